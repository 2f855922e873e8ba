"""The paper's Fig. 7, 12 and 13. No pyplot, no display, no global state."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.figure import Figure

from .demo_control import BAND, KP, KS, KV, PAPER_PEAKS, PAPER_RINGING, RATE, SAMPLES, STEEL, STEP, tip_acceleration
from .plots import BLUE, INK, ORANGE, RED, _axes

if TYPE_CHECKING:
    from .demo_control import Control


def figure_7(c: Control) -> Figure:
    """Fig. 7: power spectral density (1/Hz) of the root's strain over frequency (Hz) after an impact on the tip."""
    fig = Figure(figsize=(10.0, 5.2), layout="constrained")
    ax = fig.subplots()
    look = {STEEL: (ORANGE, "--", "bare beam")}
    for density, s in c.fine.items():
        colour, dash, name = look.get(density, (BLUE, "-", f"mass +{100 * (density / STEEL - 1):.1f} % (fitted)"))
        ax.plot(s.frequency, s.density, dash, color=colour, label=f"{name}, 8 s", linewidth=1.4)
    scale = max(s.density.max() for s in c.fine.values()) / c.coarse.density.max()
    name = f"the same in {SAMPLES} samples at {RATE:g} Hz, times {scale:.2g}"
    ax.plot(c.coarse.frequency, scale * c.coarse.density, ".-", color=INK, lw=0.6, ms=4, label=name)
    half = RATE / SAMPLES / 2
    for k, peak in enumerate(PAPER_PEAKS):
        bin_ = round(peak / (2 * half)) * 2 * half
        ax.axvspan(bin_ - half, bin_ + half, color="#DDDDDD", zorder=0, label=None if k else "bin of the paper's peak")
        text = f"paper {peak} Hz"
        ax.text(bin_ + 1.2 * half, 0.985, text, transform=ax.get_xaxis_transform(), va="top", fontsize=9, color=INK)
    ax.set_yscale("log")
    ax.set_xlim(0, 70)
    top = max(s.density.max() for s in c.fine.values())
    ax.set_ylim(1e-9 * top, 8 * top)
    _axes(ax, "Power spectral density (1/Hz)", "Frequency (Hz)")
    ax.legend(loc="upper right", bbox_to_anchor=(0.78, 0.93), frameon=False, fontsize=9)
    fig.suptitle("Fig. 7: strain gauge at the root after an impact on the tip, joint held by friction", fontsize=13)
    return fig


def response(c: Control, ks: float, title: str) -> Figure:
    """Fig. 12 or 13: joint angle (rad) and tip acceleration (m/s^2) over time (s)."""
    r, m = c.runs[ks], c.marks[ks]
    fig = Figure(figsize=(9.0, 6.4), layout="constrained")
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
    _axes(top, "Joint angle (rad)")
    _axes(bottom, "Tip acceleration (m/s²)", "Time (s)")
    fig.align_ylabels()
    fig.suptitle(title, fontsize=13)
    return fig


def figure_12(c: Control) -> Figure:
    """Fig. 12: PD alone."""
    return response(c, 0.0, f"Fig. 12: PD control, Kp {KP}, Kv {KV} (drive and step identified)")


def figure_13(c: Control) -> Figure:
    """Fig. 13: strain feedback."""
    return response(c, KS, f"Fig. 13: strain feedback, Ks {KS} (chosen; nothing else changed)")
