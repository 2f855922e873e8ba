"""`flexarm chart SCENE`: its options and its output."""

from __future__ import annotations

import argparse
import os

from .._console import complain, output_folder
from ..choose.chart import chart
from ..choose.measures import MEASURES
from ..run.scene.scene import load
from . import options

SUMMARY = "speed against accuracy of models and integrators on a scene"
TEXT = "Writes chart.png, chart.txt, chart.csv and chart.json. Ctrl-C keeps what was done."


def arguments(p: argparse.ArgumentParser) -> None:
    options.scene(p)
    options.output(p, "flexarm-chart")
    budget = "wall time to spend (%(default)g s); runs that would exceed it are skipped and listed"
    p.add_argument("--budget", metavar="SECONDS", type=float, default=60.0, help=budget)
    quantity = "what is compared: tip, the position of the arm's end; joint, the coordinates of joints that are not "
    quantity += "prescribed; strain, of each beam at its clamp (default: %(default)s)"
    p.add_argument("--quantity", metavar="|".join(MEASURES), default="tip", help=quantity)


def run(args: argparse.Namespace) -> int:
    """Charts, writes and prints; 0, or 130 after Ctrl-C, or 1 if no run came to an end."""
    scene = load(args.scene)
    folder = output_folder(args.output)
    found = chart(scene, budget=args.budget, quantity=args.quantity, progress=True)
    files = found.save(folder)
    about = {**found.to_dict(), "folder": str(folder), "files": files}
    options.told(args, about, found, f"\nPicture, table and data are in {folder}{os.sep}")
    if not found.complete:
        complain(f"interrupted; the part of the chart that was done is in {folder}{os.sep}")
        return 130
    if found.truth is None:
        complain(f"--budget {args.budget:g}: no run came to an end in this time; give more")
        return 1
    return 0
