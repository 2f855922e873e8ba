"""Poles, Nyquist and Bode diagrams, root loci."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._check import Array
from .style import BLUE, INK, PALETTE, RED, Axes, Figure, label_axes, new_figure

_FEW = 4  # loops whose names fit in a diagram
_SLOW = 8  # slowest poles, which set the limits of the s-plane


def _window(s: NDArray[np.complex128]) -> tuple[float, float]:
    """Limits of the s-plane, to the left and upwards: the slower poles, and all unstable ones, are inside."""
    finite = s[np.isfinite(s)]
    slow = finite[np.argsort(np.abs(finite))][: max(_SLOW, 1)]
    grown = finite[finite.real > 0]
    seen = np.concatenate([slow, grown])
    up = float(np.abs(seen.imag).max(initial=0.0))
    left = float(np.abs(seen.real).max(initial=0.0))
    return 1.25 * max(left, 1e-2 * up, 1e-9), 1.2 * max(up, 0.3 * left, 1e-9)


def _crosses(ax: Axes, poles: NDArray[np.complex128], good: NDArray[np.bool_]) -> None:
    """Blue crosses at the poles that fall, larger red ones at those that grow."""
    ax.plot(poles.real[good], poles.imag[good], "x", color=BLUE, ms=8, mew=1.8, label="falls")
    if not good.all():
        ax.plot(poles.real[~good], poles.imag[~good], "x", color=RED, ms=10, mew=2.4, label="grows")


def _poles_s(ax: Axes, s: NDArray[np.complex128]) -> None:
    left, up = _window(s)
    right = max(0.25 * left, 1.3 * float(s.real[np.isfinite(s)].max(initial=0.0)))
    finite = s[np.isfinite(s)]
    _crosses(ax, finite, finite.real <= 0)
    ax.axvline(0.0, color=INK, lw=1.2)
    ax.set_xlim(-left, right)
    ax.set_ylim(-up, up)
    hidden = int(((np.abs(finite.imag) > up) | (finite.real < -left)).sum())
    more = f"; {hidden} farther out" if hidden else ""
    ax.set_title(f"poles s{more}", fontsize=10, loc="left")
    label_axes(ax, "imaginary part (rad/s)", "real part (1/s)")


def _poles_z(ax: Axes, z: NDArray[np.complex128]) -> None:
    angle = np.linspace(0, 2 * np.pi, 400)
    ax.plot(np.cos(angle), np.sin(angle), color=INK, lw=1.2)
    _crosses(ax, z, np.abs(z) <= 1.0 + 1e-9)
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_title("poles z, and the unit circle", fontsize=10, loc="left")
    label_axes(ax, "imaginary part", "real part")


def _begin(w: Array, L: NDArray[np.complex128]) -> float:
    """First frequency of a Bode diagram (rad/s): a decade below the lowest corner or crossing of 1; below that both
    curves are straight lines."""
    gain, turn = np.abs(L), np.unwrap(np.angle(L))
    if len(w) < 3 or not gain.all():
        return float(w.min(initial=0.0))
    second = min(int(np.searchsorted(w, 2 * w[0])), len(w) - 1)
    slope = np.round(np.log(gain[second] / gain[0]) / np.log(w[second] / w[0]))  # minus the number of integrators
    bent = np.abs(np.log(gain / gain[0]) - slope * np.log(w / w[0])) > 0.1  # by a pole or zero at about twice that w
    bends = 2 * w[bent | (np.abs(turn - turn[0]) > np.radians(30))]
    crossings = w[1:][(gain[1:] > 1) != (gain[:-1] > 1)]
    return float(0.1 * min([*bends[:1], *crossings[:1]], default=0.0))


def plot_loop(s: NDArray[np.complex128], z: Any, curves: Sequence[tuple[Any, Any, Any]]) -> Figure:
    """Poles s, or z where there are some; and (margins, frequencies, loop gain) of each channel."""
    from matplotlib.ticker import MultipleLocator

    fig = new_figure(11.0, 7.6 if curves else 4.4)
    axes = fig.subplots(2, 2) if curves else np.array([[fig.subplots(), None], [None, None]])
    _poles_s(axes[0, 0], s) if z is None else _poles_z(axes[0, 0], z)
    if not curves:
        return fig
    nyquist, gain, phase = axes[0, 1], axes[1, 0], axes[1, 1]
    angle = np.linspace(0, 2 * np.pi, 400)
    nyquist.plot(np.cos(angle), np.sin(angle), color="#BBBBBB", lw=1.0, ls="--")
    begin = min(_begin(w[np.isfinite(L)], L[np.isfinite(L)]) for _, w, L in curves)
    for (m, w, L), colour in zip(curves, [PALETTE[k % len(PALETTE)] for k in range(len(curves))], strict=True):
        good = np.isfinite(L)
        w, L = w[good], L[good]
        nyquist.plot(L.real, L.imag, color=colour, lw=1.4)
        shown = w >= begin
        gain.loglog(w[shown], np.abs(L[shown]), color=colour, lw=1.4, label=m.name)
        phase.semilogx(w[shown], np.degrees(np.unwrap(np.angle(L)))[shown], color=colour, lw=1.4)
        if np.isfinite(m.phase_frequency):
            gain.plot(m.phase_frequency, 1.0, "o", color=colour, ms=7, mfc="white", mew=1.6)
    nyquist.plot(-1.0, 0.0, "+", color=INK, ms=16, mew=2.8, zorder=5)
    nyquist.set_xlim(-3.2, 3.2)
    nyquist.set_ylim(-2.4, 2.4)
    nyquist.set_aspect("equal", adjustable="box")
    nyquist.set_title("loop gain L (cross: the point -1)", fontsize=10, loc="left")
    gain.axhline(1.0, color=INK, lw=1.0)
    label_axes(nyquist, "imaginary part", "real part")
    label_axes(gain, "|L|", "frequency (rad/s)")
    label_axes(phase, "phase of L (deg)", "frequency (rad/s)")
    gain.set_title("gain (circle: the phase margin is read here)", fontsize=10, loc="left")
    phase.set_title("phase", fontsize=10, loc="left")
    low, high = gain.get_ylim()
    gain.set_ylim(max(low, 1e-6), min(high, 1e6))  # undamped modes have infinite peaks
    phase.yaxis.set_major_locator(MultipleLocator(90))
    if len(curves) <= _FEW:
        gain.legend(frameon=False, fontsize=9, loc="lower left")
    else:  # a legend inside would hide the curves
        longest = max(len(m.name) for m, _, _ in curves)
        ncols = min(6, max(1, 165 // (longest + 8)))  # as many as fit into the figure's width
        handles = gain.get_legend_handles_labels()
        fig.legend(*handles, loc="outside lower center", ncols=ncols, frameon=False, fontsize=9)
    return fig


def plot_locus(over: str, values: Any, poles: NDArray[np.complex128], crossings: Sequence[Any]) -> Figure:
    """Poles (m, n) over values (m,), and where they cross."""
    fig = new_figure(11.0, 4.6)
    ax, growth = fig.subplots(1, 2)
    name = "factor of the gains" if over == "gain" else over
    spread = values[0] > 0 and values[-1] / values[0] > 20
    from matplotlib.colors import LogNorm, Normalize
    from matplotlib.ticker import LogLocator, NullLocator

    norm = LogNorm(values[0], values[-1]) if spread else Normalize(values[0], values[-1])
    middle = poles[len(values) // 2]
    left, up = _window(np.concatenate([poles[0], middle, poles[-1]]))
    for column in poles.T:
        points = ax.scatter(column.real, column.imag, c=values, cmap="viridis", norm=norm, s=9, zorder=3)
    ax.plot(poles[0].real, poles[0].imag, "x", color=INK, ms=8, mew=1.6, label=f"at {values[0]:.4g}", zorder=4)
    for k, (value, frequency) in enumerate(crossings):
        ax.plot([0, 0], [frequency, -frequency], "D", color=RED, ms=8, mfc="none", mew=1.8, zorder=5,
                label=f"crosses at {value:.4g}" if k < 4 else None)  # fmt: skip
        growth.axvline(value, color=RED, lw=1.2, ls="--")
    ax.axvline(0, color=INK, lw=1.2)
    seen = poles.real[np.isfinite(poles.real) & (np.abs(poles.imag) <= up)]
    ax.set_xlim(-left, max(0.2 * left, 1.15 * float(seen.max(initial=0.0))))
    ax.set_ylim(-0.02 * up, up)
    label_axes(ax, "imaginary part (rad/s)", "real part (1/s)")
    ax.legend(frameon=False, fontsize=9, loc="upper left")
    bar = fig.colorbar(points, ax=ax, label=name)
    worst = np.nanmax(poles.real, axis=1)
    growth.plot(values, worst, color=BLUE, lw=1.6)
    growth.axhline(0, color=INK, lw=1.2)
    if spread:
        growth.set_xscale("log")
    if spread and values[-1] / values[0] < 100:  # one or two powers of ten: too few labels
        for axis in (bar.long_axis, growth.xaxis):
            axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_locator(NullLocator())
    span = float(np.nanmax(np.abs(worst[np.isfinite(worst)]))) or 1.0
    low, high = float(np.nanmin(worst)), float(np.nanmax(worst))
    growth.set_ylim(max(-1.1 * span, low - 0.05 * span), 1.05 * max(high, 0.1 * span))
    label_axes(growth, "growth of the fastest pole (1/s)", name)
    return fig


def plot_map(over: tuple[str, str], x: Array, y: Array, growth: Array, now: tuple[float, float]) -> Figure:
    """The growth (ny, nx) over two parameters: coloured where it falls, grey where it grows."""
    fig = new_figure(7.4, 5.4)
    ax = fig.subplots()
    falls = np.where(growth < 0.0, -growth, np.nan)
    ax.set_facecolor("#DDDDDD")
    if np.isfinite(falls).any():
        from matplotlib.colors import LogNorm

        high = float(np.nanmax(falls))
        colours = ax.pcolormesh(x, y, falls, cmap="viridis", norm=LogNorm(1e-3 * high, high), shading="nearest")
        fig.colorbar(colours, ax=ax, label="decay of the slowest motion (1/s)")
    if np.isfinite(falls).any() and np.isnan(falls).any():
        level = np.arcsinh(1e3 * growth / np.nanmax(falls))  # growths are far larger on one side
        ax.contour(x, y, np.where(np.isfinite(level), level, -1e3), [0.0], colors=[RED], linewidths=2.0)
        ax.plot([], [], color=RED, lw=2.0, label="boundary (grey: unstable)")
    ax.plot(*now, "+", color=INK, ms=14, mew=2.6, label="now")
    for values, scale in ((x, ax.set_xscale), (y, ax.set_yscale)):
        if values[0] > 0 and values[-1] / values[0] > 20:
            scale("log")
    ax.set_xlim(x[0], x[-1])
    ax.set_ylim(y[0], y[-1])
    label_axes(ax, over[1], over[0])
    fig.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    return fig
