"""Before a model is run: the coordinates that move at all, whether the others stay at rest, and estimated changes of a
run by a richer model.

For the estimates, a run of one model is put into the equations of a richer one. The residual is the force on the richer
model's coordinates that the poorer model does not balance. The linear response to it, with the modes and the spectrum
of the excitation, estimates the error of leaving them out. The cost is one inverse dynamics for each row and one linear
integration of small matrices: less than a run.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._check import Array
from ..analysis.closed import turning
from ..arm.arm import Arm
from ..model.acting.control import control_laws
from ..model.acting.drive import Motion, split_drives, voltage_forces
from ..model.acting.load import at_time, pushes
from ..model.parts.beam import STRAINS
from ..run.result import Result
from ..run.scene.scene import Scene
from ..run.start import acting
from .measures import Measure, probes
from .states import embed, restated, some_rows

_ROWS = 121  # rows of a run for the residuals


def _driven(scene: Scene) -> NDArray[np.bool_]:
    """Mask of rates with a drive, controller, patch or motion at the start."""
    arm = scene.arm
    active = np.zeros(arm.nv, dtype=bool)
    joints, patches, struts = split_drives(arm, scene.drive)
    active[list(arm.by_rate("drive", joints))] = True
    if struts:
        active |= (arm.strut_jacobian(scene.start())[[arm._strut(name) for name in struts]] != 0.0).any(axis=0)
    if scene.v0 is not None:
        active |= scene.v0 != 0.0
    if scene.q0 is not None:  # a ball joint with an initial rotation keeps it; other coordinates move about it
        at = np.array([arm.coordinate_of(i) for i in range(arm.nv)])
        active |= (at >= 0) & (scene.q0 != arm.zero)[at]
    if patches:
        active = active | (arm.patch_matrix != 0.0).any(axis=1)
    for c in scene.control:
        for column in c._columns(arm):
            active |= column != 0.0
    return active


def _acting(scene: Scene) -> tuple[list[Any], Array]:
    """Places of the loads, and the largest magnitude of each component over time, (n, 6)."""
    most = []
    loads = [*scene.loads, *pushes(scene.arm, scene.drive)]
    for load in loads:
        if load.by_state:
            raise ValueError(f"{load}: follows from the state, so that how large it becomes is not known beforehand")
        breaks = load.law[0].breaks if isinstance(load.law, tuple) else probes(scene)
        times = np.union1d(scene.t, np.clip(breaks, scene.t[0], scene.t[-1]))
        most.append(np.abs([load(float(t)) for t in times]).max(axis=0))
    return [load.place(scene.arm) for load in loads], np.array(most).reshape(-1, 6)


def excited(scene: Scene) -> NDArray[np.bool_]:
    """Mask (nv,) of rates that move at all: the driven ones, and those on which random motions of these exert a force.
    In a symmetric scene, such as a planar one, the force on all others is exactly zero."""
    rng, arm, active = np.random.default_rng(1), scene.arm, _driven(scene)
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
            if arm.contacts:  # wherever they might touch
                J = np.abs(arm.contact_jacobian(q))
                more |= (J > 1e-9 * J.max()).any(axis=0)
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
    beams, eye = elastic(arm)[0][np.ix_(out, out)], np.eye(2 * n)
    mean: Array
    mean_a = np.gradient(run.v, run.t, axis=0)  # not of fast vibration
    rows = [_tangent(scene, out, *row) for row in zip(run.t, run.q, run.v, mean_a, strict=True)]
    stiffening: Array = np.zeros((n, n))  # of loads and spin, at their largest
    for K, _, _ in rows:
        w, Z = np.linalg.eigh(0.5 * (K + K.T) - beams)
        positive: Array = (Z * np.maximum(w, 0.0)) @ Z.T
        stiffening = positive if np.trace(positive) > np.trace(stiffening) else stiffening
    M0 = rows[0][1]
    norm = np.linalg.cholesky(np.block([[beams + stiffening + M0 / span**2, 0 * M0], [0 * M0, M0]])).T
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
    No force acts on them along the run."""
    arm, here = scene.arm, np.ix_(out, out)
    loads = [*scene.loads, *pushes(arm, scene.drive)]
    by_q, by_v = arm._core.inverse_derivatives(q, v, a, *at_time(arm, loads, t))
    K, D, M = ((by_q @ arm._core.rates(q, v)[2])[here], by_v[here], arm._core.mass_matrix(q)[here])
    turn = -turning(arm, v)[here]  # of the axes of a ball's rates, as it rotates
    return K, M, np.block([[turn, np.eye(len(out))], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])


def elastic(arm: Arm) -> tuple[Array, Array]:
    """Stiffness and damping of the beams, (nv, nv) each."""
    K, D = np.zeros((2, arm.nv, arm.nv))
    for _, beam, _, at in arm.beams():
        K[at, at], D[at, at] = beam._core.stiffness, beam._core.damping
    return K, D


def _forces(scene: Scene, arm: Arm, run: Result) -> Array:
    """Inverse dynamics along a run, less the loads' and the patches' forces, (nt, nv)."""
    patched, loads = bool(split_drives(arm, scene.drive)[1]), [*scene.loads, *pushes(arm, scene.drive)]
    if not loads and not patched:
        return np.asarray(arm._core.inverse_dynamics(run.q, run.v, run.a))
    out = []
    for t, q, v, a in zip(run.t, run.q, run.v, run.a, strict=True):
        r = arm._core.inverse_dynamics(q, v, a, *at_time(arm, loads, float(t)))
        out.append(r - voltage_forces(arm, acting(scene.arm, scene.drive, float(t))[1]) if patched else r)
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
    run, x = _lacking(rich, result, variants)
    size = measure.sense(rich, run.q)
    share = np.array([size(x[:, :, 0] * unit) for unit in np.eye(rich.arm.nv)])
    return share, {
        name: size(x[:, :, k]) + measure.kinematic(rich, other, run.q)
        for k, (name, other) in enumerate(variants.items(), 1)
    }


def response(rich: Scene, result: Result, measure: Measure) -> tuple[Array, float]:
    """The contribution of each coordinate of a richer arm to the quantity, over its span, (nv,), and that of all."""
    run, x = _lacking(rich, result, {})
    size = measure.sense(rich, run.q)
    return np.array([size(x[:, :, 0] * unit) for unit in np.eye(rich.arm.nv)]), size(x[:, :, 0])


def _lacking(rich: Scene, result: Result, variants: Mapping[Any, Arm]) -> tuple[Result, Array]:
    """Some rows of a run in a richer arm, and the motions (nt, nv, 1 + variants) of that under the forces that are
    lacking: those of the poorer arm, and those of each variant."""
    arm, rows = rich.arm, some_rows(len(result.t), _ROWS)
    run = embed(result, arm, rows)
    full = _forces(rich, arm, run)
    known = restated(_forces(rich, result.arm, embed(result, result.arm, rows)), result.arm, arm, rates=True)
    missing = [full - known, *(full - _forces(rich, other, run) for other in variants.values())]
    return run, _response(rich, run, -np.stack(missing, axis=2))


def _response(scene: Scene, run: Result, forces: Array) -> Array:
    """Motions (nt, nv, m) of the linearised arm under forces (nt, nv, m), from rest."""
    arm, n = scene.arm, scene.arm.nv
    k, still = len(run.t) // 2, np.zeros(n)
    loads = at_time(arm, [*scene.loads, *pushes(arm, scene.drive)], float(run.t[k]))
    M, (by_q, D) = arm._core.mass_matrix(run.q[k]), arm._core.inverse_derivatives(run.q[k], still, still, *loads)
    K = np.asarray(by_q @ arm._core.rates(run.q[k], still)[2])
    rates = [arm.coordinate_of(i) for i in range(n)]
    for f in control_laws(arm, scene.control, scene.t, scene.loads)[0] if scene.control else ():
        by_rate = np.array([f.by_q[j] if j >= 0 else 0.0 for j in rates])
        K, D = K + np.outer(f.column[:n], by_rate), D + np.outer(f.column[:n], f.by_v[:n])
    laws = arm.by_rate("drive", split_drives(arm, scene.drive)[0])
    free = np.array([not isinstance(laws.get(i), Motion) for i in range(n)])
    x = np.zeros(forces.shape)
    if free.any() and len(run.t) > 1:
        at2 = np.ix_(free, free)
        dt = float(run.t[-1] - run.t[0]) / (len(run.t) - 1)
        with np.errstate(all="ignore"):
            x[:, free] = _newmark(M[at2], D[at2], K[at2], dt, forces[:, free])
    return np.nan_to_num(x, nan=1e6, posinf=1e6, neginf=-1e6)
