"""What a sweep keeps in a folder, so that one that was interrupted or killed goes on from there."""

from __future__ import annotations

import csv
import hashlib
import json
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ._check import Array
from .batch_file import _digest as digest

if TYPE_CHECKING:
    from .plan import Sweep
    from .scene import Scene
    from .sweep import SweepResult


def h5py() -> Any:
    """The module h5py; ValueError where it is not installed."""
    try:
        import h5py
    except ImportError:
        raise ValueError("trajectories = true: needs h5py; pip install 'flexarm[batch]'") from None
    return h5py


def write_table(path: Path, result: SweepResult) -> None:
    """One line for each scenario that was run."""
    names, numbers = parameter_columns(result.parameters)
    reasons = {i: reason for i, _, reason in result.failures}
    header = ["scenario", *names, *(_headed(n, result.units[n]) for n in result.columns), "failure"]
    columns = [*numbers, *result.columns.values()]
    temporary = path.with_suffix(".part")
    with temporary.open("w", newline="", encoding="utf-8") as f:
        out = csv.writer(f, lineterminator="\n")
        out.writerow(header)
        for i in np.flatnonzero(result.done):
            out.writerow([int(i), *(repr(float(c[i])) for c in columns), reasons.get(int(i), "")])
    os.replace(temporary, path)


def _headed(name: str, unit: str) -> str:
    return f"{name} ({unit})" if unit else name


def parameter_columns(parameters: Mapping[str, Array]) -> tuple[list[str], list[Array]]:
    names, columns = [], []
    for path, v in parameters.items():
        names += [path] if v.ndim == 1 else [f"{path}.{k}" for k in range(v.shape[1])]
        columns += [v] if v.ndim == 1 else list(v.T)
    return names, columns


def fingerprint(scene: Scene, plan: Sweep, parameters: Mapping[str, Array]) -> str:
    """What tells one sweep from another: the scene, the values, and what is noted."""
    h = hashlib.sha256()
    digest(h, [scene.arm, scene.drive, scene.loads, scene.control, scene.options, scene.t, scene.q0, scene.v0])
    digest(h, [list(plan.outputs), plan.link, plan.band, plan.trajectories, plan.every, dict(parameters)])
    return h.hexdigest()


class Kept:
    """The shares that are done, in a folder: each in its own file, which appears whole or not at all, so that a sweep
    that is killed at any moment goes on from there; when all are done, one file."""

    def __init__(self, folder: Path, fingerprint: str, resume: bool) -> None:
        self.folder, self.whole, self.fingerprint = folder / "sweep.parts", folder / "sweep.npz", fingerprint
        mark = self.folder / "fingerprint"
        if not resume:
            self.remove()
            self.whole.unlink(missing_ok=True)
        if mark.exists() and mark.read_text() != fingerprint:
            raise ValueError(
                f"output folder {str(folder)!r}: holds the unfinished parts of another sweep; take another folder, or "
                "start anew there with resume=False (--fresh)"
            )

    def write(self, part: range, found: Mapping[str, Any]) -> None:
        mark = self.folder / "fingerprint"
        if not mark.exists():
            self.folder.mkdir(parents=True, exist_ok=True)
            _write_whole(mark, lambda f: f.write(self.fingerprint.encode()))
        path = self.folder / f"{part.start:09d}-{part.stop:09d}.npz"
        _write_whole(path, lambda f: np.savez(f, **_packed(found)))

    def read(self) -> Iterator[tuple[range, dict[str, Any]]]:
        if self.whole.exists():
            found = _unpacked(self.whole)
            if found.pop("fingerprint", None) == self.fingerprint:
                yield range(len(found["rows"])), found
                return
        for path in sorted(self.folder.glob("*.npz")):
            first, last = path.stem.split("-")
            yield range(int(first), int(last)), _unpacked(path)

    def finish(self, result: SweepResult) -> None:
        """One file in place of the parts."""
        found = {"rows": np.column_stack(list(result.columns.values())), "fingerprint": self.fingerprint}
        found |= {"failures": result.failures, "beyond": result.beyond}
        _write_whole(self.whole, lambda f: np.savez(f, **_packed(found)))
        self.remove()

    def remove(self) -> None:
        if self.folder.exists():
            for path in self.folder.iterdir():
                path.unlink()
            self.folder.rmdir()


def _packed(found: Mapping[str, Any]) -> dict[str, Any]:
    return {k: v if isinstance(v, np.ndarray) else np.array(json.dumps(v)) for k, v in found.items()}


def _unpacked(path: Path) -> dict[str, Any]:
    with np.load(path, allow_pickle=False) as f:
        return {k: f[k] if f[k].dtype.kind == "f" else json.loads(str(f[k])) for k in f.files}


def _write_whole(path: Path, write: Callable[[Any], Any]) -> None:
    """A file that appears whole or not at all."""
    temporary = path.with_suffix(".new")
    with temporary.open("wb") as f:
        write(f)
        f.flush()
        os.fsync(f.fileno())
    os.replace(temporary, path)


def write_trajectories(
    kept: Kept, path: Path, result: SweepResult, times: Array, parameters: Mapping[str, Array]
) -> None:
    """All q and v in one HDF5 file, from those of the shares."""
    temporary = path.with_suffix(".new")
    with h5py().File(temporary, "w") as f:
        f["t"] = times
        for name, v in parameters.items():
            f[f"parameters/{name}"] = v
        for name, v in result.columns.items():
            f[f"columns/{name}"] = v
        for part, found in kept.read():
            for name in ("q", "v"):
                x = found[name]
                if name not in f:
                    f.create_dataset(name, (len(result), *x.shape[1:]), fillvalue=np.nan, dtype="f8")
                f[name][part.start : part.stop] = x
    os.replace(temporary, path)
