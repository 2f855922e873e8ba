"""Springs that are let go and torques that leap on joints with hardly any inertia: implicit steps go on."""

from __future__ import annotations

from pathlib import Path

import flexarm as fa
import numpy as np
import pytest

CRANE = Path(__file__).parents[1] / "data" / "crane.toml"


def _crane(integrator: fa.Gauss | fa.Implicit) -> fa.Result:
    """The first 0.3 s: the joints' springs are let go at t = 0, where they pull with 270 and 240 N m."""
    scene = fa.load(CRANE)
    return fa.simulate(scene.arm, np.linspace(0, 0.3, 31), drive=scene.drive, integrator=integrator)


@pytest.mark.parametrize(("step", "radius", "error"), [(1e-3, 1.0, 2e-3), (5e-3, 1.0, 5e-2), (5e-3, 0.8, 0.1)])
def test_a_crane_whose_springs_are_let_go(step: float, radius: float, error: float) -> None:
    """The joints' accelerations at the start carry them by a radian within a step of 1 ms."""
    exact = _crane(fa.Gauss(step=5e-3)).frame(link=-1)[0]
    tip = _crane(fa.Implicit(step=step, spectral_radius=radius)).frame(link=-1)[0]
    assert np.abs(tip - exact).max() < error  # m, of an arm of 2.2 m


def test_a_sudden_load_in_lanes_disturbs_no_other_arm() -> None:
    scene, t = fa.load(CRANE), np.linspace(0, 0.1, 11)
    arm, drive = scene.arm, scene.drive
    rest = arm.pose({1: -0.3, 2: 0.6})  # of the springs

    def batch(*q0: object) -> fa.BatchResult:
        return fa.simulate_batch(arm, t, q0=np.array(q0), drive=drive, integrator="implicit", step=1e-3)

    alone = fa.simulate(arm, t, drive=drive, integrator=fa.Implicit(step=1e-3))
    both = batch(arm.zero, rest)
    np.testing.assert_allclose(both[0].q, alone.q, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(both[1].q, batch(rest, rest)[1].q)
