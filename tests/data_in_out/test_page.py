"""docs/data.md keeps what it says."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "data.md"


def test_code_of_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for block in re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL):
        exec(block, names)
    assert names["late"].lag(names["data"], "theta") == pytest.approx(0.0123, abs=1e-4)
    assert names["found"].nrmse["strain"] < 0.1 and names["found"].nrmse["joint"] < 1e-9
    assert {p.name for p in tmp_path.iterdir()} >= {"run.csv", "run.h5", "run.mat", "rig.png", "compared.png"}
