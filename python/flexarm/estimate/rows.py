"""Sensors and parameters as the core's filter takes them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .._check import Array, array, not_negative
from ..arm.arm import Arm
from ..run.sensing.lowpass import LowPass
from ..run.sensing.sensor import Sensor
from ..run.sensing.sensors import Camera, Encoder, StrainGauge, Tachometer

_MOST = 100  # steps of a delay: each is a state
#: parameters by name, in the order of the core
KINDS = ("payload", "damping", "coulomb", "offset", "gain")


def sensor_rows(arm: Arm, sensor: Sensor, step: float) -> list[Any]:
    """Rows of a sensor's components for the core's filter."""
    if not isinstance(sensor, (Encoder, Tachometer, StrainGauge, Camera)):
        raise ValueError(f"{type(sensor).__name__}: must be an Encoder, Tachometer, StrainGauge or Camera")
    sensor.check(arm)
    n, count = arm.nv, len(sensor.components(arm))
    std = np.sqrt(sensor._each("noise", count, 0.0) ** 2 + sensor.steps(arm) ** 2 / 12)
    if not (std > 0).all():
        raise ValueError("noise = None: a filter must know how far to believe a sensor; give its standard deviation")
    if sensor.delay / step > _MOST:
        raise ValueError(f"delay = {sensor.delay}: is more than {_MOST} of the filter's steps of {step:g} s, too many")
    F, before, after = _late(_passed(sensor.filter, step), sensor.delay / step)
    gain, shift = sensor._each("gain", count, 1.0), sensor._each("offset", count, 0.0)
    if isinstance(sensor, Camera):
        if sensor.axes != "world":
            raise ValueError(f"axes = {sensor.axes!r}: must be 'world'")
        place = arm._link(sensor.link), sensor.x
        return [(np.zeros(n), np.zeros(n), shift[k], std[k], place, gain[k] * np.eye(3)[k], F, before, after)
                for k in range(3)]  # fmt: skip
    # linear: evaluated at unit coordinates and rates
    zero, unit = np.zeros((n, n)), np.eye(n)
    own = np.array([arm.coordinate_of(i) for i in range(n)])  # none of balls
    moves = (np.arange(arm.nq) == own[:, None]) * 1.0
    y0 = sensor.measure(arm, 0.0, arm.zero, np.zeros(n))[0]
    by_q = sensor.measure(arm, np.zeros(n), arm.zero + moves, zero)[:, 0] - y0
    by_v = sensor.measure(arm, np.zeros(n), arm.zero + zero[:, :1], unit)[:, 0] - y0
    q, v = np.cos(1.0 + np.arange(n)), np.sin(2.0 + np.arange(n))  # any state
    there = sensor.measure(arm, 1.0, arm.zero + q @ moves, v)[0]
    if abs(there - y0 - by_q @ q - by_v @ v) > 1e-6 * (abs(there) + np.abs(by_q).sum() + np.abs(by_v).sum()):
        raise ValueError(f"{type(sensor).__name__}: must be linear in q and v, and the same at all times")
    row = gain[0] * by_q, gain[0] * by_v, float(gain[0] * y0 + shift[0])  # gain acts after the filter, noise before
    return [(*row, std[0], None, np.zeros(3), F, before, after)]


#: F, before, after: x goes to F x + before y0 + after y1 over a step in which y goes from y0 to y1; x[0] is read
Chain = tuple[Array, Array, Array]


def _passed(filter: Any, step: float) -> Chain:
    """A sensor's filter over a step; no states without one."""
    if not isinstance(filter, LowPass):
        return np.empty((0, 0)), np.empty(0), np.empty(0)
    F, given = np.split(filter.step(step), [filter.order], axis=1)
    return F, given[:, 0] + given[:, 1] / 2, given[:, 2] + given[:, 1] / 2  # linear between


def _late(chain: Chain, steps: float) -> Chain:
    """A chain that is read so many steps later, on straight lines between steps."""
    if not steps:
        return chain
    F, before, after = chain
    n, line = len(F), int(np.ceil(steps - 1e-9))
    old = line - steps  # the part of the newer of both readings that it lies between
    # the line's last place takes, of the readings of a step's beginning and end, the part that it lies between
    out = np.zeros((line + n, line + n)), np.zeros(line + n), np.zeros(line + n)
    out[0][: line - 1, 1:line] = np.eye(line - 1)
    if n:
        out[0][line - 1, line:] = old * F[0]
        out[0][line - 1, line] += 1 - old
        out[0][line:, line:], out[1][line:], out[2][line:] = F, before, after
        before, after = old * before[:1], old * after[:1]
    else:
        before, after = np.array([1 - old]), np.array([old])
    out[1][line - 1], out[2][line - 1] = before[0], after[0]
    return out


def unknowns(
    arm: Arm, estimate: Mapping[str, Any], drift: Mapping[str, Any]
) -> tuple[list[str], list[tuple[int, int, float, float, float]]]:
    """Names of parameters, and the parameters for the core's filter."""
    given: tuple[tuple[str, Any], ...] = (("estimate", estimate), ("drift", drift))
    for field, keyed in given:
        if not isinstance(keyed, Mapping):
            right = "{'payload': (0.1, 0.1)}" if field == "estimate" else "{'payload': 0.01}"
            raise ValueError(f"{field} = {keyed!r}: must be a dictionary, by name, such as {right}")
    out = []
    for name, value in drift.items():
        if name not in estimate:
            raise ValueError(f"drift: {name} is not among those of estimate: {', '.join(estimate) or 'none'}")
        not_negative(f"drift: {name}", value, "unit/sqrt(s)")
    for name, value in estimate.items():
        kind, *where = str(name).split(".")
        right = "must be 'payload', or " + ", ".join(f"'{k}.LINK'" for k in KINDS[1:])
        named = where[:1] == [w for w in where[:1] if w in arm._numbers]
        places = 0 <= len(where) <= 2 and all(map(str.isdigit, where[named:])) and (kind == "payload") == (not where)
        if kind not in KINDS or not places:
            raise ValueError(f"estimate: {name!r}: {right}")
        place: Any = [int(w) if w.isdigit() else w for w in where]
        rate = arm.joint_rate(tuple(place) if len(place) == 2 else place[0], f"estimate: {name}: link") if place else 0
        start, std = array(f"estimate: {name}: (start, standard deviation)", value, (2,))
        if std < 0:
            raise ValueError(f"estimate: {name} = {value}: the standard deviation must not be negative")
        if kind == "payload" and start < 0:
            raise ValueError(f"estimate: {name} = {value}: a payload's start must not be negative (kg)")
        out.append((KINDS.index(kind), rate, float(start), float(std), float(drift.get(name, 0.0))))
    return list(estimate), out
