"""The file of many scenarios (HDF5): written bit by bit, and continued where it was left.

Each array has a row for each scenario and lies in one piece of the file, full of blanks, from the beginning. Later only
rows are written, in place: the structure of the file never changes, whenever the process is killed. "checksum" (B,),
which is written last, is the CRC-32 of all that the file holds of a scenario, and 0 until it is done. The data that all
scenarios have in common are written once; the attribute "digest" is their checksum.
"""

import json
import os
import zlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .files import Refused, check_digest, check_space, check_unused, digest, label, named, readable, texts, write_whole
from .fingerprint import difference

_BLOCK = 1 << 22  # bytes that are blanked at once
_ROOM = 1 << 18  # bytes for the tables of HDF5


class Column(NamedTuple):
    """An array of such a file: shape of a scenario's row, type, its content until the scenario is done, and names and
    units of its last axis."""

    shape: tuple[int, ...]
    kind: str
    blank: Any
    titles: Sequence[tuple[str, str]] = ()

    def blanks(self, count: int) -> Any:
        """So many rows that are not done."""
        return np.full((count, *self.shape), self.blank, self.kind)


_CHECKSUM = {"checksum": Column((), "<u4", 0)}


def _checksums(arrays: Mapping[str, Any], only: NDArray[np.bool_] | None = None) -> NDArray[np.uint32]:
    """The checksum of each row of these arrays (n, ...) together, which is never 0; or of some rows alone."""
    held = [np.ascontiguousarray(arrays[k]) for k in sorted(arrays)]
    out = np.zeros(len(held[0]), np.uint32)
    for i in range(len(out)) if only is None else np.flatnonzero(only):
        found = 0
        for x in held:
            found = zlib.crc32(x[i : i + 1].data, found)
        out[i] = found or 1
    return out


def _unlike(arrays: Mapping[str, Any], columns: Mapping[str, Column], verify: bool = True) -> tuple[Any, Any, Any]:
    """The rows that are not done; the indices of those among them that are not blank, as after a kill; and the indices
    of rows that are done and do not have their checksum, which are not looked for without `verify`."""
    marks, data = np.array(arrays["checksum"]), {k: x for k, x in arrays.items() if k not in _CHECKSUM}
    left = marks == 0
    blank = _checksums({k: columns[k].blanks(1) for k in data})[0]
    unlike = _checksums(data, None if verify else left) != np.where(left, blank, marks)
    return left, np.flatnonzero(left & unlike), np.flatnonzero(~left & unlike if verify else left & ~left)


def _mapped(f: Any, path: Path) -> dict[str, Any]:
    """All data sets that lie in one piece of this file, by name, mapped from it. Links, external and virtual storage,
    and filters, which may load a library, are not followed."""
    import h5py

    size, out = os.path.getsize(path), dict[str, Any]()

    def visit(name: str, x: Any) -> None:
        if isinstance(x, h5py.Dataset) and x.dtype.kind in "fiuS":
            offset, count = x.id.get_offset(), int(np.prod(x.shape, dtype=object))
            if not count:
                out[name] = np.empty(x.shape, x.dtype)
            elif offset is not None and offset + count * x.dtype.itemsize <= size:
                out[name] = np.memmap(path, x.dtype, "r", offset, x.shape)

    f.visititems(visit)
    return out


def _open(path: Path, advice: str = "") -> tuple[dict[str, Any], dict[str, Any], dict[str, Column], dict[str, Any]]:
    """The file's "about", the arrays that are written once, its columns, and their arrays, mapped from the file."""
    import h5py

    with h5py.File(path, "r") as f:
        held, told = _mapped(f, path), f.attrs.get("digest")
        about = {k: json.loads(held[k].tobytes()) for k in ("fingerprint", "about") if k in held}
    version = next((x["flexarm"] for x in about.values() if "flexarm" in x), None)
    if told is None or "columns" not in about.get("about", {}):
        older = f", or one of flexarm {version}, which wrote other files" if version else ""
        raise Refused(f"is not a file of a batch or a sweep{older}{advice}")
    words, columns = about["about"], {k: Column(*x) for k, x in about["about"]["columns"].items()}
    fixed = {k: x for k, x in held.items() if k not in columns and k != "about"}
    check_digest(told, words, fixed)
    for k, x in columns.items():
        if k not in held:
            raise Refused(f"{k!r} is missing, or does not lie in one piece of this file{advice}")
        if (held[k].shape, held[k].dtype) != ((words["count"], *x.shape), np.dtype(x.kind)):
            raise Refused(f"{k!r} is {held[k].dtype} {held[k].shape}, and not as it was written{advice}")
    return words, {k: np.array(x) for k, x in fixed.items()}, columns, {k: held[k] for k in columns}


def read_scenarios(
    path: Path, rows: slice = slice(None), verify: bool = True
) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any], NDArray[np.bool_]]:
    """The file's "about"; the arrays that are written once, by name; these rows of all others, mapped from the file,
    not read into memory; and which of them are done. For use in `readable`."""
    about, fixed, columns, arrays = _open(path)
    left, torn, wrong = _unlike({k: x[rows] for k, x in arrays.items()}, columns, verify)
    if wrong.size:
        shown = ", ".join(str(i) for i in wrong[:10] + (rows.start or 0))
        raise Refused(
            f"the data of scenario {shown}{f' and {wrong.size - 10} more' * (wrong.size > 10)} are damaged: their "
            "checksums do not fit. The call that wrote them (with out=) computes them again; verify=False takes them "
            "as they are"
        )
    if torn.size:  # half written, and not to be shown
        arrays = {k: np.memmap(path, x.dtype, "c", x.offset, x.shape) if x.size else x for k, x in arrays.items()}
    found = {k: x[rows] for k, x in arrays.items() if k not in _CHECKSUM}
    for k in found if torn.size else ():
        found[k][torn] = columns[k].blank
    return about, fixed, found, ~left


class ScenarioFile:
    """An open file of scenarios, which this process alone fills. ValueError when it is of something else, or cannot be
    written.

    Args:
        path: the file, or a link to it. It is laid out anew where it does not exist, or `resume` is false.
        count: of the scenarios. columns: their arrays, by name, which are written in this order.
        fixed: arrays that are written once, by name, with their titles.
        about: of the file, for JSON; "marks" are of all that the numbers follow from.
        kind: "batch" or "sweep". where: the user's name of the path. otherwise: the remedy, for the user. rows: the
            first rows of a file that is laid out anew.

    Attributes:
        damaged: how many scenarios are to be computed again because their data were damaged.
        arrays: all columns, mapped from the file, to be read.
    """

    def __init__(
        self, path: Path, count: int, columns: Mapping[str, Column], fixed: Mapping[str, tuple[Any, Any]],
        about: Mapping[str, Any], resume: bool, kind: str, where: str, otherwise: str,
        rows: Iterable[tuple[NDArray[np.int64], Mapping[str, Any]]] = (),
    ) -> None:  # fmt: skip
        self.damaged, self._path, self._where = 0, path, where
        self._columns, self._begun = {**columns, **_CHECKSUM}, np.empty(0, np.int64)
        found = path.exists()
        if found:
            check_unused(where, path)
        if not (found and resume):
            self._lay_out(count, fixed, about, rows)
        with readable(where, path, f"a file of a {kind} ({otherwise})"):
            seen = os.stat(path)
            theirs, _, _, self.arrays = _open(path, f"; {otherwise}")
            if theirs["marks"] != about["marks"]:
                raise Refused(f"holds another {kind}, {difference(theirs['marks'], about['marks'])}; {otherwise}")
        self._open_rows(path)
        try:
            if not os.path.samestat(seen, os.fstat(self._file.id.get_vfd_handle())):
                raise ValueError(f"{where} {str(path)!r}: another process put another file in its place")
            if found and resume:
                _, torn, wrong = _unlike(self.arrays, self._columns)
                self.damaged, self._begun = len(wrong), np.union1d(torn, wrong)
                self._tidy()
        except BaseException:
            self.abandon()
            raise

    def _lay_out(
        self, count: int, fixed: Mapping[str, tuple[Any, Any]], about: Mapping[str, Any],
        rows: Iterable[tuple[NDArray[np.int64], Mapping[str, Any]]],
    ) -> None:  # fmt: skip
        """Makes the file, which appears when it is whole and all its room on the disk is taken."""
        import h5py

        words = {**about, "count": count, "columns": {k: x[:3] for k, x in self._columns.items()}}
        text, arrays = json.dumps(words), {k: np.ascontiguousarray(x) for k, (x, _) in fixed.items()}
        room = _ROOM + 2 * (len(text) + sum(x.nbytes for x in arrays.values()))
        need = sum(count * x.blanks(1).nbytes for x in self._columns.values())
        check_space(self._where, self._path, need + room)
        make, place = h5py.h5p.create(h5py.h5p.DATASET_CREATE), h5py.h5p.create(h5py.h5p.LINK_CREATE)
        make.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
        make.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
        place.set_create_intermediate_group(True)

        def write(raw: Any) -> None:
            raw.write(bytes(room))  # a full disk is refused here: HDF5 cannot close a file on a full disk
            raw.flush()
            raw.truncate(room + need)
            # a version whose own tables have checksums, and that needs no clearing after a kill
            with h5py.File(raw.name, "w", libver=("v108", "v108")) as f:
                f.attrs["digest"], f.attrs["scenarios"] = digest(json.loads(text), arrays), count
                f["about"] = texts([text])[0]
                for name, x in arrays.items():
                    f[name] = x
                    label(f[name], fixed[name][1])
                for name, column in self._columns.items():
                    kind, space = np.dtype(column.kind), h5py.h5s.create_simple((count, *column.shape))
                    h5py.h5d.create(f.id, name.encode(), h5py.h5t.py_create(kind), space, make, place)
                    label(f[name], column.titles)
            self._open_rows(Path(raw.name))
            with self._file:
                self._blank(np.arange(count))
                for indices, part in rows:
                    self.write(indices, part)

        write_whole(self._path, write, self._where, sync=False)  # after a power failure the checksums tell

    def _open_rows(self, path: Path) -> None:
        """Opens the file to be filled. The library keeps no numbers back: a full disk is noticed at once."""
        import h5py

        ways = h5py.h5p.create(h5py.h5p.FILE_ACCESS)
        ways.set_sieve_buf_size(0)
        with named(self._where, self._path):
            self._file = h5py.File(h5py.h5f.open(os.fsencode(path), h5py.h5f.ACC_RDWR, ways))

    def _put(self, name: str, indices: NDArray[np.int64], rows: Any) -> None:
        """Writes rows of an array, where indices increase."""
        if len(indices):
            first, last = int(indices[0]), int(indices[-1])
            with named(self._where, self._path):
                self._file[name][slice(first, last + 1) if last - first + 1 == len(indices) else indices] = rows

    def _blank(self, indices: NDArray[np.int64]) -> None:
        """Makes scenarios as they were before they ran."""
        for name, x in {**_CHECKSUM, **self._columns}.items():  # the checksum first
            block = x.blanks(min(len(indices), max(1, _BLOCK // max(1, x.blanks(1).nbytes))))
            for first in range(0, len(indices), max(1, len(block))):
                part = indices[first : first + len(block)]
                self._put(name, part, block[: len(part)])

    def _tidy(self) -> None:
        self._blank(self._begun)
        self._begun = self._begun[:0]

    def done(self) -> NDArray[np.bool_]:
        """Whether each scenario is."""
        return np.asarray(self.arrays["checksum"] != 0)

    def write(self, indices: NDArray[np.int64], rows: Mapping[str, Any]) -> None:
        """The rows of scenarios that are done, of every array. The indices must increase."""
        rows = {k: np.ascontiguousarray(rows[k], x.kind) for k, x in self._columns.items() if k not in _CHECKSUM}
        self._begun = indices
        for name, block in {**rows, "checksum": _checksums(rows)}.items():
            self._put(name, indices, block)
        self._begun = indices[:0]

    def close(self) -> None:
        """Closes the file, whose arrays stay mapped. Scenarios whose writing was interrupted by Ctrl-C become blank."""
        try:
            self._tidy()
        finally:
            self.abandon()

    def abandon(self) -> None:
        """Closes the file after an error."""
        self._file.close()
