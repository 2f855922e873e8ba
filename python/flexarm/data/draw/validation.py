"""Recordings beside the model's results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ..._check import Array
from .style import BLUE, INK, RED, Figure, label_axes, new_figure


class Curves(NamedTuple):
    """One recording: its title, its times (s), the start of its evaluation (s), and by the name of an axis the measured
    values, the model's, and its NRMSE (%)."""

    title: str
    t: Array
    since: float
    panels: Mapping[str, tuple[Array, Array, float]]


def plot_recordings(recordings: Sequence[Curves]) -> Figure:
    """A column for each recording, a panel for each quantity."""
    names = list(dict.fromkeys(name for r in recordings for name in r.panels))
    fig = new_figure(1.0 + 5.5 * len(recordings), 0.8 + 1.9 * len(names))
    grid = fig.subplots(len(names), len(recordings), sharex="col", sharey="row", squeeze=False)
    for k, recording in enumerate(recordings):
        for i, name in enumerate(names):
            ax = grid[i, k]
            last = i == len(names) - 1
            label_axes(ax, name if k == 0 else "", "Time (s)" if last else "")
            if name not in recording.panels:
                continue
            measured, model, error = recording.panels[name]
            ax.plot(recording.t, measured, color=INK, linewidth=2.2, alpha=0.45, label="measured")
            ax.plot(recording.t, model, color=BLUE, linewidth=1.1, label="model")
            if recording.since > recording.t[0]:
                ax.axvline(recording.since, color=RED, linewidth=1.0, linestyle="--", label="judged from here on")
            score = f"NRMSE {error:.1f} %"
            ax.set_title(f"{recording.title}: {score}" if i == 0 else score, fontsize=10, loc="left", parse_math=False)
    axes = max(fig.axes, key=lambda ax: len(ax.get_lines()))
    fig.legend(*axes.get_legend_handles_labels(), loc="outside upper center", frameon=False, fontsize=9, ncols=3)
    fig.align_ylabels()
    return fig
