"""Predictive control against Riccati's recursion and bounded least squares, and on arms at their limits."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from messages import refuses, warns
from pages import Ran
from scipy.optimize import lsq_linear

STEEL = fa.Material(7850, 209e9, 0.3)
H, N = 2e-3, 12
WEIGHT, RATE_WEIGHT, EFFORT, TERMINAL = 30.0, 0.2, 1e-3, 0.05


def linear_arm() -> fa.Arm:
    """A beam on a slide, of order 0: its equations are linear."""
    beam = fa.Beam(0.5, fa.Rectangle(0.002, 0.02), STEEL, {"bending_y": 2}, "legendre", 0, damping_ratio=0.02)
    return fa.Arm([fa.Link(fa.Prismatic("y", damping=0.3), fa.RigidBody(0.5), beam, fa.RigidBody(0.1))])


def two_links(modes: int = 2, payload: float = 0.0) -> fa.Arm:
    """In the horizontal plane."""

    def link(k: int, tip: fa.RigidBody) -> fa.Link:
        hub = fa.RigidBody(0.3, (0.02, 0, 0), (0.03, 0.01)[k] * np.eye(3), (0.05, 0, 0))
        beam = fa.Beam(0.4, fa.Rectangle(0.004, 0.02), STEEL, {"bending_y": modes}, "legendre", 2, damping_ratio=0.01)
        return fa.Link(fa.Revolute("z"), hub, beam, tip)

    elbow = fa.RigidBody(0.3, (0.02, 0, 0), 1e-4 * np.eye(3), (0.03, 0, 0))
    return fa.Arm([link(0, elbow), link(1, fa.RigidBody(0.05 + payload, inertia=1e-5 * np.eye(3)))])


def discrete(arm: fa.Arm) -> tuple[np.ndarray, np.ndarray]:
    """A, B of one step of Alexander's method of two stages, g = 1 - 1 / sqrt(2), by matrices of the linear arm."""
    n, g = arm.nv, 1 - np.sqrt(0.5)
    M = arm.mass_matrix(arm.zero)
    _, C, K = arm.inverse_derivatives(arm.zero, np.zeros(n), np.zeros(n))[::-1]
    F = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    G = np.vstack([np.zeros((n, 1)), np.linalg.inv(M)[:, :1]])
    I, once = np.eye(2 * n), np.linalg.inv(np.eye(2 * n) - g * H * F)

    def end(x: np.ndarray, u: np.ndarray) -> np.ndarray:
        first = once @ (F @ x + G @ u)
        second = once @ (F @ (x + (1 - g) * H * first) + G @ u)
        return x + H * ((1 - g) * first + g * second)

    return end(I, np.zeros((1, 2 * n))), end(np.zeros((2 * n, 1)), np.ones((1, 1)))


def controller(**options: Any) -> fa.MPC:
    return fa.MPC(
        linear_arm(), weight=WEIGHT, rate_weight=RATE_WEIGHT, effort=EFFORT, rate_effort=0.0, rate=1 / H,
        horizon=N * H, stages=N, terminal=TERMINAL, **{"blocks": N, **options},
    )  # fmt: skip


def costs(n: int) -> list[np.ndarray]:
    """Of the states behind each step."""
    Q = np.zeros((2 * n, 2 * n))
    Q[0, 0], Q[n, n] = WEIGHT, RATE_WEIGHT
    return [Q * (H + (TERMINAL if k == N - 1 else 0.0)) for k in range(N)]


def test_without_limits_a_linear_arm_has_the_lqr_of_riccati() -> None:
    arm = linear_arm()
    A, B = discrete(arm)
    S, K = np.zeros_like(A), np.zeros((1, 2 * arm.nv))
    for Q in reversed(costs(arm.nv)):
        P = Q + S
        K = np.linalg.solve(H * EFFORT + B.T @ P @ B, B.T @ P @ A)
        S = A.T @ P @ A - A.T @ P @ B @ K
    mpc, rng = controller(), np.random.default_rng(5)
    for k in range(6):  # of any states, one after the other: the plan before does not matter
        x = rng.normal(size=2 * arm.nv) * np.repeat([0.1, 1.0], arm.nv)
        u = mpc.step(k * H, x[: arm.nv], x[arm.nv :])
        assert u == pytest.approx(-K @ x, rel=1e-8, abs=1e-8 * np.abs(K @ x).max())
    assert mpc.failures == 0


@pytest.mark.parametrize("blocks", [N, 5])
def test_within_limits_it_is_the_bounded_least_squares(blocks: int) -> None:
    arm = linear_arm()
    A, B = discrete(arm)
    limit, r, n = 1.0, 0.05, arm.nv
    mpc = controller(limit=limit, reference=r, blocks=blocks)
    x0 = np.array([0.0, 0.02, 0.0, 0.1, 0.0, 0.0])
    mpc.step(0.0, x0[:n], x0[n:])
    begins, plan = mpc.plan
    block = [int(np.searchsorted(begins, k * H + 1e-9, "right")) - 1 for k in range(N)]
    rows, aims = [], []
    free, by = x0, np.zeros((2 * n, blocks))
    for k, Q in enumerate(costs(n)):
        by = A @ by
        by[:, block[k]] += B[:, 0]
        free = A @ free
        for i, aim in ((0, r), (n, 0.0)):
            rows.append(np.sqrt(Q[i, i]) * by[i])
            aims.append(np.sqrt(Q[i, i]) * (aim - free[i]))
        rows.append(np.sqrt(H * EFFORT) * np.eye(blocks)[block[k]])
        aims.append(0.0)
    found = lsq_linear(np.array(rows), np.array(aims), bounds=(-limit, limit), method="bvls", tol=1e-14)
    assert len(begins) == blocks + 1
    assert np.sum(np.abs(found.x) > limit - 1e-9) >= 2  # limits do matter
    assert plan[:, 0] == pytest.approx(found.x, abs=1e-6)


def swing(control: Any, arm: fa.Arm, seconds: float = 1.0) -> fa.Result:
    t = np.linspace(0, seconds, round(seconds * 1000) + 1)
    return fa.simulate(arm, t, control=control, integrator="implicit", step=1e-3)


def test_a_swing_keeps_to_its_limits_and_beats_clipped_lqr() -> None:
    arm, goal, limit = two_links(), np.array([0.8, 0.5]), np.array([4.0, 2.0])
    joints = [arm.joint_rate(0), arm.joint_rate(1)]
    mpc = fa.MPC(reference=goal, limit=limit, rate_limit=400.0, strain_limit=[(0, 0.0, "K3", 0.07)])
    run = swing(mpc, arm)
    u = run.tau[:, joints]
    assert mpc.failures == 0
    assert (np.abs(u) <= limit).all() and (np.abs(u).max(axis=0) > 0.9 * limit).any()
    assert np.abs(np.diff(u, axis=0)).max() <= 0.4 * (1 + 1e-9)
    assert np.abs(arm.strain(run.q, 0, 0.0)[:, 2]).max() < 0.07 * 1.2
    assert np.abs(run.q[-1, joints] - goal).max() < 0.05
    free = swing(fa.MPC(reference=goal, limit=limit, effort=1e-3 / limit**2), arm)
    assert np.abs(arm.strain(free.q, 0, 0.0)[:, 2]).max() > 0.1  # the limit did matter

    # LQR of the same costs, clipped
    weights = np.zeros((2 * arm.nv, 2 * arm.nv))
    for i in joints:
        weights[i, i], weights[arm.nv + i, arm.nv + i] = 1.0, 0.05**2
    model = arm.linearize(arm.zero, inputs=(0, 1))
    from scipy.linalg import solve_continuous_are

    R = np.diag(1e-3 / limit**2)
    K = np.linalg.solve(R, model.B.T @ solve_continuous_are(model.A, model.B, weights, R))
    q0 = np.zeros(arm.nv)
    q0[joints] = goal

    def lqr(t: float, y: np.ndarray) -> np.ndarray:
        return np.asarray(np.clip(-K @ (y - np.concatenate([q0, np.zeros(arm.nv)])), -limit, limit))

    clipped = swing(fa.Sampled(lqr, 1000.0, actuate=(0, 1)), arm)

    def cost(r: fa.Result) -> float:
        return float(np.sum((r.q[:, joints] - goal) ** 2) + 0.05**2 * np.sum(r.v[:, joints] ** 2))

    assert cost(free) < cost(clipped)


def test_one_iteration_a_sample_comes_to_the_iterated_optimum() -> None:
    arm = two_links(1)
    once, full = (fa.MPC(arm, reference=[0.6, -0.4], limit=[4.0, 2.0], iterations=k) for k in (1, 12))
    q, v, off = np.zeros(arm.nv), np.zeros(arm.nv), []
    for k in range(60):
        u = once.step(k * 1e-3, q, v)
        off.append(np.abs(u - full.step(k * 1e-3, q, v)).max())
        run = fa.simulate(arm, [0, 1e-3], q0=q, v0=v, drive={0: fa.Torque(u[0]), 1: fa.Torque(u[1])},
                          integrator="implicit", step=5e-4)  # fmt: skip
        q, v = run.q[-1], run.v[-1]
    assert off[0] > 1e-6 and max(off[30:]) < 0.02  # of 4 N m


@pytest.mark.parametrize(("modes", "delay"), [(1, False), (2, True)])
def test_a_coarser_model_and_a_delay_with_a_payload_unknown_still_arrive(modes: int, delay: bool) -> None:
    goal = np.array([0.5, 0.3])
    arm = two_links(payload=0.03)
    mpc = fa.MPC(two_links(modes), reference=goal, limit=[4.0, 2.0], delay=delay)
    run = swing(mpc, arm, 1.2)
    assert mpc.failures == 0
    assert np.abs(run.q[-1, [0, arm.joint_rate(1)]] - goal).max() < 0.002


def test_a_state_that_is_not_a_number_goes_on_along_the_plan() -> None:
    arm = two_links(1)
    mpc = fa.MPC(arm, reference=0.5, limit=[4.0, 2.0])
    q = np.zeros(arm.nv)
    before = mpc.step(0.0, q, q)
    planned = mpc.plan[1]
    with warns(fa.errors.MPCWarning, "t = 0.001", "finite"):
        after = mpc.step(1e-3, np.full(arm.nv, np.nan), q)
    assert mpc.failures == 1 and np.isfinite(after).all()
    again = pickle.loads(pickle.dumps(mpc))  # as workers of a batch have it: without the plan
    assert again.step(0.0, q, q) == pytest.approx(before, abs=1e-12)
    assert after == pytest.approx(planned[1], abs=0.2) and np.abs(after) == pytest.approx(np.abs(before), abs=2.0)
    assert np.isfinite(mpc.step(2e-3, q, q)).all() and mpc.failures == 1


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"horizon": -1.0}, "horizon = -1"),
        ({"horizon": 0.01}, "horizon = 0.01: is shorter than 25 stages"),
        ({"rate": 0.0}, "rate = 0"),
        ({"stages": 0}, "stages = 0"),
        ({"blocks": 30}, "blocks = 30: must be from 1 to"),
        ({"terminal": -1.0}, "terminal = -1"),
        ({"weight": [1.0, 2.0, 3.0]}, "weight has shape (3,): must be one number, or 2"),
        ({"weight": -1.0}, "weight = -1.0"),
        ({"weight": 0.0}, "weight: must be positive for at least one"),
        ({"limit": -1.0}, "limit = -1.0: must be positive"),
        ({"limit": [1.0, 2.0, 3.0]}, "limit has shape (3,)"),
        ({"rate_limit": 0.0}, "rate_limit = 0.0: must be positive"),
        ({"effort": [1.0]}, "effort has shape (1,)"),
        ({"effort": 0.0}, "effort: effort or rate_effort must be positive"),
        ({"reference": [1.0]}, "reference has shape (1,)"),
        ({"reference": ([0, 1], [[1, 2, 3], [1, 2, 3]])}, "reference: r has shape (2, 3)"),
        ({"reference": lambda t: [np.nan, 0.0]}, "reference at t"),
        ({"track": "elbow"}, "track = 'elbow'"),
        ({"track": [("tip", 0, "w")]}, "track[0]: axis"),
        ({"track": [("joint", 7)]}, "track[0]: link = 7"),
        ({"strain_limit": [(0, 0.0, "K3")]}, "strain_limit[0]"),
        ({"strain_limit": [(0, 0.0, "K3", -1.0)]}, "strain_limit[0]: most"),
        ({"joint_limit": (1.0, -1.0)}, "joint_limit = (1.0, -1.0): lower must be below"),
        ({"speed_limit": -1.0}, "speed_limit = -1.0"),
        ({"model": 3}, "model = 3"),
        ({"model": fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, (0.1, 0, 0)))])}, "model: link 1 has 0"),
        ({"iterations": 0}, "iterations = 0"),
        ({"delay": 0.5}, "delay = 0.5"),
    ],
)
def test_bad_input_is_named(given: dict[str, Any], told: str) -> None:
    with refuses(told):
        swing(fa.MPC(**given), two_links(1), 0.002)


def test_numbers_of_the_page(page_of_docs: Callable[[str], Ran]) -> None:
    names = page_of_docs("docs/mpc.md").names
    assert names["swing"].failures == names["mpc"].failures == 0
    assert np.abs(names["run"].q[-1, [0, 3]] - [0.8, 0.5]).max() < 0.01
    assert np.abs(names["met"].q[-1, [0, 3]] - [0.2, -0.3]).max() < 1e-4
    assert np.abs(names["seen"].q[-1, [0, 3]] - [0.8, 0.5]).max() < 0.01


def test_friction_and_slides_and_balls() -> None:
    rig = fa.load("quanser").arm  # whose joints rub
    assert all(np.any(link.joint.coulomb) for link in rig.links)
    mpc = fa.MPC(reference=[0.3, 0.3], limit=[20.0, 5.0])
    run = swing(mpc, rig, 0.4)
    assert mpc.failures == 0 and np.abs(run.q[-1, [0, 3]] - 0.3).max() < 0.03
    slide = fa.MPC(reference=0.1)
    assert abs(swing(slide, linear_arm(), 0.8).q[-1, 0] - 0.1) < 0.005 and slide.failures == 0
    ball = fa.Arm([fa.Link(fa.Spherical(), fa.RigidBody(1.0, (0.1, 0, 0), 0.01 * np.eye(3)))])
    with refuses("a ball"):
        swing(fa.MPC(), ball, 0.002)


def test_scenes_and_batches_have_it(tmp_path: Path) -> None:
    arm = two_links(1)
    samples = ([0.0, 0.1, 1.0], [[0.0, 0.0], [0.3, 0.2], [0.3, 0.2]])
    control = fa.MPC(reference=samples, limit=[4.0, 2.0], inputs=[0, (1, 0)], strain_limit=[(0, 0.0, "K3", 0.2)],
                     track=[("joint", 0), ("joint", 1)], stages=15, blocks=8, horizon=0.3)  # fmt: skip
    t = np.linspace(0, 0.02, 21)
    path = tmp_path / "scene.toml"
    fa.Scene(arm, t=t, control=control, options={"integrator": "implicit", "step": 1e-3}).save(path)
    there = fa.load(path)
    here = fa.simulate(arm, t, control=control, integrator="implicit", step=1e-3)
    again = fa.simulate(there.arm, t, control=there.control, integrator="implicit", step=1e-3)
    assert np.abs(here.tau).max() > 0.1
    assert np.abs(again.tau - here.tau).max() < 1e-9
    q0 = np.array([[0.0] * arm.nv, [0.1] + [0.0] * (arm.nv - 1)])
    many = fa.simulate_batch(arm, t, q0=q0, control=control, integrator="implicit", step=1e-3)
    assert np.abs(many.q[0] - here.q).max() < 1e-12
    assert np.abs(many.q[1] - here.q).max() > 0.05


def test_gravity_and_the_tip_in_space() -> None:
    """Three joints, rigid but for the last link: the tip is held where it is told to be, against gravity."""
    hub = fa.RigidBody(1.0, (0.05, 0, 0), 0.02 * np.eye(3), (0.3, 0, 0))
    beam = fa.Beam(0.4, fa.Tube(0.02, 0.002), STEEL, {"bending_y": 1, "bending_z": 1}, "legendre", damping_ratio=0.01)
    arm = fa.Arm(
        [fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, inertia=0.02 * np.eye(3))), fa.Link(fa.Revolute("y"), hub),
         fa.Link(fa.Revolute("y"), fa.RigidBody(0.2, inertia=1e-3 * np.eye(3)), beam, fa.RigidBody(0.3))],
        gravity=(0, 0, -9.81),
    )  # fmt: skip
    q0 = np.zeros(arm.nv)
    q0[[1, 2]] = -0.5, 0.9
    goal = arm.frame(q0)[0] + [-0.05, 0.1, 0.1]
    mpc = fa.MPC(track="tip", reference=goal, limit=40.0, weight=100.0)
    run = fa.simulate(arm, np.linspace(0, 1, 1001), q0=q0, control=mpc, integrator="implicit", step=1e-3)
    assert mpc.failures == 0 and np.abs(run.tau[:, [0, 1, 2]]).max() <= 40.0
    assert np.abs(arm.frame(run.q[-1])[0] - goal).max() < 2e-3
