"""The source of functions: what it says, what it reads, and whose it is."""

from __future__ import annotations

import ast
import functools
import importlib.metadata
import inspect
import os
import sys
import sysconfig
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import CodeType
from typing import Any

import numpy as np

import flexarm._core as _core

_BEGUN = time.time()  # what is edited after this may not be what runs

NAMELESS = "<lambda>"
Function = ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda

#: methods that change what they are of, as those of lists, sets and dictionaries
_CHANGES = frozenset(
    "append appendleft extend insert pop popleft popitem remove discard add clear update setdefault reverse sort "
    "rotate fill".split()
)
#: methods, and functions of packages, that read what is not in the program: files and clocks
READERS = frozenset(
    "open read_text read_bytes read_csv read_table read_json read_excel read_hdf read_parquet read_pickle loadmat "
    "imread now utcnow today".split()
)
_UNMEANT = frozenset("type_comment kind ctx returns annotation type_params".split())


class Unseen(Exception):
    """What cannot be looked into, in words."""

def canonical(node: Any) -> str:
    """A syntax tree in words that do not change from one Python to the next, as those of ast.dump do."""
    if isinstance(node, list):
        return f"[{','.join(map(canonical, node))}]"
    if not isinstance(node, ast.AST):
        return hex(node) if type(node) is int else f"{type(node).__name__}:{node!r}"
    fields = [(k, v) for k, v in ast.iter_fields(node) if k not in _UNMEANT and v is not None and v != []]
    if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)) and ast.get_docstring(node) is not None:
        fields = [(k, v[1:] if k == "body" else v) for k, v in fields]
    return f"{type(node).__name__}({','.join(f'{k}={canonical(v)}' for k, v in fields)})"


@functools.lru_cache(64)
def _functions(text: str) -> dict[tuple[int, str], list[Function]]:
    """All functions of a source text by their first line and name."""
    out: dict[tuple[int, str], list[Function]] = {}
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Lambda):
            out.setdefault((node.lineno, NAMELESS), []).append(node)
        elif isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            first = min([node.lineno, *(d.lineno for d in node.decorator_list)])
            out.setdefault((first, node.name), []).append(node)
    return out


def codes(code: CodeType) -> Iterator[CodeType]:
    """A function's code and that of all inside it."""
    yield code
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            yield from codes(inner)


def _around(code: CodeType, node: Any) -> bool:
    """Whether all of a code stands within a lambda's body (columns are known from Python 3.11 on)."""
    body = node.body
    begin, end = (body.lineno, body.col_offset), (body.end_lineno, body.end_col_offset)
    places = [p for p in getattr(code, "co_positions", tuple)() if None not in p and p[3] != 0]
    return bool(places) and all(begin <= (p[0], p[2]) and (p[1], p[3]) <= end for p in places)


def source_of(code: CodeType) -> Function:
    """The syntax tree of a function."""
    try:
        text = "".join(inspect.findsource(code)[0])
        found = _functions(text).get((code.co_firstlineno, code.co_name), [])
    except (OSError, TypeError, IndexError, SyntaxError, ValueError):
        raise Unseen("has no source to be read (put it into a file)") from None
    edited = os.path.exists(code.co_filename) and os.path.getmtime(code.co_filename) > _BEGUN
    if edited and code not in codes(compile(text, code.co_filename, "exec", dont_inherit=True)):
        found = []
    found = [node for node in found if [a.arg for a in (*node.args.posonlyargs, *node.args.args)]
             == list(code.co_varnames[: code.co_argcount])]  # fmt: skip
    if len({canonical(node) for node in found}) > 1:
        found = [node for node in found if _around(code, node)]
        if found:  # of lambdas in lambdas, the innermost
            last = max((node.body.lineno, node.body.col_offset) for node in found)  # type: ignore[union-attr]
            found = [n for n in found if (n.body.lineno, n.body.col_offset) == last]  # type: ignore[union-attr]
        if len(found) != 1:
            raise Unseen("is one of several lambdas on one line of source (put each on its own)")
    if not found:
        raise Unseen("is not in its source file any more, which was edited since (start Python anew)")
    return found[0]


def _root(node: ast.AST) -> str | None:
    """The name that x.y, x[0] and the like begin with."""
    while isinstance(node, (ast.Attribute, ast.Subscript)):
        node = node.value
    return node.id if isinstance(node, ast.Name) else None


def changed_in(node: ast.AST, names: Iterable[str]) -> str | None:
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


def attributes_in(node: ast.AST) -> set[str]:
    """The names of all attributes that are asked for."""
    return {n.attr for n in ast.walk(node) if isinstance(n, ast.Attribute)}


def reader_in(node: ast.AST) -> str | None:
    """The first of READERS that is called of something that is not the function's own object: x.read_text()."""
    own = getattr(node, "args", None)
    first = own.args[0].arg if own is not None and own.args else None
    for n in ast.walk(node):
        if isinstance(n, ast.Call) and isinstance(n.func, ast.Attribute) and n.func.attr in READERS:
            if not (isinstance(n.func.value, ast.Name) and n.func.value.id == first):
                return n.func.attr
    return None


def chains_of(node: ast.AST) -> dict[str, set[tuple[str, ...]]]:
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


def installed(module: Any) -> str | None:
    """What stands for an installed module or what is in it, or None: its name and version."""
    if not isinstance(module, str):
        return None
    version = _release(module.partition(".")[0])
    return None if version is None else f"{module} {version}"


def stands_for(value: Any) -> str | None:
    """What stands for a thing that an installed module has under its own name."""
    module, name = getattr(value, "__module__", None), getattr(value, "__qualname__", getattr(value, "__name__", None))
    if not isinstance(name, str):
        return None
    if isinstance(value, np.ufunc):
        module = next((m for m in ("numpy", "scipy.special") if getattr(sys.modules.get(m), name, None) is value), None)
    at: Any = sys.modules.get(module) if isinstance(module, str) else None
    for part in name.split("."):
        at = getattr(at, part, None)
    return f"{installed(module)}: {name}" if at is value and installed(module) is not None else None
