"""`flexarm modes SCENE`: its options and its output."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

import numpy as np

from .._console import empty_table, json_text, print_table
from ..analysis.modes import Modes
from ..model.acting.drive import Motion
from ..run.scene.scene import Scene
from ..run.start import state
from . import options

SUMMARY = "natural frequencies of a scene's arm"
TEXT = "About rest at the scene's initial position, or about a steady spin. Frequencies are in rad/s."


def arguments(p: argparse.ArgumentParser) -> None:
    p.add_argument("scene", metavar="SCENE", help=options.robot(p))
    speed = "steady speed of a joint (rad/s; m/s if prismatic), such as 0=10, or --speed=-1=10 of the last link; "
    speed += "repeat for more joints"
    p.add_argument("--speed", metavar="LINK=RAD_PER_S", action="append", default=[], help=speed)
    lock = "hold the joint of a link (-1: the last) exactly to its steady motion; repeat for more joints, "
    lock += "'none' for no joint (default: those whose motion the scene prescribes)"
    p.add_argument("--lock", metavar="LINK", action="append", help=lock)
    count = "show the lowest COUNT (%(default)s)"
    p.add_argument("-n", dest="count", metavar="COUNT", type=int, default=10, help=count)


def _speeds(given: Sequence[str], scene: Scene) -> dict[int | str, float]:
    out: dict[int | str, float] = {}
    for text in given:
        link, _, value = text.partition("=")
        try:
            key, speed = options.link(link), float(value)
        except ValueError:
            raise ValueError(f"--speed {text}: must be LINK=SPEED, such as 0=10 (rad/s)") from None
        scene.arm._link(key, f"--speed {text}: link")
        if key in out:
            raise ValueError(f"--speed {text}: link {key} is given twice")
        out[key] = speed
    return out


def _locks(given: Sequence[str] | None, scene: Scene) -> list[Any]:
    """Links to lock; unless told otherwise those whose motion the scene prescribes."""
    if given is None:
        return [link for link, law in scene.drive.items() if isinstance(law, Motion)]
    lock = [options.link(text) for text in given if text != "none"]
    for link in lock:
        scene.arm._link(link, f"--lock {link}: link")
    return lock


def _joint(scene: Scene, link: Any) -> str:
    return scene.arm.joint_names[scene.arm._link(link[0] if isinstance(link, tuple) else link)]


def _mode_rows(modes: Modes, coordinates: Sequence[str], count: int) -> list[dict[str, Any]]:
    rows = []
    for k in range(min(count, len(modes.frequencies))):
        shape = modes.shapes[:, k]
        rows.append(
            {
                "frequency": float(modes.frequencies[k]),
                "hertz": float(modes.frequencies[k] / (2 * np.pi)),
                "damping": float(modes.damping[k]),
                "eigenvalue": [float(modes.eigenvalues[k].real), float(modes.eigenvalues[k].imag)],
                "largest_in": coordinates[int(modes.participation[:, k].argmax())],
                "share": float(modes.participation[:, k].max()),
                "shape_real": np.real(shape).tolist(),
                "shape_imag": np.imag(shape).tolist(),
            }
        )
    return rows


def run(args: argparse.Namespace) -> int:
    """Computes and prints."""
    if args.count < 1:
        raise ValueError(f"-n {args.count}: must be at least 1")
    scene = options.read(args.scene, args.tip)
    speed = _speeds(args.speed, scene)
    lock = _locks(args.lock, scene)
    q, _ = state(scene.arm, scene.q0, None, scene.drive, scene.loads, float(scene.t[0]))
    modes = scene.arm.modes(q=q, speed=speed, lock=lock)
    rows = _mode_rows(modes, scene.arm.coordinates, args.count)
    if args.json:
        keys = {"scene": scene.name, "speed": speed, "lock": lock, "stable": modes.stable}
        print(json_text({**keys, "coordinates": list(scene.arm.coordinates), "modes": rows}))
        return 0
    spin = ", ".join(f"{_joint(scene, k)} at {w:g}" for k, w in speed.items() if w) or "at rest"
    held = f", {', '.join(_joint(scene, k) for k in lock)} locked" if lock else ""
    shown = empty_table(f"{scene.name}: {spin}{held}", "mode", "rad/s", "Hz", "damping ratio", "most of its energy in")
    for k, m in enumerate(rows):
        numbers = [f"{m['frequency']:.6g}", f"{m['hertz']:.6g}", f"{m['damping']:.4g}"]
        if m["frequency"] == 0:
            numbers[2] = "grows" if m["eigenvalue"][0] > 0 else "rigid"
        where = f"{m['largest_in']} ({100 * m['share']:.0f} %)"
        shown.add_row(str(k), *numbers, where, style=None if m["damping"] >= 0 else "bold red")
    print_table(shown)
    if not modes.stable:
        print("This steady state is not stable: at least one motion grows.")
    return 0
