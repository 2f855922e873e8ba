"""Orientations where their coordinates fail: Euler angles at their singularity, quaternions that drift."""

import flexarm as fa
import numpy as np
import pytest
from messages import refuses
from stability import balls


@pytest.mark.parametrize("gap", [0.3, 1e-2, 1e-4])
def test_euler_joints_are_ill_conditioned_near_their_singularity(gap: float) -> None:
    """cond M = (1 + sin)/(1 - sin) of the second angle, 4/gap^2 nearby; a ball's is 1 everywhere."""
    s = np.cos(gap)
    assert balls.euler_condition(gap) == pytest.approx((1 + s) / (1 - s), rel=1e-6)
    arm = fa.Arm([fa.Link(fa.Spherical(), fa.RigidBody(1.0, inertia=(1, 1, 1)))])
    assert np.linalg.cond(arm.mass_matrix([0.5, 0.5, -0.5, 0.5])) == pytest.approx(1.0)


def test_a_ball_passes_where_euler_angles_stop() -> None:
    """The steps of Euler joints grow with log(1/gap) until they collapse, which is reported at the right time; a ball
    takes the same few steps at any distance."""
    ball = [balls.passage("ball", gap) for gap in (0.3, 1e-4, 1e-8, 0.0)]
    taken = [b["steps"] for b in ball]
    assert max(taken) < 1.2 * min(taken)  # nothing in the way
    assert max(b["error"] for b in ball) < 2e-8
    euler = [balls.passage("euler", gap) for gap in (0.3, 1e-2, 1e-4)]
    steps = [e["steps"] for e in euler]
    assert steps[2] > 1.4 * steps[1] > 2 * steps[0] and steps[2] > 10 * ball[0]["steps"]
    lost = balls.passage("euler", 1e-8)
    assert lost["failed"] and lost["time"] == pytest.approx(1.0, abs=1e-6)


def test_euler_joints_at_the_singularity_are_refused() -> None:
    arm = fa.Arm([fa.Link(fa.Axes(axes=balls.EULER), fa.RigidBody(1.0, inertia=(1, 1, 1)))])
    with refuses("positive", "definite"):
        arm.forward_dynamics([0.3, np.pi / 2, 0.2], [1.0, 1.0, 1.0])


def test_a_quaternion_drifts_unless_it_is_pulled_back() -> None:
    naive, pulled = balls.quaternion_length(False), balls.quaternion_length(True)
    assert naive[-1] / naive[50] == pytest.approx(2.0, rel=0.2)  # steadily
    assert abs(naive[-1]) > 5 * np.abs(pulled).max()
    assert np.abs(pulled[50:]).max() < 1.5 * np.abs(pulled[:51]).max()


def test_a_long_run_keeps_length_energy_and_momentum() -> None:
    found = balls.long_run(300.0)
    assert found["length"] < 1e-15 * 2
    assert found["energy"] < 1e-5 and found["momentum"] < 1e-5


def test_a_rigid_arm_that_lines_up_is_not_told_of_order_0() -> None:
    """Two slides lie along each other where the joint between them is at 90 degrees: the message names what is so."""
    joint = fa.Axes(axes=("tx", "ry", "tz"))
    arm = fa.Arm([fa.Link(joint, fa.RigidBody(1.0, (0.1, 0.0, 0.0), (0.1, 0.1, 0.1)))])
    q = [0.0, np.pi / 2, 0.0]
    for method in ("ab", "ci"):
        with refuses("positive definite", "line up") as said:
            arm.forward_dynamics(q, np.zeros(3), np.ones(3), method)
        assert "order 0" not in str(said.value)
