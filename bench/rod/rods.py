"""Rods in space: flexarm, Exudyn's geometrically exact beam, shooting, closed forms and literature, in one run.

    python bench/rod/rods.py [-o DIR] [--docs]

Equilibria, buckling loads, frequencies at rest and in rotation, and motions of rods with all six strains
(bench/rod/rod_cases.py). Exudyn comes from PyPI into an environment of its own under build/peers, made when missing.
What is held against what: equilibria against shooting, buckling loads and frequencies against closed forms and
independent equations (bench/rod/rod_truth.py), motions against Exudyn's, extrapolated in mesh and step.

Writes table.md and rods-*.png into DIR; with --docs what docs/rods.md shows.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import rod_flexarm
import rod_report
from rod_cases import (
    BUCKLING,
    DYNAMICS,
    PRINCETON_ANGLES,
    PRINCETON_LENGTH,
    PRINCETON_LOADS,
    RINGS,
    STATICS,
    Buckling,
    Piece,
    Static,
    princeton,
)
from rod_truth import Blade, Loads, Rod, critical, equilibrium, frequencies
from scipy.spatial.transform import Rotation

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "bench" / "speed"))
from peers import ONE_THREAD, machine, python_of  # noqa: E402

SHAPES = (4, 6, 8, 10, 12)  # of each strain
SETTINGS = {  # shapes of each strain and step (s): the answer, and what it is checked by
    "elbow": ((14, 0.05), (16, 0.025)),
    "elbow-smooth": ((14, 0.05), (16, 0.025)),
    "spaghetti": ((12, 0.1), (14, 0.05)),
    "spaghetti-smooth": ((12, 0.1), (14, 0.1)),
    "follower": ((12, 0.05), (14, 0.025)),
}
SPEEDS = (0.0, 2.0, 4.0, 8.0)  # of blades
SLENDERNESS = (30.0, 1000.0)
# Wright, Smith, Thresher & Wang 1982: flapping of a blade that neither shears nor stretches, on the axis
WRIGHT = {0.0: (3.5160, 22.0345), 2.0: (4.1373, 22.6149), 4.0: (5.5850, 24.2733), 8.0: (9.2568, 29.9954)}

Row = dict[str, Any]


def rods(pieces: tuple[Piece, ...]) -> list[Rod]:
    """For rod_truth."""
    out = []
    for p in pieces:
        turn = Rotation.from_rotvec(p.turn).as_matrix()
        out.append(Rod(p.length, p.matrix, partial(_constant, np.array(p.curvature)), turn))
    return out


def _constant(value: np.ndarray, _: float) -> np.ndarray:
    return value


def shot(case: Static) -> tuple[np.ndarray, np.ndarray]:
    loads = Loads(case.force, case.moment, case.follower_force, case.follower_moment)
    return equilibrium(rods(case.pieces), loads, case.steps)


def exudyn(cases: str) -> list[Row]:
    """What the worker reports."""
    python = python_of("exudyn")
    command = [python, Path(__file__).with_name("rod_exudyn.py"), "--cases", cases]
    out = subprocess.run(command, env={**os.environ, **ONE_THREAD}, capture_output=True, text=True)
    if out.returncode:
        print(f"exudyn failed: {out.stderr.strip()[-2000:]}", file=sys.stderr, flush=True)
    return [json.loads(line) for line in out.stdout.splitlines() if line.startswith("{")]


def statics(peer: list[Row]) -> list[Row]:
    """By case: error of the tip, a part of the length, by number of shapes and of Exudyn's elements."""
    out = []
    for case in STATICS:
        tip = shot(case)[0]
        own = []
        for n in SHAPES:
            place, _, cpu, size = rod_flexarm.equilibrium(case, n)
            own.append({"shapes": n, "size": size, "error": _apart(place, tip) / case.length, "cpu_s": cpu})
        theirs = [r for r in peer if r["kind"] == "static" and r["case"] == case.name and r["tip"]]
        other = [{**r, "error": _apart(r["tip"], tip) / case.length} for r in theirs]
        out.append({"case": case, "tip": tip, "flexarm": own, "exudyn": other})
    return out


def strip(peer: list[Row]) -> list[Row]:
    """The Princeton beam: displacements of the tip and its twist, and how far the programs are from shooting."""
    theirs = {(r["load"], r["angle"]): r["tip"] for r in peer if r["kind"] == "princeton"}
    out = []
    for load in PRINCETON_LOADS:
        for angle in PRINCETON_ANGLES:
            case = princeton(load, angle)
            (tip, R), (own, turned, _, _) = shot(case), rod_flexarm.equilibrium(case, 8)
            twist, own_twist = (float(np.degrees(np.arctan2(x[2, 1], x[1, 1]))) for x in (R, turned))
            apart = _apart(theirs[load, angle], tip) / PRINCETON_LENGTH if (load, angle) in theirs else None
            row = {"load": load, "angle": angle, "tip": tip, "own": own, "exudyn": theirs.get((load, angle))}
            row |= {"twist": twist, "own_twist": own_twist}
            out.append({**row, "error": _apart(own, tip) / PRINCETON_LENGTH, "exudyn_error": apart})
    return out


def buckling() -> list[Row]:
    out = []
    for case in BUCKLING:
        own = rod_flexarm.buckled(case, 8)
        by_shooting = None
        if case.shoots:
            by_shooting = critical(rods(case.pieces), partial(_loads, case), *case.between)
        out.append({"case": case, "flexarm": own, "shooting": by_shooting})
    return out


def _loads(case: Buckling, factor: float) -> Loads:
    force = factor * np.array(case.force)
    return Loads(force=force, arms=tuple((place, factor * np.array(f)) for place, f in case.arms))


def rings() -> list[Row]:
    """Frequencies of arcs and a helical spring, clamped at one end."""
    out = []
    for ring in RINGS:
        rod, inertia = Rod(ring.piece.length, ring.piece.matrix, partial(_constant, ring.curvature)), ring.piece.inertia
        true = frequencies(rod, inertia, 6, ring.points) / (2 * np.pi)
        model = rod_flexarm.split(ring.piece, ring.links, ring.shapes)
        own = model.modes().frequencies[:6] / (2 * np.pi)
        out.append({"ring": ring, "true": true, "own": own, "error": float(np.abs(own / true - 1).max())})
        if ring.links > 1:
            out[-1]["clamped"] = frequencies(rod, inertia, 4, ring.points, clamped=True) / (2 * np.pi)
    return out


def blades() -> list[Row]:
    """Flapping frequencies and stretch of rotating blades."""
    out = []
    for slenderness in SLENDERNESS:
        blade = Blade(slenderness)
        model = rod_flexarm.arm((Piece(1.0, blade.stiffness, inertia=blade.inertia),), 10, fa.Revolute("z"))
        for speed in SPEEDS:
            modes = model.modes(speed={0: speed}, lock=[0])
            true = blade.flap(speed, 2)
            own = np.array([modes.frequencies[np.abs(modes.frequencies - x).argmin()] for x in true])
            stretch = float(np.linalg.norm(model.frame(modes.q)[0]))
            row = {"slenderness": slenderness, "speed": speed, "true": true, "own": own}
            out.append({**row, "tip": stretch, "tip_error": stretch - blade.tip(speed)})
    return out


def motions(peer: list[Row]) -> list[Row]:
    out = []
    for case in DYNAMICS:
        paths = [rod_flexarm.simulate(case, *setting) for setting in SETTINGS[case.name]]
        theirs = next((r for r in peer if r["kind"] == "dynamic" and r["case"] == case.name), None)
        row = {"case": case, "settings": SETTINGS[case.name], "path": paths[1][0], "sizes": [p[2] for p in paths]}
        row |= {"cpu_s": [p[1] for p in paths], "moved": _path_apart(paths[0][0], paths[1][0]).max()}
        if theirs:
            apart = _path_apart(paths[1][0], np.array(theirs["path"]))
            row |= {"exudyn": np.array(theirs["path"]), "exudyn_moved": theirs["moved"], "apart": apart}
            row |= {"exudyn_cpu_s": theirs["cpu_s"]}
        out.append(row)
    return out


def _apart(a: Any, b: Any) -> float:
    return float(np.linalg.norm(np.asarray(a) - np.asarray(b)))


def _path_apart(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Largest distance of any end, by time."""
    return np.asarray(np.linalg.norm((a - b).reshape(len(a), -1, 3), axis=2).max(axis=1))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", dest="folder", type=Path, default=ROOT / "build" / "rods")
    parser.add_argument("--docs", action="store_true", help="update docs/rods.md, its tables and figures")
    arguments = parser.parse_args()
    start = time.perf_counter()
    peer = exudyn("statics,princeton,dynamics")
    print(f"exudyn {time.perf_counter() - start:.0f} s", flush=True)
    found: Row = {}
    for name, part in (
        ("statics", lambda: statics(peer)),
        ("strip", lambda: strip(peer)),
        ("buckling", buckling),
        ("rings", rings),
        ("blades", blades),
        ("motions", lambda: motions(peer)),
    ):
        found[name] = part()
        print(f"{name} {time.perf_counter() - start:.0f} s", flush=True)
    versions = next((r["exudyn"] for r in peer if r["kind"] == "versions"), "none")
    about = {**machine(), "flexarm": fa.__version__, "exudyn": versions, "wright": WRIGHT}
    out = arguments.folder
    out.mkdir(parents=True, exist_ok=True)
    text = rod_report.tables(found, about)
    (out / "table.md").write_text(text, encoding="utf-8")
    for name, figure in rod_report.figures(found).items():
        figure.savefig(out / f"rods-{name}.png", dpi=110)
        if arguments.docs:
            figure.savefig(ROOT / "docs" / "figures" / f"rods-{name}.png", dpi=110)
    if arguments.docs:
        rod_report.keep(ROOT / "docs" / "rods.md", text)
    print(text)


if __name__ == "__main__":
    main()
