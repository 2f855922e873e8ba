"""Writes the tables of names in docs/reference.md: `python docs/_site/reference.py`."""

import re
from pathlib import Path

import flexarm as fa
from flexarm import _face

PAGE = Path(__file__).parents[1] / "reference.md"


def _table(of: str) -> str:
    """Of a heading of flexarm's names, or of a list such as fa.sensors."""
    at = getattr(fa, of.removeprefix("fa."), fa)
    names = list(_face.public(at)) if at is not fa else _face.grouped(fa)[of]
    prefix = of if at is not fa else "fa"
    rows = [f"| `{prefix}.{name}` | {_face.sentence(getattr(at, name))} |" for name in names]
    return "\n".join(["| | |", "|-|-|", *rows, ""])


def filled(page: str) -> str:
    """The page with a new table below each mark."""
    return re.sub(r"(<!-- names: (.+?) -->\n)(?:\|.*\n)*", lambda m: m[1] + _table(m[2]), page)


if __name__ == "__main__":
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
