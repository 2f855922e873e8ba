"""The public names: the map of them that `help` shows, made from the lists of imports, and the ways to renamed ones."""

import re
import sys
from types import ModuleType
from typing import Any

#: Modules that list public names, beside flexarm itself.
LISTS = ("sections", "sensors", "results", "errors")

#: Headings of the map, with the rooms whose names stand below them.
HEADINGS = {
    "Parts of an arm": ("arm.", "model.parts.", "robots."),
    "What acts on it": ("model.acting.",),
    "Scenes and robots": ("run.scene.",),
    "One run": ("run.", "view.", "live."),
    "Analysis": ("analysis.", "loop."),
    "Commands": ("command.",),
    "Data and estimation": ("data.", "estimate.", "identify."),
    "Many runs": ("many.",),
    "Which model": ("choose.",),
}

_RENAMED = {
    "Plan": "results.ModelPlan",
    "PulseWarning": "errors.StepWarning",
    "Sweep": "SweepPlan",
    "WatchWarning": "errors.RangeWarning",
    "load_data": "Data.load",
    "load_sweep": "SweepPlan.load",
    "placement": "place_patch",
}


def public(module: ModuleType) -> dict[str, Any]:
    """The public names of a module, in the order of its imports, without the package's rooms."""
    return {name: x for name, x in vars(module).items() if name[0] != "_" and not isinstance(x, ModuleType)}


def grouped(module: ModuleType) -> dict[str, list[str]]:
    """The public names of a module by heading."""
    found: dict[str, list[str]] = {heading: [] for heading in HEADINGS}
    for name, thing in public(module).items():
        room = thing.__module__.removeprefix("flexarm.")
        found[next(heading for heading, rooms in HEADINGS.items() if room.startswith(rooms))].append(name)
    return {heading: listed for heading, listed in found.items() if listed}


def sentence(thing: Any) -> str:
    """The first one of a docstring, without its full stop; nothing under `python -OO`."""
    paragraph = (thing.__doc__ or "").strip().partition("\n\n")[0]
    return re.split(r"\.(?:\s|$)", " ".join(paragraph.split()), maxsplit=1)[0]


def describe(module: ModuleType) -> None:
    """Adds the map of its names to a module's docstring, with headings in that of flexarm itself."""
    wide = 2 + max(map(len, public(module)))
    lines = [(module.__doc__ or "").rstrip()]
    for heading, listed in grouped(module).items():
        lines += ["", *([heading] if hasattr(module, "Arm") else [])]
        lines += [f"    {name:{wide}}{sentence(getattr(module, name))}".rstrip() for name in listed]
    module.__doc__ = "\n".join(lines)


def missing(name: str) -> Exception:
    """The error for a name that flexarm does not have; it tells the new one of an old name."""
    here = sys.modules["flexarm"]
    new = _RENAMED.get(name) or next((f"{at}.{name}" for at in LISTS if hasattr(getattr(here, at), name)), None)
    told = f"module 'flexarm' has no attribute {name!r}" + (f"; it is fa.{new} now" if new else "")
    # Of `from flexarm import NAME` Python would drop the text of an AttributeError.
    imported = new and sys._getframe(2).f_code.co_name == "_handle_fromlist"
    return ImportError(told, name="flexarm") if imported else AttributeError(told, name=name if new else None)
