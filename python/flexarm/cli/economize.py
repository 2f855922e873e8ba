"""`flexarm economize SCENE`: its options and its output."""

import argparse

from .._console import complain
from ..choose.economize import economize
from ..run.scene.scene import load
from . import options

SUMMARY = "the cheapest model of a scene for a tolerance"
TEXT = "Writes lean.toml (a scene file with the lean model), economize.png, economize.txt and economize.json."


def arguments(p: argparse.ArgumentParser) -> None:
    options.scene(p)
    options.output(p, "flexarm-economize")
    tolerance = "error allowed, over the quantity's span (%(default)s)"
    p.add_argument("--tolerance", type=float, default=1e-3, help=tolerance)
    atol = "error allowed in the quantity's SI unit, in place of --tolerance: 1e-3 is a millimetre of the tip"
    p.add_argument("--atol", type=float, help=atol)
    options.quantity(p, "whose error counts")
    budget = "time for deciding (default: as long as it takes); a plan found until then is not certified"
    p.add_argument("--budget", metavar="SECONDS", type=float, help=budget)


def run(args: argparse.Namespace) -> int:
    """Decides, writes and prints; 0, also where the plan is not certified: the table says so."""
    scene = load(args.scene)
    out = options.Output(args.output)
    plan = economize(scene, args.tolerance, args.quantity, args.budget, atol=args.atol, progress=True)
    try:
        plan.save(out.path / "lean.toml")
        out.files.append("lean.toml")
    except ValueError as e:
        complain(f"warning: lean.toml was not written: {e}")
    out.picture("economize.png", plan.plot())
    out.text("economize.txt", plan.table())
    about = out.json("economize.json", plan.to_dict())
    options.told(args, about, plan, f"\nThe lean scene, picture and table are in {out}")
    return 0
