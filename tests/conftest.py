"""Lets the tests import their helpers (tests/arms.py) under importlib mode, and be interrupted by Ctrl-C."""

import signal
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

# Where the tests run in the background (a shell's &, nohup), SIGINT is ignored, in their subprocesses, too.
signal.signal(signal.SIGINT, signal.default_int_handler)
