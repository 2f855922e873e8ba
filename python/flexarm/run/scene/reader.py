"""From the structure of a scene file to the fields of a Scene."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from ..._check import array, choice, known_keys, number
from ...arm.arm import Arm
from ...model.acting.control import control_laws
from ...model.acting.drive import Motion, SpinUp
from ...model.parts.arguments import arguments
from ...model.parts.tables import read, read_file
from ..integrators import INTEGRATORS
from ..start import WORDS, start
from .grammar import OPTIONS, SAMPLES, SIMULATION, Samples, SceneFile, output_times
from .samples import Files, samples


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


def _drives(file: SceneFile) -> dict[Any, Any]:
    found: dict[Any, Any] = {}
    for k, drive in enumerate(file.drive):
        if len(drive.laws) != 1:
            raise ValueError(f"drive[{k}]: needs link and one of motion, spin_up, torque")
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
    drive = _drives(file)
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
