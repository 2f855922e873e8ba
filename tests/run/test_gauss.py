"""Gauss collocation: order, symmetry, stability, drives, interpolation, failures; planar kernels beyond order 2."""

import flexarm as fa
import numpy as np
import pytest
from arms import paper_link, random_state, reference
from messages import refuses, warns
from run.test_steps import floating_case, paper_case, slider, spatial_arm, spatial_case


def run(arm: fa.Arm, t: np.ndarray, step: float, stages: int = 4, **options) -> fa.Result:
    return fa.simulate(arm, t, integrator="gauss", step=step, stages=stages, **options)


@pytest.mark.parametrize(
    ("make", "end", "stages", "step"),
    [
        *((paper_case, 1.0, 1, 2.5e-3), (paper_case, 1.0, 2, 2.5e-3), (paper_case, 1.0, 3, 5e-3)),
        *((spatial_case, 0.2, 2, 1.25e-3), (spatial_case, 0.2, 3, 2.5e-3)),
        *((floating_case, 0.2, 2, 1.25e-3), (floating_case, 0.2, 3, 2.5e-3)),
    ],
)
def test_order_of_convergence(make, end: float, stages: int, step: float) -> None:
    """Twice the stages, at the ends of the steps."""
    arm, laws, start = make()
    t = np.array([0.0, end])
    truth = fa.simulate(arm, t, **start, **laws, rtol=1e-13, atol=1e-15)
    scale = np.abs(truth.v).max()
    errors = []
    for h in (step, step / 2):
        r = run(arm, t, h, stages, **start, **laws)
        errors.append(max(np.abs(r.q - truth.q).max(), np.abs(r.v - truth.v).max() / scale))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2 * stages, abs=0.25), errors


@pytest.mark.parametrize("order", [2, "exact"])
def test_spin_up_of_the_independent_reference(order) -> None:
    """Steps of 25 ms, a twelfth of the first period and one and a half of the third; outputs in between."""
    case = reference(f"spinup_order_{order}")
    arm = fa.Arm.from_dict(case["scene"])
    r = run(arm, case["t"], 0.025, drive={0: fa.Motion.spin_up(7.6, 0.5)})
    assert np.abs(r.tip_deflection()[:, 1] - case["tip_deflection_y"]).max() < 1e-6
    assert r.stats["steps"] == round((case["t"][-1] - case["t"][0]) / 0.025)


def test_outputs_between_steps() -> None:
    arm, laws, start = spatial_case()
    t = np.linspace(0, 0.2, 101)
    truth = fa.simulate(arm, t, **start, **laws, rtol=1e-12, atol=1e-14)
    r = run(arm, t, 1.6e-3, **start, **laws)
    assert r.stats["steps"] == 125
    assert np.abs(r.q - truth.q).max() < 1e-8 and np.abs(r.v - truth.v).max() < 1e-5 * np.abs(truth.v).max()
    assert np.abs(r.a - truth.a).max() < 1e-3 * np.abs(truth.a).max()


def test_steps_that_newton_cannot_solve_are_halved() -> None:
    """Half a second period of the stiffest mode in one step: it becomes several, and the motion is right."""
    arm, laws, start = spatial_case()
    t = np.linspace(0, 0.2, 21)
    truth = fa.simulate(arm, t, **start, **laws, rtol=1e-11, atol=1e-13)
    r = run(arm, t, 0.1, **start, **laws)
    assert r.stats["failed_steps"] > 0 and r.stats["steps"] > 2
    assert np.abs(r.q - truth.q).max() < 1e-3


def test_motions_and_balls() -> None:
    arm, t = paper_link(), np.linspace(0, 1, 101)
    law = fa.Motion.spin_up(7.6, 0.5)
    ida = fa.simulate(arm, t, drive={0: law}, rtol=1e-11, atol=1e-13)
    r = run(arm, t, 0.0125, drive={0: law})
    np.testing.assert_array_equal(r.q[:, 0], [law(x)[0] for x in t])
    assert np.abs(r.tau[:, 0] - ida.tau[:, 0]).max() < 1e-5 * np.abs(ida.tau).max()
    given = run(fa.Arm([fa.Link(fa.Prismatic("x"), fa.RigidBody(2.0))]), t, 0.1, drive={0: fa.Motion(parabola)})
    np.testing.assert_allclose(given.tau, 4.0)
    flying, laws, start = floating_case()
    r = run(flying, np.linspace(0, 2, 11), 5e-3, **laws, **start)
    for _, at in flying.quaternions():
        np.testing.assert_allclose(np.linalg.norm(r.q[:, at], axis=1), 1.0, atol=1e-14)


def parabola(t: float) -> tuple[float, float, float]:
    return t**2, 2 * t, 2.0


def test_samples_are_met_exactly() -> None:
    """A pulse far shorter than the step gives its full impulse; a load as well."""
    times, values = [0, 0.5, 0.5001, 0.5003, 0.5004, 1], np.array([0, 0, 50, 50, 0, 0])
    load = fa.Load(force=np.outer(values, [1, 0, 0]), t=times)
    for options in ({"drive": {0: fa.Torque(times, values)}}, {"loads": [load]}):
        r = run(slider(0.0), np.array([0.0, 1.0]), 0.1, **options)
        assert r.v[-1, 0] == pytest.approx(50 * 3e-4, rel=1e-12)
        assert r.stats["steps"] == 5 + 3 + 5


def test_a_motion_is_not_stepped_over() -> None:
    """A joint that moves for 20 ms only, sampled each millisecond, under steps of 0.1 s; and one whose speed jumps."""
    arm, t = paper_link(2, 1), np.linspace(0, 1, 201)
    times = np.linspace(0, 1, 1001)
    x = np.clip((times - 0.5) / 0.02, 0, 1)
    short = fa.Motion(times, 0.05 * (x - np.sin(2 * np.pi * x) / (2 * np.pi)))
    truth = fa.simulate(arm, t, drive={0: short}, rtol=1e-10, atol=1e-12)
    r = run(arm, t, 0.1, drive={0: short})
    assert r.stats["steps"] < 80
    assert np.abs(r.q - truth.q).max() < 1e-4 and np.abs(truth.q[:, 1:]).max() > 0.01
    ramp = fa.Motion(lambda s: (0.1 * max(s - 0.3, 0.0), 0.1 * (s > 0.3), 0.0))
    assert np.isfinite(run(arm, t, 0.1, drive={0: ramp}).q).all()


def test_no_mode_is_too_fast() -> None:
    """|R(i h omega)| = 1: a spring of any stiffness keeps its amplitude, and shear at 6e4 rad/s costs nothing."""
    for stiffness in (1.0, 1e4, 1e10):
        r = run(slider(stiffness), np.linspace(0, 10, 11), 0.1, q0=[1.0])
        energy = r.energy()[0] + r.energy()[1]
        np.testing.assert_allclose(energy, energy[0], rtol=1e-8)
    stiff = spatial_arm(shear=1, damping=0.0)
    assert stiff.modes().frequencies.max() > 5e4
    v0 = 0.5 * np.cos(np.arange(stiff.nv)) * (np.arange(stiff.nv) < 2)
    t = np.linspace(0, 0.5, 11)
    r = run(stiff, t, 2e-3, v0=v0)
    soft = fa.simulate(spatial_arm(shear=0, damping=0.0), t, v0=v0[: spatial_arm().nv], rtol=1e-10, atol=1e-12)
    assert np.abs(r.frame()[0] - soft.frame()[0]).max() < 2e-3  # shear itself is worth that much
    assert r.stats["evaluations"] < 20 * r.stats["steps"] * 4


def test_energy_of_a_free_arm_does_not_drift() -> None:
    """Symmetric in time: over 2e4 steps the error swings but has no slope."""
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(0.1, inertia=(1e-3,) * 3), paper_link().links[0].beam)])
    r = run(arm, np.linspace(0, 1000, 2001), 5e-2, 2, v0=[3.0, 0.1, 0, 0])
    energy = r.energy()[0] + r.energy()[1]
    error = energy / energy[0] - 1
    swing = np.abs(error).max()
    slope = np.polyfit(r.t, error, 1)[0] * 1000
    assert 1e-7 < swing < 1e-2 and abs(slope) < 0.02 * swing, (swing, slope)


def test_failures_are_reported() -> None:
    arm = paper_link()
    with refuses("stages = 5", "1 to 4"):
        run(arm, np.array([0.0, 1.0]), 0.1, 5)
    with refuses("step", "integrator=", '"implicit"'):
        fa.simulate(arm, [0, 1], integrator="implicit")
    runaway = fa.Torque(lambda t: 1e-5 / max(1e-60, 0.5 - t) ** 4)
    with pytest.raises(fa.SimulationError) as caught:
        run(arm, np.linspace(0, 1, 101), 0.01, drive={0: runaway})
    assert 0.3 < caught.value.time <= 0.5 and len(caught.value.result.t) > 10
    assert np.isfinite(caught.value.result.q).all()


# -- planar kernels --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", [3, "exact"])
@pytest.mark.parametrize("plane", ["y", "z"])
def test_planar_kernels_are_the_spatial_ones(order, plane: str) -> None:
    """A beam of one plane against the same with a torsion coordinate that is not moved."""
    modes = {f"bending_{plane}": 3, f"shear_{plane}": 1}

    def arm(more: dict) -> fa.Arm:
        beam = fa.Beam(0.6, fa.Rectangle(0.01, 0.02), fa.Material(2000, 1e7, 0.3), modes | more, "legendre", order)
        links = [fa.Link(fa.Universal(), fa.RigidBody(0.5, inertia=(0.1,) * 3, end=(0.1, 0, 0)), beam)]
        return fa.Arm([*links, fa.Link(fa.Revolute("x"), None, beam, fa.RigidBody(0.2, (0, 0.1, 0.02)))], (1, -9, 2))

    one, two = arm({}), arm({"torsion": 1})
    keep = [k for k, name in enumerate(two.coordinates) if "torsion" not in name]
    q, v, a = random_state(np.random.default_rng(0), one)
    q[[3, 4, 5]] *= 20  # bent far
    wide = np.zeros((3, two.nv))
    wide[:, keep] = q, v, a
    expected = two.inverse_dynamics(*wide)[keep]
    np.testing.assert_allclose(one.inverse_dynamics(q, v, a), expected, atol=1e-10 * np.abs(expected).max())
    M = two.mass_matrix(wide[0])[np.ix_(keep, keep)]
    np.testing.assert_allclose(one.mass_matrix(q), M, atol=1e-10 * np.abs(M).max())
    by_q, by_v, _ = one.inverse_derivatives(q, v, a)
    wide_q, wide_v, _ = two.inverse_derivatives(*wide)
    for found, full in ((by_q, wide_q), (by_v, wide_v)):
        full = full[np.ix_(keep, keep)]
        np.testing.assert_allclose(found, full, atol=1e-9 * np.abs(full).max())
    for x in (0.2, None):
        np.testing.assert_allclose(one.acceleration(q, v, a, 0, x), two.acceleration(*wide, 0, x), atol=1e-9)


def test_events_inside_long_steps() -> None:
    """A pendulum of 1 rad: its period is 4 K(sin(1/2)) sqrt(l/g); several zeros lie in one step of a third of it. A
    terminal event ends the rows."""
    from scipy.special import ellipk

    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, (1, 0, 0)))], gravity=(9.81, 0, 0))
    period = 4 * ellipk(np.sin(0.5) ** 2) / np.sqrt(9.81)

    def level(t: float, q: np.ndarray, v: np.ndarray) -> float:
        return float(q[0])

    t = np.linspace(0, 20, 201)
    r = run(arm, t, 0.5, q0=[1.0], events=[level])
    expected = period * (0.25 + 0.5 * np.arange(len(r.t_events[0])))
    assert len(expected) == int(np.floor(20 / period * 2 + 0.5))
    np.testing.assert_allclose(r.t_events[0], expected, atol=2e-4)
    level.terminal = 3
    stopped = run(arm, t, 0.5, q0=[1.0], events=[level])
    assert stopped.status == 1 and len(stopped.t_events[0]) == 3
    np.testing.assert_array_equal(stopped.t, t[t <= stopped.t_events[0][-1]])
    np.testing.assert_allclose(stopped.q, r.q[: len(stopped.t)], atol=1e-12)


def test_the_last_row_has_the_forces_of_its_time() -> None:
    """Not those of the last output time inside the step that ends there."""
    arm, law = paper_link(), fa.Torque(lambda t: np.sin(25 * t))
    run = fa.simulate(arm, np.linspace(0, 0.01, 51), drive={0: law}, integrator="gauss", step=1e-3)
    a = arm.forward_dynamics(run.q[-1], run.v[-1], [law(0.01), 0, 0, 0])
    np.testing.assert_allclose(run.tau[-1, 0], law(0.01), rtol=1e-14)
    np.testing.assert_allclose(run.a[-1], a, rtol=1e-10)


@pytest.mark.parametrize("step", [0.004, 0.019])
def test_a_solution_far_off_is_none(step: float) -> None:
    """An L frame let go with its stiff shapes loud: Newton's iteration runs away, and another root, or a tolerance that
    had grown with the motion, gave 1e25 J of the 0.138 J at the start. The steps are halved, and the energy stays."""
    modes, steel = {"bending_y": 5}, fa.Material(7850, 209e9, 0.3)
    beams = [
        fa.Beam(length, fa.Rectangle(thick, 0.02), steel, modes, order="exact")
        for length, thick in ((0.4, 0.002), (0.8, 0.0015))
    ]
    turn = fa.Placement(rotation=(0, 0, np.pi / 2))
    arm = fa.Arm(
        [
            fa.Link(fa.Fixed(), None, beams[0], fa.RigidBody(1.21717)),
            fa.Link(fa.Fixed(inboard=turn), None, beams[1], fa.RigidBody(0.02)),
        ]
    )
    start = np.zeros(10)
    start[[0, 1, 2, 5, 6, 7]] = 2.675e-2, -8.75e-4, -2.87e-4, -0.1556, -1.67e-3, -1.48e-4
    with warns(fa.errors.StepWarning, "step = 0.0", "halved"):
        r = fa.simulate(arm, np.linspace(0, 0.2, 11), start, integrator="gauss", step=step)
    total = sum(r.energy()[:2])
    assert r.stats["failed_steps"] > 0
    np.testing.assert_allclose(total, total[0], rtol=0.05)


def test_forces_that_begin_at_once_are_no_solution_far_off() -> None:
    """From rest without gravity: a torque, a load and a motion that begin inside a step halve nothing."""
    beam = fa.Beam(0.5, fa.Rectangle(0.01, 0.02), fa.Material(7850, 209e9, 0.3), {"bending_y": 2})
    arm = fa.Arm([fa.Link(fa.Revolute("z"), None, beam)])
    t = np.linspace(0, 0.1, 11)
    ramp = np.linspace(0, 1, 11)
    for given in (
        {"drive": {0: fa.Torque(lambda t: 1e3 * t**2)}},
        {"drive": {0: fa.Torque(t, 5 * ramp)}},
        {"drive": {0: fa.Motion.spin_up(5.0, 0.1)}},
        {"loads": [fa.Load(0, force=np.c_[0 * ramp, 5 * ramp, 0 * ramp], t=t)]},
    ):
        r = fa.simulate(arm, t, integrator="gauss", step=0.01, **given)
        assert r.stats["failed_steps"] == 0


def test_many_halved_steps_are_told() -> None:
    """Three rods that whirl: of steps of 20 ms most are halved, and the others hide that the angles are wrong."""
    rod = fa.RigidBody(1.0, (0.3, 0, 0), (0.01, 0.01, 0.01), (0.3, 0, 0))
    arm, t = fa.Arm([fa.Link(fa.Revolute("y"), rod)] * 3), np.linspace(0, 0.5, 21)
    v = [100.0, -100.0, 150.0]
    truth = fa.simulate(arm, t, v0=v, rtol=1e-11, atol=1e-13)
    with warns(fa.errors.StepWarning, "step = 0.02") as w:
        coarse = run(arm, t, 0.02, v0=v)
    assert f"{coarse.stats['failed_steps']} times" in str(w[0].message) and w[0].filename == __file__
    assert np.abs(coarse.q[-1] - truth.q[-1]).max() > 0.1
    fine = run(arm, t, 5e-3, v0=v)
    assert np.abs(fine.q[-1] - truth.q[-1]).max() < 1e-3
