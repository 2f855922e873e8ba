"""The equations of an inversion: joints that keep the tip on the path, and the elastic coordinates' own dynamics."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .._check import Array, finite
from ..arm import Arm
from .path import Output, Path, Slower

_TURN = 0.3  # rad (parts of the arm's length, for slides) that a joint may move between two poses found in turn
_SINGULAR = 1e-3  # least to largest singular value of how the joints move the output
_TRIES = 60  # Newton steps to a pose
_FOUND = 1e-12  # of a joint's change (rad, m), where its pose is found


class Poses(NamedTuple):
    """The arm in balance, its tip on the path: times (n,), coordinates (n, nq)."""

    t: Array
    q: Array


class Equations:
    """An arm whose driven joints keep an output on a path, nearest to a posture where there are more of them.

    Attributes:
        joints: indices of the driven joints' rates. inner: of all that no motor moves: elastic, and passive joints.
        posture: of the driven joints, (m,).
    """

    def __init__(self, arm: Arm, output: Output, joints: list[int], inner: list[int], posture: Array) -> None:
        self.arm, self.output, self.posture = arm, output, posture
        self.joints, self.inner = np.array(joints, dtype=int), np.array(inner, dtype=int)
        self.length = max(float(np.linalg.norm(arm.frame(arm.zero)[0])), sum(
            link.beam.length for link in arm.links if link.beam is not None), 1e-3)  # fmt: skip
        self.elastic = True  # whether the inner coordinates move
        # (link, freedom) of joints that stay, and of those that nothing drives
        self.locked: tuple[tuple[int, int], ...] = ()
        self.passive: tuple[tuple[int, int], ...] = ()

    # -- kinematics ---------------------------------------------------------------------------------------------------

    def on_path(self, q: Array, wanted: Array, posture: Array | None = None) -> tuple[Array, Array]:
        """q (n, nq) with the driven joints so that the output is `wanted` (n, p), and how far it is still off, (n,);
        nearest to a posture (n, m), or that of all times."""
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
        return q, np.linalg.norm(self.output.error(q, wanted), axis=-1)

    def follow(self, q: Array) -> tuple[Array, Array]:
        """How the driven joints (..., m, k) and the output, those held, (..., p, k) move with the inner coordinates."""
        J = self.output.jacobian(q)
        direct = J[..., self.inner]
        return -_pseudo_inverse(J[..., self.joints]) @ direct, direct

    def moved(self, q: Array, d: Array) -> float:
        """How far changes d (nv,) of the inner coordinates move the output, the arm's end (m) and passive joints (m,
        rad), the driven joints held."""
        direct = self.output.jacobian(q[None])[0][:, self.inner] @ d[self.inner]
        end = self.arm.jacobian(q)[:3, self.inner] @ d[self.inner]
        passive = [d[self.arm.joint_rate(key)] for key in self.passive]
        return float(np.abs([*direct, *end, *passive]).max())

    # -- balance ------------------------------------------------------------------------------------------------------

    def balance(self, q: Array, wanted: Array | None, K: Array | None = None) -> tuple[Array, float, Array | None]:
        """q (nq,) with the inner coordinates in balance with gravity, and the output on the path if one is wanted; how
        far that is still off; and the stiffness last used, which another pose nearby may begin with."""
        zero, off = np.zeros(self.arm.nv), 0.0
        for k in range(40):
            if wanted is not None:
                found, left = self.on_path(q[None], wanted[None])
                q, off = found[0], float(left[0])
            if not self.elastic or not len(self.inner):
                return q, off, K
            r = self.arm._core.inverse_dynamics(q, zero, zero)[self.inner]
            if K is None or k % 8 == 7:
                K = self.stiffness(q, wanted is not None)
            step = np.linalg.solve(K, -r)
            q = q.copy()
            q[self.inner] += step
            if np.abs(step).max() <= 1e-11 * max(1.0, float(np.abs(q[self.inner]).max())):
                break
        if wanted is not None:
            q = self.on_path(q[None], wanted[None])[0][0]
        return finite("balance", q), off, K

    def stiffness(self, q: Array, on_path: bool) -> Array:
        """Of the inner coordinates at rest, the driven joints following."""
        zero = np.zeros(self.arm.nv)
        by_q = self.arm._core.inverse_derivatives(q, zero, zero, by_v=False)[0][self.inner]
        K: Array = by_q[:, self.inner] + (by_q[:, self.joints] @ self.follow(q)[0] if on_path else 0.0)
        if self.passive and not np.linalg.cond(K) < 1e12:
            raise ValueError(
                f"passive: nothing holds the joints {list(self.passive)} at rest, no spring and no weight, so that no "
                "inverse comes to rest; drive them, lock them, or give them springs"
            )
        return K

    def along(self, path: Path | Slower, start: Array) -> Poses:
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
                q, off, K = self.balance(ahead, wanted[k], K)
                if off > 1e-9 * max(1.0, self.length):
                    raise ValueError(self._unreached(t[k], off, wanted[k]))
                self.check_singular(q, t[k])
                found.append(q)
            poses = np.array(found)
            step = np.abs(np.diff(poses[:, self.joints], axis=0)).max()
            if step <= _TURN or count >= 400:
                return Poses(t, poses)
            count = min(400, int(count * step / _TURN) + 8)

    def _unreached(self, t: float, off: float, wanted: Array) -> str:
        names = ", ".join(f"{name} {value:.4g}" for name, value in zip(self.output.names, wanted, strict=True))
        return (
            f"tip: at t = {t:.4g} s the path is beyond reach: {names} is missed by {off:.3g} (m, rad); the arm is "
            f"{self.length:.4g} m long; let the path stay within reach, or start from another pose (q=)"
        )

    def check_singular(self, q: Array, t: float) -> None:
        J = self.output.jacobian(q[None])[0][:, self.joints]
        sizes = np.linalg.svd(J, compute_uv=False)
        if not sizes[0] > 1e-9 * self.length:
            raise ValueError(f"tip: no driven joint moves {', '.join(self.output.names)} at t = {t:.4g} s, in pose q = "
                             f"{np.round(q[self.joints], 4).tolist()}: it has no inverse")  # fmt: skip
        if sizes[-1] < _SINGULAR * sizes[0]:
            raise ValueError(
                f"tip: at t = {t:.4g} s the path goes through a singular pose, joints "
                f"{np.round(q[self.joints], 4).tolist()}: in one direction of {', '.join(self.output.names)} "
                f"they move the tip {sizes[0] / max(sizes[-1], 1e-300):.3g} times less than in another; pass it at a "
                "distance, or ask for fewer components"
            )

    # -- dynamics -----------------------------------------------------------------------------------------------------

    def matrices(self, q: Array, v: Array, a: Array) -> tuple[Array, Array, Array]:
        """M, C, K (k, k) of the inner coordinates about one motion, the driven joints following them."""
        by_q, by_v = self.arm._core.inverse_derivatives(q, v, a)
        T, rows = self.follow(q)[0], self.inner
        M, C, K = (X[np.ix_(rows, rows)] + X[np.ix_(rows, self.joints)] @ T
                   for X in (self.arm._core.mass_matrix(q), by_v, by_q))  # fmt: skip
        return M, C, K


def _pseudo_inverse(J: Array) -> Array:
    """Of J (..., p, m) with p <= m and full rank."""
    Jt = np.swapaxes(J, -1, -2)
    JJ = J @ Jt
    size = np.trace(JJ, axis1=-2, axis2=-1)[..., None, None]
    return np.asarray(Jt @ np.linalg.inv(JJ + (1e-14 * size + 1e-300) * np.eye(JJ.shape[-1])))
