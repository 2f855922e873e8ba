"""Whether an integrator has stepped over a pulse of a callable."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .._check import Array

_PART = 0.2  # parts of all that a callable does, from which on a departure counts
_OWN = 3.0  # parts of what it does around, below which a departure is but curvature


class PulseWarning(UserWarning):
    """A callable does something between two steps that the integrator has not seen.

    Attributes:
        time: where (s). value: the callable's there. seen: its values at the times next to it that were asked for.
    """

    def __init__(self, message: str, time: float, value: float, seen: tuple[float, float]) -> None:
        super().__init__(message)
        self.time, self.value, self.seen = time, value, seen

    def __reduce__(self) -> Any:
        return type(self), (str(self), self.time, self.value, self.seen)


def missed(where: str, law: Callable[[float], Any], asked: Array, begin: float, end: float) -> PulseWarning | None:
    """Asks a law where a run has not, in equal parts from `begin` to `end`, and compares.

    Args:
        asked: the run's last call in each part: time and values, (n, 1 + k); a time of nan where there was none.
    """
    parts = len(asked)
    calls = asked[np.isfinite(asked[:, 0])]
    if len(calls) < 4:
        return None
    empty = np.flatnonzero(~np.isfinite(asked[:, 0]))
    times = begin + (empty + 0.5) * (end - begin) / parts
    times = times[(times > calls[1, 0]) & (times < calls[-2, 0])]
    if not times.size:
        return None
    try:
        values = np.array([np.ravel(law(float(t))) for t in times])
    except Exception:  # the run is done: a law that cannot be asked twice does not spoil it
        return None
    right = np.clip(np.searchsorted(calls[:, 0], times), 2, len(calls) - 2)
    before, after = calls[right - 1], calls[right]
    share = ((times - before[:, 0]) / (after[:, 0] - before[:, 0]))[:, None]
    off = np.abs(values - (before[:, 1:] + share * (after - before)[:, 1:]))
    around = np.stack([calls[right + k, 1:] for k in (-2, -1, 0, 1)])
    lowest, highest = (f(np.vstack([calls[:, 1:], values]), axis=0) for f in (np.min, np.max))
    limit = np.maximum(_PART * (highest - lowest), _OWN * np.ptp(around, axis=0))
    beyond = np.where(highest > lowest, off - limit, -1.0)
    if not (beyond > 0.0).any():
        return None
    i, j = np.unravel_index(int(np.argmax(beyond)), beyond.shape)
    value, seen = float(values[i, j]), (float(before[i, 1 + j]), float(after[i, 1 + j]))
    return PulseWarning(
        f"{where} is {value:.4g} at t = {times[i]:.6g} s; the steps passed that by, and saw {seen[0]:.4g} at "
        f"{before[i, 0]:.6g} s and {seen[1]:.4g} at {after[i, 0]:.6g} s; give samples, which steps end at, or output "
        "times that lie closer there",
        float(times[i]), value, seen,
    )  # fmt: skip
