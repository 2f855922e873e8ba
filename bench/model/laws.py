"""What a rate, gravity, inertia and the payload are worth to the joints of an arm that follows a motion.

    python bench/model/laws.py [-o DIR]

Three links in space, aluminium tubes of 0.5 m that bend and twist, with 1 kg at the end, go from rest to rest in 0.8 s
under gravity, by a quintic motion of all joints. The joints are held by PD, from rest to rest in q alone, then with the
motion's rate, then with feed-forward of gravity, of everything, and of everything without the payload; or by computed
torque at 4 kHz, which knows the payload, or does not. All have the same stiffness: the rigid arm's poles at a quarter
of the lowest frequency with the joints held. Writes laws.csv and laws.png into DIR (default: here).
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import flexarm as fa
import numpy as np
from flexarm.data.draw.style import DPI, INK, PALETTE, label_axes, legend, new_figure

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from reporting import output_folder

T = np.linspace(0, 1.6, 1601)
END, MOVES = 0.8, (1.0, 0.8, -0.6)  # s; rad
BOUND = [0.0, -0.4, 0.8]  # rad, where they start


def arm_with(payload: float) -> fa.Arm:
    tube, metal = fa.Tube(0.025, 0.021), fa.Material(2700, 70e9, 0.33)
    beam = fa.Beam(0.5, tube, metal, {"bending_y": 2, "bending_z": 2, "torsion": 1}, "legendre", damping_ratio=0.01)
    motor = fa.RigidBody(1.0, inertia=(2e-3, 2e-3, 2e-3))
    tips = (None, None, fa.RigidBody(payload, inertia=(1e-3, 1e-3, 1e-3)) if payload else None)
    joints = [fa.Revolute(axis, reflected_inertia=0.1) for axis in "zyy"]
    links = [fa.Link(joint, motor, beam, tip) for joint, tip in zip(joints, tips, strict=True)]
    return fa.Arm(links, gravity=(0, 0, -9.81))


def laws(arm: fa.Arm, light: fa.Arm, motions: list[fa.Motion]) -> dict[str, list[fa.Controller]]:
    joints = [arm.joint_rate(k) for k in range(3)]
    w = 0.25 * arm.modes(arm.equilibrium(start(arm, 0.0), lock=[0, 1, 2]), lock=[0, 1, 2]).frequencies[0]
    inertia = np.diag(arm.mass_matrix(start(arm, 0.0)))[joints]

    def pd(rated: bool) -> list[fa.Controller]:
        places = [m if rated else (T, [m(float(t))[0] for t in T]) for m in motions]
        return [fa.PD(inertia[k] * w * w, 2 * inertia[k] * w, k, reference=places[k]) for k in range(3)]

    computed = {"kp": w * w, "reference": motions, "rate": 4000.0}
    return {
        "PD": pd(False),
        "PD with the rate": pd(True),
        "and gravity": [*pd(True), fa.FeedForward(motions, inertia=False)],
        "and inertia: feed-forward": [*pd(True), fa.FeedForward(motions)],
        "feed-forward, payload unknown": [*pd(True), fa.FeedForward(motions, model=light)],
        "computed torque": [fa.ComputedTorque(**computed)],
        "computed torque, payload unknown": [fa.ComputedTorque(**computed, model=light)],
    }


def start(arm: fa.Arm, share: float) -> np.ndarray:
    """The joints' places after a share of the move."""
    q = arm.zero
    for k in range(3):
        q[arm.joint_rate(k)] = BOUND[k] + share * MOVES[k]
    return q


def main() -> None:
    out = output_folder(__doc__)
    arm, light = arm_with(1.0), arm_with(0.0)
    joints = [arm.joint_rate(k) for k in range(3)]
    zero = [0.0, 0.0, 0.0]
    motions = [fa.Motion([0, END, T[-1]], [b, b + m, b + m], zero, zero) for b, m in zip(BOUND, MOVES, strict=True)]
    places = np.array([[m(float(t))[0] for m in motions] for t in T])
    q0, q1 = (arm.equilibrium(start(arm, x), lock=[0, 1, 2]) for x in (0.0, 1.0))
    goal, after = arm.frame(q1, 2)[0], END + 1e-9 < T
    print(f"lowest frequency with the joints held: {arm.modes(q0, lock=[0, 1, 2]).frequencies[0] / 2 / np.pi:.3g} Hz")
    fig, rows = new_figure(9.0, 5.6), []
    top, bottom = fig.subplots(2, 1, sharex=True)
    for (name, law), colour in zip(laws(arm, light, motions).items(), (INK, *PALETTE), strict=True):
        run = fa.simulate(arm, T, q0, control=law, integrator="implicit", step=2.5e-4)
        off = 1e3 * np.abs(run.q[:, joints] - places).max(axis=1)
        tip = 1e3 * np.linalg.norm(run.frame(2)[0] - goal, axis=1)
        dash = "--" if "unknown" in name else "-"
        top.semilogy(T[1:], off[1:], dash, color=colour, lw=1.4, label=name)
        bottom.semilogy(T[after], tip[after], dash, color=colour, lw=1.4)
        rows.append([name, *(f"{x:.3g}" for x in (off.max(), off[-1], tip[after].max(), tip[T > T[-1] - 0.2].max())),
                     f"{np.abs(run.tau[:, joints]).max():.3g}"])  # fmt: skip
        print("  ".join(rows[-1]))
    label_axes(top, "largest joint error (mrad)")
    label_axes(bottom, "tip from its goal (mm)", "time (s)")
    top.set_ylim(1e-2, 400)
    bottom.set_ylim(1e-3, 200)
    for ax in (top, bottom):
        ax.axvline(END, color="#999999", lw=0.8)
    bottom.text(END - 0.01, 2e-3, "end of the move", ha="right", fontsize=9, color="#666666")
    legend(top, len(rows))
    fig.savefig(out / "laws.png", dpi=DPI)
    with (out / "laws.csv").open("w", newline="") as f:
        writer = csv.writer(f)
        writer.writerow(["law", "joint error, largest (mrad)", "joint error at 1.6 s (mrad)",
                         "tip, largest after the move (mm)", "tip, last 0.2 s (mm)", "peak torque (N m)"])  # fmt: skip
        writer.writerows(rows)


if __name__ == "__main__":
    main()
