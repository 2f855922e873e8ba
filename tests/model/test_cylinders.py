"""Cylinders, struts with a mass: the links, coordinates and loops that they are in an arm; checks; what rebuilds it."""

from __future__ import annotations

import copy
import pickle
from dataclasses import replace
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from arms import STEEL
from flexarm.arm.variation import Setup, Variation
from messages import refuses

LIFT = fa.Strut((0.3, -0.4, 0), ("boom", 0.6), stiffness=4e3, mass=2.0, name="lift")
FOLD = fa.Strut(("boom", 0.8), fa.Point("jib", "origin", (0.2, 0.1, 0)), mass=1.0, name="fold")


def crane(*struts: fa.Strut | fa.Tendon, **more: Any) -> fa.Arm:
    beam = fa.Beam(1.0, fa.Rectangle(0.02, 0.03), STEEL, {"bending_y": 2}, "legendre")
    jib = fa.RigidBody(2.0, (0.3, 0, 0), (0.01, 0.02, 0.02), (0.6, 0, 0))
    links = [fa.Link(fa.Revolute("z"), beam=beam, name="boom"), fa.Link(fa.Revolute("z"), jib, name="jib")]
    return fa.Arm(links, (0, -9.81, 0), struts, **more)


def test_a_cylinder_is_two_links_and_a_loop() -> None:
    rope = fa.Tendon([(0, 0.5, 0), "boom"], stiffness=1e3, name="rope")
    arm = crane(LIFT, FOLD, rope)
    assert arm.names == ("boom", "jib", "lift mount", "lift", "fold mount", "fold")
    assert arm.loop_names == ("lift end", "fold end") and arm.strut_names == ("lift", "fold", "rope")
    assert arm.coordinates[4:] == ("lift mount", "lift", "fold mount", "fold")
    assert [x.mass for x in arm.links[2:]] == [0.0, 2.0, 0.0, 1.0]
    assert (arm.mobility(arm.zero).freedoms, arm.ends, arm._link(-1)) == (4, [1], 1)
    lengths = arm.strut_motion(arm.zero)[0][:2]
    assert lengths == pytest.approx([0.5, np.hypot(0.4, 0.1)]) == arm.zero[[5, 7]]
    assert arm.zero == pytest.approx(arm.assemble(arm.zero), abs=1e-12)
    with refuses("link = -3", "from -2 to 5"):
        arm.frame(arm.zero, -3)


@pytest.mark.parametrize("strut", [LIFT, replace(LIFT, a=LIFT.b, b=LIFT.a)], ids=["on the world", "on the boom"])
def test_cylinders_follow_their_points(strut: fa.Strut) -> None:
    """Those that the others do not leave where they are."""
    arm, rng = crane(strut, FOLD), np.random.default_rng(2)
    for _ in range(5):
        pose = arm.zero
        pose[:4] += rng.uniform(-0.6, 0.6, 4)
        q = arm.assemble(pose)
        assert q[:4] == pytest.approx(pose[:4], abs=1e-12)
        named = {"boom": pose[0], "jib": pose[3]}
        assert arm.pose(named) == pytest.approx(arm.assemble(named, hold=["boom", "jib"]), abs=1e-12)
        assert arm.pose(named | {"lift": 0.77})[5] == 0.77
        assert q[[5, 7]] == pytest.approx(arm.strut_motion(q)[0], abs=1e-14)
        v = arm.assemble(q, np.r_[rng.normal(size=4), np.zeros(4)], hold=["boom", "jib"])[1]
        assert v[[5, 7]] == pytest.approx(arm.strut_motion(q, v)[1], abs=1e-11)


def test_a_cylinder_in_space_turns_about_two_axes() -> None:
    body = fa.RigidBody(1.0, (0.3, 0, 0), (0.01, 0.02, 0.02), (0.6, 0, 0))
    links = [fa.Link(fa.Revolute("z"), body, name="base"), fa.Link(fa.Revolute("y"), body, name="boom")]
    below = fa.Point("base", offset=(0, 0, -0.4))
    for a, two in (((0.2, -0.7, 0.4), True), (("base", "origin"), False), (below, False)):
        jack = fa.Strut(a, fa.Point("boom", "origin", (0.3, 0, 0.05)), mass=1.0, name="jack")
        arm = fa.Arm(links, struts=[jack])
        assert arm["jack mount"].joint.nv == 1 + two
        for q in np.random.default_rng(1).uniform(-0.5, 0.5, (5, 2)):
            q = arm.assemble({"base": q[0], "boom": q[1]})
            assert q[-1] == pytest.approx(arm.strut_motion(q)[0][0], abs=1e-14)
            assert np.abs(arm.loop_motion(q)[0]).max() < 1e-12


def test_an_arm_with_cylinders_is_rebuilt_with_them() -> None:
    pin = fa.Loop((1.5, 0, 0), "jib", fa.Revolute("z"), stiffness=1e5, name="pin")
    arm = crane(LIFT, FOLD, loops=[pin])
    table = arm.to_dict()
    assert (len(table["link"]), len(table["strut"]), len(table["loop"])) == (2, 2, 1)
    again = fa.Arm.from_dict(table), pickle.loads(pickle.dumps(arm)), copy.deepcopy(arm)
    for other in (*again, arm._alike(arm.links, arm.gravity)):
        assert other == arm and other.names == arm.names and np.array_equal(other.zero, arm.zero)
    values = {"strut.lift.mass": np.array([3.0]), "strut.fold.b.offset.0": np.array([0.25]),
              "link.boom.beam.length": np.array([1.1]), "loop.pin.stiffness": np.array([2e5])}  # fmt: skip
    made = Variation(Setup(arm), values).scenario(0).arm
    boom = replace(arm.links[0], beam=replace(arm.links[0].beam, length=1.1))
    fold = replace(FOLD, b=fa.Point("jib", "origin", (0.25, 0.1, 0)))
    assert made == fa.Arm([boom, arm.links[1]], arm.gravity, [replace(LIFT, mass=3.0), fold], (),
                          [replace(pin, stiffness=2e5)])  # fmt: skip
    for path in ("link.lift.hub.mass", "link.fold mount.joint.damping"):
        with refuses("strut", path.split(".")[1]):
            Variation(Setup(arm), {path: np.array([1.0])}).scenario(0)


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: replace(LIFT, mass=0.0), ("mass = 0",)),
        (lambda: replace(LIFT, name=None), ("mass = 2", "name")),
        (lambda: crane(replace(LIFT, name="boom")), ("struts[0]", "'boom'", "a link or a joint")),
        (lambda: crane(replace(LIFT, name="jib"), replace(LIFT, name="boom mount")), ("'jib'",)),
        (lambda: crane(replace(LIFT, a=("boom", "origin"), b="jib")), ("struts[0].a", "boom", "mass = 2")),
        (lambda: crane(replace(LIFT, a=("boom", 0.0), b="jib")), ("struts[0].a", "boom", "mass = 2")),
        (lambda: crane(LIFT, loops=[fa.Loop("jib", (1.6, 0, 0), fa.Spherical(), name="lift end")]), ("'lift end'",)),
        (lambda: fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, (0.5, 0, 0), np.eye(3), (1, 0, 0)), name="boom")],
                        struts=[fa.Strut((1, 0, 0), "boom", length=1.0, mass=1.0, name="lift")]),
         ("struts[0]", "mass = 1", "length is zero")),
    ],
)  # fmt: skip
def test_what_is_refused_is_named(make: Any, named: tuple[str, ...]) -> None:
    with refuses(*named):
        make()
