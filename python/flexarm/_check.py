"""Checks at the door: arrays of the right shape, finite numbers, and errors in words."""

import difflib
import math
import os
import sys
import warnings
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
_NEAR = 0.6  # part of the letters that agree, as in difflib.get_close_matches
_HERE = os.path.dirname(__file__) + os.sep


def outside() -> int:
    """The `stacklevel` with which a warning points at the line that called the package, whatever files of the package
    lie between (as `skip_file_prefixes` of Python 3.12)."""
    level, frame = 1, sys._getframe(1)
    while frame.f_back is not None and (frame.f_code.co_filename.startswith(_HERE) or _of_dataclass(frame.f_code)):
        level, frame = level + 1, frame.f_back
    return level


def _of_dataclass(code: Any) -> bool:
    """Whether it is the `__init__` of a dataclass, which stands in no file."""
    return bool(code.co_filename == "<string>" and code.co_name == "__init__")


def warn(message: str | Warning, kind: type[Warning] | None = None) -> None:
    """Warns at the line that called the package."""
    warnings.warn(message, kind, stacklevel=outside())


def plain(value: Any, depth: int = 0) -> Any:
    """NumPy's numbers, strings and arrays as Python's own and tuples; all else, such as a masked value, as it is."""
    if isinstance(value, np.ndarray) and value is not np.ma.masked:
        return plain(value[()]) if value.ndim == 0 else tuple(plain(v) for v in value)
    if isinstance(value, np.floating):
        return float(value)  # item() leaves a long double one
    if type(value) in (list, tuple) and depth < 8:  # no argument is nested deeper
        return type(value)([plain(v, depth + 1) for v in value])
    return value.item() if isinstance(value, np.generic) else value


def unmasked(field: str, value: Any) -> Any:
    """The value, unless it is a masked array, or has one in it, with a masked value: NumPy takes what is below for a
    number."""
    at = None if type(value) is np.ndarray else _masked(value)
    if at is not None:
        place = f"{field}[{', '.join(map(str, at))}]" if at else field
        raise ValueError(f"{place} is masked: must be a number; fill it, as value.filled(0.0) does, or leave it out")
    return value


def _masked(value: Any) -> tuple[int, ...] | None:
    """Where the first masked value is."""
    if isinstance(value, np.ma.MaskedArray):
        return next(map(tuple, np.argwhere(np.ma.getmask(value)).tolist()), None)
    if isinstance(value, (list, tuple)) and not {float, int}.issuperset(map(type, value)):
        return next(((i, *at) for i, v in enumerate(value) if (at := _masked(v)) is not None), None)
    return None


def number(field: str, value: Any) -> float:
    """A finite-or-not float; the sign and range are checked by the core."""
    value = plain(value)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ValueError(f"{field} = {value!r}: must be a number")
    try:
        return float(value)
    except OverflowError:
        raise ValueError(f"{field} = {value!r}: is too large") from None


def whole(field: str, value: Any) -> int:
    value = plain(value)
    if isinstance(value, bool) or not isinstance(value, int):
        raise ValueError(f"{field} = {value!r}: must be a whole number")
    if abs(int(value)) >= 2**31:
        raise ValueError(f"{field} = {value!r}: is too large")
    return int(value)


def finite_number(field: str, value: Any) -> float:
    x = number(field, value)
    if not math.isfinite(x):
        raise ValueError(f"{field} = {value!r}: must be finite")
    return x


def positive(field: str, value: Any, unit: str = "") -> float:
    """A finite number above 0; `unit`, if given, stands in the error."""
    x = number(field, value)
    if not 0.0 < x < math.inf:
        raise ValueError(f"{field} = {value!r}: must be positive and finite{unit and f' ({unit})'}")
    return x


def not_negative(field: str, value: Any, unit: str = "") -> float:
    """A finite number from 0."""
    x = number(field, value)
    if not 0.0 <= x < math.inf:
        raise ValueError(f"{field} = {value!r}: must not be negative, and be finite{unit and f' ({unit})'}")
    return x


def at_least(field: str, value: Any, least: int, more: str = "") -> int:
    """A whole number from `least`."""
    if whole(field, value) < least:
        raise ValueError(f"{field} = {value!r}: must be at least {least}{more}")
    return int(value)


def within(field: str, value: Any, low: float, high: float, more: str = "") -> Any:
    """A number from `low` to `high`; `more` is added to the error."""
    if not low <= number(field, value) <= high:
        raise ValueError(f"{field} = {value!r}: must be from {low:g} to {high:g}{more}")
    return plain(value)


def between(field: str, value: Any, low: float, high: float, more: str = "") -> float:
    """A number above `low` and below `high`; `more` is added to the error."""
    x = number(field, value)
    if not low < x < high:
        raise ValueError(f"{field} = {value!r}: must be above {low:g} and below {high:g}{more}")
    return x


def flag(field: str, value: Any) -> bool:
    value = plain(value)
    if not isinstance(value, bool):
        raise ValueError(f"{field} = {value!r}: must be true or false")
    return bool(value)


def instance(field: str, value: Any, kind: type | tuple[type, ...], words: str = "") -> Any:
    """A value of a class, or of one of several; the error names these, or says `words`."""
    if not isinstance(value, kind):
        names = [k.__name__ for k in (kind if isinstance(kind, tuple) else (kind,))]
        *others, last = ("None" if k == "NoneType" else f"{'an' if k[0] in 'AEIO' else 'a'} {k}" for k in names)
        said = f"{', '.join(others)} or {last}" if others else last
        raise ValueError(f"{field} = {value!r}: must be {words or said}")
    return value


def instances(field: str, value: Any, kind: type | tuple[type, ...], words: str, least: int = 0) -> tuple[Any, ...]:
    """The values of a class, or of one of several, from a list of them; `words` names them in errors."""
    if not isinstance(value, Collection) or isinstance(value, (str, bytes)) or len(value) < least:
        raise ValueError(f"{field} = {value!r}: must be a list of {words}{', one or more' * (least > 0)}")
    return tuple(instance(f"{field}[{k}]", x, kind) for k, x in enumerate(value))


def mapping(field: str, value: Any, words: str) -> dict[Any, Any]:
    """A dictionary, empty for None; `words` go on after "must be a dictionary" in the error."""
    if value is not None and not isinstance(value, Mapping):
        raise ValueError(f"{field} = {value!r}: must be a dictionary{words}")
    return dict(value or {})


def array(
    field: str, value: ArrayLike | None, shape: tuple[int, ...] | None = None, batch_ndim: int | None = None
) -> Array:
    """A finite, C-contiguous float64 array, of the given shape if one is given. Where it has `batch_ndim` axes or more,
    the first counts scenarios."""
    if value is None:
        want = "numbers" if shape is None else "one number" if shape in ((), (1,)) else f"{shape[0]} numbers"
        asked = "; does its function return its value?" if " at t = " in field else ""
        raise ValueError(f"{field} = None: must be {want}{asked}")
    unmasked(field, value)
    try:
        if getattr(value, "dtype", None) != np.float64 and np.iscomplexobj(value):
            raise TypeError
        out = np.array(value, dtype=np.float64, order="C")
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{field} = {value!r}: must be numbers") from None
    if shape is not None and out.shape != shape:
        want = f"shape {shape}" if len(shape) != 1 else "one number" if shape == (1,) else f"{shape[0]} numbers"
        raise ValueError(f"{field} has shape {out.shape}: must be {want}")
    check_finite(field, out, batch_ndim is not None and out.ndim >= batch_ndim)
    return out


def increasing(field: str, value: Any) -> Array:
    """Two numbers or more that increase, (n,)."""
    x = array(field, value)
    if x.ndim != 1 or x.size < 2:
        raise ValueError(f"{field} has shape {x.shape}: must be one list of at least two numbers")
    bad = np.flatnonzero(np.diff(x) <= 0)
    if bad.size:
        raise ValueError(f"{field}[{bad[0] + 1}] = {x[bad[0] + 1]}: {field} must be numbers that increase")
    return x


def for_each(field: str, value: Any, count: int, whom: str) -> Array:
    """`count` numbers, (count,), from these, or from one that holds for each; `whom` says for whom."""
    x = array(field, value)
    if x.shape not in ((), (count,)):
        raise ValueError(f"{field} has shape {x.shape}: must be one number, or {count}, one for each {whom}")
    return np.broadcast_to(x, (count,))


def check_finite(field: str, values: Array, scenarios: bool = False) -> None:
    """ValueError for nan and inf: of a few numbers with all of them, of many with the first and where it stands, its
    first axis being `scenarios`."""
    if math.isfinite(_quick(values)):
        return
    good = np.isfinite(values)
    if good.all():
        return
    at = tuple(np.argwhere(~good)[0].tolist())
    few = values.ndim < 2 and values.size <= 8 and not scenarios
    where = f"{field} = {values.tolist()}" if few else f"{field}[{', '.join(map(str, at))}] = {values[at]}"
    whose = f" (scenario {at[0]})" if scenarios else ""
    raise ValueError(f"{where}{whose}: must be finite, no nan or inf")


_ALONE = 8192  # numbers that BLAS takes without threads; those wait busily for more, tens of milliseconds long


def _quick(values: Array) -> float:
    """A number that is finite only if all values are, and nearly always then."""
    if values.size <= _ALONE:
        return float(np.vdot(values, values))
    with np.errstate(over="ignore", invalid="ignore"):
        return float(values.sum())


def finite(name: str, values: Array) -> Array:
    """The result of a computation, unless it overflowed."""
    if not math.isfinite(_quick(values)) and not np.isfinite(values).all():
        raise ValueError(f"{name}: is not finite; the coordinates or rates are too large")
    return values


def batch(sizes: Mapping[str, int], **named: ArrayLike) -> list[Array]:
    """Arrays (..., n), broadcast over their leading axes."""
    arrays = []
    for field, value in named.items():
        a = array(field, value)
        n = sizes[field]
        if a.ndim == 0 or a.shape[-1] != n:
            raise ValueError(f"{field} has shape {a.shape}: the last axis must be {n} long")
        arrays.append(a)
    try:
        lead = np.broadcast_shapes(*(a.shape[:-1] for a in arrays))
    except ValueError:
        shapes = ", ".join(f"{k} {a.shape}" for k, a in zip(named, arrays, strict=True))
        raise ValueError(f"leading axes do not fit each other: {shapes}") from None
    return [np.ascontiguousarray(np.broadcast_to(a, (*lead, a.shape[-1]))) for a in arrays]


def known_keys(where: str, given: Mapping[str, Any], known: Iterable[str]) -> None:
    """ValueError that names the nearest known key, or keys where several are as near."""
    if not isinstance(given, Mapping):
        raise ValueError(f"{where} = {given!r}: must be a table")
    known = dict.fromkeys(known)
    for key in given:
        if key not in known:
            distance = {k: -difflib.SequenceMatcher(None, k, str(key)).ratio() for k in known}
            near = [f"'{k}'" for k in known if distance[k] == min(distance.values()) <= -_NEAR]
            hint = f"did you mean {' or '.join(near)}?" if near else f"known are {', '.join(known) or 'none'}"
            raise ValueError(f"{where}: unknown key '{key}'; {hint}")


def path_of(field: str, value: Any, words: str = "") -> Path:
    """A path, from itself or text."""
    if not isinstance(value, (str, Path)):
        raise ValueError(f"{field} = {value!r}: must be a path{words}")
    return Path(value)


def named(path: Any, *suffixes: str) -> Path:
    """The path of a file to be written, whose name does not promise another format."""
    if path_of("path", path).suffix.lower() not in ("", *suffixes):
        raise ValueError(f"path = {str(path)!r}: must end in {' or '.join(suffixes)}, the format that is written")
    return Path(path)


def choice(field: str, value: Any, known: Iterable[str]) -> str:
    known = tuple(known)
    value = value if type(value) is str else plain(value)
    if isinstance(value, str) and value in known:
        return value
    near = difflib.get_close_matches(str(value), known, n=1)
    hint = f"; did you mean '{near[0]}'?" if near else ""
    raise ValueError(f"{field} = {value!r}: must be one of {', '.join(known)}{hint}")


def tilde(v: Any) -> Array:
    """v~ of v~ u = v x u (Eq. 2), (3, 3)."""
    return np.cross(np.eye(3), v)
