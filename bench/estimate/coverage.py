"""How often a payload lies within two standard deviations of the Kalman filter's estimate.

    python bench/estimate/coverage.py [--count 100]

Payloads are drawn from what the filter is told of them (positive ones), starts and noises likewise; truth and filter
take the same steps. Prints the table of docs/online.md, and the rms of errors over standard deviations.
"""

from __future__ import annotations

import argparse
import warnings

import flexarm as fa
import numpy as np
from online import STEP, two_links

FORCES = np.array([0.02, 1e-3, 1e-3] * 2)  # N m/sqrt(Hz)
NOISE = [1e-4, 1e-4, 2e-6, 2e-6]
SENSORS = [fa.Encoder(k, pulses=None, noise=1e-4) for k in (0, 1)] + [
    fa.StrainGauge(k, 0.01, "+y", noise=2e-6) for k in (0, 1)
]
TIMES = (50, 200, 500, 1000)  # steps


def errors(count: int, told: tuple[float, float], soft: bool) -> np.ndarray:
    """Errors over standard deviations, (count, times)."""
    rng, model = np.random.default_rng(1), two_links()
    n, steps = model.nv, TIMES[-1]
    t = np.arange(steps + 1) * STEP
    known = np.zeros((steps + 1, n))
    known[:, 0] = 1.5 * (np.sin(3 * t) if soft else np.cos(6 * t))
    known[:, 3] = 0.4 * (np.sin(5 * t) if soft else np.cos(9 * t))
    filter = fa.KalmanFilter(model, SENSORS, STEP, force_noise=FORCES, q_std=0.01, v_std=0.01,
                             estimate={"payload": told})  # fmt: skip
    out = []
    while len(out) < count:
        payload = told[0] + told[1] * rng.normal()
        if payload <= 0.02:
            continue
        forces = known[:-1] + rng.normal(size=(steps, n)) * FORCES / np.sqrt(STEP)
        q0, v0 = 0.01 * rng.normal(size=n), 0.01 * rng.normal(size=n)
        arm = two_links(payload)
        run = fa.rollout(arm, q0[None], v0[None], forces[None], step=STEP, every=1)
        y = np.column_stack([s.measure(arm, t, run.q[0], run.v[0]) for s in SENSORS])
        filter.reset()
        found = filter.run(t, known, y + rng.normal(size=y.shape) * NOISE)
        z = (found.parameters["payload"] - payload) / np.maximum(found.parameter_std["payload"], 1e-12)
        out.append(z[list(TIMES)])
    return np.array(out)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=100)
    count = parser.parse_args().count
    warnings.simplefilter("ignore", fa.FilterWarning)
    for told, soft in (((0.3, 0.05), False), ((0.3, 0.3), False), ((0.1, 0.4), False), ((0.1, 0.4), True)):
        z = errors(count, told, soft)
        inside, rms = 100 * (np.abs(z) < 2).mean(axis=0), np.sqrt((z**2).mean(axis=0))
        name = f"{told[0]} ± {told[1]}{', a soft motion' if soft else ''}"
        print(f"| {name} | " + " | ".join(f"{x:.0f}" for x in inside) + " |  rms " + " ".join(f"{x:.2f}" for x in rms))


if __name__ == "__main__":
    main()
