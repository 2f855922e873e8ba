"""Motions with accelerations that are linear between equally spaced knots, from rest to rest."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from .._check import Array
from .response import Course
from .route import Route


@lru_cache(maxsize=8)
def integrals(n: int) -> tuple[Array, Array]:
    """Matrices (n + 1, n + 1) that give rates and positions at the knots of accelerations there, in the time from 0 to
    1, starting from rest."""
    rates = np.tril(np.full((n + 1, n + 1), 1.0))
    rates -= 0.5 * np.eye(n + 1)
    rates[:, 0] = 0.5
    rates[0] = 0.0
    steps = np.zeros((n, n + 1))
    k = np.arange(n)
    steps[k, k], steps[k, k + 1] = 1 / 3, 1 / 6
    places = np.zeros((n + 1, n + 1))
    places[1:] = np.cumsum(rates[:-1] + steps, axis=0)
    return rates / n, places / n**2


@dataclass(frozen=True)
class Profile:
    """z(t) of m numbers: the place on a route, or, without one, all joints.

    Attributes:
        duration: (s). alpha: d²z/d(t/duration)² at the knots, (N + 1, m), zero at both ends.
        start: (m,). route: None of free joints.
    """

    duration: float
    alpha: Array
    start: Array
    route: Route | None

    @property
    def t(self) -> Array:
        return np.linspace(0.0, self.duration, len(self.alpha))

    def z(self) -> tuple[Array, Array, Array]:
        """With its rates, at the knots, (N + 1, m) each."""
        rates, places = integrals(len(self.alpha) - 1)
        T = self.duration
        return self.start + places @ self.alpha, rates @ self.alpha / T, self.alpha / T**2

    def joints(self) -> tuple[Array, Array, Array]:
        """q, v, a at the knots, (N + 1, nj) each."""
        z, zd, zdd = self.z()
        return (z, zd, zdd) if self.route is None else self.route.motion(z[:, 0], zd[:, 0], zdd[:, 0])

    def course(self) -> Course:
        z, zd, zdd = self.z()
        if self.route is None:
            one, zero = (np.broadcast_to(x, (*z.shape, z.shape[1])) for x in (np.eye(z.shape[1]), 0.0))
            return Course(one, zero, zero, zero)
        _, d1, d2, d3 = self.route(z[:, 0])
        return Course(*(x[:, :, None] for x in (d1, d2 * zd, d3 * zd**2 + d2 * zdd, 2.0 * d2 * zd)))

    def by_alpha(self) -> tuple[Array, Array, Array]:
        """Derivatives of z and its rates at the knots by alpha, of all numbers one after the other at each inner knot,
        (N + 1, m, m (N - 1))."""
        n, m = len(self.alpha) - 1, self.alpha.shape[1]
        rates, places = integrals(n)
        T, each = self.duration, np.eye(m)
        parts = places, rates / T, np.eye(n + 1) / T**2
        return tuple(np.kron(x[:, 1:-1], each).reshape(n + 1, m, -1) for x in parts)  # type: ignore[return-value]
