"""Files of runs, tables, batches and sweeps: damaged at random, killed while they are written, and timed.

    python bench/data/trials.py [--damages 3600] [--kills 30] [--scenarios 1000]

A damaged file must be refused, or read with the numbers that it had; a scenario of a batch may also be read as not
done. A batch that was killed must end with the bits of one that was not. A .csv has no checksum, and is not tried.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import flexarm as fa
import h5py
import numpy as np
from numpy.typing import NDArray

LENGTH = "link.0.beam.length"
TIMES = np.linspace(0, 0.02, 21)
Read = Callable[[Path], dict[str, NDArray[Any]]]


def batch(out: Path | None, count: int = 6, times: Any = TIMES, **more: Any) -> fa.BatchResult:
    """Beams of as many lengths."""
    lengths = {LENGTH: np.linspace(0.3, 0.4, count)}
    return fa.simulate_batch(
        fa.load("ist").arm, times, parameters=lengths, drive={0: fa.Torque(0.01)}, out=out, workers=1, **more
    )


def sweep(folder: Path) -> fa.results.SweepResult:
    scene = replace(fa.load("ist"), t=TIMES, options={"integrator": "implicit", "step": 1e-3})
    vary = fa.Vary("grid", {LENGTH: np.linspace(0.3, 0.4, 4).tolist()})
    return fa.sweep(scene, fa.SweepPlan([vary], trajectories=True, outputs=["tip_deflection"]), out=folder, workers=1)


# -- damage ----------------------------------------------------------------------------------------------------------


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """A file with up to three flipped bits, a sector of zeros, a piece cut out, or without its end."""
    made, at = bytearray(data), int(rng.integers(len(data)))
    way = int(rng.integers(8))
    if way == 0:
        del made[at:]
    elif way == 1:
        del made[at : at + int(rng.integers(1, 100))]
    elif way == 2:
        at = at // 512 * 512
        made[at : at + 512] = bytes(len(made[at : at + 512]))
    else:
        for _ in range(int(rng.integers(1, 4))):
            made[int(rng.integers(len(made)))] ^= 1 << int(rng.integers(8))
    return bytes(made)


def of_result(path: Path) -> dict[str, NDArray[Any]]:
    found = fa.Result.load(path)
    return {k: getattr(found, k) for k in ("t", "q", "v", "a", "tau")}


def of_table(path: Path) -> dict[str, NDArray[Any]]:
    found = fa.Data.load(path)
    return {f"{name} ({found.units[name]})": found[name] for name in found.names} | {"t": found.t}


def of_batch(found: fa.BatchResult) -> dict[str, NDArray[Any]]:
    """What is not done is nan in every array."""
    lengths = np.array([found.arm(i).links[0].beam.length for i in range(len(found))])
    status = np.where(found.status == 4, np.nan, found.status)
    return {"t": found.t, "q": np.array(found.q), "v": np.array(found.v), "status": status, "length": lengths}


def of_sweep(path: Path) -> dict[str, NDArray[Any]]:
    """The columns, too."""
    found = fa.BatchResult.load(path)
    with h5py.File(path) as f:
        noted = f["columns/tip deflection"][:]
    return {**of_batch(found), "tip": np.where(found.status == 4, np.nan, noted)}


def alike(name: str, found: NDArray[Any], truth: NDArray[Any], blank: bool) -> bool:
    if found.shape != truth.shape:
        return False
    same = (found == truth) | (np.isnan(found) & np.isnan(truth))
    return bool((same | (np.isnan(found) & blank)).all())


def damages(folder: Path, count: int) -> None:
    """Tells of each kind of file how many were refused, read as they were, and read with other values."""
    run = fa.simulate(fa.load("ist").arm, TIMES, drive={0: fa.Torque(0.01)}, events=lambda t, q, v: q[0] - 1e-4)
    kinds: dict[str, tuple[Path, Read]] = {}
    for name, read in (("run.h5", of_result), ("run.npz", of_result), ("run.mat", of_table)):
        run.save(folder / name)
        kinds[f"Result.save, {name}"] = folder / name, read
    for name in ("data.h5", "data.npz", "data.mat"):
        run.to_data().save(folder / name)
        kinds[f"Data.save, {name}"] = folder / name, of_table
    batch(folder / "batch.h5").save(folder / "batch.npz")
    for name in ("batch.h5", "batch.npz"):
        kinds[f"batch, {name}"] = folder / name, lambda path: of_batch(fa.BatchResult.load(path))
    kinds["batch, batch.h5, resumed"] = folder / "batch.h5", lambda path: of_batch(batch(path))
    sweep(folder / "s")
    kinds["sweep, sweep.h5"] = folder / "s" / "sweep.h5", of_sweep
    print("| file | bytes | tried | refused | read as it was | scenarios not done | other values |\n|-|-|-|-|-|-|-|")
    for kind, (path, read) in kinds.items():
        data, truth, rng = path.read_bytes(), {k: np.array(x) for k, x in read(path).items()}, np.random.default_rng(1)
        counts = dict.fromkeys(("refused", "same", "not done", "other"), 0)
        for k in range(count):
            bad = folder / f"bad-{k % 2}{path.suffix}"
            bad.unlink(missing_ok=True)  # arrays of the one before are mapped from it
            bad.write_bytes(damaged(data, rng))
            signal.alarm(60)  # a library may read on for ever
            try:
                found = read(bad)
            except ValueError:
                counts["refused"] += 1
                continue
            finally:
                signal.alarm(0)
            same, blank = ([alike(k, found.get(k, np.empty(0)), x, b) for k, x in truth.items()] for b in (False, True))
            counts["same" if all(same) else "not done" if "status" in truth and all(blank) else "other"] += 1
        print(f"| {kind} | {len(data)} | {count} | {' | '.join(str(n) for n in counts.values())} |", flush=True)


# -- kill ------------------------------------------------------------------------------------------------------------

KILLED = """
import sys
sys.path.insert(0, {here!r})
import trials, numpy as np
from pathlib import Path
print("begun", flush=True)
trials.batch(Path({path!r}), 400, np.linspace(0, 0.02, 201), batch=8, integrator="rk4")
print("ended", flush=True)
"""


def kills(folder: Path, count: int) -> None:
    """Kills a process that runs and writes a batch, at random moments, until the batch is done."""
    truth, rng = batch(None, 400, np.linspace(0, 0.02, 201), integrator="rk4"), np.random.default_rng(1)
    script = KILLED.format(here=str(Path(__file__).parent), path=str(folder / "k.h5"))
    killed, known, unlike, span, rounds = 0, 0, 0, 0.0, 0
    while killed < count:
        rounds += 1
        (folder / "k.h5").unlink(missing_ok=True)
        while True:
            child = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
            assert child.stdout is not None and child.stdout.readline() == "begun\n"
            begun = time.perf_counter()
            if span:
                time.sleep(rng.uniform(0.0, span))
                child.kill()
            rest = child.stdout.read()
            child.wait()
            if "ended" in rest:
                span = span or 0.5 * (time.perf_counter() - begun)
                break
            killed += 1
            if (folder / "k.h5").exists():
                left = fa.BatchResult.load(folder / "k.h5")
                done = left.status == 0
                known += int(0 < done.sum() < 400)
                unlike += not (np.array_equal(left.q[done], truth.q[done]) and np.isnan(left.q[~done]).all())
        found = fa.BatchResult.load(folder / "k.h5")
        unlike += not (np.array_equal(found.q, truth.q) and np.array_equal(found.v, truth.v))
    print(f"killed {killed} times in {rounds} batches, {known} of them with a part done; unlike: {unlike}", flush=True)


# -- time ------------------------------------------------------------------------------------------------------------


def times(folder: Path, count: int) -> None:
    """Seconds of a batch with a file, without, and of reading the file."""
    grid, best = np.linspace(0, 0.02, 201), np.full(4, np.inf)
    for k in range(5):
        path, found = folder / f"t{k}.h5", []
        for do in (
            lambda: batch(None, count, grid, integrator="rk4"), lambda p=path: batch(p, count, grid, integrator="rk4"),
            lambda p=path: batch(p, count, grid, integrator="rk4"), lambda p=path: fa.BatchResult.load(p),
        ):  # fmt: skip
            begun = time.perf_counter()
            do()
            found.append(time.perf_counter() - begun)
        best = np.minimum(best, found)
        size = path.stat().st_size
        path.unlink()
    words = ("in memory", "with a file", "again, all in the file", "BatchResult.load")
    print(f"{count} scenarios, {size / 1e6:.1f} MB, best of 5: " + ", ".join(
        f"{word} {x:.3f} s" for word, x in zip(words, best, strict=True)))  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--damages", type=int, default=3600)
    parser.add_argument("--kills", type=int, default=30)
    parser.add_argument("--scenarios", type=int, default=1000)
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if args.scenarios:
            times(folder, args.scenarios)
        if args.kills:
            kills(folder, args.kills)
        if args.damages:
            damages(folder, args.damages)


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    main()
