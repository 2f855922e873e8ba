"""docs/gradients.md keeps what it says."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from pages import Ran


def test_numbers_of_the_page(page_of_docs: Callable[[str], Ran]) -> None:
    ran = page_of_docs("docs/gradients.md")
    first, names = ran.states[0], ran.names
    for k, path in enumerate(first["paths"]):
        assert first["g"][path] == pytest.approx(first["s"].q[k, -1, 0], rel=1e-8)
    assert first["g"]["drive.0.samples"].shape == (4,) and first["tip"].shape == (3, 101)
    rolled = next(s["g"] for s in ran.states if hasattr(s["g"], "parameters"))
    assert rolled.parameters["gravity"].shape == (3,)
    if "masses" in names:
        assert names["masses"].grad.shape == (5,) and abs(names["masses"].grad).min() > 0
    if "by_tau" in names:
        assert names["by_tau"].shape == (100, names["arm"].nv) and np.isfinite(names["by_mass"])
    if "plan" in names:
        planned = names["plan"].value(names["x"])[: names["n"]].T
        np.testing.assert_allclose(names["same"].q[0], planned, atol=1e-6)
        missed = names["fine"].q[0, -1, names["motors"]] - names["goal"][names["motors"]]
        assert 1e-3 < np.abs(missed).max() < 0.02
