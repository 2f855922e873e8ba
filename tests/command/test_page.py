"""docs/invert.md keeps what it says."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from pages import Ran


def test_numbers_of_the_page(page_of_docs: Callable[[str], Ran]) -> None:
    ran = page_of_docs("docs/invert.md")
    inverse = ran.names["inverse"]
    assert abs(inverse.tip_error(ran.names["run"])).max() < 1e-7
    assert abs(inverse.tau).max() == pytest.approx(0.349, abs=5e-4)
    assert inverse.pre == pytest.approx(0.33, abs=0.01) and (ran.folder / "inverse.png").stat().st_size > 10_000
