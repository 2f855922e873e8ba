"""Static equilibrium and steady spin, by Newton's iteration with exact Jacobians."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._check import Array, array

if TYPE_CHECKING:
    from .arm import Arm

_LARGEST = 0.5  # of a step's entries (rad, m, or the elastic coordinate's unit): a step must not pass an equilibrium by
_TRIES = 200


def displaced(arm: Arm, q: Array, E: Array, step: Array) -> Array:
    """q moved by a step of its rates (nv,): q + E step, quaternions brought back to unit length."""
    out: Array = q + E @ step
    for _, at in arm.quaternions():
        out[at] /= np.linalg.norm(out[at])
    return out


def _root_step(M: Array, K: Array, r: Array) -> Array:
    import scipy.linalg as la  # slow to import

    d = 1.0 / np.sqrt(np.maximum(np.abs(np.diag(K)), 1e-14 * np.diag(M)))
    step: Array = -d * la.lstsq(d[:, None] * K * d, d * r)[0]
    return step


def _descent_step(M: Array, K: Array, r: Array, forces: float) -> Array:
    """Newton's step with |lambda| for the eigenvalues lambda of (K, M): downhill in potential energy. Where lambda is
    zero the arm is indifferent and stays, unless a force above the noise of `forces` (sqrt(kg) m/s^2) pushes it."""
    import scipy.linalg as la  # slow to import

    lam, Z = la.eigh(0.5 * (K + K.T), M)
    g = Z.T @ r
    least = 1e-14 * float(np.abs(lam).max())
    flat = (np.abs(lam) <= max(least, 1e-300)) & (np.abs(g) <= 1e-11 * forces)
    g[flat] = 0.0
    step: Array = -Z @ (g / np.maximum(np.abs(lam), max(least, 1e-300)))
    return step


def balance(
    arm: Arm, q: Array, v: Array, tau: Array, free: NDArray[np.bool_], descend: bool, loads: Any = ()
) -> tuple[Array, str]:
    """Moves the free coordinates of q until inverse_dynamics(q, v, 0) = tau on them; loads: places and wrenches.

    Steps are at most 0.5 and are halved until the residual, scaled by the mass matrix, is less than it was, or (when
    descending in potential energy) the step still leads downhill at its end. Newton's convergence being quadratic, the
    step after one of 1e-8 is the last. Returns q, and what went wrong if anything did.
    """
    q, zero = q.copy(), np.zeros(arm.nv)
    if not free.any():
        return q, ""
    at = np.ix_(free, free)
    moved = np.zeros(arm.nv)

    def residual(q: Array) -> Array:
        r: Array = (arm._core.inverse_dynamics(q[None], v[None], zero[None], *loads)[0] - tau)[free]
        return r

    r, forces, steps = residual(q), 0.0, 0
    while steps < _TRIES:
        steps += 1
        M: Array = np.asarray(arm._core.mass_matrix(q[None])[0])[at]
        E = arm._core.rates(q, zero)[2]
        K = (arm._core.inverse_derivatives(q, v, zero, *loads)[0] @ E)[at]
        scale = 1.0 / np.sqrt(np.diag(M))
        forces = max(forces, float(np.linalg.norm(scale * r)), float(np.linalg.norm(scale * tau[free])), _weight(arm))
        step = _descent_step(M, K, r, forces) if descend else _root_step(M, K, r)
        if not np.isfinite(step).all():
            break
        step *= min(1.0, _LARGEST / max(float(np.abs(step).max()), 1e-300))
        slope, size = float(step @ r), float(np.linalg.norm(scale * r))
        last = bool(np.abs(step).max() <= 1e-8 * (1e-3 + np.abs(E.T @ q)[free].max()))
        for halving in range(40):
            moved[free] = step / 2.0**halving
            q_new = displaced(arm, q, E, moved)
            r_new = residual(q_new)
            finite = np.isfinite(r_new).all()
            if finite and (last or np.linalg.norm(scale * r_new) < size or (descend and slope < 0 > step @ r_new)):
                break
        else:
            break
        q, r = q_new, r_new
        if last:
            return q, ""
    worst = int(np.abs(r / np.sqrt(np.diag(M))).argmax())
    label = np.array(arm.coordinates)[free][worst]
    return q, f"after {steps} damped Newton steps from the q given {r[worst]:.3g} is left on '{label}'"


def _weight(arm: Arm) -> float:
    """Size of the weight in the norm of the mass matrix, sqrt(m) g."""
    return float(np.sqrt(sum(link.mass for link in arm.links)) * np.linalg.norm(arm.gravity))


def elastic_rates(arm: Arm) -> NDArray[np.bool_]:
    """Which rates are elastic coordinates', (nv,)."""
    elastic = np.ones(arm.nv, dtype=bool)
    for k, link in enumerate(arm.links):
        elastic[arm._core.first(k) : arm._core.first(k) + link.joint.nv] = False
    return elastic


def steady_state(arm: Arm, q: Array, v: Array, loads: Any = ()) -> Array:
    """Elastic coordinates in balance at joint positions q and constant rates v."""
    q, wrong = balance(arm, q, v, np.zeros(arm.nv), elastic_rates(arm), descend=False, loads=loads)
    if wrong:
        raise ValueError(
            f"speed: no steady state of the elastic coordinates at this speed, gravity, loads and q: {wrong}"
        )
    return q


def locked_rates(arm: Arm, lock: Iterable[Any] | None) -> NDArray[np.bool_]:
    """Which rates belong to the locked joints, (nv,)."""
    locked = np.zeros(arm.nv, dtype=bool)
    if lock is not None and (isinstance(lock, str) or not isinstance(lock, Iterable)):
        raise ValueError(f"lock = {lock!r}: must be a list of link numbers, such as [0, 1]")
    for link in () if lock is None else lock:
        locked[arm.joint_rates(link, "lock: link")] = True
    return locked


def equilibrium(arm: Arm, q: ArrayLike | None, tau: ArrayLike | None, lock: Iterable[Any] | None, loads: Any) -> Array:
    """See Arm.equilibrium."""
    q0 = arm.zero if q is None else array("q", q, (arm.nq,))
    forces = np.zeros(arm.nv) if tau is None else array("tau", tau, (arm.nv,))
    free = ~locked_rates(arm, lock)
    q0, wrong = balance(arm, q0, np.zeros(arm.nv), np.where(free, forces, 0.0), free, True, loads)
    if wrong:
        raise ValueError(
            f"tau, gravity, loads: no equilibrium was found: {wrong} (N, N m); hold a joint with lock or tau"
        )
    return q0
