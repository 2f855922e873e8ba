"""The decisions of `economize`, a class for each: modes, order, rotary inertia, Gauss points.

A new decision is a class here, named in DECISIONS. The indicators estimate its error from forces at an instant; for a
part without such a force at rest `poorer` returns nothing.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from ..arm.arm import Arm
from ..model.parts.beam import STRAINS
from .models import ORDERS, Model, Models, lowest_order
from .trials import OutOfTime, Run, Trials

RUN, ESTIMATE, SYMMETRY = "run", "estimate", "symmetry"  # the source of a number
ALONE = "not run alone"  # one of two models that differ in this alone was not run
_SPIN = 0.5  # of the first frequency: above it order 1 is not allowed, as it softens

#: By (link, strain, number of the mode, from 1): change of the quantity by that coordinate, over its span.
Sizes: TypeAlias = dict[tuple[int, int, int], float]


def keys(arm: Arm) -> list[tuple[int, int, int]]:
    """(link, strain, number) of each rate; (-1, -1, -1) of joints."""
    out = [(-1, -1, -1)] * arm.nv
    for k, beam, _, at in arm.beams():
        out[at] = [(k, STRAINS.index(name), i + 1) for name, n in beam.counts.items() for i in range(n)]
    return out


@dataclass
class Evidence:
    """Results that decisions use, and the decisions."""

    trials: Trials  #: runs of the models
    tol: float  #: the tolerance
    base: Run  #: the scene's own model without coordinates that symmetry keeps at rest
    reference: Run = field(init=False)  #: a rich run
    judge: Run = field(init=False)  #: from which the descent takes errors: the reference, or its beams in pieces
    lean: Run = field(init=False)  #: the choice, with all output times and the chosen integrator
    check: Run | None = None  #: a richer run, from which the final error is taken
    share: Sizes = field(default_factory=dict)  #: estimated contribution of each coordinate of the enriched model
    by_order: dict[int | str, float] = field(default_factory=dict)  #: estimated error by order
    lacking: dict[str, float] = field(default_factory=dict)  #: by name, that of leaving out another part
    spin: dict[int, float] = field(default_factory=dict)  #: by link, its angular rate over the first frequency
    rotation: dict[int, float] = field(default_factory=dict)  #: by link, of its sections against its base (rad)
    first_frequency: float = np.nan  #: joints locked (rad/s)
    sizes: Sizes = field(default_factory=dict)  #: change of the quantity by each coordinate of the reference
    refused: set[tuple[Any, ...]] = field(default_factory=set)  #: reductions that were tried
    dormant: dict[int, tuple[str, ...]] = field(default_factory=dict)  #: by link, strains that are not excited
    off: float = np.inf  #: error of the lean run against the check
    gap: float = np.inf  #: between reference and check
    settings: list[Run] = field(default_factory=list)  #: runs of the lean model with other integrators
    reasons: list[str] = field(default_factory=list)  #: why the plan is not certified
    notes: list[str] = field(default_factory=list)  #: limits of the check

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
        try:
            self.models.check(model)
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


UNLIKELY = 2.5  # times the tolerance: orders of a larger estimated error are not tried


@dataclass(frozen=True)
class Choice:
    """One choice.

    Attributes:
        where: "link 0", or "arm". what: such as "bending_y". chosen: such as "2", "none", "exact".
        without: error of leaving it out, in the unit of the tolerance (for an included choice: of leaving out its last
            mode, or of the next lower order); None if not found.
        how: source of that number: "run", "estimate", or "symmetry" (then it is zero); without a number, the reason,
            such as "not run alone" for a part that was only left out together with others.
        time: share of one evaluation of the dynamics that it takes (if included), or would add (if not).
        inside: whether it is in the lean model.
    """

    where: str
    what: str
    chosen: str
    without: float | None
    how: str
    time: float | None
    inside: bool


class Reduction(NamedTuple):
    """A reduction of a model, its estimated error, and the function that makes it."""

    name: tuple[Any, ...]
    error: float
    change: Callable[[Model], Model]


class Decision:
    """A decision that is taken for each group of equal links."""

    def poorer(self, models: Models, model: Model) -> dict[Any, Model]:
        """By name, models with the same coordinates whose error the indicators are to estimate."""
        return {}

    def reductions(self, evidence: Evidence, model: Model, group: list[int]) -> Iterator[Reduction]:
        """Reductions of this model that save time."""
        yield from ()

    def rows(self, evidence: Evidence, where: str, group: list[int]) -> Iterator[Choice]:
        """Rows of the table of choices; `where` names these links."""
        yield from ()


class Modes(Decision):
    """The number of shape functions of each strain of a beam. Without any, the beam is rigid."""

    def reductions(self, evidence: Evidence, model: Model, group: list[int]) -> Iterator[Reduction]:
        for s, count in enumerate(() if evidence.models.pinned else model.counts(group[0])):
            error = 0.0
            for n in range(count, 0, -1):
                name = "modes", group[0], s, n
                if name in evidence.refused:
                    break
                error += evidence.sizes.get((group[0], s, n), 0.0)
                yield Reduction(name, error, partial(Model.with_count, links=group, strain=s, n=n - 1))

    def rows(self, evidence: Evidence, where: str, group: list[int]) -> Iterator[Choice]:
        model = evidence.lean.model
        if model.beam(group[0]).rigid:
            lost = max(evidence.size(group, s, 1) for s in range(len(STRAINS)))
            yield Choice(where, "beam", "rigid", lost, ESTIMATE, None, False)
        for s, n in enumerate(model.counts(group[0])):
            if n:
                lower = model.with_count(group, s, n - 1)
                error, how = evidence.without(lower, evidence.size(group, s, n))
                yield Choice(where, STRAINS[s], str(n), error, how, evidence.trials.share(model, lower), True)
            elif evidence.models.most(group[0])[s] == 0:
                yield Choice(where, STRAINS[s], "none", None, "no shear modulus", None, False)
            else:
                more = model.with_count(group, s, 1).but(group, rotary=True)
                more = more.but(group, order=2) if model.beam(group[0]).rigid else more
                dormant = STRAINS[s] in evidence.dormant.get(group[0], ())
                error, how = (0.0, SYMMETRY) if dormant else (evidence.size(group, s, 1), ESTIMATE)
                yield Choice(where, STRAINS[s], "none", error, how, evidence.trials.share(more, model), False)


class Order(Decision):
    """The order of the rotation of a beam's sections."""

    def poorer(self, models: Models, model: Model) -> dict[Any, Model]:
        return {order: model.but(order=order) for order in ORDERS[:-1]}

    @staticmethod
    def known(evidence: Evidence, group: list[int]) -> Sequence[int | str]:
        """The orders that the beam may have."""
        beam = evidence.models.scene.arm.links[group[0]].beam
        return ORDERS if beam is None else ORDERS[ORDERS.index(lowest_order(beam)) :]

    def cheaper(self, evidence: Evidence, model: Model, group: list[int]) -> list[tuple[int | str, Model]]:
        """The orders in which an evaluation takes less time, from low to high, and the model with each."""
        beam = model.beam(group[0])
        others = {order: model.but(group, order=order) for order in self.known(evidence, group) if not beam.rigid}
        return [(k, x) for k, x in others.items() if evidence.allowed(k) and evidence.trials.cheaper(x, model)]

    def reductions(self, evidence: Evidence, model: Model, group: list[int]) -> Iterator[Reduction]:
        for order, _ in self.cheaper(evidence, model, group):
            about = evidence.by_order.get(order, 0.0)
            if about <= UNLIKELY * evidence.tol:
                yield Reduction(("order", group[0], order), about, partial(Model.but, links=group, order=order))

    def rows(self, evidence: Evidence, where: str, group: list[int]) -> Iterator[Choice]:
        model, share, by_order = evidence.lean.model, evidence.trials.share, evidence.by_order
        beam, known = model.beam(group[0]), self.known(evidence, group)
        lower = [x for x in self.cheaper(evidence, model, group) if ORDERS.index(x[0]) < ORDERS.index(beam.order)]
        next_one = lower[-1] if lower else None
        if len(known) == 1 and not beam.rigid:
            yield Choice(where, "order", "exact", None, "curved at rest", None, True)
            return
        if next_one is not None:
            error, how = evidence.without(next_one[1], by_order.get(next_one[0], math.inf))
            yield Choice(where, "order", str(beam.order), error, how, share(model, next_one[1]), True)
        elif not beam.rigid:
            richer = 2 if 2 in known else known[-1]
            now, more = by_order.get(beam.order, math.inf), share(model.but(group, order=richer), model)
            yield Choice(where, "order", str(beam.order), now, ESTIMATE, more, False)


class RotaryInertia(Decision):
    """Rotary inertia of a beam's slices. Torsion and shear need it."""

    name = "rotary inertia"

    def poorer(self, models: Models, model: Model) -> dict[Any, Model]:
        return {self.name: model.but(rotary=False)}

    def reductions(self, evidence: Evidence, model: Model, group: list[int]) -> Iterator[Reduction]:
        if model.beam(group[0]).rotary:
            about = min(evidence.lacking.get(self.name, math.inf), evidence.tol)
            yield Reduction((self.name, group[0]), about, partial(Model.but, links=group, rotary=False))

    def rows(self, evidence: Evidence, where: str, group: list[int]) -> Iterator[Choice]:
        model, share, estimate = evidence.lean.model, evidence.trials.share, evidence.lacking.get(self.name, math.inf)
        inside = model.beam(group[0]).rotary
        other = model.but(group, rotary=not inside)
        if inside:
            error, how = evidence.without(other, estimate)
            yield Choice(where, self.name, "yes", error, how, share(model, other), True)
        elif math.isfinite(estimate):
            yield Choice(where, self.name, "no", estimate, ESTIMATE, share(other, model), False)
        else:  # another part needs it
            now, then = evidence.known(model), evidence.known(other)
            lost = None if now is None or then is None else abs(now - then)
            yield Choice(where, self.name, "no", lost, ALONE if lost is None else RUN, share(other, model), False)


class GaussPoints(Decision):
    """The number of a beam's slices. They are reduced last; see Descent.slices."""

    def rows(self, evidence: Evidence, where: str, group: list[int]) -> Iterator[Choice]:
        model, gauss = evidence.lean.model, evidence.lean.model.beam(group[0]).gauss
        if model.beam(group[0]).rigid:
            return
        full = model.but(group, gauss=None)
        beam = evidence.models.arm(full).links[group[0]].beam
        assert beam is not None
        most = beam._core.gauss_points
        if gauss is None:
            yield Choice(where, "Gauss points", str(most), None, "of the basis", 0.0, True)
            return
        now, then = (evidence.known(m, any_gauss=False) for m in (model, model.but(gauss=None)))
        cost = None if now is None or then is None else abs(now - then)
        time = evidence.trials.share(full, model)
        how = ALONE if cost is None else RUN
        yield Choice(where, "Gauss points", f"{gauss} of {most}", cost, how, time, False)


#: All decisions, in the order of the table.
DECISIONS: list[Decision] = [Modes(), Order(), RotaryInertia(), GaussPoints()]
