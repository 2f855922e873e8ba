"""docs/identify.md keeps what it says, and the command line does the same."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import flexarm as fa
import pytest
from flexarm.cli import main
from pages import Ran

TRUE = {
    "link.0.tip.mass": 0.05, "link.0.beam.material.youngs_modulus": 209e9, "link.0.joint.damping": 0.04,
    "link.0.joint.coulomb": 0.05, "drive.0.scale": 1.08, "sensor.1.delay": 0.003, "sensor.1.filter.frequency": 20.0,
}  # fmt: skip


def test_numbers_of_the_page_and_the_command_line(
    page_of_docs: Callable[[str], Ran], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ran = page_of_docs("docs/identify.md")
    monkeypatch.chdir(folder := ran.folder)
    names, fit = ran.names, ran.names["fit"]
    for name, x in TRUE.items():
        assert abs(fit.values[name] - x) < 3.5 * fit.std[name] < 0.3 * x
    assert fit.validate(names["kept_aside"]).nrmse["strain"] < 0.05
    assert (folder / "fit.png").stat().st_size > 10_000
    link = fa.load("fitted.toml").arm.links[0]
    assert link.tip is not None and link.tip.mass == fit.values["link.0.tip.mass"]

    for name in ("data", "kept_aside"):
        names[name].save(f"{name}.csv")
    capsys.readouterr()
    sought = ["-p", "link.0.tip.mass=0.06:0.01:0.1", "-p", "drive.0.scale=1.0"]
    given = ["--input", "0=torque", "--output", "angle=sensor.0", "--output", "strain=sensor.1", "-o", "out"]
    kept = ["--validate", "kept_aside.csv", "--json"]
    assert main(["identify", "fitted.toml", "data.csv", *sought, *given, *kept]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["complete"] and told["validation"][0]["nrmse"]["strain"] < 0.05
    for name in sought[1::2]:
        path = name.partition("=")[0]
        assert abs(told["values"][path] - fit.values[path]) < 0.5 * fit.std[path]
    files = {"fit.txt", "fit.png", "fit.json", "fitted.toml", "validation-0.png"}
    assert {p.name for p in (folder / "out").iterdir()} == files == set(told["files"])
    assert json.loads((folder / "out" / "fit.json").read_text())["values"] == told["values"]


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        ("-p link.0.tip.mas --input 0=tau --output q=sensor.0", "did you mean 'link.0.tip.mass'"),
        ("-p link.0.tip.mass=x", "'x' is not a number"),
        ("-p link.0.tip.mass=1:2:3", "must be within the bounds"),
        ("-p link.0.tip.mass=1:2", "with a start and bounds"),
        ("-p link.0.tip.mass --output sensor.0", "must be NAME=VALUE"),
        ("-p link.0.tip.mass --input a=tau --output q=sensor.0", "'a': no link and no joint has this name"),
        ("-p link.0.tip.mass --input a.b=tau", "must begin with a link"),
        ("-p link.0.tip.mass --noise q=x", "'x' is not a number"),
        ("--output q=sensor.0", "required: -p/--parameter"),
    ],
)
def test_bad_options_are_one_line(argv: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "data.csv").write_text("t,q,tau\n0,0,0\n0.1,0,1\n0.2,0.1,0\n0.3,0.2,0\n")
    joint = '{ type = "revolute", axis = "z", reflected_inertia = 1.0 }'
    scene = f'[[link]]\njoint = {joint}\ntip = {{ mass = 1.0 }}\n[[sensor]]\ntype = "encoder"\n'
    (tmp_path / "arm.toml").write_text(scene)
    paths = [str(tmp_path / name) for name in ("arm.toml", "data.csv")]
    assert main(["identify", *paths, *argv.split(), "-o", str(tmp_path / "out")]) == 2
    err = capsys.readouterr().err
    assert err.startswith("flexarm: ") and err.count("\n") == 1 and said in err
