"""Sections of beams: y and z are their principal axes, lengths are in m."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar

import numpy as np

import flexarm._core as _core

from .._check import array, number
from .part import Part


class Section(Part):
    """A section of a beam that has two axes of symmetry, y and z."""

    _core: _core.Section

    def _face(self, axis: str) -> tuple[float, float, bool] | None:
        """Of the faces across an axis: their distance from the neutral axis and their breadth (m), and whether the
        section warps in torsion as a rectangle does; None where there are no such faces."""
        return None


class Shape(Section):
    """A section whose integrals follow from its sides."""

    @property
    def area(self) -> float:
        """m^2"""
        return float(self._core.area)

    @property
    def second_moment_y(self) -> float:
        """Integral of z^2 dA (m^4); resists bending along z."""
        return float(self._core.second_moment_y)

    @property
    def second_moment_z(self) -> float:
        """Integral of y^2 dA (m^4); resists bending along y."""
        return float(self._core.second_moment_z)

    @property
    def torsion_constant(self) -> float:
        """Saint-Venant's torsion constant (m^4)."""
        return float(self._core.torsion_constant)


@dataclass(frozen=True)
class Rectangle(Shape):
    """Full rectangle. The torsion constant comes from Saint-Venant's series.

    Args:
        y, z: sides along the beam's y and z (m).
        shear_correction: share of the area that bears shear.
    """

    y: float
    z: float
    shear_correction: float = 5 / 6
    type: ClassVar[str] = "rectangle"
    _core: _core.Section = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        for f in ("y", "z", "shear_correction"):
            self._set(f, number(f, getattr(self, f)))
        self._set("_core", _core.Section.rectangle(self.y, self.z, self.shear_correction))

    def _face(self, axis: str) -> tuple[float, float, bool]:
        depth, breadth = (self.y, self.z) if axis == "y" else (self.z, self.y)
        return depth / 2, breadth, True


@dataclass(frozen=True)
class Circle(Shape):
    """Disc, or a tube when `inner_radius` is above zero.

    Args:
        radius, inner_radius: m.
        shear_correction: share of the area that bears shear; that of a thin tube is about 1/2.
    """

    radius: float
    inner_radius: float = 0.0
    shear_correction: float = 9 / 10
    type: ClassVar[str] = "circle"
    _core: _core.Section = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        for f in ("radius", "inner_radius", "shear_correction"):
            self._set(f, number(f, getattr(self, f)))
        self._set("_core", _core.Section.circle(self.radius, self.inner_radius, self.shear_correction))

    def _face(self, axis: str) -> tuple[float, float, bool]:
        return self.radius, 2 * self.radius, False


@dataclass(frozen=True)
class GeneralSection(Section):
    """Any doubly symmetric section, by its integrals.

    Args:
        area: m^2.
        second_moment_y: integral of z^2 dA (m^4); resists bending along z.
        second_moment_z: integral of y^2 dA (m^4); resists bending along y.
        torsion_constant: Saint-Venant's (m^4).
        shear_correction: share of the area that bears shear.
    """

    area: float
    second_moment_y: float
    second_moment_z: float
    torsion_constant: float
    shear_correction: float = 5 / 6
    type: ClassVar[str] = "general"
    _core: _core.Section = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        names = ("area", "second_moment_y", "second_moment_z", "torsion_constant", "shear_correction")
        for f in names:
            self._set(f, number(f, getattr(self, f)))
        self._set("_core", _core.Section(*(getattr(self, f) for f in names)))


@dataclass(frozen=True)
class Taper(Part):
    """A section that varies along the beam: samples from the clamp to the tip, linear in between.

    Sections of one kind are interpolated by their sides or radii (so that a wedge or a cone is exact), or, if general,
    by their integrals; sections of different kinds by their integrals.

    Args:
        x: places (m), increasing from 0 to the beam's length.
        sections: one Rectangle, Circle or GeneralSection at each.
    """

    x: Sequence[float]
    sections: Sequence[Section]
    type: ClassVar[str] = "taper"
    #: the section at x metres
    at: Callable[[float], Any] = field(init=False, repr=False, compare=False)
    _core: _core.SectionProfile = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        x = array("x", self.x)
        if x.ndim != 1 or x.size < 2 or x[0] != 0.0 or not (np.diff(x) > 0).all():
            raise ValueError(f"x = {self.x!r}: must be two or more places, increasing from 0")
        if not isinstance(self.sections, (list, tuple)) or len(self.sections) != x.size:
            raise ValueError(f"sections = {self.sections!r}: must be one section for each of the {x.size} places of x")
        for k, part in enumerate(self.sections):
            if not isinstance(part, Section):
                raise ValueError(f"sections[{k}] = {part!r}: must be a Rectangle, Circle or GeneralSection")
        kind = type(self.sections[0])
        cls: Any = kind if all(type(part) is kind for part in self.sections) else GeneralSection
        names = [f.name for f in fields(cls) if f.init]
        table = np.array([[getattr(p if cls is kind else p._core, n) for n in names] for p in self.sections])
        self._set("x", tuple(x.tolist()))
        self._set("sections", tuple(self.sections))

        def at(place: float) -> Any:
            return cls(*(float(np.interp(place, x, column)) for column in table.T))

        self._set("at", at)
        self._set("_core", _core.SectionProfile(lambda place: at(place)._core, x[1:-1].tolist()))
