"""A fit: measured and fitted columns, what is left of them, and its autocorrelation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np

from .._check import Array
from .style import BLUE, INK, RED, label_axes, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


class Table(Protocol):
    """Columns over time."""

    @property
    def t(self) -> Array: ...
    @property
    def units(self) -> Mapping[str, str]: ...
    def __getitem__(self, name: str) -> Array: ...


class Pair(Protocol):
    """Measured and simulated columns."""

    @property
    def measured(self) -> Table: ...
    @property
    def simulated(self) -> Table: ...
    @property
    def nrmse(self) -> Mapping[str, float]: ...


class Correlated(Protocol):
    """Residuals' autocorrelation at lags 1, 2, ..."""

    @property
    def correlation(self) -> Array: ...


def plot_fit(pairs: Sequence[Pair], tests: Sequence[Mapping[str, Correlated]]) -> Figure:
    """Of each column a panel for each run, with what is left below, and the autocorrelation of that at the end."""
    names = list(dict.fromkeys(name for pair in pairs for name in pair.nrmse))
    n = len(pairs)
    fig = new_figure(min(18.0, 4.5 + 5.0 * n), 0.5 + 3.2 * len(names))
    heights, widths = [2.0, 1.0] * len(names), [*[2.4] * n, 1.0]
    rows = fig.add_gridspec(2 * len(names), n + 1, height_ratios=heights, width_ratios=widths)
    for i, name in enumerate(names):
        for k, pair in enumerate(pairs):
            if name in pair.nrmse:
                top, below = fig.add_subplot(rows[2 * i, k]), fig.add_subplot(rows[2 * i + 1, k])
                _curves(top, below, pair, name, f"run {k}: " if n > 1 else "", i == len(names) - 1)
        counts = [len(p.measured.t) for p in pairs if name in p.nrmse]
        ax = fig.add_subplot(rows[2 * i : 2 * i + 2, n])
        _correlogram(ax, [t[name] for t in tests if name in t], counts, i == len(names) - 1)
    return fig


def _curves(top: Axes, below: Axes, pair: Pair, name: str, run: str, last: bool) -> None:
    t, unit = pair.measured.t, pair.measured.units[name]
    error = pair.simulated[name] - pair.measured[name]
    top.plot(t, pair.measured[name], color=BLUE, linewidth=1.6, label="measured")
    top.plot(t, pair.simulated[name], color=RED, linewidth=1.1, linestyle="--", label="fitted")
    below.plot(t, error, color=INK, linewidth=0.7)
    label_axes(top, f"{name} ({unit})" if unit not in ("", "1") else name)
    label_axes(below, f"error ({unit})" if unit not in ("", "1") else "error", "Time (s)" if last else "")
    below.ticklabel_format(axis="y", scilimits=(-3, 4))
    top.set_title(f"{run}{name}, NRMSE {100 * pair.nrmse[name]:.3g} %", fontsize=10, loc="left", parse_math=False)
    top.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1, fontsize=8, frameon=False, ncols=2)
    top.tick_params(labelbottom=False)
    for ax in (top, below):
        ax.set_xlim(t[0], t[-1])


def _correlogram(ax: Axes, tests: Sequence[Correlated], counts: Sequence[int], last: bool) -> None:
    for k, (test, count) in enumerate(zip(tests, counts, strict=True)):
        lags = np.arange(1, len(test.correlation) + 1) + 0.15 * (k - (len(tests) - 1) / 2)
        ax.vlines(lags, 0, test.correlation, color=INK, linewidth=1.2)
        ax.plot(lags, test.correlation, "o", color=INK, markersize=2.5)
        bound = 1.96 / np.sqrt(count)
        ax.axhspan(-bound, bound, color=BLUE, alpha=0.12, linewidth=0, label="white, 95 %" if k == 0 else None)
    ax.axhline(0, color=INK, linewidth=0.6)
    ax.set_ylim(-1.05, 1.05)
    ax.set_title("autocorrelation of the error", fontsize=10, loc="left")
    ax.legend(loc="lower right", fontsize=8, frameon=False)
    label_axes(ax, "", "Lag (samples)" if last else "")
