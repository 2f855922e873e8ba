"""Writes docs/api: a page for every public name, from its docstring, in the groups of the map that `help` shows."""

import inspect
import io
import os
import re
from contextlib import redirect_stdout
from functools import reduce
from pathlib import Path
from typing import Any

import flexarm as fa
from flexarm import _face
from flexarm.cli import main
from flexarm.cli.main import COMMANDS
from sphinx.util.inspect import TypeAliasForwardRef

MODULES = {
    "flexarm.env": "Gymnasium environments",
    "flexarm.tasks": "tasks to learn",
    "flexarm.torch": "rollouts of PyTorch's tensors",
    "flexarm.jax": "rollouts of JAX's arrays",
}
COLON = "\ue000"  # of a property's docstring, hidden from napoleon


def groups() -> dict[str, list[str]]:
    """Full names of the public names by the titles of their lists, each in one list."""
    found = {heading: [f"flexarm.{name}" for name in names] for heading, names in _face.grouped(fa).items()}
    for module in (getattr(fa, name) for name in _face.LISTS):
        names = [name for name in _face.public(module) if not hasattr(fa, name)]
        found[module.__name__] = [f"{module.__name__}.{name}" for name in names]
    return found


def _titled(title: str, *blocks: str) -> str:
    return "\n\n".join([f"{title}\n{'=' * len(title)}", *blocks]) + "\n"


def _listed(pages: list[str]) -> str:
    return "\n   ".join([".. toctree::", ":hidden:", "", *pages])


def _stem(title: str) -> str:
    return title.lower().replace(" ", "-")


def _thing(full: str) -> Any:
    return reduce(getattr, full.split(".")[1:], fa)


def _page(full: str) -> str:
    """Of a public name: its file, apart from another's that differs in capitals alone."""
    name = full.split(".")[-1]
    return name if name[0].isupper() else f"{name}_function"


def _row(full: str) -> str:
    """Of a list's table: a name, and the first sentence of its docstring."""
    text = [_face.sentence(_thing(full))]
    plain(None, "", full, None, None, text)
    return f"* - :py:obj:`{full.split('.')[-1]} <{full}>`\n     - {text[0]}"


def _of_name(full: str) -> str:
    what, (module, _, name) = _thing(full), full.rpartition(".")
    if not isinstance(what, type):
        directive = f".. autofunction:: {name}"
    elif issubclass(what, BaseException):
        directive = f".. autoexception:: {name}\n   :show-inheritance:"
    else:
        directive = f".. autoclass:: {name}\n   :inherited-members: object, tuple\n   :exclude-members: type"
    return _titled(name, f".. currentmodule:: {module}", directive)


def _help(*command: str) -> str:
    text = io.StringIO()
    with redirect_stdout(text):
        try:
            main([*command, "--help"])
        except SystemExit:
            pass
    return ".. code-block:: text\n\n" + re.sub("^(?=.)", "   ", text.getvalue(), flags=re.MULTILINE)


def _commands() -> str:
    os.environ["COLUMNS"] = "80"
    parts = [_help()]
    for name in COMMANDS:
        title = f"flexarm {name}"
        parts += [f"{title}\n{'-' * len(title)}", _help(name)]
    return _titled("Command line", "What ``flexarm COMMAND --help`` prints.", *parts)


def write(app: Any) -> None:
    pages = {}
    names = groups()
    for title, group in names.items():
        table = "\n   ".join([".. list-table::", ":widths: auto", "", *map(_row, group)])
        about = [f".. py:module:: {title}", f"{_face.sentence(_thing(title))}."] if "." in title else []
        pages[_stem(title)] = _titled(title, *about, table, _listed([_page(n) for n in group]))
        pages |= {_page(name): _of_name(name) for name in group}
    for module, title in MODULES.items():
        pages[module] = _titled(f"{module}: {title}", f".. automodule:: {module}")
    pages["modules"] = _titled("Other modules", "\n".join(f"* :doc:`{m}`" for m in MODULES), _listed([*MODULES]))
    pages["command-line"] = _commands()
    stems = [_stem(title) for title in names]
    text = "A page for each name, from its docstring. :doc:`/reference` has them all in one table."
    toctree = _listed([*stems, "modules", "command-line"]).replace(":hidden:", ":maxdepth: 1")
    pages["index"] = _titled("API", text, toctree)
    folder = Path(app.srcdir) / "api"
    folder.mkdir(exist_ok=True)
    for file in folder.glob("*.rst"):
        if file.stem not in pages:
            file.unlink()
    for stem, text in pages.items():
        file = folder / f"{stem}.rst"
        if not file.exists() or file.read_text(encoding="utf-8") != text:  # else Sphinx reads it again
            file.write_text(text, encoding="utf-8")


def _fields_apart(lines: list[str], known: set[str]) -> list[str]:
    """"start: of it. stop: of it." is a line for each, where both are names of arguments or attributes."""
    found, inside = [], False
    for line in lines:
        if line and line[0] != " ":
            inside = line in ("Args:", "Attributes:")
        start = 0
        for m in re.finditer(r"[.;] (?=((?:\w+, )*\w+): )", line) if inside else ():
            if set(m[1].split(", ")) <= known:
                found.append(("    " if start else "") + line[start : m.end() - 1].rstrip(";"))
                start = m.end()
        found.append(("    " if start else "") + line[start:])
    return found


def _arguments(thing: Any) -> set[str]:
    """And attributes, of a class or a function."""
    try:
        return {*dir(thing), *getattr(thing, "__annotations__", ()), *inspect.signature(thing).parameters}
    except (TypeError, ValueError):  # a property; an exception; what PyTorch's stand-in gives
        return {*dir(thing), *getattr(thing, "__annotations__", ())}


def plain(_app: Any, what: str, _name: str, thing: Any, _options: Any, lines: list[str]) -> None:
    """Docstrings are plain text with code in backticks: |x| is a magnitude, 2 * a a product. What stands before a colon
    in a property's docstring is no type."""
    lines[:] = _fields_apart(lines, _arguments(thing))
    for at, line in enumerate(lines):
        parts = re.split(r"(`[^`]*`)", line)
        line = "".join(p if p.startswith("`") else re.sub(r"([|*])", r"\\\1", p) for p in parts)
        line = re.sub(r"(^ *|: )([A-Za-z]{1,2})(?=[.)]( |$))", r"\1\\\2", line)  # "m." begins no list
        lines[at] = line.replace(":", COLON) if what in ("attribute", "property") else line


def public(_app: Any, _what: str, _name: str, _thing: Any, _options: Any, signature: str | None, _returns: Any) -> Any:
    """A signature without what no user passes."""
    if signature:
        signature = re.sub(r"(, )?\b_\w+(: [^,=]*)?=[^,)]*", "", signature).replace("<factory>", "...")
    return signature, None


def colons_again(_app: Any, _what: str, _name: str, _object: Any, _options: Any, lines: list[str]) -> None:
    lines[:] = [line.replace(COLON, ":") for line in lines]


def setup(app: Any) -> dict[str, bool]:
    TypeAliasForwardRef.__repr__ = lambda alias: alias.name  # of autodoc_type_aliases, inside another type
    app.connect("autodoc-process-signature", public)
    app.connect("autodoc-process-docstring", plain, priority=400)  # before napoleon, which is at 500
    app.connect("autodoc-process-docstring", colons_again, priority=600)
    app.connect("builder-inited", write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
