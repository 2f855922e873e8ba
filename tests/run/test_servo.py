"""fa.Servo against a drive that is written by hand, in every way to run, and as it is saved."""

from __future__ import annotations

import math
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from messages import refuses
from scipy.linalg import expm

J, B = 0.4, 0.3  # kg m², N m s/rad
RATE = 500.0
T = np.linspace(0, 0.6, 301)
RIGID = fa.Arm([fa.Link(fa.Revolute("z", damping=B), fa.RigidBody(inertia=(1, 1, J)))])
DRIVE: dict[str, Any] = {
    "kp": 90.0, "kv": 9.0, "ki": 300.0, "rate": RATE, "sensor": fa.sensors.Encoder(pulses=2500, quadrature=True),
    "filter": 60.0, "delay": 1.3e-3, "limit": 12.0, "current_loop": 150.0,
}  # fmt: skip


def led(t: float) -> tuple[float, float]:
    """A turn and its rate: the quintic of MOVE."""
    s = min(t / 0.3, 1.0)
    return 0.4 * s**3 * (10 - 15 * s + 6 * s**2), 0.4 / 0.3 * 30 * s**2 * (1 - s) ** 2


MOVE = fa.Motion([0, 0.3, 0.6], [0, 0.4, 0.4], [0, 0, 0], [0, 0, 0])


def by_hand(q0: float, push: float) -> np.ndarray:
    """Angles at T, and how many samples were at the limit: exact between samples, one number at a time."""
    h, n = 1 / RATE, len(T) - 1
    w = 2 * math.pi * DRIVE["current_loop"]
    # angle, rate, torque of the current loop, command, constant push
    flow = np.zeros((5, 5))
    flow[0, 1], flow[1, [1, 2, 4]], flow[2, [2, 3]] = 1.0, [-B / J, 1 / J, 1 / J], [-w, w]
    early, late = expm(flow * DRIVE["delay"]), expm(flow * (h - DRIVE["delay"]))
    step = 2 * math.pi / 10000
    fresh = 1 - math.exp(-2 * math.pi * DRIVE["filter"] * h)
    back = h / math.sqrt(DRIVE["kv"] / DRIVE["ki"])
    x, y_before, v, integral, cut = np.array([q0, 0, 0, 0, push]), math.nan, 0.0, 0.0, 0
    out = [q0]
    for k in range(n):
        y = math.floor(x[0] / step + 0.5) * step
        r, rate = led(k * h)
        v += fresh * ((0.0 if k == 0 else (y - y_before) / h) - v)
        y_before = y
        integral += DRIVE["ki"] * h * (r - y)
        wanted = DRIVE["kp"] * (r - y) + integral + DRIVE["kv"] * (rate - v)
        u = min(max(wanted, -DRIVE["limit"]), DRIVE["limit"])
        integral += back * (u - wanted)
        cut += u != wanted
        x = early @ x
        x[3] = u
        x = late @ x
        out.append(x[0])
    assert 20 < cut < n - 100
    return np.array(out)


@pytest.mark.parametrize(
    ("options", "near"),
    [
        ({"integrator": "gauss", "step": 1e-3}, 1e-9),
        ({}, 1e-6),
        ({"integrator": "implicit", "step": 2e-5}, 2e-6),
        ({"integrator": "rk4", "step": 1e-4}, 1e-9),
        ({"integrator": "ida", "rtol": 1e-9, "atol": 1e-12}, 1e-6),
    ],
    ids=str,
)
def test_it_is_the_drive_that_is_written_by_hand(options: dict[str, Any], near: float) -> None:
    push = fa.Torque(-1.5)
    got = fa.simulate(RIGID, T, [0.2], drive={0: push}, control=fa.Servo(0, **DRIVE, reference=MOVE), **options)
    assert abs(got.q[:, 0] - by_hand(0.2, -1.5)).max() < near


STEEL = fa.Material(7850, 209e9, 0.3)
BEAM = fa.Beam(0.4, fa.Rectangle(0.004, 0.03), STEEL, {"bending_y": 2}, "legendre", damping_ratio=0.01)
BENT = fa.Arm(
    [
        fa.Link(fa.Revolute("z", reflected_inertia=0.05), beam=BEAM, tip=fa.RigidBody(0.3)),
        fa.Link(fa.Revolute("z", reflected_inertia=0.02, torque_limit=8.0), beam=BEAM, tip=fa.RigidBody(0.2)),
    ],
    gravity=(0, -9.81, 0),
)


def servos(kp: float = 60, **more: Any) -> list[fa.Servo]:
    each = {"rate": 1000, "filter": fa.sensors.LowPass(80, 2), "limit": 20.0, "ki": 30.0, **more}
    sensor = fa.sensors.Encoder(pulses=4096, quadrature=True, gear_ratio=50)
    return [
        fa.Servo(0, kp=kp, kv=6, sensor=sensor, reference=MOVE, **each),
        fa.Servo(1, kp=20, kv=2, sensor=sensor, reference=-0.3, current_loop=200, **each),
    ]


def test_the_encoder_is_on_the_joint_and_goes_by_the_core() -> None:
    one, two = servos()
    assert [s.measure[0].link for s in (one, two)] == [0, 1]
    load_side = fa.Servo(0, kp=1, kv=1, rate=100, sensor=fa.sensors.Encoder(1))
    assert load_side.measure[0].link == 1
    fine = fa.Servo(0, kp=60, kv=6, rate=1000, sensor=fa.sensors.Encoder(pulses=None, offset=0.01, gain=1.01))
    same = fa.Servo(0, kp=60, kv=6, rate=1000, sensor=fa.sensors.Encoder(pulses=None, offset=0.01, gain=1.01, range=9))
    # a range is Python's: both ways are one law
    found = [fa.simulate(BENT, T, control=s, integrator="gauss", step=1e-3).q for s in (fine, same)]
    assert abs(found[0] - found[1]).max() < 1e-12
    assert abs(found[0][:, 0]).max() > 1e-3


def test_the_limit_of_the_joint_holds_and_the_integral_does_not_wind_up() -> None:
    far = {"kp": 40.0, "kv": 6.0, "ki": 50.0, "rate": 1000, "reference": 1.0}
    strong = fa.Arm([fa.Link(fa.Revolute("z", torque_limit=2.0), fa.RigidBody(inertia=(1, 1, J)))])
    t = np.linspace(0, 4, 401)
    runs = [fa.simulate(strong, t, control=fa.Servo(0, **far, tracking_time=x), step=1e-3) for x in (None, 1e6)]
    assert abs(runs[0].tau).max() == 2.0
    over = [r.q[:, 0].max() - 1.0 for r in runs]
    assert over[0] < 0.1
    assert over[1] > 1.5


def test_at_rest_it_is_switched_on_without_a_kick() -> None:
    still = fa.Servo(0, kp=0, kv=50, rate=1000, filter=100)
    run = fa.simulate(RIGID, T, [0.7], control=still)
    assert abs(run.tau).max() == 0.0


def test_feedforward_knows_the_references_of_all_servos() -> None:
    start, off = BENT.equilibrium({1: -0.3}, lock=[0, 1]), {}
    for word in (None, "gravity", "motion"):
        run = fa.simulate(BENT, T, start, control=servos(feedforward=word))
        off[word] = abs(run.q[:, 0] - [led(t)[0] for t in T]).max()
        if word:
            needed = fa.FeedForward([MOVE, -0.3], inertia=word == "motion").forces(BENT, [0.0])[0]
            # an encoder tells the first sample that all is where it should be
            assert run.tau[0, 0] == pytest.approx(needed[0], abs=60 * 2e-5)
    assert off["gravity"] < 0.6 * off[None]
    assert off["motion"] < 0.5 * off["gravity"]
    with refuses("feedforward = 'friction'", "gravity", "motion"):
        fa.Servo(0, kp=1, kv=1, rate=100, feedforward="friction")


def test_torques_and_moves_are_added() -> None:
    plain = {"kp": 0.0, "kv": 0.0, "rate": 1000}
    tau = (T[[0, -1]], [0.5, 1.0])
    run = fa.simulate(RIGID, T, control=fa.Servo(0, **plain, feedforward=tau), step=1e-3)
    t = np.minimum(np.floor(T * 1000 + 1e-6) / 1000, T[-1])
    assert run.tau[:, 0] == pytest.approx(0.5 + 0.5 * t / T[-1], abs=1e-9)
    move = fa.plan_move(RIGID, [0.0], [0.5], limits={"torque": 2.0})
    led_by = fa.Servo(0, kp=50, kv=5, rate=2000, reference=move.drive[0], feedforward=move)
    t = np.linspace(0, move.duration + 0.2, 201)
    run = fa.simulate(RIGID, t, control=led_by, step=5e-4)
    assert run.q[-1, 0] == pytest.approx(0.5, abs=2e-4)
    assert abs(run.q[:, 0] - [move.drive[0](x)[0] for x in t]).max() < 2e-3


def test_batches_in_lanes_and_threads_are_single_runs() -> None:
    kp = np.linspace(30, 90, 8)
    batch = fa.simulate_batch(BENT, T, control=servos(), step=1e-3, parameters={"control.0.kp": kp})
    assert batch.stats["lanes"] > 1
    for k in (0, 7):
        one = fa.simulate(BENT, T, control=servos(kp[k]), integrator="implicit", step=1e-3)
        assert abs(batch[k].q - one.q).max() < 1e-9


def test_a_scene_file_and_a_compiled_scene_keep_it(tmp_path: Any) -> None:
    moved = servos(feedforward="gravity")
    more = fa.Servo((1, 0), kp=1.0, kv=0.1, rate=500, feedforward=fa.Torque(T[[0, -1]], [0, 0.1]), tracking_time=0.2)
    scene = fa.Scene(BENT, t=T, control=(*moved, more), options={"integrator": "implicit", "step": 1e-3})
    file = tmp_path / "drive.toml"
    scene.save(file)
    back = fa.load(file)
    assert 'type = "servo"' in file.read_text()
    assert "type = \"encoder\"" in file.read_text()
    assert list(map(repr, back.control)) == list(map(repr, scene.control))
    want = scene.run().q
    assert abs(back.run().q - want).max() < 1e-12
    scene.compile(tmp_path / "drive.json")
    text = (tmp_path / "drive.json").read_text()
    assert '"resolution":[' in text


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"rate": 0}, "rate"),
        ({"filter": -1}, "filter = -1"),
        ({"current_loop": 0}, "current_loop"),
        ({"tracking_time": 1e-4}, "tracking_time"),
        ({"sensor": fa.sensors.Tachometer(0)}, "sensor"),
        ({"kp": np.nan}, "kp"),
        ({"reference": MOVE, "reference_rate": 1.0}, "reference_rate"),
    ],
    ids=str,
)
def test_what_is_wrong_is_named(bad: dict[str, Any], message: str) -> None:
    with refuses(message):
        fa.Servo(0, **{"kp": 1.0, "kv": 1.0, "ki": 1.0, "rate": 1000, **bad})


def test_feedforward_by_a_callable_reference_is_refused() -> None:
    law = fa.Servo(0, kp=1, kv=1, rate=100, reference=lambda t: t, feedforward="gravity")
    with refuses("feedforward", "gravity", "Motion"):
        fa.simulate(RIGID, T, control=law)


@pytest.mark.parametrize("options", [{"integrator": "implicit", "step": 1e-3}, {"integrator": "gauss", "step": 1e-3}])
def test_derivatives_know_that_the_first_sample_finds_it_at_rest(options: dict[str, Any]) -> None:
    law = fa.Servo(1, kp=20, kv=4, ki=30, rate=200, filter=40, delay=2e-3, current_loop=80)

    def run(elbow: float, kv: float = 4.0) -> fa.Result:
        moved = fa.Servo(1, kp=20, kv=kv, ki=30, rate=200, filter=40, delay=2e-3, current_loop=80)
        return fa.simulate(BENT, T[:61], [0, 0, 0, elbow, 0, 0], control=moved, **options)

    result, d = fa.simulate(BENT, T[:61], [0, 0, 0, 0.3, 0, 0], control=law, **options), 1e-5
    paths = ["q0.3", "control.0.kv"]
    slopes = [(run(0.3 + d).q - run(0.3 - d).q) / (2 * d), (run(0.3, 4 + d).q - run(0.3, 4 - d).q) / (2 * d)]
    weights = np.random.default_rng(0).uniform(size=result.q.shape)
    found, back = result.sensitivities(paths), result.gradient({"q": weights}, paths)
    for k, path in enumerate(paths):
        assert abs(found.q[k] - slopes[k]).max() < 1e-5 * abs(slopes[k]).max()
        assert back[path] == pytest.approx((weights * slopes[k]).sum(), rel=1e-5)
