"""The default run on six arms as users bring them, beside IDA and the best fixed steps: docs/zoo.md.

    python bench/run/zoo.py [--truth FILE] [--only NAME ...] [--docs]

An error is the largest distance of any link's end from where it should be, over all output times, in parts of the
arm's length. Truth is "gauss" in steps of a quarter of a millisecond; how far "ida" at rtol 1e-9 is from it is told.
Times are of the thread, the smallest of three runs, and are compared within one arm. The best fixed step is the
cheapest of "gauss" and "implicit", in steps that get shorter by a factor of 1.4, whose error is at most that of the
default run. --truth keeps the truths in a file, or reads them from it.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np

ROOT = Path(__file__).parents[2]
ARMS = {
    "crane": ROOT / "tests" / "data" / "crane.toml",
    **{name: ROOT / "bench" / "run" / "zoo" / f"{name}.toml" for name in
       ("boom", "picking", "free_base", "stick_and_slip", "whip")},
}  # fmt: skip
FINE = 2.5e-4  # s
LEAST = 1e-9  # parts of the arm's length: no error that is looked for is below


@dataclass
class Run:
    what: str
    seconds: float
    error: float
    steps: int


@dataclass
class Animal:
    name: str
    scene: fa.Scene
    truth: np.ndarray
    doubt: float = np.nan
    runs: list[Run] = field(default_factory=list)

    @property
    def length(self) -> float:
        return length(self.scene.arm)


def ends(arm: fa.Arm, q: np.ndarray) -> np.ndarray:
    """Places of all links' ends, (nt, links, 3)."""
    return np.stack([arm.frame(q, link=k)[0] for k in range(len(arm.links))], axis=1)


def length(arm: fa.Arm) -> float:
    places = ends(arm, arm.zero[None])[0]
    return float(np.linalg.norm(np.diff(places, axis=0, prepend=np.zeros((1, 3))), axis=1).sum())


def simulated(scene: fa.Scene, integrator: Any, again: int = 1) -> tuple[float, fa.Result]:
    best = np.inf
    for _ in range(again):
        began = time.thread_time()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            run = fa.simulate(scene.arm, scene.t, scene.q0, scene.v0, integrator=integrator, **scene.given())
        best = min(best, time.thread_time() - began)
    return best, run


def truths(names: list[str], file: Path | None) -> Iterator[Animal]:
    held = dict(np.load(file)) if file and file.exists() else {}
    for name in names:
        scene = fa.load(ARMS[name])
        if name not in held:
            held[name] = ends(scene.arm, simulated(scene, fa.Gauss(step=FINE))[1].q)
            other = ends(scene.arm, simulated(scene, fa.Ida(rtol=1e-9, atol=1e-12))[1].q)
            held[name + " doubt"] = np.linalg.norm(other - held[name], axis=2).max() / length(scene.arm)
            if file:
                np.savez(file, **held)
        yield Animal(name, scene, held[name], float(held[name + " doubt"]))


def error(animal: Animal, run: fa.Result) -> float:
    off = np.linalg.norm(ends(animal.scene.arm, run.q) - animal.truth, axis=2)
    return float(off.max() / animal.length)


def measure(animal: Animal, what: str, integrator: Any, again: int = 3) -> Run | None:
    try:
        seconds, run = simulated(animal.scene, integrator, again)
    except fa.SimulationError:
        return None
    found = Run(what, seconds, error(animal, run), int(run.stats["steps"]))
    animal.runs.append(found)
    return found


def best_fixed(animal: Animal, least: float) -> Run | None:
    """The cheapest fixed step whose error is at most that."""
    span = float(animal.scene.t[-1] - animal.scene.t[0])
    good: list[Run] = []
    for kind in (fa.Gauss, fa.Implicit):
        step, name = span / 10.0, kind.name
        for _ in range(28):
            step /= 1.4142
            found = measure(animal, f"{name}, {1e3 * step:.3g} ms", kind(step=step), 1)
            if found is None:
                continue
            if good and found.seconds > 3.0 * min(x.seconds for x in good):
                break
            if found.error <= max(least, LEAST):
                found.seconds = min(found.seconds, simulated(animal.scene, kind(step=step), 2)[0])
                good.append(found)
    return min(good, key=lambda x: x.seconds, default=None)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--truth", type=Path)
    parser.add_argument("--only", nargs="*", choices=list(ARMS), default=list(ARMS))
    parser.add_argument("--docs", action="store_true", help="write docs/zoo.md and its figure")
    args = parser.parse_args()
    rows = []
    for animal in truths(args.only, args.truth):
        default = measure(animal, "default", None)
        if default is None:
            print(animal.name, "default FAILED")
            continue
        ida = measure(animal, "ida", fa.Ida())
        best = best_fixed(animal, default.error)
        rows.append((animal, default, ida, best))
        print(f"{animal.name}: doubt {animal.doubt:.1e}; default {1e3 * default.seconds:.1f} ms {default.steps} steps "
              f"{default.error:.1e}; ida {ida and (round(1e3 * ida.seconds, 1), ida.steps, ida.error)}; best {best}; ratio "
              f"{default.seconds / best.seconds if best else np.nan:.2f}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
