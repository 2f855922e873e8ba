"""Robots with a floating base, and ball and planar joints: MuJoCo reads the same file and has the same numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from messages import refuses, warns
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

mujoco = pytest.importorskip("mujoco")
pytestmark = pytest.mark.filterwarnings("ignore::flexarm.errors.RobotWarning")

#: Four legs on a trunk that floats: two of hinges, two with balls beside their bodies' origins; a tail; a crate.
QUADRUPED = """<mujoco><compiler angle="radian"/><option gravity="0.3 0 -9.7"/>
<default><geom density="600"/></default>
<worldbody><body name="trunk" pos="0.1 -0.2 0.5" euler="0.1 0.2 0.4"><freejoint name="root"/>
  <geom type="box" size="0.25 0.1 0.06" pos="0.02 0 0.01"/>
  <body name="hip_fl" pos="0.2 0.1 0"><joint name="roll_fl" axis="1 0 0" damping="0.2" armature="0.01"/>
    <joint name="swing_fl" axis="0 1 0.1" pos="0 0.02 0" stiffness="3" springref="0.4"/>
    <geom type="capsule" fromto="0 0 0 0.02 0 -0.2" size="0.02"/>
    <body name="shin_fl" pos="0.02 0 -0.2"><joint name="knee_fl" axis="0 1 0" damping="0.1"/>
      <geom type="capsule" fromto="0 0 0 -0.03 0 -0.2" size="0.015"/></body></body>
  <body name="hip_fr" pos="0.2 -0.1 0" euler="0 0 0.1"><joint name="swing_fr" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0.02 0 -0.2" size="0.02"/></body>
  <body name="hip_bl" pos="-0.2 0.1 0" euler="0.3 0.2 0"><joint name="ball_bl" type="ball" pos="0.01 0.02 -0.03"
      damping="0.3" armature="0.02" stiffness="2" limited="true" range="0 1.2"/>
    <geom type="capsule" fromto="0 0 0 0.02 0 -0.2" size="0.02"/>
    <body name="shin_bl" pos="0.02 0 -0.2"><joint name="knee_bl" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 -0.03 0 -0.2" size="0.015"/></body></body>
  <body name="hip_br" pos="-0.2 -0.1 0"><joint name="reach_br" type="slide" axis="0 1 0"/>
    <joint name="ball_br" type="ball" pos="0 0.01 0" limited="true" range="0 3.3"/>
    <geom type="capsule" fromto="0 0 0 0.02 0 -0.2" size="0.02"/></body>
  <body name="tail" pos="-0.25 0 0.05"><joint name="wag" axis="0 0 1"/>
    <geom type="capsule" fromto="0 0 0 -0.2 0 0" size="0.01"/></body></body>
<body name="crate" pos="1 0 0.2" euler="0 0 0.7">
  <joint name="loose" type="free" damping="0.4" armature="0.3" stiffness="5"/><geom type="box" size="0.2 0.1 0.1"/></body>
<body name="lamp" pos="0 1 1" euler="0 0.5 0"><joint name="socket" type="ball"/>
  <geom size="0.1" pos="0.1 0 0.2"/></body>
</worldbody></mujoco>"""

BODY = (
    '<inertial><origin xyz="0.1 0.01 -0.02"/><mass value="1"/>'
    '<inertia ixx="0.004" ixy="0.0005" ixz="-0.0002" iyy="0.01" iyz="0" izz="0.011"/></inertial>'
)
#: link, parent, kind of its joint, axis
ROWS = (
    ("drone", "ground", "floating", "0 0 1"),
    ("gimbal", "drone", "revolute", "0 1 0"),
    ("rotor", "drone", "continuous", "0 0 1"),
    ("puck", "ground", "planar", "0.2 0.3 -1"),
    ("handle", "puck", "revolute", "1 0 0"),
    ("slab", "ground", "planar", "1 0 0"),
)
URDF = (
    '<robot name="two"><link name="ground"/>'
    + "".join(
        f'<link name="{name}">{BODY}</link><joint name="to {name}" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{name}"/><origin xyz="{0.1 * k} 0.2 0.5" rpy="0.1 {0.2 * k} 0.3"/><axis xyz="{axis}"/>'
        '<dynamics damping="0.3"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>'
        for k, (name, parent, kind, axis) in enumerate(ROWS)
    )
    + "</robot>"
)


def read(folder: Path, text: str, **options: Any) -> fa.Arm:
    path = folder / ("robot.urdf" if "<robot" in text else "robot.xml")
    path.write_text(text)
    return (fa.from_urdf if "<robot" in text else fa.from_mjcf)(path, **options)


def in_mujoco(arm: fa.Arm, model: Any, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """qpos, and T of qvel = T v, for joints in the same order. A free joint of MuJoCo has its place and its velocity in
    world axes, one of flexarm in the axes that the body has at qpos0; both have their angular velocity in the body's
    axes. All others have the same numbers."""
    qpos, blocks, at = q.copy(), list[np.ndarray](), 0
    for joint in (link.joint for link in arm):
        place, turn = slice(at, at + 3), slice(at + 3, at + 7)
        blocks.append(np.eye(joint.nv))
        if joint.type == "free":
            p, R = model.qpos0[place], Rotation.from_quat(model.qpos0[turn], scalar_first=True)
            qpos[place] = p + R.apply(q[place])
            qpos[turn] = (R * Rotation.from_quat(q[turn], scalar_first=True)).as_quat(scalar_first=True)
            blocks[-1] = block_diag(R.as_matrix(), np.eye(3))
        at += joint.nq
    return qpos, block_diag(*blocks)


def place_and_acceleration(model: Any, data: Any, body: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of a body's origin, in world axes; MuJoCo's own accelerations are those against a fall."""
    mujoco.mj_rnePostConstraint(model, data)
    found, k = np.zeros(6), model.body(body).id
    mujoco.mj_objectAcceleration(model, data, mujoco.mjtObj.mjOBJ_XBODY, k, found, 0)
    return data.xpos[k], data.xmat[k].reshape(3, 3), np.concatenate([found[3:] + model.opt.gravity, found[:3]])


def agrees(arm: fa.Arm, model: Any, bodies: tuple[str, ...], reach: float = 1.5) -> None:
    """Mass matrix, bias, both dynamics, and places and accelerations of bodies that carry no other, at random states,
    to 1e-12 of the largest number."""
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    model.opt.gravity[:] = arm.gravity
    data, rng = mujoco.MjData(model), np.random.default_rng(5)
    assert (arm.nq, arm.nv) == (model.nq, model.nv)

    def near(found: np.ndarray, wanted: np.ndarray) -> None:
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * max(np.abs(wanted).max(), 1.0))

    for _ in range(3):
        q, v, tau = rng.uniform(-reach, reach, arm.nq), rng.normal(size=arm.nv), rng.normal(size=arm.nv)
        for _, at in arm.quaternions():
            q[at] = Rotation.from_rotvec(rng.uniform(-reach, reach, 3)).as_quat(scalar_first=True)
        data.qpos[:], T = in_mujoco(arm, model, q)
        data.qvel[:], data.qfrc_applied[:] = T @ v, T @ tau  # T is orthogonal
        mujoco.mj_forward(model, data)
        M = np.array([mujoco.mj_mulM(model, data, row := np.zeros(arm.nv), x) or row for x in np.eye(arm.nv)])
        near(arm.mass_matrix(q), T.T @ M @ T)
        near(arm.bias(q, v), T.T @ (data.qfrc_bias - data.qfrc_passive))
        a = arm.forward_dynamics(q, v, tau)
        near(a, T.T @ data.qacc)
        for body in bodies:
            p, R, acceleration = place_and_acceleration(model, data, body)
            near(arm.frame(q, body)[0], p)
            near(arm.frame(q, body)[1], R)
            near(arm.acceleration(q, v, a, body), acceleration)
        a = rng.normal(size=arm.nv)
        data.qacc[:] = T @ a
        mujoco.mj_inverse(model, data)
        near(arm.inverse_dynamics(q, v, a), T.T @ data.qfrc_inverse)


def test_a_quadruped(tmp_path: Path) -> None:
    arm, model = read(tmp_path, QUADRUPED), mujoco.MjModel.from_xml_string(QUADRUPED)
    assert [link.joint.name for link in arm] == [model.joint(k).name for k in range(model.njnt)]
    kinds = {link.joint.name: link.joint.type for link in arm}
    assert [name for name in kinds if kinds[name] == "free"] == ["root", "loose"]
    assert [name for name in kinds if kinds[name] == "spherical"] == ["ball_bl", "ball_br", "socket"]
    ball, loose = arm["ball_bl"].joint, arm["loose"].joint
    assert (ball.damping, ball.reflected_inertia, ball.stiffness, ball.upper) == (0.3, 0.02, 2.0, None)
    assert (loose.damping, loose.reflected_inertia, loose.stiffness) == (0.4, 0.3, 5.0)
    assert not arm["root"].joint.outboard and len(arm.children("trunk")) == 5
    agrees(arm, model, ("shin_fl", "hip_fr", "shin_bl", "hip_br", "tail", "crate", "lamp"))


def test_zero_is_the_files_reference(tmp_path: Path) -> None:
    arm, model = read(tmp_path, QUADRUPED), mujoco.MjModel.from_xml_string(QUADRUPED)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for body in ("shin_fl", "shin_bl", "hip_br", "crate", "lamp"):
        p, R = arm.frame(arm.zero, body)
        np.testing.assert_allclose(p, data.body(body).xpos, rtol=0, atol=1e-15)
        np.testing.assert_allclose(R, data.body(body).xmat.reshape(3, 3), rtol=0, atol=1e-15)


def test_a_urdf_with_floating_and_planar_joints(tmp_path: Path) -> None:
    arm, model = read(tmp_path, URDF), mujoco.MjModel.from_xml_string(URDF)
    assert {name: arm[name].joint.type for name, *_ in ROWS} == {
        "drone": "free", "gimbal": "revolute", "rotor": "revolute", "puck": "planar", "handle": "revolute",
        "slab": "planar",
    }  # fmt: skip
    assert arm["drone"].joint.damping == arm["puck"].joint.damping == 0.3
    agrees(arm, model, ("gimbal", "rotor", "handle", "slab"))
    p, R = arm.frame(arm.pose({"slab": (0.3, -0.2, 0.4)}), "slab")
    p0, R0 = arm.frame(arm.zero, "slab")
    np.testing.assert_allclose(R0.T @ (p - p0), [0, -0.2, -0.3], atol=1e-15)  # y stays, z goes to x, the normal
    np.testing.assert_allclose(R0.T @ R, Rotation.from_rotvec([0.4, 0, 0]).as_matrix(), atol=1e-15)


def test_the_chain_to_one_leg(tmp_path: Path) -> None:
    """All that does not lead to the tip is held, as in MuJoCo where its rows and columns go."""
    arm, whole = read(tmp_path, QUADRUPED, tip="shin_bl"), read(tmp_path, QUADRUPED)
    assert arm.is_chain and arm.names == ("trunk", "hip_bl", "shin_bl")
    trunk, turn = (0.2, 0.1, -0.3, 0.3, 0.5, -0.4), (0.2, -0.3, 0.8)
    joints = {"trunk": trunk, "hip_bl": turn, "shin_bl": 0.7}
    mine = [i for name in joints for i in whole.joint_rates(name)]
    M = whole.mass_matrix(whole.pose(joints))[np.ix_(mine, mine)]
    np.testing.assert_allclose(arm.mass_matrix(arm.pose(joints)), M, rtol=0, atol=1e-13 * M.max())
    np.testing.assert_allclose(arm.frame(joints)[0], whole.frame(joints, "shin_bl")[0], rtol=0, atol=1e-15)


def test_the_stop_of_a_ball(tmp_path: Path) -> None:
    """It is the largest angle of its turn; one that no turn reaches is none."""
    arm = read(tmp_path, QUADRUPED, stops=(50.0, 1.0))
    ball = arm["ball_bl"].joint
    assert (ball.lower, ball.upper, ball.limit_stiffness, ball.limit_damping) == (None, 1.2, 50.0, 1.0)
    assert arm["ball_br"].joint.upper is None and arm["root"].joint.upper is None


def test_a_flexible_leg_on_a_floating_base(tmp_path: Path) -> None:
    """Where nothing bends, all stands as in the rigid robot; the trunk falls freely with what it carries."""
    alloy = fa.Material(density=2700.0, youngs_modulus=70e9, poisson_ratio=0.33)
    rod = fa.Beam(np.hypot(0.2, 0.02), fa.Circle(0.005), alloy, {"bending_y": 2, "bending_z": 2}, "legendre")
    arm, rigid = (read(tmp_path, QUADRUPED, flexible=x) for x in ({"hip_bl": rod}, None))
    assert arm.nv == rigid.nv + 4 and arm["hip_bl"].joint.type == "spherical"
    joints = {"trunk": (0.2, 0.1, -0.3, 0.3, 0.5, -0.4), "hip_bl": (0.2, -0.3, 0.8), "shin_bl": 0.7}
    for ours, theirs in zip(arm.frame(joints, "shin_bl"), rigid.frame(joints, "shin_bl"), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-14)


def test_numbers_for_all_joints(tmp_path: Path) -> None:
    """They are of drives, which free joints do not have, unless these are named."""
    arm = read(tmp_path, QUADRUPED, damping=0.7, coulomb=0.1, reflected_inertia={"root": 0.4})
    assert (arm["root"].joint.damping, arm["loose"].joint.damping) == (0.0, 0.4)
    assert arm["root"].joint.reflected_inertia == 0.4
    ball, tail = arm["ball_bl"].joint, arm["tail"].joint
    assert (ball.damping, ball.coulomb, tail.damping, tail.coulomb) == (0.7, 0.0, 0.7, 0.1)
    with refuses("robot.xml", "joint 'ball_bl'", "coulomb", "0.1", "three rotations"):
        read(tmp_path, QUADRUPED, coulomb={"ball_bl": 0.1})


def test_what_is_not_read(tmp_path: Path) -> None:
    text = QUADRUPED.replace('damping="0.3"', 'frictionloss="0.3"').replace('damping="0.4"', 'frictionloss="0.4"')
    with warns(fa.errors.RobotWarning, "dry friction of ball and free joints: ball_bl, loose"):
        read(tmp_path, text)
    text = URDF.replace('<dynamics damping="0.3"/>', '<dynamics friction="0.3"/>')
    with warns(fa.errors.RobotWarning, "dry friction of ball and free joints: to drone"):
        assert read(tmp_path, text)["puck"].joint.coulomb == 0.3
    with refuses("robot.urdf", "joint 'to puck'", "axis = [0.0, 0.0, 0.0]", "length"):
        read(tmp_path, URDF.replace('xyz="0.2 0.3 -1"', 'xyz="0 0 0"'))
    mimic = URDF.replace("<axis", '<mimic joint="to rotor"/><axis', 1)
    with refuses("robot.urdf", "joint 'to drone'", "mimic of 'to rotor'", "tip = ['handle', 'slab']"):
        read(tmp_path, mimic)
