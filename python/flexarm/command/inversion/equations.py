"""The equations of an inversion: joints that keep the tip on the path, and the elastic coordinates' own dynamics."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ..._check import Array, finite
from ...analysis.validity import turned_inside_out
from ...arm.arm import Arm
from .path import Output, Path

_TURN = 0.3  # rad (for slides: parts of the arm's length): largest step of a joint between two successive poses
_SINGULAR = 1e-3  # ratio of the least to the largest singular value of the joints' Jacobian
_TRIES = 60  # Newton steps to a pose
REACHED = 1e-9  # m, rad: tolerance of the tip on the path
_MOST_POSES = 400  # along a path
_FOUND = 1e-12  # tolerance of a joint's change (rad, m)


class Poses(NamedTuple):
    """The arm in balance, its tip on the path: times (n,), coordinates (n, nq)."""

    t: Array
    q: Array


class Equations:
    """An arm whose driven joints keep an output on a path; redundant joints stay nearest to a posture.

    Attributes:
        joints: indices of the driven joints' rates. inner: of all rates without a motor: elastic, and passive joints.
        posture: of the driven joints, (m,). tell: called at each iteration, with a text on the progress.
    """

    def __init__(self, arm: Arm, output: Output, joints: list[int], inner: list[int], posture: Array) -> None:
        self.arm, self.output, self.posture = arm, output, posture
        self.joints, self.inner = np.array(joints, dtype=int), np.array(inner, dtype=int)
        far = float(np.linalg.norm(arm.end_places(arm.zero), axis=1).max())
        self.length = max(far, arm.beam_reach, 1e-3)
        self.elastic = True  # whether the inner coordinates move
        self.tell: Callable[[str], None] = lambda doing: None
        self.locked: tuple[Any, ...] = ()  # keys of locked freedoms, and of passive ones
        self.passive: tuple[Any, ...] = ()

    # -- kinematics ---------------------------------------------------------------------------------------------------

    def on_path(self, q: Array, wanted: Array, posture: Array | None = None) -> tuple[Array, Array]:
        """q (n, nq) with the driven joints solved for the output `wanted` (n, p), and the remaining error, (n,);
        nearest to a posture (n, m), or to that of all times."""
        posture = self.posture if posture is None else posture
        q, th = q.copy(), self.joints
        for _ in range(_TRIES):
            error, J = self.output.error(q, wanted), self.output.jacobian(q)[..., th]
            back = posture - q[..., th] if len(th) > error.shape[-1] else np.zeros((*q.shape[:-1], len(th)))
            left = error - np.einsum("...ij,...j->...i", J, back)
            step = np.einsum("...ij,...j->...i", _pseudo_inverse(J), left) + back
            longest = np.abs(step).max(axis=-1, keepdims=True)
            q[..., th] += step * np.minimum(1.0, _TURN / np.maximum(longest, 1e-300))
            if not longest.max() > _FOUND:
                break
        else:
            error = self.output.error(q, wanted)
        return q, np.linalg.norm(error, axis=-1)

    def follow(self, q: Array) -> tuple[Array, Array]:
        """Derivatives by the inner coordinates: of the following joints (..., m, k), of the held output (..., p, k)."""
        J = self.output.jacobian(q)
        direct = J[..., self.inner]
        return -_pseudo_inverse(J[..., self.joints]) @ direct, direct

    def moved(self, q: Array, d: Array) -> float:
        """Largest displacement of the output, the arm's ends (m) and passive joints (m, rad) by changes d (nv,) of the
        inner coordinates, with the driven joints held."""
        direct = self.output.jacobian(q[None])[0][:, self.inner] @ d[self.inner]
        ends = np.ravel([self.arm.jacobian(q, k)[:3, self.inner] @ d[self.inner] for k in self.arm.ends])
        passive = [d[self.arm.joint_rate(key)] for key in self.passive]
        return float(np.abs([*direct, *ends, *passive]).max())

    # -- balance ------------------------------------------------------------------------------------------------------

    def balance(self, q: Array, wanted: Array, t: float, K: Array | None = None) -> tuple[Array, Array | None]:
        """q (nq,) with the inner coordinates in balance with gravity, and the output on the path; and the last
        stiffness, a start for another pose nearby.

        Raises:
            ValueError: beyond reach, through a singular pose, or no balance, at time t."""
        zero, step = np.zeros(self.arm.nv), np.full(1, np.inf)
        for k in range(_TRIES):
            found, left = self.on_path(q[None], wanted[None])
            q = found[0]
            if not float(left[0]) <= REACHED * max(1.0, self.length):
                raise ValueError(self.unreached(t, float(left[0]), wanted))
            if not self.elastic or not len(self.inner):
                step = zero
            if np.abs(step).max() <= 1e-11 * max(1.0, float(np.abs(q).max())):
                break
            r = self.arm._core.inverse_dynamics(q, zero, zero)[self.inner]
            if K is None or k % 8 == 7:
                K = self.stiffness(q)
            step = np.linalg.solve(K, -r)
            q[self.inner] += step
        else:
            raise ValueError(f"tip: at t = {t:.4g} s no balance with gravity was found that has the tip on the path; "
                             "the arm may be too soft, or falls; take another posture")  # fmt: skip
        if wrong := turned_inside_out(self.arm, q):
            raise ValueError(f"tip: at t = {t:.4g} s no balance with gravity was found: {wrong}")
        self.check_singular(q, f"tip: at t = {t:.4g} s the path goes through a singular pose")
        return finite("balance", q), K

    def stiffness(self, q: Array) -> Array:
        """Stiffness of the inner coordinates at rest, with the driven joints following."""
        zero = np.zeros(self.arm.nv)
        by_q = self.arm._core.inverse_derivatives(q, zero, zero, by_v=False)[0][self.inner]
        K: Array = by_q[:, self.inner] + by_q[:, self.joints] @ self.follow(q)[0]
        if self.passive and not np.linalg.cond(K) < 1e12:
            names = ", ".join(repr(self.arm.coordinates[self.arm.joint_rate(key)]) for key in self.passive)
            raise ValueError(
                f"passive: nothing holds the joints {names} at rest, no spring and no weight, so that no inverse comes "
                "to rest; drive them, lock them, or give them springs"
            )
        return K

    def along(self, path: Path, start: Array) -> Poses:
        """Poses in balance along the path, each found from the one before.

        Raises:
            ValueError: beyond reach, or through a singular pose, with the time.
        """
        count = 16
        while True:
            t = np.linspace(path.begin, path.end, count + 1)
            wanted, found, K = path(t), [start], None
            for k in range(1, count + 1):
                ahead = 2 * found[-1] - found[-2] if k > 1 else start
                q, K = self.balance(ahead, wanted[k], float(t[k]), K)
                found.append(q)
            poses = np.array(found)
            steps = np.abs(np.diff(poses[:, self.joints], axis=0)).max(axis=1)
            if steps.max() <= _TURN or (count >= _MOST_POSES and steps.max() < 10 * steps.mean()):
                return Poses(t, poses)
            if count >= _MOST_POSES:
                raise ValueError(f"tip: at t = {t[steps.argmax()]:.4g} s a joint turns or moves by {steps.max():.3g} "
                                 "(rad, m) at once, near a singular pose; pass it at a distance")  # fmt: skip
            count = min(_MOST_POSES, int(count * steps.max() / _TURN) + 8)

    def unreached(self, t: float, off: float, wanted: Array) -> str:
        names = ", ".join(f"{name} {value:.4g}" for name, value in zip(self.output.names, wanted, strict=True))
        if not np.isfinite(off):
            return f"tip: at t = {t:.4g} s no pose was found for {names}: the arm bends too far; take another posture"
        return (
            f"tip: at t = {t:.4g} s the path is beyond reach: {names} is missed by {off:.3g} (m, rad); the arm is "
            f"{self.length:.4g} m long; let the path stay within reach, or start from another pose (q=)"
        )

    def check_singular(self, q: Array, where: str) -> None:
        J = self.output.jacobian(q[None])[0][:, self.joints]
        sizes = np.linalg.svd(J, compute_uv=False)
        if not sizes[0] > 1e-9 * self.length:
            raise ValueError(f"{where}: no driven joint moves {', '.join(self.output.names)} there, so there is no "
                             f"inverse; the joints stand at {np.round(q[self.joints], 4).tolist()}")  # fmt: skip
        if sizes[-1] < _SINGULAR * sizes[0]:
            raise ValueError(
                f"{where}, joints {np.round(q[self.joints], 4).tolist()}: in one direction of "
                f"{', '.join(self.output.names)} they move the tip {sizes[0] / max(sizes[-1], 1e-300):.3g} times less "
                "than in another; keep away from it (a straight arm is singular), or ask for fewer components"
            )

    # -- dynamics -----------------------------------------------------------------------------------------------------

    def matrices(self, t: Array, q: Array, v: Array, a: Array) -> tuple[Array, Array, Array]:
        """M, C, K (n, k, k) of small changes of the inner coordinates about a motion at times t (n,), the driven joints
        following them by T: their rates by T d' + T' d, their accelerations by T d'' + 2 T' d' + T'' d."""
        rows, T = self.inner, self.follow(q)[0]
        first = np.gradient(T, t, axis=0) if len(t) > 2 else np.zeros_like(T)
        second = np.gradient(first, t, axis=0) if len(t) > 2 else first
        M, C, K = [], [], []
        for k, state in enumerate(zip(q, v, a, strict=True)):
            by_q, by_v = (X[rows] for X in self.arm._core.inverse_derivatives(*state))
            mass = self.arm._core.mass_matrix(q[k])[rows]
            (Mj, Me), (Cj, Ce), (Kj, Ke) = ((X[:, self.joints], X[:, rows]) for X in (mass, by_v, by_q))
            M.append(Me + Mj @ T[k])
            C.append(Ce + Cj @ T[k] + 2 * Mj @ first[k])
            K.append(Ke + Kj @ T[k] + Cj @ first[k] + Mj @ second[k])
        return np.array(M), np.array(C), np.array(K)

    def held(self, q: Array) -> Array:
        """The inertia (n, k, k) of the inner coordinates at q (n, nq), with the driven joints held."""
        return np.array([self.arm._core.mass_matrix(pose)[np.ix_(self.inner, self.inner)] for pose in q])


def _pseudo_inverse(J: Array) -> Array:
    """Pseudo-inverse of J (..., p, m) with p <= m and full rank."""
    Jt = np.swapaxes(J, -1, -2)
    JJ = J @ Jt
    size = np.trace(JJ, axis1=-2, axis2=-1)[..., None, None]
    return np.asarray(Jt @ np.linalg.inv(JJ + (1e-14 * size + 1e-300) * np.eye(JJ.shape[-1])))
