"""NumPy's masked arrays: a masked value is no number, through whichever door it comes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from messages import refuses

T = [0.0, 1.0, 2.0, 3.0]
HUGE = 1e20  # as files have it where there is no reading


def column(*masked: int) -> Any:
    x = np.ma.masked_array([1.0, 2.0, 3.0, 4.0], mask=[k in masked for k in range(4)])
    x.data[list(masked)] = HUGE
    return x


def arm(**joint: Any) -> fa.Arm:
    return fa.Arm([fa.Link(fa.Revolute("z", **joint), fa.RigidBody(1.0, inertia=(0.1, 0.1, 0.1)))])


def forces(x: Any) -> Any:
    return fa.rollout(arm(), [0.0], step=1e-3, tau=x[:, None])


DOORS: dict[str, Callable[[Any], Any]] = {
    "tau": lambda x: fa.Torque(T, x),
    "q": lambda x: fa.Motion(T, x),
    "t": lambda x: fa.Torque(x, T),
    "columns['x']": lambda x: fa.Data(T, {"x": x}),
    "force": lambda x: fa.Load(force=x[:3]),
    "com": lambda x: fa.RigidBody(1.0, com=x[:3]),
    "gravity": lambda x: fa.Arm(arm().links, gravity=x[:3]),
    "q0": lambda x: fa.simulate(arm(), T, x[1:2]),
    "parameters['link.0.hub.mass']": lambda x: fa.simulate_batch(arm(), T, parameters={"link.0.hub.mass": x}),
}


@pytest.mark.parametrize("field", DOORS)
def test_a_masked_value_is_refused_where_it_is(field: str) -> None:
    DOORS[field](column())  # none is masked
    at = 0 if field == "q0" else 1
    with refuses(f"{field}[{at}]", "masked", "filled", "leave"):
        DOORS[field](column(1, 2))


def test_forces_of_a_rollout_and_lists_of_masked_arrays() -> None:
    forces(column())
    with refuses("tau[2, 0]", "masked", "filled"):
        forces(column(2))
    rows = [column(), column(3)]
    with refuses("q[1, 3]", "masked"):
        fa.Motion([0.0, 1.0], [rows[0], rows[1]])
    with refuses("q[2]", "masked"):
        fa.Motion([0.0, 1.0, 2.0], [0.0, 1.0, np.ma.masked])


def test_states_of_an_arm() -> None:
    q = np.ma.masked_array([0.3], mask=[True])
    for ask in (arm().frame, arm().mass_matrix, arm().modes):
        ask(np.ma.masked_array([0.3]))
        with refuses("q[0]", "masked", "filled"):
            ask(q)


def test_a_law_that_gives_a_masked_value() -> None:
    law = fa.Sampled(lambda t, y: np.ma.masked_array([HUGE], mask=[True]), 100.0)
    with refuses("masked_array", "must be one finite number", error=(ValueError, fa.SimulationError)):
        fa.simulate(arm(), T, control=law)


def test_a_number_that_is_masked() -> None:
    for field in ("damping", "torque_limit"):
        with refuses(field, "masked", "number"):
            arm(**{field: np.ma.masked})
    with refuses("step", "masked", "number"):
        fa.Implicit(np.ma.masked)
    with refuses("tau", "masked"):
        fa.Torque(np.ma.masked)
    assert arm(damping=column()[0]).links[0].joint.damping == 1.0
