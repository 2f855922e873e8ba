"""Simulation in time."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

import flexarm._core as _core

from .._check import choice, number, outside, whole
from .._console import progress_bar
from ..acting.control import Controller
from ..acting.drive import Motion, Torque
from ..acting.load import Load
from ..acting.voltage import Voltage
from ..analysis import loops
from ..analysis.coarse import coarse
from ..analysis.validity import SILENT, out_of_range
from ..arm import METHODS, Arm
from ..parts.part import ModelWarning
from .pace import Pace, beyond_explicit, explicit_limit, halved, hasty, unbalanced
from .parameter import Parameter, core_parameters
from .problem import Problem
from .result import Result
from .sensitivity import Source
from .variation import Setup
from .watch import Watch, beyond_motor, softened

_FIRST = 5  # steps of a run that its start may be to blame for
LINEAR_SOLVERS = ("auto", "dense", "chain")


class Integrator(NamedTuple):
    """What is to be known of an integrator, beside its steps, which are C++'s."""

    rtol: float  # if None is given
    options: tuple[str, ...] = ()  # of `simulate`, which it alone has
    fixed: bool = True  # whether it takes the steps that it is given
    explicit: bool = False  # whether these have a limit; see pace
    iterates: bool = True  # whether it reads rtol
    rubs: bool = False  # whether dry friction is in its equations
    in_batches: bool = False  # whether the core's batches have it


def _one_step(rubs: bool, iterates: bool, damps: bool, limited: bool) -> Integrator:
    options = ("spectral_radius",) if damps else ()
    return Integrator(1e-10, options, explicit=limited, iterates=iterates, rubs=rubs, in_batches=True)


#: By name, explicit ones last. Those of one step are C++'s (cpp/kernel/lanes/methods.hpp).
INTEGRATORS = {
    "ida": Integrator(1e-6, ("max_order", "linear_solver"), fixed=False),
    **{name: _one_step(**row) for name, row in _core.ONE_STEP.items()},
    "gauss": Integrator(1e-12, ("stages",)),
}
INTEGRATORS = dict(sorted(INTEGRATORS.items(), key=lambda item: item[1].explicit))
#: The integrator that an option belongs to.
OPTION_OF = {option: name for name, row in INTEGRATORS.items() for option in row.options}


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


def check_integrator(integrator: str, step: float | None, **options: Any) -> None:
    """Raises ValueError where an option is given to an integrator that does not have it, or a step is missing."""
    choice("integrator", integrator, INTEGRATORS)
    for name, value in options.items():
        if value is not None and OPTION_OF[name] != integrator:
            raise ValueError(f'{name} = {value}: is for integrator="{OPTION_OF[name]}", not for "{integrator}"')
    if not INTEGRATORS[integrator].fixed and step is not None:
        *names, last = (f'"{name}"' for name, row in INTEGRATORS.items() if row.fixed)
        others = f"{', '.join(names)} or {last}"
        raise ValueError(f'step = {step}: is for integrator={others}; "{integrator}" chooses its own steps')
    if INTEGRATORS[integrator].fixed and step is None:
        raise ValueError(f'step: integrator="{integrator}" needs it, in seconds, such as step=1e-3')


def _settings(
    integrator: str, rtol: Any, atol: Any, max_order: Any, linear_solver: Any, step: Any, spectral_radius: Any,
    stages: Any,
) -> dict[str, Any]:  # fmt: skip
    """Fills in the options of the integrators that are None."""
    return {
        "linear_solver": choice("linear_solver", linear_solver or "auto", LINEAR_SOLVERS),
        "rtol": number("rtol", INTEGRATORS[integrator].rtol if rtol is None else rtol),
        "atol": number("atol", atol),
        "max_order": whole("max_order", 5 if max_order is None else max_order),
        "stages": whole("stages", 4 if stages is None else stages),
        "spectral_radius": number("spectral_radius", 1.0 if spectral_radius is None else spectral_radius),
        "step": number("step", 0.0 if step is None else step),
    }


def _integrate(
    run: Problem, integrator: str, method: str, options: Mapping[str, Any], alive: Any,
    parameters: Sequence[Parameter] = (), tape: Any = None,
) -> dict[str, Any]:  # fmt: skip
    """The core's run: of "ida" with derivatives by parameters, of others on a tape for them."""
    with run.both.naming():
        out = _run(run, integrator, method, options, alive, parameters, tape)
    out["failure"] = run.both.in_names(out["failure"])
    return out


def _run(
    run: Problem, integrator: str, method: str, options: Mapping[str, Any], alive: Any,
    parameters: Sequence[Parameter], tape: Any,
) -> dict[str, Any]:  # fmt: skip
    last = {"composite": method == "ci", "alive": alive}
    if not INTEGRATORS[integrator].fixed:
        own = {k: options[k] for k in ("rtol", "atol", "max_order", "linear_solver")}
        pace = Pace(run.arm, run.times, lambda time: run.unstable(time, False))
        by = core_parameters(run, parameters)
        return _core.simulate_ida(run.core, run.times, **own, slow=pace, **last, parameters=by)
    own = {k: options[k] for k in ("step", "rtol", "spectral_radius", "stages")}
    return _core.simulate_fixed(run.core, run.times, integrator=integrator, **own, **last, tape=tape)


def source(
    setup: Setup, t: ArrayLike, q0: ArrayLike | str | None, v0: ArrayLike | None, tau: ArrayLike | None = None, *,
    integrator: str = "ida", method: str = "ab", rtol: float | None = None, atol: float = 1e-9,
    max_order: int | None = None, linear_solver: str | None = None, step: float | None = None,
    spectral_radius: float | None = None, stages: int | None = None, events: Any = None, alive: Any = None,
    of: Any = None,
) -> Source:  # fmt: skip
    """What a run is made of, to be run or derived; arguments as of `simulate`, `of` as of Source. `alive` is called now
    and then with the time reached, and may raise."""
    special = {"max_order": max_order, "linear_solver": linear_solver, "spectral_radius": spectral_radius}
    check_integrator(integrator, step, **special, stages=stages)
    options = _settings(integrator, rtol, atol, **special, step=step, stages=stages)
    return _source(setup, t, q0, v0, tau, integrator, method, options, events, alive, of)


def _source(
    setup: Setup, t: ArrayLike, q0: Any, v0: Any, tau: Any, integrator: str, method: str, options: Mapping[str, Any],
    events: Any, alive: Any = None, of: Any = None,
) -> Source:  # fmt: skip
    """With all options."""
    v, forces = (None if x is None else np.array(x, dtype=float) for x in (v0, tau))
    q = q0 if q0 is None or isinstance(q0, str) else np.array(q0, dtype=float)
    integrate = partial(_integrate, integrator=integrator, method=method, options=options, alive=alive)
    return Source(setup, np.array(t, dtype=float), q, v, forces, integrate, integrator, options, of, events)


def _held(run: Problem, result: Result) -> list[int]:
    """The rates that are prescribed, and those that have never moved, such as of joints that stick all the time."""
    q = map(run.arm.coordinate_of, range(run.arm.nv))
    moved = [k < 0 or np.ptp(result.q[:, k]) > 0.0 or v.any() for k, v in zip(q, result.v.T, strict=True)]
    return [*run.prescribed, *np.flatnonzero(~np.array(moved, bool)).tolist()]


def _judged(run: Problem, out: dict[str, Any], result: Result, integrator: str, step: float) -> list[Warning]:
    """The warnings that a run deserves. Raises SimulationError where the run failed; its message begins with the cause
    where that is known, because the step is not to blame then."""
    time = float(out["reached"])
    if out["failure"] == "interrupted":
        raise SimulationInterrupted(f"interrupted at t = {time:.9g} s", time, result)
    beyond, failed = out_of_range(run.arm, result.t, result.q), bool(out["failure"])
    span = time - float(run.times[0])
    # a limit may hold a loop, but not in its model's range
    limits = failed or beyond is not None
    loop = run.unstable(span, limits) if limits or loops.has_grown(result.v) else None
    if not failed:
        explicit = INTEGRATORS[integrator].explicit
        rows = result.t, result.q, result.v
        blown = beyond_explicit(run.arm, step, span, run.start["q0"], _held(run, result), rows) if explicit else None
        chatters = hasty(integrator, step, out["stats"].get("switches", 0), out["hasty"])
        often = halved(integrator, step, out["stats"]) if INTEGRATORS[integrator].fixed and not loop else None
        said = [loop] if SILENT.get() else [loop or beyond, blown or chatters or often]
        return [x for x in (*said, beyond_motor(run.arm, result, run.prescribed), *run.missed()) if x]
    failure, degrees = out["failure"], run.in_degrees()
    asked = f". {degrees}" if degrees else ""
    cause = loop or softened(result.arm, result)
    if cause:
        what = failure.partition(": take ")[0].partition(": look ")[0]
        raise SimulationError(f"stopped at t = {time:.9g} s: {cause} ({what}){asked}", time, result)
    if "could not be solved" in failure and INTEGRATORS[integrator].rubs and span < _FIRST * step and len(result.a):
        failure += unbalanced(run.arm, run.prescribed, result.a[0], step)
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
        q0: initial coordinates (nq,), or those of joints as `arm.pose` takes them, {"elbow": 0.3}; `arm.zero` if None.
            Prescribed joints start where their motion does; a different q0 is an error. Or "equilibrium": at rest in
            balance with gravity, springs, and the loads, torques and voltages that act at the start, joints with a
            motion where it starts; or "trim": the other joints held at zero too, only the beams sag.
        v0: initial rates (nv,), likewise; zero if None.
        tau: constant generalised forces (N, N m), (nv,), to which torque drives are added.
        drive: by link number (-1 is the last), or by (link, freedom), what drives that freedom of its joint: a Torque,
            or a Motion, whose reaction is then in `Result.tau`. By ("patch", link, patch): a piezo patch's Voltage.
        loads: external forces and moments.
        control: controllers, whose forces add up with the torques. Continuous ones (PD, StrainFeedback, StateFeedback,
            FeedForward, LinearController) are part of the equations; those with a rate (Sampled, LinearController,
            ComputedTorque, MPC) hold their force from sample to sample. `Result.tau` has them. A step ends at each
            sample; then the fixed-step integrators continue, while "ida" starts again.
        events: one or several callables (t, q, v) -> float whose zeros are sought, as in SciPy's solve_ivp: the run
            ends at the first zero of one with the attribute `terminal` = True (at the n-th where it is a number n);
            `direction` = 1 or -1 counts only zeros where the value rises, or falls. A value that is zero at the start
            is no event. Zeros are seen where the sign changes between two steps. A terminal event adds no row: the
            last row is the output time before it, and its own time and state are in `Result.t_events`, `q_events` and
            `v_events` alone.
        method: "ab" or "ci", for the accelerations at the output times.
        integrator: "ida": SUNDIALS IDA on the residual of inverse dynamics, variable step and order. "implicit":
            generalised-alpha, fixed step, second order, stable for elastic coordinates of any stiffness, cost linear
            in the number of links; a soft stop that the arm hits needs steps below 0.3 sqrt(mass / limit_stiffness).
            "gauss": Gauss collocation, fixed step, order 2 `stages`, as stable, symmetric in time; the most accurate
            for its cost, and the state between its steps is interpolated, so that output times do not shorten them;
            its matrices are dense, for arms of up to some tens of coordinates; jumps of a force belong into samples,
            which its steps end at, and stops that the arm hits need short steps.
            "rk4": classical Runge-Kutta, fixed step, fourth order, stable only while the step is below 2.83 over the
            highest frequency, which is higher where joints are free.
        rtol, atol: of IDA: tolerances of every coordinate and rate, relative (1e-6 if None) and absolute (in its unit).
            For "gauss" and "implicit", rtol alone is how far the equations of a step are solved, as a part of the
            motion, in the norm of kinetic energy (if None 1e-12, where coordinates of very small inertia are known to
            about 1e-8, and 1e-10); a tolerance near the error that the step leaves saves a third of the time.
        max_order: of IDA's backward differentiation formulas, 1 to 5 (if None). 5 needs the fewest steps if
            the motion must be followed (bench/run/ida_order.py: 4 to 8 times fewer than 2 at rtol 1e-6, 100 times
            closer or more); 2 needs fewer, 3 times at rtol 1e-5, where fast undamped modes are present but quiet and
            the tolerance is loose, because higher orders are unstable on undamped oscillation. 3 is the worst then.
        linear_solver: of IDA: "dense" factors the exact Jacobian, O(N³) once in several steps; "chain" eliminates like
            articulated bodies, O(N), which leaves out gyroscopic and geometric stiffness, and repeats that within
            GMRES where they matter; "auto" (if None) is "chain", the faster one at any number of links.
        step: of the fixed-step integrators (s): the longest step. Output times and samples of drives and loads are
            met exactly, by dividing the time between two of them into equal steps, as few as `step` allows; "gauss"
            ends its steps at samples of torques and loads alone, and halves those that would miss some of a motion, or
            whose equations cannot be solved.
        spectral_radius: of "implicit": the factor, 0 to 1, by which one step reduces a mode much too fast for it. 1
            (if None; trapezoidal rule) keeps the energy of every mode; but modes too fast for the step, once struck by
            a jump of a force, ring on in the accelerations. At 0.9 they die out, at about the same accuracy.
        stages: of "gauss", 1 to 4 (if None).
        watch: True: warns of energy in the highest modes, and of turning too fast for orders 0 and 1; or a Watch, such
            as `economize(...).watch`, for quantities that leave the range that a model was chosen for.
        progress: shows a progress bar on stderr, or lines where that is no terminal; or a callable, which gets the time
            reached (s) about ten times a second, and may raise to stop the simulation.

    Joints with dry friction (`coulomb`, `stiction`) stick and slide; a joint that sticks does not move at all.
    "implicit" has friction in the equations of its steps, and stays of second order. The other integrators find the
    times of switching like events, and start again after each; "gauss" takes the points of Radau then (Radau IIA, order
    2 `stages` - 1), whose steps do not leave ringing what a switch strikes and is too fast for them.

    No step passes over a sample of a drive. With "ida" and a drive that is a callable, no step passes over an output
    time. A pulse of a callable between steps can still be missed; a check at a thousand times after the run warns.

    Returns:
        Its `t_events`, `q_events` and `v_events` hold what occurred. When a terminal event ended the run, that is no
        error: the rows end at the last output time up to the event, and `status` is 1.

    Raises:
        ValueError: bad arguments, an event that gives nan.
        SimulationError: the integrator could not go on; it holds the time reached and the result so far.
        SimulationInterrupted: (a KeyboardInterrupt) Ctrl-C; it holds the same.

    Warns:
        RangeWarning: a beam bent further than its order is good for, or turned inside out, at the output times.
        LoopWarning: instead, if a control loop that is linear, and that no limit holds, is unstable about the start,
            and the run has grown.
        PulseWarning: a callable has a pulse between two steps that no step has seen.
        SlowWarning: "ida" takes very many steps; it names the cause, if known, and the remedy, during the run.
        StepWarning: steps of "rk4" above its limit, which is sought without control, at rest and at the fastest row;
            dry friction that switches many times within a step; many steps of "gauss" that had to be halved.
        WatchWarning: a quantity of `watch` has left its range.
        ModelWarning: a beam with too few shape functions for what it carries, or of a basis that does not suit it.
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
    run = Problem(arm, t, q0, v0, tau, drive, loads, control, events)
    options = _settings(integrator, rtol, atol, **special, step=step, stages=stages)
    begin, end = float(run.times[0]), float(run.times[-1])
    with progress_bar(progress, "simulating", end - begin) as bar:

        def show(now: float) -> None:
            assert bar is not None
            bar(now - begin, f"t = {now:.4g} of {end:.4g} s")

        out = _integrate(run, integrator, method, options, bar if bar is None or callable(progress) else show)
    result = run.result(out)
    setup = Setup(arm, dict(drive or {}), run.loads, tuple(run.controls))
    result._source = _source(setup, run.times, arm._posed(q0), v0, tau, integrator, method, options, events)
    for warning in _judged(run, out, result, integrator, options["step"]):
        warnings.warn(warning, stacklevel=outside())
    if not SILENT.get():
        for text in coarse(arm, drive, control, tau, loads, (result.t, result.q, result.v)):
            warnings.warn(text, ModelWarning, stacklevel=outside())
    if watch:
        (Watch.usual(arm) if watch is True else watch).warn(result)
    return result
