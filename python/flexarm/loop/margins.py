"""Frequency response of a loop gain, and how far it is from instability."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from .._check import Array
from .._console import aligned
from .hybrid import Complex, Hybrid, logarithm
from .laws import Channel, HeldLaw

_GRID = 1500  # frequencies, beside those at poles
_NEAR_POLES = np.concatenate([[0.0], np.geomspace(1e-2, 30.0, 30)])  # of a pole's distance from the axis
_FASTEST = 100.0  # zeros that lie so much farther out than all poles are those at infinity
_ROUNDING = 1e-7  # of a pole's size, by which it may seem to grow for rounding alone


@dataclass(frozen=True)
class Margins:
    """How far one output of a controller is from instability, its loop broken there, all others closed.

    Attributes:
        name: of the channel, such as "PD of 'elbow'".
        gain: (low, high): the loop is stable while this output is multiplied by a factor between them; 0 and inf where
            there is no limit. nan, as all else, where the loop is unstable.
        gain_frequency: of the motion that is lost at each (rad/s), nan where there is no limit.
        phase: the least phase (rad), lost or gained, that makes it unstable; inf where the gain is nowhere 1. nan of
            one of several sampling rates, which has no frequency response.
        phase_frequency: where (rad/s).
        delay: the least further delay of this output alone that makes it unstable (s); inf where none does. Of a
            sampled law it is a delay of the output's force, with all between the samples.
    """

    name: str
    gain: tuple[float, float]
    gain_frequency: tuple[float, float]
    phase: float
    phase_frequency: float
    delay: float

    def __str__(self) -> str:
        """A small table, the phase in degrees, the delay in milliseconds."""
        return "\n".join(margins_table([self]))


class Robustness(NamedTuple):
    """The least singular value of I + L, all loops broken at once.

    Attributes:
        value: the distance of the loop gain from the critical point: 1 without a loop, 0 where it is unstable. All
            outputs may at once be multiplied, each by a factor of its own from 1 / (1 + value) to 1 / (1 - value), or
            lose 2 asin(value / 2) of phase (rad) (Lehtomaki, Sandell & Athans, IEEE Trans. Automatic Control 26, 1981).
            It depends on the outputs' units.
        frequency: where it is least (rad/s).
    """

    value: float
    frequency: float

    def __str__(self) -> str:
        return f"least singular value of I + L: {self.value:.3f}, at {short(self.frequency)} rad/s"


def margins_table(margins: Sequence[Margins]) -> list[str]:
    """The lines of a table: its head, then one for each."""
    rows = [["loop at", "gain, from", "to", "phase (deg)", "at (rad/s)", "delay (ms)"]]
    for m in margins:
        phase, delay = (short(x, "-" if np.isnan(x) else "any") for x in (np.degrees(m.phase), 1e3 * m.delay))
        rows.append([m.name, short(m.gain[0]), short(m.gain[1], "inf"), phase, short(m.phase_frequency), delay])
    return aligned(rows, range(1, 6))


def short(x: float, none: str = "-") -> str:
    """Four digits; `none` of inf and nan."""
    return none if not np.isfinite(x) else f"{x + 0.0 if abs(x) > 1e-12 else 0.0:.4g}"


class Response:
    """C (p I - A)^-1 B + D at p = i w, or p = exp(i w period)."""

    def __init__(self, system: tuple[Array, Array, Array, Array], period: float | None) -> None:
        import scipy.linalg as la  # slow to import

        A, B, C, self.D = system
        self.period = period
        if len(A):
            _, (scale, _) = la.matrix_balance(A, permute=False, separate=True)
            A, B, C = A / scale[:, None] * scale, B / scale[:, None], C * scale
        T, Q = la.schur(A.astype(complex), output="complex") if len(A) else (A.astype(complex),) * 2
        self.T: Complex = np.asarray(T)
        self.B, self.C = Q.conj().T @ B, C @ Q
        self.poles = np.diag(self.T).copy()

    def __call__(self, frequency: Array) -> Complex:
        """(nw, ny, nu) at frequencies (rad/s), (nw,)."""
        p = 1j * frequency if self.period is None else np.exp(1j * frequency * self.period)
        n = len(self.T)
        if len(p) == 1 and n and not (self.poles == p[0]).any():  # as root finders ask
            from scipy.linalg.lapack import ztrtrs  # slow to import

            out, _ = ztrtrs(p[0] * np.eye(n) - self.T, self.B)
            return np.asarray((self.C @ out + self.D)[None])
        m = self.B.shape[1]
        x = np.zeros((n, m * len(p)), complex)  # of each column of B, at all frequencies
        with np.errstate(divide="ignore", invalid="ignore"):
            for i in reversed(range(n)):
                right = np.repeat(self.B[i], len(p)) + self.T[i, i + 1 :] @ x[i + 1 :]
                x[i] = right / np.tile(p - self.T[i, i], m)
            y = (self.C @ x).reshape(-1, m, len(p))
        return np.asarray(np.moveaxis(y, 2, 0) + self.D)

    def frequencies(self, closed: Complex) -> Array:
        """Where to look (rad/s): everywhere, and closely at poles, its own and those of the closed loop (1/s)."""
        own = self.poles if self.period is None else logarithm(self.poles, self.period)
        s = np.concatenate([own, closed])
        s = s[np.isfinite(s) & (s.imag >= 0) & (np.abs(s) > 1e-14 * np.abs(s[np.isfinite(s)]).max(initial=0.0))]
        size = np.abs(s) if s.size else np.ones(1)
        high = 30.0 * size.max() if self.period is None else np.pi / self.period
        low = min(1e-3 * size.min(), 1e-3 * high)
        sides = np.concatenate([-_NEAR_POLES[:0:-1], _NEAR_POLES])
        beside = np.maximum(np.abs(s.real), 1e-7 * np.abs(s))[:, None] * sides
        w = np.concatenate([np.geomspace(low, high, _GRID), (np.abs(s.imag)[:, None] + beside).ravel()])
        return np.unique(w[(w >= low) & (w <= high)])


def _roots(values: Array, w: Array, of: Callable[[float], float]) -> list[float]:
    """The zeros of a function between neighbours of w where its values change their sign."""
    from scipy.optimize import brentq  # slow to import

    def at(x: float) -> float:
        found = of(x)
        return found if np.isfinite(found) else 0.0  # a pole on the axis, which ends the search

    good = np.isfinite(values)
    w, values = w[good], values[good]
    found = [float(w[k]) for k in np.flatnonzero(values == 0.0)]
    for k in np.flatnonzero(values[1:] * values[:-1] < 0.0):
        ends = at(w[k]), at(w[k + 1])
        if ends[0] * ends[1] >= 0.0:  # one of the values has its sign of rounding, as at half a rate: there is the zero
            found.append(float(w[k + int(abs(ends[1]) < abs(ends[0]))]))
        else:
            found.append(float(brentq(at, w[k], w[k + 1], xtol=1e-14 * w[k + 1], rtol=1e-13)))
    return found


def stable(s: Complex) -> bool:
    """Whether no pole grows, but for rounding."""
    return bool((excess(s) <= 0.0).all())


def excess(s: Complex) -> Array:
    """Growths (1/s), less the rounding of poles that stand still."""
    finite = s[np.isfinite(s)]
    return np.asarray(finite.real - _ROUNDING * np.abs(finite) - 1e-6)


def margins_of(hybrid: Hybrid, channel: int, closed: Complex, late: bool = True) -> Margins:
    """Of one channel; `closed`: the poles of the closed loop (1/s). `late`: whether the delay of a sampled law is
    sought, too, which takes longest; else it is that of the frequency response."""
    c = hybrid.channels[channel]
    nan = float("nan")
    if not stable(closed):
        return Margins(c.name, (nan, nan), (nan, nan), nan, nan, nan)
    mixed = c.rate is None and bool(hybrid.held)
    if mixed or (c.rate is not None and round((hybrid.period or 0.0) * c.rate) != 1):
        low, high = _by_poles(hybrid, channel)
        later = nan if c.rate is None else _delay_by_poles(hybrid, c, np.geomspace(1e-2, 1e2, 80) / c.rate)
        return Margins(c.name, (low[0], high[0]), (low[1], high[1]), nan, nan, later)
    response = Response(hybrid.opened([channel]), hybrid.period)

    def L(w: float) -> complex:
        return complex(response(np.array([w]))[0, 0, 0])

    w = response.frequencies(closed)
    values = response(w)[:, 0, 0]
    crossings = _roots(values.imag, w, lambda x: L(x).imag)
    # a real pole leaves at frequency zero, or half the rate
    gains = [(-1.0 / L(x).real, x) for x in (*crossings, w[-1]) if abs(L(x).imag) < 1e-6 * -L(x).real]
    if abs(values[0].imag) < 1e-2 * -values[0].real:
        still = complex(response(np.zeros(1))[0, 0, 0])
        if np.isfinite(still) and still.real < 0.0:
            gains.append((-1.0 / still.real, 0.0))
    none = (nan, nan)
    low = max((x for x in gains if x[0] < 1.0), default=(0.0, none[0]))
    high = min((x for x in gains if x[0] > 1.0), default=(np.inf, none[0]))
    low = (0.0, nan) if low[0] < 1e-9 else low
    with np.errstate(divide="ignore"):
        ones = _roots(np.log(np.abs(values)), w, lambda x: np.log(abs(L(x))))
    lags = [(np.mod(np.pi + np.angle(L(x)), 2 * np.pi), x) for x in ones]
    phase = min(((min(a, 2 * np.pi - a), x) for a, x in lags), default=(np.inf, nan))
    delay = min((a / x for a, x in lags), default=np.inf)
    if late and c.rate is not None and np.isfinite(delay):
        delay = _delay_by_poles(hybrid, c, np.linspace(0.0, 2.0 * delay, 41)[1:])
    return Margins(c.name, (low[0], high[0]), (low[1], high[1]), float(phase[0]), phase[1], float(delay))


def _by_poles(hybrid: Hybrid, channel: int) -> tuple[tuple[float, float], tuple[float, float]]:
    """The factors of one channel between which the loop is stable, and the frequency lost at each."""
    factors = hybrid.ones()

    def poles(factor: float) -> Complex:
        factors[channel] = factor
        return hybrid.poles(factors)[0]

    ends = []
    for way, end in ((np.geomspace(1.0, 1e-4, 60), 0.0), (np.geomspace(1.0, 1e4, 60), np.inf)):
        found = first_crossing(poles, way)
        ends.append((end, float("nan")) if found is None else found)
    return ends[0], ends[1]


def _delay_by_poles(hybrid: Hybrid, channel: Channel, values: Array) -> float:
    """The first of values (s), refined, by which one output of a sampled law may not come later; inf if none."""

    def poles(late: float) -> Complex:
        held = [replace(x, delay=x.delay + late * mine(x)) if x.control == channel.control else x for x in hybrid.held]
        return hybrid.with_held(held).poles()[0]

    def mine(law: HeldLaw) -> Array:
        return np.asarray(np.arange(law.columns.shape[1]) == channel.output, dtype=float)

    found = first_crossing(poles, np.concatenate([[0.0], values]))
    return np.inf if found is None else found[0]


def first_crossing(poles: Callable[[float], Complex], values: Array) -> tuple[float, float] | None:
    """The first of values, refined, at which poles(value) (1/s) become unstable, or stable; and the frequency (rad/s)
    of the pole that crosses. None: they do not, at the values that poles takes.

    Raises:
        ValueError: poles takes not even the second.
    """
    from scipy.optimize import brentq  # slow to import

    def worst(x: float) -> tuple[float, complex]:
        s = poles(float(x))
        s = s[np.isfinite(s)]
        by = excess(s)
        k = int(by.argmax())
        return float(by[k]), complex(s[k])

    before = worst(values[0])[0]
    for k, (a, b) in enumerate(pairwise(values)):
        try:
            now = worst(b)[0]
        except ValueError:  # a value that the parameter cannot take
            if k == 0:
                raise
            return None
        if (now > 0.0) == (before > 0.0):
            before = now
            continue
        at = float(brentq(lambda x: worst(x)[0], a, b, xtol=1e-14 * abs(b), rtol=1e-12))
        pole = worst(at)[1]

        def near(x: float, to: complex = pole) -> float:
            s = poles(x)
            s = s[np.isfinite(s) & (np.abs(s.real) > 1e-10)]  # not one that stands still
            if not s.size:
                return 0.0
            off = np.abs(s.real - to.real) + np.abs(np.abs(s.imag) - abs(to.imag))  # whichever of a conjugate pair
            return float(s[off.argmin()].real)

        width = 1e-5 * abs(b - a) + 1e-4 * abs(at)
        ends = at - width, at + width
        if near(ends[0]) * near(ends[1]) < 0.0:  # without the allowance for rounding
            at = float(brentq(near, *ends, xtol=1e-14 * abs(at), rtol=1e-12))
        return at, abs(pole.imag)
    return None


def robustness_of(hybrid: Hybrid, closed: Complex) -> Robustness:
    """See ClosedLoop.robustness; `closed`: the poles of the closed loop (1/s)."""
    from scipy.optimize import minimize_scalar  # slow to import

    nan = float("nan")
    if not hybrid.channels or not stable(closed):
        return Robustness(0.0 if hybrid.channels else 1.0, nan)
    try:
        response = Response(hybrid.opened(range(len(hybrid.channels))), hybrid.period)
    except ValueError:  # some are sampled and some are not
        return Robustness(nan, nan)
    eye = np.eye(response.D.shape[0])

    def least(w: Array) -> Array:
        L = response(w)
        good = np.asarray(np.isfinite(L).all(axis=(1, 2)))
        sizes = np.linalg.norm(eye + np.where(good[:, None, None], L, 0.0), -2, axis=(1, 2))
        return np.where(good, sizes, np.inf)

    w = response.frequencies(closed)
    values = least(w)
    k = int(values.argmin())
    near = w[max(k - 1, 0)], w[min(k + 1, len(w) - 1)]
    found = minimize_scalar(lambda x: float(least(np.array([x]))[0]), bounds=near, method="bounded")
    return Robustness(float(min(found.fun, values[k])), float(found.x if found.fun < values[k] else w[k]))


def zeros_of(A: Array, B: Array, C: Array, D: Array, poles: Complex) -> Complex:
    """Finite zeros of a system with as many inputs as outputs: those of its Rosenbrock matrix."""
    import scipy.linalg as la  # slow to import

    n, m = B.shape
    wide, high = (np.where(x > 0, x, 1.0) for x in (np.linalg.norm(B, axis=0), np.linalg.norm(C, axis=1)[:, None]))
    left = np.block([[A, B / wide], [C / high, D / high / wide]])
    found = la.eigvals(left, la.block_diag(np.eye(n), np.zeros((m, m))))
    most = _FASTEST * max(float(np.abs(poles[np.isfinite(poles)]).max(initial=0.0)), 1e-300)
    found = found[np.isfinite(found)]
    found = found[np.abs(found) < most]
    return np.asarray(found[np.lexsort((found.imag, np.abs(found)))], dtype=complex)
