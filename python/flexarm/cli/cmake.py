"""Where C++ users find the library: the package carries its headers, static library and CMake package."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

import flexarm._core as _core


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
