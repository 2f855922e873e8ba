"""Payload, friction and tip estimated online: in simulation, and on a measured rig.

    python bench/estimate/online.py [-o DIR] [--program build/examples/kalman]

(a) Two links with payloads of 0.05 to 0.5 kg, from starts that are wrong by factors of 3, and dry friction in the
joints that the filter's arm does not have. Encoders and strain gauges, with their noise and steps.
(b) The two-link rig of tests/data/quanser_excerpt.csv: from motor currents and encoders alone, both links' deflections,
against those measured by strain gauges, which the filter does not see; and the other way, the second joint's angle from
currents, gauges and the first joint's encoder.
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
import warnings
from pathlib import Path

import flexarm as fa
import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt

ROOT = Path(__file__).parents[2]
BLUE, ORANGE, GREY = "tab:blue", "tab:orange", "0.5"
STEP = 1e-3
STEEL = fa.Material(7850, 209e9, 0.3)
DAMPING, COULOMB = (0.05, 0.02), (0.1, 0.03)  # N m s/rad, N m
SENSORS = [fa.Encoder(k, pulses=4096, quadrature=True) for k in (0, 1)] + [
    fa.StrainGauge(k, 0.01, noise=2e-6, resolution=1e-6) for k in (0, 1)
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


def simulated(payload: float, factor: float, seconds: float = 2.0) -> tuple[fa.Result, fa.Estimate]:
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
        sensors = [*SENSORS[:2], *(fa.StrainGauge(k, 0.01, noise=gauges) for k in (0, 1))][: rng.choice([2, 4, 4])]
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

LENGTH = (0.202, 0.20185)  # m, from load to gauge
TORQUE = (0.75 * 0.119 * 100, 0.75 * 0.0232 * 50)  # N m/A: assumed efficiency, motor constant, gear
GAUGES = fa.LowPass(2, order=2, damping_ratio=0.9)  # the rig's own, ahead of what it records


def rig() -> fa.Arm:
    """Handbook values, but for the stiffness of the strips (0.65 and 0.67 of the handbook's) and the masses at their
    ends (1.79 and 0.213 kg; handbook 1.58 and 0.157), which were fitted to the recording that the excerpt is of."""

    def link(k: int, width: float, thickness: float, stiffness: float, tip: fa.RigidBody) -> fa.Link:
        joint = fa.Revolute("z", damping=(4.0, 1.5)[k], reflected_inertia=(0.0635, 0.00302)[k])
        steel = fa.Material(7850, stiffness * 2.068427e11, 0.29)
        section = fa.Rectangle(thickness, width)
        beam = fa.Beam(LENGTH[k], section, steel, {"bending_y": 2}, "legendre", 2, damping_ratio=0.02)
        return fa.Link(joint, None, beam, tip)

    stage = fa.RigidBody(1.79, inertia=np.diag([2e-3, 2e-3, 3e-3]))
    load = fa.RigidBody(0.213, inertia=1e-5 * np.eye(3))
    return fa.Arm([link(0, 0.0762, 0.00127, 0.65, stage), link(1, 0.0381, 0.000889, 0.67, load)])


def measured(path: Path, gauges: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray, fa.Estimate]:
    """Times, what the filter does not see, measured and estimated, (nt, k) rad each, and its estimate.

    It sees both encoders, and not the deflections; or, with `gauges`, the first encoder and the deflections, and not
    the second joint's angle.
    """
    data = fa.load_data(path)
    arm, h = rig(), 0.002
    t = np.arange(round(float(data.t[-1] - data.t[0]) / h) + 1) * h
    rows = np.round((data.t - data.t[0]) / h).astype(int)
    angles = np.column_stack([data["joint1"], data["joint2"]])
    deflections = np.column_stack([data["link1_deflection"], data["link2_deflection"]])
    encoders = [fa.Encoder(k, pulses=None, noise=2e-4) for k in (0, 1)]
    sensors: list[fa.Sensor] = [*encoders]
    seen = angles
    if gauges:  # of a distance that makes strain the deflection; their zero is where they are in the mean
        sensors = encoders[:1] + [
            fa.StrainGauge(k, face="-y", distance=LENGTH[k] / 3, filter=GAUGES, noise=3e-4) for k in (0, 1)
        ]
        seen = np.column_stack([angles[:, 0], deflections - deflections.mean(axis=0)])
    tau, y = np.zeros((t.size, arm.nv)), np.full((t.size, len(sensors)), np.nan)
    y[rows] = seen
    for k, joint in enumerate((0, arm.joint_rate(1))):
        tau[:, joint] = TORQUE[k] * np.interp(t + h / 2, data.t - data.t[0], data[f"motor{k + 1}_current"])
    q = np.zeros(arm.nv)
    q[[0, arm.joint_rate(1)]] = angles[0]
    unknown = {"damping.0": (0.0, 2.0), "damping.1": (0.0, 0.7), "coulomb.0": (0.3, 0.5), "coulomb.1": (0.1, 0.2)}
    filter = fa.KalmanFilter(
        arm, sensors, h, force_noise=[1, 1e-3, 1e-3, 0.1, 1e-3, 1e-3],
        q=q, q_std=[1e-3, 0.05, 0.05] * 2, v_std=0.1, estimate=unknown,
    )  # fmt: skip
    estimate = filter.run(t, tau, y)
    since = data.t - data.t[0]
    if gauges:
        return since, angles[:, 1:], estimate.q[rows][:, [arm.joint_rate(1)]], estimate
    bent = [LENGTH[k] / 3 * arm.strain(estimate.q, k, 0.0)[:, 2] for k in (0, 1)]
    found = GAUGES.apply(t, np.column_stack(bent))[rows]
    return since, deflections, found, estimate


# -- C++ -----------------------------------------------------------------------------------------------------------


def cycles(program: Path) -> list[list[str]]:
    """Of two arms: coordinates, readings, median of the filter's cycle and of a plain step (us), allocations."""
    rows = []
    paper = ["--scene", ROOT / "python/flexarm/scenes/ist.toml", "--payload", "0.05"]
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
    parser.add_argument("--data", type=Path, default=ROOT / "tests/data/quanser_excerpt.csv")
    options = parser.parse_args()
    warnings.simplefilter("ignore", fa.LoopWarning)
    rows: list[list[object]] = []
    figure, axes = plt.subplots(1, 3, figsize=(13, 3.8), layout="constrained")
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
    t, there, found, estimate = measured(options.data, gauges=False)
    late = t >= 1.0
    print("\n| deflection | NRMSE (%) | correlation |\n|-|-|-|")
    for k, name in enumerate(("first link", "second link")):
        apart = found[late, k] - there[late, k]
        nrmse = np.sqrt(np.mean((apart - apart.mean()) ** 2)) / there[late, k].std()
        together = np.corrcoef(found[late, k], there[late, k])[0, 1]
        print(f"| {name} | {100 * nrmse:.0f} | {together:.3f} |")
        rows.append(["rig", name, nrmse, together])
        axes[1 + k].plot(t, np.rad2deg(there[:, k]), color=GREY, lw=2.5, label="measured, by a strain gauge")
        axes[1 + k].plot(t, np.rad2deg(found[:, k] - apart.mean()), color=BLUE, lw=1.3, label="estimated, without it")
        axes[1 + k].set(title=f"rig, {name}", xlabel="time (s)", ylabel="deflection (deg)")
        axes[1 + k].legend()
    print(f"\nrig: {estimate}")
    t, there, found, estimate = measured(options.data, gauges=True)
    late = t >= 1.0
    nrmse = np.sqrt(np.mean((found[late] - there[late]) ** 2)) / there[late].std()
    print(f"the other way: second joint's angle, NRMSE {100 * nrmse:.0f} %, {estimate}")
    rows.append(["rig", "second joint's angle", nrmse])
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
