"""Trees in commands: one hand on a path while the other rests, and a move of two arms that leaves both still."""

from __future__ import annotations

from dataclasses import replace

import flexarm as fa
import numpy as np
from arms import satellite, side_by_side, two_arms
from messages import refuses

T = np.linspace(0.0, 0.6, 61)
RISE = (T / 0.6) ** 5 * (126 - 420 * (T / 0.6) + 540 * (T / 0.6) ** 2 - 315 * (T / 0.6) ** 3 + 70 * (T / 0.6) ** 4)
REST = ["waist", "right shoulder", "right elbow"]


def path(arm: fa.Arm, q: np.ndarray, link: str) -> dict[str, fa.Motion]:
    x, y, _ = arm.frame(q, link)[0]
    return {"x": fa.Motion(T, x - 0.1 * RISE, ends="rest"), "y": fa.Motion(T, y + 0.05 * RISE, ends="rest")}


def test_one_hand_follows_a_path() -> None:
    """Its torques are those of that arm alone, and it stays on the path in a run."""
    arm = two_arms()
    q = arm.pose({"left elbow": 0.6, "right elbow": -0.5})
    found = fa.invert(arm, path(arm, q, "left fore"), q=q, link="left fore", lock=REST)
    run = found.replay()
    assert np.abs(found.tip_error(run)).max() < 1e-7
    assert np.abs(run.frame("right fore")[0] - arm.frame(q, "right fore")[0]).max() < 1e-12
    alone = fa.Arm([replace(arm.links[0], joint=fa.Fixed()), *arm.links[1:3]])
    one = fa.invert(alone, path(arm, q, "left fore"), q=alone.pose({"left elbow": 0.6}))
    rates = [x.joint_rate(k) for x in (arm, alone) for k in ("left shoulder", "left elbow")]
    mine = np.array([np.interp(one.t, found.t, found.tau[:, i]) for i in rates[:2]])
    theirs = one.tau[:, rates[2:]].T
    assert np.abs(mine - theirs).max() < 2e-3 * np.abs(theirs).max()


def test_the_other_arm_must_come_to_rest_too() -> None:
    arm = two_arms()
    q = arm.pose({"left elbow": 0.6, "right elbow": -0.5})
    with refuses("tip", "rest"):
        fa.invert(arm, path(arm, q, "left fore"), q=q, link="left fore")
    with refuses("arm", "bus free"):
        fa.invert(satellite(), {"x": fa.Motion(T, RISE, ends="rest")})
    found = fa.invert(arm, path(arm, q, "left fore"), q=q, link="left fore", lock=REST)
    moved = [replace(x, parent="world") if x.name == "right upper" else x for x in arm.links]
    with refuses("arm", "same joints"):
        found.replay(fa.Arm(moved))


def test_a_move_leaves_both_ends_still() -> None:
    """The flexible arm stands first in the list, a rigid one last, which a look at the last end alone would judge."""
    beam = fa.Beam(0.7, fa.Rectangle(0.004, 0.03), fa.Material(7850, 209e9, 0.3), {"bending_y": 1}, order=1)
    body = fa.RigidBody(0.1, inertia=(0, 0, 0.01))
    bent = fa.Arm([fa.Link(fa.Revolute("z"), body, beam, fa.RigidBody(0.2))])
    stiff = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(0.5, (0.3, 0, 0), (0.01,) * 3, (0.5, 0, 0)))])
    pair = side_by_side(bent, stiff)
    limits = {"acceleration": 20.0, "torque": 5.0}
    move = fa.plan_move(pair, [0.0, 0.0], [0.6, 0.3], limits=limits)
    assert move.residual_unshaped > 1e-3 and move.residual < 0.05 * move.residual_unshaped
    run = fa.simulate(pair, np.linspace(0.0, move.duration + 0.5, 301), drive=move.drive)
    after = pair.end_places(run.q)[run.t > move.duration]
    assert np.linalg.norm(after - after.mean(axis=0), axis=2).max() < 1.2 * move.residual + 1e-6
    assert len(move.plot().axes[-1].lines) == 2
