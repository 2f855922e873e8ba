"""The link: joint, hub, beam and tip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import flexarm._core as _core

from ..._check import instances
from .beam import Beam, RigidBody
from .joints import Joint
from .look import Look
from .part import Part, read_name


@dataclass(frozen=True)
class Link(Part):
    """A joint and up to three bodies: a rigid hub, an elastic beam, a rigid tip. (Sec. 4.2)

    The joint sits at the end of its parent, or on a slice of its beam, in its axes. The beam starts at `hub.end`; the
    tip sits on the beam's last section (or at `hub.end`), in its axes; the links that it carries sit at `tip.end`.

    Args:
        joint: connects the link to its parent.
        hub: the rigid body that the joint moves.
        beam: the elastic beam, clamped to the hub.
        tip: the rigid body on the beam's end, such as a payload.
        name: such as "forearm"; it may be used instead of the link's number, and labels the elastic coordinates, and a
            joint without a name. No dots, no number; unique in the arm.
        looks: meshes and solids that are drawn for it, besides its beam. Without them each rigid body is
            drawn as the box of the same inertia.
        parent: the link on which the joint sits: the name or the number of one before it in the list, or "world";
            None: the link before it, or the world for the first one. A link that several others name carries branches.
        at: where along the parent's beam the joint sits (m from the beam's start, above 0 and up to its length): on the
            slice there, with which it moves and turns. None: on the parent's end, which is that of its tip.
    """

    joint: Joint
    hub: RigidBody | None = None
    beam: Beam | None = None
    tip: RigidBody | None = None
    name: str | None = None
    looks: Sequence[Look] = ()
    parent: str | int | None = None
    at: float | None = None
    _core: _core.Link = field(init=False, repr=False, compare=False)

    def _made(self) -> Any:
        read_name(self.name)
        if isinstance(self.parent, bool) or not isinstance(self.parent, (str, int, type(None))):
            raise ValueError(f"parent = {self.parent!r}: must be the name or number of a link, 'world' or None")
        self._set("looks", instances("looks", self.looks, Look, "Look"))
        hub, beam, tip = (p._core if p is not None else None for p in (self.hub, self.beam, self.tip))
        return _core.Link(self.joint._core, hub, beam, tip)  # type: ignore[arg-type]

    @property
    def mass(self) -> float:
        """kg"""
        return float(self._core.mass)
