"""The way down: coordinates, orders and integrators left out one after the other, each step verified by a run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np

from ..arm import Arm
from ..parts.beam import STRAINS
from .indicate import embed
from .rung import ORDERS, Model, Rung
from .trial import Trial, Trials

_GOAL = 0.7  # of the tolerance: what the models may use up; the rest is for the integrator and what is not known
_WITHIN = 0.85  # of the tolerance: what the integrator may bring it to
_HOPELESS = 20.0  # times the tolerance: coordinates that are estimated to do more are not left out
_UNLIKELY = 2.5  # times the tolerance: orders that are estimated to be off by more are not tried
_SPIN = 0.5  # of the first frequency: no order 1, which softens, above it

#: By (link, strain, number of the mode, from 1), how far a coordinate moves the quantity, over its span.
Sizes: TypeAlias = dict[tuple[int, int, int], float]


@dataclass
class Estimates:
    """What the indicators say, before the models that they are about have been run.

    Attributes:
        share: what each coordinate of the enriched model adds to the quantity.
        by_order: by order, what it is off by. rotary: what leaving rotary inertia out costs.
        spin: by link, its largest angular rate over the arm's first frequency with joints locked. rotation: of its
            sections against its base, the largest (rad). first_frequency: rad/s.
    """

    share: Sizes = field(default_factory=dict)
    by_order: dict[int | str, float] = field(default_factory=dict)
    rotary: float = np.nan
    spin: dict[int, float] = field(default_factory=dict)
    rotation: dict[int, float] = field(default_factory=dict)
    first_frequency: float = np.nan


def counts(rung: Rung | None) -> tuple[int, ...]:
    return (0,) * 5 if rung is None else rung.counts


def keys(arm: Arm) -> list[tuple[int, int, int]]:
    """(link, strain, number) of each rate; (-1, -1, -1) of joints."""
    out = [(-1, -1, -1)] * arm.nv
    for k, link in enumerate(arm.links):
        at = arm._core.first(k) + link.joint.nv
        for name, n in link.beam.counts.items() if link.beam is not None else ():
            for i in range(n):
                out[at] = k, STRAINS.index(name), i + 1
                at += 1
    return out


class Descent:
    """From one reference.

    Args:
        trials: runs of the models. estimates: of the indicators. tol: the tolerance. reference: the rich run that
            errors are taken from. tell: called with what is being done.

    Attributes:
        sizes: how far each coordinate of the reference moves the quantity.
    """

    def __init__(
        self, trials: Trials, estimates: Estimates, tol: float, reference: Trial, tell: Callable[[str], None]
    ) -> None:
        self.trials, self.rungs, self.quantity = trials, trials.rungs, trials.quantity
        self.by_order, self.rotary, self.spin = estimates.by_order, estimates.rotary, estimates.spin
        self.tol, self.reference, self.tell = tol, reference, tell
        self.sizes = self.find_sizes()

    def error(self, model: Model) -> float:
        """Of a model against the reference, by simulation; inf where it cannot be run."""
        if self.rungs.usable(model):
            return np.inf
        try:
            most = max(0.5, 3 * self.reference.time)
            return self.trials.distance(self.trials.run(model, most=most), self.reference)
        except ValueError:
            return np.inf

    def allowed(self, order: int | str) -> bool:
        return order != 1 or max(self.spin.values(), default=0.0) < _SPIN

    def likely(self) -> Model:
        """The reference, of the poorest order that is estimated to be good enough and is; runs are cheaper there."""
        for order in (2, 3):
            if self.by_order.get(order, np.inf) > _GOAL / 2 * self.tol:
                continue
            model = tuple(r and replace(r, order=order) for r in self.reference.model)
            if order == 3 and self.trials.cost(model) > self.trials.cost(self.reference.model):
                continue
            if self.error(model) <= _GOAL * self.tol:
                return model
        return self.reference.model

    def orders(self, start: Model, few: Model) -> Iterator[Model]:
        """The reduced model with poorer orders that still meet the goal, the poorest first; at most two. Where that
        order leaves no room for so few modes, they are chosen anew."""
        given, goal = 0, _GOAL * self.tol
        top = max((ORDERS.index(r.order) for r in few if r is not None), default=0)
        for order in ORDERS[:top]:
            if self.by_order.get(order, 0.0) > _UNLIKELY * self.tol or not self.allowed(order):
                continue
            model, full = (tuple(r and replace(r, order=order) for r in m) for m in (few, start))
            try:
                dear = order == 3 and self.trials.cost(model) > self.trials.cost(few)
            except ValueError:
                continue
            if not dear and self.error(model) <= goal:
                yield model
            elif not dear and self.by_order.get(order, 0.0) <= goal and self.error(full) <= goal:
                yield self.fewer(full)
            else:
                continue
            given += 1
            if given == 2:
                return

    def find_sizes(self) -> Sizes:
        """By (first link of the group, strain, number), how far that coordinate alone moves the quantity."""
        assert self.reference.arm is not None and self.reference.result is not None
        arm, r = self.reference.arm, self.reference.result
        rows = np.unique(np.linspace(0, len(r.t) - 1, 101).astype(int))
        run = embed(r, arm, rows)
        sense = self.quantity.sense(self.trials.scene(self.reference.model, {}), run.q)
        names, out = keys(arm), {}
        by_rate = [arm.coordinate_of(i) for i in range(arm.nv)]
        M = arm.mass_matrix(run.q[len(rows) // 2]) if self.quantity.what == "joint" else None
        joints = [i for i, key in enumerate(names) if key[0] < 0]
        for group in self.rungs.groups:
            for s in range(5):
                for n in range(1, 1 + max(counts(self.reference.model[group[0]])[s], 0)):
                    x = np.zeros((len(rows), arm.nv))
                    for i in [names.index((k, s, n)) for k in group]:
                        x[:, i] = run.q[:, by_rate[i]]
                        if M is not None and joints:  # what the joints give way to, with momentum kept
                            push = np.linalg.solve(M[np.ix_(joints, joints)], M[joints, i])
                            x[:, joints] -= np.outer(x[:, i], push)
                    out[group[0], s, n] = sense.size(x)
        return out

    def fewer(self, start: Model) -> Model:
        """Leaves out coordinates, those that move the quantity least first, as many as the goal allows; by bisection,
        each step verified."""
        tails = []
        for group, s, n in self.rungs.items(start):
            parts = [self.sizes.get((group[0], s, i), 0.0) for i in range(1, n + 1)]
            tails += [(sum(parts[i - 1 :]), group[0], s, i) for i in range(1, n + 1)]
        tails.sort()

        def without(count: int) -> Model:
            model = start
            for _, first, s, i in sorted(tails[:count], key=lambda x: -x[3]):
                group = next(g for g in self.rungs.groups if g[0] == first)
                now = counts(model[first])[s]
                if now >= i:
                    model = self.rungs.with_count(model, group, s, i - 1)
            return model

        if self.rungs.pinned or not tails:
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
        """Single steps down, as long as one meets the goal."""
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
        """(name, model, estimated error) of all single steps down that save time."""
        if not self.rungs.pinned:
            for group, s, n in self.rungs.items(model):
                yield (
                    ("modes", group[0], s, n),
                    self.rungs.with_count(model, group, s, n - 1),
                    self.sizes.get((group[0], s, n), 0.0),
                )
        for group in self.rungs.groups:
            rung = model[group[0]]
            assert rung is not None
            if rung.rotary:
                about = 0.0 if np.isnan(self.rotary) else min(self.rotary, self.tol)
                yield ("rotary", group[0]), self.rungs.set(model, group, rotary=False), about
            if not sum(rung.counts):
                continue
            for order in reversed(ORDERS[: ORDERS.index(rung.order)]):
                lower = self.rungs.set(model, group, order=order)
                if not self.allowed(order):
                    continue
                try:
                    cheaper = order != 3 or self.trials.cost(lower) < self.trials.cost(model)
                except ValueError:
                    continue
                if cheaper:
                    about = self.by_order.get(order, 0.0)
                    yield ("order", group[0], order), lower, about if about < _UNLIKELY * self.tol else np.inf
                    break

    def slices(self, model: Model) -> Model:
        """Fewer Gauss points, where that changes next to nothing."""
        before = self.trials.run(model)
        for share in (0.7, 0.5):
            fewer: list[Rung | None] = []
            for k, rung in enumerate(model):
                beam = self.rungs.arm(model).links[k].beam
                if rung is None or beam is None or not sum(rung.counts):
                    fewer.append(rung)
                    continue
                full = beam._core.gauss_points
                fewer.append(replace(rung, gauss=max(2, int(np.ceil(share * full)))))
            lower = tuple(fewer)
            if lower == model or self.error(lower) > _GOAL * self.tol:
                break
            if self.trials.distance(self.trials.run(lower), before) > 0.05 * self.tol:
                break
            model = lower
        return model

    def reduce(self) -> Model:
        """The cheapest model within the goal that the walk finds."""
        self.tell("fewer coordinates")
        start = self.likely()
        few = self.fewer(start)
        found = [self.polish(m) for m in self.orders(start, few)]
        found = found or [self.polish(few)]
        model = found[0]
        for other in found[1:]:
            if self.trials.cost(other) < 0.85 * self.trials.cost(model):  # a busy moment does not decide between equals
                model = other
        return self.slices(model)

    # -- the integrator ----------------------------------------------------------------------------------------------

    def settings(self, model: Model) -> Iterator[list[dict[str, Any]]]:
        """Of each integrator, settings in the order of trying: steps from short to long, tolerances from loose."""
        span, gap = float(np.ptp(self.rungs.scene.t)), float(np.diff(self.rungs.scene.t).max())
        step = float(self.trials.walk.get("step", gap))
        if self.rungs.arm(model).nv <= 60:
            longer = [step * 2.0**k for k in range(6) if step * 2.0**k <= span]
            yield [{"integrator": "gauss", "step": h} for h in longer or [step]]
        yield [{"integrator": "ida", "rtol": r, "atol": r * 1e-3} for r in (1e-3, 1e-4, 1e-5)]
        yield [{"integrator": "implicit", "step": gap}]
        yield [{"integrator": "rk4", "step": gap}]

    def integrate(self, model: Model) -> tuple[Trial, list[Trial]]:
        """The fastest run of the model, with all output times, that keeps to 0.85 of the tolerance; and all tried."""
        tried: list[Trial] = []
        for line in self.settings(model):
            for options in line:
                best = min((x.time for x in tried if self._good(x)), default=np.inf)
                if options["integrator"] in ("implicit", "rk4"):  # four evaluations a step at least
                    steps = float(np.ptp(self.rungs.scene.t)) / options["step"]
                    if 4 * steps * self.trials.cost(model) > best:
                        break
                trial = self.trials.run(model, options, whole=True, most=max(0.2, 3 * best))
                same = options["integrator"] == "gauss" and any(x.steps == trial.steps for x in tried)
                if same and trial.values is not None:
                    break  # samples cut longer steps into these
                tried.append(trial)
                meets = self._good(trial)
                if meets == (options["integrator"] == "ida") or trial.time > 1.5 * best:
                    break  # a longer step is worse still, a tighter tolerance dearer
        good = sorted((x for x in tried if self._good(x)), key=lambda x: x.time)
        if not good:
            trial = self.trials.run(model, self.trials.walk, whole=True)
            return trial, [*tried, trial]
        for trial in good[:3]:
            if trial.time < 1.5 * good[0].time:
                self.trials.again(trial)
        return min(good, key=lambda x: x.time), tried

    def _good(self, trial: Trial) -> bool:
        return self.trials.distance(trial, self.reference) <= _WITHIN * self.tol
