"""Controllers as the linear laws that they are, or are about a state."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import flexarm._core as _core

from .._check import Array
from ..model.acting.control import Run, gain_of, measured_rows, padded
from ..model.acting.motor import reach_of, torque_limits
from ..model.acting.record import LawRecord
from ..model.acting.sampled import LinearController, PythonLaw, Sampled, count_of, note
from ..model.parts.chain import Chain

_SMALL = 1e-6  # rad, m, and per second: steps of differences of sensors and laws
_SMOOTH = 1e-3  # parts of a law's derivatives that steps of different size may differ by
_SETTLED = 30  # samples in which a predictive law's plan comes to rest
_SHOWN = 120  # samples that a law with a memory is shown


class NoLinearLaw(ValueError):
    """A controller that is no linear law about the state."""


@dataclass
class Tap:
    """One number that a sampled law reads: its derivatives by q (nq,), v and a (nv,), the low pass behind them or None,
    the rate at which its sensor samples (Hz) or None, and how late it tells (s)."""

    by_q: Array
    by_v: Array
    by_a: Array
    filter: Any = None
    rate: float | None = None
    delay: float = 0.0


@dataclass
class HeldLaw:
    """A sampled law of controller `control`, of the class `kind`: x+ = A x - B y, u = C x - D y. `columns` u (nv, nu)
    are its forces, held, `delay` (s), one for all or one for each of u, behind the sample. It is linear while |u| is
    below `limit` (nu,), of its own and of the motors at its joints. `enters` (nv + states, nu): where u enters, if not
    as these forces, but through states of the controllers, such as that of a current loop."""

    control: int
    kind: str
    A: Array
    B: Array
    C: Array
    D: Array
    taps: list[Tap]
    columns: Array
    rate: float
    delay: float | Array
    limit: Array
    enters: Array | None = None

    @property
    def late(self) -> list[tuple[float, list[int]]]:
        """Each delay (s), and which of u have it."""
        delays = np.broadcast_to(self.delay, self.columns.shape[1])
        return [(float(d), np.flatnonzero(delays == d).tolist()) for d in np.unique(delays)]


@dataclass
class RunningLaw:
    """A law without samples, `control` and `kind` as of HeldLaw: u = -(by_q q + by_v v), `column` u its forces (nv,).
    Behind the arm's coordinates stand the states of controllers: their rates are the states. `acts`: not so of a
    motor's back-EMF and current loop, which are the arm's own, nor of an input of a controller's state."""

    control: int
    kind: str
    column: Array
    by_q: Array
    by_v: Array
    limit: float
    acts: bool = field(default=True)


@dataclass(frozen=True)
class Channel:
    """One output of a controller, where a loop can be broken.

    Attributes:
        control: index of the controller. output: which of its outputs. rate: at which it is held (Hz), or None.
        limit: that the output is kept within, by its controller or by the motor of its joint.
        kind: the controller's class. at: the joints or links that the output acts on, in words.
        name: such as "PD of 'elbow'", with more where that is not one channel alone.
    """

    control: int
    output: int
    rate: float | None
    limit: float
    kind: str
    at: str
    name: str = ""


def acted_on(arm: Chain, column: Array) -> str:
    """The joints that forces (nv,) act on; else the links whose beams they bend, as patches do."""
    acts = np.flatnonzero(column[: arm.nv]).tolist()
    joints = [i for k in range(len(arm.links)) for i in (arm.joint_rates(k) if arm.links[k].joint.nv else [])]
    names = [repr(arm.coordinates[i]) for i in acts if i in joints]
    firsts = [arm._core.first(k) for k in range(len(arm.links))]
    bent = dict.fromkeys(int(np.searchsorted(firsts, i, "right")) - 1 for i in acts)
    return ", ".join(names) or f"patches of {', '.join(repr(arm.names[k]) for k in bent)}"


def with_names(channels: Sequence[Channel]) -> list[Channel]:
    """The same channels, each with a name of its own."""
    short = [f"{c.kind} of {c.at}" for c in channels]
    long = [f"{name} (control[{c.control}])" for name, c in zip(short, channels, strict=True)]
    out = []
    for c, name, more in zip(channels, short, long, strict=True):
        same = f"{name} (control[{c.control}], output {c.output})"
        out.append(replace(c, name=name if short.count(name) == 1 else more if long.count(more) == 1 else same))
    return out


def running_laws(
    arm: Chain, controls: Sequence[Any], times: Array, loads: Any
) -> tuple[list[RunningLaw], list[list[Any]], NDArray[np.bool_]]:
    """The laws without samples of controllers; those with samples of each, as the core takes them; and which states of
    the controllers the arm feels. The others are left out."""
    found: list[RunningLaw] = []
    sampled = []
    total, first = sum(c.memory for c in controls), 0
    nq, nv = arm.nq + total, arm.nv + total
    for k, c in enumerate(controls):
        laws, held = c._laws(arm, Run(times, loads, first, total, k, controls))
        sampled.append(held)
        for law in laws:
            column, by_q, by_v = law.column, law.by_q, law.by_v
            if not (np.any(by_q) or np.any(by_v)):
                continue  # it looks at time alone
            motor = getattr(c, "motor", None)
            brakes = motor is not None and not np.any(by_q) and np.array_equal(by_v, motor.braking * column)
            acts = bool(np.any(column[: arm.nv])) and not brakes and not held
            limit = float(reach_of(arm, column[:, None], law.limit)[0])
            rows = padded(column, nv), padded(by_q, nq), padded(by_v, nv)
            found.append(RunningLaw(k, type(c).__name__, *rows, limit, acts))
        first += c.memory
    felt = np.zeros(total, dtype=bool)
    for _ in range(total):
        for x in found:
            if np.any(x.column[: arm.nv]) or np.any(x.column[arm.nv :][felt]):
                felt |= (x.by_q[arm.nq :] != 0) | (x.by_v[arm.nv :] != 0)
    gone = np.flatnonzero(~felt)  # such as the integral of a PID whose ki is zero
    for x in found:
        x.column, x.by_v = np.delete(x.column, arm.nv + gone), np.delete(x.by_v, arm.nv + gone)
        x.by_q = np.delete(x.by_q, arm.nq + gone)
    return [x for x in found if np.any(x.column)], sampled, felt


def _felt_part(A: Array, B: Array, C: Array, D: Array) -> tuple[Array, Array, Array, Array]:
    """A sampled law without the states that no output can feel."""
    felt = np.any(C != 0, axis=0)
    for _ in range(felt.size):
        felt |= np.any(A[felt] != 0, axis=0)
    return A[np.ix_(felt, felt)], B[felt], C[:, felt], D


def taps_of(arm: Chain, c: Any, q: Array, v: Array, loads: Any = None) -> tuple[list[Tap], Array, bool]:
    """The numbers that a sampled controller reads: their derivatives about a state, their values there (ny,), and
    whether a sensor has a range that may hold the loop."""
    nq, nv = arm.nq, arm.nv
    none = np.zeros(nv)
    if c.measure is None:
        eye = np.eye(nq + nv)
        return [Tap(row[:nq], row[nq:], none) for row in eye], np.concatenate([q, v]), False
    taps: list[Tap] = []
    at: list[float] = []
    bounded = False
    for i, e in enumerate(c.measure):
        if not hasattr(e, "sampler"):
            by_q, by_v = measured_rows(arm, [e], i)
            taps += [Tap(x, y, none) for x, y in zip(by_q, by_v, strict=True)]
            at += (by_q @ q + by_v @ v).tolist()
            continue
        state = np.concatenate([q, v, none])
        ends = state + _SMALL * np.vstack([np.eye(state.size), -np.eye(state.size), np.zeros((1, state.size))])
        parts = ends[:, :nq], ends[:, nq : nq + nv], ends[:, nq + nv :]
        y = e.measure(arm, np.zeros(len(ends)), *parts, loads=loads)
        gain, offset = e._each("gain", y.shape[1], 1.0), e._each("offset", y.shape[1], 0.0)
        by = gain[:, None] * (y[: state.size] - y[state.size : -1]).T / (2.0 * _SMALL)
        taps += [Tap(x[:nq], x[nq : nq + nv], x[nq + nv :], e.filter, e.rate, e.delay) for x in by]
        at += (gain * y[-1] + offset).tolist()
        bounded |= e.range is not None
    return taps, np.array(at), bounded


def held_law(
    arm: Chain, k: int, c: Any, sampled: Sequence[Any], felt: NDArray[np.bool_], q: Array, v: Array, t: float,
    loads: Any, recorded: bool,
) -> HeldLaw | None:  # fmt: skip
    """The law of a controller that samples, about a state; `sampled`: its laws as the core takes them; `felt`: see
    `running_laws`. With `recorded`, a callable is fitted to its answers in a run; None if these do not suffice.

    Raises:
        NoLinearLaw: it has no derivative there, or a memory that is not linear.
    """
    delay, law, kind = sampled[-1].delay, sampled[-1].law, type(c).__name__
    rate = getattr(c, "rate", None) or 1.0 / sampled[-1].period
    if isinstance(law, getattr(_core, "Mpc", ())):
        return _predictive(arm, k, kind, law, q, v, t, rate, delay)
    if not isinstance(c, Sampled):
        return _of_state(arm, k, kind, law, q, v, t, rate, delay)
    taps, y0, bounded = taps_of(arm, c, q, v, loads)
    columns = gain_of(c.motor) * np.array(c._columns(arm)).T
    if isinstance(c, LinearController):
        try:
            matrices = _felt_part(*c.by_readings(len(taps)))
        except ValueError as e:
            raise ValueError(f"control[{k}].{e}") from None
    elif recorded:
        found = law.record.law() if isinstance(law, PythonLaw) else None
        if found is None:
            return None
        matrices = found
    else:
        matrices = _asked(f"control[{k}]", c.law, y0, t, rate, columns.shape[1])
    limit = reach_of(arm, columns, 0.0 if bounded else c.limit)
    enters = law.columns[np.concatenate([np.ones(arm.nv, bool), felt])] if isinstance(law, _core.LinearLaw) else None
    return HeldLaw(k, kind, *matrices, taps, columns, rate, delay, limit, enters)


def _asked(name: str, law: Any, y0: Array, t: float, rate: float, nu: int) -> tuple[Array, Array, Array, Array]:
    """A callable law (t, y) -> u by its differences about y0."""
    try:
        law = copy.deepcopy(law)  # one with a memory is not to remember this
    except Exception:  # a law that cannot be copied
        pass

    def ask(y: Array, at: float = t) -> Array:
        try:
            said = law(at, y)
        except Exception as e:
            note(e, name, at)
            raise
        u = np.atleast_1d(np.asarray(said, dtype=float))
        if u.shape != (nu,) or not np.isfinite(u).all():
            raise NoLinearLaw(f"{name}: the law gave {u.tolist()} at the state; must be {count_of(nu)}")
        return u

    try:
        before = ask(y0.copy())
        steep = [np.zeros((nu, 0))] * 2
        for h in (_SMALL, 8.0 * _SMALL):
            sides = [[ask(y0 + s * h * e) for e in np.eye(y0.size)] for s in (1.0, -1.0)]
            steep = [steep[1], (np.array(sides[0]) - np.array(sides[1])).reshape(-1, nu).T / (2.0 * h)]
        forgets = bool(np.array_equal(ask(y0.copy()), before))
    except (ZeroDivisionError, OverflowError):  # it divides by the time since the last sample
        forgets = False
    if forgets:
        size = np.abs(steep[1]).max(initial=0.0)
        if np.abs(steep[0] - steep[1]).max(initial=0.0) > _SMOOTH * size + 1e-6:
            raise NoLinearLaw(
                f"{name}: the law has no derivative at the state: differences over {_SMALL:g} and {8 * _SMALL:g} give "
                f"{steep[0].ravel().tolist()} and {steep[1].ravel().tolist()}; ask about a state where it is smooth"
            )
        return np.zeros((0, 0)), np.zeros((0, y0.size)), np.zeros((nu, 0)), -steep[1]
    rng, shown = np.random.default_rng(0), LawRecord()
    for n in range(_SHOWN + 12 * y0.size):
        y = y0 + 1e-3 * rng.standard_normal(y0.size)
        shown.note(y, ask(y, t + n / rate))
    found = shown.law()
    if found is None:
        raise NoLinearLaw(
            f"{name}: the law remembers its inputs, and is not linear in the last three samples; give it as a "
            "LinearController"
        )
    return found


def _of_state(
    arm: Chain, k: int, kind: str, law: Any, q: Array, v: Array, t: float, rate: float, delay: float
) -> HeldLaw:
    """A law (t, q, v, a) -> forces of another kind, by its differences about the state."""
    state, zero = np.concatenate([q, v]), np.zeros(arm.nv)

    def ask(now: float, y: Array) -> Array:
        try:
            return np.asarray(law(now, y[: arm.nq], y[arm.nq :], zero), dtype=float)[: arm.nv]
        except TypeError:
            raise NoLinearLaw(f"control[{k}]: {type(law).__name__} is no function of a state") from None

    A, B, C, D = _asked(f"control[{k}]", ask, state, t, rate, arm.nv)
    acts = np.flatnonzero(np.any(C, axis=1) | np.any(D, axis=1))
    taps = [Tap(row[: arm.nq], row[arm.nq :], zero) for row in np.eye(state.size)]
    columns, limit = np.eye(arm.nv)[:, acts], torque_limits(arm)[acts]
    return HeldLaw(k, kind, A, B, C[acts], D[acts], taps, columns, rate, delay, limit)


def _predictive(
    arm: Chain, k: int, kind: str, law: Any, q: Array, v: Array, t: float, rate: float, delay: float
) -> HeldLaw:
    """Predictive control about a state, where its plan has come to rest, by differences. It remembers its last inputs,
    from which the rates of the next ones count, or which act until then: u = C u_last - D y."""
    state = np.concatenate([q, v])

    def ask(y: Array) -> Array:
        if law.feedback(t, y[: arm.nq], y[arm.nq :]):
            raise NoLinearLaw(f"control[{k}]: predictive control has no answer at the state")
        u: Array = law.u
        law.prepare()
        return u

    def answers(y: Array) -> Array:
        """To a state beside the one that it has come to rest in, and to that one a sample later."""
        law.reset()
        for _ in range(_SETTLED):
            ask(state)
        return np.array([ask(y), ask(state)])

    h = 100.0 * _SMALL  # its quadratic program is solved to about 1e-9
    moved = [(answers(state + h * e) - answers(state - h * e)) / (2.0 * h) for e in np.eye(state.size)]
    law.reset()
    now, later = (np.array([pair[i] for pair in moved]) for i in (0, 1))
    C: Array = np.linalg.lstsq(now, later, rcond=1e-9)[0].T.astype(float)
    taps = [Tap(row[: arm.nq], row[arm.nq :], np.zeros(arm.nv)) for row in np.eye(state.size)]
    limit = reach_of(arm, law.forces, np.inf)
    return HeldLaw(k, kind, C, -now.T, C, -now.T, taps, law.forces, rate, delay, limit)
