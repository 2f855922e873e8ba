"""The error of a run, and its parts, beside closed forms: of shapes, of orders, of steps, of uncertain numbers."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from messages import refuses
from scipy.optimize import brentq

L, SIDE, STEEL = 0.5, 0.002, fa.Material(7850.0, 209e9, 0.3)
EI = 209e9 * SIDE**4 / 12
SLOWLY = np.array([0.0, 2.0, 3.0])  # s: the beam's first period is 0.15 s
RAMP = np.array([0.0, 1.0, 1.0])


def clamped(force: Any = None, moment: Any = None, **beam: Any) -> fa.Result:
    """A clamped beam under a load that grows slowly at its end."""
    given: dict[str, Any] = {"damping_ratio": 0.1, "rotary_inertia": True, **beam}
    arm = fa.Arm([fa.Link(fa.Fixed(), beam=fa.Beam(L, fa.Rectangle(SIDE, SIDE), STEEL, **given))], (0, 0, 0))
    grown = {k: np.outer(RAMP, x) for k, x in (("force", force), ("moment", moment)) if x is not None}
    return fa.simulate(arm, np.linspace(0, 3, 31), loads=[fa.Load(t=SLOWLY, **grown)])


def part(error: fa.results.ErrorEstimate, what: str) -> float:
    return sum(x.error for x in error.sources if x.what == what)


@pytest.mark.parametrize("n", [1, 2])
def test_missing_modes_under_a_force(n: int) -> None:
    """Of F L^3 / 3 EI, n clamped-free modes miss 1 - sum 12 / lambda^4."""
    F = 0.05
    found = clamped(force=[0, F, 0], modes={"bending_y": n}, order="exact").error()
    clamped_free = [brentq(lambda x: np.cos(x) + 1 / np.cosh(x), (i - 0.9) * np.pi, (i + 0.1) * np.pi) for i in (1, 2)]
    missing = (1 - sum(12 / x**4 for x in clamped_free[:n])) * F * L**3 / (3 * EI)
    assert found.reliable and found.runs == 3 and found.unit == "m"
    np.testing.assert_allclose(found.largest, missing, rtol=0.02)
    np.testing.assert_allclose(part(found, "bending_y modes"), missing, rtol=0.02)
    np.testing.assert_allclose(found.total[-1], missing, rtol=0.02)
    assert found.sources[0].what == "bending_y modes" and found.sources[0].share > 0.98


def test_order_of_rotation() -> None:
    """Bent to a circle of angle theta, the end of a beam is at L (sin theta, 1 - cos theta) / theta; by order 1 at
    L (1, theta / 2)."""
    theta = 0.2
    run = clamped(moment=[0, 0, EI * theta / L], modes={"bending_y": 1}, basis="legendre", order=1)
    found = run.error()
    off = L * np.array([1 - np.sin(theta) / theta, theta / 2 - (1 - np.cos(theta)) / theta])
    np.testing.assert_allclose(found.largest, np.linalg.norm(off), rtol=0.01)
    np.testing.assert_allclose(part(found, "order of rotation"), np.linalg.norm(off), rtol=0.02)
    assert found.sources[0].what == "order of rotation" and found.reliable


def test_a_start_in_balance() -> None:
    """An arm that hangs in balance begins with the error that its modes miss, and keeps it."""
    beam = fa.Beam(L, fa.Rectangle(SIDE, SIDE), STEEL, {"bending_y": 1}, order="exact", damping_ratio=0.1)
    F = 0.05
    arm = fa.Arm([fa.Link(fa.Fixed(), beam=beam)], (0, 0, 0))
    t = np.array([0.0, 1.0, 2.0])
    push = fa.Load(t=t, force=np.outer([F, F, 0.8 * F], [0, 1, 0]))
    found = fa.simulate(arm, np.linspace(0, 2, 21), "equilibrium", loads=[push]).error()
    missing = (1 - 12 / 1.8751041**4) * F * L**3 / (3 * EI)
    np.testing.assert_allclose(found.total[0], missing, rtol=0.02)
    np.testing.assert_allclose(sum(x.error for x in found.sources), found.largest, rtol=0.02)
    np.testing.assert_allclose(part(found, "bending_y modes"), found.largest, rtol=0.02)


def sprung(**options: Any) -> tuple[fa.Result, float]:
    """A rigid rotor on a spring, let go at 0.3 rad, and its frequency (rad/s)."""
    body = fa.RigidBody(1.0, inertia=(0.1, 0.1, 0.1))
    arm = fa.Arm([fa.Link(fa.Revolute("z", stiffness=0.9), body)], (0, 0, 0))
    return fa.simulate(arm, np.linspace(0, 4, 41), [0.3], **options), np.sqrt(0.9 / 0.1)


def test_steps() -> None:
    """The trapezoidal rule vibrates at 2/h arctan(omega h / 2)."""
    h = 0.02
    run, omega = sprung(integrator="implicit", step=h)
    found = run.error("joint")
    off = 0.3 * np.abs(np.cos(2 / h * np.arctan(omega * h / 2) * run.t) - np.cos(omega * run.t))
    np.testing.assert_allclose(found.total, off, atol=1e-3 * off.max())
    assert [x.what for x in found.sources] == ["steps"] and found.unit == "rad" and found.reliable
    assert found.runs == 1 and found.model.max() == 0.0


def test_what_is_too_small_to_be_told() -> None:
    found = sprung(integrator="gauss", tolerance=1e-10)[0].error("joint")
    assert not found.reliable and "NOT RELIABLE" in str(found) and "steps" in found.reason


def test_uncertain_numbers() -> None:
    """A deflection under a force is as 1 / E."""
    F = 0.05
    run = clamped(force=[0, F, 0], modes={"bending_y": 2}, basis="legendre", order="exact")
    found = run.error(parameters={"link.0.beam.material.youngs_modulus": 0.02})
    (number,) = found.numbers
    np.testing.assert_allclose(number.error, 0.02 * F * L**3 / (3 * EI), rtol=0.02)
    assert found.runs == 5 and "youngs_modulus" in str(found)


def pushed(**more: Any) -> fa.Result:
    """Two links in a plane, one of them driven, on whose joints springs, friction and a controller act."""
    beam = fa.Beam(0.6, fa.Rectangle(0.003, 0.02), STEEL, {"bending_y": 1}, order=2, damping_ratio=0.01)
    arm = fa.Arm(
        [fa.Link(fa.Revolute("z", damping=0.1, coulomb=0.05, reflected_inertia=0.05), beam=beam),
         fa.Link(fa.Revolute("z", stiffness=3.0, damping=0.05), beam=beam, tip=fa.RigidBody(0.1))], (0, -9.81, 0)
    )  # fmt: skip
    hold = fa.PD(40.0, 4.0, 0, reference=0.3)
    return fa.simulate(arm, np.linspace(0, 1, 51), control=hold, **more)


def test_parts_add_up_and_hit_a_richer_run() -> None:
    run = pushed()
    found = run.error()
    np.testing.assert_allclose(sum(x.error for x in found.sources), found.largest, rtol=0.05)
    arm = run.arm
    beam = fa.Beam(
        0.6, fa.Rectangle(0.003, 0.02), STEEL, {"bending_y": 7, "shear_y": 2, "extension": 2}, "legendre",
        order="exact", damping_ratio=0.01,
    )  # fmt: skip
    more = fa.Arm([replace(link, beam=beam) for link in arm.links], (0, -9.81, 0))
    truth = fa.simulate(
        more, run.t, control=fa.PD(40.0, 4.0, 0, reference=0.3), integrator="gauss", tolerance=1e-7
    )  # fmt: skip
    off = np.linalg.norm(truth.frame()[0] - run.frame()[0], axis=1).max()
    assert 0.8 < found.largest / off < 1.25


def test_feedback_of_strains_reads_those_of_the_richer_model() -> None:
    """At the clamp these are others, although the beams have nearly the same shape: part of the error."""
    beam = fa.Beam(L, fa.Rectangle(0.003, 0.02), STEEL, {"bending_y": 2}, order=2, damping_ratio=0.01)
    arm = fa.Arm([fa.Link(fa.Revolute("z", reflected_inertia=0.1), beam=beam, tip=fa.RigidBody(0.2))], (0, 0, 0))
    hold = fa.StrainFeedback(20.0, 2.0, 1.0, reference=0.3)
    found = fa.simulate(arm, np.linspace(0, 0.5, 51), control=hold).error()
    np.testing.assert_allclose(sum(x.error for x in found.sources), found.largest, rtol=0.01)


@pytest.mark.parametrize("quantity", ["joint", "strain", lambda result: result.q[:, 0]])
def test_other_quantities(quantity: Any) -> None:
    found = pushed().error(quantity)
    np.testing.assert_allclose(sum(x.error for x in found.sources), found.largest, rtol=0.1)
    assert found.total.shape == found.t.shape and found.plot().axes


def test_strains_that_jump() -> None:
    """Four smooth shapes follow the curvature of a driven patch hardly better than two: the estimate says so."""
    pzt = fa.Piezo(60.6e9, 0.3, 7500, -274e-12, permittivity=3e-8)
    patch = fa.Patch(0.02, 0.07, 0.02, 0.2e-3, pzt)
    beam = fa.Beam(L, fa.Rectangle(1e-3, 0.02), STEEL, {"bending_y": 2}, "legendre", patches=[patch])
    arm = fa.Arm([fa.Link(fa.Fixed(), beam=beam)], (0, 0, 0))
    volts = fa.Voltage([0, 0.1, 0.2], [0, 50, 50])
    found = fa.simulate(arm, np.linspace(0, 0.2, 41), drive={("patch", 0, 0): volts}).error()
    assert not found.reliable and "patches" in found.reason and "fa.split" in found.reason


def test_constant_forces() -> None:
    """Under a constant torque a rotor on a spring swings about tau / k."""
    body, h, tau = fa.RigidBody(1.0, inertia=(0.1, 0.1, 0.1)), 0.02, 0.2
    arm = fa.Arm([fa.Link(fa.Revolute("z", stiffness=0.9), body)], (0, 0, 0))
    run = fa.simulate(arm, np.linspace(0, 4, 41), tau=[tau], integrator="implicit", step=h)
    found = run.error("joint")
    off = tau / 0.9 * np.abs(np.cos(2 / h * np.arctan(3 * h / 2) * run.t) - np.cos(3 * run.t))
    np.testing.assert_allclose(found.total, off, atol=1e-3 * off.max())


def test_constant_forces_beside_a_drive() -> None:
    """Of a clamped beam that a joint carries, what one mode misses is as large as the whole torque is."""
    beam = fa.Beam(L, fa.Rectangle(SIDE, SIDE), STEEL, {"bending_y": 1}, order="exact", damping_ratio=0.1)
    arm = fa.Arm([fa.Link(fa.Revolute("z", reflected_inertia=0.01), beam=beam)], (0, 0, 0))
    t, half = np.linspace(0, 0.5, 51), np.array([0.02, 0.02])
    both = [fa.simulate(arm, t, tau=[0.02, 0.0], drive={0: fa.Torque([0, 1], half)}),
            fa.simulate(arm, t, drive={0: fa.Torque([0, 1], 2 * half)})]  # fmt: skip
    once, twice = (run.error() for run in both)
    np.testing.assert_allclose(once.total, twice.total, rtol=1e-6, atol=1e-12)
    assert once.sources[0].what == twice.sources[0].what == "bending_y modes"


def test_compliant_loops() -> None:
    """A rotor that a compliant loop ties to the world swings as by a spring of k r^2."""
    body, h, r = fa.RigidBody(1.0, inertia=(0.1, 0.1, 0.1), end=(1.0, 0, 0)), 0.02, 1.0
    tie = fa.Loop((r, 0, 0), 0, fa.Spherical(), stiffness=0.9)
    arm = fa.Arm([fa.Link(fa.Revolute("z", reflected_inertia=0.0), body)], (0, 0, 0), loops=[tie])
    start, I = 1e-3, 0.1
    run = fa.simulate(arm, np.linspace(0, 4, 41), [start], integrator="implicit", step=h)
    found = run.error("joint")
    w = np.sqrt(0.9 * r**2 / I)
    off = start * np.abs(np.cos(2 / h * np.arctan(w * h / 2) * run.t) - np.cos(w * run.t))
    np.testing.assert_allclose(found.total, off, atol=2e-3 * off.max())


def test_shapes_that_are_added_are_never_poorer() -> None:
    """Two clamped-free modes of a clamped beam have its first two frequencies exactly: a light vibration of these
    alone, for many periods, is off by less than further modes move."""
    beam = fa.Beam(L, fa.Rectangle(SIDE, SIDE), STEEL, {"bending_y": 2}, order="exact")
    arm = fa.Arm([fa.Link(fa.Fixed(), beam=beam)], (0, 0, 0))
    run = fa.simulate(arm, np.linspace(0, 2, 401), [0.0, 1e-3], integrator="gauss", tolerance=1e-7)
    found = run.error()
    more = fa.Arm([fa.Link(fa.Fixed(), beam=replace(beam, modes={"bending_y": 6}))], (0, 0, 0))
    truth = fa.simulate(more, run.t, [0.0, 1e-3, *[0.0] * 4], integrator="gauss", tolerance=1e-7)
    off = np.linalg.norm(truth.frame()[0] - run.frame()[0], axis=1).max()
    assert found.largest < 2 * off + 0.02 * found.span


def test_an_estimate_that_is_kept() -> None:
    """`simulate(error=True)`: the result tells it where it is printed, drawn and checked, and it is not made twice."""
    run = pushed(error=True)
    found = run.error()
    assert found is run.error() and found is not run.error("joint")
    tip = run.error()
    assert f"tip off by {tip.largest:.2g} m" in repr(run)
    assert any(ax.get_ylabel().startswith("Error of the tip") for ax in run.plot().axes)
    assert pushed().error().total.tolist() == tip.total.tolist()
    (told,) = [x for x in run.check() if x.where == "tip"]
    assert told.value == tip.largest and tip.sources[0].what in told.remedy and tip.sources[0].remedy in told.remedy
    assert fa.load("ist").run(error=True).error().largest > 0.0


def test_a_refusal_that_is_kept() -> None:
    beam = fa.Beam(0.6, fa.Rectangle(0.003, 0.02), STEEL, {"bending_y": 1})
    arm = fa.Arm([fa.Link(fa.Revolute("z", reflected_inertia=0.05), beam=beam)], (0, 0, 0))
    law = fa.Sampled(lambda t, y: -y[0], 100.0, [fa.sensors.Encoder(0)], [0])
    run = fa.simulate(arm, [0, 0.05, 0.1], [0.1, 0.0], control=law, error=True)
    with refuses("control[0].measure[0]", "encoder"):
        run.error()
    assert "control[0]" in str([x for x in run.check() if x.where == "error"]) and "off by" not in repr(run)


def test_refusals() -> None:
    run = sprung()[0]
    with refuses("quantity", "'tips'", "tip"):
        run.error("tips")
    with refuses("parameters['gravity']", "-1"):
        run.error("joint", parameters={"gravity": -1.0})
    with refuses("tau[1]", "0.001", "elastic"):
        beam = fa.Beam(L, fa.Rectangle(SIDE, SIDE), STEEL, {"bending_y": 1})
        fa.simulate(fa.Arm([fa.Link(fa.Revolute("z"), beam=beam)]), [0, 0.1], tau=[0.0, 1e-3]).error()
    with refuses("does not know what it was made of"):
        copy.deepcopy(run).error()
