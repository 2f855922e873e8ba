"""Beams as rigid segments in MuJoCo: how near frequencies, sag and a motion come to the arm's, by how many there are.

    pip install 'flexarm[mjcf]'
    python bench/robots/segments.py    # the table of docs/robots.md
"""

from __future__ import annotations

import time
import warnings

import flexarm as fa
import mujoco
import numpy as np
from flexarm.robots.segments import segmented

END = 0.5
TORQUES = (1.5, 0.3)


def arm() -> fa.Arm:
    """Two links in a vertical plane, of 0.55 m and 0.4 m, strips of aluminium 4 mm thick."""
    alloy, section = fa.Material(density=2700.0, youngs_modulus=70e9), fa.Rectangle(0.004, 0.03)
    beams = [fa.Beam(x, section, alloy, modes={"bending_y": 5}, basis="legendre") for x in (0.5, 0.4)]
    hub = fa.RigidBody(0.1, inertia=(1e-4, 1e-4, 1e-4), end=(0.05, 0, 0))
    upper = fa.Link(fa.Revolute(damping=0.05, name="shoulder"), hub, beams[0], fa.RigidBody(0.2), name="upper")
    lower = fa.Link(fa.Revolute(damping=0.05, name="elbow"), None, beams[1], fa.RigidBody(0.1), name="lower")
    return fa.Arm([upper, lower], (0, -9.81, 0))


def sag(given: fa.Arm, locked: list[int]) -> np.ndarray:
    """The tip (3,) under gravity, joints locked."""
    return given.frame(given.equilibrium(lock=locked))[0]


def main() -> None:
    """The table."""
    given = arm()
    print("| segments | not fitted (%) | fitted (%) | sag (%) | tip (mm) | over bending (%) | step (s) | time (s) |")
    print("|-|-|-|-|-|-|-|-|")
    straight = given.frame(given.zero)[0]
    for n in (4, 6, 10, 20):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", fa.errors.RobotWarning)
            cut, text = segmented(given, n), given.to_mjcf(segments=n)
        locked = [k for k, link in enumerate(cut.arm.links) if link.joint.nv and k not in cut.hinges]
        full = sag(given, [0, 1])
        off = np.linalg.norm(sag(fa.Arm(cut.arm.links, given.gravity), locked) - full) / np.linalg.norm(full - straight)
        model = mujoco.MjModel.from_xml_string(text)
        data = mujoco.MjData(model)
        steps, track = round(END / model.opt.timestep), []
        began = time.perf_counter()
        for _ in range(steps):
            data.ctrl[:] = TORQUES
            mujoco.mj_step(model, data)
            track.append(data.site("tip").xpos.copy())
        took = time.perf_counter() - began
        every = max(1, steps // 500)
        t = np.arange(steps)[every::every] * model.opt.timestep  # a site is known as of the step's start
        run = fa.simulate(given, np.append(0.0, t), drive={k: fa.Torque(x) for k, x in enumerate(TORQUES)})
        error = np.linalg.norm(run.frame()[0][1:] - np.array(track)[every::every], axis=1).max()
        bent = max(np.abs(run.tip_deflection(k)).max() for k in (0, 1))
        raw = segmented(given, n, fit=False)
        frequencies = ", ".join(f"{100 * (f / w - 1):+.2f}" for f, w in zip(raw.frequencies, raw.wanted, strict=True))
        print(
            f"| {n} | {frequencies} | {100 * cut.error:.0e} | {100 * off:.2f} | {1e3 * error:.2f} | "
            f"{100 * error / bent:.1f} | {model.opt.timestep:.0e} | {took:.2f} |"
        )


if __name__ == "__main__":
    main()
