"""Runs of a scene's models, timed, each made once, within a budget of wall time."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from .._check import Array
from ..analysis.findings import RangeWarning
from ..run.result import Result
from ..run.simulation import SimulationError, simulated
from ..scene.scene import Scene
from .coordinates import carried_q, carried_v, some_rows
from .integrators import OVER_OUTPUTS
from .measures import Measure
from .models import Model, Models
from .times import between, thinned

_LONG = 0.3  # seconds after which a run is not repeated
_ROUNDS = 5  # of the timing of an evaluation
_EQUAL = 0.05  # of the time of an evaluation: a model that saves less, were all beams changed, is not cheaper


class OutOfTime(Exception):
    """The budget, or a run's share of it, is used up."""


class Budget:
    """Wall time that may be used, from now on (s)."""

    def __init__(self, seconds: float = np.inf) -> None:
        self.seconds, self._started = seconds, time.perf_counter()

    @property
    def used(self) -> float:
        return time.perf_counter() - self._started

    @property
    def left(self) -> float:
        return self.seconds - self.used


def timed(scene: Scene, look: Callable[[float], None] | None = None) -> tuple[Result, float, str]:
    """Runs a scene: the result, its time (s), and what RangeWarning would say. The time is the lesser of the
    simulation's wall time and what this thread has used of the processor, which a busy machine does not lengthen.

    Args:
        look: called now and then; may raise OutOfTime.
    """
    used = time.thread_time()
    given = {**scene.given(), **scene.options}
    result = simulated(scene.arm, scene.t, scene.q0, scene.v0, progress=look or False, **given)
    used = time.thread_time() - used
    spent = max(1e-6, min(float(result.stats["wall_time"]), used))  # 0 where nothing is integrated
    return result, spent, "; ".join(str(w) for w in result._wrong if isinstance(w, RangeWarning))


@dataclass(eq=False)
class Run:
    """A run of a model in some setting, or what became of it.

    Attributes:
        model: the model.
        options: the arguments of `simulate`.
        choice: its integrator's line in a chart, a key of LINES.
        whole: whether it had all the scene's output times, too, or those of comparison alone.
        status: "ok", "failed", "skipped" (not begun) or "cut" (given up); `reason` says why.
        time: wall time of the integration (s), best of `runs`; predicted if skipped, spent if cut.
        steps, evaluations: of the integrator; so many of the steps were `halved` others.
        warning: what RangeWarning would say, if a beam bent further than its order is good for.
        error: in a chart, the largest distance from the truth over the quantity's span; None if not known.
        absolute: the same by unit, such as {"m": 1e-5}.
        values: what is compared, at the times of comparison; None where the run failed.
        full: of a whole run that is kept, the same at all the scene's output times and those of comparison.
        result: at the times of comparison, where it is kept.
    """

    model: Model
    options: dict[str, Any]
    choice: str = ""
    whole: bool = False
    status: str = "ok"
    reason: str = ""
    time: float = 0.0
    runs: int = 0
    steps: int = 0
    evaluations: int = 0
    halved: int = 0
    warning: str = ""
    error: float | None = None
    absolute: dict[str, float] = field(default_factory=dict)
    values: dict[str, Array] | None = field(default=None, repr=False)
    full: dict[str, Array] | None = field(default=None, repr=False)
    result: Result | None = field(default=None, repr=False)

    @property
    def key(self) -> Any:
        return self.model, tuple(sorted(self.options.items())), self.whole

    @property
    def setting(self) -> str:
        """What its integrator is set by: "rtol" or "step"."""
        return "rtol" if "rtol" in self.options else "step"

    @property
    def value(self) -> float:
        """Its rtol, or its step (s)."""
        return float(self.options[self.setting])

    @property
    def label(self) -> str:
        unit = " s" if self.setting == "step" else ""
        return f"{self.model.label}, {self.choice}, {self.setting} {self.value:.4g}{unit}"

    def to_dict(self) -> dict[str, Any]:
        keep = ("choice", "setting", "value", "status", "reason", "time", "runs", "error", "absolute")
        about = {k: getattr(self.model, k) for k in ("order", "modes", "shift", "basis")}
        return {**about, **{k: getattr(self, k) for k in (*keep, "steps", "evaluations", "warning")}}


class Trials:
    """Runs of the models of a scene.

    Args:
        models: the models. measure: what is compared. t: the times at which runs are compared.
        budget: the time for all of them. keep: whether results are kept, not the values alone.

    Attributes:
        all: the times of comparison and all of the scene's output times.
        runs: all that were made, by what tells them apart. seconds: spent in them.
        setting: arguments of `simulate` with which models are compared.
        busy: how many times as long as it took on this thread the last run lasted: other work slows it.
        states: a run at whose states evaluations of the dynamics are timed.
    """

    def __init__(self, models: Models, measure: Measure, t: Array, budget: Budget, keep: bool = True) -> None:
        self.models, self.measure, self.t, self.budget, self.keep = models, measure, t, budget, keep
        self.all: Array = np.union1d(models.scene.t, t)
        self.runs: dict[Any, Run] = {}
        self.seconds, self.busy = 0.0, 1.0
        self.setting: dict[str, Any] = {"integrator": "gauss"}
        self._costs: dict[tuple[Model, str], float] = {}
        self.states: Result | None = None

    # -- runs --------------------------------------------------------------------------------------------------------

    def run(
        self, model: Model, options: dict[str, Any] | None = None, whole: bool = False, most: float = np.inf,
        choice: str = "", often: int = 1, tell: Callable[[], None] = lambda: None,
    ) -> Run:  # fmt: skip
        """This run, made now unless it was made before.

        Args:
            options: of simulate; None: those with which models are compared.
            whole: with all output times: as a user runs it, so that its steps are those of the user's run. What lies
                between them is interpolated, where output times inside of a step would shorten it.
            most: seconds after which it is given up.
            often: how often short runs are repeated, for the least time.
            tell: called now and then, to keep a progress bar alive.

        Raises:
            OutOfTime: the budget is used up.
        """
        run = Run(model, self.setting if options is None else options, choice, whole)
        known = self.runs.get(run.key)
        if known is not None and known.status in ("ok", "failed"):
            return known
        if self.budget.left < 0:
            raise OutOfTime
        started = time.perf_counter()
        try:
            scene = self.models.at(model, run.options)
            inside = run.options["integrator"] in OVER_OUTPUTS  # the steps of others depend on the output times
            times = self.t if not whole else self.all if inside else scene.t
            self._read(run, self._timed(run, replace(scene, t=times), most, often, tell))
        except OutOfTime:
            if self.budget.left < 0:
                raise
            run.status, run.time, run.reason = "cut", time.perf_counter() - started, f"given up after {most:.2g} s"
        except (SimulationError, ValueError) as e:
            if isinstance(e, ValueError) and str(e).startswith("quantity"):
                raise
            run.status, run.reason = "failed", str(e)
        finally:
            self.seconds += time.perf_counter() - started
        return self.note(run)

    def note(self, run: Run) -> Run:
        """Keeps a run, as the last of all."""
        self.runs.pop(run.key, None)
        self.runs[run.key] = run
        return run

    def _timed(self, run: Run, scene: Scene, most: float, often: int, tell: Callable[[], None]) -> Result:
        """Runs it, again while it is short, and notes its best time."""
        started = time.perf_counter()
        deadline, enough = started + min(most, self.budget.left), started + _LONG

        def look(_: float) -> None:
            tell()
            if time.perf_counter() > deadline:
                raise OutOfTime

        count, best = 0, run.time if run.runs else np.inf
        while count == 0 or (count < often and time.perf_counter() < min(enough, deadline - best)):
            result, used, run.warning = timed(scene, look)
            count, best = count + 1, min(best, used)
        run.time, run.runs = best, run.runs + count
        self.busy = max(1.0, float(result.stats["wall_time"]) / used)
        return result

    def _read(self, run: Run, result: Result) -> None:
        run.steps, run.evaluations, run.halved = (
            int(result.stats[name]) for name in ("steps", "evaluations", "failed_steps")
        )
        with np.errstate(all="ignore"):
            result = between(result, self.all) if run.whole else result
            seen = thinned(result, self.t)
            first = self.models.first(run.model)
            values = self.measure.values(seen, first)
            full = self.measure.values(result, first) if run.whole and self.keep else None
        if not all(np.isfinite(x).all() for x in (full or values).values()):
            run.status, run.reason = "failed", "it ran away"
            return
        run.values, run.full, run.result = values, full, seen if self.keep else None

    def again(self, run: Run, most: float = np.inf, often: int = 1) -> None:
        """Times a run once more and keeps its best time. Not at times between the scene's output times, which a user's
        run does not have."""
        scene = self.models.at(run.model, run.options)
        with contextlib.suppress(OutOfTime, SimulationError):
            self._timed(run, scene if run.whole else replace(scene, t=self.t), most, often, lambda: None)

    def closely(self, run: Run, rows: int) -> Result:
        """The same run at so many times; at its own where that fails."""
        assert run.result is not None
        scene = self.models.at(run.model, run.options)
        try:
            return timed(replace(scene, t=np.linspace(self.t[0], self.t[-1], rows)))[0]
        except SimulationError:
            return run.result

    def distance(self, a: Run, b: Run) -> float:
        """Over the span; inf where one failed."""
        if a.values is None or b.values is None:
            return np.inf
        if a.full is not None and b.full is not None:
            return self.measure.distance(a.full, b.full)
        return self.measure.distance(a.values, b.values)

    # -- cost of an evaluation ---------------------------------------------------------------------------------------

    def cost(self, model: Model, method: str = "ab") -> float:
        """Time (s) of one forward dynamics of a model at states of the run, the least of some rounds. ValueError where
        such an arm cannot be."""
        if (model, method) not in self._costs:
            self._costs[model, method] = self.measured(model, method)
        return self._costs[model, method]

    def measured(self, model: Model, method: str) -> float:
        """That time, measured now."""
        arm, r = self.models.arm(model), self.states
        assert r is not None
        rows = some_rows(len(r.t), 16)
        q, v = carried_q(r.q[rows], r.arm, arm), carried_v(r.v[rows], r.arm, arm)
        tau, least = np.zeros(v.shape), np.inf
        for _ in range(_ROUNDS):
            started = time.perf_counter()
            try:
                arm._core.forward_dynamics(q, v, tau, method)
            except ValueError:
                pass
            least = min(least, time.perf_counter() - started)
        return least / len(q)

    def share(self, more: Model, less: Model, method: str = "ab") -> float | None:
        """Of the time of an evaluation, what one model takes above another (by "ab"); None where one of them cannot
        be."""
        try:
            return self.cost(more, method) / self.cost(less) - 1.0
        except ValueError:
            return None

    def cheaper(self, model: Model, than: Model) -> bool:
        """Whether an evaluation of a model is measured to take less time; not where one of them cannot be."""
        share = self.share(model, than)
        changed = [a != b for a, b in zip(model.beams, than.beams, strict=True) if b is not None]
        return share is not None and share < -_EQUAL * sum(changed) / max(1, len(changed))
