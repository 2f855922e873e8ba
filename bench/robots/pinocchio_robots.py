"""Rigid arms from URDF files against Pinocchio: mass matrix, bias, accelerations, the tip's frame.

    pip install pin example-robot-data
    python bench/robots/pinocchio_robots.py           # published robots, the table of docs/robots.md
    python bench/robots/pinocchio_robots.py --data    # the robots of tests/data/robots, into tests/data/robots.json

Joints that are not on the way to the tip stand at zero in both (`buildReducedModel`). Pinocchio's models have no
damping; that of the file is added to its bias.
"""

from __future__ import annotations

import json
import sys
import warnings
from pathlib import Path

import flexarm as fa
import numpy as np
import pinocchio as pin

DATA = Path(__file__).parents[2] / "tests" / "data"
OWN = (
    ("six.urdf", "tool"),
    ("six.urdf", "forearm"),
    ("scara.urdf", "gripper"),
    ("tree.urdf", "left_palm"),
    ("tree.urdf", "finger_a"),
)
PUBLISHED = (
    ("ur_description/urdf/ur5_robot.urdf", "tool0"),
    ("ur_description/urdf/ur10_robot.urdf", "ee_link"),
    ("panda_description/urdf/panda.urdf", "panda_hand_tcp"),
    ("panda_description/urdf/panda.urdf", "panda_leftfinger"),
    ("xarm_description/urdf/xarm7.urdf", "link7"),
    ("kinova_description/robots/kinova.urdf", "j2s6s200_end_effector"),
    ("z1_description/urdf/z1.urdf", "gripperStator"),
    ("so_arm_description/urdf/so101.urdf", "gripper_link"),
    ("tiago_description/robots/tiago.urdf", "arm_tool_link"),
    ("baxter_description/urdf/baxter.urdf", "left_gripper"),
    ("pr2_description/urdf/pr2.urdf", "r_gripper_tool_frame"),
    ("talos_data/robots/talos_reduced.urdf", "gripper_left_base_link"),
    ("icub_description/robots/icub.urdf", "l_hand"),
)
STATES = 5


def reduced(path: Path, names: list[str]) -> pin.Model:
    """Pinocchio's model with all joints but these locked at zero."""
    full = pin.buildModelFromUrdf(str(path))
    locked = [i for i in range(1, full.njoints) if full.names[i] not in names]
    model = pin.buildReducedModel(full, locked, pin.neutral(full))
    assert list(model.names)[1:] == names
    return model


def numbers(model: pin.Model, tip: str, states: int, seed: int = 1) -> list[dict[str, np.ndarray]]:
    """At random states: M, h without damping, a of random forces, and the tip's place."""
    rng, data = np.random.default_rng(seed), model.createData()
    frame = model.getFrameId(tip, pin.FrameType.BODY)
    out = []
    for _ in range(states):
        q, v, tau = rng.uniform(-2, 2, model.nv), rng.normal(size=model.nv), rng.normal(size=model.nv)
        # a continuous joint has cos and sin
        pairs = zip(q, list(model.joints)[1:], strict=True)
        given = np.concatenate([[np.cos(x), np.sin(x)] if j.nq == 2 else [x] for x, j in pairs])
        upper = np.triu(pin.crba(model, data, given))
        M = upper + np.triu(upper, 1).T
        h = pin.nonLinearEffects(model, data, given, v).copy()
        a = pin.aba(model, data, given, v, tau).copy()
        pin.framesForwardKinematics(model, data, given)
        place = data.oMf[frame]
        state = {"q": q, "v": v, "tau": tau, "M": M, "h": h, "a": a}
        out.append({**state, "p": place.translation.copy(), "R": place.rotation.copy()})
    return out


def arm_of(path: Path, tip: str) -> fa.Arm:
    """Without what the file says of no use here."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.errors.RobotWarning)
        return fa.from_urdf(path, tip=tip)


def worst(arm: fa.Arm, found: list[dict[str, np.ndarray]]) -> dict[str, float]:
    """The largest difference of each, over the largest entry."""
    damping = np.array([np.sum(link.joint.damping) for link in arm if link.joint.nv])
    out: dict[str, float] = {}
    for x in found:
        p, R = arm.frame(x["q"])
        ours = {"M": arm.mass_matrix(x["q"]), "h": arm.bias(x["q"], x["v"]) - damping * x["v"], "p": p, "R": R}
        ours["a"] = arm.forward_dynamics(x["q"], x["v"], x["tau"] + damping * x["v"])
        for k, value in ours.items():
            out[k] = max(out.get(k, 0.0), float(np.abs(value - x[k]).max() / np.abs(x[k]).max()))
    return out


def main() -> None:
    """One of the two."""
    if "--data" in sys.argv:
        made = []
        for file, tip in OWN:
            path = DATA / "robots" / file
            joints = [link.joint.name for link in arm_of(path, tip) if link.joint.nv]
            found = numbers(reduced(path, joints), tip, 2)
            made.append({"file": file, "tip": tip, "states": [{k: x.tolist() for k, x in s.items()} for s in found]})
        about = f"made by bench/robots/pinocchio_robots.py --data, Pinocchio {pin.__version__}"
        (DATA / "robots.json").write_text(json.dumps({"about": about, "robots": made}, indent=1) + "\n")
        return
    robots = Path(pin.__file__).parents[4] / "share" / "example-robot-data" / "robots"
    print(f"Pinocchio {pin.__version__}\n")
    print("| robot | tip | joints | M | bias | acceleration | place | axes |\n|-|-|-|-|-|-|-|-|")
    for file, tip in PUBLISHED:
        arm = arm_of(robots / file, tip)
        model = reduced(robots / file, [link.joint.name for link in arm if link.joint.nv])
        e = worst(arm, numbers(model, tip, STATES))
        cells = [Path(file).stem, tip, str(arm.nv), *(f"{e[k]:.0e}" for k in ("M", "h", "a", "p", "R"))]
        print(f"| {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
