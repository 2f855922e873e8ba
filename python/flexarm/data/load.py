"""Data from files and data frames, checked."""

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np

from .._check import Array, choice, path_of, positive, warn
from . import files, logs, text
from .signal import DataWarning, check_times
from .store.files import Refused, readable
from .units import heading, unit, unit_of

TEXT = (".csv", ".txt", ".tsv", ".dat", ".asc")
MISSING = ("error", "drop")
_TIMES = ("t", "time", "times", "timestamp")

NONE: Mapping[str, str] = MappingProxyType({})

D = TypeVar("D")  # Data, which is made of times, columns, units and a name

#: How the values of a column are got, once it is known that they are wanted.
Get = Callable[[str], Any]


class Loaded:
    """The reader of `Data`, its subclass, which is made of times, columns, units and a name."""

    @classmethod
    def load(
        cls: type[D],
        source: Any,
        *,
        columns: Iterable[str] | None = None,
        time: str | None = None,
        rate: float | None = None,
        units: Mapping[str, str] | None = None,
        key: str | None = None,
        missing: str = "error",
    ) -> D:
        """Reads signals over time, with names and units, in SI.

        A heading tells name and unit: "theta [deg]", "theta (deg)", or "theta_deg" where the part after the last
        underscore is a common unit ("ms" is m/s after a speed's name, "speed_ms", and else milliseconds); a text file
        may have a line of units below the names. Without a unit, a column counts as SI, its times as s. Units are
        products of powers of s, rad, deg, m, N, g (gravity), A, V, Hz, ... with prefixes, and rpm, %, °C, ...: an
        unknown one is an error that lists those known.

        Args:
            source: the path of a file, by suffix, or a pandas DataFrame.
                .csv, .txt, .tsv, .dat: cells parted by tabs, semicolons, commas or white space, with decimal points or
                (not between commas) decimal commas. Lines that begin with #, % or // are comments; the last one before
                the numbers may hold the names. UTF-8, UTF-16 with its mark, else Windows' Latin letters.
                .h5, .hdf5: data sets, of which an attribute "unit" or "units" tells the unit.
                .mat: variables or the fields of a structure; up to MATLAB 7.3.
                .npz: arrays. In the last three, a matrix x is columns x_0, x_1, ..., dates count in s from the first,
                and one number or word alone is left out.
                .mcap, .db3, or the folder of a bag: a topic of a log of ROS 2 (pip install 'flexarm[ros]'), in SI.
                sensor_msgs/JointState has columns position/JOINT, velocity/JOINT and effort/JOINT, others the paths of
                their numbers, such as wrench/force/x. Times are those of the headers, else of the log, since the
                log's beginning; those of a simulated clock stay as they are.
                A DataFrame's index gives the times where it has a name, or holds dates or durations.
            columns: names to keep (as in the heading, with or without the unit); None: all.
            time: the name of the times; None: "t", "time", "timestamp", or the only column in seconds.
            rate: samples a second (Hz), where there are no times: they begin at 0.
            units: units by name that count instead of the heading's, such as {"tau_m": "N m"}; "" is none.
            key: the group of a HDF5 file, or the variable of a .mat; None: all there is. The topic of a log; None:
                the only one of joints, or of all.
            missing: of nan, inf and empty cells: "error", or "drop" the rows with one in any column kept.

        Returns:
            Data: `.t`, `["name"]`, `.units`, in the order of the file.

        Raises:
            ValueError: no such file, another kind, one that is damaged or cut short; no such topic; columns missing, of
                different lengths, alike; lines with another number of cells; no numbers, nan (all with row or line, and
                column); times that do not increase; unknown units.
            (DataWarning: gaps in time, with the longest, where; arrays of a file that are no columns (complex, text,
            three axes, sparse, links), with the reason, unless `columns` says that this is meant.)
        """
        choice("missing", missing, MISSING)
        if isinstance(columns, str):
            raise ValueError(f"columns = {columns!r}: must be a list of names")
        if units is not None and not isinstance(units, Mapping):
            raise ValueError(f"units = {units!r}: must be units by name, such as {{'theta': 'deg'}}")
        for name, of in (units or {}).items():
            unit_of(name, of)
        if rate is not None:
            positive("rate", rate, "Hz")
        take = partial(_made, cls, wanted=columns, time=time, rate=rate, given=dict(units or {}), missing=missing)
        if _is_frame(source):
            if key is not None:
                raise ValueError(f"key = {key!r}: a DataFrame has none")
            try:
                found = take(*_of_frame(source), "")
            except Refused as e:
                raise ValueError(f"data frame: {e}") from None
            left: dict[str, str] = {}
        else:
            found, left = _from_file(source, key, take)
        if left and columns is None:
            text = f"data {Path(source).name!r}: leaves out {_said(left)}; columns= says that this is meant"
            warn(text, DataWarning)
        _tell_gaps(found)
        return found


def _said(left: Mapping[str, str]) -> str:
    return ", ".join(f"'{name}', which {why}" for name, why in left.items())


def _from_file(source: Any, key: str | None, take: Callable[..., D]) -> tuple[D, dict[str, str]]:
    """Data, and by name why something in the file is none."""
    path = path_of("path", source, ", or a pandas DataFrame")
    suffix = path.suffix.lower()
    known = (*TEXT, *files.HDF5, *files.MAT, *files.NPZ, *logs.LOGS)
    logged = suffix in logs.LOGS or (path / "metadata.yaml").exists()
    if suffix not in known and not logged:
        bag = "be the folder of a bag of ROS 2, with metadata.yaml"
        raise ValueError(f"path = {str(path)!r}: must end in {', '.join(known)}, or {bag}; or give a pandas DataFrame")
    if key is not None and suffix not in (*files.HDF5, *files.MAT) and not logged:
        raise ValueError(f"key = {key!r}: only HDF5, .mat and logs of ROS 2 have groups, variables and topics")
    with readable("data", path, "a whole log of ROS 2" if logged else f"a table of columns ({suffix})"):
        if suffix in TEXT:
            table = text.read_table(path)
            gets = [partial(table.column, k) for k in range(len(table.headings))]
            heads = [(h, u, g) for (h, u), g in zip(text.columns_of(table), gets, strict=True)]
            return take(heads, lambda k: f"line {table.lines[k]}", path.name), {}
        if logged:
            raw = logs.read_log(path, key)
        elif suffix in files.HDF5:
            raw = files.read_hdf5(path, key)
        else:
            raw = files.read_mat(path, key) if suffix in files.MAT else files.read_npz(path)
        heads = [(h, u, partial(_numbers, x)) for h, (x, u) in raw.items() if not isinstance(x, str)]
        left = {h: x for h, (x, _) in raw.items() if isinstance(x, str)}
        return take(heads, lambda k: f"row {k}", path.name, left), left


def _numbers(values: Any, name: str) -> Array:
    return np.array(values, dtype=float)


# -- data frames -------------------------------------------------------------------------------------------------------


def _is_frame(source: Any) -> bool:
    return all(hasattr(source, k) for k in ("columns", "index", "iloc", "attrs"))


def _of_frame(frame: Any) -> tuple[list[tuple[str, str | None, Get]], Callable[[int], str]]:
    told, index = dict(frame.attrs.get("units", {})), frame.index
    heads: list[tuple[str, str | None, Get]] = []
    if getattr(index.dtype, "kind", "O") in "Mm":
        heads.append(("t", "s", lambda name: files.seconds(index)))
    elif isinstance(index.name, str) or (getattr(index.dtype, "kind", "O") == "f" and index.name is None):
        name = index.name or "t"
        heads.append((name, told.get(name), partial(_of_series, index.to_series())))
    for k, label in enumerate(frame.columns):
        name = label if isinstance(label, str) else " ".join(map(str, label)) if type(label) is tuple else str(label)
        heads.append((name, told.get(name), partial(_of_series, frame.iloc[:, k])))
    return heads, lambda k: f"row {k}"


def _of_series(series: Any, name: str) -> Array:
    if getattr(series.dtype, "kind", "O") in "Mm":
        return files.seconds(series.reset_index(drop=True))
    if getattr(series.dtype, "kind", "O") == "c":
        raise Refused(f"column '{name}' is complex: give its real and imaginary parts, or leave it out by columns=")
    try:
        return np.array(series.to_numpy(dtype=float, na_value=np.nan), dtype=float)
    except (TypeError, ValueError):
        for k, x in enumerate(series):
            try:
                float(x)
            except (TypeError, ValueError):
                raise Refused(f"column '{name}', row {k}: {x!r} is not a number; columns= can leave it out") from None
        raise


# -- checks ------------------------------------------------------------------------------------------------------------


def _made(
    make: Callable[..., D], heads: list[tuple[str, str | None, Get]], place: Callable[[int], str], source: str,
    left: Mapping[str, str] = NONE, *,
    wanted: Iterable[str] | None, time: str | None, rate: float | None, given: dict[str, str], missing: str,
) -> D:  # fmt: skip
    """Data of columns (heading, unit or None, how to get the values); `left` has the reasons why others are
    none. Refused or ValueError for errors."""
    for name in [] if wanted is None else (wanted := list(wanted)):
        if name in left:
            raise Refused(f"columns: '{name}' {left[name]}")
    found = _named(heads, given)
    kept = None if wanted is None else [_find(name, found, "columns") for name in wanted]
    clock = _clock(found, kept, time, rate, left)
    if kept is None:
        kept = list(found)
    names = [name for name in kept if name != clock]
    values = {name: found[name][2](name) for name in ([clock] if clock else []) + names}
    t, values = _equally_long(values, clock, rate)
    if clock is not None:
        of = unit_of(clock, found[clock][1])
        if of.si not in ("s", ""):
            raise Refused(f"column '{clock}' is in {of.si}: times must be in s, ms, ...")
        t = t * of.scale
    t, values, rows = _without_missing(t, values, clock or "t", place, missing)
    try:
        check_times(t, lambda k: place(int(rows[k])))
        return make(t, values, {name: found[name][1] for name in names}, source)
    except ValueError as e:
        raise Refused(str(e)) from None


Found = dict[str, tuple[str, str, Get]]  # heading, unit and values by name


def _named(heads: list[tuple[str, str | None, Get]], given: dict[str, str]) -> Found:
    """Columns by name."""
    found: Found = {}
    used = set()
    for head, of, get in heads:
        name, told = heading(head)
        bracketed = head.rstrip().endswith(("]", ")"))
        if of is not None or (head in given and not bracketed):
            name, told = head, ""  # its last word is no unit: the unit stands elsewhere
        key = head if head in given else name
        used.add(key)
        told = given.get(key, told if of is None else of)
        if name in found:
            raise Refused(f"columns '{found[name][0]}' and '{head}' have the same name '{name}'")
        found[name] = (head, told, get)
    for lost in given:
        if lost not in used:
            _find(lost, found, "units")
    return found


def _find(name: str, found: Found, where: str) -> str:
    """The name of a column, of which the heading may be given too."""
    heads = {head: n for n, (head, _, _) in found.items()}
    if name in heads and name not in found:
        return heads[name]
    if name in found:
        return name
    raise Refused(f"{where}: has no column '{name}'; there are {', '.join(found) or 'none'}")


def _clock(
    found: Found, kept: list[str] | None, time: str | None, rate: float | None, left: Mapping[str, str]
) -> str | None:
    """The column of times; None where a rate tells them."""
    if rate is not None:
        if time is not None:
            raise Refused(f"time = {time!r} and rate = {rate:g}: one of them tells the times")
        return None
    if time is not None:
        return _find(time, found, "time")
    in_time = [name for name, (_, of, _) in found.items() if of and _is_time(of)]
    called = [name for name in found if name.lower() in _TIMES]
    named = [name for name in called if name in in_time] or called or in_time
    if len(named) != 1:
        others = f", besides {_said(left)}" if left else ""
        none = f"no column of times: there are {', '.join(found) or 'none'}{others}"
        many = f"times may be {' or '.join(named)}" if named else none
        raise Refused(f"{many}; tell time='NAME', or rate= (Hz) where the file has none")
    return named[0]


def _is_time(of: str) -> bool:
    try:
        return bool(unit(of).si == "s")
    except ValueError:
        return False


def _equally_long(
    values: dict[str, Array], clock: str | None, rate: float | None
) -> tuple[Array, dict[str, Array]]:
    """Times and the other columns."""
    if clock is None:
        count = max((len(x) for x in values.values()), default=0)
        assert rate is not None
        t = np.arange(count) / rate
    else:
        t = values.pop(clock)
    values = {k: x for k, x in values.items() if len(x) > 1 or len(t) == 1}
    for name, x in values.items():
        if len(x) != len(t):
            raise Refused(f"column '{name}' has {len(x)} rows, and the times have {len(t)}; columns= can leave it out")
    if not len(t):
        raise Refused("is empty: it has no rows")
    return t, values


def _without_missing(
    t: Array, values: dict[str, Array], clock: str, place: Callable[[int], str], missing: str
) -> tuple[Array, dict[str, Array], Any]:
    """The same without rows that hold nan or inf, and which rows are left; Refused where these are an error."""
    bad = np.zeros(len(t), bool)
    for name, x in {clock: t, **values}.items():
        odd = ~np.isfinite(x)
        if odd.all() and np.isnan(x).all():
            raise Refused(f"column '{name}' is empty: no row has a value; columns= can leave it out")
        if odd.any() and missing == "error":
            k, more = int(np.argmax(odd)), int(odd.sum()) - 1
            others = f" (and {more} more of its rows)" if more else ""
            raise Refused(f"column '{name}', {place(k)}: {x[k]}{others}; missing='drop' leaves such rows out")
        bad |= odd
    rows = np.flatnonzero(~bad)
    if not rows.size:
        raise Refused("has no row without a missing value; columns= can leave columns out")
    return t[rows], {k: x[rows] for k, x in values.items()}, rows


def _tell_gaps(data: Any) -> None:
    gaps = data.gaps()
    if len(gaps):
        begin, length = gaps[np.argmax(gaps[:, 1])]
        count = "a gap in time" if len(gaps) == 1 else f"{len(gaps)} gaps in time, the longest"
        text = f"data {data.name!r}: {count}: {length:.6g} s after t = {begin:.6g} s; rows are {data.step:.6g} s apart"
        warn(text, DataWarning)
