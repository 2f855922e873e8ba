"""States of one model of an arm in the coordinates of another, and the initial state of a scene's models."""

import warnings
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np

import flexarm._core as _core

from .._check import Array
from ..analysis.rates import elastic_rates
from ..arm.arm import Arm
from ..model.acting.drive import Motion
from ..model.acting.load import pushes
from ..model.parts.beam import STRAINS, Beam
from ..run.result import Result
from ..run.scene.scene import Scene
from ..run.start import NEAR, acting, sagging, state

_FARTHEST_START = 0.5  # a start farther than this is not meant to be in equilibrium
_REST_MOTION = 1e-3  # rad or m: tolerated motion of a joint in equilibrium when it is released

_POINTS = np.polynomial.legendre.leggauss(40)  # of a beam, at which strains are compared

#: The pieces of a beam (or the whole beam), each with its start along the beam (m).
Parts: TypeAlias = Sequence[tuple[float, Beam]]


def restated(
    x: Array, of: Arm, arm: Arm, parts: Sequence[Sequence[tuple[int, float]]] | None = None, rates: bool = False
) -> Array:
    """Coordinates (..., nq), or rates (..., nv), for another model of an arm.

    Joint coordinates keep their values. Elastic coordinates keep them by strain and number, new ones are zero; in
    another basis, or in pieces, their strains along the beam fit the given ones by least squares.

    Args:
        parts: for each link of `of`, the links of `arm` that represent it, and where (m) they begin; None: one each.
    """

    def first(a: Arm, k: int) -> tuple[int, int]:
        """First indices of a link's joint coordinates and of its elastic coordinates."""
        joint = a.links[k].joint
        at = a._core.first(k) if rates else a._core.first_q(k)
        return at, at + (joint.nv if rates else joint.nq)

    out = np.tile(np.zeros(arm.nv) if rates else arm.zero, (*x.shape[:-1], 1))
    parts = [[(k, 0.0)] for k in range(len(of.links))] if parts is None else parts
    for k, (given, pieces) in enumerate(zip(of.links, parts, strict=True)):
        (old, elastic), (new, end) = first(of, k), first(arm, pieces[0][0])
        out[..., new:end] = x[..., old:elastic]
        found = [(i, start, beam) for i, start in pieces if (beam := arm.links[i].beam) is not None and beam.ne]
        if given.beam is None or not given.beam.ne or not found:
            continue
        if len(pieces) == 1 and given.beam.basis == found[0][2].basis:
            P = _same(given.beam, found[0][2])
        else:
            P = nearest([(0.0, given.beam)], [(start, beam) for _, start, beam in found])
        at = np.concatenate([first(arm, i)[1] + np.arange(beam.ne) for i, _, beam in found])
        out[..., at] = x[..., elastic : elastic + given.beam.ne] @ P.T
    return out


def _same(of: Beam, to: Beam) -> Array:
    """1 where coordinates (to.ne, of.ne) are of the same strain and number."""
    names = [[(s, n) for s in STRAINS for n in range(beam.counts.get(s, 0))] for beam in (to, of)]
    return np.array([[float(a == b) for b in names[1]] for a in names[0]]).reshape(to.ne, of.ne)


def nearest(of: Parts, to: Parts) -> Array:
    """Matrix from the elastic coordinates of one beam (or of its pieces in turn) to those of another whose strains
    along the beam are nearest."""
    if len(of) == len(to) == 1:
        return _nearest(of[0][1]._core, to[0][1]._core, of[0][1].length)
    x, weights = _POINTS
    rows = []
    for start, beam in max(of, to, key=len):
        places = start + beam.length * (x + 1) / 2
        rows += [(w * _strains(of, p), w * _strains(to, p))
                 for p, w in zip(places.tolist(), np.sqrt(weights * beam.length), strict=True)]  # fmt: skip
    given, own = (np.vstack(part) for part in zip(*rows, strict=True))
    return np.asarray(np.linalg.lstsq(own, given, rcond=None)[0])


@lru_cache(64)
def _nearest(of: _core.Beam, to: _core.Beam, length: float) -> Array:
    """The same of whole beams."""
    own, given = (_table(beam, length) for beam in (to, of))
    return np.asarray(np.linalg.lstsq(own, given, rcond=None)[0])


@lru_cache(64)
def _table(beam: _core.Beam, length: float) -> Array:
    """Strains at the points along a beam by its elastic coordinates, weighted, (points times strains, ne)."""
    x, weights = _POINTS
    rows = [w * beam.strains(p) for p, w in zip((length * (x + 1) / 2).tolist(), np.sqrt(weights), strict=True)]
    return np.vstack(rows)


def _strains(parts: Parts, x: float) -> Array:
    """Strains at x (m) per elastic coordinate of all parts."""
    here = max(k for k, (start, _) in enumerate(parts) if start <= x)
    rows = [np.zeros((len(STRAINS), beam.ne)) for _, beam in parts]
    start, beam = parts[here]
    rows[here] = np.asarray(beam._core.strains(min(x - start, beam.length)))
    return np.hstack(rows)


def embed(result: Result, arm: Arm, rows: Any = slice(None)) -> Result:
    """Rows of a run in the coordinates of another model of its arm."""
    of, t = result.arm, result.t[rows]
    v, a, tau = restated(np.stack([x[rows] for x in (result.v, result.a, result.tau)]), of, arm, rates=True)
    return Result(arm, t, restated(result.q[rows], of, arm), v, a, tau)


def keys(arm: Arm) -> list[tuple[int, int, int]]:
    """(link, strain, number) of each rate; (-1, -1, -1) of joints."""
    out = [(-1, -1, -1)] * arm.nv
    for k, beam, _, at in arm.beams():
        out[at] = [(k, STRAINS.index(name), i + 1) for name, n in beam.counts.items() for i in range(n)]
    return out


def some_rows(n: int, most: int) -> Array:
    """Indices of at most `most` of n rows, evenly spaced, with the first and the last."""
    return np.unique(np.linspace(0, n - 1, most).astype(int))


# -- initial states ----------------------------------------------------------------------------------------------------


class Start:
    """The initial state of a scene, and of its models.

    Attributes:
        distance: of the elastic coordinates from equilibrium at the joints' positions and rates, over the sag, in the
            norm of elastic energy; inf if there is no equilibrium, or q0 is a word.
        balanced: whether every model starts in its own equilibrium. free: also with released joints.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene, self.distance = scene, np.inf
        self.balanced, self.free = isinstance(scene.q0, str), False
        if scene.q0 is None or self.balanced:
            return
        arm, at = scene.arm, elastic_rates(scene.arm)
        q, v = state(arm, scene.q0, scene.v0, scene.drive, scene.loads, float(scene.t[0]), scene.control)
        if not at.any() or v[at].any():
            return
        try:
            sag, self.distance = _joints_held(scene, q, v)
        except ValueError:
            return
        self.balanced = self.distance < NEAR
        self.extra = q - sag
        self.free = self.balanced and not v.any() and not scene.control and _stays_at_rest(scene, sag)

    @property
    def note(self) -> str:
        """A note on the start for a reader of a plan; "" if there is none."""
        if NEAR <= self.distance < _FARTHEST_START:
            return (
                f"the start is {100 * self.distance:.2g} % of the sag from balance in the scene's own model; other "
                "models begin with the same strains, and vibrate otherwise; if balance is meant, say q0 = "
                '"trim" or "equilibrium"'
            )
        if self.balanced and np.isfinite(self.distance):
            return "the start is in balance in the scene's own model; so is that of each model, with strains of its own"
        return ""

    def of(self, scene: Scene, parts: Sequence[Sequence[tuple[int, float]]]) -> tuple[Array | None, Array | None]:
        """q0 and v0 of the scene with another model of its arm; `parts` as of `restated`.

        Raises:
            ValueError: that model has no such equilibrium.
        """
        given, arm = self.scene, scene.arm
        v0 = None if given.v0 is None else restated(given.v0, given.arm, arm, parts, rates=True)
        if given.q0 is None:
            return None, v0
        if isinstance(given.q0, str):
            return replace(scene, q0=given.q0).start(), v0
        q0 = restated(given.start(), given.arm, arm, parts)
        if not self.balanced:
            return q0, v0
        q, v = state(arm, q0, v0, scene.drive, scene.loads, float(scene.t[0]), scene.control)
        try:
            sag = _joints_released(scene, q) if self.free else _joints_held(scene, q, v)[0]
        except ValueError as e:
            raise ValueError(f"q0: is in balance in the scene's own model, in this one is none: {e}") from None
        return sag + restated(self.extra + given.arm.zero, given.arm, arm, parts) - arm.zero, v0


def _joints_held(scene: Scene, q: Array, v: Array) -> tuple[Array, float]:
    return sagging(scene.arm, q, v, scene.drive, scene.loads, float(scene.t[0]))


def _joints_released(scene: Scene, q: Array) -> Array:
    """q in equilibrium with all joints released except those of prescribed motion."""
    t, arm = float(scene.t[0]), scene.arm
    tau, volts = acting(arm, scene.drive, t)
    held = [key for key, law in scene.drive.items() if isinstance(law, Motion)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        loads = [*scene.loads, *pushes(arm, scene.drive)]
        return arm.equilibrium(q, tau, held, loads=loads, t=t, voltages=volts or None)


def _stays_at_rest(scene: Scene, q: Array) -> bool:
    """Whether released joints stay at rest."""
    try:
        found = _joints_released(scene, q)
    except ValueError:
        return False
    return bool(np.abs(found - q).max() < _REST_MOTION)
