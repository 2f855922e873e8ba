"""The figure of `flexarm chart`: error against wall time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter

from .._console import seconds
from ..draw.style import INK, PALETTE
from .ladder import CHOICES, Row

if TYPE_CHECKING:
    from .chart import Chart

_MARKERS, _DASHES = ("o", "s", "^", "D", "v", "P", "*"), ("-", "--", "-.", ":", (0, (6, 1, 1, 1, 1, 1)))
_COLOURS = (*PALETTE, "#8C564B", "#6B6B6B", "#17A2A2", "#A0A000")


def _style(choice: str) -> dict[str, Any]:
    k = list(CHOICES).index(choice)
    return {"marker": _MARKERS[k % len(_MARKERS)], "linestyle": _DASHES[k % len(_DASHES)], "lw": 1.2, "ms": 5}


def _lines(chart: Chart) -> dict[tuple[str, str, str], list[Row]]:
    """Runs with an error by (model, choice, method), loose to tight."""
    out: dict[tuple[str, str, str], list[Row]] = {}
    for r in chart._graded:
        out.setdefault((r.model.label, r.choice, r.method), []).append(r)
    return {k: sorted(rows, key=lambda r: -r.value) for k, rows in out.items()}


def plot_chart(chart: Chart) -> Figure:
    """Error over the quantity's span against wall time (s), log-log: a colour for each model, a marker and dash for
    each integrator, the Pareto front in black, and a band where the truth itself is not known.

    Models timed at a single setting, because another order has less error in less time, are grey.
    """
    fig = Figure(figsize=(10.0, 6.4), layout="constrained")
    ax = fig.subplots()
    lines = _lines(chart)
    floor = max(chart._least, 1e-12)
    busy = [m for m in dict.fromkeys(k[0] for k in lines) if sum(len(v) for k, v in lines.items() if k[0] == m) > 1]
    quick = sorted(busy, key=lambda m: min(r.time for k, v in lines.items() for r in v if k[0] == m))
    colours = {m: _COLOURS[i % len(_COLOURS)] for i, m in enumerate(quick)}
    for (model, choice, method), rows in lines.items():
        if method != "ab" and all(d <= 1e-9 for d, _ in chart.methods.values()):
            continue
        y = [max(r.error or 0.0, floor) for r in rows]
        colour = colours.get(model, "#AAAAAA")
        face = colour if method == "ab" else "white"
        ax.plot([r.time for r in rows], y, color=colour, mfc=face, alpha=0.85, **_style(choice))
    front = chart.front
    x, y = [r.time for r in front], [max(r.error or 0.0, floor) for r in front]
    ax.plot(x, y, color=INK, lw=2.2, drawstyle="steps-post", zorder=1, alpha=0.55)
    ax.plot(x, y, "o", ms=11, mfc="none", mec=INK, mew=1.4, zorder=5)
    if lines:
        ax.set_xscale("log")
        ax.set_yscale("log")
        ax.set_ylim(top=min(10.0, ax.get_ylim()[1]))
    unsure = chart.truth.uncertainty if chart.truth else np.inf
    if lines and ax.get_ylim()[0] < unsure < np.inf:
        ax.axhspan(ax.get_ylim()[0], unsure, color="#EEEEEE", zorder=0)
        note = f"the truth is known to {unsure:.1e}"
        ax.text(0.01, unsure, note, transform=ax.get_yaxis_transform(), va="top", fontsize=9, color=INK)
    ax.xaxis.set_major_formatter(FuncFormatter(lambda t, _: seconds(t)))
    ax.xaxis.set_minor_formatter(FuncFormatter(lambda t, _: ""))
    ax.grid(True, which="major", color="#DDDDDD", linewidth=0.6)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)
    ax.set_xlabel("Wall time of one run")
    ax.set_ylabel(f"Largest error of the {chart.quantity}, over its span")
    handles = [Line2D([], [], color=c, lw=3, label=m) for m, c in colours.items()]
    if any(k[0] not in colours for k in lines):
        handles.append(Line2D([], [], color="#AAAAAA", marker=".", ls="", ms=10, label="beaten models"))
    used = {choice for _, choice, _ in lines}
    handles += [Line2D([], [], color=INK, label=name, **_style(name)) for name in CHOICES if name in used]
    handles.append(Line2D([], [], color=INK, marker="o", ms=10, mfc="none", lw=2.2, alpha=0.7, label="Pareto front"))
    ax.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False, fontsize=9)
    partial = "" if chart.complete else " (partial: interrupted)"
    spans = ", ".join(f"{s:.3g} {u}" for u, s in chart.truth.span.items()) if chart.truth else ""
    title = f"{chart.scene.name}: {chart.quantity}, span {spans}{partial}"
    ax.set_title(title, fontsize=11, fontweight="bold", parse_math=False)
    if not lines:
        ax.text(0.5, 0.5, "nothing to compare yet", transform=ax.transAxes, ha="center", color=INK)
    return fig
