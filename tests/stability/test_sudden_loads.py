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


@pytest.mark.parametrize(("step", "radius", "error"), [(1e-3, 1.0, 1e-4), (5e-3, 1.0, 4e-4), (5e-3, 0.8, 4e-4)])
def test_a_crane_whose_springs_are_let_go(step: float, radius: float, error: float) -> None:
    """The joints' accelerations at the start carry them by a radian within a step of 1 ms."""
    exact = _crane(fa.Gauss(step=5e-3)).frame(link=-1)[0]
    with warns(fa.errors.StepWarning, "1 of", "divided"):
        r = _crane(fa.Implicit(step=step, spectral_radius=radius))
    assert np.abs(r.frame(link=-1)[0] - exact).max() < error and r.stats["failed_steps"] == 1  # m, of 2.2 m


def test_a_sudden_load_in_lanes_disturbs_no_other_arm() -> None:
    scene, t = fa.load(CRANE), np.linspace(0, 0.1, 11)
    arm, drive = scene.arm, scene.drive
    rest = arm.pose({1: -0.3, 2: 0.6})  # of the springs

    def batch(*q0: object) -> fa.BatchResult:
        return fa.simulate_batch(arm, t, q0=np.array(q0), drive=drive, integrator="implicit", step=1e-3)

    with warns(fa.errors.StepWarning, "divided"):
        alone = fa.simulate(arm, t, drive=drive, integrator=fa.Implicit(step=1e-3))
    with warns(fa.errors.StepWarning, "scenario 0", "divided"):
        both = batch(arm.zero, rest)
    assert both.stats["failed_steps"] == alone.stats["failed_steps"] == 1
    np.testing.assert_allclose(both[0].q, alone.q, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(both[1].q, batch(rest, rest)[1].q)


def _explorer(radius: float) -> fa.Arm:
    """Two links in space, whose joints have next to no inertia."""
    beam = fa.Beam(0.5, fa.Circle(radius), fa.Material(2700, 70e9, 0.33),
                   {"bending_y": 2, "bending_z": 2, "torsion": 1}, order=2)  # fmt: skip
    hub, tip = (fa.RigidBody(m, inertia=(1e-4,) * 3) for m in (0.1, 0.2))
    return fa.Arm([fa.Link(fa.Revolute(axis), hub, beam, tip) for axis in "zy"], gravity=(0, 0, -9.81))


def _leaps(arm: fa.Arm, most: float, count: int, held: int) -> np.ndarray:
    """Torques that leap behind every `held` steps, (count, 10 held, nv)."""
    tau = np.zeros((count, 10 * held, arm.nv))
    joints = [k for k, name in enumerate(arm.coordinates) if "revolute" in name]
    tau[:, :, joints] = np.repeat(np.random.default_rng(1).uniform(-most, most, (count, 10, 2)), held, axis=1)
    return tau


@pytest.mark.parametrize(("radius", "most", "step"), [(0.005, 3.0, 2e-3), (0.005, 3.0, 5e-3), (0.004, 4.0, 5e-3)])
def test_rollouts_under_torques_that_leap_go_through_and_tell(radius: float, most: float, step: float) -> None:
    """A learner's torques, held for 20 ms. The steps that are divided are counted, in a warning, and the tip stays as
    near to that of "gauss" as these steps allow."""
    arm = _explorer(radius)
    tau = _leaps(arm, most, 16, round(0.02 / step))
    with warns(fa.errors.StepWarning, "scenario", "divided", "speed"):
        r = fa.rollout(arm, arm.zero, tau=tau, step=step, every=round(0.02 / step))
    assert not r.failures and r.stats["failed_steps"] > 0
    t, held = np.linspace(0, 0.2, 11), tau[:4, :: round(0.02 / step)]
    exact = fa.simulate_batch(arm, t, tau=held[:, [*range(10), 9]], integrator="gauss", step=1e-3)
    for k in range(4):
        tips = [np.array([arm.frame(q, link=-1)[0] for q in rows]) for rows in (r.q[k], exact.q[k])]
        assert np.abs(tips[0] - tips[1]).max() < 0.1  # m, of an arm of 1 m


def test_a_divided_step_has_derivatives() -> None:
    """Of a step that only goes in parts, by differences."""
    arm, rng = _explorer(0.004), np.random.default_rng(3)
    q, v, tau = 0.01 * rng.standard_normal(arm.nq), np.zeros(arm.nv), np.zeros(arm.nv)
    tau[0], tau[1] = 4.0, -4.0
    options = {"step": 5e-3, "rtol": 1e-13}
    x = np.concatenate([q, v, tau])

    def end(x: np.ndarray) -> np.ndarray:
        q, v, tau = np.split(x, [arm.nq, 2 * arm.nq])
        with warns(fa.errors.StepWarning, "divided"):
            r = fa.rollout(arm, q, v, tau=tau[None], integrator="implicit", **options)
        return np.concatenate([r.q[0, -1], r.v[0, -1]])

    found = fa.step_derivatives(arm, q, v, tau, integrator="implicit", **options)
    for k in rng.choice(x.size, 6, replace=False):
        d = 1e-6 * np.eye(x.size)[k]
        expected = (end(x + d) - end(x - d)) / 2e-6
        np.testing.assert_allclose(np.hstack([found.A, found.B])[:, k], expected, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("coulomb", [0.0, 0.3])
def test_a_rollout_with_divided_steps_has_derivatives(coulomb: float) -> None:
    """By forces, where earlier steps have been faster, and where joints rub."""
    beam = fa.Beam(0.4, fa.Rectangle(0.006, 0.03), fa.Material(2700, 70e9, 0.33), {"bending_y": 2}, "legendre",
                   damping_ratio=0.01)  # fmt: skip
    arm = fa.Arm([fa.Link(fa.Revolute("z", coulomb=coulomb), None, beam, fa.RigidBody(0.2))] * 2, (0, -9.81, 0))
    rng, step = np.random.default_rng(0), 2e-3
    tau, along = rng.standard_normal((20, arm.nv)), rng.standard_normal(20)

    def roll(by: float) -> fa.BatchResult:
        other = tau.copy()
        other[:, 0] += by * along
        with warns(fa.errors.StepWarning, "divided"):
            return fa.rollout(arm, arm.zero, tau=other, step=step)

    here = roll(0.0)
    weights = np.zeros(here.q[0].shape)
    weights[-1, 0] = 1.0
    found = fa.rollout_gradient(arm, here.q[0], here.v[0], tau, weights, step=step).tau[:, 0] @ along
    expected = (roll(1e-5).q[0, -1, 0] - roll(-1e-5).q[0, -1, 0]) / 2e-5
    assert here.stats["failed_steps"] > 1
    assert found == pytest.approx(expected, rel=1e-4 if coulomb else 1e-5)  # switches of friction: shorter differences


def test_a_run_of_a_ball_with_a_divided_step_has_derivatives() -> None:
    """A ball has four coordinates for its three rates."""
    link = _explorer(0.004).links[0]
    ball = fa.Link(fa.Spherical(), link.hub, link.beam, link.tip)
    tau = np.zeros(fa.Arm([ball, link]).nv)
    tau[:3] = (4.0, -4.0, 1.0)

    def run(gravity: float) -> fa.Result:
        arm = fa.Arm([ball, link], (0, 0, gravity))
        with warns(fa.errors.StepWarning, "divided"):
            return fa.simulate(arm, [0, 0.03], tau=tau, integrator="implicit", step=5e-3)

    here = run(-9.81)
    expected = (run(-9.81 + 1e-4).v[-1] - run(-9.81 - 1e-4).v[-1]) / 2e-4
    found = here.sensitivities(["gravity.2"]).v[0, -1]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5 * np.abs(expected).max())
    weights = np.zeros(here.v.shape)
    weights[-1, 0] = 1.0
    by = here.gradient({"v": weights}, ["gravity.2"])["gravity.2"]
    assert by == pytest.approx(found[0], rel=1e-6)


def test_a_divided_step_leaves_friction_as_it_is() -> None:
    """A single arm and a lane have the same motion behind it."""
    arm = fa.Arm([fa.Link(fa.Revolute(axis, coulomb=0.3), link.hub, link.beam, link.tip)
                  for axis, link in zip("zy", _explorer(0.004).links, strict=True)], gravity=(0, 0, -9.81))  # fmt: skip
    t, tau = np.linspace(0, 0.04, 9), np.zeros(arm.nv)
    tau[[0, arm.coordinates.index("link 1 revolute")]] = (3.0, -4.0)
    with warns(fa.errors.StepWarning, "divided"):
        alone = fa.simulate(arm, t, tau=tau, integrator=fa.Implicit(step=5e-3))
    with warns(fa.errors.StepWarning, "divided"):
        both = fa.simulate_batch(arm, t, q0=np.array([arm.zero] * 2), tau=tau[None], integrator="implicit", step=5e-3)
    np.testing.assert_allclose(both[1].q, alone.q, rtol=0, atol=1e-8)


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
