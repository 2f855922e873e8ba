"""Scene files: an arm, what drives it and for how long, in TOML or in the same structure of dictionaries."""

from __future__ import annotations

import csv
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .._check import Array, array, choice, known_keys, named, number, whole
from ..acting.control import PD, Controller, StateFeedback, StrainFeedback, control_laws
from ..acting.drive import Motion, Torque
from ..acting.load import Load
from ..acting.motor import Motor
from ..acting.sampled import LinearController
from ..acting.voltage import Voltage
from ..arm import METHODS, Arm
from ..parts import beam as model
from ..parts import joints
from ..parts.link import Link
from ..parts.patch import Patch, Piezo
from ..run.result import Result
from ..run.simulation import INTEGRATORS, simulate
from ..sensing import sensors
from ..sensing.reading import Reading
from ..sensing.sensor import Sensor
from ..store.files import write_whole

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

SCENES = Path(__file__).parents[1] / "scenes"
_SECTIONS = {"rectangle": model.Rectangle, "circle": model.Circle, "general": model.GeneralSection}
_ALONG = {**_SECTIONS, "taper": model.Taper}
_JOINTS = {j.type: j for j in joints.Joint.__subclasses__()}
_CONTROLS: dict[str, Callable[..., Controller]] = {
    "pd": PD,
    "strain_feedback": StrainFeedback,
    "state_feedback": StateFeedback,
    "pid": LinearController.pid,
}
_SENSORS = {s.type: s for s in sensors.KINDS}


def _make(where: str, cls: Callable[..., Any], table: Mapping[str, Any], known: tuple[str, ...]) -> Any:
    """cls(**table), with errors that say where in the scene they are."""
    known_keys(where, table, known)
    try:
        return cls(**table)
    except ValueError as e:
        raise ValueError(f"{where}.{e}") from None
    except TypeError as e:
        import inspect

        needed = [p.name for p in inspect.signature(cls).parameters.values() if p.default is p.empty]
        missing = [n for n in needed if n not in table]
        if not missing:
            raise ValueError(f"{where}: {e}") from None
        raise ValueError(f"{where}: missing {', '.join(missing)}") from None


def _names(cls: type) -> tuple[str, ...]:
    import dataclasses

    return tuple(f.name for f in dataclasses.fields(cls) if f.init)


def _typed(where: str, table: Any, kinds: Mapping[str, Any]) -> Any:
    """A table {type = "...", ...} of one of several kinds."""
    if not isinstance(table, Mapping) or "type" not in table:
        raise ValueError(f"{where} = {table!r}: must be a table with a type: {', '.join(kinds)}")
    cls = kinds[choice(f"{where}.type", table["type"], kinds)]
    rest = {k: v for k, v in table.items() if k != "type"}
    return _make(where, cls, rest, _names(cls))


def _beam(where: str, table: Any) -> model.Beam:
    known_keys(where, table, _names(model.Beam))
    t = dict(table)
    if "section" in t:
        section, at = t["section"], f"{where}.section"
        if isinstance(section, Mapping) and isinstance(section.get("sections"), (list, tuple)):
            parts = [_typed(f"{at}.sections[{k}]", s, _SECTIONS) for k, s in enumerate(section["sections"])]
            section = {**section, "sections": parts}
        t["section"] = _typed(at, section, _ALONG)
    if "material" in t:
        t["material"] = _make(f"{where}.material", model.Material, t["material"], _names(model.Material))
    if "basis_tip" in t:
        t["basis_tip"] = _make(f"{where}.basis_tip", model.RigidBody, t["basis_tip"], _names(model.RigidBody))
    if "patches" in t:
        if not isinstance(t["patches"], (list, tuple)):
            raise ValueError(f"{where}.patches = {t['patches']!r}: must be a list of tables")
        t["patches"] = [_patch(f"{where}.patches[{k}]", p) for k, p in enumerate(t["patches"])]
    return _make(where, model.Beam, t, _names(model.Beam))  # type: ignore[no-any-return]


def _patch(where: str, table: Any) -> Patch:
    known_keys(where, table, _names(Patch))
    t = dict(table)
    if "material" in t:
        t["material"] = _make(f"{where}.material", Piezo, t["material"], _names(Piezo))
    return _make(where, Patch, t, _names(Patch))  # type: ignore[no-any-return]


def _link(where: str, table: Any) -> Link:
    known_keys(where, table, _names(Link))
    t = dict(table)
    if "joint" not in t:
        raise ValueError(f"{where}: missing joint")
    joint = t["joint"]
    if isinstance(joint, Mapping):
        sides = {
            side: _make(f"{where}.joint.{side}", joints.Placement, joint[side], _names(joints.Placement))
            for side in ("inboard", "outboard")
            if side in joint
        }
        joint = {**joint, **sides}
    t["joint"] = _typed(f"{where}.joint", joint, _JOINTS)
    for body in ("hub", "tip"):
        if body in t:
            t[body] = _make(f"{where}.{body}", model.RigidBody, t[body], _names(model.RigidBody))
    if "beam" in t:
        t["beam"] = _beam(f"{where}.beam", t["beam"])
    return _make(where, Link, t, _names(Link))  # type: ignore[no-any-return]


@contextmanager
def shallow(what: str) -> Iterator[None]:
    """What is nested deeper than Python's stack, and cannot even be printed, is a ValueError."""
    try:
        yield
    except RecursionError:
        raise ValueError(f"{what}: is nested too deeply") from None


@shallow("scene")
def arm_from_dict(d: Mapping[str, Any]) -> Arm:
    known_keys("scene", d, ("gravity", "link"))
    links = d.get("link")
    if not isinstance(links, (list, tuple)) or not links:
        raise ValueError(f"link = {links!r}: must be a list of at least one table")
    arm = Arm._made([_link(f"link[{k}]", t) for k, t in enumerate(links)], d.get("gravity", (0.0, 0.0, 0.0)))
    arm._warned = False
    return arm


class _Files(NamedTuple):
    """Files that a scene names: relative to `base`, inside `allowed`."""

    base: Path
    allowed: Path

    def path(self, where: str, name: Any) -> Path:
        """Of a file that may be read. ValueError tells nothing of any other."""
        try:
            path: Path = (self.base / name).resolve()  # links are followed before the check
            allowed = self.allowed.resolve()
        except (TypeError, OSError, RuntimeError, ValueError):  # not a string, too long, a circle of links, a NUL
            raise ValueError(f"{where} = {name!r}: must be the name of a file") from None
        if not path.is_relative_to(allowed):
            raise ValueError(
                f"{where} = {name!r}: must be in the scene's folder, {str(self.allowed)!r}, or below; "
                "load(..., files=FOLDER) allows another"
            )
        return path


def _samples(where: str, table: Mapping[str, Any], columns: tuple[str, ...], files: _Files) -> dict[str, Array]:
    """Columns given in place or in a CSV file with a header line. Errors say nothing of what is in the file: it may not
    be meant for who reads them."""
    known_keys(where, table, (*columns, "file"))
    if "file" not in table:
        return {k: array(f"{where}.{k}", v) for k, v in table.items()}
    path, where = files.path(f"{where}.file", table["file"]), f"{where}.file = {str(table['file'])!r}"
    try:
        if path.exists() and not path.is_file():  # a pipe would be waited for
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


def _drive(where: str, table: Mapping[str, Any], files: _Files) -> tuple[Any, Motion | Torque | Voltage]:
    if isinstance(table, Mapping) and "patch" in table:
        return _voltage(where, table, files)
    known_keys(where, table, ("link", "freedom", "motion", "spin_up", "torque"))
    laws = [k for k in ("motion", "spin_up", "torque") if k in table]
    if "link" not in table or len(laws) != 1:
        raise ValueError(f"{where}: needs link and one of motion, spin_up, torque")
    link: Any = whole(f"{where}.link", table["link"])
    if "freedom" in table:
        link = (link, whole(f"{where}.freedom", table["freedom"]))
    law, value = laws[0], table[laws[0]]
    if law == "spin_up":
        return link, _make(f"{where}.spin_up", Motion.spin_up, value, ("speed", "time"))
    if law == "torque" and not isinstance(value, Mapping):
        return link, Torque(number(f"{where}.torque", value))
    columns = ("t", "q", "v", "a") if law == "motion" else ("t", "tau")
    samples = _samples(f"{where}.{law}", value, columns, files)
    return link, _make(f"{where}.{law}", Motion if law == "motion" else Torque, samples, columns)


def _control(where: str, table: Any, files: _Files) -> Controller:
    if not isinstance(table, Mapping) or "type" not in table:
        raise ValueError(f"{where} = {table!r}: must be a table with a type: {', '.join(_CONTROLS)}")
    make = _CONTROLS[choice(f"{where}.type", table["type"], _CONTROLS)]
    t = {k: v for k, v in table.items() if k != "type"}
    if isinstance(t.get("reference"), Mapping):
        samples = _samples(f"{where}.reference", t["reference"], ("t", "r"), files)
        missing = [k for k in ("t", "r") if k not in samples]
        if missing:
            raise ValueError(f"{where}.reference: missing {', '.join(missing)}")
        t["reference"] = (samples["t"], samples["r"])
    if "motor" in t:
        t["motor"] = _make(f"{where}.motor", Motor, t["motor"], _parameters(Motor))
    if isinstance(t.get("link"), list):
        t["link"] = tuple(t["link"])  # (link, freedom)
    return _make(where, make, t, _parameters(make))  # type: ignore[no-any-return]


def _parameters(function: Callable[..., Any]) -> tuple[str, ...]:
    import inspect

    return tuple(inspect.signature(function).parameters)


def _controls(tables: Any, arm: Arm, t: Array, files: _Files) -> tuple[Controller, ...]:
    if not isinstance(tables, (list, tuple)):
        raise ValueError(f"control = {tables!r}: must be a list of tables")
    found = []
    for k, table in enumerate(tables):
        found.append(_control(f"control[{k}]", table, files))
        try:
            control_laws(arm, found[k], t)
        except ValueError as e:
            raise ValueError(f"control[{k}]: {e}") from None
    return tuple(found)


def _voltage(where: str, table: Mapping[str, Any], files: _Files) -> tuple[Any, Voltage]:
    """Of a piezo patch: {link, patch, voltage}."""
    known_keys(where, table, ("link", "patch", "voltage"))
    for name in ("link", "voltage"):
        if name not in table:
            raise ValueError(f"{where}: missing {name}")
    key, value = ("patch", *(whole(f"{where}.{k}", table[k]) for k in ("link", "patch"))), table["voltage"]
    if not isinstance(value, Mapping):
        return key, Voltage(number(f"{where}.voltage", value))
    samples = _samples(f"{where}.voltage", value, ("t", "V"), files)
    return key, _make(f"{where}.voltage", Voltage, samples, ("t", "V"))


@dataclass
class Scene:
    """An arm, its drives by link (or by (link, freedom)), and how to simulate it.

    Attributes:
        arm: the arm.
        drive: Motion or Torque by link number, or by (link, freedom); Voltage by ("patch", link, patch).
        loads: forces and moments on slices.
        t: output times (s).
        q0, v0: initial state, or None for rest at zero.
        options: further keyword arguments of `simulate`: method, integrator, rtol, atol, max_order, linear_solver,
            step, spectral_radius, stages.
        name: the scene's title.
        sensors: what `flexarm run` reads; `sensor.read(scene.run())` does in Python.
        control: its controllers.
    """

    arm: Arm
    drive: dict[Any, Motion | Torque | Voltage] = field(default_factory=dict)
    loads: tuple[Load, ...] = ()
    t: Array = field(default_factory=lambda: np.linspace(0.0, 1.0, 1001))
    q0: Array | None = None
    v0: Array | None = None
    options: dict[str, Any] = field(default_factory=dict)
    name: str = "scene"
    sensors: tuple[Sensor, ...] = ()
    control: tuple[Controller, ...] = ()

    def run(self, progress: bool = False) -> Result:
        """Simulates the scene."""
        given = {"drive": self.drive, "loads": self.loads, "control": self.control}
        return simulate(self.arm, self.t, self.q0, self.v0, **given, progress=progress, **self.options)  # type: ignore

    def save(self, path: str | Path, comment: str = "") -> None:
        """Writes a scene file that `load` reads back; functions of time are sampled, which the file then says.

        Raises:
            ValueError: what no scene file can hold: uneven output times, controllers and options that are Python code;
                or a name that promises another format.
        """
        from .writer import scene_text

        file, text = named(path, ".toml"), scene_text(self, comment)
        try:
            content, back = text.encode(), scene_from_dict(tomllib.loads(text), name=self.name)
        except ValueError as e:
            raise ValueError(f"this scene cannot be saved, its file would not be read back: {e}") from None
        if back.arm != self.arm:
            raise ValueError("this scene cannot be saved: its file would be read back as another arm")
        write_whole(file, lambda f: f.write(content), "path")

    def readings(self, result: Result) -> dict[str, Reading]:
        """What the scene's sensors read of a result, by names such as "sensor-0-encoder"; none of a single row."""
        sensors = self.sensors if len(result.t) > 1 else ()
        return {f"sensor-{k}-{sensor.type}": sensor.read(result) for k, sensor in enumerate(sensors)}


def _sensors(tables: Any, arm: Arm, t: Array) -> tuple[Sensor, ...]:
    if not isinstance(tables, (list, tuple)):
        raise ValueError(f"sensor = {tables!r}: must be a list of tables")
    found: list[Sensor] = []
    for k, table in enumerate(tables):
        found.append(_typed(f"sensor[{k}]", table, _SENSORS))
        try:
            found[k].check(arm, t)
        except ValueError as e:
            raise ValueError(f"sensor[{k}]: {e}") from None
    return tuple(found)


_OPTIONS = ("method", "integrator", "rtol", "atol", "max_order", "linear_solver", "step", "spectral_radius", "stages")
_SIMULATION = ("duration", "interval", "q0", "v0", *_OPTIONS)


@shallow("scene")
def scene_from_dict(
    d: Mapping[str, Any], base: Path | None = None, name: str = "scene", allowed: Path | None = None
) -> Scene:
    """A Scene from the structure of a scene file; `base` is the folder that file names in it are relative to, `allowed`
    the one that they must stay in, `base` if None."""
    known_keys("scene", d, ("title", "gravity", "link", "drive", "load", "control", "sensor", "simulation"))
    files = _Files(base or Path(), allowed or base or Path())
    arm = arm_from_dict({k: d[k] for k in ("gravity", "link") if k in d})
    s = d.get("simulation", {})
    known_keys("simulation", s, _SIMULATION)
    duration, interval = (number(f"simulation.{k}", s.get(k, v)) for k, v in (("duration", 1.0), ("interval", 1e-3)))
    for key, value in (("duration", duration), ("interval", interval)):
        if not (value > 0 and np.isfinite(value)):
            raise ValueError(f"simulation.{key} = {value}: must be positive and finite")
    parts = duration / interval
    count = round(parts) if parts <= 1e7 else 0
    if not (1 <= count <= 10_000_000) or abs(count * interval - duration) > 1e-6 * duration:
        raise ValueError(f"simulation.interval = {interval}: must divide the duration, {duration}, into 1 to 1e7 parts")
    if "method" in s:
        choice("simulation.method", s["method"], METHODS)
    if "integrator" in s:
        choice("simulation.integrator", s["integrator"], INTEGRATORS)
    drives = d.get("drive", [])
    if not isinstance(drives, (list, tuple)):
        raise ValueError(f"drive = {drives!r}: must be a list of tables")
    drive: dict[Any, Motion | Torque | Voltage] = {}
    for k, table in enumerate(drives):
        link, law = _drive(f"drive[{k}]", table, files)
        if link in drive:
            raise ValueError(f"drive[{k}].link = {link}: is driven twice")
        drive[link] = law
    t = np.linspace(0.0, duration, count + 1)
    tables = d.get("load", [])
    if not isinstance(tables, (list, tuple)):
        raise ValueError(f"load = {tables!r}: must be a list of tables")
    known = ("link", "x", "force", "moment", "t", "along", "axes")
    loads = tuple(_make(f"load[{k}]", Load, table, known) for k, table in enumerate(tables))
    for k, load in enumerate(loads):
        try:
            load.place(arm)
        except ValueError as e:
            raise ValueError(f"load[{k}]: {e}") from None
    return Scene(
        arm,
        drive,
        loads,
        t,
        array("simulation.q0", s["q0"], (arm.nq,)) if "q0" in s else None,
        array("simulation.v0", s["v0"], (arm.nv,)) if "v0" in s else None,
        {k: s[k] for k in _OPTIONS if k in s},
        str(d.get("title", name)),
        _sensors(d.get("sensor", []), arm, t),
        _controls(d.get("control", []), arm, t, files),
    )


def load(path: str | Path, *, files: str | Path | None = None) -> Scene:
    """Reads a scene file (TOML). A bare name such as "ist" means a scene shipped with the package.

    Args:
        path: of the scene file.
        files: the folder that files of samples, which a scene may name (`torque = { file = "torque.csv" }`), must be
            in or below, whatever links lead there; None: the scene's own. Their names are relative to the scene's.

    Raises:
        ValueError: unreadable file, bad TOML, unknown key (the nearest known one is named) or bad value.
    """
    if not isinstance(path, (str, Path)):
        raise ValueError(f"scene = {path!r}: must be a path")
    p = Path(path)
    try:
        if not p.exists() and (SCENES / f"{p.name}.toml").exists() and p.parent == Path():
            p = SCENES / f"{p.name}.toml"
        with p.open("rb") as f, shallow("scene"):
            d = tomllib.load(f)
    except OSError as e:
        shipped = ", ".join(sorted(s.stem for s in SCENES.glob("*.toml")))
        raise ValueError(f"scene {str(path)!r}: {e.strerror}; shipped scenes are {shipped}") from None
    except ValueError as e:  # TOML's, Unicode's, and int's of numbers with thousands of digits
        raise ValueError(f"scene {str(path)!r}: {e}") from None
    try:
        return scene_from_dict(d, p.parent, p.stem, None if files is None else Path(files))
    except ValueError as e:
        raise ValueError(f"scene {str(path)!r}: {e}") from None
