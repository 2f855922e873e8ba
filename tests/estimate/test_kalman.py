"""The Kalman filter against an independent one, against chi-square, and on arms whose payload and friction it finds."""

from __future__ import annotations

import copy
import pickle
import warnings
from dataclasses import replace
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from messages import refuses, warns
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

STEEL = fa.Material(7850, 209e9, 0.3)
STEP = 1e-3
GAUGES = [fa.sensors.StrainGauge(k, 0.01, "+y", noise=2e-6, resolution=1e-6) for k in (0, 1)]
SENSORS = [fa.sensors.Encoder(k, pulses=4096, quadrature=True) for k in (0, 1)] + GAUGES


def two_links(payload: float = 0.0, damping: Any = (0.0, 0.0), coulomb: Any = (0.0, 0.0)) -> fa.Arm:
    """In the horizontal plane."""

    def link(k: int, tip: fa.RigidBody) -> fa.Link:
        hub = fa.RigidBody(0.3, (0.02, 0, 0), (0.03, 0.01)[k] * np.eye(3), (0.05, 0, 0))
        beam = fa.Beam(0.4, fa.Rectangle(0.004, 0.02), STEEL, {"bending_y": 2}, "legendre", 2, damping_ratio=0.01)
        return fa.Link(fa.Revolute("z", damping=damping[k], coulomb=coulomb[k]), hub, beam, tip)

    elbow = fa.RigidBody(0.3, (0.02, 0, 0), 1e-4 * np.eye(3), (0.03, 0, 0))
    return fa.Arm([link(0, elbow), link(1, fa.RigidBody(0.05 + payload, inertia=1e-5 * np.eye(3)))])


def moved(arm: fa.Arm, seconds: float, soft: bool = False) -> tuple[fa.Result, np.ndarray]:
    """A run under a sampled PD controller, and the forces that it held from each time to the next."""
    t = np.arange(round(seconds / STEP) + 1) * STEP
    tau = np.zeros((t.size, arm.nv))
    first, n = arm.joint_rate(1), arm.nv

    def law(now: float, y: np.ndarray) -> np.ndarray:
        reference = np.array([0.6 * np.sin(4 * now), 0.8 * np.sin(6 * now)])
        if soft:
            reference = np.array([0.4, 0.6]) * (1 - np.cos(np.array([2.0, 3.0]) * now))
        u = np.array([12.0, 4.0]) * (reference - y[[0, first]]) - np.array([1.2, 0.3]) * y[[n, n + first]]
        tau[round(now / STEP), [0, first]] = u
        return np.asarray(u)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.errors.LoopWarning)
        control = fa.Sampled(law, 1 / STEP, actuate=(0, 1))
        run = fa.simulate(arm, t, control=control, integrator="implicit", step=STEP / 4)
    return run, tau


NOISE = np.array([0.02, 1e-3, 1e-3, 0.02, 1e-3, 1e-3])  # N m/sqrt(Hz); of elastic coordinates N m^2/sqrt(Hz)


def test_a_linear_arm_has_the_filter_of_textbooks() -> None:
    """A beam on a slide, of order 0: its equations are linear, and a step is a Runge-Kutta step of first-order ones."""
    beam = fa.Beam(0.5, fa.Rectangle(0.002, 0.02), STEEL, {"bending_y": 2}, "legendre", 0, damping_ratio=0.02)
    arm = fa.Arm([fa.Link(fa.Prismatic("y", damping=0.3), fa.RigidBody(0.5), beam, fa.RigidBody(0.1))])
    sensors = [fa.sensors.Encoder(0, pulses=None, noise=1e-4), fa.sensors.StrainGauge(0, 0.02, "-y", noise=1e-6)]
    n, rng, h = arm.nv, np.random.default_rng(3), 2e-3
    noise, q_std, v_std = np.array([0.1, 0.01, 0.01]), np.array([0.01, 0.1, 0.2]), np.array([0.1, 1.0, 0.5])
    filter = fa.KalmanFilter(arm, sensors, h, force_noise=noise, q_std=q_std, v_std=v_std, v=[0.1, 0, 0],
                             estimate={"offset.0": (0.2, 0.5)}, drift={"offset.0": 0.1})  # fmt: skip

    # linear model, with held forces as states: R(h F) = (1 - g h F)^-2 (1 + (1 - 2 g) h F); and with the offset as one
    M = arm.mass_matrix(arm.zero)
    _, C, K = arm.inverse_derivatives(arm.zero, np.zeros(n), np.zeros(n))[::-1]
    F = np.zeros((3 * n, 3 * n))
    F[:n, n : 2 * n] = np.eye(n)
    F[n : 2 * n] = np.linalg.solve(M, np.hstack([-K, -C, np.eye(n)]))
    W = np.eye(5) / 4
    W[1, 0], W[2, :2], W[3, :3] = 1 / 2, (17 / 50, -1 / 25), (371 / 1360, -137 / 2720, 15 / 544)
    W[4, :4] = 25 / 24, -49 / 48, 125 / 16, -85 / 12
    one = np.eye(3 * n)
    slopes = np.linalg.solve(np.eye(15 * n) - h * np.kron(W, F), np.vstack([F] * 5))
    R = one + h * np.kron(W[-1], one) @ slopes
    A, B = R[: 2 * n, : 2 * n], R[: 2 * n, 2 * n :]
    A = np.block([[A, B[:, :1]], [np.zeros((1, 2 * n)), np.eye(1)]])
    B = np.vstack([B, np.zeros((1, n))])
    Q = B @ np.diag(noise**2 / h) @ B.T
    Q[-1, -1] += 0.1**2 * h
    H = np.zeros((2, 2 * n + 1))
    H[0, 0] = 1.0
    H[1, :n] = 0.001 * np.array([arm.strain(q, 0, 0.02)[2] for q in np.eye(n)])  # -y: eps = + (thickness / 2) K3
    R = np.diag([1e-8, 1e-12])
    x = np.array([0, 0, 0, 0.1, 0, 0, 0.2])
    P = np.diag(np.concatenate([q_std, v_std, [0.5]]) ** 2)

    for k in range(60):
        y, tau = rng.normal(size=2) * [0.01, 1e-4], rng.normal(size=n) * [1, 0, 0]
        use = np.array([True, k % 3 != 1])  # dropouts
        S = H[use] @ P @ H[use].T + R[np.ix_(use, use)]
        innovation = (y - H @ x)[use]
        gain = np.linalg.solve(S, H[use] @ P).T
        x, P = x + gain @ innovation, P - gain @ S @ gain.T
        filter.update(np.where(use, y, np.nan))
        assert filter.used == use.sum()
        assert filter.nis == pytest.approx(innovation @ np.linalg.solve(S, innovation), rel=1e-7)
        x, P = A @ x + B @ tau, A @ P @ A.T + Q
        filter.predict(tau)
    scale = np.sqrt(np.diag(P))
    got = np.concatenate([filter.q, filter.v, list(filter.parameters.values())])
    np.testing.assert_allclose(got, x, rtol=0, atol=1e-8 * np.abs(x).max())
    np.testing.assert_allclose(filter.covariance / np.outer(scale, scale), P / np.outer(scale, scale), atol=1e-7)
    assert filter.parameter_std["offset.0"] == pytest.approx(scale[-1]) and scale[-1] < 0.4


def test_errors_are_what_the_filter_believes() -> None:
    """Normalised squared errors of states and readings of 25 runs with payloads, starts and noise drawn at random:
    within the 0.1 and 99.9 % bounds of chi-square."""
    rng, steps, runs = np.random.default_rng(11), 150, 25
    model = two_links()
    n = model.nv
    q_std, v_std = np.array([0.05, 0.02, 0.02] * 2), np.array([0.1, 0.1, 0.1] * 2)
    sensors = [fa.sensors.Encoder(k, pulses=None, noise=1e-4) for k in (0, 1)] + [
        fa.sensors.StrainGauge(k, 0.01, "+y", noise=2e-6) for k in (0, 1)
    ]
    filter = fa.KalmanFilter(model, sensors, STEP, force_noise=NOISE, q_std=q_std, v_std=v_std,
                             estimate={"payload": (0.3, 0.05)})  # fmt: skip
    t = np.arange(steps + 1) * STEP
    known = np.zeros((steps + 1, n))
    known[:, 0], known[:, 3] = 3 * np.sin(40 * t), np.cos(30 * t)
    nees, nis, used = [], 0.0, 0
    for _ in range(runs):
        payload = 0.3 + 0.05 * rng.normal()
        arm = two_links(payload)
        forces = known[:-1] + rng.normal(size=(steps, n)) * NOISE / np.sqrt(STEP)
        q0, v0 = q_std * rng.normal(size=n), v_std * rng.normal(size=n)
        run = fa.rollout(arm, q0[None], v0[None], forces[None], step=STEP, every=1)
        y = np.column_stack([s.measure(arm, t, run.q[0], run.v[0]) for s in sensors])
        y += rng.normal(size=y.shape) * [1e-4, 1e-4, 2e-6, 2e-6]
        filter.reset()
        estimate = filter.run(t, known, y)
        error = np.concatenate([run.q[0, -1], run.v[0, -1], [payload]])
        error -= np.concatenate([filter.q, filter.v, [filter.parameters["payload"]]])
        nees.append(error @ np.linalg.solve(filter.covariance, error))
        nis, used = nis + estimate.nis.sum(), used + estimate.used.sum()
    count = runs * (2 * n + 1)
    assert used == runs * (steps + 1) * 4
    assert chi2.ppf(0.001, count) < sum(nees) < chi2.ppf(0.999, count)
    assert chi2.ppf(0.001, used) < nis < chi2.ppf(0.999, used)


@pytest.mark.parametrize("start, spread", [(0.3, 0.3), (0.1, 0.4)])
def test_a_poorly_known_payload_has_honest_intervals(start: float, spread: float) -> None:
    """24 payloads drawn from what the filter is told of them: the error after 0.2 s over the standard deviation. (What
    the product of two errors does, that of the payload and that of an acceleration, is most of it at first.) The arm
    that is read moves by four fine steps to one of the filter, which is half of the fastest mode's 1 / omega."""
    rng, h, steps, model = np.random.default_rng(5), STEP / 2, 400, two_links()
    n = model.nv
    noises = [1e-4, 1e-4, 2e-6, 2e-6]
    sensors = [fa.sensors.Encoder(k, pulses=None, noise=1e-4) for k in (0, 1)] + [
        fa.sensors.StrainGauge(k, 0.01, "+y", noise=2e-6) for k in (0, 1)
    ]
    filter = fa.KalmanFilter(model, sensors, h, force_noise=NOISE, q_std=0.01, v_std=0.01,
                             estimate={"payload": (start, spread)})  # fmt: skip
    t = np.arange(steps + 1) * h
    known = np.zeros((steps + 1, n))
    known[:, 0], known[:, 3] = 1.5 * np.cos(6 * t), 0.4 * np.cos(9 * t)
    errors: list[float] = []
    while len(errors) < 24:
        payload = start + spread * rng.normal()
        if payload < 0.02:
            continue
        forces = known[:-1] + rng.normal(size=(steps, n)) * NOISE / np.sqrt(h)
        q0, v0 = 0.01 * rng.normal(size=(2, n))
        arm = two_links(payload)
        run = fa.rollout(arm, q0[None], v0[None], np.repeat(forces, 4, axis=0)[None], step=h / 4, every=4)
        y = np.column_stack([s.measure(arm, t, run.q[0], run.v[0]) for s in sensors])
        filter.reset()
        filter.run(t, known, y + rng.normal(size=y.shape) * noises)
        errors.append((filter.parameters["payload"] - payload) / max(filter.parameter_std["payload"], 1e-9))
    assert np.mean(np.square(errors)) < 3.0  # 1 of normal errors; 250 and 1400 without those products
    assert (np.abs(errors) < 2).mean() > 0.85


@pytest.mark.parametrize("payload, wrong", [(0.05, 3), (0.15, 1 / 3), (0.5, 0.4), (0.5, 2)])
def test_payload_within_5_percent_in_2_seconds(payload: float, wrong: float) -> None:
    run, tau = moved(two_links(payload, damping=(0.05, 0.02)), 2.0)
    unknown = {"payload": (wrong * payload, 2 * payload), "damping.0": (0.1, 0.1), "damping.1": (0.05, 0.05)}
    filter = fa.KalmanFilter(two_links(), SENSORS, STEP, force_noise=NOISE, q_std=0.01, v_std=0.01, estimate=unknown)
    estimate = filter.run(run.t, tau, [s.read(run) for s in SENSORS])
    found = estimate.parameters["payload"]
    assert abs(found[0] / payload - 1) > 0.5
    assert np.abs(found[1000:] / payload - 1).max() < 0.02
    assert abs(filter.parameters["damping.0"] - 0.05) < 0.01
    tip = run.frame()[0]
    assert np.abs(estimate.tip - tip)[1000:].max() < 5e-4 < 0.1 * np.ptp(tip, axis=0).max()
    place, covariance = filter.tip()
    np.testing.assert_allclose(place, estimate.tip[-1])
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), estimate.tip_std[-1])
    assert "payload" in repr(estimate) and estimate.plot().axes


def test_a_payload_is_not_lost_in_noise() -> None:
    """A motion that begins softly: without the products of errors the filter takes noise for motion, and believes in no
    payload."""
    run, tau = moved(two_links(0.3), 2.0, soft=True)
    filter = fa.KalmanFilter(two_links(), SENSORS, STEP, force_noise=NOISE, q_std=0.01, v_std=0.01,
                             estimate={"payload": (0.1, 0.6)})  # fmt: skip
    found = filter.run(run.t, tau, [s.read(run) for s in SENSORS])
    payload, std = found.parameters["payload"], found.parameter_std["payload"]
    assert abs(payload[-1] / 0.3 - 1) < 0.02
    assert (np.abs(payload - 0.3) < 3 * std).mean() > 0.95


def test_friction_of_joints_that_stick_and_slide() -> None:
    """The arm has dry friction in its equations; the filter smooths it."""
    run, tau = moved(two_links(0.15, (0.05, 0.02), (0.1, 0.03)), 4.0)
    unknown = {"payload": (0.05, 0.2), "damping.0": (0.1, 0.1), "damping.1": (0.05, 0.05),
               "coulomb.0": (0.03, 0.1), "coulomb.1": (0.1, 0.1)}  # fmt: skip
    filter = fa.KalmanFilter(two_links(), SENSORS, STEP, force_noise=0.2 * NOISE, q_std=0.01, v_std=0.01,
                             estimate=unknown)  # fmt: skip
    filter.run(run.t, tau, [s.read(run) for s in SENSORS])
    right = {"payload": 0.15, "damping.0": 0.05, "damping.1": 0.02, "coulomb.0": 0.1, "coulomb.1": 0.03}
    for name, value in right.items():
        assert abs(filter.parameters[name] / value - 1) < 0.05, name
        assert abs(filter.parameters[name] - value) < 3 * filter.parameter_std[name], name
    # an arm with that friction of its own has nothing left to find, and is warned of once
    with warns(fa.errors.ModelWarning, "'link 0 revolute'", "'link 1 revolute'") as said:
        knows = fa.KalmanFilter(run.arm, SENSORS, STEP, force_noise=0.2 * NOISE, q_std=0.01, v_std=0.01,
                                estimate={"coulomb.0": (0.0, 0.05), "gain.0": (0.0, 0.1)})  # fmt: skip
    assert len(said) == 1
    knows.run(run.t, tau, [s.read(run) for s in SENSORS])
    assert abs(knows.parameters["coulomb.0"]) < 0.005 and abs(knows.parameters["gain.0"]) < 0.005


def test_filtered_gauges_and_slow_ones() -> None:
    """A gauge behind a low pass, sampled at 100 Hz: its lag is in the model, not in the estimate."""
    run, tau = moved(two_links(), 1.0)
    slow = fa.sensors.StrainGauge(
        1, 0.01, "+y", noise=2e-7, rate=100, filter=fa.sensors.LowPass(5, order=2, damping_ratio=0.9)
    )
    sensors = [fa.sensors.Encoder(0), fa.sensors.Encoder(1), slow]
    filter = fa.KalmanFilter(two_links(), sensors, STEP, force_noise=0.0, q_std=0.0, v_std=0.0)
    estimate = filter.run(run.t, tau, [s.read(run) for s in sensors])
    assert estimate.used[::10].min() == 3 and estimate.used[1:10].max() == 2
    gauge = estimate.innovations[::10, 2]
    assert np.abs(gauge).max() < 1.5e-6
    assert (
        np.abs(slow.read(run).y[:, 0] - fa.sensors.StrainGauge(1, 0.01, "+y", rate=100).read(run).y[:, 0]).max() > 2e-5
    )
    np.testing.assert_allclose(filter.q, run.q[-1], atol=2e-4)


def test_delays_are_in_the_model() -> None:
    """Of encoders, of a gauge behind a filter, of cameras with both: readings are predicted to what straight lines
    between steps leave, where a filter that does not know of the delays misses them by a hundred times that."""
    run, tau = moved(two_links(), 0.5)
    plain = [
        fa.sensors.Encoder(0, pulses=None, noise=1e-5),
        fa.sensors.Encoder(1, pulses=None, noise=1e-5),
        fa.sensors.StrainGauge(1, 0.01, "+y", noise=1e-6, filter=20.0),
        fa.sensors.Camera(noise=1e-5),
        fa.sensors.Camera(0, noise=1e-5, filter=20.0),
    ]
    late = [replace(s, delay=d) for s, d in zip(plain, (0.0, 5e-3, 2.4e-3, 20e-3, 3.5e-3), strict=True)]
    readings = [s.read(run) for s in late]
    given = {"force_noise": 0.0, "q_std": 0.0, "v_std": 0.0}
    knows = fa.KalmanFilter(two_links(), late, STEP, **given).run(run.t, tau, readings)
    told = np.abs(knows.innovations) / [1e-5, 1e-5, 1e-6, *[1e-5] * 6]
    assert told.max() < 6
    assert 0.8 < knows.consistency < 1.3
    with warns(fa.errors.FilterWarning, "predictions"):
        ignores = fa.KalmanFilter(two_links(), plain, STEP, **given).run(run.t, tau, readings)
    assert (np.abs(ignores.innovations[:, [1, 3]]).max(axis=0) > 100e-5).all()
    np.testing.assert_allclose(knows.tip[-1], run.frame()[0][-1], atol=1e-5)


def test_the_turn_of_a_ball_is_found_from_afar() -> None:
    """Started 0.4 rad off in each axis, beside cameras: the true turn lies where it should."""
    arm = fa.Arm([
        fa.Link(fa.Spherical(damping=0.01), fa.RigidBody(0.5, (0.2, 0, 0), np.diag([2e-3, 8e-3, 8e-3]), (0.4, 0, 0))),
        fa.Link(fa.Fixed(), fa.RigidBody(0.02, end=(-0.2, 0.1, 0))),
    ])  # fmt: skip
    t, v0, rng = np.arange(51) * STEP, np.array([1.0, 2.0, -1.0]), np.random.default_rng(2)
    run = fa.simulate(arm, t, None, v0)
    cameras = [fa.sensors.Camera(k, noise=1e-3) for k in (0, 1)]
    exact = np.column_stack([s.measure(arm, t, run.q, run.v) for s in cameras])
    far = []
    for _ in range(12):
        off = Rotation.from_quat(np.roll(run.q[0], -1)) * Rotation.from_rotvec(0.4 * rng.normal(size=3))
        filter = fa.KalmanFilter(arm, cameras, STEP, force_noise=1e-4, q_std=0.4, v_std=0.1,
                                 q=np.roll(off.as_quat(), 1), v=v0 + 0.1 * rng.normal(size=3))  # fmt: skip
        found = filter.run(t, None, exact + 1e-3 * rng.normal(size=exact.shape))
        between = Rotation.from_quat(np.roll(filter.q, -1)).inv() * Rotation.from_quat(np.roll(run.q[-1], -1))
        error = between.as_rotvec()
        far.append(error @ np.linalg.solve(filter.covariance[:3, :3], error))
        assert found.consistency < 1.5
    assert np.mean(far) < 6  # of chi-square with 3 degrees of freedom; without the repetition above 100


def test_a_filter_that_believes_a_wrong_model_says_so() -> None:
    run, tau = moved(two_links(0.3), 0.5)
    y = [s.read(run) for s in SENSORS]
    wrong = fa.KalmanFilter(two_links(), SENSORS, STEP, force_noise=0.01 * NOISE, q_std=0.01, v_std=0.01)
    with warns(fa.errors.FilterWarning, "predictions"):
        assert wrong.run(run.t, tau, y).consistency > 2
    right = fa.KalmanFilter(two_links(0.3), SENSORS, STEP, force_noise=0.01 * NOISE, q_std=0.01, v_std=0.01)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert 0.2 < right.run(run.t, tau, y).consistency < 1.3
    # an arm that hangs at rest in the horizontal plane does not tell what it carries
    rest = fa.KalmanFilter(two_links(), SENSORS, STEP, force_noise=NOISE, q_std=0.01, v_std=0.0,
                           estimate={"payload": (0.1, 0.1)})  # fmt: skip
    with warns(fa.errors.FilterWarning, "payload", "readings", "nothing"):
        rest.run(run.t, np.zeros_like(tau), np.zeros((run.t.size, 4)))


def test_readings_at_the_end_of_a_range_and_dropouts_are_left_out() -> None:
    sensors = [fa.sensors.Encoder(0), fa.sensors.StrainGauge(0, 0.01, noise=1e-6, range=1e-4)]
    filter = fa.KalmanFilter(two_links(), sensors, STEP, force_noise=NOISE, q_std=0.01, v_std=0.01)
    for y, used in (([0.0, 9e-5], 2), ([0.0, 1e-4], 1), ([0.0, -2e-4], 1), ([np.nan, np.inf], 0)):
        filter.reset()
        filter.update(y)
        assert filter.used == used
        assert np.isfinite(filter.innovation).sum() == used and np.isfinite(filter.q).all()
    assert np.all(filter.q == 0) and filter.nis == 0
    camera = fa.KalmanFilter(
        two_links(), [fa.sensors.Camera(noise=1e-3)], STEP, force_noise=NOISE, q_std=0.01, v_std=0.01
    )
    before = camera.tip()[1]
    camera.update(camera.tip()[0] + [0, 1e-3, 0])
    assert camera.tip()[1][1, 1] < 0.1 * before[1, 1] and len(camera.labels) == 3


@pytest.mark.parametrize(
    "sensors",
    [
        [fa.sensors.Encoder(0, pulses=None, noise=1e-3, gain=2.0, offset=0.1), *SENSORS[1:]],
        [
            *SENSORS[:2],
            fa.sensors.StrainGauge(0, 0.01, noise=1e-3, gain=1e3, offset=0.02, filter=50.0, range=9.0),
            GAUGES[1],
        ],
        [*SENSORS, fa.sensors.Camera(noise=1e-4, gain=[1.1, 0.9, 1.0], offset=[0.1, -0.1, 0.05])],
        [*SENSORS, fa.sensors.Tachometer(1, noise=1e-3, gain=9.55, offset=-0.5)],
    ],
    ids=["encoder", "gauge behind a filter", "camera", "tachometer"],
)
def test_gain_and_offset_of_sensors_are_used(sensors: list[fa.sensors.Sensor]) -> None:
    """A sensor that reads gain times what is there plus offset, in whatever unit, tells as much as one that reads it
    straight, with its noise over the gain: the same estimate, to rounding."""
    run, tau = moved(two_links(0.2), 0.2)
    plain = []
    for s in sensors:
        gain, noise = np.asarray(s.gain), None if s.noise is None else s.noise / np.asarray(s.gain)
        plain.append(replace(s, gain=1.0, offset=0.0, range=None, noise=noise.tolist() if np.ndim(noise) else noise)
                     if np.any(gain != 1.0) else s)  # fmt: skip
    found = []
    for kind in (sensors, plain):
        filter = fa.KalmanFilter(two_links(), kind, STEP, force_noise=NOISE, q_std=0.01, v_std=0.01,
                                 estimate={"payload": (0.1, 0.2)})  # fmt: skip
        found.append(filter.run(run.t, tau, [s.read(run) for s in kind]))
    np.testing.assert_allclose(found[0].q, found[1].q, atol=1e-9)
    np.testing.assert_allclose(found[0].q_std, found[1].q_std, rtol=1e-6)
    np.testing.assert_allclose(found[0].nis, found[1].nis, rtol=1e-5, atol=1e-7)
    assert found[0].parameters["payload"][-1] == pytest.approx(0.2, abs=0.02)


def test_a_sensor_that_is_not_linear_is_refused() -> None:
    """Nothing of it would be seen in derivatives at rest."""

    class Squared(fa.sensors.Encoder):
        def _measure(self, arm: fa.Arm, t: Any, q: Any, v: Any, a: Any, loads: Any) -> Any:
            return np.asarray(super()._measure(arm, t, q, v, a, loads) ** 2)

    with refuses("sensors[0]: Squared", "linear"):
        fa.KalmanFilter(two_links(), [Squared(0, noise=1.0)], STEP, force_noise=NOISE, q_std=0.01, v_std=0.01)


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))])
def test_a_copy_goes_on_as_the_filter_itself(copied: Any) -> None:
    run, tau = moved(two_links(0.2), 0.1)
    sensors = [*SENSORS[:3], replace(GAUGES[1], filter=50.0)]
    filter = fa.KalmanFilter(two_links(), sensors, STEP, force_noise=NOISE, q_std=0.01, v_std=0.01,
                             estimate={"payload": (0.1, 0.2)}, drift={"payload": 0.01})  # fmt: skip
    y = np.hstack([s.read(run).y for s in sensors])
    filter.run(run.t[:50], tau[:50], y[:50])
    other = copied(filter)
    for name in ("q", "v", "covariance", "innovation", "innovation_std", "parameters", "consistency", "nis", "used"):
        np.testing.assert_array_equal(getattr(other, name), getattr(filter, name))
    filter.predict(tau[49])
    filter.update(y[50])
    assert other.q[0] != filter.q[0]
    other.predict(tau[49])
    other.update(y[50])
    np.testing.assert_array_equal(other.covariance, filter.covariance)
    assert (other.parameters, other.consistency) == (filter.parameters, filter.consistency)


GOOD: dict[str, Any] = {"force_noise": NOISE, "q_std": 0.01, "v_std": 0.01}


@pytest.mark.parametrize(
    "change, told",
    [
        ({"sensors": []}, "sensors = []"),
        ({"sensors": [fa.sensors.StrainGauge(0, 0.01)]}, ("sensors[0]", "noise = None")),
        ({"sensors": [SENSORS[0], fa.sensors.Tachometer(5, noise=1)]}, ("sensors[1]", "link = 5")),
        ({"sensors": [fa.sensors.Accelerometer(noise=1.0)]}, ("sensors[0]", "Accelerometer", "Encoder")),
        ({"sensors": [fa.sensors.Encoder(0, delay=1.0)]}, ("sensors[0]", "delay = 1")),
        ({"step": 0.0}, "step = 0.0"),
        ({"force_noise": -1.0}, "force_noise = -1.0"),
        ({"force_noise": [1.0, 2.0]}, "force_noise"),
        ({"q_std": -0.1}, "q_std = -0.1"),
        ({"v_std": np.nan}, "v_std"),
        ({"q": np.zeros(2)}, "q has shape"),
        ({"estimate": {"mass": (0.1, 0.1)}}, ("estimate", "'mass'", "'payload'")),
        ({"estimate": {"coulomb": (0.1, 0.1)}}, ("estimate", "'coulomb'")),
        ({"estimate": {"damping.7": (0.1, 0.1)}}, ("estimate", "damping.7", "link = 7")),
        ({"sensors": SENSORS[0]}, ("list", "sensors")),
        ({"arm": None}, ("arm = None", "Arm")),
        ({"estimate": ["payload"]}, "estimate = ['payload']"),
        ({"drift": 0.1}, "drift = 0.1"),
        ({"estimate": {"payload": (-0.1, 0.1)}}, ("payload", "negative")),
        ({"estimate": {"payload": 0.1}}, ("payload", "standard deviation")),
        ({"estimate": {"payload": (0.1, -0.1)}}, ("standard deviation", "negative")),
        ({"drift": {"payload": 0.1}}, ("drift", "payload")),
        ({"friction_speed": 0.0}, "friction_speed = 0"),
    ],
)
def test_bad_input_is_named(change: dict[str, Any], told: str) -> None:
    given: dict[str, Any] = {"arm": two_links(), "sensors": SENSORS, "step": STEP} | GOOD | change
    with refuses(told):
        fa.KalmanFilter(**given)


def test_bad_readings_and_times_are_named() -> None:
    filter = fa.KalmanFilter(two_links(), SENSORS, STEP, **GOOD)
    t, zeros = np.arange(5) * STEP, np.zeros((5, 6))
    for call, told in (
        (lambda: filter.update(np.zeros(3)), ("readings has shape (3,)", "(4,)")),
        (lambda: filter.update(["a"] * 4), ("readings", "numbers")),
        (lambda: filter.predict(np.zeros(2)), "tau has shape"),
        (lambda: filter.predict(np.full(6, np.nan)), "tau"),
        (lambda: filter.run(2 * t, zeros, np.zeros((5, 4))), ("t", "0.001 s")),
        (lambda: filter.run(t, zeros[:3], np.zeros((5, 4))), "tau has shape"),
        (lambda: filter.run(t, zeros, np.zeros((4, 4))), ("readings has 4 rows", "5")),
        (lambda: filter.tip(7), "link = 7"),
    ):
        with refuses(told):
            call()
    with refuses("t =", "filter", "ran away", "payload", error=RuntimeError):
        wild = fa.KalmanFilter(two_links(), SENSORS, STEP, **GOOD, estimate={"payload": (0.1, 0.1)})
        wild.run(t, zeros, np.full((5, 4), 1e300))


def test_a_long_run_tells_how_far_it_is_and_can_be_stopped() -> None:
    rows, told = 20_000, list[float]()
    given = STEP * np.arange(rows), None, np.zeros((rows, 1))

    def made() -> fa.KalmanFilter:
        sensors = [fa.sensors.Encoder(0, noise=1e-3)]
        return fa.KalmanFilter(two_links(), sensors, STEP, force_noise=NOISE, q_std=0.01, v_std=0.01)

    def stop(share: float) -> None:
        raise ZeroDivisionError(share)

    assert len(made().run(*given, progress=told.append).t) == rows
    assert told == sorted(told) and 0 < told[0] and told[-1] < 1
    with pytest.raises(ZeroDivisionError):
        made().run(*given, progress=stop)
