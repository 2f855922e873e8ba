"""Unknown numbers of a scene from measured runs, by least squares."""

from __future__ import annotations

import time
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .._check import whole
from .._console import progress_bar
from ..analysis.findings import RunWarning
from ..data.data import Data
from ..run.scene.scene import Scene
from ..run.sensitivity import RunStopped
from .fit import Fit, FitError, FitInterrupted, FitWarning
from .search import Found, Search
from .task import Task
from .unknown import Parameters, drawn

_STARTS = 8  # if one is not enough
_POOR = 0.5  # NRMSE of a poor fit


def identify(
    scene: Scene,
    data: Data | Sequence[Data],
    parameters: Parameters,
    *,
    inputs: Any = None,
    outputs: Any = None,
    noise: Mapping[str, float] | None = None,
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

    Args:
        scene: the model: its arm, drives, loads, controllers, sensors, initial state, integrator.
        data: a measured run, or several. Times are those of the scene.
        parameters: the unknown numbers, by path as in `simulate_batch`, with the start of the search: a number, None
            (the scene's value) or an `Unknown`, which has bounds and prior knowledge. A list of paths starts at the
            scene's values. Beside those of `simulate_batch`: "drive.1.scale",
            "drive.1.offset", "drive.1.delay", "sensor.0.gain", "sensor.0.offset", "sensor.0.delay",
            "sensor.0.filter.frequency", "q0.1", "v0.1", "gravity.2".
        inputs: measured signals that drive the arm, by key of a drive: a column of forces or voltages, straight between
            the samples; (fa.Motion, column) of a joint that moves as measured; a function of the data that gives a
            Motion, Torque or Voltage. For several runs a list of such tables, or one for all. None: the scene's drives.
        outputs: the measured quantity of each column of the data: a sensor, "sensor.0" of the scene ("sensor.0.1": its
            second component), the name of a column of `result.to_data()`, or a function of a Result that returns (nt,).
            None: all names in both. Sensors are read without noise and quantisation, at the times of the data.
        noise: standard deviation of columns, in SI. For others it is estimated from the residuals, until it settles.
        starts: number of starts; all but the first are drawn within the bounds, or within a factor of 3 of the first.
            They are simulated as one batch, and the best `keep` of them are fitted. None: one, or 8 if one fails or
            leaves more than a tenth of a column's deviation. seed: of the draw.
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
    if not isinstance(scene, Scene):
        raise ValueError(f"scene = {type(scene).__name__}: must be an fa.Scene, such as fa.load(...) gives")
    task = Task.of(scene, data, parameters, inputs, outputs, noise, integrator, step, workers)
    counts = {"starts": 1 if starts is None else starts, "keep": keep, "max_iterations": max_iterations}
    for name, value in counts.items():
        if whole(name, value) < 1:
            raise ValueError(f"{name} = {value}: must be at least 1")
    of = task.residuals
    search = Search(of, task.noise, max_iterations)
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
            fit = task.fit(found, points[: len(found.tried) or 1], began)
        hints = task.sign_hints(points[0])
    poor = [
        f"column '{name}': the residual is {100 * x:.3g} % of the measured deviation: the model does not explain it, "
        + (hints.get(name) or "or this is a local minimum; try more starts")
        for name, x in fit.nrmse.items()
        if x > _POOR
    ]
    own = [w for w in heard if issubclass(w.category, RunWarning)]
    for message in {str(w.message): w.message for w in own}.values():
        warnings.warn(message, stacklevel=2)  # warnings of the fitted runs
    for text in [*poor, *(f"the data cannot tell: {x}" for x in fit.untold), *missed]:
        warnings.warn(text, FitWarning, stacklevel=2)
    return fit
