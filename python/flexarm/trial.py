"""Timed runs of a scene's models for `economize`, each made once."""

from __future__ import annotations

import time
import warnings
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ._check import Array
from .arm import Arm
from .measure import Quantity, thinned
from .result import Result
from .rung import Model, Rungs
from .scene import Scene
from .simulation import SimulationError, simulate

_ROWS = 401  # output times of the runs that are compared
_DENSE = 60  # coordinates up to which Gauss collocation, whose matrices are dense, is taken
_ROUNDS = 5  # of the timing of an evaluation


class OutOfTime(Exception):
    """The time for deciding, or a run's share of it, is used up."""


def took(result: Result, used: float) -> float:
    """Wall time (s) of a simulation that began when this thread had used so much processor time: the lesser of what
    the simulation says and what the thread has used since, which a busy machine does not lengthen."""
    return max(1e-6, min(float(result.stats["wall_time"]), time.thread_time() - used))  # 0 where nothing is integrated


@dataclass(eq=False)
class Trial:
    """One run.

    Attributes:
        model, options: the model, and the arguments of `simulate`.
        whole: whether it had all the scene's output times, or the thinned ones.
        time: wall time of the integration (s).
        values: of the quantity, at the thinned times; None where the run failed, and `reason` says why.
        result: at the thinned times.
    """

    model: Model
    options: dict[str, Any]
    whole: bool
    time: float = np.inf
    values: dict[str, Array] | None = None
    result: Result | None = field(default=None, repr=False)
    reason: str = ""
    arm: Arm | None = field(default=None, repr=False)


class Trials:
    """Runs of the models of a scene.

    Args:
        rungs: the models. quantity: what is compared. deadline: time.perf_counter() at which runs are given up.

    Attributes:
        t: the output times of the runs that are compared: some 400 of the scene's.
        runs: all of them. seconds: spent in them.
    """

    def __init__(self, rungs: Rungs, quantity: Quantity, deadline: float) -> None:
        self.rungs, self.quantity, self.deadline = rungs, quantity, deadline
        t = rungs.scene.t
        self.t: Array = t[np.unique(np.linspace(0, len(t) - 1, _ROWS).astype(int))]
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
            whole: with all output times.
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
            times = s.t if whole else self.t
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                used = time.thread_time()
                result = simulate(
                    s.arm, times, s.q0, s.v0, drive=s.drive, loads=s.loads, control=s.control, progress=look, **options
                )  # fmt: skip
                trial.arm, trial.time = s.arm, took(result, used)
                trial.result = thinned(result, self.t) if whole else result
                with np.errstate(all="ignore"):
                    values = self.quantity.values(trial.result)
            if not all(np.isfinite(x).all() for x in values.values()):
                trial.reason = "it ran away"
            else:
                trial.values = values
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
            times = s.t if trial.whole else self.t
            used = time.thread_time()
            result = simulate(
                s.arm, times, s.q0, s.v0, drive=s.drive, loads=s.loads, control=s.control, **trial.options
            )  # fmt: skip
        trial.time = min(trial.time, took(result, used))
        self.seconds += result.stats["wall_time"]

    def distance(self, a: Trial, b: Trial) -> float:
        """Over the span; inf where one failed."""
        if a.values is None or b.values is None:
            return np.inf
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
        span = float(self.t[-1] - self.t[0])
        if self.rungs.arm(model).nv <= _DENSE:
            before: Trial | None = None
            failures = 0
            for step in span / 4 / 2.0 ** np.arange(10):
                options = {"integrator": "gauss", "step": float(step)}
                trial = self.run(model, options)
                if before is not None and self._close(trial, before, tol):
                    self.walk = before.options
                    return before
                before = trial if trial.values is not None else before
                failures += trial.values is None
                if failures > 2 or (failures and self.seconds > 2.0):
                    break  # a motion for variable steps
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

    def finer(self, factor: float = 2.0) -> dict[str, Any]:
        """The walk's setting, so many times finer."""
        if "step" in self.walk:
            return {**self.walk, "step": self.walk["step"] / factor}
        rtol = self.walk["rtol"] / factor**3
        return {**self.walk, "rtol": rtol, "atol": rtol * 1e-3}
