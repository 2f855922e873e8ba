"""Dry friction in the equations of the implicit step: single runs, batches, lanes, environments."""

from __future__ import annotations

import flexarm as fa
import numpy as np
import pytest
from arms import STEEL

lanes = pytest.mark.parametrize("side_by_side", [True, False], ids=["lanes", "one by one"])
G = 9.81


def rotor(coulomb: float, stiction: float | None = None, inertia: float = 0.1) -> fa.Arm:
    joint = fa.Revolute("z", coulomb=coulomb, stiction=stiction)
    return fa.Arm([fa.Link(joint, fa.RigidBody(1.0, inertia=(inertia, inertia, inertia)))])


def chain(coulomb, stiction=None, thickness: float = 0.003, modes: int = 2, flexible: bool = True) -> fa.Arm:
    """Hanging links with friction, of thin steel or rigid."""
    links = []
    for k, c in enumerate(coulomb):
        joint = fa.Revolute("z", coulomb=c, stiction=None if stiction is None else stiction[k])
        hub = fa.RigidBody(0.3, com=(0.03, 0, 0), inertia=(1e-3, 1e-3, 2e-3), end=(0.075, 0, 0))
        beam = fa.Beam(0.3, fa.Rectangle(thickness, 0.02), STEEL, {"bending_y": modes}, damping_ratio=0.02)
        links.append(fa.Link(joint, hub, beam if flexible else None))
    return fa.Arm(links, gravity=(0, -G, 0))


def joints(arm: fa.Arm) -> list[int]:
    return [i for i, name in enumerate(arm.coordinates) if "revolute" in name]


def waves(arm: fa.Arm) -> dict[int, fa.Torque]:
    return {k: fa.Torque(lambda t, k=k: 0.4 / (1 + k) * np.sin(7 * t * (1 + 0.3 * k))) for k in range(len(arm.links))}


def held_waves(arm: fa.Arm, count: int, steps: int, dt: float, seed: int = 0) -> np.ndarray:
    rng, t = np.random.default_rng(seed), np.arange(steps) * dt
    tau = np.zeros((count, steps, arm.nv))
    for b in range(count):
        for k, i in enumerate(joints(arm)):
            tau[b, :, i] = 0.3 / (1 + k) * np.sin(t * rng.uniform(3, 12) + rng.uniform(0, 6))
    return tau


@lanes
def test_a_torque_below_the_friction_moves_nothing(side_by_side: bool) -> None:
    tau = np.full((3, 100, 1), 0.1)
    tau[1] = -0.4999
    r = fa.rollout(rotor(0.5), [0.3], tau=tau, step=1e-3, lanes=side_by_side)
    assert np.all(r.q == 0.3) and np.all(r.v == 0.0) and not r.failures


@pytest.mark.parametrize("integrator", [fa.RK4(1e-3), fa.Gauss(2e-3), fa.Implicit(1e-3), fa.Ida()])
def test_a_batch_has_the_numbers_of_single_runs(integrator: fa.Integrator) -> None:
    """Of pushed chains whose joints stick and slide, with a joint without friction in one scenario; to the bit, but for
    rounding in the lanes."""
    t, coulomb = np.linspace(0.0, 0.4, 41), np.array([0.0, 0.02, 5.0])
    push = {0: fa.Torque(t, 0.3 * np.sin(9.0 * t))}
    runs = fa.simulate_batch(
        chain([0.05, 0.0], flexible=False), t, parameters={"link.1.joint.coulomb": coulomb}, drive=push,
        integrator=integrator, outputs=("q", "v", "a", "tau"),
    )  # fmt: skip
    assert not runs.failures
    for k in range(3):
        one = fa.simulate(runs.arm(k), t, drive=push, integrator=integrator)
        for name in ("q", "v", "a", "tau"):
            x, y = getattr(runs, name)[k], getattr(one, name)
            np.testing.assert_allclose(x, y, rtol=0, atol=1e-9 * np.abs(y).max() if runs.stats["lanes"] else 0)
    assert np.ptp(runs.q[2, :, 1]) == 0 < np.ptp(runs.q[0, :, 1])


@lanes
def test_sliding_to_rest(side_by_side: bool) -> None:
    """From 1 rad/s against 0.5 N m, pushed by 0.1 N m in a direction: it stops after J v / (0.5 -/+ 0.1), has turned
    by half of that, but for h² a / 8, and lies still to the bit."""
    dt, steps = 7.3e-3, 80
    tau = np.zeros((5, steps, 1))
    tau[:, :, 0] = np.array([0.1, -0.1, 0.0, 0.3, 0.49])[:, None]
    r = fa.rollout(rotor(0.5), [0.0], [1.0], tau, step=dt, lanes=side_by_side)
    brake = (0.5 - tau[:, 0, 0]) / 0.1
    for k in range(4):
        still = r.t > 1 / brake[k] + dt
        assert np.all(r.v[k, still] == 0.0) and np.ptp(r.q[k, still]) == 0.0
        assert abs(r.q[k, -1, 0] - 0.5 / brake[k]) <= dt**2 * brake[k] / 8 * (1 + 1e-9)
    np.testing.assert_allclose(r.q[4, :, 0], r.t - brake[4] * r.t**2 / 2, atol=1e-12)


@lanes
def test_breakaway_at_the_stiction_then_coulomb(side_by_side: bool) -> None:
    """A torque that grows by 1 N m/s, held over steps: still up to the stiction, 0.3 N m; then tau - 0.2 N m."""
    dt, steps = 1e-3, 500
    r = fa.rollout(rotor(0.2, 0.3), [0.0], tau=np.arange(steps)[None, :, None] * dt, step=dt, lanes=side_by_side)
    held, s = r.t < 0.3, r.t[r.t > 0.302] - 0.3
    assert np.all(r.q[0, held] == 0.0) and np.all(r.v[0, held] == 0.0)
    np.testing.assert_allclose(r.v[0, r.t > 0.302, 0], (0.1 * s + s**2 / 2) / 0.1, atol=2 * dt)
    np.testing.assert_allclose(np.diff(r.v[0, r.t > 0.302, 0]) * 0.1 / dt, r.t[r.t > 0.302][:-1] - 0.2, atol=1e-9)


@pytest.mark.parametrize(
    "arm",
    [
        chain([0.1, 0.02], flexible=False),
        chain([0.1, 0.05, 0.02], [0.2, 0.1, 0.04], flexible=False),
        chain([0.1, 0.05]),
        chain([0.3, 0.15], [0.5, 0.25]),
    ],
    ids=["rigid", "rigid, stiction", "flexible", "flexible, stiction"],
)
def test_second_order_over_many_switches(arm: fa.Arm) -> None:
    """Joints that stick and slide together, against the path whose switches are found as events, of high order."""
    t = np.linspace(0, 1.0, 21)
    exact = fa.simulate(arm, t, drive=waves(arm), integrator="gauss", step=2e-3)
    assert exact.stats["switches"] >= 4
    error = {}
    for h in (1e-3, 2.5e-4):
        r = fa.simulate(arm, t, drive=waves(arm), integrator="implicit", step=h)
        error[h] = np.abs(r.q - exact.q)[:, joints(arm)].max()
    assert abs(r.stats["switches"] - exact.stats["switches"]) <= 1
    assert error[2.5e-4] < 1e-3 and error[1e-3] > 6 * error[2.5e-4]


def test_against_moreau_time_stepping() -> None:
    """An independent program of first order: v' = v + M⁻¹ (h (tau - bias) + p), with impulses p of friction from
    projection, p in [-h F, h F], v' = 0 inside, v' against p at its ends (Moreau 1988)."""
    coulomb = np.array([0.15, 0.05])
    arm = chain(coulomb, flexible=False)
    h, steps = 4e-4, 1600
    tau = lambda t: np.array([0.5 * np.sin(9 * t), 0.2 * np.sin(14 * t)])  # noqa: E731
    q, v, rests = np.zeros(2), np.zeros(2), 0
    path = [q]
    for k in range(steps):
        W = np.linalg.inv(arm.mass_matrix(q))
        free = v + W @ (h * (tau((k + 0.5) * h) - arm.bias(q, v)))
        p = np.zeros(2)
        for _ in range(15):
            for i in range(2):
                p[i] = np.clip(p[i] - (free + W @ p)[i] / W[i, i], -h * coulomb[i], h * coulomb[i])
        new = free + W @ p
        new[np.abs(new) < 1e-9] = 0.0
        rests += int(np.sum(new == 0.0))
        q, v = q + h * 0.5 * (v + new), new
        path.append(q)
    t = np.linspace(0, h * steps, 41)
    drive = {k: fa.Torque(lambda s, k=k: tau(s)[k]) for k in range(2)}
    r = fa.simulate(arm, t, drive=drive, integrator="implicit", step=1e-3)
    assert rests > 100 and r.stats["switches"] >= 4
    assert np.sum(r.v[1:] == 0.0) > 2
    np.testing.assert_allclose(r.q, np.array(path)[:: steps // 40], atol=0.01 * np.ptp(path))


@pytest.mark.filterwarnings("ignore::flexarm.errors.RangeWarning")
def test_friction_does_not_break_steps_that_go_well_without() -> None:
    """Beams with modes far too fast for the step: a switch must not wake them. (When states were interpolated at
    switches, it did: all of these runs failed.)"""
    pairs = np.random.default_rng(0).uniform(-1, 1, (30, 2))
    ends = []
    for coulomb in (0.0, 1e-9, 0.1):
        joint = fa.Revolute("z", coulomb=coulomb)
        hub = fa.RigidBody(0.1, inertia=(1e-3, 1e-3, 1e-3), end=(0.075, 0, 0))
        link = fa.Link(joint, hub, fa.Beam(0.5, fa.Rectangle(0.003, 0.02), STEEL, {"bending_y": 5}))
        arm = fa.Arm([link, link])
        tau = np.zeros((30, 1, arm.nv))
        tau[:, 0, joints(arm)] = pairs
        r = fa.rollout(arm, arm.zero, tau=tau, step=2e-3, nstep=250, every=250)
        assert not r.failures
        ends.append(r.q[:, -1])
        for k in range(5):
            one = fa.simulate(arm, np.linspace(0, 0.5, 6), tau=tau[k, 0], integrator="implicit", step=2e-3)
            np.testing.assert_allclose(one.q[-1], r.q[k, -1], atol=1e-9)
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-6)
    assert np.abs(ends[2] - ends[0]).max() > 0.1


def test_scenarios_are_what_simulate_gives_whoever_their_partners_are() -> None:
    """Different friction in the lanes of a pack, and none; accelerations and forces; a prescribed joint that rubs."""
    t = np.linspace(0, 0.6, 61)
    arm = chain([0.1, 0.05])
    values = {"link.0.joint.coulomb": np.array([0.1, 0.0, 0.3, 0.02, 0.1, 5.0, 0.2, 0.05, 0.1])}
    values["link.0.joint.stiction"] = 1.5 * values["link.0.joint.coulomb"]
    force = fa.Torque(t, 0.4 * np.sin(9 * t))
    given = fa.Motion(t, 0.3 * np.sin(12 * t))
    for drive in ({0: force}, {0: force, 1: given}):
        options = {"drive": drive, "integrator": "implicit", "step": 2e-3}
        every = fa.simulate_batch(arm, t, parameters=values, outputs=("q", "v", "a", "tau"), **options)
        assert every.stats["lanes"] > 0 and not every.failures
        for i in range(9):
            one = fa.simulate(every.arm(i), t, **options)
            for name in ("q", "v", "a", "tau"):
                x, y = getattr(every, name)[i], getattr(one, name)
                np.testing.assert_allclose(x, y, rtol=0, atol=1e-10 * max(1.0, np.abs(y).max()), err_msg=name)
            others = {k: np.repeat(x[i : i + 1], 5, axis=0) for k, x in values.items()}
            apart = fa.simulate_batch(arm, t, parameters=others, **options)
            np.testing.assert_array_equal(apart.q[0], every.q[i])
            np.testing.assert_array_equal(apart.v[0], every.v[i])
            alone = fa.simulate_batch(arm, t, parameters={k: x[i : i + 1] for k, x in values.items()}, **options)
            np.testing.assert_allclose(alone.q[0], every.q[i], rtol=0, atol=1e-10 * max(1.0, np.abs(every.q[i]).max()))


def test_joints_without_friction_beside_those_with_it() -> None:
    """A freedom without friction that turns back is not brought to rest, whatever it shares its lanes with."""
    coulomb = [[0.0, 0.0], [0.02, 0.0], [0.0, 0.01], [0.02, 0.01], [0.0, 0.0]]
    arms, dt, steps = [chain(c) for c in coulomb], 2e-3, 250
    v0 = np.array([[1.0, -0.5, *np.zeros(arms[0].nv - 2)]]) * np.arange(1, 6)[:, None]
    r = fa.rollout(arms, arms[0].zero, v0, step=dt, nstep=steps)
    for i, arm in enumerate(arms):
        one = fa.simulate(arm, r.t, arm.zero, v0[i], integrator="implicit", step=dt)
        np.testing.assert_allclose(r.q[i], one.q, rtol=1e-9, atol=1e-9)


def test_lanes_agree_with_one_by_one() -> None:
    for arm in (chain([0.1, 0.05], [0.2, 0.1]), chain([0.05] * 5, flexible=False)):
        tau = held_waves(arm, 11, 300, 2e-3)
        side, one = (fa.rollout(arm, arm.zero, tau=tau, step=2e-3, lanes=x) for x in (True, False))
        np.testing.assert_allclose(side.q, one.q, atol=1e-11)
        assert not side.failures
        rests = one.v[:, :, joints(arm)] == 0.0
        assert 0.02 < rests.mean() < 0.95
        np.testing.assert_array_equal(side.v[:, :, joints(arm)] == 0.0, rests)


def test_an_environment_has_the_friction_of_its_arm() -> None:
    tasks = pytest.importorskip("flexarm.tasks")
    env = pytest.importorskip("flexarm.env")
    from dataclasses import replace

    task = tasks.VibrationSuppression()
    link = task.arm.links[0]
    moved = []
    for coulomb in (0.0, 0.5):
        stiff = fa.Arm([replace(link, joint=replace(link.joint, coulomb=coulomb))], gravity=task.arm.gravity)
        envs = env.FlexarmVectorEnv(2, tasks.VibrationSuppression(arm=stiff))
        envs.reset(seed=0)
        start = envs.state.q[:, 0].copy()
        for _ in range(20):
            envs.step(np.full((2, 1), 0.2))  # 0.1 N m
        moved.append(np.abs(envs.state.q[:, 0] - start).max())
    assert moved[0] > 1e-3 and moved[1] == 0.0


def test_partners_that_stick_at_other_times_change_no_digit() -> None:
    """An arm in a lane needs the columns of its contact equations when it sticks, whenever its partners do."""
    body, tip = fa.RigidBody(0.2, (0.1, 0.05, 0), (1e-3,) * 3, (0.3, 0, 0)), fa.RigidBody(0.1)
    joints = [fa.Revolute("z", coulomb=0.5, stiction=0.6), fa.Revolute("x", coulomb=0.2), fa.Revolute("y", coulomb=0.1)]
    arm, rng = fa.Arm([fa.Link(joint, body, tip=tip) for joint in joints]), np.random.default_rng(0)
    q0, v0 = rng.normal(size=(8, 3)), rng.normal(size=(8, 3)) * np.array([0, 0.3, 1, 3, 5, 7, 9, 10])[:, None]
    tau = rng.normal(size=(8, 30, 3))
    together = fa.rollout(arm, q0, v0, tau, step=2e-3)
    for k in range(8):
        alike = [k] * 5  # so many that they run in lanes
        apart = fa.rollout(arm, q0[alike], v0[alike], tau[alike], step=2e-3)
        np.testing.assert_array_equal(apart.q[0], together.q[k])


@pytest.mark.parametrize("integrator", ["gauss", "rk4"])
@pytest.mark.parametrize(("begins", "force"), [(0.5, lambda t: float(t > 0.5)), (0.3, lambda t: float(t >= 3 * 0.1))])
def test_a_force_that_leaps_just_behind_a_step_tears_a_joint_loose(integrator, begins, force) -> None:
    """A mass of 1 kg under 1 N beyond its stiction of 0.3 N; Coulomb friction of 0.2 N slows it down."""
    arm = fa.Arm([fa.Link(fa.Prismatic("x", coulomb=0.2, stiction=0.3), fa.RigidBody(1.0, inertia=(1, 1, 1)))])
    t = np.linspace(0.0, 1.0, 11)
    run = fa.simulate(arm, t, drive={0: fa.Torque(force)}, integrator=integrator, step=0.01)
    assert run.v[-1, 0] == pytest.approx(0.8 * (1.0 - begins), abs=1e-6) and run.stats["switches"] == 1
    assert abs(run.sensitivities(["link.0.joint.stiction"]).v[0, -1, 0]) < 1e-8  # the time of the leap is given
