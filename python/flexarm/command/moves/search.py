"""The search for a motion of the joints, within limits, after which the flexible arm is at rest.

Sequential linear programming with an exact penalty and a trust region (R. Fletcher and E. Sainz de la Maza, "Nonlinear
programming and nonsmooth optimization by successive linear programming", Mathematical Programming 43 (1989), 235-256):
each round simulates the flexible arm, and a linear programme (HiGHS, in SciPy) chooses the next motion by exact
Jacobians along that run. Fastest motions lie at corners of the feasible set, where this converges quadratically.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from ..._check import Array
from ...run.result import Result
from ...run.simulation import SimulationError
from ..joint_limits import Limits
from .moved_arm import MovedArm, Response, respond
from .route import Profile

#: Penalties of exceeded limits (in parts of them), and of vibration (in parts of `scale`), by whether the duration is
#: free; the next one is taken if too much excess is left.
PENALTIES = {True: (5.0, 50.0), False: (100.0,)}
_SMOOTH = 1e-3  # weight of the largest jerk if the duration is minimised
_SMOOTH_ALONE = 1e-2  # and if it alone is minimised
_TOLERANCE, _NOISE = 1e-3, 2e-4  # final tolerance of limits; tolerance of limits and vibration in a step
_GAIN, _GAIN_OF_PENALTY = 2e-4, 0.02  # least gain of a round, as parts of the objective and of the penalties
_JERK = 8.0  # largest jerk of the smoothest motion, in parts of the size of its accelerations
_DT = 1e-5  # relative difference of the duration for derivatives
_SIMPLEX = {"presolve": False}  # it removes no dense row, and takes a quarter of the time


@dataclass(frozen=True)
class Aim:
    """The aim of a search."""

    limits: Limits  #: with their margins
    free: bool  #: whether the duration is minimised; else the largest jerk
    end: Array  #: final z, (m,)
    size: Array  #: of alpha of each number, (m,)
    scale: float  #: of vibration (m)
    kept: int  #: number of modes that are steered
    enough: float  #: sufficient vibration, in parts of `scale`
    penalty: float = PENALTIES[False][0]  #: of exceeded limits and of vibration


@dataclass(frozen=True)
class Found:
    """A motion, the run of the flexible arm, and its merit."""

    profile: Profile
    run: Result
    goal: float  #: the objective
    over: float  #: largest excess over a limit, as a part of it
    left: float  #: vibration, in parts of `Aim.scale`
    penalty: float  #: of both
    enough: float  #: sufficient value of `left`

    @property
    def merit(self) -> float:
        over, left = max(self.over - _NOISE, 0.0), max(self.left - _NOISE, 0.0)
        return self.goal + self.penalty * (over + left)

    @property
    def good(self) -> bool:
        return self.over < _TOLERANCE and self.left < self.enough


class Search:
    """A search from a first motion."""

    def __init__(self, plant: MovedArm, aim: Aim, first: Profile, tell: Callable[[str], None] | None = None) -> None:
        self.plant, self.aim, self.tell = plant, aim, tell
        self.reference = first.duration

    def _run(self, profile: Profile) -> Result:
        t = profile.t
        return self.plant.run(t, *profile.joints(), t, float(t[1]))

    def judge(self, profile: Profile) -> Found:
        aim = self.aim
        try:
            run = self._run(profile)
        except SimulationError as e:
            return Found(profile, e.result, np.inf, np.inf, np.inf, aim.penalty, aim.enough)
        jerk = float(np.abs(_jerks(profile, aim)).max())
        goal = profile.duration / self.reference + _SMOOTH * jerk if aim.free else _SMOOTH_ALONE * jerk
        over = max((float(np.abs(x.value).max()) for x in self._limited(profile, run)), default=0.0) - 1.0
        left = float(np.abs(self._left(run)).max(initial=0.0)) / aim.scale
        return Found(profile, run, goal, max(over, 0.0), left, aim.penalty, aim.enough)

    def _left(self, run: Result) -> Array:
        return self.plant.left(run.q[-1], run.v[-1])[:, : self.aim.kept]

    def _limited(self, profile: Profile, run: Result, by: Response | None = None) -> list[_Limited]:
        """The limited quantities, as parts of the limits; without derivatives, if no response is given."""
        q, v, a = profile.joints()
        limits, h = self.aim.limits, profile.t[1]
        values = [
            (run.tau[:, self.plant.driven.rates], limits.torque, None if by is None else by.tau, None),
            (q - limits.middle, limits.reach, None if by is None else by.q, None),
            (v, limits.speed, None if by is None else by.v, -v),
            (a, limits.acceleration, None if by is None else by.a, -2.0 * a),
            (np.diff(a, axis=0) / h, limits.jerk, None if by is None else np.diff(by.a, axis=0) / h,
             -3.0 * np.diff(a, axis=0) / h),
        ]  # fmt: skip
        if profile.route is not None:  # a route begins at 0 and ends at 1
            z = 2.0 * profile.z()[0] - 1.0
            values.append((z, np.ones(1), None if by is None else 2.0 * profile.by_alpha()[0], None))
        out = []
        for value, most, by_x, by_T in values:
            on = np.isfinite(most)
            if on.any():
                slopes = None if by_x is None else by_x[:, on] / most[on, None]
                out.append(_Limited(value[:, on] / most[on], slopes, 0.0 if by_T is None else by_T[:, on] / most[on]))
        return out

    def solve(self, first: Profile, rounds: int) -> Found:
        """The best motion found within that many rounds."""
        best, trust = self.judge(first), 1.0
        for k in range(rounds):
            if self.tell is not None:
                self.tell(f"round {k + 1}: {best.profile.duration:.4g} s, {100 * best.left:.2g} % left")
            slopes = self._slopes(best)
            while True:
                step, promised = self._next(best, best, slopes, trust)
                gain = best.merit - promised
                # the programme accepts excess if no motion nearby keeps the limits
                worth = max(_GAIN, _GAIN_OF_PENALTY * (best.merit - best.goal))
                if step is None or trust < 1e-3 or gain < worth:
                    return best
                trial = self.judge(step)
                # a further step with the same slopes corrects for curvature
                step = self._next(trial, best, slopes, trust)[0] if max(trial.over, trial.left) > _NOISE else None
                if step is not None:
                    trial = min(trial, self.judge(step), key=lambda found: found.merit)
                share = (best.merit - trial.merit) / max(gain, 1e-300)
                if share > 0.05:
                    break
                trust *= 0.3
            best = trial
            trust = min(2.0 * trust, 2.0) if share > 0.5 else trust
        return best

    def _slopes(self, at: Found) -> _Slopes:
        aim, p = self.aim, at.profile
        m, n = p.alpha.shape[1], len(p.alpha) - 1
        size, by_alpha = np.tile(aim.size, n - 1), p.by_alpha()
        response = respond(self.plant, at.run, p.slopes(), aim.kept)
        limited = self._limited(p, at.run, response)
        left_T, tau_T = self._by_duration(at) if aim.free else (np.zeros((2, aim.kept)), None)
        if np.isfinite(aim.limits.torque).any():
            limited[0] = limited[0]._replace(by_T=0.0 if tau_T is None else tau_T)  # the torques come first
        ends = np.vstack([by_alpha[0][-1], by_alpha[1][-1] * p.duration]) * size
        rows = [_rows(x.by_x * size, x.by_T, _SLACK) for x in limited]
        rows.append(_rows(response.left / aim.scale * size, left_T / aim.scale, _REST))
        A = np.vstack([*rows, _rows(_jerk_rows(n, m), 0.0, _PEAK)])
        return _Slopes(A, np.hstack([ends, np.zeros((2 * m, 4))]), np.abs(A[:, : len(size) + 1]))

    def _next(self, at: Found, of: Found, slopes: _Slopes, trust: float) -> tuple[Profile | None, float]:
        """The solution of the linear programme about `at`, within the trust region about `of`, with the slopes of `of`;
        and its predicted merit. Its variables: changes of alpha, in parts of its size; of the duration, in parts of
        that; the largest jerk; excess over limits; vibration."""
        from scipy.optimize import linprog  # slow to import

        aim, p = self.aim, at.profile
        m, n = p.alpha.shape[1], len(p.alpha) - 1
        nx = m * (n - 1)
        most = [(x.value, 1.0) for x in self._limited(p, at.run)]
        most += [(self._left(at.run) / aim.scale, 0.0), (_jerks(p, aim), 0.0)]
        b = np.concatenate([bound - sign * x.ravel() for x, bound in most for sign in (1.0, -1.0)])
        z, zd, _ = p.z()
        ends = np.concatenate([aim.end - z[-1], -zd[-1] * p.duration])
        cost = np.append(np.zeros(nx), [float(aim.free), _SMOOTH if aim.free else _SMOOTH_ALONE, *[aim.penalty] * 2])
        cost[nx] *= p.duration / self.reference
        moved = ((p.alpha - of.profile.alpha)[1:-1] / aim.size).ravel()
        bounds = np.zeros((nx + 4, 2))
        bounds[:nx] = np.column_stack([-trust - moved, trust - moved])
        bounds[nx] = np.array([-0.2, 0.2]) * min(trust, 1.0) if aim.free else 0.0
        bounds[nx + 1 :, 1] = np.inf
        near = slopes.sizes @ np.abs(bounds[: nx + 1]).max(axis=1) >= b  # others cannot be exceeded
        out = linprog(cost, slopes.A[near], b[near], slopes.ends, ends, bounds, method="highs-ds", options=_SIMPLEX)
        if out.status != 0:
            return None, np.inf
        alpha = p.alpha.copy()
        alpha[1:-1] += out.x[:nx].reshape(n - 1, m) * aim.size
        already = p.duration / self.reference if aim.free else 0.0
        return replace(p, alpha=alpha, duration=p.duration * (1.0 + out.x[nx])), float(out.fun) + already

    def _by_duration(self, at: Found) -> tuple[Array, Array]:
        """Derivatives of the vibration (m) and of the limited torques (parts of the limits) by the logarithm of the
        duration, at constant alpha; by a difference."""
        later = self._run(replace(at.profile, duration=at.profile.duration * (1.0 + _DT)))
        on, most = self.plant.driven.rates, self.aim.limits.torque
        tau = ((later.tau - at.run.tau)[:, on] / most)[:, np.isfinite(most)]
        return (self._left(later) - self._left(at.run)) / _DT, tau / _DT


class _Limited(NamedTuple):
    """Values (n, k) that must stay within 1, and derivatives by alpha (n, k, nx) and by the logarithm of the duration,
    (n, k)."""

    value: Array
    by_x: Any
    by_T: Any


_PEAK, _SLACK, _REST = 1, 2, 3  # places of the last variables, behind the duration's


class _Slopes(NamedTuple):
    """Matrices of the linear programme: of the limited quantities, and of the final z and rate; the bounds on the
    former by alpha and by the duration."""

    A: Array
    ends: Array
    sizes: Array


def _rows(by_x: Array, by_T: Any, variable: int) -> Array:
    """Rows that keep absolute values below a bound and one of the last variables."""
    nx = by_x.shape[-1]
    rows = np.zeros((by_x.size // nx, nx + 4))
    rows[:, :nx] = by_x.reshape(-1, nx)
    rows[:, nx] = np.broadcast_to(by_T, by_x.shape[:-1]).ravel()
    both = np.vstack([rows, -rows])
    both[:, nx + variable] = -1.0
    return both


def _jerks(profile: Profile, aim: Aim) -> Array:
    """Jerks of z between the knots, (N, m), as parts of about the least for a way of 1 in a time of 1."""
    n = len(profile.alpha) - 1
    return np.diff(profile.alpha, axis=0) * n / (_JERK * aim.size)


def _jerk_rows(n: int, m: int) -> Array:
    """Derivatives of the jerks by alpha at the inner knots, in parts of its size, (n, m, m (n - 1))."""
    differences = (np.eye(n, n - 1) - np.eye(n, n - 1, -1)) * n / _JERK
    return np.asarray(np.kron(differences, np.eye(m)).reshape(n, m, -1))
