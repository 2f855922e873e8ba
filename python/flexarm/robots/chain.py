"""From a robot's tree to the links of an arm."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from .._check import Array, array, choice, instance, known_keys, number
from ..model.parts.beam import Beam, RigidBody, Vector
from ..model.parts.joints import UNIT, Fixed, Joint, Placement, Prismatic, Revolute
from ..model.parts.link import Link
from ..model.parts.look import Look
from .tree import MOVING, Mass, Pose, Tree, TreeJoint, merged

_JOINTS = {"revolute": Revolute, "prismatic": Prismatic}
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
        end: the other end, likewise; None: the origin of the next joint, or of the tip. For a last link without a tip,
            the arm's end is the beam's.
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
class _Group:
    """A future link: its joint, the bodies rigid with it, and the next joint, all in the frame of its first body."""

    joint: TreeJoint
    bodies: list[tuple[str, Mass]]
    places: dict[str, Pose]
    looks: list[tuple[str, Pose, Look]]  #: of the bodies
    next: TreeJoint | None
    end: Pose  #: of the next joint, or of the tip
    tip: str | None  #: the name of the tip, if it is another body


@dataclass
class Conversion:
    """Links, and notes for the user."""

    links: list[Link] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def chain(
    tree: Tree, tip: str | None, flexible: Mapping[str, Any] | None, stops: Any, springs: Mapping[str, Any]
) -> Conversion:
    """The links of an arm that ends with `tip`; see from_urdf. `springs`: values that replace the file's, by the names
    of fa.Joint's arguments."""
    path = tree.path(tree.default_tip() if tip is None else tip)
    moving = [j for j in path if j.moves]
    if not moving:
        raise ValueError(f"tip = {tip!r}: no joint on the way to it moves")
    for joint in moving:
        if joint.kind not in MOVING:
            raise ValueError(f"joint '{joint.name}': type '{joint.kind}' is not supported; choose a tip ahead of it")
    _set_springs(moving, springs)
    out = Conversion()
    groups = [_group(tree, path, k) for k, j in enumerate(path) if j.moves]
    _note_omissions(tree, path, out)
    wanted = _read_flexible(flexible, groups)
    base = tree.path(moving[0].parent)
    inboard = moving[0].origin
    for joint in reversed(base):
        inboard = joint.rest_pose @ inboard
    limited = [j.name for j in moving if j.lower is not None or j.upper is not None]
    if limited and stops is None:
        out.notes.append(f"limits of position (`stops` makes soft stops of them): {_first_few(limited)}")
    for group in groups:
        link, inboard = _link(group, inboard, wanted.get(group.joint.child), stops, out)
        out.links.append(link)
    first, standing = groups[0].joint, out.links[0]
    looks = [_placed(pose @ at, look, "base") for name, pose in tree.beneath(tree.root, first)
             for at, look in tree.looks.get(name, [])]  # fmt: skip
    if looks:
        out.links[0] = replace(standing, looks=[*looks, *standing.looks])
    last = groups[-1]
    if last.tip is not None:
        out.links.append(Link(Fixed(inboard=_placement(inboard)), name=_named(last.tip, out)))
    return out


def _set_springs(moving: Sequence[TreeJoint], springs: Mapping[str, Any]) -> None:
    """Replaces the file's values: one for all joints, or by the name of a joint or of the link that it moves."""
    by_name = {j.child: j for j in moving} | {j.name: j for j in moving}
    for argument, values in springs.items():
        if values is None:
            continue
        one_for_all = not isinstance(values, Mapping)
        each = {j.name: number(argument, values) for j in moving} if one_for_all else values
        known_keys(argument, each, by_name)
        used: dict[str, str] = {}
        for key, value in each.items():
            joint = by_name[key]
            if joint.name in used:
                raise ValueError(f"{argument}: '{key}' and '{used[joint.name]}' are one joint")
            used[joint.name] = key
            joint.springs[argument] = number(f"{argument}['{key}']", value)


def _group(tree: Tree, path: Sequence[TreeJoint], k: int) -> _Group:
    joint = path[k]
    at, after = Pose(), None
    for i in range(k + 1, len(path)):
        after = path[i]
        if after.moves:
            break
        at = at @ after.rest_pose
    following = after if after is not None and after.moves else None
    if following is not None:
        at = at @ following.origin
    bodies = tree.beneath(joint.child, following)
    masses = [(name, tree.bodies[name].placed(pose)) for name, pose in bodies]
    fixed = {joint.child: Pose()}
    for name, pose in bodies[1:]:  # parents come first
        if tree.above[name].parent in fixed and not tree.above[name].moves:
            fixed[name] = pose
    tip = path[-1].child if following is None and path[-1] is not joint else None
    looks = [(name, pose @ there, look) for name, pose in bodies for there, look in tree.looks.get(name, [])]
    return _Group(joint, masses, fixed, looks, following, at, tip)


def _note_omissions(tree: Tree, path: Sequence[TreeJoint], out: Conversion) -> None:
    """Notes branches off the chain, bodies fixed to the base, and the reader's omissions."""
    first = next(j for j in path if j.moves)
    base = tree.beneath(tree.root, first)
    still = sum(tree.bodies[name].mass for name, _ in base)
    if still:
        out.notes.append(f"{still:.6g} kg fixed to the base: it does not move")
    on_base = {name for name, _ in base}
    on_path = {id(j) for j in path}
    away = [j for j in tree.joints if j.moves and id(j) not in on_path]
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


def _read_flexible(flexible: Mapping[str, Any] | None, groups: Sequence[_Group]) -> dict[str, Flexible]:
    if flexible is None:
        return {}
    known = {g.joint.child: g for g in groups}
    for name in set(flexible) - set(known) if isinstance(flexible, Mapping) else ():
        for g in groups:
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
    if not joint.axis.any():
        raise ValueError(f"joint '{joint.name}': axis = {joint.axis.tolist()}: must have a length")
    bare = joint.axis / np.abs(joint.axis).max()  # avoids overflow and underflow of the squares
    axis = tuple((bare / np.linalg.norm(bare)).tolist())
    word = next((w for w, unit in UNIT.items() if unit == axis), axis)
    places = {"inboard": _placement(inboard), "outboard": _placement(outboard)}
    values |= {k: v for k, v in places.items() if v is not None}
    try:
        return _JOINTS[joint.kind](word, **values, name=_named(joint.name, out))
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
    """A link, and the frame of the next joint on its end."""
    name, outboard = g.joint.child, g.joint.outboard
    end = g.end
    if wanted is None:
        hub = _body(name, merged(m for _, m in g.bodies), np.eye(3), np.zeros(3), end.position)
        looks = [_placed(pose, look, "hub") for _, pose, look in g.looks]
        link = Link(_joint(g.joint, inboard, outboard, stops, out), hub, name=_named(name, out), looks=looks)
        return link, Pose(rotation=end.rotation)
    where = f"flexible['{name}']"
    a = _point(f"{where}.start", wanted.start, g, np.zeros(3))
    b = _point(f"{where}.end", wanted.end, g, None if g.next is None and g.tip is None else end.position)
    if g.next is None and g.tip is None:  # the arm ends with the beam
        end = Pose(b)
    axes, length = _beam_axes(where, wanted, a, b)
    if abs(wanted.beam.length - length) > 1e-6 * length:
        raise ValueError(
            f"{where}: beam.length = {wanted.beam.length}: must be {length:.9g} m, the distance from its start "
            f"{np.round(a, 9).tolist()} to its end {np.round(b, 9).tolist()}"
        )
    own, x = g.bodies[0][1], axes[:, 0]
    kept = [m for n, m in g.bodies if n != name or wanted.mass == "add"]
    if wanted.mass == "replace" and own.mass:
        out.notes.append(f"the {own.mass:.6g} kg of '{name}': its beam of {wanted.beam.mass:.6g} kg replaces them")
    near = [m for m in kept if (m.com - a) @ x <= length / 2]
    far = [m for m in kept if (m.com - a) @ x > length / 2]
    hub = _body(name, merged(near), axes, np.zeros(3), a)
    tip = _body(name, merged(far), axes, b, end.position - b)
    if not np.array_equal(axes, np.eye(3)):
        out.notes.append(f"the axes of '{name}': those of its beam are the link's here")
    turned = Pose(outboard.position, outboard.rotation @ axes)
    joint = _joint(g.joint, inboard, turned, stops, out)
    looks = _looks_of_beam(g, wanted, axes, a, b, out)
    return Link(joint, hub, wanted.beam, tip, _named(name, out), looks), Pose(rotation=axes.T @ end.rotation)


def _looks_of_beam(g: _Group, wanted: Flexible, axes: Array, a: Array, b: Array, out: Conversion) -> list[Look]:
    """The looks of a link that is a beam: those of the bodies fixed to it, each on the nearer end, and its own, if its
    own body stays."""
    looks = []
    for name, pose, look in g.looks:
        if name == g.joint.child and wanted.mass == "replace":
            continue
        far = (pose.position - a) @ axes[:, 0] > wanted.beam.length / 2
        origin = b if far else np.zeros(3)
        seen = Pose(axes.T @ (pose.position - origin), axes.T @ pose.rotation)
        looks.append(_placed(seen, look, "tip" if far else "hub"))
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
