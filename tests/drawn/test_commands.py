"""Twins that are fitted, inversions that are replayed, moves that are simulated: of arms drawn at random."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from hypothesis import assume

sys.path.insert(0, str(Path(__file__).parent))

from scenes import SEEDS, drawn, note

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")
STEEL = fa.Material(7850, 209e9, 0.3)


def planar(rng: np.random.Generator, most: int, thick: tuple[float, float] = (0.003, 0.012), **joint: Any) -> fa.Arm:
    """Links that turn in the horizontal plane, or under gravity, with a beam each."""
    links = []
    for _ in range(int(rng.integers(1, most + 1))):
        beam = fa.Beam(rng.uniform(0.3, 0.7), fa.Rectangle(rng.uniform(*thick), 0.02), STEEL,
                       {"bending_y": int(rng.integers(1, 3))}, order=2, damping_ratio=0.01)  # fmt: skip
        hub = fa.RigidBody(0.3, inertia=np.eye(3) * rng.uniform(1e-3, 2e-2), end=(0.04, 0, 0))
        links.append(fa.Link(fa.Revolute("z", **joint), hub, beam, fa.RigidBody(rng.uniform(0.05, 0.5))))
    return fa.Arm(links, gravity=(0, -9.81, 0) if rng.random() < 0.4 else (0, 0, 0))


# -- a twin is found again -------------------------------------------------------------------------------------------


@drawn(3, SEEDS)
def test_a_twin_is_found_again(seed: int) -> None:
    """A run of known numbers, by another integrator at tight tolerance and with noise, from starts off by up to a
    factor of two: the true values within five standard deviations, or a word that the data cannot tell them."""
    rng = np.random.default_rng(seed)
    true = {
        "link.0.tip.mass": rng.uniform(0.05, 0.3),
        "link.0.joint.damping": rng.uniform(0.02, 0.2),
        "link.0.beam.material.youngs_modulus": 10.0 ** rng.uniform(10.5, 11.5),
        "link.0.joint.reflected_inertia": rng.uniform(0.01, 0.05),
        "drive.0.scale": rng.uniform(0.8, 1.2),
    }
    length, thick, hub = rng.uniform(0.3, 0.6), rng.uniform(0.0015, 0.004), rng.uniform(0.0, 1e-2)
    t = np.linspace(0.0, 0.6, 121)
    low, up, size = rng.uniform(0.5, 2), rng.uniform(2, 5), rng.uniform(0.1, 0.5)

    def scene(values: dict[str, float], scale: float = 1.0) -> fa.Scene:
        m, c, E, J = list(values.values())[:4]
        beam = fa.Beam(length, fa.Rectangle(thick, 0.02), fa.Material(7850, E, 0.3), {"bending_y": 2}, "legendre",
                       damping_ratio=0.01)  # fmt: skip
        joint = fa.Revolute("z", damping=c, reflected_inertia=J)
        arm = fa.Arm([fa.Link(joint, fa.RigidBody(0.2, inertia=np.eye(3) * (1e-4 + hub)), beam, fa.RigidBody(m))])
        torque = scale * size * np.sin(2 * np.pi * (low + up * t) * t)
        sensors = (fa.sensors.Encoder(0, pulses=None), fa.sensors.StrainGauge(0, 0.01))
        return fa.Scene(arm, {0: fa.Torque(t, torque)}, t=t, sensors=sensors)

    twin = scene(true, true["drive.0.scale"])
    run = fa.simulate(twin.arm, t, drive=twin.drive, rtol=1e-9, atol=1e-11)
    noise = {"angle": 1e-4, "strain": 1e-6}
    columns = {name: s.read(run).y[:, 0] + noise[name] * rng.normal(size=len(t))
               for name, s in zip(noise, twin.sensors, strict=True)}  # fmt: skip
    sought = list(rng.permutation(list(true))[: rng.integers(1, 4)])
    asked = {k: 1.0 if k == "drive.0.scale" else true[k] * 2.0 ** rng.uniform(-1, 1) for k in sought}
    first = scene({**true, **asked}, 1.0 if "drive.0.scale" in asked else true["drive.0.scale"])
    data = fa.Data(t, columns, {"angle": "rad", "strain": "1"})
    fit = fa.identify(first, data, asked, outputs={"angle": "sensor.0", "strain": "sensor.1"}, noise=noise)
    for name in sought:
        if fit.untold or name in fit.at_bounds:
            note("numbers that data cannot tell")
            continue
        assert abs(fit.values[name] - true[name]) < 5 * fit.std[name] + 1e-4 * true[name], name
        note("numbers found")


# -- an inversion is replayed ----------------------------------------------------------------------------------------


@drawn(3, SEEDS)
def test_an_inversion_replayed_follows_its_path(seed: int) -> None:
    """The joints' motions, in a run by IDA: the tip is on the path, and the torques are those that were told."""
    rng = np.random.default_rng(seed)
    arm = planar(rng, 2, thick=(0.004, 0.02))
    n = len(arm.links)
    q = arm.zero
    joints = [arm.joint_rate(k) for k in range(n)]
    q[joints] = rng.uniform(-1, 1, n) + 1.2 * (np.arange(n) > 0)
    place = arm.frame(arm.equilibrium(q, lock=range(n)))[0]
    s = np.linspace(0, 1, 81)
    rise = s**5 * (126 - 420 * s + 540 * s**2 - 315 * s**3 + 70 * s**4)
    T = rng.uniform(0.4, 1.5)
    if n == 1:
        angle = float(np.arctan2(place[1], place[0]))
        tip: dict[str, Any] = {"azimuth": fa.Motion(s * T, angle + rng.uniform(-1, 1) * rise, ends="rest")}
    else:
        by = rng.uniform(-0.08, 0.08, 2)
        tip = {name: fa.Motion(s * T, place[k] + by[k] * rise, ends="rest") for k, name in enumerate("xy")}
    try:
        found = fa.invert(arm, tip, q=q)
    except ValueError as e:
        assert str(e)
        assume(False)
    run = found.replay()
    p = run.frame()[0]
    seen = np.unwrap(np.arctan2(p[:, 1], p[:, 0]))[:, None] if n == 1 else p[:, :2]
    reach = 1.0 if n > 1 else 1.0 / np.linalg.norm(place)
    assert np.abs(seen - found.wanted).max() < (2e-6 + 10 * found.edge) * reach
    inner = slice(5, -5)
    tau = run.tau[inner, joints[0]] if n == 1 else run.tau[inner][:, joints]
    told = found.tau[inner, joints[0]] if n == 1 else found.tau[inner][:, joints]
    assert np.abs(tau - told).max() < 2e-3 * np.abs(found.tau).max()
    note(f"of {n} links")


# -- a move keeps its limits -----------------------------------------------------------------------------------------


@drawn(2, SEEDS)
def test_a_move_keeps_its_limits_and_leaves_little(seed: int) -> None:
    """Simulated here by IDA: torques and speeds within limits, little swing after it, and the arm where it was sent.
    Where it says that it does not, that is said."""
    rng = np.random.default_rng(seed)
    arm = planar(rng, 2)
    n = len(arm.links)
    start, way = rng.uniform(-1, 1, n), rng.uniform(0.2, 1.5, n) * rng.choice([-1, 1], n)
    joints = [arm.joint_rate(k) for k in range(n)]
    q0, q1 = arm.zero, arm.zero
    q0[joints], q1[joints] = start, start + way
    J = np.diag(arm.mass_matrix(arm.zero))[joints]
    held = max(np.abs(arm.bias(q, np.zeros(arm.nv))[joints]).max() for q in (arm.zero, q0, q1))
    limits: dict[str, Any] = {"torque": 1.5 * held + J * rng.uniform(3, 30)}
    if rng.random() < 0.5:
        limits["speed"] = float(rng.uniform(1.0, 4.0))
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            move = fa.plan_move(arm, start, start + way, limits=limits)
        except ValueError as e:
            assert str(e)
            assume(False)
    told = [str(w.message) for w in said if issubclass(w.category, fa.errors.MoveWarning)]
    lock = list(range(n))
    first, last = arm.equilibrium(q0, lock=lock), arm.equilibrium(q1, lock=lock)
    t = np.unique(np.concatenate([np.linspace(0, move.duration, 400), move.duration + np.linspace(0, 1.0, 300)]))
    run = fa.simulate(arm, t, first, drive=move.drive, rtol=1e-8, atol=1e-10)
    over = np.abs(run.tau[:, joints]).max(axis=0) / limits["torque"] - 1
    assert (over < 0.01).all() or any("torque" in x for x in told)
    if "speed" in limits:
        assert np.abs(run.v[:, joints]).max() < 1.001 * limits["speed"]
    np.testing.assert_allclose(run.q[-1, joints], start + way, atol=1e-9)
    after = run.frame()[0][t >= move.duration]
    swing = np.linalg.norm(after - arm.frame(last)[0], axis=1).max()
    assert swing == pytest.approx(move.residual, rel=0.2, abs=1e-6)
    assert move.residual < 0.05 * move.residual_unshaped + 1e-3 * np.linalg.norm(arm.frame(last)[0]) * 0.1 or any(
        "vibration" in x for x in told)  # fmt: skip
    note("moves that keep all" if not told else "moves that say what they do not keep")
