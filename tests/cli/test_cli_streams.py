"""The command line where its streams are closed, full, left, or ASCII, and with titles that other programs read."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from flexarm.cli import main

ARM = """
[[link]]
joint = { type = "revolute", axis = "z" }
tip = { mass = 1.0, inertia = [1, 1, 1] }
[simulation]
duration = 0.1
"""


def titled(folder: Path, title: str) -> Path:
    (folder / "scene.toml").write_text(f"title = {json.dumps(title, ensure_ascii=False)}\n{ARM}", encoding="utf-8")
    return folder / "scene.toml"


def shell(command: str, folder: Path, **env: str) -> subprocess.CompletedProcess[str]:
    """`flexarm` is the program; the folder's scene.toml is there."""
    run = command.replace("flexarm", f"'{sys.executable}' -m flexarm")
    return subprocess.run(
        ["bash", "-c", run], cwd=folder, capture_output=True, encoding="utf-8", env={**os.environ, **env}, timeout=60
    )


TITLES = ["[red]fast[/red] arm :smile:", "[/nonsense]", "$5 and $x_{ a\\b"]


@pytest.mark.parametrize("title", TITLES)
def test_a_title_is_shown_as_it_is(title: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = titled(tmp_path, title)
    assert main(["run", str(scene), "-o", str(tmp_path / "out")]) == 0
    assert title in capsys.readouterr().out
    assert title in (tmp_path / "out" / "summary.txt").read_text(encoding="utf-8")


@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- <&- 2>&-"])
def test_closed_streams_change_nothing(closed: str, tmp_path: Path) -> None:
    titled(tmp_path, "arm")
    done = shell(f"flexarm run scene.toml -o out {closed}", tmp_path)
    assert done.returncode == 0 and "Error" not in done.stderr
    assert (tmp_path / "out" / "run.npz").stat().st_size > 1000
    if closed == "2>&-":
        assert shell(f"flexarm run nope.toml -o out {closed}", tmp_path).returncode == 2


@pytest.mark.skipif(sys.platform == "win32", reason="has no signals of this kind")
@pytest.mark.parametrize("command", [["-m", "flexarm"], ["flexarm"], ["-c", "import flexarm"]])
def test_ctrl_c_while_the_libraries_are_loaded(command: list[str], tmp_path: Path) -> None:
    """Which takes longer than most commands. A program that imports flexarm gets its KeyboardInterrupt."""
    fake = "import os, signal, time\nos.kill(os.getpid(), signal.SIGINT)\ntime.sleep(60)"
    (tmp_path / "numpy.py").write_text(fake)
    (tmp_path / "flexarm").write_text("import sys\nfrom flexarm.cli import main\nsys.exit(main())")
    found = os.pathsep.join([str(tmp_path), *sys.path])
    done = subprocess.run(
        [sys.executable, *command, *["--version"] * (command[0] != "-c")], cwd=tmp_path, capture_output=True, text=True,
        env={**os.environ, "PYTHONPATH": found, "PYTHONSAFEPATH": "1"}, timeout=60,
    )  # fmt: skip
    if command[0] == "-c":
        assert "KeyboardInterrupt" in done.stderr
    else:
        assert (done.returncode, done.stdout, done.stderr) == (130, "", "flexarm: interrupted\n")


def test_a_reader_that_leaves(tmp_path: Path) -> None:
    titled(tmp_path, "arm")
    done = shell("set -o pipefail; flexarm run scene.toml -o out | head -c 1", tmp_path)
    assert done.returncode == 0 and done.stderr == ""


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_a_full_disk_takes_one_line(tmp_path: Path) -> None:
    titled(tmp_path, "arm")
    done = shell("flexarm run scene.toml -o out > /dev/full", tmp_path)
    assert done.returncode == 2 and done.stderr == "flexarm: file: No space left on device\n"
    assert shell("flexarm run nope.toml -o out 2> /dev/full", tmp_path).returncode == 2


@pytest.mark.parametrize("command", ["flexarm run scene.toml -o out", "flexarm modes scene.toml --lock none"])
def test_an_ascii_terminal(command: str, tmp_path: Path) -> None:
    titled(tmp_path, "Träger 漢")
    text = (tmp_path / "scene.toml").read_text(encoding="utf-8")
    spring = text.replace('axis = "z"', 'axis = "z", stiffness = 4.0')
    (tmp_path / "scene.toml").write_text(spring, encoding="utf-8")
    done = shell(command, tmp_path, PYTHONIOENCODING="ascii")
    assert done.returncode == 0 and done.stderr == "" and "Tr\\xe4ger" in done.stdout
    assert shell(command.replace("scene", "Ä"), tmp_path, PYTHONIOENCODING="ascii").returncode == 2


DEEP = "[" * 5000 + "]" * 5000


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("duration = 0.1", "duration = 1e308"), "must divide the duration"),
        (("duration = 0.1", "duration = 0.1\ninterval = 5e-324"), "must divide the duration"),
        (("mass = 1.0", f"mass = {'9' * 400}"), "is too large"),
        (("mass = 1.0", f"mass = {'9' * 5000}"), "scene"),
        (("[1, 1, 1]", DEEP), "nested too deeply"),
        (("[[link]]", f"gravity = {DEEP[4900:-4900]}\n[[link]]"), "gravity"),
    ],
    ids=lambda x: "" if isinstance(x, tuple) else x,
)
def test_absurd_numbers_take_one_line(
    change: tuple[str, str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "scene.toml").write_text(ARM.replace(*change))
    assert main(["run", str(tmp_path / "scene.toml"), "-o", str(tmp_path)]) == 2
    out, err = capsys.readouterr()
    assert out == "" and says in err and err.count("\n") == 1 and len(err) < 600


def test_a_speed_without_bounds_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["modes", "ist", "--speed", "0=1e200"]) == 2
    assert "speed, q: are too large" in capsys.readouterr().err
