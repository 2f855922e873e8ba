"""Signals over time: their values at other times, and by how much one comes later than another."""

import warnings
from typing import Any

import numpy as np

from .._check import Array

GAP = 2.5  # median steps: a longer one misses two samples or more
_ORDER, _SHARE = 8, 0.8  # of the low-pass before samples are thinned out: its order, its corner in the new Nyquist rate
_MOST = 10_000_000  # samples of an even grid


class DataWarning(UserWarning):
    """Data that tell less than they seem to: gaps in time, a constant signal, a lag that is not sure."""


def check_times(t: Array, place: Any) -> None:
    """ValueError where they do not increase; `place` says where a row is."""
    bad = np.flatnonzero(~(np.diff(t) > 0))
    if bad.size:
        k = int(bad[0]) + 1
        more = f" (and {bad.size - 1} times more)" if bad.size > 1 else ""
        raise ValueError(f"t must increase: {place(k)} has {t[k]:.9g} s after {t[k - 1]:.9g} s{more}")


def median_step(t: Array) -> float:
    """The usual time between two samples (s); nan of one sample."""
    return float(np.median(np.diff(t))) if len(t) > 1 else float("nan")


def gaps(t: Array) -> Array:
    """Begin and length (s) of each gap in time, (n, 2)."""
    steps = np.diff(t)
    at = np.flatnonzero(steps > GAP * np.median(steps)) if len(steps) else np.empty(0, int)
    return np.column_stack([t[at], steps[at]]) if len(at) else np.empty((0, 2))


def last_above(t: Array, y: Array, level: float) -> float:
    """The time after which |y| stays below a level, between two samples by a straight line; nan if it does not."""
    k = np.flatnonzero(np.abs(y) > level)
    if not k.size:
        return float(t[0])
    if k[-1] + 1 == len(t):
        return float("nan")
    a, b = np.abs(y[k[-1] : k[-1] + 2])
    return float(t[k[-1]] + (a - level) / (a - b) * (t[k[-1] + 1] - t[k[-1]]))


def at_times(t: Array, y: Array, new: Array, method: str) -> Array:
    """Columns y (nt, k) at new times within t, (n, k)."""
    from scipy.interpolate import CubicSpline

    if method == "cubic" and len(t) > 2:
        return np.asarray(CubicSpline(t, y)(new))
    return np.column_stack([np.interp(new, t, column) for column in y.T]) if y.shape[1] else np.empty((len(new), 0))


def even_times(first: float, last: float, step: float) -> Array:
    """first, first + step, ... up to last, which counts as reached within rounding."""
    count = np.floor((last - first) / step * (1 + 1e-12) + 1e-6) + 1
    if not count <= _MOST:
        raise ValueError(f"step = {step:g} s: makes {count:.3g} samples, above {_MOST:.0e}")
    return np.asarray(np.minimum(first + step * np.arange(int(count)), last))


def low_passed(t: Array, y: Array, step: float, method: str) -> tuple[Array, Array]:
    """The part of y (nt, k) that can be sampled each `step` s without being folded back, on even times: through a
    Butterworth low-pass run forward and backward, so that nothing comes later."""
    from scipy.signal import butter, sosfiltfilt

    span = float(t[-1] - t[0])
    h = span / max(1, round(span / median_step(t)))
    even = even_times(t[0], t[-1], h)
    rows = at_times(t, y, even, method)
    sections = butter(_ORDER, _SHARE * h / step, output="sos")
    room = min(len(even) - 1, int(3 * _ORDER * step / h))
    return even, np.asarray(sosfiltfilt(sections, rows, axis=0, padlen=room))


def _coefficients(a: Array, b: Array) -> tuple[Array, Array]:
    """Correlation coefficient of a[n + k] and b[n] over the rows that both have, and how many these are; for
    k = 1 - len(b) to len(a) - 1."""
    from scipy.signal import correlate

    def summed(x: Array, y: Array) -> Array:
        return np.asarray(correlate(x, y, method="fft"))

    ones_a, ones_b = np.ones_like(a), np.ones_like(b)
    n = np.maximum(np.round(summed(ones_a, ones_b)), 1)
    sum_a, sum_b = summed(a, ones_b), summed(ones_a, b)
    var_a = summed(a * a, ones_b) - sum_a**2 / n
    var_b = summed(ones_a, b * b) - sum_b**2 / n
    enough = (var_a > 1e-9 * a.var() * n) & (var_b > 1e-9 * b.var() * n)
    r = np.zeros(len(n))
    both = summed(a, b) - sum_a * sum_b / n
    r[enough] = both[enough] / np.sqrt(var_a[enough] * var_b[enough])
    return r, n


def lag(one: tuple[Array, Array], two: tuple[Array, Array], most: float | None) -> tuple[float, float]:
    """By how much (s) the first signal (t, y) comes later than the second, and their correlation then: the highest peak
    of the correlation coefficient over at least half of the shorter one; of peaks within 0.001 of it the one nearest to
    zero. Between samples, the second is interpolated by cubic splines.

    Raises:
        ValueError: no peak within `most` seconds.
    """
    from scipy.interpolate import CubicSpline
    from scipy.optimize import minimize_scalar

    h = min(median_step(one[0]), median_step(two[0]))
    grids = [even_times(t[0], t[-1], h) for t, _ in (one, two)]
    rows = [np.interp(g, t, y) for g, (t, y) in zip(grids, (one, two), strict=True)]
    a, b = (x - x.mean() for x in rows)
    r, n = _coefficients(a, b)
    lags = grids[0][0] - grids[1][0] + h * np.arange(1 - len(b), len(a))
    shorter = min(len(a), len(b))
    allowed = n >= max(3, shorter // 2)
    if most is not None:
        allowed &= np.abs(lags) <= most + 0.5 * h
    r = np.where(allowed, r, -2.0)
    inner = np.arange(1, len(r) - 1)
    peaks = inner[(r[inner] >= r[inner - 1]) & (r[inner] >= r[inner + 1]) & allowed[inner - 1] & allowed[inner + 1]]
    peaks = peaks[r[peaks] > 0]
    within = "over half of the shorter one" if most is None else f"within max_lag = {most:g} s"
    if not len(peaks):
        raise ValueError(f"no lag is found: their correlation has no peak {within}")
    near = peaks[r[peaks] >= r[peaks].max() - 1e-3]
    at = int(near[np.argmin(np.abs(lags[near]))])

    spline = CubicSpline(grids[1], rows[1])
    inside = (grids[0] - lags[at] - h >= grids[1][0]) & (grids[0] - lags[at] + h <= grids[1][-1])
    times, fixed = grids[0][inside], rows[0][inside]

    def unlike(more: float) -> float:
        moved = spline(times - lags[at] - more)
        return -float(np.corrcoef(fixed, moved)[0, 1])

    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = minimize_scalar(unlike, bounds=(-h, h), method="bounded", options={"xatol": 1e-5 * h})
    more = float(found.x) if np.isfinite(found.fun) else 0.0
    return float(lags[at]) + more, float(-found.fun if np.isfinite(found.fun) else r[at])
