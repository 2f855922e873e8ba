"""Exact derivatives of a run by parameters, start and forces: forward, and by the adjoint method."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

import flexarm._core as _core

from .._check import Array, array, choice
from .._threads import cores
from ..arm.variation import Setup
from ..model.acting.drive import Torque, Voltage, split_drives
from ..model.acting.load import driven_forces
from ..model.acting.motor import torque_limits
from ..model.acting.sampled import PythonLaw
from .integrators import Implicit, Integrator
from .occurrence import EVENTS, Occurrence, by_event, cubics, rows_of
from .perturbed import (
    FOURTH,
    Difference,
    Neighbour,
    Parameter,
    check_paths,
    components,
    core_parameters,
    drive_of,
    problems,
    start_of,
)
from .problem import Problem
from .result import Result
from .touch import OfContact

ROWS = ("q", "v", "a", "tau")
_SAMPLES = re.compile(r"drive\..+\.samples")
_SMALLER = (1.0, 0.1, 0.01)  # that step again, where none of its neighbours goes the same way
NEAR = 1e-6  #: step of differences in steps in which friction switches: a larger one may switch in another step

#: An output of a run, from its rows and its setup.
Output = Callable[[Result, Setup], ArrayLike]
#: Derivatives of a number by rows and events of the result, by their names; or a function that gives the number and
#: these.
Loss = Mapping[str, Any] | Callable[[Result], tuple[float, Mapping[str, Any]]]


#: Is told how far work is: (part done, its present step) -> None; None where nobody looks.
Look = Callable[[float, str], None] | None


class RunStopped(ValueError):
    """A run that could not go on, and so has no derivatives. `.time` is the time reached (s)."""

    def __init__(self, message: str, time: float) -> None:
        super().__init__(message)
        self.time = time


@dataclass(repr=False)
class Sensitivities:
    """A run, and its exact derivatives by np parameters, of the integrator's equations.

    Attributes:
        result: the run.
        parameters: their paths.
        q, v, a, tau: derivatives of the result's rows, (np, nt, nq) and (np, nt, nv); of a ball, those of its
            quaternion. Rows stand at their times; where
            a terminal event has ended the run, they end before it.
        t_events, q_events, v_events: per event, derivatives of its occurrences' times (np, n), coordinates (np, n, nq)
            and rates (np, n, nv); None without events. The time moves with a parameter p by
            dt/dp = -(dg/dp) / (dg/dt), of the event's value g along the run, and the state with it: that of the given
            time changes by dq/dp, and that at the event by dq/dp + v dt/dp.
    """

    result: Result
    parameters: tuple[str, ...]
    q: Array
    v: Array
    a: Array
    tau: Array
    _neighbours: list[Parameter]
    _setup: Setup
    t_events: list[Array] | None = None
    q_events: list[Array] | None = None
    v_events: list[Array] | None = None

    def __repr__(self) -> str:
        return f"Sensitivities({len(self.result.t)} rows by {', '.join(self.parameters)})"

    def of(self, output: Output) -> Array:
        """Derivatives of an output of a run, (np, *shape): its direct dependence on the parameters is in it.

        Args:
            output: a function of a Result, and of the Setup that it is made of (arm, drive, loads, control, sensors),
                that gives an array. It must be smooth.
        """
        found = []
        base = np.asarray(output(self.result, self._setup), dtype=float)
        for k in range(len(self.parameters)):
            total = np.zeros(base.shape)
            for weight, changed, setup in self._changed(k):
                total += weight * (np.asarray(output(changed, setup), dtype=float) - base)
            found.append(total)
        return np.array(found)

    def _changed(self, k: int) -> Iterator[tuple[float, Result, Setup]]:
        """Weights, results and setups of runs with parameter k a little larger and smaller, to first order: the
        weighted sum of an output of theirs is its derivative."""
        rates = {name: getattr(self, name)[k] for name in ROWS}
        for near in self._neighbours[k].neighbours:
            state = {name: getattr(self.result, name) + near.offset * x for name, x in rates.items()}
            for name in EVENTS if self.t_events is not None else ():
                pairs = zip(getattr(self.result, name), getattr(self, name), strict=True)
                state[name] = [x + near.offset * by[k] for x, by in pairs]
            status = self.result.status
            result = Result(near.setup.arm, self.result.t, **state, loads=near.setup.loads, status=status)
            result.driven = driven_forces(result.arm, near.setup.drive, result.t)
            yield near.weight, result, near.setup


class ByForces(NamedTuple):
    """A run, and the derivatives of a number that depends on it by further generalised forces `tau` (n, nv) at the
    times `t` (n,) at which its steps ask the equations of motion, and by its start q0, v0 (nv,); of a ball q0 is its
    small turn in its own axes."""

    result: Result
    t: Array
    tau: Array
    q0: Array
    v0: Array


@dataclass
class Source:
    """The source of a result, so that it can be run again.

    Attributes:
        setup: of the run. t, q0, v0, tau: as of `simulate`.
        integrate: the core's run of a problem; with a tape, of a fixed-step method, which it writes.
        integrator: of the run.
        events: as of `simulate`.
        of: the setup that `setup` was made of, and by which values (1, ...) of parameters.
        by: the differences by parameters.

    `workers` of its functions: threads; None: one for each core. `look` is called now and then with the part that is
    done, and with its present step in words.
    """

    setup: Setup
    t: Array
    q0: Array | Mapping[Any, Any] | str | None
    v0: Array | None
    tau: Array | None
    integrate: Callable[..., dict[str, Any]]
    integrator: Integrator
    of: tuple[Setup, Mapping[str, Array]] | None = None
    events: Any = None
    by: Difference = FOURTH

    def _problem(self) -> Problem:
        s = self.setup
        s.arm.refuse_rubbing("derivatives of a run")
        if not self.integrator.taped:
            caller = f'derivatives of a run, integrator = "{self.integrator.name}" (methods of fixed steps have them)'
            s.arm.refuse_loops(caller, rigid=True)
        run = Problem(s, self.t, self.q0, self.v0, self.tau, self.events)
        for k, control in enumerate(run.controls):
            control.check_smooth(s.arm, f"control[{k}]")
        for sampler in run.sampled:
            if isinstance(sampler.law, PythonLaw):
                sampler.law.twice = True
        return run

    def _seen(self, look: Look, share: float) -> dict[str, Any]:
        """For `integrate`: tells how far the run is, which is this share of all."""
        begin, end = float(self.t[0]), float(self.t[-1])

        def tell(now: float) -> None:
            if look:
                look(share * (now - begin) / (end - begin), f"run at t = {now:.4g} of {end:.4g} s")

        return {"alive": tell} if look else {}

    def _taped(self, look: Look, share: float) -> tuple[Problem, Result, Any, Any]:
        """The run once more, and its tape."""
        run = self._problem()
        tape = _core.Tape()
        out = self.integrate(run, tape=tape, **self._seen(look, share))
        core = run.core
        tape.complete(core)
        return run, run.result(_done(out)), tape, core

    def sensitivities(
        self, parameters: Sequence[str], workers: int | None = None, look: Look = None
    ) -> Sensitivities:  # fmt: skip
        near = self._near(list(dict.fromkeys(p for parts in self._paths(parameters, False).values() for p in parts)))
        workers = workers or cores()
        result, rows = self._forward(near, workers, look) if self.integrator.taped else self._with_ida(near, look)
        return Sensitivities(result, tuple(p.path for p in near), **rows, _neighbours=near, _setup=self.setup)

    def _with_ida(self, near: list[Parameter], look: Look) -> tuple[Result, dict[str, Any]]:
        """Forward sensitivities integrated with the run, by IDAS."""
        run = self._problem()
        out = _done(self.integrate(run, parameters=near, **self._seen(look, 1.0)))
        arm, found, result = self.setup.arm, out["tangents"], run.result(out)
        nq, nv = arm.nq, arm.nv
        rows: dict[str, Any] = {k: np.ascontiguousarray(found[k][..., : nq if k == "q" else nv]) for k in ROWS}
        if result.t_events is None:
            return result, rows
        occurred = []
        for k, (t, q, v, slopes) in enumerate(zip(*out["events"], out["event_slopes"], strict=True)):
            for n, (a, by_q, by_v) in enumerate(slopes):
                state = q[n, :nq], v[n, :nv]
                dq = arm._core.rates(*state)[0] if nq != nv else state[1]
                at = Occurrence(run, k, t[n], *state, dq, a[:nv])
                occurred.append(at.moved(by_q[:nq].T, by_v[:nv].T, _by_value(at, near)))
        return result, rows | by_event(occurred, result, len(near))

    def _forward(self, near: list[Parameter], workers: int, look: Look) -> tuple[Result, dict[str, Any]]:
        """Tangents along a tape."""
        run, result, tape, core = self._taped(look, 1 / (len(near) + 2))
        if look:
            look(1 / (len(near) + 2), "by parameters")
        switches = [self._switches(tape, p, run) for p in near]
        found = tape.tangents(core, *self._numbers, switches, core_parameters(run, near), True, workers)
        mine, arm, nv = rows_of(tape), self.setup.arm, self.setup.arm.nv
        rows: dict[str, Any] = {k: np.ascontiguousarray(found[k][:, mine, : getattr(result, k).shape[1]]) for k in ROWS}
        for k, p in enumerate(near):
            for i, moved in self._moved(run, p, result.t):
                for name, change in zip(("q", "v", "a"), moved, strict=True):
                    rows[name][k, :, arm.coordinate_of(i) if name == "q" else i] = change
        if result.t_events is None:
            return result, rows
        occurred = []
        for cubic in cubics(run, tape, result):
            q, v = cubic.through({name: found[name][..., :nv] for name in ("q", "v", "a")})
            for k, p in enumerate(near):
                for i, moved in self._moved(run, p, [cubic.t]):
                    q[k, i], v[k, i] = moved[0, 0], moved[1, 0]
            occurred.append(cubic.moved(q, v, _by_value(cubic, near)))
        return result, rows | by_event(occurred, result, len(near))

    def gradient(
        self, loss: Loss, parameters: Sequence[str], workers: int | None = None, look: Look = None
    ) -> dict[str, Any]:  # fmt: skip
        paths = self._paths(parameters, self.integrator.taped)
        if not self.integrator.taped or not all(map(_slopes_known, self._problem().sampled)):
            found = self.sensitivities(parameters, workers, look)
            weights = _weights(loss, found.result)
            by = {p: float(sum((w * x[k]).sum() for name, given in weights.items()
                               for w, x in _pairs(given, getattr(found, name))))
                  for k, p in enumerate(found.parameters)}  # fmt: skip
            return {path: by[path] if parts == [path] else np.array([by[p] for p in parts])
                    for path, parts in paths.items()}  # fmt: skip
        workers = workers or cores()
        run, result, tape, core = self._taped(look, 1 / 3)
        if look:
            look(1 / 3, "backwards through the run")
        weights, occurred, found = self._backwards(loss, run, result, tape, core, workers)
        q0, v0, needed, applied, switches, held, looks = found
        arm, nv = self.setup.arm, self.setup.arm.nv
        near = {p.path: p for p in self._near(list(dict.fromkeys(p for parts in paths.values() for p in parts)))}
        if look:
            look(2 / 3, "by parameters")
        by_forces = tape.weigh(core, core_parameters(run, list(near.values())), needed, applied, workers)
        forces = dict(zip(near, by_forces, strict=True))
        pushed = np.vstack([applied, held]) * _below_limits(tape, run)
        whole = {"q0": q0, "v0": v0, "tau": pushed.sum(axis=0)}
        out: dict[str, Any] = {}
        for path, parts in paths.items():
            if path in whole:
                out[path] = whole[path][: arm.nq if path == "q0" else nv]
                continue
            if _SAMPLES.fullmatch(path):
                out[path] = self._by_samples(path, np.append(tape.t, tape.switches), pushed)
                continue
            values = []
            for p in (near[part] for part in parts):
                value = forces[p.path] + _sum(p, lambda n: q0 @ n.problem.core.q0 + v0 @ n.problem.core.v0)
                value += (switches * self._switches(tape, p, run)).sum()
                if run.sampled:
                    value += _sum(p, lambda n: (looks * tape.repeat_looks(n.problem.core, core)).sum())
                for i, moved in self._moved(run, p, result.t):
                    for name, change in zip(("q", "v", "a"), moved, strict=True):
                        at = arm.coordinate_of(i) if name == "q" else i
                        value += (weights[name][:, at] * change).sum() if name in weights else 0.0
                for cubic, q, v, by_value in occurred:
                    value += by_value * _by_value(cubic, [p])[0]
                    for i, moved in self._moved(run, p, [cubic.t]):
                        value += q[i] * moved[0, 0] + v[i] * moved[1, 0]
                values.append(float(value))
            out[path] = values[0] if parts == [path] else np.array(values)
        return out

    def _backwards(
        self, loss: Loss, run: Problem, result: Result, tape: Any, core: Any, workers: int, rough: bool = False
    ) -> tuple[dict[str, Any], list[Any], Any]:  # fmt: skip
        """Derivatives of a number by rows and events, those of the events weighed by these, and the result of the
        tape's adjoint."""
        weights = _weights(loss, result)
        mine = rows_of(tape)
        occurred = [cubic.weighed(weights) for cubic in cubics(run, tape, result)] if weights.keys() & EVENTS else []
        full = {k: np.zeros((len(tape.points), run.both.nq if k == "q" else run.both.nv)) for k in ROWS}
        for k in ROWS:
            full[k][mine, : getattr(result, k).shape[1]] = weights.get(k, 0.0)
        for cubic, q, v, _ in occurred:
            cubic.share(q, v, full)
        asked = {"q", "v", *weights, *(["a"] if occurred else [])}
        read = [full[k] if k in asked else np.zeros((0, run.both.nv)) for k in ROWS]
        return weights, occurred, tape.adjoint(core, *self._numbers, *read, workers, rough)

    def by_forces(self, loss: Loss, workers: int | None = None, look: Look = None) -> ByForces:
        """Derivatives of a number by forces that act at any time of the run, and by its start, by the adjoint method,
        about: of arms without balls with slopes at two places of each step.

        Raises:
            ValueError: no derivatives go through, as of `gradient`; a controller whose slopes are not known.
        """
        run, result, tape, core = self._taped(look, 0.5)
        if not all(map(_slopes_known, run.sampled)):
            raise ValueError("control: the adjoint method does not know the memory of sensors, nor that of an MPC")
        rough = self.setup.arm.nq == self.setup.arm.nv  # balls turn within a step
        _, _, found = self._backwards(loss, run, result, tape, core, workers or cores(), rough)
        q0, v0, _, applied, _, held, _ = found
        nv = self.setup.arm.nv
        pushed = (np.vstack([applied, held]) * _below_limits(tape, run))[:, :nv]
        return ByForces(result, np.append(tape.t, tape.switches), pushed, q0[:nv], v0[:nv])

    @property
    def _numbers(self) -> tuple[float, float]:
        """Options of "implicit", whose steps are taken again; others have no friction in theirs."""
        of = self.integrator if isinstance(self.integrator, Implicit) else Implicit(1.0)
        return of.rtol, of.spectral_radius

    def _switches(self, tape: Any, p: Parameter, run: Problem) -> Array:
        """Derivatives of the ends of steps in which dry friction switches, from where they begin."""
        if p.start_only or not len(tape.switches):
            return np.zeros((len(tape.switches), 2 * run.both.nv))
        return repeated(tape, lambda step: self._near([p.path], step)[0], run.core, self._numbers)

    def _paths(self, parameters: Sequence[str], adjoint: bool) -> dict[str, list[str]]:
        """The numbers that each path stands for."""
        check_paths(parameters, 1)
        start = start_of(self.setup, float(self.t[0]), self.q0, self.v0, self.tau)
        whole = {p for p in parameters if p in ("q0", "v0", "tau") or _SAMPLES.fullmatch(p)} if adjoint else set()
        return {p: [] if p in whole else components(self.setup, p, start) for p in parameters}

    def _near(self, paths: list[str], step: float | None = None) -> list[Parameter]:
        by = self.by._replace(step=step or self.by.step)
        return problems(self.setup, paths, self.t, self.q0, self.v0, self.tau, by, self.of)

    def _moved(self, run: Problem, p: Parameter, times: Sequence[float] | Array) -> list[tuple[int, Array]]:
        """Of each prescribed rate whose motion the parameter changes: derivatives (3, n) of its q, v and a at times."""
        if not p.path.startswith("drive."):
            return []
        return [(d.rate, _sum(p, lambda n, k=k: np.array([n.problem.drives[k].law(t) for t in times]).T))  # type: ignore[misc]
                for k, d in enumerate(run.drives) if d.moves]  # fmt: skip

    def _by_samples(self, path: str, t: Array, applied: Array) -> Array:
        """Derivatives by the samples of a torque or a voltage, between which it is linear."""
        key, law = drive_of(self.setup, path.removeprefix("drive.").removesuffix(".samples"))
        if not isinstance(law, (Torque, Voltage)) or law.constant or not hasattr(law.law, "breaks"):
            raise ValueError(f"parameters: '{path}' is nothing that can vary: drive {key} has no samples of a force")
        joints, patches, struts = split_drives(self.setup.arm, self.setup.drive)
        if key in struts:
            raise ValueError(f"parameters: '{path}': is not derived, as it is a strut's; 'drive.{key}.scale' is")
        run = self._problem()
        at = [*patches, *joints].index(key)
        rate, column = run.drives[at].rate, run.drives[at].column
        force = applied[:, : column.size] @ column if column.size else applied[:, rate]
        breaks = law.law.breaks
        k = np.clip(np.searchsorted(breaks, t, side="right") - 1, 0, len(breaks) - 2)
        part = (t - breaks[k]) / (breaks[k + 1] - breaks[k])
        out = np.zeros(len(breaks))
        np.add.at(out, k, (1 - part) * force)
        np.add.at(out, k + 1, part * force)
        return out


def _slopes_known(sampler: Any) -> bool:
    """Whether slopes tell all about a sampled law: the memory of sensors, and of an MPC, is not."""
    law = sampler.law
    if isinstance(law, _core.LinearLaw):
        return not law.reads
    return isinstance(law, _core.ComputedTorque) or (isinstance(law, PythonLaw) and not law.senses)


def _below_limits(tape: Any, run: Problem) -> Array:
    """1 where a further force acts, at the places of a tape and then at its switches; 0 at a motor's limit."""
    limited = np.flatnonzero(np.isfinite(torque_limits(run.arm)))
    below = np.ones((len(tape.t), run.both.nv))
    below[:, limited] = tape.sides[:, tape.sides.shape[1] - len(limited) :] == 0
    near = np.clip(np.searchsorted(tape.t, tape.switches), 0, len(tape.t) - 1)
    return np.vstack([below, below[near]])


def _done(out: dict[str, Any]) -> dict[str, Any]:
    if out["failure"] == "interrupted":
        raise KeyboardInterrupt
    if out["failure"]:
        raise RunStopped(f"the run stopped at t = {out['reached']:.9g} s: {out['failure']}", out["reached"])
    return out


def repeated(
    tape: Any, near: Callable[[float], Parameter], problem: Any, options: tuple[float, float]
) -> Array:  # fmt: skip
    """Derivatives by a parameter of the ends of steps in which dry friction switches: of the polynomials through the
    ends of those neighbours' steps in which it goes the same way.

    Args:
        near: gives the parameter with neighbours at a step of differences.
        problem: the run's, as a tape takes it. options: rtol and spectral_radius of "implicit".
    """
    here, ways = tape.repeat_switches(problem, *options)
    out = np.zeros(here.shape)
    left = set(range(len(here)))
    for smaller in _SMALLER:
        p = near(NEAR * smaller)
        found = [(n.offset, *tape.repeat_switches(n.problem.core, *options)) for n in p.neighbours if n.offset]
        for k in sorted(left):
            alike = [(d, ends[k]) for d, ends, its in found if its[k] == ways[k]]
            if not alike and smaller != _SMALLER[-1]:
                continue
            offsets, ends = zip(*(alike or [(d, ends[k]) for d, ends, _ in found]), strict=True)
            out[k] = _slope_at_zero(offsets) @ (np.array(ends) - here[k])
            left.remove(k)
        if not left:
            break
    return out


@lru_cache(maxsize=256)  # those of a parameter are the same at all switches
def _slope_at_zero(offsets: tuple[float, ...]) -> Array:
    """Weights of values at these offsets in the slope at 0 of the polynomial through 0 and them."""
    size = max(map(abs, offsets))
    powers = np.vander(np.array(offsets) / size, len(offsets) + 1, increasing=True)[:, 1:]
    return np.asarray(np.linalg.inv(powers)[0] / size)


def _sum(p: Parameter, value: Callable[[Neighbour], Any]) -> Any:
    """The derivative of a value by a parameter."""
    return sum(n.weight * np.asarray(value(n), dtype=float) for n in p.neighbours)


def _by_value(at: Occurrence, near: Sequence[Parameter]) -> Array:
    """Derivatives by parameters of an event's value in one state: of contacts, whose places they may move."""
    event = at.run.asked_events[at.event]
    if not isinstance(event, OfContact):
        return np.zeros(len(near))
    return np.array([_sum(p, lambda n: event.of(n.setup.arm)(at.t, at.q, at.v)) for p in near])


def _weights(loss: Loss, result: Result) -> dict[str, Any]:
    """Derivatives of a number by the rows and events of the result."""
    given = loss
    if callable(loss):
        pair = loss(result)
        if not (isinstance(pair, tuple) and len(pair) == 2 and isinstance(pair[1], Mapping)):
            raise ValueError(f"loss: gave {pair!r}; must give (value, derivatives), such as (x, {{'q': dx_dq}})")
        given = pair[1]
    if not isinstance(given, Mapping) or not given:
        raise ValueError(f"loss = {loss!r}: must be derivatives by rows, such as {{'q': (nt, nq)}}, or a function")
    out: dict[str, Any] = {}
    for name, w in given.items():
        rows = getattr(result, choice("loss", name, ROWS if result.t_events is None else (*ROWS, *EVENTS)))
        if name in ROWS:
            out[name] = array(f"loss['{name}']", w, rows.shape)
            continue
        if not isinstance(w, (list, tuple)) or len(w) != len(rows):
            raise ValueError(f"loss['{name}'] = {w!r}: must be a list of {len(rows)} arrays, one for each event")
        out[name] = [array(f"loss['{name}'][{k}]", x, of.shape) for k, (x, of) in enumerate(zip(w, rows, strict=True))]
    return out


def _pairs(weights: Any, found: Any) -> Sequence[tuple[Array, Array]]:
    """Weights and the arrays that they weigh, of rows or of lists of events."""
    return list(zip(weights, found, strict=True)) if isinstance(weights, list) else [(weights, found)]
