"""Beams and rigid bodies.

Each part is an immutable dataclass; the C++ core checks its numbers when it is made. SI units throughout: m, kg, s, N,
Pa, rad. Axes of a beam: x along the undeformed neutral axis, y and z the principal axes of its section.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np

import flexarm._core as _core

from ..._check import array, instances, known_keys, number, positive, whole, within
from .material import Material
from .part import Part, Place, one_of
from .patch import Patch, core_patches
from .sections import Section, SectionMatrix
from .shapes import coefficients, columns, curvature, kept_curvature
from .taper import Taper

STRAINS = _core.STRAINS  #: "bending_y" and so on, in the order of a beam's coordinates (Eq. 33)
STRAIN_NAMES = _core.STRAIN_NAMES  #: "K1" and so on, of a section, as Arm.strain orders them
Vector = Sequence[float]


@dataclass(frozen=True)
class Beam(Part):
    """Elastic beam along x, clamped to its link's hub at X = 0. (Sec. 3)

    Args:
        length: m.
        section: a Rectangle, Circle, Tube, Ellipse, Box, IBeam, GeneralSection or SectionMatrix, or a Taper of these.
        material: a Material; None for a SectionMatrix, which has its own.
        modes: must be given: for each strain, `bending_y`, `bending_z`, `torsion`, `shear_y`, `shear_z`, `extension`,
            how many shape functions of the basis, or a list of strain shapes of your own; those left out are zero. The
            beam's elastic coordinates have that order (Eq. 33; the paper has no extension). Each shape of your own
            is a callable of x (m), samples at equal steps from the clamp to the tip, {"x": ..., "strain": ...} or
            Legendre coefficients {"legendre": ...}; it is the strain (Eq. 28-32): the curvature v'' of bending, not the
            deflection. They must be independent. Sections move by x' = R (1 + eps, phi12, phi13), with eps the
            extension: of its terms orders 0 and 1 have eps itself, order 2 its products with a slope too, order 3 those
            with two slopes. At orders 0 to 2 a beam that stretches is computed in space, even if it moves in a
            plane; order 3 is then faster.
        basis: "clamped-free" (Euler-Bernoulli clamped-free modes; sines for torsion, shear and extension; each 1 at
            X = L, so that a coordinate is its share of the tip's displacement in m, or of its twist in rad), "legendre"
            (Legendre polynomials as strains, so that a coordinate is a curvature or twist in 1/m, a shear angle in rad
            or a stretch; well conditioned at any count), or "loaded" (modes of this beam, tapered or not,
            clamped, with `basis_tip` on its end; each 1 at its largest deflection). Clamped-free modes suit a beam that
            carries nothing: they have no curvature at the end, where a payload or another link bends the beam. Three
            or more Legendre polynomials represent this; `fa.check` says if it matters.
        order: of the rotation of the sections (Eq. 26). 0 is the paper's simplified model, which neither stiffens nor
            softens with speed; 1 softens; 2 has the right centrifugal stiffening; 3 and
            "exact" (no truncation) are for large bending and cost more.
        rotary_inertia: whether slices have rotary inertia.
        damping_ratio: modal damping ratio of every mode of the beam clamped at its base, 0 to 1; 2 % is 0.02.
        kelvin_voigt: retardation time (s) of the material: stress = E (strain + kelvin_voigt d(strain)/dt); or one for
            each strain, by name; those left out are zero.
        damping: further damping, as a matrix of the elastic coordinates, (ne, ne), symmetric, without negative
            eigenvalues: forces damping @ rates. `Arm.modal_damping` and `Arm.rayleigh_damping` make such matrices.
        gauss_points: slices that carry the inertia, and points along which order "exact" integrates the rotation. None
            lets the basis choose enough for about 1e-12; in "exact" beams that turn their sections by far more than a
            radian these may be too few; then a RangeWarning says so. With None, uniform beams of order 3
            and "exact" take fewer of them while their coordinates are so small that only rounding errors change.
        basis_tip: the body that the modes of the loaded basis carry on the beam's end; its mass, com along x and
            principal inertia are used. It changes only the basis; the load itself is the link's `tip`. None: the modes
            carry nothing, even if the link has a tip (then `fa.check` says so).
        patches: piezoelectric patches; see Patch. The loaded basis ignores them.
        curvature: at rest, with no stress (1/m): twist K1 and curvatures K2, K3, about the section's x, y and z as the
            strains are (K3 > 0 bends towards +y, K2 > 0 towards -z). Three numbers; a smooth callable of x (m); samples
            {"x": ..., "K": ...} or (x, K), K (n, 3), through which a spline goes; or Legendre coefficients {"legendre":
            three lists}. None: straight. The elastic coordinates are the strains beyond it (q = 0 is the shape at
            rest) in the axes of the sections, which turn with it. It needs order "exact": the other orders are series
            about a straight beam. A basis has the modes of the straight beam; a damping ratio is of the curved beam's.
    """

    length: float
    section: Section | Taper
    material: Material | None = None
    modes: Mapping[str, Any] = None  # type: ignore[assignment]  # must be given
    basis: Annotated[str, one_of("clamped-free", "legendre", "loaded")] = "clamped-free"
    order: int | str = 2
    _: KW_ONLY
    rotary_inertia: bool = True
    damping_ratio: float = 0.0
    kelvin_voigt: float | Mapping[str, float] = 0.0
    damping: Sequence[Sequence[float]] = ()
    gauss_points: int | None = None
    basis_tip: RigidBody | None = None
    patches: Sequence[Patch] = ()
    curvature: Any = None
    #: number of shape functions, for each strain with any
    counts: Mapping[str, int] = field(init=False, repr=False, compare=False)
    _core: _core.Beam = field(init=False, repr=False, compare=False)

    def _made(self) -> Any:
        damping = array("damping", self.damping)
        if damping.ndim != 2 and (damping.size or not damping.ndim):
            raise ValueError(f"damping has shape {damping.shape}: must be a matrix of the elastic coordinates")
        self._set("damping", as_floats(damping))
        if isinstance(self.section, Taper) and not abs(self.section.x[-1] - self.length) <= 1e-9 * self.length:
            raise ValueError(f"section.x = {self.section.x}: must end at the beam's length, {self.length} m")
        matrices = isinstance(self.section.at(0.0), SectionMatrix)
        if matrices and self.material is not None:
            raise ValueError(f"material = {self.material!r}: must be left out, for a SectionMatrix has its own")
        if not matrices and self.material is None:
            raise ValueError("material = None: must be a Material")
        if self.modes is None:
            raise ValueError("modes: missing: how many shape functions of each strain")
        order = self.order if isinstance(self.order, str) else whole("order", self.order)
        if order not in (0, 1, 2, 3, "exact"):
            raise ValueError(f'order = {self.order!r}: must be 0, 1, 2, 3 or "exact"')
        self._set("order", order)
        if self.gauss_points is not None:
            within("gauss_points", self.gauss_points, 1, 400, ", or left out")
        counts, own = self._read_modes()
        tip = self._read_tip()
        options = _core.BeamOptions(
            counts,
            self.basis,
            [columns(shapes) for shapes in own],
            4 if order == "exact" else int(order),
            self.rotary_inertia,
            self.damping_ratio,
            self._read_kelvin_voigt(),
            self.damping or np.zeros((0, 0)),
            self.gauss_points or 0,
            *tip,
            self._read_curvature(),
        )
        self._set("patches", instances("patches", self.patches, Patch, "Patch"))
        glued = core_patches(self.patches, self.section, self.length)
        made_of = () if self.material is None else (self.material._core,)
        core: Any = _core.Beam
        return core(self.length, self.section._core, *made_of, options, glued)

    def _read_modes(self) -> tuple[list[int], list[list[tuple[float, ...]]]]:
        known_keys("modes", self.modes, STRAINS)
        modes: dict[str, Any] = {}
        own: list[list[tuple[float, ...]]] = [[] for _ in STRAINS]
        for k, strain in enumerate(STRAINS):
            value = self.modes.get(strain, 0)
            if isinstance(value, (list, tuple)):
                positive("length", self.length)
                own[k] = [coefficients(f"modes.{strain}[{i}]", v, self.length) for i, v in enumerate(value)]
                modes[strain] = tuple(MappingProxyType({"legendre": c}) for c in own[k])
            elif callable(value) or np.ndim(value):
                raise ValueError(f"modes.{strain} = {value!r}: must be a whole number, or a list of strain shapes")
            else:
                modes[strain] = whole(f"modes.{strain}", value)
        counts = [len(own[k]) if own[k] else modes[s] or 0 for k, s in enumerate(STRAINS)]
        self._set("modes", MappingProxyType({s: m for s, m in modes.items() if m}))
        self._set("counts", MappingProxyType({s: n for s, n in zip(STRAINS, counts, strict=True) if n}))
        return counts, own

    def _read_kelvin_voigt(self) -> list[float]:
        times = self.kelvin_voigt
        if not isinstance(times, Mapping):
            self._set("kelvin_voigt", number("kelvin_voigt", times))
            return [number("kelvin_voigt", times)] * len(STRAINS)
        known_keys("kelvin_voigt", times, STRAINS)
        times = {s: number(f"kelvin_voigt.{s}", t) for s, t in times.items()}
        self._set("kelvin_voigt", MappingProxyType(times))
        return [times.get(s, 0.0) for s in STRAINS]

    def _read_curvature(self) -> Any:
        if self.curvature is None:
            return np.zeros((0, 0))
        positive("length", self.length)
        c = curvature("curvature", self.curvature, self.length)
        self._set("curvature", kept_curvature(c))
        return c if len(c) else np.zeros((0, 0))

    def _read_tip(self) -> tuple[float, float, Any]:
        if self.basis_tip is None:
            return 0.0, 0.0, np.zeros(3)
        if self.basis != "loaded":
            raise ValueError(f"basis_tip: goes with basis = 'loaded', not {self.basis!r}")
        return self.basis_tip.mass, self.basis_tip.com[0], np.diag(inertia_matrix(self.basis_tip.inertia))

    @property
    def mass(self) -> float:
        """kg"""
        return float(self._core.mass)

    @property
    def ne(self) -> int:
        """Number of elastic coordinates."""
        return sum(self.counts.values())


def inertia_matrix(value: Any) -> Any:
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


def as_floats(value: Any) -> Any:
    """Nested tuples of floats, so that parts compare, print and pickle simply."""
    return tuple(as_floats(v) if np.ndim(v) else float(v) for v in value)


@dataclass(frozen=True)
class RigidBody(Part):
    """Rigid hub or tip of a link.

    Args:
        mass: kg.
        com: centre of mass in body axes (m).
        inertia: about the centre of mass, body axes (kg m^2): 3 numbers (diagonal), 6 (xx yy zz xy xz yz, the entries
            of the matrix) or a symmetric 3 x 3 matrix. No principal moment is above the sum of the others, but in a
            plane one alone, about the axis of its joints, may be given.
        end: where the next body, or the next link's joint, begins, in body axes (m).
    """

    mass: float = 0.0
    com: Place = (0.0, 0.0, 0.0)
    inertia: Vector | Sequence[Vector] = (0.0, 0.0, 0.0)
    end: Place = (0.0, 0.0, 0.0)
    _core: _core.RigidBody = field(init=False, repr=False, compare=False)

    def _made(self) -> Any:
        made = _core.RigidBody(self.mass, np.array(self.com), inertia_matrix(self.inertia), np.array(self.end))
        self._set("inertia", as_floats(self.inertia))
        return made
