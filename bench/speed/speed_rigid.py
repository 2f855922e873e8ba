"""One evaluation against pinocchio's: forward dynamics, its derivatives, mass matrix and inverse dynamics of rigid
chains, and of flexible arms against pinocchio's rigid one.

    python bench/speed/speed_rigid.py [--runs 5] [-o DIR]

The programs of bench/speed/pinocchio_build.py run in turn.
Writes speed_rigid.csv, speed_rigid.png and its section of docs/speed.md (with -o only the files, into DIR).
"""

from __future__ import annotations

import argparse
import csv
import os
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
from pinocchio_build import FLAGS, RUNS, program
from speed_common import Figure, about, keep, ratio, table

RIGID = ("rigid 7", "rigid 20", "rigid 100")
FLEXIBLE = ("flexible 7 x (3+3+1)", "planar 2 x 3")
FUNCTIONS = {
    "forward dynamics": ("pinocchio aba (world)", "pinocchio aba (local)"),
    "inverse dynamics": ("pinocchio rnea",),
    "mass matrix": ("pinocchio crba (world)", "pinocchio crba (local)"),
    "derivatives": ("pinocchio computeABADerivatives",),
}
AIMED = {"forward dynamics": 0.35, "inverse dynamics": 0.5, "mass matrix": 0.8}
AIMS = [(scene, *aim) for scene in ("rigid 7", "rigid 100") for aim in AIMED.items()] + [
    ("rigid 7", "derivatives", 1.0)
]
Times = dict[tuple[str, str, str], np.ndarray]  # run, scene, function: ns of every round


def run(programs: dict[str, Path], runs: int) -> tuple[Times, list[str]]:
    """All programs in turn, `runs` times; and what they remark."""
    rounds: dict[tuple[str, str, str], list[float]] = {}
    remarks: list[str] = []
    for _ in range(runs):
        for name, (flags, isa) in RUNS.items():
            if flags not in programs:
                continue
            environment = {**os.environ, **({"FLEXARM_ISA": isa} if isa else {})}
            out = subprocess.run([programs[flags]], check=True, capture_output=True, text=True, env=environment)
            lines = out.stdout.splitlines()
            remarks = remarks or [x[2:] for x in lines if x.startswith("#")]
            for row in csv.DictReader(x for x in lines if not x.startswith("#")):
                rounds.setdefault((name, row["scene"], row["function"]), []).append(float(row["ns"]))
    return {k: np.array(v) for k, v in rounds.items()}, remarks


def best_peer(times: Times, name: str, scene: str, function: str) -> np.ndarray:
    """Pinocchio's rounds, in whichever convention is faster here; for a flexible arm those of seven rigid links."""
    scene = scene if scene in RIGID else "rigid 7"
    return min((times[name, scene, f] for f in FUNCTIONS[function]), key=lambda x: float(np.median(x)))


def against(times: Times, name: str, scene: str, function: str) -> float:
    """Median over the rounds of flexarm's time over pinocchio's."""
    return float(np.median(times[name, scene, f"flexarm {function}"] / best_peer(times, name, scene, function)))


def page(times: Times, remarks: list[str]) -> str:
    rows: list[list[Any]] = []
    runs = [name for name in RUNS if any(k[0] == name for k in times)]
    for scene in (*RIGID, *FLEXIBLE):
        for function in FUNCTIONS:
            row: list[Any] = [scene, function]
            for name in runs:
                other = float(np.median(best_peer(times, name, scene, function))) if scene in RIGID else None
                mine = float(np.median(times[name, scene, f"flexarm {function}"]))
                row += [mine, other, against(times, name, scene, function)]
            rows.append(row)
    head = ["scene", "function"]
    for name in runs:
        head += [f"flexarm {name} (ns)", "pinocchio (ns)", "ratio"]
    aims, hardest = [], {"-O3", "-march=native"} <= set(runs)
    last = ["flexarm -O3, pinocchio -march=native"] if hardest else []
    of_last = " The last column is the hardest test: flexarm as shipped, pinocchio compiled for this processor."
    flags = "" if hardest else " --flags " + RUNS[runs[0]][0]
    for scene, function, aim in AIMS:
        found = [against(times, name, scene, function) for name in runs]
        if hardest:
            shipped = times["-O3", scene, f"flexarm {function}"]
            found.append(float(np.median(shipped) / np.median(best_peer(times, "-march=native", scene, function))))
        aims.append([f"{scene}: {function}", *(ratio(x, aim, below=True) for x in found)])
    version = next((x.split()[1].rstrip(",") for x in remarks if x.startswith("pinocchio")), "")
    compiler = next((x.split(", ", 1)[1] for x in remarks if x.startswith("pinocchio")), "")
    return f"""
One evaluation, median of the CPU time, one thread. A ratio is the median over the rounds of the ratio of both programs'
times in the same round. Both programs are compiled with the same flags. flexarm's kernels choose their instruction set
at run time, whatever the flags (in the columns AVX2 they are set to it), so -O3 alone does not mean the same for both.
Pinocchio's algorithms have two conventions; the faster one is shown. Its crba fills half of the matrix, and
computeABADerivatives half of the derivative by forces; flexarm's mass matrix is complete. Derivatives are of forward
dynamics by q, v and forces; flexarm's include the acceleration. Flexible arms (order 2) are compared with pinocchio's
*rigid* chain of 7.

{table(head, rows)}

Aims.{of_last if hardest else ""}

{table(["", *(f"both {name}" for name in runs), *last], aims)}

{chr(10).join(f"- {x}" for x in remarks if x.startswith("rigid"))}

![Time of one evaluation](figures/speed_rigid.png)

Measured by `python bench/speed/speed_rigid.py{flags}` ({about(pinocchio=version, compiler=compiler)}).
"""


def draw(times: Times) -> Figure:
    figure = Figure(figsize=(9, 4.4), layout="constrained")
    names = [n for n in RUNS if n != "-O3, AVX2" and (n, RIGID[0], "flexarm forward dynamics") in times]
    axes = figure.subplots(1, len(names), sharey=True, squeeze=False)[0]
    scenes = (*RIGID, *FLEXIBLE)
    for ax, name in zip(axes, names, strict=True):
        x = np.arange(len(scenes))
        own = [np.median(times[name, s, "flexarm forward dynamics"]) for s in scenes]
        peer = [np.median(best_peer(times, name, s, "forward dynamics")) for s in scenes]
        ax.bar(x - 0.2, own, 0.4, label="flexarm", color="tab:blue")
        ax.bar(x[:3] + 0.2, peer[:3], 0.4, label="pinocchio aba, same chain", color="tab:orange")
        ax.bar(x[3:] + 0.2, peer[3:], 0.4, label="pinocchio aba, rigid 7", color="moccasin")
        for k in x:
            ax.annotate(f"{own[k] / peer[k]:.2g}×", (k - 0.2, own[k]), ha="center", va="bottom", fontsize=8)
        ax.set(yscale="log", title=name)
        ax.set_xticks(x, [s.replace(" x ", "×").replace(" ", "\n") for s in scenes], fontsize=8)
        ax.grid(axis="y", alpha=0.3)
    axes[0].set_ylabel("one forward dynamics (ns)")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8)
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--flags", default=",".join(FLAGS), help="of the builds: to compile pinocchio once takes half")
    parser.add_argument("-o", type=Path)
    options = parser.parse_args()
    times, remarks = run({flags: program(flags, "speed_rigid") for flags in options.flags.split(",")}, options.runs)
    rows = [
        {"run": run_, "scene": s, "function": name, "median_ns": f"{np.median(x):.6g}", "least_ns": f"{x.min():.6g}"}
        for (run_, s, name), x in times.items()
    ]
    keep("speed_rigid", page(times, remarks), rows, draw(times), options.o)


if __name__ == "__main__":
    main()
