"""A unit of FMI 3.0 against the native simulation: time of a step of 1 ms through the interface, size of the archive.

    python bench/speed/fmi.py

Both take the same steps, in turns, by the implicit method; times are of the processor, medians of rounds. The program
writes the table into docs/fmi.md.
"""

from __future__ import annotations

import ctypes
import sys
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

import flexarm as fa
import fmpy
import numpy as np
from fmpy.fmi3 import FMU3Slave
from peers import machine

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from reporting import replace_table

ROOT = Path(__file__).resolve().parents[2]
STEP, ROUNDS, STEPS = 1e-3, 20, 100


def seven(order: int) -> fa.Arm:
    """7 links of 3 + 3 + 1 modes."""
    steel = fa.Material(7850, 209e9, 0.3)
    beam = fa.Beam(0.4, fa.Circle(0.01), steel, {"bending_y": 3, "bending_z": 3, "torsion": 1}, order=order)
    hub = fa.RigidBody(0.3, inertia=(1e-3,) * 3, end=(0.05, 0, 0))
    links = [fa.Link(fa.Revolute("zy"[k % 2], damping=1.0), hub, beam, fa.RigidBody(0.1)) for k in range(7)]
    return fa.Arm(links, gravity=(0, 0, -9.81))


def per_step(work: Callable[[], None]) -> float:
    """Time of a step (s)."""
    began = time.thread_time()
    for _ in range(STEPS):
        work()
    return (time.thread_time() - began) / STEPS


def measured(scene: fa.Scene, folder: Path) -> tuple[float, float, int]:
    """Times of a step, natively and through the interface (s), and the archive's size (bytes)."""
    file = folder / "arm.fmu"
    scene.to_fmu(file, fa.Implicit(STEP))
    about = fmpy.read_model_description(str(file))
    inside = folder / f"arm{len(list(folder.iterdir()))}"
    with zipfile.ZipFile(file) as archive:
        archive.extractall(inside)
    fmu = FMU3Slave(guid=about.guid, unzipDirectory=str(inside), modelIdentifier=about.coSimulation.modelIdentifier)
    fmu.instantiate()
    fmu.enterInitializationMode(startTime=0.0)
    fmu.exitInitializationMode()
    sim = fa.Simulation(scene, fa.Implicit(STEP))
    call = fmu.dll.fmi3DoStep
    call.argtypes = [ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_bool, *[ctypes.c_void_p] * 4]
    flags, reached, now = [ctypes.c_bool() for _ in range(3)], ctypes.c_double(), 0
    out = [ctypes.addressof(x) for x in (*flags, reached)]

    def step() -> None:
        nonlocal now
        if call(fmu.component, now * STEP, STEP, True, *out):
            raise SystemExit("a step failed")
        now += 1

    rounds = [(per_step(sim.step), per_step(step)) for _ in range(ROUNDS)]
    names = [v.valueReference for v in about.modelVariables if v.name.startswith("q.")]
    np.testing.assert_array_equal(fmu.getFloat64(names), sim.q)
    fmu.freeInstance()
    native, unit = zip(*rounds, strict=True)
    return median(native), median(unit), file.stat().st_size


def main() -> None:
    lines = ["| arm | native step | step of the unit | ratio | aim | archive |", "|-|-|-|-|-|-|"]
    with TemporaryDirectory() as folder:
        for name, order in (("7 x (3+3+1), order 2", 2), ("7 x (3+3+1), order 1", 1)):
            native, unit, size = measured(fa.Scene(seven(order), t=np.linspace(0, 10, 1001)), Path(folder))
            lines.append(f"| {name} | {1e6 * native:.1f} µs | {1e6 * unit:.1f} µs | {unit / native:.2f} | ≤ 30 µs | "
                         f"{size / 1e6:.1f} MB |")  # fmt: skip
    here = machine()
    lines += ["", f"{here['cpu']}, commit {here['commit']}; states of unit and simulation are equal to the last bit."]
    print("\n".join(lines))
    replace_table(ROOT / "docs" / "fmi.md", "times", "\n".join(lines))


if __name__ == "__main__":
    main()
