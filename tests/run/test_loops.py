"""Closed loops in runs: against the same mechanism as a tree, balances of power and momentum, starts, results, files,
scenes, batches, steps, and what refuses loops by name."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from arms import STEEL, bennett
from messages import refuses

G = (0, -9.81, 0)
T = np.linspace(0.0, 0.5, 51)
FOOT = fa.Loop((0.7, 0, 0), "rocker", fa.Revolute("z"), name="foot")
LENGTHS = {"crank": 0.2, "coupler": 0.6, "rocker": 0.5}
START = {"crank": 0.5, "coupler": 0.2, "rocker": -2.1}
RUNS: dict[str, dict[str, Any]] = {
    "gauss": {"integrator": "gauss", "step": 1e-3},
    "chosen": {"integrator": "gauss"},
    "implicit": {"integrator": "implicit", "step": 2e-4},
    "rk4": {"integrator": "rk4", "step": 1e-4},
    "ida": {"integrator": "ida", "rtol": 1e-8},
}


def bar(length: float) -> fa.RigidBody:
    return fa.RigidBody(1.0, (0.5 * length, 0, 0), (0.001, 0.02, 0.02), (length, 0, 0))


def beam(length: float) -> fa.Beam:
    return fa.Beam(length, fa.Rectangle(0.006, 0.02), STEEL, {"bending_y": 2}, "legendre", damping_ratio=0.01)


def four_bar(*loops: fa.Loop, bends: bool = False, gravity: Any = G, **joint: Any) -> fa.Arm:
    links = [fa.Link(fa.Revolute("z", **joint), *((None, beam(x)) if bends else (bar(x),)), name=name)
             for name, x in LENGTHS.items()]  # fmt: skip
    return fa.Arm(links, gravity, loops=loops or (FOOT,))


def closed(arm: fa.Arm) -> np.ndarray:
    return arm.assemble(START, hold=["crank"])


def twins() -> tuple[fa.Arm, fa.Arm]:
    """A beam that hangs on a rigid link by a joint of a link; and one that a loop holds there."""
    upper = fa.Link(fa.Revolute("z"), bar(0.4), name="upper")
    thin = fa.Beam(0.5, fa.Rectangle(0.004, 0.02), STEEL, {"bending_y": 1}, "legendre", damping_ratio=0.02)
    tip = fa.RigidBody(0.2)
    tree = fa.Arm([upper, fa.Link(fa.Revolute("z"), beam=thin, tip=tip, name="fore")], G)
    free = fa.Link(fa.Planar(), beam=thin, tip=tip, name="fore", parent="world")
    return tree, fa.Arm([upper, free], G, loops=[fa.Loop("upper", ("fore", "origin"), fa.Revolute("z"), name="elbow")])


@pytest.mark.parametrize("name", RUNS)
def test_a_joint_that_closes_moves_and_pulls_as_that_of_a_link(name: str) -> None:
    tree, arm = twins()
    torque = {"upper": fa.Torque([0, 0.5], [4.0, -4.0])}
    wanted = fa.simulate(tree, T, {"upper": 0.3, "fore": -1.0}, drive=torque, integrator="gauss", step=1e-4)
    start = np.array([0.3, 0.4 * np.cos(0.3), 0.4 * np.sin(0.3), -0.7, 0])
    run = fa.simulate(arm, T, start, drive=torque, **RUNS[name])
    near = {"implicit": 2e-5, "chosen": 1e-5}.get(name, 2e-6)
    np.testing.assert_allclose(run.frame()[0], wanted.frame()[0], atol=near)
    elbow = run.loop("elbow")
    np.testing.assert_allclose(elbow.place[:, 0], wanted.q[:, 1], atol=10 * near)
    R = wanted.frame("fore", 0.0)[1]
    force = np.einsum("tij,tj->ti", R, wanted.joint_reaction("fore")[:, :3])
    np.testing.assert_allclose(elbow.force, force, atol=3e3 * near)
    assert abs(elbow.moment).max() < 1e-9 and abs(elbow.gap).max() < 1e-12
    assert abs(arm.loop_motion(run.q, run.v)[1]).max() < 1e-10


@pytest.mark.parametrize("name", RUNS)
def test_loops_stay_closed_and_energy_stays(name: str) -> None:
    arm = four_bar(bends=True)
    arm = fa.Arm([replace(x, beam=replace(x.beam, damping_ratio=0.0)) for x in arm.links], G, loops=arm.loops)
    q, v = arm.assemble(START, 8.0 * np.eye(9)[0], hold=["crank"])
    run = fa.simulate(arm, T, q, v, **RUNS[name])
    g, rate = arm.loop_motion(run.q, run.v)
    assert abs(g).max() < 1e-12 and abs(rate).max() < 1e-9
    energy = np.sum(run.energy(), axis=0)
    limit = {"implicit": 1e-3, "chosen": 1e-4}.get(name, 1e-5)
    assert abs(energy - energy[0]).max() < limit * np.ptp(run.energy()[1])
    assert np.ptp(run.q[:, 1]) > 1e-3  # beams bend


def test_a_driven_crank_takes_the_power_that_the_arm_gains() -> None:
    """The start follows from the motion: the others' positions and rates."""
    arm = four_bar(bends=True)
    turn = fa.Motion(t=[0, 0.5], q=[0.5, 2.0], v=[2.0, 4.0], a=[0, 0])
    t = np.linspace(0, 0.5, 2001)
    at = closed(arm)
    run = fa.simulate(arm, t, {"crank": 0.5, "coupler": at[3]}, drive={"crank": turn}, **RUNS["gauss"])
    assert run.q[0, 0] == 0.5 and run.v[0, 0] == 2.0 and abs(run.v[0, 3]) > 0.1 and not run.v[0, 1:3].any()
    energy = np.sum(run.energy(), axis=0)
    damping = np.zeros(len(t))
    for _, part, _, at in arm.beams():
        damping += np.einsum("ti,ij,tj->t", run.v[:, at], part._core.damping, run.v[:, at])
    power = run.tau[:, 0] * run.v[:, 0] - damping
    gained = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(t))])
    np.testing.assert_allclose(energy - energy[0], gained, atol=2e-4 * np.ptp(energy))
    assert not run.tau[:, 1:].any()


def test_reactions_of_base_and_loop_balance_momentum() -> None:
    arm = four_bar()
    t = np.linspace(0, 0.2, 401)
    run = fa.simulate(arm, t, closed(arm), **RUNS["gauss"])
    base = run.joint_reaction("crank", "inboard")
    sensor = fa.sensors.ForceTorque("crank", "inboard").read(run)
    np.testing.assert_allclose(sensor.y, base, atol=1e-12)
    foot, mass = run.loop("foot"), sum(link.mass for link in arm.links)
    P = arm.momentum(run.q, run.v)
    force = base[:, :3] + foot.force + mass * np.array(G)
    arms = np.cross([0.7, 0, 0], foot.force) + np.cross(arm.center_of_mass(run.q), mass * np.array(G))
    moment = base[:, 3:] + foot.moment + arms
    slope = np.gradient(P, t, axis=0)
    np.testing.assert_allclose(np.hstack([force, moment])[5:-5], slope[5:-5], atol=2e-3 * abs(slope).max())


def test_a_compliant_loop_gives_way_by_its_force() -> None:
    soft = replace(FOOT, stiffness=2e4, damping=300.0, angular_stiffness=50.0, angular_damping=0.5)
    arm = four_bar(soft, damping=3.0)
    run = fa.simulate(arm, np.linspace(0, 2, 201), closed(four_bar()), **RUNS["gauss"])
    foot, (g, rate) = run.loop("foot"), arm.loop_motion(run.q, run.v)
    np.testing.assert_allclose(foot.force, -2e4 * g[:, :3] - 300 * rate[:, :3], atol=1e-9)  # axes of a are the world's
    np.testing.assert_allclose(foot.gap, abs(g[:, :3]).max(axis=1), atol=1e-15)
    assert 1e-4 < foot.gap.max() < 1e-2
    rest = arm.equilibrium(run.q[-1])
    np.testing.assert_allclose(arm.forward_dynamics(rest, np.zeros(3)), 0.0, atol=1e-8)
    assert sum(arm.energy(rest, np.zeros(3))) < sum(arm.energy(closed(four_bar()), np.zeros(3)))


def test_starts_are_closed_or_named() -> None:
    arm = four_bar()
    run = fa.simulate(arm, T[:3], {"crank": 0.5})
    assert run.q[0, 0] == 0.5 and abs(arm.loop_motion(run.q[0])[0]).max() < 1e-12
    assert abs(arm.loop_motion(fa.simulate(arm, T[:3]).q[0])[0]).max() < 1e-12
    with refuses("q0", "loop 'foot'", "0.6 m", "arm.assemble"):
        fa.simulate(arm, T, np.zeros(3))
    with refuses("v0", "loop 'foot'", "m/s", "arm.assemble"):
        fa.simulate(arm, T, closed(arm), [1.0, 0, 0])
    with refuses("q0", "loop 'foot'"):
        fa.simulate(four_bar(bends=True), T, {"crank": 0.5, "coupler": 0.1, "rocker": 0.2})
    with refuses("q0", "loop 'foot'", "do not reach"):
        fa.simulate(four_bar(replace(FOOT, a=(2, 0, 0))), T)
    rest = fa.simulate(arm, T[:3], "equilibrium")
    np.testing.assert_allclose(rest.q, np.tile(arm.equilibrium(), (3, 1)), atol=1e-9)
    for word in ("trim", "held"):
        with refuses(f"q0 = '{word}'", "rigid loops", "foot"):
            fa.simulate(arm, T, word, control=fa.PD(1.0, 1.0, link="crank"))


def test_a_controlled_crank_follows_its_reference() -> None:
    arm = four_bar(bends=True, damping=0.05)
    turn = fa.Motion(t=[0, 0.5], q=[0.5, 1.5], v=[0, 0], a=[0, 0])
    run = fa.simulate(arm, T, closed(arm), control=fa.PD(2e3, 40.0, link="crank", reference=turn), **RUNS["implicit"])
    assert abs(run.q[:, 0] - [turn(t)[0] for t in T]).max() < 0.02
    assert abs(arm.loop_motion(run.q)[0]).max() < 1e-12


def test_a_result_is_kept_in_files_with_its_loops(tmp_path: Path) -> None:
    arm = four_bar()
    run = fa.simulate(arm, T, closed(arm), **RUNS["gauss"])
    for suffix in ("npz", "h5"):
        run.save(tmp_path / f"run.{suffix}")
        back = fa.Result.load(tmp_path / f"run.{suffix}")
        assert back.arm == arm and np.array_equal(back.loops, run.loops)
        assert np.array_equal(back.loop("foot").force, run.loop("foot").force)
    data = run.to_data()
    np.testing.assert_array_equal(data["foot force x"], run.loops[:, 0, 0])
    np.testing.assert_array_equal(data["foot angle"], run.loop(0).place[:, 0])
    assert data.units["foot moment z"] == "N m" and data.units["foot gap"] == "m"
    assert "Force of the loop (N)" in [a.get_ylabel() for a in run.plot().axes]
    run.loops = None
    assert np.isnan(run.loop().force).all() and np.isfinite(run.loop().gap).all()
    with refuses("loops", "foot"):
        run.joint_reaction()


FILE = """
gravity = [0, -9.81, 0]
[[link]]
name = "crank"
joint = { type = "revolute", axis = "z" }
hub = { mass = 1.0, com = [0.1, 0, 0], inertia = [0.001, 0.02, 0.02], end = [0.2, 0, 0] }
[[link]]
name = "coupler"
joint = { type = "revolute", axis = "z" }
hub = { mass = 1.0, com = [0.3, 0, 0], inertia = [0.001, 0.02, 0.02], end = [0.6, 0, 0] }
[[link]]
name = "rocker"
joint = { type = "revolute", axis = "z" }
hub = { mass = 1.0, com = [0.25, 0, 0], inertia = [0.001, 0.02, 0.02], end = [0.5, 0, 0] }
[[loop]]
name = "foot"
a = [0.7, 0, 0]
b = "rocker"
joint = { type = "revolute", axis = "z" }
[simulation]
duration = 0.5
interval = 0.01
integrator = "gauss"
step = 1e-3
q0 = [0.5, 0.22601658977, -2.14464931]
"""


def test_a_scene_file_has_loops(tmp_path: Path) -> None:
    (tmp_path / "bar.toml").write_text(FILE, encoding="utf-8")
    scene = fa.load(tmp_path / "bar.toml")
    assert scene.arm == four_bar()
    run = scene.run()
    np.testing.assert_allclose(run.q, fa.simulate(scene.arm, T, closed(scene.arm), **RUNS["gauss"]).q, atol=1e-7)
    scene.save(tmp_path / "again.toml")
    assert fa.load(tmp_path / "again.toml").arm == scene.arm
    scene.compile(tmp_path / "bar.json")
    (loop,) = json.loads((tmp_path / "bar.json").read_text(encoding="utf-8"))["arm"]["loops"]
    assert loop["kind"] == "revolute"
    (tmp_path / "wrong.toml").write_text(FILE.replace('b = "rocker"', 'b = "rokcer"'), encoding="utf-8")
    with refuses("loops[0]: b.link = 'rokcer'", "rocker"):
        fa.load(tmp_path / "wrong.toml")
    with refuses("loop[0]", "joint"):
        fa.Arm.from_dict({**four_bar().to_dict(), "loop": [{"a": [0.7, 0, 0], "b": "rocker"}]})


def test_lanes_and_rollouts_are_single_runs() -> None:
    arm = four_bar(bends=True)
    masses = np.linspace(0.0, 0.4, 8)
    arm = fa.Arm([*arm.links[:2], replace(arm.links[2], tip=fa.RigidBody(0.1))], G, loops=arm.loops)
    q, v = arm.assemble(START, 3.0 * np.eye(9)[0], hold=["crank"])
    given = {"q0": q, "v0": v, "integrator": "implicit", "step": 1e-3}
    batch = fa.simulate_batch(arm, T, parameters={"link.rocker.tip.mass": masses}, outputs=("q", "v", "loops"), **given)
    assert batch.stats["lanes"] > 1 and batch.loops.shape == (8, 51, 6)
    for k in (0, 7):
        one = fa.simulate(batch.arm(k), T, q, v, integrator="implicit", step=1e-3)
        np.testing.assert_allclose(batch[k].q, one.q, atol=1e-8)
        np.testing.assert_allclose(batch[k].loop("foot").force, one.loop("foot").force, atol=1e-3)
    roll = fa.rollout(arm, q, v, step=1e-3, nstep=500, every=10)
    np.testing.assert_allclose(roll.q[0], fa.simulate(arm, T, q, v, integrator="implicit", step=1e-3).q, atol=1e-8)
    with refuses("outputs: 'loops'", "none"):
        fa.simulate_batch(fa.Arm(arm.links), T, parameters={"link.2.tip.mass": masses}, outputs=("q", "loops"))


def test_each_scenario_of_a_batch_starts_closed() -> None:
    arm = four_bar()
    feet = np.linspace(0.65, 0.75, 5)
    batch = fa.simulate_batch(
        arm, T, {"crank": 0.5}, parameters={"loop.foot.a.offset.0": feet}, integrator="implicit", step=1e-3
    )
    for k, x in enumerate(feet):
        assert batch[k].q[0, 0] == 0.5
        np.testing.assert_allclose(batch[k].frame("rocker")[0][:, 0], x, atol=1e-12)
    assert len({batch[k].q[0, 1] for k in range(5)}) == 5
    with refuses("scenario 0", "q0", "loop 'foot'"):
        fa.simulate_batch(arm, T, closed(arm), parameters={"loop.foot.a.offset.0": feet}, step=1e-3)


def test_step_by_step_is_the_same_run() -> None:
    arm = four_bar(bends=True)
    q = closed(arm)
    run = fa.simulate(arm, T, q, integrator="implicit", step=1e-3)
    sim = fa.Simulation(arm, fa.Implicit(1e-3), t=T, q0=q)
    for t in T[1:26]:
        sim.step(until=t)
    np.testing.assert_allclose(sim.q, run.q[25], atol=1e-12)
    state = sim.state()
    for t in T[26:]:
        sim.step(until=t)
    end = sim.q
    np.testing.assert_allclose(end, run.q[-1], atol=1e-11)
    sim.restore(state)
    for t in T[26:]:
        sim.step(until=t)
    assert np.array_equal(sim.q, end)


def test_where_ida_cannot_run_it_is_not_chosen() -> None:
    arm = four_bar(coulomb=0.1)
    drive = {"crank": fa.Torque(lambda t: np.sin(20 * t))}
    run = fa.simulate(arm, T, closed(arm), drive=drive)
    assert run.stats["integrator"] == "gauss"
    with refuses("loops", "dry friction", "gauss"):
        fa.simulate(arm, T, closed(arm), drive=drive, integrator="ida")


@pytest.mark.parametrize("rtol", [1e-4, 1e-6])
def test_ida_takes_steps_on_loops_of_beams_as_on_open_chains(rtol: float) -> None:
    arm = four_bar(bends=True)
    q = closed(arm)
    run = fa.simulate(arm, T, q, integrator="ida", rtol=rtol)
    tree = fa.simulate(fa.Arm(arm.links, arm.gravity), T, q, integrator="ida", rtol=rtol, linear_solver="dense")
    assert run.stats["failed_steps"] < 0.1 * run.stats["steps"]
    assert run.stats["steps"] < 2 * tree.stats["steps"]
    np.testing.assert_allclose(run.q, fa.simulate(arm, T, q).q, atol=10 * rtol)


@pytest.mark.parametrize("size", [1e-3, 100.0])
def test_ida_runs_loops_of_beams_of_any_size(size: float) -> None:
    def bent(length: float) -> fa.Beam:
        section = fa.Rectangle(0.01 * size, 0.02 * size)
        return fa.Beam(length * size, section, STEEL, {"bending_y": 2}, "legendre", "exact", kelvin_voigt=1e-5 * size)

    links = [fa.Link(fa.Revolute("z"), beam=bent(x), name=name) for name, x in LENGTHS.items()]
    arm = fa.Arm(links, G, loops=[fa.Loop((0.7 * size, 0, 0), "rocker", fa.Revolute("z"), name="foot")])
    q, t = closed(arm), np.linspace(0, 0.5 * np.sqrt(size), 11)
    run, other = (fa.simulate(arm, t, q, integrator=x) for x in ("ida", "gauss"))
    joints = [arm.coordinate_of(arm.joint_rate(name)) for name in LENGTHS]
    np.testing.assert_allclose(run.q[:, joints], other.q[:, joints], atol=1e-4)


def test_a_linkage_that_folds_flat_keeps_its_energy() -> None:
    """Some of its conditions hold nothing where it is flat."""
    arm = bennett()
    q = arm.assemble([1.0, 2.5, 1.0])
    assert arm.mobility(q).redundant == 3
    run = fa.simulate(arm, np.linspace(0, 0.4, 401), q, integrator="implicit", step=2.5e-4)
    energy = np.sum(run.energy(), axis=0)
    assert np.ptp(run.q[:, 0]) > 0.5 and run.q[:, 0].min() < 0 < run.q[:, 0].max()  # through the flat position
    assert np.ptp(energy) < 2e-3 * np.ptp(run.energy()[0])
    assert np.abs(run.loop("close").force).max() < 200


def test_what_does_not_know_loops_refuses_them() -> None:
    arm = four_bar(damping=0.1)
    q = closed(arm)
    run = fa.simulate(arm, T, q, integrator="ida")
    scene = fa.Scene(arm, t=T, q0=q, options={"integrator": "implicit", "step": 1e-3})
    force, computed = fa.sensors.ForceTorque("crank"), fa.ComputedTorque(1.0, reference=[0.1] * 3, rate=100)
    encoder, sampled = fa.sensors.Encoder("crank"), fa.Sampled(lambda t, y: [0.0], 100, [force], actuate=["crank"])
    ways: list[tuple[str, Any]] = [
        ("derivatives of a run", lambda: run.sensitivities(["link.0.hub.mass"])),
        ("derivatives of a run", lambda: run.gradient({"q": np.ones_like(run.q)}, ["link.0.hub.mass"])),
        ("KalmanFilter", lambda: fa.KalmanFilter(arm, [encoder], 1e-3, force_noise=1e-3, q_std=1e-3, v_std=1e-3)),
        ("MPC", lambda: fa.simulate(arm, T, q, control=fa.MPC(horizon=0.1, stages=5, blocks=3))),
        ("invert", lambda: fa.invert(arm, {"x": 1.0, "y": fa.Motion([0, 1], [0.5, 0.6], [0, 0], [0, 0])})),
        ("plan_move", lambda: fa.plan_move(arm, [0, 0, 0], [1, 0, 0], limits={"torque": 100.0})),
        ("economize", lambda: fa.economize(scene, tolerance=1e-2)),
        ("chart", lambda: fa.chart(scene, budget=1)),
        ("to_urdf", lambda: arm.to_urdf()),
        ("lqr", lambda: fa.lqr(arm, q)),
        ("ComputedTorque", lambda: fa.simulate(arm, T, q, control=computed)),
        ("FeedForward", lambda: fa.simulate(arm, T, q, control=fa.FeedForward([0.1] * 3))),
        ("joint_reaction", lambda: fa.simulate(arm, T, q, control=sampled)),
    ]  # fmt: skip
    for what, way in ways:
        with refuses("loops", "foot") as told:
            way()
        assert what.lower() in str(told.value).lower()


def test_a_picture_has_the_closing_joint(tmp_path: Path) -> None:
    arm = four_bar()
    view = arm.show(closed(arm), open=False)
    view.save(tmp_path / "arm.png")
    assert (tmp_path / "arm.png").stat().st_size > 5000
    bare = fa.Arm(arm.links, G)
    (track,), (other,) = view.tracks, bare.show(closed(arm), open=False).tracks
    assert len(track.body.axes) == len(other.body.axes) + 1 and track.body.labels[-1]["text"] == "foot"
