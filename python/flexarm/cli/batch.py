"""`flexarm batch SCENE SWEEP`: its options and its output."""

from __future__ import annotations

import argparse
import functools
import os
from typing import Any

from .._console import complain, empty_table, json_text, output_folder, print_table
from ..many.sweeps.sweep import SweepInterrupted, sweep
from ..many.sweeps.vary import SweepPlan
from ..run.scene.scene import load
from . import options

SUMMARY = "simulate a scene many times over, its parameters varied"
TEXT = (
    "Writes sweep.csv, a line for each scenario, sweep.png, and sweep.h5, which holds what is done and, where SWEEP "
    "says so, trajectories. What was interrupted goes on when the same command is given again."
)


def arguments(p: argparse.ArgumentParser) -> None:
    options.scene(p)
    sweep = "TOML file of what to vary (docs/sweeps.md), or the name of a shipped one such as ist"
    p.add_argument("sweep", metavar="SWEEP", help=sweep)
    options.output(p, "flexarm-batch")
    workers = "how many threads, or processes (default: one for each core)"
    p.add_argument("--workers", metavar="N", type=int, help=workers)
    where = (
        "where to compute: threads; processes; mpi, under 'mpiexec -n N python -m mpi4py.futures -m flexarm batch'; "
    )
    where += "or the address of a Dask scheduler, such as tcp://host:8786 (default: %(default)s)"
    p.add_argument("--on", metavar="WHERE", default="threads", help=where)
    p.add_argument("--fresh", action="store_true", help="forget what DIR holds of an earlier sweep")


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
    folder = output_folder(args.output)
    workers = args.workers if executor is None else None
    interrupted = None
    try:
        result = sweep(
            scene, plan, out=folder, resume=not args.fresh, workers=workers, executor=executor, progress=True
        )
    except SweepInterrupted as e:
        interrupted, result = e, e.result
    files = sorted(path.name for path in folder.iterdir() if path.is_file())
    if args.json:
        print(json_text({**_summary(result), "scene": scene.name, "folder": str(folder), "files": files}))
    else:
        _print(result, str(folder))
    if interrupted is not None:
        complain(f"{interrupted}; the same command goes on from there")
        return 130
    if len(result.failures) == len(result):
        complain(f"no scenario came to its end; the first: {result.failures[0][2]}")
        return 1
    return 0


def _summary(result: Any) -> dict[str, Any]:
    import numpy as np

    columns = []
    for name, values in result.columns.items():
        good = values[np.isfinite(values)]
        least, most = (float(good.min()), float(good.max())) if good.size else (float("nan"),) * 2
        middle = float(np.median(good)) if good.size else float("nan")
        at = [int(np.nanargmin(values)), int(np.nanargmax(values))] if good.size else [None, None]
        columns.append(
            {"name": name, "unit": result.units[name], "minimum": least, "median": middle, "maximum": most,
             "minimum_at": at[0], "maximum_at": at[1]}
        )  # fmt: skip
    failures = [{"scenario": i, "time": t, "reason": reason} for i, t, reason in result.failures]
    return {
        "sweep": result.plan.title, "complete": result.complete, "scenarios": len(result),
        "done": int(result.done.sum()), "parameters": list(result.parameters), "columns": columns,
        "failures": failures, "beyond_range": [i for i, *_ in result.beyond], "stats": result.stats,
    }  # fmt: skip


def _print(result: Any, folder: str) -> None:
    summary = _summary(result)
    table = empty_table(
        f"{result.plan.title}: {summary['done']} of {len(result)} scenarios",
        "", "unit", "minimum", "in scenario", "median", "maximum", "in scenario ",
    )  # fmt: skip
    for c in summary["columns"]:
        at = ["" if c[k] is None else str(c[k]) for k in ("minimum_at", "maximum_at")]
        least, middle, most = (f"{c[k]:.6g}" for k in ("minimum", "median", "maximum"))
        table.add_row(c["name"], c["unit"], least, at[0], middle, most, at[1])
    print_table(table)
    if result.failures:
        i, t, reason = result.failures[0]
        print(f"{len(result.failures)} failed; the first, scenario {i}, at t = {t:.4g} s: {reason}")
    print(f"{result.stats['computed']} computed in {result.stats['wall_time']:.3g} s")
    print(f"Table, picture and data are in {folder}{os.sep}")
