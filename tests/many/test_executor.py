"""Batches and sweeps in worker processes of the standard library, Dask and MPI, and what becomes of those that die."""

import contextlib
import os
import pickle
import re
import shutil
import signal
import subprocess
import sys
import sysconfig
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import flexarm as fa
import h5py
import numpy as np
import pytest
from messages import refuses, warns

LENGTH = "link.0.beam.length"
SCENE = replace(fa.load("ist"), t=np.linspace(0.0, 0.4, 21), options={"integrator": "gauss", "step": 4e-3})
PLAN = fa.SweepPlan([fa.Vary("grid", {LENGTH: {"from": 0.3, "to": 0.4, "count": 24}})], outputs=["final_state"])


@pytest.fixture(scope="module")
def truth():
    """The sweep in this process."""
    return fa.sweep(SCENE, PLAN)


def same(a, b):
    return all(np.array_equal(a.columns[name], b.columns[name]) for name in a.columns)


def batch(executor=None, **more):
    """B scenarios that differ in everything that has a leading axis."""
    arm, n = fa.load("ist").arm, 9
    q0 = np.zeros((n, arm.nq))
    q0[:, 1] = np.linspace(0, 0.01, n)
    t = np.linspace(0, 0.05, 11)
    tau = np.zeros((n, t.size, arm.nv))
    tau[:, :, 0] = np.linspace(-0.01, 0.01, n)[:, None]
    parameters = {LENGTH: np.linspace(0.4, 0.5, n), "gravity": [[0.0, -9.81, 0.0]]}
    hubs = [replace(link, joint=fa.Revolute("z", reflected_inertia=0.03)) for link in arm.links]
    return fa.simulate_batch(
        fa.Arm(hubs), t, q0, None, tau=tau, parameters=parameters, integrator="implicit", step=5e-3, executor=executor,
        **more,
    )  # fmt: skip


# -- the sharing itself -------------------------------------------------------------------------------------


def turned(count, executor, size=2):
    """A batch of joints that turn at their own speeds, which they keep."""
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, inertia=(1, 1, 1)))])
    v0 = np.linspace(0.0, 1.0, count)[:, None]
    found = fa.simulate_batch(arm, [0.0, 0.1], v0=v0, executor=executor, batch=size)
    np.testing.assert_allclose(found.v[:, -1], v0, atol=1e-12)


def parts(flaky):
    """The scenarios of each task that was asked for."""
    return [arguments["names"].tolist() for _, _, arguments in flaky.asked]


@pytest.mark.parametrize(("count", "size"), [(1, None), (7, 3), (64, None), (150, None), (5, 9)])
def test_shares_cover_everything_once(count, size):
    flaky = Flaky((), None)
    turned(count, flaky, size)
    assert [i for part in parts(flaky) for i in part] == list(range(count))
    assert size is not None or len(parts(flaky)) <= 64


class Flaky(Executor):
    """Runs at once, in this process; loses the n-th tasks it is given, as `how` says."""

    def __init__(self, loses, how):
        self.loses, self.how, self.given, self.asked = set(loses), how, 0, []

    def submit(self, fn, /, *args, **kwargs):
        self.asked.append(args)
        future, n = Future(), self.given
        self.given += 1
        if n in self.loses and self.how == "cancelled":
            future.cancel()
            future.set_running_or_notify_cancel()
        elif n in self.loses:
            future.set_exception(self.how)
        else:
            try:
                future.set_result(fn(*args, **kwargs))
            except Exception as e:
                future.set_exception(e)
        return future


class KilledWorker(Exception):
    """As dask.distributed calls it."""


@pytest.mark.parametrize("how", ["cancelled", KilledWorker("task-3")])
def test_lost_shares_are_redone_each_once(how):
    flaky = Flaky({0, 3, 5}, how)
    turned(10, flaky)
    asked = parts(flaky)
    assert asked[:5] == [[0, 1], [2, 3], [4, 5], [6, 7], [8, 9]] and len(asked) == 8
    assert sorted(asked[5:]) in ([[0, 1], [0, 1], [6, 7]], [[0, 1], [6, 7], [6, 7]])  # the first of them was lost again


def test_what_is_lost_every_time_ends_the_batch():
    with refuses("scenarios 0 to 1", "4 times", "task-3", error=RuntimeError):
        turned(4, Flaky(range(99), KilledWorker("task-3")))


def test_errors_of_the_work_itself_are_not_tried_again():
    flaky = Flaky({0}, ValueError("q0[3]: nonsense"))
    with refuses("nonsense"):
        turned(1, flaky)
    assert flaky.given == 1


def test_a_broken_executor_without_successor_says_what_to_give():
    with refuses("executor", "callable", error=RuntimeError):
        turned(4, Flaky({0}, BrokenExecutor("gone")))
    made = []

    def make():
        made.append(Flaky({0} if not made else (), BrokenExecutor("gone")))
        return made[-1]

    turned(4, make)
    assert len(made) == 2


def test_no_executor_is_named():
    with refuses("executor = 3"):
        fa.sweep(SCENE, PLAN, executor=3)
    with refuses("which is no"):
        fa.sweep(SCENE, PLAN, executor=lambda: None)


def test_everything_of_a_scene_pickles():
    for name in ("ist", "ist_control"):
        scene = fa.load(name)
        again = pickle.loads(pickle.dumps(scene))
        assert again.arm == scene.arm and again.arm.nv == scene.arm.nv
    run = fa.simulate(again.arm, [0, 0.01], control=again.control)
    assert np.array_equal(run.q, fa.simulate(scene.arm, [0, 0.01], control=scene.control).q)


def test_batch_in_an_executor_is_the_batch_here():
    here = batch()
    with ThreadPoolExecutor(2) as threads:
        there = batch(threads, batch=2)
    assert np.array_equal(here.q, there.q) and np.array_equal(here.v, there.v)
    assert here.arm(3) == there.arm(3) and len(there) == 9 and not there.failures


def test_ctrl_c_keeps_the_shares_that_are_done(tmp_path):

    def stop(share):
        if share > 0.4:
            raise KeyboardInterrupt

    here = batch()
    for out in (None, tmp_path / "batch.h5"):
        with ThreadPoolExecutor(2) as threads, pytest.raises(fa.errors.BatchInterrupted) as e:
            batch(threads, batch=1, progress=stop, out=out)
        part = e.value.result
        done = part.status == 0
        assert 4 <= done.sum() < 9 and np.array_equal(part.q[done], here.q[done])
        assert out is not None or np.isnan(part.q[~done]).all()
    with ThreadPoolExecutor(2) as threads:
        rest = batch(threads, batch=2, out=tmp_path / "batch.h5")
    assert rest.stats["resumed"] == done.sum() and np.array_equal(rest.q, here.q)


# -- processes ----------------------------------------------------------------------------------------------


def killer(pids):
    """A progress callback that kills one of these processes, once."""
    dead = []

    def show(done, total):
        if 0 < done < total and not dead:
            dead.append(pids()[0])
            os.kill(dead[0], signal.SIGKILL)

    show.dead = dead
    return show


@pytest.mark.parametrize("given", ["pool", "callable"])
def test_pool_with_a_killed_process(truth, given):
    pools = []

    def make():
        pools.append(ProcessPoolExecutor(2, mp_context=get_context("spawn")))
        return pools[-1]

    show = killer(lambda: list(pools[0]._processes))
    found = fa.sweep(SCENE, PLAN, executor=make() if given == "pool" else make, batch=2, progress=show)
    assert show.dead and found.complete and same(found, truth)
    assert found.stats["redone"] >= 1
    assert len(pools) == (1 if given == "pool" else 2)
    for pool in pools:
        pool.shutdown()


def test_batch_into_a_file_with_a_killed_process(tmp_path):
    here, pool = batch(), ProcessPoolExecutor(2, mp_context=get_context("spawn"))
    show = killer(lambda: list(pool._processes))
    path = tmp_path / "batch.h5"
    there = batch(pool, batch=1, out=path, progress=lambda share: show(share, 1.0))
    pool.shutdown()
    assert show.dead and there.stats["redone"] >= 1 and not there.failures
    assert np.array_equal(here.q, there.q) and np.array_equal(here.v, there.v) and (there.status == 0).all()
    again = batch(out=path)
    assert again.stats["resumed"] == 9 and np.array_equal(here.q, again.q)


def test_failures_keep_their_number_in_the_whole_batch():
    arm, t = fa.load("ist").arm, [0.0, 0.1, 0.2]
    hubs = fa.Arm([replace(link, joint=fa.Revolute("z", reflected_inertia=0.03)) for link in arm.links])
    stiff = np.full(6, 209e9)
    stiff[4] = 1e14  # far too fast for this step of rk4
    q0 = np.zeros(arm.nq)
    q0[1] = 0.01

    def run(**more):
        parameters = {"link.0.beam.material.youngs_modulus": stiff}
        return fa.simulate_batch(hubs, t, q0, parameters=parameters, integrator="rk4", step=2e-3, **more)

    with (
        ThreadPoolExecutor(2) as threads,
        warns(fa.errors.StepWarning, "scenario 4", "0.000351 s") as w,
    ):
        here, there = run(), run(executor=threads, batch=2)
    assert len(w) == 2
    assert [f.index for f in here.failures] == [4] and here.failures == there.failures
    assert np.array_equal(here.q, there.q, equal_nan=True) and np.array_equal(here.status, there.status)
    with ThreadPoolExecutor(2) as threads, refuses("scenario 5"):
        stiff[5] = -1.0
        run(executor=threads, batch=2)


def test_what_cannot_be_sent_is_explained():
    scene = replace(SCENE, drive={0: fa.Torque(lambda t: 0.0)})
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool, refuses("executor", "lambda"):
        fa.sweep(scene, PLAN, executor=pool)


# -- Dask ---------------------------------------------------------------------------------------------------


@pytest.mark.filterwarnings("default")  # of distributed's own
def test_dask_cluster_with_a_killed_worker(truth, tmp_path):
    distributed = pytest.importorskip("distributed")
    with contextlib.ExitStack() as stack:
        cluster = stack.enter_context(
            distributed.LocalCluster(
                n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, local_directory=str(tmp_path)
            )
        )
        client = stack.enter_context(distributed.Client(cluster))
        pids = client.run(os.getpid)
        show = killer(lambda: list(pids.values()))
        executor = client.get_executor()
        found = fa.sweep(SCENE, PLAN, executor=executor, batch=1, progress=show)
        assert show.dead and found.complete and same(found, truth)
        here, there = batch(), batch(executor, batch=2)
        assert np.array_equal(here.q, there.q) and np.array_equal(here.v, there.v)
        left = {w.process.pid for w in cluster.workers.values()}
        assert show.dead[0] not in left  # it had really gone


# -- MPI ----------------------------------------------------------------------------------------------------

MPI = """
import os, signal, sys
import many.test_executor as t

def main():
    from mpi4py import MPI
    from mpi4py.futures import MPIPoolExecutor
    def show(done, total):
        if sys.argv[2] == "kill" and done == 6:
            os.kill(victim, signal.SIGKILL)
    with MPIPoolExecutor() as executor:
        victim = executor.submit(os.getpid).result()
        found = t.fa.sweep(t.SCENE, t.PLAN, executor=executor, batch=2, out=sys.argv[1], progress=show)
        assert victim != os.getpid() and executor.num_workers >= 1
        assert t.same(found, t.fa.sweep(t.SCENE, t.PLAN))
        here, there = t.batch(), t.batch(executor, batch=2)
        assert t.np.array_equal(here.q, there.q)
        print("computed", found.stats["computed"], "of", len(found))

if __name__ == "__main__":
    main()
"""


def mpi(folder, how, ranks):
    """This script under mpiexec: one rank that hands out, the others work."""
    pytest.importorskip("mpi4py")
    mpiexec = shutil.which("mpiexec", path=sysconfig.get_path("scripts")) or shutil.which("mpiexec")
    if mpiexec is None:
        pytest.skip("no mpiexec here; pip install mpich")
    script = Path(folder) / "script.py"
    script.write_text(MPI)
    command = [mpiexec, "-n", str(ranks), sys.executable, "-m", "mpi4py.futures", str(script), str(folder), how]
    path = os.pathsep.join([os.path.dirname(os.path.dirname(__file__)), *filter(None, [os.environ.get("PYTHONPATH")])])
    env = {**os.environ, "PYTHONPATH": path}
    return subprocess.run(command, timeout=60, check=False, capture_output=True, text=True, env=env)


def test_mpi_and_after_a_killed_rank_the_rest(tmp_path):
    dead = mpi(tmp_path, "kill", 2)  # MPI ends all ranks when one dies; what was done is in the folder
    assert dead.returncode != 0 and "computed" not in dead.stdout
    with h5py.File(tmp_path / "sweep.h5") as f:
        assert (f["checksum"][:] != 0).sum() >= 6, dead.stderr
    rest = mpi(tmp_path, "run", 3)
    assert rest.returncode == 0, rest.stderr
    done = int(re.search(r"computed (\d+)", rest.stdout)[1])  # MPI may talk as well
    assert 0 < done <= 18  # at least 6 of 24 were kept
