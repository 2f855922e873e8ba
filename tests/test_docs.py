"""README and docs keep what they say: code runs, names are complete, links and paths lead somewhere."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
README = PAGES[0].read_text(encoding="utf-8")
COMPILER = os.environ.get("CXX") or shutil.which("c++")


def blocks(language: str, text: str = README) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)


def test_python_of_the_readme_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for block in blocks("python"):
        exec(block, names)
    assert (tmp_path / "run.png").stat().st_size > 10_000
    told = re.search(r"# Hz: ([\d. ]+)", README)
    assert told
    frequencies = names["modes"].frequencies / (2 * np.pi)
    assert [f"{x:.4g}" for x in frequencies] == told[1].split()
    assert 0.06 < abs(names["run"].tip_deflection(1)[:, 1]).max() < 0.08  # m, as the picture shows


def test_cpp_of_the_readme_compiles(tmp_path: Path) -> None:
    eigen = [p for p in ("/usr/include/eigen3", "/usr/local/include/eigen3") if Path(p).exists()]
    if not (COMPILER and eigen):
        pytest.skip("SKIPPED, not passed: needs a C++ compiler and Eigen")
    headers = {p.parent.parent for p in (ROOT / "cpp").glob("**/flexarm/*.hpp")}
    for block in blocks("cpp"):
        flags = ["-DFLEXARM_SCENES"]
        flags += [word for place in (*eigen, *sorted(headers)) for word in ("-isystem", str(place))]
        done = subprocess.run(
            [COMPILER, "-std=c++17", "-fsyntax-only", *flags, "-x", "c++", "-"],
            input=block, capture_output=True, text=True, timeout=300,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr[-2000:]


def test_setup_of_a_bare_machine_is_told() -> None:
    assert "    ./setup.sh demo\n" in README and "    ./setup.sh test\n" in README


def test_reference_has_every_name() -> None:
    text = (ROOT / "docs" / "reference.md").read_text(encoding="utf-8")
    told = set(re.findall(r"fa\.(\w+)", text))
    assert set(dir(fa)) - {"__version__"} == told
    arm = {name for name in vars(fa.Arm) if not name.startswith("_")}
    assert arm <= set(re.findall(r"\w+", text))


def _anchors(page: Path) -> set[str]:
    """Of its headings, as GitHub makes them."""
    heads = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_links_and_paths_lead_somewhere(page: Path) -> None:
    text, lost = page.read_text(encoding="utf-8"), []
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        file, _, anchor = link.partition("#")
        target = page.parent / file if file else page
        if not file.startswith("http") and not (target.exists() and (not anchor or anchor in _anchors(target))):
            lost.append(link)
    for path in re.findall(r"(?<![\w/.-])((?:bench|tests|python|cpp|docs)/[\w/.-]*\w)", text):
        placeholder = re.search(r"/[A-Z]+(/|$)", path)  # cpp/ROOM
        lost += [] if placeholder or (ROOT / path).exists() else [path]
    assert not lost
