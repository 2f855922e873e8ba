"""Arms as MJCF and URDF files: Arm.to_mjcf and Arm.to_urdf."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from .._check import Array, named, warn
from ..data.store.files import write_whole
from ..model.parts.chain import Chain
from ..model.parts.joints import UNIT, Joint
from ..model.parts.link import Link
from .segments import Segmented, locked_frequencies, mass_of, place_in, segmented
from .tree import Mass, Pose, RobotWarning, realisable

WORLD = "world"  #: name of the base in both formats
#: the constraints that close a loop, and where along the joint's axis
_LOOPS = {"fixed": ("weld", (0.0,)), "spherical": ("connect", (0.0,)), "revolute": ("connect", (0.0, 1.0))}
_HINGE = 0.1  # of the longest link: how far apart the two balls of a hinge are
_SMALL = 1e-12  # kg, kg m^2: least mass and inertia, for programs that refuse zero


@dataclass(frozen=True)
class _Freedom:
    """One freedom of a joint, with its spring, damper, stops, friction and motor."""

    name: str
    rotates: bool
    axis: Array
    values: dict[str, float]  #: by the names of fa.Joint's arguments


def _pose(place: Any) -> Pose:
    return Pose() if place is None else Pose(*place._core)


def _freedoms(own: str, joint: Joint) -> list[_Freedom]:
    """The freedoms of a joint of this name; those of a ball, its angular velocities, come last."""
    fields = ("stiffness", "rest", "damping", "lower", "upper", "coulomb", "stiction", "reflected_inertia",
              "torque_limit")  # fmt: skip
    columns = {field: joint._per_freedom(field, joint.nv) for field in fields}
    out = []
    turns = [(f"w{x}", True, axis) for x, axis in UNIT.items() if joint.ball]
    for k, (label, rotates, axis) in enumerate([*joint._freedoms(), *turns]):
        words = own if joint.nv == 1 else f"{own} {label}"
        out.append(_Freedom(words, rotates, np.array(axis), {f: float(c[k]) for f, c in columns.items()}))
    return out


def _joint_name(name: str, joint: Joint, taken: Sequence[str]) -> str:
    """A name for the joint of the link `name`: its own, or one that differs from `taken`."""
    return joint.name or _free(f"{name} joint", taken)


def _misfit(freedoms: Sequence[_Freedom], common: Sequence[str], lost: Sequence[str] = ()) -> str | None:
    """The first numbers that keep the freedoms from being one joint of a file, which has one number for all of them in
    the `common` fields, and no others; the lost ones do not matter."""
    none = {"lower": -np.inf, "upper": np.inf, "torque_limit": np.inf}
    for field, first in freedoms[0].values.items() if freedoms else ():
        each = [f.values[field] for f in freedoms]
        if field not in lost and any(x != (first if field in common else none.get(field, 0.0)) for x in each):
            return f"{field} = {each}"
    return None


def _at_end(link: Link) -> Array:
    return np.zeros(3) if link.hub is None else np.array(link.hub.end)


def _free(name: str, taken: Sequence[str]) -> str:
    """The name, or, if it is taken, one like it."""
    return _free(f"{name}_", taken) if name in taken else name


def _taken(arm: Chain) -> list[str]:
    return [link.joint.name for link in arm.links if link.joint.name is not None]


def _numbers(values: Any) -> str:
    return " ".join(repr(float(x) + 0.0) for x in np.ravel(values))


def _quaternion(R: Array) -> Array:
    from scipy.spatial.transform import Rotation  # slow to import

    return np.asarray(Rotation.from_matrix(R).as_quat())[[3, 0, 1, 2]]


def _in_space(mass: Mass) -> Mass:
    """The same body for programs that refuse bodies without mass or inertia."""
    body = realisable(mass)
    small = _SMALL * np.eye(3) * (np.linalg.eigvalsh(body.inertia)[0] < _SMALL)
    return Mass(max(body.mass, _SMALL), body.com, body.inertia + small)


def about(cut: Segmented) -> Iterator[str]:
    """Comment lines on the arm that the file approximates, and the accuracy."""
    yield "Written by flexarm."
    if len(cut.wanted):
        words = ", ".join(
            f"{w:.6g} ({100 * (f / w - 1):+.2f} % here)" for w, f in zip(cut.wanted, cut.frequencies, strict=True)
        )
        yield "Beams are rigid segments on springs, fitted to the arm's lowest frequencies (rad/s, joints locked, no "
        yield f"gravity): {words}."


def _comment(cut: Segmented) -> str:
    return f"<!-- {' '.join(' '.join(about(cut)).replace('--', '- -').split())} -->\n"


def missing_features(cut: Segmented, fields: dict[str, str]) -> list[str]:
    """Features of the arm that the file does not have; for joints, by the names of their arguments."""
    out = list(cut.left_out)
    links = list(zip(cut.names, cut.arm.links, strict=True))
    for field, words in fields.items():
        out += _note(words, [link.joint.name or name for name, link in links if _has(link.joint, field)])
    return out + _note("looks (shapes and meshes)", [name for name, link in links if link.looks])


def _note(words: str, owners: Sequence[str]) -> list[str]:
    more = f" and {len(owners) - 6} more" if len(owners) > 6 else ""
    return [f"{words}: {', '.join(owners[:6])}{more}"] if owners else []


def _has(joint: Joint, field: str) -> bool:
    """Whether the joint uses the feature of this argument."""
    if field == "name":
        return not joint.nv and joint.name is not None
    column = {f: np.array(joint._per_freedom(f, joint.nv)) for f in ("coulomb", "lower", "upper", field)}
    if field == "limit_stiffness":
        return bool(np.isfinite([column["lower"], column["upper"]]).any())
    return bool((column[field] != (column["coulomb"] if field == "stiction" else 0.0)).any())


# -- MJCF -------------------------------------------------------------------------------------------------------------

#: numbers of a free joint and a ball of MJCF, each for all freedoms
_OF_A_BALL = ("stiffness", "damping", "reflected_inertia")


def mjcf(cut: Segmented, whole: Chain) -> str:
    """The file of an arm that is cut: a body for each link, hinges, slides and balls for its joint, a motor for each of
    the arm's own freedoms, a site at each tip, and a tendon with an actuator for each strut of the whole arm."""
    arm, w = cut.arm, float(locked_frequencies(cut.arm, cut.hinges).max(initial=500.0))
    digit = 10.0 ** np.floor(-np.log10(w))
    step = float(f"{np.floor(1 / w / digit) * digit:.0e}")  # at most half of the largest stable step
    root = ET.Element("mujoco", model="arm")
    ET.SubElement(root, "compiler", angle="radian", autolimits="false")
    option = {"gravity": _numbers(arm.gravity), "timestep": repr(step), "integrator": "implicitfast"}
    ET.SubElement(root, "option", option)
    elements, ends = {-1: ET.SubElement(root, "worldbody")}, {-1: Pose()}  # of the world, and of each link
    motors, taken = list[dict[str, str]](), _taken(arm)
    for k, (name, link) in enumerate(zip(cut.names, arm.links, strict=True)):
        name = _free(name, [WORLD])
        inboard, outboard = _pose(link.joint.inboard), _pose(link.joint.outboard)
        at = ends[arm.parents[k]] @ inboard @ outboard
        turn = _numbers(_quaternion(at.rotation))
        element = ET.SubElement(elements[arm.parents[k]], "body", name=name, pos=_numbers(at.position), quat=turn)
        own = _joint_name(name, link.joint, taken)
        found = _mjcf_joints(element, own, link.joint, inboard if arm.parents[k] < 0 else None, outboard.inverse)
        motors += found if k not in cut.hinges else []
        _mjcf_inertia(element, mass_of(link.hub), bool(found))
        _mjcf_shape(element, _at_end(link))
        elements[k], ends[k] = element, Pose(_at_end(link))
    for k, tip in cut.tips.items():
        ET.SubElement(elements[k], "site", name=tip, pos=_numbers(ends[k].position))
    closed = [held for k in range(len(whole.loops)) for held in _mjcf_loop(k, cut, whole, elements)]
    if closed:
        ET.SubElement(root, "equality").extend(closed)
    lines = [_mjcf_strut(k, cut, whole, elements) for k in range(len(whole.struts))]
    if lines:
        ET.SubElement(root, "tendon").extend([line for line, _ in lines])
    if motors or lines:
        actuator = ET.SubElement(root, "actuator")
        actuator.extend([ET.Element("motor", motor) for motor in motors])
        actuator.extend([ET.Element("general", force) for _, force in lines])
    ET.indent(root)
    return _comment(cut) + ET.tostring(root, encoding="unicode") + "\n"


def _mjcf_loop(k: int, cut: Segmented, whole: Chain, elements: Mapping[int, ET.Element]) -> list[ET.Element]:
    """Writes the sites of a loop, and returns its constraints: a weld, a ball, or two balls on the axis of a hinge."""
    loop, name = whole.loops[k], whole.loop_names[k]
    kind, points = _LOOPS.get(loop.joint.type, ("", ()))
    if not kind:
        raise ValueError(
            f"loop '{name}': a {loop.joint.type} joint: MJCF closes loops by balls, hinges and fixed joints; leave it "
            "out, or cut the loop at another joint"
        )
    size = _HINGE * max(float(np.linalg.norm(_at_end(link))) for link in whole.links)
    out = []
    for i, along in enumerate(points):
        sites: dict[str, str] = {}
        for side, (link, on, x, at), (_, axes) in zip("12", whole._closing[k], loop._core, strict=True):
            n, origin = (-1, np.zeros(3)) if link < 0 else place_in(cut, whole, link, on, x)
            sites[f"site{side}"] = f"{name} {i} {side}"
            pos, quat = _numbers(origin + at + along * size * axes[:, 2]), _numbers(_quaternion(axes))
            ET.SubElement(elements[n], "site", name=sites[f"site{side}"], pos=pos, quat=quat)
        out.append(ET.Element(kind, sites, name=f"{name} {i}" if i else name))
    return out


def _mjcf_strut(
    k: int, cut: Segmented, whole: Chain, elements: Mapping[int, ET.Element]
) -> tuple[ET.Element, dict[str, str]]:
    """Writes the sites of a strut or tendon, and returns its tendon and its actuator: a control of 1 is a driven force
    of 1 N."""
    strut, name, rest = whole.struts[k], whole.strut_names[k], whole.rest_lengths[k]
    name = f"{name} spring" if name in whole.names else name  # of a cylinder, whose joint has its name
    spring = {"stiffness": _numbers(strut.stiffness), "damping": _numbers(strut.damping)}
    free = _numbers([0.0, rest] if strut.tension_only else rest)
    line = ET.Element("spatial", {"name": name, **spring, "springlength": free})
    for i, (link, on, x, offset) in enumerate(whole._fastened[k]):
        n, at = (-1, np.zeros(3)) if link < 0 else place_in(cut, whole, link, on, x)
        ET.SubElement(elements[n], "site", name=f"{name} {i}", pos=_numbers(at + offset))
        ET.SubElement(line, "site", site=f"{name} {i}")
    own = {"biastype": "affine", "biasprm": _numbers([strut.force, 0, 0]), "gainprm": _numbers(strut.sense)}
    return line, {"name": name, "tendon": name, **own}


def _mjcf_joints(body: ET.Element, own: str, joint: Joint, ground: Pose | None, anchor: Pose) -> list[dict[str, str]]:
    """Writes a link's joint, and returns a motor for each freedom. Of a free joint on the world (`ground`: its inboard
    frame) a free one; elsewhere, or where its freedoms have different numbers, three slides and a ball."""
    freedoms = _freedoms(own, joint)
    slides, turns = (freedoms[:-3], freedoms[-3:]) if joint.ball else (freedoms, [])
    axes = [_numbers(anchor.rotation @ f.axis) for f in freedoms]
    if joint.type == "free" and ground is not None and not anchor.position.any() and not _misfit(freedoms, _OF_A_BALL):
        _mjcf_joint(body, replace(freedoms[0], name=own), {"type": "free"})
        pulls = [f"{_numbers(ground.rotation @ f.axis)} 0 0 0" for f in slides]
        gears = [*pulls, *(f"0 0 0 {axis}" for axis in axes[3:])]
        return [{"name": f.name, "joint": own, "gear": gear} for f, gear in zip(freedoms, gears, strict=True)]
    motors, pos = [{"name": f.name, "joint": f.name} for f in slides], _numbers(anchor.position)
    for f, axis in zip(slides, axes, strict=False):
        _mjcf_joint(body, f, {"type": "hinge" if f.rotates else "slide", "axis": axis, "pos": pos})
    if not turns:
        return motors
    if bad := _misfit(turns, (*_OF_A_BALL, "lower", "upper")):
        raise ValueError(f"{own}: {bad} of its ball: must be the same about all axes in MJCF")
    ball = own if not slides else f"{own} turn"
    values = turns[0].values | ({"lower": 0.0} if np.isfinite(turns[0].values["upper"]) else {})
    _mjcf_joint(body, replace(turns[0], name=ball, values=values), {"type": "ball", "pos": pos})
    about = zip(turns, axes[len(slides) :], strict=True)
    return motors + [{"name": f.name, "joint": ball, "gear": axis} for f, axis in about]


def _mjcf_joint(body: ET.Element, f: _Freedom, kind: dict[str, str]) -> None:
    """Writes one joint, with the numbers of a freedom."""
    attributes, v = {"name": f.name, **kind}, f.values
    if v["stiffness"]:
        attributes |= {"stiffness": _numbers(v["stiffness"]), "springref": _numbers(v["rest"])}
    for key, field in (("damping", "damping"), ("frictionloss", "coulomb"), ("armature", "reflected_inertia")):
        if v[field]:
            attributes[key] = _numbers(v[field])
    if np.isfinite([v["lower"], v["upper"]]).any():
        limits = np.nan_to_num([v["lower"], v["upper"]], posinf=1e6, neginf=-1e6)
        attributes |= {"limited": "true", "range": _numbers(limits)}
    if np.isfinite(v["torque_limit"]):
        most = v["torque_limit"]
        attributes |= {"actuatorfrclimited": "true", "actuatorfrcrange": _numbers([-most, most])}
    ET.SubElement(body, "joint", attributes)


def _mjcf_inertia(body: ET.Element, mass: Mass, moves: bool) -> None:
    if not (moves or mass.mass):
        return
    own = _in_space(mass)
    I = own.inertia
    entries = _numbers([I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]])
    ET.SubElement(body, "inertial", pos=_numbers(own.com), mass=_numbers(own.mass), fullinertia=entries)


def _mjcf_shape(body: ET.Element, end: Array) -> None:
    """A stick to look at; it touches nothing and has no mass."""
    if size := float(np.linalg.norm(end)):
        look = {"type": "capsule", "fromto": _numbers([np.zeros(3), end]), "size": repr(max(0.02 * size, 1e-3))}
        ET.SubElement(body, "geom", {**look, "contype": "0", "conaffinity": "0", "mass": "0"})


# -- URDF -------------------------------------------------------------------------------------------------------------


def urdf(cut: Segmented) -> str:
    """The file: a link and a joint for each freedom, one for a free joint, and for a planar one whose freedoms are
    alike; a fixed link at each tip. Springs stand in <gazebo> elements, which Gazebo reads."""
    root = ET.Element("robot", name="arm")
    springs, taken = list[_Freedom](), _taken(cut.arm)
    bodies, ends = {-1: _free(WORLD, cut.names)}, {-1: Pose()}  # of the world and each link: the file's link, its end
    ET.SubElement(root, "link", name=bodies[-1])
    for n, (name, link) in enumerate(zip(cut.names, cut.arm.links, strict=True)):
        inboard, outboard = _pose(link.joint.inboard), _pose(link.joint.outboard)
        freedoms, kind = _urdf_freedoms(_joint_name(name, link.joint, taken), link.joint)
        parent, at = bodies[cut.arm.parents[n]], ends[cut.arm.parents[n]] @ inboard
        for k, f in enumerate(freedoms):
            child = name if k + 1 == len(freedoms) else f"{name} {k + 1} of {len(freedoms)}"
            body = ET.SubElement(root, "link", name=child)
            last = k + 1 == len(freedoms)  # a URDF link's frame is that of the joint's moving side
            _urdf_inertia(body, mass_of(link.hub).placed(outboard) if last else Mass(), f is not None)
            _urdf_joint(root, f or link.joint.name or f"{child} (fixed)", at, parent, child, kind)
            springs += [f] if f is not None and f.values["stiffness"] else []
            parent, at = child, Pose()
        bodies[n], ends[n] = parent, outboard @ Pose(_at_end(link))
    for n, tip in cut.tips.items():
        tip = _free(tip, cut.names)
        ET.SubElement(root, "link", name=tip)
        _urdf_joint(root, f"{tip} (fixed)", ends[n], bodies[n], tip)
    for f in springs:
        spring = ET.SubElement(root, "gazebo", reference=f.name)
        ET.SubElement(spring, "springStiffness").text = _numbers(f.values["stiffness"])
        ET.SubElement(spring, "springReference").text = _numbers(f.values["rest"])
    ET.indent(root)
    return '<?xml version="1.0"?>\n' + _comment(cut) + ET.tostring(root, encoding="unicode") + "\n"


def _urdf_freedoms(own: str, joint: Joint) -> tuple[Sequence[_Freedom | None], str | None]:
    """The file's joints in place of one: its freedoms, or one for all with the format's name; None: a fixed joint."""
    freedoms = _freedoms(own, joint)
    bad = _misfit(freedoms, ("damping", "coulomb"), ("stiction", "reflected_inertia"))
    if joint.type == "planar" and not bad:
        return [replace(freedoms[-1], name=own)], "planar"
    if not joint.ball:
        return freedoms or [None], None
    if joint.type != "free":
        raise ValueError(f"{own}: its joint '{joint.type}': URDF has no balls; use three rotations (Axes)")
    if bad:
        raise ValueError(f"{own}: {bad}: a floating joint of URDF has one damping and no springs, stops nor friction")
    return [replace(freedoms[-1], name=own)], "floating"


def _rpy(R: Array) -> tuple[float, float, float]:
    """Roll, pitch, yaw; at a pitch of 90 degrees, where only their sum or difference is determined, yaw is 0."""
    flat = float(np.hypot(R[0, 0], R[1, 0]))
    pitch = float(np.arctan2(-R[2, 0], flat))
    if flat < 1e-9:
        return float(np.arctan2(-R[1, 2], R[1, 1])), pitch, 0.0
    return float(np.arctan2(R[2, 1], R[2, 2])), pitch, float(np.arctan2(R[1, 0], R[0, 0]))


def _urdf_origin(parent: ET.Element, at: Pose) -> None:
    rpy = _rpy(at.rotation)
    ET.SubElement(parent, "origin", xyz=_numbers(at.position), rpy=_numbers(rpy))


def _urdf_inertia(link: ET.Element, mass: Mass, moves: bool) -> None:
    if not (moves or mass.mass or mass.inertia.any()):
        return
    own = _in_space(mass)
    inertial = ET.SubElement(link, "inertial")
    _urdf_origin(inertial, Pose(own.com))
    ET.SubElement(inertial, "mass", value=_numbers(own.mass))
    pairs = [(i, j) for i in range(3) for j in range(i, 3)]
    ET.SubElement(inertial, "inertia", {f"i{'xyz'[i]}{'xyz'[j]}": _numbers(own.inertia[i, j]) for i, j in pairs})


def _urdf_joint(
    root: ET.Element, f: _Freedom | str, at: Pose, parent: str, child: str, given: str | None = None
) -> None:
    """Writes a joint with the numbers of a freedom, of the given type; or a fixed one with this name."""
    kind, name, limits = "fixed", f, (-np.inf, np.inf)
    if isinstance(f, _Freedom):
        name, limits = f.name, (f.values["lower"], f.values["upper"])
        own = ("revolute" if np.isfinite(limits).any() else "continuous") if f.rotates else "prismatic"
        kind = given or own
    joint = ET.SubElement(root, "joint", name=str(name), type=kind)
    _urdf_origin(joint, at)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    if not isinstance(f, _Freedom):
        return
    if kind != "floating":
        ET.SubElement(joint, "axis", xyz=_numbers(f.axis))
    effort = {"effort": _numbers(np.nan_to_num(f.values["torque_limit"], posinf=1e6)), "velocity": "1e6"}
    if kind in ("revolute", "prismatic"):  # the format requires limits
        lower, upper = np.nan_to_num(limits, posinf=1e6, neginf=-1e6)
        ET.SubElement(joint, "limit", {"lower": _numbers(lower), "upper": _numbers(upper), **effort})
    elif np.isfinite(f.values["torque_limit"]):
        ET.SubElement(joint, "limit", effort)
    if f.values["damping"] or f.values["coulomb"]:
        ET.SubElement(joint, "dynamics", damping=_numbers(f.values["damping"]), friction=_numbers(f.values["coulomb"]))


_NEAR = 0.01
_BOTH = {
    "stiction": "stiction above dry friction",
    "limit_stiffness": "stiffness and damping of soft stops (the range is written)",
}
_MJCF = {**_BOTH, "name": "names of fixed joints"}
_URDF = {**_BOTH, "stiffness": "springs, but for Gazebo", "reflected_inertia": "reflected inertia"}


def to_mjcf(arm: Chain, path: str | Path | None = None, segments: int = 10) -> str:
    """The arm as an MJCF file for MuJoCo, its beams as rigid segments on springs.

    Each beam becomes `segments` hinges in the middles of equal pieces, for bending and torsion, with springs that
    are fitted to the arm's lowest three frequencies; the file tells how near they come. Rigid links are exact.
    There is a motor for each freedom of the arm's joints, a site "tip", and a time step for these segments. A strut
    or tendon becomes a spatial tendon with its spring and damper, and an actuator with its constant force. A loop
    becomes a weld (Fixed), a connect (Spherical), or two on its axis (Revolute). Contacts are left out: MuJoCo's
    have other laws. A tree of links becomes one of bodies, with a site "NAME tip" on each link that carries no
    other; `from_mjcf` reads its links branch after branch. A free joint becomes one of MJCF, if it sits on the
    world, its moving side is at the link's origin, and its freedoms have the same numbers; otherwise it becomes
    three slides and a ball.

    Args:
        path: where to write it; None: nowhere.
        segments: of each beam, 2 to 200.

    Returns:
        The text of the file.

    Raises:
        ValueError: loops of other joints; a ball whose damping or reflected inertia differs from axis to axis; a
            beam that is curved at rest; bad arguments.

    Warns:
        RobotWarning: features of the arm that the file lacks, and a frequency error of more than 1 %.
    """
    cut = segmented(arm, segments)
    name = [f"the name '{WORLD}' of a link, which is the base's: '{WORLD}_' there"] if WORLD in cut.names else []
    ropes = [name for name, s in zip(arm.strut_names, arm.struts, strict=True) if s.tension_only and s.damping]
    slack = _note("the end of a tendon's damping where it is slack", ropes)
    soft = [name for name, x in zip(arm.loop_names, arm.loops, strict=True) if x.gives_way]
    left_out = missing_features(cut, _MJCF) + name + slack + _note("contacts", arm.contact_names)
    left_out += _note("the stiffness of loops (MuJoCo's constraints give way by solref)", soft)
    return _written(path, ".xml", mjcf(cut, arm), cut, left_out)


def to_urdf(arm: Chain, path: str | Path | None = None, segments: int = 10) -> str:
    """The arm as a URDF file, its beams as in `to_mjcf`, with a link and a joint for each freedom.

    A free joint becomes a floating one, and a planar joint whose freedoms have the same numbers a planar one. URDF
    has no springs: those of the segments stand in elements that Gazebo alone reads. The tip is a link "tip"; those
    of a tree are links "NAME tip".

    Args:
        path: where to write it; None: nowhere.
        segments: of each beam, 2 to 200.

    Returns:
        The text of the file.

    Raises:
        ValueError: loops; a ball; a free joint with more than one number of damping for all its freedoms; a beam
            that is curved at rest; bad arguments.

    Warns:
        RobotWarning: features of the arm that the file lacks, and a frequency error of more than 1 %.
    """
    arm.refuse_loops("to_urdf")
    cut = segmented(arm, segments)
    gravity = ["gravity: URDF has none"] if any(arm.gravity) else []
    more = _note("struts and tendons", arm.strut_names) + _note("contacts", arm.contact_names)
    return _written(path, ".urdf", urdf(cut), cut, missing_features(cut, _URDF) + gravity + more)


def _written(path: Any, suffix: str, text: str, cut: Segmented, left_out: list[str]) -> str:
    if path is not None:
        content = text.encode()
        write_whole(named(path, suffix), lambda f: f.write(content), "path")
    if cut.error > _NEAR:
        worst = max(range(len(cut.wanted)), key=lambda k: abs(cut.frequencies[k] / cut.wanted[k] - 1))
        left_out.append(
            f"frequency {worst + 1} of the arm: {cut.wanted[worst]:.6g} rad/s, of the segments "
            f"{cut.frequencies[worst]:.6g}; take more segments, or see whether the arm has modes enough"
        )
    if left_out:
        said = "\n".join(f"  - {line}" for line in left_out)
        warn(f"the file does not have\n{said}", RobotWarning)
    return text
