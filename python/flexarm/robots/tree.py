"""A robot as described by its file: bodies on joints in a tree."""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .._check import Array, choice
from ..model.parts.look import Look

BALL_FRICTION = "dry friction of ball and free joints"  #: an item of Omissions

#: Features of a file that an arm does not have: (item, owner).
Omissions = list[tuple[str, str]]


class RobotWarning(UserWarning):
    """A feature of a robot's file that the arm does not have, or the other way round."""


@dataclass(frozen=True)
class Pose:
    """A frame in another: x = position + rotation @ x'."""

    position: Array = field(default_factory=lambda: np.zeros(3))
    rotation: Array = field(default_factory=lambda: np.eye(3))

    def __matmul__(self, other: Pose) -> Pose:
        return Pose(self.position + self.rotation @ other.position, self.rotation @ other.rotation)

    @property
    def inverse(self) -> Pose:
        return Pose(-self.rotation.T @ self.position, self.rotation.T)

    def seen(self, other: Pose) -> Pose:
        """A frame that stands beside this one, in this one."""
        return Pose(self.rotation.T @ (other.position - self.position), self.rotation.T @ other.rotation)


@dataclass(frozen=True)
class Mass:
    """A rigid body: kg, centre of mass (m), inertia about it (kg m^2)."""

    mass: float = 0.0
    com: Array = field(default_factory=lambda: np.zeros(3))
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))

    def placed(self, pose: Pose) -> Mass:
        """The same body in another frame; `pose` is its frame in that one."""
        R = pose.rotation
        return Mass(self.mass, pose.position + R @ self.com, R @ self.inertia @ R.T)


#: The looks of bodies by name, each with its pose in the body's frame.
Looks = dict[str, list[tuple[Pose, Look]]]


def hex_colour(rgba: Any) -> str | None:
    """The "#RRGGBB" of a colour from 0 to 1; None if it is none."""
    rgb = np.asarray(rgba, dtype=float)[:3]
    if rgb.shape != (3,) or not np.isfinite(rgb).all():
        return None
    return "#" + "".join(f"{round(255 * float(c)):02X}" for c in rgb.clip(0.0, 1.0))


def merged(bodies: Iterable[Mass]) -> Mass:
    """Several bodies as one rigid body, by the parallel axis theorem."""
    bodies = list(bodies)
    mass = sum(b.mass for b in bodies)
    com = sum((b.mass * b.com for b in bodies), np.zeros(3)) / mass if mass > 0 else np.zeros(3)
    inertia = np.zeros((3, 3))
    for b in bodies:
        r = b.com - com
        inertia = inertia + b.inertia + b.mass * (r @ r * np.eye(3) - np.outer(r, r))
    return Mass(mass, com, (inertia + inertia.T) / 2)


def unit_axis(joint: str, axis: Array) -> Array:
    """A joint's axis at length 1."""
    if not axis.any():
        raise ValueError(f"joint '{joint}': axis = {axis.tolist()}: must have a length")
    bare = axis / np.abs(axis).max()  # avoids overflow and underflow of the squares
    return np.asarray(bare / np.linalg.norm(bare))


def realisable(body: Mass) -> Mass:
    """The same body with moments that a body in space can have. In a plane only the moment about the axis of the joints
    may be given; the others do not matter there, and are raised until it is not above their sum."""
    moments, axes = np.linalg.eigh(body.inertia)
    lacks = moments[2] - moments[0] - moments[1]
    if lacks <= 1e-12 * moments[2]:
        return body
    raised = moments + np.array([0.5, 0.5, 0.0]) * lacks * (1 + 1e-9)
    return Mass(body.mass, body.com, axes @ np.diag(raised) @ axes.T)


@dataclass(frozen=True)
class TreeJoint:
    """A joint of the tree."""

    name: str
    kind: str  #: "fixed", "revolute", ... as of fa.Joint; or another word of the file, which is not supported
    parent: str
    child: str
    origin: Pose = field(default_factory=Pose)  #: its frame in the parent's frame
    axis: Array = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))  #: in the axes of `origin`
    outboard: Pose = field(default_factory=Pose)  #: the child's frame, in the joint's moving axes
    springs: dict[str, float] = field(default_factory=dict)  #: arguments of fa.Joint, from stiffness on
    lower: float | None = None  #: limit (rad, m), or None
    upper: float | None = None  #: likewise; of a ball, the largest angle of its turn

    @property
    def moves(self) -> bool:
        return self.kind != "fixed"

    @property
    def rest_pose(self) -> Pose:
        """The child's frame in the parent's, with the joint at zero."""
        return self.origin @ self.outboard


@dataclass(frozen=True)
class TreeLoop:
    """The closure of a loop: frames on two bodies meet ("fixed"), or their origins do ("spherical")."""

    name: str
    kind: str
    a: tuple[str, Pose]  #: a body, and the frame in the body's
    b: tuple[str, Pose]


@dataclass
class Tree:
    """Bodies by name, joints, omissions of the file (item, owner), the looks of bodies, each with its pose in the
    body's frame, and closures of loops."""

    bodies: dict[str, Mass]
    joints: list[TreeJoint]
    gravity: tuple[float, float, float]
    left_out: Omissions = field(default_factory=list)
    looks: Looks = field(default_factory=dict)
    loops: list[TreeLoop] = field(default_factory=list)
    root: str = field(init=False)
    above: dict[str, TreeJoint] = field(init=False, repr=False)  #: the joint of each body to its parent
    below: dict[str, list[TreeJoint]] = field(init=False, repr=False)  #: the joints of each body to its children

    def __post_init__(self) -> None:
        self.above, self.below = {}, {name: [] for name in self.bodies}
        for joint in self.joints:
            for which, name in (("parent", joint.parent), ("child", joint.child)):
                if name not in self.bodies:
                    raise ValueError(f"joint '{joint.name}': its {which} '{name}' is no link of the file")
            if joint.child in self.above:
                other = self.above[joint.child].name
                raise ValueError(
                    f"link '{joint.child}': is the child of '{other}' and '{joint.name}'; loops are not supported"
                )
            self.above[joint.child] = joint
            self.below[joint.parent].append(joint)
        roots = [name for name in self.bodies if name not in self.above]
        if not self.bodies:
            raise ValueError("the file has no links")
        if not roots:
            raise ValueError(f"joint '{self.joints[0].name}': the joints close a loop, no link is the base")
        if len(roots) > 1:
            raise ValueError(f"links {', '.join(roots)}: no joint leads to them; only one, the base, may have none")
        self.root = roots[0]
        lost = set(self.bodies) - {name for name, _ in self.beneath(self.root)}
        if lost:
            raise ValueError(f"link '{sorted(lost)[0]}': hangs in a loop of joints, which is not supported")

    def ways(self, tips: Sequence[str] | None) -> list[TreeJoint]:
        """The joints on the ways from the base to these bodies, None: to all that move; parents first, branch after
        branch."""
        passed: set[str] = set()
        for tip in (j.child for j in self.joints if j.moves) if tips is None else tips:
            choice("tip", tip, self.bodies)
            while tip in self.above and tip not in passed:
                passed.add(tip)
                tip = self.above[tip].parent
        return [self.above[name] for name, _ in self.beneath(self.root) if name in passed]

    def beneath(self, name: str, without: Container[str] = ()) -> list[tuple[str, Pose]]:
        """A body and all its descendants, except those that begin with a body of `without`, with their poses at zero;
        parents first, branch after branch."""
        out, todo = [], [(name, Pose())]
        while todo:
            body, pose = todo.pop()
            out.append((body, pose))
            todo += [(j.child, pose @ j.rest_pose) for j in reversed(self.below[body]) if j.child not in without]
        return out
