"""The file of many scenarios (HDF5): written bit by bit, taken up again where it was left.

Its arrays have a row for each scenario, and lie there whole from the beginning, so that later nothing of the file's
structure changes, whenever the process is killed. "done" (B,) is 0 of scenarios that are not done, whose rows are
blank; 2 while their rows go out, 1 after them; "checksum" (B,) is of all that the file holds of a scenario. What all
have in common, and the marks of what the file is of, is written once, under a checksum of its own.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .files import Refused, readable
from .fingerprint import difference
from .hdf5 import Laid, Place, check_seal, checksums, dataset, lay_out, place, sealed_names

_DONE, _BEGUN = 1, 2
_SMALL = 256  # bytes of a row that is blanked in any case


class Column(NamedTuple):
    """An array of such a file: shape of a scenario's row, type, and what stands there until it is done."""

    shape: tuple[int, ...]
    kind: str
    blank: Any


_OURS = {"checksum": Column((), "<u4", 0), "done": Column((), "|u1", 0)}


def _damaged(arrays: Mapping[str, Any]) -> NDArray[np.int64]:
    """Scenarios whose checksums, or marks of whether they are done, do not fit."""
    marks, sums = np.asarray(arrays["done"]), np.asarray(arrays["checksum"])
    done, odd = marks == _DONE, (marks > _BEGUN) | ((marks == 0) & (sums != 0))
    held = {k: x for k, x in arrays.items() if k not in _OURS}
    wrong = np.zeros(len(done), bool)
    for first in range(0, len(done), 4096):  # pieces, so that little of it is in memory at once
        part = slice(first, first + 4096)
        if done[part].any():
            wrong[part] = checksums({k: x[part] for k, x in held.items()}) != sums[part]
    return np.flatnonzero(done & wrong | odd)


def _written(array: Any, rows: NDArray[np.int64], blank: Any) -> NDArray[np.bool_]:
    """Which of these rows of an array (n, ...) are not blank."""
    out = np.zeros(len(array), bool)
    for i in rows:
        row = np.asarray(array[i])
        out[i] = not (np.isnan(row) if blank != blank else row == np.asarray(blank, row.dtype)).all()
    return out


def _complaint(indices: NDArray[np.int64]) -> Refused:
    shown = ", ".join(str(i) for i in indices[:10]) + (f" and {len(indices) - 10} more" if len(indices) > 10 else "")
    return Refused(
        f"the data of scenario {shown} are damaged: their checksums do not fit. The call that wrote them (with out=) "
        "computes them again; verify=False takes them as they are"
    )


def _open(path: Path, verify: bool, advice: str = "") -> tuple[dict[str, Any], dict[str, Column], dict[str, Place]]:
    """What is written once; the arrays, and where they lie."""
    import h5py

    with h5py.File(path, "r") as f:
        if not {"arrays", "fingerprint"} <= f.keys():
            raise Refused(f"is not a file of a batch or a sweep, or one of an older flexarm{advice}")
        if verify:
            check_seal(f)
        columns = {k: Column(*x) for k, x in json.loads(dataset(f, "arrays")[()]).items()}
        fixed = {k: dataset(f, k)[()] for k in sealed_names(f)}
        return fixed, columns, {k: place(f, k, path, x.kind, 1 + len(x.shape)) for k, x in columns.items()}


def read_scenarios(path: Path, verify: bool) -> tuple[dict[str, Any], dict[str, Any], NDArray[np.bool_]]:
    """What is written once, by name; all arrays, mapped from the file, not read into memory; and which scenarios are
    done. For use in `readable`."""
    fixed, columns, places = _open(path, verify)
    arrays = {k: x.of(path) for k, x in places.items()}
    wrong = _damaged(arrays) if verify else np.empty(0, int)
    if wrong.size:
        raise _complaint(wrong)
    done, marks = np.array(arrays.pop("done")), np.array(arrays.pop("checksum"))
    left = done != _DONE
    torn = left & ((done != 0) | (marks != 0))  # half written, and not to be shown
    for k in arrays:
        again = left if arrays[k][:1].nbytes <= _SMALL else torn
        if verify:
            again = again | _written(arrays[k], np.flatnonzero(left & ~again), columns[k].blank)
        if again.any():
            arrays[k] = places[k].of(path, "c")
            arrays[k][again] = columns[k].blank
    return fixed, arrays, ~left


def read_scenario(path: Path, i: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """What is written once, and the rows of one scenario, whose checksum fits. For use in `readable`."""
    fixed, _, places = _open(path, True)
    rows = {k: np.array(x.of(path)[i : i + 1]) for k, x in places.items()}
    if _damaged(rows).size:
        raise _complaint(np.array([i]))
    return fixed, {k: x[0] for k, x in rows.items()}


class ScenarioFile:
    """An open file of scenarios, which this process alone fills. ValueError when it is of something else, or cannot be
    written.

    Args:
        path: the file. It is laid out anew where it does not exist, or `resume` is false.
        count: of the scenarios. columns: their arrays, by name.
        fixed: what is written once, by name: arrays, and texts.
        marks: of all that the numbers follow from, as `marks` makes them.
        what: "batch", or what else the file is of. where: what the user calls the path. otherwise: what the user can do
            instead.

    Attributes:
        damaged: how many scenarios are to be computed again because their data were damaged.
    """

    def __init__(
        self, path: Path, count: int, columns: Mapping[str, Column], fixed: Mapping[str, Any], marks: Mapping[str, str],
        resume: bool, what: str, where: str, otherwise: str,
    ) -> None:  # fmt: skip
        self._columns, self.damaged = {**columns, **_OURS}, 0
        found = path.exists()
        if found and not resume:
            Laid(where, path, {}).close()  # nobody writes over what another process is writing
        if not (found and resume):
            words = {"fingerprint": json.dumps(marks), "arrays": json.dumps(self._columns)}
            large = {k: ((count, *x.shape), x.kind, x.blank) for k, x in self._columns.items()}
            lay_out(where, path, {**words, **fixed}, large)
        with readable(where, path, f"a file of a {what} ({otherwise})"):
            fixed, _, places = _open(path, True, f"; {otherwise}")
            theirs = json.loads(fixed["fingerprint"])
            if theirs != marks:
                raise Refused(f"holds another {what}, {difference(theirs, marks)}; {otherwise}")
            mine = {k: ((count, *x.shape), np.dtype(x.kind)) for k, x in self._columns.items()}
            if {k: (x.shape, x.kind) for k, x in places.items()} != mine:
                raise Refused(f"its arrays are damaged; {otherwise}")
        self._file = Laid(where, path, places)
        if found and resume:
            try:
                self._forget_what_is_torn()
            except BaseException:
                self.close()
                raise

    def _forget_what_is_torn(self) -> None:
        """Scenarios that were half written, or are damaged, are as if they had never run."""
        wrong, done = _damaged({k: self.array(k) for k in self._columns}), self.array("done")
        self.damaged = len(wrong)
        self._reset(np.union1d(np.flatnonzero((done != _DONE) & (done != 0)), wrong))

    def _reset(self, again: NDArray[np.int64]) -> None:
        """Makes scenarios as they were before they ran."""
        self._file.put("done", again, np.full(len(again), _BEGUN))
        for k, x in self._columns.items():
            if k != "done":
                for i in again:
                    self._file.put(k, np.array([i]), np.full((1, *x.shape), x.blank, x.kind))
        self._file.put("done", again, np.zeros(len(again)))

    def array(self, name: str) -> Any:
        """Mapped from the file, to be read."""
        return self._file.array(name)

    def done(self) -> NDArray[np.bool_]:
        """Whether each scenario is."""
        return np.asarray(self.array("done") == _DONE)

    def write(self, indices: NDArray[np.int64], rows: Mapping[str, Any]) -> None:
        """The rows of scenarios that are done, of every array. The indices must increase."""
        rows = {k: np.ascontiguousarray(rows[k], x.kind) for k, x in self._columns.items() if k not in _OURS}
        self._file.put("done", indices, np.full(len(indices), _BEGUN))
        for name, block in rows.items():
            self._file.put(name, indices, block)
        self._file.put("checksum", indices, checksums(rows))
        self._file.put("done", indices, np.full(len(indices), _DONE))

    def tidy(self) -> None:
        """After Ctrl-C: what was being written is as if it had never run."""
        self._reset(np.flatnonzero(self.array("done") == _BEGUN))

    def close(self) -> None:
        """Closes the file. The arrays stay mapped."""
        self._file.close()
