"""The result of a fit: values, their uncertainty, and residuals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from .._check import Array
from .._console import aligned, seconds
from ..data.compare import Comparison
from ..data.data import Data
from ..data.draw.fit import plot_fit
from ..run.scene.scene import Scene
from .statistics import Loose, Untold, Whiteness

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_APART = 1.5  # ratio of residuals to the given noise, above which a report names it
_FAR = 4.0  # standard deviations, beyond which a report counts outliers


class FitWarning(UserWarning):
    """A fit with limits: numbers that the data do not determine, or steps that are too long."""


class FitInterrupted(KeyboardInterrupt):
    """Ctrl-C during `identify`; it holds the best fit so far, `.fit`, None if no run was completed."""

    def __init__(self, message: str, fit: Fit | None) -> None:
        super().__init__(message)
        self.fit = fit


class FitError(RuntimeError):
    """A fit that could not begin: the runs at all starts failed. `.values` are those of the first start."""

    def __init__(self, message: str, values: dict[str, float]) -> None:
        super().__init__(message)
        self.values = values

    def __reduce__(self) -> Any:
        return type(self), (str(self), self.values)


@dataclass(repr=False, eq=False)
class Fit:
    """A scene fitted to measured runs. `print(fit)` is its report.

    Attributes:
        scene: with the fitted values. Where inputs were measured, they drive it, and its times are those of the (first)
            data: `fit.scene.run()` is the fitted run.
        values: by name: the path of a number, or "run K: path" if each run has its own value.
        intervals: by name, the 95 % confidence interval (low, high), within the bounds.
        std: by name, the standard deviation; inf if the data do not determine the value.
        correlation: of the values, in their order, (n, n); nan if the data do not determine a value.
        start: by name, the start of the search.
        noise: by column, the standard deviation that weights its residuals: as given, or estimated from them.
        noise_told: columns with given noise.
        comparisons: of each run with its data: `.nrmse`, `.plot()`.
        whiteness: of each run, by column: `.p` of Ljung and Box's test, `.white` (p above 0.01), `.correlation`. Where
            residuals are not white, the intervals allow for their autocorrelation.
        untold: combinations of numbers that the data do not determine; str() of each names them.
        loose: groups of strongly correlated numbers (multiple correlations above 0.95), and how far they may change
            together until the root mean square of the residuals is 1 % larger: if residuals are not noise, the values
            are at least this uncertain.
        method, loss: as given. After "filter" residuals are those of each reading as it is predicted from those before.
        at_bounds: names of values that are at a bound.
        converged, message: whether the search converged, and why it ended.
        derivatives: those of the search and the intervals, and why: ("exact", ""); or ("smoothed", why), those of
            the loop whose sensors read without steps; or ("differences", why), of runs.
        starts: at each start, the root mean square of the residuals, in per cent of the columns' standard deviations
            (with given noise, in its units), and the same after the fit, or None if it was not fitted.
        stats: runs simulated, step (s) of the integrator, wall_time (s).
    """

    scene: Scene
    values: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    std: dict[str, float]
    correlation: Array
    start: dict[str, float]
    noise: dict[str, float]
    noise_told: frozenset[str]
    comparisons: list[Comparison]
    whiteness: list[dict[str, Whiteness]]
    untold: list[Untold]
    loose: list[Loose]
    method: str
    loss: str
    at_bounds: list[str]
    converged: bool
    message: str
    derivatives: tuple[str, str]
    starts: list[tuple[float, float | None]]
    stats: dict[str, Any]
    _comparison_with: Any = field(default=None)  #: (data, inputs) -> Comparison, of validate

    def __repr__(self) -> str:
        return self.report()

    @property
    def nrmse(self) -> dict[str, float]:
        """By column, the root mean square of the residuals of all runs over the standard deviation of the data (1)."""
        found = {}
        for name in self.noise:
            parts = [c for c in self.comparisons if name in c.nrmse]
            squares = sum(len(c.measured) * c.rmse[name] ** 2 for c in parts)
            spread = sum(len(c.measured) * float(c.measured[name].var()) for c in parts)
            found[name] = float(np.sqrt(squares / spread)) if spread > 0 else float("nan")
        return found

    def validate(self, data: Data, inputs: Mapping[Any, Any] | None = None) -> Comparison:
        """Compares the fitted scene with a run that was not used in the fit.

        Only values that each run has of its own, such as unknown initial states, are fitted to this run.

        Args:
            data: measured, with the columns of the fit. inputs: as of `identify`; None: those of the fit.

        Returns:
            Comparison: `.nrmse["column"]`, `print`, `.plot()`.

        Raises:
            ValueError: as `identify`. FitError: the run could not go on.
        """
        return self._comparison_with(data, inputs)  # type: ignore[no-any-return]

    def report(self) -> str:
        """Tables of values and of columns, and the notes."""
        runs = len(self.comparisons)
        readings = sum(len(c.measured) * len(c.nrmse) for c in self.comparisons)
        head = (
            f"{self.scene.name}: {len(self.values)} number{'s' if len(self.values) > 1 else ''} fitted to {readings} "
            f"readings of {runs} run{'s' if runs > 1 else ''}; {self.stats['runs']} runs simulated in "
            f"{seconds(self.stats['wall_time'])}"
        )
        cells = [["number", "start", "value", "95 % interval", "", "deviation (%)"]]
        for name, value in self.values.items():
            low, high = self.intervals[name]
            part = 100 * self.std[name] / abs(value) if value else np.inf
            cells.append([name, f"{self.start[name]:.6g}", f"{value:.6g}", f"{low:.6g}", f"to {high:.6g}",
                          f"{part:.3g}" if part < 1e3 else "-"])  # fmt: skip
        lines = [head, "", *aligned(cells, (1, 2, 3, 5)), ""]
        cells = [["column", "unit", "noise", "", "NRMSE (%)", "residuals"]]
        for name, sigma in self.noise.items():
            white = [w[name] for w in self.whiteness if name in w]
            tail = "" if not white else "white" if all(w.white for w in white) else "not white"
            p = min((w.p for w in white), default=np.nan)
            unit = next(c.measured.units[name] for c in self.comparisons if name in c.nrmse)
            told = "told" if name in self.noise_told else "estimated"
            cells.append([name, unit, f"{sigma:.4g}", told, f"{100 * self.nrmse[name]:.4g}", f"{tail} (p = {p:.2g})"])
        lines += aligned(cells, (2, 4))
        notes = self.notes()
        return "\n".join([*lines, *([""] if notes else []), *notes])

    def notes(self) -> list[str]:
        """Notes on the values, a sentence each."""
        notes = []
        if self.method == "filter":
            notes.append("Residuals are those of each reading as it is predicted from those before.")
        if not self.converged:
            notes.append(f"The search did not come to its end: {self.message}")
        way, why = self.derivatives
        if way != "exact":
            of = "differences of runs" if way == "differences" else "those of the same loop without these steps"
            residuals = "" if self.method == "filter" else ", the residuals those of the run as it is"
            notes.append(f"{why}; the derivatives taken are {of}{residuals}.")
        for name in self.noise if self.loss != "linear" else ():
            r = np.concatenate([c.simulated[name] - c.measured[name] for c in self.comparisons if name in c.nrmse])
            out = int((np.abs(r) > _FAR * self.noise[name]).sum())
            notes.append(f"{out} of {len(r)} readings of {name} are more than {_FAR:g} standard deviations off.")
        if len(self.starts) > 1:
            ends = sorted(x for _, x in self.starts if x is not None)
            said = ", ".join(f"{x:.4g}" for x in ends)
            failed = sum(not np.isfinite(x) for x, _ in self.starts)
            lost = f" ({failed} could not be simulated)" if failed else ""
            of = "units of noise" if self.noise_told else "% of the deviation"
            notes.append(f"Of {len(self.starts)} starts{lost} {len(ends)} were fitted; they left {said} {of}.")
        notes += [f"The data cannot tell: {x}." for x in self.untold]
        notes += [f"{name} is at its bound." for name in self.at_bounds]
        notes += [f"{x}." for x in self.loose]
        coloured = sorted({name for run in self.whiteness for name, w in run.items() if not w.white})
        if coloured:
            notes.append(
                f"Residuals of {', '.join(coloured)} are not white: the intervals allow for their autocorrelation, but "
                "not for effects that the model lacks. Possible causes: friction, damping, backlash or modes that the "
                "scene lacks; a step of the integrator that is too long; a sensor whose filter, delay, gain or place "
                "differs from the scene's; noise that is coloured."
            )
        for name in sorted(self.noise_told):
            rms = np.sqrt(np.mean([c.rmse[name] ** 2 for c in self.comparisons if name in c.rmse]))
            if rms < self.noise[name] / _APART:
                notes.append(
                    f"Residuals of {name} are {self.noise[name] / rms:.3g} times smaller than the noise that was told: "
                    "the intervals are too wide; tell the noise as it is, or leave it to the fit."
                )
            if rms > _APART * self.noise[name]:
                notes.append(
                    f"Residuals of {name} are {rms / self.noise[name]:.3g} times the noise that was told: the model "
                    "does not explain the data, or they are noisier; the intervals are too narrow."
                )
        return notes

    def plot(self) -> Figure:
        """A figure: of each run the measured and fitted columns, the residuals, and their autocorrelation."""
        return plot_fit(self.comparisons, self.whiteness)

    def to_dict(self) -> dict[str, Any]:
        """Values, intervals and all else but the scene, for JSON."""
        return {
            "scene": self.scene.name,
            "values": dict(self.values),
            "intervals": {k: list(x) for k, x in self.intervals.items()},
            "std": dict(self.std),
            "start": dict(self.start),
            "correlation": self.correlation.tolist(),
            "noise": dict(self.noise),
            "noise_told": sorted(self.noise_told),
            "nrmse": self.nrmse,
            "runs": [{"data": c.measured.name, "nrmse": dict(c.nrmse), "whiteness": {k: w.p for k, w in run.items()}}
                     for c, run in zip(self.comparisons, self.whiteness, strict=True)],
            "untold": [dict(zip(x.names, x.changes, strict=True)) for x in self.untold],
            "loose": [{**dict(zip(x.names, x.changes, strict=True)), "correlation": x.correlation} for x in self.loose],
            "method": self.method,
            "loss": self.loss,
            "at_bounds": list(self.at_bounds),
            "converged": self.converged,
            "message": self.message,
            "derivatives": list(self.derivatives),
            "starts": [list(x) for x in self.starts],
            "notes": self.notes(),
            "stats": dict(self.stats),
        }  # fmt: skip
