"""The descent: coordinates, orders and integrators are reduced one after the other, each step verified by a run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from .coordinates import embed, some_rows
from .decisions import DECISIONS, UNLIKELY
from .findings import Findings, Sizes, keys
from .integrators import BY_TOLERANCE, DENSE, IN_TURN, OVER_OUTPUTS, longest_gap, settings_to_try
from .models import ORDERS, BeamModel, Model
from .trials import Run

_GOAL = 0.7  # of the tolerance: share for the model; the rest is for the integrator and unknown errors
_RUN_SHARE = 0.85  # of the tolerance: limit of the error with the integrator's
_HOPELESS = 20.0  # times the tolerance: coordinates of a larger estimated effect stay


class Descent:
    """The descent from one reference model.

    Args:
        found: the reference, and the estimates of the indicators. tell: called with the present activity.
    """

    def __init__(self, found: Findings, tell: Callable[[str], None]) -> None:
        self.found, self.tell = found, tell
        self.trials, self.models, self.tol = found.trials, found.models, found.tol
        self.reference, self.by_order = found.reference, found.estimates.by_order
        self.error = found.error
        found.sizes = self.find_sizes()

    def likely(self) -> Model:
        """The reference with order 2, or else 3, if that is cheaper and its estimated and true errors are small."""
        reference = self.reference.model
        for order in (2, 3):
            model = reference.but(order=order)
            if self.by_order.get(order, np.inf) <= _GOAL / 2 * self.tol and self.trials.cheaper(model, reference):
                if self.error(model) <= _GOAL * self.tol:
                    return model
        return reference

    def orders(self, start: Model, few: Model) -> Iterator[Model]:
        """The reduced model with lower orders that are cheaper and meet the goal: at most two, the lowest first. If the
        error of an order is too large with so few modes, the modes are chosen anew."""
        count, goal = 0, _GOAL * self.tol
        top = max((ORDERS.index(beam.order) for beam in few.beams if beam is not None), default=0)
        for order in ORDERS[:top]:
            model, full, about = few.but(order=order), start.but(order=order), self.by_order.get(order, 0.0)
            if about > UNLIKELY * self.tol or not self.found.allowed(order) or not self.trials.cheaper(model, few):
                continue
            if self.error(model) <= goal:
                yield model
            elif about <= goal and self.error(full) <= goal:
                yield self.fewer(full)
            else:
                continue
            count += 1
            if count == 2:
                return

    def find_sizes(self) -> Sizes:
        """By (first link of the group, strain, number), the change of the quantity by that coordinate alone."""
        r = self.reference.result
        assert r is not None
        arm = r.arm
        rows = some_rows(len(r.t), 101)
        run = embed(r, arm, rows)
        sense = self.trials.measure.sense(self.models.at(self.reference.model, {}), run.q)
        names, out = keys(arm), {}
        by_rate = [arm.coordinate_of(i) for i in range(arm.nv)]
        M = arm.mass_matrix(run.q[len(rows) // 2]) if self.trials.measure.quantity == "joint" else None
        joints = [i for i, key in enumerate(names) if key[0] < 0]
        for group in self.models.groups:
            for s, count in enumerate(self.reference.model.counts(group[0])):
                for n in range(1, 1 + count):
                    x = np.zeros((len(rows), arm.nv))
                    for i in [names.index((k, s, n)) for k in group]:
                        x[:, i] = run.q[:, by_rate[i]]
                        if M is not None and joints:  # the joints' reaction, with momentum kept
                            push = np.linalg.solve(M[np.ix_(joints, joints)], M[joints, i])
                            x[:, joints] -= np.outer(x[:, i], push)
                    out[group[0], s, n] = sense.size(x)
        return out

    def fewer(self, start: Model) -> Model:
        """Leaves out as many coordinates as the goal allows, the least important first, by verified bisection."""
        tails = []
        for group, s, n in self.models.items(start):
            parts = [self.found.sizes.get((group[0], s, i), 0.0) for i in range(1, n + 1)]
            tails += [(sum(parts[i - 1 :]), group[0], s, i) for i in range(1, n + 1)]
        tails.sort()

        def without(count: int) -> Model:
            model = start
            for _, first, s, i in sorted(tails[:count], key=lambda x: -x[3]):
                if model.counts(first)[s] >= i:
                    group = next(g for g in self.models.groups if g[0] == first)
                    model = model.with_count(group, s, i - 1)
            return model

        if self.models.pinned or not tails:
            return start
        goal = _GOAL * self.tol
        low, high = 0, len(tails)
        guess = int(np.searchsorted([x[0] for x in tails], goal))
        while low < high:
            at = min(max(guess, low + 1), high)
            if self.error(without(at)) <= goal:
                low = at
            else:
                high = at - 1
            guess = (low + high + 1) // 2
        return without(low)

    def polish(self, model: Model) -> Model:
        """Takes single reducing steps as long as one meets the goal."""
        goal = _GOAL * self.tol
        failed: set[Any] = set()
        better = True
        while better:
            better = False
            for name, lower, about in sorted(self.moves(model), key=lambda m: m[2]):
                if name in failed or about > _HOPELESS * self.tol:
                    continue
                if self.error(lower) <= goal:
                    model, better = lower, True
                    break
                failed.add(name)
        return model

    def moves(self, model: Model) -> Iterator[tuple[Any, Model, float]]:
        """(name, model, estimated error) of all single reducing steps that save time."""
        for decision in DECISIONS:
            for group in decision.groups(self.models):
                yield from decision.moves(self.found, model, group)

    def sliced(self, model: Model, share: float) -> Model:
        """The model with this share of the Gauss points that its bases require."""
        links = self.models.arm(model).links

        def fewer(k: int, beam: BeamModel) -> BeamModel:
            of = links[k].beam
            assert of is not None
            return beam if beam.rigid else replace(beam, gauss=max(2, int(np.ceil(share * of._core.gauss_points))))

        return model.each(fewer)

    def slices(self, model: Model) -> Model:
        """Takes fewer Gauss points if the run hardly changes and no new warning appears."""
        before = self.trials.run(model)
        for share in (0.7, 0.5):
            lower = self.sliced(model, share)
            if lower == model or self.error(lower) > _GOAL * self.tol:
                break
            trial = self.trials.run(lower)
            if self.trials.distance(trial, before) > 0.05 * self.tol or (trial.warning and not before.warning):
                break
            model = lower
        return model

    def reduce(self) -> Model:
        """The cheapest model found within the goal."""
        self.tell("fewer coordinates")
        start = self.likely()
        few = self.fewer(start)
        found = [self.polish(m) for m in self.orders(start, few)]
        found = found or [self.polish(few)]
        model = found[0]
        for other in found[1:]:
            if self.trials.cost(other) < 0.85 * self.trials.cost(model):  # timing noise must not decide
                model = other
        return self.slices(model)

    # -- the integrator ----------------------------------------------------------------------------------------------

    def settings(self, model: Model) -> Iterator[list[dict[str, Any]]]:
        """Settings of each integrator in the order of trial: steps from short to long, tolerances from loose."""
        scene = self.models.scene
        step = float(self.trials.setting.get("step", longest_gap(scene)))
        for integrator in IN_TURN:
            if integrator not in OVER_OUTPUTS or self.models.arm(model).nv <= DENSE:
                yield settings_to_try(scene, integrator, step)

    def integrate(self, model: Model) -> tuple[Run, list[Run]]:
        """The fastest run of the model, with an error below 0.85 of the tolerance, and all runs tried."""
        tried: list[Run] = []
        for line in self.settings(model):
            for options in line:
                best = min((x.time for x in tried if self._good(x)), default=np.inf)
                integrator = options["integrator"]
                if integrator not in BY_TOLERANCE | OVER_OUTPUTS:  # at least four evaluations a step
                    steps = float(np.ptp(self.models.scene.t)) / options["step"]
                    if 4 * steps * self.trials.cost(model) > best:
                        break
                trial = self.trials.run(model, options, whole=True, most=max(0.2, 3 * best))
                same = integrator in OVER_OUTPUTS and any(x.steps == trial.steps for x in tried)
                if same and trial.values is not None:
                    break  # sampling times cut longer steps into these
                tried.append(trial)
                meets = self._good(trial)
                time = trial.time if trial.values is not None else np.inf
                if meets == (integrator in BY_TOLERANCE) or time > 1.5 * best:
                    break  # a longer step has a larger error, a tighter tolerance takes longer
        good = sorted((x for x in tried if self._good(x)), key=lambda x: x.time)
        if not good:
            trial = self.trials.run(model, self.trials.setting, whole=True)
            return trial, [*tried, trial]
        for trial in good[:3]:
            if trial.time < 1.5 * good[0].time:
                self.trials.time_again(trial)
        return min(good, key=lambda x: x.time), tried

    def _good(self, trial: Run) -> bool:
        return self.trials.distance(trial, self.found.judge) <= _RUN_SHARE * self.tol
