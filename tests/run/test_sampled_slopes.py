"""Derivatives of runs under controllers that sample: against complex steps of a program written apart, and against
differences of runs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from arms import run_derivatives
from messages import refuses

STEEL = fa.Material(7850.0, 209e9, 0.3)
STEP, PERIOD, LATE = 0.01, 2, 3  # of the pendulum: a step (s); in steps, between samples, and to their force


def pendulum(mass: Any, kp: Any, ki: Any, reference: Any, q0: Any, count: int) -> Any:
    """Angle after each step of the classical Runge-Kutta method under a PI law with a delay: (count + 1), of any type
    of number."""
    arm, own = 0.3, 0.02
    x, memory, on_the_way, held = np.array([q0, 0 * q0]), 0 * ki, [0.0] * (LATE + 1), 0.0

    def rate(x: Any) -> Any:
        force = held - 0.05 * x[1] - mass * 9.81 * arm * np.cos(x[0])
        return np.array([x[1], force / (own + mass * arm**2)])

    out = [x[0]]
    for n in range(count):
        answer = None
        if n % PERIOD == 0:
            error = reference - x[0]
            answer, memory = kp * error + memory, memory + ki * error
        on_the_way.append(answer)
        held = held if on_the_way[-1 - LATE] is None else on_the_way[-1 - LATE]
        a = rate(x)
        b = rate(x + STEP / 2 * a)
        c = rate(x + STEP / 2 * b)
        x = x + STEP / 6 * (a + 2 * b + 2 * c + rate(x + STEP * c))
        out.append(x[0])
    return np.array(out)


def test_a_pendulum_equals_complex_steps_of_another_program() -> None:
    given = {"mass": 0.7, "kp": 4.0, "ki": 0.3, "reference": 0.5, "q0": 0.4}
    body = fa.RigidBody(given["mass"], com=(0.3, 0, 0), inertia=(0.02, 0.02, 0.02))
    arm = fa.Arm([fa.Link(fa.Revolute("z", damping=0.05), body)], gravity=(0, -9.81, 0))
    law = fa.LinearController([[1.0]], [[given["ki"]]], [[1.0]], [[given["kp"]]], rate=1 / (PERIOD * STEP),
                              measure=[("joint", 0)], reference=given["reference"], delay=LATE * STEP)  # fmt: skip
    run = fa.simulate(arm, STEP * np.arange(101), [given["q0"]], control=law, integrator="rk4", step=STEP)
    np.testing.assert_allclose(run.q[:, 0], pendulum(**given, count=100), atol=1e-12)
    paths = {"mass": "link.0.hub.mass", "kp": "control.0.D.0.0", "ki": "control.0.B.0.0",
             "reference": "control.0.reference", "q0": "q0.0"}  # fmt: skip
    found = run.sensitivities(list(paths.values()))
    weights = np.random.default_rng(1).normal(size=run.q.shape)
    gradient = run.gradient({"q": weights}, list(paths.values()))
    for k, (name, path) in enumerate(paths.items()):
        expected = pendulum(**{**given, name: given[name] + 1e-30j}, count=100).imag / 1e-30
        assert np.abs(found.q[k, :, 0] - expected).max() < 1e-10 * np.abs(expected).max(), name
        parts = weights[:, 0] * expected
        assert abs(gradient[path] - parts.sum()) < 1e-10 * np.abs(parts).sum(), name


def flexible(mass: float, limit: float | None = None) -> fa.Arm:
    beam = fa.Beam(0.4, fa.Rectangle(0.003, 0.02), STEEL, {"bending_y": 2}, "legendre", 2, damping_ratio=0.01)
    joint = fa.Revolute("z", damping=0.02, torque_limit=np.inf if limit is None else limit)
    hub, tip = fa.RigidBody(0.3, inertia=(5e-3,) * 3), fa.RigidBody(mass, inertia=(1e-5,) * 3)
    return fa.Arm([fa.Link(joint, hub, beam, tip)])


def integral(gain: float, **more: Any) -> fa.LinearController:
    return fa.LinearController.pid(gain, 20.0, 0.4, 0, reference=0.3, rate=250.0, **more)


def read(gain: float, sensors: list[Any], more: float) -> fa.LinearController:
    return fa.LinearController([], D=[[gain, more]], measure=sensors, reference=[0.3, 0.0], rate=250.0)


def law_of(gain: float) -> Callable[[float, np.ndarray], float]:
    return lambda t, y: float(gain * np.sin(0.3 - y[0]) - 0.4 * np.tanh(y[1]))


ANGLE = fa.sensors.Encoder(0, pulses=None)
SLOW = fa.sensors.Encoder(0, pulses=None, filter=60.0, delay=1e-3, noise=1e-3)
LAWS: dict[str, Callable[[float], Any]] = {
    "integral, late": lambda x: [integral(x, delay=0.003),
                                 fa.LinearController.pid(1.0, 3.0, 0.1, 0, rate=90.0, delay=0.02)],
    "at its limit": lambda x: integral(x, limit=0.5, tracking_time=0.02),
    "an accelerometer": lambda x: read(x, [ANGLE, fa.sensors.Accelerometer(0)], 0.01),
    "filters, noise": lambda x: read(x, [SLOW, fa.sensors.Tachometer(0)], 0.4),
    "a function": lambda x: fa.Sampled(law_of(x), 250.0, [("joint", 0), ("rate", 0)]),
    "computed torque": lambda x: fa.ComputedTorque(20 * x, reference=0.3, rate=250.0),
    "MPC": lambda x: fa.MPC(reference=0.05 * x, rate=125.0, horizon=0.2, stages=10, blocks=5),
}  # fmt: skip


def run_of(law: str, options: dict[str, Any], mass: float = 0.1, limit: float | None = None) -> fa.Result:
    t = np.linspace(0, 0.1, 26)
    return fa.simulate(flexible(mass, limit), t, [0.1, 0, 0], control=LAWS[law](6.0), **options)


GAUSS = {"integrator": "gauss", "step": 2e-3, "rtol": 1e-14}
IMPLICIT = {"integrator": "implicit", "step": 1e-3, "rtol": 1e-13}
IDA = {"rtol": 1e-10, "atol": 1e-13}


@pytest.mark.parametrize(
    ("law", "options", "rough"),
    [*[(name, GAUSS, 1e-4 if name == "MPC" else 1e-7) for name in LAWS],
     *[(name, IMPLICIT, 1e-6) for name in ("integral, late", "at its limit", "an accelerometer", "a function")],
     ("an accelerometer", IDA, 1e-4), ("filters, noise", IDA, 1e-4), ("computed torque", IDA, 1e-4),
     ("integral, late", {"integrator": "rk4", "step": 5e-5}, 1e-7)],
)  # fmt: skip
def test_flexible_arms_equal_differences(law: str, options: dict[str, Any], rough: float) -> None:
    """By a mass, and by the start; and the adjoint's are the forward method's."""
    run = run_of(law, options)
    found = run.sensitivities(["link.0.tip.mass", "q0.0"])
    expected = run_derivatives(lambda x: run_of(law, options, x), 0.1, 1e-4, ("q", "v", "a", "tau"))
    for rows, x in expected.items():
        far = np.abs(getattr(found, rows)[0] - x).max()
        assert far < (100 if rows == "a" else 10 if rows == "v" else 1) * rough * np.abs(x).max(), rows
    rng = np.random.default_rng(2)
    weights = {rows: rng.normal(size=getattr(run, rows).shape) for rows in ("q", "v", "a", "tau")}
    gradient = run.gradient(weights, found.parameters)
    for k, path in enumerate(found.parameters):
        parts = [(w * getattr(found, rows)[k]).sum() for rows, w in weights.items()]
        assert abs(gradient[path] - sum(parts)) < 1e-9 * max(np.abs(parts)), path


def test_a_motor_at_its_limit_gives_no_more() -> None:
    """The sampled force asks for more than the motor has, for a while."""
    run = run_of("integral, late", GAUSS, limit=0.6)
    assert 0 < np.sum(np.abs(run.tau[:, 0]) > 0.6 - 1e-9) < 20
    found = run.sensitivities(["link.0.tip.mass"])
    expected = run_derivatives(lambda x: run_of("integral, late", GAUSS, x, limit=0.6), 0.1, 1e-5)["q"]
    assert np.abs(found.q[0] - expected).max() < 1e-5 * np.abs(expected).max()
    gradient = run.gradient({"q": np.ones(run.q.shape)}, ["link.0.tip.mass", "q0"])
    assert gradient["link.0.tip.mass"] == pytest.approx(found.q[0].sum(), rel=1e-9) and gradient["q0"].shape == (3,)


def test_dry_friction_under_a_sampled_law() -> None:
    def run(mass: float) -> fa.Result:
        joint = fa.Revolute("z", damping=0.02, coulomb=0.2, stiction=0.25)
        link = flexible(mass).links[0]
        arm = fa.Arm([fa.Link(joint, link.hub, link.beam, link.tip)])
        return fa.simulate(arm, np.linspace(0, 0.3, 31), control=integral(6.0), **IMPLICIT)

    base = run(0.1)
    assert base.stats["switches"] > 1
    found = base.sensitivities(["link.0.tip.mass"])
    expected = run_derivatives(run, 0.1, 1e-7)["q"]
    assert np.abs(found.q[0] - expected).max() < 1e-4 * np.abs(expected).max()
    weights = np.random.default_rng(3).normal(size=base.q.shape)
    gradient = base.gradient({"q": weights}, ["link.0.tip.mass"])["link.0.tip.mass"]
    assert gradient == pytest.approx((weights * found.q[0]).sum(), rel=1e-6)


class Adds:
    """A law that remembers."""

    total = 0.0

    def __call__(self, t: float, y: np.ndarray) -> float:
        self.total += 0.01 * float(y[0])
        return -self.total


@pytest.mark.parametrize("options", [GAUSS, IDA])
def test_what_a_run_has_no_derivatives_through(options: dict[str, Any]) -> None:
    steps = fa.LinearController([], D=[[6.0]], measure=[fa.sensors.Encoder(0)], rate=250.0)
    adds = fa.Sampled(Adds(), 250.0, [("joint", 0)])
    for law, says in ((steps, ("measure[0]", "steps")), (adds, "remembers")):
        run = fa.simulate(flexible(0.1), np.linspace(0, 0.1, 26), [0.1, 0, 0], control=law, **options)
        for way in (run.sensitivities, lambda p, run=run: run.gradient({"q": np.ones(run.q.shape)}, p)):
            with refuses(says):
                way(["link.0.tip.mass"])
