"""Static balance under gravity, springs and forces."""

import flexarm as fa
import numpy as np
import pytest
from arms import BODY, STEEL, STRIP, G, pendulum, random_arm


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
    with pytest.raises(ValueError, match=r"no equilibrium was found: .* Newton steps .* 'link 0 revolute'"):
        arm.equilibrium(tau=[1.1 * G])
    falls = fa.Arm([fa.Link(fa.Prismatic("y"), BODY)], gravity=(0, -G, 0))
    with pytest.raises(ValueError, match="no equilibrium was found"):
        falls.equilibrium()
    assert falls.equilibrium(tau=[BODY.mass * G])[0] == 0.0


@pytest.mark.parametrize("seed", range(6))
def test_untruncated_arms_always_sag_to_rest(seed: int) -> None:
    """Joints locked, order exact: the elastic energy outgrows that of any weight, however floppy the beams (E down to
    1e7 Pa here), so there is an equilibrium. (Order 2 may have none: its shortening grows as deflection squared.)"""
    arm = random_arm(np.random.default_rng(seed), 3, orders=("exact",))
    q = arm.equilibrium(lock=[k for k, link in enumerate(arm.links) if link.joint.nv])
    elastic = [k for k, name in enumerate(arm.coordinates) if any(s in name for s in ("bending", "torsion", "shear"))]
    weight = sum(link.mass for link in arm.links) * np.linalg.norm(arm.gravity)
    assert np.abs(arm.bias(q, np.zeros(arm.nv))[elastic]).max(initial=0.0) < 1e-11 * weight


def test_a_ball_hangs() -> None:
    """A flexible two-link arm on balls: its centre of mass ends below the base, and it is stable."""
    arm = fa.Arm([fa.Link(fa.Spherical(), BODY, STRIP, BODY)] * 2, gravity=(0, 0, -G))
    q = arm.equilibrium()
    np.testing.assert_allclose(arm.center_of_mass(q)[:2], 0.0, atol=1e-9)
    assert arm.center_of_mass(q)[2] < -0.5
    assert np.linalg.norm(q[:4]) == pytest.approx(1.0, abs=1e-15)
    assert (arm.modes(q).eigenvalues.real < 1e-3).all()  # turning about the vertical is indifferent


def test_more_bad_input() -> None:
    arm = pendulum()
    for call in (arm.forward_derivatives, arm.linearize):
        with pytest.raises(ValueError, match=r"q has shape \(2,\)"):
            call([0.0, 0.0], [0.0])
    with pytest.raises(ValueError, match=r"q has shape \(2,\)"):
        arm.equilibrium([0.0, 0.0])
    with pytest.raises(ValueError, match="lock: link = 1"):
        arm.equilibrium(lock=[1])
    with pytest.raises(ValueError, match="link = 4"):
        arm.acceleration([0.0], [0.0], [0.0], 4)
    wheel = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(inertia=(1, 1, 1)))])
    with pytest.raises(ValueError, match="no link has a mass"):
        wheel.center_of_mass([0.0])
