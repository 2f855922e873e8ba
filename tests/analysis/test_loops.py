"""Equilibria, modes, linear models and loops of control of arms whose loops are closed."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from arms import STEEL, derivative
from messages import refuses, warns
from scipy.optimize import minimize_scalar

G = (0, -9.81, 0)
FOOT = fa.Loop((0.7, 0, 0), "rocker", fa.Revolute("z"), name="foot")
LENGTHS = {"crank": 0.2, "coupler": 0.6, "rocker": 0.5}


def bar(length: float) -> fa.RigidBody:
    return fa.RigidBody(1.0, (0.5 * length, 0, 0), (0.001, 0.02, 0.02), (length, 0, 0))


def beam(length: float) -> fa.Beam:
    return fa.Beam(length, fa.Rectangle(0.006, 0.02), STEEL, {"bending_y": 2}, "legendre", damping_ratio=0.01)


def four_bar(*loops: fa.Loop, bends: bool = False, **joint: Any) -> fa.Arm:
    links = [fa.Link(fa.Revolute("z", **joint), *((None, beam(x)) if bends else (bar(x),)), name=name)
             for name, x in LENGTHS.items()]  # fmt: skip
    return fa.Arm(links, G, loops=loops or (FOOT,))


def turned(arm: fa.Arm, crank: float) -> np.ndarray:
    return arm.assemble({"crank": crank, "coupler": 0.6 - crank, "rocker": -2.0}, hold=["crank"])


def test_an_equilibrium_has_the_least_energy_of_all_closed_positions() -> None:
    arm = four_bar(stiffness=0.3)

    def energy(crank: float) -> float:
        return float(arm.energy(turned(arm, crank), np.zeros(3))[1])

    least = minimize_scalar(energy, bounds=(-2.5, -1.0), method="bounded", options={"xatol": 1e-10})
    q = arm.equilibrium(turned(arm, -1.0))
    assert q[0] == pytest.approx(least.x, abs=1e-6) and energy(q[0]) <= least.fun + 1e-12
    assert abs(arm.loop_motion(q)[0]).max() < 1e-13
    np.testing.assert_allclose(arm.forward_dynamics(q, np.zeros(3)), 0.0, atol=1e-9)
    held = arm.equilibrium({"crank": 0.4, "coupler": 0.2, "rocker": -2.0}, lock=["crank"])
    assert held[0] == 0.4 and abs(arm.loop_motion(held)[0]).max() < 1e-13


def test_one_freedom_swings_as_its_energies_tell() -> None:
    arm = four_bar(stiffness=0.3)
    q = arm.equilibrium(turned(arm, -1.0))
    h, still = 1e-4, np.zeros(3)
    near = [arm.energy(arm.assemble(q + s * np.eye(3)[0], hold=["crank"]), still)[1] for s in (-h, 0.0, h)]
    _, v = arm.assemble(q, [1.0, 0, 0], hold=["crank"])
    stiffness, mass = (near[0] - 2 * near[1] + near[2]) / h**2, 2 * arm.energy(q, v)[0]
    modes = arm.modes(q)
    assert modes.frequencies == pytest.approx([np.sqrt(stiffness / mass)], rel=1e-6)
    np.testing.assert_allclose(modes.shapes[:, 0] / modes.shapes[0, 0], v, rtol=1e-9)
    np.testing.assert_allclose(arm.loop_jacobian(q) @ modes.shapes, 0.0, atol=1e-12)
    assert modes.participation.sum() == pytest.approx(1.0)


def test_rigid_loops_are_the_limit_of_stiff_ones() -> None:
    """Equilibria, frequencies and poles of a four-bar of beams whose last hinge gives way ever less."""
    rigid = four_bar(bends=True)
    q = rigid.equilibrium(turned(rigid, 0.5), lock=["crank"])
    wanted = rigid.modes(q, lock=["crank"])
    assert len(wanted.frequencies) == 6
    errors = []
    for k in (1e8, 1e9):
        soft = four_bar(replace(FOOT, stiffness=k, angular_stiffness=1e6), bends=True)
        at = soft.equilibrium(q, lock=["crank"])
        found = soft.modes(at, lock=["crank"])
        errors.append([abs(at - q).max(), abs(found.frequencies[:6] / wanted.frequencies - 1).max()])
    np.testing.assert_allclose(errors[0], 10 * np.array(errors[1]), rtol=0.1)
    assert max(errors[1]) < 1e-4


@pytest.mark.parametrize("moves", [False, True])
def test_a_linear_model_is_that_of_differences_along_the_loops(moves: bool) -> None:
    arm = four_bar(bends=True, damping=0.02)
    q = turned(arm, 0.6)
    q[[1, 4, 7]] = [0.1, -0.2, 0.15]
    q = arm.assemble(q, hold=["crank"])
    v = arm.assemble(q, np.array([3.0, 0.5, -1, 0, 1, 2, 0, -0.3, 0.2]) * moves, hold=["crank"])[1]
    tau = arm.bias(q, v)
    model = arm.linearize(q, v, inputs=["crank"], outputs=[("tip", "coupler"), ("accelerometer", "coupler")], tau=tau)
    n = len(model.states) // 2
    assert n == 7 and len(model.A) == 14
    own = [arm.coordinates.index(x) for x in model.states[:n]]
    rest = [i for i in range(9) if i not in own]
    assert [arm.coordinates[i] for i in rest] == ["coupler revolute", "rocker revolute"]

    def state(x: np.ndarray, u: float) -> tuple[np.ndarray, np.ndarray]:
        """Its slope, and the outputs."""
        at, rates = q.copy(), v.copy()
        at[own], rates[own] = x[:n], x[n:]
        for _ in range(20):  # the others close the loop
            J, g = arm.loop_jacobian(at)[:2], arm.loop_motion(at)[0][:2]
            at[rest] -= np.linalg.solve(J[:, rest], g)
        J = arm.loop_jacobian(at)[:2]
        rates[rest] = -np.linalg.solve(J[:, rest], J[:, own] @ rates[own])
        a = arm.forward_dynamics(at, rates, tau + u * np.eye(9)[0])
        reads = arm.frame(at, "coupler")[1].T @ (arm.acceleration(at, rates, a, "coupler")[:3] - np.array(G))
        return np.concatenate([rates[own], a[own]]), np.concatenate([arm.frame(at, "coupler")[0], reads])

    x0, h = np.concatenate([q[own], v[own]]), 1e-5
    slopes = [[(a - b) / (2 * h) for a, b in zip(state(x0 + h * e, 0.0), state(x0 - h * e, 0.0), strict=True)]
              for e in np.eye(2 * n)]  # fmt: skip
    by_u = [(a - b) / 2 for a, b in zip(state(x0, 1.0), state(x0, -1.0), strict=True)]
    for found, wanted in (
        (model.A, np.array([s[0] for s in slopes]).T), (model.C, np.array([s[1] for s in slopes]).T),
        (model.B[:, 0], by_u[0]), (model.D[:, 0], by_u[1]),
    ):  # fmt: skip
        size = np.abs(wanted).max(axis=-1, keepdims=True)  # of a row: rates of stiff beams are 1e8 times joints'
        assert (np.abs(found - wanted) <= 2e-6 * np.maximum(size, 1)).all()


def test_an_equilibrium_of_beams_that_stretch_is_found_from_afar() -> None:
    steps = {"bending_y": 2, "extension": 1}
    links = [fa.Link(fa.Revolute("z"), beam=replace(beam(x), modes=steps), name=name) for name, x in LENGTHS.items()]
    arm, stiff = fa.Arm(links, G, loops=[FOOT]), four_bar(bends=True)
    low, other = (x.equilibrium(turned(x, 0.5)) for x in (arm, stiff))
    joints = [arm.coordinates.index(f"{name} revolute") for name in LENGTHS]
    same = [stiff.coordinates.index(f"{name} revolute") for name in LENGTHS]
    np.testing.assert_allclose(low[joints], other[same], atol=1e-6)
    assert np.abs(arm.loop_motion(low)[0]).max() < 1e-12


@pytest.mark.parametrize("stiffness", [1e4, 1e7])
def test_an_equilibrium_on_compliant_loops_is_found_from_afar(stiffness: float) -> None:
    soft = four_bar(fa.Loop((0.7, 0, 0), "rocker", fa.Spherical(), stiffness=stiffness), bends=True)
    stiff = four_bar(bends=True)
    start = turned(stiff, 0.5)
    low, other = soft.equilibrium(start), stiff.equilibrium(start)
    force = -stiffness * soft.loop_motion(low)[0]
    assert np.linalg.norm(force) < 3 * 9.81 * sum(link.mass for link in soft.links)
    np.testing.assert_allclose(low, other, atol=100 / stiffness)
    assert soft.energy(low, np.zeros(9))[1] <= soft.energy(other, np.zeros(9))[1] + 1e-9


@pytest.mark.parametrize("rate", [0.0, 1.0, 5.0])
def test_a_linear_model_out_of_balance_is_that_of_differences(rate: float) -> None:
    """Of a rigid four-bar, whose crank is its one freedom."""
    arm = four_bar()
    q = turned(arm, 0.6)

    def acceleration(crank: float, at: float) -> float:
        closed = arm.assemble({**dict(zip(arm.names, q, strict=True)), "crank": crank}, hold=["crank"])
        return arm.forward_dynamics(*arm.assemble(closed, np.array([at, 0, 0]), hold=["crank"]))[0]

    by_q = derivative(lambda x: acceleration(x, rate), q[0], 1e-3)
    by = by_q, derivative(lambda x: acceleration(q[0], x), rate, 1e-3)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.errors.StateWarning)
        model = arm.linearize(*arm.assemble(q, np.array([rate, 0, 0]), hold=["crank"]), tau=np.zeros(3))
    assert model.states[0] == "crank revolute"
    np.testing.assert_allclose(model.A, [[0, 1], by], atol=1e-6 * np.abs(by).max())


def test_a_locked_crank_is_no_state_and_its_torque_is_told() -> None:
    arm = four_bar(bends=True)
    q = arm.equilibrium(turned(arm, 0.5), lock=["crank"])
    model = arm.linearize(q, lock=["crank"], inputs=["rocker"])
    assert len(model.states) == 12 and not any("crank revolute" in x for x in model.states)
    found = np.sort(np.abs(np.linalg.eigvals(model.A)))[::2]
    np.testing.assert_allclose(found, arm.modes(q, lock=["crank"]).frequencies, rtol=1e-8)
    work = [arm.energy(arm.equilibrium(turned(arm, 0.5 + s), lock=["crank"]), np.zeros(9))[1] for s in (-1e-3, 1e-3)]
    assert model.tau[0] == pytest.approx((work[1] - work[0]) / 2e-3, rel=1e-5) and not model.tau[1:].any()
    np.testing.assert_allclose(model.a, 0.0, atol=1e-6)


def test_poles_of_a_controlled_crank_are_those_of_its_linear_model() -> None:
    arm = four_bar()
    q = arm.equilibrium(turned(arm, -1.0))
    loop = fa.closed_loop(arm, [fa.PD(50.0, 3.0, link="crank")], q)
    model = arm.linearize(q, inputs=["crank"], outputs=[("joint", "crank"), ("rate", "crank")])
    wanted = np.linalg.eigvals(model.A - model.B @ [[50.0, 3.0]] @ model.C)
    np.testing.assert_allclose(np.sort(loop.poles), np.sort(wanted), rtol=1e-9)


def test_what_does_not_rest_and_what_is_open_are_told() -> None:
    arm = four_bar()
    q = turned(arm, 0.5)
    with warns(fa.errors.StateWarning, "does not rest"):
        arm.linearize(q)
    with refuses("q", "loop 'foot'", "0.6 m"):
        arm.linearize(np.zeros(3))
    with refuses("v", "loop 'foot'", "m/s"):
        arm.linearize(q, [1.0, 0, 0])
    with refuses("q", "loop 'foot'"):
        arm.modes(np.zeros(3))
    with refuses("speed", "loop 'foot'"):
        arm.modes(q, speed={"crank": 1.0})


@pytest.mark.parametrize("name", ["trim", "inverse_dynamics", "inverse_derivatives", "joint_reaction", "modal_damping"])
def test_what_does_not_know_rigid_loops_refuses_them(name: str) -> None:
    arm = four_bar(bends=True)
    q, zero = turned(arm, 0.5), np.zeros(9)
    given = {"trim": (q,), "modal_damping": ({1: 0.03}, q)}.get(name, (q, zero, zero))
    with refuses(name, "rigid loops", "foot"):
        getattr(arm, name)(*given)
    soft = four_bar(replace(FOOT, stiffness=1e6, angular_stiffness=1e3), bends=True)
    getattr(soft, name)(*given)
