"""Time: published manoeuvres, conservation, drives, failure, interruption."""

import os
import pickle
import signal
import threading
import time
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from arms import paper_link, reference
from messages import refuses
from scipy.integrate import solve_ivp


def kane_beam(order: int) -> fa.Arm:
    """L 10, EI 1.4e4, rho A 1.2, rho I 6e-4, GA 1e7 (Kane, Ryan & Banerjee 1987; Simo & Vu-Quoc 1986)."""
    I = 6e-4 / 1.2
    section = fa.sections.GeneralSection(1.0, I, I, 1.0, shear_correction=1.0)
    material = fa.Material(1.2, 1.4e4 / I, shear_modulus=1e7)
    modes = {"bending_y": 5}
    return fa.Arm([fa.Link(fa.Revolute("z"), beam=fa.Beam(10.0, section, material, modes, "legendre", order))])


SPIN_UPS = [  # arm, speed, time, peak tip deflection of order 0, order 1, and order 2 with linear elastic equations
    (kane_beam, 6.0, 15.0, -0.629158, None, -0.574367),
    (lambda order: paper_link(order, 6, "legendre"), 7.6, 0.5, -0.070408, -0.072146, -0.069682),
    (lambda order: paper_link(order, 6, "legendre"), 10.0, 1.0, -0.032604, -0.035444, -0.031594),
]


@pytest.mark.parametrize("case", SPIN_UPS, ids=["kane", "paper 7.6", "paper 10"])
def test_spin_up_at_orders_zero_and_one(case) -> None:
    make, speed, duration, *peaks, _ = case
    for order, peak in enumerate(peaks):
        if peak is None:
            continue
        r = fa.simulate(make(order), np.linspace(0, duration, 1501), drive={0: fa.Motion.spin_up(speed, duration)})
        assert r.tip_deflection()[:, 1].min() == pytest.approx(peak, rel=3e-5)


@pytest.mark.parametrize("case", SPIN_UPS, ids=["kane", "paper 7.6", "paper 10"])
def test_spin_up_of_the_linearised_order_two(case) -> None:
    """The published order-2 numbers keep the elastic equations linear: M ddq + K(Omega) q = -m dOmega. The exact
    Jacobians along the motion give just that; the full order-2 model stays within half a per cent of it."""
    make, speed, duration, *_, peak = case
    arm = make(2)
    law = fa.Motion.spin_up(speed, duration).law
    n, zero = arm.nv, np.zeros(arm.nv)
    M = arm.mass_matrix(zero)
    invM = np.linalg.inv(M[1:, 1:])
    hub = np.eye(n)[0]
    rest, spin, thrust = (  # K = rest + Omega^2 spin + dOmega thrust
        arm.inverse_derivatives(zero, w * hub, dw * hub)[0][1:, 1:] for w, dw in ((0, 0), (1, 0), (0, 1))
    )

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        _, w, dw = law(t)
        K = rest + w**2 * (spin - rest) + dw * (thrust - rest)
        return np.concatenate([y[n - 1 :], -invM @ (K @ y[: n - 1] + M[1:, 0] * dw)])

    t = np.linspace(0, duration, 1501)
    y = solve_ivp(rate, (0, duration), np.zeros(2 * n - 2), "DOP853", t, rtol=1e-8, atol=1e-10).y
    q = np.hstack([np.zeros((len(t), 1)), y[: n - 1].T])
    assert arm.deflection(q)[:, 1].min() == pytest.approx(peak, rel=3e-5)
    full = fa.simulate(arm, t, drive={0: fa.Motion.spin_up(speed, duration)}, max_order=2).tip_deflection()[:, 1].min()
    assert full == pytest.approx(peak, rel=6e-3)


@pytest.mark.parametrize("rtol", [1e-5, 1e-7, 1e-9])
@pytest.mark.parametrize("name", ["ist_order1", "ist_order2", "elbow_order2"])
def test_energy_is_conserved_to_the_tolerance(name: str, rtol: float) -> None:
    """Undamped, unforced: T + U stays within a small multiple of the tolerance."""
    arm = fa.Arm.from_dict(reference(name)["scene"])
    v0 = np.zeros(arm.nv)
    v0[0] = 2.0
    q0 = np.zeros(arm.nv)
    q0[1] = 0.05
    r = fa.simulate(arm, np.linspace(0, 0.05, 51), q0, v0, rtol=rtol, atol=1e-2 * rtol)
    kinetic, potential = r.energy()
    assert np.ptp(kinetic + potential) < 100 * rtol * np.ptp(kinetic)


def test_tighter_tolerances_converge() -> None:
    arm, t = paper_link(), np.linspace(0, 1, 101)
    drive = {0: fa.Motion.spin_up(7.6, 0.5)}
    truth = fa.simulate(arm, t, drive=drive, rtol=1e-11, atol=1e-13).q
    errors = [
        np.abs(fa.simulate(arm, t, drive=drive, rtol=r, atol=r * 1e-2).q - truth).max() for r in (1e-4, 1e-6, 1e-8)
    ]
    assert errors[0] < 1e-3 and errors[1] < 1e-5 and errors[2] < 1e-7
    assert errors[0] > 3 * errors[1] > 9 * errors[2]


def test_motion_samples_and_callable_agree() -> None:
    arm, t = paper_link(), np.linspace(0, 1, 51)
    law = fa.Motion.spin_up(7.6, 0.5).law
    s = np.linspace(0, 1, 401)
    q, v, a = np.array([law(x) for x in s]).T
    runs = [
        fa.simulate(arm, t, drive={0: m}, rtol=1e-9, atol=1e-11)
        for m in (fa.Motion(law), fa.Motion(s, q, v, a), fa.Motion(s, q))
    ]
    for r in runs[1:]:
        assert np.abs(r.tip_deflection() - runs[0].tip_deflection()).max() < 1e-6
    # the reaction is the torque that makes the motion
    free = fa.simulate(
        arm, t, drive={0: fa.Torque(t_fine := np.linspace(0, 1, 2001), _reaction(arm, t_fine))}, rtol=1e-9
    )
    assert np.abs(free.q[:, 0] - runs[0].q[:, 0]).max() < 1e-4


def _reaction(arm: fa.Arm, t: np.ndarray) -> np.ndarray:
    return fa.simulate(arm, t, drive={0: fa.Motion.spin_up(7.6, 0.5)}, rtol=1e-9, atol=1e-11).tau[:, 0]


def test_torque_and_constant_force() -> None:
    """A rigid hub under a constant, a sampled and a callable torque: closed forms."""
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(inertia=(0, 0, 2.0)))])
    t = np.linspace(0, 2, 21)
    constant = fa.simulate(arm, t, drive={0: fa.Torque(3.0)})
    np.testing.assert_allclose(constant.q[:, 0], 0.75 * t**2, atol=1e-6)
    np.testing.assert_allclose(constant.tau[:, 0], 3.0)
    also = fa.simulate(arm, t, tau=[3.0])
    np.testing.assert_allclose(also.q, constant.q, atol=1e-9)
    ramp = fa.simulate(arm, t, drive={0: fa.Torque([0, 2], [0, 6])})
    np.testing.assert_allclose(ramp.q[:, 0], t**3 / 4, atol=1e-6)
    called = fa.simulate(arm, t, drive={0: fa.Torque(lambda x: 3 * x)})
    np.testing.assert_allclose(called.q, ramp.q, atol=1e-6)


def test_everything_prescribed() -> None:
    arm = fa.Arm([fa.Link(fa.Prismatic("x"), fa.RigidBody(2.0))])
    t = np.linspace(0, 1, 11)
    r = fa.simulate(arm, t, drive={0: fa.Motion(lambda x: (x**2, 2 * x, 2.0))})
    np.testing.assert_allclose(r.q[:, 0], t**2)
    np.testing.assert_allclose(r.tau, 4.0)


@pytest.mark.filterwarnings("ignore::flexarm.errors.RangeWarning")  # bends far, on purpose
def test_order_one_diverges_above_its_critical_speed() -> None:
    t = np.linspace(0, 4, 101)
    drive = {0: fa.Motion.spin_up(24.0, 1.0)}
    tip = {}
    for order in (1, 2):
        try:
            tip[order] = np.abs(fa.simulate(paper_link(order), t, drive=drive).tip_deflection()[:, 1]).max()
        except fa.SimulationError as e:
            tip[order] = np.abs(e.result.tip_deflection()[:, 1]).max()
    assert 1.0 < tip[1] < 5.0 and tip[2] < 0.2  # given up at ten lengths


def test_failure_returns_what_there_is() -> None:
    """A torque that runs away: SimulationError with the time reached and the result up to there."""
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(inertia=(0, 0, 1.0)))])
    runaway = fa.Torque(lambda t: 1.0 / max(1.0 - t, 1e-300) ** 3)
    with refuses("t =", error=fa.SimulationError) as caught:
        fa.simulate(arm, np.linspace(0, 2, 201), drive={0: runaway})
    error = caught.value
    assert 0.9 < error.time <= 1.01
    assert len(error.result.t) == len(error.result.q) > 90
    assert error.result.t[-1] <= error.time + 0.01 and np.isfinite(error.result.q).all()


def test_errors_of_a_drive_come_through() -> None:
    arm = paper_link()

    def broken(t: float) -> float:
        raise KeyError("no such torque")

    with refuses("no such torque", error=KeyError):
        fa.simulate(arm, [0, 1], drive={0: fa.Torque(broken)})
    with refuses("Torque at t = 0", "nan"):
        fa.simulate(arm, [0, 1], drive={0: fa.Torque(lambda t: float("nan"))})


@pytest.mark.filterwarnings("ignore::flexarm.errors.SlowWarning")
def test_ctrl_c_stops_a_long_run() -> None:
    arm = paper_link()
    q0 = [0, 0.1, 0, 0]
    killer = threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT))
    killer.start()
    with pytest.raises(KeyboardInterrupt) as caught:
        fa.simulate(arm, np.linspace(0, 1e4, 100_001), q0)
    killer.join()
    kept = caught.value.result  # what was computed is not lost
    assert len(kept.t) > 1 and kept.t[-1] <= caught.value.time and np.isfinite(kept.q).all()


@pytest.mark.parametrize("how", [{}, {"integrator": "implicit", "step": 1e-3}, {"integrator": "gauss", "step": 1e-2}])
@pytest.mark.parametrize("place", ["drive", "load", "event", "progress"])
def test_ctrl_c_inside_a_callable_keeps_the_result(how: dict[str, Any], place: str) -> None:
    """Signals reach Python's code, which is where a run with callables spends its time."""
    arm = paper_link()

    def pressed(t: float, answer: Any = None) -> Any:
        if t > 0.5:
            raise KeyboardInterrupt  # as Python's own handler of the signal does
        return answer

    given: dict[str, Any] = {
        "drive": {"drive": {0: fa.Torque(lambda t: pressed(t, 1e-3))}},
        "load": {"loads": [fa.Load(0, force=lambda t: pressed(t, (0.0, 1e-3, 0.0)))]},
        "event": {"events": lambda t, q, v: pressed(t, 1.0)},
        "progress": {"progress": pressed},
    }[place]
    end = 1000.0 if place == "progress" else 1.0
    with pytest.raises(fa.errors.SimulationInterrupted) as caught:
        fa.simulate(arm, np.linspace(0, end, int(100 * end) + 1), [0, 0.05, 0, 0], **given, **how)
    kept = caught.value.result
    assert kept.t[-1] <= caught.value.time and len(kept.t) > 10 and np.isfinite(kept.q).all()
    if place != "progress":
        assert 0.3 < caught.value.time < 0.6


def test_ida_looks_around_often_however_long_its_steps_take() -> None:
    """By the clock, about every 0.1 s: a torque that takes 20 ms is asked for few times between two looks."""
    asked, looks = [], []

    def torque(t: float) -> float:
        asked.append(t)
        time.sleep(0.02)
        return 0.001

    def look(now: float) -> None:
        looks.append(now)
        if len(looks) > 5:
            raise KeyboardInterrupt

    with pytest.raises(fa.errors.SimulationInterrupted):
        fa.simulate(paper_link(), [0, 1000], drive={0: fa.Torque(torque)}, progress=look)
    assert len(asked) < 200  # as many as steps between two looks once


def test_result_saves_and_loads(tmp_path) -> None:
    r = fa.simulate(paper_link(), np.linspace(0, 0.1, 11), [0, 0.05, 0, 0])
    r.save(tmp_path / "run.npz")
    s = fa.Result.load(tmp_path / "run.npz")
    assert s.arm == r.arm and s.stats == r.stats
    for k in ("t", "q", "v", "a", "tau"):
        np.testing.assert_array_equal(getattr(s, k), getattr(r, k))
    with refuses("nothing.npz"):
        fa.Result.load(tmp_path / "nothing.npz")


def test_progress_goes_to_stderr(capsys) -> None:
    fa.simulate(paper_link(), [0, 0.1], [0, 0.05, 0, 0], progress=True)
    assert capsys.readouterr().out == ""


@pytest.mark.filterwarnings("ignore::flexarm.errors.RangeWarning")  # bends far, on purpose
def test_no_step_passes_over_a_pulse() -> None:
    """An arm at rest must not sleep through a short torque or motion."""
    hub = fa.RigidBody(inertia=(0, 0, 1e-2), end=(0.075, 0, 0))
    arm = fa.Arm([fa.Link(fa.Revolute("z"), hub, paper_link().links[0].beam)])
    pulse = fa.Torque([0, 0.5, 0.5001, 0.6, 0.6001, 1], [0, 0, 1, 1, 0, 0])
    coarse, fine = (fa.simulate(arm, np.linspace(0, 1, n), drive={0: pulse}).q[-1] for n in (3, 1001))
    assert abs(coarse[0]) > 1
    np.testing.assert_allclose(coarse, fine, rtol=1e-3, atol=1e-5)
    t = np.linspace(0, 1, 101)
    bump = fa.Motion(t, np.where(abs(t - 0.5) < 0.02, 0.05 * np.cos((t - 0.5) * np.pi / 0.04) ** 4, 0.0))
    assert max(fa.simulate(paper_link(), [0, 1], drive={0: bump}).energy()[1]) > 1e-3
    called = fa.simulate(arm, np.linspace(0, 1, 201), drive={0: fa.Torque(lambda x: float(0.5 <= x < 0.6))})
    assert abs(called.q[-1, 0] - coarse[0]) < 0.02 * abs(coarse[0])


def test_motions_that_start_and_end_at_rest() -> None:
    t = np.linspace(0, 1, 11)
    motion = fa.Motion(t, np.clip(t - 0.2, 0, 0.5), ends="rest")
    np.testing.assert_allclose([motion(0.0), motion(1.0)], [[0, 0, 0], [0.5, 0, 0]], atol=1e-9)
    few = fa.Motion([0, 0.5, 1], [0, 1, 0])  # the parabola
    np.testing.assert_allclose(few(0.25), [0.75, 2.0, -8.0], atol=1e-12)
    assert fa.Motion([0, 2], [0.4, 0.4])(1.0) == (0.4, 0.0, 0.0)


def test_a_callable_motion_must_be_consistent() -> None:
    with refuses("derivative"):
        fa.simulate(paper_link(), [0, 1], drive={0: fa.Motion(lambda t: (t, 0.0, 0.0))})
    with refuses("derivative"):
        fa.simulate(paper_link(), [0, 1], drive={0: fa.Motion(lambda t: (t**2, 2 * t, 0.0))})
    with refuses("Torque at t = 0", "[1.0, 2.0]"):
        fa.simulate(paper_link(), [0, 1], drive={0: fa.Torque(lambda t: [1.0, 2.0])})


def test_drives_errors_and_results_survive_pickling() -> None:
    arm = paper_link()
    t = np.linspace(0, 0.1, 11)
    for law in (fa.Motion.spin_up(7.6, 0.5), fa.Motion(t, t**3), fa.Torque(0.1), fa.Torque(t, t)):
        twin = pickle.loads(pickle.dumps(law))
        assert twin(0.05) == law(0.05)
    with pytest.raises(fa.SimulationError) as caught:
        fa.simulate(arm, [0, 2], drive={0: fa.Torque(lambda t: 1.0 / max(1.0 - t, 1e-300) ** 3)}, q0=[0, 0.01, 0, 0])
    twin = pickle.loads(pickle.dumps(caught.value))
    assert str(twin) == str(caught.value) and twin.time == caught.value.time
