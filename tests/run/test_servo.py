"""fa.Servo against a drive that is written by hand, in every way to run, and as it is saved."""

from __future__ import annotations

import math
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from scipy.linalg import expm

J, B = 0.4, 0.3  # kg m², N m s/rad
RATE = 500.0
T = np.linspace(0, 0.6, 301)
RIGID = fa.Arm([fa.Link(fa.Revolute("z", damping=B), fa.RigidBody(inertia=(1, 1, J)))])
DRIVE: dict[str, Any] = {
    "kp": 90.0, "kv": 9.0, "ki": 300.0, "rate": RATE, "sensor": fa.sensors.Encoder(pulses=2500, quadrature=True),
    "filter": 60.0, "delay": 1.3e-3, "limit": 12.0, "current_loop": 150.0,
}  # fmt: skip


def led(t: float) -> tuple[float, float]:
    """A turn and its rate: the quintic of MOVE."""
    s = min(t / 0.3, 1.0)
    return 0.4 * s**3 * (10 - 15 * s + 6 * s**2), 0.4 / 0.3 * 30 * s**2 * (1 - s) ** 2


MOVE = fa.Motion([0, 0.3, 0.6], [0, 0.4, 0.4], [0, 0, 0], [0, 0, 0])


def by_hand(q0: float, push: float) -> np.ndarray:
    """Angles at T, and how many samples were at the limit: exact between samples, one number at a time."""
    h, n = 1 / RATE, len(T) - 1
    w = 2 * math.pi * DRIVE["current_loop"]
    # angle, rate, torque of the current loop, command, constant push
    flow = np.zeros((5, 5))
    flow[0, 1], flow[1, [1, 2, 4]], flow[2, [2, 3]] = 1.0, [-B / J, 1 / J, 1 / J], [-w, w]
    early, late = expm(flow * DRIVE["delay"]), expm(flow * (h - DRIVE["delay"]))
    step = 2 * math.pi / 10000
    fresh = 1 - math.exp(-2 * math.pi * DRIVE["filter"] * h)
    back = h / math.sqrt(DRIVE["kv"] / DRIVE["ki"])
    x, y_before, v, integral, cut = np.array([q0, 0, 0, 0, push]), math.nan, 0.0, 0.0, 0
    out = [q0]
    for k in range(n):
        y = math.floor(x[0] / step + 0.5) * step
        r, rate = led(k * h)
        v += fresh * ((0.0 if k == 0 else (y - y_before) / h) - v)
        y_before = y
        integral += DRIVE["ki"] * h * (r - y)
        wanted = DRIVE["kp"] * (r - y) + integral + DRIVE["kv"] * (rate - v)
        u = min(max(wanted, -DRIVE["limit"]), DRIVE["limit"])
        integral += back * (u - wanted)
        cut += u != wanted
        x = early @ x
        x[3] = u
        x = late @ x
        out.append(x[0])
    assert 20 < cut < n - 100
    return np.array(out)


@pytest.mark.parametrize(
    ("options", "near"),
    [
        ({"integrator": "gauss", "step": 1e-3}, 1e-9),
        ({}, 1e-6),
        ({"integrator": "implicit", "step": 2e-5}, 2e-6),
        ({"integrator": "rk4", "step": 1e-4}, 1e-9),
        ({"integrator": "ida", "rtol": 1e-9, "atol": 1e-12}, 1e-6),
    ],
    ids=str,
)
def test_it_is_the_drive_that_is_written_by_hand(options: dict[str, Any], near: float) -> None:
    push = fa.Torque(-1.5)
    got = fa.simulate(RIGID, T, [0.2], drive={0: push}, control=fa.Servo(0, **DRIVE, reference=MOVE), **options)
    assert abs(got.q[:, 0] - by_hand(0.2, -1.5)).max() < near
