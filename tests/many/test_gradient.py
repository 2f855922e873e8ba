"""Derivatives of steps and rollouts against differences in extended steps."""

from dataclasses import replace

import flexarm as fa
import numpy as np
import pytest
from arms import paper_link
from messages import refuses

PATHS = ["link.1.tip.mass", "link.0.beam.length", "link.1.beam.material.youngs_modulus", "link.0.joint.damping",
         "gravity", "link.1.tip.com"]  # fmt: skip


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
        ({"arm": fa.Arm([fa.Link(fa.Spherical(), fa.RigidBody(1.0, inertia=(1, 1, 1)))])}, ("link[0].joint", "ball")),
        ({"arm": fa.Arm([fa.Link(fa.Revolute("z", coulomb=1.0), fa.RigidBody(1.0, inertia=(1, 1, 1)))])}, "friction"),
        ({"q": np.nan}, "q = [nan, nan, nan, nan]"),
    ],
)
def test_bad_input(change: dict, says: str) -> None:
    arm = change.pop("arm", paper_link())
    q = arm.zero + change.pop("q", 0.0)
    with refuses(says):
        fa.step_derivatives(arm, q, np.zeros(arm.nv), np.zeros(arm.nv), **{"step": 1e-3} | change)


@pytest.mark.parametrize("integrator", ["implicit", "rk4"])
def test_derivatives_of_steps_leave_the_arm_as_it_is(integrator: str) -> None:
    """Steps hold torques within `torque_limit`; the arm's dynamics do not."""
    arm = fa.Arm([fa.Link(fa.Revolute("z", torque_limit=3.0), fa.RigidBody(1.0, inertia=(0.1,) * 3))])
    fa.step_derivatives(arm, [0.0], [0.0], [10.0], step=0.1, integrator=integrator)
    np.testing.assert_allclose(arm.forward_dynamics([0.0], [0.0], [10.0]), 100.0, rtol=1e-12)


def test_a_step_without_a_solution_is_said() -> None:
    arm = arm_of()
    rng = np.random.default_rng(1)
    q, v, tau = (0.2 * rng.normal(size=arm.nv) for _ in range(3))  # a torsion far too fast for the step, and loud
    with refuses("no solution", "smaller step"):
        fa.step_derivatives(arm, q, v, tau, step=5e-3)
    with refuses("step 0", "no solution"):
        fa.rollout_gradient(arm, np.stack([q, q]), np.stack([v, v]), tau[None], step=5e-3)


def with_value(arm: fa.Arm, path: str, value: np.ndarray) -> fa.Arm:
    return fa.simulate_batch(arm, [0, 1e-9], parameters={path: np.asarray(value)[None]}).arm(0)


@pytest.mark.parametrize(
    ("integrator", "step", "radius"), [("implicit", 5e-4, None), ("implicit", 5e-4, 0.7), ("rk4", 2e-5, None)]
)
def test_by_parameters_and_with_forces_that_stay(integrator: str, step: float, radius: float | None) -> None:
    """Steps 4 to 8 go on under the same forces: the method does not begin anew there."""
    arm, n, nstep = arm_of(), arm_of().nv, 12
    rng = np.random.default_rng(4)
    soft = np.array([1, 0.02, 0.02, 0.002, 1, 0.02, 0.02, 0.002])
    q0, v0, tau = 0.3 * soft * rng.normal(size=n), soft * rng.normal(size=n), 0.1 * rng.normal(size=(nstep, n))
    tau[4:9] = tau[4]
    wq, wv = rng.normal(size=(nstep + 1, n)), 0.01 * rng.normal(size=(nstep + 1, n))
    more = {"step": step, "integrator": integrator, "spectral_radius": radius}
    more |= {"rtol": 1e-14} if integrator == "implicit" else {}

    def value(arm: fa.Arm, q: np.ndarray = q0) -> float:
        r = fa.rollout(arm, q, v0, tau, **more)
        return float((wq * r.q[0]).sum() + (wv * r.v[0]).sum())

    r = fa.rollout(arm, q0, v0, tau, **more)
    g = fa.rollout_gradient(arm, r.q[0], r.v[0], tau, wq, wv, **more, parameters=PATHS)
    starts = differences(lambda q: np.array(value(arm, q)), q0, 0.5 * soft)
    np.testing.assert_allclose(g.q0, starts, atol=1e-7 * np.abs(starts).max())
    here = {"link.1.tip.mass": 0.1, "link.0.beam.length": 0.5, "link.1.beam.material.youngs_modulus": 209e9,
            "link.0.joint.damping": 0.01, "gravity": (0, 0, -9.81), "link.1.tip.com": (0, 0, 0)}  # fmt: skip
    for path in PATHS:
        x = np.atleast_1d(np.asarray(here[path], dtype=float))
        size = np.full(len(x), np.abs(x).max() or 0.01)
        expected = differences(
            lambda p, x=x, path=path: np.array(value(with_value(arm, path, p if len(x) > 1 else p[0]))), x, size
        )
        assert g.parameters[path].shape == ((3,) if len(x) > 1 else ())
        assert np.abs(expected).max() > 0
        np.testing.assert_allclose(
            np.atleast_1d(g.parameters[path]), expected, atol=1e-7 * np.abs(expected).max(), err_msg=path
        )


def test_by_forces_and_parameters_through_dry_friction() -> None:
    """A joint that is pushed, slides, comes to rest, and is torn loose."""
    upper = fa.RigidBody(1.0, com=(0.3, 0, 0), inertia=(0.1,) * 3, end=(0.5, 0, 0))
    lower = fa.RigidBody(0.5, com=(0.2, 0, 0), inertia=(0.01,) * 3)
    arm = fa.Arm([fa.Link(fa.Revolute("z", coulomb=0.5, stiction=0.6), upper), fa.Link(fa.Revolute("z"), lower)])
    nstep, step = 180, 5e-3
    t = step * np.arange(nstep)
    tau = np.stack([0.9 * np.sin(12 * t), 0.05 * np.cos(5 * t)], axis=1)
    w = np.random.default_rng(5).normal(size=(nstep + 1, 2))
    more = {"step": step, "rtol": 1e-13}
    paths = ["link.0.joint.coulomb", "link.0.joint.stiction", "link.1.hub.mass"]

    def value(arm: fa.Arm, tau: np.ndarray = tau) -> float:
        return float((w * fa.rollout(arm, arm.zero, None, tau, **more).q[0]).sum())

    r = fa.rollout(arm, arm.zero, None, tau, **more)
    still = (r.v[0, 1:, 0] == 0.0) & (np.arange(nstep) > 3)
    assert still.any() and (np.diff(np.flatnonzero(still)) > 1).any()  # at rest more than once, with sliding between
    g = fa.rollout_gradient(arm, r.q[0], r.v[0], tau, w, **more, parameters=paths)
    for k in np.linspace(1, nstep - 2, 40).astype(int):
        e = np.zeros(tau.shape)
        e[k, 0] = 1e-6
        d = (value(arm, tau + e) - value(arm, tau - e)) / 2e-6
        assert g.tau[k, 0] == pytest.approx(d, rel=1e-4, abs=1e-5 * np.abs(g.tau).max()), k
    here = {"link.0.joint.coulomb": 0.5, "link.0.joint.stiction": 0.6, "link.1.hub.mass": 0.5}
    for path in paths:
        x, h = here[path], 1e-7
        d = (value(with_value(arm, path, x + h)) - value(with_value(arm, path, x - h))) / (2 * h)
        assert g.parameters[path] == pytest.approx(d, rel=1e-4, abs=1e-6), path


def test_scenarios_have_their_own_arms() -> None:
    rng = np.random.default_rng(6)
    arms = [with_value(arm_of(), "link.1.tip.mass", m) for m in (0.05, 0.1, 0.3, 0.2)]
    q, v, tau = 0.01 * rng.normal(size=(2, 2, 8)), np.zeros((2, 2, 8)), 0.1 * rng.normal(size=(2, 2, 5, 8))
    more = {"step": 5e-4}
    r = fa.rollout(arms, q.reshape(4, 8), v.reshape(4, 8), tau.reshape(4, 5, 8), **more)
    w = rng.normal(size=(2, 2, 6, 8))
    rows = r.q.reshape(2, 2, 6, 8), r.v.reshape(2, 2, 6, 8)
    told: list[int] = []
    many = fa.rollout_gradient(arms, *rows, tau, w, **more, parameters=PATHS, workers=2, progress=told.append)
    assert told[-1] == len(arms) and told == sorted(told)
    for k in range(4):
        i = divmod(k, 2)
        one = fa.rollout_gradient(arms[k], r.q[k], r.v[k], tau[i], w[i], **more, parameters=PATHS)
        for name in ("q0", "v0", "tau"):
            np.testing.assert_allclose(getattr(many, name)[i], getattr(one, name), rtol=1e-9, atol=1e-15)
        for path in PATHS:
            np.testing.assert_allclose(many.parameters[path][i], one.parameters[path], rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"parameters": ["link.0.tip.mas"]}, "'link.0.tip.mas'"),
        ({"parameters": ["q0"]}, ("parameters", "'q0'")),
        ({"parameters": "gravity"}, "parameters = 'gravity'"),
        ({"parameters": ["link.0.joint"]}, "link.0.joint"),
        ({"step": 1e-3}, "rollout"),
        ({"q": np.zeros((4, 7))}, "q has shape"),
        ({"arm": [arm_of(), arm_of()]}, ("arm", "2 arms")),
    ],
)
def test_bad_input_of_a_rollout(change: dict, says: str) -> None:
    arm = arm_of()
    r = fa.rollout(arm, 0.01 + arm.zero, None, np.zeros((3, 8)), step=2e-4)
    given = {"arm": arm, "q": r.q[0], "v": r.v[0], "tau": np.zeros((3, 8)), "step": 2e-4} | change
    with refuses(says):
        fa.rollout_gradient(given.pop("arm"), **given)


def test_scenarios_of_a_batch_have_derivatives() -> None:
    """Those of `simulate` of the same scenario."""
    arm, t, masses = paper_link(), np.linspace(0, 0.05, 6), [0.01, 0.05]
    arm = fa.Arm([replace(arm.links[0], tip=fa.RigidBody(0.02))])
    given = {"drive": {0: fa.Torque([0.0, 0.1], [0.1, 0.3])}, "integrator": "implicit", "step": 1e-3}
    batch = fa.simulate_batch(arm, t, parameters={"link.0.tip.mass": masses}, **given)
    twice = fa.simulate_batch(arm, t, parameters={"drive.0.scale": [2.0]}, **given)[0]
    once = fa.simulate(arm, t, **{**given, "drive": {0: fa.Torque([0.0, 0.1], [0.2, 0.6])}})
    weights = {"q": np.ones(once.q.shape)}
    by_scale = twice.gradient(weights, ["drive.0.scale"])["drive.0.scale"]
    assert by_scale == pytest.approx(0.5 * once.gradient(weights, ["drive.0.scale"])["drive.0.scale"], rel=1e-9)
    for k, mass in enumerate(masses):
        one = fa.simulate(fa.Arm([replace(arm.links[0], tip=fa.RigidBody(mass))]), t, **given)
        weights = {"q": np.ones(one.q.shape)}
        paths = ["link.0.tip.mass", "drive.0.scale"]
        assert batch[k].gradient(weights, paths) == pytest.approx(one.gradient(weights, paths), rel=1e-12)
    held = fa.simulate_batch(arm, t, tau=np.ones((2, 6, arm.nv)), integrator="implicit", step=1e-3)
    with refuses("result", "simulate"):
        held[0].gradient({"q": np.ones((6, arm.nq))}, ["link.0.tip.mass"])
