"""The chain: an immutable series or tree of links, its indices, and its kinematics."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from copyreg import __newobj__  # type: ignore[attr-defined]
from difflib import get_close_matches
from itertools import pairwise
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

import flexarm._core as _core

from ..._check import Array, array, batch, finite, instances, mapping, number
from .beam import Beam
from .contact import Contact
from .cylinder import cylinders, stretched, tie, tube
from .link import Link
from .loop import Loop
from .part import as_table
from .strut import WORLD, Point, Strut, Tendon

_Kind = TypeVar("_Kind", bound="Chain")
_LEAST = 1e-9  # m: a strut that is shorter has no direction
_Fastened = tuple[int, str, float, Array]  # link, "origin", "end" or "slice", its place (m), offset (m)


def _numbers(links: Sequence[Link]) -> dict[str, tuple[int, ...]]:
    """Indices of the links with each name, where a link may have its own name or its joint's."""
    out: dict[str, tuple[int, ...]] = {}
    for owner in ("link", "joint"):
        own: dict[str, int] = {}
        for k, link in enumerate(links):
            name = (link if owner == "link" else link.joint).name
            if name is None:
                continue
            if name in own:
                raise ValueError(f"links[{k}]: its {owner} is called '{name}', as is that of link {own[name]}")
            own[name] = k
            if k not in out.get(name, ()):
                out[name] = (*out.get(name, ()), k)
    return out


def _found(given: Any, field: str, names: Sequence[str], none: str) -> int:
    """The index of an item, given by its number or its name."""
    n = len(names)
    if isinstance(given, str) and given in names:
        return names.index(given)
    if isinstance(given, str) or not n:
        known = f"there are {', '.join(names)}" if n else "the arm has none"
        raise ValueError(f"{field} = {given!r}: {none} has this name; {known}")
    if isinstance(given, bool) or not isinstance(given, (int, np.integer)) or not -n <= given < n:
        raise ValueError(f"{field} = {given!r}: must be from {-n} to {n - 1}, or a name")
    return int(given) % n


def _alike(x: Link, y: Link) -> bool:
    """Whether links have the same names and coordinates."""
    counts = [link.beam.counts if link.beam is not None else {} for link in (x, y)]
    return (x.name, x.joint.name, x.joint.type, x.joint.labels, x.parent, x.at, counts[0]) == (
        y.name, y.joint.name, y.joint.type, y.joint.labels, y.parent, y.at, counts[1]
    )  # fmt: skip


def _quaternion(turn: Array) -> Array:
    """w, x, y, z of a rotation vector (rad)."""
    half = 0.5 * float(np.linalg.norm(turn))
    return np.array([np.cos(half), *(0.5 * np.sinc(half / np.pi) * turn)])


class Parts(NamedTuple):
    """The arguments of a chain, by their names in files and in the paths of parameters."""

    link: Sequence[Link]
    gravity: Sequence[float]
    strut: Sequence[Strut | Tendon]
    contact: Sequence[Contact]
    loop: Sequence[Loop]


class Chain:
    """The data of an arm: its links, gravity, struts, contacts and loops, the indices of its coordinates, its slices
    and their motion. Links are a chain, or a tree: see `parents`.

    Rooms below `arm` take a Chain instead of an `Arm`. Shapes and conventions are those of `flexarm.Arm`: links
    count from 0 at the base; -1 is the last, and the default.
    """

    links: tuple[Link, ...]

    def __init__(
        self,
        links: Sequence[Link],
        gravity: Sequence[float] = (0.0, 0.0, 0.0),
        struts: Sequence[Strut | Tendon] = (),
        contacts: Sequence[Contact] = (),
        loops: Sequence[Loop] = (),
    ) -> None:
        self.links: tuple[Link, ...] = instances("links", links, Link, "links")
        self.gravity: tuple[float, ...] = tuple(array("gravity", gravity, (3,)).tolist())
        lines = instances("struts", struts, (Strut, Tendon), "Strut and Tendon")
        #: struts, then tendons, as files have them, by number
        self.struts: tuple[Strut | Tendon, ...] = tuple(sorted(lines, key=lambda x: isinstance(x, Tendon)))
        self.contacts: tuple[Contact, ...] = instances("contacts", contacts, Contact, "contacts")  #: by number
        self.loops: tuple[Loop, ...] = instances("loops", loops, Loop, "loops")  #: by number
        self._name()
        self._make()
        if len(self._tubes) < len(self._rods):
            more, ties = cylinders(self)
            self.links, self.loops = (*self.links, *more), (*self.loops, *ties)
            self._name()
            self._make()

    def _name(self) -> None:
        self._numbers = numbers = _numbers(self.links)
        #: names of the struts that are cylinders, and of the loops that close them
        self._rods: list[str] = [s.name for s in self.struts if s.mass is not None and s.name is not None]
        self._ties: list[str] = [tie(name) for name in self._rods]
        #: numbers of the links that are tubes of cylinders, each ahead of its rod
        self._tubes: list[int] = [k for x in self._rods if x in numbers for k in numbers.get(tube(x), ())]
        #: how many links it was given; those of cylinders follow them
        self._own: int = min(self._tubes, default=len(self.links))
        #: name of each strut and tendon: its own, or "strut 0" and so on
        self.strut_names: tuple[str, ...] = tuple(s.name or f"strut {k}" for k, s in enumerate(self.struts))
        #: name of each contact: its own, or "contact 0" and so on
        self.contact_names: tuple[str, ...] = tuple(c.name or f"contact {k}" for k, c in enumerate(self.contacts))
        #: name of each loop: its own, or "loop 0" and so on
        self.loop_names: tuple[str, ...] = tuple(x.name or f"loop {k}" for k, x in enumerate(self.loops))
        #: number of the link on which each link sits; -1: the world
        self.parents: tuple[int, ...] = tuple(self._parent(k, link.parent) for k, link in enumerate(self.links))
        own = [link.joint.name if self._numbers.get(link.joint.name or "") == (k,) else None
               for k, link in enumerate(self.links)]  # fmt: skip
        #: name of each link: its own, or its joint's (if no other link has that), or "link 0" and so on
        self.names: tuple[str, ...] = tuple(
            link.name or joint or f"link {k}" for k, (link, joint) in enumerate(zip(self.links, own, strict=True))
        )
        #: name of each link's joint: its own (if no other link has that), or the link's name and the joint's type
        self.joint_names: tuple[str, ...] = tuple(
            joint or f"{self.names[k]} {self.links[k].joint.type}" for k, joint in enumerate(own)
        )
        self.coordinates: tuple[str, ...] = self._labels()
        #: number of the link on which each link sits, -1: the world; and where along its beam (m), None: on its end
        self.seats: tuple[tuple[int, float | None], ...] = tuple(
            (n, self._at(k, n, link.at)) for k, (n, link) in enumerate(zip(self.parents, self.links, strict=True))
        )

        known = {*self._numbers, *self.names, *self.joint_names}.difference(self._rods if self._tubes else ())
        taken = dict.fromkeys(known, "a link or a joint")
        for group, names, one in (
            ("struts", self.strut_names, "a strut"), ("contacts", self.contact_names, "a contact"),
            ("loops", self.loop_names, "a loop"),
        ):  # fmt: skip
            for k, name in enumerate(names):
                if name in names[:k]:
                    other = f"{group}[{names.index(name)}], too"
                    raise ValueError(f"{group}[{k}]: name = '{name}': is that of {other}; take another")
                if name in taken:
                    raise ValueError(f"{group}[{k}]: name = '{name}': is that of {taken[name]}; take another")
            taken |= dict.fromkeys(names, one)

    def _make(self) -> None:
        self._fastened = [self._line(f"struts[{k}]", s) for k, s in enumerate(self.struts)]
        self._touching = [self._touch(f"contacts[{k}]", c) for k, c in enumerate(self.contacts)]
        self._closing = [self._close(f"loops[{k}]", x) for k, x in enumerate(self.loops)]
        #: length at which the spring of each strut and tendon has no force (m)
        self.rest_lengths: tuple[float, ...] = tuple(0.0 if s.length is None else s.length for s in self.struts)
        self._core = self._core_arm()
        self._zero = np.array(self._core.zero)
        if any(s.length is None or s.mass is not None for s in self.struts):
            still, undriven = np.zeros(self._core.nv), np.zeros(len(self.struts))
            at_zero = self._core.strut_motion(self._core.zero, still, undriven)[0][:, 0].tolist()
            for k, s in enumerate(self.struts):
                if s.length is None and not at_zero[k] > _LEAST:
                    raise ValueError(f"struts[{k}]: length = None: is zero at q = zero; give the spring's length (m)")
            lengths = zip(self.struts, at_zero, strict=True)
            self.rest_lengths = tuple(x if s.length is None else s.length for s, x in lengths)
            self._core = self._core_arm()
            for k, s in enumerate(self.struts):
                if s.mass is not None and self._tubes:
                    self._zero[self._core.first_q(self._link(s.name))] = at_zero[k]
        self.nq: int = self._core.nq
        self.nv: int = self._core.nv
        self.patch_matrix: Array = self._core.patch_matrix()  #: generalised forces per volt (Eq. 61), (nv, n_patches)
        self.patch_matrix.flags.writeable = False
        self.patches: list[tuple[int, int]] = [
            (k, i) for k, link in enumerate(self.links) if link.beam for i in range(len(link.beam.patches))
        ]  #: (link, patch) of each column of patch_matrix

    def _core_arm(self) -> _core.Arm:
        made = zip(self.struts, self._fastened, self.rest_lengths, strict=True)
        struts = [_core.Strut(points, s.stiffness, s.damping, x, s.force, s.tension_only) for s, points, x in made]
        contacts = [
            _core.Contact(point, c.radius, c.against.type, on, *c.against._core, c.stiffness, c.exponent, c.damping,
                          c.coulomb, c.bristles)
            for c, (point, on) in zip(self.contacts, self._touching, strict=True)
        ]  # fmt: skip
        loops = [
            _core.Loop(a, b, x.joint.type, x._core[0][1], x._core[1][1],
                       *(np.inf if x.stiffness is None else x.stiffness, x.damping),
                       *(np.inf if x.angular_stiffness is None else x.angular_stiffness, x.angular_damping))
            for x, (a, b) in zip(self.loops, self._closing, strict=True)
        ]  # fmt: skip
        with self.naming():
            return _core.Arm([link._core for link in self.links], self.gravity, self.seats, struts, contacts, loops)

    def _fasten(self, field: str, points: Mapping[str, Any], fault: str) -> list[_Fastened]:
        """Points, by their names, as the core takes them. ValueError, with this `fault`, where all sit on one rigid
        body."""
        found = [self._fasten_point(f"{field}: {name}", p) for name, p in points.items()]
        if len({self._body(*point[:3]) for point in found}) == 1:
            raise ValueError(f"{field}: {fault}")
        return found

    def _line(self, field: str, strut: Strut | Tendon) -> list[_Fastened]:
        """The points of a strut."""
        names = ("a", "b") if isinstance(strut, Strut) else [f"points[{i}]" for i in range(len(strut.points))]
        fault = "all its points sit on one rigid body, so that its length cannot change"
        points = self._fasten(field, dict(zip(names, strut.points, strict=True)), fault)
        for i, (here, there) in enumerate(pairwise(points)):
            if here[:3] == there[:3] and np.array_equal(here[3], there[3]):
                raise ValueError(f"{field}: {names[i]} and {names[i + 1]} are one point; give different ones")
        return points

    def _touch(self, field: str, contact: Contact) -> list[_Fastened]:
        """The point of a contact and that of its surface."""
        surface = contact.against
        fault = "its point and its surface sit on one rigid body, so that the gap cannot change"
        return self._fasten(field, {"point": contact.point, f"against.{surface.on}": surface.at}, fault)

    def _close(self, field: str, loop: Loop) -> list[_Fastened]:
        """The origins of a loop's frames."""
        fault = "both its places sit on one rigid body, so that it closes nothing"
        sides = self._fasten(field, {"a": loop.a, "b": loop.b}, fault)
        pairs = zip(sides, loop._core, strict=True)
        return [(link, on, x, offset + origin) for (link, on, x, offset), (origin, _) in pairs]

    def _fasten_point(self, field: str, point: Point) -> _Fastened:
        offset = np.array(point.offset)
        if point.link == WORLD:
            if WORLD in self._numbers:
                raise ValueError(f"{field}.link = 'world': is the name of a link, too; give that another name")
            return -1, "end", 0.0, offset
        k = self._link(point.link, f"{field}.link")
        if isinstance(point.at, str):
            return k, point.at, 0.0, offset
        beam, x = self.links[k].beam, float(point.at or 0.0)
        if beam is None:
            raise ValueError(f"{field}.at = {x:g}: must be 'end' or 'origin': {self.names[k]} has no beam")
        if not 0.0 <= x <= beam.length:
            where = f"0 to {beam.length:g} m, along the beam of {self.names[k]}"
            raise ValueError(f"{field}.at = {x:g}: must be from {where}")
        return k, "slice", x, offset

    def _body(self, link: int, on: str, x: float) -> Any:
        """A key of the rigid body on which a point sits, equal for all points of the body."""
        if link < 0:
            return -1
        beam = self.links[link].beam
        bends = beam is not None and beam.ne > 0
        if bends and beam is not None and (on == "end" or x > 0.0):
            return link, beam.length if on == "end" else x
        if not self.links[link].joint.nv:  # it is one body with its parent
            parent, at = self.seats[link]
            return self._body(parent, "end" if at is None else "slice", at or 0.0)
        return link, 0.0

    @property
    def _parts(self) -> Parts:
        """All that it is made of."""
        return Parts(self.links, self.gravity, self.struts, self.contacts, self.loops)

    def to_dict(self) -> dict[str, Any]:
        """The inverse of `from_dict`."""
        own = self.links[: self._own]
        out: dict[str, Any] = {"gravity": as_table(self.gravity), "link": [link.to_dict() for link in own]}
        for kind, name in ((Strut, "strut"), (Tendon, "tendon")):
            if found := [s.to_dict() for s in self.struts if isinstance(s, kind)]:
                out[name] = found
        loops = tuple(x for x in self.loops if x.name not in self._ties)
        return out | {k: as_table(x) for k, x in (("contact", self.contacts), ("loop", loops)) if x}

    def _alike(
        self: _Kind,
        links: Sequence[Link],
        gravity: Sequence[float] = (0.0, 0.0, 0.0),
        struts: Sequence[Strut | Tendon] | None = None,
        contacts: Sequence[Contact] | None = None,
        loops: Sequence[Loop] | None = None,
    ) -> _Kind:
        """An arm of the same class, with the same struts, contacts and loops (if None); a subclass's own `__init__`,
        which may take other arguments, is not called."""
        out = type(self).__new__(type(self))
        given = ((struts, self.struts), (contacts, self.contacts), (loops, self.loops))
        Chain.__init__(out, links, gravity, *(own if x is None else x for x, own in given))  # type: ignore[arg-type]
        return out

    @classmethod
    def _varied(cls: type[_Kind], of: Chain, parts: Parts) -> _Kind:
        """An arm with other numbers than `of`: it takes the names from there, if its links have the same."""
        links, gravity, struts, contacts, loops = parts
        if of._tubes:  # cylinders follow their struts
            mine = [*zip(links[of._own :], of.links[of._own :], strict=True)]
            ties: Any = [(x, y) for x, y in zip(loops, of.loops, strict=True) if y.name in of._ties]
            for x, y in (*mine, *ties):
                if x is not y:
                    raise ValueError(f"'{y.name}': is of a cylinder; change its strut")
            kept = [x for x in loops if x.name not in of._ties]
            return of._alike(links[: of._own], gravity, struts, contacts, kept)  # type: ignore[return-value]
        if len(links) != len(of.links) or not all(x is y or _alike(x, y) for x, y in zip(links, of.links, strict=True)):
            return cls(*parts)
        out = cls.__new__(cls)
        out.links, out.gravity = tuple(links), tuple(array("gravity", gravity, (3,)).tolist())
        out.struts, out.strut_names = tuple(struts), of.strut_names
        out.contacts, out.contact_names = tuple(contacts), of.contact_names
        out.loops, out.loop_names = tuple(loops), of.loop_names
        out._numbers, out.names, out.joint_names = of._numbers, of.names, of.joint_names
        out.coordinates, out.parents = of.coordinates, of.parents
        out._rods, out._ties, out._tubes, out._own = [], [], [], of._own
        out.seats = tuple((parent, out._at(k, parent, x)) for k, (parent, x) in enumerate(of.seats))
        out._make()
        return out

    def __reduce__(self) -> Any:
        return __newobj__, (type(self),), tuple(self._parts)

    def __setstate__(self, state: Any) -> None:
        Chain.__init__(self, *state)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Chain) and self._parts == other._parts

    __hash__ = None  # type: ignore[assignment]  # beams hold dictionaries

    def __repr__(self) -> str:
        many = {"struts": self.struts, "contacts": self.contacts, "loops": self.loops}
        counted = f"{len(self.links)} links, " + "".join(f"{len(x)} {name}, " for name, x in many.items() if x)
        return f"{type(self).__name__}({counted}{self.nv} coordinates: {', '.join(self.coordinates)})"

    def __getitem__(self, link: Any) -> Link:
        """The link of a name (its own or its joint's) or a number."""
        return self.links[self._link(link)]

    def __iter__(self) -> Iterator[Link]:
        return iter(self.links)

    def _labels(self) -> tuple[str, ...]:
        """A label per rate, such as "elbow" and "forearm bending_y 1"."""
        out: dict[str, int] = {}
        for k, link in enumerate(self.links):
            labels = [self.joint_names[k] + label.removeprefix(link.joint.type) for label in link.joint.labels]
            counts = link.beam.counts if link.beam is not None else {}
            labels += [f"{self.names[k]} {s} {i + 1}" for s in _core.STRAINS for i in range(counts.get(s, 0))]
            for label in labels:
                if label in out:
                    other = f"a coordinate of link {out[label]}, too"
                    raise ValueError(f"links[{k}]: '{label}' is {other}; take other names")
                out[label] = k
        return tuple(out)

    def in_names(self, text: str) -> str:
        """A message of the core, with names in place of the numbers of coordinates, links and loops."""

        def coordinate(m: re.Match[str]) -> str:
            k, rest = int(m[1]), m[2]
            kind = self.links[k].joint.type
            joint = rest == kind or rest.startswith(f"{kind} ")
            return f"'{self.joint_names[k]}{rest.removeprefix(kind)}'" if joint else f"'{self.names[k]} {rest}'"

        for k, name in enumerate(self.loop_names):
            text = text.replace(f"loop [{k}]", f"loop '{name}'")
        text = re.sub(r"'link (\d+) ([^']*)'", coordinate, text)
        return re.sub(r"(?<=beam of )link (\d+)", lambda m: self.names[int(m[1])], text)

    @contextmanager
    def naming(self) -> Iterator[None]:
        """Puts these names into the core's errors."""
        try:
            yield
        except ValueError as e:
            raise ValueError(self.in_names(str(e))) from None

    def _link(self, link: Any, field: str = "link") -> int:
        """The index of a link, given by its number, its name or its joint's; -1 is the last that is no cylinder. Only
        this function reads links."""
        n, own = len(self.links), self._own
        if isinstance(link, str):
            found = self._numbers.get(link, ())
            if len(found) == 1:
                return found[0]
            if found:
                two = f"is link {found[0]} and the joint of link {found[1]}"
                raise ValueError(f"{field} = {link!r}: {two}; give a number")
            others = (("strut", self.strut_names), ("contact", self.contact_names), ("loop", self.loop_names))
            for kind, names in others:
                if link in names:
                    hint = "; a strut with a mass is one: fa.Strut(..., mass=...)" if kind == "strut" else ""
                    raise ValueError(f"{field} = {link!r}: is a {kind}; it must be a link or a joint{hint}")
            known = ", ".join(self._numbers)
            near = get_close_matches(link, self._numbers, n=1)
            hint = f"did you mean '{near[0]}'?" if near else f"there are {known}" if known else "none has a name"
            raise ValueError(f"{field} = {link!r}: no link and no joint has this name; {hint}")
        if isinstance(link, bool) or not isinstance(link, (int, np.integer)) or not -own <= link < n:
            raise ValueError(f"{field} = {link!r}: must be from {-own} to {n - 1}")
        return int(link) + (own if link < 0 else 0)

    def _strut(self, strut: Any, field: str = "strut") -> int:
        """The index of a strut or tendon, given by its number or its name."""
        return _found(strut, field, self.strut_names, "no strut and no tendon")

    def _contact(self, contact: Any, field: str = "contact") -> int:
        """The index of a contact, given by its number or its name."""
        return _found(contact, field, self.contact_names, "no contact")

    def _loop(self, loop: Any, field: str = "loop") -> int:
        """The index of a loop, given by its number or its name."""
        return _found(loop, field, self.loop_names, "no loop")

    def _parent(self, k: int, parent: str | int | None) -> int:
        """The number of the link that link k sits on; -1: the world."""
        field = f"links[{k}]: parent"
        if parent == "world" and parent in self._numbers:
            raise ValueError(f"{field} = 'world': is the name of a link, too; give that another name")
        if parent is None or parent == "world":
            return k - 1 if parent is None else -1
        n = self._link(parent, field) if isinstance(parent, str) else parent
        if not 0 <= n < k:
            right = "a link before this one, or 'world'" if k else "None or 'world', as this is the first link"
            raise ValueError(f"{field} = {parent!r}: must be {right}")
        return n

    def _at(self, k: int, parent: int, at: float | None) -> float | None:
        """The place along its parent's beam of link k, which sits on link `parent`."""
        if at is None:
            return None
        field, beam = f"links[{k}]: at = {at:g}", self.links[parent].beam if parent >= 0 else None
        if beam is None:
            on = f"parent '{self.names[parent]}' has no beam" if parent >= 0 else "world has no beam"
            raise ValueError(f"{field}: its {on}; the inboard placement of its joint tells where it sits there")
        if not 0 < at <= beam.length:
            right = f"above 0 and up to its length, {beam.length:g} m"
            raise ValueError(f"{field}: must be on the beam of its parent '{self.names[parent]}', {right}")
        return at

    @property
    def is_chain(self) -> bool:
        """Whether every link sits on the end of the one before it."""
        return self.seats == tuple((k, None) for k in range(-1, len(self.links) - 1))

    def children(self, link: int | str = -1) -> list[int]:
        """The links that sit on a link: on its end, or on slices of its beam."""
        n = self._link(link)
        return [k for k, parent in enumerate(self.parents) if parent == n]

    @property
    def ends(self) -> list[int]:
        """The links that carry no other one on their end: the last one of a chain."""
        return [k for k in range(self._own) if (k, None) not in self.seats[: self._own]]

    def path(self, link: int | str = -1) -> list[int]:
        """The links from the world to this one."""
        out = [self._link(link)]
        while self.parents[out[-1]] >= 0:
            out.append(self.parents[out[-1]])
        return out[::-1]

    def carried(self, link: int | str = -1) -> list[int]:
        """The links that sit on a link, those on them, and so on, in the order of the list."""
        out, n = [], self._link(link)
        seen = {n}
        for k in range(n + 1, len(self.links)):
            if self.parents[k] in seen:
                seen.add(k)
                out.append(k)
        return out

    def longest(self, sizes: Sequence[float]) -> float:
        """The largest sum of numbers >= 0 of the links, one of each, along the way from the world to an end."""
        sums: list[float] = []
        for size, parent in zip(sizes, self.parents, strict=True):
            sums.append(size if parent < 0 else sums[parent] + size)
        return max(sums, default=0.0)

    @property
    def beam_reach(self) -> float:
        """The largest length of beams along the way from the world to an end (m)."""
        return self.longest([link.beam.length if link.beam is not None else 0.0 for link in self.links])

    def end_places(self, q: ArrayLike) -> Array:
        """Positions (..., n, 3) of all `ends` in the world (m)."""
        return np.stack([self.frame(q, k)[0] for k in self.ends], axis=-2)

    def joint_rates(self, link: Any, field: str = "link") -> list[int]:
        """Indices in v of the rates of a link's joint, or of one of them if `link` is (link, freedom); `field` is the
        argument's name in errors."""
        name, freedom = link if isinstance(link, tuple) and len(link) == 2 else (link, None)
        n = self._link(name, field)
        nv = self.links[n].joint.nv
        if nv == 0:
            raise ValueError(f"{field} = {link}: its joint is fixed, it has no coordinate")
        if freedom is None:
            return list(range(self._core.first(n), self._core.first(n) + nv))
        if isinstance(freedom, bool) or not isinstance(freedom, (int, np.integer)) or not 0 <= freedom < nv:
            raise ValueError(f"{field} = {link}: its joint has freedoms 0 to {nv - 1}")
        return [self._core.first(n) + int(freedom)]

    def joint_rate(self, link: Any, field: str = "link") -> int:
        """The index of one rate, given by a link whose joint has one freedom, or by (link, freedom)."""
        rates = self.joint_rates(link, field)
        if len(rates) > 1:
            raise ValueError(f"{field} = {link}: its joint has {len(rates)} freedoms; name one as ({link}, 0)")
        return rates[0]

    def by_rate(self, field: str, keyed: Mapping[Any, Any] | None) -> dict[int, Any]:
        """The values of `keyed` by index of the rate instead of by link or (link, freedom)."""
        out: dict[int, Any] = {}
        for link, value in mapping(field, keyed, ", by link number or name").items():
            i = self.joint_rate(link, f"{field}: link")
            if i in out:
                raise ValueError(f"{field}: link = {link}: is named twice")
            out[i] = value
        return out

    def coordinate_of(self, rate: int) -> int:
        """Index in q of the coordinate whose rate has index `rate` in v; -1 for the rates of a ball."""
        return self._core.coordinate_of(rate)

    @property
    def q_names(self) -> tuple[str, ...]:
        """A label for each coordinate of q: as `coordinates`, and the components of quaternions; (nq,)."""
        names = [""] * self.nq
        for i, label in enumerate(self.coordinates):
            if self.coordinate_of(i) >= 0:
                names[self.coordinate_of(i)] = label
        for k, at in self.quaternions():
            names[at] = [f"{self.joint_names[k]} quaternion {c}" for c in "wxyz"]
        return tuple(names)

    def quaternions(self) -> list[tuple[int, slice]]:
        """The links with a ball in their joint, each with the slice of q that holds its quaternion (w, x, y, z)."""
        ends = [self._core.first_q(k) + link.joint.nq for k, link in enumerate(self.links)]
        return [(k, slice(end - 4, end)) for k, end in enumerate(ends) if self.links[k].joint.ball]

    def ball_rates(self) -> list[tuple[int, slice]]:
        """The links with a ball in their joint, each with the slice of v that holds its three rates."""
        ends = [self._core.first(k) + link.joint.nv for k, link in enumerate(self.links)]
        return [(k, slice(end - 3, end)) for k, end in enumerate(ends) if self.links[k].joint.ball]

    def beams(self) -> Iterator[tuple[int, Beam, slice, slice]]:
        """The beams with elastic coordinates: each one's link, itself, and the slices of q and of v that hold them."""
        for k, link in enumerate(self.links):
            if link.beam is not None and link.beam.ne:
                at_q, at_v = self._core.first_q(k) + link.joint.nq, self._core.first(k) + link.joint.nv
                yield k, link.beam, slice(at_q, at_q + link.beam.ne), slice(at_v, at_v + link.beam.ne)

    @property
    def movable(self) -> list[int]:
        """The links whose joints have freedoms."""
        return [k for k, link in enumerate(self.links) if link.joint.nv]

    @property
    def freedoms(self) -> list[int]:
        """The indices in v of all joints' rates, from the base on."""
        return [i for k in self.movable for i in self.joint_rates(k)]

    @property
    def zero(self) -> Array:
        """All coordinates zero, except the quaternions of balls, 1 0 0 0, and the lengths of cylinders, which are those
        of this place; (nq,)."""
        return self._zero.copy()

    def patch_column(self, link: Any, patch: Any, field: str = "") -> int:
        """The column of `patch_matrix` that belongs to a link's patch."""
        n = self._link(link, f"{field}link")
        beam = self.links[n].beam
        count = len(beam.patches) if beam else 0
        if not count:
            raise ValueError(f"{field}link = {link}: has no patches")
        if isinstance(patch, bool) or not isinstance(patch, (int, np.integer)) or not -count <= patch < count:
            whose = f"the patches of {self.names[n]}"
            raise ValueError(f"{field}patch = {patch!r}: must be from {-count} to {count - 1}, {whose}")
        return self.patches.index((n, int(patch) % count))

    def pose(self, joints: Mapping[Any, Any]) -> Array:
        """q (nq,) with the named joints at the given values, and all other coordinates as in `zero`; cylinders that are
        not named are where their points are.

        The dictionary itself may stand for q in all methods, and for q0 in `simulate`.

        Args:
            joints: by link: its number, its name or its joint's; or by (link, freedom). The value is a number (rad, m);
                of a joint with several freedoms a list, in which a ball's turn is a rotation vector (rad), three
                numbers, or a quaternion w, x, y, z. {"elbow": 0.3, 0: -1.0}

        Raises:
            ValueError: an unknown name, a joint named twice, too few or too many numbers.
        """
        q, seen = self.zero, set[int]()
        for link, value in mapping("joints", joints, ", by link number or name, such as {0: 0.3}").items():
            rates = self.joint_rates(link, "joints: link")
            if not seen.isdisjoint(rates):
                raise ValueError(f"joints: link = {link}: is named twice")
            seen.update(rates)
            places = [self.coordinate_of(i) for i in rates]
            slides = [k for k in places if k >= 0]
            given = np.atleast_1d(array(f"joints: {link!r}", value))
            if isinstance(link, tuple) and not slides:
                raise ValueError(f"joints: link = {link}: is a ball's, which has no angle; give the whole joint's turn")
            ball = len(places) - len(slides)
            lengths = [len(slides) + part for part in ((3, 4) if ball else (0,))]
            if given.ndim != 1 or len(given) not in lengths:
                want = " or ".join(map(str, lengths))
                turn = ", a ball's turn by a rotation vector (rad) or a quaternion" if ball else ""
                raise ValueError(f"joints: {link!r} = {value!r}: must be {want} number{'s' * (want != '1')}{turn}")
            q[slides] = given[: len(slides)]
            if ball:
                at = dict(self.quaternions())[self._link(link[0] if isinstance(link, tuple) else link)]
                turn_by = given[len(slides) :]
                q[at] = turn_by if len(turn_by) == 4 else _quaternion(turn_by)
        self.check_balls("joints", q)
        return stretched(self, q, np.isin(np.arange(self.nv), list(seen))) if self._tubes else q

    @contextmanager
    def _pointing_to_pose(self, field: str = "q") -> Iterator[None]:
        """Adds a hint at `pose` to the error of a wrong number of coordinates."""
        try:
            yield
        except ValueError as e:
            if not str(e).startswith(f"{field} has shape"):
                raise
            raise ValueError(
                f"{e}, those of arm.q_names, elastic ones too; arm.pose({{0: 0.3}}) makes them of the joints' alone"
            ) from None

    def _posed(self, q: Any) -> Any:
        """q; a dictionary is converted by `pose`."""
        return self.pose(q) if q is not None and isinstance(q, Mapping) else q

    def _place(self, field: str, q: Any) -> Array:
        """q (nq,): `zero` for None, the `pose` of a dictionary; quaternions are not checked."""
        with self._pointing_to_pose(field):
            return self.zero if q is None else array(field, self._posed(q), (self.nq,))

    @staticmethod
    def _x(x: float | None) -> float | None:
        return None if x is None else number("x", x)

    def _batch(self, balls: bool = True, /, **named: Any) -> list[Array]:
        """q (..., nq) and the others (..., nv), checked and broadcast; a single valid state is returned at once.
        `balls`: whether quaternions are checked for zero length."""
        if self._core.one_state(named, balls):
            return list(named.values())
        named = {k: self._posed(value) if k == "q" else value for k, value in named.items()}
        with self._pointing_to_pose():
            arrays = batch({k: self.nq if k == "q" else self.nv for k in named}, **named)
        if balls:
            self.check_balls("q", arrays[list(named).index("q")])
        return arrays

    def _single(self, **named: Any) -> list[Array]:
        if self._core.one_state(named, True):
            return list(named.values())
        named["q"] = self._posed(named["q"])
        with self._pointing_to_pose():
            arrays = [array(k, value, (self.nq if k == "q" else self.nv,)) for k, value in named.items()]
        self.check_balls("q", arrays[list(named).index("q")])
        return arrays

    def check_balls(self, field: str, q: Array) -> None:
        """Raises ValueError if a quaternion in q (..., nq) has zero length, or a length whose square overflows."""
        for k, at in self.quaternions() if self.nq != self.nv else ():
            size = np.abs(q[..., at]).max(axis=-1, initial=0.0)
            bad = np.argwhere((size < 1e-100) | (size > 1e100))
            if len(bad):
                first = tuple(bad[0].tolist())
                value = "0 0 0 0" if size[first] < 1e-100 else f"up to {size[first]:g}"
                where = "".join(f"[{i}]" for i in first) + f"[{at.start}:{at.stop}]"
                raise ValueError(
                    f"{field}{where} = {value}: the quaternion of {self.joint_names[k]} must have a length, from "
                    "1e-100 to 1e100"
                )

    # -- kinematics ----------------------------------------------------------------------------------------------------

    def frame(self, q: ArrayLike, link: int | str = -1, x: float | None = None) -> tuple[Array, Array]:
        """Position (..., 3) and orientation (..., 3, 3) in the world of the slice of a link's beam at x metres.

        x = None is the link's end, where the next joint sits. The columns of R are the slice's axes.
        """
        (q,) = self._batch(q=q)
        p, R = self._core.frame(q, self._link(link), self._x(x))
        return finite("frame", p), finite("frame", R)

    def jacobian(self, q: ArrayLike, link: int | str = -1, x: float | None = None) -> Array:
        """Jacobian (..., 6, nv) of a frame of `frame`: [linear; angular] velocity in world axes (Phi H of Eq. 91)."""
        (q,) = self._batch(q=q)
        return finite("jacobian", self._core.jacobian(q, self._link(link), self._x(x)))

    def jacobian_rate(self, q: ArrayLike, v: ArrayLike, link: int | str = -1, x: float | None = None) -> Array:
        """Time derivative (..., 6, nv) of `jacobian` at the rates v: acceleration = J a + dJ/dt v."""
        q, v = self._batch(q=q, v=v)
        return finite("jacobian rate", self._core.jacobian_rate(q, v, self._link(link), self._x(x)))

    def velocity(self, q: ArrayLike, v: ArrayLike, link: int | str = -1, x: float | None = None) -> Array:
        """Velocity (..., 6) of a frame of `frame`: [linear (m/s); angular (rad/s)] in world axes (Eq. 85)."""
        q, v = self._batch(q=q, v=v)
        return finite("velocity", self._core.slice_motion(q, v, v, self._link(link), self._x(x))[0])

    def acceleration(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, link: int | str = -1, x: float | None = None
    ) -> Array:
        """Acceleration (..., 6) of a frame of `frame`: [linear (m/s^2); angular (rad/s^2)] in world axes (Eq. 86)."""
        q, v, a = self._batch(q=q, v=v, a=a)
        return finite("acceleration", self._core.slice_motion(q, v, a, self._link(link), self._x(x))[1])

    def center_of_mass(self, q: ArrayLike) -> Array:
        """Position (..., 3) of the whole arm's centre of mass in the world (m)."""
        (q,) = self._batch(q=q)
        if not any(link.mass for link in self.links):
            raise ValueError("links: no link has a mass, so there is no centre of mass")
        return finite("centre of mass", self._core.momentum(q, np.zeros((*q.shape[:-1], self.nv)))[1])

    def momentum(self, q: ArrayLike, v: ArrayLike) -> Array:
        """The whole arm's momentum (..., 6): [linear (kg m/s); angular about the world's origin (kg m^2/s)], world
        axes. At order 0, of the truncated kinetic energy, it differs a little from mass times the centre's velocity."""
        q, v = self._batch(q=q, v=v)
        return finite("momentum", self._core.momentum(q, v)[0])

    def strain(self, q: ArrayLike, link: int | str = -1, x: float = 0.0) -> Array:
        """Strains (Eq. 18-21) at x metres along a link's beam, (..., 6): K1, K2, K3 (1/m), phi12, phi13 (rad) and eps;
        of a beam that is curved at rest, the strains beyond its `curvature`."""
        (q,) = self._batch(False, q=q)
        return finite("strain", self._core.strain(q, self._link(link), number("x", x)))

    def deflection(self, q: ArrayLike, link: int | str = -1, x: float | None = None) -> Array:
        """Displacement (..., 3) of the slice at x metres (None: the beam's tip) from rest, in the link's axes (m)."""
        (q,) = self._batch(q=q)
        n = self._link(link)
        beam = self.links[n].beam
        if beam is None:
            raise ValueError(f"link = {link}: has no beam, so no deflection")
        return finite("deflection", self._core.deflection(q, n, beam.length if x is None else number("x", x)))

    def charge(self, q: ArrayLike, link: int | str = -1, patch: int = 0) -> Array:
        """Charge (C) that strain brings onto the electrodes of a link's patch when they are short-circuited, (...): by
        reciprocity, the patch's forces per volt (Eq. 61) times the elastic coordinates."""
        (q,) = self._batch(False, q=q)
        with np.errstate(over="ignore", invalid="ignore"):
            force = self.patch_matrix[:, self.patch_column(link, patch)]
            used = np.flatnonzero(force)
            return finite("charge", np.asarray(q[..., [self.coordinate_of(int(i)) for i in used]] @ force[used]))

    def patch_voltage(self, q: ArrayLike, link: int | str = -1, patch: int = 0) -> Array:
        """Voltage (V) of a link's patch with open electrodes, (...): -charge / capacitance; a patch that shrinks under
        a positive voltage shows one when stretched. The reaction of this voltage on the motion is left out."""
        with np.errstate(over="ignore"):
            return finite("patch voltage", -self.charge(q, link, patch) / self.capacitance(link, patch))

    def capacitance(self, link: int | str = -1, patch: int = 0) -> float:
        """Capacitance (F) of a link's patch, of a pair in parallel, with all strains held.

        Raises:
            ValueError: no such patch, or its material has no permittivity.
        """
        n = self._link(link)
        self.patch_column(n, patch)
        beam = self.links[n].beam
        assert beam is not None
        value = float(beam._core.patch_capacitances[patch])
        if not value > 0:
            raise ValueError(
                f"permittivity = {beam.patches[patch].material.permittivity}: patch {patch} of {self.names[n]} needs "
                "it to sense a voltage"
            )
        return value

    # -- struts and tendons --------------------------------------------------------------------------------------------

    def strut_motion(
        self, q: ArrayLike, v: ArrayLike | None = None, driven: ArrayLike | None = None
    ) -> tuple[Array, Array, Array]:
        """Length (m), its rate (m/s) and force (N) of each strut and tendon, (..., n) each, by their numbers in
        `struts`. The force is that with which it pushes its points apart, spring, damper, constant and driven part: of
        a tendon, its tension is the negative. `driven` (..., n) adds to the force of a Strut and the tension of a
        Tendon, as drives do; v and driven are zero if None."""
        found = finite("strut motion", self._strut_motion(q, v, driven)[0])
        return found[..., 0], found[..., 1], found[..., 2]

    def _strut_motion(self, q: ArrayLike, v: ArrayLike | None, driven: ArrayLike | None) -> tuple[Array, Array]:
        q, v = self._batch(q=q, v=np.zeros(self.nv) if v is None else v)
        sense = np.array([s.sense for s in self.struts])
        given = array("driven", np.zeros(len(sense)) if driven is None else driven)
        if given.shape[-1:] != sense.shape:
            raise ValueError(f"driven: has shape {given.shape}: must be (..., {len(sense)}), a number for each strut")
        pushed = np.broadcast_to(given * sense, (*q.shape[:-1], len(sense)))
        return self._core.strut_motion(q, v, np.ascontiguousarray(pushed))

    def strut_jacobian(self, q: ArrayLike) -> Array:
        """Jacobian (..., n, nv) of the lengths of struts and tendons: dl/dt = J v. A force f with which they push has
        the generalised forces J^T f."""
        return finite("strut Jacobian", self._strut_motion(q, None, None)[1])

    # -- contacts ------------------------------------------------------------------------------------------------------

    def contact_motion(self, q: ArrayLike, v: ArrayLike | None = None) -> tuple[Array, Array, Array]:
        """Gap (m), its rate (m/s) and normal force (N) of each contact, (..., n) each, by their numbers in `contacts`.
        Where a gap is below zero, it touches; the rate is negative where it gets nearer. v is zero if None."""
        q, v = self._batch(q=q, v=np.zeros(self.nv) if v is None else v)
        found = finite("contact motion", self._core.contact_motion(q, v))
        return found[..., 0], found[..., 1], found[..., 2]

    def contact_jacobian(self, q: ArrayLike) -> Array:
        """Jacobian (..., n, nv) of the gaps: d gap/dt = J v. Normal forces f have the generalised forces J^T f."""
        (q,) = self._batch(q=q)
        rates = self.contact_motion(np.repeat(q[..., None, :], self.nv, axis=-2), np.eye(self.nv))[1]
        return np.ascontiguousarray(np.swapaxes(rates, -1, -2))

    def contact_places(self, q: ArrayLike) -> tuple[Array, Array]:
        """Where the sphere of each contact is nearest to its surface (m), and the direction from the surface to it, in
        the world, (..., n, 3) each, by their numbers in `contacts`."""
        (q,) = self._batch(q=q)
        at, normal = np.zeros((2, *q.shape[:-1], len(self.contacts), 3))
        for k, (c, (point, on)) in enumerate(zip(self.contacts, self._touching, strict=True)):
            axes, (origin, turn), centre = c.against._core[0], self._point_frame(q, on), self._point_frame(q, point)[0]
            y = np.einsum("...ij,...i->...j", turn @ axes, centre - origin)
            normal[..., k, :] = np.einsum("...ij,...j->...i", turn @ axes, c.against.normal_at(y))
            at[..., k, :] = centre - c.radius * normal[..., k, :]
        return at, normal

    def _point_frame(self, q: Array, point: _Fastened) -> tuple[Array, Array]:
        """A point in the world (..., 3), and the axes there (..., 3, 3)."""
        link, on, x, offset = point
        if link < 0:
            return np.broadcast_to(offset, (*q.shape[:-1], 3)), np.broadcast_to(np.eye(3), (*q.shape[:-1], 3, 3))
        p, R = self._core.frame(q, link, x if on == "slice" else None)
        if on == "origin":
            of = self.links[link]
            p, R = self._core.frame(q, link, 0.0 if of.beam else None)
            bodies = (of.hub,) if of.beam else (of.hub, of.tip)
            offset = offset - sum((np.array(b.end) for b in bodies if b is not None), np.zeros(3))
        return p + R @ offset, R

    @property
    def rubbing(self) -> list[str]:
        """The names of contacts with friction."""
        return [name for name, c in zip(self.contact_names, self.contacts, strict=True) if c.coulomb]

    def refuse_rubbing(self, caller: str) -> None:
        """ValueError where contacts have friction: `caller` does not know the past of a run, on which that depends."""
        for k, c in enumerate(self.contacts):
            if c.coulomb:
                name = self.contact_names[k]
                raise ValueError(
                    f"{caller}: contact '{name}' has friction (coulomb = {c.coulomb:g}), which depends on a run's "
                    "past, and that is not known here; take contacts with coulomb = 0"
                )

    # -- loops ---------------------------------------------------------------------------------------------------------

    def loop_motion(self, q: ArrayLike, v: ArrayLike | None = None) -> tuple[Array, Array]:
        """The constraints g (..., n) of the loops, and their rates dg/dt, loop by loop: components of the way from the
        joint's frame on a to that on b, along axes of a's (m), then products of an axis of a's and one of b's, 0 where
        they are square (such as 1e-3 for a turn of 1e-3 rad). v is zero if None. A compliant loop pulls g back to zero;
        runs keep that of rigid ones there."""
        q, v = self._batch(q=q, v=np.zeros(self.nv) if v is None else v)
        found = finite("loop motion", self._core.loop_motion(q, v))
        return found[..., 0], found[..., 1]

    def loop_jacobian(self, q: ArrayLike) -> Array:
        """Jacobian (..., n, nv) of the constraints of `loop_motion`: dg/dt = J v. Forces f along g have the generalised
        forces J^T f."""
        (q,) = self._batch(q=q)
        rates = self.loop_motion(np.repeat(q[..., None, :], self.nv, axis=-2), np.eye(self.nv))[1]
        return np.ascontiguousarray(np.swapaxes(rates, -1, -2))

    def loop_place(self, q: ArrayLike, loop: int | str = -1) -> Array:
        """Coordinates (..., nq) of a loop's joint, as of a link's joint: angle (rad), displacement (m), or both; a
        ball's quaternion; none of a fixed joint. `loop` is its name or its number in `loops`."""
        (q,) = self._batch(q=q)
        k = self._loop(loop)
        (p, A), (end, B) = self._loop_frames(q, k)
        away = np.einsum("...ji,...j->...i", A, end - p)
        return finite("loop place", self.loops[k].place(away, np.swapaxes(A, -1, -2) @ B))

    def _loop_frames(self, q: Array, k: int) -> list[tuple[Array, Array]]:
        """The frames of loop k's joint on a and on b: origin (..., 3) and axes (..., 3, 3) in the world."""
        sides = zip(self._closing[k], self.loops[k]._core, strict=True)
        return [(p, R @ axes) for (p, R), (_, axes) in ((self._point_frame(q, at), own) for at, own in sides)]

    @property
    def rigid_rows(self) -> NDArray[np.bool_]:
        """Which entries of `loop_motion` rigid loops hold, (n,); compliant loops pull at the others."""
        return np.array([rigid for _, _, rigid in self._core.loop_rows], dtype=bool)

    @property
    def constrained(self) -> bool:
        """Whether loops hold it rigidly, so that not all of its coordinates are free."""
        return any(x.rigid for x in self.loops)

    def refuse_loops(self, caller: str, rigid: bool = False) -> None:
        """ValueError where there are loops, or `rigid` ones: `caller` does not know them."""
        for name, loop in zip(self.loop_names, self.loops, strict=True):
            if name in self._ties:
                rod = self._rods[self._ties.index(name)]
                raise ValueError(f"{caller}: does not know cylinders, such as '{rod}', a strut with a mass")
            if loop.rigid or not rigid:
                kind, remedy = ("rigid loops", "; give it stiffnesses") if rigid else ("loops", "")
                raise ValueError(f"{caller}: does not know {kind}, such as '{name}'{remedy}")

    # -- inertia and energy --------------------------------------------------------------------------------------------

    def mass_matrix(self, q: ArrayLike) -> Array:
        """Joint-space mass matrix of Eq. 90, shape (..., nv, nv); of an arm with loops that of its tree."""
        return finite("mass matrix", self._core.mass_matrix(*self._batch(q=q)))

    def energy(self, q: ArrayLike, v: ArrayLike) -> tuple[Any, Any]:
        """Kinetic and potential energy (J), each of shape (...): potential is elastic less sum of m g . p."""
        e = finite("energy", self._core.energy(*self._batch(q=q, v=v)))
        return tuple(e.tolist()) if e.ndim == 1 else (e[..., 0], e[..., 1])
