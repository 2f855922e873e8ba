"""Scenarios of a batch, all at once in the core."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import _core
from ..._check import Array
from ...analysis.findings import LoopWarning, RunWarning
from ...arm.arm import Arm
from ...arm.variation import Setup
from ...loop import loops
from ...model.acting.control import Controller
from ...run.steps import Pace
from .arguments import check_balls
from .job import ENDED, FAILED, Job
from .problems import problems_of, run_problems
from .rollout import OVER, Failure, failures_of, judge, out_of_range


def run_steps(
    job: Job, setups: Sequence[Setup], indices: NDArray[np.int64], blocks: Mapping[str, Any], workers: int, alive: Any
) -> tuple[list[Failure], dict[str, Any]]:
    """Runs these scenarios, made of these setups, into their `Job.blocks`.

    Returns:
        What failed, and counts; counts["interrupted"] after Ctrl-C.
    """
    arms = [s.arm for s in setups]
    one = arms[0]
    for k, arm in enumerate(arms):
        if arm is not one and arm.coordinates != one.coordinates:
            raise ValueError(f"scenario {indices[k]}: its arm must have the same coordinates as the others")
    q0, v0, tau = (None if x is None else _taken(x, indices) for x in (job.q0, job.v0, job.tau))
    if q0 is not None:
        check_balls(one, q0)
    integrator = job.stepping
    apart = not all(_core.in_kernels(integrator.name, arm._core) for arm in arms)
    problems = problems_of(setups, len(indices), job.t, job.options.get("events"), indices, apart)
    prescribed = problems[0].prescribed
    for i in prescribed:
        for name, given, at in (("q0", q0, one.coordinate_of(i)), ("v0", v0, i)):
            value = np.array([p.start[name][at] for p in problems])
            if given is not None and (np.abs(given[:, at] - value) > 1e-9 * np.maximum(1.0, np.abs(value))).any():
                raise ValueError(f"{name}: disagrees with the motion of '{one.coordinates[i]}' at t = {job.t[0]}")
    if apart:  # what is wrong is found in q and v, whether or not they are kept
        rows = len(job.t[:: job.every])
        blocks = {k: np.full((len(indices), rows, n), np.nan) for k, n in (("q", one.nq), ("v", one.nv))} | {**blocks}
    wanted = [k for k in ("q", "v", "a", "tau", "status", "reached", "events") if k in blocks]

    def scenario(k: int) -> tuple[Arm, Array, Any, Sequence[Controller]]:
        s = setups[k % len(setups)]
        return s.arm, one.zero if q0 is None else q0[k % len(q0)], s.loads, list(s.control)

    def grown(k: int, time: float) -> LoopWarning | None:
        arm, start, loads, control = scenario(k)
        return loops.unstable(arm, start, prescribed, job.t, loads, control, time, False) if control else None

    def note(k: int, warning: RunWarning) -> None:
        blocks["wrong"][k] = [*(blocks["wrong"][k] or ()), warning]

    paces: dict[int, Pace] = {}

    def slow(k: int, now: float, steps: int) -> None:
        if k not in paces:
            paces[k] = Pace(scenario(k)[0], job.t, partial(grown, k), partial(note, k))
        paces[k](now, steps)

    stats = run_problems(
        problems, arms, len(indices), job.every, q0, v0, tau, integrator, {k: blocks[k] for k in wanted}, workers,
        alive, whole=job.whole, names=indices, slow=slow,
    )  # fmt: skip
    alone, counted = stats.pop("apart"), stats.pop("counted")
    arms = arms[:1] if all(arm is one for arm in arms) else arms
    if "q" in blocks:
        blocks["out_of_range"][:] = out_of_range(arms, job.t[:: job.every], blocks["q"])

    found = failures_of(blocks, scenario, prescribed, job.t, alone)
    judge(blocks, scenario, problems, job.t, job.every, integrator, alone, counted)
    ended = blocks["status"] == OVER
    blocks["status"][[f.index for f in found]] = FAILED
    blocks["status"][ended] = ENDED
    return [replace(f, index=int(indices[f.index])) for f in found], stats


def _taken(x: Array, indices: NDArray[np.int64]) -> Array:
    """Those rows; not copied where they follow each other."""
    if len(x) == 1:
        return x
    first, last = int(indices[0]), int(indices[-1])
    return x[first : last + 1] if last - first + 1 == len(indices) else np.ascontiguousarray(x[indices])
