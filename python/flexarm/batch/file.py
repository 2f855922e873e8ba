"""The file of a long batch (HDF5): written chunk by chunk, taken up again where it was left.

The arrays "q", "v", ... (B, nt, n), "status" (B,), "reached" (B,), "reason" and "out_of_range" lie there whole from the
beginning, so that later nothing of the file's structure changes, whenever the process is killed: nan, and status 4, of
scenarios that are not done. "done" (B,) is 0 of those, 2 while a scenario's rows go out, 1 after them; "checksum" (B,)
is of all that the file holds of a scenario.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _core
from .._check import Array
from ..store.files import Refused, readable, zipped
from ..store.fingerprint import difference, marks
from ..store.hdf5 import Laid, Place, check_seal, checksums, dataset, h5py, lay_out, place
from . import events as batch_events
from .job import ENDED, FAILED, Job
from .rollout import NOT_DONE, Failure
from .variation import Variation

_REASON = 200  # bytes
_KIND, _WHERE = "a file of a batch", "out ="
_DONE, _BEGUN = 1, 2
#: what a scenario has beside its rows: the axes of each, and their type
_COLUMNS: dict[str, tuple[tuple[int, ...], str]] = {
    "status": ((), "<i4"), "reached": ((), "<f8"), "reason": ((), f"S{_REASON}"), "out_of_range": ((4,), "<f8"),
    "checksum": ((), "<u4"), "done": ((), "|u1"),
}  # fmt: skip


def job_marks(job: Job, name: str | None) -> dict[str, str]:
    """Of everything that a batch's results follow from; `name` is the user's, for what cannot be looked into."""
    s = job.variation.setup
    parts: dict[str, Any] = {"arm": s.arm, "parameters": job.variation.values}
    parts |= {f"drive {key}": law for key, law in s.drive.items()}
    for kind, group in (("loads", s.loads), ("control", s.control)):
        parts |= {f"{kind}[{k}]": part for k, part in enumerate(group)}
    parts |= {k: getattr(job, k) for k in ("t", "q0", "v0", "tau", "outputs", "every", "integrator", "step")}
    return marks({**parts, **job.options}, name)


def about(variation: Variation) -> dict[str, Any]:
    """What a saved batch says of itself, beside its arrays."""
    setup = variation.setup
    return {"flexarm": _core.__version__, "arm": setup.arm.to_dict(), "loads": len(setup.loads)}


def in_bytes(reason: str) -> bytes:
    """As a file keeps it: cut between two letters."""
    return reason.encode()[:_REASON].decode(errors="ignore").encode()


def failures_in(held: Mapping[str, Any]) -> list[Failure]:
    """What failed, of a file's status, reached and reason."""
    bad = np.flatnonzero(~np.isin(held["status"], (0, ENDED, NOT_DONE)))
    return [Failure(int(i), float(held["reached"][i]), held["reason"][i].decode(errors="replace")) for i in bad]


def _damaged(arrays: Mapping[str, Any]) -> NDArray[np.int64]:
    """Scenarios whose checksums, or marks of whether they are done, do not fit."""
    marks, sums = np.asarray(arrays["done"]), np.asarray(arrays["checksum"])
    done, odd = marks == _DONE, (marks > _BEGUN) | ((marks == 0) & (sums != 0))
    held = {k: x for k, x in arrays.items() if k not in ("done", "checksum")}
    wrong = np.zeros(len(done), bool)
    for first in range(0, len(done), 4096):  # pieces, so that little of it is in memory at once
        part = slice(first, first + 4096)
        if done[part].any():
            wrong[part] = checksums({k: x[part] for k, x in held.items()}) != sums[part]
    return np.flatnonzero(done & wrong | odd)


def _listed(indices: NDArray[np.int64]) -> str:
    shown = ", ".join(str(i) for i in indices[:10])
    return shown + (f" and {len(indices) - 10} more" if len(indices) > 10 else "")


def read(path: Path, outputs: tuple[str, ...], verify: bool) -> dict[str, Any]:
    """All arrays of a saved batch by name (those of HDF5 mapped, not read into memory), "about", "parameters" and
    "reason". For use in `readable`."""
    with path.open("rb") as raw:
        of_save = raw.read(2) == b"PK"
    if of_save:
        held = zipped(path)
        held["about"] = json.loads(str(held["about"]))
        values = {k.partition("/")[2]: held.pop(k) for k in list(held) if k.startswith("parameters/")}
        if "events" in held:
            held["events"] = batch_events.unpacked(held, held["status"] != NOT_DONE)
        return {**held, "parameters": values}
    with h5py().File(path, "r") as f:
        if verify:
            check_seal(f)
        places = _places(f, path, [k for k in outputs if k in f])
        times, words = dataset(f, "t")[:], json.loads(dataset(f, "about")[()])
        values = {k: dataset(f, f"parameters/{k}")[:] for k in f.get("parameters", {})}
    arrays = {k: x.of(path) for k, x in places.items()}
    wrong = _damaged(arrays) if verify else np.empty(0, int)
    if wrong.size:
        raise Refused(
            f"the data of scenario {_listed(wrong)} are damaged: their checksums do not fit. simulate_batch(out=) "
            "computes them again where it is called as before; verify=False takes them as they are"
        )
    done = arrays["done"]
    held = {k: np.array(x) if k in _COLUMNS else x for k, x in arrays.items()}
    left, torn = done != _DONE, np.flatnonzero((done != _DONE) & (done != 0))
    if torn.size:  # half written, and not to be shown
        held |= {k: places[k].of(path, "c") for k in outputs if k in places}
        for k in outputs:
            if k in held:
                held[k][torn] = np.nan
    held["status"][left], held["reached"][left], held["out_of_range"][left] = NOT_DONE, times[0], np.nan
    if "events" in held:
        held["events"] = batch_events.unpacked(arrays, ~left)
    return {**held, "t": times, "about": words, "parameters": values}


def _places(f: Any, path: Path, outputs: Iterable[str]) -> dict[str, Place]:
    return {
        **{k: place(f, k, path, "<f8", 3) for k in outputs},
        **{k: place(f, k, path, kind, 1 + len(shape)) for k, (shape, kind) in _COLUMNS.items()},
        **{k: place(f, k, path, kind, axes) for k, (axes, kind) in batch_events.ARRAYS.items() if "events" in f},
    }


class BatchFile:
    """An open file of a batch. ValueError when it is another batch's, or cannot be written.

    Attributes:
        damaged: how many scenarios are to be computed again because their data were damaged.
    """

    def __init__(self, path: Path, job: Job, count: int, resume: bool, name: str | None) -> None:
        h5, mine = h5py(), job_marks(job, name)
        self.path, self._job, self._count, self.damaged = path, job, count, 0
        found = path.exists()
        if found and not resume:
            Laid(_WHERE, path, {}).close()  # nobody writes over what another process is writing
        if not (found and resume):
            self._make(mine)
        with readable(_WHERE, path, f"{_KIND}; give another name"), h5.File(path, "r") as f:
            places = self._check(f, mine)
        self._file = Laid(_WHERE, path, places)
        if found and resume:
            try:
                self._forget_what_is_torn()
            except BaseException:
                self.abandon()
                raise

    def _check(self, f: Any, mine: Mapping[str, str]) -> dict[str, Place]:
        """Where the arrays lie in the file, if it is this batch's."""
        if "fingerprint" not in f or "seal" not in f.attrs:
            raise Refused("is not a file of a batch, or one of an older flexarm; give another name")
        check_seal(f)
        found = json.loads(dataset(f, "fingerprint")[()])
        if found != mine:
            raise Refused(
                f"holds another batch, {difference(found, mine)}; give another name, or resume=False to write over it"
            )
        places = _places(f, self.path, self._job.outputs)
        for k, (shape, _, _) in self._arrays().items():
            if k not in places or places[k].shape != shape:
                raise Refused(f"{k!r} is damaged; resume=False writes over the file")
        return places

    def _arrays(self) -> dict[str, tuple[tuple[int, ...], str, Any]]:
        """Shape, type and first content of all that is filled."""
        first = {"status": NOT_DONE, "reached": self._job.t[0], "reason": b"", "out_of_range": np.nan}
        job, arm = self._job, self._job.variation.setup.arm
        shapes = batch_events.shapes(self._count, job.events, job.rows, arm.nq, arm.nv) if job.events else {}
        return {
            **{k: ((self._count, self._job.rows, size), "<f8", np.nan) for k, size in self._job.sizes().items()},
            **{k: ((self._count, *shape), kind, first.get(k, 0)) for k, (shape, kind) in _COLUMNS.items()},
            **{k: (shape, kind, 0 if k == "events" else np.nan) for k, (shape, kind) in shapes.items()},
        }

    def _make(self, mine: Mapping[str, str]) -> None:
        words = {"fingerprint": json.dumps(mine), "about": json.dumps(about(self._job.variation))}
        values = {f"parameters/{path}": x for path, x in self._job.variation.values.items()}
        lay_out(_WHERE, self.path, {**words, "t": self._job.t[:: self._job.every], **values}, self._arrays())

    def _forget_what_is_torn(self) -> None:
        """Scenarios that were half written, or are damaged, are as if they had never run."""
        arrays = {k: self._file.array(k) for k in self._file.places}
        wrong = _damaged(arrays)
        self.damaged = len(wrong)
        self._reset(np.union1d(np.flatnonzero((arrays["done"] != _DONE) & (arrays["done"] != 0)), wrong))

    def _reset(self, again: NDArray[np.int64]) -> None:
        """Makes scenarios as they were before they ran."""
        self._file.put("done", again, np.full(len(again), _BEGUN))
        for k, (shape, kind, value) in self._arrays().items():
            if k != "done":
                for i in again:
                    self._file.put(k, np.array([i]), np.full((1, *shape[1:]), value, kind))
        self._file.put("done", again, np.zeros(len(again)))

    def missing(self) -> NDArray[np.int64]:
        """Scenarios that are not done."""
        return np.flatnonzero(self._file.array("done") != _DONE)

    def write(
        self, indices: NDArray[np.int64], blocks: Mapping[str, Any], failures: list[Failure], beyond: Array
    ) -> None:
        """Scenarios that are done, or failed; indices must increase. beyond: (n, 4), see `worst_range`."""
        job, arm = self._job, self._job.variation.setup.arm
        if job.events:
            found = blocks["events"]
            for k in batch_events.crowded(found, job.rows):
                blocks["status"][k] = FAILED
                reason = f"an event occurred more than {job.rows} times: a file keeps as many as it has rows; "
                reason += "give more times t, or out=None"
                failures = [*failures, Failure(int(indices[k]), float(blocks["reached"][k]), reason)]
            blocks = {**blocks, **batch_events.packed(found, job.events, job.rows, arm.nq, arm.nv)}
        reasons = dict.fromkeys(indices.tolist(), b"") | {f.index: in_bytes(f.reason) for f in failures}
        words = np.array([reasons[i] for i in indices.tolist()], f"S{_REASON}")
        blocks = {**blocks, "reason": words, "out_of_range": np.asarray(beyond, "<f8")}
        self._file.put("done", indices, np.full(len(indices), _BEGUN))
        for name, block in blocks.items():
            self._file.put(name, indices, block)
        self._file.put("checksum", indices, checksums(blocks))
        self._file.put("done", indices, np.full(len(indices), _DONE))

    def abandon(self) -> None:
        """Closes the file after an error."""
        self._file.close()

    def close(self) -> tuple[dict[str, Any], list[Failure]]:
        """Closes the file; what it holds, the large arrays mapped from it, not read."""
        self._reset(np.flatnonzero(self._file.array("done") == _BEGUN))  # Ctrl-C while it was written
        held = {k: np.array(self._file.array(k)) for k in ("status", "reached", "reason", "out_of_range")}
        held |= {k: self._file.array(k) for k in self._job.outputs}
        if self._job.events:
            kept = {k: self._file.array(k) for k in batch_events.ARRAYS}
            held["events"] = batch_events.unpacked(kept, self._file.array("done") == _DONE)
        self._file.close()
        return held, failures_in(held)
