"""Small motions of an arm whose loops are closed: in coordinates of the motions that rigid loops leave."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._check import Array, finite, tilde
from ..model.parts.chain import Chain
from .assembly import RANK, Closure

_SINGULAR = 1e-11  # of the largest eigenvalue: given accelerations that follow from each other


def turning(arm: Chain, v: Array) -> Array:
    """W (nv, nv) of d(theta)/dt = dv - W theta for small turns theta of balls in their links' axes, which the link
    carries along at w: from dR = R theta~ and dR/dt = R w~ follows d(theta)/dt = dw - w x theta. Zero otherwise."""
    W = np.zeros((arm.nv, arm.nv))
    for _, rates in arm.ball_rates():
        W[rates, rates] = tilde(v[rates])
    return W


def tangent(closure: Closure, q: Array, free: NDArray[np.bool_], M: Array) -> Array:
    """The motions of the rates that rigid loops leave, where others than the `free` ones are held: T (nv, n), of unit
    mass, T' M T = 1. LinAlgError where the masses are singular."""
    import scipy.linalg as la  # slow to import

    at = np.flatnonzero(free)
    J = closure.jacobian(q)[:, at]
    U, s, _ = np.linalg.svd(J / closure.sizes[at], full_matrices=False)
    rows = U[:, s > RANK * s.max(initial=0.0)].T @ J  # as many as hold something that the others do not
    d = 1.0 / np.sqrt(M.diagonal()[at])
    L = la.cholesky(d[:, None] * M[np.ix_(at, at)] * d, lower=True)
    Z = la.solve_triangular(L, (rows * d).T, lower=True)
    null = la.qr(Z)[0][:, Z.shape[1] :] if Z.size else np.eye(len(at))
    T = np.zeros((len(free), null.shape[1]))
    T[at] = d[:, None] * la.solve_triangular(L.T, null)
    return T


class Slopes(NamedTuple):
    """Accelerations with the loops closed, and their derivatives by small displacements of the rates, by rates and by
    generalised forces, where the accelerations of some rates are given.

    Attributes:
        a: (nv,). q, v, tau: (nv, nv); tau of a given rate: by its acceleration. forces: with those of given rates.
    """

    a: Array
    q: Array
    v: Array
    tau: Array
    forces: Array


def slopes(arm: Chain, q: Array, v: Array, tau: Array, given: NDArray[np.bool_], loads: Any = ()) -> Slopes:
    """At a state with the loops closed; the accelerations of the `given` rates are zero."""
    core, E = arm._core, arm._core.rates(q, v)[2]
    by_tau: Array = core.forward_derivatives(q, v, tau, *loads)[2]
    a = core.forward_dynamics(q, v, tau, "ab", {}, *loads)
    back = np.zeros((arm.nv, int(given.sum())))
    if given.any():
        S = by_tau[np.ix_(given, given)]
        d = 1.0 / np.sqrt(np.maximum(S.diagonal(), 1e-300))
        inverse = d[:, None] * np.linalg.pinv(d[:, None] * S * d, _SINGULAR, hermitian=True) * d
        more = -inverse @ a[given]
        tau, a = tau.copy(), a + by_tau[:, given] @ more
        tau[given] += more
        back = by_tau[:, given] @ inverse
    by_q, by_v, _ = core.forward_derivatives(q, v, tau, *loads)
    by_q, by_v, by_tau = (finite("forward derivatives", x) for x in (by_q @ E, by_v, by_tau))
    by_q, by_v, by_tau = (x - back @ x[given] for x in (by_q, by_v, by_tau))
    by_tau[:, given] = back
    return Slopes(a, by_q, by_v, by_tau, tau)


def holding(arm: Chain, closure: Closure, q: Array, v: Array, loads: Any, held: NDArray[np.bool_]) -> Array:
    """Forces of the joints (nv,) with which the arm keeps its rates: of the `held` ones, and of others only those
    that these do not hold."""
    zero = np.zeros(arm.nv)
    T = tangent(closure, q, np.ones(arm.nv, bool), arm._core.mass_matrix(q))
    needed = T.T @ arm._core.inverse_dynamics(q, v, zero, *loads)
    tau, joints = zero, np.isin(np.arange(arm.nv), arm.freedoms)
    for at in (held, joints):
        if at.any():
            tau[at] += np.linalg.lstsq(T[at].T, needed - T.T @ tau, rcond=1e-10)[0]
    return tau


class Carried(NamedTuple):
    """Accelerations (nv,) with the loops closed, and the forces of all rows of the loops."""

    a: Array
    rows: Array


def carried(
    arm: Chain, closure: Closure, q: Array, v: Array, tau: Array, free: NDArray[np.bool_], loads: Any = ()
) -> Carried:
    """At a state with the loops closed, where rates that are not `free` are not accelerated."""
    places, wrenches = loads or ([], np.zeros((0, 6)))
    still = {int(i): 0.0 for i in np.flatnonzero(~free)}
    a = arm._core.forward_dynamics(q, v, tau, "ab", still, places, wrenches)
    left = arm._core.inverse_dynamics(q, v, a, places, wrenches) - tau
    J = closure.jacobian(q)
    d = 1.0 / closure.sizes[free]
    forces = np.linalg.lstsq((J[:, free] * d).T, d * left[free], rcond=RANK)[0]
    rows = np.zeros(len(closure.rigid))
    rows[closure.rigid] = closure.scale * forces
    return Carried(a, rows)


class Reduced(NamedTuple):
    """dz/dt = w - W z and dw/dt = -K z - C w; displacements of the rates are T z, and rates T w + N z.

    Attributes:
        T, N: (nv, n). W, K, C: (n, n), to unit masses. M: the masses of the tree, (nv, nv).
    """

    T: Array
    N: Array
    W: Array
    K: Array
    C: Array
    M: Array


def reduced(
    arm: Chain, closure: Closure, q: Array, v: Array, tau: Array, free: NDArray[np.bool_], loads: Any = ()
) -> Reduced:
    """The motions that loops and rates that are not `free` leave, about a state at which the loops are closed. From
    M a + h = tau + J' f: along T the forces f of loops do as if they were constant."""
    core, (places, wrenches) = arm._core, loads or ([], np.zeros((0, 6)))
    M = core.mass_matrix(q)
    T = tangent(closure, q, free, M)
    W, N = turning(arm, v), np.zeros_like(T)
    if v.any():  # from J a + dJ/dt v = 0: J dv cancels dJ/dt v where q moves along T
        whole = tangent(closure, q, np.ones(arm.nv, bool), M)
        N = 0.5 * (core.forward_derivatives(q, v, tau, places, wrenches)[1] + W) @ T
        N -= whole @ (whole.T @ M @ N)
    at = carried(arm, closure, q, v, tau, free, loads)
    by_q, by_v = core.inverse_derivatives(q, v, at.a, places, wrenches, True, at.rows)
    by_q, by_v = finite("inverse derivatives", by_q @ core.rates(q, v)[2]), finite("inverse derivatives", by_v)
    return Reduced(T, N, T.T @ M @ W @ T, T.T @ (by_q @ T + by_v @ N), T.T @ by_v @ T, M)
