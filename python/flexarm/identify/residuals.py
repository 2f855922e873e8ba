"""Residuals of measured runs, and their derivatives by the unknowns: exact, or differences where a run has none."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from .._check import Array
from .._threads import each
from ..arm.variation import Setup, Variation
from ..many.batch.simulate import simulate_batch
from ..run.perturbed import SECOND
from ..run.result import Result
from ..run.sensitivity import ROWS, RunStopped
from ..run.simulation import source
from ..run.start import state
from .loss import Loss
from .runs import Run
from .unknown import Sought

_CACHED = 4  # points of the search with stored residuals and derivatives
# differences of runs: a number is moved until the outputs move by a part of their deviation, that is more than the
# leaps of a quantised loop, and little enough for a slope; in its scale, or of its logarithm
_MOVED = 0.01
_FIRST_MOVE, _LEAST_MOVE, _MOST_MOVE = 1e-3, 1e-5, 0.1
_FAR = 3.0  # a move that misses its aim by this factor is made again


def scenarios(run: Run, parameters: Mapping[str, Array]) -> list[tuple[Setup, Array, Array]]:
    """Setups and initial states of a run with values (B,) of parameters, by their paths."""
    variation = Variation(run.setup, parameters)
    setups = [variation.scenario(i) for i in range(max((len(x) for x in parameters.values()), default=1))]
    states = [state(s.arm, run.first, run.v0, s.drive, s.loads, float(run.t[0]), s.control) for s in setups]
    q, v = (np.array(x) for x in zip(*states, strict=True))
    return list(zip(setups, variation.initial("q0", q), variation.initial("v0", v), strict=True))


def smooth(setup: Setup) -> Setup:
    """The setup with controllers whose sensors read without steps."""
    return replace(setup, control=tuple(c._smooth() for c in setup.control))


class Residuals:
    """Simulated less measured outputs of all runs, as functions of the unknowns' inner values.

    Attributes:
        runs: the runs. sought: the n unknowns. options: of `simulate_batch`.
        why: reason of the last failure of a simulation. refused: whether that was a bad argument.
        count: runs simulated so far. look: called about ten times a second while runs are simulated.
        rough: why a run has no exact derivatives; "" if it has. way: which are taken, "exact", "smoothed" (of the loop
            whose sensors read without steps), or "differences" (of runs).
        loss: of residuals over their standard deviations; None: their squares.
    """

    loss: Loss | None = None

    def __init__(self, runs: list[Run], sought: list[Sought], options: Mapping[str, Any], workers: int) -> None:
        self.runs, self.sought, self.options, self.workers = runs, sought, dict(options), workers
        self.why, self.refused, self.count = "", False, 0
        self.look: Callable[[], None] | None = None
        self._cache: OrderedDict[tuple[str, bytes], Any] = OrderedDict()
        self._stopped = False
        self.rough, self.way = "", "exact"
        self._moves = np.full(len(sought), _FIRST_MOVE)

    # -- values --------------------------------------------------------------------------------------------------------

    def values(self, inner: Array) -> Array:
        """Values of the unknowns in the scene, (n,)."""
        return np.array([x.value(float(u)) for x, u in zip(self.sought, inner, strict=True)])

    def slopes_of_values(self, inner: Array) -> Array:
        """Derivatives d value / d inner, (n,)."""
        return np.array([x.slope(float(u)) for x, u in zip(self.sought, inner, strict=True)])

    def parameters(self, k: int, points: Array) -> dict[str, Array]:
        """By path, the values of the unknowns of run k at points (m, n), (m,) each."""
        values = np.array([self.values(u) for u in points])
        return {x.path: values[:, j] for j, x in enumerate(self.sought) if x.run in (None, k)}

    # -- runs ----------------------------------------------------------------------------------------------------------

    def _look(self, _: float) -> None:
        if self._stopped:
            raise KeyboardInterrupt

    def _simulated(self, k: int, points: Array, workers: int) -> list[tuple[Setup, Array, Array, Result | RunStopped]]:
        """Setup, initial state and simulation of run k at each of the points (m, n)."""
        run, parameters = self.runs[k], self.parameters(k, points)
        made, of = scenarios(run, parameters), run.setup
        _, q, v = zip(*made, strict=True)
        moving = {path: x for path, x in parameters.items() if not path.startswith("sensor.")}
        start = "held" if run.balance == "held" else np.array(q)  # or without the memory that holds it
        batch = simulate_batch(
            of.arm, run.t, start, np.array(v), parameters=moving, drive=of.drive, loads=of.loads,
            control=of.control, outputs=ROWS, workers=workers, progress=self._look, **self.options,
        )  # fmt: skip
        failed = {f.index: RunStopped(f.reason, f.time) for f in batch.failures}
        return [(*x, failed.get(i) or batch[i]) for i, x in enumerate(made)]

    def _each(self, work: Callable[[int, int], None]) -> None:
        """Calls work(run, workers) for every run, in threads."""
        self._stopped = False
        share = max(1, self.workers // len(self.runs))
        look = self.look or (lambda: None)
        each(lambda k: work(k, share), len(self.runs), min(self.workers, len(self.runs)), look, self._stop)

    def _stop(self) -> None:
        self._stopped = True

    def finished(self, inner: Array, k: int) -> tuple[Setup, Array, Array, Result | RunStopped]:
        """The setup of run k with these values, its initial state, and the run."""
        self._stopped = False
        return self._simulated(k, inner[None], self.workers)[0]

    def setup(self, inner: Array, sensors: Any) -> Setup:
        """The setup of the first run with these values, with the sensors as given."""
        own = replace(self.runs[0].setup, sensors=sensors)
        return Variation(own, self.parameters(0, inner[None])).scenario(0)

    # -- residuals -----------------------------------------------------------------------------------------------------

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

    def residuals(self, inner: Array) -> list[Array] | None:
        """Residuals, (outputs, nt) of each run; None if a run failed."""
        return self._cached("residuals", inner, lambda: self.many(inner[None])[0])  # type: ignore[no-any-return]

    def many(self, points: Array) -> list[list[Array] | None]:
        """Residuals at several points (m, n), simulated as batches."""
        found: list[list[Any]] = [[None] * len(points) for _ in self.runs]

        def one(k: int, workers: int) -> None:
            try:
                found[k] = self._outputs(k, points, workers)
            except ValueError as e:
                self.why, self.refused = str(e), True
                return
            found[k] = [None if y is None else y - self.runs[k].measured for y in found[k]]

        self._each(one)
        of_point = [[run[i] for run in found] for i in range(len(points))]
        return [None if any(x is None for x in runs) else runs for runs in of_point]

    def _outputs(self, k: int, points: Array, workers: int) -> list[Array | None]:
        """Outputs (outputs, nt) of run k at points (m, n); None where it failed."""
        found: list[Array | None] = []
        for setup, _, _, result in self._simulated(k, points, workers):
            if isinstance(result, RunStopped):
                self.why, self.refused = str(result), False
                found.append(None)
                continue
            y = self.runs[k].read(result, setup)
            found.append(y if np.isfinite(y).all() else None)
        self.count += len(points)
        return found

    def derivatives(self, inner: Array) -> list[Array]:
        """Derivatives of the outputs by the inner values, (n, outputs, nt) of each run.

        Raises:
            RunStopped: a run failed.
        """
        return self._cached("derivatives", inner, lambda: self._derivatives(inner))  # type: ignore[no-any-return]

    def _derivatives(self, inner: Array) -> list[Array]:
        ways = {"exact": self._exact, "smoothed": self._smoothed, "differences": self._differences}
        for way in list(ways)[list(ways).index(self.way) :]:
            try:
                found = ways[way](inner)
            except RunStopped:
                raise
            except ValueError as e:
                if way == "differences":
                    raise
                self.rough = str(e).partition(": give")[0]
                if way == "exact":
                    self._check_repeats(inner)
            else:
                self.way = way
                return found
        raise AssertionError

    def _check_repeats(self, inner: Array) -> None:
        """ValueError where two runs of the same are not the same."""
        self._stopped = False
        for k in range(len(self.runs)):
            one, two = self._outputs(k, np.array([inner, inner]), 1)
            if one is not None and two is not None and not np.array_equal(one, two):
                raise ValueError(
                    "control: two runs of the same scene differ: a law in Python remembers, and one run's memory is "
                    "the next one's; give a LinearController, or a law of t and y alone"
                )

    def _differences(self, inner: Array) -> list[Array]:
        low, high = np.array([x.bounds for x in self.sought]).T
        found = [np.zeros((len(inner), *run.measured.shape)) for run in self.runs]
        moved = np.zeros(len(inner))

        def one(k: int, workers: int) -> None:
            run = self.runs[k]
            own = [j for j, x in enumerate(self.sought) if x.run in (None, k)]
            ends = np.repeat(inner[None], 2 * len(own), axis=0)
            for i, j in enumerate(own):
                ends[2 * i : 2 * i + 2, j] = np.clip(inner[j] + self._moves[j] * np.array([-1, 1]), low[j], high[j])
            outputs = self._outputs(k, ends, workers)
            here = self._outputs(k, inner[None], 1)[0] if any(y is None for y in outputs) else None
            for i, j in enumerate(own):
                places = ends[2 * i : 2 * i + 2, j].copy()
                pair = outputs[2 * i : 2 * i + 2]
                for side in (0, 1):  # a neighbour that fails is replaced by the point itself
                    if pair[side] is None:
                        pair[side], places[side] = here, inner[j]
                first, last = pair
                if first is None or last is None or places[0] == places[1]:
                    raise RunStopped(self.why or f"no room to move {self.sought[j].name}", np.nan)
                found[k][j] = (last - first) / (places[1] - places[0])
                part = np.abs(found[k][j]).std(axis=1) / np.maximum(run.measured.std(axis=1), 1e-300)
                moved[j] = max(moved[j], float(part.max()))

        for _ in range(2):
            moved[:] = 0.0
            self._each(one)
            with np.errstate(divide="ignore"):
                moves = np.clip(_MOVED / moved, _LEAST_MOVE, _MOST_MOVE)
            far = np.abs(np.log(moves / self._moves)).max() > np.log(_FAR)
            self._moves = moves
            if not far:
                break
        return found

    def _smoothed(self, inner: Array) -> list[Array]:
        return self._exact(inner, smooth)

    def _exact(self, inner: Array, made_of: Callable[[Setup], Setup] = lambda setup: setup) -> list[Array]:
        slopes, found = self.slopes_of_values(inner), [np.empty(0)] * len(self.runs)

        def one(k: int, workers: int) -> None:
            run, parameters = self.runs[k], self.parameters(k, inner[None])
            setup, q, v = scenarios(run, parameters)[0]
            setup = made_of(setup)
            of = made_of(run.setup), {path: x for path, x in parameters.items() if not path.startswith(("q0", "v0"))}
            first = run.first if isinstance(run.first, str) else q
            made = replace(source(setup, run.t, first, v, **self.options, alive=self._look, of=of), by=SECOND)
            own = [j for j, x in enumerate(self.sought) if x.run in (None, k)]
            found[k] = np.zeros((len(inner), *run.measured.shape))
            found[k][own] = run.slopes(made.sensitivities(list(parameters), workers), setup) * slopes[own, None, None]

        self._each(one)
        self.count += len(self.runs)
        return found

    # -- weighted ------------------------------------------------------------------------------------------------------

    def weighted(self, inner: Array, sigma: Mapping[str, float], found: list[Array] | None = None) -> Array:
        """Residuals over their standard deviations, with those of priors at the end, (m,); nan if a run failed. With a
        loss, the numbers whose squares are the losses.

        Args:
            found: the residuals there, if they are known.
        """
        found = self.residuals(inner) if found is None else found
        priors = self.priors(inner)[0]
        if found is None:
            return np.full(sum(run.measured.size for run in self.runs) + len(priors), np.nan)
        rows = [(y / _sigmas(run, sigma)).ravel() for run, y in zip(self.runs, found, strict=True)]
        if self.loss:
            rows = list(map(self.loss.rooted, rows))
        return np.concatenate([*rows, priors])

    def jacobian(self, inner: Array, sigma: Mapping[str, float]) -> Array:
        """Derivatives of `weighted`, (m, n)."""
        found = self.derivatives(inner)
        rows = [(y / _sigmas(run, sigma)).reshape(len(inner), -1) for run, y in zip(self.runs, found, strict=True)]
        if self.loss:
            at = self.residuals(inner)
            assert at is not None
            rows = [x * self.loss.slope((y / _sigmas(run, sigma)).ravel())
                    for x, run, y in zip(rows, self.runs, at, strict=True)]  # fmt: skip
        return np.vstack([np.hstack(rows).T, self.priors(inner)[1]])

    def priors(self, inner: Array) -> tuple[Array, Array]:
        """Residuals of the priors, (k,), and their derivatives, (k, n)."""
        values, slopes = self.values(inner), self.slopes_of_values(inner)
        known = [(j, x.of.mean, x.of.std) for j, x in enumerate(self.sought) if x.of.mean is not None and x.of.std]
        rows = [np.eye(len(inner))[j] * slopes[j] / std for j, _, std in known]
        return np.array([(values[j] - mean) / std for j, mean, std in known]), np.array(rows).reshape(-1, len(inner))


def _sigmas(run: Run, sigma: Mapping[str, float]) -> Array:
    return np.array([sigma[name] for name in run.outputs])[:, None]
