"""Simulation in time."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .. import _core
from .._check import Array, array, choice, number, whole
from .._console import progress_bar
from ..acting.control import Controller, control_laws, extended, padded
from ..acting.drive import Motion, Torque
from ..acting.load import Load, at_time
from ..acting.voltage import Voltage, patch_laws, split_drives
from ..analysis import loops
from ..analysis.doubts import ModelWarning, coarse
from ..analysis.validity import SILENT, out_of_range
from ..arm import METHODS, Arm
from .pace import Pace, beyond_explicit, explicit_limit
from .pulses import PulseWarning, missed
from .result import Result
from .watch import Watch, softened

INTEGRATORS = ("ida", "implicit", "gauss", "rk4")
LINEAR_SOLVERS = ("auto", "dense", "chain")
_RTOL = {"ida": 1e-6, "implicit": 1e-10, "gauss": 1e-12, "rk4": 1e-6}
#: The integrator that an option belongs to.
OPTION_OF = {"max_order": "ida", "linear_solver": "ida", "spectral_radius": "implicit", "stages": "gauss"}


class SimulationError(RuntimeError):
    """A simulation that could not go on. `.time` is the time reached (s), `.result` what was computed up to there."""

    def __init__(self, message: str, time: float, result: Result) -> None:
        super().__init__(message)
        self.time = time
        self.result = result

    def __reduce__(self) -> Any:
        return type(self), (str(self), self.time, self.result)


class SimulationInterrupted(KeyboardInterrupt):
    """Ctrl-C during a simulation. `.time` is the time reached (s), `.result` what was computed up to there."""

    def __init__(self, message: str, time: float, result: Result) -> None:
        super().__init__(message)
        self.time = time
        self.result = result

    def __reduce__(self) -> Any:
        return type(self), (str(self), self.time, self.result)


def read_events(events: Any) -> list[tuple[Any, int, int]]:
    """(callable, occurrence that ends the run or 0, direction) of each event."""
    given = [] if events is None else [events] if callable(events) else events
    if not isinstance(given, (list, tuple)):
        raise ValueError(f"events = {events!r}: must be a callable (t, q, v) -> float, or a list of them")
    out = []
    for k, f in enumerate(given):
        if not callable(f):
            raise ValueError(f"events[{k}] = {f!r}: must be a callable (t, q, v) -> float")
        terminal, direction = getattr(f, "terminal", False), getattr(f, "direction", 0)
        count = int(terminal) if isinstance(terminal, (bool, np.bool_)) else whole(f"events[{k}].terminal", terminal)
        if count < 0:
            raise ValueError(f"events[{k}].terminal = {terminal}: must be True, False or a number of occurrences")
        if number(f"events[{k}].direction", direction) not in (-1, 0, 1):
            raise ValueError(f"events[{k}].direction = {direction}: must be -1, 0 or 1")
        out.append((f, count, int(direction)))
    return out


def check_integrator(integrator: str, step: float | None, **options: Any) -> None:
    """Raises ValueError where an option is given to an integrator that does not have it, or a step is missing."""
    choice("integrator", integrator, INTEGRATORS)
    for name, value in options.items():
        if value is not None and OPTION_OF[name] != integrator:
            raise ValueError(f'{name} = {value}: is for integrator="{OPTION_OF[name]}", not for "{integrator}"')
    if integrator == "ida" and step is not None:
        raise ValueError(f'step = {step}: is for integrator="implicit", "gauss" or "rk4"; "ida" chooses its own steps')
    if integrator != "ida" and step is None:
        raise ValueError(f'step: integrator="{integrator}" needs it, in seconds, such as step=1e-3')


def _of_arm(event: Callable[..., Any], arm: Arm) -> Callable[..., Any]:
    """The event, of the arm's part of q and v."""
    return lambda t, q, v: event(t, q[: arm.nq], v[: arm.nv])


def _leave_out_memory(out: dict[str, Any], arm: Arm) -> None:
    """Takes the controllers' states out of what the core gives."""
    for name, n in (("q", arm.nq), ("v", arm.nv), ("a", arm.nv), ("tau", arm.nv), ("friction", arm.nv)):
        if out[name] is not None:
            out[name] = np.ascontiguousarray(out[name][:, :n])
    out["events"] = [(t, q[:, : arm.nq], v[:, : arm.nv]) for t, q, v in out["events"]]


def _fail(
    failure: str, time: float, step: float, result: Result, controlled: bool, loop: Warning | None,
    beyond: Warning | None,
) -> None:  # fmt: skip
    """Raises the SimulationError, whose message begins with the cause, where that is known: not the step is to blame
    then."""
    cause = loop or softened(result.arm, result)
    if cause:
        what = failure.partition(": take ")[0].partition(": look ")[0]
        raise SimulationError(f"stopped at t = {time:.9g} s: {cause} ({what})", time, result)
    limit = "over the highest frequency"
    if limit in failure:  # rk4's
        failure = failure.replace(limit, limit + explicit_limit(result.arm, step))
    if controlled:
        failure += "; and see whether the loop of control is stable"
    more = f" ({beyond})" if beyond else ""
    raise SimulationError(f"stopped at t = {time:.9g} s: {failure}{more}", time, result)


def _missed(
    arm: Arm, laws: Any, wrenches: Any, feedback: Any, asked: Any, times: Array
) -> Iterator[PulseWarning | None]:
    """What the steps have not seen of callables: of drives, of loads, of the references of control."""
    names = [f"drive of '{arm.coordinates[i]}'" if not len(column) else "voltage" for i, _, _, column in laws]
    names += [f"loads[{k}]" for k in range(len(wrenches))]
    callables = [law for _, _, law, _ in laws] + [law for _, law in wrenches]
    references = [law for _, _, _, law, _ in feedback if law is not None]
    names += ["reference of control"] * len(references)
    for name, law, calls in zip(names, callables + references, asked, strict=True):
        if calls is not None:
            yield missed(name, law, calls, float(times[0]), float(times[-1]))


def simulate(
    arm: Arm,
    t: ArrayLike,
    q0: ArrayLike | None = None,
    v0: ArrayLike | None = None,
    *,
    tau: ArrayLike | None = None,
    drive: Mapping[Any, Motion | Torque | Voltage] | None = None,
    loads: Sequence[Load] | None = None,
    control: Controller | Sequence[Controller] | None = None,
    events: Callable[..., float] | Sequence[Callable[..., float]] | None = None,
    method: str = "ab",
    integrator: str = "ida",
    rtol: float | None = None,
    atol: float = 1e-9,
    max_order: int | None = None,
    linear_solver: str | None = None,
    step: float | None = None,
    spectral_radius: float | None = None,
    stages: int | None = None,
    watch: bool | Watch = False,
    progress: bool | Callable[[float], None] = False,
) -> Result:
    """Simulates an arm from t[0] and returns its state at every time of t.

    Args:
        arm: the arm.
        t: output times (s), at least two, increasing.
        q0, v0: initial coordinates (nq,) and rates (nv,); `arm.zero` and zero if None. Prescribed
            joints start where their motion does; a q0 or v0 that says otherwise is an error.
        tau: constant generalised forces (N, N m), (nv,), to which torque drives are added.
        drive: by link number (-1 is the last), or by (link, freedom), what drives that freedom of its joint: a Torque,
            or a Motion, whose reaction is then in `Result.tau`. By ("patch", link, patch): a piezo patch's Voltage.
        loads: external forces and moments.
        control: controllers, whose forces add up with the torques. Continuous ones (PD, StrainFeedback, StateFeedback,
            LinearController) are part of the equations; those with a rate (Sampled, LinearController) hold their force
            from sample to sample. `Result.tau` has them. Samples are met exactly; behind each the fixed-step
            integrators go on, while "ida" begins anew.
        events: one or several callables (t, q, v) -> float whose zeros are sought, as in SciPy's solve_ivp: the run
            ends at the first zero of one with the attribute `terminal` = True (at the n-th where it is a number n);
            `direction` = 1 or -1 counts only zeros where the value rises, or falls. A value that is zero at the start
            is no event. Zeros are seen where the sign changes between two steps.
        method: "ab" or "ci", for the accelerations at the output times.
        integrator: "ida": SUNDIALS IDA on the residual of inverse dynamics, variable step and order. "implicit":
            generalised-alpha, fixed step, second order, stable however stiff the elastic coordinates are, cost linear
            in the number of links; a soft stop that is to be hit needs steps below 0.3 sqrt(mass / limit_stiffness).
            "gauss": Gauss collocation, fixed step, order 2 `stages`, as stable, symmetric in time; the most accurate
            for its cost, and the state between its steps is interpolated, so that output times do not shorten them;
            its matrices are dense, for arms of up to some tens of coordinates; jumps of a force belong into samples,
            which its steps end at, and stops that are hit want short steps.
            "rk4": classical Runge-Kutta, fixed step, fourth order, stable only while the step is below 2.83 over the
            highest frequency.
        rtol, atol: of IDA: tolerances of every coordinate and rate, relative (1e-6 if None) and absolute (in its unit).
            Of "gauss" and "implicit", rtol alone is how far the equations of a step are solved, as a part of the
            motion, in the norm of kinetic energy (if None 1e-12, where coordinates of very small inertia are known to
            about 1e-8, and 1e-10); a tolerance near the error that the step leaves saves a third of the time.
        max_order: of IDA's backward differentiation formulas, 1 to 5 (if None). 5 needs the fewest steps wherever
            what moves must be followed (bench/run/ida_order.py: 4 to 8 times fewer than 2 at rtol 1e-6, 100 times
            closer or more); 2 needs fewer, 3 times at rtol 1e-5, where fast undamped modes are present but quiet and
            the tolerance is loose, because higher orders are unstable on undamped oscillation. 3 is the worst there.
        linear_solver: of IDA: "dense" factors the exact Jacobian, O(N³) once in several steps; "chain" eliminates like
            articulated bodies, O(N), which leaves out gyroscopic and geometric stiffness, and repeats that within
            GMRES where they matter; "auto" (if None) is "chain", the faster one at any number of links.
        step: of the fixed-step integrators (s): the longest step. Output times and samples of drives and loads are
            met exactly, by dividing what lies between two of them into equal steps, as few as `step` allows; "gauss"
            ends its steps at samples of torques and loads alone, and halves those that would miss some of a motion, or
            whose equations cannot be solved.
        spectral_radius: of "implicit": what is left after one step of a mode much too fast for the step, 0 to 1. 1
            (if None; trapezoidal rule) keeps the energy of every mode; but modes too fast for the step, once struck by
            a jump of a force, ring on in the accelerations. At 0.9 they die out, at about the same accuracy.
        stages: of "gauss", 1 to 4 (if None).
        watch: True: warns of energy in the highest modes, and of turning too fast for orders 0 and 1; or a Watch, such
            as `economize(...).watch`, of what leaves the range that a model was chosen for.
        progress: shows a progress bar on stderr, where that is a terminal; or a callable, which is given the time
            reached (s) about ten times a second, and may raise to give the simulation up.

    Joints with dry friction (`coulomb`, `stiction`) stick and slide; what sticks is exactly still. "implicit" has that
    in the equations of its steps, of second order as without; for the other integrators the times of switching are
    found as events are, and they begin anew behind them.

    No step passes over a sample of a drive. With "ida", nor over an output time where a drive is a callable; a pulse of
    a callable between steps can still be missed: a thousand places are looked at after the run.

    Returns:
        Its `t_events`, `q_events` and `v_events` hold what occurred. When a terminal event ended the run, that is no
        error: the rows end at the last output time up to the event, and `status` is 1.

    Raises:
        ValueError: bad arguments, an event that gives nan.
        SimulationError: the integrator could not go on; it holds the time reached and the result so far.
        SimulationInterrupted: (a KeyboardInterrupt) Ctrl-C; it holds the same.

    Warns:
        RangeWarning: a beam bent further than its order is good for, at the output times.
        LoopWarning: instead, if a control loop that is linear, and that no limit holds, is unstable about the start,
            and the run has grown.
        PulseWarning: a callable does something between two steps that none of them has seen.
        SlowWarning: "ida" takes very many steps; what they follow, if that is known, and what to do. While it runs.
        StepWarning: steps of "rk4" above its limit.
        WatchWarning: what `watch` asks for.
        ModelWarning: a beam with too few shape functions for what it carries.
    """
    choice("method", method, METHODS)
    check_integrator(
        integrator,
        step,
        max_order=max_order,
        linear_solver=linear_solver,
        spectral_radius=spectral_radius,
        stages=stages,
    )
    if not isinstance(arm, Arm):
        raise ValueError(f"arm = {arm!r}: must be an Arm")
    if not isinstance(watch, (bool, Watch)):
        raise ValueError(f"watch = {watch!r}: must be True, False or a Watch")
    arm._warn()
    for text in coarse(arm):
        warnings.warn(text, ModelWarning, stacklevel=2)
    times = array("t", t)
    if times.ndim != 1 or times.size < 2:
        raise ValueError(f"t has shape {times.shape}: must be one list of at least two times")
    state = {}
    for name, value, zero in (("q0", q0, arm.zero), ("v0", v0, np.zeros(arm.nv)), ("tau", tau, np.zeros(arm.nv))):
        if name == "tau" and value is not None and np.ndim(value) > 1:
            raise ValueError("tau: must be constant here; give drive=Torque(t, tau) for what changes with time")
        state[name] = zero if value is None else array(name, value, zero.shape)
    arm.check_balls("q0", state["q0"])
    joints, patches = split_drives(drive)
    laws = patch_laws(arm, patches, times)
    for i, law in arm.by_rate("drive", joints).items():
        where = f"drive of '{arm.coordinates[i]}'"
        if not isinstance(law, (Motion, Torque)):
            raise ValueError(f"{where} = {law!r}: must be a Motion or a Torque")
        law.check_span(where, times)
        laws.append((i, isinstance(law, Motion), law.law, np.zeros(0)))
        if isinstance(law, Motion):
            law.check_rates(where, times)
            start = array(f"{where} at t = {times[0]}", law(float(times[0])), (3,))
            k = arm.coordinate_of(i)
            if k < 0:
                raise ValueError(f"{where}: the motion of a ball cannot be prescribed; use three rotations (Axes)")
            for name, given, at, value in (("q0", q0, k, start[0]), ("v0", v0, i, start[1])):
                if given is not None and abs(state[name][at] - value) > 1e-9 * max(1.0, abs(value)):
                    raise ValueError(f"{name}[{at}] = {state[name][at]}: {where} prescribes {value} at t = {times[0]}")
                state[name][at] = value
    places, _ = at_time(arm, loads, float(times[0]))
    for k, load in enumerate(loads or ()):
        load.check_span(f"loads[{k}]", times)
    prescribed = [i for i, moves, *_ in laws if moves]
    feedback, sampled, memory = control_laws(arm, control, times, loads, prescribed)
    both = extended(arm, memory) if memory else arm
    laws = [(i, moves, law, padded(column, both.nv) if column.size else column) for i, moves, law, column in laws]
    wrenches = [(place, load.law) for place, load in zip(places, loads or (), strict=True)]
    watched = [(_of_arm(f, arm), n, direction) for f, n, direction in read_events(events)]
    linear_solver = choice("linear_solver", linear_solver or "auto", LINEAR_SOLVERS)
    rtol, atol = number("rtol", _RTOL[integrator] if rtol is None else rtol), number("atol", atol)
    order, stages = (
        whole("max_order", 5 if max_order is None else max_order),
        whole("stages", 4 if stages is None else stages),
    )
    radius = number("spectral_radius", 1.0 if spectral_radius is None else spectral_radius)
    h = number("step", 0.0 if step is None else step)

    def unstable(time: float, failed: bool) -> loops.LoopWarning | None:
        if control is None:
            return None
        controls = [control] if isinstance(control, Controller) else list(control)
        start = padded(state["q0"], both.nq)
        return loops.unstable(arm, both, start, prescribed, times, loads, controls, sampled, time, failed)

    def integrate(alive: Any = None) -> dict[str, Any]:
        start = (padded(state["q0"], both.nq), padded(state["v0"], both.nv), padded(state["tau"], both.nv))
        motion = (both._core, laws, times, *start)
        ci, rest = method == "ci", (wrenches, watched, feedback, sampled)
        if integrator == "ida":
            pace = Pace(arm, times, lambda time: unstable(time, False))
            return _core.simulate_ida(*motion, rtol, atol, order, linear_solver, pace, ci, alive, *rest)
        return _core.simulate_fixed(*motion, integrator, h, rtol, radius, stages, ci, alive, *rest)

    begin, end = float(times[0]), float(times[-1])
    with progress_bar(progress, "simulating", end - begin) as bar:

        def show(now: float) -> None:
            assert bar is not None
            bar(now - begin, f"t = {now:.4g} of {end:.4g} s")

        out = integrate(bar if bar is None or callable(progress) else show)
    if memory:
        _leave_out_memory(out, arm)
    done = len(out["q"])
    result = Result(arm, times[:done], out["q"], out["v"], out["a"], out["tau"], out["stats"], tuple(loads or ()))
    result.status, result.friction = int(out["terminated"]), out["friction"]
    if watched:
        result.t_events, result.q_events, result.v_events = (list(x) for x in zip(*out["events"], strict=True))
    if out["failure"] == "interrupted":
        raise SimulationInterrupted(f"interrupted at t = {out['reached']:.9g} s", out["reached"], result)
    beyond, failed = out_of_range(arm, result.t, result.q), bool(out["failure"])
    grown = failed or beyond is not None or loops.has_grown(result.v)
    loop = unstable(out["reached"] - float(times[0]), failed) if grown else None
    if failed:
        _fail(out["failure"], out["reached"], h, result, control is not None, loop, beyond)
    blown = beyond_explicit(arm, h, out["reached"] - float(times[0])) if integrator == "rk4" else None
    if SILENT.get():
        beyond = blown = None
    for warning in (loop or beyond, blown, *_missed(arm, laws, wrenches, feedback, out["asked"], times)):
        if warning:
            warnings.warn(warning, stacklevel=2)
    if watch:
        (Watch.usual(arm) if watch is True else watch).warn(result)
    return result
