"""What is sought: numbers of a scene by their dotted paths, each with a start, bounds and what is known beforehand."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from .._check import Array, number
from ..run.variation import Setup, Variation, fields_of, known_paths, numbered

_FACTOR = 3.0  # by which starts differ where no bounds tell


@dataclass(frozen=True)
class Unknown:
    """An unknown number of a scene, for `fa.identify`.

    Args:
        start: where the search begins; None: the scene's value.
        low, high: bounds. A quantity that its part refuses when it is negative, such as a stiffness, is at least 0
            without being told.
        mean, std: what is known beforehand: a mean and a standard deviation (a prior). Give both or neither.
        log: whether the logarithm is sought, so that factors count alike and the interval lies asymmetrically about the
            value; None: of what must be positive (a modulus, a length), but not of what may be zero (a friction).
        each_run: whether each run has a value of its own; None: initial states (q0.K, v0.K) alone.
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
        if self.std is not None and not 0 < self.std < np.inf:
            raise ValueError(f"std = {self.std:g}: must be positive and finite")
        if self.mean is not None and not np.isfinite(self.mean):
            raise ValueError(f"mean = {self.mean}: must be finite")
        for name in ("log", "each_run"):
            if getattr(self, name) not in (None, True, False):
                raise ValueError(f"{name} = {getattr(self, name)!r}: must be True, False or None")


class Sought(NamedTuple):
    """One number that is sought.

    Attributes:
        name: what it is called: its path, or "run K: path". path: where it stands. run: the run it belongs to, or None.
        of: as it was asked for, its start and bounds filled in.
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
        """By which a number that is not sought by its logarithm is divided."""
        assert self.of.start is not None
        if self.log:
            return 1.0
        finite = [x for x in (self.of.low, self.of.high) if np.isfinite(x) and x]
        return abs(self.of.start) or self.of.std or (max(map(abs, finite)) if finite else 1.0)

    def inner(self, value: float) -> float:
        """What the search sees of a value."""
        if self.log:
            return float(np.log(value)) if value > 0 else -np.inf
        return value / self.scale

    def value(self, inner: float) -> float:
        return float(np.exp(inner)) if self.log else inner * self.scale

    def slope(self, inner: float) -> float:
        """d value / d inner."""
        return float(np.exp(inner)) if self.log else self.scale


Asked = Mapping[str, "Unknown | float | None"] | Iterable[str]


def sought(setups: list[Setup], states: list[tuple[Array, Array]], parameters: Any) -> list[Sought]:
    """All numbers that are asked for, of runs that are made of these setups and begin in these states."""
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
    Variation(setups[0], {x.path: np.array([x.of.start]) for x in found})  # names a path that is part of another
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
    """The value that a path has in a setup; None where it is left out there. ValueError for what is no number."""
    known = known_paths(setup)
    path = numbered(setup, path)
    root, *inner = path.split(".")
    arm = setup.arm
    node: Any = {
        "link": arm.links, "load": setup.loads, "control": setup.control, "sensor": setup.sensors, "q0": state[0],
        "v0": state[1], "gravity": arm.gravity,
    }.get(root)  # fmt: skip
    if root == "drive":
        names = {".".join(str(k) for k in key) if isinstance(key, tuple) else str(key): key for key in setup.drive}
        for name, key in names.items():
            if path.startswith(f"drive.{name}."):
                node, inner = setup.drive[key], path[len(f"drive.{name}.") :].split(".")
    try:
        for name in inner:
            node = node[int(name)] if isinstance(node, (tuple, list, np.ndarray)) else fields_of(node)[name]
    except (KeyError, IndexError, ValueError, TypeError):
        node = path
    if node is path or root not in ("link", "load", "control", "sensor", "q0", "v0", "gravity", "drive"):
        states = [f"{k}.{i}" for k, x in zip(("q0", "v0"), state, strict=True) for i in range(len(x))]
        near = difflib.get_close_matches(path, [*known, *states], n=1, cutoff=0.3)
        hint = f"; did you mean '{near[0]}'?" if near else ""
        if root == "sensor" and inner[1:2] == ["filter"] and len(inner) == 3 and inner[0].isdigit():
            hint = "; give this sensor a filter in the scene, such as filter=fa.LowPass(20.0)"
        raise ValueError(f"is nothing that can vary{hint}")
    if np.ndim(node) or isinstance(node, Mapping) or isinstance(node, str):
        raise ValueError(f"is no single number; take one of it, such as '{path}.0'")
    if node is not None and not isinstance(node, (int, float, np.floating)):
        raise ValueError(f"is no number; can vary there: {', '.join(k for k in known if k.startswith(path + '.'))}")
    return None if node is None else float(node)


def drawn(all_sought: list[Sought], count: int, seed: int) -> Array:
    """Starts (count, n), as the search sees them: the first is that which was asked for, the others are a Latin
    hypercube within the bounds; where these are missing, within a factor of 3 of the start (of what starts at zero,
    within 2 standard deviations of what is known beforehand, or there)."""
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
