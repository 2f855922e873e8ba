"""What a chart is made of: its runs, those that no other beats, and the run that errors are measured against."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..scene.scene import Scene
from .integrators import line_options, setting_name
from .trials import Run

_MARGIN = 1.1  # the run in another basis is off by a little, too


@dataclass(eq=False)
class Row(Run):
    """One run, or one that failed, was skipped or was cut off.

    Attributes:
        choice: the integrator's line in the chart, a key of LINES.
        value: its rtol, or its step (s).
        method: "ab" or "ci", for the accelerations at the output times.
        error: largest distance from the truth over the quantity's span; None if not known.
        absolute: the same by unit, such as {"m": 1e-5}.
    """

    choice: str
    value: float
    method: str = "ab"
    error: float | None = field(default=None, kw_only=True)
    absolute: dict[str, float] = field(default_factory=dict, kw_only=True)

    @property
    def setting(self) -> str:
        return setting_name(self.choice)

    @property
    def label(self) -> str:
        method = "" if self.method == "ab" else f", {self.method}"
        unit = " s" if self.setting == "step" else ""
        return f"{self.model.label}, {self.choice}{method}, {self.setting} {self.value:.4g}{unit}"

    def options(self, scene: Scene) -> dict[str, Any]:
        """Arguments of `simulate`: the scene's, with this row's choice."""
        return line_options(scene, self.choice, self.value, self.method)

    def to_dict(self) -> dict[str, Any]:
        keep = ("choice", "setting", "value", "method", "status", "reason", "time", "runs", "error", "absolute")
        about = {k: getattr(self.model, k) for k in ("order", "modes", "shift", "basis")}
        return {**about, **{k: getattr(self, k) for k in (*keep, "steps", "evaluations", "warning")}}


def best(rows: Iterable[Row], least: float = 0.0) -> list[Row]:
    """The rows that no other one beats in both time and error, fastest first; errors below `least` count as that."""
    graded = sorted((r.time, max(r.error, least), k, r) for k, r in enumerate(rows) if r.error is not None)
    front: list[Row] = []
    lowest = np.inf
    for _, error, _, row in graded:
        if error < lowest:
            front.append(row)
            lowest = error
    return front


@dataclass(frozen=True)
class Truth:
    """What errors are measured against, and how far it is converged.

    Attributes:
        row: the run: the richest model, at a tolerance that no longer matters.
        span: by unit, the largest range of any one component of the quantity.
        modes, order, tolerance: distance over the span between this run and the next-richest in modes (one less
            for each strain), in order, and in tolerance (or step); None where there is none, inf if it was not run.
        basis: the same from a run in Legendre polynomials, two more for each strain: modes of a free beam converge
            slowly under a payload, and one less says little of that. None where they may not stand in, or already do.
        poorer: what those other runs are, in words.
    """

    row: Row
    span: dict[str, float]
    modes: float | None
    order: float | None
    tolerance: float
    basis: float | None
    poorer: dict[str, str]

    @property
    def uncertainty(self) -> float:
        """The largest of the distances that say how far the truth may be off; exact rotation cuts nothing more."""
        order = None if self.row.model.order == "exact" else self.order
        basis = None if self.basis is None else _MARGIN * self.basis
        return max((d for d in (self.modes, order, self.tolerance, basis) if d is not None), default=0.0)

    def to_dict(self) -> dict[str, Any]:
        keep = {k: getattr(self, k) for k in ("span", "modes", "order", "tolerance", "basis", "uncertainty", "poorer")}
        return {"run": self.row.to_dict(), **keep}
