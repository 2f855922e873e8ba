"""What a batch costs: against one `simulate` after the other, over threads, and before it begins.

    python bench/batch.py [-o DIR] [--docs] [--seconds 20]

Writes batch.csv and batch.png into DIR (default: here); with --docs into docs/figures, and the table of docs/batch.md.
All ways of a comparison take turns; medians.
"""

from __future__ import annotations

import argparse
import csv
import platform
import time
from collections.abc import Callable
from pathlib import Path

import flexarm as fa
import matplotlib
import numpy as np
from flexarm.rollout import default_workers
from flexarm.variation import Setup, Variation

matplotlib.use("Agg")
import matplotlib.pyplot as plt

ROOT = Path(__file__).resolve().parents[1]
STEEL = fa.Material(7850, 209e9, 0.3)
MARK = "<!-- measured by bench/batch.py -->"
Row = dict[str, float | str]


def planar_arm() -> fa.Arm:
    """Two links, three modes each."""
    beam = fa.Beam(0.5, fa.Rectangle(0.002, 0.02), STEEL, {"bending_y": 3}, damping_ratio=0.01)
    return fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(0.1), beam, fa.RigidBody(0.1)) for _ in range(2)])


def in_turn(ways: dict[str, Callable[[], object]], seconds: float) -> dict[str, float]:
    """Median seconds of each, all taking turns for so long."""
    times: dict[str, list[float]] = {name: [] for name in ways}
    end = time.perf_counter() + seconds
    while time.perf_counter() < end or len(next(iter(times.values()))) < 3:
        for name, way in ways.items():
            begun = time.perf_counter()
            way()
            times[name].append(time.perf_counter() - begun)
    return {name: float(np.median(x)) for name, x in times.items()}


def throughput(seconds: float) -> list[Row]:
    """Steps a second of 16 scenarios, by their length."""
    arm, rng, out = planar_arm(), np.random.default_rng(0), []
    q0 = np.zeros((16, arm.nq))
    q0[:, [1, 5]] = 0.005 * rng.normal(size=(16, 2))
    counts = [1 << k for k in range(w.bit_length())] if (w := default_workers(None)) else [1]
    for n in (1, 10, 100, 1000):
        t = 1e-3 * np.arange(n + 1)

        def singly(t: np.ndarray = t) -> None:
            for q in q0:
                fa.simulate(arm, t, q, integrator="implicit", step=1e-3)

        ways: dict[str, Callable[[], object]] = {"simulate": singly}
        for w in counts:
            ways[f"rollout, {w}"] = lambda n=n, w=w: fa.rollout(arm, q0, dt=1e-3, nstep=n, workers=w)
        ways[f"simulate_batch, {w}"] = lambda t=t, w=w: fa.simulate_batch(arm, t, q0, workers=w)
        for name, took in in_turn(ways, seconds / 4).items():
            out.append({"kind": "steps", "way": name, "n": n, "value": 16 * n / took})
    return out


def building() -> list[Row]:
    """Microseconds of one core for each scenario's arm, by what differs."""
    arm, count, out = planar_arm(), 200, []
    rng = np.random.default_rng(0)
    kinds = {
        "gravity": {"gravity": rng.normal(size=(count, 3))},
        "a tip's mass": {"link.1.tip.mass": rng.random(count)},
        "a beam's length": {"link.1.beam.length": 0.5 + rng.random(count)},
        "a beam's length, one of ten, and a tip's mass": {
            "link.1.beam.length": np.repeat(0.5 + rng.random(10), count // 10), "link.1.tip.mass": rng.random(count)
        },
    }  # fmt: skip
    for name, parameters in kinds.items():
        variation = Variation(Setup(arm), parameters)
        begun = time.process_time()
        variation.scenarios(range(count))
        out.append({"kind": "building", "way": name, "n": 1, "value": 1e6 * (time.process_time() - begun) / count})
    return out


def draw(rows: list[Row], path: Path) -> None:
    figure, axes = plt.subplots(figsize=(6.4, 4.4), layout="constrained")
    for way in dict.fromkeys(r["way"] for r in rows if r["kind"] == "steps"):
        mine = [(r["n"], r["value"]) for r in rows if r["kind"] == "steps" and r["way"] == way]
        label = f"{way} worker{'s' if not str(way).endswith(', 1') else ''}" if "," in str(way) else way
        axes.loglog(*zip(*mine, strict=True), "o-", ms=4, lw=1.2, label=label)
    axes.set(xlabel="steps of a scenario", ylabel="steps a second", title="16 scenarios of a two-link arm, 6 modes")
    axes.grid(alpha=0.3, which="both")
    axes.legend(fontsize=8)
    figure.savefig(path, dpi=100)


def page(rows: list[Row]) -> str:
    ways = list(dict.fromkeys(str(r["way"]) for r in rows if r["kind"] == "steps"))
    lengths = sorted({int(r["n"]) for r in rows if r["kind"] == "steps"})
    at = {(r["way"], r["n"]): float(r["value"]) for r in rows}
    lines = ["![Steps a second](figures/batch.png)", ""]
    lines += ["| steps of a scenario | " + " | ".join(ways) + " |", "| - " * (len(ways) + 1) + "|"]
    lines += [f"| {n} | " + " | ".join(f"{at[w, n]:.3g}" for w in ways) + " |" for n in lengths]
    lines += ["", "Steps a second; behind a comma the workers.", ""]
    lines += ["| what differs | µs of one core for each scenario's arm |", "| - | - |"]
    lines += [f"| {r['way']} | {float(r['value']):.0f} |" for r in rows if r["kind"] == "building"]
    lines += ["", f"{platform.machine()}, {default_workers(None)} cores."]
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", type=Path, default=Path(), metavar="DIR")
    parser.add_argument("--docs", action="store_true")
    parser.add_argument("--seconds", type=float, default=20.0)
    options = parser.parse_args()
    folder = ROOT / "docs/figures" if options.docs else options.o
    folder.mkdir(parents=True, exist_ok=True)
    rows = throughput(options.seconds) + building()
    with (folder / "batch.csv").open("w", newline="") as f:
        writer = csv.DictWriter(f, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    draw(rows, folder / "batch.png")
    print(page(rows))
    if options.docs:
        path = ROOT / "docs/batch.md"
        head = path.read_text(encoding="utf-8").partition(MARK)[0]
        path.write_text(f"{head}{MARK}\n\n{page(rows)}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
