"""The motion of an arm's nodes over time, at as many frames as a smooth curve needs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._check import Array
from ..model.acting.load import Load
from ..model.parts.chain import Chain
from .body import Body, length, make_body

_BUDGET = 1.5e6  # bytes: frames of one page
_MOST = 20_000  # rows: of a result, at most
_TOLERANCE = 3e-4  # of the arm's length, between frames


@dataclass
class Track:
    """One arm over time."""

    body: Body  #: the drawn shapes
    t: Array  #: of the frames (s), (nt,)
    position: Array  #: of the nodes, world axes (m), (nt, n, 3)
    quaternion: Array  #: x, y, z, w, (nt, n, 4), without jumps of sign
    strain: Array  #: eps, K2, K3 (1/m) of the slices, not magnified, (nt, n, 3); zero elsewhere
    force: Array  #: of the loads, world axes (N), (nt, n, 3)
    moment: Array  #: likewise (N m)
    error: float  #: largest distance of the curve through the frames from the rows between them (m)
    title: str  #: text above the arm
    gravity: Array  #: world axes (m/s^2)

    @cached_property
    def _curve(self) -> Callable[[Any], Array]:
        columns = (self.position, self.quaternion, self.strain, self.force, self.moment)
        return curve(self.t, np.concatenate([x.reshape(len(self.t), -1) for x in columns], axis=1))

    def at(self, t: float) -> tuple[Array, Array, Array, Array, Array]:
        """position, rotation (n, 3, 3), strain, force and moment at a time (s), interpolated as in the browser."""
        from scipy.spatial.transform import Rotation

        n, loads = self.position.shape[1], self.force.shape[1]
        ends = np.cumsum([3 * n, 4 * n, 3 * n, 3 * loads])
        p, turn, *rest = np.split(self._curve(np.clip(t, self.t[0], self.t[-1])), ends)
        strain, force, moment = (x.reshape(-1, 3) for x in rest)
        return p.reshape(-1, 3), Rotation.from_quat(turn.reshape(-1, 4)).as_matrix(), strain, force, moment

    def tips(self, times: Array) -> list[Array]:
        """Positions of the arm's ends at times (s), (nt, 3) each."""
        from scipy.spatial.transform import Rotation

        def tip(node: int, at: Any) -> Array:
            p, turn = (curve(self.t, x[:, node])(times) for x in (self.position, self.quaternion))
            return np.asarray(p + Rotation.from_quat(turn).apply(at))

        return [tip(*end) for end in self.body.tips]


def curve(t: Array, x: Array) -> Callable[[Any], Array]:
    """The cubic spline through x (nt, ...) at times t, whose ends have the slope of the cubic through four frames."""
    from scipy.interpolate import CubicSpline

    if len(t) == 1:
        return lambda at: np.broadcast_to(x[0], (*np.shape(at), *x.shape[1:]))
    first, last = (np.tensordot(_end_weights(s[:4]), y[:4], 1) for s, y in ((t, x), (t[::-1], x[::-1])))
    return CubicSpline(t, x, bc_type=((1, first), (1, last)))  # type: ignore[no-any-return]


def _end_weights(t: Array) -> Array:
    """Weights of the values at t for the derivative at t[0] of the polynomial through them."""
    apart = t[:, None] - t + np.eye(len(t))
    others = np.prod(apart[0, 1:]) / apart[0]
    weights = others / np.prod(apart, axis=1)
    weights[0] = (1 / apart[0, 1:]).sum()
    return np.asarray(weights)


def magnified(arm: Chain, q: Array, magnify: float) -> Array:
    """q (..., nq) with the elastic coordinates multiplied by `magnify`."""
    out = np.array(q)
    for _, _, at, _ in arm.beams():
        out[..., at] *= magnify
    return out


def _slices(arm: Chain, q: Array) -> list[int]:
    """Numbers of slices of the beams: neighbours turn by less than 6 degrees at the rows q (nt, nq), 33 at most."""
    rows = q[:: max(len(q) // 60, 1)]
    counts = []
    for k, link in enumerate(arm.links):
        if link.beam is None:
            counts.append(0)
            continue
        R = np.array([arm.frame(rows, k, x)[1] for x in np.linspace(0.0, link.beam.length, 13)])
        cosine = (np.einsum("stij,stij->st", R[1:], R[:-1]) - 1) / 2
        turn = np.arccos(np.clip(cosine, -1.0, 1.0)).sum(axis=0).max()
        fewest = min(max(8, 4 * max(link.beam.counts.values(), default=0)), 32)  # colours follow the strain shapes
        counts.append(int(np.clip(np.ceil(turn / np.radians(6)), fewest, 32)) + 1 if link.beam.ne or turn > 0 else 2)
    return counts


def _frames(arm: Chain, t: Array, q: Array, most: int) -> tuple[NDArray[np.int_], float]:
    """Indices of the frames, evenly spaced, and the largest distance of the curve through them from the rows (m)."""
    places: list[tuple[int, float | None]] = [(k, None) for k in range(len(arm.links))]
    places += [(k, link.beam.length / 2) for k, link in enumerate(arm.links) if link.beam]
    arms = 0.1 * length(arm) * np.array([(0, 0, 0), (0, 1, 0), (0, 0, 1)])  # points beside the axis follow rotations
    poses = [arm.frame(q, k, x) for k, x in places]
    ends = np.concatenate([(p[:, None] + arms @ R.swapaxes(1, 2)).reshape(len(q), -1) for p, R in poses], axis=1)
    last = len(t) - 1
    tolerance, most = _TOLERANCE * max(float(np.ptp(ends, axis=0).max()), 1e-9), max(most, 2)
    finest = -(-last // (most - 1)) if last else 1
    frames, error = np.arange(len(t)), 0.0
    for stride in sorted({int(finest * 1.4**k) for k in range(30)}):
        rows = np.unique(np.append(np.arange(0, len(t), stride), last))
        off = float(np.abs(curve(t[rows], ends[rows])(t) - ends).max()) if stride > 1 else 0.0
        if (stride > finest and off > tolerance) or len(rows) < min(9, len(t)):
            break
        frames, error = rows, off
    return frames, error


def _pose(arm: Chain, body: Body, q: Array) -> tuple[Array, Array, Array]:
    """Positions, rotations and strains (eps, K2, K3) of the nodes at rows q (nt, nq)."""
    n = len(body.places)
    p, R, strain = np.zeros((len(q), n, 3)), np.zeros((len(q), n, 3, 3)), np.zeros((len(q), n, 3))
    for i, (k, x) in enumerate(body.places):
        if k is None:
            R[:, i] = np.eye(3)
            continue
        link = arm.links[k]
        if x is not None:
            p[:, i], R[:, i] = arm.frame(q, k, None if np.isinf(x) else x)
            continue
        p[:, i], R[:, i] = arm.frame(q, k, 0.0 if link.beam else None)
        ends = [link.hub] if link.beam else [link.hub, link.tip]
        p[:, i] -= R[:, i] @ sum((np.array(b.end) for b in ends if b is not None), np.zeros(3))
    return p, R, strain


def _strains(arm: Chain, body: Body, q: Array, strain: Array) -> None:
    for beam in (b for b in body.beams if b["part"] == "beam"):
        for i in range(beam["first"], beam["first"] + beam["count"]):
            k, x = body.places[i]
            assert k is not None and x is not None
            strain[:, i] = arm.strain(q, k, x)[:, [5, 1, 2]]


def _smooth(quaternion: Array) -> Array:
    """Quaternions with continuous signs: q and -q are one rotation."""
    turned = np.einsum("tnk,tnk->tn", quaternion[1:], quaternion[:-1]) < 0
    quaternion[1:] *= np.cumprod(np.where(turned, -1.0, 1.0), axis=0)[:, :, None]
    return quaternion


def make_track(
    arm: Chain,
    t: Array,
    q: Array,
    *,
    loads: Sequence[Load] = (),
    magnify: float = 1.0,
    title: str = "",
    share: float = 1.0,
) -> Track:
    """The track of an arm whose coordinates are q (nt, nq) at times t; `share` is its part of a page's bytes."""
    from scipy.spatial.transform import Rotation

    _, rows = np.unique(t, return_index=True)
    rows = np.unique(np.append(rows[:: -(-len(rows) // _MOST)], rows[-1]))
    t, q = t[rows], q[rows]
    large = magnified(arm, q, magnify)
    body = make_body(arm, _slices(arm, large), loads)
    frames, error = _frames(arm, t, large, int(share * _BUDGET / (20 * len(body.places) + 12 * len(loads))))
    t, q, large = t[frames], q[frames], large[frames]
    p, R, strain = _pose(arm, body, large)
    _strains(arm, body, q, strain)
    known = [[np.zeros(6) if load.by_state else load(float(s)) for load in loads] for s in t]  # others are not drawn
    wrench = np.array(known).reshape(len(t), len(loads), 2, 3)
    for i, load in enumerate(loads):
        if load.along is not None:
            wrench[:, i] *= load.along[1] - load.along[0]
        if load.axes == "section":
            wrench[:, i] = np.einsum("tij,tkj->tki", R[:, body.loads[i]], wrench[:, i])
    turns = Rotation.from_matrix(R.reshape(-1, 3, 3)).as_quat().reshape(len(t), -1, 4)
    force, moment = wrench[:, :, 0], wrench[:, :, 1]
    return Track(body, t, p, _smooth(turns), strain, force, moment, error, title, np.array(arm.gravity))
