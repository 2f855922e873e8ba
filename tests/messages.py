"""Errors and warnings, tested for the field, the value and the right value that they name, not for their sentences."""

from __future__ import annotations

import re
from typing import Any

import pytest


def naming(*named: Any) -> str:
    """The regular expression of a text that holds each of these as whole words, in any order; a tuple stands for its
    parts. A decimal fraction may have more digits in the text."""
    texts = [str(part) for one in named for part in (one if isinstance(one, tuple) else (one,))]
    assert texts and all(texts)
    found = r"(?s)\A"
    for text in texts:
        start = r"(?<!\w)" if text[0].isalnum() else ""
        end = r"(?!\w)" if text[-1].isalnum() and not re.search(r"\.\d+$", text) else ""
        found += f"(?=.*{start}{re.escape(text)}{end})"
    return found


def refuses(*named: Any, error: Any = ValueError) -> Any:
    """A context like `pytest.raises`: an error that names these."""
    return pytest.raises(error, match=naming(*named))


def warns(category: type[Warning], *named: Any) -> Any:
    """A context like `pytest.warns`: a warning that names these."""
    return pytest.warns(category, match=naming(*named))
