"""Evidence of `economize` about a scene's models: estimates before runs, errors of runs, the chosen model."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from ..arm.arm import Arm
from ..model.parts.beam import STRAINS
from .models import Model, Models
from .states import elastic_parts
from .trials import OutOfTime, Run, Trials

RUN, ESTIMATE, SYMMETRY = "run", "estimate", "symmetry"  # the source of a number
ALONE = "not run alone"  # one of two models that differ in this alone was not run
_SPIN = 0.5  # of the first frequency: above it order 1 is not allowed, as it softens

#: By (link, strain, number of the mode, from 1): change of the quantity by that coordinate, over its span.
Sizes: TypeAlias = dict[tuple[int, int, int], float]


def keys(arm: Arm) -> list[tuple[int, int, int]]:
    """(link, strain, number) of each rate; (-1, -1, -1) of joints."""
    out = [(-1, -1, -1)] * arm.nv
    for k, at, beam in elastic_parts(arm):
        out[at] = [(k, STRAINS.index(name), i + 1) for name, n in beam.counts.items() for i in range(n)]
    return out


@dataclass
class Evidence:
    """Results that decisions use, and the decisions.

    Attributes:
        trials: runs of the models. tol: the tolerance.
        base: the scene's own model without coordinates that symmetry keeps at rest. reference, check: rich runs. lean:
            the choice, with all output times and the chosen integrator. judge: run from which the descent takes errors:
            the reference, or, if strains jump, its beams in pieces.
        share: estimated contribution of each coordinate of the enriched model to the quantity. by_order: estimated
            error by order. lacking: by name, that of leaving out another part of the model.
        spin: by link, its largest angular rate over the arm's first frequency with joints locked. rotation: of its
            sections against its base, the largest (rad). first_frequency: rad/s.
        sizes: change of the quantity by each coordinate of the reference.
        refused: reductions that were tried. dormant: by link, strains that are not excited.
        off: error of the lean run against the check. gap: between reference and check.
        settings: runs of the lean model with other integrators.
        reasons: why the plan is not certified. notes: limits of the check.
    """

    trials: Trials
    tol: float
    base: Run
    reference: Run = field(init=False)
    judge: Run = field(init=False)
    lean: Run = field(init=False)
    check: Run | None = None
    share: Sizes = field(default_factory=dict)
    by_order: dict[int | str, float] = field(default_factory=dict)
    lacking: dict[str, float] = field(default_factory=dict)
    spin: dict[int, float] = field(default_factory=dict)
    rotation: dict[int, float] = field(default_factory=dict)
    first_frequency: float = np.nan
    sizes: Sizes = field(default_factory=dict)
    refused: set[tuple[Any, ...]] = field(default_factory=set)
    dormant: dict[int, tuple[str, ...]] = field(default_factory=dict)
    off: float = np.inf
    gap: float = np.inf
    settings: list[Run] = field(default_factory=list)
    reasons: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.reference = self.judge = self.lean = self.base

    @property
    def models(self) -> Models:
        return self.trials.models

    @property
    def rich(self) -> Run:
        """The run from which final errors are taken: the check, or the reference if there is none."""
        return self.check or self.reference

    def error(self, model: Model) -> float:
        """Error of a model against the judge, by simulation; inf where it cannot be run."""
        if self.models.usable(model):
            return np.inf
        try:
            most = max(0.5, 3 * self.reference.time)
            return self.trials.distance(self.trials.run(model, most=most), self.judge)
        except ValueError:
            return np.inf

    def known(self, model: Model, any_gauss: bool = True) -> float | None:
        """Error of a model that was run with its or (any_gauss) other Gauss points; None if it was not run."""
        for trial in self.trials.runs.values():
            same = trial.options == self.trials.setting and trial.values is not None
            if same and (trial.model.but(gauss=None) == model.but(gauss=None) if any_gauss else trial.model == model):
                return self.trials.distance(trial, self.judge)
        return None

    def without(self, lower: Model, estimate: float) -> tuple[float, str]:
        """Error of a poorer model, and its source: a run, if that is not much longer than a lean one, or the
        estimate."""
        known = self.known(lower)
        if known is not None:
            return known, RUN
        try:  # one more lean run
            trial = self.trials.run(lower, most=max(0.2, 3 * self.lean.time))
        except (OutOfTime, ValueError):
            return estimate, ESTIMATE
        return (estimate, ESTIMATE) if trial.status == "cut" else (self.trials.distance(trial, self.judge), RUN)

    def size(self, group: list[int], strain: int, n: int) -> float:
        """Change of the quantity by the n-th coordinate of a strain."""
        shares = (self.share.get((k, strain, n), 0.0) for k in group)
        return self.sizes.get((group[0], strain, n), max(shares, default=0.0))

    def allowed(self, order: int | str) -> bool:
        return order != 1 or max(self.spin.values(), default=0.0) < _SPIN
