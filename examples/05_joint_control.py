"""A sampled joint controller of a flexible link: how much delay it bears, before any run and in runs.

Shows: `fa.closed_loop` (poles, margins, limits) of an arm with a sampled law, and the same law in a nonlinear run.
You see: the margins of PD with strain feedback on the paper's arm at 500 Hz; steps of the joint with delays below and
above the limit that the linear analysis tells. The tip rings down below it and grows above it, at the rate of the pole.
Takes: 3 s. Needs: nothing besides flexarm.

    python 05_joint_control.py [--output DIR]
"""

import argparse
import warnings
from dataclasses import replace
from pathlib import Path

import flexarm as fa
import matplotlib.pyplot as plt
import numpy as np

parser = argparse.ArgumentParser(description="A sampled joint controller of a flexible link.")
parser.add_argument("--output", type=Path, default=Path(), metavar="DIR", help="folder to write into (here)")
folder = parser.parse_args().output
folder.mkdir(parents=True, exist_ok=True)

scene = fa.load("ist_control")  # the paper's link with its drive, here without its dry friction
link = scene.arm.links[0]
arm = fa.Arm([replace(link, joint=fa.Revolute("z", reflected_inertia=0.03, damping=0.38643))])
motor = scene.control[0].motor
measured = [("joint", 0), ("rate", 0), ("strain", 0, 0.0, "K3")]  # an encoder, a tachometer, a gauge at the root


def law(delay: float) -> fa.Sampled:
    """Eq. 97: u = kp (r - q) - kv q' - ks K3, at 500 Hz; the output comes `delay` after its sample."""
    return fa.Sampled(lambda t, y: 0.22 * (0.1 - y[0]) - 0.001 * y[1] + 0.015 * y[2], 500, measured,
                      delay=delay, motor=motor)


loop = fa.closed_loop(arm, law(0.0))
print(loop)
limits = loop.limits("control.0.delay")
print(limits)
limit = limits.high
loop.plot().savefig(folder / "loop.png", dpi=120)

print(f"\n{'delay (ms)':>10} {'fastest pole (1/s)':>19} {'in the run (1/s)':>17}")
t = np.linspace(0, 3, 3001)
figure, axes = plt.subplots(2, 1, figsize=(8, 5), sharex=True, layout="constrained")
growths = []
for share in (0.0, 0.5, 3.0):
    delay = share * limit
    growth = fa.closed_loop(arm, law(delay)).growth
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.errors.LoopWarning)  # which tells the same of the last one
        run = fa.simulate(arm, t, control=law(delay), integrator="implicit", step=5e-4)
    bend = 1e3 * run.tip_deflection()[:, 1]
    decay = fa.fit_decay(t[500:], bend[500:], modes=3)
    seen = max(-decay.damping * decay.frequencies)
    growths.append((growth, seen))
    print(f"{1e3 * delay:10.3f} {growth:19.3f} {seen:17.3f}")
    axes[0].plot(t, run.q[:, 0], label=f"{1e3 * delay:.2f} ms")
    axes[1].plot(t, bend)
axes[0].set(ylabel="joint (rad)")
axes[0].legend(frameon=False, title="delay")
axes[1].set(ylabel="tip deflection (mm)", xlabel="time (s)", ylim=(-40, 40))
figure.savefig(folder / "steps.png", dpi=120)
print(f"The figures are {folder / 'loop.png'} and {folder / 'steps.png'}.")
