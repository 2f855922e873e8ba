"""The search: several starts, least squares from the best of them, weights from the residual noise."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .._check import Array
from .._console import seconds
from ..run.sensitivity import RunStopped
from .problem import Problem
from .statistics import pseudo_inverse

_ROUNDS = 12  # most updates of the weights
_SETTLED = 0.01  # relative change of noise in the last update
_HOLD = 1e-4  # of a derivative's norm: weight that holds a number at the start of a least squares
_HOLD_PRIOR = 0.3  # or like a prior of this inverse standard deviation, in the number's scale or of its logarithm
_HOLD_EFFECT = 0.02  # standard deviations: largest effect of this weight at the end
_LEFT = 0.1  # of a column's deviation: with larger residuals, one start is not enough
_USUAL = 7  # usual iterations of one least squares
_WEIGHTED = 2  # usual number of least squares for the weights
_LEAST = 1e-9  # of a column's first weight: smaller noise counts as rounding


class Best:
    """The best point of a search so far, and the display of its progress."""

    def __init__(self, problem: Problem, show: Callable[[int, str], None] | None) -> None:
        self.problem, self.show = problem, show
        self.inner: Array | None = None
        self.cost = np.inf
        self.iterations, self.usual, self.began = 0, 0, time.monotonic()
        if show is not None:
            problem.look = self.tell

    def seen(self, inner: Array, cost: float) -> None:
        """Stores a point if it is the best."""
        if cost < self.cost:
            self.inner, self.cost = inner.copy(), cost
        self.tell()

    def tell(self) -> None:
        """Shows the progress of the search, and its approximate end for a usual number of iterations."""
        if self.show is None:
            return
        text = f"{self.problem.count} runs, iteration {self.iterations + 1}"
        if np.isfinite(self.cost):
            text += f", rms {np.sqrt(self.cost):.4g}"
        if 0 < self.iterations < self.usual:
            whole = (time.monotonic() - self.began) / self.iterations * self.usual
            text += f"; about {seconds(whole)} in all if it takes {self.usual} iterations, which is usual"
        self.show(self.problem.count, text)


@dataclass
class Found:
    """The end of a search.

    Attributes:
        inner: the point, (n,). sigma: noise by column. message: why it ended. converged: whether it converged.
        tried: rms of the weighted residuals of each start, (k,). fitted: the same after the fits, by start.
    """

    inner: Array
    sigma: dict[str, float]
    message: str = ""
    converged: bool = False
    tried: list[float] = field(default_factory=list)
    fitted: dict[int, float] = field(default_factory=dict)


def estimated(
    problem: Problem, inner: Array, first: Mapping[str, float], told: Mapping[str, float]
) -> dict[str, float]:
    """The noise of each column: as given, or the standard deviation of the residuals, with the fit's degrees of
    freedom."""
    found = problem.residuals(inner)
    assert found is not None
    total = sum(y.size for y in found)
    free = max(1, total - len(inner)) / total
    out = dict(first)
    for name in first:
        if name in told:
            continue
        having = [(run, y) for run, y in zip(problem.runs, found, strict=True) if name in run.outputs]
        r = np.concatenate([y[list(run.outputs).index(name)] for run, y in having])
        out[name] = max(float(np.sqrt(np.mean(r**2) / free)), _LEAST * first[name])
    return out


def fitted(problem: Problem, inner: Array, sigma: Mapping[str, float], best: Best, most: int) -> tuple[Array, Any]:
    """Solves least squares from one point. Returns the end point and scipy's result.

    A small weight holds each number at its start, so that undetermined combinations stay there (rounding errors would
    move them). The next least squares starts at the end of the last, until nothing changes.

    Raises:
        RunStopped: the run at the start, or one of the derivatives, failed.
    """
    from scipy.optimize import least_squares  # slow to import

    low = np.array([x.inner(x.of.low) if np.isfinite(x.of.low) else -np.inf for x in problem.sought])
    high = np.array([x.inner(x.of.high) if np.isfinite(x.of.high) else np.inf for x in problem.sought])

    def residuals(u: Array) -> Array:
        r = problem.weighted(u, sigma)
        if np.isfinite(r).all():  # otherwise the step is shortened
            best.seen(u, float(np.mean(r**2)))
        return r

    if not np.isfinite(residuals(inner)).all():
        raise RunStopped(problem.why, np.nan)
    norms = np.linalg.norm(problem.jacobian(inner, sigma), axis=0)
    hold = np.diag(np.maximum(_HOLD * norms, _HOLD_PRIOR))

    def slopes(u: Array) -> Array:
        J = problem.jacobian(u, sigma)
        best.iterations += 1
        return np.vstack([J, hold])

    done = least_squares(
        lambda u: np.append(residuals(u), hold @ (u - inner)), inner,
        slopes,
        bounds=(low, high), x_scale="jac", max_nfev=most, xtol=1e-9, ftol=1e-9, gtol=1e-12,
    )  # fmt: skip
    std = np.sqrt(np.diag(pseudo_inverse(done.jac)))
    pulled = std * np.diag(hold) ** 2 * np.abs(done.x - inner)
    done.pulled = float(np.max(pulled[std * _HOLD_PRIOR < 0.9], initial=0.0))
    return np.asarray(done.x), done


def search(
    problem: Problem, alone: bool, starts: Array, keep: int, first: Mapping[str, float], told: Mapping[str, float],
    most: int, best: Best,
) -> Found:  # fmt: skip
    """The best point from several starts (k, n), of which the best `keep` are fitted. `alone`: from the first only, if
    that leaves less than a tenth of each column's deviation.

    Raises:
        RunStopped: none of them could be simulated.
    """
    if not alone:
        return _searched(problem, starts, keep, first, told, most, best)
    try:
        found = _searched(problem, starts[:1], 1, first, told, most, best)
    except RunStopped:
        return _searched(problem, starts, keep, first, told, most, best)
    if _explains(problem, found.inner):
        return found
    best.cost = np.inf
    other = _searched(problem, starts, keep, first, told, most, best)
    return min(found, other, key=lambda x: _minus_log_likelihood(problem, x, told))


def _explains(problem: Problem, inner: Array) -> bool:
    """Whether the residuals of all columns are below a tenth of their deviation."""
    found = problem.residuals(inner)
    assert found is not None
    rows = [np.sqrt((y**2).mean(axis=1)) < _LEFT * run.measured.std(axis=1)
            for run, y in zip(problem.runs, found, strict=True)]  # fmt: skip
    return bool(np.concatenate(rows).all())


def _minus_log_likelihood(problem: Problem, found: Found, told: Mapping[str, float]) -> float:
    """Twice the negative log-likelihood, up to a constant."""
    r = problem.weighted(found.inner, found.sigma)
    count = {name: sum(len(run.data) for run in problem.runs if name in run.outputs) for name in found.sigma}
    return float(r @ r + 2 * sum(count[k] * np.log(x) for k, x in found.sigma.items() if k not in told))


def _searched(
    problem: Problem, starts: Array, keep: int, first: Mapping[str, float], told: Mapping[str, float], most: int,
    best: Best,
) -> Found:  # fmt: skip
    """The best point from these starts, with fixed weights."""
    tried = [np.inf] * len(starts)
    if len(starts) > 1:
        for i, residuals in enumerate(problem.many(starts)):
            if residuals is not None:
                r = problem.weighted(starts[i], first) if i == 0 else _weighted(problem, starts[i], residuals, first)
                tried[i] = float(np.sqrt(np.mean(r**2)))
                best.seen(starts[i], tried[i] ** 2)
    order = sorted(range(len(starts)), key=lambda i: tried[i])[: max(1, keep)]
    best.usual = best.iterations + _USUAL * (len(order) + _WEIGHTED)
    ends: dict[int, tuple[float, Array, Any]] = {}
    failed: RunStopped | None = None
    for i in order:
        try:
            inner, done = fitted(problem, starts[i], first, best, most)
            rms = np.sqrt(np.mean(problem.weighted(inner, first) ** 2))
            ends[i] = (float(rms), inner, done)
        except RunStopped as e:
            failed = e
    if not ends:
        assert failed is not None
        raise failed
    i = min(ends, key=lambda k: ends[k][0])
    inner, done = ends[i][1:]
    found = Found(inner, dict(first), tried=tried, fitted={k: x[0] for k, x in ends.items()})
    return weighed(problem, found, told, most, best, done)


def weighed(
    problem: Problem, found: Found, told: Mapping[str, float], most: int, best: Best, done: Any = None
) -> Found:
    """Continues from a point with weights from the residual noise, until that settles."""
    first = dict(found.sigma)
    sigma = estimated(problem, found.inner, first, told)
    for _ in range(_ROUNDS):
        best.cost = np.inf  # costs change with the weights
        found.inner, done = fitted(problem, found.inner, sigma, best, most)
        found.sigma, sigma = sigma, estimated(problem, found.inner, first, told)
        if done.pulled < _HOLD_EFFECT and all(abs(sigma[k] / found.sigma[k] - 1) < _SETTLED for k in sigma):
            break
    found.sigma, found.message, found.converged = sigma, str(done.message), bool(done.status > 0)
    return found


def _weighted(problem: Problem, inner: Array, residuals: list[Array], sigma: Mapping[str, float]) -> Array:
    rows = [(y / problem._sigmas(run, sigma)).ravel() for run, y in zip(problem.runs, residuals, strict=True)]
    return np.concatenate([*rows, problem._priors(inner)[0]])
