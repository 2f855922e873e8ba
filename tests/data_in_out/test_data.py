"""Signals at other times, beside each other, and out again."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from messages import refuses, warns
from scipy.io import loadmat

T = np.linspace(0, 4, 2001)


def made(t: np.ndarray = T, late: float = 0.0) -> fa.Data:
    """A smooth motion that does not repeat, in deg and mm."""
    s = t - late
    theta = np.sin(2 * s) + 0.5 * np.sin(5.3 * s + 1) + 0.2 * s
    return fa.Data(t, {"theta": np.rad2deg(theta), "x": 1000 * np.cos(3 * s)}, {"theta": "deg", "x": "mm"}, "made")


def test_columns_are_in_si_and_found_by_name() -> None:
    data = made()
    assert data.names == ("theta", "x") == tuple(data) and "x" in data and len(data) == 2001
    assert dict(data.units) == {"theta": "rad", "x": "m"} and data.step == pytest.approx(0.002)
    np.testing.assert_allclose(data["x"], np.cos(3 * T), rtol=1e-14)
    assert data[["x"]].names == ("x",) and data[["x"]].units == {"x": "m"}
    lines = repr(data).splitlines()
    assert lines[0] == "Data made: 2001 rows, t = 0 to 4 s, every 0.002 s" and lines[1].split()[:3] == [
        "column", "unit", "min",
    ]  # fmt: skip
    assert lines[4].split()[:3] == ["x", "m", "-1"]
    with refuses("column = 'thet'", "'theta'"):
        data["thet"]


BAD: list[tuple[tuple[Any, ...], Any]] = [
    (([], {}), "t has shape"), (([[0.0]], {}), "t has shape"), (([0, 0], {}), ("row 1", "0 s", "increase")),
    (([0, np.nan], {}), "t = [0.0, nan]"), (([0, 1], {"x": [1]}), ("columns['x'] has shape (1,)", "2")),
    (([0, 1], {"x": [1, np.nan]}), "columns['x'] = [1.0, nan]"),
    (([0, 1], {"x": [1, 2]}, {"y": "m"}), ("units['y']", "column")),
    (([0, 1], {"x": [1, 2]}, {"x": "furlong"}), ("column 'x'", "'furlong'", "unit")),
    (([0, 1], {"t": [1, 2]}), ("'t'", "times")), (([0, 1], {3: [1, 2]}), "columns: 3"),
    (([0, 1], {"x": ["a", "b"]}), "columns['x'] = ['a', 'b']"),
]  # fmt: skip


@pytest.mark.parametrize(("given", "says"), BAD)
def test_what_is_no_data(given: tuple[Any, ...], says: Any) -> None:
    with refuses(says):
        fa.Data(*given)


def test_between_and_shift() -> None:
    data = made()
    part = data.between(1.0, 2.0)
    assert part.t[0] == 1.0 and part.t[-1] == 2.0 and len(part) == 501
    assert data.between(None, 0.5).t[-1] == 0.5 and data.between(3.5).t[0] == 3.5
    assert part.shift(-1.0).t[0] == 0.0
    with refuses("t0 = 5", "t1 = None", "0 to 4"):
        data.between(5)


# -- resampling --------------------------------------------------------------------------------------------------------


def test_resampling_finer_is_interpolation() -> None:
    data, fine = made(np.linspace(0, 4, 201)), made(np.linspace(0, 4, 2001))
    cubic, linear = (data.resample(fine.t, method) for method in ("cubic", "linear"))
    assert np.abs(cubic["theta"] - fine["theta"]).max() < 1e-5
    h2 = 0.02**2 / 8 * (4 + 0.5 * 5.3**2)  # h^2 / 8 of the greatest second derivative
    assert 1e-5 < np.abs(linear["theta"] - fine["theta"]).max() < h2
    same = data.resample(data.t)
    np.testing.assert_array_equal(same["theta"], data["theta"])
    assert same.units == data.units and len(data.resample(0.01)) == 401


def test_resampling_coarser_folds_nothing_back() -> None:
    """45 Hz on samples each 1/50 s would be seen as 5 Hz; 1 Hz passes, and comes no later."""
    t = np.arange(0, 10, 0.002)
    data = fa.Data(t, {"y": np.sin(2 * np.pi * t) + np.sin(2 * np.pi * 45 * t)})
    inner = slice(25, -25)
    clean = data.resample(0.02)
    assert np.abs(clean["y"] - np.sin(2 * np.pi * clean.t))[inner].max() < 1e-3
    folded = data.resample(0.02, antialias=False)
    assert np.abs(folded["y"] - np.sin(2 * np.pi * folded.t))[inner].max() > 0.9


def test_resampling_is_refused_or_warns() -> None:
    data = made()
    for t, says in ((0.0, ("t = 0", "number", "step")), ([3.0, 5.0], "3 to 5 s"),
                    ([2.0, 1.0], ("row 1", "increase")), ([], "t has shape"), (1e-9, "step = 1e-09")):  # fmt: skip
        with refuses(says):
            data.resample(t)
    with refuses("method = 'quintic'"):
        data.resample(0.1, "quintic")
    holed = fa.Data(np.r_[T[:500], T[800:]], {"x": np.r_[T[:500], T[800:]]})
    with warns(fa.errors.DataWarning, "0.602 s", "t = 0.998", "gap"):
        holed.resample(0.002)
    holed.between(2.0).resample(0.002)


# -- lags --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("late", [0.0, 0.1, 0.1234567, -0.3217])
@pytest.mark.parametrize("step", [0.002, 0.003])
def test_a_lag_is_found_between_samples(late: float, step: float) -> None:
    other = made(np.arange(0, 4, step))
    data = made(late=late)
    found = data.lag(other, "theta")
    assert found == pytest.approx(late, abs=2e-5)
    moved = data.align(other, "theta")
    assert moved.t[0] == pytest.approx(-late, abs=2e-5)
    assert other.lag(data, "theta") == pytest.approx(-late, abs=2e-5)


def test_a_lag_minds_neither_clock_offset_scale_nor_noise() -> None:
    rng = np.random.default_rng(1)
    data, other = made(late=0.0871), made()
    noisy = fa.Data(data.t + 1e4, {"gauge": 3e-6 * data["theta"] + 5 + 3e-7 * rng.normal(size=len(T))})
    assert noisy.lag(other, "gauge", "theta") == pytest.approx(1e4 + 0.0871, abs=2e-3)
    periodic = fa.Data(T, {"theta": np.sin(10 * (T - 0.05))})
    assert periodic.lag(fa.Data(T, {"theta": np.sin(10 * T)}), "theta") == pytest.approx(0.05, abs=1e-4)


def test_lags_that_are_none() -> None:
    data, rng = made(), np.random.default_rng(0)
    still = fa.Data(T, {"theta": np.full(len(T), 0.1)})
    with refuses("column 'theta'", "0.1", "constant", "lag"):
        data.lag(still, "theta")
    with refuses("max_lag = 0.01"):
        made(late=0.5).lag(data, "theta", max_lag=0.01)
    with warns(fa.errors.DataWarning, "column 'a'", "lag"):
        fa.Data(T, {"a": rng.normal(size=len(T))}).lag(fa.Data(T, {"a": rng.normal(size=len(T))}), "a")
    for call, says in (
        (lambda: data.lag(data, "y"), "column = 'y'"), (lambda: data.lag(data, "x", "y"), "column = 'y'"),
        (lambda: data.lag(T, "x"), ("other = ndarray", "fa.Data")),  # type: ignore[arg-type]
        (lambda: data.lag(data, "x", max_lag=-1), "max_lag = -1"),
        (lambda: data.between(0, 0.01).lag(data, "x"), ("column 'x'", "6", "rows", "lag")),
    ):  # fmt: skip
        with refuses(says):
            call()


# -- out ---------------------------------------------------------------------------------------------------------------

ODD = ("theta", "t_s", "a (b)", "a [b]", "w_deg_s", "é/ü 漢", "1st", "x" * 80, "x" * 79 + "y", "flexarm", 'q"u,o;te',
       "a;b c", "#refs#", "#c", "0", "1e5", "nan", "-", "sub/x", "..", "a.npy", "a", "axis0", "block0_values", "[]")


@pytest.mark.parametrize("suffix", [".csv", ".txt", ".h5", ".hdf5", ".mat", ".npz", ".CSV"])
def test_what_is_saved_is_loaded_to_the_bit(suffix: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    columns = {name: rng.normal(size=7) * 10.0 ** rng.integers(-300, 300, 7) for name in ODD}
    units = {name: of for name, of in zip(ODD, ("rad", "", "m/s^2", "", "1", "W/(m K)"), strict=False)}
    data = fa.Data(np.cumsum(rng.uniform(0.5, 1.0, 7)) - 3, columns, units)
    data = fa.Data(data.t[:1], {k: y[:1] for k, y in columns.items()}, units) if suffix == ".txt" else data
    data.save(tmp_path / f"x{suffix}")
    back = fa.Data.load(tmp_path / f"x{suffix}", time="t")
    assert back.names == data.names and back.units == data.units
    np.testing.assert_array_equal(back.t, data.t)
    for name in data:
        np.testing.assert_array_equal(back[name], data[name])


REFUSED = [
    *((k, of) for k in (" a", "a\u00a0", "a\tb", "a\nb", "a\x00b", "\ud800") for of in (".csv", ".h5", ".mat")),
    *((name, ".h5") for name in ("/", "/a", "a/", "a//b", ".", "./a", "z/b")),
    ("about", ".npz"),
]


@pytest.mark.parametrize(("name", "suffix"), REFUSED)
def test_a_name_that_a_file_cannot_hold_is_refused(name: str, suffix: str, tmp_path: Path) -> None:
    data = fa.Data([0.0, 1.0], {"z": [1, 2], name: [3, 4]})
    with refuses(f"columns: {name!r}"):
        data.save(tmp_path / f"x{suffix}")
    assert not any(tmp_path.iterdir())


def test_a_table_of_large_numbers_does_not_overflow() -> None:
    large = np.array([-1.5e308, 1.5e308, 0.0])
    data = fa.Data([0.0, 1.0, 2.0], {"x": large, "same": np.full(3, 1e308), "none": np.zeros(3)})
    cells = {line.split()[0]: line.split()[-2:] for line in repr(data).splitlines()[3:]}
    assert cells["x"] == ["0", f"{1.5e308 * np.sqrt(2 / 3):.5g}"] and cells["same"] == ["1e+308", "0"]
    assert cells["none"] == ["0", "0"]
    with refuses("columns['x']", "finite"):
        fa.Data([0.0, 1.0], {"x": [1e308, 1.0]}, {"x": "km"})


def test_matlab_sees_plain_names(tmp_path: Path) -> None:
    fa.Data([0.0, 1.0], {"link 0 tip": [1, 2], "link_0_tip": [3, 4], "2nd": [5, 6]}).save(tmp_path / "x.mat")
    held = loadmat(tmp_path / "x.mat")
    assert [k for k in held if not k.startswith("__")] == ["flexarm", "t", "link_0_tip", "link_0_tip_2", "x2nd"]


def test_other_suffixes_are_refused(tmp_path: Path) -> None:
    for name in ("x.xlsx", "x.json", "x", "x.tsv"):
        with refuses("path =", name, ".csv"):
            made().save(tmp_path / name)
    with refuses("path", "none"):
        made().save(tmp_path / "none" / "x.csv")
    assert not any(tmp_path.iterdir())


def test_a_figure_has_a_panel_for_each_unit() -> None:
    figure = made().plot()
    assert [ax.get_ylabel() for ax in figure.axes] == ["theta (rad)", "x (m)"]
    assert figure.axes[-1].get_xlabel() == "Time (s)"
    two = fa.Data(T, {"a": T, "b": -T}, {"a": "deg", "b": "rad"}).plot()
    assert [ax.get_ylabel() for ax in two.axes] == ["Angle (rad)"] and len(two.axes[0].lines) == 2
    assert len(made().plot("x").axes) == 1
    with refuses("columns = 'y'"):
        made().plot(["y"])


def test_pandas_is_asked_for_where_it_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with refuses("'flexarm[pandas]'", "pip", error=ImportError):
        made().to_pandas()
