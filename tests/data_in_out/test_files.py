"""What is saved is read back, or refused by name; what is not ours, or damaged, is a ValueError."""

from __future__ import annotations

import pickle
import zipfile
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from arms import floating_arm, paper_link
from messages import refuses

HINGE = fa.Link(fa.Revolute("z", coulomb=0.1), fa.RigidBody(1.0, inertia=(1, 1, 1)))


@pytest.fixture(scope="module")
def run() -> fa.Result:
    return fa.simulate(fa.Arm([HINGE]), np.linspace(0, 1, 11), v0=[1.0], events=lambda t, q, v: q[0] - 0.3)


@pytest.mark.parametrize("name", ["run.npy", "run.json", "run.xlsx", "run.png", "run.CSV2"])
def test_a_result_is_not_written_under_another_formats_name(name: str, run: fa.Result, tmp_path: Path) -> None:
    with refuses("path =", name, ".npz"):
        run.save(tmp_path / name)
    assert not any(tmp_path.iterdir())


def test_siblings_refuse_other_formats_names(run: fa.Result, tmp_path: Path) -> None:
    with refuses("path =", "scene.json", ".toml"):
        fa.Scene(run.arm).save(tmp_path / "scene.json")
    with refuses(".csv", ".txt"):
        fa.sensors.Encoder().read(run).save(tmp_path / "encoder.mat")
    for name in ("run.npz", "run.NPZ", "run"):
        run.save(tmp_path / name)
        assert fa.Result.load(tmp_path / name).arm == run.arm


def test_a_result_whose_part_has_another_name_is_damaged(run: fa.Result, tmp_path: Path) -> None:
    run.save(tmp_path / "run.npz")
    for part in ("friction", "tau", "t"):
        with zipfile.ZipFile(tmp_path / "run.npz") as old, zipfile.ZipFile(tmp_path / "other.npz", "w") as new:
            for name in old.namelist():
                new.writestr(name.replace(f"{part}.npy", "x.npy"), old.read(name))
        with refuses("other.npz", "damaged"):
            fa.Result.load(tmp_path / "other.npz")


def test_damaged_results_are_value_errors(run: fa.Result, tmp_path: Path) -> None:
    """Bytes flipped, pieces cut out, ends cut off: refused, or, where nothing hangs on the byte, the same result."""
    path = tmp_path / "run.npz"
    run.save(path)
    whole, rng, refused = path.read_bytes(), np.random.default_rng(0), 0
    for k in range(300):
        damaged = bytearray(whole)
        at = int(rng.integers(len(whole)))
        if k % 3 == 0:
            damaged[at] ^= 1 << int(rng.integers(8))
        elif k % 3 == 1:
            del damaged[at : at + int(rng.integers(1, 100))]
        else:
            del damaged[at:]
        path.write_bytes(damaged)
        try:
            back = fa.Result.load(path)
        except ValueError as e:
            assert "damaged" in str(e)
            refused += 1
        else:
            assert back.arm == run.arm
            for name in ("t", "q", "v", "a", "tau", "friction"):
                np.testing.assert_array_equal(getattr(back, name), getattr(run, name))
    assert refused > 200


@pytest.mark.skipif(not hasattr(Path, "symlink_to"), reason="has no links")
@pytest.mark.parametrize("name", ["x.npz", "x.h5", "x.csv", "x.mat"])
def test_what_is_saved_onto_a_link_is_where_it_leads(name: str, run: fa.Result, tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    link, target = tmp_path / name, tmp_path / "there" / name
    link.symlink_to(target)
    for _ in range(2):  # at first the link leads to nothing
        run.save(link)
        assert link.is_symlink() and target.is_file() and len(fa.Data.load(target).t) == len(run.t)
    assert [x.name for x in target.parent.iterdir()] == [name]
    link.unlink()
    link.symlink_to(tmp_path / "nowhere" / name)
    with refuses(f"path '{link}'", "nowhere", "no such file"):
        run.save(link)
    link.unlink()
    link.symlink_to(link)
    with refuses(f"path '{link}'", "itself"):
        run.save(link)


def test_what_is_no_result_is_a_value_error(run: fa.Result, tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    for content in (b"", b"PK", b"PK\3\4" + bytes(100), b"\x93NUMPY" + bytes(50), b"gravity = [0, 0, 0]\n"):
        path.write_bytes(content)
        with refuses("run.npz", "damaged"):
            fa.Result.load(path)
    np.savez(path, t=np.zeros(3))
    with refuses("run.npz", "damaged"):
        fa.Result.load(path)
    np.save(tmp_path / "x.npy", np.zeros(3))
    for other in (tmp_path / "x.npy", tmp_path, tmp_path / "none.npz", 5):
        with refuses("result", other):
            fa.Result.load(other)
    run.save(path)
    with np.load(path) as f:
        held = dict(f)
    np.savez(path, **(held | {"v": held["v"][:-1]}))
    with refuses("run.npz", "damaged"):
        fa.Result.load(path)


def test_interruptions_survive_pickling(run: fa.Result) -> None:
    """As they must between processes."""
    for error in (fa.errors.SimulationInterrupted("stop", 0.5, run), fa.SimulationError("stop", 0.5, run)):
        back = pickle.loads(pickle.dumps(error))
        assert type(back) is type(error) and str(back) == "stop" and back.time == 0.5
        np.testing.assert_array_equal(back.result.q, run.q)
    done = fa.rollout(fa.Arm([fa.Link(fa.Revolute("z"), HINGE.hub)]), np.zeros((2, 1)), step=0.1, nstep=2)
    back = pickle.loads(pickle.dumps(fa.errors.BatchInterrupted("stop", done)))
    assert type(back) is fa.errors.BatchInterrupted and str(back) == "stop"
    np.testing.assert_array_equal(back.result.q, done.q)
    assert str(pickle.loads(pickle.dumps(fa.errors.SweepInterrupted("stop", None)))) == "stop"


ODD = ["\x7f", 'a "quote" \\ and [brackets]', "tab\tline\nand\rmore", "\x00\x1b\x80\x9f", "é 漢 \U0001f600", "", "#"]


@pytest.mark.parametrize("title", ODD)
def test_every_title_is_read_back(title: str, tmp_path: Path) -> None:
    fa.Scene(fa.Arm([HINGE]), name=title).save(tmp_path / "scene.toml", comment=title)
    assert fa.load(tmp_path / "scene.toml").name == title


REFUSED: list[tuple[dict[str, Any], Any]] = [
    ({"options": {"events": lambda t, q, v: 1.0}}, ("options", "events =", "Python", "code")),
    ({"options": {"progress": print}}, ("options", "progress =", "Python", "code")),
    ({"options": {"watch": True}}, "'watch'"),
    ({"name": "\ud800"}, "cannot be saved"),
    ({"t": np.zeros(1)}, ("0", "times")),
    ({"t": np.linspace(1, 2, 11)}, ("0", "times")),
    ({"q0": [0.0, 1.0]}, "q0"),
    ({"control": (fa.Sampled(lambda t, y: 0.0, 10.0),)}, ("Python", "code")),
    ({"loads": (fa.Load(3, force=[0, 0, 1]),)}, "link = 3"),
]


@pytest.mark.parametrize(("change", "says"), REFUSED)
def test_what_would_not_be_read_back_is_not_written(change: dict[str, Any], says: Any, tmp_path: Path) -> None:
    with refuses(says):
        fa.Scene(fa.Arm([HINGE]), **change).save(tmp_path / "scene.toml")
    assert not any(tmp_path.iterdir())


def test_controllers_of_one_freedom_of_several_are_read_back(tmp_path: Path) -> None:
    """In a file (0, 1) would be a column of two forces."""
    arm = fa.Arm([fa.Link(fa.Universal(), fa.RigidBody(1.0, inertia=(1, 1, 1)))])
    state = fa.StateFeedback([[1, 2, 3, 4], [0, 1, 0, 1]], actuate=[(0, 1), (0, 0)])
    pid = fa.LinearController.pid(1.0, 0.1, 0.1, (0, 1), rate=100.0)
    for law in (state, pid, fa.PD(1.0, 1.0, (0, 1))):
        scene = fa.Scene(arm, t=np.linspace(0, 0.2, 11), v0=np.array([1.0, -0.5]), control=(law,))
        scene.save(tmp_path / "scene.toml")
        np.testing.assert_allclose(fa.load(tmp_path / "scene.toml").run().q, scene.run().q, atol=1e-9)


def test_scenes_with_balls_and_beams_are_read_back(tmp_path: Path) -> None:
    for arm in (floating_arm(), paper_link(damping_ratio=0.01)):
        options = {"atol": 1e-8, "max_order": 4, "step": None}
        scene = fa.Scene(arm, loads=(fa.Load(-1, force=[0, 0, 1]),), options=options)
        scene.save(tmp_path / "scene.toml")
        back = fa.load(tmp_path / "scene.toml")
        assert back.arm == arm and back.options == {"atol": 1e-8, "max_order": 4}


def test_what_cannot_be_written_or_is_no_run_is_a_value_error(tmp_path: Path) -> None:
    run = fa.simulate(fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, inertia=(1, 1, 1)))]), [0.0, 0.1])
    for save in (run.save, fa.load("ist").save):
        with refuses("path", "none"):
            save(tmp_path / "none" / ("x.npz" if save == run.save else "x.toml"))
    run.save(tmp_path / "x.npz")
    held = dict(np.load(tmp_path / "x.npz"))
    for wrong in ({"q": held["q"].astype(str)}, {"v": held["v"].astype(complex)}, {"t": held["t"][None]},
                  {"t": held["t"][::-1]}):  # fmt: skip
        np.savez(tmp_path / "y.npz", **(held | wrong))
        with refuses("y.npz", "damaged"):
            fa.Result.load(tmp_path / "y.npz")
