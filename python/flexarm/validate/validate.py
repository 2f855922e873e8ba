"""`fa.validate`: the model of a measured arm against recordings of it."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from .._check import choice, number
from ..identify.fit import Fit, FitWarning
from ..identify.identify import identify
from ..identify.unknown import Unknown
from ..scene.scene import Scene, load
from .recordings import CURRENTS, DEFLECTIONS, JOINTS, SHIPPED, Recording, read
from .rig import ARM, EACH, sensors
from .validation import Judged, Validation

RIGS = ("quanser",)
_STEP = 0.01  # s, of the integrator; half of it changes no error by 0.1 %
_NOISE = dict.fromkeys(DEFLECTIONS, 8e-4) | dict.fromkeys(JOINTS, 0.03)  # rad: what the model leaves out
_CALIBRATION = "zeros, gains, cable, level"


def validate(
    rig: str = "quanser", data: Any = None, *, fit: str = "lqr", calibrate: float | None = None, progress: Any = False
) -> Validation:
    """Compares the shipped model of a measured arm with recordings of it.

    Without `data`, what is not known of the arm is fitted to one of the shipped recordings, and the other is predicted.
    With `data`, the shipped values of the arm are judged on other recordings. What differs from recording to recording
    is fitted to each: the zero of the second joint's encoder, the calibration of the strain gauges, the pull of the
    cable, the level of the table.

    Args:
        rig: "quanser", a two-link flexible arm (docs/validation.md).
        data: recordings: the path of a file, Data, or a list of these. Columns (of a CSV, by their headings)
            "joint1_deg", "link1_deflection_deg", "motor1_current_A", and the same of 2, over "t_s"; at least 2 s at 90
            rows a second.
        fit: which of the shipped recordings, "lqr" or "fsf", is fitted to; the other is predicted.
        calibrate: with `data`: how much of each recording (s) its zeros and gains are fitted to; the rest is judged.
            None: half of it.
        progress: shows progress on stderr, where that is a terminal.

    Returns:
        Validation: `print` it; `.judged`, `.plot()`.

    Raises:
        ValueError: an unknown rig or recording; as of `load_data`; columns that are missing. FitInterrupted: Ctrl-C.
    """
    choice("rig", rig, RIGS)
    scene = load(rig)
    if data is None:
        choice("fit", fit, SHIPPED)
        if calibrate is not None:
            raise ValueError(f"calibrate = {calibrate!r}: goes with data alone")
        return _shipped(scene, fit, progress)
    sources = list(data) if isinstance(data, (list, tuple)) else [data]
    recordings = [read(source, k) for k, source in enumerate(sources)]
    found = Validation([])
    for recording in recordings:
        _judge(_made(scene, recording), recording, calibrate, found, progress)
    return found


def _shipped(scene: Scene, fit: str, progress: Any) -> Validation:
    first, other = (read(name, k) for k, name in enumerate((fit, *(n for n in SHIPPED if n != fit))))
    done = _fitted(_made(scene, first), first, {**ARM, **EACH}, progress)
    found = Validation([Judged.of(first, "motion", "all", done.comparisons[0])], {"motion": done})
    arm = _made(_without_drive(done.scene), other)
    again = _fitted(arm, other, EACH, progress)
    found.judged.append(Judged.of(other, "motion", _CALIBRATION, again.comparisons[0]))
    found.calibrations[other.name] = again.values
    return found


def _judge(scene: Scene, recording: Recording, calibrate: float | None, found: Validation, progress: Any) -> None:
    """A recording that nothing of the arm was fitted to."""
    t = recording.data.t - recording.begin
    until = t[-1] / 2 if calibrate is None else number("calibrate", calibrate)
    least = t[recording.judged][0] + 1.0
    if not least <= until <= t[-1] - 1.0:
        raise ValueError(f"calibrate = {until:g}: must be from {least:.4g} to {t[-1] - 1:.4g} s, for {recording.name}")
    part = replace(recording, data=recording.data.between(None, recording.begin + until))
    done = _fitted(scene, part, EACH, progress)
    rest = done.validate(recording.data, _inputs(recording))
    found.judged.append(Judged.of(recording, "motion", f"{_CALIBRATION}, {until:.3g} s", rest, until))
    done = _fitted(scene, recording, EACH, progress, done.values)
    found.judged.append(Judged.of(recording, "motion", _CALIBRATION, done.comparisons[0]))
    found.calibrations[recording.name] = done.values


def _made(scene: Scene, recording: Recording) -> Scene:
    """The scene with the sensors of a recording."""
    there = sensors(scene, [recording])
    return replace(scene, sensors=tuple(there[name] for name in (*DEFLECTIONS, *JOINTS)), drive={})


def _without_drive(scene: Scene) -> Scene:
    return replace(scene, drive={})


def _inputs(recording: Recording) -> dict[int, Any]:
    return {k: lambda _, name=name: recording.motion(name) for k, name in enumerate(JOINTS)}


def _fitted(
    scene: Scene, recording: Recording, unknown: Mapping[str, Unknown], progress: Any,
    begin: Mapping[str, float] | None = None,
) -> Fit:  # fmt: skip
    sought = {k: replace(x, start=(begin or {}).get(k, x.start)) for k, x in unknown.items()}
    outputs = dict(zip(DEFLECTIONS, scene.sensors, strict=False))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FitWarning)
        return identify(
            scene, recording.data, sought, inputs=_inputs(recording), outputs=outputs, step=_STEP,
            noise={name: _NOISE[name] for name in outputs}, progress=progress,
        )  # fmt: skip
