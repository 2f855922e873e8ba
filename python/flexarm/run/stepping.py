"""A simulation step by step: inputs between its steps, outputs behind them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import flexarm._core as _core

from .._check import Array, array, number
from ..arm.arm import Arm
from ..arm.variation import Setup
from ..model.acting.control import PD, Controller, Run
from ..model.acting.drive import Motion, Torque, Voltage, is_patch, is_strut, split_drives
from ..model.acting.load import Load
from .integrators import Ida, Implicit, Integrator
from .problem import Problem
from .result import Result
from .simulation import SimulationError


def _now(name: str, size: str = "") -> Any:
    """A value of the core; with `size`, nq or nv, the arm's part of a vector, without the states of controllers."""
    read = attrgetter(f"_core.{name}")
    return property(lambda self: read(self)[: getattr(self.arm, size)] if size else read(self))


class Simulation:
    """An arm in motion, step by step, for loops that set inputs and read outputs as they go.

    Args:
        of: a Scene, or an Arm, which the keyword arguments then belong to.
        integrator: `Implicit`, `Gauss` or `RK4`, with the step; or `Gauss()`, which chooses its steps. `Ida` is for
            `simulate`.
        t: times (s): the simulation starts at the first, and functions of time (samples, feed-forwards) are prepared
            until the last, beyond which steps may go. A scene's if None.
        q0, v0, tau, drive, loads, control, events: as of `simulate`.

    Attributes:
        t: time (s). q: (nq,). v, a: (nv,). tau: generalised forces (N, N m), those applied and the reactions of
            prescribed motions, (nv,). friction: dry friction of the joints, (nv,). All are copies.
        arm, integrator: as given. steps: how many were taken.
        failed_steps: of these, how many could not be solved as they are, and were divided; see `Implicit`.
        t_events, q_events, v_events: the events so far, as in `Result`.
        terminated: whether a terminal event has ended the last `step`. The state is that of its time, and the next
            `step` goes on from there: to where the arm goes on from, if you set it, or as if nothing was.

    Sampled controllers keep their clock, and joints that stick go on sticking.

    Raises:
        ValueError: bad arguments, a start without accelerations.
    """

    t: float = _now("t")
    steps: int = _now("steps")
    failed_steps: int = _now("failed_steps")
    terminated: bool = _now("terminated")
    q: Array = _now("q", "nq")
    v: Array = _now("v", "nv")
    a: Array = _now("a", "nv")
    tau: Array = _now("tau", "nv")
    friction: Array = _now("friction", "nv")

    @property
    def t_events(self) -> list[Array]:
        return self._core.events[0]

    @property
    def q_events(self) -> list[Array]:
        return [q[:, : self.arm.nq] for q in self._core.events[1]]

    @property
    def v_events(self) -> list[Array]:
        return [v[:, : self.arm.nv] for v in self._core.events[2]]

    def __init__(
        self, of: Any, integrator: Integrator | None = None, *, t: ArrayLike | None = None, q0: Any = None,
        v0: ArrayLike | None = None, tau: ArrayLike | None = None,
        drive: Mapping[Any, Motion | Torque | Voltage] | None = None, loads: Sequence[Load] | None = None,
        control: Controller | Sequence[Controller] | None = None, events: Any = None,
    ) -> None:  # fmt: skip
        if not isinstance(of, Arm):
            if not all(hasattr(of, name) for name in ("arm", "drive", "loads", "control")):
                raise ValueError(f"of = {of!r}: must be an Arm or a Scene")
            own = {"drive": drive, "loads": loads, "control": control, "events": events}
            for name, value in own.items():
                if value is not None:
                    raise ValueError(f"{name}: is the scene's own; change the scene")
            drive, loads, control, events = of.drive, of.loads, of.control, of.events
            t, q0 = of.t if t is None else t, of.q0 if q0 is None else q0
            v0 = of.v0 if v0 is None else v0
        self.integrator = Implicit(1e-3) if integrator is None else integrator
        if not isinstance(self.integrator, Integrator) or isinstance(self.integrator, Ida):
            raise ValueError(f"integrator = {integrator!r}: must be Implicit, Gauss or RK4, such as fa.Implicit(1e-3)")
        self.arm: Arm = of if isinstance(of, Arm) else of.arm
        times = np.array([0.0, 10.0]) if t is None else array("t", t)
        given: Any = drive, loads, control  # which the problem checks
        run = self._problem = Problem(Setup(self.arm, *given), times, q0, v0, tau, events)
        self._patches = list(split_drives(self.arm, drive)[1])
        with run.both.naming():
            problem = run.core_problem(run.start, run.events, weak=True)
            self._core = _core.Simulation(problem, self.integrator.core, float(times[0]))
        self._step = self._core.step

    def step(self, until: float | None = None) -> None:
        """Takes one step, given or chosen; or, with `until` (s), as many as reach that time, equal if they are given.

        Raises:
            SimulationError: the step could not be taken; the state is that of its beginning.
            KeyboardInterrupt: Ctrl-C on the way; the state is that of the last step.
        """
        if not (self._step() if until is None else self._core.advance(until)):
            with self._problem.both.naming():
                why = self._problem.both.in_names(self._core.failure)
            raise SimulationError(f"stopped at t = {self.t:.9g} s: {why}", self.t, self._row())

    def _row(self) -> Result:
        rows = {name: getattr(self, name)[None] for name in ("q", "v", "a", "tau", "friction")}
        unknown = np.full((1, len(self.arm.struts)), np.nan) if self._problem.strut_drives else None
        return Result(self.arm, np.array([self.t]), **rows, driven=unknown)  # they may have been set since

    def set_tau(self, tau: ArrayLike) -> None:
        """Constant generalised forces (N, N m), (nv,), from now on, to which those of drives are added."""
        self._core.set_tau(np.append(array("tau", tau, (self.arm.nv,)), np.zeros(self._problem.both.nv - self.arm.nv)))

    def set_drive(self, key: Any, value: float) -> None:
        """The force or tension of a drive (N, N m), or the voltage of a patch (V), from now on, in place of its law.

        Args:
            key: as of `drive` in `simulate`: a link, (link, freedom), the name of a strut or tendon, or ("patch", link,
                patch).
        """
        if is_strut(self.arm, key):
            sense = self.arm.struts[self.arm._strut(key)].sense
            self._set_wrench(self._force(key), np.array([sense * number("value", value), *[0.0] * 5]))
            return
        self._core.set_force(self._drive(key), number("value", value))

    def _drive(self, key: Any) -> int:
        if is_patch(key):
            if key in self._patches:
                return self._patches.index(key)
        else:
            (rate,) = self.arm.by_rate("key", {key: None})
            for k, drive in enumerate(self._problem.drives):
                if drive.rate == rate and not drive.moves:
                    return k
        raise self._not_driven(key)

    def _force(self, strut: str) -> int:
        """The number of a strut's driven force among the loads."""
        name = f"drive of '{strut}'"
        if name not in self._problem.force_names:
            raise self._not_driven(strut)
        return self._problem.force_names.index(name)

    @staticmethod
    def _not_driven(key: Any) -> ValueError:
        return ValueError(f"key = {key!r}: no torque or voltage drives it; give drive={{{key!r}: ...}} from the start")

    def set_load(self, index: int, force: ArrayLike = (0, 0, 0), moment: ArrayLike = (0, 0, 0)) -> None:
        """Force (N) and moment (N m) of the load of this number in `loads`, from now on, in place of its law."""
        if not 0 <= index < len(self._problem.loads):
            raise ValueError(f"load = {index}: must be the number, from 0, of one of {len(self._problem.loads)} loads")
        self._set_wrench(index, np.concatenate([array("force", force, (3,)), array("moment", moment, (3,))]))

    def _set_wrench(self, index: int, wrench: Array) -> None:
        self._core.set_load(index, wrench)

    def set_reference(self, index: int, reference: float, reference_rate: float = 0.0) -> None:
        """Reference (rad, m), and its rate, of the PD or StrainFeedback of this number in `control`, from now on."""
        controls = self._problem.controls
        law = controls[index] if 0 <= index < len(controls) else None
        if not isinstance(law, PD):
            raise ValueError(f"index = {index}: must be that of a PD or a StrainFeedback in control")
        run = Run(self._problem.times, self._problem.loads, 0, sum(c.memory for c in controls))
        before = sum(len(c._laws(self.arm, run)[0]) for c in controls[:index])
        rate = number("reference_rate", reference_rate)
        self._core.set_reference(before, law.kp * number("reference", reference) + law.kv * rate)

    def frame(self, link: int | str = -1, x: float | None = None) -> tuple[Array, Array]:
        """Position (3,) and orientation (3, 3) of a slice now; see `Arm.frame`."""
        return self.arm.frame(self.q, link, x)

    def state(self) -> Any:
        """All that the rest of the run follows from, but for the memory of Python functions and of an MPC.
        `restore` goes on from it to the last bit, here or in a simulation of the same problem."""
        return self._core.state()

    def restore(self, state: Any) -> None:
        """Goes back, or on, to a `state`.

        Raises:
            ValueError: a state of another problem.
        """
        if not isinstance(state, _core.State):
            raise ValueError(f"state = {state!r}: must come from state()")
        self._core.restore(state)

    def __repr__(self) -> str:
        return f"Simulation(t = {self.t:.6g} s, {self.steps} steps, {self.integrator})"
