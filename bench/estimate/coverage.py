"""How often a payload lies within two standard deviations of the Kalman filter's estimate.

    python bench/estimate/coverage.py [--count 100] [--step 0.001] [--docs]

Payloads are drawn from what the filter is told of them (positive ones), starts and noises likewise. Readings come at
1 kHz; the arm that is read moves by finer steps than the filter's. Prints the tables of docs/online.md (with --docs
puts them there): how often the payload is within two standard deviations, and the rms of errors over these; and how
often the turn of a ball lies in the region of 95 %.
"""

from __future__ import annotations

import argparse
import re
import warnings
from pathlib import Path

import flexarm as fa
import numpy as np
from online import STEP, two_links
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--step", type=float, default=STEP)
    parser.add_argument("--docs", action="store_true", help="write the tables into docs/online.md")
    given = parser.parse_args()
    warnings.simplefilter("ignore", fa.errors.FilterWarning)
    tables = {
        "payload": ["| payload told (kg) | within two deviations after 0.05 s (%) | 0.2 s | 0.5 s | 1 s "
                    "| rms after 0.05 s | 0.2 s | 0.5 s | 1 s |", "|-|-|-|-|-|-|-|-|-|"],
        "ball": ["| standard deviation of the start (rad, each axis) | after 0.05 s (%) | 0.2 s | 0.5 s | 1 s |",
                 "|-|-|-|-|-|"],
    }  # fmt: skip
    for told, soft in (((0.3, 0.05), False), ((0.3, 0.3), False), ((0.1, 0.4), False), ((0.1, 0.4), True)):
        z = errors(given.count, told, soft, given.step)
        inside, rms = 100 * (np.abs(z) < 2).mean(axis=0), np.sqrt((z**2).mean(axis=0))
        cells = [f"{x:.0f}" for x in inside] + [f"{x:.2f}" for x in rms]
        name = f"{told[0]} ± {told[1]}{', a soft motion' if soft else ''}"
        tables["payload"].append(f"| {name} | {' | '.join(cells)} |")
        print(tables["payload"][-1], flush=True)
    for std in (0.02, 0.05, 0.1, 0.2, 0.4):
        inside = 100 * ball(given.count, std).mean(axis=0)
        tables["ball"].append(f"| {std} | {' | '.join(f'{x:.0f}' for x in inside)} |")
        print(tables["ball"][-1], flush=True)
    if given.docs:
        text = DOCS.read_text(encoding="utf-8")
        for name, lines in tables.items():
            begin, end = f"<!-- {name}: written by bench/estimate/coverage.py -->\n", f"<!-- end of {name} -->"
            table = "\n".join([*lines, ""])
            text = re.sub(f"{begin}.*?{end}", lambda _, a=begin + table + end: a, text, flags=re.DOTALL)
        DOCS.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
