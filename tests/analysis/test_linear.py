"""Exact derivatives and linear models."""

import sys

import flexarm as fa
import numpy as np
import pytest
from arms import (
    BODY,
    STEEL,
    STRIP,
    G,
    close,
    differences,
    floating_arm,
    moved,
    paper_link,
    pendulum,
    random_arm,
    random_state,
    unit_balls,
)
from messages import refuses, warns
from scipy.spatial.transform import Rotation

# -- derivatives -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(8))
def test_forward_derivatives_against_differences(seed: int) -> None:
    """Steps of 1e-4 and stops met in the last 1e-3 m leave differences of some 1e-6 of the largest entry."""
    rng = np.random.default_rng(seed)
    arm = random_arm(rng, 3)
    q, v, tau = random_state(rng, arm)
    push = [fa.Load(1, None, force=(1.0, -2.0, 0.5), moment=(0.1, 0.3, -0.2), axes="section")]
    found = arm.forward_derivatives(q, v, tau, loads=push)
    h = 1e-5
    close(found.dq, differences(lambda e: arm.forward_dynamics(q + e, v, tau, loads=push), arm.nq, h), 2e-6)
    close(found.dv, differences(lambda e: arm.forward_dynamics(q, v + e, tau, loads=push), arm.nv), 2e-6)
    close(found.dtau @ arm.mass_matrix(q), np.eye(arm.nv), 1e-8)


@pytest.mark.parametrize("modes", [{}, {"bending_y": 3, "shear_y": 1}, {"bending_y": 2, "bending_z": 2, "torsion": 2}])
@pytest.mark.parametrize("order", [1, 2])
def test_derivatives_without_loads_are_those_with_a_load_of_nothing(modes: dict, order: int) -> None:
    """A load of nothing changes nothing: in the plane and in space, with springs,
    stops that are met, rotors and placements."""
    beam = fa.Beam(0.6, fa.Rectangle(0.01, 0.02), STEEL, modes, order=order, kelvin_voigt=1e-3) if modes else None
    stop = {"lower": -0.1, "upper": 0.2, "limit_stiffness": 1e3, "limit_damping": 2.0, "reflected_inertia": 0.01}
    flat = "torsion" not in modes
    tilt = {} if flat else {"outboard": fa.Placement((0.1, 0, 0), (0.3, -0.5, 0.4))}
    links = [
        fa.Link(fa.Revolute("z", stiffness=3.0, rest=0.2, damping=0.1, **stop), BODY, beam),
        fa.Link(fa.Prismatic("x" if flat else (1, 2, 2), **stop), BODY, beam, BODY),
        fa.Link(fa.Revolute("z" if flat else "y", **tilt), None if beam else BODY, beam, BODY),
    ]
    arm = fa.Arm(links, (1, -9.81, 0 if flat else 2))
    rng = np.random.default_rng(0)
    q, v, a = random_state(rng, arm)
    nothing = [fa.Load(0, force=(0, 0, 0))]
    fast, general = arm.inverse_derivatives(q, v, a), arm.inverse_derivatives(q, v, a, loads=nothing)
    for x, y in zip(fast, general, strict=True):
        np.testing.assert_allclose(x, y, atol=1e-11 * np.abs(y).max())


def test_forward_and_inverse_derivatives_are_inverse() -> None:
    rng = np.random.default_rng(11)
    arm = floating_arm()
    q, v, tau = random_state(rng, arm)
    forward = arm.forward_derivatives(q, v, tau)
    by_q, by_v, M = arm.inverse_derivatives(q, v, arm.forward_dynamics(q, v, tau))
    close(M @ forward.dq, -by_q, 1e-10)
    close(M @ forward.dv, -by_v, 1e-10)
    close(forward.dtau @ M, np.eye(arm.nv), 1e-10)


# -- linear models ---------------------------------------------------------------------------------------------------

INPUTS = [0, (1, 2), ("load", 1, 0.3), ("load", 2)]
OUTPUTS = [
    *(("joint", 0), ("rate", (1, 0)), ("tip", 1, 0.2), ("tip", 2), ("velocity", 1), ("acceleration", 2)),
    *(("accelerometer", 1), ("strain", 1, 0.1), ("strain", 1, 0.0, "K3")),
    *(("velocity", 2, 0.1), ("acceleration", 1, 0.3), ("accelerometer", 2, 0.4)),
]


def test_every_output_against_differences_of_its_value() -> None:
    """At a state that moves and accelerates, with balls; velocities and accelerations are checked further down."""
    rng = np.random.default_rng(5)
    arm = floating_arm()
    q, v, tau = random_state(rng, arm)
    q = unit_balls(arm, q)
    follower = fa.Load(1, 0.25, force=(0.3, -0.4, 0.5), moment=(0.1, 0.2, 0.3), axes="section")
    push = [follower, fa.Load(2, force=(1.0, 0.5, -2.0))]
    sys = arm.linearize(q, v, INPUTS, OUTPUTS, tau=tau, loads=push)
    assert sys.C.shape == (3 + 3 + 1 + 3 + 3 + 3 + 3 + 3 + 6 + 1 + 9, 2 * arm.nv) and sys.D.shape[1] == 6 + 1 + 3 + 3
    loads = np.hstack([arm.jacobian(q, 1, 0.3)[:3].T, arm.jacobian(q, 2)[:3].T])
    units = np.hstack([np.eye(arm.nv)[:, [*range(6), arm.joint_rate((1, 2))]], loads])
    turns = [k for k, name in enumerate(sys.outputs) if name.startswith("joint") and " w" in name]
    rows = np.setdiff1d(np.arange(len(sys.outputs)), turns)  # y holds no turn of a ball

    none, no_u = np.zeros(arm.nv), np.zeros(13)

    def y(theta: np.ndarray = none, dv: np.ndarray = none, u: np.ndarray = no_u) -> np.ndarray:
        x, w = moved(arm, q, theta), v + dv
        a = arm.forward_dynamics(x, w, tau + units @ u, loads=push)
        R = arm.frame(x, 1)[1]
        g = np.array(arm.gravity)
        slices = (arm.frame(x, 1, 0.2)[0], arm.frame(x, 2)[0], arm.velocity(x, w, 1)[:3])
        accelerations = (arm.acceleration(x, w, a, 2)[:3], R.T @ (arm.acceleration(x, w, a, 1)[:3] - g))
        strains = (arm.strain(x, 1, 0.1), arm.strain(x, 1)[2:3])
        felt = arm.frame(x, 2, 0.4)[1].T @ (arm.acceleration(x, w, a, 2, 0.4)[:3] - g)
        inner = (arm.velocity(x, w, 2, 0.1)[:3], arm.acceleration(x, w, a, 1, 0.3)[:3], felt)
        return np.concatenate([x[:3], w[arm.joint_rates((1, 0))], *slices, *accelerations, *strains, *inner])

    np.testing.assert_allclose(sys.y[rows], y(), rtol=1e-12)
    n = arm.nv
    scale = np.maximum(1.0, np.abs(sys.C[rows]).max(axis=1, keepdims=True))
    for found, expected in (
        (sys.C[rows, :n], differences(lambda e: y(theta=e), n)),
        (sys.C[rows, n:], differences(lambda e: y(dv=e), n)),
        (sys.D[rows], np.stack([y(u=e) - y() for e in np.eye(13)], axis=-1)),  # affine in u
    ):
        np.testing.assert_allclose(found / scale, expected / scale, atol=1e-7)
    np.testing.assert_array_equal(sys.C[turns, :n], np.eye(n)[3:6])


def test_state_matrix_follows_the_motion() -> None:
    """A with balls that turn: two motions a little apart, by a short step of each along its own turn."""
    rng = np.random.default_rng(6)
    arm = floating_arm()
    q, v, tau = random_state(rng, arm)
    q = unit_balls(arm, q)
    sys = arm.linearize(q, v, tau=tau)
    n, h, small = arm.nv, 1e-4, 1e-4
    da = arm.forward_derivatives(q, v, tau)
    E = arm._core.rates(q, v)[2]
    close(sys.A[n:, :n], da.dq @ E, 1e-12)
    close(sys.A[n:, n:], da.dv, 1e-12)
    close(sys.B[n:], da.dtau[:, [*arm.joint_rates(0), *arm.joint_rates(1), *arm.joint_rates(2)]], 1e-12)
    dx = small * rng.normal(size=2 * n)
    w, dw, theta = v[3:6], dx[n + 3 : n + 6], dx[3:6]
    turn = Rotation.from_rotvec
    later = (turn(h * w).inv() * turn(theta) * turn(h * (w + dw))).as_rotvec()
    earlier = (turn(-h * w).inv() * turn(theta) * turn(-h * (w + dw))).as_rotvec()
    # second order in dx, fourth power of w h aside: 1e-4 of it
    np.testing.assert_allclose((sys.A @ dx)[3:6], (later - earlier) / (2 * h), atol=1e-3 * small)


def test_small_perturbation_follows_the_linear_model() -> None:
    """Two-link arm hanging in balance: free and forced response of simulate() against exp(A t), at 1e-5 rad, where the
    quadratic terms are 1e-5 of the linear ones."""
    from scipy.linalg import expm

    beam = fa.Beam(0.5, fa.Rectangle(0.004, 0.02), STEEL, {"bending_y": 2}, "legendre", damping_ratio=0.02)
    tip = fa.RigidBody(0.2, end=(0.02, 0, 0))
    arm = fa.Arm([fa.Link(fa.Revolute("z", damping=0.01), BODY, beam, tip)] * 2, gravity=(0, -G, 0))
    q = arm.equilibrium()
    lin = arm.linearize(q, inputs=[1], outputs=[("joint", 0), ("accelerometer", 1), ("strain", 0, 0.0, "K3")])
    rng = np.random.default_rng(1)
    x0, u = 1e-5 * rng.normal(size=2 * arm.nv), 1e-4
    x0[[1, 2, 4, 5]] *= 1e-2  # the tip, in metres
    x0[arm.nv :] = 0.0
    t = np.linspace(0, 1, 21)
    run = fa.simulate(arm, t, q + x0[: arm.nv], drive={1: fa.Torque(u)}, rtol=1e-9, atol=1e-14)
    n = 2 * arm.nv
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n], whole[:n, n:] = lin.A, lin.B
    x = np.array([(expm(whole * s) @ [*x0, u])[:n] for s in t])
    size = np.abs(x).max(axis=0)
    np.testing.assert_allclose(np.hstack([run.q - q, run.v]) / size, x / size, atol=3e-3)
    y = lin.y + x @ lin.C.T + u * lin.D[:, 0]
    K3 = run.strain(0, 0.0)[:, 2]
    np.testing.assert_allclose(K3, y[:, 4], atol=3e-3 * np.ptp(y[:, 4]))


@pytest.mark.parametrize("speed", [0.0, 10.0])
def test_eigenvalues_are_those_of_modes(speed: float) -> None:
    arm = paper_link(2, damping_ratio=0.01)
    modes = arm.modes(speed={0: speed}, lock=[0])
    v = np.zeros(arm.nv)
    v[0] = speed
    found = arm.linearize(modes.q, v, lock=[0])
    assert found.A.shape == (6, 6) and found.B.shape == (6, 0) and found.inputs == ()
    s = found.eigenvalues
    np.testing.assert_allclose(np.sort_complex(s[s.imag > 0]), np.sort_complex(modes.eigenvalues), rtol=1e-8)


def test_gyroscopic_modes_are_the_eigenvalues_too() -> None:
    shaft = fa.Beam(0.6, fa.Circle(0.004), STEEL, {"bending_y": 3, "bending_z": 3}, "legendre")
    arm = fa.Arm([fa.Link(fa.Revolute("x"), fa.RigidBody(1, inertia=(1, 1, 1)), shaft, fa.RigidBody(0.2))])
    modes = arm.modes(speed={0: 20.0}, lock=[0])
    assert np.iscomplexobj(modes.shapes)
    v = np.zeros(arm.nv)
    v[0] = 20.0
    s = arm.linearize(modes.q, v, lock=[0]).eigenvalues
    np.testing.assert_allclose(np.sort(s.imag[s.imag > 0]), np.sort(modes.eigenvalues.imag), rtol=1e-8)


def test_a_spinning_free_body() -> None:
    """Euler: about its axis C at rate W a body nutates at W sqrt((C - A)(C - B)/(A B)), and its turns in its own axes
    go round at W; the modes say the same."""
    A, B, C, W = 1.0, 1.5, 2.0, 3.0
    arm = fa.Arm([fa.Link(fa.Spherical(), fa.RigidBody(1.0, inertia=(A, B, C)))])
    expected = np.sort([W * np.sqrt((C - A) * (C - B) / (A * B)), W])
    s = arm.linearize(arm.zero, [0, 0, W]).eigenvalues
    np.testing.assert_allclose(np.sort(s.imag[s.imag > 1e-6]), expected, rtol=1e-10)
    modes = arm.modes(speed={(0, 2): W})
    np.testing.assert_allclose(modes.frequencies[-2:], expected, rtol=1e-7)


def test_prescribed_acceleration_as_input() -> None:
    """The free coordinates answer a joint's acceleration as forward dynamics with that motion prescribed says."""
    beam = fa.Beam(0.5, fa.Rectangle(0.01, 0.02), STEEL, {"bending_y": 2})
    arm = fa.Arm([fa.Link(fa.Revolute("z"), BODY, beam, BODY)] * 2, gravity=(0, -G, 0))
    q = arm.equilibrium([0.3, *np.zeros(arm.nq - 1)], lock=[0])
    sys = arm.linearize(q, inputs=[("acceleration", 0), 1], outputs=[("acceleration", 1), ("joint", 0)])
    n = arm.nv
    np.testing.assert_array_equal(sys.A[n], np.zeros(2 * n))
    np.testing.assert_array_equal(sys.B[n], [1.0, 0.0])
    still = arm.forward_dynamics(q, np.zeros(n), prescribed={0: 0.0})
    a = arm.forward_dynamics(q, np.zeros(n), prescribed={0: 1.0})
    np.testing.assert_allclose(sys.B[n:, 0], a - still, atol=1e-9 * np.abs(a).max())
    np.testing.assert_allclose(sys.D[:3, 0], (arm.jacobian(q) @ (a - still))[:3], atol=1e-9)
    assert sys.tau[0] == pytest.approx(arm.inverse_dynamics(q, np.zeros(n), sys.a)[0])
    assert sys.inputs == ("acceleration link 0 revolute", "force link 1 revolute")
    assert sys.outputs == ("acceleration link 1 x", "acceleration link 1 y", "acceleration link 1 z",
                           "joint link 0 revolute")  # fmt: skip


def test_to_control() -> None:
    control = pytest.importorskip("control")
    sys = paper_link().linearize(paper_link().zero, outputs=[("joint", 0), ("strain", 0, 0.05, "K3")])
    other = sys.to_control()
    assert isinstance(other, control.StateSpace)
    for name in "ABCD":
        np.testing.assert_array_equal(getattr(other, name), getattr(sys, name))
    assert other.input_labels == ["force link 0 revolute"] and other.output_labels[0] == "joint link 0 revolute"
    assert len(other.state_labels) == 8


def test_to_control_without_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "control", None)
    with refuses("flexarm[control]", "pip", error=ImportError):
        pendulum().linearize([-np.pi / 2]).to_control()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"inputs": 0}, "inputs = 0"),
        ({"inputs": [7]}, ("inputs[0]", "link = 7", "-3 to 2")),
        ({"inputs": [2, 2]}, ("'force link 2 revolute'", "named", "twice")),
        ({"inputs": [2], "lock": [2]}, "inputs[0] = 2"),
        ({"inputs": [("torque", 2)]}, "inputs[0] = 'torque'"),
        ({"inputs": [("load",)]}, ("inputs[0] = ('load',)", '"load"')),
        ({"inputs": [("load", 1, 0.7)]}, "x = 0.7"),
        ({"inputs": [("acceleration", (0, 4))]}, ("inputs", "ball", "link 0")),
        ({"outputs": "tip"}, "outputs = 'tip'"),
        ({"outputs": ["tip"]}, "outputs[0] = 'tip'"),
        ({"outputs": [("tips", 0)]}, ("outputs[0] = 'tips'", "'tip'")),
        ({"outputs": [("tip", 0), ("strain", 0, 0.1, "K4")]}, ("outputs[1]", "strain = 'K4'")),
        ({"outputs": [("strain", 0)]}, ("outputs[0] = ('strain', 0)", '"strain"')),
        ({"outputs": [("strain", 0, "tip")]}, ("outputs[0]", "x = 'tip'", "number")),
        ({"outputs": [("acceleration", 0, 0.2, "x")]}, ('"acceleration"', "link")),
        ({"outputs": [("velocity", 0, 0.7)]}, ("x = 0.7", "beam")),
        ({"outputs": [("joint", (2, 1))]}, ("outputs[0]", "link = (2, 1)", "0 to 0")),
        ({"lock": 0}, "lock = 0"),
        ({"lock": [(1, 0)]}, ("lock", "ball", "link 1 spherical")),
        ({"v": [0.0]}, "v has shape (1,)"),
        ({"tau": np.full(29, np.nan)}, "tau has shape (29,)"),
    ],
)
def test_bad_input(options: dict, message: str) -> None:
    arm = floating_arm()
    with refuses(message):
        arm.linearize(arm.zero, **options)


def test_loads_must_be_a_list() -> None:
    arm, load = paper_link(), fa.Load(force=(0, 1, 0))
    for call in (lambda: arm.modes(loads=load), lambda: fa.simulate(arm, [0, 1], loads=load)):
        with refuses("loads = Load"):
            call()


def test_a_state_that_falls_is_named() -> None:
    """About a state that moves on, A and B hold for a moment only: the level pendulum falls, the level beam sags."""
    arm = pendulum()
    with warns(fa.errors.StateWarning, "'link 0 revolute'", "arm.equilibrium", "rest"):
        arm.linearize([0.0])
    arm.linearize(arm.equilibrium([0.1]))  # a warning is an error here
    arm.linearize([0.0], tau=arm.bias([0.0], [0.0]))
    arm.linearize([0.0], lock=[0], inputs=[])
    arm.linearize([0.3], [2.0])  # named as it moves
    beam = fa.Arm([fa.Link(fa.Fixed(), None, STRIP)], gravity=(0, -0.5, 0))
    with warns(fa.errors.StateWarning, "'link 0 bending_y"):
        beam.linearize(beam.zero, inputs=[])
    beam.linearize(beam.equilibrium(), inputs=[])
