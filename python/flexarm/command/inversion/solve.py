"""Solves the equations of an inversion in time, on an even, periodic grid: differences of eighth order, a banded solve,
an iteration.

A solution that is bounded for all times, of equations with stable and unstable parts, is the periodic one of a window
that is long enough for both to die out: the unstable part backwards in time (Bayo 1987; Devasia, Chen and Paden 1996).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..._check import Array
from .equations import REACHED, Equations, Poses
from .path import Path

_FIRST = (4 / 5, -1 / 5, 4 / 105, -1 / 280)  # differences of eighth order, to the right
_SECOND = (8 / 5, -1 / 5, 8 / 315, -1 / 560)
_SHARE = 0.1  # of either neighbour's forces: brings the compact differences nearest to eighth order
_CENTRE = -205 / 72
_BETWEEN = (1225 / 2048, -245 / 2048, 49 / 2048, -5 / 2048)  # values halfway, from four on either side


def rates(d: Array, h: float) -> tuple[Array, Array]:
    """First and second derivatives of samples (n, k) on a periodic grid of step h."""
    n = len(d)
    wide = np.concatenate([d[-4:], d, d[:4]])
    v, a = np.zeros_like(d), _CENTRE * d
    for j, (first, second) in enumerate(zip(_FIRST, _SECOND, strict=True), start=1):
        right, left = wide[4 + j : 4 + j + n], wide[4 - j : 4 - j + n]
        v += first * (right - left)
        a += second * (right + left)
    return v / h, a / h**2


def halfway(d: Array) -> Array:
    """Values halfway between each sample and the next, (n, k)."""
    n = len(d)
    wide = np.concatenate([d[-3:], d, d[:4]])
    return np.asarray(sum(w * (wide[3 - j : 3 - j + n] + wide[4 + j : 4 + j + n]) for j, w in enumerate(_BETWEEN)))


class Banded:
    """Solves M d'' + C d' + K d = r by compact differences (Numerov's): block tridiagonal, periodic.

    M, C, K: (n, k, k), at the nodes. h: step between them."""

    def __init__(self, h: float, M: Array, C: Array, K: Array) -> None:
        from scipy.sparse import coo_array  # slow to import
        from scipy.sparse.linalg import splu

        M, C, (n, size, _) = M / h**2, C / (2 * h), M.shape
        # each node's blocks in the rows of its right neighbour, its own, and its left neighbour
        blocks = np.stack([M - C + _SHARE * K, (1 - 2 * _SHARE) * K - 2 * M, M + C + _SHARE * K])
        node, inside = np.arange(n), np.arange(size)
        rows = size * ((node + np.array([[1], [0], [-1]])) % n)[..., None, None] + inside[:, None]
        columns = size * node[:, None, None] + inside
        places = np.broadcast_to(rows, blocks.shape).ravel(), np.broadcast_to(columns, blocks.shape).ravel()
        self._factors = splu(coo_array((blocks.ravel(), places), shape=(n * size, n * size)).tocsc())

    def solve(self, r: Array) -> Array:
        """d (n, k) of r (n, k)."""
        r = _SHARE * (np.roll(r, 1, 0) + np.roll(r, -1, 0)) + (1 - 2 * _SHARE) * r
        return np.asarray(self._factors.solve(r.ravel())).reshape(r.shape)


class Mixing:
    """Anderson's acceleration of x <- x + f(x) (D. G. Anderson, J. ACM 12 (1965), 547-560)."""

    def __init__(self, depth: int = 60) -> None:
        self._depth = depth
        self._x: list[Any] = []
        self._f: list[Any] = []

    def __call__(self, x: Array, f: Array) -> Array:
        """The next x, of the same shape."""
        self._x = [*self._x[-self._depth :], x.ravel()]
        self._f = [*self._f[-self._depth :], f.ravel()]
        moved, changed = np.diff(self._x, axis=0), np.diff(self._f, axis=0)
        step = self._f[-1]
        if len(changed):
            gram = changed @ changed.T
            scale = 1 / np.sqrt(np.maximum(np.diag(gram), 1e-300))
            gram = gram * np.outer(scale, scale)
            weights = scale * np.linalg.lstsq(gram, scale * (changed @ step), rcond=1e-14)[0]
            step = step - (moved + changed).T @ weights
        return np.asarray(self._x[-1] + step).reshape(x.shape)


_ITERATIONS = 60
_PATIENCE = 10  # iterations without gain
_RENEWALS = 3  # of the matrices, if the iteration does not converge
DECAY = 40.0  # twice the natural logarithm of the buffer's damping of ringing modes
MOST = 6000  # intervals over the path, with those before and after it


class NotConverged(ValueError):
    """The iteration did not converge."""


@dataclass
class Motions:
    """A motion found: rows at times t; `error`: largest distance of the tip from the path halfway between rows (m,
    rad), estimated from the equations' residual; `edge`: distance from rest at the window's ends."""

    t: Array
    q: Array
    v: Array
    a: Array
    tau: Array
    step: float
    error: float
    edges: list[float]
    iterations: int


class Grid:
    """Even times from `before` intervals ahead of the path to `after` behind it, and a smooth reference from the pose
    at the start to that at the end; the motion differs from it by a periodic part.

    They are followed by `buffer` intervals with added damping, in which ringing after the path dies out before the
    window begins anew; these are not in the result.

    Attributes:
        n, keep: rows with the buffer, and without. damping: of these rows, in parts of the inertia (1/s), (n,).
    """

    def __init__(self, path: Path, poses: Poses, count: int, before: int, after: int, buffer: int) -> None:
        self.path, self.step = path, (path.end - path.begin) / count
        self.keep = before + count + after + 1
        self.n = self.keep + buffer
        self.t: Array = np.asarray(path.begin + self.step * np.arange(-before, self.n - before), dtype=float)
        place = np.arange(1, buffer + 1) / (buffer + 1)
        length = max(buffer, 1) * self.step
        self.damping = np.concatenate([np.zeros(self.keep), DECAY / length * 2 * np.sin(np.pi * place) ** 2])
        self.wanted = path(self.t)
        self._ends, self._T = (poses.q[0], poses.q[-1]), path.end - path.begin
        self.way, self.rate, self.acceleration = self.reference(self.t)

    def reference(self, t: Array) -> tuple[Array, Array, Array]:
        """A smooth step from the start to the end, with six continuous derivatives."""
        bell = np.polynomial.Polynomial([0, 1]) ** 6 * np.polynomial.Polynomial([1, -1]) ** 6
        total = bell.integ()(1.0)
        x, change = np.clip((t - self.path.begin) / self._T, 0.0, 1.0), self._ends[1] - self._ends[0]
        ways = [p(x) / total / self._T**k for k, p in enumerate((bell.integ(), bell, bell.deriv()))]
        q, v, a = (np.outer(way, change) for way in ways)
        return self._ends[0] + q, v, a

    def motion(self, q: Array) -> tuple[Array, Array]:
        v, a = rates(q - self.way, self.step)
        return v + self.rate, a + self.acceleration


class Solver:
    """Solves on successively finer grids, each from the solution before."""

    def __init__(self, equations: Equations, path: Path, poses: Poses) -> None:
        self.equations, self.path, self.poses = equations, path, poses
        self._last: Banded | None = None  # the factor last used
        self._at, self._matrices = poses.t, tuple[Array, ...]()  # M, C and K along the path, and their times
        ends, still = poses.q[[0, -1]], np.zeros((2, equations.arm.nv))
        #: M, C, K at rest, at the start and at the end
        self.ends = equations.matrices(poses.t[[0, -1]], ends, still, still)
        self._inertia = self.ends[0][1]

    def first_guess(self, grid: Grid) -> Array:
        from scipy.interpolate import make_interp_spline  # slow to import

        rest = [(1, np.zeros(self.equations.arm.nq)), (2, np.zeros(self.equations.arm.nq))]
        spline = make_interp_spline(self.poses.t, self.poses.q, k=5, bc_type=(rest, rest))
        return np.asarray(spline(np.clip(grid.t, self.path.begin, self.path.end)))

    def refined(self, grid: Grid, found: Motions) -> Array:
        """A solution on another grid, interpolated."""
        from scipy.interpolate import make_interp_spline  # slow to import

        return np.asarray(make_interp_spline(found.t, found.q, k=5)(np.clip(grid.t, found.t[0], found.t[-1])))

    def still(self, grid: Grid, q: Array) -> Motions:
        """Equilibrium with gravity at each time of the grid, from a guess q."""
        near = self.first_guess(grid)[:, self.equations.joints]
        q, off = self.equations.on_path(q, grid.wanted, near)
        self._check_path(grid, off)
        if not len(self.equations.inner):
            return self._motions(grid, q, 0, 0.0)
        zero, inner = np.zeros_like(q), self.equations.inner
        K = np.array([self.equations.stiffness(x) for x in self.poses.q])
        pose = np.abs(grid.t[:, None] - self.poses.t).argmin(axis=1)
        iteration, step = 0, np.full(1, np.inf)
        while np.abs(step).max() > 1e-12 * max(1.0, float(np.abs(q[:, inner]).max())) and iteration < _ITERATIONS:
            r = self.equations.arm._core.inverse_dynamics(q, zero, zero)[:, inner]
            step = -np.linalg.solve(K[pose], r[..., None])[..., 0]
            q[:, inner] += step
            q, off = self.equations.on_path(q, grid.wanted, near)
            iteration += 1
        self._check_path(grid, off)
        if iteration == _ITERATIONS:
            raise NotConverged("tip: no balance with gravity was found along the path; the arm may be too soft")
        return self._motions(grid, q, iteration, 0.0)

    def solve(self, grid: Grid, q: Array, tolerance: float) -> Motions:
        """The motion on the grid, from a guess q.

        Raises:
            NotConverged: (a ValueError)"""
        near = self.first_guess(grid)[:, self.equations.joints]
        q, off = self.equations.on_path(q, grid.wanted, near)
        self._check_path(grid, off)
        if not self.equations.elastic or not len(self.equations.inner):
            return self._motions(grid, q, 0, 0.0)
        inner, done, last, best_q = self.equations.inner, 0, np.inf, q
        for renewal in range(_RENEWALS + 1):
            if not self._matrices or renewal:
                self._renew(grid, q, renewal)
            try:
                solver = self._last = Banded(grid.step, *self._between(grid))
            except RuntimeError:  # singular
                break
            mixing, best, since = Mixing(), np.inf, 0
            for k in range(_ITERATIONS):
                done += 1
                self.equations.tell(f"{grid.n} rows, iteration {done}")
                v, a = grid.motion(q)
                r = self.equations.arm._core.inverse_dynamics(q, v, a)[:, inner]
                r[grid.keep :] += grid.damping[grid.keep :, None] * (v[grid.keep :][:, inner] @ self._inertia.T)
                if not np.isfinite(r).all():
                    break
                f = -solver.solve(r)
                T, direct = self.equations.follow(q)
                last = _size(direct, f)
                if last <= 0.05 * tolerance:
                    return self._motions(grid, q, done, last)
                since = k if last < 0.7 * best else since
                if not last < 1e3 * best or k > since + _PATIENCE:
                    break
                if last < best:
                    best, best_q = last, q
                moved = mixing(q[:, inner], f) - q[:, inner]
                q = q.copy()
                q[:, inner] += moved
                q[:, self.equations.joints] += np.einsum("nmk,nk->nm", T, moved)
                q, off = self.equations.on_path(q, grid.wanted, near)
                if not off.max() <= REACHED * max(1.0, self.equations.length):
                    break
            q = best_q
        raise NotConverged(
            f"tip: the iteration did not converge in {done} steps (last change of the tip {last:.3g} m); try a slower "
            "or smoother path, one that stays farther from singular poses, or another posture"
        )

    def _check_path(self, grid: Grid, off: Array) -> None:
        if not off.max() <= REACHED * max(1.0, self.equations.length):
            k = int(off.argmax())
            raise ValueError(self.equations.unreached(grid.t[k], float(off[k]), grid.wanted[k]))

    def _renew(self, grid: Grid, q: Array, renewal: int) -> None:
        """Computes the matrices along the motion, at some of its times; at more of them from the second time on."""
        v, a = grid.motion(q)
        inside = np.flatnonzero((grid.t > self.path.begin - 1e-9) & (grid.t < self.path.end + 1e-9))
        first = int(np.clip(1300 // len(self.equations.inner), 17, 65))
        count = min(len(inside), (first, 65, 257, 257)[renewal])
        rows = inside[np.unique(np.linspace(0, len(inside) - 1, count).round().astype(int))]
        self._at = grid.t[rows]
        self._matrices = self.equations.matrices(self._at, q[rows], v[rows], a[rows])

    def _between(self, grid: Grid) -> tuple[Array, Array, Array]:
        """M, C, K (n, k, k) at the nodes, straight between the times at which they are known."""
        at, t = self._at, np.clip(grid.t, self._at[0], self._at[-1])
        left = np.clip(np.searchsorted(at, t, side="right") - 1, 0, len(at) - 2)
        share = ((t - at[left]) / (at[left + 1] - at[left]))[:, None, None]
        M, C, K = ((1 - share) * X[left] + share * X[left + 1] for X in self._matrices)
        return M, C + grid.damping[:, None, None] * self._inertia, K

    def _motions(self, grid: Grid, q: Array, iterations: int, residual: float) -> Motions:
        v, a = grid.motion(q)
        tau = self.equations.arm._core.inverse_dynamics(q, v, a)
        edges, end = [0.0], grid.keep
        if self.equations.elastic and len(self.equations.inner) and self._matrices:
            edges = [self._distance_from_rest(side, q[k], v[k]) for side, k in ((0, 0), (-1, end - 1))]
        error = max(self._halfway(grid, q), residual)
        return Motions(grid.t[:end], q[:end], v[:end], a[:end], tau[:end], grid.step, error, edges, iterations)

    def _distance_from_rest(self, side: int, q: Array, v: Array) -> float:
        """Distance of the arm from rest at one end of the window (side 0 or -1): from its pose, and by its rates over
        the frequency of its slowest inner mode."""
        equations = self.equations
        M, _, K = (X[side] for X in self._matrices)
        slowest = np.sqrt(np.abs(np.linalg.eigvals(np.linalg.solve(M, K))).min())
        parts = [q - self.poses.q[side]] + ([v / slowest] if slowest > 0 else [])
        return float(np.linalg.norm([equations.moved(q, d) for d in parts]))

    def _halfway(self, grid: Grid, q: Array) -> float:
        d = q - grid.way
        d_rates = rates(d, grid.step)
        t: Array = np.asarray(grid.t + 0.5 * grid.step, dtype=float)
        way = grid.reference(t)
        at, v, a = (halfway(x) + w for x, w in zip((d, *d_rates), way, strict=True))
        off = np.abs(self.equations.output.error(at, self.path(t)))
        if self.equations.elastic and len(self.equations.inner) and self._matrices:
            r = self.equations.arm._core.inverse_dynamics(at, v, a)[:, self.equations.inner]
            r[grid.keep - 1 :] = 0.0
            assert self._last is not None
            K, left = self._matrices[2], np.clip(np.searchsorted(self._at, t) - 1, 0, len(self._at) - 1)
            sag = np.linalg.solve(K[left], r[..., None])[..., 0]
            direct = self.equations.follow(at)[1]
            moves = [np.abs(np.einsum("npk,nk->np", direct, d)) for d in (self._last.solve(r), sag)]
            off = off + min(moves, key=np.max)
        return float(off[: grid.keep - 1].max())


def _size(direct: Array, f: Array) -> float:
    """Size of changes f (n, k) of the inner coordinates: the output's displacement with the joints held, by direct
    (n, p, k), or a hundredth of the largest change, if that is more."""
    seen = float(np.abs(np.einsum("npk,nk->np", direct, f)).max())
    return max(seen, 1e-2 * float(np.abs(f).max()))
