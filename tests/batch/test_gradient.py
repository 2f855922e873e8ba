"""Derivatives of steps and rollouts against differences in extended steps."""

import flexarm as fa
import numpy as np
import pytest
from arms import paper_link


def arm_of() -> fa.Arm:
    steel = fa.Material(7850.0, 209e9, 0.3)
    beam = fa.Beam(0.5, fa.Rectangle(0.004, 0.01), steel, {"bending_y": 2, "torsion": 1}, "legendre", "exact")
    links = [fa.Link(fa.Revolute("z", damping=0.01), fa.RigidBody(0.2, inertia=(1e-3,) * 3), beam)]
    links += [fa.Link(fa.Revolute("y"), None, beam, fa.RigidBody(0.1, inertia=(1e-4,) * 3))]
    return fa.Arm(links, gravity=(0, 0, -9.81))


def differences(f: object, x: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Central, extrapolated twice: (..., x)."""
    columns = []
    for k in range(len(x)):

        def at(h: float, k: int = k) -> np.ndarray:
            e = np.zeros(len(x))
            e[k] = h * size[k]
            return (f(x + e) - f(x - e)) / (2 * h * size[k])

        a, b, c = at(1e-2), at(5e-3), at(2.5e-3)
        ab, bc = (4 * b - a) / 3, (4 * c - b) / 3
        columns.append((16 * bc - ab) / 15)
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize(("integrator", "radius"), [("implicit", None), ("implicit", 0.5), ("rk4", None)])
@pytest.mark.parametrize("loaded", [False, True])
def test_a_step(integrator: str, radius: float | None, loaded: bool) -> None:
    arm, n = arm_of(), arm_of().nv
    rng = np.random.default_rng(1)
    soft = np.array([1, 0.02, 0.02, 0.002, 1, 0.02, 0.02, 0.002])
    q, v, tau = (0.5 * soft * rng.normal(size=n) for _ in range(3))
    step = 2e-4 if integrator == "implicit" else 2e-5
    more = {"step": step, "integrator": integrator, "spectral_radius": radius}
    more |= {"rtol": 1e-14} if integrator == "implicit" else {}
    if loaded:
        more["loads"] = [fa.Load(-1, force=(1, 2, 3), axes="section")]
    d = fa.step_derivatives(arm, q, v, tau, **more)

    def end(x: np.ndarray) -> np.ndarray:
        one = fa.step_derivatives(arm, x[:n], x[n : 2 * n], x[2 * n :], **more)
        return np.concatenate([one.q, one.v])

    scale = np.concatenate([0.5 * soft, 10 * soft, np.ones(n)])
    expected = differences(end, np.concatenate([q, v, tau]), scale)
    found = np.hstack([d.A, d.B])
    size = np.abs(expected).max(axis=1, keepdims=True) * np.ones(3 * n)
    assert (np.abs(found - expected) / size).max() < 1e-7
    if not loaded:
        r = fa.rollout(arm, q, v, tau[None], nstep=1, **{k: x for k, x in more.items() if k != "loads"})
        np.testing.assert_allclose(r.q[0, -1], d.q, rtol=1e-11, atol=1e-13)
        np.testing.assert_allclose(r.v[0, -1], d.v, rtol=1e-10, atol=1e-11)


@pytest.mark.parametrize(("integrator", "step"), [("implicit", 5e-4), ("rk4", 2e-5)])
def test_a_rollout(integrator: str, step: float) -> None:
    arm, n, nstep = arm_of(), arm_of().nv, 12
    rng = np.random.default_rng(2)
    soft = np.array([1, 0.02, 0.02, 0.002, 1, 0.02, 0.02, 0.002])
    q0, v0, tau = 0.3 * soft * rng.normal(size=n), soft * rng.normal(size=n), 0.1 * rng.normal(size=(nstep, n))
    wq, wv = rng.normal(size=(nstep + 1, n)), 0.01 * rng.normal(size=(nstep + 1, n))
    more = {"step": step, "integrator": integrator} | ({"rtol": 1e-14} if integrator == "implicit" else {})

    def value(x: np.ndarray) -> np.ndarray:
        r = fa.rollout(arm, x[:n], x[n : 2 * n], x[2 * n :].reshape(nstep, n), **more)
        return np.array((wq * r.q[0]).sum() + (wv * r.v[0]).sum())

    r = fa.rollout(arm, q0, v0, tau, **more)
    g = fa.rollout_gradient(arm, r.q[0], r.v[0], tau, wq, wv, **more)
    found = np.concatenate([g.q0, g.v0, g.tau.ravel()])
    scale = np.concatenate([0.5 * soft, 10 * soft, np.ones(nstep * n)])
    expected = differences(value, np.concatenate([q0, v0, tau.ravel()]), scale)
    for part in (slice(0, n), slice(n, 2 * n), slice(2 * n, None)):
        np.testing.assert_allclose(found[part], expected[part], atol=1e-7 * np.abs(expected[part]).max())


def test_many_at_once_are_those_one_by_one() -> None:
    arm = paper_link()
    rng = np.random.default_rng(3)
    q, v, tau = (0.05 * rng.normal(size=(4, 3, arm.nv)) for _ in range(3))
    many = fa.step_derivatives(arm, q, v, tau, step=1e-3)
    one = fa.step_derivatives(arm, q[2, 1], v[2, 1], tau[2, 1], step=1e-3)
    for a, b in zip(many, one, strict=True):
        np.testing.assert_array_equal(a[2, 1], b)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"step": 0.0}, "step = 0"),
        ({"integrator": "gauss"}, "integrator = 'gauss'"),
        ({"integrator": "rk4", "rtol": 1e-9}, "rtol = 1e-09"),
        ({"spectral_radius": 2.0}, "spectral_radius = 2"),
        ({"arm": fa.Arm([fa.Link(fa.Spherical(), fa.RigidBody(1.0, inertia=(1, 1, 1)))])}, "ball"),
        ({"arm": fa.Arm([fa.Link(fa.Revolute("z", coulomb=1.0), fa.RigidBody(1.0, inertia=(1, 1, 1)))])}, "friction"),
        ({"q": np.nan}, "q"),
    ],
)
def test_bad_input(change: dict, says: str) -> None:
    arm = change.pop("arm", paper_link())
    q = arm.zero + change.pop("q", 0.0)
    with pytest.raises(ValueError, match=says):
        fa.step_derivatives(arm, q, np.zeros(arm.nv), np.zeros(arm.nv), **{"step": 1e-3} | change)


def test_a_step_without_a_solution_is_said() -> None:
    arm = arm_of()
    rng = np.random.default_rng(1)
    q, v, tau = (0.2 * rng.normal(size=arm.nv) for _ in range(3))  # a torsion far too fast for the step, and loud
    with pytest.raises(ValueError, match="no solution was found; take a smaller step"):
        fa.step_derivatives(arm, q, v, tau, step=1e-3)
    with pytest.raises(ValueError, match="step 0: no solution was found"):
        fa.rollout_gradient(arm, np.stack([q, q]), np.stack([v, v]), tau[None], step=1e-3)
