"""Rotations of balls in every integrator: steady spin, Euler's top (Jacobi's functions), momentum of free arms."""

from itertools import pairwise

import flexarm as fa
import numpy as np
import pytest
from arms import paper_link
from scipy.integrate import quad
from scipy.spatial.transform import Rotation
from scipy.special import ellipj

MOMENTS = np.array([0.01, 0.02, 0.024])  # kg m^2


def free_body() -> fa.Arm:
    return fa.Arm([fa.Link(fa.Free(), fa.RigidBody(1.5, inertia=MOMENTS))])


def matrices(q: np.ndarray) -> np.ndarray:
    """From the quaternions w x y z in columns 3 to 6."""
    return Rotation.from_quat(np.roll(q[..., 3:7], -1, axis=-1)).as_matrix()


def angle(found: np.ndarray, expected: np.ndarray) -> float:
    """The largest angle between two rotations (rad)."""
    return float(np.linalg.norm(found - expected, axis=(-2, -1)).max() / np.sqrt(2))


class Top:
    """Euler's free body, L^2 > 2 E I2 (Landau & Lifshitz, Mechanics, 37): rates by Jacobi's functions; its attitude by
    Euler's angles about the angular momentum, of which phi is a quadrature."""

    def __init__(self, w1: float, w3: float) -> None:
        I1, I2, I3 = MOMENTS
        E2, self.L = I1 * w1**2 + I3 * w3**2, np.hypot(I1 * w1, I3 * w3)
        small, large = E2 * I3 - self.L**2, self.L**2 - E2 * I1
        assert self.L**2 > E2 * I2
        self.rate = np.sqrt((I3 - I2) * large / (I1 * I2 * I3))
        self.m = (I2 - I1) * small / ((I3 - I2) * large)
        self.size = np.sqrt([small / (I1 * (I3 - I1)), small / (I2 * (I3 - I2)), large / (I3 * (I3 - I1))])
        assert np.allclose(self.w(0.0), [w1, 0, w3], rtol=1e-14)

    def w(self, t: float) -> np.ndarray:
        sn, cn, dn, _ = ellipj(self.rate * t, self.m)
        return self.size * [cn, sn, dn]

    def rotations(self, times: np.ndarray) -> np.ndarray:
        """From the attitude at time 0."""

        def precession(t: float) -> float:
            M = MOMENTS * self.w(t)
            return self.L * (M[:2] @ self.w(t)[:2]) / (M[:2] @ M[:2])

        phi = np.cumsum([0.0] + [quad(precession, a, b, epsabs=1e-14, epsrel=1e-13)[0] for a, b in pairwise(times)])
        out = []
        for at, t in zip(phi, times, strict=True):
            M = MOMENTS * self.w(t) / self.L
            out.append(Rotation.from_euler("ZXZ", [at, np.arccos(M[2]), np.arctan2(M[0], M[1])]))
        return (out[0].inv() * Rotation.concatenate(out)).as_matrix()


@pytest.mark.parametrize("stages", [1, 2, 3, 4])
@pytest.mark.parametrize("step", [0.1, 0.02])
def test_steady_spin_in_gauss(stages: int, step: float) -> None:
    """10 rad/s about z for 10 s: to rounding, whatever the step."""
    t = np.linspace(0, 10, 41)
    r = fa.simulate(free_body(), t, v0=[0, 0, 0, 0, 0, 10], integrator="gauss", step=step, stages=stages)
    turns = Rotation.from_rotvec(10 * np.outer(t, [0, 0, 1])).as_matrix()
    assert angle(matrices(r.q), turns) < 2e-11
    np.testing.assert_allclose(np.linalg.norm(r.q[:, 3:], axis=1), 1, atol=1e-14)


@pytest.mark.parametrize("stages", [1, 2, 3, 4])
def test_order_on_eulers_top(stages: int) -> None:
    """Twice the stages, in rate and in attitude."""
    t, top = np.array([0.0, 1.6]), Top(3.0, 8.0)
    truth = top.rotations(t)
    steps = {1: 0.01, 2: 0.04, 3: 0.08, 4: 0.16}[stages] / np.array([1, 2])
    errors = []
    for step in steps:
        r = fa.simulate(free_body(), t, v0=[0, 0, 0, 3, 0, 8], integrator="gauss", step=step, stages=stages)
        assert r.stats["failed_steps"] == 0
        errors.append([angle(matrices(r.q), truth), np.abs(r.v[-1, 3:] - top.w(1.6)).max()])
    rates = np.log2(np.divide(*errors))
    np.testing.assert_allclose(rates, 2 * stages, atol=0.35), errors


@pytest.mark.parametrize(
    ("integrator", "options", "error"),
    [
        ("gauss", {"step": 0.02}, 1e-10),
        ("gauss", {"step": 0.005}, 1e-11),
        ("ida", {"rtol": 1e-11, "atol": 1e-13}, 1e-7),
        ("implicit", {"step": 1e-3}, 3e-4),
        ("rk4", {"step": 1e-3}, 1e-8),
    ],
)
def test_eulers_top(integrator: str, options: dict, error: float) -> None:
    """Rows within the steps as well; gauss has no floor but rounding, also where steps are small."""
    t, top = np.linspace(0, 4, 81), Top(3.0, 8.0)
    r = fa.simulate(free_body(), t, v0=[0, 0, 0, 3, 0, 8], integrator=integrator, **options)
    assert angle(matrices(r.q), top.rotations(t)) < error
    np.testing.assert_allclose(r.v[:, 3:], [top.w(x) for x in t], atol=10 * error)


@pytest.mark.parametrize("stages", [2, 3, 4])
def test_rows_within_steps_turn_as_well(stages: int) -> None:
    """Between the ends of its steps, the attitude is of the order that other coordinates have there."""
    top, step = Top(3.0, 8.0), {2: 0.01, 3: 0.02, 4: 0.04}[stages]
    errors = []
    for h in (step, step / 2):
        t = np.arange(0.0, 0.8, 0.3 * h)
        r = fa.simulate(free_body(), t, v0=[0, 0, 0, 3, 0, 8], integrator="gauss", step=h, stages=stages)
        errors.append(angle(matrices(r.q), top.rotations(t)))
        np.testing.assert_allclose(np.linalg.norm(r.q[:, 3:], axis=1), 1, atol=1e-14)
    assert np.log2(errors[0] / errors[1]) > stages + 0.6, errors


def test_momentum_of_a_floating_arm() -> None:
    """A body and a beam on a ball, all in motion: momentum, and angular momentum about the centre of mass, in world
    axes."""
    beam = paper_link(2).links[0].beam
    arm = fa.Arm([fa.Link(fa.Free(), fa.RigidBody(1.5, inertia=MOMENTS)), fa.Link(fa.Spherical(), None, beam)])
    v0 = np.zeros(arm.nv)
    v0[:9] = 0.1, -0.2, 0.3, 2, -3, 1, 1, 2, -1.5
    r = fa.simulate(arm, np.linspace(0, 2, 11), v0=v0, integrator="gauss", step=5e-3)
    p = np.array([arm.momentum(q, v) for q, v in zip(r.q, r.v, strict=True)])
    assert np.abs(p - p[0]).max() < 1e-10 * np.abs(p[0]).max()
    energy = np.sum(r.energy(), axis=0)
    np.testing.assert_allclose(energy, energy[0], rtol=1e-10)
    assert np.ptp(r.q[:, 7:11], axis=0).max() > 0.5
