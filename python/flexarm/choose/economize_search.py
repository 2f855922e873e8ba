"""The search of `economize`: indicators first, then models verified by simulation, then an independent check."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

import flexarm._core as _core

from .._check import Array
from ..arm.arm import Arm
from ..model.acting.drive import split_drives
from ..model.parts.beam import STRAINS
from ..run.scene.scene import Scene
from ..run.watch import first_frequency, readings
from .coordinates import some_rows
from .decisions import DECISIONS
from .descent import Descent
from .findings import Estimates, Findings, keys
from .indicators import Indicators
from .integrators import by_tolerance
from .measures import Measure
from .models import ORDERS, BeamModel, Model, Models
from .steps import differs, finer, settle
from .symmetry import excited, growth
from .times import times_to_compare
from .trials import Budget, OutOfTime, Run, Trials

_SMALL = 1 / 30  # of the tolerance: coordinates of a smaller estimated effect are not in the reference
_AGREE = 1 / 3  # of the tolerance: largest distance between reference and check
_REMAINDER = 1.5  # times the gap: error that may remain beyond the check, if convergence is slow
_NEAR = 0.6  # of the tolerance: largest distance of smooth shapes from a beam in pieces
_ROUNDS = 3  # most references
#: strains whose modes are the fastest
_EXTENSION = STRAINS.index("extension")
_FAST = (*(s for s, name in enumerate(STRAINS) if name.startswith("shear")), _EXTENSION)
_MANY_ROWS = 1601  # rows for a second test of growth, if fewer show some
_GROWTH = 100.0  # of motions that symmetry excludes, within the run: above it the run is unstable


class EconomizeSearch:
    """Decides for one scene.

    Args:
        scene: the scene. measure: the quantity. tol: its tolerance. budget: time for deciding. tell: called with the
            present activity.
    """

    def __init__(
        self, scene: Scene, measure: Measure, tol: float, budget: Budget, tell: Callable[[str], None]
    ) -> None:
        self.scene, self.measure, self.tol, self.tell = scene, measure, tol, tell
        self.models = Models(scene)
        # a user's own function of a Result may rely on the scene's output times
        own = scene.t[some_rows(len(scene.t), 400)]
        times = own if callable(measure.quantity) else times_to_compare(scene.t)
        self.trials = Trials(self.models, measure, times, budget)
        self.reached: dict[int, Array] = {}
        self.rebase = False

    # -- models ------------------------------------------------------------------------------------------------------

    def enriched(self, extra: int, than: Model | None = None, all_strains: bool = False) -> Model:
        """A model with `extra` modes more than the scene of every strain that symmetry allows, and exact rotation.

        Args:
            all_strains: include the strains that symmetry keeps at rest.
            than: have more modes of every strain than this model, too, in Legendre polynomials where possible.
        """
        many = sum(beam is not None for beam in self.models.given.beams) > 4
        bends = [field.bending for field in _core.STRAIN_FIELDS]
        least = [2 if bend else 1 for bend in bends] if many else [4 if bend else 2 for bend in bends]
        more = [1 if bend else 0 for bend in bends] if many else [2 if bend else 1 for bend in bends]

        def rich(k: int, beam: BeamModel) -> BeamModel:
            numbers, most = [], self.models.most(k)
            for s, n in enumerate(beam.counts):
                want = n
                if not (self.models.pinned or self.models.own_shapes(k, s)):
                    want = max(n + more[s], least[s]) + (1 + bends[s]) * extra
                    want = want if than is None else max(want, than.counts(k)[s] + 1 + bends[s])
                limit = most[s]
                want = want if limit is None else min(want, limit)
                numbers.append(want if all_strains or k not in self.reached or self.reached[k][s] else 0)
            return BeamModel(tuple(numbers), "exact", True)

        model = self.models.given.each(rich)
        return self._based(model) if than is None else self._rebased(model)

    def richer(self, lean: Model) -> Model:
        """The enriched model, with all coordinates of the lean one."""
        model = self._rebased(self.enriched(0)) if lean.basis else self.enriched(0)
        return model.each(lambda k, b: replace(b, counts=tuple(map(max, b.counts, lean.counts(k)))))

    def _rebased(self, model: Model) -> Model:
        """The model in Legendre polynomials, unless something reads the elastic coordinates by number."""
        return model if self.models.pinned else self.models.rebased(model)

    def _based(self, model: Model) -> Model:
        return self._rebased(model) if self.rebase else model

    def find_symmetry(self) -> None:
        """Finds the strains of each link that are excited, directly or through others."""
        few = self.enriched(0).each(lambda k, b: BeamModel(tuple(min(n, 2) for n in b.counts), 2, True))
        scene = self.models.at(few, {})
        moves = excited(scene)
        found = {}
        for k, link in enumerate(scene.arm.links):
            if link.beam is None:
                continue
            at, reached = scene.arm._core.first(k) + link.joint.nv, np.zeros(len(STRAINS), dtype=bool)
            for s, name in enumerate(STRAINS):
                n = link.beam.counts.get(name, 0)
                reached[s], at = moves[at : at + n].any(), at + n
            found[k] = reached if not self.models.pinned else np.array(self.models.given.counts(k)) > 0
        for group in self.models.groups:  # one choice for a group: excited in one link counts for all
            together = np.any([found[k] for k in group], axis=0)
            self.reached |= {k: together for k in group}

    def own(self) -> Model:
        """The scene's model without dormant coordinates."""
        return self._based(self._own())

    def _own(self) -> Model:
        def moving(k: int, beam: BeamModel) -> BeamModel:
            return replace(beam, counts=tuple(n * bool(m) for n, m in zip(beam.counts, self.reached[k], strict=True)))

        return self.models.given.each(moving)

    def find_basis(self) -> None:
        """Decides whether Legendre polynomials replace the scene's basis, at the same count: if their first frequency
        (an upper bound, by Ritz's method) is lower by more than the tolerance allows, or patches are driven."""
        own = self._own()
        other = self._rebased(own)
        if other == own:
            return
        driven = bool(split_drives(self.scene.drive)[1])
        w, better = (first_frequency(self.models.arm(model)) for model in (own, other))
        self.rebase = driven or w - better > 0.1 * self.tol * w

    # -- indicators --------------------------------------------------------------------------------------------------

    def estimate(self, rich: Model, base: Run) -> Estimates:
        """Estimates the effect of each coordinate of the rich model and of each order from a run of the base."""
        assert base.result is not None
        scene, arm = self.models.at(rich, {}), base.result.arm
        found = Indicators(scene, base.result, self.measure, {})
        share = dict(zip(keys(scene.arm), found.share, strict=True))
        share.pop((-1, -1, -1), None)
        by_order, without = self._poorer(base)
        w = first_frequency(arm)
        most = {key: float(values.max()) for key, values in readings(arm, base.result, w).items()}
        spin, turn = ({k: x for (name, k), x in most.items() if name == kind} for kind in ("spin", "rotation"))
        return Estimates(share, by_order, without, spin, turn, w)

    def _poorer(self, base: Run) -> tuple[dict[int | str, float], dict[str, float]]:
        """Estimated errors of each order, and of each decision's variants by name."""
        assert base.result is not None
        exact = base.model.but(order="exact", rotary=True, gauss=None)
        if not exact.elastic:
            return {}, {}
        variants: dict[Any, Arm] = {}
        for decision in DECISIONS:
            for name, model in decision.poorer(self.models, exact).items():
                try:
                    variants[name] = self.models.arm(model)
                except ValueError:
                    continue  # torsion and shear need rotary inertia; order 0 may lack inertia
        found = Indicators(self.models.at(exact, {}), base.result, self.measure, variants).variants
        by_order = {order: found.pop(order) for order in ORDERS if order in found}
        return {**by_order, "exact": 0.0}, found

    def relevant(self, rich: Model, base: Model, estimates: Estimates) -> Model:
        """The rich model reduced to coordinates with an estimated effect; it keeps those of the base."""
        small, share = _SMALL * self.tol, estimates.share

        def matters(k: int, beam: BeamModel) -> BeamModel:
            group, numbers = next(g for g in self.models.groups if k in g), []
            for s, (n, own) in enumerate(zip(beam.counts, base.counts(k), strict=True)):
                seen = [i for i in range(1, n + 1) if max(share[j, s, i] for j in group) > small]
                numbers.append(max([min(own, n), *seen]))
            return replace(beam, counts=tuple(numbers))

        return rich.each(matters)

    # -- all together ------------------------------------------------------------------------------------------------

    def start(self) -> Run:
        """A first run: of the scene's own model if it can be run, else of that with exact rotation."""
        own = self.own()
        exact = own.but(order="exact")
        for model in dict.fromkeys((own, exact)):
            self.tell("the scene's own model")
            trial = settle(self.trials, model, self.tol)
            if trial is not None:
                return trial
        reasons = [t.reason for t in self.trials.runs.values() if t.reason]
        why = reasons[0] if reasons else "no setting of any integrator agrees with the next finer one"
        raise ValueError(f"scene: cannot be run to this tolerance: {why}")

    def __call__(self) -> Findings:
        """Decides. After OutOfTime the result so far is returned, not certified."""
        self.find_symmetry()
        self.find_basis()
        try:
            base = self.start()
        except OutOfTime:
            raise ValueError("time_budget: is over before the scene's own model could be run; give more") from None
        assert base.values is not None
        if not self.measure.span:
            self.measure.set_span(base.values)
        self.trials.states = base.result
        found = Findings(self.trials, self.tol, base)
        found.notes += [note] if (note := self.models.start.note) else []
        found.dormant = {k: tuple(s for s, r in zip(STRAINS, reached, strict=True) if not r)
                         for k, reached in self.reached.items()}  # fmt: skip
        try:
            self._decide(found)
        except OutOfTime:
            found.reasons.append("the time for deciding was used up")
        self.find_unstable(found)
        return found

    def find_unstable(self, found: Findings) -> None:
        """Tests whether disturbances of motions that symmetry excludes stay small."""
        if self.models.pinned or found.reference.result is None:
            return
        rich, lean = self.enriched(0, all_strains=True), found.reference.model

        def few(k: int, own: BeamModel) -> BeamModel:
            numbers = tuple(n or min(m, 2) for n, m in zip(own.counts, rich.counts(k), strict=True))
            return BeamModel(numbers, "exact", True, None, own.basis)

        try:
            scene = self.models.at(lean.each(few), {})
            moves = excited(scene)
            grown = growth(scene, found.reference.result, moves)
            if grown > _GROWTH:
                grown = growth(scene, found.reference.result, moves, 241)
            if grown > _GROWTH:  # too few rows for fast vibrations show false growth
                grown = growth(scene, self.trials.at_rows(found.reference, _MANY_ROWS), moves, _MANY_ROWS)
        except ValueError as e:
            found.notes.append(f"the stability of motions that symmetry excludes could not be tested: {e}")
            return
        if grown > _GROWTH:
            left = [name for name, moving in zip(scene.arm.coordinates, moves, strict=True) if not moving]
            found.reasons.append(
                f"the motion is unstable: by symmetry {left[0]}{' and others stay' if left[1:] else ' stays'} at zero, "
                f"but a disturbance of them grows {grown:.2g} times within the run; add them to the scene"
            )

    def checked(self, rich: Model, found: Findings) -> Run:
        """A run of the enriched model with finer steps at all output times. If no integrator completes it (for example
        with switching friction and fast shear), shear and extension are left out if their estimated effect is small; a
        note tells."""
        reference = found.reference
        options, found.notes = finer(self.trials, reference), found.notes[: bool(self.models.start.note)]
        lost = max((x for (_, s, _), x in found.estimates.share.items() if s in _FAST), default=0.0)

        def without_more(k: int, beam: BeamModel) -> BeamModel:
            numbers = zip(beam.counts, reference.model.counts(k), strict=True)
            return replace(beam, counts=tuple(own if s in _FAST else n for s, (n, own) in enumerate(numbers)))

        without_fast = rich.each(without_more)
        check = self.trials.run(rich, options, whole="step" in options, most=max(10.0, 100.0 * found.base.time))
        if check.values is None:
            check = self.retried(rich, reference)
        if check.values is None and without_fast != rich and lost <= _SMALL * self.tol:
            check = self.trials.run(without_fast, options, whole="step" in options, most=self.patience())
            check = check if check.values is not None else self.retried(without_fast, reference)
            found.notes.append(f"the check could not be run with shear and extension, estimated at {lost:.1g}")
        return check

    def worth_a_check(self, rich: Model, found: Findings) -> Model:
        """The enriched model with the extension of the reference, if more has a small estimated effect: a beam that is
        stiff in extension needs very short steps."""
        lost = max((x for (_, s, _), x in found.estimates.share.items() if s == _EXTENSION), default=0.0)
        if lost > _SMALL * self.tol:
            return rich
        return rich.each(lambda k, b: b.with_count(_EXTENSION, found.reference.model.counts(k)[_EXTENSION]))

    def patience(self) -> float:
        """Time limit (s) for one more attempt at a run that has failed."""
        return max(5.0, 0.5 * self.trials.seconds)

    def retried(self, model: Model, other: Run) -> Run:
        """A run of a model that fails with the present setting: with finer steps, or with variable steps."""
        setting, trial, slow = self.trials.setting, other, by_tolerance(1e-6)
        steps = [{**setting, "step": setting["step"] / k} for k in (8, 64)] if "step" in setting else []
        for options in (*steps, slow, {**slow, "max_order": 2}):
            trial = self.trials.run(model, options, whole="step" in options, most=self.patience())
            if trial.values is not None:
                break
        return trial

    def _decide(self, found: Findings) -> None:
        rich = self.enriched(0)
        self.tell("indicators")
        found.estimates = self.estimate(rich, found.base)
        relevant = self.relevant(rich, found.base.model, found.estimates)
        reference = self.trials.run(relevant, most=max(10.0, 100.0 * found.base.time))
        if reference.values is None:
            reference = self.retried(reference.model, reference)
        if reference.values is None:
            reference = found.base  # the check measures its error
        if self.models.jumps:
            self._in_pieces(found, reference)
            return
        for k in range(_ROUNDS):
            assert reference.values is not None
            self.measure.set_span(reference.values)
            found.reference = found.judge = reference
            rich = self.worth_a_check(self.enriched(k, reference.model), found)
            if self._descended(found, rich) or found.check is None or found.check.values is None:
                return
            reference, self.trials.setting = found.check, found.check.options

    def _descended(self, found: Findings, rich: Model) -> bool:
        """Makes the descent and its check; returns whether they agree."""
        found.reasons, found.check = [], None
        down = Descent(found, self.tell)
        model = down.reduce()
        self.tell("integrators")
        found.lean, found.settings = down.integrate(model)
        self.tell("check")
        check = found.check = self.checked(rich, found)
        if check.values is None:
            found.reasons.append(f"the check, {self.models.label(rich)}, cannot be run: {check.reason}")
            return False
        if not (differs(check, found.judge) and differs(check, found.lean)):
            found.reasons.append(f"the check took no more steps, {check.steps}, than the run it checks")
            found.check = None
            return False
        found.off = self.trials.distance(found.lean, check)
        found.gap = self.trials.distance(found.judge, check)
        if found.off + _REMAINDER * found.gap <= self.tol and found.gap <= _AGREE * self.tol:
            return True
        found.reasons = [
            f"against the check it is off by {found.off:.2g}, and the reference, against which choices were "
            f"made, by {found.gap:.2g}; tolerance {self.tol:.2g}"
        ]
        return False

    def _in_pieces(self, found: Findings, reference: Run) -> None:
        """If strains jump, models with smooth shapes agree with each other before they are accurate. Errors are then
        taken from beams in pieces from the start, also in the check. The reference gets as many modes as it needs to
        come near these."""
        if self.models.pinned or callable(self.measure.quantity):
            why = self.models.pinned or "the quantity is a function, which may count on the links"
            found.reasons.append(f"{self.advice}; the check cannot, as {why}")
            return
        found.reference = reference
        rich = replace(self.worth_a_check(self.enriched(0, reference.model), found), pieces=True)
        self.tell("beams in pieces")
        judge = self.trials.run(rich, most=max(10.0, 100.0 * found.base.time))
        near = False
        for k in range(_ROUNDS):
            if judge.values is None or reference.values is None:
                break
            self.measure.set_span(judge.values)
            found.reference = reference
            near = self.trials.distance(reference, judge) <= _NEAR * self.tol
            if near:
                break
            reference = self.trials.run(self.enriched(2 * k + 1, found.reference.model))
        found.judge = judge if near else found.reference  # too far from the pieces: the check reports it
        many = {k: 1 + len(places) for k, places in self.models.jumps.items()}
        more = rich.each(lambda k, b: replace(b, counts=tuple(n and n + many.get(k, 1) for n in b.counts)))
        if not self._descended(found, more) and found.check is not None:
            found.reasons[0] += f"; {self.advice}"

    @property
    def advice(self) -> str:
        """Advice for a scene with beams whose strains jump."""
        return (
            f"strains jump at {self.models.cuts}, which smooth shapes follow slowly: cut the beam there, "
            "Arm([*fa.split(link), ...])"
        )
