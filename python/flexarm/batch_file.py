"""The file of a long batch (HDF5): written chunk by chunk, taken up again where it was left.

The arrays "q", "v", ... (B, nt, n), "status" (B,), "reached" (B,) and "reason" lie there whole from the beginning, so
that later nothing of the file's structure changes, whenever the process is killed. A chunk's rows go out first and its
marks in "done" (B,) after them.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _core, batch_events
from .batch_run import FAILED, Job
from .rollout import NOT_DONE, Failure
from .variation import Variation

_REASON = 200  # bytes


def _h5py() -> Any:
    try:
        import h5py
    except ImportError:
        raise ImportError('out: a file needs h5py; install it with  pip install "flexarm[batch]"') from None
    return h5py


def _parts(value: Any) -> Any:
    """What an object's meaning follows from, in simpler objects."""
    if isinstance(value, _core.PiecewisePolynomial):
        return value.breaks, value.coefficients
    if hasattr(value, "to_dict"):
        return value.to_dict()
    if isinstance(value, CodeType):
        return value.co_name, value.co_code, value.co_consts, value.co_names
    if isinstance(value, FunctionType):
        held = tuple(cell.cell_contents for cell in value.__closure__ or ())
        return value.__code__, value.__defaults__, value.__kwdefaults__, held
    if isinstance(value, (type, ModuleType, BuiltinFunctionType)):
        return value.__name__
    try:
        return value.__reduce_ex__(4)[1:3]
    except TypeError:
        return None


def _digest(h: Any, value: Any, inside: tuple[int, ...] = ()) -> None:
    """Feeds a value to a hash: numbers bit by bit, objects by what they hold, functions by their code."""
    h.update(type(value).__name__.encode())
    if id(value) in inside:
        return
    inside = (*inside, id(value))
    if value is None or isinstance(value, (bool, int, float, complex, str, bytes, np.generic)):
        h.update(repr(value).encode())
    elif isinstance(value, np.ndarray) and value.dtype != object:
        h.update(str(value.shape).encode())
        h.update(np.ascontiguousarray(value))
    elif isinstance(value, Mapping):
        h.update(str(len(value)).encode())
        for k, v in value.items():
            _digest(h, k, inside)
            _digest(h, v, inside)
    elif isinstance(value, (tuple, list)):
        h.update(str(len(value)).encode())
        for v in value:
            _digest(h, v, inside)
    else:
        _digest(h, _parts(value), inside)


def fingerprint(job: Job) -> str:
    """Of everything that a batch's results follow from. (What a function of yours calls in turn is not seen.)"""
    h, s = hashlib.sha256(), job.variation.setup
    _digest(h, [s.arm, s.drive, s.loads, s.control, job.variation.values, job.t, job.q0, job.v0, job.tau])
    _digest(h, [job.outputs, job.every, job.integrator, job.step, job.options])
    return h.hexdigest()


def _places(file: Any, names: Sequence[str]) -> dict[str, Any]:
    """Where each array lies in the file, its shape and kind."""
    return {k: (file[k].id.get_offset(), file[k].shape, file[k].dtype) for k in names}


def _mapped(path: Path, places: Mapping[str, Any]) -> dict[str, Any]:
    return {k: np.memmap(path, kind, "r", offset, shape) for k, (offset, shape, kind) in places.items()}


def about(variation: Variation) -> dict[str, Any]:
    """What a saved batch says of itself, beside its arrays."""
    setup = variation.setup
    return {"flexarm": _core.__version__, "arm": setup.arm.to_dict(), "loads": len(setup.loads)}


def read(path: Path, outputs: tuple[str, ...]) -> dict[str, Any]:
    """All arrays of a saved batch by name (those of HDF5 mapped, not read), "about", "parameters" and "reason".

    Raises:
        ValueError: no such file, or another kind of file.
    """
    try:
        with path.open("rb") as f:
            zipped = f.read(2) == b"PK"
        if zipped:
            with np.load(path, allow_pickle=False) as z:
                held: dict[str, Any] = {k: z[k] for k in z.files}
            held["about"] = json.loads(str(held["about"]))
            values = {k.partition("/")[2]: held.pop(k) for k in list(held) if k.startswith("parameters/")}
            if "events" in held:
                held["events"] = batch_events.unpacked(held, held["status"] != NOT_DONE)
            return {**held, "parameters": values}
        with _h5py().File(path, "r") as f5:
            small = {k: f5[k][:] for k in ("t", "status", "reached", "reason")}
            places = _places(f5, [k for k in outputs if k in f5])
            values = {k: f5["parameters"][k][:] for k in f5.get("parameters", {})}
            words, left = json.loads(f5["about"][()]), f5["done"][:] == 0
            events = _places(f5, batch_events.NAMES) if "events" in f5 else {}
        small["status"][left], small["reached"][left] = NOT_DONE, small["t"][0]
        large = _mapped(path, places)
        if events:
            large["events"] = batch_events.unpacked(_mapped(path, events), ~left)
        return {**small, **large, "about": words, "parameters": values}
    except OSError as e:
        raise ValueError(f"batch {str(path)!r}: {e.strerror or e}") from None
    except (KeyError, ValueError, TypeError, EOFError):
        raise ValueError(f"batch {str(path)!r}: is not a file of a batch") from None


class BatchFile:
    """An open file of a batch. ValueError when it is another batch's."""

    def __init__(self, path: Path, job: Job, count: int, resume: bool) -> None:
        h5py = _h5py()
        self.path, self._job, self._count = path, job, count
        mark = fingerprint(job)
        if path.exists() and resume:
            self._check(h5py, mark)
            self._file = h5py.File(path, "r+")
        else:
            part = path.with_name(path.name + ".part")  # a file that is killed while it is made is none
            with h5py.File(part, "w") as f:
                self._make(h5py, f, mark)
            part.replace(path)
            self._file = h5py.File(path, "r+")

    def _check(self, h5py: Any, mark: str) -> None:
        try:
            with h5py.File(self.path, "r") as f:
                found = f.attrs.get("fingerprint")
        except OSError as e:
            raise ValueError(f"out = {str(self.path)!r}: is not a file of a batch ({e}); give another name") from None
        if found != mark:
            raise ValueError(
                f"out = {str(self.path)!r}: holds another batch; give another name, or resume=False to write over it"
            )

    def _make(self, h5py: Any, f: Any, mark: str) -> None:
        f.attrs["fingerprint"] = mark
        f["about"] = json.dumps(about(self._job.variation))
        f["t"] = self._job.t[:: self._job.every]
        for path, values in self._job.variation.values.items():
            f[f"parameters/{path}"] = values
        rows, n = self._job.rows, self._count
        shapes: dict[str, tuple[tuple[int, ...], Any]] = {
            k: ((n, rows, size), "f8") for k, size in self._job.sizes().items()
        }
        shapes |= {"status": ((n,), "i4"), "reached": ((n,), "f8"), "reason": ((n,), f"S{_REASON}")}
        shapes["done"] = ((n,), "u1")
        arm = self._job.variation.setup.arm
        shapes |= batch_events.shapes(n, self._job.events, rows, arm.nq, arm.nv) if self._job.events else {}
        for name, (shape, kind) in shapes.items():
            make = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
            make.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
            big = len(shape) > 1
            make.set_fill_time(h5py.h5d.FILL_TIME_NEVER if big else h5py.h5d.FILL_TIME_ALLOC)
            space = h5py.h5s.create_simple(shape)
            h5py.h5d.create(f.id, name.encode(), h5py.h5t.py_create(np.dtype(kind)), space, make)

    def missing(self) -> NDArray[np.int64]:
        """Scenarios that are not done."""
        return np.flatnonzero(self._file["done"][:] == 0)

    def write(self, indices: NDArray[np.int64], blocks: Mapping[str, Any], failures: list[Failure]) -> None:
        """Scenarios that are done, or failed; indices must increase."""
        job, arm = self._job, self._job.variation.setup.arm
        if job.events:
            found = blocks["events"]
            for k in batch_events.crowded(found, job.rows):
                blocks["status"][k] = FAILED
                reason = f"an event occurred more than {job.rows} times: a file keeps as many as rows; take out=None"
                failures = [*failures, Failure(int(indices[k]), float(blocks["reached"][k]), reason)]
            blocks = {**blocks, **batch_events.packed(found, job.events, job.rows, arm.nq, arm.nv)}
        for name, block in blocks.items():
            self._put(name, indices, block)
        reasons = dict.fromkeys(indices.tolist(), b"") | {f.index: f.reason.encode()[:_REASON] for f in failures}
        self._put("reason", indices, np.array([reasons[i] for i in indices.tolist()], f"S{_REASON}"))
        self._file.flush()
        self._put("done", indices, np.ones(len(indices), np.uint8))
        self._file.flush()

    def _put(self, name: str, indices: NDArray[np.int64], block: Any) -> None:
        for run in np.split(np.arange(len(indices)), np.flatnonzero(np.diff(indices) != 1) + 1):
            if run.size:
                first = int(indices[run[0]])
                self._file[name][first : first + run.size] = block[run[0] : run[-1] + 1]

    def close(self) -> tuple[dict[str, Any], list[Failure]]:
        """Closes the file; what it holds, the large arrays mapped from it, not read."""
        f = self._file
        held: dict[str, Any] = {k: f[k][:] for k in ("status", "reached")}
        failed = np.flatnonzero(f["reason"][:] != b"")
        failures = [Failure(int(i), float(held["reached"][i]), f["reason"][i].decode()) for i in failed]
        places, done = _places(f, self._job.outputs), f["done"][:] != 0
        events = _places(f, batch_events.NAMES) if self._job.events else {}
        f.close()
        held |= _mapped(self.path, places)
        if events:
            held["events"] = batch_events.unpacked(_mapped(self.path, events), done)
        return held, failures
