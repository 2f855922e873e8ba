"""The package's rooms (docs/contributing.md): imports point to lower rooms, at the top of a file, without circles."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[1] / "python" / "flexarm"
# From low to high; a room's folders stand beside it. env, tasks, torch and jax are public modules of the room `many`.
ROOMS = (
    "_starting _core _check _face _threads _console data.store data.draw data model model.parts model.acting view "
    "analysis robots arm loop run run.sensing run.scene estimate command command.inversion command.moves live many "
    "many.batch many.sweeps tasks env torch jax identify identify.validate choose sections sensors results errors "
    "cli.paper cli __init__ __main__"
).split()
FILES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts): path
    for path in [*sorted(ROOT.rglob("*.py")), ROOT / "_core.pyi"]
}
# Rooms of the C++ kernel, and the rooms that each may include.
KERNEL = Path(__file__).parents[1] / "cpp" / "kernel"
KERNEL_ROOMS = {
    "door": "",
    "wide": "",
    "space": "wide door",
    "beam": "space door",
    "arm": "beam space wide door",
    "step": "arm wide door",
    "slopes": "arm door",
    "setup": "door space wide",
}
TESTS = Path(__file__).parent
PUBLIC = set("flexarm cli env errors jax results sections sensors tasks torch".split())
#: Modules below the public face that tests import, and why.
INTERNALS = {
    "_console _threads data.store data.store.fingerprint": "failures made on purpose, clocks, states of objects",
    "analysis.modes many.sweeps.quantities": "one formula, with its closed form",
    "arm.variation run.perturbed": "an oracle: runs with one number moved",
    "choose.chart_search choose.economize_search choose.measures choose.models choose.sources choose.trials": (
        "steps of a search, whose timings no test may hang on"
    ),
    "cli.paper identify.validate.rig identify.validate.validate": "a published experiment, and its measures",
    "data.draw": "figures of made-up numbers",
    "identify.filtered identify.identify identify.loss identify.search identify.statistics run.simulation": (
        "steps of a least squares: their formulas"
    ),
    "robots.segments view view.meshes": "geometry without a run",
}


class Import(NamedTuple):
    file: str
    line: int
    of: str  # "parts.beam", or "_core"
    top: bool  # whether it stands at the top of the file, not in a function nor behind a condition

    @property
    def place(self) -> str:
        return f"{self.file.replace('.', '/')}.py:{self.line} imports {self.of}"


def _room(file: str) -> int:
    folder, _, name = file.rpartition(".")
    room = ".".join(folder.split(".")[:2]) if folder else name
    return ROOMS.index(room)


def _named(base: list[str], name: str) -> str:
    """The file that `from base import name` opens."""
    ways = ([*base, name], [*base, name, "__init__"], base, [*base, "__init__"])
    return next((found for parts in ways if (found := ".".join(parts)) in FILES), ".".join([*base, name]))


def _imports(file: str) -> Iterator[Import]:
    """Of the package's own files."""
    tree = ast.parse(FILES[file].read_text(encoding="utf-8"))
    own = file.split(".")[:-1]
    for node in ast.walk(tree):
        top = node in tree.body
        if isinstance(node, ast.ImportFrom):
            given = (node.module or "").split(".") if node.module else []
            if node.level or given[0] == "flexarm":
                base = own[: len(own) - node.level + 1] + given if node.level else given[1:]
                yield from (Import(file, node.lineno, _named(base, alias.name), top) for alias in node.names)
        elif isinstance(node, ast.Import):
            for given in (alias.name.split(".") for alias in node.names):
                if given[0] == "flexarm":
                    yield Import(file, node.lineno, _named(given[1:-1], given[-1]), top)


IMPORTS = [found for file in FILES for found in _imports(file)]


def test_every_file_has_a_room() -> None:
    assert not {file for file in FILES if (file.rpartition(".")[0] or file) not in ROOMS}
    assert len(IMPORTS) > 200 and all(x.of in FILES for x in IMPORTS)


def test_imports_point_to_lower_rooms() -> None:
    upward = [x.place for x in IMPORTS if _room(x.of) > _room(x.file)]
    assert not upward, "\n".join(upward)


def test_imports_stand_at_the_top() -> None:
    """Not in functions, not under TYPE_CHECKING: a circle that is hidden is a circle."""
    hidden = [x.place for x in IMPORTS if not x.top]
    assert not hidden, "\n".join(hidden)


def test_no_circles() -> None:
    graph: dict[str, set[str]] = {}
    for x in IMPORTS:
        graph.setdefault(x.file, set()).add(x.of)
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as e:
        pytest.fail(" -> ".join(e.args[1]))


def test_rooms_of_the_kernel() -> None:
    rooms = {path.name for path in KERNEL.iterdir() if path.is_dir()}
    assert rooms == set(KERNEL_ROOMS)
    for room, lower in KERNEL_ROOMS.items():
        for path in (KERNEL / room).iterdir():
            included = set(re.findall(r'#include "(\w+)/', path.read_text(encoding="utf-8")))
            assert included <= {room, "flexarm", *lower.split()}, path


def test_tests_go_through_the_public_face() -> None:
    """With few exceptions; of errors and warnings they hold fields and values (tests/messages.py), not sentences."""
    known, found = {module for modules in INTERNALS for module in modules.split()}, set()
    for path in TESTS.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        assert path.name == "messages.py" or not re.search(r"(raises|warns)\([^()]*match=", text), path
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "flexarm":
                inside = (node.module or "").removeprefix("flexarm").removeprefix(".")
                found |= {inside} if inside else {alias.name for alias in node.names if alias.name[0] == "_"}
    assert found - PUBLIC == known
