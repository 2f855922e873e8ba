"""Sliders of a page: those that a user gives, or those that suit a scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._check import Array, array
from ..arm.variation import OF_ARM, Setup, can_vary, numbered, value_at
from ..model.acting.control import PD
from ..model.parts.taper import Taper
from ..run.scene.scene import Scene

_UNITS = {
    "mass": "kg", "length": "m", "youngs_modulus": "Pa", "density": "kg/m³", "kp": "N m/rad", "kv": "N m s/rad",
    "stiffness": "N m/rad", "damping": "N m s/rad", "coulomb": "N m", "reflected_inertia": "kg m²", "gravity": "m/s²",
}  # fmt: skip


@dataclass(frozen=True)
class Slider:
    """A slider of the page.

    Attributes:
        paths: of the scene's numbers that it moves; of several, by a common factor.
        label, unit: shown. low, high: its ends. value: where the scene itself has it, in between.
        factor: what it shows times this is the number.
    """

    paths: tuple[str, ...]
    label: str
    unit: str
    low: float
    high: float
    value: float
    factor: bool

    @property
    def of_arm(self) -> bool:
        """Whether it moves numbers of the arm alone."""
        return all(path.partition(".")[0] in OF_ARM for path in self.paths)

    def parameters(self, scene: Setup, value: float) -> dict[str, Array]:
        """By path, the numbers at a value of the slider."""
        found = {}
        for path in self.paths:
            own = np.asarray(value_at(scene, path)[0], dtype=float)
            found[path] = (value * own if self.factor else np.full(own.shape, value))[None]
        return found


def chosen(scene: Scene) -> list[Slider]:
    """Gains, payload, lengths and stiffness, of those that the scene has."""
    arm, out = scene.arm, []
    pds = [k for k, one in enumerate(scene.control) if isinstance(one, PD)]
    for gain, low, high in (("kp", 0.1, 3), ("kv", 0, 3)):
        paths = tuple(f"control.{k}.{gain}" for k in pds if getattr(scene.control[k], gain) != 0)
        one = float(getattr(scene.control[pds[0]], gain)) if len(paths) == 1 else 0.0
        if one > 0:
            out.append(_slider_of(scene, paths, low * one, high * one, f"gain {gain}"))
        elif paths:
            out.append(_slider_of(scene, paths, low, high, f"gain {gain}", True))
    own = arm.links[arm.ends[-1]].tip
    most = max(3 * (own.mass if own else 0.0), 0.3 * sum(link.mass for link in arm.links))
    out.append(_slider_of(scene, (f"link.{arm.ends[-1]}.tip.mass",), 0.0, float(f"{most:.2g}"), "payload"))
    beams = [(k, link.beam) for k, link in enumerate(arm.links) if link.beam is not None and link.beam.modes]
    for k, beam in beams:
        if not isinstance(beam.section, Taper) and beam.curvature is None and not beam.patches:
            least, most = (float(f"{f * beam.length:.2g}") for f in (0.6, 1.4))
            out.append(_slider_of(scene, (f"link.{k}.beam.length",), least, most, f"length of {arm.names[k]}"))
    moduli = tuple(f"link.{k}.beam.material.youngs_modulus" for k, beam in beams if beam.material is not None)
    out += [_slider_of(scene, moduli, 0.2, 3, "stiffness of beams", True)] if moduli else []
    return out


def _slider_of(
    scene: Scene, paths: tuple[str, ...], low: float, high: float, label: str, factor: bool = False
) -> Slider:
    own = 1.0 if factor else float(value_at(Setup.of(scene), paths[0])[0] or 0.0)
    return Slider(paths, label, _unit(paths, factor), min(low, own), max(high, own), own, factor)


def _unit(paths: tuple[str, ...], factor: bool) -> str:
    return "×" if factor else _UNITS.get(paths[0].rpartition(".")[2], "")


def given(scenes: Mapping[str, Scene], paths: Any, ends: ArrayLike) -> Slider:
    """A slider of a user."""
    several = (paths,) if isinstance(paths, str) else tuple(paths)
    name = ", ".join(map(str, several))
    low, high = array(f"sliders[{name!r}]", ends, (2,)).tolist()
    if not low < high:
        raise ValueError(f"sliders[{name!r}] = ({low:g}, {high:g}): must be (lowest, highest)")
    holder = next((s for s in scenes.values() if has(s, several)), None)
    if holder is None:
        raise ValueError(f"sliders[{name!r}]: no scene has a number at this path; docs/live.md lists such paths")
    factor = len(several) > 1
    own = 1.0 if factor else float(value_at(Setup.of(holder), several[0])[0] or 0.0)
    if not low <= own <= high:
        raise ValueError(f"sliders[{name!r}] = ({low:g}, {high:g}): must hold the scene's own value, {own:g}")
    return Slider(several, name, _unit(several, factor), low, high, own, factor)


def has(scene: Scene, paths: Sequence[str]) -> bool:
    setup = Setup.of(scene)
    return all(can_vary(numbered(setup, path), setup.known) for path in paths)
