"""`flexarm view SCENE|RUN`: its options and its output."""

import argparse
from pathlib import Path

import numpy as np

from ..run.result import Result
from ..run.scene.scene import ROBOTS
from ..run.simulation import SimulationError, SimulationInterrupted
from ..view.page import library
from ..view.stage import greatest_strain
from . import options

SUMMARY = "see a scene or a run in 3-D"
TEXT = (
    "Simulates a scene, or reads what `flexarm run` or Result.save wrote, and shows the arm in motion: in the browser, "
    "or with -o as a page (.html, one file), a picture (.png) or a film (.gif, .mp4). Several stand side by side. "
    "Pages need: pip install 'flexarm[view]'."
)


def arguments(p: argparse.ArgumentParser) -> None:
    p.add_argument("runs", metavar="SCENE|RUN", nargs="+", help=options.robot(p, "a run (.npz, .h5), "))
    p.add_argument("-o", "--output", metavar="FILE", help=".html, .png, .gif or .mp4 (default: open the browser)")
    magnify = "draw the bending that many times as large (%(default)s)"
    p.add_argument("--magnify", metavar="M", type=float, default=1.0, help=magnify)
    p.add_argument("--speed", metavar="S", type=float, default=1.0, help="of playing; 1 is real time (%(default)s)")
    p.add_argument("--time", metavar="T", type=float, help="of a picture (s; default: the first)")


def _read(name: str, tip: str | None) -> tuple[str, Result, SimulationError | SimulationInterrupted | None]:
    """Title and rows, and why there are no more of them."""
    if Path(name).suffix.lower() in (".npz", ".h5", ".hdf5"):
        return Path(name).stem, Result.load(name), None
    scene = options.read(name, tip)
    if Path(name).suffix.lower() in ROBOTS:  # as it stands
        still = np.zeros((1, scene.arm.nv))
        return scene.name, Result(scene.arm, np.zeros(1), scene.arm.zero[None], still, still, still), None
    try:
        return scene.name, scene.run(progress=True), None
    except (SimulationError, SimulationInterrupted) as e:
        return scene.name, e.result, e


def _library() -> None:
    try:
        library()
    except ImportError as e:
        raise ValueError(str(e)) from None


def run(args: argparse.Namespace) -> int:
    """Simulates or reads, and shows or writes; 1 if a run could not go on, 130 after Ctrl-C."""
    if args.time is not None and Path(args.output or "").suffix.lower() != ".png":
        raise ValueError(f"--time {args.time:g}: goes with a picture, -o FILE.png")
    if Path(args.output or "").suffix.lower() in ("", ".html", ".htm"):
        _library()
    read = [_read(name, args.tip) for name in args.runs]
    for _, result, failure in read:
        if failure is not None and not len(result.t):
            return options.gave_up(failure, "there is nothing to show")
    first, *others = (result for _, result, _ in read)
    view = first.animate(*others, magnify=args.magnify, speed=args.speed, titles=[title for title, _, _ in read])
    file = args.output
    if file is None:
        file = str(view.open())
    else:
        view.save(file, t=args.time, progress=True)
    frames = max(len(track.t) for track in view.tracks)
    about = {"file": file, "frames": frames, "times": list(view.times), "magnify": view.magnify, "speed": view.speed}
    if args.json or args.output is not None:
        shown = f"{view.times[0]:g} to {view.times[1]:g} s: {args.output}" if frames > 1 else args.output
        options.told(args, {**about, "greatest_strain": greatest_strain(view.tracks)}, shown)
    for _, _, failure in read:
        if failure is not None:
            return options.gave_up(failure, "shown is the motion before that")
    return 0
