"""The file of a long batch (HDF5): written chunk by chunk, taken up again where it was left.

The arrays "q", "v", ... (B, nt, n), "status" (B,), "reached" (B,) and "reason" lie there whole from the beginning, so
that later nothing of the file's structure changes, whenever the process is killed. A chunk's rows go out first and its
marks in "done" (B,) after them.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _core
from .batch_run import Job
from .rollout import Failure

_REASON = 200  # bytes


def _h5py() -> Any:
    try:
        import h5py
    except ImportError:
        raise ImportError('out: a file needs h5py; install it with  pip install "flexarm[batch]"') from None
    return h5py


def _digest(h: Any, value: Any) -> None:
    """Feeds a value to a hash: numbers bit by bit, objects by what they hold, functions by their code."""
    h.update(type(value).__name__.encode())
    if isinstance(value, _core.PiecewisePolynomial):
        value = (value.breaks, value.coefficients)
    if hasattr(value, "to_dict"):
        value = value.to_dict()
    if isinstance(value, np.ndarray):
        h.update(str(value.shape).encode())
        h.update(np.ascontiguousarray(value))
    elif isinstance(value, Mapping):
        for k, v in value.items():
            _digest(h, k)
            _digest(h, v)
    elif isinstance(value, (tuple, list)):
        h.update(str(len(value)).encode())
        for v in value:
            _digest(h, v)
    elif hasattr(value, "__code__"):
        h.update(value.__code__.co_code + repr(value.__code__.co_consts).encode() + value.__qualname__.encode())
    elif hasattr(value, "__dict__") and not isinstance(value, type):
        _digest(h, {k: v for k, v in vars(value).items() if not k.startswith("_")})
    else:
        h.update(repr(value).encode())


def fingerprint(job: Job) -> str:
    """Of everything that a batch's results follow from. (What a function of yours calls in turn is not seen.)"""
    h, s = hashlib.sha256(), job.variation.setup
    _digest(h, [s.arm, s.drive, s.loads, s.control, job.variation.values, job.t, job.q0, job.v0, job.tau])
    _digest(h, [job.outputs, job.every, job.integrator, job.step, job.options])
    return h.hexdigest()


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
        f.attrs["about"] = json.dumps({"parameters": list(self._job.variation.values), "flexarm": _core.__version__})
        f["t"] = self._job.t[:: self._job.every]
        for path, values in self._job.variation.values.items():
            f[f"parameters/{path}"] = values
        rows, n = self._job.rows, self._count
        shapes: dict[str, tuple[tuple[int, ...], Any]] = {
            k: ((n, rows, size), "f8") for k, size in self._job.sizes().items()
        }
        shapes |= {"status": ((n,), "i4"), "reached": ((n,), "f8"), "reason": ((n,), f"S{_REASON}")}
        shapes["done"] = ((n,), "u1")
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
        places = {k: (f[k].id.get_offset(), f[k].shape) for k in self._job.outputs}
        f.close()
        for k, (offset, shape) in places.items():
            held[k] = np.memmap(self.path, np.float64, "r", offset, shape)
        return held, failures
