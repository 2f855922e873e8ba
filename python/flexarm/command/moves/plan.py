"""Moves from rest to rest, as fast as limits allow, that leave a flexible arm still."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..._check import Array, array, between, choice, warn
from ..._console import progress_bar
from ...arm.arm import Arm
from ...run.simulation import simulated
from ..joint_limits import Driven, Limits, joint_ranges
from .move import LimitUse, Move, held, swing
from .moved_arm import MovedArm
from .rigid import RigidMove, fastest
from .route import Profile, Route, path_points
from .search import PENALTIES, Aim, Found, Search

Tell = Callable[[str], None] | None
METHODS = ("fast", "shaped")
_KNOTS, _KNOTS_EACH = (160, 240), (60, 120)  # of a motion, at least and at most: along a route, and of each joint
_KNOTS_ALL, _KNOTS_FEW = 240, 24  # all joints together have at most the first, unless each had fewer than the second
_ASIDE = 1e-3  # of the largest way: how far a joint without stops that stays may move
_PER_HALF, _PER_HALF_EACH = 10, 2  # knots in half a period of the slowest mode
_FAST = 4.0  # a mode is steered if its frequency times the time between knots is below this
_MODES = 12  # steered, at most
_ROUNDS, _TRIES = 40, 12  # of a search for the least time, and for the smoothest motion in a given one
_TIGHTER = 5  # attempts with larger margins, if limits are passed between the knots
_MARGIN = 3e-3  # first margin of torque, which is not steered between the knots
_RIPPLE = 5e-3  # excess between the knots, above which the search includes rows there
_ROUNDING = 1e-5  # accepted excess over a limit
_LONGER, _SLOWER = 1.008, (1.0, 1.1, 1.3, 1.6, 2.0)  # factors of a duration that is too short
_STALLED = 0.8  # share of the excess or vibration that is left, above which more time does not help
_RESERVE = 1.002  # factor of the least time
_FINE = 5  # rows of the result between two knots: odd, so that rows differ from the middles of pieces
_ENOUGH, _ENOUGH_OF = 1e-3, 0.1  # sufficient vibration, as a part of the scale, and of the allowed one
_LEAST_SCALE = 0.1  # of the static deflection: a smaller vibration of the unshaped move is chance
_NEGLIGIBLE = 1e-3  # of the static deflection: a vibration that is always allowed


class MoveWarning(UserWarning):
    """A planned move that leaves more vibration than it should, or passes a limit."""


def plan_move(
    arm: Arm,
    q_from: ArrayLike | Mapping[Any, float] | None = None,
    q_to: ArrayLike | Mapping[Any, float] | None = None,
    *,
    limits: Mapping[str, Any] | None = None,
    path: ArrayLike | Callable[[float], Any] | None = None,
    residual: float = 0.05,
    method: str = "fast",
    progress: Any = False,
) -> Move:
    """A fast move of the joints from rest to rest that leaves the flexible arm at rest.

    By default each joint goes its own way, or all go together along `path`, in about the least time in which the limits
    allow it: a search finds a local optimum, and ends early if the limits are far away. A joint stays between its
    stops; where a stop is missing and there is no path, it does not go beyond both positions, nor does a single joint.
    First the time-optimal move of the rigid arm along the path or the straight line is found (Bobrow et al. 1985,
    Verscheure et al. 2009). The motion is then chosen so that on the flexible arm, simulated, all limits hold and
    nothing swings at the end: by linear programmes on exact Jacobians along the run, in which modes may change with
    the pose. The result is run once more by "ida": `.limits` and `.residual` are of that run.

    Every joint is driven, and the arm starts and ends in balance with gravity. Accelerations are continuous, and zero
    at both ends.

    Args:
        arm: the arm, without ball joints.
        q_from, q_to: joint positions (rad, m), (nj,), in the order of the links; or states (nq,), of which the joints'
            entries are used; or by joint, {"elbow": 0.3}, the others at 0.
        limits: of each joint on the flexible arm, by kind: "torque", the largest absolute torque or force (N m, N),
            which includes the weight; "speed" (rad/s, m/s); "acceleration" (rad/s², m/s²); "jerk" (rad/s³, m/s³). Each
            is one number for all joints, one for each, or a dictionary by link or (link, freedom). None, and joints
            that a dictionary leaves out: no limit. Every joint needs one of torque and acceleration.
        path: instead of q_from and q_to: samples (n, nj) of joint positions, through which a smooth curve goes (of
            degree five); or a function of s from 0 to 1 that gives them. [q_from, q_to] is the straight line.
        residual: vibration allowed after the move, as a part of the vibration after the time-optimal rigid move; a
            MoveWarning says if it is more.
        method: "fast": the least time. "shaped": as smooth as it can be (the least largest jerk along the path, or the
            straight line) in the time that the rigid arm needs plus half a period of the slowest mode, the cost of a
            command without vibration (Singer and Seering 1990); longer if that is too short for the limits.
        progress: shows progress of the search on stderr: a bar, or lines where that is no terminal; or a callable
            (done, text).

    Returns:
        Move: `.drive` for `simulate`, `.duration`, `.torques`, `.limits`, `.residual`, `.plot()`.

    Raises:
        ValueError: bad arguments; torques that cannot hold the arm's weight, with joint, need and limit; poses beyond
            the joints' stops; a path that jumps; from = to.

    Warns:
        MoveWarning: the remaining vibration is above `residual`, or a limit is passed.
    """
    driven = Driven.of(arm)
    arm.refuse_rubbing("plan_move: arm")
    arm.refuse_loops("plan_move: arm")
    choice("method", method, METHODS)
    allowed = between("residual", residual, 0, 1, ", a part of the rigid move's vibration")
    within = Limits.of(arm, driven, limits)
    route = Route(_points(arm, driven, q_from, q_to, path))
    within.check_stops("q_from, q_to" if path is None else "path", route(np.linspace(0, 1, 401))[0], driven.names)
    with progress_bar(progress, "planning", None) as tell:
        say = None if tell is None else lambda text: tell(0.0, text)
        rigid = fastest(arm, driven, route, within)
        plant = MovedArm(arm, driven, route.start, route.end)
        independent = method == "fast" and path is None and len(driven.rates) > 1
        plan = _Plan(plant, within, route, rigid, independent, allowed, say)
        move = plan.move(*(plan.shaped() if method == "shaped" else plan.fast()))
    _warn(move, allowed, plan.scale)
    return move


def _points(arm: Arm, driven: Driven, q_from: Any, q_to: Any, path: Any) -> Array:
    n = len(driven.rates)
    if path is not None:
        if q_from is not None or q_to is not None:
            raise ValueError("path: has both ends; leave out q_from and q_to")
        return path_points(path, n, driven.names)
    ends = []
    for name, value in (("q_from", q_from), ("q_to", q_to)):
        if value is None:
            raise ValueError(f"{name} = None: give q_from and q_to, or path")
        if isinstance(value, Mapping):
            own = arm.by_rate(name, value)
            value = [own.get(int(i), 0.0) for i in driven.rates]
        q = np.atleast_1d(array(name, value))
        if q.shape not in ((n,), (arm.nq,)):
            raise ValueError(
                f"{name} has shape {q.shape}: must be {n} joint positions ({', '.join(driven.names)}), or a state of "
                f"{arm.nq} coordinates"
            )
        ends.append(q if q.shape == (n,) else q[driven.at])
    if np.abs(ends[1] - ends[0]).max() < 1e-9:
        raise ValueError(f"q_to = {ends[1].tolist()}: is where the move starts")
    return np.array(ends)


def _warn(move: Move, allowed: float, scale: float) -> None:
    if move.residual > max(allowed * move.residual_unshaped, _NEGLIGIBLE * scale):
        warn(
            f"plan_move: {1e3 * move.residual:.3g} mm of vibration are left, of {1e3 * move.residual_unshaped:.3g} mm "
            f"unshaped; residual = {allowed:g} asks for less. Take longer limits, or an arm with more damping or modes",
            MoveWarning,
        )
    for x in move.limits:
        if x.peak > 1.001 * x.limit:
            warn(
                f"plan_move: {x.what} of '{x.joint}' comes to {x.peak:.5g} at t = {x.t:.4g} s, above its limit "
                f"{x.limit:.5g}",
                MoveWarning,
            )


class _Plan:
    """The problem of a planned move, and the searches for its solution."""

    def __init__(self, plant: MovedArm, limits: Limits, route: Route, rigid: RigidMove, independent: bool,
                 allowed: float, tell: Tell) -> None:  # fmt: skip
        self.plant, self.limits, self.route, self.rigid, self.tell = plant, limits, route, rigid, tell
        self.independent = independent
        self.target = rigid.duration + plant.half_period
        per = self.target / plant.half_period if plant.half_period else 0.0
        self.knots = int(np.clip(np.ceil(_PER_HALF * per), *_KNOTS))
        if independent:
            least = np.clip(_KNOTS_ALL // len(route.end), _KNOTS_FEW, _KNOTS_EACH[0])
            self.knots = int(np.clip(np.ceil(_PER_HALF_EACH * per), least, _KNOTS_EACH[1]))
        w = plant.modes.frequencies
        self.kept = min(_MODES, int((w * self.target / self.knots < _FAST).sum()))
        self.rigid_drive = plant.drive(*held(*self._rigid_samples()))
        self.unshaped = self._unshaped()
        self.scale = self._scale()
        self.enough = max(_ENOUGH, _ENOUGH_OF * allowed * min(self.unshaped / self.scale, 1.0))

    def _scale(self) -> float:
        """Scale of vibration (m): the swing of the arm's end after the rigid move. This may be small by chance, so it
        is at least a part of the static deflection under the largest accelerations of that move, or under a jump of the
        joints over the whole way, which is less if the move takes a small part of the mode's period."""
        q, _, a = self.route.motion(*self.rigid.at(np.linspace(0.0, self.rigid.duration, 401)))
        m, d = self.plant.modes, self.plant.driven
        if not m.frequencies.size:
            return 1.0
        M = self.plant.arm.mass_matrix(self.plant.q_end)[np.ix_(d.elastic, d.rates)]
        least = np.minimum(np.abs(a).max(axis=0) / m.frequencies[:, None] ** 2, np.ptp(q, axis=0))
        bent = (np.abs(m.shapes.T @ M) * least).sum(axis=1) * m.tip
        reach = float(np.linalg.norm(self.plant.rest, axis=1).max()) or 1.0
        most = max(float(bent[: max(self.kept, 1)].max()), 1e-9 * reach * self.plant.small)
        return float(np.clip(self.unshaped, _LEAST_SCALE * most, most))

    def _first(self) -> Profile:
        """The rigid move, shaped by ZV; or, if it acts as an impulse on the modes or exceeds the limits of jerk, a move
        of constant jerks. Brought to rest at the end."""
        half, n = self.plant.half_period, self.knots
        T = self.target
        if np.isfinite(self.limits.jerk).any():
            way = np.abs(self.route.end - self.route.start)
            T = max(T, float(((32.0 * way / self.limits.jerk) ** (1 / 3)).max()))
        if T > min(self.target, 2.0 * self.rigid.duration):
            alpha = np.interp(np.linspace(0, 1, n + 1), [0, 0.25, 0.75, 1], [0, 8, -8, 0])
        else:
            t = np.linspace(0.0, T, n + 1)
            alpha = 0.5 * T**2 * (self.rigid.at(t)[2] + self.rigid.at(t - half)[2])
        along = at_rest(Profile(T, alpha[:, None], np.zeros(1), self.route))
        if not self.independent:
            return along
        return Profile(T, along.alpha * (self.route.end - self.route.start), self.route.start, None)

    def _aim(self) -> Aim:
        tight = replace(self.limits, torque=self.limits.torque * (1.0 - _MARGIN))
        if not self.independent:
            return Aim(tight, False, np.ones(1), np.full(1, 4.0), self.scale, self.kept, self.enough)
        start, end = self.route.start, self.route.end
        way = np.abs(end - start)
        low, high = joint_ranges(self.plant.arm, "stops", None, self.plant.driven.rates.tolist())
        low = np.where(np.isinf(low), np.minimum(start, end), low)
        high = np.where(np.isinf(high), np.maximum(start, end), high)
        tight = replace(tight, middle=0.5 * (low + high), reach=np.maximum(0.5 * (high - low), _ASIDE * way.max()))
        M = np.diag(self.plant.arm.mass_matrix(self.plant.q_end))[self.plant.driven.rates]
        able = np.minimum(self.limits.acceleration, self.limits.torque / M)  # approximate largest accelerations
        size = 4.0 * np.maximum(way, 0.25 * (way / able).max() * able)
        return Aim(tight, False, end, size, self.scale, self.kept, self.enough)

    def _search(self, aim: Aim, first: Profile, rounds: int) -> Found:
        return Search(self.plant, aim, first, self.tell).solve(first, rounds)

    def shaped(self) -> tuple[Found, Any]:
        return self._within(self._aim(), self._first())

    def fast(self) -> tuple[Found, Any]:
        """The least time; then a little more of it, and smooth."""
        aim, first = self._aim(), self._first()
        return self._within(aim, self._least(aim, first), first)

    def _least(self, aim: Aim, first: Profile) -> Profile:
        """The least time, and a little more."""
        for penalty in PENALTIES[True]:
            found = self._search(replace(aim, free=True, penalty=penalty), first, _ROUNDS)
            if found.good:
                break
            first = found.profile
        return replace(found.profile, duration=_RESERVE * found.profile.duration)

    def _smooth(self, aim: Aim, first: Profile) -> Found:
        """The smoothest motion in the duration of `first`, or a little more."""
        found = self._search(aim, first, _TRIES)
        for _ in range(2):
            if not found.good:
                found = self._search(aim, replace(found.profile, duration=_LONGER * found.profile.duration), _TRIES)
        return found

    def _from_slower(self, aim: Aim, first: Profile) -> Found:
        """The smoothest motion in about the least time, searched for from a slower motion."""
        best = None
        for slower in _SLOWER:
            found = self._search(aim, replace(first, duration=slower * first.duration), _TRIES)
            if found.good:
                faster = self._smooth(aim, self._least(aim, found.profile))
                return faster if faster.good else found
            if best is not None and max(found.over, found.left) > _STALLED * max(best.over, best.left):
                return best
            best = found
        return found

    def _within(self, aim: Aim, first: Profile, slower: Profile | None = None) -> tuple[Found, Any]:
        """The smoothest motion, again with margins if peaks between the knots exceed a limit; and its run on a fine
        grid. If there is none near `first`, the search begins from `slower`, and from slower motions."""
        margin: dict[str, Any] = {"torque": _MARGIN}
        found = self._smooth(aim, first)
        found = found if found.good else self._from_slower(aim, replace(slower or first, fine=2))
        for attempt in range(_TIGHTER + 1):
            p = found.profile
            fine = np.linspace(0.0, p.duration, _FINE * self.knots + 1)
            run = self.plant.run(p.t, *p.joints(), fine, float(fine[1]))
            over = {k: np.maximum(x.max(axis=0) - 1.0 - _ROUNDING, 0.0) for k, x in self._peaks(run).items()}
            if attempt == _TIGHTER or not any(x.any() for x in over.values()):
                break
            margin = {k: margin.get(k, 0.0) + 1.2 * x for k, x in over.items()}
            if any((x > _RIPPLE).any() for x in over.values()) and p.fine == 1:  # include rows between the knots
                margin, p = {"torque": _MARGIN}, replace(p, fine=2)
            tight = replace(aim.limits, **{k: getattr(self.limits, k) * (1.0 - x) for k, x in margin.items()})
            found = self._smooth(replace(aim, limits=tight), p)
        return found, run

    def _peaks(self, run: Any) -> dict[str, Array]:
        """Absolute values over the limits at rows of a run, (n, nj), for each given limit."""
        d = self.plant.driven
        jerk = np.diff(run.a[:, d.rates], axis=0) / np.diff(run.t)[:, None]
        rows = {"torque": run.tau[:, d.rates], "speed": run.v[:, d.rates], "acceleration": run.a[:, d.rates]}
        values = {**rows, "jerk": np.vstack([jerk, jerk[-1:]])}
        return {
            k: np.abs(x) / getattr(self.limits, k)
            for k, x in values.items()
            if np.isfinite(getattr(self.limits, k)).any()
        }

    def move(self, found: Found, run: Any) -> Move:
        p, plant, d = found.profile, self.plant, self.plant.driven
        frequencies = np.stack([plant.modes_start.frequencies[: self.kept], plant.modes.frequencies[: self.kept]])
        move = Move(
            plant.arm, run.t, run.q[:, d.at], run.v[:, d.rates], run.a[:, d.rates], run.tau[:, d.rates],
            tuple(d.names), p.duration, self.rigid.duration, plant.half_period, frequencies, (),
            0.0, 0.0, plant.drive(*held(p.t, *p.joints())), self.rigid_drive, plant,
        )  # fmt: skip
        run = move._run(simulated, None, None, {})
        left = swing(plant, run, p.duration)
        return replace(move, limits=self._uses(run), residual=left, residual_unshaped=self.unshaped)

    def _uses(self, run: Any) -> tuple[LimitUse, ...]:
        uses = []
        for kind, part in self._peaks(run).items():
            most = getattr(self.limits, kind)
            for j in np.flatnonzero(np.isfinite(most)):
                k = int(part[:, j].argmax())
                uses.append(LimitUse(kind, self.plant.driven.names[j], float(part[k, j] * most[j]), float(most[j]),
                                     float(run.t[k])))  # fmt: skip
        return tuple(uses)

    def _rigid_samples(self) -> tuple[Array, ...]:
        t = np.linspace(0.0, self.rigid.duration, 801)
        q, v, a = self.route.motion(*self.rigid.at(t))
        q[-1], v[-1], a[[0, -1]] = self.route.end, 0.0, 0.0  # accelerations set in within T / 800
        return t, q, v, a

    def _unshaped(self) -> float:
        """Swing of the arm's end after the time-optimal rigid move (m)."""
        T = self.rigid.duration
        run = simulated(self.plant.arm, np.append(0.0, self.plant.after(T)), q0=self.plant.q_start,
                        drive=self.rigid_drive, **self.plant.tolerances)  # fmt: skip
        return swing(self.plant, run, T)


def at_rest(p: Profile) -> Profile:
    """The nearest profile along a route that ends at rest, at its end."""
    z, zd, _ = p.by_alpha()
    rows = np.vstack([z[-1], zd[-1] * p.duration])
    now, rate, _ = p.z()
    alpha = p.alpha.copy()
    alpha[[0, -1]] = 0.0
    missing = np.array([1.0 - now[-1, 0], -rate[-1, 0] * p.duration])
    for _ in range(2):
        alpha[1:-1, 0] += np.linalg.lstsq(rows, missing, rcond=None)[0]
        now, rate, _ = replace(p, alpha=alpha).z()
        missing = np.array([1.0 - now[-1, 0], -rate[-1, 0] * p.duration])
    return replace(p, alpha=alpha)
