"""docs/scene-reference.md, written from the grammar: python bench/run/scene_reference.py > docs/scene-reference.md"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from textwrap import dedent
from typing import Any, get_args, get_origin

from flexarm.model.parts.arguments import Argument, arguments, members, summary
from flexarm.model.parts.arguments import kinds as all_kinds
from flexarm.run.scene.grammar import SAMPLES, SIMULATION, SceneFile

HEAD = """# The scene file

Every table and key of a scene file, which `fa.load` and `flexarm run` read and `scene.save` writes. The file is
[TOML](https://toml.io); [ist.toml](../python/flexarm/scenes/ist.toml) is one. SI units and radians throughout. A table
holds the arguments of the class made from it: the text here under `beam` is that of `help(fa.Beam)`. Arguments that are
not required may be left out, which means None. Callables are for Python only. C++ reads the output of `flexarm
compile`: [cpp.md](cpp.md#scenes).

**Samples** are laws of time, in place, `torque = { t = [0, 1], tau = [0, 2] }`, or in a file of comma-separated values
whose first line names the columns, `torque = { file = "torque.csv" }`; see `fa.load` for where that file may be.

Written by `python bench/run/scene_reference.py`; do not edit.
"""

_Group = tuple[type, ...]  # the class of a table, or several that its type or keys distinguish
_Groups = Mapping[_Group, Sequence[str]]  # with the keys of each group


def kinds(*bases: type) -> dict[str, type]:
    """Subclasses by name, of flexarm's own only: users may have defined others."""
    return {kind: cls for kind, cls in all_kinds(*bases).items() if cls.__module__.startswith("flexarm.")}


def _home(group: _Group, groups: Iterable[_Group]) -> _Group:
    """The group that explains a group: itself, or another with all its kinds."""
    own = kinds(*group).items()
    return next((other for other in groups if own and own <= kinds(*other).items()), group)


def _found(rows: Iterable[Argument], groups: dict[_Group, list[str]]) -> None:
    """Collects all groups reachable from some arguments, with their names."""
    for argument in rows:
        if argument.parts and argument.name not in SAMPLES:
            group = _home(argument.parts, groups)
            new = group not in groups
            names = groups.setdefault(group, [])
            names += [] if argument.name in names else [argument.name]
            for cls in (*group, *kinds(*group).values()) if new else ():
                _found(arguments(cls).values(), groups)


def _title(group: _Group, names: Iterable[str]) -> str:
    one = len(group) == 1 and not kinds(*group)
    return ", ".join(sorted(names, key=len)) + (f": {group[0].__name__}" if one else "")


def _link(words: str, title: str) -> str:
    return f"[{words}](#{re.sub('[^a-z_ -]', '', title.lower()).replace(' ', '-')})"


def _words(hint: Any) -> str:
    """A type in the words of a file."""
    known = {bool: "true or false", int: "whole number", float: "number", str: "text", Any: "", type(None): ""}
    inside = list(members(hint, deep=False))
    if any(getattr(h, "__module__", "").startswith("numpy") for h in inside):
        return "numbers"  # ArrayLike
    words = []
    for h in inside:
        origin = get_origin(h)
        if origin is Sequence:
            words.append({"number": "numbers", "text": "texts"}.get(_words(get_args(h)[0]), "list"))
        else:
            words.append("table" if origin is Mapping else known.get(h, ""))
    return " or ".join(dict.fromkeys(filter(None, words)))


def _default(argument: Argument) -> str:
    value = argument.default
    if argument.required:
        return "required"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (tuple, list)):
        return "[" + ", ".join(f"{x:g}" for x in value) + "]" if value else ""
    return f"{value:.6g}" if isinstance(value, (int, float)) else f'"{value}"' if isinstance(value, str) else ""


def _names(columns: Sequence[str]) -> str:
    return ", ".join(f"`{c}`" for c in columns)


def _takes(argument: Argument, groups: _Groups) -> str:
    """The values that a key takes."""
    if argument.name in SAMPLES:
        law = SAMPLES[argument.name]
        text = ("number, or " if len(law.columns) == 2 else "") + "samples " + _names(law.columns)
        motion = f"; or a motion: samples {_names(SAMPLES['motion'].columns)}, or `spin_up`" if law.moves else ""
        return text + motion
    if argument.parts:
        group = _home(argument.parts, groups)
        title = _title(group, groups[group])
        if argument.many:
            return "list of " + _link("tables", title)
        return ("number, or " if argument.number else "") + _link("table", title)
    return _words(argument.hint)


def _rows(rows: Iterable[Argument], groups: _Groups) -> Iterator[str]:
    """The rows of a table of arguments; arguments with a common text share a row if possible."""
    yield from ("", "| key | value | default | |", "|-|-|-|-|")
    told: dict[str, str] = {}
    for (meaning, takes, default), alike in groupby(rows, lambda a: (a.meaning, _takes(a, groups), _default(a))):
        names = ", ".join(f"`{a.name}`" for a in alike)
        before = told.setdefault(meaning, names)
        text = meaning if before == names or len(meaning) < 60 else f"see {before}."
        yield "| " + " | ".join(cell.replace("|", "\\|") for cell in (names, takes, default, text)) + " |"


def _prose(make: Any) -> str:
    """The summary of a docstring; indented text, such as a formula, is fenced."""
    return re.sub(r"\n\n((?:    .*\n)+)", lambda m: f"\n\n```text\n{dedent(m[1])}```\n", summary(make))


def _section(group: _Group, groups: _Groups) -> Iterator[str]:
    """The section of one group."""
    known = kinds(*group)
    shared = arguments(group[0]) if known and len(group) == 1 else {}
    if known and len(group) == 1:
        yield from ("", _prose(group[0]))
        if shared:
            yield from _rows(shared.values(), groups)
    for kind, cls in known.items() or ((None, c) for c in group):
        own = [a for name, a in arguments(cls).items() if name not in shared]
        yield from ("", f'**`type = "{kind}"`** {_prose(cls)}' if kind else _prose(cls))
        if own:
            yield from _rows(own, groups)


def page() -> str:
    """The page, in Markdown."""
    top = arguments(SceneFile)
    groups: dict[_Group, list[str]] = {}
    _found(top.values(), groups)
    lines = ["## The file", *_rows(top.values(), groups)]
    for group, names in groups.items():
        first = any(name in top for name in names)
        lines += ["", f"{'##' if first else '###'} {_title(group, names)}", *_section(group, groups)]
    lines += ["", "## simulation", "", "The output times, and options of `fa.simulate`."]
    lines += _rows(SIMULATION.values(), groups)
    return HEAD + "\n" + "\n".join(lines) + "\n"


if __name__ == "__main__":
    print(page(), end="")
