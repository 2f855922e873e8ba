"""Error against wall time of runs, log-log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from .._console import seconds
from .style import BLUE, GREEN, INK, ORANGE, PALETTE, RED, label_axes, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MARKERS, _DASHES = ("o", "s", "^", "D", "v", "P", "*"), ("-", "--", "-.", ":", (0, (6, 1, 1, 1, 1, 1)))
_COLOURS = (*PALETTE, "#8C564B", "#6B6B6B", "#17A2A2", "#A0A000")
_BEATEN = "#AAAAAA"

#: Of a run: wall time (s), error.
Point = tuple[float, float]


def scale_errors(ax: Axes, top: float = 10.0) -> None:
    """Both axes logarithmic; errors above `top` are not shown."""
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_ylim(top=min(top, ax.get_ylim()[1]))


def label_errors(ax: Axes, ylabel: str) -> None:
    """Names the axes: errors over wall times."""
    from matplotlib.ticker import FuncFormatter

    label_axes(ax, ylabel, "Wall time of one run")
    ax.xaxis.set_major_formatter(FuncFormatter(lambda t, _: seconds(t)))
    ax.xaxis.set_minor_formatter(FuncFormatter(lambda t, _: ""))


@dataclass(frozen=True)
class Line:
    """Runs of one model with one integrator, from loose to tight; `hollow`: with another method than the usual."""

    model: str
    integrator: str
    points: Sequence[Point]
    hollow: bool = False


def plot_lines(
    lines: Sequence[Line], front: Sequence[Point], integrators: Sequence[str], unsure: float, ylabel: str, title: str
) -> Figure:
    """A colour for each model, a marker and dash for each integrator, the Pareto front in black.

    Models timed at a single setting, because another order has less error in less time, are grey.

    Args:
        integrators: all that have a marker, in their order. unsure: errors below it are in a band: the truth itself is
            not known so well.
    """
    from matplotlib.lines import Line2D

    fig = new_figure(10.0, 6.4)
    ax = fig.subplots()

    def style(integrator: str) -> dict[str, Any]:
        k = integrators.index(integrator)
        return {"marker": _MARKERS[k % len(_MARKERS)], "linestyle": _DASHES[k % len(_DASHES)], "lw": 1.2, "ms": 5}

    points: dict[str, list[Point]] = {}
    for line in lines:
        points.setdefault(line.model, []).extend(line.points)
    busy = sorted((m for m, all_of_it in points.items() if len(all_of_it) > 1), key=lambda m: min(points[m])[0])
    colours = {m: _COLOURS[i % len(_COLOURS)] for i, m in enumerate(busy)}
    for line in lines:
        colour = colours.get(line.model, _BEATEN)
        face = "white" if line.hollow else colour
        ax.plot(*zip(*line.points, strict=True), color=colour, mfc=face, alpha=0.85, **style(line.integrator))
    if front:
        x, y = zip(*front, strict=True)
        ax.plot(x, y, color=INK, lw=2.2, drawstyle="steps-post", zorder=1, alpha=0.55)
        ax.plot(x, y, "o", ms=11, mfc="none", mec=INK, mew=1.4, zorder=5)
    if lines:
        scale_errors(ax)
        if ax.get_ylim()[0] < unsure < float("inf"):
            ax.axhspan(ax.get_ylim()[0], unsure, color="#EEEEEE", zorder=0)
            note = f"the truth is known to {unsure:.1e}"
            ax.text(0.01, unsure, note, transform=ax.get_yaxis_transform(), va="top", fontsize=9, color=INK)
    else:
        ax.text(0.5, 0.5, "nothing to compare yet", transform=ax.transAxes, ha="center", color=INK)
    label_errors(ax, ylabel)
    handles = [Line2D([], [], color=c, lw=3, label=m) for m, c in colours.items()]
    if len(points) > len(colours):
        handles.append(Line2D([], [], color=_BEATEN, marker=".", ls="", ms=10, label="beaten models"))
    used = {line.integrator for line in lines}
    handles += [Line2D([], [], color=INK, label=name, **style(name)) for name in integrators if name in used]
    handles.append(Line2D([], [], color=INK, marker="o", ms=10, mfc="none", lw=2.2, alpha=0.7, label="Pareto front"))
    ax.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False, fontsize=9)
    ax.set_title(title, fontsize=11, fontweight="bold", parse_math=False)
    return fig


def plot_tried(
    models: Sequence[Point], settings: Sequence[Point], own: Point | None, chosen: Point, tol: float, absolute: bool,
    ylabel: str, title: str,
) -> Figure:  # fmt: skip
    """What was tried for a tolerance: models, settings of the lean model's integrators, the scene's own model (None
    where it cannot be run), and what was chosen.

    Args:
        absolute: whether errors have a unit; else they are shares, and those above 10 are not shown.
    """
    from matplotlib.ticker import LogLocator

    fig = new_figure(9.0, 5.4)
    ax = fig.subplots()
    groups = (
        ("models, at some 400 times", models, BLUE, "o"),
        ("the lean model, integrators, all output times", settings, ORANGE, "s"),
    )
    for label, points, colour, marker in groups:
        ax.plot([x for x, _ in points], [y for _, y in points], marker, color=colour, alpha=0.75, ms=6, label=label)
    if own is not None:
        ax.plot(*own, "^", color=RED, ms=11, mfc="none", mew=2, label="the scene's own model")
    ax.plot(*chosen, "o", ms=15, mfc="none", mec=INK, mew=2, label="chosen")
    ax.axhline(tol, color=GREEN, lw=1.5, ls="--")
    ax.text(0.99, tol, "tolerance ", transform=ax.get_yaxis_transform(), ha="right", va="bottom", color=GREEN)
    scale_errors(ax, float("inf") if absolute else 10.0)
    ax.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    label_errors(ax, ylabel)
    ax.set_title(title, fontsize=10, fontweight="bold", parse_math=False, wrap=True)
    ax.legend(frameon=False, fontsize=9, loc="best")
    return fig
