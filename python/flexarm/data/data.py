"""Columns over time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._check import Array, array, choice, number, positive, warn
from .._console import aligned
from . import signal
from .draw.style import Figure
from .draw.trajectory import by_unit, plot_panels
from .files import write_columns
from .load import Loaded
from .signal import DataWarning, check_times
from .units import unit_of

METHODS = ("linear", "cubic")
_QUANTITIES = {
    "rad": "Angle", "m": "Length", "rad/s": "Rate", "m/s": "Speed", "m/s^2": "Acceleration", "A": "Current",
    "rad/s^2": "Acceleration", "V": "Voltage", "N": "Force", "N m": "Torque", "Pa": "Pressure", "K": "Temperature",
}  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class Data(Loaded):
    """Signals over time, measured or simulated, in SI units. `fa.Data.load` reads them from a file.

    `data["name"]` is a column, `data[["one", "two"]]` is Data of these alone; `len(data)` is the number of rows,
    iteration goes over the names, `"name" in data` tells whether there is such a column. `print(data)` is a table.

    Attributes:
        t: times (s), (nt,), increasing; not always in equal steps.
        columns: values by name, (nt,) each, in SI.
        units: the SI unit of each column; "" where it is not known, "1" of a plain number. Values in another
            one, such as "deg" or "mm/s^2", is converted when Data is made.
        name: of tables and figures, such as the file.

    Raises:
        ValueError: no rows, times that do not increase, a column of another length, nan (with row and column), an
            unknown unit.
    """

    t: Array
    columns: Mapping[str, Array]
    units: Mapping[str, str] = field(default_factory=dict)
    name: str = ""

    def __post_init__(self) -> None:
        t = array("t", self.t)
        if t.ndim != 1 or not t.size:
            raise ValueError(f"t has shape {t.shape}: must be times, (nt,), one or more")
        check_times(t, lambda k: f"row {k}")
        columns, units = dict[str, Array](), dict[str, str]()
        for name, values in self.columns.items():
            if not isinstance(name, str) or not name.strip():
                raise ValueError(f"columns: {name!r}: a name must be text")
            if name == "t":
                raise ValueError("columns: 't' is the name of the times, the first argument; rename this column")
            of = unit_of(name, self.units.get(name, ""))
            y = array(f"columns['{name}']", values)
            if y.shape != t.shape:
                raise ValueError(f"columns['{name}'] has shape {y.shape}: must be {len(t)} numbers, one for each time")
            with np.errstate(over="ignore"):
                columns[name] = array(f"columns['{name}'] ({of.si})", y * of.scale + of.shift)
            units[name] = of.si
        lost = [name for name in self.units if name not in columns]
        if lost:
            raise ValueError(f"units['{lost[0]}']: there is no such column; there are {', '.join(columns) or 'none'}")
        for key, value in (("t", t), ("columns", columns), ("units", units)):
            object.__setattr__(self, key, value)

    # -- its contents --------------------------------------------------------------------------------------------------

    @property
    def names(self) -> tuple[str, ...]:
        """Of the columns, in order."""
        return tuple(self.columns)

    @property
    def step(self) -> float:
        """The usual time between two rows (s): the median; nan of one row."""
        return signal.median_step(self.t)

    def gaps(self) -> Array:
        """Where rows are missing, (n, 2): time before each gap and its length (s). A gap is a step longer than 2.5
        usual ones."""
        return signal.gaps(self.t)

    def __len__(self) -> int:
        return len(self.t)

    def __iter__(self) -> Iterator[str]:
        return iter(self.columns)

    def __contains__(self, name: object) -> bool:
        return name in self.columns

    def __getitem__(self, name: str | Iterable[str]) -> Any:
        if isinstance(name, str):
            return self.columns[choice("column", name, self.columns)]
        kept = [choice("column", n, self.columns) for n in name]
        return Data(self.t, {n: self.columns[n] for n in kept}, {n: self.units[n] for n in kept}, self.name)

    def _with(self, t: Array, rows: Iterable[Array]) -> Data:
        return Data(t, dict(zip(self.columns, rows, strict=True)), self.units, self.name)

    def __repr__(self) -> str:
        span = f"t = {self.t[0]:g} to {self.t[-1]:g} s"
        rate = f", every {self.step:.6g} s" if len(self) > 1 else ""
        lines = [f"Data {self.name}: ".replace(" :", ":") + f"{len(self)} rows, {span}{rate}"]
        cells = [["column", "unit", "min", "max", "mean", "std"]]
        for name, y in self.columns.items():
            most = np.abs(y).max() or 1.0  # neither sums nor squares of parts of it overflow
            mean, std = most * (y / most).mean(), 0.0 if constant(y) else most * (y / most).std()
            cells.append([name, self.units[name], *(f"{x:.5g}" for x in (y.min(), y.max(), mean, std))])
        return "\n".join([*lines, *aligned(cells, range(2, 6))])

    # -- other times ---------------------------------------------------------------------------------------------------

    def between(self, t0: float | None = None, t1: float | None = None) -> Data:
        """The rows from t0 to t1 (s), both included; None: from the first, to the last.

        Raises:
            ValueError: there are none.
        """
        low = -np.inf if t0 is None else number("t0", t0)
        high = np.inf if t1 is None else number("t1", t1)
        kept = (self.t >= low) & (self.t <= high)
        if not kept.any():
            raise ValueError(f"t0 = {t0}, t1 = {t1}: no rows; there are some from {self.t[0]:g} to {self.t[-1]:g} s")
        return self._with(self.t[kept], [y[kept] for y in self.columns.values()])

    def shift(self, by: float) -> Data:
        """The same rows, all `by` seconds later."""
        return self._with(self.t + array("by", by, ()), self.columns.values())

    def resample(self, t: ArrayLike, method: str = "linear", *, antialias: bool = True) -> Data:
        """All columns at other times.

        Where these lie further apart than the rows do, motion faster than half of their rate would be folded back
        into slow motion that never was (aliasing). A Butterworth low-pass at 0.8 of half the new rate, run forward and
        backward so that nothing comes later, takes it out before. It smooths steps, too.

        Args:
            t: new times (s), (n,), increasing and within the old ones; or one number, the step between them (s), from
                the first time on.
            method: "linear", which never leaves the range of the samples; or "cubic", a spline, better for smooth
                signals that are sampled less than ten times in a period, but it overshoots at steps.
            antialias: whether to take out motion too fast for the new times.

        Raises:
            ValueError: times outside of the data, that do not increase, a step that is not positive.
            (DataWarning: a gap was interpolated.)
        """
        choice("method", method, METHODS)
        new = array("t", t)
        if new.ndim == 0:
            if not new > 0:
                raise ValueError(f"t = {new:g}: one number is a step (s), which must be positive")
            new = signal.even_times(self.t[0], self.t[-1], float(new))
        if new.ndim != 1 or not new.size:
            raise ValueError(f"t has shape {new.shape}: must be times, (n,), or one step")
        slack = 1e-9 * max(1.0, float(np.abs(self.t).max()))
        if new.min() < self.t[0] - slack or new.max() > self.t[-1] + slack:
            raise ValueError(
                f"t: from {new.min():g} to {new.max():g} s, but the data are from {self.t[0]:g} to {self.t[-1]:g} s"
            )
        check_times(new, lambda k: f"row {k}")
        for begin, length in self.gaps():
            if ((new > begin) & (new < begin + length)).any():
                text = f"resample: a gap of {length:g} s from t = {begin:g} s on is interpolated"
                warn(text, DataWarning)
        old, rows = self.t, np.column_stack([*self.columns.values()]) if self.columns else np.empty((len(self), 0))
        if antialias and len(new) > 1 and len(old) > 2 and signal.median_step(new) > 1.001 * self.step:
            old, rows = signal.low_passed(old, rows, signal.median_step(new), method)
        return self._with(new, signal.at_times(old, rows, np.clip(new, old[0], old[-1]), method).T)

    def lag(self, other: Data, column: str, other_column: str | None = None, *, max_lag: float | None = None) -> float:
        """By how much (s) a column comes later here than in other data, by cross-correlation, between samples too.

        Offsets and scales do not matter, nor does where either one's clock begins. It is the peak of the correlation
        coefficient over at least half of the shorter one's time; of peaks as high within 0.001 (of a periodic motion),
        the one nearest to zero.

        Args:
            other: other data, at times of its own.
            column: the column here. other_column: its name there; None: the same.
            max_lag: the largest lag to look for, either way (s); None: any.

        Raises:
            ValueError: no such column, a constant one, or no peak within max_lag.
            (DataWarning: a peak correlation below 0.5: the lag tells little.)
        """
        if not isinstance(other, Data):
            raise ValueError(f"other = {type(other).__name__}: must be fa.Data")
        if max_lag is not None:
            positive("max_lag", max_lag, "s")
        there = column if other_column is None else other_column
        pairs = (self.t, self[column]), (other.t, other[there])
        for (t, y), name in zip(pairs, (column, there), strict=True):
            if constant(y):
                raise ValueError(f"column '{name}' is constant ({y[0]:g}): it has no lag")
            if len(t) < 8:
                raise ValueError(f"column '{name}' has {len(t)} rows: a lag needs eight or more")
        found, r = signal.lag(*pairs, max_lag)
        if r < 0.5:
            text = f"column '{column}': the correlation is {r:.2g} at best: its lag tells little"
            warn(text, DataWarning)
        return found

    def align(
        self, other: Data, column: str, other_column: str | None = None, *, max_lag: float | None = None
    ) -> Data:
        """These data with their times moved so that a column fits other data's: `self.shift(-self.lag(...))`. The
        arguments are those of `lag`, and so are the errors."""
        return self.shift(-self.lag(other, column, other_column, max_lag=max_lag))

    # -- out -----------------------------------------------------------------------------------------------------------

    def plot(self, columns: str | Sequence[str] | None = None) -> Figure:
        """A figure of columns over time, a panel for each unit.

        Args:
            columns: a name or names; None: all.
        """
        shown = self.names if columns is None else (columns,) if isinstance(columns, str) else tuple(columns)
        for name in shown:
            choice("columns", name, self.columns)
        if not shown:
            raise ValueError("columns: there are none to plot")
        curves = ((name, self.units[name], self.columns[name]) for name in shown)
        return plot_panels(self.t, by_unit(curves, lambda unit, _: _QUANTITIES.get(unit, "")), self.name)

    def to_pandas(self) -> Any:
        """A pandas DataFrame: its index is t (s), its columns have the names here, and `.attrs["units"]` their units;
        `fa.Data.load` takes it back. It needs `pip install 'flexarm[pandas]'`."""
        try:
            import pandas
        except ImportError:
            raise ImportError("to_pandas needs pandas: pip install 'flexarm[pandas]'") from None
        frame = pandas.DataFrame(dict(self.columns), index=pandas.Index(self.t, name="t"))
        frame.attrs["units"] = dict(self.units)
        return frame

    def save(self, path: str | Path) -> None:
        """Writes a file that `fa.Data.load` reads, and others do: .csv (or .txt: the same), .h5 (or .hdf5: a data set
        each, with an attribute "unit"), .mat (of MATLAB 5: a vector each, and names and units in `flexarm`), .npz.

        Raises:
            ValueError: another suffix, a name that such a file cannot hold, or where nothing can be written.
        """
        write_columns(path, {"t": ("s", self.t), **{n: (self.units[n], y) for n, y in self.columns.items()}})


def constant(y: Array) -> bool:
    """Whether a signal says nothing, but for rounding."""
    most = np.abs(y).max(initial=0.0)
    return bool(not most or np.ptp(y / most) <= 1e-12)
