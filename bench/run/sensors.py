"""What instruments make of the paper's arm: gauge, encoder and accelerometer.

    python bench/run/sensors.py [-o DIR]

(a, b) the experiment of the paper's Fig. 7: the hub held, an impact on the tip, a strain gauge at the root, and its
power spectral density. The beam's modal damping, 0.3 %, the gauge's noise and the impact are assumed; the paper gives
none.
(c, d) the scene "ist": the hub's speed from the differences of a 2000-pulse encoder, with and without quadrature, and
the acceleration of the tip as an instrument with a delay, a range and noise reads it.
Writes sensors.csv and sensors.png into DIR (default: here).
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

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from reporting import finish, output_folder

BLUE, ORANGE, GREY = "#0072B2", "#D55E00", "#888888"
PAPER = (20.95, 131.28, 367.6)  # rad/s, calculated; measured 2.9, 20.5, 55.7 Hz
GAUGE = fa.sensors.StrainGauge(0, x=0.005, face="+y", rate=1000, noise=0.1e-6, seed=7)


def impact() -> fa.Result:
    """The hub held; half a sine of 2 ms and 0.5 N on the tip."""
    scene = fa.load("ist")
    beam = replace(scene.arm.links[0].beam, damping_ratio=0.003)
    arm = fa.Arm([replace(scene.arm.links[0], beam=beam)])
    s = np.linspace(0, 2e-3, 21)
    t = np.append(s, 8.0)
    hit = fa.Load(force=np.outer(np.append(0.5 * np.sin(np.pi * s / 2e-3), 0.0), [0, 1, 0]), t=t)
    times = np.arange(8001) / 1000
    hold = {0: fa.Motion([0, 8], [0, 0])}
    return fa.simulate(arm, times, drive=hold, loads=[hit], integrator="gauss", step=0.002)


def measure(rows: list[dict[str, Any]]) -> tuple[fa.results.Reading, fa.results.PowerSpectrum, fa.Result]:
    rung = GAUGE.read(impact())
    spectrum = fa.sensors.psd(rung.t, rung.y)
    for k, (peak, paper) in enumerate(zip(spectrum.peaks(3), PAPER, strict=True), 1):
        rows.append(
            {"quantity": f"peak {k} of the gauge's spectrum (Hz)", "found": f"{peak:.3f}"}
            | {"expected": f"{paper / (2 * np.pi):.3f}"}
        )
    run = fa.load("ist").run()
    speed = fa.sensors.Tachometer().read(run)
    for quadrature, name in ((False, "without"), (True, "with")):
        angle = fa.sensors.Encoder(pulses=2000, quadrature=quadrature).read(run)
        off = np.diff(angle.y[:, 0]) / np.diff(angle.t) - (speed.y[1:, 0] + speed.y[:-1, 0]) / 2
        step = fa.sensors.Encoder(quadrature=quadrature).steps(run.arm)[0] * 1000
        rows.append(
            {"quantity": f"speed from differences, {name} quadrature: largest error (rad/s)"}
            | {"found": f"{np.abs(off).max():.2f}", "expected": f"below {step:.2f}"}
        )
    return rung, spectrum, run


def axes_of(ax: Axes, title: str, x: str, y: str) -> None:
    ax.set_title(title, fontsize=10, loc="left")
    ax.set_xlabel(x)
    ax.set_ylabel(y)


def draw(rung: fa.results.Reading, spectrum: fa.results.PowerSpectrum, run: fa.Result, path: Path) -> None:
    figure, ((a, b), (c, d)) = plt.subplots(2, 2, figsize=(11, 7), layout="constrained")
    first = rung.t <= 1.0
    a.plot(rung.t[first], 1e6 * rung.y[first, 0], color=BLUE, lw=1)
    axes_of(a, "a: strain gauge at the root after an impact on the tip", "time (s)", "strain (µm/m)")
    b.semilogy(spectrum.frequency, spectrum.density, color=BLUE, lw=1)
    for f in spectrum.peaks(3):
        top = spectrum.density[np.argmin(np.abs(spectrum.frequency - f))]
        b.annotate(f"{f:.2f} Hz", (f, top), (6, 0), textcoords="offset points", fontsize=9, va="center")
    axes_of(b, "b: its power spectral density", "frequency (Hz)", "density (1/Hz)")
    b.set(xlim=(0, 100), ylim=(1e-20, 1e-9))

    now = (run.t >= 0.1) & (run.t <= 0.3)
    for quadrature, colour, label in ((False, GREY, "2000 pulses"), (True, ORANGE, "the same in quadrature")):
        angle = fa.sensors.Encoder(pulses=2000, quadrature=quadrature).read(run)
        rate = np.diff(angle.y[:, 0], prepend=0.0) / 1e-3
        c.plot(run.t[now], rate[now], color=colour, lw=0.8, label=label)
    c.plot(run.t[now], run.v[now, 0], color=BLUE, lw=1.5, label="true")
    axes_of(c, "c: the hub's speed by differences of an encoder, every 1 ms", "time (s)", "speed (rad/s)")
    c.legend(frameon=False, fontsize=9, loc="upper left")

    true = fa.sensors.Accelerometer(gravity=False).read(run)
    meter = fa.sensors.Accelerometer(delay=0.02, range=20.0, noise=0.5, resolution=0.1)
    read = meter.read(run)
    d.plot(read.t, read.y, color=ORANGE, lw=1, label="read: 20 ms late, within ±20 m/s², noise 0.5 m/s²")
    d.plot(true.t, true.y, color=BLUE, lw=1.2, label="true")
    axes_of(d, "d: acceleration of the tip, across the beam", "time (s)", "acceleration (m/s²)")
    d.set_ylim(d.get_ylim()[0], d.get_ylim()[1] + 0.25 * np.ptp(d.get_ylim()))
    d.legend(frameon=False, fontsize=9, loc="upper right")
    finish(figure, path)


def main() -> None:
    out = output_folder(__doc__)
    rows: list[dict[str, Any]] = []
    draw(*measure(rows), out / "sensors.png")
    with (out / "sensors.csv").open("w", newline="") as f:
        f.write(f"# flexarm {fa.__version__}, {platform.machine()}, Python {platform.python_version()}\n")
        writer = csv.DictWriter(f, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    for row in rows:
        print("  ".join(str(v) for v in row.values()))


if __name__ == "__main__":
    main()
