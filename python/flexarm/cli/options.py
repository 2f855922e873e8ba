"""Arguments and output that several commands have."""

import argparse
import os
from pathlib import Path
from typing import Any

from .._console import complain, json_text, output_folder
from ..choose.measures import MEASURES
from ..data.draw.style import DPI, Figure
from ..run.scene.robot import from_mjcf, from_urdf
from ..run.scene.scene import ROBOTS, Scene, load


def scene(p: argparse.ArgumentParser) -> None:
    """SCENE, which `flexarm.load` takes."""
    p.add_argument("scene", metavar="SCENE", help="TOML file, or the name of a shipped scene such as ist")


def robot(p: argparse.ArgumentParser, more: str = "") -> str:
    """--tip of a robot's file; the help of SCENE then."""
    tip = "of a robot's file, the link that the arm ends with; by default the robot is taken whole, with its branches"
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


def quantity(p: argparse.ArgumentParser, use: str) -> None:
    """--quantity, whose help begins with its use."""
    quantities = "tip, the position of the arm's end (of a tree all ends); joint, the coordinates of joints that are "
    quantities += "not prescribed; "
    text = f"{use}: {quantities}strain, of each beam at its clamp (default: %(default)s)"
    p.add_argument("--quantity", metavar="|".join(MEASURES), default="tip", help=text)


def output(p: argparse.ArgumentParser, folder: str) -> None:
    """-o DIR, by default `folder`."""
    p.add_argument("-o", "--output", default=folder, metavar="DIR", help="folder to write into (%(default)s)")


class Output:
    """The folder that a command writes into; as text, its path with a slash.

    Attributes:
        path: of the folder. files: names of the files written there, in order.
    """

    def __init__(self, path: str) -> None:
        self.path, self.files = output_folder(path), list[str]()

    def __str__(self) -> str:
        return f"{self.path}{os.sep}"

    def file(self, name: str) -> Path:
        """The path of a file that is written there."""
        self.files.append(name)
        return self.path / name

    def text(self, name: str, text: Any) -> None:
        """Writes a text file."""
        self.file(name).write_text(f"{text}\n", encoding="utf-8")

    def picture(self, name: str, figure: Figure) -> None:
        """Writes a picture."""
        figure.savefig(self.file(name), dpi=DPI)

    def described(self, about: dict[str, Any]) -> dict[str, Any]:
        """The JSON of a command, with the folder and its files."""
        return {**about, "folder": str(self.path), "files": self.files}

    def json(self, name: str, about: dict[str, Any]) -> dict[str, Any]:
        """Writes a JSON file, and returns its content: `about`, the folder and its files."""
        path, content = self.file(name), self.described(about)
        path.write_text(json_text(content) + "\n", encoding="utf-8")
        return content


def told(args: argparse.Namespace, about: Any, *lines: Any) -> None:
    """Prints JSON, or else the lines."""
    print(json_text(about) if args.json else "\n".join(map(str, lines)), flush=True)


def gave_up(failure: BaseException, more: str) -> int:
    """Says why a run ended early, and more; the exit code."""
    complain(f"{failure}; {more}")
    return 130 if isinstance(failure, KeyboardInterrupt) else 1


def link(text: str) -> int | str:
    """A link's number, or its name."""
    try:
        return int(text)
    except ValueError:
        return text
