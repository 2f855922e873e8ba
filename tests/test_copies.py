"""Whatever a public function gives pickles and copies, so that other processes and caches can have it."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from typing import Any

import flexarm as fa
import flexarm.env
import numpy as np
import pytest
from flexarm.identify.validate.validate import Judged
from messages import refuses

STEEL = fa.Material(7850, 209e9, 0.3)
T = np.linspace(0.0, 0.1, 11)


def arm(patches: tuple[fa.Patch, ...] = ()) -> fa.Arm:
    beam = fa.Beam(0.4, fa.Rectangle(0.004, 0.02), STEEL, {"bending_y": 1}, damping_ratio=0.01, patches=patches)
    return fa.Arm([fa.Link(fa.Revolute("z", reflected_inertia=0.05, damping=0.1), beam=beam, tip=fa.RigidBody(0.1))])


def scene(law: Any = None) -> fa.Scene:
    drive = {0: law or fa.Torque(T, np.sin(40 * T))}
    return fa.Scene(
        arm(), drive, t=T, sensors=(fa.sensors.Encoder(),), options={"integrator": "implicit", "step": 0.01}
    )


def fit() -> fa.results.Fit:
    run = scene().run()
    noise = 1e-4 * np.random.default_rng(0).standard_normal(len(T))
    data = fa.Data(T, {"angle": run.q[:, 0] + noise}, {"angle": "rad"})
    return fa.identify(scene(), data, {"link.0.tip.mass": 0.12}, step=1e-3, outputs={"angle": "sensor.0"}, inputs={})


def validation() -> fa.results.Validation:
    done = fit()
    judged = Judged("lqr", "motion", "all", 0.0, done.comparisons[0], done.nrmse)
    return fa.results.Validation([judged], {"motion": done}, notes=["..."])


def piezo() -> fa.Patch:
    return fa.Patch(0.0, 0.05, 0.02, 5e-4, fa.Piezo(62e9, 0.3, 7800, -190e-12))


def mpc() -> fa.MPC:
    return fa.MPC(arm(), rate=100, horizon=0.1, stages=5, blocks=5, weight=1.0, effort=1e-3)


MADE: dict[str, Callable[[], Any]] = {
    "arm": arm,
    "batch": lambda: fa.simulate_batch(arm(), T, parameters={"link.0.tip.mass": [0.1, 0.2]}),
    "chart": lambda: fa.chart(scene(), budget=0.1),
    "closed loop": lambda: fa.closed_loop(arm(), [fa.PD(5.0, 1.0, 0)]),
    "comparison": lambda: fit().comparisons[0],
    "data": lambda: scene().run().to_data(),
    "decay": lambda: fa.fit_decay(T, np.exp(-T) * np.cos(200 * T)),
    "environment": flexarm.env.FlexarmEnv,
    "environments": lambda: flexarm.env.FlexarmVectorEnv(2),
    "fit": fit,
    "inversion": lambda: fa.invert(arm(), {"azimuth": fa.Motion(T, 1e-3 * T, ends="rest")}, tolerance=1e-4),
    "linear model": lambda: arm().linearize(arm().zero),
    "locus": lambda: fa.closed_loop(arm(), [fa.PD(5.0, 1.0, 0)]).locus([1.0, 2.0]),
    "margins": lambda: fa.closed_loop(arm(), [fa.PD(5.0, 1.0, 0)]).margins,
    "modes": lambda: arm().modes(),
    "mpc": mpc,
    "move": lambda: fa.plan_move(arm(), 0.0, 0.5, limits={"torque": 1.0}),
    "placement": lambda: fa.place_patch(arm(), patch=piezo(), modes=1),
    "plan": lambda: fa.economize(scene(), 1e-2),
    "result": lambda: scene().run(),
    "reading": lambda: fa.sensors.Encoder().read(scene().run()),
    "scene": scene,
    "sensitivities": lambda: scene().run().sensitivities(["link.0.tip.mass"]),
    "step derivatives": lambda: fa.step_derivatives(arm(), arm().zero, [0.0, 0.0], [0.1, 0.0], step=0.01),
    "validation": validation,
    "view": lambda: arm().show(open=False),
}


@pytest.mark.parametrize("name", MADE)
def test_all_that_is_given_pickles_and_copies(name: str) -> None:
    made = MADE[name]()
    for again in (copy.deepcopy(made), copy.copy(made), pickle.loads(pickle.dumps(made))):
        assert type(again) is type(made)
        if " object at " not in repr(made):
            assert repr(again) == repr(made)


def test_what_was_pickled_goes_on() -> None:
    made, plan, mpc_made = fit(), MADE["plan"](), mpc()
    kept = scene().run()
    data = fa.Data(T, {"angle": kept.q[:, 0]}, {"angle": "rad"})
    assert pickle.loads(pickle.dumps(made)).validate(data).nrmse == made.validate(data).nrmse
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(plan)).run().q, plan.run().q)
    still = np.zeros(2)
    assert pickle.loads(pickle.dumps(mpc_made)).step(0.0, still, still) == pytest.approx(
        mpc_made.step(0.0, still, still)
    )


def test_a_function_that_cannot_be_sent_is_named() -> None:
    local = scene(fa.Torque(lambda t: 0.1))
    assert copy.deepcopy(local).run().q[-1, 0] == local.run().q[-1, 0]
    with refuses("lambda", error=(pickle.PicklingError, AttributeError)):
        pickle.dumps(local)


class Reacher(fa.Arm):
    """An arm of a user's own class, with arguments of its own."""

    def __init__(self, length: float) -> None:
        beam = fa.Beam(length, fa.Rectangle(0.002, 0.02), fa.Material(7850, 2e11, 0.3), modes={"bending_y": 2})
        super().__init__([fa.Link(fa.Revolute("z"), fa.RigidBody(end=(0.1, 0, 0)), beam)])


def test_arms_of_a_class_with_arguments_of_its_own() -> None:
    arm = Reacher(0.5)
    again = pickle.loads(pickle.dumps(arm))
    assert type(again) is Reacher and again == arm
    assert "none" not in str(arm) and "- \n" not in str(arm)  # frequencies, also of the clamped beam
    with refuses("steps of 0.02 s", "rk4", error=fa.SimulationError):
        fa.simulate(arm, [0.0, 1.0], v0=[0.0, 1e-3, 0.0], integrator="rk4", step=0.02)
