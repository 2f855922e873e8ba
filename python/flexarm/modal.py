"""Natural frequencies and modes about a steady spin."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._check import Array, array

if TYPE_CHECKING:
    from .arm import Arm


@dataclass(frozen=True)
class Modes:
    """Small free motions about a steady state, in ascending frequency.

    Attributes:
        frequencies: |s| (rad/s), shape (n,): undamped natural frequencies of what oscillates. Zero for a rigid-body
            motion, or a mode that is lost to divergence (then `damping` is -1). An overdamped mode stands twice, once
            for each of its real roots (damping 1): then n is above the number of free coordinates.
        damping: ratios -Re(s)/|s|, shape (n,); negative when unstable.
        shapes: one column a mode, shape (nv, n); locked coordinates are zero, the largest entry is 1. Complex when
            gyroscopic or damped.
        participation: share of each coordinate in a mode's kinetic energy, shape (nv, n), columns adding up to 1.
        eigenvalues: s (1/s), shape (n,); of each conjugate pair the one with Im(s) > 0, and every real one.
        q: the steady state, shape (nv,).
    """

    frequencies: Array
    damping: Array
    shapes: NDArray[Any]
    participation: Array
    eigenvalues: NDArray[np.complex128]
    q: Array

    @property
    def stable(self) -> bool:
        """Whether no mode grows."""
        return bool((self.eigenvalues.real <= 1e-9 * np.abs(self.eigenvalues).max(initial=0.0)).all())


def steady_state(arm: Arm, q: Array, v: Array, joints: NDArray[np.bool_]) -> Array:
    """Elastic coordinates in balance at joint positions q and constant rates v, by Newton's iteration."""
    import scipy.linalg as la  # slow to import

    q, zero = q.copy(), np.zeros(arm.nv)
    elastic = np.flatnonzero(~joints)
    at = np.array([arm.coordinate_of(int(i)) for i in elastic], dtype=int)  # where the elastic coordinates stand in q
    if elastic.size == 0:
        return q
    scale = 1.0 / np.sqrt(np.abs(np.diag(arm._core.inverse_derivatives(q, v, zero)[0][np.ix_(elastic, at)])) + 1e-300)
    for _ in range(50):
        force = arm._core.inverse_dynamics(q[None], v[None], zero[None])[0][elastic]
        stiffness = arm._core.inverse_derivatives(q, v, zero)[0][np.ix_(elastic, at)]
        step = scale * la.lstsq(scale[:, None] * stiffness * scale, -scale * force)[0]
        q[at] += step
        if not np.isfinite(q).all():
            break
        if np.linalg.norm(step / scale) <= 1e-13 * max(1e-6, float(np.linalg.norm(q[at] / scale))):
            return q
        if np.linalg.norm(scale * force) < 1e-14:
            return q
    raise ValueError("speed: no steady state of the elastic coordinates was found at this speed, gravity and q")


def modes(
    arm: Arm,
    q: ArrayLike | None = None,
    speed: Mapping[int, float] | None = None,
    lock: Iterable[int] | None = None,
) -> Modes:
    q0 = arm.zero if q is None else array("q", q, (arm.nq,))
    v0 = np.zeros(arm.nv)
    joints = np.zeros(arm.nv, dtype=bool)
    for k, part in enumerate(arm.links):
        joints[arm._core.first(k) : arm._core.first(k) + part.joint.nv] = True
    for i, value in arm.by_rate("speed", speed).items():
        v0[i] = array("speed", value, ())
    free = np.ones(arm.nv, dtype=bool)
    if lock is not None and not isinstance(lock, Iterable):
        raise ValueError(f"lock = {lock!r}: must be a list of link numbers")
    for link in () if lock is None else lock:
        free[arm.joint_rates(link, "lock: link")] = False
    if not free.any():
        raise ValueError("lock: no coordinate is left to move")
    q0 = steady_state(arm, q0, v0, joints)

    # M dv + G v + K q = 0 for small motions; scaled so that M has a unit diagonal
    at = np.ix_(free, free)
    by_q, by_v = arm._core.inverse_derivatives(q0, v0, np.zeros(arm.nv))
    _, _, E = arm._core.rates(q0, v0)  # dq = E v: small turns of a ball move its quaternion so
    K, G = (by_q @ E)[at], by_v[at]
    M = np.asarray(arm._core.mass_matrix(q0[None])[0])[at]
    d = 1.0 / np.sqrt(np.diag(M))
    M, G, K = (d[:, None] * x * d for x in (M, G, K))
    size = float(np.abs(K).max()) or 1.0
    conservative = np.abs(G).max() <= 1e-13 * np.sqrt(size) and np.abs(K - K.T).max() <= 1e-10 * size
    s, vectors = _conservative(M, K) if conservative else _general(M, G, K)

    shapes = np.zeros((arm.nv, s.size), dtype=vectors.dtype)
    shapes[free] = d[:, None] * vectors
    largest = np.abs(shapes).argmax(axis=0)
    shapes = shapes / shapes[largest, np.arange(s.size)]
    radius = np.abs(s)
    oscillates = np.abs(s.imag) > 1e-9 * max(radius.max(), 1e-300)
    frequencies = np.where(oscillates | ((s.real < 0) & (radius > 0)), radius, 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        damping = np.where(radius > 0, -s.real / radius, 0.0)
    damping[np.abs(damping) < 1e-12] = 0.0
    share = np.zeros(shapes.shape)
    share[free] = np.abs(np.real(np.conj(vectors) * (M @ vectors)))
    share /= share.sum(axis=0)
    up = np.lexsort((radius, frequencies))
    return Modes(frequencies[up], damping[up], shapes[:, up], share[:, up], s[up], q0)


def _shift(M: Array, K: Array) -> float:
    """The least of a row of numbers sigma that makes K + sigma M positive definite; 0 if K is."""
    import scipy.linalg as la  # slow to import

    sigma = 0.0
    for _ in range(60):
        try:
            la.cholesky(K + sigma * M)
            return sigma
        except la.LinAlgError:
            sigma = max(10.0 * sigma, 1e-6 * float(np.abs(np.diag(K)).min()), 1e-12 * float(np.abs(K).max()), 1e-30)
    return sigma


def _conservative(M: Array, K: Array) -> tuple[NDArray[np.complex128], Array]:
    """s^2 M + K = 0. Solved as M x = mu (K + sigma M) x for the largest mu: eigh(K, M) loses digits of low modes when
    the highest eigenvalue is 1e10 times the lowest."""
    import scipy.linalg as la  # slow to import

    K = 0.5 * (K + K.T)
    sigma = _shift(M, K)
    mu, vectors = la.eigh(M, K + sigma * M)
    square = 1.0 / mu - sigma
    square[np.abs(square) < 1e-10 * max(sigma, 1e-300)] = 0.0
    return np.emath.sqrt(-square).astype(complex), vectors


def _general(M: Array, G: Array, K: Array) -> tuple[NDArray[np.complex128], NDArray[Any]]:
    """s^2 M + s G + K = 0, as an ordinary eigenvalue problem of w = 1/(s - sigma), for the same reason."""
    import scipy.linalg as la  # slow to import

    n = len(M)
    sigma = np.sqrt(_shift(M, 0.5 * (K + K.T)))
    at_shift = la.lu_factor(M * sigma**2 + G * sigma + K)
    companion = np.zeros((2 * n, 2 * n))
    companion[:n, :n] = -la.lu_solve(at_shift, 2 * sigma * M + G)
    companion[:n, n:] = -la.lu_solve(at_shift, M)
    companion[n:, :n] = np.eye(n)
    w, vectors = la.eig(companion)
    s = sigma + 1.0 / w
    s[np.abs(s) < 1e-5 * sigma] = 0.0
    tiny = 1e-12 * np.abs(s).max()
    upper, real = np.flatnonzero(s.imag > tiny), np.flatnonzero((np.abs(s.imag) <= tiny) & (s != 0))
    zero = np.flatnonzero(s == 0)  # two for each rigid-body motion; one stands for it
    keep = np.concatenate([zero[: (zero.size + 1) // 2], real, upper])
    s = np.where(np.abs(s.imag) <= tiny, s.real, s)
    return s[keep], vectors[n:, keep]
