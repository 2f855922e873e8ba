"""One tree of rigid bodies in flexarm, Pinocchio and MuJoCo: mass matrix, inverse and forward dynamics, compared.

    pip install pin 'flexarm[mjcf]'
    python bench/run/trees_peers.py [--docs]

A free body that carries 16 others on hinges and slides, all drawn at random: parents, places, axes, masses, centres,
inertias. Each program gets the numbers by its own functions; no file of a robot is between them.
Prints the table; with --docs writes it into docs/trees.md.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import flexarm as fa
import mujoco
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from reporting import replace_table

Array = NDArray[np.float64]
PAGE = Path(__file__).resolve().parents[2] / "docs" / "trees.md"
GRAVITY = (0.3, -0.5, -9.81)
BODIES, STATES = 17, 50
FREE = 6  # rates of the first body


@dataclass
class Body:
    parent: int
    slides: bool
    axis: Array
    place: Array  # on the parent, in its axes
    turn: Array  # rotation matrix from there
    mass: float
    com: Array
    inertia: Array  # about the centre of mass


def draw(seed: int = 3) -> list[Body]:
    """Parents in depth-first order, as Pinocchio and MuJoCo number them."""
    rng = np.random.default_rng(seed)
    made: list[Body] = []
    branch: list[int] = []  # from the first body to the last one
    for k in range(BODIES):
        branch = branch[: max(1, len(branch) - int(rng.integers(0, 3)))] if k else []
        moments = rng.normal(size=(3, 3)) * 0.1
        second = moments @ moments.T + 1e-3 * np.eye(3)
        made.append(
            Body(
                branch[-1] if branch else -1,
                k % 5 == 4,
                (axis := rng.normal(size=3)) / np.linalg.norm(axis),
                rng.uniform(-0.4, 0.4, 3) if k else np.zeros(3),
                Rotation.random(random_state=rng).as_matrix() if k else np.eye(3),
                float(rng.uniform(0.2, 3)),
                rng.uniform(-0.2, 0.2, 3),
                np.trace(second) * np.eye(3) - second,
            )
        )
        branch.append(k)
    return made


def in_flexarm(bodies: list[Body]) -> fa.Arm:
    links = []
    for k, of in enumerate(bodies):
        kind = fa.Prismatic if of.slides else fa.Revolute
        joint = kind(tuple(of.axis), inboard=fa.Placement(tuple(of.place), of.turn)) if k else fa.Free()
        parent = f"body{of.parent}" if k else "world"
        links.append(fa.Link(joint, fa.RigidBody(of.mass, tuple(of.com), of.inertia), name=f"body{k}", parent=parent))
    return fa.Arm(links, GRAVITY)


class Pinocchio:
    """Of the free body its rates are those in the body's axes."""

    def __init__(self, bodies: list[Body]) -> None:
        self.model = pin.Model()
        self.model.gravity.linear = np.array(GRAVITY)
        joints: list[int] = []
        for k, of in enumerate(bodies):
            kind = pin.JointModelPrismaticUnaligned if of.slides else pin.JointModelRevoluteUnaligned
            seat, on = pin.SE3(of.turn, of.place), joints[of.parent] if k else 0
            joint = self.model.addJoint(on, kind(*of.axis) if k else pin.JointModelFreeFlyer(), seat, f"joint{k}")
            self.model.appendBodyToJoint(joint, pin.Inertia(of.mass, of.com, of.inertia), pin.SE3.Identity())
            joints.append(int(joint))
        self.data = self.model.createData()

    def answers(self, q: Array, v: Array, a: Array, tau: Array) -> list[Array]:
        R = Rotation.from_quat(q[3:7], scalar_first=True).as_matrix()
        P = np.eye(len(v))  # its rates are P v
        P[:3, :3] = R.T
        rate = np.zeros(len(v))  # dP/dt v
        rate[:3] = -np.cross(v[3:6], R.T @ v[:3])
        given = np.concatenate([q[:3], q[4:7], q[3:4], q[7:]])
        upper = np.triu(pin.crba(self.model, self.data, given))
        M = P.T @ (upper + np.triu(upper, 1).T) @ P
        inverse = P.T @ pin.rnea(self.model, self.data, given, P @ v, P @ a + rate)
        forward = pin.aba(self.model, self.data, given, P @ v, P @ tau)
        return [M, inverse, P.T @ (forward - rate)]


class Mujoco:
    def __init__(self, bodies: list[Body]) -> None:
        def text(x: Array) -> str:
            return " ".join(f"{y:.17g}" for y in x)

        def element(k: int) -> str:
            of, I = bodies[k], bodies[k].inertia
            turn = Rotation.from_matrix(of.turn).as_quat(scalar_first=True)
            full = np.array([I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]])
            joint = f'<joint type="{"slide" if of.slides else "hinge"}" axis="{text(of.axis)}"/>'
            inside = "".join(element(j) for j in range(k + 1, BODIES) if bodies[j].parent == k)
            return (
                f'<body pos="{text(of.place)}" quat="{text(turn)}">{joint if k else "<freejoint/>"}'
                f'<inertial pos="{text(of.com)}" mass="{of.mass:.17g}" fullinertia="{text(full)}"/>{inside}</body>'
            )

        option = f'<option gravity="{text(np.array(GRAVITY))}"/>'
        xml = f"<mujoco>{option}<worldbody>{element(0)}</worldbody></mujoco>"
        self.model = mujoco.MjModel.from_xml_string(xml)
        self.data = mujoco.MjData(self.model)

    def answers(self, q: Array, v: Array, a: Array, tau: Array) -> list[Array]:
        model, data = self.model, self.data
        data.qpos[:], data.qvel[:], data.qfrc_applied[:] = q, v, tau
        mujoco.mj_forward(model, data)
        forward, M = data.qacc.copy(), np.zeros((len(v), len(v)))
        for row, unit in zip(M, np.eye(len(v)), strict=True):
            mujoco.mj_mulM(model, data, row, unit)
        data.qacc[:] = a
        mujoco.mj_inverse(model, data)
        return [M, data.qfrc_inverse.copy(), forward]


def compare() -> tuple[Array, fa.Arm]:
    """Of M, inverse and forward dynamics (rows): flexarm from Pinocchio, from MuJoCo, and these two from each other;
    the largest difference over the largest entry, at all states."""
    bodies = draw()
    arm, first, second = in_flexarm(bodies), Pinocchio(bodies), Mujoco(bodies)
    rng, worst = np.random.default_rng(8), np.zeros((3, 3))
    for _ in range(STATES):
        q, (v, a, tau) = np.array(arm.zero), rng.normal(size=(3, arm.nv))
        q[:3], q[7:] = rng.normal(size=3), rng.uniform(-2, 2, BODIES - 1)
        q[3:7] = Rotation.random(random_state=rng).as_quat(scalar_first=True)
        own = [arm.mass_matrix(q), arm.inverse_dynamics(q, v, a), arm.forward_dynamics(q, v, tau)]
        for row, x, y, z in zip(worst, own, first.answers(q, v, a, tau), second.answers(q, v, a, tau), strict=True):
            size = np.abs(x).max()
            found = [np.abs(x - y).max() / size, np.abs(x - z).max() / size, np.abs(y - z).max() / size]
            row[:] = np.maximum(row, found)
    return worst, arm


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--docs", action="store_true", help="write the table of docs/trees.md")
    args = parser.parse_args()
    worst, arm = compare()
    lines = ["|  | flexarm from Pinocchio | flexarm from MuJoCo | these two |", "|-" * 4 + "|"]
    for name, row in zip(("mass matrix", "inverse dynamics", "forward dynamics"), worst, strict=True):
        lines.append(f"| {name} | " + " | ".join(f"{x:.0e}" for x in row) + " |")
    about = f"{len(arm.links)} bodies, {len(arm.ends)} ends, {arm.nv} freedoms, {STATES} states; "
    lines += ["", f"{about}Pinocchio {pin.__version__}, MuJoCo {mujoco.__version__}."]
    print("\n".join(lines))
    if args.docs:
        replace_table(PAGE, "rigid", "\n".join(lines))


if __name__ == "__main__":
    main()
