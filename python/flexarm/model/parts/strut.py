"""Struts and tendons: forces along the straight lines between points of an arm and of the world."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Any, ClassVar

from ..._check import choice, finite_number, plain
from .part import Finite, NotNegative, Part, Place, Positive, read_name

WORLD = "world"
PLACES = ("end", "origin")


@dataclass(frozen=True)
class Point(Part):
    """A point of a link or of the world: of a strut, a tendon, a contact or a surface.

    Args:
        link: the link: its name, or its number from 0 at the base; or "world".
        at: "end": where the next joint sits, the default; "origin": the link's own frame, where its joint is; or a
            slice of its beam, by its place (m from the clamp). Left out for the world.
        offset: from there (m), in the axes of that frame or slice, with which it turns; for the world, the place.
    """

    link: str | int
    at: str | float | None = None
    offset: Place = (0.0, 0.0, 0.0)

    def _made(self) -> None:
        link, at = self.link, self.at
        if isinstance(link, bool) or not isinstance(link, (str, int)) or (isinstance(link, int) and link < 0):
            raise ValueError(f"link = {link!r}: must be the name of a link, its number from 0, or 'world'")
        if link == WORLD:
            if at is not None:
                raise ValueError(f"at = {at!r}: must be left out for the world; `offset` is the place in its axes")
        elif at is None or isinstance(at, str):
            self._set("at", choice("at", "end" if at is None else at, PLACES))
        else:
            self._set("at", finite_number("at", at))

    @staticmethod
    def of(field: str, value: Any) -> Point:
        """A Point, also of its short forms: a link, (link, at), or three numbers, a place in the world."""
        if isinstance(value, Point):
            return value
        value = plain(value)
        try:
            if isinstance(value, (str, int)):
                return Point(value)
            if isinstance(value, (list, tuple)) and len(value) == 2:
                return Point(*value)
            if isinstance(value, (list, tuple)) and len(value) == 3:
                return Point(WORLD, offset=value)
        except ValueError as e:
            raise ValueError(f"{field}: {e}") from None
        raise ValueError(
            f"{field} = {value!r}: must be a Point, a link, (link, at), or three numbers, a place in the world"
        )


@dataclass(frozen=True)
class Strut(Part):
    """A straight line between two points with a force along it: a cylinder, a spring, a strut.

    It pushes its points apart with force - stiffness (l - length) - damping dl/dt, where l is their distance (m).

    Args:
        a, b: its points: a Point; or short, a link (its end), (link, at), or (x, y, z), a place in the world (m).
        stiffness: N/m. damping: N s/m.
        length: at which the spring has no force (m); None: its length where all coordinates of the arm are zero.
        force: constant, with which it pushes (N); negative: it pulls. `simulate(drive={name: Torque(...)})` adds to it.
        name: such as "lift", in place of "strut 0" and so on, by its number in the arm. No dots, no number; different
            from the names of the arm's links and joints.
        mass: of a cylinder's rod (kg), a point at b, which slides in a tube without mass. The cylinder is a link of the
            arm then, of this name, whose joint is its length (m): motions, torques, controllers and sensors take it as
            any joint. A loop ties the rod to b. None: a line without mass.
    """

    a: Point | str | int | Sequence[Any]
    b: Point | str | int | Sequence[Any]
    _: KW_ONLY
    stiffness: NotNegative = 0.0
    damping: NotNegative = 0.0
    length: NotNegative | None = None
    force: Finite = 0.0
    name: str | None = None
    mass: Positive | None = None
    tension_only: ClassVar[bool] = False
    sense: ClassVar[float] = 1.0  #: of a driven force: it pushes

    def _made(self) -> None:
        read_name(self.name)
        self._set("a", Point.of("a", self.a))
        self._set("b", Point.of("b", self.b))
        if self.mass is not None and self.name is None:
            raise ValueError(f"mass = {self.mass:g}: a cylinder needs a name, by which it is driven")

    @property
    def points(self) -> tuple[Any, ...]:
        """`a` and `b`."""
        return self.a, self.b


@dataclass(frozen=True)
class Tendon(Part):
    """A massless line that runs straight from point to point and pulls: a rope, a cable, a muscle.

    It slides through its inner points without friction. Its length l is the sum of its pieces, and its tension is
    tension + stiffness (l - length) + damping dl/dt.

    Args:
        points: two or more, from end to end: each a Point; or short, a link (its end), (link, at), or (x, y, z), a
            place in the world (m).
        stiffness: N/m. damping: N s/m.
        length: at which the spring has no force (m); None: its length where all coordinates of the arm are zero.
        tension: constant (N). `simulate(drive={name: Torque(...)})` adds to it.
        tension_only: a rope: spring and damper have no force where it is shorter than `length`, and the whole tension
            is never below zero. The damper sets in over the first millimetre beyond. False: it pushes as well.
        name: such as "cable", in place of "strut 0" and so on, by its number in the arm. No dots, no number; different
            from the names of the arm's links and joints.
    """

    points: Sequence[Point | str | int | Sequence[Any]]
    _: KW_ONLY
    stiffness: NotNegative
    damping: NotNegative = 0.0
    length: NotNegative | None = None
    tension: Finite = 0.0
    tension_only: bool = True
    name: str | None = None
    sense: ClassVar[float] = -1.0
    mass: ClassVar[None] = None

    def _made(self) -> None:
        read_name(self.name)
        if not isinstance(self.points, (list, tuple)) or len(self.points) < 2:
            raise ValueError(f"points = {self.points!r}: must be two or more points")
        self._set("points", tuple(Point.of(f"points[{k}]", p) for k, p in enumerate(self.points)))

    @property
    def force(self) -> float:
        """The constant force with which it pushes (N), as of a Strut: -tension."""
        return -self.tension
