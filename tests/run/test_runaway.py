"""Runs that leave any reach, that a loop feeds, that crawl, or that step over a pulse: what is said of them."""

from __future__ import annotations

import pickle
import re
import sys
from dataclasses import replace

import flexarm as fa
import numpy as np
import pytest
from arms import STEEL, paper_link
from flexarm.env import FlexarmVectorEnv
from flexarm.tasks import TipTracking
from messages import refuses, warns

FIXED = {"implicit": 1e-3, "gauss": 1e-2, "rk4": 1e-3}
EVERY = ["ida", *FIXED]


def steps(integrator: str) -> dict:
    return {"integrator": integrator} | ({"step": FIXED[integrator]} if integrator in FIXED else {})


# -- beyond any reach --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("integrator", EVERY)
def test_order_one_above_its_critical_speed_is_given_up(integrator: str) -> None:
    """A spin-up to 25 rad/s, above 20.95: the tip was 26 km away, and status 0."""
    with refuses("link 0", "order 1", "order = 2", error=fa.SimulationError) as e:
        fa.simulate(
            paper_link(1), np.linspace(0, 4, 401), drive={0: fa.Motion.spin_up(25.0, 1.0)}, **steps(integrator)
        )
    assert "ran away" in str(e.value) and "the beam of link 0 is bent by" in str(e.value)
    kept = np.abs(e.value.result.tip_deflection()).max()
    assert 1.0 < kept < 10 * 0.5 and e.value.result.t[-1] <= e.value.time  # up to ten lengths
    fa.simulate(paper_link(2), np.linspace(0, 1.2, 5), drive={0: fa.Motion.spin_up(25.0, 1.0)}, **steps(integrator))


@pytest.mark.parametrize("lanes", [True, False])
@pytest.mark.parametrize("integrator", ["implicit", "rk4"])
def test_batches_give_up_what_runs_away_alone(integrator: str, lanes: bool) -> None:
    """Two of three scenarios at order 1, spun below and above the critical speed."""
    n, dt = 2000, 1e-3
    t = np.arange(n + 1) * dt
    spins = [{0: fa.Motion(t, w * t, np.full(n + 1, w), np.zeros(n + 1))} for w in (15.0, 30.0, 10.0)]
    q0 = np.array([0.0, 1e-6, 0.0, 0.0])
    r = fa.rollout(paper_link(1), q0, step=dt, nstep=n, drive=spins, integrator=integrator, lanes=lanes)
    assert r.status.tolist() == [0, 3, 0] and [f.index for f in r.failures] == [1]
    assert "the beam of link 0 is bent by" in r.failures[0].reason
    rate = np.sqrt(30.0**2 - 20.9487**2)
    assert r.reached[1] == pytest.approx(np.log(10 * 0.5 / 0.5e-6) / rate, rel=0.05)
    assert np.nanmax(np.abs(r.q[1, :, 1])) < 5.1 and np.isnan(r.q[1, -1]).all()
    assert np.isfinite(r.q[[0, 2]]).all()


def test_the_environment_ends_what_runs_away() -> None:
    task = TipTracking()
    env = FlexarmVectorEnv(2, task)
    env.reset(seed=1)
    env._v[1, task.arm.nv - 1] = 1e9
    *_, terminated, _, _ = env.step(np.zeros((2, env.single_action_space.shape[0])))
    assert terminated.tolist() == [False, True]


def test_a_coil_and_a_shaft_may_turn_far() -> None:
    """A beam of exact order bent to twenty rings, and a shaft twisted by fifty turns, move as they should."""
    strip = fa.Beam(1.0, fa.Rectangle(1e-3, 1e-2), STEEL, {"bending_y": 2}, "legendre", "exact", gauss_points=200)
    arm = fa.Arm([fa.Link(fa.Fixed(), beam=strip)])
    fa.simulate(arm, [0, 1e-4], [2 * np.pi * 20, 0.0], integrator="implicit", step=1e-5)
    shaft = fa.Beam(1.0, fa.Circle(1e-3), STEEL, {"torsion": 1})
    fa.simulate(fa.Arm([fa.Link(fa.Fixed(), beam=shaft)]), [0, 1e-4], [2 * np.pi * 50])


def test_joints_travel_as_far_as_they_like() -> None:
    arm = fa.Arm([fa.Link(fa.Prismatic("x"), fa.RigidBody(1.0))])
    assert fa.simulate(arm, [0.0, 1.0], v0=[1e9]).q[-1, 0] == pytest.approx(1e9)


# -- loops -------------------------------------------------------------------------------------------------------------

INERTIA = 0.35


def rigid() -> fa.Arm:
    return fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, (0.5, 0, 0), (0, 0, 0.1), (1, 0, 0)))])


def damper(share: float, period: float = 0.01, delay: float = 0.0, compiled: bool = False, **more) -> fa.Controller:
    """A sampled damper of kd period / inertia = share, which is stable below 2."""
    kd = share * INERTIA / period
    if compiled:
        none = np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0))
        return fa.LinearController(*none, [[kd]], rate=1 / period, measure=[("rate", 0)], delay=delay, **more)
    return fa.Sampled(lambda t, y: -kd * y[0], 1 / period, [("rate", 0)], delay=delay, **more)


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("integrator", EVERY)
def test_a_sampled_loop_is_named_above_its_limit_and_not_below(integrator: str, compiled: bool) -> None:
    """kd h / I = 2: the rate is multiplied by 1 - kd h / I from sample to sample."""
    t, v0 = np.linspace(0, 2, 101), [0.1]
    fa.simulate(rigid(), t, v0=v0, control=damper(1.95, compiled=compiled), **steps(integrator))  # warnings are errors
    said = ("'link 0 revolute'", "0.01 s", "z = -1.1", "0.95", "0.005 s")
    with warns(fa.errors.LoopWarning, said) as w:
        fa.simulate(rigid(), t, v0=v0, control=damper(2.1, compiled=compiled), **steps(integrator))
    assert w[0].message.control == 0 and w[0].message.finding.value == pytest.approx(np.log(1.1) / 0.01)
    assert w[0].filename == __file__
    assert str(pickle.loads(pickle.dumps(w[0].message))) == str(w[0].message)
    with refuses("z = -3", "gains", "0.5", "ran away", error=fa.SimulationError):
        fa.simulate(rigid(), t, v0=v0, control=damper(4.0, compiled=compiled), **steps(integrator))


def test_a_loop_that_less_gain_does_not_cure_is_told_what_does() -> None:
    """A damper on the hub of an undamped beam: between its samples it feeds a fast mode at any gain."""
    hub = fa.RigidBody(0.1, inertia=(1e-3, 1e-3, 1e-3), end=(0.075, 0, 0))
    arm = fa.Arm([fa.Link(fa.Revolute("z"), hub, fa.Beam(0.5, fa.Rectangle(0.003, 0.02), STEEL, {"bending_y": 3}))])
    kd = 230.0 * arm.mass_matrix(arm.zero)[0, 0]
    law = fa.Sampled(lambda t, y: -kd * y[0], 100, [("rate", 0)])
    said = ("sampled", "stable", "0.001")
    with refuses(said, error=fa.SimulationError):
        fa.simulate(arm, np.linspace(0, 5, 51), v0=[0.1, 0, 0, 0], control=law)


@pytest.mark.parametrize("compiled", [True, False])
def test_the_delay_of_a_loop_counts(compiled: bool) -> None:
    """A damper a period late, z^2 - z + k = 0, is stable below 1; half a period late, k (1 - d) + k d / z ... : the
    limit is that of (z - 1) z + k (z / 2 + 1 / 2) = 0, 2."""
    t, v0 = np.linspace(0, 3, 51), [0.1]
    for delay, limit in ((0.01, 1.0), (0.005, 2.0), (0.02, 0.618)):
        fa.simulate(rigid(), t, v0=v0, control=damper(0.97 * limit, delay=delay, compiled=compiled))
        with warns(fa.errors.LoopWarning, f"delay of {delay:g} s", "unstable"):
            fa.simulate(rigid(), t, v0=v0, control=damper(1.06 * limit, delay=delay, compiled=compiled))


def test_a_loop_with_a_reference_that_steps_is_named() -> None:
    kd = 2.3 * INERTIA / 0.01
    law = fa.Sampled(lambda t, y: 5.0 * ((t > 0.1) - y[0]) - kd * y[1], 100, [("joint", 0), ("rate", 0)])
    with warns(fa.errors.LoopWarning, "z = -1.3"):
        fa.simulate(rigid(), np.linspace(0, 1, 101), control=law)


def test_two_loops_that_are_stable_alone_are_named_together() -> None:
    t = np.linspace(0, 2, 101)
    told = ("control[0]", "control[1]")
    with warns(fa.errors.LoopWarning, told):
        fa.simulate(rigid(), t, v0=[0.1], control=[damper(1.2), damper(0.95)])


def test_a_limit_cycle_and_a_fall_are_no_fault_of_the_loop() -> None:
    t = np.linspace(0, 2, 101)
    fa.simulate(rigid(), t, v0=[0.1], control=damper(2.5, limit=1.0))
    falling = fa.Arm(rigid().links, (0, -9.81, 0))
    fa.simulate(falling, t, [np.pi / 2 - 1e-3], control=fa.PD(0.5, 0.01, reference=np.pi / 2))


class Pid:
    """In Python, with its own memory, asked every 0.01 s."""

    def __init__(self, kp: float, ki: float, kd: float) -> None:
        self.gains, self.sum, self.last = (kp, ki, kd), 0.0, 0.3

    def __call__(self, t: float, y: np.ndarray) -> float:
        e = 0.3 - float(y[0])
        self.sum += 0.01 * e
        rate, self.last = (e - self.last) / 0.01, e
        return float(np.dot(self.gains, (e, self.sum, rate)))


@pytest.mark.parametrize("integrator", EVERY)
def test_python_laws_with_memory_are_named(integrator: str) -> None:
    """An integral that is too strong; and differences with k = kd h / I = 2.2: (z - 1)^2 z + k/2 (z + 1) (z - 1) = 0,
    so that |z|^2 = k/2."""
    t, I = np.linspace(0, 2, 41), INERTIA
    fa.simulate(rigid(), t, control=fa.Sampled(Pid(20 * I, 10 * I, 5 * I), 100, [("joint", 0)]), **steps(integrator))
    with warns(fa.errors.LoopWarning, "sampled", "0.01 s", "z = 1.01 +- 0.0694i"):
        fa.simulate(
            rigid(), t, control=fa.Sampled(Pid(20 * I, 400 * I, 5 * I), 100, [("joint", 0)]), **steps(integrator)
        )
    late = fa.Sampled(Pid(0.0, 0.0, 2.2 * I / 0.01), 100, [("joint", 0)])
    with pytest.warns(fa.errors.LoopWarning) as w:
        fa.simulate(rigid(), t, v0=[0.1], control=late, **steps(integrator))
    assert w[0].message.finding.value == pytest.approx(0.5 * np.log(1.1) / 0.01, rel=1e-4)


@pytest.mark.parametrize("compiled", [True, False])
def test_laws_that_read_sensors_are_named(compiled: bool) -> None:
    """As one that reads the rate; a sensor's delay counts as the law's own; its noise and its steps do not matter."""
    t = np.linspace(0, 1, 51)

    def law(share: float, sensor: fa.sensors.Sensor) -> fa.Controller:
        kd = share * INERTIA / 0.01
        if not compiled:
            return fa.Sampled(lambda t, y: -kd * y[0], 100, [sensor])
        return fa.LinearController(
            np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), [[kd]], rate=100, measure=[sensor]
        )

    noisy, late = fa.sensors.Tachometer(0, noise=1e-4, resolution=1e-5), fa.sensors.Tachometer(0, delay=0.01)
    fa.simulate(rigid(), t, v0=[0.1], control=law(1.8, noisy))
    fa.simulate(rigid(), t, v0=[0.1], control=law(0.9, late))
    with warns(fa.errors.LoopWarning, "0.01 s", "z = -1.1"):
        fa.simulate(rigid(), t, v0=[0.1], control=law(2.1, noisy))
    with warns(fa.errors.LoopWarning, "0.01 s", "delay", "unstable"):
        fa.simulate(rigid(), t, v0=[0.1], control=law(1.1, late))


def test_what_is_called_stable_is_stable_for_the_whole_run() -> None:
    """A run that fails at once leaves no time to grow in: a ninth of these gains still grows at 300 1/s."""
    law = fa.StateFeedback([[-1.0, 0, 0, 0, -0.5, 0, 0, 0]])
    with refuses("other sign", "stable", error=fa.SimulationError) as e:
        fa.simulate(paper_link(), np.linspace(0, 3, 31), v0=[0.1, 0, 0, 0], control=law, **steps("implicit"))
    assert e.value.time < 0.1


def test_a_run_with_control_that_fails_before_its_law_is_known_points_at_the_loop() -> None:
    law = fa.Sampled(lambda t, y: 1e4 * np.sign(y[0]), 100, [("joint", 0)])
    with refuses("loop of control", "stable", error=fa.SimulationError):
        fa.simulate(paper_link(), np.linspace(0, 3, 31), v0=[0.1, 0, 0, 0], control=law, **steps("implicit"))


def test_batches_name_a_loop_that_grows_without_failing() -> None:
    """In lanes as by `simulate`: they were silent but for scenarios that failed."""
    t, law, v0 = np.linspace(0, 2, 51), fa.PD(5.0, -1.0, reference=0.1), [[0.1], [0.2]]
    said = ("scenario 0", "control[0]", "PD", "'link 0 revolute'", "1.43", "3.5i 1/s", "energy")
    with warns(fa.errors.LoopWarning, said):
        r = fa.simulate_batch(rigid(), t, v0=v0, control=law, integrator="implicit", step=1e-3)
    assert r.stats["lanes"] > 0 and not r.failures
    with warns(fa.errors.LoopWarning, said):
        fa.rollout(rigid(), [0.0], v0, step=1e-3, nstep=2000, control=law)
    fa.rollout(rigid(), [0.0], v0, step=1e-3, nstep=2000, control=fa.PD(5.0, 1.0, reference=0.1))
    fa.rollout(rigid(), [0.0], v0, tau=np.full((2000, 1), 0.3), step=1e-3)


@pytest.mark.parametrize("integrator", ["ida", "implicit"])
def test_strain_feedback_with_the_wrong_sign_is_named(integrator: str) -> None:
    """The tip was 1.3 km away, and status 0."""
    law = fa.StrainFeedback(2.0, 0.05, 2.0, x=0.0, reference=0.3)
    with refuses("'link 0 revolute'", "1", "energy", "bent", error=fa.SimulationError):
        fa.simulate(paper_link(1), np.linspace(0, 20, 201), control=law, **steps(integrator))


def test_sampled_strain_feedback_is_named_above_its_known_limit() -> None:
    """At 100 Hz the demo's loop is lost beyond Ks = -0.01332, docs/strain-feedback.md; without dry friction."""
    scene, t = fa.load("ist_control"), np.linspace(0, 8, 401)
    link, pd = scene.arm.links[0], scene.control[0]
    free = fa.Arm([replace(link, joint=replace(link.joint, coulomb=0.0))])
    measured = [("joint", 0), ("rate", 0), ("strain", 0, 0.0, "K3")]

    def run(ks: float) -> fa.Result:
        law = fa.Sampled(lambda _, y: -(np.array([pd.kp, pd.kv, ks]) @ y), 100, measured, motor=pd.motor)
        return fa.simulate(free, t, [0.0, 1e-4, 1e-5, 0.0], control=law, integrator="gauss", step=5e-3)

    run(0.95 * -0.01332)
    with warns(fa.errors.LoopWarning, "0.01 s", "0.6", "sampled", "unstable"):
        run(1.5 * -0.01332)


def test_batches_name_the_loop_of_a_scenario_that_fails() -> None:
    arm, ks = paper_link(), np.array([0.01, 1.0])

    def law(k: float) -> fa.StrainFeedback:
        return fa.StrainFeedback(2.0, 0.05, k, x=0.0, reference=0.1)

    t = np.linspace(0, 3, 4)
    told = ("scenario 1", "StrainFeedback", "link 0", "energy")
    with warns(fa.errors.LoopWarning, told):
        runs = fa.simulate_batch(arm, t, control=law(1.0), parameters={"control.0.ks": ks}, step=1e-3)
    rolled = fa.rollout(arm, arm.zero, step=1e-3, nstep=3000, control=[[law(k)] for k in ks])
    for failures in (runs.failures, rolled.failures):
        assert [f.index for f in failures] == [1]
        assert "of 'link 0 revolute' feeds energy in" in failures[0].reason and "bent by" in failures[0].reason


def test_a_position_loop_with_the_wrong_sign() -> None:
    with warns(fa.errors.LoopWarning, "5 1/s", "sign", "stable"):
        fa.simulate(rigid(), np.linspace(0, 2, 21), [1e-3], control=fa.PD(-25 * INERTIA, 0.0))


# -- crawling ----------------------------------------------------------------------------------------------------------


def sheared() -> fa.Arm:
    modes = {"bending_y": 2, "bending_z": 2, "torsion": 1, "shear_y": 1, "shear_z": 1}
    beam = fa.Beam(0.5, fa.Rectangle(0.004, 0.01), STEEL, modes, "legendre")
    hub = fa.RigidBody(1.0, inertia=(1e-3, 1e-3, 1e-3), end=(0.075, 0, 0))
    return fa.Arm([fa.Link(fa.Revolute("z"), hub, beam, fa.RigidBody(0.2, inertia=(1e-4, 1e-4, 1e-4)))], (0, 0, -9.81))


def test_a_run_of_ida_is_told_which_modes_hold_its_steps_down() -> None:
    """Shear at 9e4 rad/s, struck by a torque that sets in: 5e5 steps for a second; "implicit" takes 5000."""
    arm, drive = sheared(), {0: fa.Torque(0.5)}
    run = fa.simulate(arm, [0.0, 0.03], drive=drive, integrator="ida")
    (found,) = [x for x in run.check() if x.unit == "steps"]
    assert found.value == run.stats["steps"] > 1e4
    assert re.search(r"9e\+04 rad/s \(link 0 shear_. 1\).*integrator = \"implicit\", step = 0.0002 ", str(found))
    assert fa.simulate(arm, [0.0, 1.0], drive=drive, integrator="implicit", step=2e-4).stats["steps"] == 5000
    assert not [x for x in fa.simulate(arm, [0.0, 0.01], rtol=1e-4).check() if x.unit == "steps"]


# -- pulses ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("integrator", EVERY)
def test_a_pulse_between_steps_is_told(integrator: str) -> None:
    """A torque of 5 N m for 2 ms, between two output times and two steps."""
    options = steps(integrator) | ({"step": 0.05 if integrator == "gauss" else 8e-3} if integrator in FIXED else {})
    pulse = fa.Torque(lambda t: 5.0 if 0.5005 < t < 0.5025 else 0.0)
    with warns(fa.errors.StepWarning, "'link 0 revolute'", "t = 0.50", "drive", "samples") as w:
        r = fa.simulate(rigid(), np.linspace(0, 1.6, 5), drive={0: pulse}, **options)
    assert not r.v.any() and w[0].message.finding.value == 5.0 and w[0].filename == __file__
    assert str(pickle.loads(pickle.dumps(w[0].message))) == str(w[0].message)


def test_pulses_of_loads_and_references_are_told() -> None:
    t = np.linspace(0, 1, 3)
    push = fa.Load(0, force=lambda t: (0.0, 5.0 if 0.7 < t < 0.71 else 0.0, 0.0))
    with warns(fa.errors.StepWarning, "loads[0]", "5", "t = 0.70"):
        fa.simulate(rigid(), t, loads=[push])
    with warns(fa.errors.StepWarning, "reference of control", "1", "t = 0.70"):
        fa.simulate(rigid(), t, control=fa.PD(1.0, 1.0, reference=lambda t: 1.0 if 0.7 < t < 0.71 else 0.0))


@pytest.mark.parametrize("integrator", EVERY)
def test_what_the_steps_have_seen_is_not_told(integrator: str) -> None:
    t = np.linspace(0, 1, 11)
    for law in (
        lambda t: 0.0 if t < 0.5 else 1.0, lambda t: np.sin(60 * t), lambda t: np.exp(-((t - 0.5) ** 2) / 1e-3),
        lambda t: 5.0 if 0.4 < t < 0.7 else 0.0, lambda t: 3.0,
    ):  # fmt: skip
        fa.simulate(rigid(), t, drive={0: fa.Torque(law)}, **steps(integrator))
    fa.simulate(paper_link(), t, drive={0: fa.Motion.spin_up(5.0, 0.4)}, **steps(integrator))


@pytest.mark.parametrize("integrator", ["implicit", "rk4"])
def test_batches_tell_of_pulses_between_half_steps(integrator: str) -> None:
    t = np.linspace(0, 1, 11)

    def run(law) -> None:
        fa.simulate_batch(rigid(), t, np.zeros((2, 1)), drive={0: fa.Torque(law)}, integrator=integrator, step=0.02)

    with warns(fa.errors.StepWarning, "t = 0.50", "drive"):
        run(lambda t: 5.0 if 0.501 < t < 0.509 else 0.0)
    run(lambda t: np.sin(20 * t))
    run(lambda t: 5.0 if 0.45 < t < 0.7 else 0.0)


def test_a_long_vibration_is_told_how_long_it_will_take() -> None:
    """The text had been: look for what changes so fast."""

    class Enough(Exception):
        pass

    def stop(now: float) -> None:
        if now > 20.0:
            raise Enough

    said = ("1e+04 s", "vibration", "368 rad/s", '"gauss"')
    with warns(fa.errors.SlowWarning, said), pytest.raises(Enough):
        fa.simulate(paper_link(), np.linspace(0, 1e4, 11), [0, 1e-3, 0, 0], progress=stop, integrator="ida")


def test_what_is_told_during_a_run_is_told_once_and_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """A SlowWarning was not listed by check(); a LoopWarning came twice."""
    steps_of = sys.modules["flexarm.run.steps"]
    monkeypatch.setattr(steps_of, "_STEPS_OF_LOOPS", 10)
    monkeypatch.setattr(steps_of, "_TOO_MANY_STEPS", 10)
    with pytest.warns(fa.errors.SlowWarning) as told:
        run = fa.simulate(sheared(), [0.0, 0.03], drive={0: fa.Torque(0.5)}, integrator="ida")
    assert len(told) == 1 and told[0].message.finding in run.check()
    monkeypatch.setattr(steps_of, "_TOO_MANY_STEPS", 1e12)
    control = fa.PD(-25 * INERTIA, 0.0)
    with pytest.warns(fa.errors.LoopWarning) as told:
        run = fa.simulate(rigid(), np.linspace(0, 2, 21), [1e-3], control=control, rtol=1e-7, max_order=1)
    assert len(told) == 1 and told[0].message.finding in run.check()


def test_a_run_away_asks_whether_angles_are_in_degrees() -> None:
    """Of a command or a start above one turn; not of a spin, nor below."""

    def message(t: float = 0.2, start: float = 0.0, **given: object) -> str:
        with pytest.raises(fa.SimulationError) as e:
            fa.simulate(paper_link(1), np.linspace(0, t, 51), {0: start}, **given, integrator="implicit", step=1e-3)
        return str(e.value)

    def turn(angle: float) -> fa.Motion:
        return fa.Motion([0, 0.2], [0, angle], [0, 0], [0, 0])

    law = fa.PD(50.0, 1.0, 0, reference=90.0)
    asks = r"'link 0 revolute' is commanded to 90 rad: was that meant in degrees\? Angles are in radians$"
    assert re.search(asks, message(drive={0: turn(90.0)}))
    assert re.search(asks, message(control=law))
    assert "'link 0 revolute' starts at -45 rad: was that meant in degrees?" in message(start=-45.0, control=law)
    spin = {0: fa.Motion.spin_up(25.0, 1.0)}  # above the critical speed of order 1
    assert "degrees" not in message(4.0, drive=spin)


@pytest.mark.parametrize("integrator", EVERY)
def test_a_run_that_fails_before_its_first_row_is_an_error_of_its_own(integrator: str) -> None:
    """Of a beam of order 1, whose speed of turning was asked for in the last row."""
    with refuses("t = 0", error=fa.SimulationError) as e:
        fa.simulate(paper_link(1), [0, 0.1], v0=[1e200, 0, 0, 0], **steps(integrator))
    assert len(e.value.result.t) == 0
