"""Low passes ahead of sensors: their amplitude and phase, what they cost in accuracy, and what they keep from folding.

    python bench/run/filters.py [-o DIR]

(a, b) A hinge swings at seven frequencies at once, from 0.1 to 10 times the 5 Hz of a filter ahead of its encoder;
amplitude and phase of what is read, fitted, against the closed form; and the same with fewer output times.
(c, d) the impact of sensors.py: the gauge as it reads 100 times a second, with and without a filter.
Writes filters.csv and filters.png into DIR (default: here).
"""

from __future__ import annotations

import csv
import platform
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import flexarm as fa
import matplotlib
import numpy as np
from sensors import BLUE, GREY, ORANGE, axes_of, impact

matplotlib.use("Agg")
import matplotlib.pyplot as plt

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from reporting import output_folder

CUT = 5.0  # Hz
SWUNG = CUT * np.array([0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0])
FILTERS = {
    "order 1": (fa.sensors.LowPass(CUT), GREY),
    "order 2, damping ratio 0.707": (fa.sensors.LowPass(CUT, order=2), BLUE),
    "order 2, damping ratio 0.2": (fa.sensors.LowPass(CUT, order=2, damping_ratio=0.2), ORANGE),
}


def swing(rate: float) -> fa.Result:
    """All frequencies at once, `rate` output times a second."""
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, inertia=(1, 1, 1)))])
    w = 2 * np.pi * SWUNG
    phase = np.arange(len(w))

    def law(t: float) -> tuple[float, float, float]:
        s, c = np.sin(w * t + phase), np.cos(w * t + phase)
        return float(s.sum()), float(w @ c), float(-(w * w) @ s)

    return fa.simulate(arm, np.arange(round(6 * rate) + 1) / rate, drive={0: fa.Motion(law)})


def passed(low_pass: fa.sensors.LowPass, run: fa.Result) -> np.ndarray:
    """What is left of each frequency, complex."""
    y = fa.sensors.Encoder(pulses=None, filter=low_pass).read(run).y[:, 0]
    late = run.t >= 4.0  # when the start is forgotten; whole periods of all
    angle = np.outer(run.t[late], 2 * np.pi * SWUNG) + np.arange(len(SWUNG))
    fit = np.linalg.lstsq(np.hstack([np.sin(angle), np.cos(angle)]), y[late], rcond=None)[0]
    return np.asarray(fit[: len(SWUNG)] + 1j * fit[len(SWUNG) :])


def main() -> None:
    out = output_folder(__doc__)
    figure, ((a, b), (c, d)) = plt.subplots(2, 2, figsize=(11, 7), layout="constrained")
    rows: list[dict[str, Any]] = []
    run = swing(4000)
    f = np.geomspace(0.05, 20, 400) * CUT
    for name, (low_pass, colour) in FILTERS.items():
        found, exact = passed(low_pass, run), low_pass.response(f)
        a.loglog(f, np.abs(exact), color=colour, lw=1.2, label=name)
        a.loglog(SWUNG, np.abs(found), "o", color=colour, ms=5)
        b.semilogx(f, np.angle(exact, deg=True), color=colour, lw=1.2)
        b.semilogx(SWUNG, np.angle(found, deg=True), "o", color=colour, ms=5)
        b.set_yticks([0, -45, -90, -135, -180])
    axes_of(a, "a: amplitude, filters of 5 Hz: lines exact, dots read", "frequency (Hz)", "share that passes")
    axes_of(b, "b: phase", "frequency (Hz)", "phase (degrees)")
    a.legend(frameon=False, fontsize=9, loc="lower left")
    for rate in (500, 1000, 2000, 4000):
        run = swing(rate)
        off = [passed(x, run) / x.response(SWUNG) - 1 for x, _ in FILTERS.values()]
        for k in (3, 5, 6):
            rows.append(
                {"motion (Hz)": SWUNG[k], "output times a second": rate, "output times a period": rate / SWUNG[k]}
                | {"error of amplitude and phase": f"{max(abs(x[k]) for x in off):.1e}"}
            )

    rung = impact()
    gauge = fa.sensors.StrainGauge(0, x=0.005, face="+y", rate=100, noise=1e-8, seed=7)
    low_pass = fa.sensors.LowPass(25.0, order=2)
    ways = (("without a filter", gauge, ORANGE), ("25 Hz, order 2", replace(gauge, filter=low_pass), BLUE))
    for name, sensor, colour in ways:
        read = sensor.read(rung)
        spectrum = fa.sensors.psd(read.t, read.y)
        c.plot(read.t, 1e6 * read.y[:, 0], color=colour, lw=1, label=name)
        d.semilogy(spectrum.frequency, spectrum.density, color=colour, lw=1)
        at = np.abs(spectrum.frequency - (100 - 58.505)) < 1.0
        rows.append(
            {"motion (Hz)": 58.5, "output times a second": f"gauge, 100 Hz, {name}"}
            | {"error of amplitude and phase": f"density {spectrum.density[at].max():.1e} at 41.5 Hz"}
        )
    axes_of(c, "c: gauge after an impact, read 100 times a second", "time (s)", "strain (µm/m)")
    c.set(xlim=(0, 0.6), ylim=(-30, 45))
    c.legend(frameon=False, fontsize=9, loc="upper right")
    axes_of(d, "d: its spectrum: 58.5 Hz folds to 41.5 Hz", "frequency (Hz)", "density (1/Hz)")
    d.set(xlim=(0, 50), ylim=(1e-19, 1e-9))
    figure.savefig(out / "filters.png", dpi=110)
    with (out / "filters.csv").open("w", newline="") as file:
        file.write(f"# flexarm {fa.__version__}, {platform.machine()}, Python {platform.python_version()}\n")
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    for row in rows:
        print("  ".join(str(v) for v in row.values()))


if __name__ == "__main__":
    main()
