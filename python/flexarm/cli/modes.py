"""`flexarm modes SCENE`: its options and its output."""

import argparse
from collections.abc import Sequence
from typing import Any

import numpy as np

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
    """Links to lock; by default those whose motion the scene prescribes."""
    if given is None:
        return [link for link, law in scene.drive.items() if isinstance(law, Motion)]
    lock = [options.link(text) for text in given if text != "none"]
    for link in lock:
        scene.arm._link(link, f"--lock {link}: link")
    return lock


def _joint(scene: Scene, link: Any) -> str:
    return scene.arm.joint_names[scene.arm._link(link[0] if isinstance(link, tuple) else link)]


def _mode(modes: Modes, k: int) -> dict[str, Any]:
    """A mode, for JSON."""
    frequency, s, share = float(modes.frequencies[k]), modes.eigenvalues[k], modes.participation[:, k]
    return {
        "frequency": frequency, "hertz": frequency / (2 * np.pi), "damping": float(modes.damping[k]),
        "eigenvalue": [float(s.real), float(s.imag)], "largest_in": modes.arm.coordinates[int(share.argmax())],
        "share": float(share.max()), "shape_real": np.real(modes.shapes[:, k]).tolist(),
        "shape_imag": np.imag(modes.shapes[:, k]).tolist(),
    }  # fmt: skip


def run(args: argparse.Namespace) -> int:
    """Computes and prints."""
    if args.count < 1:
        raise ValueError(f"-n {args.count}: must be at least 1")
    scene = options.read(args.scene, args.tip)
    speed = _speeds(args.speed, scene)
    lock = _locks(args.lock, scene)
    q, _ = state(scene.arm, scene.q0, None, scene.drive, scene.loads, float(scene.t[0]), scene.control)
    modes = scene.arm.modes(q=q, speed=speed, lock=lock)
    spin = ", ".join(f"{_joint(scene, k)} at {w:g}" for k, w in speed.items() if w) or "at rest"
    held = f", {', '.join(_joint(scene, k) for k in lock)} locked" if lock else ""
    unstable = [] if modes.stable else ["This steady state is not stable: at least one motion grows."]
    about = {
        "scene": scene.name, "speed": speed, "lock": lock, "stable": modes.stable,
        "coordinates": list(scene.arm.coordinates),
        "modes": [_mode(modes, k) for k in range(min(args.count, len(modes.frequencies)))],
    }  # fmt: skip
    options.told(args, about, f"{scene.name}: {spin}{held}", modes._table(args.count), *unstable)
    return 0
