"""Joints (paper Sec. 4.1): zero to six freedoms between the end of one link and the next link."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

import numpy as np

import flexarm._core as _core

from ..._check import Array, array, number
from .beam import Vector, as_floats
from .part import Part, Place, read_name

UNIT = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
_SPRINGS = ("stiffness", "rest", "damping", "lower", "upper", "limit_stiffness", "limit_damping")
FORCES = (*_SPRINGS, "coulomb", "stiction", "reflected_inertia", "torque_limit")
PerFreedom = float | Sequence[float]
_Freedom = tuple[str, bool, Vector]  # label, whether a rotation, axis


def _axis(name: str, value: Any) -> str | tuple[float, ...]:
    if not isinstance(value, str):
        return tuple(array(name, value, (3,)).tolist())
    if value not in UNIT:
        raise ValueError(f'{name} = {value!r}: must be "x", "y", "z" or three numbers')
    return value


Axis = Annotated[str | Vector, _axis]


def _rotation(field_name: str, value: Any) -> Array:
    """A rotation matrix from a rotation vector (rad) or a 3 x 3 matrix."""
    a = array(field_name, value)
    if a.shape == (3, 3):
        return a
    if a.shape != (3,):
        raise ValueError(f"{field_name} has shape {a.shape}: must be a rotation vector (rad) or a 3 x 3 matrix")
    if not a.any():  # as of most joints
        return np.eye(3)
    from scipy.spatial.transform import Rotation  # slow to import

    return np.asarray(Rotation.from_rotvec(a).as_matrix())


def axes_about(axis: Array) -> Array:
    """Axes (columns, (3, 3)) whose third is the axis, of any length: of x, y or z itself these in turn."""
    n = axis / np.linalg.norm(axis)
    k = int(np.abs(n).argmax())
    if n[k] == 1.0:
        return np.roll(np.eye(3), 2 - k, axis=1)
    first = np.cross(n, np.eye(3)[np.abs(n).argmin()])
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(n, first), n])


@dataclass(frozen=True)
class Placement(Part):
    """A frame on one side of a joint.

    Args:
        position: m.
        rotation: a rotation vector (rad), or a 3 x 3 matrix.
    """

    position: Place = (0.0, 0.0, 0.0)
    rotation: Vector | Sequence[Vector] = (0.0, 0.0, 0.0)
    _core: tuple[Array, Array] = field(init=False, repr=False, compare=False)

    def _made(self) -> tuple[Array, Array]:
        made = np.array(self.position), _rotation("rotation", self.rotation)
        self._set("rotation", as_floats(self.rotation))
        return made


_ORIGIN = Placement()


@dataclass(frozen=True, repr=False)
class Joint(Part):
    """The base class of joints: springs, dampers, stops and friction.

    Each of their values is one number, or one for each freedom.

    Args:
        stiffness: of springs (N/m, N m/rad). A ball's spring acts on the angle of its whole turn, alike about all
            axes.
        rest: positions at which the springs are unloaded (m, rad).
        damping: viscous (N s/m, N m s/rad).
        lower, upper: soft stops (m, rad); None: no stop. Of a ball, `upper` is the largest angle of its turn, below pi,
            alike about all axes.
        limit_stiffness: of the stops (N/m, N m/rad).
        limit_damping: of the stops (N s/m, N m s/rad); it sets in over the first 1e-3 m or rad of penetration, so that
            the force stays continuous.
        coulomb: dry friction (N, N m): the force that opposes sliding, at any speed. It acts in all time integration
            (`simulate`, `simulate_batch`, `rollout`, environments): a freedom that comes to rest sticks, exactly still,
            until more than `stiction` is needed to hold it. Functions of one instant (`forward_dynamics`,
            `inverse_dynamics`, `linearize`) leave it out.
        stiction: largest force that holds a sticking freedom (N, N m), at least `coulomb`; None: equal to `coulomb`.
        reflected_inertia: of the drive's rotor, seen from the joint: gear ratio squared times rotor inertia (kg,
            kg m²). The rotor's own gyroscopic moments are left out.
        torque_limit: of the motor or its gear (N m, N): the largest absolute sum of drives, controllers and `tau`;
            None: no limit. It acts in all time integration; `Result.tau` is the limited torque. A prescribed motion and
            the functions of one instant have no limit. Springs, dampers, stops and dry friction are not in the sum.
        inboard: frame of the joint, from the end of the link's parent, or in the world.
        outboard: frame of the link, from the joint's moving side.
        name: such as "elbow"; it may be used instead of the link's number, and labels the coordinates. No dots, no
            number; unique in the arm.
    """

    stiffness: PerFreedom = field(default=0.0, kw_only=True)
    rest: PerFreedom = field(default=0.0, kw_only=True)
    damping: PerFreedom = field(default=0.0, kw_only=True)
    lower: PerFreedom | None = field(default=None, kw_only=True)
    upper: PerFreedom | None = field(default=None, kw_only=True)
    limit_stiffness: PerFreedom = field(default=0.0, kw_only=True)
    limit_damping: PerFreedom = field(default=0.0, kw_only=True)
    coulomb: PerFreedom = field(default=0.0, kw_only=True)
    stiction: PerFreedom | None = field(default=None, kw_only=True)
    reflected_inertia: PerFreedom = field(default=0.0, kw_only=True)
    torque_limit: PerFreedom | None = field(default=None, kw_only=True)
    inboard: Placement | None = field(default=None, kw_only=True)
    outboard: Placement | None = field(default=None, kw_only=True)
    name: str | None = field(default=None, kw_only=True)
    #: one label and one unit ("rad" or "m") for each rate
    labels: tuple[str, ...] = field(init=False, repr=False, compare=False)
    units: tuple[str, ...] = field(init=False, repr=False, compare=False)
    _core: _core.Joint = field(init=False, repr=False, compare=False)

    type: ClassVar[str] = ""
    #: its elementary motions, in order, besides those of a ball: label, whether a rotation, and its axis; "axis" is the
    #: argument
    motions: ClassVar[tuple[tuple[str, bool, str], ...]] = ()
    ball: ClassVar[bool] = False

    @property
    def rubs(self) -> bool:
        """Whether it has dry friction."""
        return bool(np.any(self.coulomb) or np.any(self.stiction))

    def _freedoms(self) -> list[_Freedom]:
        own: Any = getattr(self, "axis", "z")
        axes: dict[str, Vector] = {**UNIT, "axis": UNIT[own] if isinstance(own, str) else own}
        return [(label, rotates, axes[axis]) for label, rotates, axis in self.motions]

    def _per_freedom(self, name: str, n: int) -> list[float]:
        value = getattr(self, name)
        if value is None and name == "stiction":
            return self._per_freedom("coulomb", n)
        if value is None:
            return [-np.inf if name == "lower" else np.inf] * n
        if not isinstance(value, (list, tuple)):
            self._set(name, number(name, value))
            return [getattr(self, name)] * n
        self._set(name, tuple(array(name, value, (n,)).tolist()))
        return list(getattr(self, name))

    def _made(self) -> Any:
        read_name(self.name)
        freedoms = self._freedoms()
        labels = [f"{self.type} {name}".strip() for name, _, _ in freedoms]
        labels += [f"{self.type} w{a}" for a in "xyz"] if self.ball else []
        forces = []
        if any(getattr(self, f) != type(self).__dataclass_fields__[f].default for f in FORCES):
            columns = [self._per_freedom(f, len(labels)) for f in FORCES]
            forces = [_core.JointForce(*row) for row in zip(*columns, strict=True)]
        sides = [(place or _ORIGIN)._core for place in (self.inboard, self.outboard)]
        motions = [(rotates, axis) for _, rotates, axis in freedoms]
        units = ["rad" if rotates else "m" for _, rotates, _ in freedoms] + ["rad"] * (3 if self.ball else 0)
        self._set("labels", tuple(labels))
        self._set("units", tuple(units))
        return _core.Joint(motions, self.ball, labels, forces, *sides)

    def to_dict(self) -> dict[str, Any]:
        """The same structure as in a scene file, without the arguments that have their defaults."""
        defaults = {name: type(self).__dataclass_fields__[name].default for name in (*FORCES, "inboard", "outboard")}
        return {k: v for k, v in super().to_dict().items() if k not in defaults or v != defaults[k]}

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{k}={v!r}' for k, v in self.to_dict().items() if k != 'type')})"

    @property
    def nv(self) -> int:
        """Degrees of freedom: number of rates."""
        return len(self.labels)

    @property
    def nq(self) -> int:
        """Number of coordinates; a ball has four for its three rates."""
        return self.nv + self.ball

    @property
    def q_units(self) -> tuple[str, ...]:
        """A unit for each coordinate: as `units`, and 1 for each component of a quaternion."""
        return self.units[:-3] + ("1",) * 4 if self.ball else self.units


@dataclass(frozen=True, repr=False)
class Fixed(Joint):
    """Rigid connection: no freedom; springs, dampers, stops and friction have no effect."""

    type: ClassVar[str] = "fixed"


@dataclass(frozen=True, repr=False)
class Revolute(Joint):
    """Rotation by q (rad) about an axis.

    Args:
        axis: "x", "y", "z" or three numbers, in the axes the joint sits on.
    """

    axis: Axis = "z"
    type: ClassVar[str] = "revolute"
    motions: ClassVar = (("", True, "axis"),)


@dataclass(frozen=True, repr=False)
class Prismatic(Joint):
    """Translation by q (m) along an axis.

    A beam behind it is clamped to the slide and moves with it at constant length: it is neither a telescope nor a beam
    that slides through a guide.

    Args:
        axis: "x", "y", "z" or three numbers, in the axes the joint sits on.
    """

    axis: Axis = "x"
    type: ClassVar[str] = "prismatic"
    motions: ClassVar = (("", False, "axis"),)


@dataclass(frozen=True, repr=False)
class Cylindrical(Joint):
    """Translation (m) along and rotation (rad) about one axis.

    Args:
        axis: "x", "y", "z" or three numbers, in the axes the joint sits on.
    """

    axis: Axis = "z"
    type: ClassVar[str] = "cylindrical"
    motions: ClassVar = (("translation", False, "axis"), ("rotation", True, "axis"))


@dataclass(frozen=True, repr=False)
class Universal(Joint):
    """Rotations (rad) about x, then about the moved y."""

    type: ClassVar[str] = "universal"
    motions: ClassVar = (("x", True, "x"), ("y", True, "y"))


@dataclass(frozen=True, repr=False)
class Planar(Joint):
    """Translations (m) along x and y, then a rotation (rad) about z."""

    type: ClassVar[str] = "planar"
    motions: ClassVar = (("x", False, "x"), ("y", False, "y"), ("rotation", True, "z"))


@dataclass(frozen=True, repr=False)
class Spherical(Joint):
    """Ball: q is a unit quaternion (w, x, y, z), v the angular velocity in the link's axes (rad/s). No singularity."""

    type: ClassVar[str] = "spherical"
    ball: ClassVar[bool] = True


@dataclass(frozen=True, repr=False)
class Free(Joint):
    """Six freedoms: a position (m) in the axes the joint sits on, and a unit quaternion.

    q = (x, y, z, w, x, y, z); v = (rate of the position, angular velocity in the link's axes)."""

    type: ClassVar[str] = "free"
    motions: ClassVar = (("x", False, "x"), ("y", False, "y"), ("z", False, "z"))
    ball: ClassVar[bool] = True


@dataclass(frozen=True, repr=False)
class Axes(Joint):
    """Up to six elementary motions, one after the other, singular where two axes meet.

    Args:
        axes: in this order, such as ("tx", "ty", "rz"): translations (m) along and rotations (rad) about the x, y and z
            that the motions before have moved.
    """

    axes: Sequence[str] = ()
    type: ClassVar[str] = "axes"

    def _freedoms(self) -> list[_Freedom]:
        names = (self.axes,) if isinstance(self.axes, str) else self.axes
        if not isinstance(names, (list, tuple)):
            raise ValueError(f"axes = {names!r}: must be a list of motions, such as ['tx', 'rz']")
        names = tuple(names)
        self._set("axes", names)
        for name in names:
            if name not in ("tx", "ty", "tz", "rx", "ry", "rz"):
                raise ValueError(f"axes = {list(names)!r}: {name!r} must be one of tx, ty, tz, rx, ry, rz")
        return [(name, name[0] == "r", UNIT[name[1]]) for name in names]
