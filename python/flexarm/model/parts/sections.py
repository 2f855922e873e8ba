"""Sections of beams: y and z are their principal axes, lengths are in m."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

import numpy as np

import flexarm._core as _core

from ..._check import array, instance, number, tilde, warn
from .material import Material
from .part import ModelWarning, Part

Face = _core.Face


def _pair(name: str, value: Any) -> float | tuple[float, float]:
    if not isinstance(value, (tuple, list)):
        return number(name, value)
    if len(value) != 2:
        raise ValueError(f"{name} = {value!r}: must be one number, or two, along y and along z")
    return number(name, value[0]), number(name, value[1])


Pair = Annotated[float | Sequence[float], _pair]  # one number, or two, along y and along z


def _both(value: float | Sequence[float]) -> tuple[float, float]:
    y, z = np.broadcast_to(value, 2).tolist()
    return y, z


class Section(Part):
    """A section of a beam."""

    def at(self, place: float) -> Any:
        """The section at a place along the beam (m): itself, unless it is a Taper."""
        return self

    def _face(self, axis: str) -> Face | None:
        """The faces across an axis; None if there are none."""
        return None

    def _reach(self, axis: str) -> float | None:
        """The largest distance from the axis (m); None if it is not known."""
        return None


@dataclass(frozen=True)
class SymmetricSection(Section):
    """A section with two axes of symmetry, y and z."""

    _core: _core.Section = field(init=False, repr=False, compare=False)

    def _face(self, axis: str) -> Face | None:
        return self._core.faces["yz".index(axis)]

    def _reach(self, axis: str) -> float | None:
        return self._core.reach["yz".index(axis)]


class Shape(SymmetricSection):
    """A symmetric section whose integrals follow from its sides."""

    type: ClassVar[str]  #: the name of the core's maker, too
    shear_correction: Pair | None

    def _sizes(self) -> list[Any]:
        """The arguments as the core's maker takes them, apart from the shear correction."""
        return [x for name, x in self._arguments().items() if name != "shear_correction"]

    def _made(self) -> Any:
        k = None if self.shear_correction is None else _both(self.shear_correction)
        return getattr(_core.Section, self.type)(*self._sizes(), k)

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

    @property
    def shear_areas(self) -> tuple[float, float]:
        """Areas that bear shear along y and along z (m^2): the area times the shear correction."""
        y, z = self._core.shear_correction
        return y * self.area, z * self.area


@dataclass(frozen=True)
class Rectangle(Shape):
    """Full rectangle. The torsion constant comes from Saint-Venant's series.

    Args:
        y, z: sides along the beam's y and z (m).
        shear_correction: share of the area that bears shear: one number, or two, along y and along z.
    """

    y: float
    z: float
    shear_correction: Pair = 5 / 6
    type: ClassVar[str] = "rectangle"


@dataclass(frozen=True)
class Circle(Shape):
    """Disc, or a tube when `inner_radius` is above zero.

    Args:
        radius, inner_radius: m.
        shear_correction: share of the area that bears shear: one number, or two, along y and along z; that of a thin
            tube is about 1/2.
    """

    radius: float
    inner_radius: float = 0.0
    shear_correction: Pair = 9 / 10
    type: ClassVar[str] = "circle"


@dataclass(frozen=True)
class Tube(Shape):
    """Round tube. All its integrals are exact.

    Args:
        radius: of the outside (m). thickness: of the wall (m).
        shear_correction: share of the area that bears shear: one number, or two, along y and along z. None: Cowper's
            (J. Appl. Mech. 33, 1966), with Poisson's ratio zero as for all shapes: from 6/7 of a disc to 1/2 of a thin
            tube; with 0.3 it would be 3 to 6 % more.
    """

    radius: float
    thickness: float
    shear_correction: Pair | None = None
    type: ClassVar[str] = "tube"


@dataclass(frozen=True)
class Ellipse(Shape):
    """Full ellipse. All its integrals are exact.

    Args:
        y, z: its axes along the beam's y and z, from edge to edge (m).
        shear_correction: share of the area that bears shear: one number, or two, along y and along z. None: Cowper's
            (1966), with Poisson's ratio zero.
    """

    y: float
    z: float
    shear_correction: Pair | None = None
    type: ClassVar[str] = "ellipse"


@dataclass(frozen=True)
class Box(Shape):
    """Hollow rectangle with sharp corners.

    Area and second moments are exact. The torsion constant is Bredt's, 4 A^2 / int ds/t, with the walls' own torsion
    and the contribution of the corners, 1 to 6 %: against a solution of Saint-Venant's equation it is off by less
    than 5e-4 (walls that differ by up to a factor of 5), and by 3e-3 of a nearly full section.

    Args:
        y, z: outer sides along the beam's y and z (m).
        thickness: of the walls (m), or two: of those across y and of those across z.
        shear_correction: share of the area that bears shear: one number, or two, along y and along z. None: that of
            the shear flow in walls as thick as these, with Poisson's ratio zero (Cowper's 1966 formula is its limit of
            thin walls); about the share of the walls along the force. It is right to 3 % for walls up to a tenth of
            the smaller side, and to 6 % up to a fifth.
    """

    y: float
    z: float
    thickness: Pair
    shear_correction: Pair | None = None
    type: ClassVar[str] = "box"

    def _sizes(self) -> list[Any]:
        return [self.y, self.z, _both(self.thickness)]


@dataclass(frozen=True)
class IBeam(Shape):
    """I-beam with two equal flanges, without fillets: the web along y, the flanges across its ends.

    Area and second moments are exact. The torsion constant is the sum over its strips, corrected for their ends and
    junctions (as El Darwish and Johnston, Proc. ASCE 91 ST1, 1965, but for webs of 0.1 to 4 flange thicknesses):
    against a solution of Saint-Venant's equation it is off by less than 2e-3 where the flanges are wider than 4 times
    their thickness and the web's. It twists freely: warping that is held at the clamp makes it stiffer there.

    Args:
        y: depth along the beam's y, over both flanges (m). z: width of the flanges, along the beam's z (m).
        flange: thickness of a flange (m). web: thickness of the web (m).
        shear_correction: share of the area that bears shear: one number, or two, along y and along z. None: that of
            the shear flow, with Poisson's ratio zero (Cowper's 1966 formula is its limit of thin walls): about the
            web's share along y, 5/6 of the flanges' along z; right to 3 % for walls up to a tenth of the depth.
    """

    y: float
    z: float
    flange: float
    web: float
    shear_correction: Pair | None = None
    type: ClassVar[str] = "i_beam"


@dataclass(frozen=True)
class GeneralSection(SymmetricSection):
    """Any doubly symmetric section, by its integrals.

    Args:
        area: m^2.
        second_moment_y: integral of z^2 dA (m^4); resists bending along z.
        second_moment_z: integral of y^2 dA (m^4); resists bending along y.
        torsion_constant: Saint-Venant's (m^4).
        shear_correction: share of the area that bears shear: one number, or two, along y and along z.
    """

    area: float
    second_moment_y: float
    second_moment_z: float
    torsion_constant: float
    shear_correction: Pair = 5 / 6
    type: ClassVar[str] = "general"

    def _made(self) -> Any:
        sizes = (self.area, self.second_moment_y, self.second_moment_z, self.torsion_constant)
        return _core.Section(*sizes, _both(self.shear_correction))


_ROWS = ("extension", "shear_y", "shear_z", "torsion", "bending_z", "bending_y")  # of a SectionMatrix, by strains


@dataclass(frozen=True)
class SectionMatrix(Section):
    """Any section, by its stiffness and its inertia per unit length. It holds its material: a beam of it has none.

    Rows and columns stand for x, y, z (force or velocity), then about x, y, z (moment or angular velocity), with x
    along the beam, all at the beam's axis: N, V_y, V_z, M_x, M_y, M_z = stiffness @ (eps, phi12, phi13, K1, K2, K3),
    the strains of `Arm.strain`. Couplings of bending with torsion, of stretch with bending, and so on are its entries
    off the diagonal: where the shear centre or the neutral axis is off the beam's axis, or plies lie at an angle. A
    strain without modes stays zero, even if it is coupled to others.

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

    def _made(self) -> Any:
        matrices = [array(name, getattr(self, name), (6, 6)) for name in ("stiffness", "inertia")]
        for name, matrix in zip(("stiffness", "inertia"), matrices, strict=True):
            self._set(name, tuple(tuple(row) for row in matrix.tolist()))
        return _core.SectionMatrix(*matrices)

    @classmethod
    def of(
        cls, section: SymmetricSection, material: Material, *, y: float = 0.0, z: float = 0.0, angle: float = 0.0
    ) -> SectionMatrix:
        """The matrices of a doubly symmetric section, turned and off the beam's axis.

        Args:
            section: a Rectangle, Circle, ... or GeneralSection.
            material: with poisson_ratio or shear_modulus.
            y, z: where its centre lies from the beam's axis (m).
            angle: of its own y from the beam's (rad), about x.

        Warns:
            ModelWarning: an angle of more than a turn, as if in degrees.
        """
        instance("section", section, SymmetricSection, "a doubly symmetric one, as Rectangle")
        instance("material", material, Material)
        if material.shear_modulus is None and material.poisson_ratio is None:
            raise ValueError(f"material = {material!r}: must have a poisson_ratio or a shear_modulus")
        s, E, G = section._core, material.youngs_modulus, material._core.shear_modulus
        shear_y, shear_z = (G * k * s.area for k in s.shear_correction)
        iy, iz = s.second_moment_y, s.second_moment_z
        K = np.diag([E * s.area, shear_y, shear_z, G * s.torsion_constant, E * iy, E * iz])
        M = material.density * np.diag([s.area, s.area, s.area, iy + iz, iy, iz])
        y, z, angle = (float(array(name, v, ())) for name, v in (("y", y), ("z", z), ("angle", angle)))
        if abs(angle) > 2 * np.pi:
            warn(f"angle = {angle:g} rad of a section: is it in degrees?", ModelWarning)
        cosine, sine = np.cos(angle), np.sin(angle)
        R = np.array([[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]])
        c = tilde((0.0, y, z))
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
        """The diagonal entry of the stiffness for "bending_y" and so on (N m^2, N)."""
        row = _ROWS.index(strain)
        return self.stiffness[row][row]

    def coupling(self, one: str, other: str) -> float:
        """The share of its stiffness that a strain loses if the other is free, from 0 to 1."""
        size = self.rigidity(one) * self.rigidity(other)
        return self.stiffness[_ROWS.index(one)][_ROWS.index(other)] ** 2 / size if size else 0.0

    @property
    def off_axis(self) -> bool:
        """Whether its inertia has a centre of mass off the beam's axis, or products of inertia."""
        J = np.array(self._core.inertia_about_com)
        return any(self.com) or bool((J != np.diag(np.diag(J))).any())
