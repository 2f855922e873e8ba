"""Evaluations of one state and of many: the same numbers, from one thread and from many, in memory that is kept."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from arms import random_arm, random_state
from messages import refuses

LOADS = [fa.Load(0, force=(1.0, 2.0, 3.0)), fa.Load(1, moment=(0.1, 0.2, 0.3), axes="section")]
CALLS: dict[str, Callable[[fa.Arm, Any, Any, Any], Any]] = {
    "forward": lambda arm, q, v, a: arm.forward_dynamics(q, v, a),
    "ci": lambda arm, q, v, a: arm.forward_dynamics(q, v, a, "ci"),
    "prescribed": lambda arm, q, v, a: arm.forward_dynamics(q, v, a, prescribed={0: 2.0}),
    "loaded": lambda arm, q, v, a: arm.forward_dynamics(q, v, a, loads=LOADS),
    "loaded less": lambda arm, q, v, a: arm.forward_dynamics(q, v, a, loads=LOADS[:1]),
    "inverse": lambda arm, q, v, a: arm.inverse_dynamics(q, v, a),
    "inverse loaded": lambda arm, q, v, a: arm.inverse_dynamics(q, v, a, loads=LOADS),
    "reaction": lambda arm, q, v, a: arm.joint_reaction(q, v, a, 0),
    "bias": lambda arm, q, v, a: arm.bias(q, v),
    "mass matrix": lambda arm, q, v, a: arm.mass_matrix(q),
    "energy": lambda arm, q, v, a: arm.energy(q, v),
    "momentum": lambda arm, q, v, a: arm.momentum(q, v),
    "centre of mass": lambda arm, q, v, a: arm.center_of_mass(q),
    "frame": lambda arm, q, v, a: arm.frame(q),
    "jacobian": lambda arm, q, v, a: arm.jacobian(q, 0),
    "jacobian rate": lambda arm, q, v, a: arm.jacobian_rate(q, v),
    "velocity": lambda arm, q, v, a: arm.velocity(q, v),
    "acceleration": lambda arm, q, v, a: arm.acceleration(q, v, a, 1),
}


def hinged() -> fa.Arm:
    beam = fa.Beam(0.5, fa.Rectangle(0.004, 0.01), fa.Material(7850, 209e9, 0.3), {"bending_y": 2, "torsion": 1})
    hub = fa.RigidBody(0.3, inertia=(1e-4, 2e-4, 2e-4), end=(0.1, 0, 0))
    return fa.Arm([fa.Link(fa.Revolute(axis), hub, beam) for axis in "zyz"], (0, 0, -9.81))


def states(arm: fa.Arm, count: int) -> list[np.ndarray]:
    rng = np.random.default_rng(4)
    return [0.01 * rng.normal(size=(count, n)) for n in (arm.nq, arm.nv, arm.nv)]


def flat(answer: Any) -> np.ndarray:
    return np.concatenate([np.ravel(x) for x in answer]) if isinstance(answer, tuple) else np.ravel(answer)


@pytest.mark.parametrize("name", CALLS)
def test_one_state_is_a_row_of_many(name: str) -> None:
    arm, call = hinged(), CALLS[name]
    q, v, a = states(arm, 6)
    many = call(arm, *(x.reshape(2, 3, -1) for x in (q, v, a)))
    for k in range(6):
        one = call(arm, q[k], v[k], a[k])
        rows = [x[k // 3, k % 3] for x in (many if isinstance(many, tuple) else (many,))]
        for x, y in zip(one if isinstance(one, tuple) else (one,), rows, strict=True):
            assert np.shape(x) == np.shape(y) and np.array_equal(x, y)
        as_lists = call(arm, q[k].tolist(), v[k].tolist(), a[k].tolist())
        strided = call(arm, *(np.repeat(x[k], 2)[::2] for x in (q, v, a)))
        assert np.array_equal(flat(one), flat(as_lists)) and np.array_equal(flat(one), flat(strided))


def test_many_threads_at_once_get_their_own_numbers() -> None:
    arm, rounds, count = hinged(), 8, 40  # 40 states together are long enough for the lock to be let go of
    q, v, a = states(arm, rounds * count)
    jobs = [(call, slice(k * count, (k + 1) * count)) for k in range(rounds) for call in CALLS.values()]

    def run(job: tuple[Callable[..., Any], slice]) -> np.ndarray:
        call, at = job
        ones = [call(arm, q[i], v[i], a[i]) for i in range(at.start, at.start + 5)]
        return np.concatenate([flat(call(arm, q[at], v[at], a[at])), *map(flat, ones)])

    alone = [run(job) for job in jobs]
    with ThreadPoolExecutor(8) as pool:
        for together, expected in zip(pool.map(run, jobs * 2), alone * 2, strict=True):
            assert np.array_equal(together, expected)


def test_a_state_that_fails_leaves_no_trace() -> None:
    rng = np.random.default_rng(2)
    for arm in (hinged(), random_arm(rng, 3, orders=("exact",))):
        q, v, tau = random_state(rng, arm)
        for name in ("forward", "ci", "inverse"):
            expected = CALLS[name](arm, q, v, tau)
            with refuses("too large"):
                CALLS[name](arm, q, v + 1e200, tau)
            assert np.array_equal(CALLS[name](arm, q, v, tau), expected)


def test_memory_goes_with_the_arm() -> None:
    gc.disable()
    try:
        arm = hinged()
        for call in CALLS.values():
            call(arm, arm.zero, arm.zero, arm.zero)
        arm.inverse_derivatives(arm.zero, arm.zero, arm.zero)
        gone = weakref.ref(arm), weakref.ref(arm._core)
        del arm
        assert gone[0]() is None and gone[1]() is None
    finally:
        gc.enable()
