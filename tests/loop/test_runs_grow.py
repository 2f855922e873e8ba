"""Growth of runs against the poles: samples, holds, delays, filters, slow sensors, rates of several, mixtures."""

from __future__ import annotations

import warnings
from math import ceil

import flexarm as fa
import numpy as np
import pytest

INERTIA = 0.35
J, V = ("joint", 0), ("rate", 0)


def law(gains: list[float], measured: list, rate: float = 100.0, delay: float = 0.0) -> fa.Sampled:
    return fa.Sampled(lambda t, y: -INERTIA * (np.array(gains) @ y), rate, measured, delay=delay)


def encoder(**more) -> fa.sensors.Encoder:
    return fa.sensors.Encoder(0, pulses=None, **more)


def tacho(**more) -> fa.sensors.Tachometer:
    return fa.sensors.Tachometer(0, **more)


LOOPS = {
    "late by a part of a period": law([400, 1], [J, V], delay=0.004),
    "late by more than a period": law([400, 1], [J, V], delay=0.013),
    "behind low passes": law([400, 1], [encoder(filter=20.0), tacho(filter=fa.sensors.LowPass(30.0, 2))]),
    "of slower sensors": law([400, 2], [encoder(rate=50.0), tacho(rate=25.0)]),
    "of late sensors": law([400, 2], [encoder(delay=0.01), tacho(delay=0.02)]),
    "of sensors with a gain": law([400, 4], [encoder(gain=1.5), tacho(gain=0.2)]),
    "of an accelerometer": law([400, -0.5, 0.3], [J, V, fa.sensors.Accelerometer(0, axis="y")]),
    "of two rates": [law([400, 0], [J, V]), law([0, 1], [J, V], rate=40)],
    "of two rates, late": [law([400, 0], [J, V], delay=0.007), law([0, 4], [J, V], rate=40, delay=0.03)],
    "sampled beside PD": [fa.PD(100 * INERTIA, INERTIA), law([300, 0], [J, V], rate=50)],
    "sampled beside a continuous PID": [
        fa.LinearController.pid(100 * INERTIA, 200 * INERTIA, INERTIA, filter_time=0.01),
        law([300, 0], [J, V], rate=50),
    ],
}


@pytest.mark.parametrize("name", LOOPS)
def test_a_run_grows_as_its_fastest_pole_says(name: str) -> None:
    """A rigid link: its rate, taken every period, is one geometric oscillation once all else is gone."""
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, (0.5, 0, 0), (0, 0, 0.1), (1, 0, 0)))])
    loop = fa.closed_loop(arm, LOOPS[name])
    fastest = loop.poles[0]
    assert 0.1 < fastest.real < 5 and not loop.stable
    every = loop.period * ceil(0.05 / loop.period - 1e-9)
    n = round(every / 1e-3)
    t = np.arange(int(4.0 / every) * n + 1) * 1e-3
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run = fa.simulate(arm, t, [1e-6], control=LOOPS[name], integrator="gauss", step=1e-3)
    y = run.v[len(t) // 2 :: n, 0]
    a, b = np.linalg.lstsq(np.c_[y[1:-1], y[:-2]], y[2:], rcond=None)[0]
    z = np.roots([1, -a, -b])
    assert np.log(np.abs(z).max()) / every == pytest.approx(fastest.real, rel=1e-7)
    turn = fastest.imag * every
    assert np.abs(np.angle(z[0])) == pytest.approx(abs((turn + np.pi) % (2 * np.pi) - np.pi), rel=1e-7)
