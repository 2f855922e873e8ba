"""Latency of one step of a 1 kHz loop: quantiles and histogram.

    cmake --preset release && cmake --build --preset release
    python bench/speed/latency.py [--steps 100000] [-o DIR] [--program build/release/bench_latency]

Writes speed_latency.csv, speed_latency.png and its section of docs/speed.md (with -o only the files, into DIR).
"""

from __future__ import annotations

import argparse
import csv
import subprocess
from pathlib import Path

from speed_common import ROOT, Figure, about, keep, ratio, table

CLOCKS = {"wall": "the clock's time", "thread": "the thread's own time"}
AIMED = "7 links of 3 + 3 + 1 modes"


def quantiles(rows: list[dict[str, str]], scene: str, clock: str) -> dict[float, float]:
    """Microseconds by probability."""
    mine = (r for r in rows if (r["scene"], r["clock"], r["kind"]) == (scene, clock, "quantile"))
    return {float(r["at"]): float(r["value"]) for r in mine}


def work(rows: list[dict[str, str]], scene: str) -> dict[int, tuple[int, float]]:
    """By iterations of a step: how many steps took so many, and their median in microseconds of the thread."""
    found = {k: {int(r["at"]): float(r["value"]) for r in rows if (r["scene"], r["kind"]) == (scene, k)}
             for k in ("steps", "median")}  # fmt: skip
    return {n: (int(steps), found["median"][n]) for n, steps in sorted(found["steps"].items())}


def by_work(of: dict[int, tuple[int, float]], p: float) -> float:
    """Quantile of the steps' times if each took the median of the steps with as many iterations."""
    at = p * sum(steps for steps, _ in of.values())
    for steps, median in of.values():
        at -= steps
        if at <= 0:
            return median
    raise ValueError(p)


def page(rows: list[dict[str, str]]) -> str:
    lines, iterations = [], []
    for scene in dict.fromkeys(r["scene"] for r in rows):
        for clock, name in CLOCKS.items():
            q = quantiles(rows, scene, clock)
            lines.append([scene, name, q[0.5], q[0.99], q[0.999], q[0.9999], q[1.0], q[0.999] / q[0.5]])
        of = work(rows, scene)
        all_steps, middle = sum(steps for steps, _ in of.values()), by_work(of, 0.5)
        iterations += [[scene, n, f"{100 * steps / all_steps:.3g} %", us, us / middle] for n, (steps, us) in of.items()]
    head = ["arm", "by", "median (µs)", "p99", "p99.9", "p99.99", "largest", "p99.9 / median"]
    aims = []
    for clock, name in CLOCKS.items():
        q = quantiles(rows, AIMED, clock)
        aims.append(f"- 7 flexible links, by {name}: p99.9 over the median {ratio(q[0.999] / q[0.5], 2, below=True)}")
    of = work(rows, AIMED)
    share = by_work(of, 0.999) / by_work(of, 0.5)
    aims.append(f"- 7 flexible links, by the work of a step alone: {ratio(share, 2, below=True)}")
    return f"""
Implicit steps of 1 ms, one after the other without sleep. Torques drive the joints, which have springs and dampers.
Other work on the machine disturbs the clock's time. The thread's own time excludes interruptions (reading it takes a
part of a microsecond). There is no real-time scheduling and no locked memory.

{table(head, lines)}

{chr(10).join(aims)}

The work of a step is that of its iterations. Beyond the slowest of these medians, the machine took the time (its
timer's interruptions count as the thread's):

{table(["arm", "iterations", "of the steps", "median of these (µs)", "over the median step"], iterations)}

![Latency of one step](figures/speed_latency.png)

Measured by `python bench/speed/latency.py` ({about()}).
"""


def draw(rows: list[dict[str, str]]) -> Figure:
    scenes = list(dict.fromkeys(r["scene"] for r in rows))
    figure = Figure(figsize=(9, 3.8), layout="constrained")
    for ax, scene in zip(figure.subplots(1, len(scenes), sharey=True), scenes, strict=True):
        for (clock, name), colour in zip(CLOCKS.items(), ("tab:blue", "tab:orange"), strict=True):
            bins = [r for r in rows if (r["scene"], r["clock"], r["kind"]) == (scene, clock, "bin")]
            edges, counts = [float(r["at"]) for r in bins], [float(r["value"]) for r in bins]
            median = quantiles(rows, scene, clock)[0.5]
            ax.loglog(edges, counts, ".-", lw=0.8, ms=4, color=colour, label=f"{name}: median {median:.3g} µs")
        for p, style in ((0.5, "-"), (0.999, "--")):
            ax.axvline(quantiles(rows, scene, "wall")[p], color="grey", ls=style, lw=0.8)
        ax.set(title=scene, xlabel="one step (µs); grey: median and p99.9 of the clock's")
        ax.grid(alpha=0.3)
        ax.legend(fontsize=8)
    figure.axes[0].set_ylabel("steps in a bin (5 % wide)")
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=100000)
    parser.add_argument("-o", type=Path)
    parser.add_argument("--program", type=Path, default=ROOT / "build/release/bench_latency")
    options = parser.parse_args()
    if not options.program.exists():
        parser.error(f"{options.program} is not there: cmake --preset release && cmake --build --preset release")
    command = [options.program, str(options.steps)]
    lines = subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()
    rows = list(csv.DictReader(lines))
    keep("speed_latency", page(rows), rows, draw(rows), options.o)


if __name__ == "__main__":
    main()
