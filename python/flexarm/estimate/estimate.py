"""Estimates of a Kalman filter over time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from .._check import Array
from ..data.draw.trajectory import plot_panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, repr=False)
class Estimate:
    """Estimates at nt times, each after the readings of its time, as `KalmanFilter.run` returns them. Standard
    deviations are the filter's own; `consistency` tells whether they are right.

    Attributes:
        t: times (s), (nt,).
        q, v: coordinates (nt, nq) and rates (nt, nv); q_std, v_std: their standard deviations, (nt, nv), of a ball's
            rotation (rad).
        parameters: by name, (nt,) each; parameter_std: their standard deviations.
        tip: position of the last link's end in the world (m), (nt, 3); tip_std: its standard deviations.
        innovations: readings less their predictions, (nt, k); nan without a reading.
        innovation_std: their standard deviations predicted by the filter, (nt, k).
        nis: at each time the sum of the squares of innovations over innovation_std (NIS), (nt,).
        used: at each time the number of readings, (nt,).
        labels: of the k readings.
    """

    t: Array
    q: Array
    v: Array
    q_std: Array
    v_std: Array
    parameters: dict[str, Array]
    parameter_std: dict[str, Array]
    tip: Array
    tip_std: Array
    innovations: Array
    innovation_std: Array
    nis: Array
    used: Array
    labels: tuple[str, ...]

    @property
    def consistency(self) -> float:
        """The sum of `nis` over the number of readings: 1 if model and noises are right. Above 1 the given noises are
        too small or the model is wrong; below 1 the noises are too large."""
        return float(self.nis.sum() / max(self.used.sum(), 1))

    def __repr__(self) -> str:
        names = "".join(f", {k} {x[-1]:.4g} ± {self.parameter_std[k][-1]:.2g}" for k, x in self.parameters.items())
        return f"Estimate({len(self.t)} times up to t = {self.t[-1]:g} s{names}; consistency {self.consistency:.3g})"

    def plot(self) -> Figure:
        """A figure over time of each parameter, with a band of two standard deviations, and of the tip's position."""
        panels = []
        for name, x in self.parameters.items():
            band = 2 * self.parameter_std[name]
            curves = [("estimate", x), ("two std above", x + band), ("and below", x - band)]
            panels.append((name, curves))
        panels.append(("tip (m)", [(f"tip {c}", self.tip[:, k]) for k, c in enumerate("xyz")]))
        return plot_panels(self.t, panels)
