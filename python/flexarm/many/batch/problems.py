"""The problems of a batch, and their run in the core."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

import flexarm._core as _core

from ..._check import Array
from ...analysis.findings import RunWarning
from ...arm.arm import Arm
from ...arm.variation import Setup
from ...model.acting.drive import is_patch
from ...run.integrators import Integrator
from ...run.problem import Problem
from .job import renamed

STEP_BYTES = 100  # of a step's times, here and in the core


def problems_of(
    setups: Sequence[Setup], count: int, t: Array, events: Any, names: NDArray[np.int64] | None = None,
    apart: bool = False,
) -> list[Problem]:  # fmt: skip
    """One problem if all scenarios can share it, except for their arms, else one for each; callables of time are
    sampled once for all.

    Args:
        setups: one, or one for each of `count` scenarios. t: times of the run.
        names: of the scenarios, in errors.
        apart: whether each scenario has steps of its own, which may miss a pulse of a callable of time that the
            others' see.
    """
    remembered: dict[int, Any] | None = None if apart else {}

    def made(k: int, s: Setup) -> Problem:
        try:
            return Problem(s.arm, t, None, None, None, s.drive, s.loads, s.control, events, remembered)
        except ValueError as e:
            if len(setups) == 1:
                raise
            raise ValueError(f"scenario {k if names is None else names[k]}: {e}") from None

    first = made(0, setups[0])
    alike = first.shares and not (apart and any(times is not None for times in first.core.asked))
    if count == 1 or ((len(setups) == 1 or _differ_in_arms(setups)) and alike):
        return [first]
    return [first, *(made(k, setups[k % len(setups)]) for k in range(1, count))]


def _differ_in_arms(setups: Sequence[Setup]) -> bool:
    """Whether only the arms differ, and no action depends on them."""
    drive = setups[0].drive
    if any(is_patch(key) for key in drive):
        return False
    same = all(s.drive is drive or all(s.drive[k] is drive[k] for k in drive) for s in setups)
    return same and not any(s.loads or s.control for s in setups)


def run_problems(
    problems: Sequence[Problem], arms: Sequence[Arm], count: int, every: int, q0: Array | None, v0: Array | None,
    tau: Array | None, integrator: Integrator, blocks: Mapping[str, Any], workers: int, alive: Any = None,
    lanes: bool = True, whole: int = 0, names: NDArray[np.int64] | None = None, slow: Any = None,
) -> dict[str, Any]:  # fmt: skip
    """Runs a batch in the core, into `blocks` (q, v, a, tau, events as requested, status, reached). Returns its counts;
    "apart": of each scenario that was run by itself, why it ended; "counted": what each of these counted, or one of
    the kernels in which a step was divided.

    Args:
        arms: of each scenario, in place of the one problem's; or that one.
        slow: told (scenario, time, steps) now and then by "ida".
        q0, v0: (B or 1, n) in place of the problems'. tau: (B or 1, nt - 1 or more or 1, nv), held.
    """
    one = problems[0]
    with one.both.naming():
        try:
            batch = _core.BatchProblem(
                [p.core for p in problems], [a._core for a in arms] if len(arms) > len(problems) else [],
                scenarios=count, t=one.times, every=every, q0=None if q0 is None else q0[:, None],
                v0=None if v0 is None else v0[:, None], tau=tau, nq=one.arm.nq, nv=one.arm.nv,
                integrator=integrator.core, slow=slow, lanes=lanes, whole=whole,
            )  # fmt: skip
            stats = batch.run(dict(blocks), workers, alive)
        except ValueError as e:
            raise ValueError(str(e) if names is None else renamed(str(e), names)) from None
    stats["apart"] = {k: one.both.in_names(reason) for k, reason in stats["apart"].items()}
    stats["failed_steps"] = sum(counts["failed_steps"] for counts in stats["counted"].values())
    return stats


def first_missed(problems: Sequence[Problem]) -> tuple[int, RunWarning] | None:
    """The first problem in which no step met a pulse of a callable, and its warning."""
    return next(((k, pulse) for k, p in enumerate(problems) for pulse in p.missed() if pulse), None)
