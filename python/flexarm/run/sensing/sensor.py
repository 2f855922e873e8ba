"""The base of all sensors (paper Sec. 5): how an instrument on the arm reads, at an instant and over a whole run.

A sensor is on a joint or on a slice. `measure` gives the physical quantity; `read` (of a Result) and `sampler` (inside
a control loop) give the instrument's output: it filters, samples, delays, scales and shifts (gain, offset), adds
noise, rounds to steps and saturates, in this order.
"""

from __future__ import annotations

import zlib
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ..._check import Array, array, not_negative, positive, warn
from ...arm.arm import Arm
from ...model.acting.load import Load
from ...model.parts.beam import as_floats
from ...model.parts.part import ModelWarning, Part
from ..result import Result
from .lowpass import Filtered, LowPass, as_low_pass
from .reading import Reading

PerComponent = float | Sequence[float]
Component = tuple[str, str]  # label, unit
_COMMON = ("filter", "rate", "delay", "gain", "offset", "resolution", "noise", "range", "seed")
_FINER = 10  # a sensor may sample so many times between two output times


@dataclass(frozen=True)
class Sensor(Part):
    """The base class of sensors: filter, rate, delay, errors and noise.

    `offset`, `resolution`, `noise` and `range` are in the sensor's unit; they and `gain` are each one number or one for
    each component. By default an instrument is ideal.

    Attributes:
        filter: analogue low pass ahead of sampling, noise and steps: a cut-off (Hz) for one of the first order, or a
            LowPass. It starts settled.
        rate: samples a second (Hz); None: a sample at every output time, or every time a sampler is asked.
        delay: age of the measured quantity at the output (s); before the start, the arm stood as it started.
        gain, offset: the reading is gain (1) times the measured quantity, plus offset: errors of calibration, or
            another scale (a gain in V gives a reading in V; the sensor's unit does not change).
        noise: standard deviation of each sample, white and Gaussian. (Of a one-sided density n, in unit/sqrt(Hz),
            that is n sqrt(rate / 2).)
        resolution: the reading is the nearest multiple of this.
        range: the reading stays between -range and +range.
        seed: of the noise, a whole number from 0. The same sensor and seed give the same noise, another sensor (or
            the same one elsewhere) another; two alike in one place need two seeds.
    """

    filter: LowPass | float | None = field(default=None, kw_only=True)
    rate: float | None = field(default=None, kw_only=True)
    delay: float = field(default=0.0, kw_only=True)
    gain: PerComponent = field(default=1.0, kw_only=True)
    offset: PerComponent = field(default=0.0, kw_only=True)
    resolution: PerComponent | None = field(default=None, kw_only=True)
    noise: PerComponent | None = field(default=None, kw_only=True)
    range: PerComponent | None = field(default=None, kw_only=True)
    seed: int = field(default=0, kw_only=True)

    type: ClassVar[str] = ""
    #: whether `measure` needs the accelerations a
    needs_a: ClassVar[bool] = False
    #: whether `measure` needs the loads
    feels_loads: ClassVar[bool] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.filter is not None:
            self._set("filter", as_low_pass("filter", self.filter))
        if self.rate is not None:
            positive("rate", self.rate, "Hz")
        not_negative("delay", self.delay, "s")
        for name in ("gain", "offset"):
            value = array(name, getattr(self, name))
            self._set(name, as_floats(value) if value.ndim else float(value))
        for name in ("resolution", "noise", "range"):
            value = getattr(self, name)
            if value is None:
                continue
            if isinstance(value, (list, tuple)):
                self._set(name, as_floats(array(name, value)))
            if not (array(name, value) >= 0).all() or (name != "noise" and not np.all(value)):
                raise ValueError(f"{name} = {value}: must {'not be negative' if name == 'noise' else 'be positive'}")
        not_negative("seed", self.seed)

    def _smooth(self) -> Sensor:
        """It, whose readings have no steps."""
        steps: dict[str, Any] = {name: None for name in ("resolution", "pulses") if hasattr(self, name)}
        return replace(self, **steps)

    # -- defined by each kind of sensor --------------------------------------------------------------------------------

    def components(self, arm: Arm) -> list[Component]:
        """(label, unit) of each component."""
        raise NotImplementedError(f"{type(self).__name__} has no components(arm): it is no kind of sensor by itself")

    def measure(
        self,
        arm: Arm,
        t: ArrayLike,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike | None = None,
        tau: ArrayLike | None = None,
        *,
        loads: Sequence[Load] | None = None,
    ) -> Array:
        """The measured quantity: no filter, sampling, delay, noise, steps or saturation.

        Args:
            arm: the arm.
            t: times (s), (...). q: (..., nq). v, a, tau: (..., nv). An accelerometer and a force/torque sensor
                need a (`needs_a`); of the others it may be None. None of those here needs tau.
            loads: external forces and moments, which affect a force/torque sensor.

        Returns:
            (..., k)

        Raises:
            ValueError: bad shapes, or a place that is not on the arm.
        """
        if self.needs_a and a is None:
            raise ValueError(f"a = None: {self._kind()} needs the accelerations")
        return self._measure(arm, np.asarray(t, dtype=float), array("q", q), array("v", v), a, loads)

    def _measure(self, arm: Arm, t: Array, q: Array, v: Array, a: Any, loads: Any) -> Array:
        raise NotImplementedError(f"{type(self).__name__} has no measure(...): it is no kind of sensor by itself")

    def _rows(self, arm: Arm) -> tuple[Array, Array] | None:
        """Derivatives of the quantity by q (k, nq) and v (k, nv), if it is linear in them; else None."""
        return None

    def line(self, arm: Arm) -> tuple[Array, Array, Array, Array] | None:
        """The reading as rows by q (k, nq) and v (k, nv), their offsets and their steps (k,); None of an instrument
        that remembers, has noise or a range, or is not linear in the state."""
        kind = type(self)
        plain = kind.measure is Sensor.measure and kind.sampler is Sensor.sampler
        if not plain or self.rate or self.delay or np.any(self.noise or 0.0) or self.filter or self.range is not None:
            return None
        rows, k = self._rows(arm), len(self.components(arm))
        gain = self._each("gain", k, 1.0)[:, None]
        return None if rows is None else (gain * rows[0], gain * rows[1], self._each("offset", k, 0.0), self.steps(arm))

    def steps(self, arm: Arm) -> Array:
        """The step of the reading, per component, (k,); 0: no steps."""
        return self._each("resolution", len(self.components(arm)), 0.0)

    # -- readings ------------------------------------------------------------------------------------------------------

    def check(self, arm: Arm, t: Array | None = None) -> None:
        """ValueError if this sensor cannot be on this arm, or cannot read a result at these times."""
        if t is not None:
            self._instants(t)
        zero = np.zeros(arm.nv)
        self.measure(arm, 0.0, arm.zero, zero, zero)
        _Instrument(self, arm)

    def read(self, result: Result) -> Reading:
        """The instrument's output for a simulated run.

        Between output times the state is interpolated: q by cubic Hermite pieces from q and dq/dt, v likewise from v
        and a, a is the derivative of the latter. A jump of a force between two output times is smoothed over that time.
        A filter is exact for parabolas through the measured quantity at the output times and halfway between; it starts
        settled at the first value. Without one, frequencies above half the rate are aliased.

        Raises:
            ValueError: a place that is not on the arm, a result of fewer than two rows, or a rate above ten times that
                of the output times.

        Warns:
            ModelWarning: a filter's frequency is above half the rate of the output times.
        """
        arm = result.arm
        instrument = _Instrument(self, arm)
        if len(result.t) < 2:
            raise ValueError(f"result: has {len(result.t)} rows; a reading needs at least two")
        if self.feels_loads and result.loads is None:
            raise ValueError(
                "loads = None: the file does not keep the loads of this result, so reactions are not known"
            )
        t, found = self._instants(result.t), self._quantity([(1.0, result)])
        y = found[0]
        if isinstance(self.filter, LowPass):
            coarse = self._coarse_warning(float(np.diff(result.t).max()))
            if coarse:
                warn(coarse)
            y = self._filtered(result.t, found)
        names, units = zip(*self.components(arm), strict=True)
        return Reading(t, instrument(y), self.title(arm), names, units)

    def _read_sums(self, groups: Sequence[Sequence[tuple[float, Result]]]) -> Array:
        """Of each group of weights, whose sum is zero, and results: the weighted sum of their readings without noise,
        steps and limits, (k, nt, components). The filter passes all of them at once."""
        found = [self._quantity(group) for group in groups]
        y = [np.concatenate(x, axis=1) for x in zip(*found, strict=True)]
        t = groups[0][0][1].t
        rows = self._filtered(t, y) if isinstance(self.filter, LowPass) else y[0]
        rows = rows.reshape(len(rows), len(groups), -1).transpose(1, 0, 2)
        return np.asarray(rows * self._each("gain", rows.shape[2], 1.0))

    def _times(self, t: Array) -> Array | None:
        """Times of the quantity in the readings of a result at t; None: those of the result."""
        return np.clip(self._instants(t) - self.delay, t[0], t[-1]) if self.delay or self.rate else None

    def _quantity(self, of: Sequence[tuple[float, Result]]) -> list[Array]:
        """The weighted sum of the measured quantities of results, (nt, k); with a filter, at the output times and
        halfway between."""
        found: list[Any] = []
        for weight, result in of:
            arm, state = result.arm, (result.t, result.q, result.v, result.a, result.tau)
            if isinstance(self.filter, LowPass):
                states = [state, _midway(arm, *state)]
            else:
                states = [_interpolated(result, self._times(result.t))]
            arm, loads = result.acting if self.feels_loads else (arm, ())
            found.append([weight * self.measure(arm, *x, loads=loads) for x in states])
        return [sum(x) for x in zip(*found, strict=True)]

    def _filtered(self, t: Array, y: list[Array]) -> Array:
        """Output of the filter for quantities at times t and halfway between, at the times of the readings."""
        assert isinstance(self.filter, LowPass)
        filtered, at = Filtered(self.filter, t, *y), self._times(t)
        return filtered.states[:, 0] if at is None else filtered.at(at)

    def sampler(self, arm: Arm, *, loads: Sequence[Load] | None = None) -> Sampler:
        """The instrument inside a control loop; see Sampler."""
        return Sampler(self, arm, loads=loads)

    def title(self, arm: Arm) -> str:
        """A name, such as "strain gauge +y, link 0 at 0.01 m"."""
        return f"{self._kind()}, {self._where(arm)}"

    def _kind(self) -> str:
        return self.type.replace("_", " ")

    def _where(self, arm: Arm) -> str:
        link, x = arm._link(getattr(self, "link", -1)), getattr(self, "x", None)
        return f"{arm.names[link]} end" if x is None else f"{arm.names[link]} at {x:g} m"

    def _each(self, name: str, count: int, without: float) -> Array:
        value = getattr(self, name)
        if value is None:
            return np.full(count, without)
        if np.ndim(value) and np.shape(value) != (count,):
            raise ValueError(f"{name} = {value}: must be one number, or {count}, one for each component")
        return np.array(np.broadcast_to(np.asarray(value, dtype=float), count))

    def _coarse_warning(self, gap: float) -> ModelWarning | None:
        """A warning if a filter is too fast for states that are `gap` (s) apart, else None."""
        frequency = self.filter.frequency if isinstance(self.filter, LowPass) else 0.0
        if frequency * gap <= 0.5 * (1 + 1e-9):
            return None
        return ModelWarning(
            f"filter: {frequency:g} Hz is above half the rate of the states that this {self._kind()} sees, every "
            f"{gap:g} s: it passes frequencies that these do not resolve; have one every {0.5 / frequency:.3g} s"
        )

    def _instants(self, t: Array) -> Array:
        if self.rate is None:
            return np.array(t)
        gap = float(np.diff(t).max())
        if self.rate * gap > _FINER * (1 + 1e-9):
            raise ValueError(
                f"rate = {self.rate:g}: is above {_FINER / gap:g} Hz, ten times that of the result's output times; "
                f"simulate with an output time every {_FINER / self.rate:g} s or less"
            )
        count = int(np.floor((t[-1] - t[0]) * self.rate + 1e-6)) + 1
        return np.asarray(t[0] + np.arange(count) / self.rate)


class _Instrument:
    """Turns measured quantities into readings: it scales and shifts rows (..., k), adds noise, rounds them to steps,
    and saturates."""

    def __init__(self, sensor: Sensor, arm: Arm) -> None:
        count = len(sensor.components(arm))
        self.gain, self.offset = sensor._each("gain", count, 1.0), sensor._each("offset", count, 0.0)
        self.noise = sensor._each("noise", count, 0.0)
        self.range = sensor._each("range", count, np.inf)
        self.step = sensor.steps(arm)
        place = {k: v for k, v in sensor._arguments().items() if k not in _COMMON}
        if "link" in place:  # -1 and the last link's number are one place
            place["link"] = arm._link(place["link"])
        if "contact" in place:
            place["contact"] = arm._contact(place["contact"])
        self.rng = np.random.default_rng([sensor.seed, zlib.crc32(f"{sensor.type} {place}".encode())])

    def __call__(self, y: Array, skip: int = 0) -> Array:
        """The reading of y; the noise of `skip` samples is drawn first and dropped."""
        if (self.gain != 1.0).any() or self.offset.any():
            y = self.gain * y + self.offset
        if self.noise.any():
            if skip:
                self.rng.normal(size=(skip, self.noise.size))
            y = y + self.noise * self.rng.normal(size=y.shape)
        if self.step.any():
            by = np.where(self.step > 0, self.step, 1.0)
            y = np.where(self.step > 0, np.floor(y / by + 0.5) * by, y)
        return np.clip(y, -self.range, self.range)


def _interpolated(result: Result, t: Array | None) -> tuple[Array, Array, Array, Array, Array]:
    """Times and state t, q, v, a, tau, interpolated between the output times; None: at those."""
    if t is None:
        return result.t, result.q, result.v, result.a, result.tau
    from scipy.interpolate import CubicHermiteSpline  # slow to import

    rates = _rates(result.arm, result.q, result.v)
    q = CubicHermiteSpline(result.t, result.q, rates)(t)
    v = CubicHermiteSpline(result.t, result.v, result.a)
    tau = np.stack([np.interp(t, result.t, column) for column in result.tau.T], axis=-1)
    return t, q, v(t), v(t, 1), tau


def _rates(arm: Arm, q: Array, v: Array) -> Array:
    """dq/dt of rows of states; v, but for the quaternions of balls."""
    if arm.nq == arm.nv:
        return v
    return np.array([arm._core.rates(*x)[0] for x in zip(q, v, strict=True)])


def _slope(h: Array, x: Array, rate: Array) -> Array:
    """The slope halfway between rows of the cubic pieces through x and `rate`; the mean rate if x is constant."""
    move, mean = np.diff(x, axis=0), 0.5 * (rate[:-1] + rate[1:])
    return np.asarray(mean + np.where(move == 0, 0.0, 1.5 * (move / h - mean)))


def _midway(
    arm: Arm, t: Array, q: Array, v: Array, a: Array | None, tau: Array | None
) -> tuple[Array, Array, Array, Array | None, Array | None]:
    """Times and states halfway between rows: q of cubic pieces through q and dq/dt, v their slope, a the slope of those
    through v and a. A force that jumps at a row leaves v right, and a right on average."""
    h = np.diff(t)[:, None]
    rates = _rates(arm, q, v)
    qm, vm = 0.5 * (q[:-1] + q[1:]) - h / 8 * np.diff(rates, axis=0), _slope(h, q, rates)
    if arm.nq != arm.nv:  # balls
        zero = np.zeros(arm.nv)
        vm = np.array([np.linalg.lstsq(arm._core.rates(x, zero)[2], y)[0] for x, y in zip(qm, vm, strict=True)])
    am = None if a is None else _slope(h, v, a)
    return 0.5 * (t[:-1] + t[1:]), qm, vm, am, None if tau is None else 0.5 * (tau[:-1] + tau[1:])


class Sampler:
    """A sensor in a control loop: it keeps the past for its delay, and holds its last sample.

    Called at the same times, it gives the same readings as `read`, noise included. If its sample times (`rate`) or
    their delayed times (`delay`) fall between two calls, it interpolates linearly between the quantities at both; if
    several samples fall due between two calls, the last one counts. A filter is integrated from call to call, as in
    `read` from output time to output time.

    Args:
        sensor: the sensor. arm: the arm.
        loads: external forces and moments, which affect a force/torque sensor.
    """

    def __init__(self, sensor: Sensor, arm: Arm, *, loads: Sequence[Load] | None = None) -> None:
        sensor.check(arm)
        if sensor.feels_loads:
            arm.refuse_rubbing(f"{sensor._kind()} in a loop of control")
        self.sensor, self.arm, self.loads = sensor, arm, loads
        self.reset()

    def reset(self) -> None:
        """Clears the past and restarts the noise."""
        self._instrument = _Instrument(self.sensor, self.arm)
        #: time and quantity of past calls, and, with a filter, its state before and its inputs since the call before
        self._history: deque[tuple[float, Array, tuple[Array, Array] | None]] = deque()
        self._filter: Array = np.empty(0)  #: the filter's state
        self._last_input: tuple[Any, ...] = ()  #: input of the filter at the last call, with time and state
        self._start = 0.0
        self._count = -1
        self._last: Array = np.empty(0)

    def sample(
        self, t: float, q: ArrayLike, v: ArrayLike, a: ArrayLike | None = None, tau: ArrayLike | None = None
    ) -> Array:
        """The reading (k,) at time t (s), which must increase from call to call; q (nq,), v, a, tau (nv,)."""
        s = self.sensor
        self.observe(t, q, v, a, tau)
        now, missed = t, 0
        if s.rate is not None:
            count = int(np.floor((t - self._start) * s.rate + 1e-6))
            if count == self._count:
                return self._last.copy()
            now, missed, self._count = self._start + count / s.rate, count - self._count - 1, count
        self._last = self._instrument(self._output_at(now - s.delay), missed)
        return self._last.copy()

    def observe(
        self, t: float, q: ArrayLike, v: ArrayLike, a: ArrayLike | None = None, tau: ArrayLike | None = None
    ) -> None:
        """Passes the state at time t (s) without a reading: between samples, for a filter or a delay."""
        if not self._history:
            self._start = t
        elif not t > self._history[-1][0]:
            raise ValueError(f"t = {t}: must be later than the last call's, {self._history[-1][0]}")
        y = self.sensor.measure(self.arm, t, q, v, a, tau, loads=self.loads)
        self._history.append((t, y, None) if self.sensor.filter is None else (t, *self._filtered(y, t, q, v, a, tau)))

    def _filtered(self, y: Array, t: float, *state: Any) -> tuple[Array, tuple[Array, Array] | None]:
        """The filter's output at t for the input y; its state before, and its inputs since the last call."""
        s, f = self.sensor, self.sensor.filter
        assert isinstance(f, LowPass)
        now = [None if x is None else np.array(x, dtype=float) for x in (t, *state)]
        before, self._last_input = self._last_input, (y, *now)
        if not self._history:
            self._filter = f.settled(y)
            return y, None
        if len(self._history) == 1 and (coarse := s._coarse_warning(t - self._history[-1][0])):
            warn(coarse)
        rows: list[Any] = [None if x0 is None or x1 is None else np.stack([x0, x1])
                           for x0, x1 in zip(before[1:], self._last_input[1:], strict=True)]  # fmt: skip
        middle = s.measure(self.arm, *_midway(self.arm, *rows), loads=self.loads)[0]
        old, inputs = self._filter, np.stack([before[0], middle, y])
        self._filter = f.step(t - self._history[-1][0]) @ np.vstack([old, inputs])
        return self._filter[0], (old, inputs)

    def _output_at(self, t: float) -> Array:
        while len(self._history) > 2 and self._history[1][0] <= t:
            self._history.popleft()
        times = [seen[0] for seen in self._history]
        k = int(np.searchsorted(times, t))
        if k == 0 or k == len(times):
            return self._history[min(k, len(times) - 1)][1]
        (before, y0, _), (after, y1, inside) = self._history[k - 1], self._history[k]
        part = (t - before) / (after - before)
        if inside is None:
            return np.asarray(y0 + part * (y1 - y0))
        assert isinstance(self.sensor.filter, LowPass)
        return np.asarray((self.sensor.filter.step(after - before, part) @ np.vstack(inside))[0])
