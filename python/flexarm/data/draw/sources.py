"""An error over time, the quantity within it, and its sources."""

from collections.abc import Mapping, Sequence

import numpy as np

from ..._check import Array
from .style import BLUE, GREEN, INK, ORANGE, RED, Figure, label_axes, new_figure, short, words

_COLOURS = (INK, ORANGE, BLUE)
_MOST = 12  # bars


def plot_error(
    t: Array, values: Array, errors: Mapping[str, Array], sources: Sequence[tuple[str, float]], at: float, name: str,
    unit: str, note: str = "",
) -> Figure:  # fmt: skip
    """Three panels: each component of the quantity `values` (nt, k) in the band of the first of the errors (nt,); the
    errors over time, in a logarithmic scale; and the sources as bars."""
    sources = sources[:_MOST]
    fig = new_figure(10.0, 5.0 + 0.25 * max(0, len(sources) - 6))
    grid = fig.add_gridspec(2, 2, width_ratios=[1.5, 1.0])
    top, below, bars = (fig.add_subplot(x) for x in (grid[0, 0], grid[1, 0], grid[:, 1]))
    words_of_unit = f" ({unit})" if unit else ""
    band = next(iter(errors.values()))
    moving = [k for k in range(values.shape[1]) if np.ptp(values[:, k]) > 1e-9 * np.ptp(values, axis=0).max()]
    for k, colour in zip(moving, (BLUE, RED, GREEN, ORANGE, INK), strict=False):
        y = values[:, k]
        axis = f" {'xyz'[k]}" if name == "tip" else f" {k}" if values.shape[1] > 1 else ""
        top.plot(t, y, color=colour, linewidth=1.0, label=words(f"{name}{axis}"))
        top.fill_between(t, y - band, y + band, color=colour, alpha=0.3, linewidth=0)
    label_axes(top, f"{name}{words_of_unit}")
    top.legend(fontsize=8, frameon=False)
    for (label, y), colour in zip(errors.items(), _COLOURS, strict=False):
        if y.any():
            below.plot(t, np.where(y > 0.0, y, np.nan), color=colour, linewidth=1.0, label=label)
    below.axvline(at, color=INK, linewidth=0.7, linestyle=":")
    below.set_yscale("log")
    least = float(band.max()) * 1e-6
    below.set_ylim(bottom=max(below.get_ylim()[0], least) if least > 0.0 else None)
    label_axes(below, f"error{words_of_unit}", "Time (s)")
    below.legend(fontsize=8, frameon=False)
    names = [words(short(label, 44)) for label, _ in sources][::-1]
    sizes = [x for _, x in sources][::-1]
    bars.barh(names, sizes, color=[BLUE if x >= 0 else RED for x in sizes], height=0.6)
    bars.axvline(0.0, color=INK, linewidth=0.7)
    label_axes(bars, "", f"part of the error at {at:.4g} s{words_of_unit}")
    bars.tick_params(labelsize=8)
    if note:
        fig.suptitle(words(short(note, 150)), fontsize=9, color=RED)
    return fig
