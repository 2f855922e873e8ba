"""Error against processor time of runs, log-log."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from textwrap import wrap
from typing import Any

import numpy as np

from ..._console import seconds
from .style import GREEN, INK, ORANGE, ORDER_COLOURS, RED, Axes, Figure, label_axes, new_figure, short, words

_MARKERS: tuple[Any, ...] = ("o", "s", "^", "D", "v", "p", "*", "P", "X", "<", ">", "h")
_FILLS = ("full", "none", "left", "top", "right", "bottom")
_DASHES: tuple[Any, ...] = ("-", "--", "-.", ":", (0, (6, 1, 1, 1, 1, 1)), (0, (2, 3)))
_SIZE = (7.6, 5.2)  # of the axes of a chart (inches), about
_TOP = 10.0  # shares of a span: larger errors are drawn at the upper edge
_SMALL = 8.5  # size of letters (pt)
_WIDE = 140  # letters of that size across a figure
_UNDER = 6  # lines under a title

#: A run: processor time (s), error.
Point = tuple[float, float]


def scale_errors(ax: Axes, top: float = _TOP) -> None:
    """Both axes logarithmic; errors above `top` are not shown."""
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_ylim(top=min(top, ax.get_ylim()[1]))


def label_errors(ax: Axes, ylabel: str) -> None:
    """Names the axes: errors over processor times."""
    from matplotlib.ticker import FuncFormatter, LogLocator

    label_axes(ax, ylabel, "Processor time of one run")
    low, high = ax.get_xlim()
    ax.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if high < 300 * low else (1,)))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda t, _: seconds(t)))
    ax.xaxis.set_minor_formatter(FuncFormatter(lambda t, _: ""))


@dataclass(frozen=True)
class Kind:
    """A model of a chart: the order of its beams' rotation ("as given": it has none), its modes, such as "3" or "2+1",
    and their basis; "": the scene's."""

    order: int | str
    modes: str
    basis: str = ""


@dataclass(frozen=True)
class Line:
    """Runs of one model with one integrator, in order of falling tolerance."""

    kind: Kind
    integrator: str
    points: Sequence[Point]


@dataclass(frozen=True)
class Cheapest:
    """A run that no other run beats in both time and error, with its text for the list under the chart."""

    time: float
    error: float
    words: str


def _marker(i: int) -> Any:
    return _MARKERS[i] if i < len(_MARKERS) else (i - len(_MARKERS) + 5, 1, 0)  # then stars, each with one point more


def _modes_first(modes: str) -> tuple[int, int, str]:
    """Sort key of modes in the legend: few modes first."""
    counts = [int(n) for n in modes.split("+") if n.isdigit()]
    return sum(counts), len(counts), modes


def _distinct(kinds: Iterable[Kind]) -> tuple[list[int | str], list[str], list[str]]:
    """The orders, modes and bases that occur, in the order of the legend."""
    kinds = list(kinds)
    orders = [o for o in ORDER_COLOURS if any(k.order == o for k in kinds)]
    modes = sorted({k.modes for k in kinds}, key=_modes_first)
    return orders, modes, sorted({k.basis for k in kinds})  # "" is first


def model_styles(kinds: Iterable[Kind]) -> dict[Kind, dict[str, Any]]:
    """A distinct style for each model: colour for the order, marker for the modes, filling for the basis."""
    kinds = list(dict.fromkeys(kinds))
    _, modes, bases = _distinct(kinds)
    return {
        k: {
            "color": ORDER_COLOURS[k.order], "markerfacecoloralt": "white",
            "marker": _marker(modes.index(k.modes)), "fillstyle": _FILLS[bases.index(k.basis) % len(_FILLS)],
        }
        for k in kinds
    }  # fmt: skip


def _dash(integrator: str, integrators: Sequence[str]) -> Any:
    return _DASHES[integrators.index(integrator) % len(_DASHES)]


def _chart_legend(ax: Axes, lines: Sequence[Line], integrators: Sequence[str], front: bool) -> None:
    """Adds a legend of colours, markers, fillings and dashes beside the axes."""
    from matplotlib.lines import Line2D

    orders, modes, bases = _distinct(line.kind for line in lines)
    used = {line.integrator for line in lines}

    def entry(label: str, **look: Any) -> Line2D:
        return Line2D([], [], label=label, **{"color": INK, "ls": "", "ms": 6.5, "markerfacecoloralt": "white", **look})

    groups: list[tuple[str, list[Line2D]]] = []
    if orders != ["as given"]:
        words = {o: "exact" if o == "exact" else "rigid arm" if o == "as given" else f"order {o}" for o in orders}
        groups.append(("Rotation: colour", [entry(words[o], color=ORDER_COLOURS[o], ls="-", lw=3) for o in orders]))
        groups.append(("Modes: marker", [entry(m or "none", marker=_marker(k)) for k, m in enumerate(modes)]))
    if len(bases) > 1:
        some = [entry(b or "the scene's", marker="o", fillstyle=_FILLS[k % len(_FILLS)]) for k, b in enumerate(bases)]
        groups.append(("Basis: filling", some))
    named = [entry(n, ls=_dash(n, integrators), lw=1.4) for n in integrators if n in used]
    groups.append(("Integrator: line", named))
    if front:
        ring = entry("no other has less\nerror in less time", marker="o", ms=10, mfc="none", ls="-", lw=2, alpha=0.7)
        groups.append(("The cheapest", [ring]))
    handles = [h for title, some in groups for h in (entry(title), *some)]
    shown = ax.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.01, 1.02), frameon=False, fontsize=_SMALL)
    titles = {title for title, _ in groups}
    for text in shown.get_texts():
        if text.get_text() in titles:
            text.set_fontweight("bold")
            text.set_x(text.get_position()[0] - 26)  # aligned with the lines of the entries


def _add_numbers(ax: Axes, front: Sequence[Point]) -> None:
    """Numbers the ringed runs, each to the lower left of its point, where no run can be, apart from the others."""
    box = {"boxstyle": "round,pad=0.12", "fc": "white", "ec": "none", "alpha": 0.8}
    rings = (ax.transData + ax.transAxes.inverted()).transform(front) * _SIZE
    taken = np.empty((0, 2))
    for k, ring in enumerate(rings):
        away = next(r for r in 0.13 * np.arange(1, 99) if (np.linalg.norm(ring - r - taken, axis=1) > 0.19).all())
        taken = np.vstack([taken, ring - away])
        ax.annotate(str(k + 1), front[k], (-72 * away, -72 * away), textcoords="offset points", ha="center",
                    va="center", fontsize=9, zorder=7, bbox=box)


def _clipped(points: Sequence[Point], top: float, low: float = 0.0) -> list[Point]:
    """Points with values beyond a limit moved onto it."""
    return [(t, max(min(error, top), low)) for t, error in points]


def plot_lines(
    lines: Sequence[Line], front: Sequence[Cheapest], integrators: Sequence[str], unsure: float, ylabel: str,
    title: str, notes: Sequence[str] = (), given_up: Sequence[float] = (),
) -> Figure:  # fmt: skip
    """Models and integrators of a chart, the cheapest ringed, numbered and listed below.

    Models timed at a single setting, because another model beats them in both error and time, are pale.

    Args:
        front: the cheapest, fastest first. integrators: all that have a dash, in their order.
        unsure: uncertainty of the reference; smaller errors are drawn in a band.
        notes: warnings, written in red under the title.
        given_up: wall time limit (s): runs beyond it are crosses at the upper edge.
    """
    from matplotlib.ticker import NullLocator

    styles = model_styles(line.kind for line in lines)
    low = unsure / 10 if unsure < float("inf") else 0.0
    least = min([_TOP, *(error for line in lines for _, error in line.points)])
    known = ""
    if lines and max(least, low) < 1.5 * unsure:
        known = "grey: how near the richest model is to the truth is not known"
        if low:
            known = f"grey: the uncertainty of the reference, {unsure:.1e}; errors below {low:.0e} are drawn there"
    listed = [f"{k}  {run.words}: {seconds(run.time)}, error {run.error:.1e}" for k, run in enumerate(front, 1)]
    listed = [short(row, _WIDE) for row in listed] + ([f"\n{known}"] if known else [])
    under = 0.1 + 0.175 * (len(listed) + bool(known))  # inches
    fig = new_figure(10.0, 6.2 + under)
    grid = fig.add_gridspec(2, 1, height_ratios=[6.0, under])
    ax, below = fig.add_subplot(grid[0]), fig.add_subplot(grid[1])
    below.set_axis_off()
    below.text(0.0, 1.0, "\n".join(listed), transform=below.transAxes, va="top", fontsize=_SMALL, color=INK,
               parse_math=False).set_in_layout(False)  # it may reach below the legend
    count: dict[Kind, int] = {}
    for line in lines:
        count[line.kind] = count.get(line.kind, 0) + len(line.points)
    for line in lines:
        points = _clipped(line.points, _TOP, low)
        pale = 0.3 if count[line.kind] == 1 else 0.85
        look = {**styles[line.kind], "ls": _dash(line.integrator, integrators), "lw": 1.2, "ms": 6}
        ax.plot(*zip(*points, strict=True), alpha=pale, **look)
    if front:
        x, y = zip(*_clipped([(run.time, run.error) for run in front], _TOP, low), strict=True)
        ax.plot(x, y, color=INK, lw=2.2, drawstyle="steps-post", zorder=1, alpha=0.45)
        ax.plot(x, y, "o", ms=11, mfc="none", mec=INK, mew=1.3, zorder=5)
    if lines:
        scale_errors(ax, 2 * _TOP)
        if known:
            top = min(unsure, ax.get_ylim()[1])
            ax.axhspan(ax.get_ylim()[0], top, color="#EEEEEE", zorder=0)
        if any(error > _TOP for line in lines for _, error in line.points):
            notes = [*notes, f"Errors above {_TOP:g} spans are drawn at {_TOP:g}."]
    else:
        ax.text(0.5, 0.5, "nothing to compare yet", transform=ax.transAxes, ha="center", color=INK)
    for t in given_up:
        ax.plot([t], [0.985], "x", color=RED, ms=7, transform=ax.get_xaxis_transform(), zorder=6)
    label_errors(ax, ylabel)
    if not lines:
        ax.xaxis.set_major_locator(NullLocator())
    _chart_legend(ax, lines, integrators, bool(front))
    if front:
        _add_numbers(ax, list(zip(x, y, strict=True)))
    _add_title(fig, ax, title, notes)
    return fig


def _add_title(fig: Figure, ax: Axes, title: str, notes: Sequence[str], under: str = "") -> None:
    fig.suptitle(words(title), fontsize=12, fontweight="bold", wrap=True)
    note_lines = [line for note in notes for line in wrap(note, _WIDE - 25)]
    if under:
        lines = wrap(under, _WIDE - 35)
        lines = lines if len(lines) <= _UNDER else [*lines[: _UNDER - 1], f"{lines[_UNDER - 1]} ..."]
        room = 6.0 + 13.0 * len(note_lines)  # of the notes
        ax.set_title("\n".join(lines), fontsize=10, color=INK, loc="left", pad=room, parse_math=False)
    if note_lines:
        look: dict[str, Any] = {"fontsize": 9, "color": RED, "parse_math": False}
        ax.text(0.0, 1.012, "\n".join(note_lines), va="bottom", transform=ax.transAxes, **look)


@dataclass(frozen=True)
class Trial:
    """A trial of the choice of a model: processor time (s), error, and order of the model; "as given": a rigid arm."""

    time: float
    error: float
    order: int | str


def plot_trials(
    models: Sequence[Trial], settings: Sequence[Point], given: Point | None, chosen: Point, tol: float, absolute: bool,
    ylabel: str, title: str, under: str, notes: Sequence[str] = (),
) -> Figure:  # fmt: skip
    """The trials for a tolerance: models by their order, settings of the cheapest model's integrators, the scene as
    given (None if it cannot be run), and the choice.

    Args:
        absolute: whether errors have a unit; else they are shares, and those above 10 are drawn at 10.
        under: text under the title, in smaller letters.
        notes: warnings, written in red under the title.
    """
    top = float("inf") if absolute else _TOP
    fig = new_figure(10.0, 6.0)
    ax = fig.subplots()
    words: Mapping[int | str, str] = {"as given": "rigid", "exact": "exact rotation", "mixed": "orders mixed"}
    for order, colour in ORDER_COLOURS.items():
        some = [(run.time, min(run.error, top)) for run in models if run.order == order]
        if some:
            label = words.get(order, f"order {order}")
            ax.plot(*zip(*some, strict=True), "o", color=colour, alpha=0.75, ms=6, label=label)
    if settings:
        label = "the lean model, with\nother integrators and steps"
        ax.plot(*zip(*_clipped(settings, top), strict=True), "s", color=ORANGE, mec=INK, mew=0.6, ms=7, label=label)
    if given is not None:
        ax.plot(*_clipped([given], top)[0], "^", color=RED, ms=11, mfc="none", mew=2, label="the scene as given")
    ax.plot(*_clipped([chosen], top)[0], "o", ms=15, mfc="none", mec=INK, mew=2, label="chosen")
    ax.axhline(tol, color=GREEN, lw=1.5, ls="--")
    ax.text(0.99, tol, "tolerance ", transform=ax.get_yaxis_transform(), ha="right", va="bottom", color=GREEN)
    scale_errors(ax, 2 * top)
    label_errors(ax, ylabel)
    _add_title(fig, ax, title, notes, under)
    head = "Dots: models, compared\nat about 400 instants;\nothers: at all output times\n"
    at = (1.01, 1.0)
    ax.legend(
        frameon=False, fontsize=9, loc="upper left", bbox_to_anchor=at, title=head, alignment="left", labelspacing=0.9
    )
    return fig
