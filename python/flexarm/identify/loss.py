"""Losses that outliers do not rule: of residuals r in units of the noise, sum of c^2 rho((r / c)^2) in place of r^2."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from .._check import Array

_NORMAL = 1.4826  # standard deviation of normal noise over its median |r|


class Loss(NamedTuple):
    """A loss, as SciPy's `least_squares` names it.

    Attributes:
        name: of it. c: residuals of this many standard deviations begin to count less: normal noise costs 5 % of the
            information (Huber, Robust Statistics, 1981). rho, first, second: of z = (r / c)^2, and its derivatives.
    """

    name: str
    c: float
    rho: Callable[[Array], Array]
    first: Callable[[Array], Array]
    second: Callable[[Array], Array]

    def rooted(self, r: Array) -> Array:
        """Residuals whose squares are the losses of r."""
        return np.asarray(np.sign(r) * self.c * np.sqrt(self.rho((r / self.c) ** 2)))

    def slope(self, r: Array) -> Array:
        """Derivative of `rooted`."""
        s = self.rooted(r)
        return np.where(s == 0.0, 1.0, self.pull(r) / np.where(s == 0.0, 1.0, s))

    def pull(self, r: Array) -> Array:
        """Half the derivative of the loss: r, less where r is large."""
        return np.asarray(r * self.first((r / self.c) ** 2))

    def spread(self, r: Array) -> tuple[float, float]:
        """Means of the derivative of `pull`, and of its square."""
        z = (r / self.c) ** 2
        return float(np.mean(self.first(z) + 2 * z * self.second(z))), float(np.mean(self.pull(r) ** 2))


def _beyond(z: Array) -> Array:
    return np.maximum(z, 1.0)


LOSSES = {
    "soft_l1": Loss("soft_l1", 1.287, lambda z: 2 * z / (np.sqrt(1 + z) + 1), lambda z: (1 + z) ** -0.5,
                    lambda z: -0.5 * (1 + z) ** -1.5),
    "huber": Loss("huber", 1.345, lambda z: np.where(z < 1, z, 2 * _beyond(z) ** 0.5 - 1), lambda z: _beyond(z) ** -0.5,
                  lambda z: np.where(z < 1, 0.0, -0.5 * _beyond(z) ** -1.5)),
    "cauchy": Loss("cauchy", 2.385, np.log1p, lambda z: 1 / (1 + z), lambda z: -1 / (1 + z) ** 2),
}  # fmt: skip


def deviation(r: Array) -> float:
    """Standard deviation of normal residuals, some of which are outliers: by the median of |r|."""
    return _NORMAL * float(np.median(np.abs(r)))
