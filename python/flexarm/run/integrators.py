"""Integrators: objects that hold their options. A name, such as "implicit", stands for the object with its defaults."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any, ClassVar

import flexarm._core as _core

from .._check import choice, positive, whole, within
from ..arm.arm import Arm
from ..model.acting.drive import Motion, Torque
from .perturbed import Parameter, core_parameters
from .problem import Problem
from .steps import Pace

LINEAR_SOLVERS = ("auto", "dense", "chain")


class Integrator:
    """A method of time integration: `Ida`, or by fixed steps `Implicit`, `Gauss` or `RK4`."""

    name: ClassVar[str]
    needs_step: ClassVar[bool] = True
    taped: ClassVar[bool] = True  # whether derivatives come from a record of its steps
    explicit: ClassVar[bool] = False  # whether these have a limit; see steps
    iterates: ClassVar[bool] = True  # whether it reads rtol
    rtol = 1e-10

    @property
    def fixed(self) -> bool:
        """Whether it takes the steps that it is given."""
        return getattr(self, "step", None) is not None

    @property
    def options(self) -> dict[str, Any]:
        """Its options, as keyword arguments of its class."""
        return dict(vars(self))

    def run(self, problem: Problem, alive: Any, parameters: Sequence[Parameter], tape: Any) -> dict[str, Any]:
        """The core's run: of `Ida` with derivatives by parameters, of fixed steps on a tape for them."""
        return _core.simulate_fixed(problem.core, problem.times, self.core, alive=alive, tape=tape)

    @property
    def core(self) -> _core.Integrator:
        """It, as the core takes it."""
        return _core_of(self)


@lru_cache(64, typed=True)
def _core_of(integrator: Integrator) -> _core.Integrator:
    return _core.Integrator(integrator.name, **integrator.options)


@dataclass(frozen=True)
class Ida(Integrator):
    """SUNDIALS IDA on the residual of inverse dynamics: variable step and order. (Hindmarsh et al. 2005)

    Args:
        rtol, atol: tolerances of every coordinate and rate, relative and absolute (in its unit); with rigid loops,
            of every coordinate and every rate of a joint.
        max_order: highest order of its formulas (BDF), 1 to 5; 2 damps modes that are too fast, 5 is faster.
        linear_solver: of its Newton iterations: "dense" factors the exact Jacobian, O(N^3) once in several steps;
            "chain" eliminates like articulated bodies, O(N), which leaves out gyroscopic and geometric stiffness, and
            repeats that within GMRES where they matter; "auto" is "chain", the faster one at any number of links.
    """

    name: ClassVar[str] = "ida"
    needs_step: ClassVar[bool] = False
    taped: ClassVar[bool] = False
    rtol: float = 1e-6
    atol: float = 1e-9
    max_order: int = 5
    linear_solver: str = "auto"

    def __post_init__(self) -> None:
        positive("rtol", self.rtol)
        positive("atol", self.atol)
        within("max_order", whole("max_order", self.max_order), 1, 5)
        choice("linear_solver", self.linear_solver, LINEAR_SOLVERS)

    def run(self, problem: Problem, alive: Any, parameters: Sequence[Parameter], tape: Any) -> dict[str, Any]:
        tell, grown = problem.tell, lambda time: problem.unstable(time, False)
        pace = None if tell is None else Pace(problem.arm, problem.times, grown, tell)
        by = core_parameters(problem, parameters)
        return _core.simulate_ida(problem.core, problem.times, self.core, slow=pace, alive=alive, parameters=by)


@dataclass(frozen=True)
class Implicit(Integrator):
    """Generalised-alpha: fixed step, second order, stable at any stiffness, cost linear in links.

    (Chung & Hulbert 1993.) A step whose equations cannot be solved, as where a force leaps on a joint with hardly any
    inertia, is divided, which damps motion too fast for it; a run counts such steps (`stats["failed_steps"]`), and
    warns. Dry friction is in its equations. A soft stop that the arm hits needs
    steps below 0.3 sqrt(mass / limit_stiffness).

    Args:
        step: the longest step (s). Output times and samples of drives and loads are met exactly, by dividing the time
            between two of them into equal steps, as few as `step` allows.
        rtol: how far the equations of a step are solved, as a part of the motion, in the norm of kinetic energy; a
            tolerance near the error that the step leaves saves a third of the time.
        spectral_radius: the factor, 0 to 1, by which one step reduces a mode much too fast for it. 1 (trapezoidal rule)
            keeps the energy of every mode; but modes too fast for the step, once struck by a jump of a force, ring on
            in the accelerations. At 0.9 they die out, at about the same accuracy.
    """

    name: ClassVar[str] = "implicit"
    step: float
    rtol: float = 1e-10
    spectral_radius: float = 1.0

    def __post_init__(self) -> None:
        positive("step", self.step)
        positive("rtol", self.rtol)
        within("spectral_radius", self.spectral_radius, 0, 1)


@dataclass(frozen=True)
class Gauss(Integrator):
    """Gauss collocation: chosen or fixed steps, order 2 `stages`, stable at any stiffness, cheap.

    (Hairer & Wanner, Solving ODEs II.) Without a `step` it chooses its steps by an estimate of their error in the
    places of the arm, its joints and its links' ends, and of its energy; vibration that is too fast for the steps
    counts by its size. It is symmetric in time. The state between its steps is interpolated, so that output times do
    not shorten them; its matrices are dense, for arms of up to some tens of coordinates; jumps of a force belong into
    samples, which its steps end at, and stops that the arm hits need short steps. With dry friction it takes the
    points of Radau (Radau IIA, order 2 `stages` - 1), whose steps damp vibration that a switch strikes and that is
    too fast for them.

    Args:
        step: the longest step (s); None: it chooses. Steps end at samples of torques and loads alone; those that would
            miss some of a motion, or whose equations cannot be solved, are halved.
        stages: 1 to 4.
        rtol: how far the equations of a step are solved, as a part of the motion, in the norm of kinetic energy, where
            coordinates of very small inertia are known to about 1e-8; in steps that it chooses no further than a
            thousandth of the tolerance.
        tolerance: of steps that it chooses: the error of places that they aim at, as a part of the arm's length, of
            angles (rad), and of the energy, as a part of the largest kinetic energy; a step may miss a quarter of it in
            places, with dry friction a thirtieth. With a callable drive, load or reference, none of these steps passes
            over an output time.
    """

    name: ClassVar[str] = "gauss"
    needs_step: ClassVar[bool] = False
    step: float | None = None
    stages: int = 4
    rtol: float = 1e-12
    tolerance: float = 1e-5

    def __post_init__(self) -> None:
        if self.step is not None:
            positive("step", self.step)
        positive("tolerance", self.tolerance)
        positive("rtol", self.rtol)
        within("stages", whole("stages", self.stages), 1, 4)

    @property
    def core(self) -> _core.Integrator:
        tolerance = self.tolerance if self.step is None else None
        step = 0.0 if self.step is None else self.step
        return _core.Integrator(self.name, step=step, stages=self.stages, rtol=self.rtol, tolerance=tolerance)


@dataclass(frozen=True)
class RK4(Integrator):
    """The classical Runge-Kutta method: fixed step, fourth order, stable for short steps alone.

    The step must be below 2.83 over the highest frequency, which is higher where joints are free.

    Args:
        step: the longest step (s).
    """

    name: ClassVar[str] = "rk4"
    explicit: ClassVar[bool] = True
    iterates: ClassVar[bool] = False
    step: float

    def __post_init__(self) -> None:
        positive("step", self.step)


#: By name, explicit ones last. A new one is a class and its row here, and its steps in C++.
INTEGRATORS: Mapping[str, type[Integrator]] = {x.name: x for x in (Ida, Implicit, Gauss, RK4)}
_OWN = {name: [f.name for f in fields(x)] for name, x in INTEGRATORS.items()}  # type: ignore[arg-type]
#: The integrators that have an option.
OPTIONS = {x: tuple(name for name in _OWN if x in _OWN[name]) for own in _OWN.values() for x in own}


DENSE = 60  # the most coordinates for Gauss collocation: its matrices are dense


def asks_functions(of: Any) -> bool:
    """Whether a torque, a voltage, a load or a reference of a continuous controller of a Setup or Scene is a Python
    function, which may leap at any time."""
    laws = [x for x in (*of.drive.values(), *of.loads) if not isinstance(x, Motion)]
    for law in of.control:
        if getattr(law, "rate", None) is None:
            laws += [x for x in vars(law).values() if isinstance(x, Torque)]
    return any(not isinstance(x.law, (tuple, _core.PiecewisePolynomial)) for x in laws)


def beyond_ida(arm: Arm) -> bool:
    """Whether dry friction of joints stands beside loops or contacts with friction, which "ida" cannot run."""
    rubs = any(link.joint.rubs for link in arm.links)
    return rubs and bool(arm.loops or arm.rubbing)


def named(of: Any, integrator: str | Integrator | None, options: Mapping[str, Any]) -> str | Integrator:
    """The integrator as given; where none is, "gauss", which chooses its steps; or "ida", if an option of it is given,
    such as rtol, if a force is a Python function, whose leaps it finds, or if the arm has more than 60 coordinates; but
    not where it cannot run.

    Args:
        of: a Setup or Scene.
    """
    if integrator is not None:
        return integrator
    given = {k for k, x in options.items() if x is not None}
    if given & set(_OWN["ida"]):
        return "ida"
    chosen = given & set(_OWN["gauss"]) or (of.arm.nv <= DENSE and not asks_functions(of))
    return "gauss" if chosen or beyond_ida(of.arm) else "ida"


def integrator_on(of: Any, options: Mapping[str, Any]) -> Integrator:
    """The integrator of a Setup or Scene by the options of a run: its name, which may be missing, and its own.

    Raises:
        ValueError: as `integrator_of`.
    """
    rest = dict(options)
    return integrator_of(named(of, rest.pop("integrator", None), rest), **rest)


def integrator_of(integrator: str | Integrator, **options: Any) -> Integrator:
    """The integrator of a name and its options; None stands for an option's default.

    Raises:
        ValueError: an unknown name; an option that it does not have; a step that is missing.
    """
    try:
        return _integrator_of(integrator, **options)
    except TypeError:  # options that are not hashable
        return _integrator_of.__wrapped__(integrator, **options)


@lru_cache(64, typed=True)
def _integrator_of(integrator: str | Integrator, **options: Any) -> Integrator:
    given = {k: x for k, x in options.items() if x is not None}
    for name in given:
        if name == "method":
            raise ValueError("method: belongs to the dynamics: arm.forward_dynamics(q, v, tau, method=)")
        choice("argument", name, OPTIONS)
    if isinstance(integrator, Integrator):
        for name, value in given.items():
            raise ValueError(f"{name} = {value}: belongs into the integrator, {type(integrator).__name__}({name}=...)")
        return integrator
    kind = INTEGRATORS[choice("integrator", integrator, INTEGRATORS)]
    for name, value in given.items():
        if integrator in OPTIONS[name]:
            continue
        *others, last = (f'"{x}"' for x in OPTIONS[name])
        whom = f"{', '.join(others)} or {last}" if others else last
        more = f'; "{integrator}" chooses its own steps' if name == "step" else f', not for "{integrator}"'
        raise ValueError(f"{name} = {value}: is for integrator={whom}{more}")
    if kind.needs_step and "step" not in given:
        raise ValueError(f'step: integrator="{integrator}" needs it, in seconds, such as step=1e-3')
    return kind(**given)
