"""Sweeps: runs of a scene with varied parameters, and quantities of each run."""

import csv
import io
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..._check import Array, warn
from ..._console import progress_bar
from ...analysis.findings import RangeWarning
from ...analysis.validity import range_warning
from ...data.draw.style import DPI, Figure
from ...data.draw.sweep import MISSING, plot_sweep
from ...data.store.files import named, readable, write_whole
from ...data.store.scenarios import read_scenarios
from ...run.scene.scene import Scene, load
from ..batch.arguments import default_workers
from ..batch.job import FAILED, Job
from ..batch.problems import NOT_DONE
from ..batch.rollout import BatchInterrupted, lowest
from ..batch.runner import Runner
from ..batch.simulate import make_job
from ..batch.storage import File, Memory
from .quantities import RunSummary, check_quantities, quantity
from .vary import SweepPlan

FILE = "sweep.h5"  # in the folder of a sweep
_MOST = 4  # columns, and parameters, that a figure shows
#: Units of parameters, by the last name of their paths.
_UNITS = {
    "length": "m", "radius": "m", "inner_radius": "m", "thickness": "m", "mass": "kg", "density": "kg/m³",
    "youngs_modulus": "Pa", "shear_modulus": "Pa", "area": "m²", "second_moment_y": "m⁴", "second_moment_z": "m⁴",
    "torsion_constant": "m⁴",
}  # fmt: skip


@dataclass(repr=False)
class SweepResult:
    """The table of a sweep; every array has one entry for each of its B scenarios.

    Attributes:
        plan: the sweep.
        parameters: values by path, (B,) or (B, k).
        columns: quantities by name, (B,); nan if a run failed or was not done.
        units: of each column.
        done: (B,), whether that scenario was run.
        failures: (index, time reached (s), reason) of each that failed.
        beyond: (index, RangeWarning) of each in which a beam bent beyond the range of its order.
        stats: scenarios, computed (now, not resumed), redone (shares whose worker died), wall_time (s).
        folder: of its files, or None.
    """

    plan: SweepPlan
    parameters: dict[str, Array]
    columns: dict[str, Array]
    units: dict[str, str]
    done: Any
    failures: list[tuple[int, float, str]] = field(default_factory=list)
    beyond: list[tuple[int, RangeWarning]] = field(default_factory=list)
    stats: dict[str, Any] = field(default_factory=dict)
    folder: Path | None = None

    def __len__(self) -> int:
        return len(self.done)

    def __repr__(self) -> str:
        names = ", ".join(self.columns)
        return f"SweepResult({len(self)} scenarios, {len(self.failures)} failed; {names})"

    def __getitem__(self, name: str) -> Array:
        """A column, or a parameter, by name."""
        known = {**self.parameters, **self.columns}
        if name not in known:
            raise ValueError(f"{name!r}: no column of this sweep; it has {', '.join(known)}")
        return known[name]

    @property
    def complete(self) -> bool:
        return bool(self.done.all())

    def trajectory(self, index: int) -> tuple[Array, Array, Array]:
        """t (nt,), q (nt, nq) and v (nt, nv) of a scenario, if the plan stores them."""
        if self.folder is None or not self.plan.trajectories:
            raise ValueError("trajectories = false: this sweep did not keep them")
        path = self.folder / FILE
        with readable("trajectories", path, "the file of a sweep"):
            i = range(len(self))[index]
            _, fixed, rows, _ = read_scenarios(path, slice(i, i + 1))
            return fixed["t"], np.array(rows["q"][0]), np.array(rows["v"][0])

    def save(self, folder: str | Path) -> list[str]:
        """Writes sweep.csv and sweep.png there; their names."""
        path = Path(folder)
        with named("output folder", path):
            path.mkdir(parents=True, exist_ok=True)
        _write_table(path / "sweep.csv", self)
        figure = self.plot()
        write_whole(path / "sweep.png", lambda f: figure.savefig(f, dpi=DPI, format="png"), "output file")
        return ["sweep.csv", "sweep.png"]

    def plot(self) -> Figure:
        """A heat map of each column over a grid of two parameters, else each column over each parameter. Missing
        numbers are grey, or crosses; a line below gives the reason."""
        names, numbers = _parameter_columns(self.parameters)
        labels = {name: _with_unit(name, _UNITS.get(name.rpartition(".")[2], "")) for name in names}
        grid = self.plan.grid()
        why = np.full(len(self), list(MISSING).index("no value"))
        why[~self.done] = list(MISSING).index("not run yet")
        why[[i for i, *_ in self.failures]] = list(MISSING).index("failed")
        failed = f"; {len(self.failures)} failed" if self.failures else ""
        left = "" if self.complete else f" of {len(self)}"
        cut = [f"the first {_MOST} of {len(x)} {w}" for x, w in ((self.columns, "columns"), (names, "parameters"))
               if len(x) > _MOST]  # fmt: skip
        runs = f"{int(self.done.sum())}{left} runs{failed}"
        return plot_sweep(
            [(_with_unit(n, self.units[n]), self.columns[n]) for n in list(self.columns)[:_MOST]],
            [(labels[name], values) for name, values in zip(names, numbers, strict=True)][:_MOST],
            None if grid is None else {labels[name]: values for name, values in grid.items()},
            len(names) == 1 and self.plan.vary[0].kind in ("grid", "list"),
            f"{self.plan.title}: {', '.join([runs, *cut])}",
            why,
        )


def _with_unit(name: str, unit: str) -> str:
    return f"{name} ({unit})" if unit not in ("", "1") else name


class SweepInterrupted(BatchInterrupted):
    """Ctrl-C during a sweep. `.result` is the SweepResult so far."""


def _write_table(path: Path, result: SweepResult) -> None:
    """One line for each scenario that was run."""
    names, numbers = _parameter_columns(result.parameters)
    reasons = {i: reason for i, _, reason in result.failures}
    header = ["scenario", *names, *(f"{n} ({u})" if (u := result.units[n]) else n for n in result.columns), "failure"]
    columns = [*numbers, *result.columns.values()]
    with io.StringIO(newline="") as text:
        out = csv.writer(text, lineterminator="\n")
        out.writerow(header)
        for i in np.flatnonzero(result.done):
            out.writerow([int(i), *(repr(float(c[i])) for c in columns), reasons.get(int(i), "")])
        write_whole(path, lambda f: f.write(text.getvalue().encode()), "output file")


def _parameter_columns(parameters: Mapping[str, Array]) -> tuple[list[str], list[Array]]:
    names, columns = [], []
    for path, v in parameters.items():
        names += [path] if v.ndim == 1 else [f"{path}.{k}" for k in range(v.shape[1])]
        columns += [v] if v.ndim == 1 else list(v.T)
    return names, columns


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
        warn(worst.of(f"scenario {i}{others}"))
    for found in lowest(held["wrong"]).values():
        warn(found)
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
