"""Equations in time on an even, periodic grid: differences of eighth order, a banded solve, an iteration.

A solution that is bounded for all times, of equations with stable and unstable parts, is the periodic one of a window
that is long enough for both to die out: the unstable part backwards in time (Bayo 1987; Devasia, Chen and Paden 1996).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..._check import Array

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
