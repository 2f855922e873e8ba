"""The time-optimal move of the rigid arm along a path.

J. E. Bobrow, S. Dubowsky and J. S. Gibson, "Time-optimal control of robotic manipulators along specified paths",
International Journal of Robotics Research 4(3) (1985), 3-17. D. Verscheure et al., "Time-optimal path tracking for
robots: a convex optimization approach", IEEE Transactions on Automatic Control 54 (2009), 2318-2327: with x = (ds/dt)²
and u = d²s/dt² = (dx/ds)/2 all limits are linear, but for viscous friction. Of two speeds along the path that keep
them, the larger at every place keeps them too: the fastest is the one with the largest sum of x, a linear programme.
"""

from typing import NamedTuple

import numpy as np

from ..._check import Array
from ...arm.arm import Arm
from ..joint_limits import Driven, Limits, by_freedom
from .route import Route

_INTERVALS = 400
_ROUNDS = 20  # for viscous friction


class RigidMove(NamedTuple):
    """A way along a path, with constant d²s/dt² between places."""

    t: Array  #: places in time (s), (n + 1,)
    s: Array  #: the place on the path there
    ds: Array  #: its rate there
    dds: Array  #: its second rate between them, (n,)

    @property
    def duration(self) -> float:
        return float(self.t[-1])

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """s and its two rates at times (s); at rest before and after."""
        inside = np.clip(t, 0.0, self.duration)
        k = np.clip(np.searchsorted(self.t, inside, side="right") - 1, 0, len(self.dds) - 1)
        dt, rest = inside - self.t[k], (t < 0.0) | (t > self.duration)
        s = self.s[k] + dt * (self.ds[k] + 0.5 * dt * self.dds[k])
        return s, np.where(rest, 0.0, self.ds[k] + dt * self.dds[k]), np.where(rest, 0.0, self.dds[k])


def joint_torques(arm: Arm, driven: Driven, q: Array, v: Array, a: Array) -> Array:
    """Torques of the joints of the arm with straight beams, (n, nj)."""
    full = [np.zeros((len(q), n)) for n in (arm.nq, arm.nv, arm.nv)]
    full[0][:] = arm.zero
    full[0][:, driven.at] = q
    full[1][:, driven.rates], full[2][:, driven.rates] = v, a
    return arm.inverse_dynamics(*full)[:, driven.rates]


def fastest(arm: Arm, driven: Driven, route: Route, limits: Limits) -> RigidMove:
    """The time-optimal move along a route under limits of torque, speed and acceleration.

    Raises:
        ValueError: a torque does not hold the arm's weight, naming joint, place, need and limit.
    """
    s = np.linspace(0.0, 1.0, _INTERVALS + 1)
    middle = 0.5 * (s[1:] + s[:-1])
    q, d1, d2, _ = route(middle)
    zero = np.zeros_like(q)
    still = joint_torques(arm, driven, q, zero, zero)
    _check_weight(still, middle, q, driven, limits)
    by_u = joint_torques(arm, driven, q, zero, d1) - still
    forth, back = joint_torques(arm, driven, q, d1, d2), joint_torques(arm, driven, q, -d1, d2)
    by_x, viscous = 0.5 * (forth + back) - still, 0.5 * (forth - back)
    still = still + np.array(list(by_freedom(arm, "coulomb").values())) * np.sign(d1)
    x = _profile(s, (by_u, by_x, still), (d1, d2), limits, route) if not viscous.any() else np.zeros(_INTERVALS + 1)
    with np.errstate(divide="ignore"):
        slow = 0.25 * np.nanmin(np.where(viscous == 0, np.inf, (limits.torque - np.abs(still)) / viscous) ** 2, axis=1)
    at = np.minimum(slow, 1e12)  # linearises the friction here: the concave c sqrt(x) lies below its tangents
    for _ in range(_ROUNDS if viscous.any() else 0):
        root = np.sqrt(at)[:, None]
        torque = by_u, by_x + 0.5 * viscous / root, still + 0.5 * viscous * root
        before, x = x, _profile(s, torque, (d1, d2), limits, route)
        at = np.maximum(0.5 * (x[1:] + x[:-1]), 1e-9 * x.max())
        if np.abs(x - before).max() < 1e-6 * x.max():
            break
    ds = np.sqrt(np.maximum(x, 0.0))
    dt = 2.0 * np.diff(s) / (ds[1:] + ds[:-1])
    return RigidMove(np.append(0.0, np.cumsum(dt)), s, ds, np.diff(x) / (2.0 * np.diff(s)))


def _check_weight(still: Array, s: Array, q: Array, driven: Driven, limits: Limits) -> None:
    """ValueError where the torque needed at rest is not below the limit."""
    over = np.abs(still) - limits.torque
    k, j = np.unravel_index(int(over.argmax()), over.shape)
    if over[k, j] >= 0.0:
        raise ValueError(
            f"limits['torque'] = {limits.torque[j]:.6g} of '{driven.names[j]}': cannot hold the arm's weight at "
            f"q = {np.array2string(q[k], precision=4)} (s = {s[k]:.3f}), which takes {abs(still[k, j]):.6g} (N, N m)"
        )


def _profile(
    s: Array, torque: tuple[Array, Array, Array], way: tuple[Array, Array], limits: Limits, route: Route
) -> Array:
    """The largest x at the places s that keeps the limits in the middle of the intervals, and of speed at the places.

    Args:
        torque: of each joint by u, by x, and without either, (n, nj) each. way: dq/ds and d²q/ds² there.
    """
    import scipy.sparse as sp  # slow to import
    from scipy.optimize import linprog

    n = len(s) - 1
    by_u, by_x, rest = torque
    rise = sp.diags([np.full(n, -1.0), np.full(n, 1.0)], [0, 1], shape=(n, n + 1)) / (2.0 / n)
    mean = sp.diags([np.full(n, 0.5), np.full(n, 0.5)], [0, 1], shape=(n, n + 1))
    rows, bounds = [], []
    for j in range(by_u.shape[1]):
        both = ((by_u, by_x, rest, limits.torque), (way[0], way[1], np.zeros_like(rest), limits.acceleration))
        for of_u, of_x, alone, most in both:
            if np.isfinite(most[j]):
                row = (sp.diags(of_u[:, j]) @ rise + sp.diags(of_x[:, j]) @ mean) / most[j]
                rows += [row, -row]
                bounds += [1.0 - alone[:, j] / most[j], 1.0 + alone[:, j] / most[j]]
    with np.errstate(divide="ignore"):
        top = (np.where(np.isfinite(limits.speed), limits.speed, np.inf) / np.abs(route(s)[1])).min(axis=1) ** 2
    top[[0, -1]] = 0.0
    scale = _scale(rows, bounds)  # so that x is about 1
    found = linprog(-np.ones(n + 1), sp.vstack(rows) * scale, np.concatenate(bounds), method="highs",
                    bounds=np.column_stack([np.zeros(n + 1), np.minimum(top / scale, 1e6)]))  # fmt: skip
    if found.status != 0:
        raise ValueError(
            "torque, acceleration: no move along this path keeps them: somewhere it would have to go faster and slower "
            "at once, or weight and dry friction leave nothing to start or to stop with"
        )
    return np.asarray(scale * found.x)


def _scale(rows: list, bounds: list) -> float:  # type: ignore[type-arg]
    """About the largest x."""
    largest = [np.abs(row.tocsr()).max(axis=1).toarray().ravel() for row in rows]
    most = [row / np.maximum(b, 1e-3) for row, b in zip(largest, bounds, strict=True)]
    return 0.25 * len(most[0]) / max(float(np.median(np.concatenate(most))), 1e-300)
