"""Runs of arms with struts and tendons: what stays, and what forces and dampers do."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import flexarm as fa
import numpy as np
import pytest
from arms import satellite
from scipy.interpolate import make_interp_spline

T = np.linspace(0.0, 0.5, 2001)


def held(damping: float = 0.0, free: bool = True) -> fa.Arm:
    """A satellite whose panels and arm are tied to each other and to the bus."""
    arm = satellite(free=free)
    law = {"stiffness": 500.0, "damping": damping}
    return fa.Arm(
        arm.links,
        struts=[
            fa.Strut(fa.Point("upper", 0.3, (0, 0.05, 0)), "fore", name="lift", **law),
            fa.Strut(("left panel", 1.2), fa.Point("bus", offset=(0.3, 0.2, 0.4)), force=3.0, name="mast", **law),
            fa.Tendon(
                [("right panel", 1.5), fa.Point("bus", "origin", (0.5, 0, 0.3)), ("upper", 0.5), "fore"],
                tension_only=False,
                name="line",
                **law,
            ),
        ],
    )


def started(arm: fa.Arm) -> tuple[np.ndarray, np.ndarray]:
    v = 0.2 * np.random.default_rng(2).normal(size=arm.nv)
    v[arm.joint_rate("shoulder")], v[arm.joint_rate("elbow")] = 0.5, -1.0
    return arm.pose({"shoulder": 0.1, "elbow": -0.4}), v


def integral(t: np.ndarray, y: np.ndarray) -> np.ndarray:
    """From the first time on."""
    return make_interp_spline(t, y, k=5).antiderivative()(t)


def test_momentum_and_energy_of_what_floats_stay() -> None:
    """Springs without dampers; their energy is counted, and the constant force has one by its way."""
    arm = held()
    q0, v0 = started(arm)
    run = fa.simulate(arm, T[::80], q0, v0, integrator="gauss", step=1e-3, rtol=1e-14)
    p = arm.momentum(run.q, run.v)
    energy, length = np.asarray(sum(run.energy())), arm.strut_motion(run.q)[0]
    total = energy - 3.0 * length[:, 1]
    assert np.ptp(length, axis=0).min() > 1e-3  # m: all of them move
    assert np.abs(p - p[0]).max() < 1e-10 * np.abs(p[0]).max()
    assert np.ptp(total) < 1e-9 * np.ptp(energy) + 1e-10 * abs(total[0])


@pytest.mark.parametrize("integrator", ["gauss", "implicit"])
def test_dampers_take_what_is_lost(integrator: str) -> None:
    arm = held(30.0)
    q0, v0 = started(arm)
    step = {"gauss": 1e-3, "implicit": 1e-4}[integrator]
    run = fa.simulate(arm, T, q0, v0, integrator=integrator, step=step)
    p, energy = arm.momentum(run.q, run.v), np.asarray(sum(run.energy()))
    length, rate, _ = arm.strut_motion(run.q, run.v)
    lost = integral(T, 30.0 * (rate**2).sum(1))
    kept = energy - 3.0 * length[:, 1] + lost
    tolerance = {"gauss": 3e-8, "implicit": 1e-4}[integrator]
    assert lost[-1] > 0.05  # J
    assert np.ptp(kept) < tolerance * lost[-1]
    assert np.abs(p - p[0]).max() < {"gauss": 1e-10, "implicit": 1e-5}[integrator] * np.abs(p[0]).max()


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"integrator": "gauss", "step": 1e-3},
        {"integrator": "implicit", "step": 1e-3},
        {"integrator": "ida"},
        {"integrator": "rk4", "step": 1e-4},
    ],
)
def test_a_drive_is_a_constant_force_that_changes(options: dict[str, object]) -> None:
    """A constant drive runs as the field `force`, or `tension`."""
    arm = held(30.0)
    q0, v0 = started(arm)
    t = T[::200]
    driven = fa.simulate(arm, t, q0, v0, drive={"lift": fa.Torque(20.0), "line": fa.Torque(15.0)}, **options)
    lift, mast, line = arm.struts
    there = fa.Arm(arm.links, struts=[replace(lift, force=20.0), mast, replace(line, tension=15.0)])
    expected = fa.simulate(there, t, q0, v0, **options)
    without = fa.simulate(arm, t, q0, v0, **options)
    moved = np.abs(expected.q - without.q).max()
    assert moved > 1e-3
    assert np.abs(driven.q - expected.q).max() < 1e-6 * moved


def test_work_of_a_drive() -> None:
    """What it does is stored, or taken by dampers; the force has corners, where steps end."""
    arm = held(30.0)
    q0, v0 = started(arm)
    at, forces = (0.0, 0.2, 0.3, 0.5), (0.0, 60.0, -40.0, 10.0)
    run = fa.simulate(arm, T, q0, v0, drive={"lift": fa.Torque(at, forces)}, integrator="gauss", step=1e-3)
    length, rate, _ = arm.strut_motion(run.q, run.v)
    power = np.interp(T, at, forces) * rate[:, 0] - 30.0 * (rate**2).sum(1)
    work = np.zeros_like(T)
    for a, b in pairwise(at):
        here = (a - 1e-9 <= T) & (b + 1e-9 >= T)
        work[here] = work[here][0] + integral(T[here], power[here])
    energy = np.asarray(sum(run.energy())) - 3.0 * length[:, 1]
    assert np.ptp(work) > 0.1
    assert np.ptp(energy - work) < 1e-7 * np.ptp(work)
    p = arm.momentum(run.q, run.v)
    assert np.abs(p - p[0]).max() < 1e-10 * np.abs(p[0]).max()


def test_a_rope_goes_slack_and_tight() -> None:
    """A weight on a rope, thrown up: free flight while it is slack, and no tension below zero."""
    mass, stiffness, g = 2.0, 2e3, 9.81
    slide = fa.Link(fa.Prismatic("z"), fa.RigidBody(mass), name="weight")
    rope = fa.Tendon([(0, 0, 1.0), "weight"], stiffness=stiffness, length=1.0)
    arm = fa.Arm([slide], gravity=(0, 0, -g), struts=[rope])
    t = np.linspace(0.0, 0.6, 601)
    up = 1.5  # m/s
    run = fa.simulate(arm, t, [0.0], [up], integrator="gauss", step=2.5e-4)
    flight, w = 2 * up / g, np.sqrt(stiffness / mass)
    swing = (np.pi + 2 * np.arctan(g / (w * up))) / w  # time below: z = -(up/w) sin - (g/w^2)(1 - cos)
    assert flight < 0.32 and flight + swing < t[-1]
    z = np.where(t < flight, up * t - 0.5 * g * t**2, 0.0)
    s = t - flight
    below = (s >= 0) & (s <= swing)
    z[below] = -up / w * np.sin(w * s[below]) - g / w**2 * (1 - np.cos(w * s[below]))
    known = t <= flight + swing
    assert np.abs(run.q[known, 0] - z[known]).max() < 1e-7
    tension = -arm.strut_motion(run.q, run.v)[2][:, 0]
    most = mass * (g + np.hypot(g, w * up))
    assert tension.min() == 0.0 and abs(tension.max() - most) < 0.01
