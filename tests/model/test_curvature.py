"""Beams that are curved or twisted at rest: shapes, equilibria, frequencies, energy, and how they are given."""

import pickle
from dataclasses import replace

import flexarm as fa
import numpy as np
import pytest
from arms import shear_modulus
from messages import refuses
from numpy.polynomial.legendre import legval
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

STEEL = fa.Material(7850.0, 209e9, 0.3)
STRIP = fa.Rectangle(0.004, 0.006)
ALL = {"bending_y": 2, "bending_z": 2, "torsion": 1, "shear_y": 1, "shear_z": 1, "extension": 1}


def beam(curvature, modes=ALL, length: float = 0.5, **more) -> fa.Beam:
    return fa.Beam(length, STRIP, STEEL, modes, **{"basis": "legendre", "order": "exact"} | more, curvature=curvature)


def wave(x: float) -> list[float]:
    return [2.0 + x, 3.0 * np.sin(4 * x), -4.0 * x]


def held(b: fa.Beam, tip: fa.RigidBody | None = None, gravity=(0, 0, 0)) -> fa.Arm:
    return fa.Arm([fa.Link(fa.Fixed(), None, b, tip)], gravity)


def test_the_motion_of_sections_against_integration() -> None:
    """R' = R (K0 + K)~, x' = R (1 + eps, phi12, phi13)."""
    arm = held(beam(wave))
    rng = np.random.default_rng(1)
    for size in (0.0, 1.0):
        q = size * rng.normal(size=8) * [4, 4, 4, 4, 4, 0.05, 0.05, 0.05]

        def slope(s: float, y: np.ndarray, q=q) -> np.ndarray:
            e, R = arm.strain(q, 0, s), y[3:].reshape(3, 3)
            K = np.array(wave(s)) + e[:3]
            W = np.array([[0, -K[2], K[1]], [K[2], 0, -K[0]], [-K[1], K[0], 0]])
            return np.concatenate([R @ (1 + e[5], e[3], e[4]), (R @ W).ravel()])

        y = solve_ivp(slope, (0, 0.5), [0, 0, 0, *np.eye(3).ravel()], "DOP853", [0.2, 0.5], rtol=1e-12, atol=1e-13).y
        for x, end in zip((0.2, 0.5), y.T, strict=True):
            p, R = arm.frame(q, 0, x)
            assert np.abs(p - end[:3]).max() < 1e-10 and np.abs(R - end[3:].reshape(3, 3)).max() < 1e-10


def determinant(mu: float, angle: float, clamp) -> float:
    """Of the conditions at both ends on exponentials; its other end is free."""
    r = np.sqrt(np.roots([1, 2, 1 - mu, mu]).astype(complex))
    r = np.concatenate([r, -r])
    end = np.exp(r * angle)
    scale = 1 / np.maximum(1, np.abs(end))
    rows = [*clamp(r, mu), (r**3 + r) * end, (r**4 + r**2) * end, (r**5 + r**3 - mu * r) * end]
    det = np.linalg.det(np.array(rows) * scale)
    vandermonde = np.prod([r[j] - r[i] for i in range(6) for j in range(i)])
    return float((det / vandermonde).real)


@pytest.mark.parametrize("angle", [0.5, np.pi / 2, np.pi, 1.9 * np.pi])
def test_the_frequencies_of_an_arc(angle: float) -> None:
    """In its plane, clamped and free, without stretch (Love): v'''''' + 2 v'''' + v'' = mu (v'' - v) of the tangential
    displacement v, mu = rho A R^4 w^2 / EI; v = v' = v'' = 0; v''' + v' = v'''' + v'' = v''''' + v''' - mu v' = 0."""
    L = 0.5
    arm = held(beam((0, 0, angle / L), {"bending_y": 14}, rotary_inertia=False))
    R = L / angle

    def singular(mu: float) -> float:
        return determinant(mu, angle, lambda r, mu: [r**0, r, r**2])

    unit = np.sqrt(209e9 * STRIP.second_moment_z / (7850 * STRIP.area)) / R**2
    for w in arm.modes().frequencies[:3]:
        mu = (w / unit) ** 2
        root = brentq(singular, 0.98 * mu, 1.02 * mu, xtol=1e-14, rtol=1e-14)
        assert mu == pytest.approx(root, rel=2e-7)


def test_an_open_ring_free_at_both_ends() -> None:
    """By the same equation."""
    L = 1.0
    b = beam((0, 0, 2 * np.pi / L), {"bending_y": 14}, L, rotary_inertia=False)
    joint = fa.Planar()
    free = fa.Arm([fa.Link(joint, None, b)])
    unit = np.sqrt(209e9 * STRIP.second_moment_z / (7850 * STRIP.area)) * (2 * np.pi / L) ** 2
    found = [w for w in free.modes().frequencies if w > 1e-2 * unit]

    def singular(mu: float) -> float:
        return determinant(mu, 2 * np.pi, lambda r, mu: [r**3 + r, r**4 + r**2, r**5 + r**3 - mu * r])

    for w in found[:3]:
        mu = (w / unit) ** 2
        assert mu == pytest.approx(brentq(singular, 0.98 * mu, 1.02 * mu, xtol=1e-14, rtol=1e-14), rel=2e-7)


def test_a_straightened_arc() -> None:
    """A moment EI K0 the other way makes a cantilever arc straight."""
    K = 3.0
    arm = held(beam((0, 0, K), {"bending_y": 2, "shear_y": 1, "extension": 1}))
    EI = 209e9 * STRIP.second_moment_z
    q = arm.equilibrium(loads=[fa.Load(moment=(0, 0, -EI * K))])
    p, R = arm.frame(q)
    assert np.abs(p - [0.5, 0, 0]).max() < 1e-12 and np.abs(R - np.eye(3)).max() < 1e-11
    assert arm.strain(q, 0, 0.1)[2] == pytest.approx(-K, rel=1e-12)
    assert arm.deflection(q, 0)[1] == pytest.approx(-(1 - np.cos(0.5 * K)) / K)


def test_the_springs_of_a_coil() -> None:
    """A helix of small pitch under an axial force: f = P R^2 s / GJ (and bending's share, of the pitch squared)."""
    turns, R, pitch = 2, 0.05, 1e-3
    s = np.hypot(R, pitch / (2 * np.pi)) * 2 * np.pi * turns
    k = R / (R**2 + (pitch / (2 * np.pi)) ** 2)
    tau = pitch / (2 * np.pi) / (R**2 + (pitch / (2 * np.pi)) ** 2)
    section = fa.Circle(0.002)
    modes = {"bending_y": 10, "bending_z": 10, "torsion": 10}
    coil = fa.Beam(s, section, STEEL, modes, "legendre", "exact", curvature=(tau, 0, k))
    arm = held(coil)
    axis = np.array([np.sin(np.arctan2(pitch / (2 * np.pi), R)), 0, np.cos(np.arctan2(pitch / (2 * np.pi), R))])
    arm2 = fa.Arm([fa.Link(fa.Fixed(), None, coil, fa.RigidBody(end=(0, R, 0)))])
    rest = arm.frame(arm.zero)[0]
    np.testing.assert_allclose(rest @ axis, turns * pitch, rtol=1e-9)
    P = 1e-3
    lever = fa.Load(0, None, force=P * axis, axes="world")  # through the axis, by a rigid arm
    moved = arm2.frame(arm2.equilibrium(loads=[lever]))[0] - arm2.frame(arm2.zero)[0]
    G = shear_modulus(STEEL)
    # Castigliano, clamped at one end: torque P R cos, and the moment P R sin of the pitch about the binormal
    a = np.arctan2(pitch / (2 * np.pi), R)
    EI, GJ = 209e9 * section.second_moment_z, G * section.torsion_constant
    expected = P * R**2 * s * (np.cos(a) ** 2 / GJ + np.sin(a) ** 2 / EI)
    assert moved @ axis == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("curvature", [(0, 0, 4.0), (6.0, 1.0, -3.0)])
def test_energy_is_kept(curvature) -> None:
    soft = fa.Material(2000.0, 2e7, 0.3)
    b = replace(beam(curvature), material=soft)
    arm = fa.Arm([fa.Link(fa.Revolute("z"), None, b, fa.RigidBody(0.005, inertia=(1e-6,) * 3))], (0, -9.81, 0))
    run = fa.simulate(arm, np.linspace(0, 0.3, 31), rtol=1e-8, atol=1e-10)
    total = sum(run.energy())
    assert np.ptp(total) < 1e-5 * np.ptp(run.energy()[0])


def test_a_modal_damping_ratio_is_of_the_curved_beam() -> None:
    arm = held(beam((3.0, 1.0, 5.0), damping_ratio=0.03))
    np.testing.assert_allclose(arm.modes().damping, 0.03, rtol=1e-8)


def test_a_batch_is_each_alone() -> None:
    arms = [fa.Arm([fa.Link(fa.Revolute("z"), None, beam((0.5 * k, 1.0, 4.0 - k)))]) for k in range(5)]
    v0 = np.zeros(arms[0].nv)
    v0[0] = 1.0
    for k, arm in enumerate(arms):
        many = fa.rollout(arm, np.tile(arm.zero, (9, 1)), np.linspace(0.5, 1, 9)[:, None] * v0, step=1e-4, nstep=5)
        alone = fa.rollout(arm, arm.zero, (0.5 + k / 16) * v0, step=1e-4, nstep=5)
        np.testing.assert_allclose(many.q[k], alone.q[0], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("cuts", [[0.2], [0.1, 0.35]])
def test_pieces_are_the_whole(cuts: list[float]) -> None:
    modes = {"bending_y": 8, "bending_z": 8, "torsion": 7, "shear_y": 6, "shear_z": 6, "extension": 6}
    for curvature in (wave, (2.0, -1.0, 5.0)):
        link = fa.Link(fa.Fixed(), None, beam(curvature, modes))
        push = [fa.Load(force=(3.0, -4.0, 10.0), moment=(0.1, 0.5, -0.4))]
        frames = []
        for arm in (fa.Arm([link]), fa.Arm(fa.split(link, modes, cuts))):
            assert np.abs(arm.frame(arm.zero)[0] - fa.Arm([link]).frame(np.zeros(41))[0]).max() < 1e-11
            frames.append(arm.frame(arm.equilibrium(loads=push)))
        for a, b in zip(*frames, strict=True):
            assert np.abs(a - b).max() < 1e-7


def test_without_modes_it_is_a_bent_rigid_body() -> None:
    arm = held(beam((0, 0, np.pi), {}, order=2), fa.RigidBody(0.2, com=(0.01, 0, 0)), (0, -9.81, 0))
    p, R = arm.frame([])
    np.testing.assert_allclose(p, [1 / np.pi, 1 / np.pi, 0], atol=1e-12)
    np.testing.assert_allclose(R, Rotation.from_rotvec([0, 0, np.pi / 2]).as_matrix(), atol=1e-12)
    middle = np.array([np.sin(np.pi / 4), 1 - np.cos(np.pi / 4), 0]) / np.pi
    np.testing.assert_allclose(arm.frame([], 0, 0.25)[0], middle, atol=1e-12)
    assert arm.energy([], [])[1] == pytest.approx(
        9.81 * (0.2 * (1 / np.pi + 0.01) + arm.links[0].beam.mass * (1 - 2 / np.pi) / np.pi)
    )


X = np.linspace(0, 0.5, 200)


@pytest.mark.parametrize(
    "given",
    [
        wave,
        {"x": X, "K": [wave(x) for x in X]},
        (X, np.array([wave(x) for x in X])),
        {"legendre": beam(wave).curvature["legendre"]},
    ],
)
def test_ways_to_give_it(given) -> None:
    found, want = beam(given), beam(wave)
    for x in (0.0, 0.21, 0.5):
        kept = legval(4 * x - 1, np.array(found.curvature["legendre"]).T)
        np.testing.assert_allclose(kept, wave(x), atol=2e-5)
    arms = held(found), held(want)
    p = [arm.frame(arm.zero)[0] for arm in arms]
    assert np.abs(p[0] - p[1]).max() < 1e-6
    for again in (pickle.loads(pickle.dumps(found)), fa.Arm.from_dict(arms[0].to_dict()).links[0].beam):
        assert again == found
        np.testing.assert_array_equal(again._core.stiffness, found._core.stiffness)


def test_three_numbers_and_nothing() -> None:
    assert beam([0, 1, 2]) == beam({"legendre": [[0.0], [1.0], [2.0]]})
    np.testing.assert_allclose(beam(lambda x: (0, 1, 2)).curvature, (0, 1, 2), rtol=1e-14)
    assert beam((0, 0, 0)) == beam(None) == beam(lambda x: np.zeros(3))
    assert beam((0, 0, 0)).curvature is None
    straight = [held(b) for b in (beam((0, 0, 0), order=2), beam(None, order=2))]
    np.testing.assert_array_equal(*(arm.mass_matrix(0.1 * np.ones(8)) for arm in straight))


def test_files_and_tables(tmp_path) -> None:
    for curvature in ((1.0, 0, 3.0), wave):
        scene = fa.Scene(held(beam(curvature)), t=np.linspace(0, 1, 3))
        scene.save(tmp_path / "scene.toml")
        assert fa.load(tmp_path / "scene.toml").arm == scene.arm
    assert "bent 1.5 rad, twisted 0.5 rad" in held(beam((1.0, 0, 3.0))).describe()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"curvature": (0, 1)}, "curvature"),
        ({"curvature": (0, 1, np.nan)}, ("curvature", "finite")),
        ({"curvature": (0, 0, 1.0), "order": 2}, ("order = 2", '"exact"')),
        ({"curvature": (0, 0, 600.0)}, ("curvature =", "600", "folds")),
        ({"curvature": (0, 400.0, 0)}, ("curvature", "folds", "beam")),
        ({"curvature": {"x": [0, 0.5]}}, "curvature ="),
        ({"curvature": {"x": [0, 0.4], "K": np.ones((2, 3))}}, ("0", "increase", "length")),
        ({"curvature": {"x": [0, 0.5], "K": np.ones((3, 3))}}, "(n, 3)"),
        ({"curvature": {"legendre": [[1.0], [2.0]]}}, "three lists"),
        ({"curvature": lambda x: (0, 0, x > 0.2)}, ("smooth", "split")),
        ({"curvature": lambda x: (0, 1)}, ("curvature at x = 0", "shape")),
    ],
)
def test_bad_curvatures(change: dict, message: str) -> None:
    with refuses(message):
        beam(**change)
