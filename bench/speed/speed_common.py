"""What the programs behind docs/speed.md share: its sections, tables, environments of peers."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

matplotlib.use("Agg")
from matplotlib.figure import Figure
from peers import machine, python_of

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "speed.md"

__all__ = ["ROOT", "Figure", "Table", "about", "keep", "machine", "python_of", "ratio", "table", "text", "verdict"]

Table = Sequence[Sequence[Any]]


def about(**versions: str) -> str:
    """Processor, commit and versions, for the end of a section."""
    m = machine()
    return ", ".join([m["cpu"], f"commit {m['commit']}", *(f"{k} {v}" for k, v in versions.items())])


def text(x: Any, digits: int = 3) -> str:
    """A number with so many digits; nothing for None and nan."""
    if isinstance(x, float):
        return "–" if np.isnan(x) else f"{x:.{digits}g}" if abs(x) < 10**digits else f"{x:.0f}"
    return "–" if x is None else str(x)


def table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Markdown; numbers to three digits."""
    lines = [head, ["-"] * len(head), *rows]
    return "\n".join("| " + " | ".join(text(x) for x in line) + " |" for line in lines)


def verdict(measured: float, aim: float, *, below: bool = True) -> str:
    """Whether an aim is met, and by how much it is missed."""
    factor = measured / aim if below else aim / measured
    return "met" if factor <= 1 else f"missed, by a factor of {text(factor)}"


def ratio(measured: float, aim: float, *, below: bool) -> str:
    """A ratio beside its aim."""
    if np.isnan(measured):
        return f"aim {text(aim)}: not measured"
    return f"**{text(measured)}** (aim {'≤' if below else '≥'} {text(aim)}: {verdict(measured, aim, below=below)})"


def keep(name: str, words: str, rows: list[dict[str, Any]], figure: Figure | None, folder: Path | None) -> None:
    """Prints the words; writes NAME.csv and NAME.png into the folder or, without one, into docs/figures, and the words
    between NAME's marks of docs/speed.md."""
    print(words)
    out = folder or ROOT / "docs" / "figures"
    out.mkdir(parents=True, exist_ok=True)
    with (out / f"{name}.csv").open("w", newline="", encoding="utf-8") as f:
        writer = csv.DictWriter(f, list(dict.fromkeys(k for row in rows for k in row)), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    if figure:
        figure.savefig(out / f"{name}.png", dpi=110)
    if folder:
        return
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    page = PAGE.read_text(encoding="utf-8")
    if begin not in page:
        raise SystemExit(f"{PAGE} has no mark {begin}")
    head, rest = page.split(begin)
    PAGE.write_text(f"{head}{begin}\n{words}\n{end}{rest.split(end)[1]}", encoding="utf-8")
