"""The arguments of a class or a function: names, types, defaults and meanings, from its signature and docstring.

This is the grammar of scene files: each table holds the arguments of one class. Reading and writing of files, the
nearest key in their errors, and docs/scene-reference.md are all derived from here.
"""

from __future__ import annotations

import inspect
import re
import textwrap
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, is_dataclass
from functools import cache
from itertools import zip_longest
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

_BLOCK = re.compile(r"^(?:Args|Attributes):\n((?: .*\n|\n)*)", re.M)


@dataclass(frozen=True)
class Argument:
    """One argument: its annotated type, its default (`inspect.Parameter.empty`: none), and its meaning from the
    docstring."""

    name: str
    hint: Any
    default: Any
    meaning: str

    @property
    def required(self) -> bool:
        return self.default is inspect.Parameter.empty

    @property
    def parts(self) -> tuple[type, ...]:
        """The flexarm classes it accepts: in a file, a table."""
        return _own(self.hint)

    @property
    def number(self) -> bool:
        """Whether it accepts a single number."""
        return float in members(self.hint, deep=False)

    @property
    def text(self) -> bool:
        """Whether it accepts a text."""
        return str in members(self.hint, deep=False)

    @property
    def many(self) -> bool:
        """Whether it accepts a sequence of `parts`: in a file, a list of tables."""
        return any(get_origin(h) is Sequence and _own(h) for h in members(self.hint, deep=False))


def _own(hint: Any) -> tuple[type, ...]:
    package = __name__.partition(".")[0] + "."
    return tuple(h for h in members(hint) if isinstance(h, type) and h.__module__.startswith(package))


def members(hint: Any, deep: bool = True) -> Iterator[Any]:
    """The types that a union allows, without their annotations; if deep, with those of the entries of its lists."""
    for kind in alternatives(hint):
        if get_origin(kind) is Annotated:
            yield from members(kind.__origin__, deep)
        elif deep and get_origin(kind) is Sequence:
            yield from members(get_args(kind)[0])
        else:
            yield kind


def alternatives(hint: Any) -> tuple[Any, ...]:
    """The types of a union, annotated as they are."""
    return get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)


@cache
def arguments(make: Callable[..., Any]) -> dict[str, Argument]:
    """The arguments of a class or a function, by name."""
    parameters = inspect.signature(make).parameters
    by_init = isinstance(make, type) and not is_dataclass(make)
    try:
        hints = get_type_hints(make.__init__ if by_init else make, include_extras=True)
    except NameError:  # a user's class may import names for typing only
        hints = {}
    docs = [c.__doc__ or "" for c in (make.__mro__[::-1] if isinstance(make, type) else (make,))]  # base classes first
    meanings = {name: text for doc in docs for name, text in _meanings(doc, tuple(parameters)).items()}
    return {k: Argument(k, hints.get(k, Any), p.default, meanings.get(k, "")) for k, p in parameters.items()}


@cache
def summary(make: Callable[..., Any]) -> str:
    """The part of its docstring ahead of the arguments."""
    return re.split(r"^(?:Args|Attributes|Raises):$", inspect.cleandoc(make.__doc__ or ""), flags=re.M)[0].strip()


def kinds(*bases: type) -> dict[str, type]:
    """These classes and all their subclasses with a `type` of their own, by that type."""
    found: dict[str, type] = {}
    for base in bases:
        if base.__dict__.get("type"):
            found[base.type] = base  # type: ignore[attr-defined]
        found |= kinds(*base.__subclasses__())
    return found


def _block(doc: str) -> str:
    """The entries below "Args:", one a line; continuation lines are indented."""
    found = _BLOCK.search(inspect.cleandoc(doc) + "\n")
    return textwrap.dedent(found[1]).strip("\n") if found else ""


def _meanings(doc: str, names: Sequence[str]) -> dict[str, str]:
    """The meanings by name, from "a, b: text"; one line may hold several: "a: text. b: text"."""
    text = re.sub(r"\n +", " ", _block(doc))
    one = "|".join(names)
    heads = list(re.finditer(rf"(?:^|(?<=\. ))((?:{one})(?:, (?:{one}))*): ", text, re.M)) if names else []
    out: dict[str, str] = {}
    for head, after in zip_longest(heads, heads[1:]):
        meaning = text[head.end() : after.start() if after else None].partition("\n")[0].strip()
        out.update(dict.fromkeys(head[1].split(", "), meaning))
    return out


def with_inherited(cls: type) -> str | None:
    """The docstring of a class, with the entries of the arguments that it inherits."""
    doc = cls.__dict__.get("__doc__")
    if not doc:
        return None
    explained = set(re.findall(r"\w+(?=(?:, \w+)*: )", _block(doc)))
    more = []
    for base in cls.__mro__[1:]:
        for entry in filter(None, re.split(r"\n(?! )", _block(base.__doc__ or ""))):
            names = entry.partition(": ")[0].split(", ")
            if explained.isdisjoint(names):
                more.append(entry)
                explained.update(names)
    if not more:
        return str(doc)
    doc, new = inspect.cleandoc(doc) + "\n", textwrap.indent("\n".join(more), "    ") + "\n"
    found = _BLOCK.search(doc)
    if not found:
        return f"{doc}\nArgs:\n{new}"
    rest = doc[found.end() :]
    return doc[: found.end()].rstrip() + "\n" + new + ("\n" + rest if rest else "")
