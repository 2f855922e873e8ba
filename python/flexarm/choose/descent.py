"""Steps of a negligible error; and the descent from a rich model to the cheapest one within the tolerance: models and
integrators, verified by runs."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ..run.integrators import DENSE
from ..run.scene.scene import Scene
from ..run.watch import first_frequency
from .decisions import DECISIONS, Evidence, Reduction, Sizes, keys
from .measures import callables, probes
from .models import BeamModel, Model
from .states import embed, some_rows
from .trials import BY_TOLERANCE, IN_TURN, LINES, OVER_OUTPUTS, Run, Trials, by_tolerance, longest_gap, settings_to_try

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


_GOAL = 0.7  # of the tolerance: share for the model; the rest is for the integrator and unknown errors
_RUN_SHARE = 0.85  # of the tolerance: limit of the error with the integrator's
_HOPELESS = 20.0  # times the tolerance: reductions of a larger estimated error are not tried


class Descent:
    """The descent from one reference model.

    Args:
        evidence: the reference, and the estimates of the indicators. tell: called with the present activity.
    """

    def __init__(self, evidence: Evidence, tell: Callable[[str], None]) -> None:
        self.evidence, self.tell = evidence, tell
        self.trials, self.models, self.tol = evidence.trials, evidence.models, evidence.tol
        evidence.sizes, evidence.refused = self.find_sizes(), set()

    def good(self, model: Model) -> bool:
        return self.evidence.error(model) <= _GOAL * self.tol

    def find_sizes(self) -> Sizes:
        """By (first link of the group, strain, number), the change of the quantity by that coordinate alone."""
        reference = self.evidence.reference
        assert reference.result is not None
        r, arm = reference.result, reference.result.arm
        run = embed(r, arm, some_rows(len(r.t), 101))
        size = self.trials.measure.sense(self.models.at(reference.model, {}), run.q)
        names, out = keys(arm), {}
        by_rate = [arm.coordinate_of(i) for i in range(arm.nv)]
        M = arm.mass_matrix(run.q[len(run.q) // 2]) if self.trials.measure.quantity == "joint" else None
        joints = [i for i, key in enumerate(names) if key[0] < 0]
        for group, s, count in self.models.items(reference.model):
            for n in range(1, 1 + count):
                x = np.zeros((len(run.q), arm.nv))
                for i in [names.index((k, s, n)) for k in group]:
                    x[:, i] = run.q[:, by_rate[i]]
                    if M is not None and joints:  # the joints' reaction, with momentum kept
                        push = np.linalg.solve(M[np.ix_(joints, joints)], M[joints, i])
                        x[:, joints] -= np.outer(x[:, i], push)
                out[group[0], s, n] = size(x)
        return out

    def reductions(self, model: Model) -> list[Reduction]:
        """Reductions that save time and were not refused, by rising estimated error."""
        known = [x for decision in DECISIONS for group in self.models.groups
                 for x in decision.reductions(self.evidence, model, group)]
        left = [x for x in known if x.error <= _HOPELESS * self.tol and x.name not in self.evidence.refused]
        return sorted(left, key=lambda x: x.error)

    def reduce(self) -> Model:
        """The reference with all reductions that the goal allows.

        All reductions are made in a row, by rising estimated error, and bisection finds how many of them the goal
        allows. The next one is refused, and the others are tried again from there.
        """
        self.tell("fewer coordinates")
        model = self.evidence.reference.model
        seen = {model}
        while row := self.reductions(model):
            chain = [model]
            for x in row:
                chain.append(x.change(chain[-1]))
            low, high = 0, len(row)
            guess = int(np.searchsorted(np.cumsum([x.error for x in row]), _GOAL * self.tol))
            while low < high:
                at = min(max(guess, low + 1), high)
                if chain[at] == chain[low] or self.good(chain[at]):
                    low = at
                else:
                    high = at - 1
                guess = (low + high + 1) // 2
            again = low > 0 and chain[low] in seen  # measured times differ: a reduction and its reverse both save time
            model = chain[low]
            seen.add(model)
            self.evidence.refused |= {x.name for x in (row if again else row[low : low + 1])}
        return self.slices(model)

    def sliced(self, model: Model, share: float) -> Model:
        """The model with this share of the Gauss points that its bases require."""
        links = self.models.arm(model).links

        def fewer(k: int, beam: BeamModel) -> BeamModel:
            of = links[k].beam
            assert of is not None
            return beam if beam.rigid else replace(beam, gauss=max(2, int(np.ceil(share * of._core.gauss_points))))

        return model.each(fewer)

    def slices(self, model: Model) -> Model:
        """Takes fewer Gauss points if the run hardly changes and no new warning appears."""
        before = self.trials.run(model)
        for share in (0.7, 0.5):
            lower = self.sliced(model, share)
            if lower == model or not self.good(lower):
                break
            trial = self.trials.run(lower)
            if self.trials.distance(trial, before) > 0.05 * self.tol or (trial.warning and not before.warning):
                break
            model = lower
        return model

    def integrate(self, model: Model) -> tuple[Run, list[Run]]:
        """The fastest run of the model, with an error below 0.85 of the tolerance, and all runs tried."""
        tried: list[Run] = []
        step = float(self.trials.setting.get("step", longest_gap(self.models.scene)))
        for line in IN_TURN:
            if LINES[line]["integrator"] in OVER_OUTPUTS and self.models.arm(model).nv > DENSE:
                continue
            for options in settings_to_try(self.models.scene, line, step):
                best = min((x.time for x in tried if self._good(x)), default=np.inf)
                if line not in BY_TOLERANCE | OVER_OUTPUTS:  # at least four evaluations a step
                    steps = float(np.ptp(self.models.scene.t)) / options["step"]
                    if 4 * steps * self.trials.cost(model) > best:
                        break
                trial = self.trials.run(model, options, whole=True, most=max(0.2, 3 * best))
                same = line in OVER_OUTPUTS and any(x.steps == trial.steps for x in tried)
                if same and trial.values is not None:
                    break  # sampling times cut longer steps into these
                tried.append(trial)
                meets = self._good(trial)
                time = trial.time if trial.values is not None else np.inf
                if meets == (line in BY_TOLERANCE) or time > 1.5 * best:
                    break  # a longer step has a larger error, a tighter tolerance takes longer
        good = sorted((x for x in tried if self._good(x)), key=lambda x: x.time)
        if not good:
            trial = self.trials.run(model, self.trials.setting, whole=True)
            return trial, [*tried, trial]
        for trial in good[:3]:
            if trial.time < 1.5 * good[0].time:
                self.trials.time_again(trial)
        return min(good, key=lambda x: x.time), tried

    def _good(self, trial: Run) -> bool:
        return self.trials.distance(trial, self.evidence.judge) <= _RUN_SHARE * self.tol
