"""Low passes ahead of sensors, against closed forms: of a record, in a loop, in scenes and in batches."""

from __future__ import annotations

import copy
import pickle
import warnings
from dataclasses import replace
from pathlib import Path

import flexarm as fa
import numpy as np
import pytest
from arms import close, floating_arm, paper_link
from messages import refuses, warns
from scipy.linalg import expm

CUT = 5.0  # Hz
FILTERS = [
    fa.sensors.LowPass(CUT),
    fa.sensors.LowPass(CUT, 2),
    fa.sensors.LowPass(CUT, 2, 0.3),
    fa.sensors.LowPass(CUT, 2, 1.0),
    fa.sensors.LowPass(CUT, 2, 3.0),
]
each = pytest.mark.parametrize("low_pass", FILTERS, ids=str)


def hinge() -> fa.Arm:
    """A rigid body on a hinge, of 1 kg m^2 about it."""
    return fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, inertia=(1, 1, 1), end=(0.4, 0, 0)))])


def moved(t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> fa.Result:
    """A record of the hinge, as it is given."""
    return fa.Result(hinge(), t, q[:, None], v[:, None], a[:, None], a[:, None])


def ramp(f: fa.sensors.LowPass, t: np.ndarray) -> np.ndarray:
    """What leaves a filter, at rest before, of u = max(t, 0)."""
    t, w = np.maximum(t, 0.0), 2 * np.pi * f.frequency
    if f.order == 1:
        return t - (1 - np.exp(-w * t)) / w
    d = f.damping_ratio
    if d == 1.0:
        return t - 2 / w + np.exp(-w * t) * (2 / w + t)
    b = w * np.sqrt(complex(1 - d * d))  # imaginary above critical damping
    e = np.exp(-d * w * t) * (2 * d / w * np.cos(b * t) + (2 * d * d - 1) / b * np.sin(b * t))
    return t - 2 * d / w + e.real


def step(f: fa.sensors.LowPass, t: np.ndarray) -> np.ndarray:
    """And of u = 1 from 0 on."""
    t, w = np.maximum(t, 0.0), 2 * np.pi * f.frequency
    if f.order == 1:
        return 1 - np.exp(-w * t)
    d = f.damping_ratio
    if d == 1.0:
        return 1 - np.exp(-w * t) * (1 + w * t)
    b = w * np.sqrt(complex(1 - d * d))
    return 1 - (np.exp(-d * w * t) * (np.cos(b * t) + d * w / b * np.sin(b * t))).real


# -- the filter by itself ----------------------------------------------------------------------------------------------


@each
def test_straight_lines_are_exact_at_any_times(low_pass: fa.sensors.LowPass) -> None:
    rng = np.random.default_rng(1)
    kinks, slopes = np.array([0.1, 0.15, 0.4]), np.array([3.0, -5.0, 2.0])
    for count in (3, 40, 4000):
        t = np.sort(np.concatenate([[0.0, 1.0], kinks, rng.uniform(0, 1, count)]))
        signal = 7.0 + sum(s * np.maximum(t - k, 0) for k, s in zip(kinks, slopes, strict=True))
        expected = 7.0 + sum(s * ramp(low_pass, t - k) for k, s in zip(kinks, slopes, strict=True))
        close(low_pass.apply(t, signal), expected, 1e-9)


@each
def test_a_step_is_answered_as_the_closed_form_has_it(low_pass: fa.sensors.LowPass) -> None:
    t = np.concatenate([[-1.0, 0.0], np.linspace(1e-9, 1.0, 777)])
    y = low_pass.apply(t, (t > 0).astype(float))
    close(y, step(low_pass, t), 1e-7)
    if low_pass.order == 2 and low_pass.damping_ratio < 1:
        d = low_pass.damping_ratio
        assert y.max() - 1 == pytest.approx(np.exp(-np.pi * d / np.sqrt(1 - d * d)), rel=1e-3)  # the overshoot


def test_what_frequency_and_bandwidth_mean() -> None:
    first, second = fa.sensors.LowPass(CUT), fa.sensors.LowPass(CUT, order=2)
    assert abs(first.response(CUT)) == pytest.approx(np.sqrt(0.5)) == abs(second.response(CUT))
    assert np.angle(first.response(CUT), deg=True) == pytest.approx(-45.0)
    assert np.angle(second.response(CUT), deg=True) == pytest.approx(-90.0)
    assert abs(fa.sensors.LowPass(CUT, 2, 0.3).response(CUT)) == pytest.approx(1 / 0.6)
    f = np.concatenate([np.linspace(0, 40 * CUT, 400001), np.geomspace(40 * CUT, 1e7 * CUT, 400001)[1:]])
    for low_pass in FILTERS:
        energy = np.abs(low_pass.response(f)) ** 2
        total = (0.5 * (energy[1:] + energy[:-1]) * np.diff(f)).sum()
        assert low_pass.bandwidth == pytest.approx(total, rel=1e-4)


@each
def test_white_noise_leaves_with_the_energy_of_the_bandwidth(low_pass: fa.sensors.LowPass) -> None:
    dt, sigma = 1e-3, 0.5  # one-sided density sigma^2 2 dt, up to 500 Hz
    t, density = np.arange(200_001) * dt, sigma**2 * 2 * dt
    noise = np.random.default_rng(3).normal(scale=sigma, size=(t.size, 10))
    y = low_pass.apply(t, noise)[5000:]
    assert y.var() == pytest.approx(density * low_pass.bandwidth, rel=0.05)
    # and its spectrum is |response|^2 of it; far below 500 Hz, straight lines between samples take nothing away
    spectra = [fa.sensors.psd(t[5000:], column, segment=2.0) for column in y.T]
    at = spectra[0].frequency
    near = (at > 1) & (at < 20)
    ratio = np.mean([s.density for s in spectra], axis=0)[near] / (density * np.abs(low_pass.response(at[near])) ** 2)
    assert np.abs(ratio - 1).max() < 0.2 and ratio.mean() == pytest.approx(1, abs=0.02)


def test_signals_are_filtered_along_an_axis() -> None:
    low_pass, t = FILTERS[1], np.linspace(0, 1, 201)
    y = np.random.default_rng(2).normal(size=(4, 201, 3))
    out = low_pass.apply(t, y, axis=1)
    assert out.shape == y.shape
    close(out[2, :, 1], low_pass.apply(t, y[2, :, 1]), 1e-14)
    close(np.moveaxis(out, 1, 0), low_pass.apply(t, np.moveaxis(y, 1, 0)), 1e-14)
    close(out[:, 0], y[:, 0], 0)  # settled
    close(low_pass.apply([0.0], [3.0]), np.array([3.0]), 0)


@pytest.mark.parametrize("ratio", [1e-9, 1e-3, 1e4])
def test_very_slow_and_very_fast_filters(ratio: float) -> None:
    """Frequency times step; a slow one keeps its first value, a fast one lets all pass."""
    t = np.arange(2001) * 1e-3
    y = np.sin(9 * t)
    for low_pass in (
        fa.sensors.LowPass(1e3 * ratio),
        fa.sensors.LowPass(1e3 * ratio, 2),
        fa.sensors.LowPass(1e3 * ratio, 2, 1.0),
    ):
        out = low_pass.apply(t, y)
        if ratio == 1e4:
            assert np.abs(out - y).max() < 1e-5
        elif ratio == 1e-9:
            assert np.abs(out).max() < 2e-5
        assert np.isfinite(out).all()


# -- reading a record --------------------------------------------------------------------------------------------------


@each
def test_amplitudes_and_phases_from_a_tenth_to_ten_times_the_frequency(low_pass: fa.sensors.LowPass) -> None:
    f = CUT * np.array([0.1, 0.3, 1.0, 3.0, 10.0])
    t = np.arange(24001) / 4000
    w, phase = 2 * np.pi * f, np.arange(5)
    angle = np.outer(t, w) + phase
    run = moved(t, np.sin(angle).sum(1), (w * np.cos(angle)).sum(1), -(w * w * np.sin(angle)).sum(1))
    for sensor, gain in ((fa.sensors.Encoder(0, pulses=None), np.ones(5)), (fa.sensors.Tachometer(0), 1j * w)):
        y = replace(sensor, filter=low_pass).read(run).y[:, 0]
        late = t >= 4.0  # a whole number of periods of all, long after the start
        fit = np.linalg.lstsq(np.hstack([np.sin(angle), np.cos(angle)])[late], y[late], rcond=None)[0]
        found = (fit[:5] + 1j * fit[5:]) / gain
        s = 1j * w / (2 * np.pi * CUT)
        expected = 1 / (1 + s) if low_pass.order == 1 else 1 / (1 + 2 * low_pass.damping_ratio * s + s * s)
        assert np.abs(np.abs(found) / np.abs(expected) - 1).max() < 1e-6
        assert np.abs(np.angle(found / expected)).max() < 1e-6


@each
def test_a_reading_does_not_depend_on_the_output_times(low_pass: fa.sensors.LowPass) -> None:
    """A constant acceleration is exact whatever they are, sampled between them, too, and late."""
    uneven = np.cumsum(np.random.default_rng(4).uniform(0.01, 0.1, 40))
    for t in (np.linspace(0, 1, 11), np.linspace(0, 1, 501), (uneven - uneven[0]) / np.ptp(uneven)):
        run = moved(t, 1.0 + t**2, 2 * t, np.full(len(t), 2.0))
        late = {"rate": 37.0, "delay": 0.0123, "filter": low_pass}
        rate = fa.sensors.Tachometer(**late).read(run)
        close(rate.y[:, 0], 2 * ramp(low_pass, rate.t - 0.0123), 1e-8)
        angle = fa.sensors.Encoder(pulses=None, **late).read(run)
        # a parabola's answer is the integral of the ramp's
        fine = np.linspace(0, 1, 200001)
        r = ramp(low_pass, fine)
        whole = np.concatenate([[0], np.cumsum(0.5 * (r[1:] + r[:-1])) * fine[1]])
        close(angle.y[:, 0], 1.0 + 2 * np.interp(np.maximum(angle.t - 0.0123, 0), fine, whole), 1e-8)


def test_coarse_output_times_follow_a_fine_run() -> None:
    arm, end = paper_link(), 0.5
    for sensor in (
        fa.sensors.StrainGauge(0, 0.01, filter=30.0, rate=1000),
        fa.sensors.Accelerometer(filter=fa.sensors.LowPass(30.0, 2), rate=1000),
        fa.sensors.ForceTorque(0, filter=30.0, rate=1000),
    ):
        coarse, fine = (
            sensor.read(fa.simulate(arm, np.linspace(0, end, n), drive={0: fa.Motion.spin_up(2.0, 0.25)}, rtol=1e-9)).y
            for n in (501, 5001)
        )
        assert np.abs(coarse - fine).max() < 1e-3 * np.ptp(fine, axis=0).max()


def test_turning_balls_and_loads_that_change_are_filtered() -> None:
    arm = floating_arm()
    rng = np.random.default_rng(5)
    v = 0.3 * rng.normal(size=arm.nv)
    v[6:] *= 0.05
    loads = [fa.Load(force=lambda t: [0, 2 * np.sin(90 * t), 0])]
    coarse, fine = (fa.simulate(arm, np.linspace(0, 0.05, n), arm.zero, v, loads=loads, rtol=1e-9) for n in (101, 1001))
    for sensor in (
        fa.sensors.Tachometer(),
        fa.sensors.Camera(),
        fa.sensors.Accelerometer(axis="xyz"),
        fa.sensors.ForceTorque(),
    ):
        sensor = replace(sensor, filter=fa.sensors.LowPass(50.0, 2))
        y = sensor.read(coarse).y
        assert np.abs(y - sensor.read(fine).y[::10]).max() < 1e-3 * np.ptp(y, axis=0).max()
        sampler = sensor.sampler(arm, loads=loads)
        heard = [sampler.sample(*x) for x in zip(coarse.t, coarse.q, coarse.v, coarse.a, strict=True)]
        close(np.array(heard), y, 1e-9)


def test_the_filter_comes_first_and_noise_is_added_behind_it() -> None:
    t = np.linspace(0, 1, 2001)
    run = moved(t, 0 * t, 0 * t, 0 * t)
    bare = fa.sensors.Tachometer(noise=0.2, seed=3)
    filtered = replace(bare, filter=1.0)
    np.testing.assert_array_equal(filtered.read(run).y, bare.read(run).y)  # still white, the same by the same seed
    turn = moved(t, t, np.ones_like(t), 0 * t)
    steps = fa.sensors.Encoder(pulses=100, filter=CUT).read(turn).y[:, 0] / (2 * np.pi / 100)
    close(steps, np.round(steps), 1e-9)
    jump = moved(t, 0 * t, np.where(t < 0.5, 0.0, 5.0), 0 * t)
    held = fa.sensors.Tachometer(range=2.0, filter=CUT).read(jump).y[:, 0]
    assert held.max() == 2.0 and 0.1 < held[np.searchsorted(t, 0.503)] < 0.6  # saturation is the converter's


def test_filters_keep_vibrations_from_folding_back() -> None:
    """A gauge read 50 times a second: what is at 41 Hz shows at 9 Hz, unless a filter stands ahead."""
    t = np.linspace(0, 20, 20001)
    w = 2 * np.pi * 41.0
    run = moved(t, np.sin(w * t), w * np.cos(w * t), -w * w * np.sin(w * t))
    sensor = fa.sensors.Encoder(pulses=None, rate=50)
    folded, clean = (
        fa.sensors.psd(*_ty(sensor.read(run))),
        fa.sensors.psd(*_ty(replace(sensor, filter=fa.sensors.LowPass(10.0, 2)).read(run))),
    )
    assert folded.peaks(1)[0] == pytest.approx(9.0, abs=0.01)
    ratio = clean.density.max() / folded.density.max()
    assert ratio == pytest.approx(1 / (1 + 4.1**4), rel=0.02)


def _ty(reading: fa.results.Reading) -> tuple[np.ndarray, np.ndarray]:
    return reading.t, reading.y


# -- in a loop ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "options", [{}, {"rate": 250.0}, {"delay": 0.008}, {"delay": 0.0034}, {"rate": 500.0, "delay": 0.004}]
)
@pytest.mark.parametrize("low_pass", [20.0, fa.sensors.LowPass(20.0, 2, 0.9)], ids=str)
def test_a_sampler_gives_what_a_reading_gives(low_pass, options: dict) -> None:
    arm = paper_link()
    run = fa.simulate(arm, np.arange(301) / 1000, drive={0: fa.Motion.spin_up(2.0, 0.25)})
    for sensor in (
        fa.sensors.Accelerometer(noise=0.3, range=4.0, filter=low_pass, **options),
        fa.sensors.Encoder(pulses=None, noise=0.001, filter=low_pass, **options),
        fa.sensors.ForceTorque(filter=low_pass, **options),
    ):
        reading, sampler = sensor.read(run), sensor.sampler(arm)
        for _ in range(2):
            heard = [sampler.sample(t, q, v, a) for t, q, v, a in zip(run.t, run.q, run.v, run.a, strict=True)]
            held = np.searchsorted(reading.t, run.t + 1e-9) - 1  # the newest sample
            np.testing.assert_allclose(heard, reading.y[held], rtol=0, atol=1e-9)
            sampler.reset()


@pytest.mark.parametrize("copied", [lambda x: pickle.loads(pickle.dumps(x)), copy.deepcopy])
def test_a_sampler_goes_on_where_it_was_saved(copied) -> None:
    sensor = fa.sensors.Tachometer(filter=fa.sensors.LowPass(20.0, 2), noise=0.1, delay=0.003)
    t = np.arange(100) / 1000
    whole, half = sensor.sampler(hinge()), sensor.sampler(hinge())
    heard = [whole.sample(s, [0.0], [np.sin(50 * s)], [50 * np.cos(50 * s)]) for s in t]
    again = []
    for k, s in enumerate(t):
        half = copied(half) if k == 50 else half
        again.append(half.sample(s, [0.0], [np.sin(50 * s)], [50 * np.cos(50 * s)]))
    np.testing.assert_array_equal(heard, again)


@pytest.mark.parametrize("options", [{"integrator": "implicit", "step": 5e-3}, {"integrator": "rk4", "step": 1e-3}, {}])
def test_a_loop_sees_what_is_read_of_its_run(options: dict) -> None:
    """A law that brakes by a filtered rate; its force jumps at each sample."""
    seen: list[np.ndarray] = []

    def law(t: float, y: np.ndarray) -> float:
        seen.append(y)
        return -3.0 * y[0]

    sensors = [
        fa.sensors.Tachometer(0, filter=fa.sensors.LowPass(15.0, 2)),
        fa.sensors.Encoder(0, pulses=None, filter=15.0),
    ]
    t = np.arange(201) / 200
    for _ in range(2):  # a run begins anew
        seen.clear()
        run = fa.simulate(hinge(), t, v0=[1.0], control=fa.Sampled(law, 200.0, sensors), **options)
        read = np.hstack([sensor.read(run).y for sensor in sensors])
        close(np.array(seen)[: len(t)], read[: len(seen)], 1e-12)
    # closed form: between samples the torque is held, so the rate is straight
    A, B = sensors[0].filter.matrices()
    M = np.zeros((4, 4))  # of the rate, the filter's two states, the torque
    M[0, 3], M[1:3, 0], M[1:3, 1:3] = 1.0, B, A
    state, by_step = np.array([1.0, 1.0, 0.0, 0.0]), expm(M / 200)
    for y in seen[: len(t)]:
        assert y[0] == pytest.approx(state[1], abs=1e-9 if options else 1e-5)
        state[3] = -3.0 * state[1]
        state = by_step @ state


@pytest.mark.parametrize("integrator", ["implicit", "rk4", "gauss", "ida"])
def test_filters_in_a_slow_loop_see_the_arm_between_its_samples(integrator: str) -> None:
    """A beam rings at 3.3, 21 and 58 Hz; a law asks 40 times a second, late, the result has a row each millisecond."""
    arm, t = paper_link(), np.arange(501) / 1000
    v0 = [0.0, 0.1, 0.1, 0.1]
    options = {} if integrator == "ida" else {"integrator": integrator, "step": 1e-4 if integrator == "rk4" else 1e-3}
    sensors = [
        fa.sensors.StrainGauge(0, 0.01, filter=fa.sensors.LowPass(10.0, 2)),
        fa.sensors.Tachometer(0, filter=8.0),
        fa.sensors.Camera(filter=8.0, rate=20.0, delay=0.0123, noise=1e-4),
    ]
    seen: list[tuple[float, np.ndarray]] = []

    def law(t: float, y: np.ndarray) -> float:
        seen.append((t, y))
        return -1e-3 * y[1]

    loop = fa.Sampled(law, 40.0, sensors, delay=0.004)
    run = fa.simulate(arm, t, v0=v0, control=loop, **options)
    at = np.round(1000 * np.array([s for s, _ in seen])).astype(int)
    y = np.array([y for _, y in seen])
    for sensor, found in ((sensors[0], y[:, :1]), (sensors[1], y[:, 1:2])):
        read = sensor.read(run).y
        close(found, read[at], 1e-8 * np.abs(read).max())
    camera = sensors[2].read(run)
    close(y[:, 2:], camera.y[np.searchsorted(camera.t, t[at] + 1e-9) - 1], 1e-6)
    rings = fa.sensors.StrainGauge(0, 0.01).read(run).y
    assert np.ptp(rings) > 1.5 * np.ptp(y[:, 0])


def test_looking_at_an_arm_does_not_move_it() -> None:
    arm, t = paper_link(), np.arange(201) / 1000
    for options in ({"integrator": "implicit", "step": 1e-3}, {"rtol": 1e-8}):
        runs = [
            fa.simulate(arm, t, v0=[0.0, 0.1, 0.0, 0.0], control=fa.Sampled(lambda t, y: 1e-3, 50.0, [s]), **options)
            for s in (fa.sensors.Tachometer(0), fa.sensors.Tachometer(0, filter=10.0))
        ]
        close(runs[1].q, runs[0].q, 1e-6 * np.abs(runs[0].q).max())
        assert runs[1].stats["steps"] < 1.6 * runs[0].stats["steps"]  # IDA ends steps there, and does not begin anew


@pytest.mark.parametrize("integrator", ["implicit", "gauss", "ida"])
def test_looking_at_a_joint_with_friction_does_not_move_it(integrator: str) -> None:
    rod = fa.RigidBody(1.0, inertia=(1, 1, 1))
    arm, t = fa.Arm([fa.Link(fa.Revolute("z", coulomb=1.0, stiction=1.5), rod)]), np.arange(401) / 200
    options = {} if integrator == "ida" else {"integrator": integrator, "step": 5e-3}

    def law(t: float, y: np.ndarray) -> float:
        return 3.0 * np.sin(5 * t)

    runs = [
        fa.simulate(arm, t, control=fa.Sampled(law, 20.0, [s]), **options)
        for s in (fa.sensors.Tachometer(0), fa.sensors.Tachometer(0, filter=10.0))
    ]
    assert runs[0].stats["switches"] >= 2
    close(runs[1].q, runs[0].q, 1e-5)


def test_an_accelerometer_has_the_mean_right_where_forces_jump() -> None:
    """A bang-bang torque: what the filter gives of the record, where forces jump at rows, against the closed form."""
    low_pass, h = fa.sensors.LowPass(CUT, 2), 5e-3
    torque = np.where(np.arange(201) // 7 % 2, -4.0, 4.0)
    run = fa.simulate(
        hinge(), np.arange(201) * h, v0=[0.0],
        control=fa.Sampled(lambda t, y: torque[round(t / h)], 1 / h, [("joint", 0)]), integrator="implicit", step=h,
    )  # fmt: skip
    y = fa.sensors.Accelerometer(filter=low_pass, gravity=False).read(run).y[:, 0]
    edges = np.flatnonzero(np.diff(torque)) + 1
    expected = 1.6 + sum(0.4 * (torque[k] - torque[k - 1]) * step(low_pass, run.t - run.t[k]) for k in edges)
    assert np.abs(y - expected).max() < 0.01  # straight lines between rows would be half a step early: 0.11


def test_a_loop_that_its_filter_makes_unstable_is_named() -> None:
    """A rate fed back through a slow filter, and an angle: growth against the matrix of one sample."""
    kp, kd, h = 300.0, 6.0, 0.01
    for low_pass in (fa.sensors.LowPass(0.1), fa.sensors.LowPass(0.8, 2, 0.5)):
        A, B = low_pass.matrices()
        k = len(A)
        M = np.zeros((3 + k, 3 + k))  # angle, rate, filter, held torque
        M[0, 1] = M[1, 2 + k] = 1.0
        M[2 : 2 + k, 1], M[2 : 2 + k, 2 : 2 + k] = B, A
        hold = np.eye(3 + k)
        hold[2 + k] = 0
        hold[2 + k, 0], hold[2 + k, 2] = -kp, -kd
        growth = np.log(np.abs(np.linalg.eigvals(expm(M * h) @ hold)).max()) / h
        assert growth > 0.5

        def law(sensor: fa.sensors.Sensor) -> fa.Controller:
            gains = np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((1, 0)), [[kp, kd]]
            return fa.LinearController(*gains, rate=1 / h, measure=[("joint", 0), sensor])

        t = np.linspace(0, 4, 401)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            fa.simulate(hinge(), t, [0.01], control=law(fa.sensors.Tachometer(0)), integrator="implicit", step=h)
        slow = law(fa.sensors.Tachometer(0, filter=low_pass))
        with warns(fa.errors.LoopWarning, "'link 0 revolute'", "unstable") as w:
            fa.simulate(hinge(), t, [0.01], control=slow, integrator="implicit", step=h)
        assert w[0].message.finding.value == pytest.approx(growth, rel=1e-5)


# -- scenes, batches, what is said -------------------------------------------------------------------------------------

SCENE = """
[[link]]
joint = { type = "revolute", axis = "z" }
tip = { mass = 1.0, com = [0.3, 0, 0] }
[[drive]]
link = 0
spin_up = { speed = 2.0, time = 0.1 }
[[sensor]]
type = "tachometer"
filter = 40
[[sensor]]
type = "accelerometer"
filter = { frequency = 2, order = 2, damping_ratio = 0.9 }
[simulation]
duration = 0.1
"""


def test_scenes_have_filters(tmp_path: Path) -> None:
    path = tmp_path / "s.toml"
    path.write_text(SCENE)
    scene = fa.load(path)
    first, second = scene.sensors
    assert first == fa.sensors.Tachometer(filter=40) == fa.sensors.Tachometer(filter=fa.sensors.LowPass(40.0))
    assert second.filter == fa.sensors.LowPass(2.0, order=2, damping_ratio=0.9)
    for sensor in scene.sensors:
        assert pickle.loads(pickle.dumps(sensor)) == sensor and hash(sensor) == hash(copy.copy(sensor))
    scene.save(tmp_path / "again.toml")
    assert fa.load(tmp_path / "again.toml").sensors == scene.sensors
    run = scene.run()
    close(scene.readings(run)["sensor-0-tachometer"].y, first.read(run).y, 0)
    run.save(tmp_path / "run.npz")
    close(second.read(fa.Result.load(tmp_path / "run.npz")).y, second.read(run).y, 1e-15)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("filter = 40", "filter = 0", ("sensor[0].filter = 0", "Hz")),
        ("filter = 40", 'filter = "fast"', ("sensor[0].filter = 'fast'", "Hz", "LowPass")),
        ("filter = 40", "filter = [40]", ("sensor[0].filter = [40]", "Hz", "LowPass")),
        ("filter = 40", "filter = { order = 2 }", ("sensor[0].filter", "missing")),
        ("order = 2", "order = 3", ("sensor[1].filter.order = 3", "1 or 2")),
        ("damping_ratio", "damping", ("sensor[1].filter", "key 'damping'", "'damping_ratio'")),
    ],
)
def test_bad_scenes(old: str, new: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text(SCENE.replace(old, new))
    with refuses(message):
        fa.load(tmp_path / "s.toml")


def test_batches_are_filtered_one_by_one_or_at_once() -> None:
    low_pass, t = fa.sensors.LowPass(CUT, 2), np.linspace(0, 1, 201)
    batch = fa.simulate_batch(hinge(), t, v0=np.array([[1.0], [2.0], [-3.0]]), outputs=("q", "v"))
    sensor = fa.sensors.Tachometer(0, filter=low_pass)
    at_once = low_pass.apply(t, batch.v, axis=1)
    for k in range(3):
        close(sensor.read(batch[k]).y, at_once[k], 1e-9)

    seen: list[float] = []

    def law(t: float, y: np.ndarray) -> float:
        seen.append(float(y[0]))
        return -2.0 * y[0]

    loop = fa.Sampled(law, 200.0, [sensor])
    v0 = np.array([[1.0], [2.0]])
    both = fa.simulate_batch(hinge(), t, v0=v0, control=loop, integrator="implicit", step=5e-3, workers=1)
    for k in range(2):
        alone = fa.simulate(hinge(), t, v0=v0[k], control=loop, integrator="implicit", step=5e-3)
        close(both.v[k], alone.v, 1e-9)


def test_a_filter_above_half_the_rate_of_the_states_is_warned_of() -> None:
    t = np.linspace(0, 1, 101)
    run = moved(t, t, np.ones_like(t), 0 * t)
    words = ("filter", "60 Hz", "0.01 s", "0.00833 s", "rate")
    with warns(fa.errors.ModelWarning, words):
        fa.sensors.Tachometer(filter=60.0).read(run)
    sampler = fa.sensors.Tachometer(filter=60.0).sampler(run.arm)
    sampler.sample(0.0, [0.0], [1.0])
    with warns(fa.errors.ModelWarning, words):
        sampler.sample(0.01, [0.0], [1.0])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sampler.sample(0.02, [0.0], [1.0])  # once
        fa.sensors.Tachometer(filter=50.0).read(run)
        fa.sensors.Tachometer(filter=50.0, rate=20.0).read(run)  # above half its own rate: an analogue filter may


BAD = [
    (lambda: fa.sensors.Encoder(filter=0), ("filter = 0", "Hz")),
    (lambda: fa.sensors.Encoder(filter=-5.0), "filter = -5.0"),
    (lambda: fa.sensors.Encoder(filter=np.nan), "filter = nan"),
    (lambda: fa.sensors.Encoder(filter=np.inf), "filter = inf"),
    (lambda: fa.sensors.Encoder(filter=True), ("filter = True", "Hz", "LowPass")),
    (lambda: fa.sensors.Encoder(filter="slow"), ("filter = 'slow'", "Hz", "LowPass")),
    (lambda: fa.sensors.Encoder(filter=(5.0, 2)), ("filter = (5.0, 2)", "Hz", "LowPass")),
    (lambda: fa.sensors.LowPass(0.0), ("frequency = 0.0", "Hz")),
    (lambda: fa.sensors.LowPass("5"), "frequency = '5'"),
    (lambda: fa.sensors.LowPass(5.0, 0), ("order = 0", "1 or 2")),
    (lambda: fa.sensors.LowPass(5.0, 3), ("order = 3", "1 or 2")),
    (lambda: fa.sensors.LowPass(5.0, 1.5), "order = 1.5"),
    (lambda: fa.sensors.LowPass(5.0, 1, 0.7), ("damping_ratio = 0.7", "order 2", "order = 1")),
    (lambda: fa.sensors.LowPass(5.0, 2, 0.0), "damping_ratio = 0.0"),
    (lambda: fa.sensors.LowPass(5.0, 2, "soft"), "damping_ratio = 'soft'"),
    (lambda: fa.sensors.LowPass(5.0).apply([0, 1, 1], [0, 0, 0]), ("t", "times", "increase")),
    (lambda: fa.sensors.LowPass(5.0).apply([0, 1], [0, 0, 0]), ("y has shape (3,)", "2")),
    (lambda: fa.sensors.LowPass(5.0).apply([0, 1], [0, 1], axis=1), "y has shape (2,)"),
    (lambda: fa.sensors.LowPass(5.0).apply([0, 1], [0, np.nan]), "y = [0.0, nan]"),
    (lambda: fa.sensors.LowPass(5.0).response("x"), "frequency = 'x'"),
]


@pytest.mark.parametrize(("make", "message"), BAD)
def test_bad_input(make, message: str) -> None:
    with refuses(message):
        make()
