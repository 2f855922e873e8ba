"""A priori indicators: estimated changes of a run by a richer model, before the richer model is run.

A run of one model is put into the equations of a richer one. The residual is the force on the richer model's
coordinates that the poorer model does not balance. The linear response to it, with the modes and the spectrum of the
excitation, estimates the error of leaving them out. The cost is one inverse dynamics for each row and one linear
integration of small matrices: less than a run.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .._check import Array
from ..arm.arm import Arm
from ..model.acting.control import control_laws
from ..model.acting.drive import Motion, split_drives
from ..model.acting.load import at_time
from ..run.result import Result
from ..run.scene.scene import Scene
from .coordinates import Embedded, carried_v, embed, some_rows
from .measures import Measure

_ROWS = 121  # rows of a run for the residuals


def prescribed_rates(scene: Scene) -> list[int]:
    """Indices of rates with prescribed motion."""
    laws = scene.arm.by_rate("drive", split_drives(scene.drive)[0])
    return [i for i, law in laws.items() if isinstance(law, Motion)]


def _voltages(scene: Scene, t: float) -> Array:
    V = np.zeros(len(scene.arm.patches))
    for (_, link, patch), law in split_drives(scene.drive)[1].items():
        V[scene.arm.patch_column(link, patch)] = law(t)
    return V


def _feedback(scene: Scene) -> list[Any]:
    if not scene.control:
        return []
    return list(control_laws(scene.arm, scene.control, scene.t, scene.loads)[0])


def _forces(scene: Scene, arm: Arm, run: Embedded) -> Array:
    """Inverse dynamics along a run, less the loads' and the patches' forces, (nt, nv)."""
    patched = bool(split_drives(scene.drive)[1])
    if not scene.loads and not patched:
        return np.asarray(arm._core.inverse_dynamics(run.q, run.v, run.a))
    out = []
    for t, q, v, a in zip(run.t, run.q, run.v, run.a, strict=True):
        r = arm._core.inverse_dynamics(q, v, a, *at_time(arm, scene.loads, float(t)))
        out.append(r - arm.patch_matrix @ _voltages(scene, float(t)) if patched else r)
    return np.array(out)


def _newmark(M: Array, D: Array, K: Array, dt: float, forces: Array) -> Array:
    """x (nt, n, m) of M x'' + D x' + K x = f from rest, f (nt, n, m), by Newmark's method with numerical damping of
    modes too fast for dt: their coordinates follow f quasi-statically."""
    gamma, beta = 0.55, 0.276
    size = 1.0 / np.sqrt(np.diag(M) + beta * dt**2 * np.abs(np.diag(K)))
    S = size[:, None] * (M + gamma * dt * D + beta * dt**2 * K) * size
    inverse = size[:, None] * np.linalg.inv(S) * size  # scaled, small, used for every step
    x, v, a = (np.zeros(forces.shape[1:]) for _ in range(3))
    out = np.zeros(forces.shape)
    for k in range(1, len(forces)):
        x = x + dt * v + dt**2 * (0.5 - beta) * a
        v = v + dt * (1 - gamma) * a
        a = inverse @ (forces[k] - D @ v - K @ x)
        x, v = x + beta * dt**2 * a, v + gamma * dt * a
        out[k] = x
    return out


class Indicators:
    """Estimated changes of a run by a richer arm.

    Args:
        rich: the scene with the richer arm. result: a run of a poorer one. measure: the quantity, with its span.
        variants: arms with the richer one's coordinates, poorer in another property (order, rotary inertia).

    Attributes:
        share: contribution of each coordinate of the richer arm to the quantity, over its span, (nv,).
        variants: by name, the estimated difference of each variant from the richer arm.
    """

    def __init__(self, rich: Scene, result: Result, measure: Measure, variants: dict[Any, Arm]) -> None:
        arm = rich.arm
        rows = some_rows(len(result.t), _ROWS)
        run = embed(result, arm, rows)
        self.run = run
        full = _forces(rich, arm, run)
        poor = Embedded(result.t[rows], result.q[rows], result.v[rows], result.a[rows])
        known = carried_v(_forces(rich, result.arm, poor), result.arm, arm)
        columns = [full - known]
        columns += [full - _forces(rich, other, run) for other in variants.values()]
        x = self._response(rich, run, -np.stack(columns, axis=2))
        sense = measure.sense(rich, run.q)
        own = [sense.size(x[:, :, 0] * unit) for unit in np.eye(arm.nv)]
        self.share = np.array(own)
        self.total = sense.size(x[:, :, 0])
        self.variants: dict[Any, float] = {
            name: sense.size(x[:, :, k]) + measure.kinematic(rich, other, run.q)
            for k, (name, other) in enumerate(variants.items(), 1)
        }

    @staticmethod
    def _response(scene: Scene, run: Embedded, forces: Array) -> Array:
        arm, mid = scene.arm, len(run.t) // 2
        M = arm._core.mass_matrix(run.q[mid])
        K, D = np.zeros((arm.nv, arm.nv)), np.zeros((arm.nv, arm.nv))
        for k, link in enumerate(arm.links):
            if link.beam is not None and link.beam.ne:
                at = slice(arm._core.first(k) + link.joint.nv, arm._core.first(k) + link.joint.nv + link.beam.ne)
                K[at, at], D[at, at] = link.beam._core.stiffness, link.beam._core.damping
        rates = [arm.coordinate_of(i) for i in range(arm.nv)]
        for f in _feedback(scene):
            column, by_q, by_v = f.column, f.by_q, f.by_v
            c, by_rate = column[: arm.nv], np.array([by_q[j] if j >= 0 else 0.0 for j in rates])
            K, D = K + np.outer(c, by_rate), D + np.outer(c, by_v[: arm.nv])
        free = np.ones(arm.nv, dtype=bool)
        free[prescribed_rates(scene)] = False
        x = np.zeros(forces.shape)
        if free.any() and len(run.t) > 1:
            at2 = np.ix_(free, free)
            dt = float(run.t[-1] - run.t[0]) / (len(run.t) - 1)
            with np.errstate(all="ignore"):
                x[:, free] = _newmark(M[at2], D[at2], K[at2], dt, forces[:, free])
        return np.nan_to_num(x, nan=1e6, posinf=1e6, neginf=-1e6)
