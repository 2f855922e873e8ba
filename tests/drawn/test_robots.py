"""URDF files drawn at random: against a rigid chain of this file's own, written and read again, damaged."""

from __future__ import annotations

import sys
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from hypothesis import strategies as st

sys.path.insert(0, str(Path(__file__).parent))

from scenes import SEEDS, drawn, note

pytestmark = pytest.mark.filterwarnings("ignore::flexarm.errors.RobotWarning")

WORDS = ["arm", "fore arm", "b<&>'\"", "élan", "wrist/pitch", "tool0", "UPPER", "x_y-z"]


def cross(a: Any) -> np.ndarray:
    x, y, z = a
    return np.array([[0 * x, -z, y], [z, 0 * x, -x], [-y, x, 0 * x]])


def turned(axis: Any, angle: Any) -> np.ndarray:
    """A rotation about a unit axis; also by a complex angle."""
    K = cross(axis)
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * (K @ K)


def pose(xyz: Any, rpy: Any) -> tuple[np.ndarray, np.ndarray]:
    x, y, z = np.eye(3)
    return np.array(xyz), turned(z, rpy[2]) @ turned(y, rpy[1]) @ turned(x, rpy[0])


@dataclass
class Robot:
    """Joints (kind, parent, xyz, rpy, axis, damping, friction) that move link k + 1 on link `parent`; of links 0, 1,
    ... mass, xyz, rpy and inertia; which of them is the tip."""

    joints: list[tuple[Any, ...]]
    bodies: list[tuple[Any, ...]]
    tip: int

    @classmethod
    def of(cls, seed: int) -> Robot:
        """A chain of joints that turn, slide or stand, with branches whose joints stand or are held."""
        rng = np.random.default_rng(seed)
        joints: list[tuple[Any, ...]] = []
        n = int(rng.integers(1, 6))
        for k in range(n + int(rng.integers(0, 3))):
            kinds = ["revolute", "revolute", "continuous", "prismatic", "fixed"]
            kind = kinds[rng.integers(3)] if k == 0 else kinds[rng.integers(len(kinds))]
            parent = k if k < n else int(rng.integers(1, n + 1))
            axis = np.eye(3)[rng.integers(3)] * rng.choice([-1, 1]) if rng.random() < 0.5 else rng.normal(size=3)
            friction = rng.uniform(0, 1, 2) * (rng.random(2) < 0.5)
            place = rng.normal(size=(2, 3)) * rng.choice([0.0, 0.3, 1.0], size=(2, 1))
            joints.append((kind, parent, *place, axis, *friction))
        bodies = [(0.0, np.zeros(3), np.zeros(3), np.zeros((3, 3)))]
        for k in range(len(joints)):
            m, A = np.exp(rng.uniform(-3, 2)), 0.1 * rng.normal(size=(3, 3))
            S = m * A @ A.T
            body = m, 0.2 * rng.normal(size=3), rng.normal(size=3), np.trace(S) * np.eye(3) - S
            bodies.append(body if rng.random() < 0.8 or k + 1 == n else bodies[0])
        return cls(joints, bodies, n)

    def text(self, names: Callable[[int], str] = "link{}".format) -> str:
        def words(x: Any) -> str:
            return " ".join(map(repr, map(float, np.ravel(x))))

        root = ET.Element("robot", name="drawn")
        for k, (m, xyz, rpy, J) in enumerate(self.bodies):
            link = ET.SubElement(root, "link", name=names(k))
            if m:
                inner = ET.SubElement(link, "inertial")
                ET.SubElement(inner, "origin", xyz=words(xyz), rpy=words(rpy))
                ET.SubElement(inner, "mass", value=repr(float(m)))
                six = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
                ET.SubElement(inner, "inertia", {key: repr(float(J[at])) for key, at in six.items()})
        for k, (kind, parent, xyz, rpy, axis, damping, friction) in enumerate(self.joints):
            joint = ET.SubElement(root, "joint", name=f"joint of {names(k + 1)}", type=kind)
            ET.SubElement(joint, "origin", xyz=words(xyz), rpy=words(rpy))
            ET.SubElement(joint, "parent", link=names(parent))
            ET.SubElement(joint, "child", link=names(k + 1))
            ET.SubElement(joint, "axis", xyz=words(axis))
            if kind != "fixed":
                ET.SubElement(joint, "limit", lower="-2", upper="2", effort="10", velocity="1")
                ET.SubElement(joint, "dynamics", damping=repr(float(damping)), friction=repr(float(friction)))
        return ET.tostring(root, encoding="unicode")

    @property
    def moving(self) -> list[int]:
        return [k for k in range(self.tip) if self.joints[k][0] != "fixed"]

    def at(self, q: Any) -> tuple[Any, Any, Any, Any]:
        """Mass matrix, potential, and the tip's place and axes, of coordinates that may be complex."""
        moving = self.moving
        places: list[tuple[Any, Any]] = [(np.zeros(3), np.eye(3))]
        columns: list[list[tuple[Any, Any, bool]]] = [[]]  # of joints below each link: place, axis, whether it turns
        M, V = np.zeros((len(moving), len(moving)), q.dtype), np.zeros((), q.dtype)
        for k, (kind, parent, xyz, rpy, axis, *_) in enumerate(self.joints):
            (p, R), (there, turn) = places[parent], pose(xyz, rpy)
            p, R, own = p + R @ there, R @ turn, []
            if k in moving:
                x, unit = q[moving.index(k)], axis / np.linalg.norm(axis)
                own = [(p, R @ unit, kind != "prismatic")]
                p, R = (p + R @ unit * x, R) if kind == "prismatic" else (p, R @ turned(unit, x))
            places.append((p, R))
            columns.append(columns[parent] + own)
            m, xyz, rpy, J = self.bodies[k + 1]
            if not m:
                continue
            com, axes = p + R @ xyz, R @ pose(xyz, rpy)[1]
            Jv, Jw = np.zeros((2, 3, len(moving)), q.dtype)
            for i, (base, along, turns) in enumerate(columns[-1]):
                Jv[:, i] = np.cross(along, com - base) if turns else along
                Jw[:, i] = along if turns else 0.0
            M = M + m * Jv.T @ Jv + Jw.T @ (axes @ J @ axes.T) @ Jw
            V = V + m * 9.81 * com[2]
        return M, V, *places[self.tip]

    def bias(self, q: Any, v: Any) -> Any:
        """Lagrange's equations, their derivatives by complex steps."""
        h = 1e-30
        steps = [self.at(q + 1j * h * e) for e in np.eye(len(q))]
        dM, dV = np.array([s[0].imag / h for s in steps]), np.array([s[1].imag / h for s in steps])
        damping = np.array([self.joints[k][5] for k in self.moving])
        return np.einsum("kij,k,j->i", dM, v, v) - 0.5 * np.einsum("kij,i,j->k", dM, v, v) + dV + damping * v


def read(folder: Path, text: str, **options: Any) -> fa.Arm:
    path = folder / "drawn.urdf"
    path.write_text(text, encoding="utf-8")
    return fa.from_urdf(path, **options)


@drawn(12, SEEDS, st.permutations(WORDS))
def test_a_robot_is_the_chain_in_its_file(
    tmp_path_factory: pytest.TempPathFactory, seed: int, names: list[str]
) -> None:
    """Mass matrix, bias and tip of an arm from a URDF file, and of what that arm writes as one."""
    robot, rng, folder = Robot.of(seed), np.random.default_rng(seed), tmp_path_factory.mktemp("robot")
    arm = read(folder, robot.text(lambda k: names[k]), tip=names[robot.tip])
    kinds = ["prismatic" if robot.joints[k][0] == "prismatic" else "revolute" for k in robot.moving]
    assert [link.joint.type for link in arm.links if link.joint.nv] == kinds
    assert list(arm.names) == [names[k + 1] for k in {*robot.moving, robot.tip - 1}]
    coulomb = [robot.joints[k][6] for k in robot.moving]
    assert [float(np.sum(link.joint.coulomb)) for link in arm.links if link.joint.nv] == coulomb
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        again = read(folder, arm.to_urdf(), tip="tip")
    q, v = rng.normal(size=(2, arm.nv))
    M, _, place, axes = robot.at(q)
    size = np.abs(M).max() + 1e-9
    for one, close in ((arm, 1e-11), (again, 1e-8)):  # the latter has 1e-12 kg where there is no mass
        np.testing.assert_allclose(one.mass_matrix(q), M, rtol=0, atol=close * size)
        h = robot.bias(q, v)
        np.testing.assert_allclose(one.bias(q, v), h, rtol=0, atol=close * (np.abs(h).max() + size * (v @ v + 10)))
        found = one.frame(q)
        np.testing.assert_allclose(found[0], place, rtol=0, atol=close * (1 + np.abs(place).max()))
        np.testing.assert_allclose(found[1], axes, rtol=0, atol=close)


JUNK = ["", "nan", "inf", "-1", "1e400", "0 0", "1 2 3 4", "abc", "0 0 0", "1e200 0 0", "\N{BULLET}", "ball", "link1"]


@drawn(30, SEEDS)
def test_a_damaged_robot_is_refused_in_words(tmp_path_factory: pytest.TempPathFactory, seed: int) -> None:
    """A value, an element or a part of the file is wrong: an arm of finite numbers, or ValueError with the file's
    name; nothing else."""
    rng = np.random.default_rng(seed)
    robot = Robot.of(seed)
    text = robot.text()
    root = ET.fromstring(text)
    nodes = list(root.iter())
    kind = rng.integers(5)
    if kind == 0:
        text = text[: rng.integers(len(text))]
    elif kind == 1:
        parent = nodes[rng.integers(len(nodes))]
        if len(parent):
            parent.remove(parent[rng.integers(len(parent))])
    elif kind == 2:
        parent = nodes[rng.integers(len(nodes))]
        if len(parent):
            parent.append(parent[rng.integers(len(parent))])
    else:
        node = nodes[rng.integers(len(nodes))]
        if node.attrib:
            key = list(node.attrib)[rng.integers(len(node.attrib))]
            node.set(key, JUNK[rng.integers(len(JUNK))])
    text = text if kind == 0 else ET.tostring(root, encoding="unicode")
    try:
        arm = read(tmp_path_factory.mktemp("robot"), text, tip=f"link{robot.tip}")
    except ValueError as e:
        assert "drawn.urdf" in str(e) and not isinstance(e, np.linalg.LinAlgError)
        note("refused in words")
    else:
        assert np.isfinite(arm.mass_matrix(arm.zero)).all() and np.isfinite(arm.frame(arm.zero)[0]).all()
