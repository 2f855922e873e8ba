"""How often a payload lies within two standard deviations of the Kalman filter's estimate.

    python bench/estimate/coverage.py [--count 100] [--step 0.001] [--case payload|ball|late ...] [--docs]

Payloads are drawn from what the filter is told of them (positive ones), starts and noises likewise. Readings come at
1 kHz; the arm that is read moves by finer steps than the filter's. Prints the tables of docs/online.md (with --docs
puts them there): how often the payload is within two standard deviations, and the rms of errors over these; how
often the turn of a ball lies in the region of 95 %; and both, of a strip with a payload on a ball, before late cameras.
"""

from __future__ import annotations

import argparse
import re
import warnings
from pathlib import Path

import flexarm as fa
import numpy as np
from online import STEEL, STEP, two_links
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

DOCS = Path(__file__).parents[2] / "docs" / "online.md"
FORCES = np.array([0.02, 1e-3, 1e-3] * 2)  # N m/sqrt(Hz)
NOISE = [1e-4, 1e-4, 2e-6, 2e-6]
SENSORS = [fa.sensors.Encoder(k, pulses=None, noise=1e-4) for k in (0, 1)] + [
    fa.sensors.StrainGauge(k, 0.01, "+y", noise=2e-6) for k in (0, 1)
]
TIMES = (0.05, 0.2, 0.5, 1.0)  # s
FINE = STEP / 32  # of the arm that is read (s): the frequency of its fastest mode is right to 1e-4


def errors(count: int, told: tuple[float, float], soft: bool, step: float) -> np.ndarray:
    """Errors over standard deviations, (count, times)."""
    rng, model = np.random.default_rng(1), two_links()
    n, steps, every, fine = model.nv, round(TIMES[-1] / step), round(STEP / step), round(step / FINE)
    t = np.arange(steps + 1) * step
    known = np.zeros((steps + 1, n))
    known[:, 0] = 1.5 * (np.sin(3 * t) if soft else np.cos(6 * t))
    known[:, 3] = 0.4 * (np.sin(5 * t) if soft else np.cos(9 * t))
    filter = fa.KalmanFilter(model, SENSORS, step, force_noise=FORCES, q_std=0.01, v_std=0.01,
                             estimate={"payload": told})  # fmt: skip
    out = []
    while len(out) < count:
        payload = told[0] + told[1] * rng.normal()
        if payload <= 0.02:
            continue
        forces = known[:-1] + rng.normal(size=(steps, n)) * FORCES / np.sqrt(step)
        q0, v0 = 0.01 * rng.normal(size=n), 0.01 * rng.normal(size=n)
        arm = two_links(payload)
        run = fa.rollout(arm, q0[None], v0[None], np.repeat(forces, fine, axis=0)[None], step=step / fine, every=fine)
        y = np.column_stack([s.measure(arm, t, run.q[0], run.v[0]) for s in SENSORS])
        y += rng.normal(size=y.shape) * NOISE
        y[np.arange(steps + 1) % every != 0] = np.nan
        filter.reset()
        found = filter.run(t, known, y)
        z = (found.parameters["payload"] - payload) / np.maximum(found.parameter_std["payload"], 1e-12)
        out.append(z[[round(x / step) for x in TIMES]])
    return np.array(out)


def ball(count: int, std: float) -> np.ndarray:
    """Whether the error of a ball's turn is within 95 % of what is believed, (count, times): a link of 0.4 m that
    swings from a ball, seen by cameras at its end and at a bracket, 0.1 m beside the middle."""
    rng, step = np.random.default_rng(2), 1e-3
    link = fa.Link(fa.Spherical(damping=0.01), fa.RigidBody(0.5, (0.2, 0, 0), np.diag([2e-3, 8e-3, 8e-3]), (0.4, 0, 0)))
    arm = fa.Arm([link, fa.Link(fa.Fixed(), fa.RigidBody(0.02, end=(-0.2, 0.1, 0)))])
    t, v0 = np.arange(1001) * step, np.array([1.0, 2.0, -1.0])
    run = fa.simulate(arm, t, None, v0, rtol=1e-9, atol=1e-11)
    cameras = [fa.sensors.Camera(k, noise=1e-3) for k in (0, 1)]
    exact = np.column_stack([s.measure(arm, t, run.q, run.v) for s in cameras])
    out = []
    for _ in range(count):
        off = Rotation.from_quat(np.roll(run.q[0], -1)) * Rotation.from_rotvec(std * rng.normal(size=3))
        filter = fa.KalmanFilter(arm, cameras, step, force_noise=1e-4, q_std=std, v_std=0.1,
                                 q=np.roll(off.as_quat(), 1), v=v0 + 0.1 * rng.normal(size=3))  # fmt: skip
        y, inside = exact + 1e-3 * rng.normal(size=exact.shape), []
        for k, readings in enumerate(y):
            filter.update(readings)
            if k in [round(x / step) for x in TIMES]:
                between = Rotation.from_quat(np.roll(filter.q, -1)).inv() * Rotation.from_quat(np.roll(run.q[k], -1))
                error = between.as_rotvec()
                inside.append(error @ np.linalg.solve(filter.covariance[:3, :3], error) < chi2.ppf(0.95, 3))
            filter.predict()
        out.append(inside)
    return np.array(out)


def late(count: int, std: float, delay: float, low_pass: float | None) -> np.ndarray:
    """Of a strip with a payload of 0.3 ± 0.1 kg that swings from a ball, beside gyroscopes and two cameras at 200 Hz:
    errors of the payload over standard deviations at TIMES, whether the turn is within 95 % at the last of these, and
    the error of the tip there (m), (count, times + 2)."""
    rng, h, v0 = np.random.default_rng(3), STEP, np.array([1.0, 2.0, -1.0, 0.0, 0.0])
    strip = fa.Beam(0.5, fa.Rectangle(0.005, 0.02), STEEL, {"bending_y": 2}, "legendre", damping_ratio=0.01)
    hub = fa.RigidBody(0.3, (0.1, 0, 0), np.diag([2e-3, 4e-3, 4e-3]), (0.2, 0, 0))

    def arm(payload: float) -> fa.Arm:
        tip = fa.RigidBody(0.1 + payload, inertia=1e-5 * np.eye(3))
        return fa.Arm([fa.Link(fa.Spherical(damping=0.01), hub, strip, tip)])

    t, base, out = np.arange(round(TIMES[-1] / h) + 1) * h, arm(0.0), []
    for _ in range(count):
        payload = 0.3 + 0.1 * rng.normal()
        run = fa.simulate(arm(payload), t, None, v0, integrator="implicit", step=h / 8)
        given = {"noise": 1e-3, "delay": delay, "filter": low_pass, "rate": 200}
        sensors = [fa.sensors.Camera(0, x, **given, seed=int(rng.integers(2**31))) for x in (None, 0.1)]
        sensors += [fa.sensors.Tachometer(0, k, noise=1e-2, seed=int(rng.integers(2**31))) for k in range(3)]
        off = Rotation.from_quat(np.roll(run.q[0, :4], -1)) * Rotation.from_rotvec(std * rng.normal(size=3))
        filter = fa.KalmanFilter(
            base, sensors, h, force_noise=1e-4 * np.ones(5), q_std=[std] * 3 + [1e-3] * 2, v_std=[0.1] * 3 + [0.01] * 2,
            q=np.r_[np.roll(off.as_quat(), 1), run.q[0, 4:]], v=v0 + np.r_[0.1 * rng.normal(size=3), 0, 0],
            estimate={"payload": (0.3, 0.1)},
        )  # fmt: skip
        found = filter.run(t, None, [s.read(run) for s in sensors])
        z = (found.parameters["payload"] - payload) / found.parameter_std["payload"]
        between = Rotation.from_quat(np.roll(filter.q[:4], -1)).inv() * Rotation.from_quat(np.roll(run.q[-1, :4], -1))
        error = between.as_rotvec()
        inside = error @ np.linalg.solve(filter.covariance[:3, :3], error) < chi2.ppf(0.95, 3)
        out.append([*z[[round(x / h) for x in TIMES]], inside, np.linalg.norm(found.tip[-1] - run.frame()[0][-1])])
    return np.array(out)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--step", type=float, default=STEP)
    parser.add_argument("--case", choices=("payload", "ball", "late"), action="append", help="these tables alone")
    parser.add_argument("--docs", action="store_true", help="write the tables into docs/online.md")
    given = parser.parse_args()
    warnings.simplefilter("ignore", fa.errors.FilterWarning)
    tables = {
        "payload": ["| payload told (kg) | within two deviations after 0.05 s (%) | 0.2 s | 0.5 s | 1 s "
                    "| rms after 0.05 s | 0.2 s | 0.5 s | 1 s |", "|-|-|-|-|-|-|-|-|-|"],
        "ball": ["| standard deviation of the start (rad, each axis) | after 0.05 s (%) | 0.2 s | 0.5 s | 1 s |",
                 "|-|-|-|-|-|"],
        "late": ["| cameras | standard deviation of the start (rad, each axis) | payload within two deviations after "
                 "0.05 s (%) | 0.2 s | 0.5 s | 1 s | turn within 95 % after 1 s (%) | error of the tip there (mm) |",
                 "|-|-|-|-|-|-|-|-|"],
    }  # fmt: skip
    tables = {name: table for name, table in tables.items() if given.case is None or name in given.case}
    kinds = (((0.3, 0.05), False), ((0.3, 0.3), False), ((0.1, 0.4), False), ((0.1, 0.4), True))
    for told, soft in kinds if "payload" in tables else ():
        z = errors(given.count, told, soft, given.step)
        inside, rms = 100 * (np.abs(z) < 2).mean(axis=0), np.sqrt((z**2).mean(axis=0))
        cells = [f"{x:.0f}" for x in inside] + [f"{x:.2f}" for x in rms]
        name = f"{told[0]} ± {told[1]}{', a soft motion' if soft else ''}"
        tables["payload"].append(f"| {name} | {' | '.join(cells)} |")
        print(tables["payload"][-1], flush=True)
    for std in (0.02, 0.05, 0.1, 0.2, 0.4) if "ball" in tables else ():
        inside = 100 * ball(given.count, std).mean(axis=0)
        tables["ball"].append(f"| {std} | {' | '.join(f'{x:.0f}' for x in inside)} |")
        print(tables["ball"][-1], flush=True)
    seen = (
        ("as of now", 0.02, 0.0, None), ("30 ms late", 0.02, 0.03, None),
        ("30 ms late, behind 20 Hz", 0.05, 0.03, 20.0), ("30 ms late", 0.1, 0.03, None),
    )  # fmt: skip
    for name, std, delay, low_pass in seen if "late" in tables else ():
        x = late(given.count, std, delay, low_pass)
        cells = [f"{100 * y:.0f}" for y in (*(np.abs(x[:, : len(TIMES)]) < 2).mean(axis=0), x[:, -2].mean())]
        tables["late"].append(f"| {name} | {std} | {' | '.join(cells)} | {1e3 * np.sqrt(np.mean(x[:, -1] ** 2)):.2f} |")
        print(tables["late"][-1], flush=True)
    if given.docs:
        text = DOCS.read_text(encoding="utf-8")
        for name, lines in tables.items():
            begin, end = f"<!-- {name}: written by bench/estimate/coverage.py -->\n", f"<!-- end of {name} -->"
            table = "\n".join([*lines, ""])
            text = re.sub(f"{begin}.*?{end}", lambda _, a=begin + table + end: a, text, flags=re.DOTALL)
        DOCS.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
