"""Servos in linear loops: against runs, python-control and a root that is written by hand; maps and tuned gains."""

from __future__ import annotations

from typing import Any

import control as ct
import flexarm as fa
import numpy as np
import pytest
from matplotlib.figure import Figure
from messages import refuses
from scipy.linalg import expm

STEEL = fa.Material(7850, 209e9, 0.3)
BEAM = fa.Beam(0.5, fa.Rectangle(0.003, 0.03), STEEL, {"bending_y": 2}, "legendre", damping_ratio=0.01)
BENT = fa.Arm([fa.Link(fa.Revolute("z", reflected_inertia=0.05, damping=0.1), beam=BEAM, tip=fa.RigidBody(0.2))])
J, B, H = 0.4, 0.3, 2e-3
RIGID = fa.Arm([fa.Link(fa.Revolute("z", damping=B), fa.RigidBody(inertia=(1, 1, J)))])


def drive(**more: Any) -> fa.Servo:
    made: dict[str, Any] = {"kp": 20, "kv": 2, "ki": 5, "rate": 1 / H, "filter": 100, "delay": 1.3e-3}
    return fa.Servo(0, **{**made, **more})


@pytest.mark.parametrize("lag", [None, 100.0])
@pytest.mark.parametrize("sensor", [None, fa.sensors.Encoder(0, pulses=None, filter=200.0)])
def test_a_run_from_a_small_displacement_is_a_sum_of_the_modes_of_its_poles(lag: Any, sensor: Any) -> None:
    law = drive(current_loop=lag, sensor=sensor)
    s = fa.closed_loop(BENT, law).poles
    s = s[np.isfinite(s)]
    parts, n = 8, 60
    t = H / parts * np.arange(parts * n + 1)
    up, down = (fa.simulate(BENT, t, None, k * 1e-5 * np.ones(BENT.nv), control=law, integrator="gauss",
                            step=H / parts).v for k in (1, -1))  # fmt: skip
    y, modes = (up - down)[::parts][20:], np.exp(np.outer(t[::parts], s))[20:]
    rest = y - modes @ np.linalg.lstsq(modes, y, rcond=None)[0]
    assert np.abs(rest).max() < 1e-6 * np.abs(y).max()


def by_hand(kp: float, kv: float, ki: float) -> Any:
    """The loop gain of RIGID in z, by python-control: the plant behind a delay, and the drive."""
    z, late = ct.TransferFunction([1, 0], [1], H), 1.3e-3
    flow = np.array([[0, 1, 0], [0, -B / J, 1 / J], [0, 0, 0]])
    first, second = expm(flow * late), expm(flow * (H - late))  # under the force before, and the new one
    A = np.vstack([second[:2, :2] @ first[:2], np.zeros(3)])
    plant = ct.ss2tf(ct.StateSpace(A, np.append(second[:2, 2], 1.0)[:, None], [[1.0, 0, 0]], 0, H))
    f = np.exp(-2 * np.pi * 100 * H)
    return plant * (kp + (ki * H * z / (z - 1) if ki else 0) + kv * (z - 1) / (H * z) * (1 - f) * z / (z - f))


@pytest.mark.parametrize(("kp", "kv", "ki"), [(20.0, 6.0, 0.0), (90.0, 9.0, 300.0)])
def test_margins_are_those_of_python_control(kp: float, kv: float, ki: float) -> None:
    open_loop = by_hand(kp, kv, ki)
    loop = fa.closed_loop(RIGID, drive(kp=kp, kv=kv, ki=ki))
    (m,) = loop.margins
    w = np.geomspace(1.0, 0.999 * np.pi / H, 4000)
    L = open_loop(np.exp(1j * w * H))
    assert abs(loop.loop_gain(w)[:, 0, 0] / L - 1).max() < 1e-7
    at_one, at_gain = (complex(open_loop(np.exp(1j * x * H))) for x in (m.phase_frequency, m.gain_frequency[1]))
    assert at_one == pytest.approx(-np.exp(1j * m.phase), rel=1e-7)
    assert at_gain == pytest.approx(-1 / m.gain[1], rel=1e-7)
    crossings = np.flatnonzero((abs(L[1:]) > 1) != (abs(L[:-1]) > 1))
    assert len(crossings) == 1
    poles = np.roots(np.polyadd(open_loop.num[0][0], open_loop.den[0][0]))
    assert abs(poles).max() == pytest.approx(np.exp(loop.growth * H), rel=1e-6)


def test_a_current_loop_is_no_loop_of_its_own() -> None:
    loop = fa.closed_loop(BENT, [drive(current_loop=100.0), fa.PD(0.0, 0.01)])
    assert [c.kind for c in loop.channels] == ["PD", "Servo"]
    slow, fast = (fa.closed_loop(BENT, drive(current_loop=x)).margins[0].phase for x in (100.0, None))
    late = fa.closed_loop(BENT, drive()).margins[0].phase_frequency
    assert fast - slow == pytest.approx(late / (2 * np.pi * 100), rel=0.02)  # rad, of a lag of 1.6 ms


def test_the_map_is_the_poles_of_each_pair(tmp_path: Any) -> None:
    loop = fa.closed_loop(BENT, drive(current_loop=100.0))
    kp, kv = np.geomspace(0.1, 1000, 9), np.geomspace(0.02, 50, 8)
    found = loop.stability_map(kp, kv)
    assert found.over == ("control.0.kp", "control.0.kv")
    assert found.now == (20.0, 2.0)
    for i, j in ((0, 0), (4, 3), (8, 2), (6, 7), (3, 6)):
        one = fa.closed_loop(BENT, drive(current_loop=100.0, kp=kp[i], kv=kv[j]))
        assert found.growth[j, i] == pytest.approx(one.growth, rel=1e-6, abs=1e-6)
        assert found.stable[j, i] == one.stable
    assert 0.1 < found.stable.mean() < 0.9
    limit = loop.limits("control.0.kv").high
    row = loop.stability_map([19.0, 20.0], limit * np.array([0.99, 1.01]))
    assert row.stable[:, 1].tolist() == [True, False]
    # of two numbers in which the loop is not bilinear, one pair at a time
    rates = loop.stability_map([200.0, 400.0, 800.0], kv[:3], ("control.0.rate", "control.0.kv"))
    slow = fa.closed_loop(BENT, drive(current_loop=100.0, rate=200.0, kv=kv[2]))
    assert rates.growth[2, 0] == pytest.approx(slow.growth, rel=1e-9)
    assert isinstance(found.plot(), Figure)
    found.plot().savefig(tmp_path / "map.png")
    assert "%" in repr(found)


@pytest.mark.parametrize("law", [drive(), drive(ki=0, current_loop=200.0), fa.PD(1.0, 1.0), fa.PD(-3.0, 0.0)], ids=repr)
def test_tuned_gains_have_the_bandwidth_and_the_margins(law: Any) -> None:
    tuned = fa.closed_loop(BENT, law).tune(12.0, phase_margin=np.radians(50), gain_margin=3.0)
    loop = fa.closed_loop(BENT, tuned.control)
    (m,) = loop.margins
    assert abs(loop.loop_gain([12.0])[0, 0, 0]) == pytest.approx(1.0)
    assert (abs(loop.loop_gain(np.geomspace(0.01, 11.9, 500))[:, 0, 0]) > 1).all()
    assert m.phase >= np.radians(50) - 1e-6
    assert m.gain[0] <= 1 / 3 and m.gain[1] >= 3
    assert (tuned.margins.gain, tuned.margins.phase, tuned.margins.delay) == (m.gain, m.phase, m.delay)
    assert tuned.gains == {name: getattr(tuned.control[0], name) for name in tuned.gains}
    assert ("ki" in tuned.gains) == isinstance(law, fa.Servo)
    assert "50" in str(tuned) and "12" in str(tuned)


def test_a_rigid_joint_has_the_gains_of_the_closed_form() -> None:
    """Of PD on J s² + B s: kp + i w kv = (J w² - i B w) exp(i phase) ... with the phase margin."""
    w, phase = 30.0, np.radians(65)
    needed = -np.exp(1j * phase) * (-J * w**2 + 1j * B * w)
    tuned = fa.closed_loop(RIGID, fa.PD(1.0, 1.0)).tune(w, phase_margin=phase)
    assert tuned.gains["kp"] == pytest.approx(needed.real)
    assert tuned.gains["kv"] == pytest.approx(needed.imag / w)


def test_the_integral_is_a_tenth_of_the_bandwidth_or_as_told() -> None:
    loop = fa.closed_loop(BENT, drive())
    for told, part in ((None, 1.2), (0.0, 0.0), (2.5, 2.5)):
        gains = loop.tune(12.0, integral=told).gains
        assert gains["ki"] == pytest.approx(part * gains["kp"])


def test_one_joint_is_tuned_while_the_other_stays_closed() -> None:
    two = fa.Arm([fa.Link(fa.Revolute("z", reflected_inertia=0.1), BENT.links[0].hub, BEAM)] * 2)
    laws = [fa.Servo(k, kp=30, kv=4, rate=1000) for k in (0, 1)]
    tuned = fa.closed_loop(two, laws).tune(10.0, control=1)
    assert tuned.control[0].kp == 30
    assert fa.closed_loop(two, tuned.control).margins[1].phase == tuned.margins.phase


def test_what_cannot_be_reached_says_what_can() -> None:
    loop = fa.closed_loop(BENT, drive())
    with refuses("bandwidth = 400 rad/s", "within reach") as e:
        loop.tune(400.0)
    near = float(str(e.value).split("; ")[-1].split()[0])
    assert loop.tune(near).bandwidth == near
    with refuses("phase_margin = 60", "rad"):
        loop.tune(10.0, phase_margin=60)
    with refuses("gain_margin = 1"):
        loop.tune(10.0, gain_margin=1)
    with refuses("bandwidth = 2000", "1570"):
        loop.tune(2000.0)
    with refuses("control = 1", "0"):
        loop.tune(10.0, control=1)
    with refuses("control = None", "none"):
        fa.closed_loop(BENT, fa.StateFeedback(np.zeros((1, 2 * BENT.nv)))).tune(10.0)
    with refuses("y = None", "control.0.kv"):
        fa.closed_loop(BENT, fa.PD(1.0, 0.0)).stability_map([1, 2])
    with refuses("x", "increase"):
        loop.stability_map([2, 1])


def test_references_need_not_last() -> None:
    short = fa.Motion([0, 0.3], [0, 0.4], [0, 0], [0, 0])
    loop = fa.closed_loop(BENT, drive(reference=short, feedforward="motion"))
    assert loop.growth == fa.closed_loop(BENT, drive()).growth
