"""Batches: runs against MuJoCo's, lanes and threads, and rods against SoRoMoX's.

    python bench/speed/speed_batch.py [--rounds 2] [--only mujoco,lanes,soromox] [-o DIR]

SoRoMoX (JAX) comes from PyPI into an environment under build/peers, made when missing; flexarm and MuJoCo (pip install
'flexarm[mjcf]') run in this interpreter. Each program runs in a process of its own (speed_mujoco.py, speed_soromox.py,
speed_flexarm.py), one after the other, `rounds` times in turn, and its best round counts. Writes speed_mujoco,
speed_lanes and speed_soromox (.csv and .png) and their sections of docs/speed.md (with -o only the files, into DIR).
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from peer_rods import RODS
from speed_common import ROOT, Figure, about, keep, python_of, ratio, table

NEEDS: dict[str, list[str]] = {"flexarm": [], "mujoco": [], "soromox": ["soromox"]}
ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMEXPR")}
TARGETS = (1e-2, 3e-3, 1e-3, 3e-4, 1e-4)  # m, of tip error
AIMED = "MuJoCo Euler"  # what the aim was set against
Row = dict[str, Any]


def ask(program: str, *arguments: str) -> list[Row]:
    """What a worker reports; none, and a word on stderr, where it cannot be had."""
    try:
        python = python_of(program, NEEDS[program])
    except subprocess.CalledProcessError:
        print(f"{program} cannot be installed", file=sys.stderr)
        return []
    command = [python, ROOT / "bench" / "speed" / f"speed_{program}.py", *arguments]
    with tempfile.TemporaryDirectory() as folder:  # MuJoCo writes a log where it stands
        out = subprocess.run(command, env={**os.environ, **ONE_THREAD}, cwd=folder, capture_output=True, text=True)
    if out.returncode:
        print(f"{program} failed: {out.stderr.strip()[-2000:]}", file=sys.stderr)
    return [json.loads(line) for line in out.stdout.splitlines() if line.startswith("{")]


def versions(rows: list[Row]) -> dict[str, str]:
    return {k: v for r in rows if r["kind"] == "versions" for k, v in r.items() if k != "kind"}


def distance(a: Any, b: Any) -> float:
    """Largest distance of two paths (m)."""
    return float(np.linalg.norm(np.asarray(a) - np.asarray(b), axis=1).max())


def best(rounds: list[Row], key: tuple[str, ...], fast: tuple[str, ...]) -> list[Row]:
    """Of rows alike in `key`, one with the largest of each of `fast`."""
    out: dict[tuple[Any, ...], Row] = {}
    for row in rounds:
        mine = out.setdefault(tuple(row.get(k) for k in key), dict(row))
        mine |= {k: max(mine[k], row[k]) for k in fast if k in row and k in mine}
    return list(out.values())


def fastest(rows: list[Row], error: float, column: str = "batch") -> Row | None:
    """The fastest run with at most this error."""
    good = [r for r in rows if r["error"] is not None and r["error"] <= error]
    return max(good, key=lambda r: r[column], default=None)


def mujoco_rows(rounds: int) -> tuple[list[Row], dict[str, str], str]:
    """Runs with errors, versions, and what the references say of each other."""
    asked = [*ask("flexarm", "truth"), *ask("mujoco", "--refined")]
    truth = next(r for r in asked if r["kind"] == "truth")
    raw = [r for _ in range(rounds) for w in (("mujoco",), ("flexarm", "mujoco")) for r in ask(*w)]
    runs = best([r for r in raw if r["kind"] == "run"], ("method", "setting"), ("batch", "scalar", "two"))
    for run in runs:
        path = run.pop("path")
        run["error"] = None if path is None else max(distance(path, truth["path"]), truth["converged"])
    coarse, fine = (np.array(r["path"]) for r in asked if r["kind"] == "refined")
    limit = fine + (fine - coarse) / 3  # the segments converge with the square of their number
    words = (
        f"The reference is flexarm's (order exact, 6 Legendre modes, Gauss's method), converged to "
        f"{truth['converged']:.1e} m. MuJoCo's\nchain of 10 segments with short steps (RK4) is "
        f"{distance(coarse, truth['path']):.1e} m from it, of 20 segments {distance(fine, truth['path']):.1e} m;\n"
        f"extrapolated in their number {distance(limit, truth['path']):.1e} m: this is the common limit."
    )
    return runs, versions(asked), words


def mujoco_page(runs: list[Row], found: dict[str, str], words: str) -> str:
    mine = [r for r in runs if r["method"].startswith("flexarm")]
    theirs = [r for r in runs if r["method"].startswith("MuJoCo")]
    rows = []
    for r in theirs:
        own = None if r["error"] is None else fastest(mine, r["error"])
        gain = own["batch"] / r["batch"] if own else None
        name = f"{own['method']}, {own['setting']}" if own else None
        values = [r.get(k) for k in ("error", "scalar", "batch", "two")]
        rows.append([r["method"], r["setting"], *values, name, own and own["error"], own and own["batch"], gain])
    head = ["MuJoCo", "setting", "tip error (m)", "`mj_step` from Python", "rollout", "rollout, 2 threads"]
    head += ["flexarm's fastest as accurate", "tip error (m)", "rollout", "ratio"]
    euler = [r for r in theirs if r["method"] == AIMED and r["error"] is not None]
    first = max(euler, key=lambda r: r["batch"])
    any_first = max((r for r in theirs if r["error"] is not None), key=lambda r: r["batch"])
    aims = []
    for name, r in (("Euler, its longest stable step here", first), (f"the fastest, {any_first['method']}", any_first)):
        own = fastest(mine, r["error"])
        aims.append(f"- against {name}: {ratio(own['batch'] / r['batch'] if own else float('nan'), 30, below=False)}")
    fronts = []
    for target in TARGETS:
        own, other = fastest(mine, target), fastest(theirs, target)
        gain = own["batch"] / other["batch"] if own and other else None
        cells = [f"{r['method']}, {r['setting']}" if r else "not reached" for r in (own, other)]
        speeds = [own and own["scalar"], own and own["batch"], own and own["two"], other and other["batch"]]
        fronts.append([f"{target:.0e}", cells[0], *speeds[:3], cells[1], speeds[3], gain])
    front_head = ["tip error (m)", "flexarm", "alone", "batch", "batch, 2 threads", "MuJoCo", "rollout", "ratio"]
    return f"""
Two flexible links driven by joint torques (case c of [work-precision](work-precision.md)), one second;
each of MuJoCo's links is ten rigid segments on hinges with springs. Speeds are simulated seconds in a second of one
core (CPU time), or with 2 threads in a second of the clock. A run that failed (–) has a step above its stability limit.
Tip errors are the largest of 201 times (if flexarm's steps are longer than 5 ms, its states are interpolated).

{table(head, rows)}

At equal or smaller tip error, simulated seconds per core-second:

{chr(10).join(aims)}

{table(front_head, fronts)}

{words}

![Tip error against speed](figures/speed_mujoco.png)

Measured by `python bench/speed/speed_batch.py` ({about(**found)}).
"""


def mujoco_figure(runs: list[Row]) -> Figure:
    figure = Figure(figsize=(7, 4.6), layout="constrained")
    ax = figure.subplots()
    marks = dict(zip(sorted({r["method"] for r in runs}), "osD^vP*X", strict=False))
    colours = {"flexarm implicit": "tab:blue", "flexarm rk4": "tab:cyan"}
    for name, mark in marks.items():
        good = [r for r in runs if r["method"] == name and r["error"] is not None]
        colour = colours.get(name) or {"E": "tab:red", "i": "tab:orange", "R": "tab:olive", "d": "tab:green"}[name[7]]
        label = f"{name}{' (batch)' if name.startswith('flexarm') else ' (rollout)'}"
        ax.loglog([r["batch"] for r in good], [r["error"] for r in good], mark, ms=5, color=colour, label=label)
        if name.startswith("flexarm"):
            ax.loglog([r["scalar"] for r in good], [r["error"] for r in good], mark, ms=5, mfc="none", color=colour)
    ax.set(xlabel="simulated seconds per core-second", ylabel="largest tip error (m)")
    ax.set_title("Two flexible links; hollow: flexarm, one scenario at a time", fontsize=10)
    ax.grid(alpha=0.3)
    ax.legend(fontsize=8)
    return figure


def lanes_rows(rounds: int) -> tuple[list[Row], list[Row], dict[str, str]]:
    """Times of batches from small to large; scalar against lanes and one thread against two; versions."""
    raw = [r for _ in range(rounds) for r in ask("flexarm", "lanes")]
    batches: dict[tuple[Any, ...], Row] = {}
    threads: dict[tuple[Any, ...], Row] = {}
    for row in raw:
        if row["kind"] == "lanes":
            mine = batches.setdefault((row["scene"], row["integrator"], row["count"]), row)
            mine["us"] = min(mine["us"], row["us"])
        elif row["kind"] == "threads":
            mine = threads.setdefault((row["scene"], row["integrator"]), row)
            mine |= {k: min(mine[k], row[k]) for k in ("scalar_us", "one_s", "two_s")}
    return list(batches.values()), list(threads.values()), versions(raw)


def crossover(rows: list[Row], scalar: float) -> str:
    """From how many scenarios on a batch is faster than scenarios one by one, by a tenth at least."""
    first = None
    for row in reversed(rows):
        if row["us"] >= 0.9 * scalar:
            break
        first = row["count"]
    return "never" if first is None else str(first)


def lanes_page(batches: list[Row], threads: list[Row], found: dict[str, str]) -> str:
    counts = sorted({r["count"] for r in batches})
    rows = []
    for t in threads:
        mine = [r for r in batches if (r["scene"], r["integrator"]) == (t["scene"], t["integrator"])]
        times = {r["count"]: r["us"] for r in mine}
        gain = t["scalar_us"] / min(times.values())
        cells = [times.get(c) for c in counts]
        rows.append(
            [
                t["scene"],
                t["integrator"],
                t["scalar_us"],
                *cells,
                gain,
                crossover(mine, t["scalar_us"]),
                t["one_s"] / t["two_s"],
            ]
        )
    lanes = max(r["lanes"] or 1 for r in batches)
    head = ["scene", "integrator", "one by one (µs)", *(f"{c}" for c in counts)]
    head += ["lanes gain (aim ≥ 5 on AVX-512, 3.5 on AVX2)", "lanes pay from", "two threads (aim ≥ 1.9)"]
    return f"""
CPU time of one step of one scenario, in µs, in batches of 1 to {max(counts)} on one thread. "One by one" is
without lanes. "Two threads" is the clock's time with one thread divided by that with two, for a batch of 64; it is
meaningful only if both cores are idle. Lanes: {lanes}.

{table(head, rows)}

![Time of a step against the size of the batch](figures/speed_lanes.png)

Measured by `python bench/speed/speed_batch.py` ({about(**found)}).
"""


def lanes_figure(batches: list[Row], threads: list[Row]) -> Figure:
    figure = Figure(figsize=(9, 4), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    for ax, integrator in zip(axes, ("implicit", "rk4"), strict=True):
        for k, scene in enumerate(dict.fromkeys(r["scene"] for r in batches)):
            mine = [r for r in batches if (r["scene"], r["integrator"]) == (scene, integrator)]
            ax.loglog([r["count"] for r in mine], [r["us"] for r in mine], "o-", ms=4, color=f"C{k}", label=scene)
            for t in threads:
                if (t["scene"], t["integrator"]) == (scene, integrator):
                    ax.axhline(t["scalar_us"], color=f"C{k}", ls=":", lw=1)
        ax.set(title=integrator, xlabel="scenarios in the batch")
        ax.set_xticks([1, 2, 4, 8, 16, 32, 64], ["1", "2", "4", "8", "16", "32", "64"])
        ax.grid(alpha=0.3)
    axes[0].set_ylabel("one step of one scenario (µs of CPU)")
    axes[0].legend(fontsize=8, title="dotted: one by one, without lanes", title_fontsize=8)
    return figure


def soromox_rows(rounds: int) -> tuple[list[Row], dict[str, str]]:
    raw = [r for _ in range(rounds) for w in (("soromox",), ("flexarm", "rods")) for r in ask(*w)]
    out: dict[tuple[str, str], Row] = {}
    for row in raw:
        if row["kind"] == "rods":
            mine = out.setdefault((row["name"], row.get("order", "")), row)
            mine |= {k: min(mine[k], row[k]) for k in ("loop_us", "batch_us")}
    return list(out.values()), versions(raw)


def difference(a: list[float], b: list[float]) -> float:
    """Relative difference of two programs' accelerations."""
    return float(np.linalg.norm(np.subtract(a, b)) / np.linalg.norm(b))


def soromox_page(rods: list[Row], found: dict[str, str]) -> str:
    rows, aims = [], []
    for r in rods:
        theirs = next((x for x in rods if x["name"] == r["name"] and "order" not in x), None)
        program = f"flexarm, order {r['order']}" if "order" in r else "SoRoMoX"
        gains = [None, None, None]
        if theirs and "order" in r:
            gains = [theirs[k] / r[k] for k in ("loop_us", "batch_us")] + [difference(r["a"], theirs["a"])]
            if r["order"] == "exact" and r["name"] == RODS[0].name:  # SoRoMoX's own model
                for name, gain, aim in zip(("alone", "in a batch"), gains, (30.0, 50.0), strict=False):
                    aims.append(f"- {r['name']}, exact, {name}: {ratio(gain, aim, below=False)}")
        times = [r["loop_us"], r["batch_us"], 1e6 / r["batch_us"], r.get("rows_us")]
        rows.append([r["name"], program, r["coordinates"], *times, *gains])
    head = [
        "rods",
        "program",
        "coordinates",
        "alone (µs)",
        "in a batch (µs)",
        "per second of a core",
        "from Python (µs)",
    ]
    head += ["ratio alone", "ratio in a batch", "accelerations differ by"]
    missing = "" if any("order" not in r for r in rods) else "\n**SoRoMoX could not be installed or run here.**\n"
    return f"""
CPU time of one forward dynamics on one core, in µs. SoRoMoX runs in a loop compiled by JAX, and by `vmap` with a batch
of 64 or 512, whichever is faster. flexarm's times are stages of `rollout`'s rk4, without lanes (alone) and with them,
in a batch of 64, and rows of `forward_dynamics` called from Python.
SoRoMoX's rods have strains without truncation (order exact here), with the same Legendre polynomials, and the smallest
number of Gauss points with which its accelerations change by less than one per cent.
{missing}
{table(head, sorted(rows, key=lambda r: r[0], reverse=True))}

{chr(10).join(aims)}

![One forward dynamics of rods](figures/speed_soromox.png)

Measured by `python bench/speed/speed_batch.py` ({about(**found)}).
"""


def soromox_figure(rods: list[Row]) -> Figure:
    figure = Figure(figsize=(8, 3.6), layout="constrained")
    axes = figure.subplots(1, 2)
    for ax, name in zip(axes, dict.fromkeys(r["name"] for r in rods), strict=False):
        mine = [r for r in rods if r["name"] == name]
        x = np.arange(len(mine))
        for k, (column, label) in enumerate((("loop_us", "alone"), ("batch_us", "in a batch"))):
            bars = ax.bar(x + 0.4 * k - 0.2, [r[column] for r in mine], 0.4, label=label)
            ax.bar_label(bars, fmt="%.3g", fontsize=8)
        ax.set(yscale="log", title=name)
        ax.title.set_fontsize(9)
        ax.set_xticks(x, [f"flexarm,\norder {r['order']}" if "order" in r else "SoRoMoX" for r in mine], fontsize=8)
        ax.margins(y=0.15)
        ax.grid(axis="y", alpha=0.3)
    axes[0].set_ylabel("one forward dynamics (µs of CPU)")
    axes[0].legend(fontsize=8)
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--only", default="mujoco,lanes,soromox")
    parser.add_argument("-o", type=Path)
    options = parser.parse_args()
    only = options.only.split(",")
    if not set(only) <= {"mujoco", "lanes", "soromox"}:
        parser.error(f"--only {options.only}: must be of mujoco, lanes, soromox")
    if "mujoco" in only:
        runs, found, words = mujoco_rows(options.rounds)
        keep("speed_mujoco", mujoco_page(runs, found, words), runs, mujoco_figure(runs), options.o)
    if "lanes" in only:
        batches, threads, found = lanes_rows(options.rounds)
        keep(
            "speed_lanes",
            lanes_page(batches, threads, found),
            batches + threads,
            lanes_figure(batches, threads),
            options.o,
        )
    if "soromox" in only:
        rods, found = soromox_rows(options.rounds)
        slim = [{k: v for k, v in r.items() if k != "a"} for r in rods]
        keep("speed_soromox", soromox_page(rods, found), slim, soromox_figure(rods), options.o)


if __name__ == "__main__":
    main()
