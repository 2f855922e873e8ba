"""Order "exact" in space, against SciPy's integration of R' = R K~, x' = R [1 + eps, phi12, phi13] from strains written
down here; bent by a whole turn and beyond."""

import warnings

import flexarm as fa
import numpy as np
import pytest
from arms import derivative
from messages import refuses, warns
from numpy.polynomial import legendre
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

SHAPES = {
    "bending and twist": {"bending_y": 3, "bending_z": 3, "torsion": 1},
    "two of each": {"bending_y": 2, "bending_z": 2, "torsion": 2},
    "eight bending shapes, one shear": {"bending_y": 4, "bending_z": 4, "shear_y": 1},
    "eight along y": {"bending_y": 8, "bending_z": 1, "shear_y": 1},
    "every strain": {"bending_y": 2, "bending_z": 2, "torsion": 1, "shear_y": 1, "shear_z": 1, "extension": 2},
}
ROWS = {"bending_y": (2, 1), "bending_z": (1, -1), "torsion": (0, 1), "shear_y": (3, 1), "shear_z": (4, 1)}
ROWS["extension"] = 5, 1
X = np.array([0.1, 0.37, 0.5, 0.83, 1.0])


def make(modes: dict, order: int | str = "exact", **options) -> fa.Arm:
    material = fa.Material(2000, 1e7, 0.3)
    beam = fa.Beam(1.0, fa.Rectangle(0.02, 0.03), material, modes, "legendre", order, **options)
    return fa.Arm([fa.Link(fa.Revolute("y"), fa.RigidBody(0.5, inertia=(0.1,) * 3), beam, fa.RigidBody(0.3))])


def strains(modes: dict, q: np.ndarray, x: np.ndarray) -> np.ndarray:
    """K1 K2 K3 phi12 phi13 eps at places of a beam of 1 m (6, nx)."""
    out, at = np.zeros((6, np.size(x))), 0
    for name in ROWS:
        n = modes.get(name, 0)
        row, sign = ROWS[name]
        if n:
            out[row] += sign * legendre.legval(2 * np.atleast_1d(x) - 1, q[at : at + n])
        at += n
    return out


def truth(modes: dict, q: np.ndarray, x: np.ndarray = X) -> tuple[np.ndarray, np.ndarray]:
    """Position and orientation of the sections at x."""
    line = [np.zeros(1) for _ in ROWS]  # strains as polynomials of X
    at = 0
    for name in ROWS:
        n, (row, sign) = modes.get(name, 0), ROWS[name]
        if n:
            line[row] = sign * legendre.Legendre(q[at : at + n], [0, 1]).convert(kind=np.polynomial.Polynomial).coef
        at += n
    most = max(map(len, line))
    C = np.array([np.pad(c, (0, most - len(c))) for c in line])
    powers = np.arange(most)

    def slope(s: float, y: np.ndarray) -> list[float]:
        K1, K2, K3, f, g, e = C @ s**powers
        w, a, b, c = y[:4]
        n = w * w + a * a + b * b + c * c
        return [
            -0.5 * (a * K1 + b * K2 + c * K3),
            0.5 * (w * K1 + b * K3 - c * K2),
            0.5 * (w * K2 + c * K1 - a * K3),
            0.5 * (w * K3 + a * K2 - b * K1),
            ((w * w + a * a - b * b - c * c) * (1 + e) + 2 * (a * b - w * c) * f + 2 * (a * c + w * b) * g) / n,
            (2 * (a * b + w * c) * (1 + e) + (w * w - a * a + b * b - c * c) * f + 2 * (b * c - w * a) * g) / n,
            (2 * (a * c - w * b) * (1 + e) + 2 * (b * c + w * a) * f + (w * w - a * a - b * b + c * c) * g) / n,
        ]

    y = solve_ivp(slope, (0, 1), [1.0, 0, 0, 0, 0, 0, 0], "DOP853", x, rtol=1e-13, atol=1e-14).y
    return y[4:].T, Rotation.from_quat(np.column_stack([*y[1:4], y[0]])).as_matrix()


def bent(modes: dict, turn: float, seed: int = 0) -> np.ndarray:
    """Coordinates of which the integral of K is `turn` where it is largest."""
    rng = np.random.default_rng(seed)
    q = rng.normal(size=sum(modes.values()))
    n = sum(k for name, k in modes.items() if "shear" not in name and name != "extension")
    q[n:] = 0
    x, w = legendre.leggauss(400)
    angle = np.cumsum(0.5 * w * strains(modes, q, 0.5 * (1 + x))[:3], axis=1)
    q *= turn / np.linalg.norm(angle, axis=0).max()
    q[n:] = 0.05 * rng.normal(size=q.size - n)
    return q


def wrong(arm: fa.Arm, modes: dict, q: np.ndarray) -> tuple[float, float]:
    """Largest errors of place (m) and of rotation (rad)."""
    q = np.r_[0.0, q]
    places, turns = truth(modes, q[1:])
    frames = [arm.frame(q, 0, x) for x in X]
    return (
        max(np.abs(p - x).max() for (p, _), x in zip(frames, places, strict=True)),
        max(np.abs(R - T).max() for (_, R), T in zip(frames, turns, strict=True)),
    )


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("turn", [1.0, 3.0, 2 * np.pi])
def test_up_to_a_whole_turn(name: str, turn: float) -> None:
    modes = SHAPES[name]
    for seed in range(2):
        assert max(wrong(make(modes), modes, bent(modes, turn, seed))) < 1e-10


@pytest.mark.parametrize("shape", ["bending_y", "torsion"])
def test_the_highest_shape_alone(shape: str) -> None:
    """It turns sections by 1 rad, and the beam is bent to an arc besides."""
    modes = {"bending_y": 3, "bending_z": 1, "torsion": 3}
    q = np.zeros(7)
    q[[3, {"bending_y": 2, "torsion": 6}[shape]]] = 1.0, 1 / 0.0962
    assert max(wrong(make(modes), modes, q)) < 1e-10


@pytest.mark.parametrize("turn", [3.0, 8.0, 20.0])
def test_sections_stay_rotations(turn: float) -> None:
    """However far they are turned, with enough points or, as far as 12 points can tell anything, without."""
    for modes in SHAPES.values():
        for options in ({}, {"gauss_points": 12}) if turn < 20 else ({},):
            arm = make(modes, **options)
            q = np.r_[0.3, bent(modes, turn)]
            for x in (0.2, None):
                R = arm.frame(q, 0, x)[1]
                np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-13)
                assert np.linalg.det(R) > 0


@pytest.mark.parametrize("turn", [80.0, 200.0, 1e3])
def test_a_beam_wound_up_without_end_is_refused(turn: float) -> None:
    """Beyond some 60 rad in space the series has no digits: it gave R = I, and called that resolved to 1e-16."""
    few, many = {"gauss_points": 12}, {"gauss_points": 40}
    for name, options in (("bending and twist", {}), ("eight along y", few), ("two of each", many)):
        arm = make(SHAPES[name], **options)
        q = np.r_[0.3, bent(SHAPES[name], turn)]
        for ask in (arm.frame, arm.mass_matrix, lambda q, arm=arm: arm.inverse_dynamics(q, 0 * q, 0 * q)):
            with refuses("finite"):
                ask(q)
    with refuses("finite", error=fa.SimulationError):
        fa.simulate(arm, [0, 1e-3], q)


def test_ten_radians_more_than_a_turn_are_right_with_enough_points() -> None:
    modes = SHAPES["two of each"]
    for turn in (10.0, 20.0, 30.0):
        assert max(wrong(make(modes, gauss_points=48), modes, bent(modes, turn))) < 1e-9


@pytest.mark.parametrize("name", SHAPES)
def test_what_forces_do_is_stored(name: str) -> None:
    """v tau = dE/dt along a motion, and the Jacobian is that of the places, at a whole turn."""
    modes = SHAPES[name]
    arm = make(modes)
    rng = np.random.default_rng(1)
    q, v, a = np.r_[0.3, bent(modes, 2 * np.pi)], rng.normal(size=arm.nv), rng.normal(size=arm.nv)

    energy = derivative(lambda s: np.sum(arm.energy(q + v * s + 0.5 * a * s * s, v + a * s)), 0.0, 2e-3)
    power = v @ arm.inverse_dynamics(q, v, a)
    assert abs(power - energy) < 1e-8 * np.abs(v * arm.inverse_dynamics(q, v, a)).max()
    for x in (0.37, 1.0, None):
        rate = derivative(lambda s, x=x: arm.frame(q + v * s, 0, x)[0], 0.0, 2e-3)
        np.testing.assert_allclose((arm.jacobian(q, 0, x) @ v)[:3], rate, atol=1e-9 * np.abs(rate).max())


def test_energy_over_a_run() -> None:
    """A strip let go from most of a turn, bent and twisted."""
    modes = {"bending_y": 2, "bending_z": 2, "torsion": 1}
    arm = make(modes)
    q0 = np.r_[0.0, bent(modes, 5.0)]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        r = fa.simulate(arm, np.linspace(0, 0.1, 6), q0, integrator="gauss", step=2e-4)
    energy = np.sum(r.energy(), axis=0)
    np.testing.assert_allclose(energy, energy[0], rtol=1e-7)
    assert np.ptp(r.q, axis=0).max() > 1


@pytest.mark.parametrize("modes", [*SHAPES.values(), {"bending_y": 3}, {"bending_z": 5, "shear_z": 1}])
def test_estimate_of_what_is_truncated(modes: dict) -> None:
    """What a beam says of itself is what SciPy finds, also where it is all wrong."""
    q = bent(modes, 6.0)
    worst = 0.0
    for options in ({}, {"gauss_points": 10}):
        arm = make(modes, **options)
        estimate, true = arm.links[0].beam._core.truncation(q[None])[0], max(wrong(arm, modes, q))
        assert 0.3 * true - 1e-11 < estimate < 10 * true + 1e-11, (options, estimate, true)
        worst = max(worst, true)
    assert worst > 1e-7
    assert make(modes, 2).links[0].beam._core.truncation(np.ones((1, len(q)))) == 0


def test_a_run_that_bends_too_far_for_its_points_says_so() -> None:
    modes = {"bending_y": 8, "bending_z": 1}
    arm = make(modes)
    q0 = np.zeros(arm.nq)
    q0[8] = 160.0  # the eighth shape: 3 rad
    t = np.linspace(0, 1e-4, 3)
    with warns(fa.errors.RangeWarning, "link 0", '"exact"', "60", "Gauss") as caught:
        fa.simulate(arm, t, q0, integrator="gauss", step=1e-5)
    found = caught[0].message
    assert found.link == 0 and found.time == 0 and 1.5 < found.finding.value < 4
    again = make(modes, gauss_points=120)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fa.simulate(again, t, q0, integrator="gauss", step=1e-5)
    few = make({"bending_y": 2}, gauss_points=4)  # in the plane as well
    with warns(fa.errors.RangeWarning, "gauss_points = 8"):
        fa.simulate(few, t, [0, 3.0, 3.0], integrator="gauss", step=1e-5)
