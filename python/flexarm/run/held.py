"""A start at rest, as its controllers hold an arm: their references have always had their values of the start."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import flexarm._core as _core

from .._check import Array, array
from ..analysis.rates import displaced
from ..arm.arm import Arm
from ..arm.variation import Setup
from ..loop.laws import taps_of
from ..model.acting.control import Controller, Run, controllers, gain_of, padded
from ..model.acting.drive import Motion, Torque, is_patch, is_strut, split_drives, voltage_forces
from ..model.acting.following import plus
from ..model.acting.load import at_time
from ..model.acting.motor import torque_limits
from ..model.acting.sampled import LinearController
from ..model.parts.chain import Chain

_TRIES = 100
_LONGEST = 0.3  # a step of the joints (rad, m)
_SETTLED = 1e-10  # a step of all, in parts of where they are, or of this
_LONG = 1e9  # s: a time after all runs


class Held(NamedTuple):
    """Coordinates (nq,) at the start, and the setup whose controllers hold the arm there from the first instant on."""

    q: Array
    setup: Setup


class _Law(NamedTuple):
    """A controller at rest: u = at + by_q dq + by_x x, of which `columns` (nv, nu) make forces, with a memory x that
    stands still: 0 = x_at + x_by_q dq + x_by_x x. `limit` of |u|."""

    columns: Array
    at: Array
    by_q: Array
    by_x: Array
    x_at: Array
    x_by_q: Array
    x_by_x: Array
    limit: Array


def held(of: Any, t: float, tau: Any = None) -> Held:
    """The start of a Setup or a Scene at time t (s), with constant forces tau (nv,).

    Raises:
        ValueError: a controller that samples or remembers and is no LinearController; controllers that do not hold the
            arm, or only beyond a limit.
    """
    arm: Arm = of.arm
    arm.refuse_loops("q0 = 'held'", rigid=True)
    setup = Setup(arm, dict(of.drive or {}), tuple(of.loads or ()), controllers(of.control))
    places = at_time(arm, setup.forces, t)
    laws = split_drives(arm, setup.drive)[0]
    motions = {i: float(law(t)[0]) for i, law in arm.by_rate("drive", laws).items() if isinstance(law, Motion)}
    forces, volts = acting(arm, setup.drive, t)
    forces = forces + voltage_forces(arm, volts) + (0.0 if tau is None else array("tau", tau, (arm.nv,)))
    q, free = np.array(arm.zero), ~np.isin(np.arange(arm.nv), list(motions))
    for i, place in motions.items():
        q[arm.coordinate_of(i)] = place
    q, x = arm.trim(q, loads=setup.forces, t=t, voltages=volts or None).q, None
    zero = np.zeros(arm.nv)
    for _ in range(_TRIES):
        found = [_law(setup, k, q, t) for k in range(len(setup.control))]
        n = [len(law.x_at) for law in found]
        x = np.zeros(sum(n)) if x is None else x
        E = arm._core.rates(q, zero)[2]
        K = arm._core.inverse_derivatives(q, zero, zero, *places, by_v=False)[0] @ E
        r = arm._core.inverse_dynamics(q, zero, zero, *places) - forces
        J, below = np.zeros((arm.nv + len(x),) * 2), np.zeros(len(x))
        J[: arm.nv, : arm.nv] = K
        first = 0
        for law in found:
            own = slice(first, first := first + len(law.x_at))
            rows = slice(arm.nv + own.start, arm.nv + own.stop)
            r = r - law.columns @ (law.at + law.by_x @ x[own])
            J[: arm.nv, : arm.nv] -= law.columns @ law.by_q @ E
            J[: arm.nv, rows] = -law.columns @ law.by_x
            below[own] = law.x_at + law.x_by_x @ x[own]
            J[rows, : arm.nv], J[rows, rows] = law.x_by_q @ E, law.x_by_x
        keep = np.concatenate([free, np.ones(len(x), bool)])
        try:
            part = np.linalg.solve(J[np.ix_(keep, keep)], -np.concatenate([r, below])[keep])
        except np.linalg.LinAlgError:
            break
        step = np.zeros(len(keep))
        step[keep] = part
        share = min(1.0, _LONGEST / max(float(np.abs(step[arm.freedoms]).max(initial=0.0)), 1e-300))
        q, x = displaced(arm, q, E, share * step[: arm.nv]), x + share * step[arm.nv :]
        if not np.isfinite(q).all():
            break
        if share == 1.0 and np.abs(part).max(initial=0.0) <= _SETTLED * (1 + np.abs(np.concatenate([q, x])).max()):
            return Held(q, _holding(setup, q, x, t, forces, free))
    raise ValueError("q0 = 'held': the controllers do not hold the arm at rest: no such start was found")


def _law(setup: Setup, k: int, q: Array, t: float) -> _Law:
    """Controller k about q."""
    arm, c = setup.arm, setup.control[k]
    run = Run(np.array([t, t + 1e-3]), setup.forces, 0, c.memory, k, list(setup.control))
    if isinstance(c, LinearController) and c.memory == (len(c.A) if c.continuous else 0):
        taps, y, _ = taps_of(arm, c, q, np.zeros(arm.nv), setup.forces)
        by_q = c._takes() @ np.array([tap.by_q for tap in taps]).reshape(-1, arm.nq)
        A = c.A if c.continuous else c.A - np.eye(len(c.A))
        felt = np.any(c.C != 0, axis=0)
        for _ in range(felt.size):  # states that no output feels may move: the integral of a PID without one
            felt |= np.any(A[felt] != 0, axis=0)
        A, B, C = A[np.ix_(felt, felt)], c.B[felt], c.C[:, felt]
        e = _error(c, arm, run, y)
        columns = gain_of(c.motor) * np.array(c._columns(arm)).T
        limit = np.broadcast_to(c.limit, len(c.D))
        return _Law(columns, c.u0 + c.D @ e, -c.D @ by_q, C, B @ e, -B @ by_q, A, limit)
    laws, sampled = c._laws(arm, run)
    if sampled or c.memory:
        more = " with a current loop" if sampled and c.memory else " with a washout" if c.memory else ""
        raise ValueError(f"control[{k}]: q0 = 'held' is not known of {type(c).__name__}{more}: give q0 in numbers")
    by_q = -np.array([law.by_q for law in laws]).reshape(-1, arm.nq)
    at = [0.0 if law.reference is None else float(np.ravel(law.reference(t))[0]) for law in laws]
    columns, n = np.array([law.column for law in laws]).reshape(-1, arm.nv).T, len(laws)
    limit = np.array([law.limit for law in laws])
    no_memory = np.zeros((n, 0)), np.zeros(0), np.zeros((0, arm.nq)), np.zeros((0, 0))
    return _Law(columns, np.array(at) + by_q @ q, by_q, *no_memory, limit)


def _error(c: LinearController, arm: Arm, run: Run, y: Array) -> Array:
    """e (ny,) at the start, from readings y there."""
    given, t = c._given(arm, run), float(run.times[0])
    if isinstance(given, list):
        given = np.array([float(np.ravel(law(t))[0]) for law in given])
    return np.asarray(given(t) if callable(given) else given, dtype=float) - c._takes() @ y


def _holding(setup: Setup, q: Array, x: Array, t: float, forces: Array, free: NDArray[np.bool_]) -> Setup:
    """The setup whose controllers begin with their outputs at q with the memory x, and give them before their delay
    is over; drives give the other `forces` (nv,). Rates that are `free` have no motion."""
    arm, control, first, total = setup.arm, list(setup.control), 0, forces.copy()
    for k, c in enumerate(setup.control):
        law = _law(setup, k, q, t)
        u = law.at + law.by_x @ x[first : (first := first + len(law.x_at))]
        over = np.flatnonzero(np.abs(u) > law.limit)
        if over.size:
            raise ValueError(
                f"control[{k}].limit = {law.limit[over[0]]:g}: to hold the arm at rest takes {u[over[0]]:.4g} "
                "(q0 = 'held')"
            )
        total += law.columns @ u
        if not isinstance(c, LinearController):
            continue
        if len(c.A):  # x = x0 + z, e = e0 + d: the same law of z and d begins at zero, with u for u0
            made = copy.copy(c)
            made.u0 = u
            run = Run(np.array([t, t + 1e-3]), setup.forces, 0, c.memory, k, list(setup.control))
            e0 = _error(c, arm, run, taps_of(arm, c, q, np.zeros(arm.nv), setup.forces)[1])
            made._given = partial(_less, c._given, e0)  # type: ignore[method-assign]
            control[k] = made
        if not c.continuous and c.delay and (law.columns @ u).any():
            control.append(_Before(law.columns @ u, c.delay))
    most = torque_limits(arm)
    beyond = np.flatnonzero(free & (np.abs(total) > most))
    if beyond.size:
        i = beyond[0]
        raise ValueError(
            f"torque_limit = {most[i]:g} of '{arm.coordinates[i]}': to hold the arm at rest takes {total[i]:.4g} "
            "(q0 = 'held')"
        )
    return replace(setup, control=tuple(control))


class _Before(Controller):
    """Forces (nv,) that act until a time after the start (s): always, and from then on less as much."""

    def __init__(self, forces: Array, until: float) -> None:
        self.forces, self.until = forces, until

    def _columns(self, arm: Chain) -> list[Array]:
        return list(np.eye(arm.nv)[np.flatnonzero(self.forces)])

    def _laws(self, arm: Chain, run: Run) -> tuple[list[_core.Feedback], list[_core.Sampler]]:
        u, nq, nv = self.forces[np.flatnonzero(self.forces)], arm.nq + run.total, arm.nv + run.total
        units, n, none = [padded(x, nv) for x in self._columns(arm)], len(u), np.zeros((0, 0))
        always = [_core.Feedback(x, np.zeros(nq), np.zeros(nv), Torque(float(f)).law, np.inf)
                  for x, f in zip(units, u, strict=True)]  # fmt: skip
        less = _core.LinearLaw(none, np.zeros((0, 1)), np.zeros((n, 0)), np.zeros((n, 1)), np.array(units).T,
                               np.zeros((1, nq)), np.zeros((1, nv)), np.full(n, np.inf), np.zeros(1), None, -u,
                               np.zeros((0, n)), np.full(n, np.inf), np.zeros(1), np.zeros(1), np.zeros((0, 0)),
                               float(run.times[0]))  # fmt: skip
        return always, [_core.Sampler(float(run.times[0]), _LONG, self.until, less)]


def _less(given: Callable[[Arm, Run], Any], by: Array, arm: Arm, run: Run) -> Any:
    """A reference of e, less constants (ny,)."""
    of = given(arm, run)
    if isinstance(of, list):
        return [plus(law, Torque(-float(x))) for law, x in zip(of, by, strict=True)]
    return (lambda t: np.asarray(of(t), dtype=float) - by) if callable(of) else np.asarray(of) - by


def acting(arm: Arm, drive: Mapping[Any, Any], t: float) -> tuple[Array, dict[Any, float]]:
    """Forces of the joints' drives (nv,) and voltages of the patches, by (link, patch), at time t (s)."""
    tau, volts = np.zeros(arm.nv), {}
    for key, law in drive.items():
        if is_patch(key):
            volts[arm._link(key[1], "drive: link"), key[2]] = float(law(t))
        elif not isinstance(law, Motion) and not is_strut(arm, key):
            tau[arm.joint_rate(key, "drive: link")] += float(law(t))
    return tau, volts
