"""`flexarm examples`: its options and its output."""

import argparse
import ast
from difflib import get_close_matches
from pathlib import Path

from ..data.store.files import write_whole
from . import options

SUMMARY = "list complete scripts, or copy them"
TEXT = (
    "Without a name it lists them. 'flexarm examples 03_spin_up -o DIR' copies one there, with the file that it reads; "
    "then 'python DIR/03_spin_up.py' runs it."
)


def scripts() -> dict[str, Path]:
    """The examples by name, in their order.

    Raises:
        ValueError: this installation has none.
    """
    package = Path(__file__).resolve().parents[1]
    for folder in (package / "examples", package.parents[1] / "examples"):  # of a wheel; of an editable installation
        if found := {path.stem: path for path in sorted(folder.glob("[0-9][0-9]_*.py"))}:
            return found
    raise ValueError(f"examples: there are none beside {str(package)!r}; this is not an installation by pip")


def summary(script: Path) -> str:
    """The first line of its docstring."""
    told = ast.get_docstring(ast.parse(script.read_text(encoding="utf-8"))) or ""
    return told.partition("\n")[0]


def arguments(p: argparse.ArgumentParser) -> None:
    p.add_argument("names", metavar="EXAMPLE", nargs="*", help="which to copy")
    p.add_argument("--all", action="store_true", help="copy all of them")
    options.output(p, ".")


def _copy(script: Path, folder: Path) -> list[Path]:
    """The script and the file that it reads, which has its name and another suffix."""
    copied = []
    for source in sorted(script.parent.glob(f"{script.stem}.*")):
        if source.suffix != ".pyc":
            content, target = source.read_bytes(), folder / source.name
            if target.exists() and target.read_bytes() != content:
                raise ValueError(f"{str(target)!r}: is there and differs; rename it, or name another folder with -o")
            write_whole(target, lambda f, content=content: f.write(content), "output")  # type: ignore[misc]
            copied.append(target)
    return copied


def run(args: argparse.Namespace) -> int:
    """Lists or copies, and prints."""
    found = scripts()
    for name in args.names:
        if name not in found:
            near = [x for x in found if name and x.startswith(name)] or get_close_matches(name, found, n=1, cutoff=0.5)
            hint = f"; did you mean '{near[0]}'?" if near else ""
            raise ValueError(f"example {name!r}: there is none of that name; 'flexarm examples' lists them{hint}")
    names = list(found) if args.all else args.names
    if not names:
        told = {name: summary(script) for name, script in found.items()}
        width = max(map(len, told))
        lines = [f"{name:{width}}  {line}" for name, line in told.items()]
        how = "\nCopy one: flexarm examples NAME [-o DIR]; all of them: flexarm examples --all [-o DIR]"
        options.told(args, told, *lines, how)
        return 0
    folder = options.Output(args.output).path
    copied = [str(path) for name in names for path in _copy(found[name], folder)]
    options.told(args, {"files": copied}, *copied)
    return 0
