"""Command shaping: its impulses, and what it leaves of the vibration of the paper's arm."""

from __future__ import annotations

import pickle

import flexarm as fa
import numpy as np
import pytest
from arms import close, paper_link
from hypothesis import given, settings
from hypothesis import strategies as st
from messages import refuses

KINDS = ("zv", "zvd", "zvdd")
QUINTIC = fa.Motion([0, 0.25, 1.65], [0, 0.1, 0.1], [0, 0, 0], [0, 0, 0])  # 0.1 rad in 0.25 s, then rest


# -- impulses ------------------------------------------------------------------------------------------------------


def test_the_impulses_of_singer_and_seering() -> None:
    zeta, w = 0.1, 10.0
    K = np.exp(-zeta * np.pi / np.sqrt(1 - zeta**2))
    half = np.pi / (w * np.sqrt(1 - zeta**2))
    close(np.array(fa.input_shaper("zv", w, zeta).impulses), np.array([[0, 1], [half, K]]) / [1, 1 + K], 1e-14)
    zvd = [[0, 1], [half, 2 * K], [2 * half, K * K]] / np.array([1, 1 + 2 * K + K * K])
    close(np.array(fa.input_shaper("zvd", w, zeta).impulses), zvd, 1e-14)


@settings(max_examples=50, deadline=None)
@given(st.sampled_from(KINDS), st.floats(0.1, 1e3), st.floats(0, 0.9))
def test_impulses_sum_to_one_and_cancel_at_the_design_point(kind: str, w: float, zeta: float) -> None:
    shaper = fa.input_shaper(kind, w, zeta)
    assert sum(shaper.amplitudes) == pytest.approx(1, abs=1e-14) and min(shaper.amplitudes) > 0
    assert shaper.residual(w, zeta) < 1e-12
    half = np.pi / (w * np.sqrt(1 - zeta**2))
    assert shaper.duration == pytest.approx((KINDS.index(kind) + 1) * half)


@settings(max_examples=50, deadline=None)
@given(st.floats(1, 100), st.floats(1, 100), st.floats(0, 0.5), st.sampled_from(KINDS), st.sampled_from(KINDS))
def test_a_product_cancels_both_modes(w: float, other: float, zeta: float, kind: str, with_kind: str) -> None:
    both = fa.input_shaper(kind, w, zeta) * fa.input_shaper(with_kind, other)
    assert sum(both.amplitudes) == pytest.approx(1, abs=1e-13)
    assert both.residual(w, zeta) < 1e-12 and both.residual(other) < 1e-12


def test_zvd_is_zv_twice() -> None:
    zv, zvd = fa.input_shaper("zv", 20.0, 0.02), fa.input_shaper("zvd", 20.0, 0.02)
    close(np.array((zv * zv).impulses), np.array(zvd.impulses), 1e-14)


def test_what_is_left_off_the_design_point() -> None:
    """Without damping |cos(pi w / 2 w0)| of ZV, its square of ZVD."""
    off = np.linspace(0.7, 1.3, 13)
    expected = np.abs(np.cos(np.pi / 2 * off))
    for power, kind in enumerate(KINDS, 1):
        close(fa.input_shaper(kind, 20.0).residual(20.0 * off), expected**power, 1e-13)
    assert fa.input_shaper("zv", 20.0).residual([18.0, 22.0]) == pytest.approx([0.1564, 0.1564], abs=1e-4)
    assert fa.input_shaper("zvd", 20.0).residual([18.0, 22.0]) == pytest.approx([0.0245, 0.0245], abs=1e-4)


# -- shaped commands -----------------------------------------------------------------------------------------------


def test_a_shaped_step_is_a_staircase() -> None:
    t = np.arange(9.0)
    shaped = fa.Shaper((0, 2, 5), (0.5, 0.3, 0.2))(t, np.ones(9), before=0.0)
    np.testing.assert_allclose(shaped, [0.5, 0.5, 0.8, 0.8, 0.8, 1, 1, 1, 1], atol=1e-15)
    columns = fa.Shaper((0, 2), (0.5, 0.5))(t, np.stack([t, 3 + 0 * t], axis=1))
    np.testing.assert_allclose(columns[:4], [[0, 3], [0.5, 3], [1, 3], [2, 3]], atol=1e-15)


def test_a_shaped_motion_is_the_sum_of_its_delayed_copies() -> None:
    t = np.linspace(0, 1, 8)
    rest = fa.Motion(t, np.array([0, 0.1, 0.4, 0.9, 1.2, 1.0, 0.8, 0.75]), ends="rest")
    shaper = fa.input_shaper("zvd", 25.0, 0.05) * fa.input_shaper("zv", 110.0)
    shaped = shaper.shape(rest)
    assert isinstance(shaped, fa.Motion) and pickle.loads(pickle.dumps(shaped))(0.3) == shaped(0.3)
    for now in np.linspace(0, 1 + shaper.duration, 173):
        copies = [np.array(rest(min(max(now - delay, 0.0), 1.0))) for delay, _ in shaper.impulses]
        expected = sum(share * copy for (_, share), copy in zip(shaper.impulses, copies, strict=True))
        assert (np.abs(np.array(shaped(now)) - expected) < [1e-12, 1e-9, 1e-6]).all()
    assert shaped.law.breaks[-1] == pytest.approx(1 + shaper.duration)


def test_a_shaped_motion_stays_smooth() -> None:
    shaper = fa.input_shaper("zv", 20.95)
    shaped = shaper.shape(QUINTIC)
    for t in [*shaper.times, *(0.25 + np.array(shaper.times))]:
        np.testing.assert_allclose(shaped(t - 1e-9), shaped(t + 1e-9), rtol=0, atol=1e-5)


def test_motions_that_do_not_end_at_rest() -> None:
    spin = fa.input_shaper("zv", 20.0).shape(fa.Motion.spin_up(2.0, 0.5))
    assert spin(3.0)[0] == pytest.approx(2.0 * (3.0 - 0.25 - np.pi / 40)) and spin(3.0)[1] == pytest.approx(2.0)
    assert spin(0.0) == (0, 0, 0) and spin(0.1)[0] == pytest.approx(0.5 * fa.Motion.spin_up(2.0, 0.5)(0.1)[0])
    half = fa.Motion([0, 0.25], [0, 0.4], [0, 1.0], [0, 0])
    assert fa.input_shaper("zv", 20.0).shape(half).law.breaks[-1] == 0.25
    with refuses("t = 0.0", "v = 1", "motion", "start", "rest"):
        fa.input_shaper("zv", 20.0).shape(fa.Motion([0, 1], [0, 1], [1, 1], [0, 0]))


def test_shaped_torques() -> None:
    shaper = fa.Shaper((0, 0.1, 0.25), (0.5, 0.3, 0.2))
    constant = shaper.shape(fa.Torque(2.0), start=1.0)
    assert [constant(t) for t in (0, 0.99, 1.05, 1.2, 1.3, 9)] == pytest.approx([0, 0, 1, 1.6, 2, 2])
    ramp = shaper.shape(fa.Torque([0, 0.2, 0.4], [1, 3, 0]), before=1.0)
    called = shaper.shape(fa.Torque(lambda t: float(np.interp(t, [0, 0.2, 0.4], [1, 3, 0]))), before=1.0)
    for t in np.linspace(0.001, 0.649, 50):
        copies = [np.interp(t - delay, [0, 0.2, 0.4], [1, 3, 0]) for delay in shaper.times]
        assert ramp(t) == pytest.approx(np.dot(shaper.amplitudes, copies), abs=1e-12)
        assert called(t) == pytest.approx(ramp(t), abs=1e-12)
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, inertia=(1, 1, 0.5)))])
    run = fa.simulate(arm, np.linspace(0, 2, 201), drive={0: constant})
    speed = 2.0 / 0.5 * (0.5 * 1.0 + 0.3 * 0.9 + 0.2 * 0.75)  # the steps' integral over the moment of inertia
    assert run.v[-1, 0] == pytest.approx(speed, rel=1e-6)


# -- the paper's arm -----------------------------------------------------------------------------------------------


def ringing(motion: fa.Motion, youngs_modulus: float = 209e9) -> float:
    """Largest deflection of the tip (m) in the second after 0.65 s; ZVD's motion has ended by then, too."""
    beam = fa.Beam(0.5, fa.Rectangle(0.001, 0.02), fa.Material(7850, youngs_modulus, 0.3), {"bending_y": 3})
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(end=(0.075, 0, 0)), beam)])
    run = fa.simulate(arm, np.linspace(0, 1.65, 1651), drive={0: motion}, integrator="gauss", step=0.005)
    return float(np.abs(run.tip_deflection()[run.t >= 0.65, 1]).max())


def test_shaping_stills_the_papers_arm() -> None:
    w = paper_link().modes(lock=[0]).frequencies[0]
    unshaped = ringing(QUINTIC)
    assert unshaped > 0.01
    for kind in ("zv", "zvd"):
        assert ringing(fa.input_shaper(kind, w).shape(QUINTIC)) < 0.005 * unshaped


@pytest.mark.parametrize("error", [-0.1, 0.1])
def test_zvd_forgives_a_wrong_frequency_that_zv_does_not(error: float) -> None:
    w = paper_link().modes(lock=[0]).frequencies[0]
    E = 209e9 * (1 + error) ** 2  # the arm's frequencies are off, the shapers are not
    unshaped = ringing(QUINTIC, E)
    zv, zvd = (ringing(fa.input_shaper(kind, w).shape(QUINTIC), E) / unshaped for kind in ("zv", "zvd"))
    assert 0.14 < zv < 0.17 and 0.015 < zvd < 0.035  # in theory 0.156 and 0.024 of the first mode
    for found, kind in ((zv, "zv"), (zvd, "zvd")):
        assert found == pytest.approx(fa.input_shaper(kind, w).residual(w * (1 + error)), abs=0.003)


# -- bad input -----------------------------------------------------------------------------------------------------

BAD = [
    (lambda: fa.input_shaper("zvv", 20.0), "kind = 'zvv'"),
    (lambda: fa.input_shaper("zv", 0.0), "frequency = 0.0"),
    (lambda: fa.input_shaper("zv", [20.0, 30.0]), "frequency = [20.0, 30.0]"),
    (lambda: fa.input_shaper("zv", 20.0, 1.0), "damping_ratio = 1.0"),
    (lambda: fa.Shaper((0, 1), (0.5, 0.6)), ("amplitudes = (0.5, 0.6)", "1.1")),
    (lambda: fa.Shaper((0.1, 1), (0.5, 0.5)), "times = (0.1, 1)"),
    (lambda: fa.Shaper((0, 1), (1.0,)), ("amplitudes has shape (1,)", "2", "numbers")),
    (lambda: fa.input_shaper("zv", 20.0).residual(-1.0), "frequency = -1.0"),
    (lambda: fa.input_shaper("zv", 20.0).shape(3.0), ("command = 3.0", "Motion", "Torque")),
    (lambda: fa.input_shaper("zv", 20.0).shape(QUINTIC, before=1.0), ("before = 1.0", "Torque")),
    (
        lambda: fa.input_shaper("zv", 20.0)([0, 1], [0, 1, 2]),
        ("y has shape (3,)", "2"),
    ),
    (lambda: fa.input_shaper("zv", 20.0)([0, 0], [0, 1]), "t[1] = 0.0"),
]


@pytest.mark.parametrize(("make", "message"), BAD)
def test_bad_input(make, message: str) -> None:
    with refuses(message):
        make()
