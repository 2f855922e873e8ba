"""Tutorials: notebooks without outputs, so that changes read well; the build of the site runs them (docs/conf.py)."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

DOCS = Path(__file__).parents[2] / "docs"
NOTEBOOKS = sorted((DOCS / "tutorials").glob("*.ipynb"), key=lambda p: int(p.stem.partition("-")[0]))
each = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)


def read(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text(encoding="utf-8"))


def words(path: Path) -> str:
    """All of its text, without code."""
    return "\n\n".join("".join(c["source"]) for c in read(path)["cells"] if c["cell_type"] == "markdown")


def test_numbers_make_an_order() -> None:
    numbers = [int(path.stem.partition("-")[0]) for path in NOTEBOOKS]
    assert len(numbers) >= 5 and numbers == list(range(1, len(numbers) + 1))


@each
def test_no_outputs_are_kept(path: Path) -> None:
    notebook = read(path)
    code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert code and all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code)
    assert notebook["metadata"]["kernelspec"]["name"] == "python3"
    ids = [cell["id"] for cell in notebook["cells"]]
    assert len(set(ids)) == len(ids)


@each
def test_it_begins_with_what_one_learns_and_how_long_it_takes(path: Path) -> None:
    first = "".join(read(path)["cells"][0]["source"])
    assert first.startswith(f"# {path.stem.partition('-')[0]}. ")
    assert "**You will learn** " in first and re.search(r"\*\*It takes\*\* about \d+ minutes", first)
    text = words(path).lower()
    assert "what you learned" in text and "exercises" in text and "<details>" in text


@each
def test_links_lead_somewhere(path: Path) -> None:
    links = re.findall(r"\]\(([^)#:\s]+)[^):]*\)", words(path))
    assert len(links) >= 2
    assert not [link for link in links if not (path.parent / link).exists()]


@each
def test_a_page_leads_to_it(path: Path) -> None:
    pages = [page.read_text(encoding="utf-8") for page in DOCS.glob("*.md")]
    assert any(f"tutorials/{path.name}" in text for text in pages)
