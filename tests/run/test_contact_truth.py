"""Contacts in runs: bounces, restitution, stick, slide and roll beside closed forms; a beam that falls on a stop and an
arm that presses on a wall beside solutions that are not flexarm's (tests/data/contacts.json)."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from arms import DATA, STEEL, G
from messages import refuses
from scipy.interpolate import make_interp_spline
from scipy.optimize import brentq

RUNS = [
    {},
    {"integrator": "gauss", "step": 5e-4},
    {"integrator": "implicit", "step": 5e-5},
    {"integrator": "rk4", "step": 1e-4},
    {"integrator": "ida", "rtol": 1e-9, "atol": 1e-11},
]
every_run = pytest.mark.parametrize("options", RUNS, ids=lambda x: x.get("integrator", "default"))


def ball(law: dict[str, Any], against: Any = None, gravity: float = G) -> fa.Arm:
    """On a vertical slide over the ground, or over what is given."""
    body = fa.Link(fa.Prismatic("z"), fa.RigidBody(0.5), name="ball")
    touch = fa.Contact("ball", against or fa.Plane((0, 0, 0)), radius=0.05, name="ground", **({"stiffness": 2e4} | law))
    return fa.Arm([body], (0, 0, -gravity), contacts=[touch])


def restitution(damping: float, speed: float) -> float:
    """From m w dw / (1 + w) = - k damping^2 d^n dd, w = damping times speed: at both ends w - log(1 + w)."""
    w = damping * speed
    kept = w - np.log1p(w)
    return float(-brentq(lambda x: x - np.log1p(x) - kept, -1 + 1e-14, -1e-9, xtol=1e-15) / w)


# -- a ball ------------------------------------------------------------------------------------------------------------


@every_run
def test_a_ball_without_damping_bounces_for_ever(options: dict[str, Any]) -> None:
    """Height, by the closed form, over five bounces; energy; the time of contact."""
    w, height = 200.0, 0.3
    flight = np.sqrt(2 * height / G)
    speed = G * flight
    touching = 2 / w * (np.pi - np.arctan(speed * w / G))
    t = np.linspace(0, 2.5, 501)
    run = fa.simulate(ball({}), t, [height + 0.05], events=[fa.Touch("ground"), fa.Release("ground")], **options)
    s = np.mod(t + flight, 2 * flight + touching)
    u = s - 2 * flight
    expected = np.where(
        u < 0, speed * s - 0.5 * G * s**2, -G / w**2 * (1 - np.cos(w * u)) - speed / w * np.sin(w * u)
    )
    far, kept = {"implicit": (3e-5, 1e-4), "rk4": (1e-4, 1e-4), "ida": (1e-6, 1e-6)}.get(
        options.get("integrator", ""), (1e-3, 3e-3)
    )
    np.testing.assert_allclose(run.q[:, 0] - 0.05, expected, atol=far)
    energy = np.asarray(sum(run.energy()))
    assert np.ptp(energy) < kept * energy[0]
    touch, release = run.t_events
    assert len(touch) == len(release) == 5
    np.testing.assert_allclose(touch, flight + np.arange(5) * (2 * flight + touching), atol=far)
    np.testing.assert_allclose(release - touch, touching, rtol=2e-5)


@pytest.mark.parametrize("exponent", [1.0, 1.5])
@pytest.mark.parametrize("damping", [0.2, 3.0])
@pytest.mark.parametrize(
    "against",
    [
        fa.Plane((0, 0, 0)),
        fa.Sphere((0, 0, -0.4), 0.4),
        fa.Box((0.3, 0, -0.1), (0.8, 0.2, 0.2)),
        fa.Box((0, 0, -np.sqrt(0.02)), (0.2, 2.0, 0.2), (0, np.pi / 4, 0)),  # on its edge
    ],
    ids=["plane", "sphere", "box", "edge"],
)
def test_it_leaves_as_hunt_and_crossley_say(exponent: float, damping: float, against: Any) -> None:
    """The speed of release depends on damping and speed alone."""
    arm = ball({"damping": damping, "exponent": exponent, "stiffness": 1e5}, against, gravity=0.0)
    event = fa.Release(0, terminal=True)
    run = fa.simulate(arm, [0, 0.1], [0.1], [-1.0], events=[event], integrator="gauss", step=1e-5)
    assert run.v_events[0][0, 0] == pytest.approx(restitution(damping, 1.0), abs=1e-7)
    run = fa.simulate(arm, [0, 0.1], [0.1], [-1.0], events=[event])
    assert run.v_events[0][0, 0] == pytest.approx(restitution(damping, 1.0), abs=3e-4)


def test_hertz_contact_lasts_as_long_as_it_should() -> None:
    """2.9432 times the depth over the speed."""
    m, k, v = 0.5, 1e5, 0.7
    depth = (1.25 * m * v**2 / k) ** 0.4
    arm = ball({"exponent": 1.5, "stiffness": k}, gravity=0.0)
    run = fa.simulate(arm, [0, 0.15], [0.1], [-v], events=[fa.Touch(0), fa.Release(0), lambda t, q, v: v[0]],
                      integrator="gauss", step=2e-5)  # fmt: skip
    (touch,), (release,), _ = run.t_events
    assert release - touch == pytest.approx(2.94328 * depth / v, rel=2e-6)
    assert 0.05 - run.q_events[2][0, 0] == pytest.approx(depth, rel=1e-6)


@pytest.mark.parametrize("stiffness", [1e4, 1e5, 1e6])
def test_a_stiff_ground_at_steps_of_a_millisecond(stiffness: float) -> None:
    """Steps up to half as long as the contact. The ball loses at each bounce; at rest it is carried."""
    arm = ball({"stiffness": stiffness, "damping": 0.5})
    run = fa.simulate(arm, np.arange(0, 10.0, 1e-3), [0.25], integrator="implicit", step=1e-3)
    energy = np.asarray(sum(run.energy())) - 0.5 * G * 0.05
    assert energy.max() < 1.001 * energy[0] and energy[-1] < 0.01 * energy[0]
    held = fa.simulate(arm, [0, 0.5, 1.0], "equilibrium", integrator="implicit", step=1e-3)
    np.testing.assert_allclose(held.contact("ground").normal, 0.5 * G, rtol=1e-6)


@pytest.mark.parametrize("step", [1e-3, 1e-2])
@pytest.mark.parametrize("stiffness", [1e4, 1e6, 1e8])
def test_steps_too_long_for_an_impact_keep_energy(stiffness: float, step: float) -> None:
    """Undamped, and steps up to some hundred times as long as the contact."""
    t = np.arange(0, 10.0, step)
    run = fa.simulate(ball({"stiffness": stiffness}), t, [0.25], integrator="implicit", step=step)
    energy = np.asarray(sum(run.energy())) - 0.5 * G * 0.05
    assert run.contact("ground").touching.any() and np.ptp(energy) < 1e-6 * energy[0]


# -- stick and slide ---------------------------------------------------------------------------------------------------

RUBS = {"stiffness": 1e6, "damping": 1.0}


def block(angle: float, mu: float, spring: float = 0.0, **law: float) -> fa.Arm:
    """2 kg, of no size, that does not turn, on a plane that falls along x."""
    joint = fa.Axes(("tx", "ty", "tz"), stiffness=(spring, 0, 0))
    plane = fa.Plane((0, 0, 0), (np.sin(angle), 0, np.cos(angle)))
    touch = fa.Contact("block", plane, coulomb=mu, name="foot", **(RUBS | law))
    return fa.Arm([fa.Link(joint, fa.RigidBody(2.0), name="block")], (0, 0, -G), contacts=[touch])


def carried(angle: float) -> np.ndarray:
    """Where the plane carries it."""
    return -2.0 * G * np.cos(angle) / 1e6 * np.array([np.sin(angle), 0, np.cos(angle)])


def test_it_sticks_on_a_slope_and_does_not_creep() -> None:
    angle, t = 0.3, np.array([0, 20.0, 50.0, 100.0])
    weight = 2.0 * G * np.sin(angle)
    for share in (2.2, 1.05):  # at first its bristles bend by twice as much as later, and the second slides
        arm = block(angle, share * np.tan(angle))
        run = fa.simulate(arm, t, carried(angle), integrator="implicit", step=1e-3)
        down = run.q @ [np.cos(angle), 0, -np.sin(angle)]
        assert np.ptp(down[1:]) < 1e-14
        assert down[-1] == pytest.approx(weight / 1e6, rel=1e-6) or (share == 1.05 and 1e-5 < down[-1] < 1e-4)
        foot = run.contact("foot")
        np.testing.assert_allclose(foot.force[1:], np.tile([0, 0, 2.0 * G], (3, 1)), atol=1e-6)
        np.testing.assert_allclose(foot.friction[1:], weight, rtol=1e-6)


@every_run
def test_it_slides_where_friction_cannot_hold_it(options: dict[str, Any]) -> None:
    """Its bristles bend like a spring to their limit, then it slides; no damping."""
    angle, mu = 0.5, 0.4
    arm, t = block(angle, mu, damping=0.0), np.linspace(0, 1, 101)
    run = fa.simulate(arm, t, carried(angle), **options)
    drive, limit, w = 2 * G * np.sin(angle), mu * 2 * G * np.cos(angle), np.sqrt(1e6 / 2)
    turn = np.arccos(1 - limit / drive) / w
    u = t[1:] - turn
    way = limit / 1e6 + drive / 1e6 * w * np.sin(w * turn) * u + 0.5 * (drive - limit) / 2 * u**2
    found = run.q[1:] @ [np.cos(angle), 0, -np.sin(angle)]
    np.testing.assert_allclose(found, way, atol=1e-5 if options else 5e-4)
    foot = run.contact("foot")
    np.testing.assert_allclose(foot.friction[1:], limit, rtol=1e-7)
    assert foot.touching.all()


def test_what_is_thrown_slides_straight_and_stops() -> None:
    mu, v = 0.3, np.array([0.6, -0.8, 0.0])
    run = fa.simulate(block(0.0, mu), np.linspace(0, 2, 201), carried(0.0), v, integrator="ida")
    way = 1.0 / (2 * mu * G)
    np.testing.assert_allclose(run.q[-1, :2], way * v[:2], atol=1.5e-5)  # bristles are bent by 6 um
    assert np.abs(run.v[-1]).max() < 1e-4
    before = run.t < 1.0 / (mu * G) - 0.01
    np.testing.assert_allclose(run.q[before, :2], np.outer(run.t - 0.5 * mu * G * run.t**2, v[:2])[before], atol=1e-5)


def test_a_spring_pulls_it_to_and_fro() -> None:
    """Each half swing ends 2 mu m g / k nearer, until the spring no longer moves it; bristles bend by a few um."""
    mu, k = 0.2, 400.0
    f = mu * 2 * G / k
    x0 = 7.5 * f
    run = fa.simulate(block(0.0, mu, k), np.linspace(0, 3, 601), carried(0.0) + np.array([x0, 0, 0]),
                      integrator="ida", events=[lambda t, q, v: v[0]])  # fmt: skip
    turns = run.q_events[0][:, 0]
    turns = turns[np.abs(np.diff(turns, prepend=x0)) > 1e-3]
    np.testing.assert_allclose(turns[:3], [-x0 + 2 * f, x0 - 4 * f, -x0 + 6 * f], atol=5e-5)
    assert abs(run.q[-1, 0]) < 1.01 * f  # stuck: x0 is 7.5 f, so that it rests at 0.5 f
    assert np.abs(run.v[-1]).max() < 1e-4


@pytest.mark.parametrize("mu", [0.3, 0.05])
def test_a_ball_rolls_down_a_slope(mu: float) -> None:
    """With enough friction at 5/7 of the acceleration, without slip; else it slips, once its bristles are bent."""
    angle, r, m, k = 0.4, 0.1, 2.0, 1e6
    down, up = np.array([np.cos(angle), -np.sin(angle)]), np.array([np.sin(angle), np.cos(angle)])
    body = fa.RigidBody(m, inertia=[0.4 * m * r**2] * 3)
    limit, pull = mu * m * G * np.cos(angle), m * G * np.sin(angle)
    slips = limit < 2 / 7 * pull
    assert slips == (mu == 0.05)
    law = {"stiffness": k, "coulomb": mu, "damping": 0.0 if slips else 1.0}
    touch = fa.Contact(0, fa.Plane((0, 0, 0), (up[0], 0, up[1])), radius=r, **law)
    arm = fa.Arm([fa.Link(fa.Axes(("tx", "tz", "ry")), body)], (0, 0, -G), contacts=[touch])
    start = (r - m * G * np.cos(angle) / k) * up
    t = np.linspace(0, 1, 11)
    run = fa.simulate(arm, t, [*start, 0.0], integrator="implicit", step=1e-4)
    missing = 0.0  # what friction gives less, until it slips (N s)
    if slips:
        w = np.sqrt(3.5 * k / m)
        turn = np.arccos(1 - limit * 3.5 / pull) / w
        missing = limit * turn - pull / 3.5 * (turn - np.sin(w * turn) / w)
    force = limit if slips else 2 / 7 * pull
    way = 0.5 * (pull - force) / m * t**2 + missing / m * t
    turned = (0.5 * force * t**2 - missing * t) * r / (0.4 * m * r**2)
    np.testing.assert_allclose(run.q[:, :2] @ down - start @ down, way, atol=2e-6)
    np.testing.assert_allclose(run.q[:, 2], turned, atol=5e-5)


# -- surfaces that move ------------------------------------------------------------------------------------------------


def on_table(joint: fa.Joint, mu: float, damping: float = 1.0) -> fa.Arm:
    table = fa.Link(joint, fa.RigidBody(1.0, inertia=(1, 1, 1)), name="table")
    body = fa.Link(fa.Axes(("tx", "ty", "tz")), fa.RigidBody(2.0), name="block", parent="world")
    touch = fa.Contact("block", fa.Plane("table"), coulomb=mu, stiffness=1e6, damping=damping)
    return fa.Arm([table, body], (0, 0, -G), contacts=[touch])


@pytest.mark.parametrize("mu", [0.5, 0.2])
def test_a_table_carries_it_along(mu: float) -> None:
    """The table is accelerated by 3 m/s^2: mu g is more, or less; then the bristles bend first."""
    t, w = np.linspace(0, 1, 21), np.sqrt(1e6 / 2)
    pull = fa.Motion([0, 1], [0, 1.5], [0, 3.0], [3.0, 3.0])
    arm = on_table(fa.Prismatic("x"), mu, damping=0.0)
    run = fa.simulate(arm, t, [0, *carried(0.0)], drive={0: pull}, integrator="ida")
    way = 0.5 * 3.0 * t**2
    if mu * G < 3.0:
        turn = np.arccos(1 - mu * G / 3.0) / w
        missing = mu * G * turn - 3.0 * (turn - np.sin(w * turn) / w)
        way = 0.5 * mu * G * t**2 - missing * t
    np.testing.assert_allclose(run.q[:, 1], way, atol=1.5e-5)  # bristles that stick ring on by 12 um


def test_a_table_turns_with_it() -> None:
    """It stays where it is on the table, over eight turns; the bristles turn, too."""
    turn, r = fa.Motion([0, 1, 10], [0, 2.5, 47.5], [0, 5, 5], [0, 0, 0]), 0.1
    run = fa.simulate(
        on_table(fa.Revolute("z"), 0.5), np.linspace(0, 10, 101), [0, r, 0, carried(0.0)[2]], drive={0: turn},
        integrator="implicit", step=1e-3,
    )  # fmt: skip
    angle = run.q[:, 0]
    along = run.q[:, 1] * np.cos(angle) + run.q[:, 2] * np.sin(angle)
    across = -run.q[:, 1] * np.sin(angle) + run.q[:, 2] * np.cos(angle)
    steady = run.t > 2
    pull = 2.0 * 25.0 * r / 1e6  # m w^2 r over the bristles' stiffness
    np.testing.assert_allclose(along[steady] - r, pull, rtol=0.02)
    np.testing.assert_allclose(across[steady], 0.0, atol=0.05 * pull)


def struck() -> tuple[fa.Arm, np.ndarray, np.ndarray]:
    """A free body with a jaw that shuts on it, and rubs."""
    base = fa.Link(fa.Free(), fa.RigidBody(3.0, (0.02, 0, 0), (0.02, 0.05, 0.05)), name="base")
    jaw = fa.Link(
        fa.Universal(inboard=fa.Placement((0.1, 0, 0.1)), stiffness=0.5), fa.RigidBody(
            0.5, (0.1, 0, 0), (1e-3, 2e-3, 2e-3), (0.2, 0, 0)), name="jaw",
    )  # fmt: skip
    touch = fa.Contact(
        "jaw", fa.Box(fa.Point("base", "origin", (0.25, 0, 0)), (0.5, 0.2, 0.1)), radius=0.02, stiffness=1e4,
        damping=0.5, coulomb=0.3, name="bite",
    )  # fmt: skip
    arm = fa.Arm([base, jaw], contacts=[touch])
    v = np.zeros(arm.nv)
    v[:6], v[6:] = (0.1, 0, 0.2, 0.3, -0.2, 0.5), (0.4, 2.0)
    return arm, arm.zero, v


def test_momentum_stays_and_energy_falls() -> None:
    arm, q, v = struck()
    t = np.linspace(0, 1, 1001)
    run = fa.simulate(arm, t, q, v, integrator="gauss", step=1e-4)
    touch = run.contact("bite")
    assert touch.touching.any() and not touch.touching.all() and touch.friction.max() > 0.1
    assert (touch.friction <= 0.3 * touch.normal + 1e-9).all()
    p = arm.momentum(run.q, run.v)
    assert np.abs(p - p[0]).max() < 1e-8 * np.abs(p[0]).max()
    energy = np.asarray(sum(run.energy()))
    bent = np.square(touch.friction).max() / (2 * 1e4)  # J, what the bristles can have
    assert energy[-1] < energy[0] - 1e-3 and (np.diff(energy) < bent + 1e-6).all()


def test_the_damper_takes_what_is_lost() -> None:
    """Without friction: the work of the normal force less that of its spring."""
    arm, q, v = struck()
    arm = fa.Arm(arm.links, contacts=[replace(arm.contacts[0], coulomb=0.0)])
    t = np.linspace(0, 0.5, 10001)
    run = fa.simulate(arm, t, q, v, integrator="gauss", step=5e-5)
    touch = run.contact("bite")
    power = (touch.normal - 1e4 * np.maximum(-touch.gap, 0.0)) * touch.rate
    lost = make_interp_spline(t, power, k=1).antiderivative()(t)
    energy = np.asarray(sum(run.energy()))
    assert lost[-1] < -4e-4
    np.testing.assert_allclose(energy - energy[0], lost, atol=1e-3 * -lost[-1])


# -- beside solutions that are not flexarm's ---------------------------------------------------------------------------

KNOWN = json.loads((DATA / "contacts.json").read_text())


def falling(shapes: int = 12) -> fa.Arm:
    """A cantilever and the stop below its end."""
    beam = fa.Beam(
        0.5, fa.Rectangle(0.004, 0.02), STEEL, {"bending_y": shapes}, "legendre", kelvin_voigt=1e-4,
        rotary_inertia=False,
    )  # fmt: skip
    link = fa.Link(fa.Fixed(), beam=beam, tip=fa.RigidBody(0.1), name="beam")
    stop = fa.Contact("beam", fa.Plane((0, -1e-3, 0), (0, 1, 0)), stiffness=1e6, damping=2.0, name="stop")
    return fa.Arm([link], (0, -G, 0), contacts=[stop])


@pytest.mark.parametrize(
    ("options", "end", "normal"),
    [
        ({}, 1e-6, 0.5),
        ({"integrator": "ida", "rtol": 1e-8, "atol": 1e-10}, 1e-7, 0.1),
        ({"integrator": "implicit", "step": 1e-5}, 1e-6, 0.5),
    ],
    ids=["default", "ida", "implicit, 10 us"],
)
def test_a_beam_that_falls_on_a_stop(options: dict[str, Any], end: float, normal: float) -> None:
    known = KNOWN["falling"]
    run = fa.simulate(falling(), known["t"], **options)
    np.testing.assert_allclose(run.frame()[0][:, 1], known["end"], atol=end)
    np.testing.assert_allclose(run.contact("stop").normal, known["normal"], atol=normal)


def presser() -> fa.Arm:
    """The paper's link, four times as thick, on a rigid one, and a wall."""
    upper = fa.RigidBody(1.0, (0.25, 0, 0), (0.02, 0.02, 0.02), (0.5, 0, 0))
    beam = fa.Beam(
        0.5, fa.Rectangle(0.004, 0.02), STEEL, {"bending_y": 3}, "legendre", "exact", kelvin_voigt=2e-4,
        rotary_inertia=False,
    )  # fmt: skip
    links = [
        fa.Link(fa.Revolute("z", reflected_inertia=0.05, name="shoulder"), upper, name="upper"),
        fa.Link(fa.Revolute("z", reflected_inertia=0.05, name="elbow"), beam=beam, tip=fa.RigidBody(0.1), name="fore"),
    ]
    finger = fa.Contact(
        "fore", fa.Plane((0.6, 0, 0), (-1, 0, 0)), radius=0.01, stiffness=1e6, damping=1.0, coulomb=0.3, name="finger"
    )
    return fa.Arm(links, contacts=[finger])


START, LENGTH = (0.55, 0.3), 0.5


class Press:
    """20 N towards the wall: PI of the force and damping; along the wall, a spring and a damper to a quintic."""

    def __init__(self) -> None:
        self.sum = 0.0

    def __call__(self, t: float, y: np.ndarray) -> np.ndarray:
        one, two = y[0], y[0] + y[1]
        p = LENGTH * np.array([np.cos(one) + np.cos(two), np.sin(one) + np.sin(two)])
        far = LENGTH * np.array([-np.sin(two), np.cos(two)])
        J = np.column_stack([LENGTH * np.array([-np.sin(one), np.cos(one)]) + far, far])
        speed, error = J @ y[2:4], 20.0 - y[4]
        if y[4] > 0:
            self.sum += error / 1000.0
        u = min(max(t - 1.0, 0.0), 1.0)
        aim = START[1] - 0.15 * u**3 * (10 - 15 * u + 6 * u * u)
        push = 20.0 + 0.3 * error + 20.0 * self.sum - 150.0 * speed[0]
        return J.T @ [push, 4000.0 * (aim - p[1]) - 250.0 * speed[1]]


def pressed(**options: Any) -> fa.Result:
    measure = [("joint", 0), ("joint", 1), ("rate", 0), ("rate", 1), fa.sensors.ContactForce("finger")]
    law = fa.Sampled(Press(), 1000, measure, ("upper", "fore"))
    elbow = np.arccos((START[0] ** 2 + START[1] ** 2 - 0.5) / 0.5)
    shoulder = np.arctan2(START[1], START[0]) - elbow / 2
    arm = presser()
    return fa.simulate(arm, KNOWN["pressing"]["t"], arm.pose({"shoulder": shoulder, "elbow": elbow}), control=law,
                       **options)  # fmt: skip


@pytest.mark.parametrize(
    ("options", "end", "force"),
    [
        ({}, 2e-4, 0.5),
        ({"integrator": "implicit", "step": 1e-3}, 5e-4, 1.0),
        ({"integrator": "ida", "rtol": 1e-8, "atol": 1e-10}, 1e-8, 1e-4),
    ],
    ids=["default", "implicit, 1 ms", "ida"],
)
def test_an_arm_presses_on_a_wall_and_slides(options: dict[str, Any], end: float, force: float) -> None:
    """It hits the wall at 0.24 s and rings; then the force settles, and from 1 s on it slides along the wall."""
    known = KNOWN["pressing"]
    run = pressed(**options)
    np.testing.assert_allclose(run.frame()[0][:, :2], known["end"], atol=end)
    finger = run.contact("finger")
    calm = run.t > 0.4
    np.testing.assert_allclose(finger.normal[calm], np.array(known["normal"])[calm], atol=force)
    np.testing.assert_allclose(-finger.force[calm, 1], np.array(known["friction"])[calm], atol=force)
    assert finger.normal[-1] == pytest.approx(20.0, abs=0.05)
    assert finger.friction[-1] == pytest.approx(6.0, abs=0.05)


# -- many at a time ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("options", [{"integrator": "implicit", "step": 1e-3}, {"integrator": "rk4", "step": 1e-4}])
def test_lanes_are_single_runs(options: dict[str, Any]) -> None:
    """Arms of several gaps, stiffnesses and frictions; they touch at different times."""
    arm, t = block(0.5, 0.4), np.linspace(0, 0.3, 31)
    heights = np.linspace(0, 0.05, 11)
    q = carried(0.5) + heights[:, None] * [0, 0, 1]
    values = {"contact.foot.coulomb": np.linspace(0, 0.8, 11), "contact.foot.stiffness": np.geomspace(1e4, 1e5, 11)}
    batch = fa.simulate_batch(arm, t, q0=q, parameters=values, **options)
    for k, (mu, stiffness) in enumerate(zip(*values.values(), strict=True)):
        alone = fa.simulate(block(0.5, mu, stiffness=stiffness), t, q[k], **options)
        np.testing.assert_allclose(batch.q[k], alone.q, atol=1e-10)


def test_derivatives_with_friction_are_refused() -> None:
    run = fa.simulate(block(0.5, 0.4), np.linspace(0, 0.1, 11), carried(0.5), integrator="implicit", step=1e-3)
    with refuses("coulomb", "0.4"):
        run.sensitivities(["contact.foot.stiffness"])
