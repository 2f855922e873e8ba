"""Figures: of a result, and of the paper's Fig. 8, 9 and 10. No pyplot, no display, no global state."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import ConnectionPatch, Rectangle

from ._check import Array

if TYPE_CHECKING:
    from .arm import Arm
    from .demo import Manoeuvre, Spectrum
    from .reading import Reading
    from .result import Result

#: Okabe and Ito's colours, told apart by colour-blind readers too.
BLUE, ORANGE, GREEN, PURPLE, SKY, RED = "#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00"
PALETTE = (BLUE, RED, GREEN, PURPLE, ORANGE, SKY)
INK = "#333333"
DPI = 150

_ORDER_NAME = {
    0: "order 0, simplified",
    1: "order 1, linear",
    2: "order 2, quadratic",
}
_ORDER_COLOUR = {0: ORANGE, 1: PURPLE, 2: BLUE}
_ORDER_DASH = {0: "--", 1: "-.", 2: "-"}


def joint_coordinates(arm: Arm) -> list[tuple[int, str, str]]:
    """(index into q, label, unit) of every joint coordinate of an arm; units are rad or m, or 1 of a quaternion."""
    out, names = [], arm.q_names
    for k, link in enumerate(arm.links):
        first = arm._core.first_q(k)
        units = link.joint.units[:-3] + ("1",) * 4 if link.joint.ball else link.joint.units
        out += [(first + n, names[first + n], unit) for n, unit in enumerate(units)]
    return out


def joint_rates(arm: Arm) -> list[tuple[int, str, str]]:
    """(index into v and tau, label, unit of what it is the rate of, rad or m) of every joint rate of an arm."""
    firsts = [(arm._core.first(k), link.joint.units) for k, link in enumerate(arm.links)]
    return [(i, arm.coordinates[i], unit) for first, units in firsts for i, unit in enumerate(units, first)]


def deflections(arm: Arm) -> list[tuple[int, int, str]]:
    """(link, component, label) of every tip deflection an arm's beams can have; component 1 is y, 2 is z."""
    out = []
    for k, link in enumerate(arm.links):
        for component, axis in ((1, "y"), (2, "z")):
            if link.beam and any(link.beam.counts.get(f"{strain}_{axis}") for strain in ("bending", "shear")):
                out.append((k, component, f"link {k} tip {axis}"))
    return out


def _axes(ax: Axes, ylabel: str, xlabel: str = "") -> None:
    ax.set_ylabel(ylabel)
    ax.set_xlabel(xlabel)
    ax.grid(True, color="#DDDDDD", linewidth=0.6)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)


def _legend(ax: Axes, count: int) -> None:
    """Beside the axes, where it hides no curve; none for a single unnamed curve."""
    if count:
        columns = 1 + (count - 1) // 12
        ax.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False, fontsize=9, ncols=columns)


def plot_result(result: Result) -> Figure:
    """Joint coordinates (rad, m, quaternions) and tip deflections of the flexible links (m) over time (s)."""
    arm, t = result.arm, result.t
    joints = joint_coordinates(arm)
    panels: list[tuple[str, list[tuple[str, Array]]]] = []
    for unit, name in (("rad", "Joint angle (rad)"), ("m", "Joint displacement (m)"), ("1", "Quaternion of a ball")):
        curves = [(label, result.q[:, i]) for i, label, u in joints if u == unit]
        if curves:
            panels.append((name, curves))
    tips = {k: result.tip_deflection(k) for k in sorted({k for k, _, _ in deflections(arm)})}
    bent = [(label, tips[k][:, component]) for k, component, label in deflections(arm)]
    if bent:
        panels.append(("Tip deflection (m)", bent))
    if not panels:
        position = result.frame()[0]
        panels.append(("Position of the end (m)", [(axis, position[:, i]) for i, axis in enumerate("xyz")]))

    fig = Figure(figsize=(9.0, 0.8 + 2.6 * len(panels)), layout="constrained")
    grid = fig.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    marker = "o" if len(t) == 1 else None
    for ax, (ylabel, curves) in zip(grid, panels, strict=True):
        for i, (label, y) in enumerate(curves):
            colour, dash = PALETTE[i % len(PALETTE)], ("-", "--", "-.", ":")[i // len(PALETTE) % 4]
            ax.plot(t, y, label=label, color=colour, linestyle=dash, marker=marker, linewidth=1.4)
        _axes(ax, ylabel)
        _legend(ax, len(curves))
    grid[-1].set_xlabel("Time (s)")
    fig.align_ylabels()
    return fig


def _order_line(ax: Axes, order: int, x: Array, y: Array, label: str | None = None) -> None:
    ax.plot(x, y, _ORDER_DASH[order], color=_ORDER_COLOUR[order], label=label, linewidth=2.0)


def _mode_panel(ax: Axes, s: Spectrum, mode: int, rest: float, change: float, measured: float) -> None:
    """One mode of Fig. 8: the paper's values (rad/s, %) as points, what it measured (Hz) as text."""
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
    _axes(ax, "Frequency (rad/s)", "Hub speed (rad/s)")


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
    _axes(ax, "Frequency (rad/s)", "Hub speed (rad/s)")


def figure_8(
    s: Spectrum, paper_rest: tuple[float, ...], paper_change: tuple[float, ...], measured: tuple[float, ...]
) -> Figure:
    """Fig. 8: frequencies (rad/s) against hub speed (rad/s), orders 0, 1, 2, and where order 1 loses mode 1.

    `paper_rest` in rad/s, `paper_change` in % at the highest speed, `measured` in Hz at rest; one a mode.
    """
    fig = Figure(figsize=(10.0, 7.6), layout="constrained")
    axes = fig.subplots(2, 2).ravel()
    for mode in range(3):
        _mode_panel(axes[mode], s, mode, paper_rest[mode], paper_change[mode], measured[mode])
    _loss_panel(axes[3], s)
    handles, labels = axes[0].get_legend_handles_labels()
    rank = [2, 1, 0, 3]  # drawn 1, 0, 2, so that the stiffening one lies on top
    names = [labels[i] for i in rank]
    axes[0].legend([handles[i] for i in rank], names, loc="lower left", frameon=False)
    fig.suptitle("Fig. 8: effect of the centrifugal force on the natural frequencies", fontsize=13)
    return fig


def figure_9(m: Manoeuvre) -> Figure:
    """Fig. 9: the joint manoeuvre; position (rad), velocity (rad/s), acceleration (rad/s^2) over time (s)."""
    r = m.results[2]
    fig = Figure(figsize=(9.0, 7.6), layout="constrained")
    axes = fig.subplots(3, 1, sharex=True)
    names = ("Hub position\n(rad)", "Hub velocity\n(rad/s)", "Hub acceleration\n(rad/s²)")
    for ax, y, name in zip(axes, (r.q[:, 0], r.v[:, 0], r.a[:, 0]), names, strict=True):
        ax.plot(r.t, y, color=BLUE, linewidth=2.0)
        _axes(ax, name)
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


def _inset(ax: Axes, m: Manoeuvre, window: tuple[float, float], height: tuple[float, float]) -> None:
    """The peaks of the cruise, enlarged as in the paper: s, m."""
    box = ax.inset_axes((0.52, 0.64, 0.42, 0.35))
    for order in (0, 2):
        _order_line(box, order, m.results[order].t, m.tip(order))
        t, y = m.peak[order]
        box.plot([t], [y], "o", color=_ORDER_COLOUR[order], markersize=6)
        box.plot([t, t], [height[0], y], ":", color=INK, linewidth=1.2)
    low = height[0] + 0.12 * (height[1] - height[0])
    first, second = m.peak[2][0], m.peak[0][0]
    arrow = {"arrowstyle": "<->", "color": INK, "shrinkA": 0, "shrinkB": 0}
    box.annotate("", (first, low), (second, low), arrowprops=arrow)
    box.text(second + 8e-4, low, f"{1e3 * m.lead:.1f} ms", va="center", fontsize=9, color=INK)
    box.set_xlim(*window)
    box.set_ylim(*height)
    box.yaxis.tick_right()
    box.tick_params(labelsize=8)
    box.grid(True, color="#DDDDDD", linewidth=0.6)
    size = window[1] - window[0], height[1] - height[0]
    ax.add_patch(Rectangle((window[0], height[0]), *size, fill=False, edgecolor=INK, linewidth=1.0))
    for here, there in zip(height, (0.0, 1.0), strict=True):
        line = ConnectionPatch((window[0], here), (0.0, there), ax.transData, box.transAxes, color=INK, alpha=0.5)
        line.set_in_layout(False)
        ax.add_artist(line)


def figure_10(m: Manoeuvre, window: tuple[float, float], height: tuple[float, float]) -> Figure:
    """Fig. 10: tip displacement (m) over time (s), orders 0 and 2; inset of `window` (s) by `height` (m)."""
    fig = Figure(figsize=(10.0, 6.0), layout="constrained")
    ax = fig.subplots()
    for order in (0, 2):
        _order_line(ax, order, m.results[order].t, m.tip(order), f"{_ORDER_NAME[order]}, 3 modes")
    _axes(ax, "Tip displacement (m)", "Time (s)")
    ax.set_xlim(m.results[2].t[0], m.results[2].t[-1])
    ax.set_ylim(-0.13, 0.25)
    ax.set_yticks(np.arange(-0.10, 0.11, 0.05))
    ax.axvspan(*m.cruise, color="#EEEEEE", zorder=0)
    ax.text(sum(m.cruise) / 2, -0.126, "cruise at 7.6 rad/s", ha="center", va="bottom", fontsize=9, color=INK)
    _inset(ax, m, window, height)
    ax.legend(loc="upper left", frameon=False)
    fig.suptitle("Fig. 10: tip displacement during the reconstructed manoeuvre", fontsize=13)
    return fig


def plot_reading(reading: Reading) -> Figure:
    """The samples of a sensor over time (s), each held until the next; a panel for each unit."""
    units = list(dict.fromkeys(reading.units))
    fig = Figure(figsize=(9.0, 1.0 + 2.8 * len(units)), layout="constrained")
    panels = fig.subplots(len(units), 1, squeeze=False, sharex=True)[:, 0]
    for ax, unit in zip(panels, units, strict=True):
        own = [k for k, u in enumerate(reading.units) if u == unit]
        for k, colour in zip(own, PALETTE, strict=False):
            line = {"color": colour, "linewidth": 1.2, "drawstyle": "steps-post"}
            ax.plot(reading.t, reading.y[:, k], label=reading.labels[k], **line)
        name = reading.labels[own[0]] if len(own) == 1 else reading.labels[own[0]].rsplit(" ", 1)[0]
        _axes(ax, f"{name} ({unit})" if unit != "1" else name, "Time (s)" if ax is panels[-1] else "")
        _legend(ax, len(own) if len(own) > 1 else 0)
    fig.suptitle(reading.name, fontsize=12)
    return fig
