"""Inputs and outputs of a sampled law, and the linear law that fits them."""

from __future__ import annotations

import numpy as np

from ..._check import Array

_SEEN = 400  # stored samples of a law, the first ones
_FIT = 1e-3  # relative error of a linear fit
_PAST = 3  # most past samples in a fit


class LawRecord:
    """Inputs and outputs of a sampled law, before its limit."""

    def __init__(self) -> None:
        self.asked: list[tuple[Array, Array]] = []

    def note(self, y: Array, u: Array) -> None:
        if len(self.asked) < _SEEN:
            self.asked.append((y, u))

    def law(self) -> tuple[Array, Array, Array, Array] | None:
        """A, B, C, D of x+ = A x - B y, u = C x - D y, if that fits most samples; else None: the law is not linear,
        remembers more than three samples, or has too few."""
        if len(self.asked) < 2:
            return None
        y, u = (np.diff(np.array(x, dtype=float), axis=0) for x in zip(*self.asked, strict=True))
        for past in range(min(_PAST + 1, len(y))):
            for told in (0, past)[: 1 + (past > 0)]:  # past outputs
                late = [x[past - k : len(x) - k] for x, n in ((y, past), (u, told)) for k in range(1, n + 1)]
                found = _fit(np.hstack([y[past:], *late]), u[past:])
                if found is not None:
                    return _remembering(np.pad(found, ((0, 0), (0, (past - told) * u.shape[1]))), y.shape[1], past)
        return None


def _fit(y: Array, u: Array) -> Array | None:
    """D of u = D y, if that holds in most rows; else None."""
    size = np.abs(y).max(axis=0)
    used = np.flatnonzero(size > 0.0)
    rows, keep = y[:, used] / size[used], np.ones(len(y), bool)
    weight = np.linalg.norm(rows, axis=1)  # equal weight of early and late samples, even if they grow
    keep &= weight > 0.0
    for _ in range(3):  # a jump of the reference makes outliers
        if keep.sum() < max(rows.shape[1] + 3, 0.6 * len(y)):
            return None
        left, right = rows[keep] / weight[keep, None], u[keep] / weight[keep, None]
        found, _, rank, _ = np.linalg.lstsq(left, right, rcond=1e-6)
        miss = np.abs(left @ found - right).max(axis=1)
        if rank < rows.shape[1]:
            return None
        if miss.max() <= _FIT * np.abs(right).max():
            gains = np.zeros((u.shape[1], y.shape[1]))
            gains[:, used] = (found / size[used, None]).T
            return gains
        keep[np.flatnonzero(keep)[miss > 3.0 * np.median(miss)]] = False
    return None


def _remembering(found: Array, ny: int, past: int) -> tuple[Array, Array, Array, Array]:
    """The law u = found [y; past y; past u]; its states are the past values."""
    nu, D, C = len(found), -found[:, :ny], found[:, ny:]
    A, B = np.zeros((C.shape[1],) * 2), np.zeros((C.shape[1], ny))
    first, second = ny * past, nu * past
    A[:first, :first] = np.eye(first, k=-ny)
    A[first:, first:] = np.eye(second, k=-nu)
    if past:
        B[:ny] = -np.eye(ny)
        A[first : first + nu], B[first : first + nu] = C, D
    return A, B, C, D
