"""Samples of laws of time: in place, or in a CSV file that a scene names."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from ..._check import Array, array, known_keys


class Files(NamedTuple):
    """Files that a scene names: relative to `base`, inside `allowed`."""

    base: Path
    allowed: Path

    def path(self, where: str, name: Any) -> Path:
        """The path of a file that may be read. ValueError, without details, for any other."""
        try:
            path: Path = (self.base / name).resolve()  # links are followed before the check
            allowed = self.allowed.resolve()
        except (TypeError, OSError, RuntimeError, ValueError):  # not a string, too long, circular links, a NUL
            raise ValueError(f"{where} = {name!r}: must be the name of a file") from None
        if not path.is_relative_to(allowed):
            raise ValueError(
                f"{where} = {name!r}: must be in the scene's folder, {str(self.allowed)!r}, or below; "
                "load(..., files=FOLDER) allows another"
            )
        return path


def samples(where: str, table: Mapping[str, Any], columns: tuple[str, ...], files: Files) -> dict[str, Array]:
    """Columns given in place or in a CSV file with a header line. Errors do not show the file's content: their reader
    may lack the right to see it."""
    known_keys(where, table, (*columns, "file"))
    if "file" not in table:
        return {k: array(f"{where}.{k}", v) for k, v in table.items()}
    path, where = files.path(f"{where}.file", table["file"]), f"{where}.file = {str(table['file'])!r}"
    try:
        if path.exists() and not path.is_file():  # reading a pipe would block
            raise ValueError(f"{where}: is not a file")
        with path.open(newline="", encoding="utf-8-sig") as f:
            rows = list(csv.DictReader(f, skipinitialspace=True))
    except OSError as e:
        raise ValueError(f"{where}: {e.strerror}") from None
    except (UnicodeDecodeError, csv.Error):
        raise ValueError(f"{where}: is not a table of comma-separated values in UTF-8") from None
    if not rows:
        raise ValueError(f"{where}: has no rows")
    if any(name not in columns for name in rows[0] if name is not None):
        raise ValueError(f"{where}: its first line must name columns, of {', '.join(columns)}")
    if any(None in row for row in rows):
        raise ValueError(f"{where}: a row has more columns than the header")
    found = {}
    for k in rows[0]:
        try:
            found[k] = array(k, [row[k] for row in rows])
        except ValueError:
            raise ValueError(f"{where}: column {k} must be finite numbers, one in each row") from None
    return found
