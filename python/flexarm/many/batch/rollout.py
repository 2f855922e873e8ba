"""Many runs of fixed steps, from arrays to arrays."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..._check import Array, at_least, flag, instances, warn, whole, within
from ..._console import progress_bar
from ...analysis.findings import LoopWarning, RunWarning
from ...analysis.validity import range_warning
from ...arm.arm import Arm
from ...arm.variation import Setup
from ...model.acting.control import Controller, controllers
from ...model.acting.drive import Motion, Torque, Voltage
from ...model.acting.load import Load
from ...run.integrators import Integrator
from ...run.start import start
from ...run.touch import of_contacts
from .arguments import (
    check_memory,
    checked_drives,
    default_workers,
    forces,
    prepared,
    rows,
    scenario_count,
    stepping,
)
from .problems import NOT_DONE, STEP_BYTES, Failure, problems_of, run_problems


class BatchInterrupted(KeyboardInterrupt):
    """Ctrl-C during a batch. `.result` holds the results so far: a Rollout or a BatchResult."""

    def __init__(self, message: str, result: Any) -> None:
        super().__init__(message)
        self.result = result

    def __reduce__(self) -> Any:
        return type(self), (str(self), self.result)


@dataclass(repr=False)
class Rollout:
    """States of B scenarios at nout times; row 0 is the start.

    Attributes:
        t: times (s), (nout,). q: (B, nout, nq). v: (B, nout, nv). Rows after a failure are nan.
        status: (B,): 0 where all steps were taken; 1: the mass matrix is singular, 2: the equations of a step could not
            be solved, 3: the motion ran away (nan, or a beam bent by ten times its length), 4: interrupted before
            the end, 5: ended by a terminal event.
        reached: (B,), time reached (s).
        events: (B,), (t_events, q_events, v_events) of each scenario, as `simulate` has them; None without events.
        failures: index, time and reason of each scenario that failed.
        stats: lanes (scenarios side by side), workers, steps, evaluations, factorisations, newton_iterations,
            failed_steps (divided; see `fa.Implicit`), wall_time (s).
    """

    t: Array
    q: Array
    v: Array
    status: NDArray[np.int32]
    reached: Array
    events: NDArray[Any] | None = None
    failures: list[Failure] = field(default_factory=list)
    stats: dict[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.q)

    def __repr__(self) -> str:
        return f"Rollout({len(self)} scenarios, {len(self.t)} rows, {len(self.failures)} failed)"


def _check_arms(arm: Any) -> Sequence[Arm]:
    """One arm, or B of equal structure, as a list."""
    arms = [arm] if isinstance(arm, Arm) else arm
    if not isinstance(arms, Sequence) or not arms or not all(isinstance(a, Arm) for a in arms):
        raise ValueError(f"arm = {arm!r}: must be an Arm, or a list of them, one for each scenario")
    for k, other in enumerate(arms):
        if other is not arms[0] and (other.coordinates != arms[0].coordinates or other.nq != arms[0].nq):
            raise ValueError(f"arm[{k}]: must have the same coordinates as arm[0]: {', '.join(arms[0].coordinates)}")
    return arms


def lowest(wrong: NDArray[Any]) -> dict[type, RunWarning]:
    """The first warning of each kind in `wrong`, (B,), with the number of its scenario."""
    found: dict[type, RunWarning] = {}
    for k, own in enumerate(wrong):
        for warning in own or ():
            if type(warning) not in found:
                found[type(warning)] = warning.of(f"scenario {k}")
    return found


def _listed(name: str, given: Any, count: str) -> list[Any]:
    """An argument given once or, as a list of lists, for each scenario."""
    several = isinstance(given, (list, tuple)) and any(isinstance(c, (list, tuple)) for c in given)
    if several and not all(isinstance(c, (list, tuple)) for c in given):
        raise ValueError(f"{name} = {given!r}: must be {count}, a list of them, or such a list for each scenario")
    return [tuple(c) for c in given] if several else [tuple(given) if isinstance(given, (list, tuple)) else given]


def rollout(
    arm: Arm | Sequence[Arm],
    q0: ArrayLike,
    v0: ArrayLike | None = None,
    tau: ArrayLike | None = None,
    *,
    step: float | None = None,
    nstep: int | None = None,
    integrator: str | Integrator = "implicit",
    every: int = 1,
    drive: Mapping[Any, Motion | Torque | Voltage] | Sequence[Mapping[Any, Any]] | None = None,
    loads: Sequence[Load] | None = None,
    control: Controller | Sequence[Any] | None = None,
    events: Callable[..., float] | Sequence[Callable[..., float]] | None = None,
    workers: int | None = None,
    rtol: float | None = None,
    spectral_radius: float | None = None,
    lanes: bool = True,
    out: Mapping[str, Array] | None = None,
    progress: Any = False,
) -> Rollout:
    """Takes B scenarios through `nstep` equal steps from t = 0, in C++, over threads. Arguments that are not given B
    times are alike for all, without a copy. The result of a scenario depends neither on the workers nor on the others.

    Args:
        arm: an arm, or B arms with the same coordinates.
        q0, v0: initial coordinates (B, nq) or (nq,) and rates (B, nv) or (nv,); v0 is zero if None.
        tau: generalised forces (N, N m), (B, nstep, nv) or (nstep, nv), held over each step: tau[:, k] acts from
            t = k step to (k + 1) step. An axis of length 1 stands for all scenarios or steps. None: zero.
        step: length of a step (s), here or in the integrator. Where a sample of a drive, a load or a controller falls
            into a step, it is divided there, as in `simulate`.
        nstep: how many; None: as many as tau has.
        integrator: "implicit" or "rk4", or `fa.Implicit(...)`, `fa.RK4(...)`; see `simulate`. With "rk4", scenarios of
            joints with dry friction run one by one.
        every: steps between two rows of the result.
        drive: as of `simulate`, alike for all scenarios, or a list of B such dictionaries, which drive the same joints
            in the same way. Motions take the place of q0 and v0 there.
        loads, events: as of `simulate`, alike for all scenarios.
        control: controllers, as of `simulate`, alike for all scenarios: one, or a list of them; or a list of B such
            lists. A Python function that several scenarios share must not remember one of them.
        workers: threads; None: one for each core.
        rtol, spectral_radius: of "implicit"; see `simulate`.
        lanes: whether scenarios run side by side in the processor's vector lanes, as many as it has, where there are
            enough to be worth it. It changes results by rounding (1e-12).
        out: arrays "q" and "v" that the result is written into, float64, C-contiguous, of the result's shapes.
        progress: shows a bar on stderr, or lines where that is no terminal; or a callable, which is given the share of
            steps taken about ten times a second, and may raise to give up.

    Returns:
        Rollout: 8 (nq + nv) B nout bytes, beside one workspace for each worker.

    Raises:
        ValueError: bad arguments.
        BatchInterrupted: (a KeyboardInterrupt) Ctrl-C; its `result` holds the results so far.

    Warns:
        RangeWarning: a beam bent beyond the range of its order, or turned inside out, in scenarios that did not fail;
            `stats["out_of_range"]` is their number.
        LoopWarning: a control loop is unstable about the start of a scenario, which has grown.
        StepWarning: steps of "rk4" above the limit of a scenario's arm, which has grown; a callable has a pulse
            between two steps that no step has seen; the equations of a step could not be solved as they are.
    """
    return rolled(warn, **locals())


def rolled(
    tell: Callable[[RunWarning], None], arm: Any, q0: Any, v0: Any = None, tau: Any = None, *, step: Any = None,
    nstep: Any = None, integrator: str | Integrator = "implicit", every: int = 1, drive: Any = None, loads: Any = None,
    control: Any = None, events: Any = None, workers: Any = None, rtol: Any = None, spectral_radius: Any = None,
    lanes: bool = True, out: Any = None, progress: Any = False,
) -> Rollout:  # fmt: skip
    """As `rollout`, but `tell` is called with each warning."""
    arms = _check_arms(arm)
    one = arms[0]
    loads, lanes = instances("loads", () if loads is None else loads, Load, "Load"), flag("lanes", lanes)
    chosen = stepping(integrator, step=step, rtol=rtol, spectral_radius=spectral_radius)
    length = chosen.options["step"]
    if nstep is not None:
        at_least("nstep", nstep, 1)
    if one.constrained and (q0 is None or isinstance(q0, Mapping)):
        moves = checked_drives(drive)
        q0 = [start(x, q0, moves[k % len(moves)], None, 0.0) for k, x in enumerate(arms)]
    q, v, force = rows("q0", q0, one.zero), rows("v0", v0, np.zeros(one.nv)), forces(tau, one.nv, nstep)
    if nstep is None and tau is None:
        raise ValueError("nstep = None: must be given, where tau does not tell it")
    steps, most = nstep or force.shape[1], max(len(arms), len(q), len(v), len(force))
    within("every", whole("every", every), 1, steps, ", the number of steps")
    nout = steps // every + 1
    kept = 0 if out else 8 * nout * (one.nq + one.nv) * most
    check_memory(f"nstep = {steps}: {nout} rows of {most} scenarios, and {steps} steps,", kept + STEP_BYTES * steps,
                 "or fewer steps at once")  # fmt: skip
    drives, controls = checked_drives(drive), _listed("control", control, "a controller")
    sizes = {"arm": len(arms), "q0": len(q), "v0": len(v), "tau": len(force), "drive": len(drives),
             "control": len(controls)}  # fmt: skip
    count = scenario_count(sizes)
    one.check_balls("q0", q)
    made = max(len(arms) if drive or loads or control or of_contacts(events) else 1, len(drives), len(controls))

    def setup(k: int) -> Setup:
        laws = controllers(controls[k % len(controls)])
        return Setup(arms[k % len(arms)], drives[k % len(drives)], loads, laws)

    times = length * np.arange(steps + 1, dtype=float)
    setups = [setup(k) for k in range(made)]
    problems = problems_of(setups, count, times, events)
    blocks: dict[str, Any] = prepared(out, {"q": (count, nout, one.nq), "v": (count, nout, one.nv)})
    blocks |= {"status": np.zeros(count, np.int32), "reached": np.zeros(count)}
    blocks |= {"events": np.full(count, None)} if events else {}
    judged = {"wrong": np.full(count, None), "out_of_range": np.full((count, 4), np.nan)}
    workers = default_workers(workers)
    started = time.perf_counter()
    with progress_bar(progress, "rolling out") as alive:
        failures, stats = run_problems(
            problems, setups, arms, count, every, q, None if v0 is None and one.constrained else v,
            None if tau is None else force, chosen, {**blocks, **judged}, workers, alive, lanes,
        )  # fmt: skip
        interrupted = stats.pop("interrupted")
        if alive and not interrupted:
            alive(1.0)
    ranges, wrong = judged["out_of_range"], judged["wrong"]
    beyond = np.flatnonzero(~np.isnan(ranges[:, 0]) & (blocks["status"] == 0))  # failures have a reason of their own
    stats |= {"wall_time": time.perf_counter() - started, **({"out_of_range": beyond.size} if beyond.size else {})}
    result = Rollout(times[::every], **blocks, failures=failures, stats=stats)
    if interrupted:
        done = int((result.status != NOT_DONE).sum())
        raise BatchInterrupted(f"interrupted when {done} of {count} scenarios were done", result)
    found = lowest(wrong)
    if beyond.size and LoopWarning not in found:
        i = int(beyond[0])
        tell(range_warning(arms[i % len(arms)], ranges[i]).of(f"scenario {i}"))
    for warning in found.values():
        tell(warning)
    return result
