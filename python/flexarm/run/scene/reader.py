"""From the structure of a scene file to the fields of a Scene."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from ..._check import Array, array, choice, known_keys, number
from ...arm.arm import Arm
from ...model.acting.control import control_laws
from ...model.acting.drive import Motion, SpinUp
from ...model.parts.arguments import arguments
from ...model.parts.tables import read, read_file
from ..integrators import INTEGRATORS
from ..start import WORDS, start
from .grammar import OPTIONS, SAMPLES, SIMULATION, Samples, SceneFile, StrutDrive, output_times


class Files(NamedTuple):
    """Files that a scene names: relative to `base`, inside `allowed`."""

    base: Path
    allowed: Path

    def path(self, where: str, name: Any) -> Path:
        """The path of a file that may be read. ValueError, without details, for any other."""
        try:
            path: Path = (self.base / name).resolve()  # links are followed before the check
            allowed = self.allowed.resolve()
        except (TypeError, OSError, RuntimeError, ValueError):  # not a string, too long, circular links, a NUL
            raise ValueError(f"{where} = {name!r}: must be the name of a file") from None
        if not path.is_relative_to(allowed):
            raise ValueError(
                f"{where} = {name!r}: must be in the scene's folder, {str(self.allowed)!r}, or below; "
                "load(..., files=FOLDER) allows another"
            )
        return path


def samples(where: str, table: Mapping[str, Any], columns: tuple[str, ...], files: Files) -> dict[str, Array]:
    """Columns given in place or in a CSV file with a header line. Errors do not show the file's content: their reader
    may lack the right to see it."""
    known_keys(where, table, (*columns, "file"))
    if "file" not in table:
        return {k: array(f"{where}.{k}", v) for k, v in table.items()}
    path, where = files.path(f"{where}.file", table["file"]), f"{where}.file = {str(table['file'])!r}"
    try:
        if path.exists() and not path.is_file():  # reading a pipe would block
            raise ValueError(f"{where}: is not a file")
        with path.open(newline="", encoding="utf-8-sig") as f:
            rows = list(csv.DictReader(f, skipinitialspace=True))
    except OSError as e:
        raise ValueError(f"{where}: {e.strerror}") from None
    except (UnicodeDecodeError, csv.Error):
        raise ValueError(f"{where}: is not a table of comma-separated values in UTF-8") from None
    if not rows:
        raise ValueError(f"{where}: has no rows")
    if any(name not in columns for name in rows[0] if name is not None):
        raise ValueError(f"{where}: its first line must name columns, of {', '.join(columns)}")
    if any(None in row for row in rows):
        raise ValueError(f"{where}: a row has more columns than the header")
    found = {}
    for k in rows[0]:
        try:
            found[k] = array(k, [row[k] for row in rows])
        except ValueError:
            raise ValueError(f"{where}: column {k} must be finite numbers, one in each row") from None
    return found


def _law(files: Files, law: Samples, where: str, value: Any) -> Any:
    """A law of time: a number if possible, or samples."""
    if law.moves and isinstance(value, (list, tuple)) and any(isinstance(x, Mapping) for x in value):
        return [_law(files, law, f"{where}[{k}]", x) for k, x in enumerate(value)]
    if law.moves and isinstance(value, Mapping) and "spin_up" in value:
        known_keys(where, value, ("spin_up",))
        return Motion(read(f"{where}.spin_up", SpinUp, value["spin_up"]))
    if not isinstance(value, Mapping) and law.make is None:
        return value
    if not isinstance(value, Mapping) and len(law.columns) == 2:
        return law.make(number(where, value))
    motion = SAMPLES["motion"].columns
    found = samples(where, value, (*law.columns, *motion[1:]) if law.moves else law.columns, files)
    if law.moves and "r" not in found and "q" in found:
        return read(where, Motion, found)
    known_keys(where, found, law.columns)
    if law.make is not None:
        return read(where, law.make, found)
    missing = [k for k in law.columns if k not in found]
    if missing:
        raise ValueError(f"{where}: missing {', '.join(missing)}")
    return tuple(found[k] for k in law.columns)


def _simulation(where: str, table: Any) -> dict[str, Any]:
    known_keys(where, table, SIMULATION)
    if "integrator" in table:
        choice(f"{where}.integrator", table["integrator"], INTEGRATORS)
    return dict(table)


def _drives(file: SceneFile, arm: Arm) -> dict[Any, Any]:
    found: dict[Any, Any] = {}
    for k, drive in enumerate(file.drive):
        if len(drive.laws) != 1:
            raise ValueError(f"drive[{k}]: needs link or strut, and one of motion, spin_up, torque")
        if isinstance(drive, StrutDrive) and drive.strut not in arm.strut_names:
            known = ", ".join(arm.strut_names) or "none"
            raise ValueError(f"drive[{k}].strut = {drive.strut!r}: must be the name of a strut or tendon, of {known}")
        if drive.key in found:
            raise ValueError(f"drive[{k}].link = {drive.key}: is driven twice")
        found[drive.key] = drive.laws[0]
    return found


def scene_fields(d: Mapping[str, Any], name: str, files: Files) -> dict[str, Any]:
    """The fields of a Scene, from the structure of its file."""
    laws = {key: partial(_law, files, law) for key, law in SAMPLES.items()}
    file = read_file(SceneFile, d, {**laws, "simulation": _simulation})
    arm, s = Arm._read(file), file.simulation
    t = read("simulation", output_times, {k: s[k] for k in arguments(output_times) if k in s})
    checks: dict[str, Callable[[Any], Any]] = {
        "load": lambda load: load.place(arm),
        "sensor": lambda sensor: sensor.check(arm, t),
        "control": lambda law: control_laws(arm, law, t),
    }
    for key, check in checks.items():
        for k, part in enumerate(getattr(file, key)):
            try:
                check(part)
            except ValueError as e:
                raise ValueError(f"{key}[{k}]: {e}") from None
    drive = _drives(file, arm)
    q0 = s.get("q0")
    try:
        if isinstance(q0, str):
            choice("q0", q0, WORDS)
        elif q0 is not None:
            q0 = start(arm, q0, drive, file.load, float(t[0]))
    except ValueError as e:
        raise ValueError(f"simulation.{e}") from None
    return {
        "arm": arm,
        "drive": drive,
        "loads": tuple(file.load),
        "t": t,
        "q0": q0,
        "v0": array("simulation.v0", s["v0"], (arm.nv,)) if "v0" in s else None,
        "options": {k: s[k] for k in OPTIONS if k in s},
        "name": name if file.title is None else str(file.title),
        "sensors": tuple(file.sensor),
        "control": tuple(file.control),
    }
