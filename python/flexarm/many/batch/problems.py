"""The problems of a batch, their run in the core, and the judgement of it: failures, and warnings of wrong numbers."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import flexarm._core as _core

from ..._check import Array
from ...analysis.assembly import closed_start
from ...analysis.findings import LoopWarning, RunWarning
from ...analysis.validity import worst_range
from ...arm.arm import Arm
from ...arm.variation import Setup
from ...loop import loops
from ...model.acting.control import Controller
from ...model.acting.drive import is_patch, is_strut
from ...run.integrators import Integrator
from ...run.problem import Problem
from ...run.steps import FAST_JOINTS, Pace, Struck, beyond_explicit, failed_steps, switches_too_often
from ...run.touch import of_contacts
from .job import renamed

_REASONS = {
    1: "the mass matrix is singular",
    2: "the equations of a step could not be solved: take a smaller step; with control, see whether its loop is stable",
    3: "the motion ran away: look for its cause (a control loop, order 1 at high speed), or take a smaller step",
}
RAN_AWAY, NOT_DONE, OVER = 3, 4, 5
_LOOKS = 3  # scenarios of growing motion whose loops are tested

_Apart = Mapping[int, str]
#: arm, q0, loads and controllers by index
_Scenario = Callable[[int], tuple[Arm, Array, Any, Sequence[Controller]]]
_FILLED = ("q", "v", "a", "tau", "contacts", "loops", "status", "reached", "events")
STEP_BYTES = 100  # of a step's times, here and in the core


def problems_of(
    setups: Sequence[Setup], count: int, t: Array, events: Any, names: NDArray[np.int64] | None = None,
    apart: bool = False,
) -> list[Problem]:  # fmt: skip
    """One problem if all scenarios can share it, except for their arms, else one for each; callables of time are
    sampled once for all.

    Args:
        setups: one, or one for each of `count` scenarios. t: times of the run.
        names: of the scenarios, in errors.
        apart: whether each scenario has steps of its own, which may miss a pulse of a callable of time that the
            others' see.
    """
    remembered: dict[int, Any] | None = None if apart else {}

    def made(k: int, s: Setup) -> Problem:
        try:
            return Problem(s, t, events=events, remembered=remembered, starts=False)
        except ValueError as e:
            if len(setups) == 1:
                raise
            raise ValueError(f"scenario {k if names is None else names[k]}: {e}") from None

    first = made(0, setups[0])
    alike = first.shares and not (apart and any(times is not None for times in first.core.asked))
    if count == 1 or ((len(setups) == 1 or (_differ_in_arms(setups) and not of_contacts(events))) and alike):
        return [first]
    return [first, *(made(k, setups[k % len(setups)]) for k in range(1, count))]


def _differ_in_arms(setups: Sequence[Setup]) -> bool:
    """Whether only the arms differ, and no action depends on them."""
    drive, arm = setups[0].drive, setups[0].arm
    if any(is_patch(key) or is_strut(arm, key) for key in drive):
        return False
    same = all(s.drive is drive or all(s.drive[k] is drive[k] for k in drive) for s in setups)
    return same and not any(s.loads or s.control for s in setups)


@dataclass(frozen=True)
class Failure:
    """A scenario that failed: its `index`, the `time` reached (s), and the `reason`."""

    index: int
    time: float
    reason: str


def run_problems(
    problems: Sequence[Problem], setups: Sequence[Setup], arms: Sequence[Arm], count: int, every: int,
    q0: Array | None, v0: Array | None, tau: Array | None, integrator: Integrator, blocks: Mapping[str, Any],
    workers: int, alive: Any = None, lanes: bool = True, whole: int = 0, names: NDArray[np.int64] | None = None,
) -> tuple[list[Failure], dict[str, Any]]:  # fmt: skip
    """Runs a batch in the core, into `blocks`: q, v, a, tau, contacts, loops and events if they are there, status,
    reached; and judges it, into "out_of_range" (if there is q) and "wrong", the warnings of each scenario.

    Args:
        setups: one, or one for each scenario. arms: the same, in place of the setups'.
        q0, v0: (B or 1, n) in place of the problems'. tau: (B or 1, nt - 1 or more or 1, nv), held.
        names: of the scenarios, in errors.

    Returns:
        The failures, and counts; counts["interrupted"] after Ctrl-C.
    """
    one, wrong = problems[0], blocks["wrong"]
    if arms[0].constrained:
        q0, v0 = _closed(problems, arms, q0, v0)

    def scenario(k: int) -> tuple[Arm, Array, Any, Sequence[Controller]]:
        s, arm = setups[k % len(setups)], arms[k % len(arms)]
        return arm, arm.zero if q0 is None else q0[k % len(q0)], s.forces, list(s.control)

    def grown(k: int, time: float) -> LoopWarning | None:
        arm, start, loads, control = scenario(k)
        return loops.unstable(arm, start, one.prescribed, one.times, loads, control, time, False) if control else None

    def note(k: int, warning: RunWarning) -> None:
        wrong[k] = [*(wrong[k] or ()), warning]

    paces: dict[int, Pace] = {}

    def slow(k: int, now: float, steps: int) -> None:
        """Told now and then by "ida"."""
        if k not in paces:
            paces[k] = Pace(scenario(k)[0], one.times, partial(grown, k), partial(note, k))
        paces[k](now, steps)

    with one.both.naming():
        try:
            batch = _core.BatchProblem(
                [p.core for p in problems], [a._core for a in arms] if len(arms) > len(problems) else [],
                scenarios=count, t=one.times, every=every, q0=None if q0 is None else q0[:, None],
                v0=None if v0 is None else v0[:, None], tau=tau, nq=one.arm.nq, nv=one.arm.nv,
                integrator=integrator.core, slow=slow, lanes=lanes, whole=whole,
            )  # fmt: skip
            stats = batch.run({k: blocks[k] for k in _FILLED if k in blocks}, workers, alive)
        except ValueError as e:
            raise ValueError(str(e) if names is None else renamed(str(e), names)) from None
    apart, counted = {k: one.both.in_names(reason) for k, reason in stats.pop("apart").items()}, stats.pop("counted")
    stats["failed_steps"] = sum(counts["failed_steps"] for counts in counted.values())
    if "q" in blocks:
        blocks["out_of_range"][:] = out_of_range(arms, one.times[::every], blocks["q"])
    failures = _failures(blocks, scenario, one.prescribed, one.times, apart)
    _judge(blocks, scenario, problems, every, integrator, apart, counted)
    return failures, stats


def _closed(
    problems: Sequence[Problem], arms: Sequence[Arm], q0: Array | None, v0: Array | None
) -> tuple[Array, Array]:  # fmt: skip
    """The starts at which the loops of these arms are closed; arguments as of `run_problems`."""
    found = []
    for k in range(max(len(problems), len(arms), *(len(x) for x in (q0, v0) if x is not None), 1)):
        p, arm = problems[k % len(problems)], arms[k % len(arms)]
        q, v = (start if x is None else x[k % len(x)] for start, x in ((p.start["q0"], q0), (p.start["v0"], v0)))
        q, v = np.array(q), np.array(v)
        for i, motion in p.motions.items():
            q[arm.coordinate_of(i)], v[i] = motion(float(p.times[0]))[:2]
        try:
            found.append(closed_start(arm, q, v, (q0 is not None, v0 is not None), p.prescribed))
        except ValueError as e:
            raise ValueError(f"scenario {k}: {e}") from None
    q, v = (np.array(x) for x in zip(*found, strict=True))
    return q, v


def _failures(
    blocks: Mapping[str, Any], scenario: _Scenario, prescribed: Sequence[int], times: Array, apart: _Apart
) -> list[Failure]:
    """The failures of scenarios whose `blocks` the core has written; with continuous control, the unstable loop that
    caused one.

    Args:
        scenario: arm, q0, loads and control by index. times: of the run. apart: of each scenario that was run by
            itself, why it ended.
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


def _judge(
    blocks: Mapping[str, Any], scenario: _Scenario, problems: Sequence[Problem], every: int, integrator: Integrator,
    apart: _Apart, counted: Mapping[int, Mapping[str, Any]],
) -> None:  # fmt: skip
    """Stores in blocks["wrong"], (B,), warnings of scenarios; arguments as of `_failures`. Tested are the fastest few
    scenarios of an arm: loops of continuous control if rates have grown; steps of an explicit integrator, also if the
    arm moves fast or a run failed.

    Args:
        problems: that were run. every: times between two rows. integrator: of the run.
        counted: of each scenario that ran apart, or in a lane in which a step was divided.
    """
    wrong = blocks["wrong"]
    missed = next(((k, pulse) for k, p in enumerate(problems) for pulse in p.missed() if pulse), None)
    if missed is not None:  # the first pulse of a callable that no step met
        wrong[missed[0]] = [*(wrong[missed[0]] or ()), missed[1]]
    if integrator.explicit or any(p.controls for p in problems):
        _judge_growth(blocks, scenario, problems[0], every, integrator, bool(apart))
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
    blocks: Mapping[str, Any], scenario: _Scenario, of: Problem, every: int, integrator: Integrator, apart: bool
) -> None:
    """Notes loops of control, and steps of an explicit integrator, that have made rates grow; arguments as of
    `_judge`. Of scenarios that were run by themselves, the steps of all are examined: dry friction may hold growth."""
    times, prescribed = of.times, of.prescribed
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
