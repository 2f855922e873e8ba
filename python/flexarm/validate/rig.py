"""The rig's scene: its sensors as the recordings have them, and what is not known of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .._check import Array
from ..acting.load import Load
from ..arm import Arm
from ..identify.unknown import Unknown
from ..scene.scene import Scene
from ..sensing.sensor import Sensor
from ..sensing.sensors import Component, Encoder, StrainGauge
from .recordings import DEFLECTIONS, JOINTS, Recording


@dataclass(frozen=True)
class TaredGauge(StrainGauge):
    """A strain gauge that reads an angle (rad), and whose zero is taken as the rig takes it: within each of the spans
    `tares` (begin, end; s) it reads nothing, and then less its mean over that span."""

    tares: Sequence[Sequence[float]] = ()

    def components(self, arm: Arm) -> list[Component]:
        return [("deflection", "rad")]

    def _measure(self, arm: Arm, t: Array, q: Array, v: Array, a: Any, loads: Sequence[Load] | None) -> Array:
        y = super()._measure(arm, t, q, v, a, loads)
        for begin, end in self.tares:
            dead = (t >= begin) & (t < end)
            if t.ndim and dead.any():
                y = np.where(dead[:, None], 0.0, y - y[dead].mean(axis=0))
        return y


def sensors(scene: Scene, recordings: Sequence[Recording]) -> dict[str, Sensor]:
    """By column of the recordings, what reads it: the scene's gauges, tared as they were in each, and its encoders."""
    gauges = [s for s in scene.sensors if isinstance(s, StrainGauge)]
    encoders = [s for s in scene.sensors if isinstance(s, Encoder)]
    found: dict[str, Sensor] = {}
    for k, gauge in enumerate(gauges):
        tares = tuple((r.begin - 1.0, r.begin + r.tares[k]) for r in recordings if r.tares[k])
        given = {f: getattr(gauge, f) for f in ("link", "x", "face", "gauge_factor", "filter", "gain", "offset")}
        found[DEFLECTIONS[k]] = TaredGauge(**given, tares=tares)
    return found | {JOINTS[k]: replace(e, pulses=None) for k, e in enumerate(encoders)}


#: What is not known of the arm, by path: a prior mean and its standard deviation.
ARM = {
    "link.0.beam.material.youngs_modulus": Unknown(mean=2.07e11, std=0.4e11),
    "link.1.beam.material.youngs_modulus": Unknown(mean=2.07e11, std=0.4e11),
    "link.0.tip.mass": Unknown(mean=1.4, std=0.5),
    "link.0.beam.kelvin_voigt": Unknown(low=0.0, high=0.05),
    "link.1.beam.kelvin_voigt": Unknown(low=0.0, high=0.05),
    "control.1.limit": Unknown(low=1e-4, high=0.2),
}
#: What differs from recording to recording: the zero of the second joint's encoder, the calibration of both gauges, the
#: pull of the cable, the level of the table.
EACH = {
    "link.1.joint.outboard.rotation.2": Unknown(0.0, mean=0.0, std=0.5, low=-1.5, high=1.5),
    "sensor.0.gain": Unknown(1.0, mean=1.0, std=0.2),
    "sensor.1.gain": Unknown(1.0, mean=1.0, std=0.2),
    "sensor.0.offset": Unknown(0.0, mean=0.0, std=0.005),
    "sensor.1.offset": Unknown(0.0, mean=0.0, std=0.005),
    "control.0.K.0.0": Unknown(0.1, mean=0.1, std=0.1),
    "gravity.1": Unknown(0.0, mean=0.0, std=0.2),
}
