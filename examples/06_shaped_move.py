"""A fast move of two flexible links that ends at rest.

Shows: `fa.plan_move` with limits of torque and speed, its replay by another integrator, another payload.
You see: the planned move beside a plain one of the same duration (quintic polynomials of the joints). The plain
one leaves the arm ringing by centimetres, and needs more torque than the motors have.
Takes: 5 s. Needs: nothing besides flexarm.

    python 06_shaped_move.py [--output DIR]
"""

import argparse
from dataclasses import replace
from pathlib import Path

import flexarm as fa
import matplotlib.pyplot as plt
import numpy as np

parser = argparse.ArgumentParser(description="A fast move of two flexible links that ends at rest.")
parser.add_argument("--output", type=Path, default=Path(), metavar="DIR", help="folder to write into (here)")
folder = parser.parse_args().output
folder.mkdir(parents=True, exist_ok=True)

steel = fa.Material(density=7850, youngs_modulus=209e9, poisson_ratio=0.3)
beam = fa.Beam(0.5, fa.Rectangle(y=0.008, z=0.03), steel, modes={"bending_y": 3}, basis="legendre")
hub = fa.RigidBody(mass=0.5, end=(0.05, 0, 0))
arm = fa.Arm([fa.Link(fa.Revolute("z"), hub, beam), fa.Link(fa.Revolute("z"), hub, beam, fa.RigidBody(mass=1.0))])
limits = (60, 15)  # N m
goal = np.array([0.8, -0.6])  # rad

move = fa.plan_move(arm, [0, 0], goal, limits={"torque": limits, "speed": 8})
print(move)

t = np.linspace(0, move.duration + 0.5, 1001)
plain = {k: fa.Motion([0, move.duration, t[-1]], [0, goal[k], goal[k]], [0, 0, 0], [0, 0, 0]) for k in (0, 1)}
heavier = fa.Arm([arm.links[0], replace(arm.links[1], tip=fa.RigidBody(mass=1.1))])
cases = {
    "planned": fa.simulate(arm, t, drive=move.drive, rtol=1e-8),  # IDA: it shares no code with the plan's integrator
    "planned, payload +10 %": fa.simulate(heavier, t, drive=move.drive, rtol=1e-8),
    "plain": fa.simulate(arm, t, drive=plain, rtol=1e-8),
}
rest = arm.frame(arm.pose({0: goal[0], 1: goal[1]}))[0]  # where the arm's end should be (m)
joints = [arm.coordinates.index(name) for name in arm.coordinates if "revolute" in name]

print(f"\n{'':24} {'torques up to (N m)':>20} {'left after the move (mm)':>25}")
left_over = {}
for name, run in cases.items():
    peak = abs(run.tau[:, joints]).max(0)
    swing = 1e3 * np.linalg.norm(run.frame()[0] - rest, axis=1)
    left_over[name] = swing[t > move.duration].max()
    print(f"{name:24} {peak[0]:10.1f}, {peak[1]:8.1f} {left_over[name]:25.4f}")

figure, (top, bottom) = plt.subplots(2, 1, figsize=(8, 5.5), sharex=True, layout="constrained")
for name, run in cases.items():
    top.plot(t, run.tau[:, joints[0]], label=name)
    bottom.semilogy(t, 1e3 * np.linalg.norm(run.frame()[0] - rest, axis=1) + 1e-6, label=name)
top.axhline(limits[0], color="0.6", linestyle="--")
top.axhline(-limits[0], color="0.6", linestyle="--")
top.set(ylabel="torque of joint 0 (N m)")
top.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
bottom.axvline(move.duration, color="0.6")
bottom.set(xlabel="time (s)", ylabel="tip to its goal (mm)")
figure.savefig(folder / "shaped_move.png", dpi=120)
print(f"The figure is {folder / 'shaped_move.png'}.")
