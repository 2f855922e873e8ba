"""Findings: possible improvements of a model or a run, listed when asked for; and the warnings of runs, whose
numbers are wrong."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Finding:
    """A remark about an arm, a scene or a run. `str` makes a sentence of it.

    Attributes:
        where: the field, link, joint or setting that it is about.
        what: the cause, in words.
        value, limit: how much it is, and where the remark begins; nan where that is no number.
        unit: of these.
        remedy: the change that helps.
    """

    where: str
    what: str
    value: float = np.nan
    limit: float = np.nan
    unit: str = ""
    remedy: str = ""

    def __str__(self) -> str:
        return f"{self.where}: {self.what}" + (f"; {self.remedy}" if self.remedy else "")

    def of(self, whom: str) -> Finding:
        """The same, about one of many."""
        return replace(self, where=f"{whom}: {self.where}")


class Findings(tuple[Finding, ...]):
    """A tuple of findings, which prints one on a line; empty, and false, where there is nothing to remark."""

    def __new__(cls, found: Iterable[Finding] = ()) -> Findings:
        return super().__new__(cls, dict.fromkeys(found))

    def __str__(self) -> str:
        return "\n".join(map(str, self)) or "nothing to remark"

    __repr__ = __str__


class RunWarning(UserWarning):
    """The numbers of a run are wrong. `finding` says why."""

    finding: Finding

    def __init__(self, finding: Finding, **about: Any) -> None:
        super().__init__(finding)
        self.__dict__.update(about, finding=finding)

    def of(self, whom: str) -> RunWarning:
        """The same, about one of many."""
        return type(self)(**{**vars(self), "finding": self.finding.of(whom)})


class RangeWarning(RunWarning):
    """A run is beyond the range of its model, such as a beam that bends further than its order allows.

    The limit of each order is in `LIMITS`; at order "exact" it is that of its Gauss points (see `TRUNCATION`). Or the
    beam's axis is shortened to nothing, which turns it inside out; or a quantity of a plan's `Watch` has left its
    range.

    Attributes:
        finding: its value is the largest rotation of a section against the beam's base (rad), or the quantity watched;
            where the beam is turned inside out, the least 1 + eps, which is not above 0.
        link: the link of that beam (the worst, if there are several).
        time: of the first output row past the limit (s).
    """

    link: int
    time: float


class LoopWarning(RunWarning):
    """A control loop is unstable where the run begins, and the run has grown.

    Attributes:
        finding: its value is the growth of the loop's fastest motion (1/s), for small deviations.
        control: index of the controller.
    """

    control: int


class StepWarning(RunWarning):
    """Steps miss a part of the motion.

    Those of "rk4" are above its limit, and a fast oscillation has grown; dry friction switches again and again within
    a step; many steps of "gauss" had to be halved; or no step has seen a pulse of a callable.

    Attributes:
        finding: its value and limit are the step of "rk4" and its limit (s); how often joints switched, or steps were
            halved, and how often is too often; or its value is the height of the pulse.
        growth: of the fastest motion, by one step of "rk4"; else nan.
    """

    growth: float = np.nan


class SlowWarning(RunWarning):
    """"ida" takes so many steps that the run will hardly end.

    Attributes:
        finding: its value is the number of steps of the whole run, if it goes on so.
        time: reached (s). steps: taken so far.
        step: that "implicit" may take instead (s); nan where no mode can be stepped over.
    """

    time: float
    steps: int
    step: float
