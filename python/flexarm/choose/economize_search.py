"""The search of `economize`: indicators first, then models verified by simulation, then an independent check."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from .._check import Array
from ..arm.arm import Arm
from ..model.acting.drive import split_drives
from ..model.parts.beam import STRAINS
from ..run.scene.scene import Scene
from ..run.watch import first_frequency, readings
from .decisions import DECISIONS, Evidence, keys
from .descent import Descent, differs, finer, settle
from .enrich import enriched, moving_strains
from .indicators import excited, growth, indicate
from .measures import Measure, times_to_compare
from .models import ORDERS, BeamModel, Model, Models
from .states import some_rows
from .trials import Budget, OutOfTime, Run, Trials, by_tolerance

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

    def __init__(self, scene: Scene, measure: Measure, tol: float, budget: Budget, tell: Callable[[str], None]) -> None:
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
        model = enriched(self.models, extra, None if all_strains else self.reached, than)
        return model if than is None and not self.rebase else self.models.rebased(model)

    def richer(self, lean: Model) -> Model:
        """The enriched model, with all coordinates of the lean one."""
        model = self.models.rebased(self.enriched(0)) if lean.basis else self.enriched(0)
        return model.each(lambda k, b: replace(b, counts=tuple(map(max, b.counts, lean.counts(k)))))

    def find_symmetry(self) -> None:
        """Finds the strains of each link that are excited, directly or through others."""
        self.reached = moving_strains(self.models)

    def find_basis(self) -> None:
        """Finds `own`, the scene's model without dormant coordinates. Legendre polynomials replace the scene's basis,
        at the same count, if their first frequency (an upper bound, by Ritz's method) is lower by more than the
        tolerance allows, or patches are driven."""

        def moving(k: int, beam: BeamModel) -> BeamModel:
            return replace(beam, counts=tuple(n * bool(m) for n, m in zip(beam.counts, self.reached[k], strict=True)))

        self.own = self.models.given.each(moving)
        other = self.models.rebased(self.own)
        if other == self.own:
            return
        w, better = (first_frequency(self.models.arm(model)) for model in (self.own, other))
        self.rebase = bool(split_drives(self.scene.arm, self.scene.drive)[1]) or w - better > 0.1 * self.tol * w
        self.own = other if self.rebase else self.own

    # -- indicators --------------------------------------------------------------------------------------------------

    def estimate(self, rich: Model, evidence: Evidence) -> None:
        """Estimates the effect of each coordinate of the rich model and of each order from the run of the base."""
        base = evidence.base.result
        assert base is not None
        scene = self.models.at(rich, {})
        sizes, _ = indicate(scene, base, self.measure, {})
        evidence.share = {key: x for key, x in zip(keys(scene.arm), sizes.tolist(), strict=True) if key[0] >= 0}
        evidence.by_order, evidence.lacking = self._poorer(evidence.base)
        evidence.first_frequency = first_frequency(base.arm)
        most = {key: float(x.max()) for key, x in readings(base.arm, base, evidence.first_frequency).items()}
        evidence.spin, evidence.rotation = ({k: x for (name, k), x in most.items() if name == kind}
                                      for kind in ("spin", "rotation"))  # fmt: skip

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
        _, errors = indicate(self.models.at(exact, {}), base.result, self.measure, variants)
        by_order = {order: errors.pop(order) for order in ORDERS if order in errors}
        return {**by_order, "exact": 0.0}, errors

    def relevant(self, rich: Model, evidence: Evidence) -> Model:
        """The rich model reduced to coordinates with an estimated effect; it keeps those of the base."""
        small, share, base = _SMALL * self.tol, evidence.share, evidence.base.model

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
        for model in dict.fromkeys((self.own, self.own.but(order="exact"))):
            self.tell("the scene's own model")
            trial = settle(self.trials, model, self.tol)
            if trial is not None:
                return trial
        reasons = [t.reason for t in self.trials.runs.values() if t.reason]
        why = reasons[0] if reasons else "no setting of any integrator agrees with the next finer one"
        raise ValueError(f"scene: cannot be run to this tolerance: {why}")

    def __call__(self) -> Evidence:
        """Decides. After OutOfTime the result so far is returned, not certified."""
        self.find_symmetry()
        self.find_basis()
        try:
            base = self.start()
        except OutOfTime:
            raise ValueError("budget: is over before the scene's own model could be run; give more") from None
        assert base.values is not None
        if not self.measure.span:
            self.measure.set_span(base.values)
        self.trials.states = base.result
        evidence = Evidence(self.trials, self.tol, base)
        evidence.notes += [note] if (note := self.models.start.note) else []
        evidence.dormant = {k: tuple(s for s, r in zip(STRAINS, reached, strict=True) if not r)
                         for k, reached in self.reached.items()}  # fmt: skip
        try:
            self._decide(evidence)
        except OutOfTime:
            evidence.reasons.append("the time for deciding was used up")
        self.find_unstable(evidence)
        return evidence

    def find_unstable(self, evidence: Evidence) -> None:
        """Tests whether disturbances of motions that symmetry excludes stay small."""
        run = evidence.reference
        if self.models.pinned or run.result is None:
            return
        rich, lean = self.enriched(0, all_strains=True), run.model

        def few(k: int, own: BeamModel) -> BeamModel:
            numbers = tuple(n or min(m, 2) for n, m in zip(own.counts, rich.counts(k), strict=True))
            return BeamModel(numbers, "exact", True, None, own.basis)

        try:
            scene = self.models.at(lean.each(few), {})
            moves = excited(scene)
            for rows in (31, 241, _MANY_ROWS):  # too few rows for fast vibrations show false growth
                result = run.result if rows < _MANY_ROWS else self.trials.at_rows(run, rows)
                grown = growth(scene, result, moves, rows)
                if grown <= _GROWTH:
                    return
        except ValueError as e:
            evidence.notes.append(f"the stability of motions that symmetry excludes could not be tested: {e}")
            return
        left = [name for name, moving in zip(scene.arm.coordinates, moves, strict=True) if not moving]
        evidence.reasons.append(
            f"the motion is unstable: by symmetry {left[0]}{' and others stay' if left[1:] else ' stays'} at zero, "
            f"but a disturbance of them grows {grown:.2g} times within the run; add them to the scene"
        )

    def attempt(self, model: Model, options: dict[str, Any], whole: bool, base: Run) -> Run:
        """A run of a model; if it fails, one with finer steps, or with variable steps.

        Args:
            whole: with all output times, where the integrator has fixed steps. base: a run whose time is usual.
        """
        setting, slow, most = self.trials.setting, by_tolerance(1e-6), max(10.0, 100.0 * base.time)
        finer_steps = [{**setting, "step": setting["step"] / k} for k in (8, 64)] if "step" in setting else []
        for tried in (options, *finer_steps, slow, {**slow, "max_order": 2}):
            run = self.trials.run(model, tried, whole=whole and "step" in tried, most=most)
            if run.values is not None:
                break
            most = max(5.0, 0.5 * self.trials.seconds)
        return run

    def checked(self, rich: Model, evidence: Evidence) -> Run:
        """A run of the enriched model with finer steps at all output times. If no integrator completes it (for example
        with switching friction and fast shear), shear and extension are left out if their estimated effect is small; a
        note tells."""
        options, evidence.notes = finer(self.trials, evidence.reference), evidence.notes[: bool(self.models.start.note)]
        check = self.attempt(rich, options, True, evidence.base)
        few = self.as_in(rich, evidence.reference.model, _FAST)
        lost = self.effect(evidence, _FAST)
        if check.values is None and few != rich and lost <= _SMALL * self.tol:
            check = self.attempt(few, options, True, evidence.base)
            evidence.notes.append(f"the check could not be run with shear and extension, estimated at {lost:.1g}")
        return check

    def worth_a_check(self, rich: Model, evidence: Evidence) -> Model:
        """The enriched model with the extension of the reference, if more has a small estimated effect: a beam that is
        stiff in extension needs very short steps."""
        small = self.effect(evidence, (_EXTENSION,)) <= _SMALL * self.tol
        return self.as_in(rich, evidence.reference.model, (_EXTENSION,)) if small else rich

    @staticmethod
    def effect(evidence: Evidence, strains: tuple[int, ...]) -> float:
        """The largest estimated effect of a coordinate of these strains."""
        return max((x for (_, s, _), x in evidence.share.items() if s in strains), default=0.0)

    @staticmethod
    def as_in(rich: Model, other: Model, strains: tuple[int, ...]) -> Model:
        """The rich model with the other's numbers of shapes of these strains."""

        def change(k: int, beam: BeamModel) -> BeamModel:
            counts = enumerate(zip(beam.counts, other.counts(k), strict=True))
            return replace(beam, counts=tuple(own if s in strains else n for s, (n, own) in counts))

        return rich.each(change)

    def _decide(self, evidence: Evidence) -> None:
        rich = self.enriched(0)
        self.tell("indicators")
        self.estimate(rich, evidence)
        reference = self.attempt(self.relevant(rich, evidence), self.trials.setting, False, evidence.base)
        if reference.values is None:
            reference = evidence.base  # the check measures its error
        if self.models.jumps:
            self._in_pieces(evidence, reference)
            return
        for k in range(_ROUNDS):
            assert reference.values is not None
            self.measure.set_span(reference.values)
            evidence.reference = evidence.judge = reference
            rich = self.worth_a_check(self.enriched(k, reference.model), evidence)
            if self._descended(evidence, rich) or evidence.check is None or evidence.check.values is None:
                return
            reference, self.trials.setting = evidence.check, evidence.check.options

    def _descended(self, evidence: Evidence, rich: Model) -> bool:
        """Makes the descent and its check; returns whether they agree."""
        evidence.reasons, evidence.check = [], None
        down = Descent(evidence, self.tell)
        model = down.reduce()
        self.tell("integrators")
        evidence.lean, evidence.settings = down.integrate(model)
        self.tell("check")
        check = evidence.check = self.checked(rich, evidence)
        if check.values is None:
            evidence.reasons.append(f"the check, {self.models.label(rich)}, cannot be run: {check.reason}")
            return False
        if not (differs(check, evidence.judge) and differs(check, evidence.lean)):
            evidence.reasons.append(f"the check took no more steps, {check.steps}, than the run it checks")
            evidence.check = None
            return False
        evidence.off = self.trials.distance(evidence.lean, check)
        evidence.gap = self.trials.distance(evidence.judge, check)
        if evidence.off + _REMAINDER * evidence.gap <= self.tol and evidence.gap <= _AGREE * self.tol:
            return True
        evidence.reasons = [
            f"against the check it is off by {evidence.off:.2g}, and the reference, against which choices were "
            f"made, by {evidence.gap:.2g}; tolerance {self.tol:.2g}"
        ]
        return False

    def _in_pieces(self, evidence: Evidence, reference: Run) -> None:
        """If strains jump, models with smooth shapes agree with each other before they are accurate. Errors are then
        taken from beams in pieces from the start, also in the check. The reference gets as many modes as it needs to
        come near these."""
        if self.models.pinned or callable(self.measure.quantity):
            why = self.models.pinned or "the quantity is a function, which may count on the links"
            evidence.reasons.append(f"{self.advice}; the check cannot, as {why}")
            return
        evidence.reference = reference
        rich = replace(self.worth_a_check(self.enriched(0, reference.model), evidence), pieces=True)
        self.tell("beams in pieces")
        judge, near = self.trials.run(rich, most=max(10.0, 100.0 * evidence.base.time)), False
        for k in range(_ROUNDS):
            if judge.values is None or reference.values is None:
                break
            self.measure.set_span(judge.values)
            evidence.reference = reference
            near = self.trials.distance(reference, judge) <= _NEAR * self.tol
            if near:
                break
            reference = self.trials.run(self.enriched(2 * k + 1, evidence.reference.model))
        evidence.judge = judge if near else evidence.reference  # too far from the pieces: the check reports it
        many = {k: 1 + len(places) for k, places in self.models.jumps.items()}
        more = rich.each(lambda k, b: replace(b, counts=tuple(n and n + many.get(k, 1) for n in b.counts)))
        if not self._descended(evidence, more) and evidence.check is not None:
            evidence.reasons[0] += f"; {self.advice}"

    @property
    def advice(self) -> str:
        """Advice for a scene with beams whose strains jump."""
        return (
            f"strains jump at {self.models.cuts}, which smooth shapes follow slowly: cut the beam there, "
            "Arm([*fa.split(link), ...])"
        )
