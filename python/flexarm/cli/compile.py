"""`flexarm compile SCENE`: its options and its output."""

import argparse
from pathlib import Path

from ..run.scene.scene import load
from . import options

SUMMARY = "write a scene as numbers, for C++"
TEXT = (
    "flexarm::load_scene of C++ reads the file and runs the whole scene: drives, loads, controllers, friction, and the "
    "integrator with its step."
)


def arguments(p: argparse.ArgumentParser) -> None:
    options.scene(p)
    p.add_argument("-o", "--output", metavar="FILE", help="file to write (SCENE.json, in this folder)")


def run(args: argparse.Namespace) -> int:
    """Compiles, writes and prints."""
    scene = load(args.scene)
    file = Path(args.output or f"{Path(args.scene).stem}.json")
    scene.compile(file)
    options.told(args, {"file": str(file)}, f"{scene.name}: {file}")
    return 0
