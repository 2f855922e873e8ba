"""Many short or long runs of fixed steps, from arrays to arrays."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._check import Array, array, choice, number, whole
from .arm import Arm
from .control import Controller
from .drive import Motion
from .sampled import Sampled
from .simulation import SimulationError, simulate

STEPPERS = ("implicit", "rk4")
#: Rollout.status: done; and why a scenario stopped.
OK, SINGULAR, NOT_CONVERGED, NOT_FINITE, NOT_DONE = range(5)


class Failure(NamedTuple):
    """A scenario that could not go on: its index, the time reached (s), and why."""

    index: int
    time: float
    reason: str


class BatchInterrupted(KeyboardInterrupt):
    """Ctrl-C during a batch. `.result` is what was computed up to there: a Rollout or a BatchResult."""

    def __init__(self, message: str, result: Any) -> None:
        super().__init__(message)
        self.result = result


@dataclass(repr=False)
class Rollout:
    """States of B scenarios at nout times; row 0 is the start.

    Attributes:
        t: times (s), (nout,). q: (B, nout, nq). v: (B, nout, nv). Rows after a failure are nan.
        status: (B,): 0 where all steps were taken; 1: the mass matrix is singular, 2: the equations of a step could not
            be solved, 3: the motion ran away, 4: interrupted before the end.
        reached: (B,), time reached (s).
        failures: index, time and reason of each scenario that failed.
        stats: engine, workers, steps, evaluations, wall_time (s).
    """

    t: Array
    q: Array
    v: Array
    status: NDArray[np.int32]
    reached: Array
    failures: list[Failure] = field(default_factory=list)
    stats: dict[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.q)

    def __repr__(self) -> str:
        return f"Rollout({len(self)} scenarios, {len(self.t)} rows, {len(self.failures)} failed)"


def default_workers(workers: int | None) -> int:
    """The number of threads: as many as this process may use cores, if None."""
    if workers is None:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if whole("workers", workers) < 1:
        raise ValueError(f"workers = {workers}: must be at least 1")
    return workers


def check_arms(arm: Any) -> Sequence[Arm]:
    """One arm, or B of equal structure, as a list."""
    arms = [arm] if isinstance(arm, Arm) else arm
    if not isinstance(arms, Sequence) or not arms or not all(isinstance(a, Arm) for a in arms):
        raise ValueError(f"arm = {arm!r}: must be an Arm, or a list of them, one for each scenario")
    for k, other in enumerate(arms):
        if other.coordinates != arms[0].coordinates or other.nq != arms[0].nq:
            raise ValueError(f"arm[{k}]: must have the same coordinates as arm[0]: {', '.join(arms[0].coordinates)}")
    return arms


def scenario_count(sizes: Mapping[str, int]) -> int:
    """B, from how many scenarios each argument is for; 1 suits all."""
    count = max(sizes.values(), default=1)
    for name, n in sizes.items():
        if n not in (1, count):
            most = max(sizes, key=lambda k: sizes[k])
            raise ValueError(f"{name}: is for {n} scenarios, {most} for {count}; must be 1 or {count}")
    return count


def rows(name: str, value: ArrayLike | None, default: Array) -> Array:
    """(B or 1, n) from (B, n) or (n,)."""
    a = default if value is None else array(name, value)
    if a.ndim not in (1, 2) or a.shape[-1] != default.shape[-1]:
        n = default.shape[-1]
        raise ValueError(f"{name} has shape {a.shape}: must be ({n},) or (B, {n})")
    return np.atleast_2d(a)


def forces(tau: ArrayLike | None, nv: int, nstep: int | None) -> Array:
    """(B or 1, nstep or 1, nv) from what `rollout` takes; not copied where it is an array already."""
    if tau is None:
        return np.zeros((1, 1, nv))
    try:
        a = np.ascontiguousarray(tau, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"tau = {tau!r}: must be numbers") from None
    if a.ndim not in (2, 3) or a.shape[-1] != nv or a.size == 0:
        raise ValueError(f"tau has shape {a.shape}: must be (nstep, {nv}) or (B, nstep, {nv}); nstep may be 1")
    if nstep is not None and a.shape[-2] not in (1, nstep):
        raise ValueError(f"tau has shape {a.shape}: its last axis but one must be nstep = {nstep}, or 1")
    if not np.isfinite(a).all():
        raise ValueError("tau: must be finite, no nan or inf")
    return a if a.ndim == 3 else a[None]


def rollout(
    arm: Arm | Sequence[Arm],
    q0: ArrayLike,
    v0: ArrayLike | None = None,
    tau: ArrayLike | None = None,
    *,
    dt: float,
    nstep: int | None = None,
    integrator: str = "implicit",
    every: int = 1,
    feedback: Controller | Sequence[Any] | None = None,
    motion: Mapping[Any, Motion | ArrayLike] | None = None,
    workers: int | None = None,
    rtol: float | None = None,
    spectral_radius: float | None = None,
    out: Mapping[str, Array] | None = None,
    progress: Any = False,
) -> Rollout:
    """Takes B scenarios through nstep equal steps from t = 0; what is not given B times is alike for all."""
    arms = check_arms(arm)
    one = arms[0]
    q, v, force = rows("q0", q0, one.zero), rows("v0", v0, np.zeros(one.nv)), forces(tau, one.nv, nstep)
    count = scenario_count({"arm": len(arms), "q0": len(q), "v0": len(v), "tau": len(force)})
    choice("integrator", integrator, STEPPERS)
    nstep = force.shape[1] if nstep is None else whole("nstep", nstep)
    dt = number("dt", dt)
    t = dt * np.arange(nstep + 1)
    started = time.perf_counter()
    result = Rollout(
        t[::every],
        np.full((count, nstep // every + 1, one.nq), np.nan),
        np.full((count, nstep // every + 1, one.nv), np.nan),
        np.zeros(count, np.int32),
        np.zeros(count),
    )
    given = [] if feedback is None else [feedback] if isinstance(feedback, Controller) else list(feedback)
    for i in range(count):  # slow, and soon replaced
        held = np.broadcast_to(force[i % len(force)], (nstep, one.nv))
        law = Sampled(
            lambda at, y, held=held: held[min(int(at / dt + 0.5), nstep - 1)],
            1 / dt,
            actuate=[np.eye(one.nv)[k] for k in range(one.nv)],
        )
        options = {} if spectral_radius is None else {"spectral_radius": spectral_radius}
        try:
            run = simulate(
                arms[i % len(arms)], t, q[i % len(q)], v[i % len(v)], control=[*given, law], drive=motion,  # type: ignore
                integrator=integrator, step=dt, rtol=rtol, **options,
            )  # fmt: skip
        except SimulationError as e:
            run = e.result
            result.status[i] = NOT_FINITE
            result.failures.append(Failure(i, e.time, str(e)))
        result.reached[i] = run.t[-1]
        kept = len(run.t[::every])
        result.q[i, :kept], result.v[i, :kept] = run.q[::every], run.v[::every]
    result.stats = {
        "engine": "simulate", "workers": 1, "steps": nstep * count, "wall_time": time.perf_counter() - started
    }  # fmt: skip
    for name in ("q", "v"):
        if out and name in out:
            out[name][:] = getattr(result, name)
            setattr(result, name, out[name])
    return result
