"""From tables of a file to parts: a table holds the arguments of one class (see arguments.py)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, TypeVar

from ..._check import choice, known_keys
from .arguments import Argument, arguments, kinds, members
from .beam import Vector
from .contact import Contact
from .link import Link
from .loop import Loop
from .strut import Strut, Tendon

#: (where, value) -> value, by the name of an argument: readers that replace the one of its type
Readers = Mapping[str, Callable[[str, Any], Any]]
_NONE: Readers = MappingProxyType({})
_T = TypeVar("_T")


@dataclass(frozen=True)
class ArmFile:
    """The arm of a scene file.

    Args:
        link: the links, from the base to the tip: each sits on the one before, or on its `parent`. A joint on the world
            sits at its origin, in its axes.
        gravity: in world axes (m/s^2).
        strut: cylinders, springs and struts between points of links and of the world.
        tendon: ropes and cables, likewise. In the arm's numbers of struts they come behind all of `strut`.
        contact: spheres and points of links that touch surfaces of the world, or of other links.
        loop: joints that close loops, between places of two links, or of a link and the world.
    """

    link: Sequence[Link]
    gravity: Vector = (0.0, 0.0, 0.0)
    strut: Sequence[Strut] = ()
    tendon: Sequence[Tendon] = ()
    contact: Sequence[Contact] = ()
    loop: Sequence[Loop] = ()


@contextmanager
def shallow(label: str) -> Iterator[None]:
    """Raises ValueError for data nested deeper than Python's stack, which cannot even be printed."""
    try:
        yield
    except RecursionError:
        raise ValueError(f"{label}: is nested too deeply") from None


@shallow("scene")
def read_file(kind: type[_T], d: Mapping[str, Any], own: Readers = _NONE) -> _T:
    """A whole file (an ArmFile or a class derived from it) from its structure of dictionaries and lists."""
    return read("", kind, {"link": None, **d} if isinstance(d, Mapping) else d, own)


def read(where: str, make: Callable[..., _T], table: Any, own: Readers = _NONE) -> _T:
    """make(**table), its tables read likewise; errors say where in the file they are ("": at its top)."""
    here, inside = where or "scene", f"{where}." if where else ""
    known = arguments(make)
    known_keys(here, table, known)
    missing = [name for name, argument in known.items() if argument.required and name not in table]
    if missing:
        raise ValueError(f"{here}: missing {', '.join(missing)}")
    given = {name: _value(inside + name, known[name], value, own) for name, value in table.items()}
    try:
        return make(**given)
    except ValueError as e:
        raise ValueError(f"{inside}{e}") from None
    except TypeError as e:
        raise ValueError(f"{here}: {e}") from None


def _value(where: str, argument: Argument, value: Any, own: Readers) -> Any:
    if argument.name in own:
        return own[argument.name](where, value)
    if not argument.parts:
        return value
    if (argument.number or argument.text) and not isinstance(value, Mapping):
        return value
    if not argument.many:
        return _part(where, argument.parts, value, own)
    if not isinstance(value, (list, tuple)) or (argument.required and not value):
        want = "at least one table" if argument.required else "tables"
        raise ValueError(f"{where} = {value!r}: must be a list of {want}")
    short = str in members(argument.hint)
    return [table if short and not isinstance(table, Mapping) else _part(f"{where}[{k}]", argument.parts, table, own)
            for k, table in enumerate(value)]  # fmt: skip


def _part(where: str, classes: Sequence[type], table: Any, own: Readers) -> Any:
    """One of several classes: the one with the table's type; without types, the one that has most of its keys."""
    known = kinds(*classes)
    if not known:
        keys = table if isinstance(table, Mapping) else ()
        return read(where, max(classes, key=lambda c: sum(k in arguments(c) for k in keys)), table, own)
    if not isinstance(table, Mapping) or "type" not in table:
        raise ValueError(f"{where} = {table!r}: must be a table with a type: {', '.join(known)}")
    make = known[choice(f"{where}.type", table["type"], known)]
    return read(where, make, {k: v for k, v in table.items() if k != "type"}, own)
