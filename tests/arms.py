"""Arms for the tests: the paper's link, and random spatial arms with every strain."""

from __future__ import annotations

import json
from pathlib import Path

import flexarm as fa
import numpy as np

DATA = Path(__file__).parent / "data"


def reference(name: str) -> dict:
    """A reference case: scene and states or trajectories, made by an independent program (see data/README.md)."""
    return json.loads((DATA / f"{name}.json").read_text())


def paper_link(order: int = 2, n: int = 3, basis: str = "clamped-free", **beam) -> fa.Arm:
    """The IST single link of the paper's Sec. 5."""
    return fa.Arm(
        [
            fa.Link(
                fa.Revolute("z"),
                fa.RigidBody(end=(0.075, 0, 0)),
                fa.Beam(
                    0.5,
                    fa.Rectangle(0.001, 0.02),
                    fa.Material(7850, 209e9, 0.3),
                    {"bending_y": n},
                    basis,
                    order,
                    **beam,
                ),
            )
        ]
    )


def random_arm(rng: np.random.Generator, links: int, orders=(0, 1, 2, 3, "exact")) -> fa.Arm:
    """Mixed joints, bodies, sections, bases and strains; well scaled, so that 1e-10 is a fair demand."""

    def body() -> fa.RigidBody:
        m = rng.uniform(0.2, 2.0)
        A = rng.normal(size=(3, 3))
        inertia = m * 0.01 * (A @ A.T + 0.1 * np.eye(3))
        return fa.RigidBody(m, rng.uniform(-0.1, 0.1, 3), inertia, rng.uniform(-0.2, 0.2, 3))

    def beam() -> fa.Beam:
        section = (
            fa.Rectangle(*rng.uniform(0.004, 0.02, 2)) if rng.random() < 0.5 else fa.Circle(rng.uniform(0.003, 0.01))
        )
        modes = {s: int(rng.integers(0, 3)) for s in ("bending_y", "bending_z", "torsion", "shear_y", "shear_z")}
        return fa.Beam(
            rng.uniform(0.3, 1.0),
            section,
            fa.Material(rng.uniform(1e3, 8e3), rng.uniform(1e7, 1e9), 0.3),
            modes,
            basis=str(rng.choice(["clamped-free", "legendre"])),
            order=orders[int(rng.integers(len(orders)))],
            damping_ratio=float(rng.choice([0.0, 0.02])),
        )

    chain = []
    for k in range(links):
        joint = [fa.Revolute(rng.normal(size=3)), fa.Prismatic(rng.normal(size=3)), fa.Fixed()][
            int(rng.integers(0, 3 if k else 2))
        ]
        elastic = beam() if rng.random() < 0.7 else None
        needs_hub = elastic is not None and elastic.order == 0
        chain.append(fa.Link(joint, body() if needs_hub or rng.random() < 0.8 else None, elastic, body()))
    return fa.Arm(chain, rng.normal(size=3) * 5)


def random_state(rng: np.random.Generator, arm: fa.Arm) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """q, v, tau with deflections of a few per cent of a length; of a few thousandths where a beam has order 0, whose
    kinetic energy, cut at first order, is not positive further out."""
    small = any(link.beam and link.beam.order == 0 for link in arm.links)
    joint = [" revolute" in c or " prismatic" in c for c in arm.coordinates]
    scale = np.where(joint, 1.0, 0.003 if small else 0.05)
    q = scale * rng.normal(size=arm.nv)
    v = scale * rng.normal(size=arm.nv)
    return q, v, rng.normal(size=arm.nv)
