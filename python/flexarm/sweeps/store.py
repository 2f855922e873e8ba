"""What a sweep keeps in a folder, so that one that was interrupted or killed goes on from there."""

from __future__ import annotations

import csv
import io
import json
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._check import Array
from ..store.files import Refused, named, packed, readable, unpacked, write_whole
from ..store.fingerprint import difference, marks
from ..store.hdf5 import Laid, check_seal, checksums, dataset, h5py, lay_out, place

if TYPE_CHECKING:
    from ..scene.scene import Scene
    from .sweep import SweepResult
    from .vary import Sweep


def write_table(path: Path, result: SweepResult) -> None:
    """One line for each scenario that was run."""
    names, numbers = parameter_columns(result.parameters)
    reasons = {i: reason for i, _, reason in result.failures}
    header = ["scenario", *names, *(_headed(n, result.units[n]) for n in result.columns), "failure"]
    columns = [*numbers, *result.columns.values()]
    with io.StringIO(newline="") as text:
        out = csv.writer(text, lineterminator="\n")
        out.writerow(header)
        for i in np.flatnonzero(result.done):
            out.writerow([int(i), *(repr(float(c[i])) for c in columns), reasons.get(int(i), "")])
        write_whole(path, lambda f: f.write(text.getvalue().encode()), "output file")


def _headed(name: str, unit: str) -> str:
    return f"{name} ({unit})" if unit else name


def parameter_columns(parameters: Mapping[str, Array]) -> tuple[list[str], list[Array]]:
    names, columns = [], []
    for path, v in parameters.items():
        names += [path] if v.ndim == 1 else [f"{path}.{k}" for k in range(v.shape[1])]
        columns += [v] if v.ndim == 1 else list(v.T)
    return names, columns


def sweep_marks(scene: Scene, plan: Sweep, parameters: Mapping[str, Array], name: str | None) -> dict[str, str]:
    """What tells one sweep from another: the scene, the values, and what is noted; name: see `marks`."""
    parts: dict[str, Any] = {"parameters": dict(parameters)}
    parts |= {k: getattr(scene, k) for k in ("arm", "drive", "loads", "control", "options", "t", "q0", "v0")}
    parts |= {k: getattr(plan, k) for k in ("outputs", "link", "band", "trajectories", "every")}
    return marks(parts, name)


_SHARE = re.compile(r"(\d{9})-(\d{9})\.npz")
#: all that a sweep writes into the folder of its shares
_OURS = re.compile(r"\d{9}-\d{9}(\.npz)?(\.new)?|fingerprint(\.new)?")


_ARRAYS = (("q", "<f8", 3), ("v", "<f8", 3), ("checksum", "<u4", 1))


class Kept:
    """The shares that are done, in a folder: each in its own file, which appears whole or not at all, so that a sweep
    that is killed at any moment goes on from there; when all are done, one file.

    Attributes:
        damaged: how many files of shares could not be read, and are computed again.
    """

    def __init__(self, folder: Path, mine: Mapping[str, str], resume: bool, shape: tuple[int, int]) -> None:
        self.folder, self.whole, self.mine = folder / "sweep.parts", folder / "sweep.npz", dict(mine)
        self._mark, self._shape, self.damaged = self.folder / "fingerprint", shape, 0
        self._finished: dict[str, Any] | None = None
        self._where = f"output folder {str(folder)!r}"
        with named("output folder", folder):
            if self.folder.is_symlink():
                raise ValueError(f"{self._where}: its sweep.parts is a link to elsewhere, which is not followed")
            if not resume:
                self.remove()
                self.whole.unlink(missing_ok=True)
            elif self.whole.exists():
                self._finished = self._read_whole()
            elif (folder / "sweep.csv").exists() and not self._mark.exists():
                raise self._another("a sweep.csv without its sweep.npz")
            self._check_mark()

    def _another(self, which: str) -> ValueError:
        return ValueError(
            f"{self._where}: holds another sweep, {which}; take another folder, or start anew there with resume=False "
            "(--fresh)"
        )

    def _read_whole(self) -> dict[str, Any]:
        anew = "a finished sweep (start anew in its folder with resume=False, --fresh)"
        with readable("sweep", self.whole, anew):
            found = unpacked(self.whole)
            theirs = found.pop("fingerprint")
            if theirs == self.mine:
                return self._checked(found, range(self._shape[0]))
        raise self._another(difference(theirs, self.mine))

    def _check_mark(self) -> None:
        """ValueError where the shares that lie here are another sweep's."""
        if not self._shares() and not self._mark.exists():
            return
        try:
            found = json.loads(self._mark.read_bytes())
        except (FileNotFoundError, ValueError):  # of its encoding, too
            found = None
            if not self._shares():  # killed while it was written
                self._mark.unlink(missing_ok=True)
                return
        if found != self.mine:
            raise self._another(difference(found, self.mine))

    def _shares(self) -> list[Path]:
        return sorted(p for p in self.folder.glob("*.npz") if _SHARE.fullmatch(p.name))

    def write(self, part: range, found: Mapping[str, Any]) -> None:
        with named("output folder", self.folder):
            self.folder.mkdir(parents=True, exist_ok=True)
            try:
                with self._mark.open("xb") as f:
                    f.write(json.dumps(self.mine).encode())
            except FileExistsError:
                self._check_mark()  # another sweep may have begun here meanwhile
        path = self.folder / f"{part.start:09d}-{part.stop:09d}.npz"
        kept = {**found, "fingerprint": self.mine, "part": [part.start, part.stop]}
        write_whole(path, lambda f: np.savez(f, **packed(kept)), "output file")

    def read(self) -> Iterator[tuple[range, dict[str, Any]]]:
        """What is done. Damaged shares are taken away, to be computed again."""
        if self._finished is not None:
            yield range(self._shape[0]), self._finished
            return
        for path in self._shares():
            first, last = _SHARE.fullmatch(path.name).groups()  # type: ignore[union-attr]
            try:
                with readable("share", path, "a share of a sweep"):
                    found, part = unpacked(path), range(int(first), int(last))
                    if found["fingerprint"] != self.mine or found["part"] != [part.start, part.stop]:
                        raise Refused("is a share of other scenarios")
                    found = self._checked(found, part)
            except ValueError:
                self.damaged += 1
                path.unlink()
                continue
            yield part, found

    def _checked(self, found: dict[str, Any], part: range) -> dict[str, Any]:
        """What a file holds, if that is what it should."""
        count, width = self._shape
        rows = found["rows"]
        if not 0 <= part.start < part.stop <= count or rows.dtype != np.float64 or rows.shape != (len(part), width):
            raise Refused(f"has {rows.shape} numbers for {len(part)} scenarios")
        for i, time, reason in found["failures"]:
            if i not in part or not isinstance(time, float | int) or not isinstance(reason, str):
                raise Refused("has failures of other scenarios")
        for i, text, *rest in found["beyond"]:
            if i not in part or not isinstance(text, str) or len(rest) != 4:
                raise Refused("has warnings of other scenarios")
        if any(found[k].ndim != 3 or len(found[k]) != len(part) for k in ("q", "v") if k in found):
            raise Refused("has trajectories of other scenarios")
        return found

    def lost(self) -> ValueError:
        return ValueError(f"{self._where}: shares of this sweep were damaged meanwhile; the same call goes on")

    def forget(self) -> None:
        """A finished sweep is as if it had never run."""
        self._finished = None

    def finish(self, result: SweepResult) -> None:
        """One file in place of the parts."""
        found = {"rows": np.column_stack(list(result.columns.values())), "fingerprint": self.mine}
        found |= {"failures": result.failures, "beyond": result.beyond}
        write_whole(self.whole, lambda f: np.savez(f, **packed(found)), "output file")
        self.remove()

    def remove(self) -> None:
        """The shares, and their folder where nothing else is in it."""
        try:
            for path in self.folder.iterdir():
                if _OURS.fullmatch(path.name) and not path.is_dir():
                    path.unlink(missing_ok=True)
            if not any(self.folder.iterdir()):
                self.folder.rmdir()
        except FileNotFoundError:
            pass  # none, or another process that does the same sweep was faster


def write_trajectories(
    kept: Kept, path: Path, result: SweepResult, scene: Scene, parameters: Mapping[str, Array]
) -> None:
    """All q and v in one HDF5 file, with checksums, from those of the shares."""
    times, arm = scene.t[:: result.plan.every], scene.arm
    small: dict[str, Any] = {"t": times, **{f"parameters/{k}": v for k, v in parameters.items()}}
    small |= {f"columns/{k}": v for k, v in result.columns.items()}
    count, file = len(result), "output file"
    shapes = {"q": (count, len(times), arm.nq), "v": (count, len(times), arm.nv)}
    whole, there = path.with_name(path.name + ".new"), np.zeros(count, bool)
    try:
        large = {k: (x, "<f8", np.nan) for k, x in shapes.items()}
        lay_out(file, whole, small, {**large, "checksum": ((count,), "<u4", 0)})
        with h5py().File(whole, "r") as f:
            places = {k: place(f, k, whole, kind, n) for k, kind, n in _ARRAYS}
        laid = Laid(file, whole, places)
        try:
            for part, found in kept.read():
                rows, indices = {k: found[k] for k in shapes}, np.array(part)
                for k, x in {**rows, "checksum": checksums(rows)}.items():
                    laid.put(k, indices, x)
                there[indices] = True
        finally:
            laid.close()
        if not there.all():
            raise kept.lost()
        with named(file, path):
            os.replace(whole, path)
    except BaseException:
        whole.unlink(missing_ok=True)
        raise


def read_trajectory(path: Path, i: int) -> tuple[Array, Array, Array]:
    """t, and q and v of a scenario. ValueError where they are damaged, or gone."""
    with readable("trajectories", path, "what a sweep writes"):
        with h5py("trajectories = true:").File(path, "r") as f:
            check_seal(f)
            t, places = dataset(f, "t")[:], {k: place(f, k, path, kind, n) for k, kind, n in _ARRAYS}
        rows = {k: np.array(x.of(path)[i : i + 1]) for k, x in places.items()}
        if rows.pop("checksum") != checksums(rows):
            raise Refused(f"the trajectory of scenario {i} is damaged: its checksum does not fit")
        return t, rows["q"][0], rows["v"][0]
