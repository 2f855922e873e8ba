"""The measured rig: deflections from currents and encoders against its strain gauges, which the filter does not see."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "bench" / "estimate"))

from online import measured


@pytest.mark.filterwarnings("ignore:dry friction of 'link 0")  # encoders hold the rig's joints where they rest
@pytest.mark.parametrize("name, share, most", [("lqr", 1.0, (0.12, 0.12)), ("psf", 0.35, (0.25, 0.25))])
def test_deflections_without_gauges(name: str, share: float, most: tuple[float, float]) -> None:
    t, there, found, _ = measured(name, share)
    apart = found - there
    assert t.size > 500 and there.std(axis=0).min() > 1e-3  # rad: it moves
    assert (apart.std(axis=0) < np.array(most) * there.std(axis=0)).all()
