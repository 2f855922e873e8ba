"""Contacts: a sphere or a point of an arm that touches a surface, of the world or of another link."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, field
from typing import Annotated, Any, ClassVar

import numpy as np

from ..._check import Array, number
from .beam import Vector
from .joints import Placement
from .part import NotNegative, Part, Place, Positive, read_name
from .strut import WORLD, Point

EXPONENTS = (1.0, 1.5)


@dataclass(frozen=True)
class Surface(Part):
    """The base of surfaces. `_core`: axes (columns, (3, 3)), in those of the point where it is, and sizes (3,)."""

    type: ClassVar[str] = ""
    on: ClassVar[str] = "center"  #: the argument that is its Point
    _core: tuple[Array, Array] = field(init=False, repr=False, compare=False)

    def _made(self) -> tuple[Array, Array]:
        self._set(self.on, Point.of(self.on, getattr(self, self.on)))
        return self._shape()

    def _shape(self) -> tuple[Array, Array]:
        raise NotImplementedError

    def normal_at(self, y: Array) -> Array:
        """The directions (..., 3) away from the surface to points y (..., 3), all in its axes."""
        raise NotImplementedError

    @property
    def at(self) -> Point:
        """The point where it is."""
        found: Point = getattr(self, self.on)
        return found


@dataclass(frozen=True)
class Plane(Surface):
    """A plane that an arm touches, on the side to which the normal points. Behind it all is solid.

    Args:
        point: on the plane: a Point of a link, with which it moves, or of the world; or short, a link (its end),
            (link, at), or (x, y, z), a place in the world (m).
        normal: of any length, in the axes of the point: those of the link's end, origin or slice; of the world.
    """

    point: Point | str | int | Sequence[Any]
    normal: Place = (0.0, 0.0, 1.0)
    type: ClassVar[str] = "plane"
    on: ClassVar[str] = "point"

    def _shape(self) -> tuple[Array, Array]:
        n = np.array(self.normal)
        size = float(np.linalg.norm(n))
        if not size > 0:
            raise ValueError(f"normal = {self.normal}: must not be zero")
        n /= size
        other = np.cross(n, np.eye(3)[np.abs(n).argmin()])
        other /= np.linalg.norm(other)
        return np.column_stack([other, np.cross(n, other), n]), np.zeros(3)

    def normal_at(self, y: Array) -> Array:
        return np.broadcast_to(np.array([0.0, 0.0, 1.0]), y.shape)


@dataclass(frozen=True)
class Sphere(Surface):
    """A ball that an arm touches from outside.

    Args:
        center: a Point of a link, with which it moves, or of the world; or short, as of Plane.
        radius: m.
    """

    center: Point | str | int | Sequence[Any]
    radius: Positive
    type: ClassVar[str] = "sphere"

    def _shape(self) -> tuple[Array, Array]:
        return np.eye(3), np.array([self.radius, 0.0, 0.0])

    def normal_at(self, y: Array) -> Array:
        return _direction(y)


@dataclass(frozen=True)
class Box(Surface):
    """A solid box that an arm touches from outside.

    Args:
        center: a Point of a link, with which it moves, or of the world; or short, as of Plane.
        size: lengths of its edges (m).
        rotation: of the box, in the axes of the point: a rotation vector (rad), or a 3 x 3 matrix, whose columns are
            the directions of the edges.
    """

    center: Point | str | int | Sequence[Any]
    size: Place
    rotation: Vector | Sequence[Vector] = (0.0, 0.0, 0.0)
    type: ClassVar[str] = "box"

    def _shape(self) -> tuple[Array, Array]:
        if not min(self.size) > 0:
            raise ValueError(f"size = {self.size}: must be three lengths above zero")
        turned = Placement(rotation=self.rotation)
        axes = turned._core[1]
        if np.abs(axes.T @ axes - np.eye(3)).max() > 1e-9 or np.linalg.det(axes) < 0:
            raise ValueError(f"rotation = {self.rotation}: is no rotation")
        self._set("rotation", turned.rotation)
        return axes, np.array(self.size)

    def normal_at(self, y: Array) -> Array:
        beyond, side = np.abs(y) - 0.5 * np.array(self.size), np.where(y < 0.0, -1.0, 1.0)
        a, b, c = np.moveaxis(beyond, -1, 0)
        x, y = (a > b) & (a > c), b > c
        nearest = side * np.stack([x, y & np.logical_not(x), np.logical_not(x | y)], axis=-1)  # of its faces
        inside = beyond.max(axis=-1, keepdims=True) <= 0.0
        return np.where(inside, nearest, _direction(side * np.maximum(beyond, 0.0)))


def _direction(y: Array) -> Array:
    return np.asarray(y / np.maximum(np.linalg.norm(y, axis=-1, keepdims=True), 1e-300))


def _exponent(name: str, value: Any) -> float:
    found = number(name, value)
    if found not in EXPONENTS:
        raise ValueError(f"{name} = {found:g}: must be 1, or 1.5, that of Hertz")
    return found


@dataclass(frozen=True)
class Contact(Part):
    """A sphere, or a point, of the arm that touches a surface: of the world, or of another link.

    The gap is their distance (m), and where it is below zero, the depth d is its negative. There the surface pushes
    with the force stiffness d^exponent (1 + damping dd/dt) along its normal, but never pulls (Hunt & Crossley 1975).
    Friction is that of bristles: they bend by the distance z (m) that the sphere has moved along the surface since it
    touched, and hold it with tangential_stiffness z and a damping, up to `coulomb` times the normal force. Beyond that
    it slides. The sphere may roll and spin.

    Args:
        point: the centre of the sphere: a Point of a link; or short, a link (its end), or (link, at).
        against: the surface: a Plane, a Sphere or a Box.
        radius: of the sphere (m); 0: a point.
        stiffness: N/m; with the exponent 1.5, N/m^1.5.
        damping: s/m. Where a body of no other forces hits at the speed v, it leaves at about v (1 - 2/3 damping v).
        coulomb: friction over normal force; 0: no friction. It depends on the past of a run, and acts in all time
            integration. Functions of one instant (`forward_dynamics`, `equilibrium`) have bristles that are not bent:
            where it touches, there is their damping, and, in linear models and modes, their stiffness. Derivatives of
            runs, KalmanFilter, MPC, invert, plan_move and economize refuse it.
        exponent: 1, or 1.5, that of Hertz, of round bodies.
        tangential_stiffness: of the bristles (N/m); None: `stiffness`, where the exponent is 1.
        name: such as "toe", in place of "contact 0" and so on, by its number in the arm. No dots, no number; different
            from the names of the arm's links, joints and struts.
    """

    point: Point | str | int | Sequence[Any]
    against: Plane | Sphere | Box
    _: KW_ONLY
    radius: NotNegative = 0.0
    stiffness: Positive
    damping: NotNegative = 0.0
    coulomb: NotNegative = 0.0
    exponent: Annotated[float, _exponent] = 1.0
    tangential_stiffness: Positive | None = None
    name: str | None = None

    def _made(self) -> None:
        read_name(self.name)
        self._set("point", Point.of("point", self.point))
        assert isinstance(self.point, Point)
        if self.point.link == WORLD:
            raise ValueError("point: is one of the world; it must be on a link, and `against` may be in the world")
        if self.coulomb and self.exponent != 1.0 and self.tangential_stiffness is None:
            raise ValueError(
                f"tangential_stiffness = None: must be given (N/m) for friction with exponent = {self.exponent:g}"
            )

    @property
    def bristles(self) -> float:
        """Their stiffness (N/m); 0 without friction."""
        own: float = self.stiffness if self.tangential_stiffness is None else self.tangential_stiffness
        return own if self.coulomb else 0.0
