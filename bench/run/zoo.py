"""The default run on six arms as users bring them, beside IDA, the best fixed steps, the cheapest model of `economize`,
and Exudyn: docs/zoo.md.

    python bench/run/zoo.py [--truth FILE] [--only NAME ...] [--docs]

An error is the largest distance of any link's end from where it should be, over all output times, in parts of the
arm's length; that of energy is in parts of the largest kinetic energy and what the potential energy spans. Truth is
"gauss" in steps of a quarter of a millisecond; how far "ida" at rtol 1e-9 is from it is told. Times are of the thread,
the smallest of three runs, and are compared within one arm. The best fixed step is the cheapest of "gauss" and
"implicit", in steps that get shorter by a factor of 1.6, whose error is at most that of the default run. Exudyn comes
from PyPI into an environment of its own under build/peers, made when missing (bench/run/zoo_exudyn.py). --truth keeps
the truths in a file, or reads them from it.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
from flexarm.run.scene.scene import tomllib

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "bench" / "speed"), str(ROOT / "bench")]
from peers import ONE_THREAD, python_of  # noqa: E402
from reporting import replace_table  # noqa: E402

ARMS = {
    "crane": ROOT / "tests" / "data" / "crane.toml",
    **{name: ROOT / "bench" / "run" / "zoo" / f"{name}.toml" for name in
       ("boom", "picking", "free_base", "stick_and_slip", "whip")},
}  # fmt: skip
FINE = 2.5e-4  # s
LEAST = 1e-7  # parts of the arm's length, a hundredth of the tolerance: no error that is looked for is below
COARSE = 1e-3  # tolerance of the cheapest model, in parts of what the tip spans
IN_EXUDYN = ("whip",)


@dataclass
class Run:
    what: str
    seconds: float
    error: float
    energy: float
    steps: int


@dataclass
class Animal:
    name: str
    scene: fa.Scene
    truth: np.ndarray
    energy: np.ndarray  # kinetic and potential, (2, nt)
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
            truth = simulated(scene, fa.Gauss(step=FINE))[1]
            held[name], held[name + " energy"] = ends(scene.arm, truth.q), np.array(truth.energy())
            other = ends(scene.arm, simulated(scene, fa.Ida(rtol=1e-9, atol=1e-12))[1].q)
            held[name + " doubt"] = np.linalg.norm(other - held[name], axis=2).max() / length(scene.arm)
            if file:
                np.savez(file, **held)
        yield Animal(name, scene, held[name], held[name + " energy"], float(held[name + " doubt"]))


def error(animal: Animal, run: fa.Result) -> float:
    off = np.linalg.norm(ends(animal.scene.arm, run.q) - animal.truth, axis=2)
    return float(off.max() / animal.length)


def energy_error(animal: Animal, run: fa.Result) -> float:
    kinetic, potential = animal.energy
    off = np.abs(np.add(*run.energy()) - kinetic - potential)
    return float(off.max() / (kinetic.max() + np.ptp(potential)))


def measure(animal: Animal, what: str, integrator: Any, again: int = 3) -> Run | None:
    try:
        seconds, run = simulated(animal.scene, integrator, again)
    except fa.SimulationError:
        return None
    found = Run(what, seconds, error(animal, run), energy_error(animal, run), int(run.stats["steps"]))
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


@dataclass
class Other:
    """The cheapest model, and the arm in Exudyn: time (s), and error (of Exudyn as that of a Run)."""

    plan: fa.results.ModelPlan
    seconds: float
    exudyn: dict[str, Any] | None


def other(animal: Animal, default: Run) -> Other:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        plan = fa.economize(animal.scene, COARSE)
        times = [time.thread_time()]
        for _ in range(3):
            plan.scene.run()
            times.append(time.thread_time())
    return Other(plan, float(np.diff(times).min()), exudyn(animal, default) if animal.name in IN_EXUDYN else None)


def exudyn(animal: Animal, default: Run) -> dict[str, Any] | None:
    """What the worker reports at the error of the default run, or at the least that is looked for; and the largest
    distance of its answer from the arm's, over a quarter of the run."""
    scene = json.dumps(tomllib.loads(ARMS[animal.name].read_text(encoding="utf-8")))
    command = [python_of("exudyn"), ROOT / "bench" / "run" / "zoo_exudyn.py", str(max(default.error, LEAST))]
    out = subprocess.run(command, input=scene, env={**os.environ, **ONE_THREAD}, capture_output=True, text=True)
    if out.returncode:
        print(f"Exudyn failed: {out.stderr.strip()[-2000:]}", file=sys.stderr, flush=True)
        return None
    found = json.loads(out.stdout.splitlines()[-1])
    quarter = animal.truth[(len(animal.truth) - 1) // 4][:, [0, 2]] * [1.0, -1.0]
    found["apart"] = float(np.linalg.norm(quarter - np.array(found["ends"][1]), axis=1).max() / animal.length)
    return found


Row = tuple[Animal, Run, Run | None, Run | None, Other]


def written(number: float) -> str:
    return f"{number:.1e}".replace("e-0", "e-")


def lines(head: str, rows: list[list[str]]) -> str:
    cells = [f"| {' | '.join(row)} |" for row in rows]
    return "\n".join([head, "|-" * (head.count("|") - 1) + "|", *cells])


def table(rows: list[Row]) -> str:
    cells = []
    for animal, default, ida, best, _ in rows:
        of = [str(ida.steps), written(ida.error)] if ida else ["fails", "-"]
        fixed = ["none", "-", "-"]
        if best:
            fixed = [best.what, written(best.error), f"{default.seconds / best.seconds:.2f}"]
        over = f"{ida.seconds / best.seconds:.1f}" if ida and best else "-"
        name, size = animal.name.replace("_", " "), str(animal.scene.arm.nv)
        own = [str(default.steps), written(default.error), written(default.energy)]
        cells.append([name, size, *own, *of, *fixed, over, written(animal.doubt)])
    return lines(
        "| arm | coordinates | default: steps | error | of energy | IDA: steps | error | best fixed step as accurate "
        "| its error | time of the default over it | of IDA over it | truths agree to |",
        cells,
    )


def table_of_others(rows: list[Row]) -> str:
    cells = []
    for animal, default, _, _, of in rows:
        plan, peer = of.plan, of.exudyn
        options = dict(plan.scene.options)
        by = f"{options.pop('integrator')}, " + ", ".join(f"{k} {x:.2g}" for k, x in options.items())
        cheap = [str(plan.arm.nv), plan.model, by, f"{1e3 * of.seconds:.2g}", written(plan.error)]
        ratio = f"{peer['seconds'] / default.seconds:.0f}, at {written(peer['error'])}" if peer else "-"
        name = animal.name.replace("_", " ")
        cells.append([name, f"{1e3 * default.seconds:.2g}", *cheap, f"{default.seconds / of.seconds:.1f}", ratio])
    return lines(
        "| arm | default (ms) | coordinates | cheapest model | its integrator | ms | error | time of the default over "
        "it | Exudyn over the default |",
        cells,
    )


def table_of_swings() -> str:
    """Of an undamped beam on a spring, by the default run: the energy at all output times, over that at the start."""
    beam = fa.Beam(0.5, fa.Rectangle(0.004, 0.02), fa.Material(7850, 209e9, 0.3), {"bending_y": 2})
    arm = fa.Arm([fa.Link(fa.Revolute("z", stiffness=5.0), fa.RigidBody(0.3, inertia=(1e-3,) * 3), beam)])
    cells = []
    for angle in (0.1, 0.03, 0.01, 1e-3, 1e-4):
        run = fa.simulate(arm, np.linspace(0.0, 2.0, 401), [angle, 0.0, 0.0])
        kinetic, potential = run.energy()
        off = np.abs(kinetic + potential - potential[0]).max() / potential[0]
        cells.append([f"{angle:g}", str(run.stats["steps"]), written(off)])
    return lines("| swing (rad) | steps | error of energy |", cells)


def draw(rows: list[Row], path: Path) -> None:
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 3, figsize=(10, 6), layout="constrained")
    for ax, (animal, default, ida, _, more) in zip(axes.flat, rows, strict=False):
        for kind, mark in (("gauss", "o-"), ("implicit", "s-")):
            of = sorted((x.seconds * 1e3, x.error) for x in animal.runs if x.what.startswith(kind))
            ax.plot(*zip(*of, strict=True), mark, ms=3, lw=0.7, label=f'"{kind}" in fixed steps')
        ax.plot(default.seconds * 1e3, default.error, "k*", ms=13, label="default")
        if ida:
            ax.plot(ida.seconds * 1e3, ida.error, "rD", label='"ida"')
        if found := more.exudyn:
            peer = ax.plot(found["seconds"] * 1e3, found["error"], "P", color="tab:green", label="Exudyn")
            ax.legend(handles=peer, fontsize=7)
        ax.axhline(1e-5, color="0.7", lw=0.7)
        ax.set(xscale="log", yscale="log", title=animal.name.replace("_", " "), xlim=(3, 5000))
        ax.xaxis.set_minor_formatter("")
    for ax in axes[1]:
        ax.set_xlabel("time of computing (ms)")
    for ax in axes[:, 0]:
        ax.set_ylabel("error (parts of the arm's length)")
    axes[0, 0].legend(fontsize=7)
    figure.savefig(path, dpi=110)


def page(rows: list[Row]) -> None:
    draw(rows, ROOT / "docs" / "figures" / "zoo.png")
    for mark, of in (("table", table(rows)), ("others", table_of_others(rows)), ("swings", table_of_swings())):
        replace_table(ROOT / "docs" / "zoo.md", mark, of)


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
        ida, best = measure(animal, "ida", fa.Ida(), 1), best_fixed(animal, default.error)
        rows.append((animal, default, ida, best, other(animal, default)))
        for written_so in (table, table_of_others):
            print(written_so(rows[-1:]).splitlines()[-1], flush=True)
        if found := rows[-1][-1].exudyn:
            print({k: x for k, x in found.items() if k != "ends"})
    if args.docs:
        page(rows)


if __name__ == "__main__":
    main()
