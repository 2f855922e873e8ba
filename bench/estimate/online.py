"""Payload, friction and tip estimated online: in simulation, and on a measured rig.

    python bench/estimate/online.py [-o DIR] [--docs] [--program build/examples/kalman]

(a) Two links with payloads of 0.05 to 0.5 kg, from starts that are wrong by factors of 3, and dry friction in the
joints that the filter's arm does not have. Encoders and strain gauges, with their noise and steps.
(b) The rig of the scene "quanser", and its recordings: from motor currents and encoders alone, both links' deflections,
against those measured by strain gauges, which the filter does not see.
(c) 30 scenes at random: payload, start, its standard deviation, noises, gravity, how softly the motion begins; with
strain gauges, or without.
(d) With the program (cpp/examples, built), times of a cycle in C++.
Writes online.csv and online.png into DIR (default: here), and prints the tables of docs/online.md.
"""

from __future__ import annotations

import argparse
import csv
import re
import subprocess
import sys
import tempfile
import warnings
from dataclasses import replace
from pathlib import Path

import flexarm as fa
import matplotlib
import numpy as np
from flexarm.identify.validate.rig import FOLDER, identified, with_values

matplotlib.use("Agg")
import matplotlib.pyplot as plt

DOCS = Path(__file__).parents[2] / "docs"
BLUE, ORANGE, GREY = "tab:blue", "tab:orange", "0.5"
STEP = 1e-3
STEEL = fa.Material(7850, 209e9, 0.3)
DAMPING, COULOMB = (0.05, 0.02), (0.1, 0.03)  # N m s/rad, N m
SENSORS = [fa.sensors.Encoder(k, pulses=4096, quadrature=True) for k in (0, 1)] + [
    fa.sensors.StrainGauge(k, 0.01, noise=2e-6, resolution=1e-6) for k in (0, 1)
]
FORCE_NOISE = [0.004, 2e-4, 2e-4] * 2  # N m/sqrt(Hz)


# -- simulated -----------------------------------------------------------------------------------------------------


def two_links(payload: float = 0.0, rubs: bool = False, thickness: float = 0.004, gravity: float = 0.0) -> fa.Arm:
    """Steel strips, in the horizontal plane if there is no gravity."""

    def link(k: int, tip: fa.RigidBody) -> fa.Link:
        joint = fa.Revolute("z", damping=DAMPING[k], coulomb=COULOMB[k]) if rubs else fa.Revolute("z")
        hub = fa.RigidBody(0.3, (0.02, 0, 0), (0.03, 0.01)[k] * np.eye(3), (0.05, 0, 0))
        beam = fa.Beam(0.4, fa.Rectangle(thickness, 0.02), STEEL, {"bending_y": 2}, "legendre", 2, damping_ratio=0.01)
        return fa.Link(joint, hub, beam, tip)

    elbow = fa.RigidBody(0.3, (0.02, 0, 0), 1e-4 * np.eye(3), (0.03, 0, 0))
    return fa.Arm([link(0, elbow), link(1, fa.RigidBody(0.05 + payload, inertia=1e-5 * np.eye(3)))],
                  gravity=(0, -gravity, 0))  # fmt: skip


def moved(arm: fa.Arm, seconds: float, soft: float = 0.0) -> tuple[fa.Result, np.ndarray]:
    """A run under a sampled PD controller, and the forces that it held from each time to the next. `soft`: rate (rad/s)
    of a motion that begins from rest, in balance."""
    t = np.arange(round(seconds / STEP) + 1) * STEP
    tau = np.zeros((t.size, arm.nv))
    first, n = arm.joint_rate(1), arm.nv
    q0 = arm.equilibrium(lock=[0, 1])
    held = arm.inverse_dynamics(q0, np.zeros(n), np.zeros(n))[[0, first]]

    def law(now: float, y: np.ndarray) -> np.ndarray:
        reference = np.array([0.6 * np.sin(4 * now), 0.8 * np.sin(6 * now)])
        if soft:
            reference = np.array([0.4, 0.6]) * (1 - np.cos(np.array([1.0, 1.5]) * soft * now))
        u = held + np.array([12.0, 4.0]) * (reference - y[[0, first]]) - np.array([1.2, 0.3]) * y[[n, n + first]]
        tau[round(now / STEP), [0, first]] = u
        return np.asarray(u)

    control = fa.Sampled(law, 1 / STEP, actuate=(0, 1))
    run = fa.simulate(arm, t, q0, control=control, integrator="implicit", step=STEP / 4)
    return run, tau


def simulated(payload: float, factor: float, seconds: float = 2.0) -> tuple[fa.Result, fa.results.Estimate]:
    run, tau = moved(two_links(payload, rubs=True), seconds)
    unknown = {"payload": (factor * payload, payload), "damping.0": (0.1, 0.1), "damping.1": (0.05, 0.05),
               "coulomb.0": (0.0, 0.1), "coulomb.1": (0.0, 0.1)}  # fmt: skip
    filter = fa.KalmanFilter(two_links(), SENSORS, STEP, force_noise=FORCE_NOISE, q_std=0.01, v_std=0.01,
                             estimate=unknown)  # fmt: skip
    return run, filter.run(run.t, tau, [s.read(run) for s in SENSORS])


def at_random(count: int = 30) -> list[tuple[float, float, float]]:
    """Of scenes at random: error of the payload after 2 s and its standard deviation, over the payload; consistency."""
    rng, out = np.random.default_rng(5), []
    for _ in range(count):
        payload, factor = np.exp(rng.uniform(np.log([0.05, 1 / 3]), np.log([0.8, 3])))
        wrong = factor * payload
        joints, gauges = 10 ** rng.uniform([-3, -6], [0, -5])
        strips, gravity, soft = rng.choice([0, 1e-4]), rng.choice([0, 9.81]), rng.choice([2, 4, 8])
        std = rng.choice([1, 2, 4]) * max(payload, wrong)
        sensors = [*SENSORS[:2], *(fa.sensors.StrainGauge(k, 0.01, noise=gauges) for k in (0, 1))][
            : rng.choice([2, 4, 4])
        ]
        run, tau = moved(two_links(payload, thickness=0.005, gravity=gravity), 2.0, soft)
        filter = fa.KalmanFilter(
            two_links(thickness=0.005, gravity=gravity), sensors, STEP, force_noise=[joints, strips, strips] * 2,
            q=run.q[0], q_std=0.01, v_std=0.01, estimate={"payload": (wrong, std)},
        )  # fmt: skip
        estimate = filter.run(run.t, tau, [s.read(run) for s in sensors])
        error = estimate.parameters["payload"][-1] / payload - 1
        out.append((error, estimate.parameter_std["payload"][-1] / payload, estimate.consistency))
    return out


# -- measured ------------------------------------------------------------------------------------------------------

TORQUE = (0.75 * 0.119 * 100, 0.75 * 0.0232 * 50)  # N m/A: assumed efficiency, motor constant, gear
#: Recordings, and whose set-up (zero of the second encoder, cable, gains of the gauges) they are taken with: `psf` was
#: recorded on the rig of `fsf`.
RECORDED = {"lqr": "lqr", "fsf": "fsf", "psf": "fsf"}


def measured(name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times; deflections measured and estimated, (nt, 2) rad each, from 1 s after both gauges read (the rig tares them
    at first)."""
    scene = with_values(fa.load("quanser"), identified(RECORDED[name])[0])
    data, h = fa.Data.load(FOLDER / f"{name}.csv"), 0.002
    gauges = [s for s in scene.sensors if isinstance(s, fa.sensors.StrainGauge)]
    since = data.t - data.t[0]
    t = np.arange(round(float(since[-1]) / h) + 1) * h
    rows = np.round(since / h).astype(int)
    joints = [scene.arm.joint_rate(k) for k in (0, 1)]
    angles = np.column_stack([data["joint1"], data["joint2"]])
    deflections = np.column_stack([data["link1_deflection"], data["link2_deflection"]])
    late = since >= since[int(np.argmax((deflections != 0).all(axis=1)))] + 1.0
    sensors = [fa.sensors.Encoder(k, pulses=None, noise=2e-4) for k in (0, 1)]
    tau, y = np.zeros((t.size, scene.arm.nv)), np.full((t.size, 2), np.nan)
    y[rows] = angles
    for k, joint in enumerate(joints):
        tau[:, joint] = TORQUE[k] * np.interp(t + h / 2, since, data[f"motor{k + 1}_current"])
    q = np.zeros(scene.arm.nv)
    q[joints] = angles[0]
    unknown = {"damping.0": (0.0, 1.0), "damping.1": (0.0, 0.2), "coulomb.0": (0.0, 0.5), "coulomb.1": (0.0, 0.5)}
    filter = fa.KalmanFilter(
        scene.arm, sensors, h, force_noise=[1.0, 0, 0, 0.1, 0, 0], q=q, q_std=[1e-3, 0.05, 0.05] * 2, v_std=0.1,
        estimate=unknown, control=scene.control,
    )  # fmt: skip
    estimate = filter.run(t, tau, y)
    found = [s.gain * replace(s, filter=None).measure(scene.arm, t, estimate.q, estimate.v) for s in gauges]
    through = gauges[0].filter
    assert isinstance(through, fa.sensors.LowPass)
    return since[late], deflections[late], through.apply(t, np.hstack(found))[rows][late]


# -- C++ -----------------------------------------------------------------------------------------------------------


def cycles(program: Path) -> list[list[str]]:
    """Of two arms: coordinates, readings, median of the filter's cycle and of a plain step (us), allocations."""
    rows = []
    compiled = Path(tempfile.mkdtemp()) / "ist.json"
    subprocess.run([sys.executable, "-m", "flexarm", "compile", "ist", "-o", compiled], check=True, capture_output=True)
    paper = ["--scene", compiled, "--payload", "0.05"]
    scenes: dict[str, list[object]] = {"two links": [], "the paper's link": paper}
    for name, options in scenes.items():
        out = subprocess.run([program, *options], capture_output=True, text=True, check=True).stdout
        sizes = re.findall(r"\d+", out.splitlines()[0])
        medians = re.findall(r"median +([\d.]+)", out)
        spare = re.findall(r"p99.9 +([\d.]+)", out)
        asked = re.search(r"allocated +(\d+)", out)
        ratio = float(medians[0]) / float(medians[1])
        rows.append([name, *sizes, *medians, f"{ratio:.0f}", spare[0], asked[1] if asked else "not counted"])
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", type=Path, default=Path())
    parser.add_argument("--program", type=Path)
    parser.add_argument("--docs", action="store_true", help="write the rig's table into docs/online.md")
    options = parser.parse_args()
    warnings.simplefilter("ignore", fa.errors.LoopWarning)
    warnings.filterwarnings("ignore", "dry friction of 'link 0", fa.errors.ModelWarning)  # encoders hold its joints
    rows: list[list[object]] = []
    figure, axes = plt.subplots(1, 3, figsize=(10.4, 3.6), layout="constrained")
    for payload in (0.05, 0.15, 0.5):
        for factor, colour in ((1 / 3, BLUE), (3, ORANGE)):
            run, estimate = simulated(payload, factor)
            found, std = estimate.parameters["payload"] / payload, estimate.parameter_std["payload"] / payload
            late = run.t >= 1.0
            tip = 1e3 * np.abs(estimate.tip - run.frame()[0])[late].max()
            errors = [100 * (found[round(s / STEP)] - 1) for s in (0.25, 0.5, 1, 2)]
            friction = [estimate.parameters[f"coulomb.{k}"][-1] for k in (0, 1)]
            rows.append([payload, f"{factor:.2g}", *(f"{e:+.2f}" for e in errors), *(f"{c:.3f}" for c in friction),
                         f"{tip:.2f}"])  # fmt: skip
            if payload == 0.15:
                axes[0].plot(run.t, payload * found, color=colour, label=f"start {factor * payload:.2g} kg")
                low, high = payload * (found - 2 * std), payload * (found + 2 * std)
                axes[0].fill_between(run.t, low, high, color=colour, alpha=0.2)
    axes[0].axhspan(0.95 * 0.15, 1.05 * 0.15, color=GREY, alpha=0.4, label="0.15 kg ± 5 %")
    axes[0].set(title="payload, in simulation", xlabel="time (s)", ylabel="payload (kg)", xlim=(0, 0.5), ylim=(0, 0.5))
    axes[0].legend()
    head = "payload (kg) | start over it | error at 0.25 s (%) | 0.5 s | 1 s | 2 s | coulomb.0, .1 (N m) | | tip (mm)"
    print(f"| {head} |\n|-|-|-|-|-|-|-|-|-|")
    for row in rows:
        print("| " + " | ".join(map(str, row)) + " |")
    tried = np.array(at_random())
    error, within = np.abs(tried[:, 0]), np.abs(tried[:, 0]) < 2 * tried[:, 1]
    print(f"\nat random: {len(error)} scenes, {(error < 0.05).sum()} within 5 %, median error {np.median(error):.2%}, "
          f"largest {error.max():.1%}, {within.sum()} within two standard deviations")  # fmt: skip
    rows += [["at random", *row] for row in tried]
    lines = ["| recording | NRMSE link 1, 2 (%) | correlation |", "|-|-|-|"]
    for name in RECORDED:
        t, there, found = measured(name)
        apart = (found - there) - (found - there).mean(axis=0)
        nrmse = apart.std(axis=0) / there.std(axis=0)
        together = [np.corrcoef(found[:, k], there[:, k])[0, 1] for k in (0, 1)]
        lines.append(f"| {name} | {100 * nrmse[0]:.0f}, {100 * nrmse[1]:.0f} | {together[0]:.3f}, {together[1]:.3f} |")
        print(lines[-1], flush=True)
        rows.append([name, *nrmse, *together])
        for k in (0, 1) if name == "psf" else ():
            axes[1 + k].plot(t, np.rad2deg(there[:, k]), color=GREY, lw=2.5, label="measured, by a strain gauge")
            seen = np.rad2deg(found[:, k] - (found - there)[:, k].mean())
            axes[1 + k].plot(t, seen, color=BLUE, lw=1.3, label="estimated without it")
            axes[1 + k].set(title=f"rig, psf, link {k + 1}", xlabel="time (s)", ylabel="deflection (deg)")
            axes[1 + k].set(xlim=(t[0], t[0] + 10), ylim=(-3.2, 2.5))
            axes[1 + k].legend(loc="lower right", fontsize=9)
    if options.docs:
        page, end = DOCS / "online.md", "<!-- end of rig -->"
        text, begin = page.read_text(encoding="utf-8"), "<!-- rig: written by bench/estimate/online.py -->\n"
        table = "\n".join([*lines, ""])
        page.write_text(re.sub(f"{begin}.*?{end}", lambda _: begin + table + end, text, flags=re.DOTALL), "utf-8")
    if options.program:
        head = "arm | coordinates | readings | cycle, median (us) | plain implicit step | ratio | p99.9 | allocations"
        print(f"\n| {head} |\n|-|-|-|-|-|-|-|-|")
        for cycle in cycles(options.program):
            print("| " + " | ".join(cycle) + " |")
            rows.append(list(cycle))
    for ax in axes:
        ax.grid(alpha=0.3)
    options.o.mkdir(parents=True, exist_ok=True)
    figure.savefig(options.o / "online.png", dpi=110)
    with (options.o / "online.csv").open("w", newline="") as file:
        csv.writer(file).writerows(rows)


if __name__ == "__main__":
    main()
