"""A start at rest that controllers hold: nothing moves, and it follows the numbers."""

from __future__ import annotations

from typing import Any

import flexarm as fa
import numpy as np
import pytest
from messages import refuses

T = np.linspace(0.0, 0.5, 101)
AT = (0.4, -0.3)  # rad


def arm(payload: float = 0.5, **joint: Any) -> fa.Arm:
    steel = fa.Material(7850, 209e9, 0.3)

    def link(tip: float) -> fa.Link:
        beam = fa.Beam(0.5, fa.Rectangle(0.02, 0.006), steel, {"bending_z": 2}, "legendre", damping_ratio=0.01)
        return fa.Link(fa.Revolute("y", reflected_inertia=0.05, damping=0.1, **joint), beam=beam, tip=fa.RigidBody(tip))

    return fa.Arm([link(0.2), link(payload)], gravity=(0, 0, -9.81))


def pd(**more: Any) -> list[Any]:
    return [fa.PD(200, 20, 0, reference=AT[0], **more), fa.PD(100, 8, 1, reference=AT[1])]


def pid(ki: float = 1.0, **more: Any) -> list[Any]:
    made = fa.LinearController.pid
    return [made(60, 100 * ki, 4, 0, filter_time=4e-3, reference=AT[0], **more),
            made(30, 50 * ki, 2, 1, filter_time=4e-3, reference=(T, AT[1] + 0 * T), **more)]  # fmt: skip


def on_sensors() -> list[Any]:
    law = fa.LinearController([[0.8]], [[0.2]], [[-400.0]], [[30.0 + 400.0]], rate=500, delay=1e-3, reference=AT[1],
                              measure=[fa.sensors.Encoder(1, pulses=None, offset=0.01)])  # fmt: skip
    return [fa.PD(200, 20, 0, reference=AT[0]), law]


LAWS = {
    "pd": pd(),
    "feed-forward": [*pd(), fa.FeedForward(list(AT))],
    "strain": [fa.StrainFeedback(200, 20, 3.0, 0, reference=AT[0]), pd()[1]],
    "pid": pid(),
    "sampled": pid(rate=500),
    "delayed": pid(rate=500, delay=1.5e-3, limit=15.0),
    "no integral": pid(0.0, rate=500, delay=1.5e-3),
    "memoryless": [fa.LinearController([], D=[[150.0, 5.0]], rate=500, delay=1e-3, actuate=[k], reference=[r, 0.0],
                                       measure=[("joint", k), ("rate", k)]) for k, r in enumerate(AT)],
    "sensors": on_sensors(),
    "servo": [fa.Servo(k, kp=60, kv=3, ki=ki, rate=1000, delay=1e-3, filter=200.0, limit=20.0, reference=r,
                       feedforward=forward)
              for k, (r, ki, forward) in enumerate(zip(AT, (80.0, 0.0), (None, "gravity"), strict=True))],
}  # fmt: skip


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("options", [{"integrator": "implicit", "step": 5e-4}, {"integrator": "gauss", "step": 1e-3}])
def test_nothing_moves(name: str, options: dict[str, Any]) -> None:
    run = fa.simulate(arm(), T, "held", control=LAWS[name], **options)
    assert np.abs(run.q - run.q[0]).max() < 1e-9 and np.abs(run.v).max() < 1e-7
    sag = arm().trim(arm().pose({0: run.q[0, 0], 1: run.q[0, 3]}))  # the oracle of the torques
    np.testing.assert_allclose(run.q[0], sag.q, atol=1e-9)
    np.testing.assert_allclose(run.tau[0], sag.tau, atol=1e-7)
    if name in ("pid", "sampled", "delayed", "feed-forward"):
        np.testing.assert_allclose(run.q[0, [0, 3]], AT, atol=1e-10)
    elif name == "pd":
        np.testing.assert_allclose(run.tau[0, [0, 3]], np.array([200, 100]) * (AT - run.q[0, [0, 3]]), rtol=1e-9)


def test_a_joint_that_needs_no_force() -> None:
    """Its axis is vertical, and it turns no sooner than the others."""
    upright = fa.Arm([fa.Link(fa.Revolute("z", reflected_inertia=0.05)), *arm().links], gravity=(0, 0, -9.81))
    more = {"rate": 500, "delay": 1e-3, "filter_time": 4e-3}
    law = [fa.LinearController.pid(20, 10, 2, k, reference=r, **more) for k, r in enumerate((0.2, *AT))]
    run = fa.simulate(upright, T, "held", control=law, integrator="implicit", step=5e-4)
    assert np.abs(run.v).max() < 1e-7 and run.tau[0, 0] == pytest.approx(0, abs=1e-12)
    np.testing.assert_allclose(run.q[-1, [0, 1, 4]], (0.2, *AT), atol=1e-8)


def test_it_begins_as_a_loop_that_has_come_to_rest() -> None:
    """The oracle: the same loop let settle for long, and its way when a command comes then."""
    law = pid(rate=500, delay=1e-3)
    late = [fa.LinearController.pid(60, 100, 4, 0, filter_time=4e-3, rate=500, delay=1e-3,
                                    reference=([-40.0, 0.1, 0.2, 1.0], [0.4, 0.4, 0.6, 0.6])), law[1]]  # fmt: skip
    soon = [late[0], fa.LinearController.pid(30, 50, 2, 1, filter_time=4e-3, rate=500, delay=1e-3, reference=AT[1])]
    options = {"integrator": "implicit", "step": 1e-3}
    long = fa.simulate(arm(), np.arange(-20000, 501) * 1e-3, "trim", control=soon, **options)
    run = fa.simulate(arm(), np.arange(501) * 1e-3, "held", control=soon, **options)
    np.testing.assert_allclose(run.q, long.q[20000:], atol=2e-5)
    assert np.ptp(run.q[:, 0]) > 0.1


def test_every_scenario_of_a_batch_has_its_own_start() -> None:
    law = pid(rate=500, delay=1.5e-3)
    batch = fa.simulate_batch(arm(), T, "held", control=law, parameters={"link.1.tip.mass": np.array([0.2, 0.5, 0.9])},
                              integrator="implicit", step=5e-4, outputs=("q", "v", "tau"))  # fmt: skip
    for k, payload in enumerate((0.2, 0.5, 0.9)):
        one = fa.simulate(arm(payload), T, "held", control=law, integrator="implicit", step=5e-4)
        assert np.abs(batch[k].v).max() < 1e-9
        np.testing.assert_allclose(batch[k].q, one.q, atol=1e-12)
        np.testing.assert_allclose(batch[k].tau, one.tau, atol=1e-9)


@pytest.mark.parametrize("name", ["pd", "delayed", "sensors"])
def test_derivatives_follow_the_start(name: str) -> None:
    law = LAWS[name]
    options = {"integrator": "implicit", "step": 5e-4}
    found = fa.simulate(arm(), T, "held", control=law, **options).sensitivities(["link.1.tip.mass"])
    ends = [fa.simulate(arm(0.5 + h), T, "held", control=law, **options) for h in (-1e-4, 1e-4)]
    for rows in ("q", "tau"):
        by = (getattr(ends[1], rows) - getattr(ends[0], rows)) / 2e-4
        np.testing.assert_allclose(getattr(found, rows)[0], by, atol=1e-6 * np.abs(by).max())


def test_what_does_not_hold_is_refused() -> None:
    with refuses("control[0].limit", "1", "9.65", "held"):
        fa.simulate(arm(), T, "held", control=pd(limit=1.0))
    with refuses("torque_limit", "1", "9.65", "held", "link 0 revolute"):
        fa.simulate(arm(torque_limit=1.0), T, "held", control=pd())
    half = [fa.PD(100, 10, 0, reference=AT[0]), *pd()]  # each law is within the limit of the motor, their sum is not
    with refuses("torque_limit", "9", "9.65"):
        fa.simulate(arm(torque_limit=9.0), T, "held", control=[half[0], half[0], half[2]])
    with refuses("torque_limit", "9", "9.74"):  # nor is the sum with what a drive carries
        fa.simulate(arm(torque_limit=9.0), T, "held", control=pd(limit=6.0), drive={0: fa.Torque(-5.0)})
    fa.simulate(arm(torque_limit=9.0), T, "held", control=pd()[1:], drive={0: fa.Motion(lambda t: (AT[0], 0.0, 0.0))})
    with refuses("control[0]", "Sampled", "held"):
        fa.simulate(arm(), T, "held", control=fa.Sampled(lambda t, y: 0.0, 100))
    lagging = fa.Servo(0, kp=60, kv=3, rate=1000, current_loop=300.0)
    with refuses("control[0]", "Servo", "current loop"):
        fa.simulate(arm(), T, "held", control=[lagging, pd()[1]])
    washed = fa.StrainFeedback(200, 20, 3.0, 0, reference=AT[0], washout=1.0)
    with refuses("control[0]", "washout"):
        fa.simulate(arm(), T, "held", control=[washed, pd()[1]])
    level = fa.Arm(arm().links, gravity=(0, 9.81, 0))
    with refuses("q0 = 'held'", "do not hold"):
        fa.simulate(level, T, "held", control=pd()[:1])
