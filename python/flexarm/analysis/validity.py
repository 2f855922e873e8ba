"""Whether a run stayed within the range of its beams' orders."""

from collections.abc import Iterable
from weakref import WeakKeyDictionary

import numpy as np

import flexarm._core as _core

from .._check import Array
from ..model.parts.beam import Beam
from ..model.parts.chain import Chain
from .findings import Finding, RangeWarning

#: Rotation of a section against the beam's base (rad) up to which each order keeps the tip within 2 % of the length of
#: where "exact" has it: the least over static loads and, but for order 1, the first swing of spin-ups, rounded; see
#: docs/failures.md, which bench/failures/failures.py measures. Order 1 softens with speed besides, at any deflection.
LIMITS = {0: 0.25, 1: 0.25, 2: 0.3, 3: 0.65}

#: Parts of a beam's length, and radians, by which the sections of order "exact" may be off because its Gauss points are
#: too few for how it is bent, before that is said.
TRUNCATION = 1e-6
#: Rotation (rad) up to which the points that the basis chooses are always enough for that.
_RESOLVED = 1.0


_BOUNDS: WeakKeyDictionary[_core.Arm, Array] = WeakKeyDictionary()  # every run asks
_ALWAYS = 1e-300  # limit of a bound that says nothing


def _places(beam: Beam) -> Array:
    """Where a beam is looked at (m), from its clamp to its end."""
    return np.linspace(0.0, beam.length, 1 + max(8, 2 * max(beam.counts.values())))


def _stretches(beam: Beam) -> tuple[Array, Array]:
    """The strain eps of the axis at `_places`, by a unit of each elastic coordinate, (nx, ne); its largest, (ne,)."""
    eps = np.array([beam._core.strains(x)[5] for x in _places(beam)])
    return eps, np.abs(eps).max(axis=0)


def _inside_out(arm: Chain, t: Array, q: Array) -> tuple[float, ...] | None:
    """Finds the beam whose axis is shortened most, where that is by more than its length: 1 + eps <= 0. Returns its
    link, the time of the first such row (s), the least 1 + eps, and where along the beam (m); or None. (An elastic
    force that is linear in eps knows no such limit, so that equations have solutions beyond it.)"""
    worst = None
    for k, beam, at, _ in arm.beams():
        if "extension" not in beam.counts:
            continue
        stretch = 1.0 + q[:, at] @ _stretches(beam)[0].T
        past = np.flatnonzero(stretch.min(axis=1) <= 0.0)
        if past.size:
            place = np.unravel_index(int(stretch.argmin()), stretch.shape)
            found = float(stretch[place]), k, float(t[past[0]]), float(_places(beam)[place[1]])
            worst = found if worst is None else min(worst, found)
    return None if worst is None else (worst[1], worst[2], worst[0], worst[3])


def turned_inside_out(arm: Chain, q: Array) -> str:
    """Says which beam is so at one q (nq,), and where; "" if none is."""
    found = _inside_out(arm, np.zeros(1), q[None])
    return "" if found is None else f"{arm.names[int(found[0])]}: {_shortened(*found)}"


def _shortened(_: float, __: float, stretch: float, x: float) -> str:
    return f"its beam is turned inside out at x = {x:.4g} m: 1 + eps of its axis is {stretch:.3g}"


def _turns(beam: Beam) -> tuple[Array, Array]:
    """Rotation vector, integral of K from 0 to X, of a unit of each elastic coordinate, at places X, (3 nx, ne); and of
    each coordinate the largest rotation of a section, (ne,)."""
    turns = beam._core.turns(_places(beam)[1:])
    return turns, np.linalg.norm(turns.reshape(-1, 3, turns.shape[1]), axis=1).max(axis=0)


def rotation(beam: Beam, qe: Array) -> Array:
    """The measure that LIMITS bounds, at each row of qe (nt, ne): the largest rotation of a section (rad).

    In a plane that is the whole angle a. Torsion moves nothing by itself, so that in space the measure is
    (b a^n)^(1/(n+1)), with b the angle of bending: the terms that order n leaves out grow like that."""
    turns = _turns(beam)[0]
    angles = (qe @ turns.T).reshape(len(qe), len(turns) // 3, 3)
    whole, bending = np.linalg.norm(angles, axis=2), np.linalg.norm(angles[:, :, 1:], axis=2)
    n = 1 if beam.order in (0, "exact") else int(beam.order)
    out: Array = ((bending * whole**n) ** (1.0 / (n + 1))).max(axis=1)
    return out


def _within_bounds(arm: Chain, q: Array) -> bool:
    """Whether bounds of all beams' rotations, and of their shortening, by the largest of each coordinate of q (nt, nq)
    are within their ranges."""
    if (known := _BOUNDS.get(arm._core)) is None:
        rows = []
        for _, beam, at, _ in arm.beams():
            most = _RESOLVED if beam.order == "exact" else LIMITS[int(beam.order)]
            bounds = [(_turns(beam)[1], _ALWAYS if beam.order == "exact" and beam.gauss_points is not None else most)]
            bounds += [(_stretches(beam)[1], np.nextafter(1.0, 0.0))] if "extension" in beam.counts else []
            for sizes, limit in bounds:
                row = np.zeros(arm.nq)
                row[at] = sizes / limit
                rows.append(row)
        known = _BOUNDS[arm._core] = np.reshape(rows, (len(rows), arm.nq))
    if not len(known) or not len(q):
        return True
    return bool(np.maximum.reduce(known.dot(np.maximum.reduce(np.abs(q)))) <= 1.0)  # max(): slower


def _unresolved(arm: Chain, t: Array, q: Array) -> tuple[float, ...] | None:
    """Finds the first exact beam whose Gauss points are too few for how it is bent. Returns its link, the time of the
    first row that is off by more than TRUNCATION (s), its largest rotation (rad), and by how much sections are off at
    most; or None. It looks at the rows where a coordinate is largest, and at all rows only if one of these is off."""
    for k, beam, at, _ in arm.beams() if len(q) else ():
        if beam.order != "exact":
            continue
        qe = q[:, at]
        angle = rotation(beam, qe)
        rows = np.unique([*np.abs(qe).argmax(axis=0), angle.argmax()])
        if (beam._core.truncation(qe[rows]) <= TRUNCATION).all():
            continue
        wrong = beam._core.truncation(qe)
        return k, float(t[np.argmax(~(wrong <= TRUNCATION))]), float(angle.max()), float(wrong.max())
    return None


def worst_range(arm: Chain, t: Array, q: Array) -> tuple[float, ...] | None:
    """Finds the beam of a trajectory t (nt,), q (nt, nq) that is furthest beyond its order's range. Returns its link,
    the time of the first row past the limit (s), its largest rotation (rad), and how many others are beyond theirs;
    where none is, the result of `_unresolved`. But first that of `_inside_out`, whose third number is not above 0. It
    costs next to nothing while all is well."""
    if _within_bounds(arm, q):
        return None
    if (turned := _inside_out(arm, t, q)) is not None:
        return turned
    worst, others = None, -1
    for k, beam, at, _ in arm.beams():
        if beam.order == "exact":
            continue
        angle, limit = rotation(beam, q[:, at]), LIMITS[int(beam.order)]
        past = np.flatnonzero(~(angle <= limit))
        if past.size:
            others += 1
            found = (float(angle.max()) / limit, k, float(t[past[0]]), float(angle.max()))
            worst = found if worst is None else max(worst, found)
    return _unresolved(arm, t, q) if worst is None else (*worst[1:], others)


def range_warning(arm: Chain, found: Iterable[float], still: bool = False) -> RangeWarning:
    """The warning for a result of `worst_range`. `still`: it is about one state, without times."""
    found = link, time, rotation, others = tuple(map(float, found))
    since, beam = "" if still else f"from t = {time:.6g} s ", arm.links[int(link)].beam
    assert beam is not None
    where, unit = arm.names[int(link)], "rad"
    limit = _RESOLVED if beam.order == "exact" else LIMITS[int(beam.order)]
    if rotation <= 0.0:
        what = f"{_shortened(*found)}{', ' * (not still)}{since.strip()}"
        remedy, limit, unit = "no real beam bears this; take less load or a stiffer beam", 0.0, ""
    elif beam.order == "exact":
        points = beam._core.gauss_points
        what = (
            f'order "exact" has {points} Gauss points along this beam, too few for how it is bent: {since}its sections '
            f"are off by more than {TRUNCATION:g} of its length, by up to {others:.2g}"
        )
        remedy = f"take gauss_points = {min(2 * points, 400)}, or fewer shapes"
    else:
        where += f", and {int(others)} more" if others else ""
        passes = "" if still else f"passes that at t = {time:.6g} s and "
        what = (
            f"at order {beam.order} a beam that turns its sections by {limit:g} rad has its tip wrong by 2 % of its "
            f"length; this one {passes}turns them by up to {rotation:.3g} rad"
        )
        enough = [str(n) for n in (2, 3) if n > int(beam.order) and LIMITS[n] >= rotation]
        remedy = "take order = " + " or ".join([", ".join(enough), '"exact"'] if enough else ['"exact"'])
    return RangeWarning(Finding(where, what, rotation, limit, unit, remedy), link=int(link), time=time)
