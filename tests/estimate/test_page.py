"""docs/online.md keeps what it says."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "online.md"


def test_code_of_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    page = PAGE.read_text(encoding="utf-8")
    for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL):
        exec(block, names)
    told = re.search(r"# (payload [\d.]+ ± [\d.]+, damping.0 [\d.]+ ± [\d.]+)", page)
    assert told and told[1] in repr(names["found"])
    assert abs(names["found"].parameters["payload"][-1] / 0.15 - 1) < 0.02
    assert names["covariance"].shape == (3, 3) and (tmp_path / "online.png").exists()
