"""Predictive control that knows what acts beside it: its prediction is the run, and it needs no error to answer."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from messages import refuses

STEEL = fa.Material(7850, 209e9, 0.3)
PZT = fa.Piezo(62e9, 0.3, 7800, d31=-1.8e-10, permittivity=1.5e-8)
H = 1e-3
T = np.arange(101) * H


def link(joint: Any, tip: float, **beam: Any) -> fa.Link:
    hub = fa.RigidBody(0.3, (0.02, 0, 0), 0.01 * np.eye(3), (0.05, 0, 0))
    modes = {"bending_y": 2}
    body = fa.Beam(0.4, fa.Rectangle(0.004, 0.02), STEEL, modes, "legendre", 2, damping_ratio=0.02, **beam)
    return fa.Link(joint, hub, body, fa.RigidBody(tip, inertia=1e-4 * np.eye(3)))


def two_links() -> fa.Arm:
    patch = fa.Patch(0.02, 0.1, 0.02, 5e-4, PZT, face="y")
    return fa.Arm([link(fa.Revolute("z", damping=0.02), 0.3, patches=[patch]), link(fa.Revolute("z"), 0.05)])


def ball_arm() -> fa.Arm:
    return fa.Arm([link(fa.Spherical(), 0.2), link(fa.Revolute("z"), 0.05)])


def pid(**more: Any) -> fa.LinearController:
    return fa.LinearController.pid(kp=3.0, ki=20.0, kd=0.1, link=1, reference=(T, 0.4 * T / T[-1]), **more)


def knowing(name: str) -> tuple[fa.Arm, dict[str, Any]]:
    """An arm, and what acts on it."""
    push = 0.4 * np.sin(40 * T)
    acts: dict[str, dict[str, Any]] = {
        "torque samples": {"drive": {0: fa.Torque(T, push)}},
        "torque, a callable": {"drive": {0: fa.Torque(lambda t: 0.4 * float(np.sin(40 * t)))}},
        "motion": {"drive": {1: fa.Motion(T, 3.0 * T**2, 6.0 * T, np.full(T.size, 6.0))}},
        "voltage": {"drive": {("patch", 0, 0): fa.Voltage(T, 2e3 * T)}},
        "dead load": {"loads": [fa.Load(force=np.outer(T, [0, 30, 0]), t=T)]},
        "follower load": {"loads": [fa.Load(0, force=(-2, 3, 0), axes="section")]},
        "PD": {"control": fa.PD(5.0, 0.2, 1, reference=(T, 0.4 * T / T[-1]))},
        "PD at its limit": {"control": fa.PD(5.0, 0.2, 1, reference=0.5, limit=0.3)},
        "continuous PID": {"control": pid(filter_time=2e-3)},
        "sampled PID": {"control": [pid(rate=250.0)]},
        "sampled PID, late": {"control": [pid(rate=400.0, delay=0.004)]},
        "ball": {"loads": [fa.Load(force=(0, 1, 2))], "control": fa.PD(3.0, 0.1, 1, reference=0.3)},
    }
    return ball_arm() if name == "ball" else two_links(), acts[name]


NAMES = ["torque samples", "torque, a callable", "motion", "voltage", "dead load", "follower load", "PD",
         "PD at its limit", "continuous PID", "sampled PID", "sampled PID, late", "ball"]  # fmt: skip


def predicted(name: str, known: bool = True) -> tuple[float, float]:
    """How far a prediction is from a run of IDA under the same plan, at most, as a part of the way: of the tip, and of
    strains."""
    arm, acts = knowing(name)
    v0 = np.zeros(arm.nv)
    v0[:3] = (1.0, 2.0, 3.0) if name == "ball" else (2.0, 0.0, 0.0)
    joint = 1 if name == "ball" else 0
    law = fa.MPC(
        arm, **(acts if known else {}), rate=1 / H, horizon=25 * H, inputs=[joint], limit=0.5, reference=0.1,
        track=[("strain", 0, 0.01, "K3")],
    )  # fmt: skip
    first = float(law.step(0.0, arm.zero, v0)[0])
    assert law.failures == 0
    begins, plan = law._core.block_times[:-1], law._core.plan[:, 0]  # from the second sample on
    assert np.ptp(plan) > 0.01

    def planned(t: float, y: np.ndarray) -> float:
        return first if t < 0.5 * H else float(plan[np.searchsorted(begins, t - 0.5 * H) - 1])

    inner = acts.pop("control", [])
    laws = [*(inner if isinstance(inner, list) else [inner]), fa.Sampled(planned, 1 / H, actuate=[joint])]
    t = H * np.arange(27)
    run = fa.simulate(arm, t, None, None if "drive" in acts else v0, control=laws, rtol=1e-8, **acts)
    if "drive" in acts:
        run = fa.simulate(arm, t, None, np.where(np.eye(arm.nv)[0] > 0, v0, run.v[0]), control=laws, rtol=1e-8, **acts)
    q = law._core.predicted[:, : arm.nq]
    off = []
    for found, true in ((arm.frame(q)[0], run.frame()[0][1:]), *((arm.strain(q, k, 0.05)[:, 2],
                        arm.strain(run.q[1:], k, 0.05)[:, 2]) for k in (0, 1))):  # fmt: skip
        off.append(float(np.abs(found - true).max() / np.abs(true - true[0]).max()))
    return off[0], max(off[1:])


@pytest.mark.parametrize("name", NAMES)
def test_a_prediction_is_the_run_under_its_plan(name: str) -> None:
    tip, strain = predicted(name)
    assert tip < 1e-4
    assert strain < 0.15 * predicted(name, known=False)[1]  # steps of a millisecond see the second modes roughly


def settled(**known: Any) -> float:
    """Of two links under a load and a law beside it: how far the joints are from where they are to be."""
    arm, acts = two_links(), {"loads": [fa.Load(force=(0, 3.0, 0))], "control": [fa.PD(5.0, 0.2, 0, reference=0.5)]}
    law = fa.MPC(**{k: acts[k] for k in known}, reference=[0.2, -0.3], rate=250.0, horizon=0.3)
    t = np.linspace(0, 1.0, 501)
    run = fa.simulate(arm, t, loads=acts["loads"], control=[*acts["control"], law], integrator="implicit", step=1e-3)
    assert law.failures == 0
    return float(np.abs(run.q[-50:, [0, 3]] - [0.2, -0.3]).max())


def test_what_is_known_leaves_no_error() -> None:
    assert settled(loads=True, control=True) < 1e-3
    assert settled(loads=True) > 0.01
    assert settled(control=True) > 0.01


def test_a_ball_is_led_by_its_tip() -> None:
    arm, goal = fa.Arm([link(fa.Spherical(), 0.2)]), 0.45 * np.array([np.cos(0.4), 0.0, np.sin(0.4)])
    law = fa.MPC(track="tip", reference=goal, rate=500.0, horizon=0.3)
    v0 = np.array([3.0, 0.5, -0.5, 0.0, 0.0])
    run = fa.simulate(arm, np.linspace(0, 1, 501), None, v0, control=law, integrator="implicit", step=1e-3)
    assert law.failures == 0 and np.abs(run.frame()[0][-50:] - goal).max() < 3e-3
    with refuses('track = "joints"', "link 0"):
        fa.MPC(arm).step(0.0, arm.zero, v0)
    with refuses("a ball"):
        fa.MPC(arm, track=[("joint", 0)]).step(0.0, arm.zero, v0)
    heavy = fa.Arm([link(fa.Spherical(), 0.25)])  # a model of its own, with a ball as well
    other = fa.MPC(heavy, track="tip", reference=goal, rate=500.0, horizon=0.3)
    run = fa.simulate(arm, np.linspace(0, 1, 501), None, v0, control=other, integrator="implicit", step=1e-3)
    assert np.abs(run.frame()[0][-50:] - goal).max() < 0.02


def test_what_cannot_be_predicted_is_named() -> None:
    arm, q = two_links(), np.zeros(6)
    for more, told in (
        ({"control": fa.Sampled(lambda t, y: 0.0, 500.0)}, ("control", "law 0", "sampled", "linear")),
        ({"control": fa.ComputedTorque(100.0, reference=[0, 0], rate=500.0)}, ("law 0", "sampled", "linear")),
        ({"control": fa.FeedForward({0: fa.Motion([0, 1], [0, 1])})}, "times of a run"),
        ({"drive": {0: fa.Motion([0, 1], [0, 1])}, "inputs": [0, 1]}, ("motion", "prescribed")),
        ({"drive": dict.fromkeys((0, 1), fa.Motion([0, 1], [0, 1]))}, "motion"),
        ({"drive": {0: fa.Torque([5, 6], [0, 1])}}, ("t = 5", "samples")),
        ({"loads": 3}, "loads = 3"),
    ):  # fmt: skip
        with refuses(told):
            fa.MPC(arm, **more).step(0.0, q, q)


def test_copies_know_the_same() -> None:
    arm, acts = knowing("sampled PID")
    law = fa.MPC(arm, **acts, loads=[fa.Load(force=(0, 1, 0))], reference=0.2, inputs=[0])
    u = law.step(0.0, arm.zero, np.zeros(6))
    for other in (copy.deepcopy(law), pickle.loads(pickle.dumps(law))):
        assert other.step(0.0, arm.zero, np.zeros(6)) == pytest.approx(u, abs=0.0)
    assert "control" in repr(law)
