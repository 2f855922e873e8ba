"""What the entries of the failure catalogue share: their register, axes, and the way to tests/stability."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from flexarm.data.draw.style import BLUE, GREEN, INK, ORANGE, PURPLE
from matplotlib.figure import Figure

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))

Rows = list[dict[str, object]]
Entry = tuple[Figure, Rows]
ENTRIES: dict[str, Callable[[], Entry]] = {}
ORDER = {0: ORANGE, 1: PURPLE, 2: BLUE, 3: GREEN, "exact": INK}


def entry(measure: Callable[[], Entry]) -> Callable[[], Entry]:
    ENTRIES[measure.__name__] = measure
    return measure


def panels(*labels: tuple[str, str], scales: str = "") -> tuple[Figure, list]:
    """Axes side by side with (x label, y label); `scales` has two letters for each: "i" linear or "o" logarithmic."""
    fig = Figure(figsize=({1: 5.6, 2: 8.4}.get(len(labels), 10.0), 3.4), layout="constrained")
    axes = fig.subplots(1, len(labels), squeeze=False)[0]
    for k, (ax, (x, y)) in enumerate(zip(axes, labels, strict=True)):
        ax.set_xlabel(x)
        ax.set_ylabel(y)
        if scales[2 * k : 2 * k + 1] == "o":
            ax.set_xscale("log")
        if scales[2 * k + 1 : 2 * k + 2] == "o":
            ax.set_yscale("log")
        ax.grid(True, color="#DDDDDD", linewidth=0.6)
        ax.spines[["top", "right"]].set_visible(False)
    return fig, list(axes)


def legend(ax, **how) -> None:
    ax.legend(**({"frameon": False, "fontsize": 8} | how))
