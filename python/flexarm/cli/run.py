"""`flexarm run SCENE`: its options and its output."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._console import complain, empty_table, json_text, output_folder, print_table, write_csv, write_table
from ..data.draw import style as plots
from ..model.parts.labels import deflections, joint_coordinates, joint_rates
from ..run.result import Result
from ..run.scene.check import check_run
from ..run.simulation import SimulationError, SimulationInterrupted
from . import options

if TYPE_CHECKING:
    from rich.table import Table

SUMMARY = "simulate a scene"
TEXT = (
    "Writes run.npz (for flexarm.Result.load), run.csv, run.png, summary.txt and summary.json, "
    "and for each [[sensor]] of the scene what it reads, sensor-K-TYPE.csv."
)


def arguments(p: argparse.ArgumentParser) -> None:
    p.add_argument("scene", metavar="SCENE", help=options.robot(p))
    options.output(p, "flexarm-run")


def _quantities(result: Result) -> list[dict[str, Any]]:
    """Least, greatest and last value of the joints' motion and forces and of the tips' deflections."""
    places = {label: (i, unit) for i, label, unit in joint_coordinates(result.arm)}
    curves = [(label, unit, result.q[:, i]) for label, (i, unit) in places.items() if unit == "1"]  # without rates
    for i, label, unit in joint_rates(result.arm):
        if label in places:
            curves.append((label, unit, result.q[:, places[label][0]]))
        curves.append((f"{label} rate", f"{unit}/s", result.v[:, i]))
        force = ("torque", "N m") if unit == "rad" else ("force", "N")
        curves.append((f"{label} {force[0]}", force[1], result.tau[:, i]))
    for link, component, label in deflections(result.arm):
        curves.append((f"{label} deflection", "m", result.tip_deflection(link)[:, component]))
    return [
        {"name": n, "unit": u, "minimum": float(y.min()), "maximum": float(y.max()), "final": float(y[-1])}
        for n, u, y in curves
    ]


def _write_run(folder: Path, result: Result, summary: dict[str, Any], shown: Table) -> None:
    """run.npz, run.csv, run.png, summary.txt, summary.json."""
    result.save(folder / "run.npz")
    data = result.to_data()
    names = [name for name in data if not name.startswith("friction ")]
    write_csv(folder / "run.csv", ["t", *names], [data.t, *(data[name] for name in names)])
    result.plot().savefig(folder / "run.png", dpi=plots.DPI)
    with (folder / "summary.txt").open("w", encoding="utf-8") as f:
        write_table(f, shown)
    (folder / "summary.json").write_text(json_text(summary) + "\n", encoding="utf-8")


def run(args: argparse.Namespace) -> int:
    """Simulates, writes and prints; 0, or 130 after Ctrl-C, or 1 if the run could not go on."""
    scene = options.read(args.scene, args.tip)
    folder = output_folder(args.output)
    failure: SimulationError | SimulationInterrupted | None = None
    try:
        result = scene.run(progress=True)
    except (SimulationError, SimulationInterrupted) as e:
        failure, result = e, e.result
    summary: dict[str, Any] = {
        "scene": scene.name,
        "complete": failure is None,
        "error": None if failure is None else str(failure),
        "time_reached": float(scene.t[-1]) if failure is None else failure.time,
        "stats": result.stats,
        "folder": str(folder),
        "files": [],
        "quantities": [],
        "remarks": [] if failure else list(map(str, check_run(scene, result))),
    }
    title = f"{scene.name}: {summary['time_reached']:.6g} s simulated"
    shown = empty_table(title, "", "unit", "minimum", "maximum", "final")
    if len(result.t):
        summary["quantities"] = _quantities(result)
        summary["files"] = ["run.npz", "run.csv", "run.png", "summary.txt", "summary.json"]
        for name, reading in scene.readings(result).items():
            reading.save(folder / f"{name}.csv")
            summary["files"].append(f"{name}.csv")
        for c in summary["quantities"]:
            shown.add_row(c["name"], c["unit"], *(f"{c[k]:.6g}" for k in ("minimum", "maximum", "final")))
        _write_run(folder, result, summary, shown)
    if args.json:
        print(json_text(summary))
    elif len(result.t):
        print_table(shown)
        s = result.stats
        steps = f"{s['steps']} steps of {s['integrator']}"
        print(f"{steps}, {s['evaluations']} evaluations, {s['wall_time']:.3g} s of computing")
        print(f"Picture, data and summary are in {folder}{os.sep}")
    if summary["remarks"] and not args.json:
        count, tip = len(summary["remarks"]), f" --tip {args.tip}" if args.tip else ""
        print(f"{count} remark{'s' * (count > 1)}: flexarm check {args.scene}{tip}")
    if failure is not None:
        kept = f"the result up to there is in {folder}{os.sep}" if len(result.t) else "nothing to save"
        complain(f"{failure}; {kept}")
        return 130 if isinstance(failure, KeyboardInterrupt) else 1
    return 0
