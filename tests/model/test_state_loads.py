"""Loads that follow from the state of their slice."""

import pickle

import flexarm as fa
import numpy as np
import pytest
from messages import refuses

K, C, M = 400.0, 3.0, 2.0


def slide(**joint):
    body = fa.RigidBody(mass=M, inertia=(0.01, 0.01, 0.01))
    return fa.Arm([fa.Link(joint=fa.Prismatic("x", **joint), hub=body)])


def pull(t, pose, velocity):
    return [-K * pose.p[0] - C * velocity[0], 0.0, 0.0]


def flexible():
    material = fa.Material(youngs_modulus=70e9, density=2700.0, poisson_ratio=0.3)
    beam = fa.Beam(0.6, fa.Rectangle(0.02, 0.004), material, modes={"bending_y": 2, "bending_z": 1, "torsion": 1})
    links = [
        fa.Link(joint=fa.Revolute("z"), beam=beam, tip=fa.RigidBody(mass=0.2, inertia=(1e-3, 1e-3, 1e-3))),
        fa.Link(joint=fa.Spherical(), beam=beam, tip=fa.RigidBody(mass=0.1, inertia=(1e-3, 1e-3, 1e-3))),
    ]
    return fa.Arm(links, gravity=(0.0, 0.0, -9.81))


def bent(arm, seed=0):
    rng = np.random.default_rng(seed)
    q = arm.zero + 0.02 * rng.standard_normal(arm.nq)
    return q, 0.5 * rng.standard_normal(arm.nv)


def drag(t, pose, velocity):
    """Of a plate across the slice's y axis, and of a magnet at a point."""
    normal = pose.R[:, 1]
    away = np.array([0.3, 0.4, 0.5]) - pose.p
    speed = normal @ velocity[:3]
    return -2.0 * speed * np.sqrt(speed**2 + 0.01) * normal + (1.0 + t) * away / (0.1 + away @ away) ** 1.5


def twist(t, pose, velocity):
    return 0.1 * np.cross(pose.R[:, 0], [0.0, 0.0, 1.0]) - 0.02 * velocity[3:]


LOADS = [
    fa.Load(0, x=0.4, force=drag, moment=twist),
    fa.Load(1, force=drag),
    fa.Load(1, x=0.2, force=lambda t, pose, velocity: [0.3, pose.p[2], 0.1 * velocity[4]], axes="section"),
]


@pytest.mark.parametrize("integrator", ["ida", "gauss", "implicit", "rk4", None])
def test_a_spring_by_the_state_is_that_of_the_joint(integrator):
    t = np.linspace(0.0, 1.0, 21)
    options = {} if integrator is None else {"integrator": integrator}
    if integrator in ("gauss", "implicit", "rk4"):
        options["step"] = 1e-3
    found = fa.simulate(slide(), t, [0.1], loads=[fa.Load(0, force=pull)], **options)
    expected = fa.simulate(slide(stiffness=K, damping=C), t, [0.1], **options)
    np.testing.assert_allclose(found.q, expected.q, atol=2e-5 if integrator in ("ida", None) else 1e-9)
    np.testing.assert_allclose(found.tau, expected.tau, atol=1e-9)


def test_steps_take_a_spring_that_is_stiff_for_them():
    def stiff(t, pose, velocity):
        return [-1e8 * pose.p[0], 0.0, 0.0]

    t = np.linspace(0.0, 0.1, 101)
    found = fa.simulate(slide(), t, [0.01], loads=[fa.Load(0, force=stiff)], integrator="implicit", step=1e-3)
    expected = fa.simulate(slide(stiffness=1e8), t, [0.01], integrator="implicit", step=1e-3)
    np.testing.assert_allclose(found.q, expected.q, atol=1e-8)


def test_forces_are_those_of_virtual_work():
    arm = flexible()
    q, v = bent(arm)
    t, a = 0.7, np.zeros(arm.nv)
    expected = arm.inverse_dynamics(q, v, a)
    for load in LOADS:
        p, R = arm.frame(q, load.link, load.x)
        J = arm.jacobian(q, load.link, load.x)
        wrench = np.array(load.law(t, p, R, J @ v))
        if load.axes == "section":
            wrench = np.concatenate([R @ wrench[:3], R @ wrench[3:]])
        expected = expected - J.T @ wrench
    np.testing.assert_allclose(arm.inverse_dynamics(q, v, a, loads=LOADS, t=t), expected, atol=1e-10)
    back = arm.forward_dynamics(q, v, expected, loads=LOADS, t=t)
    np.testing.assert_allclose(back, a, atol=1e-8)


def test_derivatives_have_the_slopes():
    arm = flexible()
    q, v = bent(arm)
    tau = np.zeros(arm.nv)
    found = arm.forward_derivatives(q, v, tau, loads=LOADS, t=0.2)
    plain = arm.forward_derivatives(q, v, tau)

    def accelerations(q, v):
        return arm.forward_dynamics(q, v, tau, loads=LOADS, t=0.2)

    h = 1e-5
    by_q = [(accelerations(q + h * e, v) - accelerations(q - h * e, v)) / (2 * h) for e in np.eye(arm.nq)]
    by_v = [(accelerations(q, v + h * e) - accelerations(q, v - h * e)) / (2 * h) for e in np.eye(arm.nv)]
    assert abs(found.dq - plain.dq).max() > 1.0
    np.testing.assert_allclose(found.dq, np.transpose(by_q), atol=1e-6 * abs(found.dq).max())
    np.testing.assert_allclose(found.dv, np.transpose(by_v), atol=1e-6 * abs(found.dv).max())


def test_a_slide_vibrates_and_rests_by_it():
    arm = slide()
    load = fa.Load(0, force=lambda t, pose, velocity: [-K * (pose.p[0] - 0.2), 0.0, 0.0])
    np.testing.assert_allclose(arm.equilibrium(loads=[load]), [0.2], atol=1e-9)
    np.testing.assert_allclose(arm.modes([0.2], loads=[load]).frequencies, [np.sqrt(K / M)], rtol=1e-8)


def test_planar_arms_see_the_world():
    """An arm that moves in x-z, with a link out of that plane: its law is asked as in space."""
    seen = []

    def look(t, pose, velocity):
        seen.append((pose.p.copy(), pose.R.copy(), velocity.copy()))
        return [0.0, 0.0, 0.0]

    body = fa.RigidBody(mass=1.0, inertia=(0.01, 0.01, 0.01), end=(0.3, 0.1, 0.05))
    arm = fa.Arm([fa.Link(joint=fa.Revolute("y"), hub=body), fa.Link(joint=fa.Revolute("y"), hub=body)])
    q, v = np.array([0.3, -0.8]), np.array([1.0, 2.0])
    arm.inverse_dynamics(q, v, np.zeros(2), loads=[fa.Load(1, force=look)])
    p, R = arm.frame(q)
    np.testing.assert_allclose(seen[0][0], p, atol=1e-14)
    np.testing.assert_allclose(seen[0][1], R, atol=1e-14)
    np.testing.assert_allclose(seen[0][2], arm.jacobian(q) @ v, atol=1e-14)


def test_in_batches_it_acts_as_alone():
    arm = flexible()
    t, (_, v) = np.linspace(0.0, 0.02, 3), bent(arm)
    rates = np.outer(np.linspace(-0.2, 0.2, 8), v)
    options = {"loads": LOADS[1:2], "integrator": "implicit", "step": 2e-4}
    batch = fa.simulate_batch(arm, t, arm.zero, rates, **options)
    assert batch.stats["lanes"] > 1
    for k in (0, 5):
        alone = fa.simulate(arm, t, arm.zero, rates[k], **options)
        np.testing.assert_allclose(batch.q[k], alone.q, atol=1e-9)


def test_scaled_copied_and_checked():
    t = np.linspace(0.0, 0.2, 5)
    scene = fa.Scene(slide(), loads=[fa.Load(0, force=pull)], t=t, q0=[0.1], options={"integrator": "gauss"})
    scales = {"load.0.scale": [1.0, 2.0]}
    batch = fa.simulate_batch(scene.arm, t, [0.1], loads=scene.loads, parameters=scales, step=1e-3)
    assert abs(batch.q[0] - batch.q[1]).max() > 1e-3
    np.testing.assert_allclose(batch.q[1], fa.simulate(slide(stiffness=2 * K, damping=2 * C), t, [0.1]).q, atol=1e-4)
    copied = pickle.loads(pickle.dumps(scene.loads[0]))
    same = (fa.simulate(slide(), t, [0.1], loads=[load]).q for load in (copied, scene.loads[0]))
    np.testing.assert_array_equal(*same)
    arm = flexible()
    fa.simulate(arm, t, loads=[fa.Load(1, force=drag)], integrator="ida").check()


def test_what_it_cannot_be():
    zero = ([0.0], [0.0], [0.0])
    with refuses("force, moment", "along"):
        fa.Load(0, along=(0.0, 0.1), force=drag)
    with refuses("Load", "law"):
        LOADS[1](0.0)
    with refuses("Load force", "(1,)", "3"):
        slide().inverse_dynamics(*zero, loads=[fa.Load(0, force=lambda t, pose, velocity: [1.0])])
    with refuses("Load force", "nan"):
        slide().inverse_dynamics(*zero, loads=[fa.Load(0, force=lambda t, pose, velocity: [np.nan] * 3)])
    run = fa.Simulation(slide(), fa.Implicit(1e-3), loads=[fa.Load(0, force=pull)])
    with refuses("load", "0"):
        run.set_load(0, (1.0, 0.0, 0.0))
    with pytest.raises(ZeroDivisionError):
        fa.simulate(slide(), np.linspace(0, 1, 3), [0.1], loads=[fa.Load(0, force=lambda t, pose, velocity: 1 / 0)])
