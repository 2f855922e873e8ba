"""`flexarm check SCENE`: its options and its output."""

import argparse
from dataclasses import asdict

from .._console import complain
from ..analysis.findings import RunWarning, SlowWarning
from ..run.scene.check import check, check_run
from ..run.simulation import SimulationError, simulated
from . import options

SUMMARY = "list possible improvements of a scene"
TEXT = (
    "Runs it, writes nothing, and prints a line for each remark: numbers that are probably mistakes, too few shape "
    "functions, ranges that the run leaves, and the remedy."
)


def arguments(p: argparse.ArgumentParser) -> None:
    p.add_argument("scene", metavar="SCENE", help=options.robot(p))


def _slow(warning: RunWarning) -> None:
    """Says during the run that it will hardly end."""
    if isinstance(warning, SlowWarning):
        complain(f"warning: {warning}")


def run(args: argparse.Namespace) -> int:
    """Prints the findings; 0, or 1 if the run could not go on."""
    scene = options.read(args.scene, args.tip)
    failure = None
    try:
        made = simulated(
            scene.arm, scene.t, scene.q0, scene.v0, **scene.given(), progress=True, tell=_slow, **scene.options
        )
        found = check_run(scene, made)
    except SimulationError as e:
        failure, found = e, check(scene)
    options.told(args, [asdict(x) for x in found], found)
    if failure is not None:
        complain(str(failure))
    return int(failure is not None)
