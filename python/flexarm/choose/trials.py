"""Integrators and their settings to try, from loose to tight; timed runs of a scene's models within a budget of wall
time, each of which is made once."""

import contextlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from .._check import Array
from ..analysis.findings import RangeWarning
from ..model.acting.drive import moved_rates
from ..run.integrators import INTEGRATORS, OPTIONS, asks_functions
from ..run.result import Result
from ..run.scene.scene import Scene
from ..run.simulation import SimulationError, simulated
from ..run.steps import explicit_limit
from .measures import Measure, between, thinned
from .models import Model, Models
from .states import embed, some_rows

#: Gauss collocation that chooses its steps.
CHOSEN = "gauss, chosen steps"

#: The chart's lines, by name: arguments of `simulate`.
LINES: dict[str, dict[str, Any]] = {
    **{name: {"integrator": name} for name in INTEGRATORS},
    "ida, BDF 2": {"integrator": "ida", "max_order": 2},
    CHOSEN: {"integrator": "gauss"},
}

#: Of each line the argument of `simulate` that makes it more accurate.
SETTINGS = {name: "step" if of["integrator"] in OPTIONS["step"] else "rtol" for name, of in LINES.items()}
SETTINGS[CHOSEN] = "tolerance"

#: The lines that are compared by a tolerance; every other one by its `step`.
BY_TOLERANCE = frozenset(name for name in LINES if SETTINGS[name] != "step")

#: The integrators with a step that step over output times.
OVER_OUTPUTS = frozenset({"gauss"})


def longest_gap(scene: Scene) -> float:
    """The longest gap between output times (s)."""
    return float(np.diff(scene.t).max())


def stable_step(scene: Scene, step: float) -> float:
    """The longest step (s) up to this one in which explicit integrators are stable, of small motions about rest."""
    held = moved_rates(scene.arm, scene.drive)
    return min(step, explicit_limit(scene.arm, step, scene.start(), held)[2])


def line_options(scene: Scene, line: str, value: float) -> dict[str, Any]:
    """Arguments of `simulate`: the scene's, with a line's integrator at a setting."""
    setting, own = SETTINGS[line], (LINES[line]["integrator"],)
    out = {k: v for k, v in scene.options.items() if OPTIONS.get(k) == own and k not in SETTINGS.values()}
    out |= {**LINES[line], setting: value}
    if setting == "rtol":
        out["atol"] = value * scene.options.get("atol", 1e-9) / scene.options.get("rtol", 1e-6)
    return out


def line_settings(scene: Scene, line: str, rtols: Sequence[float] = ()) -> list[float]:
    """Settings of a line, from loose to tight. Steps fit between output times if the integrator stops at all of
    these."""
    gap = longest_gap(scene)
    if line in BY_TOLERANCE:
        return list(rtols or 10.0 ** -np.arange(2, 12))
    longest = max(gap, float(np.ptp(scene.t)) / 16) if line in OVER_OUTPUTS else gap
    return list(longest / 2.0 ** np.arange(16))


def by_tolerance(rtol: float) -> dict[str, Any]:
    return {"integrator": "ida", "rtol": float(rtol), "atol": float(rtol * 1e-3)}


def setting_of(options: dict[str, Any]) -> str:
    """The argument that makes a run with these more accurate; "" where it is not among them."""
    return next((name for name in ("step", "tolerance", "rtol") if name in options), "")


def setting_words(options: dict[str, Any]) -> str:
    """The setting in words, such as "gauss, step 0.05 s"."""
    setting = setting_of(options)
    unit = " s" if setting == "step" else ""
    return f"{options['integrator']}, {setting} {options[setting]:.3g}{unit}" if setting else str(options["integrator"])


_LONG = 0.3  # s: longer runs are not repeated
_ROUNDS, _STATES = 6, 32  # timings of evaluations, and of how many
_EQUAL = 0.05  # of an evaluation's time: least saving, with all beams changed, that counts as cheaper


class OutOfTime(Exception):
    """The budget, or a run's share of it, is used up."""


class Budget:
    """Wall time (s) that may be used from now on."""

    def __init__(self, seconds: float = np.inf) -> None:
        self.seconds, self._started = seconds, time.perf_counter()

    @property
    def used(self) -> float:
        return time.perf_counter() - self._started

    @property
    def left(self) -> float:
        return self.seconds - self.used


def silent(scene: Scene, progress: Any = False) -> Result:
    """A run of a scene that passes no warning on; they are in `Result._wrong`."""
    return simulated(scene.arm, scene.t, scene.q0, scene.v0, progress=progress, **scene.given(), **scene.options)


def timed(scene: Scene, look: Callable[[float], None] | None = None) -> tuple[Result, float, str]:
    """Runs a scene: returns the result, its time (s), and the messages of RangeWarning. The time is the lesser of the
    wall time and the processor time of this thread, which other processes do not lengthen.

    Args:
        look: called at times during the run; may raise OutOfTime.
    """
    used = time.thread_time()
    result = silent(scene, look or False)
    used = time.thread_time() - used
    spent = max(1e-6, min(float(result.stats["wall_time"]), used))  # 0 where nothing is integrated
    return result, spent, "; ".join(str(w) for w in result._wrong if isinstance(w, RangeWarning))


@dataclass(eq=False)
class Run:
    """A run of a model with a setting, or the record of a failed or skipped one."""

    model: Model
    options: dict[str, Any]  #: the arguments of `simulate`
    choice: str = ""  #: the chart line of its integrator, a key of LINES
    whole: bool = False  #: whether at all output times of the scene, or only at those of comparison
    status: str = "ok"  #: "ok", "failed", "skipped" (not begun) or "cut" (given up)
    reason: str = ""  #: of a status that is not ok
    time: float = 0.0  #: wall time of the integration (s), best of `runs`; predicted if skipped, spent if cut
    runs: int = 0
    steps: int = 0
    evaluations: int = 0
    halved: int = 0  #: steps that were
    warning: str = ""  #: messages of RangeWarning, if a beam bent beyond the range of its order
    error: float | None = None  #: in a chart, the largest distance from the truth over the span; None: unknown
    absolute: dict[str, float] = field(default_factory=dict)  #: the same by unit, such as {"m": 1e-5}
    values: dict[str, Array] | None = field(default=None, repr=False)  #: where runs are compared; None: it failed
    full: dict[str, Array] | None = field(default=None, repr=False)  #: of a kept whole run, at all output times, too
    result: Result | None = field(default=None, repr=False)  #: where runs are compared, if kept
    dense: Result | None = field(default=None, repr=False)  #: at evenly spaced times, if asked for

    @property
    def key(self) -> Any:
        return self.model, tuple(sorted(self.options.items())), self.whole

    @property
    def setting(self) -> str:
        """The argument that sets its integrator: "rtol", "tolerance" or "step"."""
        return setting_of(self.options)

    @property
    def value(self) -> float:
        """The value of its rtol or tolerance, or of its step (s)."""
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
        models: the models. measure: the compared quantity. t: the times at which runs are compared.
        budget: the time for all runs. keep: whether results are kept beside the values.

    Attributes:
        all: the times of comparison and all of the scene's output times.
        runs: all runs made, by `Run.key`.
        setting: arguments of `simulate` for comparing models.
        busy: wall time of the last run over its time on this thread; above 1 if other processes slow it.
        states: a run at whose states evaluations of the dynamics are timed.
    """

    def __init__(self, models: Models, measure: Measure, t: Array, budget: Budget, keep: bool = True) -> None:
        self.models, self.measure, self.t, self.budget, self.keep = models, measure, t, budget, keep
        self.all: Array = np.union1d(models.scene.t, t)
        self.runs: dict[Any, Run] = {}
        self.busy = 1.0
        self.setting: dict[str, Any] = {"integrator": "gauss"}
        self._costs: dict[tuple[Model, str], float] = {}
        self.states: Result | None = None

    # -- runs --------------------------------------------------------------------------------------------------------

    def run(
        self, model: Model, options: dict[str, Any] | None = None, whole: bool = False, most: float = np.inf,
        choice: str = "", often: int = 1, tell: Callable[[], None] = lambda: None, dense: int = 0,
    ) -> Run:  # fmt: skip
        """The run of this model with this setting, made now unless it was made before.

        Args:
            options: of simulate; None: `setting`.
            whole: with all output times, so that its steps are those of a user's run. Values between output times are
                interpolated if more output times would shorten the steps.
            most: processor time that the run may take (s).
            often: number of repetitions of short runs, of which the least time counts.
            tell: called at times during the run, to update a progress bar.
            dense: keep the run also at so many evenly spaced times.

        Raises:
            OutOfTime: the budget is used up.
        """
        run = Run(model, self.setting if options is None else options, choice, whole)
        known = self.runs.get(run.key)
        if known is not None and (known.status == "failed" or (known.status == "ok" and (known.dense or not dense))):
            return known
        if self.budget.left < 0:
            raise OutOfTime
        started = time.thread_time()
        try:
            scene = self.models.at(model, run.options)
            # where more output times do not shorten the steps
            inside = run.options["integrator"] in OVER_OUTPUTS and ("step" in run.options or not asks_functions(scene))
            times = self.t if not whole else self.all if inside else scene.t
            even = np.linspace(self.t[0], self.t[-1], dense) if dense else self.t
            times = np.union1d(times, even) if dense else times
            self._read(run, self._run_timed(run, replace(scene, t=times), most, often, tell), even)
        except OutOfTime:
            if self.budget.left < 0:
                raise
            run.status, run.time, run.reason = "cut", time.thread_time() - started, f"given up after {most:.2g} s"
        except (SimulationError, ValueError) as e:
            if isinstance(e, ValueError) and str(e).startswith("quantity"):
                raise
            run.status, run.reason = "failed", str(e)
        return self.store(run)

    def store(self, run: Run) -> Run:
        """Stores a run as the latest."""
        self.runs.pop(run.key, None)
        self.runs[run.key] = run
        return run

    def _run_timed(self, run: Run, scene: Scene, most: float, often: int, tell: Callable[[], None]) -> Result:
        """Runs it, repeats it while it is short, and stores its best time."""
        started = time.thread_time()

        def used_up(more: float = 0.0) -> bool:
            return time.thread_time() - started + more > most or self.budget.left < more

        def look(_: float) -> None:
            tell()
            if used_up():
                raise OutOfTime

        count, best = 0, run.time if run.runs else np.inf
        while count == 0 or (count < often and time.thread_time() - started < _LONG and not used_up(best)):
            result, used, run.warning = timed(scene, look)
            count, best = count + 1, min(best, used)
        run.time, run.runs = best, run.runs + count
        self.busy = max(1.0, float(result.stats["wall_time"]) / used)
        return result

    def _read(self, run: Run, result: Result, even: Array) -> None:
        run.steps, run.evaluations, run.halved = (
            int(result.stats[name]) for name in ("steps", "evaluations", "failed_steps")
        )
        run.dense = None if even is self.t else between(result, even)
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

    def time_again(self, run: Run, most: float = np.inf, often: int = 1) -> None:
        """Times a run once more and keeps its best time; a whole run at the scene's output times only, as a user runs
        it."""
        scene = self.models.at(run.model, run.options)
        with contextlib.suppress(OutOfTime, SimulationError):
            self._run_timed(run, scene if run.whole else replace(scene, t=self.t), most, often, lambda: None)

    def at_rows(self, run: Run, rows: int) -> Result:
        """The same run at `rows` evenly spaced times; the run itself if that fails."""
        assert run.result is not None
        scene = self.models.at(run.model, run.options)
        try:
            return timed(replace(scene, t=np.linspace(self.t[0], self.t[-1], rows)))[0]
        except SimulationError:
            return run.result

    def distance(self, a: Run, b: Run) -> float:
        """Distance of two runs over the span; inf if one failed."""
        if a.values is None or b.values is None:
            return np.inf
        if a.full is not None and b.full is not None:
            return self.measure.distance(a.full, b.full)
        return self.measure.distance(a.values, b.values)

    # -- cost of an evaluation ---------------------------------------------------------------------------------------

    def cost(self, model: Model, method: str = "ab") -> float:
        """Time (s) of one forward dynamics of a model at states of the run: processor time of this thread, which other
        work on the machine hardly lengthens, the least of some rounds. ValueError if such an arm is impossible."""
        if (model, method) not in self._costs:
            self._costs[model, method] = self.measured(model, method)
        return self._costs[model, method]

    def measured(self, model: Model, method: str) -> float:
        """The time of `cost`, measured now."""
        arm, r = self.models.arm(model), self.states
        assert r is not None
        states = embed(r, arm, some_rows(len(r.t), _STATES))
        tau, least = np.zeros(states.v.shape), np.inf
        for _ in range(_ROUNDS):
            started = time.thread_time()
            arm._core.forward_dynamics(states.q, states.v, tau, method)
            least = min(least, time.thread_time() - started)
        return least / len(tau)

    def share(self, more: Model, less: Model, method: str = "ab") -> float | None:
        """Relative extra time of an evaluation of `more` above `less` (by "ab"); None if one of them is impossible."""
        try:
            return self.cost(more, method) / self.cost(less) - 1.0
        except ValueError:
            return None

    def saved(self, model: Model, other: Model) -> float:
        """The share of the time of a run that another model saves, about: vibrations of n coordinates take some sqrt(n)
        evaluations. 0 if it is impossible, or saves less than measurements are known."""
        share = self.share(other, model)
        if share is None:
            return 0.0
        many, few = (self.models.arm(x).nv for x in (model, other))
        share = (1.0 + share) * np.sqrt(few / max(1, many)) - 1.0
        changed = [a != b for a, b in zip(model.beams, other.beams, strict=True) if b is not None]
        least = 0.0 if other.less(model) else _EQUAL * sum(changed) / max(1, len(changed))
        return 0.0 if share > -least else -share
