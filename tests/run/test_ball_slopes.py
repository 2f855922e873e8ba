"""Derivatives of runs with balls: against a closed form, and against differences of runs."""

from __future__ import annotations

from typing import Any

import flexarm as fa
import numpy as np
import pytest
from arms import derivative
from messages import refuses

STEEL = fa.Material(7850.0, 209e9, 0.3)
WAYS = {
    "ida": ({"rtol": 1e-10, "atol": 1e-13}, 1e-4),
    "gauss": ({"integrator": "gauss", "step": 4e-3, "rtol": 1e-14}, 1e-7),
    "one stage": ({"integrator": "gauss", "step": 4e-3, "rtol": 1e-14, "stages": 1}, 1e-7),
    "implicit": ({"integrator": "implicit", "step": 1e-3, "rtol": 1e-13}, 1e-6),
    "damped": ({"integrator": "implicit", "step": 1e-3, "rtol": 1e-13, "spectral_radius": 0.8}, 1e-5),
    "rk4": ({"integrator": "rk4", "step": 1e-4}, 1e-7),
}
ROWS = ("q", "v", "a", "tau")
SIZES = {"mass": 0.1, "turn": 2.0, "damping": 0.02, "length": 0.3}


@pytest.mark.parametrize("way", WAYS)
def test_a_top_turns_at_its_rate(way: str) -> None:
    """Of equal moments of inertia I its rate w dies out: it turns by w (1 - exp(-c t / I)) I / c."""
    inertia, damping, rate = 0.02, 0.05, np.array([0.6, -0.8, 1.1])
    arm = fa.Arm([fa.Link(fa.Spherical(damping=damping), fa.RigidBody(1.0, inertia=(inertia,) * 3))])
    t = np.linspace(0, 0.5, 26)
    options = {**WAYS[way][0], **({} if way == "ida" else {"step": 2e-3})}
    found = fa.simulate(arm, t, v0=rate, **options).sensitivities(["v0.2", "link.0.joint.damping"])

    def quaternion(w: np.ndarray, c: Any) -> np.ndarray:
        u = np.outer((1 - np.exp(-c * t / inertia)) * inertia / c, w)
        half = np.sqrt((u**2).sum(axis=1))[:, None] / 2
        return np.hstack([np.cos(half), np.sin(half) / half / 2 * u])

    with np.errstate(invalid="ignore"):
        expected = [quaternion(rate + 1e-30j * np.eye(3)[2], damping), quaternion(rate, damping + 1e-30j)]
    rough = 2e-5 if way in ("one stage", "implicit", "damped") else 1e-6
    for k, x in enumerate(expected):
        by = x.imag[1:] / 1e-30
        assert np.abs(found.q[k, 1:] - by).max() < rough * np.abs(by).max(), k


def spun(**given: float) -> dict[str, Any]:
    """A flexible link on a floating base, and a body on a ball at its end."""
    at = {**SIZES, **given}
    modes = {"bending_y": 1, "bending_z": 1}
    beam = fa.Beam(at["length"], fa.Rectangle(0.004, 0.02), STEEL, modes, "legendre", "exact", damping_ratio=0.01)
    links = [fa.Link(fa.Free(), fa.RigidBody(0.5, inertia=(0.01, 0.012, 0.008), end=(0.1, 0, 0)))]
    links += [fa.Link(fa.Revolute("z", damping=at["damping"]), fa.RigidBody(0.2, inertia=(1e-3,) * 3), beam)]
    body = fa.RigidBody(at["mass"], (0.05, 0.01, 0), inertia=(3e-4, 4e-4, 5e-4))
    links += [fa.Link(fa.Spherical(damping=0.01), body)]
    arm = fa.Arm(links, gravity=(0, 0, -9.81))
    v0 = [0.2, 0.1, 0.3, 1.0, at["turn"], 3.0, -2.0, 0, 0, 0.5, -3.0, 1.0]
    return {
        "arm": arm, "t": np.linspace(0, 0.04, 11), "v0": v0, "drive": {1: fa.Torque([0, 0.04], [0.0, 0.3])},
        "control": fa.PD(2.0, 0.1, 1, reference=0.3),
        "loads": [fa.Load(-1, force=(0.1, 0.2, 0.3))],
    }  # fmt: skip


PATHS = {"mass": "link.2.hub.mass", "turn": "v0.4", "damping": "link.1.joint.damping", "length": "link.1.beam.length"}


@pytest.mark.parametrize("way", WAYS)
def test_a_floating_arm_equals_differences(way: str) -> None:
    options, rough = WAYS[way]
    run = fa.simulate(**spun(), **options)
    found = run.sensitivities(list(PATHS.values()))
    assert found.q.shape == (4, 11, run.arm.nq)
    few = ("mass",) if way == "ida" else ("mass", "turn") if way in ("rk4", "one stage", "damped") else tuple(PATHS)
    for name in few:

        def stacked(x: float, name: str = name) -> np.ndarray:
            result = fa.simulate(**spun(**{name: x}), **options)
            return np.hstack([getattr(result, rows) for rows in ROWS])

        x = derivative(stacked, SIZES[name], 1e-3 * SIZES[name])
        for rows, by in zip(ROWS, np.split(x, np.cumsum([run.q.shape[1], *[run.arm.nv] * 2]), axis=1), strict=True):
            far = np.abs(getattr(found, rows)[list(PATHS).index(name)] - by).max()
            assert far < (100 if rows == "a" else 10) * rough * np.abs(by).max() + 1e-12, (name, rows)
    rng = np.random.default_rng(1)
    weights = {rows: rng.normal(size=getattr(run, rows).shape) for rows in ROWS}
    gradient = run.gradient(weights, [*PATHS.values(), "q0.4", "v0", *([] if way == "ida" else ["q0"])])
    for k, path in enumerate(PATHS.values()):
        parts = [(w * getattr(found, rows)[k]).sum() for rows, w in weights.items()]
        assert abs(gradient[path] - sum(parts)) < (1e-6 if way == "ida" else 5e-9) * max(np.abs(parts)), path
    assert gradient["v0"][4] == pytest.approx(gradient["v0.4"], rel=1e-9)
    if way != "ida":
        assert gradient["q0"].shape == (run.arm.nq,) and gradient["q0"][4] == pytest.approx(gradient["q0.4"], rel=1e-8)


def test_what_is_read_of_a_run() -> None:
    """The tip's place, through rows that are differentiated and the length itself."""
    options = WAYS["gauss"][0]
    found = fa.simulate(**spun(), **options).sensitivities([PATHS["length"]])
    mine = found.of(lambda result, _: result.frame()[0])[0]
    expected = derivative(lambda x: fa.simulate(**spun(length=x), **options).frame()[0], SIZES["length"], 3e-5)
    assert np.abs(mine - expected).max() < 1e-6 * np.abs(expected).max()


def test_an_event_by_ida() -> None:
    def run(mass: float) -> fa.Result:
        def event(t: float, q: np.ndarray, v: np.ndarray) -> float:
            return float(q[4] - 0.005)

        return fa.simulate(**spun(mass=mass), events=event, rtol=1e-10, atol=1e-13)

    base = run(0.1)
    assert len(base.t_events[0]) == 1
    found = base.sensitivities([PATHS["mass"]])
    for name in ("t_events", "q_events", "v_events"):
        expected = derivative(lambda x, n=name: getattr(run(x), n)[0], 0.1, 1e-4)
        assert np.abs(getattr(found, name)[0][0] - expected).max() < 1e-4 * np.abs(expected).max(), name
    fixed = fa.simulate(**spun(), events=lambda t, q, v: q[4] - 0.005, **WAYS["implicit"][0])
    with refuses('"ida"', "alone"):
        fixed.sensitivities([PATHS["mass"]])
