"""What `economize` decides, a class for each: modes, order, rotary inertia, Gauss points.

A new decision is a class here, named in DECISIONS. What is there or not of a link, such as friction in its joint, is a
LinkFeature: it says which links have it, and what such a link is without it. The way down then tries to leave it out,
the indicators estimate what that costs, the table has a row of it, and the saved scene is without it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from ..parts.beam import STRAINS
from ..parts.link import Link
from .evidence import ESTIMATE, RUN, Evidence
from .models import ORDERS, BeamModel, Model, Models

SYMMETRY = "symmetry"
UNLIKELY = 2.5  # times the tolerance: orders that are estimated to be off by more are not tried


@dataclass(frozen=True)
class Choice:
    """One choice.

    Attributes:
        where: "link 0", or "arm". what: such as "bending_y". chosen: such as "2", "none", "exact".
        without: what leaving it out costs (of what is in: its last mode, or the next poorer order), or costs now (of
            what is out), in the terms of the tolerance; None where that is not known.
        how: where that number is from: "run", "estimate", or "symmetry" (then it is zero).
        time: of one evaluation of the dynamics, the share that it takes (of what is in), or that it would add.
        inside: whether it is in the lean model.
    """

    where: str
    what: str
    chosen: str
    without: float | None
    how: str
    time: float | None
    inside: bool

    def to_dict(self) -> dict[str, Any]:
        return dict(self.__dict__)


@dataclass(frozen=True)
class Place:
    """Where a decision is told of: a group of links of the chosen model, in words, and the seconds (`most`) that one
    more run may take to measure what leaving something out costs."""

    where: str
    group: list[int]
    model: Model
    most: float

    @property
    def beam(self) -> BeamModel:
        beam = self.model.beams[self.group[0]]
        assert beam is not None
        return beam


class Decision:
    """Something that is decided for each group of links alike."""

    def groups(self, models: Models) -> list[list[int]]:
        """The links that it is decided for."""
        return models.groups

    def poorer(self, models: Models, model: Model) -> dict[Any, Model]:
        """By name, models with the same coordinates whose error the indicators are to estimate."""
        return {}

    def moves(self, known: Evidence, model: Model, group: list[int]) -> Iterator[tuple[Any, Model, float]]:
        """(name, model, estimated error) of single steps down that save time."""
        yield from ()

    def rows(self, known: Evidence, at: Place) -> Iterator[Choice]:
        """What was chosen, for the table."""
        yield from ()


class Modes(Decision):
    """How many shape functions each strain of a beam has; none at all: the beam is rigid."""

    def moves(self, known: Evidence, model: Model, group: list[int]) -> Iterator[tuple[Any, Model, float]]:
        for s, n in enumerate(() if known.trials.models.pinned else model.counts(group[0])):
            if n:
                about = known.sizes.get((group[0], s, n), 0.0)
                yield ("modes", group[0], s, n), model.with_count(group, s, n - 1), about

    def rows(self, known: Evidence, at: Place) -> Iterator[Choice]:
        if at.beam.rigid:
            lost = max(known.size(at.group, s, 1) for s in range(len(STRAINS)))
            yield Choice(at.where, "beam", "rigid", lost, ESTIMATE, None, False)
        for s, n in enumerate(at.beam.counts):
            yield self._in(known, at, s, n) if n else self._out(known, at, s)

    def _in(self, known: Evidence, at: Place, s: int, n: int) -> Choice:
        lower = at.model.with_count(at.group, s, n - 1)
        error, how = known.without(lower, known.size(at.group, s, n), at.most)
        return Choice(at.where, STRAINS[s], str(n), error, how, known.trials.share(at.model, lower), True)

    def _out(self, known: Evidence, at: Place, s: int) -> Choice:
        if known.trials.models.most(at.group[0])[s] == 0:
            return Choice(at.where, STRAINS[s], "none", None, "no shear modulus", None, False)
        more = at.model.with_count(at.group, s, 1).but(at.group, rotary=True)
        if at.beam.rigid:
            more = more.but(at.group, order=2)
        dormant = STRAINS[s] in known.dormant.get(at.group[0], ())
        error, how = (0.0, SYMMETRY) if dormant else (known.size(at.group, s, 1), ESTIMATE)
        return Choice(at.where, STRAINS[s], "none", error, how, known.trials.share(more, at.model), False)


class Order(Decision):
    """Of the rotation of a beam's sections."""

    def poorer(self, models: Models, model: Model) -> dict[Any, Model]:
        return {order: model.but(order=order) for order in ORDERS[:-1]}

    def moves(self, known: Evidence, model: Model, group: list[int]) -> Iterator[tuple[Any, Model, float]]:
        beam = model.beams[group[0]]
        if beam is None or beam.rigid:
            return
        for order in reversed(ORDERS[: ORDERS.index(beam.order)]):
            lower = model.but(group, order=order)
            if not known.allowed(order):
                continue
            time = known.trials.share(lower, model) if order == 3 else -1.0
            if time is not None and time < 0:
                about = known.estimates.by_order.get(order, 0.0)
                yield ("order", group[0], order), lower, about if about < UNLIKELY * known.tol else math.inf
                return

    def rows(self, known: Evidence, at: Place) -> Iterator[Choice]:
        if at.beam.rigid:
            return
        trials, order = known.trials, at.beam.order
        for other in reversed(ORDERS[: ORDERS.index(order)]):
            lower = at.model.but(at.group, order=other)
            error, how = known.without(lower, known.estimates.by_order.get(other, math.inf), at.most)
            time = trials.share(at.model, lower)
            if other == 3 and how == ESTIMATE and (time or 0.0) < 0:
                continue  # dearer than exact
            yield Choice(at.where, "order", str(order), error, how, time, True)
            return
        now = known.estimates.by_order.get(order, math.inf)
        time = trials.share(at.model.but(at.group, order=2), at.model)
        yield Choice(at.where, "order", str(order), now, ESTIMATE, time, False)


class Switch(Decision):
    """Something that is there or not.

    Attributes:
        name: what it is called in the table.
    """

    name: str

    def inside(self, model: Model, group: list[int]) -> bool:
        raise NotImplementedError

    def switched(self, model: Model, group: list[int], on: bool) -> Model:
        """The model with it, or without."""
        raise NotImplementedError

    def poorer(self, models: Models, model: Model) -> dict[Any, Model]:
        links = [k for group in self.groups(models) for k in group]
        return {self.name: self.switched(model, links, False)} if links else {}

    def moves(self, known: Evidence, model: Model, group: list[int]) -> Iterator[tuple[Any, Model, float]]:
        if self.inside(model, group):
            about = min(known.estimates.without.get(self.name, math.inf), known.tol)
            yield (self.name, group[0]), self.switched(model, group, False), about

    def rows(self, known: Evidence, at: Place) -> Iterator[Choice]:
        trials, inside = known.trials, self.inside(at.model, at.group)
        other = self.switched(at.model, at.group, not inside)
        estimate = known.estimates.without.get(self.name, math.inf)
        if inside:
            error, how = known.without(other, estimate, at.most)
            yield Choice(at.where, self.name, "yes", error, how, trials.share(at.model, other), True)
        elif math.isfinite(estimate):
            yield Choice(at.where, self.name, "no", estimate, ESTIMATE, trials.share(other, at.model), False)
        else:  # something cannot do without
            now, then = known.known(at.model), known.known(other)
            lost = None if now is None or then is None else abs(now - then)
            yield Choice(at.where, self.name, "no", lost, RUN, trials.share(other, at.model), False)


class RotaryInertia(Switch):
    """Of a beam's slices. Torsion and shear cannot do without."""

    name = "rotary inertia"

    def inside(self, model: Model, group: list[int]) -> bool:
        beam = model.beams[group[0]]
        return beam is not None and beam.rotary

    def switched(self, model: Model, group: list[int], on: bool) -> Model:
        return model.but(group, rotary=on)


class LinkFeature(Switch):
    """Something of a link, beam or not, that the scene has."""

    def has(self, link: Link) -> bool:
        raise NotImplementedError

    def leave_out(self, link: Link) -> Link:
        """The link without it."""
        raise NotImplementedError

    def groups(self, models: Models) -> list[list[int]]:
        return [group for group in models.link_groups if all(self.has(models.scene.arm.links[k]) for k in group)]

    def inside(self, model: Model, group: list[int]) -> bool:
        return (group[0], self) not in model.without

    def switched(self, model: Model, group: list[int], on: bool) -> Model:
        these = {(k, self) for k in group}
        return replace(model, without=model.without - these if on else model.without | these)


class GaussPoints(Decision):
    """How many slices a beam has. They are left out last; see Descent.slices."""

    def rows(self, known: Evidence, at: Place) -> Iterator[Choice]:
        if at.beam.rigid:
            return
        full = at.model.but(at.group, gauss=None)
        beam = known.trials.models.arm(full).links[at.group[0]].beam
        assert beam is not None
        most = beam._core.gauss_points
        if at.beam.gauss is None:
            yield Choice(at.where, "Gauss points", str(most), None, "of the basis", 0.0, True)
            return
        now, then = (known.known(model, any_gauss=False) for model in (at.model, at.model.but(gauss=None)))
        cost = None if now is None or then is None else abs(now - then)
        time = known.trials.share(full, at.model)
        yield Choice(at.where, "Gauss points", f"{at.beam.gauss} of {most}", cost, RUN, time, False)


#: In the order of the table.
DECISIONS: tuple[Decision, ...] = (Modes(), Order(), RotaryInertia(), GaussPoints())
