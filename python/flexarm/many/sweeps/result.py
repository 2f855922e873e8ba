"""The result of a sweep: a table, its file and its figure."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._check import Array
from ...analysis.findings import RangeWarning
from ...data.draw.style import DPI
from ...data.draw.sweep import MISSING, plot_sweep
from ...data.store.files import named, readable, write_whole
from ...data.store.scenarios import read_scenarios
from ..batch.rollout import BatchInterrupted
from .vary import SweepPlan

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FILE = "sweep.h5"  # in the folder of a sweep
_MOST = 4  # columns, and parameters, that a figure shows
#: Units of parameters, by the last name of their paths.
_UNITS = {
    "length": "m", "radius": "m", "inner_radius": "m", "thickness": "m", "mass": "kg", "density": "kg/m³",
    "youngs_modulus": "Pa", "shear_modulus": "Pa", "area": "m²", "second_moment_y": "m⁴", "second_moment_z": "m⁴",
    "torsion_constant": "m⁴",
}  # fmt: skip


@dataclass(repr=False)
class SweepResult:
    """The table of a sweep; every array has one entry for each of its B scenarios.

    Attributes:
        plan: the sweep.
        parameters: values by path, (B,) or (B, k).
        columns: quantities by name, (B,); nan if a run failed or was not done.
        units: of each column.
        done: (B,), whether that scenario was run.
        failures: (index, time reached (s), reason) of each that failed.
        beyond: (index, RangeWarning) of each in which a beam bent beyond the range of its order.
        stats: scenarios, computed (now, not resumed), redone (shares whose worker died), wall_time (s).
        folder: of its files, or None.
    """

    plan: SweepPlan
    parameters: dict[str, Array]
    columns: dict[str, Array]
    units: dict[str, str]
    done: Any
    failures: list[tuple[int, float, str]] = field(default_factory=list)
    beyond: list[tuple[int, RangeWarning]] = field(default_factory=list)
    stats: dict[str, Any] = field(default_factory=dict)
    folder: Path | None = None

    def __len__(self) -> int:
        return len(self.done)

    def __repr__(self) -> str:
        names = ", ".join(self.columns)
        return f"SweepResult({len(self)} scenarios, {len(self.failures)} failed; {names})"

    def __getitem__(self, name: str) -> Array:
        """A column, or a parameter, by name."""
        known = {**self.parameters, **self.columns}
        if name not in known:
            raise ValueError(f"{name!r}: no column of this sweep; it has {', '.join(known)}")
        return known[name]

    @property
    def complete(self) -> bool:
        return bool(self.done.all())

    def trajectory(self, index: int) -> tuple[Array, Array, Array]:
        """t (nt,), q (nt, nq) and v (nt, nv) of a scenario, if the plan stores them."""
        if self.folder is None or not self.plan.trajectories:
            raise ValueError("trajectories = false: this sweep did not keep them")
        path = self.folder / FILE
        with readable("trajectories", path, "the file of a sweep"):
            i = range(len(self))[index]
            _, fixed, rows, _ = read_scenarios(path, slice(i, i + 1))
            return fixed["t"], np.array(rows["q"][0]), np.array(rows["v"][0])

    def save(self, folder: str | Path) -> list[str]:
        """Writes sweep.csv and sweep.png there; their names."""
        path = Path(folder)
        with named("output folder", path):
            path.mkdir(parents=True, exist_ok=True)
        _write_table(path / "sweep.csv", self)
        figure = self.plot()
        write_whole(path / "sweep.png", lambda f: figure.savefig(f, dpi=DPI, format="png"), "output file")
        return ["sweep.csv", "sweep.png"]

    def plot(self) -> Figure:
        """A heat map of each column over a grid of two parameters, else each column over each parameter. Missing
        numbers are grey, or crosses; a line below gives the reason."""
        names, numbers = _parameter_columns(self.parameters)
        labels = {name: _with_unit(name, _UNITS.get(name.rpartition(".")[2], "")) for name in names}
        grid = self.plan.grid()
        why = np.full(len(self), list(MISSING).index("no value"))
        why[~self.done] = list(MISSING).index("not run yet")
        why[[i for i, *_ in self.failures]] = list(MISSING).index("failed")
        failed = f"; {len(self.failures)} failed" if self.failures else ""
        left = "" if self.complete else f" of {len(self)}"
        cut = [f"the first {_MOST} of {len(x)} {w}" for x, w in ((self.columns, "columns"), (names, "parameters"))
               if len(x) > _MOST]  # fmt: skip
        runs = f"{int(self.done.sum())}{left} runs{failed}"
        return plot_sweep(
            [(_with_unit(n, self.units[n]), self.columns[n]) for n in list(self.columns)[:_MOST]],
            [(labels[name], values) for name, values in zip(names, numbers, strict=True)][:_MOST],
            None if grid is None else {labels[name]: values for name, values in grid.items()},
            len(names) == 1 and self.plan.vary[0].kind in ("grid", "list"),
            f"{self.plan.title}: {', '.join([runs, *cut])}",
            why,
        )


def _with_unit(name: str, unit: str) -> str:
    return f"{name} ({unit})" if unit not in ("", "1") else name


class SweepInterrupted(BatchInterrupted):
    """Ctrl-C during a sweep. `.result` is the SweepResult so far."""


def _write_table(path: Path, result: SweepResult) -> None:
    """One line for each scenario that was run."""
    names, numbers = _parameter_columns(result.parameters)
    reasons = {i: reason for i, _, reason in result.failures}
    header = ["scenario", *names, *(f"{n} ({u})" if (u := result.units[n]) else n for n in result.columns), "failure"]
    columns = [*numbers, *result.columns.values()]
    with io.StringIO(newline="") as text:
        out = csv.writer(text, lineterminator="\n")
        out.writerow(header)
        for i in np.flatnonzero(result.done):
            out.writerow([int(i), *(repr(float(c[i])) for c in columns), reasons.get(int(i), "")])
        write_whole(path, lambda f: f.write(text.getvalue().encode()), "output file")


def _parameter_columns(parameters: Mapping[str, Array]) -> tuple[list[str], list[Array]]:
    names, columns = [], []
    for path, v in parameters.items():
        names += [path] if v.ndim == 1 else [f"{path}.{k}" for k in range(v.shape[1])]
        columns += [v] if v.ndim == 1 else list(v.T)
    return names, columns
