"""Measured data come in as they are, in SI, or are refused by name."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import flexarm as fa
import h5py
import numpy as np
import pytest
from messages import naming, refuses, warns
from scipy.io import savemat

EXCERPT = Path(__file__).parents[1] / "data" / "quanser_excerpt.csv"
DEG = math.pi / 180

UNITS = [
    ("deg", "rad", DEG), ("°", "rad", DEG), ("mrad", "rad", 1e-3), ("mm", "m", 1e-3), ("ms", "s", 1e-3),
    ("mV", "V", 1e-3), ("g", "m/s^2", 9.80665), ("mg", "m/s^2", 9.80665e-3), ("rpm", "rad/s", math.pi / 30),
    ("uA", "A", 1e-6), ("µA", "A", 1e-6), ("deg/s", "rad/s", DEG), ("°/s", "rad/s", DEG), ("dps", "rad/s", DEG),
    ("mm/s^2", "m/s^2", 1e-3), ("m/s²", "m/s^2", 1.0), ("rad/s2", "rad/s^2", 1.0), ("rad s^-1", "rad/s", 1.0),
    ("N·mm", "N m", 1e-3), ("mNm", "N m", 1e-3), ("N m", "N m", 1.0), ("kN", "N", 1e3), ("µε", "1", 1e-6),
    ("um/m", "1", 1e-6), ("mV/V", "1", 1e-3), ("%", "1", 1e-2), ("kHz", "Hz", 1e3), ("kg m^2", "kg m^2", 1.0),
    ("MPa", "Pa", 1e6), ("1/s", "1/s", 1.0), ("Nm/rad", "N m/rad", 1.0), ("rev", "rad", 2 * math.pi), ("", "", 1.0),
    ("W/(m K)", "W/(m K)", 1.0), ("min", "s", 60.0), ("in", "m", 0.0254),
]  # fmt: skip


@pytest.mark.parametrize(("text", "si", "scale"), UNITS)
def test_units_in_si(text: str, si: str, scale: float) -> None:
    held = fa.Data([0.0, 1.0], {"x": [1.0, 0.0]}, {"x": text})
    assert held.units["x"] == si and held["x"] == pytest.approx([scale, 0.0], rel=1e-14)
    again = fa.Data([0.0], {"x": [3.0]}, {"x": si})  # what is written is read back
    assert again.units["x"] == si and again["x"] == 3.0


def test_celsius_has_a_zero_of_its_own() -> None:
    assert fa.Data([0.0], {"T": [20.0]}, {"T": "°C"})["T"][0] == pytest.approx(293.15)


@pytest.mark.parametrize("text", ["counts", "m//s", "m/s/s", "N/m s", "10", "xyz", "m^", "s^s", "kkg", "DEG", "Mm/h/"])
def test_an_unknown_unit_is_named_with_those_known(text: str) -> None:
    with refuses("unit", "rpm"):
        fa.Data([0.0], {"x": [1.0]}, {"x": text})


def test_headings_tell_units(tmp_path: Path) -> None:
    told = {
        "theta [deg]": ("theta", "deg"), "theta (deg)": ("theta", "deg"), "theta": ("theta", ""),
        "motor1_current_A": ("motor1_current", "A"), "w_deg_s": ("w", "deg/s"), "a_m_s2": ("a", "m/s2"),
        "x_max": ("x_max", ""), "x_min": ("x_min", ""), "b_g": ("b_g", ""), "_s": ("_s", ""), "s": ("s", ""),
        # milliseconds, but of what names a speed
        "delay_ms": ("delay", "ms"), "speed_ms": ("speed", "m/s"), "v_ms": ("v", "m/s"),
        "Tip_Velocity_ms": ("Tip_Velocity", "m/s"), "vx_ms": ("vx", "m/s"), "TipSpeed_ms": ("TipSpeed", "m/s"),
        "rev_ms": ("rev", "ms"), "a_ms2": ("a", "m/s2"), "speed [ms]": ("speed", "ms"),
    }  # fmt: skip
    for head, (name, unit) in told.items():
        column = read(tmp_path, f"time,{head}\n0,1\n1,2\n", time="time")
        assert list(column) == [name]
        assert column.units[name] == fa.Data([0.0], {name: [1.0]}, {name: unit}).units[name]
        assert column[name][0] == fa.Data([0.0], {name: [1.0]}, {name: unit})[name][0]
    assert [read(tmp_path, f"{head},x\n0,1\n1,2\n").t[1] for head in ("t_s", "t_ms")] == [1.0, 1e-3]
    for name in ("theta", "t_s", "a (b)", "a [b]", "q link 0", "w_deg_s", "é/ü"):
        for si in ("", "rad", "m/s^2", "W/(m K)"):
            fa.Data([0.0, 1.0], {name: [1.0, 2.0]}, {name: si}).save(tmp_path / "again.csv")
            again = fa.Data.load(tmp_path / "again.csv")
            assert list(again) == [name] and again.units[name] == si


# -- text --------------------------------------------------------------------------------------------------------------


def read(folder: Path, content: str | bytes, **more: Any) -> fa.Data:
    path = folder / "x.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return fa.Data.load(path, **more)


SAME = [
    "time [s],theta [deg],e\n0,10,1\n0.5,20,-2e3\n",
    "time [s];theta [deg];e\n0;10;1\n0,5;20,0;-2e3\n",
    "time [ms]\ttheta [°]\te\n0\t10\t1\n500\t20\t-2e3\n",
    "# a rig\n% of ours\n\ntime [s] theta [deg]  e\n0 10 1\n 0.5  20   -2e3 \n# the end",
    "# a rig\n# t [s], theta [deg], e\n0, 10, 1\n0.5, 20, -2e3",
    "\ufefft_s,theta_deg,e\r\n0,10,1\r\n0.5,20,-2e3\r\n",
    "t,theta,e\ns,deg,\n0,10,1\n0.5,20,-2e3\n",
    "t;theta;e\n[s];[deg];[-]\n0;10;1\n0,5;20;-2e3\n".replace("[-]", "[1]"),
    "sep=;\nt;theta (deg);e\n0;10;1\n0.5;20;-2e3\n",
    '"t","theta (deg)","e"\n"0,0","10,0","1,0"\n"0,5","20,0","-2e3"\n',
    "t,theta (deg),e,\n0,10,1,\n0.5,20,-2e3,\n",
    "t,theta (deg),e\r0,10,1\r0.5,20,-2e3\r",
    "t,theta (°),e\n0,10,1\n0.5,20,-2e3\n".encode("cp1252"),
    "t,theta (°),e\n0,10,1\n0.5,20,-2e3\n".encode("utf-16"),
]


@pytest.mark.parametrize("content", SAME)
def test_one_table_written_in_many_ways(content: str | bytes, tmp_path: Path) -> None:
    data = read(tmp_path, content)
    assert data.names == ("theta", "e") and data.units["theta"] == "rad"
    np.testing.assert_allclose(data.t, [0, 0.5], rtol=1e-15)
    np.testing.assert_allclose(data["theta"], [10 * DEG, 20 * DEG], rtol=1e-15)
    np.testing.assert_array_equal(data["e"], [1, -2000])


BAD: list[tuple[str | bytes, dict[str, Any], Any]] = [
    ("", {}, "empty"),
    ("# nothing\n\n", {}, "empty"),
    ("t,x\n", {}, "rows"),
    ("0,1\n1,2\n", {}, ("line 1", "numbers")),
    ("t,x\n0,1\n1,2,3\n", {}, ("line 3", "2")),
    ("t,x\n0,1\n1\n", {}, ("line 3", "1", "2")),
    ("t,x\n0,000,1,5\n0,001,1,6\n", {}, ("line 2", "4")),
    ("t;x\n0;1,5\n1;2.5\n", {}, ("column 'x'", "line 3", "'2.5'", "'1,5'")),
    ("t,x\n0,1\n1,two\n", {}, ("column 'x'", "line 3", "'two'", "number")),
    ("t,x\n0,1\n1,1_0\n", {}, ("column 'x'", "line 3", "'1_0'", "number")),
    ("t,x\n0,1\n1,\n2,nan\n", {}, ("column 'x'", "line 3", "1", "missing='drop'", "nan", "rows")),
    ("# by us\nt,x\n\n0,1\n1,inf\n", {}, ("column 'x'", "line 5")),
    ("t,x\nnan,1\n1,2\n", {}, ("column 't'", "line 2", "nan")),
    ("t,x,y\n0,,1\n1,1,\n", {"missing": "drop"}, "missing"),
    ("t,x\n0,1\n2,1\n1,2\n", {}, ("line 4", "1 s", "2 s", "increase")),
    ("t,x\n0,1\n0,1\n0,2\n", {}, ("line 3", "0 s", "1", "times")),
    ("t,x [counts]\n0,1\n", {}, ("column 'x'", "'counts'", "unit")),
    ("t,x\ns,counts\n0,1\n", {}, ("column 'x'", "'counts'", "unit")),
    ("t [kg],x\n0,1\n", {}, ("column 't'", "kg", "times")),
    ("a,b\n0,1\n", {}, ("time='NAME'", "rate=", "column", "times")),
    ("t,time,b\n0,1,2\n", {}, ("times", "time")),
    ("t,b\n0,1\n", {"time": "c"}, ("time", "column 'c'")),
    ("t,b\n0,1\n", {"columns": ["b", "c"]}, ("columns", "column 'c'")),
    ("t,b\n0,1\n", {"units": {"c": "m"}}, ("units", "column 'c'")),
    ("t,b [m],b [mm]\n0,1,1\n", {}, ("'b [m]'", "'b [mm]'", "'b'", "same name")),
    ("t,b\n0,1\n", {"time": "t", "rate": 5}, ("time = 't'", "rate = 5")),
    (b"PK\3\4\0\0", {}, "zero bytes"),
    ("t,x,y\n0,1,\n1,2,\n", {}, ("column 'y'", "columns=", "empty")),
    ("t,x,y\n0,1,\n1,2,\n", {"missing": "drop"}, ("column 'y'", "columns=", "empty")),
]


@pytest.mark.parametrize(("content", "more", "says"), BAD)
def test_bad_tables_are_refused_by_name(content: Any, more: dict[str, Any], says: Any, tmp_path: Path) -> None:
    with refuses("x.csv", says):
        read(tmp_path, content, **more)


def test_arguments_are_checked(tmp_path: Path) -> None:
    good = "t,x\n0,1\n1,2\n"
    for more, says in (
        ({"missing": "skip"}, "missing = 'skip'"), ({"columns": "x"}, "list"), ({"rate": 0}, "rate = 0"),
        ({"units": "m"}, "units = 'm'"), ({"units": {"x": 3}}, "units['x'] = 3"), ({"key": "g"}, "HDF5"),
    ):  # fmt: skip
        with refuses(says):
            read(tmp_path, good, **more)
    for path, says in ((tmp_path / "no.csv", "no such file"), (tmp_path / "x.xlsx", ".csv"),
                       (5, "path = 5"), (tmp_path, "end")):  # fmt: skip
        with refuses(says):
            fa.Data.load(path)


def test_what_is_not_asked_for_may_be_anything(tmp_path: Path) -> None:
    data = read(tmp_path, "t,x,state,y [counts]\n0,1,on,3\n1,2,,4\n", columns=["x"])
    assert data.names == ("x",)
    data = read(tmp_path, "t,y [counts],tau_m\n0,1,3\n1,2,4\n", units={"y": "", "tau_m": "mNm"})
    assert dict(data.units) == {"y": "", "tau_m": "N m"} and data["tau_m"][0] == pytest.approx(3e-3)
    data = read(tmp_path, "t [s],y [m]\n0,1\n1,2\n", columns=["y [m]"], time="t [s]")
    assert data.names == ("y",)


def test_units_that_are_told_count_more(tmp_path: Path) -> None:
    table = "t,theta [deg]\n0,1\n1,2\n"
    assert read(tmp_path, table, units={"theta": "rad"})["theta"].tolist() == [1, 2]
    assert read(tmp_path, table, units={"theta [deg]": "mrad", "t": "ms"}).t.tolist() == [0, 1e-3]
    assert read(tmp_path, "t (s),time\n0,1\n1,2\n").names == ("time",)


def test_times_by_a_rate_and_missing_rows(tmp_path: Path) -> None:
    assert read(tmp_path, "x\n1\n2\n3\n", rate=200.0).t.tolist() == [0, 0.005, 0.01]
    data = read(tmp_path, "t,x,y\n0,1,1\n1,,1\n2,3,inf\n3,4,5\n", missing="drop")
    assert data.t.tolist() == [0, 3] and data["x"].tolist() == [1, 4]
    assert read(tmp_path, "t,x,y\n0,1,1\n1,,1\n", missing="drop", columns=["y"]).t.tolist() == [0, 1]


def test_gaps_are_told(tmp_path: Path) -> None:
    rows = [f"{t},1" for t in (*range(10), *range(13, 20), *range(30, 40))]
    with warns(fa.errors.DataWarning, "2", "11 s", "t = 19", "gaps", "time", "rows"):
        data = read(tmp_path, "\n".join(["t,x", *rows]))
    assert data.gaps().tolist() == [[9, 4], [19, 11]]


def test_a_table_as_numpy_writes_it(tmp_path: Path) -> None:
    x = np.random.default_rng(0).normal(size=(20_000, 5))
    x[:, 0] = np.arange(20_000)
    np.savetxt(tmp_path / "x.dat", x, header="t a b c d")
    back = fa.Data.load(tmp_path / "x.dat")
    np.testing.assert_array_equal(np.column_stack([back.t, *back.columns.values()]), x)


# -- other formats -----------------------------------------------------------------------------------------------------


def test_a_recording_of_a_rig() -> None:
    data = fa.Data.load(EXCERPT)
    assert len(data) == 420 and data.step == pytest.approx(0.01) and len(data.names) == 10
    assert data.units["link2_deflection"] == "rad" and data.units["motor1_current"] == "A"
    assert np.ptp(data["joint1_reference"]) == pytest.approx(50 * DEG)
    assert fa.Data.load(EXCERPT, columns=["joint1"])["joint1"] == pytest.approx(data["joint1"])


def test_hdf5_of_others(tmp_path: Path) -> None:
    path, t = tmp_path / "x.h5", np.arange(5.0)
    with h5py.File(path, "w") as f:
        g = f.create_group("run")
        g["time"], g["angle"], g["mean"], g["note"], g["xyz"] = t * 1000, t, 2.0, "by us", np.ones((5, 3))
        g["time"].attrs["units"], g["angle"].attrs["unit"] = "ms", np.bytes_(b"deg")
        g["elsewhere"] = h5py.ExternalLink("other.h5", "x")
        f["alone"] = np.arange(3.0)
    with refuses("column 'alone'", "columns="):
        fa.Data.load(path)
    with warns(fa.errors.DataWarning, "'elsewhere'", "link"):
        data = fa.Data.load(path, key="run")
    assert data.names == ("angle", "xyz_0", "xyz_1", "xyz_2") and data.units["angle"] == "rad"
    np.testing.assert_array_equal(data.t, t)
    with refuses("key = 'walk'"):
        fa.Data.load(path, key="walk")
    with h5py.File(path, "w") as f:
        f["table"] = np.array([(0.0, 1.0), (1.0, 2.0)], [("t", "f8"), ("x [mm]", "f4")])
    assert fa.Data.load(path)["x"].tolist() == [0.001, 0.002]
    with h5py.File(path, "w") as f:
        f["t"], f["x"] = t, t[:3]
    with refuses("column 'x'", "3", "5", "columns=", "rows", "times"):
        fa.Data.load(path)
    path.write_bytes(path.read_bytes()[:1000])
    with refuses("table", "columns", "damaged"):
        fa.Data.load(path)


def test_numbers_in_another_file_are_not_read(tmp_path: Path) -> None:
    np.arange(5.0).tofile(tmp_path / "raw")
    with h5py.File(tmp_path / "x.h5", "w") as f:
        f["t"] = np.arange(5.0)
        f.create_dataset("x", (5,), "f8", external=[(str(tmp_path / "raw"), 0, 40)])
    with refuses("'x'", "outside", "file"):
        fa.Data.load(tmp_path / "x.h5")


def test_matlab_files_of_others(tmp_path: Path) -> None:
    path, t = tmp_path / "x.mat", np.arange(5.0)
    savemat(path, {"t": t, "theta_deg": t[:, None], "rate": 500.0, "note": "by us", "xy": np.ones((5, 2))})
    data = fa.Data.load(path)
    assert data.names == ("theta", "xy_0", "xy_1") and data["theta"][1] == pytest.approx(DEG)
    savemat(path, {"log": {"time": t, "u_mV": t, "inner": {"x": t}}})
    data = fa.Data.load(path)
    assert data.names == ("u", "inner/x") and data["u"][1] == 1e-3
    savemat(path, {"log": {"time": t, "u": t}, "more": np.ones(3)})
    assert fa.Data.load(path, key="log").names == ("u",)
    with refuses("key = 'lag'"):
        fa.Data.load(path, key="lag")
    with refuses("no column of times", "rate="):
        fa.Data.load(path)


def test_matlab_7_3(tmp_path: Path) -> None:
    """As MATLAB lays it out: HDF5 behind 512 bytes, matrices transposed, texts as numbers."""
    path, t = tmp_path / "x.mat", np.arange(5.0)
    with h5py.File(path, "w", userblock_size=512) as f:
        for name, x, kind in (("t", t[None], "double"), ("xy", np.arange(10.0).reshape(2, 5), "double"),
                              ("note", np.array([[98], [121]], "u2"), "char")):  # fmt: skip
            f[name] = x
            f[name].attrs["MATLAB_class"] = np.bytes_(kind)
        f.create_group("#refs#")["a"] = np.ones(7)
    data = fa.Data.load(path)
    assert data.names == ("xy_0", "xy_1") and data["xy_1"].tolist() == [5, 6, 7, 8, 9]


COMPLEX = np.arange(5) + 1j
LEFT = {
    "z": (COMPLEX, "complex"),
    "state": (np.array(["on", "off"] * 2 + ["on"]), "text"),
    "cube": (np.zeros((5, 2, 2)), "(5, 2, 2)"),
}


@pytest.mark.parametrize("name", ["x.npz", "x.mat", "x.h5"])
def test_what_is_left_out_is_told_with_the_reason(name: str, tmp_path: Path) -> None:
    path, t, left = tmp_path / name, np.arange(5.0), dict(LEFT)
    held = {"t": t, "x": t**2, "rate": 500.0, "note": "by us", **{k: x for k, (x, _) in left.items()}}
    if path.suffix == ".npz":
        np.savez(path, **held)
    elif path.suffix == ".mat":
        import scipy.sparse

        left["S"], left["cell"] = (None, "sparse matrix"), (None, "objects")
        savemat(path, {**held, "S": scipy.sparse.eye_array(5), "cell": np.array([t, "a", t, t, t], object)})
    else:
        left["there"] = None, "link"
        with h5py.File(path, "w") as f:
            for k, x in held.items():
                f[k] = x.astype("S") if k == "state" else x
            f["there"] = h5py.ExternalLink("other.h5", "x")
    with warns(fa.errors.DataWarning, f"data '{name}'") as told:
        data = fa.Data.load(path)
    assert data.names == ("x",) and len(told) == 1
    for k, (_, why) in left.items():
        assert re.search(naming(f"'{k}'", why), str(told[0].message))
        with refuses("columns", f"'{k}'", why):
            fa.Data.load(path, columns=["x", k])
    for k in ("note", "rate"):  # a word, or one number alone, is no column
        assert f"'{k}'" not in str(told[0].message)
    assert fa.Data.load(path, columns=["x"]).names == ("x",)  # no word of what was not asked for


def test_sparse_and_cells_of_matlab_7_3_are_told_of(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "x.mat", "w", userblock_size=512) as f:
        f["t"], f["c"] = np.arange(5.0)[None], np.ones((1, 5), "u8")
        f["c"].attrs["MATLAB_class"] = np.bytes_("cell")
        S = f.create_group("S")
        S.attrs["MATLAB_sparse"], S["data"], S["ir"] = 5, np.ones(3), np.arange(3)
    with warns(fa.errors.DataWarning, "'S'", "'c'", "sparse matrix", "cell"):
        assert fa.Data.load(tmp_path / "x.mat").names == ()


def test_a_name_of_times_that_is_no_column_is_told_of(tmp_path: Path) -> None:
    np.savez(tmp_path / "x.npz", t=["a", "b"], x=[1.0, 2.0], y=[1.0, 2.0])
    with refuses("'t'", "time=", "column", "times", "text"):
        fa.Data.load(tmp_path / "x.npz")


def test_dates_in_arrays_are_times(tmp_path: Path) -> None:
    stamps = np.datetime64("2024-01-01T00:00:00", "ms") + np.arange(3) * np.timedelta64(20, "ms")
    np.savez(tmp_path / "x.npz", time=stamps, x=[1.0, 2.0, 3.0])
    np.testing.assert_allclose(fa.Data.load(tmp_path / "x.npz").t, [0, 0.02, 0.04], atol=1e-15)


def test_complex_columns_of_frames_are_refused() -> None:
    pandas = pytest.importorskip("pandas")
    with refuses("column 'z'", "complex"):
        fa.Data.load(pandas.DataFrame({"t": np.arange(5.0), "z": COMPLEX}))


def test_data_frames() -> None:
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({"t": [0.0, 0.5], "theta [deg]": [1, 2], "state": ["on", "off"]})
    assert fa.Data.load(frame, columns=["theta"])["theta"][1] == pytest.approx(2 * DEG)
    with refuses("column 'state'", "row 0", "'on'", "number"):
        fa.Data.load(frame)
    dates = pandas.date_range("2024-01-01", periods=3, freq="2ms")
    data = fa.Data.load(pandas.DataFrame({"x": [1.0, 2.0, 3.0]}, index=dates))
    np.testing.assert_allclose(data.t, [0, 0.002, 0.004], atol=1e-15)
    holes = pandas.DataFrame({"t": [0.0, 1.0], "x": pandas.array([1, None], "Int64")})
    with refuses("column 'x'", "row 1", "nan"):
        fa.Data.load(holes)
    data = fa.Data.load(EXCERPT)
    back = fa.Data.load(data.to_pandas())
    assert back.names == data.names and back.units == data.units
    np.testing.assert_array_equal(back.t, data.t)
    with refuses("'x'", "same name"):
        fa.Data.load(pandas.DataFrame([[0, 1, 2]], columns=["t", "x", "x"]))


def test_npz_of_others(tmp_path: Path) -> None:
    np.savez(tmp_path / "x.npz", t_ms=[0.0, 2.0], x=[[1, 2], [3, 4]], rate=500.0, note="by us")
    data = fa.Data.load(tmp_path / "x.npz")
    assert data.t.tolist() == [0, 0.002] and data["x_1"].tolist() == [2, 4]
    np.savez(tmp_path / "y.npz", t=np.array([{}], object))
    with refuses("table", "columns", "damaged"):
        fa.Data.load(tmp_path / "y.npz")
