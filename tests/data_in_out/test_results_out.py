"""Results leave in the format that the file's name promises, or not at all."""

from __future__ import annotations

from pathlib import Path

import flexarm as fa
import h5py
import numpy as np
import pytest
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
    with pytest.raises(ValueError, match=r"runs\.\w+': must end in \.npz"):
        runs.save(tmp_path / name)
    assert not any(tmp_path.iterdir())


def test_a_batch_under_an_hdf5_name_is_hdf5(runs: fa.BatchResult, tmp_path: Path) -> None:
    runs.save(tmp_path / "runs.h5")
    assert h5py.is_hdf5(tmp_path / "runs.h5")
    back = fa.BatchResult.load(tmp_path / "runs.h5")
    for name in ("t", "q", "v", "a", "tau", "status", "reached"):
        np.testing.assert_array_equal(getattr(back, name), getattr(runs, name))
    np.testing.assert_array_equal(back.parameters["link.0.hub.mass"], [1.0, 2.0])
