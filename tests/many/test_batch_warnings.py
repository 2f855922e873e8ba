"""Warnings of wrong numbers in batches: whichever scenario deserves one, once of a kind, wherever it was computed."""

from __future__ import annotations

import warnings
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from messages import refuses, warns

T = np.linspace(0, 10, 41)


def on_springs() -> fa.Arm:
    return fa.Arm([fa.Link(fa.Prismatic("x", stiffness=1.0), fa.RigidBody(1.0))])


def stiff_one(**options: Any) -> fa.BatchResult:
    """Steps of 0.05 s: below the limit at 10 rad/s, above it at 60 rad/s."""
    k = {"link.0.joint.stiffness": [100.0] * 5 + [3600.0] * 2}
    return fa.simulate_batch(on_springs(), T, [1e-9], parameters=k, integrator="rk4", step=0.05, **options)


def told(run: Any) -> list[warnings.WarningMessage]:
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        run()
    return found


def test_steps_above_the_limit_of_any_scenario_are_told() -> None:
    """Only the first scenario had been looked at."""
    (said,) = told(stiff_one)
    assert str(said.message).startswith("scenario 5: ") and "here 60 rad/s" in str(said.message)
    assert said.category is fa.errors.StepWarning and said.filename == __file__
    arms = [fa.Arm([fa.Link(fa.Prismatic("x", stiffness=k), fa.RigidBody(1.0))]) for k in (100.0, 3600.0)]
    (said,) = told(lambda: fa.rollout(arms, [1e-9], step=0.05, nstep=200, integrator="rk4"))
    assert str(said.message).startswith("scenario 1: ") and "here 60 rad/s" in str(said.message)


def rubbing(**options: Any) -> fa.BatchResult:
    """One by one, by `simulate`: joints that rub, of a mass that vibrates too fast for the step."""
    k = {"link.0.joint.stiffness": [100.0] * 3 + [3600.0] * 2}
    arm = fa.Arm([fa.Link(fa.Prismatic("x", stiffness=1.0, coulomb=1e-12), fa.RigidBody(1.0))])
    return fa.simulate_batch(arm, T, [1e-9], parameters=k, integrator="rk4", step=0.05, **options)


@pytest.mark.parametrize("batch", [rubbing, stiff_one])
def test_a_warning_is_told_once_at_the_call_wherever_it_was_found(batch: Any) -> None:
    """In threads it had pointed at threading.py and named any scenario, in processes it was lost."""
    (alone,) = told(lambda: batch(workers=1))
    with ProcessPoolExecutor(1) as pool:
        for options in ({"workers": 2, "batch": 2}, {"executor": pool, "batch": 2}):
            (said,) = told(lambda options=options: batch(**options))
            assert str(said.message) == str(alone.message) and said.filename == __file__


@pytest.mark.parametrize("batch", [rubbing, stiff_one])
def test_warnings_of_wrong_numbers_are_told_again_of_what_was_resumed(batch: Any, tmp_path: Any) -> None:
    found = [told(lambda: batch(out=tmp_path / "b.h5")) for _ in range(2)]
    first, again = (x.message for (x,) in found)
    assert str(first) == str(again) and first.finding.value == again.finding.value and first.growth == again.growth


def test_a_pulse_that_one_scenario_missed_is_told() -> None:
    """Only the first scenario's calls had been looked at: its step sees the pulse."""
    pulse = fa.Torque(lambda t: 5.0 if 0.498 < t < 0.502 else 0.0)
    delay = {"drive.0.delay": [0.0, 0.0, 0.005]}
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, inertia=(1, 1, 1)))])

    def run() -> None:
        fa.simulate_batch(arm, np.linspace(0, 1, 11), drive={0: pulse}, parameters=delay, step=0.02)

    (said,) = told(run)
    assert str(said.message).startswith("scenario 2: drive of") and "is 5 at t = 0.50" in str(said.message)


def test_a_scenario_remembers_that_its_numbers_are_wrong() -> None:
    with warns(fa.errors.StepWarning, "scenario 5"):
        runs = stiff_one()
    assert "above 2.83 over" in str(runs[5].check()) and "above 2.83 over" not in str(runs[0].check())


def flexible(youngs_modulus: float, order: int) -> fa.Arm:
    beam = fa.Beam(0.4, fa.Rectangle(0.002, 0.02), fa.Material(7800.0, youngs_modulus, 0.3), {"bending_y": 2},
                   damping_ratio=0.01, order=order)  # fmt: skip
    link = fa.Link(fa.Revolute("z"), fa.RigidBody(end=(0.05, 0, 0)), beam, fa.RigidBody(0.05))
    return fa.Arm([link, link], gravity=(0, -9.81, 0))


def test_a_pulse_that_the_steps_of_one_scenario_miss_is_told() -> None:
    """Scenarios of "ida" have steps of their own: those of one may see a pulse that another's miss."""

    def pulse(t: float) -> tuple[float, float, float]:
        return 0.0, 100.0 if 0.1013 < t < 0.1016 else 0.0, 0.0

    arm, t, loads, ida = flexible(2.1e11, 2), np.linspace(0, 0.2, 5), [fa.Load(-1, force=pulse)], fa.Ida(rtol=1e-3)
    v0 = np.outer(np.linspace(0, 1, 5), np.eye(arm.nv)[0])
    alone = [told(lambda v=v: fa.simulate(arm, t, v0=v, loads=loads, integrator=ida)) for v in v0]
    assert any(alone)
    (said,) = told(lambda: fa.simulate_batch(arm, t, v0=v0, loads=loads, integrator=ida))
    assert said.category is fa.errors.StepWarning and "loads[0]" in str(said.message)


@pytest.mark.parametrize(("integrator", "options"), [("ida", {}), ("gauss", {"step": 1e-3})])
def test_ranges_are_told_whatever_is_kept(integrator: str, options: dict[str, float]) -> None:
    arm, t = flexible(2e9, 1), np.linspace(0, 0.2, 21)
    v0 = np.outer([0.0, 3.0, 10.0], np.eye(arm.nv)[0])
    kept = told(lambda: fa.simulate_batch(arm, t, v0=v0, integrator=integrator, **options))
    less = told(lambda: fa.simulate_batch(arm, t, v0=v0, integrator=integrator, outputs=["a"], **options))
    assert [str(x.message) for x in kept] == [str(x.message) for x in less]
    assert any(x.category is fa.errors.RangeWarning for x in less)


@pytest.mark.parametrize("integrator", ["ida", "gauss", "implicit", "rk4"])
def test_options_that_are_not_known_are_refused(integrator: str) -> None:
    with refuses("argument = 'rtoll'"):
        fa.simulate_batch(on_springs(), T, integrator=integrator, rtoll=1e-3)
