"""`flexarm export SCENE --fmi FILE`: its options and its output."""

import argparse

from .._check import positive
from ..run.integrators import Implicit
from ..run.scene.scene import load
from . import options

SUMMARY = "write a scene for other simulators"
TEXT = (
    "A unit of FMI is for co-simulation and model exchange. The simulator that imports it needs neither Python nor "
    "a compiler."
)


def arguments(p: argparse.ArgumentParser) -> None:
    options.scene(p)
    p.add_argument("--fmi", metavar="FILE", required=True, help="unit of FMI to write (.fmu)")
    p.add_argument("--fmi-version", type=int, choices=(3, 2), default=3, help="FMI 3.0 (default) or 2.0")
    text = "step of co-simulation by the implicit method (s); by default the scene's integrator"
    p.add_argument("--step", type=float, metavar="S", help=text)


def run(args: argparse.Namespace) -> int:
    """Exports and prints."""
    scene = load(args.scene)
    scene.to_fmu(args.fmi, None if args.step is None else Implicit(positive("--step", args.step)), args.fmi_version)
    options.told(args, {"file": args.fmi}, f"{scene.name}: {args.fmi}")
    return 0
