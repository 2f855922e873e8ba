"""`flexarm run SCENE`: its options and its output."""

import argparse
from typing import Any

from .._console import aligned, write_csv
from ..model.parts.labels import deflections, joint_coordinates, joint_rates
from ..run.result import Result
from ..run.scene.check import check_run
from ..run.simulation import SimulationError, SimulationInterrupted
from . import options

SUMMARY = "simulate a scene"
TEXT = (
    "Writes run.npz (for flexarm.Result.load), run.csv, run.png, summary.txt and summary.json, "
    "and the readings of each [[sensor]] of the scene, sensor-K-TYPE.csv; with --error also error.txt and error.png."
)
_EXTREMES = ("minimum", "maximum", "final")


def arguments(p: argparse.ArgumentParser) -> None:
    p.add_argument("scene", metavar="SCENE", help=options.robot(p))
    p.add_argument(
        "--error", action="store_true", help="estimate the error of the tip, and its sources: error.txt, error.png"
    )
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
        {"name": n, "unit": u, **dict(zip(_EXTREMES, map(float, (y.min(), y.max(), y[-1])), strict=True))}
        for n, u, y in curves
    ]


def _estimate(result: Result, out: options.Output, about: dict[str, Any]) -> list[str]:
    """Estimates the error of a run, writes it, and returns it as lines."""
    try:
        found = result.error(progress=True)
    except ValueError as e:
        about["estimate"] = {"refused": str(e)}
        return ["", f"The error of this run is not known: {e}", ""]
    about["estimate"] = found.to_dict()
    out.text("error.txt", str(found))
    out.picture("error.png", found.plot())
    return ["", str(found), ""]


def run(args: argparse.Namespace) -> int:
    """Simulates, writes and prints; 0, or 130 after Ctrl-C, or 1 if the run could not go on."""
    scene = options.read(args.scene, args.tip)
    out = options.Output(args.output)
    failure: SimulationError | SimulationInterrupted | None = None
    try:
        result = scene.run(progress=True)
    except (SimulationError, SimulationInterrupted) as e:
        failure, result = e, e.result
    reached = float(scene.t[-1]) if failure is None else failure.time
    remarks = [] if failure else list(map(str, check_run(scene, result)))
    about: dict[str, Any] = {
        "scene": scene.name, "complete": failure is None, "error": None if failure is None else str(failure),
        "time_reached": reached, "stats": result.stats, "remarks": remarks,
        "quantities": _quantities(result) if len(result.t) else [],
    }  # fmt: skip
    lines: list[str] = []
    if len(result.t):
        rows = [[c["name"], c["unit"], *(f"{c[k]:.6g}" for k in _EXTREMES)] for c in about["quantities"]]
        table = aligned([["", "unit", *_EXTREMES], *rows], range(2, 5))
        shown = "\n".join([f"{scene.name}: {reached:.6g} s simulated", *table])
        data = result.to_data()
        names = [name for name in data if not name.startswith("friction ")]
        result.save(out.file("run.npz"))
        write_csv(out.file("run.csv"), ["t", *names], [data.t, *(data[name] for name in names)])
        out.picture("run.png", result.plot())
        for name, reading in scene.readings(result).items():
            reading.save(out.file(f"{name}.csv"))
        out.text("summary.txt", shown)
        told = _estimate(result, out, about) if args.error and failure is None else []
        about = out.json("summary.json", about)
        s = result.stats
        steps = f"{s['steps']} steps of {s['integrator']}, {s['evaluations']} evaluations"
        lines = [shown, f"{steps}, {s['wall_time']:.3g} s of computing"]
        lines += [*told, f"Picture, data and summary are in {out}"]
    if remarks:
        tip = f" --tip {args.tip}" if args.tip else ""
        lines.append(f"{len(remarks)} remark{'s' * (len(remarks) > 1)}: flexarm check {args.scene}{tip}")
    if lines or args.json:
        options.told(args, about if out.files else out.described(about), *lines)
    if failure is not None:
        return options.gave_up(failure, f"the result up to there is in {out}" if len(result.t) else "nothing to save")
    return 0
