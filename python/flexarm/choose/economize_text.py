"""The table of `flexarm economize`."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from .._console import aligned, seconds
from .choices import Choice, setting_words, speed_of

if TYPE_CHECKING:
    from .economize import Plan


def _number(x: float | None) -> str:
    return "" if x is None else "0" if x == 0 else f"{x:.1e}" if math.isfinite(x) else "fails"


def _time(choice: Choice) -> str:
    """What it takes, of what is in; what it would add, of what is out."""
    if choice.time is None or (choice.time == 0.0 and choice.inside):
        return ""
    return f"{100 * choice.time:+.0f} %"


def _head(plan: Plan) -> list[str]:
    spans = ", ".join(f"{s:.4g} {u}".rstrip() for u, s in plan.span.items())
    tol = f"{plan.tol:g} {' '.join(plan.span)}".rstrip() if plan.absolute else f"{plan.tol:g} of it"
    check = plan._walk.rungs.label(plan._rich_model)
    lines = [f"{plan.given.name}: {plan.quantity}, span {spans}, to {tol}", ""]
    lines.append(f"Take   {plan.model}; {setting_words(plan.scene.options)}")
    if plan.certified:
        lines.append(f"CERTIFIED: error {plan.error:.1e} against {check}, which was not on the path")
    else:
        lines.append(f"NOT CERTIFIED: {'; '.join(plan.reasons)}")
    lines += [f"Note: {note}" for note in plan._found.notes]
    lines.append(f"A run takes {seconds(plan.time)}; deciding took {seconds(plan.seconds)} and {plan.runs} runs")
    return lines


def _speed(plan: Plan) -> list[str]:
    rows = [["model", "coordinates", "an evaluation", "operations"]]
    for name, of in speed_of(plan._walk, plan._found).items():
        time = "" if of["time"] is None else f"{1e6 * of['time']:.2f} µs"
        word = {"given": "the scene's own", "lean": "lean", "rich": "of the check"}[name]
        rows.append([word, str(of["coordinates"]), time, "" if of["operations"] is None else f"{of['operations']}"])
    if not any(r[3] for r in rows[1:]):
        rows = [r[:3] for r in rows]
    return aligned(rows, frozenset({1, 2, 3}))


def _indicators(plan: Plan) -> list[str]:
    found = plan._found
    orders = ", ".join(f"{o}: {e:.1e}" for o, e in found.estimates.by_order.items() if o != "exact")
    lines = [f"Indicators: error by order, estimated: {orders}"] if orders else []
    turn = ", ".join(f"{x:.2g}" for x in found.estimates.rotation.values())
    spin = ", ".join(f"{x:.2g}" for x in found.estimates.spin.values())
    if turn:
        lines.append(f"  largest rotation of sections by link (rad): {turn}")
    if spin:
        lines.append(
            f"  speed of turning over the first frequency, {found.estimates.first_frequency:.4g} rad/s, by link: {spin}"
        )
    return lines


def table(plan: Plan) -> str:
    """See Plan.table."""
    rows = [["", "choice", "", "error without", "from", "time", ""]]
    last = ""
    for c in plan.choices:
        where, last = ("" if c.where == last else c.where), c.where
        mark = "in" if c.inside else ""
        rows.append([where, c.what, c.chosen, _number(c.without), c.how, _time(c), mark])
    note = (
        "error without: of what is in, when its last mode goes, or with the next poorer order; of what is out, what\n"
        "that costs now; of integrators, the whole error. time: of an evaluation of the dynamics (of integrators, of\n"
        "the run), what it takes, or would add."
    )
    return "\n".join(
        [*_head(plan), "", *_speed(plan), "", *aligned(rows, frozenset({3, 5})), note, "", *_indicators(plan)]
    )
