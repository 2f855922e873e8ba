"""The search of `economize`: a rich run, what each part of its model is worth, the cheapest model by these estimates,
runs of that model, and an independent check."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from ..model.acting.drive import split_drives
from ..model.parts.beam import STRAINS
from ..run.integrators import DENSE
from ..run.scene.scene import Scene
from ..run.watch import first_frequency, readings
from .enrich import enriched, moving_strains, relevant
from .indicators import excited, growth, smoothed
from .measures import Measure, times_to_compare
from .models import BeamModel, Model, Models
from .sources import MODES, ORDER, ROTARY, Change, Part, Sources, orders, size
from .states import some_rows
from .trials import Budget, OutOfTime, Run, Trials, by_tolerance, longest_gap, stable_step

_GOAL = 0.9  # of the room in the tolerance: what models may take of it; steps and Gauss points may take the rest
_ROOM = 0.97  # of the tolerance: the largest known error
_SMALL = 1 / 30  # of the tolerance: tolerance of steps
_LOST = 0.1  # of the tolerance: shapes of less estimated effect together are not in the reference
_AGREE = 1 / 3  # of the tolerance: largest distance between reference and check
_REMAINDER = 1.5  # times the gap: error that may remain beyond the check, if convergence is slow
_ROUNDS = 3  # most references
_SLIGHT = 0.05  # of the goal: parts that change less hardly matter
_NEAR = 3.0  # times the goal: models that are estimated to miss it by less are tried
_WALKS = 3  # most runs of models
_STEPS = (1e-9, 1e-4)  # bounds of the tolerance of steps
_DENSE = (8, 401, 801)  # times of a run for estimates: of each of its steps, the least and the most in all
_GROWTH = 100.0  # of motions that symmetry excludes, within the run: above it the run is unstable
_ROWS = (31, 241, 1601)  # of a run, for their growth: few rows of fast vibrations may show some where there is none
_FAST = tuple(s for s, name in enumerate(STRAINS) if name.startswith(("shear", "extension")))


class EconomizeSearch:
    """Decides for one scene.

    Args:
        scene: the scene. measure: the quantity. tol: its tolerance. budget: time for deciding. tell: called with the
            present activity.

    Attributes:
        reference: a rich run; `sources` are the parts of its model. check: a richer run, from which errors are taken.
            gap: between them, or where strains jump, between the check and a run with its beams in pieces, too.
            lost: the estimated effect of shear and extension that none of these has.
        best: of models in steps of a negligible error. lean: the choice, with all output times and the chosen
            integrator. off: of it from the check.
        share: estimated effect of each coordinate of the enriched model, by (link, strain, number).
        settings: runs of the lean model with other integrators. reasons: why the plan is not certified.
        notes: of the start, and of what could not be tested. dormant: by link, strains that are not excited.
    """

    reference: Run
    lean: Run
    best: Run
    sources: Sources | None = None

    def __init__(self, scene: Scene, measure: Measure, tol: float, budget: Budget, tell: Callable[[str], None]) -> None:
        self.scene, self.measure, self.tol, self.tell = scene, measure, tol, tell
        self.models = Models(scene)
        # a user's own function of a Result may rely on the scene's output times
        own = scene.t[some_rows(len(scene.t), 400)]
        times = own if callable(measure.quantity) else times_to_compare(scene.t)
        self.trials = Trials(self.models, measure, times, budget)
        self.check: Run | None = None
        self.off = self.gap = np.inf
        self.lost = 0.0
        self.share: dict[tuple[int, int, int], float] = {}
        self.settings: list[Run] = []
        self.known: list[tuple[Change, Change]] = []
        self.refused: set[Part] = set()
        self.reasons: list[str] = []
        self.notes: list[str] = []

    @property
    def rich(self) -> Run:
        """The run from which errors are taken: the check, or the reference if there is none."""
        return self.reference if self.check is None or self.check.values is None else self.check

    # -- models ------------------------------------------------------------------------------------------------------

    def enriched(self, extra: int, than: Model | None = None, all_strains: bool = False) -> Model:
        """A model with `extra` modes more than the scene of every strain that symmetry allows, and exact rotation.

        Args:
            all_strains: include the strains that symmetry keeps at rest.
            than: have more modes of every strain than this model, too, in Legendre polynomials where possible.
        """
        model = enriched(self.models, extra, None if all_strains else self.reached, than)
        return model if than is None and not self.rebase else self.models.rebased(model)

    def richer(self, lean: Model) -> Model:
        """The enriched model, with all coordinates of the lean one."""
        model = self.models.rebased(self.enriched(0)) if lean.basis else self.enriched(0)
        return model.each(lambda k, b: replace(b, counts=tuple(map(max, b.counts, lean.counts(k)))))

    def find_basis(self) -> None:
        """Finds the strains of each link that are excited, directly or through others; and `own`, the scene's model
        with these alone. Legendre polynomials replace the scene's basis, at the same count, if their first frequency
        (an upper bound, by Ritz's method) is lower by more than the tolerance allows, or patches are driven."""
        self.reached = moving_strains(self.models)
        self.dormant = {k: {s for s, moves in zip(STRAINS, row, strict=True) if not moves}
                        for k, row in self.reached.items()}  # fmt: skip

        def moving(k: int, beam: BeamModel) -> BeamModel:
            return replace(beam, counts=tuple(n * bool(m) for n, m in zip(beam.counts, self.reached[k], strict=True)))

        self.own, self.rebase = self.models.given.each(moving), False
        other = self.models.rebased(self.own)
        if other != self.own:
            w, better = (first_frequency(self.models.arm(model)) for model in (self.own, other))
            self.rebase = bool(split_drives(self.scene.arm, self.scene.drive)[1]) or w - better > 0.1 * self.tol * w
            self.own = other if self.rebase else self.own

    def relevant(self, rich: Model, base: Run) -> Model:
        """The rich model without coordinates that hardly have an estimated effect; it keeps those of the base."""
        assert base.dense is not None
        kept, self.share, _ = relevant(
            self.models, rich, base.model, smoothed(base.dense), self.measure, _LOST, self.tol
        )  # fmt: skip
        return kept

    def affordable(self, rich: Model, model: Model | None = None) -> Model:
        """The rich model without the shear and extension that another one has none of (None: without all), whose
        estimated effect is `lost`: beams are stiff in them, and need very short steps."""
        beams = [k for k, beam in enumerate(rich.beams) if beam]
        out = {(k, s) for k in beams for s in _FAST if model is None or not model.counts(k)[s]}

        def fewer(k: int, beam: BeamModel) -> BeamModel:
            return replace(beam, counts=tuple(0 if (k, s) in out else n for s, n in enumerate(beam.counts)))

        self.lost = sum(x for (k, s, _), x in self.share.items() if (k, s) in out)
        return rich.each(fewer)

    # -- runs --------------------------------------------------------------------------------------------------------

    def steps(self) -> float:
        """A tolerance of steps whose error is negligible."""
        share = min((self.measure.span[u] / self.measure.size_of(u) for u in self.measure.span), default=1.0)
        return float(np.clip(_SMALL * self.tol * min(share, 1.0), *_STEPS))

    def first(self) -> Run:
        """A first run, and the setting of others: of the scene's own model if it can be run, else of that with exact
        rotation."""
        for model in dict.fromkeys((self.own, self.own.but(order="exact"))):
            self.tell("the scene's own model")
            for options in self.options(self.steps()):
                run = self.trials.run(model, options, dense=_DENSE[1])
                if run.values is not None:
                    self.measure.set_span(run.values)
                    name = "tolerance" if "tolerance" in options else "rtol"
                    self.trials.setting = {**options, name: min(options[name], self.steps())}
                    return run
        reasons = [run.reason for run in self.trials.runs.values() if run.reason]
        raise ValueError(f"scene: cannot be run to this tolerance: {reasons[0]}")

    def options(self, steps: float, stages: int = 4) -> list[dict[str, Any]]:
        """Arguments of `simulate` to try in turn for a run with steps of this tolerance."""
        gauss = {"integrator": "gauss", "tolerance": steps, "stages": stages}
        ida = by_tolerance(1e-2 * steps)
        return [*([gauss] if self.scene.arm.nv <= DENSE else []), ida, {**ida, "max_order": 2}]

    def attempt(self, model: Model, finer: bool = False) -> Run:
        """A run of a model, with the setting, or with steps and a method that are independent of it; if it fails, with
        another integrator."""
        setting, usual = self.trials.setting, max(3.0, 50.0 * self.base.time)
        steps = setting.get("tolerance", setting.get("rtol", 0.0)) / (10 if finer else 1)
        dense = int(np.clip(_DENSE[0] * self.base.steps, *_DENSE[1:]))
        for tried in self.options(steps, 3) if finer else [setting, *self.options(steps)[1:]]:
            run = self.trials.run(model, tried, whole=finer and "tolerance" in tried, most=usual, dense=dense)
            if run.values is not None:
                break
        return run

    def error(self, model: Model) -> float:
        """Error of a model beside the check, by simulation; inf where it cannot be run."""
        try:
            self.models.check(model)
            return self.trials.distance(self.trials.run(model, most=max(0.5, 3 * self.reference.time)), self.rich)
        except ValueError:
            return np.inf

    # -- the walk ----------------------------------------------------------------------------------------------------

    def estimate(self, model: Model) -> float:
        """Estimated error of a model. Where runs of others are off from their estimates, so is this, by what those are
        off that are near to it."""
        assert self.sources is not None
        change = self.sources.change(model)
        near = np.array([size({u: x - known[u] for u, x in change.items()}) for known, _ in self.known])
        parts = 1.0 / np.maximum(near, 1e-9 * self.tol) ** 2
        parts = parts / parts.sum()
        return size({u: x + np.tensordot(parts, [off[u] for _, off in self.known], 1) for u, x in change.items()})

    def learn(self, run: Run) -> None:
        """Stores how far a run is off from its estimate."""
        assert self.sources is not None and run.values is not None and self.rich.values is not None
        change = self.sources.change(run.model)
        self.known.append((change, {u: (run.values[u] - self.rich.values[u]) / span - change[u]
                                    for u, span in self.measure.span.items()}))  # fmt: skip

    def poorer(self, model: Model) -> Iterator[Model]:
        """Models with one thing less, or of another order."""
        for group in self.models.groups:
            beam = model.beam(group[0])
            if not self.models.pinned:
                yield from (model.with_count(group, s, n - 1) for s, n in enumerate(beam.counts) if n)
            if beam.rotary and (ROTARY, group[0]) not in self.refused:
                yield model.but(group, rotary=False)
            others = () if beam.rigid else orders(self.models, group)
            yield from (model.but(group, order=order) for order in others
                        if order != beam.order and (ORDER, group[0], order) not in self.refused)  # fmt: skip

    def walk(self) -> Model:
        """From the reference's model down, by what saves most time for its error, to the goal. Fewer shapes always save
        time: those that hardly matter go first."""
        goal, model, now = _GOAL * self.room, self.reference.model, 0.0

        def first(some: list[tuple[float, float, Model]]) -> tuple[float, float, Model] | None:
            return next((x for x in sorted(some, key=lambda x: x[0]) if self.possible(x[2])), None)

        while True:
            known = [(self.estimate(other), other) for other in self.poorer(model)]
            known = [x for x in known if x[0] <= goal]
            step = first([(error, error, other) for error, other in known
                          if other.size < model.size and error <= max(now, _SLIGHT * goal)])  # fmt: skip
            step = step or first([(max(error - now, 0.0) / saved, error, other) for error, other in known
                                  if (saved := self.trials.saved(model, other)) > 0.0])  # fmt: skip
            if step is None:
                return model
            _, now, model = step

    def possible(self, model: Model) -> bool:
        """Whether the scene's controllers and sensors can work with a model."""
        try:
            self.models.check(model)
        except ValueError:
            return False
        return True

    def reduce(self) -> None:
        """Finds `best`, the run of the cheapest model that keeps the goal: the walk's, again with what its runs tell;
        then of those that lack one thing more, where the estimates say that they hardly miss the goal."""
        self.tell("fewer coordinates")
        self.best, self.known, self.refused = self.reference, [], set()
        self.sources = Sources(self.models, self.measure, self.reference)
        self.learn(self.reference)
        ran = {self.reference.model}
        for _ in range(_WALKS):
            model = self.walk()
            if model in ran:
                near = [(self.estimate(x), x) for x in self.poorer(self.best.model) if x.size < self.best.model.size]
                near = [x for x in near if x[1] not in ran and x[0] <= _NEAR * _GOAL * self.room]
                near = [x for x in near if self.possible(x[1])]
                if not near:
                    break
                model = min(near, key=lambda x: x[0])[1]
            ran.add(model)
            run = self.trials.run(model, most=max(0.5, 3 * self.reference.time), often=2)
            if run.values is None:
                gone = [part for part in self.sources.left_out(model) if part[0] != MODES]
                self.refused |= {part for part in gone if part[0] == ROTARY} or set(gone)
                continue
            self.learn(run)
            if self.good(run, _GOAL) and (self.best is self.reference or run.time < self.best.time):
                self.best = run

    @property
    def room(self) -> float:
        """The error beside the check that a run may have. (What cannot be certified leaves half of the tolerance.)"""
        room = _ROOM * self.tol - _REMAINDER * self.gap - self.lost
        return room if self.gap <= _AGREE * self.tol else 0.5 * self.tol

    def good(self, run: Run, share: float = 1.0) -> bool:
        return self.trials.distance(run, self.rich) <= share * self.room

    def sliced(self, model: Model, share: float) -> Model:
        """The model with this share of the Gauss points that its bases ask for."""
        links = self.models.arm(model).links

        def fewer(k: int, beam: BeamModel) -> BeamModel:
            of = links[k].beam
            assert of is not None
            return beam if beam.rigid else replace(beam, gauss=max(2, int(np.ceil(share * of._core.gauss_points))))

        return model.each(fewer) if share < 1.0 else model

    def integrate(self) -> None:
        """Finds the fastest run of the best model with an error within the room: few Gauss points first,
        where no new warning appears; chosen steps, loose ones first, then fixed ones of some times their length, then
        short ones of a cheap method."""
        self.tell("integrators")
        tried = self.settings = []
        span, gap = float(np.ptp(self.scene.t)), longest_gap(self.scene)

        def good(run: Run) -> bool:
            return self.good(run) and (bool(self.best.warning) or not run.warning)

        def best() -> float:
            return min((x.time for x in tried if good(x)), default=np.inf)

        def run(model: Model, **options: Any) -> Run:
            tried.append(self.trials.run(model, options, whole=True, most=max(0.2, 3 * best())))
            return tried[-1]

        setting = self.trials.setting
        name = "tolerance" if "tolerance" in setting else "rtol"
        for share, factor in ((0.5, 30), (1.0, 30), (1.0, 3), (1.0, 1)):
            model = self.sliced(self.best.model, share)
            value = min(factor * setting[name], 1e-2)
            by = run(model, **(by_tolerance(value) if name == "rtol" else {"integrator": "gauss", name: value}))
            if good(by):
                break
        if name == "tolerance":
            step = min(4 * span / max(by.steps, 1), span)
            fits = good(run(model, integrator="gauss", step=step))
            run(model, integrator="gauss", step=2 * step if fits else step / 2)
        if 8 * span / gap * self.trials.cost(model) < best():  # at least four evaluations a step
            stable = stable_step(self.models.at(model, {}), gap) == gap
            run(model, integrator="rk4" if stable else "implicit", step=gap)
        found = sorted(filter(good, tried), key=lambda x: x.time)
        for x in found[:2]:
            self.trials.time_again(x, often=2)
        self.lean = min(found, key=lambda x: x.time, default=by)

    # -- all together ------------------------------------------------------------------------------------------------

    def __call__(self) -> None:
        """Decides. After OutOfTime the result so far stays, not certified."""
        self.find_basis()
        try:
            self.base = self.reference = self.best = self.lean = self.first()
            self.trials.states = self.base.result
        except OutOfTime:
            raise ValueError("budget: is over before the scene's own model could be run; give more") from None
        self.notes += [note] if (note := self.models.start.note) else []
        assert self.base.result is not None
        arm = self.base.result.arm
        self.first_frequency = first_frequency(arm)
        most = {key: float(x.max()) for key, x in readings(arm, self.base.result, self.first_frequency).items()}
        self.spin, self.rotation = ({k: x for (name, k), x in most.items() if name == kind}
                                    for kind in ("spin", "rotation"))  # fmt: skip
        try:
            self.decide()
        except OutOfTime:
            self.reasons.append("the time for deciding was used up")
        self.find_unstable()

    def decide(self) -> None:
        self.tell("a rich model")
        reference = self.attempt(self.relevant(self.enriched(0), self.base))
        if reference.values is None:
            reference = self.base  # the check measures its error
        agree = self.in_pieces(reference) if self.models.jumps else self.by_more_shapes(reference)
        if self.check is None:
            return
        self.reduce()
        self.integrate()
        if self.check.values is None:
            self.reasons.append(f"the check, {self.models.label(self.check.model)}, cannot be run: {self.check.reason}")
            return
        self.off = self.trials.distance(self.lean, self.check)
        if not agree or self.off > self.tol - _REMAINDER * self.gap - self.lost:
            self.reasons.append(
                f"against the check the lean run is off by {self.off:.2g}, and one of a poorer model by {self.gap:.2g}"
                f"; tolerance {self.tol:.2g}{f'; {self.advice}' if self.models.jumps else ''}"
            )

    @property
    def advice(self) -> str:
        """What mends strains that jump."""
        return (
            f"strains jump at {self.models.cuts}, which smooth shapes follow slowly: cut the beam there, "
            "Arm([*fa.split(link), ...])"
        )

    def checked(self, beside: Run, rich: Model) -> bool:
        """Runs the check; whether the run beside it agrees with it."""
        self.tell("check")
        self.check = self.attempt(rich, finer=True)
        self.gap = self.trials.distance(beside, self.check)
        return self.gap <= _AGREE * self.tol

    def by_more_shapes(self, reference: Run) -> bool:
        """Finds a reference that agrees with a richer model: the check of one that does not is the next."""
        for k in range(_ROUNDS):
            assert reference.values is not None
            self.measure.set_span(reference.values)
            self.reference = reference
            if self.checked(reference, self.affordable(self.enriched(2 * k, reference.model), reference.model)):
                return True
            assert self.check is not None
            if self.check.values is None:  # for example with switching friction and fast shear
                few = self.affordable(reference.model)
                reference = self.attempt(few)
                if few == self.reference.model or reference.values is None:
                    return False
                self.notes.append(f"nothing could be run with shear and extension, estimated at {self.lost:.1g}")
            elif k + 1 < _ROUNDS:
                reference = self.check
                self.trials.setting = {k: v for k, v in reference.options.items() if k != "stages"} | {"stages": 4}
        return False

    def in_pieces(self, reference: Run) -> bool:
        """If strains jump, models with smooth shapes agree with each other before they are accurate. Errors are then
        taken from beams in pieces. The reference gets as many modes as it needs to come near these."""
        self.reference = reference
        if self.models.pinned or callable(self.measure.quantity):
            why = self.models.pinned or "the quantity is a function, which may count on the links"
            self.reasons.append(f"{self.advice}; the check cannot, as {why}")
            return False
        rich = replace(self.affordable(self.enriched(0, reference.model), reference.model), pieces=True)
        many = {k: 1 + len(places) for k, places in self.models.jumps.items()}
        more = rich.each(lambda k, b: replace(b, counts=tuple(n and n + many.get(k, 1) for n in b.counts)))
        self.tell("beams in pieces")
        cut = self.attempt(rich)
        if cut.values is not None:
            self.measure.set_span(cut.values)
        agree = self.checked(cut, more)
        for k in range(_ROUNDS):
            if not agree or reference.values is None or self.check is None or self.check.values is None:
                break
            self.reference = reference
            if self.good(reference, _GOAL):
                return True
            reference = self.attempt(self.enriched(2 * k + 1, self.reference.model))
        return False

    def find_unstable(self) -> None:
        """Tests whether disturbances of motions that symmetry excludes stay small."""
        run = self.reference
        if self.models.pinned or run.result is None:
            return
        rich = self.enriched(0, all_strains=True)

        def few(k: int, own: BeamModel) -> BeamModel:
            numbers = tuple(n or min(m, 2) for n, m in zip(own.counts, rich.counts(k), strict=True))
            return BeamModel(numbers, "exact", True, None, own.basis)

        try:
            scene = self.models.at(run.model.each(few), {})
            moves = excited(scene)
            for rows in _ROWS:
                result = run.result if rows < _ROWS[-1] else self.trials.at_rows(run, rows)
                grown = growth(scene, result, moves, rows)
                if grown <= _GROWTH:
                    return
        except ValueError as e:
            self.notes.append(f"the stability of motions that symmetry excludes could not be tested: {e}")
            return
        left = [name for name, moving in zip(scene.arm.coordinates, moves, strict=True) if not moving]
        self.reasons.append(
            f"the motion is unstable: by symmetry {left[0]}{' and others stay' if left[1:] else ' stays'} at zero, "
            f"but a disturbance of them grows {grown:.2g} times within the run; add them to the scene"
        )

    def by_order(self) -> dict[int | str, float]:
        """Estimated error of the rich model by the order of all its beams."""
        known = [part for part in self.sources.changes if part[0] == ORDER] if self.sources else []
        parts = {order: [part for part in known if part[2] == order] for order in self.models.orders}
        return {order: self.sources.size_of(*some) for order, some in parts.items() if some and self.sources}
