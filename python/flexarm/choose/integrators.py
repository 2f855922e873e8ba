"""Integrators and their settings to try, as arguments of `simulate`, from loose to tight.

The names are those of INTEGRATORS in run/simulation.py, whose rows say whether an integrator takes steps or a
tolerance.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..run.integrators import DENSE as DENSE
from ..run.integrators import INTEGRATORS, OPTIONS
from ..run.scene.scene import Scene

#: The integrators that are compared by their tolerance; every other one by its `step`.
BY_TOLERANCE = frozenset(set(INTEGRATORS) - set(OPTIONS["step"]))

#: The fixed-step integrators that step over output times.
OVER_OUTPUTS = frozenset({"gauss"})

#: Integrators of high order first.
IN_TURN = sorted(INTEGRATORS, key=lambda name: (name not in OVER_OUTPUTS, name not in BY_TOLERANCE))

#: The chart's lines, by name: arguments of `simulate`.
LINES: dict[str, dict[str, Any]] = {
    **{name: {"integrator": name} for name in INTEGRATORS},
    "ida, BDF 2": {"integrator": "ida", "max_order": 2},
}

def longest_gap(scene: Scene) -> float:
    """The longest gap between output times (s)."""
    return float(np.diff(scene.t).max())


def line_options(scene: Scene, line: str, value: float) -> dict[str, Any]:
    """Arguments of `simulate`: the scene's, with a line's integrator at a setting."""
    integrator = LINES[line]["integrator"]
    setting = "rtol" if integrator in BY_TOLERANCE else "step"
    out = {k: v for k, v in scene.options.items() if OPTIONS.get(k) == (integrator,)}
    out |= {**LINES[line], setting: value}
    if setting == "rtol":
        out["atol"] = value * scene.options.get("atol", 1e-9) / scene.options.get("rtol", 1e-6)
    return out


def line_settings(scene: Scene, line: str, rtols: Sequence[float] = ()) -> list[float]:
    """Settings of a line, from loose to tight. Steps fit between output times if the integrator stops at all of
    these."""
    integrator, gap = LINES[line]["integrator"], longest_gap(scene)
    if integrator in BY_TOLERANCE:
        return list(rtols or 10.0 ** -np.arange(2, 12))
    longest = max(gap, float(np.ptp(scene.t)) / 16) if integrator in OVER_OUTPUTS else gap
    return list(longest / 2.0 ** np.arange(16))


def by_tolerance(rtol: float, integrator: str = "ida") -> dict[str, Any]:
    return {"integrator": integrator, "rtol": float(rtol), "atol": float(rtol * 1e-3)}


def settings_to_try(scene: Scene, integrator: str, step: float) -> list[dict[str, Any]]:
    """Settings of an integrator for `economize` in order of trial: steps from `step` to long, tolerances from loose."""
    if integrator in BY_TOLERANCE:
        return [by_tolerance(rtol, integrator) for rtol in (1e-3, 1e-4, 1e-5)]
    if integrator not in OVER_OUTPUTS:
        return [{"integrator": integrator, "step": longest_gap(scene)}]
    longer = [step * 2.0**k for k in range(6) if step * 2.0**k <= float(np.ptp(scene.t))]
    return [{"integrator": integrator, "step": h} for h in longer or [step]]


def setting_words(options: dict[str, Any]) -> str:
    """The setting in words, such as "gauss, step 0.05 s"."""
    if "step" in options:
        return f"{options['integrator']}, step {options['step']:.3g} s"
    return f"{options['integrator']}, rtol {options['rtol']:.3g}" if "rtol" in options else str(options["integrator"])
