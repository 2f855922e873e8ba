"""Figures of a sweep: columns over parameters."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..._check import Array
from .style import BLUE, RED, Axes, Figure, label_axes, new_figure, short, words

_WIDE = 10.0  # inches: the widest figure whose letters stay readable on a page
_LETTER = 0.078  # inches, of a label
_FEW = 8  # values of a parameter that all have a tick
#: Reasons of a missing number, and their colours in maps.
MISSING = {"failed": "#6E6E6E", "not run yet": "#FFFFFF", "no value": "#C8C8C8"}


def _log(values: Array) -> bool:
    """Whether positive values over more than a decade are better seen on a logarithmic axis."""
    good = values[np.isfinite(values)]
    return bool(good.size and good.min() > 0 and good.max() > 20 * good.min())


def _map(figure: Figure, ax: Axes, axes: dict[str, Array], values: Array, label: str, why: Array) -> None:
    from matplotlib.colors import ListedColormap, LogNorm

    (y_name, y), (x_name, x) = axes.items()
    order = np.argsort(y), np.argsort(x)
    places = x[order[1]], y[order[0]]

    def cells(numbers: Array) -> Any:
        return numbers.reshape(y.size, x.size)[np.ix_(*order)]

    norm, some = LogNorm() if _log(values) else None, np.isfinite(values).any()
    found = ax.pcolormesh(*places, np.ma.masked_invalid(cells(values)), shading="nearest", cmap="viridis", norm=norm)
    lost = np.ma.masked_less(cells(np.where(np.isfinite(values), -1, why)), 0)
    if lost.count():
        greys = ListedColormap(list(MISSING.values()))
        ax.pcolormesh(*places, lost, shading="nearest", cmap=greys, vmin=-0.5, vmax=len(MISSING) - 0.5)
    if some:
        figure.colorbar(found, ax=ax, label=words(f"{label}\n(grey: no number)" if lost.count() else label))
    else:
        ax.set_title(words(f"{label}: no number"), fontsize=10)
    ax.set(xlabel=words(_folded(x_name, 3.0)), ylabel=words(_folded(y_name, 3.0)))
    _scales(ax, x, y)
    _tick_values(ax.xaxis, x, 3.0)
    _tick_values(ax.yaxis, y, 3.0)


def _folded(name: str, inches: float) -> str:
    """A path in lines that fit, broken at its dots."""
    lines, most = [""], int(inches / _LETTER)
    for part in re.split(r"(?<=\.)(?=\D)|(?= \()", name):
        part = short(part, most)
        lines[-1:] = [lines[-1] + part] if len(lines[-1] + part) <= most else [lines[-1], part]
    return "\n".join(line.strip() for line in lines if line)


def _scales(ax: Axes, x: Array, y: Array) -> None:
    from matplotlib.ticker import EngFormatter, MaxNLocator

    for axis, set_scale, values in ((ax.xaxis, ax.set_xscale, x), (ax.yaxis, ax.set_yscale, y)):
        if _log(values):
            set_scale("log")
            continue
        axis.set_major_locator(MaxNLocator(5))
        if 0.0 < np.abs(values[np.isfinite(values)]).max(initial=0.0) < 1e-3:
            ax.ticklabel_format(axis="x" if axis is ax.xaxis else "y", scilimits=(-3, 4))
        if np.abs(values[np.isfinite(values)]).max(initial=0.0) >= 1e5:
            axis.set_major_formatter(EngFormatter(sep=""))  # 210G instead of 2.10 and a separate 1e11


def _tick_values(axis: Any, values: Array, inches: float) -> None:
    """Puts ticks at a parameter's values, if these are few and their labels do not overlap."""
    from matplotlib.axis import YAxis
    from matplotlib.ticker import EngFormatter, NullLocator

    few = np.unique(values[np.isfinite(values)])
    if not 0 < few.size <= _FEW:
        return
    write = EngFormatter(sep="") if np.abs(few).max() >= 1e5 else "{:.4g}".format
    labels = [write(float(f"{value:.4g}")) for value in few]
    places = np.log(few) if _log(values) else few
    letters = 1.5 if isinstance(axis, YAxis) else max(map(len, labels)) + 1.0  # from one label to the next
    if few.size > 1 and np.diff(places).min() / np.ptp(places) * inches < 0.09 * letters:  # inches a letter
        return
    axis.set_minor_locator(NullLocator())
    axis.set_ticks(few, labels)


def _points(ax: Axes, x: Array, y: Array, labels: tuple[str, str], joined: bool, why: Array, inches: float) -> None:
    if joined:
        order = np.argsort(x)
        ax.plot(x[order], y[order], "o-", color=BLUE, markersize=3.5, linewidth=1.2)
    else:
        size = float(np.clip(2000 / max(1, y.size), 2, 14))
        ax.scatter(x, y, s=size, color=BLUE, alpha=0.7, linewidths=0)
    label_axes(ax, labels[1], _folded(labels[0], inches))
    _scales(ax, x, y)
    _tick_values(ax.xaxis, x, inches)
    lost = ~np.isfinite(y) & (why != list(MISSING).index("not run yet"))
    if lost.any():
        ax.plot(x[lost], np.full(lost.sum(), 0.02), "x", color=RED, ms=5, transform=ax.get_xaxis_transform())


def _missing_legend(figure: Figure, missing: Mapping[str, int], maps: bool) -> None:
    """Adds a legend of the missing numbers below the panels."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    if maps:
        handles: list[Any] = [
            Patch(facecolor=MISSING[word], edgecolor="#888888", label=f"{word}: {n}") for word, n in missing.items()
        ]
    else:
        words = [f"{word}: {n}" for word, n in missing.items() if word != "not run yet"]
        handles = [Line2D([], [], color=RED, marker="x", ls="", label=f"without a number ({', '.join(words)})")]
        handles = handles if words else []
    if handles:
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False, fontsize=9)


def plot_sweep(
    columns: Sequence[tuple[str, Array]],
    parameters: Sequence[tuple[str, Array]],
    grid: dict[str, Array] | None,
    joined: bool,
    title: str,
    why: Array | None = None,
) -> Figure:
    """Columns (label, values (n,)) of n runs over their parameters (name, values (n,)).

    Args:
        grid: the values of two parameters whose runs fill a grid, row by row: heat maps then; None: points.
        joined: whether points of a single parameter are joined by lines.
        why: (n,), for runs whose values are nan, the index into MISSING; None: all have "no value".
    """
    count = len(columns)
    reasons = np.full(len(columns[0][1]) if count else 0, len(MISSING) - 1) if why is None else np.asarray(why)
    maps = grid is not None and len(grid) == 2 and all(v.size > 1 for v in grid.values())
    if maps and grid is not None:
        across = min(count, 2)
        down = -(-count // across)
        figure = new_figure(_WIDE if across == 2 else 6.5, 0.8 + 3.9 * down)
        panels = figure.subplots(down, across, squeeze=False).ravel()
        for ax, (label, values) in zip(panels, columns, strict=False):
            _map(figure, ax, grid, values, label, reasons)
        for ax in panels[count:]:
            ax.set_axis_off()
    else:
        wide = len(parameters)
        width = min(_WIDE, 2.2 + 4.4 * wide)
        inches = 0.7 * width / max(wide, 1)
        figure = new_figure(width, 0.8 + 2.4 * count)
        shown = figure.subplots(count, wide, squeeze=False, sharey="row", sharex="col")
        for i, (label, values) in enumerate(columns):
            for k, (name, numbers) in enumerate(parameters):
                under, beside = name if i + 1 == count else "", label if k == 0 else ""
                _points(shown[i][k], numbers, values, (under, beside), joined and wide == 1, reasons, inches)
    lost = np.any([~np.isfinite(values) for _, values in columns], axis=0) if count else np.zeros(0, dtype=bool)
    missing = {word: int((lost & (reasons == k)).sum()) for k, word in enumerate(MISSING)}
    _missing_legend(figure, {word: n for word, n in missing.items() if n}, maps)
    figure.suptitle(words(title), fontsize=12, fontweight="bold", wrap=True)
    return figure
