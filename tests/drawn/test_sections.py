"""Sections drawn at random, against Green's theorem on their outlines, quadrature, and Saint-Venant's problem by finite
elements."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from arms import shear_modulus
from model.saint_venant import grid, lines

sys.path.insert(0, str(Path(__file__).parent))

from scenes import SEEDS, drawn, note

ALLOY = fa.Material(density=2700.0, youngs_modulus=70e9, poisson_ratio=0.33)


def green(outline: Any) -> np.ndarray:
    """Integrals of 1, y, z, y^2, z^2 and y z over a polygon, by its corners."""
    (y, z), (u, w) = np.array(outline).T, np.roll(outline, -1, axis=0).T
    c = y * w - u * z
    parts = c / 2, c * (y + u) / 6, c * (z + w) / 6, c * (y * y + y * u + u * u) / 12, c * (z * z + z * w + w * w) / 12
    out = np.array([x.sum() for x in (*parts, c * (2 * y * z + y * w + u * z + 2 * u * w) / 24)])
    return out * np.sign(out[0])


def rectangle(y: float, z: float) -> np.ndarray:
    return np.array([[-y, -z], [y, -z], [y, z], [-y, z]]) / 2


def ring(outer: float, inner: float, z_over_y: float = 1.0) -> np.ndarray:
    """The same integrals of an ellipse less a similar one, by quadrature in polar coordinates, exact for these."""
    r, weight = np.polynomial.legendre.leggauss(4)
    r, weight = (outer + inner) / 2 + (outer - inner) / 2 * r, (outer - inner) / 2 * weight
    a = np.arange(16) * 2 * np.pi / 16
    y, z = r[:, None] * np.cos(a), z_over_y * r[:, None] * np.sin(a)
    dA = (weight * r)[:, None] * z_over_y * 2 * np.pi / 16 * np.ones_like(y)
    return np.array([(dA * f).sum() for f in (1.0, y, z, y * y, z * z, y * z)])


def shape(rng: np.random.Generator) -> tuple[Any, np.ndarray, Any, float]:
    """A section, its integrals, its torsion constant or a mesh of it, and how good that is."""
    kind, y = int(rng.integers(6)), 10.0 ** rng.uniform(-2.5, -0.5)
    z = y * 10.0 ** rng.uniform(-1, 1)
    if kind == 0:
        made: Any = fa.Rectangle(y, z)
        return made, green(rectangle(y, z)), grid(lines(-y / 2, y / 2, n=16), lines(-z / 2, z / 2, n=16)), 1e-3
    if kind == 1:
        inner = y * rng.choice([0.0, rng.uniform(0, 0.98)])
        return fa.Circle(y, inner), ring(y, inner), np.pi / 2 * (y**4 - inner**4), 1e-12
    if kind == 2:
        t = y * rng.uniform(0.02, 0.98)
        return fa.Tube(y, t), ring(y, y - t), np.pi / 2 * (y**4 - (y - t) ** 4), 1e-12
    if kind == 3:
        return fa.sections.Ellipse(y, z), ring(y / 2, 0.0, z / y), np.pi / 16 * (y * z) ** 3 / (y * y + z * z), 1e-12
    a, b = y / 2, z / 2
    if kind == 4:
        z = y * rng.uniform(0.5, 2.0)
        t, s = rng.uniform(0.02, 0.2, 2) * min(y, z)
        a, b = y / 2, z / 2
        wall = lambda u, v: (np.abs(u) > a - t) | (np.abs(v) > b - s)  # noqa: E731
        exact = green(rectangle(y, z)) - green(rectangle(y - 2 * t, z - 2 * s))
        mesh = grid(lines(-a, t - a, a - t, a), lines(-b, s - b, b - s, b), keep=wall)
        return fa.sections.Box(y, z, (t, s)), exact, mesh, 6e-3
    z = y * rng.uniform(0.3, 1.5)
    f = rng.uniform(0.02, 0.12) * min(y, z)
    w = f * rng.uniform(0.2, 2.0)
    a, b, c = y / 2, z / 2, w / 2
    keep = lambda u, v: (np.abs(u) > a - f) | (np.abs(v) < c)  # noqa: E731
    aside = np.array([a - f / 2, 0.0])
    exact = 2 * green(rectangle(f, z) + aside) + green(rectangle(y - 2 * f, w))
    exact[1] = 0.0
    return fa.sections.IBeam(y, z, f, w), exact, grid(lines(-a, f - a, a - f, a), lines(-b, -c, c, b), keep=keep), 3e-3


@drawn(10, SEEDS)
def test_a_section_has_the_integrals_of_its_outline(seed: int) -> None:
    rng = np.random.default_rng(seed)
    section, exact, torsion, good = shape(rng)
    area, _, _, yy, zz, _ = exact
    assert section.area == pytest.approx(area, rel=1e-12)
    assert section.second_moment_z == pytest.approx(yy, rel=1e-12)
    assert section.second_moment_y == pytest.approx(zz, rel=1e-12)
    J = torsion.torsion_constant() if hasattr(torsion, "torsion_constant") else torsion
    assert section.torsion_constant == pytest.approx(J, rel=good)
    for part in section.shear_areas:
        assert 0 < part <= area
    note(type(section).__name__)
    # turned and moved: the matrices about another point, of fibres
    y, z, angle = *rng.normal(size=2) * 0.1, rng.uniform(-3, 3)
    found = fa.SectionMatrix.of(section, ALLOY, y=y, z=z, angle=angle)
    c, s = np.cos(angle), np.sin(angle)
    Iyy, Izz, Iyz = c * c * yy + s * s * zz + area * y * y, s * s * yy + c * c * zz + area * z * z, c * s * (
        yy - zz) + area * y * z  # fmt: skip
    K, M = np.array(found.stiffness) / 70e9, np.array(found.inertia) / 2700.0
    size = area * (abs(y) + abs(z)) ** 2 + yy + zz
    bending = [[area, area * z, -area * y], [area * z, Izz, -Iyz], [-area * y, -Iyz, Iyy]]
    np.testing.assert_allclose(K[np.ix_([0, 4, 5], [0, 4, 5])], bending, rtol=1e-10, atol=1e-11 * size)
    np.testing.assert_allclose(M[3:, 3:], [[Iyy + Izz, 0, 0], [0, Izz, -Iyz], [0, -Iyz, Iyy]], atol=1e-11 * size)
    assert found.mass == pytest.approx(2700.0 * area) and found.com == pytest.approx((y, z))


@drawn(3, SEEDS)
def test_a_polygon_has_the_integrals_of_its_outline(seed: int) -> None:
    """A star of corners, with a hole or none: the matrices about its origin; its torsion constant is below the polar
    moment about the centre of mass, and that of the full outline is not less than with a hole."""
    pytest.importorskip("sectionproperties")
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3, 9))
    angles = np.sort(rng.uniform(0, 0.7, n) + np.arange(n)) * 2 * np.pi / n
    scale = 10.0 ** rng.uniform(-3, 0)
    star = rng.uniform(0.5, 1.0, n)[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    if n == 3:
        star = np.array([[1, 0], [-0.5, 0.8], [-0.5, -0.8]]) * rng.uniform(0.5, 1.0, 3)[:, None]
    least = min(np.linalg.norm(star, axis=1)) * 0.15
    hole = [least * rectangle(1.0, rng.uniform(0.5, 1.0))] if rng.random() < 0.5 else []
    at = rng.normal(size=2) * rng.choice([0.0, 1.0])
    outline, holes = scale * (star + at), [scale * (h + at) for h in hole]
    found = fa.sections.polygon(outline, ALLOY, holes=holes, elements=300)
    A, Ay, Az, Ayy, Azz, Ayz = green(outline) - sum((green(h) for h in holes), np.zeros(6))
    K, M = np.array(found.stiffness) / 70e9, np.array(found.inertia) / 2700.0
    size = Ayy + Azz
    bending = [[A, Az, -Ay], [Az, Azz, -Ayz], [-Ay, -Ayz, Ayy]]
    lengths = np.sqrt([A, size, size])
    np.testing.assert_allclose(K[np.ix_([0, 4, 5], [0, 4, 5])] / np.outer(lengths, lengths),
                               bending / np.outer(lengths, lengths), atol=1e-9)  # fmt: skip
    about = np.array([[size, 0, 0], [0, Azz, -Ayz], [0, -Ayz, Ayy]])
    np.testing.assert_allclose(M[3:, 3:] / size, about / size, atol=1e-9)
    G = shear_modulus(ALLOY)
    full = fa.sections.polygon(outline, ALLOY, elements=300) if holes else found

    def torsion(of: fa.SectionMatrix) -> float:
        return 1.0 / np.linalg.inv(np.array(of.stiffness))[3, 3] / G  # free of the shear that couples with it

    polar = size - (Ay**2 + Az**2) / A
    assert 0 < torsion(found) < polar * (1 + 1e-9)
    assert torsion(found) < torsion(full) * 1.01
    d = np.sqrt(np.diag(found.stiffness))
    assert (np.linalg.eigvalsh(np.array(found.stiffness) / np.outer(d, d)) > 0).all()
