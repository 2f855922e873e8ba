"""Runs that are stopped from outside: Ctrl-C, and the end of the process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import flexarm as fa
import numpy as np
import pytest
from arms import STEEL, paper_link
from flexarm import _threads

SOON = 1.5  # s of the processor, within which Ctrl-C must have its effect: no other work on the machine counts

AT_THE_END = """
import threading, time
import numpy as np
import flexarm as fa

arm = fa.load("ist").arm
t, v0 = np.linspace(0, 1e4, 11), np.full(4, 0.1)
def slow(t):
    begun.set()
    time.sleep(0.2)
    return 0.0
def told(share):
    begun.set()
runs = {
    "simulate": lambda: fa.simulate(arm, t, v0=v0, progress=told),
    "callable": lambda: fa.simulate(arm, t, v0=v0, drive={0: fa.Torque(slow)}),
    "rollout": lambda: fa.rollout(arm, np.zeros((20, 4)), v0, step=1e-4, nstep=10**6, every=10**6, progress=told),
    "batch": lambda: fa.simulate_batch(arm, t, v0=np.tile(v0, (20, 1)), integrator="ida", progress=told),
    "evaluations": lambda: (begun.set(), arm.forward_dynamics(np.zeros((3 * 10**6, 4)), v0, v0)),
}
begun = threading.Event()
threading.Thread(target=runs[WHAT], daemon=True).start()
begun.wait()
time.sleep(0.05)
print("over", flush=True)
"""


@pytest.mark.parametrize("what", ["simulate", "callable", "rollout", "batch", "evaluations"])
def test_a_daemon_thread_may_be_in_a_run_when_the_process_ends(what):
    command = [sys.executable, "-W", "ignore", "-c", f"WHAT = {what!r}\n{AT_THE_END}"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (0, "over\n", "")


@contextmanager
def ctrl_c(after: float) -> Iterator[Callable[[], float]]:
    """Sends SIGINT to this process; gives how much it has computed since (s of processors)."""
    sent: list[float] = []

    def send() -> None:
        sent.append(time.process_time())
        os.kill(os.getpid(), signal.SIGINT)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may have it ignored
    timer = threading.Timer(after, send)
    timer.start()
    try:
        yield lambda: time.process_time() - sent[0]
    finally:
        timer.cancel()
        timer.join()
        signal.signal(signal.SIGINT, before)


def chain(n: int, modes: int) -> fa.Arm:
    beam = fa.Beam(0.5, fa.Rectangle(0.01, 0.02), STEEL, {"bending_y": modes, "bending_z": modes})
    return fa.Arm([fa.Link(fa.Revolute("zy"[k % 2]), beam=beam) for k in range(n)])


EVALUATIONS = {
    "forward_dynamics": lambda arm, n: arm.forward_dynamics(np.zeros((n, arm.nv)), np.zeros(arm.nv), np.zeros(arm.nv)),
    "inverse_dynamics": lambda arm, n: arm.inverse_dynamics(np.zeros((n, arm.nv)), np.zeros(arm.nv), np.zeros(arm.nv)),
    "mass_matrix": lambda arm, n: arm.mass_matrix(np.zeros((n // 8, arm.nv))),
    "jacobian": lambda arm, n: arm.jacobian(np.zeros((n // 2, arm.nv))),
    "energy": lambda arm, n: arm.energy(np.zeros((n, arm.nv)), np.zeros(arm.nv)),
}


@pytest.mark.parametrize("what", EVALUATIONS)
def test_ctrl_c_stops_evaluations_and_other_threads_go_on(what):
    arm, n = chain(3, 2), 1000
    for _ in range(12):  # for about 2 s
        begun = time.process_time()
        EVALUATIONS[what](arm, n)
        took = time.process_time() - begun
        if took > 0.05:
            break
        n *= 2
    with ctrl_c(after=0.3) as since, pytest.raises(KeyboardInterrupt):
        for _ in range(40):
            EVALUATIONS[what](arm, min(int(4 * n / took), 10**9 // arm.nv**2))
    assert since() < SOON


def test_other_threads_go_on_during_evaluations():
    arm, counted, stop = chain(3, 2), [0], threading.Event()

    def count() -> None:
        while not stop.is_set():
            counted[0] += 1
            time.sleep(1e-3)

    other = threading.Thread(target=count)
    other.start()
    try:
        for n in (4000, 40_000, 400_000):  # until one takes long enough
            before = counted[0]
            arm.mass_matrix(np.zeros((n, arm.nv)))
            done = counted[0] - before
            if done >= 3:
                break
    finally:
        stop.set()
        other.join()
    assert done >= 3


def test_ctrl_c_stops_steps_of_gauss_that_cannot_be_solved():
    arm = chain(6, 3)  # 42 coordinates, thrown so fast that steps are halved again and again
    with ctrl_c(after=0.5) as since, pytest.raises(fa.errors.SimulationInterrupted):
        fa.simulate(arm, [0, 100.0], v0=np.full(arm.nv, 0.3), integrator="gauss", step=0.05)
    assert since() < SOON


@pytest.mark.parametrize("prescribed", [False, True])
def test_ctrl_c_between_many_rows_of_one_step(prescribed):
    arm, t = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, (0.1, 0, 0)))] * 4), np.linspace(0, 1, 300_001)
    options = (
        {"drive": {k: fa.Motion.spin_up(1.0, 1.0) for k in range(4)}}
        if prescribed
        else {"v0": np.ones(4), "integrator": "gauss", "step": 0.5}
    )
    with ctrl_c(after=0.4) as since, pytest.raises(KeyboardInterrupt) as caught:
        for _ in range(20):
            fa.simulate(arm, t, **options)
    assert since() < SOON
    if isinstance(caught.value, fa.errors.SimulationInterrupted):  # not between two runs
        assert len(caught.value.result.t) < len(t)


@pytest.mark.filterwarnings("ignore::flexarm.errors.RangeWarning")
def test_ctrl_c_while_a_batch_builds_its_beams():
    taper = fa.sections.Taper([0, 0.2, 0.5], [fa.Rectangle(y, 0.02) for y in (0.004, 0.003, 0.002)])
    arm = fa.Arm([fa.Link(fa.Revolute("z"), beam=fa.Beam(0.5, taper, STEEL, {"bending_y": 3, "bending_z": 3}))])
    tips, kinds = np.linspace(0, 1, 4000), "link.0.beam.material.density"
    before = threading.active_count()
    with ctrl_c(after=0.6) as since, pytest.raises(fa.errors.BatchInterrupted) as caught:
        fa.simulate_batch(arm, [0, 0.01], parameters={kinds: 7000 + tips}, integrator="implicit", step=0.01, workers=2)
    assert since() < SOON and len(caught.value.result) == 4000
    assert threading.active_count() == before


def test_what_an_interrupted_batch_gives_does_not_change_any_more():
    """Thread.join of Python up to 3.12, interrupted, takes threads that run for ended ones."""
    stop, ended = threading.Event(), []

    def work(k: int) -> None:
        stop.wait()
        time.sleep(0.2)  # to its next look around
        ended.append(k)

    with ctrl_c(after=0.3) as since, pytest.raises(KeyboardInterrupt):
        _threads.each(work, 8, 1, stop=stop.set)
    assert ended == [0] and since() < SOON


def test_progress_of_a_batch_is_told_while_it_builds_and_runs():
    shares: list[float] = []
    lengths = {"link.0.beam.length": np.linspace(0.4, 0.5, 300)}
    fa.simulate_batch(
        paper_link(order=2), np.linspace(0, 0.02, 3), parameters=lengths, step=1e-3, workers=1, batch=8,
        progress=shares.append,
    )  # fmt: skip
    assert 0.0 <= shares[0] < 1.0 == shares[-1] and (np.diff(shares) >= 0).all()
