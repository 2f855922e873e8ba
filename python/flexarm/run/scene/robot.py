"""Arms from robots' files."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ..._check import array, warn
from ...arm.arm import Arm
from ...model.parts.beam import Beam
from ...robots.chain import Flexible, arm_links
from ...robots.mjcf import read_mjcf
from ...robots.tree import RobotWarning, Tree
from ...robots.urdf import read_urdf


def from_urdf(
    path: str | Path,
    *,
    tip: str | Sequence[str] | None = None,
    flexible: Mapping[str, Beam | Flexible] | None = None,
    stops: float | Sequence[float] | None = None,
    reflected_inertia: float | Mapping[str, float] | None = None,
    damping: float | Mapping[str, float] | None = None,
    coulomb: float | Mapping[str, float] | None = None,
    gravity: Sequence[float] = (0.0, 0.0, -9.81),
) -> Arm:
    """An arm from a URDF file: the tree of its joints, or the chain to one of its links.

    Each moving joint, with its child link and all links fixed to that, becomes one link of the arm, with the URDF's
    frames and the URDF's names of link and joint. Origins, axes, inertias, damping and (dry) friction are kept. The
    arm's world is the base's frame, and links on the base have the parent "world". The links stand branch after branch,
    in the order of the file's joints; a link's end is the place of the first joint on it. A floating joint becomes a
    Free one, at zero in its origin; a planar one Planar, in axes that the shortest turn takes from its origin's to z
    along its axis. Their damping holds for all their freedoms.

    Args:
        path: of the file.
        tip: the last link of the arm, whose frame is `arm.frame(q)`; if it is fixed to a moving link, it becomes a link
            of its own, without mass. A list: the last links of a tree. Joints of other branches are locked at zero, and
            their bodies move with the link that carries them. None: all joints that move.
        flexible: flexible links: by the name of a moving link, a Beam from its joint to the next one (or the tip), with
            that length, whose mass replaces the link's own; or a Flexible for other cases. Links on a beam must sit
            on its end: there, beyond it, or on a body that is fixed to it.
        stops: soft stops at the position limits: a stiffness (N m/rad, N/m), or (stiffness, damping). None: no stops.
        reflected_inertia: of the drives' rotors at the joints (kg m^2, kg), which URDF lacks: one number for all moving
            joints but floating ones, or by the name of a joint or of its child link, {"elbow": 0.1}.
        damping: viscous (N m s/rad, N s/m), likewise, in place of the file's; None: the file's.
        coulomb: dry friction (N m, N), likewise; balls have none.
        gravity: in the base's axes (m/s^2).

    Raises:
        ValueError: no such file, bad XML (with the line), a loop, a mimic joint on the way to a tip (with the tips
            ahead of it), an impossible inertia, an unknown name (with the known ones), a joint along a beam; each with
            the name of the link or joint.
        ImportError: the parser is missing.

    Warns:
        RobotWarning: one list of all features of the file that the arm lacks.
    """
    springs = {"reflected_inertia": reflected_inertia, "damping": damping, "coulomb": coulomb}
    return _arm(read_urdf, path, gravity, tip, flexible, stops, springs)


def from_mjcf(
    path: str | Path,
    *,
    tip: str | Sequence[str] | None = None,
    flexible: Mapping[str, Beam | Flexible] | None = None,
    stops: float | Sequence[float] | None = None,
    reflected_inertia: float | Mapping[str, float] | None = None,
    damping: float | Mapping[str, float] | None = None,
    coulomb: float | Mapping[str, float] | None = None,
    gravity: Sequence[float] | None = None,
) -> Arm:
    """An arm from an MJCF file: the tree of its joints, or the chain to one of its bodies.

    As of `from_urdf`, with bodies for links: hinges, slides, balls (Spherical) and free joints, their anchors, springs,
    damping, armature (as reflected inertia) and friction loss. A body with several joints gives links without mass
    between them. Active constraints that connect or weld become loops. All coordinates are zero in the model's `qpos0`,
    and quaternions 1 0 0 0; a free joint's position is told from there, in the axes that its body has there. It needs
    `pip install 'flexarm[mjcf]'`.

    Args:
        path: of the file; its includes are read from its folder.
        tip: the last body of the arm, or the last bodies; as of `from_urdf`, as are flexible and stops.
        flexible: flexible links, by the name of a body.
        stops: of soft stops at the joints' ranges.
        reflected_inertia, damping, coulomb: in place of the file's armature, damping and friction loss; as of
            `from_urdf`.
        gravity: in world axes (m/s^2); None: the file's.

    Raises:
        ValueError: as of `from_urdf`; errors of MuJoCo, with its message.
        ImportError: MuJoCo is missing.

    Warns:
        RobotWarning: one list of all features of the file that the arm lacks.
    """
    springs = {"reflected_inertia": reflected_inertia, "damping": damping, "coulomb": coulomb}
    return _arm(read_mjcf, path, gravity, tip, flexible, stops, springs)


def _arm(
    read: Callable[[Any, Any], Tree], path: Any, gravity: Any, tip: Any, flexible: Any, stops: Any,
    springs: Mapping[str, Any],
) -> Arm:  # fmt: skip
    try:
        tree = read(path, None if gravity is None else tuple(array("gravity", gravity, (3,)).tolist()))
        made = arm_links(tree, tip, flexible, stops, springs)
        arm = Arm(made.links, tree.gravity, loops=made.loops)
    except ValueError as e:
        raise ValueError(f"{Path(path).name}: {e}" if isinstance(path, (str, Path)) else str(e)) from None
    if made.notes:
        text = "\n".join(f"  - {line}" for line in made.notes)
        warn(f"{Path(path).name}: the arm does not have\n{text}", RobotWarning)
    return arm
