"""What benches share: their folder, the least of many times, the end of a figure, a table in a page."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray


def output_folder(description: str | None) -> Path:
    """The folder of the command line's `-o DIR` (here, by default), which is made."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", type=Path, default=Path(), metavar="DIR", help="folder to write into")
    out: Path = parser.parse_args().o
    out.mkdir(parents=True, exist_ok=True)
    return out


def fastest(jobs: list[Callable[[], Any]], rounds: int) -> NDArray[np.float64]:
    """Least time of each (s), one after the other in every round."""
    times = np.full((rounds, len(jobs)), np.inf)
    for row in times:
        for k, job in enumerate(jobs):
            began = perf_counter()
            job()
            row[k] = perf_counter() - began
    return np.asarray(times.min(axis=0))


def finish(figure: Any, path: Path, dpi: int = 110) -> None:
    """Grids on all axes, no frame above and on the right; saved and closed."""
    for ax in figure.axes:
        ax.grid(alpha=0.25)
        ax.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=dpi)
    plt.close(figure)


def replace_table(page: Path, mark: str, table: str) -> None:
    """Puts a table into a page, between the comments `<!-- mark: ... -->` and `<!-- end of mark -->`."""
    pattern = rf"(<!-- {mark}: [^\n]*-->\n).*?(<!-- end of {mark} -->)"
    text = page.read_text(encoding="utf-8")
    new, count = re.subn(pattern, lambda m: f"{m[1]}{table}\n{m[2]}", text, flags=re.S)
    if count != 1:
        raise SystemExit(f"{page}: the marks '{mark}' of the table are missing")
    page.write_text(new, encoding="utf-8")
