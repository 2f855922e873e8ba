"""Figures of sweeps."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .plots import BLUE, _axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ._check import Array
    from .sweep import SweepResult

_MOST = 4  # columns, and parameters, that a figure shows


def _log(values: Array) -> bool:
    """Whether positive values over more than a decade are better seen on a logarithmic axis."""
    good = values[np.isfinite(values)]
    return bool(good.size and good.min() > 0 and good.max() > 20 * good.min())


def _label(name: str, unit: str) -> str:
    return f"{name} ({unit})" if unit not in ("", "1") else name


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
    _axes(ax, labels[1], labels[0])
    _scales(ax, x, y)


def plot_sweep(result: SweepResult) -> Figure:
    """See SweepResult.plot."""
    from matplotlib.figure import Figure

    from .sweep_store import parameter_columns

    names, numbers = parameter_columns(result.parameters)
    shown = [(n, _label(n, result.units[n]), result.columns[n]) for n in list(result.columns)[:_MOST]]
    grid = result.plan.grid()
    axes: Any
    if grid is not None and len(grid) == 2 and all(v.size > 1 for v in grid.values()):
        figure = Figure(figsize=(5.6 * len(shown), 4.4), layout="constrained")
        for ax, (_, label, values) in zip(np.atleast_1d(figure.subplots(1, len(shown))), shown, strict=True):
            _map(figure, ax, grid, values, label)
    else:
        columns = min(_MOST, len(names))
        figure = Figure(figsize=(1.2 + 4.0 * columns, 0.6 + 2.9 * len(shown)), layout="constrained")
        axes = figure.subplots(len(shown), columns, squeeze=False, sharey="row", sharex="col")
        joined = len(names) == 1 and result.plan.vary[0].kind in ("grid", "list")
        for i, (_, label, values) in enumerate(shown):
            for k in range(columns):
                under, beside = names[k] if i + 1 == len(shown) else "", label if k == 0 else ""
                _points(axes[i][k], numbers[k], values, (under, beside), joined)
    failed = f"; {len(result.failures)} failed" if result.failures else ""
    left = "" if result.complete else f" of {len(result)}"
    figure.suptitle(f"{result.plan.title}: {int(result.done.sum())}{left} runs{failed}", fontsize=11, parse_math=False)
    return figure
