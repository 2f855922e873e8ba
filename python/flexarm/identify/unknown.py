"""Unknown numbers of a scene by their dotted paths, each with a start, bounds and prior knowledge."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from .._check import Array, finite_number, number, positive
from ..arm.variation import Setup, Variation, numbered, value_at

_FACTOR = 3.0  # range of random starts without bounds, as a factor


@dataclass(frozen=True)
class Unknown:
    """An unknown number of a scene, for `fa.identify`.

    Args:
        start: start of the search; None: the scene's value.
        low, high: bounds. A quantity that must not be negative, such as a stiffness, has the lower bound 0 by itself.
        mean, std: prior knowledge: a mean and a standard deviation. Give both or neither.
        log: whether the logarithm is fitted: steps are then factors, and the interval is asymmetric about the value.
            None: for positive quantities (a modulus, a length), but not for those that may be zero (a friction).
        each_run: whether each run has its own value; None: only initial states (q0.K, v0.K).
    """

    start: float | None = None
    low: float = -np.inf
    high: float = np.inf
    mean: float | None = None
    std: float | None = None
    log: bool | None = None
    each_run: bool | None = None

    def __post_init__(self) -> None:
        for name in ("start", "low", "high", "mean", "std"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, number(name, value))
        if not self.low < self.high:
            raise ValueError(f"low = {self.low:g}, high = {self.high:g}: low must be below high")
        if self.start is not None and not (np.isfinite(self.start) and self.low <= self.start <= self.high):
            raise ValueError(f"start = {self.start:g}: must be within the bounds, {self.low:g} to {self.high:g}")
        if (self.mean is None) != (self.std is None):
            raise ValueError(f"mean = {self.mean}, std = {self.std}: a prior needs both")
        if self.mean is not None:
            positive("std", self.std)
            finite_number("mean", self.mean)
        for name in ("log", "each_run"):
            if getattr(self, name) not in (None, True, False):
                raise ValueError(f"{name} = {getattr(self, name)!r}: must be True, False or None")


class Sought(NamedTuple):
    """One unknown number of the fit.

    Attributes:
        name: its path, or "run K: path". path: in the scene. run: the run it belongs to, or None. of: as requested,
            with start and bounds filled in.
    """

    name: str
    path: str
    run: int | None
    of: Unknown

    @property
    def log(self) -> bool:
        return bool(self.of.log)

    @property
    def scale(self) -> float:
        """The divisor of a number that is not fitted by its logarithm."""
        assert self.of.start is not None
        if self.log:
            return 1.0
        finite = [x for x in (self.of.low, self.of.high) if np.isfinite(x) and x]
        return abs(self.of.start) or self.of.std or (max(map(abs, finite)) if finite else 1.0)

    def inner(self, value: float) -> float:
        """The inner value of the search: the logarithm or the scaled value."""
        if self.log:
            return float(np.log(value)) if value > 0 else -np.inf
        return value / self.scale

    @property
    def bounds(self) -> tuple[float, float]:
        """Of the inner value."""
        low, high = self.of.low, self.of.high
        return self.inner(low) if np.isfinite(low) else -np.inf, self.inner(high) if np.isfinite(high) else np.inf

    def value(self, inner: float) -> float:
        return float(np.exp(inner)) if self.log else inner * self.scale

    def slope(self, inner: float) -> float:
        """Derivative d value / d inner."""
        return float(np.exp(inner)) if self.log else self.scale


Parameters = Mapping[str, "Unknown | float | None"] | Iterable[str]


def sought(setups: list[Setup], states: list[tuple[Array, Array]], parameters: Any) -> list[Sought]:
    """All unknown numbers of runs with these setups and initial states."""
    if isinstance(parameters, str):
        parameters = [parameters]
    if not isinstance(parameters, Mapping):
        parameters = dict.fromkeys(parameters)
    if not parameters:
        raise ValueError("parameters: name at least one that is sought, such as 'link.0.tip.mass'")
    found = []
    for path, given in parameters.items():
        unknown = given if isinstance(given, Unknown) else _of_number(path, given)
        own = path.startswith(("q0", "v0")) if unknown.each_run is None else unknown.each_run
        own = own and len(setups) > 1
        for run in range(len(setups)) if own else (None,):
            name = path if run is None else f"run {run}: {path}"
            try:
                filled = _filled(setups[run or 0], states[run or 0], path, unknown)
            except ValueError as e:
                raise ValueError(f"parameters['{path}']: {e}") from None
            found.append(Sought(name, path, run, filled))
    Variation(setups[0], {x.path: np.array([x.of.start]) for x in found})  # raises for a path that is part of another
    return found


def _of_number(path: str, given: Any) -> Unknown:
    try:
        return Unknown() if given is None else Unknown(number("start", given))
    except ValueError as e:
        raise ValueError(f"parameters['{path}']: {e}; or give an fa.Unknown") from None


def _filled(setup: Setup, state: tuple[Array, Array], path: str, unknown: Unknown) -> Unknown:
    value = current(setup, state, path)
    start = value if unknown.start is None else unknown.start
    if start is None or not np.isfinite(start):
        raise ValueError(f"the scene's value is {value}: give a start, such as fa.Unknown(start=...)")
    low, log = unknown.low, unknown.log
    if not path.startswith(("q0", "v0", "gravity")):
        size = abs(start) or 1.0
        try:
            _tried(setup, path, start)
        except ValueError as e:
            said = str(e).removeprefix("parameters of scenario 0: ")
            raise ValueError(f"start = {start:g}: {said}") from None
        if low < 0 and not _takes(setup, path, -size):
            low = 0.0
        if log is None:
            log = low >= 0 and start > 0 and not _takes(setup, path, 0.0)
    if not low <= start <= unknown.high:
        raise ValueError(f"start = {start:g}: must be within the bounds, {low:g} to {unknown.high:g}")
    if log and not (start > 0 and low >= 0):
        raise ValueError(f"log = True: needs a positive start and bounds, not {start:g} within {low:g} on")
    return replace(unknown, start=float(start), low=low, log=bool(log))


def _tried(setup: Setup, path: str, value: float) -> None:
    Variation(setup, {path: np.array([value])}).scenario(0)


def _takes(setup: Setup, path: str, value: float) -> bool:
    try:
        _tried(setup, path, value)
    except ValueError:
        return False
    return True


def current(setup: Setup, state: tuple[Array, Array], path: str) -> float | None:
    """The value of a path in a setup; None if it is left out there. ValueError if it is no number."""
    path, known = numbered(setup, path), setup.known
    value, _ = value_at(setup, path, dict(zip(("q0", "v0"), state, strict=True)))
    if value is None and path not in known:
        states = [f"{k}.{i}" for k, x in zip(("q0", "v0"), state, strict=True) for i in range(len(x))]
        near = difflib.get_close_matches(path, [*known, *states], n=1, cutoff=0.3)
        hint = f"; did you mean '{near[0]}'?" if near else ""
        if re.fullmatch(r"sensor\.\d+\.filter\.\w+", path):
            hint = "; give this sensor a filter in the scene, such as filter=fa.sensors.LowPass(20.0)"
        raise ValueError(f"is nothing that can vary{hint}")
    if np.ndim(value) or isinstance(value, (Mapping, str)):
        raise ValueError(f"is no single number; take one of it, such as '{path}.0'")
    if value is not None and not isinstance(value, (int, float, np.floating)):
        raise ValueError(f"is no number; can vary there: {', '.join(k for k in known if k.startswith(path + '.'))}")
    return None if value is None else float(value)


def drawn(all_sought: list[Sought], count: int, seed: int) -> Array:
    """Starts (count, n) as inner values: the first is the given one, the others are a Latin hypercube within the
    bounds. Without bounds it is within a factor of 3 of the start; for a start of zero within 2 standard deviations of
    the prior, or at zero."""
    from scipy.stats import qmc  # slow to import

    first = np.array([x.inner(x.of.start or 0.0) for x in all_sought])
    if count == 1:
        return first[None]
    share = qmc.LatinHypercube(len(first), rng=seed).random(count - 1)
    low, high = np.array([_range(x) for x in all_sought]).T
    return np.vstack([first, low + share * (high - low)])


def _range(x: Sought) -> tuple[float, float]:
    start, low, high = x.of.start or 0.0, x.of.low, x.of.high
    if x.of.mean is not None and x.of.std is not None:
        a, b = x.of.mean - 2 * x.of.std, x.of.mean + 2 * x.of.std
        if x.log and a <= 0:
            a = min(start, x.of.mean) / _FACTOR if x.of.mean > 0 else start / _FACTOR
    elif start:
        a, b = sorted((start / _FACTOR, start * _FACTOR))
    else:
        a = b = 0.0
    bounded = np.isfinite(low) and np.isfinite(high) and (low > 0 or not x.log)
    a, b = (low, high) if bounded else (max(a, low), min(b, high))
    return x.inner(a), x.inner(b)
