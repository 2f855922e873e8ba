"""Steps within the samples of a loop: how far each integrator moves the growth of a mode at 100 Hz.

    python bench/loop/sampled_steps.py [--check]

The loop is a PD at 1 kHz on the hub of a beam, one sample late. Its map over a sample is taken from runs, one from each
small displacement and rate and from the force under way, by central differences; the growth is that of its eigenvalue
at the mode. The truth is that of `fa.closed_loop`, which takes the arm exactly between samples. Writes the marked part
of docs/control.md; with --check it only prints it.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import flexarm as fa
import numpy as np

PAGE = Path(__file__).resolve().parents[2] / "docs" / "control.md"
PERIOD, KP, KD = 1e-3, 60.0, 1.0
STEPS = [("implicit", 1), ("implicit", 2), ("implicit", 4), ("implicit", 8), ("rk4", 4), ("gauss", 1)]
SMALL = 1e-7


def arm() -> fa.Arm:
    steel = fa.Material(7850, 209e9, 0.3)
    beam = fa.Beam(0.5, fa.Rectangle(0.0037, 0.03), steel, {"bending_y": 2}, "legendre", damping_ratio=0.002)
    return fa.Arm([fa.Link(fa.Revolute("z", reflected_inertia=0.02), beam=beam, tip=fa.RigidBody(0.05))])


def law() -> fa.LinearController:
    """A sample late by its own memory: u is what was computed at the sample before."""
    K = np.array([[KP, KD]])
    return fa.LinearController([[0.0]], K, [[1.0]], [[0.0, 0.0]], rate=1 / PERIOD, measure=[("joint", 0), ("rate", 0)])


def growth_of_runs(of: fa.Arm, integrator: str, parts: int, mode: complex) -> float:
    """Of the map [q; v; force] -> the same a sample later, at the pole nearest to `mode`."""
    n, K = of.nv, np.array([KP, KD])

    def ahead(x: np.ndarray) -> np.ndarray:
        run = fa.simulate(of, [0.0, PERIOD], x[:n], x[n : 2 * n], tau=x[2 * n] * np.eye(n)[0], integrator=integrator,
                          step=PERIOD / parts)  # fmt: skip
        return np.concatenate([run.q[-1], run.v[-1], [-K @ [x[0], x[n]]]])

    columns = [(ahead(SMALL * e) - ahead(-SMALL * e)) / (2 * SMALL) for e in np.eye(2 * n + 1)]
    s = np.log(np.linalg.eigvals(np.array(columns).T).astype(complex)) / PERIOD
    return float(s[np.abs(s - mode).argmin()].real)


def table() -> list[str]:
    of = arm()
    poles = fa.closed_loop(of, law()).poles
    mode = poles[np.abs(poles - 2j * np.pi * 100).argmin()]
    w = abs(mode)
    lines = [
        f"| integrator | steps in a sample | step times {w:.0f} rad/s, the mode's frequency | growth (1/s) | "
        "error (1/s) |",
        "|-|-|-|-|-|",
        f"| `fa.closed_loop` | | | {mode.real:.4f} | |",
    ]
    for integrator, parts in STEPS:
        found = growth_of_runs(of, integrator, parts, mode)
        ahead = w * PERIOD / parts
        lines.append(f'| `"{integrator}"` | {parts} | {ahead:.2f} | {found:.4f} | {found - mode.real:+.1g} |')
    return lines


def main() -> None:
    lines = table()
    print("\n".join(lines))
    if "--check" in sys.argv:
        return
    text = PAGE.read_text()
    mark = r"(<!-- steps_in_a_sample: [^\n]*-->\n).*?(<!-- end of steps_in_a_sample -->)"
    new, count = re.subn(mark, lambda m: m[1] + "\n".join(lines) + "\n" + m[2], text, flags=re.S)
    if count != 1:
        raise SystemExit(f"{PAGE}: the marks of steps_in_a_sample are missing")
    PAGE.write_text(new)


if __name__ == "__main__":
    main()
