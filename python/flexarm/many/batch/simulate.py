"""Batches: many simulations that differ in their start, forces and parameters."""

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..._check import Array, choice, increasing, instance, instances, warn, whole, within
from ..._console import progress_bar
from ...analysis.findings import LoopWarning, RangeWarning
from ...analysis.validity import range_warning
from ...arm.arm import Arm
from ...arm.variation import Setup, Variation
from ...loop.loops import unstable
from ...model.acting.control import Controller, controllers
from ...model.acting.drive import Motion, split_drives
from ...model.acting.load import Load
from ...run.integrators import INTEGRATORS, Integrator, integrator_of, named
from ...run.start import check_one_start, start
from .arguments import check_memory, checked_drive, default_workers, forces, rows, scenario_count
from .job import OUTPUTS, Job, width
from .problems import NOT_DONE
from .result import BatchResult
from .rollout import BatchInterrupted, lowest
from .runner import Runner
from .storage import File, Memory


def batch_memory(arm: Arm, scenarios: int, rows: int, outputs: Sequence[str] = ("q", "v")) -> int:
    """Bytes of a batch's result: 8 B nt (nq + nv) for q and v. Beside it each worker has one workspace, and, where
    parameters change the arm, some hundred arms at a time are held.

    Args:
        arm: the arm. scenarios: B. rows: nt, output times.
        outputs: which of "q", "v", "a", "tau", "contacts", "loops" are kept.
    """
    return 8 * scenarios * rows * sum(width(arm, k) for k in outputs)


def make_job(
    arm: Any, t: Any, q0: Any, v0: Any, tau: Any = None, *, drive: Any, loads: Any, control: Any, parameters: Any,
    outputs: Any, every: Any = 1, integrator: str | Integrator | None = None, events: Any = None, **options: Any,
) -> tuple[Job, int]:  # fmt: skip
    """The batch, checked, and its number of scenarios."""
    setup = _make_setup(arm, drive, loads, control)
    times = increasing("t", t)
    integrator = named(setup, integrator, options)
    if isinstance(integrator, str) and INTEGRATORS[choice("integrator", integrator, INTEGRATORS)].needs_step:
        options = {"step": float(np.diff(times).min()), **{k: x for k, x in options.items() if x is not None}}
    chosen = integrator_of(integrator, **options)
    within("every", whole("every", every), 1, times.size - 1, ", the number of steps")
    outputs = instances("outputs", outputs, object, f"some of {', '.join(OUTPUTS)}", 1)
    wanted = tuple(k for k in OUTPUTS if k in [choice("outputs", x, OUTPUTS) for x in outputs])
    for output in ("contacts", "loops"):
        if output in wanted and not getattr(setup.arm, output):
            raise ValueError(f"outputs: '{output}': the arm has none")
    variation = Variation(setup, parameters)
    balance = q0 if isinstance(q0, str) else None
    if balance is not None or (setup.arm.constrained and (q0 is None or isinstance(q0, Mapping))):
        q0 = _balances(variation, q0, float(times[0]), tau)
    q, v = rows("q0", arm._posed(q0), arm.zero), rows("v0", v0, np.zeros(arm.nv))
    held = forces(tau, arm.nv, times.size, "nt")
    starts = {}
    for name, given, value in (("q0", q0, q), ("v0", v0, v)):
        said = variation.initial(name, value)
        starts[name] = None if given is None and said is value else said
    sizes = {name: len(x) for name, x in starts.items() if x is not None}
    count = scenario_count({"arm": 1, **sizes, "tau": len(held), **variation.sizes})
    job = Job(variation, times, starts["q0"], starts["v0"], None if tau is None else held, wanted, every, chosen,
              events, whole=count, balance=balance)  # fmt: skip
    return job, count


def _balances(variation: Variation, word: Any, t: float, tau: Any) -> Array:
    """The balance of each scenario at time t (s), or where its loops are closed, (B or 1, nq)."""
    check_one_start(word, variation.values)
    if tau is not None and word == "equilibrium":
        raise ValueError("tau: goes with a q0 in numbers; a constant force that is a drive is in the balance")
    count, found = 1 if variation.one_setup else max(variation.sizes.values()), []
    for i in range(count):
        s = variation.scenario(i)
        try:
            found.append(start(s.arm, word, s.drive, s.loads, t, None, s.control))
        except ValueError as e:
            raise ValueError(f"q0 = {word!r}, scenario {i}: {e}") from None
    return np.array(found)


def _make_setup(arm: Any, drive: Any, loads: Any, control: Any) -> Setup:
    """The common setup of the scenarios, checked."""
    drives = checked_drive(drive)
    instance("arm", arm, Arm, "an Arm; give differences as parameters")
    return Setup(arm, drives, instances("loads", loads or (), Load, "Load"), controllers(control))


def simulate_batch(
    arm: Arm,
    t: ArrayLike,
    q0: ArrayLike | str | None = None,
    v0: ArrayLike | None = None,
    *,
    tau: ArrayLike | None = None,
    parameters: Mapping[str, ArrayLike] | None = None,
    drive: Mapping[Any, Any] | None = None,
    loads: Sequence[Load] | None = None,
    control: Controller | Sequence[Controller] | None = None,
    integrator: str | Integrator = "implicit",
    outputs: Sequence[str] = ("q", "v"),
    every: int = 1,
    workers: int | None = None,
    progress: Any = False,
    out: str | Path | Mapping[str, Array] | None = None,
    resume: bool = True,
    name: str | None = None,
    executor: Any = None,
    batch: int | None = None,
    **options: Any,
) -> BatchResult:
    """Simulates B scenarios over threads. Arguments that are not given B times are alike for all. The result of a
    scenario depends neither on the workers nor on the others; a failed one is reported, and does not affect others.

    Args:
        arm, t, drive, loads, control: as of `simulate`.
        q0, v0: (B, nq) or (nq,), (B, nv) or (nv,). A q0 of "equilibrium", "trim" or "held" is the balance of each
            scenario.
        tau: generalised forces (N, N m), (B, nt, nv) or (nt, nv), held from t[k] to t[k + 1]; the last row acts on
            nothing. An axis of length 1 stands for all scenarios or times.
        parameters: values (B, ...), by their paths in a scene: "link.0.tip.mass", "link.1.beam.length",
            "link.0.beam.material.youngs_modulus", "link.0.tip.com.1", "gravity" (B, 3), "gravity.2", "control.0.kp",
            "load.0.force" (B, 3), "load.0.scale", "drive.0.scale", "drive.0.offset", "drive.0.delay", "drive.0.value"
            of a constant torque, "q0.1".
            Beams and links that repeat are built once. Modes and joints, which change the coordinates, cannot differ.
        integrator, options: as of `simulate`; the step of "implicit" and "rk4" is the shortest time between two of t,
            if none is given.
            "implicit" and "rk4" step scenarios side by side, whatever acts on the arm; with other integrators, and dry
            friction with "rk4", each scenario is one `simulate`, and `stats["lanes"]` 0. docs/batch.md has a table of
            their costs. A Python function that several scenarios share is called for all of them in turn: it must
            not remember one of them.
        outputs: which of "q", "v", "a", "tau", "contacts", the forces of these, with friction, and "loops",
            likewise.
        every: times of t between two rows of the result.
        workers: threads; None: one for each core.
        progress: shows a bar on stderr, or lines where that is no terminal; or a callable, which is given the share
            done about ten times a second and whenever a part of `batch` scenarios is done, and may raise to give up.
        out: arrays by name that the result is written into; or a file ("sweep.h5"), written as the scenarios are
            done: the same call again computes missing and damaged ones, whatever stopped it.
            Another batch's file is refused, and that of another version of flexarm; see docs/batch.md.
        resume: whether to go on with such a file; if not, it is written over.
        name: for a file, where functions or objects take part that are not flexarm's: a name for all of them, such as
            "law 2", and another one when you change them. Their code is not compared; their attributes are.
        executor: a concurrent.futures.Executor, or a callable that makes one, whose workers take shares of the batch:
            a ProcessPoolExecutor, Dask's client.get_executor(), mpi4py's MPIPoolExecutor(). Shares of workers that
            die are computed again; docs/sweeps.md. `workers` are then the threads in each (1 if None).
        batch: scenarios at once, in memory together and written to a file together. None: 256, or 16 for each worker,
            whichever is more, and at most as many as 64 MB hold where there is a file; all, where nothing but the start
            and the forces differ; with an executor a 64th of all.

    Returns:
        BatchResult; `batch_memory` tells its bytes beforehand.

    Raises:
        ValueError: bad arguments, nan and inf among them; a scenario's, with its index. Nothing is run then.
        BatchInterrupted: (a KeyboardInterrupt) Ctrl-C; its `result` holds the results so far.

    Warns:
        RangeWarning: a beam bent beyond the range of its order, in at least one scenario.
        LoopWarning: a control loop is unstable about the start of a scenario, which has grown.
        StepWarning, SlowWarning: as `simulate`. Of each kind, that of the lowest scenario found.
    """
    job, count = make_job(
        arm, t, q0, v0, tau, drive=drive, loads=loads, control=control, parameters=parameters, outputs=outputs,
        every=every, integrator=integrator, **options,
    )  # fmt: skip
    workers = default_workers(1 if workers is None and executor is not None else workers)
    if not out:
        kept = f"outputs: {count} scenarios of {job.rows} rows"
        check_memory(kept, batch_memory(arm, count, job.rows, job.outputs), "fewer `outputs`, or out='file.h5'")
    started = time.perf_counter()
    runner = Runner(job, count, workers, batch, executor)
    storage: File | Memory
    if isinstance(out, (str, Path)):
        storage = File(job, count, Path(out), resume, name)
    else:
        storage = Memory(job, count, out)
    with progress_bar(progress, "simulating") as bar:
        show = None if bar is None else lambda done: bar(done / count)
        held, failures, interrupted = runner.run(storage, show)
    beyond = np.flatnonzero(~np.isnan(held["out_of_range"][:, 0]))
    stats = {**runner.stats, **({"out_of_range": beyond.size} if beyond.size else {})}
    arrays: dict[str, Any] = {k: held.get(k) for k in (*OUTPUTS, "status", "reached", "events")}
    result = BatchResult(job.t[:: job.every], **arrays, variation=job.variation, failures=failures,
                         stats={**stats, "wall_time": time.perf_counter() - started}, _job=job,
                         _wrong=held["wrong"])  # fmt: skip
    if interrupted:
        done = int((result.status != NOT_DONE).sum())
        raise BatchInterrupted(f"interrupted when {done} of {count} scenarios were done", result)
    found = lowest(held["wrong"])
    if beyond.size:  # if a loop bent the beams too far, its warning replaces this one
        i = int(beyond[0])
        loop = _loop_of(job, i, float(held["reached"][i]))
        if loop is None:
            worst = range_warning(job.variation.scenario(i).arm, held["out_of_range"][i])
            found[RangeWarning] = worst.of(f"scenario {i}")
        else:
            found.setdefault(LoopWarning, loop.of(f"scenario {i}"))
    for warning in found.values():
        warn(warning)
    return result


def _loop_of(job: Job, i: int, reached: float) -> LoopWarning | None:
    """The unstable loop of control that bent the beams of scenario i too far by the time reached (s), or None."""
    s = job.variation.scenario(i)
    if not s.control:
        return None
    laws = s.arm.by_rate("drive", split_drives(s.arm, s.drive)[0])
    prescribed = [k for k, law in laws.items() if isinstance(law, Motion)]
    q0 = s.arm.zero if job.q0 is None else job.q0[i % len(job.q0)]
    return unstable(s.arm, q0, prescribed, job.t, s.forces, s.control, reached - float(job.t[0]), True)
