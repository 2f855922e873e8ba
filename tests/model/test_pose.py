"""q of named joints."""

import flexarm as fa
import numpy as np
import pytest
from messages import refuses
from scipy.spatial.transform import Rotation

BODY = fa.RigidBody(1.0, inertia=(1.0, 1.0, 1.0), end=(0.4, 0.0, 0.0))


def beam() -> fa.Beam:
    return fa.Beam(0.5, fa.Rectangle(0.01, 0.02), fa.Material(2700, 70e9, 0.33), {"bending_y": 2})


@pytest.fixture(scope="module")
def arm() -> fa.Arm:
    return fa.Arm(
        [
            fa.Link(fa.Revolute("z", name="shoulder"), beam=beam(), name="upper"),
            fa.Link(fa.Revolute("z", name="elbow"), BODY, beam()),
            fa.Link(fa.Universal(name="wrist"), BODY),
            fa.Link(fa.Spherical(name="hand"), BODY),
        ]
    )


def test_named_joints_stand_where_they_are_put(arm: fa.Arm) -> None:
    q = arm.pose({"elbow": 0.3, "upper": -0.2, ("wrist", 1): 0.7})
    put = dict(zip(arm.q_names, q, strict=True))
    moved = {name: value for name, value in put.items() if value}
    ball = next(name for name in arm.q_names if name.endswith("quaternion w"))
    assert sorted(moved.values()) == [-0.2, 0.3, 0.7, 1.0] and moved[ball] == 1.0
    # two turns about z, the beams straight: elementary geometry
    elbow, angle = np.array([0.5 * np.cos(0.2), -0.5 * np.sin(0.2), 0.0]), 0.3 - 0.2
    end = elbow + 0.9 * np.array([np.cos(angle), np.sin(angle), 0.0])
    np.testing.assert_allclose(arm.frame(q, "elbow")[0], end, atol=1e-14)
    np.testing.assert_array_equal(arm.pose({}), arm.zero)
    np.testing.assert_array_equal(arm.pose({-2: [0.1, 0.2]}), arm.pose({("wrist", 0): 0.1, (2, 1): 0.2}))


@pytest.mark.parametrize("turn", [(0.3, -1.2, 0.4), (0.0, 0.0, 0.0), (1e-9, 0.0, 0.0), (4.0, 0.0, 0.0)])
def test_balls_by_a_rotation_vector_or_a_quaternion(arm: fa.Arm, turn: tuple[float, ...]) -> None:
    there = Rotation.from_rotvec(turn)
    quaternion = there.as_quat()[[3, 0, 1, 2]]
    for given in (turn, quaternion):
        np.testing.assert_allclose(arm.frame(arm.pose({"hand": given}))[1], there.as_matrix(), atol=1e-14)


def test_a_pose_will_do_wherever_a_q_is_asked_for(arm: fa.Arm) -> None:
    two = fa.Arm(arm.links[:2], (0, -9.81, 0))
    named, q = {"elbow": 1.1}, two.pose({"elbow": 1.1})
    still = np.zeros(two.nv)
    np.testing.assert_array_equal(two.frame(named)[0], two.frame(q)[0])  # type: ignore[arg-type]
    np.testing.assert_array_equal(two.bias(named, still), two.bias(q, still))  # type: ignore[arg-type]
    a, b = (two.modes(x, lock=["shoulder", "elbow"]) for x in (named, q))
    np.testing.assert_array_equal(a.frequencies, b.frequencies)
    assert abs(two.modes(lock=["shoulder", "elbow"]).frequencies[0] / a.frequencies[0] - 1) > 0.01
    np.testing.assert_array_equal(two.trim(named).q, two.trim(q).q)
    hold = {"drive": {0: fa.Motion([0, 1], [0, 0])}}
    first, second = (fa.simulate(two, [0, 0.01], x, **hold) for x in (named, q))
    assert (first.q == second.q).all() and first.q[0, 3] == 1.1


WRONG = [
    ({"elbo": 0.3}, ("joints", "link = 'elbo'", "'elbow'")),
    ({"elbow": [0.3, 0.1]}, ("joints", "'elbow'", "0.3", "0.1", "number")),
    ({"elbow": "far"}, ("joints", "'elbow'", "'far'", "numbers")),
    ({"elbow": np.nan}, ("joints", "'elbow'", "nan", "finite")),
    ({"wrist": 0.3}, ("joints", "'wrist'", "0.3", "2", "numbers")),
    ({"hand": 0.3}, ("'hand'", "0.3", "4", "numbers", "a ball")),
    ({"hand": [0, 0, 0, 0]}, ("quaternion", "hand")),
    ({("hand", 0): 0.3}, ("ball", "angle")),
    ({"elbow": 0.1, 1: 0.2}, ("joints", "link = 1")),
    ([0.3], "joints = [0.3]"),
]


@pytest.mark.parametrize(("joints", "message"), WRONG)
def test_wrong_poses(arm: fa.Arm, joints, message: str) -> None:
    with refuses(message):
        arm.pose(joints)


def test_too_few_coordinates_say_how(arm: fa.Arm) -> None:
    for ask in (arm.frame, arm.modes, arm.equilibrium, lambda q: fa.simulate(arm, [0, 1], q)):
        with refuses("has shape (2,)", "arm.pose({0: 0.3})"):
            ask([0.1, 0.2])


def test_whoever_takes_a_state_tells_of_pose_and_takes_its_dictionary() -> None:
    beam = fa.Beam(0.5, fa.Rectangle(0.004, 0.02), fa.Material(2700, 70e9, 0.3), {"bending_y": 2}, damping_ratio=0.01)
    two = fa.Arm([fa.Link(fa.Revolute("z"), beam=beam), fa.Link(fa.Revolute("z"), beam=beam, name="fore")])
    q = two.pose({"fore": 0.4})
    for ask in (
        lambda q: fa.lqr(two, q).K,
        two.linearize,
        two.equilibrium,
        lambda q: two.modes(q).frequencies,
        lambda q: fa.closed_loop(two, fa.StateFeedback(np.ones((1, 12)), q0=q)).growth,
    ):
        with refuses("has shape (2,)", "6 numbers", "arm.pose"):
            ask([0.2, -0.2])
    assert (fa.lqr(two, {"fore": 0.4}).K == fa.lqr(two, q).K).all()
    assert (two.modes({"fore": 0.4}).frequencies == two.modes(q).frequencies).all()
