"""What a batch costs: against one `simulate` after the other, over threads, and before it begins.

    python bench/many/batch.py [-o DIR] [--docs] [--seconds 20]

Writes batch.csv and batch.png into DIR (default: here); with --docs into docs/figures, and the table of docs/batch.md.
All ways of a comparison take turns; medians.
"""

from __future__ import annotations

import argparse
import csv
import platform
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import flexarm as fa
import matplotlib
import numpy as np
from flexarm.arm.variation import Setup, Variation
from flexarm.data.draw.style import PALETTE
from flexarm.many.batch.arguments import default_workers

matplotlib.use("Agg")
import matplotlib.pyplot as plt

ROOT = Path(__file__).resolve().parents[2]
STEEL = fa.Material(7850, 209e9, 0.3)
HOW = {"lanes": "side by side, in lanes", "core": "one by one, in the core", "simulate": "by `simulate`"}
MARK = "<!-- measured by bench/many/batch.py -->"
Row = dict[str, float | str]


def planar_arm() -> fa.Arm:
    """Two links, three modes each."""
    beam = fa.Beam(0.5, fa.Rectangle(0.002, 0.02), STEEL, {"bending_y": 3}, damping_ratio=0.01)
    return fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(0.1), beam, fa.RigidBody(0.1)) for _ in range(2)])


def in_turn(
    ways: dict[str, Callable[[], object]], seconds: float, clock: Callable[[], float] = time.perf_counter
) -> dict[str, float]:
    """Median seconds of each, all taking turns for so long."""
    times: dict[str, list[float]] = {name: [] for name in ways}
    end = time.perf_counter() + seconds
    while time.perf_counter() < end or len(next(iter(times.values()))) < 3:
        for name, way in ways.items():
            begun = clock()
            way()
            times[name].append(clock() - begun)
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
            ways[f"rollout, {w}"] = lambda n=n, w=w: fa.rollout(arm, q0, step=1e-3, nstep=n, workers=w)
        ways[f"simulate_batch, {w}"] = lambda t=t, w=w: fa.simulate_batch(arm, t, q0, workers=w)
        for name, took in in_turn(ways, seconds / 4).items():
            out.append({"kind": "steps", "way": name, "n": n, "value": 16 * n / took})
    return out


def kinds_of_scenarios() -> dict[str, tuple[fa.Arm, dict[str, Any]]]:
    """What may be in a scenario, as an arm and arguments of `simulate_batch`."""
    arm = planar_arm()
    first, second = arm.links
    rubs = fa.Arm([replace(first, joint=fa.Revolute("z", coulomb=0.02)), second])
    ball = fa.Arm([replace(first, joint=fa.Spherical()), second])
    bent = fa.Arm([replace(link, beam=replace(link.beam, order=3)) for link in arm.links])
    pd = {"kp": 0.5, "kv": 0.05}
    return {
        "starts that differ": (arm, {}),
        "parameters of the arm that differ": (arm, {"parameters": {"link.1.tip.mass": np.linspace(0.1, 0.2, 16)}}),
        "a motion, or a torque, by samples": (arm, {"drive": {0: fa.Motion.spin_up(1.0, 0.1)}}),
        "a torque, a function of time": (arm, {"drive": {0: fa.Torque(lambda t: 0.1 * np.sin(9 * t))}}),
        "PD, strain or state feedback": (arm, {"control": fa.PD(**pd)}),
        'integrator="rk4"': (arm, {"integrator": "rk4"}),
        "a load": (arm, {"loads": [fa.Load(force=(0, 0.1, 0), link=1)]}),
        "a ball joint": (ball, {}),
        "beams of order 3": (bent, {}),
        "dry friction": (rubs, {}),
        'dry friction, integrator="rk4"': (rubs, {"integrator": "rk4"}),
        "a law sampled each 10 ms, in Python": (
            arm, {"control": fa.Sampled(lambda t, y: [-0.5 * y[0]], 100.0, measure=[("joint", 0)], actuate=[0])}
        ),
        "events": (arm, {"events": lambda t, q, v: q[0] - 9.0}),
        'integrator="gauss", steps of 10 ms': (arm, {"integrator": "gauss", "step": 1e-2}),
        'integrator="ida"': (arm, {"integrator": "ida"}),
    }  # fmt: skip


def costs(seconds: float) -> list[Row]:
    """Of 16 scenarios of 0.2 s on one core, by what is in them: how they are run, and milliseconds for each."""
    t, ways, run = np.linspace(0, 0.2, 21), {}, {}
    for name, (arm, options) in kinds_of_scenarios().items():
        q0 = np.tile(arm.zero, (16, 1))
        q0[:, -3] = 0.005 * np.random.default_rng(0).normal(size=16)
        given = {"step": 1e-3, **options}
        if given.get("integrator") == "ida":
            given.pop("step")
        ways[name] = lambda arm=arm, q0=q0, given=given: fa.simulate_batch(arm, t, q0, workers=1, **given)
        stats = ways[name]().stats
        run[name] = "lanes" if stats["lanes"] > 1 else "core" if stats["lanes"] else "simulate"
    took = in_turn(ways, seconds, time.process_time)
    return [{"kind": run[name], "way": name, "n": 200, "value": 1e3 * took[name] / 16} for name in ways]


def building() -> list[Row]:
    """Microseconds of one core for each scenario's arm, by what differs."""
    arm, count, out = planar_arm(), 200, []
    rng = np.random.default_rng(0)
    kinds = {
        "gravity": {"gravity": rng.normal(size=(count, 3))},
        "a tip's mass": {"link.1.tip.mass": rng.random(count)},
        "a beam's youngs_modulus": {"link.1.beam.material.youngs_modulus": 209e9 * (1 + rng.random(count))},
        "a beam's section": {"link.1.beam.section.y": 0.002 * (1 + rng.random(count))},
        "a beam's length": {"link.1.beam.length": 0.5 + rng.random(count)},
        "a beam's length, one of ten, and a tip's mass": {
            "link.1.beam.length": np.repeat(0.5 + rng.random(10), count // 10), "link.1.tip.mass": rng.random(count)
        },
    }  # fmt: skip
    space = {"bending_y": 3, "bending_z": 3, "torsion": 2}
    beams = [replace(link.beam, modes=space) for link in arm.links]
    spatial = fa.Arm([replace(link, beam=beam) for link, beam in zip(arm.links, beams, strict=True)])
    for name, parameters in kinds.items():
        row: Row = {"kind": "building", "way": name, "n": 1}
        for column, of in (("value", arm), ("space", spatial)):
            variation = Variation(Setup(of), parameters)
            begun = time.process_time()
            variation.scenarios(range(count))
            row[column] = 1e6 * (time.process_time() - begun) / count
        out.append(row)
    return out


def draw(rows: list[Row], path: Path) -> None:
    figure, axes = plt.subplots(figsize=(8.0, 4.6), layout="constrained")
    ways = dict.fromkeys(r["way"] for r in rows if r["kind"] == "steps")
    for way, colour in zip(ways, PALETTE, strict=False):
        mine = [(r["n"], r["value"]) for r in rows if r["kind"] == "steps" and r["way"] == way]
        label = f"{way} worker{'s' if not str(way).endswith(', 1') else ''}" if "," in str(way) else way
        axes.loglog(*zip(*mine, strict=True), "o-", color=colour, ms=4, lw=1.4, label=label)
    axes.set(xlabel="steps of a scenario", ylabel="steps a second", title="16 scenarios of a two-link arm, 6 modes")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=9, frameon=False, loc="lower right")
    figure.savefig(path, dpi=120)


def page(rows: list[Row]) -> str:
    ways = list(dict.fromkeys(str(r["way"]) for r in rows if r["kind"] == "steps"))
    lengths = sorted({int(r["n"]) for r in rows if r["kind"] == "steps"})
    at = {(r["way"], r["n"]): float(r["value"]) for r in rows}
    lines = ["![Steps a second](figures/batch.png)", ""]
    lines += ["| steps of a scenario | " + " | ".join(ways) + " |", "| - " * (len(ways) + 1) + "|"]
    lines += [f"| {n} | " + " | ".join(f"{at[w, n]:.3g}" for w in ways) + " |" for n in lengths]
    lines += ["", "Steps in a second; the number after the comma is the number of workers.", ""]
    lines += ["| in a scenario | run | ms | relative to the first |", "| - | - | - | - |"]
    cost = [r for r in rows if r["kind"] in HOW]
    for r in cost:
        ms = float(r["value"])
        lines.append(f"| {r['way']} | {HOW[str(r['kind'])]} | {ms:.2g} | {ms / float(cost[0]['value']):.1f} |")
    lines += ["", "Time of one core for 0.2 s of this arm, with steps of 1 ms unless the row says otherwise.", ""]
    lines += ["| what differs | µs of one core for each scenario's arm | of one that moves in space |", "| - | - | - |"]
    lines += [
        f"| {r['way']} | {float(r['value']):.0f} | {float(r['space']):.0f} |" for r in rows if r["kind"] == "building"
    ]
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
    rows = throughput(options.seconds) + costs(options.seconds) + building()
    with (folder / "batch.csv").open("w", newline="") as f:
        writer = csv.DictWriter(f, [*rows[0], "space"])
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
