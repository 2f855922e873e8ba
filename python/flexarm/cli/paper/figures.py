"""The paper's Fig. 7 to 10, 12 and 13."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..._check import Array
from ...data.draw.style import BLUE, INK, ORANGE, ORDER_COLOURS, RED, Axes, Figure, label_axes, new_figure
from .control import BAND, KP, KS, KV, PAPER_PEAKS, PAPER_RINGING, RATE, SAMPLES, STEEL, STEP, Control, tip_acceleration
from .single_link import INSET_HEIGHT, INSET_TIME, MEASURED_HERTZ, PAPER_CHANGE, PAPER_FREQUENCIES, Manoeuvre, Spectrum

_ORDER_NAME = {
    0: "order 0, simplified",
    1: "order 1, linear",
    2: "order 2, quadratic",
}
_ORDER_DASH = {0: "--", 1: "-.", 2: "-"}


def _order_line(ax: Axes, order: int, x: Array, y: Array, label: str | None = None) -> None:
    ax.plot(x, y, _ORDER_DASH[order], color=ORDER_COLOURS[order], label=label, linewidth=2.0)


def _mode_panel(ax: Axes, s: Spectrum, mode: int, rest: float, change: float, measured: float) -> None:
    """One mode of Fig. 8: the paper's values (rad/s, %) as points, its measured value (Hz) as text."""
    for order in (1, 0, 2):
        _order_line(ax, order, s.speeds, s.frequencies[order][:, mode], _ORDER_NAME[order])
    end, high = s.speeds[-1], rest * (1 + change / 100)
    rounding = [[0.0, 0.05 / 100 * rest]] * 2  # the paper prints a tenth of a per cent
    marker: dict[str, Any] = {"fmt": "o", "fillstyle": "none", "markersize": 8, "markeredgewidth": 1.6}
    marker |= {"color": INK, "capsize": 4, "label": "paper, with its rounding"}
    ax.errorbar([s.speeds[0], end], [rest, high], yerr=rounding, **marker)
    ax.annotate(
        f"paper +{change} %",
        (end, high),
        xytext=(-12, 7),
        textcoords="offset points",
        ha="right",
        va="bottom",
        fontsize=9,
        color=INK,
    )
    low, high = ax.get_ylim()
    ax.set_ylim(low, high + 0.15 * (high - low))
    text = f"measured at rest: {measured} Hz = {measured * 2 * np.pi:.1f} rad/s"
    paper = {"facecolor": "white", "edgecolor": "none", "pad": 1.5}
    ax.text(0.03, 0.97, text, transform=ax.transAxes, va="top", fontsize=9, color=INK, bbox=paper)
    ax.set_title(f"Mode {mode + 1}", fontsize=11, fontweight="bold")
    ax.ticklabel_format(useOffset=False)
    label_axes(ax, "Frequency (rad/s)", "Hub speed (rad/s)")


def _loss_panel(ax: Axes, s: Spectrum) -> None:
    for order in (1, 0, 2):
        _order_line(ax, order, s.wide_speeds, s.wide[order])
    ax.plot([s.loss], [0.0], "x", color=INK, markersize=10, mew=2.2, clip_on=False, zorder=5)
    ax.annotate(
        f"order 1 loses mode 1\nat {s.loss:.2f} rad/s",
        (s.loss, 0.0),
        xytext=(0.36, 0.14),
        textcoords="axes fraction",
        arrowprops={"arrowstyle": "->", "color": INK, "shrinkB": 7},
        ha="center",
        fontsize=10,
        color=INK,
    )
    ax.axvspan(s.speeds[0], s.speeds[-1], color="#EEEEEE", zorder=0)
    place: dict[str, Any] = {"transform": ax.get_xaxis_transform(), "ha": "center", "va": "top"}
    ax.text(float(s.speeds[-1]) / 2, 0.97, "range of Fig. 8", fontsize=9, color=INK, **place)
    ax.set_xlim(0, s.wide_speeds[-1])
    ax.set_ylim(bottom=0)
    ax.set_title("Mode 1, further on", fontsize=11, fontweight="bold")
    label_axes(ax, "Frequency (rad/s)", "Hub speed (rad/s)")


def figure_8(s: Spectrum) -> Figure:
    """Fig. 8: frequencies (rad/s) against hub speed (rad/s), orders 0, 1, 2; order 1 loses mode 1."""
    fig = new_figure(10.0, 7.6)
    axes = fig.subplots(2, 2).ravel()
    for mode in range(3):
        _mode_panel(axes[mode], s, mode, PAPER_FREQUENCIES[mode], PAPER_CHANGE[mode], MEASURED_HERTZ[mode])
    _loss_panel(axes[3], s)
    handles, labels = axes[0].get_legend_handles_labels()
    rank = [2, 1, 0, 3]  # drawn 1, 0, 2, the stiffening order on top
    names = [labels[i] for i in rank]
    axes[0].legend([handles[i] for i in rank], names, loc="lower left", frameon=False)
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
    axes[0].set_ylim(0, 5.3)
    axes[1].set_ylim(0, 8.8)
    axes[1].axhline(m.peak_speed, color=INK, linestyle=":", linewidth=1.2)
    text = f"peak {m.peak_speed:.2f} rad/s (paper: 7.6)"
    axes[1].text(r.t[-1], m.peak_speed - 0.15, text, ha="right", va="top", color=INK)
    axes[2].set_xlabel("Time (s)")
    axes[2].set_xlim(r.t[0], r.t[-1])
    fig.align_ylabels()
    fig.suptitle("Fig. 9: joint manoeuvre, reconstructed from the paper's figures (not its data)", fontsize=13)
    return fig


def _inset(ax: Axes, box: Axes, m: Manoeuvre, window: tuple[float, float], height: tuple[float, float]) -> None:
    """The first peak of the cruise, enlarged as in the paper: s, m."""
    from matplotlib.patches import ConnectionPatch, Rectangle

    for order in (0, 2):
        _order_line(box, order, m.results[order].t, m.tip(order))
        t, y = m.peak[order]
        box.plot([t], [y], "o", color=ORDER_COLOURS[order], markersize=6)
        box.plot([t, t], [height[0], y], ":", color=INK, linewidth=1.2)
    low = height[0] + 0.15 * (height[1] - height[0])
    first, second = m.peak[2][0], m.peak[0][0]
    arrow = {"arrowstyle": "<->", "color": INK, "shrinkA": 0, "shrinkB": 0}
    box.annotate("", (first, low), (second, low), arrowprops=arrow)
    box.text(second + 5e-4, low, f"order 2 is {1e3 * m.lead:.1f} ms earlier", va="center", fontsize=9, color=INK)
    box.set_xlim(*window)
    box.set_ylim(*height)
    box.set_title("The paper's inset: first peak of the cruise", fontsize=10)
    label_axes(box, "Tip displacement (m)", "Time (s)")
    box.spines[["top", "right"]].set_visible(True)
    box.locator_params(axis="x", nbins=4)
    box.locator_params(axis="y", nbins=4)
    size = window[1] - window[0], height[1] - height[0]
    ax.add_patch(Rectangle((window[0], height[0]), *size, fill=False, edgecolor=INK, linewidth=1.2, zorder=5))
    for there in (0.0, 1.0):  # from the frame's lower corners to the inset's
        corner = (window[0] + there * size[0], height[1])
        line = ConnectionPatch(corner, (there, 0.0), ax.transData, box.transAxes, color=INK, alpha=0.5, zorder=0)
        line.set_in_layout(False)
        ax.add_artist(line)


def figure_10(m: Manoeuvre) -> Figure:
    """Fig. 10: tip displacement (m) over time (s), orders 0 and 2; the paper's inset above."""
    fig = new_figure(10.0, 8.0)
    grid = fig.add_gridspec(2, 2, height_ratios=[2.2, 4.0], width_ratios=[2.0, 3.0])
    words, box, ax = fig.add_subplot(grid[0, 0]), fig.add_subplot(grid[0, 1]), fig.add_subplot(grid[1, :])
    for order in (0, 2):
        _order_line(ax, order, m.results[order].t, m.tip(order), f"{_ORDER_NAME[order]}, 3 modes")
    label_axes(ax, "Tip displacement (m)", "Time (s)")
    ax.set_xlim(m.results[2].t[0], m.results[2].t[-1])
    ax.set_ylim(-0.13, 0.13)
    ax.axvspan(*m.cruise, color="#EEEEEE", zorder=-1)
    ax.text(sum(m.cruise) / 2, -0.126, "cruise at 7.6 rad/s", ha="center", va="bottom", fontsize=9, color=INK)
    words.set_axis_off()
    words.legend(*ax.get_legend_handles_labels(), loc="center left", frameon=False)
    _inset(ax, box, m, INSET_TIME, INSET_HEIGHT)
    fig.suptitle("Fig. 10: tip displacement during the reconstructed manoeuvre", fontsize=13)
    return fig


def figure_7(c: Control) -> Figure:
    """Fig. 7: power spectral density (1/Hz) of the root's strain over frequency (Hz) after an impact on the tip."""
    fig = new_figure(10.0, 5.8)
    ax = fig.subplots()
    look = {STEEL: (ORANGE, "--", "bare beam")}
    heavier = ""
    for density, s in c.fine.items():
        if density != STEEL:
            heavier = f"beam {100 * (density / STEEL - 1):.1f} % heavier (fitted)"
        colour, dash, name = look.get(density, (BLUE, "-", heavier))
        ax.plot(s.frequency, s.density, dash, color=colour, label=f"{name}, record of 8 s", linewidth=1.4)
    scale = max(s.density.max() for s in c.fine.values()) / c.coarse.density.max()
    name = f"{heavier}, record of {SAMPLES / RATE:.3g} s, drawn {scale:.2g} times as high"
    ax.plot(c.coarse.frequency, scale * c.coarse.density, ".-", color=INK, lw=0.6, ms=4, label=name)
    half = RATE / SAMPLES / 2
    for k, peak in enumerate(PAPER_PEAKS):
        bin_ = round(peak / (2 * half)) * 2 * half
        label = None if k else f"the paper's peak: one bin of {2 * half:.2g} Hz"
        ax.axvspan(bin_ - half, bin_ + half, color="#DDDDDD", zorder=0, label=label)
        text = f"paper {peak} Hz"
        ax.text(bin_ + 1.2 * half, 0.985, text, transform=ax.get_xaxis_transform(), va="top", fontsize=9, color=INK)
    ax.set_yscale("log")
    ax.set_xlim(0, 70)
    top = max(s.density.max() for s in c.fine.values())
    ax.set_ylim(1e-9 * top, 8 * top)
    label_axes(ax, "Power spectral density (1/Hz)", "Frequency (Hz)")
    fig.legend(loc="outside lower center", frameon=False, fontsize=9, ncols=2)
    fig.suptitle("Fig. 7: strain gauge at the root after an impact on the tip, joint held by friction", fontsize=13)
    return fig


def response(c: Control, ks: float, title: str) -> Figure:
    """Fig. 12 or 13: joint angle (rad) and tip acceleration (m/s^2) over time (s)."""
    r, m = c.runs[ks], c.marks[ks]
    fig = new_figure(9.0, 6.4)
    top, bottom = fig.subplots(2, 1, sharex=True)
    if ks:
        grey = c.runs[0.0]
        top.plot(grey.t, grey.q[:, 0], color="#AAAAAA", linewidth=1.2, label="PD alone (Fig. 12)")
        bottom.plot(grey.t, tip_acceleration(grey), color="#CCCCCC", linewidth=0.8)
    top.plot(r.t, r.q[:, 0], color=BLUE, linewidth=1.8, label="with strain feedback" if ks else "joint")
    top.axhline(STEP, color=INK, linestyle=":", linewidth=1.2, label="reference")
    top.axhspan((1 - BAND) * STEP, (1 + BAND) * STEP, color="#EEEEEE", zorder=0)
    told = f"rise {m.rise:.3f} s, overshoot {m.overshoot:.1f} %, settling {m.settling:.3f} s (±5 %)"
    told += f"\nstands still from {m.held:.2f} s, {m.error:+.1f} % off"
    top.text(0.98, 0.05, told, transform=top.transAxes, ha="right", va="bottom", fontsize=9, color=INK)
    top.set_ylim(0, 1.45 * STEP)
    top.legend(loc="upper right", frameon=False, fontsize=9, ncols=3)
    bottom.plot(r.t, tip_acceleration(r), color=BLUE, linewidth=1.0)
    for sign in (-1, 1):
        bottom.axhline(sign * PAPER_RINGING, color=RED, linestyle="--", linewidth=1.2)
    bottom.text(r.t[-1], PAPER_RINGING + 2, "paper, PD: ±50 m/s²", ha="right", va="bottom", fontsize=9, color=RED)
    bottom.set_ylim(-110, 110)
    bottom.set_xlim(0, r.t[-1])
    label_axes(top, "Joint angle (rad)")
    label_axes(bottom, "Tip acceleration (m/s²)", "Time (s)")
    fig.align_ylabels()
    fig.suptitle(title, fontsize=13)
    return fig


def figure_12(c: Control) -> Figure:
    """Fig. 12: PD alone."""
    return response(c, 0.0, f"Fig. 12: PD control, Kp {KP}, Kv {KV} (drive and step identified)")


def figure_13(c: Control) -> Figure:
    """Fig. 13: strain feedback."""
    return response(c, KS, f"Fig. 13: strain feedback, Ks {KS} (chosen; nothing else changed)")
