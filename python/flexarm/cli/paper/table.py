"""The table of `flexarm demo`: this program's numbers beside the paper's."""

from collections.abc import Iterable
from dataclasses import dataclass

from ..._console import aligned

COLUMNS = ("", "unit", "flexarm", "paper", "measured", "agrees")


@dataclass(frozen=True)
class Row:
    """One line of the table: a number of this program, and the paper's.

    `paper` is a number, or a range read from a figure's axes; `digits`: its printed digits after the point.
    `fitted`: the scene's motion was fitted to it, so that it proves nothing.
    `agrees`: whether the value, rounded to those digits, equals the paper's; None if nothing is published.
    """

    key: str
    name: str
    unit: str
    value: float
    digits: int
    paper: float | tuple[float, float] | None = None
    measured: float | None = None
    fitted: bool = False

    @property
    def agrees(self) -> bool | None:
        if self.paper is None:
            return None
        if isinstance(self.paper, tuple):
            return self.paper[0] <= self.value <= self.paper[1]
        return f"{self.value:.{self.digits}f}" == f"{self.paper:.{self.digits}f}"

    def cells(self) -> list[str]:
        """Text of every column of the table."""

        def text(x: float | None) -> str:
            if x is None:
                return ""
            return f"{x:+.{self.digits}f}" if self.unit == "%" else f"{x:.{self.digits}f}"

        paper = "{:g} to {:g}".format(*self.paper) if isinstance(self.paper, tuple) else text(self.paper)
        verdict = {None: "", True: "fitted" if self.fitted else "yes", False: "NO"}[self.agrees]
        measured = "" if self.measured is None else f"{self.measured:.1f}"
        return [self.name, self.unit, text(self.value), paper, measured, verdict]


def text(rows: Iterable[Row]) -> str:
    """The table, for people."""
    lines = aligned([COLUMNS, *(row.cells() for row in rows)], range(2, len(COLUMNS)))
    return "\n".join(["The paper's single flexible link (Sec. 5)", *lines])
