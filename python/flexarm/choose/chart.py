"""Speed against accuracy: the ladder of models, integrators and tolerances on one scene (`flexarm chart`)."""

from __future__ import annotations

import csv
import math
import platform
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._check import choice, number
from .._console import json_text, progress_bar
from .._core import __version__
from ..scene.scene import Scene, load
from .ladder import QUANTITIES, Row, scene_of
from .walk import Walk, best

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MARGIN = 1.1  # the run in another basis is off by a little, too
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)


@dataclass(frozen=True)
class Truth:
    """What errors are measured against, and how far it is converged.

    Attributes:
        row: the run: the richest model, at a tolerance that no longer matters.
        span: by unit, the largest range of any one component of the quantity.
        modes, order, tolerance: distance over the span between this run and the next-richest in modes (one less
            for each strain), in order, and in tolerance (or step); None where there is none, inf if it was not run.
        basis: the same from a run in Legendre polynomials, two more for each strain: modes of a free beam converge
            slowly under a payload, and one less says little of that. None where they may not stand in, or already do.
        poorer: what those other runs are, in words.
    """

    row: Row
    span: dict[str, float]
    modes: float | None
    order: float | None
    tolerance: float
    basis: float | None
    poorer: dict[str, str]

    @property
    def uncertainty(self) -> float:
        """The largest of the distances that say how far the truth may be off; exact rotation cuts nothing more."""
        order = None if self.row.model.order == "exact" else self.order
        basis = None if self.basis is None else _MARGIN * self.basis
        return max((d for d in (self.modes, order, self.tolerance, basis) if d is not None), default=0.0)

    def to_dict(self) -> dict[str, Any]:
        keep = {k: getattr(self, k) for k in ("span", "modes", "order", "tolerance", "basis", "uncertainty", "poorer")}
        return {"run": self.row.to_dict(), **keep}


@dataclass(repr=False)
class Chart:
    """What `chart` found. `print(chart)` shows the table.

    Attributes:
        scene: the scene.
        quantity: "tip", "joint" or "strain".
        rows: every run, also those that failed, were skipped or cut off, with the reason.
        truth: the truth, or None if no run came to an end.
        methods: by integrator, distance of method "ci" from "ab", and its time over that of "ab".
        complete: False after Ctrl-C.
        budget, used: wall time allowed and used (s).
    """

    scene: Scene
    quantity: str
    rows: list[Row]
    truth: Truth | None
    methods: dict[str, tuple[float, float]]
    complete: bool
    budget: float
    used: float

    def __repr__(self) -> str:
        return f"Chart({self.scene.name!r}, {self.quantity}, {len(self.rows)} runs)"

    def __str__(self) -> str:
        return self.table()

    def with_status(self, status: str) -> list[Row]:
        """The rows that are "ok", "failed", "skipped" or "cut"."""
        return [r for r in self.rows if r.status == status]

    @property
    def _graded(self) -> list[Row]:
        """Runs with an error, without the truth's own."""
        if self.truth is None:
            return []
        it = self.truth.row
        own = [r for r in self.rows if r.model is it.model and r.choice == it.choice and r.value == it.value]
        return [r for r in self.rows if r.error is not None and r not in own]

    @property
    def _least(self) -> float:
        return self.truth.tolerance if self.truth and math.isfinite(self.truth.tolerance) else 0.0

    @property
    def front(self) -> list[Row]:
        """The Pareto front, fastest first: runs that no other beats in both time and error."""
        return best(self._graded, self._least)

    def recommend(self, tol: float) -> Row | None:
        """The fastest run with an error of at most `tol` (over the quantity's span); None if there is none, or if the
        truth's own tolerance is coarser than that."""
        if not number("tol", tol) > 0:
            raise ValueError(f"tol = {tol}: must be positive")
        good = [r for r in self._graded if r.error is not None and r.error <= tol and self._least <= tol]
        return min(good, key=lambda r: r.time, default=None)

    def scene_of(self, row: Row) -> Scene:
        """The scene with a row's model, integrator and setting, to run."""
        return scene_of(self.scene, row)

    def table(self) -> str:
        """What to take for 1e-2 to 1e-6, how far the truth is converged, and what failed or was skipped."""
        from .chart_text import table

        return table(self)

    def plot(self) -> Figure:
        """Error against wall time, a line for each model and integrator, the Pareto front marked."""
        from .chart_figure import plot_chart

        return plot_chart(self)

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
            "methods": {k: {"distance": d, "time_ratio": ratio} for k, (d, ratio) in self.methods.items()},
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


def chart(scene: Scene | str | Path, *, budget: float = 60.0, quantity: str = "tip", progress: bool = False) -> Chart:
    """Charts speed against accuracy on a scene.

    Runs the scene at orders 0 to 3 and exact, with 1 to n + 2 modes per strain where the scene has n, and with every
    integrator at looser and tighter settings; not all of them, but first the orders, then the modes of those orders
    that no other beats in time and error, then the integrators on those models that no other beats. Errors are largest
    distances from the richest converged model, over the quantity's span.

    Args:
        scene: a Scene, a scene file, or the name of a shipped scene.
        budget: wall time (s). Runs predicted to exceed what is left of it are skipped, and say so.
        quantity: what is compared: "tip", the position of the arm's end (m); "joint", the coordinates of those joints
            that are not prescribed (rad, m); "strain", of every beam at its clamp (1/m, rad).
        progress: shows a bar on stderr, where that is a terminal.

    Ctrl-C ends the walk early: the chart holds what was done, and says that it is partial.

    Raises:
        ValueError: bad arguments, a scene that cannot be run, or a quantity that does not move in it.
    """
    if isinstance(scene, (str, Path)):
        scene = load(scene)
    if not isinstance(scene, Scene):
        raise ValueError(f"scene = {scene!r}: must be a Scene, or the path of a scene file")
    budget = number("budget", budget)
    if not 0 < budget < math.inf:
        raise ValueError(f"budget = {budget}: must be positive and finite, in seconds")
    choice("quantity", quantity, QUANTITIES)
    with progress_bar(progress, "charting", budget) as bar:

        def tell(used: float, doing: str) -> None:
            if bar is not None:
                bar(used, f"{used:.0f} of {budget:.0f} s  {doing}")

        walk = Walk(scene, quantity, budget, tell)
        complete = True
        try:
            walk()
        except KeyboardInterrupt:
            complete = False
            for row in walk.rows:
                walk.grade(row)
    failed = [r for r in walk.rows if r.status == "failed"]
    if complete and walk.truth is None and failed and len(failed) == len(walk.rows):
        raise ValueError(f"scene: cannot be run at any order, with any integrator: {failed[0].reason}")
    truth = None
    if walk.truth is not None:
        poorer = {name: row.model.label for name, row in walk.poorer.items() if row.error is not None}
        if walk.looser is not None:
            poorer["tolerance"] = f"{walk.looser.setting} {walk.looser.value:.3g}"
        modes, order = (
            None if len(ladder) == 1 else walk.poorer[name].error if name in poorer else math.inf
            for name, ladder in (("modes", walk.shifts), ("order", walk.orders))
        )
        other = walk.poorer.get("basis")
        basis = None if other is None else math.inf if other.error is None else other.error
        truth = Truth(walk.truth, walk.span, modes, order, walk.tolerance, basis, poorer)
    return Chart(scene, quantity, walk.rows, truth, walk.methods, complete, budget, walk.used)
