"""Loops: joints that close an arm on itself, or on the world."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, field
from typing import Any

import numpy as np

from ..._check import Array
from .joints import (
    FORCES,
    UNIT,
    Cylindrical,
    Fixed,
    Joint,
    Placement,
    Planar,
    Prismatic,
    Revolute,
    Spherical,
    Universal,
    axes_about,
)  # fmt: skip
from .part import NotNegative, Part, Positive, read_name
from .strut import Point

KINDS: tuple[type[Joint], ...] = (Fixed, Revolute, Prismatic, Cylindrical, Universal, Planar, Spherical)


@dataclass(frozen=True)
class Loop(Part):
    """A joint that closes a loop: between places of two links, or of a link and the world.

    The links of an arm are a chain or a tree; cut each loop of the mechanism at one joint, and close it by a Loop with
    that joint. It holds the frame of b on that of a as the joint would if it carried b: the joint's `inboard` is seen
    from the frame of a, and the frame of b from the joint's moving side is its `outboard`.

    Args:
        a, b: the places, and their frames: a Point, whose axes are those of its link's end, origin or slice, or of the
            world; or short, a link (its end), (link, at), or (x, y, z), a place in the world (m).
        joint: Fixed, Revolute, Prismatic, Cylindrical, Universal, Planar or Spherical. It moves freely: springs,
            dampers, stops, friction and motors belong to a joint of a link; cut the loop at another joint then. Of
            turns it holds right angles between axes, which remain right where an axis is reversed: a hinge whose
            axes point opposite ways at the start counts as closed, and stays so. Its `place` is then counted the other
            way; turn the joint's `inboard` or `outboard` by pi to have it the usual way.
        stiffness: of the directions that the joint holds (N/m); None: it is rigid there.
        damping: of these (N s/m); 0 if it is rigid.
        angular_stiffness: of the turns that the joint holds (N m/rad); None: it is rigid there.
        angular_damping: of these (N m s/rad); 0 if it is rigid.
        name: such as "coupler", in place of "loop 0" and so on, by its number in the arm. No dots, no number; different
            from the names of the arm's links, joints, struts and contacts.
    """

    a: Point | str | int | Sequence[Any]
    b: Point | str | int | Sequence[Any]
    joint: Joint
    _: KW_ONLY
    stiffness: Positive | None = None
    damping: NotNegative = 0.0
    angular_stiffness: Positive | None = None
    angular_damping: NotNegative = 0.0
    name: str | None = None
    #: of the joint's frame on a, and on b: origin (3,) and axes (columns, (3, 3)), from the places and in their axes
    _core: tuple[tuple[Array, Array], tuple[Array, Array]] = field(init=False, repr=False, compare=False)

    def _made(self) -> Any:
        read_name(self.name)
        self._set("a", Point.of("a", self.a))
        self._set("b", Point.of("b", self.b))
        joint = self.joint
        if type(joint) not in KINDS:
            known = ", ".join(x.__name__ for x in KINDS[:-1])
            raise ValueError(
                f"joint = {type(joint).__name__}: closes no loop; must be {known} or {KINDS[-1].__name__}"
            )
        for name in FORCES:
            if getattr(joint, name) != type(joint).__dataclass_fields__[name].default:
                raise ValueError(
                    f"joint: {name} = {getattr(joint, name)!r}: the joint that closes a loop moves freely; cut the "
                    f"loop at another joint, and give this one, with its {name}, to a link"
                )
        if joint.name is not None:
            raise ValueError(f"joint: name = {joint.name!r}: must be None; give the loop a name")
        if self.angular_stiffness is not None and isinstance(joint, Spherical):
            raise ValueError(f"angular_stiffness = {self.angular_stiffness:g}: a spherical joint holds no turn")
        for kind, unit in (("", "N/m"), ("angular_", "N m/rad")):
            damping = getattr(self, f"{kind}damping")
            if damping and getattr(self, f"{kind}stiffness") is None:
                raise ValueError(
                    f"{kind}damping = {damping:g}: must be 0 where the joint is rigid; give {kind}stiffness ({unit})"
                )
        own: Any = getattr(joint, "axis", "z")
        axes = axes_about(np.array(UNIT[own] if isinstance(own, str) else own))
        (at, inward), (end, out) = ((side or Placement())._core for side in (joint.inboard, joint.outboard))
        return (at, inward @ axes), (-out.T @ end, out.T @ axes)

    @property
    def rigid(self) -> bool:
        """Whether it holds something without giving way."""
        turns = self.angular_stiffness is None and not isinstance(self.joint, Spherical)
        return self.stiffness is None or turns

    @property
    def gives_way(self) -> bool:
        """Whether it gives way in anything that it holds."""
        return self.stiffness is not None or self.angular_stiffness is not None

    def place(self, p: Array, R: Array) -> Array:
        """The joint's coordinates (..., nq), as of a link's joint, of its frame on b as seen from that on a: the origin
        (..., 3) and the axes (columns, (..., 3, 3))."""
        if isinstance(self.joint, Spherical):
            from scipy.spatial.transform import Rotation  # slow to import

            turned = Rotation.from_matrix(R.reshape(-1, 3, 3)).as_quat(canonical=True)[:, [3, 0, 1, 2]]
            return np.asarray(turned).reshape(*R.shape[:-2], 4)
        (x, y, z), turn = np.moveaxis(p, -1, 0), np.arctan2(R[..., 1, 0], R[..., 0, 0])
        tilts = np.arctan2(R[..., 2, 1], R[..., 1, 1]), np.arctan2(R[..., 0, 2], R[..., 0, 0])
        found: dict[str, tuple[Array, ...]] = {
            "fixed": (), "revolute": (turn,), "prismatic": (z,), "cylindrical": (z, turn), "universal": tilts,
            "planar": (x, y, turn),
        }  # fmt: skip
        out = np.zeros((*p.shape[:-1], self.joint.nq))
        for k, value in enumerate(found[self.joint.type]):
            out[..., k] = value
        return out
