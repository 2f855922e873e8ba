"""Robots that branch, whole and rigid: flexarm against Pinocchio and MuJoCo, numbers and the time of forward dynamics.

    pip install pin example-robot-data 'flexarm[mjcf]'
    python bench/robots/trees.py    # the table of docs/robots.md

All three read the same URDF file, without the base's body, shapes and friction, with mimic joints held, and with an
inertia for points of mass, which MuJoCo refuses. Gravity and damping act. Each program is called from Python with one
state, flexarm with many, too; they take turns; a time is the least of the rounds, a ratio their median.
"""

from __future__ import annotations

import tempfile
import time
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import flexarm as fa
import mujoco
import numpy as np
import pinocchio as pin

PAGE = Path(__file__).parents[2] / "docs" / "robots.md"
BEGIN, END = "<!-- written by bench/robots/trees.py: begin -->", "<!-- end -->"
ROBOTS = (
    "double_pendulum_description/urdf/double_pendulum_simple.urdf",
    "hyq_description/robots/hyq_no_sensors.urdf",
    "anymal_b_simple_description/robots/anymal-kinova.urdf",
    "simple_humanoid_description/urdf/simple_humanoid.urdf",
    "talos_data/robots/talos_reduced.urdf",
    "g1_description/urdf/g1_29dof_with_hand_rev_1_0.urdf",
    "baxter_description/urdf/baxter.urdf",
    "tiago_pro_description/robots/tiago_pro.urdf",
    "tiago_description/robots/tiago_dual.urdf",
)
POINT = "1e-6"  # kg m^2
STATES, ROUNDS, CALLS, BATCH = 5, 30, 50, 256


def plain(path: Path, out: Path) -> None:
    """The file without what moves nothing, for all three to read."""
    root = ET.parse(path).getroot()
    for link in root.iter("link"):
        for shape in (*link.findall("visual"), *link.findall("collision")):
            link.remove(shape)
    children = {child.get("link") for child in root.iter("child")}
    for link in root.findall("link"):
        for inertial in link.findall("inertial"):
            inertia, mass = inertial.find("inertia"), float(inertial.find("mass").get("value"))
            I = [[float(inertia.get("i" + "".join(sorted(a + b)))) for a in "xyz"] for b in "xyz"]
            if link.get("name") not in children or not mass:
                link.remove(inertial)
            elif not np.linalg.eigvalsh(I)[0] > 0:
                inertia.attrib.update(dict.fromkeys(("ixx", "iyy", "izz"), POINT), ixy="0", ixz="0", iyz="0")
    for joint in root.iter("joint"):
        joint.set("name", joint.get("name", "").replace(".", "_"))
        for mimic in joint.findall("mimic"):
            joint.remove(mimic)
            joint.set("type", "fixed")
        for dynamics in joint.findall("dynamics"):
            dynamics.attrib.pop("friction", None)
    settings = ET.SubElement(root, "mujoco")
    ET.SubElement(settings, "compiler", balanceinertia="false", boundmass="0", boundinertia="0")
    ET.ElementTree(root).write(out)


class Peers:
    """One robot in the three programs; a state is in flexarm's order."""

    def __init__(self, path: Path) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", fa.errors.RobotWarning)
            self.arm = fa.from_urdf(path)
        names = [link.joint.name for link in self.arm]
        self.damping = np.array([np.sum(link.joint.damping) for link in self.arm])
        self.pin = pin.buildModelFromUrdf(str(path))
        self.pin_data = self.pin.createData()
        joints = [self.pin.joints[self.pin.getJointId(name)] for name in names]
        self.to_pin = np.array([j.idx_v for j in joints])
        self.turns = [(j.idx_q, j.nq == 2) for j in joints]  # a continuous joint has cos and sin
        self.model = mujoco.MjModel.from_xml_path(str(path))
        bits = mujoco.mjtDisableBit
        self.model.opt.disableflags |= bits.mjDSBL_CONTACT | bits.mjDSBL_LIMIT | bits.mjDSBL_CONSTRAINT
        self.data = mujoco.MjData(self.model)
        self.to_mujoco = np.array([self.model.joint(name).dofadr[0] for name in names])
        assert self.arm.nv == self.pin.nv == self.model.nv

    def in_pin(self, q: np.ndarray, *others: np.ndarray) -> list[np.ndarray]:
        """A state in Pinocchio's order."""
        out = [np.zeros(self.pin.nq), *(np.zeros(self.pin.nv) for _ in others)]
        for (at, two), x in zip(self.turns, q, strict=True):
            out[0][at : at + 1 + two] = [np.cos(x), np.sin(x)] if two else x
        for given, x in zip(out[1:], others, strict=True):
            given[self.to_pin] = x
        return out

    def worst(self) -> dict[str, float]:
        """Of M, bias and accelerations at random states, the largest difference over the largest entry."""
        rng, out = np.random.default_rng(1), dict.fromkeys(("pin M", "pin h", "pin a", "mj M", "mj h", "mj a"), 0.0)
        for _ in range(STATES):
            q, v, tau = rng.uniform(-2, 2, self.arm.nv), *rng.normal(size=(2, self.arm.nv))
            ours = {"M": self.arm.mass_matrix(q), "h": self.arm.bias(q, v), "a": self.arm.forward_dynamics(q, v, tau)}
            given, rates, forces = self.in_pin(q, v, tau - self.damping * v)
            upper = np.triu(pin.crba(self.pin, self.pin_data, given))
            k = self.to_pin
            found = {
                "pin M": (upper + np.triu(upper, 1).T)[np.ix_(k, k)],
                "pin h": pin.nonLinearEffects(self.pin, self.pin_data, given, rates)[k] + self.damping * v,
                "pin a": pin.aba(self.pin, self.pin_data, given, rates, forces)[k],
            }
            k, data = self.to_mujoco, self.data
            data.qpos[k], data.qvel[k], data.qfrc_applied[k] = q, v, tau
            mujoco.mj_forward(self.model, data)
            M = np.zeros((self.arm.nv, self.arm.nv))
            for row, unit in zip(M, np.eye(self.arm.nv), strict=True):
                mujoco.mj_mulM(self.model, data, row, unit)
            found |= {"mj M": M[np.ix_(k, k)], "mj h": (data.qfrc_bias - data.qfrc_passive)[k], "mj a": data.qacc[k]}
            for name, x in found.items():
                error = np.abs(ours[name.split()[1]] - x).max() / np.abs(x).max()
                out[name] = max(out[name], float(error))
        return out

    def times(self) -> list[float]:
        """Forward dynamics by flexarm of one state and of one among BATCH (s of this thread), each with its ratios to
        Pinocchio's aba and to MuJoCo's mj_forward."""
        q, v, tau = np.random.default_rng(2).normal(size=(3, self.arm.nv))
        many = [np.repeat(x[None], BATCH, 0) for x in (q, v, tau)]
        given = self.in_pin(q, v, tau)
        self.data.qpos[self.to_mujoco], self.data.qvel[self.to_mujoco] = q, v

        def took(call: Callable[[], object], calls: int) -> float:
            began = time.thread_time_ns()
            for _ in range(calls):
                call()
            return (time.thread_time_ns() - began) * 1e-9 / calls

        def turn() -> list[float]:
            one = took(lambda: self.arm.forward_dynamics(q, v, tau), CALLS)
            peers = (
                took(lambda: pin.aba(self.pin, self.pin_data, *given), CALLS),
                took(lambda: mujoco.mj_forward(self.model, self.data), CALLS),
            )
            each = took(lambda: self.arm.forward_dynamics(*many), 1) / BATCH
            return [one, *(one / x for x in peers), each, *(each / x for x in peers)]

        rounds = np.array([turn() for _ in range(ROUNDS + 3)][3:])
        least, middle = rounds.min(axis=0).tolist(), np.median(rounds, axis=0).tolist()
        return [least[0], *middle[1:3], least[3], *middle[4:]]


def main() -> None:
    """The table, into the page."""
    robots = Path(pin.__file__).parents[4] / "share" / "example-robot-data" / "robots"
    peers = ["of Pinocchio's", "of MuJoCo's"]
    head = ["robot", "joints", "ends", "from Pinocchio", "from MuJoCo"]
    head += ["one state (µs)", *peers, f"one of {BATCH} (µs)", *peers]
    lines = [" | ".join(head), "|".join("-" * len(head))]
    with tempfile.TemporaryDirectory() as folder:
        for file in ROBOTS:
            plain(robots / file, path := Path(folder) / Path(file).name)
            robot = Peers(path)
            errors, times = robot.worst(), robot.times()
            cells = [path.stem, str(robot.arm.nv), str(len(robot.arm.ends))]
            cells += [f"{max(e for name, e in errors.items() if name.startswith(peer)):.0e}" for peer in ("pin", "mj")]
            cells += [f"{1e6 * x:.1f}" if k % 3 == 0 else f"{x:.2f}" for k, x in enumerate(times)]
            lines.append(" | ".join(cells))
            print(lines[-1], {name: f"{e:.0e}" for name, e in errors.items()}, flush=True)
    about = f"Pinocchio {pin.__version__} and MuJoCo {mujoco.__version__}, from PyPI, on a machine with other work."
    words = "\n".join([*(f"| {line} |" if "-|" not in line else f"|{line}|" for line in lines), "", about])
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    PAGE.write_text(f"{before}{BEGIN}\n\n{words}\n\n{END}{rest.partition(END)[2]}", encoding="utf-8")


if __name__ == "__main__":
    main()
