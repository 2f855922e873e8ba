"""The forces that a run lacks, of a poorer model than another, source by source.

The motion of the poorer model, in the coordinates of the richer one, is the motion of the richer one under further
forces: what its inverse dynamics asks for on that motion, less what acts. The models between the two differ in one
property of one beam each, and so tell the forces apart.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from .._check import Array
from ..arm.arm import Arm
from ..model.acting.load import at_time, pushes
from ..model.parts.beam import STRAINS
from ..run.result import Result
from ..run.scene.scene import Scene
from ..run.start import state
from .indicators import acting_on, forces
from .models import BeamModel, Model, Models
from .states import embed, keys, restated

ORDER, ROTARY, GAUSS = "order of rotation", "rotary inertia", "Gauss points"
BASIS, START, REST = "basis", "start", "rest"


class Lack(NamedTuple):
    """Forces (nt, nv) on the coordinates of the rich arm that a source lacks; `number`: of the shape function, from 1;
    0 where it is of no single one."""

    where: str
    what: str
    number: int
    forces: Array


class Between:
    """The models between a scene's own and a richer one.

    Attributes:
        rich: the richer model. arm: its arm.
        first: the richer model's shapes of the strains that the scene's model has; all else is the scene's.
        steps: where, what, and the model with this and all before it. last: the last of them.
    """

    def __init__(self, models: Models, rich: Model) -> None:
        self.models, self.rich, self.arm = models, rich, models.arm(rich)
        self.names = models.scene.arm.names

        def base(k: int, beam: BeamModel) -> BeamModel:
            own = models.given.beam(k)
            counts = tuple(n if m else 0 for n, m in zip(beam.counts, own.counts, strict=True))
            return replace(own, counts=counts, basis=beam.basis)

        model = self.first = rich.each(base)
        self.steps: list[tuple[str, str, Model]] = []
        for k, beam in enumerate(rich.beams):
            for what, change in () if beam is None else (
                (ORDER, {"order": beam.order}), (ROTARY, {"rotary": beam.rotary}), (GAUSS, {"gauss": beam.gauss})
            ):  # fmt: skip
                new = model.but([k], **change)
                if new != model:
                    self.steps.append((self.names[k], what, new))
                    model = new
        self.last = model

    def lacks(self, run: Result) -> Iterator[Lack]:
        """All that a run of the scene's own model lacks; their sum is what its motion lacks in the rich arm."""
        arm = self.models.arm(self.first)
        scene, acting = self.models.scene, acting_on(self.models, run, self.arm)
        lifted = embed(run, arm)
        before = self._up(forces(scene, lifted, arm), arm)
        own = {key[:2] for key in keys(arm)}
        yield from self._by_shape(before - acting, lambda key: key in own and key[0] >= 0, "modes")
        joints = [i for i, key in enumerate(keys(self.arm)) if key[0] < 0]
        yield Lack("arm", BASIS, 0, _only(before - acting, joints))
        for where, what, model in self.steps:
            arm = self.models.arm(model)
            now = self._up(forces(scene, lifted, arm), arm)
            yield Lack(where, what, 0, now - before)
            before = now
        whole = forces(scene, embed(lifted, self.arm))
        yield from self._by_shape(whole - acting, lambda key: key not in own, "left out")
        rest = [i for i, key in enumerate(keys(self.arm)) if key[:2] in own]
        yield Lack("arm", REST, 0, _only(whole - before, rest))

    def _up(self, forces: Array, arm: Arm) -> Array:
        return restated(forces, arm, self.arm, rates=True)

    def _by_shape(self, forces: Array, which: Callable[[tuple[int, int]], bool], word: str) -> Iterator[Lack]:
        for i, (k, s, number) in enumerate(keys(self.arm)):
            if which((k, s)):
                yield Lack(self.names[k], f"{STRAINS[s]} {word}", number, _only(forces, [i]))


def _only(forces: Array, columns: list[int]) -> Array:
    out = np.zeros_like(forces)
    out[:, columns] = forces[:, columns]
    return out


def static_weights(scene: Scene, held: set[int], weights: Array) -> Array:
    """Derivatives of a number by forces (nv,) on an arm that begins in balance, from those by its start: through the
    stiffness there.

    Args:
        held: rates of the joints that do not give way. weights: the derivatives by the start, (nv,).
    """
    arm, t = scene.arm, float(scene.t[0])
    q, v = state(arm, scene.q0, scene.v0, scene.drive, scene.loads, t, scene.control)
    loads = [*scene.loads, *pushes(arm, scene.drive)]
    by_q, _ = arm._core.inverse_derivatives(q, v, np.zeros(arm.nv), *at_time(arm, loads, t))
    K = np.asarray(by_q @ arm._core.rates(q, v)[2])
    free = [i for i in range(arm.nv) if i not in held]
    out = np.zeros(arm.nv)
    out[free] = np.linalg.lstsq(K[np.ix_(free, free)].T, weights[free], rcond=None)[0]
    return out
