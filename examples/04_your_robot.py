"""Your robot's URDF, one of its links flexible.

Shows: `fa.from_urdf(..., flexible=)`, names of links and joints, poses by name, equilibrium under gravity, a picture.
You see: by how much the tube of this robot's forearm sags in several poses, and its frequencies there; the robot in 3-D
with its sag drawn 20 times as large. Put your own file in place of 04_your_robot.urdf.
Takes: 2 s. Needs: nothing besides flexarm.

    python 04_your_robot.py [--output DIR]
"""

import argparse
import warnings
from pathlib import Path

import flexarm as fa
import numpy as np

parser = argparse.ArgumentParser(description="A robot's URDF with one flexible link.")
parser.add_argument("--output", type=Path, default=Path(), metavar="DIR", help="folder to write into (here)")
folder = parser.parse_args().output
folder.mkdir(parents=True, exist_ok=True)

# The tube takes the place of the forearm's own mass. It bends both ways and twists.
carbon = fa.Material(density=1600, youngs_modulus=70e9, poisson_ratio=0.3)
tube = fa.Beam(
    length=0.7,  # from the elbow to the gripper: where the URDF says otherwise, the error tells
    section=fa.Tube(radius=0.012, thickness=0.0015),
    material=carbon,
    modes={"bending_y": 2, "bending_z": 2, "torsion": 1},
    basis="legendre",
)
with warnings.catch_warnings():
    warnings.simplefilter("ignore", fa.errors.RobotWarning)  # it tells that the tube stands for the forearm's 0.35 kg
    arm = fa.from_urdf(Path(__file__).with_suffix(".urdf"), tip="gripper", flexible={"forearm": tube})
print(arm)

joints = ["turn", "shoulder", "elbow"]
print(f"\n{'shoulder, elbow (rad)':>21} {'sag (mm)':>9} {'frequencies, joints held (Hz)':>32}")
sags = []
for shoulder, elbow in ((0.0, 0.0), (-0.8, 0.8), (-0.8, 1.6), (-1.5, 0.0)):
    pose = arm.pose({"shoulder": shoulder, "elbow": elbow})
    q = arm.equilibrium(pose, lock=joints)
    sags.append(1e3 * (arm.frame(pose, "gripper")[0][2] - arm.frame(q, "gripper")[0][2]))
    f = arm.modes(q, lock=joints).frequencies[:4] / (2 * np.pi)
    print(f"{shoulder:10.2f}, {elbow:9.2f} {sags[-1]:9.3f}     {np.array2string(f, precision=2)}")

q = arm.equilibrium(arm.pose({"shoulder": -0.8, "elbow": 0.8}), lock=joints)
arm.show(q, magnify=20, open=False).save(folder / "your_robot.png", size=(7, 5))
print(f"The picture is {folder / 'your_robot.png'}. In the browser: arm.show(q), with pip install 'flexarm[view]'.")
