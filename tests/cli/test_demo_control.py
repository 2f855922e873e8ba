"""The paper's Fig. 7, 12 and 13: the identified arm meets what the paper says of PD, and strain feedback damps it."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from flexarm.cli.paper import control as dc
from messages import warns
from pages import Ran


@pytest.fixture(scope="module")
def control(demonstration: tuple[Any, Any]) -> dc.Control:
    return demonstration[0].control


def test_pd_shows_the_papers_numbers(control: dc.Control) -> None:
    """0.098 s, 0.143 s, 2.2 %, 50 m/s^2, as printed; and the joint is held while the link rings on."""
    m = control.marks[0.0]
    assert m.rise == pytest.approx(0.098, abs=5e-4)
    assert m.settling == pytest.approx(0.143, abs=5e-4)
    assert m.overshoot == pytest.approx(2.2, abs=0.05)
    assert m.ringing == pytest.approx(50.0, abs=0.5)
    assert m.held < 1.5 and np.isnan(m.quiet)
    r = control.runs[0.0]
    assert not r.v[r.t > 1.5, 0].any()  # exactly still


def test_the_scene_runs_fig_12(control: dc.Control) -> None:
    r = fa.load("ist_control").run()
    np.testing.assert_allclose(r.q, control.runs[0.0].q, atol=1e-9)


def test_marks_do_not_depend_on_the_integrator(control: dc.Control) -> None:
    arm = fa.load("ist_control").arm
    law = fa.StrainFeedback(dc.KP, dc.KV, 0.0, reference=dc.STEP, motor=fa.Motor(dc.DRIVE_GAIN))
    t = control.runs[0.0].t
    m = dc.marks(fa.simulate(arm, t, control=law, rtol=1e-8), dc.STEP)
    for name, tolerance in (("rise", 1e-5), ("settling", 1e-5), ("overshoot", 1e-3), ("ringing", 0.1), ("held", 2e-3)):
        assert getattr(m, name) == pytest.approx(getattr(control.marks[0.0], name), abs=tolerance), name


def test_strain_feedback_damps_and_costs_the_joint(control: dc.Control) -> None:
    pd, strain = control.marks[0.0], control.marks[dc.KS]
    assert strain.ringing < pd.ringing / 7 and 3.0 < strain.quiet < 4.0
    assert strain.decay > 4 * pd.decay
    assert 20 < strain.overshoot < 30 and strain.rise == pytest.approx(0.163, abs=2e-3)
    with warns(fa.errors.LoopWarning, "energy"):
        other = dc.marks(dc.respond(fa.load("ist_control").arm, -dc.KS, duration=1.0), dc.STEP)
    assert other.ringing > 200  # the other sign drives the vibration


def test_peaks_of_the_gauge(control: dc.Control) -> None:
    bare = control.fine[dc.STEEL].peaks(3)
    np.testing.assert_allclose(bare, np.array([20.948766, 131.283672, 367.598084]) / (2 * np.pi), atol=0.02)
    heavy = next(s for density, s in control.fine.items() if density != dc.STEEL).peaks(3)
    np.testing.assert_allclose(heavy / bare, np.sqrt(7850 / 8533), rtol=2e-3)
    assert [f"{x:.1f}" for x in control.peaks] == ["2.9", "20.5", "55.7"]


def test_marks_of_a_known_response() -> None:
    """By hand: a joint that ramps to 1.1 and back to 1, and an angular acceleration that dies at 1 s."""
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, inertia=(1, 1, 1), end=(0.5, 0, 0)))])
    t = np.linspace(0, 4, 4001)
    q = np.interp(t, [0, 1, 1.1, 1.3, 4], [0, 1, 1.1, 1.0, 1.0])[:, None]
    a = np.zeros((t.size, 1))
    a[t < 1.0] = 80.0 * np.exp(-t[t < 1.0, None])
    v = np.gradient(q[:, 0], t)[:, None] * (t[:, None] < 1.3)
    m = dc.marks(fa.Result(arm, t, q, v, a, 0 * a), 1.0)
    assert m.rise == pytest.approx(0.8, abs=1e-9) and m.overshoot == pytest.approx(10.0)
    assert m.settling == pytest.approx(1.2, abs=1e-9) and m.error == pytest.approx(0.0, abs=1e-9)
    assert m.held == pytest.approx(1.3, abs=2e-3) and m.ringing == 0.0
    assert m.quiet == pytest.approx(1.0, abs=2e-3)  # 0.5 m off the axis: 40 exp(-t), cut off at 1 s


def test_numbers_of_the_example_of_ringing_md(page_of_docs: Callable[[str], Ran]) -> None:
    """Its controllers, designed on the linear model, still the nonlinear arm that PD leaves ringing."""
    pytest.importorskip("control")
    names = page_of_docs("docs/ringing.md").names
    arm, t, knock = names["arm"], names["t"], names["knock"]
    pd = fa.simulate(arm, t, control=fa.PD(13.8, 0.063), loads=[knock], integrator="gauss", step=0.01)
    left = {k: np.abs(r.tip_deflection()[t > 1, 1]).max() for k, r in (names | {"pd": pd}).items() if k in RUNS}
    assert left["pd"] > 0.05 and left["lqr"] < 0.005 and left["strain"] < 0.005
    assert names["poles"].real.max() < -1


RUNS = ("pd", "lqr", "strain")


def test_the_loop_is_lost_where_the_linear_model_says() -> None:
    """Strain feedback sampled at 100 Hz, 3 % below and above the discretised model's limit, without dry friction."""
    sys.path.insert(0, str(Path(__file__).parents[2] / "bench" / "cli"))
    import strain_feedback as sf

    arm = fa.load("ist_control").arm
    assert sf.limits(arm, None)[0] is None
    low, high = sf.limits(arm, 100.0)
    assert low.value == pytest.approx(-0.01332, rel=1e-3) and high.value == pytest.approx(0.00668, rel=2e-3)
    for factor in (0.97, 1.03):
        ks = factor * low.value
        expected = fa.closed_loop(arm, sf.law_of(ks, 100.0)).growth
        assert np.sign(expected) == np.sign(factor - 1)
        assert sf.simulated_growth(arm, ks, 100.0) == pytest.approx(expected, abs=0.003)
