"""The route of the joints: a straight line between two poses, or a path, by one number from 0 to 1."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..._check import Array, array

_SAMPLES = 401  # of a path that is a function
_JUMP = 20.0  # a chord longer than this, in medians of all chords, is a jump


class Route:
    """Joint positions q(s), s from 0 to 1, with three derivatives; a spline of degree five through samples at chord
    lengths, or the straight line between two.

    Args:
        points: (n, nj), n at least 2.
    """

    def __init__(self, points: Array) -> None:
        from scipy.interpolate import make_interp_spline  # slow to import

        chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
        points = points[np.append(True, chords > 1e-9 * chords.sum())]  # without duplicates
        chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
        at = np.append(0.0, np.cumsum(chords)) / chords.sum()
        at[-1] = 1.0
        self.straight = len(points) == 2
        self.start, self.end = points[0], points[-1]
        self._spline = make_interp_spline(at, points, k=min(5, len(points) - 1))

    def __call__(self, s: Any) -> tuple[Array, Array, Array, Array]:
        """q, dq/ds and two more derivatives, each (..., nj). The curve extends a little beyond both ends."""
        q, d1, d2, d3 = (self._spline(s, n) for n in range(4))
        return q, d1, d2, d3

    def motion(self, s: Array, ds: Array, dds: Array) -> tuple[Array, Array, Array]:
        """q, v and a of the joints (n, nj) of s and its rates (n,)."""
        q, d1, d2, _ = self(s)
        return q, d1 * ds[:, None], d1 * dds[:, None] + d2 * (ds**2)[:, None]


def path_points(path: Any, joints: int, names: list[str]) -> Array:
    """Samples (n, nj) of a path: of an array of them, or of a function of s from 0 to 1.

    Raises:
        ValueError: wrong shapes, a path that jumps, or one that does not move.
    """
    points = _sampled(path, joints, _SAMPLES) if callable(path) else array("path", path)
    if points.ndim != 2 or points.shape[1] != joints or len(points) < 2:
        raise ValueError(
            f"path has shape {points.shape}: must have at least two rows of {joints} joint positions "
            f"({', '.join(names)}), or be a function of s from 0 to 1 that gives one"
        )
    steps = np.abs(np.diff(points, axis=0))
    if not steps.any():
        raise ValueError("path: does not move")
    if callable(path):
        _check_function(path, joints, steps)
    else:
        _check_chords(points)
    return points


def _sampled(path: Callable[[float], Any], joints: int, count: int) -> Array:
    return np.array([array(f"path({s:g})", path(float(s)), (joints,)) for s in np.linspace(0.0, 1.0, count)])


def _check_function(path: Callable[[float], Any], joints: int, steps: Array) -> None:
    """ValueError where steps of half the size do not halve the longest."""
    finer = np.abs(np.diff(_sampled(path, joints, 2 * _SAMPLES - 1), axis=0))
    k, j = np.unravel_index(int(finer.argmax()), finer.shape)
    if finer[k, j] > 0.8 * steps.max() and finer[k, j] > 1e-9:
        raise ValueError(f"path: jumps by {finer[k, j]:.4g} (rad, m) at s = {(k + 0.5) / len(finer):.4g}")


def _check_chords(points: Array) -> None:
    """ValueError for a chord far longer than the others."""
    chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
    k, middle = int(chords.argmax()), float(np.median(chords[chords > 0.0]))
    if len(chords) >= 4 and chords[k] > _JUMP * middle:
        raise ValueError(
            f"path: jumps by {chords[k]:.4g} (rad, m) from row {k} to {k + 1}, where rows are {middle:.4g} apart; give "
            "it closer samples there"
        )
