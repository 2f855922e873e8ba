"""What each choice of a plan costs and saves: rows of its table, and the time of an evaluation of the dynamics."""

from __future__ import annotations

import numpy as np

from .decisions import DECISIONS, SYMMETRY, Choice, Place
from .economize_search import EconomizeSearch, Findings
from .evidence import ESTIMATE, RUN, Evidence
from .integrators import setting_words
from .trials import Trial


def choices_of(search: EconomizeSearch, found: Findings) -> list[Choice]:
    """Every choice, with the error of leaving it out and the time of putting it in: link by link, then of the arm."""
    trials, models, model = search.trials, search.models, found.lean.model
    known = Evidence(trials, search.tol, found.reference, found.estimates, found.sizes, found.dormant)
    most = max(0.2, 3 * found.lean.time)
    rows: list[Choice] = []
    for group in models.link_groups:
        where = f"link {group[0]}" + (f" and {len(group) - 1} alike" if len(group) > 1 else "")
        for decision in DECISIONS:
            if group in decision.groups(models):
                rows += decision.rows(known, Place(where, group, model, most))
    out = [*rows, *_planes(search, found, rows)]
    try:
        ratio: float | None = trials.cost(model, "ci") / trials.cost(model) - 1.0
    except ValueError:
        ratio = None
    out.append(Choice("arm", "method", "ab", None, "the same motion", ratio, True))
    return [*out, *(_setting(search, found, trial) for trial in sorted(found.settings, key=lambda x: x.time))]


def _planes(search: EconomizeSearch, found: Findings, rows: list[Choice]) -> list[Choice]:
    """Whether beams bend in a plane, or in space."""
    names = [set(link.beam.counts) for link in search.models.arm(found.lean.model).links if link.beam is not None]
    if not any(names):
        return []
    in_y = all(n <= {"bending_y", "shear_y"} for n in names)
    in_z = all(n <= {"bending_z", "shear_z"} for n in names)
    side = {"bending_z", "torsion", "shear_z"} if in_y else {"bending_y", "torsion", "shear_y"}
    lost = max((c.without or 0.0 for c in rows if c.what in side), default=0.0)
    how = SYMMETRY if lost == 0.0 else ESTIMATE
    if in_y or in_z:
        return [Choice("arm", "beams bend in", "one plane each", lost, how, None, False)]
    return [Choice("arm", "beams bend in", "space", None, how, None, True)]


def _setting(search: EconomizeSearch, found: Findings, trial: Trial) -> Choice:
    error = None if trial.values is None else search.trials.distance(trial, found.reference)
    time = trial.time / found.lean.time - 1.0 if np.isfinite(trial.time) else None
    return Choice("arm", "integrator", setting_words(trial.options), error, RUN, time, trial is found.lean)


def speed_of(search: EconomizeSearch, found: Findings) -> dict[str, dict[str, float | int | None]]:
    """Of the scene's own model, the lean and the rich one: coordinates, time (s) and floating point operations of one
    evaluation of the dynamics; operations are None where the arm does not count them."""
    out: dict[str, dict[str, float | int | None]] = {}
    for name, model in (("given", search.models.given), ("lean", found.lean.model), ("rich", found.rich.model)):
        arm = search.models.arm(model)
        try:
            time: float | None = search.trials.cost(model)
        except ValueError:
            time = None
        out[name] = {"coordinates": arm.nv, "time": time, "operations": arm.operation_count()}
    return out
