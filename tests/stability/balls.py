"""Measures of how coordinates of orientation fail: Euler angles near their singularity, quaternions that drift.

Each function returns numbers; test_balls.py judges them, bench/failures/failures.py draws them.
"""

from __future__ import annotations

import flexarm as fa
import numpy as np
from scipy.spatial.transform import Rotation

EULER = ("rx", "ry", "rz")
SPEED = np.pi / 2  # rad/s, of the passage


def euler_condition(gap: float) -> float:
    """Condition number of the mass matrix of a ball-shaped body on three Euler joints, its second angle `gap` (rad)
    short of a quarter turn."""
    arm = fa.Arm([fa.Link(fa.Axes(axes=EULER), fa.RigidBody(1.0, inertia=(1, 1, 1)))])
    return float(np.linalg.cond(arm.mass_matrix([0.3, np.pi / 2 - gap, 0.2])))


def passage(kind: str, gap: float, rtol: float = 1e-8) -> dict:
    """A ball-shaped body turns by half a turn at constant angular velocity, past the Euler angles' singularity at a
    distance of `gap` rad, on three Euler joints ("euler") or a ball ("ball"): steps, largest error of its orientation
    (entries of R), or the error raised and the time reached."""
    body = fa.RigidBody(1.0, inertia=(1, 1, 1))
    start, w = Rotation.from_rotvec([-gap, 0, 0]), np.array([0.0, SPEED, 0.0])
    if kind == "euler":
        arm = fa.Arm([fa.Link(fa.Axes(axes=EULER), body)])
        q0 = start.as_euler("XYZ")
        v0 = np.linalg.solve(arm.jacobian(q0)[3:], w)
    else:
        arm = fa.Arm([fa.Link(fa.Spherical(), body)])
        q0, v0 = np.roll(start.as_quat(), 1), start.inv().apply(w)
    t = np.linspace(0, 2, 102)  # none of them at the singularity itself
    try:
        r = fa.simulate(arm, t, q0, v0, rtol=rtol, atol=1e-2 * rtol)
    except fa.SimulationError as e:
        return {"failed": str(e), "time": e.time, "steps": e.result.stats["steps"]}
    truth = (Rotation.from_rotvec(np.outer(t, w)) * start).as_matrix()
    return {"failed": "", "steps": r.stats["steps"], "error": float(np.abs(r.frame()[1] - truth).max())}


def tumbling() -> tuple[fa.Arm, np.ndarray]:
    """A body with inertia 1, 2, 3 kg m^2 on a ball joint, turning about its middle axis: it tumbles."""
    return fa.Arm([fa.Link(fa.Spherical(), fa.RigidBody(1.0, inertia=(1, 2, 3)))]), np.array([0.1, 2.0, 0.1])


def quaternion_length(pull: bool, duration: float = 200.0, step: float = 0.1, rows: int = 101) -> np.ndarray:
    """Length of the tumbling body's quaternion, less 1, when classical RK4 integrates q' = 1/2 q w as it stands, or
    with the program's own rates, which pull it back (rows,). The angular velocity is Euler's equations'."""
    arm, w = tumbling()
    I = np.array([1.0, 2.0, 3.0])

    def rate(y: np.ndarray) -> np.ndarray:
        q, w = y[:4], y[4:]
        if pull:
            dq = arm._core.rates(q, w)[0]
        else:
            dq = 0.5 * np.concatenate([[-q[1:] @ w], q[0] * w + np.cross(q[1:], w)])
        return np.concatenate([dq, -np.cross(w, I * w) / I])

    y, out = np.concatenate([[1.0, 0, 0, 0], w]), [0.0]
    every = round(duration / step) // (rows - 1)
    for k in range(1, every * (rows - 1) + 1):
        a = rate(y)
        b = rate(y + step / 2 * a)
        c = rate(y + step / 2 * b)
        y = y + step / 6 * (a + 2 * b + 2 * c + rate(y + step * c))
        if k % every == 0:
            out.append(float(np.linalg.norm(y[:4]) - 1))
    return np.array(out)


def long_run(duration: float = 1000.0, rtol: float = 1e-8) -> dict:
    """The same body in fa.simulate: departure of its quaternions from unit length, relative drift of the energy and of
    the angular momentum, steps."""
    arm, w = tumbling()
    r = fa.simulate(arm, np.linspace(0, duration, 501), v0=w, rtol=rtol, atol=1e-2 * rtol)
    momentum, energy = arm.momentum(r.q, r.v)[:, 3:], r.energy()[0]
    return {
        "length": float(np.abs(np.linalg.norm(r.q, axis=1) - 1).max()),
        "energy": float(np.abs(energy / energy[0] - 1).max()),
        "momentum": float(np.linalg.norm(momentum - momentum[0], axis=1).max() / np.linalg.norm(momentum[0])),
        "steps": r.stats["steps"],
    }
