"""`flexarm place SCENE`: its options and its output."""

import argparse
from dataclasses import replace

from .._console import write_csv
from ..analysis.placement import place_patch
from ..run.scene.scene import load
from . import options

SUMMARY = "where to bond a piezo patch"
TEXT = (
    "The scene holds the patch, anywhere along its beam; where it would do most is sought, without it in place. "
    "Writes placement.png, placement.csv and placement.txt."
)


def arguments(p: argparse.ArgumentParser) -> None:
    options.scene(p)
    options.output(p, "flexarm-place")
    p.add_argument("--link", type=options.link, default=-1, help="number or name; -1 is the last (%(default)s)")
    p.add_argument("--patch", type=int, default=0, help="which of its patches (%(default)s)")
    p.add_argument("-n", dest="modes", metavar="MODES", type=int, default=3, help="how many modes (%(default)s)")
    weight = "weight of a mode, from the lowest up; repeat for each (default: all alike)"
    p.add_argument("--weight", metavar="W", type=float, action="append", help=weight)
    p.add_argument("--free", action="store_true", help="modes with all joints free (default: all held)")


def run(args: argparse.Namespace) -> int:
    """Places, writes and prints."""
    scene = load(args.scene)
    scene.arm.patch_column(args.link, args.patch, "--")
    links = list(scene.arm.links)
    number = scene.arm._link(args.link, "--link")
    link = links[number]
    assert link.beam is not None
    others = list(link.beam.patches)
    patch = others.pop(args.patch)
    links[number] = replace(link, beam=replace(link.beam, patches=others))
    lock: list[int] | None = [] if args.free else None
    given = {"modes": args.modes, "weights": args.weight, "lock": lock}
    found = place_patch(scene.arm._alike(links), number, patch=patch, progress=True, **given)
    out = options.Output(args.output)
    names = ["centre (m)", *(f"mode {k} (m/V)" for k in range(args.modes)), "merit"]
    write_csv(out.file("placement.csv"), names, [found.x, *found.authority.T, found.merit])
    out.picture("placement.png", found.plot())
    out.text("placement.txt", found)
    values = ("best", "best_merit", "best_authority", "frequencies", "weights", "x", "authority", "merit")
    about = {k: v.tolist() if hasattr(v := getattr(found, k), "tolist") else v for k in values}
    options.told(args, out.described(about), f"{scene.name}: {found}", f"\nPicture and data are in {out}")
    return 0
