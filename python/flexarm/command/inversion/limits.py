"""Limits of joints: limits that a motion exceeds, and the slowing of the path that satisfies them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ..._check import Array
from ...arm.arm import Arm
from ..joint_limits import by_kind, joint_limits, joint_ranges
from .equations import Equations
from .solve import Motions

LIMITS = ("torque", "speed", "range")
_NEAR = 0.01  # tolerance of the factor by which a path is slowed


class Exceeded(NamedTuple):
    """A limit that an inversion exceeds: its kind ("torque", "speed", "range"), the joint's link (or (link, freedom)),
    the time of the largest excess (s), the value there, the limit, and the joint's name in `arm.coordinates`."""

    kind: str
    joint: Any
    time: float
    value: float
    limit: float
    name: str

    def __str__(self) -> str:
        return f"{self.kind} of {self.name}: {self.value:.4g} at t = {self.time:.4g} s, limit {self.limit:.4g}"


def bounds_of(arm: Arm, limits: Any, keys: list[Any]) -> dict[str, Array]:
    """Limits by kind: (m,), of the range (2, m)."""
    given, rates = by_kind(limits, LIMITS), [arm.joint_rate(key) for key in keys]
    ranges = joint_ranges(arm, "limits['range']", given.pop("range", None), rates)
    return {"range": ranges} | {name: joint_limits(arm, f"limits[{name!r}]", x, rates) for name, x in given.items()}


def applied(equations: Equations, found: Motions) -> Array:
    """The motors' torques, with the dry friction that they overcome."""
    tau = np.zeros_like(found.tau)
    tau[:, equations.joints] = found.tau[:, equations.joints]
    first = equations.arm._core.first
    for n, link in enumerate(equations.arm.links):
        for k, dry in enumerate(link.joint._per_freedom("coulomb", link.joint.nv)):
            i = first(n) + k
            if dry and i in equations.joints:
                v = found.v[:, i]
                tau[:, i] += dry * np.sign(v) * (np.abs(v) > 1e-6 * np.abs(v).max())
    return tau


def exceeded(
    equations: Equations, found: Motions, tau: Array, bounds: Mapping[str, Array], keys: list[Any]
) -> list[Exceeded]:
    out: list[Exceeded] = []
    th, names = equations.joints, [equations.arm.coordinates[i] for i in equations.joints]
    for kind, values in (("torque", tau[:, th]), ("speed", found.v[:, th])):
        if kind not in bounds:
            continue
        for k in np.flatnonzero(np.abs(values).max(axis=0) > bounds[kind] * (1 + 1e-9)).tolist():
            at = int(np.abs(values[:, k]).argmax())
            numbers = float(found.t[at]), float(values[at, k]), float(bounds[kind][k])
            out.append(Exceeded(kind, keys[k], *numbers, names[k]))
    q, (low, high) = found.q[:, th], bounds["range"]
    for k in range(len(th)):
        for at, limit, beyond in ((int(q[:, k].argmin()), low[k], q[:, k].min() < low[k]),
                                  (int(q[:, k].argmax()), high[k], q[:, k].max() > high[k])):  # fmt: skip
            if beyond:
                out.append(Exceeded("range", keys[k], float(found.t[at]), float(q[at, k]), float(limit), names[k]))
    return out


def within(solved: Any, equations: Equations, bounds: Mapping[str, Array], stretch: bool) -> tuple[Any, float]:
    """A solution within the limits, and the factor by which the path is slowed for it."""
    found = solved(1.0)
    if not stretch:
        return found, 1.0

    def respected(motions: Motions) -> bool:
        over = exceeded(equations, motions, applied(equations, motions), bounds, list(range(len(equations.joints))))
        if any(x.kind == "range" for x in over):
            first = next(x for x in over if x.kind == "range")
            raise ValueError(f"limits: {first}, and no slowing helps; take another posture")
        return not over

    if respected(found[1]):
        return found, 1.0
    low, high = 1.0, 2.0
    while not respected((found := solved(high))[1]):
        if high > 60:
            raise ValueError(
                "limits: are exceeded even by a path 64 times slower, so by gravity alone; allow more torque, or take "
                "another posture"
            )
        low, high = high, 2 * high
    while high / low > 1 + _NEAR:
        middle = float(np.sqrt(low * high))
        trial = solved(middle)
        if respected(trial[1]):
            high, found = middle, trial
        else:
            low = middle
    return found, high
