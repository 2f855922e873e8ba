"""Robots from MJCF files: their mass matrix, bias, places and accelerations are MuJoCo's."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from messages import refuses, warns

mujoco = pytest.importorskip("mujoco")
FILE = Path(__file__).parents[1] / "data" / "robots" / "arm.xml"
TEXT = FILE.read_text()


def quiet(path: Path, **options: Any) -> fa.Arm:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.errors.RobotWarning)
        return fa.from_mjcf(path, **options)


def test_mujoco() -> None:
    """With the joint off the chain held at zero: its row and column go."""
    arm = quiet(FILE, tip="tool")
    model = mujoco.MjModel.from_xml_path(str(FILE))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    data, rng = mujoco.MjData(model), np.random.default_rng(2)
    mine = [model.joint(link.joint.name).dofadr[0] for link in arm if link.joint.nv]
    assert len(mine) == arm.nv == 4 and model.nv == 5
    body = model.body("tool").id
    for _ in range(4):
        q, v = rng.uniform(-1.5, 1.5, 4), rng.normal(size=4)
        data.qpos[:], data.qvel[:] = 0.0, 0.0
        data.qpos[mine], data.qvel[mine] = q, v
        mujoco.mj_forward(model, data)
        M = np.zeros((model.nv, model.nv))
        for k, unit in enumerate(np.eye(model.nv)):
            mujoco.mj_mulM(model, data, M[k], unit)
        M = M[np.ix_(mine, mine)]
        np.testing.assert_allclose(arm.mass_matrix(q), M, rtol=0, atol=1e-13 * M.max())
        h = (data.qfrc_bias - data.qfrc_passive)[mine]
        np.testing.assert_allclose(arm.bias(q, v), h, rtol=0, atol=1e-12 * np.abs(h).max())
        p, R = arm.frame(q)
        np.testing.assert_allclose(p, data.xpos[body], rtol=0, atol=1e-13)
        np.testing.assert_allclose(R, data.xmat[body].reshape(3, 3), rtol=0, atol=1e-13)
    assert arm.gravity == (0.5, 0.0, -9.7)


def test_what_it_says_and_does_not() -> None:
    with pytest.warns(fa.errors.RobotWarning) as seen:
        arm = fa.from_mjcf(FILE, tip="hand", stops=1e3)
    text = str(seen[0].message)
    for words in ("5 kg fixed to the base", "move with the link: flap_hinge", "1 actuator", "geoms"):
        assert words in text
    assert arm.names == ("shoulder_block on pan", "shoulder_block", "forearm", "hand")
    pan, lift = arm["pan"].joint, arm["lift"].joint
    assert (pan.reflected_inertia, pan.coulomb) == (0.03, 0.2)
    assert (lift.stiffness, lift.rest, lift.lower, lift.upper, lift.limit_stiffness) == (2.0, 0.3, -2.0, 1.5, 1e3)


def test_a_flexible_body(tmp_path: Path) -> None:
    L = float(np.hypot(0.36, 0.02))
    beam = fa.Beam(L, fa.Tube(0.02, 0.002), fa.Material(1800.0, 40e9, 0.3), modes={"bending_y": 2, "bending_z": 2})
    arm, rigid = quiet(FILE, tip="tool", flexible={"forearm": beam}), quiet(FILE, tip="tool")
    q, angles = arm.zero, np.array([0.3, -0.4, 0.8, 0.1])
    q[[i for i, name in enumerate(arm.coordinates) if "bending" not in name]] = angles
    np.testing.assert_allclose(arm.frame(q)[0], rigid.frame(angles)[0], atol=1e-14)
    np.testing.assert_allclose(arm.frame(q)[1], rigid.frame(angles)[1], atol=1e-14)


def test_the_reference_position(tmp_path: Path) -> None:
    text = TEXT.replace('<joint name="elbow"', '<joint name="elbow" ref="0.5"')
    (path := tmp_path / "arm.xml").write_text(text)
    with warns(fa.errors.RobotWarning, "qpos - ref", "elbow"):
        assert fa.from_mjcf(path, tip="tool") == quiet(FILE, tip="tool")


@pytest.mark.parametrize(
    ("text", "options", "says"),
    [
        (TEXT.replace("</worldbody>", ""), {"tip": "tool"}, "line 29"),
        (TEXT.replace('type="slide"', 'type="slid"'), {"tip": "tool"}, "line 20"),
        (TEXT, {"tip": "tol"}, ("tip = 'tol'", "'tool'")),
        ("<robot/>", {}, "URDF"),
        ("<mujoco/>", {}, ("joint", "moves")),
    ],
    ids=["XML", "MuJoCo's own", "tip", "URDF", "empty"],
)
def test_bad_input(text: str, options: dict[str, Any], says: str, tmp_path: Path) -> None:
    (path := tmp_path / "arm.xml").write_text(text)
    with refuses(says):
        quiet(path, **options)


def test_no_mujoco(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "mujoco", None)
    with refuses("flexarm[mjcf]", error=ImportError):
        fa.from_mjcf(FILE)


def test_numbers_of_joints() -> None:
    """In place of the file's armature, damping and friction loss, by joint."""
    plain = quiet(FILE, tip="tool")
    arm = quiet(FILE, tip="tool", reflected_inertia={"pan": 0.5}, damping=0.0, coulomb={"pan": 0.0})
    assert plain["pan"].joint.reflected_inertia == 0.03 and plain["pan"].joint.coulomb == 0.2
    assert arm["pan"].joint.reflected_inertia == 0.5 and arm["pan"].joint.coulomb == 0.0
    assert not any(link.joint.damping for link in arm) and arm["lift"].joint.stiffness == 2.0
