"""The response of the flexible arm to a small change of its joints' motion: exact Jacobians along the run, and modes,
integrated from knot to knot by matrix exponentials."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..._check import Array
from ...run.result import Result
from .move_limits import Indices
from .moved_arm import MovedArm

_FOLLOWED = 24  # modes, at most


class Response(NamedTuple):
    """Derivatives by the variables (nx).

    Attributes:
        left: of `MovedArm.left`, for the modes that are steered, (2, n, nx).
        tau, q, v, a: of the joints' torques, positions, rates and accelerations at the knots, (N + 1, nj, nx).
    """

    left: Array
    tau: Array
    q: Array
    v: Array
    a: Array


def respond(plant: MovedArm, run: Result, slopes: tuple[Array, Array, Array], kept: int) -> Response:
    """The response of the arm to changes of its joints' motion.

    Args:
        run: rows at the knots, (N + 1).
        slopes: derivatives of q, v, a of the joints by the variables, (N + 1, nj, nx) each.
        kept: number of modes whose vibration is steered.
    """
    at = [plant.arm.coordinate_of(i) for i in range(plant.arm.nv)]
    found = [plant.arm.inverse_derivatives(*row) for row in zip(run.q, run.v, run.a, strict=True)]
    by_q, by_v, by_a = (np.array(x) for x in zip(*found, strict=True))
    jacobians = by_q[:, :, at], by_v, by_a
    joints, elastic = plant.driven.rates, plant.driven.elastic

    def forces(rows: Indices) -> Array:
        return np.asarray(sum(J[:, rows][:, :, joints] @ x for J, x in zip(jacobians, slopes, strict=True)))

    tau = forces(joints)
    if not kept:
        return Response(np.zeros((2, 0, tau.shape[2])), tau, *slopes)
    shapes, w = plant.modes.shapes[:, :_FOLLOWED], plant.modes.frequencies[:_FOLLOWED]

    def modal(X: Array) -> Array:
        return np.asarray(shapes.T @ X[:, elastic][:, :, elastic] @ shapes)

    K, D, M = (modal(J) for J in jacobians)
    push = np.asarray(-np.linalg.solve(M, shapes.T @ forces(elastic)), float)
    K_M, D_M = (np.asarray(np.linalg.solve(M, X), float) for X in (K, D))
    x = _march(K_M, D_M, push, w, np.diff(run.t))
    eta, rate = x[:, : len(w)] / w[:, None], x[:, len(w) :]
    acceleration = push - np.linalg.solve(M, K @ eta + D @ rate)
    for J, y in zip(jacobians, (eta, rate, acceleration), strict=True):
        tau += J[:, joints][:, :, elastic] @ shapes @ y
    left = (np.stack([eta[-1], rate[-1] / w[:, None]]) * plant.modes.tip[: len(w), None])[:, :kept]
    return Response(left, tau, *slopes)


def _march(K: Array, D: Array, push: Array, w: Array, steps: Array) -> Array:
    """[w eta; d(eta)/dt] (N + 1, 2 n, nx) of eta'' + D eta' + K eta = push, which is linear in between: exactly, with K
    and D as in the middle of each step."""
    from scipy.linalg import expm  # slow to import

    n, h = len(w), steps[:, None, None]
    A = np.zeros((len(steps), 2 * n, 2 * n))
    A[:, :n, n:] = np.diag(w)
    A[:, n:, :n] = -0.5 * (K[1:] + K[:-1]) / w
    A[:, n:, n:] = -0.5 * (D[1:] + D[:-1])
    eye = np.eye(2 * n)
    go = expm(A * h)
    even = np.linalg.solve(A, go - eye)  # response to a constant push
    late = np.linalg.solve(A, even / h - eye)  # response to one that grows from 0 to 1
    even, late = even[:, :, n:], late[:, :, n:]
    x = np.zeros((len(steps) + 1, 2 * n, push.shape[2]))
    for k in range(len(steps)):
        x[k + 1] = go[k] @ x[k] + (even[k] - late[k]) @ push[k] + late[k] @ push[k + 1]
    return x
