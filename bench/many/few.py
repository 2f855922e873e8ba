"""What few scenarios cost: `rollout` of 1 to 8, side by side in lanes and one by one, in parts of one `simulate`.

    python bench/many/few.py [--seconds 60]

One thread; all ways of a row take turns, best times. `docs/batch.md` says from how many on the lanes are taken.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import flexarm as fa
import flexarm._core as _core
import numpy as np
from flexarm.arm.variation import Setup
from flexarm.many.batch.problems import problems_of
from flexarm.run.integrators import integrator_of

STEEL = fa.Material(7850, 209e9, 0.3)
COUNTS = (1, 2, 3, 4, 8)
FAST = 1e-5  # s, a step that rk4 can take on all of them


def planar(links: int) -> fa.Arm:
    beam = fa.Beam(0.5, fa.Rectangle(0.002, 0.02), STEEL, {"bending_y": 3}, damping_ratio=0.01)
    return fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(0.1), beam, fa.RigidBody(0.1))] * links)


def spatial(links: int, modes: dict[str, int] | None) -> fa.Arm:
    beam = modes and fa.Beam(0.5, fa.Circle(0.01), STEEL, modes, "legendre", damping_ratio=0.01)
    hub = fa.RigidBody(1.0, (0.1, 0, 0), (1e-2, 1e-2, 1e-2), end=(0.2, 0, 0))
    return fa.Arm([fa.Link(fa.Revolute("zy"[k % 2]), hub, beam) for k in range(links)], (0, 0, -9.81))


#: name: the arm, the implicit method's step (s), and steps of a run
ARMS: dict[str, tuple[fa.Arm, float, int]] = {
    "planar, 1 x 3": (planar(1), 1e-3, 1000),
    "planar, 2 x 3": (planar(2), 1e-3, 500),
    "rigid, 7": (spatial(7, None), 1e-3, 500),
    "7 x (3 + 3 + 1)": (spatial(7, {"bending_y": 3, "bending_z": 3, "torsion": 1}), 1e-4, 50),
}


def best(ways: dict[str, Callable[[], object]], seconds: float) -> dict[str, float]:
    """Least seconds of each, all taking turns for so long."""
    times, end = dict.fromkeys(ways, np.inf), time.perf_counter() + seconds
    while time.perf_counter() < end or not all(np.isfinite(list(times.values()))):
        for name, way in ways.items():
            begun = time.perf_counter()
            way()
            times[name] = min(times[name], time.perf_counter() - begun)
    return times


def row(arm: fa.Arm, integrator: str, step: float, steps: int, seconds: float) -> list[str]:
    v0 = np.zeros((max(COUNTS), arm.nv))
    v0[:, 0] = 0.1 * np.arange(1, len(v0) + 1)
    options = {"step": step, "nstep": steps, "integrator": integrator, "workers": 1, "every": steps}
    whole = np.repeat(v0, 4, axis=0)  # so many that they run in lanes

    t = step * np.arange(steps + 1)
    problem = problems_of([Setup(arm)], 1, t, None)[0].core
    method = integrator_of(integrator, step=step).core

    def in_lanes(n: int) -> Callable[[], object]:
        batch = _core.BatchProblem(
            [problem], [], scenarios=n, t=t, every=steps, q0=arm.zero[None, None], v0=v0[:n, None], tau=None,
            nq=arm.nq, nv=arm.nv, **method, lanes=True, whole=len(whole),
        )  # fmt: skip
        blocks = {"q": np.empty((n, 2, arm.nq)), "status": np.zeros(n, np.int32), "reached": np.zeros(n)}
        return lambda: batch.run(blocks, 1, None)

    ways: dict[str, Callable[[], object]] = {
        "alone": lambda: fa.simulate(arm, [0, step * steps], v0=v0[0], integrator=integrator, step=step)
    }
    for n in COUNTS:
        ways[f"lanes {n}"] = in_lanes(n)
        ways[f"singly {n}"] = lambda n=n: fa.rollout(arm, arm.zero, v0[:n], lanes=False, **options)
        ways[f"rollout {n}"] = lambda n=n: fa.rollout(arm, arm.zero, v0[:n], **options)
    took = best(ways, seconds)
    return [f"{1e6 * took['alone'] / steps:.2f}"] + [
        " / ".join(f"{took[f'{way} {n}'] / took['alone']:.2f}" for way in ("lanes", "singly", "rollout"))
        for n in COUNTS
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0, help="of the whole")
    seconds = parser.parse_args().seconds / (2 * len(ARMS))
    heads = [f"{n}: lanes / singly / as taken" for n in COUNTS]
    print(f"| arm | method | µs a step of simulate | {' | '.join(heads)} |\n{'|-' * (len(COUNTS) + 3)}|")
    for name, (arm, step, steps) in ARMS.items():
        for integrator in ("implicit", "rk4"):
            h = step if integrator == "implicit" else FAST
            print(f"| {name} | {integrator} | {' | '.join(row(arm, integrator, h, steps, seconds))} |", flush=True)


if __name__ == "__main__":
    main()
