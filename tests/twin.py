"""A link whose numbers are known, and what a rig would record of it."""

from __future__ import annotations

from typing import Any

import flexarm as fa
import numpy as np

MASS, MODULUS, DAMPING = "link.0.tip.mass", "link.0.beam.material.youngs_modulus", "link.0.joint.damping"
TRUE = {MASS: 0.05, MODULUS: 2.09e11, DAMPING: 0.05}
NOISE = {"angle": 3e-4, "strain": 2e-6}
MEASURED: dict[str, Any] = {"inputs": {0: "torque"}, "outputs": {"angle": "sensor.0", "strain": "sensor.1"}}
T = np.linspace(0.0, 1.0, 201)


def torque(t: float) -> float:
    return float(0.3 * np.sin(2 * np.pi * (1.0 + 3.0 * t) * t))


def scene(mass: float = 0.05, modulus: float = 2.09e11, damping: float = 0.05, coulomb: float = 0.0) -> fa.Scene:
    joint = fa.Revolute("z", damping=damping, reflected_inertia=0.01, coulomb=coulomb)
    beam = fa.Beam(0.5, fa.Rectangle(0.002, 0.02), fa.Material(7850, modulus, 0.3), modes={"bending_y": 2},
                   basis="legendre", damping_ratio=0.01)  # fmt: skip
    arm = fa.Arm([fa.Link(joint, beam=beam, tip=fa.RigidBody(mass))])
    sensors = (fa.sensors.Encoder(0, pulses=None), fa.sensors.StrainGauge(0, 0.01))
    return fa.Scene(arm, {0: fa.Torque(T, [torque(x) for x in T])}, t=T, sensors=sensors)


def recorded(twin: fa.Scene, seed: int = 0, noise: dict[str, float] = NOISE) -> fa.Data:
    """What a rig would record; its torque as it was asked for, whatever the drive made of it."""
    fine = np.linspace(T[0], T[-1], 8 * (len(T) - 1) + 1)
    run = fa.simulate(twin.arm, fine, twin.q0, twin.v0, drive=twin.drive, integrator="implicit", step=2.5e-4)
    rng = np.random.default_rng(seed)
    columns = {
        name: sensor.read(run).y[::8, 0] + noise.get(name, 0.0) * rng.normal(size=len(T))
        for name, sensor in zip(("angle", "strain"), twin.sensors, strict=True)
    }
    return fa.Data(T, {**columns, "torque": [torque(x) for x in T]}, {"angle": "rad", "strain": "1", "torque": "N m"})
