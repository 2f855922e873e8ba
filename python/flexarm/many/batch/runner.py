"""Runs a batch chunk by chunk, in threads or in the workers of an executor."""

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, wait
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import _core
from ..._check import Array, at_least
from ..._threads import later
from ...arm.variation import Setup
from ...run.held import held
from .executor import gather
from .job import ENDED, FAILED, Job, renamed
from .problems import OVER, Failure, problems_of, run_problems
from .result import one_result
from .storage import File, Memory

CHUNK_BYTES = 1 << 26  # of a chunk: written to a file, or sent back by a worker, at once

_Done = tuple[NDArray[np.int64], dict[str, Any], list[Failure], bool]
_Kept = tuple[dict[str, Any], list[Failure], bool]


def run_steps(
    job: Job, setups: Sequence[Setup], indices: NDArray[np.int64], blocks: Mapping[str, Any], workers: int, alive: Any
) -> tuple[list[Failure], dict[str, Any]]:
    """Runs these scenarios, made of these setups, into their `Job.blocks`.

    Returns:
        The failures, and counts; counts["interrupted"] after Ctrl-C.
    """
    arms = [s.arm for s in setups]
    one = arms[0]
    for k, arm in enumerate(arms):
        if arm is not one and arm.coordinates != one.coordinates:
            raise ValueError(f"scenario {indices[k]}: its arm must have the same coordinates as the others")
    q0, v0, tau = (None if x is None else _taken(x, indices) for x in (job.q0, job.v0, job.tau))
    if q0 is not None:
        one.check_balls("q0", q0)
    acting = setups
    if job.balance == "held":
        acting = [held(s, float(job.t[0])).setup for s in setups]
    apart = not all(_core.in_kernels(job.integrator.name, arm._core) for arm in arms)
    problems = problems_of(acting, len(indices), job.t, job.events, indices, apart)
    prescribed = problems[0].prescribed
    for i in prescribed:
        for name, given, at in (("q0", q0, one.coordinate_of(i)), ("v0", v0, i)):
            value = np.array([p.start[name][at] for p in problems])
            if given is not None and (np.abs(given[:, at] - value) > 1e-9 * np.maximum(1.0, np.abs(value))).any():
                raise ValueError(f"{name}: disagrees with the motion of '{one.coordinates[i]}' at t = {job.t[0]}")
    if apart:  # errors are found in q and v, whether or not these are kept
        rows = len(job.t[:: job.every])
        blocks = {k: np.full((len(indices), rows, n), np.nan) for k, n in (("q", one.nq), ("v", one.nv))} | {**blocks}
    found, stats = run_problems(
        problems, setups, arms[:1] if all(arm is one for arm in arms) else arms, len(indices), job.every, q0, v0, tau,
        job.integrator, blocks, workers, alive, whole=job.whole, names=indices,
    )  # fmt: skip
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


@dataclass
class Runner:
    """Runs a batch, chunk by chunk, here or in the workers of an executor."""

    job: Job
    count: int  #: of its scenarios
    workers: int  #: threads
    batch: int | None = None  #: scenarios in a chunk, or None
    executor: Any = None  #: as of `simulate_batch`
    stats: dict[str, Any] = field(default_factory=dict)  #: counts of the run

    def __post_init__(self) -> None:
        if self.batch is not None:
            at_least("batch", self.batch, 1)

    def run(self, storage: Memory | File, show: Callable[[float], None] | None, within: bool = True) -> _Kept:
        """The stored arrays of all scenarios, the failures, and whether Ctrl-C came first.

        Args:
            show: called with the number of scenarios done after each chunk, and `within` it about ten times a second;
                or else at the beginning, too.
        """
        interrupted = False
        try:
            missing = storage.missing()
            done = self.count - len(missing)
            if isinstance(storage, File):
                self.stats |= {"resumed": done, **({"damaged": storage.damaged} if storage.damaged else {})}
            if show is not None and not within:
                show(done)
            size = self._size(storage)
            parts = [missing[k : k + size] for k in range(0, len(missing), size)]
            inside = show if within else None
            found = self._here(parts, storage, inside) if self.executor is None else self._elsewhere(parts)
            for part, blocks, failures, interrupted in found:
                storage.write(part, blocks, failures)
                done += len(part)
                if show is not None and not interrupted:
                    show(done)
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
        fit, most = max(1, CHUNK_BYTES // self.job.row_bytes), max(256, 16 * self.workers)  # arms held at once
        if self.executor is not None or self.job.summary is not None:
            few = 4 * self.workers if self.workers > 1 else 1
            return int(min(max(few, -(-self.count // 64)), max(fit, self.workers)))
        if isinstance(storage, File):
            return int(np.clip(fit, self.workers, most))
        return self.count if self.job.variation.one_setup else most

    def _add(self, stats: Mapping[str, int]) -> None:
        for k, n in stats.items():
            known = self.stats.get(k, 0)
            self.stats[k] = max(known, n) if k in ("workers", "lanes") else known + n

    def _here(self, parts: list[NDArray[np.int64]], storage: Memory | File, show: Any) -> Iterator[_Done]:
        """The parts one after the other, with their arrays, their failures, and whether Ctrl-C ended it there."""
        done = self.count - sum(map(len, parts))

        def waiting() -> None:
            if show is not None:
                show(done)

        for part, setups in self._made(parts, waiting):
            blocks, now = storage.blocks(part), _scaled(show, done, len(part))
            failures, stats = run_steps(self.job, setups, part, blocks, self.workers, now)
            interrupted = bool(stats.pop("interrupted"))
            self._add(stats)
            yield part, self._summed_up(setups, blocks), failures, interrupted
            if interrupted:
                return
            done += len(part)

    def _elsewhere(self, parts: list[NDArray[np.int64]]) -> Iterator[_Done]:
        """The same from the workers of an executor, in any order."""
        again: list[Any] = []

        def sent(part: NDArray[np.int64]) -> dict[str, Any]:
            return {"job": self.job.taken(part), "names": part, "workers": self.workers}

        for part, (blocks, failures, stats) in gather(run_share, sent, parts, self.executor, again=again.append):
            self._add(stats)
            self.stats["redone"] = len(again)
            yield part, blocks, [replace(f, index=int(part[f.index])) for f in failures], False

    def _made(
        self, parts: list[NDArray[np.int64]], waiting: Callable[[], None]
    ) -> Iterator[tuple[NDArray[np.int64], list[Setup]]]:
        """The parts with their setups, the next of which are built while one runs; `waiting` is called ten times a
        second until they are."""
        if self.job.variation.one_setup:
            yield from ((part, self.job.variation.scenarios(part)) for part in parts)
            return
        stop = threading.Event()

        def built(k: int) -> Future[list[Setup]] | None:
            if k == len(parts):
                return None
            return later(lambda: self.job.variation.scenarios(parts[k], self.workers, stop.is_set))

        coming = built(0)
        try:
            for k, part in enumerate(parts):
                assert coming is not None
                while not wait([coming], timeout=0.1).done:  # Ctrl-C comes through
                    waiting()
                setups, coming = coming.result(), built(k + 1)
                yield part, setups
        finally:
            stop.set()
            wait([coming] if coming else [])

    def _summed_up(self, setups: list[Setup], blocks: dict[str, Any]) -> dict[str, Any]:
        """The stored arrays of a chunk."""
        job = self.job
        if job.summary is None:
            return blocks
        arm, times = job.variation.setup.arm, job.t[:: job.every]
        found = job.summary(arm, blocks, lambda k: one_result(setups[k % len(setups)], times, blocks, k))
        return {**found, **{k: blocks[k] for k in ("status", "reached", "out_of_range", "wrong")}}


def _scaled(show: Any, first: float, share: float) -> Any:
    return None if show is None else lambda part: show(first + share * part)


def run_share(job: Job, names: NDArray[np.int64], workers: int) -> tuple[Any, ...]:
    """Runs a share of a batch, in a worker of an executor; `names` are the numbers of its scenarios in the whole batch.
    Returns the stored arrays, the failures, and counts."""
    runner = Runner(job, len(names), workers)
    try:
        held, failures, interrupted = runner.run(Memory(job, len(names)), None)
    except ValueError as e:
        raise ValueError(renamed(str(e), names)) from None
    if interrupted:
        raise KeyboardInterrupt
    return held, failures, runner.stats
