"""The measured rig: deflections from currents and encoders against its strain gauges, which the filter does not see."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "bench" / "estimate"))

from online import measured


@pytest.mark.filterwarnings("ignore:dry friction of 'link 0")  # encoders hold the rig's joints where they rest
@pytest.mark.parametrize("name, most", [("lqr", 0.11), ("fsf", 0.25), ("psf", 0.2)])
def test_deflections_without_gauges(name: str, most: float) -> None:
    t, there, found = measured(name)
    apart = found - there
    assert t.size > 500 and there.std(axis=0).min() > 1e-3  # rad: it moves
    assert (apart.std(axis=0) < most * there.std(axis=0)).all()
