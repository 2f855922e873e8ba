"""Whether a run stayed within the range of its beams' orders."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ._check import Array

if TYPE_CHECKING:
    from .arm import Arm
    from .model import Beam

#: Rotation of a section against the beam's base (rad) up to which each order keeps the tip within 2 % of the length of
#: where "exact" has it: the least over static loads and, but for order 1, the first swing of spin-ups, rounded; see
#: docs/failures.md, which bench/failures.py measures. Order 1 softens with speed besides, at any deflection.
LIMITS = {0: 0.25, 1: 0.25, 2: 0.3, 3: 0.65}


class RangeWarning(UserWarning):
    """A beam bent further than its order is good for (see `LIMITS`).

    Attributes:
        link: the link of that beam (the worst, if there are several).
        time: of the first output row past the limit (s).
        rotation: largest rotation of its sections against its base in the run (rad).
        limit: that its order is good for (rad).
    """

    def __init__(self, message: str, link: int, time: float, rotation: float, limit: float) -> None:
        super().__init__(message)
        self.link, self.time, self.rotation, self.limit = link, time, rotation, limit

    def __reduce__(self) -> Any:
        return type(self), (str(self), self.link, self.time, self.rotation, self.limit)


def _turns(beam: Beam) -> Array:
    """Rotation vector, integral of K from 0 to X, of a unit of each elastic coordinate, at places X: (3 nx, ne)."""
    places = max(8, 2 * max(beam.counts.values()))
    turns: Array = beam._core.turns(np.linspace(0.0, beam.length, places + 1)[1:])
    return turns


def rotation(beam: Beam, qe: Array, turns: Array | None = None) -> Array:
    """What LIMITS limits, at each row of qe (nt, ne): the largest rotation, b = a in a plane; with torsion, which moves
    nothing by itself, (b a^n)^(1/(n+1)) of the angle b of bending and the whole angle a, as the terms that order n
    leaves out have it."""
    angles = (qe @ (_turns(beam) if turns is None else turns).T).reshape(len(qe), -1, 3)
    whole, bending = np.linalg.norm(angles, axis=2), np.linalg.norm(angles[:, :, 1:], axis=2)
    n = 1 if beam.order in (0, "exact") else int(beam.order)
    out: Array = ((bending * whole**n) ** (1.0 / (n + 1))).max(axis=1)
    return out


def out_of_range(arm: Arm, t: Array, q: Array) -> RangeWarning | None:
    """The warning that a trajectory t (nt,), q (nt, nq) deserves, or None. Costs next to nothing while all is well."""
    worst, others = None, -1
    for k, link in enumerate(arm.links):
        beam = link.beam
        if beam is None or beam.order == "exact" or not beam.ne:
            continue
        first = arm._core.first_q(k) + link.joint.nq
        qe, limit = q[:, first : first + beam.ne], LIMITS[int(beam.order)]
        turns = _turns(beam)
        if (
            np.abs(qe).max(axis=0, initial=0.0) @ np.linalg.norm(turns.reshape(-1, 3, beam.ne), axis=1).max(axis=0)
            <= limit
        ):
            continue
        angle = rotation(beam, qe, turns)
        past = np.flatnonzero(~(angle <= limit))
        if past.size:
            others += 1
            found = (float(angle.max()) / limit, k, float(t[past[0]]), float(angle.max()), limit, beam.order)
            worst = found if worst is None else max(worst, found)
    if worst is None:
        return None
    _, k, time, largest, limit, order = worst
    more = f", and {others} more" if others else ""
    better = '"exact"' if order == 3 else '3 or "exact"' if order == 2 else '2, 3 or "exact"'
    return RangeWarning(
        f"link {k}{more}: at order {order} a beam that turns its sections by {limit:g} rad has its tip wrong by 2 % of "
        f"its length; this one passes that at t = {time:.6g} s and turns them by up to {largest:.3g} rad; take order = "
        f"{better}",
        k, time, largest, limit,
    )  # fmt: skip
