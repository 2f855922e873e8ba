"""The walk of `economize`: indicators first, then models verified by simulation, then a check off the path."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np

from ._check import Array
from .arm import Arm
from .indicate import Indicators, embed, excited
from .measure import Quantity
from .model import STRAINS
from .patch import split_drives
from .rung import ORDERS, Model, Rung, Rungs
from .scene import Scene
from .trial import OutOfTime, Trial, Trials
from .watch import first_frequency, readings

_GOAL = 0.7  # of the tolerance: what the walk may use up; the rest is for what the reference does not know
_SMALL = 1 / 30  # of the tolerance: what is estimated to do less is left out of the reference
_HOPELESS = 20.0  # times the tolerance: coordinates that are estimated to do more are not left out
_UNLIKELY = 2.5  # times the tolerance: orders that are estimated to be off by more are not tried
_AGREE = 1 / 3  # of the tolerance: how close reference and check must be
_BEYOND = 1.5  # times the gap: what may be left beyond the check, where convergence is slow
_ROUNDS = 3  # references, at most
_SPIN = 0.5  # of the first frequency: no order 1, which softens, above it


#: By (link, strain, number of the mode, from 1), how far a coordinate moves the quantity, over its span.
Sizes: TypeAlias = dict[tuple[int, int, int], float]


@dataclass
class Findings:
    """What the walk found.

    Attributes:
        base: the scene's own model, less what symmetry rules out. reference, check: rich runs. lean: the choice, with
            all output times and the chosen integrator.
        lean_model_error: of the lean model, with the reference's integrator, against the reference.
        error: of the lean run against the check. gap: between reference and check.
        dormant: by link, strains that nothing excites.
        share: by (link, strain, number of the mode, from 1), what a coordinate adds to the quantity (estimated).
        by_order: by order, what it is off by (estimated). rotary: what leaving rotary inertia out costs (estimated).
        spin: by link, its largest angular rate over the arm's first frequency with joints locked. rotation: of its
            sections against its base, the largest (rad).
        settings: runs of the lean model with other integrators.
        sizes: how far each coordinate of the reference moves the quantity.
        reasons: why it is not certified.
    """

    base: Trial
    reference: Trial
    lean: Trial
    check: Trial | None = None
    lean_model_error: float = np.inf
    error: float = np.inf
    gap: float = np.inf
    dormant: dict[int, tuple[str, ...]] = field(default_factory=dict)
    share: Sizes = field(default_factory=dict)
    by_order: dict[int | str, float] = field(default_factory=dict)
    rotary: float = 0.0
    spin: dict[int, float] = field(default_factory=dict)
    rotation: dict[int, float] = field(default_factory=dict)
    first_frequency: float = np.nan
    settings: list[Trial] = field(default_factory=list)
    reasons: list[str] = field(default_factory=list)
    sizes: Sizes = field(default_factory=dict)


class Economy:
    """Decides for one scene.

    Args:
        scene: the scene. quantity: what matters. tol: its tolerance. deadline: time.perf_counter() of giving up.
        tell: called with what is being done.
    """

    def __init__(
        self, scene: Scene, quantity: Quantity, tol: float, deadline: float, tell: Callable[[str], None]
    ) -> None:
        self.scene, self.quantity, self.tol, self.tell = scene, quantity, tol, tell
        self.rungs = Rungs(scene)
        self.trials = Trials(self.rungs, quantity, deadline)
        self.reached: dict[int, Array] = {}
        self.spin: dict[int, float] = {}
        self.rotation: dict[int, float] = {}
        self.first_frequency = np.nan
        self.by_order: dict[int | str, float] = {}
        self.rotary = np.nan
        self.rebase = False
        self.share: Sizes = {}
        self.size: Sizes = {}

    # -- models ------------------------------------------------------------------------------------------------------

    def enriched(self, extra: int, than: Model | None = None) -> Model:
        """Everything that symmetry leaves: more modes of every strain than the scene has, exact rotation.

        Args:
            than: more modes of every strain than this model has, too, in Legendre polynomials where they may stand in.
        """
        many = sum(r is not None for r in self.rungs.given) > 4
        least = (2, 2, 1, 1, 1) if many else (4, 4, 2, 2, 2)
        more = (1, 1, 0, 0, 0) if many else (2, 2, 1, 1, 1)
        out: list[Rung | None] = []
        for k, rung in enumerate(self.rungs.given):
            if rung is None:
                out.append(None)
                continue
            most = self.rungs.most(k)
            counts = []
            for s, n in enumerate(rung.counts):
                own = isinstance(self.scene.arm.links[k].beam.modes.get(STRAINS[s]), tuple)  # type: ignore[union-attr]
                want = n
                if not (self.rungs.pinned or own):
                    want = max(n + more[s], least[s]) + (1 + (s < 2)) * extra
                limit = most[s]
                if than is not None and not (self.rungs.pinned or own):
                    want = max(want, self._counts(than[k])[s] + 1 + (s < 2))
                want = want if limit is None else min(want, limit)
                counts.append(want if k not in self.reached or self.reached[k][s] else 0)
            out.append(Rung(tuple(counts), "exact", True, None))
        model: Model = tuple(out)
        return self._based(model) if than is None else self.rungs.rebased(model)

    def richer(self, lean: Model) -> Model:
        """The enriched model whose coordinates have those of the lean one among them."""
        model = self.enriched(0)
        if any(r is not None and r.basis for r in lean):
            model = self.rungs.rebased(model)
        more: list[Rung | None] = []
        for r, own in zip(model, lean, strict=True):
            more.append(r and own and replace(r, counts=tuple(map(max, r.counts, own.counts))))
        return tuple(more)

    def _based(self, model: Model) -> Model:
        return self.rungs.rebased(model) if self.rebase else model

    def find_symmetry(self) -> None:
        """Which strains of which links nothing excites, not even by way of others."""
        model = tuple(
            None if r is None else Rung(tuple(min(n, 2) for n in r.counts), 2, True) for r in self.enriched(0)
        )
        scene = self.trials.scene(model, {})
        moves = excited(scene)
        found = {}
        for k, link in enumerate(scene.arm.links):
            if link.beam is None:
                continue
            at, reached = scene.arm._core.first(k) + link.joint.nv, np.zeros(5, dtype=bool)
            for s, name in enumerate(STRAINS):
                n = link.beam.counts.get(name, 0)
                reached[s], at = moves[at : at + n].any(), at + n
            found[k] = reached if not self.rungs.pinned else np.array(self._counts(self.rungs.given[k])) > 0
        for group in self.rungs.groups:  # chosen alike, so reached alike
            together = np.any([found[k] for k in group], axis=0)
            self.reached |= {k: together for k in group}

    @staticmethod
    def _counts(rung: Rung | None) -> tuple[int, ...]:
        return (0,) * 5 if rung is None else rung.counts

    def own(self) -> Model:
        """The scene's model without dormant coordinates."""
        return self._based(self._own())

    def _own(self) -> Model:
        return tuple(
            r and replace(r, counts=tuple(n * bool(m) for n, m in zip(r.counts, self.reached[k], strict=True)))
            for k, r in enumerate(self.rungs.given)
        )

    def find_basis(self) -> None:
        """Whether Legendre polynomials serve better than the scene's basis, at the same count: where their first
        frequency, which Ritz's method has from above, is lower by what matters; and under patches that are driven."""
        own = self._own()
        other = self.rungs.rebased(own)
        if other == own:
            return
        driven = bool(split_drives(self.scene.drive)[1])
        w, better = (first_frequency(self.rungs.arm(model)) for model in (own, other))
        self.rebase = driven or w - better > 0.1 * self.tol * w

    # -- indicators --------------------------------------------------------------------------------------------------

    def look(self, rich: Model, base: Trial) -> None:
        """Estimates, from a run of the base, what each coordinate of the rich model and each order matters."""
        assert base.result is not None
        scene = self.trials.scene(rich, {})
        found = Indicators(scene, base.result, self.quantity, {})
        self.share = dict(zip(self._keys(scene.arm), found.share, strict=True))
        self.share.pop((-1, -1, -1), None)
        exact = tuple(r and replace(r, order="exact", rotary=True, gauss=None) for r in base.model)
        if any(sum(self._counts(r)) for r in exact):
            poorer: dict[Any, Model] = {o: tuple(r and replace(r, order=o) for r in exact) for o in ORDERS[:-1]}
            poorer["rotary"] = tuple(r and replace(r, rotary=False) for r in exact)
            variants: dict[Any, Arm] = {}
            for name, model in poorer.items():
                try:
                    variants[name] = self.rungs.arm(model)
                except ValueError:
                    continue  # torsion and shear need rotary inertia, order 0 inertia that an arm may not have
            about: dict[Any, float] = Indicators(
                self.trials.scene(exact, {}), base.result, self.quantity, variants
            ).variants
            self.rotary = about.pop("rotary", np.inf)
            self.by_order = {**about, "exact": 0.0}
        else:
            self.by_order, self.rotary = {}, np.inf
        self._spin(base)

    @staticmethod
    def _keys(arm: Arm) -> list[tuple[int, int, int]]:
        """(link, strain, number) of each rate; (-1, -1, -1) of joints."""
        keys = [(-1, -1, -1)] * arm.nv
        for k, link in enumerate(arm.links):
            at = arm._core.first(k) + link.joint.nv
            for name, n in link.beam.counts.items() if link.beam is not None else ():
                for i in range(n):
                    keys[at] = k, STRAINS.index(name), i + 1
                    at += 1
        return keys

    def _spin(self, run: Trial) -> None:
        """How fast each link turns, against the first frequency of the arm with joints locked."""
        assert run.result is not None and run.arm is not None
        arm, r = run.arm, run.result
        self.first_frequency = first_frequency(arm)
        read = readings(arm, r, self.first_frequency)
        self.spin = {k: float(values.max()) for (what, k), values in read.items() if what == "spin"}
        self.rotation = {k: float(values.max()) for (what, k), values in read.items() if what == "rotation"}

    def relevant(self, rich: Model, base: Model) -> Model:
        """Of the rich model, what the indicators say may matter; never less than the base."""
        out: list[Rung | None] = []
        small = _SMALL * self.tol
        for k, (rung, own) in enumerate(zip(rich, base, strict=True)):
            if rung is None or own is None:
                out.append(None)
                continue
            group = next(g for g in self.rungs.groups if k in g)
            counts = []
            for s, n in enumerate(rung.counts):
                matters = [i for i in range(1, n + 1) if max(self.share[j, s, i] for j in group) > small]
                counts.append(max([min(own.counts[s], n), *matters]))
            fair = self.by_order.get(2, np.inf) <= small
            out.append(Rung(tuple(counts), 2 if fair else "exact", True, None, rung.basis))
        return tuple(out)

    # -- the walk ----------------------------------------------------------------------------------------------------

    def error(self, model: Model, reference: Trial) -> float:
        """Of a model against the reference, by simulation; inf where it cannot be run."""
        if self.rungs.usable(model):
            return np.inf
        try:
            return self.trials.distance(self.trials.run(model, most=max(0.5, 3 * reference.time)), reference)
        except ValueError:
            return np.inf

    def allowed(self, order: int | str) -> bool:
        return order != 1 or max(self.spin.values(), default=0.0) < _SPIN

    def likely(self, reference: Trial) -> Model:
        """The reference, of the poorest order that is estimated to be good enough and is; runs are cheaper there."""
        for order in (2, 3):
            if self.by_order.get(order, np.inf) > _GOAL / 2 * self.tol:
                continue
            model = tuple(r and replace(r, order=order) for r in reference.model)
            if order == 3 and self.trials.cost(model) > self.trials.cost(reference.model):
                continue
            if self.error(model, reference) <= _GOAL * self.tol:
                return model
        return reference.model

    def orders(self, start: Model, few: Model, reference: Trial, sizes: Sizes) -> Iterator[Model]:
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
            if not dear and self.error(model, reference) <= goal:
                yield model
            elif not dear and self.by_order.get(order, 0.0) <= goal and self.error(full, reference) <= goal:
                yield self.fewer(full, reference, sizes)
            else:
                continue
            given += 1
            if given == 2:
                return

    def sizes(self, reference: Trial) -> Sizes:
        """By (first link of the group, strain, number), how far that coordinate alone moves the quantity."""
        assert reference.arm is not None and reference.result is not None
        arm, r = reference.arm, reference.result
        rows = np.unique(np.linspace(0, len(r.t) - 1, 101).astype(int))
        run = embed(r, arm, rows)
        sense = self.quantity.sense(self.trials.scene(reference.model, {}), run.q)
        keys, out = self._keys(arm), {}
        by_rate = [arm.coordinate_of(i) for i in range(arm.nv)]
        M = arm.mass_matrix(run.q[len(rows) // 2]) if self.quantity.what == "joint" else None
        joints = [i for i, key in enumerate(keys) if key[0] < 0]
        for group in self.rungs.groups:
            for s in range(5):
                for n in range(1, 1 + max(self._counts(reference.model[group[0]])[s], 0)):
                    x = np.zeros((len(rows), arm.nv))
                    for i in [keys.index((k, s, n)) for k in group]:
                        x[:, i] = run.q[:, by_rate[i]]
                        if M is not None and joints:  # what the joints give way to, with momentum kept
                            push = np.linalg.solve(M[np.ix_(joints, joints)], M[joints, i])
                            x[:, joints] -= np.outer(x[:, i], push)
                    out[group[0], s, n] = sense.size(x)
        return out

    def fewer(self, start: Model, reference: Trial, sizes: Sizes) -> Model:
        """Leaves out coordinates, those that move the quantity least first, as many as the goal allows; by bisection,
        each step verified."""
        tails = []
        for group, s, n in self.rungs.items(start):
            parts = [sizes.get((group[0], s, i), 0.0) for i in range(1, n + 1)]
            tails += [(sum(parts[i - 1 :]), group[0], s, i) for i in range(1, n + 1)]
        tails.sort()

        def without(count: int) -> Model:
            model = start
            for _, first, s, i in sorted(tails[:count], key=lambda x: -x[3]):
                group = next(g for g in self.rungs.groups if g[0] == first)
                now = self._counts(model[first])[s]
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
            if self.error(without(at), reference) <= goal:
                low = at
            else:
                high = at - 1
            guess = (low + high + 1) // 2
        return without(low)

    def polish(self, model: Model, reference: Trial, sizes: Sizes) -> Model:
        """Single steps down, as long as one meets the goal."""
        goal = _GOAL * self.tol
        failed: set[Any] = set()
        better = True
        while better:
            better = False
            for name, lower, about in sorted(self.moves(model, sizes), key=lambda m: m[2]):
                if name in failed or about > _HOPELESS * self.tol:
                    continue
                if self.error(lower, reference) <= goal:
                    model, better = lower, True
                    break
                failed.add(name)
        return model

    def moves(self, model: Model, sizes: Sizes) -> Iterator[tuple[Any, Model, float]]:
        """(name, model, estimated error) of all single steps down that save time."""
        if not self.rungs.pinned:
            for group, s, n in self.rungs.items(model):
                yield (
                    ("modes", group[0], s, n),
                    self.rungs.with_count(model, group, s, n - 1),
                    sizes.get((group[0], s, n), 0.0),
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

    def slices(self, model: Model, reference: Trial) -> Model:
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
            if lower == model or self.error(lower, reference) > _GOAL * self.tol:
                break
            if self.trials.distance(self.trials.run(lower), before) > 0.05 * self.tol:
                break
            model = lower
        return model

    def reduce(self, reference: Trial) -> Model:
        """The cheapest model within the goal that the walk finds."""
        sizes = self.size = self.sizes(reference)
        self.tell("fewer coordinates")
        start = self.likely(reference)
        few = self.fewer(start, reference, sizes)
        found = [self.polish(m, reference, sizes) for m in self.orders(start, few, reference, sizes)]
        found = found or [self.polish(few, reference, sizes)]
        model = min(dict.fromkeys(found), key=self.trials.cost)
        return self.slices(model, reference)

    # -- the integrator ----------------------------------------------------------------------------------------------

    def settings(self, model: Model) -> Iterator[list[dict[str, Any]]]:
        """Of each integrator, settings in the order of trying: steps from short to long, tolerances from loose."""
        span, gap = float(np.ptp(self.scene.t)), float(np.diff(self.scene.t).max())
        step = float(self.trials.walk.get("step", gap))
        if self.rungs.arm(model).nv <= 60:
            longer = [step * 2.0**k for k in range(6) if step * 2.0**k <= span]
            yield [{"integrator": "gauss", "step": h} for h in longer or [step]]
        yield [{"integrator": "ida", "rtol": r, "atol": r * 1e-3} for r in (1e-3, 1e-4, 1e-5)]
        yield [{"integrator": "implicit", "step": gap}]
        yield [{"integrator": "rk4", "step": gap}]

    def integrate(self, model: Model, reference: Trial) -> tuple[Trial, list[Trial]]:
        """The fastest run of the model, with all output times, that keeps to 0.85 of the tolerance; and all tried."""
        tried: list[Trial] = []
        for line in self.settings(model):
            for options in line:
                best = min((x.time for x in tried if self._good(x, reference)), default=np.inf)
                if options["integrator"] in ("implicit", "rk4"):  # four evaluations a step at least
                    steps = float(np.ptp(self.scene.t)) / options["step"]
                    if 4 * steps * self.trials.cost(model) > best:
                        break
                trial = self.trials.run(model, options, whole=True, most=max(0.2, 3 * best))
                tried.append(trial)
                meets = self._good(trial, reference)
                if meets == (options["integrator"] == "ida") or trial.time > 1.5 * best:
                    break  # a longer step is worse still, a tighter tolerance dearer
        good = sorted((x for x in tried if self._good(x, reference)), key=lambda x: x.time)
        if not good:
            trial = self.trials.run(model, self.trials.walk, whole=True)
            return trial, [*tried, trial]
        for trial in good[:3]:
            if trial.time < 1.5 * good[0].time:
                self.trials.again(trial)
        return min(good, key=lambda x: x.time), tried

    def _good(self, trial: Trial, reference: Trial) -> bool:
        return self.trials.distance(trial, reference) <= 0.85 * self.tol

    # -- all together ------------------------------------------------------------------------------------------------

    def start(self) -> Trial:
        """A first run, of the scene's own model if it can be run."""
        own = self.own()
        exact = tuple(r and replace(r, order="exact") for r in own)
        for model in dict.fromkeys((own, exact)):
            self.tell("the scene's own model")
            trial = self.trials.settle(model, self.tol)
            if trial is not None:
                return trial
        reasons = [t.reason for t in self.trials.runs.values() if t.reason]
        why = reasons[0] if reasons else "no setting of any integrator agrees with the next finer one"
        raise ValueError(f"scene: cannot be run to this tolerance: {why}")

    def __call__(self) -> Findings:
        """Decides. OutOfTime in the middle leaves what was found until then, not certified."""
        self.find_symmetry()
        self.find_basis()
        base = self.start()
        assert base.values is not None
        if not self.quantity.span:
            self.quantity.set_span(base.values)
        self.trials.keep_state(base)
        found = Findings(base, base, base)
        found.dormant = {k: tuple(s for s, r in zip(STRAINS, reached, strict=True) if not r)
                         for k, reached in self.reached.items()}  # fmt: skip
        try:
            self._decide(found)
        except OutOfTime:
            found.reasons.append("the time for deciding was used up")
        found.by_order, found.rotary, found.spin, found.rotation = self.by_order, self.rotary, self.spin, self.rotation
        found.sizes, found.share, found.first_frequency = self.size, self.share, self.first_frequency
        return found

    def _decide(self, found: Findings) -> None:
        rich = self.enriched(0)
        self.tell("indicators")
        self.look(rich, found.base)
        reference = self.trials.run(self.relevant(rich, found.base.model))
        for k in range(_ROUNDS):
            if reference.values is None:
                found.reasons.append(f"the reference cannot be run: {reference.reason}")
                return
            self.quantity.set_span(reference.values)
            found.reference, found.reasons = reference, []
            model = self.reduce(reference)
            self.tell("integrators")
            found.lean, found.settings = self.integrate(model, reference)
            found.lean_model_error = self.trials.distance(self.trials.run(model), reference)
            self.tell("check")
            rich = self.enriched(k, reference.model)
            check = self.trials.run(rich, self.trials.finer())
            found.check = check
            if check.values is None:
                found.reasons.append(f"the check, {self.rungs.label(rich)}, cannot be run: {check.reason}")
                return
            found.error = self.trials.distance(found.lean, check)
            found.gap = self.trials.distance(reference, check)
            if found.error + _BEYOND * found.gap <= self.tol and found.gap <= _AGREE * self.tol:
                return
            found.reasons = [
                f"against the check it is off by {found.error:.2g}, and the reference, against which choices were "
                f"made, by {found.gap:.2g}; tolerance {self.tol:.2g}"
            ]
            reference, self.trials.walk = check, check.options


def decide(
    scene: Scene, quantity: Quantity, tol: float, time_budget: float | None, tell: Callable[[str], None]
) -> tuple[Economy, Findings, float]:
    """The walk, what it found, and the seconds it took."""
    started = time.perf_counter()
    deadline = np.inf if time_budget is None else started + time_budget
    walk = Economy(scene, quantity, tol, deadline, tell)
    found = walk()
    return walk, found, time.perf_counter() - started
