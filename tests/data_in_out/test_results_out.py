"""Results leave in the format that the file's name promises, or not at all."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import flexarm as fa
import h5py
import numpy as np
import pytest
from messages import refuses, warns
from scipy.io import loadmat

HINGE = fa.Link(fa.Revolute("z", coulomb=0.1), fa.RigidBody(1.0, inertia=(1, 1, 1)))
TIMES = np.linspace(0, 1, 11)


@pytest.fixture(scope="module")
def run() -> fa.Result:
    return fa.simulate(fa.Arm([HINGE]), TIMES, v0=[1.0], events=lambda t, q, v: q[0] - 0.3)


@pytest.fixture(scope="module")
def runs() -> fa.BatchResult:
    return fa.simulate_batch(fa.Arm([HINGE]), TIMES, parameters={"link.0.hub.mass": [1.0, 2.0]}, v0=[1.0])


def test_a_table_holds_what_the_result_has(run: fa.Result, tmp_path: Path) -> None:
    run.save(tmp_path / "x.csv")
    assert (tmp_path / "x.csv").read_text(encoding="utf-8").startswith("t (s),")
    run.save(tmp_path / "x.mat")
    np.testing.assert_array_equal(loadmat(tmp_path / "x.mat")["t"].ravel(), run.t)
    for name in ("x.h5", "x.hdf5"):
        run.save(tmp_path / name)
        with h5py.File(tmp_path / name) as f:
            np.testing.assert_array_equal(f["q"], run.q)


@pytest.mark.parametrize("name", ["runs.csv", "runs.mat", "runs.json", "runs.xlsx"])
def test_a_batch_is_not_written_under_another_formats_name(name: str, runs: fa.BatchResult, tmp_path: Path) -> None:
    with refuses("path =", name, ".npz"):
        runs.save(tmp_path / name)
    assert not any(tmp_path.iterdir())


def test_a_batch_under_an_hdf5_name_is_hdf5(runs: fa.BatchResult, tmp_path: Path) -> None:
    runs.save(tmp_path / "runs.h5")
    assert h5py.is_hdf5(tmp_path / "runs.h5")
    back = fa.BatchResult.load(tmp_path / "runs.h5")
    for name in ("t", "q", "v", "a", "tau", "status", "reached"):
        np.testing.assert_array_equal(getattr(back, name), getattr(runs, name))
    np.testing.assert_array_equal(back.parameters["link.0.hub.mass"], [1.0, 2.0])


@pytest.mark.parametrize("suffix", [".csv", ".mat", ".h5", ".npz"])
def test_columns_of_a_result_are_loaded(suffix: str, run: fa.Result, tmp_path: Path) -> None:
    run.save(tmp_path / f"x{suffix}")
    back, own = fa.Data.load(tmp_path / f"x{suffix}"), run.to_data()
    assert back.names == own.names and back.units == own.units
    assert {"q link 0 revolute", "friction link 0 revolute", "end x"} <= set(own.names)
    assert own.units["q link 0 revolute"] == "rad" and own.units["tau link 0 revolute"] == "N m"
    for name in own:
        np.testing.assert_array_equal(back[name], own[name])
    np.testing.assert_array_equal(own["v link 0 revolute"], run.v[:, 0])
    frame = run.to_pandas()
    np.testing.assert_array_equal(frame["end x"], run.frame()[0][:, 0])


@pytest.mark.parametrize("suffix", [".h5", ".hdf5", ".npz", ""])
def test_a_whole_result_is_loaded(suffix: str, run: fa.Result, tmp_path: Path) -> None:
    path = tmp_path / f"x{suffix}"
    run.save(path)
    back = fa.Result.load(path)
    assert back.arm == run.arm and back.stats == run.stats and back.status == run.status
    for name in ("t", "q", "v", "a", "tau", "friction"):
        np.testing.assert_array_equal(getattr(back, name), getattr(run, name))
    assert back.t_events is not None and run.t_events is not None
    np.testing.assert_array_equal(back.t_events[0], run.t_events[0])


def test_tables_are_no_results(run: fa.Result, tmp_path: Path) -> None:
    for name in ("x.csv", "x.mat"):
        run.save(tmp_path / name)
        with refuses("fa.Data.load", "table", "columns"):
            fa.Result.load(tmp_path / name)


def test_damaged_hdf5_results_are_value_errors(run: fa.Result, tmp_path: Path) -> None:
    path = tmp_path / "x.h5"
    run.save(path)
    whole, rng, refused = path.read_bytes(), np.random.default_rng(0), 0
    for k in range(150):
        damaged = bytearray(whole)
        at = int(rng.integers(len(whole)))
        if k % 3 == 0:
            damaged[at] ^= 1 << int(rng.integers(8))
        else:
            del damaged[at : at + int(rng.integers(1, 100)) if k % 3 == 1 else len(whole)]
        path.write_bytes(damaged)
        try:
            back = fa.Result.load(path)
        except ValueError as e:
            assert "damaged" in str(e)
            refused += 1
        else:
            for name in ("t", "q", "v", "a", "tau"):
                np.testing.assert_array_equal(getattr(back, name), getattr(run, name))
    assert refused > 50


@pytest.mark.parametrize("name", ["x.h5", "x.npz"])
@pytest.mark.parametrize("read", [fa.Result.load, fa.Data.load])
@pytest.mark.parametrize("part", ["numbers", "words", "one array less"])
def test_a_file_whose_own_tables_fit_and_whose_contents_do_not_is_refused(
    part: str, read: Any, name: str, run: fa.Result, tmp_path: Path
) -> None:
    """As one flipped bit in the library's tables of chunks or members makes it, which have no checksums."""
    path = tmp_path / name
    for write in (run.save, run.to_data().save) if read is fa.Data.load else (run.save,):
        write(path)
        read(path)
        if path.suffix == ".npz":
            with np.load(path) as f:
                held = dict(f)
            last = list(held)[-1]
            if part == "numbers":
                held[last] = held[last] + 1.0
            elif part == "words":
                held["about"] = np.array(str(held["about"]).replace('"rad"', '"deg"', 1))
            else:
                del held[last]
            np.savez(path, **held)
        else:
            with h5py.File(path, "r+") as f:
                last = list(f)[-1]
                if part == "numbers":
                    f[last][0] += 1.0
                elif part == "words" and "about" in f:
                    f["about"][0] = f["about"][0].replace(b"0.", b"1.", 1)
                else:
                    del f[last]
        with refuses(path, "damaged"):
            read(path)


def test_a_damaged_mat_is_refused_before_scipy_reads_it(
    run: fa.Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """SciPy's reader of a few of them ends the process (segmentation fault)."""
    path, rng = tmp_path / "x.mat", np.random.default_rng(0)
    run.save(path)
    whole = path.read_bytes()
    fa.Data.load(path)
    monkeypatch.setattr("scipy.io.loadmat", lambda *args, **more: pytest.fail("SciPy was asked"))
    places = [*rng.integers(116, len(whole), 100), *range(16, 100, 4)]  # of the numbers, and of the checksum
    for made in (*(whole[:k] + bytes([whole[k] ^ 1 << k % 8]) + whole[k + 1 :] for k in places), whole[:-1]):
        path.write_bytes(made)
        with refuses("x.mat", "damaged"):
            fa.Data.load(path)


def test_a_mat_that_another_program_has_written_again_is_read(run: fa.Result, tmp_path: Path) -> None:
    from scipy.io import savemat

    path = tmp_path / "x.mat"
    run.save(path)
    held = {k: x for k, x in loadmat(path).items() if not k.startswith("__")}
    last = [k for k in held if k != "flexarm"][-1]
    savemat(path, held | {last: held[last] + 1.0}, long_field_names=True)
    found, truth = fa.Data.load(path), run.to_data()
    assert found.names == truth.names and found.units == truth.units
    np.testing.assert_allclose(found[truth.names[-1]], truth[truth.names[-1]] + 1.0)


def test_what_was_written_without_a_checksum_is_read(run: fa.Result, tmp_path: Path) -> None:
    """By an older flexarm."""
    run.save(tmp_path / "x.h5")
    run.save(tmp_path / "x.npz")
    with h5py.File(tmp_path / "x.h5", "r+") as f:
        del f.attrs["digest"]
    with np.load(tmp_path / "x.npz") as z:
        held = dict(z)
    about = json.loads(str(held["about"]))
    del about["digest"]
    np.savez(tmp_path / "x.npz", **(held | {"about": np.array(json.dumps(about))}))
    for name in ("x.h5", "x.npz"):
        np.testing.assert_array_equal(fa.Result.load(tmp_path / name).q, run.q)
        assert len(fa.Data.load(tmp_path / name).columns) == len(run.to_data().columns)


def test_a_failed_batch_with_events_goes_through_hdf5(tmp_path: Path) -> None:
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, inertia=(1, 1, 1)))])
    runs = fa.simulate_batch(arm, TIMES, v0=[[1.0], [2.0], [0.0]], events=lambda t, q, v: q[0] - 0.3)
    runs.save(tmp_path / "a.npz")
    runs.save(tmp_path / "a.h5")
    runs.save(tmp_path / "a.h5")  # again, over itself
    one, two = fa.BatchResult.load(tmp_path / "a.npz"), fa.BatchResult.load(tmp_path / "a.h5")
    for k in range(3):
        np.testing.assert_array_equal(one[k].q, two[k].q)
        np.testing.assert_array_equal(one[k].t_events[0], two[k].t_events[0])
    for name in ("a.npz", "a.h5"):
        with refuses("BatchResult.load(...)[k]"):
            fa.Data.load(tmp_path / name)
    two[1].save(tmp_path / "one.csv")
    assert len(fa.Data.load(tmp_path / "one.csv")) == len(TIMES)
    with refuses("BatchResult.save", "another batch", "origin"):
        fa.simulate_batch(arm, TIMES, v0=[[1.0], [2.0], [0.0]], out=tmp_path / "a.h5")


def test_a_batch_that_kept_little_is_a_table_of_that(tmp_path: Path) -> None:
    arm = fa.Arm([HINGE])
    runs = fa.simulate_batch(arm, TIMES, v0=[[1.0], [2.0]], outputs=("v",))
    assert runs[0].to_data().names == ("v link 0 revolute",)
    runs[0].save(tmp_path / "x.csv")
    assert fa.Data.load(tmp_path / "x.csv").names == ("v link 0 revolute",)
    runs.save(tmp_path / "x.h5")
    back = fa.BatchResult.load(tmp_path / "x.h5")
    assert back.q is None and back.v is not None


# -- beside measured data ----------------------------------------------------------------------------------------------


def test_a_run_beside_what_was_measured() -> None:
    """Of y = a x + b, by hand: the rms of x - y over the deviation of y."""
    run = fa.load("ist").run()
    x = run.tip_deflection(0)[:, 1]
    data = fa.Data(run.t, {"tip": 1200 * x + 0.3}, {"tip": "mm"})
    y = data["tip"]
    found = run.compare(data, {"tip": "link 0 tip y deflection"})
    assert found.nrmse["tip"] == pytest.approx(np.sqrt(np.mean((x - y) ** 2)) / y.std(), rel=1e-9)
    assert found.bias["tip"] == pytest.approx((x - y).mean(), rel=1e-9)
    assert found.correlation["tip"] == pytest.approx(1.0) and found.lag["tip"] == pytest.approx(0, abs=1e-6)
    (axes,) = found.plot().axes
    assert "NRMSE (%)" in repr(found)
    assert axes.get_ylabel() == "m" and axes.get_title(loc="left").startswith("tip, NRMSE")
    same = [run.tip_deflection(0)[:, 1], lambda r: r.tip_deflection(0)[:, 1]]
    for what in same:
        assert run.compare(data, {"tip": what}).nrmse == found.nrmse


def test_sensors_and_lags_and_other_times() -> None:
    run = fa.load("ist").run()
    gauge = fa.sensors.StrainGauge(0, 0.005)
    own = run.to_data()
    late = fa.Data(run.t, {"e": gauge.read(run).y[:, 0], "q link 0 revolute": run.q[:, 0]}).shift(0.0123)
    late = late.between(0.1).resample(0.0017, "cubic", antialias=False)
    found = run.compare(late, {"e": gauge, "q link 0 revolute": "q link 0 revolute"})
    assert found.lag["q link 0 revolute"] == pytest.approx(-0.0123, abs=1e-3)
    assert found.measured.t[-1] <= own.t[-1] + 1e-9
    assert run.compare(late).measured.names == ("q link 0 revolute",)
    assert run.compare(late.shift(-0.0123)).nrmse["q link 0 revolute"] < 1e-3


def test_comparisons_that_cannot_be(run: fa.Result) -> None:
    t = run.t
    data = fa.Data(t, {"x": np.sin(t), "y": np.ones(len(t)), "z": t}, {"x": "m", "z": "rad"})
    joint, camera = "q link 0 revolute", fa.sensors.Camera(0)
    for given, says in (
        ((t,), "data = ndarray"), ((data,), "name"), ((data, {"w": joint}), "columns = 'w'"),
        ((data, {"z": "q"}), ("columns['z'] = 'q'", "link 0")),
        ((data, {"x": joint}), ("columns['x']", "m", "rad")),
        ((data, {"z": camera}), "3 components"), ((data, {"z": t[:3]}), ("has shape (3,)", "11 numbers")),
        ((data.shift(5), {"z": joint}), ("5 to 6 s", "0 to 1 s")),
    ):  # fmt: skip
        with refuses(says):
            run.compare(*given)
    with warns(fa.errors.DataWarning, "column 'y'", "1", "NRMSE", "constant"):
        found = run.compare(data, {"y": joint, "z": joint})
    assert np.isnan(found.nrmse["y"]) and np.isfinite(found.nrmse["z"]) and np.isnan(found.lag["y"])
