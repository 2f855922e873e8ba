"""Static balance under gravity, springs and forces."""

import dataclasses

import flexarm as fa
import numpy as np
import pytest
from arms import BODY, STEEL, STRAINS, STRIP, G, pendulum, random_arm
from messages import refuses, warns
from scipy.integrate import solve_ivp


def cantilever(tip: float, order: int | str = 2) -> fa.Arm:
    beam = fa.Beam(0.5, fa.Rectangle(0.01, 0.02), STEEL, {"bending_y": 4}, "legendre", order)
    return fa.Arm([fa.Link(fa.Fixed(), None, beam, fa.RigidBody(tip))], gravity=(0, -G, 0))


def test_sag_of_a_cantilever() -> None:
    """PL^3/3EI + wL^4/8EI; at a sag of 1e-4 of the length the second order is 1e-8."""
    P, L = 0.1, 0.5
    arm = cantilever(P)
    beam = arm.links[0].beam
    EI, w = 209e9 * beam.section.second_moment_z, beam.mass * G / L
    sag = P * G * L**3 / (3 * EI) + w * L**4 / (8 * EI)
    assert arm.deflection(arm.equilibrium())[1] == pytest.approx(-sag, rel=1e-6)


def test_a_large_sag_balances() -> None:
    arm = cantilever(400.0, order="exact")  # two thirds of the length
    q = arm.equilibrium()
    assert np.abs(arm.bias(q, np.zeros(arm.nv))).max() < 1e-9 * 400 * G
    assert arm.deflection(q)[1] < -0.1
    assert arm.modes(q).stable


def test_equilibrium_of_a_pendulum() -> None:
    arm = pendulum()
    for start in (0.0, 1.5, -3.0):  # level, where the stiffness is zero; almost upright
        q = arm.equilibrium([start])
        assert np.cos(q[0] + np.pi / 2) == pytest.approx(1.0, abs=1e-14)
    assert arm.equilibrium([np.pi / 2])[0] == pytest.approx(np.pi / 2, abs=1e-15)  # in balance already
    assert arm.equilibrium(tau=[0.5 * G])[0] == pytest.approx(-np.pi / 3)
    assert arm.equilibrium([0.3], lock=[0])[0] == 0.3
    held = pendulum(stiffness=20.0).equilibrium()[0]
    assert 20.0 * held == pytest.approx(-G * np.cos(held), rel=1e-14)
    with refuses("Newton", "'link 0 revolute'", "no equilibrium", "steps"):
        arm.equilibrium(tau=[1.1 * G])
    falls = fa.Arm([fa.Link(fa.Prismatic("y"), BODY)], gravity=(0, -G, 0))
    with refuses("no equilibrium"):
        falls.equilibrium()
    assert falls.equilibrium(tau=[BODY.mass * G])[0] == 0.0


@pytest.mark.parametrize("seed", range(6))
def test_untruncated_arms_always_sag_to_rest(seed: int) -> None:
    """Joints locked, order exact: the elastic energy outgrows that of any weight, however floppy the beams (E down to
    1e7 Pa here), so there is an equilibrium. (Order 2 may have none: its shortening grows as deflection squared.)"""
    arm = random_arm(np.random.default_rng(seed), 3, orders=("exact",))
    q = arm.equilibrium(lock=[k for k, link in enumerate(arm.links) if link.joint.nv])
    elastic = [k for k, name in enumerate(arm.coordinates) if any(s in name for s in STRAINS)]
    weight = sum(link.mass for link in arm.links) * np.linalg.norm(arm.gravity)
    assert np.abs(arm.bias(q, np.zeros(arm.nv))[elastic]).max(initial=0.0) < 1e-11 * weight


def test_a_ball_hangs() -> None:
    """A flexible two-link arm on balls: its centre of mass ends below the base, and it is stable."""
    strip = dataclasses.replace(STRIP, order="exact", gauss_points=12)
    arm = fa.Arm([fa.Link(fa.Spherical(), BODY, strip, BODY)] * 2, gravity=(0, 0, -G))
    q = arm.equilibrium()
    np.testing.assert_allclose(arm.center_of_mass(q)[:2], 0.0, atol=1e-9)
    assert arm.center_of_mass(q)[2] < -0.5
    assert np.linalg.norm(q[:4]) == pytest.approx(1.0, abs=1e-15)
    assert (arm.modes(q).eigenvalues.real < 1e-3).all()  # turning about the vertical is indifferent


def test_more_bad_input() -> None:
    arm = pendulum()
    for call in (arm.forward_derivatives, arm.linearize):
        with refuses("q has shape (2,)"):
            call([0.0, 0.0], [0.0])
    with refuses("q has shape (2,)"):
        arm.equilibrium([0.0, 0.0])
    with refuses("lock", "link = 1"):
        arm.equilibrium(lock=[1])
    with refuses("link = 4"):
        arm.acceleration([0.0], [0.0], [0.0], 4)
    wheel = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(inertia=(1, 1, 1)))])
    with refuses("link", "mass"):
        wheel.center_of_mass([0.0])


def slender(length: float = 1.0, **modes: int) -> fa.Arm:
    """A clamped rod of order exact, EI = 1 N m^2 both ways, GJ = 0.8 N m^2."""
    section = fa.sections.GeneralSection(1.0, 1.0, 1.0, 2.0)
    material = fa.Material(1.0, 1.0, shear_modulus=0.4)
    beam = fa.Beam(length, section, material, modes, "legendre", "exact")
    return fa.Arm([fa.Link(fa.Fixed(), beam=beam)])


def left_over(arm: fa.Arm, q: np.ndarray, loads: list[fa.Load]) -> float:
    return float(np.abs(arm.inverse_dynamics(q, np.zeros(arm.nv), np.zeros(arm.nv), loads=loads)).max())


@pytest.mark.parametrize("P", [2.0, 9.0, 25.0])
def test_a_follower_force(P: float) -> None:
    """A force across the tip that turns with it, P L^2/EI = P. From the tip inward K' = -P cos(angle to the tip), which
    is integrated apart: there is no potential, so that only Newton's iteration on the forces finds the balance."""
    far = solve_ivp(lambda s, y: [y[1], P * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])], (0, 1), np.zeros(4),
                    rtol=1e-12, atol=1e-13).y[:, -1]  # fmt: skip
    turn = far[0]  # of the tip, from the root
    tip = [np.cos(turn) * far[2] + np.sin(turn) * far[3], np.sin(turn) * far[2] - np.cos(turn) * far[3]]
    arm = slender(bending_y=16)
    load = fa.Load(force=(0, P, 0), axes="section")
    q = arm.equilibrium(loads=[load])
    p, R = arm.frame(q)
    np.testing.assert_allclose(p[:2], tip, atol=1e-7)
    assert np.arctan2(R[1, 0], R[0, 0]) == pytest.approx((turn + np.pi) % (2 * np.pi) - np.pi, abs=1e-7)
    assert left_over(arm, q, [load]) < 1e-9 * P


def test_a_dead_moment_in_space() -> None:
    """A moment that keeps its direction has no potential in space. K(x) = C^-1 R^T m, R' = R K~ from the root on."""
    m = np.array([0.6, 0.9, 1.8])

    def slope(_: float, y: np.ndarray) -> np.ndarray:
        R = y[3:].reshape(3, 3)
        k = (R.T @ m) / [0.8, 1.0, 1.0]
        return np.concatenate([R[:, 0], (R @ np.cross(np.eye(3), k)).ravel()])

    end = solve_ivp(slope, (0, 1), np.concatenate([np.zeros(3), np.eye(3).ravel()]), rtol=1e-11, atol=1e-12).y[:, -1]
    arm = slender(bending_y=8, bending_z=8, torsion=8)
    load = fa.Load(moment=tuple(m))
    q = arm.equilibrium(loads=[load])
    p, R = arm.frame(q)
    np.testing.assert_allclose(p, end[:3], atol=1e-7)
    np.testing.assert_allclose(R, end[3:].reshape(3, 3), atol=1e-7)
    assert left_over(arm, q, [load]) < 1e-9


@pytest.mark.parametrize("axes", ["world", "section"])
@pytest.mark.parametrize("length", [0.005, 1.0, 300.0])
def test_the_size_of_a_beam_does_not_matter(length: float, axes: str) -> None:
    """A quarter turn by an end moment is a quarter circle: strains of a short beam are large numbers (1/m)."""
    arm = slender(length, bending_y=3)
    p, R = arm.frame(arm.equilibrium(loads=[fa.Load(moment=(0, 0, 0.5 * np.pi / length), axes=axes)]))
    np.testing.assert_allclose(p / length, [2 / np.pi, 2 / np.pi, 0], atol=1e-9)
    np.testing.assert_allclose(R[:, 0], [0, 1, 0], atol=1e-9)


def test_an_arc_under_a_follower_force() -> None:
    """The 45 degree bend of Bathe and Bolourchi 1979 (radius 100, unit square, E = 1e7, 600 out of its plane) in eight
    straight pieces, the force turning with the tip."""
    n, radius = 8, 100.0
    turn = np.pi / 4 / n
    chord = 2 * radius * np.sin(turn / 2)
    beam = fa.Beam(chord, fa.Rectangle(1.0, 1.0), fa.Material(1.0, 1e7, shear_modulus=5e6),
                   {"bending_y": 2, "bending_z": 2, "torsion": 2}, "legendre", "exact")  # fmt: skip
    seats = [fa.Placement(rotation=(0, 0, a)) for a in (turn / 2, *[turn] * (n - 1))]
    arm = fa.Arm([fa.Link(fa.Fixed(inboard=seat), beam=beam) for seat in seats])
    end = radius * np.array([np.sqrt(0.5), 1 - np.sqrt(0.5), 0])
    np.testing.assert_allclose(arm.frame(arm.zero)[0], end, rtol=1e-12, atol=1e-12)
    loads = [fa.Load(force=(0, 0, 600.0), axes="section")]
    q = arm.equilibrium(loads=loads)
    assert left_over(arm, q, loads) < 1e-8 * 600
    dead = arm.frame(arm.equilibrium(loads=[fa.Load(force=(0, 0, 600.0))]))[0]
    np.testing.assert_allclose(dead[[1, 0, 2]], [15.7, 47.2, 53.4], atol=0.5)  # Simo & Vu-Quoc 1986: straight elements


def test_what_hangs_on_nothing_is_said() -> None:
    """A tangential follower force on a free body, a moment on a free joint: no balance, and the message says where."""
    wheel = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, inertia=(1, 1, 1), end=(1, 0, 0)))])
    with refuses("'link 0 revolute'", "no equilibrium"):
        wheel.equilibrium(loads=[fa.Load(force=(0, 1.0, 0), axes="section")])


def test_no_saddle_is_given_for_a_balance() -> None:
    """A strip on edge sags in its plane until it tips over sideways: P = 4.013 sqrt(EI GJ)/L^2. A pull in that plane
    alone has no part sideways, and a column under its own axis none at all."""
    section = fa.sections.GeneralSection(1.0, 1.0, 400.0, 0.5)
    beam = fa.Beam(1.0, section, fa.Material(1.0, 1.0, shear_modulus=1.0),
                   {"bending_y": 3, "bending_z": 4, "torsion": 4}, "legendre", "exact")  # fmt: skip
    arm = fa.Arm([fa.Link(fa.Fixed(), beam=beam)])
    strong, weak = section.second_moment_z, section.second_moment_y
    critical = 4.0126 * np.sqrt(min(strong, weak) * 0.5)
    along = 1 if strong > weak else 2
    for P, tips in ((0.95, False), (1.3, True)):
        force = np.zeros(3)
        force[along] = P * critical
        loads = [fa.Load(force=tuple(force))]
        q = arm.equilibrium(loads=loads)
        assert (abs(arm.frame(q)[0][3 - along]) > 0.01) == tips
        assert arm.modes(q, loads=loads).stable and left_over(arm, q, loads) < 1e-9
    push = [fa.Load(force=(-3.0, 0.0, 0.0))]  # critical is pi^2/4
    column = slender(bending_y=4)
    with warns(fa.errors.StateWarning, "equilibrium", "'link 0 bending_y 1'", "unstable", "start"):
        straight = column.equilibrium(loads=push)
    assert not straight.any() and not column.equilibrium(straight, loads=push).any()
    assert column.modes(column.equilibrium(straight + 1e-3, loads=push), loads=push).stable


def test_a_strip_that_hardly_stretches_tips_over() -> None:
    """Strains with hardly any inertia and much stiffness do not hide what is soft, just above the critical load."""
    section = fa.sections.GeneralSection(1e-6, 1.3e-15, 1.3e-13, 1e-15, 1.0)
    beam = fa.Beam(1.0, section, fa.Material(1.0, 1e15, shear_modulus=1e15),
                   {s: 6 for s in STRAINS}, "legendre", "exact")  # fmt: skip
    arm = fa.Arm([fa.Link(fa.Fixed(), beam=beam)])
    loads = [fa.Load(force=(0.0, -1.05 * 4.0126 * np.sqrt(1.3), 0.0))]
    q = arm.equilibrium(loads=loads)
    assert abs(arm.frame(q)[0][2]) > 0.1 and arm.modes(q, loads=loads).stable


def test_a_balance_beyond_an_orders_range_is_told() -> None:
    section, material = fa.sections.GeneralSection(1.0, 1.0, 1.0, 2.0), fa.Material(1.0, 1.0, shear_modulus=0.4)
    arm = fa.Arm([fa.Link(fa.Fixed(), beam=fa.Beam(1.0, section, material, {"bending_y": 4}, "legendre", 2))])
    arm.equilibrium(loads=[fa.Load(force=(0.0, 0.5, 0.0))])
    with warns(fa.errors.RangeWarning, "equilibrium", "link 0", "order 2", "turns"):
        arm.equilibrium(loads=[fa.Load(force=(0.0, 2.0, 0.0))])
    arm = fa.Arm([fa.Link(fa.Fixed(), beam=fa.Beam(1.0, section, material, {"bending_y": 10}, "legendre", 3))])
    with refuses('"exact"', "balance"):
        arm.equilibrium(loads=[fa.Load(force=(0.0, 9.0, 0.0), axes="section")])


def test_a_beam_far_too_soft_for_its_load_is_refused() -> None:
    """A rod of k G A = 1.67 mN under 8.8 N would shear by 5300: no beam does, nor is it worth 10 000 Newton steps."""
    rod = fa.Beam(0.9, fa.Rectangle(0.01, 0.01), fa.Material(1e-9, 2.6, shear_modulus=20.0), {"shear_y": 1}, order=2)
    tip = fa.RigidBody(0.9, (0, 0, 0), (0.1, 0.1, 0.1))
    arm = fa.Arm([fa.Link(fa.Revolute("z"), beam=rod, tip=tip)], (0, -9.81, 0))
    with refuses("load", "link 0", "bent"):
        arm.modes()
    with refuses("steps", "load"):
        arm.equilibrium(lock=[0])
