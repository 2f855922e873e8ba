"""Struts and tendons: their points, names and checks; lengths, rates and forces; what rebuilds an arm keeps them."""

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

LIFT = fa.Strut((0.3, -0.4, 0), ("boom", 0.6), stiffness=4e3, damping=50.0, force=30.0, name="lift")
ROPE = fa.Tendon(
    [(0, 0.5, 0), "boom", fa.Point("jib", offset=(0, 0.05, 0))], stiffness=2e3, damping=20.0, tension=5.0, name="rope"
)


def crane(*struts: fa.Strut | fa.Tendon, length: float = 1.0) -> fa.Arm:
    """A boom that bends, a rigid jib on its end, both in a plane."""
    beam = fa.Beam(length, fa.Rectangle(0.02, 0.03), STEEL, {"bending_y": 2}, "legendre")
    jib = fa.RigidBody(2.0, (0.3, 0, 0), (0.01, 0.02, 0.02), (0.6, 0, 0))
    links = [
        fa.Link(fa.Revolute("z", name="hinge"), beam=beam, name="boom"),
        fa.Link(fa.Revolute("z", name="knee"), jib, name="jib"),
    ]
    return fa.Arm(links, (0, -9.81, 0), struts)


def states(arm: fa.Arm, count: int = 5, size: float = 0.3) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(7)
    return size * rng.normal(size=(count, arm.nq)), rng.normal(size=(count, arm.nv))


def lengths_by_frames(arm: fa.Arm, q: np.ndarray) -> np.ndarray:
    """Those of LIFT and ROPE, by the frames of their points."""
    at_boom, end, (jib, turn) = arm.frame(q, "boom", 0.6)[0], arm.frame(q, "boom")[0], arm.frame(q, "jib")
    jib = jib + turn @ [0, 0.05, 0]
    first = np.linalg.norm(end - [0, 0.5, 0], axis=-1)
    return np.stack([np.linalg.norm(at_boom - [0.3, -0.4, 0], axis=-1), first + np.linalg.norm(jib - end, axis=-1)], -1)


def test_short_forms_of_points() -> None:
    assert LIFT.a == fa.Point("world", offset=(0.3, -0.4, 0)) == fa.Strut(np.array([0.3, -0.4, 0]), "boom").a
    assert LIFT.b == fa.Point("boom", 0.6) and fa.Strut(0, "boom").a == fa.Point(0, at="end")
    assert ROPE.points[1] == fa.Point("boom") == fa.Point("boom", "end", (0, 0, 0))
    assert fa.Strut(("boom", "origin"), "jib").a.at == "origin"
    assert replace(LIFT, b="jib").b == fa.Point("jib") and replace(ROPE, tension=1.0) != ROPE


def test_an_arm_with_struts_comes_back_from_its_dictionary_and_its_pickle() -> None:
    arm = crane(ROPE, LIFT)
    assert arm.struts == (LIFT, ROPE) and arm.strut_names == ("lift", "rope")
    assert fa.Arm.from_dict(arm.to_dict()) == arm == pickle.loads(pickle.dumps(arm))
    assert arm != crane(LIFT) and arm != crane(LIFT, replace(ROPE, tension=5.1)) and "strut" not in crane().to_dict()
    table = {"a": [0.3, -0.4, 0], "b": ["boom", 0.6], "stiffness": 4e3, "damping": 50, "force": 30, "name": "lift"}
    assert fa.Arm.from_dict({**crane().to_dict(), "strut": [table]}) == crane(LIFT)
    assert crane(fa.Strut(0, (0, 0, 1)), fa.Strut("boom", (0, 1, 0))).strut_names == ("strut 0", "strut 1")


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: fa.Point(-1), ("link = -1", "world")),
        (lambda: fa.Point(True), ("link = True",)),
        (lambda: fa.Point("boom", "middle"), ("at = 'middle'", "end", "origin")),
        (lambda: fa.Point("world", 0.3), ("at = 0.3", "world", "offset")),
        (lambda: fa.Point("boom", offset=(0, 0)), ("offset", 3)),
        (lambda: fa.Strut("boom", 0.5), ("b = 0.5", "Point")),
        (lambda: fa.Strut("boom", ("jib", "here")), ("b: at = 'here'",)),
        (lambda: fa.Strut("boom", "jib", stiffness=-1), ("stiffness = -1", "negative")),
        (lambda: fa.Strut("boom", "jib", damping=-1), ("damping = -1", "negative")),
        (lambda: fa.Strut("boom", "jib", length=-0.1), ("length = -0.1",)),
        (lambda: fa.Strut("boom", "jib", force=float("inf")), ("force = inf", "finite")),
        (lambda: fa.Strut("boom", "jib", name="3"), ("name = '3'",)),
        (lambda: fa.Strut("boom", "jib", name="strut 3"), ("name = 'strut 3'",)),
        (lambda: fa.Tendon(["boom"], stiffness=1), ("points", "two")),
        (lambda: fa.Tendon(["boom", None], stiffness=1), ("points[1] = None",)),
        (lambda: crane(fa.Strut("bom", (0, 1, 0))), ("struts[0]: a.link = 'bom'", "boom")),
        (lambda: crane(LIFT, fa.Strut((0, 1, 0), 7)), ("struts[1]: b.link = 7",)),
        (lambda: crane(fa.Strut((0, 1, 0), ("jib", 0.2))), ("b.at = 0.2", "jib", "no beam")),
        (lambda: crane(fa.Strut((0, 1, 0), ("boom", 1.2))), ("b.at = 1.2", "0 to 1 m", "boom")),
        (lambda: crane(LIFT, LIFT), ("struts[1]: name = 'lift'", "struts[0]")),
        (lambda: crane(replace(LIFT, name="knee")), ("struts[0]: name = 'knee'", "joint")),
        (lambda: crane(fa.Strut(("jib", "origin"), ("jib", "end"))), ("struts[0]", "rigid body")),
        (lambda: crane(fa.Tendon([(0, 0, 1), (0, 0, 2)], stiffness=1)), ("struts[0]", "rigid body")),
        (lambda: crane(fa.Strut(("boom", "origin"), ("boom", 0.0))), ("struts[0]", "rigid body")),
        (lambda: crane(fa.Strut((1.0, 0, 0), "boom")), ("struts[0]: length = None", "zero")),
        (lambda: crane("lift"), ("struts[0] = 'lift'", "Strut")),
        (lambda: crane(LIFT).frame(np.zeros(4), "lift"), ("link = 'lift'", "strut")),
    ],
)
def test_what_is_refused_is_named(make: Any, named: tuple[str, ...]) -> None:
    with refuses(*named):
        make()


def test_a_fixed_joint_makes_one_body_of_two() -> None:
    links = [*crane().links, fa.Link(fa.Fixed(), fa.RigidBody(0.1, end=(0.1, 0, 0)), name="hook")]
    with refuses("rigid body"):
        fa.Arm(links, struts=[fa.Strut(("jib", "origin"), "hook")])
    fa.Arm(links, struts=[fa.Strut(("boom", 0.5), "hook")])


def test_lengths_rates_and_the_jacobian_are_those_of_the_points() -> None:
    arm = crane(LIFT, ROPE)
    q, v = states(arm)
    length, rate, _ = arm.strut_motion(q, v)
    np.testing.assert_allclose(length, lengths_by_frames(arm, q), rtol=1e-13)
    np.testing.assert_allclose(arm.rest_lengths, lengths_by_frames(arm, arm.zero), rtol=1e-13)
    J, h = arm.strut_jacobian(q), 1e-6
    for k in range(arm.nv):
        step = h * np.eye(arm.nq)[k]
        slope = (lengths_by_frames(arm, q + step) - lengths_by_frames(arm, q - step)) / (2 * h)
        np.testing.assert_allclose(J[..., k], slope, atol=1e-8)
    np.testing.assert_allclose(rate, np.einsum("...ij,...j->...i", J, v), atol=1e-12)
    assert [x.shape for x in arm.strut_motion(q[0])] == [(2,)] * 3 and arm.strut_motion(q[0])[1].tolist() == [0, 0]


def test_forces_are_those_of_spring_damper_and_constant_part() -> None:
    arm = crane(LIFT, replace(ROPE, length=1.8))
    q, v = states(arm, 40)
    length, rate, force = arm.strut_motion(q, v)
    lift = 30.0 - 4e3 * (length[:, 0] - arm.rest_lengths[0]) - 50.0 * rate[:, 0]
    np.testing.assert_allclose(force[:, 0], lift, rtol=1e-12)
    long = length[:, 1] - 1.8
    pull = 5.0 + np.where(long > 0, 2e3 * long + 20.0 * np.clip(long / 1e-3, 0, 1) * rate[:, 1], 0.0)
    np.testing.assert_allclose(force[:, 1], -np.maximum(pull, 0.0), atol=1e-9)
    assert 5 < (long > 0).sum() < 35
    both = crane(replace(ROPE, length=1.8, tension_only=False))
    np.testing.assert_allclose(both.strut_motion(q, v)[2][:, 0], -(5.0 + 2e3 * long + 20.0 * rate[:, 1]), rtol=1e-12)


def test_forces_act_on_the_arm_by_the_jacobian() -> None:
    """Forward dynamics, inverse dynamics and energies against the arm without them, pushed from outside."""
    arm, bare = crane(LIFT, ROPE), crane()
    q, v = states(arm)
    length, _, force = arm.strut_motion(q, v)
    pushed = np.einsum("...ij,...i->...j", arm.strut_jacobian(q), force)
    np.testing.assert_allclose(arm.forward_dynamics(q, v), bare.forward_dynamics(q, v, pushed), rtol=1e-9)
    a = np.ones(arm.nv)
    np.testing.assert_allclose(arm.inverse_dynamics(q, v, a), bare.inverse_dynamics(q, v, a) - pushed, atol=1e-9)
    stretch = length - arm.rest_lengths
    stretch[:, 1] = np.maximum(stretch[:, 1], 0.0)
    stored = arm.energy(q, v)[1] - bare.energy(q, v)[1]
    np.testing.assert_allclose(stored, 0.5 * stretch**2 @ [4e3, 2e3], rtol=1e-9)


def test_a_base_bears_what_struts_do_not() -> None:
    """In balance: what the hinge passes on, the struts' forces from the world, and the weight."""
    arm = crane(LIFT, ROPE)
    q, zero = arm.equilibrium(), np.zeros(arm.nv)
    pushes = []
    for place, x, force in zip(([0.3, -0.4, 0], [0, 0.5, 0]), (0.6, None), arm.strut_motion(q)[2], strict=True):
        way = arm.frame(q, "boom", x)[0] - place
        pushes.append(force * way / np.linalg.norm(way))
    weight = sum(link.mass for link in arm.links) * np.array(arm.gravity)
    hinge = arm.joint_reaction(q, zero, zero, "boom", "inboard")[:3]
    np.testing.assert_allclose(hinge + sum(pushes) + weight, 0.0, atol=1e-9)


def test_a_tendon_led_along_a_beam_bends_it_as_a_moment_does() -> None:
    rod = fa.Beam(0.5, fa.Circle(0.004), STEEL, {"bending_y": 4}, "legendre", "exact")
    eyes = [fa.Point(0, x, (0, 0.02, 0)) for x in np.linspace(0.025, 0.5, 20)]
    rope = fa.Tendon([fa.Point(0, "origin", (0, 0.02, 0)), *eyes], stiffness=0.0, tension=500.0)
    arm = fa.Arm([fa.Link(fa.Fixed(), beam=rod)], struts=[rope])
    R = arm.frame(arm.equilibrium())[1]
    turn = 500.0 * 0.02 * 0.5 / (209e9 * np.pi * 0.004**4 / 4)
    assert np.arctan2(R[1, 0], R[0, 0]) == pytest.approx(turn, rel=1e-3)


def test_a_length_that_is_left_out_follows_the_arm() -> None:
    """It is that at zero, of each scenario's own numbers."""
    arm = crane(LIFT)
    varied = Variation(Setup(arm), {"strut.lift.a.offset.1": [-0.4, -0.9], "strut.0.stiffness": [1.0, 2.0]})
    for i, down in enumerate((0.4, 0.9)):
        made = varied.scenario(i).arm
        assert made.struts[0].stiffness == i + 1 and made.struts[0].length is None
        assert made.rest_lengths == pytest.approx([np.hypot(0.3, down)], rel=1e-14)
    assert arm._alike([*crane(length=2.0).links]).rest_lengths == arm.rest_lengths  # its point is at 0.6 m
    given = Variation(Setup(arm), {"strut.0.length": [0.7]}).scenario(0).arm
    assert given.rest_lengths == (0.7,) and given != arm
    with refuses("strut.lift.stiffnes", "strut.0.stiffness"):
        Variation(Setup(arm), {"strut.lift.stiffnes": [1.0]})


def test_what_rebuilds_an_arm_keeps_its_struts() -> None:
    arm = crane(LIFT, ROPE)
    for other in (arm.modal_damping(0.02, lock=[0, 1]), arm.rayleigh_damping(0.1, 1e-3), arm._alike(arm.links)):
        assert other.struts == arm.struts and other.rest_lengths == arm.rest_lengths
    with_spring, without = (a.modes(lock=["hinge", "knee"]).frequencies for a in (crane(LIFT), crane()))
    assert (with_spring > without * 1.001).all()


def test_the_table_of_an_arm_tells_its_struts() -> None:
    text = crane(LIFT, ROPE).describe()
    for word in ("lift", "rope", "tendon", "boom 0.6 m", "world (0.3, -0.4, 0)", "jib end + (0, 0.05, 0)", "4000"):
        assert word in text
    assert "2 struts" in repr(crane(LIFT, ROPE)) and "strut" not in repr(crane()) + crane().describe()
