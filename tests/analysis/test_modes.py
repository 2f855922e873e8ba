"""Frequencies against published tables (sources in each test)."""

import flexarm as fa
import numpy as np
import pytest
from arms import STEEL, paper_link
from messages import refuses

# Rotating Euler-Bernoulli cantilever: lambda = omega L^2 sqrt(rho A/EI) against gamma = Omega L^2 sqrt(rho A/EI), hub
# radius alpha L. Flapwise, alpha = 0: Wright et al., J. Applied Mechanics 49 (1982); the rest computed independently.
ROTATING = {
    ("flap", 0.0): {
        0: (3.516015, 22.034492, 61.697214),
        1: (3.681647, 22.181011, 61.841763),
        2: (4.137320, 22.614922, 62.273184),
        4: (5.585001, 24.273349, 63.966760),
        6: (7.360373, 26.809082, 66.683914),
        8: (9.256838, 29.995382, 70.292962),
        10: (11.202328, 33.640366, 74.649295),
        12: (13.170151, 37.603112, 79.614479),
    },
    ("flap", 0.15): {
        1: (3.713473, 22.210226, 61.872006),
        2: (4.249207, 22.729267, 62.393102),
        4: (5.908266, 24.695900, 64.430530),
        6: (7.902350, 27.660171, 67.674415),
        8: (10.013763, 31.331276, 71.941775),
        10: (12.171921, 35.479616, 77.040151),
        12: (14.351511, 39.946856, 82.793861),
    },
    ("chord", 0.0): {
        1: (3.543236, 22.158458, 61.833677),
        2: (3.621797, 22.526311, 62.241059),
        4: (3.897722, 23.941501, 63.841573),
        6: (4.263225, 26.129043, 66.413436),
        8: (4.657150, 28.908873, 69.836241),
        10: (5.048975, 32.119686, 73.976464),
        12: (5.427049, 35.636976, 78.704925),
    },
    ("chord", 0.15): {
        1: (3.576294, 22.187702, 61.863924),
        2: (3.749101, 22.641104, 62.361039),
        4: (4.348288, 24.369807, 64.306246),
        6: (5.142677, 27.001575, 67.407911),
        8: (6.022911, 30.292720, 71.495588),
        10: (6.939427, 34.041198, 76.388381),
        12: (7.871841, 38.101855, 81.919616),
    },
}


def unit_beam(modes: dict[str, int], hub: float = 0.0, tip: fa.RigidBody | None = None, **beam) -> fa.Arm:
    """L = EI = rho A = 1."""
    section = fa.sections.GeneralSection(1.0, 1.0, 1.0, 1.0)
    options = {"basis": "legendre", "rotary_inertia": False} | beam
    return fa.Arm(
        [
            fa.Link(
                fa.Revolute("z"),
                fa.RigidBody(end=(hub, 0, 0)),
                fa.Beam(1.0, section, fa.Material(1.0, 1.0, 0.3), modes, **options),
                tip,
            )
        ]
    )


@pytest.mark.parametrize("case", ROTATING)
def test_rotating_cantilever_to_six_digits(case: tuple[str, float]) -> None:
    direction, alpha = case
    arm = unit_beam({"bending_z" if direction == "flap" else "bending_y": 12}, alpha)
    for gamma, expected in ROTATING[case].items():
        found = arm.modes(speed={0: gamma}, lock=[0])
        np.testing.assert_allclose(found.frequencies[:3], expected, atol=1.5e-6)
        np.testing.assert_array_equal(found.damping[:3], 0.0)


def test_timoshenko_flap_of_this_kinematics() -> None:
    """r_g/L = 1/30, E/kG = 3.059, computed independently: 4.096941 at gamma 2, and at rest the textbook's values."""
    r2, k = 1 / 900, 2.6 / 3.059  # with E = 1/I and G = E/2.6: E/kG = 2.6/k
    section = fa.sections.GeneralSection(1.0, r2, r2, 1.0, shear_correction=k)
    beam = fa.Beam(1.0, section, fa.Material(1.0, 1 / r2, 0.3), {"bending_z": 12, "shear_z": 12}, "legendre", 2)
    arm = fa.Arm([fa.Link(fa.Revolute("z"), beam=beam)])
    np.testing.assert_allclose(arm.modes(lock=[0]).frequencies[:3], (3.479841, 20.589156, 53.339811), atol=2e-6)
    assert arm.modes(speed={0: 2.0}, lock=[0]).frequencies[0] == pytest.approx(4.096941, abs=2e-6)


def test_the_papers_link() -> None:
    """Sec. 5.1: 20.95 131.28 367.6 rad/s at rest; order 2 +4.7 +1.9 +0.8 % at 10 rad/s; order 1 softens."""
    options = {"rotary_inertia": False}
    converged = paper_link(2, 12, "legendre", **options)
    table = {
        0: (20.948766, 131.283672, 367.598084),
        5: (21.202578, 131.927197, 368.297906),
        10: (21.939613, 133.839190, 370.388432),
    }
    for speed, expected in table.items():
        np.testing.assert_allclose(converged.modes(speed={0: speed}, lock=[0]).frequencies[:3], expected, atol=2e-6)
    three = paper_link(2, **options).modes(speed={0: 10.0}, lock=[0]).frequencies
    np.testing.assert_allclose(three, (21.939904, 133.840341, 370.389888), atol=2e-6)
    rest = paper_link(2, **options).modes(lock=[0]).frequencies
    np.testing.assert_array_equal(np.round(100 * (three / rest - 1), 1), (4.7, 1.9, 0.8))
    for speed, first in ((0, 20.948766), (5, 20.343323), (10, 18.407900)):
        found = paper_link(1, **options).modes(speed={0: speed}, lock=[0]).frequencies[0]
        assert found == pytest.approx(first, abs=2e-6)
    still, fast = (paper_link(0).modes(speed={0: w}, lock=[0]).frequencies for w in (0.0, 10.0))
    np.testing.assert_allclose(still, fast, rtol=1e-12)


def test_order_one_loses_its_first_mode() -> None:
    arm = paper_link(1, rotary_inertia=False)
    just_below = arm.modes(speed={0: 20.9487}, lock=[0])
    assert just_below.stable and 0 < just_below.frequencies[0] < 0.1
    above = arm.modes(speed={0: 21.0}, lock=[0])
    assert not above.stable
    assert above.frequencies[0] == 0.0 and above.damping[0] == -1.0 and above.eigenvalues[0].real > 1.0
    assert (above.frequencies[1:] > 100).all()
    assert paper_link(2).modes(speed={0: 21.0}, lock=[0]).stable


@pytest.mark.parametrize(("mu", "expected"), [(0.1, 2.967838), (1.0, 1.557298), (10.0, 0.541375)])
def test_tip_mass(mu: float, expected: float) -> None:
    arm = unit_beam({"bending_y": 10}, tip=fa.RigidBody(mu))
    assert arm.modes(lock=[0]).frequencies[0] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("eta", "expected"),
    [(0.0, (15.418206, 49.964862)), (0.1, (6.963924, 22.980239)), (1.0, (4.040113, 22.125680))],
)
def test_pinned_beam_with_hub_inertia(eta: float, expected: tuple[float, float]) -> None:
    beam = unit_beam({"bending_y": 12}).links[0].beam
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(inertia=(0, 0, eta)), beam)])
    found = arm.modes()
    assert found.frequencies[0] == 0.0  # turning as a rigid body
    np.testing.assert_allclose(found.frequencies[1:3], expected, atol=1e-6)


def test_torsion_and_shear_alone() -> None:
    """Clamped-free rod in torsion: omega_i = (i - 1/2) pi sqrt(G J / rho Ip) / L; shear the same with k G A, rho A."""
    section, steel, L = fa.Rectangle(0.004, 0.01), fa.Material(7850, 209e9, 0.3), 0.5
    G = 209e9 / 2.6
    polar = section.second_moment_y + section.second_moment_z
    i = np.arange(1, 4) - 0.5
    for strain, speed in (
        ("torsion", np.sqrt(G * section.torsion_constant / (7850 * polar))),
        ("shear_y", np.sqrt(5 / 6 * G / 7850)),
        ("shear_z", np.sqrt(5 / 6 * G / 7850)),
    ):
        for basis, n in (("clamped-free", 3), ("legendre", 12)):
            arm = fa.Arm([fa.Link(fa.Fixed(), beam=fa.Beam(L, section, steel, {strain: n}, basis))])
            np.testing.assert_allclose(arm.modes().frequencies[:3], i * np.pi * speed / L, rtol=1e-9)


def test_section_constants() -> None:
    """Torsion constant of a square, 0.1405770 a^4 (Timoshenko & Goodier), and of a thin strip, b h^3 / 3."""
    assert fa.Rectangle(1.0, 1.0).torsion_constant == pytest.approx(0.14057701, rel=1e-7)
    assert fa.Rectangle(1e-4, 1.0).torsion_constant == pytest.approx(1e-12 / 3 * (1 - 0.630249e-4), rel=1e-9)
    tube = fa.Circle(0.02, 0.01)
    assert tube.torsion_constant == pytest.approx(np.pi / 2 * (0.02**4 - 0.01**4))
    assert fa.Rectangle(0.001, 0.02).second_moment_z == pytest.approx(0.02 * 0.001**3 / 12)


def test_modal_damping() -> None:
    """The ratio asked for is the ratio found, for every mode of the clamped beam; whirling is gyroscopic and stable."""
    found = paper_link(2, damping_ratio=0.03).modes(lock=[0])
    np.testing.assert_allclose(found.damping, 0.03, rtol=1e-9)
    np.testing.assert_allclose(found.frequencies, paper_link(2).modes(lock=[0]).frequencies, rtol=1e-9)


def test_kelvin_voigt_damping() -> None:
    """Stress in proportion to the strain rate: a ratio of tau omega / 2, growing with the frequency; they add."""
    tau = 1e-4
    found = paper_link(2, kelvin_voigt=tau).modes(lock=[0])
    np.testing.assert_allclose(found.damping, tau * found.frequencies / 2, rtol=1e-9)
    both = paper_link(2, kelvin_voigt=tau, damping_ratio=0.01).modes(lock=[0])
    np.testing.assert_allclose(both.damping, found.damping + 0.01, rtol=1e-9)


@pytest.mark.parametrize("order", [2, "exact"])
def test_a_split_beam_is_the_whole_beam(order: int | str) -> None:
    """Beams joined by fixed joints make a longer one: frequencies at rest and at speed, and a spin-up, converge."""
    whole = paper_link(order, 10, "legendre", rotary_inertia=False)
    beam = whole.links[0].beam
    drive = {0: fa.Motion.spin_up(7.6, 0.5)}
    t = np.linspace(0, 0.5, 101)
    tip = fa.simulate(whole, t, drive=drive, max_order=2).frame()[0]
    for parts, n, limit in ((2, 7, 1e-6), (4, 5, 1e-6)):
        length, modes = beam.length / parts, {"bending_y": n}
        piece = fa.Beam(length, beam.section, beam.material, modes, "legendre", order, rotary_inertia=False)
        links = [fa.Link(fa.Revolute("z"), whole.links[0].hub, piece)]
        split = fa.Arm(links + [fa.Link(fa.Fixed(), beam=piece)] * (parts - 1))
        for speed in (0.0, 10.0):
            a, b = (arm.modes(speed={0: speed}, lock=[0]).frequencies[:3] for arm in (whole, split))
            np.testing.assert_allclose(a, b, rtol=limit)
        if parts > 2:
            continue  # the spin-up of four says no more, and takes its time
        # order 2 truncates the rotation of each piece anew, so the finer model is nearer the exact one
        found = fa.simulate(split, t, drive=drive, max_order=2).frame()[0]
        assert np.abs(found - tip).max() < (1e-4 if order == "exact" else 2e-3)


def test_gyroscopic_modes_of_a_whirling_shaft() -> None:
    """A round shaft along the spin axis, seen from axes that spin with it: s = i (omega0 -+ Omega), twice each."""
    section, modes = fa.sections.GeneralSection(1, 1, 1, 1), {"bending_y": 10, "bending_z": 10}
    shaft = fa.Beam(1.0, section, fa.Material(1, 1, 0.3), modes, "legendre", rotary_inertia=False)
    arm = fa.Arm([fa.Link(fa.Revolute("x"), fa.RigidBody(1, inertia=(1, 1, 1)), shaft)])
    found = arm.modes(speed={0: 1.5}, lock=[0])
    rest = np.array([3.516015, 22.034492])
    np.testing.assert_allclose(found.frequencies[:4], np.sort([rest - 1.5, rest + 1.5], axis=None), atol=1e-5)
    assert np.abs(found.damping[:4]).max() < 1e-8


def test_damped_modes() -> None:
    """A rigid-body mode of a damped arm is zero, not growing; an overdamped mode shows both its roots."""
    hub = fa.RigidBody(inertia=(0, 0, 1e-3), end=(0.075, 0, 0))
    arm = fa.Arm([fa.Link(fa.Revolute("z"), hub, paper_link(2, damping_ratio=0.01).links[0].beam)])
    found = arm.modes()
    assert found.stable and found.frequencies[0] == 0.0 and found.damping[0] == 0.0
    rest = paper_link(2).modes(lock=[0]).frequencies
    roots = paper_link(2, kelvin_voigt=4.0 / rest[0]).modes(lock=[0]).eigenvalues.real
    ratios = 2.0 * rest / rest[0]
    known = [w * (z + s * np.sqrt(z * z - 1)) for w, z in zip(rest, ratios, strict=True) for s in (1, -1)]
    np.testing.assert_allclose(np.sort(-roots), np.sort(known), rtol=1e-6)


def test_participation_names_the_coordinate_that_moves() -> None:
    found = paper_link().modes(lock=[0])
    np.testing.assert_allclose(found.participation.sum(axis=0), 1.0)
    np.testing.assert_array_equal(found.participation.argmax(axis=0), [1, 2, 3])
    with refuses("lock = 0"):
        paper_link().modes(lock=0)  # type: ignore[arg-type]


def test_a_dead_load_buckles_a_clamped_beam() -> None:
    """A clamped beam under a dead end load buckles at pi^2 EI / 4 L^2 (Euler)."""
    beam = fa.Beam(0.5, fa.Rectangle(0.002, 0.02), fa.Material(7850, 209e9), {"bending_y": 8}, "legendre")
    arm = fa.Arm([fa.Link(fa.Fixed(), None, beam)])
    critical = np.pi**2 * 209e9 * beam.section.second_moment_z / (4 * 0.5**2)
    just_under, just_over = (
        arm.modes(loads=[fa.Load(force=(-share * critical, 0, 0))]).eigenvalues for share in (0.9999, 1.0001)
    )
    assert just_under.real.max() < 1e-6 < just_over.real.max()


@pytest.mark.parametrize("seed", range(20))
def test_rigid_motions_that_rounding_hides(seed: int) -> None:
    """A stiffness with two zero eigenvalues that rounding makes +-1e-16: Cholesky alone can take it for definite."""
    from flexarm.analysis.modes import _conservative

    rng = np.random.default_rng(seed)
    V = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    square = np.array([0.0, 0.0, 4.0, 5.0, 900.0, 1300.0])
    s, _ = _conservative(np.eye(6), V @ np.diag(square) @ V.T)
    np.testing.assert_allclose(np.sort(np.abs(s) ** 2), square, atol=1e-8)
    assert (s.real == 0).all()


def test_nearly_dependent_shapes_keep_their_modes() -> None:
    """1 and 1 + 1e-5 x: the mass matrix is as ill-conditioned as the stiffness, and no shift can help. Its condition
    number, 2e13, leaves three digits."""
    beam = fa.Beam(
        1.0, fa.Rectangle(0.01, 0.02), fa.Material(2000, 1e9), {"bending_y": [lambda x: 1.0, lambda x: 1 + 1e-5 * x]}
    )
    clean = fa.Beam(1.0, fa.Rectangle(0.01, 0.02), fa.Material(2000, 1e9), {"bending_y": 2}, "legendre")
    one, two = (fa.Arm([fa.Link(fa.Fixed(), None, b)]).modes().frequencies for b in (beam, clean))
    np.testing.assert_allclose(one, two, rtol=1e-3)


@pytest.mark.parametrize("damping", [0.0, 0.3, 1e-7])
@pytest.mark.parametrize("joint", ["revolute", "prismatic", "free", "spherical"])
def test_an_arm_without_stiffness(joint: str, damping: float) -> None:
    """A rigid link that nothing holds: its modes are rigid-body motions, at zero; a damped one comes to rest with
    s = -damping / inertia."""
    body = fa.RigidBody(2.0, inertia=(0.5, 0.5, 0.5))
    made = {"revolute": fa.Revolute("z", damping=damping), "prismatic": fa.Prismatic("x", damping=damping),
            "free": fa.Free(damping=damping), "spherical": fa.Spherical(damping=damping)}[joint]  # fmt: skip
    arm = fa.Arm([fa.Link(made, body)])
    modes = arm.modes()
    assert np.isfinite(modes.shapes).all() and np.isfinite(modes.damping).all()
    if damping == 0.0:
        assert len(modes.frequencies) == arm.nv
        np.testing.assert_array_equal(modes.frequencies, 0.0)
        assert modes.stable
        return
    rates = {"revolute": {damping / 0.5}, "prismatic": {damping / 2.0}, "spherical": {damping / 0.5},
             "free": {damping / 0.5, damping / 2.0}}[joint]  # fmt: skip
    decaying = -modes.eigenvalues.real[modes.eigenvalues.real < 0]
    assert len(decaying) == arm.nv
    for rate in rates:
        assert np.isclose(decaying, rate, rtol=1e-6).any()


def test_a_cart_with_a_pendulum() -> None:
    """The cart is free to roll; the pendulum under it swings at sqrt(g (M + m) / (M l)) [textbook]."""
    G, M, m, length = 9.81, 2.0, 0.5, 0.7
    cart = fa.Link(fa.Prismatic("x"), fa.RigidBody(M))
    bob = fa.Link(fa.Revolute("z"), fa.RigidBody(m, com=(0, -length, 0)))
    w = fa.Arm([cart, bob], gravity=(0, -G, 0)).modes().frequencies
    np.testing.assert_allclose(w, [0.0, np.sqrt(G * (M + m) / (M * length))], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("damping", [0.0, 10.0])
def test_motions_that_double_precision_cannot_tell_apart(damping: float) -> None:
    """A mass on a slide, 1e9 m from a joint that swings it along the slide: both move it alike. This is said."""
    far, near = fa.RigidBody(0.0, inertia=(1, 1, 1), end=(0, 0, 1e9)), fa.RigidBody(0.0, inertia=(1, 1, 1))
    joints = fa.Revolute("y"), fa.Revolute("y", damping=damping), fa.Prismatic("z")
    arm = fa.Arm([fa.Link(j, b) for j, b in zip(joints, (far, near, fa.RigidBody(1.0)), strict=True)])
    with refuses("modes", "singular"):
        arm.modes([0.0, np.pi / 2, 0.0])


def test_damped_motions_that_nothing_holds() -> None:
    """Each has a zero of its own, a pair of shapes for it, and what damps it: -d/I."""
    body = fa.RigidBody(1.0, inertia=(0.01, 0.01, 0.01))
    modes = fa.Arm([fa.Link(fa.Spherical(damping=0.2), body)]).modes()
    np.testing.assert_allclose(modes.eigenvalues, [0, 0, 0, -20, -20, -20], atol=1e-9)
    assert np.linalg.matrix_rank(modes.shapes[:, :3]) == 3
    axes = fa.Arm([fa.Link(fa.Prismatic("x", damping=0.5), body), fa.Link(fa.Prismatic("y"), body)]).modes()
    np.testing.assert_allclose(axes.eigenvalues, [0, 0, -0.25], atol=1e-9)
    assert np.linalg.matrix_rank(axes.shapes[:, :2]) == 2


@pytest.mark.parametrize("damping", [1e6, 1e10])
def test_a_joint_that_is_held_by_damping(damping: float) -> None:
    """It creeps at k / c and stops at c over its inertia, 1e20 times faster; between them are the beam's modes, as of a
    joint that is locked."""
    tip = fa.RigidBody(0.1, (0.0, 0.02, 0.0), (1e-4, 2e-4, 2e-4))
    beam = fa.Beam(1.0, fa.Rectangle(0.01, 0.02), STEEL, {"bending_y": 3, "shear_y": 1, "torsion": 1})
    springs = {"stiffness": 1.0, "damping": damping}
    for joint, n in ((fa.Revolute("z", **springs), 1), (fa.Free(**springs), 6)):
        arm = fa.Arm([fa.Link(joint, fa.RigidBody(0.5, (0.02, 0.01, 0), (0.01, 0.02, 0.02)), beam, tip)])
        found, locked = arm.modes(), arm.modes(lock=[0])
        slow, bends = found.eigenvalues[:n], found.eigenvalues.imag > 0
        np.testing.assert_allclose(slow, -1.0 / damping, rtol=1e-6)
        np.testing.assert_allclose(found.frequencies[bends], locked.frequencies, rtol=1e-3)
        assert (found.eigenvalues.real < 1e-6 * np.abs(found.eigenvalues)).all()
        assert len(found.eigenvalues) == 2 * n + 5
        fast = np.sort(-found.eigenvalues.real)[-n:]
        M = arm.mass_matrix(arm.zero)
        exact = damping * np.sort(np.linalg.eigvalsh(np.linalg.inv(M)[:n, :n]))
        np.testing.assert_allclose(fast, exact, rtol=1e-3)


@pytest.mark.parametrize("kelvin_voigt", [0.0, 1e-2])
def test_what_falls_over_is_not_stable_beside_fast_damping(kelvin_voigt: float) -> None:
    """A pendulum on its head grows at about sqrt(m g l / I), whatever its shear damps: 1e10 1/s here."""
    beam = fa.Beam(1.0, fa.Rectangle(0.01, 0.02), STEEL, {"bending_y": 2, "shear_y": 2}, kelvin_voigt=kelvin_voigt)
    tip = fa.RigidBody(0.5)
    arm = fa.Arm([fa.Link(fa.Revolute("z", damping=0.1), beam=beam, tip=tip)], (9.81, 0, 0))
    rigid = np.sqrt((beam.mass / 2 + tip.mass) * 9.81 / (beam.mass / 3 + tip.mass))
    head, hanging = arm.modes([np.pi, 0, 0, 0, 0]), arm.modes()
    assert head.eigenvalues.real.max() == pytest.approx(rigid, rel=0.03)
    assert not head.stable
    assert hanging.stable
