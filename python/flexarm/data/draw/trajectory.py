"""Curves over time, of one run or beside recordings."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

from ..._check import Array
from .style import BLUE, INK, PALETTE, RED, Figure, label_axes, legend, new_figure, short, words

_DASHES = ("-", "--", "-.", ":")
_LETTERS = 32  # of a name along an axis
_PANELS, _TALL = 8, 13.0  # in a column; inches of one that is full


#: name of the axis, [(label, values (nt,)), ...]
Panel = tuple[str, list[tuple[str, Array]]]


def by_unit(curves: Iterable[tuple[str, str, Array]], named: Callable[[str, str], str]) -> list[Panel]:
    """A panel for each unit of curves (label, unit, values); `named` tells from a unit and the first label how several
    curves are called together."""
    groups: dict[str, list[tuple[str, Array]]] = {}
    for label, unit, y in curves:
        groups.setdefault(unit, []).append((label, y))
    panels = []
    for unit, own in groups.items():
        name = own[0][0] if len(own) == 1 else named(unit, own[0][0])
        panels.append((f"{name} ({unit})".strip() if unit not in ("", "1") else name, own))
    return panels


def plot_panels(t: Array, panels: Sequence[Panel], title: str = "", held: bool = False) -> Figure:
    """Curves over time (s), (nt,), one panel below the other, many in columns side by side; `held`: each value stands
    until the next."""
    across = 1 + (len(panels) > _PANELS) + (len(panels) > 2 * _PANELS)
    down = -(-len(panels) // across)
    fig = new_figure(9.0 if across == 1 else 15.0, 0.8 + min(2.6, max(1.4, _TALL / down)) * down)
    grid = fig.subplots(down, across, sharex=True, squeeze=False).ravel()
    marker = "o" if len(t) == 1 else None
    listed: list[str] = []
    for ax in grid[len(panels) :]:
        ax.set_axis_off()
    for ax, (ylabel, curves) in zip(grid, panels, strict=False):
        for i, (label, y) in enumerate(curves):
            colour, dash = PALETTE[i % len(PALETTE)], _DASHES[i // len(PALETTE) % len(_DASHES)]
            look = {"marker": marker, "drawstyle": "steps-post" if held else "default"}
            ax.plot(t, y, label=words(label), color=colour, linestyle=dash, linewidth=1.4, **look)
        name = short(ylabel, _LETTERS)
        label_axes(ax, name)
        ax.ticklabel_format(axis="y", scilimits=(-3, 4))
        labels = [label for label, _ in curves]
        known = (len(curves) == 1 and name.startswith(labels[0])) or (across > 1 and labels == listed)
        legend(ax, 0 if known else len(curves))
        listed = labels
    for ax in grid[max(0, len(panels) - across) : len(panels)]:
        ax.set_xlabel("Time (s)")
        ax.tick_params(labelbottom=True)
        if across > 1:
            ax.locator_params(axis="x", nbins=4)
    if title:
        fig.suptitle(words(title), fontsize=12, wrap=True)
    return fig


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
    width = min(5.5, 15.0 / len(recordings))  # inches of a column
    fig = new_figure(1.0 + width * len(recordings), 0.8 + 1.9 * len(names))
    grid = fig.subplots(len(names), len(recordings), sharex="col", sharey="row", squeeze=False)
    for k, recording in enumerate(recordings):
        for i, name in enumerate(names):
            ax = grid[i, k]
            last = i == len(names) - 1
            label_axes(ax, short(name, 24) if k == 0 else "", "Time (s)" if last else "")
            if name not in recording.panels:
                continue
            measured, model, error = recording.panels[name]
            ax.plot(recording.t, measured, color=INK, linewidth=2.2, alpha=0.45, label="measured")
            ax.plot(recording.t, model, color=BLUE, linewidth=1.1, label="model")
            if recording.since > recording.t[0]:
                ax.axvline(recording.since, color=RED, linewidth=1.0, linestyle="--", label="judged from here on")
            score = f"NRMSE {error:.1f} %"
            title = f"{short(recording.title, int(10 * width) - 16)}: {score}" if i == 0 else score
            ax.set_title(title, fontsize=10, loc="left", parse_math=False)
    axes = max(fig.axes, key=lambda ax: len(ax.get_lines()))
    fig.legend(*axes.get_legend_handles_labels(), loc="outside upper center", frameon=False, fontsize=9, ncols=3)
    fig.align_ylabels()
    return fig
