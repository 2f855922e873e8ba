"""Sections by their matrices: couplings, and what lies off the beam's axis."""

import math

import flexarm as fa
import numpy as np
import pytest
import scipy.linalg
import scipy.optimize
from arms import STRAINS
from messages import refuses, warns

STEEL = fa.Material(7850.0, 209e9, 0.3)
STRIP = fa.Rectangle(0.004, 0.01)
ALL = {s: 3 for s in STRAINS}
K = np.array(fa.SectionMatrix.of(STRIP, STEEL).stiffness)
M = np.array(fa.SectionMatrix.of(STRIP, STEEL).inertia)


def arm(section: object, modes: dict = ALL, order: object = "exact", **more: object) -> fa.Arm:
    material = None if isinstance(section, fa.SectionMatrix | fa.sections.Taper) else STEEL
    beam = fa.Beam(0.5, section, material, modes, "legendre", order, **more)
    hub = fa.RigidBody(0.5, (0.01, 0.02, 0.0), (1e-3, 2e-3, 1.5e-3))
    return fa.Arm([fa.Link(fa.Revolute((0, 0.6, 0.8)), hub, beam)], gravity=(1, 2, -9.81))


@pytest.mark.parametrize("order", [0, 1, 2, 3, "exact"])
def test_a_symmetric_section_by_its_matrices(order: object) -> None:
    one, other = arm(STRIP, order=order), arm(fa.SectionMatrix.of(STRIP, STEEL), order=order)
    rng = np.random.default_rng(0)
    q, v, tau = 0.01 * rng.normal(size=(3, one.nv))
    np.testing.assert_allclose(one.forward_dynamics(q, v, tau), other.forward_dynamics(q, v, tau), rtol=1e-9)


@pytest.mark.parametrize("curved", [False, True])
def test_the_axis_is_a_matter_of_description(curved: bool) -> None:
    """A beam whose strains are those of an axis beside its middle and turned against it is the same beam: with x' =
    R (e1 + phi), the section at d has phi + K x d, and q follows."""
    d, angle = np.array([0.0, 0.003, -0.002]), 0.4
    c, s = math.cos(angle), math.sin(angle)
    R = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    here = arm(fa.SectionMatrix.of(STRIP, STEEL), curvature=(0, 0, 0) if not curved else (2.0, 3.0, -1.0))
    K0 = R @ (2.0, 3.0, -1.0) if curved else np.zeros(3)
    # along the axis at -R d the rod at rest is (1 + eps0) long a metre: it is straight there, so that K0 = 0 else
    if curved:
        d = np.zeros(3)  # a rod that is curved at rest has no other axis of unit speed
    section = fa.SectionMatrix.of(STRIP, STEEL, y=(R @ d)[1], z=(R @ d)[2], angle=angle)
    base = fa.RigidBody(0.5, R @ (0.01, 0.02, 0.0) + (0, 0, 0), R @ np.diag([1e-3, 2e-3, 1.5e-3]) @ R.T, end=-R @ d)
    beam = fa.Beam(0.5, section, modes=ALL, basis="legendre", order="exact", curvature=K0)
    there = fa.Arm([fa.Link(fa.Revolute(R @ (0, 0.6, 0.8)), base, beam)], gravity=R @ (1, 2, -9.81))
    rows = [fa._core.STRAIN_NAMES.index(n) for n in ("eps", "phi12", "phi13", "K1", "K2", "K3")]
    at = 0.5 * (np.polynomial.legendre.leggauss(6)[0] + 1) * 0.5
    tilde = np.array([[0, -d[2], d[1]], [d[2], 0, -d[0]], [-d[1], d[0], 0]])
    T = scipy.linalg.block_diag(R, R) @ np.block([[np.eye(3), tilde], [np.zeros((3, 3)), np.eye(3)]])

    def strains(a: fa.Arm) -> np.ndarray:
        return np.vstack([np.array(a.links[0].beam._core.strains(float(x)))[rows] for x in at])

    wanted = np.kron(np.eye(6), T) @ strains(here)
    S = np.eye(here.nv)
    S[1:, 1:] = np.linalg.lstsq(strains(there), wanted, rcond=None)[0]
    rng = np.random.default_rng(1)
    q, v, tau = rng.normal(size=(3, here.nv)) * np.array([[0.3], [0.3], [1.0]])
    a = here.forward_dynamics(q, v, S.T @ tau)
    np.testing.assert_allclose(there.forward_dynamics(S @ q, S @ v, tau), S @ a, atol=1e-7 * np.abs(S @ a).max())
    middle, turned = here.frame(q)
    p, Rp = there.frame(S @ q)
    np.testing.assert_allclose(R.T @ (p + Rp @ R @ d), middle, atol=1e-12)
    np.testing.assert_allclose(R.T @ Rp @ R, turned, atol=1e-12)


def goland() -> tuple[fa.SectionMatrix, float]:
    """The wing of Goland (1945): with his masses and stiffness, in SI."""
    m, offset, inertia = 35.71, 0.18288, 8.64  # the centre of mass is off the elastic axis; inertia is about that
    stiffness = np.diag([1e10, 1e10, 1e10, 0.9876e6, 9.773e6, 1e10])
    J = np.diag([inertia, 1e-6, inertia + 1e-6])
    c = np.array([[0, 0, offset], [0, 0, 0], [-offset, 0, 0]])  # of a centre of mass on y
    return fa.SectionMatrix(stiffness, np.block([[m * np.eye(3), -m * c], [-m * c.T, J]])), 6.096


def test_a_wing_that_bends_and_twists_together() -> None:
    """Against the transfer matrix of Euler-Bernoulli bending with Saint-Venant torsion."""
    section, length = goland()
    beam = fa.Beam(length, section, modes={"bending_z": 14, "torsion": 14}, basis="legendre", order="exact")
    found = fa.Arm([fa.Link(fa.Fixed(), None, beam)]).modes().frequencies[:6]
    m, offset = section.mass, section.com[0]
    EI, GJ, J = section.stiffness[4][4], section.stiffness[3][3], section.inertia[3][3]

    def end(w: float) -> float:
        A = np.zeros((6, 6))  # h, h', moment, shear, turn, torque; downward motion by a turn is offset * turn
        A[0, 1], A[1, 2], A[2, 3], A[4, 5] = 1, 1 / EI, 1, 1 / GJ
        A[3, 0], A[3, 4] = m * w * w, m * offset * w * w
        A[5, 0], A[5, 4] = -m * offset * w * w, -J * w * w
        return float(np.linalg.det(scipy.linalg.expm(A * length)[np.ix_([2, 3, 5], [2, 3, 5])]))

    for f in found:
        exact = scipy.optimize.brentq(end, 0.995 * f, 1.005 * f)
        assert abs(f / exact - 1) < 1e-7


def test_bending_that_twists() -> None:
    """Linear statics of a coupled section: a moment at the end, strains C^-1 m."""
    C = K.copy()
    C[3, 4] = C[4, 3] = 0.5 * math.sqrt(C[3, 3] * C[4, 4])
    beam = fa.Beam(0.5, fa.SectionMatrix(C, M), modes=ALL, basis="legendre", order="exact")
    a = fa.Arm([fa.Link(fa.Fixed(), None, beam)])
    m = np.array([0.0, 1e-6, 0.0])
    q = a.equilibrium(loads=[fa.Load(moment=m)])
    e = np.linalg.solve(C, np.concatenate([np.zeros(3), m]))
    found = a.strain(q, 0, 0.25)
    rows = [fa._core.STRAIN_NAMES.index(n) for n in ("eps", "phi12", "phi13", "K1", "K2", "K3")]
    np.testing.assert_allclose(found[rows], e, atol=1e-6 * np.abs(e).max())
    assert abs(e[3]) > 0.3 * abs(e[4])


def test_energy_and_momentum_of_a_free_rod() -> None:
    """With its centre of mass off the axis, tumbling and ringing."""
    section = fa.SectionMatrix.of(STRIP, STEEL, y=0.004, z=-0.003, angle=0.3)
    beam = fa.Beam(0.5, section, modes={s: 2 for s in STRAINS}, basis="legendre", order="exact")
    a = fa.Arm([fa.Link(fa.Free(), None, beam)])
    rng = np.random.default_rng(2)
    v0 = rng.normal(size=a.nv) * np.array([*[1.0] * 6, *[3.0] * 6, *[0.01] * 6])
    result = fa.simulate(a, np.linspace(0.0, 0.02, 11), v0=v0, integrator="gauss", step=2e-5)
    energy = np.array([a.energy(q, v) for q, v in zip(result.q, result.v, strict=True)])
    total = energy.reshape(len(result.t), -1)
    total = total.sum(axis=1) if total.shape[1] > 1 else total[:, 0]
    np.testing.assert_allclose(total, total[0], rtol=1e-7)


def test_tapers_are_linear_in_the_matrices() -> None:
    first, last = fa.SectionMatrix(K, M), fa.SectionMatrix(0.4 * K, 0.5 * M)
    taper = fa.sections.Taper((0.0, 0.2, 0.5), (first, last, first))
    np.testing.assert_allclose(taper.at(0.1).stiffness, 0.7 * K)
    a = arm(taper)
    assert a.links[0].beam.mass == pytest.approx(0.5 * 0.75 * M[0, 0])
    pieces = fa.split(a.links[0], 3, (0.2,))
    assert sum(link.beam.mass for link in pieces) == pytest.approx(a.links[0].beam.mass)


def summed(beam: fa.Beam, a: fa.Arm, q: np.ndarray, breaks: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Mass matrix and first moment of mass, by a quadrature of each stretch of the beam."""
    M, moment = np.zeros((a.nv, a.nv)), np.zeros(3)
    for low, high in zip((0.0, *breaks), (*breaks, beam.length), strict=True):
        for x, w in zip(*np.polynomial.legendre.leggauss(30), strict=True):
            at = low + (high - low) / 2 * (1 + x)
            section = beam.section.at(at)
            if not isinstance(section, fa.SectionMatrix):
                section = fa.SectionMatrix.of(section, beam.material)
            inertia = w * (high - low) / 2 * np.array(section.inertia)
            place, R = a.frame(q, 0, at)
            J = scipy.linalg.block_diag(R.T, R.T) @ a.jacobian(q, 0, at)
            M += J.T @ inertia @ J
            moment += inertia[0, 0] * (place + R @ (0.0, *section.com))
    return M, moment


@pytest.mark.parametrize("kind", ["matrices", "shapes"])
def test_kinks_of_a_taper_are_integrated(kind: str) -> None:
    """Centres of mass and moments of inertia that have kinks along the beam, as its mass has."""
    sections = [STRIP, fa.Rectangle(0.02, 0.01), fa.Rectangle(0.004, 0.004)]
    if kind == "matrices":
        sections = [fa.SectionMatrix.of(s, STEEL, y=y) for s, y in zip(sections, (0.0, 0.02, 0.0), strict=True)]
    beam = fa.Beam(
        0.5,
        fa.sections.Taper((0.0, 0.2, 0.5), sections),
        STEEL if kind == "shapes" else None,
        {"bending_y": 2, "torsion": 3},
        "legendre",
        3,
    )
    a = fa.Arm([fa.Link(fa.Revolute("x"), None, beam)])
    q = 0.1 * np.random.default_rng(3).normal(size=a.nq)
    M, moment = summed(beam, a, q, (0.2,))
    size = np.sqrt(np.outer(M.diagonal(), M.diagonal()))
    np.testing.assert_allclose(a.mass_matrix(q) / size, M / size, atol=1e-9)
    np.testing.assert_allclose(a.center_of_mass(q), moment / beam.mass, atol=1e-12)


def test_scenes_and_copies(tmp_path: object) -> None:
    one = fa.SectionMatrix.of(STRIP, STEEL, y=0.004, angle=0.3)
    a = arm(one)
    again = fa.Arm.from_dict(a.to_dict())
    assert again.links[0].beam.section == one and again.links[0].beam.material is None
    assert "kg/m" in a.describe()


def test_a_coupled_strain_without_modes_is_said() -> None:
    (found,) = fa.check(arm(fa.SectionMatrix.of(STRIP, STEEL, y=0.003), {"bending_y": 2}))
    assert "extension has none" in found.what and "couples it to bending_y" in found.what and 80 < found.value < 90


@pytest.mark.parametrize(
    ("section", "says"),
    [
        (fa.SectionMatrix.of(STRIP, fa.Material(7850.0, 209.0, 0.3)), "Young's modulus of 209 Pa, softer than any"),
        (fa.SectionMatrix.of(STRIP, fa.Material(7850.0, 209e3, 0.3)), "is it in GPa or MPa"),
        (fa.SectionMatrix.of(fa.Rectangle(4, 10), STEEL), "is 4 m by 10 m, of a beam of length 0.5 m; is it in mm"),
    ],
)
def test_units_of_matrices_are_looked_at(section: fa.SectionMatrix, says: str) -> None:
    (found,) = fa.check(arm(section))
    assert says in str(found)


def test_matrices_without_units_are_not() -> None:
    assert not fa.check(arm(fa.SectionMatrix(np.eye(6), np.eye(6))))


def test_parameters_of_matrices_vary() -> None:
    """The whole matrix, or an entry of it."""
    a = arm(fa.SectionMatrix(K, M))
    t, path = np.linspace(0.0, 0.01, 3), "link.0.beam.section.stiffness"
    other = K.copy()
    other[3, 3] *= 2.0
    v0 = 0.1 * np.random.default_rng(4).normal(size=a.nv)
    whole = fa.simulate_batch(a, t, v0=v0, parameters={path: [K, other]}, step=1e-4)
    entry = fa.simulate_batch(a, t, v0=v0, parameters={path + ".3.3": [K[3, 3], other[3, 3]]}, step=1e-4)
    np.testing.assert_array_equal(whole.q, entry.q)
    assert np.abs(whole.q[0] - whole.q[1]).max() > 0


def test_economize_knows_them() -> None:
    """Sections off the axis need order 3 or more, whatever else is left out."""
    beam = fa.Beam(
        0.5,
        fa.SectionMatrix.of(STRIP, STEEL, y=0.001),
        modes={"bending_y": 3, "extension": 2, "shear_y": 1},
        basis="legendre",
        order="exact",
    )
    one = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(0.2, inertia=(1e-3,) * 3), beam)])
    scene = fa.Scene(one, {0: fa.Motion.spin_up(3.0, 0.15)}, t=np.linspace(0.0, 0.2, 21))
    plan = fa.economize(scene, tolerance=1e-2)
    found = plan.scene.arm.links[0].beam
    assert found.order in (3, "exact") and found.ne < beam.ne


def test_an_angle_in_degrees_is_doubted() -> None:
    with warns(fa.errors.ModelWarning, "angle = 45"):
        fa.SectionMatrix.of(STRIP, STEEL, angle=45)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: fa.SectionMatrix(K[:5], M), "stiffness has shape"),
        (lambda: fa.SectionMatrix(K * np.nan, M), "stiffness"),
        (lambda: fa.SectionMatrix(K, M * [1, 1, 1, 1, 1, -1]), "inertia"),
        (lambda: fa.SectionMatrix(K, np.diag(np.diag(M) * [1, 2, 1, 1, 1, 1])), "inertia[1][1]"),
        (lambda: fa.SectionMatrix.of(STRIP, fa.Material(1.0, 1.0)), "poisson_ratio"),
        (lambda: fa.SectionMatrix.of(fa.SectionMatrix(K, M), STEEL), "doubly symmetric"),
        (lambda: fa.SectionMatrix.of(STRIP, STEEL, y=np.nan), "y = nan"),
        (lambda: fa.SectionMatrix.of(STRIP, STEEL, z=np.inf), "z = inf"),
        (lambda: fa.SectionMatrix.of(STRIP, STEEL, angle=np.inf), "angle = inf"),
        (lambda: fa.Beam(0.5, fa.SectionMatrix(K, M), STEEL, ALL), "material ="),
        (lambda: fa.Beam(0.5, STRIP, None, ALL), ("material = None", "Material")),
        (lambda: fa.Beam(0.5, STRIP, STEEL), ("modes", "missing")),
        (lambda: arm(fa.SectionMatrix(np.diag([1, 1, 1, 0, 1, 1]) * K, M)), ("torsion", "positive")),
        (
            lambda: fa.Beam(0.5, fa.SectionMatrix(np.diag([1, 1, 1, 0, 1, 1]) * K, M), modes=ALL, basis="loaded"),
            ("section", "stiffness = 0"),
        ),
        (lambda: arm(fa.SectionMatrix.of(STRIP, STEEL, y=0.01), order=2), ("order = 2", "3", '"exact"')),
        (lambda: fa.sections.Taper((0, 1), (STRIP, fa.SectionMatrix(K, M))), "SectionMatrix"),
    ],
)
def test_bad_input(make: object, says: str) -> None:
    with refuses(says):
        make()
