"""docs/robots.md keeps what it says."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("urdf_parser_py")
PAGE = Path(__file__).parents[2] / "docs" / "robots.md"


@pytest.mark.filterwarnings("ignore::flexarm.RobotWarning")
def test_code_of_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for block in re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL):
        exec(block, names)
    arm = names["arm"]
    assert arm.names == ("upper_arm", "forearm", "gripper") and arm["elbow"].joint.damping == 0.2
    np.testing.assert_allclose(arm.frame(arm.zero)[0], [0.4, 0.0, 0.8], atol=1e-15)
    assert np.abs(names["run"].tip_deflection("forearm")).max() > 1e-4
    assert "off" not in (text := (tmp_path / "arm.xml").read_text()) and 'name="forearm segment 10"' in text
