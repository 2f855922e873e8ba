"""`flexarm demo`: its options and its output."""

from __future__ import annotations

import argparse
import itertools
import os

from .._console import json_text, output_folder, print_table, progress_bar
from . import options
from .paper import demo

SUMMARY = "the paper's single-link experiment, held against its numbers"
TEXT = "Needs no scene, network or display."


def arguments(p: argparse.ArgumentParser) -> None:
    options.output(p, "flexarm-demo")


def run(args: argparse.Namespace) -> int:
    """Computes, writes and prints."""
    folder = output_folder(args.output)
    with progress_bar(True, "demo", demo.STEPS) as bar:
        count = itertools.count(1)
        done = demo.run(folder, lambda what: bar(next(count), what) if bar else None)
    if args.json:
        print(json_text(done.to_dict()))
        return 0
    print_table(demo.rich_table(done.rows))
    print(demo.note())
    print(f"\nPictures, data and README.txt are in {folder}{os.sep}")
    return 0
