"""What the command line gives beside simulations: examples, completion, the way to the documentation."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import flexarm as fa
import pytest
from flexarm.cli import main

ROOT = Path(__file__).parents[2]
DOCS = "https://flexarm.readthedocs.io"

COMMANDS = {"chart", "check", "demo", "economize", "examples", "identify", "modes", "place", "run", "validate", "view"}


def refused(capsys: pytest.CaptureFixture[str], *argv: str) -> str:
    assert main(argv) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("flexarm: ") and err.count("\n") == 1
    return err


# -- examples ------------------------------------------------------------------------------------------------


def test_examples_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["examples"]) == 0
    lines = capsys.readouterr().out.splitlines()
    names = sorted(p.stem for p in (ROOT / "examples").glob("*.py"))
    assert [line.split()[0] for line in lines[:10]] == names and "Two flexible links" in lines[0]
    assert main(["examples", "--json"]) == 0
    assert list(json.loads(capsys.readouterr().out)) == names


def test_examples_are_copied_with_what_they_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    one, every = tmp_path / "one", tmp_path / "every"
    assert main(["examples", "04_your_robot", "-o", str(one), "--json"]) == 0
    assert [Path(p).name for p in json.loads(capsys.readouterr().out)["files"]] == [
        "04_your_robot.py", "04_your_robot.urdf"
    ]  # fmt: skip
    assert main(["examples", "--all", "-o", str(every)]) == 0
    assert main(["examples", "--all", "-o", str(every)]) == 0  # once more changes nothing
    there = {p.name: p.read_bytes() for p in every.iterdir()}
    assert there == {p.name: p.read_bytes() for p in (ROOT / "examples").iterdir() if p.is_file()}
    assert (one / "04_your_robot.urdf").read_bytes() == there["04_your_robot.urdf"]


def test_a_copied_example_runs(tmp_path: Path) -> None:
    assert main(["examples", "03_spin_up", "-o", str(tmp_path)]) == 0
    command = [sys.executable, "-W", "error", "03_spin_up.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0 and done.stderr == "" and "exact" in done.stdout
    assert (tmp_path / "spin_up.png").stat().st_size > 10_000


def test_examples_keep_what_was_changed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "03_spin_up.py").write_text("mine")
    assert "03_spin_up.py" in refused(capsys, "examples", "03_spin_up", "-o", str(tmp_path))
    assert (tmp_path / "03_spin_up.py").read_text() == "mine"
    assert "'spin'" in refused(capsys, "examples", "spin")
    assert "did you mean '09_fit_a_payload'?" in refused(capsys, "examples", "09_fit")


# -- completion ----------------------------------------------------------------------------------------------


def completed(script: str, folder: Path, *words: str) -> list[str]:
    """What bash offers for the last word."""
    ask = 'COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); made=$(complete -p flexarm); made=${made#*-F }\n'
    ask += '"${made%% *}" flexarm "${COMP_WORDS[COMP_CWORD]}"; printf "%s\\n" "${COMPREPLY[@]}"'
    text = f"{script}\n{ask}\n"
    done = subprocess.run(["bash", "-c", text, "bash", *words], cwd=folder, capture_output=True, text=True, timeout=60)
    return done.stdout.split()


@pytest.mark.skipif(shutil.which("bash") is None, reason="SKIPPED, not passed: needs bash")
def test_bash_completes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", "bash"]) == 0
    script = capsys.readouterr().out
    assert subprocess.run(["bash", "-n"], input=script, text=True, timeout=60).returncode == 0
    for name in ("a.toml", "b.npz", "c.txt"):
        (tmp_path / name).touch()
    (tmp_path / "folder").mkdir()
    assert completed(script, tmp_path, "flexarm", "ru") == ["run"]
    assert set(completed(script, tmp_path, "flexarm", "")) >= COMMANDS
    scenes = ["ist", "ist_control", "quanser", "two_links"]
    assert completed(script, tmp_path, "flexarm", "run", "") == [*scenes, "a.toml", "folder"]
    assert completed(script, tmp_path, "flexarm", "run", "ist", "-o", "") == ["folder"]
    assert set(completed(script, tmp_path, "flexarm", "view", "b")) == {"b.npz"}
    assert completed(script, tmp_path, "flexarm", "modes", "ist", "--sp") == ["--speed"]
    for command in ("chart", "economize"):
        assert completed(script, tmp_path, "flexarm", command, "ist", "--quantity", "") == ["tip", "joint", "strain"]
    assert completed(script, tmp_path, "flexarm", "examples", "01_two_links", "03") == ["03_spin_up"]


@pytest.mark.parametrize("shell", ["zsh", "fish", "tcsh"])
def test_other_shells_know_the_commands(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    assert all(name in script for name in COMMANDS)
    if shell != "tcsh":
        assert "ist_control" in script
    if shell == "zsh":  # where brackets around a single pattern are a qualifier of files
        assert '_files -g "*.toml"' in script and '_files -g "(*.toml|*.npz' in script
    found = shutil.which(shell)
    if found and shell != "tcsh":
        assert subprocess.run([found, "-n", "/dev/stdin"], input=script, text=True, timeout=60).returncode == 0


def test_completion_names_shells(capsys: pytest.CaptureFixture[str]) -> None:
    assert "'ksh'" in refused(capsys, "completion", "ksh")


# -- where the documentation is ------------------------------------------------------------------------------


def test_version_and_help_name_the_documentation(capsys: pytest.CaptureFixture[str]) -> None:
    for option in ("--version", "--help"):
        with pytest.raises(SystemExit) as end:
            main([option])
        assert end.value.code == 0
        said = capsys.readouterr().out
        assert DOCS in said and (option == "--help" or said == f"flexarm {fa.__version__} {DOCS}\n")


def test_python_m_flexarm_is_the_command() -> None:
    done = subprocess.run([sys.executable, "-m", "flexarm", "--version"], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (0, f"flexarm {fa.__version__} {DOCS}\n", "")
    done = subprocess.run([sys.executable, "-m", "flexarm", "run"], capture_output=True, text=True, timeout=60)
    assert done.returncode == 2 and done.stderr.startswith("flexarm: ")
