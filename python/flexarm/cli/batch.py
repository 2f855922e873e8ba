"""`flexarm batch SCENE SWEEP`: its options and its output."""

import argparse
import functools
from typing import Any

import numpy as np

from .._console import aligned, complain
from ..many.sweeps.sweep import SweepInterrupted, sweep
from ..many.sweeps.vary import SweepPlan
from ..run.scene.scene import load
from . import options

SUMMARY = "simulate a scene many times over, its parameters varied"
TEXT = (
    "Writes sweep.csv, a line for each scenario, sweep.png, and sweep.h5, which holds the finished scenarios and, "
    "where SWEEP says so, trajectories. An interrupted sweep goes on when the same command is given again."
)


def arguments(p: argparse.ArgumentParser) -> None:
    options.scene(p)
    sweep = "TOML file of the parameters to vary (docs/sweeps.md), or the name of a shipped one such as ist"
    p.add_argument("sweep", metavar="SWEEP", help=sweep)
    options.output(p, "flexarm-batch")
    workers = "how many threads, or processes (default: one for each core)"
    p.add_argument("--workers", metavar="N", type=int, help=workers)
    where = (
        "where to compute: threads; processes; mpi, under 'mpiexec -n N python -m mpi4py.futures -m flexarm batch'; "
    )
    where += "or the address of a Dask scheduler, such as tcp://host:8786 (default: %(default)s)"
    p.add_argument("--on", metavar="WHERE", default="threads", help=where)
    p.add_argument("--fresh", action="store_true", help="discard the runs of an earlier sweep in DIR")


def _executor(where: str, workers: int | None) -> Any:
    """The maker of the executor, or None for threads."""
    if workers is not None and workers < 1:
        raise ValueError(f"--workers {workers}: must be at least 1")
    if where == "threads":
        return None
    if where == "processes":
        from concurrent.futures import ProcessPoolExecutor
        from multiprocessing import get_context

        return functools.partial(ProcessPoolExecutor, workers, mp_context=get_context("spawn"))
    try:
        if where == "mpi":
            from mpi4py.futures import MPIPoolExecutor

            return MPIPoolExecutor
        if "://" in where:
            import distributed

            client: Any = distributed.Client  # no type stubs
            return client(where, timeout=10).get_executor()
    except ImportError as e:
        extra = "mpi" if where == "mpi" else "dask"
        raise ValueError(f"--on {where}: {e}; pip install 'flexarm[{extra}]'") from None
    except (OSError, TimeoutError) as e:
        raise ValueError(f"--on {where}: no scheduler answers there ({e})") from None
    raise ValueError(f"--on {where}: must be threads, processes, mpi, or an address such as tcp://host:8786")


def run(args: argparse.Namespace) -> int:
    """Sweeps, writes and prints; 0, 1 where no scenario came to its end, 130 after Ctrl-C."""
    scene, plan = load(args.scene), SweepPlan.load(args.sweep)
    executor = _executor(args.on, args.workers)
    out = options.Output(args.output)
    workers = args.workers if executor is None else None
    interrupted = None
    try:
        result = sweep(
            scene, plan, out=out.path, resume=not args.fresh, workers=workers, executor=executor, progress=True
        )
    except SweepInterrupted as e:
        interrupted, result = e, e.result
    out.files += sorted(path.name for path in out.path.iterdir() if path.is_file())
    about = {**_summary(result), "scene": scene.name}
    options.told(args, out.described(about), *_lines(about), f"Table, picture and data are in {out}")
    if interrupted is not None:
        complain(f"{interrupted}; the same command goes on from there")
        return 130
    if len(result.failures) == len(result):
        complain(f"no scenario came to its end; the first: {result.failures[0][2]}")
        return 1
    return 0


def _extremes(values: Any) -> dict[str, Any]:
    """Least, middle and greatest number of a column, and the scenarios of the first and the last."""
    good = np.flatnonzero(np.isfinite(values))
    if not good.size:
        return {k: float("nan") for k in ("minimum", "median", "maximum")} | {"minimum_at": None, "maximum_at": None}
    low, high = int(good[values[good].argmin()]), int(good[values[good].argmax()])
    numbers = {"minimum": float(values[low]), "median": float(np.median(values[good])), "maximum": float(values[high])}
    return {**numbers, "minimum_at": low, "maximum_at": high}


def _summary(result: Any) -> dict[str, Any]:
    columns = [{"name": n, "unit": result.units[n], **_extremes(values)} for n, values in result.columns.items()]
    failures = [{"scenario": i, "time": t, "reason": reason} for i, t, reason in result.failures]
    return {
        "sweep": result.plan.title, "complete": result.complete, "scenarios": len(result),
        "done": int(result.done.sum()), "parameters": list(result.parameters), "columns": columns,
        "failures": failures, "beyond_range": [i for i, *_ in result.beyond], "stats": result.stats,
    }  # fmt: skip


def _lines(about: dict[str, Any]) -> list[str]:
    """The summary as text."""
    rows = [["", "unit", "minimum", "in scenario", "median", "maximum", "in scenario"]]
    for c in about["columns"]:
        low, high = ("" if c[k] is None else str(c[k]) for k in ("minimum_at", "maximum_at"))
        least, middle, most = (f"{c[k]:.6g}" for k in ("minimum", "median", "maximum"))
        rows.append([c["name"], c["unit"], least, low, middle, most, high])
    lines = [f"{about['sweep']}: {about['done']} of {about['scenarios']} scenarios", *aligned(rows, range(2, 7))]
    for f in about["failures"][:1]:
        first = f"scenario {f['scenario']}, at t = {f['time']:.4g} s: {f['reason']}"
        lines.append(f"{len(about['failures'])} failed; the first, {first}")
    return [*lines, f"{about['stats']['computed']} computed in {about['stats']['wall_time']:.3g} s"]
