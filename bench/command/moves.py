"""Planned moves over poses and payloads: how much vibration is left, and how long they take.

    python bench/command/moves.py [-o DIR]

Three arms, each with several payloads, two of them between several poses: a link that turns, two links with a heavy
end in the plane, three links in space that bear their weight. Of each move: the time-optimal one of the rigid arm, that
one shaped by ZV (for the slowest locked mode at the end), `fa.plan_move(...)` as it is and with method="shaped".
Durations are in parts
of the rigid arm's plus half a period. What is left is how far the arm's end swings after the move, in a
simulation by IDA, in parts of what the unshaped one leaves. Writes moves.csv, moves.md and moves.png into DIR (default:
here). Prints, too: two masses and a spring; a servo with and without the torques of the move.
"""

from __future__ import annotations

import csv
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import flexarm as fa
import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from reporting import output_folder

STEEL, ALUMINIUM = fa.Material(7850, 209e9, 0.3), fa.Material(2700, 70e9, 0.33)
COLOURS = {"unshaped": "#888888", "ZV": "#D55E00", "shaped": "#0072B2", "fast": "#009E73"}


def one(payload: float) -> fa.Arm:
    beam = fa.Beam(0.7, fa.Rectangle(0.004, 0.03), STEEL, {"bending_y": 3}, order=3)
    hub = fa.RigidBody(0.1, inertia=(0, 0, 0.01), end=(0.05, 0, 0))
    return fa.Arm([fa.Link(fa.Revolute("z"), hub, beam, fa.RigidBody(payload))])


def two(payload: float) -> fa.Arm:
    def beam() -> fa.Beam:
        return fa.Beam(0.5, fa.Rectangle(0.008, 0.03), STEEL, {"bending_y": 3}, order=2)

    hub, elbow = fa.RigidBody(0.3, end=(0.05, 0, 0)), fa.RigidBody(0.5, end=(0.05, 0, 0))
    tip = fa.RigidBody(payload)
    return fa.Arm([fa.Link(fa.Revolute("z"), hub, beam()), fa.Link(fa.Revolute("z"), elbow, beam(), tip)])


def three(payload: float) -> fa.Arm:
    def beam(length: float, diameter: float) -> fa.Beam:
        modes = {"bending_y": 2, "bending_z": 2, "torsion": 1}
        return fa.Beam(length, fa.Circle(diameter), ALUMINIUM, modes, order=2)

    base = fa.Link(fa.Revolute("z"), fa.RigidBody(3.0, inertia=(0.01, 0.01, 0.01), end=(0, 0, 0.3)))
    upper = fa.Link(fa.Revolute("y"), fa.RigidBody(1.0), beam(0.6, 0.016))
    fore = fa.Link(fa.Revolute("y"), fa.RigidBody(0.8), beam(0.5, 0.012), fa.RigidBody(payload))
    return fa.Arm([base, upper, fore], gravity=(0, 0, -9.81))


#: arm, torques, payloads, (from, to)
Case = tuple[Callable[[float], fa.Arm], tuple[float, ...], tuple[float, ...], list[tuple[Any, Any]]]
CASES: dict[str, Case] = {
    "1 link": (one, (3.0,), (0.05, 0.2, 0.5), [([0.0], [0.4]), ([0.0], [1.5])]),
    "2 links": (two, (60.0, 15.0), (0.5, 1.0, 2.0),
                [([0, 0], [1, -1]), ([0.3, 1.5], [-1, 0.2]), ([0, 2.2], [0.8, 0.4])]),
    "3 links, gravity": (three, (30.0, 40.0, 15.0), (0.2, 0.5, 1.0),
                         [([0, 0.2, 0.5], [1.5, -0.5, 1.2])]),
}  # fmt: skip


def swing(move: fa.results.Move, drive: dict[Any, fa.Motion], end: float) -> float:
    """Of the arm's end after `end` seconds, with other motions from the same start (m)."""
    arm, start = move.arm, move.simulate(after=0.0).q[0]
    period = 2 * move.half_period
    t = np.append(0.0, end + np.linspace(0, 1.05 * period, 97))
    run = fa.simulate(arm, t, q0=start, drive=drive, rtol=1e-8)
    rest = arm.frame(move.simulate(after=0.0).q[-1])[0]
    return float(np.linalg.norm(run.frame()[0][1:] - rest, axis=1).max())


def zv(move: fa.results.Move) -> tuple[dict[Any, fa.Motion], float]:
    """The rigid move shaped, and its duration."""
    shaper = fa.input_shaper("zv", move.frequencies[1, 0])
    return {k: shaper.shape(m) for k, m in move.rigid_drive.items()}, move.rigid_duration + shaper.duration


def rows() -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    for name, (make, torque, payloads, poses) in CASES.items():
        for q_from, q_to in poses:
            for payload in payloads:
                arm, moves, took = make(payload), {}, {}
                for method in ("fast", "shaped"):
                    started = time.process_time()
                    moves[method] = fa.plan_move(arm, q_from, q_to, limits={"torque": torque}, method=method)
                    took[method] = time.process_time() - started
                move = moves["fast"]
                bound, whole = move.rigid_duration + move.half_period, move.residual_unshaped
                commands, end = zv(move)
                row = {
                    "arm": name, "from": q_from, "to": q_to, "payload": payload, "rigid": move.rigid_duration,
                    "half period": move.half_period, "swing": whole, "ZV": swing(move, commands, end) / whole,
                }  # fmt: skip
                for method, planned in moves.items():
                    row |= {
                        method: planned.residual / whole, f"{method} duration": planned.duration / bound,
                        f"{method} off": planned.residual_of(make(1.2 * payload)) / whole,
                        f"{method} peak": max(x.peak / x.limit for x in planned.limits),
                        f"{method} seconds": took[method],
                    }  # fmt: skip
                yield row, moves


def percent(x: float) -> str:
    return f"{100 * x:.2g} %"


def cells(row: dict[str, Any]) -> list[str]:
    def pose(q: Any) -> str:
        return ", ".join(f"{x:g}" for x in q)

    return [
        row["arm"], f"{pose(row['from'])} to {pose(row['to'])}", f"{row['payload']:g}",
        f"{row['rigid']:.3f} + {row['half period']:.3f}", f"{1e3 * row['swing']:.3g}", percent(row["ZV"]),
        *(cell for x in ("fast", "shaped") for cell in
          (percent(row[x]), f"{row[f'{x} duration']:.3f}", percent(row[f"{x} off"]))),
    ]  # fmt: skip


HEAD = [
    "arm", "joints (rad)", "payload (kg)", "rigid + half period (s)", "vibration, unshaped (mm)", "left by ZV",
    "left by the fast move", "its duration", "left with payload +20 %",
    "left by the shaped move", "its duration", "left with payload +20 %",
]  # fmt: skip


def figure(table: list[dict[str, Any]], moves: dict[str, Any], path: Path) -> None:
    fig, ((a, b), (c, d)) = plt.subplots(2, 2, figsize=(11, 7.4), layout="constrained")
    shaped, best = moves["shaped"], moves["fast"]
    for k, style in enumerate(("-", "--")):
        for name, move in (("shaped", shaped), ("fast", best)):
            most = [x.limit for x in move.limits if x.what == "torque"][k]
            a.plot(move.t, move.torques[:, k] / most, style, color=COLOURS[name], lw=1.4, label=f"{name}, joint {k}")
    a.axhline(1, color="#333333", lw=0.8)
    a.axhline(-1, color="#333333", lw=0.8)
    a.set(xlabel="time (s)", ylabel="torque, parts of its limit", ylim=(-1.2, 1.7))
    a.legend(frameon=False, fontsize=8, ncols=2, loc="upper right")
    commands, end = zv(shaped)
    drives = {"unshaped": (shaped.rigid_drive, shaped.rigid_duration), "ZV": (commands, end),
              "shaped": (shaped.drive, shaped.duration), "fast": (best.drive, best.duration)}  # fmt: skip
    start, goal = shaped.simulate(after=0.0).q[[0, -1]]
    t = np.linspace(0, 1.2, 1201)
    for name, (drive, stop) in drives.items():
        run = fa.simulate(shaped.arm, t, q0=start, drive=drive, rtol=1e-8)
        off = 1e3 * np.linalg.norm(run.frame()[0] - shaped.arm.frame(goal)[0], axis=1)
        b.semilogy(t, np.maximum(off, 1e-4), color=COLOURS[name], lw=1.3, label=name)
        b.plot(stop, np.interp(stop, t, off), "o", color=COLOURS[name], ms=5)
    b.set(xlabel="time (s)", ylabel="end to where it rests (mm)", ylim=(1e-3, 3e3))
    b.legend(frameon=False, fontsize=8, ncols=4, loc="upper center")
    at = np.arange(len(table))
    for name in ("ZV", "shaped", "fast"):
        c.semilogy(at, [max(100 * r[name], 1e-5) for r in table], "o", color=COLOURS[name], ms=5, label=name)
    for name in ("shaped", "fast"):
        c.semilogy(at, [100 * r[f"{name} off"] for r in table], "x", color=COLOURS[name], ms=5,
                   label=f"{name}, payload +20 %")  # fmt: skip
    c.axhline(5, color="#333333", lw=0.8, ls="--")
    c.text(at[6], 4.4, "aim 5 %", ha="left", va="top", fontsize=8)
    c.set(ylabel="left, % of unshaped", ylim=(1e-5, 1e4))
    c.legend(frameon=False, fontsize=8, ncols=3, loc="upper center", columnspacing=0.8, handletextpad=0.2)
    for name in ("shaped", "fast"):
        d.plot(at, [r[f"{name} duration"] for r in table], "o", color=COLOURS[name], ms=5, label=name)
    d.set(ylabel="duration / (rigid + half period)", ylim=(0.65, 1.25))
    d.legend(frameon=False, fontsize=8, loc="upper left")
    edges = [k for k in range(1, len(table)) if table[k]["arm"] != table[k - 1]["arm"]]
    for ax in (c, d):
        for k in edges:
            ax.axvline(k - 0.5, color="#CCCCCC", lw=0.8)
        middles = [(i + j - 1) / 2 for i, j in zip([0, *edges], [*edges, len(table)], strict=True)]
        ax.set_xticks(middles, list(dict.fromkeys(r["arm"] for r in table)))
        ax.tick_params(axis="x", length=0)
    titles = ("a: two links, 0, 0 to 1, −1 rad, 1 kg", "b: the same: the arm's end", "c: vibration left, all moves",
              "d: durations, all moves")  # fmt: skip
    for ax, title in zip((a, b, c, d), titles, strict=True):
        ax.set_title(title, fontsize=10, loc="left")
        ax.grid(alpha=0.3, axis="y")
        ax.spines[["top", "right"]].set_visible(False)
    fig.savefig(path, dpi=110)


def two_masses() -> None:
    """Two masses of 1 kg, 1 N/m between them, 1 m with up to 1 N; the least time is 4.218 s (Wie and Liu 1992)."""
    height = (0.25 * 12 / (1e9 * 0.01)) ** (1 / 3)  # a massless beam of one shape: k = 4 E I / L^3
    massless = fa.Material(1e-9, 1e9, 0.3)
    spring = fa.Beam(1.0, fa.Rectangle(height, 0.01), massless, {"bending_y": 1}, basis="legendre", order=1)
    arm = fa.Arm([fa.Link(fa.Prismatic("y"), fa.RigidBody(1.0), spring, fa.RigidBody(1.0))])
    for method in ("fast", "shaped"):
        duration = fa.plan_move(arm, 0.0, 1.0, limits={"torque": 1.0}, method=method).duration
        print(f"two masses, {method}: {duration:.3f} s, {duration / 4.218:.3f} of the least", flush=True)


def servo() -> None:
    """The move of the front of docs/moves.md with gravity, followed by a PD servo with and without its torques."""
    beam = fa.Beam(0.5, fa.Rectangle(0.008, 0.03), STEEL, {"bending_y": 3}, basis="legendre", order=2)
    hub, elbow = fa.RigidBody(0.3, end=(0.05, 0, 0)), fa.RigidBody(0.5, end=(0.05, 0, 0))
    links = [fa.Link(fa.Revolute("z"), hub, beam), fa.Link(fa.Revolute("z"), elbow, beam, fa.RigidBody(1.0))]
    arm = fa.Arm(links, gravity=(0, -9.81, 0))
    move = fa.plan_move(arm, [0, 0], [1, -1], limits={"torque": (60, 15), "speed": 8})
    start, goal = move.simulate(after=0.0).q[[0, -1]]
    t = np.append(move.t, move.duration + np.linspace(0.002, 1, 500))
    rest, weight = arm.zero, []
    for joints in move.q:  # of the arm in balance there
        rest[[0, 4]] = joints
        weight.append(arm.inverse_dynamics(arm.equilibrium(rest, lock=[0, 1]), 0 * rest, 0 * rest)[[0, 4]])
    control = [fa.PD(500.0, 30.0, k, reference=move.drive[k]) for k in (0, 1)]
    for name, rows in (("gravity alone", np.array(weight)), ("the torques of the move", move.torques)):
        forward = {k: fa.Torque(np.append(move.t, t[-1]), np.append(rows[:, k], rows[-1, k])) for k in (0, 1)}
        run = fa.simulate(arm, t, q0=start, drive=forward, control=control, rtol=1e-8)
        off = np.linalg.norm(run.frame()[0] - arm.frame(goal)[0], axis=1)[len(move.t) :]
        print(f"PD with {name}: up to {1e3 * off.max():.3g} mm are left", flush=True)


def main() -> None:
    out = output_folder(__doc__)
    warnings.simplefilter("ignore", fa.errors.RangeWarning)
    two_masses()
    servo()
    table, shown = [], {}
    for row, moves in rows():
        table.append(row)
        if row["arm"] == "2 links" and row["payload"] == 1.0 and row["to"] == [1, -1]:
            shown = moves
        print(*cells(row), *(f"peak {row[f'{x} peak']:.4f}, {row[f'{x} seconds']:.1f} s" for x in moves), sep=" | ",
              flush=True)  # fmt: skip
    with (out / "moves.csv").open("w", newline="") as f:
        writer = csv.DictWriter(f, list(table[0]))
        writer.writeheader()
        writer.writerows(table)
    lines = ["| " + " | ".join(row) + " |" for row in (HEAD, *map(cells, table))]
    lines.insert(1, "|-" * len(HEAD) + "|")
    (out / "moves.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    figure(table, shown, out / "moves.png")


if __name__ == "__main__":
    main()
