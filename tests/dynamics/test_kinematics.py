"""Motion of slices and of the whole arm; mode shapes; the table."""

import numpy as np
import pytest
from arms import differences, floating_arm, paper_link, pendulum, random_arm, random_state, rates, unit_balls
from messages import refuses
from scipy.spatial.transform import Rotation


def test_velocities_and_accelerations_of_slices() -> None:
    """Against differences of frames and velocities along the motion."""
    rng = np.random.default_rng(7)
    arm = floating_arm()
    q, v, _ = random_state(rng, arm)
    a = rng.normal(size=arm.nv)

    def state(t: float, steps: int = 20) -> tuple[np.ndarray, np.ndarray]:
        """v(t) = v + a t; q by Runge-Kutta."""
        x, h = unit_balls(arm, q), t / steps
        for k in range(steps):
            s = k * h
            k1 = rates(arm, x, v + a * s)
            k2 = rates(arm, x + h / 2 * k1, v + a * (s + h / 2))
            k3 = rates(arm, x + h / 2 * k2, v + a * (s + h / 2))
            k4 = rates(arm, x + h * k3, v + a * (s + h))
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        return x, v + a * t

    q = unit_balls(arm, q)
    for link, x in ((0, None), (1, 0.2), (2, None)):
        V = arm.velocity(q, v, link, x)
        dp = differences(lambda t, k=link, x=x: arm.frame(state(t[0])[0], k, x)[0], 1, 1e-3)[:, 0]
        np.testing.assert_allclose(V[:3], dp, atol=1e-7)
        dR = differences(lambda t, k=link, x=x: arm.frame(state(t[0])[0], k, x)[1], 1, 1e-3)[..., 0]
        wx = dR @ arm.frame(q, link, x)[1].T
        np.testing.assert_allclose(V[3:], [wx[2, 1], wx[0, 2], wx[1, 0]], atol=1e-7)
        dV = differences(lambda t, k=link, x=x: arm.velocity(*state(t[0]), k, x), 1, 1e-3)[:, 0]
        np.testing.assert_allclose(arm.acceleration(q, v, a, link, x), dV, atol=1e-6)
        dJ = differences(lambda t, k=link, x=x: arm.jacobian(state(t[0])[0], k, x), 1, 1e-3)[..., 0]
        np.testing.assert_allclose(arm.jacobian_rate(q, v, link, x), dJ, atol=1e-6)
    lead = arm.acceleration(np.stack([q, q]), v, a)
    assert lead.shape == (2, 6)


@pytest.mark.parametrize("seed", range(6))
def test_acceleration_from_the_jacobian_and_its_rate(seed: int) -> None:
    """Every joint, order and basis: a = J dv/dt + dJ/dt v, at ends and inner slices."""
    rng = np.random.default_rng(seed)
    arm = random_arm(rng, 3)
    q, v, a = random_state(rng, arm)
    for k, link in enumerate(arm.links):
        for x in (None, 0.4 * link.beam.length) if link.beam else (None,):
            J, dJ = arm.jacobian(q, k, x), arm.jacobian_rate(q, v, k, x)
            found = arm.acceleration(q, v, a, k, x)
            np.testing.assert_allclose(found, J @ a + dJ @ v, atol=1e-11 * max(1.0, np.abs(found).max()))
            np.testing.assert_allclose(arm.velocity(q, v, k, x), J @ v, atol=1e-12 * np.abs(J).max())


def test_centre_of_mass_and_momentum() -> None:
    rng = np.random.default_rng(8)
    arm, heavy = floating_arm((0, 0, 0)), floating_arm((0, 0, -1.0))
    q, v, _ = random_state(rng, arm)
    q = unit_balls(arm, q)
    mass = sum(link.mass for link in arm.links)
    c, p = arm.center_of_mass(q), arm.momentum(q, v)
    assert heavy.energy(q, v)[1] - arm.energy(q, v)[1] == pytest.approx(mass * c[2], rel=1e-12)
    dc = differences(lambda e: arm.center_of_mass(q + e[0] * rates(arm, q, v)), 1)[:, 0]
    np.testing.assert_allclose(p[:3], mass * dc, atol=1e-8)
    # the free joint's rows of M v, turned from where they are measured
    rows = arm.mass_matrix(q)[:6] @ v
    R = Rotation.from_quat(q[[4, 5, 6, 3]]).as_matrix()
    np.testing.assert_allclose(p[:3], rows[:3], atol=1e-12 * np.abs(p).max())
    np.testing.assert_allclose(p[3:], R @ rows[3:] + np.cross(q[:3], rows[:3]), atol=1e-11 * np.abs(p).max())
    assert arm.momentum(q, np.stack([v, -v])).shape == (2, 6)


def test_mode_shapes_along_the_arm() -> None:
    """Clamped-free bending is cosh - cos - s (sinh - sin); the hub's end does not move."""
    arm = paper_link(2, 10, "legendre", rotary_inertia=False)
    modes = arm.modes(lock=[0])
    shapes = arm.mode_shapes(modes, 11)
    assert shapes.position.shape == (12, 3) and shapes.displacement.shape == (12, 3, 10)
    np.testing.assert_allclose(shapes.position[:11, 0], 0.075 + np.linspace(0, 0.5, 11))
    assert np.isnan(shapes.x[-1]) and (shapes.link == 0).all()
    for n, b in enumerate((1.875104068711961, 4.694091132974175)):
        x = b * shapes.x[:11] / 0.5
        s = (np.cosh(b) + np.cos(b)) / (np.sinh(b) + np.sin(b))
        w = np.cosh(x) - np.cos(x) - s * (np.sinh(x) - np.sin(x))
        found = shapes.displacement[:11, 1, n]
        np.testing.assert_allclose(found / found[-1], w / w[-1], atol=1e-7)
    with refuses("points = 1", "2"):
        arm.mode_shapes(modes, 1)
    with refuses("arm's"):
        pendulum().mode_shapes(modes)


def test_the_table() -> None:
    text = str(paper_link())
    assert text == paper_link().describe()
    assert "revolute z" in text and "0.5, 0.001 x 0.02" in text and "bending_y 3" in text
    assert "0.0785" in text and "20.95" in text
    assert all(len(line) <= 160 for line in text.splitlines())
    assert "the arm is rigid" in str(pendulum())
    assert "spherical" in str(floating_arm())


# -- bad input -------------------------------------------------------------------------------------------------------
