"""The base of all parts of an arm: immutable dataclasses with a counterpart in the core."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from functools import cache
from typing import Annotated, Any, get_origin

from ..._check import (
    array,
    choice,
    finite_number,
    flag,
    instance,
    not_negative,
    number,
    plain,
    positive,
    unmasked,
    whole,
)
from .arguments import alternatives, arguments, with_inherited

#: A check of an argument, which returns the value to be kept: (name, value) -> value.
Check = Callable[[str, Any], Any]


class ModelWarning(UserWarning):
    """A part is used beyond its theory, or an angle looks like one in degrees.

    The message gives the limit or the remedy. `check` finds other probable mistakes."""


#: first entries of tuples that name an item, such as ("patch", link, patch)
_TAKEN = ("patch", "load", "force", "acceleration", "strut")


def read_name(value: Any) -> str | None:
    """The name of a link or a joint, or None. Dots are refused: they separate the words of paths. So are numbers."""
    if value is None:
        return None
    if not isinstance(value, str) or not value.strip() or value != value.strip() or not value.isprintable():
        raise ValueError(f"name = {value!r}: must be text without blanks around it, such as 'elbow'")
    if "." in value:
        raise ValueError(f"name = {value!r}: must have no dot, which parts the words of a path ('link.elbow.tip.mass')")
    if value in _TAKEN or re.fullmatch(r"((link|strut|contact|loop) )?[-+]?\d+", value):
        raise ValueError(f"name = {value!r}: means something else already; take another")
    return value


def _place(name: str, value: Any) -> tuple[float, ...]:
    return tuple(array(name, value, (3,)).tolist())


def one_of(*known: str) -> Check:
    """The check of a word."""
    return lambda name, value: choice(name, value, known)


# Types of arguments with the checks that belong to them; a Place is three numbers.
Finite = Annotated[float, finite_number]
Positive = Annotated[float, positive]
NotNegative = Annotated[float, not_negative]
Place = Annotated[Sequence[float], _place]


class Part:
    """A dataclass whose arguments are checked by their annotated types, and then together by `_made`, which returns the
    core's counterpart. That is held in `_core`, outside equality, printing and pickling. Bad arguments raise
    ValueError, which names the field and its value."""

    _core: Any

    def __init_subclass__(cls) -> None:
        cls.__doc__ = with_inherited(cls)

    def __post_init__(self) -> None:
        """Checks each argument by its type, and converts NumPy's numbers to Python's, so that parts compare, print and
        save alike."""
        kind: Any = type(self)
        for name, read in _checks(kind).items():
            self._set(name, read(name, getattr(self, name)))
        self._set("_core", self._made())

    def _replaced(self, new: Mapping[str, Any]) -> Part:
        """As `dataclasses.replace`; arguments that stay are not checked again."""
        kind: Any = type(self)
        if kind.__post_init__ is not Part.__post_init__:  # which checks more
            return replace(self, **new)  # type: ignore[type-var]
        out: Part = object.__new__(kind)
        for name, read in _checks(kind).items():
            out._set(name, read(name, new[name]) if name in new else getattr(self, name))
        out._set("_core", out._made())
        return out

    def _made(self) -> Any:
        return None

    def _set(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)  # dataclasses here are frozen

    def _arguments(self) -> dict[str, Any]:
        return {f.name: getattr(self, f.name) for f in fields(self) if f.init}  # type: ignore[arg-type]

    def __reduce__(self) -> Any:
        return _rebuild, (type(self), {k: _unwrapped(v) for k, v in self._arguments().items()})

    def to_dict(self) -> dict[str, Any]:
        """The same structure as in a scene file."""
        out: dict[str, Any] = {}
        kind = getattr(self, "type", None)
        if kind is not None:
            out["type"] = kind
        for name, value in self._arguments().items():
            if value is not None and not (isinstance(value, tuple) and not value):
                out[name] = as_table(value)
        return out


_SIMPLE: dict[Any, Check] = {float: number, int: whole, bool: flag}


@cache
def _checks(cls: Callable[..., Part]) -> dict[str, Check]:
    """A check of each argument: that of its annotated type, of a number, a flag, or a part, and whether it may be
    None."""
    return {name: _check(alternatives(a.hint)) for name, a in arguments(cls).items()}


def _check(kinds: Sequence[Any]) -> Check:
    given, optional = [k for k in kinds if k is not type(None)], type(None) in kinds
    parts = tuple(k for k in given if isinstance(k, type) and issubclass(k, Part))
    own: Check | None = None
    if len(given) == 1:
        own = given[0].__metadata__[0] if get_origin(given[0]) is Annotated else _SIMPLE.get(given[0])

    def read(name: str, value: Any) -> Any:
        if value is None and optional:
            return None
        value = unmasked(name, value)
        if own is not None:
            return own(name, plain(value))
        if parts and len(parts) == len(given) and not isinstance(value, parts):
            instance(name, value, (*parts, *[type(None)] * optional))
        return plain(value)

    return read


def _rebuild(cls: type, arguments: dict[str, Any]) -> Any:
    return cls(**arguments)


def _unwrapped(value: Any) -> Any:
    """Read-only mappings as dictionaries, which can be pickled."""
    if isinstance(value, Mapping):
        return {k: _unwrapped(v) for k, v in value.items()}
    return tuple(_unwrapped(v) for v in value) if isinstance(value, tuple) else value


def as_table(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {k: as_table(v) for k, v in value.items()}
    if isinstance(value, (tuple, list)):
        return [as_table(v) for v in value]
    return value.to_dict() if isinstance(value, Part) else value
