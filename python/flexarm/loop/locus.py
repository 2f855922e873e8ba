"""Poles over a parameter, and the range in which a loop is stable."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from .._check import Array
from .._console import progress_bar
from ..data.draw.loop import plot_locus
from ..data.draw.style import Figure
from .hybrid import Complex
from .margins import first_crossing, stable

_DECADES, _EACH = 4, 24  # decades searched, and values in each

Poles = Callable[[float], Complex]


class Crossing(NamedTuple):
    """A pole on the stability boundary: the value of the parameter, and the pole's frequency (rad/s)."""

    value: float
    frequency: float


@dataclass(frozen=True)
class Locus:
    """A root locus.

    Attributes:
        over: the varied parameter. values: of it, (m,).
        poles: s (1/s), (m, n), each column one pole followed from value to value; nan if a loop has fewer.
        crossings: values between the first and the last at which the loop becomes unstable or stable.
    """

    over: str
    values: Array
    poles: Complex
    crossings: tuple[Crossing, ...]

    @property
    def stable(self) -> Array:
        """Whether the loop is stable at each value, (m,) of bool."""
        return np.array([stable(row[~np.isnan(row)]) for row in self.poles])

    def plot(self) -> Figure:
        """A figure of the poles in the s-plane, coloured by the parameter, and of their growth over it."""
        return plot_locus(self.over, self.values, self.poles, self.crossings)


class Limits(NamedTuple):
    """The range of a parameter in which a loop is stable.

    Attributes:
        over: the parameter. value: its present value.
        low, high: ends of the stable range about the value; 0 and inf if there is no limit within a factor of 10 000,
            or within the parameter's own range (a delay: up to 300 samples). If the loop is unstable: the nearest
            stable range, nan if there is none.
        frequencies: of the poles that cross at low and high (rad/s), nan without a limit.
        stable: whether the loop is stable at the value.
    """

    over: str
    value: float
    low: float
    high: float
    frequencies: tuple[float, float]
    stable: bool

    def __str__(self) -> str:
        subject = "the gains" if self.over == "gain" else self.over
        times = " times their value" if self.over == "gain" else ""
        if not np.isfinite(self.low) and not np.isfinite(self.high):
            return f"no {'share of ' if times else 'value of '}{subject} was found at which the loop is stable"
        bounds = [f"{side} {x:.4g}{times} (lost at {w:.4g} rad/s)" for side, x, w in
                  (("below", self.low, self.frequencies[0]), ("above", self.high, self.frequencies[1]))
                  if np.isfinite(w)]  # fmt: skip
        if not bounds:
            return f"{subject}: stable at every value that was tried, from a 10 000th to 10 000 times {self.value:.4g}"
        now = "stable" if self.stable else "unstable"
        is_now = "" if self.over == "gain" else f" (now {self.value:.4g}, {now})"
        return f"{subject}{is_now}: unstable {' and '.join(bounds)}"


def _matched(before: Complex, now: Complex) -> Complex:
    """The poles `now`, each in the column of the nearest pole `before`."""
    from scipy.optimize import linear_sum_assignment  # slow to import

    out = np.full(max(len(before), len(now)), np.nan + 0j)
    here, there = np.flatnonzero(np.isfinite(before)), np.flatnonzero(np.isfinite(now))
    gap = np.abs(before[here][:, None] - now[there])
    rows, columns = linear_sum_assignment(gap)
    out[here[rows]] = now[there[columns]]
    rest = np.setdiff1d(there, there[columns])
    out[np.flatnonzero(np.isnan(out))[: rest.size]] = now[rest]
    return out


def locus_of(poles: Poles, values: Array, over: str, progress: Any) -> Locus:
    """See ClosedLoop.locus."""
    rows: list[Complex] = []
    with progress_bar(progress, "following poles", values.size) as bar:
        for value in values:
            now = poles(float(value))
            now = np.where(np.isfinite(now), now, np.nan + 0j)
            rows.append(_matched(rows[-1], now) if rows else now)
            if bar is not None:
                bar(len(rows))
    most = max(len(row) for row in rows)
    whole = np.array([np.concatenate([row, np.full(most - len(row), np.nan + 0j)]) for row in rows])
    found, good = [], [stable(row[~np.isnan(row)]) for row in rows]
    for k in np.flatnonzero(np.diff(good)):
        crossing = first_crossing(poles, values[k : k + 2])
        if crossing is not None:
            found.append(Crossing(*crossing))
    return Locus(over, values, whole, tuple(found))


def _search_values(now: float, s: Complex) -> tuple[Array, Array]:
    """Trial values, downward and upward from the present one."""
    count = _DECADES * _EACH + 1
    if now:
        return now * np.geomspace(1.0, 10.0**-_DECADES, count), now * np.geomspace(1.0, 10.0**_DECADES, count)
    size = np.abs(s[np.isfinite(s)])
    scale = 1.0 / float(size[size > 0].min()) if (size > 0).any() else 1.0
    return np.zeros(1), np.concatenate([[0.0], scale * np.geomspace(1e-5, 10.0, 6 * _EACH)])


def limits_of(poles: Poles, now: float, over: str, s: Complex) -> Limits:
    """See ClosedLoop.limits."""
    nan, good = float("nan"), stable(s)
    down, up = _search_values(now, s)
    below, above = first_crossing(poles, down), first_crossing(poles, up)
    if good:
        low, high = below or (0.0, nan), above or (np.inf, nan)
        return Limits(over, now, low[0], high[0], (low[1], high[1]), True)
    ranges = []
    if below is not None:  # stable from there downward
        rest = down[down < below[0]]
        other = first_crossing(poles, np.concatenate([[below[0] * (1.0 - 1e-6)], rest]))
        ranges.append((other or (0.0, nan), below))
    if above is not None:
        rest = up[up > above[0]]
        other = first_crossing(poles, np.concatenate([[above[0] * (1.0 + 1e-6)], rest]))
        ranges.append((above, other or (np.inf, nan)))
    if not ranges:
        return Limits(over, now, nan, nan, (nan, nan), False)
    low, high = min(ranges, key=lambda r: min(abs(np.log(max(x[0], 1e-300) / (now or 1.0))) for x in r))
    return Limits(over, now, low[0], high[0], (low[1], high[1]), False)
