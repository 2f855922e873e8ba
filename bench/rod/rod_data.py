"""Writes tests/data/rods_in_space.json: rods in space, reckoned without flexarm.

    python bench/rod/rod_data.py

Equilibria and critical loads by shooting, frequencies of curved rods and rotating blades by collocation
(bench/rod/rod_truth.py), motions by Exudyn, extrapolated in mesh and step (bench/rod/rod_exudyn.py).
"""

from __future__ import annotations

import json
from dataclasses import asdict
from functools import partial
from typing import Any

import numpy as np
from rod_cases import BUCKLING, DYNAMICS, MORE, RINGS, STATICS
from rod_truth import Blade, Rod, critical, frequencies
from rods import ROOT, SPEEDS, _constant, _loads, exudyn, rods, shot

ABOUT = (
    "Written by bench/rod/rod_data.py. Rods in a row, clamped (or free: root is place and rotation vector), each with "
    "length, stiffness and inertia per length (diagonal or 36 numbers; force x y z, moment x y z; x along the rod), "
    "curvature at rest, and the rotation vector by which its root is turned against the end before. Forces act on the "
    "tip; follower_ ones turn with it. tip, orientation: of the end, from the root. between: of critical loads, in "
    "`force` and, at places in the tip's axes, `arms`. path: root, then the end of each piece, at times."
)
KEPT = {"elbow-smooth": 2.0, "spaghetti-smooth": 3.0, "follower": 3.0}  # until (s)


def main() -> None:
    data: dict[str, Any] = {"about": ABOUT, "equilibria": [], "buckling": [], "rings": [], "blades": [], "motions": []}
    for case in (*STATICS, *MORE):
        tip, R = shot(case)
        data["equilibria"].append({**asdict(case), "tip": tip.tolist(), "orientation": R.tolist()})
    for case in BUCKLING:
        if case.shoots:
            factor = critical(rods(case.pieces), partial(_loads, case), *case.between)
            data["buckling"].append({**asdict(case), "critical": factor})
    for ring in RINGS:
        rod = Rod(ring.piece.length, ring.piece.matrix, partial(_constant, ring.curvature))
        hertz = frequencies(rod, ring.piece.inertia, 6, ring.points) / (2 * np.pi)
        data["rings"].append({**asdict(ring), "hertz": hertz.tolist()})
    blade = Blade(30.0)
    for speed in SPEEDS:
        flap = blade.flap(speed, 2).tolist()
        row = {"stiffness": blade.stiffness, "inertia": blade.inertia, "speed": speed}
        data["blades"].append({**row, "flap": flap, "length": blade.tip(speed)})
    answers = {r["case"]: r for r in exudyn(",".join(KEPT)) if r["kind"] == "dynamic"}
    for case in DYNAMICS:
        if case.name in KEPT:
            use = case.times <= KEPT[case.name] + 1e-9
            path = np.array(answers[case.name]["path"])[use]
            rows = {"times": case.times[use].tolist(), "path": path.tolist(), "moved": answers[case.name]["moved"]}
            data["motions"].append({**asdict(case), **rows})
    out = ROOT / "tests" / "data" / "rods_in_space.json"
    out.write_text(json.dumps(data) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
