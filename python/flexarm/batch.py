"""Batches: many simulations that differ in their start, forces and parameters."""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._check import Array, array, choice, number, whole
from .arm import Arm
from .batch_file import BatchFile
from .batch_result import OUTPUTS, BatchResult
from .batch_run import Job
from .control import Controller
from .load import Load
from .rollout import (
    NOT_DONE,
    BatchInterrupted,
    Failure,
    check_options,
    default_workers,
    forces,
    prepared,
    rows,
    scenario_count,
    show_progress,
)
from .simulation import INTEGRATORS, _check_options
from .tables import check_every
from .validity import RangeWarning, out_of_range
from .variation import Setup, Variation

_CHUNK_BYTES = 1 << 26  # what a file is written in


def batch_memory(arm: Arm, scenarios: int, rows: int, outputs: Sequence[str] = ("q", "v")) -> int:
    """Bytes of a batch's result: 8 B nt (nq + nv) for q and v. Beside it each worker has one workspace, and, where
    parameters change the arm, some hundred arms at a time are held."""
    return 8 * scenarios * rows * sum(arm.nq if k == "q" else arm.nv for k in outputs)


def _physical_memory() -> float:
    import os

    try:
        return float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return np.inf


def _make_job(
    arm: Any, t: Any, q0: Any, v0: Any, tau: Any, setup: dict[str, Any], parameters: Any, outputs: Any, every: Any,
    integrator: str, step: Any, options: dict[str, Any],
) -> tuple[Job, int]:  # fmt: skip
    """The batch, checked, and its number of scenarios."""
    if not isinstance(arm, Arm):
        raise ValueError(f"arm = {arm!r}: must be an Arm; what differs goes into parameters")
    times = array("t", t)
    if times.ndim != 1 or times.size < 2 or not (np.diff(times) > 0).all():
        raise ValueError(f"t has shape {times.shape}: must be one list of at least two times, increasing")
    choice("integrator", integrator, INTEGRATORS)
    if integrator != "ida" and step is None:
        step = float(np.diff(times).min())
    special = ("max_order", "linear_solver", "spectral_radius", "stages")
    _check_options(integrator, step, **{k: options[k] for k in special if k in options})
    options = {k: x for k, x in options.items() if x is not None}
    if step is not None and not 0.0 < number("step", step) < np.inf:
        raise ValueError(f"step = {step}: must be positive and finite, in seconds")
    if integrator in ("implicit", "rk4"):
        check_options(integrator, options.get("rtol"), options.get("spectral_radius"))
    check_every(whole("every", every), times.size - 1)
    if isinstance(outputs, str) or not outputs:
        raise ValueError(f"outputs = {outputs!r}: must be a list of some of {', '.join(OUTPUTS)}")
    wanted = tuple(k for k in OUTPUTS if k in [choice("outputs", x, OUTPUTS) for x in outputs])
    variation = Variation(Setup(arm, **setup), parameters)
    q, v = rows("q0", q0, arm.zero), rows("v0", v0, np.zeros(arm.nv))
    held = forces(tau, arm.nv, times.size, "nt")
    starts = {}
    for name, given, value in (("q0", q0, q), ("v0", v0, v)):
        said = variation.initial(name, value)
        starts[name] = None if given is None and said is value else said
    sizes = {name: len(x) for name, x in starts.items() if x is not None}
    count = scenario_count({"arm": 1, **sizes, "tau": len(held), **variation.sizes})
    job = Job(variation, times, starts["q0"], starts["v0"], None if tau is None else held, wanted, every, integrator,
              step, options)  # fmt: skip
    return job, count


def simulate_batch(
    arm: Arm,
    t: ArrayLike,
    q0: ArrayLike | None = None,
    v0: ArrayLike | None = None,
    *,
    tau: ArrayLike | None = None,
    parameters: Mapping[str, ArrayLike] | None = None,
    drive: Mapping[Any, Any] | None = None,
    loads: Sequence[Load] | None = None,
    control: Controller | Sequence[Controller] | None = None,
    integrator: str = "implicit",
    step: float | None = None,
    rtol: float | None = None,
    spectral_radius: float | None = None,
    outputs: Sequence[str] = ("q", "v"),
    every: int = 1,
    workers: int | None = None,
    progress: Any = False,
    out: str | Path | Mapping[str, Array] | None = None,
    resume: bool = True,
    executor: Any = None,
    batch: int | None = None,
    **options: Any,
) -> BatchResult:
    """Simulates B scenarios over threads. What is not given B times is alike for all. What one scenario gives depends
    neither on the workers nor on the others; one that fails is reported, and spoils no other.

    Args:
        arm, t, drive, loads, control: as of `simulate`.
        q0, v0: (B, nq) or (nq,), (B, nv) or (nv,).
        tau: generalised forces (N, N m), (B, nt, nv) or (nt, nv), held from t[k] to t[k + 1]; the last row acts on
            nothing. An axis of length 1 stands for all scenarios or times.
        parameters: what differs, each (B, ...), by its path in a scene: "link.0.tip.mass", "link.1.beam.length",
            "link.0.beam.material.youngs_modulus", "link.0.tip.com.1", "gravity" (B, 3), "gravity.2", "control.0.kp",
            "load.0.force" (B, 3), "load.0.scale", "drive.0.scale", "drive.0.value" of a constant torque, "q0.1".
            Beams and links that repeat are built once. What changes the coordinates (modes, joints) cannot differ.
        integrator, step, rtol, spectral_radius, options: as of `simulate`; step is the shortest time between two of t,
            if None. "implicit" and "rk4" run wholly in the core, with drives, loads and continuous control whose
            samples fall on ends of steps. Dry friction, sampled control, and "ida" and "gauss" take one `simulate` for
            each scenario. `stats["engine"]` says which.
        outputs: which of "q", "v", "a", "tau". every: times of t between two rows of the result.
        workers: threads; None: one for each core.
        progress: shows a bar on stderr, where that is a terminal; or a callable, which is given the share done about
            ten times a second, and may raise to give up.
        out: arrays by name that the result is written into; or a file ("sweep.h5", extra "batch"), written as the
            scenarios are done: the same call again does what is missing, whatever stopped it. Another batch's file is
            refused.
        resume: whether to go on with such a file; if not, it is written over.
        executor: not there yet.
        batch: scenarios at once, in memory together and written to a file together. None: 256, or 16 for each worker,
            whichever is more, and at most what 64 MB hold where there is a file; all, where nothing but the start and
            the forces differ.

    Returns:
        BatchResult; `batch_memory` tells its bytes beforehand.

    Raises:
        ValueError: bad arguments; a scenario's, with its index.
        BatchInterrupted: (a KeyboardInterrupt) Ctrl-C; its `result` holds what was done.

    Warns:
        RangeWarning: a beam bent further than its order is good for, in at least one scenario.
    """
    if executor is not None:
        raise ValueError("executor: is not there yet; leave it out")
    controls = () if control is None else (control,) if isinstance(control, Controller) else tuple(control)
    setup = {"drive": dict(drive or {}), "loads": tuple(loads or ()), "control": controls}
    options = {"rtol": rtol, "spectral_radius": spectral_radius, **options}
    job, count = _make_job(arm, t, q0, v0, tau, setup, parameters, outputs, every, integrator, step, options)
    workers = default_workers(workers)
    path = Path(out) if isinstance(out, (str, Path)) else None
    need, there = batch_memory(arm, count, job.rows, job.outputs), _physical_memory()
    if path is None and not out and need > there:
        raise ValueError(
            f"outputs: {count} scenarios of {job.rows} rows take {need / 1e9:.3g} GB, this machine has "
            f"{there / 1e9:.3g} GB; take a larger `every`, fewer `outputs`, or out='file.h5'"
        )
    started = time.perf_counter()
    engine = job.engine()
    runner = _Runner(job, count, engine, workers, batch)
    if path is None:
        arrays = None if isinstance(out, (str, Path)) else out
        result, interrupted = runner.in_memory(arrays, progress)
    else:
        result, interrupted = runner.in_file(path, resume, progress)
    name = "scalar" if engine == "steps" else engine
    result.stats = {"engine": name, **result.stats, "wall_time": time.perf_counter() - started}
    if interrupted:
        done = int((result.status != NOT_DONE).sum())
        raise BatchInterrupted(f"interrupted when {done} of {count} scenarios were done", result)
    if runner.beyond:
        warnings.warn(runner.beyond, stacklevel=2)
    return result


@dataclass
class _Runner:
    """Runs a batch, chunk by chunk."""

    job: Job
    count: int
    engine: str
    workers: int
    batch: int | None
    stats: dict[str, Any] = field(default_factory=dict)
    beyond: RangeWarning | None = None
    out_of_range: int = 0

    def _most(self) -> int:
        """Scenarios whose arms are held at once."""
        return max(256, 16 * self.workers)

    def _chunk(self, default: int) -> int:
        if self.batch is None:
            return default
        if whole("batch", self.batch) < 1:
            raise ValueError(f"batch = {self.batch}: must be at least 1")
        return self.batch

    def _run(
        self, indices: NDArray[np.int64], setups: list[Setup], blocks: Mapping[str, Any], alive: Any
    ) -> tuple[list[Failure], bool]:
        failures, stats = self.job.run(self.engine, setups, indices, blocks, self.workers, alive)
        interrupted = bool(stats.pop("interrupted"))
        for k, n in stats.items():
            self.stats[k] = max(self.stats.get(k, 0), n) if k == "workers" else self.stats.get(k, 0) + n
        if self.engine == "steps" and "q" in blocks:
            self._check_range(indices, setups, blocks["q"])
        return failures, interrupted

    def _check_range(self, indices: NDArray[np.int64], setups: list[Setup], q: Array) -> None:
        """Looks for beams bent beyond their order's range; the first is told of."""
        variation, t = self.job.variation, self.job.t[:: self.job.every]
        alike = not variation.varies_arm
        if alike:  # a look at all at once, which mostly is enough
            arm, flat = variation.setup.arm, np.nan_to_num(q).reshape(-1, q.shape[2])
            if out_of_range(arm, np.zeros(len(flat)), flat) is None:
                return
        for k, i in enumerate(indices.tolist()):
            arm = setups[k % len(setups)].arm
            here = ~np.isnan(q[k, :, 0])
            found = out_of_range(arm, t[here], q[k, here])
            if found is not None:
                self.out_of_range += 1
                if self.beyond is None:
                    told = (found.link, found.time, found.rotation, found.limit)
                    self.beyond = RangeWarning(f"scenario {i}: {found}", *told)

    def _chunks(self, indices: NDArray[np.int64], size: int) -> Iterator[tuple[NDArray[np.int64], list[Setup]]]:
        """Pieces of the indices with what they are made of, the next being built while one runs."""
        parts = [indices[k : k + size] for k in range(0, len(indices), size)]
        if len(parts) == 1:
            yield parts[0], self.job.variation.scenarios(parts[0], self.workers)
            return
        with ThreadPoolExecutor(1) as ahead:
            coming = [ahead.submit(self.job.variation.scenarios, part, self.workers) for part in parts[:1]]
            for k, part in enumerate(parts):
                setups = coming.pop().result()
                if k + 1 < len(parts):
                    coming.append(ahead.submit(self.job.variation.scenarios, parts[k + 1], self.workers))
                yield part, setups

    def in_memory(self, out: Mapping[str, Array] | None, progress: Any) -> tuple[BatchResult, bool]:
        job, n = self.job, self.count
        blocks: dict[str, Any] = prepared(out, {k: (n, job.rows, size) for k, size in job.sizes().items()})
        blocks["status"], blocks["reached"] = np.full(n, NOT_DONE, np.int32), np.full(n, job.t[0])
        failures: list[Failure] = []
        interrupted, done = False, 0
        with show_progress(progress, "simulating") as show:
            size = self._chunk(n if job.variation.one_setup else self._most())
            try:
                for part, setups in self._chunks(np.arange(n), size):
                    here = {k: x[done : done + len(part)] for k, x in blocks.items()}
                    found, interrupted = self._run(part, setups, here, _scaled(show, done / n, len(part) / n))
                    failures += found
                    done += len(part)
                    if interrupted:
                        break
            except KeyboardInterrupt:  # between two chunks
                interrupted = True
        for k in job.outputs:
            blocks[k][done:] = np.nan
        return self._result(blocks, failures), interrupted

    def in_file(self, path: Path, resume: bool, progress: Any) -> tuple[BatchResult, bool]:
        job, n = self.job, self.count
        row = max(1, batch_memory(job.variation.setup.arm, 1, job.rows, job.outputs))
        size = self._chunk(int(np.clip(_CHUNK_BYTES // row, self.workers, self._most())))
        file = BatchFile(path, job, n, resume)
        interrupted = False
        try:
            missing = file.missing()
            done = n - len(missing)
            self.stats["resumed"] = done
            with show_progress(progress, "simulating") as show:
                for part, setups in self._chunks(missing, size):
                    shape = {k: (len(part), job.rows, width) for k, width in job.sizes().items()}
                    blocks: dict[str, Any] = {k: np.empty(s) for k, s in shape.items()}
                    blocks["status"], blocks["reached"] = np.empty(len(part), np.int32), np.empty(len(part))
                    found, interrupted = self._run(part, setups, blocks, _scaled(show, done / n, len(part) / n))
                    whole = blocks["status"] != NOT_DONE
                    file.write(part[whole], {k: x[whole] for k, x in blocks.items()}, found)
                    done += len(part)
                    if interrupted:
                        break
        except KeyboardInterrupt:  # between two chunks
            interrupted = True
        finally:
            left = file.missing()
            held, failures = file.close()
        held["status"][left], held["reached"][left] = NOT_DONE, job.t[0]
        return self._result(held, failures), interrupted

    def _result(self, held: Mapping[str, Any], failures: list[Failure]) -> BatchResult:
        job = self.job
        arrays: dict[str, Any] = {k: held.get(k) for k in OUTPUTS}
        stats = {**self.stats, **({"out_of_range": self.out_of_range} if self.out_of_range else {})}
        return BatchResult(job.t[:: job.every], **arrays, status=held["status"], reached=held["reached"],
                           variation=job.variation, failures=failures, stats=stats)  # fmt: skip


def _scaled(show: Any, first: float, share: float) -> Any:
    return None if show is None else lambda part: show(first + share * part)
