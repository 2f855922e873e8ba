"""Threads that a process does not wait for when it ends, as it does for those of concurrent.futures."""

import os
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import TypeVar

T = TypeVar("T")

_LOOK = 0.1  # s


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def each(
    work: Callable[[int], None],
    count: int,
    workers: int,
    look: Callable[[], None] = lambda: None,
    stop: Callable[[], None] = lambda: None,
) -> None:
    """work(0) ... work(count - 1), each once, and look() about ten times a second in this thread. After an exception in
    one of them nothing more is begun, and `stop` is called; it is raised when all threads have ended."""
    numbers, change = iter(range(count)), threading.Condition()
    busy = over = 0
    failed: list[BaseException] = []

    def give_up(error: BaseException) -> None:
        failed.append(error)
        stop()

    def run() -> None:
        nonlocal busy, over
        with change:
            busy += 1
        try:
            while not failed:
                with change:
                    k = next(numbers, None)
                if k is None:
                    break
                work(k)
        except BaseException as e:
            give_up(e)
        with change:
            busy, over = busy - 1, over + 1
            change.notify()

    threads = [threading.Thread(target=run, daemon=True) for _ in range(min(workers, count))]

    def ended() -> bool:
        with change:
            return change.wait_for(lambda: over == len(threads), _LOOK)

    try:
        for thread in threads:
            thread.start()
        while not ended():
            look()
    except BaseException as e:
        give_up(e)
    with change:  # not Thread.join: interrupted once, it takes threads that run for ended ones (Python up to 3.12)
        change.wait_for(lambda: not busy)
    if failed:
        raise failed[0]


def later(work: Callable[[], T]) -> Future[T]:
    """The future result of work(), which runs in a thread of its own."""
    future: Future[T] = Future()

    def run() -> None:
        try:
            future.set_result(work())
        except BaseException as e:
            future.set_exception(e)

    threading.Thread(target=run, daemon=True).start()
    return future
