"""A pose in balance, and what holds it."""

from __future__ import annotations

import flexarm as fa
import numpy as np
import pytest
from arms import STEEL
from messages import refuses, warns


def boom(order: int | str = 2) -> fa.Arm:
    beam = fa.Beam(0.5, fa.Rectangle(0.004, 0.02), STEEL, {"bending_y": 3}, order=order)
    link = fa.Link(fa.Revolute("z"), fa.RigidBody(0.5, inertia=(1e-3, 1e-3, 2e-3), end=(0.075, 0, 0)), beam)
    return fa.Arm([link, link], (0, -9.81, 0))


def test_nothing_moves_and_the_moments_are_those_of_the_weight() -> None:
    arm = boom()
    q, tau = arm.trim({0: 0.3, 1: -0.8})
    assert q[0] == 0.3 and q[4] == -0.8 and q[[1, 5]].all() and not tau[[1, 2, 3, 5, 6, 7]].any()
    assert np.abs(arm.forward_dynamics(q, np.zeros(8), tau)).max() < 1e-6
    # the shoulder holds the moment of the weight about it
    weight = 9.81 * sum(link.mass for link in arm.links)
    assert tau[0] == pytest.approx(weight * arm.center_of_mass(q)[0], rel=1e-9)
    arm.linearize(q, tau=tau)  # a warning is an error here
    still = fa.simulate(arm, [0.0, 0.5], q, tau=tau)
    assert np.abs(still.q - q).max() < 1e-6
    assert arm.trim(q).q == pytest.approx(q, abs=1e-12)


def test_linearize_points_at_it() -> None:
    with warns(fa.errors.StateWarning, "q, tau = arm.trim(q)"):
        boom().linearize(np.zeros(8))


def test_a_column_that_buckles_is_said_so() -> None:
    beam = fa.Beam(1.0, fa.Rectangle(0.001, 0.02), STEEL, {"bending_y": 3}, "legendre", "exact")
    arm = fa.Arm([fa.Link(fa.Revolute("z"), beam=beam, tip=fa.RigidBody(0.05))], (0, -9.81, 0))
    assert abs(arm.trim({0: 1.5}).q[1]) > 0.1  # it hangs over
    with refuses("q", "nan"):
        arm.trim([np.nan, 0, 0, 0])
    with refuses("joints", "0", "1", "number"):
        arm.trim({0: [1, 2]})
    with refuses("link = 7"):
        arm.trim({7: 0.0})
    ball = fa.Arm([fa.Link(fa.Spherical(), fa.RigidBody(1.0, inertia=(1, 1, 1)))])
    with pytest.raises(ValueError):
        ball.trim({0: 1.0})
