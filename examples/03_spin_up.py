"""A beam spins up: why the order of a model matters.

Shows: `Beam(order=)`, a prescribed motion of a joint, a beam that also stretches, a run that fails.
You see: the beam of Simo and Vu-Quoc (1986), 10 m long, spun up to 6 rad/s in 15 s. Its tip lags by 0.57 m; then the
centrifugal force pulls it straight, and stretches it by 0.51 mm. Order 2 is enough for that, "exact" agrees with it.
Order 0 keeps neither what stiffens a turning beam nor what softens it, and lags more; order 1 keeps only what softens
it, and its tip runs away.
Takes: 2 s. Needs: nothing besides flexarm.

    python 03_spin_up.py [--output DIR]
"""

import argparse
import warnings
from pathlib import Path

import flexarm as fa
import matplotlib.pyplot as plt
import numpy as np

parser = argparse.ArgumentParser(description="A beam spins up.")
parser.add_argument("--output", type=Path, default=Path(), metavar="DIR", help="folder to write into (here)")
folder = parser.parse_args().output
folder.mkdir(parents=True, exist_ok=True)

length, speed, rise = 10.0, 6.0, 15.0  # m, rad/s, s
stretch, bending, mass_per_length = 2.8e7, 1.4e4, 1.2  # EA (N), EI (N m^2), kg/m
section = fa.SectionMatrix(
    stiffness=np.diag([stretch, 1e7, 1e7, 1e4, bending, bending]),  # of stretch, shears, twist, bendings
    inertia=np.diag([mass_per_length] * 3 + [2 * 6e-4, 6e-4, 6e-4]),
)


def hub(t: float) -> tuple[float, float, float]:
    """Its angle, rate and acceleration (rad, rad/s, rad/s^2), as in that paper."""
    if t > rise:
        return speed * (t - rise / 2), speed, 0.0
    w = 2 * np.pi / rise
    angle = t**2 / 2 + (np.cos(w * t) - 1) / w**2
    return speed / rise * angle, speed / rise * (t - np.sin(w * t) / w), speed / rise * (1 - np.cos(w * t))


print(f"{'order':>6} {'greatest lag (m)':>17} {'at (s)':>7} {'tip at 20 s (m)':>16} {'stretch at 20 s (m)':>20}")
t = np.linspace(0, 20, 801)
runs = {}
for order in (0, 1, 2, "exact"):
    beam = fa.Beam(length, section, modes={"bending_y": 3, "extension": 2}, basis="legendre", order=order)
    arm = fa.Arm([fa.Link(fa.Revolute("z"), beam=beam)])
    drive = {0: fa.Motion(hub)}
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", fa.errors.RangeWarning
        )  # orders 0 and 1 bend the beam much too far: that is the point
        try:
            run = fa.simulate(arm, t, drive=drive, integrator="gauss", step=0.05)
        except fa.SimulationError as e:
            run = e.result  # what there was before
    bend = run.tip_deflection()
    runs[order] = run
    low = np.argmin(bend[:, 1])
    end = f"{bend[-1, 1]:16.2e} {bend[-1, 0]:20.3e}" if run.t[-1] == t[-1] else f"  stopped at {run.t[-1]:.1f} s"
    print(f"{order!s:>6} {-bend[low, 1]:17.4f} {run.t[low]:7.2f} {end}")

figure, ax = plt.subplots(figsize=(8, 4), layout="constrained")
for (order, run), style in zip(runs.items(), ("-.", ":", "-", "--"), strict=True):
    ax.plot(run.t, run.tip_deflection()[:, 1], style, label=f"order {order}")
ax.set(xlabel="time (s)", ylabel="deflection of the tip (m)", ylim=(-1.5, 0.5))
ax.axvline(rise, color="0.6", linewidth=1)
ax.annotate("full speed", (rise, 0.4), (4, 0), textcoords="offset points")
ax.legend(frameon=False, loc="lower right")
figure.savefig(folder / "spin_up.png", dpi=120)
print(f"The figure is {folder / 'spin_up.png'}.")
