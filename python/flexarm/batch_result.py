"""What a batch gives."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import batch_events
from ._check import Array
from .arm import Arm
from .batch_file import about, read
from .batch_run import ENDED
from .result import Result
from .rollout import NOT_DONE, Failure
from .variation import Setup, Variation

OUTPUTS = ("q", "v", "a", "tau")


@dataclass(repr=False)
class BatchResult:
    """What a batch gives: B scenarios, nt rows each.

    Attributes:
        t: times (s), (nt,). q: (B, nt, nq). v, a, tau: (B, nt, nv). Those not asked for are None; rows after a
            failure or a terminal event are nan. Of a batch with a file they are mapped from it, not read.
        status: (B,): 0 where the scenario was done; 1 where a terminal event ended it, as in Result; 4 where Ctrl-C
            came first; 5 where it failed.
        reached: (B,), time reached (s): the last of t, or that of the event, of Ctrl-C, of the failure.
        failures: index, time and reason of each scenario that failed.
        parameters: values (B, ...) by path. variation: what the scenarios are made of.
        events: (B,): (t_events, q_events, v_events) of each scenario, as Result has them, or None where it was not
            done; None without events. A file keeps as many occurrences of each event as there are rows; where there
            are more, the scenario counts as failed.
        stats: engine ("steps": all steps in the core; "simulate": one `simulate` for each scenario), workers, steps,
            resumed (scenarios that the file held already), wall_time (s).
    """

    t: Array
    q: Array | None
    v: Array | None
    a: Array | None
    tau: Array | None
    status: NDArray[np.int32]
    reached: Array
    variation: Variation
    failures: list[Failure] = field(default_factory=list)
    stats: dict[str, Any] = field(default_factory=dict)
    keeps_loads: bool = True  #: a file keeps none
    events: NDArray[Any] | None = None

    def __len__(self) -> int:
        return len(self.status)

    def __repr__(self) -> str:
        return f"BatchResult({len(self)} scenarios, {len(self.t)} rows, {len(self.failures)} failed)"

    @property
    def parameters(self) -> dict[str, Array]:
        return self.variation.values

    def arm(self, i: int) -> Arm:
        """The arm of scenario i, with its parameters."""
        return self.variation.scenario(range(len(self))[i]).arm

    def __getitem__(self, i: int) -> Result:
        """Scenario i, with its own arm: the rows up to where it got. What was not asked for is nan."""
        i = range(len(self))[i]
        setup = self.variation.scenario(i)
        n = int((self.t <= self.reached[i] + 1e-9 * (self.t[-1] - self.t[0])).sum())
        held = {k: getattr(self, k) for k in OUTPUTS}
        sizes = {k: setup.arm.nq if k == "q" else setup.arm.nv for k in OUTPUTS}
        arrays: dict[str, Any] = {
            k: np.full((n, sizes[k]), np.nan) if x is None else np.array(x[i, :n]) for k, x in held.items()
        }
        result = Result(setup.arm, self.t[:n], **arrays, loads=setup.loads if self.keeps_loads else None)
        result.status = int(self.status[i] == ENDED)
        if self.events is not None and self.events[i] is not None:
            result.t_events, result.q_events, result.v_events = self.events[i]
        return result

    def map(self, f: Callable[[Result], Any]) -> Array:
        """f(result) of every scenario, such as `lambda r: r.tip_deflection()[-1]`, (B, ...)."""
        return np.array([f(self[i]) for i in range(len(self))])

    def save(self, path: str | Path) -> None:
        """Writes times, arrays, failures, parameters and the arm to one file (.npz) that `BatchResult.load` reads."""
        kept: dict[str, Any] = {k: getattr(self, k) for k in OUTPUTS if getattr(self, k) is not None}
        kept |= {f"parameters/{k}": v for k, v in self.variation.values.items()}
        reason = np.zeros(len(self), "S200")
        for f in self.failures:
            reason[f.index] = f.reason.encode()
        if self.events is not None:
            kept |= batch_events.kept(self.events)
        kept |= {"t": self.t, "status": self.status, "reached": self.reached, "reason": reason}
        words = json.dumps({**about(self.variation), **({} if self.keeps_loads else {"loads": 1})})
        with Path(path).open("wb") as file:  # an open file keeps its name; numpy would append .npz
            np.savez_compressed(file, about=np.array(words), **kept)

    @staticmethod
    def load(path: str | Path) -> BatchResult:
        """Reads what `save` or simulate_batch(out="sweep.h5") wrote, whether that was finished or not. Of the
        parameters, those of the arm make the arms; the file does not keep drives, loads and controllers."""
        held = read(Path(path), OUTPUTS)
        values, status = held["parameters"], held["status"]
        ours = {k: v for k, v in values.items() if k.split(".")[0] in ("link", "gravity", "q0", "v0")}
        variation = Variation(Setup(Arm.from_dict(held["about"]["arm"])), ours)
        variation.values.update(values)
        failures = [
            Failure(int(i), float(held["reached"][i]), held["reason"][i].decode())
            for i in np.flatnonzero((status != 0) & (status != ENDED) & (status != NOT_DONE))
        ]
        arrays: dict[str, Any] = {k: held.get(k) for k in OUTPUTS}
        return BatchResult(held["t"], **arrays, status=status, reached=held["reached"], variation=variation,
                           failures=failures, keeps_loads=not held["about"]["loads"],
                           events=held.get("events"))  # fmt: skip
