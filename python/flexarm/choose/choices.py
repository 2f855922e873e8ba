"""The choices of `economize` in rows: what each part of the lean model is worth, and what it costs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from ..model.parts.beam import STRAINS
from .economize_search import EconomizeSearch
from .models import ORDERS, Model
from .sources import MODES, ORDER, ROTARY, orders
from .trials import Run, setting_words

RUN, ESTIMATE, SYMMETRY = "run", "estimate", "symmetry"  # the source of a number


@dataclass(frozen=True)
class Choice:
    """One choice.

    Attributes:
        where: "link 0", or "arm". what: such as "bending_y". chosen: such as "2", "none", "exact".
        without: error of leaving it out, in the unit of the tolerance (for an included choice: of leaving out its last
            mode, or of the next lower order); None if not found.
        how: source of that number: "run", "estimate", or "symmetry" (then it is zero); without a number, the reason.
        time: share of one evaluation of the dynamics that it takes (if included), or would add (if not).
        inside: whether it is in the lean model.
    """

    where: str
    what: str
    chosen: str
    without: float | None
    how: str
    time: float | None
    inside: bool


def choices_of(search: EconomizeSearch) -> list[Choice]:
    """Every choice, with the error without it and the time of including it: link by link, then of the arm."""
    model, names = search.lean.model, search.models.scene.arm.names
    rows: list[Choice] = []
    for group in search.models.groups:
        where = names[group[0]] + (f" and {len(group) - 1} alike" if len(group) > 1 else "")
        for of in (_modes, _order, _rotary, _gauss):
            rows += of(search, where, group)
    method = Choice("arm", "method", "ab", None, "the same motion", search.trials.share(model, model, "ci"), True)
    tried = sorted(search.settings, key=lambda run: (run.values is None, run.time))
    return [*rows, *_planes(search, rows), method, *(_setting(search, run) for run in tried)]


def _without(search: EconomizeSearch, lower: Model) -> tuple[float | None, str]:
    """Error of a poorer model, and its source: a run, or the estimate."""
    for run in search.trials.runs.values():
        if run.options == search.trials.setting and run.model == lower and run.values is not None:
            return search.trials.distance(run, search.rich), RUN
    if search.sources is None:
        return None, "not looked at"
    return search.estimate(lower), ESTIMATE


def _modes(search: EconomizeSearch, where: str, group: list[int]) -> Iterator[Choice]:
    model, k, share = search.lean.model.but(gauss=None), group[0], search.trials.share

    def first(s: int) -> float:
        known = [search.sources.size_of((MODES, k, s, 1))] if search.sources else []
        return max([*known, *(search.share.get((j, s, 1), 0.0) for j in group)])

    if model.beam(k).rigid:
        yield Choice(where, "beam", "rigid", max(map(first, range(len(STRAINS)))), ESTIMATE, None, False)
    for s, n in enumerate(model.counts(k)):
        if n:
            lower = model.with_count(group, s, n - 1)
            yield Choice(where, STRAINS[s], str(n), *_without(search, lower), share(model, lower), True)
        elif search.models.most(k)[s] == 0:
            yield Choice(where, STRAINS[s], "none", None, "no shear modulus", None, False)
        else:
            more = model.with_count(group, s, 1).but(group, rotary=True)
            more = more.but(group, order=2) if model.beam(k).rigid else more
            error, how = (0.0, SYMMETRY) if STRAINS[s] in search.dormant.get(k, ()) else (first(s), ESTIMATE)
            yield Choice(where, STRAINS[s], "none", error, how, share(more, model), False)


def _order(search: EconomizeSearch, where: str, group: list[int]) -> Iterator[Choice]:
    model, known, trials = search.lean.model.but(gauss=None), orders(search.models, group), search.trials
    beam = model.beam(group[0])
    if beam.rigid:
        return
    if len(known) == 1:
        yield Choice(where, "order", "exact", None, "curved at rest", None, True)
        return
    lower = [model.but(group, order=x) for x in known if ORDERS.index(x) < ORDERS.index(beam.order)]
    cheaper = [x for x in lower if trials.saved(model, x) > 0.0]
    if cheaper:
        error, time = _without(search, cheaper[-1]), trials.share(model, cheaper[-1])
        yield Choice(where, "order", str(beam.order), *error, time, True)
    elif search.sources is not None:
        now = search.sources.size_of((ORDER, group[0], beam.order))
        more = trials.share(model.but(group, order=2 if 2 in known else known[-1]), model)
        yield Choice(where, "order", str(beam.order), now, ESTIMATE, more, False)


def _rotary(search: EconomizeSearch, where: str, group: list[int]) -> Iterator[Choice]:
    model = search.lean.model.but(gauss=None)
    inside = model.beam(group[0]).rotary
    other = model.but(group, rotary=not inside)
    more, less = (model, other) if inside else (other, model)
    time = search.trials.share(more, less)
    if inside and time is None:
        yield Choice(where, ROTARY, "yes", None, "torsion and shear need it", None, True)
    elif inside:
        yield Choice(where, ROTARY, "yes", *_without(search, other), time, True)
    elif search.sources is not None:
        yield Choice(where, ROTARY, "no", search.sources.size_of((ROTARY, group[0])), ESTIMATE, time, False)


def _gauss(search: EconomizeSearch, where: str, group: list[int]) -> Iterator[Choice]:
    """The number of a beam's slices."""
    model = search.lean.model
    gauss = model.beam(group[0]).gauss
    if model.beam(group[0]).rigid:
        return
    full = model.but(group, gauss=None)
    beam = search.models.arm(full).links[group[0]].beam
    assert beam is not None
    most = beam._core.gauss_points
    if gauss is None:
        yield Choice(where, "Gauss points", str(most), None, "of the basis", 0.0, True)
        return
    time = search.trials.share(full, model)
    yield Choice(where, "Gauss points", f"{gauss} of {most}", None, "in the run's error", time, False)


def _planes(search: EconomizeSearch, rows: list[Choice]) -> list[Choice]:
    """The row that tells whether beams bend in a plane or in space."""
    names = [set(link.beam.counts) for link in search.models.arm(search.lean.model).links if link.beam is not None]
    if not any(names):
        return []
    in_y = all(n <= {"bending_y", "shear_y", "extension"} for n in names)
    in_z = all(n <= {"bending_z", "shear_z", "extension"} for n in names)
    side = {"bending_z", "torsion", "shear_z"} if in_y else {"bending_y", "torsion", "shear_y"}
    lost = max((c.without or 0.0 for c in rows if c.what in side), default=0.0)
    how = SYMMETRY if lost == 0.0 else ESTIMATE
    if in_y or in_z:
        return [Choice("arm", "beams bend in", "one plane each", lost, how, None, False)]
    return [Choice("arm", "beams bend in", "space", None, "its strains", None, True)]


def _setting(search: EconomizeSearch, run: Run) -> Choice:
    words = setting_words(run.options)
    if run.values is None:
        why = {"cut": "given up: slow", "failed": "the run failed"}.get(run.status, run.status)
        return Choice("arm", "integrator", words, None, why, None, False)
    error, time = search.trials.distance(run, search.rich), run.time / search.lean.time - 1.0
    return Choice("arm", "integrator", words, error, RUN, time, run is search.lean)


def speed_of(search: EconomizeSearch) -> dict[str, dict[str, float | int]]:
    """Coordinates, time (s) and floating point operations of one evaluation of the dynamics: of the scene's own model,
    the lean and the rich one."""
    out: dict[str, dict[str, float | int]] = {}
    of = {"given": search.models.given, "lean": search.lean.model, "rich": search.rich.model}
    for name, model in of.items():
        arm = search.models.arm(model)
        out[name] = {"coordinates": arm.nv, "time": search.trials.cost(model), "operations": arm.operation_count()}
    return out
