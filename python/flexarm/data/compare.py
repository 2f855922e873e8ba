"""Simulated against measured columns, in numbers and as a figure."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from .._check import Array, warn
from .._console import aligned
from . import signal
from .data import Data, constant
from .draw.fit import plot_pair
from .draw.style import Figure
from .signal import DataWarning

_LAG_SHARE = 0.1  # of the time compared, within which a lag is looked for


@dataclass(frozen=True, eq=False, repr=False)
class Comparison:
    """A run beside measured data, at the times of the measurement. `print(comparison)` is a table.

    Attributes:
        measured, simulated: Data with the same times, names and units.
        nrmse: by name, the root mean square of simulated less measured, over the standard deviation of the measured
            (1); nan of a constant measured column.
        rmse: by name, the root mean square alone, in the column's unit.
        bias: by name, the mean of simulated less measured, in the column's unit.
        lag: by name, how much later the simulated comes (s), looked for within a tenth of the time; nan where there is
            none.
        correlation: by name, Pearson's coefficient without a lag (1); nan where either is constant.
    """

    measured: Data
    simulated: Data
    nrmse: Mapping[str, float]
    rmse: Mapping[str, float]
    bias: Mapping[str, float]
    lag: Mapping[str, float]
    correlation: Mapping[str, float]

    def __repr__(self) -> str:
        t = self.measured.t
        cells = [["column", "unit", "NRMSE (%)", "rms error", "bias", "lag (s)", "correlation"]]
        for n in self.measured:
            numbers = (f"{100 * self.nrmse[n]:.4g}", f"{self.rmse[n]:.4g}", f"{self.bias[n]:.3g}", f"{self.lag[n]:.3g}")
            cells.append([n, self.measured.units[n], *numbers, f"{self.correlation[n]:.5f}"])
        head = f"Comparison over {len(t)} rows, t = {t[0]:g} to {t[-1]:g} s; simulated less measured"
        return "\n".join([head, *aligned(cells, range(2, 7))])

    def plot(self) -> Figure:
        """A figure of both over time, a panel for each column."""
        return plot_pair(self)


def compared(measured: Data, simulated: Data) -> Comparison:
    """Of Data with the same times and names.

    Raises:
        (DataWarning: a measured column is constant.)
    """
    found: dict[str, dict[str, float]] = {k: {} for k in ("nrmse", "rmse", "bias", "lag", "correlation")}
    still = [name for name, y in measured.columns.items() if constant(y)]
    if still:
        text = f"measured column '{still[0]}' is constant ({measured[still[0]][0]:g}): its NRMSE is not defined"
        warn(text, DataWarning)
    for name, y in measured.columns.items():
        x = simulated[name]
        error, rigid = x - y, constant(x) or constant(y)
        found["rmse"][name] = float(np.sqrt(np.mean(error**2)))
        found["bias"][name] = float(error.mean())
        found["nrmse"][name] = float("nan") if constant(y) else found["rmse"][name] / float(y.std())
        found["correlation"][name] = float("nan") if rigid else float(np.corrcoef(x, y)[0, 1])
        found["lag"][name] = float("nan") if rigid else _lag(measured.t, x, y)
    return Comparison(measured, simulated, **found)


def _lag(t: Array, x: Array, y: Array) -> float:
    if len(t) < 8:
        return float("nan")
    try:
        return signal.lag((t, x), (t, y), _LAG_SHARE * float(t[-1] - t[0]))[0]
    except ValueError:
        return float("nan")
