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
from ..model.acting.control import control_laws, padded
from ..model.acting.drive import moved_rates, split_drives
from ..model.acting.load import at_time, pushes
from ..model.parts.beam import STRAINS
from ..run.result import Result
from ..run.scene.scene import Scene
from .measures import Measure, probes
from .models import Model, Models
from .states import embed, keys, restated, some_rows

_ROWS = 81  # rows of a run for the residuals
_PLACES, _FEW = 61, 9  # of a run, at which its equations of small motions are found; the latter for shares alone
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
    run = replace(run, a=np.gradient(run.v, run.t, axis=0))  # not of fast vibration
    n, span = len(out), float(run.t[-1] - run.t[0])
    beams, eye = elastic(arm)[0][np.ix_(out, out)], np.eye(2 * n)
    M, D, K = Tangents(scene, run, len(run.t)).matrices[:, :, out[:, None], out]
    w, Z = np.linalg.eigh(0.5 * (K + K.transpose(0, 2, 1)) - beams)
    positive = (Z * np.maximum(w, 0.0)[:, None]) @ Z.transpose(0, 2, 1)
    stiffening = positive[np.trace(positive, axis1=1, axis2=2).argmax()]  # of loads and spin
    M0, A = M[0], np.tile(np.eye(2 * n, k=n), (len(M), 1, 1))
    A[:, n:] = -np.linalg.solve(M, np.concatenate([K, D], axis=2))
    norm = np.linalg.cholesky(np.block([[beams + stiffening + M0 / span**2, 0 * M0], [0 * M0, M0]])).T
    state: Array = np.linalg.inv(norm)  # columns of unit energy
    most, fast = 1.0, 0.0
    for stiff, before, after, step in zip(K[:-1], A[:-1], A[1:], np.diff(run.t), strict=True):
        for share in (0.25, 0.75):  # trapezoidal rule: modes too fast for it neither grow nor decay
            mean = float(step) / 4 * ((1 - share) * before + share * after)
            state = np.asarray(np.linalg.solve(eye - mean, state + mean @ state))
        size = float(np.linalg.norm(norm @ state, 2)) if np.isfinite(state).all() else np.inf
        most = max(most, size)
        if np.linalg.eigvalsh(stiff + stiff.T)[0] < 0:  # growth too fast for the rule is counted apart
            rate = float(step) * float(np.linalg.eigvals(before).real.max())
            fast += rate if rate > 2.0 else 0.0
        if not size < 1e12:
            break
    return max(most, float(np.exp(min(fast, 30.0))))


def elastic(arm: Arm) -> tuple[Array, Array]:
    """Stiffness and damping of the beams, (nv, nv) each."""
    K, D = np.zeros((2, arm.nv, arm.nv))
    for _, beam, _, at in arm.beams():
        K[at, at], D[at, at] = beam._core.stiffness, beam._core.damping
    return K, D


def forces(scene: Scene, run: Result, arm: Arm | None = None) -> Array:
    """Inverse dynamics along a run, of its arm or of another one with its coordinates, less the loads' forces,
    (nt, nv)."""
    arm, loads = arm or run.arm, [*scene.loads, *pushes(scene.arm, scene.drive)]
    rows = [[load.numbers(x) for load in loads] for x in run.t.tolist()]
    wrenches = np.array(rows).reshape(len(run.t), len(loads), 6)
    return np.asarray(arm._core.inverse_dynamics(run.q, run.v, run.a, [x.place(arm) for x in loads], wrenches))


def acting_on(models: Models, run: Result, arm: Arm) -> Array:
    """What acts on the coordinates of a run, beside loads, in those of another model: on joints as it is; on beams by
    the voltages of patches. Feedback reads what the other model shows, such as another strain at a clamp."""
    of, found = run.arm, forces(models.scene, run)
    out = restated(found, of, arm, rates=True)
    if models.pinned:  # something may act on coordinates by number; they are the same
        return out
    theirs, own = ([i for i, key in enumerate(keys(a)) if key[0] >= 0] for a in (arm, of))
    out[:, theirs] = 0.0
    if of.patch_matrix.size and of.patch_matrix[own].any():
        volts = np.linalg.lstsq(of.patch_matrix[own], found[:, own].T, rcond=None)[0]
        out[:, theirs] = (arm.patch_matrix[theirs] @ volts).T
    scene, lifted = models.scene, embed(run, arm)
    laws = (control_laws(a, scene.control, scene.t, scene.loads)[0] if scene.control else () for a in (arm, of))
    for f, g in zip(*laws, strict=True):  # a force is column (reference - by_q q - by_v v)
        read = lifted.q @ f.by_q[: arm.nq] + lifted.v @ f.by_v[: arm.nv]
        before = run.q @ g.by_q[: of.nq] + run.v @ g.by_v[: of.nv]
        out -= np.outer(read - before, f.column[: arm.nv])
    return out


class Tangents:
    """The equations of small motions x about a run, M x'' + D x' + K x = f, at some of its times; with controllers and
    their memory, but without those that sample. The turns of a ball are in its link's axes, which turn with it.

    Args:
        scene: with the run's arm. run: at evenly spaced times. places: of the run, at which the equations are found;
            between them they are interpolated.

    Attributes:
        rows: of the run. matrices: M, D and K there, (3, rows, n, n); memory comes after the rates.
    """

    def __init__(self, scene: Scene, run: Result, places: int = _PLACES) -> None:
        arm, n = scene.arm, scene.arm.nv
        laws, _, memory = control_laws(arm, scene.control, scene.t, scene.loads) if scene.control else ([], [], 0)
        self.scene, self.run = scene, run
        self.rows, size = some_rows(len(run.t), places), n + memory
        held = moved_rates(arm, scene.drive)
        self.free = np.flatnonzero(~np.isin(np.arange(size), held))
        fed: Array = np.zeros((3, size, size))
        fed[0, n:, n:] = np.eye(memory)
        read = np.array([*map(arm.coordinate_of, range(n)), *range(arm.nq, arm.nq + memory)])
        for f in laws:
            column, by_q, by_v = padded(f.column, size), padded(f.by_q, arm.nq + memory), padded(f.by_v, size)
            fed[1:] += column[:, None] * np.stack([by_v, np.where(read >= 0, by_q[read], 0.0)])[:, None]
        loads = [*scene.loads, *pushes(arm, scene.drive)]
        rubs = np.zeros(n, dtype=bool)
        for k, link in enumerate(arm.links):
            first = arm._core.first(k)
            rubs[first : first + link.joint.nv] = np.array(link.joint._per_freedom("coulomb", link.joint.nv)) > 0.0
        self.matrices: Array = np.repeat(fed[:, None], len(self.rows), axis=1)
        for at, k in zip(self.matrices.transpose(1, 0, 2, 3), self.rows, strict=True):
            q, v, a = run.q[k], run.v[k], run.a[k]
            by_q, by_v = arm._core.inverse_derivatives(q, v, a, *at_time(arm, loads, float(run.t[k])))
            M, K, W = arm._core.mass_matrix(q), by_q @ arm._core.rates(q, v)[2], turning(arm, v)
            D = by_v + np.diag(np.where(rubs & (np.abs(v) < _STUCK), 1e6 * np.diag(M) / np.ptp(run.t), 0.0))
            at[:, :n, :n] += M, D + M @ W, K + D @ W + M @ turning(arm, a)

    def answers(
        self, forces: Array, held: Sequence[Sequence[int]] = (), balanced: bool = False
    ) -> tuple[Array, Array]:  # fmt: skip
        """Motions x and x' (nt, nv, m) under forces (nt, nv, m), by the midpoint rule.

        Args:
            held: of the first columns, the rates that undo the run's: without these coordinates it would be like this.
            balanced: whether it begins where the elastic coordinates are in balance; else, but for those held, at zero.
        """
        free, arm, last = self.free, self.scene.arm, len(self.run.t) - 1
        h, m, n = float(np.ptp(self.run.t)) / last, forces.shape[2], len(self.free)
        own = free < arm.nv
        M, D, K = self.matrices[:, :, free[:, None], free]
        before, after, stiff = M + 0.5 * h * D + 0.25 * h**2 * K, M - 0.5 * h * D - 0.25 * h**2 * K, h * K
        mine = free[own]
        at = np.array([arm.coordinate_of(int(i)) for i in mine])
        target, groups = -self.run.v[:, mine], [np.searchsorted(mine, list(some)) for some in held]
        elastic = [i for i, j in enumerate(mine) if keys(arm)[j][0] >= 0]
        x, v = np.zeros((2, n, m))
        for c in range(m if balanced else len(groups)):
            some = groups[c] if c < len(groups) else np.zeros(0, dtype=int)
            x[some, c] = -self.run.q[0, at[some]]
            others = np.array([i for i in elastic if i not in some] if balanced else [], dtype=int)
            push = forces[0, free[others], c] - K[0][np.ix_(others, some)] @ x[some, c]
            x[others, c] = np.linalg.lstsq(K[0][np.ix_(others, others)], push, rcond=None)[0]
        single = [c for c, some in enumerate(groups) if len(some) == 1]
        one, several = [groups[c][0] for c in single], [(c, some) for c, some in enumerate(groups) if len(some) > 1]
        out, pushed = np.zeros((2, *forces.shape)), np.zeros((last, n, m))
        out[0, 0, mine], pushed[:, own] = x[own], 0.5 * h * (forces[1:, mine] + forces[:-1, mine])
        with np.errstate(all="ignore"):
            for i, (first, end) in enumerate(zip(self.rows[:-1], self.rows[1:], strict=True)):
                part = ((np.arange(first, end) + 0.5 - first) / (end - first))[:, None, None]
                S, T, L = (X[i] + part * (X[i + 1] - X[i]) for X in (before, after, stiff))
                S = np.linalg.inv(S)
                for k in range(end - first):
                    new = S[k] @ (T[k] @ v - L[k] @ x + pushed[first + k])
                    if single:
                        lacks = target[first + k + 1, one] - new[one, single]
                        new[:, single] += S[k][:, one] * (lacks / S[k, one, one])
                    for c, some in several:
                        lacks = target[first + k + 1, some] - new[some, c]
                        new[:, c] += S[k][:, some] @ np.linalg.solve(S[k][np.ix_(some, some)], lacks)
                    x, v = x + 0.5 * h * (v + new), new
                    out[0, first + k + 1, mine], out[1, first + k + 1, mine] = x[own], v[own]
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


def shares(
    models: Models, rich: Model, result: Result, measure: Measure
) -> tuple[dict[tuple[int, int, int], float], float]:
    """What a run's quantity changes, over its span, by the force that it lacks on each further coordinate of a richer
    model, by (link, strain, number), and by all that it lacks: the motions of the richer arm under these."""
    scene, rows = models.at(rich, {}), some_rows(len(result.t), _ROWS)
    some, run = embed(result, result.arm, rows), embed(result, scene.arm, rows)
    lacking = acting_on(models, some, scene.arm) - forces(scene, run)
    own = set(keys(result.arm))
    new = {key: i for i, key in enumerate(keys(scene.arm)) if key not in own}
    each = np.zeros((*lacking.shape, len(new) + 1))
    each[:, list(new.values()), range(len(new))], each[:, :, -1] = lacking[:, list(new.values())], lacking
    x, size = Tangents(scene, run, _FEW).answers(each)[0], measure.sense(scene, run.q)
    return {key: size(x[:, :, k]) for k, key in enumerate(new)}, size(x[:, :, -1])
