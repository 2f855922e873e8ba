"""Recordings of the rig: those shipped, and others with the same columns."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..._check import Array
from ...data.data import Data
from ...model.acting.drive import Motion, Torque

FOLDER = Path(__file__).with_name("quanser")
SHIPPED = ("lqr", "fsf")  #: names of the files in FOLDER
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
        source: "lqr" or "fsf", shipped; the path of a file, or Data.

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
