"""Far from rest: many turns of twist, the smallest tilts, and numbers that no arm ever has."""

from __future__ import annotations

import functools
import warnings
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from messages import refuses
from scipy.spatial.transform import Rotation

STEEL = fa.Material(7850, 209e9, 0.3)
STRIP = fa.Rectangle(0.004, 0.01)
BODY = fa.RigidBody(0.5, (0.02, 0.03, -0.01), (1e-3, 2e-3, 1.5e-3), (0.1, 0, 0))
GRAVITY = (1.0, 2.0, -9.81)


def rod(modes: dict[str, int], order: Any = 2) -> fa.Beam:
    return fa.Beam(0.5, STRIP, STEEL, modes, order=order)


def twisted(order: Any = 2) -> fa.Arm:
    """A rod that only twists, and carries a body on a hinge across it."""
    return fa.Arm([fa.Link(fa.Fixed(), beam=rod({"torsion": 1}, order)), fa.Link(fa.Revolute("y"), BODY)], GRAVITY)


def hinged() -> tuple[fa.Arm, float]:
    """The same without a rod: a hinge with its stiffness and its inertia, in radians of the rod's end; and these
    radians for one of the rod's coordinate."""
    alone = fa.Arm([fa.Link(fa.Fixed(), beam=rod({"torsion": 1}))])
    turn = alone.jacobian([0.0])[3, 0]
    stiffness = alone.inverse_dynamics([1.0], [0.0], [0.0])[0] / turn**2
    joint = fa.Revolute("x", stiffness=stiffness, reflected_inertia=alone.mass_matrix([0.0])[0, 0] / turn**2)
    return fa.Arm([fa.Link(joint), fa.Link(fa.Revolute("y"), BODY)], GRAVITY), turn


@pytest.mark.parametrize("order", [1, 2, 3])
def test_a_rod_twisted_by_many_turns_is_a_hinge(order: Any) -> None:
    arm, (hinge, turn) = twisted(order), hinged()
    angles = np.concatenate([[9, 11, 13, 30], np.linspace(-30, 30, 301)])
    q = np.column_stack([angles / turn, 0.7 + 0 * angles])
    v, tau, scale = np.array([8.0 / turn, -3.0]), np.array([0.02 * turn, 0.1]), np.array([turn, 1.0])
    expected = hinge.forward_dynamics(q * scale, v * scale, tau / scale) / scale
    for method in ("ab", "ci"):
        a = arm.forward_dynamics(q, v, tau, method=method)
        assert abs(a - expected).max() < 1e-9 * abs(expected).max(axis=1).min()
    for k in range(4):  # and the hinge itself
        turned = Rotation.from_rotvec([angles[k], 0, 0]) * Rotation.from_rotvec([0, 0.7, 0])
        np.testing.assert_allclose(arm.frame(q[k])[1], turned.as_matrix(), atol=1e-13)


def test_a_rod_twisted_by_many_turns_keeps_its_energy() -> None:
    arm, (hinge, turn) = twisted(), hinged()
    q0, v0, t = np.array([11.0 / turn, 0.7]), np.zeros(2), np.linspace(0, 0.02, 5)
    scale = np.array([turn, 1.0])
    run = fa.simulate(arm, t, q0, v0, integrator="implicit", step=1e-5)
    energy = np.sum(arm.energy(run.q, run.v), axis=0)
    assert abs(energy - energy[0]).max() < 1e-5 * arm.energy(q0, v0)[1]
    other = fa.simulate(hinge, t, q0 * scale, v0, integrator="implicit", step=1e-5)
    np.testing.assert_allclose(run.q * scale, other.q, rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("turned", [0.9, 3.1, 3.3, 9.0, 30.0])
def test_both_methods_agree_however_far_beams_turn(order: int, turned: float) -> None:
    arm = fa.Arm(
        [
            fa.Link(fa.Revolute("z"), beam=rod({"bending_y": 2, "bending_z": 2, "torsion": 1}, order)),
            fa.Link(fa.Revolute("y"), BODY),
        ],
        GRAVITY,
    )
    rng = np.random.default_rng(5)
    size = turned / np.maximum(abs(arm.jacobian(arm.zero, link=0)[3:]).max(axis=0), 0.1)
    q, v = rng.uniform(-1, 1, (20, arm.nv)) * size, rng.uniform(-1, 1, (20, arm.nv))
    a, b = arm.forward_dynamics(q, v), arm.forward_dynamics(q, v, method="ci")
    M = arm.mass_matrix(q)
    left = np.einsum("kij,kj->ki", M, a - b)  # as forces, beside those that are there
    there = np.einsum("kij,kj->ki", abs(M), abs(b)) + abs(arm.bias(q, v))
    assert (abs(left).max(axis=1) < 1e-9 * there.max(axis=1)).all()


@pytest.mark.parametrize("tilt", [1e-14, 4e-8, -4e-8, 1e-6, -2e-6])
@pytest.mark.parametrize("along", [1.0, -1.0])
def test_the_smallest_tilt_acts(tilt: float, along: float) -> None:
    arm = fa.Arm([fa.Link(fa.Prismatic((0, tilt, along)), BODY)], gravity=(0, 10.0, 0))
    expected = 10.0 * tilt / np.hypot(1.0, tilt)
    for method in ("ab", "ci"):
        np.testing.assert_allclose(arm.forward_dynamics([0.0], [0.0], method=method), expected, rtol=1e-9)
    for integrator in ("implicit", "rk4", "gauss"):
        run = fa.simulate(arm, [0.0, 1.0], integrator=integrator, step=0.5)
        np.testing.assert_allclose(run.v[-1], expected, rtol=1e-9)


def test_a_first_factorisation_that_fails_under_control_is_an_error() -> None:
    beam = fa.Beam(0.5, fa.Rectangle(0.01, 0.02), STEEL, {"bending_y": 1}, order=0)
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(end=(0, 0.5, 0)), beam)])
    for start in (0.38, -0.38, 30.0, -30.0):
        try:
            run = fa.simulate(
                arm, [0, 0.4], [0, start], integrator="implicit", step=0.4, control=fa.PD(1, 1)
            )
        except (fa.SimulationError, ValueError):
            continue
        assert np.isfinite(run.q).all()


# -- absurd sizes ------------------------------------------------------------------------------------------------------

PIEZO = fa.Piezo(6e10, 0.3, 7800, d31=-1.8e-10, permittivity=3e-8)
PATCH = fa.Patch(0.02, 0.1, width=0.003, thickness=3e-4, material=PIEZO)
ALL = {"bending_y": 1, "bending_z": 1, "torsion": 1, "shear_y": 1, "shear_z": 1}


@functools.cache
def absurd_arms() -> dict[str, fa.Arm]:
    def arm(joint: fa.Joint, order: Any, modes: dict[str, int] = ALL) -> fa.Arm:
        beam = fa.Beam(0.5, STRIP, STEEL, modes, order=order, patches=[PATCH])
        return fa.Arm([fa.Link(joint, BODY, beam), fa.Link(fa.Revolute("y"), BODY)], GRAVITY)

    arms = {f"order {order}": arm(fa.Revolute("z"), order) for order in (0, 1, 2, 3, "exact")}
    return arms | {
        "plane": fa.Arm([fa.Link(fa.Revolute("z"), BODY, rod({"bending_y": 2}))]),
        "ball": arm(fa.Spherical(stiffness=2.0), 2),
        "free": arm(fa.Free(), 3, {"bending_y": 1}),
    }


def numbers(result: Any) -> list[np.ndarray[Any, Any]]:
    """All arrays of a result."""
    if isinstance(result, (tuple, list)):
        return [x for part in result for x in numbers(part)]
    if isinstance(result, (float, np.ndarray)):
        return [np.asarray(result)]
    return [x for part in vars(result).values() if isinstance(part, np.ndarray) for x in numbers(part)]


EVALUATIONS = {
    "forward ab": lambda a, q, v, x: a.forward_dynamics(q, v, x),
    "forward ci": lambda a, q, v, x: a.forward_dynamics(q, v, x, method="ci"),
    "inverse": lambda a, q, v, x: a.inverse_dynamics(q, v, x),
    "reaction": lambda a, q, v, x: a.joint_reaction(q, v, x, 0),
    "mass matrix": lambda a, q, v, x: a.mass_matrix(q),
    "bias": lambda a, q, v, x: a.bias(q, v),
    "energy": lambda a, q, v, x: a.energy(q, v),
    "frame": lambda a, q, v, x: a.frame(q),
    "slice": lambda a, q, v, x: a.frame(q, 0, 0.3),
    "jacobian": lambda a, q, v, x: a.jacobian(q),
    "jacobian rate": lambda a, q, v, x: a.jacobian_rate(q, v),
    "velocity": lambda a, q, v, x: a.velocity(q, v),
    "acceleration": lambda a, q, v, x: a.acceleration(q, v, x),
    "centre": lambda a, q, v, x: a.center_of_mass(q),
    "momentum": lambda a, q, v, x: a.momentum(q, v),
    "strain": lambda a, q, v, x: a.strain(q, 0),
    "deflection": lambda a, q, v, x: a.deflection(q, 0),
    "charge": lambda a, q, v, x: a.charge(q, 0) if a.patches else 0.0,
    "voltage": lambda a, q, v, x: a.patch_voltage(q, 0) if a.patches else 0.0,
    "inverse derivatives": lambda a, q, v, x: a.inverse_derivatives(q, v, x),
    "forward derivatives": lambda a, q, v, x: a.forward_derivatives(q, v, x),
    "linearize": lambda a, q, v, x: a.linearize(q, v, tau=x),
}


@pytest.mark.parametrize("evaluation", EVALUATIONS)
@pytest.mark.parametrize("name", absurd_arms())
def test_every_evaluation_is_finite_or_refused(name: str, evaluation: str) -> None:
    arm, evaluate = absurd_arms()[name], EVALUATIONS[evaluation]
    rng = np.random.default_rng(3)
    for size in (1e30, 1e100, 1e155, 1e160, 1e280, 1.7e308):
        for spoilt in range(3):
            x = [arm.zero, np.full(arm.nv, 0.1), np.full(arm.nv, 0.1)]
            for i in (slice(None), *rng.choice(len(x[spoilt]), 2, replace=False)):
                bad = [y.copy() for y in x]
                bad[spoilt][i] = size * (1 if isinstance(i, slice) else rng.choice([-1, 1]))
                try:
                    with warnings.catch_warnings():
                        warnings.simplefilter("ignore", fa.errors.RangeWarning)
                        result = evaluate(arm, *bad)
                except ValueError as error:
                    assert len(str(error)) > 10
                    continue
                assert all(np.isfinite(y).all() for y in numbers(result)), (size, spoilt, i)


@pytest.mark.parametrize("length", [0.0, 1e-160, 1e160])
def test_a_quaternion_without_a_usable_length_is_refused(length: float) -> None:
    arm = absurd_arms()["ball"]
    q = arm.zero
    q[:4] = length * np.array([0.5, -0.5, 0.5, 0.5])
    v = np.zeros(arm.nv)
    for call in (
        lambda: arm.frame(q),
        lambda: arm.inverse_derivatives(q, v, v),
        lambda: arm.linearize(q),
        lambda: arm.modes(q),
        lambda: arm.equilibrium(q),
        lambda: fa.simulate(arm, [0, 1e-3], q),
        lambda: fa.rollout(arm, q[None], v[None], np.zeros((1, 1, arm.nv)), step=1e-3),
    ):
        with refuses("link 0", "quaternion", "length"):
            call()
