"""The times of moves of `fa.plan_move`: shaped, along the line, and of independent joints without and with stops; and
how far the tip of a planned move strays from a line that its joints keep to.

    python bench/command/methods.py

Prints the table and the numbers of docs/moves.md.
"""

from __future__ import annotations

import time
import warnings

import flexarm as fa
import numpy as np

STEEL = fa.Material(7850, 209e9, 0.3)


def two(shapes: int = 3, thick: float = 0.008, stop: float | None = None) -> fa.Arm:
    """The arm of docs/moves.md; its joints with stops at plus and minus `stop` (rad)."""
    stops = {} if stop is None else {"lower": -stop, "upper": stop, "limit_stiffness": 1e4}
    beam = fa.Beam(0.5, fa.Rectangle(thick, 0.03), STEEL, {"bending_y": shapes}, basis="legendre", order=2)
    hub = {"end": (0.05, 0, 0)}
    return fa.Arm([
        fa.Link(fa.Revolute("z", **stops), fa.RigidBody(0.3, **hub), beam),
        fa.Link(fa.Revolute("z", **stops), fa.RigidBody(0.5, **hub), beam, fa.RigidBody(1.0)),
    ])  # fmt: skip


def found(arm: fa.Arm, start: list[float], end: list[float], speed: float | None, kind: str) -> str:
    begun = time.process_time()
    ends = {"path": [start, end]} if kind == "line" else {"q_from": start, "q_to": end}
    method = "shaped" if kind == "shaped" else "fast"
    move = fa.plan_move(arm, **ends, limits={"torque": (60, 15), "speed": speed}, method=method)
    return f"{move.duration:.3f} s, found in {time.process_time() - begun:.0f} s"


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
    print("| move, without gravity | shaped | along the line | each joint its own way | with stops at 2.5 rad |")
    print("|-" * 5 + "|")
    moves = [("two links, 0, 0 to 1, -1, 8 rad/s", 3, [0, 0], [1, -1], 8)]
    moves += [("one shape a beam, 0, 0 to 0.5, -0.5", 1, [0, 0], [0.5, -0.5], None)]
    moves += [("two links, 0.3, 1.5 to -1, 0.2", 3, [0.3, 1.5], [-1, 0.2], None)]
    for name, shapes, start, end, speed in moves:
        kinds = [("shaped", None), ("line", None), ("free", None), ("free", 2.5)]
        cells = [found(two(shapes, stop=stop), start, end, speed, kind) for kind, stop in kinds]
        print(f"| {name} | " + " | ".join(cells) + " |", flush=True)
    for thick in (0.008, 0.04):
        print(f"beams of {1e3 * thick:g} mm: the tip strays by {1e3 * strays(thick):.2g} mm")


if __name__ == "__main__":
    main()
