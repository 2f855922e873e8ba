"""A run that may switch to a richer arm tells, and remembers, what makes its numbers wrong."""

from __future__ import annotations

from dataclasses import replace

import flexarm as fa
import numpy as np
import pytest
from messages import warns

STEEL = fa.Material(7850, 209e9, 0.3)


@pytest.fixture(scope="module")
def plan() -> fa.results.ModelPlan:
    beam = fa.Beam(0.5, fa.Rectangle(0.002, 0.02), STEEL, {"bending_y": 1}, "legendre")
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, inertia=(0.1, 0.1, 0.1)), beam)])
    return fa.economize(fa.Scene(arm, {0: fa.Torque(lambda t: float(np.sin(20 * t)))}, t=np.linspace(0, 1, 21)), 1e-3)


@pytest.mark.parametrize("limit", [np.inf, 1e-6], ids=["one arm", "two arms"])
def test_a_pulse_that_no_step_has_seen_is_told(plan: fa.results.ModelPlan, limit: float) -> None:
    """It was told by nobody, and check() of the result did not list it."""

    def pushed(t: float) -> float:
        return 5.0 if 0.8005 < t < 0.8025 else 0.1 * (t > 0.3)

    options = {"integrator": "implicit", "step": 0.01}
    scene = replace(plan.scene, drive={0: fa.Torque(pushed)}, options=options)
    other = replace(plan, scene=scene, watch=fa.Watch({("rotation", 0): limit}))
    with warns(fa.errors.StepWarning, "5", "t = 0.80") as told:
        run = other.run(adapt=True)
    assert len(told) == 1 and (run.arm.nv == plan.arm.nv) == np.isinf(limit)
    assert "is 5 at t = 0.80" in str(run.check())


@pytest.mark.parametrize("begins", [0.0, 0.5])
def test_a_start_in_words_is_that_of_the_arm_that_runs(plan: fa.results.ModelPlan, begins: float) -> None:
    """It goes on from where the lean arm was, or from the rich one's own balance where it begins with that."""
    push = fa.Torque(lambda t: 0.0 if t < begins else 0.05 * float(np.sin(20 * (t - begins))))
    sag = [fa.Load(-1, force=(0.0, -1e-3, 0.0))] if begins == 0.0 else []
    scene = replace(plan.scene, drive={0: push}, loads=sag, q0="trim", options={"integrator": "implicit", "step": 0.01})
    run = replace(plan, scene=scene, watch=fa.Watch({("rotation", 0): 1e-6})).run(adapt=True)
    assert run.arm.nv > plan.arm.nv and (run.t == scene.t).all()
    np.testing.assert_allclose(run.q[0], run.arm.trim(loads=sag).q, atol=1e-9)
    assert np.ptp(run.q[:, 0]) > 1e-4
