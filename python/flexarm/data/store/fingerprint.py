"""Fingerprints of the values that a batch follows from, so that a file is continued only by the call that began it.

Numbers, arrays, Python's containers and flexarm's own objects count by their values. The code of other functions and
classes is not compared: the user gives a name for it, and another name when it changes. All that they hold counts, too.
"""

import copyreg
import enum
import functools
import hashlib
import sys
from collections.abc import Mapping
from pathlib import PurePath
from types import FunctionType, MappingProxyType, MethodType, ModuleType
from typing import Any

import numpy as np

import flexarm._core as _core


class _Unknown(Exception):
    """A value that has no fingerprint, and the remedy, in words."""


def _hash(*parts: Any) -> bytes:
    h = hashlib.sha256()
    for part in parts:
        data = part if isinstance(part, (bytes, memoryview)) else str(part).encode("utf-8", "surrogatepass")
        h.update(len(data).to_bytes(8, "little"))
        h.update(data)
    return h.digest()


class _Hashes:
    """Hashes of values. Code that is not flexarm's raises _Unknown, unless it is named."""

    def __init__(self, named: bool) -> None:
        self._named = named
        self._within: list[int] = []
        self._known: dict[int, tuple[Any, bytes]] = {}  # with the values, so that no other takes their ids

    def of(self, value: Any) -> bytes:
        """The hash of a value."""
        kind = type(value)
        if value is None or kind in (bool, int, str, bytes, complex) or isinstance(value, PurePath):
            return _hash(kind.__name__, value)
        if kind in (float, np.float64):
            return _hash("float", float(value).hex())
        if (kind in (np.ndarray, np.memmap) or isinstance(value, np.generic)) and not value.dtype.hasobject:
            x = np.ascontiguousarray(value)
            return _hash("array", repr(x.dtype), value.shape, x.reshape(-1).view(np.uint8).data)
        if id(value) in self._within:
            return _hash("again", len(self._within) - self._within.index(id(value)))
        if id(value) not in self._known:
            self._within.append(id(value))
            try:
                self._known[id(value)] = value, self._compound(value)
            finally:
                self._within.pop()
        return self._known[id(value)][1]

    def _all(self, word: str, *values: Any) -> bytes:
        return _hash(word, *map(self.of, values))

    def _compound(self, value: Any) -> bytes:
        kind = type(value)
        if kind is np.ndarray:
            return self._all(f"objects {value.shape}", *value.ravel())
        if isinstance(value, ModuleType):
            return _hash("module", value.__name__)
        if kind in (list, tuple, range):
            return self._all(kind.__name__, *value)
        if kind in (set, frozenset):
            return _hash("set", *sorted(map(self.of, value)))
        if kind in (dict, MappingProxyType):
            return self._all("mapping", *(x for item in value.items() for x in item))
        if isinstance(value, MethodType):
            return self._all("method", value.__self__, value.__func__)
        if isinstance(value, functools.partial):
            return self._all(f"partial {kind.__qualname__}", value.func, value.args, value.keywords, vars(value))
        named = value if isinstance(value, (FunctionType, type)) else kind
        word = f"{named.__module__}.{named.__qualname__}"
        if not word.startswith("flexarm.") and not self._named:
            raise _Unknown(
                f"code that a file cannot compare, {getattr(value, '__qualname__', f'an object of {word}')}: give "
                "name='law 1', a name for your functions, and another name when you change them, so that the file is "
                "not continued with other functions"
            )
        if isinstance(value, FunctionType):
            return self._all(word, value.__defaults__, value.__kwdefaults__, vars(value), *_cells(value))
        if isinstance(value, type):
            return self._all(word, *_made(value))
        if isinstance(value, enum.Enum):
            return _hash(word, value.name)
        return self._all(word, *_read(value, word))


def _cells(f: FunctionType) -> list[Any]:
    """The values of a function's closure that it has already."""
    filled = [cell for cell in f.__closure__ or () if cell != type(cell)()]
    return [cell.cell_contents for cell in filled]


def _made(kind: type) -> list[Any]:
    """The functions and values of a class that a function made, and of its bases, as they may hold its numbers."""
    if "<locals>" not in kind.__qualname__:
        return []
    held = {k: getattr(x, "fget", getattr(x, "func", getattr(x, "__func__", x))) for k, x in vars(kind).items()}
    plain = {k for k, x in held.items() if not (k.startswith("__") or k == "_abc_impl" or hasattr(type(x), "__get__"))}
    return [{k: x for k, x in held.items() if k in plain or isinstance(x, FunctionType)}, *kind.__bases__]


def _read(value: Any, word: str) -> tuple[Any, ...]:
    """All that an object is made of, as `copy` reads it, without the values that are only kept for speed."""
    kind = type(value)
    by_type: Any = copyreg.dispatch_table.get(kind)
    tensor: Any = getattr(sys.modules.get("torch"), "Tensor", ())
    try:
        if isinstance(value, tensor):  # it is copied with its address
            return (value.detach().cpu().numpy(),)
        found = by_type(value) if by_type else value.__reduce_ex__(4)
    except Exception:
        found = None
    if isinstance(found, str) and not found.endswith(" (vectorized)"):  # a function; np.frompyfunc hides its own
        return found, getattr(value, "__module__", None), getattr(value, "__dict__", None)
    if not isinstance(found, tuple):
        raise _Unknown(
            f"an object of {word}, whose state cannot be read: leave it out of the arguments of the batch, or out of "
            "the __getstate__ of the class that holds it"
        )
    function, args, state, items, pairs = (*found, None, None, None)[:5]
    cached = {k for c in kind.__mro__ for k, x in vars(c).items() if isinstance(x, functools.cached_property)}
    states = [
        {k: x for k, x in part.items() if k not in cached} if type(part) is dict else part
        for part in (state if type(state) is tuple else (state,))
    ]
    return getattr(function, "__name__", function), args, states, list(items or ()), list(pairs or ())


def marks(parts: Mapping[str, Any], name: str | None = None) -> dict[str, str]:
    """A hash of each part, and flexarm's version.

    Args:
        parts: values by their names.
        name: stands for all code of the user's.

    Raises:
        ValueError: there is such code, and no name; or an object whose state cannot be read.
    """
    if name is not None and (not isinstance(name, str) or not name):
        raise ValueError(f"name = {name!r}: must be a text, such as 'gains of May'")
    out = {"flexarm": _core.__version__, **({} if name is None else {"name": name})}
    for label, value in parts.items():
        try:
            out[label] = _Hashes(name is not None).of(value).hex()
        except _Unknown as e:
            raise ValueError(f"{label}: is or holds {e}") from None
        except RecursionError:
            raise ValueError(f"{label}: holds lists in lists, too deep to be compared") from None
    return out


def difference(found: Mapping[str, str], mine: Mapping[str, str]) -> str:
    """The parts that tell two marks apart, in words."""
    if found.get("flexarm") != mine["flexarm"]:
        return f"of flexarm {found.get('flexarm')}, this is {mine['flexarm']}"
    other = [k for k in {**found, **mine} if found.get(k) != mine.get(k)]
    return f"with another {', '.join(other[:4])}{', ...' if len(other) > 4 else ''}"
