"""Chosen steps where a force has a kink: joints that meet their stops, contacts, ropes, and limits of motors and laws.
Beside closed forms, and IDA at tight tolerances."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from run.test_chosen_steps import error

TOLERANCE = 1e-5
TIGHT = fa.Ida(rtol=1e-10, atol=1e-12)
STEEL = fa.Material(7850.0, youngs_modulus=209e9, poisson_ratio=0.3)
INERTIA, STIFFNESS, UPPER, TORQUE = 0.1, 500.0, 0.3, 3.0
BODY = fa.RigidBody(1.0, inertia=(0.05, 0.05, INERTIA), end=(1, 0, 0))
HEAVY = fa.RigidBody(1.0, com=(0.3, 0, 0), inertia=(0.02, 0.04, 0.05), end=(0.6, 0, 0))
TOP = fa.RigidBody(1.0, inertia=(0.1, 0.2, 0.15), end=(0.3, 0, 0))
T = np.linspace(0, 2, 201)


def one(**joint: Any) -> fa.Arm:
    return fa.Arm([fa.Link(fa.Revolute("z", **joint), BODY)])


def stopped(damping: float = 0.0) -> fa.Arm:
    return one(lower=-UPPER, upper=UPPER, limit_stiffness=STIFFNESS, limit_damping=damping)


def bounce(t: np.ndarray) -> np.ndarray:
    """The angle under a constant torque, from rest at zero, between turns at zero and an undamped stop at `UPPER`."""
    fall = np.sqrt(2 * UPPER * INERTIA / TORQUE)
    w, speed, dent = np.sqrt(STIFFNESS / INERTIA), TORQUE / INERTIA * fall, TORQUE / STIFFNESS
    touch = 2 * (np.pi - np.arctan(speed / (w * dent))) / w
    since = np.mod(t, 2 * fall + touch)
    free = 0.5 * TORQUE / INERTIA * np.minimum(since, 2 * fall + touch - since) ** 2
    x = w * (since - fall)
    return np.where((x < 0) | (x > w * touch), free, UPPER + dent * (1 - np.cos(x)) + speed / w * np.sin(x))


def pair(joint: fa.Joint, beam: bool = False, **arm: Any) -> fa.Arm:
    """Two links in a plane, of which the second has this joint."""
    strip = fa.Beam(0.5, fa.Rectangle(0.004, 0.02), STEEL, {"bending_y": 2}, order="exact", damping_ratio=0.01)
    fore = fa.Link(joint, beam=strip, tip=fa.RigidBody(0.1)) if beam else fa.Link(joint, HEAVY)
    upper = fa.RigidBody(1.0, com=(0.25, 0, 0), inertia=(0.02, 0.04, 0.05), end=(0.5, 0, 0))
    return fa.Arm([fa.Link(fa.Revolute("z", damping=0.1), upper), fore], gravity=(0, -9.81, 0), **arm)


def falling(damping: float, coulomb: float = 0.0, exponent: float = 1.0) -> fa.Arm:
    floor = fa.Contact(
        0, fa.Plane((0, 0, 0), (0, 0, 1)), radius=0.05, stiffness=1e5, damping=damping, coulomb=coulomb,
        exponent=exponent, tangential_stiffness=1e5,
    )  # fmt: skip
    body = fa.RigidBody(1.0, inertia=(1e-3,) * 3, end=(0.3, 0, 0))
    return fa.Arm([fa.Link(fa.Axes(("tx", "ty", "tz")), body)], gravity=(0, 0, -9.81), contacts=[floor])


def drawn(seed: int) -> tuple[fa.Arm, dict[str, Any]]:
    """Three links whose axes point anywhere, the second with stops that it meets."""
    rng = np.random.default_rng(seed)
    links = []
    for k in range(3):
        stops = (
            {"lower": -0.2, "upper": 0.2, "limit_stiffness": 500.0, "limit_damping": 2.0 * (seed % 2)} if k == 1 else {}
        )
        body = fa.RigidBody(1.0, com=(0.1, 0.02, 0), inertia=(0.01, 0.02, 0.02), end=(0.3, 0, 0.05))
        links.append(fa.Link(fa.Revolute(rng.normal(size=3), reflected_inertia=0.02, damping=0.05, **stops), body))
    return fa.Arm(links, gravity=(0, 0, -9.81)), {"tau": rng.uniform(-6, 6, 3)}


def rope(damping: float) -> fa.Arm:
    """A pendulum that a rope catches."""
    line = fa.Tendon([(0.6, 0, 0), 0], stiffness=2e3, damping=damping, length=0.7)
    return fa.Arm([fa.Link(fa.Revolute("z"), HEAVY)], gravity=(0, -9.81, 0), struts=[line])


WALL = fa.Contact(1, fa.Plane((0, -0.6, 0), (0, 1, 0)), radius=0.01, stiffness=1e5, damping=0.5, name="floor")
STOPS = {"lower": -0.4, "upper": 0.4, "limit_stiffness": 800.0}
BALL_STOP = {"upper": 0.3, "limit_stiffness": 300.0}
PUSHED = {"tau": [TORQUE]}
CASES: dict[str, tuple[Any, dict[str, Any]]] = {
    "stop": (lambda: stopped(), PUSHED),
    "damped stop": (lambda: stopped(2.0), PUSHED),
    "stops of the second of two links": (lambda: pair(fa.Revolute("z", **STOPS)), {}),
    "stops of a flexible link": (lambda: pair(fa.Revolute("z", **STOPS, limit_damping=1.0), beam=True), {}),
    "stop beside dry friction": (lambda: pair(fa.Revolute("z", **STOPS, coulomb=0.1)), {}),
    "stop of a ball": (
        lambda: fa.Arm([fa.Link(fa.Spherical(**BALL_STOP), TOP)]),
        {"tau": [1.0, 0.5, -0.7]},
    ),
    "backlash": (
        lambda: one(damping=0.2, lower=-0.01, upper=0.01, limit_stiffness=200.0, limit_damping=0.5),
        {"drive": {0: fa.Torque(lambda t: 2 * np.sin(5 * t))}},
    ),
    "contact": (lambda: falling(0.0), {"q0": [0, 0, 0.3]}),
    "damped contact": (lambda: falling(0.3), {"q0": [0, 0, 0.3]}),
    "round contact": (lambda: falling(0.1, exponent=1.5), {"q0": [0, 0, 0.3]}),
    "rubbing contact": (lambda: falling(0.3, 0.3), {"q0": [0, 0, 0.1], "v0": [1.0, 0, 0]}),
    "contact of the second of two links": (lambda: pair(fa.Revolute("z"), contacts=[WALL]), {}),
    "rope": (lambda: rope(0.0), {"q0": [0.2]}),
    "damped rope": (lambda: rope(20.0), {"q0": [0.2]}),
    "limit of a motor": (lambda: one(torque_limit=2.0), {"control": [fa.PD(40.0, 0.4, reference=1.0)]}),
    "limit of a law": (lambda: one(), {"control": [fa.PD(40.0, 0.4, reference=1.0, limit=2.0)]}),
}  # fmt: skip


def test_an_undamped_bounce_is_that_of_the_closed_form() -> None:
    run = fa.simulate(stopped(), T, **PUSHED)
    assert np.abs(run.q[:, 0] - bounce(T)).max() < 3 * TOLERANCE


@pytest.mark.parametrize("case", CASES)
def test_the_error_is_within_the_tolerance_at_kinks(case: str) -> None:
    make, given = CASES[case]
    arm = make()
    run = fa.simulate(arm, T, integrator=fa.Gauss(), **given)
    assert error(run, fa.simulate(arm, T, integrator=TIGHT, **given)) < 3 * TOLERANCE
    assert run.stats["steps"] < 600


@pytest.mark.parametrize("seed", range(6))
def test_drawn_arms_with_a_stop(seed: int) -> None:
    arm, given = drawn(seed)
    t = np.linspace(0, 0.5, 51)
    run = fa.simulate(arm, t, **given)
    assert error(run, fa.simulate(arm, t, integrator=TIGHT, **given)) < 3 * TOLERANCE


def test_simulations_and_scenes_meet_kinks(tmp_path: Path) -> None:
    sim = fa.Simulation(stopped(), fa.Gauss(), drive={0: fa.Torque(TORQUE)})
    for t, q in zip(T[1::10], bounce(T)[1::10], strict=True):
        sim.step(until=t)
        assert abs(sim.q[0] - q) < 3 * TOLERANCE
    (tmp_path / "stop.toml").write_text(
        f"""
        [[link]]
        joint = {{ type = "revolute", axis = "z", upper = {UPPER}, limit_stiffness = {STIFFNESS} }}
        hub = {{ mass = 1.0, inertia = [0.05, 0.05, {INERTIA}], end = [1, 0, 0] }}
        [[drive]]
        link = 0
        torque = {TORQUE}
        [simulation]
        duration = 2.0
        interval = 0.1
        """
    )
    run = fa.load(tmp_path / "stop.toml").run()
    np.testing.assert_allclose(run.q[:, 0], bounce(run.t), atol=3 * TOLERANCE)


def test_derivatives_go_through_kinks() -> None:
    t = np.linspace(0, 0.6, 31)

    def turned(scale: float) -> fa.Result:
        return fa.simulate(stopped(2.0), t, drive={0: fa.Torque(scale * TORQUE)}, tolerance=1e-9)

    h = 1e-4
    differences = (turned(1 + h).q - turned(1 - h).q) / (2 * h)
    found = turned(1.0).sensitivities(["drive.0.scale"]).q[0]
    assert np.abs(found - differences).max() < 1e-4 * np.abs(differences).max()


def test_what_rests_takes_few_steps() -> None:
    """On a contact that sticks, and in a stop, after bounces."""
    t = np.linspace(0, 20, 21)
    assert fa.simulate(falling(1.0, 0.3), t, [0, 0, 0.06], [0.5, 0.2, 0]).stats["steps"] < 600
    assert fa.simulate(stopped(20.0), t, **PUSHED).stats["steps"] < 100
