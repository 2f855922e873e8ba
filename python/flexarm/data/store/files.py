"""Files that appear whole or not at all, and that are read with one clear error where they are damaged."""

import errno
import json
import os
import re
import shutil
import threading
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

_WORDS = {
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "the quota of the disk is used up",
    errno.EFBIG: "a file may not be as large as that here",
    errno.EAGAIN: "another process is using it",
    errno.ENOENT: "there is no such file or folder",
    errno.ENOTDIR: "its folder is a file",
    errno.EISDIR: "is a folder",
    errno.EEXIST: "is a file",
    errno.EACCES: "is not allowed",
    errno.EROFS: "the disk can only be read",
}


def explained(error: OSError) -> str:
    """The cause of an error of the system, in words; of HDF5's errors too, which bury its number in their text."""
    found = re.search(r"errno = (\d+)", str(error))
    number = int(found[1]) if found else errno.EAGAIN if "already open" in str(error) else error.errno
    return _WORDS.get(number or 0, error.strerror or str(error))


@contextmanager
def named(where: str, path: Path | str) -> Iterator[None]:
    """Errors of the disk as a ValueError that names the file; a text stands there as it is."""
    try:
        yield
    except OSError as e:
        shown = path if isinstance(path, str) else repr(str(path))
        raise ValueError(f"{where} {shown}: {explained(e)}") from None


def _size(count: float) -> str:
    """So many bytes, in words."""
    for unit in ("B", "kB", "MB"):
        if count < 1000:
            return f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:.3g} GB"


def check_space(where: str, path: Path, need: int) -> None:
    """ValueError where so many bytes do not fit on the disk, or where there is no folder for the
    file."""
    folder = Path(os.path.realpath(path)).parent  # where a link leads
    if not folder.is_dir():
        raise ValueError(f"{where} {str(path)!r}: there is no folder {str(folder)!r}")
    with named(where, path):
        free = shutil.disk_usage(folder).free
    if need > free:
        raise ValueError(
            f"{where} {str(path)!r}: takes {_size(need)}, and the disk has {_size(free)} free; take a larger "
            "`every`, fewer outputs, or another disk"
        )


def check_unused(where: str, path: Path) -> None:
    """ValueError where another process, or another thread of this one, has the lock of HDF5 on a file."""
    try:
        import fcntl
    except ImportError:  # Windows
        return
    with named(where, path), path.open("r+b") as raw:
        try:
            fcntl.flock(raw, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise
        except OSError:
            pass  # a disk that knows no locks


def write_whole(path: Path, write: Callable[[Any], Any], where: str = "file", sync: bool = True) -> None:
    """A file that appears whole or not at all, where a link leads if the path is one; with `sync` also after a power
    failure. ValueError where it cannot be written."""
    target, shown = path, repr(str(path))
    if path.is_symlink():
        target = Path(os.path.realpath(path))
        if target.is_symlink():
            raise ValueError(f"{where} {shown}: is a link to itself; remove it, or give another name")
        shown += f", a link to {str(target)!r}"
    temporary = target.with_name(f"{target.name}.{os.getpid()}-{threading.get_ident()}.new")
    with named(where, shown):
        try:
            with temporary.open("wb") as f:
                write(f)
                f.flush()
                if sync:
                    os.fsync(f.fileno())
            os.replace(temporary, target)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise


def zipped(path: Path) -> dict[str, Any]:
    """All of an .npz; each is checked by its checksum. For use in `readable`."""
    with path.open("rb") as f, np.load(f, allow_pickle=False) as z:
        return {k.removesuffix(".npy"): z[k] for k in z.zip.namelist()}


def texts(words: Sequence[str]) -> Any:
    """Texts for HDF5, of fixed length. Those of variable length lie in a heap without checksums, and where that is
    damaged, the library may read on for ever."""
    import h5py

    raw = [word.encode() for word in words]
    return np.array(raw, h5py.string_dtype("utf-8", max(map(len, [*raw, b" "]))))


def label(dataset: Any, titles: Sequence[tuple[str, str]]) -> None:
    """Gives a data set of HDF5 its unit, or the names and units of its columns, as attributes."""
    if titles and dataset.ndim == 1:
        dataset.attrs["unit"] = texts([titles[0][1]])[0]
    elif titles:
        dataset.attrs["columns"], dataset.attrs["units"] = (texts(part) for part in zip(*titles, strict=True))


def digest(about: Any, arrays: Mapping[str, Any]) -> int:
    """A checksum (CRC-32) of arrays, with their names, types and shapes, and of the JSON beside them. (HDF5 and
    zip have checksums of data, but not of all their own tables, so that one flipped bit there may lose an array.)"""
    found = zlib.crc32(json.dumps(about).encode())
    for name in sorted(arrays):
        x = np.ascontiguousarray(arrays[name])
        found = zlib.crc32(f"{name} {x.dtype.str} {x.shape}".encode(), found)
        found = zlib.crc32(x.data, found)
    return found


def check_digest(told: Any, about: Any, arrays: Mapping[str, Any]) -> None:
    """Refuses data that are not as they were written. Without a digest it is of an older flexarm."""
    if told is not None and int(told) != digest(about, arrays):
        raise Refused("is damaged: its checksum does not fit")


def sealed(about: Mapping[str, Any], arrays: Mapping[str, Any]) -> str:
    """The "about" of an .npz beside arrays: JSON, with the digest of both."""
    return json.dumps({**about, "digest": digest(about, arrays)})


def unsealed(words: str, arrays: Mapping[str, Any]) -> dict[str, Any]:
    """The reverse of `sealed`. Refuses damaged data."""
    about: dict[str, Any] = json.loads(words)
    check_digest(about.pop("digest", None), about, arrays)
    return about


@contextmanager
def readable(where: str, path: Path, kind: str) -> Iterator[None]:
    """One ValueError for all that can go wrong while a file is read: the zip, zlib, JSON, NumPy and HDF5 readers each
    raise many kinds of errors of a damaged one (BadZipFile, zlib.error, EOFError, KeyError, ...)."""
    try:
        yield
    except ImportError:
        raise
    except Refused as e:
        raise ValueError(f"{where} {str(path)!r}: {e}") from None
    except (FileNotFoundError, PermissionError, IsADirectoryError, BlockingIOError) as e:
        raise ValueError(f"{where} {str(path)!r}: {explained(e)}") from None
    except Exception as e:
        raise ValueError(f"{where} {str(path)!r}: is not {kind}, or damaged ({type(e).__name__}: {e})") from None


class Refused(Exception):
    """The fault of a file, in words; see `readable`."""
