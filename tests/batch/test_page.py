"""docs/gradients.md keeps what it says."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

PAGE = Path(__file__).parents[2] / "docs" / "gradients.md"


def test_code_of_the_page_runs() -> None:
    text = PAGE.read_text(encoding="utf-8")
    names: dict[str, Any] = {}
    ran = 0
    for block in re.findall(r"```python\n(.*?)```", text, re.DOTALL):
        missing = [x for x in ("torch", "jax") if f"import {x}\n" in block and not importlib.util.find_spec(x)]
        if missing:
            continue
        try:
            exec(block, names)
        finally:
            if "jax" in names:
                names["jax"].config.update("jax_enable_x64", False)
        ran += 1
        if ran == 1:
            for k, path in enumerate(names["paths"]):
                assert names["g"][path] == pytest.approx(names["s"].q[k, -1, 0], rel=1e-8)
            assert names["g"]["drive.0.samples"].shape == (4,) and names["tip"].shape == (3, 101)
        if ran == 2:
            assert names["g"].parameters["gravity"].shape == (3,)
    assert ran >= 2
    if "masses" in names:
        assert names["masses"].grad.shape == (5,) and abs(names["masses"].grad).min() > 0
    if "by_tau" in names:
        assert names["by_tau"].shape == (100, names["arm"].nv) and np.isfinite(names["by_mass"])
