"""Root locus and margins of strain feedback (Eq. 97) on the paper's arm with its identified drive.

    python bench/cli/strain_feedback.py [-o DIR]

The linear model has the joint's viscous friction, but no dry friction. Poles against Ks, continuous; the largest Ks of
either sign that is stable, continuous and sampled with a hold (fa.closed_loop); and the same
limit found in nonlinear simulation: sampled at 100 Hz, 3 % below and above. Last, the step of Fig. 12 and 13, nonlinear
and with dry friction, against Ks. Writes strain-feedback.csv (poles), -margins.csv, -steps.csv and strain-feedback.png
into DIR (default: here).
"""

from __future__ import annotations

import csv
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
from flexarm.cli.paper.control import DRIVE_GAIN, KP, KS, KV, STEP, marks, respond
from flexarm.data.draw.style import BLUE, GREEN, INK, ORANGE, PURPLE, RED
from matplotlib.figure import Figure

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from reporting import finish, output_folder

RATES = (1000.0, 500.0, 100.0)
GAINS = (0.006, 0.0, -0.005, -0.01, KS, -0.02, -0.05, -0.1, -0.2)
MEASURED = [("joint", 0), ("rate", 0), ("strain", 0, 0.0, "K3")]


def law_of(ks: float, rate: float | None = None) -> fa.Controller:
    """Eq. 97 behind its drive, continuous or sampled at a rate (Hz)."""
    motor = fa.Motor(DRIVE_GAIN)
    if rate is None:
        return fa.StrainFeedback(KP, KV, ks, motor=motor)
    none = np.zeros((0, 0)), np.zeros((0, 3)), np.zeros((1, 0))
    return fa.LinearController(*none, [[KP, KV, ks]], rate=rate, measure=MEASURED, motor=motor)


def limits(arm: fa.Arm, rate: float | None, most: float = 1e3) -> tuple[Any, Any]:
    """The Ks of smallest size, below and above zero, beyond which the loop is unstable, with the frequency of the mode
    that is lost; None: none up to `most`."""
    sizes = np.geomspace(1e-4, most, 400)
    over = "control.0.ks" if rate is None else "control.0.D.0.2"
    found = fa.closed_loop(arm, law_of(KS, rate)).locus(np.concatenate([-sizes[::-1], sizes]), over).crossings
    low, high = [x for x in found if x.value < 0], [x for x in found if x.value > 0]
    return (low[-1] if low else None), (high[0] if high else None)


def simulated_growth(arm: fa.Arm, ks: float, rate: float) -> float:
    """Of the root's strain in nonlinear simulation without dry friction, from 3 s to 6 s (1/s)."""
    link = arm.links[0]
    free = fa.Arm([replace(link, joint=replace(link.joint, coulomb=0.0))])
    t = np.arange(6001) / 1000
    r = fa.simulate(free, t, np.array([0.0, 1e-4, 1e-5, 0.0]), control=law_of(ks, rate), integrator="gauss", step=5e-3)
    strain = np.abs(r.strain(0, 0.0)[:, 2])
    early, late = (strain[(t > s) & (t < s + 0.5)].max() for s in (2.75, 5.25))
    return float(np.log(late / early) / 2.5)


def oscillating(poles: np.ndarray) -> np.ndarray:
    up = poles[poles.imag > 1e-6]
    return up[np.argsort(up.imag)]


def draw(arm: fa.Arm, most: float, path: Path) -> None:
    """`most`: the largest Ks above zero."""
    def poles(ks: float, rate: float | None = None) -> np.ndarray:
        return fa.closed_loop(arm, law_of(ks, rate)).poles

    fig = Figure(figsize=(10.4, 4.2), layout="constrained")
    a, b, c = fig.subplots(1, 3)
    sizes = np.concatenate([[0.0], np.geomspace(1e-4, 0.3, 300)])
    for sign, colour, name in ((-1, BLUE, "Ks below 0, to −0.3"), (1, RED, "Ks above 0, to 0.0105")):
        gains = sign * (sizes if sign < 0 else np.linspace(0, 0.0105, 100))
        z = np.concatenate([poles(k) for k in gains])
        z = z[(z.imag > 0) & (z.imag < 160)]
        a.plot(z.real, z.imag, ".", ms=2.5, color=colour, label=name)
    for k, mark, name in ((0.0, "x", "Ks = 0"), (KS, "s", f"Ks = {KS}, the demo's"), (most, "D", "limit")):
        z = oscillating(poles(k))[:3]
        a.plot(z.real, z.imag, mark, color=INK, ms=7, mfc="none", mew=1.6, label=name)
    a.axvline(0, color=INK, lw=1)
    a.set(xlabel="real part (1/s)", ylabel="imaginary part (rad/s)", xlim=(-7, 2.5), ylim=(0, 160))
    ratios = np.array([[-z.real / abs(z) for z in oscillating(poles(-k))] for k in sizes[1:]])
    for k, colour in enumerate((BLUE, GREEN, ORANGE, PURPLE)):
        name = ("joint", "first bending", "second bending", "third bending")[k]
        b.plot(sizes[1:], 100 * ratios[:, k], color=colour, label=name)
    b.set(xlabel="−Ks", ylabel="damping ratio (%)", xscale="log", yscale="log")
    for rate, colour in zip(RATES, (BLUE, GREEN, RED), strict=True):
        growth = [poles(-k, rate)[0].real for k in sizes[1:]]
        c.plot(sizes[1:], growth, color=colour, label=f"{rate:g} Hz")
    c.plot(sizes[1:], [poles(-k)[0].real for k in sizes[1:]], "--", color=INK, label="continuous")
    c.axhline(0, color=INK, lw=1)
    c.set(xlabel="−Ks", ylabel="growth of the least stable mode (1/s)", xscale="log", ylim=(-2, 2))
    for ax in (b, c):
        ax.axvline(-KS, color=INK, ls=":", lw=1)
    for ax, title in ((a, "a: root locus"), (b, "b: damping, continuous"), (c, "c: sampled, with a hold")):
        ax.set_title(title, fontsize=10, loc="left")
        where = {a: (0.02, 0.46), b: (0.02, 0.42), c: (0.02, 0.68)}[ax]
        ax.legend(frameon=False, fontsize=8, loc=where)
    finish(fig, path)


def steps(arm: fa.Arm, path: Path) -> None:
    """The step response against Ks, as a table."""
    names = ("rise", "settling", "overshoot", "ringing", "quiet", "held", "error")
    with path.open("w", newline="") as f:
        writer = csv.writer(f)
        writer.writerow(["Ks", *names])
        for ks in (0.0, -0.002, -0.005, -0.01, -0.015, -0.02, -0.03, -0.05):
            m = marks(respond(arm, ks), STEP)
            row = [ks, *(f"{getattr(m, name):.3f}" for name in names)]
            writer.writerow(row)
            print(*row, sep="  ")


def main() -> None:
    out = output_folder(__doc__)
    arm = fa.load("ist_control").arm
    with (out / "strain-feedback.csv").open("w", newline="") as f:
        writer = csv.writer(f)
        writer.writerow(["Ks", *(f"{n} {what}" for n in range(4) for what in ("real", "imaginary", "damping (%)"))])
        for ks in GAINS:
            z = oscillating(fa.closed_loop(arm, law_of(ks)).poles)
            row = [x for p in z for x in (p.real, p.imag, -100 * p.real / abs(p))]
            writer.writerow([ks, *(f"{x:.4g}" for x in row)])
            print(ks, "  ".join(f"{p.real:.2f} + {p.imag:.2f}i ({-100 * p.real / abs(p):.2f} %)" for p in z))
    found = {rate: limits(arm, rate) for rate in (None, *RATES)}
    with (out / "strain-feedback-margins.csv").open("w", newline="") as f:
        writer = csv.writer(f)
        writer.writerow(["sampling", "limit below", "limit above", "gain margin of the demo's Ks (dB)",
                         "mode lost (rad/s)"])  # fmt: skip
        for rate, (low, high) in found.items():
            row = ["continuous" if rate is None else f"{rate:g} Hz", "none" if low is None else f"{low.value:.5f}",
                   f"{high.value:.5f}", "" if low is None else f"{20 * np.log10(low.value / KS):.1f}",
                   "" if low is None else f"{low.frequency:.0f}"]  # fmt: skip
            writer.writerow(row)
            print(*row, sep="  ")
    for factor in (0.97, 1.03):
        ks, rate = factor * found[RATES[-1]][0].value, RATES[-1]
        print(f"100 Hz, Ks = {ks:.5f}: growth {fa.closed_loop(arm, law_of(ks, rate)).growth:+.3f} 1/s by the linear "
              f"model, {simulated_growth(arm, ks, rate):+.3f} in simulation")  # fmt: skip
    steps(arm, out / "strain-feedback-steps.csv")
    draw(arm, found[None][1].value, out / "strain-feedback.png")


if __name__ == "__main__":
    main()
