"""Batches: many simulations that differ in their start, forces and parameters."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._check import Array, array
from .arm import Arm
from .control import Controller
from .load import Load
from .result import Result
from .rollout import NOT_FINITE, Failure, forces, rows, scenario_count
from .sampled import Sampled
from .simulation import SimulationError, simulate
from .variation import Setup, Variation


@dataclass(repr=False)
class BatchResult:
    """What a batch gives: B scenarios, nt rows each.

    Attributes:
        t: times (s), (nt,). q: (B, nt, nq). v, and a and tau where asked for: (B, nt, nv), else None. Rows after a
            failure are nan.
        status: (B,), 0 where the scenario was done. reached: (B,), time reached (s).
        failures: index, time and reason of each scenario that failed.
        stats: engine, workers, steps, wall_time (s).
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

    def __len__(self) -> int:
        return len(self.status)

    def __repr__(self) -> str:
        return f"BatchResult({len(self)} scenarios, {len(self.t)} rows, {len(self.failures)} failed)"

    def arm(self, i: int) -> Arm:
        """The arm of scenario i, with its parameters."""
        return self.variation.scenario(range(len(self))[i]).arm

    def __getitem__(self, i: int) -> Result:
        """Scenario i: its rows up to where it got, with its own arm; what was not asked for is nan."""
        i = range(len(self))[i]
        setup = self.variation.scenario(i)
        n = int(np.searchsorted(self.t, self.reached[i], side="right")) if self.status[i] else len(self.t)
        sizes = {"q": setup.arm.nq, "v": setup.arm.nv, "a": setup.arm.nv, "tau": setup.arm.nv}
        kept = {k: getattr(self, k) for k in sizes}
        arrays = {k: np.full((n, sizes[k]), np.nan) if x is None else np.array(x[i, :n]) for k, x in kept.items()}
        return Result(setup.arm, self.t[:n], **arrays, loads=setup.loads)


def simulate_batch(
    arm: Arm,
    t: ArrayLike,
    q0: ArrayLike | None = None,
    v0: ArrayLike | None = None,
    *,
    tau: ArrayLike | None = None,
    parameters: Mapping[str, ArrayLike] | None = None,
    drive: Mapping[Any, Any] | None = None,
    loads: Sequence[Load] | None = None,
    control: Controller | Sequence[Controller] | None = None,
    integrator: str = "implicit",
    step: float | None = None,
    rtol: float | None = None,
    outputs: Sequence[str] = ("q", "v"),
    every: int = 1,
    workers: int | None = None,
    progress: Any = False,
    out: Any = None,
    resume: bool = True,
    executor: Any = None,
    batch: int | None = None,
    **options: Any,
) -> BatchResult:
    """Simulates B scenarios; what is not given B times is alike for all."""
    started = time.perf_counter()
    times = array("t", t)
    controllers = () if control is None else (control,) if isinstance(control, Controller) else tuple(control)
    variation = Variation(Setup(arm, dict(drive or {}), tuple(loads or ()), controllers), parameters)
    q = variation.initial("q0", rows("q0", q0, arm.zero))
    v = variation.initial("v0", rows("v0", v0, np.zeros(arm.nv)))
    force = forces(tau, arm.nv, times.size)
    count = scenario_count({"q0": len(q), "v0": len(v), "tau": len(force), **variation.sizes})
    if integrator != "ida" and step is None:
        step = float(np.diff(times).min())
    kept = times[::every]
    arrays = {
        k: np.full((count, kept.size, arm.nq if k == "q" else arm.nv), np.nan) if k in outputs else None
        for k in ("q", "v", "a", "tau")
    }
    result = BatchResult(kept, **arrays, status=np.zeros(count, np.int32), reached=np.zeros(count), variation=variation)
    for i in range(count):  # slow, and soon replaced
        setup = variation.scenario(i)
        held = np.broadcast_to(force[i % len(force)], (times.size, arm.nv))
        laws = list(setup.control)
        if tau is not None:
            dt = times[1] - times[0]
            laws.append(
                Sampled(
                    lambda at, y, held=held, dt=dt: held[int((at - times[0]) / dt + 0.5)],
                    1 / dt,
                    actuate=[np.eye(arm.nv)[k] for k in range(arm.nv)],
                )
            )
        start = {
            k: x[i % len(x)]
            for k, x, given in (
                ("q0", q, q0 is not None or "q0" in str(parameters)),
                ("v0", v, v0 is not None or "v0" in str(parameters)),
            )
            if given
        }
        try:
            run = simulate(
                setup.arm, times, **start, drive=setup.drive, loads=setup.loads, control=laws,  # type: ignore[arg-type]
                integrator=integrator, step=step, rtol=rtol, **options,
            )  # fmt: skip
        except SimulationError as e:
            run = e.result
            result.status[i] = NOT_FINITE
            result.failures.append(Failure(i, e.time, str(e)))
        result.reached[i] = run.t[-1]
        n = len(run.t[::every])
        for k, x in arrays.items():
            if x is not None:
                x[i, :n] = getattr(run, k)[::every]
    result.stats = {"engine": "simulate", "workers": 1, "wall_time": time.perf_counter() - started}
    return result
