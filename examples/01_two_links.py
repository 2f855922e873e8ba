"""Two flexible links fall: a first run, its energy, a figure.

Shows: how an arm is made of links, joints, beams and tips; how it is simulated; what a run holds.
You see: the arm every 50 ms while it falls under gravity, and its energy: what gravity gives becomes motion and bending,
and the sum stays what it was.
Takes: 1 s. Needs: nothing besides flexarm.

    python 01_two_links.py [--output DIR]
"""

import argparse
from pathlib import Path

import flexarm as fa
import matplotlib.pyplot as plt
import numpy as np

parser = argparse.ArgumentParser(description="Two flexible links fall.")
parser.add_argument("--output", type=Path, default=Path(), metavar="DIR", help="folder to write into (here)")
folder = parser.parse_args().output
folder.mkdir(parents=True, exist_ok=True)

# The arm: hinges turn about z, beams lie along x and bend towards y, gravity pulls along -y. SI units, radians.
aluminium = fa.Material(density=2700, youngs_modulus=70e9, poisson_ratio=0.33)
thin = fa.Rectangle(y=0.002, z=0.03)
beam = fa.Beam(length=0.5, section=thin, material=aluminium, modes={"bending_y": 3}, basis="legendre")
arm = fa.Arm(
    [
        fa.Link(fa.Revolute("z", name="shoulder"), beam=beam, tip=fa.RigidBody(mass=0.05)),
        fa.Link(fa.Revolute("z", name="elbow"), beam=beam, tip=fa.RigidBody(mass=0.05)),
    ],
    gravity=(0, -9.81, 0),
)
print(arm)

# The run: it starts at rest, stretched out horizontally, and nothing holds it.
t = np.linspace(0, 0.6, 601)
run = fa.simulate(arm, t, rtol=1e-8)
kinetic, potential = run.energy()
change = kinetic + potential - potential[0]

print(f"\n{'t (s)':>6} {'shoulder (deg)':>15} {'elbow (deg)':>12} {'tip x (m)':>10} {'tip y (m)':>10} {'kinetic (J)':>12}")
place = run.frame()[0]  # of the arm's end, (nt, 3)
shoulder, elbow = run.q[:, 0], run.q[:, 1 + 3]  # of each link: its joint, then its beam's functions
for k in range(0, len(t), 100):
    angles = f"{np.degrees(shoulder[k]):15.2f} {np.degrees(elbow[k]):12.2f}"
    print(f"{t[k]:6.2f} {angles} {place[k, 0]:10.4f} {place[k, 1]:10.4f} {kinetic[k]:12.4f}")
print(f"\nThe energy changes by at most {abs(change).max():.1e} J of {kinetic.max():.2f} J.")

figure, (left, right) = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
for k in range(0, len(t), 50):
    line = [arm.frame(run.q[k], link, x)[0] for link in (0, 1) for x in np.linspace(0, beam.length, 20)]
    left.plot(*np.array(line)[:, :2].T, color=plt.colormaps["viridis_r"](0.1 + 0.9 * k / len(t)))
left.plot(place[:, 0], place[:, 1], "k:", linewidth=1, label="path of the tip")
left.set(xlabel="x (m)", ylabel="y (m)", aspect="equal", title="every 50 ms, light to dark")
left.legend(frameon=False)
right.plot(t, kinetic, label="kinetic")
right.plot(t, potential - potential[0], label="gravity and bending")
right.plot(t, change, "k--", label="sum")
right.set(xlabel="time (s)", ylabel="energy (J)")
right.legend(frameon=False)
figure.savefig(folder / "two_links.png", dpi=120)
print(f"The figure is {folder / 'two_links.png'}.")
