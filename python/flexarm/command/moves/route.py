"""The motion of the joints: a route, by one number from 0 to 1, and profiles over time."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
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


@lru_cache(maxsize=8)
def integrals(knots: int, fine: int = 1) -> tuple[Array, Array, Array]:
    """Matrices (P, knots + 1) that give positions, rates and accelerations at P = fine knots + 1 places from
    accelerations at the knots, in the time from 0 to 1, starting from rest."""
    n = knots * fine
    here = np.maximum(0.0, 1.0 - np.abs(np.arange(n + 1)[:, None] / fine - np.arange(knots + 1)))
    rates = np.tril(np.ones((n + 1, n + 1))) - 0.5 * np.eye(n + 1)
    rates[:, 0] = 0.5
    rates[0] = 0.0
    k, steps = np.arange(n), np.zeros((n, n + 1))
    steps[k, k], steps[k, k + 1] = 1 / 3, 1 / 6
    places = np.zeros((n + 1, n + 1))
    places[1:] = np.cumsum(rates[:-1] + steps, axis=0)
    return places @ here / n**2, rates @ here / n, here


@dataclass(frozen=True)
class Profile:
    """z(t) of m numbers: the place on a route, or all joints."""

    duration: float  #: (s)
    alpha: Array  #: d²z/d(t/duration)² at the knots, (N + 1, m), zero at both ends
    start: Array  #: (m,)
    route: Route | None  #: None for independent joints
    fine: int = 1  #: places in each interval between knots, P - 1 in all

    @property
    def t(self) -> Array:
        """Times of the places, (P,)."""
        return np.linspace(0.0, self.duration, (len(self.alpha) - 1) * self.fine + 1)

    def z(self) -> tuple[Array, Array, Array]:
        """z and its two rates, at the places, (P, m) each."""
        places, rates, here = integrals(len(self.alpha) - 1, self.fine)
        T = self.duration
        return self.start + places @ self.alpha, rates @ self.alpha / T, here @ self.alpha / T**2

    def joints(self) -> tuple[Array, Array, Array]:
        """q, v, a at the places, (P, nj) each."""
        z, zd, zdd = self.z()
        return (z, zd, zdd) if self.route is None else self.route.motion(z[:, 0], zd[:, 0], zdd[:, 0])

    def by_alpha(self) -> tuple[Array, Array, Array]:
        """Derivatives of z and its rates at the places by alpha, of all numbers one after the other at each inner knot,
        (P, m, m (N - 1))."""
        m, T = self.alpha.shape[1], self.duration
        places, rates, here = integrals(len(self.alpha) - 1, self.fine)
        parts = places, rates / T, here / T**2
        each = np.eye(m)
        return tuple(np.kron(x[:, 1:-1], each).reshape(len(x), m, -1) for x in parts)  # type: ignore[return-value]

    def slopes(self) -> tuple[Array, Array, Array]:
        """Derivatives of q, v, a of the joints at the places by alpha, as `by_alpha`, (P, nj, m (N - 1))."""
        by_s, by_ds, by_dds = own = self.by_alpha()
        if self.route is None:
            return own
        s, ds, dds = (x[:, :, None] for x in self.z())
        _, d1, d2, d3 = (x[:, :, None] for x in self.route(s[:, 0, 0]))
        by_v = d2 * ds @ by_s + d1 @ by_ds
        by_a = (d3 * ds**2 + d2 * dds) @ by_s + 2.0 * d2 * ds @ by_ds + d1 @ by_dds
        return d1 @ by_s, by_v, by_a
