"""Unknown numbers of a scene from measured runs, by least squares."""

from __future__ import annotations

import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from .._check import Array, at_least, choice, instance, known_keys, number, positive, warn, whole
from .._console import progress_bar
from ..analysis.findings import RunWarning
from ..data.compare import Comparison
from ..data.data import Data
from ..many.batch.arguments import default_workers
from ..model.acting.drive import Motion, split_drives
from ..run.integrators import OPTIONS, integrator_of
from ..run.scene.scene import Scene
from ..run.sensing.sensor import Sensor
from ..run.sensitivity import RunStopped
from .filtered import Likelihood, filtered, predicted
from .fit import Fit, FitError, FitInterrupted, FitWarning
from .loss import LOSSES, deviation
from .residuals import Residuals, scenarios, smooth
from .runs import Run, measured_run
from .search import Found, Search
from .statistics import coloured, covariance, loose, untold, whiteness
from .unknown import Parameters, Sought, drawn, sought

METHODS = ("simulation", "filter")
_STARTS = 8  # if one is not enough
_POOR = 0.5  # NRMSE of a poor fit


def identify(
    scene: Scene | Sequence[Scene],
    data: Data | Sequence[Data],
    parameters: Parameters,
    *,
    inputs: Any = None,
    outputs: Any = None,
    noise: Mapping[str, float] | None = None,
    loss: str = "linear",
    method: str = "simulation",
    starts: int | None = None,
    keep: int = 3,
    seed: int = 0,
    integrator: str | None = None,
    step: float | None = None,
    max_iterations: int = 100,
    workers: int | None = None,
    progress: Any = False,
) -> Fit:
    """Fits unknown numbers of a scene to measured runs, by least squares of the outputs.

    Derivatives are exact. Of a loop whose controller reads sensors in steps they are those of the same loop without
    steps, and where a run has none at all (by the rate or delay of a controller) differences of runs; the report says
    so. Such runs leap a little with every change of a number; the values are then means over 16 places about the end,
    and the leaps widen the intervals.

    Args:
        scene: the model: its arm, drives, loads, controllers, sensors, initial state, integrator. Or one for each run,
            which may differ in all known numbers, such as payloads; the unknowns are the same in all of them.
        data: a measured run, or several. Times are those of the scene.
        parameters: the unknown numbers, by path as in `simulate_batch`, with the start of the search: a number, None
            (the scene's value) or an `Unknown`, which has bounds and prior knowledge. A list of paths starts at the
            scene's values. Beside those of `simulate_batch`: "drive.1.scale",
            "drive.1.offset", "drive.1.delay", "sensor.0.gain", "sensor.0.offset", "sensor.0.delay",
            "sensor.0.filter.frequency", "q0.1", "v0.1", "gravity.2".
        inputs: measured signals that drive the arm, by key of a drive: a column of forces or voltages, straight between
            the samples; (fa.Motion, column) of a joint that moves as measured; a function of the data that gives a
            Motion, Torque or Voltage. Or commands as they were given, with the drive in the model:
            "control.0.reference" of a controller, whose reference is then a column, (fa.Motion, column), which has a
            rate too, a function of the data, or a list of these where it has several. For several runs a list of such
            tables, or one for all. None: the scene's drives and references.
        outputs: the measured quantity of each column of the data: a sensor, "sensor.0" of the scene ("sensor.0.1": its
            second component), the name of a column of `result.to_data()`, or a function of a Result that returns (nt,).
            None: all names in both. Sensors are read without noise and quantisation, at the times of the data.
        noise: standard deviation of columns, in SI. For others it is estimated from the residuals, until it settles.
        loss: of residuals over their noise, as SciPy's `least_squares` names it: "linear", their squares; "soft_l1",
            "huber" or "cauchy", for data with outliers, which then count less. The noise is that of the other readings.
        method: "simulation": a run is computed from its start to its end, and all that it misses is noise of readings;
            or "filter": from there on, the likelihood of a `KalmanFilter` that reads the data, whose forces are noisy,
            too: it also finds their noise, "force_noise.JOINT" (N m/sqrt(Hz); N/sqrt(Hz)), that of readings, and, on
            joints that nothing drives, the drift of an unknown torque, "force_drift.JOINT" (N m/sqrt(s); N/sqrt(s)).
            For measured torques that are not exact, disturbances, and joints of which the motion alone was measured.
            Outputs are sensors that the filter takes, and controllers do not sample.
        starts: number of starts; all but the first are drawn within the bounds, or within a factor of 3 of the first.
            They are simulated as one batch, and the best `keep` of them are fitted. None: one, or 8 if one fails or
            leaves more than a tenth of a column's deviation that is no white noise. seed: of the draw.
        integrator, step: of `simulate`; None: the scene's, and "implicit" in place of "ida". If neither gives a step,
            it is the time between two rows of the data, halved until it no longer affects the values.
        max_iterations: of each least squares.
        workers: threads; None: one for each core.
        progress: shows progress on stderr: a bar, or lines if that is no terminal; or a callable, called with the
            number of runs simulated so far, which may raise to stop.

    Returns:
        Fit: `.values`, `.intervals`, `.correlation`, `.scene`, `.report()`, `.plot()`, `.validate(data)`.

    Raises:
        ValueError: bad arguments: columns that are missing or constant, units that do not fit, unknown paths, a start
            outside its bounds, fewer readings than numbers.
        FitError: the runs at all starts failed.
        FitInterrupted: (a KeyboardInterrupt) Ctrl-C; its `fit` is the best so far.

    Warns:
        FitWarning: numbers, or combinations of them, that the data do not determine; poorly fitted columns; steps that
            are too long.
        RangeWarning, LoopWarning, StepWarning, SlowWarning: of the fitted runs, as `simulate_batch`.
        (DataWarning: gaps in the data.)
    """
    began = time.perf_counter()
    task = _task(scene, data, parameters, inputs, outputs, noise, integrator, step, workers)
    robust = LOSSES.get(choice("loss", loss, ("linear", *LOSSES)))
    choice("method", method, METHODS)
    if robust and method == "filter":
        raise ValueError(f"loss = {loss!r}: is of residuals, which method = 'filter' does not have; leave one out")
    at_least("starts", 1 if starts is None else starts, 1)
    at_least("keep", keep, 1)
    at_least("max_iterations", max_iterations, 1)
    of = task.residuals
    search = Search(of, task.noise, max_iterations, robust)
    count = sum(run.measured.size for run in of.runs) + len(of.priors(np.zeros(len(of.sought)))[0])
    if count < len(of.sought):
        raise ValueError(f"parameters: {len(of.sought)} numbers are sought, and there are {count} readings")
    points = drawn(of.sought, starts or _STARTS, whole("seed", seed))
    with progress_bar(progress, "identifying", None) as bar, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # warnings of intermediate runs
        if bar is not None:
            search.showing(bar if not callable(progress) else lambda done, _: progress(done))
        try:
            found = search(points, keep, alone=starts is None)
            missed = task.refined(found, search)
            leaps = search.averaged(found) if of.rough else None
        except RunStopped as e:
            if of.refused:
                raise ValueError(of.why.removeprefix("parameters of scenario 0: ")) from None
            values = {x.name: float(x.of.start or 0.0) for x in of.sought}
            said = ", ".join(f"{k} = {x:g}" for k, x in values.items())
            which = "the start" if len(points) == 1 else f"all {len(points)} starts"
            raise FitError(f"the run fails at {which} ({said}): {e}", values) from None
        except KeyboardInterrupt:
            fit, best = None, search.best
            if best is not None:
                fit = task.fit(Found(best, search.estimated(best, search.first), "interrupted"), points[:1], began)
            raise FitInterrupted(f"interrupted after {of.count} runs; .fit is the best so far", fit) from None
        with warnings.catch_warnings(record=True) as heard:
            warnings.simplefilter("always")
            fit = task.fit(found, points[: len(found.tried) or 1], began, leaps)
            try:
                fit = task.filtered(fit, found, search, began) if method == "filter" else fit
            except KeyboardInterrupt:
                raise FitInterrupted("interrupted in the filter; .fit is that by simulation", fit) from None
        hints = task.sign_hints(points[0])
    poor = [
        f"column '{name}': the residual is {100 * x:.3g} % of the measured deviation: the model does not explain it, "
        + (hints.get(name) or "or this is a local minimum; try more starts")
        for name, x in (_without_outliers(fit) if robust else fit.nrmse).items()
        if x > _POOR
    ]
    own = [w for w in heard if issubclass(w.category, RunWarning)]
    for message in {str(w.message): w.message for w in own}.values():
        warn(message)  # of the fitted runs
    for text in [*poor, *(f"the data cannot tell: {x}" for x in fit.untold), *missed]:
        warn(text, FitWarning)
    return fit


_FIXED_STEP = "implicit"  # replaces integrators with variable steps
_HALVINGS = 4  # most halvings of a step that was not given
_MOVED = 0.1  # standard deviations: tolerated effect of the step on a value
_ROWS = 4  # most rows between two of the data, for filters and delays
_AGAINST = -0.5  # correlation of data and output at the start: below it the sign may be wrong


@dataclass
class Task:
    """A checked request for a fit, and the report of its end."""

    scene: Scene
    residuals: Residuals
    noise: dict[str, float]
    inputs: Any
    outputs: Any
    auto: bool  #: whether the step is automatic

    def sign_hints(self, inner: Array) -> dict[str, str]:
        """Hints, by name, for columns with the opposite sign of the output at a point."""
        found, hints = self.residuals.residuals(inner), {}
        for run, y in zip(self.residuals.runs, found or [], strict=False):
            for name, r in zip(run.outputs, y, strict=True):
                with np.errstate(invalid="ignore"):
                    agreed = np.corrcoef(r + run.data[name], run.data[name])[0, 1]
                if agreed < _AGAINST:
                    hints[name] = f"and at the start it goes the other way (correlation {agreed:.2f}): look at its sign"
        return hints

    def refined(self, found: Found, search: Search) -> list[str]:
        """Shortens the step until its effect is negligible. Returns messages about the last step."""
        p = self.residuals
        if p.options.get("step") is None:
            return []
        left = _HALVINGS if self.auto else 0
        while True:
            moved, name = self._step_effect(found)
            if moved < _MOVED:
                return []
            if not left:
                break
            times = min(left, int(np.ceil(np.log(moved / _MOVED) / np.log(4))))  # the error is of order step squared
            left -= times
            p.options["step"] /= 2**times
            p.clear()
            _finer(p)
            search.weighed(found)
        if moved < 1:
            return []
        return [
            f"step = {p.options['step']:g} s: the error of the integrator moves {name} by {moved:.3g} of its standard "
            "deviations; take a shorter one"
        ]

    def _step_effect(self, found: Found) -> tuple[float, str]:
        """The largest change of a value by half the step, in standard deviations, and the name of that value."""
        p = self.residuals
        J = p.jacobian(found.inner, found.sigma)
        here = p
        if p.way == "smoothed":  # leaps are no error of the integrator
            here = Residuals([replace(run, setup=smooth(run.setup)) for run in p.runs], p.sought, p.options, p.workers)
        halved = Residuals(here.runs, p.sought, {**p.options, "step": p.options["step"] / 2}, p.workers)
        here.loss = halved.loss = p.loss
        r, finer = (x.weighted(found.inner, found.sigma) for x in (here, halved))
        p.count += halved.count
        if not np.isfinite(finer).all():
            return 0.0, ""
        size = np.linalg.norm(J, axis=0)
        by = np.where(size > 0, size, 1.0)
        shift = np.linalg.lstsq(J / by, finer - r, rcond=1e-6)[0] / by
        std = np.sqrt(np.diag(covariance(J, [])))
        moved = np.where(np.isfinite(std), np.abs(shift) / np.where(std > 0, std, 1.0), 0.0)
        k = int(np.argmax(moved))
        return float(moved[k]), p.sought[k].name

    # -- the end -------------------------------------------------------------------------------------------------------

    def fit(self, found: Found, points: Array, began: float, leaps: Array | None = None) -> Fit:
        """The fit with the uncertainty of its values, to which leaps of runs add a covariance."""
        from scipy.stats import t as student  # slow to import

        p, inner = self.residuals, found.inner
        loss, p.loss = p.loss, None  # the derivatives are those of the residuals
        residuals, done = p.residuals(inner), [p.finished(inner, k) for k in range(len(p.runs))]
        assert residuals is not None
        derived = True
        try:
            J = p.jacobian(inner, found.sigma)
        except (RunStopped, KeyboardInterrupt):
            derived = False
            J = np.zeros((sum(y.size for y in residuals), len(inner)))
        tests: list[dict[str, Any]] = []
        blocks: list[tuple[slice, Array | None]] = []
        row = 0
        for run, y in zip(p.runs, residuals, strict=True):
            tests.append({})
            for name, r in zip(run.outputs, y, strict=True):
                rows = slice(row, row + len(r))
                row += len(r)
                told = r if loss is None else loss.pull(r / found.sigma[name])
                test = tests[-1][name] = whiteness(told)
                rho = None if test.white else coloured(told)
                if loss is not None:  # of an M-estimator: Huber 1981, 6.5
                    bend, square = loss.spread(r / found.sigma[name])
                    J[rows] *= np.sqrt(bend)
                    rho = (np.eye(1, len(r))[0] if rho is None else rho) * square / bend
                blocks.append((rows, rho))
        C = covariance(J, blocks) + (0.0 if leaps is None else leaps)
        std = np.sqrt(np.diag(C))
        free = max(1, row - len(inner))
        reach = float(student.ppf(0.975, free)) if len(self.noise) < len(found.sigma) else 1.959964
        values, slopes = p.values(inner), p.slopes_of_values(inner)
        sizes = np.array([1.0 if x.log else max(1.0, abs(u)) for x, u in zip(p.sought, inner, strict=True)])
        names = [x.name for x in p.sought]
        with np.errstate(divide="ignore"):
            parts = np.minimum(10.0, np.where([x.log for x in p.sought], 1.0, sizes / np.abs(inner)))
        with np.errstate(invalid="ignore"):
            correlation = C / np.outer(std, std)
        correlation[~np.isfinite(correlation)] = np.nan
        tried = found.tried or [np.inf] * len(points)
        runs: list[Comparison] = []
        for run, (setup, _, _, result) in zip(p.runs, done, strict=True):
            assert not isinstance(result, RunStopped)
            runs.append(run.compared(result, setup))
        again = replace(self, residuals=Residuals([], p.sought, p.options, p.workers))  # without stored points
        return Fit(
            scene=self._scene(inner, *done[0][1:3]),
            values=dict(zip(names, values.tolist(), strict=True)),
            intervals={x.name: _interval(x, float(u), reach * float(s))
                       for x, u, s in zip(p.sought, inner, std, strict=True)},
            std=dict(zip(names, (std * np.abs(slopes)).tolist(), strict=True)),
            correlation=correlation,
            start={x.name: float(x.of.start or 0.0) for x in p.sought},
            noise=dict(found.sigma),
            noise_told=frozenset(self.noise),
            comparisons=runs,
            whiteness=tests,
            untold=untold(J, sizes, names, parts) if derived else [],
            loose=loose(J, p.weighted(inner, found.sigma), slopes, names, correlation),
            method="simulation",
            loss="linear" if loss is None else loss.name,
            at_bounds=[x.name for x, v in zip(p.sought, values, strict=True) if _at_bound(x, float(v))],
            converged=found.converged,
            message=found.message,
            derivatives=(p.way, p.rough),
            starts=[(tried[k], found.fitted.get(k)) for k in range(len(points))],
            stats={"runs": p.count, "step": p.options.get("step"), "wall_time": time.perf_counter() - began},
            _comparison_with=partial(again._validated, inner),
        )  # fmt: skip

    def filtered(self, fit: Fit, found: Found, search: Search, began: float) -> Fit:
        """The fit continued by the likelihood of a filter."""
        p, n = self.residuals, len(found.inner)
        of = Likelihood(p, found.inner, found.sigma, self.noise)
        try:
            converged, message = of.search(search.most, search.filters())
            J = of.rows(of.point)[1]
        except RunStopped as e:
            raise FitError(f"the filter fails: {e}", fit.values) from None
        runs = [of.compared(k) for k in range(len(p.runs))]
        tests: list[dict[str, Any]] = []
        blocks: list[tuple[slice, Array | None]] = []
        row = 0
        for k, run in enumerate(p.runs):
            tests.append({})
            innovations, deviations = of.filtered(of.point, k)
            for name, r in zip(run.outputs, (innovations / deviations).T, strict=True):
                test = tests[-1][name] = whiteness(r)
                blocks.append((slice(row, row + len(r)), None if test.white else coloured(r)))
                row += len(r)
        C = covariance(J, blocks)
        std, values = np.sqrt(np.diag(C)), of.values(of.point)
        slopes = [x.slope(float(u)) for x, u in zip(of.sought, of.point, strict=True)]
        names = [x.name for x in of.sought]
        with np.errstate(invalid="ignore"):
            correlation = C / np.outer(std, std)
        each = dict(zip(names, values.tolist(), strict=True))
        scene = self._scene(of.point[:n], *scenarios(p.runs[0], p.parameters(0, of.point[None, :n]))[0][1:])
        return replace(
            fit, scene=scene, values=each,
            intervals={x.name: _interval(x, float(u), 1.959964 * float(s))
                       for x, u, s in zip(of.sought, of.point, std, strict=True)},
            std=dict(zip(names, (std * np.abs(slopes)).tolist(), strict=True)), correlation=correlation,
            start={x.name: float(x.of.start or 0.0) for x in of.sought},
            noise={k: each.get(f"noise.{k}", x) for k, x in found.sigma.items()}, comparisons=runs, whiteness=tests,
            untold=[], loose=[], converged=converged, message=message, method="filter",
            at_bounds=[x.name for x, v in zip(of.sought, values, strict=True) if _at_bound(x, float(v))],
            derivatives=("differences", "The likelihood of a filter has no exact derivatives"),
            stats={**fit.stats, "runs": p.count, "wall_time": time.perf_counter() - began},
            _comparison_with=partial(self._predicted, each),
        )  # fmt: skip

    def _predicted(self, values: Mapping[str, float], data: Any, inputs: Any) -> Comparison:
        """Another run, each reading predicted from those before."""
        own = [x.path for x in self.residuals.sought if _own(x)]
        if own:
            raise ValueError(f"validate: the run's own '{own[0]}' is not known; fit it to this run")
        run = self._other(data, inputs)
        fixed = {x.path: np.array([values[x.name]]) for x in self.residuals.sought}
        setup, q, v = scenarios(run, fixed)[0]
        return predicted(run, filtered(run, setup, q, v, values, self.noise, self.residuals.options.get("step"))[0])

    def _other(self, data: Any, inputs: Any) -> Run:
        """A run that was not used in the fit."""
        if inputs is None:
            inputs = self.inputs[0] if isinstance(self.inputs, (list, tuple)) else self.inputs
        paths = [x.path for x in self.residuals.sought]
        return measured_run(self.scene, data, inputs, self.outputs, "data", paths)

    def _scene(self, inner: Array, q0: Array, v0: Array) -> Scene:
        """The scene with the fitted values of its first run."""
        p, run = self.residuals, self.residuals.runs[0]
        # the scene's sensors, followed by those that only outputs name
        setup = p.setup(inner, (*self.scene.sensors, *run.setup.sensors[len(self.scene.sensors) :]))
        given = any(x.path.startswith(("q0", "v0")) for x in p.sought)
        state = {"q0": q0, "v0": v0} if given else {}
        options = {k: v for k, v in p.options.items() if v is not None}
        times = {"t": np.array(run.data.t)} if self.inputs else {}
        return replace(
            self.scene, arm=setup.arm, drive=dict(setup.drive), loads=setup.loads, control=setup.control,
            sensors=setup.sensors, options=options, **state, **times,  # type: ignore[arg-type]
        )  # fmt: skip

    def _validated(self, inner: Array, data: Any, inputs: Any) -> Comparison:
        p, run = self.residuals, self._other(data, inputs)
        fixed = {x.path: np.array([v]) for x, v in zip(p.sought, p.values(inner), strict=True) if not _own(x)}
        run.setup, run.q0, run.v0 = scenarios(run, fixed)[0]
        own = [x._replace(run=None, name=x.path) for x in p.sought if _own(x)]
        own = list({x.path: x for x in own}.values())
        one = Residuals([run], own, p.options, p.workers)
        _finer(one)
        point = drawn(own, 1, 0)[0] if own else np.empty(0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if own:
                try:
                    point = Search(one, self.noise, 50)(point[None], 1, False).inner
                except RunStopped as e:
                    raise FitError(f"the run fails: {e}", {}) from None
            setup, _, _, result = one.finished(point, 0)
        if isinstance(result, RunStopped):
            raise FitError(f"the run fails: {result}", {})
        return run.compared(result, setup)


def _task(
    scene: Any, data: Any, parameters: Any, inputs: Any, outputs: Any, noise: Any, integrator: Any, step: Any,
    workers: Any,
) -> Task:  # fmt: skip
    """The request of `identify`, checked."""
    scenes = list(scene) if isinstance(scene, (list, tuple)) else [scene]
    for one in scenes or [None]:
        instance("scene", one, Scene, "an fa.Scene, such as fa.load(...) gives")
    if not isinstance(parameters, (str, Mapping, list, tuple, set)):
        raise ValueError(f"parameters = {parameters!r}: must be paths, or a dictionary by paths")
    paths = [parameters] if isinstance(parameters, str) else [str(path) for path in parameters]
    runs = _runs(scenes, data, inputs, outputs, paths)
    known_keys("noise", noise or {}, [name for run in runs for name in run.outputs])
    noise = {name: positive(f"noise['{name}']", x) for name, x in (noise or {}).items()}
    unknown = sought([run.setup for run in runs], [(run.q0, run.v0) for run in runs], parameters)
    _check_states(runs, unknown)
    options, auto = _options(scenes[0], runs, integrator, step)
    residuals = Residuals(runs, unknown, options, default_workers(workers))
    _finer(residuals)
    return Task(scenes[0], residuals, noise, inputs, outputs, auto)


def _own(x: Sought) -> bool:
    """Whether each run has its own value of this number."""
    return x.run is not None or bool(x.of.each_run) or (x.of.each_run is None and x.path.startswith(("q0", "v0")))


def _runs(scenes: list[Scene], data: Any, inputs: Any, outputs: Any, paths: list[str]) -> list[Run]:
    """The measured runs."""
    several = isinstance(data, (list, tuple))
    all_data = list(data) if several else [data]
    if not all_data:
        raise ValueError("data: is an empty list; give at least one fa.Data")
    all_inputs = inputs if isinstance(inputs, (list, tuple)) else [inputs] * len(all_data)
    if len(all_inputs) != len(all_data):
        raise ValueError(f"inputs: are for {len(all_inputs)} runs, data for {len(all_data)}")
    if len(scenes) not in (1, len(all_data)):
        raise ValueError(f"scene: are {len(scenes)} scenes, for {len(all_data)} runs")
    named = [f"data[{k}]" if several else "data" for k in range(len(all_data))]
    rows = zip(scenes * (len(all_data) // len(scenes)), all_data, all_inputs, named, strict=True)
    return [measured_run(scene, d, i, outputs, name, paths) for scene, d, i, name in rows]


def _check_states(runs: list[Run], unknown: list[Sought]) -> None:
    """Raises ValueError for unknown initial states that motions prescribe."""
    for run in runs:
        arm = run.setup.arm
        laws = arm.by_rate("drive", split_drives(arm, run.setup.drive)[0])
        moved = [i for i, law in laws.items() if isinstance(law, Motion)]
        taken = {f"v0.{i}" for i in moved} | {f"q0.{arm.coordinate_of(i)}" for i in moved}
        for x in unknown:
            if x.path in taken:
                raise ValueError(f"parameters['{x.path}']: the motion of that joint is prescribed, its start with it")


def _options(scene: Scene, runs: list[Run], integrator: str | None, step: float | None) -> tuple[dict[str, Any], bool]:
    """Options of the runs, and whether the step is automatic."""
    options = {k: v for k, v in scene.options.items() if v is not None}
    own = options.get("integrator", "ida")
    chosen = integrator or (own if own in OPTIONS["step"] else _FIXED_STEP)
    if chosen != own:
        for key in OPTIONS:
            options.pop(key, None)
    options["integrator"] = chosen
    if step is not None:
        options["step"] = number("step", step)
    auto = chosen in OPTIONS["step"] and options.get("step") is None
    if auto:
        options["step"] = min(run.data.step for run in runs)
    integrator_of(chosen, **{k: x for k, x in options.items() if k in OPTIONS})
    return options, auto


def _finer(residuals: Residuals) -> None:
    """Adds rows between those of the data if a filter or a delay of a sensor needs them."""
    step = residuals.options.get("step")
    for run in residuals.runs:
        looks = [s for s in run.setup.sensors if isinstance(s, Sensor) and (s.filter is not None or s.delay)]
        sought_too = any(x.path.startswith("sensor.") and ".delay" in x.path for x in residuals.sought)
        fine = bool(step) and (bool(looks) or sought_too)
        run.every = int(np.clip(round(run.data.step / step), 1, _ROWS)) if fine and step else 1


def _without_outliers(fit: Fit) -> dict[str, float]:
    """By column, the noise over the deviation of the data, both by medians."""
    data = {name: np.concatenate([c.measured[name] for c in fit.comparisons if name in c.nrmse]) for name in fit.noise}
    return {name: fit.noise[name] / (deviation(y - np.median(y)) or np.inf) for name, y in data.items()}


def _interval(x: Sought, inner: float, reach: float) -> tuple[float, float]:
    low, high = (x.value(inner - reach), x.value(inner + reach)) if np.isfinite(reach) else (-np.inf, np.inf)
    return max(low, x.of.low), min(high, x.of.high)


def _at_bound(x: Sought, value: float) -> bool:
    near = 1e-6 * max(abs(value), x.scale if not x.log else 0.0)
    return value - x.of.low <= near or x.of.high - value <= near
