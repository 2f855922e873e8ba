"""Which order of IDA's formulas? Work against error at max_order 2 to 5 on three cases.

    python bench/run/ida_order.py [-o DIR]

(a) the paper's spin-up; (b) a two-link arm with shear and torsion, stiff modes that stay quiet; (c) an undamped
beam that rings in its third mode. Writes ida_order.csv and ida_order.png into DIR (default: here). Error is the largest
distance of the tip from the truth: Gauss collocation of order 8, converged as the table says. A run that takes more
than 20 s is left out.
"""

from __future__ import annotations

import csv
import platform
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import flexarm as fa
import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.ticker import NullFormatter

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from reporting import output_folder

STEEL = fa.Material(7850, 209e9, 0.3)
ORDERS = (2, 3, 4, 5)
RTOLS = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
LIMIT = 20.0  # s


def paper_link(modes: int = 3) -> fa.Arm:
    """The paper's link (Sec. 5), order 2."""
    beam = fa.Beam(0.5, fa.Rectangle(0.001, 0.02), STEEL, {"bending_y": modes})
    return fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(end=(0.075, 0, 0)), beam)])


def spin_up() -> tuple[fa.Arm, dict[str, Any], float]:
    return paper_link(), {"t": np.linspace(0, 2, 101), "drive": {0: fa.Motion.spin_up(7.6, 0.5)}}, 5e-3


def two_links() -> tuple[fa.Arm, dict[str, Any], float]:
    """Torques that rise and fall smoothly: bending follows, torsion and shear (up to 1e5 rad/s) stay quiet."""
    modes = {"bending_y": 1, "torsion": 1, "shear_y": 1}
    body = fa.RigidBody(0.3, inertia=(1e-3, 1e-3, 1e-3), end=(0.075, 0, 0))
    links = [
        fa.Link(fa.Revolute(axis), body, fa.Beam(0.5, fa.Rectangle(0.004, 0.01), STEEL, modes, "legendre"), body)
        for axis in ("z", "y")
    ]
    s = np.linspace(0, 0.5, 201)
    push = {0: fa.Torque(s, 0.5 * np.sin(2 * np.pi * s) ** 4), 1: fa.Torque(s, 0.2 * np.sin(2 * np.pi * s) ** 4)}
    return fa.Arm(links), {"t": np.linspace(0, 0.5, 51), "drive": push}, 2.5e-3


def ringing() -> tuple[fa.Arm, dict[str, Any], float]:
    arm = paper_link()
    hold = {0: fa.Motion([0, 1], [0.0, 0.0])}
    return arm, {"t": np.linspace(0, 1, 101), "drive": hold, "q0": [0, 0, 0, 0.005]}, 2e-3


CASES: dict[str, Callable[[], tuple[fa.Arm, dict[str, Any], float]]] = {
    "a: the paper's spin-up": spin_up,
    "b: two links, quiet shear and torsion": two_links,
    "c: an undamped beam rings": ringing,
}


class TooLong(Exception):
    pass


def run(arm: fa.Arm, scene: dict[str, Any], rtol: float, order: int) -> tuple[fa.Result, float] | None:
    start = time.process_time()

    def watch(_: float) -> None:
        if time.process_time() - start > LIMIT:
            raise TooLong

    try:
        r = fa.simulate(arm, **scene, rtol=rtol, atol=1e-3 * rtol, max_order=order, progress=watch)
    except TooLong:
        return None
    return r, time.process_time() - start


def measure(name: str) -> list[dict[str, Any]]:
    """A row for each order and tolerance."""
    arm, scene, h = CASES[name]()
    fine, coarse = (fa.simulate(arm, **scene, integrator="gauss", step=x * h, stages=4).frame()[0] for x in (0.25, 0.5))
    known = np.abs(fine - coarse).max()
    rows = []
    for order in ORDERS:
        for rtol in RTOLS:
            got = run(arm, scene, rtol, order)
            row = {"case": name, "max_order": order, "rtol": f"{rtol:.0e}", "truth to (m)": f"{known:.1e}"}
            if got is None:
                row |= {"steps": "", "iterations": "", "cpu (ms)": f"> {1e3 * LIMIT:.0f}", "error (m)": ""}
            else:
                r, cpu = got
                row |= {"steps": r.stats["steps"], "iterations": r.stats["newton_iterations"]}
                row |= {"cpu (ms)": f"{1e3 * cpu:.3g}", "error (m)": f"{np.abs(r.frame()[0] - fine).max():.3g}"}
            rows.append(row)
            print("  ".join(f"{v!s:>12}" for v in row.values()), flush=True)
    return rows


def main() -> None:
    out = output_folder(__doc__)
    rows = [row for name in CASES for row in measure(name)]
    with (out / "ida_order.csv").open("w", newline="") as f:
        f.write(f"# flexarm {fa.__version__}, {platform.machine()}, Python {platform.python_version()}\n")
        writer = csv.DictWriter(f, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    figure, axes = plt.subplots(1, 3, figsize=(11, 3.8), layout="constrained")
    for ax, name in zip(axes, CASES, strict=True):
        for order in ORDERS:
            mine = [r for r in rows if r["case"] == name and r["max_order"] == order and r["steps"] != ""]
            ax.loglog([r["steps"] for r in mine], [float(r["error (m)"]) for r in mine], "o-", ms=4, label=f"{order}")
        ax.set(xlabel="steps", title=name)
        ax.title.set_fontsize(10)
        ax.grid(alpha=0.3)
        ax.xaxis.set_minor_formatter(NullFormatter())
    axes[0].set_ylabel("largest tip error (m)")
    axes[0].legend(title="max_order", fontsize=8)
    figure.savefig(out / "ida_order.png", dpi=110)


if __name__ == "__main__":
    main()
