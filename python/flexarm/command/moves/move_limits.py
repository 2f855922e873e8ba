"""Limits of the joints of a move, read and checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._check import Array
from ...analysis.equilibrium import elastic_rates
from ...arm.arm import Arm

Indices = NDArray[np.intp]


@dataclass(frozen=True)
class Driven:
    """The joint coordinates of an arm, all of which are driven.

    Attributes:
        rates: their indices in v. at: in q. elastic, elastic_at: of the others. names, units: of the joints.
    """

    rates: Indices
    at: Indices
    elastic: Indices
    elastic_at: Indices
    names: list[str]
    units: list[str]

    @staticmethod
    def of(arm: Arm) -> Driven:
        if not isinstance(arm, Arm):
            raise ValueError(f"arm = {arm!r}: must be an Arm")
        if any(link.joint.ball for link in arm.links):
            raise ValueError("arm: has a ball joint, which has no angle to plan; use fa.Axes or three revolute joints")
        elastic = elastic_rates(arm)
        where = np.array([arm.coordinate_of(i) for i in range(arm.nv)], dtype=np.intp)
        rates, bent = np.flatnonzero(~elastic), np.flatnonzero(elastic)
        if not rates.size:
            raise ValueError("arm: has no joint that moves")
        units = [unit for link in arm.links for unit in link.joint.units]
        return Driven(rates, where[rates], bent, where[bent], [arm.coordinates[i] for i in rates], units)


@dataclass(frozen=True)
class Limits:
    """Largest absolute values for each joint, (nj,); inf where there is none.

    Attributes:
        torque, speed, acceleration, jerk: as given.
        middle, reach: a joint's range between its stops: `middle` plus and minus `reach`.
    """

    torque: Array
    speed: Array
    acceleration: Array
    jerk: Array
    middle: Array
    reach: Array

    @staticmethod
    def of(arm: Arm, driven: Driven, torque: Any, speed: Any, acceleration: Any, jerk: Any) -> Limits:
        values = {"torque": torque, "speed": speed, "acceleration": acceleration, "jerk": jerk}
        read = {name: _read(arm, driven, name, value) for name, value in values.items()}
        bare = ~np.isfinite(read["torque"]) & ~np.isfinite(read["acceleration"])
        if bare.any():
            name = driven.names[int(np.flatnonzero(bare)[0])]
            raise ValueError(f"torque, acceleration: '{name}' has neither: give one of them, or its move takes no time")
        return Limits(**read, **_stops(arm))

    def check_stops(self, field: str, q: Array, names: list[str]) -> None:
        """ValueError where joint positions (n, nj) are beyond the stops."""
        over = np.abs(q - self.middle) - self.reach
        k, j = np.unravel_index(int(over.argmax()), over.shape)
        if over[k, j] > 1e-12:
            low, high = self.middle[j] - self.reach[j], self.middle[j] + self.reach[j]
            raise ValueError(
                f"{field}: {q[k, j]:.6g} of '{names[j]}' is beyond its stops; must be from {low:.6g} to {high:.6g}"
            )


def _stops(arm: Arm) -> dict[str, Array]:
    ends: dict[str, list[float]] = {"lower": [], "upper": []}
    for link in arm.links:
        for name, out in ends.items():
            value = getattr(link.joint, name)
            none = -np.inf if name == "lower" else np.inf
            out += np.broadcast_to(none if value is None else value, (link.joint.nv,)).tolist()
    low, high = np.array(ends["lower"]), np.array(ends["upper"])
    far = 1e3  # stands for a missing stop
    held = np.isfinite(low) | np.isfinite(high)
    low, high = low[held], high[held]
    low, high = np.where(np.isfinite(low), low, high - far), np.where(np.isfinite(high), high, low + far)
    middle, reach = np.zeros(len(held)), np.full(len(held), np.inf)
    middle[held], reach[held] = 0.5 * (low + high), 0.5 * (high - low)
    return {"middle": middle, "reach": reach}


def _read(arm: Arm, driven: Driven, name: str, value: Any) -> Array:
    """One number for all joints, one for each, or a dictionary by link; None and missing keys stand for inf."""
    out = np.full(len(driven.rates), np.inf)
    if value is None:
        return out
    if isinstance(value, Mapping):
        for i, x in arm.by_rate(name, value).items():
            field = f"{name} of '{arm.coordinates[i]}'"
            limit = np.inf if x is None else _numbers(field, x)
            if np.ndim(limit):
                raise ValueError(f"{field} = {x!r}: must be one number")
            out[driven.rates == i] = limit
    else:
        finite = _numbers(name, value)
        if finite.shape not in ((), out.shape):
            raise ValueError(
                f"{name} has shape {finite.shape}: must be one number, {len(out)} (one for each of "
                f"{', '.join(driven.names)}), or a dictionary by link"
            )
        out[:] = finite
    for x, joint in zip(out, driven.names, strict=True):
        if not x > 0.0:
            raise ValueError(f"{name} = {x:g} of '{joint}': must be positive")
    return out


def _numbers(name: str, value: Any) -> Array:
    """Numbers as `array` reads them; inf stands for no limit."""
    try:
        out = np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(f"{name} = {value!r}: must be numbers") from None
    if np.isnan(out).any():
        raise ValueError(f"{name} = {out.tolist()}: must not be nan")
    return out
