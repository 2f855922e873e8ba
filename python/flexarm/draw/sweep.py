"""Columns over parameters: what a sweep shows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .._check import Array
from .style import BLUE, label_axes, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def _log(values: Array) -> bool:
    """Whether positive values over more than a decade are better seen on a logarithmic axis."""
    good = values[np.isfinite(values)]
    return bool(good.size and good.min() > 0 and good.max() > 20 * good.min())


def _map(figure: Figure, ax: Axes, axes: dict[str, Array], values: Array, label: str) -> None:
    (y_name, y), (x_name, x) = axes.items()
    order = np.argsort(y), np.argsort(x)
    z = np.ma.masked_invalid(values.reshape(y.size, x.size)[np.ix_(*order)])
    from matplotlib.colors import LogNorm

    norm = LogNorm() if _log(values) else None
    ax.set_facecolor("#BBBBBB")  # of what failed
    found = ax.pcolormesh(x[order[1]], y[order[0]], z, shading="nearest", cmap="viridis", norm=norm)
    figure.colorbar(found, ax=ax, label=label)
    ax.set(xlabel=x_name, ylabel=y_name)
    _scales(ax, x, y)


def _scales(ax: Axes, x: Array, y: Array) -> None:
    if _log(x):
        ax.set_xscale("log")
    else:
        ax.locator_params(axis="x", nbins=5)
    if _log(y):
        ax.set_yscale("log")


def _points(ax: Axes, x: Array, y: Array, labels: tuple[str, str], joined: bool) -> None:
    if joined:
        order = np.argsort(x)
        ax.plot(x[order], y[order], "o-", color=BLUE, markersize=3.5, linewidth=1.2)
    else:
        size = float(np.clip(2000 / max(1, y.size), 2, 14))
        ax.scatter(x, y, s=size, color=BLUE, alpha=0.7, linewidths=0)
    label_axes(ax, labels[1], labels[0])
    _scales(ax, x, y)


def plot_sweep(
    columns: Sequence[tuple[str, Array]],
    parameters: Sequence[tuple[str, Array]],
    grid: dict[str, Array] | None,
    joined: bool,
    title: str,
) -> Figure:
    """Columns (label, values (n,)) of n runs over their parameters (name, values (n,)).

    Args:
        grid: the values of two parameters whose runs fill a grid, row by row: heat maps then; None: points.
        joined: whether points of a single parameter are joined by lines.
    """
    shown: Any
    if grid is not None and len(grid) == 2 and all(v.size > 1 for v in grid.values()):
        figure = new_figure(5.6 * len(columns), 4.4)
        for ax, (label, values) in zip(np.atleast_1d(figure.subplots(1, len(columns))), columns, strict=True):
            _map(figure, ax, grid, values, label)
    else:
        wide = len(parameters)
        figure = new_figure(1.2 + 4.0 * wide, 0.6 + 2.9 * len(columns))
        shown = figure.subplots(len(columns), wide, squeeze=False, sharey="row", sharex="col")
        for i, (label, values) in enumerate(columns):
            for k, (name, numbers) in enumerate(parameters):
                under, beside = name if i + 1 == len(columns) else "", label if k == 0 else ""
                _points(shown[i][k], numbers, values, (under, beside), joined and wide == 1)
    figure.suptitle(title, fontsize=11, parse_math=False)
    return figure
