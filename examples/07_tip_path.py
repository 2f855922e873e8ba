"""The tip of a flexible arm along a circle.

Shows: `fa.invert`, which gives the joints' motions and torques for a path of the tip, and its replay.
You see: the path of the tip with the motions of `invert`, and with those of an arm whose links do not bend. The second
misses the circle by centimetres, and rings on.
Takes: 3 s. Needs: nothing besides flexarm.

    python 07_tip_path.py [--output DIR]
"""

import argparse
from pathlib import Path

import flexarm as fa
import matplotlib.pyplot as plt
import numpy as np

parser = argparse.ArgumentParser(description="The tip of a flexible arm along a circle.")
parser.add_argument("--output", type=Path, default=Path(), metavar="DIR", help="folder to write into (here)")
folder = parser.parse_args().output
folder.mkdir(parents=True, exist_ok=True)

aluminium = fa.Material(density=2700, youngs_modulus=70e9, poisson_ratio=0.33)
beam = fa.Beam(0.5, fa.Rectangle(y=0.006, z=0.03), aluminium, {"bending_y": 2}, "legendre", damping_ratio=0.005)
hub = fa.RigidBody(mass=0.3, inertia=(1e-3, 1e-3, 1e-3))
arm = fa.Arm([fa.Link(fa.Revolute("z"), hub, beam), fa.Link(fa.Revolute("z"), hub, beam, fa.RigidBody(mass=0.2))])

# Once round a circle of 0.12 m, in 1.2 s from rest to rest. The angle is a polynomial with four continuous derivatives.
radius, duration = 0.12, 1.2
s = np.linspace(0, 1, 241)
angle = 2 * np.pi * s**5 * (126 - 420 * s + 540 * s**2 - 315 * s**3 + 70 * s**4)
circle = np.array([0.6, 0.2])[:, None] + radius * np.array([np.cos(angle), np.sin(angle)])
path = {name: fa.Motion(duration * s, circle[k], ends="rest") for k, name in enumerate("xy")}
posture = arm.pose({0: -0.6, 1: 1.6})  # the elbow's side; the pose with the tip where the path begins is found

runs = {}
print(f"{'joints of':12} {'begin (s)':>9} {'end (s)':>8} {'torques up to (N m)':>20} {'tip off (mm)':>13}")
for method in ("stable", "rigid"):
    inverse = fa.invert(arm, path, posture=posture, method=method, tolerance=1e-6)
    t = np.linspace(inverse.t[0], inverse.t[-1], 801)
    run = fa.simulate(arm, t, inverse.q[0], drive=inverse.motions, rtol=1e-9, atol=1e-11)  # servos keep to the motions
    off = 1e3 * np.linalg.norm(inverse.tip_error(run), axis=1)
    runs[method] = inverse, run, off
    peak = abs(run.tau[:, [arm.coordinates.index(name) for name in arm.coordinates if "revolute" in name]]).max(0)
    ends = f"{-inverse.pre:9.2f} {duration + inverse.post:8.2f}"
    print(f"{method:12} {ends} {peak[0]:11.2f}, {peak[1]:6.2f} {off.max():13.5f}")

figure, (left, right) = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
left.plot(*circle, "k:", linewidth=3, label="path")
for method, (_, run, off) in runs.items():
    left.plot(*run.frame()[0][:, :2].T, label=method)
    right.semilogy(run.t, off + 1e-6, label=method)
left.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
left.legend(frameon=False)
right.set(xlabel="time (s)", ylabel="tip off its path (mm)")
right.axvspan(0, duration, color="0.92")
right.annotate("path", (0.02, 1.02), xycoords=("data", "axes fraction"))
figure.savefig(folder / "tip_path.png", dpi=120)
print(f"The figure is {folder / 'tip_path.png'}.")
