"""Signatures are alike across rooms: one default for `link`, one name for a step, what acts is named by keyword."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from flexarm.tasks import Task, TipTracking
from public import LISTS, names


def callables() -> Iterator[tuple[str, Callable[..., Any]]]:
    """All public functions, classes and methods."""
    for name, thing in [*(x for module in LISTS for x in names(module).items()), ("tasks.Task", Task)]:
        if callable(thing) and not (inspect.isclass(thing) and issubclass(thing, BaseException)):
            yield name, thing
        if inspect.isclass(thing):
            for method, value in inspect.getmembers(thing, callable):
                if not method.startswith("_"):
                    yield f"{name}.{method}", value


PARAMETERS = [
    (name, p)
    for name, thing in callables()
    if not name.endswith((".with_traceback", ".add_note"))
    for p in inspect.signature(thing).parameters.values()
]


def test_the_last_link_is_the_default() -> None:
    first = {"joint_rate", "joint_rates", "patch_column"}  # which must be told
    found = [(name, p.default) for name, p in PARAMETERS if p.name == "link" and name.split(".")[-1] not in first]
    assert len(found) > 20
    given = {"split", "Point"}
    results = {"ModeShapes"}  # arrays, not arguments
    assert [name for name, default in found if default != -1 and name not in given | results] == []
    whole = {"lqr", "lqg"}  # of all joints
    other = {name: p.default for name, p in PARAMETERS if p.name == "actuate" and p.default != (-1,)}
    assert other == dict.fromkeys(whole)


def test_a_step_is_a_step_and_what_acts_is_named() -> None:
    assert [name for name, p in PARAMETERS if p.name == "dt"] == []
    named = [(name, p.kind) for name, p in PARAMETERS if p.name == "loads" and name not in ("Scene", "Result")]
    assert len(named) > 8
    assert [name for name, kind in named if kind is not inspect.Parameter.KEYWORD_ONLY] == []


def test_one_meaning_has_one_name() -> None:
    """Names that other arguments have in their place: of a tolerance, a time for deciding, a ratio of a gear."""
    others = {"tol", "time_budget", "gear", "k", "i", "h", "dt"}
    assert [(name, p.name) for name, p in PARAMETERS if p.name in others] == []


@pytest.mark.parametrize(
    "of",
    [
        lambda arm, q, link: arm.strain(q, **link),
        lambda arm, q, link: arm.deflection(q, **link),
        lambda arm, q, link: arm.joint_reaction(q, np.ones(arm.nv), np.ones(arm.nv), **link),
        lambda arm, q, link: fa.sensors.StrainGauge(**link).measure(arm, 0.0, q, np.ones(arm.nv)),
        lambda arm, q, link: fa.sensors.Encoder(noise=1.0, **link).read(run(arm)).y,
        lambda arm, q, link: fa.simulate(arm, [0, 0.01], q, control=fa.PD(1.0, 0.1, **link)).q,
        lambda arm, q, link: fa.simulate(arm, [0, 0.01], q, control=fa.StrainFeedback(1.0, 0.1, 0.1, **link)).q,
        lambda arm, q, link: fa.simulate(arm, [0, 0.01], drive={link.get("link", -1): fa.Torque(0.1)}).q,
        lambda arm, q, link: arm.modes(speed={link.get("link", -1): 1.0}, lock=[link.get("link", -1)]).frequencies,
    ],
)
def test_minus_one_and_no_number_are_the_last_link(of: Callable[..., np.ndarray]) -> None:
    arm = TipTracking().arm
    q = np.linspace(0.001, 0.002, arm.nq)
    last, first = of(arm, q, {"link": 1}), of(arm, q, {"link": 0})
    np.testing.assert_array_equal(of(arm, q, {}), last)
    np.testing.assert_array_equal(of(arm, q, {"link": -1}), last)
    np.testing.assert_array_equal(of(arm, q, {"link": -2}), first)
    assert np.shape(first) != np.shape(last) or not np.array_equal(first, last)


def run(arm: fa.Arm) -> fa.Result:
    return fa.simulate(arm, np.linspace(0, 0.1, 11), v0=np.ones(arm.nv))


def test_a_watch_takes_negative_links() -> None:
    result = run(TipTracking().arm)
    *_, found = result.check(fa.Watch({("rotation", -1): 1e-9}))
    assert (found.where, found.unit) == (result.arm.names[1], "rad") and found.value > found.limit == 1e-9
