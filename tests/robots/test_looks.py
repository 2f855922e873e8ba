"""What robots' files show: meshes and solids with their links, where the file puts them; what is missing is said."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from messages import refuses, warns
from scipy.spatial.transform import Rotation

URDF = """<robot name="arm">
  <material name="blue"><color rgba="0 0 1 1"/></material>
  <link name="base"><visual><origin xyz="0 0 0.05"/><geometry><box size="0.3 0.2 0.1"/></geometry></visual></link>
  <link name="upper"><inertial><mass value="1"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>
    <visual><origin xyz="0.1 0 0" rpy="0 1.5707963267948966 0"/>
      <geometry><cylinder radius="0.03" length="0.4"/></geometry><material name="blue"/></visual>
    <collision><geometry><box size="1 1 1"/></geometry></collision></link>
  <link name="fore"><inertial><origin xyz="0.2 0 0"/><mass value="0.5"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>
    <visual><origin xyz="0.01 0.02 0.03" rpy="0.3 0 0"/>
      <geometry><mesh filename="MESH" scale="0.001 0.001 0.002"/></geometry></visual></link>
  <link name="hand"><visual><geometry><sphere radius="0.05"/></geometry></visual></link>
  <joint name="a" type="continuous"><origin xyz="0 0 0.1"/><axis xyz="0 0 1"/>
    <parent link="base"/><child link="upper"/></joint>
  <joint name="b" type="continuous"><origin xyz="0.4 0 0" rpy="0 0 0.5"/><axis xyz="0 1 0"/>
    <parent link="upper"/><child link="fore"/></joint>
  <joint name="c" type="fixed"><origin xyz="0.5 0 0" rpy="0 0 0.2"/><parent link="fore"/><child link="hand"/></joint>
</robot>"""
#: a tetrahedron, in millimetres
CORNERS = np.array([[0, 0, 0], [300, 0, 0], [0, 40, 0], [0, 0, 60.0]])
OBJ = "".join(f"v {x} {y} {z}\n" for x, y, z in CORNERS) + "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def robot(tmp_path: Path, mesh: str = "package://my_robot/meshes/fore.obj", **options: Any) -> tuple[fa.Arm, str]:
    """The arm and what was said."""
    folder = tmp_path / "my_robot"
    (folder / "meshes").mkdir(parents=True, exist_ok=True)
    (folder / "urdf").mkdir(exist_ok=True)
    (folder / "meshes" / "fore.obj").write_text(OBJ)
    file = folder / "urdf" / "arm.urdf"
    file.write_text(URDF.replace("MESH", mesh))
    with pytest.warns(fa.errors.RobotWarning) as said:
        arm = fa.from_urdf(file, **options)
    return arm, str(said[0].message)


def bare(arm: fa.Arm) -> fa.Arm:
    return fa.Arm([fa.Link(k.joint, k.hub, k.beam, k.tip, k.name) for k in arm.links], arm.gravity)


def test_looks_are_carried_with_their_links(tmp_path: Path) -> None:
    arm, said = robot(tmp_path, tip="fore")
    upper, fore = arm["upper"].looks, arm["fore"].looks
    assert [(x.shape, x.on, x.size, x.colour) for x in upper] == [
        ("box", "base", (0.3, 0.2, 0.1), None), ("cylinder", "hub", (0.03, 0.4), "#0000FF")
    ]  # fmt: skip
    assert [(x.shape, x.size) for x in fore] == [("mesh", (0.001, 0.001, 0.002)), ("ball", (0.05,))]
    assert fore[0].file == str((tmp_path / "my_robot/meshes/fore.obj").resolve())
    assert "<visual>" not in said and "shapes to touch (<collision>): upper" in said
    again = fa.Arm.from_dict(arm.to_dict())
    assert again == arm and hash(again["fore"].looks) == hash(fore) and again != bare(arm)


def test_looks_change_no_motion(tmp_path: Path) -> None:
    arm, _ = robot(tmp_path)
    q, v = np.array([0.3, -0.4]), np.array([1.0, 2.0])
    other = bare(arm)
    assert arm["fore"].looks and not other["fore"].looks and arm.nv == other.nv
    assert np.array_equal(arm.forward_dynamics(q, v, v), other.forward_dynamics(q, v, v))


def test_a_mesh_is_drawn_where_the_file_puts_it(tmp_path: Path) -> None:
    pytest.importorskip("trimesh")
    arm, _ = robot(tmp_path, tip="fore")
    q = np.array([0.7, -0.4])
    view = arm.show(q, open=False)
    (mesh,) = view.tracks[0].body.meshes
    p, R, *_ = view.tracks[0].at(0.0)
    drawn = mesh.vertices @ R[mesh.node].T + p[mesh.node]
    turned = Rotation.from_euler("x", 0.3).as_matrix()
    in_fore = (CORNERS * [1e-3, 1e-3, 2e-3]) @ turned.T + [0.01, 0.02, 0.03]
    upper = Rotation.from_euler("z", 0.7).as_matrix()
    fore = upper @ Rotation.from_euler("z", 0.5).as_matrix() @ Rotation.from_euler("y", -0.4).as_matrix()
    wanted = in_fore @ fore.T + upper @ [0.4, 0, 0] + [0, 0, 0.1]
    apart = np.linalg.norm(drawn[:, None] - wanted, axis=2)
    assert apart.shape == (4, 4) and apart.min(axis=0).max() < 1e-6 and len(mesh.faces) == 4


def test_a_beam_is_drawn_for_its_link_and_what_is_fixed_to_it_moves_with_its_end(tmp_path: Path) -> None:
    alloy = fa.Material(density=2700.0, youngs_modulus=70e9, poisson_ratio=0.33)
    beam = fa.Beam(0.5, fa.Tube(0.01, 0.001), alloy, {"bending_y": 2})
    arm, said = robot(tmp_path, tip="hand", flexible={"fore": beam})
    (ball,) = arm["fore"].looks
    assert (ball.shape, ball.on) == ("ball", "tip") and "the look of 'fore': its beam is drawn" in said
    q = np.array([0.2, 0.1, 0.05, 0.0])
    track = arm.show(q, open=False).tracks[0]
    p, R, *_ = track.at(0.0)
    (solid,) = (s for s in track.body.solids if s["part"] == "look" and s["kind"] == "ball")
    assert np.allclose(R[solid["node"]] @ solid["at"] + p[solid["node"]], arm.frame(q)[0], atol=1e-9)
    stays, _ = robot(tmp_path, tip="hand", flexible={"fore": fa.Flexible(beam, mass="add")})
    assert [x.shape for x in stays["fore"].looks] == ["mesh", "ball"]


def test_a_missing_mesh_is_named_and_the_arm_is_made(tmp_path: Path) -> None:
    arm, said = robot(tmp_path, "package://my_robot/meshes/other.stl")
    assert "the mesh package://my_robot/meshes/other.stl: there is no such file: fore" in said
    assert [x.shape for x in arm["fore"].looks] == ["ball"] and arm.show(open=False).figure() is not None


def test_a_mesh_that_cannot_be_read_is_named_and_the_arm_is_shown(tmp_path: Path) -> None:
    pytest.importorskip("trimesh")
    arm, _ = robot(tmp_path)
    file = Path(arm["fore"].looks[0].file)
    file.write_text("this is no mesh")
    with warns(UserWarning, "fore.obj"):
        assert not arm.show(open=False).tracks[0].body.meshes
    file.unlink()
    with warns(UserWarning, "fore.obj", "No such file"):
        view = arm.show(open=False)
    assert view.image().std() > 5


def test_files_of_packages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    here, ros, ament = (tmp_path / x for x in ("here", "ros/src", "ament/share"))
    for place in (here / "my_robot", ros / "robot_a", ament / "robot_b"):
        place.mkdir(parents=True)
    a, b, c = ros / "robot_a" / "a b.stl", ament / "robot_b" / "b.stl", here / "my_robot" / "c.stl"
    for file in (a, b, c):
        file.write_text("")

    def found(name: str) -> str | None:
        return robot(here, name)[0]["fore"].looks[0].file

    with_none, said = robot(here, "package://robot_a/a%20b.stl")
    assert "no such file: fore" in said and [x.shape for x in with_none["fore"].looks] == ["ball"]
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(ros))
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "ament"))
    assert found("package://robot_a/a%20b.stl") == str(a.resolve())
    assert found("package://robot_b/b.stl") == str(b.resolve())
    assert found("../c.stl") == found(f"file://{c}") == str(c.resolve())
    assert found("package://my_robot/c.stl") == str(c.resolve())


def test_geoms_of_mjcf_stand_where_mujoco_has_them(tmp_path: Path) -> None:
    """MuJoCo turns meshes into the axes of their inertia; its own corners are the judge."""
    mujoco = pytest.importorskip("mujoco")
    pytest.importorskip("trimesh")
    (tmp_path / "assets").mkdir()
    (tmp_path / "assets" / "tetra.obj").write_text(OBJ)
    file = tmp_path / "arm.xml"
    file.write_text("""<mujoco><compiler meshdir="assets"/>
      <asset><mesh name="tetra" file="tetra.obj" scale="0.001 0.002 0.001"/></asset>
      <worldbody><geom type="box" size="0.1 0.2 0.05" pos="0 0 -0.1"/>
        <body name="one" pos="0 0 0.3"><joint name="j" axis="0 1 0"/>
          <geom type="mesh" mesh="tetra" pos="0.1 0 0" euler="20 30 40" rgba="1 0 0 1"/>
          <geom type="capsule" size="0.02 0.1" pos="0 0 0.1"/>
          <geom type="sphere" size="0.3" group="3"/></body></worldbody></mujoco>""")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.errors.RobotWarning)
        arm = fa.from_mjcf(file)
    found = [(x.shape, x.on, x.colour) for x in arm["one"].looks]
    assert found[:2] == [("box", "base", "#808080"), ("mesh", "hub", "#FF0000")]
    assert [x[0] for x in found[2:]] == ["cylinder", "ball", "ball"]
    q = np.array([0.6])
    track = arm.show(q, open=False).tracks[0]
    (mesh,) = track.body.meshes
    p, R, *_ = track.at(0.0)
    drawn = mesh.vertices @ R[mesh.node].T + p[mesh.node]
    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    k = int(np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_MESH)[0])
    wanted = model.mesh_vert @ data.geom_xmat[k].reshape(3, 3).T + data.geom_xpos[k]
    apart = np.linalg.norm(drawn[:, None] - wanted, axis=2)
    assert len(drawn) == len(wanted) == 4 and apart.min(axis=0).max() < 1e-6


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"shape": "mesh"}, "file = None"),
        ({"shape": "box", "size": (1, 2)}, "size"),
        ({"shape": "box", "size": (1, 2, 0)}, ("size", "0")),
        ({"shape": "ball", "size": [1], "file": "a.stl"}, ("a ball", "none")),
        ({"shape": "cone", "size": [1]}, "shape = 'cone'"),
        ({"shape": "ball", "size": [1], "on": "end"}, "on = 'end'"),
        ({"shape": "ball", "size": [1], "colour": "red"}, "#RRGGBB"),
    ],
)
def test_wrong_looks(arguments: dict[str, Any], said: str) -> None:
    with refuses(said):
        fa.Look(**arguments)
    with refuses("looks[0] = 'hand.stl'", "Look"):
        fa.Link(fa.Revolute("z"), looks=["hand.stl"])  # type: ignore[list-item]
