"""What `dir(fa)` and `help(fa)` show: a user's names, all of them, on two screens."""

import inspect
import pydoc
import re
from dataclasses import fields, is_dataclass
from types import ModuleType
from typing import Any

import flexarm as fa
import pytest

NAMES = [name for name in dir(fa) if name != "__version__"]
ACCEPTED = [name for name in NAMES if not issubclass(type(getattr(fa, name)), type)]
ACCEPTED += [name for name in NAMES if name not in ACCEPTED and not issubclass(getattr(fa, name), BaseException)]


def test_dir_shows_public_names_alone() -> None:
    assert not [name for name in NAMES if name.startswith("_") or isinstance(getattr(fa, name), ModuleType)]
    assert {"Arm", "simulate", "rollout", "RangeWarning"} <= set(NAMES) and fa.__version__
    room: dict[str, Any] = {}
    exec("from flexarm import *", room)
    assert set(NAMES) <= set(room)


def test_help_is_a_map_of_two_screens() -> None:
    lines = pydoc.plain(pydoc.render_doc(fa)).splitlines()
    assert len(lines) <= 107 and max(map(len, lines)) <= 124
    assert fa.__doc__
    words = set(re.findall(r"\w+", fa.__doc__))
    assert set(NAMES) <= words, "names that the docstring of flexarm does not list"
    meant = {w for w in words if re.search("[a-z][A-Z]", w)} - {"ValueError"}
    assert meant <= set(NAMES), "names that the docstring lists and flexarm does not have"


@pytest.mark.parametrize("name", sorted(ACCEPTED))
def test_arguments_are_explained(name: str) -> None:
    """Of functions and of the classes a user makes; what a class does not show of itself is no user's."""
    what = getattr(fa, name)
    shown = set(inspect.signature(what).parameters)
    if is_dataclass(what):
        shown -= {f.name for f in fields(what) if not f.repr}
    words = set(re.findall(r"\w+", inspect.getdoc(what) or ""))
    assert not {p for p in shown if not p.startswith("_")} - words
