"""Quantities of a run, for sweeps."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..._check import Array, array, choice
from ...arm.arm import Arm
from ...data.signal import last_above
from ...model.parts.beam import STRAIN_NAMES
from ...model.parts.labels import ends, joint_coordinates
from ...run.result import Result
from ...run.sensing.sensors import half_thickness
from ..batch.job import FAILED
from ..batch.problems import NOT_DONE

_PLACES = 17  # along a beam, for its largest strain


@dataclass(frozen=True)
class Quantity:
    """A quantity of a run: its columns with their units, and its function."""

    columns: Callable[[Arm, int], list[tuple[str, str]]]  #: (arm, link) -> [(name, unit), ...]
    of: Callable[[Result, int, float], Array]  #: (result, link, band) -> a number for each column
    forces: bool = False  #: whether it needs `Result.tau`


def _one(name: str, unit: str) -> Callable[[Arm, int], list[tuple[str, str]]]:
    return lambda arm, link: [(name, unit)]


def _residual(result: Result, link: int, band: float) -> Array:
    late = result.t >= result.t[-1] - 0.1 * (result.t[-1] - result.t[0])
    tip = result.tip_deflection(link)[late]
    return np.array([np.ptp(tip, axis=0).max() / 2])


def settling_time(t: Array, distance: Array, band: float) -> float:
    """From t[0] to the last time that `distance` was above `band` times its greatest value (s); nan where that is in
    the last tenth of the run, which then is too short to tell."""
    settled = last_above(t, distance, band * distance.max()) - float(t[0])
    return settled if settled <= 0.9 * float(t[-1] - t[0]) else float("nan")


def _settling(result: Result, link: int, band: float) -> Array:
    end = result.arm.end_places(result.q)
    return np.array([settling_time(result.t, np.linalg.norm(end - end[-1], axis=2).max(axis=1), band)])


def _strain(result: Result, link: int, band: float) -> Array:
    beam = result.arm.links[link].beam
    assert beam is not None
    greatest = 0.0
    for x in np.linspace(0.0, beam.length, _PLACES):
        strains = np.abs(result.strain(link, float(x)))
        stretch = strains[:, STRAIN_NAMES.index("eps")]
        for row, along in ((1, "z"), (2, "y")):  # K2 bends z, K3 bends y
            half = half_thickness(beam.section, along, float(x)) if strains[:, row].any() else 0.0
            on_face = stretch + strains[:, row] * (np.nan if half is None else half)
            greatest = max(greatest, float(on_face.max(initial=0.0)))
    return np.array([greatest])


def _joint_columns(suffix: str, *units: str) -> Callable[[Arm, int], list[tuple[str, str]]]:
    """A column for each freedom of the link's joint; units of turning and of sliding ones."""

    def columns(arm: Arm, link: int) -> list[tuple[str, str]]:
        rates = arm.joint_rates(link)
        kinds = {label: unit for _, label, unit in joint_coordinates(arm)}
        names = [arm.coordinates[i] for i in rates]
        return [(f"{name} {suffix}", units[kinds.get(name, "rad") != "rad"]) for name in names]

    return columns


def _of_joint(name: str) -> Callable[[Result, int, float], Array]:
    return lambda r, link, band: np.asarray(np.abs(getattr(r, name)[:, r.arm.joint_rates(link)]).max(axis=0))


def _state_columns(arm: Arm, link: int) -> list[tuple[str, str]]:
    return [
        (f"{kind} {label}", "") for kind, labels in (("q", arm.q_names), ("v", arm.coordinates)) for label in labels
    ]


def _tip(result: Result, link: int, band: float) -> Array:
    return np.array([np.linalg.norm(result.tip_deflection(link), axis=1).max()])


def _end_columns(arm: Arm, link: int) -> list[tuple[str, str]]:
    return [(f"{label} {c}", "m") for _, label in ends(arm) for c in "xyz"]


#: the quantities of sweeps, by name; docs/sweeps.md explains each
QUANTITIES: dict[str, Quantity] = {
    "tip_deflection": Quantity(_one("tip deflection", "m"), _tip),
    "residual": Quantity(_one("residual", "m"), _residual),
    "settling": Quantity(_one("settling", "s"), _settling),
    "strain": Quantity(_one("strain", "1"), _strain),
    "speed": Quantity(_joint_columns("speed", "rad/s", "m/s"), _of_joint("v")),
    "torque": Quantity(_joint_columns("force", "N m", "N"), _of_joint("tau"), forces=True),
    "energy": Quantity(_one("energy", "J"), lambda r, *_: np.array([sum(float(x[-1]) for x in r.energy())])),
    "end_position": Quantity(_end_columns, lambda r, *_: r.arm.end_places(r.q[-1]).ravel()),
    "final_state": Quantity(_state_columns, lambda r, *_: np.concatenate([r.q[-1], r.v[-1]])),
}


def quantity(output: str | Callable[[Result], float]) -> Quantity:
    """The quantity of this name; or of a function of a Result: one number, in a column with the function's name."""
    if isinstance(output, str):
        return QUANTITIES[choice("outputs", output, QUANTITIES)]
    if not callable(output):
        raise ValueError(f"outputs: {output!r}: must be one of {', '.join(QUANTITIES)}, or a function of a Result")
    name = getattr(output, "__name__", type(output).__name__)
    return Quantity(_one(name, ""), lambda r, *_: array(name, [output(r)], (1,)))


def check_quantities(arm: Arm, names: Sequence[Any], link: int | str) -> list[tuple[str, str]]:
    """The columns (name, unit) of these quantities; ValueError where this arm does not have one."""
    beam = arm.links[arm._link(link)].beam
    for name in names:
        if name in ("tip_deflection", "residual", "strain") and beam is None:
            raise ValueError(f"outputs: {name}: link {link} has no beam; choose another link, or other outputs")
        if name == "strain" and beam is not None and half_thickness(beam.section, "y", 0.0) is None:
            raise ValueError(f"outputs: strain: the section of link {link} does not tell how far its faces are")
    columns = [column for name in names for column in quantity(name).columns(arm, arm._link(link))]
    twice = {name for name, _ in columns if [n for n, _ in columns].count(name) > 1}
    if twice:
        raise ValueError(f"outputs: {sorted(twice)[0]!r} is noted twice")
    return columns


@dataclass(frozen=True)
class RunSummary:
    """The `Job.summary` of a sweep: quantities of each run and, with `trajectories`, every `every`-th row of q and v.
    The arguments are those of `SweepPlan`."""

    outputs: tuple[str | Callable[[Result], float], ...]
    link: int | str
    band: float
    trajectories: bool
    every: int

    def _columns(self, arm: Arm) -> list[str]:
        return [f"columns/{name}" for name, _ in check_quantities(arm, self.outputs, self.link)]

    def kept(self, arm: Arm, rows: int) -> dict[str, tuple[int, ...]]:
        """By name, the shapes of the arrays for a run with this number of rows."""
        few, numbers = len(range(0, rows, self.every)), dict.fromkeys(self._columns(arm), ())
        return numbers | ({"q": (few, arm.nq), "v": (few, arm.nv)} if self.trajectories else {})

    def __call__(self, arm: Arm, blocks: Mapping[str, Any], result: Callable[[int], Result]) -> dict[str, Any]:
        """These arrays of all runs in the blocks of a batch; nan if a run failed."""
        names, noted, link = self._columns(arm), [quantity(x) for x in self.outputs], arm._link(self.link)
        table = np.full((len(blocks["status"]), len(names)), np.nan)
        for k in np.flatnonzero(~np.isin(blocks["status"], (FAILED, NOT_DONE))).tolist():
            run = result(k)
            table[k] = np.concatenate([x.of(run, link, self.band) for x in noted])
        kept = {k: blocks[k][:, :: self.every] for k in ("q", "v") if self.trajectories}
        return {**dict(zip(names, table.T, strict=True)), **kept}
