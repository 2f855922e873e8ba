"""Loops drawn at random, against runs; Kalman filters of linear arms, against one of this file's own; low-pass filters
of sensors, against SciPy."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from hypothesis import assume
from scipy.signal import lsim

sys.path.insert(0, str(Path(__file__).parent))

from scenes import SEEDS, drawn, note

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")
STEEL = fa.Material(7850, 209e9, 0.3)


def links(rng: np.random.Generator, most: int = 2, order: Any = 2) -> list[fa.Link]:
    """Links that turn or slide in a plane or out of it, bent or rigid; well scaled."""
    out = []
    for _ in range(int(rng.integers(1, most + 1))):
        strip = fa.Rectangle(*rng.uniform(0.004, 0.012, 2))
        shapes = {"bending_y": int(rng.integers(1, 3)), "bending_z": int(rng.integers(0, 2))}
        beam = fa.Beam(rng.uniform(0.3, 0.8), strip, STEEL, shapes, order=order,
                       damping_ratio=float(rng.choice([0.0, 0.01])))  # fmt: skip
        damping = float(rng.choice([0.0, 0.05]))
        joint = [fa.Revolute("z", damping=damping), fa.Revolute("y", damping=damping), fa.Prismatic("y", damping=1.0)]
        hub = fa.RigidBody(0.4, (0, 0, 0), np.eye(3) * rng.uniform(0.005, 0.05), (0.03, 0, 0))
        tip = fa.RigidBody(rng.uniform(0.05, 0.4), (0.01, 0, 0), np.eye(3) * 1e-4, (0.02, 0, 0))
        out.append(fa.Link(joint[rng.choice(3, p=[0.5, 0.3, 0.2])], hub, beam if rng.random() < 0.7 else None, tip))
    return out


def laws(rng: np.random.Generator, arm: fa.Arm, rate: float) -> list[Any]:
    """A controller of each joint: PD, PID, continuous or sampled, with delays and filters; gains for 1 to 6 Hz."""
    out: list[Any] = []
    M = arm.mass_matrix(arm.zero)
    for k in range(len(arm.links)):
        J, w, zeta = M[arm.joint_rate(k)][arm.joint_rate(k)], 2 * np.pi * rng.uniform(1, 6), rng.uniform(0.02, 0.8)
        kp, kv = J * w * w, 2 * zeta * J * w
        kind = int(rng.integers(4))
        if kind == 0:
            out.append(fa.PD(kp, kv, k))
        elif kind == 1:
            out.append(fa.LinearController.pid(kp, kp * w * rng.uniform(0, 0.1), kv, k, filter_time=0.01))
        elif kind == 2:
            out.append(fa.LinearController.pid(kp, kp * w * rng.uniform(0, 0.1), kv, k, rate=rate, filter_time=0.01))
        else:
            gains, filters = np.array([kp, kv]), [None, 60.0, fa.sensors.LowPass(80.0, 2)]
            filter = filters[rng.integers(3)]
            read = [fa.sensors.Encoder(k, pulses=None, filter=filter), fa.sensors.Tachometer(k, filter=filter)]
            late = rng.choice([0.0, 0.3, 1.0, 1.4]) / rate
            out.append(fa.Sampled(lambda t, y, gains=gains: -gains @ y, rate, read, actuate=[k], delay=float(late)))
    return out


@drawn(6, SEEDS)
def test_a_run_is_made_of_the_loops_poles(seed: int) -> None:
    """Of a small disturbance, what is seen every period is a sum of powers of the poles, and of nothing else."""
    rng = np.random.default_rng(seed)
    arm = fa.Arm(links(rng), gravity=(0, 0, -9.81) if rng.random() < 0.5 else (0, 0, 0))
    rate = float(rng.choice([100.0, 200.0]))
    control = laws(rng, arm, rate)
    hold = {}
    balance = arm.equilibrium(arm.zero, lock=range(len(arm.links)))
    weight = arm.inverse_dynamics(balance, np.zeros(arm.nv), np.zeros(arm.nv))
    for k in range(len(arm.links)):
        hold[k] = fa.Torque(float(weight[arm.joint_rate(k)]))
    loop = fa.closed_loop(arm, control, arm.zero)
    h, size, n = 1.0 / rate, 1e-6, 160
    assume(loop.growth * n * h < 6.0)  # to 400 times its size at most: what is small stays small
    q = balance.copy()
    joints = [arm.joint_rate(k) for k in range(len(arm.links))]
    q[joints] += size * rng.normal(size=len(joints))
    v = np.zeros(arm.nv)
    v[joints] = size * rng.normal(size=len(joints))
    elastic = arm.nv - len(arm.links)
    fastest = arm.modes(balance, lock=range(len(arm.links))).frequencies.max() if elastic else 0.0
    parts = int(np.clip(np.ceil(10 * h * fastest), 16, 32))  # filters of sensors take parabolas between output times
    t = np.arange(parts * n + 1) * h / parts
    step = h / (parts * np.ceil(max(h * fastest / parts, 1)))
    try:
        run = fa.simulate(arm, t, q, v, drive=hold, control=control, integrator="gauss", step=step)
    except fa.SimulationError:
        assume(False)
    y = np.hstack([run.q - balance, run.v])[8 * parts :: parts]
    y = y[:, joints + [arm.nv + j for j in joints]] / size
    z = np.exp(loop.poles * h)
    z = z[np.abs(z) > 1e-3]  # others are over by the eighth row
    V = z[None, :] ** (np.arange(len(y)))[:, None] / np.maximum(np.abs(z) ** (len(y) - 1), 1.0)
    real = np.hstack([V.real, V.imag])
    left = y - real @ np.linalg.lstsq(real, y, rcond=1e-12)[0]
    assert np.abs(left).max(axis=0) == pytest.approx(0.0, abs=2e-5 * np.abs(y).max())
    note("stable" if loop.stable else "unstable")
    note(f"of {len(arm.links)} links")


#: five implicit stages, below the diagonal, which is 1/4; the last row has the weights, too (Hairer & Wanner 1996)
_LAST = (25 / 24, -49 / 48, 125 / 16, -85 / 12)
SDIRK4 = ((), (1 / 2,), (17 / 50, -1 / 25), (371 / 1360, -137 / 2720, 15 / 544), _LAST)


@drawn(6, SEEDS)
def test_a_kalman_filter_of_a_linear_arm_is_the_one_of_textbooks(seed: int) -> None:
    """Beams of order 0 on slides that do not turn: the filter of five stages; Joseph's form."""
    rng = np.random.default_rng(seed)
    shapes, damping = {"bending_y": int(rng.integers(1, 4))}, rng.uniform(0, 0.05)
    strip = fa.Rectangle(*rng.uniform(0.002, 0.01, 2))
    beam = fa.Beam(rng.uniform(0.3, 0.8), strip, STEEL, shapes, "legendre", 0, damping_ratio=damping)
    joint = fa.Prismatic("y", damping=rng.uniform(0, 1), stiffness=float(rng.choice([0.0, 30.0])))
    arm = fa.Arm([fa.Link(joint, fa.RigidBody(rng.uniform(0.1, 1)), beam, fa.RigidBody(rng.uniform(0.05, 0.3)))])
    n, h = arm.nv, 10.0 ** rng.uniform(-3.5, -2)
    far = rng.uniform(0, 0.9) * beam.length
    half = beam.section.y / 2
    known = [
        (fa.sensors.Encoder(0, pulses=None, noise=1e-4), np.eye(2 * n)[0], 1e-4),
        (fa.sensors.Tachometer(0, noise=1e-3), np.eye(2 * n)[n], 1e-3),
        (fa.sensors.StrainGauge(0, far, "-y", noise=1e-6),
         half * np.array([*(arm.strain(q, 0, far)[2] for q in np.eye(n)), *np.zeros(n)]), 1e-6),
    ]  # fmt: skip
    known = [known[k] for k in rng.permutation(3)[: rng.integers(1, 4)]]
    noise = np.array([0.1, *rng.uniform(0, 0.05, n - 1)])
    q_std, v_std = rng.uniform(0.001, 0.1, (2, n))
    unknown = bool(rng.random() < 0.5)
    offset: dict[str, Any] = {"estimate": {"offset.0": (0.2, 0.5)}, "drift": {"offset.0": 0.1}} if unknown else {}
    filter = fa.KalmanFilter(arm, [s for s, _, _ in known], h, force_noise=noise, q_std=q_std, v_std=v_std, **offset)
    M = arm.mass_matrix(arm.zero)
    _, C, K = arm.inverse_derivatives(arm.zero, np.zeros(n), np.zeros(n))[::-1]
    F = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    one = np.eye(2 * n)
    stage = np.linalg.inv(one - 0.25 * h * F)
    by_x, by_force = [], []  # the rate in each stage, by x and by a force
    for row in SDIRK4:
        done = [h * np.einsum("i,ijk", row, x) if row else 0 * one for x in (by_x, by_force)]
        by_x.append(stage @ F @ (one + done[0]))
        by_force.append(stage @ (one + F @ done[1]))
    weights = (*SDIRK4[-1], 0.25)
    A = one + h * sum(w * k for w, k in zip(weights, by_x, strict=True))
    B = h * sum(w * k for w, k in zip(weights, by_force, strict=True))
    B = B @ np.vstack([np.zeros((n, n)), np.linalg.inv(M)])
    A = np.block([[A, B[:, :1]], [np.zeros((1, 2 * n)), np.eye(1)]])
    B = np.vstack([B, np.zeros((1, n))])
    Q = B @ np.diag(noise**2 / h) @ B.T
    Q[-1, -1] += 0.1**2 * h * unknown
    H, R = np.array([[*row, 0.0] for _, row, _ in known]), np.diag([s**2 for _, _, s in known])
    x = np.array([*np.zeros(2 * n), 0.2 * unknown])
    P = np.diag(np.concatenate([q_std, v_std, [0.5 * unknown]]) ** 2)
    for _ in range(30):
        tau = np.zeros(n)
        tau[0] = rng.normal()
        y = H @ x + np.sqrt(np.diag(H @ P @ H.T + R)) * rng.normal(size=len(known))
        use = rng.random(len(known)) < 0.8
        if use.any():
            G = P @ H[use].T @ np.linalg.inv(H[use] @ P @ H[use].T + R[np.ix_(use, use)])
            I = np.eye(len(x)) - G @ H[use]
            x, P = x + G @ (y - H @ x)[use], I @ P @ I.T + G @ R[np.ix_(use, use)] @ G.T
        filter.update(np.where(use, y, np.nan))
        x, P = A @ x + B @ tau, A @ P @ A.T + Q
        filter.predict(tau)
    m = 2 * n + unknown
    scale = np.sqrt(np.diag(P)[:m])
    got = np.concatenate([filter.q, filter.v, list(filter.parameters.values())])
    np.testing.assert_allclose((got - x[:m]) / scale, 0.0, atol=1e-4)
    size = np.outer(scale, scale)
    np.testing.assert_allclose(filter.covariance / size, P[:m, :m] / size, atol=1e-5)


@drawn(12, SEEDS)
def test_a_sensors_filter_is_that_of_its_transfer_function(seed: int) -> None:
    """A joint swings in two sines; what is read is that behind the filter, by SciPy on a fine grid, late, scaled and
    shifted. And a recorded signal between whose samples are straight lines."""
    rng = np.random.default_rng(seed)
    order = int(rng.integers(1, 3))
    zeta = float(rng.choice([rng.uniform(0.2, 1.5), 1.0])) if order == 2 else None
    f = rng.uniform(2.0, 30.0)
    filter = fa.sensors.LowPass(f, order, zeta)
    w = 2 * np.pi * f
    transfer = ([w], [1.0, w]) if zeta is None else ([w * w], [1.0, 2 * zeta * w, w * w])
    s = 2j * np.pi * (at := rng.uniform(0.1, 100.0, 5))
    np.testing.assert_allclose(filter.response(at), np.polyval(transfer[0], s) / np.polyval(transfer[1], s), rtol=1e-12)
    t = np.cumsum(rng.uniform(1e-3, 2e-2, 60)) if rng.random() < 0.5 else np.arange(150) * 4e-3
    y = rng.normal(size=len(t))
    if np.ptp(np.diff(t)) < 1e-9:  # SciPy wants equal steps
        straight = lsim(transfer, y - y[0], t - t[0])[1] + y[0]
        np.testing.assert_allclose(filter.apply(t, y), straight, atol=1e-8)
    else:
        even = np.linspace(t[0], t[-1], 8001)
        straight = lsim(transfer, np.interp(even, t, y) - y[0], even - t[0])[1] + y[0]
        np.testing.assert_allclose(filter.apply(t, y), np.interp(t, even, straight), atol=2e-3)
    a, b = rng.uniform(0.1, 1.0, 2)
    p, r = rng.uniform(3.0, 20.0, 2)
    turn = fa.Motion(lambda x: (a * np.sin(p * x) + b * np.cos(r * x), a * p * np.cos(p * x) - b * r * np.sin(r * x),
                                -a * p * p * np.sin(p * x) - b * r * r * np.cos(r * x)))  # fmt: skip
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, inertia=(0.1, 0.1, 0.1)))])
    t = np.linspace(0, 1, 401)
    run = fa.simulate(arm, t, [b], [a * p], drive={0: turn}, integrator="implicit", step=2.5e-3)
    gain, offset, delay = rng.uniform(0.5, 2.0), rng.normal(), float(rng.choice([0.0, rng.uniform(0, 0.1)]))
    rate = None if rng.random() < 0.5 else float(rng.uniform(20, 500))
    made: dict[str, Any] = {"filter": filter, "gain": gain, "offset": offset, "delay": delay, "rate": rate}
    kind = bool(rng.random() < 0.5)
    reading = (fa.sensors.Encoder(0, pulses=None, **made) if kind else fa.sensors.Tachometer(0, **made)).read(run)
    fine = np.linspace(0, 1, 10001)
    there = a * np.sin(p * fine) + b * np.cos(r * fine) if kind else a * p * np.cos(p * fine) - b * r * np.sin(r * fine)
    behind = lsim(transfer, there - there[0], fine)[1] + there[0]
    wanted = gain * np.interp(np.clip(reading.t - delay, 0, 1), fine, behind) + offset
    np.testing.assert_allclose(reading.y[:, 0], wanted, atol=1e-5 * np.abs(wanted).max())
