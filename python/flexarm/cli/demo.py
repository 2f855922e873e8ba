"""`flexarm demo`: its options and its output."""

import argparse
import itertools

from .._console import progress_bar
from . import options
from .paper import demo, table

SUMMARY = "the paper's single-link experiment, held against its numbers"
TEXT = "Needs no scene, network or display."


def arguments(p: argparse.ArgumentParser) -> None:
    options.output(p, "flexarm-demo")


def run(args: argparse.Namespace) -> int:
    """Computes, writes and prints."""
    out = options.Output(args.output)
    with progress_bar(True, "demo", demo.STEPS) as bar:
        count = itertools.count(1)
        done = demo.run(out.path, lambda text: bar(next(count), text) if bar else None)
    where = f"\nPictures, data and README.txt are in {out}"
    options.told(args, done.to_dict(), table.text(done.rows), demo.note(), where)
    return 0
