"""Recordings of the rig, those shipped and others like them; its scene for one, and its unknown parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..._check import Array
from ...arm.arm import Arm
from ...arm.variation import Setup, Variation
from ...data.compare import Comparison
from ...data.data import Data
from ...model.acting.control import StateFeedback
from ...model.acting.drive import Motion, Torque
from ...model.acting.load import Load
from ...run.scene.scene import Scene
from ...run.sensing.sensor import Component, Sensor
from ...run.sensing.sensors import Encoder, StrainGauge
from ..unknown import Unknown

FOLDER = Path(__file__).with_name("quanser")
SHIPPED = ("lqr", "fsf", "psf")  #: names of the files in FOLDER
JOINTS = ("joint1", "joint2")
DEFLECTIONS = ("link1_deflection", "link2_deflection")
CURRENTS = ("motor1_current", "motor2_current")
UNITS = {**dict.fromkeys((*JOINTS, *DEFLECTIONS), "rad"), **dict.fromkeys(CURRENTS, "A")}

RATE = 50.0  # Hz, to which recordings are averaged
_WINDOW = 5  # rows of a cubic's window, which smooths angles: encoder steps would spoil their accelerations
_LEAST_TARE = 0.02  # s; shorter rows of zeros are chance
_SETTLED = 0.5  # s: time for a gauge to settle after its tare


@dataclass(frozen=True)
class Recording:
    """One recording, prepared.

    Attributes:
        name: of its file. data: its columns in rad and A at RATE, on times from 0.
        tares: for how long each gauge read zero at the start (s), during the rig's tare (QUARC's "Bias Removal").
    """

    name: str
    data: Data
    tares: tuple[float, float]

    @property
    def judged(self) -> Array:
        """Rows after both gauges have settled, (nt,) of bool."""
        wait = max(self.tares)
        return np.asarray(self.data.t >= (wait + _SETTLED if wait else 0.0))

    @property
    def from_rest(self) -> bool:
        """Whether the arm is at rest at the start: a gauge is tared there, or no deflection changes within 0.25 s by a
        fifth of its standard deviation."""
        first = self.data.between(None, 0.25)
        return any(self.tares) or all(np.ptp(first[name]) < 0.2 * self.data[name].std() for name in DEFLECTIONS)

    def motion(self, column: str) -> Motion:
        """The joint's angle as measured, smoothed."""
        from scipy.signal import savgol_filter  # slow to import

        return Motion(self.data.t, savgol_filter(self.data[column], _WINDOW, 3))

    def current(self, column: str) -> Torque:
        """A torque of 1 N m for each measured ampere; a fit scales it."""
        return Torque(self.data.t, self.data[column])


def read(source: Any) -> Recording:
    """Reads a recording.

    Args:
        source: "lqr", "fsf" or "psf", shipped; the path of a file, or Data.

    Raises:
        ValueError: as of `Data.load`; columns that are missing or in another unit; less than 2 s, below 46 Hz.
    """
    if isinstance(source, Data):
        data = source
    else:
        shipped = isinstance(source, str) and source in SHIPPED
        data = Data.load(FOLDER / f"{source}.csv" if shipped else source)
    for name, unit in UNITS.items():
        if name not in data:
            raise ValueError(f"data: column '{name}' is missing; there must be {', '.join(UNITS)}")
        if data.units[name] not in (unit, ""):
            raise ValueError(f"data: column '{name}' is in {data.units[name]}: must be in {unit}, or convertible")
    data = data[list(UNITS)]
    if len(data) < 2 or data.t[-1] - data.t[0] < 2.0 or data.step > 1.1 / RATE:
        raise ValueError(f"data: {len(data)} rows every {data.step:.3g} s: must be 2 s or more, at 46 Hz or more")
    tares = tuple(_tare(data, name) for name in DEFLECTIONS)
    name = Path(source).stem if isinstance(source, (str, Path)) else data.name or "data"
    return Recording(name, _averaged(data), tares)  # type: ignore[arg-type]


def _tare(data: Data, name: str) -> float:
    """Time for which a gauge read zero at the start (s)."""
    alive = np.flatnonzero(data[name])
    wait = float(data.t[alive[0]] - data.t[0]) if alive.size else 0.0
    return wait if wait > _LEAST_TARE else 0.0


def _averaged(data: Data) -> Data:
    """Means over enough rows for RATE, on times from 0."""
    n = max(1, round(1.0 / (RATE * data.step)))
    rows = len(data) // n * n

    def mean(x: Array) -> Array:
        return np.asarray(x[:rows].reshape(-1, n).mean(axis=1))

    t = mean(data.t - data.t[0])
    return Data(t - t[0], {k: mean(data[k]) for k in data}, data.units, data.name)


#: Unknown parameters of the arm, by path, and prior knowledge of them.
ARM = {
    "link.0.beam.material.youngs_modulus": Unknown(mean=2.07e11, std=0.4e11),
    "link.1.beam.material.youngs_modulus": Unknown(mean=2.07e11, std=0.4e11),
    "link.0.tip.mass": Unknown(mean=1.4, std=0.5),
    "link.0.beam.kelvin_voigt": Unknown(low=0.0, high=0.05),
    "link.1.beam.kelvin_voigt": Unknown(low=0.0, high=0.05),
    "strut.cable.damping": Unknown(low=0.0),
}
#: Parameters that differ from recording to recording: the zero of the second joint's encoder, the calibration of both
#: gauges, the cable's stiffness and the length at which it is taut.
PER_RUN = {
    "link.1.joint.outboard.rotation.2": Unknown(0.0, mean=0.0, std=0.5, low=-1.5, high=1.5),
    "sensor.0.gain": Unknown(1.0, mean=1.0, std=0.2),
    "sensor.1.gain": Unknown(1.0, mean=1.0, std=0.2),
    "sensor.0.offset": Unknown(0.0, mean=0.0, std=0.005),
    "sensor.1.offset": Unknown(0.0, mean=0.0, std=0.005),
    "strut.cable.stiffness": Unknown(15.0, mean=15.0, std=10.0, low=0.0),
    "strut.cable.length": Unknown(1.13, mean=1.13, std=0.05),
}
#: State of the strips at the start of a recording that does not begin at rest: mean curvatures and their rates.
START = {
    "q0.1": Unknown(0.0, mean=0.0, std=0.3, each_run=False),
    "q0.4": Unknown(0.0, mean=0.0, std=0.3, each_run=False),
    "v0.1": Unknown(0.0, mean=0.0, std=5.0, each_run=False),
    "v0.4": Unknown(0.0, mean=0.0, std=5.0, each_run=False),
}
#: Unknown parameters of the drives. The handbook's torques of an ampere are 8.9 and 0.87 N m, at an assumed efficiency.
#: Each drive has dry and viscous friction, and some that saturates (control.0, control.1: N m s/rad at rest, N m at
#: most): together a curve that bends down, as harmonic drives have it.
DRIVES = {
    "drive.0.scale": Unknown(mean=8.9, std=2.0),
    "drive.1.scale": Unknown(mean=0.9, std=1.0),
    "drive.0.offset": Unknown(mean=0.0, std=0.2),
    "drive.1.offset": Unknown(mean=0.0, std=0.05),
    "link.0.joint.coulomb": Unknown(low=0.0),
    "link.1.joint.coulomb": Unknown(low=0.0),
    "link.0.joint.damping": Unknown(low=0.0),
    "link.1.joint.damping": Unknown(low=0.0),
    "link.0.joint.reflected_inertia": Unknown(mean=0.063, std=0.05),
    "control.0.K.0.6": Unknown(low=0.0),
    "control.0.limit": Unknown(low=1e-3),
    "control.1.K.0.9": Unknown(low=0.0),
    "control.1.limit": Unknown(low=1e-4),
}
_STILL = 0.02  # rad/s, below which a joint stands still at the start: the encoder's steps resolve no less
#: Values of PER_RUN and of DRIVES, in order, fitted to the shipped recordings with the scene's values of the arm. The
#: drives are not alike: the second one of "fsf" and "psf" needs six times the current of "lqr" to slide.
IDENTIFIED = {
    "lqr": (
        (-0.737, 1.079, 0.943, 1e-4, -2.4e-4, 9.4, 1.127),
        (11.9, 0.881, -0.119, -0.0108, 1.58, 0.0692, 2.29, 0.0843, 0.212, 4.52, 1.72, 0.325, 0.0567),
    ),
    "fsf": (
        (0.080, 0.839, 0.901, 8.3e-4, 7.4e-4, 5.25, 1.057),
        (6.83, 1.54, 0.125, 0.0124, 0.635, 0.809, 0.562, 5.94e-12, 0.0741, 1.52, 1.1, 4.57e-12, 0.103),
    ),
    "psf": (
        (0.034, 0.841, 0.897, 8.6e-4, 6.1e-4, 18.1, 1.123),
        (10.1, 0.933, 0.162, 0.0167, 0.899, 0.44, 1.74, 0.0652, 0.105, 1.95, 0.796, 0.0289, 0.000632),
    ),
}


def identified(name: str) -> tuple[dict[str, float], dict[str, float]]:
    """The values of IDENTIFIED, by path: of PER_RUN, and of DRIVES."""
    each, drives = IDENTIFIED[name]
    return dict(zip(PER_RUN, each, strict=True)), dict(zip(DRIVES, drives, strict=True))


@dataclass(frozen=True)
class TaredGauge(StrainGauge):
    """A strain gauge that reads an angle (rad). Until `tare` (s) it reads 0, and afterwards subtracts its mean up to
    `tare`, as the rig takes its zero."""

    tare: float = 0.0

    def components(self, arm: Arm) -> list[Component]:
        return [("deflection", "rad")]

    def _measure(self, arm: Arm, t: Array, q: Array, v: Array, a: Any, loads: Sequence[Load] | None) -> Array:
        y = super()._measure(arm, t, q, v, a, loads)
        dead = np.asarray(t < self.tare)
        if t.ndim and dead.any():
            y = np.where(dead[:, None], 0.0, y - y[dead].mean(axis=0))
        return y


def with_motion(scene: Scene, recording: Recording) -> Scene:
    """The scene with its joints moved as measured, and its gauges tared as in the recording."""
    drive: dict[Any, Any] = {k: recording.motion(name) for k, name in enumerate(JOINTS)}
    return replace(scene, drive=drive, t=np.array(recording.data.t), sensors=tuple(_sensors(scene, recording).values()))


def with_currents(scene: Scene, recording: Recording) -> Scene:
    """The scene with the measured currents in its motors, and the joints' measured start."""
    moved, arm = with_motion(scene, recording), scene.arm
    q0 = scene.start()
    v0 = np.zeros(arm.nv) if scene.v0 is None else np.array(scene.v0)
    friction = []
    for k, name in enumerate(JOINTS):
        i = arm.joint_rate(k)
        q0[arm.coordinate_of(i)], rate, _ = recording.motion(name)(0.0)
        v0[i] = rate if abs(rate) > _STILL else 0.0
        K, actuate = np.zeros((1, 2 * arm.nv)), np.zeros((1, arm.nv))
        K[0, arm.nv + i] = actuate[0, i] = 1.0
        friction.append(StateFeedback(K.tolist(), actuate=actuate.tolist(), limit=1.0))
    drive: dict[Any, Any] = {k: recording.current(name) for k, name in enumerate(CURRENTS)}
    return replace(moved, drive=drive, control=(*scene.control, *friction), q0=q0, v0=v0)


def with_values(scene: Scene, values: Mapping[str, float]) -> Scene:
    """The scene with these values, by path."""
    varied = Variation(Setup.of(scene), {path: np.array([x]) for path, x in values.items()}).scenario(0)
    return replace(scene, arm=varied.arm, drive=varied.drive, control=varied.control, sensors=varied.sensors)  # type: ignore


def compared(scene: Scene, recording: Recording, names: Sequence[str]) -> Comparison:
    """Compares a run of the scene with the recording."""
    result = scene.run()
    read = {name: sensor.read(result).y[:, 0] for name, sensor in outputs(scene, names).items()}
    return result.compare(recording.data, read)


def outputs(scene: Scene, names: Sequence[str]) -> dict[str, Sensor]:
    """The sensor of each column of the recordings."""
    return {name: scene.sensors[(*DEFLECTIONS, *JOINTS).index(name)] for name in names}


def _sensors(scene: Scene, recording: Recording) -> dict[str, Sensor]:
    """The scene's gauges by column, tared as in the recording, and its encoders without their steps."""
    gauges = [s for s in scene.sensors if isinstance(s, StrainGauge)]
    encoders = [s for s in scene.sensors if isinstance(s, Encoder)]
    found: dict[str, Sensor] = {}
    for name, gauge, tare in zip(DEFLECTIONS, gauges, recording.tares, strict=True):
        settings = {f: getattr(gauge, f) for f in ("link", "x", "face", "gauge_factor", "filter", "gain", "offset")}
        found[name] = TaredGauge(**settings, tare=tare)
    return found | {name: replace(e, pulses=None) for name, e in zip(JOINTS, encoders, strict=True)}
