"""Loops of MJCF files, read and written: closure and accelerations beside MuJoCo's own Jacobians and inertia."""

from __future__ import annotations

from pathlib import Path

import flexarm as fa
import numpy as np
import pytest
from arms import STEEL
from messages import refuses, warns

mujoco = pytest.importorskip("mujoco")

BARS = """
<mujoco><option gravity="0 -9.81 0"/><worldbody>
  <body name="crank"><joint name="a" axis="0 0 1"/><inertial pos="0.1 0 0" mass="1" diaginertia="1e-3 2e-3 2e-3"/>
    <body name="coupler" pos="0.2 0 0"><joint name="b" axis="0 0 1"/>
      <inertial pos="0.3 0 0" mass="2" diaginertia="1e-3 5e-2 5e-2"/><site name="hand" pos="0.6 0.02 0" euler="0 0 20"/>
    </body></body>
  <body name="rocker" pos="0.5 0 0" euler="0 0 90"><joint name="c" axis="0 0 1"/>
    <inertial pos="0.2 0 0" mass="1" diaginertia="1e-3 1e-2 1e-2"/>
    <body name="knob" pos="0.5 0 0"><inertial pos="0 0 0" mass="0.3" diaginertia="1e-3 1e-3 1e-3"/>
      <site name="top" pos="0 0.01 0" euler="0 0 -50"/></body></body>
</worldbody><equality>%s</equality></mujoco>"""
CLOSED = {
    "of bodies": '<connect name="pin" body1="coupler" body2="knob" anchor="0.3 0.1 0"/>',
    "of sites": '<connect name="pin" site1="hand" site2="top"/>',
    "weld": '<weld name="pin" body1="coupler" body2="knob" anchor="0 0.02 0.03" relpose="0.3 0.1 0.03 0.8 0 0 0.6"/>',
    "weld of sites": '<weld name="pin" site1="hand" site2="top"/>',
    "to the world": '<connect name="pin" body1="coupler" anchor="0.5 0.2 0"/>',
}  # fmt: skip


@pytest.mark.parametrize("kind", CLOSED)
def test_loops_of_a_file_hold_as_mujocos_constraints_do(kind: str, tmp_path: Path) -> None:
    file = tmp_path / "bars.xml"
    file.write_text(BARS % CLOSED[kind])
    arm = fa.from_mjcf(file)
    assert arm.loop_names == ("pin",)
    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    q = data.qpos[:] = arm.assemble([0.9, -0.4, 0.2])
    mujoco.mj_forward(model, data)
    assert np.abs(data.efc_pos).max() < 1e-10  # closed as MuJoCo sees it
    J, M = data.efc_J.reshape(-1, 3), np.zeros((3, 3))
    for k, unit in enumerate(np.eye(3)):
        mujoco.mj_mulM(model, data, M[k], unit)
    rest = np.zeros(len(J))
    held = np.block([[M, J.T], [J, np.diag(rest)]])  # rigid constraints at rest, redundant rows by least squares
    a = np.linalg.lstsq(held, np.concatenate([-data.qfrc_bias, rest]), rcond=1e-10)[0][:3]
    np.testing.assert_allclose(arm.forward_dynamics(q, np.zeros(3), np.zeros(3)), a, atol=1e-8 * (1 + np.abs(a).max()))


def test_a_constraint_of_another_kind_or_of_a_held_body_is_told(tmp_path: Path) -> None:
    file = tmp_path / "bars.xml"
    file.write_text(BARS % ('<joint name="gear" joint1="a" joint2="c"/><connect name="off" active="false" '
                            'body1="coupler" body2="knob" anchor="0 0 0"/>'))  # fmt: skip
    with warns(fa.errors.RobotWarning, "connect or weld", "gear", "off"):
        assert not fa.from_mjcf(file).loops
    file.write_text(BARS % CLOSED["of bodies"])
    with warns(fa.errors.RobotWarning, "'pin'", "'knob'"):
        assert not fa.from_mjcf(file, tip="coupler").loops


def test_a_loop_on_a_flexible_link_sits_on_its_slice(tmp_path: Path) -> None:
    file = tmp_path / "bars.xml"
    file.write_text(BARS % CLOSED["of bodies"])
    beam = fa.Beam(0.6, fa.Rectangle(0.004, 0.02), STEEL, {"bending_y": 2})
    flexible = fa.Flexible(beam, end=(0.6, 0, 0))
    with warns(fa.errors.RobotWarning, "coupler"):
        arm = fa.from_mjcf(file, flexible={"coupler": flexible})
    (loop,) = arm.loops
    assert loop.a.at == pytest.approx(0.3) and loop.b.at == "origin"
    rigid = fa.from_mjcf(file)
    q = rigid.assemble([0.9, -0.4, 0.2])
    closed = arm.pose(dict(zip(arm.names, q, strict=True)))
    np.testing.assert_allclose(arm.loop_motion(closed)[0], 0, atol=1e-12)


TURNED = fa.Placement((0, 0, 0), (0, 0, -1.4))


def bars(closing: fa.Joint, **loop: float) -> fa.Arm:
    beam = fa.Beam(0.6, fa.Rectangle(0.006, 0.02), STEEL, {"bending_y": 2}, "legendre")
    crank = fa.RigidBody(1.0, (0.1, 0, 0), (1e-3, 2e-3, 2e-3), (0.2, 0, 0))
    rocker = fa.RigidBody(1.0, (0.2, 0, 0), (1e-3, 1e-2, 1e-2), (0.5, 0, 0))
    bodies = {"crank": {"hub": crank}, "coupler": {"beam": beam}, "rocker": {"hub": rocker}}
    links = [fa.Link(fa.Revolute("z"), name=name, **body) for name, body in bodies.items()]
    return fa.Arm(links, (0, -9.81, 0), loops=[fa.Loop((0.7, 0, 0), "rocker", closing, name="foot", **loop)])


@pytest.mark.parametrize("closing", [fa.Revolute("z"), fa.Spherical(), fa.Fixed(inboard=TURNED)], ids=lambda x: x.type)
def test_loops_are_written_as_constraints_that_are_closed_where_the_arm_is(closing: fa.Joint, tmp_path: Path) -> None:
    arm = bars(closing)
    file = tmp_path / "bars.xml"
    arm.to_mjcf(file, segments=2)
    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    q = arm.assemble({"crank": 0.5, "coupler": 0.2, "rocker": -2.1})
    names = [model.joint(k).name for k in range(model.njnt)]
    joints = [names.index(f"{name} joint") for name in arm.names]
    data.qpos[joints] = q[[0, 1, -1]]
    straight = np.abs(np.delete(q, [0, 1, arm.nq - 1])).max() < 1e-12
    assert straight  # joints alone close it, and all hinges of segments are at zero
    mujoco.mj_forward(model, data)
    assert np.abs(data.efc_pos).max() < 1e-10
    data.qpos[joints[2]] += 0.1
    mujoco.mj_forward(model, data)
    assert np.abs(data.efc_pos).max() > 0.01


def test_what_mjcf_has_not_of_loops_is_told() -> None:
    with refuses("foot", "prismatic"):
        bars(fa.Prismatic("x")).to_mjcf()
    with warns(fa.errors.RobotWarning, "solref", "foot"):
        bars(fa.Revolute("z"), stiffness=1e6, angular_stiffness=1e3).to_mjcf()


def test_a_cylinder_is_a_slide_in_a_file(tmp_path: Path) -> None:
    """Whose rod a constraint ties to its point; beside MuJoCo's accelerations."""
    body = fa.RigidBody(5.0, (0.5, 0, 0), (0.1, 0.5, 0.5), (1, 0, 0))
    top = fa.Point("boom", "origin", (0.6, 0.05, 0))
    jack = fa.Strut((0.3, -0.4, 0), top, stiffness=900, length=0.6, mass=2.0, name="jack")
    arm = fa.Arm([fa.Link(fa.Revolute("z"), body, name="boom")], (0, -9.81, 0), [jack])
    arm.to_mjcf(tmp_path / "arm.xml")
    with warns(fa.errors.RobotWarning, "1 tendon"):
        read = fa.from_mjcf(tmp_path / "arm.xml")
    assert set(read.names) == set(arm.names) and read.loop_names == ("jack end",)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    data, M = mujoco.MjData(model), np.zeros((3, 3))
    q = arm.assemble({"boom": 0.3})
    data.qpos[[model.joint(name).qposadr[0] for name in ("boom joint", "jack mount", "jack")]] = q
    mujoco.mj_forward(model, data)
    assert np.abs(data.efc_pos).max() < 1e-10
    for k, unit in enumerate(np.eye(3)):
        mujoco.mj_mulM(model, data, M[k], unit)
    J = data.efc_J.reshape(-1, 3)
    held = np.block([[M, J.T], [J, np.zeros((len(J), len(J)))]])
    force = np.concatenate([data.qfrc_passive - data.qfrc_bias, np.zeros(len(J))])
    a = np.linalg.lstsq(held, force, rcond=1e-10)[0][:3]
    a = a[[model.joint(name).dofadr[0] for name in ("boom joint", "jack mount", "jack")]]
    found = arm.forward_dynamics(q, np.zeros(3), np.zeros(3))
    np.testing.assert_allclose(found, a, atol=1e-8 * np.abs(a).max())
