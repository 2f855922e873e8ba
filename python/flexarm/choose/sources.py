"""What each part of a model is worth: how the quantity of a rich model's run changes without it, from that run alone.

Without a shape, its coordinate is held at zero; in a poorer order, or without rotary inertia, other forces act on the
same motion. The equations of small motions along the run tell how all else moves then, over the whole run and for all
parts at once, and the quantity what that changes. Changes add up, and so every model below the rich one has its
estimated error over time, without a run.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np

from .._check import Array
from ..arm.arm import Arm
from ..run.result import Result
from .indicators import Tangents, forces, smoothed
from .measures import Measure
from .models import ORDERS, Model, Models, lowest_order
from .states import embed, keys, restated
from .trials import Run

MODES, ORDER, ROTARY = "modes", "order", "rotary inertia"

#: Changes of the quantity over time, over its span, by unit.
Change: TypeAlias = dict[str, Array]
#: (what, first link of a group, ...): a shape of a strain (strain, number), an order, rotary inertia.
Part: TypeAlias = tuple[Any, ...]


class Sources:
    """Estimated changes of a run's quantity by parts of its model.

    Args:
        models: of the scene. measure: with its span. run: of the rich model, kept at evenly spaced times, too.

    Attributes:
        changes: by part, what leaving it out changes.
    """

    def __init__(self, models: Models, measure: Measure, run: Run) -> None:
        assert run.result is not None and run.values is not None
        self.models, self.measure, self.rich, self.run = models, measure, run.model, run.result
        self.scene = models.at(run.model, {})
        assert run.dense is not None
        self.fine = smoothed(run.dense)
        self.tangents = Tangents(self.scene, self.fine)
        self.changes: dict[Part, Change] = {}
        self._known: dict[Model, Change] = {}
        names, arm = keys(self.scene.arm), self.scene.arm
        held = {(MODES, group[0], s, n): [names.index((k, s, n)) for k in group]
                for group, s, count in models.items(self.rich) for n in range(1, count + 1)}  # fmt: skip
        none = np.zeros(self.fine.v.shape)
        lacking = [*((part, none, arm) for part in held), *self._lacking()]
        if not lacking:
            return
        pushed = np.stack([f for _, f, _ in lacking], axis=2)
        x, v = self.tangents.answers(pushed, list(held.values()), models.start.balanced)
        whole = self.run
        E = np.array([arm._core.rates(*row)[2] for row in zip(whole.q, whole.v, strict=True)])
        own = self._values(whole)
        for k, (part, _, other) in enumerate(lacking):
            dx, dv = (np.array([np.interp(whole.t, self.fine.t, row) for row in y[:, :, k].T]).T for y in (x, v))
            q = whole.q + np.einsum("tij,tj->ti", E, dx)
            for _, ball in arm.quaternions():
                q[:, ball] /= np.linalg.norm(q[:, ball], axis=1, keepdims=True)
            moved = self._values(replace(whole, arm=other, q=q, v=whole.v + dv))
            self.changes[part] = {u: (moved[u] - own[u]) / span for u, span in self.measure.span.items()}

    def _values(self, run: Result) -> dict[str, Array]:
        return self.measure.values(run, self.models.first(self.rich))

    def _lacking(self) -> Iterator[tuple[Part, Array, Arm]]:
        """Each part that is no shape, the forces (nt, nv) of leaving it out, and the arm that makes the quantity."""
        arm, fine = self.scene.arm, self.fine
        all_of_it = forces(self.scene, fine)
        for group in self.models.groups:
            for order in orders(self.models, group):
                if order != self.rich.beam(group[0]).order:
                    other = self.models.arm(self.rich.but(group, order=order))
                    yield (ORDER, group[0], order), all_of_it - forces(self.scene, fine, other), other
            if self.rich.beam(group[0]).rotary:
                bare = self._bare(group)
                few, none = (self.models.arm(bare.but(group, rotary=rotary)) for rotary in (True, False))
                some = embed(fine, few)
                lost = forces(self.scene, some) - forces(self.scene, some, none)
                yield (ROTARY, group[0]), restated(lost, few, arm, rates=True), arm

    def _bare(self, group: list[int]) -> Model:
        """The rich model without the strains of these links that need rotary inertia."""
        bare = {k: (*b.counts[:2], 0, 0, 0, *b.counts[5:]) for k, b in enumerate(self.rich.beams) if b and k in group}
        return self.rich.each(lambda k, b: replace(b, counts=bare.get(k, b.counts)))

    # -- estimates ---------------------------------------------------------------------------------------------------

    def left_out(self, model: Model) -> Iterator[Part]:
        """The parts of the rich model that a model has not."""
        for group in self.models.groups:
            k = group[0]
            ours, theirs = self.rich.beam(k), model.beam(k)
            for s, (n, most) in enumerate(zip(theirs.counts, ours.counts, strict=True)):
                yield from ((MODES, k, s, i) for i in range(n + 1, most + 1))
            if theirs.order != ours.order and not theirs.rigid:
                yield ORDER, k, theirs.order
            if ours.rotary and not theirs.rotary:
                yield ROTARY, k

    def change(self, model: Model) -> Change:
        """The estimated change of the quantity by a model below the rich one."""
        if model not in self._known:
            parts = [self.changes[part] for part in self.left_out(model) if part in self.changes]
            zero = {u: 0.0 * x for u, x in next(iter(self.changes.values()), {}).items()}
            self._known[model] = {u: x + np.sum([part[u] for part in parts], axis=0) for u, x in zero.items()}
        return self._known[model]

    def size_of(self, *parts: Part) -> float:
        """The largest change by some parts together."""
        some = [self.changes[part] for part in parts if part in self.changes]
        return size({u: np.sum([x[u] for x in some], axis=0) for u in some[0]}) if some else 0.0


def size(change: Change) -> float:
    """The largest change over time and places."""
    with np.errstate(all="ignore"):
        most = max((float(np.linalg.norm(x, axis=-1).max(initial=0.0)) for x in change.values()), default=0.0)
    return most if np.isfinite(most) else np.inf


def orders(models: Models, group: list[int]) -> tuple[int | str, ...]:
    """The orders that the beams of a group may have, from poor to rich."""
    beam = models.scene.arm.links[group[0]].beam
    return ORDERS if beam is None else ORDERS[ORDERS.index(lowest_order(beam)) :]
