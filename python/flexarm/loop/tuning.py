"""Gains of a control loop: a map of which are stable, and those for a wanted bandwidth with its margins."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .._check import Array
from .._console import progress_bar
from ..data.draw.loop import plot_map
from ..data.draw.style import Figure
from .hybrid import Complex, Hybrid, logarithm
from .margins import Margins, Response, margins_of, margins_table, short, stable

_GAINS = ("kp", "kv", "kd", "ki")
_BILINEAR = 1e-9  # parts of the largest entry, to which a loop's matrix is bilinear in two gains
_LEADS = 13  # phases that are tried, from the wanted margin to 90 degrees; for an advice
_FEW_LEADS = 3
_LOWEST, _GRID = 1e-3, 2000  # frequencies below the bandwidth, where the loop gain must be above 1
_SLOWER = 0.8  # factor between bandwidths that are tried for an advice, down to a hundredth

Build = Callable[[Mapping[str, float]], Hybrid]


@dataclass(frozen=True)
class StabilityMap:
    """Which values of two parameters of a loop are stable.

    Attributes:
        over: the two parameters. x: values of the first, (nx,). y: of the second, (ny,).
        growth: of the fastest growing pole (1/s), (ny, nx); negative: the loop is stable.
        now: their present values.
    """

    over: tuple[str, str]
    x: Array
    y: Array
    growth: Array
    now: tuple[float, float]

    @property
    def stable(self) -> Array:
        """Whether the loop is stable, (ny, nx) of bool."""
        return np.asarray(self.growth <= 1e-6)

    def __repr__(self) -> str:
        share = f"{100 * self.stable.mean():.0f} % of {self.growth.size} points are stable"
        return f"StabilityMap({self.over[0]}, {self.over[1]}: {share})"

    def plot(self) -> Figure:
        """A figure: how fast the slowest motion of the stable loops dies away, the unstable ones in grey, the boundary,
        and the present values."""
        return plot_map(self.over, self.x, self.y, self.growth, self.now)


def map_of(
    build: Build, over: tuple[str, str], x: Array, y: Array, now: tuple[float, float], progress: Any
) -> StabilityMap:
    """See ClosedLoop.stability_map. Where the matrix of the loop is bilinear in both values it is made of those at the
    corners."""

    def at(i: int, j: int) -> Hybrid:
        return build({over[0]: float(x[i]), over[1]: float(y[j])})

    def between(i: int, j: int) -> Array:
        a, b = (x[i] - x[0]) / (x[-1] - x[0]), (y[j] - y[0]) / (y[-1] - y[0])
        low, right, up, both = corners
        return np.asarray((1 - b) * ((1 - a) * low + a * right) + b * ((1 - a) * up + a * both))

    middle = len(x) // 2, len(y) // 2
    loops = [at(*middle), *(at(i, j) for j in (0, -1) for i in (0, -1))]
    (whole, *corners), period = [loop.matrix() for loop in loops], loops[0].period
    same = all(m.shape == whole.shape for m in corners) and all(loop.period == period for loop in loops)
    bilinear = same and np.abs(whole - between(*middle)).max() <= _BILINEAR * np.abs(whole).max()

    def grown(i: int, j: int) -> float:
        if not bilinear:
            return at(i, j).growth()
        s = np.linalg.eigvals(between(i, j)).astype(complex)
        return float((s if period is None else logarithm(s, period)).real.max(initial=-np.inf))

    growth = np.empty((len(y), len(x)))
    with progress_bar(progress, "mapping poles", len(y)) as bar:
        for j in range(len(y)):
            growth[j] = [grown(i, j) for i in range(len(x))]
            if bar is not None:
                bar(j + 1)
    return StabilityMap(over, x, y, growth, now)


@dataclass(frozen=True)
class Tuned:
    """Gains that were found for a loop, the result of `ClosedLoop.tune`.

    Attributes:
        control: all controllers of the loop, one with the new gains; for `simulate` and `closed_loop`.
        gains: these gains, by name. bandwidth: where the loop gain is 1 (rad/s).
        margins: of this loop, all others closed. wanted: the margins that were asked for: of phase (rad), of gain.
    """

    control: tuple[Any, ...]
    gains: dict[str, float]
    bandwidth: float
    margins: Margins
    wanted: tuple[float, float]

    def __str__(self) -> str:
        """The gains, and the margins that they reach."""
        gains = ", ".join(f"{name} = {x:.6g}" for name, x in self.gains.items())
        phase, gain = self.wanted
        first = f"{gains}; loop gain 1 at {short(self.bandwidth)} rad/s"
        last = f"wanted: {np.degrees(phase):.4g} deg or more, gains from {1 / gain:.4g} or less to {gain:.4g} or more"
        return "\n".join([first, *margins_table([self.margins]), last])


def gains_of(law: Any) -> list[str]:
    """The gains of a law that can be tuned: kp, kv or kd, and ki if it has one."""
    found = law._arguments() if law.type else {}
    names = [name for name in _GAINS if np.ndim(found.get(name, "")) == 0 and isinstance(found.get(name), float)]
    return names if "kp" in names and len({"kv", "kd"} & set(names)) == 1 else []


@dataclass
class Found:
    """The result of a search: stable gains with their margins; whether the last have those wanted; and the largest
    frequency (rad/s) at which the loop gain fell below 1 too early, 0 if nowhere."""

    tried: list[tuple[Array, Margins]] = field(default_factory=list)
    good: bool = False
    lost: float = 0.0


class Tuner:
    """The loop of one controller, whose gain is linear in the controller's gains.

    Args:
        build: the loop with other values of some parameters. number: of the controller.
        names, now: its gains, and their present values. channel: its only output among the loop's.

    Raises:
        ValueError: the loop has no frequency response.
    """

    def __init__(self, build: Build, number: int, names: list[str], now: Array, channel: int) -> None:
        self.names, self.channel = names, channel
        self._build, self._number = build, number
        self._here = np.where(now == 0.0, 1.0, now)
        loops = [self.at(self._here + d) for d in (np.zeros(len(names)), *np.diag(self._here))]
        self._parts = [Response(loop.opened([channel]), loop.period) for loop in loops]
        if self._parts[0].D.size != 1:
            raise ValueError("tune: several sampling rates: the loop has no frequency response")

    def values(self, gains: Array) -> dict[str, float]:
        return {f"control.{self._number}.{name}": float(x) for name, x in zip(self.names, gains, strict=True)}

    def at(self, gains: Array) -> Hybrid:
        return self._build(self.values(gains))

    def parts(self, w: Array) -> Complex:
        """The loop gain without any of the gains, and by each of them, (1 + n, nw), at frequencies (rad/s)."""
        first, *moved = (part(w)[:, 0, 0] for part in self._parts)
        by = (np.array(moved) - first) / self._here[:, None]
        return np.vstack([first - self._here @ by, by])

    def gains(self, at: Complex, phase: float, corner: float) -> Array | None:
        """The gains with which the loop gain of these `parts` (1 + n,) is -exp(i phase), ki = corner kp; None if one is
        not positive."""
        rest = -np.exp(1j * phase) - at[0]
        lead = at[1] + (corner * at[3] if len(at) > 3 else 0.0)
        both = np.array([[lead.real, at[2].real], [lead.imag, at[2].imag]])
        if not np.isfinite(both).all() or abs(np.linalg.det(both)) < 1e-12 * np.abs(both).max() ** 2:
            return None
        kp, kv = np.linalg.solve(both, [rest.real, rest.imag])
        return np.array([kp, kv, corner * kp][: len(at) - 1]) if kp > 0.0 and kv >= 0.0 else None

    def margins(self, gains: Array, late: bool = False) -> Margins | None:
        """With these gains; None if the loop is unstable."""
        loop = self.at(gains)
        poles = loop.poles()[0]
        return margins_of(loop, self.channel, poles, late) if stable(poles) else None

    def search(self, w: float, wanted: tuple[float, float], corner: float, leads: int = _LEADS) -> Found:
        """Gains for a bandwidth w, of which the first with the margins wanted are the last."""
        found = Found()
        grid = w * np.geomspace(_LOWEST, 1.0, _GRID)
        parts = self.parts(grid)
        for phase in np.linspace(wanted[0], max(wanted[0], 0.5 * np.pi), leads):
            gains = self.gains(parts[:, -1], float(phase), corner)
            if gains is None:
                continue
            below = np.flatnonzero(np.abs(parts[0] + gains @ parts[1:])[:-1] < 1.0 - 1e-6)
            if below.size:
                found.lost = max(found.lost, float(grid[below[0]]))
                continue
            margins = self.margins(gains)
            if margins is None:
                continue
            found.tried.append((gains, margins))
            low, high = margins.gain
            if margins.phase >= wanted[0] - 1e-6 and high >= wanted[1] and low <= 1 / wanted[1]:
                found.good = True
                break
        return found

    def tune(self, w: float, wanted: tuple[float, float], corner: Callable[[float], float]) -> tuple[Array, Margins]:
        """The gains with the least lead that reach the margins wanted.

        Raises:
            ValueError: there are none; the message has the gains that were found, and a bandwidth within reach.
        """
        found = self.search(w, wanted, corner(w))
        if found.good:
            gains = found.tried[-1][0]
            margins = self.margins(gains, late=True)
            assert margins is not None
            return gains, margins
        asked = f"a phase margin of {np.degrees(wanted[0]):.4g} deg and a gain margin of {wanted[1]:.4g}"
        near = "no positive gains make the loop stable there"
        if found.tried:
            _, best = max(found.tried, key=lambda x: min(x[1].phase / wanted[0], x[1].gain[1] / wanted[1]))
            near = f"the best found has {np.degrees(best.phase):.4g} deg and {short(best.gain[1], 'inf')}"
        elif found.lost:
            near = f"the loop gain falls below 1 at {found.lost:.4g} rad/s, near a frequency of the arm held there"
        slower = w * _SLOWER ** np.arange(1, 22)
        reach = next((x for x in slower if self.search(x, wanted, corner(x), _FEW_LEADS).good), None)
        advice = f"; {reach:.3g} rad/s is within reach" if reach else "; nor is a hundredth of it within reach"
        raise ValueError(f"bandwidth = {w:.6g} rad/s: is not reached with {asked}: {near}{advice}")
