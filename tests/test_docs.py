"""README and docs keep what they say: code runs, names are complete, links and paths lead somewhere."""

from __future__ import annotations

import re
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import flexarm as fa
import numpy as np
import pytest
from pages import PAGES, ROOT, Ran

README = PAGES[0].read_text(encoding="utf-8")


def test_numbers_of_the_readme(page_of_docs: Callable[[str], Ran]) -> None:
    ran = page_of_docs("README.md")
    assert (ran.folder / "run.png").stat().st_size > 10_000
    told = re.search(r"# Hz: \[([\d. ]+)\]", README)
    assert told
    frequencies = ran.names["modes"].frequencies / (2 * np.pi)
    assert [f"{x:.4g}" for x in frequencies] == [f"{float(x):.4g}" for x in told[1].split()]
    assert 0.06 < abs(ran.names["run"].tip_deflection(1)[:, 1]).max() < 0.08  # m, as the picture shows


def test_the_first_program_prints_what_its_comments_show(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code = re.search(r"```python\n(.*?)```", README, re.DOTALL)
    assert code
    exec(code[1], {})
    shown = re.findall(r"^print.*# [^:\n]+: (.+)$", code[1], re.MULTILINE)
    assert len(shown) == 2 and capsys.readouterr().out.splitlines()[-2:] == shown


def test_readme_has_every_extra() -> None:
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    extras = re.search(r"^\[project.optional-dependencies\]\n(.*?)^\[", project, re.MULTILINE | re.DOTALL)
    assert extras
    names = set(re.findall(r"^(\w+) = ", extras[1], re.MULTILINE))
    assert names == set(re.findall(r"^\| `(\w+)` \|", README, re.MULTILINE))
    assert "pip install ./flexarm-" in README


def test_setup_of_a_bare_machine_is_told() -> None:
    assert "\n./setup.sh demo\n" in README and "\n./setup.sh test\n" in README


def test_reference_has_every_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "_site"))
    reference = import_module("reference")
    text = reference.PAGE.read_text(encoding="utf-8")
    assert reference.filled(text) == text, "run python docs/_site/reference.py"
    marks = set(re.findall("<!-- names: (.+) -->", text))
    headings = re.findall(r"\n\n(\w.*)\n    \w", fa.__doc__ or "")
    assert marks == {*headings, "fa.sections", "fa.sensors", "fa.results", "fa.errors"}
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
