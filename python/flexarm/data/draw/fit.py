"""A fit: measured and fitted columns, residuals, and their autocorrelation."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .style import BLUE, INK, RED, Axes, Figure, label_axes, new_figure, short

_FEW = 4  # columns in one stack of panels
_TALL = 12.0  # inches: height of most figures, at most


def plot_fit(pairs: Sequence[Any], tests: Sequence[Mapping[str, Any]]) -> Figure:
    """A panel for each column of each run, its residual below, and at the end the residuals' autocorrelation; many
    columns of one run stand in two rows side by side. Pairs are as of Comparison; the tests have the `correlation` at
    lags 1, 2, ..."""
    names = list(dict.fromkeys(name for pair in pairs for name in pair.nrmse))
    n, across = len(pairs), 2 if len(pairs) == 1 and len(names) > _FEW else 1
    down = -(-len(names) // across)
    height = min(3.2, max(1.5, _TALL / down))
    fig = new_figure(min(18.0, across * (3.5 + 4.0 * n) if across > 1 else 4.5 + 5.0 * n), 0.8 + height * down)
    heights, widths = [2.0, 1.0] * down, [*[2.4] * n, 1.0] * across
    grid = fig.add_gridspec(2 * down, across * (n + 1), height_ratios=heights, width_ratios=widths)
    letters = 42 if across == 1 else 34
    for i, name in enumerate(names):
        row, first, last = 2 * (i // across), (i % across) * (n + 1), i >= len(names) - across
        for k, pair in enumerate(pairs):
            if name in pair.nrmse:
                top, below = fig.add_subplot(grid[row, first + k]), fig.add_subplot(grid[row + 1, first + k])
                _curves(top, below, pair, name, f"run {k}: " if n > 1 else "", last, letters)
        counts = [len(p.measured.t) for p in pairs if name in p.nrmse]
        ax = fig.add_subplot(grid[row : row + 2, first + n])
        _correlogram(ax, [t[name] for t in tests if name in t], counts, last, i == 0)
    _add_legend(fig)
    return fig


def _add_legend(fig: Figure) -> None:
    """Adds a legend of the first panel's lines above all panels."""
    fig.legend(*fig.axes[0].get_legend_handles_labels(), loc="outside upper right", fontsize=9, frameon=False, ncols=2)


def plot_pair(pair: Any) -> Figure:
    """Measured and simulated columns over time, a panel for each."""
    names = list(pair.nrmse)
    across = 1 if len(names) <= _FEW else 2 if len(names) <= 3 * _FEW else 3
    down = -(-len(names) // across)
    fig = new_figure(9.0 if across == 1 else 6.0 * across, 0.8 + min(2.6, max(1.7, _TALL / down)) * down)
    grid = fig.subplots(down, across, sharex=True, squeeze=False)
    for i, ax in enumerate(grid.ravel()):
        if i < len(names):
            _panel(ax, pair, names[i], "simulated", "", 60 if across == 1 else 40)
            ax.set_xlabel("Time (s)" if i >= len(names) - across else "")
            ax.tick_params(labelbottom=i >= len(names) - across)
        else:
            ax.set_axis_off()
    _add_legend(fig)
    return fig


def _panel(ax: Axes, pair: Any, name: str, other: str, run: str, letters: int) -> None:
    t, unit = pair.measured.t, pair.measured.units[name]
    ax.plot(t, pair.measured[name], color=BLUE, linewidth=1.6, label="measured")
    ax.plot(t, pair.simulated[name], color=RED, linewidth=1.1, linestyle="--", label=other)
    label_axes(ax, unit if unit != "1" else "")
    ax.ticklabel_format(axis="y", scilimits=(-3, 4))
    ax.yaxis.get_offset_text().set_horizontalalignment("right")  # the title begins at the left
    title = f"{run}{short(name, letters)}, NRMSE {100 * pair.nrmse[name]:.3g} %"
    ax.set_title(title, fontsize=10, loc="left", parse_math=False)
    ax.set_xlim(t[0], t[-1])


def _curves(top: Axes, below: Axes, pair: Any, name: str, run: str, last: bool, letters: int) -> None:
    t = pair.measured.t
    _panel(top, pair, name, "fitted", run, letters)
    below.plot(t, pair.simulated[name] - pair.measured[name], color=INK, linewidth=0.7)
    label_axes(below, "error", "Time (s)" if last else "")
    below.ticklabel_format(axis="y", scilimits=(-3, 4))
    below.set_xlim(t[0], t[-1])
    top.tick_params(labelbottom=False)


def _correlogram(ax: Axes, tests: Sequence[Any], counts: Sequence[int], last: bool, first: bool) -> None:
    for k, (test, count) in enumerate(zip(tests, counts, strict=True)):
        lags = np.arange(1, len(test.correlation) + 1) + 0.15 * (k - (len(tests) - 1) / 2)
        ax.vlines(lags, 0, test.correlation, color=INK, linewidth=1.2)
        ax.plot(lags, test.correlation, "o", color=INK, markersize=2.5)
        bound = 1.96 / np.sqrt(count)
        ax.axhspan(-bound, bound, color=BLUE, alpha=0.12, linewidth=0, label="white, 95 %" if k == 0 else None)
    ax.axhline(0, color=INK, linewidth=0.6)
    ax.set_ylim(-1.05, 1.05)
    ax.set_title("its autocorrelation", fontsize=10, loc="left")
    if first:
        ax.legend(loc="lower right", fontsize=8, frameon=False)
    label_axes(ax, "", "Lag (samples)" if last else "")
