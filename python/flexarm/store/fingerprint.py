"""Fingerprints of the values that a batch follows from, so that a file is continued only by the call that began it.

Numbers, arrays, containers and flexarm's own objects count by their values. The code of a user's functions and classes
is not compared: the user gives a name for it, and another name when it changes. The numbers that they hold count, too.
"""

from __future__ import annotations

import enum
import functools
import hashlib
from collections.abc import Mapping
from pathlib import PurePath
from types import FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np

import flexarm._core as _core


class _Unknown(Exception):
    """Code that has no fingerprint, in words."""


def _hash(*parts: Any) -> bytes:
    h = hashlib.sha256()
    for part in parts:
        data = part if isinstance(part, (bytes, memoryview)) else str(part).encode("utf-8", "surrogatepass")
        h.update(len(data).to_bytes(8, "little"))
        h.update(data)
    return h.digest()


class _Hashes:
    """Hashes of values. Code of the user raises _Unknown, unless it is named."""

    def __init__(self, named: bool) -> None:
        self._named = named
        self._within: list[int] = []

    def of(self, value: Any) -> bytes:
        """The hash of a value."""
        kind = type(value)
        if value is None or kind in (bool, int, str, bytes, complex) or isinstance(value, PurePath):
            return _hash(kind.__name__, value)
        if isinstance(value, float):  # numpy's float64, too
            return _hash("float", float(value).hex())
        if isinstance(value, (np.ndarray, np.generic)) and not value.dtype.hasobject:
            x = np.ascontiguousarray(value)
            return _hash("array", x.dtype.str, value.shape, x.reshape(-1).view(np.uint8).data)
        if id(value) in self._within:
            return _hash("again", len(self._within) - self._within.index(id(value)))
        self._within.append(id(value))
        try:
            return self._compound(value)
        finally:
            self._within.pop()

    def _all(self, word: str, *values: Any) -> bytes:
        return _hash(word, *map(self.of, values))

    def _compound(self, value: Any) -> bytes:
        kind = type(value)
        if isinstance(value, np.ndarray):
            return self._all(f"objects {value.shape}", *value.ravel())
        if isinstance(value, ModuleType):
            return _hash("module", value.__name__)
        if kind in (list, tuple, range):
            return self._all(kind.__name__, *value)
        if kind in (set, frozenset):
            return _hash("set", *sorted(map(self.of, value)))
        if isinstance(value, Mapping):
            return self._all("mapping", *(x for item in value.items() for x in item))
        if isinstance(value, MethodType):
            return self._all("method", value.__self__, value.__func__)
        if isinstance(value, functools.partial):
            return self._all("partial", value.func, value.args, value.keywords)
        named = value if isinstance(value, (FunctionType, type)) else kind
        word, ours = f"{named.__module__}.{named.__qualname__}", named.__module__.partition(".")[0] == "flexarm"
        if not ours and not self._named:
            raise _Unknown(f"code that a file cannot compare, {getattr(value, '__qualname__', f'an object of {word}')}")
        if isinstance(value, FunctionType):
            return self._all(word, value.__defaults__, value.__kwdefaults__, *_cells(value))
        if isinstance(value, type):
            return _hash(word)
        if not ours:
            return self._all(word, getattr(value, "__qualname__", None), getattr(value, "__dict__", None))
        if isinstance(value, enum.Enum):
            return _hash(word, value.name)
        function, args, state, items, pairs = (*value.__reduce_ex__(4), None, None, None)[:5]
        if isinstance(state, dict):  # without the values that are only kept for speed
            cached = functools.cached_property
            state = {k: v for k, v in state.items() if not isinstance(getattr(kind, k, None), cached)}
        return self._all(word, function.__name__, args, state, list(items or ()), dict(pairs or ()))


def _cells(f: FunctionType) -> list[Any]:
    """The values of a function's closure that it has already."""
    filled = [cell for cell in f.__closure__ or () if cell != type(cell)()]
    return [cell.cell_contents for cell in filled]


def marks(parts: Mapping[str, Any], name: str | None = None) -> dict[str, str]:
    """A hash of each part, and flexarm's version.

    Args:
        parts: values by what they are called.
        name: stands for all code of the user's.

    Raises:
        ValueError: there is such code, and no name.
    """
    if name is not None and (not isinstance(name, str) or not name):
        raise ValueError(f"name = {name!r}: must be a text, such as 'gains of May'")
    out = {"flexarm": _core.__version__, **({} if name is None else {"name": name})}
    for label, value in parts.items():
        try:
            out[label] = _Hashes(name is not None).of(value).hex()
        except _Unknown as e:
            raise ValueError(
                f"{label}: is or holds {e}: give name='law 1', a name for your functions, and another name when you "
                "change them, so that the file is not continued with other functions"
            ) from None
        except RecursionError:
            raise ValueError(f"{label}: holds lists in lists, too deep to be compared") from None
    return out


def difference(found: Mapping[str, str], mine: Mapping[str, str]) -> str:
    """The parts that tell two marks apart, in words."""
    if found.get("flexarm") != mine["flexarm"]:
        return f"of flexarm {found.get('flexarm')}, this is {mine['flexarm']}"
    other = [k for k in {**found, **mine} if found.get(k) != mine.get(k)]
    return f"with another {', '.join(other[:4])}{', ...' if len(other) > 4 else ''}"
