"""Steps of "rk4" above its limit, 2.83 over the highest frequency of what moves: they are told."""

import pickle
import warnings

import flexarm as fa
import numpy as np
import pytest
from messages import refuses, warns

STEEL = fa.Material(7850.0, 210e9, 0.3)


def test_rk4_above_its_limit_is_told_where_nothing_runs_away() -> None:
    """Steps of 0.28 ms for a limit of 0.274 ms: the joints were off by 5.9 rad after a second, without a word."""
    beam = fa.Beam(0.3, fa.Rectangle(0.005, 0.02), STEEL, {"bending_y": 4})
    link = fa.Link(fa.Revolute("z"), fa.RigidBody(0.3, inertia=(1e-3, 1e-3, 2e-3), end=(0.075, 0, 0)), beam)
    arm, t, h = fa.Arm([link, link]), np.linspace(0, 1, 11), 2.8e-4
    tau = np.zeros(arm.nv)
    tau[0] = 1.0
    z = 1j * h * arm.modes().frequencies[-1]
    growth = abs(1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24)
    said = ("step = 0.00028", "1.03e+04 rad/s", "bending_y", "0.000274 s")
    with warns(fa.errors.StepWarning, said) as w:
        fa.simulate(arm, t, tau=tau, integrator="rk4", step=h)
    assert w[0].message.growth == pytest.approx(growth, rel=1e-6) and w[0].filename == __file__
    assert str(pickle.loads(pickle.dumps(w[0].message))) == str(w[0].message)
    with warns(fa.errors.StepWarning, said):
        fa.simulate_batch(arm, t, tau=np.tile(tau, (2, 1, 1)), integrator="rk4", step=h)
    with warns(fa.errors.StepWarning, said):
        fa.rollout(arm, arm.zero, tau=tau[None, None], step=h, nstep=3000, integrator="rk4")
    fa.simulate(arm, t, tau=tau, integrator="rk4", step=2.7e-4)
    fa.rollout(arm, arm.zero, tau=tau[None, None], step=h, nstep=20, integrator="rk4")  # nothing felt yet


def two_masses(**friction: float) -> fa.Arm:
    """0.01 kg on a line, and 1 kg on a spring behind it."""
    base = fa.Link(fa.Prismatic("x", **friction), fa.RigidBody(0.01))
    return fa.Arm([base, fa.Link(fa.Prismatic("x", stiffness=1e4, name="top"), fa.RigidBody(1.0))])


FREE = np.sqrt(1e4 * (1 / 0.01 + 1 / 1.0))  # rad/s, where both masses move; 100 where the first is held
LIMIT = np.sqrt(8) / FREE
TOLD = f"{FREE:.3g} rad/s", "top", f"{LIMIT:.3g} s"
START = {"integrator": "rk4", "q0": [0.0, 1e-12]}


def test_the_limit_is_that_of_free_joints() -> None:
    """The limit of locked joints had been told, or none: here that is ten times longer."""
    with warns(fa.errors.StepWarning, TOLD):
        r = fa.simulate(two_masses(), [0, 1], step=1.01 * LIMIT, **START)
    assert abs(r.q[-1, 1]) > 1e8 * 1e-12
    with refuses(TOLD, error=fa.SimulationError):
        fa.simulate(two_masses(), [0, 1], step=2 * LIMIT, **START)
    with warns(fa.errors.StepWarning, TOLD):
        fa.simulate_batch(two_masses(), [0, 1], step=1.01 * LIMIT, **START)
    with warns(fa.errors.StepWarning, TOLD):
        fa.rollout(two_masses(), step=1.01 * LIMIT, nstep=400, **START)


def test_below_the_limit_and_with_held_joints_nothing_is_told() -> None:
    still, step = fa.Motion(lambda t: (0.0, 0.0, 0.0)), 1.01 * LIMIT
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        below = fa.simulate(two_masses(), [0, 1], step=0.99 * LIMIT, **START)
        held = fa.simulate(two_masses(), [0, 1], step=step, drive={0: still}, **START)
        stuck = fa.simulate(two_masses(coulomb=1.0), [0, 1], step=step, **START)
        fa.simulate_batch(two_masses(), [0, 1], step=step, drive={0: still}, **START)
        fa.rollout(two_masses(), step=step, nstep=400, drive={0: still}, **START)
    assert max(np.abs(r.q).max() for r in (below, held, stuck)) < 1.001e-12


def test_with_friction_the_limit_is_told_where_the_joint_slides() -> None:
    slides = {"step": 1.01 * LIMIT, "v0": [1.0, 0.0], **START}
    with warns(fa.errors.StepWarning, TOLD):
        fa.simulate(two_masses(coulomb=1.0), [0, 1], **slides)
    with warns(fa.errors.StepWarning, TOLD):
        fa.simulate_batch(two_masses(coulomb=1.0), [0, 1], **slides)


def test_a_damper_has_a_limit_too() -> None:
    """Stable while d h/m is below the real root 2.7853 of |1 - x + x^2/2 - x^3/6 + x^4/24| = 1."""
    arm = fa.Arm([fa.Link(fa.Prismatic("x", damping=100.0), fa.RigidBody(1.0))])
    limit = 2.785293563405282 / 100.0
    run = {"t": [0, 12], "v0": [1e-12], "integrator": "rk4"}
    with warns(fa.errors.StepWarning, "100 rad/s", "link 0 prismatic", "0.0279 s"):
        fa.simulate(arm, step=1.02 * limit, **run)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        r = fa.simulate(arm, step=0.99 * limit, **run)
    assert r.q[-1, 0] == pytest.approx(1e-14, rel=1e-6)


def test_an_arm_that_turns_has_a_lower_limit() -> None:
    """Its centrifugal forces stiffen the beam: 208 rad/s at rest, 790 rad/s at 300 rad/s. Steps of 3.8 ms lost 13 J of
    the 4892 J without a word."""
    beam = fa.Beam(0.5, fa.Rectangle(0.001, 0.02), fa.Material(7850, 210e9, 0.3), {"bending_y": 2}, "legendre", 2)
    hub = fa.RigidBody(1.0, inertia=(0.1, 0.1, 0.1), end=(0.05, 0, 0))
    arm, t = fa.Arm([fa.Link(fa.Revolute("z"), hub, beam)]), np.linspace(0, 1, 11)
    w = arm.modes(speed={0: 300.0}).frequencies.max()
    limit = np.sqrt(8) / w
    said = "300 rad/s", f"{w:.3g} rad/s", f"{limit:.3g} s"
    start = {"v0": [300.0, 1e-6, 0.0], "integrator": "rk4"}
    with warns(fa.errors.StepWarning, said):
        fa.simulate(arm, t, step=3.8e-3, **start)
    with warns(fa.errors.StepWarning, "rad/s", "link 0 bending_y 1"):
        fa.rollout(arm, arm.zero, start["v0"], step=3.8e-3, nstep=250, every=25, integrator="rk4")
    with warns(fa.errors.StepWarning, "rad/s", "link 0 bending_y 1"):
        fa.simulate_batch(arm, t, v0=np.tile(start["v0"], (2, 1)), step=3.8e-3, integrator="rk4")
    fa.simulate(arm, t, step=0.98 * limit, **start)

    def soon(t: float, q: np.ndarray, v: np.ndarray) -> float:
        return t - 0.01

    soon.terminal = True  # type: ignore[attr-defined]
    assert len(fa.simulate(arm, t, step=3.8e-3, events=soon, **start).t) == 1  # a row alone tells no time


def test_a_run_through_a_singular_pose_is_told() -> None:
    """Where the second axis of the joint makes the first and the last one parallel, the mass matrix is singular: rk4
    stepped over it, from 3.2 J to 5.4e12 J."""
    first = fa.RigidBody(0.5, (0.2, 0.05, 0.03), (0.01, 0.02, 0.03), (0.3, 0, 0))
    second = fa.RigidBody(0.6, (0.4, 0.05, 0.1), (0.05, 0.12, 0.13))
    links = [fa.Link(fa.Axes(["tx", "ry", "rx", "tz"]), first), fa.Link(fa.Revolute((0.3, -0.36, -1.3)), second)]
    start = {"q0": [0, 0.3, 0, 0, 0.2], "v0": [0.1, 3.0, 0.5, 0.2, -1.0]}
    arm, t = fa.Arm(links, (-1, -5, 8)), np.linspace(0, 1, 11)
    for step in (2e-5, 10**-4.5, 4e-5, 5e-5):  # rounding decides which of the two a step does
        with warnings.catch_warnings(record=True) as seen:
            warnings.simplefilter("always")
            try:
                fa.simulate(arm, t, **start, integrator="rk4", step=step)
                assert any("where the joints move at up to" in str(w.message) for w in seen)
            except fa.SimulationError as e:
                assert "ran away" in str(e)
