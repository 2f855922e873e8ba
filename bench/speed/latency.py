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


def page(rows: list[dict[str, str]], remarks: list[str]) -> str:
    lines = []
    for scene in dict.fromkeys(r["scene"] for r in rows):
        for clock, name in CLOCKS.items():
            q = quantiles(rows, scene, clock)
            lines.append([scene, name, q[0.5], q[0.99], q[0.999], q[0.9999], q[1.0], q[0.999] / q[0.5]])
    head = ["arm", "by", "median (µs)", "p99", "p99.9", "p99.99", "largest", "p99.9 / median"]
    aims = []
    for clock, name in CLOCKS.items():
        q = quantiles(rows, AIMED, clock)
        aims.append(f"- 7 flexible links, by {name}: p99.9 over the median {ratio(q[0.999] / q[0.5], 2, below=True)}")
    return f"""
Implicit steps of 1 ms, one after the other without sleep. Torques drive the joints, which have springs and dampers.
Other work on the machine disturbs the clock's time. The thread's own time excludes interruptions (reading it takes a
part of a microsecond). There is no real-time scheduling and no locked memory.

{table(head, lines)}

{chr(10).join(aims)}

{chr(10).join(f"- {x}" for x in remarks)}

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
    rows = list(csv.DictReader(x for x in lines if not x.startswith("#")))
    keep("speed_latency", page(rows, [x[2:] for x in lines if x.startswith("#")]), rows, draw(rows), options.o)


if __name__ == "__main__":
    main()
