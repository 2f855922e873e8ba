"""Times of comparison, interpolation of runs to other times, and samples of the scene's Python functions."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from .._check import Array
from .._core import PiecewisePolynomial
from ..model.acting.drive import Motion
from ..run.result import Result
from ..run.scene.scene import Scene

_ROWS = 200  # output times of the runs that are compared, and as many times between them
_PROBES = 4000


def times_to_compare(t: Array) -> Array:
    """The first and the last output time, some of the others, and as many times between them, each drawn at random from
    its own part of the run, so that no vibration has zeros at all of them."""
    rng = np.random.default_rng(19)
    part = (np.arange(_ROWS) + rng.random((2, _ROWS))) / _ROWS
    own = t if len(t) <= _ROWS else t[np.unique(np.append(part[0] * len(t), [0, len(t) - 1]).astype(int))]
    gaps, many = len(t) - 1, -(-_ROWS // (len(t) - 1))  # several in each where output times are few
    drawn = np.searchsorted(t, t[0] + part[1] * (t[-1] - t[0])).clip(1, gaps) - 1
    gap = np.arange(gaps) if many > 1 else np.unique(drawn)
    share = 0.01 + 0.98 * (np.arange(many) + rng.random((len(gap), many))) / many
    inside = (t[gap, None] + share * np.diff(t)[gap, None]).ravel()
    return np.union1d(own, inside)


def thinned(result: Result, t: Array) -> Result:
    """The rows of a result at the times t, which must be among its own."""
    rows = np.searchsorted(result.t, t - 1e-12 * max(1.0, float(abs(t[-1]))))
    if len(rows) == len(result.t):
        return result
    tau = result.tau[rows]
    return replace(result, t=result.t[rows], q=result.q[rows], v=result.v[rows], a=result.a[rows], tau=tau)


def between(result: Result, t: Array) -> Result:
    """A result at other times within its own: polynomials of degree five through coordinates, rates and accelerations
    at both ends (degree three for quaternions, without second derivatives); forces by linear interpolation."""
    if np.isin(t, result.t).all():
        return thinned(result, t)
    arm, old = result.arm, result.t
    k = np.clip(np.searchsorted(old, t, side="right") - 1, 0, len(old) - 2)
    h, u = np.diff(old)[k][:, None], ((t - old[k]) / np.diff(old)[k])[:, None]

    def through(x: Array, dx: Array, ddx: Array | None) -> Array:
        rise = x[k + 1] - x[k]
        c, d = h * dx[k] - rise, h * dx[k + 1] - rise  # slopes less the straight line's
        out = x[k] + u * rise + u * (1 - u) * ((1 - u) * c - u * d)
        if ddx is not None:  # curvatures less the cubic's
            e, f = h**2 * ddx[k] + 4 * c + 2 * d, h**2 * ddx[k + 1] - (2 * c + 4 * d)
            out = out + u**2 * (1 - u) ** 2 / 2 * ((1 - u) * e + u * f)
        return np.asarray(out)

    rates = np.array([arm._core.rates(x, y)[0] for x, y in zip(result.q, result.v, strict=True)])
    q = through(result.q, rates, None)
    plain = [(i, arm.coordinate_of(i)) for i in range(arm.nv) if arm.coordinate_of(i) >= 0]
    of, at = [i for i, _ in plain], [j for _, j in plain]
    q[:, at] = through(result.q[:, at], result.v[:, of], result.a[:, of])
    for _, ball in arm.quaternions():
        q[:, ball] /= np.linalg.norm(q[:, ball], axis=1, keepdims=True)
    line = [x[k] + u * (x[k + 1] - x[k]) for x in (result.a, result.tau)]
    return replace(result, t=t, q=q, v=through(result.v, result.a, None), a=line[0], tau=line[1], friction=None)


def probes(scene: Scene) -> Array:
    """Times (s) at which functions of time in Python are sampled."""
    return np.asarray(scene.t[0] + np.ptp(scene.t) * np.sort(np.random.default_rng(4).random(_PROBES)))


def callables(scene: Scene) -> list[Any]:
    """Functions of time in Python, t -> number or numbers, that drive the scene; of motions, their accelerations."""
    out: list[Any] = []
    given = [*scene.drive.values(), *scene.loads, *(getattr(c, "reference", None) for c in scene.control)]
    for law in given:
        inner = getattr(law, "law", law)
        if isinstance(law, Motion) and callable(inner) and not isinstance(inner, PiecewisePolynomial):
            out.append(lambda t, f=inner: f(t)[2])
        elif callable(inner) and not isinstance(inner, PiecewisePolynomial):
            out.append(inner)
    return out
