"""Piezo patches, against numbers made without them: independent ones, closed forms, other series, a transfer matrix."""

from dataclasses import replace

import flexarm as fa
import numpy as np
import pytest
from arms import STEEL, close, shear_modulus
from numpy.polynomial import legendre
from scipy.linalg import expm
from scipy.optimize import brentq

E, G, D31, L, H, B, T = 60.6e9, 60.6e9 / 2.6, -274e-12, 0.5, 1e-3, 0.02, 0.2e-3
MOMENT = 3.985056e-4  # N m per volt, of a pair: Crawley & de Luis, AIAA Journal 25 (1987)
PZT = fa.Piezo(E, 0.3, 7500, D31, permittivity=3e-8)
FIBRE = replace(PZT, d31=4e-10, permittivity=4e-8)  # acts along its axis alone
PAIR = fa.Patch(0.02, 0.07, B, T, PZT)
GHOST = replace(PAIR, stiffness=False, mass=False)
EI = 209e9 * B * H**3 / 12


def strip(*patches, modes=None, joint=None, length=L, **beam) -> fa.Arm:
    given = {"modes": modes or {"bending_y": 3}, "basis": "legendre", "order": 2} | beam
    section = given.pop("section", fa.Rectangle(H, B))
    beam = fa.Beam(length, section, STEEL, patches=list(patches), **given)
    return fa.Arm([fa.Link(joint or fa.Fixed(), fa.RigidBody(), beam)])


def split(patch: fa.Patch, n: int = 8, **beam) -> fa.Arm:
    """The strip in three beams, so that no shape function has to follow a jump of the curvature."""
    return fa.Arm(fa.split(strip(patch, **beam).links[0], n))


def clamped_free(k: int, x: np.ndarray, derivative: int) -> np.ndarray:
    """Mode k = 0, 1, 2 of the clamped-free beam, 1 at its end, from the textbook."""
    b = brentq(lambda z: np.cos(z) * np.cosh(z) + 1, *((1.8, 1.95), (4.6, 4.8), (7.8, 7.95))[k], xtol=1e-15)
    sigma = (np.sinh(b) - np.sin(b)) / (np.cosh(b) + np.cos(b))
    z, d = b * np.asarray(x) / L, derivative % 4
    ch, sh = (np.cosh(z), np.sinh(z)) if d % 2 == 0 else (np.sinh(z), np.cosh(z))
    c, s = ((np.cos, np.sin), (lambda z: -np.sin(z), np.cos), (lambda z: -np.cos(z), lambda z: -np.sin(z)))[d]
    end = np.cosh(b) - np.cos(b) - sigma * (np.sinh(b) - np.sin(b))
    return (b / L) ** derivative * (ch - c(z) - sigma * (sh - s(z))) / end


# -- independent -----------------------------------------------------------------------------------------------------


def test_moment_and_signs() -> None:
    assert strip(GHOST, modes={"bending_y": 1}).patch_matrix[0, 0] == pytest.approx(MOMENT * 0.05, rel=1e-13)
    for face, strain, sign in (("y", 0, 2), ("+y", 0, 1), ("-y", 0, -1), ("z", 1, 2), ("+z", 1, 1), ("-z", 1, -1)):
        # equal sides, so that all faces are alike; positive: d31 < 0 bends towards +y, or +z
        arm = strip(replace(GHOST, face=face), modes={"bending_y": 1, "bending_z": 1}, section=fa.Rectangle(0.02, 0.02))
        half = E * -D31 * B * (0.02 + T) / 2
        expected = np.zeros(2)
        expected[strain] = sign * half * 0.05
        np.testing.assert_allclose(arm.patch_matrix[:, 0], expected, rtol=1e-12, atol=1e-18)


@pytest.mark.parametrize(
    ("stiffness", "curvature", "tip"), [(False, 1.1440352e-3, 2.6026801e-5), (True, 7.5981472e-4, 1.7285785e-5)]
)
def test_curvature_and_tip(stiffness: bool, curvature: float, tip: float) -> None:
    arm = split(replace(PAIR, stiffness=stiffness), n=2)
    q = arm.equilibrium(voltages={(1, 0): 1.0})
    assert arm.strain(q, 1, 0.02)[2] == pytest.approx(curvature, rel=5e-8)
    assert arm.frame(q)[0][1] == pytest.approx(tip, rel=5e-8)
    assert arm.frame(arm.equilibrium(voltages=[-1.0]))[0][1] == pytest.approx(-tip, rel=5e-8)


def test_one_beam_has_the_same_tip() -> None:
    """Without the patch's stiffness exactly, with it only as fast as smooth curvatures follow a jump."""
    assert strip(GHOST).deflection(strip(GHOST).equilibrium(voltages=[1.0]))[1] == pytest.approx(2.6026801e-5, rel=5e-8)
    errors = []
    for n in (2, 10, 30):
        arm = strip(PAIR, modes={"bending_y": n})
        errors.append(arm.deflection(arm.equilibrium(voltages=[1.0]))[1] / 1.7285785e-5 - 1)
    assert 0.35 > errors[0] > 2 * errors[1] > 3 * errors[2] > 0


def test_pvdf_bimorph() -> None:
    """Layers of 0.5 mm in series, so that each has half of the 100 V."""
    pvdf = fa.Piezo(2e9, 0.29, 1800, 2.2e-11)
    layer = fa.Patch(0, 0.1, 0.005, 0.5e-3, pvdf, offset=0.0, stiffness=False, mass=False)
    beam = fa.Beam(0.1, fa.Rectangle(1e-3, 0.005), fa.Material(1800, 2e9, 0.29), {"bending_y": 1}, "legendre",
                   patches=[layer])  # fmt: skip
    core = replace(beam, section=fa.Rectangle(1e-8, 0.005), patches=[replace(layer, offset=None, stiffness=True)])
    for made in (beam, core):  # the layers as the beam's own, and on a foil
        arm = fa.Arm([fa.Link(fa.Fixed(), beam=made)])
        assert arm.deflection(arm.equilibrium(voltages=[-50.0]))[1] == pytest.approx(3.3e-5, rel=5e-5)


# -- closed forms ----------------------------------------------------------------------------------------------------


def test_forces_are_exact_in_both_bases() -> None:
    s = 2 * np.array([0.02, 0.07]) / L - 1
    expected = [np.diff(legendre.legval(s, legendre.legint(np.eye(12)[k])))[0] * L / 2 for k in range(12)]
    found = strip(GHOST, modes={"bending_y": 12}).patch_matrix[:, 0]
    np.testing.assert_allclose(found, MOMENT * np.array(expected), rtol=0, atol=1e-12 * MOMENT * 0.05)
    expected = [np.diff(clamped_free(k, np.array([0.02, 0.07]), 1))[0] for k in range(3)]
    found = strip(GHOST, basis="clamped-free").patch_matrix[:, 0]
    np.testing.assert_allclose(found, MOMENT * np.array(expected), rtol=1e-12)


def test_whole_beam_bends_to_a_circle() -> None:
    arm = strip(replace(PAIR, start=0, end=L), order="exact", modes={"bending_y": 4})
    stiff = EI + E * 2 * B * ((H / 2 + T) ** 3 - (H / 2) ** 3) / 3
    V = np.pi / 2 / L * stiff / MOMENT  # a quarter
    tip, R = arm.frame(arm.equilibrium(voltages=[V]))
    close(tip, [2 * L / np.pi, 2 * L / np.pi, 0], 1e-10)
    close(R, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], 1e-10)


def surface_twist(depth: float, breadth: float, width: float) -> float:
    """By the stress function in cosines along the face; the core's series goes across it."""
    n = np.arange(1, 400001, 2)
    A = 8 * breadth**2 / (np.pi * n) ** 3 * np.where(n % 4 == 1, 1, -1)
    shear = A * n * np.pi / breadth * np.tanh(n * np.pi * depth / (2 * breadth))
    mean = shear * np.sin(n * np.pi * width / (2 * breadth)) * 2 * breadth / (n * np.pi * width)
    return float(mean.sum() / (depth / 2))


@pytest.mark.parametrize("sides", [(1e-3, 0.02, 0.02), (1e-3, 0.02, 0.01), (0.01, 0.01, 0.01), (0.02, 0.001, 0.001)])
def test_shear_of_a_twisted_face(sides: tuple[float, float, float]) -> None:
    assert fa._core.surface_twist(*sides) == pytest.approx(surface_twist(*sides), abs=1e-6)


def test_twist_at_45_degrees() -> None:
    """By hand: free shear e = d31 V/t in each layer, of opposite sense; by reciprocity with Saint-Venant's torsion the
    torque is the integral over both of G e c r dA, with c r the shear there per twist."""
    patch = replace(GHOST, material=FIBRE, angle=np.pi / 4, pair="same")
    arm = strip(patch, modes={"bending_y": 2, "torsion": 3, "shear_z": 2})
    torque = 2 * G * 4e-10 / T * surface_twist(H, B, B) * B * T * (H + T) / 2
    q = arm.equilibrium(voltages=[100.0])
    shear = shear_modulus(STEEL)
    J = fa.Rectangle(H, B).torsion_constant
    R = arm.frame(q)[1]
    assert np.arctan2(R[2, 1], R[1, 1]) == pytest.approx(100 * torque * 0.05 / (shear * J), rel=1e-5)
    assert np.abs(arm.deflection(q)).max() < 1e-12
    # opposed at the same angle: as much torque, and half the bending of angle 0, since e_xx = cos^2 e
    both = strip(replace(patch, pair="opposed"), modes={"bending_y": 1, "torsion": 1}).patch_matrix[:, 0]
    plain = strip(replace(patch, pair="opposed", angle=0.0), modes={"bending_y": 1, "torsion": 1}).patch_matrix[:, 0]
    assert both[0] == pytest.approx(plain[0] / 2, rel=1e-12)
    assert abs(both[1]) == pytest.approx(torque * 0.05, rel=1e-5)
    assert plain[1] == 0
    # a ceramic plate, d32 = d31, does the same at every angle
    plate = replace(GHOST, material=replace(PZT, d32=D31))
    for angle in (0.0, 0.3, 1.2):
        found = strip(replace(plate, angle=angle), modes={"bending_y": 1, "torsion": 1}).patch_matrix[:, 0]
        np.testing.assert_allclose(found, [MOMENT * 0.05, 0], rtol=1e-12, atol=1e-20)


def test_twist_turns_the_same_way_on_both_kinds_of_face() -> None:
    """A layer that wants to stretch along +45 degrees on +y, seen from outside, drives the twist as one on +z does."""
    square = {"section": fa.Rectangle(0.02, 0.02), "modes": {"torsion": 1}}
    faces = [("+y", 1), ("-y", -1), ("+z", -1), ("-z", 1)]  # from x to z is clockwise seen from +y, and so on
    patch = replace(GHOST, material=FIBRE)
    found = [strip(replace(patch, face=f, angle=s * np.pi / 4), **square).patch_matrix[0, 0] for f, s in faces]
    np.testing.assert_allclose(found, found[0], rtol=1e-12)
    assert found[0] > 0  # fibres from x towards z on +y, lengthened: the section turns from y to z


def test_shear_by_d15() -> None:
    """A layer at the axis: force G d15 w per volt, deflection its free shear times its share of the stiffness."""
    core = fa.Piezo(E, 0.3, 0, 0.0, d15=5e-10)
    patch = fa.Patch(0, L, B, 1e-4, core, face="+y", offset=0.0, mass=False)
    arm = strip(patch, modes={"shear_y": 1})
    q = arm.equilibrium(voltages=[10.0])
    stiff = 5 / 6 * shear_modulus(STEEL) * B * H + G * B * 1e-4
    assert arm.deflection(q)[1] == pytest.approx(10 * G * 5e-10 * B * L / stiff, rel=1e-12)
    assert strip(replace(patch, face="y"), modes={"shear_y": 1}).patch_matrix[0, 0] == 0  # opposed: they cancel


def test_halves_make_a_whole() -> None:
    all_strains = {"bending_y": 3, "bending_z": 2, "torsion": 2, "shear_y": 2, "shear_z": 2}
    patch = replace(PAIR, face="+y", angle=0.4, material=FIBRE, profile=lambda x: 5 * x)
    whole = strip(patch, modes=all_strains, basis="clamped-free")
    halves = strip(replace(patch, end=0.045, profile=lambda x: 5 * x), replace(patch, start=0.045,
                   profile=lambda x: 5 * x), modes=all_strains, basis="clamped-free")  # fmt: skip
    q = np.linspace(-0.01, 0.01, whole.nv)
    close(halves.patch_matrix.sum(axis=1), whole.patch_matrix[:, 0], 1e-14)
    close(halves.links[0].beam._core.stiffness, whole.links[0].beam._core.stiffness, 1e-12)
    close(halves.mass_matrix(q), whole.mass_matrix(q), 1e-11)
    assert halves.capacitance(0, 0) + halves.capacitance(0, 1) == pytest.approx(whole.capacitance(), rel=1e-12)
    sides = strip(replace(patch, profile=None), replace(patch, face="-y", profile=None), modes=all_strains)
    pair = strip(replace(patch, face="y", profile=None), modes=all_strains)
    close(sides.patch_matrix @ [1, -1], pair.patch_matrix[:, 0], 1e-13)
    close(sides.links[0].beam._core.stiffness, pair.links[0].beam._core.stiffness, 1e-12)


@pytest.mark.parametrize("mode", [0, 1, 2])
def test_a_profile_shaped_like_a_mode_excites_and_senses_that_mode_alone(mode: int) -> None:
    greatest = clamped_free(mode, 0.0, 2)
    patch = fa.Patch(0, L, B, T, PZT, profile=lambda x: clamped_free(mode, x, 2) / greatest)
    arm = strip(replace(patch, stiffness=False, mass=False), basis="clamped-free")
    force = arm.patch_matrix[:, 0]
    others = np.delete(np.arange(3), mode)
    assert np.abs(force[others]).max() < 1e-10 * abs(force[mode])
    norm = 4 * (np.arccosh(1.0) + [1.8751040687, 4.6940911330, 7.8547574382][mode]) ** 4 / L**3 / 16
    assert force[mode] == pytest.approx(MOMENT * norm / greatest, rel=1e-8)  # int phi''^2 = b^4 / (4 L^3)
    assert np.abs(arm.charge(np.eye(3))[others]).max() < 1e-10 * abs(arm.charge(np.eye(3)[mode]))


def test_linear_profile_and_taper_by_quadrature() -> None:
    x, share = [0.02, 0.03, 0.07], [1.0, -0.5, 0.25]
    taper = fa.sections.Taper(
        [0, 0.05, L], [fa.Rectangle(2e-3, 0.03), fa.Rectangle(1.5e-3, 0.025), fa.Rectangle(1e-3, 0.02)]
    )
    arm = strip(replace(GHOST, profile={"x": x, "share": share}), section=taper, modes={"bending_y": 4})
    expected = np.zeros(4)
    for a, b in ((0.02, 0.03), (0.03, 0.05), (0.05, 0.07)):
        s, w = legendre.leggauss(20)
        at = a + (b - a) * (s + 1) / 2
        depth = np.interp(at, [0, 0.05, L], [2e-3, 1.5e-3, 1e-3])
        moment = E * -D31 * B * (depth + T) * np.interp(at, x, share)
        expected += (b - a) / 2 * legendre.legvander(2 * at / L - 1, 3).T @ (w * moment)
    np.testing.assert_allclose(arm.patch_matrix[:, 0], expected, rtol=1e-11)


# -- stiffness and mass ----------------------------------------------------------------------------------------------


def transfer_matrix_frequencies(parts: list[tuple[float, float, float]], guesses: list[float]) -> list[float]:
    """Clamped-free Euler-Bernoulli beam in pieces (length, EI, mass per length): state w, slope, moment, shear."""

    def determinant(omega: float) -> float:
        state = np.eye(4)
        for length, rigidity, mass in parts:
            A = np.zeros((4, 4))
            A[0, 1], A[1, 2], A[2, 3], A[3, 0] = 1, 1 / rigidity, 1, mass * omega**2
            state = expm(A * length) @ state
        return float(np.linalg.det(state[2:, 2:]))

    return [brentq(determinant, 0.97 * g, 1.03 * g, xtol=1e-9, rtol=1e-13) for g in guesses]


@pytest.mark.parametrize(("stiffness", "mass"), [(True, True), (True, False), (False, True)])
def test_frequencies_against_a_transfer_matrix(stiffness: bool, mass: bool) -> None:
    patch = replace(PAIR, stiffness=stiffness, mass=mass)
    arm = split(patch, n=12, rotary_inertia=False)
    found = arm.modes().frequencies[:3]
    under = EI + stiffness * E * 2 * B * ((H / 2 + T) ** 3 - (H / 2) ** 3) / 3
    heavy = 7850 * H * B + mass * 2 * 7500 * B * T
    parts = [(0.02, EI, 7850 * H * B), (0.05, under, heavy), (0.43, EI, 7850 * H * B)]
    exact = transfer_matrix_frequencies(parts, list(found))
    np.testing.assert_allclose(found, exact, rtol=1e-7)
    one = strip(patch, modes={"bending_y": 20}, rotary_inertia=False).modes().frequencies[:3]
    assert (one > np.array(exact) * (1 - 1e-9)).all()  # Ritz, from above
    np.testing.assert_allclose(one, exact, rtol=6e-3 if stiffness else 1e-7)


def test_mass_and_rotary_inertia() -> None:
    patch = replace(PAIR, face="+z", width=8e-4)
    arm, bare = (strip(*p, modes={"bending_y": 2, "bending_z": 2, "torsion": 1}) for p in ([patch], []))
    assert arm.links[0].mass - bare.links[0].mass == pytest.approx(7500 * 0.05 * 8e-4 * T, rel=1e-12)
    added = arm.mass_matrix(arm.zero) - bare.mass_matrix(bare.zero)
    x, w = legendre.leggauss(20)
    x, w = 0.02 + 0.025 * (x + 1), 0.025 * w
    area, inner = 8e-4 * T, B / 2
    z2 = 8e-4 * ((inner + T) ** 3 - inner**3) / 3
    y2 = area * (8e-4) ** 2 / 12
    J = np.array([bare.jacobian(bare.zero, 0, float(at)) for at in x])
    weight = 7500 * np.array([area, area, area, z2 + y2, z2, y2])
    np.testing.assert_allclose(added, np.einsum("g,gik,i,gil->kl", w, J, weight, J), rtol=1e-6, atol=1e-16)


def test_rigidities_of_a_section() -> None:
    """Of both bendings, torsion, stretch, and shear in the patch's plane; every order and basis sees the same."""
    layer = replace(PAIR, face="+y", width=0.01)._layer(5e-4, 1.0, 1.9)
    r1, r2 = 0.01 * T * 6e-4, 0.01 * (7e-4**3 - 5e-4**3) / 3
    expected = np.diag([G * 1.9**2 * r2, E * T * 0.01**3 / 12, E * r2, 0, G * 0.01 * T, E * 0.01 * T])
    expected[0, 4] = expected[4, 0] = G * 1.9 * r1
    expected[2, 5] = expected[5, 2] = -E * r1
    np.testing.assert_allclose(layer.rigidity, expected, rtol=1e-12)


@pytest.mark.parametrize("order", [0, 1, 2, 3, "exact"])
def test_energy_is_the_voltage_s_work(order) -> None:
    hub = fa.RigidBody(0.1, inertia=(1e-4, 1e-4, 1e-4))
    beam = fa.Beam(L, fa.Rectangle(H, B), STEEL, {"bending_y": 2}, "clamped-free", order, patches=[PAIR])
    arm = fa.Arm([fa.Link(fa.Revolute("z"), hub, beam)])
    t = np.linspace(0, 0.3, 1501)
    law = fa.Voltage(lambda t: 30 * np.sin(25 * t))
    run = fa.simulate(arm, t, drive={("patch", 0, 0): law}, integrator="gauss", step=1e-3)
    V, dV, b = 30 * np.sin(25 * t), 750 * np.cos(25 * t), arm.patch_matrix[:, 0]
    power, change, h = V * (run.v @ b), dV * (run.v @ b) + V * (run.a @ b), t[1]
    steps = (power[1:] + power[:-1]) * h / 2 - np.diff(change) * h**2 / 12  # trapezoid, corrected: fourth order
    work = np.concatenate([[0], np.cumsum(steps)])
    stored = sum(run.energy())
    assert stored.max() > 1e-7
    np.testing.assert_allclose(stored - stored[0], work, rtol=0, atol=1e-7 * stored.max())


def test_split_is_the_same_link() -> None:
    """Rigidly the same mass, place and force; elastically the limit of more and more shape functions."""
    taper = fa.sections.Taper(
        [0, 0.05, L], [fa.Rectangle(2e-3, 0.03), fa.Rectangle(1.5e-3, 0.025), fa.Rectangle(1e-3, 0.02)]
    )
    ghosts = [replace(GHOST, profile=[1, 0.2, 0.8]), replace(GHOST, start=0.2, end=0.4, profile=np.cos)]
    link = strip(*ghosts, section=taper, modes={"bending_y": 16}, rotary_inertia=False).links[0]
    link = replace(link, joint=fa.Revolute("z"), hub=fa.RigidBody(0.1, end=(0.1, 0, 0)), tip=fa.RigidBody(0.02))
    whole, parts = fa.Arm([link]), fa.Arm(fa.split(link, 5, places=[0.02, 0.05, 0.07, 0.2, 0.3, 0.4]))
    assert parts.patches == [(1, 0), (2, 0), (4, 0), (5, 0)]
    above = whole.modes().frequencies[1:4] / parts.modes().frequencies[1:4] - 1
    assert (above > 0).all()
    assert (above < 2e-4).all()
    x, tip = np.linspace(0, L, 500001), 0.0
    x = (x[1:] + x[:-1]) / 2
    depth, width = (np.interp(x, [0, 0.05, L], sides) for sides in ([2e-3, 1.5e-3, 1e-3], [0.03, 0.025, 0.02]))
    for V, a, b, share in ((1.0, 0.02, 0.07, np.interp(x, [0.02, 0.045, 0.07], [1, 0.2, 0.8])),
                           (-2.0, 0.2, 0.4, np.cos(x))):  # fmt: skip
        curvature = V * E * -D31 * B * (depth + T) * share / (209e9 * width * depth**3 / 12)
        tip += ((x > a) & (x < b)) * curvature @ (L - x) * L / len(x)
    q = parts.equilibrium(lock=[0], voltages=[1.0, 1.0, -2.0, -2.0])
    assert parts.frame(q)[0][1] == pytest.approx(tip, rel=2e-6)
    assert [k.joint.nv for k in parts.links] == [1] + 6 * [0]
    assert sum(k.mass for k in parts.links) == pytest.approx(link.mass, rel=1e-12)
    assert [k.hub is None for k in parts.links] == [False] + 6 * [True]
    assert len(fa.split(strip().links[0])) == 1
