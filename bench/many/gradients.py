"""What exact derivatives of runs cost, and how exact they are: the table of docs/gradients.md.

    python bench/many/gradients.py [--seconds 10]

Times in parts of that of the run itself, by `simulate`; all ways of a row take turns, best times, all cores. Errors are
those against differences of sixth order of runs at a tight tolerance, extrapolated; relative, the largest of all.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import flexarm as fa
import numpy as np
from few import best, spatial
from flexarm.arm.variation import Setup, Variation
from flexarm.run.perturbed import components, problems

PAGE = Path(__file__).parents[2] / "docs" / "gradients.md"
BEGIN, END = "<!-- bench/many/gradients.py -->", "<!-- end -->"
MODES = {"bending_y": 2, "bending_z": 2, "torsion": 1}
LINK = fa.load("ist").arm.links[0]
#: name: the arm, and the step of "implicit" (s); "gauss" takes four times that
ARMS = {
    "the paper's link": (fa.Arm([replace(LINK, tip=fa.RigidBody(0.03))]), 1e-3),
    "two links in space": (spatial(2, MODES), 1e-3),
    "seven links in space": (spatial(7, MODES), 5e-4),
}
COUNTS = (1, 10, 100)
FORWARD = (1, 10)
STEPS, SHORT = 1000, 50  # of the runs timed, and of those whose derivatives are looked at
CENTRAL = ((1, 3 / 4), (2, -3 / 20), (3, 1 / 60))  # offsets and weights, of sixth order


def paths(arm: fa.Arm) -> list[str]:
    """Of all numbers of an arm that can vary."""
    out: list[str] = []
    for path in Setup(arm).known:
        if path in ("q0", "v0"):
            continue
        try:
            found = components(Setup(arm), path, {})
            problems(Setup(arm), found, [0.0, 1.0], None, None, None)
        except ValueError:
            continue
        out += found
    return out


def run_of(arm: fa.Arm, integrator: str, step: float, steps: int, tight: bool = False) -> fa.Result:
    v0, tau = np.zeros(arm.nv), np.zeros(arm.nv)
    v0[0], tau[0] = 0.5, 0.2
    own = {"gauss": 4 * step, "rk4": 1e-2 * step}.get(integrator, step)
    more = {"rtol": 1e-14} if tight and integrator != "rk4" else {}
    t = np.linspace(0.0, steps * own, steps + 1)
    return fa.simulate(arm, t, None, v0, tau=tau, integrator=integrator, step=own, **more)


def weights(run: fa.Result) -> dict[str, np.ndarray]:
    return {"q": np.random.default_rng(0).normal(size=run.q.shape)}


def error(arm: fa.Arm, integrator: str, step: float) -> float:
    """Of the gradient of a short run by some parameters, relative."""
    known = ["link.0.beam.material.youngs_modulus", "link.0.beam.material.density", "link.0.beam.length"]
    steps = SHORT // 4 if integrator == "gauss" else SHORT
    run = run_of(arm, integrator, step, steps, True)
    w = weights(run)
    worst = 0.0
    size = {path: problems(Setup(arm), [path], [0.0, 1.0], None, None, None)[0] for path in known}
    gradient = run.gradient(w, known)
    for path in known:
        value, scale = size[path].value, size[path].scale
        found = []
        for h in (4e-4 * scale, 2e-4 * scale):
            total = 0.0
            for k, weight in CENTRAL:
                ends = [Variation(Setup(arm), {path: np.array([value + s * k * h])}).scenario(0).arm for s in (1, -1)]
                rows = [run_of(a, integrator, step, steps, True).q for a in ends]
                total += weight * float((w["q"] * (rows[0] - rows[1])).sum()) / h
            found.append(total)
        truth = (64 * found[1] - found[0]) / 63
        worst = max(worst, abs(gradient[path] - truth) / abs(truth))
    return worst


def row(name: str, integrator: str, seconds: float) -> str:
    arm, step = ARMS[name]
    all_paths = paths(arm)
    spread = [all_paths[k] for k in np.linspace(0, len(all_paths) - 1, min(max(COUNTS), len(all_paths))).astype(int)]
    run = run_of(arm, integrator, step, STEPS)
    w = weights(run)
    ways: dict[str, Callable[[], object]] = {"run": lambda: run_of(arm, integrator, step, STEPS)}
    ways["tau"] = lambda: run.gradient(w, ["tau"])
    some = {n: [spread[k] for k in np.linspace(0, len(spread) - 1, min(n, len(spread))).astype(int)] for n in COUNTS}
    for n, found in some.items():
        ways[f"adjoint {n}"] = lambda found=found: run.gradient(w, found)
    for n in FORWARD:
        ways[f"forward {n}"] = lambda found=some[n]: run.sensitivities(found)
    times = best(ways, seconds)
    cells = [f"{times['run'] * 1e3:.3g} ms"] + [f"{times[k] / times['run']:.1f}" for k in list(ways)[1:]]
    cells.append(f"{error(arm, integrator, step):.0e}")
    few = f" ({len(spread)})" if len(spread) < max(COUNTS) else ""
    line = f"| {name}, {arm.nv}{few} | {integrator} | " + " | ".join(cells) + " |"
    print(line, flush=True)
    return line


def main() -> None:
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--seconds", type=float, default=10.0, help="for each row")
    given = p.parse_args()
    heads = ["arm, coordinates", "integrator", f"run of {STEPS} steps", "adjoint, forces alone"]
    heads += [f"adjoint, {n} parameter{'s' * (n > 1)}" for n in COUNTS] + [f"forward, {n}" for n in FORWARD] + ["error"]
    table = ["| " + " | ".join(heads) + " |", "|-" * len(heads) + "|"]
    table += [row(name, integrator, given.seconds) for name in ARMS for integrator in ("implicit", "gauss", "rk4")]
    text = PAGE.read_text(encoding="utf-8")
    before, _, rest = text.partition(BEGIN)
    PAGE.write_text(before + "\n".join([BEGIN, *table, END]) + rest.partition(END)[2], encoding="utf-8")


if __name__ == "__main__":
    main()
