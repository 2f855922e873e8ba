"""Sweeps: a scene many times over, with its parameters varied, and what is noted of each run."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._check import Array, whole
from .._console import progress_bar
from ..analysis.validity import RangeWarning, out_of_range
from ..batch.rollout import default_workers
from ..batch.runner import renamed
from ..batch.shares import gather, shares
from ..batch.simulate import simulate_batch
from ..draw.style import DPI
from ..draw.sweep import plot_sweep
from ..scene.scene import Scene, load
from ..store.files import check_space, named, write_whole
from ..store.hdf5 import h5py
from .quantities import check_quantities, quantity
from .store import Kept, parameter_columns, read_trajectory, sweep_marks, write_table, write_trajectories
from .vary import Sweep, load_sweep

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST_NUMBERS = 4_000_000  # numbers in the trajectories of one share

_MOST = 4  # columns, and parameters, that a figure shows


@dataclass(repr=False)
class SweepResult:
    """The table of a sweep; every array has one entry for each of its B scenarios.

    Attributes:
        plan: the sweep.
        parameters: values by path, (B,) or (B, k).
        columns: what was noted, by name, (B,); nan where a run failed, or was not done.
        units: of each column.
        done: (B,), whether that scenario was run.
        failures: (index, time reached (s), reason) of each that could not go on.
        beyond: (index, text, link, time, rotation, limit) of each that bent a beam further than its
            order is good for (RangeWarning).
        stats: scenarios, computed (now, not resumed), redone (shares whose worker died), wall_time (s).
        folder: where it was written, or None.
    """

    plan: Sweep
    parameters: dict[str, Array]
    columns: dict[str, Array]
    units: dict[str, str]
    done: Any
    failures: list[tuple[int, float, str]] = field(default_factory=list)
    beyond: list[tuple[Any, ...]] = field(default_factory=list)
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

    def trajectory(self, i: int) -> tuple[Array, Array, Array]:
        """t (nt,), q (nt, nq) and v (nt, nv) of scenario i, where the plan keeps them."""
        if self.folder is None or not self.plan.trajectories:
            raise ValueError("trajectories = false: this sweep did not keep them")
        return read_trajectory(self.folder / "trajectories.h5", range(len(self))[i])

    def save(self, folder: str | Path) -> list[str]:
        """Writes sweep.csv and sweep.png there; their names."""
        path = Path(folder)
        with named("output folder", path):
            path.mkdir(parents=True, exist_ok=True)
        write_table(path / "sweep.csv", self)
        figure = self.plot()
        write_whole(path / "sweep.png", lambda f: figure.savefig(f, dpi=DPI, format="png"), "output file")
        return ["sweep.csv", "sweep.png"]

    def plot(self) -> Figure:
        """A heat map of each column over a grid of two parameters, else each column over each parameter."""
        names, numbers = parameter_columns(self.parameters)
        failed = f"; {len(self.failures)} failed" if self.failures else ""
        left = "" if self.complete else f" of {len(self)}"
        return plot_sweep(
            [(self._label(n), self.columns[n]) for n in list(self.columns)[:_MOST]],
            list(zip(names, numbers, strict=True))[:_MOST],
            self.plan.grid(),
            len(names) == 1 and self.plan.vary[0].kind in ("grid", "list"),
            f"{self.plan.title}: {int(self.done.sum())}{left} runs{failed}",
        )

    def _label(self, column: str) -> str:
        unit = self.units[column]
        return f"{column} ({unit})" if unit not in ("", "1") else column


class SweepInterrupted(KeyboardInterrupt):
    """Ctrl-C during a sweep. `.result` is the SweepResult up to there."""

    def __init__(self, message: str, result: SweepResult) -> None:
        super().__init__(message)
        self.result = result

    def __reduce__(self) -> Any:
        return type(self), (str(self), self.result)


# -- one share ----------------------------------------------------------------------------------------------


def run_share(first: int, scene: Scene, parameters: Mapping[str, Array], plan: Sweep, workers: int) -> dict[str, Any]:
    """What a worker does: simulates the scenarios of these parameters and sums them up.

    Returns:
        rows (n, columns), failures, and, where the plan keeps them, q and v.
    """
    options: dict[str, Any] = {"integrator": "ida", **scene.options}  # what Scene.run takes
    noted = [quantity(x) for x in plan.outputs]
    outputs = ("q", "v", "tau") if any(x.forces for x in noted) else ("q", "v")
    given: dict[str, Any] = {"drive": scene.drive, "loads": scene.loads, "control": scene.control}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RangeWarning)  # told once, for all
        try:
            found = simulate_batch(
                scene.arm, scene.t, scene.q0, scene.v0, parameters=parameters, outputs=outputs, workers=workers,
                **given, **options,
            )  # fmt: skip
        except ValueError as e:
            raise ValueError(renamed(str(e), range(first, first + len(next(iter(parameters.values())))))) from None
    link = scene.arm._link(plan.link)
    width = len(check_quantities(scene.arm, list(plan.outputs), link))
    rows = np.full((len(found), width), np.nan)
    failed, beyond = {f.index for f in found.failures}, []
    for i in range(len(found)):
        if i in failed:
            continue
        run = found[i]
        rows[i] = np.concatenate([x.of(run, link, plan.band) for x in noted])
        too_far = out_of_range(run.arm, run.t, run.q)
        if too_far:
            beyond.append((first + i, str(too_far), too_far.link, too_far.time, too_far.rotation, too_far.limit))
    failures = [(first + f.index, f.time, f.reason) for f in found.failures]
    out: dict[str, Any] = {"rows": rows, "failures": failures, "beyond": beyond}
    if plan.trajectories:
        assert found.q is not None and found.v is not None
        out |= {"q": found.q[:, :: plan.every], "v": found.v[:, :: plan.every]}
    return out


# -- the sweep ----------------------------------------------------------------------------------------------


def _size(scene: Scene, count: int, batch: int | None, threads: int) -> int:
    """Scenarios in a share: 64 shares, but a few for each thread, unless their trajectories would take more memory than
    they should."""
    if batch is not None:
        if whole("batch", batch) < 1:
            raise ValueError(f"batch = {batch}: must be at least 1")
        return batch
    most = max(threads, _MOST_NUMBERS // (len(scene.t) * (scene.arm.nq + 3 * scene.arm.nv)))
    return int(min(most, max(4 * threads if threads > 1 else 1, -(-count // 64))))


def sweep(
    scene: Scene | str | Path,
    plan: Sweep | str | Path,
    *,
    out: str | Path | None = None,
    resume: bool = True,
    fingerprint: str | None = None,
    workers: int | None = None,
    executor: Executor | Callable[[], Executor] | None = None,
    batch: int | None = None,
    progress: bool | Callable[[int, int], None] = False,
) -> SweepResult:
    """Runs a scene once for each scenario of a sweep, and notes what the plan asks for.

    Args:
        scene: a Scene, or the path or name of one.
        plan: a Sweep, or the path or name of a sweep file.
        out: folder for sweep.csv, sweep.png, and trajectories.h5 where the plan keeps them. A sweep that was
            interrupted or killed goes on from there when it is called again; what is damaged is computed again.
            Another sweep's folder is refused, finished or not, and that of another version of flexarm.
        resume: False forgets what the folder holds.
        fingerprint: as of `simulate_batch`, for functions that a folder cannot know a sweep by.
        workers: threads; None: one for each core. With an executor, threads in each of its workers (1 if None).
        executor: a concurrent.futures.Executor, or a callable that makes one: each of its workers takes shares of the
            sweep; those of workers that die are computed again. See docs/sweeps.md for processes, Dask and MPI.
        batch: scenarios in a share; None: so that there are about 64 shares.
        progress: a bar on stderr, where that is a terminal; or a callable (done, all).

    Returns:
        The table; runs that failed are in its `failures`, and spoil no other.

    Raises:
        ValueError: bad input, or a folder with another sweep in it.
        SweepInterrupted: Ctrl-C; its `.result` is what was done.
    """
    started = time.perf_counter()
    scene = scene if isinstance(scene, Scene) else load(scene)
    plan = plan if isinstance(plan, Sweep) else load_sweep(plan)
    parameters = plan.parameters()
    count = len(next(iter(parameters.values())))
    if plan.trajectories:
        try:
            h5py("trajectories = true:")
        except ImportError as e:
            raise ValueError(str(e)) from None
        if out is None:
            raise ValueError("trajectories = true: needs a folder to write them to, out=")
    columns = check_quantities(scene.arm, list(plan.outputs), plan.link)
    blank = {name: np.full(count, np.nan) for name, _ in columns}
    result = SweepResult(plan, parameters, blank, dict(columns), np.zeros(count, bool))
    kept: Kept | None = None
    if out is not None:
        result.folder = Path(out)
        kept = _kept(result, scene, parameters, resume, fingerprint)
        for part, found in kept.read():
            _enter(result, part, found)
    computed = int((~result.done).sum())
    workers = default_workers(1 if workers is None and executor is not None else workers)
    todo = _missing(result.done, _size(scene, count, batch, workers))
    stop: BaseException | None = None
    again: list[range] = []
    with progress_bar(progress, "scenarios", count) as bar:

        def show(done: int) -> None:
            if bar is not None:
                bar(done, count if callable(progress) else f"{done} of {count}")

        show(count - computed)
        try:
            for part, found in _computed(scene, plan, parameters, todo, workers, executor, again.append):
                if kept is not None:
                    kept.write(part, found)
                _enter(result, part, found)
                show(int(result.done.sum()))
        except KeyboardInterrupt as e:
            stop = e
    result.failures.sort()
    result.beyond.sort()
    result.stats = {"scenarios": count, "computed": computed - int((~result.done).sum()), "redone": len(again)}
    if kept is not None:
        result.stats |= {"damaged": kept.damaged} if kept.damaged else {}
        _write(result, kept, scene)
    result.stats["wall_time"] = time.perf_counter() - started
    if stop is not None:
        raise SweepInterrupted(f"interrupted after {result.done.sum()} of {count} scenarios", result) from stop
    if result.beyond:
        i, text, *rest = result.beyond[0]
        others = f"; so do {len(result.beyond) - 1} others" if len(result.beyond) > 1 else ""
        warnings.warn(RangeWarning(f"scenario {i}: {text}{others}", *rest), stacklevel=2)
    return result


def _kept(result: SweepResult, scene: Scene, parameters: Mapping[str, Array], resume: bool, name: str | None) -> Kept:
    """What the folder holds of this sweep, after a look whether there is room for the rest."""
    folder, plan, count = result.folder, result.plan, len(result)
    assert folder is not None
    with named("output folder", folder):
        folder.mkdir(parents=True, exist_ok=True)
    row = 64 * (len(result.columns) + sum(v[0].size for v in parameters.values()))  # as numbers, and in words
    if plan.trajectories:  # in shares, and all together
        row += 2 * 8 * len(scene.t[:: plan.every]) * (scene.arm.nq + scene.arm.nv)
    kept = Kept(folder, sweep_marks(scene, plan, parameters, name), resume, (count, len(result.columns)))
    check_space("output file", folder / "trajectories.h5" if plan.trajectories else kept.whole, count * row)
    if plan.trajectories and kept.whole.exists():
        try:
            read_trajectory(folder / "trajectories.h5", 0)
        except ValueError:  # gone, or damaged
            kept.forget()
    return kept


def _write(result: SweepResult, kept: Kept, scene: Scene) -> None:
    """What the folder shall hold."""
    assert result.folder is not None
    if result.complete and result.stats["computed"]:
        plan, path = result.plan, result.folder / "trajectories.h5"
        if plan.trajectories:
            write_trajectories(kept, path, result, scene, result.parameters)
        kept.finish(result)
    if result.done.any():
        result.save(result.folder)


def _missing(done: Any, size: int) -> list[range]:
    """Ranges of up to `size` scenarios that are not done."""
    edges = np.flatnonzero(np.diff(np.concatenate([[True], done, [True]]).astype(int)))
    out = []
    for first, last in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        out += [range(first + p.start, first + p.stop) for p in shares(last - first, size)]
    return out


def _enter(result: SweepResult, part: range, found: Mapping[str, Any]) -> None:
    for k, column in enumerate(result.columns.values()):
        column[part.start : part.stop] = found["rows"][:, k]
    result.done[part.start : part.stop] = True
    result.failures += [(int(i), float(t), str(reason)) for i, t, reason in found["failures"]]
    result.beyond += [(i, str(text), *rest) for i, text, *rest in found["beyond"]]


def _computed(
    scene: Scene,
    plan: Sweep,
    parameters: Mapping[str, Array],
    todo: list[range],
    workers: int,
    executor: Any,
    again: Callable[[range], None],
) -> Iterable[tuple[range, dict[str, Any]]]:
    def arguments(part: range) -> dict[str, Any]:
        values = {path: v[part.start : part.stop] for path, v in parameters.items()}
        return {"first": part.start, "scene": scene, "parameters": values, "plan": plan, "workers": workers}

    if executor is not None:
        yield from gather(run_share, arguments, todo, executor, again=again)
    else:
        for part in todo:
            yield part, run_share(**arguments(part))
