"""Fits by the likelihood of a Kalman filter's innovations (prediction error): readings are noisy, and so are the forces
that drive the arm (Ljung, System Identification, 1999, ch. 7; Fisher scoring)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from .._check import Array
from .._threads import each
from ..arm.variation import Setup
from ..data.compare import Comparison, compared
from ..data.data import Data
from ..estimate.kalman import KalmanFilter
from ..model.acting.drive import Motion, split_drives
from ..model.parts.labels import joint_rates
from ..run.held import held
from ..run.sensing.sensor import Sensor
from ..run.sensitivity import RunStopped
from .residuals import Residuals, scenarios
from .runs import Run
from .unknown import Sought, Unknown

_MOVE = 1e-4  # of an inner value: step of central differences
_SHARE = 0.01  # of the largest force: first deviation of the forces that the model lacks, from one row to the next
_LEAST = 1e-3  # of the first force noise: less counts as none
_LONGEST = 2.0  # longest step of the logarithm of a noise
_SETTLED = 1e-4  # squared standard deviations: smaller steps do not matter
_HALVINGS = 10


class Likelihood:
    """The likelihood of measured runs as a function of a point: inner values of the unknowns, then of the noises, which
    are "noise.COLUMN" of readings that have no given noise, "force_noise.JOINT", and of joints that nothing drives
    "force_drift.JOINT".

    Attributes:
        sought: all these. point: where the search is.
    """

    def __init__(
        self, residuals: Residuals, inner: Array, sigma: Mapping[str, float], told: Mapping[str, float]
    ) -> None:  # fmt: skip
        self.residuals, self.told = residuals, told
        starts = {f"noise.{name}": x for name, x in sigma.items() if name not in told}
        for run in residuals.runs:
            for name, reader in run.outputs.items():
                if reader.sensor is None:
                    raise ValueError(f"outputs['{name}']: must be a sensor for method = 'filter'")
        run, result = residuals.runs[0], residuals.finished(inner, 0)[3]
        assert not isinstance(result, RunStopped)
        arm, moved = run.setup.arm, _moved(run.setup)
        for i, name, _ in joint_rates(arm):
            if i not in moved:
                most = float(np.abs(result.tau[:, i]).max()) or float(np.abs(result.tau).max()) or 1.0
                starts[f"force_noise.{name}"] = _SHARE * most * float(np.sqrt(run.data.step))
                if not _driven(run.setup, i):
                    starts[f"force_drift.{name}"] = most / float(np.sqrt(run.data.t[-1] - run.data.t[0]))
        noises = [Sought(name, name, None, Unknown(float(x), low=_LEAST * x * name.startswith("force"), log=True))
                  for name, x in starts.items()]  # fmt: skip
        self.sought = [*residuals.sought, *noises]
        self.point = np.concatenate([inner, [x.inner(x.of.start or 0.0) for x in noises]])
        self.low, self.high = np.array([x.bounds for x in self.sought]).T

    def values(self, point: Array) -> Array:
        """Values of all that is sought."""
        return np.array([x.value(float(u)) for x, u in zip(self.sought, point, strict=True)])

    # -- a run of the filter -------------------------------------------------------------------------------------------

    def filtered(self, point: Array, k: int) -> tuple[Array, Array]:
        """Innovations of run k, (nt, outputs), and their standard deviations.

        Raises:
            RunStopped: the filter could not go on.
        """
        run, n = self.residuals.runs[k], len(self.residuals.sought)
        setup, q, v = scenarios(run, self.residuals.parameters(k, point[None, :n]))[0]
        noise = dict(zip([x.name for x in self.sought[n:]], self.values(point)[n:], strict=True))
        return filtered(run, setup, q, v, noise, self.told, self.residuals.options.get("step"))

    def parts(self, point: Array) -> tuple[Array, Array]:
        """Innovations of all runs, and the logarithms of their standard deviations, (m,) each."""
        found = [self.filtered(point, k) for k in range(len(self.residuals.runs))]
        self.residuals.count += len(found)
        e, s = (np.concatenate([x[i].T.ravel() for x in found]) for i in (0, 1))
        return e, np.log(s)

    def __call__(self, point: Array) -> float:
        """Minus its logarithm, with that of the priors, without constants; inf where the filter fails."""
        try:
            e, log_s = self.parts(point)
        except RunStopped:
            return np.inf
        p = self.residuals.priors(point[: len(self.residuals.sought)])[0]
        value = float(0.5 * np.sum((e * np.exp(-log_s)) ** 2) + np.sum(log_s) + 0.5 * p @ p)
        return value if np.isfinite(value) else np.inf

    def rows(self, point: Array) -> tuple[Array, Array]:
        """r (m,) and J (m, n) with J^T r the derivative of minus the log-likelihood, and J^T J Fisher's information: of
        innovations, then of their variances, then of priors."""
        e, log_s = self.parts(point)
        by = np.zeros((2, len(e), len(point)))

        def one(j: int) -> None:
            ends = np.array([point, point])
            ends[:, j] += _MOVE * np.array([-1.0, 1.0])
            ends[:, j] = np.clip(ends[:, j], self.low[j], self.high[j])
            first, last = (self.parts(end) for end in ends)
            by[:, :, j] = (np.array(last) - np.array(first)) / (ends[1, j] - ends[0, j])

        each(one, len(point), self.residuals.workers, self.residuals.look or (lambda: None))
        s = np.exp(log_s)
        p, by_p = self.residuals.priors(point[: len(self.residuals.sought)])
        J = [by[0] / s[:, None], np.sqrt(2.0) * by[1], np.pad(by_p, ((0, 0), (0, len(point) - by_p.shape[1])))]
        return np.concatenate([e / s, (1 - (e / s) ** 2) / np.sqrt(2.0), p]), np.vstack(J)

    def search(self, most: int, done: Callable[[], None]) -> tuple[bool, str]:
        """Moves the point to the largest likelihood. Whether it is there, and why the search ended. `done` is called
        after each iteration."""
        from scipy.optimize import lsq_linear  # slow to import

        n = len(self.residuals.sought)
        value = self(self.point)
        for _ in range(most):
            r, J = self.rows(self.point)
            scale = np.maximum(np.linalg.norm(J, axis=0), 1e-9)
            least, largest = self.low - self.point, self.high - self.point
            least[n:], largest[n:] = np.maximum(least[n:], -_LONGEST), np.minimum(largest[n:], _LONGEST)
            bounds = np.minimum(least, -1e-12) * scale, np.maximum(largest, 1e-12) * scale
            step = lsq_linear(J / scale, -r, bounds).x / scale
            if float(np.sum((J @ step) ** 2)) < _SETTLED:
                return True, "the next step would move no value by 0.01 of its standard deviation"
            for _ in range(_HALVINGS):
                there = np.clip(self.point + step, self.low, self.high)
                found = self(there)
                if found < value:
                    break
                step = step / 2
            else:
                return True, "no step makes the likelihood larger"
            self.point, value = there, found
            done()
        return False, f"it took {most} iterations"

    def compared(self, k: int) -> Comparison:
        """Run k with each reading as it was predicted from those before."""
        return predicted(self.residuals.runs[k], self.filtered(self.point, k)[0])


def _driven(setup: Setup, rate: int) -> bool:
    """Whether a drive or a controller acts on a rate."""
    arm = setup.arm
    if rate in arm.by_rate("drive", split_drives(arm, setup.drive)[0]):
        return True
    return any(column[rate] != 0.0 for c in setup.control for column in c._columns(arm))


def _moved(setup: Setup) -> set[int]:
    laws = setup.arm.by_rate("drive", split_drives(setup.arm, setup.drive)[0])
    return {i for i, law in laws.items() if isinstance(law, Motion)}


def predicted(run: Run, innovations: Array) -> Comparison:
    """A run's readings beside those that the filter predicts."""
    units = {name: run.data.units[name] for name in run.outputs}
    measured = Data(run.data.t, dict(zip(run.outputs, run.measured, strict=True)), units)
    simulated = Data(run.data.t, dict(zip(run.outputs, run.measured - innovations.T, strict=True)), units)
    return compared(measured, simulated)


def filtered(
    run: Run, setup: Setup, q: Array, v: Array, noise: Mapping[str, float], told: Mapping[str, float],
    step: float | None,
) -> tuple[Array, Array]:  # fmt: skip
    """Innovations of a run, (nt, outputs), and their standard deviations. The run starts where the scene says.

    Raises:
        RunStopped: the filter could not go on.
    """
    arm, data = setup.arm, run.data
    if run.balance == "held":
        setup = held(setup, float(run.t[0])).setup
    every = max(1, int(np.ceil(data.step / step - 1e-6))) if step else 1
    t = np.interp(np.arange((len(data) - 1) * every + 1) / every, np.arange(len(data)), data.t)
    sensors: dict[int, Sensor] = {}
    for reader in run.outputs.values():
        sensor = setup.sensors[reader.sensor or 0]
        assert isinstance(sensor, Sensor)
        sensors[reader.sensor or 0] = sensor
    first, size = {}, 0
    for k, sensor in sensors.items():
        first[k], size = size, size + len(sensor.components(arm))
    columns = [first[reader.sensor or 0] + reader.component for reader in run.outputs.values()]
    std, readings = np.ones(size), np.full((len(t), size), np.nan)
    std[columns] = [told[name] if name in told else noise[f"noise.{name}"] for name in run.outputs]
    readings[::every, columns] = run.measured.T
    made: list[Sensor] = []
    for k, sensor in sensors.items():
        own = std[first[k] : first[k] + len(sensor.components(arm))]
        made.append(replace(sensor, noise=float(own[0]) if len(own) == 1 else tuple(own.tolist())))
    forces, offsets, drift = np.zeros(arm.nv), {}, {}
    for i, name, _ in joint_rates(arm):
        forces[i] = noise.get(f"force_noise.{name}", 0.0)
        if f"force_drift.{name}" in noise:
            link = max(k for k in range(len(arm.links)) if arm._core.first(k) <= i)
            key = f"offset.{link}.{i - arm._core.first(link)}"
            drift[key] = noise[f"force_drift.{name}"]
            offsets[key] = (0.0, drift[key] * float(np.sqrt(t[-1] - t[0])))
    given: dict[str, Any] = {"drive": setup.drive, "loads": setup.loads, "control": setup.control}
    given |= {"force_noise": forces, "estimate": offsets, "drift": drift, "q_std": 0.0, "v_std": 0.0, "q": q, "v": v}
    kalman = KalmanFilter(arm, made, (t[-1] - t[0]) / (len(t) - 1), t=float(t[0]), **given)
    try:
        found = kalman.run(t, None, readings)
    except RuntimeError as e:
        raise RunStopped(str(e), np.nan) from None
    innovations, std = (x[::every, columns] for x in (found.innovations, found.innovation_std))
    lost = np.isnan(innovations)  # readings at the range of their sensor
    return np.where(lost, 0.0, innovations), np.where(lost, 1.0, std)
