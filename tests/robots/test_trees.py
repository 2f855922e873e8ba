"""Robots that branch, as trees: MuJoCo reads the same file and has the same numbers; what is written comes back."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from flexarm.robots.segments import segmented
from messages import refuses

mujoco = pytest.importorskip("mujoco")
pytestmark = pytest.mark.filterwarnings("ignore::flexarm.errors.RobotWarning")
ALLOY = fa.Material(density=2700.0, youngs_modulus=70e9, poisson_ratio=0.33)

#: link, parent, kind of its joint, place, roll pitch yaw, axis; each link weighs 1 kg, its centre of mass ahead
ROWS = (
    ("column", "base", "fixed", "0 0 0.4", "0 0 0.2", "1 0 0"),
    ("torso", "column", "revolute", "0 0.02 0.1", "0.1 0 0", "0 0 1"),
    ("chest", "torso", "fixed", "0 0 0.3", "0 0.3 0", "1 0 0"),
    ("left_upper", "chest", "continuous", "0 0.2 0.1", "0 0 0.3", "0 1 0.2"),
    ("left_fore", "left_upper", "revolute", "0.3 0 0", "0.4 0 0", "0 0 1"),
    ("left_palm", "left_fore", "fixed", "0.25 0 0", "0 0.2 0", "1 0 0"),
    ("left_thumb", "left_palm", "prismatic", "0.05 0.02 0", "0 0 0", "0 1 0"),
    ("left_finger", "left_palm", "revolute", "0.05 -0.02 0.01", "0 0.5 0", "0 1 1"),
    ("right_upper", "chest", "continuous", "0 -0.2 0.1", "0 0 -0.3", "0 1 -0.2"),
    ("right_fore", "right_upper", "revolute", "0.3 0 0", "-0.4 0 0", "0 0 1"),
    ("head", "torso", "revolute", "0.02 0 0.5", "0 0.1 0", "0 0 1"),
    ("cart", "base", "prismatic", "1 0 0", "0 0 0.7", "1 0 0"),
    ("mast", "cart", "revolute", "0 0 0.2", "0 0 0", "0 1 0"),
)
BODY = (
    '<inertial><origin xyz="0.1 0.01 -0.02"/><mass value="1"/>'
    '<inertia ixx="0.004" ixy="0.0005" ixz="-0.0002" iyy="0.01" iyz="0" izz="0.011"/></inertial>'
)
ROBOT = (
    '<robot name="two arms"><mujoco><compiler fusestatic="false"/></mujoco><link name="base"/>'
    + "".join(
        f'<link name="{name}">{BODY}</link><joint name="to {name}" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{name}"/><origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/><dynamics damping="0.3"/>'
        '<limit lower="-2" upper="2" effort="1" velocity="1"/></joint>'
        for name, parent, kind, xyz, rpy, axis in ROWS
    )
    + "</robot>"
)
MOVING = [name for name, _, kind, *_ in ROWS if kind != "fixed"]

#: A torso with a head, two arms and two legs: anchors beside bodies, joints of two freedoms, springs, armature.
HUMANOID = """<mujoco><compiler angle="radian"/><option gravity="0.3 0 -9.7"/>
<default><joint damping="0.2" armature="0.01"/><geom density="800"/></default>
<worldbody><body name="pelvis" pos="0 0 1"><joint name="lift" type="slide" axis="0 0 1"/>
  <geom type="box" size="0.1 0.15 0.05"/>
  <body name="chest" pos="0 0 0.2" euler="0 0.1 0"><joint name="waist" axis="0 0 1" pos="0 0 -0.1" stiffness="5"/>
    <geom type="capsule" fromto="0 -0.15 0.1 0 0.15 0.1" size="0.08"/>
    <body name="skull" pos="0 0 0.3"><geom type="sphere" size="0.1"/></body>
    <body name="left_arm" pos="0 0.2 0.1"><joint name="left_swing" axis="0 1 0"/>
      <joint name="left_raise" axis="1 0 0" pos="0 0.02 0" stiffness="3" springref="0.4"/>
      <geom type="capsule" fromto="0 0 0 0 0.05 -0.3" size="0.03"/>
      <body name="left_hand" pos="0 0.05 -0.3" euler="0.3 0 0"><joint name="left_elbow" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.03"/></body></body>
    <body name="right_arm" pos="0 -0.2 0.1"><joint name="right_swing" axis="0 1 0.1"/>
      <geom type="capsule" fromto="0 0 0 0 -0.05 -0.3" size="0.03"/></body></body>
  <body name="left_leg" pos="0 0.1 -0.05"><joint name="left_hip" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.05"/>
    <body name="left_foot" pos="0 0 -0.4"><joint name="left_knee" axis="0 1 0"/>
      <geom type="box" size="0.1 0.05 0.03"/></body></body>
  <body name="right_leg" pos="0 -0.1 -0.05"><joint name="right_hip" axis="0 1 0.2"/>
    <geom type="capsule" fromto="0 0 0 0.1 0 -0.4" size="0.05"/></body></body>
  <body name="door" pos="1 0 0"><joint name="latch" axis="0 0 1"/><geom type="box" size="0.2 0.01 0.4"/></body>
</worldbody></mujoco>"""


def read(folder: Path, text: str, **options: Any) -> fa.Arm:
    path = folder / ("robot.urdf" if "<robot" in text else "robot.xml")
    path.write_text(text)
    return (fa.from_urdf if "<robot" in text else fa.from_mjcf)(path, **options)


def parents(arm: fa.Arm) -> dict[str, str]:
    return {name: arm.names[n] if n >= 0 else "world" for name, n in zip(arm.names, arm.parents, strict=True)}


def agrees(arm: fa.Arm, model: Any, frames: dict[str, str], order: list[int] | None = None) -> None:
    """M, inverse and forward dynamics, and the frames of links (by MuJoCo's bodies), at random states, 1e-12; `order`:
    MuJoCo's number of each rate, by default by the names of joints."""
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    model.opt.gravity[:] = arm.gravity
    data, rng = mujoco.MjData(model), np.random.default_rng(3)
    order = order or [model.joint(link.joint.name).dofadr[0] for link in arm if link.joint.nv]
    assert sorted(order) == list(range(model.nv)) and arm.nv == model.nv

    def near(found: np.ndarray, wanted: np.ndarray) -> None:
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())

    for _ in range(3):
        q, v, tau = rng.uniform(-1.5, 1.5, arm.nv), rng.normal(size=arm.nv), rng.normal(size=arm.nv)
        data.qpos[order], data.qvel[order], data.qfrc_applied[order] = q, v, tau
        mujoco.mj_forward(model, data)
        M = np.array([mujoco.mj_mulM(model, data, row := np.zeros(arm.nv), unit) or row for unit in np.eye(arm.nv)])
        near(arm.mass_matrix(q), M[np.ix_(order, order)])
        near(arm.bias(q, v), (data.qfrc_bias - data.qfrc_passive)[order])
        near(arm.forward_dynamics(q, v, tau), data.qacc[order])
        data.qacc[order] = a = rng.normal(size=arm.nv)
        mujoco.mj_inverse(model, data)
        near(arm.inverse_dynamics(q, v, a), data.qfrc_inverse[order])
        for link, body in frames.items():
            p, R = arm.frame(q, link)
            near(p, data.body(body).xpos)
            near(R, data.body(body).xmat.reshape(3, 3))


def test_a_urdf_that_branches(tmp_path: Path) -> None:
    arm = read(tmp_path, ROBOT)
    assert list(arm.names) == MOVING and not arm.is_chain
    assert parents(arm) == {
        "torso": "world", "left_upper": "torso", "left_fore": "left_upper", "left_thumb": "left_fore",
        "left_finger": "left_fore", "right_upper": "torso", "right_fore": "right_upper", "head": "torso",
        "cart": "world", "mast": "cart",
    }  # fmt: skip
    assert [link.parent for link in arm] == [None, None, None, None, "left_fore", "torso", None, "torso", "world", None]
    agrees(arm, mujoco.MjModel.from_xml_string(ROBOT), {x: x for x in ("left_finger", "head", "right_fore", "mast")})


def test_an_mjcf_that_branches(tmp_path: Path) -> None:
    arm = read(tmp_path, HUMANOID)
    model = mujoco.MjModel.from_xml_string(HUMANOID)
    assert [link.joint.name for link in arm] == [model.joint(k).name for k in range(model.njnt)]
    assert arm.children("chest") == [arm.names.index(x) for x in ("left_arm on left_swing", "right_arm")]
    assert [arm.names[k] for k in arm.ends] == ["left_hand", "right_arm", "left_foot", "right_leg", "door"]
    assert arm.parents[-1] == -1 and arm["waist"].joint.stiffness == 5 and arm["latch"].joint.reflected_inertia == 0.01
    agrees(arm, model, {x: x for x in ("left_hand", "right_leg", "left_foot")})


def test_several_tips(tmp_path: Path) -> None:
    """The ways to them; a tip that is fixed to a link that carries others is a link of its own."""
    arm = read(tmp_path, ROBOT, tip=["left_palm", "left_finger", "right_upper", "chest"])
    assert parents(arm) == {
        "torso": "world", "chest": "torso", "left_upper": "torso", "left_fore": "left_upper", "left_palm": "left_fore",
        "left_finger": "left_fore", "right_upper": "torso",
    }  # fmt: skip
    whole = read(tmp_path, ROBOT)
    q = dict(zip(whole.names, np.linspace(-1, 1, whole.nv), strict=True))
    held = {"left_thumb": 0.0, "head": 0.0, "right_fore": 0.0, "cart": 0.0, "mast": 0.0}
    mine = [k for k, name in enumerate(whole.names) if name not in held]
    every, few = whole.pose(q | held), arm.pose({name: q[name] for name in q if name not in held})
    assert mine == [0, 1, 2, 4, 5]
    M = whole.mass_matrix(every)[np.ix_(mine, mine)]
    np.testing.assert_allclose(arm.mass_matrix(few), M, rtol=0, atol=1e-13 * M.max())
    for link in ("left_finger", "right_upper"):
        np.testing.assert_allclose(arm.frame(few, link)[1], whole.frame(every, link)[1], atol=1e-13)
    chain = read(tmp_path, ROBOT, tip="left_palm")
    assert chain.is_chain and chain == read(tmp_path, ROBOT, tip=["left_palm"])
    three = chain.pose({name: q[name] for name in ("torso", "left_upper", "left_fore")})
    np.testing.assert_allclose(arm.frame(few, "left_palm")[0], chain.frame(three)[0], atol=1e-13)


def test_names_of_parents_are_links_alone(tmp_path: Path) -> None:
    """Where a joint has the name of another link, the parent is told by number."""
    text = ROBOT.replace('"to cart"', '"left_fore"').replace('"to mast"', '"torso"')
    arm = read(tmp_path, text)
    assert arm.parents == read(tmp_path, ROBOT).parents and arm.links[4].parent == 2 and arm.links[5].parent == 0


# -- beams ------------------------------------------------------------------------------------------------------------


def beam(length: float) -> fa.Beam:
    return fa.Beam(length, fa.Rectangle(0.02, 0.05), ALLOY, modes={"bending_y": 2, "torsion": 1}, basis="legendre")


def test_a_beam_that_carries_two(tmp_path: Path) -> None:
    """Thumb and finger sit on the palm, which is fixed to the beam's end; where nothing bends, they stand where they
    do in the rigid tree, and when it bends they ride with its end."""
    rigid = read(tmp_path, ROBOT)
    flexible = {"left_fore": fa.Flexible(beam(0.25), end="left_palm"), "right_upper": beam(0.3)}
    arm = read(tmp_path, ROBOT, flexible=flexible)
    assert parents(arm) == parents(rigid) and arm.nv == rigid.nv + 6
    joints = np.linspace(-1, 1, rigid.nv)
    q = arm.pose(dict(zip(rigid.names, joints, strict=True)))
    for link in ("left_thumb", "left_finger", "right_fore", "mast"):
        for ours, theirs in zip(arm.frame(q, link), rigid.frame(joints, link), strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-13)
    bent = q.copy()
    bent[[i for i, name in enumerate(arm.coordinates) if name.startswith("left_fore ")]] = 0.05, 0.02, 0.1
    ends = [arm.frame(x, "left_fore") for x in (q, bent)]
    assert np.linalg.norm(ends[0][0] - ends[1][0]) > 1e-3
    for link in ("left_thumb", "left_finger"):
        seen = [R.T @ (arm.frame(x, link)[0] - p) for x, (p, R) in zip((q, bent), ends, strict=True)]
        np.testing.assert_allclose(seen[0], seen[1], rtol=0, atol=1e-14)


def test_a_beam_in_a_tree_has_its_rods_inertia(tmp_path: Path) -> None:
    """Where nothing bends, the tree is the rigid one with a cuboid for the link; the palm rides on the beam's end."""
    bar = fa.Beam(0.25, fa.Rectangle(0.02, 0.05), ALLOY, modes={"bending_y": 2, "bending_z": 1}, basis="legendre")
    arm = read(tmp_path, ROBOT, flexible={"left_fore": fa.Flexible(bar, end="left_palm")})
    m, xx, yy, zz = 0.675, 0.02**2 + 0.05**2, 0.25**2 + 0.05**2, 0.25**2 + 0.02**2
    cuboid = f'ixx="{m * xx / 12}" iyy="{m * yy / 12}" izz="{m * zz / 12}" ixy="0" ixz="0" iyz="0"'
    body = f'<inertial><origin xyz="0.125 0 0"/><mass value="{m}"/><inertia {cuboid}/></inertial>'
    model = mujoco.MjModel.from_xml_string(ROBOT.replace(f'"left_fore">{BODY}', f'"left_fore">{body}'))
    agrees(fa.Arm([x if x.beam is None else replace(x, beam=replace(bar, modes={})) for x in arm], arm.gravity), model,
           {"left_finger": "left_finger"})  # fmt: skip
    assert arm["left_fore"].tip.mass == 1.0 and arm["left_fore"].hub is None


def test_a_beam_with_a_joint_along_it(tmp_path: Path) -> None:
    """The head sits half a metre up the torso; the arms on the chest, which is fixed at 0.3 m."""
    text = re.sub(r'(<link name="torso">)<inertial>.*?</inertial>', r"\1", ROBOT)
    with refuses("flexible['torso']", "joint 'to left_upper'", "0.395"):
        read(tmp_path, text, flexible={"torso": fa.Flexible(beam(0.8), end=(0, 0, 0.8))})
    with refuses("flexible['torso']", "joint 'to head'", "0.5 m", "0.8 m"):
        read(tmp_path, text, flexible={"torso": fa.Flexible(beam(0.8), end=(0, 0, 0.8))}, tip=["head", "mast"])
    with refuses("flexible['torso']", "tip 'chest'", "0.3 m"):
        read(tmp_path, text, flexible={"torso": fa.Flexible(beam(0.8), end=(0, 0, 0.8))}, tip="chest")
    with refuses("flexible['left_fore']", "beam.length = 0.27", "0.299836063 m"):
        read(tmp_path, text, flexible={"left_fore": beam(0.27)})
    short = read(tmp_path, text, flexible={"torso": fa.Flexible(beam(0.3), end="chest")})  # all of it beyond the end
    assert short.children("torso") == [short.names.index(x) for x in ("left_upper", "right_upper", "head")]


# -- what is refused --------------------------------------------------------------------------------------------------


def test_what_stays_refused(tmp_path: Path) -> None:
    mimic = '<mimic joint="to head"/><origin xyz="0.05 0.02 0"'
    with refuses("robot.urdf", "'to left_thumb'", "mimic of 'to head'", "tip = ['left_finger', 'right_fore'"):
        read(tmp_path, ROBOT.replace('<origin xyz="0.05 0.02 0"', mimic))
    loop = '<joint name="shut" type="fixed"><parent link="left_fore"/><child link="right_fore"/></joint></robot>'
    with refuses("robot.urdf", "'right_fore'", "'to right_fore'", "'shut'"):
        read(tmp_path, ROBOT.replace("</robot>", loop))
    with refuses("tip =", "'left_fore'"):
        read(tmp_path, ROBOT, tip=["head", "left_for"])


# -- written ----------------------------------------------------------------------------------------------------------


def across() -> fa.Arm:
    """Beams on beams, branches on the world; links that stand in another order than branch after branch, unnamed ones,
    joints with placements on both sides."""
    side = fa.Placement((0.02, 0.05, -0.03), (0.2, -0.4, 0.6))
    both = {"inboard": side, "outboard": fa.Placement((0.01, 0.0, 0.02), (0.1, 0.3, 0.0)), "damping": 0.1}
    hub, tip = fa.RigidBody(0.3, (0.1, 0, 0.02), (2e-3, 3e-3, 4e-3), (0.2, 0, 0.05)), fa.RigidBody(0.2, (0.02, 0, 0))
    return fa.Arm(
        [
            fa.Link(fa.Revolute("z", name="yaw", reflected_inertia=0.02), hub, beam(0.4), tip, "torso"),
            fa.Link(fa.Revolute("y", **both), hub, beam(0.3), name="left"),
            fa.Link(fa.Universal(**both), hub, name="right", parent="torso", at=0.25),
            fa.Link(fa.Revolute("x", stiffness=4.0, rest=0.1), hub, parent="left"),
            fa.Link(fa.Prismatic("x", **both), hub, name="claw", parent="right"),
            fa.Link(fa.Fixed(inboard=side), None, beam(0.2), hub, "mast", parent="world"),
            fa.Link(fa.Revolute("y", **both), hub, name="flag", parent=5),
        ],
        (0.5, 0.0, -9.81),
    )


def stiff() -> fa.Arm:
    return fa.Arm([fa.Link(x.joint, x.hub, None, x.tip, x.name, parent=x.parent) for x in across()], across().gravity)


def names_of_freedoms(cut: Any) -> list[str]:
    """As files call them: by the joint, and, of several, by the kind of motion."""
    links = zip(cut.names, (link.joint for link in cut.arm), strict=True)
    return [(j.name or f"{name} joint") + x.removeprefix(j.type) for name, j in links for x in j.labels]


@pytest.mark.parametrize("make", [across, stiff])
@pytest.mark.parametrize("file", ["arm.xml", "arm.urdf"])
def test_a_tree_comes_back(make: Any, file: str, tmp_path: Path) -> None:
    """Its segments, branch after branch: mass matrix, bias, and the ends of the branches."""
    arm, cut = make(), segmented(make(), 3)
    (arm.to_mjcf if file == "arm.xml" else arm.to_urdf)(tmp_path / file, segments=3)
    ends = ["link 3 tip", "claw tip", "flag tip"]
    if file == "arm.xml":
        back = fa.from_mjcf(tmp_path / file)
    else:
        back = fa.from_urdf(tmp_path / file, tip=ends, gravity=arm.gravity, reflected_inertia={"yaw": 0.02})
    names = names_of_freedoms(cut)
    order = [names.index(name) for name in back.coordinates]
    assert sorted(order) == list(range(cut.arm.nv)) and order != sorted(order)
    q, v = np.linspace(-0.8, 1.1, back.nv), np.linspace(1, -0.5, back.nv)
    h, M = fa.Arm(cut.arm.links, arm.gravity).bias(q, v), cut.arm.mass_matrix(q)
    if file == "arm.urdf":  # it has no springs
        joints = [link.joint for link in cut.arm]
        k, rest = (np.concatenate([np.resize(getattr(j, f), j.nv) for j in joints]) for f in ("stiffness", "rest"))
        h = h - k * (q - rest)
    np.testing.assert_allclose(back.mass_matrix(q[order]), M[np.ix_(order, order)], rtol=0, atol=1e-10 * M.max())
    np.testing.assert_allclose(back.bias(q[order], v[order]), h[order], rtol=0, atol=1e-10 * np.abs(h).max())
    places = [cut.arm.frame(q, k)[0] for k in cut.ends]
    if file == "arm.urdf":
        found = [back.frame(q[order], end)[0] for end in ends]
    else:
        model = mujoco.MjModel.from_xml_path(str(tmp_path / file))
        data = mujoco.MjData(model)
        data.qpos[:] = q[order]
        mujoco.mj_kinematics(model, data)
        found = [data.site(end).xpos for end in ends]
        assert [model.joint(k).name for k in range(model.njnt)] == list(back.coordinates)
    np.testing.assert_allclose(found, places, rtol=0, atol=1e-12)


def test_a_written_tree_moves_as_the_segments_do_in_mujoco() -> None:
    arm = across()
    model = mujoco.MjModel.from_xml_string(arm.to_mjcf(segments=3))
    cut = segmented(arm, 3)
    back = {model.joint(k).name: model.joint(k).dofadr[0] for k in range(model.njnt)}
    agrees(fa.Arm(cut.arm.links, arm.gravity), model, {}, [back[name] for name in names_of_freedoms(cut)])


def test_the_segments_of_a_tree_have_its_frequencies() -> None:
    arm = across()
    cut = segmented(arm, 10)
    joints = [k for k, link in enumerate(arm) if link.joint.nv]
    wanted = fa.Arm(arm.links).modes(lock=joints).frequencies[:3]
    held = [k for k, link in enumerate(cut.arm.links) if link.joint.nv and k not in cut.hinges]
    found = fa.Arm(cut.arm.links).modes(lock=held).frequencies[:3]
    np.testing.assert_allclose(found, wanted, rtol=1e-3)
    on_torso = [cut.names[n] for n in cut.arm.parents if n >= 0 and cut.of[n] == 0]
    assert on_torso[-2:] == ["torso segment 10", "torso segment 6"]
