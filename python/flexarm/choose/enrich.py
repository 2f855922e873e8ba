"""Richer models of a scene: the strains that move at all, more shapes of each of them, and which of these matter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

import flexarm._core as _core

from .._check import Array
from ..model.parts.beam import STRAINS
from ..run.result import Result
from .indicators import excited, shares
from .measures import Measure
from .models import BeamModel, Model, Models
from .states import keys

_MANY = 4  # with more beams than this, each gets fewer further shapes


def moving_strains(models: Models) -> dict[int, Array]:
    """By link with a beam, a mask of the strains that are excited, directly or through others."""
    few = enriched(models, 0).each(lambda k, b: BeamModel(tuple(min(n, 2) for n in b.counts), 2, True))
    scene = models.at(few, {})
    moves = list(zip(keys(scene.arm), excited(scene), strict=True))
    excites = {}
    for k, link in enumerate(scene.arm.links):
        if link.beam is not None:
            own = [s for (j, s, _), moving in moves if j == k and moving]
            excites[k] = np.isin(np.arange(len(STRAINS)), own)
            if models.pinned:
                excites[k] = np.array(models.given.counts(k)) > 0
    reached: dict[int, Array] = {}
    for group in models.groups:  # one choice for a group: excited in one link counts for all
        together = np.any([excites[k] for k in group], axis=0)
        reached |= {k: together for k in group}
    return reached


def enriched(
    models: Models, extra: int, reached: Mapping[int, Array] | None = None, than: Model | None = None
) -> Model:
    """A model with `extra` modes more than the scene of every strain that moves, and exact rotation.

    Args:
        reached: by link, the strains that move; None, or a link that is not in it: all of them.
        than: have more modes of every strain than this model, too.
    """
    many = sum(beam is not None for beam in models.given.beams) > _MANY
    each = [1 + field.bending for field in _core.STRAIN_FIELDS]  # modes of bending come in twos

    def rich(k: int, beam: BeamModel) -> BeamModel:
        numbers = []
        for s, (n, limit, two) in enumerate(zip(beam.counts, models.most(k), each, strict=True)):
            want = n
            if not (models.pinned or models.own_shapes(k, s)):
                least, more = (two, two - 1) if many else (2 * two, two)
                want = max(n + more, least) + two * extra
                want = want if than is None else max(want, than.counts(k)[s] + two)
            want = want if limit is None else min(want, limit)
            numbers.append(want if reached is None or k not in reached or reached[k][s] else 0)
        return BeamModel(tuple(numbers), "exact", True)

    return models.given.each(rich)


def relevant(
    models: Models, rich: Model, least: Model, result: Result, measure: Measure, part: float, size: float | None = None
) -> tuple[Model, dict[tuple[int, int, int], float], float]:
    """A rich model without the shapes that are estimated to change a run's quantity by less than a part of `size`
    together (None: of what the rich model changes), but no less than the `least` model; by (link, strain, number) what
    each further shape changes, over the span; and what the rich model does."""
    of, whole = shares(models, rich, result, measure)
    counts = {(g[0], s): n for g, s, n in models.items(rich)}
    worth = {(g[0], s, i): max(of.get((k, s, i), 0.0) for k in g) for g, s, n in models.items(rich)
             for i in range(least.counts(g[0])[s] + 1, n + 1)}  # fmt: skip
    left = part * (whole if size is None else size)
    while last := {(k, s): worth[k, s, n] for (k, s), n in counts.items() if (k, s, n) in worth}:
        fewest = min(last, key=lambda key: last[key])
        if last[fewest] > left:
            break
        counts[fewest], left = counts[fewest] - 1, left - last[fewest]
    group = {k: g[0] for g in models.groups for k in g}

    def fewer(k: int, beam: BeamModel) -> BeamModel:
        return replace(beam, counts=tuple(counts.get((group[k], s), 0) for s in range(len(beam.counts))))

    return rich.each(fewer), of, whole
