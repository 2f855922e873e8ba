"""The README's picture: runs the README's first Python block and draws what it has simulated.

    python bench/data/readme.py [-o FILE]

Left the arm, every tenth of a second, and where a rigid arm would be; right how far the links' ends are bent away.
Writes docs/figures/two-links.png.
"""

from __future__ import annotations

import argparse
import os
import re
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from flexarm.data.draw.style import BLUE, DPI, INK, RED, label_axes, new_figure
from matplotlib import colormaps
from matplotlib.axes import Axes

ROOT = Path(__file__).parents[2]
WIDTH, HEIGHT = 8.3, 4.0  # inches; a page shows them at about 100 points an inch
APART = 0.1  # s, between two shapes
END = 0.6  # s, of the drives' motion


def simulate() -> dict[str, Any]:
    """The names that the README's first block leaves: `arm`, `run`, ..."""
    block = re.search(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    assert block
    names: dict[str, Any] = {}
    here = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)  # where it may write
        try:
            exec(block[1], names)
        finally:
            os.chdir(here)
    return names


def shape(arm: Any, q: np.ndarray) -> np.ndarray:
    """Points (n, 2) of the neutral axis in the plane of the motion (m)."""
    points = [
        arm.frame(q, link, x)[0][:2]
        for link, part in enumerate(arm.links)
        for x in np.linspace(0, part.beam.length, 25)
    ]
    return np.array(points)


def draw_arm(ax: Axes, arm: Any, run: Any) -> None:
    rows = [int(np.argmin(abs(run.t - at))) for at in np.arange(0, END + APART / 2, APART)]
    dark = colormaps["Blues"](np.linspace(0.35, 1.0, len(rows)))
    path = run.frame()[0][: rows[-1] + 1]
    ax.plot(path[:, 0], path[:, 1], color=RED, linewidth=1, label="its tip's path")
    stiff = run.q[rows[2]].copy()
    stiff[[k for k, name in enumerate(arm.coordinates) if "bending" in name]] = 0
    name = f"if it were rigid, {run.t[rows[2]]:.1f} s"
    ax.plot(*shape(arm, stiff).T, color=INK, linewidth=1, linestyle="--", label=name)
    for k, (row, colour) in enumerate(zip(rows, dark, strict=True)):
        points = shape(arm, run.q[row])
        name = f"arm, every {APART:g} s" if k == len(rows) - 1 else None
        ax.plot(*points.T, color=colour, linewidth=2.2, label=name)
        ax.plot(*points[[25, -1]].T, "o", color=colour, markersize=5)
        if k in (0, 2, len(rows) - 1):
            right = k == 0
            ax.annotate(f"{run.t[row]:.1f} s", points[-1], (0, 7) if right else (6, 4), textcoords="offset points",
                        fontsize=9, ha="center" if right else "left", color=INK)  # fmt: skip
    ax.plot(0, 0, "s", color=INK, markersize=8)
    label_axes(ax, "y (m)", "x (m)")
    ax.set(xlim=(-0.12, 1.25), ylim=(-0.08, 1.12), aspect="equal")
    ax.legend(frameon=False, fontsize=9, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, columnspacing=1.0,
              handlelength=1.4)  # fmt: skip


def draw_bending(ax: Axes, run: Any) -> None:
    for link, colour, name in ((0, INK, "first link"), (1, BLUE, "second link")):
        ax.plot(run.t, 1000 * run.tip_deflection(link)[:, 1], color=colour, linewidth=1.5, label=name)
    ax.axvline(END, color="#999999", linewidth=1, linestyle=":")
    ax.annotate("joints stop", (END, 1), (4, -2), xycoords=("data", "axes fraction"), textcoords="offset points",
                fontsize=9, va="top", color=INK)  # fmt: skip
    label_axes(ax, "deflection of the end of a link (mm)", "time (s)")
    ax.set_xlim(run.t[0], run.t[-1])
    ax.legend(frameon=False, fontsize=9, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else None)
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs" / "figures" / "two-links.png")
    args = parser.parse_args()
    made = simulate()
    figure = new_figure(WIDTH, HEIGHT)
    left, right = figure.subplots(1, 2, width_ratios=(1.05, 1))
    draw_arm(left, made["arm"], made["run"])
    draw_bending(right, made["run"])
    figure.savefig(args.output, dpi=DPI)
    print(f"wrote {args.output}")


if __name__ == "__main__":
    main()
