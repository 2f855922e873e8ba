"""The figures of docs/closed-loops.md: strain feedback on the paper's arm at 500 Hz.

    python bench/loop/closed_loops.py [-o DIR]

Prints the table of the loop and its limits; writes closed-loop.png (poles, Nyquist and Bode diagrams) and
closed-loop-locus.png (poles over Ks at 100 Hz) into DIR (default: here).
"""

from __future__ import annotations

import sys
from pathlib import Path

import flexarm as fa
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from reporting import output_folder

MEASURED = [("joint", 0), ("rate", 0), ("strain", 0, 0.0, "K3")]
NONE = np.zeros((0, 0)), np.zeros((0, 3)), np.zeros((1, 0))


def law(rate: float, ks: float = -0.015) -> fa.Controller:
    return fa.LinearController(*NONE, [[0.22, 0.001, ks]], rate=rate, measure=MEASURED, motor=fa.Motor(62.584))


def main() -> None:
    out = output_folder(__doc__)
    arm = fa.load("ist_control").arm
    loop = fa.closed_loop(arm, law(500))
    print(loop)
    for over in ("gain", "control.0.rate", "control.0.delay", "link.0.tip.mass"):
        try:
            print(loop.limits(over))
        except ValueError as e:
            print(e)
    loop.plot().savefig(out / "closed-loop.png", dpi=95)
    locus = fa.closed_loop(arm, law(100)).locus(-np.geomspace(0.1, 1e-3, 80), "control.0.D.0.2")
    print(locus.crossings)
    locus.plot().savefig(out / "closed-loop-locus.png", dpi=95)


if __name__ == "__main__":
    main()
