"""Strain shapes given by the user: measured, from finite elements, or any function along the beam."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.polynomial import legendre

from ..._check import Array, array, known_keys

_TERMS = 60  # Legendre polynomials that stand for a shape, at most
Shape = Callable[[float], float] | Sequence[float] | Mapping[str, Any]


def _project(f: Callable[[Array], Array], length: float, points: int) -> Array:
    """Coefficients of f in P_0, P_1, ... of 2x/L - 1, as many as half the Gauss points."""
    s, w = legendre.leggauss(points)
    k = np.arange(min(points // 2, _TERMS))
    values = f(0.5 * length * (1.0 + s))
    return np.asarray((2 * k + 1) / 2 * (legendre.legvander(s, len(k) - 1).T @ (w * values)))


def _from_function(field: str, f: Callable[[float], float], length: float) -> Array:
    def values(x: Array) -> Array:
        return array(field, [f(float(at)) for at in x], x.shape)

    for points in (16, 32, 64, 128):
        c = _project(values, length, points)
        size = np.abs(c) / np.sqrt(2 * np.arange(len(c)) + 1)
        if not size.max() > 0.0:
            raise ValueError(f"{field}: its strain must not be zero throughout")
        tail = float(size[-len(c) // 4 :].max()) / float(size.max())
        if tail < 1e-13:
            break
    if tail > 1e-6:
        raise ValueError(
            f"{field}: is not smooth enough along the beam: {len(c)} Legendre polynomials leave {tail:.1g} of it; "
            "it has too many waves, or kinks (split the beam there)"
        )
    return np.trim_zeros(np.where(size > 1e-15 * size.max(), c, 0.0), "b")


def _from_samples(field: str, x: Array, strain: Array, length: float) -> Array:
    """Cubic spline through the samples, then the fewest Legendre polynomials that keep to it within 1e-6 in the mean
    (all of them, if that leaves less than 1e-2)."""
    from scipy.interpolate import CubicSpline, lagrange

    if x.ndim != 1 or x.size < 2 or strain.shape != x.shape:
        raise ValueError(f"{field} has shapes x {x.shape}, strain {strain.shape}: must be two or more samples of each")
    if not (np.diff(x) > 0).all() or abs(x[0]) > 1e-9 * length or abs(x[-1] - length) > 1e-9 * length:
        raise ValueError(
            f"{field}: x must increase from 0 to the length, {length} m, no place twice; it goes from {x[0]} to {x[-1]}"
        )
    through = CubicSpline(x, strain) if x.size > 3 else lagrange(x, strain)
    c = _project(lambda at: np.asarray(through(at)), length, 512)
    power = c**2 / (2 * np.arange(len(c)) + 1)
    s, w = legendre.leggauss(512)
    whole = float(w @ np.asarray(through(0.5 * length * (1.0 + s))) ** 2) / 2
    left = np.sqrt(np.maximum(whole - np.cumsum(power), 0.0) / max(whole, 1e-300))
    if left[-1] > 1e-2:
        raise ValueError(f"{field}: is too rough: {len(c)} Legendre polynomials leave {left[-1]:.1g} of it")
    enough = int(np.argmax(left <= 1e-6)) if (left <= 1e-6).any() else len(c) - 1
    return c[: enough + 1]


def coefficients(field: str, shape: Any, length: float) -> tuple[float, ...]:
    """One strain shape as coefficients in the Legendre polynomials P_0, P_1, ... of 2x/L - 1.

    `shape` is a callable of x (m); samples at equal steps from the clamp to the tip; {"x": (m), "strain": ...}; or the
    coefficients themselves, {"legendre": ...}.
    """
    if callable(shape):
        c = _from_function(field, shape, length)
    elif isinstance(shape, Mapping):
        known_keys(field, shape, ("x", "strain", "legendre"))
        if set(shape) == {"legendre"}:
            c = array(field, shape["legendre"])
            if c.ndim != 1 or not 1 <= c.size <= _TERMS:
                raise ValueError(f"{field}.legendre has shape {c.shape}: must be 1 to {_TERMS} numbers")
        elif set(shape) == {"x", "strain"}:
            c = _from_samples(field, array(f"{field}.x", shape["x"]), array(f"{field}.strain", shape["strain"]), length)
        else:
            raise ValueError(f"{field} = {shape!r}: must have x and strain, or legendre")
    else:
        strain = array(field, shape)
        c = _from_samples(field, np.linspace(0.0, length, strain.size), strain, length)
    return tuple(float(v) for v in c)


def columns(shapes: Sequence[tuple[float, ...]]) -> Array:
    """One column a shape, for the core."""
    out = np.zeros((max((len(c) for c in shapes), default=0), len(shapes)))
    for k, c in enumerate(shapes):
        out[: len(c), k] = c
    return out


def curvature(field: str, value: Any, length: float) -> Array:
    """Twist and curvatures at rest as coefficients in P_0, P_1, ... of 2x/L - 1, one column each of K1, K2, K3, (n, 3);
    without rows where the beam is straight.

    `value` is three numbers; a callable of x (m) that gives three; samples {"x": (m), "K": (n, 3)} or (x, K); or the
    coefficients {"legendre": three lists}.
    """
    if isinstance(value, Mapping) and set(value) == {"legendre"}:
        rows = value["legendre"]
        if not isinstance(rows, (list, tuple, np.ndarray)) or len(rows) != 3:
            raise ValueError(f"{field}.legendre = {rows!r}: must be three lists, of K1, K2 and K3")
        given = [array(f"{field}.legendre[{c}]", row) for c, row in enumerate(rows)]
        if any(row.ndim != 1 or not 1 <= row.size <= _TERMS for row in given):
            raise ValueError(f"{field}.legendre: must be three lists of 1 to {_TERMS} numbers")
        out = columns([tuple(row.tolist()) for row in given])
    elif callable(value) or isinstance(value, Mapping) or (isinstance(value, (list, tuple)) and len(value) == 2):
        out = columns(_curvature_along(field, value, length))
        out[np.abs(out) < 1e-14 * np.abs(out).max(initial=0.0)] = 0.0  # rounding of the fit
    else:
        out = array(field, value)
        if out.shape != (3,):
            raise ValueError(f"{field} has shape {out.shape}: must be three numbers, K1 (twist), K2 and K3 (1/m)")
        out = out[None]
    while len(out) and not out[-1].any():
        out = out[:-1]
    return out


def kept_curvature(c: Array) -> Any:
    """The coefficients as a beam stores them: three numbers, {"legendre": three lists}, or None if straight."""
    if len(c) == 1:
        return tuple(c[0].tolist())
    return MappingProxyType({"legendre": tuple(tuple(column) for column in c.T.tolist())}) if len(c) else None


def curvature_at(kept: Any, length: float, x: float) -> Array:
    """K1, K2, K3 at rest at x metres (1/m), (3,), from the stored form `kept` of a beam of that length (m)."""
    if not isinstance(kept, Mapping):
        return np.zeros(3) if kept is None else np.array(kept)
    return np.asarray(legendre.legval(2 * x / length - 1, np.array(kept["legendre"]).T))


def _curvature_along(field: str, value: Any, length: float) -> list[tuple[float, ...]]:
    """The columns of a curvature that varies."""
    if callable(value):

        def at(x: float) -> Array:
            return array(f"{field} at x = {x:g}", value(x), (3,))

        values = np.array([at(float(x)) for x in np.linspace(0.0, length, 33)])
        parts: list[Any] = [lambda x, c=c: float(at(x)[c]) for c in range(3)]
    else:
        if isinstance(value, Mapping):
            known_keys(field, value, ("x", "K", "legendre"))
            if set(value) != {"x", "K"}:
                raise ValueError(f"{field} = {value!r}: must have x and K, or legendre")
            value = value["x"], value["K"]
        x, values = array(f"{field}.x", value[0]), array(f"{field}.K", value[1])
        if x.ndim != 1 or values.shape != (x.size, 3):
            raise ValueError(f"{field} has shapes x {x.shape}, K {values.shape}: must be (n,) and (n, 3)")
        parts = [{"x": x, "strain": column} for column in values.T]
    largest = np.abs(values).max(axis=0)
    zero = largest <= 1e-13 * largest.max()
    return [(0.0,) if none else coefficients(field, part, length) for part, none in zip(parts, zero, strict=True)]
