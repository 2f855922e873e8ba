"""Runs the code blocks of a page of the documentation, as a reader would who copies them one after the other.

| tag | what is done with the block |
|-|-|
| `python` | runs; all such blocks of a page share their names; a warning is an error |
| `sh` | runs with `bash -eu`, with this environment's `flexarm` and `python` on PATH |
| `cpp` | is compiled with -fsyntax-only |
| `toml` | is parsed; one with links is loaded as a scene; one that begins with `# NAME.toml` is saved under that name |
| `text` | output, or anything else that is not code |

Python and sh blocks run in the order of the page, in one folder that is empty at first. Comments directly before a
block change that: `<!-- not run: REASON -->`; `<!-- needs: MODULE -->`, which runs the block where the module is
installed; `<!-- warns: CATEGORY -->`, for a block that has to emit this warning.
"""

from __future__ import annotations

import contextlib
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import flexarm as fa
import matplotlib.pyplot as plt
import pytest
from markdown_it import MarkdownIt

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
COMPILER = os.environ.get("CXX") or shutil.which("c++")
EIGEN = [p for p in ("/usr/include/eigen3", "/usr/local/include/eigen3") if Path(p).exists()]
LANGUAGES = ("python", "sh", "cpp", "toml", "text")


@dataclass
class Block:
    language: str
    text: str
    line: int  # of its first line of code on the page, from 0
    not_run: str | None = None
    needs: str | None = None
    warns: str | None = None


@dataclass
class Ran:
    """What a page left behind."""

    folder: Path
    names: dict[str, Any] = field(default_factory=lambda: {"__name__": "__main__"})
    states: list[dict[str, Any]] = field(default_factory=list)  # the names after each Python block
    missing: list[str] = field(default_factory=list)  # modules that blocks need and that are not installed


def blocks(page: Path) -> list[Block]:
    """Of a page, in order; ValueError for a tag that the runner does not know, and for code without a fence."""
    found: list[Block] = []
    told: list[re.Match[str]] = []  # comments directly before
    for token in MarkdownIt("commonmark").parse(page.read_text(encoding="utf-8")):
        where = f"{page}, line {token.map[0] + 1 if token.map else '?'}"
        if token.type == "code_block":
            raise ValueError(f"{where}: code must stand between ``` lines with a language, not be indented")
        if token.type == "fence" and not token.info.startswith("{"):  # {note} and the like are Sphinx's
            assert token.map
            found.append(block := Block(token.info.strip(), token.content, token.map[0] + 1))
            for comment in told:
                if not comment[2]:
                    raise ValueError(f"{where}: '{comment[1]}:' in the comment before it needs a reason or a name")
                setattr(block, comment[1].replace(" ", "_"), comment[2])
            if block.language not in LANGUAGES and not (block.language and block.not_run):
                known = ", ".join(LANGUAGES)
                raise ValueError(f"{where}: the language of a block must be one of {known}, not {block.language!r}")
        comment = re.match(r"<!-- (not run|needs|warns):? *(.*?) *-->", token.content)
        told = [*told, comment] if comment else []
    return found


def compile_cpp(block: str) -> None:
    if not (COMPILER and EIGEN):
        pytest.skip("SKIPPED, not passed: needs a C++ compiler and Eigen")
    headers = {p.parent.parent for p in (ROOT / "cpp").glob("**/flexarm/*.hpp")}
    flags = ["-DFLEXARM_SCENES"]
    flags += [word for place in (*EIGEN, *sorted(headers)) for word in ("-isystem", str(place))]
    command = [COMPILER, "-std=c++17", "-fsyntax-only", *flags, "-x", "c++", "-"]
    done = subprocess.run(command, input=block, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]


def run(page: Path, folder: Path) -> Ran:
    """Its python, sh and toml blocks, in order, in `folder`."""
    ran = Ran(folder)
    with _chdir(folder), _as_it_was():
        for block in blocks(page):
            if block.needs and not importlib.util.find_spec(block.needs):
                ran.missing.append(block.needs)
            elif block.not_run:
                continue
            elif block.language == "python":
                _python(block, page, ran.names)
                ran.states.append(dict(ran.names))
            elif block.language == "sh":
                _sh(block, page)
            elif block.language == "toml":
                _toml(block)
    return ran


@contextlib.contextmanager
def _chdir(folder: Path) -> Iterator[None]:
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


@contextlib.contextmanager
def _as_it_was() -> Iterator[None]:
    """Figures are closed, and JAX counts in single precision again, whatever a page has set."""
    try:
        yield
    finally:
        plt.close("all")
        if "jax" in sys.modules:
            sys.modules["jax"].config.update("jax_enable_x64", False)


def _python(block: Block, page: Path, names: dict[str, Any]) -> None:
    code = compile("\n" * block.line + block.text, str(page), "exec")  # an error shows the page's own line
    with warnings.catch_warnings(record=bool(block.warns)) as seen:
        warnings.simplefilter("always" if block.warns else "error")
        exec(code, names)
    if block.warns:
        assert seen is not None and {w.category.__name__ for w in seen} == {block.warns}, (page, block.line)


def _sh(block: Block, page: Path) -> None:
    path = os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"]))
    env = {**os.environ, "PATH": path, "MPLBACKEND": "Agg"}
    done = subprocess.run(["bash", "-eu"], input=block.text, capture_output=True, text=True, env=env, timeout=120)
    assert done.returncode == 0, f"{page}:{block.line + 1}\n{done.stdout[-1000:]}\n{done.stderr[-2000:]}"


def _toml(block: Block) -> None:
    table, name = tomllib.loads(block.text), re.match(r"# ([\w.-]+\.toml)\n", block.text)
    if name:
        Path(name[1]).write_text(block.text, encoding="utf-8")
    if isinstance(table.get("link"), list):
        scene = Path(name[1] if name else "a block.toml")
        scene.write_text(block.text, encoding="utf-8")
        fa.load(scene)
