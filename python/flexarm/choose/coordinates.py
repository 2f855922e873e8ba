"""States and runs of one arm in the coordinates of another: those of the same name keep their values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .._check import Array
from ..arm import Arm
from ..parts.beam import Beam
from ..run.result import Result
from ..scene.scene import Scene


def carried(values: Array, names: tuple[str, ...], others: tuple[str, ...], start: Array) -> Array:
    """Values (..., n) of the coordinates `names` as values (..., m) of the coordinates `others`: those of the same name
    keep theirs, new ones have those of `start` (m,)."""
    out = np.tile(start, (*values.shape[:-1], 1)) if values.ndim > 1 else np.array(start)
    at = {name: k for k, name in enumerate(names)}
    pairs = [(k, at[name]) for k, name in enumerate(others) if name in at]
    out[..., [k for k, _ in pairs]] = values[..., [j for _, j in pairs]]
    return out


def carried_q(q: Array, of: Arm, arm: Arm) -> Array:
    """Coordinates (..., of.nq) as another arm's (..., arm.nq)."""
    return carried(q, of.q_names, arm.q_names, arm.zero)


def carried_v(v: Array, of: Arm, arm: Arm) -> Array:
    """Rates, or what belongs to rates, (..., of.nv) as another arm's (..., arm.nv)."""
    return carried(v, of.coordinates, arm.coordinates, np.zeros(arm.nv))


def initial_state(scene: Scene, arm: Arm) -> tuple[Array | None, Array | None]:
    """q0 and v0 of the scene for another model of its arm. Elastic coordinates keep their values by name, new ones
    start at zero; in another basis they are those whose strains along the beam are nearest to the given ones."""
    q0 = None if scene.q0 is None else carried_q(scene.q0, scene.arm, arm)
    v0 = None if scene.v0 is None else carried_v(scene.v0, scene.arm, arm)
    for k, (link, given) in enumerate(zip(arm.links, scene.arm.links, strict=True)):
        beam, old = link.beam, given.beam
        if beam is None or old is None or not beam.ne or not old.ne or beam.basis == old.basis:
            continue
        new_q, old_q = (a._core.first_q(k) + link.joint.nq for a in (arm, scene.arm))
        new_v, old_v = (a._core.first(k) + link.joint.nv for a in (arm, scene.arm))
        P = nearest(old, beam)
        for out, value, at, of in ((q0, scene.q0, new_q, old_q), (v0, scene.v0, new_v, old_v)):
            if out is not None and value is not None:
                out[at : at + beam.ne] = P @ value[of : of + old.ne]
    return q0, v0


def nearest(of: Beam, to: Beam) -> Array:
    """Elastic coordinates (to.ne, of.ne) of one beam by those of another, of the strains that are nearest to the
    other's along the beam."""
    x, weights = np.polynomial.legendre.leggauss(40)
    places = list(zip(np.sqrt(weights), of.length * (x + 1) / 2, strict=True))
    given, own = (np.vstack([w * np.asarray(b._core.strains(float(p))) for w, p in places]) for b in (of, to))
    return np.asarray(np.linalg.lstsq(own, given, rcond=None)[0])


@dataclass
class Embedded:
    """A run of one arm, in the coordinates of another."""

    t: Array
    q: Array
    v: Array
    a: Array


def embed(result: Result, arm: Arm, rows: Any = slice(None)) -> Embedded:
    """Coordinates of the same name keep their values, others are zero."""
    of = result.arm
    v, a = (carried_v(x[rows], of, arm) for x in (result.v, result.a))
    return Embedded(result.t[rows], carried_q(result.q[rows], of, arm), v, a)


def some_rows(n: int, most: int) -> Array:
    """At most so many of n rows, evenly, the first and the last among them."""
    return np.unique(np.linspace(0, n - 1, most).astype(int))
