"""Compiled scenes: the file, and what cannot be compiled. That C++ runs them as Python does: tests/cpp."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from flexarm.cli import main
from messages import refuses


def test_the_file_holds_the_resolved_numbers_of_the_scene(tmp_path: Path) -> None:
    scene = fa.load("quanser")
    scene.compile(tmp_path / "arm.json")
    file = json.loads((tmp_path / "arm.json").read_text())
    assert (file["format"], file["version"]) == ("flexarm scene", 6)
    assert file["t"] == scene.t.tolist() and file["integrator"] == "implicit" and file["step"] == 0.005
    first = file["arm"]["links"][0]
    assert first["joint"]["forces"][0]["coulomb"] == 1.7 and first["joint"]["forces"][0]["upper"] == "inf"
    EI = 1.69e11 * 0.0762 * 0.00127**3 / 12
    # curvatures P_0 and P_1 along the beam: integrals of EI P_k^2
    np.testing.assert_allclose(np.diag(first["beam"]["stiffness"]), EI * 0.202 * np.array([1, 1 / 3]), rtol=1e-12)
    assert sum(s["mass"] for s in first["beam"]["slices"]) == pytest.approx(7850 * 0.202 * 0.0762 * 0.00127, rel=1e-12)
    assert len(file["arm"]["struts"]) == 1
    assert file["drives"][0]["motion"]["breaks"] == [0, 0.5, 1.5, 5.5, 6.5, 10]


def test_the_command_writes_it(tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["compile", "ist"]) == 0
    assert main(["compile", "ist", "-o", "other.json", "--json"]) == 0
    out = capsys.readouterr().out
    assert json.loads(out[out.index("{") :]) == {"file": "other.json"}
    assert Path("ist.json").read_text() == Path("other.json").read_text()
    file = json.loads(Path("ist.json").read_text())
    assert (file["integrator"], file["tolerance"]) == ("gauss", 1e-5)
    assert main(["compile", "ist", "-o", "arm.toml"]) == 2
    assert "must end in .json" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("part", "named"),
    [
        ({"drive": {0: fa.Torque(lambda t: t)}}, ("drive 0", "Torque", "Python", "function", "samples")),
        ({"drive": {0: fa.Motion.spin_up(1.0, 1.0)}}, ("drive 0", "Motion", "SpinUp", "Python", "function")),
        ({"drive": {}, "loads": (fa.Load(force=lambda t: (t, 0, 0)),)}, ("loads[0] = Load", "Python")),
        (
            {"drive": {}, "control": (fa.PD(1, 1), fa.PD(1, 1, reference=lambda t: t))},
            "control[1] = PD",
        ),
        ({"drive": {}, "control": (fa.Sampled(lambda t, y: [0.0], rate=100),)}, ("control[0] =", "LinearController")),
        ({"events": lambda t, q, v: q[0]}, ("events", "Python", "code")),
    ],
    ids=["torque", "spin_up", "load", "reference", "sampled", "events"],
)
def test_python_code_is_named(tmp_path: Path, part: dict[str, Any], named: str) -> None:
    with refuses(named):
        replace(fa.load("ist"), **part).compile(tmp_path / "arm.json")
    assert not list(tmp_path.iterdir())
