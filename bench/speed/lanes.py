"""What bounds the forward dynamics of an arm in lanes: its time against that of its instructions at full tilt.

    cmake --preset release && cmake --build --preset release
    python bench/speed/lanes.py [-o DIR] [--program build/release/bench_lanes]

Needs valgrind and objdump. Callgrind says how often each instruction was executed and how often the first cache had not
what it reads or writes; the program measures times, and what the processor can do at best. Writes speed_floor.csv and
its section of docs/speed.md (with -o only the file, into DIR).
"""

from __future__ import annotations

import csv
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

from counts import arguments, code_of, executed, operations_of, timed, under_callgrind
from speed_common import about, keep, table

NEAR = 1.3  # measured over floor: the aim


def is_load(mnemonic: str, operands: str) -> bool:
    """Whether it reads memory: it has an operand there that is not the last one, which a move writes."""
    operands = operands.partition("#")[0].strip()
    written = operands.endswith(")") and not mnemonic.startswith(("cmp", "test", "vucomi", "vcomi"))
    return operands.count("(") > written and not mnemonic.startswith(("lea", "nop", "prefetch"))


def counted(dump: Path, known: dict[str, dict[int, tuple[str, str]]]) -> Counter[str]:
    """Of a callgrind dump: instructions, of these arithmetic and loads, operations on doubles, lines that were not in
    the first cache."""
    events, counts = executed(dump)
    out = Counter({"instructions": events["Ir"], "lines": events["D1mr"] + events["D1mw"]})
    for path, addresses in counts.items():
        code = known.setdefault(path, code_of(path))
        for address, times in addresses.items():
            mnemonic, operands = code.get(address, ("", ""))
            operations = operations_of(mnemonic, operands)
            out["operations"] += times * operations
            out["arithmetic"] += times * (operations > 0)
            out["loads"] += times * is_load(mnemonic, operands)
    return out


def measure(program: Path) -> tuple[list[dict[str, Any]], dict[str, float]]:
    """A row for each work, and nanoseconds of one instruction of each kind."""
    rows, words = timed(program)
    best = dict(zip(words[::2], map(float, words[1::2]), strict=True))
    known: dict[str, dict[int, tuple[str, str]]] = {}
    with tempfile.TemporaryDirectory() as folder:
        text = under_callgrind(program, folder, "--cache-sim=yes")
        for k, (row, other) in enumerate(zip(rows, csv.DictReader(text.splitlines()), strict=True)):
            if row["lanes"] != other["lanes"]:
                raise SystemExit("valgrind does not know this processor's vectors: set FLEXARM_ISA=avx2")
            found = counted(Path(folder) / f"out.{k + 1}", known)
            row.update({name: n / int(row["evaluations"]) for name, n in found.items()})
            row.update(ns=float(row["ns"]), floor_arithmetic=row["arithmetic"] * best["arithmetic"],
                       floor_loads=row["loads"] * best["load"], floor_lines=row["lines"] * best["line"])  # fmt: skip
            row["floor"] = max(row["floor_arithmetic"], row["floor_loads"], row["floor_lines"])
    return rows, best


def page(rows: list[dict[str, Any]], best: dict[str, float], valgrind: str) -> str:
    head = ["arm", "measured (µs)", "operations", "instructions", "arithmetic", "loads", "lines"]
    head += ["floor: arithmetic (µs)", "loads (µs)", "lines (µs)", f"measured / highest floor (aim ≤ {NEAR})"]
    lines = []
    for r in rows:
        numbers = [round(r[k]) for k in ("operations", "instructions", "arithmetic", "loads", "lines")]
        floors = [r[f"floor_{k}"] / 1e3 for k in ("arithmetic", "loads", "lines")]
        lines.append([r["work"], r["ns"] / 1e3, *numbers, *floors, r["ns"] / r["floor"]])
    return f"""
What bounds an arm's forward dynamics in lanes ({rows[0]["lanes"]} here; a stage of rk4 in a batch of 64): callgrind
counts, of one arm, its operations on doubles, its share of the instructions, those of them that calculate and those
that read memory, and the lines (64 bytes) that the first cache lacked. A floor is the time of one kind alone when its
units are never idle, which the program measures: {best["arithmetic"]:.3g} ns an arithmetic instruction,
{best["load"]:.3g} ns a load, {best["line"]:.3g} ns a line from the second cache.

{table(head, lines)}

Measured by `python bench/speed/lanes.py` ({about(valgrind=valgrind)}).
"""


def main() -> None:
    options, valgrind = arguments(__doc__, "bench_lanes")
    rows, best = measure(options.program)
    keep("speed_floor", page(rows, best, valgrind), rows, None, options.o)


if __name__ == "__main__":
    main()
