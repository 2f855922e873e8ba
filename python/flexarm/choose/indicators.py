"""A priori indicators: estimated changes of a run by a richer model, before the richer model is run.

A run of one model is put into the equations of a richer one. The residual is the force on the richer model's
coordinates that the poorer model does not balance. The linear response to it, with the modes and the spectrum of the
excitation, estimates the error of leaving them out. The cost is one inverse dynamics for each row and one linear
integration of small matrices: less than a run.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .._check import Array
from ..arm.arm import Arm
from ..model.acting.control import control_laws
from ..model.acting.drive import Motion, split_drives
from ..model.acting.load import at_time
from ..run.result import Result
from ..run.scene.scene import Scene
from .measures import Measure
from .states import elastic_parts, embed, restated, some_rows

_ROWS = 121  # rows of a run for the residuals


def _voltages(scene: Scene, t: float) -> Array:
    V = np.zeros(len(scene.arm.patches))
    for (_, link, patch), law in split_drives(scene.drive)[1].items():
        V[scene.arm.patch_column(link, patch)] = law(t)
    return V


def _forces(scene: Scene, arm: Arm, run: Result) -> Array:
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


def indicate(
    rich: Scene, result: Result, measure: Measure, variants: Mapping[Any, Arm]
) -> tuple[Array, dict[Any, float]]:
    """The contribution of each coordinate of a richer arm to the quantity, over its span, (nv,); and by name, the
    estimated difference of each variant from the richer arm.

    Args:
        rich: the scene with the richer arm. result: a run of a poorer one. measure: the quantity, with its span.
        variants: arms with the richer one's coordinates, poorer in another property (order, rotary inertia).
    """
    arm, rows = rich.arm, some_rows(len(result.t), _ROWS)
    run = embed(result, arm, rows)
    full = _forces(rich, arm, run)
    known = restated(_forces(rich, result.arm, embed(result, result.arm, rows)), result.arm, arm, rates=True)
    missing = [full - known, *(full - _forces(rich, other, run) for other in variants.values())]
    x = _response(rich, run, -np.stack(missing, axis=2))
    size = measure.sense(rich, run.q)
    share = np.array([size(x[:, :, 0] * unit) for unit in np.eye(arm.nv)])
    return share, {
        name: size(x[:, :, k]) + measure.kinematic(rich, other, run.q)
        for k, (name, other) in enumerate(variants.items(), 1)
    }


def _response(scene: Scene, run: Result, forces: Array) -> Array:
    """Motions (nt, nv, m) of the linearised arm under forces (nt, nv, m), from rest."""
    arm, n = scene.arm, scene.arm.nv
    M, K, D = arm._core.mass_matrix(run.q[len(run.t) // 2]), np.zeros((n, n)), np.zeros((n, n))
    for _, at, beam in elastic_parts(arm):
        K[at, at], D[at, at] = beam._core.stiffness, beam._core.damping
    rates = [arm.coordinate_of(i) for i in range(n)]
    for f in control_laws(arm, scene.control, scene.t, scene.loads)[0] if scene.control else ():
        by_rate = np.array([f.by_q[j] if j >= 0 else 0.0 for j in rates])
        K, D = K + np.outer(f.column[:n], by_rate), D + np.outer(f.column[:n], f.by_v[:n])
    laws = arm.by_rate("drive", split_drives(scene.drive)[0])
    free = np.array([not isinstance(laws.get(i), Motion) for i in range(n)])
    x = np.zeros(forces.shape)
    if free.any() and len(run.t) > 1:
        at2 = np.ix_(free, free)
        dt = float(run.t[-1] - run.t[0]) / (len(run.t) - 1)
        with np.errstate(all="ignore"):
            x[:, free] = _newmark(M[at2], D[at2], K[at2], dt, forces[:, free])
    return np.nan_to_num(x, nan=1e6, posinf=1e6, neginf=-1e6)
