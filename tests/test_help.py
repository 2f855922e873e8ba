"""`dir(fa)` and `help(fa)` show the public names, all of them; old names tell the new ones."""

import inspect
import pydoc
import re
import subprocess
import sys
from dataclasses import fields, is_dataclass
from functools import reduce
from types import ModuleType
from typing import Any

import flexarm as fa
import pytest
from messages import refuses
from public import LISTS, names

NAMES = {module: names(module) for module in LISTS}
ALL = {name: thing for names in NAMES.values() for name, thing in names.items()}
ACCEPTED = [name for name, thing in ALL.items() if not (isinstance(thing, type) and issubclass(thing, BaseException))]


def test_dir_shows_public_names_alone() -> None:
    assert set(dir(fa)) == {*NAMES[fa], "sections", "sensors", "results", "errors", "__version__"}
    assert {"Arm", "simulate", "rollout", "SimulationError"} <= set(NAMES[fa]) and fa.__version__
    room: dict[str, Any] = {}
    exec("from flexarm import *", room)
    assert set(NAMES[fa]) <= set(room)
    import flexarm.sensors

    assert flexarm.sensors.Encoder is fa.sensors.Encoder


def test_a_name_stands_in_one_list() -> None:
    """But for the commonest sections, which are names of flexarm as well, and for a box: a section, or what an arm
    touches."""
    both = {"Rectangle", "Circle", "Tube", "SectionMatrix", "Box"}
    assert set(NAMES[fa]) & set(NAMES[fa.sections]) == both and fa.Box is not fa.sections.Box
    assert sum(len(names) for names in NAMES.values()) == len(ALL) + 5
    warn = {name for name, thing in ALL.items() if isinstance(thing, type) and issubclass(thing, BaseException)}
    assert warn - {"SimulationError"} == set(NAMES[fa.errors])


@pytest.mark.parametrize("module", LISTS, ids=lambda module: module.__name__)
def test_help_is_a_map_of_the_names(module: ModuleType) -> None:
    """A line for each, with the first sentence of its docstring, in the width of a terminal."""
    lines = pydoc.plain(pydoc.render_doc(module)).splitlines()
    assert max(map(len, lines)) <= 124 and len(lines) <= 170
    told = dict(re.findall(r"^ {4,8}(\w+) +(\S.*)$", "\n".join(lines), re.MULTILINE))
    assert set(NAMES[module]) <= set(told)
    assert not [name for name in NAMES[module] if re.search(r"\b(Eq|Sec|Fig|al)$|^What", told[name])]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("Encoder", "sensors.Encoder"),
        ("RangeWarning", "errors.RangeWarning"),
        ("WatchWarning", "errors.RangeWarning"),
        ("Modes", "results.Modes"),
        ("Plan", "results.ModelPlan"),
        ("PulseWarning", "errors.StepWarning"),
        ("Sweep", "SweepPlan"),
        ("load_data", "Data.load"),
        ("load_sweep", "SweepPlan.load"),
        ("placement", "place_patch"),
    ],
)
def test_an_old_name_tells_the_new_one(old: str, new: str) -> None:
    assert reduce(getattr, new.split("."), fa) and not hasattr(fa, old) and (old not in ALL or new.endswith(f".{old}"))
    with refuses(f"'{old}'", f"fa.{new}", error=AttributeError):
        getattr(fa, old)
    with refuses(f"'{old}'", f"fa.{new}", error=ImportError):
        exec(f"from flexarm import {old}")
    with refuses("'Nothing'", error=AttributeError):
        _ = fa.Nothing


def test_without_docstrings_the_names_are_left() -> None:
    code = "import flexarm as fa; assert fa.__doc__.count('Arm') and fa.errors.__doc__"
    subprocess.run([sys.executable, "-OO", "-c", code], check=True)


@pytest.mark.parametrize("name", sorted(ACCEPTED))
def test_arguments_are_explained(name: str) -> None:
    """Of functions and of the classes a user makes; what a class does not show of itself is no user's."""
    what = ALL[name]
    shown = set(inspect.signature(what).parameters)
    if is_dataclass(what):
        shown -= {f.name for f in fields(what) if not f.repr}
    words = set(re.findall(r"\w+", inspect.getdoc(what) or ""))
    assert not {p for p in shown if not p.startswith("_")} - words
