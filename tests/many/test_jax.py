"""flexarm.jax: gradients of rollouts against differences, under jit and vmap."""

from collections.abc import Iterator

import flexarm as fa
import numpy as np
import pytest

jax = pytest.importorskip("jax")
import jax.numpy as jnp  # noqa: E402
from flexarm.jax import rollout  # noqa: E402
from jax.test_util import check_grads  # noqa: E402
from messages import refuses  # noqa: E402

STEP = 4e-3


@pytest.fixture(autouse=True)
def numbers_of_64_bits() -> Iterator[None]:
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", before)


def arm_of(mass: float = 0.1) -> fa.Arm:
    steel = fa.Material(7850.0, 209e9, 0.3)
    beam = fa.Beam(0.4, fa.Rectangle(0.004, 0.01), steel, {"bending_y": 1}, "legendre", "exact")
    link = fa.Link(fa.Revolute("y", damping=0.05), fa.RigidBody(0.2, inertia=(1e-3,) * 3), beam, fa.RigidBody(mass))
    return fa.Arm([link], gravity=(0, 0, -9.81))


ARM = arm_of()
RNG = np.random.default_rng(1)
Q0, V0, TAU = 0.01 * RNG.normal(size=2), 0.1 * RNG.normal(size=2), 0.1 * RNG.normal(size=(4, 2))


@pytest.mark.parametrize("jitted", [False, True])
@pytest.mark.parametrize("integrator", ["implicit", "rk4"])
def test_gradients_of_all_arguments(integrator: str, jitted: bool) -> None:
    options = {"step": STEP, "rtol": 1e-13} if integrator == "implicit" else {"step": 1e-4}

    def rows(q0: object, v0: object, tau: object, mass: object, gravity: object) -> object:
        values = {"link.0.tip.mass": mass, "gravity": gravity}
        q, v = rollout(ARM, q0, v0, tau, parameters=values, integrator=integrator, **options)
        return q, 0.01 * v

    given = Q0, V0, TAU, np.float64(0.1), np.array([0.1, 0.2, -9.81])
    check_grads(jax.jit(rows) if jitted else rows, given, order=1, modes=["rev"], eps=1e-5, atol=1e-6, rtol=1e-5)


def test_vmap_is_one_by_one() -> None:
    """Over masses inside, over starts outside, and of gradients; forces shared, or of scenarios of their own."""
    taus = jnp.asarray(0.1 * RNG.normal(size=(3, 4, 2)))

    def cost(q0: object, mass: object, tau: object) -> object:
        q, v = rollout(ARM, q0, V0, tau, step=STEP, parameters={"link.0.tip.mass": mass})
        return (q**2).sum() + 1e-3 * (v**2).sum()

    starts, masses = jnp.asarray(0.01 * RNG.normal(size=(2, 2))), jnp.array([0.05, 0.1, 0.3])
    for tau in (TAU, taus):
        found = jax.vmap(jax.vmap(jax.value_and_grad(cost, (0, 1)), (None, 0, None)), (0, None, None))(
            starts, masses, tau
        )
        for i, start in enumerate(starts):
            for j, mass in enumerate(masses):
                value, (by_q0, by_mass) = jax.value_and_grad(cost, (0, 1))(start, mass, tau)
                assert found[0][i, j] == pytest.approx(float(value), rel=1e-11)
                np.testing.assert_allclose(found[1][0][i, j], by_q0, rtol=1e-8)
                assert found[1][1][i, j] == pytest.approx(float(by_mass), rel=1e-8)


def test_scenarios_share_what_is_alike() -> None:
    def total(q0: object, mass: object) -> object:
        q, _ = rollout(ARM, q0, V0, TAU, step=STEP, parameters={"link.0.tip.mass": mass})
        assert q.shape == (3, 5, 2)
        return (q**2).sum()

    masses = np.array([0.05, 0.1, 0.3])
    by_q0, by_mass = jax.grad(total, (0, 1))(Q0, masses)
    expected = np.zeros(2)
    for k, mass in enumerate(masses):
        arm = arm_of(mass)
        r = fa.rollout(arm, Q0, V0, TAU, step=STEP)
        path = "link.0.tip.mass"
        g = fa.rollout_gradient(arm, r.q[0], r.v[0], TAU, 2 * r.q[0], step=STEP, parameters=[path])
        assert by_mass[k] == pytest.approx(float(g.parameters[path]), rel=1e-8)
        expected += g.q0
    np.testing.assert_allclose(by_q0, expected, rtol=1e-8)


def test_a_payload_is_found_by_descent() -> None:
    tau = np.zeros((50, 2))
    tau[:, 0] = 0.3 * np.sin(0.2 * np.arange(50))
    seen = fa.rollout(arm_of(0.137), ARM.zero, None, tau, step=STEP).q[0]

    @jax.jit
    def newton(log_mass: object) -> object:  # Gauss-Newton would need forward mode: the secant of the gradient
        def cost(x: object) -> object:
            q, _ = rollout(ARM, ARM.zero, np.zeros(2), tau, step=STEP, parameters={"link.0.tip.mass": jnp.exp(x)})
            return ((q - seen) ** 2).sum()

        return jax.grad(cost)(log_mass)

    x, y = np.log(0.1), np.log(0.12)
    by_x, by_y = newton(x), newton(y)
    for _ in range(12):
        if by_x == by_y:
            break
        x, y, by_x = y, y - by_y * (y - x) / (by_y - by_x), by_y
        by_y = newton(y)
    assert np.exp(y) == pytest.approx(0.137, rel=1e-7)


def test_bad_input() -> None:
    with refuses("q0 has shape (3,)", "(..., 2)"):
        rollout(ARM, np.zeros(3), V0, TAU, step=STEP)
    with refuses("v0", error=jax.errors.JaxRuntimeError):
        rollout(ARM, Q0, np.full(2, np.nan), TAU, step=STEP)[0].block_until_ready()
    jax.config.update("jax_enable_x64", False)
    with refuses("jax.config.update('jax_enable_x64', True)"):
        rollout(ARM, Q0, V0, TAU, step=STEP)


def test_a_sampled_law_and_dry_friction() -> None:
    """Each sample is a call; the joint sticks at first, then slides: by the gains, against runs with the law in
    `simulate`, a little apart."""
    joint = fa.Revolute("z", coulomb=0.02, stiction=0.03)
    arm = fa.Arm([fa.Link(joint, fa.RigidBody(0.5, (0.1, 0, 0), (0.01,) * 3))])
    samples, steps, step = 10, 5, 2e-3

    def law(gains: object, q: object, v: object, k: int) -> object:
        return gains[0] * (0.004 * k - q) - gains[1] * v

    @jax.jit
    def ends(gains: object) -> object:
        q, v = jnp.zeros(1), jnp.zeros(1)
        for k in range(samples):
            tau = jnp.broadcast_to(law(gains, q, v, k), (steps, 1))
            rows = rollout(arm, q, v, tau, step=step)
            q, v = rows[0][-1], rows[1][-1]
        return q[0] + 0.1 * v[0]

    def simulated(gains: np.ndarray) -> float:
        def at(t: float, y: np.ndarray) -> np.ndarray:
            return np.array([law(gains, y[0], y[1], round(t / (steps * step)))])

        control = fa.Sampled(at, 1 / (steps * step), [("joint", 0), ("rate", 0)], [0])
        run = fa.simulate(arm, step * np.arange(samples * steps + 1), control=control, integrator="implicit", step=step)
        return float(run.q[-1, 0] + 0.1 * run.v[-1, 0])

    gains = np.array([5.0, 0.3])
    value, slope = jax.value_and_grad(ends)(gains)
    assert float(value) == pytest.approx(simulated(gains), abs=1e-6)
    for k, by in enumerate(np.eye(2)):
        near = (simulated(gains + 1e-3 * by) - simulated(gains - 1e-3 * by)) / 2e-3
        assert float(slope[k]) == pytest.approx(near, rel=2e-2)
