"""`flexarm live SCENE`: its options and its output."""

import argparse
from typing import Any

from ..live.live import live as make_page
from ..run.scene.scene import load
from . import options

SUMMARY = "write a page in which the arm computes"
TEXT = (
    "The page holds the C++ core: one HTML file without a network, with sliders for gains, payload, lengths and "
    "stiffness, a plot of the deflection, and an end of the arm that the mouse pushes. A scene whose joints follow "
    "motions has them with buttons as they are, shaped and inverted; several scenes have a button each. Pages need: "
    "pip install 'flexarm[view]'."
)


def arguments(p: argparse.ArgumentParser) -> None:
    p.add_argument("scenes", metavar="SCENE", nargs="+", help="TOML file, or the name of a shipped scene: two_links")
    p.add_argument("-o", "--output", metavar="FILE", help=".html (default: open the browser)")
    sliders = "a slider, in place of the default ones: PATH is of a number, such as link.1.tip.mass, or several with "
    sliders += "commas between, which it multiplies; again for more"
    p.add_argument("--slider", metavar="PATH=LOW:HIGH", action="append", help=sliders)


def _sliders(given: list[str] | None) -> dict[Any, Any] | None:
    if given is None:
        return None
    out: dict[Any, Any] = {}
    for text in given:
        path, _, ends = text.partition("=")
        low, _, high = ends.partition(":")
        try:
            out[tuple(path.split(",")) if "," in path else path] = float(low), float(high)
        except ValueError:
            raise ValueError(f"--slider {text}: must be PATH=LOW:HIGH, such as link.1.tip.mass=0:1") from None
    return out


def run(args: argparse.Namespace) -> int:
    """Makes the page, writes it or opens it, and prints."""
    scenes = {scene.name: scene for scene in map(load, args.scenes)}
    if len(scenes) < len(args.scenes):
        raise ValueError("SCENE: two have the same title, which their buttons show")
    of: Any = scenes if len(args.scenes) > 1 else next(iter(scenes.values()))
    page = make_page(of, _sliders(args.slider))
    try:
        if args.output is None:
            file = str(page.open())
        else:
            page.save(file := args.output)
    except (RuntimeError, ImportError) as e:
        raise ValueError(str(e)) from None
    about = {"file": file, "buttons": list(page.scenes), "sliders": page.sliders, "notes": page.notes}
    lines = [f"buttons: {', '.join(page.scenes)}", f"sliders: {', '.join(page.sliders)}", *page.notes, file]
    options.told(args, about, *lines)
    return 0
