"""Readings of a sensor, and their power spectral density."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ..._check import Array, array, at_least, choice, named, number, positive
from ..._console import write_csv
from ...data.data import Data
from ...data.draw.style import Figure
from ...data.draw.trajectory import by_unit, plot_panels

WINDOWS = ("hann", "boxcar")


@dataclass(frozen=True, eq=False, repr=False)
class Reading:
    """Samples of a sensor.

    Attributes:
        t: output time of each sample (s), (n,); the measured quantity is a `delay` older.
        y: the samples, (n, k).
        name: of the sensor.
        labels, units: of its k components.
    """

    t: Array
    y: Array
    name: str
    labels: tuple[str, ...]
    units: tuple[str, ...]

    @property
    def unit(self) -> str:
        """The unit, or the units where components differ: "N, N m"."""
        return ", ".join(dict.fromkeys(self.units))

    def __repr__(self) -> str:
        return f"Reading({self.name}: {len(self.t)} samples of {', '.join(self.labels)} ({self.unit}))"

    def to_data(self) -> Data:
        """The components as columns over time by their labels, beside measured data or in another format: see Data.
        ValueError if two labels are equal."""
        lost = [label for k, label in enumerate(self.labels) if label in self.labels[:k]]
        if lost:
            raise ValueError(f"labels: two components are called '{lost[0]}'")
        columns = dict(zip(self.labels, self.y.T, strict=True))
        return Data(self.t, columns, dict(zip(self.labels, self.units, strict=True)), self.name)

    def plot(self) -> Figure:
        """A figure of the samples over time, each held until the next."""
        curves = zip(self.labels, self.units, self.y.T, strict=True)
        panels = by_unit(curves, lambda _, label: label.rsplit(" ", 1)[0])
        return plot_panels(self.t, panels, self.name, held=True)

    def save(self, path: str | Path) -> None:
        """Writes a CSV file: t and the components, all digits, under one header line."""
        names = [f"{label} ({unit})" for label, unit in zip(self.labels, self.units, strict=True)]
        write_csv(named(path, ".csv", ".txt"), ["t (s)", *names], [self.t, *self.y.T])


@dataclass(frozen=True, eq=False, repr=False)
class PowerSpectrum:
    """One-sided power spectral density: its integral over frequency is the variance of the signal.

    Attributes:
        frequency: Hz, (n,). density: of a signal in some unit, unit^2/Hz, (n,).
    """

    frequency: Array
    density: Array

    def __repr__(self) -> str:
        return f"PowerSpectrum({len(self.frequency)} frequencies up to {self.frequency[-1]:g} Hz)"

    def peaks(self, count: int | None = None, prominence: float = 10.0) -> Array:
        """Frequencies (Hz) of the peaks, in ascending order.

        Each is the top of the parabola through the logarithms of the highest density and its two neighbours: with
        psd's window "hann" and a lightly damped vibration, good to a few hundredths of the frequency step.

        Args:
            count: largest number of peaks, the highest ones; None: all.
            prominence: least height of a peak above the saddle to higher ones (dB).
        """
        from scipy.signal import find_peaks  # slow to import

        positive("prominence", prominence, "dB")
        top = self.density.max(initial=0.0)
        if not top > 0:
            return np.empty(0)
        level = 10 * np.log10(np.maximum(self.density, 1e-30 * top))
        at, _ = find_peaks(level, prominence=prominence)
        if count is not None:
            at_least("count", count, 1)
            at = np.sort(at[np.argsort(-level[at], kind="stable")[:count]])
        below, here, above = level[at - 1], level[at], level[at + 1]
        shift = 0.5 * (below - above) / (below - 2 * here + above)
        return np.asarray(self.frequency[at] + shift * (self.frequency[1] - self.frequency[0]))


def psd(t: ArrayLike, y: ArrayLike, *, segment: float | None = None, window: str = "hann") -> PowerSpectrum:
    """Power spectral density of an evenly sampled signal, without its mean. (Fig. 7)

    Args:
        t: times (s), (n,), in equal steps. y: the signal, (n,) or (n, 1).
        segment: length (s) of the pieces, half overlapping, over which Welch's method averages: shorter ones
            smooth noise and blur peaks, which are distinct from about 2 / segment (Hz) on. None: one piece, the whole
            signal (a periodogram).
        window: "hann", or "boxcar" for a signal that is periodic in the piece, or transient and dead at its end.

    Returns:
        PowerSpectrum: `.frequency` (Hz), `.density` (unit^2/Hz), `.peaks()`.

    Raises:
        ValueError: bad shapes, uneven times, or a segment that is too short or too long.
    """
    from scipy.signal import welch  # slow to import

    times, signal = array("t", t), array("y", y)
    if times.ndim != 1 or times.size < 8:
        raise ValueError(f"t has shape {times.shape}: must be at least eight times")
    if signal.shape not in ((times.size,), (times.size, 1)):
        raise ValueError(f"y has shape {signal.shape}: must be one signal, {times.size} numbers")
    step = float(times[-1] - times[0]) / (times.size - 1)
    if not step > 0 or np.abs(np.diff(times) - step).max() > 1e-3 * step:
        raise ValueError("t: must increase in equal steps")
    choice("window", window, WINDOWS)
    n = times.size if segment is None else round(number("segment", segment) / step)
    if not 8 <= n <= times.size:
        raise ValueError(f"segment = {segment}: must be from {8 * step:g} to {times.size * step:g} s")
    frequency, density = welch(signal.ravel(), 1 / step, window, nperseg=n, detrend="constant")
    return PowerSpectrum(np.asarray(frequency), np.asarray(density))
