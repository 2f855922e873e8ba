"""docs/robots.md keeps what it says."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from pages import Ran


def test_numbers_of_the_page(page_of_docs: Callable[[str], Ran]) -> None:
    ran = page_of_docs("docs/robots.md")
    arm = ran.names["arm"]
    assert arm.names == ("upper_arm", "forearm", "gripper") and arm["elbow"].joint.damping == 0.2
    np.testing.assert_allclose(arm.frame(arm.zero)[0], [0.4, 0.0, 0.8], atol=1e-15)
    assert np.abs(ran.names["run"].tip_deflection("forearm")).max() > 1e-4
    assert "off" not in (text := (ran.folder / "arm.xml").read_text()) and 'name="forearm segment 10"' in text
    assert ran.names["whole"].parents == (-1, 0, 0)
    assert ran.names["ends"].names == ("torso", "left", "left tip", "right")
