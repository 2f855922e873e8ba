"""Runs of a scene's models, timed, each made once, within a budget of wall time."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from .._check import Array
from ..analysis.validity import RangeWarning
from ..arm import Arm
from ..run.result import Result
from ..run.simulation import SimulationError, simulate
from ..scene.scene import Scene
from .coordinates import carried_q, carried_v, some_rows
from .integrators import OVER_OUTPUTS
from .measures import Measure
from .models import Model, Models
from .times import between, thinned

_LONG = 0.3  # seconds after which a run is not repeated
_ROUNDS = 5  # of the timing of an evaluation


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


def took(result: Result, used: float) -> float:
    """Wall time (s) of a simulation that began when this thread had used so much processor time: the lesser of what
    the simulation says and what the thread has used since, which a busy machine does not lengthen."""
    return max(1e-6, min(float(result.stats["wall_time"]), time.thread_time() - used))  # 0 where nothing is integrated


def timed(scene: Scene, look: Callable[[float], None] | None = None) -> tuple[Result, float, str]:
    """Runs a scene: the result, its time (s), and what RangeWarning said. (Whether its modes are enough, which
    ModelWarning doubts, the distance from richer models tells.)

    Args:
        look: called now and then; may raise OutOfTime.
    """
    given: dict[str, Any] = {"drive": scene.drive, "loads": scene.loads, "control": scene.control}
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        used = time.thread_time()
        result = simulate(scene.arm, scene.t, scene.q0, scene.v0, progress=look or False, **given, **scene.options)
        spent = took(result, used)
    return result, spent, "; ".join(str(w.message) for w in said if issubclass(w.category, RangeWarning))


@dataclass(eq=False)
class Run:
    """A run of a model, or what became of it.

    Attributes:
        model: the model.
        status: "ok", "failed", "skipped" (not begun) or "cut" (given up); `reason` says why.
        time: wall time of the integration (s), best of `runs`; predicted if skipped, spent if cut.
        steps, evaluations: of the integrator; so many of the steps were `halved` others.
        warning: what RangeWarning said, if a beam bent further than its order is good for.
        values: what is compared, at the times of comparison; None where the run failed.
    """

    model: Model
    status: str = field(default="ok", kw_only=True)
    reason: str = field(default="", kw_only=True)
    time: float = field(default=0.0, kw_only=True)
    runs: int = field(default=0, kw_only=True)
    steps: int = field(default=0, kw_only=True)
    evaluations: int = field(default=0, kw_only=True)
    halved: int = field(default=0, kw_only=True)
    warning: str = field(default="", kw_only=True)
    values: dict[str, Array] | None = field(default=None, repr=False, kw_only=True)

    def fail(self, reason: str) -> None:
        self.status, self.reason, self.values = "failed", reason, None


@dataclass(eq=False)
class Trial(Run):
    """A run of a model in any setting.

    Attributes:
        options: the arguments of `simulate`.
        whole: whether it had all the scene's output times, too, or those of comparison alone.
        full: values of a whole run, at all the scene's output times and those of comparison.
        result: at the times of comparison.
    """

    options: dict[str, Any]
    whole: bool = False
    full: dict[str, Array] | None = field(default=None, repr=False, kw_only=True)
    result: Result | None = field(default=None, repr=False, kw_only=True)
    arm: Arm | None = field(default=None, repr=False, kw_only=True)


class Trials:
    """Runs of the models of a scene.

    Args:
        models: the models. measure: what is compared. budget: the time for all of them.
        t: the times at which runs are compared.

    Attributes:
        all: these and all of the scene's output times.
        runs: all that were made, by what tells them apart. seconds: spent in them.
        setting: arguments of `simulate` with which models are compared.
    """

    def __init__(self, models: Models, measure: Measure, budget: Budget, t: Array) -> None:
        self.models, self.measure, self.budget, self.t = models, measure, budget, t
        self.all: Array = np.union1d(models.scene.t, t)
        self.runs: dict[Any, Run] = {}
        self.seconds = 0.0
        self.setting: dict[str, Any] = {"integrator": "gauss"}
        self._costs: dict[tuple[Model, str], float] = {}
        self._states: Result | None = None

    # -- runs --------------------------------------------------------------------------------------------------------

    def make(
        self, run: Run, make_scene: Callable[[], Scene], read: Callable[[Result], None], most: float = np.inf,
        often: int = 1, tell: Callable[[], None] = lambda: None,
    ) -> None:  # fmt: skip
        """Makes a run, and notes its status, time and steps.

        Args:
            make_scene: the scene so modelled, with its options. read: takes what is to be kept of the result.
            most: seconds after which it is given up, sooner where the budget is used up.
            often: how often short runs are repeated, for the least time.
            tell: called now and then, to keep a progress bar alive.

        Raises:
            KeyboardInterrupt: Ctrl-C.
        """
        started, spent, best = time.perf_counter(), 0.0, np.inf
        deadline = started + min(most, self.budget.left)

        def look(_: float) -> None:
            tell()
            if time.perf_counter() > deadline:
                raise OutOfTime

        try:
            scene = make_scene()
            while run.runs == 0 or (run.runs < often and spent < _LONG and time.perf_counter() + best < deadline):
                result, time_used, run.warning = timed(scene, look)
                run.runs, spent, best = run.runs + 1, spent + time_used, min(best, time_used)
            run.time, stats = best, result.stats
            run.steps, run.evaluations = int(stats["steps"]), int(stats["evaluations"])
            run.halved = int(stats["failed_steps"])
            with np.errstate(all="ignore"):
                read(result)
        except OutOfTime:
            run.status, run.time = "cut", time.perf_counter() - started
            run.reason = f"given up after {most:.2g} s"
        except (SimulationError, ValueError) as e:
            if isinstance(e, ValueError) and str(e).startswith("quantity"):
                raise
            run.fail(str(e))
        finally:
            self.seconds += time.perf_counter() - started

    def run(
        self, model: Model, options: dict[str, Any] | None = None, whole: bool = False, most: float = np.inf
    ) -> Trial:
        """This run, made now unless it was made before.

        Args:
            options: of simulate; None: those with which models are compared.
            whole: with all output times: as a user runs it, so that its steps are those of the user's run. What lies
                between them is interpolated, where output times inside of a step would shorten it.
            most: seconds after which it is given up.

        Raises:
            OutOfTime: the budget is used up.
        """
        options = self.setting if options is None else options
        key = model, tuple(sorted(options.items())), whole
        known = self.runs.get(key)
        if isinstance(known, Trial) and known.status != "cut":
            return known
        if self.budget.left < 0:
            raise OutOfTime
        trial = Trial(model, options, whole, time=np.inf)

        def scene() -> Scene:
            made = self.scene(model, options)
            inside = options["integrator"] in OVER_OUTPUTS  # the steps of others depend on the output times
            return replace(made, t=self.t if not whole else self.all if inside else made.t)

        def read(result: Result) -> None:
            result = between(result, self.all) if whole else result
            trial.arm, trial.result = result.arm, thinned(result, self.t)
            trial.values = self.measure.values(trial.result)
            trial.full = self.measure.values(result) if whole else None
            if not all(np.isfinite(x).all() for x in (trial.full or trial.values).values()):
                trial.fail("it ran away")

        self.make(trial, scene, read, most)
        if trial.status == "cut":
            if self.budget.left < 0:
                raise OutOfTime
            trial.time = np.inf
        self.runs[key] = trial
        return trial

    def again(self, run: Run, options: dict[str, Any], whole: bool = True, often: int = 1) -> None:
        """Times a run once more and keeps its best time. Not at times between the scene's output times, which a user's
        run does not have."""
        scene = self.scene(run.model, options)
        other = Run(run.model)
        self.make(other, lambda: scene if whole else replace(scene, t=self.t), lambda result: None, often=often)
        if other.status == "ok":
            run.time, run.runs = min(run.time, other.time), run.runs + other.runs

    def closely(self, trial: Trial, rows: int) -> Result:
        """The same run at so many times; at its own where that fails."""
        assert trial.result is not None
        scene = self.scene(trial.model, trial.options)
        try:
            return timed(replace(scene, t=np.linspace(self.t[0], self.t[-1], rows)))[0]
        except SimulationError:
            return trial.result

    def scene(self, model: Model, options: dict[str, Any]) -> Scene:
        return self.models.at(model, options)

    def distance(self, a: Run, b: Run) -> float:
        """Over the span; inf where one failed."""
        if a.values is None or b.values is None:
            return np.inf
        full = [getattr(run, "full", None) for run in (a, b)]
        if full[0] is not None and full[1] is not None:
            return self.measure.distance(full[0], full[1])
        return self.measure.distance(a.values, b.values)

    # -- cost of an evaluation ---------------------------------------------------------------------------------------

    def keep_states(self, trial: Trial) -> None:
        """States of this run are those at which evaluations are timed."""
        self._states = trial.result

    def cost(self, model: Model, method: str = "ab") -> float:
        """Time (s) of one forward dynamics of a model at states of the run, the least of some rounds. ValueError where
        such an arm cannot be."""
        if (model, method) not in self._costs:
            arm, r = self.models.arm(model), self._states
            assert r is not None
            rows = some_rows(len(r.t), 16)
            q, v = carried_q(r.q[rows], r.arm, arm), carried_v(r.v[rows], r.arm, arm)
            tau, given, least = np.zeros(v.shape), [False] * arm.nv, np.inf
            for _ in range(_ROUNDS):
                started = time.perf_counter()
                try:
                    arm._core.forward_dynamics(q, v, tau, method, given, tau)
                except ValueError:
                    pass
                least = min(least, time.perf_counter() - started)
            self._costs[model, method] = least / len(q)
        return self._costs[model, method]

    def share(self, more: Model, less: Model) -> float | None:
        """Of the time of an evaluation, what one model takes above another; None where one of them cannot be."""
        try:
            return self.cost(more) / self.cost(less) - 1.0
        except ValueError:
            return None
