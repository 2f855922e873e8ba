"""What a batch follows from, as hashes: so that a file is taken up again only by the call that began it.

Numbers, arrays, containers and objects count by their values; functions by their source (its syntax tree, without
comments, docstrings and annotations) and by all that they read: closures, defaults, globals, what they call in turn.
Packages that are installed count by name and version. No bytecode, no addresses, no pickled bytes: another process,
machine or Python finds the same.
"""

from __future__ import annotations

import ast
import builtins
import dis
import enum
import functools
import hashlib
import importlib
import importlib.metadata
import inspect
import io
import os
import random
import sys
import time
import types
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from types import FunctionType, ModuleType
from typing import Any

import numpy as np

import flexarm._core as _core

from .source import (
    NAMELESS,
    READERS,
    Function,
    Unseen,
    attributes_in,
    canonical,
    chains_of,
    changed_in,
    codes,
    installed,
    reader_in,
    source_of,
    stands_for,
)

#: read what is not in the program
_OUTSIDE: tuple[Any, ...] = (
    open, input, eval, exec, globals, __import__, importlib.import_module, time.time, time.time_ns, time.perf_counter,
    time.monotonic, os.urandom, os.getenv, np.load, np.loadtxt, np.genfromtxt, np.fromfile, np.memmap,
)  # fmt: skip
#: change when they are used, or belong to the moment
_STATE: tuple[type, ...] = (
    np.random.Generator, np.random.BitGenerator, np.random.RandomState, random.Random, io.IOBase, type(os.environ),
)  # fmt: skip
_DESCRIPTORS = (
    types.MethodDescriptorType, types.WrapperDescriptorType, types.GetSetDescriptorType, types.MemberDescriptorType,
    types.ClassMethodDescriptorType,
)  # fmt: skip
#: of a class, what says nothing of what it does, or is made from the rest
_IDLE = frozenset(
    "__module__ __dict__ __weakref__ __doc__ __qualname__ __firstlineno__ __static_attributes__ __annotations__ "
    "__annotate__ __annotate_func__ __annotations_cache__ __parameters__ __orig_bases__ __abstractmethods__ _abc_impl "
    "__dataclass_params__ __match_args__ __hash__".split()
)
#: methods that dataclasses and named tuples write themselves
_WRITTEN = frozenset(
    "__init__ __repr__ __eq__ __lt__ __le__ __gt__ __ge__ __hash__ __setattr__ __delattr__ __replace__ __new__ "
    "__getstate__ __setstate__".split()
)
_CACHED = type(functools.lru_cache(len))
#: methods that make an object
_MAKING = frozenset("__init__ __new__ __post_init__ __setstate__ __set_name__ __init_subclass__".split())

def _hash(*parts: bytes | bytearray | memoryview | str) -> bytes:
    h = hashlib.sha256()
    for part in parts:
        data = part.encode("utf-8", "surrogatepass") if isinstance(part, str) else part
        h.update(len(data).to_bytes(8, "little"))
        h.update(data)
    return h.digest()


def _leaf(value: Any) -> bytes | None:
    kind = type(value)
    if value is None or value is Ellipsis or value is NotImplemented:
        return _hash(repr(value))
    if kind in (bool, str, bytes, bytearray):
        return _hash(kind.__name__, value if isinstance(value, (str, bytes, bytearray)) else str(value))
    if kind is int:
        return _hash("int", hex(value))
    if kind in (float, np.float64):
        return _hash("float", float(value).hex())
    if kind is complex:
        return _hash("complex", value.real.hex(), value.imag.hex())
    return None


def _changing(cls: type, asked: Iterable[str]) -> str | None:
    """The first of these methods, or of those that they call, that changes the object that it is of."""
    todo, seen = sorted(asked), set(_MAKING)
    while todo:
        name = todo.pop(0)
        method = next((vars(c)[name] for c in cls.__mro__ if name in vars(c) and installed(c.__module__) is None), None)
        if name in seen or not isinstance(method, FunctionType) or _sourceless(method):
            continue
        seen.add(name)
        node, own = source_of(method.__code__), method.__code__.co_varnames[:1]
        if own and changed_in(node, own) is not None:
            return name
        todo += sorted(attributes_in(node))
    return None


class _Look:
    """Hashes of values. What cannot be looked into is refused, or counts by the user's name for it."""

    def __init__(self, name: str | None) -> None:
        self.name = name
        self._known: dict[int, tuple[Any, bytes]] = {}  # the values too, so that no id comes again
        self._stack: list[int] = []
        self._trail: list[str] = []
        self._asked: list[set[str]] = [{"__call__"}]  # by those through whom a value was reached

    def of(self, value: Any, place: str = "") -> bytes:
        """The hash of a value that stands at a place of another."""
        found = _leaf(value)
        if found is not None:
            return found
        key = id(value)
        if key in self._known:
            return self._known[key][1]
        if key in self._stack:
            return _hash("again", str(len(self._stack) - self._stack.index(key)))
        self._stack.append(key)
        self._trail.append(place)
        try:
            found = self._compound(value)
        except Unseen as e:
            if self.name is None:
                where = ", ".join(p for p in self._trail if p)
                raise ValueError(
                    f"out: {where} {e}; so the file could not tell this batch from another: give fingerprint='...', "
                    "a name of yours for all that this computes, and another name when you change it"
                ) from None
            found = _hash("named", self.name)
        finally:
            self._stack.pop()
            self._trail.pop()
        self._known[key] = (value, found)
        return found

    def _all(self, kind: str, values: Mapping[str, Any]) -> bytes:
        return _hash(kind, *(x for k, v in values.items() for x in (k, self.of(v, k))))

    def _items(self, kind: str, values: Any) -> bytes:
        return _hash(kind, *(self.of(v) for v in values))

    def _compound(self, value: Any) -> bytes:
        if isinstance(value, np.generic) or type(value) in (np.ndarray, np.memmap):
            return self._array(np.asarray(value))
        if type(value) in (list, tuple):
            return self._items(type(value).__name__, value)
        if type(value) in (set, frozenset):
            return _hash("set", *sorted(self.of(v) for v in value))
        if type(value) in (dict, types.MappingProxyType):
            return _hash("dict", *(x for k, v in value.items() for x in (self.of(k), self.of(v, f"{k!r}"))))
        if isinstance(value, _core.PiecewisePolynomial):
            return self._items("pieces", (value.breaks, value.coefficients))
        if any(value is x for x in _OUTSIDE):
            raise Unseen(f"reads with {value.__name__}() what is not in the program")
        if isinstance(value, ModuleType):
            stands = installed(value.__name__)
            if stands is None:
                raise Unseen(f"uses the module {value.__name__} as a whole (name what it takes from there)")
            return _hash("module", stands)
        if isinstance(value, type):
            return self._class(value)
        if callable(value) or isinstance(value, (property, classmethod, staticmethod, functools.cached_property)):
            return self._callable(value)
        return self._object(value)

    def _array(self, x: Any) -> bytes:
        if x.dtype.hasobject:
            return _hash("objects", str(x.shape), self._items("objects", x.ravel().tolist()))
        held = np.ascontiguousarray(x).reshape(-1).view(np.uint8)  # not copied
        return _hash("array", repr(np.lib.format.dtype_to_descr(x.dtype)), str(x.shape), held.data)

    # -- functions and classes --------------------------------------------------------------------------------------

    def _callable(self, value: Any) -> bytes:
        stands = stands_for(value)
        if stands is not None and getattr(value, "__name__", None) in READERS:
            raise Unseen(f"is {value.__name__}, which reads what is not in the program")
        if isinstance(value, FunctionType):
            return self._function(value) if stands is None else _hash("installed", stands)
        if isinstance(value, types.MethodType):
            with self._asking({value.__func__.__name__}):
                return self._items("method", (value.__self__, value.__func__))
        if isinstance(value, (types.BuiltinFunctionType, types.MethodWrapperType)):
            owner = value.__self__
            if owner is not None and not isinstance(owner, ModuleType):
                return self._items("method", (owner, value.__name__))
        if isinstance(value, _DESCRIPTORS):
            return self._items("descriptor", (value.__objclass__, value.__name__))
        if isinstance(value, property):
            return self._items("property", (value.fget, value.fset, value.fdel))
        if isinstance(value, (classmethod, staticmethod)):
            return self._items(type(value).__name__, (value.__func__,))
        if isinstance(value, functools.cached_property):
            return self._items("cached_property", (value.func,))
        if isinstance(value, functools.partial):
            return self._items("partial", (value.func, value.args, value.keywords))
        if stands is not None:
            return _hash("installed", stands)
        if isinstance(value, _CACHED):
            return self._items("cached", (value.__wrapped__,))
        if type(value).__module__.startswith("numba.") and hasattr(value, "py_func"):
            return self._items("numba", (value.py_func, getattr(value, "targetoptions", None)))
        if isinstance(value, types.BuiltinFunctionType):
            raise Unseen(f"calls {value.__qualname__}, which is compiled")
        return self._object(value)

    @contextmanager
    def _asking(self, names: set[str]) -> Iterator[None]:
        self._asked.append(names)
        try:
            yield
        finally:
            self._asked.pop()

    def _function(self, f: FunctionType) -> bytes:
        with self._asking(attributes_in(source_of(f.__code__))):
            return self._looked_into(f)

    def _looked_into(self, f: FunctionType) -> bytes:
        node, ours = source_of(f.__code__), installed(f.__globals__.get("__name__")) is not None
        label = "" if f.__name__ == NAMELESS else f"{f.__name__}() "
        held = {f"{label}reads {k!r}": v for k, v in _cells(f).items()}
        parts = [canonical(node).encode(), self._all("closure", held)]
        parts += [self.of(f.__defaults__, label + "defaults"), self.of(f.__kwdefaults__, label + "defaults")]
        parts.append(self._all("attributes", {k: v for k, v in sorted(vars(f).items()) if k != "__wrapped__"}))
        if not ours:  # what an installed package reads is known by its version
            reader = reader_in(node)
            if reader is not None:
                raise Unseen(f"{label}reads with {reader}() what is not in the program")
            parts.append(self._globals(f, node, label))
        return _hash("function", *parts)

    def _globals(self, f: FunctionType, node: Function, label: str) -> bytes:
        """What a function reads from its module, and from those that it imports itself."""
        names: set[str] = set()
        for code in codes(f.__code__):
            for op in dis.get_instructions(code):
                if op.opname.startswith(("LOAD_GLOBAL", "LOAD_NAME", "LOAD_FROM_DICT_OR_GLOBALS")):
                    names.add(op.argval)
                elif op.opname == "STORE_GLOBAL" or (
                    op.opname == "STORE_DEREF" and op.argval in f.__code__.co_freevars
                ):
                    raise Unseen(f"{label}changes {op.argval!r}: it depends on what ran before")
        found = {k: f.__globals__.get(k, getattr(builtins, k, Ellipsis)) for k in sorted(names)}
        cells = {k: v for k, v in _cells(f).items() if not isinstance(v, ModuleType)}
        changed = changed_in(node, {k for k, v in found.items() if not isinstance(v, ModuleType)} | set(cells))
        if changed is not None:
            raise Unseen(f"{label}changes {changed!r}: it depends on what ran before")
        found |= self._imported(f, node)
        chains, out = chains_of(node), []
        for name, value in found.items():
            for path in sorted(chains.get(name, {()})) if isinstance(value, ModuleType) else [()]:
                at, said = value, name
                for part in path:
                    if not isinstance(at, ModuleType):
                        break
                    at, said = getattr(at, part, Ellipsis), f"{said}.{part}"
                out += [said.encode(), self.of(at, f"{label}reads {said!r}")]
        return _hash("globals", *out)

    def _imported(self, f: FunctionType, node: Function) -> dict[str, Any]:
        out: dict[str, Any] = {}
        for n in ast.walk(node):
            try:
                if isinstance(n, ast.Import):
                    for a in n.names:
                        module = importlib.import_module(a.name)
                        out[a.asname or a.name.partition(".")[0]] = module if a.asname else sys.modules[
                            a.name.partition(".")[0]]  # fmt: skip
                elif isinstance(n, ast.ImportFrom):
                    package = f.__globals__.get("__package__") or None
                    module = importlib.import_module("." * n.level + (n.module or ""), package)
                    out |= {a.asname or a.name: getattr(module, a.name) for a in n.names}
            except (ImportError, AttributeError):
                pass  # not there, as it may be meant
        return out

    def _class(self, cls: type) -> bytes:
        stands = installed(cls.__module__)
        if stands is not None:
            return _hash("class", stands, cls.__qualname__)
        if issubclass(cls, enum.Enum):
            held = {k: m._value_ for k, m in cls.__members__.items()}
            held |= {k: v for k, v in vars(cls).items() if isinstance(v, (FunctionType, property))}
        else:
            held = {k: v for k, v in vars(cls).items() if k not in _IDLE}
        if "__dataclass_fields__" in held:
            fields = held.pop("__dataclass_fields__").values()
            held["fields"] = [(x.name, _default(x.default), _default(x.default_factory), x.init) for x in fields]
        if "fields" in held or hasattr(cls, "_fields"):
            held = {k: v for k, v in held.items() if k not in _WRITTEN or not _sourceless(v)}
        bases = [b for b in cls.__bases__ if b is not object]
        return _hash("class", cls.__qualname__, self._items("bases", bases), self._all(cls.__name__, _sorted(held)))

    def _object(self, value: Any) -> bytes:
        kind = type(value)
        name = f"{kind.__module__}.{kind.__qualname__}".removeprefix("builtins.")
        if isinstance(value, enum.Enum):
            return self._items("member", (kind, value.name))
        if isinstance(value, _STATE) or hasattr(kind, "__next__"):
            raise Unseen(f"is a {name}, which changes when it is used")
        changing = _changing(kind, set().union(*self._asked))
        if changing is not None:
            raise Unseen(f"is a {name}, whose {changing}() changes it: it depends on what ran before")
        try:
            made = value.__reduce_ex__(4)
        except Exception as e:
            raise Unseen(f"is a {name}, which cannot be looked into ({e})") from None
        if isinstance(made, str):
            return _hash("global", kind.__module__, made)
        function, args, state, items, pairs = (*made, None, None, None)[:5]
        if isinstance(state, dict):  # what is only kept for speed
            state = {k: v for k, v in state.items()
                     if not isinstance(getattr(kind, str(k), None), functools.cached_property)}  # fmt: skip
        parts = [self.of(function), self.of(args), self.of(state)]
        parts += [self._items("items", items or ()), self._items("pairs", pairs or ())]
        return _hash("object", *parts)


def _cells(f: FunctionType) -> dict[str, Any]:
    """What a function's closure holds."""
    out: dict[str, Any] = {}
    for name, cell in zip(f.__code__.co_freevars, f.__closure__ or (), strict=True):
        try:
            out[name] = cell.cell_contents
        except ValueError:  # not assigned yet
            out[name] = Ellipsis
    return out


def _default(value: Any) -> Any:
    import dataclasses

    return "none" if value is dataclasses.MISSING else value


def _sourceless(value: Any) -> bool:
    value = getattr(value, "__func__", value)
    if not isinstance(value, FunctionType):
        return False
    try:
        inspect.findsource(inspect.unwrap(value).__code__)  # dataclasses wrap their __repr__
    except (OSError, TypeError, IndexError):
        return True
    return False


def _sorted(held: Mapping[str, Any]) -> dict[str, Any]:
    return {k: held[k] for k in sorted(held)}


def marks(parts: Mapping[str, Any], name: str | None = None) -> dict[str, str]:
    """A hash of each part, and flexarm's version.

    Args:
        parts: values by what they are called.
        name: what stands for all that cannot be looked into.

    Raises:
        ValueError: something cannot be looked into, and there is no name.
    """
    if name is not None and (not isinstance(name, str) or not name):
        raise ValueError(f"fingerprint = {name!r}: must be a name, such as 'gains of May'")
    look, named = _Look(name), {} if name is None else {"fingerprint": name}
    try:
        return {"flexarm": _core.__version__, **named, **{k: look.of(v, k).hex() for k, v in parts.items()}}
    except RecursionError:
        raise ValueError(f"out: {', '.join(parts)}: hold lists in lists, too deep to be looked into") from None


def difference(found: Any, mine: Mapping[str, str]) -> str:
    """What tells two marks apart, in words."""
    if not isinstance(found, Mapping):
        return "whose marks cannot be read"
    if found.get("flexarm") != mine["flexarm"]:
        return f"of flexarm {found.get('flexarm')}, this is {mine['flexarm']}"
    other = [k for k in {**found, **mine} if found.get(k) != mine.get(k)]
    return f"with another {', '.join(other[:4])}{', ...' if len(other) > 4 else ''}"
