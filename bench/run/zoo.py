"""The default run on six arms as users bring them, beside IDA and the best fixed steps: docs/zoo.md.

    python bench/run/zoo.py [--truth FILE] [--only NAME ...] [--docs]

An error is the largest distance of any link's end from where it should be, over all output times, in parts of the
arm's length. Truth is "gauss" in steps of a quarter of a millisecond; how far "ida" at rtol 1e-9 is from it is told.
Times are of the thread, the smallest of three runs, and are compared within one arm. The best fixed step is the
cheapest of "gauss" and "implicit", in steps that get shorter by a factor of 1.6, whose error is at most that of the
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
LEAST = 1e-7  # parts of the arm's length, a hundredth of the tolerance: no error that is looked for is below


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
        step, name = span / 30.0, kind.name
        for _ in range(14):
            step /= 1.6
            found = measure(animal, f"{name}, {1e3 * step:.3g} ms", kind(step=step), 1)
            if found is None:
                continue
            cheapest = min((x.seconds for x in good), default=np.inf)
            if found.seconds > min(3.0 * cheapest, 20.0 * animal.runs[0].seconds):
                break
            if found.error <= max(least, LEAST):
                found.seconds = min(found.seconds, simulated(animal.scene, kind(step=step), 2)[0])
                good.append(found)
    return min(good, key=lambda x: x.seconds, default=None)


def written(number: float) -> str:
    return f"{number:.1e}".replace("e-0", "e-")


def table(rows: list[tuple[Animal, Run, Run | None, Run | None]]) -> str:
    lines = [
        "| arm | coordinates | default: steps | error | IDA: steps | error | best fixed step as accurate | its error "
        "| time of the default over it | of IDA over it | truths agree to |",
        "|-|-|-|-|-|-|-|-|-|-|-|",
    ]
    for animal, default, ida, best in rows:
        of = [str(ida.steps), written(ida.error)] if ida else ["fails", "-"]
        fixed = ["none", "-", "-"]
        if best:
            fixed = [best.what, written(best.error), f"{default.seconds / best.seconds:.2f}"]
        over = f"{ida.seconds / best.seconds:.1f}" if ida and best else "-"
        name, size = animal.name.replace("_", " "), str(animal.scene.arm.nv)
        cells = [name, size, str(default.steps), written(default.error), *of, *fixed, over, written(animal.doubt)]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def draw(rows: list[tuple[Animal, Run, Run | None, Run | None]], path: Path) -> None:
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 3, figsize=(10, 6), layout="constrained")
    for ax, (animal, default, ida, _) in zip(axes.flat, rows, strict=False):
        for kind, mark in (("gauss", "o-"), ("implicit", "s-")):
            of = sorted((x.seconds * 1e3, x.error) for x in animal.runs if x.what.startswith(kind))
            ax.plot(*zip(*of, strict=True), mark, ms=3, lw=0.7, label=f'"{kind}" in fixed steps')
        ax.plot(default.seconds * 1e3, default.error, "k*", ms=13, label="default")
        if ida:
            ax.plot(ida.seconds * 1e3, ida.error, "rD", label='"ida"')
        ax.axhline(1e-5, color="0.7", lw=0.7)
        ax.set(xscale="log", yscale="log", title=animal.name.replace("_", " "), xlim=(3, 5000))
        ax.xaxis.set_minor_formatter("")
    for ax in axes[1]:
        ax.set_xlabel("time of computing (ms)")
    for ax in axes[:, 0]:
        ax.set_ylabel("error (parts of the arm's length)")
    axes[0, 0].legend(fontsize=7)
    figure.savefig(path, dpi=110)


def page(rows: list[tuple[Animal, Run, Run | None, Run | None]]) -> None:
    draw(rows, ROOT / "docs" / "figures" / "zoo.png")
    path = ROOT / "docs" / "zoo.md"
    text = path.read_text(encoding="utf-8")
    before, rest = text.split("<!-- table -->")[0], text.split("<!-- end -->")[1]
    path.write_text(f"{before}<!-- table -->\n\n{table(rows)}\n\n<!-- end -->{rest}", encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--truth", type=Path)
    parser.add_argument("--only", nargs="*", choices=list(ARMS), default=list(ARMS))
    parser.add_argument("--docs", action="store_true", help="write the table and the figure of docs/zoo.md")
    args = parser.parse_args()
    rows = []
    for animal in truths(args.only, args.truth):
        default = measure(animal, "default", None)
        if default is None:
            raise SystemExit(f"{animal.name}: the default run fails")
        rows.append((animal, default, measure(animal, "ida", fa.Ida(), 1), best_fixed(animal, default.error)))
        print(table(rows[-1:]).splitlines()[-1], flush=True)
    if args.docs:
        page(rows)


if __name__ == "__main__":
    main()
