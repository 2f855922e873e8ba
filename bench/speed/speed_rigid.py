"""One evaluation against pinocchio's: forward dynamics, mass matrix and inverse dynamics of rigid chains, and of
flexible arms against pinocchio's rigid one.

    python bench/speed/speed_rigid.py [--runs 5] [-o DIR]

Compiles bench/speed/pinocchio twice, flexarm and pinocchio always with the same flags: as flexarm is shipped (-O3, for
any processor of the kind) and with -march=native. Pinocchio's headers come from the wheel `pin` of PyPI, in an
environment under build/peers; Eigen is the system's. The two programs run in turn. Writes speed_rigid.csv,
speed_rigid.png and its section of docs/speed.md (with -o only the files, into DIR).
"""

from __future__ import annotations

import argparse
import csv
import os
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
from speed_common import ROOT, Figure, about, keep, python_of, ratio, table

FLAGS = {"portable": "", "native": "-march=native"}
RIGID = ("rigid 7", "rigid 20", "rigid 100")
FLEXIBLE = ("flexible 7 x (3+3+1)", "planar 2 x 3")
FUNCTIONS = {
    "forward dynamics": ("pinocchio aba (world)", "pinocchio aba (local)"),
    "mass matrix": ("pinocchio crba (world)", "pinocchio crba (local)"),
    "inverse dynamics": ("pinocchio rnea",),
}
Times = dict[tuple[str, str, str], np.ndarray]  # flags, scene, function: ns of every round


def build(flags: str) -> Path:
    """The program; compiled again where something changed."""
    python = python_of("pin", ["pin"])
    where = [python, "-c", "import sysconfig; print(sysconfig.get_paths()['purelib'])"]
    site = subprocess.run(where, check=True, capture_output=True, text=True).stdout.strip()
    folder = ROOT / "build" / "bench" / f"pinocchio-{flags}"
    source = ROOT / "bench" / "speed" / "pinocchio"
    configure = ["cmake", "-G", "Ninja", "-S", source, "-B", folder, "-DCMAKE_BUILD_TYPE=Release"]
    configure += [f"-DPINOCCHIO_PREFIX={site}/cmeel.prefix", f"-DCMAKE_CXX_FLAGS={FLAGS[flags]}"]
    subprocess.run(configure, check=True, stdout=subprocess.DEVNULL)
    subprocess.run(["cmake", "--build", folder, "-j", str(os.cpu_count()), "--target", "speed_rigid"], check=True)
    return folder / "speed_rigid"


def run(programs: dict[str, Path], runs: int) -> tuple[Times, list[str]]:
    """All programs in turn, `runs` times; and what they remark."""
    rounds: dict[tuple[str, str, str], list[float]] = {}
    remarks: list[str] = []
    for _ in range(runs):
        for flags, program in programs.items():
            lines = subprocess.run([program], check=True, capture_output=True, text=True).stdout.splitlines()
            remarks = remarks or [x[2:] for x in lines if x.startswith("#")]
            for row in csv.DictReader(x for x in lines if not x.startswith("#")):
                rounds.setdefault((flags, row["scene"], row["function"]), []).append(float(row["ns"]))
    return {k: np.array(v) for k, v in rounds.items()}, remarks


def best_peer(times: Times, flags: str, scene: str, function: str) -> np.ndarray:
    """Pinocchio's rounds, in whichever convention is faster here."""
    return min((times[flags, scene, name] for name in FUNCTIONS[function]), key=lambda x: float(np.median(x)))


def against(times: Times, flags: str, scene: str, function: str, peer_scene: str | None = None) -> float:
    """Median over the rounds of flexarm's time over pinocchio's."""
    mine = times[flags, scene, f"flexarm {function}"]
    return float(np.median(mine / best_peer(times, flags, peer_scene or scene, function)))


def page(times: Times, remarks: list[str]) -> str:
    rows: list[list[Any]] = []
    for scene in (*RIGID, *FLEXIBLE):
        for function in FUNCTIONS if scene in RIGID else ("forward dynamics",):
            row: list[Any] = [scene, function]
            for flags in FLAGS:
                own = float(np.median(times[flags, scene, f"flexarm {function}"]))
                peer = best_peer(times, flags, scene if scene in RIGID else "rigid 7", function)
                other = None if scene in FLEXIBLE else float(np.median(peer))
                row += [own, other, against(times, flags, scene, function, None if scene in RIGID else "rigid 7")]
            rows.append(row)
    head = ["scene", "function"]
    for flags in ("-O3", "native"):
        head += [f"flexarm {flags} (ns)", f"pinocchio {flags} (ns)", "ratio"]
    aims = []
    for scene, aim in (("rigid 7", 0.4), ("rigid 100", 0.4), (FLEXIBLE[0], 4.0), (FLEXIBLE[1], 0.3)):
        peer = scene if scene in RIGID else "rigid 7"
        found = [against(times, f, scene, "forward dynamics", peer) for f in FLAGS]
        shipped = times["portable", scene, "flexarm forward dynamics"]
        found.append(float(np.median(shipped) / np.median(best_peer(times, "native", peer, "forward dynamics"))))
        aims.append([scene, *(ratio(x, aim, below=True) for x in found)])
    version = next((x.split()[1].rstrip(",") for x in remarks if x.startswith("pinocchio")), "")
    compiler = next((x.split(", ", 1)[1] for x in remarks if x.startswith("pinocchio")), "")
    return f"""
One evaluation, medians of CPU time, one thread; ratios are medians over rounds of the two programs' times in the same
round. Both are compiled with the same flags; flexarm's kernels choose their instruction set at run time, whatever the
flags, so that -O3 alone is not the same for both. Pinocchio's algorithms have two conventions, of which the faster is
shown; its crba fills half of the matrix, flexarm's mass matrix is whole and moves the arm with its rates. Flexible
arms (order 2) are held against pinocchio's *rigid* chain of 7.

{table(head, rows)}

Aims, as ratios of forward dynamics. The last column is the hardest: flexarm as it is shipped, pinocchio compiled for
this processor.

{table(["scene", "both -O3", "both -march=native", "flexarm -O3, pinocchio -march=native"], aims)}

{chr(10).join(f"- {x}" for x in remarks if x.startswith("rigid"))}

![Time of one evaluation](figures/speed_rigid.png)

Measured by `python bench/speed/speed_rigid.py` ({about(pinocchio=version, compiler=compiler)}).
"""


def draw(times: Times) -> Figure:
    figure = Figure(figsize=(9, 4.4), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    scenes = (*RIGID, *FLEXIBLE)
    for ax, flags in zip(axes, FLAGS, strict=True):
        x = np.arange(len(scenes))
        own = [np.median(times[flags, s, "flexarm forward dynamics"]) for s in scenes]
        peer = [np.median(best_peer(times, flags, s if s in RIGID else "rigid 7", "forward dynamics")) for s in scenes]
        ax.bar(x - 0.2, own, 0.4, label="flexarm", color="tab:blue")
        ax.bar(x[:3] + 0.2, peer[:3], 0.4, label="pinocchio aba, same chain", color="tab:orange")
        ax.bar(x[3:] + 0.2, peer[3:], 0.4, label="pinocchio aba, rigid 7", color="moccasin")
        for k in x:
            ax.annotate(f"{own[k] / peer[k]:.2g}×", (k - 0.2, own[k]), ha="center", va="bottom", fontsize=8)
        ax.set(yscale="log", title="-O3" if flags == "portable" else "-O3 -march=native")
        ax.set_xticks(x, [s.replace(" x ", "×").replace(" ", "\n") for s in scenes], fontsize=8)
        ax.grid(axis="y", alpha=0.3)
    axes[0].set_ylabel("one forward dynamics (ns)")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8)
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("-o", type=Path)
    options = parser.parse_args()
    times, remarks = run({flags: build(flags) for flags in FLAGS}, options.runs)
    rows = [
        {"flags": f, "scene": s, "function": name, "median_ns": f"{np.median(x):.6g}", "least_ns": f"{x.min():.6g}"}
        for (f, s, name), x in times.items()
    ]
    keep("speed_rigid", page(times, remarks), rows, draw(times), options.o)


if __name__ == "__main__":
    main()
