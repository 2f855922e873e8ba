"""Sudden loads on joints with hardly any inertia: how many runs of "implicit" go through, and how right they are.

    python bench/run/loads.py [--rollouts 192] [--scenes 200] [--judged 12]

Rollouts: two links in space under random torques held for 20 ms, as a learner explores, on usual and on thin rods;
their error at the tip is against "gauss" with steps of 0.5 ms. Scenes: those of tests/drawn, with a torque on each
joint that leaps every 20 ms.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections import Counter
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
from hypothesis import HealthCheck, Phase, given, seed, settings

sys.path[:0] = [str(Path(__file__).parents[2] / "tests" / part) for part in ("", "drawn")]
import scenes  # noqa: E402

HOLD = 0.02  # s
KINDS = {"usual": (0.005, 3.0), "thin": (0.004, 4.0)}  # radius of the rods (m), largest torque (N m)


def two_links(radius: float, rotor: float) -> fa.Arm:
    aluminium = fa.Material(2700, 70e9, 0.33)
    beam = fa.Beam(0.5, fa.Circle(radius), aluminium, {"bending_y": 2, "bending_z": 2, "torsion": 1}, order=2)
    hub, tip = (fa.RigidBody(m, inertia=(1e-4,) * 3) for m in (0.1, 0.2))
    return fa.Arm(
        [fa.Link(fa.Revolute(axis, reflected_inertia=rotor), hub, beam, tip) for axis in "zy"], gravity=(0, 0, -9.81)
    )


def torques(arm: fa.Arm, most: float, step: float, count: int) -> np.ndarray:
    """(count, nstep, nv) for one second."""
    nstep, hold = round(1.0 / step), round(HOLD / step)
    joints = [k for k, name in enumerate(arm.coordinates) if "revolute" in name]
    random = np.random.default_rng(1).uniform(-most, most, (count, round(1.0 / HOLD), len(joints)))
    tau = np.zeros((count, nstep, arm.nv))
    tau[:, :, joints] = np.repeat(random, hold, axis=1)
    return tau


def tips(arm: fa.Arm, q: np.ndarray) -> np.ndarray:
    return np.array([arm.frame(row, link=-1)[0] if np.isfinite(row).all() else np.full(3, np.nan) for row in q])


def rollouts(count: int, judged: int) -> None:
    for kind, (radius, most) in KINDS.items():
        for rotor in (0.0, 1e-3):
            arm = two_links(radius, rotor)
            start = np.zeros(arm.nq)
            held = torques(arm, most, HOLD, judged)[:, [*range(50), 49]]
            run = fa.simulate_batch(arm, np.linspace(0, 1, 51), tau=held, integrator="gauss", step=5e-4)
            true = [tips(arm, q) for q in run.q]
            for step in (5e-4, 2e-3, 5e-3):
                tau = torques(arm, most, step, count)
                with warnings.catch_warnings(record=True) as told:
                    warnings.simplefilter("always")
                    run = fa.rollout(arm, start, tau=tau, step=step, integrator="implicit", every=round(HOLD / step))
                errors = [np.abs(tips(arm, q) - x).max() for q, x in zip(run.q, true, strict=False)]
                fine = np.isfinite(errors)
                ran = np.array(errors)[fine]
                error = f"{np.median(ran):.2g} m, worst {ran.max():.2g} m of {ran.size}" if ran.size else "-"
                steps = 100.0 * run.stats["failed_steps"] / max(run.stats["steps"], 1)
                setting = f"{kind} rods, rotor {rotor:g} kg m2, steps of {1e3 * step:g} ms"
                print(f"{setting}: {len(run.failures)} of {count} failed; {steps:.2g} % of the steps divided;",
                      f"tip's error: median {error}", flush=True)  # fmt: skip
                for w in told:
                    print("   ", str(w.message)[:300])


def drawn(count: int, step: float) -> None:
    ended = Counter[str]()

    @seed(1)
    @settings(max_examples=count, deadline=None, database=None, phases=[Phase.generate],
              suppress_health_check=list(HealthCheck))  # fmt: skip
    @given(scenes.arm(), scenes.SEEDS)
    def run(scene: dict[str, Any], number: int) -> None:
        ends(ended, step, scene, number)

    run()
    print(f"{count} drawn scenes, steps of {1e3 * step:g} ms: {dict(ended)}", flush=True)


def ends(ended: Counter[str], step: float, scene: dict[str, Any], number: int) -> None:
    """Counts how 0.2 s of a scene end."""
    try:
        arm = fa.Arm.from_dict(scene)
        joints = [k for k, name in enumerate(arm.coordinates) if not any(s in name for s in scenes.STRAINS)]
        size = np.random.default_rng(number).uniform(-2.0, 2.0, (round(0.2 / HOLD), len(joints)))
        tau = np.zeros((round(0.2 / step), arm.nv))
        tau[:, joints] = np.repeat(size, round(HOLD / step), axis=0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            out = fa.rollout(arm, arm.zero, tau=tau, step=step, integrator="implicit")
    except ValueError as e:
        ended["refused: " + str(e)[:40]] += 1
        return
    divided = "divided, " if out.stats["failed_steps"] else ""
    ended[divided + (out.failures[0].reason[:40] if out.failures else "ran")] += 1


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, value in (("rollouts", 192), ("scenes", 200), ("judged", 12)):
        parser.add_argument(f"--{name}", type=int, default=value)
    args = parser.parse_args()
    if args.rollouts:
        rollouts(args.rollouts, min(args.judged, args.rollouts))
    for step in (1e-3, 5e-3) if args.scenes else ():
        drawn(args.scenes, step)


if __name__ == "__main__":
    main()
