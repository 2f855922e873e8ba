"""Tables of data drawn at random: what is saved is what is loaded, and what NumPy, h5py and SciPy read; tables as
others write them; damaged files."""

from __future__ import annotations

import csv
import sys
import warnings
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from hypothesis import assume
from hypothesis import strategies as st

sys.path.insert(0, str(Path(__file__).parent))

from scenes import SEEDS, drawn, note

pytestmark = pytest.mark.filterwarnings("ignore::flexarm.errors.DataWarning")

#: in SI, and what one of it is there
UNITS = {"rad": ("rad", 1.0), "deg": ("rad", np.pi / 180), "N m": ("N m", 1.0), "mm": ("m", 1e-3), "mA": ("A", 1e-3),
         "rpm": ("rad/s", np.pi / 30), "deg/s": ("rad/s", np.pi / 180), "%": ("1", 0.01), "kPa": ("Pa", 1e3),
         "g": ("m/s^2", 9.80665)}  # fmt: skip
SIGNS = st.sampled_from("abcXYZ019_ .-;/éπ%(),'\"#[]")
LETTERS = st.text(SIGNS, min_size=1, max_size=12).map(lambda x: x.strip() or "x")
NAMES = st.lists(LETTERS, min_size=1, max_size=4, unique=True)
SUFFIXES = st.sampled_from([".csv", ".txt", ".h5", ".mat", ".npz"])


def numbers(rng: np.random.Generator, n: int) -> np.ndarray:
    """Of any size, whole or not."""
    kinds = [rng.normal(size=n), np.round(rng.normal(size=n) * 100), 10.0 ** rng.uniform(-100, 100, n), np.zeros(n)]
    return kinds[rng.integers(len(kinds))]


def times(rng: np.random.Generator, n: int) -> np.ndarray:
    steps = np.ones(n) if rng.random() < 0.5 else rng.uniform(0.1, 2, n)
    return np.cumsum(rng.choice([1e-3, 1e-2, 0.5]) * steps) + rng.normal()


def table(rng: np.random.Generator, names: list[str], least: int = 1) -> fa.Data:
    n = int(rng.integers(least, 30))
    units = {name: str(rng.choice(["", "1", "rad", "m/s^2", "N m", "V"])) for name in names}
    return fa.Data(times(rng, n), {name: numbers(rng, n) for name in names}, units)


def seen_by_others(path: Path) -> list[np.ndarray]:
    """Columns as another library reads them, the times first."""
    if path.suffix == ".npz":
        with np.load(path) as z:
            return [z[k] for k in z.files if k != "about"]
    if path.suffix == ".mat":
        from scipy.io import loadmat

        return [x.ravel() for k, x in loadmat(path).items() if not k.startswith("__") and k != "flexarm"]
    if path.suffix == ".h5":
        import h5py

        found: dict[str, np.ndarray] = {}
        with h5py.File(path) as f:
            f.visititems(lambda name, x: found.update({name: x[()]}) if isinstance(x, h5py.Dataset) else None)
        return list(found.values())
    with path.open(newline="", encoding="utf-8") as f:
        return list(np.array([[float(x) for x in row] for row in list(csv.reader(f))[1:]]).T)


@drawn(60, SEEDS, NAMES, SUFFIXES)
def test_what_is_saved_is_loaded(
    tmp_path_factory: pytest.TempPathFactory, seed: int, names: list[str], suffix: str
) -> None:
    """Names, units and every digit; or the names are refused when the data are made or saved."""
    path = tmp_path_factory.mktemp("data") / f"drawn{suffix}"
    try:
        data = table(np.random.default_rng(seed), names)
        data.save(path)
    except ValueError as e:
        assert any(name in str(e) or repr(name) in str(e) for name in names) or "name" in str(e)
        assume(False)
    again = fa.Data.load(path)
    assert again.names == data.names and again.units == data.units
    np.testing.assert_array_equal(again.t, data.t)
    for name in data:
        np.testing.assert_array_equal(again[name], data[name])
    others = seen_by_others(path)
    assert len(others) == len(data.names) + 1
    for column in (data.t, *data.columns.values()):
        assert any(np.array_equal(column, x) for x in others)
    note(f"of {suffix}")


@drawn(40, SEEDS)
def test_a_table_as_others_write_it(tmp_path_factory: pytest.TempPathFactory, seed: int) -> None:
    """Separators, decimal commas, comments, units in brackets, behind an underscore or on a line of their own, times in
    ms, empty lines, a byte order mark, lines that end as on Windows."""
    rng = np.random.default_rng(seed)
    n, k = int(rng.integers(2, 20)), int(rng.integers(1, 4))
    separator = str(rng.choice([",", ";", "\t", " "]))
    style = int(rng.integers(3))  # of the units
    plain = [u for u in UNITS if style != 1 or u in ("rad", "deg", "mm", "mA", "rpm")]
    plain = [u for u in plain if style != 2 or separator != " " or " " not in u]
    units = [str(rng.choice(plain)) for _ in range(k)]
    columns = [rng.normal(size=n) * 10.0 ** rng.uniform(-3, 3) for _ in range(k)]
    t = np.round(times(rng, n), 6)
    ms = bool(rng.random() < 0.5)
    comma = separator != "," and bool(rng.random() < 0.5)
    heads = [("t", "ms" if ms else "s"), *((f"signal{j}", u) for j, u in enumerate(units))]
    words = [[f"{h} [{u}]", f"{h}_{u}", h][style] for h, u in heads]
    lines = ["# recorded by a rig", separator.join(words)]
    if style == 2:
        lines.append(separator.join(u for _, u in heads))
    written = [t * 1e3 if ms else t, *columns]
    for row in zip(*written, strict=True):
        cells = [repr(float(x)) for x in row]
        lines.append(separator.join(c.replace(".", ",") if comma else c for c in cells))
        lines += [""] * int(rng.random() < 0.1)
    text = ("\r\n" if rng.random() < 0.5 else "\n").join(lines) + "\n"
    path = tmp_path_factory.mktemp("data") / f"drawn{rng.choice(['.csv', '.txt', '.dat'])}"
    path.write_bytes(text.encode(str(rng.choice(["utf-8", "utf-8-sig", "utf-16"]))))
    data = fa.Data.load(path)
    assert data.names == tuple(f"signal{j}" for j in range(k))
    np.testing.assert_allclose(data.t, t, rtol=1e-12)
    for j, (u, y) in enumerate(zip(units, columns, strict=True)):
        assert data.units[f"signal{j}"] == UNITS[u][0]
        np.testing.assert_allclose(data[f"signal{j}"], y * UNITS[u][1], rtol=1e-12)


@drawn(60, SEEDS, SUFFIXES)
def test_damaged_tables_are_named(tmp_path_factory: pytest.TempPathFactory, seed: int, suffix: str) -> None:
    """Bytes flipped or cut off: ValueError with the file's name, or data; of a format with checksums, the same data."""
    rng = np.random.default_rng(seed)
    path = tmp_path_factory.mktemp("damage") / f"drawn{suffix}"
    data = table(rng, ["angle", "strain"], least=4)
    data.save(path)
    content = bytearray(path.read_bytes())
    if rng.random() < 0.3:
        content = content[: rng.integers(len(content))]
    else:
        for at in rng.integers(len(content), size=rng.integers(1, 8)):
            content[at] ^= 1 << int(rng.integers(8))
    path.write_bytes(bytes(content))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            again: Any = fa.Data.load(path)
        except ValueError as e:
            assert path.name in str(e)
            note("found damaged")
            return
    assert np.isfinite(again.t).all() and all(np.isfinite(y).all() for y in again.columns.values())
    if suffix == ".npz":
        for name in set(again) & set(data):
            np.testing.assert_array_equal(again[name], data[name])
