"""Batches: many simulations that differ in their start, forces and parameters."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._check import Array, array, choice, number, whole
from .arm import Arm
from .batch_file import BatchFile
from .batch_run import Job
from .control import Controller
from .load import Load
from .result import Result
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

OUTPUTS = ("q", "v", "a", "tau")
_CHUNK, _CHUNK_BYTES = 1024, 1 << 26  # scenarios at once, and what a file is written in


@dataclass(repr=False)
class BatchResult:
    """What a batch gives: B scenarios, nt rows each.

    Attributes:
        t: times (s), (nt,). q: (B, nt, nq). v, a, tau: (B, nt, nv). Those not asked for are None; rows after a
            failure are nan. Of a batch with a file they are mapped from it, not read.
        status: (B,): 0 where the scenario was done; 4 where Ctrl-C came first; else it failed.
        reached: (B,), time reached (s).
        failures: index, time and reason of each scenario that failed.
        variation: what the scenarios are made of.
        stats: engine ("scalar": all steps in the core; "simulate": one `simulate` for each scenario), workers, steps,
            resumed (scenarios that the file held already), wall_time (s).
    """

    t: Array
    q: Array | None
    v: Array | None
    a: Array | None
    tau: Array | None
    status: NDArray[np.int32]
    reached: Array
    variation: Variation
    failures: list[Failure] = field(default_factory=list)
    stats: dict[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.status)

    def __repr__(self) -> str:
        return f"BatchResult({len(self)} scenarios, {len(self.t)} rows, {len(self.failures)} failed)"

    def arm(self, i: int) -> Arm:
        """The arm of scenario i, with its parameters."""
        return self.variation.scenario(range(len(self))[i]).arm

    def __getitem__(self, i: int) -> Result:
        """Scenario i, with its own arm: the rows up to where it got. What was not asked for is nan."""
        i = range(len(self))[i]
        setup = self.variation.scenario(i)
        n = int((self.t <= self.reached[i] + 1e-9 * (self.t[-1] - self.t[0])).sum())
        held = {k: getattr(self, k) for k in OUTPUTS}
        sizes = {k: setup.arm.nq if k == "q" else setup.arm.nv for k in OUTPUTS}
        arrays: dict[str, Any] = {
            k: np.full((n, sizes[k]), np.nan) if x is None else np.array(x[i, :n]) for k, x in held.items()
        }
        return Result(setup.arm, self.t[:n], **arrays, loads=setup.loads)

    def map(self, f: Callable[[Result], Any]) -> Array:
        """f(result) of every scenario, such as `lambda r: r.tip_deflection()[-1]`, (B, ...)."""
        return np.array([f(self[i]) for i in range(len(self))])

    def save(self, path: str | Path) -> None:
        """Writes times, arrays, status and parameters to one file (.npz), for NumPy to read."""
        kept: dict[str, Any] = {k: getattr(self, k) for k in OUTPUTS if getattr(self, k) is not None}
        kept |= {f"parameters/{k}": v for k, v in self.variation.values.items()}
        with Path(path).open("wb") as f:  # an open file keeps its name; numpy would append .npz
            np.savez_compressed(f, t=self.t, status=self.status, reached=self.reached, **kept)


def batch_memory(arm: Arm, scenarios: int, rows: int, outputs: Sequence[str] = ("q", "v")) -> int:
    """Bytes of a batch's result: 8 B nt (nq + nv) for q and v. Beside it each worker takes some 100 kB, and, where
    parameters change the arm, a thousand arms at a time are held."""
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
            if None. "implicit" and "rk4" run wholly in the core, with drives and continuous control whose samples fall
            on ends of steps. Loads, dry friction, sampled control, and "ida" and "gauss" take one `simulate` for each
            scenario. `stats["engine"]` says which.
        outputs: which of "q", "v", "a", "tau". every: times of t between two rows of the result.
        workers: threads; None: one for each core.
        progress: shows a bar on stderr, where that is a terminal; or a callable, which is given the share done about
            ten times a second, and may raise to give up.
        out: arrays by name that the result is written into; or a file ("sweep.h5", extra "batch"), written as the
            scenarios are done: the same call again does what is missing, whatever stopped it. Another batch's file is
            refused.
        resume: whether to go on with such a file; if not, it is written over.
        executor: not there yet.
        batch: scenarios at once; None: 1024 where arms differ, and what 64 MB hold where there is a file.

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

    def _chunk(self, default: int) -> int:
        if self.batch is None:
            return default
        if whole("batch", self.batch) < 1:
            raise ValueError(f"batch = {self.batch}: must be at least 1")
        return self.batch

    def _run(self, indices: NDArray[np.int64], blocks: Mapping[str, Any], alive: Any) -> tuple[list[Failure], bool]:
        failures, stats = self.job.run(self.engine, indices, blocks, self.workers, alive)
        interrupted = bool(stats.pop("interrupted"))
        for k, n in stats.items():
            self.stats[k] = max(self.stats.get(k, 0), n) if k == "workers" else self.stats.get(k, 0) + n
        if self.engine == "steps" and "q" in blocks:
            self._check_range(indices, blocks["q"])
        return failures, interrupted

    def _check_range(self, indices: NDArray[np.int64], q: Array) -> None:
        """Looks for beams bent beyond their order's range; the first is told of."""
        variation, t = self.job.variation, self.job.t[:: self.job.every]
        alike = not variation.varies_arm
        if alike:  # a look at all at once, which mostly is enough
            arm, flat = variation.setup.arm, np.nan_to_num(q).reshape(-1, q.shape[2])
            if out_of_range(arm, np.zeros(len(flat)), flat) is None:
                return
        for k, i in enumerate(indices.tolist()):
            arm = variation.setup.arm if alike else variation.scenario(i).arm
            here = ~np.isnan(q[k, :, 0])
            found = out_of_range(arm, t[here], q[k, here])
            if found is not None:
                self.out_of_range += 1
                if self.beyond is None:
                    told = (found.link, found.time, found.rotation, found.limit)
                    self.beyond = RangeWarning(f"scenario {i}: {found}", *told)

    def _chunks(self, indices: NDArray[np.int64], size: int) -> list[NDArray[np.int64]]:
        return [indices[k : k + size] for k in range(0, len(indices), size)]

    def in_memory(self, out: Mapping[str, Array] | None, progress: Any) -> tuple[BatchResult, bool]:
        job, n = self.job, self.count
        blocks: dict[str, Any] = prepared(out, {k: (n, job.rows, size) for k, size in job.sizes().items()})
        blocks["status"], blocks["reached"] = np.full(n, NOT_DONE, np.int32), np.full(n, job.t[0])
        failures: list[Failure] = []
        interrupted, done = False, 0
        with show_progress(progress, "simulating") as show:
            for part in self._chunks(np.arange(n), self._chunk(n if job.variation.one_setup else _CHUNK)):
                here = {k: x[part[0] : part[-1] + 1] for k, x in blocks.items()}
                if interrupted:
                    for k in job.outputs:
                        here[k][:] = np.nan
                    continue
                found, interrupted = self._run(part, here, _scaled(show, done / n, len(part) / n))
                failures += found
                done += len(part)
        return self._result(blocks, failures), interrupted

    def in_file(self, path: Path, resume: bool, progress: Any) -> tuple[BatchResult, bool]:
        job, n = self.job, self.count
        row = max(1, batch_memory(job.variation.setup.arm, 1, job.rows, job.outputs))
        file = BatchFile(path, job, n, resume)
        interrupted = False
        try:
            missing = file.missing()
            done = n - len(missing)
            self.stats["resumed"] = done
            size = self._chunk(int(np.clip(_CHUNK_BYTES // row, self.workers, _CHUNK)))
            with show_progress(progress, "simulating") as show:
                for part in self._chunks(missing, size):
                    shape = {k: (len(part), job.rows, width) for k, width in job.sizes().items()}
                    blocks: dict[str, Any] = {k: np.empty(s) for k, s in shape.items()}
                    blocks["status"], blocks["reached"] = np.empty(len(part), np.int32), np.empty(len(part))
                    found, interrupted = self._run(part, blocks, _scaled(show, done / n, len(part) / n))
                    whole = blocks["status"] != NOT_DONE
                    file.write(part[whole], {k: x[whole] for k, x in blocks.items()}, found)
                    done += len(part)
                    if interrupted:
                        break
        finally:
            left = file.missing()
            held, failures = file.close()
        held["status"][left], held["reached"][left] = NOT_DONE, job.t[0]
        return self._result(held, failures), interrupted

    def _result(self, held: Mapping[str, Any], failures: list[Failure]) -> BatchResult:
        job = self.job
        arrays = {k: held.get(k) for k in OUTPUTS}
        stats = {**self.stats, **({"out_of_range": self.out_of_range} if self.out_of_range else {})}
        return BatchResult(job.t[:: job.every], **arrays, status=held["status"], reached=held["reached"],
                           variation=job.variation, failures=failures, stats=stats)  # fmt: skip


def _scaled(show: Any, first: float, share: float) -> Any:
    return None if show is None else lambda part: show(first + share * part)
