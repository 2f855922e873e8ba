"""Derivatives of runs of "ida" by parameters: forward sensitivities, by IDAS."""

from __future__ import annotations

import flexarm as fa
import numpy as np
import pytest
from arms import run_derivatives
from flexarm.arm.variation import Setup, Variation
from flexarm.run.perturbed import problems
from messages import refuses
from scipy.integrate import solve_ivp

SOLVERS = ("dense", "chain")
ROWS = ("q", "v", "a", "tau")
STEEL = fa.Material(7850, 209e9, 0.3)


def tangents(setup: Setup, paths: list[str], t, q0=None, v0=None, **options) -> tuple[fa.Result, dict[str, np.ndarray]]:
    acting = {"drive": setup.drive, "loads": setup.loads, "control": setup.control}
    found = fa.simulate(setup.arm, t, q0, v0, **acting, **options).sensitivities(paths)
    return found.result, {name: getattr(found, name) for name in ROWS}


def differences(setup: Setup, paths: list[str], t, q0=None, **options) -> dict[str, np.ndarray]:
    """The same, by differences of sixth order of whole runs, of "gauss" if nothing is said."""
    options = {"integrator": "gauss", "step": 5e-4} | options
    q0 = np.zeros(setup.arm.nq) if q0 is None else np.array(q0)

    def run(path: str, value: float) -> fa.Result:
        near = Variation(setup, {path: np.array([value])})
        made, start = near.scenario(0), near.initial("q0", q0[None])[0]
        acting = {"drive": made.drive, "loads": made.loads, "control": made.control}
        return fa.simulate(made.arm, t, start, **acting, **options)

    found = [run_derivatives(lambda x, p=p: run(p.path, x), p.value, 1e-3 * p.scale, ROWS)
             for p in problems(setup, paths, t, q0, None, None)]  # fmt: skip
    return {name: np.array([x[name] for x in found]) for name in ROWS}


def agree(found: dict[str, np.ndarray], wanted: dict[str, np.ndarray], rtol: float, names=ROWS) -> None:
    """Whether the derivatives by each parameter agree, in parts of the largest."""
    for name in names:
        for x, y in zip(found[name], wanted[name], strict=True):
            size = np.abs(y).max()
            np.testing.assert_allclose(x, y, rtol=0, atol=rtol * size + 1e-8, err_msg=name)


def two(**joint) -> fa.Arm:
    """Two flexible links that gravity pulls."""
    links = []
    for length, thick in ((0.5, 0.006), (0.4, 0.004)):
        hub, tip = fa.RigidBody(0.3, (0, 0, 0), (1e-3,) * 3), fa.RigidBody(0.2, (0.01, 0, 0), (1e-4, 2e-4, 2e-4))
        beam = fa.Beam(length, fa.Rectangle(thick, 0.02), STEEL, {"bending_y": 2}, damping_ratio=0.02)
        links.append(fa.Link(fa.Revolute("z", damping=0.05, stiffness=0.4, **joint), hub, beam, tip=tip))
    return fa.Arm(links, gravity=(0, -9.81, 0))


# -- against other programs and closed forms ---------------------------------------------------------------------------


def pendulum(t: np.ndarray) -> dict[str, np.ndarray]:
    """q and v of a damped pendulum by its mass, damping, gravity, and start: its variational equations, by SciPy."""
    m, l, inertia, d, g = 1.3, 0.4, 0.02, 0.15, 9.81

    def rates(_, y):
        q, v = y[:2]
        whole, s = inertia + m * l**2, y[2:].reshape(2, 4)
        a = (-m * g * l * np.cos(q) - d * v) / whole
        by_p = np.array([-g * l * np.cos(q) - l**2 * a, -v, m * l * np.cos(q), 0.0]) / whole  # gravity is -g
        return np.concatenate([[v, a], s[1], (m * g * l * np.sin(q) * s[0] - d * s[1]) / whole + by_p])

    start = np.zeros(10)
    start[0], start[5] = 0.3, 1.0
    y = solve_ivp(rates, (t[0], t[-1]), start, "DOP853", t, rtol=1e-12, atol=1e-13).y
    return {"q": np.array(y[2:6])[:, :, None], "v": np.array(y[6:10])[:, :, None]}


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_pendulum_agrees_with_its_variational_equations_ever_closer(solver):
    body = fa.RigidBody(1.3, (0.4, 0, 0), (0.02,) * 3)
    setup = Setup(fa.Arm([fa.Link(fa.Revolute("z", damping=0.15), body)], gravity=(0, -9.81, 0)))
    t = np.linspace(0, 3, 13)
    paths = ["link.0.hub.mass", "link.0.joint.damping", "gravity.1", "q0.0"]
    wanted = pendulum(t)
    errors = []
    for rtol in (1e-4, 1e-6, 1e-8, 1e-10):
        result, found = tangents(setup, paths, t, [0.3], rtol=rtol, atol=1e-3 * rtol, linear_solver=solver)
        errors.append(max(np.abs(found[k] - wanted[k]).max() / np.abs(wanted[k]).max() for k in wanted))
        assert errors[-1] < 100 * rtol
    assert errors[3] < 1e-3 * errors[1] < 1e-3 * errors[0]
    plain = fa.simulate(setup.arm, t, [0.3], rtol=1e-10, atol=1e-13, linear_solver=solver)
    np.testing.assert_allclose(result.q, plain.q, atol=1e-8)
    # the equation of motion itself, by the mass: of the accelerations' derivatives
    whole = 0.02 + 1.3 * 0.16
    s, q, v = {k: x[0, :, 0] for k, x in found.items()}, result.q[:, 0], result.v[:, 0]
    a = (-1.3 * 9.81 * 0.4 * np.cos(q) - 0.15 * v) / whole
    by_mass = (1.3 * 9.81 * 0.4 * np.sin(q) * s["q"] - 0.15 * s["v"] - 9.81 * 0.4 * np.cos(q) - 0.16 * a) / whole
    np.testing.assert_allclose(s["a"], by_mass, atol=1e-9)


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_beam_that_rings_down_agrees_with_the_closed_form(solver):
    """Of one mode: q = q0 exp(-z w t) (cos(wd t) + z w / wd sin(wd t)), with w as the root of Young's modulus."""
    beam = fa.Beam(0.5, fa.Rectangle(0.004, 0.02), STEEL, {"bending_y": 1}, order=1, damping_ratio=0.03)
    setup = Setup(fa.Arm([fa.Link(fa.Fixed(), beam=beam)]))
    w, z = float(np.sqrt(-1e3 * setup.arm.forward_dynamics([1e-3], [0.0], [0.0])[0])), 0.03
    t = np.linspace(0, 12 / w, 25)

    def q(w, z):
        wd = w * np.sqrt(1 - z * z)
        return 1e-3 * np.exp(-z * w * t) * (np.cos(wd * t) + z * w / wd * np.sin(wd * t))

    def by(f, x):  # complex steps
        return f(x + 1e-30j).imag / 1e-30

    result, found = tangents(setup, ["link.0.beam.material.youngs_modulus", "link.0.beam.damping_ratio", "q0.0"], t,
                             [1e-3], rtol=1e-9, atol=1e-14, linear_solver=solver)  # fmt: skip
    np.testing.assert_allclose(result.q[:, 0], q(w, z), atol=1e-9)
    np.testing.assert_allclose(209e9 * found["q"][0, :, 0], by(lambda x: q(x, z), w) * w / 2, atol=1e-8)
    np.testing.assert_allclose(found["q"][1, :, 0], by(lambda x: q(w, x), z), atol=1e-8)
    np.testing.assert_allclose(found["q"][2, :, 0], q(w, z) * 1e3, atol=1e-6)


# -- against differences of runs ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_flexible_arm_with_drives_loads_and_control(solver):
    t = np.linspace(0, 0.3, 7)
    drive, load, control = fa.Torque(t, np.sin(9 * t)), fa.Load(force=(0, 2.0, 0)), fa.PD(3.0, 0.3, 1, reference=0.3)
    setup = Setup(two(), {0: drive}, (load,), (control,))
    paths = ["link.0.tip.mass", "link.1.beam.length", "link.0.joint.damping", "drive.0.scale", "load.0.force.1",
             "control.0.kp", "q0.1", "gravity.1", "link.1.joint.stiffness"]  # fmt: skip
    _, found = tangents(setup, paths, t, rtol=1e-8, atol=1e-11, linear_solver=solver)
    agree(found, differences(setup, paths, t), 2e-6)


def test_a_prescribed_motion_and_its_reaction():
    t = np.linspace(0, 0.3, 7)
    setup = Setup(two(), {0: fa.Motion(lambda s: (0.3 * s**3, 0.9 * s**2, 1.8 * s))})
    paths = ["drive.0.scale", "link.0.tip.mass", "link.1.joint.stiffness"]
    _, found = tangents(setup, paths, t, rtol=1e-8, atol=1e-11)
    agree(found, differences(setup, paths, t), 5e-6)
    assert found["q"][0, -1, 0] == pytest.approx(0.3 * 0.3**3)
    assert np.abs(found["q"][1, :, 0]).max() < 1e-12 and np.abs(found["tau"][1, :, 0]).max() > 0.1


def controllers() -> dict[str, tuple[fa.Controller, list[str]]]:
    sampled = np.array([[1.0, 0], [0, 0.5]]), np.array([[0.02], [0.5]]), np.array([[4.0, -1.0]]), np.array([[3.0]])
    at = {"measure": [("joint", 0)], "actuate": [0], "reference": 0.2}
    return {
        "with memory": (fa.LinearController([[0, 0], [0, -20.0]], [[1.0], [20.0]], [[4.0, -1.0]], [[3.0]], **at),
                        ["control.0.A.1.1", "control.0.D.0.0", "link.0.tip.mass"]),
        "at its limit for a while": (fa.PD(20.0, 2.0, 0, limit=2.0),
                                     ["control.0.kp", "control.0.limit", "link.0.tip.mass"]),
        "sampled": (fa.LinearController(*sampled, rate=50.0, delay=0.004, **at),
                    ["control.0.A.1.1", "control.0.C.0.0", "link.0.tip.mass", "q0.0"]),
    }  # fmt: skip


@pytest.mark.parametrize("name", controllers())
def test_controllers(name):
    t = np.linspace(0, 0.3, 7)
    control, paths = controllers()[name]
    setup = Setup(two(), control=(control,))
    result, found = tangents(setup, paths, t, rtol=1e-9, atol=1e-12)
    reference = {}
    if name.startswith("at its limit"):  # so that the kink is in it, which "ida" follows
        held = np.abs(result.tau[:, 0]) == 2.0
        assert held.any() and not held.all()
        reference = {"integrator": "ida", "rtol": 1e-11, "atol": 1e-14, "step": None}
    agree(found, differences(setup, paths, t, **reference), 2e-6)


def test_sticking_and_sliding_arms():
    t, fine = np.linspace(0, 0.5, 11), np.linspace(0, 1, 101)
    setup = Setup(two(coulomb=0.2, stiction=0.3), {0: fa.Torque(fine, 4 * np.sin(9 * fine))})
    paths = ["drive.0.scale", "link.0.joint.coulomb", "link.1.joint.stiction", "q0.0"]
    result, found = tangents(setup, paths, t, rtol=1e-8, atol=1e-11)
    assert result.stats["switches"] >= 4
    agree(found, differences(setup, paths, t, step=2.5e-4), 5e-6)


# -- what there is no derivative of ------------------------------------------------------------------------------------


def test_what_is_refused():
    t = np.linspace(0, 0.1, 3)
    law = fa.LinearController(*([[0.5]],) * 4, rate=50.0, measure=[("joint", 0)], actuate=[0])
    rubs = two(coulomb=0.2)
    cases = [
        (Setup(two(), control=(law,)), "control.0.rate", ("'control.0.rate'", "samples")),
        (Setup(two()), "link.0.joint.coulomb", ("derivative", "friction")),
        (Setup(rubs, control=(law,)), "link.0.tip.mass", ("friction", "sampled")),
        (Setup(two()), "link.0.tip.mas", "'link.0.tip.mass'"),
    ]
    for setup, path, message in cases:
        with refuses(message):
            tangents(setup, [path], t, integrator="ida")
