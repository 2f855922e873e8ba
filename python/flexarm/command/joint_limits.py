"""The joints of a command, and their limits as users give them: for all joints, for each, or by joint; and stops."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._check import Array, choice, instance, mapping, unmasked
from ..analysis.rates import elastic_rates
from ..arm.arm import Arm

Indices = NDArray[np.intp]
KINDS = ("torque", "speed", "acceleration", "jerk")
_FAR = 1e3  # stands for a missing stop


def freedoms(arm: Arm) -> dict[Any, int]:
    """The rates of the joints' freedoms, by link, or by (link, freedom) where a joint has several."""
    rates = {n: arm.joint_rates(n) for n in arm.movable}
    return {(n, k) if own[1:] else n: i for n, own in rates.items() for k, i in enumerate(own)}


def same_joints(x: Arm, y: Arm) -> bool:
    """Whether links sit on the same ones, by joints of the same freedoms."""
    kinds = [[(n, link.joint.labels) for n, link in zip(arm.seats, arm.links, strict=True)] for arm in (x, y)]
    return kinds[0] == kinds[1]


def by_freedom(arm: Arm, name: str) -> dict[int, float]:
    """A number that each freedom of a joint has, such as "coulomb" or "lower", by rate."""
    joints = [(arm.joint_rates(n), arm.links[n].joint) for n in arm.movable]
    return {i: x for rates, joint in joints for i, x in zip(rates, joint._per_freedom(name, joint.nv), strict=True)}


def by_kind(limits: Any, kinds: Sequence[str]) -> dict[str, Any]:
    """The argument `limits` of a move or a path: limits by their kind; None: none."""
    given = mapping("limits", limits, f" of {', '.join(kinds)}")
    return {choice("limits", kind, kinds): value for kind, value in given.items()}


def joint_limits(arm: Arm, field: str, value: Any, rates: Sequence[int]) -> Array:
    """The limits (n,) of the joints with these rates: one number for all, one for each, or a dictionary by link, whose
    missing keys have none. None and inf: no limit.

    Raises:
        ValueError: a wrong shape, a joint that is not among these, a limit that is not positive.
    """
    out = _read(arm, field, value, rates, np.inf)
    for i, x in zip(rates, out, strict=True):
        if not x > 0.0:
            raise ValueError(f"{field} = {x:g} of '{arm.coordinates[i]}': must be positive")
    return out


def joint_ranges(arm: Arm, field: str, value: Any, rates: Sequence[int]) -> Array:
    """The ranges (2, n), lowest and highest, of the joints with these rates, given as the limits are, by pairs. None:
    the joints' stops."""
    if value is None:
        stops = [by_freedom(arm, name) for name in ("lower", "upper")]
        return np.array([[own[i] for i in rates] for own in stops]).reshape(2, -1)
    out = _read(arm, field, value, rates, (-np.inf, np.inf))
    if not (out[:, 0] < out[:, 1]).all():
        raise ValueError(f"{field} = {value}: must be (lowest, highest)")
    return out.T


def _read(arm: Arm, field: str, value: Any, rates: Sequence[int], none: Any) -> Array:
    """Numbers (n,), or pairs (n, 2) where `none` is one, of the joints with these rates."""
    out = np.array(np.broadcast_to(none, (len(rates), *np.shape(none))), dtype=float)
    if value is None:
        return out
    one = "one number" if out.ndim == 1 else "one pair"
    if isinstance(value, Mapping):
        for i, x in arm.by_rate(field, value).items():
            where = f"{field} of '{arm.coordinates[i]}'"
            if i not in rates:
                raise ValueError(f"{field}: '{arm.coordinates[i]}' is not driven")
            given = _numbers(where, none if x is None else x)
            if given.shape != out.shape[1:]:
                raise ValueError(f"{where} = {x!r}: must be {one}")
            out[list(rates).index(i)] = given
        return out
    given = _numbers(field, value)
    if given.shape not in (out.shape[1:], out.shape):
        names = ", ".join(arm.coordinates[i] for i in rates)
        raise ValueError(
            f"{field} has shape {given.shape}: must be {one}, {len(out)} (one for each of {names}), or a dictionary by "
            "link"
        )
    out[:] = given
    return out


def _numbers(field: str, value: Any) -> Array:
    """Numbers; inf stands for no limit."""
    unmasked(field, value)
    try:
        out = np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(f"{field} = {value!r}: must be numbers") from None
    if np.isnan(out).any():
        raise ValueError(f"{field} = {out.tolist()}: must not be nan")
    return out


@dataclass(frozen=True)
class Driven:
    """The joint coordinates of an arm, all of which are driven."""

    rates: Indices  #: their indices in v
    at: Indices  #: in q
    elastic: Indices  #: of the others, in v
    elastic_at: Indices  #: in q
    names: list[str]
    units: list[str]

    @staticmethod
    def of(arm: Arm) -> Driven:
        instance("arm", arm, Arm)
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
    """Largest absolute values for each joint, (nj,); inf where there is none."""

    torque: Array
    speed: Array
    acceleration: Array
    jerk: Array
    middle: Array  #: of a joint's range between its stops, `middle` plus and minus `reach`
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
