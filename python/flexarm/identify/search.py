"""The search: several starts, least squares from the best of them, weights from the residual noise."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from .._check import Array
from .._console import seconds
from ..run.sensitivity import RunStopped
from .loss import Loss, deviation
from .residuals import Residuals
from .runs import scales
from .statistics import independent, pseudo_inverse, upper, whiteness

_ROUNDS = 12  # most updates of the weights
_SETTLED = 0.01  # relative change of noise in the last update
_HOLD = 1e-4  # of a derivative's norm: weight that holds a number at the start of a least squares
_HOLD_PRIOR = 0.3  # or like a prior of this inverse standard deviation, in the number's scale or of its logarithm
_HOLD_EFFECT = 0.02  # standard deviations: largest effect of this weight at the end
_SETTLED_STEP = 0.003  # standard deviations: smaller steps of a least squares do not matter
_ROUGH_STEP = 0.03  # the same, where steps gain less than half of the predicted: stick and slip has leaps
_REFUSED_STEP, _REFUSED = 0.1, 5  # the same, where a step brings nothing; and how often, with shorter and shorter steps
_ALIKE = 0.1  # standard deviations: so near derivatives are used again, but at the end
_COARSE_STEP, _COARSE_MOST = 0.3, 10  # the same, and most iterations, where of several starts one is continued
_NEAR = 0.1  # of the sum of squares: where steps take less off it, curvature that J^T J leaves out matters
_LEAST_BEND = 0.3  # of the curvature of J^T J: a step is longer by no more
_LEFT = 0.1  # of a column's deviation: with larger residuals, one start is not enough
_USUAL = 7  # usual iterations of one least squares
_WEIGHTED = 2  # usual number of least squares for the weights
_FILTERED = 12  # usual iterations of a filter's likelihood
_ABOUT = 16  # points about the end, of runs that leap
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


class _Ended(Exception):
    """The end of a least squares, and whether it has converged."""

    def __init__(self, message: str, converged: bool = True) -> None:
        super().__init__(message)
        self.converged = converged


@dataclass(frozen=True)
class _Point:
    """An accepted point of a least squares.

    Attributes:
        u: it, (n,). r, J: the residuals there, (m,), and their derivatives, (m, n): those at the point `of`, with the
            residuals r_of; `old` if that is another one. due: whether new ones are due.
        bend: the curvature that J^T J leaves out, (n, n). told: the derivatives that the search gets in place of J.
    """

    u: Array
    count: float = 1.0
    r: Array = field(default_factory=lambda: np.empty(0))
    J: Array = field(default_factory=lambda: np.empty((0, 0)))
    of: Array = field(default_factory=lambda: np.empty(0))
    r_of: Array = field(default_factory=lambda: np.empty(0))
    bend: Array = field(default_factory=lambda: np.empty((0, 0)))
    bent: bool = False
    told: Array = field(default_factory=lambda: np.empty((0, 0)))
    old: bool = False
    due: bool = True

    def gain(self, u: Array) -> float:
        """The part of the sum of squares that is expected to go on the way to u, times the count of independent
        residuals: e^2 for a step of e standard deviations to its least."""
        size = np.linalg.norm(self.r)
        left = np.append(size, np.zeros(len(self.told) - 1)) + self.told @ (u - self.u)
        return float(1 - left @ left / size**2) * self.count

    def near(self, u: Array) -> bool:
        """Whether u is so near to the point of the derivatives that they serve there, too."""
        size = float(np.sum((self.J @ (u - self.of)) ** 2) / np.sum(self.r**2)) * self.count
        return not self.due and size < _ALIKE**2

    def moved(self, u: Array, r: Array) -> _Point:
        """The point u with residuals r and these derivatives."""
        told = _slopes_of_size(r, self.J, self.bend if self.bent else 0 * self.bend)
        return replace(self, u=u.copy(), r=r, told=told, old=True)

    def next(self, u: Array, count: float, r: Array, J: Array, bent: bool) -> _Point:
        """The point u with residuals r, of which `count` are independent, and derivatives J. bent: whether to use the
        further curvature."""
        bend = self.bend if self.bend.size else np.zeros((len(u), len(u)))
        if self.of.size and (u != self.of).any():
            bend = _bent(bend, u - self.of, J.T @ r - self.J.T @ self.r_of, (J - self.J).T @ r)
        told = _slopes_of_size(r, J, bend if bent else 0 * bend)
        return _Point(u.copy(), count, r, J, u.copy(), r, bend, bent, told, old=False, due=False)


class _Solved(NamedTuple):
    """The end of a least squares. pulled: standard deviations by which its weights hold a value back."""

    inner: Array
    message: str
    converged: bool
    pulled: float


class Search:
    """A search for the unknowns of residuals, and the display of its progress.

    Args:
        residuals: of the runs. noise: of columns, where it is given. most: iterations of one least squares.
        loss: once the weights are those of the residual noise; None: squares.

    Attributes:
        first: the first weight of each column. best: the best point so far, or None.
    """

    def __init__(
        self, residuals: Residuals, noise: Mapping[str, float], most: int, loss: Loss | None = None
    ) -> None:  # fmt: skip
        self.residuals, self.noise, self.most, self.first = residuals, noise, most, scales(residuals.runs, noise)
        self.loss = loss
        self.best: Array | None = None
        self._show: Callable[[int, str], None] | None = None
        self._stage = ""
        self._cost, self._iterations, self._usual, self._began = np.inf, 0, 0, time.monotonic()

    def showing(self, show: Callable[[int, str], None]) -> None:
        """Shows progress from now on: `show` is called with the number of runs, and a text."""
        self._show, self.residuals.look = show, self._tell

    def __call__(self, starts: Array, keep: int, alone: bool) -> Found:
        """The best point from several starts (k, n), of which the best `keep` are fitted. `alone`: from the first only,
        if that leaves less than a tenth of each column's deviation, or white noise.

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
        return min(found, self._from(starts, keep, found), key=self._minus_log_likelihood)

    # -- progress ------------------------------------------------------------------------------------------------------

    def _seen(self, inner: Array, cost: float) -> None:
        """Stores a point if it is the best."""
        if cost < self._cost:
            self.best, self._cost = inner.copy(), cost
        self._tell()

    def filters(self) -> Callable[[], None]:
        """Shows the iterations of a filter's likelihood from now on; returns the function that each of them calls."""
        self._cost, self._iterations, self._usual, self._began = np.inf, 0, _FILTERED, time.monotonic()
        self._stage = "the filter's "

        def done() -> None:
            self._iterations += 1
            self._tell()

        return done

    def _tell(self) -> None:
        """Shows the progress of the search, and its approximate end for a usual number of iterations."""
        if self._show is None:
            return
        text = f"{self.residuals.count} runs, {self._stage}iteration {self._iterations + 1}"
        if np.isfinite(self._cost):
            text += f", rms {np.sqrt(self._cost):.4g}"
        if 0 < self._iterations < self._usual:
            whole = (time.monotonic() - self._began) / self._iterations * self._usual
            text += f"; about {seconds(whole)} in all if it takes {self._usual} iterations, which is usual"
        self._show(self.residuals.count, text)

    # -- stages --------------------------------------------------------------------------------------------------------

    def _from(self, starts: Array, keep: int, first: Found | None = None) -> Found:
        """The best point from these starts, with the first weights; then with weights from the residual noise. `first`:
        the end of the first start, if it is known."""
        self.residuals.loss = None
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
        least, most = (_COARSE_STEP, _COARSE_MOST) if len(order) > 1 else (_SETTLED_STEP, self.most)
        for i in order:
            try:
                known = first if i == 0 else None
                inner = known.inner if known else self._fitted(starts[i], self.first, least, most).inner
                ends[i] = _rms(self.residuals.weighted(inner, self.first)), inner
            except RunStopped as e:
                failed = e
        if not ends:
            assert failed is not None
            raise failed
        inner = min(ends.values(), key=lambda x: x[0])[1]
        return self.weighed(Found(inner, dict(self.first), tried=tried, fitted={k: x[0] for k, x in ends.items()}))

    def _fitted(
        self, inner: Array, sigma: Mapping[str, float], least: float = _SETTLED_STEP, most: int | None = None
    ) -> _Solved:
        """Solves least squares from one point, until the next step would move no value by more than `least` of its
        standard deviation, or derivatives were computed `most` times (None: as often as may be).

        A small weight holds each number at its start, so that undetermined combinations stay there (rounding errors
        would move them). The next least squares starts at the end of the last, until nothing changes.

        Raises:
            RunStopped: the run at the start, or one of the derivatives, failed.
        """
        from scipy.optimize import least_squares  # slow to import

        residuals, most, first = self.residuals, most or self.most, self._iterations
        low, high = np.array([x.bounds for x in residuals.sought]).T
        n = len(inner)
        hold = np.zeros((n, n))
        at, refused = _Point(inner), 0
        less = "steps bring less than derivatives promise, as dry friction makes it"

        def rows(u: Array) -> Array:
            return np.append(residuals.weighted(u, sigma), hold @ (u - inner))

        def count(u: Array) -> float:
            found = residuals.residuals(u) or []
            return 1.0 + sum(independent(y) for run in found for y in run)

        def size(u: Array) -> Array:
            nonlocal refused
            if at.told.size and at.gain(u) < least**2:
                raise _Ended(f"the next step would move no value by {least} of its standard deviation")
            r = rows(u)
            if np.isfinite(r).all():  # otherwise the step is shortened
                self._seen(u, float(np.mean(r[:-n] ** 2)))
                if at.told.size and np.linalg.norm(r) >= np.linalg.norm(at.r):
                    refused += 1
                    if at.gain(u) < _REFUSED_STEP**2 or refused == _REFUSED:
                        raise _Ended(less)
            return np.append(np.linalg.norm(r), np.zeros(n))

        def slopes(u: Array) -> Array:
            nonlocal at, refused
            refused = 0
            r, last = rows(u), at
            had = float(last.r @ last.r)
            fell = 1 - float(r @ r) / had if had else 1.0
            if had and fell > 0 and last.near(u):
                at = last.moved(u, r)
            elif self._iterations - first == most:
                raise _Ended(f"it took {most} iterations", False)
            else:
                self._iterations += 1
                at = last.next(u, count(u), r, np.vstack([residuals.jacobian(u, sigma), hold]), fell < _NEAR)
            if last.told.size and 0 < fell * at.count < _ROUGH_STEP**2 and fell * last.count < 0.5 * last.gain(u):
                raise _Ended(less)
            return at.told

        if not np.isfinite(rows(inner)).all():
            raise RunStopped(residuals.why, np.nan)
        hold = np.diag(np.maximum(_HOLD * np.linalg.norm(residuals.jacobian(inner, sigma), axis=0), _HOLD_PRIOR))
        message, converged = "", False
        while not converged and self._iterations - first < most:
            at = replace(at, old=False, due=True, told=np.empty((0, 0)))
            try:
                done = least_squares(
                    size, at.u, slopes, bounds=(low, high), x_scale="jac", max_nfev=self.most, xtol=1e-9, ftol=1e-9,
                    gtol=1e-12,
                )  # fmt: skip
                message, converged = str(done.message), done.status > 0 and not at.old
                if not done.status:
                    break
            except _Ended as e:
                message, converged = str(e), e.converged and not at.old
        if at.old:
            at = at.next(at.u, at.count, at.r, np.vstack([residuals.jacobian(at.u, sigma), hold]), True)
        end, J = at.u, at.J
        std = np.sqrt(np.diag(pseudo_inverse(J)))
        pulled = std * np.diag(hold) ** 2 * np.abs(end - inner)
        return _Solved(end, message, converged, float(np.max(pulled[std * _HOLD_PRIOR < 0.9], initial=0.0)))

    def weighed(self, found: Found) -> Found:
        """Continues from a point with weights from the residual noise, until that settles."""
        first, sigma = dict(found.sigma), self.estimated(found.inner, found.sigma)
        self.residuals.loss = self.loss
        for _ in range(_ROUNDS):
            self._cost = np.inf  # costs change with the weights
            done = self._fitted(found.inner, sigma)
            found.inner = done.inner
            found.sigma, sigma = sigma, self.estimated(found.inner, first)
            if done.pulled < _HOLD_EFFECT and all(abs(sigma[k] / found.sigma[k] - 1) < _SETTLED for k in sigma):
                break
        found.sigma, found.message, found.converged = sigma, done.message, done.converged
        return found

    def averaged(self, found: Found) -> Array:
        """Moves a point to the mean of those to which single steps lead from points about it. Returns the covariance
        (n, n) of the mean's distance from where one more leads. For runs that leap a little with every change of a
        number, as quantised loops do: the leaps of a point are chance, and those of the rig are one more of them."""
        residuals, n = self.residuals, len(found.inner)
        low, high = np.array([x.bounds for x in residuals.sought]).T
        rng, spread = np.random.default_rng(0), np.zeros((n, n))
        for _ in range(2):
            J = residuals.jacobian(found.inner, found.sigma)
            A = pseudo_inverse(J)
            std = np.sqrt(A.diagonal())
            told = np.isfinite(std)
            A = np.where(np.outer(told, told), A, 0.0)
            about = np.clip(rng.normal(size=(_ABOUT, n)), -1, 1) * np.where(told, std, 0.0)
            points = np.clip(found.inner + about, low, high)
            ends = [u - A @ (J.T @ residuals.weighted(u, found.sigma, rows))
                    for u, rows in zip(points, residuals.many(points), strict=True) if rows is not None]  # fmt: skip
            if len(ends) < _ABOUT // 2:
                break
            found.inner = np.clip(np.mean(ends, axis=0), low, high)
            spread = np.atleast_2d(np.cov(np.array(ends).T)) * (1 + 1 / len(ends))
        found.sigma = self.estimated(found.inner, found.sigma)
        return spread

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
            size = deviation(r) if self.loss else _rms(r)
            out[name] = max(size / float(np.sqrt(free)), _LEAST * first[name])
        return out

    def _explains(self, inner: Array) -> bool:
        """Whether the residuals of all columns are below a tenth of their deviation, or white noise."""
        found = self.residuals.residuals(inner)
        assert found is not None
        rows = [(r, x) for run, y in zip(self.residuals.runs, found, strict=True)
                for r, x in zip(y, run.measured, strict=True)]  # fmt: skip
        if self.loss:
            return all(deviation(r) < _LEFT * deviation(x - np.median(x)) or whiteness(r).white for r, x in rows)
        return all(_rms(r) < _LEFT * x.std() or whiteness(r).white for r, x in rows)

    def _minus_log_likelihood(self, found: Found) -> float:
        """Twice the negative log-likelihood, up to a constant."""
        r = self.residuals.weighted(found.inner, found.sigma)
        count = {name: sum(len(run.data) for run in self.residuals.runs if name in run.outputs) for name in found.sigma}
        return float(r @ r + 2 * sum(count[k] * np.log(x) for k, x in found.sigma.items() if k not in self.noise))


def _slopes_of_size(r: Array, J: Array, S: Array) -> Array:
    """Derivatives (n + 1, n) of |r| and of n zeros, for which least squares take the steps that they take for r
    (m,) with derivatives J (m, n) and the further curvature S (n, n). Where r is zero, |r| has a corner, whose least
    point it is: the slope there is 0."""
    slope = J.T @ r / (np.linalg.norm(r) or 1.0)
    R = upper(J)
    by = np.linalg.solve(R.T, np.linalg.solve(R.T, S).T)  # in units in which J^T J is 1
    bend = _at_least(_LEAST_BEND, np.eye(len(R)) + 0.5 * (by + by.T))
    first = np.linalg.solve(R.T, slope)
    size, V = np.linalg.eigh(bend - np.outer(first, first))
    return np.vstack([slope, np.sqrt(np.maximum(size, 0.0))[:, None] * (V.T @ R)])


def _at_least(least: float, A: Array) -> Array:
    """The symmetric matrix with eigenvalues that are too small replaced."""
    size, V = np.linalg.eigh(A)
    return np.asarray((V * np.maximum(size, least)) @ V.T)


def _bent(S: Array, s: Array, y: Array, rest: Array) -> Array:
    """The curvature of half the sum of squares that J^T J leaves out, after a step s in which the gradient has changed
    by y, and by `rest` for that of J (Dennis, Gay & Welsch 1981, ACM Trans. Math. Softw. 7, 348). Without it,
    steps are too long where large residuals are left."""
    if not s @ y > 0:
        return S
    had, has = abs(float(s @ S @ s)), abs(float(s @ rest))
    S = S * min(1.0, has / had) if had else S
    miss, by = rest - S @ s, float(s @ y)
    return np.asarray(S + (np.outer(miss, y) + np.outer(y, miss)) / by - (s @ miss) / by**2 * np.outer(y, y))


def _rms(r: Array) -> float:
    return float(np.sqrt(np.mean(r**2)))
