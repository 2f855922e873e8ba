"""Scenes as text: the TOML that `load` reads back."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from .._check import Array
from ..acting.control import PD, StateFeedback, StrainFeedback
from ..acting.drive import Motion, SpinUp, Torque
from ..acting.load import Load
from ..acting.motor import Motor
from ..acting.sampled import is_samples
from ..acting.voltage import is_patch

if TYPE_CHECKING:
    from ..arm import Arm
    from .scene import Scene

_SAMPLES = 2001  # of a callable


def _plain(value: Any) -> Any:
    """Python's own numbers and lists, without None."""
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items() if v is not None}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    return value.item() if isinstance(value, np.generic) else value


def _value(value: Any) -> str:
    """One TOML value on one line."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{k} = {_value(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(_value(v) for v in value) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")  # which JSON lets pass
    if value is None or not isinstance(value, (int, float)):
        raise ValueError(f"{value!r}: is Python code, which a scene file cannot hold")
    return repr(value)


def _table(name: str, table: Mapping[str, Any], array: bool = False) -> list[str]:
    """A table, its large sub-tables as tables of their own."""
    large = {k: v for k, v in table.items() if isinstance(v, Mapping) and len(_value(v)) > 90}
    lines = ["", f"[[{name}]]" if array else f"[{name}]"]
    lines += [f"{k} = {_value(v)}" for k, v in table.items() if k not in large]
    for k, v in large.items():
        lines += _table(f"{name}.{k}", v)
    return lines


class _Laws:
    """Laws of time as tables; `notes` tells of callables, which can only be sampled."""

    def __init__(self, arm: Arm, t: Array) -> None:
        self.arm, self.t = arm, t
        self.dense = np.union1d(t, np.linspace(t[0], t[-1], _SAMPLES))
        self.notes: list[str] = []

    def _sampled(self, where: str, n: int) -> None:
        self.notes.append(f"{where} was a function of time; here are {n} samples of it.")

    def scalar(self, where: str, law: Any, column: str) -> Any:
        """A number, or samples, linear in between."""
        if law.constant:
            return float(law(0.0))
        sampled = callable(law.law) and not hasattr(law.law, "breaks")
        if sampled:
            self._sampled(where, len(self.dense))
        times = self.dense if sampled else law.law.breaks
        return {"t": times, column: [law(float(x)) for x in times]}

    def motion(self, where: str, law: Motion) -> dict[str, Any]:
        """Positions, rates and accelerations at its knots: the same quintic pieces."""
        if isinstance(law.law, SpinUp):
            return {"spin_up": {"speed": law.law.speed, "time": law.law.time}}
        times = getattr(law.law, "breaks", None)
        if times is None:
            times = self.dense
            self._sampled(where, len(times))
        q, v, a = np.array([law(float(x)) for x in times]).T
        return {"motion": {"t": times, "q": q, "v": v, "a": a}}

    def load(self, where: str, load: Load) -> dict[str, Any]:
        out: dict[str, Any] = {"link": load.link, "x": load.x, "along": load.along, "axes": load.axes}
        if isinstance(load.law, tuple) and load.constant:
            return {**out, "force": load(0.0)[:3], "moment": load(0.0)[3:]}
        times = load.law[0].breaks if isinstance(load.law, tuple) else self.dense
        if not isinstance(load.law, tuple):
            self._sampled(where, len(times))
        wrench = np.array([load(float(x)) for x in times])
        return {**out, "t": times, "force": wrench[:, :3], "moment": wrench[:, 3:]}

    def control(self, where: str, law: Any) -> dict[str, Any]:
        table = getattr(law, "table", None)
        if table is not None and not callable(table["reference"]):
            motor = table.get("motor")
            if is_samples(table["reference"]):
                table = {**table, "reference": dict(zip("tr", table["reference"], strict=True))}
            return {**table, "motor": None if motor is None else _motor(motor)}
        if isinstance(law, StateFeedback):
            about = {k: getattr(law, k) for k in ("K", "q0", "v0", "u0")}
            # a file's list is a column of forces, as is what (link, freedom) and patches stand for
            columns = law._columns(self.arm)
            named = [c if isinstance(a, tuple) else a for a, c in zip(law.actuate, columns, strict=True)]
            about["actuate"] = named
            return {"type": "state_feedback", **about, "limit": _finite(law.limit)}
        if table is not None or not isinstance(law, (PD, StrainFeedback)):
            raise ValueError(f"{where} = {law!r}: is Python code, which a scene file cannot hold")
        names = ("kp", "kv", "link", "freedom")
        out: dict[str, Any] = {"type": "pd", **{k: getattr(law, k) for k in names}}
        if isinstance(law, StrainFeedback):
            out |= {"type": "strain_feedback", **{k: getattr(law, k) for k in ("ks", "x", "strain", "beam")}}
        out["reference"] = self.scalar(f"{where}.reference", law.reference, "r")
        return {**out, "limit": _finite(law.limit), "motor": None if law.motor is None else _motor(law.motor)}


def _finite(limit: float) -> float | None:
    return float(limit) if np.isfinite(limit) else None


def _motor(motor: Motor) -> dict[str, Any]:
    names = ("torque_constant", "gear_ratio", "efficiency", "limit", "resistance", "rotor_inertia")
    return {k: getattr(motor, k) for k in names}


def _drive(laws: _Laws, where: str, key: Any, law: Any) -> dict[str, Any]:
    if is_patch(key):
        return {"link": key[1], "patch": key[2], "voltage": laws.scalar(where, law, "V")}
    link = dict(zip(("link", "freedom"), key if isinstance(key, tuple) else (key,), strict=False))
    if isinstance(law, Torque):
        return {**link, "torque": laws.scalar(where, law, "tau")}
    return {**link, **laws.motion(where, law)}


def scene_text(scene: Scene, comment: str = "") -> str:
    """The scene file of a scene.

    Args:
        comment: lines at its head.

    Raises:
        ValueError: what no scene file can hold: output times that do not begin at 0 or are not evenly spaced, and
            controllers that are Python code.
    """
    t = scene.t
    count, duration = len(t) - 1, float(t[-1])
    if count < 1 or t[0] != 0.0 or np.abs(t - np.linspace(0.0, duration, count + 1)).max() > 1e-9 * duration:
        raise ValueError("t: a scene file's output times begin at 0 and are evenly spaced; these are not")
    laws = _Laws(scene.arm, t)
    drives = [_drive(laws, f"drive[{k}]", key, law) for k, (key, law) in enumerate(scene.drive.items())]
    loads = [laws.load(f"load[{k}]", load) for k, load in enumerate(scene.loads)]
    controls = [laws.control(f"control[{k}]", law) for k, law in enumerate(scene.control)]
    sensors = [sensor.to_dict() for sensor in scene.sensors]
    arm = scene.arm.to_dict()
    for key, value in scene.options.items():
        if not isinstance(value, (str, int, float, np.generic, type(None))):
            raise ValueError(f"options: {key} = {value!r}: is Python code, which a scene file cannot hold")
    simulation = {"duration": duration, "interval": duration / count, "q0": scene.q0, "v0": scene.v0, **scene.options}
    lines = [f"title = {_value(scene.name)}", f"gravity = {_value(_plain(arm['gravity']))}"]
    groups = (("link", arm["link"]), ("drive", drives), ("load", loads), ("control", controls), ("sensor", sensors))
    for name, tables in groups:
        for table in tables:
            lines += _table(name, _plain(table), array=True)
    lines += _table("simulation", _plain(simulation))
    head = [f"# {''.join(filter(str.isprintable, line))}".rstrip() for line in [*comment.splitlines(), *laws.notes]]
    return "\n".join([*head, *lines]) + "\n"
