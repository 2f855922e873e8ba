"""Low-pass filters of the first and second order, ahead of an instrument's sampling."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..._check import Array, array, number, positive, whole
from ...model.parts.part import Part

_MANY = 100  # equal steps, from which on one recursion computes all
_DIGITS = 9  # digits in which equal steps, and places in them, agree

#: the polynomial through values at 0, 1/2 and 1: it, its slope and its second derivative at 0
_PARABOLA = np.array([[1.0, 0.0, 0.0], [-3.0, 4.0, -1.0], [4.0, -8.0, 4.0]])


@dataclass(frozen=True)
class LowPass(Part):
    """An analogue low-pass filter of unit gain.

    With w = 2 pi frequency, order 1 is w / (s + w), and order 2 is w^2 / (s^2 + 2 damping_ratio w s + w^2). White noise
    of the one-sided density n (unit/sqrt(Hz), as data sheets tell it) leaves it with a standard deviation of
    n sqrt(bandwidth).

    Args:
        frequency: Hz. Of order 1 the cut-off, where 0.707 of the amplitude (-3 dB) passes, 45 degrees late. Of order 2
            the natural frequency, where 1 / (2 damping_ratio) passes, 90 degrees late.
        order: 1 or 2.
        damping_ratio: of order 2 alone; None: 0.707, Butterworth's, with which -3 dB lie at `frequency`.
    """

    frequency: float
    order: int = 1
    damping_ratio: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        positive("frequency", self.frequency, "Hz")
        if self.order not in (1, 2):
            raise ValueError(f"order = {self.order}: must be 1 or 2")
        if self.damping_ratio is None:
            self._set("damping_ratio", float(np.sqrt(0.5)) if self.order == 2 else None)
        elif self.order == 1:
            raise ValueError(f"damping_ratio = {self.damping_ratio}: is of order 2; order = 1 has none")
        else:
            positive("damping_ratio", self.damping_ratio)

    @property
    def bandwidth(self) -> float:
        """The equivalent bandwidth of noise (Hz): the integral of |response|^2 over frequency."""
        return float(np.pi / 2 * self.frequency / (1.0 if self.damping_ratio is None else 2 * self.damping_ratio))

    def response(self, frequency: ArrayLike) -> Any:
        """Frequency response at frequencies (Hz), (...): complex, (...)."""
        s = 1j * array("frequency", frequency) / self.frequency
        return 1 / (1 + s) if self.damping_ratio is None else 1 / (1 + 2 * self.damping_ratio * s + s * s)

    def apply(self, t: ArrayLike, y: ArrayLike, axis: int = 0) -> Array:
        """The filter's output for a recorded signal: exact for straight lines between its samples.

        Args:
            t: times (s), (nt,), increasing, in equal steps or not.
            y: the signal, or signals, each settled at its first value.
            axis: of y, along which t runs.

        Returns:
            In the shape of y.

        Raises:
            ValueError: bad shapes, times that do not increase.
        """
        times, signal = array("t", t), array("y", y)
        if times.ndim != 1 or not times.size or not (np.diff(times) > 0).all():
            raise ValueError("t: must be times that increase")
        if not -signal.ndim <= whole("axis", axis) < signal.ndim or signal.shape[axis] != times.size:
            raise ValueError(f"y has shape {signal.shape}: must have {times.size} entries, one for each of t")
        rows = np.moveaxis(signal, axis, 0)
        flat = rows.reshape(times.size, -1)
        out = Filtered(self, times, flat, 0.5 * (flat[1:] + flat[:-1]))
        return np.moveaxis(out.states[:, 0].reshape(rows.shape), 0, axis).copy()

    def matrices(self) -> tuple[Array, Array]:
        """A (order, order) and B (order,) of x' = A x + B u, whose output is x[0]; settled, x is (u, 0)."""
        w = 2 * np.pi * self.frequency
        if self.damping_ratio is None:
            return np.array([[-w]]), np.array([w])
        return w * np.array([[0.0, 1.0], [-1.0, -2 * self.damping_ratio]]), w * np.array([0.0, 1.0])

    def settled(self, y: Array) -> Array:
        """The state (order, k) at equilibrium with the input y (k,)."""
        return np.vstack([y, np.zeros((self.order - 1, *y.shape))])

    def steps(self, step: Array, part: Array) -> Array:
        """Matrices from the state ahead of steps (m,) to that after a `part` of each, (m, order, order + 3): they
        multiply the state and the inputs at the step's beginning, middle and end, with a parabola between."""
        from scipy.linalg import expm  # slow to import

        (A, B), n = self.matrices(), self.order
        # x' = A x + B u; of u(s), s = 0 to 1 over the step: value, slope and second derivative are three states more
        M = np.zeros((len(step), n + 3, n + 3))
        M[:, :n, :n], M[:, :n, n] = step[:, None, None] * A, step[:, None] * B
        M[:, n, n + 1] = M[:, n + 1, n + 2] = 1.0
        after = expm(part[:, None, None] * M)[:, :n]
        return np.concatenate([after[..., :n], after[..., n:] @ _PARABOLA], axis=-1)

    def step(self, step: float, part: float = 1.0) -> Array:
        """`steps` for one step."""
        return _step(self, float(f"{step:.{_DIGITS}g}"), round(part, _DIGITS))


@lru_cache(maxsize=1024)
def _step(filter: LowPass, h: float, part: float) -> Array:
    return np.asarray(filter.steps(np.array([h]), np.array([part]))[0])


@lru_cache(maxsize=64)  # the neighbours of a fit have the same times, and mostly the same filter
def _steps(filter: LowPass, found: bytes) -> Array:
    return filter.steps(*np.frombuffer(found).reshape(2, -1))


def _recursion(A: Array, inputs: Array) -> Array:
    """x_0 = g_0, x_k = A x_(k-1) + g_k for inputs g (m, n, k), by the complex Schur form of A."""
    from scipy.linalg import schur  # slow to import
    from scipy.signal import lfilter

    T, Q = schur(A, output="complex")
    z = np.matmul(Q.conj().T, inputs)
    for i in reversed(range(len(A))):
        z[1:, i] += np.einsum("j,mjk->mk", T[i, i + 1 :], z[:-1, i + 1 :])
        z[:, i] = lfilter([1.0], [1.0, -T[i, i]], z[:, i], axis=0)
    return np.ascontiguousarray(np.matmul(Q, z).real)


class Filtered:
    """The output of a filter: k signals over nt times, and anywhere between.

    Args:
        filter: the filter. t: times (nt,).
        y: the input at these, (nt, k). middle: halfway between, (nt - 1, k).

    Attributes:
        states: of the filter at the times, (nt, order, k); the first is the output.
    """

    def __init__(self, filter: LowPass, t: Array, y: Array, middle: Array) -> None:
        self.filter, self.t, self.h = filter, t, np.diff(t)
        self.inputs = np.stack([y[:-1], middle, y[1:]], axis=1)
        self.states = np.empty((len(t), filter.order, y.shape[1]))
        x = self.states[0] = filter.settled(y[0])
        if not self.h.size:
            return
        n = filter.order
        each, which = self._distinct_steps(self.h, np.ones_like(self.h))
        by_input = np.matmul(each[which][..., n:], self.inputs)
        by_state = each[..., :n]
        if len(each) == 1 and len(self.h) >= _MANY:
            self.states[1:] = _recursion(by_state[0], np.concatenate([x[None], by_input]))[1:]
            return
        for k, i in enumerate(which):
            x = self.states[k + 1] = by_state[i] @ x + by_input[k]

    def _distinct_steps(self, h: Array, part: Array) -> tuple[Array, Any]:
        """`steps` of the distinct ones, and the index of each into them."""
        scale = 10.0 ** np.floor(np.log10(h))
        rounded = np.array([scale * np.round(h / scale, _DIGITS), np.round(part, _DIGITS)])
        if (rounded == rounded[:, :1]).all():  # sorting them takes longer than all the rest
            found, which = rounded[:, :1], np.zeros(len(h), dtype=int)
        else:
            found, which = np.unique(rounded, axis=1, return_inverse=True)
        return _steps(self.filter, found.tobytes()), np.ravel(which)

    def at(self, t: Array) -> Array:
        """The output at any times (m,) within, (m, k)."""
        if not self.h.size:
            return np.repeat(self.states[:, 0], len(t), axis=0)
        k = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.h) - 1)
        each, which = self._distinct_steps(self.h[k], np.clip((t - self.t[k]) / self.h[k], 0.0, 1.0))
        now = np.concatenate([self.states[k], self.inputs[k]], axis=1)
        return np.asarray(np.einsum("mi,mik->mk", each[which, 0], now))


def as_low_pass(field: str, value: Any) -> LowPass:
    """The filter itself; a number is the cut-off of a filter of the first order."""
    if isinstance(value, LowPass):
        return value
    try:
        number(field, value)
    except ValueError:
        raise ValueError(f"{field} = {value!r}: must be a cut-off in Hz, or a LowPass") from None
    return LowPass(positive(field, value, "Hz"))
