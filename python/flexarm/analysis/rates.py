"""The rates of an arm's coordinates: how they move it, which are elastic, which are locked."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._check import Array
from ..model.parts.beam import STRAIN_NAMES
from ..model.parts.chain import Chain


def displaced(arm: Chain, q: Array, E: Array, step: Array) -> Array:
    """q moved by a step of its rates (nv,): q + E step, quaternions brought back to unit length."""
    out: Array = q + E @ step
    for _, at in arm.quaternions():
        out[at] /= np.linalg.norm(out[at])
    return out


def reach(arm: Chain) -> float:
    """The arm's length (m): as far as an end is from the base at zero, and at least its beams; 1 where that is zero."""
    length = arm.longest([float(np.linalg.norm(arm.frame(arm.zero, k)[0])) for k in range(len(arm.links))])
    return max(length, arm.beam_reach) or 1.0


def coordinate_sizes(arm: Chain) -> Array:
    """How far one unit of each rate's coordinate moves the arm, (nv,): the turn of a section (rad), or a shift in parts
    of the arm's length. So coordinates compare, although strains of short beams are large numbers (1/m)."""
    length = reach(arm)
    sizes, first = np.ones(arm.nv), [*map(arm._core.first, range(len(arm.links))), arm.nv]
    for n, link in enumerate(arm.links):
        elastic = slice(first[n] + link.joint.nv, first[n + 1])
        sizes[first[n] : elastic.start] = [1.0 / length if unit == "m" else 1.0 for unit in link.joint.units]
        if link.beam is None or elastic.start == elastic.stop:
            continue
        L, shapes = link.beam.length, np.eye(arm.nq)[[arm.coordinate_of(i) for i in range(*elastic.indices(arm.nv))]]
        strains = np.array([arm.strain(shapes, n, x) for x in np.linspace(0.0, L, 9)])  # (points, shapes, 6)
        turns = [L if name.startswith("K") else 1.0 for name in STRAIN_NAMES]
        sizes[elastic] = np.abs(strains * turns).max(axis=(0, 2))
    return np.where(sizes > 0.0, sizes, 1.0)


def elastic_rates(arm: Chain) -> NDArray[np.bool_]:
    """Which rates are elastic coordinates', (nv,)."""
    elastic = np.zeros(arm.nv, dtype=bool)
    for *_, at in arm.beams():
        elastic[at] = True
    return elastic


def locked_rates(arm: Chain, lock: Iterable[Any] | None, field: str = "lock") -> NDArray[np.bool_]:
    """Which rates belong to the locked joints, (nv,)."""
    locked = np.zeros(arm.nv, dtype=bool)
    if lock is not None and (isinstance(lock, str) or not isinstance(lock, Iterable)):
        raise ValueError(f"{field} = {lock!r}: must be a list of link numbers or names, such as [0, 1]")
    for link in () if lock is None else lock:
        locked[arm.joint_rates(link, f"{field}: link")] = True
    return locked
