"""The shape of an arm, apart from its motion: outlines of sections, solids, joints' axes, each fixed to a node.

A node is a frame that moves with the arm: the world (node 0), each link's own frame, slices of its beam, places where
loads act. Browser and matplotlib draw the same Body.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from .._check import Array
from ..model.acting.load import Load
from ..model.parts.beam import Beam, RigidBody, inertia_matrix
from ..model.parts.chain import Chain
from ..model.parts.contact import Contact, Plane, Sphere
from ..model.parts.joints import Joint, Placement
from ..model.parts.link import Link
from ..model.parts.patch import Patch
from ..model.parts.sections import Box, Circle, Ellipse, IBeam, Rectangle, Section, SectionMatrix, Tube
from ..model.parts.strut import Tendon
from .meshes import LOOK_COLOUR, Mesh, meshes_of

_ROUND = 28  # corners of a circle
_THIN = 2e-3  # of the arm's length: of planes
_DENSITY = 7800.0  # kg/m^3, of a point mass that is drawn as a ball


@dataclass
class Body:
    """The drawn shapes of an arm.

    Attributes:
        places: of each node, the link and the place along its beam (m); None for a link's own frame, (None, None) for
            the world.
        beams: {"first": node of its clamp, "count": slices, "outlines": (count, m, 2), y and z of the corners (m),
            "part": "beam", whose colour is strain, or "patch", a piezo patch}.
        solids: {"node", "part", "kind", "at": centre (m), "axes": 3 x 3, in columns, "size": (m)}: of a "box" its
                sides, of a "ball" its radius, of a "cylinder" its length along the first axis and its radius. "under":
                it is hidden where meshes are drawn; "colour": its own. Of contacts, "surface" and "toucher" are parts.
        meshes: triangles of the links' looks.
        bars: {"ends": two of (node, at) with a straight piece between, "part": "rod", a rail of a sliding joint, or
            "strut" or "tendon", a piece of one}.
        axes: {"node", "at", "direction", "length"}: of the joints' freedoms, long enough to stand out of the solids.
        labels: {"node", "at", "text"}.
        loads: nodes where loads act. tips: (node, at) of the arm's ends.
        size: length of the arm, stretched out, of a tree the longest way to an end (m).
    """

    size: float
    places: list[tuple[int | None, float | None]] = field(default_factory=lambda: [(None, None)])
    beams: list[dict[str, Any]] = field(default_factory=list)
    solids: list[dict[str, Any]] = field(default_factory=list)
    meshes: list[Mesh] = field(default_factory=list)
    bars: list[dict[str, Any]] = field(default_factory=list)
    axes: list[dict[str, Any]] = field(default_factory=list)
    labels: list[dict[str, Any]] = field(default_factory=list)
    loads: list[int] = field(default_factory=list)
    tips: list[tuple[int, Any]] = field(default_factory=list)

    def node(self, link: int | None, x: float | None = None) -> int:
        """A new node, and its number."""
        self.places.append((link, x))
        return len(self.places) - 1

    def solid(self, part: str, node: int, kind: str, at: Any, axes: Any, size: Sequence[float]) -> None:
        """A solid that moves with a node."""
        self.solids.append({"node": node, "part": part, "kind": kind, "at": at, "axes": axes, "size": list(size)})

    def rod(self, node: int, a: Array, b: Array, radius: float, part: str = "rod") -> None:
        """A round bar between two points of a node; none if they coincide."""
        length = float(np.linalg.norm(b - a))
        if length > 1e-6 * self.size:
            self.solid(part, node, "cylinder", (a + b) / 2, along((b - a) / length), (length, radius))


def along(direction: Array) -> Array:
    """A rotation whose first column is a direction of unit length, (3, 3)."""
    other = np.eye(3)[np.abs(direction).argmin()]
    second = np.cross(direction, other)
    second /= np.linalg.norm(second)
    return np.column_stack([direction, second, np.cross(direction, second)])


def outline(section: Section) -> Array:
    """Corners (y, z) of a section (m), (m, 2); for a section given by its integrals or matrices, those of the
    rectangle with the same radii of gyration."""
    if isinstance(section, (Rectangle, Box)):
        y, z = section.y, section.z
    elif isinstance(section, (Circle, Tube)):
        y = z = 2 * section.radius
    elif isinstance(section, Ellipse):
        y, z = section.y, section.z
    elif isinstance(section, IBeam):
        y, z = section.y / 2, section.z / 2
        inner, web = y - section.flange, section.web / 2
        right = np.array([(-y, z), (-inner, z), (-inner, web), (inner, web), (inner, z), (y, z)])
        return np.vstack([right, (right * (1, -1))[::-1]])
    else:
        if isinstance(section, SectionMatrix):
            K = section.stiffness
            area, iy, iz = K[0][0], K[4][4], K[5][5]
        else:
            core = section._core
            area, iy, iz = core.area, core.second_moment_y, core.second_moment_z
        y, z = (np.sqrt(12 * i / area) if area > 0 and i > 0 else 0.0 for i in (iz, iy))
        y, z = max(y, 0.05 * z), max(z, 0.05 * y)
    if isinstance(section, (Circle, Tube, Ellipse)):
        turn = 2 * np.pi * np.arange(_ROUND) / _ROUND
        return np.column_stack([y / 2 * np.cos(turn), z / 2 * np.sin(turn)])
    return np.array([(-y, -z), (y, -z), (y, z), (-y, z)]) / 2


def length(arm: Chain) -> float:
    """Length of the stretched-out arm, of a tree the longest way to an end (m)."""
    lengths = []
    for link in arm.links:
        places = [p.position for p in (link.joint.inboard, link.joint.outboard) if p is not None]
        ends = [body.end for body in (link.hub, link.tip) if body is not None]
        own = sum(float(np.linalg.norm(v)) for v in (*places, *ends))
        lengths.append(own + (link.beam.length if link.beam else 0.0))
    return arm.longest(lengths) or 1.0


def _mass(body: Body, part: str, node: int, at: Array, of: RigidBody) -> None:
    """A rigid body's mass, as the uniform box of the same inertia; a point mass as a ball of steel."""
    if not of.mass > 0:
        return
    J, axes = np.linalg.eigh(inertia_matrix(of.inertia))
    axes[:, 0] *= np.linalg.det(axes)  # a mirror image would turn the faces inside out
    sides = np.sqrt(np.maximum(6 * (J.sum() - 2 * J) / of.mass, 0.0))
    centre = at + np.array(of.com)
    if not sides.any():
        radius = (of.mass / _DENSITY / (4 / 3 * np.pi)) ** (1 / 3)
        body.solid(part, node, "ball", centre, np.eye(3), [min(radius, 0.2 * body.size)])
        return
    sides = np.maximum(sides, 0.05 * sides.max()) * min(1.0, 0.4 * body.size / sides.max())
    body.solid(part, node, "box", centre, axes, sides.tolist())


def _joint(
    body: Body, name: str, joint: Joint, below: tuple[int, Array], above: tuple[int, Array], radius: float
) -> None:
    """A joint's symbol and name, its axes, its rail and the rigid pieces on either side of it."""
    inboard, outboard = (p or Placement() for p in (joint.inboard, joint.outboard))
    (p_in, R_in), (p_out, R_out) = inboard._core, outboard._core
    (lower, at), (node, end) = below, above
    start = at + p_in
    moved = end - R_out.T @ p_out  # the joint's moving side
    body.rod(lower, at, start, radius / 3)
    body.rod(node, moved, end, radius / 3)
    freedoms = [(rotates, np.array(axis) / np.linalg.norm(axis)) for _, rotates, axis in joint._freedoms()]
    seen = {0: (lower, start, R_in), len(freedoms) - 1: (node, moved, R_out.T)}
    for i in sorted(seen if freedoms else ()):  # freedoms between these turn with neither side
        where, place, R = seen[i] if i else (lower, start, R_in)
        rotates, axis = freedoms[i]
        body.axes.append({"node": where, "at": place, "direction": R @ axis, "length": 6 * radius})
        if rotates:
            body.solid("joint", where, "cylinder", place, along(R @ axis), (2.6 * radius, radius))
        else:
            body.solid("joint", where, "box", place, along(R @ axis), (2.4 * radius, 1.8 * radius, 1.8 * radius))
    if joint.ball:
        body.solid("joint", node, "ball", moved, np.eye(3), [1.2 * radius])
    if any(not rotates for rotates, _ in freedoms):
        body.bars.append({"ends": [(lower, start), (node, moved)], "part": "rod"})
    body.labels.append({"node": lower, "at": start, "text": name})


def _beam(body: Body, k: int, beam: Beam, slices: int) -> None:
    x = np.linspace(0.0, beam.length, slices)
    _bar(body, k, "beam", x, [outline(beam.section.at(float(place))) for place in x])
    for patch in beam.patches:
        count = max(round(slices * (patch.end - patch.start) / beam.length), 2)
        x = np.linspace(patch.start, patch.end, count)
        for side in (1, -1):
            if patch.face[0] != "+-"[side == 1]:
                _bar(body, k, "patch", x, [_layer(beam, patch, float(place), side) for place in x])


def _bar(body: Body, k: int, part: str, x: Array, outlines: list[Array]) -> None:
    first = len(body.places)
    for place in x:
        body.node(k, float(place))
    corners = np.array(outlines)
    y, z = corners[0].T
    if y @ np.roll(z, -1) < z @ np.roll(y, -1):  # all outlines go round from y to z
        corners = corners[:, ::-1]
    body.beams.append({"part": part, "first": first, "count": len(x), "outlines": corners})


def _layer(beam: Beam, patch: Patch, x: float, side: int) -> Array:
    """Corners of a patch's layer on one side of the beam (m), (4, 2)."""
    face = beam.section.at(x)._face(patch.face[-1])
    low = patch.offset if patch.offset is not None else face.distance if face is not None else 0.0
    half, high = max(abs(patch.share(x)), 1e-3) * patch.width / 2, low + patch.thickness
    corners = np.array([(low, -half), (high, -half), (high, half), (low, half)]) * (side, 1)
    return corners if patch.face[-1] == "y" else corners[:, ::-1]


def _looks(body: Body, link: Link, places: dict[str, tuple[int, Array]], hub: slice, tip: slice) -> None:
    """Adds the looks of a link; they replace the symbols and boxes of its joint, hub and tip, if they can be drawn."""
    shown = set()
    for look in link.looks:
        (node, origin), (at, axes) = places[look.on], (look.at or Placement())._core
        centre = origin + at
        if look.shape == "mesh":
            found = meshes_of(look, node, centre, axes)
            body.meshes += found
            shown |= {look.on} if found else set()
            continue
        shown.add(look.on)
        if look.shape == "cylinder":
            radius, long = look.size
            body.solid("look", node, "cylinder", centre, axes[:, [2, 0, 1]], (long, radius))
        else:
            body.solid("look", node, look.shape, centre, axes, look.size)
        body.solids[-1]["colour"] = look.colour or LOOK_COLOUR
    for on, solids in (("hub", hub), ("tip", tip)):
        if on in shown or (link.beam is None and shown & {"hub", "tip"}):  # hub and tip are one rigid body then
            for solid in body.solids[solids]:
                solid["under"] = True


def _lengthen(body: Body, joint: Joint, node: int, axis: dict[str, Any], radius: float) -> None:
    """Lengthens the axis of a joint with one freedom out of the meshes that it moves."""
    ((_, _, direction),) = joint._freedoms()
    place, turn = (joint.outboard or Placement())._core
    d = turn.T @ (np.array(direction) / np.linalg.norm(direction))
    ends = [float((mesh.vertices @ d).max()) for mesh in body.meshes if mesh.node == node]
    axis["length"] = max([axis["length"], *(end + place @ turn @ d + 3 * radius for end in ends)])


def _contact(body: Body, contact: Contact, point: tuple[int, Array], on: tuple[int, Array]) -> None:
    """The sphere of a contact, or a small one at its point, and its surface; of a plane a square around its point."""
    (node, at), surface = on, contact.against
    axes, size = surface._core
    if isinstance(surface, Plane):
        thick = _THIN * body.size
        body.solid("surface", node, "box", at - 0.5 * thick * axes[:, 2], axes, (body.size, body.size, thick))
    elif isinstance(surface, Sphere):
        body.solid("surface", node, "ball", at, axes, (surface.radius,))
    else:
        body.solid("surface", node, "box", at, axes, size.tolist())
    body.solid("toucher", point[0], "ball", point[1], np.eye(3), (max(contact.radius, 0.01 * body.size),))


def make_body(arm: Chain, slices: Sequence[int], loads: Sequence[Load] = ()) -> Body:
    """The body of an arm; `slices` is the number of slices of each link's beam."""
    body = Body(length(arm))
    ends: dict[int, tuple[int, Array]] = {-1: (0, np.zeros(3))}  # of each link; -1: the world
    origins: list[int] = []
    for k, link in enumerate(arm.links):
        node, zero = body.node(k), np.zeros(3)
        origins.append(node)
        hub_end = np.array(link.hub.end) if link.hub else zero
        first = len(body.places)
        reach = 0.0
        if link.beam:
            _beam(body, k, link.beam, slices[k])
            reach = float(np.linalg.norm(outline(link.beam.section.at(0.0)), axis=1).max())
        radius = float(np.clip(1.1 * reach, 0.012 * body.size, 0.03 * body.size))
        axes, solids = len(body.axes), len(body.solids)
        parent, x = arm.seats[k]
        base = ends[parent] if x is None else (body.node(parent, x), zero)
        _joint(body, arm.joint_names[k], link.joint, base, (node, zero), radius)
        body.rod(node, zero, hub_end, radius / 2)
        if link.hub:
            _mass(body, "hub", node, zero, link.hub)
            hubs = [] if link.looks else [s for s in body.solids if s["node"] == node and s["part"] == "hub"]
            far = max((float(np.linalg.norm(s["at"]) + np.linalg.norm(s["size"]) / 2) for s in hubs), default=0.0)
            for axis in body.axes[axes:]:
                axis["length"] = max(axis["length"], far + 3 * radius)
        tip = len(body.solids)
        last, at = (first + slices[k] - 1, zero) if link.beam else (node, hub_end)
        tip_end = at + np.array(link.tip.end) if link.tip else at
        body.rod(last, at, tip_end, radius / 2)
        if link.tip:
            _mass(body, "tip", last, at, link.tip)
        places = {"hub": (node, zero), "tip": (last, at), "base": base}
        _looks(body, link, places, slice(solids, tip), slice(tip, len(body.solids)))
        if len(body.axes) == axes + 1:
            _lengthen(body, link.joint, node, body.axes[axes], radius)
        ends[k] = (last, tip_end)
    body.tips = [ends[k] for k in arm.ends]

    def placed(point: Any) -> tuple[int, Array]:
        n, on, along_beam, offset = point
        node, at = ends[n]
        if on != "end":
            node, at = body.node(n, along_beam) if on == "slice" else origins[n], np.zeros(3)
        return node, at + offset

    for strut, points in zip(arm.struts, arm._fastened, strict=True):
        way = [placed(point) for point in points]
        part = "tendon" if isinstance(strut, Tendon) else "strut"
        body.bars += [{"ends": list(pair), "part": part} for pair in pairwise(way)]
    for contact, sides in zip(arm.contacts, arm._touching, strict=True):
        _contact(body, contact, *map(placed, sides))
    for k, loop in enumerate(arm.loops):
        a, b = (placed(arm._fasten_point("", point)) for point in (loop.a, loop.b))  # type: ignore[arg-type]
        _joint(body, arm.loop_names[k], loop.joint, a, b, 0.014 * body.size)
    for load in loads:
        n = arm._link(load.link)
        x = load.x if load.along is None else sum(load.along) / 2
        body.loads.append(body.node(n, np.inf if x is None else x))
    return body
