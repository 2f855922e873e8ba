"""Before a model is run: the coordinates that move at all, whether the others stay at rest, and estimated changes of a
run by a richer model.

For the estimates, a run of one model is put into the equations of a richer one. The residual is the force on the richer
model's coordinates that the poorer model does not balance. The linear response to it, with the modes and the spectrum
of the excitation, estimates the error of leaving them out. The cost is one inverse dynamics for each row and one linear
integration of small matrices: less than a run.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._check import Array
from ..analysis.closed import turning
from ..arm.arm import Arm
from ..model.acting.control import control_laws
from ..model.acting.drive import moved_rates, split_drives, voltage_forces
from ..model.acting.load import at_time, pushes
from ..model.parts.beam import STRAINS
from ..run.result import Result
from ..run.scene.scene import Scene
from ..run.start import acting
from .measures import Measure, probes
from .states import embed, keys, restated, some_rows

_ROWS = 121  # rows of a run for the residuals
_PLACES = 61  # of a run, at which its equations of small motions are found; between them they are interpolated
_STUCK = 1e-6  # rad/s or m/s: joints with dry friction that are slower stick


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


def forces_of(scene: Scene, arm: Arm, run: Result) -> Array:
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
    """x (nt, n) of M x'' + D x' + K x = f from rest, f (nt, n), by Newmark's method with numerical damping of modes too
    fast for dt: their coordinates follow f quasi-statically."""
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


def response(rich: Scene, result: Result, measure: Measure) -> tuple[Array, float]:
    """The contribution of each coordinate of a richer arm to the quantity, over its span, (nv,), and that of all, at
    one stiffness; `worth` takes that of each time."""
    arm, rows = rich.arm, some_rows(len(result.t), _ROWS)
    run = embed(result, arm, rows)
    known = restated(forces_of(rich, result.arm, embed(result, result.arm, rows)), result.arm, arm, rates=True)
    x, size = _response(rich, run, known - forces_of(rich, arm, run)), measure.sense(rich, run.q)
    return np.array([size(x * unit) for unit in np.eye(arm.nv)]), size(x)


def _response(scene: Scene, run: Result, forces: Array) -> Array:
    """Motions (nt, nv) of the linearised arm under forces (nt, nv), from rest."""
    arm, n = scene.arm, scene.arm.nv
    k, still = len(run.t) // 2, np.zeros(n)
    loads = at_time(arm, [*scene.loads, *pushes(arm, scene.drive)], float(run.t[k]))
    M, (by_q, D) = arm._core.mass_matrix(run.q[k]), arm._core.inverse_derivatives(run.q[k], still, still, *loads)
    K = np.asarray(by_q @ arm._core.rates(run.q[k], still)[2])
    more, free = _by_controllers(scene), _free(scene)
    K, D = K + more[1], D + more[0]
    x = np.zeros(forces.shape)
    if free.any() and len(run.t) > 1:
        at2 = np.ix_(free, free)
        dt = float(run.t[-1] - run.t[0]) / (len(run.t) - 1)
        with np.errstate(all="ignore"):
            x[:, free] = _newmark(M[at2], D[at2], K[at2], dt, forces[:, free])
    return np.nan_to_num(x, nan=1e6, posinf=1e6, neginf=-1e6)


def _by_controllers(scene: Scene) -> Array:
    """Damping and stiffness of controllers, without their memory, (2, nv, nv)."""
    arm, n = scene.arm, scene.arm.nv
    out, rates = np.zeros((2, n, n)), [arm.coordinate_of(i) for i in range(n)]
    for f in control_laws(arm, scene.control, scene.t, scene.loads)[0] if scene.control else ():
        out[0] += np.outer(f.column[:n], f.by_v[:n])
        out[1] += np.outer(f.column[:n], [f.by_q[j] if j >= 0 else 0.0 for j in rates])
    return out


def _free(scene: Scene) -> NDArray[np.bool_]:
    """Mask of rates that no motion prescribes."""
    return ~np.isin(np.arange(scene.arm.nv), moved_rates(scene.arm, scene.drive))


class Tangents:
    """The equations of small motions about a run, M x'' + D x' + K x = f, at some of its times; with controllers, but
    without their memory.

    Args:
        scene: with the run's arm. run: at evenly spaced times.

    Attributes:
        rows: of the run. matrices: M, D and K there, (3, rows, nv, nv).
    """

    def __init__(self, scene: Scene, run: Result) -> None:
        arm, n = scene.arm, scene.arm.nv
        self.scene, self.run = scene, run
        self.free, more = np.flatnonzero(_free(scene)), np.concatenate([np.zeros((1, n, n)), _by_controllers(scene)])
        loads = [*scene.loads, *pushes(arm, scene.drive)]
        rubs = np.zeros(n, dtype=bool)
        for k, link in enumerate(arm.links):
            first = arm._core.first(k)
            rubs[first : first + link.joint.nv] = np.array(link.joint._per_freedom("coulomb", link.joint.nv)) > 0.0
        self.rows, out = some_rows(len(run.t), _PLACES), []
        for k in self.rows:
            q, v, a = run.q[k], run.v[k], run.a[k]
            by_q, by_v = arm._core.inverse_derivatives(q, v, a, *at_time(arm, loads, float(run.t[k])))
            M, K = arm._core.mass_matrix(q), by_q @ arm._core.rates(q, v)[2]
            stuck = np.diag(np.where(rubs & (np.abs(v) < _STUCK), 1e6 * np.diag(M) / np.ptp(run.t), 0.0))
            out.append(np.stack([M, by_v + stuck, K]) + more)
        self.matrices: Array = np.array(out).transpose(1, 0, 2, 3)

    def answers(
        self, forces: Array, held: Sequence[Sequence[int]] = (), balanced: bool = False
    ) -> tuple[Array, Array]:  # fmt: skip
        """Motions x and rates (nt, nv, m) under forces (nt, nv, m), by the midpoint rule.

        Args:
            held: of the first columns, the rates that undo the run's: without these coordinates it would be like this.
            balanced: whether it begins where the elastic coordinates are in balance; else, but for those held, at zero.
        """
        free, h = self.free, float(np.ptp(self.run.t)) / (len(self.run.t) - 1)
        M, D, K = self.matrices[:, :, free[:, None], free]
        before, after = M + 0.5 * h * D + 0.25 * h**2 * K, M - 0.5 * h * D - 0.25 * h**2 * K
        at = np.array([self.scene.arm.coordinate_of(int(i)) for i in free])
        target, groups = -self.run.v[:, free], [np.searchsorted(free, list(some)) for some in held]
        out = np.zeros((2, *forces.shape))
        x, v = np.zeros((2, len(free), forces.shape[2]))
        elastic = [i for i, j in enumerate(free) if keys(self.scene.arm)[j][0] >= 0]
        for c in range(forces.shape[2]):
            mine = groups[c] if c < len(groups) else np.zeros(0, dtype=int)
            x[mine, c] = -self.run.q[0, at[mine]]
            others = np.array([i for i in elastic if i not in mine] if balanced else [], dtype=int)
            push = forces[0, free[others], c] - K[0][np.ix_(others, mine)] @ x[mine, c]
            x[others, c] = np.linalg.lstsq(K[0][np.ix_(others, others)], push, rcond=None)[0]
        out[0, 0, free] = x
        single = [c for c, some in enumerate(groups) if len(some) == 1]
        one = [groups[c][0] for c in single]
        pushed = 0.5 * h * (forces[1:, free] + forces[:-1, free])
        with np.errstate(all="ignore"):
            for i, (first, last) in enumerate(zip(self.rows[:-1], self.rows[1:], strict=True)):
                part = ((np.arange(first, last) + 0.5 - first) / (last - first))[:, None, None]
                S, T, stiff = (X[i] + part * (X[i + 1] - X[i]) for X in (before, after, h * K))
                S = np.linalg.inv(S)
                for n, k in enumerate(range(first, last)):
                    new = S[n] @ (T[n] @ v - stiff[n] @ x + pushed[k])
                    if single:
                        new[:, single] += S[n][:, one] * ((target[k + 1, one] - new[one, single]) / S[n][one, one])
                    for c, some in enumerate(groups):
                        if len(some) > 1:
                            lacks = target[k + 1, some] - new[some, c]
                            new[:, c] += S[n][:, some] @ np.linalg.solve(S[n][np.ix_(some, some)], lacks)
                    x, v = x + 0.5 * h * (v + new), new
                    out[0, k + 1, free], out[1, k + 1, free] = x, v
        x, v = np.nan_to_num(out, nan=1e6, posinf=1e6, neginf=-1e6)
        return x, v


def smoothed(run: Result) -> Result:
    """A run at evenly spaced times with the rates and accelerations that its coordinates have from row to row: without
    those of vibrations that the rows do not follow, whose accelerations are large."""
    arm, v = run.arm, run.v.copy()
    plain = [(i, j) for i in range(arm.nv) if (j := arm.coordinate_of(i)) >= 0]
    of, places = [i for i, _ in plain], [j for _, j in plain]
    v[:, of] = np.gradient(run.q[:, places], run.t, axis=0)
    return replace(run, v=v, a=np.gradient(v, run.t, axis=0))


def worth(rich: Scene, result: Result, measure: Measure) -> tuple[Array, float]:
    """What the quantity of a run changes, over its span, by the force that it lacks on each further coordinate of a
    richer arm, (nv,), 0 of those that it has, and by all of them: the motions of the richer arm under these."""
    arm, rows = rich.arm, some_rows(len(result.t), 201)
    some, run = embed(result, result.arm, rows), embed(result, arm, rows)
    lacking = restated(forces_of(rich, result.arm, some), result.arm, arm, rates=True) - forces_of(rich, arm, run)
    new = [i for i, key in enumerate(keys(arm)) if key not in set(keys(result.arm))]
    each = np.zeros((*lacking.shape, len(new) + 1))
    each[:, new, range(len(new))], each[:, :, -1] = lacking[:, new], lacking
    x = Tangents(rich, run).answers(each)[0]
    sizes, size = np.zeros(arm.nv), measure.sense(rich, run.q)
    sizes[new] = [size(x[:, :, k]) for k in range(len(new))]
    return sizes, size(x[:, :, -1])
