"""Modes along an arm."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from .._check import Array
from .style import PALETTE, label_axes, legend, new_figure, words

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_modes(s: Array, moved: Array, labels: Sequence[str], joints: Sequence[tuple[float, str]]) -> Figure:
    """One panel for each world axis along which something moves.

    s: places along the arm (m), (np,). moved: displacements, (np, 3, n), to any scale. labels: of the modes. joints:
    where they sit along the arm, and whose they are.
    """
    axes_used = [c for c in range(3) if np.abs(moved[:, c]).max(initial=0.0) > 0.02] or [1]
    fig = new_figure(9.0, 1.2 + 2.4 * len(axes_used))
    axes = np.atleast_1d(fig.subplots(len(axes_used), 1, sharex=True))
    for ax, c in zip(axes, axes_used, strict=True):
        for k, label in enumerate(labels):
            style = "-" if k < len(PALETTE) else "--"
            ax.plot(s, moved[:, c, k], style, color=PALETTE[k % len(PALETTE)], lw=1.8, label=words(label))
        for place, _ in joints:
            ax.axvline(place, color="#999999", lw=1.0, ls=":")
        label_axes(ax, f"displacement along\nworld {'xyz'[c]} (1 = largest)")
        ax.set_ylim(-1.12, 1.12)
    axes[0].set_xlim(left=0.0)
    together: dict[float, list[str]] = {}  # joints at one place
    for place, name in joints:
        together.setdefault(next((x for x in together if abs(x - place) < 1e-6 * s[-1]), place), []).append(name)
    named = [(place, ", ".join(names)) for place, names in sorted(together.items())]
    room = [5.5 / s[-1] * (b[0] - a[0]) / len(a[1]) for a, b in pairwise(named)]  # inches a letter
    for place, name in named:
        axes[0].annotate(
            words(name), (place, 1.0), (2, 2), xycoords=("data", "axes fraction"), textcoords="offset points",
            fontsize=8, color="#666666", rotation=0 if min(room, default=1.0) > 0.08 else 40,
        )  # fmt: skip
    axes[-1].set_xlabel("place along the arm, from its base (m); dotted: joints")
    legend(axes[0], len(labels))
    return fig
