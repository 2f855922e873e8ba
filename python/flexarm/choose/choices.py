"""Every choice of a plan, with the error of leaving it out and the time of putting it in."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..parts.beam import STRAINS
from .economy import Economy, Findings
from .rung import ORDERS, Model, Rung
from .trial import OutOfTime, Trial

_SYMMETRY, _RUN, _ESTIMATE = "symmetry", "run", "estimate"


@dataclass(frozen=True)
class Choice:
    """One choice.

    Attributes:
        where: "link 0", or "arm". what: such as "bending_y". chosen: such as "2", "none", "exact".
        without: what leaving it out costs (of what is in: its last mode, or the next poorer order), or costs now (of
            what is out), in the terms of the tolerance; None where that is not known.
        how: where that number is from: "run", "estimate", or "symmetry" (then it is zero).
        time: of one evaluation of the dynamics, the share that it takes (of what is in), or that it would add.
        inside: whether it is in the lean model.
    """

    where: str
    what: str
    chosen: str
    without: float | None
    how: str
    time: float | None
    inside: bool

    def to_dict(self) -> dict[str, Any]:
        return dict(self.__dict__)


def _key(model: Model, *names: str) -> list[Any]:
    return [r and [getattr(r, name) for name in names] for r in model]


def _known(walk: Economy, model: Model, found: Findings, *names: str) -> float | None:
    """The error against the reference of a model that the walk has run, or of one alike in these fields of Rung."""
    fields = names or ("counts", "order", "rotary", "gauss", "basis")
    wanted = _key(model, *fields)
    for trial in walk.trials.runs.values():
        same = trial.options == walk.trials.walk and trial.values is not None
        if same and _key(trial.model, *fields) == wanted:
            return walk.trials.distance(trial, found.reference)
    return None


def _ratio(walk: Economy, more: Model, less: Model) -> float | None:
    try:
        return walk.trials.cost(more) / walk.trials.cost(less) - 1.0
    except ValueError:
        return None


class _Table:
    def __init__(self, walk: Economy, found: Findings) -> None:
        self.walk, self.found, self.model = walk, found, found.lean.model

    def without(self, lower: Model, estimate: float) -> tuple[float, str]:
        """What a poorer model is off by, and where that is from."""
        known = _known(self.walk, lower, self.found, "counts", "order", "rotary", "basis")
        if known is not None:
            return known, _RUN
        try:  # a lean run more
            trial = self.walk.trials.run(lower, most=max(0.2, 3 * self.found.lean.time))
        except (OutOfTime, ValueError):
            return estimate, _ESTIMATE
        if trial.reason.startswith("given up"):
            return estimate, _ESTIMATE
        return self.walk.trials.distance(trial, self.found.reference), _RUN

    def estimate(self, group: list[int], strain: int, n: int) -> float:
        """What the n-th coordinate of a strain does to the quantity."""
        key = group[0], strain, n
        return self.found.sizes.get(
            key, max((self.found.estimates.share.get((k, strain, n), 0.0) for k in group), default=0.0)
        )

    def strain(self, where: str, group: list[int], s: int, n: int) -> Choice:
        rungs = self.walk.rungs
        if n:
            lower = rungs.with_count(self.model, group, s, n - 1)
            error, how = self.without(lower, self.estimate(group, s, n))
            return Choice(where, STRAINS[s], str(n), error, how, _ratio(self.walk, self.model, lower), True)
        dormant = STRAINS[s] in self.found.dormant.get(group[0], ())
        if rungs.most(group[0])[s] == 0:
            return Choice(where, STRAINS[s], "none", None, "no shear modulus", None, False)
        more = rungs.set(rungs.with_count(self.model, group, s, 1), group, rotary=True)
        rung = more[group[0]]
        if rung is not None and not sum(self.model[group[0]].counts):  # type: ignore[union-attr]
            more = rungs.set(more, group, order=2)
        time = _ratio(self.walk, more, self.model)
        if dormant:
            return Choice(where, STRAINS[s], "none", 0.0, _SYMMETRY, time, False)
        return Choice(where, STRAINS[s], "none", self.estimate(group, s, 1), _ESTIMATE, time, False)

    def order(self, where: str, group: list[int], rung: Rung) -> Choice:
        at = ORDERS.index(rung.order)
        for order in reversed(ORDERS[:at]):
            lower = self.walk.rungs.set(self.model, group, order=order)
            estimate = self.found.estimates.by_order.get(order, math.inf)
            error, how = self.without(lower, estimate)
            if order == 3 and how == _ESTIMATE and rung.order == "exact" and at:
                if (_ratio(self.walk, self.model, lower) or 0.0) < 0:
                    continue  # dearer than exact
            return Choice(where, "order", str(rung.order), error, how, _ratio(self.walk, self.model, lower), True)
        better = self.walk.rungs.set(self.model, group, order=2)
        now = self.found.estimates.by_order.get(rung.order, math.inf)
        return Choice(where, "order", str(rung.order), now, _ESTIMATE, _ratio(self.walk, better, self.model), False)

    def rotary(self, where: str, group: list[int], rung: Rung) -> Choice:
        other = self.walk.rungs.set(self.model, group, rotary=not rung.rotary)
        if rung.rotary:
            error, how = self.without(other, self.found.estimates.rotary)
            time = _ratio(self.walk, self.model, other)
            return Choice(where, "rotary inertia", "yes", error, how, time, True)
        lost: float | None = self.found.estimates.rotary
        how = _ESTIMATE
        if not np.isfinite(self.found.estimates.rotary):  # torsion and shear cannot do without
            pair = [_known(self.walk, m, self.found, "counts", "order", "rotary", "basis") for m in (self.model, other)]
            lost = None if pair[0] is None or pair[1] is None else abs(pair[0] - pair[1])
            how = _RUN
        return Choice(where, "rotary inertia", "no", lost, how, _ratio(self.walk, other, self.model), False)

    def gauss(self, where: str, group: list[int], rung: Rung) -> Choice:
        full = self.walk.rungs.set(self.model, group, gauss=None)
        beam = self.walk.rungs.arm(full).links[group[0]].beam
        assert beam is not None
        chosen = rung.gauss or beam._core.gauss_points
        if rung.gauss is None:
            return Choice(where, "Gauss points", str(chosen), None, "of the basis", 0.0, True)
        now, then = (_known(self.walk, m, self.found) for m in (self.model, self._full()))
        cost = None if now is None or then is None else abs(now - then)
        what = f"{chosen} of {beam._core.gauss_points}"
        return Choice(where, "Gauss points", what, cost, _RUN, _ratio(self.walk, full, self.model), False)

    def _full(self) -> Model:
        """The model with all Gauss points that its bases ask for."""
        return tuple(r and replace(r, gauss=None) for r in self.model)

    def link(self, group: list[int]) -> list[Choice]:
        rung = self.model[group[0]]
        assert rung is not None
        where = f"link {group[0]}" + (f" and {len(group) - 1} alike" if len(group) > 1 else "")
        out = []
        if not any(rung.counts):
            trials = [self.estimate(group, s, 1) for s in range(5)]
            error, how = max(trials), _ESTIMATE
            out.append(Choice(where, "beam", "rigid", error, how, None, False))
        out += [self.strain(where, group, s, n) for s, n in enumerate(rung.counts)]
        if any(rung.counts):
            out += [self.order(where, group, rung), self.rotary(where, group, rung), self.gauss(where, group, rung)]
        else:
            out.append(self.rotary(where, group, rung))
        return out

    def whole(self) -> list[Choice]:
        """What is chosen for the arm: space, method, integrator."""
        names = [set(link.beam.counts) for link in self.walk.rungs.arm(self.model).links if link.beam is not None]
        in_y = all(n <= {"bending_y", "shear_y"} for n in names)
        in_z = all(n <= {"bending_z", "shear_z"} for n in names)
        bends = any(names)
        side = {"bending_z", "torsion", "shear_z"} if in_y else {"bending_y", "torsion", "shear_y"}
        sideways = [c.without or 0.0 for g in self.walk.rungs.groups for c in self.link(g) if c.what in side]
        lost = max(sideways, default=0.0)
        out = []
        if bends and names:
            how = _SYMMETRY if lost == 0.0 else _ESTIMATE
            word = "one plane each" if in_y or in_z else "space"
            out.append(
                Choice("arm", "beams bend in", word, lost if word != "space" else None, how, None, word == "space")
            )
        try:
            ratio: float | None = self.walk.trials.cost(self.model, "ci") / self.walk.trials.cost(self.model) - 1.0
        except ValueError:
            ratio = None
        out.append(Choice("arm", "method", "ab", None, "the same motion", ratio, True))
        for trial in sorted(self.found.settings, key=lambda x: x.time):
            out.append(self.setting(trial))
        return out

    def setting(self, trial: Trial) -> Choice:
        own = trial is self.found.lean
        error = None if trial.values is None else self.walk.trials.distance(trial, self.found.reference)
        time = trial.time / self.found.lean.time - 1.0 if np.isfinite(trial.time) else None
        return Choice("arm", "integrator", setting_words(trial.options), error, _RUN, time, own)


def setting_words(options: dict[str, Any]) -> str:
    """Such as "gauss, step 0.05 s"."""
    if "step" in options:
        return f"{options['integrator']}, step {options['step']:.3g} s"
    return f"{options['integrator']}, rtol {options['rtol']:.3g}" if "rtol" in options else str(options["integrator"])


def choices_of(walk: Economy, found: Findings) -> list[Choice]:
    """Link by link, then of the arm."""
    table = _Table(walk, found)
    return [*(c for group in walk.rungs.groups for c in table.link(group)), *table.whole()]


def speed_of(walk: Economy, found: Findings) -> dict[str, dict[str, float | int | None]]:
    """Of the scene's own model, the lean and the rich one: coordinates, time (s) and floating point operations of one
    evaluation of the dynamics; operations are None where the arm does not count them."""
    rich = (found.check or found.reference).model
    given = tuple(r and replace(r) for r in walk.rungs.given)
    out: dict[str, dict[str, float | int | None]] = {}
    for name, model in (("given", given), ("lean", found.lean.model), ("rich", rich)):
        try:
            cost: float | None = walk.trials.cost(model)
        except ValueError:
            cost = None
        nv = walk.rungs.arm(model).nv
        out[name] = {"coordinates": nv, "time": cost, "operations": walk.trials.operations(model)}
    return out
