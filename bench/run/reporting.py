"""What the benches of this folder share: the least of many times, and the end of a figure."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray


def fastest(jobs: list[Callable[[], Any]], rounds: int) -> NDArray[np.float64]:
    """Least time of each (s), one after the other in every round."""
    times = np.full((rounds, len(jobs)), np.inf)
    for row in times:
        for k, job in enumerate(jobs):
            began = perf_counter()
            job()
            row[k] = perf_counter() - began
    return np.asarray(times.min(axis=0))


def finish(figure: Any, axes: Any, path: Path) -> None:
    """Grids on all axes, no frame above and on the right; saved and closed."""
    for ax in axes.flat:
        ax.grid(alpha=0.25)
        ax.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=110)
    plt.close(figure)
