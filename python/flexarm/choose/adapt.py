"""Runs that switch to a richer arm when a monitor reports that the lean one is out of its range."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np

from .._check import outside
from ..analysis.findings import RangeWarning, RunWarning
from ..arm.arm import Arm
from ..model.acting.sampled import Sampled
from ..run.result import Result
from ..run.scene.scene import Scene
from ..run.simulation import simulated
from ..run.watch import Watch
from .states import embed, restated


def _simulated(scene: Scene, progress: bool) -> Result:
    return simulated(scene.arm, scene.t, scene.q0, scene.v0, **scene.given(), progress=progress, **scene.options)


def watched(scene: Scene, watch: Watch, progress: bool = False) -> Result:
    """A run, which warns of the first quantity that leaves its range, too."""
    result = _simulated(scene, progress)
    return _told(result, *watch.left(result)[:1])


def _told(result: Result, *more: RunWarning) -> Result:
    """The result, of whose wrong numbers it warns."""
    for warning in [*result._wrong, *more]:
        warnings.warn(warning, stacklevel=outside())
    return result


def adapted(lean: Scene, arm: Arm, options: dict[str, Any], watch: Watch, progress: bool = False) -> Result:
    """Runs the lean scene; from the last output time before a monitor reports, continues with a richer arm.

    Args:
        arm: the richer arm, with all coordinates of the lean one. options: of its simulation.
    """
    first = _simulated(lean, progress)
    left = watch.left(first)
    if not left:
        return _told(first)
    q0 = None if lean.q0 is None else restated(lean.q0, lean.arm, arm)
    v0 = None if lean.v0 is None else restated(lean.v0, lean.arm, arm, rates=True)
    rich = replace(lean, arm=arm, options=options, q0=q0, v0=v0)
    cut = max(0, int(np.searchsorted(first.t, left[0].time)) - 1)
    if cut == 0 or any(isinstance(c, Sampled) for c in lean.control):
        return _told(_simulated(rich, progress))
    begin = embed(first, rich.arm, slice(cut, cut + 1))
    rest = _simulated(replace(rich, t=lean.t[cut:], q0=begin.q[0], v0=begin.v[0]), progress)
    before = embed(first, rich.arm, slice(0, cut))
    stats = {k: first.stats.get(k, 0) + v if isinstance(v, (int, float)) else v for k, v in rest.stats.items()}
    names = ("t", "q", "v", "a", "tau")
    rows: dict[str, Any] = {name: np.concatenate([getattr(before, name), getattr(rest, name)]) for name in names}
    joined = Result(rich.arm, **rows, stats=stats, loads=rest.loads, status=rest.status)
    ranges = [x for x in first._wrong if isinstance(x, RangeWarning) and x.time < rest.t[0]]
    others = [x for x in first._wrong if not isinstance(x, (RangeWarning, *map(type, rest._wrong)))]
    joined._wrong = [*ranges, *others, *rest._wrong]
    return _told(joined)
