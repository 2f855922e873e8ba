"""Sections that vary along a beam."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar

import numpy as np

import flexarm._core as _core

from ..._check import array
from .part import Part
from .sections import GeneralSection, Section, SectionMatrix


def _column(sections: Sequence[Section], name: str, alike: bool) -> Any:
    """The sections' values of one argument: (n, ...) numbers; None if all leave it out."""
    values = [getattr(part if alike else part._core, name) for part in sections]
    if all(v is None for v in values):
        return None
    values = [getattr(p._core, name) if v is None else v for p, v in zip(sections, values, strict=True)]
    return np.array([np.broadcast_to(v, max(map(np.shape, values), key=len)) for v in values])


def _between(place: float, x: Any, column: Any) -> Any:
    values = [np.interp(place, x, c) for c in column.reshape(len(x), -1).T]
    return np.reshape(values, column.shape[1:]).tolist()


@dataclass(frozen=True)
class Taper(Part):
    """A section that varies along the beam: samples from the clamp to the tip, linear in between.

    Sections of one kind are interpolated by their sides or radii (so that a wedge or a cone is exact), or, if general,
    by their integrals or their matrices; doubly symmetric ones of different kinds by their integrals.

    Args:
        x: places (m), increasing from 0 to the beam's length.
        sections: one section at each.
    """

    x: Sequence[float]
    sections: Sequence[Section]
    type: ClassVar[str] = "taper"
    #: the section at x metres
    at: Callable[[float], Any] = field(init=False, repr=False, compare=False)
    _core: _core.SectionProfile = field(init=False, repr=False, compare=False)

    def _made(self) -> Any:
        x = array("x", self.x)
        if x.ndim != 1 or x.size < 2 or x[0] != 0.0 or not (np.diff(x) > 0).all():
            raise ValueError(f"x = {self.x!r}: must be two or more places, increasing from 0")
        if not isinstance(self.sections, (list, tuple)) or len(self.sections) != x.size:
            raise ValueError(f"sections = {self.sections!r}: must be one section for each of the {x.size} places of x")
        for k, part in enumerate(self.sections):
            if not isinstance(part, Section):
                raise ValueError(f"sections[{k}] = {part!r}: must be a Rectangle or another section")
        kind = type(self.sections[0])
        cls: Any = kind if all(type(part) is kind for part in self.sections) else GeneralSection
        law = _core.SectionMatrixProfile if cls is SectionMatrix else _core.SectionProfile
        if cls is not kind and any(isinstance(part, SectionMatrix) for part in self.sections):
            raise ValueError("sections: must all be a SectionMatrix where one is; see SectionMatrix.of")
        columns = [_column(self.sections, f.name, cls is kind) for f in fields(cls) if f.init]
        self._set("x", tuple(x.tolist()))
        self._set("sections", tuple(self.sections))

        def at(place: float) -> Any:
            return cls(*(None if c is None else _between(place, x, c) for c in columns))

        self._set("at", at)
        return law(lambda place: at(place)._core, x[1:-1].tolist())
