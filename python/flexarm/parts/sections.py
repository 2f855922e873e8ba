"""Sections of beams: y and z are their principal axes, lengths are in m."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar

import numpy as np

import flexarm._core as _core

from .._check import array, number
from .material import Material
from .part import Part


class Section(Part):
    """A section of a beam."""

    _core: Any

    def _face(self, axis: str) -> tuple[float, float, bool] | None:
        """Of the faces across an axis: their distance from the neutral axis and their breadth (m), and whether the
        section warps in torsion as a rectangle does; None where there are no such faces."""
        return None


class Shape(Section):
    """A section with two axes of symmetry, whose integrals follow from its sides."""

    _core: _core.Section

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


_ROWS = ("extension", "shear_y", "shear_z", "torsion", "bending_z", "bending_y")  # of a SectionMatrix, by strains


@dataclass(frozen=True)
class SectionMatrix(Section):
    """Any section, by its stiffness and its inertia per unit length. It holds its material: a beam of it has none.

    Rows and columns stand for x, y, z (force or velocity), then about x, y, z (moment or angular velocity), with x
    along the beam, all at the beam's axis: N, V_y, V_z, M_x, M_y, M_z = stiffness @ (eps, phi12, phi13, K1, K2, K3),
    the strains of `Arm.strain`. Couplings of bending with torsion, of stretch with bending, and so on are its entries
    off the diagonal: where the shear centre or the neutral axis is off the beam's axis, or plies lie at an angle. A
    strain without modes stays zero, whatever is coupled to it.

    Args:
        stiffness: 6 x 6 (N, N m, N m^2), symmetric, positive definite of the strains that the beam has modes of.
        inertia: 6 x 6 (kg/m, kg, kg m), [m 1, -m c~; m c~, J]: m the mass per length, c = (0, y, z) the centre of mass
            (c~ v = c x v), J about the beam's axis. Centres of mass off the axis, and products of inertia, need a beam
            of order 3 or "exact".

    Raises:
        ValueError: naming the entry and the value.
    """

    stiffness: Sequence[Sequence[float]]
    inertia: Sequence[Sequence[float]]
    type: ClassVar[str] = "matrix"
    _core: _core.SectionMatrix = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        matrices = [array(name, getattr(self, name), (6, 6)) for name in ("stiffness", "inertia")]
        for name, matrix in zip(("stiffness", "inertia"), matrices, strict=True):
            self._set(name, tuple(tuple(row) for row in matrix.tolist()))
        self._set("_core", _core.SectionMatrix(*matrices))

    @classmethod
    def of(
        cls, section: Section, material: Material, *, y: float = 0.0, z: float = 0.0, angle: float = 0.0
    ) -> SectionMatrix:
        """The matrices of a doubly symmetric section, turned and off the beam's axis.

        Args:
            section: a Rectangle, Circle, ... or GeneralSection.
            material: with poisson_ratio or shear_modulus.
            y, z: where its centre lies from the beam's axis (m).
            angle: of its own y from the beam's (rad), about x.

        Raises:
            ValueError: naming the field and the value.
        """
        if not isinstance(section, Section) or isinstance(section, SectionMatrix):
            raise ValueError(f"section = {section!r}: must be a doubly symmetric one, as Rectangle")
        if not isinstance(material, Material):
            raise ValueError(f"material = {material!r}: must be a Material")
        if material.shear_modulus is None and material.poisson_ratio is None:
            raise ValueError(f"material = {material!r}: must have a poisson_ratio or a shear_modulus")
        s, E, G = section._core, material.youngs_modulus, material._core.shear_modulus
        shear = G * s.shear_correction * s.area
        iy, iz = s.second_moment_y, s.second_moment_z
        K = np.diag([E * s.area, shear, shear, G * s.torsion_constant, E * iy, E * iz])
        M = material.density * np.diag([s.area, s.area, s.area, iy + iz, iy, iz])
        cosine, sine = np.cos(number("angle", angle)), np.sin(angle)
        R = np.array([[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]])
        y, z = number("y", y), number("z", z)
        c = np.array([[0, -z, y], [z, 0, 0], [-y, 0, 0]])
        T = np.block([[R.T, -R.T @ c], [np.zeros((3, 3)), R.T]])  # strains and velocities at the section's centre
        return cls(*(0.5 * (A + A.T) for A in (T.T @ K @ T, T.T @ M @ T)))

    @property
    def mass(self) -> float:
        """kg/m"""
        return self.inertia[0][0]

    @property
    def com(self) -> tuple[float, float]:
        """y and z of the centre of mass (m)."""
        _, y, z = self._core.com
        return float(y), float(z)

    def rigidity(self, strain: str) -> float:
        """Its entry on the diagonal of the stiffness, of "bending_y" and so on (N m^2, N)."""
        row = _ROWS.index(strain)
        return self.stiffness[row][row]

    def coupling(self, one: str, other: str) -> float:
        """By which part of its stiffness a strain is softer where the other is free, from 0 to 1."""
        size = self.rigidity(one) * self.rigidity(other)
        return self.stiffness[_ROWS.index(one)][_ROWS.index(other)] ** 2 / size if size else 0.0

    @property
    def off_axis(self) -> bool:
        """Whether its inertia has a centre of mass off the beam's axis, or products."""
        J = np.array(self._core.inertia_about_com)
        return any(self.com) or bool((J != np.diag(np.diag(J))).any())


@dataclass(frozen=True)
class Taper(Part):
    """A section that varies along the beam: samples from the clamp to the tip, linear in between.

    Sections of one kind are interpolated by their sides or radii (so that a wedge or a cone is exact), or, if general,
    by their integrals or their matrices; doubly symmetric ones of different kinds by their integrals.

    Args:
        x: places (m), increasing from 0 to the beam's length.
        sections: a section at each.
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
                raise ValueError(f"sections[{k}] = {part!r}: must be a Rectangle or another section")
        kind = type(self.sections[0])
        cls: Any = kind if all(type(part) is kind for part in self.sections) else GeneralSection
        if cls is not kind and any(isinstance(part, SectionMatrix) for part in self.sections):
            raise ValueError("sections: must all be a SectionMatrix where one is; see SectionMatrix.of")
        names = [f.name for f in fields(cls) if f.init]
        table = np.array([[getattr(p if cls is kind else p._core, n) for n in names] for p in self.sections])
        law = _core.SectionMatrixProfile if cls is SectionMatrix else _core.SectionProfile
        columns = table.reshape(x.size, -1).T
        self._set("x", tuple(x.tolist()))
        self._set("sections", tuple(self.sections))

        def at(place: float) -> Any:
            values = [np.interp(place, x, column) for column in columns]
            return cls(*np.reshape(values, table.shape[1:]))

        self._set("at", at)
        self._set("_core", law(lambda place: at(place)._core, x[1:-1].tolist()))
