"""What `flexarm run` says of arms with balls: each rate and torque its own, a quaternion without a rate."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from flexarm.cli import main

BODY = "hub = { mass = 1.0, inertia = [0.1, 0.2, 0.25], end = [0.5, 0, 0] }"
BALL = f'[[link]]\njoint = {{ type = "spherical" }}\n{BODY}\n'
HINGE = f'[[link]]\njoint = {{ type = "revolute", axis = "z" }}\n{BODY}\n'
FREE = f'[[link]]\njoint = {{ type = "free" }}\n{BODY}\n'
RUN = "[simulation]\nduration = 0.1\ninterval = 0.05\n"


def told(text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    (tmp_path / "scene.toml").write_text(text + RUN)
    assert main(["run", str(tmp_path / "scene.toml"), "-o", str(tmp_path / "out"), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.mark.parametrize("links", [BALL, FREE, BALL + HINGE, FREE + BALL + HINGE, HINGE + BALL])
def test_each_row_is_what_it_is_called(links: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = links
    if links.endswith(HINGE):
        text += f"[[drive]]\nlink = {links.count('[[link]]') - 1}\ntorque = 5.0\n"
    rows = {row["name"]: row for row in told(text, tmp_path, capsys)["quantities"]}
    run = fa.Result.load(tmp_path / "out" / "run.npz")
    units = [unit for link in run.arm.links for unit in link.joint.units]
    assert len(rows) == run.arm.nq + 2 * run.arm.nv  # rigid links: joints alone
    for i, name in enumerate(run.arm.q_names):
        assert rows[name]["final"] == run.q[-1, i] and rows[name]["minimum"] == run.q[:, i].min()
        assert rows[name]["unit"] == ("1" if "quaternion" in name else units[run.arm.coordinates.index(name)])
    for i, name in enumerate(run.arm.coordinates):
        force, unit = ("torque", "N m") if units[i] == "rad" else ("force", "N")
        assert rows[f"{name} rate"]["final"] == run.v[-1, i] and rows[f"{name} rate"]["unit"] == f"{units[i]}/s"
        assert rows[f"{name} {force}"]["final"] == run.tau[-1, i] and rows[f"{name} {force}"]["unit"] == unit
    if links.endswith(HINGE):
        hinge = run.arm.coordinates[-1]
        assert rows[f"{hinge} torque"]["maximum"] == 5.0 and rows[f"{hinge} rate"]["final"] > 0.1
    with (tmp_path / "out" / "run.csv").open() as f:
        table = list(csv.DictReader(f))
    for i, name in enumerate(run.arm.coordinates):
        assert float(table[-1][f"v {name}"]) == pytest.approx(run.v[-1, i])
    assert float(table[-1][f"q {run.arm.q_names[0]}"]) == pytest.approx(run.q[-1, 0])


def test_other_tables_and_pictures_of_arms_with_balls(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text("gravity = [0, 0, -1]\n" + FREE + BALL + HINGE + RUN)
    scene = fa.load(tmp_path / "scene.toml")
    assert f"q has {scene.arm.nq} entries" in str(scene.arm)
    run = scene.run()
    panels = {ax.get_ylabel(): [line.get_label() for line in ax.lines] for ax in run.plot().axes}
    curves = [name for names in panels.values() for name in names]
    assert sorted(curves) == sorted(run.arm.q_names)
    scene.sensors = (fa.sensors.Encoder(link=2, pulses=None), fa.sensors.Tachometer(link=0, freedom=4))
    np.testing.assert_array_equal(scene.readings(run)["sensor-0-encoder"].y[:, 0], run.q[:, -1])
    np.testing.assert_array_equal(scene.readings(run)["sensor-1-tachometer"].y[:, 0], run.v[:, 4])
