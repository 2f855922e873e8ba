"""The plant of control loops: the arm about a state."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from .._check import Array, finite
from ..analysis.assembly import Closure
from ..analysis.closed import holding, reduced, turning
from ..analysis.modes import shift
from ..model.parts.chain import Chain

_SLOWEST = 1.0  # 1/s: displacements of a mode are scaled by its frequency, or by this where that is lower


class Plant:
    """Small motions about a state that nothing accelerates: x' = A x + `forces`(columns) u, and [theta; v] = T x.

    x are coordinates of modes: displacements, times the frequency, then rates, both to unit mass. So all numbers of A
    are of the size of frequencies, and slow motions keep their digits beside fast ones. Forces that hold the arm in
    the state are taken as constant, whatever gives them.

    Attributes:
        arm, q, v: the arm and the state. free: the rates that are not prescribed.
        A: (2 n, 2 n), n the number of free rates, or of the motions that rigid loops leave them. T: (2 nv, 2 n).

    Raises:
        ValueError: no rate is free, or masses or forces there are not finite. LinAlgError: the masses are singular.
    """

    def __init__(self, arm: Chain, q: Array, v: Array, prescribed: Sequence[int], loads: Any = ()) -> None:
        import scipy.linalg as la  # slow to import

        self.arm, self.q, self.v = arm, q, v
        self.free = np.setdiff1d(np.arange(arm.nv), prescribed)
        if not self.free.size:
            raise ValueError("lock: no coordinate is left to move")
        at, T = np.ix_(self.free, self.free), np.eye(arm.nv)[:, self.free]
        by_q, by_v = (finite("inverse derivatives", x) for x in arm._core.inverse_derivatives(q, v, 0.0 * v, *loads))
        self.E = arm._core.rates(q, v)[2]
        K, C, M, W = (by_q @ self.E)[at], by_v[at], arm.mass_matrix(q)[at], turning(arm, v)[at]
        if arm.constrained:
            T, M, K, C, W = self._on_loops(loads)
        d = finite("the root of the masses", 1.0 / np.sqrt(np.diag(M)))
        M1, K1 = d[:, None] * M * d, d[:, None] * (0.5 * (K + K.T)) * d
        sigma = shift(M1, K1, 1.0)
        mu, V = la.eigh(M1, K1 + sigma * M1)
        with np.errstate(divide="ignore"):
            square = np.abs(1.0 / mu - sigma)
        V = d[:, None] * V
        # where nothing holds some of them they are orthogonal to 1e-4 alone
        V = np.linalg.solve(np.linalg.cholesky(V.T @ M @ V), V.T).T
        w = np.maximum(np.sqrt(square), _SLOWEST)
        inverse = V.T @ M
        self.A = finite("the linear model", np.block([
            [-w[:, None] * (inverse @ W @ V) / w, np.diag(w)],
            [-(V.T @ K @ V) / w, -(V.T @ C @ V)],
        ]))  # fmt: skip
        n, nv = V.shape[1], arm.nv
        self._V = T @ V
        self.T = np.zeros((2 * nv, 2 * n))
        self.T[:nv, :n], self.T[nv:, n:] = self._V / w, self._V

    def _on_loops(self, loads: Any) -> tuple[Array, ...]:
        """The motions T that rigid loops leave, and their M, K, C and W."""
        arm, q, v = self.arm, self.q, self.v
        if v.any():
            raise ValueError("v: must be zero: rates of an arm with rigid loops have no linear loop of control here")
        free, closure = np.isin(np.arange(arm.nv), self.free), Closure(arm)
        r = reduced(arm, closure, q, v, holding(arm, closure, q, v, loads, ~free), free, loads)
        if not r.K.size:
            raise ValueError("lock: no motion is left")
        return r.T, np.eye(len(r.K)), r.K, r.C, r.W

    def forces(self, columns: Array) -> Array:
        """x' by generalised forces, columns (nv, m): (2 n, m)."""
        return np.vstack([np.zeros((self._V.shape[1], columns.shape[1])), self._V.T @ columns])

    def reads(self, by_q: Array, by_v: Array) -> Array:
        """Rows by x, (m, 2 n), of outputs with the derivatives by_q (m, nq) and by_v (m, nv)."""
        return np.asarray(np.hstack([by_q @ self.E, by_v]) @ self.T)

    def feels(self, by_a: Array) -> Array:
        """Rows by x' of outputs with the derivatives by_a (m, nv) by the accelerations."""
        return np.hstack([np.zeros((len(by_a), self._V.shape[1])), by_a @ self._V])
