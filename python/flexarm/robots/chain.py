"""From a robot's tree to the links of an arm."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from .._check import Array, array, choice, known_keys, number
from ..parts.beam import Beam, RigidBody, Vector
from ..parts.joints import UNIT, Fixed, Joint, Placement, Prismatic, Revolute
from ..parts.link import Link
from ..parts.look import Look
from .tree import MOVING, Mass, Pose, Tree, TreeJoint, merged

_JOINTS = {"revolute": Revolute, "prismatic": Prismatic}
_MASS = ("replace", "add")


@dataclass(frozen=True)
class Flexible:
    """How a link of a robot's file becomes a beam.

    The beam runs straight from `start` to `end`, in whatever direction that is. The link's axes are then the beam's: x
    along it, z as near to `up` as it can be. Joints, fixed bodies and the tip keep their places and directions.

    Args:
        beam: its length must be the distance from `start` to `end`.
        start: where it is clamped: a point in the link's axes (m), or the name of a link that is fixed to it; None: the
            link's own origin, where its joint sits.
        end: where it ends, likewise; None: where the next joint sits, or the tip. Of a last link without a tip, the
            arm's end is the beam's.
        up: a direction in the link's axes; None: its z, or, where the beam runs along that, its x.
        mass: "replace": the beam's mass stands for the link's own. "add": the link's own body stays, as a rigid one.
            Bodies that are fixed to the link stay in both. What stays moves with the beam's clamp if its centre of mass
            is nearer to that, else with its end.
    """

    beam: Beam
    start: Vector | str | None = None
    end: Vector | str | None = None
    up: Vector | None = None
    mass: str = "replace"

    def __post_init__(self) -> None:
        if not isinstance(self.beam, Beam):
            raise ValueError(f"beam = {self.beam!r}: must be a Beam")
        choice("mass", self.mass, _MASS)


@dataclass
class _Group:
    """A link to be: its joint, what is rigid with it, and what comes next, all in the frame of its first body."""

    joint: TreeJoint
    bodies: list[tuple[str, Mass]]
    places: dict[str, Pose]
    looks: list[tuple[str, Pose, Look]]  #: of the bodies
    next: TreeJoint | None
    end: Pose  #: where the next joint, or the tip, sits
    tip: str | None  #: the name of the tip, where it is another body


@dataclass
class Made:
    """Links, and what is to be said of them."""

    links: list[Link] = field(default_factory=list)
    said: list[str] = field(default_factory=list)


def chain(
    tree: Tree, tip: str | None, flexible: Mapping[str, Any] | None, stops: Any, springs: Mapping[str, Any]
) -> Made:
    """The links of an arm that ends with `tip`; see from_urdf. `springs`: numbers in place of the file's, by the names
    of fa.Joint's arguments."""
    path = tree.path(tree.default_tip() if tip is None else tip)
    moving = [j for j in path if j.moves]
    if not moving:
        raise ValueError(f"tip = {tip!r}: no joint on the way to it moves")
    for joint in moving:
        if joint.kind not in MOVING:
            raise ValueError(f"joint '{joint.name}': type '{joint.kind}' is not supported; choose a tip ahead of it")
    _set_springs(moving, springs)
    made = Made()
    groups = [_group(tree, path, k) for k, j in enumerate(path) if j.moves]
    _say_left_out(tree, path, made)
    wanted = _read_flexible(flexible, groups)
    base = tree.path(moving[0].parent)
    inboard = moving[0].origin
    for joint in reversed(base):
        inboard = joint.rest_pose @ inboard
    limited = [j.name for j in moving if j.lower is not None or j.upper is not None]
    if limited and stops is None:
        made.said.append(f"limits of position (`stops` makes soft stops of them): {_few(limited)}")
    for group in groups:
        link, inboard = _link(group, inboard, wanted.get(group.joint.child), stops, made)
        made.links.append(link)
    first, standing = groups[0].joint, made.links[0]
    looks = [_placed(pose @ at, look, "base") for name, pose in tree.beneath(tree.root, first)
             for at, look in tree.looks.get(name, [])]  # fmt: skip
    if looks:
        made.links[0] = replace(standing, looks=[*looks, *standing.looks])
    last = groups[-1]
    if last.tip is not None:
        made.links.append(Link(Fixed(inboard=_placement(inboard)), name=_named(last.tip, made)))
    return made


def _set_springs(moving: Sequence[TreeJoint], springs: Mapping[str, Any]) -> None:
    """Puts a number in place of the file's: of all joints, or by the name of a joint or of the link that it moves."""
    by_name = {j.child: j for j in moving} | {j.name: j for j in moving}
    for what, given in springs.items():
        if given is None:
            continue
        one_for_all = not isinstance(given, Mapping)
        each = {j.name: number(what, given) for j in moving} if one_for_all else given
        known_keys(what, each, by_name)
        told: dict[str, str] = {}
        for key, value in each.items():
            joint = by_name[key]
            if joint.name in told:
                raise ValueError(f"{what}: '{key}' and '{told[joint.name]}' are one joint")
            told[joint.name] = key
            joint.springs[what] = number(f"{what}['{key}']", value)


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
    masses = [(name, tree.bodies[name].seen(pose)) for name, pose in bodies]
    fixed = {joint.child: Pose()}
    for name, pose in bodies[1:]:  # each after its parent
        if tree.above[name].parent in fixed and not tree.above[name].moves:
            fixed[name] = pose
    tip = path[-1].child if following is None and path[-1] is not joint else None
    looks = [(name, pose @ there, look) for name, pose in bodies for there, look in tree.looks.get(name, [])]
    return _Group(joint, masses, fixed, looks, following, at, tip)


def _say_left_out(tree: Tree, path: Sequence[TreeJoint], made: Made) -> None:
    """Branches off the chain, what stands still with the base, and what the reader has noted."""
    first = next(j for j in path if j.moves)
    base = tree.beneath(tree.root, first)
    still = sum(tree.bodies[name].mass for name, _ in base)
    if still:
        made.said.append(f"{still:.6g} kg fixed to the base: it does not move")
    on_base = {name for name, _ in base}
    on_path = {id(j) for j in path}
    away = [j for j in tree.joints if j.moves and id(j) not in on_path]
    off, held = [j.name for j in away], {j.name for j in away if j.child not in on_base}
    if held:
        how = "they are held at zero, their bodies move with the link"
        made.said.append(f"motion of the joints of branches: {how}: {_few(n for n in off if n in held)}")
    if len(off) > len(held):
        made.said.append(f"branches of the base: {_few(n for n in off if n not in held)}")
    whole: dict[str, list[str]] = {}
    elsewhere = {j.name for j in tree.joints} - {j.name for j in path}
    for what, whose in tree.left_out:
        if whose not in elsewhere:
            whole.setdefault(what, []).append(whose)
    made.said += [f"{what}: {_few(whose)}" if any(whose) else what for what, whose in whole.items()]


def _few(names: Iterable[str]) -> str:
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


def _joint(joint: TreeJoint, inboard: Pose, outboard: Pose, stops: Any, made: Made) -> Joint:
    values: dict[str, Any] = {k: v for k, v in joint.springs.items() if v}
    limits = {k: v for k, v in (("lower", joint.lower), ("upper", joint.upper)) if v is not None}
    if limits and stops is not None:
        numbers = (stops, 0.0) if np.ndim(stops) == 0 else tuple(stops)
        if len(numbers) != 2:
            raise ValueError(f"stops = {stops!r}: must be a stiffness, or (stiffness, damping)")
        values |= limits | dict(zip(("limit_stiffness", "limit_damping"), numbers, strict=True))
    if not joint.axis.any():
        raise ValueError(f"joint '{joint.name}': axis = {joint.axis.tolist()}: must have a length")
    bare = joint.axis / np.abs(joint.axis).max()  # first, for what is beyond 1e154 or below 1e-154
    axis = tuple((bare / np.linalg.norm(bare)).tolist())
    word = next((w for w, unit in UNIT.items() if unit == axis), axis)
    places = {"inboard": _placement(inboard), "outboard": _placement(outboard)}
    values |= {k: v for k, v in places.items() if v is not None}
    try:
        return _JOINTS[joint.kind](word, **values, name=_named(joint.name, made))
    except ValueError as e:
        raise ValueError(f"joint '{joint.name}': {e}") from None


def _named(name: str, made: Made) -> str:
    """A file's name as a link can have it."""
    fit = name.strip().replace(".", "_") or "unnamed"
    fit = f"_{fit}" if fit.removeprefix("link ").lstrip("+-").isdigit() else fit
    if fit != name:
        made.said.append(f"the name '{name}': it is '{fit}' here")
    return fit


def _placement(pose: Pose) -> Placement | None:
    from scipy.spatial.transform import Rotation  # slow to import

    turned = not np.array_equal(pose.rotation, np.eye(3))
    if not turned and not pose.position.any():
        return None
    rotation = Rotation.from_matrix(pose.rotation).as_rotvec().tolist() if turned else (0.0, 0.0, 0.0)
    return Placement(pose.position.tolist(), rotation)


def _body(where: str, mass: Mass, axes: Array, origin: Array, end: Array) -> RigidBody | None:
    """A rigid body in turned axes about another origin; None where there is nothing."""
    if not mass.mass and not mass.inertia.any() and not end.any():
        return None
    com = axes.T @ (mass.com - origin) if mass.mass else np.zeros(3)
    inertia = axes.T @ mass.inertia @ axes
    six = [inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    try:
        return RigidBody(mass.mass, com.tolist(), six, (axes.T @ end).tolist())
    except ValueError as e:
        raise ValueError(f"link '{where}': {e}") from None


def _link(g: _Group, inboard: Pose, wanted: Flexible | None, stops: Any, made: Made) -> tuple[Link, Pose]:
    """A link, and where the next joint sits on its end."""
    name, outboard = g.joint.child, g.joint.outboard
    end = g.end
    if wanted is None:
        hub = _body(name, merged(m for _, m in g.bodies), np.eye(3), np.zeros(3), end.position)
        looks = [_placed(pose, look, "hub") for _, pose, look in g.looks]
        link = Link(_joint(g.joint, inboard, outboard, stops, made), hub, name=_named(name, made), looks=looks)
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
        made.said.append(f"the {own.mass:.6g} kg of '{name}': its beam of {wanted.beam.mass:.6g} kg replaces them")
    near = [m for m in kept if (m.com - a) @ x <= length / 2]
    far = [m for m in kept if (m.com - a) @ x > length / 2]
    hub = _body(name, merged(near), axes, np.zeros(3), a)
    tip = _body(name, merged(far), axes, b, end.position - b)
    if not np.array_equal(axes, np.eye(3)):
        made.said.append(f"the axes of '{name}': those of its beam are the link's here")
    turned = Pose(outboard.position, outboard.rotation @ axes)
    joint = _joint(g.joint, inboard, turned, stops, made)
    looks = _looks_of_beam(g, wanted, axes, a, b, made)
    return Link(joint, hub, wanted.beam, tip, _named(name, made), looks), Pose(rotation=axes.T @ end.rotation)


def _looks_of_beam(g: _Group, wanted: Flexible, axes: Array, a: Array, b: Array, made: Made) -> list[Look]:
    """What is drawn of a link that is a beam: what is fixed to it, on the end that is nearer, and, where its own body
    stays, its own."""
    looks = []
    for name, pose, look in g.looks:
        if name == g.joint.child and wanted.mass == "replace":
            continue
        far = (pose.position - a) @ axes[:, 0] > wanted.beam.length / 2
        origin = b if far else np.zeros(3)
        seen = Pose(axes.T @ (pose.position - origin), axes.T @ pose.rotation)
        looks.append(_placed(seen, look, "tip" if far else "hub"))
    if len(looks) < len(g.looks):
        made.said.append(f"what '{g.joint.child}' looks like: its beam is drawn")
    return looks


def _placed(pose: Pose, look: Look, on: str) -> Look:
    return replace(look, at=_placement(pose), on=on)


def _point(where: str, given: Any, g: _Group, default: Array | None) -> Array:
    if isinstance(given, str):
        return g.places[choice(where, given, g.places)].position
    if given is not None:
        return array(where, given, (3,))
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
