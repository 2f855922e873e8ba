"""URDF files to trees, with the looks of their links."""

import os
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlparse

import numpy as np

from .._check import Array, choice, path_of
from ..model.parts.look import Look
from .tree import BALL_FRICTION, Looks, Mass, Omissions, Pose, Tree, TreeJoint, hex_colour, unit_axis

_TYPES = ("unknown", "revolute", "continuous", "prismatic", "floating", "planar", "fixed")
_INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
#: the attributes and children that are read of each element; all but a link's visuals, of which some may be missing
_READ: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "robot": (("name",), ("link", "joint", "material")),
    "link": (("name", "type"), ("inertial", "visual")),
    "joint": (("name", "type"), ("origin", "axis", "parent", "child", "limit", "dynamics", "mimic")),
    "inertial": ((), ("origin", "mass", "inertia")),
    "origin": (("xyz", "rpy"), ()),
    "axis": (("xyz",), ()),
    "parent": (("link",), ()),
    "child": (("link",), ()),
    "mass": (("value",), ()),
    "inertia": (_INERTIA, ()),
    "limit": (("lower", "upper", "effort", "velocity"), ()),
    "dynamics": (("damping", "friction"), ()),
    "mimic": (("joint", "multiplier", "offset"), ()),
}


def read_text(path: Any) -> str:
    """The text of a robot's file."""
    try:
        return path_of("path", path).read_text(encoding="utf-8-sig")
    except OSError as e:
        raise ValueError(f"path = {str(path)!r}: {e.strerror}") from None
    except UnicodeDecodeError as e:
        raise ValueError(f"path = {str(path)!r}: is no text ({e.reason} at byte {e.start})") from None


def parse_xml(text: str) -> ET.Element:
    """The root of the XML text. ValueError with the line of a syntax error."""
    try:
        return ET.fromstring(text.encode())
    except ET.ParseError as e:
        line, column = e.position
        reason = str(e).partition(":")[0]
        raise ValueError(f"line {line}, column {column + 1}: is no XML ({reason})") from None


def read_urdf(path: Any, gravity: Any) -> Tree:
    """The tree of a URDF file."""
    root = parse_xml(read_text(path))
    if root.tag != "robot":
        raise ValueError(f"<{root.tag}>: must be <robot>" + (" (is this MJCF?)" if root.tag == "mujoco" else ""))
    if any("xacro" in x.tag for x in root.iter()):
        raise ValueError("holds macros (xacro): expand them first, with ROS' own xacro FILE > robot.urdf")
    left_out: Omissions = []
    _note_unread(root, "", left_out)
    links, joints = _by_name(root, "link"), _by_name(root, "joint")
    looks: Looks = {}
    colours = {m.get("name", ""): c for m in root.findall("material") if (c := _colour(m))}
    for name, link in links.items():
        for visual in link.findall("visual"):
            found = _look(visual, Path(path).parent, colours)
            if isinstance(found, str):
                left_out.append((found, name))
            else:
                looks.setdefault(name, []).append(found)
    bodies = {name: _mass(f"link '{name}'", link.find("inertial")) for name, link in links.items()}
    return Tree(bodies, [_joint(name, x, left_out) for name, x in joints.items()], gravity, left_out, looks)


def _by_name(root: ET.Element, kind: str) -> dict[str, ET.Element]:
    out: dict[str, ET.Element] = {}
    for x in root.findall(kind):
        name = _text(x, "name", kind)
        if name in out:
            raise ValueError(f"{kind} '{name}': is named twice")
        out[name] = x
    return out


def _note_unread(node: ET.Element, owner: str, left_out: Omissions) -> None:
    """Notes the elements and attributes that are not read."""
    attributes, elements = _READ[node.tag]
    owner = node.get("name", owner) if node.tag in ("link", "joint") else owner
    if node.tag != "robot":
        unread = sorted(k for k in set(node.attrib) - set(attributes) if not k.startswith("{"))
        left_out += [(f"attribute {key} of <{node.tag}>", owner) for key in unread]
    for inner in node:
        if inner.tag in elements:
            if inner.tag in _READ:
                _note_unread(inner, owner, left_out)
        elif inner.tag == "collision":
            left_out.append(("shapes to touch (<collision>)", owner))
        elif isinstance(inner.tag, str):
            left_out.append((f"<{inner.tag}>", owner or inner.get("name", "")))


def _text(element: ET.Element | None, key: str, where: str) -> str:
    found = None if element is None else element.get(key)
    if found is None:
        raise ValueError(f"{where}: {key} is missing")
    return found


def _numbers(where: str, element: ET.Element | None, key: str, default: Sequence[float] | None = None) -> Array:
    """The numbers of an attribute, as many as the default has; one, which must be there, without a default."""
    text = None if element is None else element.get(key)
    if element is None or text is None:
        return np.array([float(_text(element, key, where))] if default is None else default)
    count = 1 if default is None else len(default)
    try:
        out = np.array([float(word) for word in text.split()])
    except ValueError:
        out = np.zeros(0)
    if len(out) != count:
        want = "one number" if count == 1 else f"{count} numbers"
        raise ValueError(f'{where}: <{element.tag} {key}="{text}">: must be {want}')
    if not np.isfinite(out).all():
        raise ValueError(f"{where}: {element.tag} = {text}: must be finite")
    return out


def _pose(where: str, origin: ET.Element | None) -> Pose:
    xyz, rpy = (_numbers(where, origin, key, (0.0, 0.0, 0.0)) for key in ("xyz", "rpy"))
    return Pose(xyz, _rotation(rpy))


def _rotation(rpy: Array) -> Array:
    """Roll, pitch, yaw (rad) about the fixed x, y, z; quarter turns are exact."""
    c, s = np.cos(rpy), np.sin(rpy)
    c, s = (np.where(np.abs(x) < 1e-15, 0.0, x) for x in (c, s))
    x = np.array([[1, 0, 0], [0, c[0], -s[0]], [0, s[0], c[0]]])
    y = np.array([[c[1], 0, s[1]], [0, 1, 0], [-s[1], 0, c[1]]])
    z = np.array([[c[2], -s[2], 0], [s[2], c[2], 0], [0, 0, 1]])
    return np.asarray(z @ y @ x)


def _mass(where: str, inertial: ET.Element | None) -> Mass:
    if inertial is None:
        return Mass()
    pose, given = _pose(f"{where}: inertial", inertial.find("origin")), inertial.find("inertia")
    mass = float(_numbers(where, inertial.find("mass"), "value")[0])
    if mass < 0:
        raise ValueError(f"{where}: mass = {mass}: must not be negative")
    inertia = np.zeros((3, 3))
    if given is not None:
        xx, xy, xz, yy, yz, zz = (float(_numbers(where, given, key)[0]) for key in _INERTIA)
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return Mass(mass, np.zeros(3), inertia).placed(pose)


def _joint(name: str, joint: ET.Element, left_out: Omissions) -> TreeJoint:
    where = f"joint '{name}'"
    given = choice(f"{where}: type", _text(joint, "type", where), _TYPES)
    kind, mimic = {"continuous": "revolute", "floating": "free"}.get(given, given), joint.find("mimic")
    if mimic is not None:
        kind = f"mimic of '{_text(mimic, 'joint', where)}'"
    limits: list[Any] = [None, None]
    if (limit := joint.find("limit")) is not None:
        if given in ("revolute", "prismatic"):
            limits = [float(_numbers(where, limit, key, (0.0,))[0]) for key in ("lower", "upper")]
        left_out.append(("limits of effort and velocity", name))
    springs, dynamics = {}, joint.find("dynamics")
    if dynamics is not None:
        keys = {"damping": "damping", "coulomb": "friction"}
        springs = {k: float(_numbers(where, dynamics, key, (0.0,))[0]) for k, key in keys.items()}
        if given == "floating" and springs.pop("coulomb"):
            left_out.append((BALL_FRICTION, name))
    parent, child = (_text(joint.find(side), "link", f"{where}: {side}") for side in ("parent", "child"))
    axis, origin = _numbers(where, joint.find("axis"), "xyz", (1.0, 0.0, 0.0)), _pose(where, joint.find("origin"))
    turn = Pose(rotation=_turn_of_z(unit_axis(name, axis))) if given == "planar" else Pose()
    return TreeJoint(name, kind, parent, child, origin @ turn, axis, turn.inverse, springs, *limits)


def _turn_of_z(axis: Array) -> Array:
    """The rotation matrix of the shortest turn that takes z to this unit vector."""
    away, z = axis[:2], axis[2]
    size = np.linalg.norm(away)
    way = away / size if size else np.array([0.0, 1.0])  # of -z by half a turn about x
    return np.block([[np.eye(2) - (1 - z) * np.outer(way, way), away[:, None]], [-away, z]])


# -- looks -------------------------------------------------------------------------------------------------------------


def _colour(material: ET.Element | None) -> str | None:
    color = None if material is None else material.find("color")
    return None if color is None else hex_colour([float(x) for x in color.get("rgba", "").split()])


def _look(visual: ET.Element, folder: Path, colours: dict[str, str]) -> tuple[Pose, Look] | str:
    """The look of a <visual>, or why it cannot be shown, which is no error."""
    material, shape = visual.find("material"), next(iter(visual.find("geometry") or []), None)
    named = colours.get(material.get("name", "")) if material is not None else None

    def sizes(*keys: str) -> list[float]:
        return [float(_numbers("", shape, key)[0]) for key in keys]

    try:
        pose, colour, kind = _pose("", visual.find("origin")), _colour(material) or named, getattr(shape, "tag", "")
        if kind == "mesh":
            name = _text(shape, "filename", "mesh")
            if (file := mesh_file(name, folder)) is None:
                return f"the mesh {name}: there is no such file" if name else "a <visual> that is no known shape"
            scale = _numbers("", shape, "scale", (1.0, 1.0, 1.0)).tolist()
            return pose, Look("mesh", scale, file=str(file), colour=colour)
        if kind == "box":
            return pose, Look("box", _numbers("", shape, "size", (0.0, 0.0, 0.0)).tolist(), colour=colour)
        if kind == "cylinder":
            return pose, Look("cylinder", sizes("radius", "length"), colour=colour)
        if kind == "sphere":
            return pose, Look("ball", sizes("radius"), colour=colour)
    except ValueError as e:
        return f"a <visual> that cannot be read: {str(e).removeprefix(': ')}"
    return "a <visual> that is no known shape"


def mesh_file(name: str, folder: Path) -> Path | None:
    """The file that a URDF names: package://PACKAGE/..., file://..., or a path from the URDF's folder; None if there is
    none. Packages are looked for in the folders above the URDF, in ROS_PACKAGE_PATH and AMENT_PREFIX_PATH."""
    url = urlparse(name)
    if url.scheme in ("package", "model"):
        candidates = _in_packages(unquote(url.netloc), unquote(url.path).lstrip("/"), folder)
    elif url.scheme == "file":
        candidates = iter([Path(unquote(url.netloc + url.path))])
    else:
        candidates = iter([folder / name])
    return next((path.resolve() for path in candidates if path.is_file()), None)


def _in_packages(package: str, rest: str, folder: Path) -> Iterator[Path]:
    above = [folder.resolve(), *folder.resolve().parents]
    for place in (*above, *(Path(x) for x in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if x)):
        yield place / package / rest
        if place.name == package:
            yield place / rest
    for prefix in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        yield Path(prefix) / "share" / package / rest
