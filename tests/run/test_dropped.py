"""What is dropped is gone: no object keeps itself alive by a callback that the core holds for it."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Callable
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from arms import paper_link

t = np.linspace(0, 0.02, 11)


def arm() -> fa.Arm:
    return paper_link(1)


def stepped_mpc() -> list[Any]:
    law = fa.MPC(arm(), reference=lambda s: 0.1 * s, horizon=0.1, stages=5, blocks=3)
    law.step(0.0, np.zeros(4), np.zeros(4))
    return [law, law._core, law.model]


def failing_mpc() -> list[Any]:
    """Which has called back."""
    law = fa.MPC(arm(), horizon=0.1, stages=5, blocks=3)
    with pytest.warns(fa.errors.MPCWarning):
        law.step(0.0, np.full(4, np.nan), np.zeros(4))
    return [law, law._core, law.model]


def run_of(*control: Any, **more: Any) -> list[Any]:
    run = fa.simulate(arm(), t, control=list(control), integrator="implicit", step=1e-3, **more)
    return [run, *control, run.arm]


class Remembers:
    """A law that knows its controller."""

    def __init__(self) -> None:
        self.law = fa.Sampled(self.say, 200, [("joint", 0)])

    def say(self, s: float, y: np.ndarray) -> float:
        return -float(y[0])


def filtered() -> list[Any]:
    known = arm()
    found = fa.KalmanFilter(known, [fa.sensors.Encoder(0, noise=1e-3)], 2e-3, force_noise=0.1, q_std=0.1, v_std=0.1)
    found.update([0.0])
    found.predict(np.zeros(4))
    return [found, found._core, known]


def derived() -> list[Any]:
    run = fa.simulate(arm(), t, v0=[0.1, 0, 0, 0], integrator="implicit", step=1e-3)
    run.gradient(lambda r: (r.q.sum(), {"q": np.ones_like(r.q)}), ["link.0.beam.length"])
    return [run, run.arm]


class Owner:
    """Whose functions know it, and which has the object that they were given to."""

    def torque(self, s: float) -> float:
        return s

    def force(self, s: float) -> tuple[float, float, float]:
        return s, 0.0, 0.0

    def law(self, s: float, y: np.ndarray) -> float:
        return -float(y[0])

    def event(self, s: float, q: np.ndarray, v: np.ndarray) -> float:
        return 1.0 + s


def owned_mpc() -> list[Any]:
    owner: Any = Owner()
    owner.mpc = fa.MPC(
        arm(), reference=owner.torque, loads=[fa.Load(-1, force=owner.force)], strain_limit=[(0, 0.0, "K3", 0.5)],
        horizon=0.1, stages=5, blocks=3,
    )  # fmt: skip
    owner.mpc.step(0.0, np.zeros(4), np.zeros(4))
    return [owner, owner.mpc, owner.mpc._core]


def owned_simulation() -> list[Any]:
    owner: Any = Owner()
    owner.simulation = fa.Simulation(
        arm(), drive={0: fa.Torque(owner.torque)}, loads=[fa.Load(-1, force=owner.force)], events=owner.event,
        control=[fa.Sampled(owner.law, 200, [("joint", 0)]), fa.PD(1.0, 0.1, reference=owner.torque)],
    )  # fmt: skip
    gc.collect()  # what it needs stays
    owner.simulation.step(0.02)
    return [owner, owner.simulation]


def owned_filter() -> list[Any]:
    owner: Any = Owner()
    owner.filter = fa.KalmanFilter(
        arm(), [fa.sensors.Encoder(0, noise=1e-3)], 2e-3, force_noise=0.1, q_std=0.1, v_std=0.1,
        drive={0: fa.Torque(owner.torque)}, loads=[fa.Load(-1, force=owner.force)],
        control=fa.PD(1.0, 0.1, reference=owner.torque),
    )  # fmt: skip
    gc.collect()
    owner.filter.predict(np.zeros(4))
    return [owner, owner.filter]


KINDS: dict[str, Callable[[], list[Any]]] = {
    "MPC that has stepped": stepped_mpc,
    "MPC that could not be solved": failing_mpc,
    "MPC in a run": lambda: run_of(fa.MPC(horizon=0.1, stages=5, blocks=3)),
    "a law that knows its controller": lambda: run_of(Remembers().law),
    "a linear law with a callable reference, of a sensor": lambda: run_of(
        fa.LinearController([], None, None, [[1.0]], rate=200, measure=[fa.sensors.Encoder(0)], reference=lambda s: [s])
    ),
    "computed torque": lambda: run_of(fa.ComputedTorque(1.0, reference=0.0, rate=2000)),
    "a continuous PID, a drive and an event": lambda: run_of(
        fa.LinearController.pid(1.0, 1.0, 0.1, filter_time=0.01),
        drive={0: fa.Torque(lambda s: s)}, events=lambda s, q, v: 1.0 + s,
    ),
    "an MPC whose functions know it": owned_mpc,
    "a Simulation whose functions know it": owned_simulation,
    "a Kalman filter whose functions know it": owned_filter,
    "Kalman filter": filtered,
    "derivatives of a run": derived,
    "a batch": lambda: [fa.simulate_batch(arm(), t, np.zeros((3, 4)), integrator="implicit", step=1e-3)],
    "a closed loop": lambda: [fa.closed_loop(arm(), fa.PD(1.0, 0.1))],
    "a load and a voltage of time": lambda: run_of(loads=[fa.Load(-1, force=lambda s: (s, 0, 0))]),
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_dropped_is_gone(kind: str) -> None:
    """An MPC that had stepped was held by its own core: 134 to 645 kB each."""
    left = []
    for _ in range(3):
        left += [weakref.ref(x) for x in KINDS[kind]()]
    gc.collect()
    assert [x() for x in left if x() is not None] == []
