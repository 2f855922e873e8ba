"""URDF files to trees, by ROS' own parser (urdfdom-py)."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import Counter
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from .._check import Array
from .looks import rotation_of, urdf_looks
from .tree import Mass, Pose, Tree, TreeJoint

_NUMBERS = ("origin", "axis", "mass", "inertia", "limit", "dynamics")  #: have no other attributes
#: the attributes and children that are read of each element; the parser gets no others
_READ: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "robot": (("name",), ("link", "joint")),
    "link": (("name",), ("inertial",)),
    "joint": (("name", "type"), ("origin", "axis", "parent", "child", "limit", "dynamics", "mimic")),
    "inertial": ((), ("origin", "mass", "inertia")),
    "origin": (("xyz", "rpy"), ()),
    "axis": (("xyz",), ()),
    "parent": (("link",), ()),
    "child": (("link",), ()),
    "mass": (("value",), ()),
    "inertia": (("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), ()),
    "limit": (("lower", "upper", "effort", "velocity"), ()),
    "dynamics": (("damping", "friction"), ()),
    "mimic": (("joint", "multiplier", "offset"), ()),
}


def read_text(path: Any) -> str:
    """The text of a robot's file."""
    if not isinstance(path, (str, Path)):
        raise ValueError(f"path = {path!r}: must be a path")
    try:
        return Path(path).read_text(encoding="utf-8-sig")
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


def _parser() -> ModuleType:
    try:
        from urdf_parser_py import urdf
    except ImportError:
        raise ImportError("from_urdf needs a parser: pip install 'flexarm[urdf]'") from None
    return urdf  # type: ignore[no-any-return]


def read_urdf(path: Any, gravity: Any) -> Tree:
    """The tree of a URDF file."""
    text = read_text(path)
    root = parse_xml(text)
    if root.tag != "robot":
        raise ValueError(f"<{root.tag}>: must be <robot>" + (" (is this MJCF?)" if root.tag == "mujoco" else ""))
    if any("xacro" in x.tag for x in root.iter()):
        raise ValueError("holds macros (xacro): expand them first, with ROS' own xacro FILE > robot.urdf")
    left_out: list[tuple[str, str]] = []
    root.attrib.setdefault("name", "robot")
    looks = urdf_looks(root, Path(path).parent, left_out)
    _prune(root, "", left_out)
    parser = _parser()
    try:
        robot = parser.URDF.from_xml_string(ET.tostring(root))
    except Exception as e:  # the parser's own, and AssertionErrors and KeyErrors of it
        raise ValueError(" ".join(str(e).split()) or repr(e)) from None
    _unique("link", [x.name for x in robot.links])
    _unique("joint", [x.name for x in robot.joints])
    bodies = {link.name: _mass(link) for link in robot.links}
    joints = [_joint(j, left_out) for j in robot.joints]
    return Tree(bodies, joints, gravity, left_out, looks)


def _prune(node: ET.Element, owner: str, left_out: list[tuple[str, str]]) -> None:
    """Removes the elements and attributes that are not read, and notes them."""
    attributes, elements = _READ[node.tag]
    owner = node.get("name", owner) if node.tag in ("link", "joint") else owner
    for key in sorted(set(node.attrib) - set(attributes)):
        if not key.startswith("{") and not (node.tag == "robot" or (node.tag, key) == ("link", "type")):
            left_out.append((f"attribute {key} of <{node.tag}>", owner))
        del node.attrib[key]
    for key, text in node.attrib.items() if node.tag in _NUMBERS else ():
        many = 3 if key in ("xyz", "rpy") else 1
        try:
            fits = len([float(word) for word in text.split()]) == many
        except ValueError:
            fits = False
        if not fits:
            want = "3 numbers" if many == 3 else "one number"
            raise ValueError(f'\'{owner}\': <{node.tag} {key}="{text}">: must be {want}')
    node.text = node.tail = None
    for inner in list(node):
        if inner.tag in elements:
            _prune(inner, owner, left_out)
            continue
        node.remove(inner)
        if inner.tag == "collision":
            left_out.append(("shapes to touch (<collision>)", owner))
        elif inner.tag == "visual":
            continue  # read by urdf_looks
        elif isinstance(inner.tag, str):
            left_out.append((f"<{inner.tag}>", "" if inner.tag == "material" else owner or inner.get("name", "")))


def _unique(kind: str, names: list[str]) -> None:
    for name, count in Counter(names).items():
        if count > 1:
            raise ValueError(f"{kind} '{name}': is named twice")


def _numbers(where: str, values: Any, n: int) -> Array:
    out = np.zeros(n) if values is None else np.array(values, dtype=float)
    if out.shape != (n,) or not np.isfinite(out).all():
        want = f"{n} finite numbers" if n > 1 else "a finite number"
        raise ValueError(f"{where} = {out.tolist() if n > 1 else out[0]}: must be {want}")
    return out


def _pose(where: str, origin: Any) -> Pose:
    if origin is None:
        return Pose()
    rpy = _numbers(f"{where}: rpy", origin.rpy, 3)
    return Pose(_numbers(f"{where}: xyz", origin.xyz, 3), rotation_of(rpy))


def _mass(link: Any) -> Mass:
    inertial = link.inertial
    if inertial is None:
        return Mass()
    where = f"link '{link.name}'"
    pose = _pose(f"{where}: inertial", inertial.origin)
    mass = float(_numbers(f"{where}: mass", [inertial.mass], 1)[0])
    inertia = np.zeros((3, 3))
    if inertial.inertia is not None:
        inertia = np.array(inertial.inertia.to_matrix(), dtype=float)
        _numbers(f"{where}: inertia", inertia.ravel(), 9)
    if mass < 0:
        raise ValueError(f"{where}: mass = {mass}: must not be negative")
    return Mass(mass, np.zeros(3), inertia).placed(pose)


def _joint(joint: Any, left_out: list[tuple[str, str]]) -> TreeJoint:
    where, kind = f"joint '{joint.name}'", joint.type
    kind = {"continuous": "revolute"}.get(kind, kind)
    if joint.mimic is not None:
        kind = f"mimic of '{joint.mimic.joint}'"
    lower = upper = None
    if joint.limit is not None:
        if joint.type in ("revolute", "prismatic"):
            lower, upper = _numbers(f"{where}: limit", [joint.limit.lower, joint.limit.upper], 2).tolist()
        left_out.append(("limits of effort and velocity", joint.name))
    springs = {}
    if joint.dynamics is not None:
        values = [joint.dynamics.damping or 0.0, joint.dynamics.friction or 0.0]
        springs = dict(zip(("damping", "coulomb"), _numbers(f"{where}: dynamics", values, 2).tolist(), strict=True))
    axis = np.array([1.0, 0.0, 0.0]) if joint.axis is None else _numbers(f"{where}: axis", joint.axis, 3)
    origin = _pose(f"{where}: origin", joint.origin)
    return TreeJoint(
        joint.name, kind, joint.parent, joint.child, origin, axis, springs=springs, lower=lower, upper=upper
    )
