"""Cylinders, struts with a mass: moved by lengths, forces and controllers, beside closed forms, Lagrange's equations of
the arm without them (oracle.py), and the same arm with lines without mass and the rods' masses on it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from arms import STEEL
from messages import refuses
from oracle import Oracle
from scipy.integrate import solve_ivp

T = np.linspace(0.0, 0.4, 21)
FOOT, LIFTED = np.array([0.5, -0.8]), np.array([1.2, 0.1])  # of the lift: on the world, and on the boom
HELD, FOLDED = np.array([2.0, 0.25]), np.array([0.35, 0.3])  # of the fold: on the boom, and on the jib
MASSES = 4.0, 2.5  # kg, of the rods
START = {"boom": 0.2, "jib": -0.9}
STEPS: list[dict[str, Any]] = [
    {}, {"integrator": "gauss", "step": 2e-3}, {"integrator": "implicit", "step": 1e-4},
    {"integrator": "rk4", "step": 2e-4}, {"integrator": "ida", "rtol": 1e-9, "atol": 1e-11},
]  # fmt: skip
NAMES = ["default", "gauss", "implicit", "rk4", "ida"]
RUNS = list(zip(NAMES, STEPS, strict=True))
NEAR = dict(zip(NAMES, (3e-7, 1e-9, 1e-6, 1e-9, 1e-7), strict=True))  # rad


def body(mass: float, length: float, point: float = 0.0, at: Any = (0, 0)) -> fa.RigidBody:
    """A rod of this mass from its joint on, with a point mass on it."""
    masses, places = np.array([mass, point]), np.array([[length / 2, 0, 0], [*at, 0]])
    com = masses @ places / masses.sum()
    inertia = np.diag([0.02, mass * length**2 / 12, mass * length**2 / 12])
    for m, p in zip(masses, places - com, strict=True):
        inertia += m * (p @ p * np.eye(3) - np.outer(p, p))
    return fa.RigidBody(masses.sum(), tuple(com), inertia, (length, 0, 0))


def crane(points: bool = False, law: Any = None) -> fa.Arm:
    """A boom on the lift, a jib on the fold. With `points` they are lines, and the rods' masses are on the arm."""
    heavy = MASSES if points else (0.0, 0.0)
    links = [
        fa.Link(fa.Revolute("z"), body(60.0, 3.0, heavy[0], LIFTED), name="boom"),
        fa.Link(fa.Revolute("z", damping=3.0), body(25.0, 1.5, heavy[1], FOLDED), name="jib"),
    ]
    places = ((*FOOT, 0), fa.Point("boom", "origin", (*LIFTED, 0))), (
        fa.Point("boom", "origin", (*HELD, 0)), fa.Point("jib", "origin", (*FOLDED, 0)))  # fmt: skip
    more: Any = law or ({"stiffness": 2e3, "damping": 40.0, "length": 1.2}, {"force": 150.0})
    struts = [fa.Strut(a, b, **x, name=name, mass=None if points else m)
              for (a, b), x, name, m in zip(places, more, ("lift", "fold"), MASSES, strict=True)]  # fmt: skip
    return fa.Arm(links, (0, -9.81, 0), struts)


def moved(names: tuple[str, str] = ("lift", "fold")) -> dict[str, fa.Motion]:
    """Smooth lengths of both."""
    arm = crane()
    start = dict(zip(("lift", "fold"), arm.strut_motion(arm.assemble(START))[0], strict=True))

    def law(name: str, size: float, w: float) -> fa.Motion:
        def at(t: float) -> tuple[float, float, float]:
            return (float(start[name] + size * (1 - np.cos(w * t))), float(size * w * np.sin(w * t)),
                    float(size * w**2 * np.cos(w * t)))  # fmt: skip

        return fa.Motion(at)

    return {"lift": law("lift", 0.05, 7.0), "fold": law("fold", -0.04, 9.0)}


def angle(a: np.ndarray, b: np.ndarray, length: Any, rate: Any, second: Any) -> tuple[Any, Any, Any]:
    """The angle from a to b about their joint, and its derivatives, of sides |a|, |b| that a length holds apart:
    l^2 = a^2 + b^2 - 2 a b cos(angle)."""
    p, r = np.linalg.norm(a), np.linalg.norm(b)
    turn = np.arccos((p**2 + r**2 - length**2) / (2 * p * r))
    turning = length * rate / (p * r * np.sin(turn))
    bent = (rate**2 + length * second - p * r * np.cos(turn) * turning**2) / (p * r * np.sin(turn))
    return turn, turning, bent


def triangles(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angles of the boom and the jib, (nt, 2), with their rates and accelerations, under `moved`."""
    out = []
    knee = np.array([3.0, 0.0])
    for name, a, b in (("lift", FOOT, LIFTED), ("fold", HELD - knee, FOLDED)):
        found = angle(a, b, *moved()[name](t))
        zero = np.arctan2(a[1], a[0]) - np.arctan2(b[1], b[0])  # of the joint, where b points to a
        sign = 1.0 if name == "lift" else -1.0
        place = (zero + sign * found[0] + np.pi) % (2 * np.pi) - np.pi
        out.append((place, sign * found[1], sign * found[2]))
    return tuple(np.column_stack(x) for x in zip(*out, strict=True))  # type: ignore[return-value]


@pytest.mark.parametrize(("name", "options"), RUNS, ids=NAMES)
def test_prescribed_lengths_move_the_arm_as_triangles_have_it(name: str, options: dict[str, Any]) -> None:
    """And the forces that they take are those of virtual work."""
    arm, truth = crane(), Oracle(crane(True).to_dict())
    run = fa.simulate(arm, T, START, drive=moved(), **options)
    q, v, a = triangles(T)
    assert np.abs(run.q[:, :2] - q).max() < 1e-11
    assert np.abs(run.v[:, :2] - v).max() < 1e-9
    for cylinder, law in moved().items():
        line = run.strut(cylinder)
        np.testing.assert_allclose((line.length, line.rate), law(T)[:2], atol=1e-9)
    rows = zip(q, v, a, strict=True)
    wanted = np.array([np.linalg.solve(truth.strut_jacobian(x).T, truth.inverse(x, y, z)) for x, y, z in rows])
    forces = np.column_stack([run.tau[:, arm.joint_rate(x)] for x in ("lift", "fold")])
    np.testing.assert_allclose(forces, wanted, atol=1e-6 * np.abs(wanted).max())
    own = np.array([truth.strut_motion(x, y)[:, 2] for x, y in zip(q, v, strict=True)])
    whole = np.column_stack([run.strut(x).force for x in ("lift", "fold")])
    np.testing.assert_allclose(whole, own + wanted, atol=1e-6 * np.abs(wanted).max())


class Plane:
    """The crane without cylinders: masses on two rods, moved by virtual work. All places in the axes of their rods."""

    bodies = ((1, (1.5, 0), 60.0), (1, LIFTED, MASSES[0]), (2, (0.75, 0), 25.0), (2, FOLDED, MASSES[1]))
    turning = 60.0 * 3.0**2 / 12, 25.0 * 1.5**2 / 12
    lines = (((0, FOOT), (1, LIFTED)), ((1, HELD), (2, FOLDED)))

    def place(self, rod: int, at: Any, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of a point: where it is, its Jacobian, and its acceleration at constant rates."""
        x, J, bias = np.zeros(2), np.zeros((2, 2)), np.zeros(2)
        for k, part in enumerate([(3.0, 0.0)] * (rod - 1) + [at] * (rod > 0)):
            turn, w = q[: k + 1].sum(), v[: k + 1].sum()
            arm = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ np.array(part)
            x, bias = x + arm, bias - w**2 * arm
            J[:, : k + 1] += np.array([[-arm[1]], [arm[0]]])
        return (np.array(at), J, bias) if rod == 0 else (x, J, bias)

    def stretch(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Lengths, rates and springs' forces of the lines, (2, 3); the Jacobian of their lengths."""
        rows, by = [], []
        own = (2e3, 40.0, 1.2, 0.0), (0.0, 0.0, 0.0, 150.0)
        for (a, b), (k, c, rest, force) in zip(self.lines, own, strict=True):
            (p, on_p, _), (r, on_r, _) = self.place(*a, q, v), self.place(*b, q, v)
            length = np.linalg.norm(r - p)
            by.append((r - p) @ (on_r - on_p) / length)
            rows.append((length, by[-1] @ v, force - k * (length - rest) - c * (by[-1] @ v)))
        return np.array(rows), np.array(by)

    def rates(self, y: np.ndarray, push: Callable[[np.ndarray], Any]) -> np.ndarray:
        q, v = y[:2], y[2:]
        M = np.diag([self.turning[0] + self.turning[1], self.turning[1]]) + self.turning[1] * np.eye(2)[::-1]
        lines, by = self.stretch(q, v)
        force = by.T @ (lines[:, 2] + np.array(push(lines))) - [0.0, 3.0 * v[1]]
        for rod, at, mass in self.bodies:
            _, J, bias = self.place(rod, at, q, v)
            M, force = M + mass * J.T @ J, force - mass * J.T @ (bias + np.array([0.0, 9.81]))
        return np.r_[v, np.linalg.solve(M, force)]

    def run(self, t: np.ndarray, push: Callable[[float, np.ndarray], Any], y: np.ndarray) -> np.ndarray:
        """Angles and rates at times t, (nt, 4); the lines push with push(t, their motion) beside their springs."""
        law = lambda now, y: self.rates(y, lambda lines: push(now, lines))  # noqa: E731
        return np.asarray(solve_ivp(law, t[[0, -1]], y, "DOP853", t, rtol=1e-11, atol=1e-12).y.T)


KP, KV = np.array([4e4, 2e4]), np.array([3e3, 1.5e3])
LED = moved()


def pds(**more: Any) -> list[fa.PD]:
    return [fa.PD(kp, kv, name, reference=LED[name], **more) for kp, kv, name in zip(KP, KV, LED, strict=True)]


@cache
def led_by_controllers(limit: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angles and rates, (nt, 4), under the laws of `pds`; their forces, and those of the lines' springs, (nt, 2)."""
    truth = Plane()

    def force(t: float, x: np.ndarray) -> np.ndarray:
        led = np.array([law(t) for law in LED.values()])
        return np.clip(KP * (led[:, 0] - x[:, 0]) + KV * (led[:, 1] - x[:, 1]), -limit, limit)

    y = truth.run(T, force, np.r_[0.2, -0.9, 0, 0])
    lines = [truth.stretch(x[:2], x[2:])[0] for x in y]
    return y, np.array([force(t, x) for t, x in zip(T, lines, strict=True)]), np.array(lines)[:, :, 2]


@pytest.mark.parametrize(("name", "options"), RUNS, ids=NAMES)
def test_controllers_read_lengths_and_push(name: str, options: dict[str, Any]) -> None:
    y, acts, springs = led_by_controllers(np.inf)
    run = fa.simulate(crane(), T, START, control=pds(), **options)
    assert np.abs(run.q[:, :2] - y[:, :2]).max() < NEAR[name]
    forces = np.column_stack([run.tau[:, run.arm.joint_rate(x)] for x in LED])
    assert np.abs(forces - acts).max() < 1e5 * NEAR[name]
    whole = np.column_stack([run.strut(x).force for x in LED])
    assert np.abs(whole - acts - springs).max() < 1e5 * NEAR[name]


@pytest.mark.parametrize("name", ["implicit", "ida"])
def test_the_force_of_a_controller_has_a_limit(name: str) -> None:
    y, acts, _ = led_by_controllers(900.0)
    run = fa.simulate(crane(), T, START, control=pds(limit=900.0), **dict(RUNS)[name])
    assert np.abs(acts).max() == 900.0 and np.abs(acts).min() < 900.0
    assert np.abs(run.q[:, :2] - y[:, :2]).max() < 1e-6
    forces = np.column_stack([run.tau[:, run.arm.joint_rate(x)] for x in LED])
    assert np.abs(forces - acts).max() < 1.0


@cache
def sampled_by_controllers() -> np.ndarray:
    """Angles at times T under the law of SAMPLED, from sample to sample, with its delay and its limit."""
    kp, kv, rate, delay, most, led = SAMPLED
    truth = Plane()
    y, held, waiting, now = np.r_[0.2, -0.9, 0, 0], 0.0, [], 0.0
    rows = [y]
    for end in np.unique(np.round(np.r_[np.arange(1, 41) / rate, np.arange(40) / rate + delay], 9)):
        if end > T[-1]:
            break
        if abs(now * rate - round(now * rate)) < 1e-6:
            length, speed, _ = truth.stretch(y[:2], y[2:])[0][0]
            waiting.append((now + delay, float(np.clip(kp * (led - length) - kv * speed, -most, most))))
        while waiting and waiting[0][0] <= now + 1e-9:
            held = waiting.pop(0)[1]
        force = [held, 0.0]
        y, now = truth.run(np.array([now, end]), lambda t, x, force=force: force, y)[-1], end
        if np.abs(T - now).min() < 1e-9:
            rows.append(y)
    return np.array(rows)[:, :2]


SAMPLED = 3e4, 6e3, 50.0, 0.004, 900.0, 1.33  # gains, Hz, s, N, m


@pytest.mark.parametrize("own", [False, True], ids=["linear law", "user's function"])
def test_sampled_controllers_hold_the_force_of_a_cylinder(own: bool) -> None:
    kp, kv, rate, delay, most, led = SAMPLED
    seen, more = [("joint", "lift"), ("rate", "lift")], {"delay": delay, "limit": most}

    def law(t: float, y: np.ndarray) -> float:
        return float(kp * (led - y[0]) - kv * y[1])

    control: Any = fa.LinearController([], D=[[kp, kv]], rate=rate, measure=seen, actuate=["lift"],
                                       reference=[led, 0.0], **more)  # fmt: skip
    if own:
        control = fa.Sampled(law, rate, seen, ["lift"], **more)
    run = fa.simulate(crane(), T, START, control=control, integrator="gauss", step=1e-3)
    assert np.abs(run.q[:, :2] - sampled_by_controllers()).max() < 1e-8
    pushed = np.abs(run.tau[:, run.arm.joint_rate("lift")])
    assert pushed.max() == most and (pushed[1:] < most).any()


def test_integrals_drives_and_encoders_work_on_cylinders() -> None:
    """With an integral, the length comes to its reference under the weight; a drive reads it by its own encoder."""
    t, arm = np.linspace(0, 3, 31), crane()
    pid = fa.LinearController.pid(5e4, 1e5, 8e3, "lift", reference=1.3, filter_time=1e-2)
    hold = fa.LinearController.pid(4e4, 6e4, 4e3, "fold", rate=500.0, reference=0.9)
    run = fa.simulate(arm, t, START, control=[pid, hold])
    assert [run.strut(x).length[-1] for x in ("lift", "fold")] == pytest.approx([1.3, 0.9], abs=2e-3)
    servo = fa.Servo("lift", kp=5e4, kv=8e3, ki=1e5, rate=1e3, sensor=fa.sensors.Encoder(pulses=10**6), limit=5e3,
                     current_loop=200.0, reference=1.3)  # fmt: skip
    run = fa.simulate(arm, t, START, control=[servo, hold])
    assert run.strut("lift").length[-1] == pytest.approx(1.3, abs=2e-3)
    assert fa.sensors.Encoder("lift", pulses=None).read(run).y[:, 0] == pytest.approx(
        run.strut("lift").length, abs=1e-12
    )


def tower(rod: bool, base: bool) -> fa.Arm:
    """A boom that slews and luffs, on a cylinder from the world, which follows it in space, or from its column."""
    at, mass = np.array([1.2, 0.1, 0.05]), 3.0
    plain = fa.RigidBody(20.0, (1.5, 0, 0), np.diag([0.1, 15.0, 15.0]), (3, 0, 0))
    com = (20.0 * np.array(plain.com) + mass * at) / (20.0 + mass)
    inertia = np.diag([0.1, 15.0, 15.0])
    for m, p in ((20.0, np.array(plain.com) - com), (mass, at - com)):
        inertia += m * (p @ p * np.eye(3) - np.outer(p, p))
    boom = plain if rod else fa.RigidBody(20.0 + mass, tuple(com), inertia, (3, 0, 0))
    column = fa.RigidBody(30.0, (0, 0, 0.2), np.eye(3), (0.1, 0, 0.5))
    links = [fa.Link(fa.Revolute("z"), column, name="column"), fa.Link(fa.Revolute("y"), boom, name="boom")]
    a = fa.Point("column", "origin", (0.4, 0.05, 0.1)) if base else (1.0, 0.7, -0.3)
    line = fa.Strut(a, fa.Point("boom", "origin", tuple(at)), stiffness=3e3, damping=20.0, length=1.1, name="lift")
    return fa.Arm(links, (0, 0, -9.81), [replace(line, mass=mass) if rod else line])


@pytest.mark.parametrize("base", [False, True], ids=["on the world", "on the column"])
def test_in_space_a_cylinder_is_a_line_with_a_point_mass(base: bool) -> None:
    push = {"lift": fa.Torque(T, 400 * np.sin(9 * T))}
    start, options = {"column": 0.2, "boom": -0.3}, {"integrator": "gauss", "step": 2e-3}
    run, plain = (fa.simulate(tower(rod, base), T, start, drive=push, **options) for rod in (True, False))
    assert np.abs(run.q[:, :2] - plain.q).max() < 1e-10
    ours, theirs = run.strut("lift"), plain.strut("lift")
    assert np.abs(ours.length - theirs.length).max() < 1e-10
    assert np.abs(ours.force - theirs.force).max() < 1e-6
    found, wanted = (x.joint_reaction("boom", "inboard") for x in (run, plain))
    np.testing.assert_allclose(found, wanted, atol=1e-6 * np.abs(wanted).max())


def beams(points: bool = False, **law: Any) -> fa.Arm:
    """A boom that bends, with a mass on its end, on a cylinder; or on a line, with the rod's mass on the beam."""
    halves = [fa.Beam(x, fa.Rectangle(0.04, 0.03), STEEL, {"bending_y": 3}, "legendre", damping_ratio=0.01)
              for x in (1.2, 1.3)]  # fmt: skip
    links = [
        fa.Link(fa.Revolute("z"), beam=halves[0], tip=fa.RigidBody(5.0 if points else 0.0), name="boom"),
        fa.Link(fa.Fixed(), beam=halves[1], tip=fa.RigidBody(10.0), name="end"),
    ]
    if not points:
        links[0] = replace(links[0], tip=None)
    line = fa.Strut((0.5, -0.8, 0), ("boom", 1.2), name="lift", mass=None if points else 5.0, **law)
    return fa.Arm(links, (0, -9.81, 0), [line])


def test_small_motions_are_those_of_a_line() -> None:
    """Modes of a cylinder that is held, poles of one under a PD, which is a spring and a damper, and balance."""
    kp, kv, led = 3e5, 2e3, 1.1
    arm, line = beams(), beams(True, stiffness=kp, damping=kv, length=led)
    q = line.equilibrium()
    still = fa.Motion([0, 1], [line.strut_motion(q)[0][0]] * 2)
    rest = fa.simulate(arm, [0, 1e-3], "equilibrium", drive={"lift": still})
    np.testing.assert_allclose(rest.q[0, : line.nq], q, atol=1e-9)
    assert rest.strut("lift").force[0] == pytest.approx(line.strut_motion(q)[2][0], rel=1e-7)
    loop = fa.closed_loop(arm, fa.PD(kp, kv, "lift", reference=led), rest.q[0], loads=None)
    wanted = np.linalg.eigvals(line.linearize(q).A)
    found = loop.poles[np.abs(loop.poles) > 1e-6]
    gaps = np.abs(found[:, None] - wanted[None, :]).min(axis=1) / np.abs(found)
    assert len(found) == len(wanted) and gaps.max() < 1e-6
    stiff = beams(True, stiffness=1e12, length=rest.strut("lift").length[0])
    held = arm.modes(rest.q[0], lock=["lift"]).frequencies
    np.testing.assert_allclose(held, stiff.modes(stiff.equilibrium()).frequencies[: len(held)], rtol=1e-3)


@pytest.mark.parametrize("options", [STEPS[1], STEPS[2]], ids=["gauss", "implicit"])
def test_derivatives_go_through_cylinders(options: dict[str, Any]) -> None:
    t = T[:6]
    paths = {"control.0.kp": (KP[0], 10.0), "strut.fold.mass": (2.5, 1e-3), "strut.lift.stiffness": (2e3, 1.0),
             "link.jib.hub.mass": (25.0, 1e-2), "drive.fold.scale": (1.0, 1e-4)}  # fmt: skip
    arm = crane()
    q0 = arm.assemble(START)
    acts: dict[str, Any] = {"control": pds()[:1], "drive": {"fold": fa.Torque(t, 300 * np.cos(8 * t))}}
    run = fa.simulate(arm, t, q0, **acts, **options)
    by = run.sensitivities(list(paths))
    for k, path in enumerate(paths):
        now, h = paths[path]
        b = fa.simulate_batch(arm, t, q0[None], **acts, **options, parameters={path: [now - h, now + h]})
        slope = (b.q[1, -1] - b.q[0, -1]) / (2 * h)
        np.testing.assert_allclose(by.q[k, -1], slope, atol=1e-5 * np.abs(slope).max())


def test_batches_steps_and_files_are_the_same_run(tmp_path: Path) -> None:
    arm, options = crane(), {"integrator": "implicit", "step": 1e-3}
    acts: dict[str, Any] = {"control": pds()[:1], "drive": {"fold": fa.Torque(200.0)}}
    run = fa.simulate(arm, T, START, **acts, **options)
    batch = fa.simulate_batch(arm, T, START, **acts, **options, parameters={"strut.fold.mass": [2.5, 4.0, 1.0]})
    assert batch.stats["lanes"] > 1
    np.testing.assert_allclose(batch.q[0], run.q, atol=1e-10)
    other = replace(arm.struts[1], mass=4.0)
    heavier = fa.Arm(arm.links[:2], arm.gravity, [arm.struts[0], other])
    np.testing.assert_allclose(batch.q[1], fa.simulate(heavier, T, START, **acts, **options).q, atol=1e-10)
    assert np.abs(batch.q[1] - batch.q[0]).max() > 1e-4

    steps = fa.Simulation(arm, fa.Implicit(1e-3), q0=START, **acts)
    steps.step(T[-1])
    np.testing.assert_allclose(steps.q, run.q[-1], atol=1e-10)
    steps.set_drive("fold", 0.0)
    run.save(tmp_path / "run.npz")
    again = fa.Result.load(tmp_path / "run.npz")
    assert again.arm == arm and np.array_equal(again.strut("lift").force, run.strut("lift").force)

    made = fa.Scene(arm, acts["drive"], control=tuple(pds(limit=5e3)[:1]), q0=START, t=T, options=options)
    made.save(tmp_path / "crane.toml")
    read = fa.load(tmp_path / "crane.toml")
    assert fa.Arm.from_dict(arm.to_dict()) == arm and np.abs(read.run().q - made.run().q).max() < 1e-5
    text = (tmp_path / "crane.toml").read_text()
    assert text.count("[[link]]") == 2 and text.count("[[strut]]") == 2 and "[[loop]]" not in text


def test_a_drive_of_a_file_may_call_it_a_strut_or_a_link(tmp_path: Path) -> None:
    fa.Scene(crane(), t=T, q0=START).save(tmp_path / "plain.toml")
    text = (tmp_path / "plain.toml").read_text()
    lengths = {"t": [0, 0.4], "q": [1.2, 1.25], "v": [0, 0], "a": [0, 0]}
    law = "{ " + ", ".join(f"{k} = {v}" for k, v in lengths.items()) + " }"
    runs = []
    for key in ("strut", "link"):
        (tmp_path / "x.toml").write_text(
            text.partition("q0 =")[0] + f'q0 = "equilibrium"\n[[drive]]\n{key} = "lift"\nmotion = {law}\n'
        )
        runs.append(fa.load(tmp_path / "x.toml").run())
    assert np.array_equal(runs[0].q, runs[1].q)
    assert runs[0].strut("lift").length[[0, -1]] == pytest.approx([1.2, 1.25])


def test_what_cannot_drive_a_line_or_does_not_know_cylinders_names_them() -> None:
    line, arm = crane(True), crane()
    for law in (fa.PD(1.0, 1.0, "lift"), fa.LinearController.pid(1.0, 1.0, 1.0, "lift", rate=100.0)):
        with refuses("'lift'", "strut", "mass"):
            fa.simulate(line, T, control=law)
    with refuses("drive of 'lift'", "Torque", "mass"):
        fa.simulate(line, T, drive={"lift": fa.Motion([0, 1], [1.0, 1.1])})
    rope = fa.Arm(line.links, struts=[fa.Tendon([(0, 1, 0), "boom"], stiffness=1.0, name="rope")])
    with refuses("drive of 'rope'", "Torque"):
        fa.simulate(rope, T, drive={"rope": fa.Motion([0, 1], [1.0, 1.1])})
    known: Any = {"force_noise": 1.0, "q_std": 1e-2, "v_std": 1e-2}
    for refused in (
        lambda: arm.inverse_dynamics(arm.zero, np.zeros(arm.nv), np.zeros(arm.nv)),
        lambda: fa.KalmanFilter(arm, [fa.sensors.Encoder(0, noise=1e-3)], 1e-3, **known),
        lambda: fa.simulate(arm, T, START, control=fa.MPC(reference=0.0, rate=100.0, horizon=1.0)),
        lambda: fa.simulate(arm, T, "held", control=pds()),
        lambda: fa.lqr(arm),
        lambda: arm.to_urdf("x.urdf"),
        lambda: arm.trim(),
        lambda: fa.economize(fa.Scene(arm, t=T, q0=START), 1e-2),
    ):
        with refuses("cylinders", "'lift'"):
            refused()
