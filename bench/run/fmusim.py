"""Units of FMI in the simulator that comes with the reference FMUs, fmusim, beside native runs: docs/fmi.md.

    python bench/run/fmusim.py PROGRAM [--docs]

PROGRAM is fmusim of the Reference FMUs 0.0.39 (https://github.com/modelica/Reference-FMUs, folder fmusim), built with
Debian's libxml2-dev, zlib1g-dev, libminizip-dev and libsundials-dev 6.4, without SUN_COMM_NULL. It frees a state by
its value where the standard wants its address, which the first line mends:

    sed -i 's/\\(Free[A-Za-z]*\\)(S, FMUState)/\\1(S, \\&FMUState)/' FMIUtil.c
    gcc -O1 -w -DSUN_COMM_NULL=NULL -DYY_NO_UNISTD_H '-DFMUSIM_VERSION="0.0.39"' -I. -I../include \\
        -I/usr/include/libxml2 -I/usr/include/minizip -o fmusim *.c ../src/FMI.c ../src/FMI[123].c \\
        ../src/structured_variable_name.*.c -lminizip -lsundials_cvode -lsundials_nvecserial \\
        -lsundials_sunmatrixdense -lsundials_sunlinsoldense -lxml2 -lz -ldl -lm

Each number is the largest difference of a coordinate (rad, m) from the native run, at output times of 1 ms over 0.1 s.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import flexarm as fa
import fmpy
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "bench"))
from flexarm.run.scene.fmu_variables import identifier  # noqa: E402
from reporting import replace_table  # noqa: E402

T = np.arange(101) * 1e-3
SCENES = {
    "ist, controlled": "ist_control",
    "crane": ROOT / "tests" / "data" / "crane.toml",
    **{name: ROOT / "bench" / "run" / "zoo" / f"{name}.toml" for name in
       ("boom", "picking", "free_base", "stick_and_slip", "whip")},
}  # fmt: skip
WAYS = {
    "steps": ["--interface-type", "cs"],
    "event mode": ["--interface-type", "cs", "--event-mode-used"],
    "CVode": ["--interface-type", "me", "--solver", "cvode", "--tolerance", "1e-8"],
}


class Unit:
    def __init__(self, program: Path, scene: fa.Scene, folder: Path, version: int) -> None:
        self.program, self.folder, self.file = program, folder, folder / "arm.fmu"
        scene.to_fmu(self.file, fa.Implicit(1e-3), version)
        variables = fmpy.read_model_description(str(self.file)).modelVariables
        self.q = [v.name for v in variables if v.name.startswith("q.")][: scene.arm.nq]
        self.force = next(v.name for v in variables if v.name.startswith("add.force."))

    def run(self, *options: str, begin: float = 0.0, end: float = T[-1]) -> np.ndarray:
        """q at output times (n, nq), behind events."""
        out = self.folder / "out.csv"
        times = ["--start-time", str(begin), "--stop-time", str(end), "--output-interval", "1e-3"]
        wanted = itertools.chain(*(("--output-variable", name) for name in self.q))
        subprocess.run([self.program, *times, *options, *wanted, "--output-file", out, self.file], check=True,
                       stdout=subprocess.PIPE)  # fmt: skip
        rows = np.array(list(csv.reader(out.read_text().splitlines()))[1:], dtype=float)
        due = T[(T > begin - 1e-9) & (T < end + 1e-9)]
        return rows[[np.flatnonzero(abs(rows[:, 0] - t) < 1e-9)[-1] for t in due], 1:]


def native(scene: fa.Scene, push: Any = None, force: str = "") -> np.ndarray:
    sim, out = fa.Simulation(scene, fa.Implicit(1e-3)), []
    pushed = np.array([force == f"add.force.{identifier(name)}" for name in scene.arm.coordinates])
    for k, t in enumerate(T):
        if k:
            if push is not None:
                sim.set_tau(push(T[k - 1]) * pushed)
            sim.step(until=t)
        out.append(sim.q.copy())
    return np.array(out)


def measured(program: Path, scene: fa.Scene, folder: Path, version: int) -> list[float]:
    unit = Unit(program, scene, folder, version)
    steps = native(scene)
    fine = fa.simulate(scene.arm, T, scene.q0, scene.v0, **scene.given(), integrator=fa.Gauss(tolerance=1e-9)).q
    found = [abs(unit.run(*WAYS[way]) - steps).max() for way in ("steps", *["event mode"] * (version == 3))]
    state = str(folder / "state")
    unit.run(*WAYS["steps"], "--final-fmu-state-file", state, end=0.05)
    found.append(abs(unit.run(*WAYS["steps"], "--initial-fmu-state-file", state, begin=0.05) - steps[50:]).max())
    (folder / "in.csv").write_text(f'"time","{unit.force}"\n0,0\n0.05,0.4\n0.1,-0.2\n')
    pushed = native(scene, lambda t: np.interp(t, [0, 0.05, 0.1], [0, 0.4, -0.2]), unit.force)
    found.append(abs(unit.run(*WAYS["steps"], "--input-file", str(folder / "in.csv")) - pushed).max())
    found.append(abs(unit.run(*WAYS["CVode"]) - fine).max())
    return found if version == 3 else [found[0], np.nan, *found[1:]]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("program", type=Path)
    parser.add_argument("--docs", action="store_true")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    lines = ["| arm | FMI | steps | in event mode | goes on from a file | input from a file | CVode, 1e-8 |",
             "|-|-|-|-|-|-|-|"]  # fmt: skip
    with TemporaryDirectory() as folder:
        for (name, file), version in itertools.product(SCENES.items(), (3, 2)):
            scene = replace(fa.load(file), t=T)
            cells = measured(options.program.resolve(), scene, Path(folder), version)
            told = " | ".join("" if np.isnan(x) else f"{x:.0e}" for x in cells)
            lines.append(f"| {name.replace('_', ' ')} | {version}.0 | {told} |")
            print(lines[-1], flush=True)
    if options.docs:
        replace_table(ROOT / "docs" / "fmi.md", "fmusim", "\n".join(lines))


if __name__ == "__main__":
    main()
