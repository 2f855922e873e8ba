"""Files of batches and sweeps: interrupted, damaged, foreign, in use, and on a full disk."""

import errno
import json
import pickle
import re
import subprocess
import sys
import threading
import zipfile
from concurrent.futures import Executor, Future
from dataclasses import replace
from pathlib import Path

import flexarm as fa
import h5py
import numpy as np
import pytest
from flexarm.data.store import files, scenarios
from many.test_sweep import LENGTH, STIFF, plan, scene
from messages import refuses, warns

TIMES = np.linspace(0, 0.02, 5)


def arm():
    return fa.load("ist").arm


def run(path, count=6, **more):
    """A batch of as many lengths."""
    lengths = {LENGTH: np.linspace(0.3, 0.4, count)}
    return fa.simulate_batch(arm(), TIMES, parameters=lengths, drive={0: fa.Torque(0.01)}, out=path, batch=2, **more)


def interrupted(path, **more):
    """The same, given up when four are done."""

    def stop(share):
        if share > 0.6:
            raise KeyboardInterrupt

    with pytest.raises(fa.errors.BatchInterrupted) as e:
        run(path, executor=Serial(), progress=stop, **more)
    return e.value.result


class Serial(Executor):
    """Does all at once, in order, so that it is known what is done when."""

    def submit(self, f, /, *args, **kwargs):
        done = Future()
        done.set_result(f(*args, **kwargs))
        return done


# -- what is not done ---------------------------------------------------------------------------------------


def test_what_is_not_done_is_unknown_to_any_reader(tmp_path):
    path = tmp_path / "b.h5"
    interrupted(path)
    with h5py.File(path) as f:
        status = f["status"][:]
        assert status.tolist() == [0, 0, 0, 0, 4, 4] and (f["checksum"][:] != 0).tolist() == [True] * 4 + [False] * 2
        for name in ("q", "v"):
            assert np.isnan(f[name][:][status == 4]).all() and np.isfinite(f[name][:][status == 0]).all()
        assert f["reached"][4] == TIMES[0]
    kept = fa.BatchResult.load(path)
    assert np.isnan(kept.q[4:]).all() and kept.status.tolist() == status.tolist()
    assert run(path).stats["resumed"] == 4


def test_ctrl_c_while_a_scenario_is_written(tmp_path, monkeypatch):
    path, put = tmp_path / "b.h5", scenarios.ScenarioFile._put

    def stopped(self, name, indices, rows):
        put(self, name, indices, rows)
        if name == "status" and indices[0] == 2 and not rows.any():  # all is there but its checksum
            monkeypatch.undo()
            raise KeyboardInterrupt

    monkeypatch.setattr(scenarios.ScenarioFile, "_put", stopped)
    with refuses("2 of 6", error=fa.errors.BatchInterrupted) as e:
        run(path)
    for found in (e.value.result, fa.BatchResult.load(path)):
        assert found.status.tolist() == [0, 0, 4, 4, 4, 4] and np.isnan(found.q[2:]).all()
    assert run(path).stats["resumed"] == 2


# -- in the place of another file ---------------------------------------------------------------------------


def test_a_saved_file_appears_whole_or_not_at_all(tmp_path, monkeypatch):
    path, put = tmp_path / "x.h5", scenarios.ScenarioFile._put
    old, new = (fa.simulate_batch(arm(), TIMES, np.full((1030, 4), q)) for q in (0.0, 1e-3))
    old.save(path)

    def fails(self, name, indices, rows):
        if name == "status" and len(indices) == 6:  # of the second piece
            raise OSError(errno.ENOSPC, "")
        put(self, name, indices, rows)

    before = path.read_bytes()
    monkeypatch.setattr(scenarios.ScenarioFile, "_put", fails)
    with refuses("x.h5", "the disk is full"):
        new.save(path)
    assert path.read_bytes() == before and list(tmp_path.iterdir()) == [path]
    monkeypatch.undo()
    new.save(path)
    np.testing.assert_array_equal(fa.BatchResult.load(path).q, new.q)


@pytest.mark.skipif(not hasattr(Path, "symlink_to"), reason="has no links")
def test_a_file_lies_where_its_link_leads(tmp_path):
    (tmp_path / "there").mkdir()
    link, target = tmp_path / "x.h5", tmp_path / "there" / "y.h5"
    link.symlink_to(target)
    for stats in (0, 6):  # at first the link leads to nothing
        found = run(link)
        assert found.stats["resumed"] == stats and link.is_symlink() and not target.is_symlink()
    assert run(link, resume=False).stats["resumed"] == 0
    run(None).save(link)
    assert link.is_symlink() and list(target.parent.iterdir()) == [target]
    np.testing.assert_array_equal(fa.BatchResult.load(target).q, found.q)
    link.unlink()
    link.symlink_to(tmp_path / "nowhere" / "y.h5")
    with refuses("x.h5", "there is no folder"):
        run(link)
    link.unlink()
    link.symlink_to(link)
    with refuses("x.h5", "link", "itself", "another name"):
        run(link)


@pytest.mark.parametrize("name", ["_unlike", "_tidy", "close"])
def test_an_error_leaves_no_file_open(tmp_path, monkeypatch, name):
    path = tmp_path / "b.h5"
    interrupted(path)

    def fails(*_):
        raise OSError("a broken disk")

    if name == "_unlike":
        monkeypatch.setattr(scenarios, name, fails)
    elif name == "_tidy":
        monkeypatch.setattr(scenarios.ScenarioFile, name, fails)
    else:
        blank = scenarios.ScenarioFile._tidy
        monkeypatch.setattr(scenarios.ScenarioFile, "_tidy", lambda self: fails() if self.done().all() else blank(self))
    with refuses("a broken disk", error=OSError) as held:
        run(path)
    monkeypatch.undo()
    assert run(path).stats["resumed"] == (6 if name == "close" else 4)
    assert held.tb  # it keeps all objects of the call


# -- damage -------------------------------------------------------------------------------------------------


def flip(path, at, bit=1):
    data = bytearray(path.read_bytes())
    data[at] ^= bit
    path.write_bytes(data)


def test_flipped_bytes_are_told_of_and_computed_again(tmp_path):
    path = tmp_path / "b.h5"
    whole = run(path)
    q = whole.q.copy()
    with h5py.File(path) as f:
        offset, size = f["q"].id.get_offset(), f["q"][0].nbytes
        reasons, length = f["reason"].id.get_offset(), f["reason"].dtype.itemsize
    flip(path, offset + 2 * size + 7)
    flip(path, reasons + 4 * length + 3, 0xFF)  # no UTF-8
    with refuses("b.h5", "scenario 2, 4", "damaged", "verify=False"):
        fa.BatchResult.load(path)
    assert fa.BatchResult.load(path, verify=False).q.shape == q.shape
    again = run(path)
    assert again.stats["damaged"] == 2 and again.stats["resumed"] == 4
    np.testing.assert_array_equal(again.q, q)
    np.testing.assert_array_equal(fa.BatchResult.load(path).q, q)


def test_damaged_marks_of_what_is_done_are_told_of(tmp_path):
    path = tmp_path / "b.h5"
    whole = run(path)
    q = whole.q.copy()
    with h5py.File(path) as f:
        offset = f["checksum"].id.get_offset()
    flip(path, offset + 3 * 4 + 1, 0x10)
    with refuses("b.h5", "scenario 3", "damaged"):
        fa.BatchResult.load(path)
    again = run(path)
    assert again.stats["damaged"] == 1 and again.stats["resumed"] == 5
    np.testing.assert_array_equal(again.q, q)


def test_what_has_no_mark_is_not_done(tmp_path):
    path = tmp_path / "b.h5"
    q = run(path).q.copy()
    with h5py.File(path, "r+") as f:
        f["checksum"][3] = 0
    for verify in (True, False):
        shown = fa.BatchResult.load(path, verify=verify)
        assert shown.status.tolist() == [0, 0, 0, 4, 0, 0]
        assert np.isnan(shown.q[3]).all() and np.isfinite(shown.q[2]).all()
    again = run(path)
    assert again.stats["resumed"] == 5 and "damaged" not in again.stats
    np.testing.assert_array_equal(again.q, q)


def test_damage_to_what_all_have_in_common_is_told_of(tmp_path):
    path = tmp_path / "b.h5"
    run(path)
    with h5py.File(path) as f:
        at = f["parameters/link.0.beam.length"].id.get_offset()
    flip(path, at + 6)
    for read in (fa.BatchResult.load, run):
        with refuses("b.h5", "damaged", "checksum"):
            read(path)


@pytest.mark.parametrize("kind", ["h5", "npz"])
def test_damaged_files_are_refused_or_harmless(tmp_path, kind):
    path, bad = tmp_path / f"b.{kind}", tmp_path / f"bad.{kind}"
    result = run(tmp_path / "b.h5", 3)
    if kind == "npz":
        result.save(path)
    data, truth = path.read_bytes(), fa.BatchResult.load(path)
    assert b"GCOL" not in data  # HDF5's heap of texts, which has no checksum: the library reads a damaged one for ever
    q, v = np.array(truth.q), np.array(truth.v)
    rng, refused = np.random.default_rng(1), 0
    for seed in range(200):
        made = bytearray(data)
        if seed % 4 == 0:
            del made[rng.integers(len(made)) :]
        elif seed % 8 == 1:
            at = int(rng.integers(len(made))) // 512 * 512
            made[at : at + 512] = bytes(len(made[at : at + 512]))
        else:
            for _ in range(seed % 3 + 1):
                made[rng.integers(len(made))] ^= 1 << rng.integers(8)
        bad.write_bytes(made)
        try:
            found = fa.BatchResult.load(bad)
        except ValueError as e:
            assert f"batch {str(bad)!r}: " in str(e) and "\n" not in str(e), str(e)
            refused += 1
        else:  # what was hit says nothing, or that a scenario is not done
            done = found.status == 0
            assert np.array_equal(found.q[done], q[done]) and np.array_equal(found.v[done], v[done])
            assert np.array_equal(found.t, truth.t) and found.arm(1) == truth.arm(1)
            assert (found.status[~done] == 4).all()
    assert refused > 50
    for other in (b"", b"PK", b"\x89HDF\r\n\x1a\n", b"something else", pickle.dumps([1])):
        bad.write_bytes(other)
        with refuses(bad):
            fa.BatchResult.load(bad)
    with refuses("no such file"):
        fa.BatchResult.load(tmp_path / "nowhere.h5")
    with refuses("batch", tmp_path):
        fa.BatchResult.load(tmp_path)


def without_digest(path):
    """What an .npz holds, as an older flexarm wrote it."""
    with np.load(path) as z:
        held = dict(z)
    about = json.loads(str(held["about"]))
    del about["digest"]
    return held | {"about": np.array(json.dumps(about))}


def test_a_saved_batch_that_lost_an_array_is_refused(tmp_path):
    """As one flipped bit in the zip's directory makes it."""
    run(tmp_path / "b.h5", 3).save(tmp_path / "b.npz")
    with np.load(tmp_path / "b.npz") as z:
        held = dict(z)
    for name in set(held) - {"about"}:
        np.savez(tmp_path / "other.npz", **{k: x for k, x in held.items() if k != name})
        with refuses("other.npz", "damaged"):
            fa.BatchResult.load(tmp_path / "other.npz")


def test_rows_of_scenarios_that_are_not_done_are_blank_whatever_hit_them(tmp_path, monkeypatch):
    path = tmp_path / "b.h5"
    monkeypatch.setitem(globals(), "TIMES", np.linspace(0, 0.02, 50))
    interrupted(path)
    with h5py.File(path) as f:
        offset, size = f["q"].id.get_offset(), f["q"][0].nbytes
    flip(path, offset + 5 * size + 7, 0x40)
    q = fa.BatchResult.load(path).q
    assert np.isfinite(q[:4]).all() and np.isnan(q[4:]).all()


def test_files_of_an_older_flexarm_are_refused(tmp_path):
    path = tmp_path / "sweep.h5"
    with h5py.File(path, "w") as f:
        f["about"], f["q"], f["done"] = np.bytes_(b'{"flexarm": "0.0.9"}'), np.zeros((2, 3, 4)), np.ones(2, np.uint8)
    data = path.read_bytes()
    says = ("sweep.h5", "flexarm 0.0.9")
    for call in (fa.BatchResult.load, run, lambda p: fa.sweep(scene(), plan(2), out=p.parent)):
        with refuses(says):
            call(path)
    assert path.read_bytes() == data and [p.name for p in tmp_path.iterdir()] == ["sweep.h5"]


def test_an_array_or_the_numbers_of_another_arm_are_refused(tmp_path):
    run(tmp_path / "b.h5", 3).save(tmp_path / "b.npz")
    np.save(tmp_path / "one.npy", np.zeros(3))
    held = without_digest(tmp_path / "b.npz")
    for name, value, says in (
        ("q", held["q"][:, :-1], "'q' is float64"), ("status", held["status"][:2], "and not"),
        ("t", held["t"][::-1], "increase"), ("v", np.zeros((3, 5, 9)), "'v' is"),
        ("about", np.array("{}"), "damaged"), ("about", np.array("["), "damaged"),
        (f"parameters/{LENGTH}", np.full(2, 0.3), "of 3 scenarios"), ("status", np.zeros(3), "'status'"),
    ):  # fmt: skip
        with (tmp_path / "x.npz").open("wb") as f:
            np.savez(f, **{**held, name: value})
        with refuses("batch", "x.npz", says):
            fa.BatchResult.load(tmp_path / "x.npz")
    with refuses("file", "batch"):
        fa.BatchResult.load(tmp_path / "one.npy")


def test_what_points_out_of_the_file_is_not_read(tmp_path):
    path, secret = tmp_path / "b.h5", tmp_path / "secret"
    run(path, 3)
    secret.write_bytes(bytes(1000))
    with h5py.File(path) as f:
        shapes = {k: f[k].shape for k in ("q", "t", "reason")}
    ways = ["external", "link", "virtual", "soft"]
    for name, how in (*(("q", way) for way in ways), ("reason", "external"), ("t", "soft"), ("v", "filter")):
        bad = tmp_path / "bad.h5"
        bad.write_bytes(path.read_bytes())
        with h5py.File(bad, "r+") as f:
            kind, held = f[name].dtype, f[name][:]
            del f[name]
            if how == "external":
                f.create_dataset(name, shapes[name], kind, external=[(str(secret), 0, h5py.h5f.UNLIMITED)])
            elif how == "soft":
                f["other"] = held
                f[name] = h5py.SoftLink("/other")
            elif how == "link":
                f[name] = h5py.ExternalLink(str(path), "/q")
            elif how == "filter":
                f.create_dataset(name, data=held, compression="gzip")
            else:
                layout = h5py.VirtualLayout(shapes[name], kind)
                layout[:] = h5py.VirtualSource(str(path), "q", shapes[name])
                f.create_virtual_dataset(name, layout)
        for verify in (True, False):
            with refuses("bad.h5"):
                fa.BatchResult.load(bad, verify=verify)
        with refuses("bad.h5"):
            run(bad, 3)


# -- warnings -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("integrator", ["implicit", "ida"])
def test_warnings_of_what_was_resumed_are_told_again(tmp_path, integrator):
    path, q0 = tmp_path / "b.h5", np.zeros((6, arm().nq))
    q0[1:, 1] = 0.6  # bent too far, all but one

    def batch(**more):
        return fa.simulate_batch(arm(), [0, 1e-4, 2e-4], q0, out=path, integrator=integrator, batch=2, **more)

    def stop(share):
        if share > 0.6:
            raise KeyboardInterrupt

    with pytest.raises(fa.errors.BatchInterrupted) as e:
        batch(executor=Serial(), progress=stop)
    assert e.value.result.stats["out_of_range"] == 3
    told = []
    for _ in "ab":
        with warns(fa.errors.RangeWarning, "scenario 1", "link 0") as found:
            result = batch()
        assert result.stats["out_of_range"] == 5
        told.append([str(w.message) for w in found])
    assert told[0] == told[1] and len(told[0]) == 1
    assert fa.BatchResult.load(path).stats["out_of_range"] == 5


# -- the disk -----------------------------------------------------------------------------------------------


def test_what_the_disk_says_is_said_in_words(tmp_path, monkeypatch):
    with refuses("out =", "b.h5", "there is no folder"):
        run(tmp_path / "nowhere" / "b.h5")
    with refuses("out ="):
        run(tmp_path)
    usage = type(files.shutil.disk_usage(tmp_path))(1000, 900, 100)
    with monkeypatch.context() as m:
        m.setattr(files.shutil, "disk_usage", lambda path: usage)
        with refuses("out =", "100 B"):
            run(tmp_path / "b.h5")
        with refuses("file", "disk", "kB"):
            fa.sweep(scene(), plan(2), out=tmp_path / "s")
    assert [p.name for p in tmp_path.iterdir()] == ["s"]


LIMITED = """
import resource, sys
sys.path.insert(0, {tests!r})
from data_in_out.test_store import *
folder = Path({folder!r})
def limit(size):
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))
for k, call in enumerate((
    lambda: run(folder / "b.h5"),
    lambda: fa.sweep(scene(), plan(2), out=folder / "s"),
    lambda: run(None, 2).save(folder / "b.npz"),
    lambda: run(None, 2)[0].save(folder / "one.h5"),
    lambda: run(None, 2)[0].save(folder / "one.mat"),
    lambda: fa.sweep(scene(), plan(2), out=folder / "s").save(folder / "t"),
    lambda: run(folder / "later.h5", executor=Serial(), progress=lambda share: limit(100)),
    lambda: fa.sweep(scene(), plan(4), out=folder / "u", batch=2, progress=lambda done, n: done == 2 and limit(100)),
)):
    limit(600 if k < 5 else resource.RLIM_INFINITY)
    try:
        call()
    except ValueError as e:
        print(e)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="RLIMIT_FSIZE")
def test_a_full_disk(tmp_path):
    """A file may not grow past a limit: as it is made, while a batch runs, and the same of a sweep."""
    script = LIMITED.format(tests=str(Path(__file__).parents[1]), folder=str(tmp_path))
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0 and not done.stderr, done.stderr
    said = done.stdout.splitlines()
    assert len(said) == 7 and all("a file may not be as large as that here" in x for x in said), said
    names = ("b.h5", "sweep.h5", "b.npz", "one.h5", "one.mat", "later.h5", "sweep.h5")
    for name, line in zip(names, said, strict=True):
        assert name in line
    assert run(tmp_path / "later.h5").stats["resumed"] == 2
    assert fa.sweep(scene(), plan(4), out=tmp_path / "u").stats["computed"] == 2
    assert sorted(p.name for p in tmp_path.iterdir()) == ["later.h5", "s", "t", "u"]
    assert not [*tmp_path.rglob("*.new"), *tmp_path.rglob("*.part")]


def test_a_file_that_another_process_writes(tmp_path):
    path = tmp_path / "b.h5"
    run(path)
    code = f"import h5py; f = h5py.File({str(path)!r}, 'r+'); print('open', flush=True); input()"
    other = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        assert other.stdout.readline() == "open\n"
        for call in (fa.BatchResult.load, run, lambda p: run(p, resume=False)):
            with refuses("b.h5", "another process"):
                call(path)
    finally:
        other.communicate("\n")
    assert run(path).stats["resumed"] == 6


def test_two_threads_that_begin_one_file(tmp_path):
    found: list[str] = []

    def one() -> None:
        try:
            found.append(str(run(tmp_path / "b.h5").status.tolist()))
        except ValueError as e:
            found.append(str(e))

    threads = [threading.Thread(target=one) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    good = r"\[0, 0, 0, 0, 0, 0\]|.*another process (is using it|put another file in its place)"
    assert "[0, 0, 0, 0, 0, 0]" in found and all(re.fullmatch(good, x) for x in found), found


def test_interruptions_pickle(tmp_path):
    result = interrupted(tmp_path / "b.h5")
    one = fa.simulate(arm(), TIMES)
    table = fa.sweep(scene(), plan(2))
    for e in (
        fa.errors.BatchInterrupted("4 of 6", result), fa.errors.SimulationInterrupted("at 1", 1.0, one),
        fa.errors.SweepInterrupted("2", table), fa.SimulationError("at 1", 1.0, one),
    ):  # fmt: skip
        again = pickle.loads(pickle.dumps(e))
        assert type(again) is type(e) and str(again) == str(e) and type(again.result) is type(e.result)
        assert getattr(again, "time", 1.0) == 1.0
    again = pickle.loads(pickle.dumps(fa.errors.BatchInterrupted("4 of 6", result))).result
    np.testing.assert_array_equal(again.q, result.q)


# -- sweeps -------------------------------------------------------------------------------------------------


def begun(tmp_path, p, count=2):
    """A sweep that was interrupted when some of its scenarios were done; its file."""

    def stop(done, total):
        if done == count:
            raise KeyboardInterrupt

    with pytest.raises(fa.errors.SweepInterrupted):
        fa.sweep(scene(), p, out=tmp_path, batch=1, progress=stop)
    return tmp_path / "sweep.h5"


@pytest.mark.parametrize("count", [7, 8])
def test_damaged_scenarios_of_a_sweep_are_computed_again(tmp_path, count):
    """Of one that was interrupted, and of one that was finished: numbers, marks, reasons and trajectories."""
    p, notes = plan(8, trajectories=True), tmp_path / "notes.txt"
    notes.write_bytes(b"of the user's")
    truth = fa.sweep(scene(), p, out=tmp_path / "whole")
    path = begun(tmp_path, p, 7) if count == 7 else tmp_path / "sweep.h5"
    if count == 8:
        fa.sweep(scene(), p, out=tmp_path)
    with h5py.File(path) as f:
        names = ("columns/strain", "columns/settling", "status", "reason", "q", "checksum")
        rows = {name: (f[name].id.get_offset(), f[name][:1].nbytes) for name in names}
    for i, (at, size) in enumerate(rows.values()):
        flip(path, at + i * size + size // 2, 4)
    found = fa.sweep(scene(), p, out=tmp_path)
    assert found.complete and all(np.array_equal(found[name], truth[name], equal_nan=True) for name in truth.columns)
    assert found.stats["damaged"] == 6 and found.stats["computed"] == 6 + (8 - count)
    assert all(np.array_equal(found.trajectory(i)[1], truth.trajectory(i)[1]) for i in range(8))
    assert fa.sweep(scene(), p, out=tmp_path).stats["computed"] == 0 and notes.read_bytes() == b"of the user's"


def test_a_folder_of_another_sweep_is_refused_whatever_is_left_of_it(tmp_path):
    fa.sweep(scene(), plan(2), out=tmp_path)
    table = (tmp_path / "sweep.csv").read_bytes()
    other = fa.SweepPlan([fa.Vary("grid", {LENGTH: [0.3, 0.4], STIFF: [2e11, 3e11]})])
    with refuses("another sweep", "parameters", "folder"):
        fa.sweep(scene(), other, out=tmp_path)
    whole = tmp_path / "sweep.h5"
    data = whole.read_bytes()
    for bad in (b"", data[:200], data[:-30]):
        whole.write_bytes(bad)
        with refuses("sweep.h5", "--fresh", "file", "start"):
            fa.sweep(scene(), other, out=tmp_path)
    whole.unlink()
    with refuses("sweep.csv", "sweep.h5", "another sweep"):
        fa.sweep(scene(), other, out=tmp_path)
    assert (tmp_path / "sweep.csv").read_bytes() == table
    assert fa.sweep(scene(), other, out=tmp_path, resume=False).complete


def test_a_sweep_without_a_mark_is_not_taken_and_a_link_is_followed(tmp_path):
    path = begun(tmp_path / "s", plan(3))
    with h5py.File(path) as f:
        about = f["about"][()]
    whole = path.read_bytes()
    assert whole.count(about) == 1
    path.write_bytes(whole.replace(about, about.replace(b"marks", b"masks")))
    with refuses("sweep.h5", "damaged"):
        fa.sweep(scene(), plan(3), out=tmp_path / "s")
    moved = tmp_path / "elsewhere"
    path.unlink()
    moved.write_bytes(whole)
    path.symlink_to(moved)
    with refuses("another sweep"):
        fa.sweep(scene(), plan(4), out=tmp_path / "s")
    assert fa.sweep(scene(), plan(4), out=tmp_path / "s", resume=False).complete
    assert moved.read_bytes() != whole and path.is_symlink()
    assert fa.sweep(scene(), plan(4), out=tmp_path / "s").stats["computed"] == 0


def test_two_sweeps_that_begin_in_one_folder_do_not_mix(tmp_path):
    def meanwhile(done, total):
        if done == 0:
            for p, more in ((plan(3), {}), (plan(4), {}), (plan(3), {"resume": False})):
                with refuses("another"):
                    fa.sweep(scene(), p, out=tmp_path, **more)

    assert fa.sweep(scene(), plan(4), out=tmp_path, batch=1, progress=meanwhile).stats["computed"] == 4
    with refuses("another sweep"):
        fa.sweep(scene(), plan(3), out=tmp_path)


def test_a_batch_and_a_sweep_do_not_take_each_others_files(tmp_path):
    run(tmp_path / "sweep.h5")
    with refuses("another sweep"):
        fa.sweep(scene(), plan(2), out=tmp_path)
    assert fa.sweep(scene(), plan(2, trajectories=True), out=tmp_path, resume=False).complete
    with refuses("another batch"):
        run(tmp_path / "sweep.h5")
    kept = fa.BatchResult.load(tmp_path / "sweep.h5")  # to be read it is one like the other
    assert len(kept) == 2 and np.isfinite(kept.q).all() and kept.arm(0).links[0].beam.length == 0.3


def test_trajectories_that_are_damaged_or_gone(tmp_path):
    p = plan(2, trajectories=True)
    found = fa.sweep(scene(), p, out=tmp_path)
    q, path = found.trajectory(1)[1], tmp_path / "sweep.h5"
    with h5py.File(path) as f:
        where = f["q"].id.get_offset() + f["q"][0].nbytes
    flip(path, where + 20)
    assert found.trajectory(0)[1].shape == q.shape
    with refuses("sweep.h5", "scenario 1", "damaged"):
        found.trajectory(1)
    again = fa.sweep(scene(), p, out=tmp_path)
    assert again.stats["computed"] == 1 and again.stats["damaged"] == 1
    np.testing.assert_array_equal(again.trajectory(1)[1], q)
    path.unlink()
    with refuses("no such file"):
        found.trajectory(1)


def test_a_sweep_knows_its_functions(tmp_path):
    def swept(w, **more):
        def scaled(result):
            return w * np.ptp(result.q[:, 0])

        return fa.sweep(
            scene(), fa.SweepPlan([fa.Vary("grid", {LENGTH: [0.3]})], outputs=[scaled]), out=tmp_path, **more
        )

    with refuses("outputs", "scaled", "name=", "code"):
        swept(1.0)
    swept(1.0, name="A")
    assert swept(1.0, name="A").stats["computed"] == 0
    for w, name in ((2.0, "A"), (1.0, "B")):
        with refuses("another sweep"):
            swept(w, name=name)
    assert swept(1.0, name="B", resume=False).complete


def test_failures_in_a_saved_batch_of_an_older_flexarm(tmp_path):
    """Whose status 1 was a singular mass matrix, and not a terminal event."""
    path = tmp_path / "b.npz"
    run(None).save(path)
    held = without_digest(path)
    held["status"][:4], held["reason"][1:4] = (0, 1, 2, 3), b"the mass matrix is singular"
    np.savez(path, **held)
    old = fa.BatchResult.load(path)
    assert old.status.tolist() == [0, 5, 5, 5, 0, 0] and [f.index for f in old.failures] == [1, 2, 3]
    assert old[1].status == 0


def test_a_reason_is_cut_between_letters(tmp_path):
    one = run(None, 1)
    for name in ("b.h5", "b.npz"):
        for reason, kept in (("ü" * 400, "ü" * 250), ("a" + "ü" * 400, "a" + "ü" * 249)):
            replace(one, failures=[fa.results.Failure(0, 0.01, reason)], status=one.status + 5).save(tmp_path / name)
            assert [f.reason for f in fa.BatchResult.load(tmp_path / name).failures] == [kept]


def test_zip_files_are_read_whole_or_not_at_all(tmp_path):
    run(tmp_path / "b.h5").save(tmp_path / "b.npz")
    with zipfile.ZipFile(tmp_path / "b.npz") as z:
        info = z.getinfo("q.npy")
    flip(tmp_path / "b.npz", info.header_offset + 80)
    with refuses("b.npz", "file", "damaged"):
        fa.BatchResult.load(tmp_path / "b.npz")


def test_nobody_is_locked_out_by_one_that_was_killed(tmp_path):
    path = tmp_path / "b.h5"
    code = f"""
import os, signal, sys
sys.path.insert(0, {str(Path(__file__).parents[1])!r})
from data_in_out.test_store import *
def stop(share):
    if share > 0.3: os.kill(os.getpid(), signal.SIGKILL)
run(Path({str(path)!r}), executor=Serial(), progress=stop)
"""
    subprocess.run([sys.executable, "-c", code], timeout=60, check=False)
    assert 0 < run(path).stats["resumed"] < 6
