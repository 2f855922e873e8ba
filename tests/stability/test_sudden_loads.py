"""Springs that are let go and torques that leap on joints with hardly any inertia: implicit steps go on."""

from __future__ import annotations

from pathlib import Path

import flexarm as fa
import numpy as np
import pytest
from messages import warns

CRANE = Path(__file__).parents[1] / "data" / "crane.toml"


def _crane(integrator: fa.Gauss | fa.Implicit) -> fa.Result:
    """The first 0.3 s: the joints' springs are let go at t = 0, where they pull with 270 and 240 N m."""
    scene = fa.load(CRANE)
    return fa.simulate(scene.arm, np.linspace(0, 0.3, 31), drive=scene.drive, integrator=integrator)


@pytest.mark.parametrize(("step", "radius", "error"), [(1e-3, 1.0, 2e-3), (5e-3, 1.0, 5e-2), (5e-3, 0.8, 0.1)])
def test_a_crane_whose_springs_are_let_go(step: float, radius: float, error: float) -> None:
    """The joints' accelerations at the start carry them by a radian within a step of 1 ms."""
    exact = _crane(fa.Gauss(step=5e-3)).frame(link=-1)[0]
    with warns(fa.errors.StepWarning, "second start", "alone"):
        r = _crane(fa.Implicit(step=step, spectral_radius=radius))
    assert np.abs(r.frame(link=-1)[0] - exact).max() < error and r.stats["failed_steps"] > 0  # m, of an arm of 2.2 m


def test_a_sudden_load_in_lanes_disturbs_no_other_arm() -> None:
    scene, t = fa.load(CRANE), np.linspace(0, 0.1, 11)
    arm, drive = scene.arm, scene.drive
    rest = arm.pose({1: -0.3, 2: 0.6})  # of the springs

    def batch(*q0: object) -> fa.BatchResult:
        return fa.simulate_batch(arm, t, q0=np.array(q0), drive=drive, integrator="implicit", step=1e-3)

    with warns(fa.errors.StepWarning, "second start"):
        alone = fa.simulate(arm, t, drive=drive, integrator=fa.Implicit(step=1e-3))
    both = batch(arm.zero, rest)
    np.testing.assert_allclose(both[0].q, alone.q, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(both[1].q, batch(rest, rest)[1].q)


def test_a_step_that_fails_leaves_nothing_behind() -> None:
    """A step, shorter than the one before, that fails: what comes behind it is as if it had not been tried."""
    scene = fa.load(CRANE)
    rest = scene.arm.pose({1: -0.3, 2: 0.6})
    sim = fa.Simulation(scene.arm, fa.Implicit(step=1e-2, spectral_radius=0.7), q0=rest)
    sim.step(until=0.1)
    state, zero = sim.state(), np.zeros(scene.arm.nv)
    sim.set_tau(zero + 1e9)
    with pytest.raises(fa.SimulationError):
        sim.step(until=0.107)
    sim.set_tau(zero)
    sim.step(until=0.103)
    q, v = sim.q, sim.v
    sim.restore(state)
    sim.set_tau(zero)
    sim.step(until=0.103)
    np.testing.assert_array_equal(q, sim.q)
    np.testing.assert_array_equal(v, sim.v)
