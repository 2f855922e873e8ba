"""The robot of three arms in flexarm and in Pinocchio, in one program, everything compiled with the same flags.

    python bench/run/loops_pinocchio.py [--flags portable,native] [--rounds 21]

Writes the robot for bench/speed/pinocchio/loops.cpp: flexarm's as a compiled scene; Pinocchio's joints, bodies and
balls that close its loops, and states at which these are closed, in a file of numbers. Then it compiles the program
(bench/speed/pinocchio_build.py), for any processor of the kind and for this one, runs it, and prints the table that
bench/run/loops.py puts into docs/loops.md.
"""

from __future__ import annotations

import argparse
import csv
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import flexarm as fa
import loops_arms as arms
import numpy as np
from loops_truth import DELTA, DELTA_TORQUES, Array
from loops_truth import delta as delta_truth

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "speed"))
from pinocchio_build import FLAGS, program

STATES = 16
# flags of the build, and flexarm's instruction set: the widest, or that for which Pinocchio is compiled
RUNS = {"-O3": ("portable", None), "-O3, flexarm without AVX": ("portable", "base"), "-march=native": ("native", None)}
FUNCTIONS = ("flexarm", "constraintDynamics", "lcaba", "flexarm, tree", "aba")


@dataclass
class Robot:
    """Pinocchio's: joints in its order, depth first, and the balls that close loops. Its rates in flexarm's order."""

    joints: list[tuple[int, Array | None, Array, Any]] = field(default_factory=list)  # parent, axis (none: a ball), at
    balls: list[tuple[int, Array, int, Array]] = field(default_factory=list)  # joint, place; joint, place
    rates: list[int] = field(default_factory=list)  # of each of Pinocchio's, its number in flexarm

    def add(self, parent: int, axis: Array | None, at: Array, rates: Iterable[int], body: Any = None) -> int:
        self.joints.append((parent, axis, at, body))
        self.rates += rates
        return len(self.joints)


def robot() -> Robot:
    """At zero all axes are the world's, as in flexarm."""
    whole, start = delta_truth()
    elbows, _, ways = DELTA.start()
    made, plate, first = Robot(), -1, np.zeros(3)

    def body(k: int, origin: Array) -> tuple[float, Array, Array]:
        return float(whole.mass[k]), start.p[k] - origin, whole.inertia[k]

    for arm in range(3):
        out, hinge = DELTA.way(arm)
        foot = DELTA.base * out
        upper = made.add(0, hinge, foot, [arm], body(arm, foot))
        for k, side in enumerate((-1, 1)):
            number = 3 + 2 * arm + k
            top = elbows[arm] + side * DELTA.apart / 2 * hinge
            low = top + DELTA.lower * ways[arm]
            rate = 3 + 2 * (number - 3)
            cross = made.add(upper, hinge, top - foot, [rate])
            rod = made.add(cross, np.cross(ways[arm], hinge), np.zeros(3), [rate + 1], body(number, top))
            if plate < 0:
                plate, first = made.add(rod, None, low - top, [15, 16, 17], body(9, low)), low
            else:
                made.balls.append((rod, low - top, plate, low - first))
    return made


def states(arm: fa.Arm) -> list[tuple[Array, Array, Array]]:
    """Closed, in motion, and with torques in the arms' hinges; the first is that of docs/loops.md."""
    rng = np.random.default_rng(5)
    tau = np.zeros(arm.nv)
    tau[:3] = DELTA_TORQUES
    found = [(np.array(arm.zero), np.zeros(arm.nv), tau)]
    for _ in range(STATES - 1):
        q, v, tau = np.array(arm.zero), np.zeros(arm.nv), np.zeros(arm.nv)
        q[:3], v[:3], tau[:3] = rng.uniform(-0.3, 0.3, 3), rng.uniform(-2, 2, 3), rng.uniform(-2, 2, 3)
        q, v = arm.assemble(q, v, hold=[0, 1, 2])
        found.append((q, v, tau))
    return found


def numbers(arm: fa.Arm) -> str:
    """The file that loops_peer.cpp reads: joints, balls, gravity, Pinocchio's rates in flexarm's order; states in
    flexarm's order and, again, in Pinocchio's."""
    of = robot()
    rows: list[list[Any]] = [[len(of.joints)]]
    for parent, axis, at, body in of.joints:
        mass, com, inertia = body or (0.0, np.zeros(3), np.zeros((3, 3)))
        rows.append([parent, *([0, 0, 0] if axis is None else axis), *at, mass, *com, *np.ravel(inertia)])
    rows.append([len(of.balls)])
    rows += [[a, *at_a, b, *at_b] for a, at_a, b, at_b in of.balls]
    rows += [list(arm.gravity), [len(of.rates), *of.rates], [STATES, arm.nq]]
    ball = arm.nq - 4  # the plate's, w x y z; in Pinocchio x y z w
    of_q: list[int] = []
    for k in of.rates:
        of_q += [ball + 1, ball + 2, ball + 3, ball] if k == 15 else [] if k in (16, 17) else [k]
    for q, v, tau in states(arm):
        rows += [[*q, *v, *tau], [*q[of_q], *v[of.rates], *tau[of.rates]]]
    return "\n".join(" ".join(f"{x:.17g}" for x in row) for row in rows) + "\n"


def measure(flags: list[str], rounds: int = 21) -> tuple[dict[str, dict[str, float]], list[str]]:
    """Of each run and function, the least of the rounds (s); and what the programs remark."""
    arm = arms.delta_arm()[0]
    found: dict[str, dict[str, float]] = {}
    remarks: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        scene, text = Path(folder) / "robot.json", Path(folder) / "robot.txt"
        fa.Scene(arm=arm, t=np.array([0.0, 0.1])).compile(scene)
        text.write_text(numbers(arm), encoding="utf-8")
        for name, (build, isa) in RUNS.items():
            if build not in flags:
                continue
            environment = {**os.environ, **({"FLEXARM_ISA": isa} if isa else {})}
            command = [program(build, "speed_loops"), scene, text, str(rounds)]
            out = subprocess.run(command, check=True, capture_output=True, text=True, env=environment).stdout
            lines = out.splitlines()
            remarks = remarks or [x[2:] for x in lines if x.startswith("#")]
            least = found.setdefault(name, {})
            for row in csv.DictReader(x for x in lines if not x.startswith("#")):
                seconds = 1e-9 * float(row["ns"])
                least[row["function"]] = min(least.get(row["function"], np.inf), seconds)
    return found, remarks


def table(found: dict[str, dict[str, float]], remarks: list[str]) -> str:
    """For docs/loops.md."""
    heads = ["both compiled with", "flexarm", "Pinocchio, `constraintDynamics`", "ratio", "`lcaba`",
             "without loops: flexarm", "Pinocchio, `aba`", "ratio"]  # fmt: skip
    lines = ["| " + " | ".join(heads) + " |", "|-" * len(heads) + "|"]
    for name, times in found.items():
        own, peer, other, tree, aba = (times[x] for x in FUNCTIONS)
        cells = [1e6 * own, 1e6 * peer, own / peer, 1e6 * other, 1e6 * tree, 1e6 * aba, tree / aba]
        lines.append(f"| {name} | " + " | ".join(f"{x:.2f}" for x in cells) + " |")
    return "\n".join([*lines, "", *(f"{x[0].upper()}{x[1:]}." for x in remarks)])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flags", default=",".join(FLAGS), help="of the builds")
    parser.add_argument("--rounds", type=int, default=21)
    args = parser.parse_args()
    print(table(*measure(args.flags.split(","), args.rounds)))


if __name__ == "__main__":
    main()
