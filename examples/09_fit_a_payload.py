"""What hangs on the arm? Payload, friction and damping from a recorded run.

Shows: a file of columns with units in (`fa.Data.load`), `fa.identify` with intervals, validation on a second run.
You see: a table of the fitted numbers, each with the interval that should hold the true one, beside the true ones: the
records come from a finer model (order "exact", 4 shape functions, another integrator) with noise and encoder steps, and
are read back from CSV files, in degrees, as a rig would write them.
Takes: 5 s. Needs: nothing besides flexarm.

    python 09_fit_a_payload.py [--output DIR]
"""

import argparse
from dataclasses import replace
from pathlib import Path

import flexarm as fa
import numpy as np

parser = argparse.ArgumentParser(description="Payload, friction and damping from a recorded run.")
parser.add_argument("--output", type=Path, default=Path(), metavar="DIR", help="folder to write into (here)")
folder = parser.parse_args().output
folder.mkdir(parents=True, exist_ok=True)

steel = fa.Material(density=7850, youngs_modulus=209e9, poisson_ratio=0.3)
beam = fa.Beam(0.5, fa.Rectangle(y=0.002, z=0.02), steel, {"bending_y": 3}, "legendre", damping_ratio=0.01)
joint = fa.Revolute("z", reflected_inertia=0.01, damping=0.1, coulomb=0.02)
arm = fa.Arm([fa.Link(joint, beam=beam, tip=fa.RigidBody(mass=0.1))])  # the guess
encoder, gauge = fa.sensors.Encoder(0, pulses=5000, quadrature=True), fa.sensors.StrainGauge(0, x=0.02)

true = {"link.0.tip.mass": 0.215, "link.0.joint.damping": 0.06, "link.0.joint.coulomb": 0.045}


def record(file: str, frequency: float, seed: int) -> Path:
    """Stands for the rig: writes time, torque, angle and strain at 250 Hz."""
    t = np.linspace(0, 1.5, 376)
    torque = 0.5 * np.sin(2 * np.pi * frequency * t) + 0.2 * np.sign(np.sin(11 * t))
    real = replace(beam, modes={"bending_y": 4}, order="exact")
    moved = replace(joint, damping=true["link.0.joint.damping"], coulomb=true["link.0.joint.coulomb"])
    rig = fa.Arm([fa.Link(moved, beam=real, tip=fa.RigidBody(mass=true["link.0.tip.mass"]))])
    run = fa.simulate(rig, t, drive={0: fa.Torque(t, torque)}, integrator="gauss", step=0.004)
    strain = replace(gauge, noise=3e-6, seed=seed).read(run).y[:, 0]
    rows = np.column_stack([t, torque, np.degrees(encoder.read(run).y[:, 0]), 1e6 * strain])
    path = folder / file
    np.savetxt(path, rows, "%.9g", ",", header="time [s],torque [N m],angle [deg],strain [µm/m]", comments="",
               encoding="utf-8")
    return path


data = fa.Data.load(record("recorded.csv", 1.4, seed=1))
kept_aside = fa.Data.load(record("kept_aside.csv", 2.2, seed=2))
print(data)

options = {"integrator": "implicit", "step": 0.0005}
guess = fa.Scene(arm, {0: fa.Torque(0.0)}, sensors=(encoder, gauge), options=options)
fit = fa.identify(
    guess,
    data,
    dict.fromkeys(true),  # each from the guess on
    inputs={0: "torque"},
    outputs={"angle": "sensor.0", "strain": "sensor.1"},
    starts=1,
)
print(f"\n{'':22} {'guess':>8} {'fitted':>9} {'95 % interval':>20} {'true':>7}")
for name, value in fit.values.items():
    low, high = fit.intervals[name]
    start = {"mass": 0.1, "damping": 0.1, "coulomb": 0.02}[name.rpartition(".")[2]]
    print(f"{name:22} {start:8.3f} {value:9.5f} {low:9.5f} to {high:7.5f} {true[name]:7.3f}")
print(f"\nOn the record that it was not fitted to:\n{fit.validate(kept_aside)}")

fit.plot().savefig(folder / "fit.png", dpi=120)
fit.scene.save(folder / "fitted.toml")
print(f"Written: {folder / 'fit.png'}, {folder / 'fitted.toml'} (try: flexarm modes fitted.toml).")
