"""The public names, as `dir` shows them to everybody."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import flexarm as fa

LISTS = (fa, fa.sections, fa.sensors, fa.results, fa.errors)


def names(module: ModuleType) -> dict[str, Any]:
    """Of a module, without those that begin with an underscore, and without modules."""
    found = {name: getattr(module, name) for name in dir(module) if not name.startswith("_")}
    return {name: thing for name, thing in found.items() if not isinstance(thing, ModuleType)}
