"""Derivatives of runs with closed loops, against differences of runs."""

from __future__ import annotations

from typing import Any

import flexarm as fa
import numpy as np
import pytest
from arms import bennett, derivative
from messages import refuses

STEEL = fa.Material(7850.0, 209e9, 0.3)
T = np.linspace(0, 0.3, 31)


def bar(
    length: float, name: str, mass: float = 1.0, flexible: bool = False, at: float | None = None, damping: float = 0.0
) -> fa.Link:
    place = None if at is None else fa.Placement((at, 0, 0))
    joint = fa.Revolute("z", inboard=place, damping=damping)
    parent = None if at is None else "world"
    if not flexible:
        body = fa.RigidBody(mass, (length / 2, 0, 0), (0, 0, length**2 / 12), (length, 0, 0))
        return fa.Link(joint, body, name=name, parent=parent)
    beam = fa.Beam(length, fa.Rectangle(0.02, 0.004), STEEL, {"bending_y": 2}, "legendre", 2, kelvin_voigt=1e-3)
    return fa.Link(joint, beam=beam, tip=fa.RigidBody(mass), name=name, parent=parent)


def four_bar(
    flexible: bool = False, mass: float = 1.0, damping: float = 0.01, g: float = -9.81, base: float = 0.6, **loop: float
) -> fa.Arm:
    links = [bar(0.2, "crank", mass, at=0.0, damping=damping), bar(0.6, "coupler", 0.3, flexible),
             bar(0.5, "rocker", 0.2, flexible, at=base)]  # fmt: skip
    return fa.Arm(links, (0, g, 0), loops=[fa.Loop("coupler", "rocker", fa.Revolute("z"), **loop)])


def start(arm: fa.Arm) -> np.ndarray:
    return arm.assemble(arm.pose({"crank": 0.8, "coupler": -0.2, "rocker": 1.5}), hold=["crank"])


PARTS = {"mass": ("link.0.hub.mass", 1.0, 3e-3), "damping": ("link.0.joint.damping", 0.01, 1e-3),
         "g": ("gravity.1", -9.81, 1e-2)}  # fmt: skip


def check(run: Any, parts: dict[str, tuple[str, float, float]], tolerance: dict[str, float]) -> None:
    """The derivatives of `run`, forward against differences, and backwards against these."""
    result = run()
    paths = [path for path, _, _ in parts.values()]
    found = result.sensitivities(paths)
    rng = np.random.default_rng(1)
    weights = {row: rng.standard_normal(getattr(result, row).shape) for row in tolerance}
    for k, (name, (path, value, h)) in enumerate(parts.items()):
        for row, within in tolerance.items():
            expected = derivative(lambda x: getattr(run(**{name: x}), row), value, h)  # noqa: B023
            error = np.abs(getattr(found, row)[k] - expected).max() / np.abs(expected).max()
            assert error < within, (path, row, error)
    gradient = result.gradient(weights, paths)
    for k, path in enumerate(paths):
        terms = [weights[row] * getattr(found, row)[k] for row in tolerance]
        assert abs(gradient[path] - sum(x.sum() for x in terms)) < 1e-6 * max(np.abs(x).max() for x in terms), path


@pytest.mark.parametrize(
    ("integrator", "flexible", "tolerance"),
    [
        (fa.Implicit(step=1e-3, rtol=1e-13), False, {"q": 1e-8, "v": 1e-8, "a": 1e-8}),
        (fa.Implicit(step=1e-3, rtol=1e-13), True, {"q": 1e-7, "v": 1e-5, "a": 3e-4}),
        (fa.Gauss(step=1e-2, rtol=1e-13), False, {"q": 1e-9, "v": 1e-9, "a": 1e-9}),
        (fa.Gauss(step=2e-3, rtol=1e-13), True, {"q": 1e-9, "v": 1e-8, "a": 1e-6}),
        (fa.RK4(step=1e-3), False, {"q": 1e-9, "v": 1e-9, "a": 1e-6}),
    ],
)
def test_a_four_bar(integrator: Any, flexible: bool, tolerance: dict[str, float]) -> None:
    """Its rows lie within the steps of "gauss", too."""
    q0 = start(four_bar(flexible))

    def run(scale: float = 1.0, **values: float) -> fa.Result:
        torque = fa.Torque([0.0, 0.1, 0.3], scale * np.array([0.5, -0.5, 0.3]))
        return fa.simulate(four_bar(flexible, **values), T, q0, drive={"crank": torque}, integrator=integrator)

    check(run, {**PARTS, "scale": ("drive.crank.scale", 1.0, 3e-3)}, tolerance)


def test_a_crank_that_is_moved_tells_the_derivative_of_its_torque() -> None:
    motion = fa.Motion([0, 0.3], [0.8, 1.4], [0, 0], [0, 0])
    q0 = start(four_bar())

    def run(**values: float) -> fa.Result:
        return fa.simulate(
            four_bar(**values), T, q0, drive={"crank": motion}, integrator="implicit", step=1e-3, rtol=1e-13
        )

    parts = {k: PARTS[k] for k in ("mass", "g")}
    result, found = run(), run().sensitivities([path for path, _, _ in parts.values()])
    weights = np.random.default_rng(2).standard_normal(result.tau.shape)
    gradient = result.gradient({"tau": weights}, [path for path, _, _ in parts.values()])
    for k, (name, (path, value, h)) in enumerate(parts.items()):
        expected = derivative(lambda x: run(**{name: x}).tau, value, h)  # noqa: B023
        np.testing.assert_allclose(found.tau[k], expected, rtol=0, atol=1e-8 * np.abs(expected).max())
        assert gradient[path] == pytest.approx((weights * expected).sum(), rel=1e-7)


def test_a_loop_whose_conditions_depend_on_each_other() -> None:
    """Gravity out of the plane makes the four-bar one in space, whose hinge holds three times what the others hold."""

    def run(mass: float = 1.0) -> fa.Result:
        arm = fa.Arm(four_bar(mass=mass).links, (0, -9.81, 1.0), loops=four_bar().loops)
        return fa.simulate(arm, T, start(four_bar()), integrator="implicit", step=1e-3, rtol=1e-13)

    space = run().arm
    assert space.mobility(start(space)).redundant == 3
    check(run, {"mass": PARTS["mass"]}, {"q": 1e-7, "v": 1e-7})


@pytest.mark.parametrize("named", [None, {"crank": 0.8}], ids=str)
@pytest.mark.parametrize("turns", [False, True])
def test_the_start_follows_what_closes_the_loops(named: Any, turns: bool) -> None:
    """The foot of the rocker moves, and the start is assembled for each."""

    def run(base: float = 0.6) -> fa.Result:
        motion = fa.Motion([0, T[-1]], [0.8, 1.2], [1.0, 0], [0, 0])
        drive = {"crank": motion} if turns else {}
        arm, method = four_bar(base=base), fa.Implicit(step=1e-3, rtol=1e-13)
        return fa.simulate(arm, T, named, drive=drive, integrator=method)

    path, result = "link.2.joint.inboard.position.0", run()
    expected, found = derivative(lambda x: run(x).q, 0.6, 1e-3), result.sensitivities([path]).q[0]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7 * np.abs(expected).max())
    weights = np.random.default_rng(1).standard_normal(result.q.shape)
    assert result.gradient({"q": weights}, [path])[path] == pytest.approx((weights * found).sum(), rel=1e-6)


@pytest.mark.parametrize("path", ["drive.crank.scale", "drive.crank.offset"])
def test_rates_and_places_follow_a_motion(path: str) -> None:
    def run(scale: float = 1.0, offset: float = 0.0) -> fa.Result:
        at = np.array([0.8, 1.2]) * scale + offset
        motion = fa.Motion([0, T[-1]], at.tolist(), [2.0 * scale, 0], [0, 0])
        return fa.simulate(four_bar(), T, drive={"crank": motion}, integrator=fa.Gauss(step=5e-3, rtol=1e-13))

    scales = path.endswith("scale")
    expected = derivative(lambda x: (run(x) if scales else run(1.0, x)).q, float(scales), 1e-3)
    found = run().sensitivities([path]).q[0]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7 * np.abs(expected).max())


def test_a_start_in_numbers_does_not_follow_a_loop() -> None:
    arm = four_bar()
    result = fa.simulate(arm, T, start(arm), integrator="implicit", step=1e-3)
    rates = arm.assemble(result.q[0], [1.0, 0, 0], hold=["crank"])[1]
    moving = fa.simulate(arm, T, {"crank": 0.8, "coupler": result.q[0, 1]}, rates, integrator="implicit", step=1e-3)
    for run, field in ((result, "q0"), (moving, "v0")):
        with refuses("'link.2.joint.inboard.position.0'", field, "loop 0", "name joints"):
            run.sensitivities(["link.2.joint.inboard.position.0"])
    assert np.isfinite(moving.sensitivities(["link.0.hub.mass", "v0.0"]).q).all()


def test_derivatives_and_batches_need_no_way_to_the_loops_from_zero() -> None:
    arm, method = bennett(), fa.Gauss(1e-2, rtol=1e-13)
    q0, t = arm.assemble([1.0, 2.5, 1.0]), np.linspace(0, 0.1, 11)

    def run(mass: float = 0.3) -> fa.Result:
        return fa.simulate(bennett(mass), t, q0, integrator=method)

    expected = derivative(lambda x: run(x).q, 0.3, 1e-3)
    found = run().sensitivities(["link.b.hub.mass"]).q[0]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8 * np.abs(expected).max())
    batch = fa.simulate_batch(arm, t, q0, parameters={"link.b.hub.mass": [0.3, 0.31]}, integrator=method)
    np.testing.assert_allclose(batch.q[1], run(0.31).q, atol=1e-12)
    rolled = fa.rollout(arm, q0[None], step=1e-3, nstep=100)
    np.testing.assert_allclose(rolled.q[0, -1], run().q[-1], atol=1e-5)


def test_compliant_loops_have_derivatives_by_every_integrator() -> None:
    spring = {"stiffness": 1e5, "angular_stiffness": 10.0, "damping": 10.0}
    for integrator in ("gauss", "implicit", "rk4"):

        def run(mass: float = 1.0) -> fa.Result:
            arm = four_bar(mass=mass, **spring)
            return fa.simulate(arm, T, start(four_bar()), integrator=integrator, step=5e-4)  # noqa: B023

        expected = derivative(lambda x: run(x).q, 1.0, 3e-3)
        found = run().sensitivities(["link.0.hub.mass"]).q[0]
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * np.abs(expected).max())


def test_idas_sensitivities_are_refused_by_name() -> None:
    arm = four_bar()
    run = fa.simulate(arm, T, start(arm), integrator="ida")
    with refuses("derivatives of a run", "ida", "loop 0"):
        run.sensitivities(["link.0.hub.mass"])


def test_balls_in_the_tree_and_the_loop() -> None:
    """A platform on two legs: each hangs on a ball, and a spherical joint closes."""

    def platform(mass: float = 1.0, damping: float = 0.01) -> fa.Arm:
        body = fa.RigidBody(0.5, (0.2, 0, 0), (0.01, 0.02, 0.02), (0.4, 0, 0))
        leg = fa.RigidBody(mass, (0, 0, -0.3), (0.03, 0.03, 0.01), (0, 0, -0.6))
        other = fa.RigidBody(0.8, (0, 0, -0.3), (0.03, 0.03, 0.01), (0, 0, -0.6))
        foot = fa.Placement((0.4, 0, 0))
        links = [fa.Link(fa.Spherical(damping=damping), leg, name="left"),
                 fa.Link(fa.Spherical(), body, name="plate", parent="left"),
                 fa.Link(fa.Universal(inboard=foot), other, name="right", parent="world")]  # fmt: skip
        return fa.Arm(links, (0, 0, -9.81), loops=[fa.Loop("plate", "right", fa.Spherical())])

    first = platform()
    v0 = np.zeros(first.nv)
    v0[:3] = 0.3, 0.5, -0.2
    q0, v0 = first.assemble(first.zero, v0)

    parts = {"mass": ("link.0.hub.mass", 1.0, 3e-3), "damping": ("link.0.joint.damping", 0.01, 1e-3)}
    for integrator in (fa.Implicit(step=1e-3, rtol=1e-13), fa.Gauss(step=7e-3, rtol=1e-13)):

        def run(**values: float) -> fa.Result:
            return fa.simulate(platform(**values), T, q0, v0, integrator=integrator)  # noqa: B023

        check(run, parts, {"q": 1e-7, "v": 1e-7, "a": 1e-6})


def test_under_a_controller_with_a_limit() -> None:
    q0 = start(four_bar())

    def run(gain: float = 20.0, mass: float = 1.0) -> fa.Result:
        law = fa.PD(gain, 0.5, "crank", reference=1.2, limit=50.0)
        arm = four_bar(mass=mass)
        return fa.simulate(arm, T, q0, control=law, integrator="implicit", step=1e-3, rtol=1e-13)

    check(run, {"gain": ("control.0.kp", 20.0, 0.05), "mass": PARTS["mass"]}, {"q": 1e-6, "v": 1e-6})


def test_steps_and_rollouts() -> None:
    arm = four_bar(True)
    q0, rng = start(arm), np.random.default_rng(3)
    v0 = np.zeros(arm.nv)
    tau = 0.3 * rng.standard_normal((20, arm.nv))
    options: dict[str, Any] = {"integrator": "implicit", "step": 1e-3, "rtol": 1e-13}
    one = fa.step_derivatives(arm, q0, v0, tau[0], **options)
    for k in range(arm.nv):

        def end(x: float) -> np.ndarray:
            force = tau[0].copy()
            force[k] += x  # noqa: B023
            step = fa.step_derivatives(arm, q0, v0, force, **options)
            return np.concatenate([step.q, step.v])

        by = derivative(end, 0.0, 1e-2)
        assert np.abs(one.B[:, k] - by).max() < 1e-5 * np.abs(one.B).max()

    def roll(force: np.ndarray) -> Any:
        return fa.rollout(arm, q0[None], v0[None], force[None], **options)

    rolled = roll(tau)
    weights = rng.standard_normal(rolled.q[0].shape)
    found = fa.rollout_gradient(arm, rolled.q[0], rolled.v[0], tau, by_q=weights, **options)
    direction = rng.standard_normal(tau.shape)
    terms = weights * derivative(lambda x: roll(tau + x * direction).q[0], 0.0, 1e-2)
    assert (found.tau * direction).sum() == pytest.approx(terms.sum(), abs=1e-5 * np.abs(terms).max())
