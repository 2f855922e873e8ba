"""fa.plan_move against closed forms, and against simulations by another integrator."""

from __future__ import annotations

import math
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from messages import refuses
from scipy.optimize import brentq

STEEL = fa.Material(7850, 209e9, 0.3)
QUIET = pytest.mark.filterwarnings("ignore::flexarm.errors.RangeWarning")


def rigid_arm(**joint: Any) -> fa.Arm:
    body = fa.RigidBody(2.0, com=(0.3, 0, 0), inertia=(0, 0, 0.1))
    return fa.Arm([fa.Link(fa.Revolute("z", **joint), body)])


def one_mode() -> fa.Arm:
    """A link of one shape, that moves little: a rigid body and one oscillator."""
    beam = fa.Beam(0.7, fa.Rectangle(0.004, 0.03), STEEL, {"bending_y": 1}, order=1)
    return fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(0.1, inertia=(0, 0, 0.01)), beam, fa.RigidBody(0.2))])


def two_links(payload: float = 1.0, gravity: float = -9.81, shapes: int = 3, thick: float = 0.008) -> fa.Arm:
    def beam() -> fa.Beam:
        return fa.Beam(0.5, fa.Rectangle(thick, 0.03), STEEL, {"bending_y": shapes}, order=2)

    hub, elbow = fa.RigidBody(0.3, end=(0.05, 0, 0)), fa.RigidBody(0.5, end=(0.05, 0, 0))
    links = [fa.Link(fa.Revolute("z"), hub, beam()), fa.Link(fa.Revolute("z"), elbow, beam(), fa.RigidBody(payload))]
    return fa.Arm(links, gravity=(0, gravity, 0))


def swing(arm: fa.Arm, move: fa.results.Move, drive: Any = None, end: float | None = None) -> float:
    """Of the end after a move (or after another drive's end), by a simulation of one's own."""
    end = move.duration if end is None else end
    q0 = arm.zero
    names = list(arm.coordinates)
    at = [names.index(name) for name in move.joints]
    q0[at] = move.q[0]
    lock = [k for k, link in enumerate(arm.links) if link.joint.nv]
    start, goal = arm.equilibrium(q0, lock=lock), q0.copy()
    goal[at] = move.q[-1]
    t = np.append(0.0, end + np.linspace(0, 1, 400))
    small = 1e-9 * min(1.0, float(np.abs(move.q[-1] - move.q[0]).max()))
    run = fa.simulate(arm, t, q0=start, drive=move.drive if drive is None else drive, rtol=1e-8, atol=small)
    rest = arm.frame(arm.equilibrium(goal, lock=lock))[0]
    return float(np.linalg.norm(run.frame()[0][1:] - rest, axis=1).max())


# -- the rigid arm ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("angle", [0.3, 2.0])
def test_rigid_time_is_bang_bang(angle: float) -> None:
    arm = rigid_arm()
    J = arm.mass_matrix(arm.zero)[0, 0]
    move = fa.plan_move(arm, 0.0, angle, limits={"torque": 3.0})
    assert move.rigid_duration == pytest.approx(2 * math.sqrt(J * angle / 3.0), rel=1e-9)
    assert move.duration == pytest.approx(move.rigid_duration, rel=0.02)
    assert move.half_period == 0 and move.residual == 0
    assert fa.plan_move(arm, {0: 0.0}, {0: angle}, limits={"torque": 3.0}).duration == move.duration
    with refuses("q_to", "link = 'elbow'"):
        fa.plan_move(arm, {0: 0.0}, {"elbow": angle}, limits={"torque": 3.0})


def test_rigid_time_with_a_speed_limit_is_a_trapezoid() -> None:
    arm = rigid_arm()
    a, v, angle = 3.0 / arm.mass_matrix(arm.zero)[0, 0], 1.2, 2.0
    move = fa.plan_move(arm, 0.0, angle, limits={"torque": 3.0, "speed": v})
    assert move.rigid_duration == pytest.approx(angle / v + v / a, rel=2e-3)
    assert np.abs(move.v).max() <= v * 1.0001
    assert {x.what for x in move.reached} == {"torque", "speed"}


def test_viscous_friction_takes_its_share() -> None:
    """J dv/dt + c v = +-tau: v rises to (tau/c)(1 - e^(-t c/J)), then falls; integrated here by closed form."""
    arm = rigid_arm(damping=2.0)
    J, c, tau, angle = arm.mass_matrix(arm.zero)[0, 0], 2.0, 3.0, 1.5
    k, end = c / J, tau / c

    def way(t1: float) -> float:
        v = end * (1 - math.exp(-k * t1))
        t2 = math.log((v + end) / end) / k
        return end * t1 - v / k + (v + end) / k * (1 - math.exp(-k * t2)) - end * t2 - angle

    t1 = brentq(way, 0.01, 10.0)
    t2 = math.log((end * (1 - math.exp(-k * t1)) + end) / end) / k
    assert fa.plan_move(arm, 0.0, angle, limits={"torque": tau}).rigid_duration == pytest.approx(t1 + t2, rel=1e-3)


def test_joints_that_go_their_own_ways_need_no_more_than_the_slower() -> None:
    """Two sleds: 1 m at 1 m/s², 2 s; 0.5 m at that and 0.3 m/s, 0.5/0.3 + 0.3 s. On a straight line, at 0.6 m/s of the
    former, 1/0.6 + 0.6 s."""
    sleds = fa.Arm([fa.Link(fa.Prismatic("x"), fa.RigidBody(1.0)), fa.Link(fa.Prismatic("y"), fa.RigidBody(1.0))])
    limits: dict[str, Any] = {"acceleration": 1.0, "speed": (2.0, 0.3)}
    line = fa.plan_move(sleds, path=[[0, 0], [1, 0.5]], limits=limits)
    assert line.rigid_duration == pytest.approx(1 / 0.6 + 0.6, rel=2e-3)
    assert line.q[:, 1] == pytest.approx(0.5 * line.q[:, 0], abs=1e-9)
    assert line.rigid_duration <= line.duration < 1.02 * line.rigid_duration
    best = fa.plan_move(sleds, [0, 0], [1, 0.5], limits=limits)
    assert best.rigid_duration == line.rigid_duration
    assert 2.0 <= best.duration < 2.0 * 1.03
    assert np.abs(best.v).max(axis=0)[1] <= 0.3 * 1.0001 and np.abs(best.a).max() <= 1.0001


@pytest.mark.parametrize("stop", [None, 2.5])
def test_a_joint_stays_between_its_stops_or_else_between_both_positions(stop: float | None) -> None:
    """An elbow with stops folds further, which leaves less inertia to turn."""
    stops = {} if stop is None else {"lower": -stop, "upper": stop, "limit_stiffness": 1e4}
    body = fa.RigidBody(1.0, com=(0.25, 0, 0), inertia=(0, 0, 0.02), end=(0.5, 0, 0))
    arm = fa.Arm([fa.Link(fa.Revolute("z"), body), fa.Link(fa.Revolute("z", **stops), body, tip=fa.RigidBody(1.0))])
    start, end = np.array([0.3, 1.5]), np.array([-1.0, 1.2])
    limits = {"torque": (20.0, 10.0)}
    move, line = fa.plan_move(arm, start, end, limits=limits), fa.plan_move(arm, path=[start, end], limits=limits)
    assert move.q[[0, -1]] == pytest.approx(np.array([start, end]), abs=1e-9)
    assert move.q[:, 0].min() > -1.001 and move.q[:, 0].max() < 0.301
    assert move.q[:, 1].min() > (1.199 if stop is None else 1.0)
    assert (1.0 if stop is None else 0.9) * line.duration > move.duration
    assert move.q[:, 1].max() < 1.501 if stop is None else 1.7 < move.q[:, 1].max() < 2.501
    assert all(x.peak < 1.001 * x.limit for x in move.limits)


# -- one mode --------------------------------------------------------------------------------------------------------


def fastest_of_one_mode(distance: float, a: float, w: float) -> float:
    """Duration of the time-optimal bang-bang motion of a support with one undamped oscillator, accelerations up to a:
    odd about its middle, with switches there and by s before and after (e.g. Singh and Vadali 1994)."""

    def left(half: float) -> float:
        s = math.acos((1 + math.cos(w * half)) / 2) / w
        return a * (half**2 - 2 * s**2) - distance

    rigid = math.sqrt(distance / a)
    grid = np.linspace(rigid, rigid + math.pi / w, 4001)
    values = [left(x) for x in grid]
    k = next(i for i in range(len(grid)) if values[i + 1] >= 0)
    return 2 * brentq(left, grid[k], grid[k + 1])


@QUIET
def test_one_mode_takes_half_a_period_more_or_the_known_optimum() -> None:
    arm, angle, a = one_mode(), 0.3, 4.0
    w = arm.modes(lock=[0]).frequencies[0]
    shaped = fa.plan_move(arm, 0.0, angle, limits={"acceleration": a}, method="shaped")
    rigid = 2 * math.sqrt(angle / a)
    assert shaped.rigid_duration == pytest.approx(rigid, rel=1e-9)
    assert shaped.duration == pytest.approx(rigid + math.pi / w, rel=1e-6)
    best = fa.plan_move(arm, 0.0, angle, limits={"acceleration": a})
    known = fastest_of_one_mode(angle, a, w)
    assert known < rigid + math.pi / w
    assert known * 0.999 < best.duration < known * 1.02  # accelerations take the time between knots to change sign
    for move in (shaped, best):
        assert np.abs(move.a).max() <= a * 1.0001
        assert move.residual_unshaped > 1e-3
        assert move.residual < 1e-3 * move.residual_unshaped


def two_masses() -> fa.Arm:
    """Two masses of 1 kg and a spring of 1 N/m: a massless beam of one shape, u'' constant: k = 4 E I / L^3."""
    height = (0.25 * 12 / (1e9 * 0.01)) ** (1 / 3)  # E I = 1/4, L = 1
    spring = fa.Beam(
        1.0, fa.Rectangle(height, 0.01), fa.Material(1e-9, 1e9, 0.3), {"bending_y": 1}, basis="legendre", order=1
    )
    return fa.Arm([fa.Link(fa.Prismatic("y"), fa.RigidBody(1.0), spring, fa.RigidBody(1.0))])


@QUIET
def test_two_masses_and_a_spring_take_about_the_known_least_time() -> None:
    """4.218 s from rest to rest over 1 m with a force up to 1 N on the first (B. Wie and Q. Liu, J. Guidance 15 (1992),
    721-726)."""
    arm = two_masses()
    assert arm.modes(lock=[0]).frequencies[0] == pytest.approx(1.0, rel=1e-6)
    move = fa.plan_move(arm, 0.0, 1.0, limits={"torque": 1.0})
    assert 4.218 * 0.999 < move.duration < 4.218 * 1.05
    assert swing(arm, move) < 1e-3 * move.residual_unshaped
    assert move.limits[0].reached


# -- small moves -----------------------------------------------------------------------------------------------------


@QUIET
@pytest.mark.parametrize(("links", "size", "method"), [(1, 1e-6, "fast"), (2, 1e-6, "shaped"), (2, 1e-4, "fast")])
def test_small_moves_are_shaped(links: int, size: float, method: str) -> None:
    """Strong motors would do them in less than a ms: what is sought, and how it is measured, go with the move."""
    arm = one_mode() if links == 1 else two_links(gravity=0.0, shapes=1)
    start, way = np.array([0.1, 0.2])[:links], size * np.array([1.0, -1.0])[:links]
    move = fa.plan_move(arm, start, start + way, limits={"torque": (60.0, 15.0)[:links]}, method=method)
    unshaped = swing(arm, move, move.rigid_drive, move.rigid_duration)
    assert unshaped > 0.1 * size
    assert move.residual_unshaped == pytest.approx(unshaped, rel=0.05)
    assert swing(arm, move) < 1e-3 * unshaped
    assert move.residual < 1e-3 * unshaped
    done = (move.q - move.q[0]) / way
    assert done.min() > -0.01 and done.max() < 1.01
    assert np.abs(move.v).max() < 10 * size / move.duration


@QUIET
def test_a_slide_and_turns_with_friction_keep_their_limits_between_the_knots() -> None:
    """A short move, simulated on a grid of its own."""
    beam = fa.Beam(0.5, fa.Rectangle(0.006, 0.03), STEEL, {"bending_y": 1}, order=1)
    hub = fa.RigidBody(0.5, inertia=(0, 0, 0.01), end=(0.05, 0, 0))
    arm = fa.Arm([
        fa.Link(fa.Revolute("z", coulomb=0.4, damping=0.9), hub, beam),
        fa.Link(fa.Revolute("z", coulomb=1.2), hub, beam),
        fa.Link(fa.Prismatic("x", coulomb=0.1, damping=0.4), hub, beam, fa.RigidBody(0.3)),
    ], gravity=(0, -9.0, 0))  # fmt: skip
    start, torque = np.array([0.1, 0.9, -0.04]), np.array([150.0, 100.0, 60.0])
    way = np.array([-0.5, 0.6, 0.2]) * 1e-3
    move = fa.plan_move(arm, start, start + way, limits={"torque": torque}, method="shaped")
    names = list(arm.coordinates)
    t = np.linspace(0.0, move.duration, 1234)
    still = move.simulate(after=0.0).q[0]
    run = fa.simulate(arm, t, q0=still, drive=move.drive, integrator="gauss", step=float(t[1]))
    rates = [names.index(name) for name in move.joints]
    assert (np.abs(run.tau[:, rates]) < 1.01 * torque).all()
    assert np.abs(run.v[:, rates]).max(axis=0) == pytest.approx(np.abs(move.v).max(axis=0), rel=0.02)
    assert swing(arm, move) < 0.05 * swing(arm, move, move.rigid_drive, move.rigid_duration)


# -- two links -------------------------------------------------------------------------------------------------------


@QUIET
def test_two_links_come_to_rest_within_limits() -> None:
    arm, torque = two_links(gravity=-9.81), (60.0, 15.0)
    move = fa.plan_move(arm, [0.0, 0.0], [1.0, -1.0], limits={"torque": torque, "speed": 8.0})
    assert move.duration < 1.03 * (move.rigid_duration + move.half_period)
    assert swing(arm, move) < 1e-3 * move.residual_unshaped
    run = move.simulate(integrator="gauss", step=5e-4, after=0.1)
    for k, most in zip((0, 4), torque, strict=True):
        assert np.abs(run.tau[:, k]).max() <= most * 1.001
    assert any(x.what == "torque" and x.reached for x in move.limits)
    assert np.abs(move.a[[0, -1]]).max() < 1e-6 and np.abs(move.v[[0, -1]]).max() < 1e-9
    assert move.q[[0, -1]] == pytest.approx(np.array([[0, 0], [1, -1]]), abs=1e-9)


@QUIET
def test_another_payload_is_told() -> None:
    move = fa.plan_move(two_links(), [0.0, 0.0], [1.0, -1.0], limits={"torque": (60.0, 15.0)}, method="shaped")
    off = move.residual_of(two_links(payload=1.2))
    assert off > 10 * move.residual
    assert off == pytest.approx(swing(two_links(payload=1.2), move), rel=0.05)


@QUIET
def test_a_path_is_kept() -> None:
    arm = two_links(gravity=0.0, shapes=1)

    def path(s: float) -> list[float]:
        return [s, 0.5 * math.sin(math.pi * s)]

    move = fa.plan_move(arm, path=path, limits={"torque": (60.0, 15.0), "speed": 3.0})
    assert np.abs(move.q[:, 1] - 0.5 * np.sin(math.pi * move.q[:, 0])).max() < 1e-4
    assert move.duration < 1.03 * (move.rigid_duration + move.half_period)
    assert swing(arm, move) < 0.05 * move.residual_unshaped
    assert np.abs(move.v).max() <= 3.0 * 1.001


def test_a_path_of_samples_is_that_of_its_function() -> None:
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, com=(0.3, 0, 0), end=(0.5, 0, 0)))] * 2)

    def path(s: float) -> list[float]:
        return [s, 0.5 * math.sin(math.pi * s)]

    samples = [path(s) for s in np.linspace(0, 1, 41)]
    moves = [fa.plan_move(arm, path=p, limits={"torque": 2.0, "speed": 3.0}) for p in (path, samples)]
    assert moves[0].duration == pytest.approx(moves[1].duration, rel=1e-3)
    assert moves[0].rigid_duration == pytest.approx(moves[1].rigid_duration, rel=1e-3)


@QUIET
def test_the_tip_keeps_to_a_line_of_a_stiff_arm() -> None:
    """Its joints by inverse kinematics, as docs/moves.md shows; the beams then bend by tenths of a millimetre."""
    arm, ends = two_links(gravity=0.0, shapes=1, thick=0.03), np.array([[0.8, -0.3], [0.4, 0.5]])
    tip = {name: fa.Motion([0, 1], ends[:, k], ends="rest") for k, name in enumerate("xy")}
    line = fa.invert(arm, tip, posture=[-1, 0, 1, 0], method="rigid")
    move = fa.plan_move(arm, path=line.q[:, [0, 2]], limits={"acceleration": 15.0, "speed": 3.0}, method="shaped")
    places = move.simulate().frame()[0][:, :2]
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    off = np.abs((places - ends[0]) @ [-along[1], along[0]])
    assert off.max() < 1e-3
    assert places[[0, -1]] == pytest.approx(ends, abs=1e-5)
    still = np.zeros((len(move.q), 4))
    still[:, [0, 2]] = move.q
    unbent = arm.frame(still)[0][:, :2]
    assert np.abs((unbent - ends[0]) @ [-along[1], along[0]]).max() < 1e-8


# -- bad input -------------------------------------------------------------------------------------------------------


@QUIET
@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"limits": {"torque": (60.0, 2.0)}}, ("limits['torque'] = 2 of 'link 1", "weight")),
        ({"limits": {"torque": (60.0, -1.0)}}, ("limits['torque'] = -1", "'link 1 revolute'")),
        ({"limits": {"torque": (60.0, 1.0, 2.0)}}, "limits['torque'] has shape (3,)"),
        ({"limits": {"torque": {0: 60.0}}}, "'link 1 revolute'"),
        ({"limits": {"torque": {7: 60.0}}}, "link = 7"),
        ({"limits": {"torque": None}}, "'link 0 revolute'"),
        ({"limits": {"torque": (60.0, 15.0), "speed": float("nan")}}, "limits['speed'] = nan"),
        ({"q_to": [0.0, 0.0]}, "q_to = [0.0, 0.0]"),
        ({"q_to": [0.0, 0.0, 1.0]}, "q_to has shape (3,)"),
        ({"q_to": [0.0, float("nan")]}, "q_to = [0.0, nan]"),
        ({"q_to": None}, "q_to = None"),
        ({"path": [[0, 0], [1, 1]]}, ("path", "q_from")),
        ({"q_from": None, "q_to": None, "path": lambda s: [float(s > 0.5), 0.0]}, ("1", "s = 0.5", "jumps")),
        ({"q_from": None, "q_to": None, "path": [[0.01 * k + (k > 5), 0] for k in range(12)]}, "row 5 to 6"),
        ({"q_from": None, "q_to": None, "path": [[1, 1], [1, 1]]}, "does not move"),
        ({"method": "best"}, "method = 'best'"),
        ({"residual": 0.0}, "residual = 0"),
        ({"residual": 5.0}, "residual = 5"),
    ],
)
def test_bad_input_is_named(change: dict[str, Any], told: str) -> None:
    given = {"q_from": [0.0, 0.0], "q_to": [1.0, -1.0], "limits": {"torque": (60.0, 15.0)}} | change
    with refuses(told):
        fa.plan_move(two_links(), **given)


def test_stops_and_balls_are_named() -> None:
    with refuses("1.5", "'link 0 revolute'", "-1 to 1", "stops"):
        fa.plan_move(rigid_arm(lower=-1.0, upper=1.0, limit_stiffness=1e3), 0.0, 1.5, limits={"torque": 3.0})
    ball = fa.Arm([fa.Link(fa.Spherical(), fa.RigidBody(1.0, inertia=(1, 1, 1)))])
    with refuses("arm", "ball"):
        fa.plan_move(ball, [0, 0, 0], [1, 0, 0], limits={"torque": 1.0})


def test_it_can_be_interrupted() -> None:
    def stop(done: float, text: str = "") -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fa.plan_move(rigid_arm(), 0.0, 1.0, limits={"torque": 3.0}, progress=stop)
