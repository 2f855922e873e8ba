"""Inversion: against closed forms, Bayo's frequency-domain inverse, and runs of an independent integrator."""

from __future__ import annotations

from dataclasses import replace

import flexarm as fa
import numpy as np
import pytest
from arms import STEEL, paper_link
from messages import refuses, warns
from scipy.spatial.transform import Rotation

pytestmark = pytest.mark.filterwarnings("ignore::flexarm.errors.RangeWarning")
GRAVITY = (0.0, 0.0, -9.81)


def rise(s: np.ndarray) -> np.ndarray:
    """From 0 to 1 with four continuous derivatives."""
    return s**5 * (126 - 420 * s + 540 * s**2 - 315 * s**3 + 70 * s**4)


def move(a: float, b: float, T: float = 1.0, n: int = 101) -> fa.Motion:
    t = np.linspace(0.0, T, n)
    return fa.Motion(t, a + (b - a) * rise(t / T), ends="rest")


def beam_link(joint: fa.Joint, side: float, modes: dict[str, int], tip: float = 0.2, **beam) -> fa.Link:
    return fa.Link(
        joint,
        fa.RigidBody(0.2, (0, 0, 0), np.eye(3) * 1e-3, (0.03, 0, 0)),
        fa.Beam(0.5, fa.Rectangle(side, 0.02), STEEL, modes, **beam),
        fa.RigidBody(tip, (0, 0, 0), np.eye(3) * 1e-4),
    )


def spatial(n: int = 2, **beam) -> fa.Arm:
    """Three links in space, loaded."""
    modes = {"bending_y": n, "bending_z": n, "torsion": 1}
    return fa.Arm([beam_link(fa.Revolute(axis), 0.015, modes, **beam) for axis in "zyy"], GRAVITY)


def bent(arm: fa.Arm, *joints: float) -> tuple[np.ndarray, np.ndarray]:
    """A pose in balance, and its tip."""
    q = arm.zero
    for k, angle in enumerate(joints):
        q[arm.joint_rate(k)] = angle
    return q, arm.frame(arm.equilibrium(q, lock=range(len(joints))))[0]


def straight(p: np.ndarray, *by: float, T: float = 1.0) -> dict[str, fa.Motion]:
    return {name: move(p[k], p[k] + d, T) for k, (name, d) in enumerate(zip("xyz", by, strict=False))}


def missed(inv: fa.results.Inversion, **options) -> float:
    return float(np.abs(inv.tip_error(inv.replay(**options))).max())


def test_small_paths_are_followed_as_large_ones() -> None:
    """The arm is linear there: torques go with the path, by IDA the tip keeps to it."""
    links = [beam_link(fa.Revolute("z"), 0.008, {"bending_y": 2}) for _ in range(2)]
    arm = fa.Arm(links)
    q, p = bent(arm, -1.0, 1.2)
    found = [fa.invert(arm, straight(p, size, size, T=0.5), q=q) for size in (1e-4, 1e-7)]
    assert missed(found[1], rtol=1e-9, atol=1e-14) < 2e-4 * 1e-7
    peaks = [np.abs(x.tau).max(axis=0) for x in found]
    assert 1e3 * peaks[1] == pytest.approx(peaks[0], rel=2e-3)


# -- numbers from elsewhere -------------------------------------------------------------------------------------------


def test_two_masses_and_a_spring_in_closed_form() -> None:
    m1, m2, k, b = 1.3, 0.7, 40.0, 0.4
    body = [fa.RigidBody(m) for m in (m1, m2)]
    arm = fa.Arm([fa.Link(fa.Prismatic("x"), body[0]), fa.Link(fa.Prismatic("x", stiffness=k, damping=b), body[1])])
    path = move(0.0, 0.5)
    inv = fa.invert(arm, {"x": path}, passive=[1], tolerance=1e-9)
    y, _, a = np.array([path(min(max(t, 0.0), 1.0)) for t in inv.t]).T
    stretch = -inv.q[:, 1]  # of the spring: b s' + k s = m2 a, causal
    assert np.abs(b * -inv.v[:, 1] + k * stretch - m2 * a).max() < 1e-5 * np.abs(m2 * a).max()
    assert np.abs(inv.tau[:, 0] - m1 * inv.a[:, 0] - m2 * a).max() < 1e-5 * np.abs(m2 * a).max()
    assert not inv.tau[:, 1].any()
    assert np.abs(inv.q.sum(axis=1) - y).max() < 1e-12
    undamped = fa.Arm([arm.links[0], fa.Link(fa.Prismatic("x", stiffness=k), body[1])])
    inv = fa.invert(undamped, {"x": path}, passive=[1], tolerance=1e-9)
    y, _, a = np.array([path(min(max(t, 0.0), 1.0)) for t in inv.t]).T
    assert np.abs(inv.q[:, 0] - y - m2 * a / k).max() < 1e-6


def test_masses_in_a_line_have_no_poles_but_those_of_their_dampers() -> None:
    # the last mass stands on the path, so that nothing that is left can swing
    def line(*springs: tuple[float, float]) -> fa.Arm:
        joints = [fa.Prismatic("x"), *(fa.Prismatic("x", stiffness=k, damping=b) for k, b in springs)]
        return fa.Arm([fa.Link(joint, fa.RigidBody(1.0 / (1 + n))) for n, joint in enumerate(joints)])

    def poles(arm: fa.Arm) -> np.ndarray:
        found = fa.invert(arm, {"x": move(0.0, 0.1)}, passive=range(1, len(arm.links))).poles
        np.testing.assert_allclose(found[0], found[1])
        return found[0]

    for arm in (line((40.0, 0.0)), line((40.0, 0.0), (3e4, 0.0)), line((40.0, 0.0), (50.0, 0.0), (2e3, 0.0))):
        assert not len(poles(arm))
    np.testing.assert_allclose(poles(line((40.0, 0.4))), [-100.0], rtol=1e-9)  # -k / b


def bayo(T: float, tip: np.ndarray, h: float, mass: float) -> np.ndarray:
    """The torque of the paper's link with a mass on its end, pinned, whose tip's arc is `tip` (n,): modes and matrices
    written anew, frequency by frequency (E. Bayo, J. Robotic Systems 4 (1987), 61-75)."""
    L, r, rho, EI = 0.5, 0.075, 7850 * 0.001 * 0.02, 209e9 * 0.02 * 0.001**3 / 12
    x, w = np.polynomial.legendre.leggauss(60)
    x, w = L * (x + 1) / 2, w * L / 2
    shapes, curvatures = [], []
    for z in (1.8751040687119611, 4.694091132974174, 7.854757438237612):
        s, u = (np.sinh(z) - np.sin(z)) / (np.cosh(z) + np.cos(z)), z * x / L
        end = np.cosh(z) - np.cos(z) - s * (np.sinh(z) - np.sin(z))
        shapes.append((np.cosh(u) - np.cos(u) - s * (np.sinh(u) - np.sin(u))) / end)
        curvatures.append((z / L) ** 2 * (np.cosh(u) + np.cos(u) - s * (np.sinh(u) + np.sin(u))) / end)
    rows = np.array([r + x, *shapes])
    ends = np.array([r + L, 1.0, 1.0, 1.0])
    M = rho * (rows * w) @ rows.T + mass * np.outer(ends, ends)
    K = np.zeros((4, 4))
    K[1:, 1:] = EI * (np.array(curvatures) * w) @ np.array(curvatures).T
    Y, omega = np.fft.rfft(tip), 2 * np.pi * np.fft.rfftfreq(len(tip), h)
    torque = np.empty(len(Y), complex)
    for i, frequency in enumerate(omega):
        A = np.zeros((5, 5))  # of theta, the modes, and the torque
        A[:4, :4] = K - frequency**2 * M
        A[0, 4], A[4, :4] = -1.0, ends
        torque[i] = np.linalg.solve(A.astype(complex), [0, 0, 0, 0, Y[i]])[4]
    return np.fft.irfft(torque, len(tip))


def test_a_linear_link_has_bayos_inverse() -> None:
    beam = paper_link(order=1, rotary_inertia=False).links[0]
    arm = fa.Arm([fa.Link(beam.joint, beam.hub, beam.beam, fa.RigidBody(0.02))])
    turn, T, h, n = 1e-5, 0.8, 1e-3, 8192
    inv = fa.invert(arm, {"azimuth": move(0.0, turn, T)}, tolerance=1e-12)
    # there and back, so that it is periodic
    t = h * np.arange(n)
    there = rise(np.clip((t - 2.0) / T, 0, 1)) - rise(np.clip((t - 5.5) / T, 0, 1))
    torque = bayo(T, 0.575 * turn * there, h, 0.02)
    at = np.interp(inv.t + 2.0, t, torque)
    assert np.abs(inv.tau[:, 0]).max() > 1e-6
    assert np.abs(inv.tau[:, 0] - at).max() < 1e-4 * np.abs(at).max()
    before = inv.t < -0.02
    assert np.abs(inv.tau[before, 0]).max() > 1e-3 * np.abs(at).max()  # it begins ahead of the path


def test_an_inversion_tells_how_far_it_is() -> None:
    told: list[str] = []
    inv = fa.invert(paper_link(), {"azimuth": move(0.0, 0.3)}, progress=lambda done, doing: told.append(doing))
    assert len(told) >= inv.iterations > 0 and told[0].endswith("rows, iteration 1")


def test_a_rigid_arm_has_its_inverse_dynamics() -> None:
    link = fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, (0.2, 0, 0), np.eye(3) * 0.01, (0.5, 0, 0)))
    arm = fa.Arm([link, link], (0.0, -9.81, 0.0))
    q, p = bent(arm, 0.3, 0.8)
    inv = fa.invert(arm, straight(p, -0.2, 0.1), q=q)
    assert np.abs(inv.tau - arm.inverse_dynamics(inv.q, inv.v, inv.a)).max() < 1e-12
    elbow = np.arccos(((inv.wanted**2).sum(axis=1) - 0.5) / 0.5)
    assert np.abs(inv.q[:, 1] - elbow).max() < 1e-9
    assert missed(inv) < 1e-9


# -- replays ----------------------------------------------------------------------------------------------------------


def test_one_link_follows_where_computed_torque_rings() -> None:
    arm = paper_link()
    tip = {"azimuth": move(0.0, 1.5, 0.6)}
    inv = fa.invert(arm, tip)
    assert inv.pre > 0.2 and inv.post > 0.2 and inv.error < 1e-7
    assert missed(inv) < 1e-7
    assert missed(inv, how="torque") < 1e-5
    for method in ("quasi-static", "rigid"):
        assert missed(fa.invert(arm, tip, method=method)) > 0.05


def test_two_links_in_the_plane_do_the_work_that_the_energy_tells() -> None:
    arm = fa.Arm([beam_link(fa.Revolute("z"), side, {"bending_y": 3}) for side in (0.006, 0.004)], (0.0, -9.81, 0.0))
    q, p = bent(arm, 0.3, 0.9)
    inv = fa.invert(arm, straight(p, -0.3, 0.2), q=q)
    assert missed(inv) < 1e-7
    kinetic, potential = arm.energy(inv.q, inv.v)
    power = (inv.tau * inv.v).sum(axis=1)
    work = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(inv.t) * (power[1:] + power[:-1]))])
    gained = kinetic + potential - kinetic[0] - potential[0]
    assert np.ptp(gained) > 0.5
    assert np.abs(gained - work).max() < 2e-3 * np.ptp(gained)


def test_three_links_in_space_and_a_finer_model() -> None:
    arm = spatial()
    q, p = bent(arm, 0.2, -0.7, 1.2)
    inv = fa.invert(arm, straight(p, -0.2, 0.5, 0.2, T=1.5), q=q)
    assert missed(inv) < 1e-6
    fine = spatial(5, basis="legendre")
    rigid = fa.invert(arm, straight(p, -0.2, 0.5, 0.2, T=1.5), posture=q, method="rigid")
    assert missed(inv, arm=fine, integrator="implicit", step=2e-3) < 0.1 * missed(
        rigid, arm=fine, integrator="implicit", step=2e-3
    )
    run = inv.replay(how="feedback", kp=200.0, kv=20.0)
    assert np.abs(inv.tip_error(run)).max() < 1e-5


def test_more_joints_than_components_stay_near_the_posture() -> None:
    modes = {"bending_y": 2}
    arm = fa.Arm([beam_link(fa.Revolute("z"), 0.012, modes) for _ in range(3)])
    q, p = bent(arm, 0.2, 0.6, 0.5)
    back = {name: fa.Motion(t := np.linspace(0, 2, 201), p[k] + d * np.sin(np.pi * rise(t / 2)) ** 4, ends="rest")
            for k, (name, d) in enumerate({"x": -0.15, "y": 0.1}.items())}  # fmt: skip
    inv = fa.invert(arm, back, q=q)
    assert missed(inv) < 1e-6
    th = [arm.joint_rate(k) for k in range(3)]
    assert np.abs(inv.q[-1, th] - inv.q[0, th]).max() < 1e-8
    still = fa.invert(arm, back, q=q, method="quasi-static")
    middle = len(still.t) // 2
    away = still.q[middle, th] - q[th]
    _, _, Vt = np.linalg.svd(arm.jacobian(still.q[middle])[:2, th])
    assert np.linalg.norm(away) > 0.05
    assert abs(Vt[2] @ away) < 1e-3 * np.linalg.norm(away)


def test_slices_slides_turns_and_held_joints() -> None:
    gantry = fa.Arm([beam_link(fa.Prismatic("y"), 0.004, {"bending_y": 3})])
    assert missed(fa.invert(gantry, {"y": move(0.0, 0.4)})) < 1e-7
    arm = paper_link(damping_ratio=0.05)
    assert missed(fa.invert(arm, {"azimuth": move(0.0, 1.0, 1.5)}, x=0.25)) < 1e-6
    assert missed(fa.invert(arm, {"rz": move(0.0, 1.0)})) < 1e-6
    arm = spatial()
    q, p = bent(arm, 0.2, -0.7, 1.2)
    inv = fa.invert(arm, {"y": move(p[1], p[1] + 0.1, 1.5)}, q=q, lock=[1, 2])
    assert inv.joints == [0] and missed(inv) < 1e-6


def test_seven_links_in_space_obey_forward_dynamics() -> None:
    modes = {"bending_y": 3, "bending_z": 3, "torsion": 1}
    arm = fa.Arm([beam_link(fa.Revolute(axis), 0.02, modes, basis="legendre") for axis in "zyyxyxy"], GRAVITY)
    assert arm.nv == 56
    q, p = bent(arm, 0.3, -0.6, 0.9, 0.3, 0.7, -0.2, 0.5)
    inv = fa.invert(arm, straight(p, -0.3, 0.8, 0.4, T=2.0), q=q)
    assert inv.error < 1e-7 and inv.edge < 1e-6
    assert np.abs(arm.frame(inv.q)[0] - inv.wanted).max() < 1e-10
    a = arm.forward_dynamics(inv.q, inv.v, inv.tau)  # by articulated bodies
    joints = [arm.joint_rate(k) for k in range(7)]
    assert np.abs(inv.a[:, joints]).max() > 0.3
    assert np.abs(a - inv.a)[:, joints].max() < 0.05 * np.abs(inv.a[:, joints]).max()


def test_six_joints_turn_the_tip_as_they_carry_it() -> None:
    modes = {"bending_y": 2, "bending_z": 2, "torsion": 1}
    arm = fa.Arm([beam_link(fa.Revolute(axis), 0.02, modes, damping_ratio=0.01) for axis in "zyyxyx"], GRAVITY)
    q, p = bent(arm, 0.3, -0.8, 1.3, 0.4, 0.6, 0.2)
    turn = Rotation.from_matrix(arm.frame(arm.equilibrium(q, lock=range(6)))[1]).as_rotvec()
    tip = straight(p, -0.1, 0.25, 0.1, T=1.5)
    tip |= {name: move(a, a + d, 1.5) for name, a, d in zip(("rx", "ry", "rz"), turn, (0.3, -0.2, 0.2), strict=True)}
    inv = fa.invert(arm, tip, q=q)
    run = inv.replay()
    reached = Rotation.from_matrix(run.frame()[1][-1]).as_rotvec()
    assert np.abs(reached - turn - [0.3, -0.2, 0.2]).max() < 1e-6
    assert np.abs(inv.tip_error(run)).max() < 1e-6


def test_freedoms_of_one_joint_and_the_order_of_components() -> None:
    modes = {"bending_y": 2, "bending_z": 2, "torsion": 1}
    arm = fa.Arm([beam_link(joint, 0.02, modes) for joint in (fa.Universal(), fa.Revolute("y"))], GRAVITY)
    q = arm.zero
    q[[0, 1, 7]] = 0.2, -0.3, 0.9
    p = arm.frame(arm.equilibrium(q, lock=[0, 1]))[0]
    tip = straight(p, -0.1, 0.2, 0.1, T=1.5)
    inv = fa.invert(arm, dict(reversed(tip.items())), q=q)
    assert inv.names == ("x", "y", "z") and inv.joints == [(0, 0), (0, 1), 1]
    assert missed(inv) < 1e-6
    assert missed(fa.invert(arm, tip, q=q), how="feedback", kp=[300, 200, 100], kv=10) < 1e-6


# -- limits -----------------------------------------------------------------------------------------------------------


def test_limits_are_told_or_the_path_is_slowed() -> None:
    arm = paper_link()
    tip = {"azimuth": move(0.0, 1.5, 0.6)}
    most = float(np.abs(fa.invert(arm, tip).tau).max())
    with warns(fa.errors.InversionWarning, "link 0 revolute", "t =", "torque", "limit"):
        inv = fa.invert(arm, tip, limits={"torque": 0.5 * most})
    assert inv.exceeded[0].kind == "torque" and abs(inv.exceeded[0].value) == most
    inv = fa.invert(arm, tip, limits={"torque": 0.5 * most}, stretch=True)
    assert 1.1 < inv.slowed < 2.0 and not inv.exceeded
    assert 0.45 * most < np.abs(inv.tau).max() <= 0.5 * most
    assert missed(inv) < 1e-6
    named = fa.Arm([replace(x, joint=replace(x.joint, name="shoulder")) for x in arm])
    with warns(fa.errors.InversionWarning, "torque", "shoulder"):
        by_name = fa.invert(named, tip, limits={"torque": {"shoulder": 0.5 * most}})
    assert {x.joint for x in by_name.exceeded} == {0} and by_name.exceeded[0].name == "shoulder"
    with warns(fa.errors.InversionWarning, "range", "shoulder"):
        fa.invert(named, tip, limits={"range": {"shoulder": (-1.0, 1.0)}})
    with refuses("limits['torque']", "link = 'shoulde'", "'shoulder'"):
        fa.invert(named, tip, limits={"torque": {"shoulde": 1.0}})
    assert by_name.plot().axes[-1].get_title("left") == "shoulder"
    with warns(fa.errors.InversionWarning, "range", "1.5", "1"):
        fa.invert(arm, tip, limits={"range": (-1.0, 1.0)})
    with refuses("limits", "range", "1.5"):
        fa.invert(arm, tip, limits={"range": (-1.0, 1.0)}, stretch=True)


# -- what cannot be ---------------------------------------------------------------------------------------------------


def test_bad_input_is_named() -> None:
    arm = fa.Arm([beam_link(fa.Revolute("z"), 0.006, {"bending_y": 2}) for _ in range(2)])
    q, p = bent(arm, 0.3, 0.9)
    good = straight(p, -0.2, 0.1)
    t = np.linspace(0.0, 1.0, 30)

    def refused(named: str | tuple[str, ...], *args, **kwargs) -> None:
        with refuses(named):
            fa.invert(*args, **kwargs)

    refused("arm = 3", 3, good)
    refused(("tip =", "dictionary"), arm, move(0, 1))
    refused(("tip", "'X'"), arm, {"X": move(0, 1)})
    refused(("tip", "component"), arm, {"x": 0.1})
    refused("tip['x'] = nan", arm, {"x": np.nan, "y": move(0, 1)})
    refused(("q", "tip"), arm, straight(p + 0.01, -0.2, 0.1), q=q)
    refused(("q", "nan"), arm, good, q=q * np.nan)
    refused("q has shape", arm, good, q=[1.0])
    refused("reach", arm, straight(p, 0.5, 0.5), q=q)
    refused(("t =", "reach"), arm, straight(p, 0.5, 0.5), q=q)
    refused(("posture", "singular"), arm, good)  # zero is straight
    refused(("t = 0.5 s", "singular"), arm, straight(p, *(-2 * p[:2])), q=q)
    refused(("3 components", "3 driven joints"), arm, {**good, "rz": 0.3}, q=q)
    refused(("tip['azimuth']", "velocity"), arm, {"azimuth": fa.Motion(t, t)})
    jumps = fa.Motion(t, t**2 * (3 - 2 * t), 6 * t * (1 - t), 6 - 12 * t)
    refused(("tip['azimuth']", "acceleration"), arm, {"azimuth": jumps})
    refused(("tip['azimuth']", "t ="), arm, {"azimuth": fa.Motion(lambda s: (0.0, 0.0, 0.0))})
    refused("link = 7", arm, good, q=q, link=7)
    refused("tolerance = 0.0", arm, good, q=q, tolerance=0.0)
    refused("method = 'bayo'", arm, good, q=q, method="bayo")
    refused("limits['torque'] = -1", arm, good, q=q, limits={"torque": -1.0})
    refused(("limits['range']", "highest"), arm, good, q=q, limits={"range": (1.0, -1.0)})
    refused(("'x'", "Motion", "number"), arm, {"x": [0.1, 0.2], "y": 0.3}, q=q)
    refused("6000 steps", arm, good, q=q, pre=1e9)
    refused(("joint", "z"), arm, {"z": move(0, 0.1)}, posture=q)
    ball = fa.Link(fa.Spherical(), fa.RigidBody(1.0, (0.5, 0, 0), np.eye(3), (1, 0, 0)))
    refused("link 0 spherical", fa.Arm([ball]), good)


def test_a_path_that_stays_needs_what_holds_the_arm() -> None:
    arm = spatial()
    q, p = bent(arm, 0.2, -0.7, 1.2)
    inv = fa.invert(arm, {"x": p[0], "y": move(p[1], p[1]), "z": p[2]}, q=q)
    held = arm.inverse_dynamics(arm.equilibrium(q, lock=range(3)), np.zeros(arm.nv), np.zeros(arm.nv))
    assert np.abs(held).max() > 1.0
    assert np.abs(inv.tau - held).max() < 1e-6
    assert np.abs(inv.v).max() < 1e-8


def test_dry_friction_is_overcome_and_the_joints_stops_are_limits() -> None:
    stopped = fa.Revolute("z", coulomb=0.3, damping=0.1, lower=-0.5, upper=0.5, limit_stiffness=1e-9)
    joints = (stopped, fa.Revolute("z", damping=0.1))
    arm, free = (fa.Arm([beam_link(joint, 0.004, {"bending_y": 3})]) for joint in joints)
    with warns(fa.errors.InversionWarning, "link 0 revolute", "1", "t =", "0.5", "range", "limit"):
        inv = fa.invert(arm, {"azimuth": move(0.0, 1.0)})
    smooth = fa.invert(free, {"azimuth": move(0.0, 1.0)})
    middle = np.abs(inv.v[:, 0]) > 1e-3
    assert np.allclose((inv.tau - smooth.tau)[middle, 0], 0.3, atol=1e-8)


def test_a_passive_joint_that_nothing_holds_is_named() -> None:
    arm = fa.Arm([beam_link(fa.Revolute("z"), 0.006, {"bending_y": 2}) for _ in range(2)])
    with refuses("passive", "'link 1 revolute'"):
        fa.invert(arm, {"azimuth": move(0.0, 1.0)}, passive=[1])


def test_a_callable_that_jumps_is_named() -> None:
    def kinked(t: float) -> tuple[float, float, float]:
        v = 30 * t**2 * (1 - t) ** 2
        return 10 * t**3 - 15 * t**4 + 6 * t**5 + (0.1 if t > 0.4 else 0.0), v, 60 * t * (1 - t) * (1 - 2 * t)

    with refuses("jumps", "0.1", "t = 0.4"):
        fa.invert(paper_link(), {"azimuth": fa.Motion(kinked)}, t=(0, 1))


def test_what_rings_for_ever_is_told() -> None:
    with warns(fa.errors.InversionWarning, "imaginary axis"):
        inv = fa.invert(paper_link(), {"azimuth": move(0.0, 1.5)}, x=0.25)
    assert missed(inv) < 1e-6  # the tip is on its path all the same
    body = [fa.RigidBody(m) for m in (1.0, 1.0)]
    arm = fa.Arm([fa.Link(fa.Prismatic("x"), body[0]), fa.Link(fa.Prismatic("x", stiffness=40.0), body[1])])
    with refuses("inverse", "6.325 rad/s"):
        fa.invert(arm, {"x": move(0.0, 0.5)}, passive=[1], link=0)


def test_times_of_samples_are_their_own() -> None:
    with refuses("t", "callables"):
        fa.invert(paper_link(), {"azimuth": move(0.0, 1.0)}, t=(0, 1))
