"""docs/data.md keeps what it says."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from pages import Ran


def test_numbers_of_the_page(page_of_docs: Callable[[str], Ran]) -> None:
    ran = page_of_docs("docs/data.md")
    names = ran.names
    assert names["late"].lag(names["data"], "theta") == pytest.approx(0.0123, abs=1e-4)
    assert names["found"].nrmse["strain"] < 0.1 and names["found"].nrmse["joint"] < 1e-9
    files = {p.name for p in ran.folder.iterdir()}
    assert files >= {"run.csv", "run.h5", "run.mat", "rig.png", "compared.png"}
