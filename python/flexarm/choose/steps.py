"""Steps short enough for a negligible error: the setting with which `economize` compares models, and finer ones."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..run.scene.scene import Scene
from ..run.watch import first_frequency
from .integrators import DENSE, by_tolerance
from .models import Model
from .times import callables, probes
from .trials import Run, Trials

_MORE_STEPS = 1.6  # least ratio of step counts for a run to count as one with shorter steps
_CHECK_STAGES = 3  # stages of the Gauss collocation that checks the one of four stages
_HALVINGS, _PATIENCE = 12, 3.0  # of the first step, and seconds for failing steps


def first_step(scene: Scene, tol: float) -> float:
    """The first step to try (s): a quarter of the run, or less where the Gauss points of such steps miss a callable's
    changes. Its integral tells; steps end at the samples of controllers."""
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


def settle(trials: Trials, model: Model, tol: float) -> Run | None:
    """Finds an integrator and a setting whose error is negligible (tol / 10) with this model, for all compared runs.
    Returns the run with it, or None."""
    if trials.models.arm(model).nv <= DENSE:
        before: Run | None = None
        wasted = 0.0
        step = first_step(trials.models.scene, tol)
        for _ in range(_HALVINGS):
            spent = trials.seconds
            trial = trials.run(model, {"integrator": "gauss", "step": step})
            if trial.values is None:
                wasted += trials.seconds - spent
                if wasted > _PATIENCE:
                    break  # the motion needs variable steps
                period = 2 * np.pi / first_frequency(trials.models.arm(model))
                step = min(step, period) / 2 if period > 0 else step / 2  # large vibrations need short steps
                continue
            if cut(trials, trial):  # half the step might give the same steps
                before = trials.run(model, {**trial.options, "stages": _CHECK_STAGES})
                trial, before = before, trial
            if before is not None and differs(trial, before) and _close(trials, trial, before, tol):
                trials.setting = before.options
                return before
            before, step = trial, mean_step(trials, trial) / 2
    before = None
    for rtol in 10.0 ** -np.arange(4, 10):
        options = by_tolerance(rtol)
        trial = trials.run(model, options)
        if before is not None and _close(trials, trial, before, tol):
            trials.setting = options
            return trial
        before = trial if trial.values is not None else before
    return None


def _close(trials: Trials, a: Run, b: Run, tol: float) -> bool:
    if a.values is None or b.values is None:
        return False
    if not trials.measure.span:
        trials.measure.set_span(a.values)
    return trials.measure.distance(a.values, b.values) < tol / 10


def mean_step(trials: Trials, trial: Run) -> float:
    """Mean step (s) of a fixed-step run, at most the requested one, since sampling times may cut steps. (A step that
    was halved, because its equations could not be solved, counts once.)"""
    tried = trial.steps - trial.halved
    return min(float(trial.options["step"]), float(trials.t[-1] - trials.t[0]) / max(1, tried))


def cut(trials: Trials, trial: Run) -> bool:
    """Whether sampling times cut the steps of a fixed-step run."""
    return mean_step(trials, trial) * _MORE_STEPS < float(trial.options["step"])


def differs(trial: Run, other: Run) -> bool:
    """Whether a run can show the step error of another: it has another method, another order, or more steps."""
    if any(trial.options.get(k) != other.options.get(k) for k in ("integrator", "stages")):
        return True
    return "step" not in trial.options or trial.steps >= _MORE_STEPS * other.steps


def finer(trials: Trials, trial: Run) -> dict[str, Any]:
    """A setting independent of this run's: another number of stages, because sampling times may cut steps of any
    requested length, and steps shorter than those that this run took. Where most of its steps were cut, only the number
    of stages changes: that is cheaper, and checks as much."""
    if "step" in trials.setting:
        step, before = mean_step(trials, trial), "stages" in trials.setting
        stages = {} if before else {"stages": _CHECK_STAGES}
        rest = {k: v for k, v in trials.setting.items() if k != "stages"}
        if cut(trials, trial) and not before:
            return {**rest, **stages}
        return {**rest, "step": step / (_MORE_STEPS if before else 3), **stages}
    return {**trials.setting, **by_tolerance(trials.setting["rtol"] / 10)}
