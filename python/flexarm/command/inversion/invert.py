"""Stable inversion: joint torques and motions that carry the tip of a flexible arm along a path."""

import time
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..._check import Array, choice, instance, not_negative, positive, warn
from ..._console import progress_bar
from ...analysis.validity import range_warning, worst_range
from ...arm.arm import Arm
from ..joint_limits import by_freedom, by_kind, freedoms, joint_limits, joint_ranges
from .equations import Equations
from .inversion import Exceeded, Inversion
from .path import Output, Path
from .solve import Motions
from .window import check_rest, solve

METHODS = ("stable", "quasi-static", "rigid")
LIMITS = ("torque", "speed", "range")
_NEAR = 0.01  # tolerance of the factor by which a path is slowed
_TOLERANCE, _SHARE, _LEAST = 1e-7, 1e-4, 1e-12  # (m, rad); share of the tip's way; rounding


class InversionWarning(UserWarning):
    """An inversion that exceeds a limit, or after which the arm does not come to rest."""


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
    tolerance: float | None = None,
    pre: float | None = None,
    post: float | None = None,
    limits: Mapping[str, Any] | None = None,
    stretch: bool = False,
    progress: Any = False,
) -> Inversion:
    """Joint torques and motions that carry the tip along a path, by stable inversion of the dynamics.

    The tip of a flexible arm answers its motors late, and first the wrong way: torques that are computed forward in
    time for a wanted tip grow without bound. The bounded solution is not causal: the joints begin to move before the
    tip does, and come to rest after it (pre- and post-actuation); the tip stands still meanwhile. It is computed for
    the whole nonlinear arm, with gravity: inverse dynamics gives no force on any coordinate without a motor, the tip is
    on the path, and the arm is at rest at both ends of a long enough window. Differences of eighth order in time, on
    grids that are refined until the tip is within `tolerance`. (E. Bayo, J. Robotic Systems 4 (1987), 61-75; S.
    Devasia, D. Chen and B. Paden, IEEE Trans. Automatic Control 41 (1996), 930-942; R. Seifried, M. Burkhardt and A.
    Held, Multibody System Dynamics 30 (2013), 13-35.)

    `tip` has as many components as joints are driven, or fewer. If fewer, the rule is: with beams bent by gravity
    alone, the driven joints stand at each instant as near to the posture as the tip allows, by the sum of squares of
    their coordinates (rad, m); the dynamic part is the smallest one, by the same measure. So a closed path brings
    the joints back to their start. Joints in `passive` have no motor and move by the dynamics; those in `lock` do not
    move.

    Args:
        arm: without ball joints. Its payload is part of it.
        tip: by component, a Motion, or a number for one that stays: "x", "y", "z", the place in the world (m); "rx",
            "ry", "rz", the rotation vector of the frame's axes in the world (rad; in the plane, "rz" is the angle);
            "azimuth", the direction of the place, seen from above, atan2(y, x) (rad), which may go round and round.
            Others are free. Each starts and ends at rest with zero acceleration: Motion(t, x, ends="rest").
        q: the pose of rest before the path, (nq,): its joints; the elastic coordinates are brought into equilibrium.
            Its tip must be at the start of the path. It is also the posture.
        posture: instead: initial guess of the first pose, and the pose that the joints stay near to, (nq,); `zero`
            if neither is given. A straight arm is singular: bend it a little in the wanted direction.
        link, x: the slice that follows the path, as of `Arm.frame`.
        t: (begin, end) of motions that are callables (s).
        passive, lock: links, or (link, freedom).
        method: "stable", or for comparison: "quasi-static": beams bend as gravity alone bends them, at each instant;
            "rigid": beams do not bend (computed torque of the rigid arm).
        tolerance: largest distance of the tip from the path between the rows of the result (m, rad). None: 1e-7, or a
            ten-thousandth of the way of the tip, if that is less.
        pre, post: time before and after the path (s), at least twelve steps of the grid; None: the decay time of the
            poles of the internal dynamics.
        limits: "torque", "speed": one number, or one for each driven joint, in the order of links, or by the names of
            some, {"elbow": 5.0} (N m, N; rad/s, m/s); "range": (lowest, highest), or pairs likewise (rad, m); default:
            the joints' stops. They are checked in the rows of the result.
        stretch: whether the path is slowed, uniformly, by the least factor (within 1 %) that respects the limits.
        progress: shows progress on stderr: a bar, or lines where that is no terminal; or a callable (done, text).

    Returns:
        Inversion: `.torques`, `.motions`, `.t`, `.q`, `.tau`, `.pre`, `.post`, `.replay()`, `.plot()`.

    Raises:
        ValueError: bad arguments; a path that jumps, is out of reach, passes a singular pose, or does not begin at the
            tip; joints that do not move the tip, or are too few; internal dynamics that ring for ever once the path
            has begun; no convergence; limits that no slowing satisfies.

    Warns:
        InversionWarning: limits that are exceeded, without `stretch` (see `.exceeded`); an arm that does not come to
            rest.
        RangeWarning: a beam bent further than its order is good for.
    """
    begun = time.perf_counter()
    instance("arm", arm, Arm)
    choice("method", method, METHODS)
    if tolerance is not None:
        positive("tolerance", tolerance, "m, rad")
    path = Path(tip, t)
    way = float(np.ptp(path(np.linspace(path.begin, path.end, 101)), axis=0).max())
    accuracy = tolerance or min(_TOLERANCE, max(_SHARE * way, _LEAST))
    equations, keys = _equations(arm, Output(arm, link, x, path.names), passive, lock, method)
    bounds = bounds_of(arm, limits, keys)
    start = _start(equations, path, q, posture)
    window = tuple(None if w is None else not_negative(n, w, "s") for n, w in (("pre", pre), ("post", post)))

    def solved(factor: float) -> tuple[Path, Motions, float, Any]:
        slower = path.slowed(factor)
        return slower, *solve(equations, slower, start, method, accuracy, window)

    with progress_bar(progress, "inverting", None) as bar:
        if bar is not None:
            equations.tell = lambda doing: bar(0.0, doing)
        found, factor = within(solved, equations, bounds, stretch)
    slower, motions, poles = found[0], found[1], found[3]
    tau = applied(equations, motions)
    out = Inversion(
        arm, method, motions.t, motions.q, motions.v, motions.a, tau, slower(motions.t), path.names, keys,
        pre=float(slower.begin - motions.t[0]), post=float(motions.t[-1] - slower.end), error=motions.error,
        edge=max(motions.edges), iterations=int(found[2]), seconds=time.perf_counter() - begun, slowed=factor,
        poles=poles,
        exceeded=exceeded(equations, motions, tau, bounds, keys), _path=slower,
        _at=(equations.output.link, equations.output.x), _held=equations.locked, _passive=equations.passive,
    )  # fmt: skip
    if rings := check_rest(slower, motions, poles, accuracy):
        warn(f"invert: {rings}", InversionWarning)
    if (beyond := worst_range(arm, out.t, out.q)) is not None:
        warn(range_warning(arm, beyond).of("invert"))
    if out.exceeded:
        text = "; ".join(map(str, out.exceeded)) + "; slow the path (stretch=True), or take another posture"
        warn(f"invert: {text}", InversionWarning)
    return out


# -- arguments --------------------------------------------------------------------------------------------------------


def _rates(arm: Arm, name: str, links: Any) -> list[int]:
    """The rates of the joints named."""
    if isinstance(links, (str, Mapping)) or not isinstance(links, Iterable):
        raise ValueError(f"{name} = {links!r}: must be a list of links, or (link, freedom)")
    return [i for key in links for i in arm.joint_rates(key, f"{name}: link")]


def _equations(arm: Arm, output: Output, passive: Any, lock: Any, method: str) -> tuple[Equations, list[Any]]:
    if arm.nq != arm.nv:
        name = arm.joint_names[arm.quaternions()[0][0]]
        raise ValueError(f"arm: joint {name} is a ball; take three rotations in its place (Axes, Universal)")
    arm.refuse_rubbing("invert: arm")
    arm.refuse_loops("invert: arm")
    free, locked, dry = _rates(arm, "passive", passive), _rates(arm, "lock", lock), by_freedom(arm, "coulomb")
    for i in free:
        if i in locked:
            raise ValueError(f"passive: {arm.coordinates[i]} is in lock, too")
        if dry[i]:
            raise ValueError(f"passive: {arm.coordinates[i]} has dry friction; only driven joints may have it")
    keys = freedoms(arm)
    joints = [i for i in keys.values() if i not in free and i not in locked]
    inner = [i for i in range(arm.nv) if i not in dry or i in free]
    p = len(output.names)
    if len(joints) < p:
        raise ValueError(
            f"tip: {p} components ({', '.join(output.names)}) need {p} driven joints, the arm has {len(joints)}; give "
            "fewer components, such as 'azimuth' for one joint that turns"
        )
    if method == "rigid" and free:
        raise ValueError('passive: method="rigid" has none')
    equations = Equations(arm, output, joints, inner, np.zeros(len(joints)))
    equations.elastic = method != "rigid"
    equations.locked, equations.passive = (tuple(k for k, i in keys.items() if i in x) for x in (locked, free))
    return equations, [key for key, i in keys.items() if i in joints]


def _start(equations: Equations, path: Path, q: Any, posture: Any) -> Array:
    """The pose at rest at the beginning of the path; sets the posture."""
    if q is not None and posture is not None:
        raise ValueError("posture: q is the posture already; give one of them")
    arm = equations.arm
    name, value = ("q", q) if q is not None else ("posture", posture)
    pose = arm._place(name, value)
    wanted = path(np.array([path.begin]))[0]
    equations.posture = pose[equations.joints]
    if equations.elastic:
        pose = arm.equilibrium(pose, lock=[key for key in freedoms(arm) if key not in equations.passive])
    else:
        pose = pose.copy()
        pose[equations.inner] = 0.0
    if q is not None:
        off = equations.output.error(pose[None], wanted[None])[0]
        if np.linalg.norm(off) > 1e-6 * max(1.0, equations.length):
            says = ", ".join(f"{n} by {x:.4g}" for n, x in zip(path.names, off, strict=True))
            raise ValueError(
                f"q: the path does not begin at the tip of this pose in balance: it is away in {says} (m, rad); begin "
                "it at arm.frame(arm.equilibrium(q, lock=...)), or give posture= instead, and a pose is found"
            )
    equations.check_singular(pose, f"{name}: is a singular pose")
    pose, _ = equations.balance(pose, wanted, path.begin)
    if posture is None:
        equations.posture = pose[equations.joints]
    return pose


# -- limits -----------------------------------------------------------------------------------------------------------


def bounds_of(arm: Arm, limits: Any, keys: list[Any]) -> dict[str, Array]:
    """Limits by kind: (m,), of the range (2, m)."""
    given, rates = by_kind(limits, LIMITS), [arm.joint_rate(key) for key in keys]
    ranges = joint_ranges(arm, "limits['range']", given.pop("range", None), rates)
    return {"range": ranges} | {name: joint_limits(arm, f"limits[{name!r}]", x, rates) for name, x in given.items()}


def applied(equations: Equations, found: Motions) -> Array:
    """The motors' torques, with the dry friction that they overcome."""
    tau = np.zeros_like(found.tau)
    tau[:, equations.joints] = found.tau[:, equations.joints]
    for i, dry in by_freedom(equations.arm, "coulomb").items():
        if dry and i in equations.joints:
            v = found.v[:, i]
            tau[:, i] += dry * np.sign(v) * (np.abs(v) > 1e-6 * np.abs(v).max())
    return tau


def exceeded(
    equations: Equations, found: Motions, tau: Array, bounds: Mapping[str, Array], keys: list[Any]
) -> list[Exceeded]:
    out: list[Exceeded] = []
    th, names = equations.joints, [equations.arm.coordinates[i] for i in equations.joints]
    for kind, values in (("torque", tau[:, th]), ("speed", found.v[:, th])):
        if kind not in bounds:
            continue
        for k in np.flatnonzero(np.abs(values).max(axis=0) > bounds[kind] * (1 + 1e-9)).tolist():
            at = int(np.abs(values[:, k]).argmax())
            numbers = float(found.t[at]), float(values[at, k]), float(bounds[kind][k])
            out.append(Exceeded(kind, keys[k], *numbers, names[k]))
    q, (low, high) = found.q[:, th], bounds["range"]
    for k in range(len(th)):
        for at, limit, beyond in ((int(q[:, k].argmin()), low[k], q[:, k].min() < low[k]),
                                  (int(q[:, k].argmax()), high[k], q[:, k].max() > high[k])):  # fmt: skip
            if beyond:
                out.append(Exceeded("range", keys[k], float(found.t[at]), float(q[at, k]), float(limit), names[k]))
    return out


def within(solved: Any, equations: Equations, bounds: Mapping[str, Array], stretch: bool) -> tuple[Any, float]:
    """A solution within the limits, and the factor by which the path is slowed for it."""
    found = solved(1.0)
    if not stretch:
        return found, 1.0

    def respected(motions: Motions) -> bool:
        over = exceeded(equations, motions, applied(equations, motions), bounds, list(range(len(equations.joints))))
        for x in over:
            if x.kind == "range":
                raise ValueError(f"limits: {x}, and no slowing helps; take another posture")
        return not over

    if respected(found[1]):
        return found, 1.0
    low, high = 1.0, 2.0
    while not respected((found := solved(high))[1]):
        if high > 60:
            raise ValueError(
                "limits: are exceeded even by a path 64 times slower, so by gravity alone; allow more torque, or take "
                "another posture"
            )
        low, high = high, 2 * high
    while high / low > 1 + _NEAR:
        middle = float(np.sqrt(low * high))
        trial = solved(middle)
        if respected(trial[1]):
            high, found = middle, trial
        else:
            low = middle
    return found, high
