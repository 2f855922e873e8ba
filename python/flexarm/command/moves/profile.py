"""Motions with accelerations that are linear between equally spaced knots, from rest to rest."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..._check import Array
from .route import Route


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
    """z(t) of m numbers: the place on a route, or all joints.

    Attributes:
        duration: (s). alpha: d²z/d(t/duration)² at the knots, (N + 1, m), zero at both ends.
        start: (m,). route: None for independent joints.
        fine: places in each interval between knots, P - 1 in all.
    """

    duration: float
    alpha: Array
    start: Array
    route: Route | None
    fine: int = 1

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
