"""The least time of moves by each method of `fa.plan_move`; and how far the tip of a planned move strays from a line
that its joints keep to.

    python bench/command/methods.py

Prints the table and the numbers of docs/moves.md.
"""

from __future__ import annotations

import time
import warnings

import flexarm as fa
import numpy as np

STEEL = fa.Material(7850, 209e9, 0.3)


def two(shapes: int = 3, thick: float = 0.008) -> fa.Arm:
    """The arm of docs/moves.md."""
    beam = fa.Beam(0.5, fa.Rectangle(thick, 0.03), STEEL, {"bending_y": shapes}, basis="legendre", order=2)
    hub = {"end": (0.05, 0, 0)}
    return fa.Arm([
        fa.Link(fa.Revolute("z"), fa.RigidBody(0.3, **hub), beam),
        fa.Link(fa.Revolute("z"), fa.RigidBody(0.5, **hub), beam, fa.RigidBody(1.0)),
    ])  # fmt: skip


def found(arm: fa.Arm, end: list[float], method: str, speed: float | None) -> str:
    begun = time.perf_counter()
    move = fa.plan_move(arm, [0, 0], end, limits={"torque": (60, 15), "speed": speed}, method=method)
    return f"{move.duration:.4f} s, found in {time.perf_counter() - begun:.0f} s"


def strays(thick: float) -> float:
    """How far the tip is off the line at most (m)."""
    arm = two(thick=thick)
    tip = {"x": fa.Motion([0, 1], [0.8, 0.4], ends="rest"), "y": fa.Motion([0, 1], [-0.3, 0.5], ends="rest")}
    posture = arm.zero
    posture[[0, 4]] = -1, 1
    line = fa.invert(arm, tip, posture=posture, method="rigid")
    move = fa.plan_move(arm, path=line.q[:, [0, 4]], limits={"torque": (60, 15), "speed": 3})
    along = np.array([-0.4, 0.8]) / np.hypot(0.4, 0.8)
    places = move.simulate().frame()[0][:, :2] - [0.8, -0.3]
    return float(np.abs(places @ [-along[1], along[0]]).max())


def main() -> None:
    warnings.simplefilter("ignore")
    methods = ("shaped", "fast", "optimal")
    print("| move, without gravity | " + " | ".join(methods) + " |\n" + "|-" * 4 + "|")
    moves = [("two links, to (1, -1), 8 rad/s", 3, [1, -1], 8)]
    moves += [("one shape a beam, to (0.5, -0.5)", 1, [0.5, -0.5], None)]
    for name, shapes, end, speed in moves:
        print(f"| {name} | " + " | ".join(found(two(shapes), end, method, speed) for method in methods) + " |")
    for thick in (0.008, 0.04):
        print(f"beams of {1e3 * thick:g} mm: the tip strays by {1e3 * strays(thick):.2g} mm")


if __name__ == "__main__":
    main()
