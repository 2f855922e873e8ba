"""A limit on the joint holds for the sum of all that drives it, wherever an arm moves in time."""

from __future__ import annotations

from dataclasses import replace

import flexarm as fa
import numpy as np
import pytest
from scipy.integrate import solve_ivp

INERTIA, MOST = 0.35, 2.0
EVERY = {"ida": {"rtol": 1e-10, "atol": 1e-12}, "implicit": {"step": 1e-4}, "gauss": {"step": 1e-3},
         "rk4": {"step": 1e-4}}  # fmt: skip
t = np.linspace(0.0, 1.0, 101)


def rigid(limit: float | None = MOST, **joint) -> fa.Arm:
    """A link of inertia 0.35 kg m² about its joint."""
    body = fa.RigidBody(1.0, (0.5, 0, 0), (0, 0, 0.1), (1, 0, 0))
    return fa.Arm([fa.Link(fa.Revolute("z", torque_limit=limit, **joint), body)])


def flexible(limit: float | None = MOST, **joint) -> fa.Arm:
    beam = fa.Beam(0.5, fa.Rectangle(0.002, 0.02), fa.Material(7850, 209e9, 0.3), {"bending_y": 2}, "legendre")
    return fa.Arm([
        fa.Link(fa.Revolute("z", torque_limit=limit, **joint), fa.RigidBody(0.3, (0.05, 0, 0), (0, 0, 1e-3)), beam),
        fa.Link(fa.Revolute("z", torque_limit=None if limit is None else 0.3 * limit), beam=beam),
    ])  # fmt: skip


def push(s: float) -> float:
    return 1.5 * np.sin(9.0 * s)


def asked(s: float, q: float, v: float) -> float:
    """PD limited to 1.8, a drive, and a constant torque."""
    return float(np.clip(20.0 * (0.6 - q) - 1.0 * v, -1.8, 1.8)) + push(s) + 0.4


TORQUE = fa.Torque(np.linspace(0, 1, 2001), np.vectorize(push)(np.linspace(0, 1, 2001)))
PD = fa.PD(20.0, 1.0, 0, reference=0.6, limit=1.8)


def truth() -> np.ndarray:
    def slope(s: float, y: np.ndarray) -> list[float]:
        return [y[1], float(np.clip(asked(s, *y), -MOST, MOST)) / INERTIA]

    return np.asarray(solve_ivp(slope, (0, 1), [0.0, 0.0], t_eval=t, rtol=1e-11, atol=1e-12, max_step=1e-3).y)


@pytest.mark.parametrize("integrator", EVERY)
def test_the_sum_of_drive_control_and_constant_torque_is_limited(integrator: str) -> None:
    run = fa.simulate(rigid(), t, drive={0: TORQUE}, tau=[0.4], control=PD, integrator=integrator, **EVERY[integrator])
    q, v = truth()
    assert run.q[:, 0] == pytest.approx(q, abs=3e-6) and run.v[:, 0] == pytest.approx(v, abs=2e-5)
    wanted = np.array([np.clip(asked(*x), -MOST, MOST) for x in zip(t, q, v, strict=True)])
    assert run.tau[:, 0] == pytest.approx(wanted, abs=1e-4)
    assert np.abs(run.tau).max() == MOST  # to the last digit
    free = fa.simulate(rigid(None), t, drive={0: TORQUE}, tau=[0.4], control=PD, integrator="implicit", step=1e-3)
    assert np.abs(free.tau).max() > 1.5 * MOST


@pytest.mark.parametrize("integrator", EVERY)
def test_held_and_fed_forward_torques_count_as_well(integrator: str) -> None:
    """A sampled PD with a limit of its own and a feed-forward: 160 came out at a motor of 120."""
    turn = fa.Motion([0, 0.5, 1.0], [0, 0.3, 0.6], [0, 0.6, 0], a=[0, 0, 0])
    law = fa.LinearController([], None, None, [[20.0, 1.0]], rate=500, measure=[("joint", 0), ("rate", 0)], limit=1.8,
                              reference=[0.6, 0.0])  # fmt: skip
    other = fa.FeedForward(turn.scaled(8.0))
    run = fa.simulate(rigid(), t, control=[law, other], integrator=integrator, **EVERY[integrator])
    assert np.abs(run.tau).max() == MOST
    assert run.a[:, 0] == pytest.approx(run.tau[:, 0] / INERTIA, rel=1e-6)
    assert INERTIA * run.v[-1, 0] == pytest.approx(fa.simulate(
        rigid(), np.linspace(0, 1, 20001), control=[law, other], integrator="implicit", step=5e-5
    ).tau[:, 0].mean(), rel=3e-3)  # fmt: skip


@pytest.mark.parametrize("rubs", [{}, {"coulomb": 0.4, "stiction": 0.6}])
def test_all_integrators_agree_on_a_flexible_arm(rubs: dict[str, float]) -> None:
    """With dry friction as well, which is not the motor's and not within its limit."""
    arm = flexible(1.0, **rubs)
    control = [fa.PD(20.0, 1.0, 0, reference=0.6, limit=0.9), fa.PD(5.0, 0.3, 1, reference=-0.4)]
    runs = {}
    for integrator, options in EVERY.items():
        if integrator == "rk4" and rubs:
            continue
        runs[integrator] = fa.simulate(arm, t, tau=np.eye(6)[0] * 0.5, control=control, integrator=integrator,
                                       **{**options, **({"step": 2e-5} if integrator == "rk4" else {})})  # fmt: skip
    for name, run in runs.items():
        assert np.abs(run.tau[:, [0, 3]]).max(axis=0) == pytest.approx([1.0, 0.3], abs=1e-12), name
        assert run.q[-1] == pytest.approx(runs["ida"].q[-1], abs=2e-4 if rubs else 2e-5), name
    work = runs["ida"]
    assert fa.simulate(arm, t, tau=np.eye(6)[0] * 0.5, control=control, method="ci").q[-1] == pytest.approx(
        work.q[-1], abs=1e-4
    )


@pytest.mark.parametrize("integrator", ["implicit", "rk4"])
@pytest.mark.parametrize("count", [1, 9])
def test_batches_and_rollouts_are_limited_as_runs_are(integrator: str, count: int) -> None:
    arm, step = flexible(1.0), 1e-3 if integrator == "implicit" else 2e-5
    control = [fa.PD(20.0, 1.0, 0, reference=0.6, limit=0.9), fa.PD(5.0, 0.3, 1, reference=-0.4)]
    tau = np.eye(6)[0] * np.linspace(0.2, 0.6, count)[:, None]
    limits = np.linspace(0.8, 1.2, count)
    times = np.linspace(0, 0.2, 11)
    batch = fa.simulate_batch(arm, times, tau=tau, control=control, integrator=integrator, step=step, outputs="qvat",
                              parameters={"link.0.joint.torque_limit": limits})  # fmt: skip
    for k in {0, count - 1}:
        joint = replace(arm.links[0].joint, torque_limit=float(limits[k]))
        own = fa.Arm([replace(arm.links[0], joint=joint), arm.links[1]])
        one = fa.simulate(own, times, tau=tau[k], control=control, integrator=integrator, step=step)
        assert batch.q[k] == pytest.approx(one.q, abs=1e-11) and batch.tau[k] == pytest.approx(one.tau, abs=1e-9)
        assert np.abs(batch.tau[k, :, 0]).max() == limits[k]
    held = np.broadcast_to(3.0 * tau[:, None], (count, 200 if integrator == "implicit" else 100, 6))
    fast = fa.rollout(arm, arm.zero, np.zeros((count, 6)), held, step=step, integrator=integrator)
    same = fa.rollout(flexible(None), arm.zero, np.zeros((count, 6)), np.clip(held, -1.0, 1.0), step=step,
                      integrator=integrator)  # fmt: skip
    assert fast.q == pytest.approx(same.q, abs=1e-13)
