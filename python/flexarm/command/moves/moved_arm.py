"""A flexible arm whose joints are moved: its simulation, and its response to a small change of the command."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..._check import Array
from ...analysis.equilibrium import equilibrium
from ...analysis.modes import small_motions
from ...arm.arm import Arm
from ...model.acting.drive import Motion
from ...run.result import Result
from ...run.simulation import simulated
from .move_limits import Driven

_LOOK = 96  # times in a period of the slowest mode at which the vibration is evaluated


@dataclass(frozen=True)
class LockedModes:
    """Modes about rest with all joints locked.

    Attributes:
        frequencies: undamped (rad/s), ascending, (n,).
        shapes: of the elastic coordinates, their modal masses 1, (ne, n). mass: of these, (ne, ne).
        tip: displacement of the arm's end by each mode of amplitude 1, (n,).
    """

    frequencies: Array
    shapes: Array
    mass: Array
    tip: Array


class MovedArm:
    """An arm that goes from rest to rest.

    Args:
        start, end: of the joints, (nj,).
    """

    def __init__(self, arm: Arm, driven: Driven, start: Array, end: Array) -> None:
        self.arm, self.driven = arm, driven
        self.joints = [(k, n) for k, link in enumerate(arm.links) for n in range(link.joint.nv)]
        self.locked = [k for k, link in enumerate(arm.links) if link.joint.nv]
        self.q_start, self.q_end = self._rest(start), self._rest(end)
        self.modes_start, self.modes = self.modes_at(self.q_start), self.modes_at(self.q_end)
        for where, modes in (("starts", self.modes_start), ("ends", self.modes)):
            if (modes.frequencies <= 0.0).any():
                raise ValueError(f"q_from, q_to: where the move {where} the arm buckles between locked joints")

    def _rest(self, joints: Array) -> Array:
        q = self.arm.zero
        q[self.driven.at] = joints
        return equilibrium(self.arm, q, None, self.locked, ())

    def modes_at(self, q: Array) -> LockedModes:
        """The modes at a state of rest (nq,)."""
        elastic = self.driven.elastic
        if not elastic.size:
            return LockedModes(np.zeros(0), np.zeros((0, 0)), np.zeros((0, 0)), np.zeros(0))
        found = small_motions(self.arm, q, lock=self.locked)
        modes = found.undamped()
        shapes = np.real(modes.shapes[elastic])
        shapes = shapes / np.sqrt(np.einsum("ik,ij,jk->k", shapes, found.M, shapes))
        J = self.arm.jacobian(q)[:3][:, elastic]
        return LockedModes(modes.frequencies, shapes, found.M, np.linalg.norm(J @ shapes, axis=0))

    @property
    def half_period(self) -> float:
        """Half a period of the slowest mode, at the start or at the end, the shorter one (s); 0 for a rigid arm."""
        if not self.driven.elastic.size:
            return 0.0
        return float(np.pi / max(self.modes_start.frequencies[0], self.modes.frequencies[0]))

    @cached_property
    def rest(self) -> Array:
        """Final place of the arm's end, (3,)."""
        return self.arm.frame(self.q_end)[0]

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
        return {key: Motion(t, q[:, j], v[:, j], a[:, j]) for j, key in enumerate(self.joints)}

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
        arm's end (m)."""
        m, d = self.modes, self.driven
        to_modes = m.shapes.T @ m.mass
        with np.errstate(divide="ignore", invalid="ignore"):
            rate = np.where(m.frequencies > 0, (to_modes @ v[d.elastic]) / m.frequencies, 0.0)
        return np.stack([to_modes @ (q - self.q_end)[d.elastic_at], rate]) * m.tip

    def after(self, duration: float) -> Array:
        """Times (s) after a move at which its vibration is evaluated: over a period of the slowest mode."""
        period = 2.0 * self.half_period or 0.1 * duration
        return duration + np.linspace(0.0, 1.05 * period, _LOOK)
