"""Sections of any outline, by finite elements of the library sectionproperties."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..._check import Array, array, instance, tilde, whole, within
from .material import Material
from .sections import SectionMatrix

Points = Sequence[Sequence[float]]

_MOST = 100_000  # elements: they need some gigabytes
_PATIENCE = 5  # largest number of elements that thin parts may need, in multiples of the number asked for
_ROUNDING = 1e-12  # of the section's size


def polygon(points: Points, material: Material, holes: Sequence[Points] = (), elements: int = 1000) -> SectionMatrix:
    """Section of any outline, about the origin of its points: the beam's axis.

    Torsion is Saint-Venant's, with free warping, about the shear centre; bending is about the centroid; shear has the
    energy of the shear flow with Poisson's ratio zero, as in the other sections. Where these points differ from the
    origin, or the axes are not principal, the matrix has couplings.

    Args:
        points: (n, 2), y and z of the corners (m), in turn.
        material: with poisson_ratio or shear_modulus.
        holes: outlines of holes, as `points`.
        elements: how many triangles the section is divided into, about, 20 to 100 000. Thin walls need more: two across
            them.

    Returns:
        SectionMatrix, which holds the material.

    Raises:
        ImportError: without sectionproperties: pip install 'flexarm[sections]'.
        ValueError: naming the field and the value.
    """
    try:
        from sectionproperties.analysis.section import Section
        from sectionproperties.pre.geometry import Geometry
    except ImportError as e:
        raise ImportError(f"polygon needs sectionproperties: pip install 'flexarm[sections]' ({e})") from e
    instance("material", material, Material)
    if not material._core.shear_modulus > 0.0:
        raise ValueError(f"material = {material!r}: must have a poisson_ratio or a shear_modulus")
    within("elements", whole("elements", elements), 20, _MOST)
    if not isinstance(holes, (list, tuple, np.ndarray)):
        raise ValueError(f"holes = {holes!r}: must be a list of outlines")
    outline, inner = _corners("points", points), [_corners(f"holes[{k}]", h) for k, h in enumerate(holes)]
    at, size = outline.mean(axis=0), float(np.ptp(outline, axis=0).max())
    shape = _shape(outline, inner, at, size)
    needed, thin = _triangles_across(shape)
    if needed > _PATIENCE * elements:
        thin_parts = f"parts are as thin as {thin * size:.2g} m, and take about {needed:.2g} triangles of even sides"
        many = f"give elements={int(needed)} if they are meant" if needed <= _MOST else f"no more than {_MOST} may be"
        raise ValueError(f"points, holes: {thin_parts} (elements = {elements}): {many}; or leave out slivers and gaps")
    geometry = Geometry(shape).create_mesh(mesh_sizes=[shape.area / elements])
    section = Section(geometry)
    section.calculate_geometric_properties()
    section.calculate_warping_properties()
    return _assembled(section.section_props, section.get_sc(), material, at, size)


def _corners(field: str, points: Any) -> Array:
    out = array(field, points)
    if out.ndim != 2 or out.shape[1] != 2 or len(out) < 3:
        raise ValueError(f"{field} has shape {out.shape}: must be three corners (y, z) or more")
    if not np.ptp(out, axis=0).min() > 0.0:
        raise ValueError(f"{field}: must enclose an area; all its corners lie on a line")
    return out


def _shape(outline: Array, holes: Sequence[Array], at: Array, size: float) -> Any:
    """The section, of unit size about the origin."""
    from shapely import Polygon, remove_repeated_points
    from shapely.validation import explain_validity

    for field, one in (("points", outline), *((f"holes[{k}]", h) for k, h in enumerate(holes))):
        if not Polygon(one).is_valid:
            raise ValueError(f"{field}: must not cross itself: {explain_validity(Polygon(one))} (m)")
    for k, hole in enumerate(holes):
        if not Polygon(outline).contains_properly(Polygon(hole)):
            raise ValueError(f"holes[{k}]: must lie inside the outline, and not touch it")
    shape = remove_repeated_points(Polygon((outline - at) / size, [(h - at) / size for h in holes]), _ROUNDING)
    if not shape.is_valid:
        raise ValueError(f"holes: must not touch nor overlap: {explain_validity(shape)}")
    return shape


def _triangles_across(shape: Any) -> tuple[float, float]:
    """The number of triangles with even sides for a section of unit size, with about one across its thin parts, and the
    thickness that needs most of them. Erosion by d / 2, then growth by d / 2, removes the parts thinner than d."""
    lost = [0.0]
    while len(lost) == 1 or (lost[-1] > 1e-13 and len(lost) < 42):
        d = 0.5 ** (len(lost) - 1)
        thick = shape.buffer(-0.5 * d, join_style="mitre").buffer(0.5 * d, join_style="mitre")
        lost.append(shape.area - thick.intersection(shape).area)
    between = np.clip(-np.diff([*lost[1:], 0.0]), 0.0, None)  # thickness from d / 2 to d
    mean = 0.75 * 0.5 ** np.arange(len(between))
    count = between / (0.25 * np.sqrt(3.0) * mean**2)
    return float(count.sum()), float(mean[count.argmax()])


def _rounded(values: Array, size: float) -> Array:
    """Values with rounding errors set to zero, so that a centre on the axis is exactly on it."""
    return np.where(np.abs(values) < _ROUNDING * size, 0.0, values)


def _assembled(of: Any, shear_centre: tuple[float, float], material: Material, at: Array, size: float) -> SectionMatrix:
    """Matrices about the origin, from the properties of the section of unit size, whose x and y are the beam's y, z."""
    E, G, density = material.youngs_modulus, material._core.shear_modulus, material.density
    (y, z), (ys, zs) = (_rounded(at + size * np.array(c), size) for c in ((of.cx, of.cy), shear_centre))
    area = size**2 * of.area
    iy, iz, iyz = size**4 * _rounded(np.array([of.ixx_c, of.iyy_c, of.ixy_c]), of.ixx_c + of.iyy_c)
    # strains at the centroid (eps, K2, K3; a fibre is strained by eps + z K2 - y K3) and at the shear centre (phi12,
    # phi13, K1), by those at the origin
    T = np.eye(6)
    T[0, 4:] = z, -y
    T[1:3, 3] = -zs, ys
    K = np.zeros((6, 6))
    K[0, 0], K[3, 3] = E * area, G * size**4 * of.j
    K[4:, 4:] = E * np.array([[iy, -iyz], [-iyz, iz]])
    flexible = np.array([[1 / of.a_sx, 1 / of.a_sxy], [1 / of.a_sxy, 1 / of.a_sy]])
    K[1:3, 1:3] = G * size**2 * np.linalg.inv(flexible)
    m, c = density * area, tilde((0.0, y, z))
    about = density * np.array([[iy + iz, 0, 0], [0, iy, -iyz], [0, -iyz, iz]]) - m * c @ c
    stiffness, inertia = T.T @ K @ T, np.block([[m * np.eye(3), -m * c], [m * c, about]])
    return SectionMatrix(*((0.5 * (A + A.T) + 0.0).tolist() for A in (stiffness, inertia)))
