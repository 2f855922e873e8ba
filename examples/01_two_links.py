"""Two flexible links, the first one clamped, the second one swings: a first run, its energy, a figure.

Shows: how an arm is made of links, joints, beams and tips; how it is simulated; what a run holds.
You see: the arm every 60 ms. The second link falls from the horizontal and swings through; its pull bends both links.
What gravity gives becomes motion and bending, and the sum stays what it was.
Takes: 2 s. Needs: nothing besides flexarm.

    python 01_two_links.py [--output DIR]
"""

import argparse
from pathlib import Path

import flexarm as fa
import matplotlib.pyplot as plt
import numpy as np

parser = argparse.ArgumentParser(description="Two flexible links, the second one swings.")
parser.add_argument("--output", type=Path, default=Path(), metavar="DIR", help="folder to write into (here)")
folder = parser.parse_args().output
folder.mkdir(parents=True, exist_ok=True)

# The arm: the hinge turns about z, beams lie along x and bend towards y, gravity pulls along -y. SI units, radians.
aluminium = fa.Material(density=2700, youngs_modulus=70e9, poisson_ratio=0.33)
thin = fa.Rectangle(y=0.003, z=0.03)
beam = fa.Beam(length=0.5, section=thin, material=aluminium, modes={"bending_y": 3}, basis="legendre")
arm = fa.Arm(
    [
        fa.Link(fa.Fixed(), beam=beam, tip=fa.RigidBody(mass=0.1), name="upper"),
        fa.Link(fa.Revolute("z"), beam=beam, tip=fa.RigidBody(mass=0.1), name="fore"),
    ],
    gravity=(0, -9.81, 0),
)
print(arm)

# The run: it starts at rest, stretched out horizontally, and nothing holds it.
t = np.linspace(0, 0.72, 721)
run = fa.simulate(arm, t, rtol=1e-8)
kinetic, potential = run.energy()
change = kinetic + potential - potential[0]

place = run.frame()[0]  # of the arm's end, (nt, 3)
elbow = run.q[:, arm.coordinates.index("fore revolute")]
bent = [1e3 * run.tip_deflection(link)[:, 1] for link in ("upper", "fore")]  # of each link's end, across it (mm)

print(f"\n{'t (s)':>6} {'elbow (deg)':>12} {'bent by (mm)':>15} {'tip at x, y (m)':>17} {'kinetic (J)':>12}")
for k in range(0, len(t), 120):
    across, at = f"{bent[0][k]:7.2f} {bent[1][k]:7.2f}", f"{place[k, 0]:8.4f} {place[k, 1]:8.4f}"
    print(f"{t[k]:6.2f} {np.degrees(elbow[k]):12.2f} {across} {at} {kinetic[k]:12.4f}")
print(f"\nThe energy changes by at most {abs(change).max():.1e} J of {kinetic.max():.2f} J.")

figure, (left, right) = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
for k in range(0, len(t), 60):
    line = [arm.frame(run.q[k], link, x)[0] for link in (0, 1) for x in np.linspace(0, beam.length, 20)]
    left.plot(*np.array(line)[:, :2].T, color=plt.colormaps["viridis_r"](0.1 + 0.9 * k / len(t)))
left.plot(place[:, 0], place[:, 1], "k:", linewidth=1)
left.set(xlabel="x (m)", ylabel="y (m)", aspect="equal", title="every 60 ms, light to dark; dotted: the tip")
right.plot(t, kinetic, label="kinetic")
right.plot(t, potential - potential[0], label="gravity and bending")
right.plot(t, change, "k--", label="sum")
right.set(xlabel="time (s)", ylabel="energy (J)")
right.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
figure.savefig(folder / "two_links.png", dpi=120)
print(f"The figure is {folder / 'two_links.png'}.")
