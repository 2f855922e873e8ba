"""Drives: a prescribed motion or a force (torque) of a joint, and the voltage of a piezo patch (paper Eq. 61)."""

from __future__ import annotations

import copy
import math
import weakref
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

import flexarm._core as _core

from ..._check import Array, array, choice, finite_number, increasing, instance, positive
from ..parts.chain import Chain

KNOWN = (_core.PiecewisePolynomial, tuple, type(None))  # laws that the core evaluates
_OF_CORE = (_core.LinearLaw, _core.ComputedTorque, *([_core.Mpc] if hasattr(_core, "Mpc") else []))


def weak_law(law: Any) -> Any:
    """A Python function that something else holds, for an object of the core that its owner may hold: the garbage
    collector does not see the objects that the core holds, and would keep such a circle for ever."""
    try:
        held = None if isinstance(law, (*KNOWN, *_OF_CORE)) else weakref.ref(law)
    except TypeError:  # of a class without weak references
        held = None
    return law if held is None else lambda *given: held()(*given)  # type: ignore[misc]


@dataclass(frozen=True)
class _Changed:
    """A callable law, `factor` times as large, delayed by `delay` (s), its value increased by `offset`, which rates of
    a motion are not. It may take a state, too."""

    law: Callable[..., Any]
    factor: float = 1.0
    offset: float = 0.0
    delay: float = 0.0

    def __call__(self, t: float, *state: Any) -> Any:
        value = self.law(t - self.delay, *state)
        if np.ndim(value) == 0:
            return self.factor * value + self.offset
        first, *rest = (self.factor * x for x in value)
        return [first + self.offset, *rest]


def _moved(law: Any, offset: float, delay: float, ends: bool) -> Any:
    if not isinstance(law, _core.PiecewisePolynomial):
        return _Changed(law, 1.0, offset, delay)
    breaks, pieces = law.breaks + delay, np.array(law.coefficients)
    if ends and breaks[0] != law.breaks[0] and breaks[-1] != law.breaks[-1]:
        # constant where the delayed samples do not reach
        first, (last, *_) = pieces[-1, 0], law(float(law.breaks[-1]))
        still = np.zeros((len(pieces), 1))
        still[-1] = first if delay > 0 else last
        edge = law.breaks[:1] if delay > 0 else law.breaks[-1:]
        breaks = np.concatenate([edge, breaks] if delay > 0 else [breaks, edge])
        pieces = np.hstack([still, pieces] if delay > 0 else [pieces, still])
    pieces[-1] += offset
    return _core.PiecewisePolynomial(breaks, pieces)


def _times_factor(law: Any, factor: float) -> Any:
    if isinstance(law, _core.PiecewisePolynomial):
        return _core.PiecewisePolynomial(law.breaks, factor * law.coefficients)
    return _Changed(law, factor)


def standing(law: Any) -> Any:
    """A law of polynomials, extended by its first and last value outside its samples; other laws unchanged."""
    if isinstance(law, tuple):
        return tuple(standing(part) for part in law)
    return law.standing() if isinstance(law, _core.PiecewisePolynomial) else law


_Kind = TypeVar("_Kind", bound="Law")


class Law:
    """A function of time: samples, as a piecewise polynomial that C++ evaluates, or a Python callable."""

    law: Any

    constant = False  # whether the value is the same at all times

    @classmethod
    def of(cls: type[_Kind], law: Any, constant: bool = False) -> _Kind:
        """The law of a callable or polynomials, as they are."""
        made = cls.__new__(cls)
        made.law, made.constant = law, constant
        return made

    def scaled(self, factor: float) -> Any:
        """The same law, `factor` times as large."""
        law, made = self.law, copy.copy(self)
        if isinstance(law, tuple):
            made.law = tuple(_times_factor(part, factor) for part in law)
        else:
            made.law = _times_factor(law, factor)
        return made

    def moved(self, offset: float = 0.0, delay: float = 0.0) -> Any:
        """The same law of one number or motion, increased by `offset`, and delayed by `delay` (s). Before and after its
        samples it has the first or last value, at which a motion rests."""
        made = copy.copy(self)
        made.law = _moved(self.law, offset, delay, not self.constant)
        return made

    def check_span(self, where: str, t: Array) -> None:
        """Raises ValueError if the samples do not cover the simulated times."""
        part = self.law[0] if isinstance(self.law, tuple) else self.law
        if self.constant or not isinstance(part, _core.PiecewisePolynomial):
            return
        begin, end = part.breaks[[0, -1]].tolist()
        slack = 1e-9 * (end - begin)
        if t[0] < begin - slack or t[-1] > end + slack:
            raise ValueError(f"{where}: samples cover t = {begin} to {end}, the simulation asks for {t[0]} to {t[-1]}")


def _quintics(h: Array, rows: Array) -> Array:
    """Coefficients (6, n), highest powers first, of polynomials of degree five over n steps h with given position,
    velocity and acceleration, rows (n + 1, 3), at both ends."""
    (q0, v0, a0), (q1, v1, a1) = rows[:-1].T, rows[1:].T
    way, rate, bend = q1 - q0 - h * (v0 + 0.5 * h * a0), h * (v1 - v0 - h * a0), h**2 * (a1 - a0)
    cube, quart = 10.0 * way - 4.0 * rate + 0.5 * bend, 7.0 * rate - 15.0 * way - bend
    return np.stack([(6.0 * way - 3.0 * rate + 0.5 * bend) / h**5, quart / h**4, cube / h**3, 0.5 * a0, v0, q0])


class Motion(Law):
    """Prescribed motion of a joint; its reaction becomes an output. ("Displacement driven" in Sec. 5.2.)

    `Motion(t, q)` interpolates positions (rad or m) by a spline of degree 5 (fewer than six samples by one polynomial);
    with `ends="rest"` it starts and ends with zero velocity and acceleration. It goes through every sample: smooth data
    of a quantised encoder first, or the acceleration is noise.
    `Motion(t, q, v, a)` fits position, velocity and acceleration at every sample by quintic pieces. Both have
    continuous accelerations and are evaluated in C++. `Motion(f)` takes a callable t -> (q, v, a), where v and a must
    be the derivatives of q.
    """

    def __init__(
        self,
        t: ArrayLike | Callable[[float], Any],
        q: ArrayLike | None = None,
        v: ArrayLike | None = None,
        a: ArrayLike | None = None,
        *,
        ends: str = "free",
    ) -> None:
        if callable(t):
            if q is not None or v is not None or a is not None:
                raise ValueError("q: a callable t -> (q, v, a) stands alone, without samples")
            self.law = t
            return
        times = increasing("t", t)
        if q is None:
            raise ValueError("q = None: samples (t, q) or (t, q, v, a), or a callable, are needed")
        if (v is None) != (a is None):
            raise ValueError(f"{'v' if v is None else 'a'} = None: give both v and a, or neither")
        position = array("q", q, times.shape)
        choice("ends", ends, ("free", "rest"))
        if v is not None and a is not None:
            rows = np.stack([position, array("v", v, times.shape), array("a", a, times.shape)], axis=1)
            self.law = _core.PiecewisePolynomial(times, _quintics(np.diff(times), rows))
            return
        from scipy.interpolate import PPoly, make_interp_spline  # slow to import

        rest = [(1, 0.0), (2, 0.0)]
        free = ends == "free"
        degree = min(5, times.size - 1) if free else 5
        spline = make_interp_spline(times, position, k=degree, bc_type=None if free else (rest, rest))
        pieces = PPoly.from_spline(spline)
        keep = np.flatnonzero(np.diff(pieces.x) > 0)  # splines repeat their end knots
        self.law = _core.PiecewisePolynomial(np.append(pieces.x[keep], pieces.x[-1]), pieces.c[:, keep])

    def check_rates(self, where: str, t: Array) -> None:
        """Raises ValueError if a callable's v and a are clearly not the derivatives of its q."""
        if isinstance(self.law, _core.PiecewisePolynomial):
            return
        span = float(t[-1] - t[0])
        times = t[0] + span * (0.03 + 0.94 * np.linspace(0, 1, 11))
        h = 1e-5 * span
        before, at, after = (np.array([array(f"{where} at t = {x}", self.law(x), (3,)) for x in times + d])
                             for d in (-h, 0.0, h))  # fmt: skip
        rate = (after - before)[:, :2] / (2 * h)
        off = np.abs(rate - at[:, 1:]) > 1e-3 * (np.abs(rate) + np.abs(at[:, 1:])) + 1e-6 * np.abs(at).max(
            initial=1e-12
        )
        for name, of, wrong in (("v", "q", off[:, 0]), ("a", "v", off[:, 1])):
            if wrong.sum() > 5:  # at most of the times tried: single kinks are allowed
                k = int(np.flatnonzero(wrong)[0])
                raise ValueError(
                    f"{where}: its {name} must be the derivative of its {of}; at t = {times[k]:.6g} {name} is "
                    f"{at[k, 1 + (name == 'a')]:.6g}, the derivative {rate[k, int(name == 'a')]:.6g}"
                )

    def __call__(self, t: ArrayLike) -> Any:
        """Position, rate and acceleration (q, v, a) at time t (s); for times (nt,) three arrays (nt,)."""
        if np.ndim(t):
            return tuple(np.array([self(x) for x in array("t", t).ravel().tolist()]).T.reshape(3, *np.shape(t)))
        return self.law(t)

    @staticmethod
    def spin_up(speed: float, time: float) -> Motion:
        """Smooth spin-up from rest at t = 0 to `speed` (rad/s, m/s) at `time` (s), then constant speed (Kane et al.
        1987)."""
        return Motion(SpinUp(speed, time))

    def __repr__(self) -> str:
        return f"Motion({self.law!r})"


@dataclass(frozen=True)
class SpinUp:
    """Smooth spin-up from rest at t = 0 to a constant speed (Kane et al. 1987).

    Args:
        speed: rad/s, m/s.
        time: time at which it is reached (s).
    """

    speed: float
    time: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "speed", finite_number("speed", self.speed))
        object.__setattr__(self, "time", positive("time", self.time, "s"))

    def __call__(self, t: float) -> tuple[float, float, float]:
        speed, time = self.speed, self.time
        if t >= time:
            return speed * (t - time / 2), speed, 0.0
        s = t / time
        u = 2 * math.pi * s
        if abs(u) < 0.5:  # a series, as the differences below would cancel
            x = u * u
            half = x * sum((-x) ** k / math.factorial(2 * k + 4) for k in range(7))
            one = x * sum((-x) ** k / math.factorial(2 * k + 3) for k in range(7))
        else:
            half, one = 0.5 + (math.cos(u) - 1) / u**2, 1 - math.sin(u) / u
        return speed * s * t * half, speed * s * one, speed / time * 2 * math.sin(u / 2) ** 2


class Scalar(Law):
    """One number that changes with time: samples, linear in between, a callable, or a constant."""

    def _read(self, name: str, t: Any, values: ArrayLike | None) -> None:
        if callable(t):
            self.law = t
        elif values is None:
            self.constant = True
            self.law = _core.PiecewisePolynomial([0.0, 1.0], [[array(name, t, ()).item()]])
        else:
            times = increasing("t", t)
            at = array(name, values, times.shape)
            self.law = _core.PiecewisePolynomial(times, [np.diff(at) / np.diff(times), at[:-1]])

    def __call__(self, t: ArrayLike) -> Any:
        """The value (N, N m, V) at time t (s); for times (nt,) an array (nt,)."""
        if np.ndim(t):
            return np.array([self(x) for x in array("t", t).ravel()]).reshape(np.shape(t))
        value = self.law(t)
        return float(value[0] if isinstance(value, tuple) else value)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({f'{self(0.0):.6g}' if self.constant else repr(self.law)})"


class Torque(Scalar):
    """Force (N) or torque (N m) of a joint: samples (t, tau), linear in between; a callable; a number."""

    def __init__(self, t: ArrayLike | Callable[[float], float], tau: ArrayLike | None = None) -> None:
        self._read("tau", t, tau)


class Voltage(Scalar):
    """Voltage of a patch (V): samples (t, V), linear in between; a callable t -> V; or a number."""

    def __init__(self, t: ArrayLike | Callable[[float], float], V: ArrayLike | None = None) -> None:
        self._read("V", t, V)


def is_patch(key: Any) -> bool:
    return isinstance(key, tuple) and len(key) > 0 and key[0] == "patch"


def is_strut(arm: Chain, key: Any) -> bool:
    """Whether it names a strut without a joint of its own."""
    return isinstance(key, str) and key in arm.strut_names and key not in arm.names


def split_drives(arm: Chain, drive: Any) -> tuple[Any, dict[Any, Any], dict[str, Any]]:
    """The drives of joints, those of patches, and those of struts."""
    if drive is None or not isinstance(drive, Mapping):
        return drive, {}, {}
    found: tuple[dict[Any, Any], ...] = {}, {}, {}
    for key, law in drive.items():
        found[1 if is_patch(key) else 2 if is_strut(arm, key) else 0][key] = law
    return found[0], found[1], found[2]


def moved_rates(arm: Chain, drive: Any) -> list[int]:
    """The rates that motions prescribe."""
    return [i for i, law in arm.by_rate("drive", split_drives(arm, drive)[0]).items() if isinstance(law, Motion)]


def patch_laws(arm: Chain, drives: Mapping[Any, Any], t: Array) -> list[_core.Drive]:
    """The core's drives for voltages of patches, keyed by ("patch", link, patch)."""
    out: dict[int, Any] = {}
    for key, law in drives.items():
        if len(key) != 3:
            raise ValueError(f'drive {key!r}: must be ("patch", link, patch)')
        k = arm.patch_column(key[1], key[2], "drive: ")
        where = f"drive of patch {key[2]} of link {key[1]}"
        instance(where, law, Voltage)
        if k in out:
            raise ValueError(f"{where}: is named twice")
        law.check_span(where, t)
        out[k] = law.law
    B = arm.patch_matrix
    return [_core.Drive(-1, False, law, B[:, k]) for k, law in out.items()]


def voltage_forces(arm: Chain, voltages: Any) -> Array:
    """Generalised forces (nv,) of constant voltages: (n_patches,), or by (link, patch)."""
    B = arm.patch_matrix
    V = np.zeros(B.shape[1])
    if isinstance(voltages, Mapping):
        for key, value in voltages.items():
            if not isinstance(key, tuple) or len(key) != 2:
                raise ValueError(f"voltages: {key!r}: must be (link, patch)")
            V[arm.patch_column(*key, "voltages: ")] = array("voltages", value, ())
    else:
        V = array("voltages", voltages, V.shape)
    return np.asarray(B @ V)
