"""Integrators where theory says that they fail, and the way round that this program takes."""

import numpy as np
import pytest
from stability import integrators

# By order: growth and h omega of the test below, computed independently. Hairer & Wanner, Solving ODEs II, V.1 draw the
# regions of stability.
BDF = {1: (1.0, 0.0), 2: (1.0, 0.0), 3: (1.046, 1.936), 4: (1.191, 4.714), 5: (1.379, 9.392)}


@pytest.mark.parametrize("order", BDF)
def test_growth_of_bdf_on_an_undamped_oscillation(order: int) -> None:
    """Largest growth per step, and the h omega below which it is unstable, by its companion matrix."""
    growth, end = integrators.bdf_limits(order)
    assert growth == pytest.approx(BDF[order][0], abs=6e-4)
    assert end == pytest.approx(BDF[order][1], abs=1.1e-3)


def test_ida_above_order_two_excites_a_quiet_mode() -> None:
    """Order 3 raises modes 4 to 6 of an undamped beam a hundredfold and takes several times the steps; 2 does not.
    Order 5 keeps them small, at the price of steps: IDA cuts h omega down to where it is stable."""
    two, three, five = (integrators.quiet_mode(k, 1.0) for k in (2, 3, 5))
    assert two["fast"].max() < 3e-8
    assert three["fast"].max() > 30 * two["fast"].max() and three["steps"] > 4 * two["steps"]
    assert five["steps"] > 2 * two["steps"]
    assert abs(two["drift"]) < 2e-3


def test_stiff_shear_costs_no_steps() -> None:
    """With shear at 1e7 rad/s the paper's spin-up takes IDA no more steps than without, and its tip moves by no more
    than shear moves it (2.2e-6 m); an explicit method would need millions of steps to stay stable."""
    plain, stiff = integrators.stiff_shear(0), integrators.stiff_shear(6)
    assert plain["fastest"] == pytest.approx(367.593, rel=1e-4) and 0.9e7 < stiff["fastest"] < 1.1e7
    assert stiff["steps"] < 1.2 * plain["steps"] < stiff["rk4"] / 100
    assert 1e-6 < np.abs(stiff["tip"] - plain["tip"]).max() < 5e-6


def test_a_torque_that_runs_away_is_reported() -> None:
    """1/(1 - t)^3 drives an angle as 1/(2 (1 - t)): the time reached is 1 s, and what is kept is right."""
    found = integrators.collapse()
    assert "the step size fell below 1e-12" in found["message"]
    assert found["time"] == pytest.approx(1.0, abs=1e-6)
    t, q = found["t"], found["q"][:, 0]
    assert t[-1] == pytest.approx(0.999)
    np.testing.assert_allclose(q, 0.5 / (1 - t) - 0.5 - 0.5 * t, rtol=1e-4, atol=1e-6)


def beyond_reach(speed: float) -> float:
    """When order 1, from 1e-6 m at rest, has bent the paper's link by ten times its length, 5 m."""
    return np.arccosh(5.0 / 1e-6) / np.sqrt(speed**2 - 20.948766**2)


def test_a_divergence_is_reported_with_its_cause() -> None:
    """Order 1 at 100 rad/s grows from 1e-6 as cosh(97.8 t): seen at the output time (0.01 s) after ten lengths."""
    found = integrators.overflow()
    assert beyond_reach(100.0) < found["time"] < beyond_reach(100.0) + 0.011
    assert "link 0: at order 1" in found["message"] and "the motion ran away" in found["message"]
    assert np.abs(found["q"][:, 1]).max() < 5.0


@pytest.mark.parametrize(("speed", "modes"), [(30.0, 3), (100.0, 3), (1000.0, 2)])
def test_ida_reports_a_divergence_of_several_modes_at_once(speed: float, modes: int) -> None:
    """The growing mode's rounding errors are felt by the other modes, and IDA's steps shrink in proportion to its
    growth: what would take hours is given up beyond ten lengths."""
    found = integrators.overflow(speed, modes)
    assert "the motion ran away" in found["message"] and "link 0: at order 1" in found["message"]
    assert beyond_reach(speed) < found["time"] < beyond_reach(speed) + 0.011
    assert found["steps"] < 1000


@pytest.mark.parametrize("integrator", ["implicit", "gauss", "rk4"])
def test_fixed_steps_report_a_divergence_of_several_modes_at_once(integrator: str) -> None:
    """Three modes, of which one grows."""
    found = integrators.overflow(modes=3, integrator=integrator, step=1e-3)
    assert found["time"] == pytest.approx(beyond_reach(100.0), abs=2e-3)
    assert "the motion ran away in steps of 0.001 s" in found["message"] and "link 0: at order 1" in found["message"]
    assert "smaller step" not in found["message"]  # that is not the cause
    assert found["steps"] < 1000
