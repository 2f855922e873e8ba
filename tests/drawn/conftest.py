"""Counts of what was drawn: told at the end of a run. A property that refuses most of its draws fails."""

from __future__ import annotations

from collections.abc import Generator
from typing import Any

import pytest


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: Any) -> Generator[None, Any, Any]:
    count = getattr(item.function, "drawn", None)
    try:
        result = yield
    finally:
        if count is not None:
            item.user_properties.append(("drawn", dict(count)))
    if count is not None and 2 * count["refused"] > count["drawn"]:
        pytest.fail(f"{count['refused']} of {count['drawn']} draws were refused: too little is tried", pytrace=False)
    return result


def pytest_terminal_summary(terminalreporter: Any) -> None:
    rows = []
    for reports in terminalreporter.stats.values():
        for report in reports:
            for key, count in getattr(report, "user_properties", ()):
                if key == "drawn" and getattr(report, "when", "") == "call":
                    rows.append((report.nodeid.partition("tests/drawn/")[2], count))
    if not rows:
        return
    terminalreporter.section("drawn, and tried")
    for name, count in sorted(rows):
        drawn, refused = count.pop("drawn", 0), count.pop("refused", 0)
        more = "".join(f", {n} {what}" for what, n in count.items())
        terminalreporter.line(f"{drawn - refused:6} of {drawn}: {name}{more}")
