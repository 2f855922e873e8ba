"""A flexible arm whose joints are moved: its simulation, and its response to a small change of the command: exact
Jacobians along the run, and modes, integrated from knot to knot by matrix exponentials."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ..._check import Array
from ...analysis.equilibrium import balanced
from ...analysis.modes import small_motions
from ...arm.arm import Arm
from ...model.acting.drive import Motion
from ...run.result import Result
from ...run.simulation import simulated
from ..joint_limits import Driven, Indices, freedoms

_LOOK = 96  # times in a period of the slowest mode at which the vibration is evaluated


@dataclass(frozen=True)
class LockedModes:
    """Modes about rest with all joints locked."""

    frequencies: Array  #: undamped (rad/s), ascending, (n,)
    shapes: Array  #: of the elastic coordinates, their modal masses 1, (ne, n)
    mass: Array  #: of these, (ne, ne)
    tip: Array  #: displacement of the arm's end, of a tree the largest, by each mode of amplitude 1, (n,)


class MovedArm:
    """An arm that goes from rest to rest.

    Args:
        start, end: of the joints, (nj,).
    """

    def __init__(self, arm: Arm, driven: Driven, start: Array, end: Array) -> None:
        self.arm, self.driven = arm, driven
        self.q_start, self.q_end = self._rest(start), self._rest(end)
        self.modes_start, self.modes = self.modes_at(self.q_start), self.modes_at(self.q_end)
        for where, modes in (("starts", self.modes_start), ("ends", self.modes)):
            if (modes.frequencies <= 0.0).any():
                raise ValueError(f"q_from, q_to: where the move {where} the arm buckles between locked joints")

    def _rest(self, joints: Array) -> Array:
        q = self.arm.zero
        q[self.driven.at] = joints
        return balanced(self.arm, q, None, self.arm.movable)

    def modes_at(self, q: Array) -> LockedModes:
        """The modes at a state of rest (nq,)."""
        elastic = self.driven.elastic
        if not elastic.size:
            return LockedModes(np.zeros(0), np.zeros((0, 0)), np.zeros((0, 0)), np.zeros(0))
        found = small_motions(self.arm, q, lock=self.arm.movable)
        modes = found.undamped()
        shapes = np.real(modes.shapes[elastic])
        shapes = shapes / np.sqrt(np.einsum("ik,ij,jk->k", shapes, found.M, shapes))
        J = np.array([self.arm.jacobian(q, k)[:3, elastic] for k in self.arm.ends])
        return LockedModes(modes.frequencies, shapes, found.M, np.linalg.norm(J @ shapes, axis=1).max(axis=0))

    @property
    def half_period(self) -> float:
        """Half a period of the slowest mode, at the start or at the end, the shorter one (s); 0 for a rigid arm."""
        if not self.driven.elastic.size:
            return 0.0
        return float(np.pi / max(self.modes_start.frequencies[0], self.modes.frequencies[0]))

    @cached_property
    def rest(self) -> Array:
        """Final places of the arm's ends, (n, 3)."""
        return self.arm.end_places(self.q_end)

    @property
    def small(self) -> float:
        """The largest way of a joint (rad, m), up to 1."""
        d = self.driven
        return float(min(1.0, np.abs((self.q_end - self.q_start)[d.at]).max()))

    @property
    def tolerances(self) -> dict[str, Any]:
        """Tolerances of "ida" that resolve the vibration after small moves."""
        return {"rtol": 1e-8, "atol": 1e-8 * self.small}

    def drive(self, t: Array, q: Array, v: Array, a: Array) -> dict[Any, Motion]:
        return {key: Motion(t, q[:, j], v[:, j], a[:, j]) for j, key in enumerate(freedoms(self.arm))}

    def run(self, t: Array, q: Array, v: Array, a: Array, out: Array, step: float) -> Result:
        """Simulates the arm with these joint motions by Gauss collocation, at the times `out`."""
        return simulated(self.arm, out, q0=self._start(q[0]), drive=self.drive(t, q, v, a), integrator="gauss",
                         step=step)  # fmt: skip

    def _start(self, joints: Array) -> Array:
        q = self.q_start.copy()
        q[self.driven.at] = joints
        return q

    def left(self, q: Array, v: Array) -> Array:
        """Displacement and rate (over its frequency) of each locked mode at the end, (2, n), as displacements of the
        arm's end, of a tree of the end that moves most (m)."""
        m, d = self.modes, self.driven
        to_modes = m.shapes.T @ m.mass
        with np.errstate(divide="ignore", invalid="ignore"):
            rate = np.where(m.frequencies > 0, (to_modes @ v[d.elastic]) / m.frequencies, 0.0)
        return np.stack([to_modes @ (q - self.q_end)[d.elastic_at], rate]) * m.tip

    def after(self, duration: float) -> Array:
        """Times (s) after a move at which its vibration is evaluated: over a period of the slowest mode."""
        period = 2.0 * self.half_period or 0.1 * duration
        return duration + np.linspace(0.0, 1.05 * period, _LOOK)


_FOLLOWED = 24  # modes, at most


class Response(NamedTuple):
    """Derivatives by the variables (nx)."""

    left: Array  #: of `MovedArm.left`, for the modes that are steered, (2, n, nx)
    tau: Array  #: of the joints' torques at the knots, (N + 1, nj, nx)
    q: Array  #: likewise of their positions, rates and accelerations
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
