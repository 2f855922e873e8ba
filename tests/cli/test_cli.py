"""The command line: exit codes, one-line errors, JSON, and the files it writes."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from flexarm import _console
from flexarm.cli import main
from messages import refuses

PENDULUM = """
gravity = [0, -9.81, 0]
[[link]]
joint = { type = "revolute", axis = "z" }
[link.beam]
length = 0.5
section = { type = "rectangle", y = 0.01, z = 0.02 }
material = { density = 7850, youngs_modulus = 209e9, poisson_ratio = 0.3 }
modes = { bending_y = 1 }
[[link]]
joint = { type = "prismatic", axis = "x" }
tip = { mass = 0.1 }
[[drive]]
link = 1
motion = { t = [0, 0.1], q = [0.2, 0.2] }
[simulation]
duration = 0.1
"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "pendulum.toml"
    path.write_text(PENDULUM)
    return path


def refused(capsys: pytest.CaptureFixture[str], *argv: str, code: int = 2) -> str:
    """The one line on stderr of a call that ends with this exit code and prints nothing else."""
    assert main(argv) == code
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("flexarm: ") and err.count("\n") == 1 and err.endswith("\n")
    return err


def answer(capsys: pytest.CaptureFixture[str], *argv: str) -> Any:
    """What a call with --json prints, and nothing on stderr."""
    assert main([*argv, "--json"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    return json.loads(out)


# -- run -----------------------------------------------------------------------------------------------------


def test_run_writes_what_result_load_reads(scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "deep" / "out"
    assert main(["run", str(scene), "-o", str(folder)]) == 0
    out, err = capsys.readouterr()
    assert "link 0 revolute" in out and "link 0 tip y deflection" in out and err == ""
    names = {"run.npz", "run.csv", "run.png", "summary.txt", "summary.json"}
    assert {p.name for p in folder.iterdir()} == names
    result = fa.Result.load(folder / "run.npz")
    assert result.arm == fa.load(scene).arm and result.t[-1] == 0.1
    table = np.genfromtxt(folder / "run.csv", delimiter=",", names=True)
    assert len(table) == len(result.t)
    np.testing.assert_array_equal(table["q_link_0_revolute"], result.q[:, 0])
    np.testing.assert_allclose(table["end_x"], result.frame()[0][:, 0])


def test_run_tells_it_in_json(scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told = answer(capsys, "run", str(scene), "-o", str(tmp_path / "out"))
    assert told["complete"] is True and told["error"] is None and told["time_reached"] == 0.1
    assert told == json.loads((tmp_path / "out" / "summary.json").read_text())
    rows = {q["name"]: q for q in told["quantities"]}
    result = fa.Result.load(tmp_path / "out" / "run.npz")
    assert rows["link 0 revolute"]["final"] == result.q[-1, 0]
    assert rows["link 1 prismatic"]["unit"] == "m" and rows["link 1 prismatic force"]["unit"] == "N"
    assert rows["link 0 tip y deflection"]["minimum"] == result.tip_deflection(0)[:, 1].min()


def test_run_tells_its_error(scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told = answer(capsys, "run", str(scene), "--error", "-o", str(tmp_path / "out"))["estimate"]
    found = fa.load(scene).run().error()
    assert told["largest"] == pytest.approx(found.largest, rel=1e-3) and told["runs"] == found.runs
    assert [x["what"] for x in told["sources"]] == [x.what for x in found.sources]
    assert (tmp_path / "out" / "error.txt").read_text().startswith("tip: off by")
    assert (tmp_path / "out" / "error.png").stat().st_size > 1000


def test_run_keeps_what_was_computed_before_a_failure(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = fa.load(scene).run()
    half = replace(whole, **{k: getattr(whole, k)[:51] for k in ("t", "q", "v", "a", "tau")})

    def fail(*_: Any, **__: Any) -> fa.Result:
        raise fa.SimulationError("stopped at t = 0.0505 s: because", 0.0505, half)

    monkeypatch.setattr(fa.Scene, "run", fail)
    folder = tmp_path / "out"
    assert main(["run", str(scene), "-o", str(folder), "--json"]) == 1
    out, err = capsys.readouterr()
    assert "stopped at t = 0.0505 s: because" in err and str(folder) in err and err.count("\n") == 1
    told = json.loads(out)
    assert told["complete"] is False and told["time_reached"] == 0.0505
    assert fa.Result.load(folder / "run.npz").t[-1] == whole.t[50]


def test_a_rigid_arm_can_be_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "rigid.toml"
    path.write_text('[[link]]\njoint = { type = "fixed" }\nhub = { mass = 1.0, end = [1, 0, 0] }\n')
    told = answer(capsys, "run", str(path), "-o", str(tmp_path / "out"))
    assert told["quantities"] == [] and (tmp_path / "out" / "run.png").stat().st_size > 1000


# -- modes ---------------------------------------------------------------------------------------------------


def test_check_prints_what_run_counts(scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(scene)]) == 0 and capsys.readouterr().out == "nothing to remark\n"
    scene.write_text(PENDULUM.replace("density = 7850", "density = 7850e3").replace("mass = 0.1", "mass = 30"))
    assert main(["check", str(scene)]) == 0
    out, err = capsys.readouterr()
    found = out.splitlines()
    assert err == "" and len(found) == len(answer(capsys, "check", str(scene))) > 0
    assert "link[0].beam.material.density: 7.85e+06 kg/m^3: no solid is so dense; what is its unit?" in found
    assert main(["run", str(scene), "-o", str(tmp_path / "out")]) == 0
    said = f"{len(found)} remark{'s' * (len(found) > 1)}: flexarm check {scene}"
    assert capsys.readouterr().out.splitlines()[-1] == said
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["remarks"] == found


def test_modes_of_the_shipped_scene(capsys: pytest.CaptureFixture[str]) -> None:
    told = answer(capsys, "modes", "ist")
    assert told["lock"] == [0]  # prescribed by the scene
    np.testing.assert_allclose([m["frequency"] for m in told["modes"]], [20.948766, 131.283672, 367.598084], atol=6e-7)
    assert [m["largest_in"] for m in told["modes"]] == [f"link 0 bending_y {k}" for k in (1, 2, 3)]
    assert main(["modes", "ist"]) == 0
    first = next(line.split() for line in capsys.readouterr().out.splitlines() if "20.9488" in line)
    assert first[0] == "0"  # as modes.shapes[:, 0], modes.animate(0) and print(modes) count


def test_modes_take_speed_lock_and_count(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told = answer(capsys, "modes", "ist", "--speed", "0=10", "-n", "2")
    assert told["speed"] == {"0": 10.0}
    np.testing.assert_allclose([m["frequency"] for m in told["modes"]], [21.939904, 133.840341], atol=6e-7)
    free = answer(capsys, "modes", "ist", "--lock", "none")
    assert free["lock"] == [] and free["modes"][0]["frequency"] == 0 and len(free["modes"]) == 4
    assert answer(capsys, "modes", str(scene))["lock"] == [1]
    assert answer(capsys, "modes", str(scene), "--lock", "0", "--lock", "1")["lock"] == [0, 1]


def test_modes_stand_where_the_motion_starts(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The slider sits at 0.2 m, which lengthens the pendulum."""
    arm = fa.load(scene).arm
    q = np.zeros(arm.nq)
    q[arm.coordinates.index("link 1 prismatic")] = 0.2
    told = answer(capsys, "modes", str(scene))
    np.testing.assert_allclose([m["frequency"] for m in told["modes"]], arm.modes(q=q, lock=[1]).frequencies)


def test_modes_say_what_is_unstable(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (Path(fa.__file__).parent / "scenes" / "ist.toml").read_text().replace("order = 2", "order = 1")
    (tmp_path / "soft.toml").write_text(text)
    told = answer(capsys, "modes", str(tmp_path / "soft.toml"), "--speed", "0=21")
    assert told["stable"] is False and told["modes"][0]["frequency"] == 0
    assert main(["modes", str(tmp_path / "soft.toml"), "--speed", "0=21"]) == 0
    out = capsys.readouterr().out
    assert "grows" in out and "not stable" in out


# -- demo ----------------------------------------------------------------------------------------------------


def test_demo_in_json(demonstration: tuple[Any, Any]) -> None:
    done, told = demonstration
    assert told["agrees"] is True and told == json.loads((done.folder / "demo.json").read_text())
    assert all((done.folder / name).exists() for name in told["files"])


# -- bad input -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("argv", "says"),
    [
        ([], "COMMAND"),
        (["nope"], "'nope'"),
        (["run"], "SCENE"),
        (["run", "ist", "--nope"], "--nope"),
        (["run", "nope.toml"], "nope.toml"),
        (["modes", "nope.toml"], "shipped scenes are"),
        (["modes", "is"], "did you mean 'ist'?"),
        (["modes", "ist", "--speed", "0:10"], "--speed 0:10"),
        (["modes", "ist", "--speed", "x=10"], "--speed x=10"),
        (["modes", "ist", "--speed", "0=fast"], "--speed 0=fast"),
        (["modes", "ist", "--speed", "0=nan"], "nan"),
        (["modes", "ist", "--speed", "7=1"], "link = 7"),
        (["modes", "ist", "--speed", "0=1", "--speed", "0=2"], "twice"),
        (["modes", "ist", "--lock", "hub"], "--lock hub"),
        (["modes", "ist", "--lock", "7"], "link = 7"),
        (["modes", "ist", "-n", "0"], "-n 0"),
        (["modes", "ist", "-n", "few"], "few"),
    ],
)
def test_bad_options(argv: list[str], says: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert says in refused(capsys, *argv)


def test_an_unknown_key_names_the_nearest(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene.write_text(PENDULUM.replace("length", "lenght"))
    for command in ("run", "modes"):
        assert "'lenght'; did you mean 'length'?" in refused(capsys, command, str(scene))


def test_bad_toml_takes_one_line(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene.write_text("[[link]\n")
    assert "pendulum.toml" in refused(capsys, "run", str(scene))


def test_a_long_message_is_cut(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    many = ", ".join(["nan"] * 5000)
    scene.write_text(PENDULUM.replace("q = [0.2, 0.2]", f"q = [{many}]"))
    assert len(refused(capsys, "run", str(scene))) < 600


def test_a_folder_that_cannot_be_written(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for argv in (["demo"], ["run", str(scene)]):
        assert "is a file" in refused(capsys, *argv, "-o", str(scene))
        assert str(scene) in refused(capsys, *argv, "-o", str(scene / "below"))

    def denied(*_: Any, **__: Any) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("tempfile.TemporaryFile", denied)
    assert "Permission denied" in refused(capsys, "demo", "-o", str(tmp_path / "locked"))


def test_a_bad_scene_leaves_no_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    refused(capsys, "run", str(tmp_path / "nope.toml"), "-o", str(tmp_path / "out"))
    assert not (tmp_path / "out").exists()


def test_interrupt(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(fa.Scene, "run", interrupt)
    assert refused(capsys, "run", str(scene), "-o", str(tmp_path), code=130) == "flexarm: interrupted\n"


# -- the program ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "argv", [["--help"], *([command, "--help"] for command in ("demo", "run", "modes", "chart", "place"))]
)
def test_help(argv: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as done:
        main(argv)
    assert done.value.code == 0 and "usage: flexarm" in capsys.readouterr().out


def test_json_has_no_word_for_what_is_not_finite(monkeypatch: pytest.MonkeyPatch) -> None:
    """NaN and Infinity, which Python would write, are not JSON."""
    value = {"a": [math.nan, 1.5], "b": {"c": (-math.inf,)}}
    assert json.loads(_console.json_text(value)) == {"a": [None, 1.5], "b": {"c": [None]}}
    monkeypatch.setattr(_console, "finite", lambda x: x)  # should it ever miss one
    with refuses("JSON"):
        _console.json_text(value)


def test_long_work_without_a_terminal_writes_lines(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The first after 10 s, then one a minute, each with what is left if the work goes on as it did."""
    now = [0.0]
    monkeypatch.setattr(_console.time, "monotonic", lambda: now[0])
    with _console.progress_bar(True, "charting", 200.0) as tell:
        assert tell is not None
        for now[0] in range(0, 81, 5):
            tell(now[0], "a model")
    with _console.progress_bar(True, "identifying", None) as tell:
        assert tell is not None
        now[0] = 91.0
        tell(12, "12 runs")
    assert capsys.readouterr().err.splitlines() == [
        "flexarm: charting 5 % (a model): 10 s so far, about 190 s left",
        "flexarm: charting 35 % (a model): 70 s so far, about 130 s left",
        "flexarm: identifying (12 runs): 11 s so far",
    ]


def test_importing_flexarm_leaves_slow_packages_alone() -> None:
    slow = ("matplotlib", "rich", "scipy", "h5py")
    code = f"import sys, flexarm, flexarm.cli; print([m for m in {slow} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_plot_needs_no_display(scene: Path) -> None:
    run = fa.load(scene).run()
    figure = run.plot()
    assert [ax.get_ylabel() for ax in figure.axes] == [
        "Joint angle (rad)",
        "Joint displacement (m)",
        "Tip deflection (m)",
        "Joint force (N)",  # of the slide, which is driven; nothing acts on the hinge
    ]
    (force,) = figure.axes[-1].lines
    np.testing.assert_array_equal(force.get_ydata(), run.tau[:, run.arm.coordinates.index("link 1 prismatic")])
    assert not hasattr(figure, "number")  # pyplot does not know it


ROBOT = Path(__file__).parents[1] / "data" / "robots" / "six.urdf"


@pytest.mark.filterwarnings("ignore::flexarm.errors.RobotWarning")
def test_robots_files_are_scenes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """URDF and MJCF: at rest at zero, a second under gravity; tip names the end of a chain."""
    told = answer_quietly(capsys, "modes", str(ROBOT))
    joints = ["pan", "shoulder", "elbow", "wrist_a", "wrist_b", "wrist_c"]
    assert told["scene"] == "six" and told["coordinates"] == joints
    folder = tmp_path / "out"
    told = answer_quietly(capsys, "run", str(ROBOT), "--tip", "tool", "-o", str(folder))
    assert told["complete"] and told["time_reached"] == 1.0
    head = (folder / "run.csv").read_text().splitlines()[0].split(",")
    assert head[:3] == ["t", "q pan", "q shoulder"] and "tau elbow" in head and "revolute" not in " ".join(head)
    picture = tmp_path / "robot.png"
    assert answer_quietly(capsys, "view", str(ROBOT), "-o", str(picture))["frames"] == 1
    assert picture.read_bytes()[:4] == b"\x89PNG"
    tree = str(ROBOT.with_name("tree.urdf"))
    assert "mimic of 'grip_a'" in refused(capsys, "modes", tree)
    assert answer_quietly(capsys, "modes", tree, "--tip", "left_palm")["coordinates"][0] == "lift"
    assert "--tip tool: goes with a robot's file" in refused(capsys, "modes", "ist", "--tip", "tool")
    pytest.importorskip("mujoco")
    branched = answer_quietly(capsys, "modes", str(ROBOT.with_name("arm.xml")))["coordinates"]
    assert branched == ["pan", "lift", "elbow", "flap_hinge", "reach"]


def answer_quietly(capsys: pytest.CaptureFixture[str], *argv: str) -> Any:
    """As `answer`, of a robot, whose file says more than is read."""
    assert main([*argv, "--json"]) == 0
    out, err = capsys.readouterr()
    assert all(line.startswith("flexarm: warning: ") for line in err.splitlines())
    return json.loads(out)
