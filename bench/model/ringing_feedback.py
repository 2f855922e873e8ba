"""My arm rings after a knock: what feedback of the bending does about it, on the paper's arm with its friction.

    python bench/model/ringing_feedback.py [-o DIR]

A knock on the tip, half a sine of 20 ms and 3 N, while the controller holds the joint: PD alone; strain feedback
(Eq. 97), continuous, and sampled at 500 Hz from an encoder and a noisy gauge; state feedback, LQR by python-control on
the linear model; and PD alone on a joint without dry friction. Writes ringing-feedback.csv and ringing-feedback.png
into DIR (default: here).
"""

from __future__ import annotations

import csv
import sys
from dataclasses import replace
from pathlib import Path

import control
import flexarm as fa
import numpy as np
from flexarm.cli.paper.control import DRIVE_GAIN, KP, KV
from flexarm.data.draw.style import BLUE, GREEN, INK, ORANGE, RED
from matplotlib.figure import Figure

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from reporting import finish, output_folder

KS = -0.05
T = np.linspace(0, 4, 4001)
MOTOR = fa.Motor(DRIVE_GAIN)


def knock() -> fa.Load:
    s = np.linspace(0, 0.02, 21)
    force = np.append(3 * np.sin(np.pi * s / 0.02), 0)
    return fa.Load(force=np.outer(force, [0, 1, 0]), t=np.append(s, 4))


def lqr(arm: fa.Arm) -> fa.StateFeedback:
    """A torque of 1 N m weighs as much as 10 mrad of the joint, or 3 mm of the tip."""
    model = arm.linearize(arm.zero, inputs=[0], outputs=[("joint", 0), ("tip", 0)])
    weighted = model.C * np.array([[100], [0], [316], [0]])  # the joint (1/rad); the tip's x, y, z (1/m)
    return fa.StateFeedback(control.lqr(model.to_control(), weighted.T @ weighted, [[1.0]])[0])


def sampled() -> fa.Sampled:
    """Eq. 97 from what an encoder on the motor and a gauge bridge tell, every 2 ms."""
    angle = fa.sensors.Encoder(0, pulses=2000, quadrature=True, gear_ratio=50)
    gauge = fa.sensors.StrainGauge(0, noise=5e-6, seed=1)
    half = 0.5e-3  # of the beam's thickness (m): K3 = -strain / half
    return fa.Sampled(lambda t, y: -KP * y[0] + KS * y[1] / half, 500, [angle, gauge], motor=MOTOR)


def laws(arm: fa.Arm) -> dict[str, fa.Controller]:
    return {
        "PD": fa.PD(KP, KV, motor=MOTOR),
        "strain feedback": fa.StrainFeedback(KP, KV, KS, motor=MOTOR),
        "the same at 500 Hz, encoder and gauge": sampled(),
        "LQR": lqr(arm),
    }


def struck(arm: fa.Arm, law: fa.Controller) -> fa.Result:
    return fa.simulate(arm, T, control=law, loads=[knock()], integrator="gauss", step=0.01)


def frictionless(arm: fa.Arm) -> fa.Arm:
    link = arm.links[0]
    return fa.Arm([replace(link, joint=replace(link.joint, coulomb=0.0))])


def main() -> None:
    out = output_folder(__doc__)
    arm = fa.load("ist_control").arm
    rows = []
    fig = Figure(figsize=(10.0, 5.6), layout="constrained")
    top, bottom = fig.subplots(2, 1, sharex=True)
    looks = ((INK, "-", 1.0), (BLUE, "-", 2.0), (ORANGE, "--", 1.2), (RED, "-", 1.2), (GREEN, ":", 1.2))
    runs = {name: struck(arm, law) for name, law in laws(arm).items()}
    runs["PD, were there no dry friction"] = struck(frictionless(arm), laws(arm)["PD"])
    for (name, r), (colour, dash, width) in zip(runs.items(), looks, strict=True):
        tip, joint = 1e3 * r.tip_deflection()[:, 1], np.degrees(r.q[:, 0])
        top.plot(T, tip, dash, color=colour, lw=width, label=name)
        bottom.plot(T, joint, dash, color=colour, lw=width, label=name)
        left = [np.abs(tip[T >= s]).max() for s in (1, 3)]
        rows.append([name, *(f"{x:.3g}" for x in (np.abs(tip).max(), *left, np.abs(joint).max(), joint[-1])),
                     f"{np.abs(r.tau[:, 0]).max():.2f}"])  # fmt: skip
        print("  ".join(rows[-1]))
    top.set_ylabel("tip deflection (mm)")
    bottom.set(xlabel="time (s)", ylabel="joint (degrees)", xlim=(0, 3))
    top.set_ylim(-125, 190)
    top.legend(frameon=False, fontsize=9, ncols=3, loc="upper right")
    finish(fig, out / "ringing-feedback.png")
    with (out / "ringing-feedback.csv").open("w", newline="") as f:
        writer = csv.writer(f)
        writer.writerow(["controller", "peak (mm)", "after 1 s (mm)", "after 3 s (mm)", "joint, peak (degrees)",
                         "joint at 4 s (degrees)", "peak torque (N m)"])  # fmt: skip
        writer.writerows(rows)


if __name__ == "__main__":
    main()
