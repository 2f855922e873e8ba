"""Tables of columns in files of HDF5, MATLAB and NumPy: written with their units, and read, whoever wrote them."""

import hashlib
import json
import re
from collections.abc import Callable, Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from .._check import Array, named
from .._console import csv_text
from .store.files import Refused, check_digest, digest, label, sealed, texts, unsealed, write_whole, zipped
from .units import titled

CSV, HDF5, MAT, NPZ = (".csv", ".txt"), (".h5", ".hdf5"), (".mat",), (".npz",)
SUFFIXES = (*CSV, *HDF5, *MAT, *NPZ)

_MAT_HEAD = 116  # bytes of text
_NO_NUMBERS = ("char", "cell", "function_handle", "struct")  # classes of MATLAB
_LINK = "is a link to elsewhere, which is not followed"
_OF_MANY = "is of a batch or of an older flexarm: fa.BatchResult.load(...)[k] or fa.Result.load(...) has .to_data()"

#: Name and unit of each column of an array, by the array's name.
Titles = Mapping[str, Sequence[tuple[str, str]]]

#: Values by heading, each with its unit where the file has a place for it, else None; if it is no column, instead of
#: values, a text that says why.
Raw = dict[str, tuple[Any, str | None]]


# -- out ---------------------------------------------------------------------------------------------------------------


def with_suffix(path: Any, *suffixes: str) -> Path:
    """The path of a file whose suffix says in which format it is written."""
    if isinstance(path, (str, Path)) and not Path(path).suffix:
        raise ValueError(f"path = {str(path)!r}: must end in {' or '.join(suffixes)}, the format that is written")
    return named(path, *suffixes)


def write_columns(path: Any, columns: Mapping[str, tuple[str, Array]]) -> None:
    """Columns (unit, values) by name, in the format of the path's suffix. ValueError of an unknown one, or where it
    cannot be written."""
    file = with_suffix(path, *SUFFIXES)
    kind = file.suffix.lower()
    for name in columns:
        if name != name.strip() or re.search("[\x00-\x1f\x7f-\x9f\ud800-\udfff]", name):
            raise ValueError(f"columns: {name!r} has blanks at its ends or control characters, no name for a file")
    if kind in CSV:
        text = csv_text([titled(name, of) for name, (of, _) in columns.items()], [y for _, y in columns.values()])
        write_whole(file, lambda f: f.write(text.encode()), "path")
    elif kind in MAT:
        _write_mat(file, columns)
    else:
        arrays, titles = {k: y for k, (_, y) in columns.items()}, {k: [(k, of)] for k, (of, _) in columns.items()}
        (write_hdf5 if kind in HDF5 else write_npz)(file, arrays, titles, None)


def write_hdf5(path: Path, arrays: Mapping[str, Array], titles: Titles, about: Any) -> None:
    """Arrays by name. A vector with a title has its unit in an attribute "unit", a matrix the names and units of its
    columns in "columns" and "units"; `about`, unless it is None, is a data set, in JSON. The file's attribute "digest"
    is of both."""
    import h5py

    def check(name: str) -> str:
        parts = name.split("/")
        if {"", "."} & set(parts) or any("/".join(parts[:k]) in arrays for k in range(1, len(parts))):
            raise ValueError(f"columns: {name!r} is no name for HDF5, where 'a/b' is 'b' in the group 'a'")
        return name

    made = BytesIO()  # HDF5 cannot close a file on a full disk, and the process would crash
    # a version whose own tables have checksums, and whose attributes may be long
    with h5py.File(made, "w", libver=("v108", "v108"), track_order=True) as f:
        f.attrs["digest"] = digest(about, arrays)
        if about is not None:
            f["about"] = texts([json.dumps(about)])
        for name, x in arrays.items():
            packed = {"fletcher32": True, "compression": "gzip"} if x.size else {}
            label(f.create_dataset(check(name), data=x, **packed), titles.get(name, ()))
    write_whole(path, lambda file: file.write(made.getbuffer()), "path")


def write_npz(path: Path, arrays: Mapping[str, Array], titles: Titles, about: Any) -> None:
    """Arrays by name, and "about", in JSON, which holds their titles, too."""
    if lost := {"about", "file"} & set(arrays):
        raise ValueError(f"columns: {min(lost)!r} is no name for a column of an .npz")
    words = sealed({**(about or {}), "columns": {k: titles[k] for k in arrays if k in titles}}, arrays)
    held: dict[str, Any] = {"about": np.array(words), **arrays}
    write_whole(path, lambda f: np.savez_compressed(f, **held), "path")


def _write_mat(path: Path, columns: Mapping[str, tuple[str, Array]]) -> None:
    """MATLAB takes letters, digits and underscores for a name, 63 at most: the true names stand beside."""
    from scipy.io import savemat

    held: dict[str, Any] = {}
    for name, (_, y) in columns.items():
        word = re.sub(r"\W", "_", name, flags=re.ASCII)[:63]
        word = word if word[0].isalpha() else f"x{word}"[:63]
        while word in held or word == "flexarm":
            word = f"{word[:58]}_{len(held)}"
        held[word] = y[:, None]
    names, units = np.empty((len(held), 1), object), np.empty((len(held), 1), object)
    names[:, 0], units[:, 0] = list(columns), [of for of, _ in columns.values()]
    variables = np.empty((len(held), 1), object)
    variables[:, 0] = list(held)
    whole, made = {"flexarm": {"variables": variables, "names": names, "units": units}, **held}, BytesIO()
    savemat(made, whole, long_field_names=True, do_compression=True)
    rest = made.getvalue()[_MAT_HEAD:]
    write_whole(path, lambda f: f.write(_mat_head(rest) + rest), "path")


def _mat_head(rest: bytes) -> bytes:
    """The text that a file of MATLAB begins with, here with the SHA-256 of the rest."""
    return f"MATLAB 5.0 MAT-file, flexarm, SHA-256 {hashlib.sha256(rest).hexdigest()}".ljust(_MAT_HEAD).encode()


# -- in ----------------------------------------------------------------------------------------------------------------


def _spread(name: str, values: Any, titles: Any = None) -> Raw:
    """A variable as columns: a vector is one, a matrix (n, k) is k, called `name_0`, `name_1`, ... unless there are
    titles (name, unit). Dates are seconds from the first on. A text, or one number alone, is none."""
    if hasattr(values, "tocoo"):
        return {name: ("is a sparse matrix", None)}
    x = np.asarray(values)
    if x.dtype.names:  # a record array
        out: Raw = {}
        for k in x.dtype.names:
            out |= _spread(str(k), x[k])
        return out
    if x.size < 2 and not titles and (x.ndim != 1 or x.dtype.kind not in "fiub"):
        return {}
    if why := _no_column(x):
        return {name: (why, None)}
    if x.dtype.kind in "Mm":
        return {name: (seconds(x), "s")}
    if x.ndim == 2 and 1 in x.shape and not titles:
        x = x.ravel()
    if x.ndim == 1:
        title, of = titles[0] if titles else (name, None)
        return {title: (x, of)}
    if titles is None:
        return {f"{name}_{k}": (column, None) for k, column in enumerate(x.T)}
    return {title: (column, of) for (title, of), column in zip(titles, x.T, strict=True)}


def _no_column(x: Any) -> str:
    """Why an array is no column, nor several; "" if it is."""
    kind = x.dtype.kind
    if kind not in "fiubMm":
        words = {"c": "is complex: give its real and imaginary parts", "U": "is text", "S": "is text"}
        return words.get(kind, "holds objects, and no numbers")
    fits = (1,) if kind in "Mm" else (1, 2)
    return "" if x.ndim in fits else f"has {x.ndim} axes, {x.shape}: a column has one"


def seconds(stamps: Any) -> Array:
    """Dates or durations as times from the first on (s)."""
    return np.asarray(np.asarray(stamps - stamps[0]) / np.timedelta64(1, "ns") * 1e-9, dtype=float)


def read_npz(path: Path) -> Raw:
    """For use in `readable`."""
    held, titles = zipped(path), dict[str, Any]()
    if "about" in held and held["about"].dtype.kind == "U":
        about = unsealed(str(held.pop("about")), held)
        if "arm" in about and "columns" not in about:
            raise Refused(_OF_MANY)
        titles = about.get("columns", {})
    out: Raw = {}
    for name, x in held.items():
        out |= _spread(name, x, titles.get(name)) if name in titles or not titles else {}
    return out


def _text(value: Any) -> str:
    if isinstance(value, np.ndarray) and value.size < 2:
        value = value.reshape(-1)[0] if value.size else ""
    return value.decode() if isinstance(value, bytes) else str(value)


def read_hdf5(path: Path, key: str | None, matlab: bool = False) -> Raw:
    """The data sets of a group, and of those below it; links out of the file are not followed. In MATLAB's files,
    matrices lie transposed. For use in `readable`."""
    import h5py

    with h5py.File(path, "r") as f:
        if {"scenarios", "sealed"} & set(f.attrs):
            raise Refused(_OF_MANY)
        held = _held(f)[1] if "digest" in f.attrs else {}
        at = f
        for part in () if key is None else key.strip("/").split("/"):
            if not isinstance(at, h5py.Group) or part not in _members(at):
                raise Refused(f"key = {key!r}: there is no such group; there are {', '.join(_members(f)) or 'none'}")
            at = at[part]
        if isinstance(at, h5py.Dataset):
            return _of_dataset(key or "", at, matlab, held)
        while len(inner := _members(at)) == 1 and isinstance(at[inner[0]], h5py.Group):
            at = at[inner[0]]
        if (not held and {"axis0", "block0_values"} <= set(at)) or "pandas_type" in at.attrs:
            raise Refused("is of pandas' own kind: give fa.Data.load(pandas.read_hdf(...))")
        if "about" in at and _is_text(at["about"]):  # of Result.save: an array without titles is no column
            return _of_group("", at, matlab, held, lambda x: "unit" in x.attrs or "columns" in x.attrs)
        return _of_group("", at, matlab, held)


def read_arrays(content: bytes) -> tuple[dict[str, Any], dict[str, Array]]:
    """The content of `write_hdf5` or `write_npz`: "about", of JSON, and arrays by name. Errors of many kinds."""
    if not content.startswith(b"\x89HDF"):
        with np.load(BytesIO(content), allow_pickle=False) as z:
            arrays = {k: z[k] for k in z.files if k != "about"}
            return unsealed(str(z["about"]), arrays), arrays
    import h5py

    with h5py.File(BytesIO(content), "r") as f:
        return _held(f)


def _held(f: Any) -> tuple[Any, dict[str, Array]]:
    """The content of `write_hdf5`: "about", or None, and arrays by name. Refuses a damaged file."""
    arrays = _arrays(f)
    about = json.loads(arrays.pop("about")[0]) if "about" in f and _is_text(f["about"]) else None
    check_digest(f.attrs.get("digest"), about, arrays)
    return about, arrays


def _arrays(group: Any) -> dict[str, Array]:
    """All data sets of a group and those below it, by their paths in the file (a column's name may have a "/")."""
    import h5py

    out: dict[str, Array] = {}
    for x in (group[k] for k in _members(group)):
        if isinstance(x, h5py.Group):
            out |= _arrays(x)
        else:
            check_inside(x.name, x)
            out[x.name[1:]] = x[()]
    return out


def check_inside(name: str, x: Any) -> None:
    """Refuses a data set whose numbers lie in another file."""
    if x.id.get_create_plist().get_external_count() or x.is_virtual:
        raise Refused(f"{name!r} is stored outside of the file, where it is not read")


def _is_text(x: Any) -> bool:
    return bool(getattr(getattr(x, "dtype", None), "kind", "") == "S")


def _members(group: Any) -> list[str]:
    import h5py

    kept = group if "digest" in group.file.attrs else set(group) - {"#refs#", "#subsystem#"}  # MATLAB's own
    return [k for k in group if k in kept and isinstance(group.get(k, getlink=True), h5py.HardLink)]


def _of_group(
    before: str, group: Any, matlab: bool, held: Mapping[str, Array], wanted: Callable[[Any], bool] = lambda x: True
) -> Raw:
    import h5py

    links = set(group) - set(_members(group))
    out: Raw = {before + k: (_LINK, None) for k in sorted(links - {"#refs#", "#subsystem#"})}
    for k in _members(group):
        inner = group[k]
        if isinstance(inner, h5py.Group) and "MATLAB_sparse" in inner.attrs:
            out[before + k] = ("is a sparse matrix", None)
        elif isinstance(inner, h5py.Group):
            out |= _of_group(f"{before}{k}/", inner, matlab, held, wanted)
        elif wanted(inner):
            out |= _of_dataset(f"{before}{k}", inner, matlab, held)
    return out


def _of_dataset(name: str, x: Any, matlab: bool, held: Mapping[str, Array]) -> Raw:
    """Its columns; its values are in `held`, by paths in the file, if they have been read already."""
    check_inside(name, x)
    if matlab and (kind := _text(x.attrs.get("MATLAB_class", "double"))) in _NO_NUMBERS:
        return {} if kind == "char" else {name: (f"is a {kind} of MATLAB", None)}
    read = held[x.name[1:]] if x.name[1:] in held else x[()]
    values = read.T if matlab else read
    if "columns" in x.attrs:
        names, units = (np.atleast_1d(x.attrs.get(k, [])) for k in ("columns", "units"))
        padded = [*map(_text, units), *[None] * (len(names) - len(units))]
        return _spread(name, values, list(zip(map(_text, names), padded, strict=True)))
    of = next((_text(x.attrs[k]) for k in ("unit", "units", "Unit", "Units") if k in x.attrs), None)
    if of is None:
        return _spread(name, values)
    return {title: (column, of) for title, (column, _) in _spread(name, values).items()}


def read_mat(path: Path, key: str | None) -> Raw:
    """MATLAB's files, up to version 7 by SciPy, of 7.3 by h5py. For use in `readable`."""
    from scipy.io import loadmat

    content = path.read_bytes()
    if content[512:520] == b"\x89HDF\r\n\x1a\n":
        return read_hdf5(path, key, matlab=True)
    head, rest = content[:_MAT_HEAD], content[_MAT_HEAD:]
    if (b"flexarm" in head or b"SHA-256" in head) and head != _mat_head(rest):  # SciPy may crash on a damaged file
        raise Refused("is damaged: its checksum does not fit")
    held = {k: x for k, x in loadmat(BytesIO(content), struct_as_record=True).items() if not k.startswith("__")}
    ours = held.pop("flexarm", None)
    if key is not None:
        if key not in held:
            raise Refused(f"key = {key!r}: there is no such variable; there are {', '.join(held) or 'none'}")
        held = {key: held[key]}
    if len(held) == 1 and _is_struct(only := next(iter(held.values()))):
        held = {k: only[k].reshape(-1)[0] for k in only.dtype.names}
    titles: dict[str, Any] = {}
    if ours is not None and _is_struct(ours) and {"variables", "names", "units"} <= set(ours.dtype.names):
        parts = [[_text(x) for x in ours[k].reshape(-1)[0].ravel()] for k in ("variables", "names", "units")]
        titles = {variable: [(name, of)] for variable, name, of in zip(*parts, strict=True)}
    return _of_variables("", held, titles)


def _is_struct(x: Any) -> bool:
    return isinstance(x, np.ndarray) and x.dtype.names is not None and x.dtype.kind == "V" and x.size == 1


def _of_variables(before: str, held: Mapping[str, Any], titles: Mapping[str, Any]) -> Raw:
    out: Raw = {}
    for k, x in held.items():
        if _is_struct(x):
            out |= _of_variables(f"{before}{k}/", {n: x[n].reshape(-1)[0] for n in x.dtype.names}, {})
        else:
            out |= _spread(f"{before}{k}", x.ravel() if k in titles else x, titles.get(k))
    return out
