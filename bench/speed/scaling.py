"""Cost against the number of links: AB, CI, a step of IDA with either linear solver, an implicit step.

    cmake --preset release && cmake --build --preset release
    python bench/speed/scaling.py [-o DIR] [--docs] [--program build/release/bench_scaling]

Runs the program (about two minutes), and writes scaling.csv and scaling.png into DIR (default: here); with --docs into
docs/figures, and docs/scaling.md.
"""

from __future__ import annotations

import argparse
import csv
import io
import platform
import subprocess
from pathlib import Path

import flexarm as fa
import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt

ROOT = Path(__file__).resolve().parents[2]
COLUMNS = {
    "ab_us": ("AB, one evaluation", "tab:blue", "o-"),
    "ci_us": ("CI, one evaluation", "tab:orange", "s-"),
    "implicit_us": ("implicit, one step", "tab:green", "^-"),
    "ida_chain_us": ("IDA, one step, chain", "tab:purple", "o--"),
    "ida_dense_us": ("IDA, one step, dense", "tab:red", "s--"),
}
Rows = list[dict[str, str]]


def series(rows: Rows, kind: str, column: str) -> tuple[np.ndarray, np.ndarray]:
    """Links and microseconds, where measured."""
    mine = [(int(r["links"]), float(r[column])) for r in rows if r["kind"] == kind and r[column]]
    return tuple(np.array(x, dtype=float) for x in zip(*mine, strict=True))


def exponent(rows: Rows, kind: str, column: str) -> float:
    """Slope of log time over log links from 50 links on; nan with fewer than three points."""
    n, t = series(rows, kind, column)
    return float(np.polyfit(np.log(n[n >= 50]), np.log(t[n >= 50]), 1)[0]) if (n >= 50).sum() > 2 else np.nan


def crossover(rows: Rows, kind: str, cheap: str, dear: str) -> str:
    """Number of links from which `cheap` is faster, by interpolation of the logarithms."""
    n, t = series(rows, kind, cheap)
    _, u = series(rows, kind, dear)
    gain = np.log(u / t[: len(u)])
    if (gain > 0).all():
        return "at every number"
    k = int(np.nonzero(gain <= 0)[0].max())
    if k + 1 == len(gain):
        return "never"
    x = -gain[k] / (gain[k + 1] - gain[k])
    return f"from {np.exp(np.log(n[k]) + x * np.log(n[k + 1] / n[k])):.1f} links on"


def draw(rows: Rows, path: Path) -> None:
    figure, axes = plt.subplots(1, 2, figsize=(10, 4.4), sharey=True, layout="constrained")
    for ax, kind in zip(axes, ("rigid", "flexible"), strict=True):
        for column, (label, colour, style) in COLUMNS.items():
            slope = exponent(rows, kind, column)
            power = "" if np.isnan(slope) else f": N$^{{{slope:.2f}}}$"
            ax.loglog(*series(rows, kind, column), style, color=colour, ms=4, lw=1.2, label=label + power)
        ax.set(xlabel="links N", title="rigid links" if kind == "rigid" else "flexible links, 2 + 2 + 1 modes each")
        ax.grid(alpha=0.3)
        ax.legend(fontsize=8, title="exponent from 50 links on", title_fontsize=8)
    axes[0].set_ylabel("time (µs)")
    figure.savefig(path, dpi=100)


def page(rows: Rows, remarks: list[str], about: str) -> str:
    apart, set_up = ([f"- {x}" for x in remarks if ("set-up" in x) == wanted] for wanted in (False, True))
    lines = ["| | rigid links | flexible links |", "| - | - | - |"]
    for column, (label, _, _) in COLUMNS.items():
        slopes = [exponent(rows, kind, column) for kind in ("rigid", "flexible")]
        lines.append(f"| exponent: {label} | " + " | ".join("–" if np.isnan(x) else f"{x:.2f}" for x in slopes) + " |")
    for label, cheap, dear in (
        ("AB is faster than CI", "ab_us", "ci_us"),
        ("IDA: chain is faster than dense", "ida_chain_us", "ida_dense_us"),
    ):
        found = (crossover(rows, kind, cheap, dear) for kind in ("rigid", "flexible"))
        lines.append(f"| {label} | " + " | ".join(found) + " |")
    for links in (1, 7, 50, 1000):
        chosen = [next(r for r in rows if r["kind"] == k and r["links"] == str(links)) for k in ("rigid", "flexible")]
        for column, (label, _, _) in COLUMNS.items():
            if any(r[column] for r in chosen):
                lines.append(f"| {links} links: {label} (µs) | " + " | ".join(r[column] or "–" for r in chosen) + " |")
    return f"""# Cost against the number of links

How does the time of flexarm's algorithms grow with the number of links? The test is a chain of equal links that falls,
with hinges along z and y alternately; one core, medians of five rounds. IDA's time for a step is the time of a short
run (4 ms, rtol 1e-6), divided by its number of steps. It includes Jacobians or factorisations, Newton iterations and
failed steps.

![Cost against the number of links](figures/scaling.png)

{chr(10).join(lines)}

The operations of AB and of the implicit step are linear in N, and so are those of an iteration of IDA. Exponents above
1 come mostly from the processor's caches, which are large enough for short arms only; those of IDA also from more
iterations in a step. The beams here are copies of one beam and share its tables. Different beams have their own tables,
and exceed the caches earlier. As a check, the same number of links in many short arms needs as much memory, but has no
long chain (AB):

{chr(10).join(apart)}

CI's three matrices of nv² numbers are allocated only when CI is used. The cost of the set-up is linear in N, too:

{chr(10).join(set_up)}

CI was not measured for longer chains after an evaluation took more than half a second, nor the dense solver after such
a run.

Measured by `python bench/speed/scaling.py --docs` ({about}).
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", type=Path, default=Path(), help="folder for the table and the figure")
    parser.add_argument("--docs", action="store_true", help="write docs/scaling.md and docs/figures")
    parser.add_argument("--program", type=Path, default=ROOT / "build/release/bench_scaling")
    options = parser.parse_args()
    if not options.program.exists():
        parser.error(f"{options.program} is not there: cmake --preset release && cmake --build --preset release")
    out = ROOT / "docs/figures" if options.docs else options.o
    out.mkdir(parents=True, exist_ok=True)
    text = subprocess.run([options.program], check=True, capture_output=True, text=True).stdout
    commit = subprocess.run(["git", "-C", ROOT, "rev-parse", "--short", "HEAD"], capture_output=True, text=True)
    about = f"flexarm {fa.__version__} at {commit.stdout.strip() or 'no commit'}, {platform.machine()}"
    rows = list(csv.DictReader(line for line in io.StringIO(text) if not line.startswith("#")))
    remarks = [line[2:] for line in text.splitlines() if line.startswith("#")]
    (out / "scaling.csv").write_text(f"# {about}\n{text}")
    draw(rows, out / "scaling.png")
    words = page(rows, remarks, about)
    print(words)
    if options.docs:
        (ROOT / "docs/scaling.md").write_text(words)


if __name__ == "__main__":
    main()
