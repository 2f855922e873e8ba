"""Equations in time on an even, periodic grid: differences of eighth order, a banded solve, an iteration.

A solution that is bounded for all times, of equations with stable and unstable parts, is the periodic one of a window
that is long enough for both to die out: the unstable part backwards in time (Bayo 1987; Devasia, Chen and Paden 1996).
"""

from __future__ import annotations

from collections.abc import Callable
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

    M, C, K: functions of the node that give matrices (k, k)."""

    def __init__(self, n: int, h: float, matrices: Callable[[int], tuple[Array, Array, Array]]) -> None:
        self._n, self._below, self._inverse, self._above, self._last = n, [], [], [], []  # type: ignore[var-annotated]
        parts = []
        for k in range(n):
            M, C, K = matrices(k)
            M, C = M / h**2, C / (2 * h)
            # the node's blocks in the rows of its right neighbour, its own, and its left neighbour
            parts.append((M - C + _SHARE * K, (1 - 2 * _SHARE) * K - 2 * M, M + C + _SHARE * K))
        for k in range(n):
            below, centre, above = parts[k - 1][0], parts[k][1], parts[(k + 1) % n][2]
            self._below.append(below)
            if k == n - 1:
                break
            last = below if k == 0 else -below @ self._last[-1]
            if k > 0:
                centre = centre - below @ self._above[-1]
            if k == n - 2:
                last = last + above
            inverse = np.linalg.inv(centre)
            self._inverse.append(inverse)
            self._above.append(inverse @ above)
            self._last.append(inverse @ last)
        for k in range(n - 3, -1, -1):
            self._last[k] = self._last[k] - self._above[k] @ self._last[k + 1]
        self._closing = above
        self._corner = np.linalg.inv(centre - below @ self._last[n - 2] - above @ self._last[0])
        self._stacked = np.array(self._last)

    def solve(self, r: Array) -> Array:
        """d (n, k) of r (n, k)."""
        n, x = self._n, np.empty_like(r)
        r = _SHARE * (np.roll(r, 1, 0) + np.roll(r, -1, 0)) + (1 - 2 * _SHARE) * r
        x[0] = self._inverse[0] @ r[0]
        for k in range(1, n - 1):
            x[k] = self._inverse[k] @ (r[k] - self._below[k] @ x[k - 1])
        for k in range(n - 3, -1, -1):
            x[k] -= self._above[k] @ x[k + 1]
        x[n - 1] = self._corner @ (r[n - 1] - self._below[n - 1] @ x[n - 2] - self._closing @ x[0])
        x[: n - 1] -= self._stacked @ x[n - 1]
        return x


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
