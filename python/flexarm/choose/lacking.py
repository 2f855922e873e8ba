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
from ..model.acting.control import control_laws
from ..model.acting.load import Load, at_time, pushes
from ..model.parts.beam import STRAINS
from ..run.result import Result
from ..run.scene.scene import Scene
from ..run.start import state
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
        self._acting: dict[bytes, Array] = {}

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

    def forces(self, run: Result, arm: Arm) -> Array:
        """Inverse dynamics along a run, of its arm or of another one with its coordinates, less the loads' forces."""
        scene = self.models.scene
        loads = [*scene.loads, *pushes(arm, scene.drive)]
        places, wrenches = [load.place(arm) for load in loads], self._wrenches(run.t, loads)
        return np.asarray(arm._core.inverse_dynamics(run.q, run.v, run.a, places, wrenches))

    def _wrenches(self, t: Array, loads: list[Load]) -> Array:
        """What loads are at times, (nt, n, 6); the same ones on all arms."""
        key = t.tobytes()
        if key not in self._acting:
            rows = [[load.numbers(x) for load in loads] for x in t.tolist()]
            self._acting[key] = np.array(rows).reshape(len(t), len(loads), 6)
        return self._acting[key]

    def acting(self, run: Result, arm: Arm) -> Array:
        """What acts on the coordinates of a run, beside loads, in those of another model: on joints as it is; on beams
        by the voltages of patches. Feedback reads what the other model shows, such as another strain at a clamp."""
        of, found = run.arm, self.forces(run, run.arm)
        out = restated(found, of, arm, rates=True)
        if self.models.pinned:  # something may act on coordinates by number; they are the same
            return out
        out[:, _elastic(arm)] = 0.0
        if of.patch_matrix.size and of.patch_matrix[_elastic(of)].any():
            volts = np.linalg.lstsq(of.patch_matrix[_elastic(of)], found[:, _elastic(of)].T, rcond=None)[0]
            out[:, _elastic(arm)] = (arm.patch_matrix[_elastic(arm)] @ volts).T
        scene, lifted = self.models.scene, embed(run, arm)
        theirs, own = (control_laws(a, scene.control, scene.t, scene.loads)[0] for a in (arm, of))
        for f, g in zip(theirs, own, strict=True):  # a force is column (reference - by_q q - by_v v)
            read = lifted.q @ f.by_q[: arm.nq] + lifted.v @ f.by_v[: arm.nv]
            before = run.q @ g.by_q[: of.nq] + run.v @ g.by_v[: of.nv]
            out -= np.outer(read - before, f.column[: arm.nv])
        return out

    def lacks(self, run: Result) -> Iterator[Lack]:
        """All that a run of the scene's own model lacks; their sum is what its motion lacks in the rich arm."""
        arm = self.models.arm(self.first)
        acting = self.acting(run, self.arm)
        lifted = embed(run, arm)
        before = self._up(self.forces(lifted, arm), arm)
        own = {key[:2] for key in keys(arm)}
        yield from self._by_shape(before - acting, lambda key: key in own and key[0] >= 0, "modes")
        joints = [i for i, key in enumerate(keys(self.arm)) if key[0] < 0]
        yield Lack("arm", BASIS, 0, _only(before - acting, joints))
        for where, what, model in self.steps:
            arm = self.models.arm(model)
            now = self._up(self.forces(lifted, arm), arm)
            yield Lack(where, what, 0, now - before)
            before = now
        whole = self.forces(embed(lifted, self.arm), self.arm)
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


def _elastic(arm: Arm) -> list[int]:
    return [i for i, key in enumerate(keys(arm)) if key[0] >= 0]


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
