"""Fixed steps against IDA: error and time on the paper's spin-up, and the drift of a free arm's energy.

    python bench/run/steps.py [-o DIR]

Writes steps.csv and steps.png into DIR (default: here). Time is CPU time, the best of five; error is the largest
distance of the tip from that of IDA at rtol 1e-12.
"""

from __future__ import annotations

import argparse
import csv
import platform
import time
from pathlib import Path

import flexarm as fa
import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt

DRIVE = {0: fa.Motion.spin_up(7.6, 0.5)}
T = np.linspace(0, 2, 401)


def paper_arm() -> fa.Arm:
    """The paper's link (Sec. 5), three modes, order 2."""
    steel = fa.Material(7850, 209e9, 0.3)
    beam = fa.Beam(0.5, fa.Rectangle(0.001, 0.02), steel, {"bending_y": 3})
    return fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(end=(0.075, 0, 0)), beam)])


def spin_up(arm: fa.Arm) -> list[dict[str, object]]:
    """A row for each choice of integrator."""
    truth = fa.simulate(arm, T, drive=DRIVE, rtol=1e-12, atol=1e-14).frame()[0]
    choices: list[tuple[str, float, dict[str, object]]] = []
    for rtol in (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8):
        choices.append(("ida", rtol, {"rtol": rtol, "atol": rtol * 1e-2}))
        choices.append(("ida, order 2", rtol, {"rtol": rtol, "atol": rtol * 1e-2, "max_order": 2}))
    for h in (5e-3, 2.5e-3, 1.25e-3, 6.25e-4, 3.125e-4, 1.5625e-4):
        for rho in (1.0, 0.9, 0.5):
            choices.append((f"implicit, ρ = {rho:g}", h, {"integrator": "implicit", "step": h, "spectral_radius": rho}))
        choices.append(("rk4", h, {"integrator": "rk4", "step": h}))
    for h in (0.1, 0.05, 0.025, 0.0125, 6.25e-3, 3.125e-3):
        for n in (2, 3, 4):
            choices.append((f"gauss, {n} stages", h, {"integrator": "gauss", "step": h, "stages": n}))
    rows = []
    for name, setting, options in choices:
        best = np.inf
        for _ in range(5):
            start = time.process_time()
            r = fa.simulate(arm, T, drive=DRIVE, **options)  # type: ignore[arg-type]
            best = min(best, time.process_time() - start)
        s = r.stats
        rows.append(
            {
                "integrator": name,
                "rtol or step (s)": setting,
                "error (m)": f"{np.abs(r.frame()[0] - truth).max():.3g}",
                "cpu (ms)": f"{1e3 * best:.3g}",
                "steps": s["steps"],
                "iterations per step": f"{s['newton_iterations'] / s['steps']:.2f}",
            }
        )
    return rows


def drift(arm: fa.Arm, ax: plt.Axes) -> None:
    """Energy of the free arm, bent and turning, over 1e5 implicit steps."""
    q0, v0 = np.zeros(arm.nq), np.zeros(arm.nv)
    q0[1], v0[0] = 0.05, 2.0
    for h, rho in ((1e-3, 1.0), (1e-3, 0.9), (2.5e-4, 1.0)):
        t = np.arange(1001) * 100 * h
        r = fa.simulate(arm, t, q0, v0, integrator="implicit", step=1.0001 * h, spectral_radius=rho)
        energy = np.sum(r.energy(), axis=0)
        error = energy / energy[0] - 1
        slope = np.polyfit(np.linspace(0, 1, len(t)), error, 1)[0]
        print(f"free arm, 1e5 steps of {h:g} s, spectral radius {rho:g}: swing {np.ptp(error):.2e}, slope {slope:+.2e}")
        ax.semilogy(np.arange(1001) * 100, np.abs(error) + 1e-9, lw=0.7, label=f"h = {h * 1e3:g} ms, ρ = {rho:g}")
    ax.set(xlabel="step", ylabel="relative error of the energy", title="Free undamped arm")
    ax.legend(fontsize=8)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", type=Path, default=Path())
    out = parser.parse_args().o
    out.mkdir(parents=True, exist_ok=True)
    rows = spin_up(paper_arm())
    with (out / "steps.csv").open("w", newline="") as f:
        f.write(f"# flexarm {fa.__version__}, {platform.machine()}, Python {platform.python_version()}\n")
        writer = csv.DictWriter(f, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    for row in rows:
        print("  ".join(f"{v:>14}" for v in row.values()))
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.8), layout="constrained")
    for name in dict.fromkeys(row["integrator"] for row in rows):
        x, y = ([float(str(r[k])) for r in rows if r["integrator"] == name] for k in ("cpu (ms)", "error (m)"))
        left.loglog(x, y, "o-", ms=4, lw=1, label=name)
    left.set(xlabel="CPU time (ms)", ylabel="largest tip error (m)", title="The paper's spin-up, 2 s")
    left.legend(fontsize=8, loc="upper left", bbox_to_anchor=(-0.1, -0.15), ncols=3, frameon=False)
    left.grid(alpha=0.3)
    drift(paper_arm(), right)
    figure.savefig(out / "steps.png", dpi=130)


if __name__ == "__main__":
    main()
