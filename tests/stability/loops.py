"""Control loops that theory says fail: what `closed_loop` says of them, and runs. See docs/failures.md."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import flexarm as fa
import numpy as np
from scipy.linalg import solve_continuous_are
from scipy.optimize import brentq

MEASURED = [("joint", 0), ("rate", 0), ("strain", 0, 0.0, "K3")]
NONE = np.zeros((0, 0)), np.zeros((0, 3)), np.zeros((1, 0))
STEEL = fa.Material(7850, 209e9, 0.3)
PD = fa.load("ist_control").control[0]  # the paper's gains, the identified drive


def growth(arm: fa.Arm, control: Any, time: float, output: Callable[[fa.Result], np.ndarray], step: float) -> float:
    """Of a run from a small deflection (1/s): the logarithm of the root of the mean square of an output, fitted over
    the second half of the run."""
    t = np.linspace(0, time, 4001)
    start = np.where(np.arange(arm.nq) == 1, 1e-6, 0.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.errors.LoopWarning)
        y = output(fa.simulate(arm, t, start, control=control, integrator="gauss", step=step))[2000:]
    size = np.log(np.sqrt(np.mean(y[:2000].reshape(10, 200) ** 2, axis=1)))
    return float(np.polyfit(t[2000:4000].reshape(10, 200).mean(axis=1), size, 1)[0])


def critical(of: Callable[[float], float], low: float, high: float) -> float:
    """Where the growth of runs is zero."""
    return float(brentq(of, low, high, rtol=2e-4, xtol=1e-12))


# -- sampling, delay ---------------------------------------------------------------------------------------------------


def paper_arm() -> fa.Arm:
    """The paper's link with its identified drive, without dry friction."""
    link = fa.load("ist_control").arm.links[0]
    return fa.Arm([replace(link, joint=replace(link.joint, coulomb=0.0))])


def strain_feedback(rate: float, delay: float = 0.0) -> fa.Controller:
    """Eq. 97 at a rate (Hz)."""
    return fa.LinearController(
        *NONE, [[PD.kp, PD.kv, -0.015]], rate=rate, measure=MEASURED, motor=PD.motor, delay=delay
    )


def root_strain(r: fa.Result) -> np.ndarray:
    return r.strain(0, 0.0)[:, 2]


def rate_growth(rate: float, time: float = 12.0) -> float:
    return growth(paper_arm(), strain_feedback(rate), time, root_strain, 5e-3)


def delay_growth(delay: float, time: float = 12.0) -> float:
    return growth(paper_arm(), strain_feedback(500.0, delay), time, root_strain, 5e-3)


# -- PD on the tip -----------------------------------------------------------------------------------------------------


def slender(modes: int = 3) -> fa.Arm:
    """A hub and a beam of 1 % damping, in the plane."""
    beam = fa.Beam(0.5, fa.Rectangle(0.002, 0.02), STEEL, {"bending_y": modes}, damping_ratio=0.01)
    hub = fa.RigidBody(0.5, inertia=(1e-3, 1e-3, 2e-3), end=(0.075, 0, 0))
    return fa.Arm([fa.Link(fa.Revolute("z"), hub, beam)])


def pd_on(what: str, factor: float = 1.0, rate: float = 2000.0) -> fa.Controller:
    """Sampled PD with differences: on the joint's angle, or on the tip's place, by the arm's length an angle too."""
    kp, kd = factor * 2.0, factor * 0.08
    if what == "joint":
        measure, row = [fa.sensors.Encoder(0, pulses=None)], np.array([[1.0]])
    else:
        measure, row = [fa.sensors.Camera(0)], np.array([[0.0, 1.0 / 0.575, 0.0]])
    # x+ = y, u = -(kp + kd / T) y + kd / T x; B and D act on -y
    n, d = row.shape[1], kd * rate
    return fa.LinearController(
        np.zeros((1, 1)), row, np.array([[-d]]), (kp + d) * row, rate=rate, measure=measure,
        actuate=[0], reference=np.zeros(n),
    )  # fmt: skip


def tip_growth(factor: float, time: float = 4.0) -> float:
    return growth(slender(), pd_on("tip", factor), time, root_strain, 2e-3)


# -- spillover ---------------------------------------------------------------------------------------------------------


def observed(weight: float) -> fa.Controller:
    """LQG on one mode of the beam, from the joint's angle and the strain at 0.2 m; `weight` of the state's energy."""
    arm = slender(1)
    measure = [("joint", 0), ("strain", 0, 0.2, "K3")]
    model = arm.linearize(arm.zero, outputs=measure)
    A, B, C = model.A, model.B, model.C
    Q = weight * np.diag([100.0, 1.0, 1.0, 1e-3])
    K = B.T @ solve_continuous_are(A, B, Q, np.eye(1))
    noise = np.diag([1e-6, 1e-5])
    L = solve_continuous_are(A.T, C.T, weight * B @ B.T, noise) @ C.T @ np.linalg.inv(noise)
    return fa.LinearController((A - B @ K - L @ C, L, K, np.zeros((1, 2))), measure=measure)


def spillover_growth(weight: float, time: float = 3.0) -> float:
    return growth(slender(), observed(weight), time, root_strain, 1e-3)


# -- windup ------------------------------------------------------------------------------------------------------------

INERTIA, LIMIT = 0.35, 1.0
PID_GAINS = (30.0, 60.0, 5.0)  # per unit of inertia


def rigid() -> fa.Arm:
    return fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, (0.5, 0, 0), (0, 0, 0.1), (1, 0, 0)))])


def pid(limit: float | None) -> fa.Controller:
    kp, ki, kd = (INERTIA * k for k in PID_GAINS)
    return fa.LinearController.pid(kp, ki, kd, filter_time=1e-3, limit=limit)


def described(margins: Any) -> tuple[float, float]:
    """The limit cycle that the describing function of a limit tells: a loop that is lost below a factor g of its gain
    swings where the limit leaves that share of the amplitude. The joint's amplitude (rad), and its frequency (rad/s).

    N(X) = 2/pi (asin 1/X + sqrt(1 - 1/X^2)/X) = g; the force's first harmonic is g X LIMIT."""
    g, w = margins.gain[0], margins.gain_frequency[0]
    X = brentq(lambda x: 2 / np.pi * (np.arcsin(1 / x) + np.sqrt(1 - 1 / x**2) / x) - g, 1.0 + 1e-9, 1e6)
    return g * X * LIMIT / (INERTIA * w**2), w


def swing(start: float, time: float = 40.0, limit: float | None = LIMIT) -> fa.Result:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return fa.simulate(rigid(), np.linspace(0, time, 4001), [start], control=pid(limit), rtol=1e-8)


def falls(start: float) -> bool:
    """Whether a run from that angle comes to rest."""
    r = swing(start)
    return bool(np.abs(r.q[-400:]).max() < 0.1 * np.abs(r.q[:400]).max())


def edge(width: float = 1e-10) -> float:
    """The start (rad) between those that come to rest and those that do not."""
    low, high = 0.1, 1.0
    while high / low > 1.0 + width:
        middle = np.sqrt(low * high)
        low, high = (middle, high) if falls(middle) else (low, middle)
    return low


def between(start: float) -> tuple[float, float]:
    """The amplitude (rad) and frequency (rad/s) of the swing that a run from the edge keeps for a while: where its
    peaks change least."""
    r = swing(start, 20.0)
    q = r.q[:, 0]
    k = np.flatnonzero((q[1:-1] - q[:-2]) * (q[2:] - q[1:-1]) < 0) + 1
    peaks, times = np.abs(q[k]), r.t[k]
    still = int(np.abs(np.diff(np.log(peaks))).argmin())
    return float(peaks[still]), float(np.pi / (times[still + 1] - times[still]))


# -- a wrong payload ---------------------------------------------------------------------------------------------------


def lifting(payload: float) -> fa.Arm:
    beam = fa.Beam(0.5, fa.Rectangle(0.006, 0.02), STEEL, {"bending_y": 3}, damping_ratio=0.02)
    hub = fa.RigidBody(0.5, inertia=(1e-3, 1e-3, 2e-3), end=(0.075, 0, 0))
    return fa.Arm([fa.Link(fa.Revolute("z"), hub, beam, fa.RigidBody(payload))], (0, -9.81, 0))


def lift(believed: float, truth: float, kp: float, kd: float) -> fa.Result:
    """A rise from 0 to 0.8 rad in 1 s by the inverse dynamics of the arm with the payload believed, its beam stiff
    (quasi-static: bent as at rest), and PD on what is left."""
    t = np.linspace(0, 3, 601)
    move = fa.Motion([0, 1, 3], [0, 0.8, 0.8], [0, 0, 0], [0, 0, 0])
    arm, path = lifting(believed), np.array([move(x) for x in t])
    poses = [arm.trim({0: x}) for x in path[:, 0]]
    a = np.zeros((len(t), arm.nv))
    a[:, 0] = path[:, 2]
    tau = np.array([arm.inverse_dynamics(p.q, np.zeros(arm.nv), x)[0] for p, x in zip(poses, a, strict=True)])
    true = lifting(truth)
    law = [fa.PD(kp, kd, reference=(t, path[:, 0]))]
    return fa.simulate(true, t, true.trim({0: 0.0}).q, drive={0: fa.Torque(t, tau)}, control=law,
                       integrator="gauss", step=5e-3)  # fmt: skip


def lift_error(believed: float, truth: float, kp: float) -> float:
    """Where that comes to rest, less 0.8 rad: the balance of PD, the torque believed, and the true weight."""
    wanted, true = lifting(believed).trim({0: 0.8}).tau[0], lifting(truth)
    return float(brentq(lambda e: wanted - kp * e - true.trim({0: 0.8 + e}).tau[0], -1.5, 1.5))


def left_alone(truth: float, time: float = 2.0) -> tuple[float, float]:
    """The growth (1/s) of the right torque alone, from a little beside the pose at 0.8 rad: of the linear model, and
    of a run."""
    arm = lifting(truth)
    q, tau = arm.trim({0: 0.8})
    start = q + np.where(np.arange(arm.nq) == 0, 1e-6, 0.0)
    t = np.linspace(0, time, 201)
    off = fa.simulate(arm, t, start, tau=tau, integrator="gauss", step=2e-3).q[:, 0] - 0.8
    late = t > 0.6 * time
    return fa.closed_loop(arm, [], q).growth, float(np.polyfit(t[late], np.log(off[late]), 1)[0])
