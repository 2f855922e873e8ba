"""A Kalman filter on a tree: the payload in one hand, told from encoders of both arms."""

from __future__ import annotations

from dataclasses import replace

import flexarm as fa
import numpy as np
from arms import two_arms

STEP = 1e-3


def recorded() -> tuple[fa.Arm, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Two arms with 0.15 kg in the right hand: the loaded arm, times, forces, coordinates, noisy encoders."""
    arm = two_arms()
    loaded = fa.Arm([*arm.links[:-1], replace(arm.links[-1], tip=fa.RigidBody(0.15))])
    t = np.arange(601) * STEP
    tau = np.zeros((len(t), arm.nv))
    for k, size, w in (("left shoulder", 0.3, 5.0), ("right shoulder", 0.5, 8.0), ("right elbow", 0.3, 11.0)):
        tau[:, arm.joint_rate(k)] = size * np.sin(w * t)
    q = fa.rollout(loaded, arm.zero[None], None, tau[None, :-1], step=STEP).q[0]
    readings = np.stack([q[:, arm.coordinate_of(arm.joint_rate(k))] for k in arm.joint_names], axis=1)
    return loaded, t, tau, q, readings + 1e-4 * np.random.default_rng(0).normal(size=readings.shape)


def filter_of(arm: fa.Arm, **more: object) -> fa.KalmanFilter:
    sensors = [fa.sensors.Encoder(k, pulses=None, noise=1e-4) for k in arm.joint_names]
    return fa.KalmanFilter(arm, sensors, STEP, force_noise=1e-3, q_std=1e-3, v_std=1e-3, **more)


def test_the_hands_of_a_known_arm() -> None:
    loaded, t, tau, q, readings = recorded()
    kalman = filter_of(loaded)
    found = kalman.run(t, tau, readings)
    assert np.abs(found.q - q).max() < 2e-3
    for link in ("left fore", "right fore"):
        assert np.abs(kalman.tip(link)[0] - loaded.frame(q[-1], link)[0]).max() < 2e-4
    assert np.abs(found.tip[-1] - loaded.frame(q[-1])[0]).max() < 2e-4


def test_the_payload_in_the_right_hand() -> None:
    _, t, tau, q, readings = recorded()
    kalman = filter_of(two_arms(), estimate={"payload": (0.05, 0.1)})
    found = kalman.run(t, tau, readings)
    assert abs(found.parameters["payload"][-1] - 0.15) < 0.01 and np.abs(found.q - q).max() < 2e-3
