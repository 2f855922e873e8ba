"""The paper's Fig. 7 to 10, 12 and 13."""

import numpy as np

from ..._check import Array
from ...data.draw.style import BLUE, INK, ORANGE, ORDER_COLOURS, RED, Axes, Figure, label_axes, new_figure
from .control import BAND, KP, KS, KV, PAPER_PEAKS, PAPER_RINGING, RATE, SAMPLES, STEEL, STEP, Control, tip_acceleration
from .single_link import INSET_HEIGHT, INSET_TIME, MEASURED_HERTZ, PAPER_CHANGE, PAPER_FREQUENCIES, Manoeuvre, Spectrum

_ORDER_NAME = {0: "order 0, simplified", 1: "order 1, linear", 2: "order 2, quadratic"}
_ORDER_DASH = {0: "--", 1: "-.", 2: "-"}


def _order_line(ax: Axes, order: int, x: Array, y: Array) -> None:
    ax.plot(x, y, _ORDER_DASH[order], color=ORDER_COLOURS[order], label=_ORDER_NAME[order], linewidth=2.0)


def figure_8(s: Spectrum) -> Figure:
    """Fig. 8: frequencies (rad/s) against hub speed (rad/s), orders 0, 1, 2; order 1 loses mode 1."""
    fig = new_figure(10.0, 7.6)
    axes = fig.subplots(2, 2).ravel()
    paper = zip(PAPER_FREQUENCIES, PAPER_CHANGE, MEASURED_HERTZ, strict=True)
    for mode, (ax, (rest, change, hertz)) in enumerate(zip(axes, paper, strict=False)):
        for order in (1, 0, 2):
            _order_line(ax, order, s.speeds, s.frequencies[order][:, mode])
        ends, rounding = s.speeds[[0, -1]], [[0.0, 0.05 / 100 * rest]] * 2  # the paper prints a tenth of a per cent
        ax.errorbar(ends, [rest, rest * (1 + change / 100)], yerr=rounding, fmt="o", fillstyle="none", markersize=8,
                    color=INK, capsize=4, label="paper, with its rounding")
        ax.set_title(f"Mode {mode + 1}: paper +{change} %; measured at rest {hertz} Hz", fontsize=10)
        ax.ticklabel_format(useOffset=False)
    for order in (1, 0, 2):
        _order_line(axes[3], order, s.wide_speeds, s.wide[order])
    axes[3].plot([s.loss], [0.0], "x", color=INK, markersize=10, mew=2.2, clip_on=False, zorder=5)
    axes[3].axvspan(s.speeds[0], s.speeds[-1], color="#EEEEEE", zorder=0)
    axes[3].set_ylim(bottom=0)
    axes[3].set_title(f"Mode 1, further on: order 1 loses it at {s.loss:.2f} rad/s", fontsize=10)
    for ax in axes:
        label_axes(ax, "Frequency (rad/s)", "Hub speed (rad/s)")
    axes[0].legend(loc="lower left", frameon=False)
    fig.suptitle("Fig. 8: effect of the centrifugal force on the natural frequencies", fontsize=13)
    return fig


def figure_9(m: Manoeuvre) -> Figure:
    """Fig. 9: the joint manoeuvre; position (rad), velocity (rad/s), acceleration (rad/s^2) over time (s)."""
    r = m.results[2]
    fig = new_figure(9.0, 7.6)
    axes = fig.subplots(3, 1, sharex=True)
    names = ("Hub position\n(rad)", "Hub velocity\n(rad/s)", "Hub acceleration\n(rad/s²)")
    for ax, y, name in zip(axes, (r.q[:, 0], r.v[:, 0], r.a[:, 0]), names, strict=True):
        ax.plot(r.t, y, color=BLUE, linewidth=2.0)
        label_axes(ax, name)
    axes[1].axhline(m.peak_speed, color=INK, linestyle=":", linewidth=1.2)
    axes[1].set_title(f"peak {m.peak_speed:.2f} rad/s (paper: 7.6)", fontsize=10, loc="right")
    axes[2].set_xlabel("Time (s)")
    fig.align_ylabels()
    fig.suptitle("Fig. 9: joint manoeuvre, reconstructed from the paper's figures (not its data)", fontsize=13)
    return fig


def figure_10(m: Manoeuvre) -> Figure:
    """Fig. 10: tip displacement (m) over time (s), orders 0 and 2; the paper's inset above."""
    fig = new_figure(10.0, 8.0)
    box, ax = fig.subplots(2, 1, height_ratios=[2.2, 4.0])
    for order in (0, 2):
        for axes in (box, ax):
            _order_line(axes, order, m.results[order].t, m.tip(order))
        box.plot(*m.peak[order], "o", color=ORDER_COLOURS[order], markersize=6)
    box.set_xlim(*INSET_TIME)
    box.set_ylim(*INSET_HEIGHT)
    box.set_title(f"The paper's inset: first peak of the cruise; order 2 is {1e3 * m.lead:.1f} ms earlier", fontsize=10)
    ax.indicate_inset((INSET_TIME[0], INSET_HEIGHT[0], np.ptp(INSET_TIME), np.ptp(INSET_HEIGHT)), edgecolor=INK)
    ax.axvspan(*m.cruise, color="#EEEEEE", zorder=-1, label="cruise at 7.6 rad/s")
    for axes in (box, ax):
        label_axes(axes, "Tip displacement (m)", "Time (s)")
    ax.legend(loc="upper left", frameon=False)
    fig.suptitle("Fig. 10: tip displacement during the reconstructed manoeuvre, 3 modes", fontsize=13)
    return fig


def figure_7(c: Control) -> Figure:
    """Fig. 7: power spectral density (1/Hz) of the root's strain over frequency (Hz) after an impact on the tip."""
    fig = new_figure(10.0, 5.8)
    ax = fig.subplots()
    for density, s in c.fine.items():
        heavier = f"beam {100 * (density / STEEL - 1):.1f} % heavier (fitted)"
        look = (ORANGE, "--", "bare beam") if density == STEEL else (BLUE, "-", heavier)
        ax.plot(s.frequency, s.density, look[1], color=look[0], label=f"{look[2]}, record of 8 s", linewidth=1.4)
    top = max(s.density.max() for s in c.fine.values())
    scale = top / c.coarse.density.max()
    name = f"{heavier}, record of {SAMPLES / RATE:.3g} s, drawn {scale:.2g} times as high"
    ax.plot(c.coarse.frequency, scale * c.coarse.density, ".-", color=INK, lw=0.6, ms=4, label=name)
    width = RATE / SAMPLES
    for k, peak in enumerate(PAPER_PEAKS):
        middle = round(peak / width) * width
        label = None if k else f"the paper's peaks {PAPER_PEAKS} Hz: one bin of {width:.2g} Hz each"
        ax.axvspan(middle - width / 2, middle + width / 2, color="#DDDDDD", zorder=0, label=label)
    ax.set_yscale("log")
    ax.set_xlim(0, 70)
    ax.set_ylim(1e-9 * top, 8 * top)
    label_axes(ax, "Power spectral density (1/Hz)", "Frequency (Hz)")
    fig.legend(loc="outside lower center", frameon=False, fontsize=9, ncols=2)
    fig.suptitle("Fig. 7: strain gauge at the root after an impact on the tip, joint held by friction", fontsize=13)
    return fig


def _response(c: Control, ks: float, title: str) -> Figure:
    """Joint angle (rad) and tip acceleration (m/s^2) over time (s)."""
    r, m = c.runs[ks], c.marks[ks]
    fig = new_figure(9.0, 6.4)
    top, bottom = fig.subplots(2, 1, sharex=True)
    if ks:
        top.plot(r.t, c.runs[0.0].q[:, 0], color="#AAAAAA", linewidth=1.2, label="PD alone (Fig. 12)")
        bottom.plot(r.t, tip_acceleration(c.runs[0.0]), color="#CCCCCC", linewidth=0.8)
    top.plot(r.t, r.q[:, 0], color=BLUE, linewidth=1.8, label="with strain feedback" if ks else "joint")
    top.axhline(STEP, color=INK, linestyle=":", linewidth=1.2, label="reference")
    top.axhspan((1 - BAND) * STEP, (1 + BAND) * STEP, color="#EEEEEE", zorder=0)
    told = f"rise {m.rise:.3f} s, overshoot {m.overshoot:.1f} %, settling {m.settling:.3f} s (±5 %); "
    top.set_title(f"{told}stands still from {m.held:.2f} s, {m.error:+.1f} % off", fontsize=9, loc="left")
    top.legend(loc="lower right", frameon=False, fontsize=9)
    bottom.plot(r.t, tip_acceleration(r), color=BLUE, linewidth=1.0)
    for sign in (-1, 1):
        label = "paper, PD: ±50 m/s²" if sign > 0 else None
        bottom.axhline(sign * PAPER_RINGING, color=RED, linestyle="--", linewidth=1.2, label=label)
    bottom.legend(loc="upper right", frameon=False, fontsize=9)
    bottom.set_ylim(-110, 110)
    label_axes(top, "Joint angle (rad)")
    label_axes(bottom, "Tip acceleration (m/s²)", "Time (s)")
    fig.align_ylabels()
    fig.suptitle(title, fontsize=13)
    return fig


def figure_12(c: Control) -> Figure:
    """Fig. 12: PD alone."""
    return _response(c, 0.0, f"Fig. 12: PD control, Kp {KP}, Kv {KV} (drive and step identified)")


def figure_13(c: Control) -> Figure:
    """Fig. 13: strain feedback."""
    return _response(c, KS, f"Fig. 13: strain feedback, Ks {KS} (chosen; nothing else changed)")
