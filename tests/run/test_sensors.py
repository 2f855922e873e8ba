"""Sensors: what they measure against closed forms, and what sampling, delay, noise, steps and range make of it."""

from __future__ import annotations

import csv
import json
import pickle
from pathlib import Path

import flexarm as fa
import numpy as np
import pytest
from arms import STEEL, G, close, floating_arm, paper_link, pendulum
from flexarm.cli import main
from messages import refuses

LENGTH, WIDTH, HEIGHT = 0.5, 0.01, 0.02


def cantilever(gravity=(0, 0, 0), **beam) -> fa.Arm:
    """A steel strip, clamped; its curvatures are straight lines (two Legendre polynomials)."""
    modes = {"bending_y": 2, "bending_z": 2}
    strip = fa.Beam(LENGTH, fa.Rectangle(WIDTH, HEIGHT), STEEL, modes, "legendre", **beam)
    return fa.Arm([fa.Link(fa.Fixed(), beam=strip)], gravity)


def turning(speed: float, t: np.ndarray, body: fa.RigidBody | None = None, gravity=(0, 0, 0)) -> fa.Result:
    """A rigid arm that turns about z at a constant speed."""
    arm = fa.Arm([fa.Link(fa.Revolute("z"), body or fa.RigidBody(1.0, (0.2, 0, 0), end=(0.4, 0, 0)))], gravity)
    end = float(t[-1])
    return fa.simulate(arm, t, drive={0: fa.Motion([0, end], [0, speed * end], [speed, speed], [0, 0])})


# -- what is measured ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("x", [0.0, 0.1, 0.37])
def test_gauges_on_a_beam_with_a_force_on_its_end(x: float) -> None:
    arm, P, Q = cantilever(), 0.3, -0.2  # N, along y and z
    q = arm.equilibrium(loads=[fa.Load(force=(0, P, Q))])
    E, moment = 209e9, LENGTH - x
    by_y = -P * moment / (E * HEIGHT * WIDTH**3 / 12) * WIDTH / 2  # the tip goes to +y, so the face +y is compressed
    by_z = -Q * moment / (E * WIDTH * HEIGHT**3 / 12) * HEIGHT / 2
    for face, strain in (("+y", by_y), ("-y", -by_y), ("+z", by_z), ("-z", -by_z)):
        found = fa.sensors.StrainGauge(0, x, face).measure(arm, 0.0, q, np.zeros(arm.nv))
        assert found.shape == (1,) and found[0] == pytest.approx(strain, rel=1e-5)
    resistance = fa.sensors.StrainGauge(0, x, "+y", gauge_factor=2.05).measure(arm, 0.0, q, np.zeros(arm.nv))
    assert resistance[0] == pytest.approx(2.05 * by_y, rel=1e-5)


def test_gauges_know_the_faces_of_circles_and_tapers() -> None:
    def strain(section, **gauge) -> float:
        arm = fa.Arm([fa.Link(fa.Fixed(), beam=fa.Beam(0.5, section, STEEL, {"bending_y": 1}, "legendre"))])
        return float(fa.sensors.StrainGauge(0, 0.25, **gauge).measure(arm, 0.0, [2.0], [0.0])[0])  # curvature 2 1/m

    assert strain(fa.Circle(0.003)) == pytest.approx(-2 * 0.003)
    wedge = fa.sections.Taper((0, 0.5), (fa.Rectangle(0.004, 0.01), fa.Rectangle(0.002, 0.01)))
    assert strain(wedge) == pytest.approx(-2 * 0.0015)
    general = fa.sections.GeneralSection(1e-5, 1e-10, 1e-10, 1e-10)
    assert strain(general, distance=0.002) == pytest.approx(-2 * 0.002)
    with refuses("distance = None"):
        strain(general)


def test_an_accelerometer_at_rest_reads_gravity_upwards() -> None:
    arm = pendulum()  # weight along -y
    zero = np.zeros(1)

    def read(q: float, **sensor) -> np.ndarray:
        return fa.sensors.Accelerometer(axis="xyz", **sensor).measure(arm, 0.0, [q], zero, zero)

    close(read(0.0), np.array([0, G, 0]), 1e-12)
    close(read(np.pi / 2), np.array([G, 0, 0]), 1e-12)  # its own x points up
    close(read(0.0, gravity=False), np.zeros(3), 1e-12)
    oblique = fa.sensors.Accelerometer(axis=(1, 1, 0)).measure(arm, 0.0, [0.0], zero, zero)
    assert oblique[0] == pytest.approx(G / np.sqrt(2))


def test_an_accelerometer_in_free_fall_reads_nothing() -> None:
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, (1, 0, 0), end=(1, 0, 0)))], (0, -G, 0))
    a = arm.forward_dynamics([0.0], [0.0])  # a point mass let go with its rod level: nothing holds it at first
    assert abs(fa.sensors.Accelerometer().measure(arm, 0.0, [0.0], [0.0], a)[0]) < 1e-12
    assert fa.sensors.Accelerometer(gravity=False).measure(arm, 0.0, [0.0], [0.0], a)[0] == pytest.approx(-G)


def test_an_accelerometer_that_is_spun_reads_towards_the_axis() -> None:
    run = turning(3.0, np.linspace(0, 1, 11))
    y = fa.sensors.Accelerometer(axis="xyz").read(run).y
    close(y, np.tile([-(3.0**2) * 0.4, 0, 0], (11, 1)), 1e-9)


def test_force_and_torque_of_weight_and_lever() -> None:
    t = np.linspace(0, 1, 21)
    body = fa.RigidBody(2.0, (0.3, 0, 0), end=(0.5, 0, 0))
    arm = fa.Arm([fa.Link(fa.Revolute("z"), body)], (0, 0, -G))
    pull = fa.Load(force=np.outer([0.0, 4.0], [0, 0, -1.0]), t=[0, 1])
    run = fa.simulate(arm, t, drive={0: fa.Motion([0, 1], [0, 0])}, loads=[pull])
    sensor = fa.sensors.ForceTorque(0)
    weight, lever = 2.0 * G + 4.0 * t, 2.0 * G * 0.3 + 4.0 * t * 0.5
    zero = np.zeros_like(t)
    close(sensor.read(run).y, np.stack([zero, zero, weight, zero, -lever, zero], axis=1), 1e-9)
    close(sensor.read(run).y, run.joint_reaction(0), 1e-12)
    sampler = sensor.sampler(arm, loads=[pull])
    close(sampler.sample(0.5, [0.0], [0.0], [0.0]), np.array([0, 0, weight[10], 0, -lever[10], 0]), 1e-9)
    assert sensor.read(run).units == ("N", "N", "N", "N m", "N m", "N m") and sensor.read(run).unit == "N, N m"


def test_a_camera_follows_the_tip() -> None:
    arm = paper_link()
    run = fa.simulate(arm, np.linspace(0, 0.3, 61), drive={0: fa.Motion.spin_up(2.0, 0.25)})
    close(fa.sensors.Camera().read(run).y, run.frame()[0], 1e-15)
    close(fa.sensors.Camera(axes="link").read(run).y, run.tip_deflection(), 1e-12)
    close(fa.sensors.Camera(x=0.2, axes="link").read(run).y, arm.deflection(run.q, 0, 0.2), 1e-12)
    assert fa.sensors.Camera().read(run).labels == ("position x", "position y", "position z")


def test_encoders_and_tachometers() -> None:
    arm = fa.Arm([fa.Link(fa.Cylindrical("z"), fa.RigidBody(1, inertia=(1, 1, 1)))])
    q, v = [0.70, 0.0123], [0.5, 0.25]
    angle = arm.links[0].joint.units.index("rad")
    slide = 1 - angle
    for freedom, unit in ((angle, "rad"), (slide, "m")):
        assert fa.sensors.Encoder(0, freedom).components(arm) == [("position", unit)]
        assert fa.sensors.Encoder(0, freedom).measure(arm, 0.0, q, v)[0] == q[freedom]
        assert fa.sensors.Tachometer(0, freedom).measure(arm, 0.0, q, v)[0] == v[freedom]
    assert fa.sensors.Encoder(0, angle, 500).steps(arm)[0] == pytest.approx(2 * np.pi / 500)
    assert fa.sensors.Encoder(0, angle, 500, quadrature=True, gear_ratio=100).steps(arm)[0] == pytest.approx(
        2 * np.pi / 200e3
    )
    assert fa.sensors.Encoder(0, slide, 500).steps(arm)[0] == pytest.approx(1 / 500)
    assert fa.sensors.Encoder(0, slide, None).steps(arm)[0] == 0


# -- what the instrument makes of it -------------------------------------------------------------------------------


def test_a_delayed_reading_in_steps_by_hand() -> None:
    run = turning(2.0, np.linspace(0, 1, 11))
    reading = fa.sensors.Encoder(pulses=8, rate=4, delay=0.1).read(run)  # angles 0 (not yet moving), 0.3, 0.8, 1.3, 1.8
    close(reading.t, np.array([0, 0.25, 0.5, 0.75, 1.0]), 1e-15)
    np.testing.assert_allclose(reading.y[:, 0] / (np.pi / 4), [0, 0, 1, 2, 2], rtol=0, atol=1e-12)
    assert reading.unit == "rad" and "link 0 revolute" in reading.name


def test_noise_comes_before_steps_and_range_last() -> None:
    run = turning(2.0, np.linspace(0, 1, 2001))
    y = fa.sensors.Encoder(pulses=100, noise=0.5, range=1.0).read(run).y[:, 0]
    counts = y[np.abs(y) < 1.0] / (2 * np.pi / 100)
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
    assert y.max() == 1.0 and y.min() < 0 and np.abs(y).max() <= 1.0


def test_noise_is_white_repeats_by_seed_and_is_each_sensors_own() -> None:
    run = turning(0.0, np.linspace(0, 1, 20001))

    def noise(sensor: fa.sensors.Sensor) -> np.ndarray:
        return sensor.read(run).y

    first = noise(fa.sensors.Accelerometer(noise=0.2, seed=3))[:, 0]
    assert first.std() == pytest.approx(0.2, rel=0.03) and abs(first.mean()) < 4 * 0.2 / np.sqrt(20001)
    assert abs(np.corrcoef(first[1:], first[:-1])[0, 1]) < 4 / np.sqrt(20000)
    assert abs((np.abs(first) < 0.2).mean() - 0.6827) < 0.015  # Gaussian
    for same in (fa.sensors.Accelerometer(noise=0.2, seed=3), fa.sensors.Accelerometer(link=0, noise=0.2, seed=3)):
        np.testing.assert_array_equal(first, noise(same)[:, 0])
    for other in (
        fa.sensors.Accelerometer(noise=0.2, seed=4),
        fa.sensors.Accelerometer(axis="x", noise=0.2, seed=3),
        fa.sensors.Tachometer(noise=0.2, seed=3),
    ):
        assert abs(np.corrcoef(first, noise(other)[:, 0])[0, 1]) < 4 / np.sqrt(20000)
    six = noise(fa.sensors.ForceTorque(noise=(1, 1, 1, 0, 0, 0.1)))
    np.testing.assert_allclose(six.std(axis=0), [1, 1, 1, 0, 0, 0.1], rtol=0.03, atol=1e-12)


def test_samples_between_the_output_times_follow_the_motion() -> None:
    w = 2 * np.pi
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, (0.2, 0, 0), end=(0.4, 0, 0)))])
    swing = fa.Motion(lambda t: (np.sin(w * t), w * np.cos(w * t), -w * w * np.sin(w * t)))
    run = fa.simulate(arm, np.linspace(0, 1, 101), drive={0: swing})
    encoder = fa.sensors.Encoder(pulses=None, rate=730, delay=0.0123).read(run)
    at = np.maximum(encoder.t - 0.0123, 0)
    assert np.abs(encoder.y[:, 0] - np.sin(w * at)).max() < 1e-7
    rate = fa.sensors.Tachometer(rate=730).read(run)
    assert np.abs(rate.y[:, 0] - w * np.cos(w * rate.t)).max() < 1e-6
    along = fa.sensors.Accelerometer(rate=730, gravity=False).read(run)
    assert np.abs(along.y[:, 0] + 0.4 * w * w * np.sin(w * along.t)).max() < 1e-4
    with refuses("rate = 2000", "1000 Hz", "0.005 s"):
        fa.sensors.Tachometer(rate=2000).read(run)


def test_turning_balls_are_read_between_the_output_times() -> None:
    arm = floating_arm()
    q, rng = arm.zero, np.random.default_rng(5)
    v = 0.3 * rng.normal(size=arm.nv)
    v[6:] *= 0.05
    coarse, fine = (fa.simulate(arm, np.linspace(0, 0.02, n), q, v, rtol=1e-9) for n in (41, 401))
    for sensor in (fa.sensors.Camera(rate=20000), fa.sensors.Accelerometer(axis="xyz", rate=20000)):
        y = sensor.read(fine).y
        assert np.abs(sensor.read(coarse).y - y).max() < 2e-3 * np.ptp(y, axis=0).max()


@pytest.mark.parametrize(
    "options", [{}, {"rate": 250.0}, {"rate": 2000.0}, {"delay": 0.008}, {"rate": 500.0, "delay": 0.004}]
)
def test_a_sampler_gives_what_a_reading_gives(options: dict) -> None:
    arm = paper_link()
    run = fa.simulate(arm, np.arange(301) / 1000, drive={0: fa.Motion.spin_up(2.0, 0.25)})
    for sensor in (
        fa.sensors.Accelerometer(noise=0.3, resolution=0.05, range=4.0, **options),
        fa.sensors.Encoder(noise=0.001, **options),
        fa.sensors.Camera(noise=(1e-3, 1e-4, 0), **options),
    ):
        reading = sensor.read(run)
        sampler = sensor.sampler(arm)
        for _ in range(2):
            heard = [sampler.sample(t, q, v, a) for t, q, v, a in zip(run.t, run.q, run.v, run.a, strict=True)]
            held = np.searchsorted(reading.t, run.t + 1e-9) - 1  # the newest sample
            np.testing.assert_allclose(heard, reading.y[held], rtol=0, atol=1e-9)
            sampler.reset()


def test_a_sampler_interpolates_a_delay_between_calls() -> None:
    arm = turning(0.0, np.array([0, 1.0])).arm
    sampler = fa.sensors.Encoder(pulses=None, delay=0.15).sampler(arm)
    heard = [sampler.sample(0.1 * k, [float(k * k)], [0.0])[0] for k in range(5)]
    np.testing.assert_allclose(heard, [0, 0, 0.5, 2.5, 6.5], atol=1e-9)  # halfway between 0, 0, 1, 4 and 9
    with refuses("t = 0.4"):
        sampler.sample(0.4, [0.0], [0.0])


# -- spectra -------------------------------------------------------------------------------------------------------


def test_a_spectrum_holds_the_variance_and_finds_the_lines() -> None:
    t = np.arange(20000) / 1000
    y = 3 + 2 * np.sin(2 * np.pi * 7.013 * t) + 0.5 * np.sin(2 * np.pi * 91.37 * t)
    y += 0.3 * np.random.default_rng(1).normal(size=t.size)
    spectrum = fa.sensors.psd(t, y)
    assert spectrum.density.sum() * spectrum.frequency[1] == pytest.approx(2 + 0.125 + 0.09, rel=0.02)
    np.testing.assert_allclose(spectrum.peaks(2), [7.013, 91.37], atol=0.05 / 20)  # a twentieth of a step
    smooth = fa.sensors.psd(t, y, segment=2.0)
    quiet = (smooth.frequency > 150) & (smooth.frequency < 450)
    assert smooth.density[quiet].mean() == pytest.approx(0.09 / 500, rel=0.1)  # unit^2/Hz, one-sided
    assert len(fa.sensors.psd(t, np.zeros_like(t)).peaks()) == 0


def test_a_gauge_after_an_impact_tells_the_frequencies() -> None:
    """The experiment of the paper's Fig. 7: an impact on the tip, the hub held."""
    arm = paper_link(rotary_inertia=False)
    v0 = np.linalg.solve(arm.mass_matrix(arm.zero)[1:, 1:], 1e-4 * arm.jacobian(arm.zero)[1, 1:])  # 1e-4 N s
    t = np.arange(8001) / 1000
    run = fa.simulate(arm, t, v0=[0, *v0], drive={0: fa.Motion([0, 8], [0, 0])}, integrator="gauss", step=0.002)
    reading = fa.sensors.StrainGauge(0, 0.01).read(run)
    peaks = fa.sensors.psd(reading.t, reading.y).peaks(3)
    np.testing.assert_allclose(peaks * 2 * np.pi, [20.948766, 131.283672, 367.598084], rtol=1e-3)


# -- scene files, the command line, bad input ----------------------------------------------------------------------

SCENE = """
[[link]]
joint = { type = "revolute", axis = "z" }
tip = { mass = 1.0, com = [0.3, 0, 0] }
[[drive]]
link = 0
spin_up = { speed = 2.0, time = 0.1 }
[[sensor]]
type = "encoder"
link = 0
pulses = 500
[[sensor]]
type = "accelerometer"
axis = "xyz"
rate = 500
noise = [0.1, 0.1, 0.0]
[simulation]
duration = 0.1
"""


def test_scenes_and_the_command_line_read_sensors(tmp_path: Path, capsys) -> None:
    path = tmp_path / "s.toml"
    path.write_text(SCENE)
    scene = fa.load(path)
    assert scene.sensors == (
        fa.sensors.Encoder(0, pulses=500),
        fa.sensors.Accelerometer(axis="xyz", rate=500, noise=(0.1, 0.1, 0.0)),
    )
    for sensor in scene.sensors:
        assert pickle.loads(pickle.dumps(sensor)) == sensor
    assert main(["run", str(path), "-o", str(tmp_path / "out"), "--json"]) == 0
    files = json.loads(capsys.readouterr().out)["files"]
    assert {"sensor-0-encoder.csv", "sensor-1-accelerometer.csv"} <= set(files)
    with (tmp_path / "out" / "sensor-1-accelerometer.csv").open() as f:
        header, *rows = csv.reader(f)
    assert header == ["t (s)", *(f"acceleration {c} (m/s^2)" for c in "xyz")] and len(rows) == 51
    readings = scene.readings(fa.Result.load(tmp_path / "out" / "run.npz"))
    close(np.array(rows, dtype=float)[:, 1:], readings["sensor-1-accelerometer"].y, 1e-12)


def test_a_file_without_its_loads_has_no_reactions(tmp_path: Path) -> None:
    arm = pendulum()
    run = fa.simulate(arm, [0, 0.1], loads=[fa.Load(force=(1, 0, 0))])
    run.save(tmp_path / "run.npz")
    again = fa.Result.load(tmp_path / "run.npz")
    close(fa.sensors.Encoder().read(again).y, fa.sensors.Encoder().read(run).y, 1e-15)
    with refuses("loads = None"):
        fa.sensors.ForceTorque().read(again)


def test_readings_are_drawn(tmp_path: Path) -> None:
    run = turning(2.0, np.linspace(0, 1, 101))
    for sensor, panels in ((fa.sensors.Encoder(), 1), (fa.sensors.ForceTorque(), 2)):
        fig = sensor.read(run).plot()
        assert len(fig.axes) == panels
        fig.savefig(tmp_path / "reading.png")
    assert "(rad)" in fa.sensors.Encoder().read(run).plot().axes[0].get_ylabel()


LINK = paper_link()
BAD = [
    (lambda: fa.sensors.Encoder(pulses=0), ("pulses = 0", "1")),
    (lambda: fa.sensors.Encoder(pulses=1.5), "pulses = 1.5"),
    (lambda: fa.sensors.Encoder(resolution=0.1), "resolution = 0.1"),
    (lambda: fa.sensors.Encoder(gear_ratio=0), "gear_ratio = 0.0"),
    (lambda: fa.sensors.Encoder(quadrature=4), "quadrature = 4"),
    (lambda: fa.sensors.Encoder(rate=0), "rate = 0.0"),
    (lambda: fa.sensors.Encoder(rate="fast"), "rate = 'fast'"),
    (lambda: fa.sensors.Encoder(delay=-1e-3), "delay = -0.001"),
    (lambda: fa.sensors.Tachometer(noise=-1), "noise = -1"),
    (lambda: fa.sensors.Tachometer(noise=np.nan), "noise = nan"),
    (lambda: fa.sensors.Tachometer(range=0), "range = 0"),
    (lambda: fa.sensors.Tachometer(resolution=0.0), "resolution = 0.0"),
    (lambda: fa.sensors.Tachometer(seed=-1), "seed = -1"),
    (lambda: fa.sensors.Tachometer(seed=0.5), "seed = 0.5"),
    (lambda: fa.sensors.StrainGauge(face="y"), "face = 'y'"),
    (lambda: fa.sensors.StrainGauge(gauge_factor=0), "gauge_factor = 0.0"),
    (lambda: fa.sensors.Accelerometer(axis="w"), "axis = 'w'"),
    (lambda: fa.sensors.Accelerometer(axis=(0, 0, 0)), "axis ="),
    (lambda: fa.sensors.Accelerometer(gravity=9.81), "gravity = 9.81"),
    (lambda: fa.sensors.Camera(axes="hub"), "axes = 'hub'"),
    (lambda: fa.sensors.ForceTorque(side="left"), "side = 'left'"),
    (lambda: fa.sensors.Encoder(3).check(LINK), ("link = 3", "-1 to 0")),
    (lambda: fa.sensors.Encoder(0, 1).check(LINK), ("link = (0, 1)", "freedoms 0")),
    (lambda: fa.sensors.StrainGauge(0, 0.6).check(LINK), ("x = 0.6", "beam")),
    (lambda: fa.sensors.StrainGauge(0).check(pendulum()), "link = 0"),
    (lambda: fa.sensors.Camera(axes="link").check(pendulum()), "beam"),
    (lambda: fa.sensors.Camera(noise=(1, 2)).check(LINK), ("noise = (1.0, 2.0)", "3")),
    (
        lambda: fa.sensors.Encoder().check(fa.Arm([fa.Link(fa.Spherical(), fa.RigidBody(1, inertia=(1, 1, 1)))])),
        "freedom = 0",
    ),
    (
        lambda: fa.sensors.Accelerometer().sampler(LINK).sample(0.0, LINK.zero, np.zeros(4)),
        "a = None",
    ),
    (lambda: fa.sensors.psd([0, 1], [0, 1]), "t has shape (2,)"),
    (lambda: fa.sensors.psd(np.arange(9.0) ** 2, np.zeros(9)), ("t", "increase", "equal", "steps")),
    (lambda: fa.sensors.psd(np.arange(9), np.zeros(8)), ("y has shape (8,)", "9", "numbers")),
    (lambda: fa.sensors.psd(np.arange(9), np.zeros(9), segment=3), ("segment = 3", "8 to 9")),
    (lambda: fa.sensors.psd(np.arange(9), np.ones(9), window="flat"), "window = 'flat'"),
]


@pytest.mark.parametrize(("make", "message"), BAD)
def test_bad_input(make, message: str) -> None:
    with refuses(message):
        make()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('type = "encoder"', 'type = "encodr"', ("sensor[0].type = 'encodr'", "'encoder'")),
        ("pulses", "pulse", ("sensor[0]", "key 'pulse'", "'pulses'")),
        ("rate = 500", "rate = 5e6", ("sensor[1]: rate = 5e+06", "10000 Hz")),
        ("pulses = 500", "pulses = 500\nfreedom = 2", ("sensor[0]", "freedoms 0")),
    ],
)
def test_bad_scenes(old: str, new: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text(SCENE.replace(old, new))
    with refuses(message):
        fa.load(tmp_path / "s.toml")


def test_a_reading_is_columns(tmp_path: Path) -> None:
    run = fa.load("ist").run()
    reading = fa.sensors.Camera(0).read(run)
    data = reading.to_data()
    assert data.names == reading.labels == ("position x", "position y", "position z") and data.name == reading.name
    np.testing.assert_array_equal(np.column_stack(list(data.columns.values())), reading.y)
    reading.save(tmp_path / "camera.csv")
    back = fa.Data.load(tmp_path / "camera.csv")
    assert back.units == data.units
    np.testing.assert_array_equal(back["position y"], data["position y"])


def test_gain_and_offset_come_before_noise_and_steps() -> None:
    """Per component too; the noise is the same that a sensor without them has."""
    run = fa.load("ist").run()
    plain, other = (
        fa.sensors.Encoder(0, pulses=None, noise=1e-3, **more) for more in ({}, {"gain": 1.5, "offset": -0.2})
    )
    angle = fa.sensors.Encoder(0, pulses=None).read(run).y
    noise = plain.read(run).y - angle
    np.testing.assert_allclose(other.read(run).y, 1.5 * angle - 0.2 + noise, atol=1e-14)
    step = fa.sensors.Encoder(0, pulses=100, gain=2.0).read(run).y
    np.testing.assert_allclose(step, np.round(2 * angle / (2 * np.pi / 100)) * (2 * np.pi / 100), atol=1e-14)
    camera = fa.sensors.Camera(gain=(1, 2, 3), offset=(0, 0.1, 0))
    place = fa.sensors.Camera().read(run).y
    np.testing.assert_allclose(camera.read(run).y, place * [1, 2, 3] + [0, 0.1, 0], atol=1e-15)
    sampler, t = other.sampler(run.arm), 7
    rows = [sampler.sample(float(run.t[k]), run.q[k], run.v[k], run.a[k]) for k in range(t)]
    np.testing.assert_allclose(rows, other.read(run).y[:t], atol=1e-12)
    with refuses("gain = (1.0, 2.0)"):
        fa.sensors.Camera(gain=(1, 2)).read(run)
    with refuses("offset = 'x'"):
        fa.sensors.Encoder(offset="x")  # type: ignore[arg-type]
