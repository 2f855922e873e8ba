"""A compiled scene as a function of sliders: its numbers at their values, as tables that a page looks up in."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from .._check import Array
from ..arm.variation import Setup, Variation
from ..run.scene.scene import Scene
from ..run.scene.writer import compiled_text
from .sliders import Slider

STOPS = 13  # of a slider on which the numbers depend otherwise than by a straight line
_SAME = 1e-11  # of a number: rounding of a sum of many


def leaves(document: Any, field: Any = None) -> Iterator[tuple[Any, float]]:
    """The numbers of a document in the order of its text, each with its field: a vector, a matrix, a polynomial."""
    items = document.items() if isinstance(document, dict) else enumerate(document)
    for key, value in items:
        within = (id(document), key) if isinstance(document, dict) else field
        if isinstance(value, (dict, list)):
            yield from leaves(value, within)
        elif isinstance(value, (int, float)) and not isinstance(value, bool):
            yield within, float(value)


class _Compiled:
    """The numbers of a compiled scene at values of sliders, by their number; each is compiled once.

    Raises:
        ValueError: a slider on which the number of coordinates, slices or laws depends.
    """

    def __init__(self, scene: Scene, sliders: Sequence[Slider]) -> None:
        self.scene, self.sliders, self._setup = scene, sliders, Setup.of(scene)
        self.document = self._made({})
        self.own = self._read(self.document)
        self._known: dict[tuple[tuple[int, float], ...], Array] = {}

    def _made(self, values: Mapping[int, float]) -> Any:
        scene = self.scene
        if values:
            given: dict[str, Array] = {}
            for k, value in values.items():
                given |= self.sliders[k].parameters(self._setup, value)
            made = Variation(self._setup, given, once=True).scenario(0)
            scene = replace(scene, arm=made.arm, drive=made.drive, loads=made.loads, control=made.control)
        document = json.loads(compiled_text(scene))
        document["t"] = [document["t"][0], document["t"][-1]]
        return document

    @staticmethod
    def _read(document: Any) -> Array:
        return np.array([value for _, value in leaves(document)])

    def at(self, values: Mapping[int, float]) -> Array:
        moved = {k: x for k, x in sorted(values.items()) if x != self.sliders[k].value}
        key = tuple(moved.items())
        if not key:
            return self.own
        if key not in self._known:
            found = self._read(self._made(moved))
            if found.shape != self.own.shape:
                names = ", ".join(f"{self.sliders[k].label} at {x:.6g}" for k, x in key)
                raise ValueError(f"sliders: with {names} the scene has other coordinates, slices or laws")
            self._known[key] = found
        return self._known[key]


class ArmAlone(_Compiled):
    """The same of the arm of a scene, whose numbers stand ahead of all others."""

    def __init__(self, scene: Scene, sliders: Sequence[Slider]) -> None:
        bare = replace(scene, drive={}, loads=(), control=(), sensors=(), q0=None, v0=None)
        super().__init__(bare, [s for s in sliders if s.of_arm])
        self._which = {k: n for n, k in enumerate(k for k, s in enumerate(sliders) if s.of_arm)}

    @staticmethod
    def _read(document: Any) -> Array:
        return np.array([value for _, value in leaves({k: document[k] for k in ("format", "version", "arm")})])

    def at(self, values: Mapping[int, float]) -> Array:
        return super().at({self._which[k]: x for k, x in values.items() if k in self._which})


class Numbers:
    """The numbers of a scene's compiled document as functions of sliders.

    A number depends on few sliders: those that move it where the others stand as the scene has them. In a slider whose
    numbers follow straight lines the page interpolates between its ends, exactly; any other has stops.

    Args:
        arm: of the scene's arm and these sliders; scenes of one arm may share it.

    Attributes:
        document: at the scene's own values. stops: of each slider, its values. straight: whether between two ends.
        tables: {"sliders", "at": which numbers, "values": at each combination of their stops}.

    Raises:
        ValueError: a slider that no number depends on, or on which the number of coordinates or of points does.
    """

    def __init__(self, scene: Scene, sliders: Sequence[Slider], arm: ArmAlone) -> None:
        self.sliders, self._whole = sliders, _Compiled(scene, sliders)
        self.document, self._own = self._whole.document, self._whole.own
        fields = [field for field, _ in leaves(self.document)]
        numbered = {field: n for n, field in enumerate(dict.fromkeys(fields))}
        self._fields = np.array([numbered[field] for field in fields])
        self._arm: ArmAlone | None = arm
        self._tabulate()
        if not self._right():  # the scene's laws depend on its arm
            self._arm = None
            self._tabulate()
            if not self._right():
                raise ValueError("sliders: act on each other in a way that the page's tables do not hold; give fewer")

    def _tabulate(self) -> None:
        self.straight = [self._is_straight(k) for k in range(len(self.sliders))]
        self.stops = [self._stops(k) for k in range(len(self.sliders))]
        self.tables = list(self._tables())

    def _at(self, values: Mapping[int, float]) -> Array:
        """The numbers with sliders at these values."""
        if self._arm is None:
            return self._whole.at(values)
        out = self._whole.at({k: x for k, x in values.items() if not self.sliders[k].of_arm}).copy()
        mine = self._arm.at(values)
        out[: len(mine)] = mine
        return out

    def _is_straight(self, k: int) -> bool:
        """Whether all numbers follow straight lines between the ends of a slider."""
        s = self.sliders[k]
        low, high = (self._at({k: x}) for x in (s.low, s.high))
        for part in (0.3, 0.7):
            middle = self._at({k: s.low + part * (s.high - s.low)})
            if not self._same(middle, low + part * (high - low)):
                return False
        return True

    def _stops(self, k: int) -> list[float]:
        s = self.sliders[k]
        if self.straight[k]:
            return [s.low, s.high]
        return sorted({*np.linspace(s.low, s.high, STOPS).tolist(), s.value})

    def _tables(self) -> Iterator[dict[str, Any]]:
        depends = np.zeros((len(self.sliders), len(self._own)), dtype=bool)
        for k, stops in enumerate(self.stops):
            for x in stops:
                depends[k] |= self._at({k: x}) != self._own
            if not depends[k].any():
                raise ValueError(f"sliders: nothing depends on {self.sliders[k].label}")
        for who in np.unique(depends.T, axis=0):
            sliders = np.flatnonzero(who).tolist()
            if not sliders:
                continue
            at = np.flatnonzero((depends == who[:, None]).all(axis=0))
            ways = product(*(self.stops[k] for k in sliders))
            values = np.array([self._at(dict(zip(sliders, way, strict=True)))[at] for way in ways])
            yield {"sliders": sliders, "at": at, "values": values}

    def look_up(self, values: Mapping[int, float]) -> Array:
        """What the page finds in the tables; of a slider with stops the nearest one."""
        found = self._own.copy()
        for table in self.tables:
            if all(values.get(k, self.sliders[k].value) == self.sliders[k].value for k in table["sliders"]):
                continue
            parts = [self._shares(k, values.get(k, self.sliders[k].value)) for k in table["sliders"]]
            weights = np.array([np.prod(way) for way in product(*parts)])
            used = np.flatnonzero(weights)
            found[table["at"]] = weights[used] @ table["values"][used]
        return found

    def _shares(self, k: int, x: float) -> list[float]:
        """Of each stop of a slider."""
        stops = self.stops[k]
        if self.straight[k]:
            part = (x - stops[0]) / (stops[1] - stops[0])
            return [1 - part, part]
        nearest = int(np.abs(np.array(stops) - x).argmin())
        return [float(j == nearest) for j in range(len(stops))]

    def _right(self) -> bool:
        """Whether the tables hold where sliders are moved together."""
        rng = np.random.default_rng(0)
        for _ in range(3):
            values = {
                k: float(rng.uniform(s.low, s.high) if self.straight[k] else rng.choice(self.stops[k]))
                for k, s in enumerate(self.sliders)
            }
            if not self._same(self.look_up(values), self._whole.at(values)):
                return False
        return True

    def _same(self, a: Array, b: Array) -> bool:
        """Whether numbers are the same up to rounding, which is relative to the largest one of a field."""
        largest = np.zeros(self._fields.max() + 1)
        np.maximum.at(largest, self._fields, np.maximum(np.abs(a), np.abs(b)))
        return bool((np.abs(a - b) <= _SAME * largest[self._fields]).all())
