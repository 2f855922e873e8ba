"""From a robot's file, as a tree of bodies, to the links of an arm."""

from collections import Counter
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from .._check import Array, array, choice, instance, known_keys, number
from ..model.parts.beam import Beam, RigidBody, Vector
from ..model.parts.joints import UNIT, Fixed, Free, Joint, Placement, Planar, Prismatic, Revolute, Spherical
from ..model.parts.link import Link
from ..model.parts.look import Look
from ..model.parts.loop import Loop
from ..model.parts.strut import Point
from .tree import Mass, Pose, Tree, TreeJoint, merged, unit_axis

_WITH_AXIS = {"revolute": Revolute, "prismatic": Prismatic}
_WITHOUT = {"planar": Planar, "spherical": Spherical, "free": Free}
_MASS = ("replace", "add")


@dataclass(frozen=True)
class Flexible:
    """A link of a robot's file as a beam, of which a part may stay rigid.

    The beam is straight, from `start` to `end`, in any direction. The link's axes become the beam's: x along it, z as
    near to `up` as possible. Joints, fixed bodies and the tip keep their places and directions.

    Args:
        beam: its length must be the distance from `start` to `end`.
        start: the clamped end: a point in the link's axes (m), or the name of a link that is fixed to it; None: the
            link's own origin, where its joint sits.
        end: the other end, likewise; None: the origin of the next joint, or of the tip; where several sit on the link,
            of the one at the beam's length. For a last link without a tip, the arm's end is the beam's.
        up: a direction in the link's axes; None: its z, or, for a beam along z, its x.
        mass: "replace": the beam's mass replaces the link's own. "add": the link's own body stays, as a rigid one.
            Bodies that are fixed to the link stay in both. A body that stays moves with the beam's clamp or its end,
            the one that is nearer to its centre of mass.
    """

    beam: Beam
    start: Vector | str | None = None
    end: Vector | str | None = None
    up: Vector | None = None
    mass: str = "replace"

    def __post_init__(self) -> None:
        instance("beam", self.beam, Beam)
        choice("mass", self.mass, _MASS)


@dataclass
class _Seat:
    """An item on a link: the next link's joint, or a tip that is fixed to it."""

    name: str  #: of the next link, or of the tip
    joint: TreeJoint | None  #: None: of a tip
    on: str  #: the body that carries the joint, or the tip itself
    at: Pose


@dataclass
class _Group:
    """A future link: its joint, the bodies rigid with it, and the items on it, all in the frame of its first body. The
    base is one with a fixed joint."""

    joint: TreeJoint
    bodies: list[tuple[str, Mass]]
    places: dict[str, Pose]  #: of the bodies that no held joint carries
    looks: list[tuple[str, Pose, Look]]  #: of the bodies
    seats: list[_Seat] = field(default_factory=list)


@dataclass
class Conversion:
    """Links, loops that close them, and notes for the user."""

    links: list[Link] = field(default_factory=list)
    loops: list[Loop] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def arm_links(
    tree: Tree, tip: Any, flexible: Mapping[str, Any] | None, stops: Any, springs: Mapping[str, Any]
) -> Conversion:
    """The links of an arm that ends with `tip`; see from_urdf. `springs`: values that replace the file's, by the names
    of fa.Joint's arguments."""
    tips = [tip] if isinstance(tip, str) else tip
    if tips is not None and not (isinstance(tips, Sequence) and tips and all(isinstance(x, str) for x in tips)):
        raise ValueError(f"tip = {tip!r}: must be the name of a link, or a list of names")
    path = tree.ways(tips)
    moving = [j for j in path if j.moves]
    if not moving:
        no = "the file has no joint that moves" if tips is None else f"tip = {tip!r}: no joint on the way to it moves"
        raise ValueError(no)
    groups = _groups(tree, path, tips or ())
    _check_kinds(tree, moving, groups)
    _set_springs(moving, springs)
    out, base = Conversion(), groups[tree.root]
    _note_omissions(tree, path, base, out)
    wanted = _read_flexible(flexible, groups)
    limited = [j.name for j in moving if j.lower is not None or j.upper is not None]
    if limited and stops is None:
        out.notes.append(f"limits of position (`stops` makes soft stops of them): {_first_few(limited)}")
    seats = {seat.name: (owner, seat) for owner, group in groups.items() for seat in group.seats}
    ends, numbers, parents = {tree.root: Pose()}, {tree.root: -1}, list[int]()
    for name in (j.child for j in path if j.child in seats):
        owner, seat = seats[name]
        inboard = ends[owner].seen(seat.at)
        if seat.joint is not None:
            link, ends[name] = _link(groups[name], inboard, wanted.get(name), stops, out)
        else:
            link = Link(Fixed(inboard=_placement(inboard)), name=_named(name, out))
        numbers[name] = len(out.links)
        parents.append(numbers[owner])
        out.links.append(link)
    out.links = seated(out.links, parents)
    out.loops = _loops(tree, groups, numbers, ends, out)
    looks = [_placed(pose, look, "base") for _, pose, look in base.looks]
    if looks:
        out.links[0] = replace(out.links[0], looks=[*looks, *out.links[0].looks])
    return out


def _loops(
    tree: Tree, groups: Mapping[str, _Group], numbers: Mapping[str, int], ends: Mapping[str, Pose], out: Conversion
) -> list[Loop]:
    """The loops whose bodies both are of the arm."""
    carriers = {body: name for name, group in groups.items() for body in group.places}
    made = []
    for loop in tree.loops:
        if off := [body for body, _ in (loop.a, loop.b) if body not in carriers]:
            out.notes.append(f"the constraint '{loop.name}': '{off[0]}' is held, or not of the arm")
            continue
        places = []
        for body, pose in (loop.a, loop.b):
            name = carriers[body]
            seen, n = groups[name].places[body] @ pose, numbers[name]
            places.append(_place(out.links[n], n, ends[name], seen) if n >= 0 else (Point("world"), seen))
        (a, inboard), (b, there) = places
        joint = {"fixed": Fixed, "spherical": Spherical}[loop.kind]
        held = joint(inboard=_placement(inboard), outboard=_placement(there.inverse))
        made.append(Loop(a, b, held, name=_named(loop.name, out)))
    return made


def _place(link: Link, n: int, end: Pose, seen: Pose) -> tuple[Point, Pose]:
    """The place of a link that moves with a frame which is seen from the link's first body, and the frame seen from
    there: the origin, or of a beam the slice beside it."""
    own = Pose(rotation=end.rotation).seen(seen)
    if link.beam is None:
        return Point(n, "origin"), own
    start = np.array(link.hub.end if link.hub else (0.0, 0.0, 0.0))
    x = float(own.position[0] - start[0])
    if x <= 0:
        return Point(n, "origin"), own
    if x >= link.beam.length * (1 - 1e-6):
        return Point(n), end.seen(seen)
    return Point(n, x), Pose(start + np.array([x, 0.0, 0.0])).seen(own)


def _groups(tree: Tree, path: Sequence[TreeJoint], tips: Sequence[str]) -> dict[str, _Group]:
    """The base and the future links, by the names of their first bodies."""
    joints = [TreeJoint("", "fixed", "", tree.root), *(j for j in path if j.moves)]
    kept = {j.child for j in joints}
    out = {j.child: _group(tree, j, kept) for j in joints}
    carriers = {name: group for group in out.values() for name in group.places}
    for j in path:
        group = carriers[j.parent]
        if j.moves:
            group.seats.append(_Seat(j.child, j, j.parent, group.places[j.parent] @ j.origin))
        elif j.child in tips and group.joint.moves:
            group.seats.append(_Seat(j.child, None, j.child, group.places[j.child]))
    return out


def _group(tree: Tree, joint: TreeJoint, kept: Container[str]) -> _Group:
    bodies = tree.beneath(joint.child, kept)
    masses = [(name, tree.bodies[name].placed(pose)) for name, pose in bodies]
    places = {joint.child: Pose()}
    for name, pose in bodies[1:]:  # parents come first
        if tree.above[name].parent in places and not tree.above[name].moves:
            places[name] = pose
    looks = [(name, pose @ there, look) for name, pose in bodies for there, look in tree.looks.get(name, [])]
    return _Group(joint, masses, places, looks)


def _check_kinds(tree: Tree, moving: Sequence[TreeJoint], groups: Mapping[str, _Group]) -> None:
    """Refuses joints that arms from files do not have, and tells the tips that stay ahead of them."""
    bad = [j for j in moving if j.kind not in _WITH_AXIS | _WITHOUT]
    if bad:
        near = {name for name, _ in tree.beneath(tree.root, {j.child for j in bad})}
        ends = [n for n, g in groups.items() if g.joint.moves and n in near and not near & {s.name for s in g.seats}]
        hint = f"; choose tips ahead of it: tip = {ends}" if ends else ""
        raise ValueError(f"joint '{bad[0].name}': type '{bad[0].kind}' is not supported{hint}")


def seated(links: Sequence[Link], parents: Sequence[int]) -> list[Link]:
    """The links on the ends of those with these numbers (-1: the world), by name where one link or joint has it."""
    words = Counter(word for link in links for word in {link.name, link.joint.name})
    out = []
    for k, (link, n) in enumerate(zip(links, parents, strict=True)):
        name = links[n].name if n >= 0 else None
        known = name if name not in (None, "world") and words[name] == 1 else n
        parent = None if n == k - 1 else "world" if n < 0 else known
        out.append(link if parent == link.parent else replace(link, parent=parent))
    return out


def _set_springs(moving: Sequence[TreeJoint], springs: Mapping[str, Any]) -> None:
    """Replaces the file's values: one for all joints that have a drive, or by the name of a joint or of the link that
    it moves. Free joints have no drive, and balls no dry friction."""
    by_name = {j.child: j for j in moving} | {j.name: j for j in moving}
    for argument, values in springs.items():
        if values is None:
            continue
        each = values
        if not isinstance(values, Mapping):
            without = ("free", "spherical") if argument == "coulomb" else ("free",)
            each = dict.fromkeys((j.name for j in moving if j.kind not in without), number(argument, values))
        known_keys(argument, each, by_name)
        used: dict[str, str] = {}
        for key, value in each.items():
            joint = by_name[key]
            if joint.name in used:
                raise ValueError(f"{argument}: '{key}' and '{used[joint.name]}' are one joint")
            used[joint.name] = key
            joint.springs[argument] = number(f"{argument}['{key}']", value)


def _note_omissions(tree: Tree, path: Sequence[TreeJoint], base: _Group, out: Conversion) -> None:
    """Notes branches that are held, bodies fixed to the base, and the reader's omissions."""
    still = sum(mass.mass for _, mass in base.bodies)
    if still:
        out.notes.append(f"{still:.6g} kg fixed to the base: it does not move")
    on_base, on_path = {name for name, _ in base.bodies}, {j.child for j in path}
    away = [j for j in tree.joints if j.moves and j.child not in on_path]
    off, held = [j.name for j in away], {j.name for j in away if j.child not in on_base}
    if held:
        how = "they are held at zero, their bodies move with the link"
        out.notes.append(f"motion of the joints of branches: {how}: {_first_few(n for n in off if n in held)}")
    if len(off) > len(held):
        out.notes.append(f"branches of the base: {_first_few(n for n in off if n not in held)}")
    whole: dict[str, list[str]] = {}
    elsewhere = {j.name for j in tree.joints} - {j.name for j in path}
    for item, owner in tree.left_out:
        if owner not in elsewhere:
            whole.setdefault(item, []).append(owner)
    out.notes += [f"{item}: {_first_few(owners)}" if any(owners) else item for item, owners in whole.items()]


def _first_few(names: Iterable[str]) -> str:
    names = list(dict.fromkeys(names))
    return ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")


def _read_flexible(flexible: Mapping[str, Any] | None, groups: Mapping[str, _Group]) -> dict[str, Flexible]:
    if flexible is None:
        return {}
    known = {name: g for name, g in groups.items() if g.joint.moves}
    for name in set(flexible) - set(known) if isinstance(flexible, Mapping) else ():
        for g in known.values():
            if name in g.places:
                raise ValueError(f"flexible: '{name}' is fixed to '{g.joint.child}'; name that, which can be a beam")
    known_keys("flexible", flexible, known)
    out = {}
    for name, value in flexible.items():
        if not isinstance(value, (Beam, Flexible)):
            raise ValueError(f"flexible['{name}'] = {value!r}: must be a Beam, or a Flexible that tells where it runs")
        out[name] = Flexible(value) if isinstance(value, Beam) else value
    return out


def _joint(joint: TreeJoint, inboard: Pose, outboard: Pose, stops: Any, out: Conversion) -> Joint:
    values: dict[str, Any] = {k: v for k, v in joint.springs.items() if v}
    limits = {k: v for k, v in (("lower", joint.lower), ("upper", joint.upper)) if v is not None}
    if limits and stops is not None:
        numbers = (stops, 0.0) if np.ndim(stops) == 0 else tuple(stops)
        if len(numbers) != 2:
            raise ValueError(f"stops = {stops!r}: must be a stiffness, or (stiffness, damping)")
        values |= limits | dict(zip(("limit_stiffness", "limit_damping"), numbers, strict=True))
    places = {"inboard": _placement(inboard), "outboard": _placement(outboard)}
    values |= {k: v for k, v in places.items() if v is not None} | {"name": _named(joint.name, out)}
    if joint.kind in _WITH_AXIS:
        axis = tuple(unit_axis(joint.name, joint.axis).tolist())
        values["axis"] = next((w for w, unit in UNIT.items() if unit == axis), axis)
    try:
        return (_WITH_AXIS | _WITHOUT)[joint.kind](**values)
    except ValueError as e:
        raise ValueError(f"joint '{joint.name}': {e}") from None


def _named(name: str, out: Conversion) -> str:
    """A file's name, changed to a valid name of a link."""
    fit = name.strip().replace(".", "_") or "unnamed"
    fit = f"_{fit}" if fit.removeprefix("link ").lstrip("+-").isdigit() else fit
    if fit != name:
        out.notes.append(f"the name '{name}': it is '{fit}' here")
    return fit


def _placement(pose: Pose) -> Placement | None:
    from scipy.spatial.transform import Rotation  # slow to import

    turned = not np.array_equal(pose.rotation, np.eye(3))
    if not turned and not pose.position.any():
        return None
    rotation = Rotation.from_matrix(pose.rotation).as_rotvec().tolist() if turned else (0.0, 0.0, 0.0)
    return Placement(pose.position.tolist(), rotation)


def _body(where: str, mass: Mass, axes: Array, origin: Array, end: Array) -> RigidBody | None:
    """A rigid body in rotated axes about another origin; None without mass and inertia."""
    if not mass.mass and not mass.inertia.any() and not end.any():
        return None
    com = axes.T @ (mass.com - origin) if mass.mass else np.zeros(3)
    inertia = axes.T @ mass.inertia @ axes
    six = [inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    try:
        return RigidBody(mass.mass, com.tolist(), six, (axes.T @ end).tolist())
    except ValueError as e:
        raise ValueError(f"link '{where}': {e}") from None


def _link(g: _Group, inboard: Pose, wanted: Flexible | None, stops: Any, out: Conversion) -> tuple[Link, Pose]:
    """A link, and its end: the place of the first that sits on it, in the axes of the link that is made."""
    name, outboard = g.joint.child, g.joint.outboard
    end = g.seats[0].at.position if g.seats else np.zeros(3)
    if wanted is None:
        hub = _body(name, merged(m for _, m in g.bodies), np.eye(3), np.zeros(3), end)
        looks = [_placed(pose, look, "hub") for _, pose, look in g.looks]
        link = Link(_joint(g.joint, inboard, outboard, stops, out), hub, name=_named(name, out), looks=looks)
        return link, Pose(end)
    where = f"flexible['{name}']"
    a = _point(f"{where}.start", wanted.start, g, np.zeros(3))
    nexts = sorted((s.at.position for s in g.seats), key=lambda p: abs(np.linalg.norm(p - a) - wanted.beam.length))
    b = _point(f"{where}.end", wanted.end, g, nexts[0] if nexts else None)
    end = end if g.seats else b  # the arm ends with the beam
    axes, length = _beam_axes(where, wanted, a, b)
    if abs(wanted.beam.length - length) > 1e-6 * length:
        raise ValueError(
            f"{where}: beam.length = {wanted.beam.length}: must be {length:.9g} m, the distance from its start "
            f"{np.round(a, 9).tolist()} to its end {np.round(b, 9).tolist()}"
        )
    own, x = g.bodies[0][1], axes[:, 0]
    kept = [(n, m) for n, m in g.bodies if n != name or wanted.mass == "add"]
    if wanted.mass == "replace" and own.mass:
        out.notes.append(f"the {own.mass:.6g} kg of '{name}': its beam of {wanted.beam.mass:.6g} kg replaces them")
    far = {n for n, m in kept if (m.com - a) @ x > length / 2}
    for seat in g.seats:
        along = float((seat.at.position - a) @ x)
        if along < length * (1 - 1e-6) and (seat.on == name or seat.on not in far):
            which = f"joint '{seat.joint.name}'" if seat.joint else f"tip '{seat.name}'"
            raise ValueError(
                f"{where}: {which} sits {along:.6g} m along the beam of {length:.6g} m, not on its end; give a beam "
                "that ends there, or leave the link rigid"
            )
    hub = _body(name, merged(m for n, m in kept if n not in far), axes, np.zeros(3), a)
    tip = _body(name, merged(m for n, m in kept if n in far), axes, b, end - b)
    if not np.array_equal(axes, np.eye(3)):
        out.notes.append(f"the axes of '{name}': those of its beam are the link's here")
    turned = Pose(outboard.position, outboard.rotation @ axes)
    joint = _joint(g.joint, inboard, turned, stops, out)
    looks = _looks_of_beam(g, wanted, axes, a, b, out)
    return Link(joint, hub, wanted.beam, tip, _named(name, out), looks=looks), Pose(end, axes)


def _looks_of_beam(g: _Group, wanted: Flexible, axes: Array, a: Array, b: Array, out: Conversion) -> list[Look]:
    """The looks of a link that is a beam: those of the bodies fixed to it, each on the nearer end, and its own, if its
    own body stays."""
    looks = []
    for name, pose, look in g.looks:
        if name == g.joint.child and wanted.mass == "replace":
            continue
        far = (pose.position - a) @ axes[:, 0] > wanted.beam.length / 2
        origin = b if far else np.zeros(3)
        looks.append(_placed(Pose(origin, axes).seen(pose), look, "tip" if far else "hub"))
    if len(looks) < len(g.looks):
        out.notes.append(f"the look of '{g.joint.child}': its beam is drawn")
    return looks


def _placed(pose: Pose, look: Look, on: str) -> Look:
    return replace(look, at=_placement(pose), on=on)


def _point(where: str, value: Any, g: _Group, default: Array | None) -> Array:
    if isinstance(value, str):
        return g.places[choice(where, value, g.places)].position
    if value is not None:
        return array(where, value, (3,))
    if default is None:
        raise ValueError(f"{where}: must be given, for no joint follows; or give a tip")
    return default


def _beam_axes(where: str, wanted: Flexible, a: Array, b: Array) -> tuple[Array, float]:
    """Columns x, y, z of the beam in the link's axes, and its length."""
    length = float(np.linalg.norm(b - a))
    if not length > 0:
        raise ValueError(f"{where}: its beam's start and end are one point, {a.tolist()}; give a start or an end")
    x = (b - a) / length
    x = np.where(np.abs(x) < 1e-12, 0.0, x)
    x /= np.linalg.norm(x)
    if wanted.up is not None:
        up = array(f"{where}.up", wanted.up, (3,))
    else:
        up = np.array([0.0, 0.0, 1.0]) if abs(x[2]) < 0.999 else np.array([1.0, 0.0, 0.0])
    z = up - (up @ x) * x
    size = float(np.linalg.norm(z))
    if not size > 1e-6 * float(np.linalg.norm(up)):
        raise ValueError(f"{where}.up = {up.tolist()}: must not run along the beam")
    z /= size
    return np.column_stack([x, np.cross(z, x), z]), length
