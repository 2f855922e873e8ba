"""One command, a thousand payloads: how well does an input shaper forgive?

Shows: `fa.simulate_batch` over a parameter (threads, vector lanes, one call), `fa.input_shaper`, arrays as results.
You see: how much a link still rings after a turn, over the payload at its tip, unshaped and with ZV and ZVD shapers
that were made for 50 g; beside them the theory of one linear mode. 3000 runs take about a second.
Takes: 4 s. Needs: nothing besides flexarm.

    python 10_batch_of_payloads.py [--output DIR]
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path

import flexarm as fa
import matplotlib.pyplot as plt
import numpy as np

parser = argparse.ArgumentParser(description="A thousand payloads, with and without an input shaper.")
parser.add_argument("--output", type=Path, default=Path(), metavar="DIR", help="folder to write into (here)")
folder = parser.parse_args().output
folder.mkdir(parents=True, exist_ok=True)

link = fa.load("ist").arm.links[0]
beam = replace(link.beam, basis="legendre", modes={"bending_y": 2})
arm = fa.Arm([replace(link, beam=beam, tip=fa.RigidBody(mass=0.05))])
w0 = arm.modes(lock=[0]).frequencies[0]  # rad/s, at 50 g
payloads = np.linspace(0.02, 0.1, 1000)

turn = fa.Motion([0, 0.2, 3], [0, 0.05, 0.05], [0, 0, 0], [0, 0, 0])  # 50 mrad in 0.2 s
shapers = {"unshaped": None, "zv": fa.input_shaper("zv", w0), "zvd": fa.input_shaper("zvd", w0)}
t = np.linspace(0, 2, 401)
after = t > 0.2 + 2 * np.pi / w0  # all commands have ended

ringing, seconds = {}, 0.0
for name, shaper in shapers.items():
    command = turn if shaper is None else shaper.shape(turn)
    started = time.perf_counter()
    runs = fa.simulate_batch(
        arm, t, parameters={"link.0.tip.mass": payloads}, drive={0: command}, integrator="implicit", step=0.0025
    )
    seconds += time.perf_counter() - started
    tip = arm.deflection(runs.q[:, after])[..., 1]  # m, (1000, n)
    ringing[name] = 1e3 * np.ptp(tip, axis=1) / 2

few = [0, 374, 500, 750, 999]
w = np.array([fa.Arm([replace(arm.links[0], tip=fa.RigidBody(mass=m))]).modes(lock=[0]).frequencies[0]
              for m in payloads[few]])
theory = {name: shaper.residual(w) for name, shaper in shapers.items() if shaper is not None}
print(f"{3 * len(payloads)} runs of 2 s in {seconds:.2f} s.\n")
print(f"{'payload':>8} {'f / f at 50 g':>14} {'unshaped':>12} {'ZV':>9} {'theory':>9} {'ZVD':>9} {'theory':>9}")
for j, k in enumerate(few):
    left = [f"{100 * ringing[name][k] / ringing['unshaped'][k]:7.2f} % {100 * theory[name][j]:7.2f} %"
            for name in ("zv", "zvd")]
    print(f"{1e3 * payloads[k]:6.1f} g {w[j] / w0:14.3f} {ringing['unshaped'][k]:9.2f} mm {' '.join(left)}")

figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
for name, left in ringing.items():
    ax.semilogy(1e3 * payloads, left, label=name if name == "unshaped" else name.upper())
ax.axvline(50, color="0.6", linewidth=1)
ax.annotate("shapers' payload", (50, ringing["zv"].max()), (4, 0), textcoords="offset points", va="top")
ax.set(xlabel="payload (g)", ylabel="ringing of the tip (mm)")
ax.legend(frameon=False)
figure.savefig(folder / "payloads.png", dpi=120)
print(f"The figure is {folder / 'payloads.png'}.")
