"""`flexarm view`: what it writes, prints and refuses."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import flexarm as fa
import numpy as np
import pytest
from flexarm.cli import main

from tests.arms import paper_link


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    arm = paper_link(1, 1)
    run = fa.simulate(arm, np.linspace(0.0, 0.1, 21), np.array([0.0, 0.01]))
    run.save(tmp_path / "run.npz")
    return tmp_path / "run.npz"


def test_a_run_is_written(saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("jupyter_threejs_sage")
    file = tmp_path / "run.html"
    assert main(["view", str(saved), str(saved), "-o", str(file), "--magnify", "20", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["file"] == str(file) and told["magnify"] == 20 and told["times"] == [0.0, 0.1]
    # the strain at the clamp is half the thickness times the curvature there
    arm = paper_link(1, 1)
    assert told["greatest_strain"] == pytest.approx(0.5e-3 * abs(arm.strain((0.0, 0.01))[2]), rel=0.02)
    assert "bending magnified 20 times" in file.read_text(encoding="utf-8")


def test_a_scene_is_drawn(saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = fa.Result.load(saved)
    scene = fa.Scene(run.arm, t=run.t, name="a link")
    scene.save(tmp_path / "link.toml")
    assert main(["view", str(tmp_path / "link.toml"), "-o", str(tmp_path / "link.png"), "--time", "0.1"]) == 0
    assert (tmp_path / "link.png").read_bytes()[:4] == b"\x89PNG"
    assert "0 to 0.1 s" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["-o", "a.pdf"], "must end in .html"),
        (["-o", "a.png", "--magnify", "0"], "magnify = 0.0"),
        (["-o", "a.png", "--speed", "-1"], "speed = -1.0"),
        (["-o", "a.png", "--time", "9"], "t = 9.0: must be from 0 to 0.1"),
        (["--time", "0"], "--time 0: goes with a picture"),
        (["nothing.npz", "-o", "a.png"], "nothing.npz"),
        (["-o", "/no/such/folder/a.png"], "no such file or folder"),
    ],
)
def test_bad_input_is_one_line(
    saved: Path, more: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["view", str(saved), *more]) == 2
    out, err = capsys.readouterr()
    assert said in err and err.count("\n") == 1 and out == ""


def test_without_the_extra(saved: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setitem(sys.modules, "jupyter_threejs_sage", None)
    assert main(["view", str(saved), "-o", "a.html"]) == 2
    assert "flexarm[view]" in capsys.readouterr().err


@pytest.mark.parametrize(("rows", "shown"), [(11, "shown is the motion before that"), (0, "there is nothing to show")])
def test_a_run_that_could_not_go_on(
    rows: int,
    shown: str,
    saved: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    run = fa.Result.load(saved)
    fa.Scene(run.arm, t=run.t).save(tmp_path / "link.toml")
    part = fa.Result(run.arm, *(x[:rows] for x in (run.t, run.q, run.v, run.a, run.tau)))

    def stop(self: fa.Scene, **_: object) -> fa.Result:
        raise fa.SimulationError("stopped at t = 0.05 s: because", 0.05, part)

    monkeypatch.setattr(fa.Scene, "run", stop)
    picture = tmp_path / "link.png"
    assert main(["view", str(tmp_path / "link.toml"), "-o", str(picture)]) == 1
    err = capsys.readouterr().err
    assert "stopped at t = 0.05 s: because" in err and shown in err and picture.exists() == (rows > 0)
