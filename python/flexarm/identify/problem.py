"""Residuals of measured runs, and their derivatives by the unknowns."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from .._check import Array
from .._threads import each
from ..arm.variation import Setup, Variation
from ..run.result import Result
from ..run.sensitivity import RunStopped
from .runs import Run
from .simulated import runs as run_many
from .simulated import sensitivities
from .unknown import Sought

_CACHED = 4  # points of the search with stored residuals and derivatives


class Problem:
    """Measured runs and the unknowns to fit.

    Attributes:
        runs: the runs. sought: the n unknowns. options: of `simulate_batch`.
        why: reason of the last failure of a simulation. refused: whether that was a bad argument.
        count: runs simulated so far. look: called about ten times a second while runs are simulated.
    """

    def __init__(self, runs: list[Run], sought: list[Sought], options: Mapping[str, Any], workers: int) -> None:
        self.runs, self.sought, self.options, self.workers = runs, sought, dict(options), workers
        self.why, self.refused, self.count = "", False, 0
        self.look: Callable[[], None] | None = None
        self._cache: OrderedDict[tuple[str, bytes], Any] = OrderedDict()
        self._stopped = False

    # -- values --------------------------------------------------------------------------------------------------------

    def values(self, inner: Array) -> Array:
        """Values of the unknowns in the scene, (n,)."""
        return np.array([x.value(float(u)) for x, u in zip(self.sought, inner, strict=True)])

    def slopes_of_values(self, inner: Array) -> Array:
        """Derivatives d value / d inner, (n,)."""
        return np.array([x.slope(float(u)) for x, u in zip(self.sought, inner, strict=True)])

    def _of_run(self, k: int) -> list[int]:
        """Indices of the unknowns that belong to a run."""
        return [j for j, x in enumerate(self.sought) if x.run in (None, k)]

    def _options(self, workers: int) -> dict[str, Any]:
        def look(_: float) -> None:
            if self._stopped:
                raise KeyboardInterrupt

        return {**self.options, "workers": workers, "progress": look}

    def _each(self, work: Callable[[int, int], None]) -> None:
        """Calls work(run, workers) for every run, in threads."""
        self._stopped = False
        share = max(1, self.workers // len(self.runs))
        look = self.look or (lambda: None)
        each(lambda k: work(k, share), len(self.runs), min(self.workers, len(self.runs)), look, self._stop)

    def _stop(self) -> None:
        self._stopped = True

    # -- of one point --------------------------------------------------------------------------------------------------

    def residuals(self, inner: Array) -> list[Array] | None:
        """Residuals, simulated less measured, (outputs, nt) of each run; None if a run failed."""
        return self._cached("residuals", inner, lambda: self._residuals(inner[None])[0])  # type: ignore[no-any-return]

    def many(self, inner: Array) -> list[list[Array] | None]:
        """Residuals of several points (m, n), simulated as batches."""
        return self._residuals(inner)

    def _cached(self, name: str, inner: Array, make: Callable[[], Any]) -> Any:
        key = (name, inner.tobytes())
        if key not in self._cache:
            self._cache[key] = make()
            if len(self._cache) > 2 * _CACHED:
                self._cache.popitem(last=False)
        return self._cache[key]

    def clear(self) -> None:
        """Clears the stored points, since options have changed."""
        self._cache.clear()

    def _residuals(self, inner: Array) -> list[list[Array] | None]:
        values = np.array([self.values(u) for u in inner])
        found: list[list[Any]] = [[None] * len(inner) for _ in self.runs]

        def one(k: int, workers: int) -> None:
            run, own = self.runs[k], self._of_run(k)
            parameters = {self.sought[j].path: values[:, j] for j in own}
            try:
                results = run_many(run.setup, parameters, run.t, run.first, run.v0, **self._options(workers))
            except ValueError as e:
                self.why, self.refused = str(e), True
                return
            for i, (setup, _, _, result) in enumerate(results):
                if isinstance(result, RunStopped):
                    self.why, self.refused = str(result), False
                    continue
                y = run.read(result, setup) - run.measured
                found[k][i] = y if np.isfinite(y).all() else None

        self._each(one)
        self.count += len(inner) * len(self.runs)
        points = [[run[i] for run in found] for i in range(len(inner))]
        return [None if any(x is None for x in point) else point for point in points]

    def derivatives(self, inner: Array) -> list[Array]:
        """Derivatives of the outputs by the inner values, (n, outputs, nt) of each run.

        Raises:
            RunStopped: a run failed.
        """
        return self._cached("derivatives", inner, lambda: self._derivatives(inner))  # type: ignore[no-any-return]

    def _derivatives(self, inner: Array) -> list[Array]:
        values, slopes = self.values(inner), self.slopes_of_values(inner)
        found: list[Any] = [None] * len(self.runs)

        def one(k: int, workers: int) -> None:
            run, own = self.runs[k], self._of_run(k)
            parameters = {self.sought[j].path: float(values[j]) for j in own}
            made = sensitivities(run.setup, parameters, run.t, run.first, run.v0, **self._options(workers))
            out = np.zeros((len(inner), *run.measured.shape))
            out[own] = made.of(run.read) * slopes[own, None, None]
            found[k] = out

        self._each(one)
        self.count += len(self.runs)
        return found

    # -- weighted ------------------------------------------------------------------------------------------------------

    def weighted(self, inner: Array, sigma: Mapping[str, float]) -> Array:
        """Residuals over their standard deviations, with those of priors at the end, (m,); nan if a run failed."""
        found = self.residuals(inner)
        if found is None:
            return np.full(sum(run.measured.size for run in self.runs) + len(self._priors(inner)[0]), np.nan)
        rows = [(y / self._sigmas(run, sigma)).ravel() for run, y in zip(self.runs, found, strict=True)]
        return np.concatenate([*rows, self._priors(inner)[0]])

    def jacobian(self, inner: Array, sigma: Mapping[str, float]) -> Array:
        """Derivatives of `weighted`, (m, n)."""
        found = self.derivatives(inner)
        rows = [(y / self._sigmas(run, sigma)).reshape(len(inner), -1) for run, y in zip(self.runs, found, strict=True)]
        return np.vstack([np.hstack(rows).T, self._priors(inner)[1]])

    @staticmethod
    def _sigmas(run: Run, sigma: Mapping[str, float]) -> Array:
        return np.array([sigma[name] for name in run.outputs])[:, None]

    def _priors(self, inner: Array) -> tuple[Array, Array]:
        """Residuals of the priors, (k,), and their derivatives, (k, n)."""
        values, slopes = self.values(inner), self.slopes_of_values(inner)
        rows, slope_rows = [], []
        for j, x in enumerate(self.sought):
            if x.of.mean is not None and x.of.std is not None:
                rows.append((values[j] - x.of.mean) / x.of.std)
                slope_rows.append(np.eye(len(inner))[j] * slopes[j] / x.of.std)
        return np.array(rows), np.array(slope_rows).reshape(-1, len(inner))

    # -- at the end ----------------------------------------------------------------------------------------------------

    def finished(self, inner: Array, k: int) -> tuple[Setup, Array, Array, Result | RunStopped]:
        """The setup of run k with these values, its initial state, and the run."""
        self._stopped = False
        run, values = self.runs[k], self.values(inner)
        parameters = {self.sought[j].path: values[j : j + 1] for j in self._of_run(k)}
        return run_many(run.setup, parameters, run.t, run.first, run.v0, **self._options(self.workers))[0]

    def setup(self, inner: Array, sensors: Any, k: int = 0) -> Setup:
        """The setup of run k with these values, with the sensors as given."""
        run, values = self.runs[k], self.values(inner)
        own = {self.sought[j].path: values[j : j + 1] for j in self._of_run(k)}
        base = run.setup
        return Variation(Setup(base.arm, base.drive, base.loads, base.control, sensors), own).scenario(0)
