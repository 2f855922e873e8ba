"""Fixed steps: the explicit limit, steps far above it, and energy over very many steps."""

import flexarm as fa
import numpy as np
import pytest
from messages import refuses
from stability import integrators, steps


@pytest.mark.parametrize(("shear", "rel"), [(0, 1e-10), (1, 1e-7), (6, 1e-5)])
def test_rk4_under_and_over_its_limit(shear: int, rel: float) -> None:
    """The fastest mode of the paper's link shrinks at 0.99 of the limit and grows at 1.01, each by the factor of
    theory; six shear coordinates make the limit 28 000 times smaller."""
    assert steps.rk4_growth(steps.LIMIT) == pytest.approx(1.0, abs=1e-12)
    for part, sign in ((0.99, -1), (1.01, 1)):
        found = steps.growth(steps.fastest_mode(shear, part * steps.LIMIT, 40, integrator="rk4"))
        assert sign * (found - 1) > 0.05
        assert found == pytest.approx(float(steps.rk4_growth(part * steps.LIMIT)), rel=rel)
    fastest = steps.clamped_link(shear).modes().frequencies.max()
    assert fastest == pytest.approx({0: 367.593, 1: 1.760e5, 6: 1.011e7}[shear], rel=1e-3)


@pytest.mark.parametrize("shear", [0, 1, 6])
@pytest.mark.parametrize("times", [100, 300, 1000])
def test_implicit_steps_hundreds_of_times_larger(shear: int, times: int) -> None:
    """At radius 1 and by Gauss collocation the fastest mode keeps its amplitude; at 0.9 it goes as the formula."""
    phase = times * steps.LIMIT
    for options in ({"integrator": "implicit"}, {"integrator": "gauss"}):
        np.testing.assert_allclose(steps.fastest_mode(shear, phase, 100, **options), 1.0, atol=1e-4)
    found = steps.fastest_mode(shear, phase, 100, integrator="implicit", spectral_radius=0.9)
    np.testing.assert_allclose(found, steps.alpha_path(0.9, phase, 100), rtol=1e-2)
    assert steps.alpha_growth(0.9, phase) == pytest.approx(0.9, abs=0.02)


def test_a_loud_fast_mode_is_refused_not_followed_wrongly() -> None:
    """What quiet fast modes allow, loud ones do not: bending that a mode of 1e7 rad/s brings is not small against what
    a step of 1 ms can solve. The error says so."""
    fastest = steps.clamped_link(6).modes().frequencies.max()
    assert steps.fastest_mode(6, 1e-3 * fastest, 5, integrator="implicit") == pytest.approx(1.0, abs=1e-4)
    with refuses("smaller step", error=fa.SimulationError):
        steps.fastest_mode(6, 1e-3 * fastest, 5, size=1e-7, integrator="implicit")


def test_large_steps_are_right_about_what_moves() -> None:
    """The paper's spin-up with six shear coordinates, 1e7 rad/s: steps of 1 and 25 ms follow the tip to within what
    shear itself moves it (2.5e-6 m) and their own error; rk4 above the limit of the unsheared link runs away."""
    truth, _ = steps.spin_up(0, rtol=1e-9, atol=1e-11)
    for options, limit, taken in (
        ({"integrator": "implicit", "step": 1e-3}, 2e-5, 1000),
        ({"integrator": "gauss", "step": 0.025}, 3e-6, 40),
    ):
        tip, count = steps.spin_up(6, **options)
        assert np.abs(tip - truth).max() < limit and count == taken
    bound = integrators.RK4_LIMIT / 367.593
    assert np.abs(steps.spin_up(0, integrator="rk4", step=0.8 * bound)[0] - truth).max() < 1e-3
    for shear in (0, 6):
        with refuses("ran away", error=fa.SimulationError):
            steps.spin_up(shear, samples=11, integrator="rk4", step=1.5 * bound)


def test_energy_of_an_oscillator_over_many_periods() -> None:
    """1e5 periods: radius 1 keeps the energy to rounding, Gauss to its iteration's tolerance; below 1 it goes at the
    rate of the formula, and so does rk4's."""
    long, short = np.array([1, 100, 10_000, 100_000]), np.array([100, 400])
    assert np.abs(steps.oscillator(long, 16, integrator="implicit")).max() < 1e-11
    assert np.abs(steps.oscillator(long, 4, integrator="gauss")).max() < 2e-9
    phase = 2 * np.pi / 16
    for options, theory in (
        ({"integrator": "implicit", "spectral_radius": 0.9}, steps.alpha_growth(0.9, phase)),
        ({"integrator": "rk4"}, float(steps.rk4_growth(phase))),
    ):
        first, last = 1 + steps.oscillator(short, 16, **options)
        assert np.log(last / first) == pytest.approx(2 * 16 * 300 * np.log(theory), rel=0.03)


def test_energy_of_a_pendulum_over_many_periods() -> None:
    """10 000 swings of 1 rad, not linear: the swing of the energy is the same at the end as at the beginning. At
    radius 0.9, and by rk4, it goes."""
    n = 10_000
    cycles = np.concatenate([np.arange(1, 201), np.arange(n - 199, n + 1)])
    for options, per_period in (({"integrator": "implicit"}, 16), ({"integrator": "gauss"}, 4)):
        error = steps.oscillator(cycles, per_period, swinging=True, **options)
        first, last = np.abs(error[:200]).max(), np.abs(error[200:]).max()
        assert 1e-7 < first < 0.02 and 0.9 < last / first < 1.1
        assert abs(np.mean(error[200:]) - np.mean(error[:200])) < 0.005 * first
    for options in ({"integrator": "implicit", "spectral_radius": 0.9}, {"integrator": "rk4"}):
        assert steps.oscillator(np.array([n]), 16, swinging=True, **options)[0] < -0.3


def test_energy_of_a_free_flexible_arm() -> None:
    """2e4 steps of 1 ms: at radius 1 and by Gauss of the same order it swings and has no slope. At radius 0.9, by rk4,
    and by IDA over half the time, it has."""
    for options in ({"integrator": "implicit"}, {"integrator": "gauss", "stages": 1}):
        found = steps.free_arm(20_000, 1e-3, **options)
        assert found["steps"] == 20_000
        assert 1e-6 < found["swing"] < 1e-3 and abs(found["slope"]) < 0.05 * found["swing"]
    for options, count, ratio in (
        ({"integrator": "implicit", "spectral_radius": 0.9}, 20_000, 5.0),
        ({"integrator": "rk4"}, 20_000, 0.5),
        ({"integrator": "ida"}, 10_000, 2.0),
    ):
        found = steps.free_arm(count, 1e-3, **options)
        assert found["slope"] < -ratio * found["swing"]
