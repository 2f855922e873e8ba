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
from .residuals import Residuals
from .runs import scales
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


class Search:
    """A search for the unknowns of residuals, and the display of its progress.

    Args:
        residuals: of the runs. noise: of columns, where it is given. most: iterations of one least squares.

    Attributes:
        first: the first weight of each column. best: the best point so far, or None.
    """

    def __init__(self, residuals: Residuals, noise: Mapping[str, float], most: int) -> None:
        self.residuals, self.noise, self.most, self.first = residuals, noise, most, scales(residuals.runs, noise)
        self.best: Array | None = None
        self._show: Callable[[int, str], None] | None = None
        self._cost, self._iterations, self._usual, self._began = np.inf, 0, 0, time.monotonic()

    def showing(self, show: Callable[[int, str], None]) -> None:
        """Shows progress from now on: `show` is called with the number of runs, and a text."""
        self._show, self.residuals.look = show, self._tell

    def __call__(self, starts: Array, keep: int, alone: bool) -> Found:
        """The best point from several starts (k, n), of which the best `keep` are fitted. `alone`: from the first only,
        if that leaves less than a tenth of each column's deviation.

        Raises:
            RunStopped: none of them could be simulated.
        """
        if not alone:
            return self._from(starts, keep)
        try:
            found = self._from(starts[:1], 1)
        except RunStopped:
            return self._from(starts, keep)
        if self._explains(found.inner):
            return found
        self._cost = np.inf
        return min(found, self._from(starts, keep), key=self._minus_log_likelihood)

    # -- progress ------------------------------------------------------------------------------------------------------

    def _seen(self, inner: Array, cost: float) -> None:
        """Stores a point if it is the best."""
        if cost < self._cost:
            self.best, self._cost = inner.copy(), cost
        self._tell()

    def _tell(self) -> None:
        """Shows the progress of the search, and its approximate end for a usual number of iterations."""
        if self._show is None:
            return
        text = f"{self.residuals.count} runs, iteration {self._iterations + 1}"
        if np.isfinite(self._cost):
            text += f", rms {np.sqrt(self._cost):.4g}"
        if 0 < self._iterations < self._usual:
            whole = (time.monotonic() - self._began) / self._iterations * self._usual
            text += f"; about {seconds(whole)} in all if it takes {self._usual} iterations, which is usual"
        self._show(self.residuals.count, text)

    # -- stages --------------------------------------------------------------------------------------------------------

    def _from(self, starts: Array, keep: int) -> Found:
        """The best point from these starts, with the first weights; then with weights from the residual noise."""
        tried = [np.inf] * len(starts)
        if len(starts) > 1:
            for i, rows in enumerate(self.residuals.many(starts)):
                if rows is not None:
                    tried[i] = _rms(self.residuals.weighted(starts[i], self.first, rows))
                    self._seen(starts[i], tried[i] ** 2)
        order = sorted(range(len(starts)), key=lambda i: tried[i])[: max(1, keep)]
        self._usual = self._iterations + _USUAL * (len(order) + _WEIGHTED)
        ends: dict[int, tuple[float, Array]] = {}
        failed: RunStopped | None = None
        for i in order:
            try:
                inner, _ = self._fitted(starts[i], self.first)
                ends[i] = _rms(self.residuals.weighted(inner, self.first)), inner
            except RunStopped as e:
                failed = e
        if not ends:
            assert failed is not None
            raise failed
        inner = min(ends.values(), key=lambda x: x[0])[1]
        return self.weighed(Found(inner, dict(self.first), tried=tried, fitted={k: x[0] for k, x in ends.items()}))

    def _fitted(self, inner: Array, sigma: Mapping[str, float]) -> tuple[Array, Any]:
        """Solves least squares from one point. Returns the end point and scipy's result.

        A small weight holds each number at its start, so that undetermined combinations stay there (rounding errors
        would move them). The next least squares starts at the end of the last, until nothing changes.

        Raises:
            RunStopped: the run at the start, or one of the derivatives, failed.
        """
        from scipy.optimize import least_squares  # slow to import

        residuals = self.residuals
        low = np.array([x.inner(x.of.low) if np.isfinite(x.of.low) else -np.inf for x in residuals.sought])
        high = np.array([x.inner(x.of.high) if np.isfinite(x.of.high) else np.inf for x in residuals.sought])

        def weighted(u: Array) -> Array:
            r = residuals.weighted(u, sigma)
            if np.isfinite(r).all():  # otherwise the step is shortened
                self._seen(u, float(np.mean(r**2)))
            return r

        if not np.isfinite(weighted(inner)).all():
            raise RunStopped(residuals.why, np.nan)
        norms = np.linalg.norm(residuals.jacobian(inner, sigma), axis=0)
        hold = np.diag(np.maximum(_HOLD * norms, _HOLD_PRIOR))

        def slopes(u: Array) -> Array:
            J = residuals.jacobian(u, sigma)
            self._iterations += 1
            return np.vstack([J, hold])

        done = least_squares(
            lambda u: np.append(weighted(u), hold @ (u - inner)), inner, slopes,
            bounds=(low, high), x_scale="jac", max_nfev=self.most, xtol=1e-9, ftol=1e-9, gtol=1e-12,
        )  # fmt: skip
        std = np.sqrt(np.diag(pseudo_inverse(done.jac)))
        pulled = std * np.diag(hold) ** 2 * np.abs(done.x - inner)
        done.pulled = float(np.max(pulled[std * _HOLD_PRIOR < 0.9], initial=0.0))
        return np.asarray(done.x), done

    def weighed(self, found: Found) -> Found:
        """Continues from a point with weights from the residual noise, until that settles."""
        first, sigma = dict(found.sigma), self.estimated(found.inner, found.sigma)
        for _ in range(_ROUNDS):
            self._cost = np.inf  # costs change with the weights
            found.inner, done = self._fitted(found.inner, sigma)
            found.sigma, sigma = sigma, self.estimated(found.inner, first)
            if done.pulled < _HOLD_EFFECT and all(abs(sigma[k] / found.sigma[k] - 1) < _SETTLED for k in sigma):
                break
        found.sigma, found.message, found.converged = sigma, str(done.message), bool(done.status > 0)
        return found

    # -- noise ---------------------------------------------------------------------------------------------------------

    def estimated(self, inner: Array, first: Mapping[str, float]) -> dict[str, float]:
        """The noise of each column: as given, or the standard deviation of the residuals, with the fit's degrees of
        freedom; `first` are the weights so far."""
        found = self.residuals.residuals(inner)
        assert found is not None
        total = sum(y.size for y in found)
        free = max(1, total - len(inner)) / total
        out = dict(first)
        for name in first.keys() - self.noise.keys():
            having = [(run, y) for run, y in zip(self.residuals.runs, found, strict=True) if name in run.outputs]
            r = np.concatenate([y[list(run.outputs).index(name)] for run, y in having])
            out[name] = max(float(np.sqrt(np.mean(r**2) / free)), _LEAST * first[name])
        return out

    def _explains(self, inner: Array) -> bool:
        """Whether the residuals of all columns are below a tenth of their deviation."""
        found = self.residuals.residuals(inner)
        assert found is not None
        rows = [np.sqrt((y**2).mean(axis=1)) < _LEFT * run.measured.std(axis=1)
                for run, y in zip(self.residuals.runs, found, strict=True)]  # fmt: skip
        return bool(np.concatenate(rows).all())

    def _minus_log_likelihood(self, found: Found) -> float:
        """Twice the negative log-likelihood, up to a constant."""
        r = self.residuals.weighted(found.inner, found.sigma)
        count = {name: sum(len(run.data) for run in self.residuals.runs if name in run.outputs) for name in found.sigma}
        return float(r @ r + 2 * sum(count[k] * np.log(x) for k, x in found.sigma.items() if k not in self.noise))


def _rms(r: Array) -> float:
    return float(np.sqrt(np.mean(r**2)))
