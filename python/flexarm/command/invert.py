"""Stable inversion: joint torques and motions that carry the tip of a flexible arm along a path."""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._check import Array, array, choice, number
from ..arm import Arm
from .inversion import Exceeded, Inversion
from .path import Output, Path, Slower
from .problem import Equations, Poses
from .solve import DYING, MOST, Grid, Motions, NotConverged, Solver

METHODS = ("stable", "quasi-static", "rigid")
LIMITS = ("torque", "speed", "range")
_FIRST_COUNT = 48  # intervals over the path of the first grid
_SEEN = 2.5  # rad of a pole's motion in one step, above which the grid does not follow it
_ROUGH = 10.0  # times the tolerance that may be left where finer grids do not help
_TOO_MUCH = 0.01  # of the path's extent, that may go on ringing
_DECAY = 18.0  # natural logarithm of how far the slowest part of the internal dynamics has to die out
_ROUNDS = 12  # grids
_RINGS = 3.0  # natural logarithm of what a pole may grow or shrink over the path and still ring throughout
_NEAR = 0.01  # of the factor of `stretch`


class InversionWarning(UserWarning):
    """An inversion that does not respect a limit."""


def invert(
    arm: Arm,
    tip: Mapping[str, Any],
    *,
    q: ArrayLike | None = None,
    posture: ArrayLike | None = None,
    link: int = -1,
    x: float | None = None,
    t: ArrayLike | None = None,
    passive: Iterable[Any] = (),
    lock: Iterable[Any] = (),
    method: str = "stable",
    tolerance: float = 1e-7,
    pre: float | None = None,
    post: float | None = None,
    limits: Mapping[str, Any] | None = None,
    stretch: bool = False,
) -> Inversion:
    """Joint torques and motions that carry the tip along a path: the stable inverse of the arm's dynamics.

    The tip of a flexible arm answers its motors late and first the wrong way: torques computed forward in time for a
    wanted tip grow without bound. The bounded solution is not causal: the joints begin to move before the tip does
    and come to rest after it (pre- and post-actuation), while the tip stands still. It is found here of the whole
    nonlinear arm, with gravity, as the solution of (joint torques free) inverse dynamics = 0 on all other coordinates,
    and tip(q) = path, that is at rest at both ends of a long enough window, by differences of eighth order in time, on
    grids that are refined until the tip is within `tolerance`. (E. Bayo, J. Robotic Systems 4 (1987), 61-75; S. Devasia,
    D. Chen and B. Paden, IEEE Trans. Automatic Control 41 (1996), 930-942; R. Seifried, M. Burkhardt and A. Held, Multibody
    System Dynamics 30 (2013), 13-35.)

    Joints: as many as `tip` has components, or more. Where there are more, the rule is: with beams bent by gravity alone,
    the driven joints stand at each instant as near to the posture as the tip allows, by the sum of squares of their
    coordinates (rad, m), and what the dynamics add to that is the least, by the same measure. So a closed path brings
    them back to where they began. Joints in `passive` move as the dynamics have it; those in `lock`
    stay where they are.

    Args:
        arm: without ball joints. Its payload is part of it.
        tip: by component, a Motion, or a number for one that stays: "x", "y", "z", the place in the world (m); "rx",
            "ry", "rz", the rotation vector of the frame's axes in the world (rad; in the plane, "rz" is the angle);
            "azimuth", the direction of the place, seen from above, atan2(y, x) (rad), which may go round and round.
            Others are free. Each starts and ends at rest with zero acceleration: Motion(t, x, ends="rest").
        q: the pose in which the arm rests before, (nq,): its joints; what bends is brought into balance. The path must
            begin where its tip then is. It is the posture, too.
        posture: instead: where the search for the first pose begins, and what the joints stay near to, (nq,); `zero`
            if neither is given. A straight arm is singular: bend it a little the way it shall go.
        link, x: which slice follows, as of `Arm.frame`.
        t: (begin, end) of motions that are callables (s).
        passive, lock: links, or (link, freedom).
        method: "stable", or for comparison: "quasi-static": beams bend as gravity alone bends them, at each instant;
            "rigid": beams do not bend (computed torque of the rigid arm).
        tolerance: how near the tip keeps to the path between the rows of the result (m, rad).
        pre, post: time before and after the path (s); chosen from the poles of the internal dynamics if None.
        limits: "torque", "speed": one number, or one for each driven joint, in the order of links (N m, N; rad/s,
            m/s); "range": (lowest, highest), or a pair for each (rad, m), or the joints' stops, if not given.
        stretch: whether the path is slowed, uniformly, by the least factor (within 1 %) that respects the limits.

    Returns:
        Inversion: `.torques`, `.motions`, `.t`, `.q`, `.tau`, `.pre`, `.post`, `.replay()`, `.plot()`.

    Raises:
        ValueError: bad arguments; a path that jumps, is out of reach, passes a singular pose, or does not begin at the
            tip; joints that do not move the tip, or are too few; internal dynamics that ring for ever once the path
            has begun; an iteration that does not converge; limits that no slowing respects.

    Warns:
        InversionWarning: limits that are exceeded, without `stretch`; see `.exceeded`.
    """
    begun = time.perf_counter()
    if not isinstance(arm, Arm):
        raise ValueError(f"arm = {arm!r}: must be an Arm")
    choice("method", method, METHODS)
    if not 0 < number("tolerance", tolerance) < np.inf:
        raise ValueError(f"tolerance = {tolerance}: must be positive (m)")
    path = Path(tip, t)
    of, keys = _equations(arm, Output(arm, link, x, path.names), passive, lock, method)
    bounds = _bounds(arm, limits, keys)
    start = _start(of, path, q, posture)
    window = tuple(None if w is None else _duration(n, w) for n, w in (("pre", pre), ("post", post)))

    def solved(factor: float) -> tuple[Path | Slower, Motions, float, Any]:
        slower = path if factor == 1.0 else Slower(path, factor)
        return slower, *_solve(of, slower, start, method, tolerance, window)

    found, factor = _within(lambda f: solved(f), of, bounds, stretch, path)
    slower, motions, poles = found[0], found[1], found[3]
    tau = _applied(of, motions)
    out = Inversion(
        arm, method, motions.t, motions.q, motions.v, motions.a, tau, slower(motions.t), path.names, keys,
        pre=float(slower.begin - motions.t[0]), post=float(motions.t[-1] - slower.end), error=motions.error,
        edge=max(motions.edges), iterations=int(found[2]), seconds=time.perf_counter() - begun, slowed=factor, poles=poles,
        exceeded=_exceeded(of, motions, tau, bounds, keys), _path=slower, _at=(of.output.link, of.output.x),
    )  # fmt: skip
    out._held, out._passive = of.locked, of.passive
    if rings := _check_rest(of, slower, motions, poles, tolerance):
        warnings.warn(f"invert: {rings}", InversionWarning, stacklevel=2)
    if out.exceeded:
        warnings.warn("invert: " + "; ".join(map(str, out.exceeded)) + "; slow the path (stretch=True), or take another "
                      "posture", InversionWarning, stacklevel=2)  # fmt: skip
    return out


# -- arguments --------------------------------------------------------------------------------------------------------


def _duration(name: str, value: Any) -> float:
    if not 0 <= number(name, value) < np.inf:
        raise ValueError(f"{name} = {value}: must not be negative (s)")
    return float(value)


def _freedoms(arm: Arm, name: str, given: Any) -> list[tuple[int, int]]:
    """(link, freedom) of each freedom of the joints named."""
    if isinstance(given, (str, Mapping)) or not isinstance(given, Iterable):
        raise ValueError(f"{name} = {given!r}: must be a list of links, or (link, freedom)")
    found = []
    for key in given:
        rates = arm.joint_rates(key, f"{name}: link")
        n = arm._link(key[0] if isinstance(key, tuple) else key)
        found += [(n, i - arm._core.first(n)) for i in rates]
    return found


def _equations(arm: Arm, output: Output, passive: Any, lock: Any, method: str) -> tuple[Equations, list[Any]]:
    if arm.nq != arm.nv:
        n, _ = arm.quaternions()[0]
        raise ValueError(f"arm: the joint of link {n} is a ball; take three rotations in its place (Axes, Universal)")
    free, locked = _freedoms(arm, "passive", passive), _freedoms(arm, "lock", lock)
    for key in free:
        if key in locked:
            raise ValueError(f"passive: joint {key} is in lock, too")
    joints, inner, keys = [], [], []
    for n, link in enumerate(arm.links):
        first, count = arm._core.first(n), link.joint.nv
        end = arm._core.first(n + 1) if n + 1 < len(arm.links) else arm.nv
        for k in range(count):
            if (n, k) in free:
                inner.append(first + k)
                if link.joint._per_freedom("coulomb", count)[k]:
                    raise ValueError(f"passive: joint {n} has dry friction, which sticks; only driven joints may have it")
            elif (n, k) not in locked:
                joints.append(first + k)
                keys.append(n if count == 1 else (n, k))
        inner += range(first + count, end)
    p = len(output.names)
    if len(joints) < p:
        raise ValueError(
            f"tip: {p} components ({', '.join(output.names)}) need {p} driven joints, the arm has {len(joints)}; give "
            "fewer components, such as 'azimuth' for one joint that turns"
        )
    if method == "rigid" and free:
        raise ValueError('passive: method="rigid" has none')
    of = Equations(arm, output, joints, inner, np.zeros(len(joints)))
    of.elastic = method != "rigid"
    of.locked, of.passive = tuple(locked), tuple(free)
    return of, keys


def _start(of: Equations, path: Path, q: Any, posture: Any) -> Array:
    """The pose at rest at the beginning of the path; sets the posture."""
    if q is not None and posture is not None:
        raise ValueError("posture: q is the posture already; give one of them")
    arm = of.arm
    name, value = ("q", q) if q is not None else ("posture", posture)
    pose = arm.zero if value is None else array(name, value, (arm.nq,))
    wanted = path(np.array([path.begin]))[0]
    of.posture = pose[of.joints]
    if not of.elastic:
        pose = pose.copy()
        pose[of.inner] = 0.0
    if q is not None:
        pose, _ = of.balance(pose, None)
        off = of.output.error(pose[None], wanted[None])[0]
        if np.linalg.norm(off) > 1e-6 * max(1.0, of.length):
            says = ", ".join(f"{n} by {x:.4g}" for n, x in zip(path.names, off, strict=True))
            raise ValueError(
                f"q: the path does not begin at the tip of this pose in balance: it is away in {says} (m, rad); begin it "
                "at arm.frame(arm.equilibrium(q, lock=...)), or give posture= instead, and a pose is found"
            )
    of.check_singular(pose, path.begin)
    pose, off_path = of.balance(pose, wanted)
    if off_path > 1e-9 * max(1.0, of.length):
        raise ValueError(of._unreached(path.begin, off_path, wanted))
    of.check_singular(pose, path.begin)
    if posture is None:
        of.posture = pose[of.joints]
    return pose


def _bounds(arm: Arm, limits: Any, keys: list[Any]) -> dict[str, Array]:
    """Limits by kind: (m,), of the range (2, m)."""
    m, out = len(keys), {}
    if limits is not None and not isinstance(limits, Mapping):
        raise ValueError(f"limits = {limits!r}: must be a dictionary of {', '.join(LIMITS)}")
    for name, value in (limits or {}).items():
        choice("limits", name, LIMITS)
        given, shape = array(f"limits[{name!r}]", value), (m, 2) if name == "range" else (m,)
        try:
            given = np.broadcast_to(given, shape)
        except ValueError:
            raise ValueError(f"limits[{name!r}] has shape {given.shape}: must fit {shape}, the driven joints") from None
        if name != "range" and not (given > 0).all():
            raise ValueError(f"limits[{name!r}] = {value}: must be positive")
        out[name] = given.T
    if "range" not in out:
        stops = np.array([[x[arm.joint_rate(key) - arm._core.first(n)] for x in (joint._per_freedom("lower", joint.nv),
                                                                                 joint._per_freedom("upper", joint.nv))]
                          for key in keys for n in [key[0] if isinstance(key, tuple) else key]
                          for joint in [arm.links[n].joint]])  # fmt: skip
        out["range"] = stops.reshape(m, 2).T
    return out


# -- solution ---------------------------------------------------------------------------------------------------------


def _poles(M: Array, C: Array, K: Array) -> Array:
    """Of M d'' + C d' + K d = 0, by rising size; infinite ones are left out."""
    n = len(K)
    if not n:
        return np.zeros(0, dtype=complex)
    inverse = np.linalg.inv(K)
    M, C = inverse @ M, inverse @ C
    if np.abs(C).max() <= 1e-9 * np.sqrt(np.abs(M).max()):
        slow = np.linalg.eigvals(M)
        slow = np.sqrt(-slow.astype(complex))
        slow = np.concatenate([slow, -slow])
    else:
        slow = np.linalg.eigvals(np.block([[-C, -M], [np.eye(n), np.zeros((n, n))]]))
    slow = slow[np.abs(slow) > 1e-9 * np.abs(slow).max(initial=1e-300)]
    found = 1.0 / slow
    return np.asarray(found[np.argsort(np.abs(found))])


def _slow(poles: Array, T: float, step: float) -> Any:
    """Which poles ring throughout the path, among those that the grid can follow."""
    return (np.abs(poles.real) * T < _RINGS) & (np.abs(poles) * step < _SEEN)


def _padding(poles: Array, side: int, T: float, step: float) -> float:
    """How long the part that dies out on one side takes, but for what rings; of what the grid can follow."""
    rates = (side * poles.real)[(np.abs(poles) * step < _SEEN) & ~_slow(poles, T, step)]
    slowest = rates[rates > 0].min(initial=np.inf)
    return float(_DECAY / slowest) if np.isfinite(slowest) else 0.0


def _buffer(poles: tuple[Array, Array], T: float, step: float) -> float:
    """How long what rings takes to die out where it is damped; 0 where not the same poles ring at both ends: some of them
    then belong to what comes ahead of the path, which must not be damped."""
    start, end = (np.abs(p[_slow(p, T, step)]) for p in poles)
    return 1.5 * DYING / float(min(start.min(), end.min())) if len(start) and len(start) == len(end) else 0.0


def _solve(of: Equations, path: Path | Slower, start: Array, method: str, tolerance: float,
           window: tuple[float | None, ...]) -> tuple[Motions, int, Any]:  # fmt: skip
    solver, T = Solver(of, path, of.along(path, start)), path.end - path.begin
    dynamic = method == "stable" and len(of.inner) > 0
    poles = tuple(_poles(*matrices) for matrices in solver.ends) if dynamic else (np.zeros(0), np.zeros(0))
    count, longer, total, found, best, buffered = _FIRST_COUNT, 1.0, 0, None, None, True
    for _ in range(_ROUNDS):
        step = T / count
        times = [longer * _padding(p, side, T, step) if dynamic else 0.0 for p, side in zip(poles, (1, -1), strict=True)]
        times = [x if given is None else given for x, given in zip(times, window, strict=True)]
        before, after, buffer = (int(np.ceil(x / step)) for x in (*times, buffered * _buffer(poles, T, step)))
        grid = Grid(path, solver.poses, count, max(12, before), max(12, after), buffer)
        if grid.n > MOST:
            break
        guess = solver.first_guess(grid) if found is None else solver.refined(grid, found)
        try:
            found = solver.solve(grid, guess, tolerance) if method != "quasi-static" else solver.still(grid, guess)
        except NotConverged:
            if count > 4 * _FIRST_COUNT and not buffer:
                raise
            count, found, buffered = count if buffer else int(1.7 * count), None, buffered and not buffer
            continue
        total += found.iterations
        rings = any(_slow(p, T, step).any() for p in poles)
        if found.error > tolerance:
            if best is not None and found.error > 0.5 * best.error and best.error < _ROUGH * tolerance:
                break  # a finer grid follows what is faster still
            count = int(count * np.clip(1.2 * (found.error / tolerance) ** (1 / 6), 1.3, 2.5))
        elif max(found.edges) > tolerance and not rings and None in window and longer < 5:
            longer *= 1.6
        else:
            return found, total, poles
        best = found if best is None or found.error < best.error else best
    if best is not None and best.error < _ROUGH * tolerance:
        return best, total, poles
    left = "" if best is None else f": {best.error:.2g} m is left at steps of {best.step:.2g} s"
    raise ValueError(
        f"tip: the path is too rough for tolerance = {tolerance:g} m{left}; give it more continuous derivatives, more time, "
        "or allow a larger tolerance"
    )


def _check_rest(of: Equations, path: Path | Slower, found: Motions, poles: Any, tolerance: float) -> str:
    """What is to be said of an arm that does not come to rest.

    Raises:
        ValueError: where that is as much as a part of the path itself."""
    edge = max(found.edges)
    if edge <= 10 * tolerance:
        return ""
    T = path.end - path.begin
    ringing = np.abs(np.concatenate([p[_slow(p, T, found.step)] for p in poles]))
    slow = ", ".join(f"{w:.4g}" for w in sorted({float(f"{w:.4g}") for w in ringing})[:4])
    why = (f"its internal dynamics have zeros on or near the imaginary axis, at {slow} rad/s, and ring" if len(ringing) else
           "its internal dynamics die out too slowly")  # fmt: skip
    text = (
        f"the arm does not come to rest while its tip does: {why}, as if the tip moved by {edge:.2g} m; damp the beams "
        "(damping_ratio), slow or smooth the path, take another slice or other components of the tip, or more pre and post"
    )
    moved = float(np.ptp(path(found.t), axis=0).max())
    if edge > _TOO_MUCH * moved:
        raise ValueError(f"tip: there is no inverse that comes to rest: {text}")
    return text


def _applied(of: Equations, found: Motions) -> Array:
    """What the motors give: with the dry friction that they overcome."""
    tau = np.zeros_like(found.tau)
    tau[:, of.joints] = found.tau[:, of.joints]
    first = of.arm._core.first
    for n, link in enumerate(of.arm.links):
        for k, dry in enumerate(link.joint._per_freedom("coulomb", link.joint.nv)):
            i = first(n) + k
            if dry and i in of.joints:
                v = found.v[:, i]
                tau[:, i] += dry * np.sign(v) * (np.abs(v) > 1e-6 * np.abs(v).max())
    return tau


# -- limits -----------------------------------------------------------------------------------------------------------


def _exceeded(of: Equations, found: Motions, tau: Array, bounds: Mapping[str, Array], keys: list[Any]) -> list[Exceeded]:
    out, th = [], of.joints
    for kind, values in (("torque", tau[:, th]), ("speed", found.v[:, th])):
        if kind not in bounds:
            continue
        for k in np.flatnonzero(np.abs(values).max(axis=0) > bounds[kind] * (1 + 1e-9)):
            at = int(np.abs(values[:, k]).argmax())
            out.append(Exceeded(kind, keys[k], float(found.t[at]), float(values[at, k]), float(bounds[kind][k])))
    q, (low, high) = found.q[:, th], bounds["range"]
    for k in range(len(th)):
        for at, limit, beyond in ((int(q[:, k].argmin()), low[k], q[:, k].min() < low[k]),
                                  (int(q[:, k].argmax()), high[k], q[:, k].max() > high[k])):  # fmt: skip
            if beyond:
                out.append(Exceeded("range", keys[k], float(found.t[at]), float(q[at, k]), float(limit)))
    return out


def _within(solved: Any, of: Equations, bounds: Mapping[str, Array], stretch: bool, path: Path) -> tuple[Any, float]:
    """A solution, and by which factor the path is slowed for it."""
    found = solved(1.0)
    if not stretch:
        return found, 1.0

    def respected(motions: Motions) -> bool:
        over = _exceeded(of, motions, _applied(of, motions), bounds, list(range(len(of.joints))))
        if any(x.kind == "range" for x in over):
            raise ValueError(f"limits: {next(x for x in over if x.kind == 'range')} (joints in order); no slowing helps")
        return not over

    if respected(found[1]):
        return found, 1.0
    low, high = 1.0, 2.0
    while not respected((found := solved(high))[1]):
        if high > 60:
            raise ValueError("limits: are exceeded even by a path 64 times slower: by gravity alone; allow more torque, or "
                             "take another posture")  # fmt: skip
        low, high = high, 2 * high
    while high / low > 1 + _NEAR:
        middle = float(np.sqrt(low * high))
        trial = solved(middle)
        if respected(trial[1]):
            high, found = middle, trial
        else:
            low = middle
    return found, high
