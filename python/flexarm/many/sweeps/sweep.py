"""Sweeps: runs of a scene with varied parameters, and quantities of each run."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..._console import progress_bar
from ...analysis.findings import RangeWarning
from ...analysis.validity import range_warning
from ...data.store.files import named
from ...run.scene.scene import Scene, load
from ..batch.arguments import default_workers
from ..batch.job import FAILED, Job
from ..batch.rollout import NOT_DONE, lowest, tell
from ..batch.runner import Runner
from ..batch.simulate import make_job
from ..batch.storage import File, Memory
from .quantities import RunSummary, check_quantities, quantity
from .result import FILE, SweepInterrupted, SweepResult
from .vary import SweepPlan


def sweep(
    scene: Scene | str | Path,
    plan: SweepPlan | str | Path,
    *,
    out: str | Path | None = None,
    resume: bool = True,
    name: str | None = None,
    workers: int | None = None,
    executor: Executor | Callable[[], Executor] | None = None,
    batch: int | None = None,
    progress: bool | Callable[[int, int], None] = False,
) -> SweepResult:
    """Runs a scene once for each scenario of a sweep, and stores the quantities of the plan.

    Args:
        scene: a Scene, or the path or name of one.
        plan: a SweepPlan, or the path or name of a sweep file.
        out: folder for sweep.csv, sweep.png, and sweep.h5, which is written as the scenarios are done, with
            trajectories if the plan stores them. The same call again continues a sweep that was interrupted or killed,
            and repeats damaged scenarios. The folder of another sweep, finished or not, or of another version of
            flexarm is refused.
        resume: False starts anew in such a folder.
        name: as of `simulate_batch`, for functions in the scene or in the plan's outputs, where there is a folder.
        workers: threads; None: one for each core. With an executor, threads in each of its workers (1 if None).
        executor: a concurrent.futures.Executor, or a callable that makes one: each of its workers takes shares of the
            sweep; those of workers that die are computed again. See docs/sweeps.md for processes, Dask and MPI.
        batch: scenarios in a share; None: so that there are about 64 shares.
        progress: a bar on stderr, or lines where that is no terminal; or a callable (done, all).

    Returns:
        The table; failed runs are in its `failures`, and do not affect others.

    Raises:
        ValueError: bad input, or a folder with another sweep in it.
        SweepInterrupted: Ctrl-C; its `.result` is the table so far.
    """
    started = time.perf_counter()
    scene = scene if isinstance(scene, Scene) else load(scene)
    plan = plan if isinstance(plan, SweepPlan) else SweepPlan.load(plan)
    if plan.trajectories and out is None:
        raise ValueError("trajectories = true: needs a folder to write them to, out=")
    job, count = _job(scene, plan)
    workers = default_workers(1 if workers is None and executor is not None else workers)
    runner = Runner(job, count, workers, batch, executor)
    folder = None if out is None else Path(out)
    units = dict(check_quantities(scene.arm, plan.outputs, plan.link))
    storage = Memory(job, count) if folder is None else _file(folder, job, count, resume, name, units)
    with progress_bar(progress, "scenarios", count) as bar:

        def show(done: float) -> None:
            if bar is not None:
                bar(done, count if callable(progress) else f"{done} of {count}")

        held, failures, interrupted = runner.run(storage, show, within=False)
    done = held["status"] != NOT_DONE
    result = SweepResult(
        plan, job.variation.values, {name: np.array(held[f"columns/{name}"]) for name in units}, units, done,
        [(f.index, f.time, f.reason) for f in failures], _beyond(job, held), folder=folder,
    )  # fmt: skip
    counts = {"redone": 0, "resumed": 0, **runner.stats}
    result.stats = {"scenarios": count, "computed": int(done.sum()) - counts["resumed"]}
    result.stats |= {k: counts[k] for k in ("redone", "damaged") if k in counts}
    if folder is not None and done.any():
        result.save(folder)
    result.stats["wall_time"] = time.perf_counter() - started
    if interrupted:
        raise SweepInterrupted(f"interrupted after {done.sum()} of {count} scenarios", result)
    if result.beyond:
        i, worst = result.beyond[0]
        others = f" (and {len(result.beyond) - 1} others)" if len(result.beyond) > 1 else ""
        warnings.warn(worst.of(f"scenario {i}{others}"), stacklevel=2)
    for found in lowest(held["wrong"]).values():
        tell(found)
    return result


def _job(scene: Scene, plan: SweepPlan) -> tuple[Job, int]:
    """The batch of the sweep's scenarios, with a summary of each run."""
    check_quantities(scene.arm, plan.outputs, plan.link)
    outputs = ("q", "v", "tau") if any(quantity(x).forces for x in plan.outputs) else ("q", "v")
    job, count = make_job(
        scene.arm, scene.t, scene.q0, scene.v0, **scene.given(), parameters=plan.parameters(), outputs=outputs,
        **scene.options,
    )  # fmt: skip
    summary = RunSummary(tuple(plan.outputs), plan.link, plan.band, plan.trajectories, plan.every)
    return replace(job, summary=summary), count


def _file(folder: Path, job: Job, count: int, resume: bool, name: str | None, units: dict[str, str]) -> File:
    """The file of this sweep in its folder."""
    otherwise = "take another folder, or start anew there with resume=False (--fresh)"
    with named("output folder", folder):
        folder.mkdir(parents=True, exist_ok=True)
        if resume and (folder / "sweep.csv").exists() and not (folder / FILE).exists():
            raise ValueError(
                f"output folder {str(folder)!r}: holds another sweep, a sweep.csv without its {FILE}; {otherwise}"
            )
    titles = {f"columns/{name}": [(name, unit)] for name, unit in units.items()}
    return File(job, count, folder / FILE, resume, name, "sweep", "output file", otherwise, titles)


def _beyond(job: Job, held: dict[str, Any]) -> list[tuple[int, RangeWarning]]:
    """`SweepResult.beyond`: the scenarios that did not fail, but bent a beam too far."""
    found = []
    for i in np.flatnonzero(~np.isnan(held["out_of_range"][:, 0]) & (held["status"] != FAILED)).tolist():
        arm, worst = job.variation.setup.arm, held["out_of_range"][i]
        if getattr(arm.links[int(worst[0])].beam, "order", None) == "exact":  # the message gives its Gauss points
            arm = job.variation.scenario(i).arm
        found.append((i, range_warning(arm, worst)))
    return found
