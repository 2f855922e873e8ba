"""The grammar of a scene file: its tables, and the objects made from them.

A table holds the arguments of the class made from it: the fields of `SceneFile` are a file's tables, which contain
those of a `Link` or a `Beam`. If a class has subclasses (joints, sections, controllers, sensors), the table's `type`
names one. So a new joint, or a new field of a beam, is read, written and explained without a change here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, cast

import numpy as np

from ..._check import Array, positive, whole
from ...model.acting.control import Controller
from ...model.acting.drive import Motion, SpinUp, Torque, Voltage
from ...model.acting.load import Load
from ...model.parts.arguments import Argument, arguments
from ...model.parts.tables import ArmFile
from .. import integrators
from ..sensing.sensor import Sensor
from ..simulation import simulate


class Samples(NamedTuple):
    """A law of time in a file: a table of samples, or a number if it has two columns."""

    columns: tuple[str, ...]
    make: Any  #: is called with the columns as arguments; None: the pair of columns is used
    moves: bool = False  #: whether it may be a motion (samples of q, a spin-up), or a list


#: Arguments that are laws of time, by name.
SAMPLES = {
    "motion": Samples(("t", "q", "v", "a"), Motion),
    "torque": Samples(("t", "tau"), Torque),
    "voltage": Samples(("t", "V"), Voltage),
    "reference": Samples(("t", "r"), None, moves=True),
    "reference_rate": Samples(("t", "r"), None),
    "feedforward": Samples(("t", "tau"), None),
}


def _link_of(link: Any) -> None:
    """A drive's link: its name, or a number."""
    if not isinstance(link, str):
        whole("link", link)


@dataclass(frozen=True)
class JointDrive:
    """The drive of a joint: exactly one of `motion`, `spin_up` and `torque`.

    Args:
        link: the link of the joint; a number or a name, as everywhere.
        freedom: the freedom of the joint, if it has several.
        motion: a prescribed motion (rad, m; `v` per s, `a` per s²): `q` alone, by a spline, or `q`, `v` and `a`, by
            quintic pieces; its reaction becomes an output.
        spin_up: a motion from rest to a speed.
        torque: N m, or the force (N) of a prismatic joint.
    """

    link: int | str
    freedom: int | None = None
    motion: Motion | None = None
    spin_up: SpinUp | None = None
    torque: Torque | None = None

    def __post_init__(self) -> None:
        _link_of(self.link)
        if self.freedom is not None:
            whole("freedom", self.freedom)

    @property
    def laws(self) -> list[Any]:
        spin_up = None if self.spin_up is None else Motion(self.spin_up)
        return [law for law in (self.motion, spin_up, self.torque) if law is not None]

    @property
    def key(self) -> Any:
        return self.link if self.freedom is None else (self.link, self.freedom)


@dataclass(frozen=True)
class PatchDrive:
    """The drive of a piezo patch.

    Args:
        link: the link whose beam has the patch.
        patch: the number of the patch on that beam.
        voltage: of the patch (V).
    """

    link: int | str
    patch: int
    voltage: Voltage

    def __post_init__(self) -> None:
        _link_of(self.link)
        whole("patch", self.patch)

    @property
    def laws(self) -> list[Any]:
        return [self.voltage]

    @property
    def key(self) -> Any:
        return "patch", self.link, self.patch


@dataclass(frozen=True)
class StrutDrive:
    """The drive of a strut or a tendon.

    Args:
        strut: the strut or tendon: its name.
        motion: of a strut with a mass: its length (m), as of a joint's drive.
        torque: the force (N) that is added to that of a strut, or the tension that is added to that of a tendon.
    """

    strut: str
    motion: Motion | None = None
    torque: Torque | None = None

    @property
    def laws(self) -> list[Any]:
        return [law for law in (self.motion, self.torque) if law is not None]

    @property
    def key(self) -> Any:
        return self.strut


def output_times(duration: float = 1.0, interval: float = 1e-3) -> Array:
    """The output times of a run (s), from 0.

    Args:
        duration: length of the simulation (s).
        interval: time between two outputs (s), an integer fraction of the duration.
    """
    duration, interval = positive("duration", duration), positive("interval", interval)
    parts = duration / interval
    count = round(parts) if parts <= 1e7 else 0
    if not (1 <= count <= 10_000_000) or abs(count * interval - duration) > 1e-6 * duration:
        raise ValueError(f"interval = {interval}: must divide the duration, {duration}, into 1 to 1e7 parts")
    return np.linspace(0.0, duration, count + 1)


def _options() -> dict[str, Argument]:
    """Arguments of `simulate` for the integrator and its options, whose defaults differ among integrators."""
    kinds = integrators.INTEGRATORS
    names = " or ".join(f'"{name}"' for name in kinds)
    words = f"{names}, whose options follow; None: as of `fa.simulate`."
    out = {"integrator": Argument("integrator", str | None, None, words)}
    for option, owners in integrators.OPTIONS.items():
        given = {name: arguments(cast(Any, kinds[name]))[option] for name in owners}
        meanings: dict[str, list[str]] = {}
        for name, a in given.items():
            meanings.setdefault(a.meaning, []).append(f'"{name}"')
        words = " ".join(f"Of {' and '.join(whose)}: {text}" for text, whose in meanings.items())
        out[option] = Argument(option, given[owners[0]].hint | None, None, words)
    return out


OPTIONS = _options()
#: The arguments of [simulation].
SIMULATION = {**arguments(output_times), **{k: arguments(simulate)[k] for k in ("q0", "v0")}, **OPTIONS}


@dataclass(frozen=True)
class SceneFile(ArmFile):
    """A scene file: an arm, its drives, loads, controllers and sensors, and the simulation.

    Args:
        title: of tables and figures; None: the file's name.
        drive: drives of joints, struts, tendons and piezo patches.
        load: external forces and moments.
        control: controllers; their forces add to the drives'.
        sensor: sensors; `flexarm run` writes their readings as sensor-K-TYPE.csv.
        simulation: length and options of the simulation.
    """

    title: str | None = None
    drive: Sequence[JointDrive | PatchDrive | StrutDrive] = ()
    load: Sequence[Load] = ()
    control: Sequence[Controller] = ()
    sensor: Sequence[Sensor] = ()
    simulation: Mapping[str, Any] = field(default_factory=dict)
