"""What can be left out of an arm: its models as rungs of a ladder, link by link, and the scene with one of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from ..acting.control import control_laws
from ..acting.sampled import Sampled
from ..arm import Arm
from ..parts.beam import STRAINS, Beam
from ..parts.link import Link
from ..scene.scene import Scene
from .ladder import initial_state, other_basis

ORDERS: tuple[int | str, ...] = (0, 1, 2, 3, "exact")
_MANY = 4  # more beams than this are treated alike where they are alike


@dataclass(frozen=True)
class Rung:
    """How one beam is modelled.

    Attributes:
        counts: shape functions of bending_y, bending_z, torsion, shear_y, shear_z; all zero: rigid.
        order: of the rotation of its sections.
        rotary: whether its slices have rotary inertia.
        gauss: its Gauss points; None: as many as its basis asks for.
        basis: of its shape functions; None: the scene's.
    """

    counts: tuple[int, ...]
    order: int | str
    rotary: bool
    gauss: int | None = None
    basis: str | None = None

    def __post_init__(self) -> None:
        if not any(self.counts):  # nothing turns in a rigid beam: all orders are the same
            object.__setattr__(self, "order", 1)
            object.__setattr__(self, "gauss", None)
            object.__setattr__(self, "basis", None)

    @property
    def label(self) -> str:
        """Such as "order 2, bending_y 3, torsion 1"."""
        used = ", ".join(f"{s} {n}" for s, n in zip(STRAINS, self.counts, strict=True) if n)
        rest = ("", ", no rotary inertia")[not self.rotary] + (f", {self.gauss} Gauss points" if self.gauss else "")
        used += f" ({self.basis})" if self.basis else ""
        return f"order {self.order}, {used}{rest}" if used else f"rigid{rest}"

    def with_count(self, strain: int, n: int) -> Rung:
        return replace(self, counts=(*self.counts[:strain], n, *self.counts[strain + 1 :]))


#: One for each link; None where it has no beam.
Model = tuple[Rung | None, ...]


def rung_of(beam: Beam | None) -> Rung | None:
    if beam is None:
        return None
    return Rung(tuple(beam.counts.get(s, 0) for s in STRAINS), beam.order, beam.rotary_inertia, beam.gauss_points)


def beam_at(beam: Beam, rung: Rung) -> Beam:
    """The beam so modelled; strain shapes of the user's own are left out from the last on, never added to."""
    modes: dict[str, Any] = {}
    for strain, n in zip(STRAINS, rung.counts, strict=True):
        own = beam.modes.get(strain)
        if n:
            modes[strain] = list(own[:n]) if isinstance(own, tuple) else n
    given = {f.name: getattr(beam, f.name) for f in fields(beam) if f.init}
    basis = {} if rung.basis is None else {"basis": rung.basis, "basis_tip": None}
    choice = {"modes": modes, "order": rung.order, "rotary_inertia": rung.rotary, "gauss_points": rung.gauss}
    return Beam(**{**given, **choice, **basis})


class Rungs:
    """The models of a scene's arm.

    Attributes:
        given: the scene's own model.
        groups: lists of links whose beams are chosen alike: one each, but where many beams are equal.
        pinned: why the modes cannot be changed, if something reads the elastic coordinates by number; else "".
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.given: Model = tuple(rung_of(link.beam) for link in scene.arm.links)
        beams = [k for k, rung in enumerate(self.given) if rung is not None]
        self.groups: list[list[int]] = []
        for k in beams:
            alike = [g for g in self.groups if scene.arm.links[g[0]].beam == scene.arm.links[k].beam]
            if len(beams) > _MANY and alike:
                alike[0].append(k)
            else:
                self.groups.append([k])
        self._arms: dict[Model, Arm] = {}
        self.pinned = self._pinned()

    def _pinned(self) -> str:
        for k, c in enumerate(self.scene.control):
            if isinstance(c, Sampled) and c.measure is None:
                return f"control[{k}] reads the whole state"
            if hasattr(c, "K"):
                return f"control[{k}] has a gain for every coordinate"
            if any(isinstance(e, (np.ndarray, list)) for e in getattr(c, "actuate", ())):
                return f"control[{k}] acts on coordinates by number"
        return ""

    def other_basis(self, link: int) -> str | None:
        """As ladder's; nor may one stand in where something reads the elastic coordinates by number."""
        return None if self.pinned else other_basis(self.scene, link)

    def rebased(self, model: Model) -> Model:
        """The model in Legendre polynomials, where they may stand in."""
        return tuple(
            replace(r, basis=self.other_basis(k)) if r is not None and r.basis is None else r
            for k, r in enumerate(model)
        )

    def most(self, link: int) -> tuple[int | None, ...]:
        """How many shapes each strain can have at most: None: any number."""
        beam = self.scene.arm.links[link].beam
        assert beam is not None
        own = [beam.modes.get(s) for s in STRAINS]
        sheared = beam.material.poisson_ratio is not None or beam.material.shear_modulus is not None
        free = (None, None, *((None,) * 3 if sheared else (0,) * 3))
        return tuple(len(o) if isinstance(o, tuple) else limit for o, limit in zip(own, free, strict=True))

    def arm(self, model: Model) -> Arm:
        """The arm so modelled. ValueError where such an arm cannot be."""
        if model not in self._arms:
            made: dict[tuple[int, Rung], Link] = {}
            links = []
            for link, rung in zip(self.scene.arm.links, model, strict=True):
                if link.beam is None or rung is None:
                    links.append(link)
                    continue
                key = id(link), rung
                if key not in made:
                    made[key] = Link(link.joint, link.hub, beam_at(link.beam, rung), link.tip)
                links.append(made[key])
            self._arms[model] = Arm._made(links, self.scene.arm.gravity)
        return self._arms[model]

    def at(self, model: Model, options: dict[str, Any]) -> Scene:
        """The scene with this model, and its initial state."""
        arm, old = self.arm(model), self.scene
        q0, v0 = initial_state(old, arm)
        return replace(old, arm=arm, q0=q0, v0=v0, options=options)

    def usable(self, model: Model) -> str:
        """Why the scene's controllers or sensors cannot do with this model; "" if they can."""
        if not self.scene.control and not self.scene.sensors:
            return ""
        try:
            arm = self.arm(model)
            control_laws(arm, self.scene.control, self.scene.t, self.scene.loads)
            for sensor in self.scene.sensors:
                sensor.check(arm, self.scene.t)
        except ValueError as e:
            return str(e)
        return ""

    # -- moves -------------------------------------------------------------------------------------------------------

    def set(self, model: Model, group: list[int], **change: Any) -> Model:
        """The model with something else for a group's beams: fields of Rung."""
        return tuple(replace(r, **change) if r is not None and k in group else r for k, r in enumerate(model))

    def with_count(self, model: Model, group: list[int], strain: int, n: int) -> Model:
        return tuple(r.with_count(strain, n) if r is not None and k in group else r for k, r in enumerate(model))

    def items(self, model: Model) -> Iterator[tuple[list[int], int, int]]:
        """(group, strain, count) of every strain that the model has."""
        for group in self.groups:
            rung = model[group[0]]
            assert rung is not None
            for strain, n in enumerate(rung.counts):
                if n:
                    yield group, strain, n

    def label(self, model: Model) -> str:
        """What the model is, link by link."""
        parts = []
        for group in self.groups:
            rung = model[group[0]]
            assert rung is not None
            name = f"link {group[0]}" + (f" and {len(group) - 1} like it" if len(group) > 1 else "")
            parts.append((f"{name}: " if len(self.given) > 1 else "") + rung.label)
        return "; ".join(parts) or "the rigid arm"
