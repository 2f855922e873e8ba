"""Contacts: their points, surfaces, names and checks; gaps, rates and normal forces; what rebuilds an arm has them."""

from __future__ import annotations

import pickle
from dataclasses import replace
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from arms import STEEL
from flexarm.arm.variation import Setup, Variation
from messages import refuses

FLOOR = fa.Plane((0, -0.5, 0), (0, 2, 0))
TOE = fa.Contact("jib", FLOOR, radius=0.03, stiffness=2e4, damping=0.4, name="toe")
BALL = fa.Contact(("boom", 0.6), fa.Sphere((0.4, -0.3, 0.05), 0.25), stiffness=3e5, exponent=1.5, name="ball")
#: a box on the boom, and a point of the jib
GUARD = fa.Contact(
    fa.Point("jib", "origin", (0.1, -0.2, 0.02)),
    fa.Box(("boom", 0.5), (0.9, 0.2, 0.3), (0, 0, 0.4)), radius=0.02, stiffness=1e4, damping=0.2, name="guard",
)  # fmt: skip
RUBS = replace(TOE, coulomb=0.4)


def crane(*contacts: fa.Contact, length: float = 1.0, struts: Any = ()) -> fa.Arm:
    """A boom that bends, a rigid jib on its end; the jib also swings out of the boom's plane."""
    beam = fa.Beam(length, fa.Rectangle(0.02, 0.03), STEEL, {"bending_y": 2, "bending_z": 1}, "legendre")
    jib = fa.RigidBody(2.0, (0.3, 0, 0), (0.01, 0.02, 0.02), (0.6, 0, 0))
    links = [
        fa.Link(fa.Revolute("z", name="hinge"), beam=beam, name="boom"),
        fa.Link(fa.Axes(axes=("rz", "ry"), name="knee"), jib, name="jib"),
    ]
    return fa.Arm(links, (0, -9.81, 0), struts, contacts)


def states(arm: fa.Arm, count: int = 60) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(11)
    q = rng.uniform(-1, 1, (count, arm.nq)) * [1.5, 0.05, 0.02, 0.02, 2.5, 1.0]
    return q, rng.normal(size=(count, arm.nv))


def distances(arm: fa.Arm, q: np.ndarray) -> np.ndarray:
    """The gaps of TOE, BALL and GUARD, by the frames of their points; that of the box by search on its faces."""
    toe, ball = arm.frame(q, "jib")[0], arm.frame(q, "boom", 0.6)[0]
    p, R = arm.frame(q, "jib")
    point = p + R @ (np.array([0.1, -0.2, 0.02]) - [0.6, 0, 0])
    centre, axes = arm.frame(q, "boom", 0.5)
    c, s = np.cos(0.4), np.sin(0.4)
    y = np.einsum("...ij,...i->...j", axes @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]), point - centre)
    half = np.array([0.45, 0.1, 0.15])
    outside = np.linalg.norm(y - np.clip(y, -half, half), axis=-1)
    box = np.where(outside > 0, outside, -(half - np.abs(y)).min(axis=-1))
    sphere = np.linalg.norm(ball - [0.4, -0.3, 0.05], axis=-1) - 0.25
    return np.stack([toe[..., 1] + 0.5 - 0.03, sphere, box - 0.02], axis=-1)


def test_surfaces_and_their_points_in_short_forms() -> None:
    assert TOE.point == fa.Point("jib") and FLOOR.point == fa.Point("world", offset=(0, -0.5, 0))
    assert fa.Plane("boom") == fa.Plane(fa.Point("boom", "end"), (0, 0, 1)) and BALL.against.center.link == "world"
    assert fa.Box((0, 0, 0), (1, 2, 3)).rotation == (0, 0, 0) and GUARD.against.center == fa.Point("boom", 0.5)
    axes, _ = fa.Plane((0, 0, 0), (3, 0, -4))._core
    np.testing.assert_allclose(axes[:, 2], [0.6, 0, -0.8], rtol=1e-15)
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-15)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert (RUBS.bristles, TOE.bristles, replace(RUBS, tangential_stiffness=7.0).bristles) == (2e4, 0.0, 7.0)


def test_an_arm_with_contacts_comes_back_from_its_dictionary_and_its_pickle() -> None:
    arm = crane(TOE, BALL, GUARD)
    assert arm.contacts == (TOE, BALL, GUARD) and arm.contact_names == ("toe", "ball", "guard")
    assert fa.Arm.from_dict(arm.to_dict()) == arm == pickle.loads(pickle.dumps(arm))
    assert arm != crane(TOE, BALL) and crane(TOE) != crane(RUBS) and "contact" not in crane().to_dict()
    plane = {"type": "plane", "point": [0, -0.5, 0], "normal": [0, 2, 0]}
    table = {"point": "jib", "against": plane, "radius": 0.03, "stiffness": 2e4, "damping": 0.4, "name": "toe"}
    assert fa.Arm.from_dict({**crane().to_dict(), "contact": [table]}) == crane(TOE)
    assert crane(replace(TOE, name=None), BALL).contact_names == ("contact 0", "ball")


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: fa.Plane((0, 0, 0), (0, 0, 0)), ("normal", "zero")),
        (lambda: fa.Plane(0.5), ("point = 0.5", "Point")),
        (lambda: fa.Sphere((0, 0, 0), 0.0), ("radius = 0", "positive")),
        (lambda: fa.Box((0, 0, 0), (1, 0, 1)), ("size", "above zero")),
        (lambda: fa.Box((0, 0, 0), (1, 1, 1), np.ones((3, 3))), ("rotation", "no rotation")),
        (lambda: fa.Box((0, 0, 0), (1, 1, 1), (1, 2)), ("rotation", "3 x 3")),
        (lambda: replace(TOE, point=(0, 0, 1)), ("point", "world", "against")),
        (lambda: replace(TOE, against="floor"), ("against = 'floor'", "Plane", "Sphere", "Box")),
        (lambda: replace(TOE, against=fa.sections.Box(1, 1, thickness=0.1)), ("against", "Plane")),
        (lambda: replace(TOE, stiffness=0.0), ("stiffness = 0", "positive")),
        (lambda: replace(TOE, damping=-1.0), ("damping = -1", "negative")),
        (lambda: replace(TOE, coulomb=-0.1), ("coulomb = -0.1", "negative")),
        (lambda: replace(TOE, radius=-0.1), ("radius = -0.1", "negative")),
        (lambda: replace(TOE, exponent=2.0), ("exponent = 2", "1.5")),
        (lambda: replace(RUBS, exponent=1.5), ("tangential_stiffness = None", "1.5")),
        (lambda: replace(RUBS, tangential_stiffness=0.0), ("tangential_stiffness = 0", "positive")),
        (lambda: replace(TOE, name="contact 3"), ("name = 'contact 3'",)),
        (lambda: replace(TOE, name="a.b"), ("name = 'a.b'", "dot")),
        (lambda: crane(replace(TOE, point="jb")), ("contacts[0]: point.link = 'jb'", "jib")),
        (lambda: crane(TOE, replace(BALL, point=("boom", 1.2))), ("contacts[1]: point.at = 1.2", "0 to 1 m")),
        (lambda: crane(replace(TOE, against=fa.Plane(("jib", 0.1)))), ("against.point.at = 0.1", "no beam")),
        (lambda: crane(replace(TOE, against=fa.Sphere("joist", 1))), ("against.center.link = 'joist'",)),
        (lambda: crane(replace(TOE, against=fa.Sphere(("jib", "origin"), 0.1))), ("contacts[0]", "rigid body")),
        (lambda: crane(replace(TOE, point=("boom", "end"), against=fa.Plane("boom"))), ("contacts[0]", "rigid body")),
        (lambda: crane(TOE, replace(BALL, name="toe")), ("contacts[1]: name = 'toe'", "contacts[0]")),
        (lambda: crane(replace(TOE, name="knee")), ("contacts[0]: name = 'knee'", "joint")),
        (lambda: crane(replace(TOE, name="rope"), struts=[fa.Strut("jib", (0, 1, 0), name="rope")]),
         ("contacts[0]: name = 'rope'", "strut")),
        (lambda: crane("toe"), ("contacts[0] = 'toe'", "Contact")),
        (lambda: fa.Arm(crane().links, contacts=TOE), ("contacts", "list")),
        (lambda: crane(TOE).frame(np.zeros(6), "toe"), ("link = 'toe'", "contact")),
        (lambda: crane(TOE)._contact("tow"), ("contact = 'tow'", "toe")),
        (lambda: crane(TOE)._contact(1), ("contact = 1", "-1 to 0")),
        (lambda: crane()._contact(0), ("contact = 0", "none")),
    ],
)  # fmt: skip
def test_what_is_refused_is_named(make: Any, named: tuple[str, ...]) -> None:
    with refuses(*named):
        make()


def test_gaps_rates_and_their_jacobian_are_those_of_the_frames() -> None:
    arm = crane(TOE, BALL, GUARD)
    q, v = states(arm)
    gap, rate, _ = arm.contact_motion(q, v)
    np.testing.assert_allclose(gap, distances(arm, q), atol=1e-13)
    assert ((gap < 0).sum(axis=0) > 5).all() and ((gap > 0).sum(axis=0) > 5).all()
    J, h = arm.contact_jacobian(q), 1e-6
    np.testing.assert_allclose(rate, np.einsum("...ij,...j->...i", J, v), atol=1e-12)
    for k in range(arm.nv):
        step = h * np.eye(arm.nq)[k]
        ends = distances(arm, q + step), distances(arm, q - step)
        slope, second = (ends[0] - ends[1]) / (2 * h), (ends[0] - 2 * gap + ends[1]) / h
        smooth = np.abs(second) < 1e-4  # no edge of the box is passed
        np.testing.assert_allclose(J[..., k][smooth], slope[smooth], atol=1e-8)
        assert smooth.mean() > 0.95
    assert [x.shape for x in arm.contact_motion(q[0])] == [(3,)] * 3 and not arm.contact_motion(q[0])[1].any()
    assert arm.contact_jacobian(q[0]).shape == (3, arm.nv)


def test_places_and_directions_are_those_of_the_gaps() -> None:
    """At the gap along the direction from there, one is on the surface; the direction is by which the gap grows."""
    arm = crane(TOE, BALL, GUARD)
    q, v = states(arm)
    gap, rate, _ = arm.contact_motion(q, v)
    at, normal = arm.contact_places(q)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=-1), 1.0, rtol=1e-14)
    foot = at - gap[..., None] * normal
    np.testing.assert_allclose(foot[:, 0, 1], -0.5, atol=1e-13)
    np.testing.assert_allclose(np.linalg.norm(foot[:, 1] - [0.4, -0.3, 0.05], axis=-1), 0.25, rtol=1e-12)
    for row, place in enumerate(at):  # of the bodies there, what they move against each other
        for k, (body, on) in enumerate((("jib", None), (("boom", 0.6), None), ("jib", ("boom", 0.5)))):
            speed = np.zeros(3)
            for sign, of in ((1, body), (-1, on)):
                if of is not None:
                    link, x = of if isinstance(of, tuple) else (of, None)
                    p, u = arm.frame(q[row], link, x)[0], arm.velocity(q[row], v[row], link, x)
                    speed += sign * (u[:3] + np.cross(u[3:], place[k] - p))
            assert normal[row, k] @ speed == pytest.approx(rate[row, k], abs=1e-12)


def test_normal_forces_are_those_of_the_law() -> None:
    arm = crane(TOE, BALL, GUARD)
    q, v = states(arm, 200)
    gap, rate, normal = arm.contact_motion(q, v)
    for k, c in enumerate(arm.contacts):
        depth = np.maximum(-gap[:, k], 0.0)
        expected = np.maximum(c.stiffness * depth**c.exponent * (1 - c.damping * rate[:, k]), 0.0)
        np.testing.assert_allclose(normal[:, k], expected, rtol=1e-11, atol=1e-9)
    assert (normal[gap > 0] == 0).all() and (normal[gap < 0] > 0).mean() > 0.9


def test_normal_forces_act_on_the_arm_by_the_jacobian() -> None:
    """Forward dynamics, inverse dynamics and energies against the arm without them, pushed from outside; friction has
    no force there."""
    for contacts in ((TOE, BALL, GUARD), (RUBS, BALL, replace(GUARD, coulomb=0.3))):
        arm, bare = crane(*contacts), crane()
        q, v = states(arm)
        gap, _, normal = arm.contact_motion(q, v)
        pushed = np.einsum("...ij,...i->...j", arm.contact_jacobian(q), normal)
        assert np.abs(pushed).max() > 100
        if contacts[0].coulomb:
            v = np.zeros_like(v)  # where it does not slide, its damping has none either
            pushed = np.einsum("...ij,...i->...j", arm.contact_jacobian(q), arm.contact_motion(q)[2])
        a = np.ones(arm.nv)
        given = bare.inverse_dynamics(q, v, a) - pushed
        np.testing.assert_allclose(arm.inverse_dynamics(q, v, a), given, atol=1e-10 * np.abs(pushed).max())
        free = bare.forward_dynamics(q, v, pushed)
        np.testing.assert_allclose(arm.forward_dynamics(q, v), free, atol=1e-9 * np.abs(free).max())
        depth = np.maximum(-gap, 0.0)
        stored = sum(c.stiffness * depth[:, k] ** (c.exponent + 1) / (c.exponent + 1) for k, c in enumerate(contacts))
        np.testing.assert_allclose(arm.energy(q, v)[1] - bare.energy(q, v)[1], stored, atol=1e-9)


def test_a_base_bears_what_contacts_do_not() -> None:
    """In balance on the floor: what the hinge passes on, the floor's force, and the weight."""
    arm = crane(TOE)
    q = arm.equilibrium(arm.pose({"hinge": -0.4, ("knee", 0): -0.6}), lock=["knee"])
    normal, zero = arm.contact_motion(q)[2], np.zeros(arm.nv)
    weight = sum(link.mass for link in arm.links) * np.array(arm.gravity)
    assert 1.0 < normal[0] < -weight[1]
    hinge, pushed = arm.joint_reaction(q, zero, zero, "boom", "inboard")[:3], np.array([0, normal[0], 0])
    np.testing.assert_allclose(hinge + pushed + weight, 0.0, atol=1e-8)


def test_numbers_of_contacts_vary_by_their_paths() -> None:
    arm = crane(TOE, replace(BALL, coulomb=0.2, tangential_stiffness=1e3))
    values = {
        "contact.toe.stiffness": [1e4, 2e4], "contact.0.against.point.offset.1": [-0.4, -0.6],
        "contact.ball.against.radius": [0.1, 0.2], "contact.ball.tangential_stiffness": [10.0, 20.0],
        "contact.toe.point.offset.0": [0.0, 0.1],
    }  # fmt: skip
    varied = Variation(Setup(arm), values)
    for i in range(2):
        toe, ball = varied.scenario(i).arm.contacts
        found = (toe.stiffness, toe.against.point.offset[1], ball.against.radius, ball.tangential_stiffness)
        assert (*found, toe.point.offset[0]) == tuple(x[i] for x in values.values())
        assert varied.scenario(i).arm.contact_names == ("toe", "ball")
    given = Variation(Setup(crane(RUBS)), {"contact.toe.tangential_stiffness": [5.0]}).scenario(0).arm
    assert given.contacts[0].bristles == 5.0 and crane(RUBS).contacts[0].bristles == 2e4
    with refuses("contact.toe.stiffnes", "contact.0.stiffness"):
        Variation(Setup(crane(TOE)), {"contact.toe.stiffnes": [1.0]})
    with refuses("contact.0.radius", "negative"):
        Variation(Setup(arm), {"contact.0.radius": [-1.0]})


def test_what_rebuilds_an_arm_keeps_its_contacts() -> None:
    arm = crane(TOE, BALL)
    for other in (arm.modal_damping(0.02, lock=[0, 1]), arm.rayleigh_damping(0.1, 1e-3), arm._alike(arm.links)):
        assert other.contacts == arm.contacts and other.contact_names == arm.contact_names
    assert arm._alike(arm.links, arm.gravity, contacts=()) == crane()
    q = arm.pose({"hinge": -0.4})  # the ball touches the boom
    touching, free = (x.modes(q, lock=["hinge", "knee"]).frequencies for x in (arm, crane()))
    assert arm.contact_motion(q)[0][1] < 0 and touching[0] > 1.5 * free[0]


def test_the_table_of_an_arm_tells_its_contacts() -> None:
    text = crane(RUBS, BALL, GUARD).describe()
    for word in ("toe", "jib end", "plane, world (0, -0.5, 0), normal (0, 2, 0)", "0.4", "2e+04 N/m", "N/m^1.5",
                 "sphere", "radius 0.25", "box, boom 0.5 m, 0.9 x 0.2 x 0.3"):  # fmt: skip
        assert word in text
    assert "3 contacts" in repr(crane(TOE, BALL, GUARD)) and "contact" not in repr(crane()) + crane().describe()


def test_bristles_are_in_linear_models_of_an_arm_that_touches() -> None:
    """Their stiffness along the floor, where it touches, beside differences of a spring's moment; none without."""
    q = crane(RUBS).equilibrium(crane().pose({"hinge": -0.4, ("knee", 0): -0.6}), lock=["knee"])
    zero = np.zeros(6)
    stiff, smooth = (crane(c).inverse_derivatives(q, zero, zero)[0] for c in (RUBS, TOE))
    jib = crane().jacobian(q, "jib")
    place = crane(RUBS).contact_places(q)[0][0] - crane().frame(q, "jib")[0]
    J = jib[:3] + np.cross(jib[3:].T, place).T
    along = J[[0, 2]]  # the floor is across y
    np.testing.assert_allclose(stiff - smooth, 2e4 * along.T @ along, atol=1e-6 * np.abs(stiff).max())
