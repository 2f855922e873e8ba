"""Cylinders: struts with a mass, which are links of their own, so that all that drives a joint drives their length."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._check import Array
from .beam import RigidBody
from .joints import UNIT, Axes, Joint, Placement, Prismatic, Revolute, Spherical
from .link import Link
from .loop import Loop
from .strut import Point

_FLAT = 1e-9  # of its length: how far off its plane a cylinder is that swings in it
_SAMPLES = 5


def tube(name: str) -> str:
    """The name of the link that turns with a cylinder."""
    return f"{name} mount"


def tie(name: str) -> str:
    """The name of the loop that holds a cylinder's rod on its point b."""
    return f"{name} end"


def cylinders(arm: Any) -> tuple[list[Link], list[Loop]]:
    """Of a Chain without them: the tubes and rods of its cylinders, in turn, and the loops that close them."""
    links, loops = [], []
    for k, strut in enumerate(arm.struts):
        if strut.mass is not None:
            links += _links(arm, k)
            loops.append(Loop(Point(strut.name, "end"), strut.b, Spherical(), name=tie(strut.name)))
    return links, loops


def _links(arm: Any, k: int) -> list[Link]:
    strut, (a, b) = arm.struts[k], arm._fastened[k]
    n, on, x, offset = a
    of: Any = None if n < 0 else arm.links[n]
    if on == "origin" and of.beam is None:
        offset = offset - sum((np.array(body.end) for body in (of.hub, of.tip) if body is not None), np.zeros(3))
    elif on == "origin" or (on == "slice" and not x):
        raise ValueError(
            f"struts[{k}].a: sits where the beam of {arm.names[n]} begins: a cylinder (mass = {strut.mass:g}) turns on "
            "a link's end, on a slice of its beam, or on the world; exchange a and b, or take a place along the beam"
        )
    ways = _directions(arm, a, b)
    length = float(np.linalg.norm(ways[0]))
    if not length > 0.0:
        raise ValueError(f"struts[{k}]: mass = {strut.mass:g}: its length is zero at q = zero: it has no direction")
    R, turn, slide = _axes(ways[0] / length, ways)
    place, name = Placement(offset, R.tolist()), tube(strut.name)
    joint: Joint = Revolute(turn, inboard=place, name=name) if turn else Axes(("rz", "ry"), inboard=place, name=name)
    rod = RigidBody(strut.mass, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    return [
        Link(joint, name=name, parent="world" if n < 0 else n, at=x if on == "slice" else None),
        Link(Prismatic(slide, name=strut.name), rod, name=strut.name),
    ]


def _directions(arm: Any, a: Any, b: Any) -> Array:
    """From a to b in the axes of a (m), (n, 3): at q = zero, and where all coordinates are any."""
    drawn = np.random.default_rng(0).uniform(-0.5, 0.5, (_SAMPLES, arm.nq))
    q = np.vstack([arm._core.zero, arm._core.zero + drawn])
    (p, R), (end, _) = arm._point_frame(q, a), arm._point_frame(q, b)
    return np.asarray(np.einsum("nji,nj->ni", R, end - p))


def _axes(along: Array, ways: Array) -> tuple[Array, str | None, str]:
    """The axes (columns) of a joint that lets a cylinder follow all ways; the one about which it turns, None where that
    takes two; and the one along which the rod slides."""
    _, size, Vt = np.linalg.svd(ways)
    if size[2] > _FLAT * size[0]:
        aside = np.cross(along, np.eye(3)[np.abs(along).argmin()])
        aside /= np.linalg.norm(aside)
        return np.column_stack([along, aside, np.cross(along, aside)]), None, "x"
    normal = Vt[2]
    if size[1] <= _FLAT * size[0]:  # it does not turn
        normal = np.cross(along, np.eye(3)[np.abs(along).argmin()])
        normal /= np.linalg.norm(normal)
    k = int(np.abs(normal).argmax())
    if abs(abs(normal[k]) - 1.0) < _FLAT:
        normal = np.eye(3)[k]
    along = along - (along @ normal) * normal
    along /= np.linalg.norm(along)
    if normal[k] != 1.0 or k == 2:
        return np.column_stack([along, np.cross(normal, along), normal]), "z", "x"
    if k == 1:
        return np.column_stack([along, normal, np.cross(along, normal)]), "y", "x"
    return np.column_stack([normal, along, np.cross(normal, along)]), "x", "y"


def stretched(arm: Any, q: Array, held: NDArray[np.bool_]) -> Array:
    """q with the cylinders where their points are, but for rates that are held (nv,)."""
    out = q.copy()
    for mount in arm._tubes:
        name, joint, along = arm.names[mount + 1], arm.links[mount].joint, arm.links[mount + 1].joint.axis
        turns, (slide,) = arm.joint_rates(mount), arm.joint_rates(mount + 1)
        if held[turns].any():
            continue
        bare = out.copy()
        bare[[arm.coordinate_of(i) for i in (*turns, slide)]] = 0.0
        p, R = arm._core.frame(bare, mount + 1, None)
        way = R.T @ (arm._point_frame(out, arm._fastened[arm._strut(name)][1])[0] - p)
        forth, about = np.array(UNIT[along]), np.array(UNIT[getattr(joint, "axis", "z")])
        out[arm.coordinate_of(turns[0])] = np.arctan2(way @ np.cross(about, forth), way @ forth)
        for i in turns[1:]:  # about y, from x towards -z
            out[arm.coordinate_of(i)] = -np.arctan2(way[2], np.hypot(way[0], way[1]))
        if not held[slide]:
            out[arm.coordinate_of(slide)] = np.linalg.norm(way)
    return out
