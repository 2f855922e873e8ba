"""The command line on the scene of a tree."""

from __future__ import annotations

import json
from pathlib import Path

import flexarm as fa
import numpy as np
import pytest
from arms import two_arms
from flexarm.cli import main


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    drive = {"left shoulder": fa.Torque(0.4)}
    options = {"integrator": "implicit", "step": 5e-3}
    fa.Scene(two_arms(), t=np.linspace(0.0, 0.1, 6), drive=drive, options=options, name="two arms").save("tree.toml")
    assert 'parent = "torso"' in Path("tree.toml").read_text()
    return tmp_path


def test_run_modes_check_and_view(tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "tree.toml"]) == 0
    assert main(["modes", "tree.toml", "--lock", "waist", "-n", "4", "--json"]) == 0
    out = capsys.readouterr().out
    told = json.loads(out[out.index("{") :])
    assert np.allclose([x["frequency"] for x in told["modes"]], two_arms().modes(lock=["waist"]).frequencies[:4])
    assert main(["run", "tree.toml", "-o", "out"]) == 0
    heads = next(p for p in sorted((tree / "out").glob("*.csv"))).read_text().splitlines()[0]
    assert "end of left fore x" in heads and "end of right fore z" in heads
    assert main(["view", "tree.toml", "-o", "tree.html"]) == 0
    assert (tree / "tree.html").stat().st_size > 10_000
    assert main(["compile", "tree.toml"]) == 0
