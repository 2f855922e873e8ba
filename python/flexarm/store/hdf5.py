"""HDF5 files whose arrays lie whole in them from the beginning, each in one piece, and are filled bit by bit.

The HDF5 library lays them out and reads them. The numbers go in by plain writes, in order: the library keeps some back,
and a disk that is full then ends in its crash. What is read is never followed out of its file.
"""

from __future__ import annotations

import os
import threading
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .files import Refused, check_space, named

_BLOCK = 1 << 22  # bytes that are filled at once
_ROOM = 1 << 18  # bytes for the library's own tables


def texts(words: Sequence[str]) -> Any:
    """Texts as they are put into a file: of fixed length. Those of variable length lie in a heap without checksums,
    and where that is damaged, the library may read on for ever."""
    import h5py

    raw = [word.encode() for word in words]
    return np.array(raw, h5py.string_dtype("utf-8", max(map(len, [*raw, b" "]))))


def sealed_names(f: Any) -> list[str]:
    """Of the data sets that are written once."""
    return [n.decode() if isinstance(n, bytes) else str(n) for n in np.atleast_1d(f.attrs["sealed"])]


def dataset(file: Any, name: str) -> Any:
    """A data set that stands in this file. What points elsewhere is refused: links, external and virtual storage; and
    so are filters, which may load a library."""
    import h5py

    at = file
    for part in name.split("/"):
        if part not in at:
            raise Refused(f"holds no {name!r}: is not whole, or of another kind")
        if not isinstance(at.get(part, getlink=True), h5py.HardLink):
            raise Refused(f"{name!r} is a link to elsewhere, which is not followed")
        at = at[part]
    if not isinstance(at, h5py.Dataset):
        raise Refused(f"{name!r} is no data set")
    made = at.id.get_create_plist()
    if made.get_external_count() or at.is_virtual:
        raise Refused(f"{name!r} is stored outside of the file, where it is not read")
    if made.get_nfilters():
        raise Refused(f"{name!r} has filters, which flexarm does not write")
    return at


class Place(NamedTuple):
    """Where an array lies in a file."""

    offset: int
    shape: tuple[int, ...]
    kind: np.dtype[Any]

    def of(self, path: Path, mode: Any = "r") -> Any:
        """The array, mapped from the file."""
        return np.memmap(path, self.kind, mode, self.offset, self.shape)


def place(file: Any, name: str, path: Path, kind: str, ndim: int) -> Place:
    """Where a data set lies in its file."""
    found = dataset(file, name)
    offset, want = found.id.get_offset(), np.dtype(kind)
    if found.dtype != want or len(found.shape) != ndim or found.chunks is not None or offset is None:
        raise Refused(f"{name!r} is {found.dtype} {found.shape}, and not {want} of {ndim} axes in one piece")
    if offset + want.itemsize * int(np.prod(found.shape, dtype=object)) > os.path.getsize(path):
        raise Refused(f"{name!r} is cut off")
    return Place(int(offset), found.shape, want)


def checksums(arrays: Mapping[str, Any]) -> NDArray[np.uint32]:
    """Of each row of these arrays (n, ...) together."""
    held = [np.ascontiguousarray(arrays[k]) for k in sorted(arrays)]
    out = np.zeros(len(held[0]), np.uint32)
    for i in range(len(out)):
        found = 0
        for x in held:
            found = zlib.crc32(x[i : i + 1].data, found)
        out[i] = found
    return out


def _seal(f: Any) -> int:
    """A checksum of what is written once, by names."""
    found = 0
    for name in sealed_names(f):
        value = dataset(f, name)[()]
        found = zlib.crc32(value if isinstance(value, bytes) else np.ascontiguousarray(value).tobytes(), found)
        found = zlib.crc32(name.encode(), found)
    return found


def check_seal(f: Any) -> None:
    """Refuses a file whose times, parameters and the like are not as they were written."""
    if "seal" not in f.attrs or "sealed" not in f.attrs:
        raise Refused("has no checksums: is of an older flexarm, or damaged")
    if int(f.attrs["seal"]) != _seal(f):
        raise Refused("its times, parameters or marks are damaged: their checksum does not fit")


def lay_out(
    where: str, path: Path, small: Mapping[str, Any], large: Mapping[str, tuple[tuple[int, ...], str, Any]]
) -> None:
    """Makes a file, which appears when it is whole.

    Args:
        where: what the user calls the path.
        small: what is written once, by name: arrays, and texts.
        large: shape, type and first content of what is filled later.

    Raises:
        ValueError: no room, or the system lets it not be written.
    """
    import h5py

    room = _ROOM + 2 * sum(np.asarray(x).nbytes for x in small.values())
    need = sum(int(np.prod(shape)) * np.dtype(kind).itemsize for shape, kind, _ in large.values())
    check_space(where, path, need + room)
    temporary = path.with_name(f"{path.name}.{os.getpid()}-{threading.get_ident()}.part")
    with named(where, path):
        try:
            with temporary.open("wb") as raw:  # what the system refuses, it refuses here
                raw.write(bytes(room))
                raw.truncate(room + need)
            # a version whose own tables have checksums, and that needs no clearing after a kill
            with h5py.File(temporary, "w", libver=("v108", "v108")) as f:
                for name, value in small.items():
                    f[name] = texts([value])[0] if isinstance(value, str) else value
                make, place_in = h5py.h5p.create(h5py.h5p.DATASET_CREATE), h5py.h5p.create(h5py.h5p.LINK_CREATE)
                make.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
                make.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
                place_in.set_create_intermediate_group(True)
                for name, (shape, kind, _) in large.items():
                    row, space = h5py.h5t.py_create(np.dtype(kind)), h5py.h5s.create_simple(shape)
                    h5py.h5d.create(f.id, name.encode(), row, space, make, place_in)
                f.attrs["sealed"] = texts(list(small))
                f.attrs["seal"] = _seal(f)
                f.flush()
                offsets = {name: f[name].id.get_offset() for name in large}
            with temporary.open("r+b") as raw:
                for name, (shape, kind, first) in large.items():
                    raw.seek(offsets[name])
                    _fill(raw, int(np.prod(shape)), np.dtype(kind), first)
            os.replace(temporary, path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise


def _fill(raw: Any, count: int, kind: np.dtype[Any], value: Any) -> None:
    block = np.full(min(count, max(1, _BLOCK // kind.itemsize)), value, kind)
    while count > 0:
        raw.write(block[:count].view(np.uint8).data)
        count -= len(block)


class Laid:
    """A file that was laid out, open to be filled by this process alone.

    Args:
        where: what the user calls the path.
        places: of its arrays.

    Raises:
        ValueError: another process writes it.
    """

    def __init__(self, where: str, path: Path, places: Mapping[str, Place]) -> None:
        self.path, self.places, self._where = path, places, where
        with named(where, path):
            self._raw = path.open("r+b", buffering=0)
            try:
                lock(self._raw)
            except BaseException:
                self._raw.close()
                raise

    def array(self, name: str) -> Any:
        """Mapped from the file, to be read."""
        return self.places[name].of(self.path)

    def put(self, name: str, indices: NDArray[np.int64], rows: Any) -> None:
        """Writes rows of an array, where indices increase."""
        offset, shape, kind = self.places[name]
        size = kind.itemsize * int(np.prod(shape[1:]))
        with named(self._where, self.path):
            if not os.path.samestat(os.fstat(self._raw.fileno()), os.stat(self.path)):
                raise ValueError(f"{self._where} {str(self.path)!r}: another process put another file in its place")
            for run in np.split(np.arange(len(indices)), np.flatnonzero(np.diff(indices) != 1) + 1):
                if run.size:
                    data = np.ascontiguousarray(rows[run[0] : run[-1] + 1], kind).tobytes()
                    self._raw.seek(offset + size * int(indices[run[0]]))
                    while data:
                        data = data[self._raw.write(data) :]

    def close(self) -> None:
        lock(self._raw, False)
        self._raw.close()


def lock(raw: Any, held: bool = True) -> None:
    """Takes or leaves the lock that HDF5 asks for, too. BlockingIOError where another process has it."""
    try:
        import fcntl
    except ImportError:  # Windows
        return
    try:
        fcntl.flock(raw, fcntl.LOCK_EX | fcntl.LOCK_NB if held else fcntl.LOCK_UN)
    except BlockingIOError:
        raise
    except OSError:
        pass  # a disk that knows no locks
