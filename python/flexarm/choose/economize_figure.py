"""The figure of `flexarm economize`: error against wall time of what was tried."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator

from .._console import seconds
from ..draw.style import BLUE, GREEN, INK, ORANGE, RED
from .trial import OutOfTime, Trial

if TYPE_CHECKING:
    from .economize import Plan


def own_run(plan: Plan) -> Trial | None:
    """A run of the scene's own model as it is given, in its own basis; None where it cannot be run."""
    walk = plan._walk
    try:
        own = walk.trials.run(walk.rungs.given, plan._found.base.options)
    except (OutOfTime, ValueError):
        return None
    return None if own.values is None else own


def plot_plan(plan: Plan) -> Figure:
    """Error against the check (or the reference, where there is none) over wall time (s) of every run, log-log, with
    the chosen one, the scene's own model and the tolerance marked."""
    walk, found = plan._walk, plan._found
    truth = found.check or found.reference
    fig = Figure(figsize=(9.0, 5.4), layout="constrained")
    ax = fig.subplots()
    own = own_run(plan)
    models = [r for r in walk.trials.runs.values() if not r.whole and r is not own]
    groups = (
        ("models, at some 400 times", models, BLUE, "o"),
        ("the lean model, integrators, all output times", found.settings, ORANGE, "s"),
    )
    least = 1e-4 * plan.tol
    for label, all_runs, colour, marker in groups:
        runs = [r for r in all_runs if r.values is not None and r is not truth]
        y = [max(walk.trials.distance(r, truth), least) for r in runs]
        ax.plot([r.time for r in runs], y, marker, color=colour, alpha=0.75, ms=6, label=label)
    if own is not None:
        y = [max(walk.trials.distance(own, truth), least)]
        ax.plot([own.time], y, "^", color=RED, ms=11, mfc="none", mew=2, label="the scene's own model")
    chosen = max(walk.trials.distance(found.lean, truth), least)
    ax.plot([found.lean.time], [chosen], "o", ms=15, mfc="none", mec=INK, mew=2, label="chosen")
    ax.axhline(plan.tol, color=GREEN, lw=1.5, ls="--")
    ax.text(0.99, plan.tol, "tolerance ", transform=ax.get_yaxis_transform(), ha="right", va="bottom", color=GREEN)
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_ylim(top=min(10.0 if not plan.absolute else np.inf, ax.get_ylim()[1]))
    ax.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda t, _: seconds(t)))
    ax.xaxis.set_minor_formatter(FuncFormatter(lambda t, _: ""))
    ax.grid(True, which="major", color="#DDDDDD", linewidth=0.6)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)
    ax.set_xlabel("Wall time of one run")
    unit = " ".join(plan.span) if plan.absolute else "over its span"
    ax.set_ylabel(f"Largest error of the {plan.quantity}, {unit}")
    word = "certified" if plan.certified else "not certified"
    title = f"{plan.given.name}: {plan.model} ({word})"
    ax.set_title(title, fontsize=10, fontweight="bold", parse_math=False, wrap=True)
    ax.legend(frameon=False, fontsize=9, loc="best")
    return fig
