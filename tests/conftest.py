"""Lets the tests import their helpers (tests/arms.py) under importlib mode, and be interrupted by Ctrl-C; and what
several files of tests look at, computed once."""

import contextlib
import functools
import io
import json
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parent))

# The matrices are small: a second thread of OpenBLAS helps none of them, but waits for work in a busy loop, which takes
# half of the time where something else computes beside the tests. Before NumPy is imported; subprocesses inherit it.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Where the tests run in the background (a shell's &, nohup), SIGINT is ignored, in their subprocesses, too.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def demonstration(tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, Any]:
    """What `flexarm demo --json` computed, a demo.Demo, and what it printed."""
    from flexarm import cli
    from flexarm.cli import demo

    done, computed = [], demo.computed
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(io.StringIO()) as out:
        patch.setattr(demo, "computed", lambda *args: done.append(computed(*args)) or done[-1])
        assert cli.main(["demo", "-o", str(tmp_path_factory.mktemp("demo") / "new"), "--json"]) == 0
    return done[0], json.loads(out.getvalue())


@pytest.fixture(scope="session")
def page_of_docs(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Any]:
    """Runs the code of a page, such as "docs/data.md", once however many tests ask for it: a pages.Ran."""
    import pages

    return functools.cache(lambda page: pages.run(pages.ROOT / page, tmp_path_factory.mktemp("page")))
