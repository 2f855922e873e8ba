"""docs/servo.md: what each part of a drive costs in margins and in torque, and which gains are stable.

    python bench/loop/servo.py [--check] [-o DIR]

Writes the marked part of docs/servo.md, and servo-map.png into DIR (default: docs/figures); with --check it only
prints.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from reporting import replace_table

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "servo.md"
STEEL = fa.Material(7850, 209e9, 0.3)
BEAM = fa.Beam(0.5, fa.Rectangle(0.006, 0.03), STEEL, {"bending_y": 3}, "legendre", damping_ratio=0.01)
JOINT = fa.Revolute("z", reflected_inertia=0.05, damping=0.1)
ARM = fa.Arm([fa.Link(JOINT, beam=BEAM, tip=fa.RigidBody(0.2))])
ENCODER = fa.sensors.Encoder(pulses=2500, quadrature=True)
GAINS = {"kp": 60.0, "kv": 6.0}
PARTS: list[tuple[str, dict[str, Any]]] = [
    ("sampled at 1 kHz, the rate by differences", {"rate": 1000}),
    ("+ an encoder of 10 000 steps a turn", {"sensor": ENCODER}),
    ("+ a low pass of the rate, 100 Hz", {"filter": 100}),
    ("+ a delay of 1 ms", {"delay": 1e-3}),
    ("+ a current loop of 300 Hz", {"current_loop": 300}),
]
TURN = fa.Motion([0, 0.5, 1.5], [0, 0.5, 0.5], [0, 0, 0], [0, 0, 0])
T = np.linspace(0, 1.5, 1501)


def row(name: str, law: fa.Controller, without: fa.Controller) -> str:
    """`without`: the same law without steps of the encoder."""
    (m,) = fa.closed_loop(ARM, law).margins
    run, smooth = (fa.simulate(ARM, T, control=x, integrator="gauss", step=1e-3) for x in (law, without))
    off = 1e3 * np.abs(run.q[:, 0] - TURN(T)[0]).max()
    ripple = float(np.std((run.tau - smooth.tau)[50:450, 0]))  # while it turns
    gain = f"{m.gain[1]:.3g}" if np.isfinite(m.gain[1]) else "none"
    return f"| {name} | {np.degrees(m.phase):.1f} | {gain} | {1e3 * m.delay:.2f} | {off:.1f} | {ripple:.3f} |"


def table() -> str:
    lines = [
        "| drive | phase margin (deg) | gains stable up to | delay margin (ms) | largest error of a turn (mrad) "
        "| torque noise (N m) |",
        "|-|-|-|-|-|-|",
        row("continuous, `fa.PD`", *[fa.PD(**GAINS, reference=TURN)] * 2),
    ]
    given: dict[str, Any] = {**GAINS, "reference": TURN}
    for name, part in PARTS:
        given |= part
        lines.append(row(name, fa.Servo(0, **given), fa.Servo(0, **{**given, "sensor": None})))
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="print only")
    parser.add_argument("-o", type=Path, default=ROOT / "docs" / "figures", help="folder for the figure")
    options = parser.parse_args()
    found = table()
    print(found)
    if options.check:
        return
    whole = fa.Servo(0, **GAINS, **{k: v for _, part in PARTS for k, v in part.items()})
    fa.closed_loop(ARM, whole).stability_map().plot().savefig(options.o / "servo-map.png", dpi=95)
    replace_table(PAGE, "servo", found)


if __name__ == "__main__":
    main()
