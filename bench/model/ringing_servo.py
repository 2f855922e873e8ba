"""A joint that a servo holds: shapers made for the locked joint, and for the loop as it is closed.

    python bench/model/ringing_servo.py [-o DIR]

The paper's link; PD on its joint, whose reference turns by 0.5 rad in 0.4 s and stops. The reference as it is, and
shaped for the first vibration with the joint locked, and of the closed loop (`fa.closed_loop(...).shaper()`). Ringing:
the largest deflection of the tip in the second after the command has ended. Writes ringing-servo.csv and
ringing-servo.png into DIR (default: here).
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import flexarm as fa
import numpy as np
from flexarm.data.draw.style import BLUE, INK, RED, label_axes, new_figure
from ringing import paper_arm

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from reporting import output_folder

SERVOS = {"soft": (1.0, 0.01), "stiff": (5.0, 0.02)}  # N m/rad, N m s/rad
SHOWN = "soft"
T = np.linspace(0, 4, 4001)
MOVE = fa.Motion([0, 0.4, 4], [0, 0.5, 0.5], [0, 0, 0], [0, 0, 0])
COLOURS = {"unshaped": "#888888", "joint locked": RED, "closed loop": BLUE}


def run(kp: float, kd: float, shaper: fa.Shaper | None) -> tuple[fa.Result, float]:
    """The run, and the ringing (m)."""
    motion = MOVE if shaper is None else shaper.shape(MOVE)
    reference = np.array([motion(t)[0] for t in T])
    law = fa.PD(kp, kd, reference=(T, reference))
    r = fa.simulate(paper_arm(), T, control=law, integrator="gauss", step=0.01)
    end = 0.4 + (0.0 if shaper is None else shaper.duration)
    return r, float(np.abs(r.tip_deflection()[(T >= end) & (T < end + 1.0), 1]).max())


def main() -> None:
    out = output_folder(__doc__)
    arm = paper_arm()
    locked = arm.modes(lock=[0])
    rows, shown = [], {}
    for servo, (kp, kd) in SERVOS.items():
        loop = fa.closed_loop(arm, fa.PD(kp, kd))
        for kind in ("none", "zv", "zvd"):
            shapers = {"unshaped": None} if kind == "none" else {
                "joint locked": fa.input_shaper(kind, locked.frequencies[0]), "closed loop": loop.shaper(kind)
            }  # fmt: skip
            for name, shaper in shapers.items():
                r, left = run(kp, kd, shaper)
                if servo == SHOWN and kind != "zvd":
                    shown[name] = r
                w = "" if shaper is None else f"{np.pi / (shaper.times[1]):.2f}"
                rows.append({"servo": servo, "shaper": kind, "made for": name, "half a period is pi / (rad/s)": w,
                             "duration (s)": f"{0.4 + (shaper.duration if shaper else 0):.3f}",
                             "ringing (mm)": f"{1e3 * left:.3g}"})  # fmt: skip
                print("  ".join(f"{v!s:>12}" for v in rows[-1].values()))
    with (out / "ringing-servo.csv").open("w", newline="") as f:
        writer = csv.DictWriter(f, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    figure = new_figure(10.0, 3.8)
    a, b = figure.subplots(1, 2)
    for name, r in shown.items():
        label = name if name == "unshaped" else f"ZV, {name}"
        a.plot(T, r.q[:, 0], color=COLOURS[name], label=label, lw=1.5)
        b.plot(T, 1e3 * r.tip_deflection()[:, 1], color=COLOURS[name], label=label, lw=1.5)
    a.axhline(0.5, color=INK, lw=0.8, ls=":")
    label_axes(a, "joint angle (rad)", "time (s)")
    label_axes(b, "tip deflection (mm)", "time (s)")
    a.set_xlim(0, 2.5)
    b.set_xlim(0, 2.5)
    a.legend(frameon=False, fontsize=9, loc="lower right")
    figure.savefig(out / "ringing-servo.png", dpi=110)


if __name__ == "__main__":
    main()
