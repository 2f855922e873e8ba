"""A pair of piezo patches damps a cantilever.

Shows: where to bond a patch (`fa.place_patch`), positive position feedback from one patch to another (`fa.ppf`),
damping that is measured in a decay (`fa.fit_decay`). You see: the tip of the bent strip let go, with the loop open and
closed; the damping ratio of its first mode in the run, beside that of the closed loop's pole.
Takes: 3 s. Needs: nothing besides flexarm.

    python 08_piezo_damping.py [--output DIR]
"""

import argparse
from dataclasses import replace
from pathlib import Path

import flexarm as fa
import matplotlib.pyplot as plt
import numpy as np

parser = argparse.ArgumentParser(description="A pair of piezo patches damps a cantilever.")
parser.add_argument("--output", type=Path, default=Path(), metavar="DIR", help="folder to write into (here)")
folder = parser.parse_args().output
folder.mkdir(parents=True, exist_ok=True)

strip = replace(fa.load("ist").arm.links[0].beam, basis="legendre", modes={"bending_y": 4}, damping_ratio=0.002)
pzt = fa.Piezo(youngs_modulus=62e9, poisson_ratio=0.3, density=7800, d31=-1.8e-10, permittivity=1.5e-8)
patch = fa.Patch(start=0.0, end=0.06, width=0.02, thickness=2e-4, material=pzt, face="+y")


def cantilever(*patches: fa.Patch) -> fa.Arm:
    return fa.Arm([fa.Link(fa.Fixed(), beam=replace(strip, patches=patches))])


where = fa.place_patch(cantilever(), patch=patch, modes=2, weights=[1, 0.3])
start = max(where.best - 0.03, 0.0)  # `best` is the middle of the patch
print(f"The best place of the patch is from {1e3 * start:.0f} to {1e3 * (start + 0.06):.0f} mm.")
actor = replace(patch, start=start, end=start + 0.06)
arm = cantilever(actor, replace(actor, face="-y"))  # the first one acts, the second one senses

law = fa.ppf(arm, measure=[("patch_voltage", 0, 1)], actuate=[("patch", 0, 0)], mode=0)
loop = fa.closed_loop(arm, law)
print(f"Filter: {law.frequency:.1f} rad/s, damping ratio {law.damping_ratio:.2f}, gain {law.gain:.3f}.")

bent = arm.equilibrium(loads=[fa.Load(0, force=(0, 0.02, 0))])  # 20 mN at the end, let go at t = 0
t = np.linspace(0, 4, 4001)
figure, (top, bottom) = plt.subplots(2, 1, figsize=(8, 5), sharex=True, layout="constrained")
print(f"\n{'':8} {'frequency (Hz)':>15} {'damping ratio':>14} {'of the pole':>12}")
ratios = {}
for name, control in (("open", []), ("closed", [law])):
    run = fa.simulate(arm, t, bent, control=control, integrator="implicit", step=2e-4)
    tip = 1e3 * run.tip_deflection()[:, 1]
    decay = fa.fit_decay(t[:2001], tip[:2001], modes=3 if control else 2)
    near = int(np.argmax(abs(decay.amplitudes)))
    modes = loop if control else arm.modes()
    pole = modes.damping[np.argmin(abs(modes.frequencies - decay.frequencies[near]))]
    ratios[name] = decay.damping[near], pole
    print(f"{name:8} {decay.frequencies[near] / (2 * np.pi):15.3f} {decay.damping[near]:14.4f} {pole:12.4f}")
    top.plot(t, tip, label=f"loop {name}")
    if control:
        gauge = run.patch_voltage(0, 1)
        bottom.plot(t, gauge, color="C1")
top.set(ylabel="tip (mm)")
top.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
bottom.set(ylabel="sensing patch (V)", xlabel="time (s)")
figure.savefig(folder / "piezo_damping.png", dpi=120)
print(f"The figure is {folder / 'piezo_damping.png'}.")
