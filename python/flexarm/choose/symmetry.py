"""Coordinates that move at all, and the stability of those that symmetry keeps at rest."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._check import Array
from ..analysis.equilibrium import displaced
from ..model.acting.drive import split_drives
from ..model.acting.load import at_time
from ..model.parts.beam import STRAINS
from ..run.result import Result
from ..run.scene.scene import Scene
from .states import elastic_parts, embed, some_rows
from .times import probes


def _driven(scene: Scene) -> NDArray[np.bool_]:
    """Mask of rates with a drive, controller, patch or motion at the start."""
    arm = scene.arm
    active = np.zeros(arm.nv, dtype=bool)
    joints, patches = split_drives(scene.drive)
    active[list(arm.by_rate("drive", joints))] = True
    if scene.v0 is not None:
        active |= scene.v0 != 0.0
    if scene.q0 is not None:
        moved = scene.q0 != arm.zero
        for i in range(arm.nv):
            active[i] |= arm.coordinate_of(i) >= 0 and moved[arm.coordinate_of(i)]
        # a ball joint with an initial rotation keeps it; other coordinates move about it
    if patches:
        active = active | (arm.patch_matrix != 0.0).any(axis=1)
    for c in scene.control:
        for column in c._columns(arm):
            active |= column != 0.0
    return active


def _acting(scene: Scene) -> tuple[list[Any], Array]:
    """Places of the loads, and the largest magnitude of each component over time, (n, 6)."""
    most = []
    for load in scene.loads:
        breaks = load.law[0].breaks if isinstance(load.law, tuple) else probes(scene)
        times = np.union1d(scene.t, np.clip(breaks, scene.t[0], scene.t[-1]))
        most.append(np.abs([load(float(t)) for t in times]).max(axis=0))
    return [load.place(scene.arm) for load in scene.loads], np.array(most).reshape(-1, 6)


def excited(scene: Scene, seed: int = 1) -> NDArray[np.bool_]:
    """Mask (nv,) of rates that move at all: the driven ones, and those on which random motions of these exert a force.
    In a symmetric scene, such as a planar one, the force on all others is exactly zero."""
    rng, arm, active = np.random.default_rng(seed), scene.arm, _driven(scene)
    start = arm.zero if scene.q0 is None else scene.q0
    reach = np.where([any(s in name for s in STRAINS) for name in arm._core.coordinates], 0.01, 0.5)
    places, wrenches = _acting(scene)
    while not active.all():
        more = active.copy()
        for _ in range(3):
            theta, v, a = (reach * rng.normal(size=arm.nv) for _ in range(3))
            q = start + np.asarray(arm._core.rates(start, theta)[2]) @ np.where(active, theta, 0.0)
            for _, at in arm.quaternions():
                q[at] /= np.linalg.norm(q[at])
            rows = np.array([np.where(active, v, 0.0), v]), np.array([np.where(active, a, 0.0), a])
            pushed = wrenches * rng.uniform(0.5, 1.0, wrenches.shape)
            r = np.abs(arm._core.inverse_dynamics(np.tile(q, (2, 1)), *rows, places, pushed))
            more |= r[0] > 1e-9 * np.maximum(r[1], 1e-12 * r[1].max())
        if (more == active).all():
            break
        active = more
    return active


def growth(scene: Scene, result: Result, moves: NDArray[np.bool_], most_rows: int) -> float:
    """Growth factor within a run of small motions of the rates that `excited` leaves out, in the norm of kinetic and
    elastic energy: 1 if they only vibrate, a few if they drift, large if the run is unstable against small
    disturbances, like a strut above its buckling load.

    Args:
        scene: with an arm that has these coordinates. result: a run of a poorer one. most_rows: the most rows used.
    """
    arm, out = scene.arm, np.flatnonzero(~moves)
    if not out.size or len(result.t) < 2:
        return 1.0
    run = embed(result, arm, some_rows(len(result.t), most_rows))
    n, span = len(out), float(run.t[-1] - run.t[0])
    stiff = np.zeros((arm.nv, arm.nv))
    for _, at, beam in elastic_parts(arm):
        stiff[at, at] = beam._core.stiffness
    elastic, eye = stiff[np.ix_(out, out)], np.eye(2 * n)
    mean: Array
    ahead, behind = np.minimum(np.arange(len(run.t)) + 1, len(run.t) - 1), np.maximum(np.arange(len(run.t)) - 1, 0)
    mean_a = (run.v[ahead] - run.v[behind]) / (run.t[ahead] - run.t[behind])[:, None]  # not of fast vibration
    rows = [_tangent(scene, out, *row) for row in zip(run.t, run.q, run.v, mean_a, strict=True)]
    stiffening: Array = np.zeros((n, n))  # of loads and spin, at their largest
    for K, _, _ in rows:
        w, Z = np.linalg.eigh(0.5 * (K + K.T) - elastic)
        positive: Array = (Z * np.maximum(w, 0.0)) @ Z.T
        stiffening = positive if np.trace(positive) > np.trace(stiffening) else stiffening
    M0 = rows[0][1]
    norm = np.linalg.cholesky(np.block([[elastic + stiffening + M0 / span**2, 0 * M0], [0 * M0, M0]])).T
    state: Array = np.linalg.inv(norm)  # columns of unit energy
    most, fast = 1.0, 0.0
    for (K, _, before), (_, _, after), step in zip(rows[:-1], rows[1:], np.diff(run.t), strict=True):
        for share in (0.25, 0.75):  # trapezoidal rule: modes too fast for it neither grow nor decay
            mean = float(step) / 4 * ((1 - share) * before + share * after)
            state = np.asarray(np.linalg.solve(eye - mean, state + mean @ state))
        size = float(np.linalg.norm(norm @ state, 2)) if np.isfinite(state).all() else np.inf
        most = max(most, size)
        if np.linalg.eigvalsh(K + K.T)[0] < 0:  # growth too fast for the rule is counted apart
            rate = float(step) * float(np.linalg.eigvals(before).real.max())
            fast += rate if rate > 2.0 else 0.0
        if not size < 1e12:
            break
    return max(most, float(np.exp(min(fast, 30.0))))


def _tangent(scene: Scene, out: NDArray[np.int_], t: float, q: Array, v: Array, a: Array) -> tuple[Array, Array, Array]:
    """Stiffness, mass, and A in d/dt [x; y] = A [x; y] for small motions x of the coordinates `out` and their rates y.
    No force acts on them along the run. By differences of the inverse dynamics, which are odd in x and y."""
    arm, n, eps = scene.arm, len(out), 1e-5
    E = np.asarray(arm._core.rates(q, v)[2])
    units = np.eye(arm.nv)[out]
    qs = np.array([displaced(arm, q, E, eps * e) for e in units] + [q] * n)
    vs = np.array([v] * n + [v + eps * e for e in units])
    r = arm._core.inverse_dynamics(qs, vs, np.tile(a, (2 * n, 1)), *at_time(arm, scene.loads, t))
    K, D = (np.asarray(part)[:, out].T / eps for part in (r[:n], r[n:]))
    M = arm._core.mass_matrix(q)[np.ix_(out, out)]
    turn = np.zeros((n, n))  # of the axes of a ball's rates, as it rotates
    rates = np.asarray(arm._core.rates(q, v)[0])
    for _, at in arm.quaternions():
        turned = [i for i in range(arm.nv) if E[at, i].any()]
        inverse = np.linalg.pinv(E[at][:, turned])
        for j, i in enumerate(out):
            if i in turned:
                moved = displaced(arm, q, E, eps * np.eye(arm.nv)[i]), displaced(arm, q, E, -eps * np.eye(arm.nv)[i])
                change = (arm._core.rates(moved[0], v)[0] - arm._core.rates(moved[1], v)[0]) / (2 * eps)
                ahead = np.asarray(arm._core.rates(displaced(arm, q, np.eye(arm.nq), eps * rates), v)[2])
                change = change - (ahead - E)[:, i] / eps
                by = dict(zip(turned, inverse @ change[at], strict=True))
                turn[:, j] = [by.get(o, 0.0) for o in out]
    return K, M, np.block([[turn, np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
