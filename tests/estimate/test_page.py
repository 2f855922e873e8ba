"""docs/online.md keeps what it says."""

from __future__ import annotations

import re
from collections.abc import Callable

from pages import ROOT, Ran


def test_numbers_of_the_page(page_of_docs: Callable[[str], Ran]) -> None:
    ran = page_of_docs("docs/online.md")
    names, text = ran.names, (ROOT / "docs" / "online.md").read_text(encoding="utf-8")
    told = re.search(r"# (payload [\d.]+ ± [\d.]+, damping.0 [\d.]+ ± [\d.]+)", text)
    assert told and told[1] in repr(names["found"])
    assert abs(names["found"].parameters["payload"][-1] / 0.15 - 1) < 0.02
    assert 0.8 < names["told"].consistency < 1.2
    assert names["covariance"].shape == (3, 3) and (ran.folder / "online.png").exists()
