"""Speed against accuracy: models, integrators and tolerances on one scene (`flexarm chart`)."""

import csv
import math
import platform
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .._check import positive
from .._console import aligned, json_text, progress_bar, seconds
from .._core import __version__
from ..data.draw.style import Figure
from ..data.draw.tradeoff import Cheapest, Kind, Line, Point, plot_lines
from ..run.scene.scene import Scene
from .chart_search import ChartSearch, Truth, best
from .models import Models, read_scene
from .trials import LINES, OVER_OUTPUTS, Run, longest_gap

TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
_DOUBTFUL = 1e-2  # of the span: a truth with a larger uncertainty counts as not converged
_SHOWN = 6  # most failed or skipped runs in the list


@dataclass(repr=False)
class Chart:
    """Runs of a scene with many models and integrators, their errors and times. `print(chart)` shows the table.

    Attributes:
        scene: the scene.
        quantity: "tip", "joint" or "strain".
        rows: every run; of failed, skipped or cut ones with the reason.
        truth: the truth, or None if no run was completed.
        complete: False after Ctrl-C.
        budget, used: wall time allowed and used (s).
    """

    scene: Scene
    quantity: str
    rows: list[Run]
    truth: Truth | None
    complete: bool
    budget: float
    used: float

    def __repr__(self) -> str:
        return f"Chart({self.scene.name!r}, {self.quantity}, {len(self.rows)} runs)"

    def __str__(self) -> str:
        return self.table()

    def with_status(self, status: str) -> list[Run]:
        """The rows that are "ok", "failed", "skipped" or "cut"."""
        return [r for r in self.rows if r.status == status]

    @property
    def _graded(self) -> list[Run]:
        """Runs with an error, without those of the truth's model and setting."""
        if self.truth is None:
            return []
        it = self.truth.row
        own = [r for r in self.rows if r.model == it.model and r.choice == it.choice and r.value == it.value]
        return [r for r in self.rows if r.error is not None and r not in own and not r.model.pieces]

    @property
    def _least(self) -> float:
        return self.truth.tolerance if self.truth and math.isfinite(self.truth.tolerance) else 0.0

    @property
    def front(self) -> list[Run]:
        """The Pareto front, fastest first: runs that no other beats in both time and error."""
        return best(self._graded, self._least)

    def recommend(self, tolerance: float) -> Run | None:
        """The fastest run with an error of at most `tolerance` (over the quantity's span); None if there is none, or
        if the truth's own tolerance is coarser than that."""
        positive("tolerance", tolerance)
        good = [r for r in self._graded if r.error is not None and r.error <= tolerance and self._least <= tolerance]
        return min(good, key=lambda r: r.time, default=None)

    def scene_of(self, row: Run) -> Scene:
        """The scene with a row's model, integrator and setting, to run."""
        return Models(self.scene).at(row.model, row.options)

    def table(self) -> str:
        """Recommended runs for 1e-2 to 1e-6, the convergence of the truth, and failed or skipped runs."""
        done, failed, skipped, cut = (self.with_status(s) for s in ("ok", "failed", "skipped", "cut"))
        lines = []
        if not self.complete:
            lines.append("PARTIAL: interrupted; these are the completed runs.")
        truth = self.truth
        span = "" if truth is None else ", span " + ", ".join(f"{s:.4g} {u}" for u, s in truth.span.items())
        runs = f"{len(done)} run{'s' * (len(done) != 1)} in {self.used:.1f} s of {self.budget:g} s"
        lines.append(f"{self.scene.name}: {self.quantity}{span}; {runs}")
        if truth is None:
            lines.append("No truth: no run of a rich model came to an end. Give more budget, or a shorter scene.")
        else:
            lines += ["", *_truth(truth), "", *_advice(self, truth), "", *_models(self, truth)]
            gap = longest_gap(self.scene)
            if any(r.setting == "step" and r.choice not in OVER_OUTPUTS and r.value > 0.99 * gap for r in self.front):
                lines.append("")
                lines.append(f"But for gauss, no step is longer than the {gap:.3g} s between output times.")
        lines.append("")
        beaten = [r for r in skipped if "has no more error" in r.reason]
        if beaten:
            lines.append(f"{len(beaten)} lines ended where another choice has no more error in a third of the time.")
        lines += _left_out(failed, "failed")
        lines += _left_out([*cut, *(r for r in skipped if r not in beaten)], "skipped or cut off for the budget")
        return "\n".join(lines)

    def plot(self) -> Figure:
        """Error against wall time, a line for each model and integrator; the cheapest are ringed and listed."""
        floor = max(self._least, 1e-12)

        def point(row: Run) -> Point:
            return row.time, max(row.error or 0.0, floor)

        groups: dict[tuple[Kind, str], list[Run]] = {}
        for r in self._graded:
            kind = Kind(r.model.order, r.model.modes, r.model.basis)
            groups.setdefault((kind, r.choice), []).append(r)
        lines = [
            Line(kind, choice, [point(r) for r in sorted(rows, key=lambda r: -r.value)])
            for (kind, choice), rows in groups.items()
        ]
        front = [Cheapest(*point(r), r.label) for r in self.front]
        spans = ", ".join(f"{s:.3g} {u}" for u, s in self.truth.span.items()) if self.truth else ""
        unsure = self.truth.uncertainty if self.truth else math.inf
        given_up = [r.time for r in self.with_status("cut")]
        return plot_lines(
            lines, front, list(LINES), unsure, f"Largest error of the {self.quantity} (share of its span, {spans})",
            f"{self.scene.name}: models and integrators", self._cautions(), given_up,
        )  # fmt: skip

    def _cautions(self) -> list[str]:
        """Warnings in the picture: an interruption, a truth that is not converged, runs without an error."""
        said = [] if self.complete else ["PARTIAL: interrupted; these are the completed runs."]
        unsure = self.truth.uncertainty if self.truth else math.inf
        if unsure > _DOUBTFUL:
            near = f"is only known to {unsure:.1e} of the span" if unsure < math.inf else "may be far from it"
            said.append(f"NOT CONVERGED: the richest model, taken for the truth, {near}.")
        failed: dict[str, int] = {}
        for r in self.with_status("failed"):
            failed[r.choice] = failed.get(r.choice, 0) + 1
        if failed:
            named = ", ".join(f"{n} of {choice}" for choice, n in failed.items())
            said.append(f"Without a point, because they failed: {named}.")
        cut = len(self.with_status("cut"))
        if cut:
            said.append(f"Crosses at the top: {cut} run{'s' * (cut != 1)} given up at that time, error not known.")
        return said

    def to_dict(self) -> dict[str, Any]:
        """Everything but the trajectories, ready for JSON; `front` and `recommend` hold indices of `rows`."""
        at = {id(r): k for k, r in enumerate(self.rows)}
        advice = []
        for tol in TOLERANCES if self.truth else ():
            row = self.recommend(tol)
            unsure = self.truth is not None and tol < self.truth.uncertainty
            absolute = {u: tol * s for u, s in self.truth.span.items()} if self.truth else {}
            take = {"row": None if row is None else at[id(row)], "label": None if row is None else row.label}
            advice.append({"tolerance": tol, "absolute": absolute, **take, "below_uncertainty": unsure})
        return {
            "scene": self.scene.name,
            "quantity": self.quantity,
            "made_with": f"flexarm {__version__}, {platform.machine()}, Python {platform.python_version()}",
            "complete": self.complete,
            "budget": self.budget,
            "used": self.used,
            "truth": None if self.truth is None else self.truth.to_dict(),
            "recommend": advice,
            "front": [at[id(r)] for r in self.front],
            "rows": [r.to_dict() for r in self.rows],
        }

    def save(self, folder: str | Path) -> list[str]:
        """Writes chart.png, chart.txt, chart.csv and chart.json into a folder; their names."""
        path = Path(folder)
        path.mkdir(parents=True, exist_ok=True)
        (path / "chart.txt").write_text(self.table() + "\n", encoding="utf-8")
        (path / "chart.json").write_text(json_text(self.to_dict()) + "\n", encoding="utf-8")
        with (path / "chart.csv").open("w", newline="", encoding="utf-8") as f:
            rows = [r.to_dict() for r in self.rows]
            writer = csv.DictWriter(f, list(rows[0]) if rows else ["status"])
            writer.writeheader()
            for row in rows:
                words = " ".join(f"{v:.6g} {u}" for u, v in row["absolute"].items())
                writer.writerow({**row, "absolute": words})
        names = ["chart.txt", "chart.json", "chart.csv"]
        if self.truth is not None:
            self.plot().savefig(path / "chart.png", dpi=150)
            names.insert(0, "chart.png")
        return names


# -- the table ---------------------------------------------------------------------------------------------------------


def _truth(truth: Truth) -> list[str]:
    row = truth.row
    lines = [f"Truth: {row.label}. Over the span, it is"]
    words = {"modes": "the next in fewer modes", "basis": "the scene's basis" if row.model.basis else "another basis",
             "order": "the next in lower order", "tolerance": "the next in looser " + row.setting,
             "pieces": "its beams in pieces"}  # fmt: skip
    for name, word in words.items():
        d = getattr(truth, name)
        if name == "pieces" and d is None:
            continue
        if d is None or d == math.inf:
            why = "it was not run" if d else "there is none"
            lines.append(f"  {'?' if d else '-':>7}  from {word}: {why}")
        else:
            cut = "; exact cuts nothing off" if name == "order" and row.model.order == "exact" else ""
            lines.append(f"  {d:7.1e}  from {word} ({truth.poorer[name]}{cut})")
    if truth.uncertainty > _DOUBTFUL:
        lines.append("It is NOT CONVERGED: errors below say little. Give more budget, a shorter scene, or more modes.")
    return lines


def _advice(chart: Chart, truth: Truth) -> list[str]:
    rows = [["for", "that is", "take this", "time", "error", ""]]
    unsure = False
    for tol in TOLERANCES:
        row = chart.recommend(tol)
        flag = "*" if tol < truth.uncertainty else ""
        unsure = unsure or bool(flag)
        absolute = ", ".join(f"{tol * s:.2g} {u}" for u, s in truth.span.items())
        head = [f"{tol:.0e}".replace("e-0", "e-"), absolute]
        if row is None or row.error is None:
            rows.append([*head, "none of those tried", "", "", flag])
        else:
            rows.append([*head, row.label, seconds(row.time), f"{row.error:.1e}", flag])
    lines = aligned(rows, {3, 4})
    if unsure:
        known = "not known how far" if truth.uncertainty == math.inf else f"{truth.uncertainty:.1e}"
        lines.append(f"* finer than the truth is known ({known}): near the truth's model, not near the arm")
    return lines


def _models(chart: Chart, truth: Truth) -> list[str]:
    """Rows of orders with the truth's modes, and of modes with its order, at its tolerance."""
    it = truth.row
    same = [r for r in chart.rows if r.choice == it.choice and r.value == it.value]
    modes = [r for r in same if r.model.order == it.model.order and r is not it]
    richest = {b: max(r.model.shift for r in same if r.model.basis == b) for b in {r.model.basis for r in same}}
    orders = [r for r in same if r.model.shift == richest[r.model.basis] and r not in modes and r is not it]
    rows = [["model", "time", "error", ""]]
    for r in [it, *orders, *modes]:
        error = "truth" if r is it else f"{r.error:.1e}" if r.error is not None else r.status
        far = "bent beyond its range (RangeWarning)" if r.warning else ""
        rows.append([r.model.label, seconds(r.time) if r.status == "ok" else "", error, far])
    return [f"Models, by {it.choice} at {it.setting} {it.value:.3g}:", *aligned(rows, {1, 2})]


def _left_out(rows: list[Run], word: str) -> list[str]:
    """One line for each model and integrator, with all its settings."""
    groups: dict[tuple[str, str, str], list[Run]] = {}
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


# -- charting ----------------------------------------------------------------------------------------------------------


def chart(scene: Scene | str | Path, *, budget: float = 60.0, quantity: str = "tip", progress: bool = False) -> Chart:
    """Error against time of models and integrators on a scene.

    Runs the scene at orders 0 to 3 and exact, with 1 to n + 2 modes per strain where the scene has n, in every possible
    basis, and with every integrator at looser and tighter settings. Not all combinations are run: first the orders,
    then the modes of the best orders (no other beats them in time and error), then the integrators on the best models.
    Errors are largest distances from the richest converged model, which has n + 4 Legendre polynomials where these are
    possible, over the quantity's span.

    Args:
        scene: a Scene, a scene file, or the name of a shipped scene.
        budget: wall time (s). Runs predicted to exceed the remaining time are skipped and listed.
        quantity: the compared quantity: "tip", the position of the arm's end, of a tree of all its ends (m); "joint",
            the coordinates of those joints that are not prescribed (rad, m); "strain", of every beam at its clamp
            (1/m, rad).
        progress: shows a bar on stderr, or lines if that is no terminal.

    Ctrl-C ends it early: the chart holds the completed runs, and says that it is partial.

    Raises:
        ValueError: bad arguments, a scene that cannot be run, or a quantity that does not move in it.
    """
    scene = read_scene(scene)
    scene.arm.refuse_loops("chart: scene.arm")
    budget = positive("budget", budget, "s")
    with progress_bar(progress, "charting", budget) as bar:

        def tell(used: float, doing: str) -> None:
            if bar is not None:
                bar(used, f"{used:.0f} of {budget:.0f} s  {doing}")

        search = ChartSearch(scene, quantity, budget, tell)
        complete = True
        try:
            search()
        except KeyboardInterrupt:
            complete = False
            for row in search.rows:
                search.grade(row)
    rows = search.rows
    failed = [r for r in rows if r.status == "failed"]
    if complete and search.truth is None and failed and not any(r.status in ("ok", "cut") for r in rows):
        raise ValueError(f"scene: cannot be run at any order, with any integrator: {failed[0].reason}")
    return Chart(scene, quantity, rows, search.conclude(), complete, budget, search.used)
