"""Dry friction with stiction, and the rotor's reflected inertia."""

from __future__ import annotations

import warnings
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from arms import paper_link
from messages import refuses, warns

INTEGRATORS = (
    {"rtol": 1e-9, "atol": 1e-12},
    {"integrator": "implicit", "step": 5e-4},
    {"integrator": "gauss", "step": 0.02},
    {"integrator": "rk4", "step": 2e-3},
)
names = pytest.mark.parametrize("options", INTEGRATORS, ids=lambda o: o.get("integrator", "ida"))


def block(stiffness: float = 0.0, coulomb: float = 2.0, stiction: float | None = 3.0, mass: float = 1.0) -> fa.Arm:
    """A block of 1 kg on a rough line, on a spring."""
    joint = fa.Prismatic("x", stiffness=stiffness, coulomb=coulomb, stiction=stiction)
    return fa.Arm([fa.Link(joint, fa.RigidBody(mass))])


@names
def test_spring_pulls_a_block_to_rest(options: dict) -> None:
    """Half a cycle about k x = -/+ F_c each: turning points fall by 2 F_c/k, until the spring pulls less than the
    stiction; then it is exactly still (den Hartog, Mechanical Vibrations, 1934)."""
    t = np.linspace(0, 3, 301)
    r = fa.simulate(block(100.0), t, [0.25], **options)
    half = np.pi / 10
    tight = options.get("integrator") in (None, "rk4")
    for k, x in enumerate((-0.21, 0.17, -0.13, 0.09, -0.05, 0.01), start=1):
        turn = fa.simulate(block(100.0), [0, k * half], [0.25], **options)
        assert turn.q[-1, 0] == pytest.approx(x, abs=1e-6 if tight else 1e-5)
    still = t > 6 * half + 0.01
    assert np.all(r.v[still] == 0.0) and np.ptp(r.q[still]) == 0.0 and np.all(r.a[still] == 0.0)
    np.testing.assert_allclose(r.friction[still], 100 * r.q[still], rtol=1e-12)
    assert r.stats["switches"] == 6
    first = (t > 0) & (t < half - 0.01)
    assert np.all(r.friction[first] == 2.0) and np.all(r.tau == 0.0)


@names
def test_torn_loose_by_a_growing_force(options: dict) -> None:
    """Force t (N) on 1 kg: still until it is the stiction, at 3 s, then a = t - 2: exact cubic."""
    t = np.linspace(0, 5, 51)
    r = fa.simulate(block(), t, drive={0: fa.Torque([0, 5], [0, 5])}, **options)
    held, s = t < 3.0, t[t > 3.0] - 3
    assert np.all(r.q[held] == 0.0) and np.all(r.v[held] == 0.0)
    np.testing.assert_allclose(r.friction[held, 0], -t[held], atol=1e-12)
    np.testing.assert_allclose(r.tau[:, 0], t, atol=1e-12)
    np.testing.assert_allclose(r.q[t > 3.0, 0], s**2 / 2 + s**3 / 6, atol=1e-5)
    np.testing.assert_allclose(r.a[t > 3.0, 0], 1 + s, atol=1e-5)


@names
def test_through_zero_without_stopping(options: dict) -> None:
    """A constant force of 10 N against a speed of -1: it stops, turns at once, and friction turns with it."""
    arm = block(coulomb=2.0, stiction=None)
    r = fa.simulate(arm, [0, 1 / 12, 1.0], v0=[-1.0], tau=[10.0], **options)
    rest = 1 - 1 / 12
    np.testing.assert_allclose(r.q[:, 0], [0, -1 / 24, -1 / 24 + 4 * rest**2], atol=1e-6)
    np.testing.assert_allclose(r.friction[[0, 2], 0], [2.0, -2.0])
    assert r.stats["switches"] == 1


@names
def test_smaller_torque_holds_a_flexible_arm_exactly_still_while_it_rings(options: dict) -> None:
    """The paper's arm, struck at its tip: the clamping moment stays below the stiction. The joint does not move by one
    bit, the link rings at its clamped frequency (Sec. 5.3), and the friction is the moment at the joint."""
    joint = fa.Revolute("z", coulomb=1.0)
    arm = fa.Arm([fa.Link(joint, fa.RigidBody(0.1, end=(0.075, 0, 0)), paper_link().links[0].beam)])
    clamped = fa.Arm([fa.Link(fa.Fixed(), fa.RigidBody(0.1, end=(0.075, 0, 0)), paper_link().links[0].beam)])
    t, v0 = np.linspace(0, 0.6, 301), np.array([0.0, 0.1, 0.0, 0.0])
    r, other = fa.simulate(arm, t, v0=v0, **options), fa.simulate(clamped, t, v0=v0[1:], **options)
    assert np.all(r.q[:, 0] == 0.0) and np.all(r.v[:, 0] == 0.0) and r.stats["switches"] == 0
    np.testing.assert_allclose(r.q[:, 1:], other.q, atol=1e-7)
    moment = other.joint_reaction(0)[:, 5]
    np.testing.assert_allclose(r.friction[:, 0], moment, atol=2e-3 * np.abs(moment).max())


def test_energy_is_lost_to_friction_alone() -> None:
    """Work of friction = loss of energy, over stick and slip of two joints at once."""
    rod = fa.RigidBody(1.0, com=(0.3, 0, 0), inertia=(0, 0.03, 0.03), end=(0.6, 0, 0))
    links = [fa.Link(fa.Revolute("z", coulomb=c, stiction=s), rod) for c, s in ((0.6, 0.9), (0.3, None))]
    arm = fa.Arm(links, gravity=(0, -9.81, 0))
    t = np.linspace(0, 16, 16001)
    r = fa.simulate(arm, t, integrator="gauss", step=0.02)
    energy = np.sum(r.energy(), axis=0)
    work = np.sum(r.friction * r.v, axis=1)
    lost = np.concatenate([[0], np.cumsum((work[1:] + work[:-1]) / 2 * np.diff(t))])
    assert r.stats["switches"] > 8
    np.testing.assert_allclose(energy - energy[0], lost, atol=5e-4)
    ida = fa.simulate(arm, t, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(r.q, ida.q, atol=1e-6)
    assert np.all(r.v[-1] == 0.0) and np.all(np.abs(r.friction[-1]) <= [0.9, 0.3])


def strip(shapes: int, damping_ratio: float = 0.05) -> fa.Arm:
    """A strip of aluminium, 0.7 m, on a joint with stiction; its shear shape has 1 kHz."""
    modes = {"bending_z": shapes, "shear_y": 1}
    beam = fa.Beam(0.7, fa.Rectangle(0.002, 0.03), fa.Material(2700.0, 70e9, 0.33), modes, order=2,
                   damping_ratio=damping_ratio)  # fmt: skip
    hub = fa.RigidBody(0.2, inertia=(1e-3,) * 3)
    return fa.Arm([fa.Link(fa.Revolute("z", coulomb=0.12, stiction=0.16), hub, beam)])


def pulses(count: int) -> fa.Torque:
    """Torques that move the joint, which then sticks."""
    t, torque = [0.0], [0.0]
    for k in range(count):
        begin, peak = 0.02 + 0.3 * k, 0.4 if k % 3 else -0.48
        t += [begin, begin + 0.005, begin + 0.055, begin + 0.06]
        torque += [0.0, peak, peak, 0.0]
    return fa.Torque([*t, 0.3 * count + 0.05], [*torque, 0.0])


def test_stiff_shapes_do_not_make_a_joint_chatter() -> None:
    """Gauss points neither resolve nor damp modes that a switch strikes: they made 311 switches of 10, and 7 %."""
    t = np.linspace(0, 1.55, 32)
    ida = fa.simulate(strip(3), t, drive={0: pulses(5)}, rtol=1e-8, atol=1e-10)
    assert ida.stats["switches"] == 10
    for shapes, step in ((3, 0.01), (3, 0.004), (3, 0.001), (10, 0.01), (16, 0.01)):
        r = fa.simulate(strip(shapes), t, drive={0: pulses(5)}, integrator="gauss", step=step)
        assert r.stats["switches"] == 10
        np.testing.assert_allclose(r.q[:, 0], ida.q[:, 0], atol=1e-6 * np.ptp(ida.q[:, 0]))


@pytest.mark.parametrize("damping_ratio", [0.0, 1e-3])
def test_ringing_that_the_steps_damp_and_the_arm_does_not_is_told(damping_ratio: float) -> None:
    """The joint chatters, 30 switches of which gauss makes 10, alike at all steps that do not follow 25000 rad/s: the
    angle ends 0.2 % of the way off without a change from 10 ms to 1 ms. Steps that follow it have the numbers."""
    arm, t, drive = strip(3, damping_ratio), np.linspace(0, 0.35, 8), {0: pulses(1)}
    ida = fa.simulate(arm, t, drive=drive, rtol=1e-9, atol=1e-11)
    for step in (0.01, 0.001):
        with warns(fa.errors.StepWarning, "link 0", "2.51e+04 rad/s", "4e-05 s"):
            r = fa.simulate(arm, t, drive=drive, integrator="gauss", step=step)
        assert r.stats["switches"] < ida.stats["switches"]
        with warns(fa.errors.StepWarning, "scenario 0", "2.51e+04 rad/s"):
            masses = {"link.0.hub.mass": [0.2, 0.3]}
            fa.simulate_batch(arm, t, parameters=masses, drive=drive, integrator=fa.Gauss(step))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fine = fa.simulate(arm, t, drive=drive, integrator="gauss", step=3.9e-5)
        fa.simulate(arm, t, drive={0: fa.Torque(0.01)}, integrator="gauss", step=0.01)  # sticks
    rod = fa.Beam(0.66, fa.Rectangle(0.0035, 0.03), fa.Material(2700, 70e9, 0.33), {"bending_y": 2, "shear_y": 1})
    light = fa.Revolute("z", coulomb=0.166, stiction=0.266)  # it bends: 70 switches of 540, and 24 % off at the end
    bent = fa.Arm([fa.Link(light, fa.RigidBody(0.2, inertia=(2.4e-4,) * 3), rod, fa.RigidBody(0.1))])
    with warns(fa.errors.StepWarning, "link 0", "rad/s"):
        fa.simulate(bent, [0, 0.5], drive={0: fa.Torque(lambda s: 0.5 * np.sin(10 * s))}, integrator="gauss", step=1e-3)
    assert fine.stats["switches"] == ida.stats["switches"]
    np.testing.assert_allclose(fine.q[:, 0], ida.q[:, 0], atol=3e-5 * np.ptp(ida.q[:, 0]))


@pytest.mark.parametrize("step", [5e-4, 3e-4])
def test_switches_within_a_few_steps_are_told(step: float) -> None:
    """A controller of 4243 rad/s: at rest soon, but in smaller steps it swings on for more than 1 s."""
    control = fa.PD(1.8e7, 0.0, link=0)
    with warns(fa.errors.StepWarning, "friction", "steps", "smaller step"):
        fa.simulate(block(), [0, 1], [0.1], control=control, integrator="rk4", step=step)


@pytest.mark.parametrize("damping_ratio", [0.0, 0.05])
def test_rk4_tells_the_limit_of_joints_that_slide(damping_ratio: float) -> None:
    """The limit of the stuck joint is four times longer; with damping the joint ended at -1053 rad."""
    arm, given = strip(3, damping_ratio), {"drive": {0: pulses(1)}, "integrator": "rk4"}
    frequency = arm.modes().frequencies[-1]
    assert frequency > 3.9 * arm.modes(lock=[0]).frequencies[-1]
    with warns(fa.errors.StepWarning, f"{frequency:.3g} rad/s", "link 0 shear_y 1"):
        fa.simulate(arm, [0, 0.2], step=1.5e-4, **given)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fa.simulate(arm, [0, 0.2], step=1.1e-4, **given)


def test_stick_slip_on_a_belt() -> None:
    """A block drawn by a spring whose other end moves at V: it sticks until k V t = F_s, then slips; the longest
    spring is F_s/k, the period 2 (F_s - F_c)/(k V) + 2 (pi - atan((F_s - F_c)/(V sqrt(k m))))/sqrt(k/m)."""
    k, speed, fc, fs = 50.0, 0.05, 1.0, 2.0
    arm = block(k, fc, fs)
    t = np.linspace(0, 6, 6001)
    drive = {0: fa.Torque(t, k * speed * t)}
    jump = lambda t, q, v: v[0] - 1e-6  # noqa: E731
    jump.direction = 1
    r = fa.simulate(arm, t, drive=drive, integrator="gauss", step=0.02, events=jump)
    w, d = np.sqrt(k), fs - fc
    period = 2 * d / (k * speed) + 2 * (np.pi - np.arctan(d / (speed * w))) / w
    np.testing.assert_allclose(np.diff(r.t_events[0])[1:], period, rtol=1e-5)
    assert r.t_events[0][0] == pytest.approx(fs / (k * speed), rel=1e-3)


def test_prescribed_joint_tells_what_the_drive_must_overcome() -> None:
    arm = block(0.0)
    r = fa.simulate(arm, [0, 0.5, 1.0], drive={0: fa.Motion(lambda t: (t**2, 2 * t, 2.0))}, rtol=1e-8)
    np.testing.assert_allclose(r.tau[1:, 0], 2.0 + 2.0)
    np.testing.assert_allclose(r.friction[1:, 0], -2.0)
    assert r.friction[0, 0] == 0.0


def test_events_and_files_beside_friction(tmp_path) -> None:
    """A user's terminal event counts over the switches, and the file keeps the friction."""
    passes = lambda t, q, v: q[0]  # noqa: E731
    passes.terminal = 3
    r = fa.simulate(block(100.0), np.linspace(0, 3, 301), [0.25], events=passes, rtol=1e-9)
    assert len(r.t_events[0]) == 3 and r.status == 1
    back = fa.Result.load(r.save(tmp_path / "r.npz") or tmp_path / "r.npz")
    np.testing.assert_array_equal(back.friction, r.friction)
    assert back.arm.to_dict() == r.arm.to_dict()
    frictionless = fa.simulate(block(100.0, 0.0, None), [0, 1], [0.25])
    assert frictionless.friction is None and "switches" not in frictionless.stats


def test_reflected_inertia_is_inertia_at_the_joint_alone() -> None:
    """A rotor of J at gear ratio n is n² J on the diagonal of M: all algorithms agree, the energy counts it, and a
    sprung joint's frequency follows."""
    geared = fa.Revolute("z", stiffness=3.0, reflected_inertia=0.05)
    rod = fa.RigidBody(0.2, com=(0.1, 0, 0), inertia=(0, 1e-3, 1e-3), end=(0.2, 0, 0))
    beam = paper_link().links[0].beam
    arm, plain = (
        fa.Arm([fa.Link(j, rod, beam), fa.Link(j, rod, beam)]) for j in (geared, fa.Revolute("z", stiffness=3.0))
    )
    rng = np.random.default_rng(1)
    q, v, tau = rng.normal(size=(3, arm.nv)) * 0.05
    expected = plain.mass_matrix(q) + np.diag([0.05 if "revolute" in c else 0.0 for c in arm.coordinates])
    np.testing.assert_allclose(arm.mass_matrix(q), expected, atol=1e-15)
    a = np.linalg.solve(expected, tau - plain.bias(q, v))
    for method in ("ab", "ci"):
        np.testing.assert_allclose(arm.forward_dynamics(q, v, tau, method=method), a, rtol=1e-9)
    np.testing.assert_allclose(arm.inverse_dynamics(q, v, a), tau, atol=1e-9 * np.abs(a).max())
    assert arm.energy(q, v)[0] == pytest.approx(0.5 * v @ expected @ v)
    rotor = fa.Arm([fa.Link(geared, fa.RigidBody(0.0))])
    np.testing.assert_allclose(rotor.modes().frequencies, np.sqrt(3.0 / 0.05))
    q0 = np.array([0.02 if "revolute" in c else 0.0 for c in arm.coordinates])
    r = fa.simulate(arm, np.linspace(0, 1, 101), q0, integrator="gauss", step=5e-3)
    np.testing.assert_allclose(np.sum(r.energy(), axis=0), np.sum(r.energy(), axis=0)[0], rtol=1e-9)
    for other in ({"integrator": "implicit", "step": 1e-4}, {"rtol": 1e-8, "atol": 1e-11}):
        again = fa.simulate(arm, np.linspace(0, 1, 101), q0, **other)
        np.testing.assert_allclose(again.q, r.q, atol=2e-4)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: fa.Revolute("z", coulomb=-1.0), "coulomb[0] = -1"),
        (lambda: fa.Revolute("z", coulomb=2.0, stiction=1.0), "stiction[0] = 1"),
        (lambda: fa.Revolute("z", stiction=np.inf), "stiction"),
        (lambda: fa.Revolute("z", reflected_inertia=-1e-3), "reflected_inertia[0]"),
        (lambda: fa.Spherical(coulomb=1.0), ("a ball", "friction")),
        (lambda: fa.Planar(coulomb=[1.0, 2.0]), "coulomb"),
    ],
)
def test_bad_friction(make, message: str) -> None:
    with refuses(message):
        make()


def test_friction_in_scene_files() -> None:
    arm = fa.Arm(
        [
            fa.Link(
                fa.Planar(coulomb=[1.0, 2.0, 0.5], stiction=[1.5, 2.0, 0.6]), fa.RigidBody(1, inertia=(0.1, 0.1, 0.1))
            )
        ]
    )
    again = fa.Arm.from_dict(arm.to_dict())
    assert again.to_dict() == arm.to_dict() and "stiction" in repr(again.links[0].joint)


def geared(**gear) -> fa.Arm:
    """A rotor of 0.05 kg m² at the joint, a gear, a load of 0.2 kg m²."""
    load = fa.RigidBody(1.0, inertia=(0.2, 0.2, 0.2))
    return fa.Arm([fa.Link(fa.Revolute("z", reflected_inertia=0.05)), fa.Link(fa.Revolute("z", **gear), load)])


def test_elastic_gear() -> None:
    """Rotor and load on a spring: one free turn, and sqrt(k (1/J1 + 1/J2))."""
    np.testing.assert_allclose(geared(stiffness=80.0).modes().frequencies, [0.0, np.sqrt(80 * (20 + 5))], atol=1e-6)


def test_backlash() -> None:
    """A gap of 0.1 rad: the rotor turns alone until it is closed, then both, with their angular momentum kept."""
    arm = geared(lower=-0.05, upper=0.05, limit_stiffness=1e4, limit_damping=3.0)
    t = np.linspace(0, 0.5, 501)
    r = fa.simulate(arm, t, [0.0, 0.05], [1.0, -1.0], integrator="implicit", step=2e-4)
    load = r.v.sum(axis=1)
    np.testing.assert_allclose(load[t < 0.095], 0.0, atol=1e-9)
    np.testing.assert_allclose(0.05 * r.v[:, 0] + 0.2 * load, 0.05, rtol=1e-7)
    assert r.q[:, 1].min() > -0.06 and load[-1] > 0.1


@names
def test_a_force_that_meets_the_stiction_exactly_and_grows(options: dict) -> None:
    """Held with all of the stiction at the start: it breaks loose at once; two equal joints, both."""
    slide = fa.Prismatic("x", coulomb=0.5, stiction=1.0)
    table = fa.Axes(["tx", "ty"], coulomb=0.5, stiction=1.0)
    ramp = fa.Torque([0, 2], [1.0, 3.0])
    t = np.linspace(0, 2, 21)
    one = fa.simulate(fa.Arm([fa.Link(slide, fa.RigidBody(1.0))]), t, drive={0: ramp}, **options)
    both = fa.simulate(fa.Arm([fa.Link(table, fa.RigidBody(1.0))]), t, drive={(0, 0): ramp, (0, 1): ramp}, **options)
    np.testing.assert_allclose(one.q[:, 0], t**2 / 4 + t**3 / 6, atol=1e-5)
    np.testing.assert_allclose(both.q, np.stack([one.q[:, 0]] * 2, axis=1), atol=1e-5)
    for r in (one, both):
        assert np.abs(r.friction).max() <= 1.0 + 1e-8


def test_what_sticks_and_what_slides_is_consistent_at_once() -> None:
    """Random chains at rest under constant torques. In the first row every joint that is held takes no more than its
    stiction, and every one that slides is opposed by its friction."""
    rng = np.random.default_rng(11)
    for _ in range(200):
        n = int(rng.integers(2, 5))
        coulomb = rng.uniform(0.2, 1.0, n)
        rod = [
            fa.RigidBody(m, com=(0.25, 0, 0), inertia=(0, 0.02, 0.02), end=(0.5, 0, 0)) for m in rng.uniform(0.2, 2, n)
        ]
        arm = fa.Arm([fa.Link(fa.Revolute("z", coulomb=c), b) for c, b in zip(coulomb, rod, strict=True)])
        q0, tau = rng.uniform(-2, 2, n), rng.uniform(-3, 3, n)
        r = fa.simulate(arm, [0, 1e-3], q0, tau=tau, integrator="gauss", step=1e-3)
        a, f = r.a[0], r.friction[0]
        assert np.all(np.abs(f) <= coulomb * (1 + 1e-8))
        slides = a != 0.0
        np.testing.assert_allclose(f[slides], -np.sign(a[slides]) * coulomb[slides])
        np.testing.assert_allclose(arm.inverse_dynamics(q0, 0 * q0, a), tau + f, atol=1e-10)


@names
def test_rows_obey_the_law_where_samples_make_forces_jump(options: dict) -> None:
    """Each row is a sample of a controller: what it has torn loose is torn loose in that row. Friction is at most the
    stiction, opposes sliding, and is consistent with the accelerations."""
    joint = fa.Revolute("z", coulomb=0.3, stiction=0.39)
    arm = fa.Arm([fa.Link(joint, fa.RigidBody(0.1, inertia=(0.01, 0.01, 0.01)), paper_link().links[0].beam)])
    t, force = np.linspace(0, 0.8, 41), np.random.default_rng(5).uniform(-1.0, 1.0, 41)
    force[10:14] = 0.0
    law = fa.Sampled(lambda now, y: force[min(round(now / 0.02), 40)], 50.0, [("joint", 0)], [0])
    r = fa.simulate(arm, t, control=law, **options)
    f, v, a = r.friction[:, 0], r.v[:, 0], r.a[:, 0]
    np.testing.assert_allclose(r.tau[:, 0], force, atol=1e-12)
    assert np.abs(f).max() <= 0.39 and r.stats["switches"] > 5 and 2 < np.sum(v == 0.0) < 39
    np.testing.assert_array_equal(f[v != 0.0], -0.3 * np.sign(v[v != 0.0]))
    leaves = (v == 0.0) & (a != 0.0)
    assert leaves.any()
    np.testing.assert_array_equal(f[leaves], -0.3 * np.sign(a[leaves]))
    np.testing.assert_allclose(arm.inverse_dynamics(r.q, r.v, r.a), r.tau + r.friction, atol=1e-8)


@names
def test_the_last_row_is_behind_a_sample_at_the_end_of_the_run(options: dict) -> None:
    """No step follows to see that what sticks is torn loose: the row had 0.8 N m held by a stiction of 0.5."""
    joint = fa.Revolute("z", coulomb=0.3, stiction=0.5)
    arm = fa.Arm([fa.Link(joint, fa.RigidBody(1.0, inertia=(0.1, 0.1, 0.1)))])
    law = fa.Sampled(lambda t, y: 0.4 if t < 0.1999 else 0.8, 20)
    r = fa.simulate(arm, np.linspace(0, 0.2, 5), control=law, **options)
    np.testing.assert_allclose(r.friction[:, 0], [-0.4, -0.4, -0.4, -0.4, -0.3])
    np.testing.assert_allclose(r.a[:, 0], [0, 0, 0, 0, 5], atol=1e-12)
    assert np.all(r.v == 0.0)


@pytest.mark.parametrize("step", [5e-4, 1e-3, 4e-3])
def test_running_away_with_friction(step: float) -> None:
    """rk4 beyond its stability: it says so, soon, and speaks of no events where none were given."""
    joint = fa.Revolute("z", coulomb=0.1, stiction=0.2)
    beam = fa.Beam(0.3, fa.Rectangle(0.005, 0.02), fa.Material(7850, 209e9, 0.3), {"bending_y": 4})
    link = fa.Link(joint, fa.RigidBody(0.3, inertia=(1e-3, 1e-3, 2e-3), end=(0.075, 0, 0)), beam)
    arm = fa.Arm([link, link])
    tau = np.zeros(arm.nv)
    tau[0] = 1.0
    with refuses("stopped at t =", "away", error=fa.SimulationError) as caught:
        fa.simulate(arm, np.linspace(0, 1, 11), tau=tau, integrator="rk4", step=step)
    assert caught.value.result.stats["steps"] < 2000


def test_all_that_sticks_breaks_loose_between_two_output_times() -> None:
    """A torque that is a function, and outputs seldom: IDA has nothing to integrate until the joint slides."""
    arm = fa.Arm([fa.Link(fa.Revolute("z", coulomb=0.2), fa.RigidBody(1.0, inertia=(0.1, 0.1, 0.1)))])
    drive = {0: fa.Torque(lambda t: 0.4 * np.sin(2 * np.pi * t))}
    ends = [fa.simulate(arm, np.linspace(0, 10, n), drive=drive, rtol=1e-8).q[-1, 0] for n in (11, 201)]
    assert ends[0] == pytest.approx(ends[1], abs=1e-5) and abs(ends[0]) > 0.01


@pytest.mark.parametrize("options", [{"integrator": "rk4", "step": 1e-4}, {}], ids=["rk4", "ida"])
def test_interrupted_while_it_sticks_and_slips(options: dict) -> None:
    arm = block(50.0, 1.0, 2.0)
    t = np.linspace(0, 20_000, 101)
    drive = {0: fa.Torque(t, 50 * 0.05 * t)}

    def stop(now: float) -> None:
        if now > 1.0:
            raise KeyboardInterrupt

    with pytest.raises(fa.errors.SimulationInterrupted) as caught:
        fa.simulate(arm, t, drive=drive, progress=stop, **options)
    assert caught.value.time < 15_000


@pytest.mark.parametrize(("integrator", "step", "order"), [("gauss", 0.05, 7), ("rk4", 0.01, 4)])
def test_steps_keep_their_order_through_switches(integrator: str, step: float, order: int) -> None:
    """Two links that swing, stick and are torn loose again, to the digits of IDA and far finer steps."""
    first = fa.RigidBody(1.0, com=(0.3, 0, 0), inertia=(0.01, 0.05, 0.05), end=(0.6, 0, 0))
    second = fa.RigidBody(0.6, com=(0.2, 0, 0), inertia=(0.01, 0.02, 0.02))
    joints = fa.Revolute("z", coulomb=0.2, stiction=0.3), fa.Revolute("z", coulomb=0.05)
    arm = fa.Arm(list(map(fa.Link, joints, (first, second))), gravity=(0, -9.81, 0))

    def end(**options: Any) -> np.ndarray:
        r = fa.simulate(arm, [0, 2.0], [0.6, 0.4], **options)
        assert r.stats["switches"] == 6
        return r.q[-1]

    truth = end(integrator=fa.Gauss(2e-3, rtol=1e-13))
    np.testing.assert_allclose(truth, end(rtol=1e-11, atol=1e-13), atol=2e-7)
    error = [np.abs(end(integrator=integrator, step=h) - truth).max() for h in (step, step / 2)]
    assert np.log2(error[0] / error[1]) > order - 0.2 and error[1] < 1e-5
