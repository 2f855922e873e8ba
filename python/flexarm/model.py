"""The parts of an arm: materials, sections, beams, rigid bodies, joints and links.

Each part is an immutable dataclass; the C++ core checks its numbers when it is made. SI units throughout: m, kg, s, N,
Pa, rad. Axes of a beam: x along the undeformed neutral axis, y and z the principal axes of its section.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from . import _core
from ._check import array, known_keys, number, whole

STRAINS = ("bending_y", "bending_z", "torsion", "shear_y", "shear_z")
Vector = Sequence[float]


class _Part:
    """Holds the core's counterpart in `_core`, outside equality, printing and pickling."""

    _core: Any

    def _set(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)  # dataclasses here are frozen

    def _arguments(self) -> dict[str, Any]:
        return {f.name: getattr(self, f.name) for f in fields(self) if f.init}  # type: ignore[arg-type]

    def __reduce__(self) -> Any:
        plain = {k: dict(v) if isinstance(v, Mapping) else v for k, v in self._arguments().items()}
        return _rebuild, (type(self), plain)

    def to_dict(self) -> dict[str, Any]:
        """The same structure as in a scene file."""
        out: dict[str, Any] = {}
        kind = getattr(self, "type", None)
        if kind is not None:
            out["type"] = kind
        for name, value in self._arguments().items():
            if value is not None:
                out[name] = value.to_dict() if isinstance(value, _Part) else _plain(value)
        return out


def _rebuild(cls: type, arguments: dict[str, Any]) -> Any:
    return cls(**arguments)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, (tuple, list)):
        return [_plain(v) for v in value]
    return value


@dataclass(frozen=True)
class Material(_Part):
    """Linear elastic material: density (kg/m^3), youngs_modulus (Pa), and, for torsion and shear, poisson_ratio or
    shear_modulus (Pa), not both."""

    density: float
    youngs_modulus: float
    poisson_ratio: float | None = None
    shear_modulus: float | None = None
    _core: _core.Material = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        for f in ("density", "youngs_modulus", "poisson_ratio", "shear_modulus"):
            if getattr(self, f) is not None:
                self._set(f, number(f, getattr(self, f)))
        self._set(
            "_core",
            _core.Material(self.density, self.youngs_modulus, self.poisson_ratio, self.shear_modulus),
        )


class _Section(_Part):
    _core: _core.Section


class _Shape(_Section):
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
class Rectangle(_Shape):
    """Full rectangle with sides y and z (m). The torsion constant comes from Saint-Venant's series."""

    y: float
    z: float
    shear_correction: float = 5 / 6
    type: ClassVar[str] = "rectangle"
    _core: _core.Section = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        for f in ("y", "z", "shear_correction"):
            self._set(f, number(f, getattr(self, f)))
        self._set("_core", _core.Section.rectangle(self.y, self.z, self.shear_correction))


@dataclass(frozen=True)
class Circle(_Shape):
    """Disc of a radius (m), or a tube when `inner_radius` (m) is above zero."""

    radius: float
    inner_radius: float = 0.0
    shear_correction: float = 9 / 10
    type: ClassVar[str] = "circle"
    _core: _core.Section = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        for f in ("radius", "inner_radius", "shear_correction"):
            self._set(f, number(f, getattr(self, f)))
        self._set("_core", _core.Section.circle(self.radius, self.inner_radius, self.shear_correction))


@dataclass(frozen=True)
class GeneralSection(_Section):
    """Any doubly symmetric section, by its integrals (m^2, m^4). `second_moment_z` = integral of y^2 dA."""

    area: float
    second_moment_y: float
    second_moment_z: float
    torsion_constant: float
    shear_correction: float = 5 / 6
    type: ClassVar[str] = "general"
    _core: _core.Section = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        names = ("area", "second_moment_y", "second_moment_z", "torsion_constant", "shear_correction")
        for f in names:
            self._set(f, number(f, getattr(self, f)))
        self._set("_core", _core.Section(*(getattr(self, f) for f in names)))


Section = Rectangle | Circle | GeneralSection


@dataclass(frozen=True)
class Beam(_Part):
    """Uniform elastic beam along x, clamped to its link's hub at X = 0 (paper Sec. 3).

    Args:
        length: m.
        section, material: see those classes.
        modes: number of shape functions of each strain, `bending_y`, `bending_z`, `torsion`, `shear_y`, `shear_z`;
            those left out are zero. The beam's elastic coordinates stand in that order (Eq. 33).
        basis: "clamped-free" (Euler-Bernoulli clamped-free modes; sines for torsion and shear; each 1 at X = L, so that
            a coordinate is its share of the tip's deflection in m, or of its twist in rad) or "legendre" (Legendre
            polynomials as strains, so that a coordinate is a curvature or twist in 1/m, or a shear angle in rad; well
            conditioned at any count).
        order: of the rotation of the sections (Eq. 26). 0 is the paper's simplified model, which neither stiffens nor
            softens with speed; 1 softens; 2 has the right centrifugal stiffening; 3 and
            "exact" (no truncation) are for large bending and cost more.
        rotary_inertia: whether slices have rotary inertia.
        damping_ratio: modal, of every mode of the beam clamped at its base.
        kelvin_voigt: retardation time (s) of the material: stress = E (strain + kelvin_voigt d(strain)/dt).
        gauss_points: slices that carry the inertia; None lets the basis choose enough for about 1e-12.

    Raises:
        ValueError: naming the field and the value.
    """

    length: float
    section: Section
    material: Material
    modes: Mapping[str, int]
    basis: str = "clamped-free"
    order: int | str = 2
    rotary_inertia: bool = True
    damping_ratio: float = 0.0
    kelvin_voigt: float = 0.0
    gauss_points: int | None = None
    _core: _core.Beam = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        self._set("length", number("length", self.length))
        for name in ("damping_ratio", "kelvin_voigt"):
            self._set(name, number(name, getattr(self, name)))
        if not isinstance(self.section, _Section):
            raise ValueError(f"section = {self.section!r}: must be a Rectangle, Circle or GeneralSection")
        if not isinstance(self.material, Material):
            raise ValueError(f"material = {self.material!r}: must be a Material")
        known_keys("modes", self.modes, STRAINS)
        counts = [whole(f"modes.{s}", self.modes.get(s, 0)) for s in STRAINS]
        self._set("modes", MappingProxyType({s: n for s, n in zip(STRAINS, counts, strict=True) if n != 0}))
        if not isinstance(self.rotary_inertia, bool):
            raise ValueError(f"rotary_inertia = {self.rotary_inertia!r}: must be true or false")
        if not isinstance(self.basis, str):
            raise ValueError(f'basis = {self.basis!r}: must be "clamped-free" or "legendre"')
        order = self.order if isinstance(self.order, str) else whole("order", self.order)
        if order not in (0, 1, 2, 3, "exact"):
            raise ValueError(f'order = {self.order!r}: must be 0, 1, 2, 3 or "exact"')
        self._set("order", order)
        points = 0
        if self.gauss_points is not None:
            points = whole("gauss_points", self.gauss_points)
            if points < 1:
                raise ValueError(f"gauss_points = {points}: must be from 1 to 400, or left out")
            self._set("gauss_points", points)
        core = _core.Beam(
            self.length,
            self.section._core,
            self.material._core,
            counts,
            self.basis,
            4 if order == "exact" else int(order),
            self.rotary_inertia,
            self.damping_ratio,
            self.kelvin_voigt,
            points,
        )
        self._set("_core", core)

    @property
    def mass(self) -> float:
        """kg"""
        return float(self._core.mass)

    @property
    def ne(self) -> int:
        """Number of elastic coordinates."""
        return sum(self.modes.values())


def _inertia_matrix(value: Any) -> Any:
    """3 numbers: diagonal; 6: xx yy zz xy xz yz; or a 3 x 3 matrix."""
    a = array("inertia", value)
    if a.shape == (3,):
        return np.diag(a)
    if a.shape == (6,):
        xx, yy, zz, xy, xz, yz = a
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if a.shape == (3, 3):
        return a
    raise ValueError(f"inertia has shape {a.shape}: must be 3 numbers, 6 (xx yy zz xy xz yz) or a 3 x 3 matrix")


def _numbers(value: Any) -> Any:
    """Nested tuples of floats, so that parts compare, print and pickle plainly."""
    return tuple(_numbers(v) if np.ndim(v) else float(v) for v in value)


@dataclass(frozen=True)
class RigidBody(_Part):
    """Rigid hub or tip of a link.

    Args:
        mass: kg.
        com: centre of mass in body axes (m).
        inertia: about the centre of mass, body axes (kg m^2): 3 numbers (diagonal), 6 (xx yy zz xy xz yz, the entries
            of the matrix) or a symmetric 3 x 3 matrix.
        end: where the next body, or the next link's joint, begins, in body axes (m).
    """

    mass: float = 0.0
    com: Vector = (0.0, 0.0, 0.0)
    inertia: Any = (0.0, 0.0, 0.0)
    end: Vector = (0.0, 0.0, 0.0)
    _core: _core.RigidBody = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        self._set("mass", number("mass", self.mass))
        com, end = array("com", self.com, (3,)), array("end", self.end, (3,))
        inertia = _inertia_matrix(self.inertia)
        for name in ("com", "inertia", "end"):
            self._set(name, _numbers(getattr(self, name)))
        self._set("_core", _core.RigidBody(self.mass, com, inertia, end))
