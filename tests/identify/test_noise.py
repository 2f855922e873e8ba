"""Fits of data with outliers, and with noisy inputs: losses, and the likelihood of a filter."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from flexarm.identify.filtered import Likelihood
from flexarm.identify.identify import _task
from flexarm.identify.loss import LOSSES
from messages import refuses
from twin import DAMPING, MASS, MEASURED, MODULUS, NOISE, TRUE, T, recorded, scene, torque

ASKED = np.array([torque(x) for x in T])


# -- outliers ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", LOSSES)
def test_losses_are_those_of_scipy(name: str) -> None:
    """Of a line with outliers, SciPy's own robust fit is the oracle; slopes are differences."""
    from scipy.optimize import least_squares

    loss, rng = LOSSES[name], np.random.default_rng(0)
    x = np.linspace(0, 1, 60)
    y = 1 + 2 * x + 0.1 * rng.normal(size=60) + 3.0 * (rng.random(60) < 0.1)

    def rows(p: np.ndarray) -> np.ndarray:
        return (p[0] + p[1] * x - y) / 0.1

    theirs = least_squares(rows, [0.0, 0.0], loss=name, f_scale=loss.c, xtol=1e-12, ftol=1e-12)
    ours = least_squares(lambda p: loss.rooted(rows(p)), [0.0, 0.0], xtol=1e-12, ftol=1e-12)
    np.testing.assert_allclose(ours.x, theirs.x, rtol=1e-6)
    assert ours.cost == pytest.approx(theirs.cost, rel=1e-9)
    r = np.array([-7.0, -1.2, 1e-9, 0.4, 2.0, 30.0])
    for of, slope in ((loss.rooted, loss.slope), (lambda r: loss.rooted(r) ** 2 / 2, loss.pull)):
        np.testing.assert_allclose(slope(r), (of(r + 1e-6) - of(r - 1e-6)) / 2e-6, rtol=1e-5, atol=1e-8)
    z = rng.normal(size=400_000)
    bend, square = loss.spread(z)
    assert square / bend**2 == pytest.approx(1 / 0.95, rel=0.01)  # what normal noise costs
    assert bend == pytest.approx(np.mean((loss.pull(z + 1e-4) - loss.pull(z - 1e-4)) / 2e-4), rel=1e-3)


def spoilt(data: fa.Data) -> tuple[fa.Data, int]:
    """A tenth of the readings are wrong, more often upwards; and how many are, of each column."""
    rng, columns = np.random.default_rng(3), {k: x.copy() for k, x in data.columns.items()}
    for name in NOISE:
        at = rng.choice(len(T), len(T) // 10, replace=False)
        columns[name][at] += columns[name].std() * rng.normal(0.5, 0.5, at.size)
    return fa.Data(T, columns, data.units), len(T) // 10


@pytest.mark.parametrize("loss", LOSSES)
def test_outliers_count_less(loss: str) -> None:
    data, count = spoilt(recorded(scene()))
    guess = scene(0.15, 0.7e11, 0.15)
    linear = fa.identify(guess, data, [MASS, MODULUS, DAMPING], **MEASURED)
    fit = fa.identify(guess, data, [MASS, MODULUS, DAMPING], **MEASURED, loss=loss)
    clean = fa.identify(guess, recorded(scene()), [MASS, MODULUS, DAMPING], **MEASURED, loss=loss)
    assert clean.noise == pytest.approx(NOISE, rel=0.15) and fit.noise == pytest.approx(NOISE, rel=0.25)
    for name, x in TRUE.items():
        assert abs(fit.values[name] - x) < 3.5 * fit.std[name]
        assert fit.std[name] < 0.2 * linear.std[name] and fit.std[name] < 1.5 * clean.std[name]
    assert fit.loss == loss and f"of {len(T)} readings of angle are more than 4" in fit.report()
    found = int(fit.report().split(" of 201 readings of angle")[0].rpartition("\n")[2])
    assert abs(found - count) <= 2


def test_losses_by_other_names_are_refused() -> None:
    data = recorded(scene())
    with refuses("loss", "tukey", "huber"):
        fa.identify(scene(), data, [MASS], **MEASURED, loss="tukey")
    with refuses("loss = 'huber'", "filter"):
        fa.identify(scene(), data, [MASS], **MEASURED, loss="huber", method="filter")


# -- noisy inputs ------------------------------------------------------------------------------------------------------


def test_a_noisy_torque_by_the_filters_likelihood() -> None:
    """A run from start to end takes what the torque's noise does for noise of readings, and believes too much."""
    rng = np.random.default_rng(1)
    noisy = fa.Torque(T, ASKED + 0.02 * rng.normal(size=len(T)))
    data = recorded(replace(scene(), drive={0: noisy}), 1)
    guess = scene(0.07, 1.5e11, 0.08)
    plain = fa.identify(guess, data, list(TRUE), **MEASURED, starts=1)
    fit = fa.identify(guess, data, list(TRUE), **MEASURED, starts=1, method="filter")
    assert max(abs(plain.values[k] - x) / plain.std[k] for k, x in TRUE.items()) > 4
    assert max(abs(fit.values[k] - x) / fit.std[k] for k, x in TRUE.items()) < 3
    assert fit.noise == pytest.approx(NOISE, rel=0.3) and fit.values["noise.angle"] == fit.noise["angle"]
    of = "force_noise.link 0 revolute"  # N m/sqrt(Hz), of forces that are straight between their samples
    assert 0.3 < fit.values[of] / (0.02 * np.sqrt(T[1])) < 1.2 and fit.intervals[of][0] > 0
    assert all(w.white for run in fit.whiteness for w in run.values()) and fit.converged
    assert fit.method == "filter" and "predicted from those before" in fit.report()
    assert set(fit.to_dict()["values"]) == {*TRUE, "noise.angle", "noise.strain", of}
    again = fit.validate(recorded(replace(scene(), drive={0: noisy}), 2))
    assert again.rmse["strain"] < 2.5 * NOISE["strain"]


def test_a_torque_that_was_not_measured() -> None:
    """The filter finds how far to smooth the angle; as a motion, its noise becomes accelerations."""
    data = recorded(scene())
    free = replace(scene(0.07), drive={})
    fit = fa.identify(free, data, [MASS], outputs=MEASURED["outputs"], starts=1, method="filter")
    assert abs(fit.values[MASS] - TRUE[MASS]) < 3 * fit.std[MASS] and fit.std[MASS] < 0.01 * TRUE[MASS]
    assert fit.noise == pytest.approx(NOISE, rel=0.2) and fit.values["force_drift.link 0 revolute"] > 0.1
    given: dict[str, Any] = {"inputs": {0: (fa.Motion, "angle")}, "outputs": {"strain": "sensor.1"}}
    moved = fa.identify(scene(0.07), data, [MASS], **given, starts=1)
    assert abs(moved.values[MASS] - TRUE[MASS]) > 5 * abs(fit.values[MASS] - TRUE[MASS])


def test_likelihood_of_a_mass_on_a_rail_by_hand() -> None:
    """x' = v, v' = (F + w) / m, readings of x, a force w that is another in each step: SciPy's normal density of all
    readings together is the oracle."""
    from scipy.stats import multivariate_normal

    t, h, m, F, density, sigma = np.arange(12) * 0.1, 0.1, 2.0, 3.0, 0.5, 1e-2
    arm = fa.Arm([fa.Link(fa.Prismatic("x"), tip=fa.RigidBody(m))], gravity=(0, 0, 0))
    rng = np.random.default_rng(0)
    x = F * t**2 / (2 * m) + 0.02 * rng.normal(size=t.size)
    slide = fa.sensors.Encoder(0, pulses=None)
    rail = fa.Scene(arm, {0: fa.Torque(F)}, t=t, sensors=(slide,), options={"integrator": "implicit", "step": h})
    data = fa.Data(t, {"x": x}, {"x": "m"})
    task = _task(rail, data, {MASS: m}, None, {"x": "sensor.0"}, None, "implicit", h, 1)
    inner = np.array([y.inner(y.of.start) for y in task.residuals.sought])
    of = Likelihood(task.residuals, inner, {"x": sigma}, {})
    of.point[:] = [inner[0], np.log(sigma), np.log(density)]
    k = np.arange(t.size)
    by_w = np.where(k[:, None] > k, (k[:, None] - k - 0.5) * h**2 / m, 0.0)  # of x by the force of each step
    C = density**2 / h * by_w @ by_w.T + sigma**2 * np.eye(t.size)
    known = -multivariate_normal(F * t**2 / (2 * m), C).logpdf(x) - t.size / 2 * np.log(2 * np.pi)
    assert of(of.point) == pytest.approx(known, rel=1e-6)
    r, J = of.rows(of.point)
    slope = [(of(of.point + 1e-5 * e) - of(of.point - 1e-5 * e)) / 2e-5 for e in np.eye(3)]
    np.testing.assert_allclose(J.T @ r, slope, rtol=1e-4, atol=1e-4)


def test_what_the_filter_cannot_take_is_refused() -> None:
    data = recorded(scene())
    with refuses("outputs['angle']", "sensor", "filter"):
        fa.identify(scene(), data, [MASS], outputs={"angle": "q link 0 revolute"}, method="filter")
    with refuses("method", "kalman", "filter"):
        fa.identify(scene(), data, [MASS], **MEASURED, method="kalman")
