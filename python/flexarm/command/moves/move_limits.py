"""Limits of the joints of a move, read and checked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._check import Array
from ...analysis.equilibrium import elastic_rates
from ...arm.arm import Arm
from ..joint_limits import by_kind, joint_limits, joint_ranges

Indices = NDArray[np.intp]
KINDS = ("torque", "speed", "acceleration", "jerk")
_FAR = 1e3  # stands for a missing stop


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
    def of(arm: Arm, driven: Driven, limits: Any) -> Limits:
        given, rates = by_kind(limits, KINDS), driven.rates.tolist()
        read = {kind: joint_limits(arm, f"limits[{kind!r}]", given.get(kind), rates) for kind in KINDS}
        bare = ~np.isfinite(read["torque"]) & ~np.isfinite(read["acceleration"])
        if bare.any():
            name = driven.names[int(np.flatnonzero(bare)[0])]
            raise ValueError(f"limits: '{name}' has neither torque nor acceleration; its move would take no time")
        low, high = joint_ranges(arm, "stops", None, rates)
        free = np.isinf(low) & np.isinf(high)
        low, high = np.where(free, -1.0, low), np.where(free, 1.0, high)
        low, high = np.where(np.isinf(low), high - _FAR, low), np.where(np.isinf(high), low + _FAR, high)
        return Limits(**read, middle=0.5 * (low + high), reach=np.where(free, np.inf, 0.5 * (high - low)))

    def check_stops(self, field: str, q: Array, names: list[str]) -> None:
        """ValueError where joint positions (n, nj) are beyond the stops."""
        over = np.abs(q - self.middle) - self.reach
        k, j = np.unravel_index(int(over.argmax()), over.shape)
        if over[k, j] > 1e-12:
            low, high = self.middle[j] - self.reach[j], self.middle[j] + self.reach[j]
            raise ValueError(
                f"{field}: {q[k, j]:.6g} of '{names[j]}' is beyond its stops; must be from {low:.6g} to {high:.6g}"
            )
