"""docs/invert.md keeps what it says."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "invert.md"


def test_code_of_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for block in re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL):
        exec(block, names)
    inverse = names["inverse"]
    assert abs(inverse.tip_error(names["run"])).max() < 1e-7
    assert abs(inverse.tau).max() == pytest.approx(0.349, abs=5e-4)
    assert inverse.pre == pytest.approx(0.33, abs=0.01) and (tmp_path / "inverse.png").stat().st_size > 10_000
