"""Robots with a floating base, and ball and planar joints: MuJoCo reads the same file and has the same numbers."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from flexarm.robots.segments import segmented
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
  <joint name="loose" type="free" damping="0.4" armature="0.3" stiffness="5"/>
  <geom type="box" size="0.2 0.1 0.1"/></body>
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
    world axes, one of flexarm in the axes of its inboard side. MuJoCo's balls turn from and in the body's axes, those
    of flexarm in the axes of the moving side. All others have the same numbers."""
    qpos, blocks, at = q.copy(), list[np.ndarray](), 0
    for joint in (link.joint for link in arm):
        blocks.append(np.eye(joint.nv))
        at += joint.nq
        if joint.ball:
            place, turn = slice(at - 7, at - 4), slice(at - 4, at)
            out = Rotation.from_rotvec(joint.outboard.rotation if joint.outboard else (0, 0, 0))
            zero = Rotation.from_quat(model.qpos0[turn], scalar_first=True)  # no turn, but of a free joint
            own = zero * out.inv() * Rotation.from_quat(q[turn], scalar_first=True) * out
            qpos[turn] = own.as_quat(scalar_first=True)
            blocks[-1][-3:, -3:] = out.inv().as_matrix()
            if any(model.joint(k).name == joint.name and model.joint(k).type == 0 for k in range(model.njnt)):
                side = zero * out.inv()
                qpos[place] = model.qpos0[place] + side.apply(q[place])
                blocks[-1][:3, :3] = side.as_matrix()
    return qpos, block_diag(*blocks)


def place_and_acceleration(model: Any, data: Any, body: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of a body's origin, in world axes; MuJoCo's own accelerations are those against a fall."""
    mujoco.mj_rnePostConstraint(model, data)
    found, k = np.zeros(6), model.body(body).id
    mujoco.mj_objectAcceleration(model, data, mujoco.mjtObj.mjOBJ_XBODY, k, found, 0)
    return data.xpos[k], data.xmat[k].reshape(3, 3), np.concatenate([found[3:] + model.opt.gravity, found[:3]])


def agrees(arm: fa.Arm, model: Any, bodies: tuple[str, ...], near_to: float = 1e-12) -> None:
    """Mass matrix, bias, both dynamics (driven by motors, if all rates have one), and places and accelerations of
    bodies that carry no other, at random states, to a part of the largest number."""
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    model.opt.gravity[:] = arm.gravity
    data, rng = mujoco.MjData(model), np.random.default_rng(5)
    assert (arm.nq, arm.nv) == (model.nq, model.nv)

    def near(found: np.ndarray, wanted: np.ndarray) -> None:
        np.testing.assert_allclose(found, wanted, rtol=0, atol=near_to * max(np.abs(wanted).max(), 1.0))

    for _ in range(3):
        q, v, tau = rng.uniform(-1, 1, arm.nq), rng.normal(size=arm.nv), rng.normal(size=arm.nv)
        for _, at in arm.quaternions():
            q[at] = Rotation.from_rotvec(rng.uniform(-1.5, 1.5, 3)).as_quat(scalar_first=True)
        data.qpos[:], T = in_mujoco(arm, model, q)
        data.qvel[:] = T @ v
        if model.nu == model.nv:
            data.ctrl[:] = tau
        else:
            data.qfrc_applied[:] = T @ tau  # T is orthogonal
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


# -- written ----------------------------------------------------------------------------------------------------------


def odd(stiff: bool = False, **options: Any) -> fa.Arm:
    """Free joints and balls with frames on both sides, on the world and elsewhere, with springs and dampers; a beam on
    a floating base."""
    hub = fa.RigidBody(0.3, (0.1, 0.02, 0.02), (2e-3, 3e-3, 4e-3), (0.2, 0, 0.05))
    end = fa.RigidBody(0.2, (0.02, 0.05, 0), (2e-3, 3e-3, 4e-3))
    side, turned = fa.Placement((0.02, 0.05, -0.03), (0.2, -0.4, 0.6)), fa.Placement(rotation=(0.3, 0.1, -0.5))
    both = {"inboard": side, "outboard": fa.Placement((0.01, 0.0, 0.02), (0.1, 0.3, 0.0))}
    alloy = fa.Material(density=2700.0, youngs_modulus=70e9, poisson_ratio=0.33)
    boom = fa.Beam(0.4, fa.Rectangle(0.02, 0.03), alloy, {"bending_y": 2}, "legendre")
    return fa.Arm(
        [
            fa.Link(fa.Free(name="base", inboard=side, outboard=turned), hub, None if stiff else boom, name="ship"),
            fa.Link(fa.Spherical(name="wrist", damping=0.3, stiffness=2.0, reflected_inertia=0.05, **both, **options),
                    end, name="hand"),
            fa.Link(fa.Free(name="drift", stiffness=3.0, damping=0.1, **both), end, name="tug", parent="ship"),
            fa.Link(fa.Free(name="kite", damping=(1, 1, 1, 0.2, 0.2, 0.2), reflected_inertia=0.1, inboard=side), end,
                    name="sail", parent="world"),
            fa.Link(fa.Free(name="buoy", stiffness=5.0, damping=0.3, inboard=side, outboard=turned), hub, name="cork",
                    parent="world"),
            fa.Link(fa.Planar(name="glide", damping=0.4, coulomb=0.1, inboard=side), end, name="skate"),
        ],
        (0.5, 0.0, -9.81),
    )  # fmt: skip


def test_a_quadruped_is_written(tmp_path: Path) -> None:
    """With a motor for each freedom; and it comes back."""
    arm = read(tmp_path, QUADRUPED)
    text = arm.to_mjcf()
    model = mujoco.MjModel.from_xml_string(text)
    bodies = ("shin_fl", "hip_fr", "shin_bl", "hip_br", "tail", "crate", "lamp")
    assert model.nu == arm.nv and model.actuator(4).name == "root wy"
    agrees(arm, model, bodies, 1e-10)  # links without mass have 1e-12 kg there
    back = read(tmp_path, text)
    assert back.names == arm.names and [x.joint.type for x in back] == [x.joint.type for x in arm]
    np.testing.assert_allclose(back.mass_matrix(back.zero), arm.mass_matrix(arm.zero), rtol=0, atol=1e-10)


@pytest.mark.parametrize("stiff", [True, False])
def test_free_joints_and_balls_with_frames_on_both_sides(stiff: bool) -> None:
    """A free joint that MJCF does not have, on another body or with different dampers, is three slides and a ball. A
    beam's segments are light and stiff, so that accelerations lose digits."""
    arm, cut = odd(stiff), segmented(odd(stiff), 3).arm
    model = mujoco.MjModel.from_xml_string(arm.to_mjcf(segments=3))
    kinds = {model.joint(k).name: int(model.joint(k).type[0]) for k in range(model.njnt)}
    assert [name for name, kind in kinds.items() if kind == 0] == ["base", "buoy"]
    assert [name for name, kind in kinds.items() if kind == 1] == ["wrist", "drift turn", "kite turn"]
    assert [model.actuator(k).name for k in range(model.nu)][6:12] == [
        "wrist wx", "wrist wy", "wrist wz", "drift x", "drift y", "drift z",
    ]  # fmt: skip
    model.dof_frictionloss[:] = 0.0
    agrees(fa.Arm(cut.links, arm.gravity), model, ("hand", "tug", "sail", "skate"), 1e-12 if stiff else 1e-10)


def test_the_stop_of_a_ball_is_written(tmp_path: Path) -> None:
    arm = fa.Arm([*odd(stiff=True, upper=0.7, limit_stiffness=50.0)][:2])
    back = read(tmp_path, arm.to_mjcf(), stops=20.0)
    assert (back["wrist"].joint.upper, back["wrist"].joint.limit_stiffness) == (0.7, 20.0)


def test_floating_and_planar_joints_come_back_from_urdf(tmp_path: Path) -> None:
    arm = read(tmp_path, URDF)
    back = read(tmp_path, arm.to_urdf(), tip=[f"{name} tip" for name in ("gimbal", "rotor", "handle", "slab")])
    joints = [x.joint for x in back if x.joint.nv]
    assert [(x.name, x.type, x.damping) for x in joints] == [(x.joint.name, x.joint.type, 0.3) for x in arm]
    q, v = np.linspace(-0.7, 0.9, arm.nq), np.linspace(1, -0.5, arm.nv)
    np.testing.assert_allclose(back.mass_matrix(q), arm.mass_matrix(q), rtol=0, atol=1e-11)
    np.testing.assert_allclose(back.bias(q, v), arm.bias(q, v), rtol=0, atol=1e-10)
    for name in ("rotor", "handle", "slab"):
        np.testing.assert_allclose(back.frame(q, f"{name} tip")[1], arm.frame(q, name)[1], rtol=0, atol=1e-14)


def test_what_is_not_written() -> None:
    def one(joint: fa.Joint) -> fa.Arm:
        return fa.Arm([fa.Link(joint, fa.RigidBody(1.0, inertia=(1, 1, 1)), name="wrist")])

    with refuses("knuckle", "joint 'spherical'", "URDF", "no balls", "Axes"):
        one(fa.Spherical(name="knuckle")).to_urdf()
    with refuses("wrist joint", "damping = [1.0, 1.0, 2.0]", "same about all axes"):
        one(fa.Spherical(damping=(1, 1, 2))).to_mjcf()
    stops = {"lower": (-5, -5, -5, -1, -1, -1), "upper": (5, 5, 5, 1, 1, 1), "limit_stiffness": 9.0}
    for values, bad in (({"stiffness": 1.0}, "stiffness = [1.0, 1.0,"), (stops, "lower = [-5.0, -5.0,"),
                        ({"damping": (1, 1, 1, 2, 2, 2)}, "damping = [1.0, 1.0, 1.0, 2.0,")):  # fmt: skip
        with refuses("wrist joint", bad, "floating joint of URDF", "one damping"):
            one(fa.Free(**values)).to_urdf()
    ranges = re.findall(r'type="(\w+)".* range="(.*?)"', one(fa.Free(**stops)).to_mjcf())
    assert ranges == [*3 * [("slide", "-5.0 5.0")], ("ball", "0.0 1.0")]
    slides = ["prismatic", "prismatic"]
    for values, kinds in (
        ({"damping": 1.0, "coulomb": 2.0}, ["planar"]),
        ({"damping": (1, 1, 2)}, [*slides, "continuous"]),
        ({"lower": 0.0, "limit_stiffness": 1.0}, [*slides, "revolute"]),
    ):
        text = one(fa.Planar(**values)).to_urdf()
        assert re.findall(r'type="(\w+)"', text) == [*kinds, "fixed"]
    assert 'type="floating"' in one(fa.Free(reflected_inertia=(1, 1, 1, 2, 2, 2))).to_urdf()
