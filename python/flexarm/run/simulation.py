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


class _Problem:
    """What is to be simulated, checked, as the core takes it.

    Attributes:
        arm, times, loads, controls: as given.
        start: q0, v0 and tau, of the arm alone.
        laws: (rate or -1, whether it prescribes that rate's motion, law of time, column of forces) of each drive.
        prescribed: the rates whose motion is given.
        feedback, sampled: laws of the controllers. events: (callable, occurrence that ends the run or 0, direction).
        both: the arm with a link for each state of a controller, which the core integrates.
    """

    def __init__(self, arm: Arm, t: ArrayLike, q0: Any, v0: Any, tau: Any, drive: Any, loads: Any, control: Any,
                 events: Any) -> None:  # fmt: skip
        self.arm, self.times = arm, _output_times(t)
        self.start = _initial_state(arm, q0, v0, tau)
        self.laws = _drive_laws(arm, drive, self.times, self.start, {"q0": q0, "v0": v0})
        places, _ = at_time(arm, loads, float(self.times[0]))
        self.loads = tuple(loads or ())
        for k, load in enumerate(self.loads):
            load.check_span(f"loads[{k}]", self.times)
        self.wrenches = [(place, load.law) for place, load in zip(places, self.loads, strict=True)]
        self.prescribed = [i for i, moves, *_ in self.laws if moves]
        self.feedback, self.sampled, memory = control_laws(arm, control, self.times, self.loads, self.prescribed)
        self.controls = [control] if isinstance(control, Controller) else list(control or ())
        self.both = extended(arm, memory) if memory else arm
        self.events = [(self._of_arm(f), n, direction) for f, n, direction in read_events(events)]

    def _of_arm(self, event: Callable[..., Any]) -> Callable[..., Any]:
        """The event, of the arm's part of q and v."""
        nq, nv = self.arm.nq, self.arm.nv
        return lambda t, q, v: event(t, q[:nq], v[:nv])

    def unstable(self, time: float, failed: bool) -> loops.LoopWarning | None:
        """The loop of control that has made the run grow in `time` (s), if one has."""
        if not self.controls:
            return None
        start = padded(self.start["q0"], self.both.nq)
        return loops.unstable(
            self.arm, self.both, start, self.prescribed, self.times, self.loads, self.controls, self.sampled, time,
            failed,
        )  # fmt: skip

    def integrate(self, integrator: str, method: str, options: Mapping[str, Any], alive: Any) -> dict[str, Any]:
        """The core's run."""
        nv = self.both.nv
        laws = [(i, moves, law, padded(column, nv) if column.size else column) for i, moves, law, column in self.laws]
        q0, v0, tau = (padded(x, self.both.nq if name == "q0" else nv) for name, x in self.start.items())
        motion = (self.both._core, laws, self.times, q0, v0, tau)
        last = (method == "ci", alive, self.wrenches, self.events, self.feedback, self.sampled)
        if integrator == "ida":
            rtol, atol, order, solver = (options[k] for k in ("rtol", "atol", "max_order", "linear_solver"))
            pace = Pace(self.arm, self.times, lambda time: self.unstable(time, False))
            return _core.simulate_ida(*motion, rtol, atol, order, solver, pace, *last)
        step, rtol, radius, stages = (options[k] for k in ("step", "rtol", "spectral_radius", "stages"))
        return _core.simulate_fixed(*motion, integrator, step, rtol, radius, stages, *last)

    def result(self, out: dict[str, Any]) -> Result:
        """What the core gave, without the controllers' states."""
        arm, done = self.arm, len(out["q"])
        sizes = {"q": arm.nq, "v": arm.nv, "a": arm.nv, "tau": arm.nv, "friction": arm.nv}
        kept: dict[str, Any] = {k: out[k] for k in sizes}
        if self.both is not arm:
            kept = {k: None if x is None else np.ascontiguousarray(x[:, : sizes[k]]) for k, x in kept.items()}
        status = int(out["terminated"])
        found = Result(arm, self.times[:done], stats=out["stats"], loads=self.loads, status=status, **kept)
        if self.events:
            found.t_events, q, v = (list(x) for x in zip(*out["events"], strict=True))
            found.q_events, found.v_events = [x[:, : arm.nq] for x in q], [x[:, : arm.nv] for x in v]
        return found

    def missed(self, asked: Any) -> Iterator[PulseWarning | None]:
        """What the steps have not seen of callables: of drives, of loads, of the references of control."""
        names = [f"drive of '{self.arm.coordinates[i]}'" if not len(column) else "voltage"
                 for i, _, _, column in self.laws]  # fmt: skip
        names += [f"loads[{k}]" for k in range(len(self.wrenches))]
        callables = [law for _, _, law, _ in self.laws] + [law for _, law in self.wrenches]
        references = [law for _, _, _, law, _ in self.feedback if law is not None]
        names += ["reference of control"] * len(references)
        for name, law, calls in zip(names, callables + references, asked, strict=True):
            if calls is not None:
                yield missed(name, law, calls, float(self.times[0]), float(self.times[-1]))


def _output_times(t: ArrayLike) -> Array:
    times = array("t", t)
    if times.ndim != 1 or times.size < 2:
        raise ValueError(f"t has shape {times.shape}: must be one list of at least two times")
    return times


def _initial_state(arm: Arm, q0: Any, v0: Any, tau: Any) -> dict[str, Array]:
    """q0, v0 and tau, zero where they are None."""
    state = {}
    for name, value, zero in (("q0", q0, arm.zero), ("v0", v0, np.zeros(arm.nv)), ("tau", tau, np.zeros(arm.nv))):
        if name == "tau" and value is not None and np.ndim(value) > 1:
            raise ValueError("tau: must be constant here; give drive=Torque(t, tau) for what changes with time")
        state[name] = zero if value is None else array(name, value, zero.shape)
    arm.check_balls("q0", state["q0"])
    return state


def _drive_laws(
    arm: Arm, drive: Any, times: Array, state: Mapping[str, Array], given: Mapping[str, Any]
) -> list[tuple[int, bool, Any, Array]]:
    """What the core takes of drives. Prescribed joints start where their motion does, which is written into `state`;
    a q0 or v0 that was `given` and says otherwise is an error."""
    joints, patches = split_drives(drive)
    laws = patch_laws(arm, patches, times)
    for i, law in arm.by_rate("drive", joints).items():
        where = f"drive of '{arm.coordinates[i]}'"
        if not isinstance(law, (Motion, Torque)):
            raise ValueError(f"{where} = {law!r}: must be a Motion or a Torque")
        law.check_span(where, times)
        laws.append((i, isinstance(law, Motion), law.law, np.zeros(0)))
        if isinstance(law, Torque):
            continue
        law.check_rates(where, times)
        start = array(f"{where} at t = {times[0]}", law(float(times[0])), (3,))
        k = arm.coordinate_of(i)
        if k < 0:
            raise ValueError(f"{where}: the motion of a ball cannot be prescribed; use three rotations (Axes)")
        for name, at, value in (("q0", k, start[0]), ("v0", i, start[1])):
            if given[name] is not None and abs(state[name][at] - value) > 1e-9 * max(1.0, abs(value)):
                raise ValueError(f"{name}[{at}] = {state[name][at]}: {where} prescribes {value} at t = {times[0]}")
            state[name][at] = value
    return laws


def _settings(
    integrator: str, rtol: Any, atol: Any, max_order: Any, linear_solver: Any, step: Any, spectral_radius: Any,
    stages: Any,
) -> dict[str, Any]:  # fmt: skip
    """Options of the integrators, with those that are None."""
    return {
        "linear_solver": choice("linear_solver", linear_solver or "auto", LINEAR_SOLVERS),
        "rtol": number("rtol", _RTOL[integrator] if rtol is None else rtol),
        "atol": number("atol", atol),
        "max_order": whole("max_order", 5 if max_order is None else max_order),
        "stages": whole("stages", 4 if stages is None else stages),
        "spectral_radius": number("spectral_radius", 1.0 if spectral_radius is None else spectral_radius),
        "step": number("step", 0.0 if step is None else step),
    }


def _judged(run: _Problem, out: dict[str, Any], result: Result, integrator: str, step: float) -> list[Warning]:
    """What is to be said of a run. One that failed is a SimulationError, whose message begins with the cause, where
    that is known: not the step is to blame then."""
    time = float(out["reached"])
    if out["failure"] == "interrupted":
        raise SimulationInterrupted(f"interrupted at t = {time:.9g} s", time, result)
    beyond, failed = out_of_range(run.arm, result.t, result.q), bool(out["failure"])
    span = time - float(run.times[0])
    loop = run.unstable(span, failed) if failed or beyond is not None or loops.has_grown(result.v) else None
    if not failed:
        blown = beyond_explicit(run.arm, step, span) if integrator == "rk4" else None
        said = [loop] if SILENT.get() else [loop or beyond, blown]
        return [x for x in (*said, *run.missed(out["asked"])) if x]
    failure = out["failure"]
    cause = loop or softened(result.arm, result)
    if cause:
        what = failure.partition(": take ")[0].partition(": look ")[0]
        raise SimulationError(f"stopped at t = {time:.9g} s: {cause} ({what})", time, result)
    limit = "over the highest frequency"
    if limit in failure:  # rk4's
        failure = failure.replace(limit, limit + explicit_limit(result.arm, step))
    if run.controls:
        failure += "; and see whether the loop of control is stable"
    more = f" ({beyond})" if beyond else ""
    raise SimulationError(f"stopped at t = {time:.9g} s: {failure}{more}", time, result)


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
    # Long for its docstring, which is the reference of every option.
    choice("method", method, METHODS)
    special = {"max_order": max_order, "linear_solver": linear_solver, "spectral_radius": spectral_radius}
    check_integrator(integrator, step, **special, stages=stages)
    if not isinstance(arm, Arm):
        raise ValueError(f"arm = {arm!r}: must be an Arm")
    if not isinstance(watch, (bool, Watch)):
        raise ValueError(f"watch = {watch!r}: must be True, False or a Watch")
    arm._warn()
    for text in coarse(arm):
        warnings.warn(text, ModelWarning, stacklevel=2)
    run = _Problem(arm, t, q0, v0, tau, drive, loads, control, events)
    options = _settings(integrator, rtol, atol, **special, step=step, stages=stages)
    begin, end = float(run.times[0]), float(run.times[-1])
    with progress_bar(progress, "simulating", end - begin) as bar:

        def show(now: float) -> None:
            assert bar is not None
            bar(now - begin, f"t = {now:.4g} of {end:.4g} s")

        out = run.integrate(integrator, method, options, bar if bar is None or callable(progress) else show)
    result = run.result(out)
    for warning in _judged(run, out, result, integrator, options["step"]):
        warnings.warn(warning, stacklevel=2)
    if watch:
        (Watch.usual(arm) if watch is True else watch).warn(result)
    return result
