"""The runs of `flexarm chart`, and their order."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..run.integrators import INTEGRATORS
from ..run.scene.scene import Scene
from .measures import Measure
from .models import Model, Models
from .states import some_rows
from .trials import (
    BY_TOLERANCE,
    CHOSEN,
    LINES,
    OVER_OUTPUTS,
    Budget,
    Run,
    Trials,
    line_options,
    line_settings,
    stable_step,
)

_REFERENCE = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)  # rtol of the truth, until two agree to
_AGREE = 1e-8
_FINEST = 3e-7  # lines end at this error
_WORST = 0.1  # models of a larger error are not timed at other settings
_SHARE = 0.1  # of the budget: the most for a run
_EXTRA_MODES = 2  # additional modes of the truth in Legendre polynomials
_DIVERGED = 100.0  # a larger error counts as a failure
_TRUE = (CHOSEN, "ida", "gauss", "implicit")  # what finds a truth, in turn
_SAMPLES = 501  # times at which trajectories are compared
_REPEATS = 3  # of short runs; the least time counts


def best(rows: Iterable[Run], least: float = 0.0) -> list[Run]:
    """The rows that no other beats in both time and error, fastest first; errors below `least` count as `least`."""
    graded = sorted((r.time, max(r.error, least), k, r) for k, r in enumerate(rows) if r.error is not None)
    front: list[Run] = []
    lowest = np.inf
    for _, error, _, row in graded:
        if error < lowest:
            front.append(row)
            lowest = error
    return front


@dataclass(frozen=True)
class Truth:
    """The run from which errors are measured, and its convergence: over the span, its distances from the next poorer
    runs; None where there is none, inf where it was not run. (Modes of a free beam converge slowly under a payload,
    which one mode less hardly shows; another basis does. Smooth modes converge slowly where strains jump.)
    """

    row: Run  #: the richest model, at a tolerance of negligible error
    span: dict[str, float]  #: by unit, the largest range of any one component of the quantity
    modes: float | None  #: one mode less for each strain
    order: float | None  #: the next lower order
    tolerance: float  #: the next looser tolerance, or step
    basis: float | None  #: the scene's basis; None: it is this, or Legendre polynomials are impossible
    pieces: float | None  #: its beams in pieces; None: no strain jumps
    poorer: dict[str, str]  #: labels of those other runs

    @property
    def uncertainty(self) -> float:
        """The largest of the distances that bound the truth's error. With exact rotation, `order` does not count; with
        the scene's basis in Legendre polynomials, neither does `basis`."""
        order = None if self.row.model.order == "exact" else self.order
        basis = None if self.row.model.basis else self.basis
        return max((d for d in (self.modes, order, self.tolerance, basis, self.pieces) if d is not None), default=0.0)

    def to_dict(self) -> dict[str, Any]:
        keep = {k: getattr(self, k) for k in ("span", "modes", "order", "tolerance", "basis", "pieces",
                                               "uncertainty", "poorer")}  # fmt: skip
        return {"run": self.row.to_dict(), **keep}


class ChartSearch:
    """Runs models of a scene with all integrators, and stores every row.

    Args:
        scene: the scene.
        quantity: "tip", "joint" or "strain".
        budget: wall time (s).
        tell: called with (seconds used, present activity).

    Attributes:
        rows: all runs so far.
        truth: the richest converged run; `looser` the same at the next looser tolerance, `tolerance` their distance.
        near: by the difference from the truth, a run: one mode less per strain ("modes"), the next order ("order"), the
            scene's basis ("basis"), beams in pieces ("pieces").
        bases: the bases of the chart; "": the scene's. broken: models that cannot begin. slow: lines that are.
    """

    def __init__(self, scene: Scene, quantity: str, budget: float, tell: Callable[[float, str], None]) -> None:
        self.scene, self.tell = scene, tell
        self.models, self.measure, self.budget = Models(scene), Measure(scene, quantity), Budget(budget)
        times = scene.t[some_rows(len(scene.t), _SAMPLES)]
        self.trials = Trials(self.models, self.measure, times, Budget(), keep=False)  # `run` gives each its share
        self.truth: Run | None = None
        self.looser: Run | None = None
        self.tolerance = np.inf
        self.broken: set[Model] = set()
        self.slow: set[str] = set()
        self.near: dict[str, Run] = {}
        self.shifts, self.orders = self.models.shifts, self.models.orders
        given = self.models.uniform(self.orders[-1], 0)
        others = ("legendre", "loaded", "clamped-free")
        self.bases = ["", *(basis for basis in others if self.models.rebased(given, basis) != given)]

    @property
    def rows(self) -> list[Run]:
        return list(self.trials.runs.values())

    @property
    def used(self) -> float:
        return self.budget.used

    def __call__(self) -> None:
        """Runs truth, orders, modes, integrators and their settings, and repeats runs of nearly equal time."""
        if not self.reference():
            return
        survivors = self.rank()
        for model, floor in survivors:
            for choice in sorted(LINES, key=lambda choice: choice not in (CHOSEN, *OVER_OUTPUTS)):
                self.line(model, choice, floor)
        self.settle()

    def conclude(self) -> Truth | None:
        """The truth with its convergence; None if there is none."""
        if self.truth is None:
            return None
        possible = {"modes": len(self.shifts) > 1 or bool(self.truth.model.basis), "order": len(self.orders) > 1,
                    "basis": "legendre" in self.bases, "pieces": bool(self.models.jumps)}  # fmt: skip
        errors = {k: (row.error, row.model.label) for k, row in self.near.items() if row.error is not None}
        distances = {k: errors[k][0] if k in errors else math.inf if may else None for k, may in possible.items()}
        poorer = {k: label for k, (_, label) in errors.items()}
        if self.looser is not None:
            poorer["tolerance"] = f"{self.looser.setting} {self.looser.value:.3g}"
        return Truth(self.truth, self.measure.span, tolerance=self.tolerance, poorer=poorer, **distances)

    # -- one run -----------------------------------------------------------------------------------------------------

    def size(self, row: Run) -> int:
        return self.models.arm(row.model).nv

    def predict(self, row: Run) -> float:
        """Predicted wall time (s) of a run, from similar ones; 0 if there are none."""
        nv = self.size(row)
        like = [r for r in self.rows if r.choice == row.choice]
        rank = {r: self.orders.index(r.model.order) for r in [row, *like]}
        # if an easier run was cut off, this one takes at least as long
        easier = (r for r in like if r.value >= row.value and self.size(r) <= nv and rank[r] <= rank[row])
        cut = [r.time for r in easier if r.status == "cut"]
        done = [r for r in like if r.status == "ok"]
        own = [r for r in done if r.model == row.model]
        if own:
            near = min(own, key=lambda r: abs(np.log(r.value / row.value)))
            growth = near.value / row.value  # like the number of steps, or for order p its power 1 / (p + 1)
            order = 0 if row.setting == "step" else row.options.get("max_order", 5)
            return max([*cut, float(near.time * growth ** (1 / (1 + order)))])
        above = [r for r in done if r.value == row.value and rank[r] >= rank[row]]
        return max([*cut, min((r.time * (nv / max(1, self.size(r))) ** 2 for r in above), default=0.0)])

    def planned(self, model: Model, choice: str, value: float) -> Run:
        """The record of this run if it was made before, or a new one."""
        run = Run(model, line_options(self.scene, choice, float(value)), choice, True)
        return self.trials.runs.get(run.key, run)

    def skip(self, row: Run, guess: float, reason: str) -> Run:
        return self.trials.store(replace(row, status="skipped", time=guess, reason=reason))

    def run(self, model: Model, choice: str, value: float, share: float) -> Run:
        """Makes this run, unless it was made before or is predicted to take more than its share of the budget."""
        allowed = min(share * self.budget.seconds, self.budget.left)
        row = self.planned(model, choice, value)
        if row.key in self.trials.runs and (row.status in ("ok", "failed") or row.time >= allowed):
            return row
        guess = self.predict(row)
        if allowed <= 0 or guess * self.trials.busy > allowed:
            left = f"predicted {guess:.2g} s, with {allowed:.2g} s left to it"
            return self.skip(row, guess, "the budget is used up" if allowed <= 0 else left)

        def tell() -> None:
            self.tell(self.used, row.label)

        tell()
        row = self.trials.run(model, row.options, True, allowed, choice, _REPEATS, tell)
        if row.status == "failed" and row.steps == 0 and "ran away" not in row.reason:
            self.broken.add(model)  # it cannot begin
        if row.status == "cut":
            row.reason = f"given up after {row.time:.2g} s, its share of the budget"
        self.grade(row)
        return row

    def grade(self, row: Run) -> None:
        if self.truth is None or self.truth.values is None or row.values is None:
            return
        row.error = self.trials.distance(row, self.truth)
        row.absolute = self.measure.by_unit(row.values, self.truth.values)
        if not row.error < _DIVERGED:
            row.status, row.reason = "failed", f"the motion ran away, to {row.error:.1e} times the span"
            row.error, row.absolute = None, {}

    def time_again(self, row: Run) -> None:
        """Times a row once more and keeps its best time, if the budget suffices."""
        if 1.5 * row.time < self.budget.left:
            self.trials.time_again(row, self.budget.left, _REPEATS)

    # -- stages ------------------------------------------------------------------------------------------------------

    def reference(self) -> bool:
        """Finds the truth: the richest model that can be run, at a tolerance of negligible error."""
        for order in reversed(self.orders):
            for basis in ("legendre", "") if "legendre" in self.bases else ("",):
                for shift in reversed(self.shifts[-3:]):
                    if self._converge(self.models.uniform(order, shift + _EXTRA_MODES * bool(basis), basis)):
                        for row in self.rows:
                            self.grade(row)
                        return True
                    if self.budget.left <= 0:
                        return False
        return False

    def _converge(self, model: Model) -> bool:
        """Finds the truth among runs of a model in ever finer steps. They are compared with those of the poorer models
        that tell how far it is known, so each may take a tenth of the budget."""
        for choice in _TRUE:
            before: Run | None = None
            values = _REFERENCE if choice in BY_TOLERANCE else line_settings(self.scene, choice)
            for value in values if model not in self.broken else ():
                row = self.run(model, choice, value, _SHARE)
                if row.status in ("skipped", "cut"):
                    return self.tolerance < np.inf  # else a poorer model may be known better
                if row.status == "failed":
                    break
                assert row.values is not None
                if not self.measure.span:
                    self.measure.set_span(row.values)
                if before is not None:
                    d = self.trials.distance(row, before)
                    if d < self.tolerance:
                        self.truth, self.looser, self.tolerance = row, before, d
                    if d < _AGREE:
                        return True
                elif self.truth is None:
                    self.truth = row
                before = row
            if self.tolerance < 1e-6:
                return True
        return self.tolerance < np.inf

    def rank(self) -> list[tuple[Model, float]]:
        """The models to time, fastest first, each with its own error. Runs the orders first, then fewer modes."""
        assert self.truth is not None
        choice, value, rich = self.truth.choice, self.truth.value, self.truth.model
        orders = self.orders[: self.orders.index(rich.order) + 1]
        spare = _EXTRA_MODES * bool(rich.basis)
        shifts = self.shifts[: self.shifts.index(rich.shift - spare) + 1]
        near = {"order": rich.but(order=orders[-2])} if len(orders) > 1 else {}
        if rich.basis:
            near["basis"] = self.models.uniform(rich.order, shifts[-1], "")
        if rich.basis or len(shifts) > 1:
            near["modes"] = self.models.uniform(rich.order, rich.shift - 1, rich.basis)
        if self.models.jumps and not self.models.pinned:
            near["pieces"] = replace(rich, pieces=True)
        for name, model in near.items():
            self.near[name] = self.run(model, choice, value, _SHARE)
        rows = [self.truth]
        for basis in self.bases if rich.basis else ("",):
            at_order = [
                self.run(self.models.uniform(o, shifts[-1], basis), choice, value, _SHARE) for o in reversed(orders)
            ]
            rows += at_order
            for row in best(r for r in at_order if r.status == "ok"):
                for shift in reversed(shifts[:-1]):
                    fewer = self.run(self.models.uniform(row.model.order, shift, basis), choice, value, _SHARE)
                    rows.append(fewer)
                    if fewer.error is not None and fewer.error > _WORST:
                        break
        own = self.own_model()
        if own is not None:
            rows.append(self.run(own, choice, value, _SHARE))
        found = {r.model: r for r in best(rows) if r.error is not None and r.error <= _WORST}
        found |= {r.model: r for r in rows if r.model == own and r.error is not None}
        by_time = sorted(found.values(), key=lambda r: r.time)
        return [(r.model, r.error) for r in by_time if r.error is not None]

    def own_model(self) -> Model | None:
        """The scene's own model; None if its beams have different orders."""
        return self.models.given if len({beam.order for beam in self.models.given.elastic}) <= 1 else None

    def line(self, model: Model, choice: str, own_error: float) -> None:
        """Runs one line of the chart: tighter settings until only the model's own error remains. It ends at a failure;
        an explicit integrator goes on at the first step that is stable. What was too slow for a faster model is not
        asked again."""
        own = model == self.own_model()
        if model in self.broken or (choice in self.slow and not own):
            return
        floor = max(1.1 * own_error, _FINEST)
        stale, lowest, most = 0, np.inf, np.inf
        patience = 30 if own else 3  # keep a slow line of the scene's own model
        for value in line_settings(self.scene, choice):
            if value > most:
                continue
            row = self.planned(model, choice, value)
            guess = self.predict(row)
            beaten = [r for r in self.rows if r.error is not None and r.error <= floor and patience * r.time < guess]
            if beaten and row.key not in self.trials.runs:
                other = min(beaten, key=lambda r: r.time).label
                self.skip(row, guess, f"predicted {guess:.2g} s, where {other} has no more error")
                return
            good = min((r.time for r in self.rows if r.error is not None and r.error <= floor), default=np.inf)
            enough = (patience * good + 0.1) / self.budget.seconds  # a slower run would be beaten, too
            row = self.run(model, choice, value, min(_SHARE, enough))
            if row.status in ("skipped", "cut"):
                if lowest == np.inf:
                    self.slow.add(choice)
                return
            if row.error is None:
                if most < np.inf or not INTEGRATORS[LINES[choice]["integrator"]].explicit:
                    return
                most = min(stable_step(self.models.at(model, {}), value), value / 2)
                continue
            stale = stale + 1 if row.error > 0.9 * lowest else 0
            lowest = min(lowest, row.error)
            if row.error <= floor or stale == 3:
                return

    def settle(self) -> None:
        """Times the rows on or near the front once more, to reduce noise of the timing."""
        rows = [r for r in self.rows if r is not self.truth and not r.model.pieces]
        graded = [(r, max(r.error, _FINEST)) for r in rows if r.error is not None]
        for row, error in graded:
            if not any(e <= error and 1.5 * r.time < row.time for r, e in graded):
                self.tell(self.used, f"again: {row.label}")
                self.time_again(row)
