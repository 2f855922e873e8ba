"""Exact derivatives of steps and rollouts: for filters, optimal control and learning."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

import flexarm._core as _core

from ..._check import Array, array, instance
from ..._console import progress_bar
from ..._threads import each
from ...analysis.step import STATUS, step_slopes
from ...arm.arm import Arm
from ...arm.variation import Setup, Variation
from ...model.acting.load import Load, at_time
from ...model.acting.motor import torque_limits
from ...run.integrators import Integrator
from ...run.perturbed import FOURTH, Parameter, check_paths, components, problems
from ...run.problem import Problem
from ...run.sensitivity import repeated
from .arguments import default_workers, stepping
from .rollout import rollout


class StepDerivatives(NamedTuple):
    """A step's end, and its exact Jacobians.

    Attributes:
        q, v: at the end, (..., nq) and (..., nv).
        A: of [q; v] at the end by that at the beginning, (..., 2 nv, 2 nv).
        B: of [q; v] at the end by the forces, (..., 2 nv, nv).
    """

    q: Array
    v: Array
    A: Array
    B: Array


class Gradient(NamedTuple):
    """Derivatives of a number that depends on a rollout.

    Attributes:
        q0, v0: by its start, (..., nq) and (..., nv). tau: by its forces, (..., nstep, nv).
        parameters: by each of the parameters asked for, by its path: (...), or (..., n) of a field of n numbers.
    """

    q0: Array
    v0: Array
    tau: Array
    parameters: dict[str, Array]


def step_derivatives(
    arm: Arm,
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike,
    *,
    step: float | None = None,
    integrator: str | Integrator = "implicit",
    rtol: float | None = None,
    spectral_radius: float | None = None,
    loads: Sequence[Load] | None = None,
    t: float = 0.0,
) -> StepDerivatives:
    """One step from each state, and the exact derivatives of its end by state and forces.

    They are of the method's own equations (Chung & Hulbert 1993; Runge-Kutta), by the exact ones of the dynamics. A
    step that begins anew, as in a `rollout` whose forces change at every step.

    Args:
        arm: without ball joints or dry friction, and contacts without friction.
        q, v, tau: states and the forces (N, N m) held over the step, (nq,) and (nv,) or (..., nq) and (..., nv).
        step: its length (s).
        integrator: "implicit" or "rk4", or `fa.Implicit(...)`, `fa.RK4(...)`; see `simulate`.
        rtol, spectral_radius: of "implicit"; see `simulate`.
        loads, t: loads, which are held over the step with their values at time t (s).

    Raises:
        ValueError: naming the field and the value; where a step has no solution.
    """
    chosen = stepping(integrator, step=step, rtol=rtol, spectral_radius=spectral_radius)
    q, v, tau = arm._batch(q=q, v=v, tau=tau)
    shape = np.broadcast_shapes(q.shape[:-1], v.shape[:-1], tau.shape[:-1])
    q, v, tau = (np.ascontiguousarray(np.broadcast_to(x, (*shape, x.shape[-1]))) for x in (q, v, tau))
    found = step_slopes(arm, "step_derivatives", q, v, tau, _core_options(chosen), at_time(arm, loads, t))
    return StepDerivatives(*found)


def _core_options(of: Integrator) -> tuple[str, float, float, float]:
    """Name, step, rtol and spectral radius."""
    own = of.options
    return of.name, own["step"], of.rtol, own.get("spectral_radius", 1.0)


def rollout_gradient(
    arm: Arm | Sequence[Arm],
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike,
    by_q: ArrayLike | None = None,
    by_v: ArrayLike | None = None,
    *,
    step: float | None = None,
    integrator: str | Integrator = "implicit",
    rtol: float | None = None,
    spectral_radius: float | None = None,
    parameters: Sequence[str] = (),
    workers: int | None = None,
    progress: Any = False,
) -> Gradient:
    """Derivatives of a number of a rollout by its start, forces and parameters of the arm.

    The adjoint method goes backwards through the steps, at a cost that does not depend on the number of forces. The
    derivatives are exact but for rounding: of the method's own equations, which begin anew where the forces change.

    Args:
        arm: without ball joints; with dry friction for "implicit" alone; contacts without friction. Or an arm for each
            scenario, in their order.
        q, v: of the `rollout` with every=1, (..., nstep + 1, nq) and (..., nstep + 1, nv).
        tau: its forces, (..., nstep, nv).
        by_q, by_v: derivatives of the number by these rows, of the shapes of q and v; None: zero.
        step, integrator, rtol, spectral_radius: those of the rollout.
        parameters: dotted paths of numbers of the arm, as of `simulate_batch`: "link.0.tip.mass", "gravity".
        workers: threads; None: one for each core.
        progress: shows a bar on stderr, or lines where that is no terminal; or a callable, which is given the number of
            scenarios done, and may raise to give up.

    Returns:
        Gradient.

    Raises:
        ValueError: naming the field and the value; where q and v are no such rollout.
    """
    chosen = stepping(integrator, step=step, rtol=rtol, spectral_radius=spectral_radius)
    q, v, tau = array("q", q), array("v", v), array("tau", tau)
    arms = [arm] if isinstance(arm, Arm) else list(arm)
    one = arms[0]
    for each_arm in arms:
        each_arm.refuse_rubbing("rollout_gradient: arm")
    if q.ndim < 2 or q.shape[-1] != one.nq or q.shape[:-1] != v.shape[:-1] or v.shape[-1] != one.nv:
        raise ValueError(f"q has shape {q.shape} and v {v.shape}: must be (..., nstep + 1, {one.nq}) and as many rates")
    if tau.shape != (*v.shape[:-2], v.shape[-2] - 1, one.nv):
        raise ValueError(f"tau has shape {tau.shape}: must be {(*v.shape[:-2], v.shape[-2] - 1, one.nv)}")
    rows = [np.zeros(x.shape) if g is None else array(name, g, x.shape)
            for name, g, x in (("by_q", by_q, q), ("by_v", by_v, v))]  # fmt: skip
    batch = q.shape[:-2]
    count, workers = int(np.prod(batch)), default_workers(workers)
    if len(arms) not in (1, count):
        raise ValueError(f"arm: is {len(arms)} arms; must be one, or one for each of {count} scenarios")
    rolls = _Rolls(chosen, tau.shape[-2], parameters, workers if count == 1 else 1)
    known = [rolls.near(a) for a in arms] if len(arms) == 1 else None
    found: list[Any] = [None] * count

    def go_back(k: int) -> None:
        i = np.unravel_index(k, batch) if batch else ()
        try:
            near = known[0] if known else rolls.near(arms[k])
            found[k] = rolls.back(near, q[i], v[i], tau[i], rows[0][i], rows[1][i])
        except ValueError as e:
            raise ValueError(f"{e}, in scenario {tuple(map(int, i))}" if batch else str(e)) from None

    with progress_bar(progress, "going back", count) as bar:

        def show() -> None:
            if bar is not None:
                bar(count - found.count(None))

        each(go_back, count, workers, show)
        show()
    q0, v0, forces, by = zip(*found, strict=True) if found else ([], [], [], [])

    def whole(parts: Sequence[Array], tail: tuple[int, ...]) -> Array:
        return np.array(parts).reshape((*batch, *tail))

    return Gradient(
        whole(q0, (one.nq,)), whole(v0, (one.nv,)), whole(forces, tau.shape[-2:]),
        {path: whole([x[path] for x in by], by[0][path].shape if by else ()) for path in parameters},
    )  # fmt: skip


_SAME = 1e-3  # of a motion: largest difference from the same rollout in the processor's lanes


class _Near(NamedTuple):
    """An arm and its neighbours by parameters, as the core takes them."""

    arm: Arm
    problem: Any
    paths: dict[str, list[str]]  # the numbers of each parameter
    neighbours: dict[str, Parameter]


class _Rolls:
    """Rollouts with the same options, repeated on a tape, and taken backwards."""

    def __init__(self, integrator: Integrator, nstep: int, paths: Sequence[str], workers: int) -> None:
        check_paths(paths)
        for path in paths:
            if str(path).endswith(".torque_limit"):
                raise ValueError(
                    f"parameters: '{path}': a rollout has no derivative by a limit; leave the limit out of the arm, "
                    "and give the forces clipped"
                )
            if str(path).split(".")[0] in ("q0", "v0"):
                raise ValueError(f"parameters: '{path}' is the start's; `.q0` and `.v0` are the derivatives by that")
        self.integrator, self.step, *options = _core_options(integrator)
        self.options = options[0], options[1]
        self.workers, self.times = workers, np.array([0.0, self.step * max(nstep, 1)])
        self.paths = list(paths)

    def near(self, arm: Arm) -> _Near:
        paths = {path: components(Setup(arm), path, {}) for path in self.paths}
        single = list(dict.fromkeys(p for parts in paths.values() for p in parts))
        found = problems(Setup(arm), single, self.times, None, None, None, starts=False)
        problem = Problem(Setup(arm), self.times, starts=False)
        return _Near(arm, problem.core, paths, {p.path: p for p in found})

    def back(self, of: _Near, q: Array, v: Array, tau: Array, by_q: Array, by_v: Array) -> tuple[Any, ...]:
        nv, options = of.arm.nv, self.options
        with of.arm.naming():
            tape, x, y, first, failed, status = _core.roll_on_tape(
                of.arm._core, self.integrator, self.step, *options, q[0], v[0], tau
            )
        if failed >= 0:
            raise ValueError(f"step {failed}: {STATUS[status]}")
        for name, given, taken in (("q", q, x), ("v", v, y)):
            off = np.abs(given - taken).max(axis=1) > _SAME * np.abs(taken).max()
            if off.any():
                row = int(off.argmax())
                raise ValueError(f"{name}: is no rollout of this arm, these forces and this step: see row {row}")
        tape.complete(of.problem)
        none = np.zeros((0, nv))
        found = tape.adjoint(of.problem, *options, by_q, by_v, none, none, self.workers)
        q0, v0, needed, applied, switches, held, _ = found
        forces = np.zeros(tau.shape)
        np.add.at(forces, np.repeat(np.arange(len(tau)), np.diff(first)), applied)
        ends = np.rint(tape.switches / self.step).astype(int)  # of the steps in which dry friction switches
        np.add.at(forces, ends - 1, held)
        forces[np.abs(tau) > torque_limits(of.arm)] = 0.0  # beyond the limits of motors
        by = tape.weigh(of.problem, [p.core for p in of.neighbours.values()], needed, applied, self.workers)
        if len(ends):

            def near(path: str, step: float) -> Parameter:
                by = FOURTH._replace(step=step)
                return problems(Setup(of.arm), [path], self.times, None, None, None, by, starts=False)[0]

            by += [(switches * repeated(tape, partial(near, path), of.problem, options)).sum()
                   for path in of.neighbours]  # fmt: skip
        value = dict(zip(of.neighbours, by, strict=True))
        return q0, v0, forces, {
            path: np.array(value[path] if parts == [path] else [value[p] for p in parts])
            for path, parts in of.paths.items()
        }  # fmt: skip


class Rolling:
    """Rollouts of an arm whose start, forces and parameters are arguments. Leading axes are scenarios.

    Args:
        arm: as of `rollout`.
        paths: parameters of the arm, as of `rollout_gradient`.
        options: step, integrator, rtol, spectral_radius, workers.
    """

    def __init__(self, arm: Arm, paths: Sequence[str], options: Mapping[str, Any]) -> None:
        instance("arm", arm, Arm, "an Arm; its parameters may differ by scenario")
        self.arm, self.paths, self.options = arm, list(paths), dict(options)
        #: of each argument, its axes behind those of scenarios; None: of any length
        self.tails: list[tuple[Any, ...]] = [(arm.nq,), (arm.nv,), (None, arm.nv)]
        for path in self.paths:
            if str(path).split(".")[0] in ("q0", "v0"):
                raise ValueError(f"parameters: '{path}' is an argument of its own")
            parts = components(Setup(arm), path, {})
            self.tails.append(() if parts == [path] else (len(parts),))

    @property
    def names(self) -> list[str]:
        """Names of the arguments."""
        return ["q0", "v0", "tau", *(f"parameters['{path}']" for path in self.paths)]

    def scenarios(self, shapes: Sequence[tuple[int, ...]]) -> tuple[int, ...]:
        """The axes of scenarios, of arguments of these shapes."""
        found = []
        for name, shape, tail in zip(self.names, shapes, self.tails, strict=True):
            behind = shape[len(shape) - len(tail) :]
            if len(shape) < len(tail) or any(n not in (None, m) for n, m in zip(tail, behind, strict=True)):
                want = ", ".join(["...", *("nstep" if n is None else str(n) for n in tail)])
                raise ValueError(f"{name} has shape {tuple(shape)}: must be ({want})")
            found.append(tuple(shape[: len(shape) - len(tail)]))
        try:
            return np.broadcast_shapes(*found)
        except ValueError:
            told = ", ".join(f"{name} {shape}" for name, shape in zip(self.names, found, strict=True))
            raise ValueError(f"scenarios: axes of {told} do not fit together") from None

    def rows(self, *arguments: Any) -> tuple[Array, Array]:
        """q and v, (*scenarios, nstep + 1, nq) and (..., nv)."""
        batch, arms, (q0, v0, tau) = self._read(arguments)
        found = rollout(arms, q0, v0, tau, **self.options)
        for failure in found.failures:
            where = f"scenario {np.unravel_index(failure.index, batch)}: " if batch else ""
            raise ValueError(f"{where}stopped at t = {failure.time:.9g} s: {failure.reason}")
        return tuple(x.reshape((*batch, *x.shape[1:])) for x in (found.q, found.v))  # type: ignore[return-value]

    def back(self, by_q: Any, by_v: Any, q: Any, v: Any, *arguments: Any, parameters: bool = True) -> list[Array]:
        """Derivatives of a number by all arguments, in each scenario, from those by the rows.

        Args:
            parameters: whether those by parameters are asked for; else they are zero.
        """
        batch, arms, (_, _, tau) = self._read(arguments)
        one: tuple[int, ...] = (int(np.prod(batch)),)
        by_q, by_v, q, v = (np.asarray(x, dtype=float) for x in (by_q, by_v, q, v))
        by_q, by_v, q, v = (np.broadcast_to(x, (*batch, *x.shape[-2:])).reshape((*one, *x.shape[-2:]))
                            for x in (by_q, by_v, q, v))  # fmt: skip
        paths = self.paths if parameters else []
        g = rollout_gradient(arms, q, v, tau, by_q, by_v, parameters=paths, **self.options)
        tails = [(self.arm.nq,), (self.arm.nv,), tau.shape[1:], *self.tails[3:]]
        by = [g.q0, g.v0, g.tau, *(g.parameters.get(path, np.zeros(one + tail))
                                   for path, tail in zip(self.paths, tails[3:], strict=True))]  # fmt: skip
        return [x.reshape((*batch, *tail)) for x, tail in zip(by, tails, strict=True)]

    def _read(self, arguments: Sequence[Any]) -> tuple[tuple[int, ...], list[Arm], list[Array]]:
        """The axes of scenarios, the arms, and q0, v0 and tau of (B, ...)."""
        given = [array(name, np.asarray(x, dtype=float)) for name, x in zip(self.names, arguments, strict=True)]
        batch = self.scenarios([x.shape for x in given])
        count = int(np.prod(batch))
        flat = []
        for x, tail in zip(given, self.tails, strict=True):
            own = x.shape[x.ndim - len(tail) :]
            flat.append(np.broadcast_to(x, (*batch, *own)).reshape((count, *own)))
        start, values = flat[:3], flat[3:]
        if not values:
            return batch, [self.arm], start
        alike = all((x == x[0]).all() for x in values)
        parameters = {path: x[:1] if alike else x for path, x in zip(self.paths, values, strict=True)}
        near = Variation(Setup(self.arm), parameters)
        return batch, [near.scenario(k).arm for k in range(1 if alike else count)], start
