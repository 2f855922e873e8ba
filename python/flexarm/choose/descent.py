"""The descent from a rich model to the cheapest one within the tolerance: models and integrators, verified by runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from .decisions import DECISIONS, Reduction
from .evidence import Evidence, Sizes, keys
from .integrators import BY_TOLERANCE, DENSE, IN_TURN, OVER_OUTPUTS, longest_gap, settings_to_try
from .models import BeamModel, Model
from .states import embed, some_rows
from .trials import Run

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
        places = [(decision, group) for decision in DECISIONS for group in decision.groups(self.models)]
        known = [x for decision, group in places for x in decision.reductions(self.evidence, model, group)]
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
        for integrator in IN_TURN:
            if integrator in OVER_OUTPUTS and self.models.arm(model).nv > DENSE:
                continue
            for options in settings_to_try(self.models.scene, integrator, step):
                best = min((x.time for x in tried if self._good(x)), default=np.inf)
                if integrator not in BY_TOLERANCE | OVER_OUTPUTS:  # at least four evaluations a step
                    steps = float(np.ptp(self.models.scene.t)) / options["step"]
                    if 4 * steps * self.trials.cost(model) > best:
                        break
                trial = self.trials.run(model, options, whole=True, most=max(0.2, 3 * best))
                same = integrator in OVER_OUTPUTS and any(x.steps == trial.steps for x in tried)
                if same and trial.values is not None:
                    break  # sampling times cut longer steps into these
                tried.append(trial)
                meets = self._good(trial)
                time = trial.time if trial.values is not None else np.inf
                if meets == (integrator in BY_TOLERANCE) or time > 1.5 * best:
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
