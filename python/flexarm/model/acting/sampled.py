"""Sampled controllers, and linear ones, sampled or continuous."""

from __future__ import annotations

import copy
import sys
from collections.abc import Callable, Sequence
from functools import reduce
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

import flexarm._core as _core
from flexarm._core import Feedback, Sampler

from ..._check import Array, array, for_each, increasing, not_negative, number, positive, unmasked
from ..parts.chain import Chain
from .control import (
    Controller,
    Run,
    braking_laws,
    force_columns,
    gain_of,
    limit_of,
    listed,
    measured_rows,
    padded,
)
from .drive import Motion, Torque
from .following import along, check_motion, plus, scaled
from .motor import Motor, reach_of
from .record import LawRecord

_MOST = 1e8  # most samples of a run

_Reader = Callable[[float, Array, Array, Array], Array]  # (t, q, v, a) -> y


def _sensor_reader(sensor: Any, arm: Chain, loads: Any, opened: list[Any]) -> _Reader:
    sampler = sensor.sampler(arm, loads=loads)
    if getattr(sensor, "filter", None) is not None and hasattr(sampler, "observe"):
        opened.append(sampler)
    return lambda t, q, v, a: np.atleast_1d(sampler.sample(t, q, v, a))


def _row_reader(entry: Any, arm: Chain, k: int) -> _Reader:
    by_q, by_v = measured_rows(arm, [entry], k)
    return lambda t, q, v, a: np.asarray(by_q @ q + by_v @ v)


def _entry(entry: Any) -> Any:
    """An entry of `measure` or `actuate`; lists from files become tuples."""
    if isinstance(entry, (list, tuple)) and entry and isinstance(entry[0], str):
        return tuple(tuple(x) if isinstance(x, list) else x for x in entry)
    return entry


def note(e: Exception, name: str, t: float) -> None:
    """Adds the law's name and the time to an exception of a user's law."""
    text = f"raised by the law of {name} at t = {t:.9g} s"
    if sys.version_info >= (3, 11):
        e.add_note(text)
    elif len(e.args) < 2:  # Python 3.10 has no notes
        e.args = (f"{e.args[0] if e.args else type(e).__name__} ({text})",)


def count_of(n: int) -> str:
    """"n finite numbers" in words."""
    return "one finite number" if n == 1 else f"{n} finite numbers"


class PythonLaw:
    """A Python law in one run: the core calls it for forces once a sample."""

    def __init__(
        self, law: Callable[[float, Array], Any], read: _Reader, columns: Array, limit: Any, size: int, name: str,
        senses: bool,
    ) -> None:  # fmt: skip
        self.law, self.read, self.columns, self.limit, self.size, self.name = law, read, columns, limit, size, name
        self.senses = senses  #: whether it reads sensors
        self.record = LawRecord()
        self.twice = False  #: whether a repeated call must return the same

    def __call__(self, t: float, q: Array, v: Array, a: Array) -> Array:
        y = self.read(t, q, v, a)
        try:
            said = self.law(t, y)
            again = self.law(t, y) if self.twice else said
        except Exception as e:
            note(e, self.name, t)
            raise
        if self.twice and not np.array_equal(said, again):
            raise ValueError(
                f"{self.name} at t = {t}: the law gave {said!r}, and {again!r} when it was asked again: it remembers, "
                "and a run has no derivatives through it. Give a LinearController, or a law of t and y alone"
            )
        try:
            u = np.atleast_1d(np.asarray(unmasked("u", said), dtype=float))
            said = said if said is None else u.tolist()
        except (TypeError, ValueError, OverflowError):
            u = np.full(1, np.nan)
        if u.shape != (self.columns.shape[1],) or not np.isfinite(u).all():
            raise ValueError(
                f"{self.name} at t = {t}: the law gave {said!r}; must be {count_of(self.columns.shape[1])}"
            )
        self.record.note(y, u)
        return padded(self.columns @ np.clip(u, -self.limit, self.limit), self.size)


class _FilterUpdates:
    """Updates the filters of sensors between the samples of their law, `parts` times a sample; no force."""

    def __init__(self, samplers: list[Any], parts: int, arm: Chain, size: int) -> None:
        self.samplers, self.parts, self.nq, self.nv, self.none = samplers, parts, arm.nq, arm.nv, np.zeros(size)
        self.count = 0

    def __call__(self, t: float, q: Array, v: Array, a: Array) -> Array:
        if self.count % self.parts:  # otherwise the law itself reads
            for sampler in self.samplers:
                sampler.observe(t, q[: self.nq], v[: self.nv], a[: self.nv])
        self.count += 1
        return self.none


class Sampled(Controller):
    """A Python law that is called at a rate; its output is held until the next sample.

    Args:
        law: a callable (t, y) -> u: time (s), measurements (ny,), and the outputs (nu,) or one number.
        rate: samples a second (Hz).
        measure: the measurements y: entries ("joint", link), ("rate", link), ("strain", link, x, "K3"), ("charge",
            link, patch),
            ("patch_voltage", link, patch), or sensors, in order; None: the whole state [q; v].
        actuate: nu links (-1 is the last), (link, freedom), ("patch", link, patch), or columns (nv,) of generalised
            forces per unit of u.
        delay: time from a sample to its force (s), of computing and the bus.
        limit: of each |u|, one number or nu of them; None: the motor's.
        motor: converts u to torques; None: u are torques.
    """

    def __init__(
        self, law: Callable[[float, Array], Any], rate: float, measure: Sequence[Any] | None = None,
        actuate: Sequence[Any] = (-1,), *, delay: float = 0.0, limit: ArrayLike | None = None,
        motor: Motor | None = None,
    ) -> None:  # fmt: skip
        if not callable(law):
            raise ValueError(f"law = {law!r}: must be a callable (t, y) -> u")
        self.law, self.rate, self.delay = law, positive("rate", rate), not_negative("delay", delay, "s")
        self.measure = None if measure is None else [_entry(e) for e in listed("measure", measure)]
        self.actuate = [_entry(e) for e in listed("actuate", actuate)]
        self.motor, self.limit = motor, limit_of(limit, motor, len(self.actuate))

    def _sensed(self) -> bool:
        return any(hasattr(e, "sampler") for e in self.measure or ())

    def check_smooth(self, arm: Chain, name: str) -> None:
        for k, sensor in enumerate(self.measure or ()):
            if hasattr(sensor, "sampler") and (steps := sensor.steps(arm)).any():
                raise ValueError(
                    f"{name}.measure[{k}]: {sensor.type} reads in steps of {steps.max():.3g}, through which a run has "
                    "no derivatives: give it none (resolution or pulses = None)"
                )

    def _smooth(self) -> Sampled:
        made = copy.copy(self)
        made.measure = self.measure and [e._smooth() if hasattr(e, "sampler") else e for e in self.measure]
        return made

    def _reader(self, arm: Chain, loads: Any, opened: list[Any]) -> _Reader:
        """The function (t, q, v, a) -> y of one run; samplers with filters are added to `opened`."""
        nq, nv = arm.nq, arm.nv  # q, v and a may end with states of other controllers
        if self.measure is None:
            return lambda t, q, v, a: np.concatenate([q[:nq], v[:nv]])
        readers = [_sensor_reader(e, arm, loads, opened) if hasattr(e, "sampler") else _row_reader(e, arm, k)
                   for k, e in enumerate(self.measure)]  # fmt: skip
        return lambda t, q, v, a: np.concatenate([r(t, q[:nq], v[:nv], a[:nv]) for r in readers])

    def _law(self, arm: Chain, columns: Array, run: Run, opened: list[Any]) -> Any:
        """The callable that the core calls for forces, once a sample."""
        read = self._reader(arm, run.loads, opened)
        return PythonLaw(
            self.law, read, columns, self.limit, arm.nv + run.total, f"control[{run.number}]", self._sensed()
        )

    def _lines(self, arm: Chain) -> tuple[Array, Array, Array, Array] | None:
        """The readings as linear functions of the state, by q (ny, nq) and by v (ny, nv), their offsets and steps (ny);
        None if one is not that."""
        parts = []
        for k, entry in enumerate([None] if self.measure is None else self.measure):
            if hasattr(entry, "sampler"):
                parts.append(entry.line(arm) if hasattr(entry, "line") else None)
            else:
                by_q, by_v = measured_rows(arm, entry and [entry], k)
                parts.append((by_q, by_v, np.zeros(len(by_q)), np.zeros(len(by_q))))
        if any(part is None for part in parts):
            return None
        by_q, by_v, offset, step = (np.concatenate(x) for x in zip(*parts, strict=True))
        return by_q, by_v, offset, step

    def _laws(self, arm: Chain, run: Run) -> tuple[list[Feedback], list[Sampler]]:
        units = np.array(force_columns(arm, self.actuate)).T
        span = float(run.times[-1] - run.times[0])
        if self.rate * span > _MOST:
            raise ValueError(
                f"rate = {self.rate}: asks for {self.rate * span:.3g} samples in {span} s; at most {_MOST:g}"
            )
        opened: list[Any] = []
        law = self._law(arm, gain_of(self.motor) * units, run, opened)
        start, period = float(run.times[0]), 1.0 / self.rate
        laws = [Sampler(start, period, self.delay, law)]
        gap = float(np.diff(run.times).max()) if len(run.times) > 1 else period
        parts = int(np.ceil(period / gap - 1e-6))
        if opened and parts > 1:  # filters are updated as often as in `Sensor.read`
            laws.insert(0, Sampler(start, period / parts, 0.0, _FilterUpdates(opened, parts, arm, arm.nv + run.total)))
        return braking_laws(arm, self.motor, units.T), laws


def columns_of(t: Any, r: Any, ny: int) -> list[Any]:
    """Samples (t, r) of a reference, linear in between, as ny laws of time."""
    times, values = increasing("reference: t", t), array("reference: r", r)
    if values.shape in (times.shape, (times.size, 1)):
        values = np.repeat(values.reshape(-1, 1), ny, axis=1)
    if values.shape != (times.size, ny):
        raise ValueError(f"reference: r has shape {values.shape}: must be {times.size} numbers, one for each of t")
    return [Torque(times, column) for column in values.T]


def together(laws: list[Torque]) -> Any:
    """Laws of time as the reference of a linear law: as they are, or a callable if one of them is."""
    if all(isinstance(law.law, _core.PiecewisePolynomial) for law in laws):
        return laws
    return lambda t: np.array([law(t) for law in laws])


def _followed(motion: Motion, arm: Chain, measure: Any) -> list[Torque]:
    """A motion as the reference of measurements: q of joints, v of rates."""
    kinds = [e[0] if isinstance(e, tuple) and len(e) == 2 else e for e in measure or ["the whole state"]]
    for k, kind in enumerate(kinds):
        if kind not in ("joint", "rate") or len(measured_rows(arm, [measure[k]])[0]) > 1:
            raise ValueError(
                f'reference: a Motion is for ("joint", link) and ("rate", link) of one freedom; measure[{k}] is '
                f"{measure[k] if measure else kind!r}; give a callable t -> ({len(kinds)},)"
            )
    return [along(motion, float(kind == "joint"), float(kind == "rate")) for kind in kinds]


def _no_law(t: float, y: Array) -> float:
    return 0.0


class LinearController(Sampled):
    """A linear law with memory: PID, lead-lag, observers. Sampled: w = u0 + C x + D e and x+ = A x + B e. Continuous:
    x' = A x + B e, integrated together with the arm. e = reference - y; x starts at 0; u is w within the limit.

    Args:
        A, B, C, D: matrices, discrete if there is a `rate`; or as `A` alone a python-control or SciPy system, or a
            tuple (A, B, C, D), which is discretised with `method` if it is continuous and there is a rate. An empty A,
            [], is a law without memory, u = u0 + D e.
        rate: samples a second (Hz); None: continuous.
        measure: as of Sampled, None: the whole state [q; v]; sensors need a rate.
        actuate, limit, motor: as of Sampled. delay: needs a rate.
        reference: of y: a number, an array (ny,), samples (t, r), linear in between, a callable t -> (ny,), or a
            Motion, which gives q to ("joint", link) and v to ("rate", link).
        method: of SciPy's cont2discrete: "bilinear" (Tustin), "zoh", ...
        u0: constant part of u (nu,), such as the torque against gravity; None: zero.
        anti_windup: W (nx, nu), given like A and B, for x+ (or x') = A x + B e + W (u - w): effect of a limit on the
            states (Astrom & Hagglund, Advanced PID Control, 2006, ch. 3.5; Astrom & Wittenmark, Computer-Controlled
            Systems, 1997, ch. 9.4). For an observer, W is the B of its model, which then uses the applied force; for an
            integral see PID. None: zero, the states wind up at a limit. The `torque_limit` of driven joints counts as a
            limit of u here.

    It runs in C++ unless it follows a callable, or reads a sensor with a filter, a rate, a delay, noise or a range, an
    accelerometer, a camera or a force/torque sensor.
    """

    type = "linear"
    start: Array = np.zeros((0, 0))  #: the first sample finds x at start e; empty: at 0
    _given_as: dict[str, Any] | None = None  #: the arguments of a subclass that has others
    #: see PID, PPF and IRC
    pid: ClassVar[Any]
    ppf: ClassVar[Any]
    irc: ClassVar[Any]

    def __init__(
        self, A: Any, B: ArrayLike | None = None, C: ArrayLike | None = None, D: ArrayLike | None = None, *,
        rate: float | None = None, measure: Sequence[Any] | None = None, actuate: Sequence[Any] = (-1,),
        reference: Any = 0.0, delay: float = 0.0, limit: ArrayLike | None = None, motor: Motor | None = None,
        method: str = "bilinear", u0: ArrayLike | None = None, anti_windup: ArrayLike | None = None,
    ) -> None:  # fmt: skip
        super().__init__(
            _no_law, 1.0 if rate is None else rate, measure, actuate, delay=delay, limit=limit, motor=motor
        )
        self.continuous = rate is None
        if self.continuous and delay:
            raise ValueError(f"delay = {delay}: needs a rate; a continuous law has none")
        if self.continuous and any(hasattr(e, "sampler") for e in measure or []):
            raise ValueError("measure: sensors are sampled; give a rate, or measure joints, rates and strains")
        self.reference, self.method = reference, method
        self.A, self.B, self.C, self.D, self.anti_windup = _matrices(
            A, B, C, D, None if rate is None else 1.0 / self.rate, method, anti_windup
        )
        nu = self.C.shape[0]
        self.u0 = np.zeros(nu) if u0 is None else array("u0", np.atleast_1d(array("u0", u0)), (nu,))
        self.memory = self.A.shape[0] if self.continuous else 0

    def _arguments(self) -> dict[str, Any]:
        if self._given_as is not None:
            return self._given_as
        given = super()._arguments()
        return {**given, "rate": None if self.continuous else self.rate} if "rate" in given else given

    def _takes(self) -> Array:
        """y by the readings."""
        return np.eye(self.B.shape[1])

    def by_readings(self, count: int) -> tuple[Array, Array, Array, Array]:
        """A, B, C, D by so many readings."""
        y = self._takes()
        if count != y.shape[1]:
            raise ValueError(f"measure: gives {count} numbers; B has {y.shape[1]} columns")
        return self.A, self.B @ y, self.C, self.D @ y

    def _columns_of_run(self, columns: Array, arm: Chain, run: Run) -> Array:
        """Forces on the arm and on the states of controllers by u, from those on the arm."""
        return np.pad(columns, ((0, run.total), (0, 0)))

    def _given(self, arm: Chain, run: Run) -> Any:
        """The reference: an array (ny,), a list of ny laws of time, or a callable t -> (ny,)."""
        ny, reference, times = self.B.shape[1], self.reference, run.times
        if isinstance(reference, Motion):
            check_motion("reference", reference, times)
            return together(_followed(reference, arm, self.measure))
        if is_samples(reference):
            laws = columns_of(reference[0], reference[1], ny)
            laws[0].check_span("reference", times)
            return laws
        if callable(reference):
            return lambda t: np.broadcast_to(array(f"reference at t = {t}", reference(t)), (ny,))
        return for_each("reference", reference, ny, "of y")

    def _check_outputs(self, count: int) -> None:
        if count != self.C.shape[0]:
            raise ValueError(f"actuate: names {count}; the controller has {self.C.shape[0]} outputs")

    def _law(self, arm: Chain, columns: Array, run: Run, opened: list[Any]) -> Any:
        self._check_outputs(columns.shape[1])
        lines = self._lines(arm)
        read = None if lines else self._reader(arm, run.loads, opened)
        by_q, by_v, offset, step = np.zeros((0, arm.nq)), np.zeros((0, arm.nv)), np.zeros(0), np.zeros(0)
        if lines:
            self.by_readings(len(lines[0]))
            by_q, by_v, offset, step = (self._takes() @ x for x in lines)
        by_q, by_v = (np.pad(x, ((0, 0), (0, run.total))) for x in (by_q, by_v))
        given = self._given(arm, run)
        law = [one.law for one in given] if isinstance(given, list) else given
        limit, reach = np.broadcast_to(self.limit, columns.shape[1]), reach_of(arm, columns, self.limit)
        return _core.LinearLaw(
            self.A, self.B, self.C, self.D, self._columns_of_run(columns, arm, run), by_q, by_v, limit, law, read,
            self.u0, self.anti_windup, reach, offset, step, self.start, float(run.times[0]),
        )  # fmt: skip

    def _laws(self, arm: Chain, run: Run) -> tuple[list[Feedback], list[Sampler]]:
        if not self.continuous:
            return super()._laws(arm, run)
        units = np.array(force_columns(arm, self.actuate)).T
        self._check_outputs(units.shape[1])
        by_q, by_v = measured_rows(arm, self.measure)
        self.by_readings(len(by_q))
        reference, n = self._given(arm, run), self.A.shape[0]
        states = np.eye(arm.nv + run.total)[arm.nv + run.first :][:n]

        def offset(by_e: Array, constant: float) -> Any:
            if isinstance(reference, list):
                parts = [scaled(law, float(c)) for law, c in zip(reference, by_e, strict=True)]
                return reduce(plus, parts, Torque(constant)).law
            return (lambda t: constant + float(by_e @ reference(t))) if callable(reference) else Torque(
                constant + float(by_e @ reference)
            ).law  # fmt: skip

        def law(column: Array, by_x: Array, by_e: Array, constant: float, limit: float) -> Feedback:
            """The law constant + by_x x + by_e (reference - y), as -(by_q q + by_v v) and an offset."""
            rates = padded(by_e @ by_v, arm.nv + run.total) - by_x @ states
            return Feedback(column, by_e @ by_q, rates, offset(by_e, float(constant)), limit)

        # x' = (A - W C) x + (B - W D) e - W u0 + W u, with u within its limit and its motor's
        size, gain = arm.nv + run.total, gain_of(self.motor)
        reach, limit = reach_of(arm, gain * units, self.limit), np.broadcast_to(self.limit, units.shape[1])
        W = np.where(np.isfinite(reach), self.anti_windup, 0.0)
        A, B, x0 = self.A - W @ self.C, self.B - W @ self.D, -W @ self.u0
        outputs = []
        for i, given in enumerate(zip(self.C, self.D, self.u0, strict=True)):
            force, led = padded(gain * units[:, i], size), W[:, i] @ states
            same = reach[i] == limit[i] or not led.any()
            outputs += [law(force + same * led, *given, float(limit[i]))]
            outputs += [] if same else [law(led, *given, float(reach[i]))]
        inside = [law(x, a, b, constant, np.inf) for x, a, b, constant in zip(states, A, B, x0, strict=True)]
        return [*outputs, *inside, *braking_laws(arm, self.motor, units.T)], []


def as_floats(rate: Any, delay: Any, limit: Any) -> tuple[float | None, float, float | None]:
    """The arguments of a law as floats, so that integers can vary too."""
    rate = None if rate is None else positive("rate", rate)
    return rate, number("delay", delay), None if limit is None else positive("limit", limit)


def is_samples(reference: Any) -> bool:
    """Whether a reference is samples (t, r), not numbers: a pair of rows, or an array of two."""
    if isinstance(reference, np.ndarray):
        return reference.ndim == 2 and len(reference) == 2
    pair = isinstance(reference, (tuple, list)) and len(reference) == 2
    return pair and all(isinstance(x, (tuple, list, np.ndarray)) for x in reference)


def _matrices(
    A: Any, B: Any, C: Any, D: Any, dt: float | None, method: str, windup: Any
) -> tuple[Array, Array, Array, Array, Array]:
    """A, B, C, D and the anti-windup matrix, sampled every dt, or continuous if dt is None."""
    if (isinstance(A, np.ndarray) and A.size == 0) or (isinstance(A, list) and A in ([], [[]])):
        d = np.atleast_2d(array("D", D))  # D alone, a law without memory
        A, B, C, D = np.zeros((0, 0)), np.zeros((0, d.shape[1])), np.zeros((d.shape[0], 0)), d
    continuous = B is None
    if continuous:
        if isinstance(A, tuple):
            if len(A) != 4:
                raise ValueError(f"A: a tuple of {len(A)}; must be (A, B, C, D)")
            A, B, C, D = A
        elif all(hasattr(A, name) for name in "ABCD"):
            given = getattr(A, "dt", None)
            if given not in (None, 0, False) and (dt is None or abs(float(given) - dt) > 1e-9 * dt):
                raise ValueError(f"A: a system sampled every {given} s; rate asks for {dt or 'none, continuous,'} s")
            continuous = given in (None, 0, False)
            A, B, C, D = A.A, A.B, A.C, A.D
        else:
            raise ValueError(f"A = {A!r}: must be a matrix with B, C, D, or a state-space system")
    a, b, c, d = (np.atleast_2d(array(n, m)) for n, m in zip("ABCD", (A, B, C, D), strict=True))
    n = a.shape[0]
    if a.shape != (n, n) or b.shape[0] != n or c.shape[1] != n or d.shape != (c.shape[0], b.shape[1]):
        raise ValueError(f"A {a.shape}, B {b.shape}, C {c.shape}, D {d.shape}: do not fit together")
    size = (n, c.shape[0])
    w = np.zeros(size) if windup is None or n == 0 else array("anti_windup", windup)
    if w.shape != size:
        raise ValueError(f"anti_windup has shape {w.shape}: must be {size}, states by outputs")
    if continuous and dt is not None and n and method in ("bilinear", "tustin", "zoh"):
        return _core.sampled(a, b, c, d, w, dt, method == "zoh")
    if continuous and dt is not None and n:
        from scipy.signal import cont2discrete  # slow to import

        ny = b.shape[1]
        both = (a, np.hstack([b, w]), c, np.hstack([d, np.zeros((c.shape[0], w.shape[1]))]))
        a, bw, c, d, _ = cont2discrete(both, dt, method=method)
        b, w, d = bw[:, :ny], bw[:, ny:], d[:, :ny]
    return a, b, c, d, w
