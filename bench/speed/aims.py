"""What was aimed at, and what is: all that needs no other program, in one run.

    cmake --preset release && cmake --build --preset release
    python bench/speed/aims.py [--rounds 5] [-o DIR] [--program build/release/bench_aims]

The C++ program and a worker (speed_flexarm.py) run in turn, `rounds` times, on the processor's widest vectors and on
AVX2 (FLEXARM_ISA); medians count, and ratios are of times of the same round. Writes speed_aims.csv and its section of
docs/speed.md (with -o only the files, into DIR). What is aimed at against others: speed_rigid.py, speed_batch.py and
peers.py.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from speed_common import ROOT, about, keep, table, verdict

Times = dict[str, np.ndarray]  # us of every round, by work
ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMEXPR")}
FORWARD = "forward dynamics"  # the unit of derivatives
LANES = {8: "AVX-512", 4: "AVX2", 2: "two lanes"}


@dataclass(frozen=True)
class Aim:
    """The time of a work, or its ratio to that of another, and how large it may be."""

    words: str
    aim: float
    work: str
    base: str = ""
    unit: str = "µs"

    def value(self, times: Times) -> float:
        """Median over the rounds."""
        ratio = times[self.work] / (times[self.base] if self.base else 1.0)
        return float(np.median(100 * (ratio - 1) if self.unit == "% more" else ratio))


def aims(one: list[str], python: list[str]) -> list[Aim]:
    """All of them.

    Args:
        one: what a rollout of one scenario was measured on.
        python: arms whose forward dynamics were called from Python.
    """
    seven, out = "7 x (3+3+1)", []
    out.append(Aim("planar link of 3 curvatures, exact: forward dynamics", 0.4, "planar link, exact"))
    for order, alone, lanes in (("exact", 15.0, 4.0), ("order 2", 6.0, 2.0)):
        out.append(Aim(f"{seven}, {order}: forward dynamics, alone", alone, f"{seven}, {order}"))
        out.append(Aim(f"{seven}, {order}: an arm in lanes", lanes, f"in lanes, {order}"))
    for order in ("order 2", "exact"):
        base = f"two planar links, {order}"
        out.append(Aim(f"{base}: a load at the tip", 5.0, f"load at the tip, {order}", base, "% more"))
        out.append(Aim(f"{base}: a load along a beam", 15.0, f"load along the beam, {order}", base, "% more"))
    for order in ("order 2", "exact"):
        base = f"{seven}, {order}"
        out.append(Aim(f"{base}: derivatives of forward dynamics", 8.0, f"derivatives of {base}", base, FORWARD))
        out.append(Aim(f"{base}: of inverse dynamics", 8.0, f"inverse derivatives of {base}", base, FORWARD))
    out.append(Aim("an output of a run: state, acceleration, reaction", 0.5, "output"))
    out += [Aim(f"a rollout of one: {x}", 1.1, f"one: {x}", f"alone: {x}", "one by one") for x in one]
    out += [Aim(f"`arm.forward_dynamics` of one state: {x}", 4.0, f"python: {x}") for x in python]
    return out


def run(program: Path, isa: str | None) -> tuple[dict[str, float], dict[str, int], int]:
    """Microseconds and operations by work of one round, and how many lanes the kernels have."""
    environment = {**os.environ, **ONE_THREAD, **({"FLEXARM_ISA": isa} if isa else {})}

    def answer(*command: Any) -> list[str]:
        out = subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE, text=True)
        return out.stdout.splitlines()

    found: dict[str, list[float]] = {}
    operations: dict[str, int] = {}
    for row in csv.DictReader(answer(program, "5")):
        found.setdefault(row["work"], []).append(float(row["us"]))
        operations[row["work"]] = int(row["operations"])
    lanes = 0
    for line in map(json.loads, answer(sys.executable, ROOT / "bench/speed/speed_flexarm.py", "aims")):
        if line["kind"] == "aim":
            found.setdefault(line["work"], []).append(line["us"])
            lanes = max(lanes, line.get("lanes", 0))
    return {k: float(np.median(v)) for k, v in found.items()}, operations, lanes


def lines_of_code() -> int:
    """Lines of C++, without tests and examples."""
    files = [f for f in (ROOT / "cpp").rglob("*.[ch]pp") if not {"tests", "examples"} & set(f.parts)]
    return sum(len(f.read_text(encoding="utf-8").splitlines()) for f in files)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("-o", type=Path)
    parser.add_argument("--program", type=Path, default=ROOT / "build/release/bench_aims")
    options = parser.parse_args()
    rounds: dict[int, list[dict[str, float]]] = {}
    for _ in range(options.rounds):
        for isa in (None, "avx2"):
            found, operations, lanes = run(options.program, isa)
            rounds.setdefault(lanes, []).append(found)
    times = {n: {k: np.array([r[k] for r in mine]) for k in mine[0]} for n, mine in rounds.items()}
    names = list(next(iter(times.values())))
    wanted = aims(*([k.removeprefix(p) for k in names if k.startswith(p)] for p in ("one: ", "python: ")))
    rows: list[list[Any]] = []
    for a in wanted:
        values = [a.value(t) for t in times.values()]
        cells = [f"{x:.3g} {a.unit}" for x in values]
        rows.append([a.words, *cells, f"≤ {a.aim:g}", verdict(values[0], a.aim), operations.get(a.work) or None])
    rows.append(["lines of C++, without tests and examples", *[lines_of_code()] * len(times), "< 12600", None, None])
    columns = [LANES.get(n, f"{n} lanes") for n in times]
    words = f"""
CPU time of one thread. "Alone" is one state after another, in C++. "In lanes" is a stage of `rollout`'s rk4 in a batch
of 64. Loads and derivatives are relative to the same arm's forward dynamics. An output is the extra time of each of
1000 more outputs in a run of the paper's link. A rollout of one scenario is relative to the same without lanes. Calls
from Python have NumPy arrays as input and output. The aims are for AVX-512. Operations are the additions,
multiplications, divisions and roots of one forward dynamics in the motion that is measured.

{table(["work", *columns, "aim", f"with {columns[0]}", "operations"], rows)}

Measured by `python bench/speed/aims.py` ({about()}).
"""
    kept = [
        {"vectors": column, "work": k, "median_us": f"{np.median(x):.6g}", "least_us": f"{x.min():.6g}"}
        for column, t in zip(columns, times.values(), strict=True)
        for k, x in t.items()
    ]
    keep("speed_aims", words, kept, None, options.o)


if __name__ == "__main__":
    main()
