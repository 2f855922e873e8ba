"""Loops: their joints as those of links, places, names and checks; positions and rates that close them; what rebuilds
an arm has them."""

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
from scipy.spatial.transform import Rotation

A, B, C, D = 0.2, 0.6, 0.5, 0.7  # m: crank, coupler, rocker, ground
FOOT = fa.Loop((D, 0, 0), "rocker", fa.Revolute("z"), name="foot")


def bar(length: float) -> fa.RigidBody:
    return fa.RigidBody(1.0, (0.5 * length, 0, 0), (0.001, 0.02, 0.02), (length, 0, 0))


def four_bar(*loops: fa.Loop, **more: Any) -> fa.Arm:
    parts = (("crank", A), ("coupler", B), ("rocker", C))
    links = [fa.Link(fa.Revolute("z"), bar(length), name=name) for name, length in parts]
    return fa.Arm(links, (0, -9.81, 0), loops=loops or (FOOT,), **more)


def closed_form(crank: float) -> tuple[float, float]:
    """Angles of the coupler against the crank and of the rocker against the coupler: the circles about the crank's end
    and the foot meet above."""
    p = A * np.array([np.cos(crank), np.sin(crank)])
    way = np.array([D, 0.0]) - p
    far = float(np.hypot(*way))
    along = (B**2 - C**2 + far**2) / (2 * far)
    up = np.array([-way[1], way[0]]) / far
    joint = p + along * way / far + np.sqrt(B**2 - along**2) * up
    first, second = (float(np.arctan2(*x[::-1])) for x in (joint - p, np.array([D, 0.0]) - joint))
    return first - crank, second - first


PLACED = {
    "inboard": fa.Placement((0.03, -0.02, 0.05), (0.3, -0.2, 0.4)),
    "outboard": fa.Placement((0.02, 0.04, -0.01), (-0.5, 0.1, 0.7)),
}
AXIS = (1.0, 2.0, -0.5)
JOINTS = {
    "fixed": (fa.Fixed(**PLACED), []),
    "revolute": (fa.Revolute(AXIS, **PLACED), [0.4]),
    "revolute x": (fa.Revolute("x"), [-0.9]),
    "prismatic": (fa.Prismatic(AXIS, **PLACED), [0.11]),
    "prismatic y": (fa.Prismatic("y", **PLACED), [-0.07]),
    "cylindrical": (fa.Cylindrical(AXIS, **PLACED), [0.1, -0.7]),
    "cylindrical z": (fa.Cylindrical("z"), [0.1, 2.7]),
    "universal": (fa.Universal(**PLACED), [0.4, -1.1]),
    "planar": (fa.Planar(**PLACED), [0.1, -0.05, 0.8]),
    "spherical": (fa.Spherical(**PLACED), [0.8, 0.2, -0.4, 0.4]),
}
SHIFT = (0.01, 0.02, -0.03)


@pytest.mark.parametrize("name", JOINTS)
def test_a_loop_holds_what_the_same_joint_of_a_link_holds(name: str) -> None:
    """A body on that joint, on a slice of a beam, stands and moves as a free body that the loop joins to the slice."""
    joint, own = JOINTS[name]
    place = joint.inboard or fa.Placement()
    shifted = fa.Placement(np.add(place.position, SHIFT), place.rotation)
    beam = fa.Beam(0.8, fa.Rectangle(0.02, 0.03), STEEL, {"bending_y": 2}, "legendre")
    boom = fa.Link(fa.Revolute("y"), beam=beam, name="boom")
    body = fa.RigidBody(1.0, (0.1, 0, 0), (0.01, 0.02, 0.03))
    tree = fa.Arm([boom, fa.Link(replace(joint, inboard=shifted), body, name="body", at=0.3)])
    loop = fa.Loop(fa.Point("boom", 0.3, SHIFT), ("body", "origin"), joint)
    arm = fa.Arm([boom, fa.Link(fa.Free(), body, name="body", parent="world")], loops=[loop])

    rng = np.random.default_rng(3)
    q, v = np.array([0.3, 0.02, -0.05, *own]), rng.normal(size=tree.nv)
    p, R = tree.frame(q, "body")
    quaternion = Rotation.from_matrix(R).as_quat(canonical=True)[[3, 0, 1, 2]]
    speed = tree.velocity(q, v, "body")
    at, rates = np.array([*q[:3], *p, *quaternion]), np.array([*v[:3], *speed[:3], *R.T @ speed[3:]])
    g, rate = arm.loop_motion(at, rates)
    held = 6 - joint.nv
    np.testing.assert_allclose(g, 0.0, atol=1e-14)
    np.testing.assert_allclose(rate, 0.0, atol=1e-13)
    assert g.shape == (held,) and arm.mobility(at) == (arm.nv - held, held, 0)
    sign = np.sign(own[0]) if joint.ball else 1.0
    np.testing.assert_allclose(arm.loop_place(at), sign * np.array(own), atol=1e-14)

    J, h = arm.loop_jacobian(at), 1e-6
    off = rng.normal(size=arm.nv)
    np.testing.assert_allclose(arm.loop_motion(at, off)[1], J @ off, atol=1e-13)
    turned = Rotation.from_quat(quaternion[[1, 2, 3, 0]])
    ends = []
    for sign in (1, -1):
        step = sign * h * off
        there = (turned * Rotation.from_rotvec(step[6:])).as_quat()[[3, 0, 1, 2]]
        ends.append(arm.loop_motion([*(at[:6] + step[:6]), *there])[0])
    np.testing.assert_allclose((ends[0] - ends[1]) / (2 * h), J @ off, atol=1e-8)


def test_a_four_bar_is_assembled_as_circles_meet() -> None:
    arm = four_bar()
    for crank in np.linspace(-3, 3, 7):
        wanted = np.array(closed_form(crank))
        q, v = arm.assemble([crank, wanted[0] + 0.3, wanted[1] - 0.2], [2.0, 0, 0], hold=["crank"])
        np.testing.assert_allclose(q[1:], wanted, atol=1e-12)
        slope = (np.array(closed_form(crank + 1e-5)) - closed_form(crank - 1e-5)) / 2e-5
        assert q[0] == crank and v[0] == 2.0
        np.testing.assert_allclose(v[1:], 2.0 * slope, atol=1e-8)
        assert abs(arm.loop_motion(q)[0]).max() < 1e-14 and abs(arm.loop_motion(q, v)[1]).max() < 1e-14


def test_mobility_counts_what_is_redundant() -> None:
    """A planar four-bar is three times overclosed in space; with a ball and a universal joint in place it is not."""
    arm = four_bar()
    q = arm.assemble({"crank": 0.5}, hold=[0])
    assert arm.mobility(q) == (1, 5, 3)
    assert four_bar(replace(FOOT, joint=fa.Spherical())).mobility(q) == (1, 3, 1)
    assert four_bar(replace(FOOT, stiffness=1e6)).mobility(q) == (3, 2, 2)
    assert "3 of them redundant; free motions: 1" in str(arm) and "foot" in str(arm)
    stretched = four_bar(replace(FOOT, a=(A + B + C, 0, 0)))
    assert stretched.mobility(stretched.zero) == (2, 5, 4)  # a dead centre


def test_a_stretched_start_is_no_obstacle() -> None:
    arm = four_bar()
    assert abs(arm.loop_motion(arm.zero)[0]).max() == pytest.approx(A + B + C - D)
    assert abs(arm.loop_motion(arm.assemble())[0]).max() < 1e-12


def test_beams_bend_where_joints_alone_do_not_close() -> None:
    beam = fa.Beam(0.6, fa.Rectangle(0.004, 0.02), STEEL, {"bending_y": 3}, "legendre", "exact")
    arm = fa.Arm([fa.Link(fa.Fixed(), beam=beam)], loops=[fa.Loop((0.595, 0.05, 0), 0, fa.Spherical())])
    q = arm.assemble()
    np.testing.assert_allclose(arm.frame(q)[0], [0.595, 0.05, 0], atol=1e-13)
    hinged = fa.Arm([fa.Link(fa.Revolute("z"), beam=beam)] * 2, loops=[fa.Loop((1.0, 0, 0), 1, fa.Spherical())])
    q = hinged.assemble([0.4, 0, 0, 0, -0.9, 0, 0, 0])
    assert not q[[1, 2, 3, 5, 6, 7]].any()
    np.testing.assert_allclose(hinged.frame(q)[0], [1.0, 0, 0], atol=1e-13)


def test_what_cannot_be_closed_is_named_with_its_gap() -> None:
    far = four_bar(replace(FOOT, a=(2.0, 0, 0)))
    with refuses("loop 'foot'", "0.7 m", "do not reach"):
        far.assemble()
    with refuses("loop 'foot'", "0.6 m", "no joint is left"):
        four_bar().assemble(hold=[0, 1, 2])
    with refuses("hold: link = 'cramk'", "crank"):
        four_bar().assemble(hold=["cramk"])
    q = four_bar().assemble({"crank": 0.5}, hold=["crank"])
    with refuses("loop 'foot'", "m/s"):
        four_bar().assemble(q, [1.0, 0, 0], hold=[0, 1])


def test_an_arm_with_loops_comes_back_from_its_dictionary_and_its_pickle() -> None:
    soft = fa.Loop("coupler", (0, 1, 0), fa.Cylindrical((1, 1, 0)), stiffness=1e5, damping=3.0, angular_stiffness=40.0)
    arm = four_bar(FOOT, soft)
    assert arm.loops == (FOOT, soft) and arm.loop_names == ("foot", "loop 1")
    assert fa.Arm.from_dict(arm.to_dict()) == arm == pickle.loads(pickle.dumps(arm))
    assert arm != four_bar() and "loop" not in fa.Arm(arm.links).to_dict()
    table = {"a": [D, 0, 0], "b": "rocker", "joint": {"type": "revolute", "axis": "z"}, "name": "foot"}
    assert fa.Arm.from_dict({**four_bar().to_dict(), "loop": [table]}) == four_bar()
    assert "2 loops" in repr(arm) and arm.rigid_rows.tolist() == [True] * 5 + [False] * 4


def test_numbers_of_loops_vary() -> None:
    soft = replace(FOOT, stiffness=1e5, angular_stiffness=2.0)
    setup = Setup(four_bar(soft))
    values = {"loop.foot.stiffness": [1e4, 1e5], "loop.0.a.offset.0": [0.6, D], "loop.foot.angular_damping": [0.0, 1.0]}
    found = Variation(setup, values)
    moved = found.scenario(0).arm
    assert (moved.loops[0].stiffness, moved.loops[0].a.offset) == (1e4, (0.6, 0.0, 0.0))
    assert found.scenario(1).arm.loops[0].angular_damping == 1.0 and moved.loop_names == ("foot",)


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: replace(FOOT, joint=fa.Free()), ("joint = Free", "Spherical")),
        (lambda: replace(FOOT, joint=fa.Axes(axes=["rz"])), ("joint = Axes", "Revolute")),
        (lambda: replace(FOOT, joint="revolute"), ("joint = 'revolute'", "Joint")),
        (lambda: replace(FOOT, joint=fa.Revolute(damping=2.0)), ("joint", "damping = 2.0", "another joint")),
        (lambda: replace(FOOT, joint=fa.Revolute(coulomb=2.0)), ("joint", "coulomb = 2.0")),
        (lambda: replace(FOOT, joint=fa.Revolute(lower=-1.0, limit_stiffness=1.0)), ("joint", "lower = -1.0")),
        (lambda: replace(FOOT, joint=fa.Revolute(torque_limit=1.0)), ("joint", "torque_limit = 1.0")),
        (lambda: replace(FOOT, joint=fa.Revolute(name="pin")), ("joint", "name = 'pin'", "None")),
        (lambda: replace(FOOT, stiffness=0.0), ("stiffness = 0", "positive")),
        (lambda: replace(FOOT, damping=1.0), ("damping = 1", "stiffness (N/m)")),
        (lambda: replace(FOOT, angular_damping=1.0), ("angular_damping = 1", "angular_stiffness (N m/rad)")),
        (lambda: replace(FOOT, joint=fa.Spherical(), angular_stiffness=1.0), ("angular_stiffness = 1", "spherical")),
        (lambda: replace(FOOT, name="loop 0"), ("name = 'loop 0'",)),
        (lambda: replace(FOOT, a=0.5), ("a = 0.5", "Point")),
        (lambda: four_bar(replace(FOOT, b="rokcer")), ("loops[0]: b.link = 'rokcer'", "rocker")),
        (lambda: four_bar(replace(FOOT, a=("coupler", 0.1))), ("loops[0]: a.at = 0.1", "no beam")),
        (lambda: four_bar(replace(FOOT, a=("rocker", "origin"))), ("loops[0]", "rigid body")),
        (lambda: four_bar(replace(FOOT, a=(0, 0, 0), b=(1, 0, 0))), ("loops[0]", "rigid body")),
        (lambda: four_bar(FOOT, FOOT), ("loops[1]: name = 'foot'", "loops[0]")),
        (lambda: four_bar(replace(FOOT, name="crank")), ("loops[0]: name = 'crank'", "link")),
        (lambda: four_bar("foot"), ("loops[0] = 'foot'", "Loop")),
        (lambda: fa.Arm(four_bar().links, loops=FOOT), ("loops", "list")),
        (lambda: four_bar().frame(np.zeros(3), "foot"), ("link = 'foot'", "loop")),
        (lambda: four_bar().loop_place(np.zeros(3), "food"), ("loop = 'food'", "foot")),
        (lambda: fa.Arm(four_bar().links).loop_place(np.zeros(3)), ("loop = -1", "none")),
        (lambda: four_bar().loop_motion(np.zeros(2)), ("q has shape (2,)",)),
    ],
)  # fmt: skip
def test_what_is_refused_is_named(make: Any, named: tuple[str, ...]) -> None:
    with refuses(*named):
        make()
