"""Ctrl-C while the command `flexarm` loads its libraries: one line and exit code 130, as later on.

Nobody can catch a KeyboardInterrupt there: the command's first import is this package, and the C++ module, which
imports NumPy, makes an ImportError of it. So the package imports this file first.
"""

from __future__ import annotations

import os
import signal
import sys


def _is_command() -> bool:
    """Whether this process is `flexarm` or `python -m flexarm`, and not one of its workers, which have its argv."""
    words, program = sys.orig_argv, (sys.argv or [""])[0]
    if program == "-m":  # while the package is being imported
        return words[words.index("-m") + 1 :][:1] == ["flexarm"]
    return program in words and os.path.basename(program).partition(".")[0] == "flexarm"


def _leave(*_: object) -> None:
    try:
        os.write(2, b"flexarm: interrupted\n")
    finally:
        os._exit(130)


def over() -> None:
    """From here on Ctrl-C is a KeyboardInterrupt."""
    if signal.getsignal(signal.SIGINT) is _leave:
        signal.signal(signal.SIGINT, signal.default_int_handler)


if _is_command() and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, _leave)
