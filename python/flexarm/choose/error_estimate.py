"""The error of a run as it is told: over time, and its sources."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from .._check import Array
from .._console import aligned
from ..analysis.findings import Finding
from ..data.draw.sources import plot_error
from ..data.draw.style import Figure

_SHOWN = 1e-3  # of the largest error: smaller sources are told in one line
_MUCH = 0.01  # of the span: larger errors are findings
_REMEDIES = {
    "steps": "take shorter steps, or a smaller tolerance",
    "order of rotation": 'take a higher order, or "exact"',
    "rotary inertia": "take rotary_inertia = True",
    "Gauss points": "leave gauss_points out",
}


@dataclass(frozen=True)
class ErrorSource:
    """A part of an error, and what it comes from.

    Attributes:
        where: the link, or "arm". what: such as "bending_y modes", "order of rotation", "steps".
        error: its part at the time of the largest error, along the direction of that, in the quantity's unit: what
            would be added to the quantity without this source. Parts may be negative.
        share: the same over the largest error.
    """

    where: str
    what: str
    error: float
    share: float

    @property
    def remedy(self) -> str:
        """What would mend it; "" where that is not one thing."""
        strain, _, kind = self.what.partition(" ")
        return {"modes": f"take more modes of {strain}", "left out": f"give it modes of {strain}"}.get(
            kind, _REMEDIES.get(self.what, "")
        )


@dataclass(repr=False)
class ErrorEstimate:
    """The error of a run: what a richer model in finer steps differs by. `print(error)` shows the table.

    Attributes:
        quantity: "tip", "joint", "strain", or the name of the callable. unit: of the numbers here.
        t: times (s), (nt,), those of the result.
        total: the error over time, (nt,): of the place or joint that is off most. steps, model: the parts of it that
            finer steps and a richer model make, each alone; they may cancel.
        largest: the largest error. time: when (s). span: the largest range of any one component of the quantity.
        sources: the parts of the largest error, largest first.
        numbers: of uncertain numbers of the scene: the largest change of the quantity over time by the uncertainty of
            each, and that over the largest error. They are not in the total.
        reliable: whether the estimate can be relied on. reason: why not; "" if it can.
        richer: the richer model in words. runs: runs made, the backward ones included.
    """

    quantity: str
    unit: str
    t: Array
    total: Array
    steps: Array
    model: Array
    largest: float
    time: float
    span: float
    sources: list[ErrorSource]
    numbers: list[ErrorSource]
    reliable: bool
    reason: str
    richer: str
    runs: int
    _values: Array = field(repr=False)

    def __repr__(self) -> str:
        word = "" if self.reliable else ", not reliable here"
        return f"ErrorEstimate({self.quantity}: {self.largest:.2g} {self.unit} at {self.time:.4g} s{word})"

    @property
    def short(self) -> str:
        """The largest error in words."""
        word = "" if self.reliable else " (not reliable)"
        return f"{self.quantity} off by {f'{self.largest:.2g} {self.unit}'.strip()}{word}"

    @property
    def panel(self) -> tuple[str, list[tuple[str, Array]]]:
        """The name of an axis, and the curves of the error over time."""
        unit = f" ({self.unit})" if self.unit else ""
        return f"Error of the {self.quantity}{unit}", self._curves()

    def _curves(self) -> list[tuple[str, Array]]:
        return [("total", self.total), ("of steps", self.steps), ("of the model", self.model)]

    def findings(self) -> list[Finding]:
        """What to mend: an error above 1 % of what the quantity spans; an estimate that cannot be relied on."""
        share = self.largest / self.span if self.span > 0.0 else 0.0
        found = []
        if share > _MUCH:
            most = self.sources[0]
            what = f"is off by {self.largest:.2g} {self.unit} at t = {self.time:.4g} s, {100 * share:.2g} % of its span"
            remedy = f"mostly by {most.what} of {most.where}" + (f": {most.remedy}" if most.remedy else "")
            found.append(Finding(self.quantity, what, self.largest, _MUCH * self.span, self.unit, remedy))
        if not self.reliable:
            found.append(Finding(self.quantity, f"its estimated error is not reliable: {self.reason}"))
        return found

    def __str__(self) -> str:
        return self.table()

    def table(self) -> str:
        """The largest error, and its sources."""
        unit = f" {self.unit}" if self.unit else ""
        part = f", {100 * self.largest / self.span:.2g} % of its span" if self.span > 0 else ""
        lines = [f"{self.quantity}: off by {self.largest:.2g}{unit} at t = {self.time:.4g} s{part}"]
        lines += [] if self.reliable else [f"NOT RELIABLE HERE: {self.reason}"]
        shown = [x for x in self.sources if abs(x.share) >= _SHOWN]
        rows = [["", "source", f"error{f' ({self.unit})' if unit else ''}", "share"]]
        rows += [[x.where, x.what, f"{x.error:.2e}", f"{100 * x.share:.1f} %"] for x in shown]
        rows += [[x.where, x.what, f"± {x.error:.2e}", f"{100 * x.share:.1f} %"] for x in self.numbers]
        lines += ["", *aligned(rows, {2, 3})]
        if rest := len(self.sources) - len(shown):
            lines.append(f"and {rest} of less than {100 * _SHOWN:g} %")
        return "\n".join([*lines, "", f"Beside {self.richer}; {self.runs} runs"])

    def plot(self) -> Figure:
        """The error over time with the parts of steps and of the model, the quantity in its band, and the sources."""
        rows = [(f"{x.where}: {x.what}", x.error) for x in self.sources if abs(x.share) >= _SHOWN]
        rows += [(f"{x.where}: {x.what} ±", x.error) for x in self.numbers]
        return plot_error(
            self.t, self._values, dict(self._curves()), rows, self.time, self.quantity, self.unit,
            "" if self.reliable else f"NOT RELIABLE HERE: {self.reason}",
        )  # fmt: skip

    def to_dict(self) -> dict[str, Any]:
        """Everything but the curves, ready for JSON."""
        keep = "quantity unit largest time span reliable reason richer runs".split()
        parts = {name: [vars(x) for x in getattr(self, name)] for name in ("sources", "numbers")}
        return {**{k: getattr(self, k) for k in keep}, **parts}
