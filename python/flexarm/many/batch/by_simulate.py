"""Scenarios of a batch by `simulate`, one by one, in threads."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexarm._core import Feedback, Sampler

from ..._check import Array
from ..._threads import each
from ...analysis.findings import RangeWarning
from ...analysis.validity import worst_range
from ...arm.variation import Setup
from ...model.acting.control import Controller, Run, padded
from ...model.parts.chain import Chain
from ...run.simulation import SimulationError, SimulationInterrupted, simulated
from .job import ENDED, FAILED, Job
from .rollout import NOT_DONE, Failure


class _Held(Controller):
    """Forces given as rows, each held from one output time to the next."""

    def __init__(self, rows: Array) -> None:
        self.rows = rows

    def _columns(self, arm: Chain) -> list[Array]:
        return []

    def _laws(self, arm: Chain, run: Run) -> tuple[list[Feedback], list[Sampler]]:
        first, period = float(run.times[0]), float(run.times[-1] - run.times[0]) / (run.times.size - 1)
        last, rows = run.times.size - 2, self.rows

        def force(t: float, q: Array, v: Array, a: Array) -> Array:
            return padded(rows[min(round((t - first) / period), last)], arm.nv + run.total)

        return [], [Sampler(first, period, 0.0, force)]


def run_simulations(
    job: Job, setups: Sequence[Setup], indices: NDArray[np.int64], blocks: Mapping[str, Any], workers: int, alive: Any
) -> tuple[list[Failure], dict[str, Any]]:
    """Runs these scenarios, made of these setups, into their `Job.blocks`.

    Returns:
        What failed, and counts; counts["interrupted"] after Ctrl-C.
    """
    if job.tau is not None and job.tau.shape[1] > 1:
        steps = np.diff(job.t)
        if np.ptp(steps) > 1e-9 * steps.max():
            raise ValueError("tau: forces that are held, in scenarios that run one by one, need equal steps of t")
    stop, begun = threading.Event(), float(job.t[0])
    shares, beyond = np.zeros(len(indices)), blocks["out_of_range"]
    blocks["status"][:] = NOT_DONE
    blocks["reached"][:] = begun
    for name in job.outputs:
        blocks[name][:] = np.nan
    failures: list[Failure] = []
    steps = np.zeros(len(indices), np.int64)

    def one(k: int) -> None:
        def look(now: float) -> None:
            shares[k] = (now - begun) / (job.t[-1] - begun)
            if stop.is_set():
                raise KeyboardInterrupt

        setup = setups[k % len(setups)]
        result, status, failure = _one(job, setup, int(indices[k]), look)
        blocks["wrong"][k] = [x for x in result._wrong if not isinstance(x, RangeWarning)]  # which are in `beyond`
        if status != NOT_DONE:
            beyond[k] = worst_range(setup.arm, result.t, result.q) or np.nan
        for name in job.outputs:
            part = getattr(result, name)[:: job.every]
            blocks[name][k, : len(part)] = part
        times = [x[-1] for x in result.t_events or () if len(x)]
        if status == ENDED:
            blocks["reached"][k] = max(times)
        else:
            blocks["reached"][k] = job.t[-1] if status == 0 else failure.time if failure else result.t[-1]
        blocks["status"][k] = status
        if job.events:
            blocks["events"][k] = (result.t_events, result.q_events, result.v_events)
        shares[k], steps[k] = 1.0, result.stats["steps"]
        if failure:
            failures.append(failure)
        if status == NOT_DONE:
            raise KeyboardInterrupt

    def show() -> None:
        if alive:
            alive(float(shares.mean()))

    interrupted = False
    try:
        each(one, len(indices), workers, show, stop.set)
    except KeyboardInterrupt:
        interrupted = True
    failures.sort(key=lambda f: f.index)
    return failures, {"steps": int(steps.sum()), "workers": workers, "interrupted": interrupted}


def _one(job: Job, setup: Setup, i: int, look: Callable[[float], None]) -> tuple[Any, int, Failure | None]:
    """Result, status and failure of a scenario."""
    start = {k: x[i % len(x)] for k, x in (("q0", job.q0), ("v0", job.v0)) if x is not None}
    control, options = list(setup.control), dict(job.options)
    if job.tau is not None and job.tau.shape[1] > 1:
        control.append(_Held(job.tau[i % len(job.tau)]))
    elif job.tau is not None:
        options["tau"] = job.tau[i % len(job.tau), 0]
    try:
        result = simulated(
            setup.arm, job.t, **start, drive=setup.drive, loads=setup.loads, control=control,
            integrator=job.integrator, step=job.step, progress=look, **options,
        )  # fmt: skip
        return result, result.status, None
    except SimulationError as e:
        return e.result, FAILED, Failure(i, e.time, str(e))
    except SimulationInterrupted as e:
        return e.result, NOT_DONE, None
    except ValueError as e:
        raise ValueError(f"scenario {i}: {e}") from None
