"""Whether a run stayed within the range of its beams' orders."""

from __future__ import annotations

from collections.abc import Iterable
from contextvars import ContextVar
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

import flexarm._core as _core

from .._check import Array
from ..parts.beam import Beam
from ..parts.chain import Chain

#: Rotation of a section against the beam's base (rad) up to which each order keeps the tip within 2 % of the length of
#: where "exact" has it: the least over static loads and, but for order 1, the first swing of spin-ups, rounded; see
#: docs/failures.md, which bench/failures/failures.py measures. Order 1 softens with speed besides, at any deflection.
LIMITS = {0: 0.25, 1: 0.25, 2: 0.3, 3: 0.65}

#: Parts of a beam's length, and radians, by which the sections of order "exact" may be off because its Gauss points are
#: too few for how it is bent, before that is said.
TRUNCATION = 1e-6
#: Rotation (rad) up to which the points that the basis chooses are always enough for that.
_RESOLVED = 1.0


class RangeWarning(UserWarning):
    """A beam bent further than its order is good for (see `LIMITS`), or, at order "exact", than its Gauss points
    resolve (see `TRUNCATION`); or one whose axis is shorter than nothing, so that it is turned inside out.

    Attributes:
        link: the link of that beam (the worst, if there are several).
        time: of the first output row past the limit (s).
        rotation: largest rotation of its sections against its base in the run (rad); where it is turned inside out the
            least 1 + eps, which is not above 0.
        limit: that its order is good for (rad); at order "exact", that its Gauss points are always enough for; 0 where
            it is turned inside out.
    """

    def __init__(self, message: str, link: int, time: float, rotation: float, limit: float) -> None:
        super().__init__(message)
        self.link, self.time, self.rotation, self.limit = link, time, rotation, limit

    def __reduce__(self) -> Any:
        return type(self), (str(self), self.link, self.time, self.rotation, self.limit)


_KNOWN: WeakKeyDictionary[_core.Beam, tuple[Array, Array]] = WeakKeyDictionary()  # every run asks
_STRETCHES: WeakKeyDictionary[_core.Beam, tuple[Array, Array]] = WeakKeyDictionary()
_QUIET: WeakKeyDictionary[_core.Arm, tuple[Array, Array]] = WeakKeyDictionary()


def _places(beam: Beam) -> Array:
    """Where a beam is looked at (m), from its clamp to its end."""
    return np.linspace(0.0, beam.length, 1 + max(8, 2 * max(beam.counts.values())))


def _stretches(beam: Beam) -> tuple[Array, Array]:
    """The strain eps of the axis at `_places`, by a unit of each elastic coordinate, (nx, ne); its largest, (ne,)."""
    if beam._core not in _STRETCHES:
        eps = np.array([beam._core.strains(x)[5] for x in _places(beam)])
        _STRETCHES[beam._core] = eps, np.abs(eps).max(axis=0)
    return _STRETCHES[beam._core]


def _inside_out(arm: Chain, t: Array, q: Array) -> tuple[float, ...] | None:
    """Finds the beam whose axis is shortened most, where that is by more than its length: 1 + eps <= 0. Returns its
    link, the time of the first such row (s), the least 1 + eps, and where along the beam (m); or None. (An elastic
    force that is linear in eps knows no such limit, so that equations have solutions beyond it.)"""
    worst = None
    for k, link in enumerate(arm.links):
        beam = link.beam
        if beam is None or "extension" not in beam.counts:
            continue
        first, (eps, _) = arm._core.first_q(k) + link.joint.nq, _stretches(beam)
        qe = q[:, first : first + beam.ne]
        stretch = 1.0 + qe @ eps.T
        past = np.flatnonzero(stretch.min(axis=1) <= 0.0)
        if past.size:
            row, at = np.unravel_index(int(stretch.argmin()), stretch.shape)
            found = float(stretch[row, at]), k, float(t[past[0]]), float(_places(beam)[at])
            worst = found if worst is None else min(worst, found)
    return None if worst is None else (worst[1], worst[2], worst[0], worst[3])


def turned_inside_out(arm: Chain, q: Array) -> str:
    """Says which beam is so at one q (nq,), and where; "" if none is."""
    found = _inside_out(arm, np.zeros(1), q[None])
    return "" if found is None else _shortened(arm, *found)


def _shortened(arm: Chain, link: float, _: float, stretch: float, x: float) -> str:
    name = arm.names[int(link)]
    return f"{name}: its beam is turned inside out at x = {x:.4g} m: 1 + eps of its axis is {stretch:.3g}"


def _turns(beam: Beam) -> tuple[Array, Array]:
    """Rotation vector, integral of K from 0 to X, of a unit of each elastic coordinate, at places X, (3 nx, ne); and of
    each coordinate the largest rotation of a section, (ne,)."""
    if beam._core not in _KNOWN:
        turns = beam._core.turns(_places(beam)[1:])
        sizes = np.linalg.norm(turns.reshape(-1, 3, turns.shape[1]), axis=1).max(axis=0)
        _KNOWN[beam._core] = turns, sizes
    return _KNOWN[beam._core]


def rotation(beam: Beam, qe: Array) -> Array:
    """The measure that LIMITS bounds, at each row of qe (nt, ne): the largest rotation of a section (rad).

    In a plane that is the whole angle a. Torsion moves nothing by itself, so that in space the measure is
    (b a^n)^(1/(n+1)), with b the angle of bending: the terms that order n leaves out grow like that."""
    angles = (qe @ _turns(beam)[0].T).reshape(len(qe), -1, 3)
    whole, bending = np.linalg.norm(angles, axis=2), np.linalg.norm(angles[:, :, 1:], axis=2)
    n = 1 if beam.order in (0, "exact") else int(beam.order)
    out: Array = ((bending * whole**n) ** (1.0 / (n + 1))).max(axis=1)
    return out


def _quiet(arm: Chain, q: Array) -> bool:
    """Whether bounds of all beams' rotations, and of their shortening, by the largest of each coordinate of q (nt, nq)
    are within what is good for them."""
    if arm._core not in _QUIET:
        rows, limits = [], []
        for k, link in enumerate(arm.links):
            beam = link.beam
            if beam is None or not beam.ne:
                continue
            most = _RESOLVED if beam.order == "exact" else LIMITS[int(beam.order)]
            known = [(_turns(beam)[1], -1.0 if beam.order == "exact" and beam.gauss_points is not None else most)]
            known += [(_stretches(beam)[1], np.nextafter(1.0, 0.0))] if "extension" in beam.counts else []
            for sizes, limit in known:
                row, first = np.zeros(arm.nq), arm._core.first_q(k) + link.joint.nq
                row[first : first + beam.ne] = sizes
                rows.append(row)
                limits.append(limit)
        _QUIET[arm._core] = np.reshape(rows, (len(rows), arm.nq)), np.array(limits)
    by_q, bounds = _QUIET[arm._core]
    return bool((by_q @ np.abs(q).max(axis=0, initial=0.0) <= bounds).all())


def _unresolved(arm: Chain, t: Array, q: Array) -> tuple[float, ...] | None:
    """Finds the first exact beam whose Gauss points are too few for how it is bent. Returns its link, the time of the
    first row that is off by more than TRUNCATION (s), its largest rotation (rad), and by how much sections are off at
    most; or None. It looks at the rows where a coordinate is largest, and at all rows only if one of these is off."""
    for k, link in enumerate(arm.links):
        beam = link.beam
        if beam is None or beam.order != "exact" or not beam.ne or not len(q):
            continue
        first = arm._core.first_q(k) + link.joint.nq
        qe = q[:, first : first + beam.ne]
        angle = rotation(beam, qe)
        rows = np.unique([*np.abs(qe).argmax(axis=0), angle.argmax()])
        if (beam._core.truncation(qe[rows]) <= TRUNCATION).all():
            continue
        wrong = beam._core.truncation(qe)
        return k, float(t[np.argmax(~(wrong <= TRUNCATION))]), float(angle.max()), float(wrong.max())
    return None


#: set where who calls `simulate` tells of these warnings himself
SILENT: ContextVar[bool] = ContextVar("SILENT", default=False)


def worst_range(arm: Chain, t: Array, q: Array) -> tuple[float, ...] | None:
    """Finds the beam of a trajectory t (nt,), q (nt, nq) that is furthest beyond its order's range. Returns its link,
    the time of the first row past the limit (s), its largest rotation (rad), and how many others are beyond theirs;
    where none is, what `_unresolved` finds. But first what `_inside_out` finds, whose third number is not above 0. It
    costs next to nothing while all is well."""
    if _quiet(arm, q):
        return None
    if (turned := _inside_out(arm, t, q)) is not None:
        return turned
    worst, others = None, -1
    for k, link in enumerate(arm.links):
        beam = link.beam
        if beam is None or beam.order == "exact" or not beam.ne:
            continue
        first = arm._core.first_q(k) + link.joint.nq
        qe, limit = q[:, first : first + beam.ne], LIMITS[int(beam.order)]
        angle = rotation(beam, qe)
        past = np.flatnonzero(~(angle <= limit))
        if past.size:
            others += 1
            found = (float(angle.max()) / limit, k, float(t[past[0]]), float(angle.max()))
            worst = found if worst is None else max(worst, found)
    return _unresolved(arm, t, q) if worst is None else (*worst[1:], others)


def range_warning(arm: Chain, found: Iterable[float], name: str = "", still: bool = False) -> RangeWarning:
    """Words what `worst_range` found. `name` begins the message; `still`: it is about one state, without times."""
    found = link, time, rotation, others = tuple(map(float, found))
    since, passes = f"from t = {time:.6g} s ", f"passes that at t = {time:.6g} s and "
    if still:
        since = passes = ""
    if rotation <= 0.0:
        text = f"{name}{_shortened(arm, *found)}" + f", {since.strip()}" * (not still)
        remedy = "no real beam bears this; take less load or a stiffer beam"
        return RangeWarning(f"{text}; {remedy}", int(link), time, rotation, 0.0)
    beam, name = arm.links[int(link)].beam, name + arm.names[int(link)]
    assert beam is not None
    if beam.order == "exact":
        points = beam._core.gauss_points
        return RangeWarning(
            f'{name}: order "exact" has {points} Gauss points along this beam, too few for how it is '
            f"bent: {since}its sections are off by more than {TRUNCATION:g} of its length, by up to "
            f"{others:.2g}; take gauss_points = {min(2 * points, 400)}, or fewer shapes",
            int(link), time, rotation, _RESOLVED,
        )  # fmt: skip
    order, limit = beam.order, LIMITS[int(beam.order)]
    more = f", and {int(others)} more" if others else ""
    enough = [str(n) for n in (2, 3) if n > int(order) and LIMITS[n] >= rotation]
    better = " or ".join([", ".join(enough), '"exact"'] if enough else ['"exact"'])
    return RangeWarning(
        f"{name}{more}: at order {order} a beam that turns its sections by {limit:g} rad has its tip "
        f"wrong by 2 % of its length; this one {passes}turns them by up "
        f"to {rotation:.3g} rad; take order = {better}",
        int(link), time, rotation, limit,
    )  # fmt: skip


def out_of_range(arm: Chain, t: Array, q: Array) -> RangeWarning | None:
    """The warning that a trajectory t (nt,), q (nt, nq) deserves, or None."""
    found = worst_range(arm, t, q)
    return None if found is None else range_warning(arm, found)
