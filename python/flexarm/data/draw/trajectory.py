"""Curves over time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from ..._check import Array
from .style import PALETTE, Figure, label_axes, legend, new_figure, short, words

_DASHES = ("-", "--", "-.", ":")
_LETTERS = 32  # of a name along an axis


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
        panels.append((f"{short(name, _LETTERS)} ({unit})".strip() if unit not in ("", "1") else name, own))
    return panels


def plot_panels(t: Array, panels: Sequence[Panel], title: str = "", held: bool = False) -> Figure:
    """Curves over time (s), (nt,), one panel below the other; `held`: each value stands until the next."""
    fig = new_figure(9.0, 0.8 + 2.6 * len(panels))
    grid = fig.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    marker = "o" if len(t) == 1 else None
    for ax, (ylabel, curves) in zip(grid, panels, strict=True):
        for i, (label, y) in enumerate(curves):
            colour, dash = PALETTE[i % len(PALETTE)], _DASHES[i // len(PALETTE) % len(_DASHES)]
            look = {"marker": marker, "drawstyle": "steps-post" if held else "default"}
            ax.plot(t, y, label=words(label), color=colour, linestyle=dash, linewidth=1.4, **look)
        label_axes(ax, short(ylabel, _LETTERS + 12))
        ax.ticklabel_format(axis="y", scilimits=(-3, 4))
        legend(ax, len(curves))
    grid[-1].set_xlabel("Time (s)")
    if title:
        fig.suptitle(words(title), fontsize=12, wrap=True)
    return fig
