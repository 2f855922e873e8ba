"""A simulation step by step: the same numbers as a run, inputs between steps, states restored to the last bit."""

from __future__ import annotations

from types import SimpleNamespace

import flexarm as fa
import numpy as np
import pytest
from messages import refuses

STEEL = fa.Material(7850.0, youngs_modulus=209e9, poisson_ratio=0.3)
T = np.arange(101) * 1e-3


def arm(**joint: float) -> fa.Arm:
    beam = fa.Beam(0.4, fa.Rectangle(0.002, 0.02), STEEL, {"bending_y": 2}, damping_ratio=0.01)
    hub, tip = fa.RigidBody(0.2, inertia=(1e-3,) * 3, end=(0.05, 0, 0)), fa.RigidBody(0.05)
    first, second = fa.Revolute("y", **joint), fa.Revolute("y", reflected_inertia=1e-3)
    return fa.Arm([fa.Link(first, hub, beam, tip, name="upper"), fa.Link(second, hub, beam, tip, name="fore")])


PUSH = fa.Load(-1, force=np.outer([0, 1, 0, 1, 1], [0.2, 0, 0.5]), t=[0, 0.02, 0.0501, 0.07, 0.1])
LOOP = fa.LinearController.pid(4.0, 2.0, 0.2, reference=0.3, rate=200, delay=1e-3)
SWING = fa.Motion(lambda t: (0.2 * t**3, 0.6 * t**2, 1.2 * t))
CASES = {
    "free": {},
    "loads": {"loads": [PUSH]},
    "continuous control": {"control": [fa.PD(4.0, 0.2, link=0, reference=0.3)]},
    "sampled control": {"control": [LOOP]},
    "driven": {"drive": {1: SWING}, "tau": [0.5, 0, 0, 0, 0, 0]},
    "torque": {"drive": {"fore": fa.Torque([0, 0.03, 0.1], [0, 0.2, 0.1])}},
}
METHODS = [fa.Implicit(1e-3), fa.Implicit(5e-4, spectral_radius=0.8), fa.RK4(1e-4)]
ALL = [*METHODS, fa.Gauss(2e-3, stages=3)]


MOTOR = fa.Motor(0.5, 2.0, resistance=1.0)
TO = {"reference": 0.3}
LIMITED = {**TO, "limit": 0.6, "tracking_time": 0.1}
LAWS = {  # each kind of controller and drive that goes on from what it has said, or from what it remembers
    "pd": [fa.PD(4.0, 0.2, 0, **TO)],
    "pd at its limit": [fa.PD(4.0, 0.2, 0, **TO, limit=0.3)],
    "pd through a motor": [fa.PD(4.0, 0.2, 0, **TO, motor=MOTOR)],
    "integral": [fa.LinearController.pid(4.0, 2.0, 0.2, 0, filter_time=0.01, **LIMITED)],
    "sampled integral": [fa.LinearController.pid(4.0, 2.0, 0.2, 0, rate=200, delay=7.1e-3, **LIMITED)],
    "servo": [fa.Servo(0, kp=4.0, kv=0.2, rate=200, **TO, motor=MOTOR)],
    "servo with a current loop": [fa.Servo(0, kp=4.0, kv=0.2, ki=5.0, rate=200, **TO, current_loop=100.0)],
    "law of Python": [fa.Sampled(lambda t, y: 4.0 * (0.3 - y[0]) - 0.2 * y[1], 200, [("joint", 0), ("rate", 0)])],
    "both": [fa.PD(2.0, 0.1, 0, **TO), fa.Servo(0, kp=2.0, kv=0.1, rate=200, current_loop=100.0, **TO)],
}  # fmt: skip
JOINTS = {
    "": {}, "torque limit": {"torque_limit": 0.5}, "dry friction": {"coulomb": 0.05, "stiction": 0.07},
    "limit and friction": {"torque_limit": 0.5, "coulomb": 0.05, "stiction": 0.07},
}  # fmt: skip


def start(case: str) -> dict:
    return {**CASES[case], "q0": {"upper": 0.2} if case != "driven" else None}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("method", METHODS, ids=repr)
def test_steps_are_those_of_a_run(case: str, method) -> None:
    given = start(case)
    run = fa.simulate(arm(), T, integrator=method, **given)
    sim = fa.Simulation(arm(), method, t=T, **given)
    for k, t in enumerate(T):
        sim.step(until=t)
        assert sim.t == t
        np.testing.assert_array_equal(sim.q, run.q[k])
        np.testing.assert_array_equal(sim.v, run.v[k])
        if k % 10 == 0:
            np.testing.assert_allclose(sim.a, run.a[k], rtol=1e-12, atol=1e-12)
            np.testing.assert_allclose(sim.tau, run.tau[k], rtol=1e-12, atol=1e-12)


def test_gauss_and_friction() -> None:
    rubs = arm(coulomb=0.2, stiction=0.3)
    run = fa.simulate(rubs, T, integrator="implicit", step=1e-3, tau=[0.9, 0, 0, 0, 0, 0], v0=[1, 0, 0, 0, 0, 0])
    sim = fa.Simulation(rubs, fa.Implicit(1e-3), t=T, tau=[0.9, 0, 0, 0, 0, 0], v0=[1, 0, 0, 0, 0, 0])
    for k in range(101):
        np.testing.assert_array_equal(sim.q, run.q[k])
        np.testing.assert_allclose(sim.friction, run.friction[k], atol=1e-12)
        sim.step()
    for integrator in (fa.Gauss(2e-3), fa.RK4(2e-5)):  # a step ends at each switch
        run = fa.simulate(rubs, T[:41], integrator=integrator, tau=[0.9, 0, 0, 0, 0, 0], v0=[-0.3, 0, 0, 0, 0, 0])
        sim = fa.Simulation(rubs, integrator, t=T, tau=[0.9, 0, 0, 0, 0, 0], v0=[-0.3, 0, 0, 0, 0, 0])
        ida = fa.simulate(rubs, T[:41], tau=[0.9, 0, 0, 0, 0, 0], v0=[-0.3, 0, 0, 0, 0, 0], rtol=1e-9, atol=1e-11)
        assert run.stats["switches"] == ida.stats["switches"] > 0
        np.testing.assert_allclose(run.q, ida.q, atol=1e-6)
        for k in range(1, 41):
            sim.step(until=T[k])
            if k == 11:
                state = sim.state()
        np.testing.assert_allclose(sim.q, run.q[-1], atol=1e-7)
        last = sim.q
        sim.restore(state)
        for k in range(12, 41):
            sim.step(until=T[k])
        np.testing.assert_array_equal(sim.q, last)
    ends = T[[0, -1]]
    run = fa.simulate(arm(), ends, integrator=fa.Gauss(2e-3), loads=[PUSH])
    sim = fa.Simulation(arm(), fa.Gauss(2e-3), t=ends, loads=[PUSH])
    sim.step(until=ends[1])
    np.testing.assert_array_equal(sim.q, run.q[-1])


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("method", ALL, ids=repr)
def test_a_restored_state_goes_on_to_the_last_bit(case: str, method) -> None:
    sim, other = (fa.Simulation(arm(), method, t=T, **start(case)) for _ in range(2))
    for _ in range(7):
        sim.step()
    kept = sim.state()
    there = []
    for _ in range(12):
        sim.step()
        there.append((sim.t, *sim.q, *sim.v))
    for again in (sim, other):
        again.restore(kept)
        assert again.t == kept.t
        for row in there:
            again.step()
            assert (again.t, *again.q, *again.v) == row


@pytest.mark.parametrize("joint", JOINTS)
@pytest.mark.parametrize("law", LAWS)
def test_each_law_goes_on_from_a_restored_state(law: str, joint: str) -> None:
    """To the last bit, in the same simulation from its start and from later, and in another one."""
    for method in (fa.Implicit(1e-3), fa.Gauss(2e-3), fa.Gauss(), fa.RK4(1e-4)):
        made = [fa.Simulation(arm(**JOINTS[joint]), method, t=[0.0, 0.1], control=LAWS[law]) for _ in range(2)]
        states, ends = [made[0].state()], []
        for t in (0.0237, 0.05, 0.06):
            made[0].step(until=t)
            states.append(made[0].state())
            ends.append((*made[0].q, *made[0].v))
        for sim in made:
            for k in (0, 1, 2):
                sim.restore(states[k])
                for t, end in list(zip((0.0237, 0.05, 0.06), ends, strict=True))[k:]:
                    sim.step(until=t)
                    assert (*sim.q, *sim.v) == end, method


def test_inputs_take_the_place_of_laws() -> None:
    given = {"drive": {"fore": fa.Torque(0.1)}, "loads": [fa.Load(-1, force=(0, 0, 0))],
             "control": [fa.PD(4.0, 0.2, link=0, reference=0.0)]}  # fmt: skip
    sim = fa.Simulation(arm(), fa.Implicit(5e-4), **given)
    sim.step(until=0.02)
    was = SimpleNamespace(q=sim.q, v=sim.v)
    sim.set_drive("fore", 0.3)
    sim.set_load(0, force=(0.0, 0.0, 0.7))
    sim.set_reference(0, 0.5)
    sim.set_tau([0.05, 0, 0, 0, 0, 0])
    sim.step(until=0.05)

    run = fa.simulate(
        arm(), [0.02, 0.05], was.q, was.v, tau=[0.05, 0, 0, 0, 0, 0], integrator=fa.Implicit(5e-4),
        drive={"fore": fa.Torque(0.3)}, loads=[fa.Load(-1, force=(0, 0, 0.7))],
        control=[fa.PD(4.0, 0.2, link=0, reference=0.5)],
    )  # fmt: skip
    np.testing.assert_allclose(sim.q, run.q[-1], atol=1e-5 * np.abs(run.q).max())
    assert sim.tau[0] == pytest.approx(0.05 + 4.0 * (0.5 - sim.q[0]) - 0.2 * sim.v[0])


def test_a_scene_and_bad_arguments() -> None:
    scene = fa.load("ist")
    sim = fa.Simulation(scene, fa.Implicit(1e-3))
    sim.step()
    assert sim.t == pytest.approx(1e-3)
    assert "1 steps" in repr(sim)
    np.testing.assert_array_equal(sim.frame()[0], scene.arm.frame(sim.q)[0])
    for message, make in {
        ("Implicit", "Gauss", "RK4"): lambda: fa.Simulation(scene, fa.Ida()),
        ("Arm", "Scene"): lambda: fa.Simulation("ist"),
        "loads": lambda: fa.Simulation(scene, loads=[]),
        "until": lambda: sim.step(until=0.0),
        "torque": lambda: sim.set_drive(0, 1.0),
        "load = 3": lambda: sim.set_load(3),
        "state": lambda: sim.restore(1),
        "this problem's has": lambda: sim.restore(fa.Simulation(arm()).state()),
    }.items():
        with refuses(message):
            make()


def test_a_step_that_fails_leaves_the_state_of_its_beginning() -> None:
    sim = fa.Simulation(arm(), fa.RK4(0.02), v0=[0, 0.1, 0, 0.5, 0, 0])
    with refuses("2.83", "stable", error=fa.SimulationError) as e:
        for _ in range(500):
            before = sim.t, sim.q
            sim.step()
    assert sim.t == e.value.time == before[0]
    np.testing.assert_array_equal(sim.q, before[1])
    assert e.value.result.q.shape == (1, 6)


def ground(t: float, q: np.ndarray, v: np.ndarray) -> float:
    return float(q[0])


ground.terminal, ground.direction = True, -1  # type: ignore[attr-defined]


@pytest.mark.parametrize("integrator", [fa.Implicit(1e-3), fa.Gauss(0.05), fa.RK4(0.02)], ids=lambda i: i.name)
def test_a_terminal_event_stops_a_step_and_the_next_goes_on(integrator: fa.Integrator) -> None:
    """A mass falls from 1 m: it passes zero after sqrt(2/g), and again where gravity has turned a new start round."""
    mass = fa.Arm([fa.Link(fa.Prismatic("x"), fa.RigidBody(2.0))], gravity=(-9.81, 0, 0))
    fall = np.sqrt(2 / 9.81)
    sim = fa.Simulation(mass, integrator, q0=[1.0], events=[ground, lambda t, q, v: q[0] - 0.5])
    sim.step(until=0.2)
    assert not sim.terminated and sim.t == 0.2
    sim.step(until=2.0)
    assert sim.terminated
    np.testing.assert_allclose([sim.t, sim.q[0], sim.v[0]], [fall, 0.0, -9.81 * fall], atol=2e-6)
    np.testing.assert_allclose(sim.t_events[0], [fall], atol=1e-6)
    np.testing.assert_allclose(sim.t_events[1], [np.sqrt(1 / 9.81)], atol=1e-6)
    np.testing.assert_allclose(sim.v_events[1], [[-np.sqrt(9.81)]], atol=1e-5)
    state = sim.state()
    sim.step()
    assert not sim.terminated and sim.t == pytest.approx(fall + integrator.step, abs=1e-5)  # type: ignore[attr-defined]
    assert sim.q[0] < 0
    sim.restore(state)
    assert sim.q[0] == pytest.approx(0, abs=1e-6) and sim.t == pytest.approx(fall, abs=1e-6)


def test_a_scene_has_events() -> None:
    mass = fa.Arm([fa.Link(fa.Prismatic("x"), fa.RigidBody(2.0))], gravity=(-9.81, 0, 0))
    scene = fa.Scene(mass, t=np.linspace(0, 1, 11), q0=[1.0], events=ground)
    r = scene.run()
    assert r.status == 1 and r.t_events[0] == pytest.approx(np.sqrt(2 / 9.81), abs=1e-6)
    sim = fa.Simulation(scene)
    sim.step(until=1.0)
    assert sim.terminated
    with refuses("events[0].terminal = 1"):
        fa.economize(scene)
    with refuses("events", "Python", "code", "file"):
        scene.save("nowhere.toml")
