"""Control loops that theory says fail, judged: docs/failures.md."""

from __future__ import annotations

import flexarm as fa
import numpy as np
import pytest
from messages import warns
from scipy.optimize import brentq
from stability import loops


def test_sampled_strain_feedback_is_lost_at_the_rate_that_the_poles_tell() -> None:
    loop = fa.closed_loop(loops.paper_arm(), loops.strain_feedback(500.0))
    lost = loop.limits("control.0.rate")
    assert lost.low == pytest.approx(112.713, rel=1e-4) and lost.frequencies[0] == pytest.approx(128.5, rel=1e-3)
    assert loops.critical(loops.rate_growth, 0.98 * lost.low, 1.02 * lost.low) == pytest.approx(lost.low, rel=2e-3)


def test_a_delay_is_lost_where_the_margin_ends() -> None:
    loop = fa.closed_loop(loops.paper_arm(), loops.strain_feedback(500.0))
    late = loop.limits("control.0.delay").high
    assert late == pytest.approx(loop.margins[0].delay, rel=1e-9)
    assert loops.critical(loops.delay_growth, 0.98 * late, 1.02 * late) == pytest.approx(late, rel=3e-3)


def test_pd_on_the_tip_is_lost_at_a_gain_at_which_pd_on_the_joint_is_not() -> None:
    lost = fa.closed_loop(loops.slender(), loops.pd_on("tip")).limits()
    assert not lost.stable and 0.3 < lost.high < 1.0
    assert loops.critical(loops.tip_growth, 0.9 * lost.high, 1.1 * lost.high) == pytest.approx(lost.high, rel=1e-2)
    assert fa.closed_loop(loops.slender(), loops.pd_on("joint")).limits().high > 50 * lost.high


def lost_weight() -> float:
    return float(brentq(lambda w: fa.closed_loop(loops.slender(), loops.observed(w)).growth, 1e-2, 1e-1, rtol=1e-8))


def test_a_design_on_one_mode_is_lost_by_the_next() -> None:
    lost = lost_weight()
    for weight in (0.5 * lost, lost, 2 * lost, 10 * lost):
        assert fa.closed_loop(loops.slender(1), loops.observed(weight)).growth < -1.0  # the model that it is made on
    assert loops.critical(loops.spillover_growth, 0.9 * lost, 1.1 * lost) == pytest.approx(lost, rel=1e-2)
    with warns(fa.errors.LoopWarning, "energy"):
        fa.simulate(loops.slender(), np.linspace(0, 2, 201), [0, 1e-4, 0, 0], control=loops.observed(2 * lost))


def test_windup_begins_where_the_describing_function_says() -> None:
    loop = fa.closed_loop(loops.rigid(), loops.pid(None))
    kp, ki, kd = loops.PID_GAINS
    low = loop.margins[0].gain[0]
    assert loop.stable and low == pytest.approx(ki / (kp * kd), rel=0.01)  # of s^3 + g (kd s^2 + kp s + ki)
    amplitude, frequency = loops.described(loop.margins[0])
    found = loops.between(loops.edge())
    assert found[0] == pytest.approx(amplitude, rel=0.1) and found[1] == pytest.approx(frequency, rel=0.1)


def test_the_inverse_of_a_wrong_payload_is_off_by_what_the_servo_gives_way() -> None:
    for believed in (0.25, 0.5, 0.75):
        r = loops.lift(believed, 0.5, 20.0, 2.0)
        expected = loops.lift_error(believed, 0.5, 20.0)
        assert r.q[-60:, 0].mean() - 0.8 == pytest.approx(expected, abs=5e-5)
    theory, found = loops.left_alone(0.5)
    assert theory > 1.0 and found == pytest.approx(theory, rel=1e-3)
