"""`flexarm chart SCENE`: its options and its output."""

import argparse

from .._console import complain
from ..choose.chart import chart
from ..run.scene.scene import load
from . import options

SUMMARY = "speed against accuracy of models and integrators on a scene"
TEXT = "Writes chart.png, chart.txt, chart.csv and chart.json. Ctrl-C keeps the part that was done."


def arguments(p: argparse.ArgumentParser) -> None:
    options.scene(p)
    options.output(p, "flexarm-chart")
    budget = "wall time to spend (%(default)g s); runs that would exceed it are skipped and listed"
    p.add_argument("--budget", metavar="SECONDS", type=float, default=60.0, help=budget)
    options.quantity(p, "compared")


def run(args: argparse.Namespace) -> int:
    """Charts, writes and prints; 0, or 130 after Ctrl-C, or 1 if no run came to an end."""
    scene = load(args.scene)
    out = options.Output(args.output)
    found = chart(scene, budget=args.budget, quantity=args.quantity, progress=True)
    out.files += found.save(out.path)
    options.told(args, out.described(found.to_dict()), found, f"\nPicture, table and data are in {out}")
    if not found.complete:
        complain(f"interrupted; the part of the chart that was done is in {out}")
        return 130
    if found.truth is None:
        complain(f"--budget {args.budget:g}: no run came to an end in this time; give more")
        return 1
    return 0
