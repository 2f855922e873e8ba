"""`flexarm validate RIG`: its options and its output."""

import argparse
import json

from .._console import complain
from ..identify.fit import FitError
from ..identify.validate.rig import SHIPPED
from ..identify.validate.validate import RIGS, validate
from . import options

SUMMARY = "compare the model of a measured arm with recordings of it"
TEXT = (
    "Fits the unknown numbers of the arm to the recordings shipped but one, and predicts that one; with --data, judges "
    "the shipped model on recordings of yours. Writes validate.txt, validate.json and a figure for each kind of drive. "
    "Without RIG it lists the arms."
)


def arguments(p: argparse.ArgumentParser) -> None:
    p.add_argument("rig", metavar="RIG", nargs="?", choices=tuple(RIGS), help=f"the arm: {', '.join(RIGS)}")
    options.output(p, "flexarm-validate")
    p.add_argument("--predict", choices=SHIPPED, default=SHIPPED[-1],
                   help="the recording that is predicted by those left (%(default)s)")  # fmt: skip
    data = "a recording with the columns of those shipped, to judge the shipped model on; repeat for each"
    p.add_argument("--data", metavar="FILE", action="append", help=data)
    part = "how much of a judged recording its zeros, gains and cable are fitted to (half of it)"
    p.add_argument("--calibrate", metavar="SECONDS", type=float, help=part)


def run(args: argparse.Namespace) -> int:
    """Validates, writes and prints; 0, or 1 if a run could not go on."""
    if args.rig is None:
        if args.json:
            print(json.dumps({name: {"arm": arm, "recordings": SHIPPED} for name, arm in RIGS.items()}))
        else:
            print("\n".join(f"{name}  {arm}; recordings {', '.join(SHIPPED)}" for name, arm in RIGS.items()))
        return 0
    try:
        found = validate(args.rig, args.data, predict=args.predict, calibrate=args.calibrate, progress=True)
    except FitError as e:
        complain(str(e))
        return 1
    out = options.Output(args.output)
    out.text("validate.txt", found)
    for driven in dict.fromkeys(j.driven for j in found.judged):
        out.picture(f"validate-{driven}.png", found.plot(driven))
    about = out.json("validate.json", found.to_dict())
    options.told(args, about, found, f"\nPictures and data are in {out}")
    return 0
