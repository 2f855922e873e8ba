"""Gains of a control loop: a map of which are stable, and those for a wanted bandwidth with its margins."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._check import Array
from ..data.draw.loop import plot_map
from ..data.draw.style import Figure
from .hybrid import Hybrid, logarithm
from .margins import Margins, Response, margins_of, margins_table, short, stable

_GAINS = ("kp", "kv", "kd", "ki")
_BILINEAR = 1e-9  # parts of the largest entry, to which a loop's matrix is bilinear in two gains
_LEADS = 13  # phases that are tried, from the wanted margin to 90 degrees
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


def map_of(build: Build, over: tuple[str, str], x: Array, y: Array, now: tuple[float, float]) -> StabilityMap:
    """See ClosedLoop.stability_map. Where the matrix of the loop is bilinear in both values it is made of five."""

    def matrix(a: float, b: float) -> Array:
        return build({over[0]: float(a), over[1]: float(b)}).matrix()

    growth = np.empty((len(y), len(x)))
    period = build(dict(zip(over, now, strict=True))).period
    corners = [[matrix(a, b) for a in (x[0], x[-1])] for b in (y[0], y[-1])]
    part = (x - x[0]) / (x[-1] - x[0]), (y - y[0]) / (y[-1] - y[0])

    def between(i: int, j: int) -> Array:
        a, b = part[0][i], part[1][j]
        (low, right), (up, both) = corners
        return np.asarray((1 - b) * ((1 - a) * low + a * right) + b * ((1 - a) * up + a * both))

    middle = len(x) // 2, len(y) // 2
    whole = matrix(x[middle[0]], y[middle[1]])
    same = all(m.shape == whole.shape for row in corners for m in row)
    bilinear = same and np.abs(whole - between(*middle)).max() <= _BILINEAR * np.abs(whole).max()
    for j in range(len(y)):
        rows = [between(i, j) if bilinear else matrix(x[i], y[j]) for i in range(len(x))]
        values = [np.linalg.eigvals(m).astype(complex) for m in rows]
        for i, z in enumerate(values):
            s = z if period is None else logarithm(z, period)
            growth[j, i] = s.real.max(initial=-np.inf)
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
        """The gains, and what is reached."""
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


class Tuner:
    """The loop of one controller, whose gain is linear in the controller's gains.

    Args:
        build: the loop with other values of some parameters. number: of the controller.
        names, now: its gains, and their present values. channel: its only output among the loop's.
    """

    def __init__(self, build: Build, number: int, names: list[str], now: Array, channel: int) -> None:
        self.names, self.channel = names, channel
        self._build, self._number = build, number
        here = np.where(now == 0.0, 1.0, now)
        loops = [self.at(here + d) for d in (np.zeros(len(names)), *np.diag(here))]
        self._parts = [Response(loop.opened([channel]), loop.period) for loop in loops]
        self._here = here
        self.period = loops[0].period

    def values(self, gains: Array) -> dict[str, float]:
        return {f"control.{self._number}.{name}": float(x) for name, x in zip(self.names, gains, strict=True)}

    def at(self, gains: Array) -> Hybrid:
        return self._build(self.values(gains))

    def gains(self, w: float, phase: float, corner: float) -> Array | None:
        """The gains with which L(w) = -exp(i phase) (w in rad/s), ki = corner kp; None if a gain is not positive."""
        first, *moved = (complex(part(np.array([w]))[0, 0, 0]) for part in self._parts)
        by = (np.array(moved) - first) / self._here
        rest = -np.exp(1j * phase) - (first - by @ self._here)
        lead = by[0] + (corner * by[2] if len(by) > 2 else 0.0)
        both = np.array([[lead.real, by[1].real], [lead.imag, by[1].imag]])
        if not np.isfinite(both).all() or abs(np.linalg.det(both)) < 1e-12 * np.abs(both).max() ** 2:
            return None
        kp, kv = np.linalg.solve(both, [rest.real, rest.imag])
        return np.array([kp, kv, corner * kp][: len(by)]) if kp > 0.0 and kv >= 0.0 else None

    def reached(self, gains: Array) -> Margins | None:
        """The margins with these gains; None if the loop is unstable."""
        loop = self.at(gains)
        poles = loop.poles()[0]
        return margins_of(loop, self.channel, poles) if stable(poles) else None

    def search(self, w: float, wanted: tuple[float, float], corner: float) -> tuple[list[tuple[Array, Margins]], bool]:
        """Gains that are stable and have a loop gain of 1 at w, with their margins; whether the last have those
        wanted."""
        found = []
        for phase in np.linspace(wanted[0], 0.5 * np.pi, _LEADS) if wanted[0] < 0.5 * np.pi else [wanted[0]]:
            gains = self.gains(w, float(phase), corner)
            margins = None if gains is None else self.reached(gains)
            if gains is None or margins is None:
                continue
            found.append((gains, margins))
            if margins.phase >= wanted[0] - 1e-6 and margins.gain[1] >= wanted[1] and margins.gain[0] <= 1 / wanted[1]:
                return found, True
        return found, False

    def tune(self, w: float, wanted: tuple[float, float], corner: Callable[[float], float]) -> tuple[Array, Margins]:
        """The gains with the least lead that reach the margins wanted.

        Raises:
            ValueError: there are none; with what was found, and with a bandwidth that is within reach.
        """
        found, good = self.search(w, wanted, corner(w))
        if good:
            return found[-1]
        asked = f"a phase margin of {np.degrees(wanted[0]):.4g} deg and a gain margin of {wanted[1]:.4g}"
        best = max(found, key=lambda x: min(x[1].phase / wanted[0], x[1].gain[1] / wanted[1]), default=None)
        near = "no gains make the loop stable there" if best is None else (
            f"the best found has {np.degrees(best[1].phase):.4g} deg and {short(best[1].gain[1], 'inf')}"
        )  # fmt: skip
        slower = w * _SLOWER ** np.arange(1, 22)
        reach = next((x for x in slower if self.search(x, wanted, corner(x))[1]), None)
        advice = f"; {reach:.3g} rad/s is within reach" if reach else "; nor is a hundredth of it within reach"
        raise ValueError(f"bandwidth = {w:.6g} rad/s: is not reached with {asked}: {near}{advice}")

