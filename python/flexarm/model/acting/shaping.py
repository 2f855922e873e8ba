"""Command shaping: a command is split into delayed parts whose vibrations cancel.

N. C. Singer and W. P. Seering, "Preshaping command inputs to reduce system vibration", Journal of Dynamic Systems,
Measurement, and Control 112 (1990), 76-82.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike

import flexarm._core as _core

from ..._check import Array, array, choice, increasing, number, positive
from .drive import Motion, Torque

#: number of "zv" shapers whose convolution gives each kind
KINDS = {"zv": 1, "zvd": 2, "zvdd": 3}
Command = TypeVar("Command", bound=Motion | Torque)


@dataclass(frozen=True)
class Shaper:
    """Impulses that a command is convolved with; `a * b` convolves two shapers, for two modes.

    Args:
        times: s, increasing from 0, (n,).
        amplitudes: shares of the command, with sum 1, (n,).
    """

    times: Sequence[float]
    amplitudes: Sequence[float]

    def __post_init__(self) -> None:
        times = array("times", self.times)
        if times.ndim != 1 or not times.size or times[0] != 0 or not (np.diff(times) > 0).all():
            raise ValueError(f"times = {self.times}: must increase from 0")
        shares = array("amplitudes", self.amplitudes, times.shape)
        if abs(shares.sum() - 1) > 1e-9:
            raise ValueError(f"amplitudes = {self.amplitudes}: sum to {shares.sum():g}, must sum to 1")
        object.__setattr__(self, "times", tuple(times.tolist()))
        object.__setattr__(self, "amplitudes", tuple(shares.tolist()))

    @property
    def impulses(self) -> tuple[tuple[float, float], ...]:
        """(time (s), amplitude) of each impulse."""
        return tuple(zip(self.times, self.amplitudes, strict=True))

    @property
    def duration(self) -> float:
        """The time that it adds to a command (s)."""
        return self.times[-1]

    def __mul__(self, other: Shaper) -> Shaper:
        """Both shapers in series: the zeros of both remain."""
        if not isinstance(other, Shaper):
            return NotImplemented
        found: dict[float, float] = {}
        for t, share in sorted((t + s, a * b) for t, a in self.impulses for s, b in other.impulses):
            last = next(reversed(found), -math.inf)
            same = t - last <= 1e-15 * (1 + abs(t))  # equal up to rounding; a mode of w keeps w times this
            found[last if same else t] = share + (found[last] if same else 0.0)
        return Shaper(tuple(found), tuple(found.values()))

    def residual(self, frequency: ArrayLike, damping_ratio: float = 0.0) -> Any:
        """Residual vibration at the last impulse, over that of the unshaped command.

        Args:
            frequency: undamped frequency (rad/s), an array of any shape. damping_ratio: of the vibration.

        Returns:
            The ratio, in the same shape: 0 at the design point, 1 without a shaper.
        """
        w, zeta = array("frequency", frequency), _ratio(damping_ratio)
        if not (w > 0).all():
            raise ValueError(f"frequency = {frequency!r}: must be positive (rad/s)")
        t = np.array(self.times)
        pole = -zeta + 1j * math.sqrt(1 - zeta**2)
        left = np.abs(np.exp(pole * w[..., None] * (t[-1] - t)) @ np.array(self.amplitudes))
        return left if w.ndim else float(left)

    def __call__(self, t: ArrayLike, y: ArrayLike, *, before: ArrayLike | None = None) -> Array:
        """A sampled command, shaped.

        Args:
            t: times (s), increasing, (nt,); they should extend `duration` beyond the end of the command.
            y: the command, linear in between, (nt,) or (nt, k).
            before: its value before t[0]; y[0] if None.

        Returns:
            The shaped command at the same times, of y's shape.
        """
        times, values = increasing("t", t), array("y", y)
        if values.ndim not in (1, 2) or len(values) != len(times):
            raise ValueError(f"y has shape {values.shape}: must have one row for each of the {len(times)} times")
        columns = values.reshape(len(times), -1)
        first = np.broadcast_to(columns[0] if before is None else array("before", before), columns.shape[1:])
        out = np.zeros_like(columns)
        for delay, share in self.impulses:
            for k, column in enumerate(columns.T):
                out[:, k] += share * np.interp(times - delay, times, column, left=first[k])
        return out.reshape(values.shape)

    def shape(self, command: Command, *, start: float = 0.0, before: float | None = None) -> Command:
        """A Motion or a Torque, shaped; of the same kind, and as smooth. Samples stay samples, evaluated in C++.

        Before its start, a motion rests at its first position. If it ends at rest, it stays there, and the shaped one
        ends `duration` later; otherwise the shaped one ends with the samples. A torque of samples keeps its last value.

        Args:
            command: the unshaped drive of the joint.
            start: start time of a callable or constant Torque (s); samples start with the first.
            before: the torque before it starts (N, N m), zero if None; not of a Motion.

        Raises:
            ValueError: neither Motion nor Torque, or a motion that does not start at rest.
        """
        start = number("start", start)
        if isinstance(command, Motion):
            if before is not None:
                raise ValueError(f"before = {before}: is for a Torque; a motion starts at rest")
            return cast(Command, _shaped_motion(self, command, start))
        if isinstance(command, Torque):
            return cast(Command, _shaped_torque(self, command, start, number("before", before or 0.0)))
        raise ValueError(f"command = {command!r}: must be a Motion or a Torque")


def input_shaper(kind: str, frequency: float, damping_ratio: float = 0.0) -> Shaper:
    """A shaper for one mode (Singer & Seering 1990); for several, multiply the shapers of each.

    Args:
        kind: "zv": no vibration at the design point, two impulses, half a period long; "zvd": its derivative by
            frequency is zero, too, for robustness against a wrong frequency: three impulses, a whole period; "zvdd":
            its second derivative, too: four impulses, one and a half periods.
        frequency: undamped, of the mode (rad/s), such as `arm.modes(lock=[0]).frequencies[0]`: with the joint locked if
            its motion is prescribed or a stiff servo holds it.
        damping_ratio: of the mode, from 0 to below 1.
    """
    choice("kind", kind, KINDS)
    w, zeta = positive("frequency", frequency, "rad/s"), _ratio(damping_ratio)
    root = math.sqrt(1 - zeta**2)
    n, half, ratio = KINDS[kind], math.pi / (w * root), math.exp(-zeta * math.pi / root)
    shares = np.array([math.comb(n, k) * ratio**k for k in range(n + 1)])
    return Shaper(tuple(k * half for k in range(n + 1)), tuple(shares / shares.sum()))


def _ratio(damping_ratio: Any) -> float:
    zeta = number("damping_ratio", damping_ratio)
    if not 0 <= zeta < 1:
        raise ValueError(f"damping_ratio = {damping_ratio}: must be from 0 to below 1")
    return zeta


# -- of drives -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Delayed:
    """Delayed shares of a law t -> values; before `start` the law is `before`."""

    law: Any
    impulses: tuple[tuple[float, float], ...]
    start: float
    before: Any

    def __call__(self, t: float) -> Any:
        out = np.zeros(np.shape(self.before))
        for delay, share in self.impulses:
            out = out + share * np.asarray(self.before if t - delay < self.start else self.law(t - delay))
        return tuple(out.tolist()) if out.ndim else float(out)


def _spread(breaks: Array, shaper: Shaper) -> Array:
    """Breaks of the shaped law: those of every delayed copy, without duplicates by rounding."""
    all_of_them = np.sort((breaks[:, None] + np.array(shaper.times)).ravel())
    apart = np.diff(all_of_them) > 1e-12 * (1 + np.ptp(all_of_them))
    return np.asarray(all_of_them[np.append(True, apart)])


def _shaped_motion(shaper: Shaper, motion: Motion, start: float) -> Motion:
    samples = isinstance(motion.law, _core.PiecewisePolynomial)
    breaks = motion.law.breaks if samples else np.array([start])
    begin, end = float(breaks[0]), float(breaks[-1])
    at, last = (array(f"motion at t = {t}", motion(t), (3,)) for t in (begin, end))
    zero = 1e-9 * np.maximum(1.0, np.abs([motion(t) for t in breaks]).max(axis=0))
    if abs(at[1]) > zero[1] or (samples and abs(at[2]) > zero[2]):
        hint = 'Motion(t, q, ends="rest") does' if samples else "such as one that starts later"
        raise ValueError(f"motion at t = {begin}: has v = {at[1]:g}, a = {at[2]:g}: must start at rest; {hint}")
    rest = (float(at[0]), 0.0, 0.0)
    if not samples:
        return Motion(_Delayed(motion.law, shaper.impulses, begin, rest))
    still = bool((np.abs(last) <= zero)[1:].all())

    def held(t: float) -> Any:
        return (last[0], 0.0, 0.0) if still and t >= end else motion(t)

    # pieces have degree five at most: q, v and a at both ends define them
    times = _spread(breaks, shaper)
    times = times if still else times[times <= end]
    delayed = _Delayed(held, shaper.impulses, begin, rest)
    q, v, a = np.array([delayed(float(t)) for t in times]).T
    return Motion(times, q, v, a)


def _shaped_torque(shaper: Shaper, torque: Torque, start: float, before: float) -> Torque:
    if not isinstance(torque.law, _core.PiecewisePolynomial):
        return Torque(_Delayed(torque.law, shaper.impulses, start, before))
    constant = torque.constant
    breaks = np.array([start]) if constant else torque.law.breaks
    begin, end = float(breaks[0]), float(breaks[-1])

    def held(t: float) -> float:
        return float(torque(t if constant else min(t, end)))

    delayed = _Delayed(held, shaper.impulses, begin, before)
    times = _spread(breaks, shaper)
    if constant:  # constant: a piece before its start, and one after the last impulse
        times = np.concatenate([[begin - 1.0], times, [times[-1] + 1.0]])
    width = np.diff(times)
    third, two_thirds = (np.array([delayed(float(t)) for t in times[:-1] + part * width]) for part in (1 / 3, 2 / 3))
    slope = 3 * (two_thirds - third) / width
    return Torque.of(_core.PiecewisePolynomial(times, [slope, 2 * third - two_thirds]), constant)
