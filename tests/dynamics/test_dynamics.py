"""The algorithms against each other, against difference quotients, and against closed forms."""

import flexarm as fa
import numpy as np
import pytest
from arms import paper_link, random_arm, random_state, rates
from hypothesis import given, settings
from hypothesis import strategies as st

seeds = st.integers(0, 2**32 - 1)
common = settings(max_examples=40, deadline=None, derandomize=True)


def relative(x: np.ndarray, reference: np.ndarray) -> float:
    return float(np.abs(x - reference).max() / np.abs(reference).max())


@common
@given(seeds, st.integers(1, 5))
def test_ab_is_ci_is_the_inverse_of_inverse_dynamics(seed: int, links: int) -> None:
    rng = np.random.default_rng(seed)
    arm = random_arm(rng, links)
    q, v, tau = random_state(rng, arm)
    M, h = arm.mass_matrix(q), arm.bias(q, v)
    ab, ci = (arm.forward_dynamics(q, v, tau, m) for m in ("ab", "ci"))
    # forces, scaled as the mass matrix scales them, with what cancels in them counted
    size = np.abs(M) @ np.abs(ab) + np.abs(h) + np.abs(tau)
    for a in (ab, ci):
        assert (np.abs(arm.inverse_dynamics(q, v, a) - tau) < 1e-10 * size).all()
        assert (np.abs(M @ a + h - tau) < 1e-10 * size).all()
    d = 1 / np.sqrt(np.diag(M))
    condition = np.linalg.cond(d[:, None] * M * d)
    assert relative(ab / d, ci / d) < 1e-10 * max(1.0, condition / 1e4)


@common
@given(seeds, st.integers(1, 4))
def test_mass_matrix_is_symmetric_positive_definite_and_the_kinetic_energy(seed: int, links: int) -> None:
    rng = np.random.default_rng(seed)
    arm = random_arm(rng, links, orders=(1, 2, 3, "exact"))
    q, v, _ = random_state(rng, arm)
    M = arm.mass_matrix(q)
    np.testing.assert_array_equal(M, M.T)
    assert (np.linalg.eigvalsh(M) > 0).all()
    assert 0.5 * v @ M @ v == pytest.approx(arm.energy(q, v)[0], rel=1e-12)


@common
@given(seeds, st.integers(1, 4))
def test_power_balance(seed: int, links: int) -> None:
    """d(T + U)/dt = tau . v, less what the beams' damping takes, at every order."""
    rng = np.random.default_rng(seed)
    arm = random_arm(rng, links)
    q, v, tau = random_state(rng, arm)
    a = arm.forward_dynamics(q, v, tau)
    # what dampers of joints, stops and beams take
    damping = np.zeros(arm.nv)
    at = 0
    for link in arm.links:
        n = link.beam.ne if link.beam else 0
        nv = link.joint.nv
        damping[at : at + nv] = np.broadcast_to(link.joint.damping, nv) * v[at : at + nv]
        for i in range(nv if link.joint.lower is not None else 0):
            x = q[arm.coordinate_of(at + i)]
            depth = max(x - link.joint.upper, link.joint.lower - x, 0.0)
            damping[at + i] += link.joint.limit_damping * min(1.0, depth / 1e-3) * v[at + i]
        at += nv
        if n:
            damping[at : at + n] = link.beam._core.damping @ v[at : at + n]
        at += n
    dq = rates(arm, q, v)  # the rate of energy depends on dq and dv alone, not on the path
    h = 1e-4 / (1 + np.sqrt(np.abs(a).max() / np.abs(v).max()))

    def energy(k: float) -> float:
        return sum(arm.energy(q + k * h * dq, v + k * h * a))

    rate = (8 * (energy(1) - energy(-1)) - (energy(2) - energy(-2))) / (12 * h)  # fourth order
    size = np.abs(tau) @ np.abs(v) + np.abs(arm.bias(q, v)) @ np.abs(v) + sum(np.abs(arm.energy(q, v))) / h * 1e-9
    assert abs(rate - (tau - damping) @ v) < 1e-6 * size


@common
@given(seeds, st.integers(1, 3))
def test_exact_jacobians_against_difference_quotients(seed: int, links: int) -> None:
    rng = np.random.default_rng(seed)
    arm = random_arm(rng, links)
    q, v, a = random_state(rng, arm)
    dq, dv, _ = arm.inverse_derivatives(q, v, a)
    for matrix, at in ((dq, 0), (dv, 1)):
        for i in range(matrix.shape[1]):
            h = 1e-5

            def force(k: float, i: int = i, at: int = at, h: float = h) -> np.ndarray:
                x = [q.copy(), v.copy()]
                x[at][i] += k * h
                return arm.inverse_dynamics(*x, a)

            column = (8 * (force(1) - force(-1)) - (force(2) - force(-2))) / (12 * h)
            rounding = 1e-15 / h * 10 * np.abs(force(0)).max()
            assert np.abs(column - matrix[:, i]).max() < 1e-7 * np.abs(matrix).max() + rounding


@common
@given(seeds)
def test_jacobian_is_the_velocity_of_the_frame(seed: int) -> None:
    rng = np.random.default_rng(seed)
    arm = random_arm(rng, 3)
    q, v, _ = random_state(rng, arm)
    for link in range(3):
        beam = arm.links[link].beam
        for x in (None,) if beam is None else (None, 0.0, 0.7 * beam.length, beam.length):
            h = 1e-5
            (pa, Ra), (pb, Rb) = (arm.frame(q + k * h * rates(arm, q, v), link, x) for k in (-1, 1))
            R = arm.frame(q, link, x)[1]
            spin = (Rb - Ra) / (2 * h) @ R.T
            velocity = np.concatenate([(pb - pa) / (2 * h), [spin[2, 1], spin[0, 2], spin[1, 0]]])
            np.testing.assert_allclose(arm.jacobian(q, link, x) @ v, velocity, atol=1e-8)


def test_prescribed_joints() -> None:
    """Given joint accelerations are met, and inverse dynamics tells the reaction that makes them."""
    rng = np.random.default_rng(5)
    arm = random_arm(rng, 4)
    q, v, tau = random_state(rng, arm)
    driven = [k for k, link in enumerate(arm.links) if link.joint.nv][:2]
    index = [arm.joint_rates(k)[-1] for k in driven]
    given_a = {(k, arm.links[k].joint.nv - 1): a for k, a in zip(driven, (1.5, -0.7), strict=True)}
    for method in ("ab", "ci"):
        a = arm.forward_dynamics(q, v, tau, method, prescribed=given_a)
        np.testing.assert_array_equal(a[index], [1.5, -0.7])
        free = np.setdiff1d(np.arange(arm.nv), index)
        reaction = arm.inverse_dynamics(q, v, a)
        size = np.abs(arm.mass_matrix(q)) @ np.abs(a) + np.abs(tau)
        assert (np.abs(reaction - tau)[free] < 1e-10 * size[free]).all()
        np.testing.assert_allclose(arm.forward_dynamics(q, v, reaction, method), a, atol=1e-10 * np.abs(a).max())


def test_double_pendulum() -> None:
    """Rigid arm against the closed-form equations of a planar double pendulum with rods' inertia."""
    m1, m2, l1, c1, c2, i1, i2, g = 1.3, 0.7, 0.9, 0.4, 0.35, 0.11, 0.05, 9.81
    arm = fa.Arm(
        [
            fa.Link(fa.Revolute("z"), fa.RigidBody(m1, (c1, 0, 0), (0, 0, i1), (l1, 0, 0))),
            fa.Link(fa.Revolute("z"), fa.RigidBody(m2, (c2, 0, 0), (0, 0, i2))),
        ],
        gravity=(0, -g, 0),
    )
    rng = np.random.default_rng(0)
    for _ in range(20):
        (q1, q2), (v1, v2), tau = rng.normal(size=2), rng.normal(size=2), rng.normal(size=2)
        c, s = np.cos(q2), np.sin(q2)
        m22 = m2 * c2**2 + i2
        m12 = m22 + m2 * l1 * c2 * c
        m11 = m1 * c1**2 + i1 + m2 * l1**2 + m22 + 2 * m2 * l1 * c2 * c
        k = m2 * l1 * c2 * s
        g2 = m2 * g * c2 * np.cos(q1 + q2)
        h = np.array([-k * (2 * v1 * v2 + v2**2) + (m1 * c1 + m2 * l1) * g * np.cos(q1) + g2, k * v1**2 + g2])
        expected = np.linalg.solve([[m11, m12], [m12, m22]], tau - h)
        for method in ("ab", "ci"):
            a = arm.forward_dynamics([q1, q2], [v1, v2], tau, method)
            np.testing.assert_allclose(a, expected, rtol=1e-12)


def test_gauss_points_suffice() -> None:
    """The basis chooses enough slices: three times as many change nothing, at tip rotations of about one radian."""
    for basis, q in (("clamped-free", [0.0, 0.2, 0.03, -0.01]), ("legendre", [0.0, 1.5, -0.8, 0.5])):
        for order in (1, 2, 3, "exact"):
            chosen = paper_link(order, basis=basis)
            finer = paper_link(order, basis=basis, gauss_points=3 * chosen.links[0].beam._core.gauss_points)
            A, B = chosen.mass_matrix(q), finer.mass_matrix(q)
            d = np.sqrt(np.diag(B))
            assert np.abs((A - B) / np.outer(d, d)).max() < 1e-10


def test_order_zero_neither_stiffens_nor_softens_with_a_tip_body() -> None:
    beam = paper_link(0).links[0].beam
    tip = fa.RigidBody(0.1, (0.01, 0, 0), (1e-5, 2e-5, 2e-5))
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(end=(0.075, 0, 0)), beam, tip)])
    still, fast = (arm.modes(speed={0: w}, lock=[0]).frequencies for w in (0.0, 10.0))
    np.testing.assert_allclose(still, fast, rtol=1e-12)


def test_sag_under_its_own_weight_and_a_tip_mass() -> None:
    """P L^3/3EI + w L^4/8EI, and for shear P L/kGA + w L^2/2kGA; root curvature (P L + w L^2/2)/EI."""
    E, nu, y, z, L, m, rho, g = 209e9, 0.3, 0.001, 0.02, 0.5, 1e-3, 7850.0, 9.81
    section = fa.Rectangle(y, z)
    modes = {"bending_y": 3, "shear_y": 2}
    beam = fa.Beam(L, section, fa.Material(rho, E, nu), modes, basis="legendre", order=1)
    hub = fa.RigidBody(1.0, (0, 0, 0), (1, 1, 1))
    arm = fa.Arm([fa.Link(fa.Revolute("z"), hub, beam, fa.RigidBody(m))], gravity=(0, -g, 0))
    q = arm.modes(lock=[0]).q
    P, w, EI, kGA = -m * g, -rho * y * z * g, E * section.second_moment_z, 5 / 6 * E / 2 / (1 + nu) * y * z
    shear = P * L / kGA + w * L**2 / (2 * kGA)
    assert arm.deflection(q)[1] == pytest.approx(P * L**3 / (3 * EI) + w * L**4 / (8 * EI) + shear, rel=1e-9)
    assert arm.strain(q)[2] == pytest.approx((P * L + w * L**2 / 2) / EI, rel=1e-9)
    assert arm.strain(q)[3] == pytest.approx((P + w * L) / kGA, rel=1e-6)


@pytest.mark.parametrize("turn", [np.pi / 2, np.pi, 2 * np.pi])
def test_exact_order_carries_a_beam_bent_to_an_arc(turn: float) -> None:
    """Constant curvature: every slice lies on a circle of radius L/turn, at any angle."""
    arm = paper_link("exact", 2, "legendre")
    L, k = 0.5, turn / 0.5
    q = [0.0, k, 0.0]
    for x in (0.1, 0.33, L):
        p, R = arm.frame(q, 0, x)
        np.testing.assert_allclose(p, [0.075 + np.sin(k * x) / k, (1 - np.cos(k * x)) / k, 0], atol=1e-13)
        np.testing.assert_allclose(R[:, 0], [np.cos(k * x), np.sin(k * x), 0], atol=1e-13)


def test_exact_order_carries_a_helix() -> None:
    """Constant curvature and twist: R = exp(X (K1, 0, K3)~) and the helix it integrates to."""
    beam = fa.Beam(
        1.0, fa.Circle(0.01), fa.Material(7850, 209e9, 0.3), {"bending_y": 1, "torsion": 1}, "legendre", "exact"
    )
    arm = fa.Arm([fa.Link(fa.Fixed(), beam=beam)])
    K = np.array([3.0, 0.0, 4.0])  # rad/m
    u, w = K / 5.0, 5.0
    for x in (0.4, 1.0):
        p, R = arm.frame([K[2], K[0]], 0, x)
        cross = np.array([[0, -u[2], u[1]], [u[2], 0, -u[0]], [-u[1], u[0], 0]])
        a = w * x
        np.testing.assert_allclose(R, np.eye(3) + np.sin(a) * cross + (1 - np.cos(a)) * cross @ cross, atol=1e-13)
        arc = np.eye(3) * x + (1 - np.cos(a)) / w * cross + (x - np.sin(a) / w) * cross @ cross
        np.testing.assert_allclose(p, arc[:, 0], atol=1e-13)


def test_elastica_at_every_order() -> None:
    """Cantilever with a tip force across it, P L^2/EI = 1 (elastica: w/L 0.30172077, u/L 0.05643324, slope 0.46135195);
    an order's error falls with the load as its first neglected term does."""
    L, EI = 1.0, 1.0
    section, g = fa.sections.GeneralSection(1.0, 1.0, 1.0, 1.0), 9.81

    def tip(order: int | str, load: float) -> tuple[np.ndarray, float]:
        beam = fa.Beam(L, section, fa.Material(0.0, EI), {"bending_y": 6}, "legendre", order, rotary_inertia=False)
        heavy = fa.RigidBody(load / g, (0, 0, 0), (1e-3,) * 3)
        arm = fa.Arm([fa.Link(fa.Fixed(), beam=_dense(beam), tip=heavy)], gravity=(0, g, 0))
        q = arm.modes().q
        p, R = arm.frame(q)
        return p, float(np.arctan2(R[1, 0], R[0, 0]))

    def _dense(beam: fa.Beam) -> fa.Beam:  # a little mass, so that every coordinate has some
        return fa.Beam(L, section, fa.Material(1e-9, EI), beam.modes, "legendre", beam.order, rotary_inertia=False)

    p, slope = tip("exact", 1.0)
    np.testing.assert_allclose([p[1], 1 - p[0], slope], [0.30172077, 0.05643324, 0.46135195], atol=2e-8)
    for order, power in ((1, 3), (2, 3), (3, 5)):
        errors = [abs(tip(order, load)[0][1] - tip("exact", load)[0][1]) for load in (0.4, 0.2)]
        assert np.log2(errors[0] / errors[1]) == pytest.approx(power, abs=0.35)
