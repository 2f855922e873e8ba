"""Tables in text files: any of the common separators, decimal points or commas, headings, comments."""

import codecs
import csv
import io
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .._check import Array
from .store.files import Refused

_NOTHING = ("", "nan", "na", "n/a", "null", "none", "-", "--", "#n/a")  # where a value is missing
_COMMENTS = ("#", "%", "//")
_BOMS = {codecs.BOM_UTF8: "utf-8-sig", codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}


class Table(NamedTuple):
    """Columns of cells as they stand in a file, or of numbers (n, k), under their headings."""

    headings: list[str]
    units: list[str] | None  #: of a line of their own below the headings; None without one
    cells: Array | list[tuple[str, ...]]
    lines: list[int]  #: that each row stands in, from 1

    def column(self, k: int, name: str) -> Array:
        """Column k in numbers, nan where there is none. ValueError if a cell is no number."""
        if isinstance(self.cells, np.ndarray):
            return self.cells[:, k]
        return self._numbers([row[k] for row in self.cells], name)

    def _numbers(self, texts: list[str], name: str) -> Array:
        commas = any("," in x for x in texts)
        if commas:
            both = next((i for i, x in enumerate(texts) if "." in x), None)
            if both is not None:
                other = next(x for x in texts if "," in x)
                where = f"column '{name}', line {self.lines[both]}"
                raise Refused(f"{where}: {texts[both]!r} has a decimal point, and {other!r} a comma")
            texts = [x.replace(",", ".") for x in texts]
        out = np.empty(len(texts))
        for i, x in enumerate(texts):
            value = _value(x)
            if value is None:
                more = "; columns= can leave the column out"
                raise Refused(f"column '{name}', line {self.lines[i]}: {x!r} is not a number{more}")
            out[i] = value
        return out


def _value(text: str) -> float | None:
    bare = text.strip()
    if bare.lower() in _NOTHING:
        return float("nan")
    try:
        return None if "_" in bare else float(bare)
    except ValueError:
        return None


def _is_number(text: str) -> bool:
    return bool(text.strip()) and _value(text.replace(",", ".")) is not None


def read_table(path: Path) -> Table:
    """For use in `readable`."""
    raw = path.read_bytes()
    code = next((code for mark, code in _BOMS.items() if raw.startswith(mark)), "utf-8")
    if code != "utf-16" and b"\x00" in raw:
        raise Refused("is no text: it holds zero bytes (text in UTF-16 needs a byte order mark)")
    try:
        text = raw.decode(code)
    except UnicodeDecodeError:
        text = raw.decode("cp1252", errors="replace")
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    told = re.fullmatch(r"\s*sep=(.)\s*", lines[0])  # Excel's own
    content, comment = list[tuple[int, str]](), ""
    for i, line in enumerate(lines[1:] if told else lines, 2 if told else 1):
        bare = line.strip()
        if bare.startswith(_COMMENTS):
            comment = comment if content else bare.lstrip("#%/ \t")
        elif bare:
            content.append((i, line))
    if not content:
        raise Refused("is empty: it has no line of names, and no rows")
    return _parsed(content, comment, told[1] if told else _separator(content[0][1]))


def _separator(line: str) -> str:
    """Of the cells of a line; " " stands for any white space."""
    bare = re.sub(r'"[^"]*"|\[[^\]]*\]|\([^)]*\)', "", line.strip(" "))
    return next((mark for mark in "\t;, " if mark in bare), ",")


def _split(lines: list[str], separator: str, names: bool = False) -> list[list[str]]:
    if separator == " ":
        within = r'"[^"]*"|\S+\s*(?:\[[^\]]*\]|\([^)]*\))|\S+' if names else r"\S+"
        return [re.findall(within, line) for line in lines]
    return [[x.strip() for x in row] for row in csv.reader(lines, delimiter=separator, skipinitialspace=True)]


def _parsed(content: list[tuple[int, str]], comment: str, separator: str) -> Table:
    first = _split([content[0][1]], separator, names=True)[0]
    units = None
    if any(x and not _is_number(x) for x in first):
        headings, content = first, content[1:]
    else:
        headings = _split([comment], _separator(comment), names=True)[0] if comment else []
        if len(headings) != len(first):
            raise Refused(
                f"line {content[0][0]} has numbers, and no line before it tells names: the first line must, such as "
                "'time [s], theta [deg]'"
            )
    if content:
        second = _split([content[0][1]], separator)[0]
        if len(second) == len(headings) and any(second) and not any(map(_is_number, second)):
            units = [re.sub(r"^[\[(](.*)[\])]$", r"\1", x) for x in second]
            units = ["" if x in ("-", "--") else x for x in units]
            content = content[1:]
    if not content:
        raise Refused(f"has no rows: only the names {', '.join(headings)}")
    lines, rows = [i for i, _ in content], [line for _, line in content]
    headings = _without_last_empty(headings, rows, separator)
    cells = _fast(rows, separator, len(headings))
    return Table(headings, units, _slow(rows, lines, separator, headings) if cells is None else cells, lines)


def _without_last_empty(headings: list[str], rows: list[str], separator: str) -> list[str]:
    """Headings without the empty one that a separator at the end of each line makes, and names for the others."""
    if len(headings) > 1 and not headings[-1] and all(row.rstrip(" ").endswith(separator) for row in rows):
        headings = headings[:-1]
    return [name or f"column {k}" for k, name in enumerate(headings, 1)]


def _fast(rows: list[str], separator: str, width: int) -> Array | None:
    """All numbers at once; None where they are not plain ones."""
    if separator != "," and any("," in row for row in rows):
        if any("." in row for row in rows):
            return None
        rows = [row.replace(",", ".") for row in rows]
    try:
        mark = None if separator == " " else separator
        out = np.loadtxt(io.StringIO("\n".join(rows)), delimiter=mark, comments=None, ndmin=2)
    except ValueError:
        return None
    return out if out.shape == (len(rows), width) else None


def _slow(rows: list[str], lines: list[int], separator: str, headings: list[str]) -> list[tuple[str, ...]]:
    out, width = list[tuple[str, ...]](), len(headings)
    for line, cells in zip(lines, _split(rows, separator), strict=True):
        if len(cells) == width + 1 and not cells[-1]:
            cells = cells[:-1]
        if len(cells) != width:
            commas = separator == "," and len(cells) == 2 * width
            hint = "; are these decimal commas? Then another separator, such as ';', must part the cells" * commas
            names = f" ({', '.join(headings)})" * (width < 8)
            raise Refused(f"line {line}: there are {len(cells)} cells, and {width} names{names}{hint}")
        out.append(tuple(cells))
    return out


def columns_of(table: Table) -> list[tuple[str, str | None]]:
    """Heading and unit of each column; where a line of units tells one, it counts."""
    if table.units is None:
        return [(head, None) for head in table.headings]
    return [(head, of or None) for head, of in zip(table.headings, table.units, strict=True)]
