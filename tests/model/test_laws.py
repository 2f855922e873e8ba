"""Laws that follow, damp and saturate, against closed forms and recursions by hand."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from pathlib import Path

import flexarm as fa
import numpy as np
import pytest
from messages import refuses
from pages import Ran

EXACT = {"rtol": 1e-10, "atol": 1e-13}
FINE = {"integrator": "implicit", "step": 5e-4}


def mass(m: float = 2.0, **joint) -> fa.Arm:
    return fa.Arm([fa.Link(fa.Prismatic("x", **joint), fa.RigidBody(m))])


def pendulum(gravity: float = 9.81) -> fa.Arm:
    """Two rigid links in a vertical plane."""
    body = fa.RigidBody(1.0, com=(0.3, 0, 0), inertia=(0.01, 0.04, 0.04), end=(0.6, 0, 0))
    links = [fa.Link(fa.Revolute("z", damping=0.1), body), fa.Link(fa.Revolute("z"), body)]
    return fa.Arm(links, gravity=(0, -gravity, 0))


def soft(links: int = 1, payload: float = 0.05) -> fa.Arm:
    """Flexible links in a vertical plane, with a payload, that sag."""
    beam = fa.Beam(0.5, fa.Rectangle(0.003, 0.02), fa.Material(2700, 70e9, 0.3), {"bending_y": 2}, damping_ratio=0.01)
    tip = fa.RigidBody(payload)
    hub = fa.RigidBody(0.2, inertia=(1e-3, 1e-3, 1e-3))
    return fa.Arm([fa.Link(fa.Revolute("z"), hub, beam, tip) for _ in range(links)], gravity=(0, -9.81, 0))


MOVE = fa.Motion([0, 0.4, 1.0], [0.1, 0.5, 0.3], [0, 0.2, 0], [0, 0, 0])


# -- PD with a rate --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rated", [False, True])
def test_pd_follows_a_sine_as_its_transfer_function_says(rated: bool) -> None:
    """m s² q = kp (r - q) + kv s (r - q), or - kv s q: the steady state at w, after the start has died out."""
    m, kp, kv, w = 2.0, 200.0, 40.0, 5.0
    t = np.linspace(0, 4, 401)
    rate = (lambda t: w * np.cos(w * t)) if rated else None
    law = fa.PD(kp, kv, reference=lambda t: np.sin(w * t), reference_rate=rate)
    q = fa.simulate(mass(m), t, control=law, **EXACT).q[:, 0]
    s = 1j * w
    gain = (kp + (kv * s if rated else 0.0)) / (m * s**2 + kv * s + kp)
    late = t > 3
    np.testing.assert_allclose(q[late], (gain * np.exp(s * t[late])).imag, atol=2e-8)


def test_a_motion_is_a_reference_with_its_rate() -> None:
    """As samples (in C++), as a callable, and as reference and rate apart: one and the same run."""
    t = np.linspace(0, 1, 51)
    laws = [
        fa.PD(200.0, 40.0, reference=MOVE),
        fa.PD(200.0, 40.0, reference=fa.Motion(lambda t: MOVE(t))),
        fa.PD(200.0, 40.0, reference=lambda t: MOVE(t)[0], reference_rate=lambda t: MOVE(t)[1]),
    ]
    runs = [fa.simulate(mass(), t, [0.1], control=law, **EXACT).q[:, 0] for law in laws]
    assert np.abs(runs[1] - runs[0]).max() < 1e-8 and np.abs(runs[2] - runs[0]).max() < 1e-8
    without = fa.simulate(mass(), t, [0.1], control=fa.PD(200.0, 40.0, reference=lambda t: MOVE(t)[0]), **EXACT).q[:, 0]
    followed = np.array([MOVE(x)[0] for x in t])
    assert np.abs(runs[0] - followed).max() < 0.3 * np.abs(without - followed).max()


def test_samples_of_reference_and_rate_add_up() -> None:
    """A ramp with its rate: no lag is left; pieces of both, where their times differ."""
    t = np.linspace(0, 2, 101)
    law = fa.PD(200.0, 40.0, reference=([0, 0.5, 2], [0, 0.25, 1.0]), reference_rate=([0, 1.3, 2], [0.5, 0.5, 0.5]))
    run = fa.simulate(mass(), t, v0=[0.5], control=law, **EXACT)
    np.testing.assert_allclose(run.q[:, 0], 0.5 * t, atol=1e-9)


# -- feed-forward and computed torque --------------------------------------------------------------------------------


@pytest.mark.parametrize("reference", [MOVE, fa.Motion(lambda t: MOVE(t))], ids=["samples", "callable"])
def test_feed_forward_carries_a_rigid_arm_along(reference: fa.Motion) -> None:
    """With gravity and joint damping, and nothing to correct it."""
    arm, t = pendulum(), np.linspace(0, 1, 101)
    law = fa.FeedForward([reference, reference])
    run = fa.simulate(arm, t, [0.1, 0.1], control=law, **EXACT)
    followed = np.array([MOVE(x)[0] for x in t])
    assert np.abs(run.q - followed[:, None]).max() < (2e-7 if reference is MOVE else 1e-5)  # its kink is nobody's stop
    v, a = (np.array([MOVE(x)[k] for x in t])[:, None] * [1.0, 1.0] for k in (1, 2))
    q = followed[:, None] * [1.0, 1.0]
    np.testing.assert_allclose(law.forces(arm, t), arm.inverse_dynamics(q, v, a), atol=1e-12)


def test_feed_forward_holds_an_arm_that_sags() -> None:
    """In static balance nothing moves: the torque is what holds it there, found by `equilibrium`."""
    arm, place = soft(2), [0.4, -0.7]
    q = arm.equilibrium([0.4, 0, 0, -0.7, 0, 0], lock=[0, 1])
    tau = arm.inverse_dynamics(q, np.zeros(6), np.zeros(6))
    law = fa.FeedForward(place)
    held = np.where([1, 0, 0, 1, 0, 0], tau, 0.0)
    np.testing.assert_allclose(law.forces(arm, [0.0, 3.0]), [held, held], atol=1e-9)
    straight = fa.FeedForward(place, elastic="zero").forces(arm, 0.0)[0]
    at = arm.inverse_dynamics([0.4, 0, 0, -0.7, 0, 0], np.zeros(6), np.zeros(6))
    np.testing.assert_allclose(straight[[0, 3]], at[[0, 3]], atol=1e-12)
    assert abs(straight[0] - tau[0]) > 1e-3 * abs(tau[0])
    laws = [fa.PD(40.0, 2.0, link=k, reference=r) for k, r in enumerate(place)]
    run = fa.simulate(arm, np.linspace(0, 1, 11), q, control=[*laws, law], **FINE)
    assert np.abs(run.q - q).max() < 1e-9


@pytest.mark.parametrize("order", [2, 3, "exact"])
def test_feed_forward_knows_a_beam_that_bends_far(order: int | str) -> None:
    """A sag of a tenth of its length: the static balance of `equilibrium`, over a move of 1.5 rad."""
    metal = fa.Material(2700, 70e9, 0.3)
    beam = fa.Beam(0.8, fa.Rectangle(0.003, 0.02), metal, {"bending_y": 3}, "legendre", order=order)
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(0.2, inertia=(1e-3,) * 3), beam, fa.RigidBody(0.1))],
                 gravity=(0, -9.81, 0))  # fmt: skip
    move = fa.Motion([0, 1], [0.0, 1.5], [0, 0], [0, 0])
    times = [0.0, 0.5, 1.0]
    forces = fa.FeedForward(move, inertia=False).forces(arm, times)
    sags = []
    for t, found in zip(times, forces, strict=True):
        q = arm.equilibrium([move(t)[0], 0, 0, 0], lock=[0])
        sags.append(abs(arm.frame(q, 0)[0][1] - 0.8 * np.sin(q[0])))
        assert found[0] == pytest.approx(arm.inverse_dynamics(q, np.zeros(4), np.zeros(4))[0], abs=1e-9)
    assert max(sags) > 0.07


def test_computed_torque_linearises_a_rigid_arm_exactly() -> None:
    """a = r'' + kv (r' - v) + kp (r - q) at any state: s² + kv s + kp at each joint."""
    arm, rng = pendulum(), np.random.default_rng(0)
    kp, kv = np.array([100.0, 300.0]), np.array([20.0, 15.0])
    law = fa.ComputedTorque(kp, kv, reference=[MOVE, 0.2], rate=1000).law(arm)
    for t in (0.0, 0.3, 0.9):
        q, v = rng.normal(size=2), rng.normal(size=2)
        a = arm.forward_dynamics(q, v, law(t, q, v))
        r = np.array([MOVE(t), (0.2, 0, 0)]).T
        np.testing.assert_allclose(a, r[2] + kv * (r[1] - v) + kp * (r[0] - q), atol=1e-9 * np.abs(a).max())
    assert fa.ComputedTorque(100.0, reference=0.0, rate=10.0).kv == 20.0


def test_computed_torque_in_a_run_decays_as_its_poles_say() -> None:
    """Sampled fast, in C++, on a rigid arm with gravity: e = e0 (1 + w t) exp(-w t)."""
    arm, t = pendulum(), np.linspace(0, 0.5, 26)
    law = fa.ComputedTorque(400.0, reference=[0.5, -0.3], rate=20_000)
    run = fa.simulate(arm, t, [0.7, 0.1], control=law, integrator="rk4", step=5e-5)
    decay = (1 + 20 * t) * np.exp(-20 * t)
    np.testing.assert_allclose(run.q, [0.5, -0.3] + decay[:, None] * [0.2, 0.4], atol=4e-4)  # half a sample late


def test_computed_torque_of_an_elastic_arm_holds_it_where_it_sags() -> None:
    arm = soft(2)
    q = arm.equilibrium([0.4, 0, 0, -0.7, 0, 0], lock=[0, 1])
    law = fa.ComputedTorque(25.0, reference=[0.4, -0.7], rate=1000)
    run = fa.simulate(arm, np.linspace(0, 0.5, 11), q, control=law, integrator="implicit", step=1e-3)
    assert np.abs(run.q - q).max() < 1e-7
    limited = fa.ComputedTorque(25.0, reference=[1.4, -0.7], rate=1000, limit=[0.5, 3.0]).law(arm)
    assert limited(0.0, q, np.zeros(6))[0] == 0.5


def test_laws_of_another_arm_than_the_one_that_moves() -> None:
    """A rigid model of an arm that bends, and one without the payload: their forces at the arm's joints."""
    arm, light = soft(2, payload=0.2), soft(2, payload=0.0)
    body = fa.RigidBody(0.4, com=(0.3, 0, 0), inertia=(0, 0.02, 0.02), end=(0.5, 0, 0))
    rigid = fa.Arm([fa.Link(fa.Revolute("z"), body)] * 2, gravity=(0, -9.81, 0))
    q, v = np.array([0.3, 0.02, 0, -0.5, 0.01, 0]), np.array([0.2, 0.1, 0, -0.3, 0.2, 0])
    for model, at, own in ((light, [0, 3], light.nv), (rigid, [0, 1], 2)):
        law = fa.ComputedTorque(25.0, reference=[MOVE, 0.1], rate=500, model=model, elastic="zero").law(arm)
        a = np.zeros(own)
        r = np.array([MOVE(0.4), (0.1, 0, 0)]).T
        a[at] = r[2] + 10 * (r[1] - v[[0, 3]]) + 25 * (r[0] - q[[0, 3]])
        x, w = np.zeros(own), np.zeros(own)
        x[at], w[at] = q[[0, 3]], v[[0, 3]]
        tau = law(0.4, q, v)
        np.testing.assert_allclose(tau[[0, 3]], model.inverse_dynamics(x, w, a)[at], atol=1e-10)
        assert tau.shape == (6,) and not tau[[1, 2, 4, 5]].any()
        ahead = fa.FeedForward([MOVE, 0.1], model=model, elastic="zero").forces(arm, 0.4)[0]
        x[at], w[at], a[at] = r
        np.testing.assert_allclose(ahead[[0, 3]], model.inverse_dynamics(x, w, a)[at], atol=1e-10)
    ahead = fa.FeedForward([fa.Motion(lambda t: MOVE(t)), 0.1])
    np.testing.assert_allclose(ahead.forces(arm, [0.7, 0.4])[1], ahead.forces(arm, 0.4)[0], rtol=1e-8)
    with refuses("model", "1 freedoms", "2"):
        fa.FeedForward([MOVE, 0.1], model=soft(1)).forces(arm, 0.4)
    with refuses("model = 3", "Arm"):
        fa.FeedForward(0.1, model=3)


# -- limits ----------------------------------------------------------------------------------------------------------


def test_anti_windup_by_hand() -> None:
    """A mass under a sampled PI law at its limit: the recursion x+ = x + h e + h/(ki Tt) (sat(u) - u), the force held,
    the motion between samples a parabola."""
    m, h, kp, ki, tt, limit = 2.0, 0.02, 30.0, 40.0, 0.1, 3.0
    W = np.array([[h / (ki * tt)]])
    law = fa.LinearController([[1.0]], [[h]], [[ki]], [[kp]], rate=1 / h, measure=[("joint", 0)], reference=1.0,
                              limit=limit, anti_windup=W)  # fmt: skip
    t = np.arange(101) * h
    run = fa.simulate(mass(m, damping=0.0), t, control=law, integrator="rk4", step=h)
    q, v, x, held = 0.0, 0.0, 0.0, 0
    for k in range(100):
        assert run.q[k, 0] == pytest.approx(q, abs=1e-9)
        w = ki * x + kp * (1.0 - q)
        u = np.clip(w, -limit, limit)
        held += abs(w) > limit
        x += h * (1.0 - q) + W[0, 0] * (u - w)
        q, v = q + h * v + 0.5 * h**2 * u / m, v + h * u / m
    assert 10 < held < 95


@pytest.mark.parametrize("rate", [None, 1000])
def test_anti_windup_takes_the_overshoot_away(rate: float | None) -> None:
    """Sampled and continuous alike; and without a limit it does nothing."""
    t = np.linspace(0, 3, 301)
    common = {"rate": rate, "reference": 1.0, "filter_time": 2e-3, "link": 0}
    options = {"integrator": "implicit", "step": 1e-3}

    def run(**more) -> np.ndarray:
        law = fa.LinearController.pid(50.0, 100.0, 20.0, **common, **more)
        return fa.simulate(mass(2.0), t, control=law, **options).q[:, 0]

    winds, led = run(limit=4.0), run(limit=4.0, tracking_time=0.2)
    assert winds.max() - 1 > 0.5 and led.max() - 1 < 0.3 * (winds.max() - 1)
    np.testing.assert_allclose(run(tracking_time=0.2), run(), atol=1e-12)


def test_sampled_and_continuous_anti_windup_agree() -> None:
    t = np.linspace(0, 2, 201)
    both = [
        fa.simulate(
            mass(2.0), t, integrator="implicit", step=2.5e-4,
                control=fa.LinearController.pid(50, 100, 20, rate=rate, reference=1.0, limit=4.0, filter_time=5e-3,
                                            tracking_time=0.2),
        ).q
        for rate in (None, 4000)
    ]  # fmt: skip
    np.testing.assert_allclose(both[0], both[1], atol=2e-3)


# -- strain feedback without what rests ------------------------------------------------------------------------------


def test_strain_feedback_with_static_strain_taken_off_rests_at_its_reference() -> None:
    """Of an arm that sags: with the strain of equilibrium subtracted, gravity's torque alone is left of the error."""
    arm, r = soft(), 0.3
    q = arm.equilibrium([r, 0, 0], lock=[0])
    kp, ks = 40.0, 2.0
    tau = arm.inverse_dynamics(q, np.zeros(3), np.zeros(3))[0]
    strain = arm.strain(q, 0, 0.0)[2]
    held = fa.FeedForward(r)
    t, options = np.linspace(0, 0.2, 3), {"integrator": "implicit", "step": 1e-3}
    law = fa.StrainFeedback(kp, 1.0, ks, reference=r, static="equilibrium")
    still = fa.simulate(arm, t, q, control=[law, held], **options)
    assert np.abs(still.q - q).max() < 1e-9
    law = fa.StrainFeedback(kp, 1.0, ks, reference=r, static=strain)
    still = fa.simulate(arm, t, q, control=[law, held], **options)
    assert np.abs(still.q - q).max() < 1e-9
    pulled = fa.simulate(arm, t, q, control=[fa.StrainFeedback(kp, 1.0, ks, reference=r), held], **options)
    assert pulled.tau[0, 0] == pytest.approx(tau - ks * strain, rel=1e-9)


def test_static_strain_follows_a_moving_reference() -> None:
    """Its offset at each time is k_s times the strain of `equilibrium` there."""
    arm = soft(2)
    law = fa.StrainFeedback(40.0, 1.0, 2.0, link=0, reference=MOVE, static="equilibrium", pose=[9, 9, 9, -0.7, 9, 9])
    plain = fa.StrainFeedback(40.0, 1.0, 2.0, link=0, reference=MOVE)
    for x in (0.0, 0.17, 0.6, 0.99):
        q = arm.equilibrium([MOVE(x)[0], 0, 0, -0.7, 0, 0], lock=[0, 1])
        runs = [fa.simulate(arm, [x, x + 1e-3], control=a, integrator="rk4", step=1e-4) for a in (law, plain)]
        assert runs[0].tau[0, 0] - runs[1].tau[0, 0] == pytest.approx(2.0 * arm.strain(q, 0, 0.0)[2], rel=1e-8)


def test_washout_lets_what_rests_go() -> None:
    """The joint comes to rest where PD alone holds it; its poles are those of the linear model with s / (s + w)."""
    arm, kp, kv, ks, w = soft(), 40.0, 1.0, 2.0, 3.0
    law = fa.StrainFeedback(kp, kv, ks, washout=w)
    t = np.linspace(0, 6, 61)
    q0 = arm.equilibrium([0, 0, 0], lock=[0])
    options = {"integrator": "implicit", "step": 2e-3}
    both = [fa.simulate(arm, t, q0, control=c, **options).q[-1] for c in (law, fa.PD(kp, kv))]
    assert np.abs(both[0] - both[1]).max() < 1e-5
    strong = fa.simulate(arm, t, q0, control=fa.StrainFeedback(kp, kv, ks), **options).q[-1]
    assert np.abs(strong - both[1]).max() > 1e-3


# -- modes -----------------------------------------------------------------------------------------------------------


def closed(arm: fa.Arm, law: fa.LinearController, q: np.ndarray | None = None) -> np.ndarray:
    """Poles of the arm with a continuous controller, by A - B C of both, put together here."""
    q = arm.zero if q is None else q
    model = arm.linearize(q, outputs=law.measure, inputs=law.actuate)
    assert not model.D.any()
    return np.linalg.eigvals(
        np.block([[model.A - model.B @ law.D @ model.C, model.B @ law.C], [-law.B @ model.C, law.A]])
    )


def oscillator(w: float = 30.0, m: float = 2.0) -> fa.Arm:
    return mass(m, stiffness=m * w**2)


def test_ppf_has_the_poles_of_its_polynomial() -> None:
    """(s² + w²) (s² + 2 zeta wf s + wf²) = g wf²/m on an oscillator; stable as long as g / (m w²) < 1."""
    m, w, wf, zeta = 2.0, 30.0, 33.0, 0.4
    for share in (0.2, 0.99, 1.01):
        g = share * m * w**2
        law = fa.LinearController.ppf(wf, zeta, g, measure=[("joint", 0)])
        p = np.polysub(np.polymul([1, 0, w**2], [1, 2 * zeta * wf, wf**2]), [g * wf**2 / m])
        expected, found = np.sort_complex(np.roots(p)), np.sort_complex(closed(oscillator(w, m), law))
        np.testing.assert_allclose(found, expected, atol=1e-7)
        assert (found.real.max() < 0) == (share < 1)


def test_irc_has_the_poles_of_its_polynomial() -> None:
    """(s² + w²) (s + k d) = k / m."""
    m, w, d = 2.0, 30.0, 2.0 / (2.0 * 900.0)
    law = fa.LinearController.irc(50.0 / d, d, measure=[("joint", 0)])
    p = np.polysub(np.polymul([1, 0, w**2], [1, 50.0]), [50.0 / d / m])
    found = np.sort_complex(closed(oscillator(w, m), law))
    np.testing.assert_allclose(found, np.sort_complex(np.roots(p)), atol=1e-7)
    assert found.real.max() < 0


@pytest.mark.parametrize("rate", [None, 2000])
def test_ppf_and_irc_damp_a_run_as_their_poles_say(rate: float | None) -> None:
    arm, t = oscillator(), np.linspace(0, 0.6, 301)
    laws = [
        fa.LinearController.ppf(33.0, 0.4, 0.2 * 1800, measure=[("joint", 0)], rate=rate),
        fa.LinearController.irc(3e4, 2 / 1800, measure=[("joint", 0)], rate=rate),
    ]
    import scipy.linalg as la

    for law in laws:
        run = fa.simulate(arm, t, [0.01], control=law, integrator="implicit", step=5e-4)
        model = arm.linearize(arm.zero)
        cont = law if rate is None else type(law)(**{**law._arguments(), "rate": None})
        A = np.block([[model.A, model.B @ cont.C], [-cont.B @ model.C, cont.A]])
        expected = np.array([(la.expm(A * x) @ np.eye(len(A))[0])[0] * 0.01 for x in t])
        assert np.abs(run.q[:, 0] - expected).max() < (2e-5 if rate is None else 4e-4)


# -- bad input -------------------------------------------------------------------------------------------------------


def jump(t: float) -> tuple[float, float, float]:
    return (0.0 if t < 0.437 else 0.3), 0.0, 0.0


def corner(t: float) -> tuple[float, float, float]:
    return abs(t - 0.37), (1.0 if t > 0.37 else -1.0), 0.0


def run(law: fa.Controller, arm: fa.Arm | None = None, end: float = 1.0) -> None:
    fa.simulate(arm or mass(), [0, end], control=law)


def linear(**more) -> fa.LinearController:
    given = {"rate": 10, "measure": [("joint", 0)], **more}
    return fa.LinearController([[1.0]], [[1.0]], [[1.0]], [[1.0]], **given)


PID, PPF, IRC = fa.LinearController.pid, fa.LinearController.ppf, fa.LinearController.irc
ANGLE = [("joint", 0)]
JUMP = fa.Motion(jump)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: run(fa.PD(1, 1, reference=JUMP)), ("reference", "0.3 rad", "t = 0.437", "jumps")),
        (lambda: run(fa.FeedForward(JUMP)), ("'link 0 prismatic'", "reference", "jumps")),
        (lambda: run(fa.FeedForward(fa.Motion(corner))), ("2 rad/s", "t = 0.37", "jumps")),
        (lambda: run(fa.PD(1, 1, reference=fa.Motion(lambda t: (t, 0.0, 0.0)))), "derivative"),
        (lambda: run(fa.PD(1, 1, reference=MOVE), end=2.0), ("reference", "t = 0.0", "1.0", "samples")),
        (lambda: run(fa.PD(1, 1, reference_rate=([0, 0.5], [0, 1]))), ("reference_rate", "t = 0.0", "0.5", "samples")),
        (lambda: run(fa.FeedForward([MOVE]), pendulum()), ("reference", "1 entries", "2")),
        (lambda: run(fa.ComputedTorque([1, 2, 3], reference=[0, 0], rate=10), pendulum()), "kp has shape (3,)"),
        (lambda: fa.ComputedTorque(-1.0, reference=0, rate=10), "kp = -1.0"),
        (lambda: fa.ComputedTorque([[1.0]], reference=0, rate=10), ("kp =", "number")),
        (lambda: fa.ComputedTorque(1.0, reference=0, rate=0), "rate = 0"),
        (lambda: fa.ComputedTorque(1.0, reference=0, rate=10, elastic="rigid"), "elastic = 'rigid'"),
        (lambda: fa.FeedForward("a").forces(mass(), 0.0), "reference[0] = 'a'"),
        (lambda: run(fa.FeedForward([0.0]), fa.Arm([fa.Link(fa.Spherical(), fa.RigidBody(1.0, inertia=(1, 1, 1)))])),
         ("ball", "angle")),
        (lambda: PID(1, 1, 0, rate=100, tracking_time=1e-3), "tracking_time = 0.001"),
        (lambda: PID(1, 0, 0, rate=100, tracking_time=1), ("tracking_time", "integral")),
        (lambda: linear(anti_windup=[[1.0, 2.0]]), "anti_windup has shape (1, 2)"),
        (lambda: linear(u0=[1.0, 2.0]), "u0 has shape (2,)"),
        (lambda: run(linear(reference=MOVE, measure=[("joint", 0)] * 2)), ("2 numbers", "1 columns")),
        (lambda: run(fa.LinearController([], D=[[1.0, 1.0]], rate=10, reference=MOVE)), "Motion"),
        (lambda: fa.StrainFeedback(1, 1, 1, static="sag"), "static = 'sag'"),
        (lambda: fa.StrainFeedback(1, 1, 1, static=1.0, washout=1.0), "leave out static"),
        (lambda: fa.StrainFeedback(1, 1, 1, washout=-1.0), "washout = -1.0"),
        (lambda: PPF(-1, 0.3, 1, measure=ANGLE), "frequency = -1"),
        (lambda: PPF(100, 0.3, 1, measure=ANGLE, rate=20), ("rate = 20", "31.8")),
        (lambda: PPF(10, 0.3, 1, measure=[*ANGLE, ("rate", 0)]), "measure = [('joint', 0), ('rate', 0)]"),
        (lambda: IRC(1.0, -1.0, measure=ANGLE), ("feedthrough = -1", "sign")),
    ],
)  # fmt: skip
def test_bad_laws(make, message: str) -> None:
    with refuses(message):
        make()


# -- files and batches -----------------------------------------------------------------------------------------------


def every_law(arm: fa.Arm) -> list[fa.Controller]:
    strain = [("strain", 0, 0.0, "K3")]
    return [
        fa.PD(40.0, 1.0, reference=MOVE),
        fa.PD(40.0, 1.0, reference=([0, 1], [0, 0.1]), reference_rate=0.1),
        fa.StrainFeedback(40.0, 1.0, 0.1, reference=MOVE, static="equilibrium"),
        fa.StrainFeedback(40.0, 1.0, 0.1, washout=3.0),
        fa.FeedForward([MOVE]),
        fa.FeedForward(0.3, inertia=False, elastic="zero"),
        fa.ComputedTorque(25.0, reference=[MOVE], rate=500, limit=3.0),
        fa.LinearController.pid(40.0, 10.0, 1.0, rate=500, reference=MOVE, limit=2.0, tracking_time=0.1),
        fa.LinearController.ppf(60.0, 0.4, 1e-3, measure=strain, rate=500),
        fa.LinearController.irc(1e-3, 3.0, measure=strain),
        fa.LinearController([[0.9]], [[0.1, 0.0]], [[1.0]], [[5.0, 1.0]], rate=200, limit=2.0, anti_windup=[[0.2]],
                            u0=[0.1], measure=[("joint", 0), ("rate", 0)], reference=MOVE),
        fa.LinearController([], D=[[5.0, 0, 0, 0.2, 0, 0]], rate=200),
        fa.lqg(arm, [0.1, 0, 0], measure=[("joint", 0), *strain], rate=500, delay=3e-3, limit=5.0),
        fa.lqr(arm, [0.1, 0, 0]),
    ]  # fmt: skip


@pytest.mark.parametrize("k", range(14))
def test_every_law_in_a_scene_file_and_in_a_batch(k: int, tmp_path: Path) -> None:
    """Read back from a file it runs to the same numbers; so it does in a batch, whose scenarios differ in payload."""
    arm, t = soft(), np.linspace(0, 0.2, 21)
    law = every_law(arm)[k]
    options = {"integrator": "implicit", "step": 1e-3}
    scene = fa.Scene(arm, t=t, control=(law,), q0=arm.equilibrium([0.1, 0, 0], lock=[0]), options=options)
    run = scene.run()
    scene.save(tmp_path / "scene.toml")
    again = fa.load(tmp_path / "scene.toml")
    assert type(again.control[0]) is type(law)
    np.testing.assert_allclose(again.run().q, run.q, atol=1e-12)
    parameters = {"link.0.tip.mass": [0.05, 0.1]}
    batch = fa.simulate_batch(arm, t, scene.q0, control=law, parameters=parameters, **options)
    assert (batch.status == 0).all()
    np.testing.assert_allclose(batch.q[0], run.q, atol=1e-8)
    heavy = fa.simulate(soft(payload=0.1), t, scene.q0, control=law, **options)
    np.testing.assert_allclose(batch.q[1], heavy.q, atol=1e-8)


def test_numbers_of_the_page_on_control(page_of_docs: Callable[[str], Ran]) -> None:
    """Following a motion, damping a mode, a regulator about a place."""
    pytest.importorskip("control")
    states = page_of_docs("docs/control.md").states
    followed, damped, regulated = (next(s for s in states if name in s) for name in ("same", "ring", "regulator"))
    arm, t, motion = (followed[name] for name in ("arm", "t", "motion"))
    wanted = np.array([motion(x)[0] for x in t])
    joints = [0, 4]
    bare = fa.simulate(arm, t, followed["q0"], control=followed["hold"], integrator="implicit", step=1e-3)
    off = [np.abs(run.q[:, joints] - wanted[:, None]).max() for run in (bare, followed["run"], followed["same"])]
    assert off[0] > 0.1 and max(off[1:]) < 0.01
    assert np.abs(damped["ring"].q[-100:, 0]).max() < 0.05 * 1e-3
    place = arm.equilibrium(regulated["place"], lock=[0, 1])
    assert np.abs(regulated["run"].q[-1] - place).max() < 1e-3


@pytest.mark.parametrize(
    ("k", "name", "value"), [(6, "kp", 30.0), (7, "tracking_time", 0.2), (8, "gain", 1.0), (9, "feedthrough", 0.1)]
)
def test_arguments_of_laws_vary_in_batches(k: int, name: str, value: float) -> None:
    """A law that is made of its arguments is made anew."""
    arm, t = soft(), np.linspace(0, 0.2, 21)
    law, options = every_law(arm)[k], {"integrator": "implicit", "step": 1e-3}
    parameters = {f"control.0.{name}": [value]}
    batch = fa.simulate_batch(arm, t, [0.1, 0.01, 0.0], control=law, parameters=parameters, **options)
    other = type(law)(**{**law._arguments(), name: value})
    q = fa.simulate(arm, t, [0.1, 0.01, 0.0], control=other, **options).q
    np.testing.assert_allclose(batch.q[0], q, atol=1e-10)
    assert np.abs(q - fa.simulate(arm, t, [0.1, 0.01, 0.0], control=law, **options).q).max() > 1e-12


@pytest.mark.parametrize("k", [0, 2, 3, 4])
def test_runs_are_derived_through_the_laws(k: int) -> None:
    """By a payload, which the feed-forward and the static strain know: against differences."""
    t, law = np.linspace(0, 0.2, 21), every_law(soft())[k]
    options = {"integrator": "implicit", "step": 1e-3}
    run = fa.simulate(soft(), t, [0.1, 0.01, 0.0], control=law, **options)
    ends = [fa.simulate(soft(payload=0.05 + d), t, [0.1, 0.01, 0.0], control=law, **options).q for d in (1e-5, -1e-5)]
    by = (ends[0] - ends[1]) / 2e-5
    np.testing.assert_allclose(run.sensitivities(["link.0.tip.mass"]).q[0], by, atol=1e-6 * np.abs(by).max())


def test_laws_show_their_gains_in_one_line() -> None:
    def law(t: float, y: np.ndarray) -> float:
        return 0.0

    pid = fa.LinearController.pid(20, 0, 1, "elbow", rate=500, delay=0.001)
    assert str(pid) == repr(pid) == "PID(kp=20, ki=0, kd=1, link='elbow', rate=500, delay=0.001)"
    assert str(fa.PD(20, 2.5, reference=0.5, limit=3)) == "PD(kp=20, kv=2.5, link=-1, reference=0.5, limit=3)"
    sampled = str(fa.Sampled(law, 100, [("joint", 0), fa.sensors.Encoder(0)]))
    assert sampled == "Sampled(law=law, rate=100, measure=[('joint', 0), Encoder], actuate=[-1])"
    assert str(fa.StateFeedback([[3, 4]], [0])) == "StateFeedback(K=[3, 4], actuate=[0])"
    assert str(fa.StateFeedback(np.ones((2, 8)), [0, 1])) == "StateFeedback(K=2 x 8 numbers, actuate=[0, 1])"
    assert str(fa.ComputedTorque(100, 20, reference=0.0, rate=500)).startswith("ComputedTorque(kp=[100], kv=[20], ")
    system = fa.LinearController([[0.5]], [[1.0]], [[1.0]], [[2.0]], measure=[("rate", 0)])
    assert str(system) == "LinearController(A=[0.5], B=[1], C=[1], D=[2], measure=[('rate', 0)], actuate=[-1])"
    assert " at 0x" not in repr(fa.MPC(reference=1.0, rate=50))


@pytest.mark.parametrize("how", [EXACT, FINE])
def test_what_a_law_raises_says_which_law_and_when(how) -> None:
    def law(t: float, y: np.ndarray) -> float:
        return 1.0 / (t < 0.005)

    said = "".join
    with pytest.raises(ZeroDivisionError) as raised:
        fa.simulate(pendulum(), [0, 0.1], control=[fa.PD(1, 1), fa.Sampled(law, 500)], **how)
    assert "control[1] at t = 0.006 s" in said(traceback.format_exception(raised.value))
    with pytest.raises(ZeroDivisionError) as raised:
        fa.closed_loop(pendulum(), fa.Sampled(law, 500), t=0.1)
    assert "control[0] at t = 0.1" in said(traceback.format_exception(raised.value))
