"""Work against precision: flexarm and other programs on the same beams, in one run.

    python bench/speed/peers.py [--cases a,b,c] [-o DIR] [--docs]

Cases (bench/speed/peer_common.py): (a) the paper's link spun up, (b) Simo and Vu-Quoc's spin-up, (c) two flexible links
driven by torques. Exudyn comes from PyPI into an environment of its own under build/peers, made when missing; SciPy,
flexarm and MuJoCo (pip install 'flexarm[mjcf]') run in this interpreter. Each program runs in a process of its own, one
after the other, on one thread.

The quantity is the tip's path in the world. The error of a run is the largest distance, over the output times, from a
converged path of the *same mechanics* (what strains the program's beam has), and at least what that path's own last
refinement moved it; how far the converged paths lie apart is reported too. The time is the CPU time of the simulation
alone, best of three; set-up is reported apart.

Writes peers.csv (every run), peers.json (the same with machine, commit, versions, converged models), peers-CASE.png and
table.md into DIR; with --docs also what docs/work-precision.md shows.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import platform
import subprocess
import sys
import time
import venv
from pathlib import Path
from typing import Any

import numpy as np
import peer_report
from peer_common import CASES

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
# worker: what it needs from PyPI; none: it runs in this interpreter
WORKERS = {"flexarm": [], "scipy": [], "exudyn": ["exudyn", "numpy"], "mujoco": []}
ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMEXPR")}


def python_of(worker: str, needs: list[str] | None = None) -> Path | str:
    """The interpreter of a worker, in an environment that is made when missing; `needs`: of one not in `WORKERS`."""
    needs = WORKERS[worker] if needs is None else needs
    if not needs:
        return sys.executable
    folder = ROOT / "build" / "peers" / worker
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    done = folder / "installed"
    if not done.exists():
        print(f"installing {worker} into {folder}", flush=True)
        venv.create(folder, with_pip=True, clear=True)
        subprocess.run([python, "-m", "pip", "install", "--quiet", *needs], check=True)
        done.touch()
    return python


def lines(worker: str, cases: str, truth: bool) -> list[dict[str, Any]]:
    """What a worker reports; a worker that fails is told on stderr and keeps what it reported before."""
    command = [python_of(worker), HERE / f"peer_{worker}.py", "--cases", cases, *(["--truth"] if truth else [])]
    start = time.perf_counter()
    environment = {**os.environ, **ONE_THREAD}
    out = subprocess.run(command, env=environment, cwd=HERE, capture_output=True, text=True)
    print(f"{worker:8s} {'truth' if truth else 'runs':5s} {time.perf_counter() - start:6.1f} s", flush=True)
    if out.returncode:
        print(f"{worker} failed: {out.stderr.strip()[-2000:]}", file=sys.stderr, flush=True)
    return [json.loads(line) for line in out.stdout.splitlines() if line.startswith("{")]


def distance(a: Any, b: Any) -> float:
    """Largest distance of two paths (m)."""
    return float(np.linalg.norm(np.asarray(a) - np.asarray(b), axis=1).max())


def compare(rows: list[dict[str, Any]]) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Runs with their errors, and converged models with their distances to one another, without paths."""
    models = {(r["case"], r["truth"]): r for r in rows if r["kind"] == "truth"}
    runs = []
    for row in rows:
        if row["kind"] == "run":
            model = models.get((row["case"], row["truth"]))
            known = model is not None and row["path"] is not None
            # no error is known better than the converged model itself
            error = max(distance(row["path"], model["path"]), model["converged"]) if known and model else None
            runs.append({k: v for k, v in row.items() if k not in ("kind", "path")} | {"error": error})
    truths = []
    for (case, name), model in models.items():
        apart = {n: distance(m["path"], model["path"]) for (c, n), m in models.items() if c == case and n != name}
        kept = {k: model[k] for k in ("case", "method", "setting", "truth", "converged")}
        truths.append({**kept, "distance": apart})
    return runs, truths


def machine() -> dict[str, str]:
    """The processor's model, the system, and the commit of this checkout."""
    cpu = platform.processor() or platform.machine()
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                cpu = line.split(":", 1)[1].strip()
                break
    except OSError:
        pass
    git = subprocess.run(["git", "describe", "--always", "--dirty"], cwd=ROOT, capture_output=True, text=True)
    return {"cpu": cpu, "system": platform.system(), "commit": git.stdout.strip() or "unknown"}


def write(folder: Path, runs: list[dict[str, Any]], truths: list[dict[str, Any]], about: dict[str, Any]) -> None:
    """The tables and figures."""
    folder.mkdir(parents=True, exist_ok=True)
    names = ["case", "method", "setting", "truth", "error", "cpu_s", "setup_s", "note"]
    with (folder / "peers.csv").open("w", newline="", encoding="utf-8") as f:
        out = csv.DictWriter(f, names, lineterminator="\n", extrasaction="ignore")
        out.writeheader()
        out.writerows(runs)
    ratios = peer_report.ratios(runs)
    text = json.dumps({"about": about, "ratios": ratios, "truths": truths, "runs": runs}, indent=1)
    (folder / "peers.json").write_text(text + "\n", encoding="utf-8")
    (folder / "table.md").write_text(peer_report.table(ratios, truths, runs, about), encoding="utf-8")
    for name in sorted({r["case"] for r in runs}):
        mine = [r for r in runs if r["case"] == name]
        peer_report.figure(CASES[name], mine).savefig(folder / f"peers-{name}.png", dpi=110)


def update_docs(folder: Path, cases: list[str]) -> None:
    """Copies the figures, and the table to between the marks of the page."""
    page, figures = ROOT / "docs" / "work-precision.md", ROOT / "docs" / "figures"
    figures.mkdir(exist_ok=True)
    for name in cases:
        (figures / f"peers-{name}.png").write_bytes((folder / f"peers-{name}.png").read_bytes())
    head, rest = page.read_text(encoding="utf-8").split(peer_report.BEGIN)
    tail = rest.split(peer_report.END)[1]
    table = (folder / "table.md").read_text(encoding="utf-8")
    page.write_text(f"{head}{peer_report.BEGIN}\n\n{table}\n{peer_report.END}{tail}", encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", default="a,b,c", help="of a, b, c")
    parser.add_argument("-o", dest="folder", type=Path, default=ROOT / "build" / "peers" / "results")
    parser.add_argument("--docs", action="store_true", help="update docs/work-precision.md, its table and figures")
    arguments = parser.parse_args()
    cases = arguments.cases.split(",")
    if not set(cases) <= set(CASES):
        parser.error(f"--cases {arguments.cases}: must be of {', '.join(CASES)}")
    for worker in WORKERS:
        python_of(worker)
    start = time.perf_counter()
    rows: list[dict[str, Any]] = []
    for truth in (True, False):
        for worker in WORKERS:
            rows += lines(worker, arguments.cases, truth)
    runs, truths = compare(rows)
    found = {k: v for r in rows if r["kind"] == "versions" for k, v in r.items() if k != "kind"}
    about = {**machine(), "versions": found, "wall_s": round(time.perf_counter() - start)}
    write(arguments.folder, runs, truths, about)
    if arguments.docs:
        update_docs(arguments.folder, cases)
    print((arguments.folder / "table.md").read_text(encoding="utf-8"))


if __name__ == "__main__":
    main()
