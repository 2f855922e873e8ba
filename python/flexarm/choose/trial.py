"""Timed runs of a scene's models for `economize`, each made once."""

from __future__ import annotations

import time
import warnings
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .._check import Array
from ..arm import Arm
from ..run.result import Result
from ..run.simulation import SimulationError, simulate
from ..run.watch import first_frequency
from ..scene.scene import Scene
from .indicate import callables, probes
from .ladder import OVER_OUTPUTS
from .measure import Quantity, between, thinned
from .rung import Model, Rungs

_ROWS = 200  # output times of the runs that are compared, and as many times between them
_GROWN = 1.6  # times as many steps: less, and a run in shorter steps is the same run
_FEWER = 3  # stages of Gauss collocation, by which four of them are checked
_HALVINGS, _PATIENCE = 12, 3.0  # of the first step, and seconds for those that fail
_DENSE = 60  # coordinates up to which Gauss collocation, whose matrices are dense, is taken
_ROUNDS = 5  # of the timing of an evaluation


class OutOfTime(Exception):
    """The time for deciding, or a run's share of it, is used up."""


def took(result: Result, used: float) -> float:
    """Wall time (s) of a simulation that began when this thread had used so much processor time: the lesser of what
    the simulation says and what the thread has used since, which a busy machine does not lengthen."""
    return max(1e-6, min(float(result.stats["wall_time"]), time.thread_time() - used))  # 0 where nothing is integrated


def times_to_compare(t: Array) -> Array:
    """The first and the last output time, some of the others, and as many times between them, each drawn from its own
    part of the run: no vibration has its zeros at all of them."""
    rng = np.random.default_rng(19)
    part = (np.arange(_ROWS) + rng.random((2, _ROWS))) / _ROWS
    own = t if len(t) <= _ROWS else t[np.unique(np.append(part[0] * len(t), [0, len(t) - 1]).astype(int))]
    gaps, many = len(t) - 1, -(-_ROWS // (len(t) - 1))  # several in each where output times are few
    drawn = np.searchsorted(t, t[0] + part[1] * (t[-1] - t[0])).clip(1, gaps) - 1
    gap = np.arange(gaps) if many > 1 else np.unique(drawn)
    share = 0.01 + 0.98 * (np.arange(many) + rng.random((len(gap), many))) / many
    inside = (t[gap, None] + share * np.diff(t)[gap, None]).ravel()
    return np.union1d(own, inside)


def seen_step(scene: Scene, tol: float) -> float:
    """The first step of the walk (s): a quarter of the run, or less where Gauss' points of such steps would miss what a
    callable does, as its integral tells, which samples have their steps end at."""
    start, span = float(scene.t[0]), float(np.ptp(scene.t))
    step, least = span / 4, span / 4 / 2**9
    laws = callables(scene)
    if not laws:
        return step
    t = probes(scene)
    t = np.union1d(t, scene.t[:: 1 + len(scene.t) // len(t)])
    f = np.hstack([np.array([np.ravel(law(float(x))) for x in t], dtype=float) for law in laws])
    rise = 0.5 * (f[1:] + f[:-1]) * np.diff(t)[:, None]
    whole = np.vstack([np.zeros((1, f.shape[1])), np.cumsum(rise, axis=0)])
    size = np.maximum(np.ptp(whole, axis=0), 1e-300)
    points, weights = np.polynomial.legendre.leggauss(4)
    while step > least:
        ends = start + step * np.arange(round(span / step) + 1)
        nodes = (ends[:-1, None] + step * (points + 1) / 2).ravel()
        for column, total, most in zip(f.T, whole.T, size, strict=True):
            seen = np.interp(nodes, t, column).reshape(-1, 4) @ weights * step / 2
            missed = np.cumsum(seen) - (np.interp(ends[1:], t, total) - np.interp(ends[0], t, total))
            if np.abs(missed).max() > min(max(5 * tol, 1e-3), 2e-2) * most:
                break
        else:
            break
        step /= 2
    return step


@dataclass(eq=False)
class Trial:
    """One run.

    Attributes:
        model, options: the model, and the arguments of `simulate`.
        whole: whether it had all the scene's output times, too, or those of comparison alone.
        time: wall time of the integration (s). steps: that it took, of which so many `halved` others.
        values: of the quantity, at the times of comparison; None where the run failed, and `reason` says why.
        full: the same, of a whole run, at all the scene's output times and those of comparison.
        result: at the times of comparison.
    """

    model: Model
    options: dict[str, Any]
    whole: bool
    time: float = np.inf
    steps: int = 0
    halved: int = 0
    values: dict[str, Array] | None = None
    full: dict[str, Array] | None = field(default=None, repr=False)
    result: Result | None = field(default=None, repr=False)
    reason: str = ""
    arm: Arm | None = field(default=None, repr=False)


class Trials:
    """Runs of the models of a scene.

    Args:
        rungs: the models. quantity: what is compared. deadline: time.perf_counter() at which runs are given up.

    Attributes:
        t: the times at which runs are compared: some 400, at random, half of them between the scene's output times
            (where the user's own function of a Result is compared, which may count on the scene's: 400 of those).
        all: these and all of the scene's output times.
        runs: all of them. seconds: spent in them.
    """

    def __init__(self, rungs: Rungs, quantity: Quantity, deadline: float) -> None:
        self.rungs, self.quantity, self.deadline = rungs, quantity, deadline
        t = rungs.scene.t
        own = t[np.unique(np.linspace(0, len(t) - 1, 2 * _ROWS).astype(int))]
        self.t: Array = own if callable(quantity.what) else times_to_compare(t)
        self.all: Array = np.union1d(t, self.t)
        self.runs: dict[Any, Trial] = {}
        self.seconds = 0.0
        self.walk: dict[str, Any] = {"integrator": "gauss"}
        self._costs: dict[tuple[Model, str], float] = {}
        self._state: tuple[tuple[str, ...], tuple[str, ...], Array, Array] | None = None

    def scene(self, model: Model, options: dict[str, Any]) -> Scene:
        return self.rungs.at(model, options)

    def run(
        self, model: Model, options: dict[str, Any] | None = None, whole: bool = False, most: float = np.inf
    ) -> Trial:
        """This run, made now unless it was made before.

        Args:
            options: of simulate; None: those of the walk.
            whole: with all output times: as a user runs it, so that its steps are those of the user's run. What lies
                between them is interpolated, where output times inside of a step would shorten it.
            most: seconds after which it is given up.

        Raises:
            OutOfTime: at the deadline.
        """
        options = self.walk if options is None else options
        key = model, tuple(sorted(options.items())), whole
        known = self.runs.get(key)
        if known is not None and (known.values is not None or not known.reason.startswith("given up")):
            return known
        trial = Trial(model, options, whole)
        started = time.perf_counter()

        def look(_: float) -> None:
            now = time.perf_counter()
            if now > self.deadline or now > started + most:
                raise OutOfTime

        if started > self.deadline:
            raise OutOfTime
        try:
            s = self.scene(model, options)
            inside = options["integrator"] in OVER_OUTPUTS  # the steps of others depend on the output times
            times = self.t if not whole else self.all if inside else s.t
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                used = time.thread_time()
                result = simulate(
                    s.arm, times, s.q0, s.v0, drive=s.drive, loads=s.loads, control=s.control, progress=look, **options
                )  # fmt: skip
                trial.arm, trial.time = s.arm, took(result, used)
                trial.steps, trial.halved = int(result.stats["steps"]), int(result.stats["failed_steps"])
                result = between(result, self.all) if whole else result
                trial.result = thinned(result, self.t)
                with np.errstate(all="ignore"):
                    values = self.quantity.values(trial.result)
                    full = self.quantity.values(result) if whole else values
            if not all(np.isfinite(x).all() for x in full.values()):
                trial.reason = "it ran away"
            else:
                trial.values, trial.full = values, full if whole else None
        except OutOfTime:
            if time.perf_counter() > self.deadline:
                raise
            trial.reason = f"given up after {most:.2g} s"
        except (SimulationError, ValueError) as e:
            if isinstance(e, ValueError) and str(e).startswith("quantity"):
                raise
            trial.reason = str(e)
        finally:
            self.seconds += time.perf_counter() - started
        self.runs[key] = trial
        return trial

    def again(self, trial: Trial) -> None:
        """Times it once more and keeps the best."""
        s = self.scene(trial.model, trial.options)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            times = s.t if trial.whole else self.t  # not those between, which a user's run does not have
            used = time.thread_time()
            result = simulate(
                s.arm, times, s.q0, s.v0, drive=s.drive, loads=s.loads, control=s.control, **trial.options
            )  # fmt: skip
        trial.time = min(trial.time, took(result, used))
        self.seconds += result.stats["wall_time"]

    def closely(self, trial: Trial, rows: int) -> Result:
        """The same run at so many times; at its own where that fails."""
        assert trial.result is not None
        s = self.scene(trial.model, trial.options)
        times = np.linspace(self.t[0], self.t[-1], rows)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                return simulate(
                    s.arm, times, s.q0, s.v0, drive=s.drive, loads=s.loads, control=s.control, **trial.options
                )  # fmt: skip
        except SimulationError:
            return trial.result

    def distance(self, a: Trial, b: Trial) -> float:
        """Over the span; inf where one failed."""
        if a.values is None or b.values is None:
            return np.inf
        if a.full is not None and b.full is not None:
            return self.quantity.distance(a.full, b.full)
        return self.quantity.distance(a.values, b.values)

    # -- cost of an evaluation ---------------------------------------------------------------------------------------

    def keep_state(self, trial: Trial) -> None:
        """States of this run are those at which evaluations are timed."""
        assert trial.result is not None
        r = trial.result
        rows = np.unique(np.linspace(0, len(r.t) - 1, 16).astype(int))
        self._state = r.arm.q_names, r.arm.coordinates, r.q[rows], r.v[rows]

    def cost(self, model: Model, method: str = "ab") -> float:
        """Time (s) of one forward dynamics of a model at states of the run, the least of some rounds."""
        if (model, method) not in self._costs:
            arm = self.rungs.arm(model)
            assert self._state is not None
            q_names, names, q0, v0 = self._state
            q, v = np.tile(arm.zero, (len(q0), 1)), np.zeros((len(q0), arm.nv))
            for out, mine, theirs, values in ((q, arm.q_names, q_names, q0), (v, arm.coordinates, names, v0)):
                at = {name: k for k, name in enumerate(theirs)}
                for k, name in enumerate(mine):
                    if name in at:
                        out[:, k] = values[:, at[name]]
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

    def operations(self, model: Model) -> int | None:
        """Floating point operations of one forward dynamics, where the arm counts them."""
        return self.rungs.arm(model).operation_count()

    # -- the step of the walk ----------------------------------------------------------------------------------------

    def settle(self, model: Model, tol: float) -> Trial | None:
        """Finds the integrator and its setting whose own error no longer matters (tol / 10) with this model, for all
        runs that are compared; the run with it, or None."""
        if self.rungs.arm(model).nv <= _DENSE:
            before: Trial | None = None
            wasted = 0.0
            step = seen_step(self.rungs.scene, tol)
            for _ in range(_HALVINGS):
                spent = self.seconds
                trial = self.run(model, {"integrator": "gauss", "step": step})
                if trial.values is None:
                    wasted += self.seconds - spent
                    if wasted > _PATIENCE:
                        break  # a motion for variable steps
                    period = 2 * np.pi / first_frequency(self.rungs.arm(model))
                    step = min(step, period) / 2 if period > 0 else step / 2  # what vibrates far needs short steps
                    continue
                if self.cut(trial):  # half the step might be the same steps
                    before = self.run(model, {**trial.options, "stages": _FEWER})
                    trial, before = before, trial
                if before is not None and self.differs(trial, before) and self._close(trial, before, tol):
                    self.walk = before.options
                    return before
                before, step = trial, self.mean_step(trial) / 2
        before = None
        for rtol in 10.0 ** -np.arange(4, 10):
            options = {"integrator": "ida", "rtol": float(rtol), "atol": float(rtol * 1e-3)}
            trial = self.run(model, options)
            if before is not None and self._close(trial, before, tol):
                self.walk = options
                return trial
            before = trial if trial.values is not None else before
        return None

    def _close(self, a: Trial, b: Trial, tol: float) -> bool:
        if a.values is None or b.values is None:
            return False
        if not self.quantity.span:
            self.quantity.set_span(a.values)
        return self.quantity.distance(a.values, b.values) < tol / 10

    def mean_step(self, trial: Trial) -> float:
        """Of the steps that a run of a fixed-step method set out to take (s), which samples may have cut: at most the
        step that was asked for. (Each that was halved, because its equations could not be solved, is one.)"""
        tried = trial.steps - trial.halved
        return min(float(trial.options["step"]), float(self.t[-1] - self.t[0]) / max(1, tried))

    def cut(self, trial: Trial) -> bool:
        """Whether samples cut the steps of a run of a fixed-step method."""
        return self.mean_step(trial) * _GROWN < float(trial.options["step"])

    def differs(self, trial: Trial, other: Trial) -> bool:
        """Whether a run can tell the error of another one's steps: by another method, another order, or more steps."""
        if any(trial.options.get(k) != other.options.get(k) for k in ("integrator", "stages")):
            return True
        return "step" not in trial.options or trial.steps >= _GROWN * other.steps

    def finer(self, trial: Trial) -> dict[str, Any]:
        """A setting that differs in all that the walk's vouches for: another number of stages, because samples may cut
        some steps however long they are asked for, and shorter steps than those that this run in it really took. Where
        most of its steps are cut, the number of stages alone: that is cheaper, and no less honest."""
        if "step" in self.walk:
            step, before = self.mean_step(trial), "stages" in self.walk
            stages = {} if before else {"stages": _FEWER}
            rest = {k: v for k, v in self.walk.items() if k != "stages"}
            if self.cut(trial) and not before:
                return {**rest, **stages}
            return {**rest, "step": step / (_GROWN if before else 3), **stages}
        rtol = self.walk["rtol"] / 10
        return {**self.walk, "rtol": rtol, "atol": rtol * 1e-3}
