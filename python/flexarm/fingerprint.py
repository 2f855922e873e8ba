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
import sysconfig
import time
import types
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

from . import _core

_BEGUN = time.time()  # what is edited after this may not be what runs

_NAMELESS = "<lambda>"
_Function = ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda

#: read what is not in the program
_OUTSIDE: tuple[Any, ...] = (
    open, input, eval, exec, globals, time.time, time.perf_counter, time.monotonic, os.urandom, os.getenv,
    np.load, np.loadtxt, np.genfromtxt, np.fromfile, np.memmap,
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
_MAKING = frozenset("__init__ __new__ __post_init__ __setstate__ __set_name__ __init_subclass__".split())
#: methods that change what they are of, as those of lists, sets and dictionaries
_CHANGES = frozenset(
    "append appendleft extend insert pop popleft popitem remove discard add clear update setdefault reverse sort "
    "rotate fill".split()
)
_UNMEANT = frozenset("type_comment kind ctx returns annotation type_params".split())


class _Unseen(Exception):
    """What cannot be looked into, in words."""


# -- source -------------------------------------------------------------------------------------------------


def _canonical(node: Any) -> str:
    """A syntax tree in words that do not change from one Python to the next, as those of ast.dump do."""
    if isinstance(node, list):
        return f"[{','.join(map(_canonical, node))}]"
    if not isinstance(node, ast.AST):
        return hex(node) if type(node) is int else f"{type(node).__name__}:{node!r}"
    fields = [(k, v) for k, v in ast.iter_fields(node) if k not in _UNMEANT and v is not None and v != []]
    if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)) and ast.get_docstring(node) is not None:
        fields = [(k, v[1:] if k == "body" else v) for k, v in fields]
    return f"{type(node).__name__}({','.join(f'{k}={_canonical(v)}' for k, v in fields)})"


@functools.lru_cache(64)
def _functions(text: str) -> dict[tuple[int, str], list[_Function]]:
    """All functions of a source text by their first line and name."""
    out: dict[tuple[int, str], list[_Function]] = {}
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Lambda):
            out.setdefault((node.lineno, _NAMELESS), []).append(node)
        elif isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            first = min([node.lineno, *(d.lineno for d in node.decorator_list)])
            out.setdefault((first, node.name), []).append(node)
    return out


def _codes(code: CodeType) -> Iterator[CodeType]:
    """A function's code and that of all inside it."""
    yield code
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            yield from _codes(inner)


def _around(code: CodeType, node: Any) -> bool:
    """Whether all of a code stands within a lambda's body (columns are known from Python 3.11 on)."""
    body = node.body
    begin, end = (body.lineno, body.col_offset), (body.end_lineno, body.end_col_offset)
    places = [p for p in getattr(code, "co_positions", tuple)() if None not in p and p[3] != 0]
    return bool(places) and all(begin <= (p[0], p[2]) and (p[1], p[3]) <= end for p in places)


def _source(code: CodeType) -> _Function:
    """The syntax tree of a function."""
    try:
        text = "".join(inspect.findsource(code)[0])
        found = _functions(text).get((code.co_firstlineno, code.co_name), [])
    except (OSError, TypeError, IndexError, SyntaxError, ValueError):
        raise _Unseen("has no source to be read (put it into a file)") from None
    edited = os.path.exists(code.co_filename) and os.path.getmtime(code.co_filename) > _BEGUN
    if edited and code not in _codes(compile(text, code.co_filename, "exec", dont_inherit=True)):
        found = []
    found = [node for node in found if [a.arg for a in (*node.args.posonlyargs, *node.args.args)]
             == list(code.co_varnames[: code.co_argcount])]  # fmt: skip
    if len({_canonical(node) for node in found}) > 1:
        found = [node for node in found if _around(code, node)]
        if found:  # of lambdas in lambdas, the innermost
            last = max((node.body.lineno, node.body.col_offset) for node in found)  # type: ignore[union-attr]
            found = [n for n in found if (n.body.lineno, n.body.col_offset) == last]  # type: ignore[union-attr]
        if len(found) != 1:
            raise _Unseen("is one of several lambdas on one line of source (put each on its own)")
    if not found:
        raise _Unseen("is not in its source file any more, which was edited since (start Python anew)")
    return found[0]


def _root(node: ast.AST) -> str | None:
    """The name that x.y, x[0] and the like begin with."""
    while isinstance(node, (ast.Attribute, ast.Subscript)):
        node = node.value
    return node.id if isinstance(node, ast.Name) else None


def _changed(node: ast.AST, names: Iterable[str]) -> str | None:
    """The first of these names whose object is changed: x.y = 1, x[0] += 1, x.append(1)."""
    for n in ast.walk(node):
        of: ast.AST | None = None
        if isinstance(n, (ast.Attribute, ast.Subscript)) and not isinstance(n.ctx, ast.Load):
            of = n
        elif isinstance(n, ast.Call) and isinstance(n.func, ast.Attribute) and n.func.attr in _CHANGES:
            of = n.func
        found = None if of is None else _root(of)
        if found is not None and found in names:
            return found
    return None


def _chains(node: ast.AST) -> dict[str, set[tuple[str, ...]]]:
    """By each name, what is asked of it: ("random", "normal") of np.random.normal; () where it stands alone."""
    out: dict[str, set[tuple[str, ...]]] = {}

    def walk(x: ast.AST) -> None:
        path: tuple[str, ...] = ()
        inner = x
        while isinstance(inner, ast.Attribute):
            path, inner = (inner.attr, *path), inner.value
        if isinstance(inner, ast.Name):
            out.setdefault(inner.id, set()).add(path)
            return
        for child in ast.iter_child_nodes(inner):
            walk(child)

    walk(node)
    return out


# -- packages -----------------------------------------------------------------------------------------------


@functools.cache
def _release(root: str) -> str | None:
    """"" of Python's own modules, the version of an installed package, None of what can change without a new one."""
    if root in ("flexarm", "__main__"):
        return _core.__version__ if root == "flexarm" else None
    module = sys.modules.get(root)
    file = getattr(module, "__file__", None) or next(iter(getattr(module, "__path__", ())), None)
    if file is None:
        return "" if root in sys.stdlib_module_names else None
    where = Path(file).resolve()
    if not {"site-packages", "dist-packages"} & set(where.parts):
        own = {Path(sysconfig.get_path(k)).resolve() for k in ("stdlib", "platstdlib")}
        return "" if root in sys.stdlib_module_names and own & set(where.parents) else None
    try:
        return importlib.metadata.version(root)
    except importlib.metadata.PackageNotFoundError:
        names = importlib.metadata.packages_distributions().get(root, ())
        return importlib.metadata.version(names[0]) if names else getattr(module, "__version__", None)


def _installed(module: Any) -> str | None:
    """What stands for an installed module or what is in it, or None: its name and version."""
    if not isinstance(module, str):
        return None
    version = _release(module.partition(".")[0])
    return None if version is None else f"{module} {version}"


def _named(value: Any) -> str | None:
    """What stands for a thing that an installed module has under its own name."""
    module, name = getattr(value, "__module__", None), getattr(value, "__qualname__", getattr(value, "__name__", None))
    if not isinstance(name, str):
        return None
    if isinstance(value, np.ufunc):
        module = next((m for m in ("numpy", "scipy.special") if getattr(sys.modules.get(m), name, None) is value), None)
    at: Any = sys.modules.get(module) if isinstance(module, str) else None
    for part in name.split("."):
        at = getattr(at, part, None)
    return f"{_installed(module)}: {name}" if at is value and _installed(module) is not None else None


# -- values -------------------------------------------------------------------------------------------------


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


def _attributes_changed(method: FunctionType) -> bool:
    """Whether a method changes the object that it is of."""
    code, own = method.__code__, method.__code__.co_varnames[:1]
    return bool(own) and method.__name__ not in _MAKING and _changed(_source(code), own) is not None


class _Look:
    """Hashes of values. What cannot be looked into is refused, or counts by the user's name for it."""

    def __init__(self, name: str | None) -> None:
        self.name = name
        self._known: dict[int, tuple[Any, bytes]] = {}  # the values too, so that no id comes again
        self._stack: list[int] = []
        self._trail: list[str] = []

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
        except _Unseen as e:
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
            raise _Unseen(f"reads with {value.__name__}() what is not in the program")
        if isinstance(value, ModuleType):
            stands = _installed(value.__name__)
            if stands is None:
                raise _Unseen(f"uses the module {value.__name__} as a whole (name what it takes from there)")
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
        stands = _named(value)
        if isinstance(value, FunctionType):
            return self._function(value) if stands is None else _hash("installed", stands)
        if isinstance(value, types.MethodType):
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
            raise _Unseen(f"calls {value.__qualname__}, which is compiled")
        return self._object(value)

    def _function(self, f: FunctionType) -> bytes:
        node, ours = _source(f.__code__), _installed(f.__globals__.get("__name__")) is not None
        label = "" if f.__name__ == _NAMELESS else f"{f.__name__}() "
        held = {f"{label}reads {k!r}": v for k, v in _cells(f).items()}
        parts = [_canonical(node).encode(), self._all("closure", held)]
        parts += [self.of(f.__defaults__, label + "defaults"), self.of(f.__kwdefaults__, label + "defaults")]
        parts.append(self._all("attributes", {k: v for k, v in sorted(vars(f).items()) if k != "__wrapped__"}))
        if not ours:  # what an installed package reads is known by its version
            parts.append(self._globals(f, node, label))
        return _hash("function", *parts)

    def _globals(self, f: FunctionType, node: _Function, label: str) -> bytes:
        """What a function reads from its module, and from those that it imports itself."""
        names: set[str] = set()
        for code in _codes(f.__code__):
            for op in dis.get_instructions(code):
                if op.opname.startswith(("LOAD_GLOBAL", "LOAD_NAME", "LOAD_FROM_DICT_OR_GLOBALS")):
                    names.add(op.argval)
                elif op.opname == "STORE_GLOBAL" or (
                    op.opname == "STORE_DEREF" and op.argval in f.__code__.co_freevars
                ):
                    raise _Unseen(f"{label}changes {op.argval!r}: it depends on what ran before")
        found = {k: f.__globals__.get(k, getattr(builtins, k, Ellipsis)) for k in sorted(names)}
        cells = {k: v for k, v in _cells(f).items() if not isinstance(v, ModuleType)}
        changed = _changed(node, {k for k, v in found.items() if not isinstance(v, ModuleType)} | set(cells))
        if changed is not None:
            raise _Unseen(f"{label}changes {changed!r}: it depends on what ran before")
        found |= self._imported(f, node)
        chains, out = _chains(node), []
        for name, value in found.items():
            for path in sorted(chains.get(name, {()})) if isinstance(value, ModuleType) else [()]:
                at, said = value, name
                for part in path:
                    if not isinstance(at, ModuleType):
                        break
                    at, said = getattr(at, part, Ellipsis), f"{said}.{part}"
                out += [said.encode(), self.of(at, f"{label}reads {said!r}")]
        return _hash("globals", *out)

    def _imported(self, f: FunctionType, node: _Function) -> dict[str, Any]:
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
        stands = _installed(cls.__module__)
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
            raise _Unseen(f"is a {name}, which changes when it is used")
        for cls in kind.__mro__:
            for method in vars(cls).values() if _installed(cls.__module__) is None else ():
                if isinstance(method, FunctionType) and not _sourceless(method) and _attributes_changed(method):
                    raise _Unseen(f"is a {name}, whose {method.__name__}() changes it: it depends on what ran before")
        try:
            made = value.__reduce_ex__(4)
        except Exception as e:
            raise _Unseen(f"is a {name}, which cannot be looked into ({e})") from None
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
    look = _Look(name)
    return {
        "flexarm": _core.__version__, **({} if name is None else {"fingerprint": name}),
        **{k: look.of(v, k).hex() for k, v in parts.items()},
    }  # fmt: skip


def difference(found: Any, mine: Mapping[str, str]) -> str:
    """What tells two marks apart, in words."""
    if not isinstance(found, Mapping):
        return "whose marks cannot be read"
    if found.get("flexarm") != mine["flexarm"]:
        return f"of flexarm {found.get('flexarm')}, this is {mine['flexarm']}"
    other = [k for k in {**found, **mine} if found.get(k) != mine.get(k)]
    return f"with another {', '.join(other[:4])}{', ...' if len(other) > 4 else ''}"
