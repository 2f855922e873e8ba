"""Arguments that several commands have."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from .._console import json_text
from ..run.scene.robot import from_mjcf, from_urdf
from ..run.scene.scene import ROBOTS, Scene, load


def scene(p: argparse.ArgumentParser) -> None:
    """SCENE, which `flexarm.load` takes."""
    p.add_argument("scene", metavar="SCENE", help="TOML file, or the name of a shipped scene such as ist")


def robot(p: argparse.ArgumentParser, more: str = "") -> str:
    """--tip of a robot's file; the help of SCENE then."""
    tip = "of a robot's file, the link that the arm ends with; needed where the robot branches"
    p.add_argument("--tip", metavar="LINK", help=tip)
    return f"TOML file, the name of a shipped scene such as ist, {more}or a robot's file (.urdf; .xml of MuJoCo)"


def read(name: str, tip: str | None) -> Scene:
    """A scene, or a robot that is at rest at zero and falls for a second."""
    if Path(name).suffix.lower() not in ROBOTS:
        if tip is not None:
            raise ValueError(f"--tip {tip}: goes with a robot's file ({', '.join(ROBOTS)}), not with {name}")
        return load(name)
    try:
        make = from_urdf if ROBOTS[Path(name).suffix.lower()] == "from_urdf" else from_mjcf
        return Scene(make(name, tip=tip), name=Path(name).stem)
    except ImportError as e:
        raise ValueError(str(e)) from None


def output(p: argparse.ArgumentParser, folder: str) -> None:
    """-o DIR, by default `folder`."""
    p.add_argument("-o", "--output", default=folder, metavar="DIR", help="folder to write into (%(default)s)")


def told(args: argparse.Namespace, about: Any, *lines: Any) -> None:
    """Prints JSON, or else the lines."""
    print(json_text(about) if args.json else "\n".join(map(str, lines)), flush=True)


def link(text: str) -> int | str:
    """A link's number, or its name."""
    try:
        return int(text)
    except ValueError:
        return text
