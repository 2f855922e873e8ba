"""Joints of several freedoms."""

import flexarm as fa
import numpy as np
import pytest
from arms import BODY, STRIP, close, differences, random_state
from messages import refuses
from scipy.spatial.transform import Rotation


def two_links(first: fa.Joint, second: fa.Joint, gravity=(0.3, -9.81, 1.0)) -> fa.Arm:
    return fa.Arm([fa.Link(first, BODY, STRIP), fa.Link(second, BODY, STRIP, BODY)], gravity)


def unquaternion(q: np.ndarray) -> np.ndarray:
    return Rotation.from_quat(q[..., [1, 2, 3, 0]]).as_matrix()


def test_poses_are_the_products_of_the_motions() -> None:
    u = np.array([0.6, 0.0, 0.8])
    tip = (0.4, 0.1, 0.0)

    def end(joint: fa.Joint, q) -> tuple[np.ndarray, np.ndarray]:
        return fa.Arm([fa.Link(joint, BODY)]).frame(q)

    def check(joint: fa.Joint, q, p, R: Rotation) -> None:
        found = end(joint, q)
        np.testing.assert_allclose(found[0], p + R.apply(tip), atol=1e-14)
        np.testing.assert_allclose(found[1], R.as_matrix(), atol=1e-14)

    turn = Rotation.from_rotvec
    check(fa.Cylindrical(u), [0.3, 0.7], 0.3 * u, turn(0.7 * u))
    check(fa.Universal(), [0.3, 0.7], np.zeros(3), turn([0.3, 0, 0]) * turn([0, 0.7, 0]))
    check(fa.Planar(), [0.3, 0.7, 1.1], np.array([0.3, 0.7, 0]), turn([0, 0, 1.1]))
    R1 = turn([0, 0, 0.5])
    check(fa.Axes(axes=("rz", "tx", "ry")), [0.5, 0.2, 0.9], R1.apply([0.2, 0, 0]), R1 * turn([0, 0.9, 0]))
    q = np.array([0.5, -0.1, 0.7, 0.3])
    q /= np.linalg.norm(q)
    R = Rotation.from_quat(q[[1, 2, 3, 0]])
    check(fa.Spherical(), q, np.zeros(3), R)
    check(fa.Free(), [1, 2, 3, *q], np.array([1.0, 2.0, 3.0]), R)
    inboard, outboard = fa.Placement((1, 2, 3), (0.1, 0.2, 0.3)), fa.Placement((0.4, 0.5, 0.6), (0, 0, 0.5))
    A, B, C = turn([0.1, 0.2, 0.3]), turn([0, 0, 0.7]), turn([0, 0, 0.5])
    p = np.array([1, 2, 3]) + (A * B).apply([0.4, 0.5, 0.6])
    check(fa.Revolute("z", inboard=inboard, outboard=outboard), [0.7], p, A * B * C)


def test_a_ball_is_three_revolutes() -> None:
    """Away from their singularity: the same accelerations of every slice, by either description."""
    rng = np.random.default_rng(3)
    ball = two_links(fa.Spherical(), fa.Revolute("y"))
    euler = two_links(fa.Axes(axes=("rz", "ry", "rx")), fa.Revolute("y"))
    q, v, _ = random_state(rng, euler)
    quat = Rotation.from_euler("ZYX", q[:3]).as_quat()[[3, 0, 1, 2]]
    J = euler.jacobian(q, link=0, x=0.0)[3:, :3]  # world angular velocity per Euler rate
    R = euler.frame(q, link=0, x=0.0)[1]
    H = R.T @ J
    qb, vb = np.concatenate([quat, q[3:]]), np.concatenate([H @ v[:3], v[3:]])
    a, ab = euler.forward_dynamics(q, v), ball.forward_dynamics(qb, vb)
    h = 1e-5  # dH/dt along the motion
    rate = [
        (lambda x: x.T @ euler.jacobian(q + k * h * v, link=0, x=0.0)[3:, :3])(euler.frame(q + k * h * v, 0, 0.0)[1])
        for k in (-1, 1)
    ]
    dH = (rate[1] - rate[0]) / (2 * h)
    scale = np.abs(a).max()
    np.testing.assert_allclose(ab[:3], H @ a[:3] + dH @ v[:3], atol=1e-8 * scale)
    np.testing.assert_allclose(ab[3:], a[3:], atol=1e-9 * scale)
    assert ball.energy(qb, vb) == pytest.approx(euler.energy(q, v), rel=1e-12)


def test_a_turned_and_moving_seat_makes_no_difference() -> None:
    """A free-flying arm seen from axes that are shifted and turned: the same motion of the same bodies."""
    rng = np.random.default_rng(4)
    arm = two_links(fa.Free(), fa.Universal(), gravity=(0, 0, 0))
    q, v, tau = random_state(rng, arm)
    q[3:7] /= np.linalg.norm(q[3:7])
    tau[:6] = 0.0
    turn = Rotation.from_rotvec([0.4, -1.0, 0.3])
    p = turn.apply(q[:3]) + np.array([5.0, -2.0, 1.0])
    quat = (turn * Rotation.from_quat(q[[4, 5, 6, 3]])).as_quat()[[3, 0, 1, 2]]
    boost = np.array([3.0, 1.0, -7.0])
    q2, v2 = np.concatenate([p, quat, q[7:]]), np.concatenate([turn.apply(v[:3]) + boost, v[3:]])
    a, a2 = arm.forward_dynamics(q, v, tau), arm.forward_dynamics(q2, v2, tau)
    scale = np.abs(a).max()
    np.testing.assert_allclose(a2[:3], turn.apply(a[:3]), atol=1e-11 * scale)
    np.testing.assert_allclose(a2[3:], a[3:], atol=1e-11 * scale)


@pytest.mark.filterwarnings("ignore::flexarm.errors.RangeWarning")  # bends far, on purpose
def test_free_flight_keeps_energy_and_momentum() -> None:
    """A floating two-link flexible arm, undamped, over thousands of steps; its quaternion stays of unit length."""
    arm = two_links(fa.Free(), fa.Spherical(), gravity=(0, 0, 0))
    q0, v0 = arm.zero, np.zeros(arm.nv)
    v0[:6] = (0.1, -0.2, 0.3, 0.5, 1.0, -0.7)
    q0[7] = 0.1
    r = fa.simulate(arm, np.linspace(0, 1, 101), q0, v0, rtol=1e-9, atol=1e-11)
    assert r.stats["steps"] > 10_000
    kinetic, potential = r.energy()
    assert np.ptp(kinetic + potential) < 1e-6 * np.ptp(potential)
    # momentum of the whole arm in world axes: the free joint's rows of M v, turned from where they are measured
    M = arm.mass_matrix(r.q)
    p = np.einsum("tij,tj->ti", M[:, :6], r.v)
    linear = p[:, :3]
    angular = np.einsum("tij,tj->ti", unquaternion(r.q[:, 3:7]), p[:, 3:]) + np.cross(r.q[:, :3], linear)
    np.testing.assert_allclose(linear, np.tile(linear[0], (101, 1)), atol=1e-7)
    np.testing.assert_allclose(angular, np.tile(angular[0], (101, 1)), atol=1e-7)
    for first in (3, arm._core.first_q(1)):
        np.testing.assert_allclose(np.linalg.norm(r.q[:, first : first + 4], axis=1), 1.0, atol=1e-15)


def test_joint_reactions() -> None:
    """A pendulum's bearing carries weight and centripetal force; both sides see the same force and moment."""
    m, c, g, w = 2.0, 0.3, 9.81, 1.5
    bob = fa.RigidBody(m, (c, 0, 0), (0, 0, 0.01))
    arm = fa.Arm([fa.Link(fa.Revolute("z"), bob)], gravity=(0, -g, 0))
    q, v = [-np.pi / 2], [w]  # hanging, x down
    a = arm.forward_dynamics(q, v)
    f = arm.joint_reaction(q, v, a)
    np.testing.assert_allclose(f, [-m * (g + w * w * c), 0, 0, 0, 0, 0], atol=1e-12)
    seat = fa.Placement((0.1, 0.2, 0.3), (0.3, -0.2, 0.1))
    arm = two_links(fa.Spherical(), fa.Cylindrical("x", inboard=seat, outboard=seat))
    q, v, tau = random_state(np.random.default_rng(7), arm)
    a = arm.forward_dynamics(q, v, tau)
    out, inn = (arm.joint_reaction(q, v, a, 1, side) for side in ("outboard", "inboard"))
    (p0, R0), (p1, R1) = arm.frame(q, 0), fa.Arm(arm.links, arm.gravity).frame(q, 1, 0.0)
    p1 = p1 - R1 @ np.array(BODY.end)  # the link's origin
    np.testing.assert_allclose(R0 @ inn[:3], R1 @ out[:3], atol=1e-9)
    np.testing.assert_allclose(R0 @ inn[3:], R1 @ out[3:] + np.cross(p1 - p0, R1 @ out[:3]), atol=1e-9)
    axis = R0 @ Rotation.from_rotvec(seat.rotation).apply(
        [1, 0, 0]
    )  # of the cylinder: there the applied force and torque
    applied = tau[arm.joint_rates(1)]
    moment = R1 @ out[3:] + np.cross(p1 - (p0 + R0 @ np.array(seat.position)), R1 @ out[:3])
    np.testing.assert_allclose([axis @ R1 @ out[:3], axis @ moment], applied, atol=1e-7)


def test_spring_damper_and_stops() -> None:
    wheel = fa.RigidBody(inertia=(0, 0, 2.0))
    spring = fa.Arm([fa.Link(fa.Revolute("z", stiffness=8.0, damping=0.4, rest=0.3), wheel)])
    modes = spring.modes(q=[0.3])
    assert modes.frequencies[0] == pytest.approx(2.0)
    assert modes.damping[0] == pytest.approx(0.4 / (2 * np.sqrt(8.0 * 2.0)))
    assert spring.energy([0.8], [0.0])[1] == pytest.approx(0.5 * 8 * 0.25)
    stop = fa.Revolute("z", lower=-1.0, upper=0.5, limit_stiffness=1e4)
    arm = fa.Arm([fa.Link(stop, wheel)])
    r = fa.simulate(arm, np.linspace(0, 5, 2001), [0.0], [1.0], rtol=1e-9, atol=1e-11, max_order=2)
    depth = np.sqrt(2.0 / 1e4)  # 1/2 I w^2 = 1/2 k depth^2
    assert r.q.max() == pytest.approx(0.5 + depth, rel=1e-3) and r.q.min() == pytest.approx(-1.0 - depth, rel=1e-3)
    assert np.ptp(sum(r.energy())) < 1e-4
    soft = fa.Arm([fa.Link(fa.Revolute("z", upper=0.5, limit_stiffness=1e4, limit_damping=100.0), wheel)])
    back = fa.simulate(soft, np.linspace(0, 2, 201), [0.0], [1.0], rtol=1e-8, max_order=2).v[-1, 0]
    assert -0.8 < back < -0.1  # comes back, but slower


def test_spring_and_stop_of_a_ball() -> None:
    """A ball's spring bears m g l sin(turn) about any horizontal axis, like a revolute's; past its largest angle the
    stop takes over. The forces are those of the potential energy, their Jacobians exact, through zero turn too."""
    k, m, length = 4.0, 1.3, 0.4
    body = fa.RigidBody(m, (length, 0, 0), (0.1, 0.1, 0.1))
    turns = []
    for upper in (None, 0.5):
        options = {"stiffness": k, "upper": upper, "limit_stiffness": 300.0 if upper else 0.0}
        for axis, joint in (("y", fa.Revolute("y", **options)), (None, fa.Spherical(**options))):
            if axis and upper:
                options = {**options, "lower": -upper}
            arm = fa.Arm([fa.Link(joint, body)], gravity=(0, 0, -9.81))
            q = arm.equilibrium()
            turns.append(q[0] if axis else 2 * np.arctan2(np.linalg.norm(q[1:]), q[0]))
    assert turns[0] == pytest.approx(turns[1], rel=1e-9) and k * turns[0] == pytest.approx(
        m * 9.81 * length * np.cos(turns[0]), rel=1e-9
    )
    assert turns[2] == pytest.approx(turns[3], rel=1e-9) and 0.5 < turns[2] < turns[0]

    joint = fa.Spherical(stiffness=k, damping=0.1, upper=0.7, limit_stiffness=50.0, limit_damping=0.0)
    arm = fa.Arm([fa.Link(joint, body)])
    rng = np.random.default_rng(0)
    for turn in (0.0, 1e-9, 1e-5, 0.3, 0.69, 0.9, 2.5):
        axis = rng.normal(size=3)
        q = np.roll(Rotation.from_rotvec(turn * axis / np.linalg.norm(axis)).as_quat(), 1)
        v = rng.normal(size=3)
        E = arm._core.rates(q, np.zeros(3))[2]
        power = differences(lambda e, q=q, v=v, E=E: np.array([arm.energy(q + E @ v * e[0], 0 * v)[1]]), 1)[0, 0]
        force = arm.inverse_dynamics(q, 0 * v, 0 * v)
        assert v @ force == pytest.approx(power, rel=1e-8, abs=1e-9)
        assert np.allclose(arm.inverse_dynamics(-3 * q, 0 * v, 0 * v), force, atol=1e-12)
        by_q, by_v, _ = arm.inverse_derivatives(q, v, 0 * v)
        close(by_q, differences(lambda e, q=q, v=v: arm.inverse_dynamics(q + e, v, 0 * v), 4), 1e-8)
        close(by_v, differences(lambda e, q=q, v=v: arm.inverse_dynamics(q, v + e, 0 * v), 3), 1e-8)


def test_drives_of_single_freedoms() -> None:
    """Motion, torque and nothing, mixed within one joint; the reaction of the motion makes it."""
    arm = fa.Arm([fa.Link(fa.Planar(), BODY)])
    t = np.linspace(0, 1, 51)
    drive = {(0, 0): fa.Motion(lambda x: (x**3, 3 * x * x, 6 * x)), (0, 2): fa.Torque(0.1)}
    r = fa.simulate(arm, t, drive=drive, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(r.q[:, 0], t**3, atol=1e-12)
    np.testing.assert_allclose(r.tau[:, 1:], np.tile([0.0, 0.1], (51, 1)), atol=1e-12)
    again = fa.simulate(arm, t, drive={(0, 0): fa.Torque(t, r.tau[:, 0]), (0, 2): fa.Torque(0.1)}, rtol=1e-9)
    np.testing.assert_allclose(again.q, r.q, atol=1e-3)
    with refuses("drive: link = 0", "3 freedoms", "(0, 0)"):
        fa.simulate(arm, t, drive={0: fa.Torque(1.0)})
    with refuses("drive: link = (0, 3)", "0 to 2"):
        fa.simulate(arm, t, drive={(0, 3): fa.Torque(1.0)})
    ball = fa.Arm([fa.Link(fa.Spherical(), BODY)])
    with refuses("a ball", "prescribed"):
        fa.simulate(ball, t, drive={(0, 1): fa.Motion.spin_up(1, 1)})


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: fa.Axes(axes=("tx",) * 7), "axes = 7"),
        (lambda: fa.Axes(axes=("tx", "rw")), "'rw'"),
        (lambda: fa.Revolute("z", stiffness=-1.0), "stiffness[0] = -1"),
        (lambda: fa.Revolute("z", lower=1.0, upper=0.0), "lower[0] = 1"),
        (lambda: fa.Revolute("z", upper=0.0), "limit_stiffness[0] = 0"),
        (lambda: fa.Spherical(stiffness=(1, 2, 3)), "stiffness[1] = 2"),
        (lambda: fa.Spherical(rest=0.1), "rest[0] = 0.1"),
        (lambda: fa.Spherical(upper=4.0, limit_stiffness=1.0), "upper[0] = 4"),
        (lambda: fa.Spherical(lower=-1, upper=2, limit_stiffness=1.0), "lower[0] = -1"),
        (lambda: fa.Planar(damping=(1.0, 2.0)), ("damping has shape (2,)", "3", "numbers")),
        (lambda: fa.Fixed(inboard=(1, 2, 3)), ("inboard = (1, 2, 3)", "Placement")),
        (lambda: fa.Fixed(inboard=fa.Placement(rotation=2 * np.eye(3))), "inboard.rotation"),
        (lambda: fa.Arm.from_dict({"link": [{"joint": {"type": "axes", "axes": ["tx"], "inboard": {"positon": 1}}}]}),
         ("link[0].joint.inboard", "key 'positon'", "'position'")),
    ],
)  # fmt: skip
def test_bad_joints(make, message: str) -> None:
    with refuses(message):
        make()


def test_a_quaternion_needs_a_length() -> None:
    arm = two_links(fa.Free(), fa.Revolute("y"))
    for call in (lambda: arm.mass_matrix(np.zeros(arm.nq)), lambda: fa.simulate(arm, [0, 1], np.zeros(arm.nq))):
        with refuses("[3:7] = 0 0 0 0", "quaternion", "link 0 free"):
            call()
