"""Friction at zero speed: the sign function chatters, the smoothed one creeps, sticking holds exactly still."""

from __future__ import annotations

import numpy as np
import pytest
from stability import friction

REST = 0.5 / (friction.COULOMB - friction.PUSH)  # s, when the block has come to rest
OPTIONS = ({}, {"integrator": "implicit", "step": 1e-2}, {"integrator": "gauss", "step": 0.1})


@pytest.mark.parametrize("h", [1e-2, 1e-3])
def test_sign_function_chatters_with_the_step(h: float) -> None:
    """The force jumps within every step: speeds of order h F/m for ever, and a creep of that order, at any step."""
    t = np.arange(round(2 / h) + 1) * h
    v = friction.rk4(friction.sign, t)[t > REST + 0.1, 1]
    assert 0.5 * h < np.ptp(v) < 4 * h and 0.1 * h < abs(v.mean()) < 4 * h


def test_sign_function_costs_an_adaptive_method_its_steps() -> None:
    """Quick while the block slides; at rest each evaluation gains nothing."""
    sliding = friction.adaptive(friction.sign, 0.99 * REST)
    assert sliding["reached"] == 0.99 * REST and sliding["evaluations"] < 100
    resting = friction.adaptive(friction.sign, 2 * REST)
    assert resting["evaluations"] >= 20_000 and resting["reached"] < 1.2 * REST


def test_smoothed_friction_creeps() -> None:
    """It holds PUSH only at the speed where the law gives as much: atanh(PUSH / COULOMB) of its width."""
    speed = friction.adaptive(friction.smooth, REST + 0.5)["speed"]
    assert speed == pytest.approx(1e-3 * np.arctanh(friction.PUSH / friction.COULOMB), rel=1e-3)


@pytest.mark.parametrize("options", OPTIONS, ids=lambda o: o.get("integrator", "ida"))
def test_sticking_is_exactly_still(options: dict) -> None:
    t = np.linspace(0, 2, 41)
    r = friction.chosen(t, **options)
    still = t > REST + 1e-6
    assert np.all(r.v[still] == 0.0) and np.ptp(r.q[still]) == 0.0
    assert r.q[-1, 0] == pytest.approx(0.5 * 0.5 * REST, rel=1e-6)
    np.testing.assert_allclose(r.friction[still, 0], -friction.PUSH, rtol=1e-12)
    assert r.stats["switches"] == 1
