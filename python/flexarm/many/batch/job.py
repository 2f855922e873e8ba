"""A batch: its scenarios, how they are run, and the arrays of their results."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._check import Array
from ...arm.arm import Arm
from ...arm.variation import Variation
from ...run.integrators import Integrator
from ...run.outputs import row_shapes
from ...run.problem import read_events

#: the arrays that a batch may keep
OUTPUTS = ("q", "v", "a", "tau", "contacts", "loops")
ENDED = 1  #: by a terminal event, as `Result.status` has it
FAILED = 5


def width(arm: Arm, output: str) -> int:
    """Numbers in a row of an output."""
    return prod(row_shapes(arm)[output])


def renamed(message: str, names: Any) -> str:
    """A message about a scenario of a share, with the number (of `names`) that it has in the whole batch."""
    return re.sub(r"^((?:parameters of )?scenario) (\d+):", lambda m: f"{m[1]} {names[int(m[2])]}:", message)


@dataclass
class Job:
    """A batch, checked, before it runs."""

    variation: Variation  #: the scenarios' arms, drives, loads and controllers
    t: Array  #: output times (s)
    q0: Array | None  #: (B or 1, nq); None: not given
    v0: Array | None  #: (B or 1, nv), likewise
    tau: Array | None  #: (B or 1, nt or 1, nv), held; None: zero
    outputs: tuple[str, ...]  #: some of OUTPUTS
    every: int  #: how many of t between two rows of the result
    integrator: Integrator
    events: Any = None  #: as of `simulate`
    #: makes the stored arrays in place of the outputs, as `RunSummary`; a file's fingerprint has its attributes
    summary: Any = None
    whole: int = 0  #: scenarios of the whole batch, of which this may be a part; few are not worth the lanes
    balance: str | None = None  #: q0 if it was a word, such as "trim"

    def taken(self, indices: NDArray[np.int64]) -> Job:
        """The batch of these scenarios alone."""

        def part(x: Array | None) -> Array | None:
            return x if x is None or len(x) == 1 else np.ascontiguousarray(x[indices])

        values = {path: part(v) for path, v in self.variation.values.items()}
        try:
            variation = Variation(self.variation.setup, values)  # type: ignore[arg-type]
        except ValueError as e:
            raise ValueError(renamed(str(e), indices)) from None
        return replace(self, variation=variation, q0=part(self.q0), v0=part(self.v0), tau=part(self.tau))

    @property
    def rows(self) -> int:
        return len(self.t[:: self.every])

    @property
    def row_bytes(self) -> int:
        """Bytes of a scenario's result."""
        return max(1, 8 * self.rows * sum(self.sizes().values()))

    def sizes(self) -> dict[str, int]:
        """Numbers in a row of each output."""
        arm = self.variation.setup.arm
        return {k: width(arm, k) for k in self.outputs}

    def kept(self) -> dict[str, tuple[int, ...]]:
        """By name, the shapes of the stored arrays of a scenario."""
        if self.summary is not None:
            return self.summary.kept(self.variation.setup.arm, self.rows)  # type: ignore[no-any-return]
        return {k: (self.rows, size) for k, size in self.sizes().items()}

    @property
    def kept_times(self) -> Array:
        """Times of the stored rows."""
        return self.t[:: self.every][:: self.summary.every if self.summary is not None else 1]

    @property
    def keeps_events(self) -> bool:
        return bool(read_events(self.events)) and self.summary is None

    def event_sizes(self) -> tuple[int, int, int, int]:
        """Number of events, largest number of occurrences of each in a file, nq and nv."""
        arm = self.variation.setup.arm
        return len(read_events(self.events)), self.rows, arm.nq, arm.nv

    def blocks(self, count: int) -> dict[str, Any]:
        """Arrays for the results of this number of scenarios."""
        out: dict[str, Any] = {k: np.empty((count, self.rows, size)) for k, size in self.sizes().items()}
        out |= {"status": np.empty(count, np.int32), "reached": np.empty(count)}
        out |= {"events": np.full(count, None)} if read_events(self.events) else {}
        return {**out, "out_of_range": np.full((count, 4), np.nan), "wrong": np.full(count, None)}
