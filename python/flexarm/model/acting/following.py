"""References of control as functions of time: motions with rates, and laws that are fitted once for C++."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

import flexarm._core as _core

from ..._check import Array, array, finite_number
from .drive import Motion, Torque

_LAW = _core.PiecewisePolynomial
_JUMP_SAMPLES = 400  # samples of a callable in the search for a jump
_JUMP = 1e-6  # least jump, as a part of a motion's range
_DEGREE, _DEPTH, _CLOSE = 7, 14, 1e-11  # of fitted pieces: degree, most halvings, relative error
_PIECES = 500  # pieces that are halved at once


def scalar_law(field: str, value: Any) -> Torque:
    """A law of one number: a number, samples (t, value), a callable t -> value, or a Torque."""
    if isinstance(value, Torque):
        return value
    if callable(value) or not isinstance(value, (list, tuple, np.ndarray)):
        return Torque(value if callable(value) else finite_number(field, value))
    try:
        t, r = value
    except (TypeError, ValueError):
        raise ValueError(f"{field} = {value!r}: must be a number, samples (t, r), or a callable t -> r") from None
    times = array(f"{field}: t", t)
    return Torque(times, array(f"{field}: r", r, times.shape))


def scaled(one: Torque, factor: float) -> Torque:
    law = one.law
    if isinstance(law, _LAW):
        return Torque.of(_LAW(law.breaks, factor * law.coefficients), one.constant)
    return Torque.of(lambda t: factor * array(f"reference at t = {t}", law(t), ()).item())


def plus(one: Torque, other: Torque) -> Torque:
    """The sum of two laws; polynomials are split at the breaks of both."""
    both = (one, other)
    if not all(isinstance(x.law, _LAW) for x in both):
        return Torque.of(lambda t: one(t) + other(t))
    moving = [x.law for x in both if not x.constant]
    breaks = np.unique(np.concatenate([law.breaks for law in moving])) if moving else one.law.breaks
    degree = max(len(x.law.coefficients) for x in both) - 1
    law = Fitted(breaks, sum(_expanded(x, breaks, degree) for x in both))
    law.kinks = np.unique(np.concatenate([kinks_of(x) for x in moving])) if moving else np.zeros(0)
    return Torque.of(law, not moving)


def _expanded(of: Torque, breaks: Array, degree: int) -> Array:
    """Coefficients of a law in the pieces between breaks, (degree + 1, pieces)."""
    if of.constant:
        start, c = breaks[:-1], np.repeat(of.law.coefficients, len(breaks) - 1, axis=1)
    else:
        middle = 0.5 * (breaks[1:] + breaks[:-1])
        piece = np.clip(np.searchsorted(of.law.breaks, middle) - 1, 0, len(of.law.breaks) - 2)
        start, c = of.law.breaks[piece], of.law.coefficients[:, piece]
    up, shift, out = c[::-1], breaks[:-1] - start, np.zeros((degree + 1, len(breaks) - 1))
    for k in range(len(up)):
        out[degree - k] = sum(math.comb(i, k) * up[i] * shift ** (i - k) for i in range(k, len(up)))
    return out


def kinks_of(law: Any) -> Array:
    """Times of a law of polynomials that no step may pass over."""
    found: Array = law.kinks if isinstance(law, Fitted) else law.breaks
    return found


def along(motion: Motion, by_q: float, by_v: float) -> Torque:
    """by_q q + by_v v of a motion as a law of time."""
    law = motion.law
    if not isinstance(law, _LAW):
        return Torque.of(lambda t: float(np.dot((by_q, by_v), array(f"reference at t = {t}", law(t), (3,))[:2])))
    c = law.coefficients
    out = by_q * c
    out[1:] += by_v * c[:-1] * np.arange(len(c) - 1, 0, -1)[:, None]
    return Torque.of(_LAW(law.breaks, out), motion.constant)


def led(reference: Motion | Torque, rate: Torque | None, by_q: float, by_v: float, times: Array) -> Torque:
    """by_q r + by_v r' as a law of time, checked; r' is the `rate`, that of a motion, or zero."""
    if isinstance(reference, Motion):
        check_motion("reference", reference, times)
        return along(reference, by_q, by_v)
    reference.check_span("reference", times)
    if rate is None:
        return scaled(reference, by_q)
    rate.check_span("reference_rate", times)
    return plus(scaled(reference, by_q), scaled(rate, by_v))


def led_by(reference: Any, rate: Any) -> tuple[Motion | Torque, Torque | None]:
    """A reference of one number and its rate, as `led` takes them."""
    if isinstance(reference, Motion):
        if rate is not None:
            raise ValueError("reference_rate: the reference is a Motion, which has its rate")
        return reference, None
    return scalar_law("reference", reference), None if rate is None else scalar_law("reference_rate", rate)


def check_motion(where: str, motion: Motion, times: Array, smooth: bool = False) -> None:
    """Raises ValueError if a motion does not cover these times, its rates are not the derivatives of its position, or
    it jumps (or its rate, if it must be `smooth`)."""
    motion.check_span(where, times)
    if isinstance(motion.law, _LAW) or times[0] == times[-1]:
        return
    for k, name in enumerate(("q", "v")[: 1 + smooth]):
        found = _jump(where, motion, times, k)
        if found:
            unit = "rad or m" if k == 0 else "rad/s or m/s"
            raise ValueError(
                f"{where}: its {name} jumps by {found[1]:.3g} {unit} at t = {found[0]:.6g}, which no arm can follow; "
                "must be continuous"
            )
    motion.check_rates(where, times)


def _jump(where: str, motion: Motion, times: Array, k: int) -> tuple[float, float] | None:
    """Time and size of the largest jump of q (k = 0) or v (k = 1); None if there is none."""
    t = np.linspace(times[0], times[-1], _JUMP_SAMPLES + 1)
    x = np.array([array(f"{where} at t = {s}", motion.law(float(s)), (3,)) for s in t])
    miss = np.diff(x[:, k]) - 0.5 * np.diff(t) * (x[1:, k + 1] + x[:-1, k + 1])
    i = int(np.abs(miss).argmax())
    (low, high), (a, b) = (float(t[i]), float(t[i + 1])), (x[i], x[i + 1])
    for _ in range(45):
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        m = array(f"{where} at t = {middle}", motion.law(middle), (3,))
        left = abs(m[k] - a[k] - (middle - low) * a[k + 1])
        if left > abs(b[k] - m[k] - (high - middle) * b[k + 1]):
            high, b = middle, m
        else:
            low, a = middle, m
    step = float(b[k] - a[k])
    return (high, step) if abs(step) > _JUMP * max(float(np.ptp(x[:, k])), 1e-12) else None


class Fitted(_LAW):
    """A fitted law of time, which is smooth at most of its breaks.

    Attributes:
        kinks: times where the function is not smooth. No step may pass over these; over other breaks it may.
    """

    kinks: Array


def fitted(f: Callable[[Array], Array], begin: float, end: float, kinks: Array) -> list[Fitted]:
    """Piecewise polynomials of degree 7 through f (n,) -> (n, k) from begin to end, one law for each of its k numbers.
    Pieces are halved until they fit."""
    kinks, least = np.unique(kinks), 1e-9 * (end - begin)
    kinks = kinks[(kinks > begin + least) & (kinks < end - least)]
    kinks = kinks[np.diff(kinks, prepend=begin) > least]  # equal up to rounding
    left = np.concatenate([[begin], kinks])
    width = np.diff(np.append(left, end))
    nodes = 0.5 - 0.5 * np.cos(np.pi * np.arange(_DEGREE + 1) / _DEGREE)
    between = 0.5 * (nodes[1:] + nodes[:-1])
    powers = np.vander(nodes), np.vander(between, _DEGREE + 1)
    done: list[tuple[Array, Array, Array]] = []
    most = _PIECES + 4 * len(left)
    size = np.zeros(1)
    for level in range(_DEPTH + 1):
        places = left[:, None] + width[:, None] * np.concatenate([nodes, between])
        y = f(places.ravel())
        y = y.reshape(*places.shape, y.shape[1])
        size = np.maximum(size, np.abs(y).max(axis=(0, 1)))
        c = np.linalg.solve(powers[0], y[:, : nodes.size])
        off = np.abs(powers[1] @ c - y[:, nodes.size :]).max(axis=1)
        enough = level == _DEPTH or left.size > most  # noise needs endless halvings
        good = (off <= _CLOSE * size + 1e-300).all(axis=1) | enough
        done.append((left[good], width[good], c[good]))
        left, width = left[~good], 0.5 * width[~good]
        if not left.size:
            break
        left, width = np.concatenate([left, left + width]), np.tile(width, 2)
    left, width, c = (np.concatenate([d[k] for d in done]) for k in range(3))
    order = np.argsort(left)
    left, width, c = left[order], width[order], c[order]
    c = c / width[:, None, None] ** np.arange(_DEGREE, -1, -1)[:, None]
    laws = [Fitted(np.append(left, end), c[:, :, k].T) for k in range(c.shape[2])]
    for law in laws:
        law.kinks = kinks
    return laws


def motions_of(reference: Any, names: Sequence[str]) -> list[Motion]:
    """A Motion for each named freedom of the joints, from motions or numbers: a list, or a single one for one
    freedom."""
    given = list(reference) if isinstance(reference, (list, tuple, np.ndarray)) else [reference]
    if len(given) != len(names):
        raise ValueError(
            f"reference: has {len(given)} entries; must have {len(names)}, a Motion or a number for each of "
            f"{', '.join(names)}"
        )
    places = [r if isinstance(r, Motion) else finite_number(f"reference[{k}]", r) for k, r in enumerate(given)]
    return [r if isinstance(r, Motion) else Motion.of(_LAW([0.0, 1.0], [[r]]), constant=True) for r in places]
