"""Runs a batch chunk by chunk, in threads or in the workers of an executor."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, wait
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._check import whole
from ..._threads import later
from ...arm.variation import Setup
from .by_steps import run_steps
from .executor import gather
from .job import Job, renamed
from .result import one_result
from .rollout import Failure
from .storage import File, Memory

CHUNK_BYTES = 1 << 26  # what a file is written in, and what a worker sends back at once

_Done = tuple[NDArray[np.int64], dict[str, Any], list[Failure], bool]
_Kept = tuple[dict[str, Any], list[Failure], bool]


@dataclass
class Runner:
    """Runs a batch, chunk by chunk, here or in the workers of an executor.

    Attributes:
        job, count: the batch and its number of scenarios.
        workers: threads. batch: scenarios in a chunk, or None.
        executor: what `simulate_batch` takes.
        stats: what was counted.
    """

    job: Job
    count: int
    workers: int
    batch: int | None = None
    executor: Any = None
    stats: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.batch is not None and whole("batch", self.batch) < 1:
            raise ValueError(f"batch = {self.batch}: must be at least 1")

    def run(self, storage: Memory | File, show: Callable[[float], None] | None, within: bool = True) -> _Kept:
        """What is kept of all scenarios, what failed, and whether Ctrl-C came first. show: is told how many scenarios
        are done: within chunks too, about ten times a second, or else at the beginning and after each chunk."""
        interrupted = False
        try:
            missing = storage.missing()
            done = self.count - len(missing)
            if isinstance(storage, File):
                self.stats |= {"resumed": done, **({"damaged": storage.damaged} if storage.damaged else {})}
            alive = _paced(show, self.count) if within and self.executor is None else None
            told = alive or show
            if show is not None and not within:
                show(done)
            for part, blocks, failures, interrupted in self._done(missing, self._size(storage), storage, alive):
                storage.write(part, blocks, failures)
                done += len(part)
                if told is not None and not interrupted:
                    told(done)
        except KeyboardInterrupt:  # between two chunks
            interrupted = True
        except BaseException:
            storage.abandon()
            raise
        return (*storage.close(), interrupted)

    def _size(self, storage: Memory | File) -> int:
        """Scenarios in a chunk."""
        if self.batch is not None:
            return self.batch
        fit, most = max(1, CHUNK_BYTES // self.job.row_bytes), self._most()
        if self.executor is not None or self.job.summary is not None:
            few = 4 * self.workers if self.workers > 1 else 1
            return int(min(max(few, -(-self.count // 64)), max(fit, self.workers)))
        if isinstance(storage, File):
            return int(np.clip(fit, self.workers, most))
        return self.count if self.job.variation.one_setup else most

    def _most(self) -> int:
        """Scenarios whose arms are held at once."""
        return max(256, 16 * self.workers)

    def _add(self, stats: Mapping[str, int]) -> None:
        for k, n in stats.items():
            known = self.stats.get(k, 0)
            self.stats[k] = max(known, n) if k in ("workers", "lanes") else known + n

    def _done(self, indices: NDArray[np.int64], size: int, storage: Memory | File, alive: Any) -> Iterator[_Done]:
        """Pieces of the indices as they get done: what is kept of them, what failed, and whether Ctrl-C ended it there.
        In a worker elsewhere in any order, each once."""
        parts = [indices[k : k + size] for k in range(0, len(indices), size)]
        if self.executor is None:
            done = self.count - len(indices)
            for part, setups in self._made(parts, done, alive):
                blocks, now = storage.blocks(part), _scaled(alive, done, len(part))
                failures, stats = run_steps(self.job, setups, part, blocks, self.workers, now)
                interrupted = bool(stats.pop("interrupted"))
                self._add(stats)
                yield part, self._summed_up(setups, blocks), failures, interrupted
                done += len(part)
                if interrupted:
                    return
            return
        again: list[Any] = []
        for part, (blocks, failures, stats) in gather(run_share, self._sent, parts, self.executor, again=again.append):
            self._add(stats)
            self.stats["redone"] = len(again)
            yield part, blocks, [replace(f, index=int(part[f.index])) for f in failures], False

    def _made(
        self, parts: list[NDArray[np.int64]], done: int, alive: Any
    ) -> Iterator[tuple[NDArray[np.int64], list[Setup]]]:
        """The parts with what they are made of, the next being built while one runs."""
        if self.job.variation.one_setup:
            yield from ((part, self.job.variation.scenarios(part)) for part in parts)
            return
        stop = threading.Event()

        def built(k: int) -> Future[list[Setup]]:
            return later(lambda: self.job.variation.scenarios(parts[k], self.workers, stop.is_set))

        coming = built(0) if parts else None
        try:
            for k, part in enumerate(parts):
                assert coming is not None
                while not wait([coming], timeout=0.1).done:  # Ctrl-C comes through
                    if alive is not None:
                        alive(done)
                setups = coming.result()
                coming = built(k + 1) if k + 1 < len(parts) else None
                yield part, setups
                done += len(part)
        finally:
            stop.set()
            wait([coming] if coming else [])

    def _summed_up(self, setups: list[Setup], blocks: dict[str, Any]) -> dict[str, Any]:
        """What is kept of a chunk."""
        job = self.job
        if job.summary is None:
            return blocks
        arm, times = job.variation.setup.arm, job.t[:: job.every]
        found = job.summary(arm, blocks, lambda k: one_result(setups[k % len(setups)], times, blocks, k))
        return {**found, **{k: blocks[k] for k in ("status", "reached", "out_of_range", "wrong")}}

    def _sent(self, part: NDArray[np.int64]) -> dict[str, Any]:
        """What `run_share` is given of a part."""
        return {"job": self.job.taken(part), "names": part, "workers": self.workers}


def _paced(show: Callable[[float], None] | None, count: int) -> Callable[[float], None] | None:
    """show(done), but not more than about ten times a second; the end in any case."""
    if show is None:
        return None
    last = -np.inf

    def shown(done: float) -> None:
        nonlocal last
        now = time.perf_counter()
        if now - last > 0.08 or done >= count:
            last = now
            show(done)

    return shown


def _scaled(show: Any, first: float, share: float) -> Any:
    return None if show is None else lambda part: show(first + share * part)


def run_share(job: Job, names: NDArray[np.int64], workers: int) -> tuple[Any, ...]:
    """What a worker of an executor does with its share of a batch, whose scenarios have these names there: what is
    kept, what failed, and counts."""
    runner = Runner(job, len(names), workers)
    try:
        held, failures, interrupted = runner.run(Memory(job, len(names)), None)
    except ValueError as e:
        raise ValueError(renamed(str(e), names)) from None
    if interrupted:
        raise KeyboardInterrupt
    return held, failures, runner.stats
