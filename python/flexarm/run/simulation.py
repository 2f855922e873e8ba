"""Simulation in time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._check import instance, warn
from .._console import progress_bar
from ..analysis.findings import RunWarning
from ..analysis.validity import range_warning, worst_range
from ..arm.arm import Arm
from ..arm.variation import Setup
from ..loop import loops
from ..model.acting.control import Controller
from ..model.acting.drive import Motion, Torque, Voltage
from ..model.acting.load import Load
from .integrators import Integrator, integrator_of, integrator_on, named
from .perturbed import Parameter
from .problem import Problem
from .result import Result
from .sensitivity import Source
from .steps import Struck, beyond_explicit, explicit_limit, failed_steps, switches_too_often
from .watch import softened


class _Stopped(BaseException):
    def __init__(self, message: str, time: float, result: Result) -> None:
        super().__init__(message)
        self.time, self.result = time, result

    def __reduce__(self) -> Any:
        return type(self), (str(self), self.time, self.result)


class SimulationError(_Stopped, RuntimeError):
    """A simulation that could not go on. `.time` is the time reached (s), `.result` the rows up to there."""


class SimulationInterrupted(_Stopped, KeyboardInterrupt):
    """Ctrl-C during a simulation; it holds the result so far. `.result`; `.time` is the time reached (s)."""


def _integrate(
    run: Problem, integrator: Integrator, alive: Any, parameters: Sequence[Parameter] = (), tape: Any = None
) -> dict[str, Any]:
    """The core's run: of "ida" with derivatives by parameters, of others on a tape for them."""
    try:  # as `naming` does, which costs more than the rest of this
        out = integrator.run(run, alive, parameters, tape)
    except ValueError as e:
        raise ValueError(run.both.in_names(str(e))) from None
    if out["failure"]:
        out["failure"] = run.both.in_names(out["failure"])
    return out


def source(
    setup: Setup, t: ArrayLike, q0: ArrayLike | Mapping[Any, Any] | str | None, v0: ArrayLike | None,
    tau: ArrayLike | None = None, *, integrator: str | Integrator | None = None, events: Any = None,
    alive: Any = None, of: Any = None, **options: Any,
) -> Source:  # fmt: skip
    """The source of a run, to be run or derived; arguments as of `simulate`, `of` as of Source. `alive` is called now
    and then with the time reached, and may raise."""
    if not isinstance(integrator, Integrator) or options:
        integrator = integrator_of(named(setup, integrator, options), **options)
    v, forces = (None if x is None else np.array(x, dtype=float) for x in (v0, tau))
    q = q0 if q0 is None or isinstance(q0, str) else dict(q0) if isinstance(q0, Mapping) else np.array(q0, dtype=float)
    integrate = partial(_integrate, integrator=integrator, alive=alive)
    return Source(setup, np.array(t, dtype=float), q, v, forces, integrate, integrator, of, events)


def _held(run: Problem, result: Result) -> list[int]:
    """The rates that are prescribed, and those that have never moved, such as of joints that stick all the time."""
    q = map(run.arm.coordinate_of, range(run.arm.nv))
    moved = [k < 0 or np.ptp(result.q[:, k]) > 0.0 or v.any() for k, v in zip(q, result.v.T, strict=True)]
    return [*run.prescribed, *np.flatnonzero(~np.array(moved, bool)).tolist()]


def _judged(run: Problem, out: dict[str, Any], result: Result, integrator: Integrator) -> list[RunWarning]:
    """The warnings that a run deserves. Raises SimulationError where the run failed; its message begins with the cause
    where that is known, because the step is not to blame then."""
    time = float(out["reached"])
    step = getattr(integrator, "step", 0.0) or 0.0
    if out["failure"] == "interrupted":
        raise SimulationInterrupted(f"interrupted at t = {time:.9g} s", time, result)
    failed, far = bool(out["failure"]), worst_range(run.arm, result.t, result.q)
    beyond = None if far is None else range_warning(run.arm, far)
    span = time - float(run.times[0])
    # a limit may hold a loop, but not in its model's range
    limits = failed or beyond is not None
    struck = result.contacts is not None and bool(np.any(result.contacts))  # which makes rates grow, too
    grown = limits or (not struck and loops.has_grown(result.v).item())
    loop = run.unstable(span, limits) if run.controls and grown else None
    if not failed:
        rows = result.t, result.q, result.v
        blown = integrator.explicit and beyond_explicit(
            run.arm, step, span, run.start["q0"], _held(run, result), rows
        )  # fmt: skip
        switches = out["stats"].get("switches", 0)
        chatters = switches_too_often(integrator.name, step, switches, out["hasty"])
        if switches and not chatters and integrator.name == "gauss" and integrator.fixed:
            chatters = Struck.of(run.arm, step, run.start["q0"], run.prescribed).warning(step, switches)
        often = None
        if integrator.fixed and not loop:
            often = failed_steps(integrator.name, step, out["stats"], out["doubt"])
        return [x for x in (loop or beyond, blown or chatters or often, *run.missed()) if x]
    failure, degrees = out["failure"], run.in_degrees()
    asked = f". {degrees}" if degrees else ""
    cause = loop or softened(result.arm, result)
    if cause:
        cut = failure.partition(": take ")[0].partition(": look ")[0]
        raise SimulationError(f"stopped at t = {time:.9g} s: {cause} ({cut}){asked}", time, result)
    limit = "over the highest frequency"
    if limit in failure:  # rk4's
        failure = failure.replace(limit, limit + explicit_limit(run.arm, step, run.start["q0"], run.prescribed)[0])
    if run.controls:
        failure += "; and see whether the loop of control is stable"
    more = f" ({beyond})" if beyond else ""
    raise SimulationError(f"stopped at t = {time:.9g} s: {failure}{more}{asked}", time, result)


def simulate(
    arm: Arm,
    t: ArrayLike,
    q0: ArrayLike | Mapping[Any, Any] | str | None = None,
    v0: ArrayLike | None = None,
    *,
    tau: ArrayLike | None = None,
    drive: Mapping[Any, Motion | Torque | Voltage] | None = None,
    loads: Sequence[Load] | None = None,
    control: Controller | Sequence[Controller] | None = None,
    events: Callable[..., float] | Sequence[Callable[..., float]] | None = None,
    integrator: str | Integrator | None = None,
    error: bool = False,
    progress: bool | Callable[[float], None] = False,
    **options: Any,
) -> Result:
    """Simulates an arm from t[0] and returns its state at every time of t.

    Args:
        arm: the arm.
        t: output times (s), at least two, increasing.
        q0: initial coordinates (nq,), or those of joints as `arm.pose` takes them, {"elbow": 0.3}; `arm.zero` if None.
            Prescribed joints start where their motion does; a different q0 is an error. Or "equilibrium": at rest in
            balance with gravity, springs, and the loads, torques and voltages that act at the start, joints with a
            motion where it starts; or "trim": the other joints held at zero too, only the beams sag; or "held": at
            rest as the controllers hold it, whose references have always had their values of the start: integrals
            and delays have settled.
        v0: initial rates (nv,), likewise; zero if None.
        tau: constant generalised forces (N, N m), (nv,), to which torque drives are added.
        drive: by link number (-1 is the last), or by (link, freedom), the drive of that freedom of its joint: a Torque,
            or a Motion, whose reaction is then in `Result.tau`. By the name of a strut or tendon: a Torque that adds to
            its force, or tension (N); of a strut with a mass a Motion, too, of its length (m). By ("patch", link,
            patch): a piezo patch's Voltage.
        loads: external forces and moments.
        control: controllers, whose forces add up with the torques. Continuous ones (PD, StrainFeedback, StateFeedback,
            FeedForward, LinearController) are part of the equations; those with a rate (Sampled, LinearController,
            ComputedTorque, MPC) hold their force from sample to sample. `Result.tau` has them. A step ends at each
            sample; then the fixed-step integrators continue, while "ida" starts again.
        events: `fa.Touch` and `fa.Release` of contacts, and callables (t, q, v) -> float whose zeros are sought, one
            or several, as in SciPy's solve_ivp: the run
            ends at the first zero of one with the attribute `terminal` = True (at the n-th where it is a number n);
            `direction` = 1 or -1 counts only zeros where the value rises, or falls. A value that is zero at the start
            is no event. Zeros are seen where the sign changes between two steps. A terminal event adds no row: the
            last row is the output time before it, and its own time and state are in `Result.t_events`, `q_events` and
            `v_events` alone.
        integrator: `fa.Gauss()`, Gauss collocation that chooses its steps for an error of places and energy, the
            default; by fixed steps `fa.Gauss(step)`, the most accurate for its cost on arms of up to some tens of
            coordinates, `fa.Implicit(step)`, generalised-alpha, second order, for arms of any stiffness and real-time
            loops, or `fa.RK4(step)`; or `fa.Ida(...)`, SUNDIALS IDA, variable step and order. A name, "gauss",
            "implicit", "rk4" or "ida", stands for the object with its defaults. None is "ida" where rtol, atol,
            max_order or linear_solver are given, where a torque, a voltage, a load or a reference is a Python function,
            whose leaps it finds, or the arm has more than 60 coordinates, unless it cannot run (joints with dry
            friction beside loops, or beside contacts with friction); else "gauss". `Result.stats` tells.
        error: estimates at once the error of the tip and its sources: the result's `print`, `plot` and
            `check` tell it, and `Result.error()` has it, or raises ValueError where it cannot be found.
        progress: shows a progress bar on stderr, or lines where that is no terminal; or a callable, which gets the time
            reached (s) about ten times a second, and may raise to stop the simulation.
        options: of an integrator that is given by its name: `integrator="gauss", step=1e-3` is `fa.Gauss(step=1e-3)`.

    Joints with dry friction (`coulomb`, `stiction`) stick and slide; a joint that sticks does not move at all.
    "implicit" has friction in the equations of its steps, and stays of second order. A step of "gauss" or "rk4" ends
    where a joint switches, and "ida" starts again there; "gauss" takes the points of Radau then (Radau IIA, order
    2 `stages` - 1), whose steps damp vibration that a switch strikes and that is too fast for them.

    No step passes over a sample of a drive by torque, of a load or of control. With steps that are chosen ("ida",
    "gauss" without a step) and a drive that is a callable, no step passes over an output time. A pulse of a
    callable between steps can still be missed; a check at a thousand times after the run warns.

    Returns:
        Its `t_events`, `q_events` and `v_events` hold the occurrences. When a terminal event ended the run, that is no
        error: the rows end at the last output time up to the event, and `status` is 1.

    Raises:
        ValueError: bad arguments, an event that gives nan.
        SimulationError: the integrator could not go on; it holds the time reached and the result so far.
        SimulationInterrupted: (a KeyboardInterrupt) Ctrl-C; it holds the same.

    Warns:
        If the numbers are wrong; `Result.check` lists that too, and possible improvements.
        RangeWarning: a beam bent further than its order is good for, or turned inside out, at the output times.
        LoopWarning: instead, if a control loop that is linear, and that no limit holds, is unstable about the start,
            and the run has grown.
        StepWarning: steps of "rk4" above its limit, which is sought without control, at rest and at the fastest row;
            dry friction that switches many times within a step (three of "rk4"), or strikes vibrations that steps of
            "gauss" damp and the arm does not; many steps of "gauss" that had to be halved; a callable with a pulse
            between two steps that no step has seen.
        SlowWarning: "ida" takes more than 2e7 steps; it names the cause, if known, and the remedy, during the run.
    """
    result = simulated(
        arm, t, q0, v0, tau=tau, drive=drive, loads=loads, control=control, events=events, integrator=integrator,
        progress=progress, tell=warn, **options,
    )  # fmt: skip
    if error:
        with suppress(ValueError):  # which the result keeps
            result.error(progress=progress is True)
    return result


def simulated(
    arm: Arm, t: ArrayLike, q0: Any = None, v0: ArrayLike | None = None, *, tau: ArrayLike | None = None,
    drive: Mapping[Any, Motion | Torque | Voltage] | None = None, loads: Sequence[Load] | None = None,
    control: Controller | Sequence[Controller] | None = None, events: Any = None,
    integrator: str | Integrator | None = None,
    progress: bool | Callable[[float], None] = False, tell: Callable[[RunWarning], None] | None = None, **options: Any,
) -> Result:  # fmt: skip
    """As `simulate`, but its warnings are in the result's `_wrong`, and told to `tell`, some of them during the run."""
    if "watch" in options:
        raise ValueError("watch: is asked for after the run, by result.check(watch)")
    if integrator is not None:
        integrator = integrator_of(integrator, **options)
    instance("arm", arm, Arm)
    given: Any = drive, loads, control  # which the problem checks
    run = Problem(Setup(arm, *given), t, q0, v0, tau, events)
    chosen = integrator if isinstance(integrator, Integrator) else integrator_on(run.setup, options)
    wrong: list[RunWarning] = []

    def note(warning: RunWarning) -> None:
        wrong.append(warning)
        if tell is not None:
            tell(warning)

    run.tell = note
    if callable(progress) or not progress:
        out = _integrate(run, chosen, progress or None)
    else:
        begin, end = float(run.times[0]), float(run.times[-1])
        with progress_bar(progress, "simulating", end - begin) as bar:
            show = bar and (lambda now: bar(now - begin, f"t = {now:.4g} of {end:.4g} s"))
            out = _integrate(run, chosen, show)
    out["stats"] = {"integrator": chosen.name, **out["stats"]}
    result = run.result(out)
    result._source = source(run.setup, run.times, q0, v0, tau, integrator=chosen, events=events)
    result._wrong, already = wrong, {type(x) for x in wrong}  # a loop may have been told of during the run
    for warning in _judged(run, out, result, chosen):
        if type(warning) not in already:
            note(warning)
    return result
