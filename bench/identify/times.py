"""What fits cost: `fa.validate` of the shipped arm, and a fit of a spatial arm.

    python bench/identify/times.py [--docs]

Counts runs, and takes processor time in units of that of one run of the same model, taken before and after. With --docs
it puts the table between the marks of docs/identify.md. Takes a minute.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
from flexarm.identify.residuals import Residuals
from flexarm.identify.validate.rig import FOLDER, read, with_motion, with_values

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from reporting import replace_table

DOCS = Path(__file__).parents[2] / "docs" / "identify.md"
STEEL = fa.Material(7850, 209e9, 0.3)
LINKS = (("z", 0.6, 0.012, 1.0, 0.5), ("y", 0.5, 0.010, 0.7, 0.3), ("y", 0.4, 0.008, 0.4, 0.2))
TRUE = {
    "link.0.tip.mass": 1.15, "link.1.tip.mass": 0.62, "link.2.tip.mass": 0.45, "link.0.joint.damping": 0.65,
    "link.1.joint.damping": 0.24, "link.2.joint.damping": 0.26, "link.0.beam.material.youngs_modulus": 180e9,
    "link.1.beam.material.youngs_modulus": 230e9, "link.2.beam.material.youngs_modulus": 190e9,
    "drive.0.scale": 1.05, "drive.1.scale": 0.96,
}  # fmt: skip


def spatial() -> tuple[fa.Scene, fa.Data, dict[str, Any]]:
    """A three-link spatial arm, 4 s of it at 1 kHz, and what was measured."""
    links = [
        fa.Link(fa.Revolute(axis, reflected_inertia=0.02, damping=damping),
                beam=fa.Beam(length, fa.Rectangle(thick, 2 * thick), STEEL, damping_ratio=0.01,
                             modes={"bending_y": 2, "bending_z": 1, "torsion": 1}), tip=fa.RigidBody(mass))
        for axis, length, thick, mass, damping in LINKS
    ]  # fmt: skip
    t = np.linspace(0, 4, 4001)
    tau = [2 * np.sin(4.4 * t), -6 + 4 * np.sin(5.65 * t + 0.3), -1.5 + 2 * np.sin(8.17 * t + 1)]
    faces = ("+y", "+z", "+z")
    sensors = (*(fa.sensors.Encoder(k, pulses=4000, quadrature=True) for k in range(3)),
               *(fa.sensors.StrainGauge(link=k, x=0.01, face=face) for k, face in enumerate(faces)))  # fmt: skip
    options = {"integrator": "implicit", "step": 0.001}
    drive = {k: fa.Torque(t, x) for k, x in enumerate(tau)}
    scene = fa.Scene(fa.Arm(links), drive, sensors=sensors, t=t, options=options)
    run, rng = with_values(scene, TRUE).run(), np.random.default_rng(1)
    columns = {f"y{k}": s.read(run).y[:, 0] for k, s in enumerate(sensors)}
    columns |= {f"y{k}": columns[f"y{k}"] + 2e-6 * rng.normal(size=t.size) for k in range(3, 6)}
    units = dict.fromkeys(("y0", "y1", "y2"), "rad") | dict.fromkeys(("y3", "y4", "y5"), "1")
    data = fa.Data(t, columns | {f"tau{k}": x for k, x in enumerate(tau)}, units | {f"tau{k}": "N m" for k in range(3)})
    given = {"inputs": {k: f"tau{k}" for k in range(3)}, "outputs": {f"y{k}": f"sensor.{k}" for k in range(6)}}
    return scene, data, given


def driven() -> tuple[fa.Scene, fa.Data, list[str], dict[str, Any]]:
    """The same arm behind digital PIDs, from rest under gravity: what was commanded is known, not the torques."""
    scene, _, _ = spatial()
    t, rng = scene.t, np.random.default_rng(1)
    rise = 1 - np.exp(-2 * t)
    commands = [0.5 * np.sin(2 * t) * rise, 0.3 * np.sin(3 * t + 1) * rise, 0.4 * np.sin(4 * t) * rise]

    def loops(references: list[Any]) -> tuple[fa.LinearController, ...]:
        gains = ((30, 10, 3), (60, 20, 3), (20, 10, 1.5))
        shared = {"rate": 1000, "delay": 1e-3, "filter_time": 4e-3, "limit": 60}
        return tuple(fa.LinearController.pid(*k, i, reference=r, **shared)
                     for i, (k, r) in enumerate(zip(gains, references, strict=True)))  # fmt: skip

    names = [name for name in TRUE if not name.startswith("drive")]
    made = replace(scene, drive={}, q0="held", control=loops([(t, x) for x in commands]))
    run = with_values(made, {name: TRUE[name] for name in names}).run()
    y = [s.read(run).y[:, 0] for s in scene.sensors]
    columns = {f"y{k}": x + 2e-6 * rng.normal(size=t.size) * (k > 2) for k, x in enumerate(y)}
    columns |= {f"command{k}": x for k, x in enumerate(commands)}
    units = {name: "1" if name in ("y3", "y4", "y5") else "rad" for name in columns}
    given = {"inputs": {f"control.{k}.reference": f"command{k}" for k in range(3)},
             "outputs": {f"y{k}": f"sensor.{k}" for k in range(6)}}  # fmt: skip
    guess = replace(made, control=loops([0.0, 0.0, 0.0]))
    return guess, fa.Data(t, columns, units), [*names, "control.0.kp", "control.1.kp"], given


def cost(name: str, one: Callable[[], Any], work: Callable[[], Any]) -> str:
    """A row of the table: runs, derivatives, processor time, and that in runs."""
    counts = {"many": 0, "_derivatives": 0}
    kept = {key: getattr(Residuals, key) for key in counts}

    def counted(key: str) -> Callable[..., Any]:
        def call(self: Residuals, points: Any) -> Any:
            counts[key] += len(points) if key == "many" else 1
            return kept[key](self, points)

        return call

    def run() -> float:
        began = time.process_time()
        one()
        return time.process_time() - began

    before = [run() for _ in range(5)]
    for key in counts:
        setattr(Residuals, key, counted(key))
    began, wall = time.process_time(), time.perf_counter()
    work()
    took, waited = time.process_time() - began, time.perf_counter() - wall
    for key, method in kept.items():
        setattr(Residuals, key, method)
    single = float(np.median([*before, *(run() for _ in range(5))]))
    print(f"{name}: {waited:.3g} s, of which the processors worked {took:.3g} s")
    runs = f"{float(f'{took / single:.2g}'):.0f}"
    return f"| {name} | {counts['many']} | {counts['_derivatives']} | {took:.2g} s | {runs} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--docs", action="store_true", help="write the table into docs/identify.md")
    args = parser.parse_args()
    rig = with_motion(fa.load("quanser"), read("lqr"))
    scene, data, given = spatial()
    guess, recorded, names, asked = driven()
    with tempfile.TemporaryDirectory() as folder:
        mine = Path(folder) / "mine.csv"
        mine.write_bytes((FOLDER / "fsf.csv").read_bytes())
        rows = [
            cost("`flexarm validate quanser`", rig.run, fa.validate),
            cost("`flexarm validate quanser --data`, 20 s of data", rig.run, lambda: fa.validate(data=mine)),
            cost("11 numbers of a spatial arm with three links, 4 s of data at 1 kHz", scene.run,
                 lambda: fa.identify(scene, data, list(TRUE), **given)),
            cost("the same behind digital PIDs, from rest as they hold it; 9 numbers of the arm, 2 gains", guess.run,
                 lambda: fa.identify(guess, recorded, names, **asked)),
        ]  # fmt: skip
    head = "| fit | runs | with derivatives | processor time | in single runs |\n|-|-:|-:|-:|-:|\n"
    table = head + "\n".join(rows)
    print(table)
    if args.docs:
        replace_table(DOCS, "costs", table)


if __name__ == "__main__":
    main()
