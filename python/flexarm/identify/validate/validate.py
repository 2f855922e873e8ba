"""`fa.validate`: the model of a measured arm against recordings of it."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from ..._check import choice, number
from ...run.scene.scene import Scene, load
from ...run.simulation import SimulationError
from ..fit import Fit, FitError, FitWarning
from ..identify import identify
from ..unknown import Unknown
from .recordings import DEFLECTIONS, JOINTS, SHIPPED, Recording, read
from .rig import ARM, DRIVES, PER_RUN, START, compared, identified, outputs, with_currents, with_motion, with_values
from .validation import Judged, Validation

RIGS = ("quanser",)
_STEP = 0.01  # s, of the integrator; half of it changes no error by 0.1 %
_NOISE = dict.fromkeys(DEFLECTIONS, 8e-4) | dict.fromkeys(JOINTS, 0.01)  # rad: about the model's own errors
_PER_RUN, _DRIVES = "zeros, gains, cable, level", "drives"


def validate(
    rig: str = "quanser", data: Any = None, *, fit: str = "lqr", calibrate: float | None = None, progress: Any = False
) -> Validation:
    """Compares the shipped model of a measured arm with recordings of it.

    Without `data`, the unknown parameters of the arm are fitted to one of the shipped recordings, and the other is
    predicted. With `data`, the shipped values of the arm are judged on other recordings. Always fitted to each
    recording are: the zero of the second joint's encoder, the calibration of the strain gauges, the pull of the cable,
    the level of the table.

    Args:
        rig: "quanser", a two-link flexible arm (docs/validation.md).
        data: recordings: the path of a file, Data, or a list of these. Columns (of a CSV, by their headings)
            "joint1_deg", "link1_deflection_deg", "motor1_current_A", and the same of 2, over "t_s"; at least 2 s at
            46 Hz.
        fit: which of the shipped recordings, "lqr" or "fsf", is fitted to; the other is predicted.
        calibrate: with `data`: how much of each recording (s) its zeros and gains are fitted to; the rest is judged.
            None: half of it.
        progress: shows progress on stderr: a bar, or lines where that is no terminal.

    Returns:
        Validation: `print` it; `.judged`, `.plot()`.

    Raises:
        ValueError: an unknown rig or recording; as of `Data.load`; columns that are missing. FitInterrupted: Ctrl-C.
    """
    choice("rig", rig, RIGS)
    scene = load(rig)
    if data is None:
        choice("fit", fit, SHIPPED)
        if calibrate is not None:
            raise ValueError(f"calibrate = {calibrate!r}: goes with data alone")
        return _shipped(scene, fit, progress)
    sources = list(data) if isinstance(data, (list, tuple)) else [data]
    if not sources:
        raise ValueError("data: an empty list; give at least one recording")
    validation = Validation([])
    for recording in [read(source) for source in sources]:
        _judge(scene, recording, calibrate, validation, progress)
    return validation


def _shipped(scene: Scene, fit: str, progress: Any) -> Validation:
    """Fits to one of the shipped recordings and predicts the other."""
    first, other = (read(name) for name in (fit, *(n for n in SHIPPED if n != fit)))
    done = _fitted(with_motion(scene, first), first, {**ARM, **PER_RUN}, DEFLECTIONS, progress)
    validation = Validation([Judged.of(first, "motion", "all", done.comparisons[0])], {"motion": done})
    other_fit = _fitted(with_motion(done.scene, other), other, PER_RUN, DEFLECTIONS, progress)
    validation.judged.append(Judged.of(other, "motion", _PER_RUN, other_fit.comparisons[0]))
    validation.calibrations[other.name] = other_fit.values
    validation.notes += [f"{other.name}: {x}." for x in other_fit.loose]
    for recording, one in ((first, done), (other, other_fit)):
        _drive(one.scene, recording, float(recording.data.t[-1]) / 2, validation, progress)
    return validation


def _judge(scene: Scene, recording: Recording, calibrate: float | None, validation: Validation, progress: Any) -> None:
    """Judges a recording to which no parameter of the arm was fitted."""
    t = recording.data.t
    until = float(t[-1]) / 2 if calibrate is None else number("calibrate", calibrate)
    least, most = float(t[recording.judged][0]) + 1.0, float(t[-1]) - 1.0
    if not least <= until <= most:
        raise ValueError(f"calibrate = {until:g}: must be from {least:.4g} to {most:.4g} s, for {recording.name}")
    moved = with_motion(scene, recording)
    best, begin = _nearest(moved, recording, "motion", DEFLECTIONS)
    validation.judged.append(best)
    own = PER_RUN if recording.from_rest else {**PER_RUN, **START}
    done = _fitted(moved, recording, own, DEFLECTIONS, progress, until, begin)
    rest = done.validate(recording.data)
    validation.judged.append(Judged.of(recording, "motion", f"{_PER_RUN}, {until:.3g} s", rest, until))
    validation.calibrations[recording.name] = done.values
    validation.notes += [f"{recording.name}: {x}." for x in done.loose]
    _drive(done.scene, recording, until, validation, progress)


def _drive(scene: Scene, recording: Recording, until: float, validation: Validation, progress: Any) -> None:
    """The drives: with the best values of the shipped recordings, and fitted to the currents of the first part."""
    driven, columns = with_currents(scene, recording), (*JOINTS, *DEFLECTIONS)
    try:
        best, begin = _nearest(driven, recording, "current", columns)
        if recording.name not in SHIPPED:
            validation.judged.append(best)
        own = {path: x for path, x in begin.items() if not path.startswith("drive")}
        done = _fitted(with_values(driven, own), recording, DRIVES, columns, progress, until, begin)
        rest = done.validate(recording.data)
    except (FitError, SimulationError) as e:  # a drive that runs away
        validation.notes.append(f"{recording.name}, driven by current: {e}")
        return
    validation.judged.append(Judged.of(recording, "current", f"{_DRIVES}, {until:.3g} s", rest, until))
    validation.fits.setdefault("current", done)


def _nearest(
    scene: Scene, recording: Recording, driven_by: str, columns: Sequence[str]
) -> tuple[Judged, dict[str, float]]:
    """The values of the shipped recording with the smallest errors here: their comparison, and the values by path."""
    candidates = []
    for name in SHIPPED:
        values = identified(name)[driven_by == "current"]
        comparison = compared(with_values(scene, values), recording, columns)
        candidates.append((Judged.of(recording, driven_by, f"nothing; values of {name}", comparison), values))
    return min(candidates, key=lambda x: sum(x[0].nrmse.values()))


def _fitted(
    scene: Scene, recording: Recording, unknown: Mapping[str, Unknown], columns: Sequence[str], progress: Any,
    until: float | None = None, begin: Mapping[str, float] | None = None,
) -> Fit:  # fmt: skip
    """The scene fitted to a recording, or to its part before `until` (s)."""
    sought = {path: replace(x, start=(begin or {}).get(path, x.start)) for path, x in unknown.items()}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FitWarning)
        return identify(
            scene, recording.data.between(None, until), sought, outputs=outputs(scene, columns), step=_STEP,
            noise={name: _NOISE[name] for name in columns}, progress=progress,
        )  # fmt: skip
