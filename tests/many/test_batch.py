"""Batches: rollout and simulate_batch against simulate, one by one."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from arms import STEEL, G, close, floating_arm, paper_link, pendulum
from messages import refuses, warns


def two_links(tip: float = 0.05) -> fa.Arm:
    beam = fa.Beam(0.4, fa.Rectangle(0.002, 0.02), STEEL, {"bending_y": 2}, damping_ratio=0.01)
    links = [fa.Link(fa.Revolute("z"), fa.RigidBody(end=(0.05, 0, 0)), beam, fa.RigidBody(tip)) for _ in range(2)]
    return fa.Arm(links, gravity=(0, -G, 0))


def held(tau: np.ndarray, dt: float) -> fa.Sampled:
    """A sampled controller that applies the rows of tau, each over one step."""
    n, nv = tau.shape
    return fa.Sampled(lambda t, y: tau[min(round(t / dt), n - 1)], 1 / dt, actuate=list(np.eye(nv)))


def joint_torques(rng: np.random.Generator, arm: fa.Arm, *shape: int, size: float = 0.1) -> np.ndarray:
    tau = np.zeros((*shape, arm.nv))
    for k in range(len(arm.links)):
        tau[..., arm.joint_rates(k)] = size * rng.normal(size=(*shape, len(arm.joint_rates(k))))
    return tau


# -- rollout ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("integrator, dt", [("implicit", 1e-3), ("rk4", 2e-4)])
@pytest.mark.parametrize("arm", [two_links(), floating_arm()], ids=["planar", "floating"])
def test_rollout_is_simulate(arm, integrator, dt):
    rng = np.random.default_rng(1)
    tau = joint_torques(rng, arm, 2, 20)
    v0 = np.zeros((2, arm.nv))
    v0[1, 0] = 0.3
    run = fa.rollout(arm, arm.zero, v0, tau, step=dt, integrator=integrator)
    assert run.q.shape == (2, 21, arm.nq) and not run.status.any() and run.stats["steps"] == 40
    for i in range(2):
        t = dt * np.arange(21)
        one = fa.simulate(arm, t, v0=v0[i], control=held(tau[i], dt), integrator=integrator, step=dt)
        close(run.q[i], one.q, 1e-12)
        close(run.v[i], one.v, 1e-12)


def test_held_forces_keep_the_second_order():
    # a jump of the force at each step must not be smeared over two of them: impulse of a unit mass
    arm = fa.Arm([fa.Link(fa.Prismatic("x"), fa.RigidBody(1.0))])
    run = fa.rollout(arm, [0.0], tau=np.array([[1.0], [0.0], [0.0]]), step=0.1)
    np.testing.assert_allclose(run.v[0, :, 0], [0, 0.1, 0.1, 0.1], atol=1e-14)
    np.testing.assert_allclose(run.q[0, :, 0], [0, 0.005, 0.015, 0.025], atol=1e-14)


def test_rollout_does_not_depend_on_workers_neighbours_or_rows():
    arm, rng = two_links(), np.random.default_rng(2)
    q0 = 0.005 * rng.normal(size=(9, arm.nq))
    tau = joint_torques(rng, arm, 9, 30)
    one = fa.rollout(arm, q0, tau=tau, step=1e-3, workers=1)
    two = fa.rollout(arm, q0, tau=tau, step=1e-3, workers=2)
    assert two.stats["workers"] == 2
    np.testing.assert_array_equal(one.q, two.q)
    others = [4, 7, 1, 1, 1]
    apart = fa.rollout(arm, q0[others], tau=tau[others], step=1e-3)
    np.testing.assert_array_equal(apart.v[0], one.v[4])
    np.testing.assert_array_equal(apart.v[1], one.v[7])
    few = fa.rollout(arm, q0[4], tau=tau[4], step=1e-3)  # so few run one by one
    assert few.stats["lanes"] == 1
    close(few.v[0], one.v[4], 1e-12)
    singly = fa.rollout(arm, q0, tau=tau, step=1e-3, lanes=False)
    np.testing.assert_array_equal(singly.v[4], few.v[0])
    thin = fa.rollout(arm, q0, tau=tau, step=1e-3, every=7)
    np.testing.assert_array_equal(thin.t, one.t[::7])
    np.testing.assert_array_equal(thin.q, one.q[:, ::7])


def test_rollout_broadcasts_without_copies():
    arm = two_links()
    tau = np.zeros((1, arm.nv))
    tau[0, 0] = 0.2
    q0 = np.zeros((3, arm.nq))
    run = fa.rollout(arm, q0, tau=tau, step=1e-3, nstep=10)
    full = fa.rollout([arm] * 3, q0, np.zeros(arm.nv), np.broadcast_to(tau, (3, 10, arm.nv)), step=1e-3)
    np.testing.assert_array_equal(run.q, full.q)
    assert np.ptp(run.q, axis=0).max() == 0 and abs(run.q[0, -1, 0]) > 1e-4


def test_rollout_with_an_arm_for_each_scenario():
    arms = [two_links(m) for m in (0.0, 0.1)]
    run = fa.rollout(arms, arms[0].zero, step=1e-3, nstep=20)
    for i, arm in enumerate(arms):
        alone = fa.rollout(arm, arm.zero, step=1e-3, nstep=20).q[0]  # not in lanes: it differs by rounding
        np.testing.assert_allclose(run.q[i], alone, rtol=1e-9, atol=1e-15)
    assert np.abs(run.q[0] - run.q[1]).max() > 1e-6
    with refuses("arm[1]", "same coordinates"):
        fa.rollout([arms[0], paper_link()], arms[0].zero, step=1e-3, nstep=2)


@pytest.mark.parametrize("integrator, dt", [("implicit", 1e-3), ("rk4", 1e-4)])
def test_rollout_with_feedback_and_motion(integrator, dt):
    arm, n = two_links(), 40
    t = dt * np.arange(n + 1)
    motion = fa.Motion(lambda t: (0.5 * t**2, t, 1.0))
    law = fa.StrainFeedback(0.5, 0.05, 0.01, 1, reference=lambda t: 10 * t, limit=0.2)
    one = fa.simulate(arm, t, drive={0: motion}, control=law, integrator=integrator, step=dt)
    for given in (motion, fa.Motion(t, 0.5 * t**2, t, np.ones_like(t))):
        run = fa.rollout(arm, arm.zero, step=dt, nstep=n, control=law, drive={0: given}, integrator=integrator)
        for q in run.q:
            close(q, one.q, 1e-12)
    gains = [[fa.PD(kp, 0.05, 1)] for kp in (0.1, 2.0)]
    run = fa.rollout(arm, arm.zero, step=dt, nstep=n, control=gains, integrator=integrator)
    for q, law in zip(run.q, gains, strict=True):
        close(q, fa.simulate(arm, t, control=law, integrator=integrator, step=dt).q, 1e-12)


@pytest.mark.filterwarnings("ignore::flexarm.errors.RangeWarning")
def test_failures_spoil_no_other():
    arm = paper_link(order=1)
    v0 = np.zeros((5, arm.nv))
    v0[1, 0], v0[3, 2] = 0.1, 1e200
    run = fa.rollout(arm, arm.zero, v0, step=1e-4, nstep=40, integrator="rk4")
    assert run.status.tolist() == [0, 0, 0, 3, 0]
    assert [(f.index, f.time) for f in run.failures] == [(3, run.reached[3])] and "ran away" in run.failures[0].reason
    assert np.isnan(run.q[3, run.t > run.reached[3] + 1e-9]).all() and np.isfinite(np.delete(run.q, 3, axis=0)).all()
    good = fa.rollout(arm, arm.zero, v0[1], step=1e-4, nstep=40, integrator="rk4")
    np.testing.assert_array_equal(run.q[1], good.q[0])
    batch = fa.simulate_batch(arm, run.t, v0=v0, integrator="rk4", step=1e-4)
    np.testing.assert_allclose(batch.q, run.q, rtol=1e-13, atol=1e-16)
    assert batch.failures == run.failures and len(batch[3].t) < len(batch[1].t) == len(run.t)
    slow = fa.simulate_batch(arm, run.t, v0=v0, integrator="ida")
    assert [f.index for f in slow.failures] == [3] and slow.status[3] == 5 and not slow.status[:3].any()


def test_out_arrays_are_filled_and_checked():
    arm = two_links()
    out = {"q": np.empty((2, 6, arm.nq)), "v": np.empty((2, 6, arm.nv))}
    run = fa.rollout(arm, np.zeros((2, arm.nq)), step=1e-3, nstep=5, out=out)
    assert run.q is out["q"] and np.isfinite(out["v"]).all() and np.abs(out["v"]).max() > 0
    for bad, text in (
        ({"q": np.empty((2, 5, arm.nq))}, ("float64", "shape")),
        ({"q": np.empty((2, 6, arm.nq), np.float32)}, "float32"),
        ({"q": np.empty((2, 6, 2 * arm.nq))[..., ::2]}, "contiguous"),
        ({"p": out["q"]}, ("out", "'p'")),
    ):
        with refuses(text):
            fa.rollout(arm, np.zeros((2, arm.nq)), step=1e-3, nstep=5, out=bad)
    one = fa.simulate_batch(arm, [0, 1e-3, 2e-3], out={"q": (q := np.empty((1, 3, arm.nq)))})
    assert one.q is q


def test_rollout_says_what_is_wrong():
    arm = two_links()
    q0, good = arm.zero, {"step": 1e-3, "nstep": 3}
    for args, options, text in (
        ((q0[1:],), good, ("q0 has shape (5,)", "6")),
        ((np.zeros((2, 6)), np.zeros((3, 6))), good, ("q0", "2", "3")),
        ((q0, None, np.zeros((2, 6))), good, ("tau has shape", "nstep = 3")),
        ((q0, None, np.full((3, 6), np.nan)), good, "tau[0, 0] = nan"),
        ((q0,), {"step": 1e-3}, "nstep = None"),
        ((q0,), {"step": 0.0, "nstep": 1}, "step = 0.0"),
        ((q0,), {**good, "every": 4}, ("every = 4", "1", "3")),
        ((q0,), {**good, "integrator": "ida"}, "integrator = 'ida'"),
        ((q0,), {**good, "integrator": "rk4", "spectral_radius": 0.9}, ("integrator=", '"implicit"')),
        ((q0,), {**good, "spectral_radius": 1.5}, ("spectral_radius = 1.5", "0 to 1")),
        ((q0,), {**good, "workers": 0}, "workers = 0"),
        ((q0,), {**good, "drive": {0: np.zeros((3, 3))}}, ("drive[0]", "Motion")),
        ((q0,), {**good, "integrator": fa.Implicit(1e-3)}, "step = 0.001"),
        ((q0,), {**good, "control": [fa.PD(1, 1), [fa.PD(1, 1)]]}, ("list", "scenario")),
        ((q0,), {**good, "drive": {0: fa.Motion([0, 1], [0, 0])}, "control": fa.PD(1, 1, 0)}, ("motion", "prescribed")),
    ):
        with refuses(text):
            fa.rollout(arm, *args, **options)


# -- simulate_batch --------------------------------------------------------------------------------------------------


def patched() -> fa.Arm:
    piezo = fa.Piezo(62e9, 0.31, 7800, d31=-320e-12)
    patch = fa.Patch(start=0.0, end=0.1, width=0.02, thickness=5e-4, material=piezo, face="y")
    beam = fa.Beam(0.4, fa.Rectangle(0.002, 0.02), STEEL, {"bending_y": 2}, damping_ratio=0.01, patches=[patch])
    return fa.Arm([fa.Link(fa.Revolute("z", damping=0.1), None, beam, fa.RigidBody(0.01))])


PARAMETERS = {
    "link.0.tip.mass": [0.0, 0.05],
    "link.0.beam.length": [0.3, 0.4],
    "link.1.beam.material.youngs_modulus": [209e9, 70e9],
    "link.0.joint.damping": [0.0, 0.1],
    "link.1.tip.com.1": [0.0, 0.01],
    "gravity": [[0, -G, 0], [0, 0, -G]],
    "control.0.kp": [0.5, 2.0],
    "control.0.motor.gear_ratio": [1.0, 1.5],
    "control.0.motor.resistance": [2.0, 1.0],
    "drive.0.scale": [1.0, -2.0],
    "q0.1": [0.002, -0.001],
}


def varied(i: int) -> tuple[fa.Arm, np.ndarray, dict, list]:
    """What scenario i of PARAMETERS is, made by hand."""
    p = {k: v[i] for k, v in PARAMETERS.items()}
    beams = [
        fa.Beam(length, fa.Rectangle(0.002, 0.02), fa.Material(7850, E, 0.3), {"bending_y": 2}, damping_ratio=0.01)
        for length, E in ((p["link.0.beam.length"], 209e9), (0.4, p["link.1.beam.material.youngs_modulus"]))
    ]
    hub = fa.RigidBody(end=(0.05, 0, 0))
    links = [
        fa.Link(fa.Revolute("z", damping=p["link.0.joint.damping"]), hub, beams[0], fa.RigidBody(p["link.0.tip.mass"])),
        fa.Link(fa.Revolute("z"), hub, beams[1], fa.RigidBody(0.05, com=(0, p["link.1.tip.com.1"], 0))),
    ]
    arm = fa.Arm(links, p["gravity"])
    q0 = np.zeros(arm.nq)
    q0[1] = p["q0.1"]
    s = p["drive.0.scale"]
    motor = fa.Motor(0.5, p["control.0.motor.gear_ratio"], resistance=p["control.0.motor.resistance"])
    return arm, q0, {0: fa.Torque([0, 0.02, 0.05], [0, 0.1 * s, 0])}, [fa.PD(p["control.0.kp"], 0.01, 1, motor=motor)]


@pytest.mark.parametrize("integrator", ["implicit", "rk4", "gauss", "ida"])
def test_parameters_are_what_they_say(integrator):
    t = np.linspace(0, 0.05, 26)
    common = {"integrator": integrator, "step": {"rk4": 1e-4, "ida": None}.get(integrator, 1e-3)}
    drive = {0: fa.Torque([0, 0.02, 0.05], [0, 0.1, 0])}
    every = fa.simulate_batch(
        two_links(), t, parameters=PARAMETERS, drive=drive, control=fa.PD(1, 0.01, 1, motor=fa.Motor(0.5)),
        outputs=("tau", "q", "a", "v"), **common,
    )  # fmt: skip
    step_by_step = integrator in ("implicit", "rk4")
    assert (every.stats["lanes"] > 0) == step_by_step
    for i in range(2):
        arm, q0, law, control = varied(i)
        assert every.arm(i) == arm
        one = fa.simulate(arm, t, q0, drive=law, control=control, **common)
        for name in ("q", "v", "a", "tau"):
            x, y = getattr(every, name)[i], getattr(one, name)  # the same, but for rounding in the lanes
            np.testing.assert_allclose(x, y, rtol=0, atol=1e-11 * np.abs(y).max() if step_by_step else 0)
            np.testing.assert_array_equal(getattr(every[i], name), x)


def test_loads_voltages_and_friction():
    t = np.linspace(0, 0.02, 21)
    force = np.array([[0, 1.0, 0], [0, -2.0, 0]])
    others = [
        fa.Load(0, 0.2, moment=lambda t: (0, 0, np.sin(50 * t)), axes="section"),
        fa.Load(1, along=(0.1, 0.3), t=[0, 0.01, 0.02], force=[[0, 0, 0], [3, 5, 0], [0, 0, 0]]),
    ]
    given = {"load.0.force": force, "link.0.beam.length": [0.3, 0.4], "load.2.scale": [1.0, -1.0]}
    for name, step in (("implicit", 1e-3), ("rk4", 1e-4)):
        run = fa.simulate_batch(
            two_links(), t, loads=[fa.Load(force=(0, 0, 0)), *others], parameters=given, integrator=name, step=step
        )
        assert run.stats["lanes"] > 0
        for i, scale in enumerate((1.0, -1.0)):
            loads = [fa.Load(force=force[i]), others[0], others[1].scaled(scale)]
            one = fa.simulate(run.arm(i), t, loads=loads, integrator=name, step=step)
            np.testing.assert_allclose(run.q[i], one.q, rtol=0, atol=1e-14)
    arm = patched()
    key = ("patch", 0, 0)
    given = {"drive.patch.0.0.value": [10.0, 50.0], "link.0.beam.patches.0.thickness": [5e-4, 4e-4]}
    run = fa.simulate_batch(arm, t, drive={key: fa.Voltage(1.0)}, parameters=given)
    assert run.stats["lanes"] > 0
    for i, volts in enumerate((10.0, 50.0)):
        one = fa.simulate(run.arm(i), t, drive={key: fa.Voltage(volts)}, integrator="implicit", step=1e-3)
        assert np.abs(one.q).max() > 1e-7
        close(run.q[i], one.q, 1e-12)
    rubbing = pendulum(coulomb=0.0)
    for name, side_by_side in (("implicit", True), ("rk4", False)):
        run = fa.simulate_batch(rubbing, t, parameters={"link.0.joint.coulomb": [0.0, 100.0]}, integrator=name)
        assert (run.stats["lanes"] > 0) == side_by_side and np.ptp(run.q[1]) == 0 < np.ptp(run.q[0])


def test_held_forces_by_every_integrator():
    arm, t = two_links(), np.linspace(0, 0.02, 21)
    tau = joint_torques(np.random.default_rng(3), arm, 2, 21)
    runs = [
        fa.simulate_batch(arm, t, tau=tau, integrator=name, step=step)
        for name, step in (("implicit", 1e-4), ("rk4", 1e-4), ("gauss", 1e-3), ("ida", None))
    ]
    for run in runs[1:]:
        close(run.q, runs[0].q, 5e-5)
    close(runs[1].q, runs[2].q, 3e-8)
    uneven = np.array([0, 1e-3, 4e-3])  # in the core, steps may be of several lengths
    run = fa.simulate_batch(arm, uneven, tau=tau[:, :3], integrator="rk4", step=1e-4)
    again = fa.rollout(arm, arm.zero, tau=np.repeat(tau[:, :2], (10, 30), axis=1), step=1e-4, integrator="rk4")
    close(run.q[:, 1:], again.q[:, [10, 40]], 1e-12)
    with refuses("equal", "steps"):
        fa.simulate_batch(arm, uneven, tau=tau[:, :3], integrator="gauss", step=1e-4)


def test_steps_end_at_samples_of_drives_and_controllers():
    t, arm = np.linspace(0, 0.01, 11), two_links()
    for at in (0.005, 0.00512):
        drive = {0: fa.Torque([0, at, 0.01], [0, 1, 0])}
        one = fa.simulate(arm, t, drive=drive, integrator="implicit", step=1e-3)
        delays = {"drive.0.delay": [0.0, 0.0, 4e-4]}
        run = fa.simulate_batch(arm, t, drive={0: fa.Torque([-1, 0, at, 0.01], [0, 0, 1, 0])}, parameters=delays)
        assert run.stats["lanes"] > 0
        close(run.q[1], one.q, 1e-12)
        late = {0: fa.Torque([0, 4e-4, at + 4e-4, 0.0104], [0, 0, 1, 0])}
        close(run.q[2], fa.simulate(arm, t, drive=late, integrator="implicit", step=1e-3).q, 1e-12)
        close(fa.rollout(arm, arm.zero, step=1e-3, nstep=10, drive=drive).q[0], one.q, 1e-12)
    law = fa.Sampled(lambda t, y: -0.1 * y[0], 300.0, [("joint", 1)])
    sampled = {0: fa.Motion(t, t**3, 3 * t**2, 6 * t)}
    run = fa.rollout(arm, arm.zero, step=1e-3, nstep=10, control=law, drive=sampled)
    moved = {0: fa.Motion(lambda t: (t**3, 3 * t**2, 6 * t))}
    close(run.q[0], fa.simulate(arm, t, drive=moved, control=law, integrator="implicit", step=1e-3).q, 1e-12)


def controllers() -> dict[str, Any]:
    """Controllers that remember, sample, delay and filter; each by what makes it."""
    seen = [fa.sensors.Encoder(1, pulses=None, filter=fa.sensors.LowPass(40.0)), fa.sensors.Tachometer(1)]
    gains = {"D": [[0.2, 0.02]], "measure": [("joint", 1), ("rate", 1)], "reference": [0.3, 0.0], "rate": 300.0}

    class Counts:  # a law that remembers
        def __init__(self) -> None:
            self.sum = 0.0

        def __call__(self, t: float, y: np.ndarray) -> float:
            self.sum += 0.3 - y[0]
            return self.sum

    return {
        "pid": lambda: fa.LinearController.pid(1.0, 20.0, 0.05, 1, reference=0.3, rate=300.0),
        "continuous": lambda: fa.LinearController.pid(1.0, 20.0, 0.05, 1, reference=0.3, filter_time=2e-3),
        "washout": lambda: fa.StrainFeedback(1.0, 0.05, 0.01, 1, reference=0.3, washout=20.0),
        "delay": lambda: fa.LinearController([], **gains, delay=0.004),
        "filter": lambda: fa.LinearController([], **{**gains, "measure": seen}),
        "python": lambda: fa.Sampled(Counts(), 250.0, [("joint", 1)]),
        "computed torque": lambda: fa.ComputedTorque(20.0, reference=[0.0, 0.3], rate=250.0),
    }


@pytest.mark.parametrize("name", controllers())
def test_sampled_controllers_run_in_lanes(name):
    make, n = controllers()[name], 30
    hub = fa.RigidBody(0.5, inertia=0.02 * np.eye(3), end=(0.05, 0, 0))
    arm = fa.Arm([replace(link, hub=hub) for link in two_links(0.05).links])
    starts = np.tile(arm.zero, (10, 1))
    starts[:, 3] = np.linspace(-0.1, 0.2, 10)
    t = 1e-3 * np.arange(n + 1)
    several = [[make()] for _ in starts]
    run = fa.rollout(arm, starts, step=1e-3, nstep=n, control=several if name == "python" else make())
    assert run.stats["lanes"] > 1
    for k in (0, 7, 9):
        one = fa.simulate(arm, t, starts[k], control=make(), integrator="implicit", step=1e-3)
        close(run.q[k], one.q, 1e-10)
    if name == "python":
        return
    batch = fa.simulate_batch(arm, t, starts, control=make(), outputs=["q", "tau"], step=1e-3)
    assert batch.stats["lanes"] > 1
    close(batch.q, run.q, 1e-10)
    close(batch.tau[9], one.tau, 1e-7)
    exact = fa.simulate(arm, t, starts[9], control=make(), integrator="ida", rtol=1e-10, atol=1e-13)
    fine = fa.rollout(arm, starts, step=2.5e-5, nstep=40 * n, every=40, control=make())
    close(fine.q[9], exact.q, 2e-4)


def test_loads_voltages_and_events_of_a_rollout():
    arm, t, n = patched(), np.linspace(0, 0.04, 801), 800
    drive = {0: fa.Torque(lambda t: 0.1 * np.sin(30 * t)), ("patch", 0, 0): fa.Voltage([0, 0.02, 0.04], [0, 90, -50])}
    loads = [fa.Load(force=(0, 0.5, 0)), fa.Load(0, 0.2, force=lambda t: (0, np.cos(40 * t), 0), axes="section")]

    def crosses(t: float, q: np.ndarray, v: np.ndarray) -> float:
        return float(q[0] - 0.03)

    crosses.terminal = True  # type: ignore[attr-defined]
    v0 = np.zeros((12, arm.nv))
    v0[:, 0] = np.linspace(-0.3, 0.3, 12)
    run = fa.rollout(arm, arm.zero, v0, step=5e-5, nstep=n, drive=drive, loads=loads, events=crosses)
    batch = fa.simulate_batch(arm, t, v0=v0, drive=drive, loads=loads, events=crosses)
    assert run.stats["lanes"] > 1 and batch.stats["lanes"] > 0 and set(run.status) == {0, 5}
    assert set(batch.status) == {0, 1} and not run.failures and not batch.failures
    for k in (0, 5, 11):
        exact = fa.simulate(arm, t, v0=v0[k], drive=drive, loads=loads, events=crosses, rtol=1e-10, atol=1e-13)
        assert exact.status == batch[k].status and len(exact.q) == len(batch[k].q)
        times = exact.t_events[0]
        np.testing.assert_allclose(run.events[k][0][0], times, atol=1e-6)
        np.testing.assert_allclose(batch[k].t_events[0], times, atol=1e-6)
        assert abs(run.reached[k] - (times[0] if len(times) else t[-1])) < 1e-6
        close(run.q[k, : len(exact.q)], exact.q, 1e-4)
        assert np.isnan(run.q[k, len(exact.q) :]).all()


def test_a_controllers_error_names_its_scenario():
    arm = two_links()

    def law(t: float, y: np.ndarray) -> float:
        return np.nan if y[0] > 0.25 else 0.0

    q0 = np.tile(arm.zero, (20, 1))
    q0[13, 0] = 0.3
    with refuses("scenario 13", "control[0]", "t = 0"):
        fa.simulate_batch(arm, [0, 1e-3], q0, control=fa.Sampled(law, 1e3, [("joint", 0)]), batch=9)

    def breaks(t: float, y: np.ndarray) -> float:
        raise RuntimeError("enough")

    with refuses("enough", error=RuntimeError):
        fa.rollout(arm, q0, step=1e-3, nstep=2, control=fa.Sampled(breaks, 1e3, [("joint", 0)]))


def test_integrators_as_objects():
    arm, q0 = two_links(), two_links().zero
    tau = joint_torques(np.random.default_rng(1), arm, 2, 5)
    for chosen, named in (
        (fa.Implicit(1e-3, spectral_radius=0.9), {"step": 1e-3, "spectral_radius": 0.9}),
        (fa.RK4(1e-4), {"integrator": "rk4", "step": 1e-4}),
    ):
        run = fa.rollout(arm, q0, tau=tau, integrator=chosen)
        np.testing.assert_array_equal(run.q, fa.rollout(arm, q0, tau=tau, **named).q)
        by_q = np.ones(run.q.shape)
        g, same = (fa.rollout_gradient(arm, run.q, run.v, tau, by_q, **x) for x in ({"integrator": chosen}, named))
        np.testing.assert_array_equal(g.tau, same.tau)
        step = [fa.step_derivatives(arm, q0, q0, tau[0, 0], **x).A for x in ({"integrator": chosen}, named)]
        np.testing.assert_array_equal(*step)
        t = np.linspace(0, 0.01, 11)
        np.testing.assert_array_equal(*(fa.simulate_batch(arm, t, tau=tau[:, :1], **x).q
                                        for x in ({"integrator": chosen}, named)))  # fmt: skip
    with refuses("integrator = 'gauss'"):
        fa.rollout(arm, q0, tau=tau, integrator=fa.Gauss(1e-3))


def test_batch_does_not_depend_on_workers_or_chunks():
    t = np.linspace(0, 0.02, 11)
    masses = {"link.1.tip.mass": np.linspace(0, 0.2, 7)}
    for common in ({"step": 1e-3}, {"integrator": "ida"}):
        runs = [
            fa.simulate_batch(two_links(), t, parameters=masses, workers=w, batch=b, **common)
            for w, b in ((1, None), (2, None), (2, 3))
        ]
        for run in runs[1:]:
            np.testing.assert_array_equal(runs[0].q, run.q)
    thin = fa.simulate_batch(two_links(), t, parameters=masses, step=1e-3, every=5, outputs=["v"])
    assert thin.q is None and np.isnan(thin[2].q).all()
    np.testing.assert_array_equal(thin.v, fa.simulate_batch(two_links(), t, parameters=masses, step=1e-3).v[:, ::5])


def test_equal_parts_are_built_once():
    t, mass = [0, 1e-3], np.linspace(0, 1, 6)
    run = fa.simulate_batch(two_links(), t, parameters={"link.0.tip.mass": mass, "link.1.beam.length": [0.3, 0.4] * 3})
    beams = [run.arm(i).links[1].beam for i in range(6)]
    assert beams[0] is beams[2] is beams[4] and beams[1] is beams[3] and beams[0].length != beams[1].length
    assert run.arm(3).links[0].beam is run.arm(0).links[0].beam


def test_batch_says_what_is_wrong():
    arm, t = two_links(), [0, 1e-3]
    for options, text in (
        ({"parameters": {"link.0.tip.mas": [1.0]}}, "'link.0.tip.mass'"),
        ({"parameters": {"link.2.tip.mass": [1.0]}}, ("nothing", "vary")),
        ({"parameters": {"link.0.beam.order": [1, 2]}}, ("nothing", "vary")),
        ({"parameters": {"link.0.tip.mass": 1.0}}, "scenario"),
        ({"parameters": {"link.0.tip.mass": [0.1, -1.0]}}, ("scenario 1", "link.0.tip.mass = -1")),
        ({"parameters": {"link.0.tip.com": [[1.0, 2.0]]}}, "(B, 3)"),
        ({"parameters": {"link.0.tip.mass": [1.0, 2.0], "gravity": np.zeros((3, 3))}}, "2 scenarios"),
        ({"parameters": {"gravity": np.zeros((2, 3)), "gravity.1": [1.0, 2.0]}}, "'gravity'"),
        ({"q0": np.zeros((2, 6)), "parameters": {"link.0.tip.mass": [1.0, 2.0, 3.0]}}, ("q0", "2")),
        ({"outputs": ["q", "x"]}, "outputs = 'x'"),
        ({"integrator": "rk4", "stages": 2}, ("integrator=", '"gauss"')),
        ({"step": -1.0}, "step = -1.0"), ({"step": 1e-30}, "step = 1e-30"),
        ({"drive": {0: fa.Motion(lambda t: (t, 1.0, 0.0))}, "q0": np.ones(6)}, ("q0", "motion")),
        ({"q0": np.zeros((0, 6))}, "q0 has shape"),
        ({"out": "batch.h5", "batch": 0}, "batch = 0"),
    ):  # fmt: skip
        with refuses(text):
            fa.simulate_batch(arm, t, **options)


def test_memory_is_known_beforehand(monkeypatch):
    arm = two_links()
    run = fa.simulate_batch(arm, np.linspace(0, 0.01, 11), parameters={"link.0.tip.mass": [0.1, 0.2]})
    assert fa.batch_memory(arm, 2, 11) == run.q.nbytes + run.v.nbytes
    monkeypatch.setattr(sys.modules["flexarm.many.batch.arguments"], "_physical_memory", lambda: 1000.0)
    with refuses("2 scenarios", "11 rows", "GB", "out='file.h5'"):
        fa.simulate_batch(arm, np.linspace(0, 0.01, 11), parameters={"link.0.tip.mass": [0.1, 0.2]})


@pytest.mark.parametrize("options", [{"nstep": 10**9}, {"nstep": 10**9, "every": 10**9}, {"B": 10**6, "nstep": 10**6}])
def test_a_rollout_that_does_not_fit_into_memory_is_refused(options, monkeypatch):
    arm, options = paper_link(), dict(options)
    monkeypatch.setattr(sys.modules["flexarm.many.batch.arguments"], "_physical_memory", lambda: 24e9)
    q0 = np.zeros((options.pop("B", 1), arm.nq))
    with refuses("nstep =", "GB", "every"):
        fa.rollout(arm, q0, step=1e-3, **options)



def test_range_warning_names_the_scenario():
    arm = paper_link()
    q0 = np.zeros((3, arm.nq))
    q0[1, 1] = 0.6
    with warns(fa.errors.RangeWarning, "scenario 1", "link 0"):
        run = fa.simulate_batch(arm, [0, 1e-4, 2e-4], q0)
    assert run.stats["out_of_range"] == 1


# -- interrupted, and taken up again ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("integrator", "step"), [("implicit", 5e-5), ("ida", None)])
def test_ctrl_c_keeps_what_is_done(integrator, step):
    arm, before = two_links(), threading.active_count()
    asked = []

    def stop(share: float) -> None:
        asked.append(share)
        if share > 0.2:
            os.kill(os.getpid(), signal.SIGINT)

    t, sweep = np.linspace(0, 1.0, 1001), {"link.0.tip.mass": np.linspace(0.1, 1, 200)}
    how = {"integrator": integrator, "step": step}
    with pytest.raises(fa.errors.BatchInterrupted) as caught:
        fa.simulate_batch(arm, t, parameters=sweep, progress=stop, workers=2, **how)
    run = caught.value.result
    done = np.flatnonzero(run.status == 0)
    assert 0 < len(done) < 200 and asked and threading.active_count() == before
    assert np.isfinite(run.q[done]).all() and np.isnan(run.q[run.status == 4, -1]).all()
    i = int(done[-1])
    again = fa.simulate_batch(arm, t, parameters={k: np.repeat(x[i], 5) for k, x in sweep.items()}, **how)
    np.testing.assert_array_equal(run.q[i], again.q[0])


def test_ctrl_c_in_a_rollout():
    def stop(share: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(fa.errors.BatchInterrupted) as caught:
        fa.rollout(two_links(), np.zeros((500, 6)), step=1e-4, nstep=5000, progress=stop, every=1000)
    run = caught.value.result
    assert (run.status == 4).any() and np.isnan(run.q[-1, -1]).all() and run.reached[-1] < 0.5

    def give_up(share: float) -> None:
        raise RuntimeError("enough")

    with refuses("enough", error=RuntimeError):
        fa.rollout(two_links(), np.zeros((500, 6)), step=1e-4, nstep=5000, progress=give_up, every=1000)


SWEEP = {"parameters": {"link.0.tip.mass": np.linspace(0.1, 1, 40)}, "batch": 4}
TIMES = np.linspace(0, 0.1, 51)


def test_a_file_holds_what_memory_would(tmp_path):
    path = tmp_path / "sweep.h5"
    plain = fa.simulate_batch(two_links(), TIMES, **SWEEP)
    run = fa.simulate_batch(two_links(), TIMES, out=path, **SWEEP)
    np.testing.assert_array_equal(run.q, plain.q)
    again = fa.simulate_batch(two_links(), TIMES, out=path, **SWEEP)
    assert again.stats["resumed"] == 40 and "steps" not in again.stats
    np.testing.assert_array_equal(again.v, plain.v)
    plain.save(tmp_path / "sweep.npz")
    for file in (path, tmp_path / "sweep.npz"):
        kept = fa.BatchResult.load(file)
        np.testing.assert_array_equal(kept.q, plain.q)
        np.testing.assert_array_equal(kept.parameters["link.0.tip.mass"], SWEEP["parameters"]["link.0.tip.mass"])
        assert kept.arm(7) == plain.arm(7) and kept.failures == [] and not kept.status.any()
    with refuses("another batch"):
        fa.simulate_batch(two_links(0.06), TIMES, out=path, **SWEEP)
    over = fa.simulate_batch(two_links(0.06), TIMES, out=path, resume=False, **SWEEP)
    assert over.stats["resumed"] == 0 and np.abs(over.q - plain.q).max() > 1e-6
    (tmp_path / "no.h5").write_text("something else")
    with refuses("file", "batch"):
        fa.simulate_batch(two_links(), TIMES, out=tmp_path / "no.h5", **SWEEP)
    with refuses("batch", "no.h5"):
        fa.BatchResult.load(tmp_path / "no.h5")


def test_a_file_knows_its_batch(tmp_path):
    def ramp(a):
        return fa.Torque(lambda t: a * t)

    arm, force = two_links(), (0, 1.0, 0)
    base = {"drive": {0: ramp(1.0)}, "control": fa.PD(1.0, 0.1, 1), "tau": np.zeros((1, 6)), "v0": np.zeros((2, 6))}
    others = [
        {"drive": {0: ramp(2.0)}}, {"drive": {1: ramp(1.0)}}, {"control": fa.PD(1.0, 0.2, 1)}, {"every": 2},
        {"tau": np.ones((1, 6))}, {"v0": np.ones((2, 6))}, {"loads": [fa.Load(force=force)]}, {"outputs": ["q"]},
        {"integrator": "gauss"}, {"step": 5e-4}, {"rtol": 1e-9}, {"parameters": {"q0.0": [0.0, 0.0]}},
    ]  # fmt: skip
    file = {"out": tmp_path / "x.h5", "name": "ramp"}
    fa.simulate_batch(arm, [0, 1e-3, 2e-3], **file, **base)
    again = fa.simulate_batch(two_links(), [0, 1e-3, 2e-3], **file, **{**base, "drive": {0: ramp(1.0)}})
    assert again.stats["resumed"] == 2
    for other in others:
        with refuses("another batch"):
            fa.simulate_batch(arm, [0, 1e-3, 2e-3], **file, **{**base, **other})


@pytest.mark.filterwarnings("ignore::flexarm.errors.RangeWarning")
def test_a_file_remembers_failures(tmp_path):
    arm, v0 = paper_link(), np.zeros((3, 4))
    v0[1, 2] = 1e200
    runs = [fa.simulate_batch(arm, [0, 1e-3, 2e-3], v0=v0, out=tmp_path / "x.h5", integrator="rk4") for _ in "ab"]
    for run in runs:
        run.save(tmp_path / "x.npz")
        for kept in (run, *(fa.BatchResult.load(tmp_path / name) for name in ("x.h5", "x.npz"))):
            assert kept.failures == runs[0].failures and kept.status.tolist() == [0, 5, 0]
        assert [f.index for f in run.failures] == [1] and "ran away" in run.failures[0].reason


KILLED = """
import sys
sys.path.insert(0, {tests!r})
import os, signal
from flexarm.data.store.scenarios import ScenarioFile
from many.test_batch import *
put, count = ScenarioFile._put, 0
def dying(self, name, indices, block):
    global count
    count += 1
    if count == {after}:
        put(self, name, indices, np.full_like(block, 7))  # half written, and wrong
        os.kill(os.getpid(), signal.SIGKILL)
    put(self, name, indices, block)
ScenarioFile._put = dying
fa.simulate_batch(two_links(), TIMES, out={path!r}, **SWEEP)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="kill -9")
def test_killed_in_mid_write_it_goes_on(tmp_path):
    path = tmp_path / "sweep.h5"
    script = KILLED.format(tests=str(Path(__file__).parents[1]), path=str(path), after=34)
    killed = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60)
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    left = fa.BatchResult.load(path)
    assert np.isnan(left.q[12:]).all() and np.isfinite(left.q[:12]).all() and (left.status[12:] == 4).all()
    run = fa.simulate_batch(two_links(), TIMES, out=path, **SWEEP)
    assert run.stats["resumed"] == 12  # 8 arrays: blank, of three chunks of four, then two of the fourth
    np.testing.assert_array_equal(run.q, fa.simulate_batch(two_links(), TIMES, **SWEEP).q)


def test_ctrl_c_and_the_file(tmp_path):
    def stop(share: float) -> None:
        if share > 0.3:
            raise KeyboardInterrupt

    path = tmp_path / "sweep.h5"
    sweep = {"parameters": {"link.0.tip.mass": np.linspace(0.1, 1, 60)}, "integrator": "rk4", "step": 2e-6, "batch": 4}
    with pytest.raises(fa.errors.BatchInterrupted) as caught:
        fa.simulate_batch(two_links(), TIMES, out=path, progress=stop, **sweep)
    done = int((caught.value.result.status == 0).sum())
    assert 0 < done < 60
    run = fa.simulate_batch(two_links(), TIMES, out=path, **sweep)
    assert run.stats["resumed"] == done and not run.status.any()
    alone = fa.simulate_batch(run.arm(59), TIMES, integrator="rk4", step=2e-6)
    np.testing.assert_allclose(run.q[-1], alone.q[0], rtol=0, atol=1e-11 * np.abs(alone.q).max())


# -- events ----------------------------------------------------------------------------------------------------------


def _arrives(t, q, v):
    return q[0] - 0.05


def _slows(t, q, v):
    return v[0] - 1.0


_arrives.terminal = True


def _same_events(one: fa.Result, other: fa.Result) -> None:
    assert one.status == other.status and len(one.t) == len(other.t)
    np.testing.assert_array_equal(one.q, other.q)
    for name in ("t_events", "q_events", "v_events"):
        for x, y in zip(getattr(one, name), getattr(other, name), strict=True):
            np.testing.assert_array_equal(x, y)


@pytest.mark.parametrize("integrator", ["implicit", "ida"])
def test_a_terminal_event_ends_a_scenario_as_it_ends_a_simulation(tmp_path, integrator):
    arm, t = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, (0.3, 0, 0)))]), np.linspace(0, 0.2, 21)
    v0, options = np.array([[0.1], [0.9], [0.7]]), {"events": [_slows, _arrives], "integrator": integrator}
    options |= {"step": 1e-2} if integrator == "implicit" else {}
    alone = [fa.simulate(arm, t, v0=v, **options) for v in v0]
    assert [r.status for r in alone] == [0, 1, 1]
    runs = fa.simulate_batch(arm, t, v0=v0, **options)
    runs.save(tmp_path / "a.npz")
    stored = fa.simulate_batch(arm, t, v0=v0, out=tmp_path / "a.h5", name="A", **options)
    again = fa.simulate_batch(arm, t, v0=v0, out=tmp_path / "a.h5", name="A", **options)
    assert again.stats["resumed"] == 3
    files = [fa.BatchResult.load(tmp_path / name) for name in ("a.npz", "a.h5")]
    for found in (runs, stored, again, *files):
        assert found.status.tolist() == [0, 1, 1] and found.failures == []
        ends = [t[-1], alone[1].t_events[1][0], alone[2].t_events[1][0]]
        np.testing.assert_array_equal(found.reached, ends)
        for k, one in enumerate(alone):
            _same_events(found[k], one)
            assert np.isnan(found.q[k, len(one.t) :]).all()


def test_events_of_a_file_that_are_too_many_fail_aloud(tmp_path):
    arm = pendulum()
    file = {"out": tmp_path / "a.h5", "name": "A"}
    runs = fa.simulate_batch(arm, [0, 5], v0=[np.full(arm.nv, 0.1)] * 2, events=lambda t, q, v: v[0], step=0.01, **file)
    assert runs.status.tolist() == [5, 5] and "more than 2 times" in runs.failures[1].reason


def test_a_number_that_is_none_is_named_with_its_scenario():
    arm, t = two_links(), [0, 0.01, 0.02]
    for field, shape, at in (
        ("q0", (3, arm.nq), (1, 2)), ("v0", (3, arm.nv), (2, 0)), ("tau", (3, 3, arm.nv), (1, 2, 0))
    ):  # fmt: skip
        bad = np.zeros(shape)
        bad[at] = np.nan
        message = f"{field}[{', '.join(map(str, at))}] = nan", f"scenario {at[0]}"
        with refuses(message):
            fa.simulate_batch(arm, t, **{field: bad})
        with refuses(message):
            fa.rollout(arm, **{"q0": arm.zero, field: bad}, step=0.01, nstep=3)
    with refuses("parameters['link.0.tip.mass'][1] = inf", "scenario 1"):
        fa.simulate_batch(arm, t, parameters={"link.0.tip.mass": [0.1, np.inf]})


def test_counts_of_a_batch_in_chunks():
    arm, t = two_links(), [0, 0.01, 0.02]
    whole = fa.simulate_batch(arm, t, v0=np.full((16, arm.nv), 0.1), workers=1)
    chunks = fa.simulate_batch(arm, t, v0=np.full((16, arm.nv), 0.1), workers=1, batch=8)
    for name in ("lanes", "workers", "steps"):
        assert whole.stats[name] == chunks.stats[name]


def test_arms_that_move_in_other_planes_have_loads_of_their_own() -> None:
    """A load along one world axis turns one of two hinges, about z or about -y, whoever shares the pack."""
    body = fa.RigidBody(1.0, com=(0.5, 0, 0), inertia=(0.1, 0.1, 0.1), end=(1, 0, 0))
    t, axes = np.linspace(0, 0.1, 11), [(0, 0, 1.0), (0, -1.0, 0)]
    arms = [fa.Arm([fa.Link(fa.Revolute(axis), body)]) for axis in axes]
    for wrench in ({"force": (0, 1.0, 0)}, {"force": (0, 0, 1.0)}, {"moment": (0, 0, 1.0)}):
        options = {"loads": [fa.Load(0, **wrench)], "step": 0.01}
        alone = [fa.simulate(arm, t, integrator="implicit", **options).q[-1] for arm in arms]
        assert np.abs(alone[0] - alone[1]) > 1e-3
        batch = fa.simulate_batch(arms[0], t, parameters={"link.0.joint.axis": axes * 8}, **options)
        np.testing.assert_allclose(batch.q[:, -1], alone * 8, atol=1e-12)
