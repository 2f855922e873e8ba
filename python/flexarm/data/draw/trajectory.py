"""Curves over time."""

from __future__ import annotations

from collections.abc import Sequence

from ..._check import Array
from .style import PALETTE, Figure, label_axes, legend, new_figure, short, words

_DASHES = ("-", "--", "-.", ":")
_LETTERS = 32  # of a name along an axis


def plot_panels(t: Array, panels: Sequence[tuple[str, Sequence[tuple[str, Array]]]]) -> Figure:
    """Curves over time (s), (nt,): panels (name of the axis, [(label, values (nt,)), ...]), one below the other."""
    fig = new_figure(9.0, 0.8 + 2.6 * len(panels))
    grid = fig.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    marker = "o" if len(t) == 1 else None
    for ax, (ylabel, curves) in zip(grid, panels, strict=True):
        for i, (label, y) in enumerate(curves):
            colour, dash = PALETTE[i % len(PALETTE)], _DASHES[i // len(PALETTE) % len(_DASHES)]
            ax.plot(t, y, label=words(label), color=colour, linestyle=dash, marker=marker, linewidth=1.4)
        label_axes(ax, short(ylabel, _LETTERS))
        ax.ticklabel_format(axis="y", scilimits=(-3, 4))
        legend(ax, len(curves))
    grid[-1].set_xlabel("Time (s)")
    return fig


def plot_samples(t: Array, y: Array, labels: Sequence[str], all_units: Sequence[str], title: str) -> Figure:
    """Samples y (n, k) over time (s), each held until the next; a panel for each unit."""
    units = list(dict.fromkeys(all_units))
    fig = new_figure(9.0, 1.0 + 2.8 * len(units))
    panels = fig.subplots(len(units), 1, squeeze=False, sharex=True)[:, 0]
    for ax, unit in zip(panels, units, strict=True):
        own = [k for k, u in enumerate(all_units) if u == unit]
        for i, k in enumerate(own):
            colour, dash = PALETTE[i % len(PALETTE)], _DASHES[i // len(PALETTE) % len(_DASHES)]
            ax.plot(t, y[:, k], dash, label=words(labels[k]), color=colour, linewidth=1.2, drawstyle="steps-post")
        name = labels[own[0]] if len(own) == 1 else labels[own[0]].rsplit(" ", 1)[0]
        name = short(name, _LETTERS)
        label_axes(ax, f"{name} ({unit})" if unit != "1" else name, "Time (s)" if ax is panels[-1] else "")
        legend(ax, len(own) if len(own) > 1 else 0)
    fig.suptitle(words(title), fontsize=12, wrap=True)
    return fig
