"""The Kalman filter where it knows what acts, and on arms with balls: against runs of IDA, and its own statistics."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from messages import refuses

STEEL = fa.Material(7850, 209e9, 0.3)
STEP = 2e-4
T = np.arange(1001) * STEP


def link(joint: Any, tip: float, **bodies: Any) -> fa.Link:
    body = fa.Beam(0.4, fa.Rectangle(0.004, 0.02), STEEL, {"bending_y": 2}, "legendre", 2, damping_ratio=0.02)
    return fa.Link(joint, fa.RigidBody(0.3, (0.02, 0, 0), 0.01 * np.eye(3)), body, fa.RigidBody(tip, **bodies))


def two_links() -> fa.Arm:
    return fa.Arm([link(fa.Revolute("z", damping=0.02), 0.3), link(fa.Revolute("z"), 0.05)])


def pid(**more: Any) -> fa.LinearController:
    return fa.LinearController.pid(kp=3.0, ki=20.0, kd=0.1, link=1, reference=(T, 0.4 * T / T[-1]), **more)


KNOWN: dict[str, dict[str, Any]] = {
    "drives": {"drive": {0: fa.Torque(lambda t: 0.8 * float(np.sin(40 * t))), 1: fa.Torque(T, np.sin(30 * T))}},
    "motion": {"drive": {1: fa.Motion(T, 5 * T**2, 10 * T, np.full(T.size, 10.0))}},
    "loads": {"loads": [fa.Load(force=np.outer(T, [5, 20, 0]), t=T), fa.Load(0, force=(-2, 3, 0), axes="section")]},
    "laws": {"control": [fa.PD(5.0, 0.2, 0, reference=0.3, limit=1.2), pid(filter_time=2e-3)]},
}


@pytest.mark.parametrize("name", KNOWN)
def test_it_follows_a_run_by_what_it_knows(name: str) -> None:
    arm, known = two_links(), KNOWN[name]
    run = fa.simulate(arm, T, rtol=1e-8, **known)
    sensors = [fa.sensors.Encoder(0, noise=1.0), fa.sensors.Encoder(1, noise=1.0)]  # hardly believed
    readings = [s.read(run) for s in sensors]

    def off(**more: Any) -> float:
        kalman = fa.KalmanFilter(arm, sensors, STEP, force_noise=1e-9, q_std=1e-9, v_std=1e-9, q=run.q[0], v=run.v[0],
                                 **more)  # fmt: skip
        found = kalman.run(T, None, readings)
        assert kalman.t == pytest.approx(T[-1])
        assert found.q.shape == run.q.shape and kalman.covariance.shape == (12, 12)
        return float(np.abs(found.q - run.q).max() / np.abs(run.q - run.q[0]).max())

    assert off(**known) < 1e-3
    assert off() > 0.1


def spun() -> tuple[fa.Arm, fa.Result]:
    """A body and a beam on a ball, on a free base."""
    base = fa.Link(fa.Free(), fa.RigidBody(0.5, inertia=0.01 * np.eye(3), end=(0.1, 0, 0)))
    arm = fa.Arm([base, link(fa.Spherical(damping=0.01), 0.2, inertia=1e-4 * np.eye(3))])
    v0 = np.r_[0.2, 0.1, 0.3, 1.0, 2.0, -1.0, 2.0, -3.0, 1.0, 0.0, 0.0]
    t = np.arange(1001) * 1e-3
    return arm, fa.simulate(arm, t, None, v0, loads=[fa.Load(force=(0, 0.3, 0.2))], rtol=1e-9, atol=1e-11)


def test_balls_are_estimated_and_the_filter_knows_how_well() -> None:
    arm, run = spun()
    sensors = [*(fa.sensors.Camera(k, x=x, noise=1e-3) for k, x in ((0, None), (1, None), (1, 0.2))),
               fa.sensors.StrainGauge(1, x=0.05, noise=1e-5)]  # fmt: skip
    sensors += [
        fa.sensors.Tachometer(k, f, noise=0.02) for k, first in ((0, 3), (1, 0)) for f in range(first, first + 3)
    ]
    inside, nis, used = [], 0.0, 0
    for seed in range(4):
        rng = np.random.default_rng(seed)
        std = np.r_[np.full(3, 0.01), np.full(6, 0.05), 1e-6, 1e-6]
        off = std * rng.normal(size=11)
        q = np.array(run.q[0])
        q[:3] += off[:3]
        for at, turn in ((3, off[3:6]), (7, off[6:9])):
            half = np.linalg.norm(turn) / 2
            q[at : at + 4] = np.r_[np.cos(half), np.sinc(half / np.pi) * turn / 2]
        v_std = np.r_[np.full(9, 0.1), 1e-4, 1e-4]
        v = run.v[0] + v_std * rng.normal(size=11)
        load = fa.Load(force=(0, 0.3, 0.2))
        kalman = fa.KalmanFilter(arm, sensors, 1e-3, force_noise=1e-5, q_std=std, v_std=v_std, q=q, v=v, loads=[load])
        found = kalman.run(run.t, None, [replace(s, seed=10 * seed + k).read(run) for k, s in enumerate(sensors)])
        nis, used = nis + found.nis.sum(), used + found.used.sum()
        quaternions = found.q[:, 3:11].reshape(-1, 2, 4)
        assert np.abs(np.linalg.norm(quaternions, axis=2) - 1).max() < 1e-12
        cosine = np.abs(np.einsum("nij,nij->ni", quaternions, run.q[:, 3:11].reshape(-1, 2, 4)))
        turned = 2 * np.arccos(np.clip(cosine, 0, 1))
        believed = np.linalg.norm(found.q_std[:, 3:9].reshape(-1, 2, 3), axis=2)
        assert turned[0].max() > 0.02 and (turned[[200, 500, -1]] < 3 * believed[[200, 500, -1]]).all()
        inside.append(np.abs(found.v[-1] - run.v[-1]) / found.v_std[-1])
        assert np.abs(found.tip[-1] - run.frame()[0][-1]).max() < 2e-3
    assert nis / used == pytest.approx(1.0, abs=5 * np.sqrt(2 / used))
    assert np.mean(np.array(inside) < 2) > 0.85


def test_what_it_cannot_know_is_named() -> None:
    arm, sensors = two_links(), [fa.sensors.Encoder(0, noise=1e-3)]
    good: dict[str, Any] = {"force_noise": 1e-3, "q_std": 1e-3, "v_std": 1e-3}
    for more, told in (
        ({"control": pid(rate=500.0)}, ("control", "samples")),
        ({"control": fa.FeedForward({0: fa.Motion([0, 1], [0, 1])})}, "times of a run"),
        ({"drive": {0: 3.0}}, ("Motion", "Torque")),
        ({"loads": [3]}, "loads[0] = 3"),
        ({"drive": {0: fa.Torque(T, T)}, "t": 5.0}, ("t = 0", "samples")),
    ):  # fmt: skip
        with refuses(told):
            fa.KalmanFilter(arm, sensors, STEP, **good, **more)
    kalman = fa.KalmanFilter(arm, sensors, STEP, **good, **KNOWN["drives"])
    with refuses("t[0] = 0.1", "0 s"):
        kalman.run(T[500:], None, np.zeros((501, 1)))


def test_copies_know_the_same() -> None:
    arm = two_links()
    kalman = fa.KalmanFilter(arm, [fa.sensors.Encoder(0, noise=1e-3)], STEP, force_noise=1e-3, q_std=1e-3, v_std=1e-3,
                             **KNOWN["loads"], control=KNOWN["laws"]["control"])  # fmt: skip
    kalman.predict()
    kalman.update([0.01])
    other = copy.deepcopy(kalman)
    for one in (kalman, other):
        one.predict(np.full(6, 0.01))
    assert other.t == kalman.t == pytest.approx(2 * STEP)
    assert (other.q == kalman.q).all() and (other.covariance == kalman.covariance).all()
