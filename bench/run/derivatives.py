"""What derivatives of runs cost, in runs, and those of forward dynamics, in forward dynamics.

    python bench/run/derivatives.py [--rounds 5] [--scene NAME]

Processor time of all threads, but for those of BLAS, of which there is one here: others wait busily after short work,
by chance. A run and its derivatives take turns, least of all rounds. A run is that of `simulate`, its setting up
included. Writes its section of docs/gradients.md if all scenes are measured.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before NumPy is there

import flexarm as fa
import numpy as np
from flexarm.identify.validate.rig import ARM, read, with_motion

PAGE = Path(__file__).parents[2] / "docs" / "gradients.md"
BEGIN, END = "<!-- bench/run/derivatives.py -->", "<!-- derivatives: end -->"
STEEL = fa.Material(7850, 209e9, 0.3)
COUNTS = (1, 4, 8, 16)
Run = Callable[[], fa.Result]


def boom() -> fa.Arm:
    """Four beams in space, one behind the other, on two joints."""
    beam = fa.Beam(1.0, fa.Tube(0.03, 0.027), STEEL, {"bending_y": 2, "bending_z": 2}, "legendre", damping_ratio=0.02)
    axes = [fa.Revolute("z"), fa.Fixed(), fa.Revolute("y"), fa.Fixed()]
    links = [fa.Link(joint, fa.RigidBody(1.0, inertia=0.01 * np.eye(3)), beam) for joint in axes]
    return fa.Arm([*links[:3], fa.Link(axes[3], links[3].hub, beam, fa.RigidBody(2.0))], (0, 0, -9.81))


def spatial(links: int, modes: dict[str, int] | None) -> fa.Arm:
    beam = modes and fa.Beam(0.5, fa.Circle(0.01), STEEL, modes, "legendre", damping_ratio=0.01)
    hub = fa.RigidBody(1.0, (0.1, 0, 0), (1e-2, 1e-2, 1e-2), end=(0.2, 0, 0))
    return fa.Arm([fa.Link(fa.Revolute("zy"[k % 2]), hub, beam) for k in range(links)], (0, 0, -9.81))


LONG = spatial(7, {"bending_y": 3, "bending_z": 3, "torsion": 1})


def numbers(arm: fa.Arm, count: int) -> list[str]:
    """Paths of as many numbers of an arm, of all its links in turn."""
    each = ["hub.mass", "beam.material.density", "beam.material.youngs_modulus", "beam.length", "joint.damping",
            "beam.damping_ratio", "hub.com.0", "joint.stiffness"]  # fmt: skip
    if arm.links[0].beam is None:
        each = ["hub.mass", "hub.com.0", "joint.damping", "joint.stiffness"]
    return [f"link.{k}.{name}" for name in each for k in range(len(arm.links))
            if not (name.startswith("joint") and isinstance(arm.links[k].joint, fa.Fixed))][:count]  # fmt: skip


def push(arm: fa.Arm, integrator: str, step: float, count: int) -> Run:
    v0, tau = np.zeros(arm.nv), np.zeros(arm.nv)
    v0[0], tau[0] = 0.5, 0.2
    t = np.linspace(0.0, count * step, count + 1)
    return lambda: fa.simulate(arm, t, None, v0, tau=tau, integrator=integrator, step=step)


def rig() -> tuple[Run, Callable[[int], list[str]]]:
    scene = with_motion(fa.load("quanser"), read("lqr"))
    paths = [p for p in ARM if p != "strut.cable.damping"]
    paths += ["gravity.1", "link.1.joint.outboard.rotation.2", "strut.cable.stiffness", "q0.1", "q0.4", "v0.1", "v0.4"]
    paths += ["link.0.beam.length", "link.1.beam.length", "link.0.beam.material.density",
              "link.1.beam.material.density"]  # fmt: skip
    given = {**scene.given(), **scene.options}
    return lambda: fa.simulate(scene.arm, scene.t, scene.q0, scene.v0, **given), lambda n: paths[:n]


def scenes() -> dict[str, tuple[Run, Callable[[int], list[str]]]]:
    """Of each scene: its run, and paths of so many numbers."""
    made: dict[str, Any] = {"the rig of `flexarm validate quanser`": rig()}
    for name, arm, integrator, step, count in (
        ("a boom of four beams in space", boom(), "gauss", 5e-3, 100),
        ("two links in space", spatial(2, {"bending_y": 2, "bending_z": 2, "torsion": 1}), "implicit", 1e-3, 500),
        ("two links in space", spatial(2, {"bending_y": 2, "bending_z": 2, "torsion": 1}), "rk4", 1e-5, 500),
        ("7 rigid links in space", spatial(7, None), "implicit", 1e-3, 500),
        ("7 links of 3 + 3 + 1 modes", LONG, "implicit", 5e-4, 200),
    ):
        made[f"{name}, {integrator}"] = push(arm, integrator, step, count), lambda n, arm=arm: numbers(arm, n)
    return made


def least(ways: dict[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Least processor time (s) of each, all taking turns."""
    times = dict.fromkeys(ways, np.inf)
    for _ in range(rounds):
        for name, way in ways.items():
            begun = time.process_time()
            way()
            times[name] = min(times[name], time.process_time() - begun)
    return times


def row(name: str, run: Run, paths: Callable[[int], list[str]], rounds: int) -> str:
    done = run()
    w = {"q": np.random.default_rng(0).normal(size=done.q.shape)}
    ways: dict[str, Callable[[], object]] = {"run": run}
    for n in COUNTS:
        assert len(paths(n)) == n, (name, n)
        ways[f"forward {n}"] = lambda n=n: done.sensitivities(paths(n))
    for n in COUNTS:
        ways[f"adjoint {n}"] = lambda n=n: done.gradient(w, paths(n))
    times = least(ways, rounds)
    cells = [f"{times[k] / times['run']:.1f}" for k in list(ways)[1:]]
    line = f"| {name} | {times['run'] * 1e3:.3g} ms | " + " | ".join(cells) + " |"
    print(line, flush=True)
    return line


def dynamics(name: str, arm: fa.Arm, rounds: int) -> str:
    rng = np.random.default_rng(0)
    states = [[rng.normal(size=n) * 0.1 for n in (arm.nq, arm.nv, arm.nv)] for _ in range(50)]
    times = least({"a": lambda: [arm.forward_dynamics(*s) for s in states],
                   "d": lambda: [arm.forward_derivatives(*s) for s in states]}, 4 * rounds)  # fmt: skip
    line = f"| {name} | {times['a'] / len(states) * 1e6:.3g} µs | {times['d'] / times['a']:.1f} |"
    print(line, flush=True)
    return line


def main() -> None:
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--rounds", type=int, default=5)
    p.add_argument("--scene", default="", help="part of the names of those to measure")
    given = p.parse_args()
    heads = ["scene, integrator", "run", *(f"forward, {n}" for n in COUNTS), *(f"adjoint, {n}" for n in COUNTS)]
    table = ["| " + " | ".join(heads) + " |", "|-" * len(heads) + "|"]
    print(*table, sep="\n")
    table += [row(name, *of, given.rounds) for name, of in scenes().items() if given.scene in name]
    if given.scene:
        return
    table += ["", "| arm | forward dynamics | `forward_derivatives` |", "|-|-|-|"]
    table += [dynamics("7 rigid links in space", spatial(7, None), given.rounds),
              dynamics("7 links of 3 + 3 + 1 modes", LONG, given.rounds)]  # fmt: skip
    text = PAGE.read_text(encoding="utf-8")
    if BEGIN in text:
        before, _, rest = text.partition(BEGIN)
        PAGE.write_text(before + "\n".join([BEGIN, *table, END]) + rest.partition(END)[2], encoding="utf-8")


if __name__ == "__main__":
    main()
