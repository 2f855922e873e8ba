"""Output of programs: a line of complaint, a table, a progress bar, CSV and JSON."""

import contextlib
import csv
import io
import json
import math
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import IO, Any

from ._check import Array

_FIRST_LINE, _EACH_LINE = 10.0, 60.0  # s, of long work that no terminal shows


def open_streams() -> None:
    """Makes stdout and stderr take everything: a closed one (`>&-`) is None, and an ASCII one knows no Greek."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def drop(stream: IO[str]) -> None:
    """Drops output that cannot be written any more; Python would try again at its exit, and end with 120."""
    with contextlib.suppress(OSError, ValueError):
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, stream.fileno())
        os.close(null)


def complain(message: str) -> None:
    """Says one line on stderr."""
    line = " ".join(message.split())
    line = "flexarm: " + (line if len(line) <= 500 else f"{line[:300]} ... {line[-190:]}")
    try:
        print(line, file=sys.stderr, flush=True)
    except OSError:  # nobody listens; the exit code still tells
        drop(sys.stderr)


def aligned(rows: Sequence[Sequence[str]], right: Iterable[int] = ()) -> list[str]:
    """Lines of a plain table whose first row is its head; columns in `right` are flush right."""
    widths, right = [max(len(r[i]) for r in rows) for i in range(len(rows[0]))], frozenset(right)
    lines = []
    for r in rows:
        cells = [c.rjust(w) if i in right else c.ljust(w) for i, (c, w) in enumerate(zip(r, widths, strict=True))]
        lines.append("  ".join(cells).rstrip())
    lines.insert(1, "  ".join("-" * w for w in widths))
    return lines


def seconds(t: float) -> str:
    """A wall time, to three digits."""
    return f"{1e3 * t:.3g} ms" if t < 1 else f"{t:.3g} s"


# -- progress --------------------------------------------------------------------------------------------------------


@contextlib.contextmanager
def progress_bar(show: Any, name: str, total: float | None = 1.0) -> Iterator[Callable[..., None] | None]:
    """A bar on stderr, gone when done.

    Args:
        show: whether to show one; where stderr is no terminal, lines instead: the first after 10 s, then one a minute.
            A callable takes its place.
        name: stands before the bar. total: the value of `done` at the end; None: not known.

    Yields:
        (done, text="") -> None, which moves the bar to `done`, with a text beside it; None where nobody looks.
    """
    if callable(show):
        yield show
        return
    if not (show and sys.stderr):
        yield None
        return
    if not sys.stderr.isatty():
        yield _lines(name, total)
        return
    from rich.console import Console  # slow to import
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn(name), BarColumn(), TextColumn("{task.description}"), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=total)
        yield lambda done, text="": bar.update(task, completed=done, description=text)


def _lines(name: str, total: float | None) -> Callable[..., None]:
    """Now and then a line on stderr: the share that is done, the time it took, and about the time that is left."""
    began = time.monotonic()
    due = began + _FIRST_LINE

    def tell(done: float, text: str = "") -> None:
        nonlocal due
        now = time.monotonic()
        if now < due:
            return
        due = now + _EACH_LINE
        part = done / total if total else 0.0
        left = f", about {seconds((now - began) * (1 / part - 1))} left" if 0 < part <= 1 else ""
        share = f" {100 * part:.0f} %" if part else ""
        complain(f"{name}{share}{f' ({text})' if text else ''}: {seconds(now - began)} so far{left}")

    return tell


# -- files -----------------------------------------------------------------------------------------------------------


def output_folder(path: str) -> Path:
    """A folder that exists and can be written to; ValueError if not."""
    made = Path(path)
    try:
        made.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=made):
            pass
    except FileExistsError:
        raise ValueError(f"output folder {path!r}: is a file") from None
    except OSError as e:
        raise ValueError(f"output folder {path!r}: {e.strerror}") from None
    return made


def csv_text(header: Iterable[str], columns: Iterable[Array]) -> str:
    """Columns of numbers, all digits, under one header line."""
    f, header = io.StringIO(), list(header)
    out = csv.writer(f, lineterminator="\n")
    marked = any(";" in name for name in header)  # in quotes, a mark that may separate does not
    csv.writer(f, lineterminator="\n", quoting=csv.QUOTE_ALL if marked else csv.QUOTE_MINIMAL).writerow(header)
    out.writerows([repr(float(x)) for x in row] for row in zip(*columns, strict=True))
    return f.getvalue()


def write_csv(path: Path, header: Iterable[str], columns: Iterable[Array]) -> None:
    """The same in a file."""
    path.write_text(csv_text(header, columns), encoding="utf-8", newline="")


def finite(x: Any) -> Any:
    """The same structure, numbers that are not finite replaced by None."""
    if isinstance(x, dict):
        return {str(k): finite(v) for k, v in x.items()}
    if isinstance(x, (list, tuple)):
        return [finite(v) for v in x]
    return None if isinstance(x, float) and not math.isfinite(x) else x


def json_text(value: Any) -> str:
    """JSON; numbers that are not finite become null."""
    return json.dumps(finite(value), indent=1, allow_nan=False)
