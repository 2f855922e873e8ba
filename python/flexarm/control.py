"""Controllers: what turns measurements into forces of joints and voltages (paper Sec. 5.3, Eq. 97).

Continuous ones are solved together with the arm's equations, in C++, by every integrator. Sampled ones look at the
state at a rate and hold what they answer until the next sample (zero-order hold).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from . import _core
from ._check import Array, array, number
from .drive import Torque
from .motor import Motor, positive
from .patch import column_of

if TYPE_CHECKING:
    from .arm import Arm

#: (column, by_q, by_v, reference, limit) and (first, period, delay, by_acceleration, law): see flexarm/control.hpp
_Feedback = tuple[Array, Array, Array, Any, float]
_Sampler = tuple[float, float, float, bool, Any]


def _limit(value: Any) -> float:
    return np.inf if value is None else positive("limit", value)


class Controller:
    """What all controllers share: `simulate(control=...)` takes one, or a list of them."""

    def _laws(self, arm: Arm, times: Array) -> tuple[list[_Feedback], list[_Sampler]]:
        raise NotImplementedError


class _JointLaw(Controller):
    """u = k_p (r - q) - k_v dq/dt - k_s K at one freedom of a joint."""

    def __init__(self, kp: float, kv: float, link: int, freedom: int, reference: Any, limit: Any, motor: Motor | None):
        self.kp, self.kv = number("kp", kp), number("kv", kv)
        self.link, self.freedom = link, freedom
        if not isinstance(reference, Torque) and (callable(reference) or np.ndim(reference) == 0):
            reference = Torque(reference)  # a law of time like a torque's: samples, a callable, or a number
        elif not isinstance(reference, Torque):
            try:
                t, r = reference
            except (TypeError, ValueError):
                raise ValueError(
                    f"reference = {reference!r}: must be a number, samples (t, r), or a callable t -> r"
                ) from None
            reference = Torque(t, r)
        self.reference, self.motor = reference, motor
        self.limit = _limit(limit)
        if motor is not None and not isinstance(motor, Motor):
            raise ValueError(f"motor = {motor!r}: must be a Motor or None")
        if motor is not None and motor.limit is not None:
            self.limit = min(self.limit, motor.limit)

    def _strain(self, arm: Arm) -> Array:
        return np.zeros(arm.nq)

    def _laws(self, arm: Arm, times: Array) -> tuple[list[_Feedback], list[_Sampler]]:
        i = arm.joint_rates((self.link, self.freedom), "control: link")[0]
        at = arm.coordinate_of(i)
        if at < 0:
            raise ValueError(
                f"control of '{arm.coordinates[i]}': a ball has no angle to control; use three rotations (Axes)"
            )
        self.reference.check_span("reference", times)
        law = self.reference.law
        scaled = _scaled(law, self.kp)
        column, by_q, by_v = np.zeros(arm.nv), self._strain(arm), np.zeros(arm.nv)
        column[i] = 1.0 if self.motor is None else self.motor.gain
        by_q[at] += self.kp
        by_v[i] = self.kv
        out = [(column, by_q, by_v, scaled, self.limit)]
        if self.motor is not None and self.motor.braking > 0.0:
            unit = np.eye(arm.nv)[i]
            out.append((unit, np.zeros(arm.nq), self.motor.braking * unit, None, np.inf))
        return out, []


def _scaled(law: Any, factor: float) -> Any:
    if isinstance(law, _core.PiecewisePolynomial):
        return _core.PiecewisePolynomial(law.breaks, factor * law.coefficients)
    return lambda t: factor * float(law(t))


class PD(_JointLaw):
    """u = k_p (reference - q) - k_v dq/dt of one joint, continuous.

    Args:
        kp, kv: gains, per rad (m) and per rad/s (m/s); of a torque (N m, N), or of the motor's current or voltage.
        link, freedom: which joint, and which of its freedoms.
        reference: of q (rad, m): a number, samples (t, r) with straight lines between, or a callable t -> r.
        limit: u is kept within -limit .. limit; None: the motor's.
        motor: turns u into a torque; None: u is the torque.
    """

    def __init__(
        self, kp: float, kv: float, link: int = 0, freedom: int = 0, *, reference: Any = 0.0,
        limit: float | None = None, motor: Motor | None = None,
    ) -> None:  # fmt: skip
        super().__init__(kp, kv, link, freedom, reference, limit, motor)


class StrainFeedback(_JointLaw):
    """Eq. 97: u = k_p (reference - q) - k_v dq/dt - k_s K, with K a beam's curvature where a strain gauge sits.

    Args:
        kp, kv, link, freedom, reference, limit, motor: as of PD.
        ks: gain per 1/m.
        x: where the gauge is on the beam (m).
        strain: which strain, as `Arm.strain` orders them: "K1", "K2", "K3", "phi12" or "phi13".
        beam: the link whose beam bears the gauge; None: the controlled joint's own.
    """

    def __init__(
        self, kp: float, kv: float, ks: float, link: int = 0, freedom: int = 0, *, x: float = 0.0,
        strain: str = "K3", beam: int | None = None, reference: Any = 0.0, limit: float | None = None,
        motor: Motor | None = None,
    ) -> None:  # fmt: skip
        super().__init__(kp, kv, link, freedom, reference, limit, motor)
        self.ks, self.x, self.strain, self.beam = number("ks", ks), number("x", x), strain, beam

    def _strain(self, arm: Arm) -> Array:
        beam = self.link if self.beam is None else self.beam
        row: Array = self.ks * _rows(arm, [("strain", beam, self.x, self.strain)])[0][0]
        return row


class StateFeedback(Controller):
    """u = u0 - K [q - q0; v - v0], continuous, with K from a design on `Arm.linearize` (LQR, pole placement).

    Args:
        K: gains (nu, 2 nv): by all coordinates, then by all rates, in the order of LinearModel.states of a model that
            locks nothing. For arms without balls.
        actuate: nu links, (link, freedom), ("patch", link, patch), or columns (nv,) of generalised forces per unit
            of u.
        q0, v0, u0: the state about which, and the forces there; None: zero.
        limit: of each |u|; None: none.
    """

    def __init__(
        self, K: ArrayLike, actuate: Sequence[Any] = (0,), *, q0: ArrayLike | None = None, v0: ArrayLike | None = None,
        u0: ArrayLike | None = None, limit: float | None = None,
    ) -> None:  # fmt: skip
        self.K, self.actuate = np.atleast_2d(array("K", K)), list(actuate)
        self.q0, self.v0, self.u0, self.limit = q0, v0, u0, _limit(limit)

    def _laws(self, arm: Arm, times: Array) -> tuple[list[_Feedback], list[_Sampler]]:
        if arm.nq != arm.nv:
            raise ValueError(
                "StateFeedback: is for arms without balls, whose coordinates are not those of a linear model"
            )
        columns = _columns(arm, self.actuate)
        K = array("K", self.K, (len(columns), 2 * arm.nv))
        q0 = np.zeros(arm.nq) if self.q0 is None else array("q0", self.q0, (arm.nq,))
        v0 = np.zeros(arm.nv) if self.v0 is None else array("v0", self.v0, (arm.nv,))
        u0 = np.zeros(len(columns)) if self.u0 is None else array("u0", self.u0, (len(columns),))
        offset = u0 + K @ np.concatenate([q0, v0])
        laws = [
            (c, k[: arm.nq], k[arm.nq :], Torque(float(u)).law, self.limit)
            for c, k, u in zip(columns, K, offset, strict=True)
        ]
        return laws, []


def _columns(arm: Arm, actuate: Sequence[Any]) -> list[Array]:
    """A column of generalised forces (nv,) for each entry of `actuate`."""
    out = []
    for k, entry in enumerate(actuate):
        if isinstance(entry, (np.ndarray, list)):
            out.append(array(f"actuate[{k}]", entry, (arm.nv,)))
            continue
        if isinstance(entry, tuple) and entry and entry[0] == "patch":
            if len(entry) != 3:
                raise ValueError(f'actuate[{k}] = {entry!r}: must be ("patch", link, patch)')
            out.append(arm.patch_matrix[:, column_of(arm, arm._link(entry[1], f"actuate[{k}]: link"), entry[2])])
            continue
        out.append(np.eye(arm.nv)[arm.joint_rate(entry, f"actuate[{k}]: link")])
    return out


def _rows(arm: Arm, measure: Sequence[Any], first: int = 0) -> tuple[Array, Array]:
    """by_q (ny, nq) and by_v (ny, nv) of measurements that are linear in the state: "joint", "rate", "strain"."""
    from .linear import STRAIN_NAMES

    by_q, by_v = [], []
    for k, entry in enumerate(measure, first):
        field = f"measure[{k}]"
        kind = entry[0] if isinstance(entry, tuple) and entry else entry
        if kind in ("joint", "rate") and len(entry) == 2:
            for i in arm.joint_rates(entry[1], f"{field}: link"):
                at = arm.coordinate_of(i)
                if kind == "joint" and at < 0:
                    raise ValueError(f"{field} = {entry!r}: a ball has no angle")
                by_q.append(np.eye(arm.nq)[at] if kind == "joint" else np.zeros(arm.nq))
                by_v.append(np.eye(arm.nv)[i] if kind == "rate" else np.zeros(arm.nv))
        elif kind == "strain" and len(entry) == 4:
            if entry[3] not in STRAIN_NAMES:
                raise ValueError(f"{field} = {entry!r}: the strain must be one of {', '.join(STRAIN_NAMES)}")
            rows = arm.strain(np.eye(arm.nq), entry[1], number(f"{field}: x", entry[2])) - arm.strain(
                np.zeros(arm.nq), entry[1], entry[2]
            )
            by_q.append(rows[:, STRAIN_NAMES.index(entry[3])])
            by_v.append(np.zeros(arm.nv))
        elif kind in ("charge", "patch_voltage") and len(entry) == 3:
            by_q.append(getattr(arm, kind)(np.eye(arm.nq), entry[1], entry[2]))
            by_v.append(np.zeros(arm.nv))
        else:
            raise ValueError(
                f'{field} = {entry!r}: must be ("joint", link), ("rate", link), ("strain", link, x, "K3"), '
                '("charge", link, patch), ("patch_voltage", link, patch), or a sensor'
            )
    return np.array(by_q).reshape(-1, arm.nq), np.array(by_v).reshape(-1, arm.nv)


_Reader = Callable[[float, Array, Array, Array], Array]  # (t, q, v, a) -> y


def _sensor_reader(sensor: Any, arm: Arm) -> _Reader:
    sampler = sensor.sampler(arm)
    return lambda t, q, v, a: np.atleast_1d(sampler.sample(t, q, v, a))


def _row_reader(entry: Any, arm: Arm, k: int) -> _Reader:
    by_q, by_v = _rows(arm, [entry], k)
    return lambda t, q, v, a: np.asarray(by_q @ q + by_v @ v)


class Sampled(Controller):
    """A law that is asked at a rate, in Python, and whose answer is held until the next.

    Args:
        law: a callable (t, y) -> u: time (s), what is measured (ny,), and the outputs (nu,) or one number.
        rate: samples a second (Hz).
        measure: what y is: entries ("joint", link), ("rate", link), ("strain", link, x, "K3"), ("charge", link, patch),
            ("patch_voltage", link, patch), or sensors, in order; None: the whole state [q; v].
        actuate: nu links, (link, freedom), ("patch", link, patch), or columns (nv,) of generalised forces per unit
            of u.
        delay: from a sample to its force (s): what computing and the bus take.
        limit: of each |u|; None: the motor's.
        motor: turns u into torques; None: u are torques.
    """

    def __init__(
        self, law: Callable[[float, Array], Any], rate: float, measure: Sequence[Any] | None = None,
        actuate: Sequence[Any] = (0,), *, delay: float = 0.0, limit: float | None = None, motor: Motor | None = None,
    ) -> None:  # fmt: skip
        if not callable(law):
            raise ValueError(f"law = {law!r}: must be a callable (t, y) -> u")
        self.law, self.rate, self.delay = law, positive("rate", rate), number("delay", delay)
        if not 0.0 <= self.delay < np.inf:
            raise ValueError(f"delay = {delay}: must be zero or positive, in seconds")
        self.measure, self.actuate = None if measure is None else list(measure), list(actuate)
        self.motor, self.limit = motor, _limit(limit)
        if motor is not None and motor.limit is not None:
            self.limit = min(self.limit, motor.limit)

    def _reader(self, arm: Arm) -> tuple[_Reader, bool]:
        """(t, q, v, a) -> y of one run, and whether it asks for a."""
        if self.measure is None:
            return lambda t, q, v, a: np.concatenate([q, v]), False
        readers = [_sensor_reader(e, arm) if hasattr(e, "sampler") else _row_reader(e, arm, k)
                   for k, e in enumerate(self.measure)]  # fmt: skip
        by_acceleration = any(getattr(e, "needs_acceleration", False) for e in self.measure)
        return lambda t, q, v, a: np.concatenate([r(t, q, v, a) for r in readers]), by_acceleration

    def _law(self, arm: Arm, columns: Array) -> tuple[Any, bool]:
        """What the core asks for forces, once a sample, and whether it wants accelerations."""
        read, by_acceleration = self._reader(arm)
        law, limit = self.law, self.limit

        def force(t: float, q: Array, v: Array, a: Array) -> Array:
            u = np.atleast_1d(np.asarray(law(t, read(t, q, v, a)), dtype=float))
            if u.shape != (columns.shape[1],) or not np.isfinite(u).all():
                raise ValueError(
                    f"control at t = {t}: the law gave {u.tolist()}; must be {columns.shape[1]} finite numbers"
                )
            return np.asarray(columns @ np.clip(u, -limit, limit))

        return force, by_acceleration

    def _laws(self, arm: Arm, times: Array) -> tuple[list[_Feedback], list[_Sampler]]:
        units = np.array(_columns(arm, self.actuate)).T
        law, by_acceleration = self._law(arm, units if self.motor is None else self.motor.gain * units)
        braking: list[_Feedback] = []
        if self.motor is not None and self.motor.braking > 0.0:
            braking = [(c, np.zeros(arm.nq), self.motor.braking * c, None, np.inf) for c in units.T]
        return braking, [(float(times[0]), 1.0 / self.rate, self.delay, by_acceleration, law)]


def _no_law(t: float, y: Array) -> float:
    return 0.0


class LinearController(Sampled):
    """A linear law with memory, x+ = A x + B e, u = C x + D e, sampled at a rate: PID, lead-lag, observers.

    Args:
        A, B, C, D: of discrete time, or a continuous python-control or SciPy system as `A` alone, which is discretised
            with `method`.
        rate: samples a second (Hz).
        measure, actuate, delay, limit, motor: as of Sampled.
        reference: of y (a number, an array (ny,), or a callable t -> (ny,)): e = reference - y.
        method: of SciPy's cont2discrete, for continuous systems: "bilinear" (Tustin), "zoh", ...

    It begins each run with x = 0, and runs in C++ unless it reads sensors or a callable.
    """

    def __init__(
        self, A: Any, B: ArrayLike | None = None, C: ArrayLike | None = None, D: ArrayLike | None = None, *,
        rate: float, measure: Sequence[Any], actuate: Sequence[Any] = (0,), reference: Any = 0.0, delay: float = 0.0,
        limit: float | None = None, motor: Motor | None = None, method: str = "bilinear",
    ) -> None:  # fmt: skip
        super().__init__(_no_law, rate, measure, actuate, delay=delay, limit=limit, motor=motor)
        self.reference = reference
        self.A, self.B, self.C, self.D = _discrete(A, B, C, D, 1.0 / self.rate, method)

    @staticmethod
    def pid(
        kp: float, ki: float, kd: float, link: int = 0, *, rate: float, reference: Any = 0.0,
        filter_time: float | None = None, delay: float = 0.0, limit: float | None = None, motor: Motor | None = None,
    ) -> LinearController:  # fmt: skip
        """PID on a joint's angle: u = kp e + ki int e dt + kd de/dt, with e = reference - q, integral and derivative by
        Tustin's rule, the derivative behind a low pass of `filter_time` (s; None: two samples)."""
        h = 1.0 / positive("rate", rate)
        tf = 2.0 * h if filter_time is None else positive("filter_time", filter_time)
        # s-domain: states: integral of e; low-passed e
        A = np.array([[0.0, 0.0], [0.0, -1.0 / tf]])
        B = np.array([[1.0], [1.0 / tf]])
        C = np.array([[number("ki", ki), -number("kd", kd) / tf]])
        D = np.array([[number("kp", kp) + kd / tf]])
        return LinearController(
            (A, B, C, D), rate=rate, measure=[("joint", link)], actuate=[link], reference=reference, delay=delay,
            limit=limit, motor=motor,
        )  # fmt: skip

    def _law(self, arm: Arm, columns: Array) -> tuple[Any, bool]:
        ny, nu = self.B.shape[1], self.C.shape[0]
        if columns.shape[1] != nu:
            raise ValueError(f"actuate: names {columns.shape[1]}; the controller has {nu} outputs")
        read, by_acceleration = self._reader(arm)
        rows = np.zeros((0, arm.nq)), np.zeros((0, arm.nv))
        if self.measure is not None and not any(hasattr(e, "sampler") for e in self.measure):
            rows = _rows(arm, self.measure)
            if len(rows[0]) != ny:
                raise ValueError(f"measure: gives {len(rows[0])} numbers; B has {ny} columns")
        reference = (
            self.reference if callable(self.reference) else np.broadcast_to(array("reference", self.reference), (ny,))
        )
        law = _core.LinearLaw(
            *(self.A, self.B, self.C, self.D, columns, *rows, self.limit),
            (lambda t: np.broadcast_to(np.asarray(reference(t), dtype=float), (ny,)))
            if callable(reference)
            else reference,
            None if len(rows[0]) else read,
        )
        return law, by_acceleration


def _discrete(A: Any, B: Any, C: Any, D: Any, dt: float, method: str) -> tuple[Array, Array, Array, Array]:
    continuous = B is None
    if continuous:
        if isinstance(A, tuple):
            A, B, C, D = A
        elif all(hasattr(A, name) for name in "ABCD"):
            given = getattr(A, "dt", None)
            if given not in (None, 0, False) and abs(float(given) - dt) > 1e-9 * dt:
                raise ValueError(f"A: a system sampled every {given} s; rate asks for {dt} s")
            continuous = given in (None, 0, False)
            A, B, C, D = A.A, A.B, A.C, A.D
        else:
            raise ValueError(f"A = {A!r}: must be a matrix with B, C, D, or a state-space system")
    a, b, c, d = (np.atleast_2d(array(n, m)) for n, m in zip("ABCD", (A, B, C, D), strict=True))
    n = a.shape[0]
    if a.shape != (n, n) or b.shape[0] != n or c.shape[1] != n or d.shape != (c.shape[0], b.shape[1]):
        raise ValueError(f"A {a.shape}, B {b.shape}, C {c.shape}, D {d.shape}: do not fit together")
    if continuous:
        from scipy.signal import cont2discrete  # slow to import

        a, b, c, d, _ = cont2discrete((a, b, c, d), dt, method=method)
    return a, b, c, d


def control_laws(arm: Arm, control: Any, times: Array) -> tuple[list[_Feedback], list[_Sampler]]:
    """What the core needs of all controllers of a run."""
    given = [] if control is None else [control] if isinstance(control, Controller) else control
    if not isinstance(given, (list, tuple)) or not all(isinstance(c, Controller) for c in given):
        raise ValueError(f"control = {control!r}: must be a controller, such as PD(...), or a list of them")
    feedback, sampled = [], []
    for c in given:
        laws, samplers = c._laws(arm, times)
        feedback += laws
        sampled += samplers
    return feedback, sampled
