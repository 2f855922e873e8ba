"""Scenes as text: the TOML that `load` reads back, and resolved numbers for C++, in the format of its room `scene`."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

import flexarm._core as _core

from ..._check import Array
from ...arm.arm import Arm
from ...arm.variation import Setup
from ...model.acting.control import Controller
from ...model.acting.drive import Motion, Scalar, SpinUp, is_patch, is_strut
from ...model.acting.load import Load
from ...model.acting.sampled import is_samples
from ...model.parts.chain import Chain
from ...model.parts.part import Part
from ..integrators import integrator_on
from ..problem import Problem
from .grammar import SAMPLES

_SAMPLES = 2001  # samples of a callable


def _plain(value: Any) -> Any:
    """A value as Python's own numbers, lists and tables, without None."""
    if isinstance(value, Part):
        return value.to_dict()
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
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")  # JSON does not escape it
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
    """Laws of time as tables; `notes` lists callables, which are sampled."""

    def __init__(self, arm: Arm, t: Array) -> None:
        self.arm, self.t = arm, t
        self.dense = np.union1d(t, np.linspace(t[0], t[-1], _SAMPLES))
        self.notes: list[str] = []

    def _sampled(self, where: str, n: int) -> None:
        self.notes.append(f"{where} was a function of time; here are {n} samples of it.")

    def scalar(self, where: str, name: str, law: Scalar) -> Any:
        """A number, or samples, linear in between."""
        if law.constant:
            return float(law(0.0))
        sampled = callable(law.law) and not hasattr(law.law, "breaks")
        if sampled:
            self._sampled(where, len(self.dense))
        times = self.dense if sampled else law.law.breaks
        return dict(zip(SAMPLES[name].columns, (times, [law(float(x)) for x in times]), strict=True))

    def motion(self, where: str, law: Motion) -> dict[str, Any]:
        """Positions, rates and accelerations at its knots: the same quintic pieces."""
        if isinstance(law.law, SpinUp):
            return {"spin_up": {"speed": law.law.speed, "time": law.law.time}}
        times = getattr(law.law, "breaks", None)
        if times is None:
            times = self.dense
            self._sampled(where, len(times))
        found = (times, *np.array([law(float(x)) for x in times]).T)
        return {"motion": dict(zip(SAMPLES["motion"].columns, found, strict=True))}

    def followed(self, where: str, reference: Any) -> Any:
        """A reference: a motion as a table, a number as it is."""
        if not isinstance(reference, Motion):
            return reference
        table = self.motion(where, reference)
        return table.get("motion", table)

    def drive(self, where: str, key: Any, law: Any) -> dict[str, Any]:
        if is_patch(key):
            return {"link": key[1], "patch": key[2], "voltage": self.scalar(where, "voltage", law)}
        if is_strut(self.arm, key):
            return {"strut": key, "torque": self.scalar(where, "torque", law)}
        link = dict(zip(("link", "freedom"), key if isinstance(key, tuple) else (key,), strict=False))
        moves = isinstance(law, Motion)
        return {**link, **(self.motion(where, law) if moves else {"torque": self.scalar(where, "torque", law)})}

    def load(self, where: str, load: Load) -> dict[str, Any]:
        if load.by_state:
            raise ValueError(f"{where}: follows from the state by a Python function, which a scene file cannot hold")
        out: dict[str, Any] = {"link": load.link, "x": load.x, "along": load.along, "axes": load.axes}
        if isinstance(load.law, tuple) and load.constant:
            return {**out, "force": load(0.0)[:3], "moment": load(0.0)[3:]}
        times = load.law[0].breaks if isinstance(load.law, tuple) else self.dense
        if not isinstance(load.law, tuple):
            self._sampled(where, len(times))
        wrench = np.array([load(float(x)) for x in times])
        return {**out, "t": times, "force": wrench[:, :3], "moment": wrench[:, 3:]}

    def control(self, where: str, law: Controller) -> dict[str, Any]:
        if not law.type:
            raise ValueError(f"{where} = {law!r}: is Python code, which a scene file cannot hold")
        out: dict[str, Any] = {"type": law.type}
        for name, value in law._arguments().items():
            if isinstance(value, Scalar):
                value = self.scalar(f"{where}.{name}", name, value)
            elif isinstance(value, Motion):
                value = self.followed(f"{where}.{name}", value)
            elif isinstance(value, (list, tuple)) and any(isinstance(x, Motion) for x in value):
                value = [self.followed(f"{where}.{name}[{k}]", x) for k, x in enumerate(value)]
            elif isinstance(value, Chain):
                raise ValueError(f"{where}.{name}: a scene file holds one arm; leave `{name}` out")
            elif name in SAMPLES and is_samples(value):
                value = dict(zip(SAMPLES[name].columns, value, strict=True))
            elif callable(value):
                raise ValueError(f"{where} = {law!r}: is Python code, which a scene file cannot hold")
            elif name == "actuate":
                # a list in a file is a column of forces: so are (link, freedom) and patches
                columns = zip(value, law._columns(self.arm), strict=True)
                value = [column if isinstance(entry, tuple) else entry for entry, column in columns]
            elif value is not None and name == "limit" and not np.isfinite(value).all():
                value = None
            out[name] = value
        return out


def _tables(scene: Mapping[str, Any], laws: _Laws) -> Iterator[tuple[str, Sequence[Mapping[str, Any]]]]:
    """The file's lists of tables, by name."""
    arm = laws.arm.to_dict()
    for name in ("link", "strut", "tendon", "contact", "loop"):
        yield name, arm.get(name, [])
    yield "drive", [laws.drive(f"drive[{k}]", *item) for k, item in enumerate(scene["drive"].items())]
    yield "load", [laws.load(f"load[{k}]", load) for k, load in enumerate(scene["loads"])]
    yield "control", [laws.control(f"control[{k}]", law) for k, law in enumerate(scene["control"])]
    yield "sensor", [sensor.to_dict() for sensor in scene["sensors"]]


def scene_text(scene: Mapping[str, Any], comment: str = "") -> str:
    """The text of a scene file.

    Args:
        scene: its fields, by name.
        comment: lines at its head.

    Raises:
        ValueError: output times that do not begin at 0 or are not evenly spaced, and controllers that are Python code.
    """
    t, arm, options = scene["t"], scene["arm"], scene["options"]
    count, duration = len(t) - 1, float(t[-1])
    if count < 1 or t[0] != 0.0 or np.abs(t - np.linspace(0.0, duration, count + 1)).max() > 1e-9 * duration:
        raise ValueError("t: a scene file's output times begin at 0 and are evenly spaced; these are not")
    for key, value in options.items():
        if not isinstance(value, (str, int, float, np.generic, type(None))):
            raise ValueError(f"options: {key} = {value!r}: is Python code, which a scene file cannot hold")
    if scene["events"]:
        raise ValueError("events: are Python code, which a scene file cannot hold")
    laws = _Laws(arm, t)
    lines = [f"title = {_value(scene['name'])}", f"gravity = {_value(_plain(arm.gravity))}"]
    for name, tables in _tables(scene, laws):
        for table in tables:
            lines += _table(name, _plain(table), array=True)
    about = {"duration": duration, "interval": duration / count, "q0": scene["q0"], "v0": scene["v0"], **options}
    lines += _table("simulation", _plain(about))
    head = [f"# {''.join(filter(str.isprintable, line))}".rstrip() for line in [*comment.splitlines(), *laws.notes]]
    return "\n".join([*head, *lines]) + "\n"


_NUMBERS = "a compiled scene holds numbers alone: give samples"


def compiled_text(scene: Any) -> str:
    """The compiled file of a scene.

    Raises:
        ValueError: a law that is Python code, named by its owner.
        RuntimeError: flexarm was built without it (FLEXARM_SCENES=OFF).
    """
    if not hasattr(_core, "scene_text"):
        raise RuntimeError("this flexarm was built without compiled scenes (FLEXARM_SCENES=OFF)")
    if scene.events:
        raise ValueError("events: are Python code, which a compiled scene cannot hold")
    integrator = integrator_on(scene, scene.options)

    def text(control: Any) -> str:
        run = Problem(Setup(scene.arm, scene.drive, scene.loads, control), scene.t, scene.q0, scene.v0)
        laws = {f"drive {key!r}": law for key, law in scene.drive.items()}
        laws |= {f"loads[{k}]": law for k, law in enumerate(scene.loads)}
        for where, law in laws.items():
            if not isinstance(law.law, (tuple, _core.PiecewisePolynomial)):
                raise ValueError(f"{where} = {law!r}: is a Python function; {_NUMBERS}")
        return _core.scene_text(run.core, run.times, integrator.core)

    try:
        return text(scene.control)
    except ValueError:
        for k, controller in enumerate(scene.control):  # find the controller with the law
            try:
                text([controller])
            except ValueError as e:
                raise ValueError(
                    f"control[{k}] = {controller!r}: is a Python function, or reads or follows one; {_NUMBERS}, or a "
                    f"controller of numbers, such as LinearController ({e})"
                ) from None
        raise
