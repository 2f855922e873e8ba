"""Closed loops: poles against characteristic equations solved apart, margins against python-control."""

from __future__ import annotations

import re
from typing import Any

import control as ct
import flexarm as fa
import numpy as np
import pytest
from arms import STEEL, paper_link
from messages import warns
from scipy.optimize import fsolve

INERTIA = 0.35


def rigid() -> fa.Arm:
    return fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, (0.5, 0, 0), (0, 0, 0.1), (1, 0, 0)))])


def has(found: np.ndarray, expected: np.ndarray, rel: float = 1e-9) -> None:
    """Every expected pole is among those found."""
    for pole in np.atleast_1d(expected):
        assert np.abs(found - pole).min() <= rel * max(abs(pole), 1e-3), (pole, found)


def sampled_pd(kp: float, kd: float, rate: float, delay: float = 0.0) -> fa.Sampled:
    return fa.Sampled(
        lambda t, y: -INERTIA * (kp * y[0] + kd * y[1]), rate, [("joint", 0), ("rate", 0)], delay=delay
    )


def test_pd_on_a_rigid_link_is_a_quadratic() -> None:
    loop = fa.closed_loop(rigid(), fa.PD(25 * INERTIA, INERTIA))
    assert loop.z is None and loop.period is None and loop.stable
    has(loop.poles, np.roots([1, 1, 25]))
    assert loop.frequencies == pytest.approx([5, 5]) and loop.damping == pytest.approx([0.1, 0.1])
    assert fa.closed_loop(rigid(), fa.PD(25 * INERTIA, -INERTIA)).growth == pytest.approx(0.5)
    assert "UNSTABLE" in str(fa.closed_loop(rigid(), fa.PD(25 * INERTIA, -INERTIA)))


@pytest.mark.parametrize("parts", [0.0, 0.3, 1.0, 1.3, 2.0])
def test_a_sampled_pd_with_a_delay_is_its_polynomial(parts: float) -> None:
    """A double integrator, held force, `parts` of a period late: z^(m+1) (z - 1)^2 = b(z), by hand."""
    kp, kd, T = 20.0, 5.0, 0.01
    loop = fa.closed_loop(rigid(), sampled_pd(kp, kd, 1 / T, parts * T))
    m, e = int(parts), (parts - int(parts)) * T
    new, old = T - e, e  # for how long the newer and the older force act
    # x+ = x + T v + (new^2 / 2) u + (old new + old^2 / 2) u', v+ = v + new u + old u'
    a = np.array([new**2 / 2, old * new + old**2 / 2]), np.array([new, old])
    # x = [(a0 z + a1)(z - 1) + T (b0 z + b1)] / (z - 1)^2, v = (b0 z + b1) / (z - 1), u = z^-(m+1) U
    x = np.polymul(a[0], [1, -1]) + T * np.concatenate([[0], a[1]])
    v = np.polymul(a[1], [1, -1])
    poly = np.polymul([1.0, -2.0, 1.0] + [0.0] * (m + 1), [1.0])
    expected = np.roots(np.polyadd(poly, kp * x + kd * v))
    expected = expected[np.abs(expected) > 1e-9]  # without a part of a period, z cancels
    assert len(loop.z) == len(expected)
    has(loop.z, expected, 1e-8)
    assert loop.poles == pytest.approx(np.log(loop.z) / T)


def test_pd_on_an_euler_bernoulli_beam_with_a_tip_mass() -> None:
    """u = a sin + b cos + c sinh + d cosh of k x, s^2 = -(k^4) EI/m: PD on the angle at x = 0, a mass at x = L."""
    L, section, mass, kp, kd = 0.6, fa.Rectangle(0.0005, 0.02), 0.02, 0.3, 0.01
    EI, m = STEEL.youngs_modulus * 0.02 * 0.0005**3 / 12, STEEL.density * 0.0005 * 0.02
    beam = fa.Beam(L, section, STEEL, {"bending_y": 9}, "legendre", 1)
    arm = fa.Arm([fa.Link(fa.Revolute("z"), beam=beam, tip=fa.RigidBody(mass))])

    def determinant(s: complex) -> complex:
        k = (-(s**2) * m / EI) ** 0.25
        c, s_, ch, sh = np.cos(k * L), np.sin(k * L), np.cosh(k * L), np.sinh(k * L)
        rows = [
            [0, 1, 0, 1],  # u(0) = 0
            [(kp + kd * s) * k, EI * k**2, (kp + kd * s) * k, -EI * k**2],  # EI u'' = (kp + kd s) u'
            [-s_, -c, sh, ch],  # u''(L) = 0
            [-EI * k**3 * c - mass * s**2 * s_, EI * k**3 * s_ - mass * s**2 * c,
             EI * k**3 * ch - mass * s**2 * sh, EI * k**3 * sh - mass * s**2 * ch],
        ]  # fmt: skip
        scale = np.array([1.0, 1.0 / k**2, 1.0, 1.0 / k**3])[:, None]
        return complex(np.linalg.det(np.array(rows) * scale) / np.cosh(k.real * L))

    loop = fa.closed_loop(arm, fa.PD(kp, kd))
    found = loop.poles[(loop.poles.imag > 1.0)]
    found = found[np.argsort(np.abs(found))][:4]
    assert len(found) == 4
    for pole in found:
        x = fsolve(lambda x: [(d := determinant(x[0] + 1j * x[1])).real, d.imag], [pole.real, pole.imag], xtol=1e-12)
        assert abs(complex(*x) - pole) < 2e-5 * abs(pole) and abs(determinant(complex(*x))) < 1e-7


def test_pid_is_the_polynomial_of_its_transfer() -> None:
    kp, ki, kd, tf = 30.0, 20.0, 6.0, 0.02
    law = fa.LinearController.pid(kp * INERTIA, ki * INERTIA, kd * INERTIA, filter_time=tf)
    loop = fa.closed_loop(rigid(), law)
    # s^2 + kp + ki / s + kd s / (tf s + 1) = 0
    expected = np.roots([tf, 1.0, kp * tf + kd, kp + ki * tf, ki])
    assert len(loop.poles) == 4
    has(loop.poles, expected, 1e-8)
    T = 0.004
    sampled = fa.LinearController.pid(kp * INERTIA, ki * INERTIA, kd * INERTIA, rate=1 / T, filter_time=tf)
    s = ct.tf("s")
    D = ct.sample_system(kp + ki / s + kd * s / (tf * s + 1), T, "tustin")
    plant = ct.sample_system(ct.tf([1.0], [1.0, 0.0, 0.0]), T, "zoh")
    has(fa.closed_loop(rigid(), sampled).z, (1 / (1 + D * plant)).minreal(1e-6).poles(), 1e-6)


def test_motors_brake_and_joints_spring() -> None:
    motor = fa.Motor(0.05, 50.0, resistance=2.0)
    loop = fa.closed_loop(rigid(), fa.PD(3.0, 0.2, motor=motor))
    gain = motor.gain
    has(loop.poles, np.roots([INERTIA, gain * 0.2 + motor.braking, gain * 3.0]))
    assert [c.name for c in loop.channels] == ["PD of 'link 0 revolute'"]  # the back-EMF is no loop of ours


def test_state_feedback_has_the_poles_it_was_designed_for() -> None:
    arm = paper_link(1)
    model = arm.linearize(arm.zero)
    K, _, poles = ct.lqr(model.A, model.B, np.diag([50.0, 10, 10, 10, 1e-3, 1e-2, 1e-3, 1e-3]), [[1.0]])
    loop = fa.closed_loop(arm, fa.StateFeedback(K))
    has(loop.poles, poles, 1e-7)
    assert loop.margins[0].phase > np.radians(60) - 1e-6 and loop.margins[0].gain[0] < 0.5  # what an LQR promises
    assert loop.robustness.value >= 1.0 - 1e-6


def control_loop(rate: float | None = None, delay: float = 0.0):
    """Strain feedback on the paper's arm: the loop, and its gain as a python-control system made apart."""
    arm = fa.load("ist_control").arm
    kp, kv, ks, gain = 0.22, 0.001, -0.015, 62.584
    measured = [("joint", 0), ("rate", 0), ("strain", 0, 0.0, "K3")]
    model = arm.linearize(arm.zero, inputs=[0], outputs=measured)
    K = np.array([[kp, kv, ks]])
    open_ = ct.ss(model.A, gain * model.B, K @ model.C, 0.0)
    if rate is None:
        return fa.closed_loop(arm, fa.StrainFeedback(kp, kv, ks, motor=fa.Motor(gain))), open_
    law = fa.Sampled(lambda t, y: -(K @ y), rate, measured, motor=fa.Motor(gain), delay=delay)
    sampled = ct.sample_system(open_, 1 / rate, "zoh")
    late = ct.tf([1.0], [1.0] + [0.0] * round(delay * rate), 1 / rate)
    return fa.closed_loop(arm, law), ct.ss(late) * sampled


@pytest.mark.parametrize(("rate", "delay"), [(None, 0.0), (500.0, 0.0), (1000.0, 0.001), (1000.0, 0.002)])
def test_margins_are_those_of_python_control(rate: float | None, delay: float) -> None:
    loop, open_ = control_loop(rate, delay)
    if rate is None:
        of = open_
    else:  # of a sampled system python-control takes samples of its response
        fine = np.unique(np.concatenate([np.linspace(0.5, np.pi * rate * 0.9999, 4000), np.linspace(125, 132, 2000)]))
        of = ct.frd(open_(np.exp(1j * fine / rate)), fine, smooth=True)
    gm, pm, _, _, wgc, _ = ct.stability_margins(of, returnall=True)
    found = loop.margins[0]
    above, below = gm[gm > 1], gm[(gm < 1) & (gm > 1e-6)]
    near = 1e-4 if rate is None else 5e-4
    assert found.gain[1] == pytest.approx(above.min() if above.size else np.inf, rel=near)
    assert found.gain[0] == pytest.approx(below.max() if below.size else 0.0, rel=1e-4, abs=1e-9)
    assert found.phase == pytest.approx(np.radians(np.abs(pm).min()), rel=1e-4)
    w = loop.margins[0].phase_frequency
    expected = complex(open_(1j * w if rate is None else np.exp(1j * w / rate)))
    assert loop.loop_gain(w)[0, 0, 0] == pytest.approx(expected)
    assert np.abs(loop.loop_gain(w)) == pytest.approx(1.0)
    grid = np.unique(np.concatenate([np.geomspace(1.0, 1e3, 4000), np.linspace(125, 132, 4000)]))
    response = open_(1j * grid) if rate is None else open_(np.exp(1j * grid / rate))
    assert loop.robustness.value == pytest.approx(np.abs(1 + response).min(), rel=1e-3)
    if rate is None:
        lags = (np.radians(pm) % (2 * np.pi)) / wgc
        assert found.delay == pytest.approx(lags.min(), rel=1e-4)
    has(loop.poles if rate is None else loop.z, ct.feedback(open_, 1).poles(), 1e-6)


def test_margins_print_as_a_table_with_units() -> None:
    """Of PD on one inertia: L = (kd s + kp) / (I s^2) has size 1 at w, and atan(kd w / kp) of phase there."""
    inertia, kp, kd = 0.5, 2.0, 0.3
    arm = fa.Arm([fa.Link(fa.Revolute("z", reflected_inertia=inertia), fa.RigidBody(end=(0.1, 0, 0)))])
    loop = fa.closed_loop(arm, fa.PD(kp, kd))
    w = np.sqrt((kd**2 + np.sqrt(kd**4 + 4 * inertia**2 * kp**2)) / (2 * inertia**2))
    phase = np.arctan(kd * w / kp)
    head, line, row = str(loop.margins[0]).splitlines()
    assert re.split(r"  +", head) == ["loop at", "gain, from", "to", "phase (deg)", "at (rad/s)", "delay (ms)"]
    name, *cells = re.split(r"  +", row)
    assert name == "PD of 'link 0 revolute'" and cells[:2] == ["0", "inf"]
    assert [float(x) for x in cells[2:]] == pytest.approx([np.degrees(phase), w, 1e3 * phase / w], rel=1e-3)
    assert f"{head}\n{line}\n{row}\n{loop.robustness}" in str(loop)
    assert repr(loop.margins[0]).startswith("""Margins(name="PD of 'link 0 revolute'", gain=(""")


def test_channels_have_the_names_of_their_joints() -> None:
    """Two of one name have what tells them apart."""
    body = fa.RigidBody(1.0, inertia=(0.1, 0.1, 0.1), end=(0.3, 0, 0))
    arm = fa.Arm([fa.Link(fa.Revolute("z", name="shoulder"), body), fa.Link(fa.Revolute("z", name="elbow"), body)])
    D = [[9.0, 0, 3, 0], [0, 9.0, 0, 3]]
    both = fa.LinearController(np.zeros((0, 0)), np.zeros((0, 4)), np.zeros((2, 0)), D, rate=100, actuate=[0, 1])
    laws = [fa.PD(5, 1, link="elbow"), both, fa.PD(1, 1, link="elbow")]
    assert [c.name for c in fa.closed_loop(arm, laws).channels] == [
        "PD of 'elbow' (control[0])", "PD of 'elbow' (control[2])",
        "LinearController of 'shoulder'", "LinearController of 'elbow'",
    ]  # fmt: skip
    with warns(fa.errors.LoopWarning, "PD", "'elbow'", "energy"):
        fa.simulate(arm, np.linspace(0, 2, 21), v0=[0, 1e-3], control=fa.PD(5, -1, link="elbow"))


@pytest.mark.parametrize("law", [{}, {"delay": True, "rate_effort": 1e-4}])
def test_predictive_control_decays_as_its_poles_say(law: dict[str, Any]) -> None:
    beam = fa.Beam(0.5, fa.Rectangle(0.004, 0.02), fa.Material(2700, 70e9, 0.3), {"bending_y": 2}, damping_ratio=0.01)
    joint = fa.Revolute("z", reflected_inertia=0.05)
    arm = fa.Arm([fa.Link(joint, fa.RigidBody(0.5), beam, fa.RigidBody(0.1))], gravity=(0, -9.81, 0))
    rest = arm.trim(arm.zero).q
    loop = fa.closed_loop(arm, fa.MPC(track="joints", reference=0.0, limit=200, **law), q=rest)
    t, start = np.linspace(0, 6, 601), rest + 1e-3 * np.eye(arm.nq)[0]
    control = fa.MPC(track="joints", reference=0.0, limit=200, **law)
    run = fa.simulate(arm, t, start, control=control, integrator="implicit", step=5e-4)
    found = fa.fit_decay(t[100:], run.q[100:, 1] - run.q[-100:, 1].mean(), 1)
    pole = loop.poles[np.abs(np.abs(loop.poles) - found.frequencies[0]).argmin()]  # of what rings longest
    assert found.frequencies[0] == pytest.approx(abs(pole), rel=3e-3)
    assert found.damping[0] == pytest.approx(-pole.real / abs(pole), rel=0.05)


@pytest.mark.parametrize("rate", [None, 500.0])
def test_states_that_reach_no_output_have_no_poles(rate: float | None) -> None:
    """A PID whose ki is zero is a PD with a filter: the integral is not part of the loop."""
    given: dict[str, Any] = {"filter_time": 0.004, "rate": rate}
    loop = fa.closed_loop(rigid(), fa.LinearController.pid(20, 0, 4, 0, **given))
    assert len(loop.poles) == 3 and loop.growth < -0.1
    assert "does not die away" not in str(loop)
    # the same law of one state: u = D e + C x, x' = (e - x) / tf, with D = kp + kd / tf, C = -kd / tf
    same = fa.LinearController(
        ([[-250.0]], [[250.0]], [[-1000.0]], [[1020.0]]), rate=rate, measure=[("joint", 0)], actuate=[0]
    )
    assert np.sort_complex(loop.poles) == pytest.approx(np.sort_complex(fa.closed_loop(rigid(), same).poles))
    assert loop.limits().high == pytest.approx(fa.closed_loop(rigid(), same).limits().high)
    whole = fa.closed_loop(rigid(), fa.LinearController.pid(20, 1e-6, 4, 0, **given))
    assert len(whole.poles) == 4
    beside = fa.closed_loop(rigid(), [fa.LinearController.pid(20, 0, 4, 0, **given), same])
    assert len(beside.poles) == 4 and beside.growth < -0.1


def test_the_poles_beside_motions_that_nothing_holds() -> None:
    """A sled that nothing holds, and a beam on it under PD: M, C, K and the gains by hand."""
    steel = fa.Material(7850, 209e9, 0.3)
    strips = fa.Rectangle(0.009, 0.012), fa.Rectangle(0.007, 0.0044)
    beams = [fa.Beam(length, s, steel, {"bending_y": 1}) for length, s in zip((0.467, 0.31), strips, strict=True)]
    hub, joints = fa.RigidBody(0.4, inertia=np.eye(3) * 0.04, end=(0.03, 0, 0)), (fa.Prismatic("y"), fa.Revolute("z"))
    arm = fa.Arm([fa.Link(j, hub, b, fa.RigidBody(0.3)) for j, b in zip(joints, beams, strict=True)])
    n, j, zero = arm.nv, arm.joint_rate(1), np.zeros(arm.nv)
    M, (K, C) = arm.mass_matrix(zero), arm.inverse_derivatives(zero, zero, zero)[:2]
    K[j, j] += 27.0
    C[j, j] += 1.8
    by_hand = np.linalg.eigvals(np.block([[0 * M, np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]]))
    found = fa.closed_loop(arm, fa.PD(27.0, 1.8, 1)).poles
    for s in by_hand[np.abs(by_hand) > 1e-3]:
        assert np.abs(found - s).min() < 1e-8 * np.abs(by_hand).max()
