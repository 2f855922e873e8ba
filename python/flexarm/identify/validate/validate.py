"""`fa.validate`: the model of a measured arm against recordings of it."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._check import choice, number
from ..._console import aligned, progress_bar
from ...data.compare import Comparison
from ...data.draw.trajectory import Curves, plot_recordings
from ...run.scene.scene import Scene, load
from ...run.simulation import SimulationError
from ..fit import Fit, FitError, FitWarning
from ..identify import identify
from ..unknown import Unknown
from .rig import (
    ARM,
    DEFLECTIONS,
    DRIVES,
    JOINTS,
    PER_RUN,
    SHIPPED,
    START,
    Recording,
    compared,
    identified,
    outputs,
    read,
    with_currents,
    with_motion,
    with_values,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SHOWN = {JOINTS[0]: "Joint 1 (deg)", JOINTS[1]: "Joint 2 (deg)",
          DEFLECTIONS[0]: "Deflection 1 (deg)", DEFLECTIONS[1]: "Deflection 2 (deg)"}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Judged:
    """A recording beside the model.

    Attributes:
        recording: its name. driven: "motion": the joints move as measured; "current": the motors have the measured
            currents. role: the parameters that were fitted to this recording.
        since: start of the judged part (s), after the recording's. comparison: both, over the whole recording.
        nrmse: by column, the root mean square of the error over the standard deviation of the measured values, in the
            judged part (1).
    """

    recording: str
    driven: str
    role: str
    since: float
    comparison: Comparison
    nrmse: dict[str, float]

    @staticmethod
    def of(recording: Recording, driven: str, role: str, comparison: Comparison, since: float = 0.0) -> Judged:
        t = comparison.measured.t
        rows = recording.judged & np.asarray(t >= since)
        found = {}
        for name in comparison.nrmse:
            y, x = comparison.measured[name][rows], comparison.simulated[name][rows]
            found[name] = float(np.sqrt(np.mean((x - y) ** 2)) / y.std())
        return Judged(recording.name, driven, role, float(t[rows][0]), comparison, found)

    def curves(self) -> Curves:
        c = self.comparison
        shown = {_SHOWN[n]: (np.degrees(c.measured[n]), np.degrees(c.simulated[n]), 100 * e)
                 for n, e in self.nrmse.items()}  # fmt: skip
        return Curves(f"{self.recording}, {self.role}", c.measured.t, self.since, shown)


@dataclass(repr=False, eq=False)
class Validation:
    """A measured arm and its model. `print(validation)` is its report.

    Attributes:
        judged: recordings beside the model; see Judged: `.recording`, `.driven`, `.role`, `.nrmse[column]`.
        fits: by "motion" and "current", the Fit of the model; none if shipped values were used.
        calibrations: by recording, the fitted values of the parameters that differ between recordings.
        notes: failed computations, and parameters that can replace each other; see `Fit.loose`.
    """

    judged: list[Judged]
    fits: dict[str, Fit] = field(default_factory=dict)
    calibrations: dict[str, dict[str, float]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def __repr__(self) -> str:
        return self.report()

    def report(self) -> str:
        """A table of errors, and the fitted values."""
        columns = [n for n in _SHOWN if any(n in j.nrmse for j in self.judged)]
        rows = [["driven by", "recording", "what was fitted to it", "judged from", *columns]]
        for j in self.judged:
            errors = [f"{100 * j.nrmse[n]:.1f}" if n in j.nrmse else "" for n in columns]
            rows.append([j.driven, j.recording, j.role, f"{j.since:.1f} s", *errors])
        lines = ["NRMSE (%): rms of the error over the standard deviation of the measured values", "",
                 *aligned(rows, range(3, 4 + len(columns)))]  # fmt: skip
        lines += ["", *self.notes] if self.notes else []
        for name, values in self.calibrations.items():
            lines += ["", f"{name}: " + ", ".join(f"{k} = {x:.4g}" for k, x in values.items())]
        for driven, fit in self.fits.items():
            lines += ["", f"The fit, driven by {driven}:", fit.report()]
        return "\n".join(lines)

    def plot(self, driven: str = "motion") -> Figure:
        """A figure of the recordings, measured and modelled. driven: "motion" or "current"."""
        return plot_recordings(latest([j for j in self.judged if j.driven == driven]))

    def to_dict(self) -> dict[str, Any]:
        """All but the curves, as JSON has it."""
        return {
            "judged": [{"driven": j.driven, "recording": j.recording, "role": j.role, "since": j.since,
                        "nrmse": dict(j.nrmse)} for j in self.judged],
            "calibrations": {k: dict(x) for k, x in self.calibrations.items()},
            "notes": list(self.notes),
            "fits": {k: fit.to_dict() for k, fit in self.fits.items()},
        }  # fmt: skip


def latest(judged: Sequence[Judged]) -> list[Curves]:
    """The last comparison of each recording, as curves."""
    return [j.curves() for j in {j.recording: j for j in judged}.values()]


RIGS = {"quanser": "Quanser 2-DOF Serial Flexible Link, two harmonic drives and two steel strips"}
_POOR = 0.5  # NRMSE: above it other starts are tried; the model's own errors are well below
_RUNS = 60  # usual number of runs of a fit
_LOOK, _MOST = 5, 100  # iterations of the drives from each start, and from the best end of these
_STEP = 0.01  # s, of the integrator; half of it changes no error by 0.1 %
_GAUGES = ("sensor.0", "sensor.1")  # of the scene
_NOISE = dict.fromkeys(DEFLECTIONS, 8e-4) | dict.fromkeys(JOINTS, 0.01)  # rad: about the model's own errors
_PER_RUN, _DRIVES = "zeros, gains, cable", "drives"


def validate(
    rig: str = "quanser",
    data: Any = None,
    *,
    predict: str = "psf",
    calibrate: float | None = None,
    progress: Any = False,
) -> Validation:
    """Compares the shipped model of a measured arm with recordings of it.

    Without `data`, the unknown parameters of the arm are fitted to the shipped recordings but one, and that one is
    predicted. With `data`, the shipped values of the arm are judged on other recordings. The numbers of the set-up are
    always fitted to the first part of the recording that is judged, and the rest is judged: the zero of the second
    joint's encoder, the calibration of the strain gauges, the cable, and, driven by currents, the drives.

    Args:
        rig: "quanser", a two-link flexible arm (docs/validation.md).
        data: recordings: the path of a file, Data, or a list of these. Columns (of a CSV, by their headings)
            "joint1_deg", "link1_deflection_deg", "motor1_current_A", and the same of 2, over "t_s"; at least 2 s at
            46 Hz.
        predict: which of the shipped recordings, "lqr", "fsf" or "psf", is predicted; the arm is fitted to the others.
        calibrate: how much of a judged recording (s) its set-up is fitted to; the rest is judged. None: half of it.
        progress: shows progress on stderr: a bar, or lines where that is no terminal.

    Returns:
        Validation: `print` it; `.judged`, `.plot()`.

    Raises:
        ValueError: an unknown rig or recording; as of `Data.load`; columns that are missing. FitInterrupted: Ctrl-C.
    """
    choice("rig", rig, RIGS)
    choice("predict", predict, SHIPPED)
    scene, validation = load(rig), Validation([])
    sources = [predict] if data is None else list(data) if isinstance(data, (list, tuple)) else [data]
    if not sources:
        raise ValueError("data: an empty list; give at least one recording")
    recordings = [read(source) for source in sources]
    with progress_bar(progress, "validating") as bar:
        shown = _shown(bar, (2 + len(SHIPPED)) * len(recordings) + (data is None))
        if data is None:
            scene = _shipped(scene, predict, validation, next(shown))
        for recording in recordings:
            _judge(scene, recording, calibrate, validation, shown)
    return validation


def _shown(bar: Callable[..., None] | None, fits: int) -> Iterator[Any]:
    """`progress` of each of the fits, which moves the bar of them all."""

    def tell(k: int, runs: int) -> None:
        assert bar is not None
        bar((k + min(1.0, runs / _RUNS)) / fits, f"fit {k + 1} of {fits}")

    for k in range(fits):
        yield partial(tell, k) if bar else False


def _shipped(scene: Scene, predict: str, validation: Validation, progress: Any) -> Scene:
    """The scene with the arm fitted to the shipped recordings but one."""
    recordings = [read(name) for name in SHIPPED if name != predict]
    done = fitted(scene, recordings, {**ARM, **PER_RUN}, progress)
    validation.fits["motion"] = done
    for recording, comparison in zip(recordings, done.comparisons, strict=True):
        validation.judged.append(Judged.of(recording, "motion", "all", comparison))
    return with_values(scene, {path: done.values[path] for path in ARM})


def fitted(scene: Scene, recordings: Sequence[Recording], unknown: Mapping[str, Unknown], progress: Any = False) -> Fit:
    """One arm fitted to several shipped recordings, whose set-ups differ."""
    scenes = [with_values(with_motion(scene, r), {k: x for k, x in identified(r.name)[0].items() if k in unknown})
              for r in recordings]  # fmt: skip
    sought = {k: replace(x, start=None, each_run=True) if k in PER_RUN else x for k, x in unknown.items()}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FitWarning)
        return identify(
            scenes, [r.data for r in recordings], sought, outputs=dict(zip(DEFLECTIONS, _GAUGES, strict=True)),
            step=_STEP, noise={name: _NOISE[name] for name in DEFLECTIONS}, starts=1, progress=progress,
        )  # fmt: skip


def _judge(
    scene: Scene, recording: Recording, calibrate: float | None, validation: Validation, shown: Iterator[Any]
) -> None:
    """Judges a recording to which no parameter of the arm was fitted."""
    t = recording.data.t
    until = float(t[-1]) / 2 if calibrate is None else number("calibrate", calibrate)
    least, most = float(t[recording.judged][0]) + 1.0, float(t[-1]) - 1.0
    if not least <= until <= most:
        raise ValueError(f"calibrate = {until:g}: must be from {least:.4g} to {most:.4g} s, for {recording.name}")
    moved = with_motion(scene, recording)
    best, begin = _nearest(moved, recording)
    validation.judged.append(best)
    own = PER_RUN if recording.from_rest else {**PER_RUN, **START}
    done = _fitted(moved, recording, own, DEFLECTIONS, next(shown), until, begin)
    rest = done.validate(recording.data)
    validation.judged.append(Judged.of(recording, "motion", f"{_PER_RUN}, {until:.3g} s", rest, until))
    validation.calibrations[recording.name] = done.values
    validation.notes += [f"{recording.name}: {x}." for x in done.loose]
    _drive(done.scene, recording, until, validation, shown)


def _drive(scene: Scene, recording: Recording, until: float, validation: Validation, shown: Iterator[Any]) -> None:
    """The drives, fitted to the currents of the first part. Friction has many local minima: the search begins at the
    values of each shipped recording, and goes on from where a few iterations leave the least errors in that part."""
    driven, columns = with_currents(scene, recording), (*JOINTS, *DEFLECTIONS)

    def found(begin: Mapping[str, float], most: int) -> Fit:
        of = with_values(driven, {path: x for path, x in begin.items() if not path.startswith("drive")})
        return _fitted(of, recording, DRIVES, columns, next(shown), until, begin, others=False, most=most)

    fits, said = [], ""
    for name in SHIPPED:
        try:
            fits.append(found(identified(name)[1], _LOOK))
        except (FitError, SimulationError) as e:  # a drive that runs away
            said = str(e)
    if not fits:
        validation.notes.append(f"{recording.name}, driven by current: {said}")
        return
    best = min(fits, key=lambda fit: sum(fit.nrmse.values()))
    done = best if best.converged else found({path: best.values[path] for path in DRIVES}, _MOST)
    rest = done.validate(recording.data)
    validation.judged.append(Judged.of(recording, "current", f"{_DRIVES}, {until:.3g} s", rest, until))
    validation.fits["current"] = done


def _nearest(scene: Scene, recording: Recording) -> tuple[Judged, dict[str, float]]:
    """The set-up of the shipped recording with the smallest errors here, its own apart, which is not known beforehand:
    the comparison, and the values by path."""
    candidates = []
    for name in SHIPPED:
        if name != recording.name:
            values = identified(name)[0]
            comparison = compared(with_values(scene, values), recording, DEFLECTIONS)
            candidates.append((Judged.of(recording, "motion", f"nothing; values of {name}", comparison), values))
    return min(candidates, key=lambda x: sum(x[0].nrmse.values()))


def _fitted(
    scene: Scene, recording: Recording, unknown: Mapping[str, Unknown], columns: Sequence[str], progress: Any,
    until: float | None = None, begin: Mapping[str, float] | None = None, others: bool = True, most: int = _MOST,
) -> Fit:  # fmt: skip
    """The scene fitted to a recording, or to its part before `until` (s). others: tries other starts if it is poor.
    most: iterations."""
    sought = {path: replace(x, start=(begin or {}).get(path, x.start)) for path, x in unknown.items()}

    def found(starts: int | None) -> Fit:
        return identify(
            scene, recording.data.between(None, until), sought, outputs=outputs(scene, columns), step=_STEP,
            noise={name: _NOISE[name] for name in columns}, starts=starts, progress=progress, max_iterations=most,
        )  # fmt: skip

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FitWarning)
        try:
            fit = found(1)
        except FitError:
            if others:
                return found(None)
            raise
        return found(None) if others and max(fit.nrmse.values()) > _POOR else fit
