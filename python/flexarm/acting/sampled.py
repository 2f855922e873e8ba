"""Controllers that look at the state at a rate, and linear ones, at a rate or continuous."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

import flexarm._core as _core

from .._check import Array, array, number
from ..parts.chain import Chain
from .control import (
    Controller,
    Feedback,
    Run,
    SampledLaw,
    braking_laws,
    force_columns,
    gain_of,
    limit_of,
    listed,
    measured_rows,
    padded,
)
from .drive import Torque, sample_times
from .motor import Motor, finite, positive
from .seen import Seen

_MOST = 1e8  # samples of a run

_Reader = Callable[[float, Array, Array, Array], Array]  # (t, q, v, a) -> y


def _sensor_reader(sensor: Any, arm: Chain, loads: Any, opened: list[Any]) -> _Reader:
    sampler = sensor.sampler(arm, loads=loads)
    if getattr(sensor, "filter", None) is not None and hasattr(sampler, "observe"):
        opened.append(sampler)
    return lambda t, q, v, a: np.atleast_1d(sampler.sample(t, q, v, a))


def _row_reader(entry: Any, arm: Chain, k: int) -> _Reader:
    by_q, by_v = measured_rows(arm, [entry], k)
    return lambda t, q, v, a: np.asarray(by_q @ q + by_v @ v)


class Asked:
    """A law as the core asks it for forces, once a sample of one run."""

    def __init__(
        self, law: Callable[[float, Array], Any], read: _Reader, columns: Array, limit: float, size: int
    ) -> None:
        self.law, self.read, self.columns, self.limit, self.size = law, read, columns, limit, size
        self.seen = Seen()

    def __call__(self, t: float, q: Array, v: Array, a: Array) -> Array:
        y = self.read(t, q, v, a)
        said = self.law(t, y)
        try:
            u = np.atleast_1d(np.asarray(said, dtype=float))
            said = u.tolist()
        except (TypeError, ValueError, OverflowError):
            u = np.full(1, np.nan)
        if u.shape != (self.columns.shape[1],) or not np.isfinite(u).all():
            raise ValueError(
                f"control at t = {t}: the law gave {said!r}; must be {self.columns.shape[1]} finite numbers"
            )
        self.seen.note(y, u)
        return padded(self.columns @ np.clip(u, -self.limit, self.limit), self.size)


class _Between:
    """Shows the arm to the filters of sensors between the samples of their law, `parts` times a sample; no force."""

    def __init__(self, samplers: list[Any], parts: int, arm: Chain, size: int) -> None:
        self.samplers, self.parts, self.nq, self.nv, self.none = samplers, parts, arm.nq, arm.nv, np.zeros(size)
        self.count = 0

    def __call__(self, t: float, q: Array, v: Array, a: Array) -> Array:
        if self.count % self.parts:  # else the law itself looks
            for sampler in self.samplers:
                sampler.observe(t, q[: self.nq], v[: self.nv], a[: self.nv])
        self.count += 1
        return self.none


class Sampled(Controller):
    """A law that is asked at a rate, in Python, and whose answer is held until the next.

    Args:
        law: a callable (t, y) -> u: time (s), what is measured (ny,), and the outputs (nu,) or one number.
        rate: samples a second (Hz).
        measure: what y is: entries ("joint", link), ("rate", link), ("strain", link, x, "K3"), ("charge", link, patch),
            ("patch_voltage", link, patch), or sensors, in order; None: the whole state [q; v].
        actuate: nu links (-1 is the last), (link, freedom), ("patch", link, patch), or columns (nv,) of generalised
            forces per unit of u.
        delay: from a sample to its force (s): what computing and the bus take.
        limit: of each |u|; None: the motor's.
        motor: turns u into torques; None: u are torques.
    """

    def __init__(
        self, law: Callable[[float, Array], Any], rate: float, measure: Sequence[Any] | None = None,
        actuate: Sequence[Any] = (-1,), *, delay: float = 0.0, limit: float | None = None, motor: Motor | None = None,
    ) -> None:  # fmt: skip
        if not callable(law):
            raise ValueError(f"law = {law!r}: must be a callable (t, y) -> u")
        self.law, self.rate, self.delay = law, positive("rate", rate), number("delay", delay)
        if not 0.0 <= self.delay < np.inf:
            raise ValueError(f"delay = {delay}: must be zero or positive, in seconds")
        self.measure = None if measure is None else listed("measure", measure)
        self.actuate = listed("actuate", actuate)
        self.motor, self.limit = motor, limit_of(limit, motor)

    def _reader(self, arm: Chain, loads: Any, opened: list[Any]) -> _Reader:
        """(t, q, v, a) -> y of one run; samplers with filters are noted in `opened`."""
        nq, nv = arm.nq, arm.nv  # behind them, q, v and a may have states of other controllers
        if self.measure is None:
            return lambda t, q, v, a: np.concatenate([q[:nq], v[:nv]])
        readers = [_sensor_reader(e, arm, loads, opened) if hasattr(e, "sampler") else _row_reader(e, arm, k)
                   for k, e in enumerate(self.measure)]  # fmt: skip
        return lambda t, q, v, a: np.concatenate([r(t, q[:nq], v[:nv], a[:nv]) for r in readers])

    def _law(self, arm: Chain, columns: Array, run: Run, opened: list[Any]) -> Any:
        """What the core asks for forces, once a sample."""
        read = self._reader(arm, run.loads, opened)
        return Asked(self.law, read, columns, self.limit, arm.nv + run.total)

    def _laws(self, arm: Chain, run: Run) -> tuple[list[Feedback], list[SampledLaw]]:
        units = np.array(force_columns(arm, self.actuate)).T
        span = float(run.times[-1] - run.times[0])
        if self.rate * span > _MOST:
            raise ValueError(
                f"rate = {self.rate}: asks for {self.rate * span:.3g} samples in {span} s; at most {_MOST:g}"
            )
        opened: list[Any] = []
        law = self._law(arm, gain_of(self.motor) * units, run, opened)
        start, period = float(run.times[0]), 1.0 / self.rate
        laws: list[SampledLaw] = [(start, period, self.delay, law)]
        gap = float(np.diff(run.times).max()) if len(run.times) > 1 else period
        parts = int(np.ceil(period / gap - 1e-6))
        if opened and parts > 1:  # filters see the arm as often as the result will show it
            laws.insert(0, (start, period / parts, 0.0, _Between(opened, parts, arm, arm.nv + run.total)))
        return braking_laws(arm, self.motor, units.T), laws


class _Samples:
    """A reference (ny,) of samples (t, r), linear in between."""

    def __init__(self, t: Any, r: Any, ny: int) -> None:
        self.t, self.r = sample_times(array("reference: t", t)), array("reference: r", r)
        if self.r.shape == self.t.shape:
            self.r = np.repeat(self.r[:, None], ny, axis=1)
        if self.r.shape != (self.t.size, ny):
            raise ValueError(f"reference: r has shape {self.r.shape}: must be {self.t.size} numbers, one for each of t")

    def __call__(self, t: float) -> Array:
        return np.array([np.interp(t, self.t, column) for column in self.r.T])

    def along(self, by_e: Array) -> Torque:
        """by_e r, as a law of time that is evaluated in C++."""
        return Torque(self.t, self.r @ by_e)


def _no_law(t: float, y: Array) -> float:
    return 0.0


class LinearController(Sampled):
    """A linear law with memory: PID, lead-lag, observers. Sampled, x+ = A x + B e, u = C x + D e; or continuous, with
    x' = A x + B e, then its states are integrated together with the arm. e = reference - y; it begins with x = 0.

    Args:
        A, B, C, D: as `rate` asks for, or a python-control or SciPy system, or a tuple (A, B, C, D), as `A` alone: a
            continuous one is discretised with `method` where there is a rate.
        rate: samples a second (Hz); None: continuous.
        measure: as of Sampled; sensors need a rate.
        actuate, limit, motor: as of Sampled. delay: needs a rate.
        reference: of y: a number, an array (ny,), samples (t, r) with straight lines between, or a callable t -> (ny,).
        method: of SciPy's cont2discrete: "bilinear" (Tustin), "zoh", ...

    It runs in C++ unless it reads sensors or a callable.
    """

    #: see PID
    pid: ClassVar[type[PID]]

    def __init__(
        self, A: Any, B: ArrayLike | None = None, C: ArrayLike | None = None, D: ArrayLike | None = None, *,
        rate: float | None = None, measure: Sequence[Any], actuate: Sequence[Any] = (-1,), reference: Any = 0.0,
        delay: float = 0.0, limit: float | None = None, motor: Motor | None = None, method: str = "bilinear",
    ) -> None:  # fmt: skip
        super().__init__(
            _no_law, 1.0 if rate is None else rate, measure, actuate, delay=delay, limit=limit, motor=motor
        )
        self.continuous = rate is None
        if self.continuous and delay:
            raise ValueError(f"delay = {delay}: needs a rate; a continuous law has none")
        if self.continuous and any(hasattr(e, "sampler") for e in measure):
            raise ValueError("measure: sensors are sampled; give a rate, or measure joints, rates and strains")
        self.reference = reference
        self.A, self.B, self.C, self.D = _matrices(A, B, C, D, None if rate is None else 1.0 / self.rate, method)
        self.memory = self.A.shape[0] if self.continuous else 0

    def _linear_rows(self, arm: Chain) -> tuple[Array, Array]:
        """y by q and by v, of the arm."""
        by_q, by_v = measured_rows(arm, self.measure or [])
        if len(by_q) != self.B.shape[1]:
            raise ValueError(f"measure: gives {len(by_q)} numbers; B has {self.B.shape[1]} columns")
        return by_q, by_v

    def _given(self) -> Any:
        """The reference: an array (ny,), or a callable t -> (ny,)."""
        ny, reference = self.B.shape[1], self.reference
        if is_samples(reference):
            return _Samples(reference[0], reference[1], ny)
        if callable(reference):
            return lambda t: np.broadcast_to(array(f"reference at t = {t}", reference(t)), (ny,))
        given = array("reference", reference)
        if given.shape not in ((), (ny,)):
            raise ValueError(f"reference has shape {given.shape}: must be one number, or {ny}, one for each of y")
        return np.broadcast_to(given, (ny,))

    def _check_outputs(self, count: int) -> None:
        if count != self.C.shape[0]:
            raise ValueError(f"actuate: names {count}; the controller has {self.C.shape[0]} outputs")

    def _law(self, arm: Chain, columns: Array, run: Run, opened: list[Any]) -> Any:
        self._check_outputs(columns.shape[1])
        extra = run.total
        rows = np.zeros((0, arm.nq)), np.zeros((0, arm.nv))
        sensed = any(hasattr(e, "sampler") for e in self.measure or [])
        if not sensed:
            by_q, by_v = self._linear_rows(arm)
            rows = np.pad(by_q, ((0, 0), (0, extra))), np.pad(by_v, ((0, 0), (0, extra)))
        matrices = (self.A, self.B, self.C, self.D, np.pad(columns, ((0, extra), (0, 0))))
        read = self._reader(arm, run.loads, opened) if sensed else None
        given = self._given()
        if isinstance(given, _Samples):
            given.along(np.ones(given.r.shape[1])).check_span("reference", run.times)
        law = (lambda t: given(t)) if callable(given) else given
        return _core.LinearLaw(*matrices, *rows, self.limit, law, read)

    def _laws(self, arm: Chain, run: Run) -> tuple[list[Feedback], list[SampledLaw]]:
        if not self.continuous:
            return super()._laws(arm, run)
        units = np.array(force_columns(arm, self.actuate)).T
        self._check_outputs(units.shape[1])
        by_q, by_v = self._linear_rows(arm)
        given, n = self._given(), self.A.shape[0]
        states = np.eye(arm.nv + run.total)[arm.nv + run.first :][:n]

        def law(column: Array, by_x: Array, by_e: Array, limit: float) -> Feedback:
            """by_x x + by_e (reference - y), as -(by_q q + by_v v) and an offset."""
            rates = padded(by_e @ by_v, arm.nv + run.total) - by_x @ states
            if isinstance(given, _Samples):
                along = given.along(by_e)
                along.check_span("reference", run.times)
                offset: Any = along.law
            else:
                offset = (lambda t: float(by_e @ given(t))) if callable(given) else Torque(float(by_e @ given)).law
            return column, by_e @ by_q, rates, offset, limit

        gain = gain_of(self.motor)
        outputs = [law(gain * u, c, d, self.limit) for u, c, d in zip(units.T, self.C, self.D, strict=True)]
        inside = [law(x, a, b, np.inf) for x, a, b in zip(states, self.A, self.B, strict=True)]
        return [*outputs, *inside, *braking_laws(arm, self.motor, units.T)], []


class PID(LinearController):
    """PID on a joint's angle: u = kp e + ki int e dt + kd de/dt, with e = reference - q. Sampled by Tustin's rule, or,
    without a rate, continuous.

    Args:
        kp, ki, kd: gains, per rad (m), per rad s and per rad/s; of a torque (N m, N), or of the motor's current or
            voltage.
        link: which joint, or (link, freedom).
        rate: samples a second (Hz); None: continuous.
        reference: of q (rad, m): a number, samples (t, r) with straight lines between, or a callable t -> r.
        filter_time: of the low pass ahead of the derivative (s); None: two samples.
        delay: from a sample to its force (s); needs a rate.
        limit: u is kept within -limit .. limit; None: the motor's.
        motor: turns u into a torque; None: u is the torque.
    """

    type = "pid"

    def __init__(
        self, kp: float, ki: float, kd: float, link: Any = -1, *, rate: float | None = None, reference: Any = 0.0,
        filter_time: float | None = None, delay: float = 0.0, limit: float | None = None, motor: Motor | None = None,
    ) -> None:  # fmt: skip
        link = tuple(link) if isinstance(link, list) else link  # (link, freedom) in a file
        self._given_as = {"kp": kp, "ki": ki, "kd": kd, "link": link, "rate": rate, "reference": reference,
                          "filter_time": filter_time, "delay": delay, "limit": limit, "motor": motor}  # fmt: skip
        if rate is None and filter_time is None:
            raise ValueError(
                "filter_time = None: a continuous PID needs the time constant of its derivative's low pass"
            )
        tf = 2.0 / positive("rate", rate) if filter_time is None else positive("filter_time", filter_time)
        # states: integral of e; low-passed e
        A = np.array([[0.0, 0.0], [0.0, -1.0 / tf]])
        B = np.array([[1.0], [1.0 / tf]])
        C = np.array([[finite("ki", ki), -finite("kd", kd) / tf]])
        D = np.array([[finite("kp", kp) + kd / tf]])
        super().__init__(
            (A, B, C, D), rate=rate, measure=[("joint", link)], actuate=[link], reference=reference, delay=delay,
            limit=limit, motor=motor,
        )  # fmt: skip

    def _arguments(self) -> dict[str, Any]:
        return self._given_as


LinearController.pid = PID


def is_samples(reference: Any) -> bool:
    """Whether a reference is samples (t, r), not numbers."""
    pair = isinstance(reference, (tuple, list)) and len(reference) == 2
    return pair and all(isinstance(x, (tuple, list, np.ndarray)) for x in reference)


def _matrices(A: Any, B: Any, C: Any, D: Any, dt: float | None, method: str) -> tuple[Array, Array, Array, Array]:
    """A, B, C, D sampled every dt, or, where that is None, continuous."""
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
    if continuous and dt is not None:
        from scipy.signal import cont2discrete  # slow to import

        a, b, c, d, _ = cont2discrete((a, b, c, d), dt, method=method)
    return a, b, c, d
