"""Loops whose joints have prescribed motions; and what a run says where loops cannot be closed any
further."""

from __future__ import annotations

from typing import Any

import flexarm as fa
import numpy as np
import pytest
from arms import STEEL
from messages import refuses

G = (0, -9.81, 0)
LENGTHS = {"crank": 0.2, "coupler": 0.6, "rocker": 0.5}
START = {"crank": 0.5, "coupler": 0.2, "rocker": 1.5}
RUNS: dict[str, dict[str, Any]] = {
    "gauss": {"integrator": "gauss", "step": 1e-3},
    "chosen": {"integrator": "gauss"},
    "implicit": {"integrator": "implicit", "step": 1e-3},
    "rk4": {"integrator": "rk4", "step": 1e-3},
    "ida": {"integrator": "ida", "rtol": 1e-8},
}
every_run = pytest.mark.parametrize("name", RUNS)


def beam(length: float) -> fa.Beam:
    shapes = {"bending_y": 3, "shear_y": 1, "extension": 1}
    return fa.Beam(length, fa.Rectangle(0.004, 0.02), STEEL, shapes, "legendre", "exact", kelvin_voigt=1e-4)


def bar(length: float) -> fa.RigidBody:
    return fa.RigidBody(1.0, (0.5 * length, 0, 0), (0.001, 0.02, 0.02), (length, 0, 0))


def four_bar(*, bends: bool = False, **loop: Any) -> fa.Arm:
    """Its rocker stands on the world; the loop is where the coupler holds its end."""
    foot = fa.Revolute("z", inboard=fa.Placement((0.7, 0, 0)))
    links = []
    for name, x in LENGTHS.items():
        joint, parent = (foot, "world") if name == "rocker" else (fa.Revolute("z"), None)
        what = {"beam": beam(x)} if bends else {"hub": bar(x)}
        links.append(fa.Link(joint, name=name, parent=parent, **what))
    return fa.Arm(links, G, loops=[fa.Loop("coupler", "rocker", fa.Revolute("z"), name="top", **loop)])


def rest(angle: float) -> fa.Motion:
    return fa.Motion([0, 1], [angle, angle], [0, 0], [0, 0])


@every_run
def test_a_loop_that_motions_hold_at_both_ends_is_at_rest_by_its_forces(name: str) -> None:
    """Of the coupler's balance: force and moment of gravity, of the loop, and of the crank's end."""
    arm = four_bar()
    q = arm.assemble(START, hold=["crank"])
    run = fa.simulate(arm, [0, 0.05, 0.1], q, drive={"crank": rest(q[0]), "rocker": rest(q[2])}, **RUNS[name])
    np.testing.assert_allclose(run.q[-1], q, atol=1e-12)
    top, at = run.loop("top"), run.frame("coupler")[0]
    elbow = 0.2 * np.array([np.cos(q[0]), np.sin(q[0]), 0])
    # the loop's force is that on the rocker
    moment = np.cross(at - elbow, -top.force) + np.cross(0.5 * (at - elbow), np.array(G))
    np.testing.assert_allclose(moment, 0, atol=1e-9)
    base = run.joint_reaction("crank", "inboard")[:, :3] + run.joint_reaction("rocker", "inboard")[:, :3]
    np.testing.assert_allclose(base, np.tile([0, 3 * 9.81, 0], (3, 1)), atol=1e-9)
    assert np.isfinite(run.tau).all() and abs(run.tau).max() < 100


@every_run
@pytest.mark.parametrize("still", [0.0, 0.05])
def test_motions_that_contradict_a_loop_are_named(name: str, still: float) -> None:
    arm = four_bar()
    q = arm.assemble(START, hold=["crank"])

    def away(angle: float, way: float) -> fa.Motion:
        t = [0, still, 1] if still else [0, 1]
        return fa.Motion(t, [*[angle] * (len(t) - 1), angle + way], [0] * len(t), [0] * len(t))

    drive = {"crank": away(q[0], 1.0), "rocker": away(q[2], 1.0)}
    named = "loop 'top'", "'crank revolute'", "'rocker revolute'", "contradict", "assemble"
    with refuses(*named, error=fa.SimulationError):
        fa.simulate(arm, np.linspace(0, 0.2, 41), q, drive=drive, **RUNS[name])


@every_run
def test_a_motion_that_nothing_is_free_to_follow_is_named(name: str) -> None:
    links = [fa.Link(fa.Revolute("z"), bar(0.5), name=of) for of in ("left", "right")]
    arm = fa.Arm(links, G, loops=[fa.Loop((0.6, 0, 0), "right", fa.Revolute("z"), name="foot")])
    q = arm.assemble([0.8, -1.6])
    assert arm.mobility(q).freedoms == 0
    drive = {"left": fa.Motion([0, 1], [q[0], q[0] + 0.3], [0, 0], [0, 0])}
    with refuses("loop 'foot'", "'left revolute'", "stand still", error=fa.SimulationError):
        fa.simulate(arm, np.linspace(0, 0.2, 41), q, drive=drive, **RUNS[name])


@pytest.mark.parametrize("name", ["gauss", "chosen", "ida"])
def test_a_singular_position_is_named(name: str) -> None:
    """The rocker is driven beyond the place at which crank and coupler are in one line."""
    arm = four_bar()
    q = arm.assemble(START, hold=["crank"])
    low = 0.7**2 + 0.5**2 - 0.8**2
    limit = np.pi - np.arccos(low / (2 * 0.7 * 0.5))
    drive = {"rocker": fa.Motion([0, 1], [q[2], limit - 0.5], [0, 0], [0, 0])}
    with refuses("loop 'top'", "singular", error=fa.SimulationError):
        fa.simulate(arm, np.linspace(0, 1, 41), q, drive=drive, **RUNS[name])
    soft = four_bar(stiffness=1e5)
    assert fa.simulate(soft, np.linspace(0, 1, 41), q, drive=drive, **RUNS["implicit"]).t[-1] == 1
