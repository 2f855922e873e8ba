"""Writes the shipped recordings, python/flexarm/identify/validate/quanser/*.csv, from the originals at 500 Hz.

    python bench/identify/make_recordings.py lqr=ORIGINAL.csv fsf=ORIGINAL.csv

A row is the mean of five, at the mean of their times. Where a gauge was dead in any of the five, it stays exactly zero.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

FOLDER = Path(__file__).parents[2] / "python" / "flexarm" / "identify" / "validate" / "quanser"
COLUMNS = [f"{x}_deg" for x in ("joint1", "link1_deflection", "joint2", "link2_deflection")]
COLUMNS[2:2], COLUMNS[5:5] = ["motor1_current_A"], ["motor2_current_A"]
EACH = 5


def main() -> None:
    for given in sys.argv[1:]:
        name, path = given.split("=", 1)
        table = np.genfromtxt(path, delimiter=",", names=True)
        rows = len(table) // EACH * EACH
        blocks = [table[c][:rows].reshape(-1, EACH) for c in ("t_s", *COLUMNS)]
        for c, b in zip(COLUMNS, blocks[1:], strict=True):
            if "deflection" in c:
                b[(b == 0).any(axis=1)] = 0.0
        text = [",".join(["t_s", *COLUMNS])]
        text += [",".join(f"{x:.6g}" for x in row) for row in np.stack([b.mean(axis=1) for b in blocks], axis=1)]
        (FOLDER / f"{name}.csv").write_text("\n".join(text) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
