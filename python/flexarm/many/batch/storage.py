"""Stores of a batch's results, filled chunk by chunk: arrays in memory, or a file that can be continued."""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import flexarm._core as _core

from ..._check import Array
from ...analysis.findings import Finding, RunWarning
from ...arm.variation import Variation
from ...data.store.files import unsealed, zipped
from ...data.store.fingerprint import marks
from ...data.store.scenarios import Column, ScenarioFile, read_scenarios
from ...model.acting.load import pushes
from ...run.outputs import titles
from .arguments import prepared
from .job import ENDED, FAILED, Job
from .problems import NOT_DONE, Failure

REASON_BYTES = 500  # of a failure's reason
PARTS = ("t_events", "q_events", "v_events")


def event_columns(events: int, most: int, nq: int, nv: int) -> dict[str, Column]:
    """The arrays by name: the number of occurrences of each event, and the first `most` of them."""
    of = (events, most)
    rows = {k: Column(shape, "<f8", np.nan) for k, shape in zip(PARTS, (of, (*of, nq), (*of, nv)), strict=True)}
    return {"events": Column(of[:1], "<i4", 0), **rows}


def packed_events(found: NDArray[Any], events: int, most: int, nq: int, nv: int) -> dict[str, NDArray[Any]]:
    """These arrays from the events of each scenario (None: not known); blank beyond."""
    of = event_columns(events, most, nq, nv)
    out = {k: np.full((len(found), *x.shape), x.blank, x.kind) for k, x in of.items()}
    for i, scenario in enumerate(found):
        for name, parts in zip(PARTS, scenario or (), strict=False):
            for k, part in enumerate(parts):
                n = min(len(part), most)
                out["events"][i, k], out[name][i, k, :n] = n, part[:n]
    return out


def kept_events(found: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """These arrays with room for all occurrences."""
    known = [scenario for scenario in found if scenario is not None]
    if not known:
        return {}
    most = max(len(t) for t_events, _, _ in known for t in t_events)
    nq, nv = known[0][1][0].shape[1], known[0][2][0].shape[1]
    return packed_events(found, len(known[0][0]), most, nq, nv)


def crowded(found: NDArray[Any], most: int) -> list[int]:
    """Scenarios in which an event occurred more often than `most` times."""
    return [i for i, scenario in enumerate(found) if scenario and any(len(t) > most for t in scenario[0])]


def unpacked_events(held: Mapping[str, NDArray[Any]], done: NDArray[np.bool_]) -> NDArray[Any]:
    """The events of each scenario that is done, (B,): lists of t, q and v of each event; None in the others."""
    out = np.full(len(done), None)
    for i in np.flatnonzero(done):
        out[i] = tuple([np.array(held[name][i, k, :n]) for k, n in enumerate(held["events"][i])] for name in PARTS)
    return out


# -- the storage -------------------------------------------------------------------------------------------------------


def job_marks(job: Job, name: str | None) -> dict[str, str]:
    """Hashes of all inputs of a batch; `name` is the user's, for functions and classes."""
    s = job.variation.setup
    parts: dict[str, Any] = {"arm": s.arm, "parameters": job.variation.values}
    parts |= {f"drive {key}": law for key, law in s.drive.items()}
    for kind, group in (("loads", s.loads), ("control", s.control)):
        parts |= {f"{kind}[{k}]": part for k, part in enumerate(group)}
    parts |= {k: getattr(job, k) for k in ("t", "q0", "v0", "tau", "outputs", "every", "events")}
    parts |= {"integrator": job.integrator.name, **job.integrator.options}
    return marks({**parts, **(vars(job.summary) if job.summary else {})}, name)


def about(variation: Variation) -> dict[str, Any]:
    """Description of a saved batch, beside its arrays."""
    setup = variation.setup
    acting = len(setup.loads) + len(pushes(setup.arm, setup.drive))  # of which the file keeps none
    return {"flexarm": _core.__version__, "arm": setup.arm.to_dict(), "loads": acting}


def _once(t: Array, variation: Variation) -> dict[str, tuple[Any, Any]]:
    """The arrays common to all scenarios, with their titles."""
    return {"t": (t, [("t", "s")]), **{f"parameters/{k}": (x, ()) for k, x in variation.values.items()}}


def in_bytes(reason: str) -> bytes:
    """A reason as a file stores it: cut between two letters."""
    return reason.encode()[:REASON_BYTES].decode(errors="ignore").encode()


def _packed(wrong: Iterable[RunWarning]) -> bytes:
    """A line of JSON for each warning, as long as there is room in a file."""
    out = b""
    for x in wrong:
        line = json.dumps({**vars(x), "kind": type(x).__name__, "finding": vars(x.finding)}, default=float).encode()
        out += line + b"\n" if len(out) + len(line) < 2 * REASON_BYTES else b""
    return out


def _unpacked(lines: bytes) -> list[RunWarning] | None:
    if not lines:
        return None
    kinds, found = {x.__name__: x for x in RunWarning.__subclasses__()}, map(json.loads, lines.splitlines())
    return [kinds[x.pop("kind")](Finding(**x.pop("finding")), **x) for x in found]


def failures_in(held: Mapping[str, Any]) -> list[Failure]:
    """The failures, from a file's status, reached and reason."""
    bad = np.flatnonzero(~np.isin(held["status"], (0, ENDED, NOT_DONE)))
    return [Failure(int(i), float(held["reached"][i]), held["reason"][i].decode(errors="replace")) for i in bad]


def read(path: Path, verify: bool) -> dict[str, Any]:
    """All arrays of a saved batch by name (those of HDF5 mapped, not read into memory), "about" and "parameters". For
    use in `readable`."""
    with path.open("rb") as raw:
        of_save = raw.read(2) == b"PK"
    if of_save:
        held = zipped(path)
        held["about"] = unsealed(str(held.pop("about")), held)
        done = held["status"] != NOT_DONE
    else:
        words, fixed, arrays, done = read_scenarios(path, verify=verify)
        held = {**fixed, **arrays, **{k: np.array(arrays[k]) for k in ("status", "reached", "reason")}, "about": words}
    if "events" in held:
        held["events"] = unpacked_events(held, done)
    values = {k.partition("/")[2]: held.pop(k) for k in list(held) if k.startswith("parameters/")}
    return {**held, "parameters": values}


def write_file(path: Path, t: Array, variation: Variation, arrays: Mapping[str, NDArray[Any]], told: Any) -> None:
    """Writes a file as `File` makes it, from arrays with a row for each scenario; no batch can continue it."""
    blank, names = {"f": np.nan, "i": 0, "S": ""}, titles(variation.setup.arm)
    columns = {k: Column(x.shape[1:], x.dtype.str, blank[x.dtype.kind], names.get(k, ())) for k, x in arrays.items()}
    columns["status"] = columns["status"]._replace(blank=NOT_DONE)
    marks = {"flexarm": _core.__version__, "origin (BatchResult.save)": ""}
    done = np.flatnonzero(arrays["status"] != NOT_DONE)
    pieces = (done[first : first + 1024] for first in range(0, len(done), 1024))  # limits memory
    rows = ((part, {k: x[part] for k, x in arrays.items()}) for part in pieces)
    ScenarioFile(path, len(arrays["status"]), columns, _once(t, variation), {**told, "marks": marks}, False,
                 "batch", "path =", "give another name", rows).abandon()  # fmt: skip


class Memory:
    """Arrays for all scenarios.

    Args:
        out: arrays of the user, by name, to write into.
    """

    def __init__(self, job: Job, count: int, out: Mapping[str, Array] | None = None) -> None:
        kept: dict[str, Any] = prepared(out, {k: (count, *shape) for k, shape in job.kept().items()})
        kept |= {"status": np.full(count, NOT_DONE, np.int32), "reached": np.full(count, job.t[0])}
        kept |= {"events": np.full(count, None)} if job.keeps_events else {}
        self._job, self._failures, self._touched = job, list[Failure](), np.zeros(count, bool)
        self._held = {**kept, "out_of_range": np.full((count, 4), np.nan), "wrong": np.full(count, None)}

    def missing(self) -> NDArray[np.int64]:
        """Scenarios that are not done."""
        return np.flatnonzero(~self._touched)

    def blocks(self, part: NDArray[np.int64]) -> dict[str, Any]:
        """Arrays for the results of these consecutive scenarios."""
        if self._job.summary is not None:
            return self._job.blocks(len(part))
        return {k: x[part[0] : part[-1] + 1] for k, x in self._held.items()}

    def write(self, part: NDArray[np.int64], blocks: Mapping[str, Any], failures: list[Failure]) -> None:
        """Stores the results of these scenarios."""
        for k, block in blocks.items():
            if not np.may_share_memory(block, self._held[k]):
                self._held[k][part] = block
        self._failures += failures
        self._touched[part] = True

    def abandon(self) -> None:
        """After an error."""

    def close(self) -> tuple[dict[str, Any], list[Failure]]:
        """The arrays, and the failures. Scenarios that Ctrl-C ended before they were written are blank."""
        blank = {**dict.fromkeys(self._job.kept(), np.nan), "status": NOT_DONE, "reached": self._job.t[0]}
        for k, value in {**blank, "out_of_range": np.nan, "wrong": None}.items():
            self._held[k][~self._touched] = value
        return self._held, sorted(self._failures, key=lambda f: f.index)


class File:
    """A file, which may hold scenarios done before; see `ScenarioFile`. ValueError if it is another batch's, or cannot
    be written.

    Args:
        name: see `marks`. more: names and units of the columns of a summary.
        kind, where, otherwise: see `ScenarioFile`.

    Attributes:
        damaged: number of scenarios to compute again because their data were damaged.
    """

    def __init__(
        self, job: Job, count: int, path: Path, resume: bool, name: str | None, kind: str = "batch",
        where: str = "out =", otherwise: str = "give another name, or resume=False to write over it",
        more: Mapping[str, Sequence[tuple[str, str]]] | None = None,
    ) -> None:  # fmt: skip
        names = {**titles(job.variation.setup.arm), **(more or {})}
        columns = {k: Column(shape, "<f8", np.nan, names.get(k, ())) for k, shape in job.kept().items()}
        self._events = event_columns(*job.event_sizes()) if job.keeps_events else {}
        columns |= {"reason": Column((), f"S{REASON_BYTES}", ""), "out_of_range": Column((4,), "<f8", np.nan)}
        columns |= {**self._events, "reached": Column((), "<f8", float(job.t[0]), [("reached", "s")])}
        columns |= {"status": Column((), "<i4", NOT_DONE), "wrong": Column((), f"S{2 * REASON_BYTES}", "")}
        told = {**about(job.variation), "marks": job_marks(job, name)}
        self._job = job
        self._file = ScenarioFile(
            path, count, columns, _once(job.kept_times, job.variation), told, resume, kind, where, otherwise
        )
        self.damaged = self._file.damaged

    def missing(self) -> NDArray[np.int64]:
        """Scenarios that are not done."""
        return np.flatnonzero(~self._file.done())

    def blocks(self, part: NDArray[np.int64]) -> dict[str, Any]:
        """Arrays for the results of these scenarios."""
        return self._job.blocks(len(part))

    def write(self, part: NDArray[np.int64], blocks: Mapping[str, Any], failures: list[Failure]) -> None:
        """Stores the results of these scenarios, except those that Ctrl-C ended."""
        whole = blocks["status"] != NOT_DONE
        indices, rows = part[whole], {k: x[whole] for k, x in blocks.items()}
        if self._events:
            failures = [*failures, *self._crowded(indices, rows)]
            rows |= packed_events(rows["events"], *self._job.event_sizes())
        reasons = dict.fromkeys(indices.tolist(), b"") | {f.index: in_bytes(f.reason) for f in failures}
        rows["wrong"] = np.array([_packed(x or ()) for x in rows["wrong"]], f"S{2 * REASON_BYTES}")
        rows["reason"] = np.array([reasons[i] for i in indices.tolist()], f"S{REASON_BYTES}")
        self._file.write(indices, rows)

    def _crowded(self, indices: NDArray[np.int64], rows: Mapping[str, Any]) -> list[Failure]:
        """Failures: scenarios with more occurrences of an event than the file has room for."""
        most, found = self._job.rows, []
        for k in crowded(rows["events"], most):
            rows["status"][k] = FAILED
            reason = f"an event occurred more than {most} times: a file keeps as many as it has rows; "
            reason += "give more times t, or out=None"
            found.append(Failure(int(indices[k]), float(rows["reached"][k]), reason))
        return found

    def abandon(self) -> None:
        """Closes the file after an error."""
        self._file.abandon()

    def close(self) -> tuple[dict[str, Any], list[Failure]]:
        """Closes the file. Returns its arrays, the large ones mapped, not read; and the failures."""
        self._file.close()
        arrays = self._file.arrays
        held = {k: np.array(arrays[k]) for k in ("status", "reached", "reason", "out_of_range")}
        held |= {k: arrays[k] for k in self._job.kept()}
        held["wrong"] = np.fromiter(map(_unpacked, arrays["wrong"]), object, len(held["status"]))
        if self._events:
            held["events"] = unpacked_events(arrays, self._file.done())
        return held, failures_in(held)
