"""Many runs of fixed steps, from arrays to arrays."""

from __future__ import annotations

import time
import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..._check import Array, array, outside, whole
from ..._console import progress_bar
from ...analysis.findings import LoopWarning, RunWarning
from ...analysis.validity import range_warning, worst_range
from ...arm.arm import Arm
from ...arm.variation import Setup
from ...loop import loops
from ...model.acting.control import Controller
from ...model.acting.drive import Motion, Torque, Voltage
from ...model.acting.following import smooth
from ...model.acting.load import Load
from ...run.integrators import Integrator
from ...run.problem import Problem
from ...run.steps import FAST_JOINTS, Struck, beyond_explicit, failed_steps, switches_too_often
from .arguments import (
    check_balls,
    check_every,
    check_memory,
    default_workers,
    forces,
    prepared,
    rows,
    scenario_count,
    stepping,
)
from .problems import STEP_BYTES, first_missed, problems_of, run_problems

_REASONS = {
    1: "the mass matrix is singular",
    2: "the equations of a step could not be solved: take a smaller step; with control, see whether its loop is stable",
    3: "the motion ran away: look for what drives it (a control loop, order 1 at high speed), or take a smaller step",
}
RAN_AWAY, NOT_DONE, OVER = 3, 4, 5
_LOOKS = 3  # scenarios of growing motion whose loops are tested

_Apart = Mapping[int, str]
#: arm, q0, loads and controllers by index
_Scenario = Callable[[int], tuple[Arm, Array, Any, Sequence[Controller]]]


@dataclass(frozen=True)
class Failure:
    """A scenario that failed: its `index`, the `time` reached (s), and the `reason`."""

    index: int
    time: float
    reason: str


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


def failures_of(
    blocks: Mapping[str, Any], scenario: _Scenario, prescribed: Sequence[int], times: Array, apart: _Apart
) -> list[Failure]:
    """The failures of scenarios whose `blocks` the core has written; with continuous control, the unstable loop that
    caused one.

    Args:
        scenario: arm, q0, loads and control by index. times: of the run. apart: of `run_problems`.
    """
    status, found = blocks["status"], []
    for i in np.flatnonzero((status > 0) & (status < NOT_DONE)).tolist():
        arm, q0, loads, control = scenario(i)
        reason, reached = apart[i] if apart else _REASONS[int(status[i])], float(blocks["reached"][i])
        if status[i] == RAN_AWAY and not apart and "q" in blocks and "v" in blocks:
            done = int(np.isfinite(blocks["q"][i]).all(axis=1).sum())
            last = (blocks[name][i, done - 1] for name in ("q", "v"))
            who = arm.in_names(arm._core.farthest_out(*last)) if done else ""
            reason = reason.replace(":", f"; {who} and grows:", 1) if who else reason
        if control and reached > times[0]:
            loop = loops.unstable(arm, q0, prescribed, times, loads, control, reached - float(times[0]), True)
            reason = reason if loop is None else f"{loop} ({reason.partition(':')[0]})"
        found.append(Failure(i, reached, reason))
    return found


def out_of_range(arms: Sequence[Arm], t: Array, q: Array) -> Array:
    """`worst_range` of each scenario's rows at times t (nout,), q (B, nout, nq): (B, 4), nan for those in range."""
    found, rows, beams = np.full((len(q), 4), np.nan), q.reshape(-1, q.shape[2]), [x.beam for x in arms[0].links]
    lost = np.isnan(rows[:, 0])
    rows = rows[~lost] if lost.any() else rows
    alike = all(arm is arms[0] or all(x.beam is b for x, b in zip(arm.links, beams, strict=True)) for arm in arms)
    if alike and worst_range(arms[0], np.zeros(len(rows)), rows) is None:  # usually one test of all rows is enough
        return found
    for k, rows in enumerate(q):
        here = ~np.isnan(rows[:, 0])
        found[k] = worst_range(arms[k % len(arms)], t[here], rows[here]) or np.nan
    return found


def judge(
    blocks: Mapping[str, Any], scenario: _Scenario, problems: Sequence[Problem], times: Array, every: int,
    integrator: Integrator, apart: _Apart, counted: Mapping[int, Mapping[str, Any]],
) -> None:  # fmt: skip
    """Stores in blocks["wrong"], (B,), warnings of scenarios; arguments as of `failures_of`. Tested are the fastest few
    scenarios of an arm: loops of continuous control if rates have grown; steps of an explicit integrator, also if the
    arm moves fast or a run failed.

    Args:
        problems: that were run. every: times between two rows. integrator: of the run. counted: of `run_problems`.
    """
    wrong, pulse = blocks["wrong"], first_missed(problems)
    if pulse is not None:
        wrong[pulse[0]] = [*(wrong[pulse[0]] or ()), pulse[1]]
    if integrator.explicit or any(p.controls for p in problems):
        _judge_growth(blocks, scenario, problems[0].prescribed, times, every, integrator, bool(apart))
    step, struck = getattr(integrator, "step", 0.0), dict[int, Struck]()
    for k, counts in counted.items() if integrator.fixed else ():
        beyond = "out_of_range" in blocks and np.isfinite(blocks["out_of_range"][k]).any()
        if apart.get(k) or blocks["status"][k] not in (0, OVER) or wrong[k] or (beyond and scenario(k)[3]):  # a loop
            continue
        often = switches_too_often(integrator.name, step, counts["switches"], counts["hasty"])
        if not often and counts["switches"] and integrator.name == "gauss":
            arm, q0, *_ = scenario(k)
            if id(arm) not in struck:  # a pose changes little of it
                struck[id(arm)] = Struck.of(arm, step, q0, problems[0].prescribed)
            often = struck[id(arm)].warning(step, counts["switches"])
        often = often or failed_steps(integrator.name, step, counts, counts["doubt"])
        wrong[k] = [often] if often else None


def _judge_growth(
    blocks: Mapping[str, Any], scenario: _Scenario, prescribed: Sequence[int], times: Array, every: int,
    integrator: Integrator, apart: bool,
) -> None:  # fmt: skip
    """Notes loops of control, and steps of an explicit integrator, that have made rates grow; arguments as of
    `judge`. Of scenarios that were run by themselves, the steps of all are examined: dry friction may hold growth."""
    wrong, v, explicit = blocks["wrong"], blocks.get("v"), integrator.explicit
    step = getattr(integrator, "step", 0.0)
    status, begin = blocks["status"], float(times[0])
    done, ran = np.isin(status, (0, OVER)), status != NOT_DONE
    grown, fast, size = np.zeros_like(done), ran, np.zeros(len(done))
    if v is not None:
        size = np.fmax(np.fmax.reduce(v, (1, 2), initial=0.0), -np.fmin.reduce(v, (1, 2), initial=0.0))
        grown = done & loops.has_grown(v)
        for k in np.flatnonzero(status == OVER):  # after the end its rows are nan
            grown[k] = loops.has_grown(v[k][np.isfinite(v[k]).all(axis=1)])
        fast = ran & (apart | grown | ~done | (v.shape[1] < 4) | (step * size > FAST_JOINTS))
    looks = Counter[int]()  # by arm, and at loops
    some = np.flatnonzero(fast if explicit else grown)
    for k in some[np.argsort(-size[some], kind="stable")].tolist():  # the fastest first
        arm, q0, loads, control = scenario(k)
        end, found = blocks["reached"][k] if done[k] else times[-1], list[RunWarning | None]()
        span = float(end) - begin
        if grown[k] and control and looks[0] < _LOOKS:
            looks[0] += 1
            found.append(loops.unstable(arm, q0, prescribed, times, loads, control, span, False))
        if explicit and looks[id(arm)] < _LOOKS:
            looks[id(arm)] += 1
            found.append(beyond_explicit(arm, step, span, q0, prescribed, _reached_rows(blocks, times[::every], k)))
        wrong[k] = [*(wrong[k] or ()), *filter(None, found)]


def _reached_rows(blocks: Mapping[str, Any], t: Array, k: int) -> tuple[Array, Array, Array] | None:
    """The rows of scenario k up to its end, if they are stored."""
    if not {"q", "v"} <= blocks.keys():
        return None
    q, v = blocks["q"][k], blocks["v"][k]
    there = np.isfinite(q).all(axis=1) & np.isfinite(v).all(axis=1)
    return t[there], q[there], v[there]


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


def _drives(drive: Any, step: float, nstep: int) -> list[dict[Any, Any]]:
    """The drives of all scenarios, or of each if values at half steps differ."""
    made: list[dict[Any, Any]] = [{}]
    if drive is not None and not isinstance(drive, Mapping):
        raise ValueError(f"drive = {drive!r}: must be a dictionary, by link")
    for key, law in (drive or {}).items():
        laws, where = [law], f"drive[{key!r}]"
        if not isinstance(law, (Motion, Torque, Voltage)):
            values = array(where, law, batch_ndim=3)
            if values.ndim not in (2, 3) or values.shape[-2:] != (2 * nstep + 1, 3) or not len(values):
                raise ValueError(
                    f"{where} has shape {values.shape}: must be a Motion, a Torque, a Voltage, or q, v, a at half "
                    f"steps: ({2 * nstep + 1}, 3)"
                )
            tables = values if values.ndim == 3 else values[None]
            laws = [smooth(Motion(0.5 * step * np.arange(2 * nstep + 1), *table.T)) for table in tables]
        count = scenario_count({"drive": len(made), where: len(laws)})
        made = [{**made[k % len(made)], key: laws[k % len(laws)]} for k in range(count)]
    return made


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
    drive: Mapping[Any, Motion | Torque | Voltage | ArrayLike] | None = None,
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
        drive, loads, events: as of `simulate`, alike for all scenarios. A motion may also be values (q, v, a) at half
            steps, (2 nstep + 1, 3) or (B, 2 nstep + 1, 3). Motions take the place of q0 and v0 there.
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
    return rolled(tell, **locals())


def tell(warning: RunWarning) -> None:
    warnings.warn(warning, stacklevel=outside())


def rolled(
    tell: Callable[[RunWarning], None], arm: Any, q0: Any, v0: Any = None, tau: Any = None, *, step: Any = None,
    nstep: Any = None, integrator: str | Integrator = "implicit", every: int = 1, drive: Any = None, loads: Any = None,
    control: Any = None, events: Any = None, workers: Any = None, rtol: Any = None, spectral_radius: Any = None,
    lanes: bool = True, out: Any = None, progress: Any = False,
) -> Rollout:  # fmt: skip
    """As `rollout`, but `tell` is called with each warning."""
    arms = _check_arms(arm)
    one = arms[0]
    chosen = stepping(integrator, step=step, rtol=rtol, spectral_radius=spectral_radius)
    length = chosen.options["step"]
    if nstep is not None and whole("nstep", nstep) < 1:
        raise ValueError(f"nstep = {nstep}: must be at least 1")
    q, v, force = rows("q0", q0, one.zero), rows("v0", v0, np.zeros(one.nv)), forces(tau, one.nv, nstep)
    if nstep is None and tau is None:
        raise ValueError("nstep = None: must be given, where tau does not tell it")
    steps, most = nstep or force.shape[1], max(len(arms), len(q), len(v), len(force))
    check_every(whole("every", every), steps)
    nout = steps // every + 1
    kept = 0 if out else 8 * nout * (one.nq + one.nv) * most
    check_memory(f"nstep = {steps}: {nout} rows of {most} scenarios, and {steps} steps,", kept + STEP_BYTES * steps,
                 "or fewer steps at once")  # fmt: skip
    drives, controls = _drives(drive, length, steps), _listed("control", control, "a controller")
    sizes = {"arm": len(arms), "q0": len(q), "v0": len(v), "tau": len(force), "control": len(controls)}
    count = scenario_count(sizes | {"drive": len(drives)})
    check_balls(one, q)
    made = max(len(arms) if drive or loads or control else 1, len(controls), len(drives))

    def setup(k: int) -> Setup:
        law = controls[k % len(controls)]
        laws = (law,) if isinstance(law, Controller) else law or ()
        return Setup(arms[k % len(arms)], drives[k % len(drives)], tuple(loads or ()), laws)

    times = length * np.arange(steps + 1, dtype=float)
    problems = problems_of([setup(k) for k in range(made)], count, times, events)
    blocks: dict[str, Any] = prepared(out, {"q": (count, nout, one.nq), "v": (count, nout, one.nv)})
    blocks |= {"status": np.zeros(count, np.int32), "reached": np.zeros(count)}
    blocks |= {"events": np.full(count, None)} if events else {}
    workers = default_workers(workers)
    started = time.perf_counter()
    with progress_bar(progress, "rolling out") as alive:
        stats = run_problems(problems, arms, count, every, q, v, None if tau is None else force, chosen, blocks,
                             workers, alive, lanes)  # fmt: skip
        if alive and not stats["interrupted"]:
            alive(1.0)
    interrupted, apart, counted = (stats.pop(name) for name in ("interrupted", "apart", "counted"))
    t, wrong = times[::every], np.full(count, None)
    ranges = out_of_range(arms, t, blocks["q"])
    beyond = np.flatnonzero(~np.isnan(ranges[:, 0]) & (blocks["status"] == 0))  # failures have a reason of their own
    stats |= {"wall_time": time.perf_counter() - started, **({"out_of_range": beyond.size} if beyond.size else {})}

    def scenario(k: int) -> tuple[Arm, Array, Any, Sequence[Controller]]:
        s = setup(k)
        return s.arm, q[k % len(q)], s.loads, s.control

    failures = failures_of(blocks, scenario, problems[0].prescribed, times, apart)
    result = Rollout(t, **blocks, failures=failures, stats=stats)
    if interrupted:
        done = int((result.status != NOT_DONE).sum())
        raise BatchInterrupted(f"interrupted when {done} of {count} scenarios were done", result)
    judge({**blocks, "wrong": wrong}, scenario, problems, times, every, chosen, apart, counted)
    found = lowest(wrong)
    if beyond.size and LoopWarning not in found:
        i = int(beyond[0])
        tell(range_warning(arms[i % len(arms)], ranges[i]).of(f"scenario {i}"))
    for warning in found.values():
        tell(warning)
    return result
