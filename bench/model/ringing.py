"""My arm rings: what command shaping does about it, on the paper's arm.

    python bench/model/ringing.py [-o DIR]

The hub turns by 0.5 rad in 0.4 s and stops: as it is, and shaped by ZV and ZVD for the first mode. Then the same with
the arm's frequencies off from what the shapers were made for. Ringing is the largest deflection of the tip in
the second after 1 s; every command has ended by then. Writes ringing.csv and ringing.png into DIR (default: here).
"""

from __future__ import annotations

import csv
import platform
import sys
from pathlib import Path
from typing import Any

import flexarm as fa
import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from reporting import finish, output_folder

COLOURS = {"unshaped": "#888888", "zv": "#D55E00", "zvd": "#0072B2"}
MOVE = fa.Motion([0, 0.4, 2], [0, 0.5, 0.5], [0, 0, 0], [0, 0, 0])  # quintic from rest to rest, then rest
T = np.linspace(0, 2, 2001)
OFF = np.linspace(-0.2, 0.2, 9)  # of the frequency


def paper_arm(frequency: float = 1.0) -> fa.Arm:
    """The paper's link (Sec. 5), its frequencies times a factor."""
    steel = fa.Material(7850, 209e9 * frequency**2, 0.3)
    beam = fa.Beam(0.5, fa.Rectangle(0.001, 0.02), steel, {"bending_y": 3}, order=3)
    return fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(end=(0.075, 0, 0)), beam)])


def swing(motion: fa.Motion, frequency: float = 1.0) -> fa.Result:
    return fa.simulate(paper_arm(frequency), T, drive={0: motion}, integrator="gauss", step=0.01)


def ringing(run: fa.Result) -> float:
    return float(np.abs(run.tip_deflection()[run.t >= 1.0, 1]).max())


def main() -> None:
    out = output_folder(__doc__)

    w = paper_arm().modes(lock=[0]).frequencies[0]
    shapers = {kind: fa.input_shaper(kind, w) for kind in ("zv", "zvd")}
    motions = {"unshaped": MOVE} | {kind: shaper.shape(MOVE) for kind, shaper in shapers.items()}
    runs = {name: swing(motion) for name, motion in motions.items()}
    left = {name: np.array([ringing(swing(motion, 1 + e)) for e in OFF]) for name, motion in motions.items()}

    rows: list[dict[str, Any]] = []
    for name, run in runs.items():
        row = {"command": name, "duration (s)": f"{0.4 + (shapers[name].duration if name in shapers else 0):.3f}"}
        row |= {"ringing (mm)": f"{1e3 * ringing(run):.3g}"}
        for e in (-0.1, 0.0, 0.1):
            k = int(np.argmin(np.abs(OFF - e)))
            row[f"left at {100 * e:+.0f} % (%)"] = f"{100 * left[name][k] / left['unshaped'][k]:.1f}"
        row["peak hub torque (N m)"] = f"{np.abs(run.tau[:, 0]).max():.3f}"
        rows.append(row)
        print("  ".join(f"{v!s:>10}" for v in row.values()))
    with (out / "ringing.csv").open("w", newline="") as f:
        f.write(f"# flexarm {fa.__version__}, {platform.machine()}, Python {platform.python_version()}\n")
        writer = csv.DictWriter(f, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)

    figure, (a, b, c) = plt.subplots(1, 3, figsize=(10.0, 3.7), layout="constrained")
    for name, run in runs.items():
        look = {"color": COLOURS[name], "label": name if name == "unshaped" else name.upper(), "lw": 1.4}
        a.plot(run.t, run.q[:, 0], **look)
        b.plot(run.t, 1e3 * run.tip_deflection()[:, 1], **look)
    off = np.linspace(-0.2, 0.2, 201)
    for name, shaper in shapers.items():
        label = name.upper()
        c.plot(100 * off, 100 * shaper.residual(w * (1 + off)), color=COLOURS[name], label=f"{label}, theory")
        c.plot(100 * OFF, 100 * left[name] / left["unshaped"], "o", color=COLOURS[name], label=f"{label}, simulated")
    a.set(xlabel="time (s)", ylabel="hub angle (rad)", xlim=(0, 1))
    b.set(xlabel="time (s)", ylabel="tip deflection (mm)", xlim=(0, 2))
    c.set(xlabel="arm's frequency is off by (%)", ylabel="ringing left (% of unshaped)")
    for ax, title in ((a, "a: the command"), (b, "b: the tip"), (c, "c: a wrong frequency")):
        ax.set_title(title, fontsize=10, loc="left")
    b.set_ylim(b.get_ylim()[0], 1.45 * b.get_ylim()[1])
    a.legend(frameon=False, fontsize=9, loc="lower right")
    b.legend(handlelength=1.2, columnspacing=1.2, frameon=False, fontsize=9, loc="upper right", ncols=3)
    c.legend(frameon=False, fontsize=9, loc="upper center")
    finish(figure, out / "ringing.png")


if __name__ == "__main__":
    main()
