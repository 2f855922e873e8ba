"""Model predictive control: how long a cycle takes, and what it does with an arm at its limits.

    cmake --preset release -DFLEXARM_BUILD_EXAMPLES=ON && cmake --build --preset release
    python bench/model/mpc.py --program build/release/cpp/examples/mpc [-o DIR]

Latency is that of the C++ example, which has the state from a Kalman filter, by the thread's own time. The swing is
that of two flexible links in the horizontal plane from rest to (0.8, 0.5) rad. Writes mpc.csv, mpc.png and the marked
part of docs/mpc.md; with -o into DIR, and not the page.
"""

from __future__ import annotations

import argparse
import csv
import re
import subprocess
import warnings
from pathlib import Path
from typing import Any

import flexarm as fa
import matplotlib
import numpy as np
from scipy.linalg import solve_continuous_are

matplotlib.use("Agg")
import matplotlib.pyplot as plt

ROOT = Path(__file__).resolve().parents[2]
BLUE, ORANGE, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "#888888"
GOAL, LIMIT, STRAIN = np.array([0.8, 0.5]), np.array([4.0, 2.0]), 0.08
EFFORT = 1e-3 / LIMIT**2
T = np.linspace(0, 1.2, 1201)


def two_links(modes: int = 2, payload: float = 0.0) -> fa.Arm:
    steel = fa.Material(7850, 209e9, 0.3)

    def link(k: int, tip: fa.RigidBody) -> fa.Link:
        hub = fa.RigidBody(0.3, (0.02, 0, 0), (0.03, 0.01)[k] * np.eye(3), (0.05, 0, 0))
        beam = fa.Beam(0.4, fa.Rectangle(0.004, 0.02), steel, {"bending_y": modes}, "legendre", 2, damping_ratio=0.01)
        return fa.Link(fa.Revolute("z"), hub, beam, tip)

    elbow = fa.RigidBody(0.3, (0.02, 0, 0), 1e-4 * np.eye(3), (0.03, 0, 0))
    return fa.Arm([link(0, elbow), link(1, fa.RigidBody(0.05 + payload, inertia=1e-5 * np.eye(3)))])


def clipped_lqr(arm: fa.Arm) -> fa.Sampled:
    """Of the same weights, its torques kept within the limits."""
    joints = [arm.joint_rate(0), arm.joint_rate(1)]
    Q = np.zeros((2 * arm.nv, 2 * arm.nv))
    for i in joints:
        Q[i, i], Q[arm.nv + i, arm.nv + i] = 1.0, 0.05**2
    model = arm.linearize(arm.zero, inputs=(0, 1))
    R = np.diag(EFFORT)
    K = np.linalg.solve(R, model.B.T @ solve_continuous_are(model.A, model.B, Q, R))
    aim = np.zeros(2 * arm.nv)
    aim[joints] = GOAL
    return fa.Sampled(lambda t, y: np.clip(-K @ (y - aim), -LIMIT, LIMIT), 1000.0, actuate=(0, 1))


def swings() -> dict[str, tuple[fa.Arm, fa.Result, Any]]:
    """By name: the arm, its run and its controller."""
    soft = [(0, 0.0, "K3", STRAIN)]
    given: dict[str, Any] = {"reference": GOAL, "limit": LIMIT, "effort": EFFORT}
    arm, heavy = two_links(), two_links(payload=0.05)
    cases: dict[str, tuple[fa.Arm, Any]] = {
        "clipped LQR": (arm, clipped_lqr(arm)),
        "MPC": (arm, fa.MPC(**given)),
        "MPC, strain limited": (arm, fa.MPC(**given, strain_limit=soft)),
        "MPC, a period late": (arm, fa.MPC(**given, delay=True)),
        "MPC, model of 1 mode a link": (arm, fa.MPC(two_links(1), **given)),
        "MPC, tip twice as heavy as known": (heavy, fa.MPC(two_links(), **given)),
    }
    return {
        name: (a, fa.simulate(a, T, control=c, integrator="implicit", step=5e-4), c) for name, (a, c) in cases.items()
    }


def latencies(program: Path) -> list[list[Any]]:
    """Links, coordinates, horizon, stages, inputs; us: feedback, p99.9, cycle, median and p99.9; allocations."""
    rows = []
    for links in (1, 2, 3, 4):
        for horizon, stages, blocks in ((0.25, 15, 8), (0.5, 25, 12), (1.0, 40, 16)):
            given = [f"--links={links}", f"--horizon={horizon}", f"--stages={stages}", f"--blocks={blocks}"]
            flat = [x for option in given for x in option.split("=")]
            command = [program, *flat, "--cycles", "3000"]
            out = subprocess.run(command, capture_output=True, text=True, check=True).stdout
            size = re.search(r"(\d+) coordinates", out)
            asked = re.search(r"allocated +(\d+)", out)
            times = re.findall(r"median +([\d.]+) us, p99.9 +([\d.]+) us", out)
            assert size and len(times) == 2
            rows.append([links, int(size[1]), horizon, stages, links * blocks, float(times[0][1]), float(times[1][0]),
                         float(times[1][1]), int(asked[1]) if asked else "–"])  # fmt: skip
    return rows


def table(head: list[str], rows: list[list[Any]]) -> str:
    text = [[f"{x:.3g}" if isinstance(x, float) and x < 100 else f"{x:.0f}" if isinstance(x, float) else str(x)
             for x in row] for row in rows]  # fmt: skip
    return "\n".join("| " + " | ".join(row) + " |" for row in [head, ["-"] * len(head), *text])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", type=Path)
    parser.add_argument("--program", type=Path, required=True)
    options = parser.parse_args()
    warnings.simplefilter("ignore", fa.errors.LoopWarning)
    runs, cycles = swings(), latencies(options.program)
    rows: list[list[Any]] = []
    figure, panels = plt.subplots(2, 2, figsize=(11, 7.4), layout="constrained")
    axes = panels.ravel()
    look = {"clipped LQR": GREY, "MPC": BLUE, "MPC, strain limited": ORANGE}
    for name, (arm, run, control) in runs.items():
        joints = [arm.joint_rate(0), arm.joint_rate(1)]
        off = np.abs(run.q[:, joints] - GOAL).max(axis=1)
        bend = arm.strain(run.q, 0, 0.0)[:, 2]
        late = np.flatnonzero(off > 5e-3)
        settled = float(run.t[late[-1] + 1]) if late[-1] + 1 < run.t.size else "not within 1.2 s"
        cost = float(np.sum(off**2)) * 1e-3
        rows.append([name, settled, cost, float(np.abs(bend).max()), getattr(control, "failures", "–")])
        if name in look:
            axes[0].plot(run.t, run.q[:, joints[0]], color=look[name], label=name)
            axes[0].plot(run.t, run.q[:, joints[1]], color=look[name], ls="--")
            axes[1].plot(run.t, run.tau[:, joints[0]], color=look[name], lw=1)
            axes[2].plot(run.t, bend, color=look[name], lw=1.2)
    axes[0].set(title="joints (dashed: the second)", ylabel="angle (rad)", ylim=(-0.4, 1.2))
    axes[0].legend(fontsize=9, loc="lower right")
    axes[1].set(title="torque of the first joint", ylabel="torque (N m)")
    axes[2].set(title="bending at the first link's root", ylabel="curvature (1/m)")
    for ax, most in ((axes[1], LIMIT[0]), (axes[2], STRAIN)):
        for sign in (-1, 1):
            ax.axhline(sign * most, color="black", lw=0.8, ls=":")
    for ax in axes[:3]:
        ax.set(xlabel="time (s)", xlim=(0, T[-1]))
    for horizon, colour in ((0.25, GREEN), (0.5, BLUE), (1.0, ORANGE)):
        of = [c for c in cycles if c[2] == horizon]
        label = f"{horizon:g} s ahead, {of[0][3]} stages"
        axes[3].plot([c[0] for c in of], [c[6] for c in of], "o-", color=colour, label=label)
        axes[3].plot([c[0] for c in of], [c[7] for c in of], "^:", color=colour)
    axes[3].axhline(1000, color="black", lw=0.8, ls=":")
    axes[3].set(title="a cycle (dotted: p99.9)", xlabel="flexible links", ylabel="time (µs)", yscale="log")
    axes[3].set_xticks([1, 2, 3, 4])
    axes[3].set_yticks([100, 200, 500, 1000, 2000], ["100", "200", "500", "1000", "2000"])
    axes[3].minorticks_off()
    axes[3].legend(fontsize=9)
    for ax in axes:
        ax.grid(alpha=0.3)
    head = ["controller", "within 5 mrad after (s)", "∫ error² (rad² s)", "largest curvature (1/m)",
            "samples not solved"]  # fmt: skip
    heads = ["links", "coordinates", "horizon (s)", "stages", "inputs", "feedback, p99.9 (µs)", "cycle, median (µs)",
             "p99.9", "allocations"]  # fmt: skip
    words = f"{table(head, rows)}\n\n{table(heads, cycles)}\n"
    print(words)
    out = options.o or ROOT / "docs" / "figures"
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "mpc.png", dpi=110)
    with (out / "mpc.csv").open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([head, *rows, heads, *cycles])
    if options.o is None:
        page = ROOT / "docs" / "mpc.md"
        begin, end = "<!-- measured: begin -->", "<!-- measured: end -->"
        first, rest = page.read_text(encoding="utf-8").split(begin)
        page.write_text(f"{first}{begin}\n{words}{end}{rest.split(end)[1]}", encoding="utf-8")


if __name__ == "__main__":
    main()
