"""A batch in shares, each computed by a worker of a concurrent.futures.Executor, again if its worker dies."""

import pickle
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from concurrent.futures.process import ProcessPoolExecutor
from typing import Any

RETRIES = 3
_AHEAD = 64  # shares in flight if the number of workers is not known


class Workers:
    """An executor, and another like it when its processes died and it can take no more work.

    Args:
        executor: any Executor, or a callable that makes one. One that was made here is shut down by `close`. A broken
            ProcessPoolExecutor is replaced by one with the same settings; other executors that break (dask's and
            mpi4py's replace their workers themselves) need the callable.
    """

    def __init__(self, executor: Executor | Callable[[], Executor]) -> None:
        self._make = None if isinstance(executor, Executor) else executor
        if self._make is not None and not callable(self._make):
            raise ValueError(
                f"executor = {executor!r}: must be a concurrent.futures.Executor, or a callable that makes one"
            )
        self.generation = 0
        self._own: Executor | None = None
        self.now = executor if isinstance(executor, Executor) else self._made()

    def _made(self) -> Executor:
        assert self._make is not None
        made = self._make()
        if not isinstance(made, Executor):
            raise ValueError(f"executor: the callable gave {made!r}, which is no concurrent.futures.Executor")
        self._own = made
        return made

    @property
    def ahead(self) -> int:
        """Number of shares in flight: enough to keep all workers busy, few enough to bound memory."""
        known = getattr(self.now, "_max_workers", None)
        return 2 * known if isinstance(known, int) and known > 0 else _AHEAD

    def renew(self, cause: BaseException) -> None:
        """Replaces a broken executor. Raises the cause again if none can be made."""
        broken = self.now
        if self._make is None and type(broken) is ProcessPoolExecutor:
            # the standard library's own fields, unchanged from Python 3.7 on
            kept = {k: getattr(broken, f"_{k}", None) for k in ("mp_context", "initializer")}
            workers, args = getattr(broken, "_max_workers", None), getattr(broken, "_initargs", ())
            self._make = lambda: ProcessPoolExecutor(workers, initargs=args, **kept)
        if self._make is None:
            raise RuntimeError(
                f"executor: {type(broken).__name__} broke ({cause}) and takes no more work; give a callable that makes "
                "one, and lost shares are computed again"
            ) from cause
        if self._own is not None:
            self._own.shutdown(wait=False)
        self.now = self._made()
        self.generation += 1

    def close(self) -> None:
        """Shuts down an executor that was made here."""
        if self._own is not None:
            self._own.shutdown(wait=True, cancel_futures=True)


def _work(attempt: int, function: Callable[..., Any], arguments: dict[str, Any]) -> Any:
    """Calls the function, in a worker. A scheduler that knows tasks by their content, as dask's does, takes another
    attempt for another task."""
    return function(**arguments)


def _lost(error: BaseException) -> bool:
    """Whether the worker of a share died; other errors are the share's own."""
    return isinstance(error, (BrokenExecutor, CancelledError)) or type(error).__name__ == "KilledWorker"


def _explained(error: BaseException) -> BaseException:
    """A clear error if the share could not be sent; else the error itself."""
    unsent = isinstance(error, pickle.PicklingError) or (
        isinstance(error, (AttributeError, TypeError)) and "pickle" in str(error).lower()
    )
    if not unsent:
        return error
    return ValueError(
        f"executor: its workers are other processes, and something of this batch cannot be sent there ({error}); "
        "instead of a lambda or a function inside a function take one of a module, or samples"
    )


def gather(
    function: Callable[..., Any],
    arguments: Callable[[Any], dict[str, Any]],
    parts: Sequence[Any],
    executor: Executor | Callable[[], Executor],
    again: Callable[[Any], None] = lambda part: None,
) -> Iterator[tuple[Any, Any]]:
    """Yields each part (a range or an array of indices) with function(**arguments(part)), as they get done: each once,
    in any order.

    A part whose worker died (a broken pool, a cancelled future, dask's KilledWorker) is sent again, up to
    three times, and `again` is told.

    Raises:
        ValueError: no executor; or something that cannot be pickled.
        RuntimeError: a part was lost each time, or its executor cannot take more work.
        Whatever function raised.
    """
    workers = Workers(executor)
    tries, waiting = [0] * len(parts), deque(range(len(parts)))
    running: dict[Future[Any], tuple[int, int]] = {}

    def lose(k: int, generation: int, error: BaseException) -> None:
        tries[k] += 1
        waiting.appendleft(k)
        if tries[k] > RETRIES:
            of = f"scenarios {parts[k][0]} to {parts[k][-1]}"
            raise RuntimeError(f"executor: the workers that computed {of} died {tries[k]} times ({error})") from error
        again(parts[k])
        if isinstance(error, BrokenExecutor) and generation == workers.generation:
            workers.renew(error)

    try:
        while waiting or running:
            while waiting and len(running) < workers.ahead:
                k = waiting.popleft()
                try:
                    future = workers.now.submit(_work, tries[k], function, arguments(parts[k]))
                except BrokenExecutor as e:
                    lose(k, workers.generation, e)
                else:
                    running[future] = (k, workers.generation)
            for future in sorted(wait(running, return_when=FIRST_COMPLETED).done, key=lambda f: running[f]):
                k, generation = running.pop(future)
                try:
                    found = future.result()
                except BaseException as e:
                    if not _lost(e):
                        raise _explained(e) from e
                    lose(k, generation, e)
                else:
                    yield parts[k], found
    finally:
        for future in running:
            future.cancel()
        workers.close()
