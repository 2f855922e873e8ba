"""Sections of any outline, against the shapes and closed forms."""

from __future__ import annotations

from typing import Any

import flexarm as fa
import numpy as np
import pytest
from arms import shear_modulus
from messages import refuses

pytest.importorskip("sectionproperties")

STEEL = fa.Material(7850.0, 209e9, poisson_ratio=0.3)


def rectangle(y: float, z: float) -> np.ndarray:
    return np.array([[-y, -z], [y, -z], [y, z], [-y, z]]) / 2


def close(one: fa.SectionMatrix, other: fa.SectionMatrix, rel: float) -> None:
    for name in ("stiffness", "inertia"):
        expected = np.array(getattr(other, name))
        size = np.sqrt(np.outer(expected.diagonal(), expected.diagonal()))
        np.testing.assert_allclose(np.array(getattr(one, name)) / size, expected / size, atol=rel, err_msg=name)


def test_a_rectangle_wherever_it_lies() -> None:
    corners = rectangle(0.01, 0.02)
    close(fa.sections.polygon(corners, STEEL), fa.SectionMatrix.of(fa.Rectangle(0.01, 0.02), STEEL), 1e-3)
    c, s = np.cos(0.4), np.sin(0.4)
    moved = corners @ np.array([[c, s], [-s, c]]) + (0.003, -0.008)
    expected = fa.SectionMatrix.of(fa.Rectangle(0.01, 0.02), STEEL, y=0.003, z=-0.008, angle=0.4)
    close(fa.sections.polygon(moved, STEEL), expected, 1e-3)


def test_a_symmetric_one_is_on_its_axis() -> None:
    """To the last bit, so that beams of it need no higher order."""
    section = fa.sections.polygon(rectangle(0.01, 0.02), STEEL)
    assert section.com == (0.0, 0.0) and not section.off_axis
    fa.Beam(0.5, section, modes={"bending_y": 2}, order=2)


def test_corners_that_repeat() -> None:
    once = rectangle(0.01, 0.02)
    again = fa.sections.polygon(np.vstack([once[:1], once, once[:1]]), STEEL)
    close(again, fa.sections.polygon(once, STEEL), 1e-6)


@pytest.mark.parametrize("thickness", [0.002, 0.005])
def test_a_hollow_one_is_the_box(thickness: float) -> None:
    inner = rectangle(0.04 - 2 * thickness, 0.06 - 2 * thickness)
    got = fa.sections.polygon(rectangle(0.04, 0.06), STEEL, holes=[inner])
    expected = fa.SectionMatrix.of(fa.sections.Box(0.04, 0.06, thickness), STEEL)
    close(got, expected, 0.03)  # so good is the box's shear; of the others:
    for k in (0, 3, 4, 5):
        assert got.stiffness[k][k] == pytest.approx(expected.stiffness[k][k], rel=1e-3)
    h, b = 0.04 - thickness, 0.06 - thickness
    bredt = 2 * thickness * (h * b) ** 2 / (h + b)
    assert got.stiffness[3][3] == pytest.approx(shear_modulus(STEEL) * bredt, rel=0.08)


def test_an_i_beams_outline_is_the_i_beam() -> None:
    y, z, f, w = 0.05, 0.03, 0.005, 0.002  # halves, and the flange
    right = [(-y, -z), (f - y, -z), (f - y, -w), (y - f, -w), (y - f, -z), (y, -z)]
    got = fa.sections.polygon([*right, *((a, -b) for a, b in reversed(right))], STEEL)
    expected = fa.SectionMatrix.of(fa.sections.IBeam(2 * y, 2 * z, f, 2 * w), STEEL)
    close(got, expected, 0.03)  # so good is its shear; of the others:
    for k in (0, 3, 4, 5):
        assert got.stiffness[k][k] == pytest.approx(expected.stiffness[k][k], rel=2e-3)


def test_a_channels_shear_centre() -> None:
    """Behind the web, 3 b^2 / (h + 6 b) from its middle (thin walls)."""
    h, b, t = 0.1, 0.05, 0.002
    y, z, w = b, h / 2 + t / 2, t / 2
    outline = [(-w, -z), (y, -z), (y, t - z), (w, t - z), (w, z - t), (y, z - t), (y, z), (-w, z)]
    section = fa.sections.polygon(outline, STEEL)
    F = np.linalg.inv(np.array(section.stiffness))
    assert -F[3, 2] / F[3, 3] == pytest.approx(-3 * b**2 / (h + 6 * b), rel=0.02)  # y of a force along z without twist
    assert F[3, 1] / F[3, 3] == pytest.approx(0.0, abs=1e-5)
    assert section.com == pytest.approx((b**2 / (h + 2 * b), 0.0), rel=0.02, abs=1e-6)
    assert 1 / F[3, 3] == pytest.approx(shear_modulus(STEEL) * (h + 2 * b) * t**3 / 3, rel=0.02)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"points": [[0, 0], [1, 0]]}, ("points has shape (2, 2)", "three corners")),
        ({"points": [[0, 0], [1, 0], [2, 0]]}, ("points", "enclose")),
        ({"points": [[0, 0], [1, 1], [1, 0], [0, 1]]}, ("points", "cross itself")),
        ({"points": [[0, 0], [1, np.nan], [1, 0]]}, ("points", "finite")),
        ({"holes": [rectangle(0.02, 0.001)]}, ("holes[0]", "inside", "outline")),
        ({"holes": [rectangle(0.002, 0.001), rectangle(0.001, 0.002)]}, ("holes", "overlap")),
        ({"material": fa.Material(1.0, 1.0)}, ("material =", "poisson_ratio")),
        ({"elements": 3}, ("elements = 3", "20 to 100000")),
        ({"elements": 10**9}, ("elements = 1000000000", "20")),
        ({"holes": 5}, "holes = 5"),
    ],
)
def test_bad_polygons(change: dict[str, Any], message: str) -> None:
    with refuses(message):
        fa.sections.polygon(**{"points": rectangle(0.01, 0.02), "material": STEEL} | change)


@pytest.mark.parametrize(
    ("points", "holes"),
    [
        ([(0, 0), (1e-2, 0), (1e-2, 1e-9), (0, 1e-9)], []),
        ([(0, 0), (1e-2, 0), (1e-2, 1e-9)], []),  # a needle
        ([(0, 0), (5e-3, 0), (5e-3, 2e-3), (1e-2, 2e-3), (1e-2, 2.000001e-3), (5e-3, 2.000001e-3), (5e-3, 4e-3)], []),
        ([(0, 0), (1e-2, 0), (1e-2, 1e-2), (0, 1e-2)], [[(2e-3, 1e-9), (8e-3, 1e-9), (5e-3, 5e-3)]]),  # a gap
    ],
)  # fmt: skip
def test_slivers_are_refused_before_they_are_divided_into_millions(points: Any, holes: Any) -> None:
    with refuses("thin", "100000"):
        fa.sections.polygon(points, STEEL, holes)
    with refuses("9.2e-07 m", "elements="):
        fa.sections.polygon([(0, 0), (1e-2, 0), (1e-2, 1e-6), (0, 1e-6)], STEEL)
