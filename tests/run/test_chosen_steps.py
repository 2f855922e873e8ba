"""Steps that Gauss collocation chooses: their error against IDA at tight tolerances, what they step over and what they
follow, outputs, events, leaps, friction, and derivatives."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from arms import random_arm
from messages import refuses
from run.test_steps import floating_case, spatial_case

ZOO = sorted(Path(__file__).parents[2].joinpath("bench", "run", "zoo").glob("*.toml"))
STEEL = fa.Material(7850.0, youngs_modulus=209e9, poisson_ratio=0.3)
TIGHT = fa.Ida(rtol=1e-11, atol=1e-13)


def ends(arm: fa.Arm, q: np.ndarray) -> np.ndarray:
    return np.stack([arm.frame(q, link=k)[0] for k in range(len(arm.links))])


def error(run: fa.Result, truth: fa.Result) -> float:
    """Largest distance of a link's end from the truth, in parts of the arm's length."""
    arm = run.arm
    straight = ends(arm, arm.zero[None])[:, 0]
    length = np.linalg.norm(np.diff(straight, axis=0, prepend=np.zeros((1, 3))), axis=1).sum()
    return float(np.linalg.norm(ends(arm, run.q) - ends(arm, truth.q), axis=-1).max() / length)


def two_links(**joint: float) -> fa.Arm:
    beam = fa.Beam(0.4, fa.Rectangle(0.002, 0.02), STEEL, {"bending_y": 2}, order="exact", damping_ratio=0.01)
    hub, tip = fa.RigidBody(0.2, inertia=(1e-3,) * 3, end=(0.05, 0, 0)), fa.RigidBody(0.05)
    first, second = fa.Revolute("z", **joint), fa.Revolute("z", reflected_inertia=1e-3)
    return fa.Arm([fa.Link(first, hub, beam, tip, name="upper"), fa.Link(second, hub, beam, tip, name="fore")])


T = np.linspace(0.0, 1.0, 51)
SAMPLES = fa.Torque([0, 0.1, 0.1001, 0.6, 1.0], [0, 0.6, -0.5, 0.3, 0.3])
CASES: dict[str, tuple[Any, dict[str, Any]]] = {
    "torque": (two_links, {"drive": {"upper": SAMPLES}}),
    "motion": (two_links, {"drive": {"upper": fa.Motion([0, 0.3, 1], [0, 1, 1], [0, 0, 0], [0, 0, 0])}}),
    "loop": (two_links, {"control": [fa.PD(8.0, 0.4, link="upper", reference=0.5)]}),
    "sampled": (two_links, {"control": [fa.LinearController.pid(4.0, 2.0, 0.2, reference=0.3, rate=200)]}),
    "limit": (lambda: two_links(torque_limit=0.4), {"control": [fa.PD(8.0, 0.4, link="upper", reference=0.5)]}),
    "stop": (lambda: two_links(upper=0.02, limit_stiffness=500.0, limit_damping=2.0), {"drive": {"upper": SAMPLES}}),
    "friction": (lambda: two_links(coulomb=0.1, stiction=0.15), {"drive": {"upper": SAMPLES}}),
    "load": (two_links, {"loads": [fa.Load(-1, force=np.outer([0, 1, 0, 0], [0, 1, 0]), t=[0, 0.2, 0.21, 1.0])]}),
}


@pytest.mark.parametrize("case", CASES)
def test_the_error_is_within_the_tolerance(case: str) -> None:
    make, given = CASES[case]
    arm = make()
    truth = fa.simulate(arm, T, integrator=TIGHT, **given)
    run = fa.simulate(arm, T, **given)
    assert run.stats["integrator"] == "gauss"
    assert error(run, truth) < 1e-5


@pytest.mark.parametrize("case", [spatial_case, floating_case])
def test_the_error_follows_the_tolerance(case: Any) -> None:
    arm, laws, start = case()
    t = np.linspace(0, 0.2, 21)
    truth = fa.simulate(arm, t, **start, **laws, integrator=fa.Ida(rtol=1e-13, atol=1e-15))
    errors = []
    for tolerance in (1e-4, 1e-6, 1e-8):
        run = fa.simulate(arm, t, **start, **laws, tolerance=tolerance)
        errors.append(error(run, truth))
        assert errors[-1] < tolerance
    assert errors[2] < errors[0] / 100


@pytest.mark.parametrize("seed", range(12))
def test_drawn_arms(seed: int) -> None:
    rng = np.random.default_rng(seed)
    arm = random_arm(rng, int(rng.integers(1, 4)))
    t = np.linspace(0.0, 0.1, 21)
    tau = rng.uniform(-0.2, 0.2, arm.nv)
    tau[[i for i, name in enumerate(arm.coordinates) if "bending" in name or "torsion" in name]] = 0.0
    truth = fa.simulate(arm, t, tau=tau, integrator=TIGHT)
    assert error(fa.simulate(arm, t, tau=tau), truth) < 1e-5


@pytest.mark.parametrize("scene", ZOO, ids=lambda path: path.stem)
def test_the_zoo(scene: Path) -> None:
    """Against short fixed steps; `bench/run/zoo.py` compares these with IDA."""
    of = fa.load(scene)
    truth = fa.simulate(of.arm, of.t, of.q0, of.v0, integrator=fa.Gauss(1e-3), **of.given())
    assert error(of.run(), truth) < 1e-5


def test_quiet_fast_modes_take_no_steps_and_loud_ones_do() -> None:
    """A stiff mode at rest is stepped over; the same mode, bent by a hundredth of its length, is followed."""
    beam = fa.Beam(0.5, fa.Rectangle(0.02, 0.02), STEEL, {"bending_y": 2})
    arm = fa.Arm([fa.Link(fa.Revolute("z", stiffness=2.0), fa.RigidBody(1.0, inertia=(0.1,) * 3), beam)])
    t = np.linspace(0, 0.2, 11)
    quiet = fa.simulate(arm, t, [0.3, 0, 0])
    loud = fa.simulate(arm, t, [0.3, 5e-3, 0])
    assert quiet.stats["steps"] < 80 and loud.stats["steps"] > 200
    for run, q0 in ((quiet, [0.3, 0, 0]), (loud, [0.3, 5e-3, 0])):
        assert error(run, fa.simulate(arm, t, q0, integrator=TIGHT)) < 1e-5


def test_outputs_do_not_make_the_steps() -> None:
    make, given = CASES["torque"]
    few, many = (fa.simulate(make(), np.linspace(0, 1, n), **given) for n in (11, 1001))
    assert many.stats["steps"] < 1.3 * few.stats["steps"]
    np.testing.assert_allclose(many.q[::100], few.q, atol=2e-5)


def test_a_callable_is_asked_between_all_output_times() -> None:
    """A pulse that is shorter than the steps of an arm at rest would be."""
    t = np.linspace(0, 10, 1001)
    pulse = fa.Torque(lambda x: 0.5 if 5.0 <= x < 5.02 else 0.0)
    for chosen in (None, fa.Gauss()):
        run = fa.simulate(two_links(), t, drive={"upper": pulse}, integrator=chosen)
        assert run.stats["integrator"] == ("ida" if chosen is None else "gauss")
        assert np.ptp(run.q[:, 0]) > 0.01


def test_events_are_where_they_are() -> None:
    def straight(_: float, q: np.ndarray, __: np.ndarray) -> float:
        return float(q[0] - 0.02)

    make, given = CASES["torque"]
    truth = fa.simulate(make(), T, events=[straight], integrator=TIGHT, **given)
    run = fa.simulate(make(), T, events=[straight], **given)
    assert len(truth.t_events[0]) == len(run.t_events[0]) > 0
    np.testing.assert_allclose(run.t_events[0], truth.t_events[0], atol=1e-4)


def swinging(modes: int = 2) -> fa.Arm:
    """A beam on a spring, undamped."""
    beam = fa.Beam(0.5, fa.Rectangle(0.004, 0.02), STEEL, {"bending_y": modes})
    return fa.Arm([fa.Link(fa.Revolute("z", stiffness=5.0), fa.RigidBody(0.3, inertia=(1e-3,) * 3), beam)])


@pytest.mark.parametrize(("angle", "most"), [(0.1, 1e-5), (0.03, 1e-5), (0.01, 3e-5), (1e-3, 2e-4)])
def test_energy_of_a_vibration_that_is_small(angle: float, most: float) -> None:
    """Also between the steps. The less a vibration is seen, the less its energy counts."""
    arm, t = swinging(), np.linspace(0, 2, 401)
    run = fa.simulate(arm, t, [angle, 0, 0])
    kinetic, potential = run.energy()
    assert np.abs(kinetic + potential - potential[0]).max() < most * potential[0]


def test_energy_that_nobody_sees_takes_no_steps() -> None:
    arm, t = swinging(), np.linspace(0, 2, 401)
    assert fa.simulate(arm, t, [1e-7, 0, 0]).stats["steps"] < 60


@pytest.mark.parametrize("scene", ZOO, ids=lambda path: path.stem)
def test_energy_of_the_zoo(scene: Path) -> None:
    """In parts of the largest kinetic energy and what the potential energy spans."""
    of = fa.load(scene)
    truth = fa.simulate(of.arm, of.t, of.q0, of.v0, integrator=fa.Gauss(1e-3), **of.given())
    off = np.subtract(np.add(*of.run().energy()), np.add(*truth.energy()))
    kinetic, potential = truth.energy()
    assert np.abs(off).max() < 3e-5 * (kinetic.max() + np.ptp(potential))


def test_energy_of_a_free_arm() -> None:
    arm, _, start = floating_case()
    run = fa.simulate(arm, np.linspace(0, 2, 101), **start)
    total = np.add(*run.energy())
    assert np.ptp(total) < 1e-4 * np.ptp(run.energy()[0])  # its ball has damping


def test_derivatives_go_through_chosen_steps() -> None:
    make, given = CASES["torque"]

    def place(torque: float) -> np.ndarray:
        drive = {"upper": fa.Torque([0, 0.1, 0.1001, 0.6, 1.0], torque * np.array([0, 0.6, -0.5, 0.3, 0.3]))}
        return fa.simulate(make(), T, drive=drive, tolerance=1e-9).q

    run = fa.simulate(make(), T, tolerance=1e-9, **given)
    h = 1e-3
    differences = (place(1 + h) - place(1 - h)) / (2 * h)
    found = run.sensitivities(["drive.upper.scale"]).q[0]
    assert np.abs(found - differences).max() < 1e-5 * np.abs(differences).max()
    loss = {"q": np.ones_like(run.q)}
    assert run.gradient(loss, ["drive.upper.scale"])["drive.upper.scale"] == pytest.approx(found.sum(), rel=1e-9)


def test_a_simulation_by_chosen_steps() -> None:
    make, given = CASES["torque"]
    run = fa.simulate(make(), T, **given)
    sim = fa.Simulation(make(), fa.Gauss(), t=T, **given)
    for t, q in zip(T, run.q, strict=True):
        sim.step(until=t)
        assert sim.t == t
        np.testing.assert_allclose(sim.q, q, atol=1e-5)
    kept = sim.state()
    sim.step()
    once = sim.t, sim.q
    sim.restore(kept)
    sim.step()
    assert sim.t == once[0] > 1.0
    np.testing.assert_array_equal(sim.q, once[1])


def test_which_integrator_is_the_default() -> None:
    arm, t = two_links(), np.linspace(0, 0.01, 3)
    many = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, inertia=(1e-2,) * 3, end=(0.1, 0, 0)))] * 61)
    for given, expected in (
        ({}, "gauss"), ({"tolerance": 1e-6}, "gauss"), ({"step": 1e-3}, "gauss"), ({"rtol": 1e-6}, "ida"),
        ({"max_order": 2}, "ida"), ({"integrator": "ida"}, "ida"),
    ):  # fmt: skip
        assert fa.simulate(arm, t, **given).stats["integrator"] == expected
    assert fa.simulate(many, t).stats["integrator"] == "ida"
    with refuses("tolerance", -1.0):
        fa.Gauss(tolerance=-1.0)
    with refuses("tolerance", "gauss"):
        fa.simulate(arm, t, integrator="ida", tolerance=1e-6)
