"""Layered strips: against the rectangle, off-axis compliances, and the section's elasticity by finite elements."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from messages import refuses, warns
from model.saint_venant import classical_stiffness, grid, lines

STEEL = fa.Material(7850.0, 209e9, poisson_ratio=0.3)
CARBON = fa.sections.Orthotropic(1600.0, E1=140e9, E2=10e9, G12=5e9, nu12=0.3, G23=3.5e9)
B, T = 0.02, 0.001


def plies(*degrees: float, material: Any = CARBON) -> list[fa.sections.Ply]:
    return [fa.sections.Ply(T / len(degrees), material, np.deg2rad(a)) for a in degrees]


def compliance(section: fa.SectionMatrix) -> np.ndarray:
    return np.linalg.inv(np.array(section.stiffness))


@pytest.mark.parametrize("normal", ["y", "z"])
def test_an_isotropic_laminate_is_the_rectangle(normal: str) -> None:
    rectangle = fa.Rectangle(T, B) if normal == "y" else fa.Rectangle(B, T)
    one, other = (
        fa.SectionMatrix.of(rectangle, STEEL),
        fa.sections.laminate(B, plies(0, 30, -70, material=STEEL), normal),
    )
    for name in ("stiffness", "inertia"):
        expected = np.array(getattr(one, name))
        size = np.sqrt(np.outer(expected.diagonal(), expected.diagonal()))
        np.testing.assert_allclose(np.array(getattr(other, name)) / size, expected / size, atol=1e-9)
    thin = fa.sections.laminate(1.0, [fa.sections.Ply(1e-4, STEEL)])
    G = 209e9 / 2.6
    assert thin.stiffness[3][3] == pytest.approx(G * 1e-12 / 3, rel=1e-4)  # 4 b D66


@pytest.mark.parametrize("angle", [0.0, 0.3, np.pi / 4, -1.1, np.pi / 2])
def test_a_ply_off_its_axis(angle: float) -> None:
    """Jones, Eq. 2.95 to 2.97: Young's modulus along x, and the shear that a pull makes."""
    c, s, m = np.cos(angle), np.sin(angle), CARBON
    mixed = 1 / m.G12 - 2 * m.nu12 / m.E1
    S11 = c**4 / m.E1 + mixed * c**2 * s**2 + s**4 / m.E2
    S66 = 2 * (2 / m.E1 + 2 / m.E2 + 4 * m.nu12 / m.E1 - 1 / m.G12) * c**2 * s**2 + (c**4 + s**4) / m.G12
    S16 = (2 / m.E1 + 2 * m.nu12 / m.E1 - 1 / m.G12) * s * c**3 - (2 / m.E2 + 2 * m.nu12 / m.E1 - 1 / m.G12) * s**3 * c
    F = compliance(fa.sections.laminate(B, [fa.sections.Ply(T, m, angle)]))
    area, thick, wide = B * T, B * T**3 / 12, T * B**3 / 12
    small = 1e-9 * S11
    assert F[0, 0] * area == pytest.approx(S11, rel=1e-9)  # stretch by a pull
    assert F[2, 0] * area == pytest.approx(S16, rel=1e-9, abs=small)  # shear in the plane by a pull
    assert F[2, 2] * area == pytest.approx(1.2 * S66, rel=1e-9)
    assert F[5, 5] * thick == pytest.approx(S11, rel=1e-9)
    assert F[4, 4] * wide == pytest.approx(S11, rel=1e-9)
    assert F[3, 5] * thick == pytest.approx(-S16 / 2, rel=1e-9, abs=small)  # twist by bending
    assert F[0, 3] == pytest.approx(0.0, abs=1e-9 * np.sqrt(F[0, 0] * F[3, 3]))  # a single ply does not twist by a pull


def moduli(ply: fa.sections.Ply, normal: str) -> np.ndarray:
    """Of a transversely isotropic ply in the section's axes, (6, 6), xx yy zz yz xz xy."""
    m = ply.material
    nu23 = m.E2 / (2 * m.G23) - 1
    S = np.diag([1 / m.E1, 1 / m.E2, 1 / m.E2, 1 / m.G23, 1 / m.G12, 1 / m.G12])
    S[0, 1] = S[1, 0] = S[0, 2] = S[2, 0] = -m.nu12 / m.E1
    S[1, 2] = S[2, 1] = -nu23 / m.E2
    pairs = [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)]
    C, full = np.linalg.inv(S), np.zeros((3, 3, 3, 3))
    for a, (i, j) in enumerate(pairs):
        for b, (k, n) in enumerate(pairs):
            full[i, j, k, n] = full[j, i, k, n] = full[i, j, n, k] = full[j, i, n, k] = C[a, b]
    c, s = np.cos(ply.angle), np.sin(ply.angle)
    # columns: the fibres, across them in the plane, the normal
    R = np.array([[c, -s, 0], [0, 0, 1], [s, c, 0]]) if normal == "y" else np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    full = np.einsum("ai,bj,ck,dl,ijkl->abcd", R, R, R, R, full)
    return np.array([[full[i, j, k, n] for k, n in pairs] for i, j in pairs])


def errors(layup: tuple[float, ...], b: float, normal: str = "y") -> np.ndarray:
    """Of the strains by a pull, a torque and two moments, against the section's elasticity without the assumptions of
    plates: entries as shares of the diagonal's."""
    stack = plies(*layup)
    through = lines(*np.linspace(-T / 2, T / 2, len(layup) + 1), n=3)
    across = lines(-b / 2, b / 2, n=24)
    m = grid(*((through, across) if normal == "y" else (across, through)))
    n = (m.y if normal == "y" else m.z).mean(axis=1)
    which = np.clip(((n / T + 0.5) * len(layup)).astype(int), 0, len(layup) - 1)
    each = np.array([moduli(p, normal) for p in stack])
    expected = np.linalg.inv(classical_stiffness(m, each[which]))
    some = [0, 3, 4, 5]
    got = compliance(fa.sections.laminate(b, stack, normal))[np.ix_(some, some)]
    return (got - expected) / np.sqrt(np.outer(expected.diagonal(), expected.diagonal()))


LAYUPS = [(30,), (45, -45), (20, -70), (30, 0, -30), (45, 0, 0, -45), (15, -15, 40, 70), (30, -30, -30, 30)]


@pytest.mark.parametrize("layup", LAYUPS)
@pytest.mark.parametrize("normal", ["y", "z"])
def test_couplings_are_those_of_the_sections_elasticity(layup: tuple[float, ...], normal: str) -> None:
    """What plates leave out is a layer at the free edges, as broad as the strip is thick."""
    error, narrower = errors(layup, 40 * T, normal), errors(layup, 20 * T, normal)
    assert np.abs(error).max() < 0.9 / 40
    assert np.abs(error).max() < 0.6 * np.abs(narrower).max()
    others = [0, 1, 3 if normal == "y" else 2]  # than bending in the plane
    assert np.abs(error[np.ix_(others, others)]).max() < 0.4 / 40


@pytest.mark.parametrize("layup", [(0,), (90,), (0, 90), (90, 0, 90)])
def test_fibres_along_and_across_in_strips_that_are_not_thin(layup: tuple[float, ...]) -> None:
    assert np.abs(errors(layup, 4 * T)).max() < 0.01


def test_a_sandwichs_core_bears_its_shear() -> None:
    """Allen, Analysis and Design of Structural Sandwich Panels: b d^2 / c G of the core, d between the faces."""
    face, core = fa.sections.Ply(1e-4, STEEL), fa.sections.Ply(3e-3, fa.Material(60.0, 7e7, shear_modulus=2.5e7))
    K = fa.sections.laminate(0.04, [face, core, face]).stiffness
    assert K[1][1] == pytest.approx(0.04 * (3.1e-3) ** 2 / 3e-3 * 2.5e7, rel=2e-3)
    assert K[5][5] == pytest.approx(209e9 * 0.04 * 2e-4 * (3.1e-3) ** 2 / 4, rel=2e-3)


def test_the_mass_is_where_the_plies_are() -> None:
    light, heavy = replace(CARBON, density=1000.0), replace(CARBON, density=3000.0)
    for normal in "yz":
        section = fa.sections.laminate(B, [fa.sections.Ply(T / 2, light), fa.sections.Ply(T / 2, heavy)], normal)
        assert section.mass == pytest.approx(2000.0 * B * T)
        assert section.com == pytest.approx((T / 8, 0.0) if normal == "y" else (0.0, T / 8))
        assert section.inertia[3][3] == pytest.approx(2000.0 * (B * T**3 + T * B**3) / 12)


def test_a_strip_under_a_load_bends_and_twists() -> None:
    """The same strip about y and about z: a weight along its normal turns its end by the coupling's share."""
    F = compliance(fa.sections.laminate(B, plies(30)))
    ends = []
    for normal, force in (("y", [0.0, 0.01, 0.0]), ("z", [0.0, 0.0, 0.01])):
        strains = ("bending_y", "bending_z", "torsion", "extension", "shear_y", "shear_z")
        beam = fa.Beam(
            0.4,
            fa.sections.laminate(B, plies(30), normal),
            modes=dict.fromkeys(strains, 4),
            basis="legendre",
            order="exact",
        )
        arm = fa.Arm([fa.Link(fa.Fixed(), beam=beam)], gravity=(0.0, 0.0, 0.0))
        q = arm.equilibrium(loads=[fa.Load(0, 0.4, force=force)])
        ends.append(arm.frame(q))
    p, R = ends[0]
    assert p[1] == pytest.approx(0.01 * (F[5, 5] * 0.4**3 / 3 + F[1, 1] * 0.4), rel=1e-3)
    assert R[2, 1] == pytest.approx(0.01 * F[3, 5] * 0.4**2 / 2, rel=1e-3)  # the moment about z is 0.01 (0.4 - x)
    assert ends[1][0][2] == pytest.approx(p[1], rel=1e-6)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: fa.sections.Orthotropic(1600, 1e9, 1e9, -1e9, 0.3),
            "G12 =",
        ),
        (lambda: fa.sections.Orthotropic(1600, 1e10, 4e10, 1e9, 0.6), ("nu12 = 0.6", "0.5")),
        (lambda: fa.sections.Ply(0.0, CARBON), "thickness = 0.0"),
        (lambda: fa.sections.Ply(T, CARBON, np.nan), "angle = nan"),
        (lambda: fa.sections.Ply(T, fa.Material(1.0, 1e9)), ("material =", "poisson_ratio")),
        (lambda: fa.sections.Ply(T, 7.0), ("material = 7.0", "Orthotropic", "Material")),
        (lambda: fa.sections.laminate(-1.0, plies(0)), "width = -1.0"),
        (lambda: fa.sections.laminate(B, []), ("plies = []", "Ply")),
        (lambda: fa.sections.laminate(B, plies(0), "x"), "normal = 'x'"),
    ],
)
def test_bad_laminates(make: Any, message: str) -> None:
    with refuses(message):
        make()


def test_what_is_no_plate_and_degrees_are_told() -> None:
    with warns(fa.errors.ModelWarning, "0.02 m thick", "0.02 m wide"):
        fa.sections.laminate(B, [fa.sections.Ply(B, STEEL)])
    with warns(fa.errors.ModelWarning, "angle = 45"):
        fa.sections.Ply(T, CARBON, 45.0)
