"""Scene files: an arm, the actions on it and its simulation, in TOML or in the same structure of dictionaries."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np

from ..._check import Array, choice, known_keys, mapping, named, path_of
from ...arm.arm import Arm
from ...data.store.files import write_whole
from ...model.acting.control import Controller, controllers
from ...model.acting.drive import Motion, Torque, Voltage, is_strut
from ...model.acting.load import Load
from ...model.parts.arguments import arguments
from ...model.parts.tables import shallow
from ..integrators import Integrator
from ..problem import read_events
from ..result import Result
from ..sensing.reading import Reading
from ..sensing.sensor import Sensor
from ..simulation import simulate
from ..start import WORDS, start
from .fmu import unit_of
from .grammar import SceneFile
from .reader import Files, scene_fields
from .writer import compiled_text, scene_text

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

__all__ = ["ROBOTS", "SCENES", "Scene", "load", "scene_from_dict", "shallow", "tomllib"]

#: Readers of robots' files, by suffix.
ROBOTS = {".urdf": "from_urdf", ".xml": "from_mjcf", ".mjcf": "from_mjcf"}
SCENES = Path(__file__).parents[2] / "scenes"


_SHOWN = 6  # most entries of a list in print(scene)


@dataclass(repr=False)
class Scene:
    """An arm, its drives by link (or by (link, freedom)), and how to simulate it.

    Attributes:
        arm: the arm.
        drive: Motion or Torque by link number, or by (link, freedom); Torque by the name of a strut or tendon; Voltage
            by ("patch", link, patch).
        loads: forces and moments on slices.
        t: output times (s).
        q0, v0: initial state, or None for rest at zero; q0 as `simulate` takes it: numbers, joints by name, or
            "equilibrium", "trim" or "held", for each model of the arm; `start()` returns numbers.
        options: further keyword arguments of `simulate`: method, integrator, rtol, atol, max_order, linear_solver,
            step, spectral_radius, stages.
        name: the scene's title.
        sensors: read by `flexarm run`; in Python by `sensor.read(scene.run())`.
        control: its controllers.
        events: Touch, Release, and callables whose zeros are found, as `simulate` takes them. A scene file holds none.
    """

    arm: Arm
    drive: dict[Any, Motion | Torque | Voltage] = field(default_factory=dict)
    loads: tuple[Load, ...] = ()
    t: Array = field(default_factory=lambda: np.linspace(0.0, 1.0, 1001))
    q0: Any = None
    v0: Array | None = None
    options: dict[str, Any] = field(default_factory=dict)
    name: str = "scene"
    sensors: tuple[Sensor, ...] = ()
    control: tuple[Controller, ...] = ()
    events: Any = ()

    def __post_init__(self) -> None:
        mapping("drive", self.drive, ", by link number or name")
        self.control = controllers(self.control)
        if isinstance(self.q0, str):
            choice("q0", self.q0, WORDS)

    def given(self) -> dict[str, Any]:
        """The arguments of `simulate` for actions on the arm and for events."""
        return {name: getattr(self, name) or None for name in ("drive", "loads", "control", "events")}

    def check_goes_on(self, caller: str) -> None:
        """Raises ValueError if an event may end the scene's run early; `caller` compares whole runs."""
        for k, (_, count, _) in enumerate(read_events(self.events)):
            if count:
                raise ValueError(f"events[{k}].terminal = {count}: {caller} compares whole runs, which this would end")

    def start(self) -> Array:
        """Coordinates at the start, (nq,)."""
        return start(self.arm, self.q0, self.drive, self.loads, float(self.t[0]), None, self.control)

    def __repr__(self) -> str:
        return f"Scene({self.name!r}, {_links(self.arm.names)}, {self.arm.nv} coordinates, {self._times()})"

    def _times(self) -> str:
        return f"t = {float(self.t[0]):.6g} to {float(self.t[-1]):.6g} s at {len(self.t)} times"

    def __str__(self) -> str:
        """A line for each part of the scene."""
        names = self.arm.names

        def of(key: Any) -> Any:
            return names[self.arm._link(key)] if isinstance(key, (int, str)) and not is_strut(self.arm, key) else key

        drives = [f"{of(key)}: {law!r}" for key, law in self.drive.items()]
        start = repr(self.q0) if isinstance(self.q0, str) else _state(self.arm.q_names, self.start() - self.arm.zero)
        rates = "at rest" if self.v0 is None else _state(self.arm.coordinates, np.asarray(self.v0))
        said = {
            "arm": [f"{_links(names)}, {self.arm.nv} coordinates; print(scene.arm) describes it"],
            "time": [self._times()],
            "start": [start, f"rates: {rates}"],
            "drive": drives,
            "loads": list(map(repr, self.loads)),
            "control": list(map(repr, self.control)),
            "sensors": [sensor.title(self.arm) for sensor in self.sensors],
            "options": [f"{k} = {v}" for k, v in self.options.items()],
        }
        lines = [f"Scene {self.name!r}"]
        for name, parts in said.items():
            more = [f"and {len(parts) - _SHOWN} more"] if len(parts) > _SHOWN else []
            for k, part in enumerate([*parts[:_SHOWN], *more]):
                line = f"{'' if k else name:9}{part}"
                lines.append(line if len(line) <= 118 else f"{line[:115]}...")
        return "\n".join(lines)

    def run(self, progress: bool = False, error: bool = False) -> Result:
        """Simulates the scene; with `error` it also estimates how far the tip is off (Result.error)."""
        return simulate(
            self.arm, self.t, self.q0, self.v0, **self.given(), progress=progress, error=error, **self.options
        )  # fmt: skip

    def save(self, path: str | Path, comment: str = "") -> None:
        """Writes a scene file that `load` reads back; functions of time are sampled, with a comment in the file.

        Raises:
            ValueError: content that no scene file can hold: uneven output times, controllers and options that are
                Python code; or a file name of another format.
        """
        about = {f.name: getattr(self, f.name) for f in fields(self)}
        file, text = named(path, ".toml"), scene_text(about, comment)
        try:
            content, back = text.encode(), scene_from_dict(tomllib.loads(text), name=self.name)
        except ValueError as e:
            raise ValueError(f"this scene cannot be saved, its file would not be read back: {e}") from None
        if back.arm != self.arm:
            raise ValueError("this scene cannot be saved: its file would be read back as another arm")
        write_whole(file, lambda f: f.write(content), "path")

    def compile(self, path: str | Path) -> None:
        """Writes the scene as resolved numbers (JSON), which `flexarm::load_scene` of C++ reads: the arm, its drives,
        loads and controllers, its start, times and integrator, to the last bit. Sensors are left out.

        Raises:
            ValueError: a drive, load or controller that is Python code, by name; a file name of another format.
        """
        file, content = named(path, ".json"), compiled_text(self).encode()
        write_whole(file, lambda f: f.write(content), "path")

    def to_fmu(self, path: str | Path, integrator: Integrator | None = None, version: int = 3) -> None:
        """Writes the scene as a unit of FMI (.fmu) for co-simulation and model exchange, which other simulators
        import; at their side it needs neither Python nor a compiler.

        Args:
            path: of the file.
            integrator: of co-simulation: `Implicit`, `Gauss` or `RK4`, in place of the scene's own.
            version: of FMI: 3, or 2 for simulators that take no unit of FMI 3.0.

        Raises:
            ValueError: as `compile`; `Ida`, which takes no steps one by one; another version.
            RuntimeError: this installation has no library for units.

        Warns:
            ModelWarning: a sensor that a unit cannot have is left out.
        """
        scene = self if integrator is None else replace(self, options={"integrator": integrator})
        file, content = named(path, ".fmu"), unit_of(scene, version)
        write_whole(file, lambda f: f.write(content), "path")

    def readings(self, result: Result) -> dict[str, Reading]:
        """Readings of the scene's sensors from a result, by names such as "sensor-0-encoder"; none for a single row."""
        sensors = self.sensors if len(result.t) > 1 else ()
        return {f"sensor-{k}-{sensor.type}": sensor.read(result) for k, sensor in enumerate(sensors)}


def _links(names: Sequence[str]) -> str:
    return f"{len(names)} link{'s' * (len(names) != 1)}"


def _state(names: Sequence[str], x: Array) -> str:
    """The nonzero entries of a state in words."""
    at = np.flatnonzero(x)
    some = ", ".join(f"{names[i]} {x[i]:.4g}" for i in at[:_SHOWN])
    return f"{some}{' and more' if len(at) > _SHOWN else ''}" if len(at) else "zero"


@shallow("scene")
def scene_from_dict(
    d: Mapping[str, Any], base: Path | None = None, name: str = "scene", allowed: Path | None = None
) -> Scene:
    """A Scene from the structure of a scene file. File names in it are relative to the folder `base` and must stay in
    `allowed` (`base` if None)."""
    return Scene(**scene_fields(d, name, Files(base or Path(), allowed or base or Path())))


def _check_headers(path: str | Path, file: Path) -> None:
    """Raises ValueError for an unknown table name in a file that is not valid TOML: the likely cause."""
    names = re.findall(r"^\s*\[\[?\s*([A-Za-z_][\w-]*)[\w\s.-]*\]", file.read_text("utf-8", "replace"), re.MULTILINE)
    known_keys(f"scene {str(path)!r}", dict.fromkeys(names), arguments(SceneFile))


def load(path: str | Path, *, files: str | Path | None = None) -> Scene:
    """The scene of a TOML file, or a shipped one. A bare name such as "ist" means a scene shipped with the package.

    Args:
        path: of the scene file.
        files: the folder that must contain all files of samples which the scene names (`torque = { file = "torque.csv"
            }`), after symbolic links are resolved; None: the scene's own. Names are relative to the scene's folder.

    Raises:
        ValueError: unreadable file, bad TOML, unknown key (the nearest known one is named) or bad value.
    """
    p = path_of("scene", path)
    try:
        if not p.exists() and (SCENES / f"{p.name}.toml").exists() and p.parent == Path():
            p = SCENES / f"{p.name}.toml"
        with p.open("rb") as f, shallow("scene"):
            d = tomllib.load(f)
    except OSError as e:
        shipped = sorted(s.stem for s in SCENES.glob("*.toml"))
        near = get_close_matches(p.stem, shipped, n=1)
        hint = f"; did you mean '{near[0]}'?" if near else ""
        raise ValueError(f"scene {str(path)!r}: {e.strerror}; shipped scenes are {', '.join(shipped)}{hint}") from None
    except ValueError as e:  # of TOML, Unicode, or integers with thousands of digits
        if robot := ROBOTS.get(p.suffix.lower()):
            raise ValueError(f"scene {str(path)!r}: is a robot's file: fa.{robot} makes an arm of it") from None
        if p.suffix.lower() != ".toml":
            raise ValueError(
                f"scene {str(path)!r}: is not a scene file (.toml); a saved run (.npz, .h5) is for `flexarm view` and "
                f"Result.load ({e})"
            ) from None
        _check_headers(path, p)
        raise ValueError(f"scene {str(path)!r}: {e}") from None
    try:
        return scene_from_dict(d, p.parent, p.stem, None if files is None else Path(files))
    except ValueError as e:
        raise ValueError(f"scene {str(path)!r}: {e}") from None
