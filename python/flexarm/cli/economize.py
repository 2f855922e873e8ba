"""`flexarm economize SCENE`: its options and its output."""

from __future__ import annotations

import argparse
import os

from .._console import complain, json_text, output_folder
from ..choose.economize import economize
from ..choose.measures import MEASURES
from ..run.scene.scene import load
from . import options

SUMMARY = "the cheapest model of a scene for a tolerance"
TEXT = "Writes lean.toml (a scene file with the lean model), economize.png, economize.txt and economize.json."


def arguments(p: argparse.ArgumentParser) -> None:
    options.scene(p)
    options.output(p, "flexarm-economize")
    p.add_argument(
        "--tolerance", type=float, default=1e-3, help="error allowed, over the quantity's span (%(default)s)"
    )
    atol = "error allowed in the quantity's SI unit, in place of --tolerance: 1e-3 is a millimetre of the tip"
    p.add_argument("--atol", type=float, default=None, help=atol)
    quantity = "whose error counts: tip, the position of the arm's end; joint, the coordinates of joints that are not "
    quantity += "prescribed; strain, of each beam at its clamp (default: %(default)s)"
    p.add_argument("--quantity", metavar="|".join(MEASURES), default="tip", help=quantity)
    budget = "time for deciding (default: as long as it takes); what is found until then is not certified"
    p.add_argument("--budget", metavar="SECONDS", type=float, default=None, help=budget)


def run(args: argparse.Namespace) -> int:
    """Decides, writes and prints; 0, also where the plan is not certified: the table says so."""
    scene = load(args.scene)
    folder = output_folder(args.output)
    plan = economize(scene, args.tolerance, args.quantity, args.budget, atol=args.atol, progress=True)
    files = ["economize.png", "economize.txt", "economize.json"]
    plan.plot().savefig(folder / files[0], dpi=150)
    (folder / files[1]).write_text(plan.table() + "\n", encoding="utf-8")
    try:
        plan.save(folder / "lean.toml")
        files.insert(0, "lean.toml")
    except ValueError as e:
        complain(f"warning: lean.toml was not written: {e}")
    about = {**plan.to_dict(), "folder": str(folder), "files": files}
    (folder / files[-1]).write_text(json_text(about) + "\n", encoding="utf-8")
    options.told(args, about, plan, f"\nThe lean scene, picture and table are in {folder}{os.sep}")
    return 0
