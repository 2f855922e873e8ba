"""Batches of joints with dry friction against the same without, in the lanes: ratio of times in one run (aim: below 3).

Processor time, one thread. Hanging chains, each scenario driven by sines of its own, so that joints come to rest and
slide at other times in each lane. `rests`: part of joints and times at which a joint sticks.

python bench/many/friction_batch.py
"""

from __future__ import annotations

import time

import flexarm as fa
import numpy as np

STEEL = fa.Material(7850, 209e9, 0.3)
SCENARIOS, STEPS, DT, REPEATS = 64, 500, 2e-3, 25
# name, links, modes of each beam, coulomb of the first joint (N m); each next joint has half as much
CASES = (
    ("2 links, 2 modes each", 2, 2, 0.1),
    ("2 links, 2 modes each, rests more", 2, 2, 0.4),
    ("3 links, 3 modes each", 3, 3, 0.2),
    ("3 rigid links", 3, 0, 0.1),
    ("6 rigid links", 6, 0, 0.2),
)


def chain(links: int, modes: int, coulomb: float, stiction: float = 1.5) -> fa.Arm:
    """Links of 0.3 m that hang, their stiction so many times their Coulomb friction."""
    parts = []
    for k in range(links):
        c = coulomb / 2**k
        hub = fa.RigidBody(0.3, com=(0.03, 0, 0), inertia=(1e-3, 1e-3, 2e-3), end=(0.075, 0, 0))
        beam = fa.Beam(0.3, fa.Rectangle(0.003, 0.02), STEEL, {"bending_y": modes}, damping_ratio=0.02)
        joint = fa.Revolute("z", coulomb=c, stiction=stiction * c)
        parts.append(fa.Link(joint, hub, beam if modes else None))
    return fa.Arm(parts, gravity=(0, -9.81, 0))


def torques(arm: fa.Arm) -> np.ndarray:
    rng, t = np.random.default_rng(0), np.arange(STEPS) * DT
    tau = np.zeros((SCENARIOS, STEPS, arm.nv))
    for b in range(SCENARIOS):
        for k, i in enumerate(joints(arm)):
            tau[b, :, i] = 0.3 / (1 + k) * np.sin(t * rng.uniform(3, 12) + rng.uniform(0, 6))
    return tau


def joints(arm: fa.Arm) -> list[int]:
    return [i for i, name in enumerate(arm.coordinates) if "revolute" in name]


def main() -> None:
    print("| arm | rests | µs a step without | with | ratio |\n|-|-|-|-|-|")
    for name, links, modes, coulomb in CASES:
        arms = [chain(links, modes, c) for c in (0.0, coulomb)]
        tau = torques(arms[0])
        best = [np.inf, np.inf]
        for _ in range(REPEATS):  # taking turns
            for k, arm in enumerate(arms):
                begun = time.process_time()
                run = fa.rollout(arm, arm.zero, tau=tau, step=DT, every=STEPS, workers=1)
                best[k] = min(best[k], time.process_time() - begun)
                assert not run.failures
        v = fa.rollout(arms[1], arms[1].zero, tau=tau, step=DT).v[:, :, joints(arms[1])]
        without, with_it = (1e6 * x / (SCENARIOS * STEPS) for x in best)
        print(f"| {name} | {(v == 0).mean():.0%} | {without:.2f} | {with_it:.2f} | {with_it / without:.2f} |")


if __name__ == "__main__":
    main()
