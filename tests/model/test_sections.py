"""Sections by their sides, against Saint-Venant's equations solved by finite elements."""

from __future__ import annotations

from typing import Any

import flexarm as fa
import numpy as np
import pytest
from messages import refuses
from model.saint_venant import Mesh, grid, lines

STEEL = fa.Material(7850.0, 209e9, poisson_ratio=0.3)


def mesh(section: Any) -> Mesh:
    if isinstance(section, fa.Tube):
        radii = np.linspace(section.radius - section.thickness, section.radius, 9)
        return grid(radii, np.linspace(0, 2 * np.pi, 97), lambda r, a: (r * np.cos(a), r * np.sin(a)), ring=True)
    y, z = section.y / 2, section.z / 2
    if isinstance(section, fa.sections.Ellipse):
        side = np.linspace(-1, 1, 33)
        return grid(side, side, lambda u, v: (y * u * np.sqrt(1 - v * v / 2), z * v * np.sqrt(1 - u * u / 2)))
    if isinstance(section, fa.sections.Box):
        t, s = np.broadcast_to(section.thickness, 2)
        wall = lambda u, v: (np.abs(u) > y - t) | (np.abs(v) > z - s)  # noqa: E731
        return grid(lines(-y, t - y, y - t, y), lines(-z, s - z, z - s, z), keep=wall)
    if isinstance(section, fa.sections.IBeam):
        f, w = section.flange, section.web / 2
        both = lambda u, v: (np.abs(u) > y - f) | (np.abs(v) < w)  # noqa: E731
        return grid(lines(-y, f - y, y - f, y), lines(-z, -w, w, z), keep=both)
    return grid(lines(-y, y, n=20), lines(-z, z, n=20))


SHAPES = [  # with how far off the torsion constant and the two shear corrections may be
    (fa.Rectangle(0.5, 0.3), 2e-5, 1e-4, 1e-4),  # 5/6 is that of a rectangle without Poisson's ratio
    (fa.Tube(1.0, 0.3), 3e-5, 1e-5, 1e-5),
    (fa.Tube(1.0, 0.02), 3e-5, 1e-5, 1e-5),
    (fa.sections.Ellipse(2.0, 0.8), 1e-5, 1e-5, 1e-5),
    (fa.sections.Ellipse(1.0, 1.0), 1e-5, 1e-5, 1e-5),
    (fa.sections.Box(1.0, 1.0, 0.02), 5e-4, 0.01, 0.01),
    (fa.sections.Box(1.0, 1.0, 0.1), 5e-4, 0.02, 0.02),
    (fa.sections.Box(1.0, 0.5, 0.05), 5e-4, 0.03, 0.03),
    (fa.sections.Box(1.0, 0.5, 0.1), 5e-4, 0.06, 0.06),
    (fa.sections.Box(1.0, 0.8, (0.02, 0.1)), 5e-4, 0.04, 0.04),
    (fa.sections.Box(1.0, 0.8, (0.2, 0.05)), 5e-4, 0.06, 0.06),
    (fa.sections.Box(1.0, 1.0, 0.45), 3e-3, 0.3, 0.3),
    (fa.sections.IBeam(1.0, 0.6, 0.05, 0.03), 2e-3, 0.02, 0.01),
    (fa.sections.IBeam(1.0, 0.6, 0.05, 0.01), 2e-3, 0.02, 0.01),
    (fa.sections.IBeam(1.0, 0.6, 0.05, 0.1), 2e-3, 0.02, 0.01),
    (fa.sections.IBeam(1.0, 1.0, 0.1, 0.1), 2e-3, 0.03, 0.02),
    (fa.sections.IBeam(1.0, 0.6, 0.02, 0.06), 2e-3, 0.02, 0.03),
]


@pytest.mark.parametrize(("section", "torsion", "along_y", "along_z"), SHAPES, ids=lambda v: str(v))
def test_a_shape_has_saint_venants_integrals(section: Any, torsion: float, along_y: float, along_z: float) -> None:
    m = mesh(section)
    area = m.integral(np.ones_like(m.y))
    exact = {"area": area, "second_moment_y": m.integral(m.z**2), "second_moment_z": m.integral(m.y**2)}
    for name, value in exact.items():
        assert getattr(section, name) == pytest.approx(value, rel=1e-5), name
    assert section.torsion_constant == pytest.approx(m.torsion_constant(), rel=torsion)
    y, z = section.shear_areas
    assert y / area == pytest.approx(m.shear_correction("y"), rel=along_y)
    assert z / area == pytest.approx(m.shear_correction("z"), rel=along_z)


def test_a_faces_shear_in_torsion_is_that_of_the_wall() -> None:
    """Of a box and a flange, over the middle of the face, per twist and distance; see Patch."""
    for section, axis in (
        (fa.sections.Box(1.0, 0.6, (0.04, 0.02)), "y"),
        (fa.sections.Box(1.0, 0.6, (0.04, 0.02)), "z"),
        (fa.sections.IBeam(1.0, 0.6, 0.04, 0.01), "y"),
    ):
        face = section._face(axis)
        assert face.twist * face.distance == pytest.approx(mesh(section).surface_shear(axis, face.distance), rel=0.02)


def test_limits_are_the_shapes_they_ought_to_be() -> None:
    disc, circle = fa.sections.Ellipse(0.2, 0.2), fa.Circle(0.1)
    tube, bore = fa.Tube(0.1, 0.02), fa.Circle(0.1, 0.08)
    for one, two in ((disc, circle), (tube, bore)):
        for name in ("area", "second_moment_y", "second_moment_z", "torsion_constant"):
            assert getattr(one, name) == pytest.approx(getattr(two, name), rel=1e-12)
    thin = fa.sections.Box(1.0, 0.5, 1e-4)
    assert thin.torsion_constant == pytest.approx(2e-4 * 0.25 / 1.5, rel=1e-3)  # Bredt
    assert fa.Tube(1.0, 1e-4).shear_areas[0] == pytest.approx(np.pi * 1e-4, rel=1e-3)  # half the area
    wide = fa.sections.IBeam(1.0, 40.0, 0.01, 0.01)
    assert wide.torsion_constant == pytest.approx(81 * 1e-6 / 3, rel=1e-3)  # thin strips
    assert fa.sections.Ellipse(2.0, 1.0)._reach("y") == 1.0 and fa.sections.Ellipse(2.0, 1.0)._face("y") is None
    assert fa.sections.IBeam(1.0, 0.5, 0.1, 0.1)._face("z") is None


def test_shear_may_differ_along_the_two_axes() -> None:
    def shear(section: Any, axis: str) -> float:
        beam = fa.Beam(1.0, section, STEEL, {f"shear_{axis}": 1}, basis="legendre")
        return float(np.asarray(beam._core.stiffness)[0, 0])

    G = 209e9 / 2.6
    for section in (
        fa.Rectangle(0.1, 0.2, (0.5, 0.25)),
        fa.sections.GeneralSection(0.02, 1e-4, 1e-4, 1e-4, (0.5, 0.25)),
    ):
        assert shear(section, "y") == pytest.approx(0.5 * 0.02 * G) == 2 * shear(section, "z")
    beam = fa.sections.IBeam(0.1, 0.06, 0.005, 0.003)
    assert [shear(beam, a) for a in "yz"] == pytest.approx([G * a for a in beam.shear_areas])


def test_a_thin_web_shears_more_than_a_full_section() -> None:
    """Of the tip's deflection 3 E I / (G A_s L^2) is shear, which is found above 5 %."""
    full, thin = fa.Rectangle(0.1, 0.06), fa.sections.IBeam(0.1, 0.06, 0.005, 0.001)
    beams = [fa.Beam(0.8, section, STEEL, {"bending_y": 1}) for section in (full, thin)]
    share = 3 * 2.6 * thin.second_moment_z / (thin.shear_areas[0] * 0.8**2)
    assert not fa.check(fa.Arm([fa.Link(fa.Fixed(), beam=beams[0])]))
    (found,) = fa.check(fa.Arm([fa.Link(fa.Fixed(), beam=beams[1])]))
    assert "shear adds" in found.what and found.value == pytest.approx(100 * share)


TAPERED = [
    (fa.Tube(0.02, 0.004), fa.Tube(0.01, 0.002), fa.Tube(0.015, 0.003)),
    (fa.sections.Ellipse(0.02, 0.04), fa.sections.Ellipse(0.01, 0.02), fa.sections.Ellipse(0.015, 0.03)),
    (
        fa.sections.Box(0.02, 0.04, 0.004),
        fa.sections.Box(0.01, 0.02, (0.002, 0.004)),
        fa.sections.Box(0.015, 0.03, (0.003, 0.004)),
    ),
    (
        fa.sections.IBeam(0.04, 0.02, 0.004, 0.002),
        fa.sections.IBeam(0.02, 0.02, 0.002, 0.002),
        fa.sections.IBeam(0.03, 0.02, 0.003, 0.002),
    ),
]


@pytest.mark.parametrize(("root", "tip", "middle"), TAPERED)
def test_tapers_go_by_the_sides(root: Any, tip: Any, middle: Any) -> None:
    assert fa.sections.Taper((0.0, 1.0), (root, tip)).at(0.5) == middle
    given = type(tip)(**{**tip._arguments(), "shear_correction": 0.5})
    y, z = fa.sections.Taper((0.0, 1.0), (root, given)).at(0.5).shear_correction
    assert (y, z) == pytest.approx([(k + 0.5) / 2 for k in root._core.shear_correction])
    mixed = fa.sections.Taper((0.0, 1.0), (root, fa.Rectangle(0.01, 0.01))).at(0.5)
    assert mixed.area == pytest.approx((root.area + 1e-4) / 2)


def test_arms_of_them_are_kept() -> None:
    for section in (s for s, *_ in SHAPES):
        arm = fa.Arm([fa.Link(fa.Fixed(), beam=fa.Beam(50 * section._reach("y"), section, STEEL, {"bending_y": 1}))])
        assert fa.Arm.from_dict(arm.to_dict()) == arm and str(arm)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: fa.Tube(0.1, 0.1), "thickness = 0.1"),
        (lambda: fa.Tube(-0.1, 0.1), "radius = -0.1"),
        (lambda: fa.sections.Ellipse(0.1, np.nan), "z = nan"),
        (lambda: fa.sections.Box(0.1, 0.2, 0.05), "thickness = 0.05"),
        (lambda: fa.sections.Box(0.1, 0.2, (0.01, 0.1)), "thickness = 0.1"),
        (lambda: fa.sections.Box(0.1, 0.2, (0.01, 0.1, 0.1)), ("thickness =", "number")),
        (lambda: fa.sections.IBeam(0.1, 0.1, 0.05, 0.01), "flange = 0.05"),
        (lambda: fa.sections.IBeam(0.1, 0.1, 0.01, 0.1), "web = 0.1"),
        (lambda: fa.sections.IBeam(0.1, 0.1, 0.01, "thin"), "web = 'thin'"),
        (lambda: fa.sections.Box(0.1, 0.2, 0.01, 0.0), "shear_correction = 0"),
        (lambda: fa.Rectangle(0.1, 0.2, (0.5,)), ("shear_correction =", "number")),
    ],
)
def test_bad_sections(make: Any, message: str) -> None:
    with refuses(message):
        make()
