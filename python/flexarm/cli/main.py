"""The command line: `flexarm demo`, `run`, `check`, `view`, `modes`, `chart`, `economize`, `place`, `compile`,
`export`, `live`, `batch`, `identify`, `validate`, `examples`, `completion`, each with --help.

Tables go to stdout, progress and errors to stderr. Exit codes: 0 done; 1 a simulation that could not go on;
2 bad input, one line says which; 130 interrupted. A new command is one file here, and its name in COMMANDS: SUMMARY and
TEXT for --help, `arguments(parser)`, which adds its arguments, and `run(args)`, which returns the exit code.
"""

import argparse
import errno
import sys
import warnings
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, metadata
from pathlib import Path
from typing import Any, NoReturn

import flexarm._core as _core

from .._console import complain, drop, open_streams
from .._core import __version__
from .._starting import over
from . import (
    batch,
    chart,
    check,
    completion,
    demo,
    economize,
    examples,
    export,
    identify,
    live,
    modes,
    place,
    run,
    validate,
    view,
)
from . import compile as compiling


def cmake_dir() -> Path:
    """The folder of flexarmConfig.cmake: `-Dflexarm_DIR=`, or in CMAKE_PREFIX_PATH.

    Raises:
        ValueError: this installation has none.
    """
    folder = Path(_core.__file__).resolve().parent / "lib" / "cmake" / "flexarm"  # in an editable one, not beside this
    if not (folder / "flexarmConfig.cmake").exists():
        raise ValueError(
            f"cmakedir = {str(folder)!r}: is not there; this is not a wheel's installation: install one with pip, or "
            "build the library from its sources with 'cmake --install'"
        )
    return folder


class PrintCMakeDir(argparse.Action):
    """The option --cmakedir, which prints it and ends the program."""

    def __init__(self, option_strings: Sequence[str], dest: str, help: str | None = None) -> None:
        super().__init__(option_strings, dest, nargs=0, help=help)

    def __call__(self, *_: Any, **__: Any) -> NoReturn:
        print(cmake_dir())
        raise SystemExit(0)


COMMANDS = {
    command.__name__.rpartition(".")[2]: command
    for command in (demo, run, check, view, modes, chart, economize, place, compiling, export, live, batch,
                    identify, validate, examples, completion)
}  # fmt: skip


class _Parser(argparse.ArgumentParser):
    """Bad options take one line, without the usage."""

    def error(self, message: str) -> NoReturn:
        raise ValueError(f"{message}; see '{self.prog} --help'")


def _address(label: str) -> str:
    """Of a page about flexarm, as the installed package has it; "" where it is not installed."""
    try:
        urls = metadata("flexarm").get_all("Project-URL") or []
    except PackageNotFoundError:
        return ""
    return dict(str(url).split(", ", 1) for url in urls).get(label, "")


def _parser() -> _Parser:
    docs = _address("Documentation")
    start = "Start with 'flexarm demo'. SCENE is a TOML file, or the name of a shipped scene such as ist."
    top = _Parser(
        prog="flexarm",
        description="Simulates flexible robot arms.",
        epilog=f"{start} Documentation: {docs}" if docs else start,
    )
    top.add_argument("--version", action="version", version=f"flexarm {__version__} {docs}".rstrip())
    folder = "print where CMake's find_package(flexarm) looks, for C++ users"
    top.add_argument("--cmakedir", action=PrintCMakeDir, help=folder)
    commands = top.add_subparsers(metavar="COMMAND", required=True, parser_class=_Parser)
    for name, command in COMMANDS.items():
        summary = command.SUMMARY
        text = f"{summary[0].upper()}{summary[1:]}. {command.TEXT}"
        p = commands.add_parser(name, help=summary, description=text)
        p.set_defaults(does=command.run, top=top)
        p.add_argument("--json", action="store_true", help="print JSON, and only that, on stdout")
        command.arguments(p)
    return top


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command line and returns the exit code (see the module)."""
    open_streams()
    try:
        over()
        args = _parser().parse_args(argv)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # numpy's, beside our one line
            warnings.showwarning = lambda message, *_, **__: complain(f"warning: {message}")
            code = int(args.does(args))
        sys.stdout.flush()
        return code
    except ValueError as e:
        complain(str(e))
        return 2
    except BrokenPipeError:  # the reader of a pipe left
        drop(sys.stdout)
        return 0
    except OSError as e:
        if e.errno == errno.ENOSPC and e.filename is None:
            drop(sys.stdout)
        complain(f"{e.filename or 'file'}: {e.strerror or e}")
        return 2
    except KeyboardInterrupt:
        complain("interrupted")
        return 130


if __name__ == "__main__":
    sys.exit(main())
