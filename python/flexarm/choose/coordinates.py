"""States and runs of one arm in the coordinates of another: coordinates of the same name keep their values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from .._check import Array
from ..arm.arm import Arm
from ..model.parts.beam import STRAINS, Beam
from ..run.result import Result

#: The pieces of a beam (or the whole beam), each with its start along the beam (m).
Parts: TypeAlias = Sequence[tuple[float, Beam]]


def carried(values: Array, names: tuple[str, ...], others: tuple[str, ...], start: Array) -> Array:
    """Values (..., n) of the coordinates `names` as values (..., m) of `others`: coordinates of the same name keep
    their values, new ones take those of `start` (m,)."""
    out = np.tile(start, (*values.shape[:-1], 1)) if values.ndim > 1 else np.array(start)
    at = {name: k for k, name in enumerate(names)}
    pairs = [(k, at[name]) for k, name in enumerate(others) if name in at]
    out[..., [k for k, _ in pairs]] = values[..., [j for _, j in pairs]]
    return out


def carried_q(q: Array, of: Arm, arm: Arm) -> Array:
    """Coordinates (..., of.nq) as another arm's (..., arm.nq)."""
    return carried(q, of.q_names, arm.q_names, arm.zero)


def carried_v(v: Array, of: Arm, arm: Arm) -> Array:
    """Rates or generalized forces (..., of.nv) as another arm's (..., arm.nv)."""
    return carried(v, of.coordinates, arm.coordinates, np.zeros(arm.nv))


def restated(x: Array, of: Arm, arm: Arm, parts: Sequence[Sequence[tuple[int, float]]], rates: bool = False) -> Array:
    """Coordinates (nq,), or rates (nv,), for another model of an arm.

    Joint coordinates keep their values. Elastic coordinates keep them by strain and number, new ones are zero; in
    another basis, or in pieces, their strains along the beam fit the given ones by least squares.

    Args:
        parts: for each link of `of`, the links of `arm` that represent it, and where (m) they begin.
    """

    def first(a: Arm, k: int) -> tuple[int, int]:
        """First indices of a link's joint coordinates and of its elastic coordinates."""
        joint = a.links[k].joint
        at = a._core.first(k) if rates else a._core.first_q(k)
        return at, at + (joint.nv if rates else joint.nq)

    out = np.zeros(arm.nv) if rates else arm.zero
    for k, (given, pieces) in enumerate(zip(of.links, parts, strict=True)):
        (old, elastic), (new, end) = first(of, k), first(arm, pieces[0][0])
        out[new:end] = x[old:elastic]
        found = [(i, start, beam) for i, start in pieces if (beam := arm.links[i].beam) is not None and beam.ne]
        if given.beam is None or not given.beam.ne or not found:
            continue
        if len(pieces) == 1 and given.beam.basis == found[0][2].basis:
            P = _same(given.beam, found[0][2])
        else:
            P = nearest([(0.0, given.beam)], [(start, beam) for _, start, beam in found])
        at = np.concatenate([first(arm, i)[1] + np.arange(beam.ne) for i, _, beam in found])
        out[at] = P @ x[elastic : elastic + given.beam.ne]
    return out


def _same(of: Beam, to: Beam) -> Array:
    """1 where coordinates (to.ne, of.ne) are of the same strain and number."""
    names = [[(s, n) for s in STRAINS for n in range(beam.counts.get(s, 0))] for beam in (to, of)]
    return np.array([[float(a == b) for b in names[1]] for a in names[0]]).reshape(to.ne, of.ne)


def nearest(of: Parts, to: Parts) -> Array:
    """Matrix from the elastic coordinates of one beam (or of its pieces in turn) to those of another whose strains
    along the beam are nearest."""
    x, weights = np.polynomial.legendre.leggauss(40)
    rows = []
    for start, beam in max(of, to, key=len):
        places = start + beam.length * (x + 1) / 2
        rows += [(w * _strains(of, p), w * _strains(to, p))
                 for p, w in zip(places.tolist(), np.sqrt(weights * beam.length), strict=True)]  # fmt: skip
    given, own = (np.vstack(part) for part in zip(*rows, strict=True))
    return np.asarray(np.linalg.lstsq(own, given, rcond=None)[0])


def _strains(parts: Parts, x: float) -> Array:
    """Strains at x (m) per elastic coordinate of all parts."""
    here = max(k for k, (start, _) in enumerate(parts) if start <= x)
    rows = [np.zeros((len(STRAINS), beam.ne)) for _, beam in parts]
    start, beam = parts[here]
    rows[here] = np.asarray(beam._core.strains(min(x - start, beam.length)))
    return np.hstack(rows)


@dataclass
class Embedded:
    """A run of one arm in the coordinates of another."""

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
    """Indices of at most `most` of n rows, evenly spaced, with the first and the last."""
    return np.unique(np.linspace(0, n - 1, most).astype(int))
