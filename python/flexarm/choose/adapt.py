"""Runs that switch to a richer arm when a monitor reports that the lean one is out of its range."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np

from ..acting.sampled import Sampled
from ..analysis.validity import RangeWarning
from ..arm import Arm
from ..parts.part import ModelWarning
from ..run.result import Result
from ..run.simulation import simulate
from ..run.watch import Watch
from ..scene.scene import Scene
from .coordinates import carried_q, carried_v, embed


def _simulated(scene: Scene, watch: Watch | bool, progress: bool) -> Result:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)  # the choice has shown that the modes suffice
        options = {"watch": watch, "progress": progress, **scene.options}
        return simulate(scene.arm, scene.t, scene.q0, scene.v0, **scene.given(), **options)


def watched(scene: Scene, watch: Watch, progress: bool = False) -> Result:
    return _simulated(scene, watch, progress)


def adapted(lean: Scene, arm: Arm, options: dict[str, Any], watch: Watch, progress: bool = False) -> Result:
    """Runs the lean scene; from the last output time before a monitor reports, continues with a richer arm.

    Args:
        arm: the richer arm, with all coordinates of the lean one. options: of its simulation.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RangeWarning)  # the richer arm below takes over
        first = _simulated(lean, False, progress)
    left = watch.look(first)
    if left is None:
        return first
    q0 = None if lean.q0 is None else carried_q(lean.q0, lean.arm, arm)
    v0 = None if lean.v0 is None else carried_v(lean.v0, lean.arm, arm)
    rich = replace(lean, arm=arm, options=options, q0=q0, v0=v0)
    cut = max(0, int(np.searchsorted(first.t, left.time)) - 1)
    if cut == 0 or any(isinstance(c, Sampled) for c in lean.control):
        return _simulated(rich, False, progress)
    begin = embed(first, rich.arm, slice(cut, cut + 1))
    rest = _simulated(replace(rich, t=lean.t[cut:], q0=begin.q[0], v0=begin.v[0]), False, progress)
    before = embed(first, rich.arm, slice(0, cut))
    tau = np.vstack([carried_v(first.tau[:cut], first.arm, rich.arm), rest.tau])
    stats = {k: first.stats.get(k, 0) + v if isinstance(v, (int, float)) else v for k, v in rest.stats.items()}
    rows: dict[str, Any] = {name: np.vstack([getattr(before, name), getattr(rest, name)]) for name in ("q", "v", "a")}
    t = np.concatenate([first.t[:cut], rest.t])
    return Result(rich.arm, t, **rows, tau=tau, stats=stats, loads=rest.loads, status=rest.status)
