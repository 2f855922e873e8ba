"""Statistics of a fit from residuals and derivatives: deviations, correlations, undetermined combinations."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .._check import Array

_WHITE = 0.01  # below this p-value residuals count as coloured
_HIGH = 0.95  # least correlation that a report names
_MEETS = 0.1  # least share of two numbers in common combinations for one group
_SEEN = 2.0  # standard deviations of the data: smaller changes are not visible
_TRACE = 0.02  # of the largest change in a combination: smaller ones are left out
_APART = 1e3  # largest condition number for distinct directions
_MIXES = 5000  # most combinations that are tried
_BLOCK = 256  # rows
_LONGEST = 60  # lags over which correlation is counted
_RANK = 1e-6  # of the largest singular value: below it derivatives count as dependent


class Whiteness(NamedTuple):
    """Whether a column's residuals are white (Ljung & Box 1978, Biometrika 65, 297).

    Attributes:
        p: the p-value of the correlation if residuals were white.
        lags: number of lags tested. correlation: at these, (lags,).
    """

    p: float
    lags: int
    correlation: Array

    @property
    def white(self) -> bool:
        return self.p >= _WHITE


def autocorrelation(r: Array, lags: int) -> Array:
    """Autocorrelation of residuals r (n,), without their mean, at lags 1 to `lags`."""
    x = r - r.mean()
    n = 1 << (2 * len(x) - 1).bit_length()
    power = np.abs(np.fft.rfft(x, n)) ** 2
    c = np.fft.irfft(power, n)[: lags + 1]
    return np.asarray(c[1:] / c[0]) if c[0] > 0 else np.zeros(lags)


def independent(r: Array) -> float:
    """How many independent residuals are worth as much as r (n,): fewer where r is correlated, whose correlations are
    summed up to the first that is negative."""
    rho = autocorrelation(r, int(max(1, min(_LONGEST, len(r) // 10))))
    return float(len(r) / (1 + 2 * np.sum(rho[np.cumprod(rho > 0) > 0])))


def whiteness(r: Array) -> Whiteness:
    """Tests residuals r (n,) for whiteness."""
    from scipy.stats import chi2  # slow to import

    n = len(r)
    lags = int(max(1, min(20, n // 5)))
    rho = autocorrelation(r, lags)
    q = n * (n + 2) * float(np.sum(rho**2 / (n - np.arange(1, lags + 1))))
    return Whiteness(float(chi2.sf(q, lags)), lags, rho)


def coloured(r: Array) -> Array:
    """Autocorrelation (n,) of residuals r (n,) by an autoregressive model (Yule-Walker; order by Schwarz' criterion).
    It is smooth, while the sample autocorrelation is noisy."""
    n = len(r)
    most = int(max(1, min(30, n // 10)))
    rho = np.concatenate([[1.0], autocorrelation(r, most)])
    best, phi, error, chosen = np.inf, np.empty(0), 1.0, np.empty(0)
    for order in range(0, most + 1):  # Levinson's and Durbin's recursion
        if order:
            k = (rho[order] - phi @ rho[order - 1 : 0 : -1]) / error if order > 1 else rho[1]
            phi = np.append(phi - k * phi[::-1], k)
            error *= 1 - k * k
        if not error > 0:
            break
        score = n * np.log(error) + order * np.log(n)
        if score < best:
            best, chosen = score, phi.copy()
    out = np.zeros(n)
    out[: len(chosen) + 1] = rho[: len(chosen) + 1]
    for k in range(len(chosen) + 1, n):
        out[k] = chosen @ out[k - len(chosen) : k][::-1]
        if k % 64 == 0 and np.abs(out[k - 63 : k + 1]).max() < 1e-4:
            break
    return out


def covariance(J: Array, blocks: Sequence[tuple[slice, Array | None]]) -> Array:
    """Covariance of the unknowns, (n, n), from derivatives J (m, n) of residuals of variance 1.

    Args:
        J: the derivatives.
        blocks: rows of J and the autocorrelation of the residuals there; None: they are white. Where one is given,
            the estimate is the sandwich A^-1 B A^-1 with A = J^T J and B = J^T R J (White 1980, Econometrica 48, 817).
    """
    A = pseudo_inverse(J)
    if all(rho is None for _, rho in blocks):
        return A
    from scipy.linalg import matmul_toeplitz  # slow to import

    B = J.T @ J
    for rows, rho in blocks:
        if rho is not None:
            part = J[rows]
            B += part.T @ matmul_toeplitz(rho, part) - part.T @ part
    told = np.isfinite(A.diagonal())
    A = np.where(np.outer(told, told), A, 0.0)  # inf times 0 is nan
    return np.asarray(A @ B @ A + np.diag(np.where(told, 0.0, np.inf)))


def upper(J: Array) -> Array:
    """R of J = Q R, for J (m, n) of many rows: in blocks, too small for the threads of a BLAS, which wait longer than
    they work."""
    rows = max(_BLOCK, 2 * J.shape[1])
    while len(J) > 2 * rows:
        J = np.vstack([np.linalg.qr(J[k : k + rows], mode="r") for k in range(0, len(J), rows)])
    return np.asarray(np.linalg.qr(J, mode="r"))


def pseudo_inverse(J: Array) -> Array:
    """(J^T J)^-1, (n, n), for columns of any scale; inf on the diagonal of columns that are zero or depend on
    others."""
    size = np.linalg.norm(J, axis=0)
    by = np.where(size > 0, size, 1.0)
    _, s, V = np.linalg.svd(upper(J) / by, full_matrices=False)
    good = s > _RANK * s.max(initial=0.0)
    C = (V[good].T / s[good] ** 2) @ V[good]
    lost = (np.abs(V[~good]) > 1e-3).any(axis=0) if (~good).any() else np.zeros(len(size), bool)
    C = C / np.outer(by, by)
    C[lost, lost] = np.inf
    return np.asarray(C)


class Loose(NamedTuple):
    """A group of correlated numbers: the data determine combinations of them well, but each alone badly.

    Attributes:
        names: two or more. changes: how much the first may change, with all others refitted, until the root mean square
            of the residuals is 1 % larger, and the changes of the others.
        correlation: of the first with the best combination of all others (multiple correlation, 0 to 1).
    """

    names: tuple[str, ...]
    changes: tuple[float, ...]
    correlation: float

    def __str__(self) -> str:
        first, *others = (f"{name} by {x:+.3g}" for name, x in zip(self.names, self.changes, strict=True))
        told = f"{first} with {' and '.join(others)} leaves 1 % more"
        return f"{told}: these stand in for each other (correlation {self.correlation:.3f})"


def loose(J: Array, r: Array, slopes: Array, names: Sequence[str], correlation: Array) -> list[Loose]:
    """Groups of numbers with multiple correlations above 0.95 that share combinations which the data determine far
    better than each number (eigenvectors of small eigenvalues of their correlation).

    Args:
        J: derivatives (m, n) of the residuals r (m,). slopes: of the numbers by their inner values, (n,).
        names: of the numbers. correlation: of these, (n, n).
    """
    A = pseudo_inverse(J)
    some = np.flatnonzero(np.isfinite(correlation.diagonal()) & np.isfinite(A.diagonal()))
    size, V = np.linalg.eigh(correlation[np.ix_(some, some)])
    size = np.maximum(size, np.finfo(float).eps)
    R = np.sqrt(np.maximum(0.0, 1.0 - 1.0 / (V**2 / size).sum(axis=1)))
    told = V[:, size < 1.0 - _HIGH**2]  # numbers of a high R take part in one of these
    met = (np.abs(told @ told.T) > _MEETS) & np.outer(R > _HIGH, R > _HIGH)
    much = 1.01**2 - 1.0  # |r + J d|^2 = |r|^2 + |J d|^2 at the minimum
    found, left = [], set(range(len(some)))
    while left:
        group = {min(left)}
        while grown := {int(k) for k in np.flatnonzero(met[sorted(group)].any(axis=0))} - group:
            group |= grown
        left -= group
        if len(group) > 1:
            at = some[sorted(group)]
            step = np.linalg.norm(r) * np.sqrt(much / A[at[0], at[0]]) * A[at, at[0]] * slopes[at]
            found.append(Loose(tuple(names[k] for k in at), tuple(step.tolist()), float(R[min(group)])))
    return found


class Untold(NamedTuple):
    """A combination of numbers that the data do not determine.

    Attributes:
        names: numbers that change together. changes: of each, relative to its value; the largest is 1.
        seen: change of the fit, in standard deviations of the data.
    """

    names: tuple[str, ...]
    changes: tuple[float, ...]
    seen: float

    def __str__(self) -> str:
        if len(self.names) == 1:
            return f"{self.names[0]}: a change of 100 % would hardly be seen"
        parts = [f"{name} by {100 * x:+.3g} %" for name, x in zip(self.names, self.changes, strict=True)]
        return f"{', '.join(parts[:-1])} and {parts[-1]}, together, would hardly be seen"


def untold(J: Array, sizes: Array, names: Sequence[str], parts: Array) -> list[Untold]:
    """Combinations that the data do not determine: a change by the full size of a number moves all residuals together
    by less than 2 of their standard deviations, or the derivatives are linearly dependent.

    Args:
        J: derivatives (m, n). sizes: of the inner value of each number, (n,). names: of them.
        parts: each size relative to the number's value, (n,).
    """
    scaled = J * sizes
    norms = np.linalg.norm(scaled, axis=0)
    found = [Untold((names[k],), (1.0,), 0.0) for k in np.flatnonzero(norms == 0).tolist()]
    some = np.flatnonzero(norms).tolist()
    if not some:
        return found
    R = upper(scaled[:, some] / norms[some])
    _, s, V = np.linalg.svd(R)
    reach = np.abs(V / norms[some]).max(axis=1)  # largest change in each direction
    s = np.append(s, np.zeros(len(V) - len(s)))
    for change in _sparse(V[(s < _SEEN * reach) | (s < _RANK * s.max())], norms[some] / parts[some]):
        part = np.flatnonzero(np.abs(change) > _TRACE).tolist()
        moved = change / parts[some]
        seen = float(np.linalg.norm(scaled[:, some] @ moved))
        if seen > 2 * _SEEN and seen > 1e3 * _RANK * float(np.abs(moved) @ norms[some]):
            continue  # was mixed with a visible one
        found.append(Untold(tuple(names[some[k]] for k in part), tuple(float(change[k]) for k in part), seen))
    return found


def _sparse(rows: Array, by: Array) -> Array:
    """Orthonormal directions (k, n) as sparse combinations of numbers, over `by`: each has a number of its own and as
    few numbers as possible; the largest change of each is 1."""
    k, n = rows.shape
    best, fewest = rows / by, n * k + 1
    if k > 1 and math.comb(n, k) <= _MIXES:
        for pivots in itertools.combinations(range(n), k):
            part = rows[:, list(pivots)]
            if np.linalg.cond(part) < _APART:
                mixed = np.linalg.solve(part, rows) / by
                mixed = mixed / np.abs(mixed).max(axis=1, keepdims=True)
                count = int((np.abs(mixed) > _TRACE).sum())
                if count < fewest:
                    best, fewest = mixed, count
    return np.array([row / row[np.argmax(np.abs(row))] for row in best]).reshape(rows.shape)
