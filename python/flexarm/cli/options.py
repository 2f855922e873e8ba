"""Arguments that several commands have."""

from __future__ import annotations

import argparse


def scene(p: argparse.ArgumentParser) -> None:
    """SCENE, which `flexarm.load` takes."""
    p.add_argument("scene", metavar="SCENE", help="TOML file, or the name of a shipped scene such as ist")


def output(p: argparse.ArgumentParser, folder: str) -> None:
    """-o DIR, by default `folder`."""
    p.add_argument("-o", "--output", default=folder, metavar="DIR", help="folder to write into (%(default)s)")


def link(text: str) -> int | str:
    """A link's number, or its name."""
    try:
        return int(text)
    except ValueError:
        return text
