"""The result of a validation: errors by recording and column, a report, a figure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._console import aligned
from ...data.compare import Comparison
from ...data.draw.trajectory import Curves, plot_recordings
from ..fit import Fit
from .recordings import DEFLECTIONS, JOINTS, Recording

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SHOWN = {JOINTS[0]: "Joint 1 (deg)", JOINTS[1]: "Joint 2 (deg)",
          DEFLECTIONS[0]: "Deflection 1 (deg)", DEFLECTIONS[1]: "Deflection 2 (deg)"}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Judged:
    """A recording beside the model.

    Attributes:
        recording: its name. driven: "motion": the joints move as measured; "current": the motors have the measured
            currents. role: the parameters that were fitted to this recording.
        since: start of the judged part (s), after the recording's. comparison: both, over the whole recording.
        nrmse: by column, the root mean square of the error over the standard deviation of the measured values, in the
            judged part (1).
    """

    recording: str
    driven: str
    role: str
    since: float
    comparison: Comparison
    nrmse: dict[str, float]

    @staticmethod
    def of(recording: Recording, driven: str, role: str, comparison: Comparison, since: float = 0.0) -> Judged:
        t = comparison.measured.t
        rows = recording.judged & np.asarray(t >= since)
        found = {}
        for name in comparison.nrmse:
            y, x = comparison.measured[name][rows], comparison.simulated[name][rows]
            found[name] = float(np.sqrt(np.mean((x - y) ** 2)) / y.std())
        return Judged(recording.name, driven, role, float(t[rows][0]), comparison, found)

    def curves(self) -> Curves:
        c = self.comparison
        shown = {_SHOWN[n]: (np.degrees(c.measured[n]), np.degrees(c.simulated[n]), 100 * e)
                 for n, e in self.nrmse.items()}  # fmt: skip
        return Curves(f"{self.recording}, {self.role}", c.measured.t, self.since, shown)


@dataclass(repr=False, eq=False)
class Validation:
    """A measured arm and its model. `print(validation)` is its report.

    Attributes:
        judged: recordings beside the model; see Judged: `.recording`, `.driven`, `.role`, `.nrmse[column]`.
        fits: by "motion" and "current", the Fit of the model; none if shipped values were used.
        calibrations: by recording, the fitted values of the parameters that differ between recordings.
        notes: failed computations, and parameters that can replace each other; see `Fit.loose`.
    """

    judged: list[Judged]
    fits: dict[str, Fit] = field(default_factory=dict)
    calibrations: dict[str, dict[str, float]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def __repr__(self) -> str:
        return self.report()

    def report(self) -> str:
        """A table of errors, and the fitted values."""
        columns = [n for n in _SHOWN if any(n in j.nrmse for j in self.judged)]
        rows = [["driven by", "recording", "what was fitted to it", "judged from", *columns]]
        for j in self.judged:
            errors = [f"{100 * j.nrmse[n]:.1f}" if n in j.nrmse else "" for n in columns]
            rows.append([j.driven, j.recording, j.role, f"{j.since:.1f} s", *errors])
        lines = ["NRMSE (%): rms of the error over the standard deviation of the measured values", "",
                 *aligned(rows, range(3, 4 + len(columns)))]  # fmt: skip
        lines += ["", *self.notes] if self.notes else []
        for name, values in self.calibrations.items():
            lines += ["", f"{name}: " + ", ".join(f"{k} = {x:.4g}" for k, x in values.items())]
        for driven, fit in self.fits.items():
            lines += ["", f"The fit, driven by {driven}:", fit.report()]
        return "\n".join(lines)

    def plot(self, driven: str = "motion") -> Figure:
        """A figure of the recordings, measured and modelled. driven: "motion" or "current"."""
        return plot_recordings(latest([j for j in self.judged if j.driven == driven]))

    def to_dict(self) -> dict[str, Any]:
        """All but the curves, as JSON has it."""
        return {
            "judged": [{"driven": j.driven, "recording": j.recording, "role": j.role, "since": j.since,
                        "nrmse": dict(j.nrmse)} for j in self.judged],
            "calibrations": {k: dict(x) for k, x in self.calibrations.items()},
            "notes": list(self.notes),
            "fits": {k: fit.to_dict() for k, fit in self.fits.items()},
        }  # fmt: skip


def latest(judged: Sequence[Judged]) -> list[Curves]:
    """The last comparison of each recording, as curves."""
    return [j.curves() for j in {j.recording: j for j in judged}.values()]
