"""Fits of arms in closed loops: controllers as they are, commands as they were given, starts that they hold."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from messages import refuses

MASS, MODULUS, DAMPING = "link.0.tip.mass", "link.0.beam.material.youngs_modulus", "link.0.joint.damping"
TRUE = {MASS: 0.1, MODULUS: 2.09e11, DAMPING: 0.1}
T = np.linspace(0.0, 1.0, 251)
COMMAND = 0.4 * np.sin(2 * np.pi * (1.0 + 2.0 * T) * T)
READ: dict[str, Any] = {"outputs": {"angle": "sensor.0", "strain": "sensor.1"}}


def scene(control: Any, values: dict[str, float] = TRUE, q0: Any = None) -> fa.Scene:
    """A link that weighs on its joint, in a loop."""
    joint = fa.Revolute("y", reflected_inertia=0.01, damping=values[DAMPING])
    steel = fa.Material(7850, values[MODULUS], 0.3)
    beam = fa.Beam(0.5, fa.Rectangle(0.02, 0.004), steel, {"bending_z": 2}, "legendre", damping_ratio=0.01)
    arm = fa.Arm([fa.Link(joint, beam=beam, tip=fa.RigidBody(values[MASS]))], gravity=(0, 0, -9.81))
    sensors = (fa.sensors.Encoder(0, pulses=None), fa.sensors.StrainGauge(0, 0.01, face="+z"))
    options = {"integrator": "implicit", "step": 5e-4}
    return fa.Scene(arm, t=T, control=(control,), sensors=sensors, q0=q0, options=options)


def wrong(base: fa.Scene) -> fa.Scene:
    """With other numbers."""
    return replace(base, arm=scene(base.control[0], {MASS: 0.14, MODULUS: 1.7e11, DAMPING: 0.15}).arm)


def recorded(base: fa.Scene, seed: int = 0) -> fa.Data:
    run, rng = base.run(), np.random.default_rng(seed)
    y = [s.read(run).y[:, 0] + std * rng.normal(size=T.size) for s, std in zip(base.sensors, (5e-4, 1e-5), strict=True)]
    columns = {"angle": y[0], "strain": y[1], "torque": run.tau[:, 0] + 0.01 * rng.normal(size=T.size)}
    units = {"angle": "rad", "strain": "1", "torque": "N m", "command": "rad"}
    return fa.Data(T, {**columns, "command": COMMAND}, units)


def far(fit: fa.results.Fit, true: dict[str, float]) -> float:
    """The largest error in standard deviations."""
    return max(abs(fit.values[k] - x) / fit.std[k] for k, x in true.items())


def digital(pulses: int | None, reference: Any = (T, COMMAND)) -> fa.LinearController:
    """A digital PD on an encoder; the difference is filtered."""
    a, kp, kd, time = 0.8, 20.0, 0.8, 8e-3
    encoder = fa.sensors.Encoder(0, pulses=pulses)
    return fa.LinearController([[a]], [[1 - a]], [[-kd / time]], [[kp + kd / time]], rate=500, delay=1e-3, limit=3.0,
                               measure=[encoder], reference=reference)  # fmt: skip


@pytest.mark.filterwarnings("ignore:step")  # that of the rig is the same
def test_a_loop_on_an_encoders_steps() -> None:
    """Its derivatives are those without the steps, and the report says so; its residuals are those with them."""
    base = scene(digital(2000))
    fit = fa.identify(wrong(base), recorded(base), list(TRUE), **READ)
    assert far(fit, TRUE) < 3 and all(fit.std[k] < 0.01 * x for k, x in TRUE.items())
    assert fit.derivatives[0] == "smoothed" and "encoder" in fit.derivatives[1]
    assert "those of the same loop without these steps" in fit.report()
    smooth = fa.identify(wrong(scene(digital(None))), recorded(base), list(TRUE), **READ)
    assert smooth.derivatives == ("exact", "") and "steps" not in smooth.report()
    assert fit.nrmse["angle"] < 0.95 * smooth.nrmse["angle"]


@pytest.mark.filterwarnings("ignore:step")
def test_a_servo_by_its_commands() -> None:
    """An industrial drive as one object, with its encoder's steps."""
    def drive(reference: Any) -> fa.Servo:
        encoder = fa.sensors.Encoder(0, pulses=4000)
        return fa.Servo(0, kp=20, kv=0.8, ki=20, rate=500, sensor=encoder, filter=60.0, delay=1e-3, limit=3.0,
                        reference=reference)  # fmt: skip

    base = scene(drive((T, COMMAND)), q0="held")
    guess = replace(wrong(base), control=(drive(0.0),))
    fit = fa.identify(guess, recorded(base), list(TRUE), inputs={"control.0.reference": "command"}, **READ)
    assert far(fit, TRUE) < 3.5 and fit.derivatives[0] == "smoothed" and fit.nrmse["strain"] < 0.15


def test_a_delay_is_sought_by_differences() -> None:
    law = fa.LinearController.pid(20, 30, 0.5, 0, rate=500, delay=0.002, reference=(T, COMMAND), limit=3.0)
    base, true = scene(law), {**TRUE, "control.0.delay": 0.002}
    sought = {**dict.fromkeys(TRUE), "control.0.delay": fa.Unknown(0.0014, low=0.0, high=0.004)}
    fit = fa.identify(wrong(base), recorded(base), sought, **READ)
    assert far(fit, true) < 3.5 and fit.std["control.0.delay"] < 1e-4
    assert fit.derivatives[0] == "differences" and "differences of runs" in fit.report()


def test_differences_are_the_derivatives_where_these_exist() -> None:
    from flexarm.identify.identify import _task

    base = wrong(scene(fa.PD(20, 0.5, 0, reference=(T, COMMAND))))
    sought = {MASS: None, DAMPING: None, "sensor.1.gain": 1.1, "q0.0": 0.1}
    task = _task(base, recorded(base), sought, None, READ["outputs"], None, None, None, None)
    of = task.residuals
    inner = np.array([x.inner(x.of.start) for x in of.sought])
    exact, rough = of._exact(inner)[0], of._differences(inner)[0]
    for one, other in zip(exact, rough, strict=True):
        np.testing.assert_allclose(other, one, atol=2e-3 * np.abs(one).max(axis=1, keepdims=True).max())


def test_a_law_in_python_that_remembers_is_refused() -> None:
    def law(t: float, y: Any, seen: list[float] = []) -> float:  # noqa: B006
        seen.append(y[0])
        return -20.0 * y[0] - 0.1 * len(seen)

    base = scene(fa.Sampled(law, 500, [fa.sensors.Encoder(0, pulses=500)]))
    with refuses("control", "remembers", "LinearController"):
        fa.identify(base, recorded(base), [MASS], **READ)


@pytest.mark.parametrize(
    ("law", "signal", "own"),
    [
        (lambda r: fa.PD(20, 0.5, 0, reference=r, limit=2.0), "command", {"control.0.kp": 20.0}),
        (lambda r: fa.PD(20, 0.5, 0, reference=fa.Motion(*r)), (fa.Motion, "command"), {"control.0.kv": 0.5}),
        (lambda r: fa.LinearController.pid(20, 30, 0.5, 0, rate=500, reference=r), "command", {}),
        (lambda r: fa.ComputedTorque(200, reference=[fa.Motion(*r)], rate=500), [(fa.Motion, "command")], {}),
        (lambda r: fa.PD(20, 0.5, 0, reference=r), lambda data: (data.t, data["command"]), {}),
    ],
)
def test_commands_as_they_were_given(law: Any, signal: Any, own: dict[str, float]) -> None:
    """The drive is in the model; what it gives is an output."""
    base, true = scene(law((T, COMMAND))), {**TRUE, **own}
    guess = replace(wrong(base), control=(law((T, 0 * T)),))
    sought = {**dict.fromkeys(TRUE), **{k: 1.2 * x for k, x in own.items()}}
    outputs = {**READ["outputs"], "torque": "tau link 0 revolute"}
    fit = fa.identify(guess, recorded(base), sought, inputs={"control.0.reference": signal}, outputs=outputs)
    assert far(fit, true) < 3.5 and fit.nrmse["torque"] < 0.1
    assert fit.validate(recorded(base, 1)).nrmse["strain"] < 0.15


def test_commands_of_no_controller_are_refused() -> None:
    base = scene(fa.PD(20, 0.5, 0))
    with refuses("inputs['control.1.reference']", "control.0.reference"):
        fa.identify(base, recorded(base), [MASS], inputs={"control.1.reference": "command"}, **READ)
    with refuses("inputs['control.0.reference']", "comand", "command"):
        fa.identify(base, recorded(base), [MASS], inputs={"control.0.reference": "comand"}, **READ)


def test_runs_with_commands_and_numbers_of_their_own() -> None:
    """Two recordings with commands of their own; each has its own zero of the gauge, one payload is on both."""
    one, other = (
        scene(fa.LinearController.pid(20, 30, 0.5, 0, rate=500, delay=0.002, reference=(T, r)), q0="held")
        for r in (COMMAND, COMMAND[::-1])
    )
    runs = [recorded(one), recorded(other, 1)]
    moved = [fa.Data(T, {**d.columns, "strain": d["strain"] + 1e-5 * k, "command": c}, d.units)
             for k, (d, c) in enumerate(zip(runs, (COMMAND, COMMAND[::-1]), strict=True))]  # fmt: skip
    sought = {**dict.fromkeys(TRUE), "sensor.1.offset": fa.Unknown(0.0, each_run=True)}
    fit = fa.identify(wrong(one), moved, sought, inputs={"control.0.reference": "command"}, **READ)
    true = {**TRUE, "run 0: sensor.1.offset": 0.0, "run 1: sensor.1.offset": 1e-5}
    assert far(fit, true) < 3.5 and fit.derivatives == ("exact", "")


def test_a_start_that_a_loop_holds_follows_the_numbers() -> None:
    """An integral holds the weight at the start; with a start at zero memory the arm falls at first."""
    law = fa.LinearController.pid(20, 30, 0.5, 0, rate=500, delay=0.002, reference=(T, 0.3 + COMMAND), limit=3.0)
    held = scene(law, q0="held")
    data = recorded(held)
    fit = fa.identify(wrong(held), data, list(TRUE), **READ)
    assert far(fit, TRUE) < 3.5 and fit.nrmse["strain"] < 0.15 and fit.derivatives == ("exact", "")
    lost = fa.identify(replace(wrong(held), q0=None), data, list(TRUE), starts=1, **READ)
    assert lost.nrmse["angle"] > 10 * fit.nrmse["angle"]
