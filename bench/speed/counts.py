"""What each thing costs: instructions and arithmetic of one forward dynamics, on a ladder of arms.

    cmake --preset release && cmake --build --preset release
    python bench/speed/counts.py [-o DIR] [--program build/release/bench_counts]

Needs valgrind, and objdump for the arithmetic: each executed instruction that callgrind saw is looked up, and those
that add, subtract, multiply, divide or take a root of doubles are counted, once for each double. The floor is that
count times the time of one operation at full tilt, which the program measures. Writes speed_counts.csv,
speed_counts.png and its section of docs/speed.md (with -o only the files, into DIR).
"""

from __future__ import annotations

import argparse
import csv
import re
import shutil
import subprocess
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from speed_common import ROOT, Figure, about, keep, table

# an instruction that calculates with doubles; the last letter but one says whether with one or with a register full
ARITHMETIC = re.compile(r"^v?(add|sub|addsub|mul|div|sqrt|hadd|fn?m(?:add|sub)\d*)([sp])d$")
WIDTH = {"x": 2, "y": 4, "z": 8}  # doubles in a register, by its name's first letter
FREE = ("patch without its mass",)  # what must cost nothing
ALIKE = 1e-3  # of the instructions: what differs by less is free, or paid for by arms without it


def operations_of(mnemonic: str, operands: str) -> int:
    """Operations on doubles of one instruction."""
    match = ARITHMETIC.match(mnemonic)
    if not match:
        return 0
    registers = re.findall(r"%([xyz])mm", operands)
    width = 1 if match[2] == "s" else max((WIDTH[r] for r in registers), default=2)
    return width * (2 if re.match(r"v?fn?m", mnemonic) else 1)


def code_of(path: str) -> dict[int, tuple[str, str]]:
    """Mnemonic and operands of every instruction of an executable or library, by address."""
    found: dict[int, tuple[str, str]] = {}
    if not shutil.which("objdump") or not Path(path).exists():
        return found
    text = subprocess.run(["objdump", "-d", "--no-show-raw-insn", path], check=True, capture_output=True, text=True)
    for line in text.stdout.splitlines():
        address, _, code = line.partition(":\t")
        words = code.split(None, 1)
        if len(words) == 2:
            found[int(address, 16)] = (words[0], words[1])
    return found


def executed(path: Path) -> tuple[dict[str, int], dict[str, Counter[int]]]:
    """Events of a callgrind dump, and how often each address of each object was executed."""
    names: dict[str, str] = {}
    events: list[str] = []
    totals: dict[str, int] = {}
    counts: dict[str, Counter[int]] = {}
    positions, address, current, skip = 1, 0, "", False
    for line in path.read_text().splitlines():
        if line.startswith("ob="):
            key, _, name = line[3:].partition(" ")
            if name:
                names[key] = name
            current = names.get(key, "")
        elif line.startswith("cob="):
            key, _, name = line[4:].partition(" ")
            if name:
                names[key] = name
        elif line.startswith("calls="):
            skip = True  # the next line has the callee's cost, which is counted where it is spent
        elif line.startswith("positions:"):
            positions = len(line.split()) - 1
        elif line.startswith("events:"):
            events = line.split()[1:]
        elif line.startswith("summary:"):
            totals = dict(zip(events, map(int, line.split()[1:]), strict=False))
        elif line and line[0] in "0+-*":
            where, *rest = line.split()
            address = int(where, 16) if where[0] == "0" else address + (0 if where == "*" else int(where, 0))
            if not skip:
                counts.setdefault(current, Counter())[address] += int(rest[positions - 1])
            skip = False
    return totals, counts


def timed(program: Path) -> tuple[list[dict[str, Any]], list[str]]:
    """The program's rows with their times, and the words of the remark behind them."""
    lines = subprocess.run([program, "times"], check=True, capture_output=True, text=True).stdout.splitlines()
    return list(csv.DictReader(x for x in lines if not x.startswith("#"))), lines[-1][1:].split()


def under_callgrind(program: Path, folder: str, *options: str) -> str:
    """What the program prints there. FOLDER/out.1, out.2 .. are the dumps of its calls of `flexarm_measured`."""
    command = ["valgrind", "--tool=callgrind", "--dump-instr=yes", f"--callgrind-out-file={folder}/out", *options]
    command += ["--toggle-collect=flexarm_measured", "--dump-after=flexarm_measured", str(program)]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def arguments(doc: str | None, program: str) -> tuple[argparse.Namespace, str]:
    """Those of a bench whose program runs under valgrind, and valgrind's version."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", type=Path)
    parser.add_argument("--program", type=Path, default=ROOT / "build/release" / program)
    options = parser.parse_args()
    if not options.program.exists():
        parser.error(f"{options.program} is not there: cmake --preset release && cmake --build --preset release")
    if not shutil.which("valgrind"):
        parser.error("valgrind is not there; on Debian or Ubuntu: apt-get install valgrind")
    version = subprocess.run(["valgrind", "--version"], check=True, capture_output=True, text=True).stdout.strip()
    return options, version.removeprefix("valgrind-")


def measure(program: Path) -> list[dict[str, Any]]:
    """A row for each rung."""
    rows, words = timed(program)
    operation = float(words[0])
    known: dict[str, dict[int, tuple[str, str]]] = {}
    with tempfile.TemporaryDirectory() as folder:
        under_callgrind(program, folder)
        for k, row in enumerate(rows):
            events, counts = executed(Path(folder) / f"out.{k + 1}")
            total = events["Ir"]
            if sum(c.total() for c in counts.values()) != total:
                raise RuntimeError(f"{row['name']}: the dump's lines do not add up to its summary, {total}")
            flops = 0
            for path, addresses in counts.items():
                code = known.setdefault(path, code_of(path))
                flops += sum(n * operations_of(*code.get(a, ("", ""))) for a, n in addresses.items())
            evaluations = int(row.pop("evaluations"))
            row.update(coordinates=int(row["coordinates"]), points=int(row["points"]), ns=float(row["ns"]))
            row.update(instructions=total / evaluations, operations=flops / evaluations if flops else float("nan"))
            row["floor_ns"] = row["operations"] * operation
    below = {row["name"]: row for row in rows}
    for row in rows:
        base = below.get(row["below"])
        row["against"] = row["instructions"] / base["instructions"] - 1 if base else float("nan")
    return rows


def percent(x: float) -> str:
    return "" if np.isnan(x) else "nothing" if x == 0 else f"{100 * x:+.2g} %" if abs(x) < 0.1 else f"{100 * x:+.0f} %"


def page(rows: list[dict[str, Any]], valgrind: str) -> str:
    lines = [
        [
            r["name"],
            r["below"],
            percent(r["against"]),
            r["coordinates"],
            r["points"] or None,
            f"{r['instructions']:.0f}",
            f"{r['operations']:.0f}",
            f"{r['ns']:.0f}",
            f"{r['floor_ns']:.0f}",
            r["ns"] / r["floor_ns"],
        ]
        for r in rows
    ]
    head = ["arm", "held against", "instructions more", "coordinates", "Gauss points", "instructions", "operations"]
    head += ["measured (ns)", "floor (ns)", "measured / floor"]
    free = [r for r in rows if any(r["name"].endswith(x) for x in FREE)]
    paid = [r["name"] for r in free if r["against"] != 0]
    verdict = f"**Not free, but should be: {', '.join(paid)}.**" if paid else f"Free: {FREE[0]}."
    alike = [r["name"] for r in rows if abs(r["against"]) < ALIKE and r not in free]
    if alike:
        verdict += f" Within {100 * ALIKE:g} % of the arm without (free, or paid for by every arm): {'; '.join(alike)}."
    return f"""
One forward dynamics of two links on hinges along z, with order 2 and rotary inertia unless the row says otherwise.
Callgrind counts the instructions, so they do not depend on other work of the machine. Operations are the additions,
subtractions, multiplications, divisions and roots of doubles among them. The floor is the time of these operations
alone if the processor's adders and multipliers were never idle, two doubles wide. The measured time is the shortest of
many rounds. (Where kernels choose their instruction set at run time, valgrind may show them another processor:
it knows no AVX-512.) {verdict}

{table(head, lines)}

![What each thing costs](figures/speed_counts.png)

Measured by `python bench/speed/counts.py` ({about(valgrind=valgrind)}).
"""


def draw(rows: list[dict[str, Any]]) -> Figure:
    figure = Figure(figsize=(9, 0.26 * len(rows) + 1.2), layout="constrained")
    ax = figure.subplots()
    y = np.arange(len(rows))[::-1]
    ax.barh(y, [r["instructions"] for r in rows], 0.7, color="lightsteelblue", label="instructions")
    ax.barh(y, [r["operations"] for r in rows], 0.35, color="tab:blue", label="operations on doubles")
    for at, row in zip(y, rows, strict=True):
        end = np.nanmax([row["instructions"], row["operations"]])
        ax.annotate(" " + percent(row["against"]), (end, at), va="center", fontsize=7)
    ax.set_yticks(y, [r["name"] for r in rows], fontsize=8)
    ax.set(
        xscale="log", xlabel="one forward dynamics; behind each bar: against the rung below it", ylim=(-0.6, y[0] + 0.6)
    )
    low, high = ax.get_xlim()
    ax.set_xlim(low, 2 * high)
    ax.legend(fontsize=8, loc="upper right")
    ax.grid(axis="x", alpha=0.3)
    return figure


def main() -> None:
    options, valgrind = arguments(__doc__, "bench_counts")
    rows = measure(options.program)
    keep("speed_counts", page(rows, valgrind), rows, draw(rows), options.o)


if __name__ == "__main__":
    main()
