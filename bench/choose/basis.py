"""Which basis suits what a beam carries: the table in docs/choosing.md.

    python bench/choose/basis.py [-o DIR]

Errors of the tip over its span, of two to four modes of each basis, against ten Legendre polynomials (which eight
check); all of order "exact", by "gauss" in steps of 5 ms. Puts the table between the marks in DIR/choosing.md (DIR:
docs by default).
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import flexarm as fa
import numpy as np

BEGIN, END = "<!-- table: bench/choose/basis.py -->", "<!-- end of table -->"
COUNTS = (2, 3, 4)
ALUMINIUM = fa.Material(2700.0, 70e9, 0.33)
T = np.linspace(0.0, 2.0, 101)


@dataclass(frozen=True)
class Case:
    """One row: an arm, what drives it, and what the modes of each beam's loaded basis carry."""

    name: str
    arm: fa.Arm
    drive: dict
    carried: tuple[fa.RigidBody | None, ...]


def strip(y: float, length: float) -> fa.Beam:
    return fa.Beam(length, fa.Rectangle(y, 0.04), ALUMINIUM, {"bending_y": 3}, order="exact")


def payload(name: str, ratio: float) -> Case:
    """A torque that swings a strip and leaves it ringing."""
    beam = strip(0.004, 1.0)
    tip = fa.RigidBody(ratio * beam.mass) if ratio else None
    inertia = beam.mass * beam.length**2 * (1 / 3 + ratio)
    torque = inertia * min(8.0, 6.72 / (beam.mass * (ratio + 0.25)))
    law = fa.Torque([0, 0.05, 0.25, 0.35, 0.55, 0.6, 2], [0, torque, torque, -torque, -torque, 0, 0])
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(end=(0.05, 0, 0)), beam, tip)])
    return Case(name, arm, {0: law}, (tip,))


def two_links() -> Case:
    first, second = strip(0.006, 1.0), strip(0.004, 0.8)
    tip = fa.RigidBody(second.mass)
    arm = fa.Arm([fa.Link(fa.Revolute("z"), None, first), fa.Link(fa.Revolute("z"), None, second, tip)])
    drive = {0: fa.Motion.spin_up(2.0, 1.0), 1: fa.Motion.spin_up(-2.0, 1.0)}
    return Case("another such link, with a tip, its joint driven", arm, drive, (fa.RigidBody(2 * second.mass), tip))


def tip_path(case: Case, basis: str, n: int, step: float = 5e-3) -> np.ndarray:
    links = []
    for link, body in zip(case.arm.links, case.carried, strict=True):
        loaded = {"basis_tip": body} if basis == "loaded" else {}
        links.append(replace(link, beam=replace(link.beam, modes={"bending_y": n}, basis=basis, **loaded)))
    result = fa.simulate(fa.Arm(links), T, drive=case.drive, integrator="gauss", step=step)
    return result.frame()[0]


def row(case: Case) -> str:
    truth = tip_path(case, "legendre", 10, 2.5e-3)

    def error(path: np.ndarray) -> float:
        return float(np.linalg.norm(path - truth, axis=1).max() / np.ptp(truth, axis=0).max())

    check = error(tip_path(case, "legendre", 8))
    print(f"{case.name}: the truth is known to {check:.0e}", flush=True)
    cells = []
    for basis in ("clamped-free", "legendre", "loaded"):
        if basis == "loaded" and case.carried[-1] is None:
            cells.append("as clamped-free")
            continue
        found = [error(tip_path(case, basis, n)) for n in COUNTS]
        cells.append(", ".join(f"{x:.1e}" if x > 2 * check else f"below {2 * check:.0e}" for x in found))
    return f"| {case.name} | " + " | ".join(cells) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", type=Path, default=Path(__file__).parents[2] / "docs")
    page = parser.parse_args().o / "choosing.md"
    cases = [
        payload("nothing", 0.0),
        payload("a tip as heavy as the beam", 1.0),
        payload("a tip ten times as heavy", 10.0),
        two_links(),
    ]
    head = "| load on the beam's end " + '| `"clamped-free"`, the default | `"legendre"` | `"loaded"` |\n|-|-|-|-|'
    table = "\n".join([head, *(row(case) for case in cases)])
    print(table)
    before, _, rest = page.read_text().partition(BEGIN)
    page.write_text(f"{before}{BEGIN}\n{table}\n{END}{rest.partition(END)[2]}")


if __name__ == "__main__":
    main()
