"""Robots from URDF files: Pinocchio's numbers, flexible links against rods of the same inertia, what is said."""

from __future__ import annotations

import json
import re
import sys
import warnings
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from messages import refuses, warns

DATA = Path(__file__).parents[1] / "data"
ROBOTS = json.loads((DATA / "robots.json").read_text())["robots"]  # by Pinocchio: bench/robots/pinocchio_robots.py
SIX = (DATA / "robots" / "six.urdf").read_text()
TREE = (DATA / "robots" / "tree.urdf").read_text()
ALLOY = fa.Material(density=2700.0, youngs_modulus=70e9, poisson_ratio=0.33)


def quiet(path: Path, **options: Any) -> fa.Arm:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.errors.RobotWarning)
        return fa.from_urdf(path, **options)


def made(tmp_path: Path, text: str, **options: Any) -> fa.Arm:
    path = tmp_path / "robot.urdf"
    path.write_text(text)
    return quiet(path, **options)


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda r: f"{r['file']} {r['tip']}")
def test_pinocchio(robot: dict[str, Any]) -> None:
    arm = quiet(DATA / "robots" / robot["file"], tip=robot["tip"])
    damping = np.array([np.sum(link.joint.damping) for link in arm if link.joint.nv])
    assert len(robot["states"]) == 2 and arm.nv >= 3
    for state in robot["states"]:
        q, v, tau, M, h, a, p, R = (np.array(state[k]) for k in ("q", "v", "tau", "M", "h", "a", "p", "R"))
        np.testing.assert_allclose(arm.mass_matrix(q), M, rtol=0, atol=1e-12 * np.abs(M).max())
        np.testing.assert_allclose(arm.bias(q, v) - damping * v, h, rtol=0, atol=1e-12 * np.abs(h).max())
        found = arm.forward_dynamics(q, v, tau + damping * v)
        np.testing.assert_allclose(found, a, rtol=0, atol=1e-11 * np.abs(a).max())
        place, axes = arm.frame(q)
        np.testing.assert_allclose(place, p, rtol=0, atol=1e-12)
        np.testing.assert_allclose(axes, R, rtol=0, atol=1e-12)


def test_what_joints_say() -> None:
    arm = quiet(DATA / "robots" / "six.urdf", tip="tool", stops=(1e4, 5.0))
    assert arm.names == ("turret", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3", "tool")
    pan, elbow = arm["pan"].joint, arm["forearm"].joint
    assert pan.name == "pan" and arm["elbow"] is arm["forearm"]
    assert (pan.damping, pan.coulomb, pan.lower, pan.upper) == (0.5, 0.7, -3.1, 3.1)
    assert (pan.limit_stiffness, pan.limit_damping) == (1e4, 5.0)
    assert elbow.lower is None and not elbow.limit_stiffness  # continuous
    np.testing.assert_allclose(elbow.axis, np.array([0.1, -2, 0.3]) / np.sqrt(4.1), rtol=1e-15)
    assert quiet(DATA / "robots" / "scara.urdf").coordinates[2] == "slide"


def test_the_report() -> None:
    """Nothing is left out without a word."""
    with pytest.warns(fa.errors.RobotWarning) as seen:
        fa.from_urdf(DATA / "robots" / "tree.urdf", tip="left_palm")
    text = str(seen[0].message)
    assert len(seen) == 1
    for words in (
        "30 kg fixed to the base",
        "held at zero, their bodies move with the link: neck, grip_a, grip_b, right_shoulder",
        "limits of effort and velocity: lift, left_shoulder, left_elbow",
        "limits of position (`stops` makes soft stops of them): lift, left_shoulder, left_elbow",
    ):
        assert words in text
    with warns(fa.errors.RobotWarning, "effort", "velocity", "pan"):
        arm = fa.from_urdf(DATA / "robots" / "six.urdf")
    assert [look.shape for look in arm["turret"].looks] == ["box"]


def test_a_plain_file_needs_no_report(tmp_path: Path) -> None:
    text = re.sub(r"<limit.*?/>|<visual>.*?</visual>", "", SIX, flags=re.S).replace('value="4"', 'value="0"')
    (path := tmp_path / "robot.urdf").write_text(text)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert fa.from_urdf(path).links[1:] == quiet(DATA / "robots" / "six.urdf").links[1:]


def test_strange_elements(tmp_path: Path) -> None:
    """Those that are not URDF's are named, those of other programs too."""
    text = SIX.replace("</robot>", '<gazebo reference="turret"/><transmission name="t1"/></robot>')
    text = text.replace('<dynamics damping="0.4"/>', '<dynamics damping="0.4" spring="3"/>')
    (path := tmp_path / "robot.urdf").write_text(text)
    with pytest.warns(fa.errors.RobotWarning) as seen:
        arm = fa.from_urdf(path)
    said = str(seen[0].message)
    assert "<gazebo>" in said and "<transmission>: t1" in said and "attribute spring of <dynamics>: shoulder" in said
    assert arm == quiet(DATA / "robots" / "six.urdf")


# -- flexible links ---------------------------------------------------------------------------------------------------


def beam(length: float) -> fa.Beam:
    modes = {"bending_y": 2, "bending_z": 2, "torsion": 1}
    return fa.Beam(length, fa.Rectangle(y=0.02, z=0.05), ALLOY, modes=modes, basis="legendre")


def rod(start: Any, end: Any, up: Any) -> str:
    """The <inertial> of that beam when it is rigid, in the link's axes, by the formulae of a cuboid."""
    start, end = np.array(start, dtype=float), np.array(end, dtype=float)
    L = np.linalg.norm(end - start)
    x = (end - start) / L
    y = np.cross(up, x) / np.linalg.norm(np.cross(up, x))
    axes = np.column_stack([x, y, np.cross(x, y)])
    mass, b, h = 2700.0 * 0.02 * 0.05 * L, 0.02, 0.05
    I = axes @ np.diag([b**2 + h**2, L**2 + h**2, L**2 + b**2]) @ axes.T * mass / 12
    com = (start + end) / 2
    pairs = [(a, b) for a in range(3) for b in range(a, 3)]
    entries = " ".join(f'i{"xyz"[a]}{"xyz"[b]}="{float(I[a, b])!r}"' for a, b in pairs)
    place = " ".join(repr(float(c)) for c in com)
    return f'<inertial><origin xyz="{place}"/><mass value="{float(mass)!r}"/><inertia {entries}/></inertial>'


def with_inertial(text: str, link: str, inertial: str) -> str:
    found = re.sub(rf'(<link name="{link}">\s*)<inertial>.*?</inertial>', rf"\1{inertial}", text, flags=re.S)
    assert found != text
    return found


CASES = {
    # a beam that leans, to the next joint
    "forearm": ((0, 0, 0), (0.3, 0.02, 0.1), (0, 0, 1), {}),
    # along z, from a place to a place, its z axis along y
    "upper_arm": ((0, 0, 0.05), (0, 0, 0.4), (0, 1, 0), {"start": (0, 0, 0.05), "end": (0, 0, 0.4), "up": (0, 1, 0)}),
}


@pytest.mark.parametrize("link", CASES)
def test_a_flexible_link_has_its_rods_inertia(link: str, tmp_path: Path) -> None:
    """Where nothing bends, the arm is the rigid one with a cuboid for the link: its masses, places and gravity."""
    start, end, up, options = CASES[link]
    length = float(np.linalg.norm(np.subtract(end, start)))
    flexible = {link: fa.Flexible(beam(length), **options)}
    arm = made(tmp_path, SIX, tip="tool", flexible=flexible)
    stiff = made(tmp_path, with_inertial(SIX, link, rod(start, end, up)), tip="tool")
    assert arm.nv == stiff.nv + 5
    joints = [arm.joint_rate(k) for k, link in enumerate(arm) if link.joint.nv]
    rng = np.random.default_rng(3)
    for _ in range(3):
        angles, rates = rng.uniform(-2, 2, 6), rng.normal(size=6)
        q, v = arm.zero, np.zeros(arm.nv)
        q[joints], v[joints] = angles, rates
        for ours, theirs in zip(arm.frame(q), stiff.frame(angles), strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-13)
        M = stiff.mass_matrix(angles)
        np.testing.assert_allclose(arm.mass_matrix(q)[np.ix_(joints, joints)], M, rtol=0, atol=1e-11 * M.max())
        h = stiff.bias(angles, rates)
        np.testing.assert_allclose(arm.bias(q, v)[joints], h, rtol=0, atol=1e-11 * np.abs(h).max())


def test_a_beam_bends_about_its_own_axes(tmp_path: Path) -> None:
    """The tip gives way along the section's thin side, by F L^3 / 3 E I, wherever the beam points."""
    text = with_inertial(SIX, "forearm", "")
    L = float(np.sqrt(0.3**2 + 0.02**2 + 0.1**2))
    arm = made(tmp_path, text, tip="wrist_1", flexible={"forearm": beam(L)}, gravity=(0, 0, 0))
    joints = [k for k, x in enumerate(arm) if x.joint.nv]
    R = arm.frame(arm.zero, "forearm", 0.0)[1]
    for k, inertia in ((1, 0.05 * 0.02**3 / 12), (2, 0.02 * 0.05**3 / 12)):
        load = fa.Load("forearm", L, force=R[:, k])
        q = arm.equilibrium(lock=joints, loads=[load])
        moved = arm.frame(q, "forearm", L)[0] - arm.frame(arm.zero, "forearm", L)[0]
        np.testing.assert_allclose(moved @ R[:, k], L**3 / (3 * 70e9 * inertia), rtol=1e-6)
    assert arm.nv == 4 + 5


def test_a_last_link_ends_with_its_beam(tmp_path: Path) -> None:
    flexible = {"wrist_3": fa.Flexible(beam(0.2), end=(0, 0.2, 0))}
    arm, rigid = made(tmp_path, SIX, flexible=flexible), made(tmp_path, SIX)
    p, R = rigid.frame(rigid.zero)
    np.testing.assert_allclose(arm.frame(arm.zero)[0], p + R @ [0, 0.2, 0], atol=1e-14)
    assert arm["wrist_3"].hub.mass == 0.6  # the tool, whose mass is nearer to the clamp


def test_its_mass_replaces_or_is_added(tmp_path: Path) -> None:
    L = float(np.sqrt(0.3**2 + 0.02**2 + 0.1**2))
    rigid = made(tmp_path, SIX)
    masses = {}
    for mass in ("replace", "add"):
        arm = made(tmp_path, SIX, flexible={"forearm": fa.Flexible(beam(L), mass=mass)})
        masses[mass] = sum(link.mass for link in arm) - sum(link.mass for link in rigid)
    np.testing.assert_allclose(masses["add"], 2.7 * L, rtol=1e-12)
    np.testing.assert_allclose(masses["replace"], 2.7 * L - 2.3, rtol=1e-12)
    # what is bolted on rides with the nearer end: the motor, 0.3 m up of 0.42
    arm = made(tmp_path, SIX, flexible={"upper_arm": fa.Flexible(beam(0.42), end=(0, 0, 0.42))})
    assert arm["upper_arm"].tip.mass == 1.1 and arm["upper_arm"].hub is None
    with warns(fa.errors.RobotWarning, "8.4 kg", "'upper_arm'", "1.134 kg"):
        fa.from_urdf(DATA / "robots" / "six.urdf", flexible={"upper_arm": fa.Flexible(beam(0.42), end=(0, 0, 0.42))})


# -- bad input --------------------------------------------------------------------------------------------------------

LOOP = '<joint name="l" type="fixed"><parent link="tool"/><child link="turret"/></joint></robot>'
BAD: dict[str, tuple[str, dict[str, Any], Any]] = {
    "line of broken XML": (SIX.replace('<link name="pedestal"/>', '<link name="pedestal">'), {}, "line 44"),
    "empty": ("", {}, "line 1"),
    "another format": ("<mujoco/>", {}, "MJCF"),
    "macros": ('<robot xmlns:x="http://www.ros.org/wiki/xacro"><x:macro name="a"/></robot>', {}, "xacro"),
    "no links": ("<robot/>", {}, "no links"),
    "unknown": (SIX.replace('"pan" type="revolute"', '"pan" type="unknown"'), {}, ("'pan'", "'unknown'")),
    "mimic": (TREE, {"tip": "finger_b"}, ("'grip_b'", "'grip_a'")),
    "mimic in the whole": (TREE, {}, ("'grip_b'", "'grip_a'", "tip = ['head', 'finger_a', 'right_upper']")),
    "no tips": (SIX, {"tip": []}, "tip = []"),
    "a tip of two": (TREE, {"tip": ["head", "left_plam"]}, "'left_palm'"),
    "no name": (SIX, {"tip": 3}, "tip = 3"),
    "tip": (TREE, {"tip": "left_plam"}, "'left_palm'"),
    "loop": (SIX.replace("</robot>", LOOP), {}, ("'turret'", "'pan'", "'l'")),
    "massless": (re.sub(r"<inertial>.*?</inertial>", "", SIX, flags=re.S), {}, ("wrist_c", "positive")),
    "negative mass": (SIX.replace('"2.3"', '"-2.3"'), {}, ("'forearm'", "mass = -2.3")),
    "no body's inertia": (SIX.replace('izz="0.031"', 'izz="3"'), {}, ("'forearm'", "inertia")),
    "nan": (SIX.replace('"2.3"', '"nan"'), {}, ("'forearm'", "mass = nan")),
    "a word": (SIX.replace('"2.3"', '"two"'), {}, ("'forearm'", "value=", '"two"', "mass")),
    "no mass": (SIX.replace('"2.3"', '""'), {}, ("'forearm'", "value=", '""', "mass", "number")),
    "two masses": (SIX.replace('"2.3"', '"2.3 1"'), {}, ("'forearm'", "value=", '"2.3 1"', "mass", "number")),
    "no value": (SIX.replace('<mass value="2.3"/>', "<mass/>"), {}, ("'forearm'", "value", "missing")),
    "no child": (SIX.replace('<child link="turret"/>', ""), {}, ("'pan'", "child", "link", "missing")),
    "a type": (SIX.replace('"pan" type="revolute"', '"pan" type="hinge"'), {}, ("'pan'", "type = 'hinge'", "revolute")),
    "two links": (SIX.replace("</robot>", '<link name="turret"/></robot>'), {}, ("link 'turret'", "twice")),
    "a short axis": (SIX.replace('xyz="0 1 0"', 'xyz="0 1"'), {}, ("'shoulder'", "xyz=", '"0 1"', "3", "numbers")),
    "no axis": (SIX.replace('xyz="0 1 0"', 'xyz="0 0 0"'), {}, ("'shoulder'", "axis")),
    "unknown parent": (SIX.replace('<parent link="pedestal"/>', '<parent link="x"/>'), {}, ("joint 'pan'", "'x'")),
    "unknown flexible": (SIX, {"flexible": {"forarm": beam(0.3)}}, ("flexible", "key 'forarm'", "'forearm'")),
    "fixed flexible": (SIX, {"flexible": {"motor": beam(0.3)}}, ("'motor'", "'upper_arm'")),
    "no beam": (SIX, {"flexible": {"forearm": 0.3}}, ("flexible['forearm'] = 0.3", "Beam")),
    "length": (SIX, {"flexible": {"forearm": beam(0.3)}}, "0.31685959 m"),
    "no end": (SIX, {"flexible": {"wrist_3": beam(0.3)}}, "no joint follows"),
    "stops": (SIX, {"stops": (1, 2, 3)}, "stops = (1, 2, 3)"),
}  # fmt: skip


@pytest.mark.parametrize("axis", ["0 1e200 0", "0 1e-200 0", "0 7 0"])
def test_the_length_of_an_axis_says_nothing(axis: str, tmp_path: Path) -> None:
    assert made(tmp_path, SIX.replace('xyz="0 1 0"', f'xyz="{axis}"')) == made(tmp_path, SIX)


@pytest.mark.parametrize("name", BAD)
def test_bad_input(name: str, tmp_path: Path) -> None:
    text, options, says = BAD[name]
    with refuses(says) as error:
        made(tmp_path, text, **options)
    assert str(error.value).startswith("robot.urdf: ")


def test_no_file() -> None:
    with refuses("No such file"):
        fa.from_urdf("/nowhere.urdf")


# -- numbers of the user, and long chains -----------------------------------------------------------------------------


def test_numbers_of_joints() -> None:
    """By the name of a joint or of the link that it moves, or one for all; they stand in place of the file's."""
    six = DATA / "robots" / "six.urdf"
    plain = quiet(six)
    arm = quiet(six, reflected_inertia={"pan": 0.3, "forearm": 0.1}, damping=0.25, coulomb={"elbow": 0.0, "pan": 2})
    joints = {link.joint.name: link.joint for link in arm}
    assert [j.reflected_inertia for j in joints.values()] == [0.3, 0.0, 0.1, 0.0, 0.0, 0.0]
    assert {j.damping for j in joints.values()} == {0.25}
    assert joints["pan"].coulomb == 2 and joints["elbow"].coulomb == 0
    assert all(a.joint.coulomb == b.joint.coulomb for a, b in zip(arm, plain, strict=True) if a.name not in
               ("turret", "forearm"))  # fmt: skip
    rotors = np.diag([j.reflected_inertia for j in joints.values()])
    q = np.linspace(-1, 1, 6)
    np.testing.assert_allclose(arm.mass_matrix(q), plain.mass_matrix(q) + rotors, rtol=0, atol=1e-13)
    bad: dict[str, tuple[dict[str, Any], Any]] = {
        "unknown": ({"damping": {"elbo": 1.0}}, ("damping", "key 'elbo'", "'elbow'")),
        "negative": ({"coulomb": {"elbow": -1.0}}, ("joint 'elbow'", "coulomb[0] = -1")),
        "word": ({"reflected_inertia": {"elbow": "x"}}, "reflected_inertia['elbow'] = 'x'"),
        "twice": ({"damping": {"elbow": 1.0, "forearm": 2.0}}, ("damping", "'forearm'", "'elbow'")),
        "list": ({"damping": [1.0, 2.0]}, ("damping =", "number")),
    }
    for options, says in bad.values():
        with refuses(says):
            quiet(six, **options)


def test_long_chains_take_work_in_proportion(tmp_path: Path) -> None:
    """Calls of functions, not seconds: twice the joints, about twice the calls."""
    ball = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
    calls = []
    for n in (50, 100, 200):
        links = [f'<link name="link{k}"><inertial><mass value="1"/>{ball}</inertial></link>' for k in range(n + 1)]
        joints = [f'<joint name="joint{k}" type="continuous"><parent link="link{k}"/><child link="link{k + 1}"/>'
                  '</joint>'
                  for k in range(n)]  # fmt: skip
        (tmp_path / "chain.urdf").write_text(f'<robot name="chain">{"".join(links + joints)}</robot>')
        count = 0

        def counted(frame: Any, event: str, what: Any) -> None:
            nonlocal count
            count += event in ("call", "c_call")

        sys.setprofile(counted)
        try:
            arm = quiet(tmp_path / "chain.urdf")
        finally:
            sys.setprofile(None)
        assert [link.joint.name for link in arm] == [f"joint{k}" for k in range(n)]
        calls.append(count)
    assert calls[2] - calls[1] < 2.2 * (calls[1] - calls[0])
