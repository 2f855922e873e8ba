"""Worker of bench/speed/speed_batch.py and aims.py: flexarm's rollouts on MuJoCo's case, on scenes from small to large,
its forward dynamics on SoRoMoX's rods, and what it is aimed at without others.

Times are CPU seconds of the process, all its threads together, but where two threads are compared with one.
"""

from __future__ import annotations

import argparse
import json
import time
import timeit
from collections.abc import Callable, Iterator
from typing import Any

import flexarm as fa
import numpy as np
from peer_common import CASES
from peer_flexarm import arm as arm_of
from peer_flexarm import drive
from peer_rods import RODS, Rods, soromox_order, state
from scipy.interpolate import CubicHermiteSpline

CASE = CASES["c"]
# models on MuJoCo's case: order, basis, modes, and whether each beam is cut into halves with so many modes each, which
# bend half as far; steps between two output times, of which a step may take several
MODELS: tuple[tuple[int | str, str, int, bool], ...] = (
    (2, "clamped-free", 1, False),
    (2, "clamped-free", 2, False),
    (2, "legendre", 2, True),
    ("exact", "legendre", 3, False),
    ("exact", "legendre", 4, False),
)
STEPS = {"implicit": (0.25, 0.5, 1, 2, 5, 10), "rk4": (5, 10)}
BATCH = 64
COUNTS = (1, 2, 4, 8, 16, 32, 64)
SHORTEST = 0.005  # s of CPU of one scenario alone, where lanes are measured: below, calls would count
LONGEST = 0.25  # s of CPU: no larger batch, and no shorter step, is tried beyond


def report(**line: Any) -> None:
    print(json.dumps(line), flush=True)


def clocks(run: Callable[[], Any]) -> tuple[float, float, Any]:
    """CPU and wall seconds of the fastest of three runs, of fewer if they take long, and the last one's answer."""
    cpus, walls = [], []
    while len(cpus) < 3 and sum(cpus) < LONGEST:
        cpu, wall = time.process_time(), time.perf_counter()
        answer = run()
        cpus.append(time.process_time() - cpu)
        walls.append(time.perf_counter() - wall)
    return min(cpus), min(walls), answer


def truth() -> None:
    """The converged path of the tip on MuJoCo's case, and how far it moved at its last refinement."""
    paths = []
    for modes, steps in ((5, 200), (6, 400)):
        options = {"integrator": "gauss", "step": CASE.end / steps, "stages": 4, "rtol": 1e-12}
        run = fa.simulate(arm_of(CASE, modes), CASE.times, drive=drive(CASE), **options)  # type: ignore[arg-type]
        paths.append(run.frame()[0][:, :2])
    moved = float(np.linalg.norm(paths[1] - paths[0], axis=1).max())
    report(kind="truth", path=paths[1].tolist(), converged=moved)


def settings() -> Iterator[tuple[str, str, fa.Arm, str, float]]:
    for order, basis, modes, halves in MODELS:
        model = arm_of(CASE, modes, order, basis)
        if halves:
            model = fa.Arm([piece for link in model.links for piece in fa.split(link, modes, [CASE.length / 2])])
        name = f"order {order}, {f'halves of {modes}' if halves else modes} modes"
        for integrator, choices in STEPS.items():
            for every in choices:
                dt = CASE.end / CASE.outputs / every
                yield f"flexarm {integrator}", f"{name}, step {dt:.3g} s", model, integrator, every


def mujoco_run(method: str, setting: str, model: fa.Arm, integrator: str, every: float) -> None:
    """One setting: a scenario alone, a batch on one thread, and on two."""
    steps = int(every * CASE.outputs)
    t = np.linspace(0.0, CASE.end, steps + 1)
    tau = np.zeros((steps, model.nv))  # held over each step, at its middle's value
    size = model.nv // CASE.beams  # a joint's coordinate comes first in its link
    for b in range(CASE.beams):
        tau[:, b * size] = CASE.torque((t[1:] + t[:-1]) / 2, b)
    start = np.zeros((BATCH, model.nq))
    start[:, 0] = 1e-3 * np.arange(BATCH)

    def run(count: int, workers: int = 1) -> fa.results.Rollout:
        options = {"step": t[1], "integrator": integrator, "every": max(1, int(every)), "workers": workers}
        return fa.rollout(model, start[:count], None, tau, **options)  # type: ignore[arg-type]

    line: dict[str, Any] = {"kind": "run", "method": method, "setting": setting, "path": None}
    scalar, _, one = clocks(lambda: run(1))
    if one.status[0] == 0 and np.isfinite(one.q).all():
        q = CubicHermiteSpline(one.t, one.q[0], one.v[0])(CASE.times)
        line |= {"path": model.frame(q)[0][:, :2].tolist(), "scalar": CASE.end / scalar}
        count = int(max(1, min(BATCH, LONGEST / scalar)))
        cpu, _, _ = clocks(lambda: run(count))
        _, wall, _ = clocks(lambda: run(count, 2))
        line |= {"batch": count * CASE.end / cpu, "two": count * CASE.end / wall, "scenarios": count}
    report(**line)


def chain(links: int, modes: dict[str, int], planar: bool, order: int | str = 2) -> fa.Arm:
    """Links of half a metre on hinges along z, or z and y in turn."""
    steel = fa.Material(7850, 209e9, 0.3)
    beam = fa.Beam(0.5, fa.Rectangle(0.004, 0.01), steel, modes, order=order) if modes else None
    hub = fa.RigidBody(0.3, inertia=(1e-4, 2e-4, 2e-4), end=(0.075 if modes else 0.5, 0, 0))
    joints = [fa.Revolute("y" if k % 2 and not planar else "z") for k in range(links)]
    return fa.Arm([fa.Link(joint, hub, beam) for joint in joints])


SCENES: dict[str, tuple[int, dict[str, int], bool]] = {
    "planar, 2 links of 3 modes": (2, {"bending_y": 3}, True),
    "rigid, 7 links": (7, {}, False),
    "7 links of 3 + 3 + 1 modes": (7, {"bending_y": 3, "bending_z": 3, "torsion": 1}, False),
}


EXPLICIT = (1e-5, 1e-3, 2e-6)  # s, that rk4 can follow on each


class Scene:
    """An arm in many states near each other."""

    def __init__(self, name: str, order: int | str = 2) -> None:
        self.arm = chain(*SCENES[name], order)
        self.start = 0.2 * np.sin(np.arange(64 * self.arm.nq)).reshape(64, self.arm.nq)
        self.start[:, ["bending" in c or "torsion" in c for c in self.arm.coordinates]] *= 1e-3

    def run(
        self, count: int, steps: int, integrator: str, dt: float, workers: int = 1, **more: Any
    ) -> fa.results.Rollout:
        options = {"step": dt, "nstep": steps, "integrator": integrator, "every": steps, "workers": workers, **more}
        out = fa.rollout(self.arm, self.start[:count], None, np.zeros((1, self.arm.nv)), **options)
        if out.failures:
            raise RuntimeError(out.failures[0].reason)
        return out

    def enough(self, integrator: str, dt: float) -> int:
        """Steps that one scenario takes some milliseconds for."""
        return int(np.clip(20 * SHORTEST / clocks(lambda: self.run(1, 20, integrator, dt))[0], 20, 2000))


def scene_lanes(name: str, integrator: str, dt: float) -> None:
    """Time of a step of a scenario in batches from small to large; scalar, and by two threads."""
    scene = Scene(name)
    steps = scene.enough(integrator, dt)
    line = {"kind": "lanes", "scene": name, "integrator": integrator}
    for count in COUNTS:
        cpu, _, out = clocks(lambda count=count: scene.run(count, steps, integrator, dt))
        kind = {"lanes": out.stats.get("lanes")}
        report(**line, count=count, us=1e6 * cpu / count / steps, **kind)
    own = clocks(lambda: scene.run(64, steps, integrator, dt, lanes=False))[0] / 64
    ones, twos = [], []
    for _ in range(3):  # in turn: what else the machine does changes
        ones.append(clocks(lambda: scene.run(64, steps, integrator, dt))[1])
        twos.append(clocks(lambda: scene.run(64, steps, integrator, dt, 2))[1])
    report(**{**line, "kind": "threads"}, scalar_us=1e6 * own / steps, one_s=min(ones), two_s=min(twos))


def aims() -> None:
    """What is aimed at without others, in microseconds."""

    def tell(work: str, seconds: float, **more: Any) -> None:
        report(kind="aim", work=work, us=1e6 * seconds, **more)

    for order in ("exact", 2):
        scene = Scene("7 links of 3 + 3 + 1 modes", order)
        cpu, _, out = clocks(lambda scene=scene: scene.run(64, 5, "rk4", 1e-7))
        name = f"in lanes, {order if order == 'exact' else f'order {order}'}"
        tell(name, cpu / (64 * 5 * 4), lanes=out.stats["lanes"])
    for name, explicit in zip(SCENES, EXPLICIT, strict=True):
        scene = Scene(name)
        for integrator, dt in (("implicit", 1e-3), ("rk4", explicit)):
            steps = scene.enough(integrator, dt)
            for kind, lanes in (("one", True), ("alone", False)):
                cpu = clocks(lambda lanes=lanes: scene.run(1, steps, integrator, dt, lanes=lanes))[0]  # noqa: B023
                tell(f"{kind}: {name}, {integrator}", cpu / steps)
    case = CASES["a"]
    model, laws, t = arm_of(case, 3, 2, "clamped-free"), drive(case), np.linspace(0.0, case.end, 1001)
    many, few = (
        clocks(lambda t=t: fa.simulate(model, t, drive=laws, integrator="implicit", step=1e-3))[0]
        for t in (t, t[::1000])
    )
    tell("output", (many - few) / (len(t) - 2))
    for name in list(SCENES)[:2]:
        model = chain(*SCENES[name])
        q, v, tau = 1e-3 * np.sin(np.arange(model.nq)), 1e-2 * np.cos(np.arange(model.nv)), np.zeros(model.nv)
        clock = timeit.Timer(lambda: model.forward_dynamics(q, v, tau), timer=time.process_time)  # noqa: B023
        tell(f"python: {name}", min(clock.repeat(9, 2000)) / 2000)


def rod_arm(rods: Rods, order: int | str) -> fa.Arm:
    rubber = fa.Material(rods.density, rods.youngs_modulus, rods.poisson_ratio)
    modes = {"bending_y": rods.bending_y, "bending_z": rods.bending_z, "torsion": rods.torsion}
    beam = fa.Beam(rods.length, fa.Circle(rods.radius), rubber, modes, "legendre", order)
    links = []
    for k in range(rods.count):
        joint = fa.Revolute("y" if k % 2 else "z") if rods.hinged else fa.Fixed()
        links.append(fa.Link(joint, None, beam))
    return fa.Arm(links, rods.gravity)


def rods_run(rods: Rods, order: int | str) -> None:
    """One forward dynamics: by rows from Python, and in the stages of a rollout's rk4, without lanes and with them."""
    model = rod_arm(rods, order)
    q, v = state(rods)
    many_q, many_v = np.tile(q, (200, 1)), np.tile(v, (200, 1))
    rows, _, _ = clocks(lambda: model.forward_dynamics(many_q, many_v))
    none, steps = np.zeros((1, model.nv)), 5

    def run(**more: Any) -> fa.results.Rollout:
        options: dict[str, Any] = {
            **more,
            "step": 1e-7,
            "nstep": steps,
            "integrator": "rk4",
            "every": steps,
            "workers": 1,
        }
        return fa.rollout(model, many_q[:BATCH], many_v[:BATCH], none, **options)

    batch, _, out = clocks(run)
    loop, _, _ = clocks(lambda: run(lanes=False))
    if out.failures:
        raise RuntimeError(out.failures[0].reason)
    line = {"kind": "rods", "name": rods.name, "order": str(order), "coordinates": model.nv}
    stages = BATCH * steps * 4
    line |= {"loop_us": 1e6 * loop / stages, "batch_us": 1e6 * batch / stages, "rows_us": 1e6 * rows / len(many_q)}
    report(**line, a=soromox_order(rods, model.forward_dynamics(q, v)).tolist())


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("what", choices=["truth", "mujoco", "lanes", "rods", "aims"])
    what = parser.parse_args().what
    report(kind="versions", flexarm=fa.__version__, NumPy=np.__version__)
    if what == "truth":
        truth()
    elif what == "mujoco":
        for setting in settings():
            mujoco_run(*setting)
    elif what == "rods":
        for rods in RODS:
            for order in ("exact", 2):
                rods_run(rods, order)
    elif what == "aims":
        aims()
    else:
        for name, explicit in zip(SCENES, EXPLICIT, strict=True):
            scene_lanes(name, "implicit", 1e-3)
            scene_lanes(name, "rk4", explicit)
