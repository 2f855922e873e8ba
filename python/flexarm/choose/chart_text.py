"""The table of `flexarm chart`."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from .._console import aligned, seconds
from .ladder import OVER_OUTPUTS, Row

if TYPE_CHECKING:
    from .chart import Chart, Truth

_SHOWN = 6  # failed or skipped runs listed one by one


def _absolute(span: dict[str, float], tol: float) -> str:
    return ", ".join(f"{tol * s:.2g} {u}" for u, s in span.items())


def _truth(truth: Truth) -> list[str]:
    row = truth.row
    lines = [f"Truth: {row.label}. Over the span, it is"]
    words = {"modes": "the next in fewer modes", "basis": "another basis", "order": "the next in lower order",
             "tolerance": "the next in looser " + row.setting}  # fmt: skip
    for name, word in words.items():
        d = getattr(truth, name)
        if d is None or d == math.inf:
            why = "it was not run" if d else "there is none"
            lines.append(f"  {'?' if d else '-':>7}  from {word}: {why}")
        else:
            cut = "; exact cuts nothing off" if name == "order" and row.model.order == "exact" else ""
            lines.append(f"  {d:7.1e}  from {word} ({truth.poorer[name]}{cut})")
    if truth.uncertainty > 1e-2:
        lines.append("It is NOT CONVERGED: errors below say little. Give more budget, a shorter scene, or more modes.")
    return lines


def _advice(chart: Chart, truth: Truth) -> list[str]:
    from .chart import TOLERANCES

    rows = [["for", "that is", "take this", "time", "error", ""]]
    unsure = False
    for tol in TOLERANCES:
        row = chart.recommend(tol)
        flag = "*" if tol < truth.uncertainty else ""
        unsure = unsure or bool(flag)
        head = [f"{tol:.0e}".replace("e-0", "e-"), _absolute(truth.span, tol)]
        if row is None or row.error is None:
            rows.append([*head, "none of those tried", "", "", flag])
        else:
            rows.append([*head, row.label, seconds(row.time), f"{row.error:.1e}", flag])
    lines = aligned(rows, frozenset({3, 4}))
    if unsure:
        known = "not known how far" if truth.uncertainty == math.inf else f"{truth.uncertainty:.1e}"
        lines.append(f"* finer than the truth is known ({known}): near the truth's model, not near the arm")
    return lines


def _models(chart: Chart, truth: Truth) -> list[str]:
    """Orders at the truth's modes, and modes at its order, at its tolerance."""
    it = truth.row
    same = [r for r in chart.rows if r.choice == it.choice and r.value == it.value and r.method == "ab"]
    orders = [r for r in same if r.model.shift == it.model.shift]
    modes = [r for r in same if r.model.order == it.model.order and r is not it]
    rows = [["model", "time", "error", ""]]
    for r in [*orders, *modes]:
        error = "truth" if r is it else f"{r.error:.1e}" if r.error is not None else r.status
        far = "bent beyond its range (RangeWarning)" if r.warning else ""
        rows.append([r.model.label, seconds(r.time) if r.status == "ok" else "", error, far])
    return [f"Models, by {it.choice} at {it.setting} {it.value:.3g}:", *aligned(rows, frozenset({1, 2}))]


def _methods(chart: Chart) -> list[str]:
    same = {k: ratio for k, (d, ratio) in chart.methods.items() if d <= 1e-9}
    lines = []
    if same:
        times = ", ".join(f"{k} {ratio:.2f}" for k, ratio in same.items())
        lines.append(
            "AB or CI: no difference in the trajectory (CI enters at the output accelerations only), so AB is charted; "
            f"CI's time over AB's: {times}"
        )
    for k, (d, ratio) in chart.methods.items():
        if k not in same:
            lines.append(f"AB or CI: {k} differs by {d:.1e}; CI takes {ratio:.2f} of AB's time; both are charted")
    return lines


def _left_out(rows: list[Row], word: str) -> list[str]:
    """One line for each model and integrator, its settings together."""
    groups: dict[tuple[str, str, str], list[Row]] = {}
    for r in rows:
        groups.setdefault((r.model.label, r.choice, r.setting), []).append(r)
    lines = [f"{len(rows)} {word}:"] if rows else []
    for (model, choice, setting), some in list(groups.items())[:_SHOWN]:
        reason = some[0].reason
        short = reason if len(reason) <= 80 else reason[:78].rsplit(" ", 1)[0] + " ..."
        values = ", ".join(f"{r.value:.3g}" for r in some)
        lines.append(f"  {model}, {choice}, {setting} {values}{' s' * (setting == 'step')}: {short}")
    if len(groups) > _SHOWN:
        lines.append(f"  and {sum(map(len, list(groups.values())[_SHOWN:]))} more, in chart.csv")
    return lines


def table(chart: Chart) -> str:
    """See Chart.table."""
    done, failed, skipped, cut = (chart.with_status(s) for s in ("ok", "failed", "skipped", "cut"))
    lines = []
    if not chart.complete:
        lines.append("PARTIAL: interrupted; this is what was done until then.")
    truth = chart.truth
    span = "" if truth is None else ", span " + ", ".join(f"{s:.4g} {u}" for u, s in truth.span.items())
    runs = f"{len(done)} run{'s' * (len(done) != 1)} in {chart.used:.1f} s of {chart.budget:g} s"
    lines.append(f"{chart.scene.name}: {chart.quantity}{span}; {runs}")
    if truth is None:
        lines.append("No truth: no run of a rich model came to an end. Give more budget, or a shorter scene.")
    else:
        lines += ["", *_truth(truth), "", *_advice(chart, truth), "", *_models(chart, truth)]
        gap = max(b - a for a, b in zip(chart.scene.t[:-1], chart.scene.t[1:], strict=True))
        if any(r.setting == "step" and r.choice not in OVER_OUTPUTS and r.value > 0.99 * gap for r in chart.front):
            lines.append("")
            lines.append(f"But for gauss, no step is longer than the {gap:.3g} s between output times.")
    lines += ["", *_methods(chart)] if chart.methods else []
    beaten = [r for r in skipped if "has no more error" in r.reason]
    if beaten:
        lines.append(f"{len(beaten)} lines ended where another choice has no more error in a third of the time.")
    lines += _left_out(failed, "failed")
    lines += _left_out([*cut, *(r for r in skipped if r not in beaten)], "skipped or cut off for the budget")
    return "\n".join(lines)
