"""Measured runs: the inputs that drive the arm, the outputs to read, and the distance from the data."""

from __future__ import annotations

import difflib
import warnings
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from .._check import Array, array, choice, mapping, warn
from ..arm.arm import Arm
from ..arm.variation import Setup
from ..data.compare import Comparison
from ..data.data import Data, constant
from ..data.signal import DataWarning
from ..data.units import unit
from ..model.acting.control import Controller
from ..model.acting.drive import Motion, Torque, Voltage, is_patch, is_strut
from ..run import outputs as run_outputs
from ..run.result import Result
from ..run.scene.scene import Scene
from ..run.sensing.sensor import Sensor
from ..run.sensitivity import Sensitivities
from ..run.start import check_one_start, state, warn_of_one_balance

_OFTEN = 0.99  # least samples of a sensor for each row of the data
_FIRST = 0.01  # first weight of a column with unknown noise, over its standard deviation
_INSTRUMENT: dict[str, Any] = {"noise": None, "resolution": None, "rate": None, "pulses": None}


def ideal(sensor: Sensor) -> Sensor:
    """The sensor without noise, quantisation and own sample times: these have no derivatives."""
    known = {f.name for f in fields(sensor)}
    return replace(sensor, **{k: v for k, v in _INSTRUMENT.items() if k in known})


@dataclass(frozen=True)
class Reader:
    """An output of a run.

    Attributes:
        read: (result, setup) -> (nt,). unit: its own, "" where that is not known.
        sensor, component, quantity: of a sensor's reading, its index, that of the component, and the measured quantity;
            else None, 0 and "".
    """

    read: Callable[[Result, Setup], Any]
    unit: str = ""
    sensor: int | None = None
    quantity: str = ""
    component: int = 0

    def __call__(self, result: Result, setup: Setup) -> Array:
        return np.asarray(self.read(result, setup))


@dataclass
class Run:
    """One measured run.

    Attributes:
        data: measured. setup, q0, v0: the setup of the run and its initial state.
        outputs: the readers, by columns of the data. t: times of the simulated rows, `every` of them for each row of
            the data. balance: the scene's q0 if it is a word, such as "equilibrium".
    """

    data: Data
    setup: Setup
    q0: Array
    v0: Array
    outputs: Mapping[str, Reader]
    every: int = 1
    balance: str | None = None

    @property
    def first(self) -> Array | str:
        """The initial coordinates for all parameters: numbers, or the word of an equilibrium."""
        return self.balance or self.q0

    @property
    def t(self) -> Array:
        """Times of the simulated rows (s)."""
        n = len(self.data)
        return np.asarray(np.interp(np.arange((n - 1) * self.every + 1) / self.every, np.arange(n), self.data.t))

    def read(self, result: Result, setup: Setup) -> Array:
        """All outputs at the times of the data, (outputs, nt)."""
        return np.array([np.asarray(f(result, setup))[:: self.every] for f in self.outputs.values()])

    def slopes(self, of: Sensitivities, setup: Setup) -> Array:
        """Derivatives of all outputs at the times of the data, (np, outputs, nt), of a run of this setup."""
        paths, changed = of.parameters, [list(of._changed(k)) for k in range(len(of.parameters))]
        found = np.zeros((len(paths), len(self.outputs), len(self.data)))
        for row, f in enumerate(self.outputs.values()):
            y, direct = f(of.result, setup), list(range(len(paths)))
            if f.sensor is not None:
                sensor = setup.sensors[f.sensor]
                assert isinstance(sensor, Sensor)
                direct = [k for k in direct if paths[k].startswith(f"sensor.{f.sensor}.")]
                moved = [k for k in range(len(paths)) if not paths[k].startswith("sensor.")]
                if moved:
                    sums = sensor._read_sums([[(w, result) for w, result, _ in changed[k]] for k in moved])
                    most = np.broadcast_to(np.inf if sensor.range is None else sensor.range, sums.shape[2:])
                    within = np.abs(y) < most[f.component]
                    found[moved, row] = (sums[:, :, f.component] * within)[:, :: self.every]
            for k in direct:
                by = np.array([w * (f(result, made) - y) for w, result, made in changed[k]])
                found[k, row] = by.sum(axis=0)[:: self.every]
        return found

    @property
    def measured(self) -> Array:
        """The measured outputs, (outputs, nt)."""
        return np.array([self.data[name] for name in self.outputs])

    def compared(self, result: Result, setup: Setup) -> Comparison:
        """The run compared with its data."""
        columns = {name: f(result, setup) for name, f in self.outputs.items()}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DataWarning)
            return result.compare(self.data, columns)


# -- inputs ------------------------------------------------------------------------------------------------------------


def drives(scene: Scene, data: Data, inputs: Mapping[Any, Any] | None) -> dict[Any, Any]:
    """The scene's drives, replaced by the measured ones where given."""
    found = dict(scene.drive)
    for key, signal in mapping("inputs", inputs, ", such as {0: 'torque'}, by keys of drives").items():
        if _of_control(key):
            continue
        place = _place(scene.arm, f"inputs[{key!r}]", key)
        same = [k for k in found if _place(scene.arm, f"drive[{k!r}]", k) == place]  # -1 means the last link
        found[same[0] if same else key] = _law(scene.arm, data, key, signal)
    return found


def controllers(scene: Scene, data: Data, inputs: Mapping[Any, Any] | None) -> tuple[Controller, ...]:
    """The scene's controllers, with the commands of the data as their references where given."""
    found = list(scene.control)
    for key, signal in (inputs or {}).items():
        if not _of_control(key):
            continue
        where, names = f"inputs[{key!r}]", [f"control.{k}.{name}" for k, c in enumerate(found) for name in _commands(c)]
        _, k, name = choice(where, key, names).split(".")
        controller = found[int(k)]
        try:
            given = {**controller._arguments(), name: _command(where, data, signal)}
            if np.all(given.get("limit") == np.inf):  # none, as it is kept
                given["limit"] = None
            found[int(k)] = type(controller)(**given)
        except ValueError as e:
            raise ValueError(str(e) if str(e).startswith(where) else f"{where}: {e}") from None
    return tuple(found)


def _of_control(key: Any) -> bool:
    return isinstance(key, str) and key.startswith("control.")


def _commands(controller: Controller) -> list[str]:
    """Arguments of a controller that a column may give."""
    return [name for name in ("reference", "reference_rate") if name in controller._arguments()]


def _command(where: str, data: Data, signal: Any) -> Any:
    """A reference: samples of a column, a Motion of it, or the value of a function of the data; or a list of these."""
    if isinstance(signal, (tuple, list)) and len(signal) == 2 and signal[0] is Motion:
        return Motion(data.t, data[choice(where, signal[1], data)])
    if isinstance(signal, (tuple, list)):
        return [_command(f"{where}[{k}]", data, x) for k, x in enumerate(signal)]
    if callable(signal):
        return signal(data)
    return data.t, data[choice(where, signal, data)]


def _place(arm: Arm, where: str, key: Any) -> Any:
    """The rate or the patch that a drive's key names."""
    try:
        if is_patch(key):
            return "patch", arm.patch_column(key[1], key[2])
        if is_strut(arm, key):
            return "strut", arm._strut(key)
        return arm.joint_rate(key)
    except (ValueError, TypeError) as e:
        raise ValueError(f"{where}: {e}") from None


def _law(arm: Arm, data: Data, key: Any, signal: Any) -> Any:
    where = f"inputs[{key!r}]"
    if isinstance(signal, (Motion, Torque, Voltage)):
        return signal
    kind, column = signal if isinstance(signal, (tuple, list)) and len(signal) == 2 else (None, signal)
    if isinstance(signal, type):
        kind, column = signal, None
    elif callable(column):
        law = column(data)
        if not isinstance(law, (Motion, Torque, Voltage)):
            raise ValueError(f"{where}: the function gave {law!r}; must give a Motion, a Torque or a Voltage")
        return law
    if kind not in (None, Motion, Torque, Voltage):
        raise ValueError(f"{where} = {signal!r}: must be a column, or (fa.Motion, column), or a function of the data")
    if kind is None:
        kind = Voltage if is_patch(key) else Torque
    if column is None and is_strut(arm, key):
        raise ValueError(f"{where} = {signal!r}: give the column of the strut's driven force, (fa.Torque, column)")
    if column is None:
        column = f"{'q' if kind is Motion else 'tau'} {arm.coordinates[arm.joint_rate(key)]}"
    column = choice(where, column, data)
    of, moves = data.units[column], ("rad", "m")
    if kind is not Motion and of in moves:
        raise ValueError(f"{where}: column '{column}' is in {of}, which is no force; is it (fa.Motion, '{column}')?")
    if kind is Motion and of and of not in moves:
        raise ValueError(f"{where}: column '{column}' is in {of}; a motion must be in rad or m")
    try:
        return kind(data.t, data[column])
    except ValueError as e:
        raise ValueError(f"{where}: {e}") from None


def used_inputs(inputs: Mapping[Any, Any] | None) -> set[str]:
    """Names of the columns that drive the arm."""
    found: set[str] = set()
    for x in (inputs or {}).values():
        parts = x if isinstance(x, (tuple, list)) else [x]
        found |= {y for part in parts for y in (part if isinstance(part, (tuple, list)) else [part])
                  if isinstance(y, str)}  # fmt: skip
    return found


# -- outputs -----------------------------------------------------------------------------------------------------------


def readers(
    scene: Scene, data: Data, asked: Any, inputs: Mapping[Any, Any] | None
) -> tuple[tuple[Sensor, ...], dict[str, Reader]]:
    """The sensors, including those of `asked`, and the readers by columns of the data."""
    sensors = [ideal(s) for s in scene.sensors]
    if asked is None:
        asked = _named_alike(scene, data, inputs)
    if isinstance(asked, str):
        asked = [asked]
    if not isinstance(asked, Mapping):
        asked = {name: name for name in asked}
    found: dict[str, Reader] = {}
    rates = [s.rate for s in scene.sensors]
    for name, spec in asked.items():
        where = f"outputs['{name}']"
        if name not in data:
            near = difflib.get_close_matches(str(name), data, n=1)
            hint = f"; did you mean '{near[0]}'?" if near else ""
            raise ValueError(f"{where}: is no column of the data, which are {', '.join(data)}{hint}")
        if isinstance(spec, Sensor):
            if ideal(spec) not in sensors:
                sensors.append(ideal(spec))
                rates.append(spec.rate)
            spec = f"sensor.{sensors.index(ideal(spec))}"
        found[name] = reader = _reader(scene.arm, sensors, where, spec)
        rate = None if reader.sensor is None else rates[reader.sensor]
        if rate is not None and rate * data.step < _OFTEN:
            raise ValueError(
                f"{where}: the sensor samples at {rate:g} Hz, and the data have rows at {1 / data.step:.5g} Hz: those "
                "between samples would be old ones. Give data at the times of the samples or, if it is interpolated "
                "between, a sensor with rate=None"
            )
    if not found:
        raise ValueError("outputs: name at least one column that was measured")
    return tuple(sensors), found


def _named_alike(scene: Scene, data: Data, inputs: Mapping[Any, Any] | None) -> dict[str, str]:
    sensors = [f"sensor.{k}" for k in range(len(scene.sensors))]
    own = [*sensors, *_at_rest(scene.arm)]
    alike = {name: name for name in data if name in own and name not in used_inputs(inputs)}
    if not alike:
        raise ValueError(
            f"outputs: give the quantities: no column of the data ({', '.join(data) or 'none'}) is called as a "
            f"sensor of the scene ({', '.join(sensors) or 'none'}) or a column of its runs "
            f"({', '.join(own[len(sensors) :][:3])}, ...); give {{'name in the data': 'sensor.0', a sensor, or a name "
            "in the run}"
        )
    return alike


def _at_rest(arm: Arm) -> Data:
    """The table of a run that stands still."""
    zero = np.zeros((2, arm.nv))
    return Result(arm, np.array([0.0, 1.0]), np.tile(arm.zero, (2, 1)), zero, zero, zero).to_data()


def _reader(arm: Arm, sensors: list[Sensor], where: str, spec: Any) -> Reader:
    if callable(spec):
        return Reader(lambda result, setup: _of_function(where, spec, result))
    if not isinstance(spec, str):
        raise ValueError(f"{where} = {spec!r}: must be a sensor, 'sensor.0', a name in the run, or a function of it")
    if spec.startswith("sensor."):
        return _of_sensor(arm, sensors, where, spec)
    titles = run_outputs.titles(arm)
    rows = {name: (k, at, of) for k in ("q", "v", "a", "tau") for at, (name, of) in enumerate(titles[k])}
    if spec in rows:
        kind, column, own = rows[spec]
        return Reader(lambda result, setup: getattr(result, kind)[:, column], own)
    units = _at_rest(arm).units
    return Reader(lambda result, setup: result.to_data()[spec], units[choice(where, spec, units)])


def _of_function(where: str, of: Callable[[Result], Any], result: Result) -> Array:
    y = array(where, of(result))
    if y.shape not in (result.t.shape, (*result.t.shape, 1)):
        raise ValueError(f"{where} has shape {y.shape}: must be {len(result.t)} numbers, one for each row")
    return y.reshape(-1)


def _of_sensor(arm: Arm, sensors: list[Sensor], where: str, spec: str) -> Reader:
    known = [f"sensor.{k}" for k in range(len(sensors))]
    number, *component = spec.split(".")[1:]
    if f"sensor.{number}" not in known or len(component) > 1 or not all(c.isdigit() for c in component):
        there = f"there are {', '.join(known)}" if known else "the scene has no sensors"
        raise ValueError(f"{where} = '{spec}': {there}")
    k = int(number)
    parts = sensors[k].components(arm)
    if not component and len(parts) > 1:
        labels = ", ".join(f"'{spec}.{c}' ({label})" for c, (label, _) in enumerate(parts))
        raise ValueError(f"{where} = '{spec}': this sensor has {len(parts)} components; take one: {labels}")
    at = int(component[0]) if component else 0
    if at >= len(parts):
        raise ValueError(f"{where} = '{spec}': this sensor has {len(parts)} components, from 0 on")
    quantity, own = parts[at]
    return Reader(lambda result, setup: _read(setup.sensors[k], result)[:, at], unit(own).si, k, quantity, at)


def _read(sensor: Any, result: Result) -> Array:
    return sensor.read(result).y  # type: ignore[no-any-return]


# -- all of it ---------------------------------------------------------------------------------------------------------


def measured_run(
    scene: Scene, data: Data, inputs: Mapping[Any, Any] | None, asked: Any, where: str, paths: Collection[str] = ()
) -> Run:
    """A checked measured run of a scene; `paths` are the unknowns."""
    if not isinstance(data, Data):
        raise ValueError(f"{where} = {type(data).__name__}: must be fa.Data, such as fa.Data.load(...) gives")
    if len(data) < 3:
        raise ValueError(f"{where}: has {len(data)} rows: three or more are needed")
    scene.check_goes_on("a fit")
    sensors, found = readers(scene, data, asked, inputs)
    given = drives(scene, data, inputs), tuple(scene.loads), controllers(scene, data, inputs)
    setup = Setup(scene.arm, *given, sensors)
    q0, v0 = state(scene.arm, scene.q0, scene.v0, setup.drive, setup.loads, float(data.t[0]), setup.control)
    balance = scene.q0 if isinstance(scene.q0, str) else None
    check_one_start(balance, paths)
    warn_of_one_balance(scene.arm, scene.q0, setup.drive, setup.loads, float(data.t[0]), paths)
    run = Run(data, setup, q0, v0, found, balance=balance)
    _check(run, paths)
    for begin, length in data.gaps():
        text = (
            f"{where}: a gap of {length:.4g} s after t = {begin:.6g} s: measured inputs are interpolated there; where "
            "that matters, fit the parts as runs of their own (data.between)"
        )
        warn(text, DataWarning)
    return run


def _check(run: Run, paths: Collection[str]) -> None:
    """Raises ValueError for outputs that cannot be read, and units that do not match."""
    arm, still = run.setup.arm, np.zeros((2, run.setup.arm.nv))
    t = run.data.t[:2]
    result = Result(arm, t, np.array([run.q0, run.q0]), np.array([run.v0, run.v0]), still, still, loads=run.setup.loads)
    for name, f in run.outputs.items():
        f(result, run.setup)
        own, theirs = f.unit, run.data.units[name]
        if f.sensor is not None:
            scaled = np.any(getattr(run.setup.sensors[f.sensor], "gain", 1.0) != 1.0)
            if scaled or any(path.startswith(f"sensor.{f.sensor}.gain") for path in paths):
                own = ""  # a gain may have a unit
        if own and theirs and own != theirs:
            text = f"outputs['{name}']: the data are in {theirs}, and the output of the run is in {own}"
            if f.sensor is not None:
                per = f"{theirs} for each {own if own != '1' else 'unit'} of {f.quantity}"
                text += f"; add 'sensor.{f.sensor}.gain' to the parameters, which fits it, "
                text += f"or give this sensor a known gain, {per}"
            raise ValueError(text)


def scales(runs: list[Run], noise: Mapping[str, float]) -> dict[str, float]:
    """The first weight of each column: its noise if given, else a hundredth of its standard deviation."""
    names = dict.fromkeys(name for run in runs for name in run.outputs)
    found = {}
    for name in names:
        y = np.concatenate([run.data[name] for run in runs if name in run.outputs])
        if name not in noise and constant(y):
            raise ValueError(
                f"data: column '{name}' is constant ({y[0]:g}), it tells nothing; leave it out of outputs, or tell its "
                f"noise={{'{name}': ...}}"
            )
        own = float(np.sqrt(np.mean([r.data[name].var() for r in runs if name in r.outputs])))
        found[name] = noise.get(name, _FIRST * (own or float(y.std())))
    return found
