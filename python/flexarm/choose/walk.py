"""The walk over the ladder of models and settings: which runs `flexarm chart` makes, and in which order."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np

from ..run.simulation import INTEGRATORS
from ..scene.scene import Scene
from . import ladder
from .ladder import CHOICES, Model, Row

_REFERENCE = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)  # rtol of the truth, until two agree to
_AGREE = 1e-8
_FINEST = 3e-7  # no line goes below this error
_WORST = 0.1  # models further off are not timed at other settings
_FIRST, _NEXT = 0.2, 0.1  # share of the budget that a run for the truth may take
_SPARE = 2  # modes more that another basis has than the truth
_AWAY = 100.0  # an error that counts as a failure
_FAILURES = 8  # halvings (decades) in a row that may fail


def best(rows: Iterable[Row], least: float = 0.0) -> list[Row]:
    """The rows that no other one beats in both time and error, fastest first; errors below `least` count as that."""
    graded = sorted((r.time, max(r.error, least), k, r) for k, r in enumerate(rows) if r.error is not None)
    front: list[Row] = []
    lowest = np.inf
    for _, error, _, row in graded:
        if error < lowest:
            front.append(row)
            lowest = error
    return front


class Walk:
    """Runs the ladder on a scene, keeping every row.

    Args:
        scene: the scene.
        quantity: "tip", "joint" or "strain".
        budget: wall time (s).
        tell: called with (seconds used, what is being done).

    Attributes:
        rows: all runs so far.
        truth: the richest converged run; `looser` the same at the next looser tolerance, `tolerance` their distance.
        span: the quantity's, by unit.
        poorer: the runs with one mode less per strain ("modes") and of the next order ("order"), and that in another
            basis ("basis"), with modes to spare.
        methods: by integrator, distance of "ci" from "ab" and its time over that of "ab".
    """

    def __init__(self, scene: Scene, quantity: str, budget: float, tell: Callable[[float, str], None]) -> None:
        self.scene, self.quantity, self.budget, self.tell = scene, quantity, budget, tell
        self.started = time.perf_counter()
        self.rows: list[Row] = []
        self.truth: Row | None = None
        self.looser: Row | None = None
        self.tolerance = np.inf
        self.span: dict[str, float] = {}
        self.poorer: dict[str, Row] = {}
        self.methods: dict[str, tuple[float, float]] = {}
        self.shifts, self.orders = ladder.models(scene.arm)
        self.gap = float(np.diff(scene.t).max())
        self._models: dict[tuple[int | str, int], Model] = {}

    @property
    def used(self) -> float:
        return time.perf_counter() - self.started

    def __call__(self) -> None:
        """The whole walk: truth, orders, modes, integrators and their settings, and the close calls again."""
        if not self.reference():
            return
        survivors = self.rank()
        methods = {choice: self.compare_methods(choice) for choice in INTEGRATORS}
        for model, floor in survivors:
            for choice in CHOICES:
                for method in methods.get(choice, ("ab",)):
                    self.line(model, choice, floor, method)
        self.settle()

    def model(self, order: int | str, shift: int) -> Model:
        key = order, shift
        if key not in self._models:
            self._models[key] = ladder.build(self.scene.arm, order, shift)
        return self._models[key]

    def settings(self, choice: str, rtols: Sequence[float] = ()) -> Iterator[float]:
        """From loose to tight; no step is longer than the gap between output times, where those are all met."""
        if CHOICES[choice]["integrator"] in ladder.BY_TOLERANCE:
            yield from rtols or 10.0 ** -np.arange(2, 12)
        else:
            over = CHOICES[choice]["integrator"] in ladder.OVER_OUTPUTS
            longest = max(self.gap, float(np.ptp(self.scene.t)) / 16) if over else self.gap
            yield from longest / 2.0 ** np.arange(16)

    # -- one run -----------------------------------------------------------------------------------------------------

    def predict(self, row: Row) -> float:
        """Wall time (s) of a run, from those like it; 0 if there are none."""
        nv = row.model.arm.nv
        like = [r for r in self.rows if r.choice == row.choice]
        # where an easier one was cut off, this one takes at least as long
        cut = [r.time for r in like if r.status == "cut" and r.value >= row.value and r.model.arm.nv <= nv]
        done = [r for r in like if r.status == "ok"]
        own = [r for r in done if r.model is row.model]
        if own:
            near = min(own, key=lambda r: abs(np.log(r.value / row.value)))
            growth = near.value / row.value  # as the number of steps, but for a method of order p by its 1 / (p + 1)
            order = row.options(self.scene).get("max_order", 5) if row.setting == "rtol" else 0
            return max([*cut, float(near.time * growth ** (1 / (1 + order)))])
        rank = self.orders.index(row.model.order)
        above = [r for r in done if r.value == row.value and self.orders.index(r.model.order) >= rank]
        return max([*cut, min((r.time * (nv / max(1, r.model.arm.nv)) ** 2 for r in above), default=0.0)])

    def find(self, model: Model, choice: str, value: float, method: str) -> Row | None:
        """This run, if it was made or thought of before."""
        for row in self.rows:
            if row.model is model and row.choice == choice and row.value == value and row.method == method:
                return row
        return None

    def run(self, model: Model, choice: str, value: float, share: float, method: str = "ab") -> Row:
        """This run, made now unless it was made before, or is predicted to take more than its share of the budget."""
        allowed = min(share * self.budget, self.budget - self.used)
        known = self.find(model, choice, value, method)
        if known is not None and (known.status in ("ok", "failed") or known.time >= allowed):
            return known
        if known is not None:
            self.rows.remove(known)
        row = Row(model, choice, float(value), method)
        guess = self.predict(row)
        if allowed <= 0 or guess > allowed:
            row.status, row.time = "skipped", guess
            row.reason = (
                "the budget is used up" if allowed <= 0 else f"predicted {guess:.2g} s, with {allowed:.2g} s left to it"
            )
        else:
            self.tell(self.used, row.label)
            deadline = time.perf_counter() + allowed
            ladder.timed(
                self.scene, row, self.quantity, deadline, lambda: self.tell(self.used, row.label)
            )  # fmt: skip
        self.rows.append(row)
        self.grade(row)
        return row

    def grade(self, row: Row) -> None:
        if self.truth is None or self.truth.values is None or row.values is None:
            return
        row.error, row.absolute = ladder.distance(row.values, self.truth.values, self.span)
        if not row.error < _AWAY:
            row.status, row.reason = "failed", f"the motion ran away, to {row.error:.1e} times the span"
            row.error, row.absolute = None, {}

    def again(self, row: Row) -> None:
        """Times a row once more and keeps its best time, if the budget allows."""
        left = self.budget - self.used
        if 1.5 * row.time < left:
            other = Row(row.model, row.choice, row.value, row.method)
            ladder.timed(self.scene, other, self.quantity, time.perf_counter() + left, lambda: None)
            if other.status == "ok":
                row.time, row.runs = min(row.time, other.time), row.runs + other.runs

    # -- stages ------------------------------------------------------------------------------------------------------

    def reference(self) -> bool:
        """Finds the truth: the richest model that can be run, at a tolerance that no longer matters."""
        for order in reversed(self.orders):
            for shift in reversed(self.shifts[-3:]):
                if self._converge(self.model(order, shift)):
                    for row in self.rows:
                        self.grade(row)
                    return True
                if self.used >= self.budget:
                    return False
        return False

    def _converge(self, model: Model) -> bool:
        high = ladder.BY_TOLERANCE | ladder.OVER_OUTPUTS  # of high order, so first
        for choice in sorted(INTEGRATORS, key=lambda choice: choice not in high):
            before: Row | None = None
            failures = 0
            for value in self.settings(choice, _REFERENCE):
                row = self.run(model, choice, value, _FIRST if before is None else _NEXT)
                if row.status in ("skipped", "cut"):
                    break
                if row.values is None:
                    failures += 1
                    if before is not None or failures == _FAILURES:
                        break
                    continue
                if not self.span:
                    self.span = ladder.spans(row.values)
                    if not self.span:
                        why = "nothing moves" if row.values else "there is none that is not prescribed"
                        raise ValueError(f"quantity = '{self.quantity}': {why} in this scene; take another")
                if before is not None and before.values is not None:
                    d = ladder.distance(row.values, before.values, self.span)[0]
                    if d < self.tolerance:
                        self.truth, self.looser, self.tolerance = row, before, d
                    if d < _AGREE:
                        return True
                elif self.truth is None:
                    self.truth = row
                before = row
            if self.tolerance < 1e-6:
                return True
        return self.truth is not None

    def rank(self) -> list[tuple[Model, float]]:
        """The models worth timing, fastest first, each with its own error: orders first, then fewer modes."""
        assert self.truth is not None
        choice, value, rich = self.truth.choice, self.truth.value, self.truth.model
        orders = self.orders[: self.orders.index(rich.order) + 1]
        shifts = self.shifts[: self.shifts.index(rich.shift) + 1]
        dear = sorted(reversed(orders), key=lambda order: order == 3)  # last: in space it costs most, more than exact
        at_order = [self.run(self.model(order, rich.shift), choice, value, _FIRST) for order in dear]
        other = None if orders == ["as given"] else ladder.rebuilt(self.scene, rich.order, rich.shift + _SPARE)
        if other is not None:
            self.poorer["basis"] = self.run(other, choice, value, _FIRST)
        if len(orders) > 1:
            self.poorer["order"] = next(r for r in at_order if r.model.order == orders[-2])
        rows = list(at_order)
        for row in best(r for r in at_order if r.status == "ok"):
            for shift in reversed(shifts[:-1]):
                fewer = self.run(self.model(row.model.order, shift), choice, value, _FIRST)
                rows.append(fewer)
                if row.model is rich and shift == shifts[-2]:
                    self.poorer["modes"] = fewer
                if fewer.error is not None and fewer.error > _WORST:
                    break
        own = self.own_model()
        if own is not None:
            rows.append(self.run(own, choice, value, _FIRST))
        found = {r.model: r for r in best(rows) if r.error is not None and r.error <= _WORST}
        found |= {r.model: r for r in rows if r.model is own and r.error is not None}
        by_time = sorted(found.values(), key=lambda r: r.time)
        return [(r.model, r.error) for r in by_time if r.error is not None]

    def own_model(self) -> Model | None:
        """The scene's own, unless its beams have different orders."""
        if self.orders == ["as given"]:
            return self.model("as given", 0)
        orders = {link.beam.order for link in self.scene.arm.links if link.beam is not None and link.beam.ne}
        return self.model(orders.pop(), 0) if len(orders) == 1 else None

    def compare_methods(self, choice: str) -> tuple[str, ...]:
        """Whether "ci" gives this integrator another trajectory than "ab"; if not, "ab" alone is charted."""
        model = self.own_model() or (self.truth.model if self.truth else None)
        assert model is not None
        for value in list(self.settings(choice, (1e-6,)))[:_FAILURES]:
            ab = self.run(model, choice, value, 0.05)
            if ab.status == "failed":
                continue
            ci = self.run(model, choice, value, 0.05, "ci") if ab.values is not None else ab
            if ab.values is None or ci.values is None:
                break
            d = ladder.distance(ci.values, ab.values, self.span)[0]
            for row in (ab, ci):  # once more in turn, so that a busy moment does not pass for a difference
                self.again(row)
            self.methods[choice] = d, ci.time / ab.time
            return ("ab", "ci") if d > 1e-9 else ("ab",)
        return ("ab",)

    def line(self, model: Model, choice: str, own_error: float, method: str) -> None:
        """One line of the chart: tighter settings until the model's own error is all that is left."""
        floor = max(1.1 * own_error, _FINEST)
        failures = stale = 0
        lowest = np.inf
        patience = 30 if model is self.own_model() else 3  # the scene's own model is shown even where it is beaten
        for value in self.settings(choice):
            guess = self.predict(Row(model, choice, float(value), method))
            beaten = [r for r in self.rows if r.error is not None and r.error <= floor and patience * r.time < guess]
            known = self.find(model, choice, float(value), method)
            if beaten and known is None:
                row = Row(model, choice, float(value), method, "skipped", time=guess)
                row.reason = (
                    f"predicted {guess:.2g} s, where {min(beaten, key=lambda r: r.time).label} has no more error"
                )
                self.rows.append(row)
                return
            good = min((r.time for r in self.rows if r.error is not None and r.error <= floor), default=np.inf)
            enough = (patience * good + 0.1) / self.budget  # what takes longer than that would be beaten, too
            row = self.run(model, choice, float(value), min(_NEXT, enough), method)
            if row.status in ("skipped", "cut"):
                return
            if row.error is None:
                failures += 1
                if failures == _FAILURES:
                    return
                continue
            stale = stale + 1 if row.error > 0.9 * lowest else 0
            lowest = min(lowest, row.error)
            if row.error <= floor or stale == 3:
                return

    def settle(self) -> None:
        """Times the rows on or near the front once more, so that a busy moment does not decide between them."""
        graded = [(r, max(r.error, _FINEST)) for r in self.rows if r.error is not None and r is not self.truth]
        for row, error in graded:
            if not any(e <= error and 1.5 * r.time < row.time for r, e in graded):
                self.tell(self.used, f"again: {row.label}")
                self.again(row)
