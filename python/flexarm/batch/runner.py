"""Runs a batch chunk by chunk, into memory or into a file, in threads or in the workers of an executor."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, wait
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._check import Array, whole
from .._console import progress_bar
from .._threads import later
from ..analysis.validity import RangeWarning, range_warning, worst_range
from .file import BatchFile
from .job import Job
from .result import OUTPUTS, BatchResult
from .rollout import NOT_DONE, Failure, prepared
from .shares import gather
from .variation import Setup

CHUNK_BYTES = 1 << 26  # what a file is written in, and what a worker sends back at once

_Into = Callable[[NDArray[np.int64]], dict[str, Any]]
_Done = tuple[NDArray[np.int64], dict[str, Any], list[Failure], bool]


@dataclass
class Runner:
    """Runs a batch, chunk by chunk, here or in the workers of an executor.

    Attributes:
        job, count: the batch and its number of scenarios.
        engine: of `Job.engine`. workers: threads. batch: scenarios in a chunk, or None.
        executor: what `simulate_batch` takes.
        names: of the scenarios in the whole batch, where this is a share of one.
        stats: what was counted. beyond: (count, 4), what `worst_range` finds of each scenario, or nan.
    """

    job: Job
    count: int
    engine: str
    workers: int
    batch: int | None
    executor: Any = None
    names: Any = None
    stats: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.beyond: Array = np.full((self.count, 4), np.nan)

    def _most(self) -> int:
        """Scenarios whose arms are held at once."""
        return max(256, 16 * self.workers)

    def _share(self) -> int:
        """Scenarios in a share for a worker elsewhere."""
        return int(np.clip(-(-self.count // 64), 1, max(1, CHUNK_BYTES // self.job.row_bytes)))

    def _chunk(self, default: int) -> int:
        if self.batch is None:
            return default if self.executor is None else self._share()
        if whole("batch", self.batch) < 1:
            raise ValueError(f"batch = {self.batch}: must be at least 1")
        return self.batch

    def _run(
        self, indices: NDArray[np.int64], setups: list[Setup], blocks: Mapping[str, Any], alive: Any
    ) -> tuple[list[Failure], bool]:
        failures, stats = self.job.run(self.engine, setups, indices, blocks, self.workers, alive)
        interrupted, beyond = bool(stats.pop("interrupted")), stats.pop("beyond", None)
        self._add(stats)
        if beyond is not None:
            self.beyond[indices] = beyond
        elif "q" in blocks:
            self._check_range(indices, setups, blocks["q"])
        return failures, interrupted

    def _add(self, stats: Mapping[str, int]) -> None:
        for k, n in stats.items():
            known = self.stats.get(k, 0)
            self.stats[k] = max(known, n) if k in ("workers", "lanes") else known + n

    def _check_range(self, indices: NDArray[np.int64], setups: list[Setup], q: Array) -> None:
        """Looks for beams bent beyond their order's range."""
        variation, t = self.job.variation, self.job.t[:: self.job.every]
        alike = not variation.varies_arm
        if alike:  # a look at all at once, which mostly is enough
            arm, flat = variation.setup.arm, np.nan_to_num(q).reshape(-1, q.shape[2])
            if worst_range(arm, np.zeros(len(flat)), flat) is None:
                return
        for k, i in enumerate(indices.tolist()):
            here = ~np.isnan(q[k, :, 0])
            self.beyond[i] = worst_range(setups[k % len(setups)].arm, t[here], q[k, here]) or np.nan

    def warning(self) -> RangeWarning | None:
        """That of the first scenario that deserves one."""
        bad = np.flatnonzero(~np.isnan(self.beyond[:, 0]))
        if not bad.size:
            return None
        i = int(bad[0])
        return range_warning(self.job.variation.scenario(i).arm, self.beyond[i], f"scenario {i}: ")

    def _chunks(
        self, indices: NDArray[np.int64], size: int, show: Any
    ) -> Iterator[tuple[NDArray[np.int64], list[Setup]]]:
        """Pieces of the indices with what they are made of, the next being built while one runs."""
        parts = [indices[k : k + size] for k in range(0, len(indices), size)]
        if self.job.variation.one_setup:
            yield from ((part, self.job.variation.scenarios(part)) for part in parts)
            return
        stop, done = threading.Event(), self.count - len(indices)

        def built(k: int) -> Future[list[Setup]]:
            return later(lambda: self.job.variation.scenarios(parts[k], self.workers, stop.is_set))

        coming = built(0) if parts else None
        try:
            for k, part in enumerate(parts):
                assert coming is not None
                while not wait([coming], timeout=0.1).done:  # Ctrl-C comes through
                    if show is not None:
                        show(done / self.count)
                setups = coming.result()
                coming = built(k + 1) if k + 1 < len(parts) else None
                yield part, setups
                done += len(part)
        finally:
            stop.set()
            wait([coming] if coming else [])

    def _done(self, indices: NDArray[np.int64], size: int, into: _Into, show: Any) -> Iterator[_Done]:
        """Pieces of the indices as they get done: their blocks, what failed, and whether Ctrl-C ended it there. In a
        worker elsewhere in any order, each once."""
        done = self.count - len(indices)
        if self.executor is None:
            show = _paced(show)
            for part, setups in self._chunks(indices, size, show):
                blocks = into(part)
                share = len(part) / self.count
                failures, interrupted = self._run(part, setups, blocks, _scaled(show, done / self.count, share))
                done += len(part)
                yield part, blocks, failures, interrupted
                if interrupted:
                    return
                if show is not None:
                    show(done / self.count)
            return
        again: list[Any] = []
        parts = [indices[k : k + size] for k in range(0, len(indices), size)]
        for part, found in gather(run_share, self._sent, parts, self.executor, again=again.append):
            self._add(found["stats"])
            self.stats["redone"] = len(again)
            self.beyond[part] = found["beyond"]
            blocks = into(part)
            for k, block in found["blocks"].items():
                blocks[k][:] = block
            done += len(part)
            yield part, blocks, [replace(f, index=int(part[f.index])) for f in found["failures"]], False
            if show is not None:
                show(done / self.count)

    def _sent(self, part: NDArray[np.int64]) -> dict[str, Any]:
        """What `run_share` is given of a part."""
        return {"job": self.job.taken(part), "names": part, "engine": self.engine, "workers": self.workers}

    def in_memory(self, out: Mapping[str, Array] | None, progress: Any) -> tuple[BatchResult, bool]:
        """The result, and whether Ctrl-C came first."""
        job, n = self.job, self.count
        blocks: dict[str, Any] = prepared(out, {k: (n, job.rows, size) for k, size in job.sizes().items()})
        blocks["status"], blocks["reached"] = np.full(n, NOT_DONE, np.int32), np.full(n, job.t[0])
        if job.events:
            blocks["events"] = np.full(n, None)
        failures: list[Failure] = []
        interrupted, touched = False, np.zeros(n, bool)
        size = self._chunk(n if job.variation.one_setup else self._most())

        def into(part: NDArray[np.int64]) -> dict[str, Any]:
            return {k: x[part[0] : part[-1] + 1] for k, x in blocks.items()}

        with progress_bar(progress, "simulating") as show:
            try:
                for part, _, found, stopped in self._done(np.arange(n), size, into, show):
                    failures += found
                    touched[part], interrupted = True, stopped
            except KeyboardInterrupt:  # between two chunks
                interrupted = True
        for k in job.outputs:
            blocks[k][~touched] = np.nan
        return self._result(blocks, sorted(failures, key=lambda f: f.index)), interrupted

    def in_file(self, path: Path, resume: bool, progress: Any, name: str | None) -> tuple[BatchResult, bool]:
        """The result, mapped from the file, and whether Ctrl-C came first. name: see `marks`."""
        job, n = self.job, self.count
        size = self._chunk(int(np.clip(CHUNK_BYTES // job.row_bytes, self.workers, self._most())))
        file = BatchFile(path, job, n, resume, name)
        interrupted = False

        def into(part: NDArray[np.int64]) -> dict[str, Any]:
            blocks: dict[str, Any] = {k: np.empty((len(part), job.rows, w)) for k, w in job.sizes().items()}
            blocks |= {"events": np.full(len(part), None)} if job.events else {}
            return {**blocks, "status": np.empty(len(part), np.int32), "reached": np.empty(len(part))}

        try:
            missing = file.missing()
            self.stats["resumed"] = n - len(missing)
            if file.damaged:
                self.stats["damaged"] = file.damaged
            with progress_bar(progress, "simulating") as show:
                for part, blocks, found, stopped in self._done(missing, size, into, show):
                    whole, interrupted = blocks["status"] != NOT_DONE, stopped
                    done = part[whole]
                    file.write(done, {k: x[whole] for k, x in blocks.items()}, found, self.beyond[done])
        except KeyboardInterrupt:  # between two chunks
            interrupted = True
        except BaseException:
            file.abandon()
            raise
        held, failures = file.close()
        self.beyond = held["out_of_range"]  # of what was resumed too
        return self._result(held, failures), interrupted

    def _result(self, held: Mapping[str, Any], failures: list[Failure]) -> BatchResult:
        job = self.job
        arrays: dict[str, Any] = {k: held.get(k) for k in OUTPUTS}
        beyond = int((~np.isnan(self.beyond[:, 0])).sum())
        stats = {**self.stats, **({"out_of_range": beyond} if beyond else {})}
        return BatchResult(job.t[:: job.every], **arrays, status=held["status"], reached=held["reached"],
                           variation=job.variation, failures=failures, stats=stats,
                           events=held.get("events"))  # fmt: skip


def _paced(show: Any) -> Any:
    """show(share), but not more than about ten times a second; the end in any case."""
    last = -np.inf

    def shown(share: float) -> None:
        nonlocal last
        now = time.perf_counter()
        if now - last > 0.08 or share >= 1.0:
            last = now
            show(share)

    return None if show is None else shown


def _scaled(show: Any, first: float, share: float) -> Any:
    return None if show is None else lambda part: show(first + share * part)


def renamed(message: str, names: Any) -> str:
    """A message about a scenario of a share, with the number (of `names`) that it has in the whole batch."""
    return re.sub(r"^((?:parameters of )?scenario) (\d+):", lambda m: f"{m[1]} {names[int(m[2])]}:", message)


def run_share(job: Job, names: NDArray[np.int64], engine: str, workers: int) -> dict[str, Any]:
    """What a worker of an executor does with its share of a batch, whose scenarios have these names there."""
    runner = Runner(job, len(names), engine, workers, None, None, names)
    try:
        result, interrupted = runner.in_memory(None, None)
    except ValueError as e:
        raise ValueError(renamed(str(e), names)) from None
    if interrupted:
        raise KeyboardInterrupt
    more = ("events",) if job.events else ()
    blocks = {k: getattr(result, k) for k in (*job.outputs, "status", "reached", *more)}
    return {"blocks": blocks, "failures": result.failures, "stats": runner.stats, "beyond": runner.beyond}
