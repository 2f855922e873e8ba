"""`flexarm chart SCENE`: its options and what it prints."""

from __future__ import annotations

import argparse
import json
import os
import sys
from typing import Any

from .ladder import QUANTITIES

TEXT = "Writes chart.png, chart.txt, chart.csv and chart.json. Ctrl-C keeps what was done."


def options(p: argparse.ArgumentParser, scene: dict[str, Any], output: dict[str, Any]) -> None:
    """Adds the command's arguments to its parser."""
    p.add_argument("scene", **scene)
    p.add_argument("-o", "--output", default="flexarm-chart", **output)
    budget = "wall time to spend (%(default)g s); runs that would exceed it are skipped and listed"
    p.add_argument("--budget", metavar="SECONDS", type=float, default=60.0, help=budget)
    quantity = "what is compared: tip, the position of the arm's end; joint, the coordinates of joints that are not "
    quantity += "prescribed; strain, of each beam at its clamp (default: %(default)s)"
    p.add_argument("--quantity", metavar="|".join(QUANTITIES), default="tip", help=quantity)


def run(args: argparse.Namespace) -> int:
    """Charts, writes and prints; 0, or 130 after Ctrl-C, or 1 if no run came to an end."""
    from . import cli
    from .chart import chart, finite
    from .scene import load

    scene = load(args.scene)
    folder = cli._folder(args.output)
    found = chart(scene, budget=args.budget, quantity=args.quantity, progress=True)
    files = found.save(folder)
    if args.json:
        print(json.dumps(finite({**found.to_dict(), "folder": str(folder), "files": files}), indent=1))
    else:
        print(found)
        print(f"\nPicture, table and data are in {folder}{os.sep}")
    sys.stdout.flush()
    if not found.complete:
        cli._complain(f"interrupted; the part of the chart that was done is in {folder}{os.sep}")
        return 130
    if found.truth is None:
        cli._complain(f"--budget {args.budget:g}: no run came to an end in this time; give more")
        return 1
    return 0
