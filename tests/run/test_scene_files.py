"""What a scene may read: tables in its own folder and below, unless the caller allows another; nothing is echoed."""

from __future__ import annotations

import os
from pathlib import Path

import flexarm as fa
import numpy as np
import pytest
from arms import toml
from messages import refuses, warns

ARM = """
[[link]]
joint = { type = "revolute" }
tip = { mass = 1.0, inertia = [1, 1, 1] }
[simulation]
duration = 0.1
"""
TABLE = "t,tau\n0,0\n0.1,2\n"
SECRET = "root:x:0:0:hunter2,hunter3\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A scene's folder, with tables in it, below, and outside, where there is a secret, too."""
    (tmp_path / "scene" / "below").mkdir(parents=True)
    for place in ("scene/torque.csv", "scene/below/torque.csv", "torque.csv"):
        (tmp_path / place).write_text(TABLE)
    (tmp_path / "secret").write_text(SECRET * 3)
    return tmp_path / "scene"


def scene(folder: Path, name: str, law: str = "torque") -> Path:
    where = '[[control]]\ntype = "pd"\nkp = 1.0\nkv = 1.0' if law == "reference" else "[[drive]]\nlink = 0"
    (folder / "scene.toml").write_text(f'{ARM}{where}\n{law} = {{ file = "{name}" }}')
    return folder / "scene.toml"


def test_tables_in_the_scenes_folder_and_below(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("torque.csv", "below/torque.csv", "below/../torque.csv", "./torque.csv", str(folder / "torque.csv")):
        assert fa.load(scene(folder, name)).drive[0](0.1) == 2.0
    monkeypatch.chdir(folder)
    scene(folder, "below/torque.csv")
    assert fa.load("scene.toml").drive[0](0.1) == 2.0


@pytest.mark.parametrize("law", ["torque", "motion", "reference"])
def test_no_other_file_is_read(folder: Path, law: str) -> None:
    (folder / "link.csv").symlink_to("../torque.csv")
    (folder / "out").symlink_to("..")
    absolute = (str(folder.parent / "torque.csv"), "/etc/passwd", "/dev/zero")
    for name in (*absolute, "../torque.csv", "link.csv", "out/torque.csv", "../nope", "below/../../secret"):
        with refuses("file =", "folder"):
            fa.load(scene(folder, name, law))


def test_the_caller_may_allow_another_folder(folder: Path) -> None:
    for name in ("../torque.csv", str(folder.parent / "torque.csv")):
        assert fa.load(scene(folder, name), files=folder.parent).drive[0](0.1) == 2.0
    with refuses("file = 'torque.csv'", "folder"):
        fa.load(scene(folder, "torque.csv"), files=folder / "below")


@pytest.mark.parametrize("law", ["torque", "motion", "reference"])
def test_errors_tell_nothing_of_what_is_in_a_file(folder: Path, law: str) -> None:
    columns = {"torque": "t,tau", "motion": "t,q", "reference": "t,r"}[law]
    rows = ("0," + SECRET, "hunter2,0\n1,1\n", "0,0,hunter2\n", "0\n1,hunter2\n", "0,0\n0,hunter2\n")
    texts = [SECRET * 2, "hunter2", f"{columns},hunter2\n0,0,0\n", "", *(f"{columns}\n{row}" for row in rows)]
    for text in [*(t.encode() for t in texts), b"hunter2\xff\xfe,\n", b"hunter2\0", b'"hunter2' + b"x" * 200_000]:
        (folder / "table.csv").write_bytes(text)
        with refuses(f"{law}.file = 'table.csv'") as caught:
            fa.load(scene(folder, "table.csv", law)).run()
        assert "hunter" not in str(caught.value)


def test_what_is_no_file_is_named(folder: Path) -> None:
    os.mkfifo(folder / "pipe")
    for name in ("pipe", "below", ".", "none.csv", "a\\u0000b", "x" * 5000):
        with refuses("drive[0].torque.file ="):
            fa.load(scene(folder, name))
    with refuses("file = 5"):
        link = {"joint": {"type": "revolute"}, "tip": {"mass": 1.0, "inertia": [1, 1, 1]}}
        fa.load(toml(folder, {"link": [link], "drive": [{"link": 0, "torque": {"file": 5}}]}))


def test_warnings_of_a_scene_point_at_the_line_that_asked() -> None:
    """Of a beam that bends too far, and of a sensor; what is asked for is found beside it."""
    steel = {"density": 7850, "youngs_modulus": 209, "poisson_ratio": 0.3}  # in GPa: far too soft
    section = {"type": "rectangle", "y": 0.01, "z": 0.02}
    beam = {"length": 0.5, "section": section, "material": steel, "modes": {"bending_y": 2}}
    arm = fa.Arm.from_dict({"link": [{"joint": {"type": "revolute", "axis": "z"}, "beam": beam}]})
    gauge = fa.sensors.StrainGauge(link=0, x=0.01, filter=fa.sensors.LowPass(1e3))
    options = {"integrator": "implicit", "step": 1e-2}
    scene = fa.Scene(arm, {0: fa.Torque(0.1)}, t=np.linspace(0, 0.045, 11), sensors=(gauge,), options=options)
    with pytest.warns(fa.errors.RangeWarning) as said:
        run = scene.run()
    found = run.check(fa.Watch({("rotation", 0): 1e-6}))
    assert found[0] == said[0].message.finding and {x.unit for x in found} == {"rad", "Pa"}
    assert {w.filename for w in said} == {__file__}
    with warns(fa.errors.ModelWarning, "filter", "1000 Hz") as said:
        scene.readings(run)
    assert {w.filename for w in said} == {__file__}


def test_samples_of_a_motion_are_written_without_rounding(tmp_path: Path) -> None:
    """The polynomial of the last piece, at its end, gave 1.2000000000000017 and a rate of 4e-15."""
    turn = fa.Motion([0, 0.6, 2], [0, 1, 1], [0, 0, 0], [0, 0, 0]).scaled(1.2)
    assert turn(2.0) == (1.2, 0.0, 0.0) and [x[-1] for x in turn(np.array([0.3, 2.0]))] == [1.2, 0.0, 0.0]
    assert turn.moved(0.5, 1.0)(3.0) == (1.7, 0.0, 0.0)
    arm, t = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, inertia=(1, 1, 1)))]), np.linspace(0, 2, 21)
    for given in ({"drive": {0: turn}}, {"control": [fa.PD(9.0, 3.0, 0, reference=turn)]}):
        fa.Scene(arm, t=t, **given).save(tmp_path / "turn.toml")
        text = (tmp_path / "turn.toml").read_text()
        assert "q = [0.0, 1.2, 1.2]" in text and text.count("[0.0, 0.0, 0.0]") >= 2


def test_what_is_no_scene_file_is_said(tmp_path: Path) -> None:
    for name, content in (("run.csv", b"t,q\n0,1\n"), ("run.npz", b"PK\x03\x04\xff")):
        (tmp_path / name).write_bytes(content)
        with refuses(name, ".toml"):
            fa.load(tmp_path / name)
    table = "kp = 1.0\n[control.reference]\nt = [0, 1]\nq = [0, 1]\n"
    for first, says in (("[[controls]]", ("controls", "control")), ("control = 1", "line")):
        (tmp_path / "typo.toml").write_text(f"{first}\n{table}[[control]]\n{table}")
        with refuses(says):
            fa.load(tmp_path / "typo.toml")
