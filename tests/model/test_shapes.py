"""Shape functions other than the two bases: loaded modes, the user's own strains; tapered sections."""

import pickle
import subprocess
import sys

import flexarm as fa
import numpy as np
import pytest
from arms import STEEL, random_state
from messages import refuses
from numpy.polynomial.legendre import Legendre
from scipy.optimize import brentq

UNIT = fa.Material(1.0, 1.0, 0.3)
SQUARE = fa.sections.GeneralSection(1.0, 1.0, 1.0, 1.0)


def clamped(beam: fa.Beam, tip: fa.RigidBody | None = None) -> fa.Arm:
    return fa.Arm([fa.Link(fa.Fixed(), None, beam, tip)])


def spinning(modes: dict, order: int | str, **beam) -> fa.Arm:
    material, section = fa.Material(2000.0, 1e9, 0.3), fa.Rectangle(0.01, 0.02)
    options = {"section": section} | beam
    part = fa.Beam(0.6, material=material, modes=modes, order=order, **options)
    hub = fa.RigidBody(1.0, inertia=(0.1, 0.1, 0.1), end=(0.05, 0.0, 0.0))
    return fa.Arm([fa.Link(fa.Universal(), hub, part, fa.RigidBody(0.1, (0.02, 0.01, 0.0)))], (0.5, -9.81, 2.0))


# -- loaded modes ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mu", [0.0, 0.1, 1.0, 10.0, 1e4])
def test_loaded_modes_solve_the_loaded_beam(mu: float) -> None:
    """1 + cos b cosh b + mu b (cos b sinh b - sin b cosh b) = 0, frequency b^2."""

    def equation(b: float) -> float:
        return 1 / np.cosh(b) + np.cos(b) + mu * b * (np.cos(b) * np.tanh(b) - np.sin(b))

    grid = np.linspace(1e-3, 11.0, 4000)
    values = np.array([equation(b) for b in grid])
    at = np.flatnonzero(np.diff(np.sign(values)) != 0)[:3]
    b = np.array([brentq(equation, grid[k], grid[k + 1], xtol=1e-15) for k in at])
    body = fa.RigidBody(mu)
    beam = fa.Beam(1.0, SQUARE, UNIT, {"bending_y": 3}, "loaded", rotary_inertia=False, basis_tip=body)
    np.testing.assert_allclose(clamped(beam, body).modes().frequencies, b**2, rtol=1e-9)
    # each is a mode: diagonal in mass and stiffness, at most 1 along the beam
    K, M = beam._core.stiffness, clamped(beam, body).mass_matrix(np.zeros(3))
    for matrix in (K, M):
        d = np.sqrt(np.diag(matrix))
        np.testing.assert_allclose(matrix / np.outer(d, d), np.eye(3), atol=1e-9)
    arm = clamped(beam)
    for k in range(3):
        w = [arm.deflection(1e-6 * np.eye(3)[k], x=x)[1] * 1e6 for x in np.linspace(0, 1, 201)]
        assert np.abs(w).max() == pytest.approx(1.0, abs=1e-3) and w[-1] > 0


def test_unloaded_loaded_modes_are_clamped_free_modes() -> None:
    modes = {"bending_y": 4, "bending_z": 2}
    nothing = fa.RigidBody(0.0)
    one = spinning(modes, 2, rotary_inertia=True)
    two = spinning(modes, 2, basis="loaded", basis_tip=nothing, rotary_inertia=True)
    q, v, a = random_state(np.random.default_rng(0), one)
    expected = one.inverse_dynamics(q, v, a)
    np.testing.assert_allclose(two.inverse_dynamics(q, v, a), expected, atol=1e-8 * np.abs(expected).max())


def test_loaded_torsion_with_a_disc() -> None:
    """b tan b = J_beam / J_disc."""
    disc = 0.5
    section = fa.sections.GeneralSection(1.0, 0.5, 0.5, 1.0)
    tip = fa.RigidBody(0.0, inertia=(disc, 0.0, 0.0))
    beam = fa.Beam(1.0, section, fa.Material(1.0, 1.0, shear_modulus=1.0), {"torsion": 2}, "loaded", basis_tip=tip)
    b = [brentq(lambda b: b * np.tan(b) - 1.0 / disc, *bracket) for bracket in ((0.1, 1.57), (3.15, 4.71))]
    np.testing.assert_allclose(clamped(beam, tip).modes().frequencies, b, rtol=1e-10)


def test_a_heavy_tip_needs_fewer_loaded_modes() -> None:
    tip = fa.RigidBody(5.0, (0.1, 0, 0), (0.2, 0.2, 0.2))
    truth = clamped(fa.Beam(1.0, SQUARE, UNIT, {"bending_y": 14}, "legendre", rotary_inertia=False), tip)
    one, free = (
        clamped(fa.Beam(1.0, SQUARE, UNIT, {"bending_y": 2}, basis, rotary_inertia=False, **more), tip)
        for basis, more in (("loaded", {"basis_tip": tip}), ("clamped-free", {}))
    )
    expected = truth.modes().frequencies[:2]
    np.testing.assert_allclose(one.modes().frequencies, expected, rtol=1e-9)
    assert abs(free.modes().frequencies[1] / expected[1] - 1) > 0.05


def test_all_of_many_loaded_modes_are_modes() -> None:
    beam = fa.Beam(1.0, SQUARE, UNIT, {"bending_y": 30}, "loaded", order=1, rotary_inertia=False)
    expected = [((k + 0.5) * np.pi) ** 2 * np.sqrt(SQUARE.second_moment_z / SQUARE.area) for k in range(2, 30)]
    np.testing.assert_allclose(clamped(beam).modes().frequencies[2:], expected, rtol=1e-3)


# -- the user's own shapes -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", [0, 1, 2, 3, "exact"])
def test_own_shapes_that_are_a_basis_give_its_dynamics(order: int | str) -> None:
    """Legendre polynomials and the sines of torsion as callables, against the built-in bases."""
    L = 0.6
    polynomials = [Legendre.basis(k, (0, L)) for k in range(3)]
    sines = [lambda x, k=k: k * np.cos(k * x) for k in (np.pi / (2 * L), -3 * np.pi / (2 * L))]
    for basis, strain, shapes in (("legendre", "bending_y", polynomials), ("clamped-free", "torsion", sines)):
        rest = {"bending_z": 1} if strain == "bending_y" else {"bending_y": 1}
        one = spinning({strain: len(shapes)} | rest, order, basis=basis)
        two = spinning({strain: shapes} | rest, order, basis=basis)
        q, v, a = random_state(np.random.default_rng(1), one)
        expected = one.inverse_dynamics(q, v, a)
        np.testing.assert_allclose(two.inverse_dynamics(q, v, a), expected, atol=1e-9 * np.abs(expected).max())
        assert two.coordinates == one.coordinates


def test_measured_samples() -> None:
    """Curvatures of the clamped-free modes sampled at 81 places stand in for the modes to the spline's accuracy."""
    L, x = 0.6, np.linspace(0, 0.6, 81)
    modes = spinning({"bending_y": 2}, 2, basis="clamped-free")
    samples = [[modes.strain([0, 0, *e], x=at)[2] for at in x] for e in np.eye(2)]
    uneven = np.sort(np.concatenate([[0.0, L], L * np.random.default_rng(0).random(119)]))
    table = [{"x": uneven, "strain": [modes.strain([0, 0, *e], x=at)[2] for at in uneven]} for e in np.eye(2)]
    q, v, a = random_state(np.random.default_rng(1), modes)
    expected = modes.inverse_dynamics(q, v, a)
    for shapes in (samples, table):
        found = spinning({"bending_y": shapes}, 2).inverse_dynamics(q, v, a)
        np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())


@pytest.mark.parametrize("order", [0, 1, 2, 3, "exact"])
def test_gauss_points_of_own_shapes_suffice(order: int | str) -> None:
    L = 0.6
    shapes = [lambda x: np.exp(-(((x - 0.3 * L) / (0.2 * L)) ** 2)), lambda x: np.sin(9 * x / L), lambda x: 1.0]
    modes = {"bending_y": shapes, "torsion": shapes[1:], "bending_z": shapes[:1]}
    few, many = spinning(modes, order), spinning(modes, order, gauss_points=150)
    assert few.links[0].beam._core.gauss_points < 100
    q, v, a = random_state(np.random.default_rng(2), few)
    expected = many.inverse_dynamics(q, v, a)
    np.testing.assert_allclose(few.inverse_dynamics(q, v, a), expected, atol=1e-10 * np.abs(expected).max())


def test_own_shapes_survive_pickling_and_scene_files() -> None:
    arm = spinning({"bending_y": [lambda x: 1 - x / 0.6, [1.0, 0.5, 0.2, 0.0]], "torsion": 1}, 2)
    q, v, a = random_state(np.random.default_rng(3), arm)
    for twin in (fa.Arm.from_dict(arm.to_dict()), pickle.loads(pickle.dumps(arm))):
        assert twin == arm
        np.testing.assert_array_equal(twin.inverse_dynamics(q, v, a), arm.inverse_dynamics(q, v, a))
    assert "bending_y 2, torsion 1" in str(arm)


# -- tapers ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("section", "expected"),
    [
        (lambda s: fa.Rectangle(s, 1.0), (5.31510, 15.2072, 30.0198)),  # wedge, constant width
        (lambda s: fa.Circle(s), (8.71926, 21.1457, 38.4538)),  # cone
    ],
)
def test_kirchhoffs_wedge_and_cone(section, expected: tuple[float, ...]) -> None:
    """Clamped at the base, pointed at the end: omega L^2 sqrt(rho A0 / E I0) (Kirchhoff 1879; Conway & Dubil 1965)."""
    taper = fa.sections.Taper((0.0, 1.0), (section(1.0), section(1e-7)))
    beam = fa.Beam(1.0, taper, UNIT, {"bending_y": 14}, "legendre", rotary_inertia=False)
    root = section(1.0)
    found = clamped(beam).modes().frequencies[:3] / np.sqrt(root.second_moment_z / root.area)
    np.testing.assert_allclose(found, expected, rtol=2e-5)
    loaded = fa.Beam(1.0, taper, UNIT, {"bending_y": 2}, "loaded", rotary_inertia=False)
    np.testing.assert_allclose(
        clamped(loaded).modes().frequencies / np.sqrt(root.second_moment_z / root.area), expected[:2], rtol=1e-4
    )


def test_rigid_taper_with_the_basis_of_loaded_modes() -> None:
    """A beam without shapes is a rigid body: a truncated cone's mass and centre of mass, with each basis."""
    taper = fa.sections.Taper((0.0, 0.6), (fa.Circle(0.02), fa.Circle(0.01)))
    a, b = 0.02, 0.01
    mass = 2000.0 * np.pi * 0.6 / 3 * (a * a + a * b + b * b)
    com = 0.6 / 4 * (a * a + 2 * a * b + 3 * b * b) / (a * a + a * b + b * b)
    for basis in ("clamped-free", "legendre", "loaded"):
        beam = fa.Beam(0.6, taper, fa.Material(2000.0, 1e9), {}, basis)
        arm = fa.Arm([fa.Link(fa.Revolute("y"), beam=beam)])
        assert arm.links[0].mass == pytest.approx(mass, rel=1e-12)
        np.testing.assert_allclose(arm.center_of_mass([0.0]), [com, 0, 0], atol=1e-12)


def test_masses_and_sag_of_a_taper() -> None:
    """A tapered strip under a tip force: w = F int (L - x)^2 / E I(x) dx; its mass is the truncated wedge's."""
    taper = fa.sections.Taper((0.0, 0.6), (fa.Rectangle(0.01, 0.02), fa.Rectangle(0.004, 0.02)))
    beam = fa.Beam(0.6, taper, fa.Material(2000.0, 1e9), {"bending_y": 12}, "legendre")
    assert beam.mass == pytest.approx(2000 * 0.6 * 0.02 * 0.007, rel=1e-12)
    arm, F = clamped(beam), 1e-3
    x, w = np.polynomial.legendre.leggauss(60)
    x, w = 0.3 * (1 + x), 0.3 * w
    EI = 1e9 * 0.02 * (0.01 - 0.01 * x) ** 3 / 12
    sag = F * (w * (0.6 - x) ** 2 / EI).sum()
    found = arm.deflection(arm.equilibrium(loads=[fa.Load(force=(0, F, 0))]))[1]
    assert found == pytest.approx(sag, rel=1e-6)


@pytest.mark.parametrize("order", [0, 1, 2, 3, "exact"])
@pytest.mark.parametrize("places", [2, 6])
def test_gauss_points_of_a_taper_suffice(order: int | str, places: int) -> None:
    """The slices sit at the Gauss points of the mass along the beam, so that kinks in the taper cost no more of them;
    rotary inertia, which is not in proportion to the mass, is right to 1e-7 of the forces where the taper kinks."""
    rng = np.random.default_rng(places)
    x = np.linspace(0, 0.6, places)
    taper = fa.sections.Taper(x, [fa.Rectangle(*rng.uniform(0.01, 0.03, 2)) for _ in x])
    modes = {"bending_y": 3, "bending_z": 1, "torsion": 1}
    for rotary, tolerance in ((False, 1e-10), (True, 1e-9 if places == 2 else 1e-6)):
        few, many = (
            spinning(modes, order, section=taper, rotary_inertia=rotary, gauss_points=n, basis="legendre")
            for n in (None, 120)
        )
        q, v, a = random_state(np.random.default_rng(2), few)
        expected = many.inverse_dynamics(q, v, a)
        np.testing.assert_allclose(few.inverse_dynamics(q, v, a), expected, atol=tolerance * np.abs(expected).max())
        forward = [few.forward_dynamics(q, v, expected, method=method) for method in ("ab", "ci")]
        np.testing.assert_allclose(*forward, rtol=1e-7)


@pytest.mark.parametrize("order", [0, 1, 2, 3, "exact"])
def test_gauss_points_of_a_tapers_loaded_modes_suffice(order: int | str) -> None:
    """They bend where the taper is slender, so that a wave number of the whole length does not tell how many."""
    sides = (0.004, 0.004), (0.025, 0.018), (0.027, 0.005)
    taper = fa.sections.Taper((0.0, 0.3, 0.6), [fa.Rectangle(*s) for s in sides])
    modes, tip = {"bending_y": 2, "bending_z": 1, "torsion": 1}, fa.RigidBody(0.1, inertia=(1e-4, 1e-4, 1e-4))
    few, many = (
        spinning(modes, order, section=taper, rotary_inertia=False, gauss_points=n, basis="loaded", basis_tip=tip)
        for n in (None, 120)
    )
    q = random_state(np.random.default_rng(2), few)[0]
    A, B = few.mass_matrix(q), many.mass_matrix(q)
    d = np.sqrt(np.diag(B))
    assert np.abs((A - B) / np.outer(d, d)).max() < 1e-10


def test_a_taper_between_equal_sections_is_uniform() -> None:
    strip = fa.Rectangle(0.01, 0.02)
    for sections in (
        (strip, strip, strip),
        (strip, fa.sections.GeneralSection(*(getattr(strip._core, n) for n in NAMES))),
    ):
        taper = fa.sections.Taper(np.linspace(0, 0.6, len(sections)), sections)
        one, two = (spinning({"bending_y": 3, "torsion": 1, "shear_y": 1}, 2, section=s) for s in (strip, taper))
        q, v, a = random_state(np.random.default_rng(4), one)
        expected = one.inverse_dynamics(q, v, a)
        np.testing.assert_allclose(two.inverse_dynamics(q, v, a), expected, atol=1e-10 * np.abs(expected).max())
        assert fa.Arm.from_dict(two.to_dict()) == two == pickle.loads(pickle.dumps(two))
        assert "taper of" in str(two)


NAMES = ("area", "second_moment_y", "second_moment_z", "torsion_constant", "shear_correction")


def test_a_taper_in_a_scene_file(tmp_path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text("""
[[link]]
joint = { type = "fixed" }
[link.beam]
length = 0.5
material = { density = 7850, youngs_modulus = 209e9 }
modes = { bending_y = [ { legendre = [1.0, -0.8] }, { x = [0, 0.2, 0.5], strain = [0, 1, 0] } ] }
[link.beam.section]
type = "taper"
x = [0.0, 0.5]
sections = [ { type = "rectangle", y = 0.002, z = 0.02 }, { type = "rectangle", y = 0.001, z = 0.01 } ]
[[link]]
joint = { type = "fixed" }
[link.beam]
length = 0.5
section = { type = "circle", radius = 0.01 }
material = { density = 7850, youngs_modulus = 209e9 }
modes = { bending_y = 1 }
basis = "loaded"
basis_tip = { mass = 2.0, inertia = [0, 0, 0.1] }
""")
    arm = fa.load(path).arm
    assert arm.nv == 3 and arm.links[0].beam.section.sections[1].y == 0.001
    assert arm.links[1].beam.basis_tip.mass == 2.0
    path.write_text(path.read_text().replace("y = 0.001, z", "y = -0.001, z"))
    with refuses("link[0].beam.section.sections[1].y = -0.001"):
        fa.load(path)


def beam(**change) -> fa.Beam:
    return fa.Beam(**({"length": 1.0, "section": SQUARE, "material": UNIT, "modes": {"bending_y": 1}} | change))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"modes": {"bending_y": [lambda x: 1.0, lambda x: 2.0]}},
            ("modes.bending_y[1] =", "combination"),
        ),
        ({"modes": {"bending_y": [lambda x: x, lambda x: 1.0, lambda x: 3 - x]}}, "modes.bending_y[2] ="),
        ({"modes": {"bending_y": [lambda x: 0.0]}}, ("modes.bending_y[0]", "strain")),
        ({"modes": {"torsion": [[0.0, 0.0]]}}, "modes.torsion[0] = 0"),
        ({"modes": {"bending_y": [lambda x: abs(x - 0.5)]}}, ("modes.bending_y[0]", "smooth enough")),
        ({"modes": {"bending_y": lambda x: 1.0}}, ("modes.bending_y =", "whole number", "list", "strain")),
        ({"modes": {"bending_y": [lambda x: np.nan]}}, ("modes.bending_y[0]", "finite")),
        ({"modes": {"bending_y": [lambda x: "no"]}}, ("modes.bending_y[0]", "numbers")),
        ({"modes": {"bending_y": [[1.0]]}}, ("modes.bending_y[0]", "two")),
        ({"modes": {"bending_y": [{"x": [0, 0.9], "strain": [1, 2]}]}}, ("1.0 m", "increase", "length")),
        ({"modes": {"bending_y": [{"x": [0, 1]}]}}, ("x and strain", "legendre")),
        ({"modes": {"bending_y": [{"legendra": [1]}]}}, ("key 'legendra'", "'legendre'")),
        ({"modes": {"bending_y": [np.random.default_rng(0).normal(size=400)]}}, "rough"),
        ({"basis": "loadet"}, ("basis = 'loadet'", "'loaded'")),
        ({"basis_tip": fa.RigidBody(1.0)}, ("basis_tip", "basis = 'loaded'")),
        ({"basis": "loaded", "basis_tip": 1.0}, ("basis_tip = 1.0", "RigidBody")),
        (
            {"section": fa.sections.Taper((0, 2.0), (SQUARE, SQUARE))},
            "section.x = (0.0, 2.0)",
        ),
    ],
)
def test_bad_shapes(change: dict, message: str) -> None:
    with refuses(message):
        beam(**change)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (((0.0,), (SQUARE,)), "x = (0.0,)"),
        (((0.1, 1.0), (SQUARE, SQUARE)), "increasing from 0"),
        (((0.0, 1.0), (SQUARE,)), ("section", "2 places")),
        (((0.0, 1.0), (SQUARE, 1.0)), ("sections[1] = 1.0", "Rectangle")),
    ],
)
def test_bad_tapers(arguments: tuple, message: str) -> None:
    with refuses(message):
        fa.sections.Taper(*arguments)


ALL = {"bending_y": 2, "bending_z": 2, "torsion": 2, "shear_y": 1, "shear_z": 1, "extension": 2}


@pytest.mark.parametrize("length", [0.3, 1.7])
@pytest.mark.parametrize("basis", ["clamped-free", "legendre", "loaded"])
def test_second_order_is_the_start_of_the_exact_rotation_at_any_length(basis, length):
    # what is tabulated at length 1 and scaled, against the integration of R' = R K~
    rng, errors = np.random.default_rng(3), []
    beams = [fa.Beam(length, fa.Rectangle(0.02, 0.03), STEEL, ALL, basis=basis, order=k) for k in (2, "exact")]
    arms = [fa.Arm([fa.Link(fa.Revolute("z"), beam=beam)]) for beam in beams]
    q = np.append(0.0, rng.normal(size=10))
    strains = arms[0].strain(q, 0, 0.4 * length)
    q /= np.abs(strains * [length, length, length, 1, 1, 1]).max()
    for size in (0.02, 0.01):
        (p, R), (p_exact, R_exact) = (arm.frame(size * q, 0, 0.8 * length) for arm in arms)
        errors.append([np.abs(p - p_exact).max() / length, np.abs(R - R_exact).max()])
    assert (np.array(errors[0]) < 1e-5).all()
    assert (np.array(errors[1]) < 0.16 * np.array(errors[0]) + 1e-13).all()  # third order: an eighth


def test_a_beam_is_the_same_whatever_was_built_before():
    program = """
import sys, flexarm as fa
steel = fa.Material(7850.0, 209e9, 0.3)
modes = {"bending_y": 2, "bending_z": 2, "torsion": 1}
out = {}
for length in map(float, sys.argv[1:]):
    for basis in ("clamped-free", "legendre", "loaded"):
        beam = fa.Beam(length, fa.Rectangle(0.002, length / 25), steel, modes, basis=basis, damping_ratio=0.01)
        arm = fa.Arm([fa.Link(fa.Revolute("z"), beam=beam)])
        run = fa.rollout(arm, [0.0, *[1e-3] * 5], step=1e-3, nstep=3)
        out[length, basis] = (beam._core.stiffness.tobytes() + run.q.tobytes()).hex()
print(*(out[0.5, basis] for basis in ("clamped-free", "legendre", "loaded")))
"""
    found = [
        subprocess.run([sys.executable, "-c", program, *args], capture_output=True, text=True, check=True).stdout
        for args in (["0.5"], ["0.7", "0.5"])
    ]
    assert found[0] == found[1]
