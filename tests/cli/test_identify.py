"""bench/cli/identify.py recovers known values from synthetic data, and says what four marks do not determine."""

from __future__ import annotations

import sys
from pathlib import Path

import flexarm as fa
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "bench" / "cli"))
import identify

KNOWN = np.array([0.05, 150.0, 1.5, 0.8, 0.4])  # inertia, gain, viscous, dry, step
OFF = np.array([1.2, 0.85, 1.25, 0.8, 1.05])


def test_a_recording_gives_all_five_back() -> None:
    """Joint and gauge over 0.6 s, with noise: every value to a few standard deviations, from a start up to 25 % off."""
    noise = (2e-5, 5e-6)
    clean = identify.traces(KNOWN, 0.6)
    rng = np.random.default_rng(5)
    record = clean + np.repeat(noise, clean.size // 2) * rng.normal(size=clean.size)
    fit = identify.fit_traces(record, noise, KNOWN * OFF, 0.6)
    found = np.array([fit.values[path] for path in identify.PATHS[:5]])
    np.testing.assert_allclose(found, KNOWN, rtol=2e-3)
    assert np.abs(found / KNOWN - 1).max() > 1e-9  # the noise was there


def test_marks_give_four_back_when_the_inertia_is_given() -> None:
    goal = identify.told(KNOWN)
    found, miss = identify.fit_marks(KNOWN[0], KNOWN[1:] * [0.97, 1.03, 0.97, 1.02], goal, most=4)
    assert miss < 0.05
    np.testing.assert_allclose(found, KNOWN, rtol=0.02)


def test_slopes_are_those_of_differences() -> None:
    """With strain feedback, through dry friction: of all marks by all six, to a percent of a mark's largest."""
    torque, h = 0.35, 1e-4

    def told(logs: np.ndarray) -> np.ndarray:
        x = np.exp(logs)
        return identify.told(x[:5], torque=x[5])

    at = np.log([*KNOWN, torque])
    differences = np.array([(told(at + h * e) - told(at - h * e)) / (2 * h) for e in np.eye(6)]).T
    off = identify.slopes(KNOWN, torque, step=0.0005) - differences
    assert (np.abs(off).max(axis=1) < [*3 * [0.01], 0.05] * np.abs(differences).max(axis=1)).all()


def test_the_scene_is_what_was_identified() -> None:
    scene = fa.load("ist_control")
    joint, pd = scene.arm.links[0].joint, scene.control[0]
    step = float(pd.reference(0.0))
    p = np.array([joint.reflected_inertia, pd.motor.torque_constant, joint.damping, joint.coulomb, step])
    assert (np.abs(identify.told(p) - identify.TOLD) < identify.ROUNDING).all()
    J = identify.slopes(p)[:, :5] / identify.ROUNDING[:, None]
    free = np.linalg.svd(J)[2][-1]  # what the four marks leave open, in logarithms of the five
    assert np.abs(free[3:]).max() < 0.1 < np.abs(free[:3]).min()  # dry friction and step are told, the others trade
