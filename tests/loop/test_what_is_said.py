"""Runs that grow by their loop: no other cause is named, and no remedy that is none."""

from __future__ import annotations

import warnings

import flexarm as fa
import numpy as np
import pytest
from arms import paper_link

STEPS = {"ida": None, "implicit": 1e-3, "gauss": 1e-2, "rk4": 2e-4}
MEASURED = [("joint", 0), ("rate", 0), ("strain", 0, 0.0, "K3")]
LOOPS = {
    "strain feedback of the wrong sign": fa.StrainFeedback(2.0, 0.05, 2.0, reference=0.3),
    "the same with a limit": fa.StrainFeedback(2.0, 0.05, 2.0, reference=0.3, limit=0.3),
    "negative damping, a limit": fa.PD(2.0, -0.05, reference=0.3, limit=0.5),
    "too slow": fa.Sampled(lambda t, y: -2.0 * (y[0] - 0.3) - 0.5 * y[1], 100, MEASURED),
    "too late": fa.Sampled(lambda t, y: -2.0 * (y[0] - 0.3) - 0.05 * y[1], 200, MEASURED, delay=0.05),
    "an integral that is too strong": fa.LinearController.pid(2.0, 50.0, 0.05, reference=0.3, filter_time=0.01),
    "computed torque, too fast for the beam": fa.ComputedTorque(400.0, reference=0.3, rate=200),
}


def said(run) -> str:
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        try:
            found = run()
        except fa.SimulationError as e:
            return str(e)
    failures = [f.reason for f in getattr(found, "failures", [])]
    return "; ".join([*(str(w.message) for w in heard), *failures])


def is_the_loops(text: str) -> None:
    assert "control[0]" in text and ("feeds energy in" in text or "is unstable" in text), text
    for remedy in ("smaller step", "take order", "take a", "a larger"):
        assert remedy not in text, text


@pytest.mark.parametrize("integrator", STEPS)
@pytest.mark.parametrize("law", LOOPS)
def test_no_run_is_told_to_take_smaller_steps_or_a_higher_order(law: str, integrator: str) -> None:
    t = np.linspace(0, 3, 151)
    for order in (1, 2):
        is_the_loops(said(lambda n=order: fa.simulate(
            paper_link(n), t, control=LOOPS[law], integrator=integrator, step=STEPS[integrator]
        )))  # fmt: skip


@pytest.mark.parametrize("integrator", ["implicit", "rk4"])
@pytest.mark.parametrize("law", LOOPS)
def test_nor_is_a_batch(law: str, integrator: str) -> None:
    arm, t = paper_link(), np.linspace(0, 3, 31)
    is_the_loops(said(lambda: fa.simulate_batch(
        arm, t, np.zeros((2, arm.nq)), control=LOOPS[law], integrator=integrator, step=STEPS[integrator]
    )))  # fmt: skip


def test_a_beam_bent_too_far_by_a_stable_loop_is_told_of_its_order() -> None:
    law = fa.PD(2.0, 0.5, reference=lambda t: 30.0 * min(t, 0.2))
    assert "take order" in said(lambda: fa.simulate(paper_link(), np.linspace(0, 0.5, 51), control=law))
