"""A limit on the joint holds for the sum of all that drives it, wherever an arm moves in time."""

from __future__ import annotations

from dataclasses import replace

import flexarm as fa
import numpy as np
import pytest
from messages import refuses
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

INERTIA, MOST = 0.35, 2.0
EVERY = {"ida": {"rtol": 1e-10, "atol": 1e-12}, "implicit": {"step": 1e-4}, "gauss": {"step": 1e-3},
         "rk4": {"step": 1e-4}}  # fmt: skip
t = np.linspace(0.0, 1.0, 101)


def rigid(limit: float | None = MOST, **joint) -> fa.Arm:
    """A link of inertia 0.35 kg m² about its joint."""
    body = fa.RigidBody(1.0, (0.5, 0, 0), (0, 0, 0.1), (1, 0, 0))
    return fa.Arm([fa.Link(fa.Revolute("z", torque_limit=limit, **joint), body)])


def flexible(limit: float | None = MOST, **joint) -> fa.Arm:
    beam = fa.Beam(0.5, fa.Rectangle(0.002, 0.02), fa.Material(7850, 209e9, 0.3), {"bending_y": 2}, "legendre")
    return fa.Arm([
        fa.Link(fa.Revolute("z", torque_limit=limit, **joint), fa.RigidBody(0.3, (0.05, 0, 0), (0, 0, 1e-3)), beam),
        fa.Link(fa.Revolute("z", torque_limit=None if limit is None else 0.3 * limit), beam=beam),
    ])  # fmt: skip


def push(s: float) -> float:
    return 1.5 * np.sin(9.0 * s)


def asked(s: float, q: float, v: float) -> float:
    """PD limited to 1.8, a drive, and a constant torque."""
    return float(np.clip(20.0 * (0.6 - q) - 1.0 * v, -1.8, 1.8)) + push(s) + 0.4


TORQUE = fa.Torque(np.linspace(0, 1, 2001), np.vectorize(push)(np.linspace(0, 1, 2001)))
PD = fa.PD(20.0, 1.0, 0, reference=0.6, limit=1.8)


def truth() -> np.ndarray:
    def slope(s: float, y: np.ndarray) -> list[float]:
        return [y[1], float(np.clip(asked(s, *y), -MOST, MOST)) / INERTIA]

    return np.asarray(solve_ivp(slope, (0, 1), [0.0, 0.0], t_eval=t, rtol=1e-11, atol=1e-12, max_step=1e-3).y)


@pytest.mark.parametrize("integrator", EVERY)
def test_the_sum_of_drive_control_and_constant_torque_is_limited(integrator: str) -> None:
    run = fa.simulate(rigid(), t, drive={0: TORQUE}, tau=[0.4], control=PD, integrator=integrator, **EVERY[integrator])
    q, v = truth()
    assert run.q[:, 0] == pytest.approx(q, abs=3e-6) and run.v[:, 0] == pytest.approx(v, abs=2e-5)
    wanted = np.array([np.clip(asked(*x), -MOST, MOST) for x in zip(t, q, v, strict=True)])
    assert run.tau[:, 0] == pytest.approx(wanted, abs=1e-4)
    assert np.abs(run.tau).max() == MOST  # to the last digit
    free = fa.simulate(rigid(None), t, drive={0: TORQUE}, tau=[0.4], control=PD, integrator="implicit", step=1e-3)
    assert np.abs(free.tau).max() > 1.5 * MOST


@pytest.mark.parametrize("integrator", EVERY)
def test_held_and_fed_forward_torques_count_as_well(integrator: str) -> None:
    """A sampled PD with a limit of its own and a feed-forward: 160 came out at a motor of 120."""
    turn = fa.Motion([0, 0.5, 1.0], [0, 0.3, 0.6], [0, 0.6, 0], a=[0, 0, 0])
    law = fa.LinearController([], None, None, [[20.0, 1.0]], rate=500, measure=[("joint", 0), ("rate", 0)], limit=1.8,
                              reference=[0.6, 0.0])  # fmt: skip
    other = fa.FeedForward(turn.scaled(8.0))
    run = fa.simulate(rigid(), t, control=[law, other], integrator=integrator, **EVERY[integrator])
    assert np.abs(run.tau).max() == MOST
    assert run.a[:, 0] == pytest.approx(run.tau[:, 0] / INERTIA, rel=1e-6)
    assert INERTIA * run.v[-1, 0] == pytest.approx(fa.simulate(
        rigid(), np.linspace(0, 1, 20001), control=[law, other], integrator="implicit", step=5e-5
    ).tau[:, 0].mean(), rel=3e-3)  # fmt: skip


@pytest.mark.parametrize("rubs", [{}, {"coulomb": 0.4, "stiction": 0.6}])
def test_all_integrators_agree_on_a_flexible_arm(rubs: dict[str, float]) -> None:
    """With dry friction as well, which is not the motor's and not within its limit."""
    arm = flexible(1.0, **rubs)
    control = [fa.PD(20.0, 1.0, 0, reference=0.6, limit=0.9), fa.PD(5.0, 0.3, 1, reference=-0.4)]
    runs = {}
    for integrator, options in EVERY.items():
        if integrator == "rk4" and rubs:
            continue
        runs[integrator] = fa.simulate(arm, t, tau=np.eye(6)[0] * 0.5, control=control, integrator=integrator,
                                       **{**options, **({"step": 2e-5} if integrator == "rk4" else {})})  # fmt: skip
    for name, run in runs.items():
        assert np.abs(run.tau[:, [0, 3]]).max(axis=0) == pytest.approx([1.0, 0.3], abs=1e-12), name
        assert run.q[-1] == pytest.approx(runs["ida"].q[-1], abs=1e-3 if rubs else 3e-4), name


@pytest.mark.parametrize("motor", [True, False])
def test_a_step_is_solved_however_stiff_the_law_that_is_limited(motor: bool) -> None:
    """Newton's iteration jumped from one limit to the other and back. Against the trapezoidal rule, step by step."""
    kp, kd, most, h = 2e4, 700.0, 1.8, 0.01  # 0.5 h kd is 10 times the inertia
    law = fa.PD(kp, kd, 0, reference=0.02, limit=None if motor else most)
    run = fa.simulate(rigid(most if motor else None), np.arange(0, 0.5, h), v0=[0.3], control=law,
                      integrator="implicit", step=h)  # fmt: skip
    q, v, a = 0.0, 0.3, most / INERTIA
    inside = 0
    for k in range(1, len(run.t)):

        def end(x: float, q: float = q, v: float = v, a: float = a) -> tuple[float, float]:
            return q + h * v + 0.25 * h * h * (a + x), v + 0.5 * h * (a + x)

        def force(x: float) -> float:
            to, rate = end(x)
            return float(np.clip(kp * (0.02 - to) - kd * rate, -most, most))

        x = float(brentq(lambda x: INERTIA * x - force(x), -9.0, 9.0, xtol=1e-13, rtol=1e-14))
        (q, v), a = end(x), x
        inside += abs(force(x)) < most
        assert [run.q[k, 0], run.v[k, 0], run.tau[k, 0]] == pytest.approx([q, v, INERTIA * a], abs=1e-8), k
    assert 3 < inside < 45


@pytest.mark.parametrize("step", [1e-2, 5e-3, 2e-3, 1e-3, 5e-4, 2.5e-4])
def test_steps_of_any_length_are_solved(step: float) -> None:
    """A flexible arm, which changes between limits within a step, of laws and of motors, alone and in a batch."""
    control = [fa.PD(20.0, 1.0, 0, reference=0.6, limit=0.9), fa.PD(5.0, 0.3, 1, reference=-0.4)]
    for limit in (1.0, None) if step < 5e-3 else (1.0,):  # free of limits, it moves too far in one step
        options = {"tau": np.eye(6)[0] * 0.5, "control": control, "integrator": "implicit", "step": step}
        run = fa.simulate(flexible(limit), [0.0, 0.1, 0.2], **options)
        batch = fa.simulate_batch(flexible(limit), run.t, np.zeros((9, 6)), **{**options, "tau": options["tau"][None]})
        assert batch.q == pytest.approx(np.broadcast_to(run.q, batch.q.shape), abs=1e-9)


@pytest.mark.parametrize("integrator", ["implicit", "rk4"])
@pytest.mark.parametrize("count", [1, 9])
def test_batches_and_rollouts_are_limited_as_runs_are(integrator: str, count: int) -> None:
    arm, step = flexible(1.0), 1e-3 if integrator == "implicit" else 2e-5
    control = [fa.PD(20.0, 1.0, 0, reference=0.6, limit=0.9), fa.PD(5.0, 0.3, 1, reference=-0.4)]
    tau = np.eye(6)[0] * np.linspace(0.2, 0.6, count)[:, None]
    limits = np.linspace(0.8, 1.2, count)
    times = np.linspace(0, 0.2, 11)
    batch = fa.simulate_batch(arm, times, tau=tau[:, None], control=control, integrator=integrator, step=step,
                              outputs=("q", "tau"), parameters={"link.0.joint.torque_limit": limits})  # fmt: skip
    for k in {0, count - 1}:
        joint = replace(arm.links[0].joint, torque_limit=float(limits[k]))
        own = fa.Arm([replace(arm.links[0], joint=joint), arm.links[1]])
        one = fa.simulate(own, times, tau=tau[k], control=control, integrator=integrator, step=step)
        assert batch.q[k] == pytest.approx(one.q, abs=1e-11) and batch.tau[k] == pytest.approx(one.tau, abs=1e-9)
        assert np.abs(batch.tau[k, :, 0]).max() == limits[k]
    held = np.broadcast_to(3.0 * tau[:, None], (count, 200 if integrator == "implicit" else 100, 6))
    fast = fa.rollout(arm, arm.zero, np.zeros((count, 6)), held, step=step, integrator=integrator)
    same = fa.rollout(flexible(None), arm.zero, np.zeros((count, 6)), np.clip(held, -1.0, 1.0), step=step,
                      integrator=integrator)  # fmt: skip
    assert fast.q == pytest.approx(same.q, abs=1e-13)


def two(**joint) -> fa.Arm:
    link = fa.Link(fa.Revolute("z", **joint), fa.RigidBody(1.0, (0.5, 0, 0), (0, 0, 0.1), (1, 0, 0)))
    return fa.Arm([link, link])


MEASURED = [("joint", 0), ("joint", 1), ("rate", 0), ("rate", 1)]
GAINS = np.array([[90.0, 0, 12.0, 0], [0, 30.0, 0, 4.0]])


@pytest.mark.parametrize("law", [
    fa.LinearController([], None, None, GAINS, measure=MEASURED, actuate=[0, 1], limit=[3.0, 0.5], reference=1.0),
    fa.LinearController([], None, None, GAINS, measure=MEASURED, actuate=[0, 1], limit=[3.0, 0.5], reference=1.0,
                        rate=500),
    fa.StateFeedback(GAINS, [0, 1], q0=[1, 1], limit=[3.0, 0.5]),
    fa.Sampled(lambda s, y: GAINS @ (1.0 - y), 500, MEASURED, [0, 1], limit=[3.0, 0.5]),
])  # fmt: skip
def test_each_output_of_a_law_has_a_limit_of_its_own(law: fa.Controller, tmp_path) -> None:
    run = fa.simulate(two(), t, control=law, integrator="implicit", step=1e-3)
    assert np.abs(run.tau).max(axis=0).tolist() == [3.0, 0.5]
    if isinstance(law, fa.Sampled) and not isinstance(law, fa.LinearController):
        return
    fa.Scene(two(), t=t, control=(law,), options={"integrator": "implicit", "step": 1e-3}).save(tmp_path / "scene.toml")
    again = fa.load(tmp_path / "scene.toml").run()
    assert again.tau == pytest.approx(run.tau, abs=1e-13)


def test_a_list_of_limits_is_checked() -> None:
    for limit in ([1.0], [1.0, 0.0]):
        with refuses("limit =", "2", "positive", "number"):
            fa.StateFeedback(GAINS, [0, 1], limit=limit)
    for limit in (0.0, -1.0, np.nan):
        with refuses("torque_limit"):
            fa.Revolute("z", torque_limit=limit)
    with refuses("torque_limit", "a ball", "motor"):
        fa.Spherical(torque_limit=1.0)


@pytest.mark.parametrize("rate", [None, 500.0])
def test_a_pid_that_tracks_knows_the_limit_of_its_joint(rate: float | None) -> None:
    """Alone at its joint it does as one with that limit of its own; without tracking it winds up."""
    gains = {"kp": 20.0, "ki": 60.0, "kd": 3.0, "rate": rate, "reference": 1.0, "filter_time": 0.01}
    pid = fa.LinearController.pid
    times = np.linspace(0, 3, 301)

    def run(arm: fa.Arm, **more) -> np.ndarray:
        return fa.simulate(arm, times, control=pid(**gains, **more), integrator="implicit", step=1e-3).q[:, 0]

    joint, own = run(rigid(0.8), tracking_time=0.2), run(rigid(None), tracking_time=0.2, limit=0.8)
    assert joint == pytest.approx(own, abs=1e-12)
    assert joint.max() < run(rigid(0.8)).max() - 0.1


def saturated_run(kp: float = 20.0, first: float = 1.0, second: float = 0.3, tau: float = 0.5, **options) -> fa.Result:
    """Through limits and back: of the first law, and of both motors."""
    links = [replace(link, joint=replace(link.joint, torque_limit=limit))
             for link, limit in zip(flexible().links, (first, second), strict=True)]  # fmt: skip
    control = [fa.PD(kp, 1.0, 0, reference=0.2, limit=0.9), fa.PD(5.0, 0.3, 1, reference=-0.13)]
    return fa.simulate(fa.Arm(links), np.linspace(0, 0.1, 11), tau=np.eye(6)[0] * tau, control=control, **options)


@pytest.mark.parametrize("options", [
    pytest.param({"rtol": 1e-11, "atol": 1e-13}, id="ida"),
    pytest.param({"integrator": "implicit", "step": 2.5e-4}, id="implicit"),
    pytest.param({"integrator": "gauss", "step": 1e-3}, id="gauss"),
    pytest.param({"integrator": "rk4", "step": 2e-5}, id="rk4"),
])  # fmt: skip
def test_derivatives_know_the_limit(options: dict) -> None:
    """Forward and adjoint, against differences of runs."""
    run = saturated_run(**options)
    for joint, most in ((0, 1.0), (3, 0.3)):
        there = np.abs(run.tau[:, joint]) == most
        assert there.any() and not there.all()
    varied = {"control.0.kp": ("kp", 20.0, 1e-4), "link.0.joint.torque_limit": ("first", 1.0, 1e-5),
              "link.1.joint.torque_limit": ("second", 0.3, 1e-5)}  # fmt: skip
    paths = list(varied)
    found = run.sensitivities(paths)
    for k, (name, now, h) in enumerate(varied.values()):
        up, down = (saturated_run(**{name: now + s * h}, **options).q for s in (1, -1))
        wanted = (up - down) / (2 * h)
        size = np.abs(wanted).max()
        assert size > 1e-5
        assert found.q[k] == pytest.approx(wanted, abs=2e-3 * size), name
    if options.get("integrator", "ida") != "ida":
        weights = np.zeros_like(run.q)
        weights[-1, 0] = 1.0
        back = run.gradient(lambda r: (r.q[-1, 0], {"q": weights}), [*paths, "tau"])
        for k, path in enumerate(paths):
            assert back[path] == pytest.approx(found.q[k][-1, 0], rel=1e-6, abs=1e-12)
        h = 1e-5
        wanted = (saturated_run(tau=0.5 + h, **options).q - saturated_run(tau=0.5 - h, **options).q)[-1, 0] / (2 * h)
        assert back["tau"][0] == pytest.approx(wanted, rel=2e-3)


@pytest.mark.parametrize("integrator", ["implicit", "rk4"])
def test_derivatives_of_steps_and_rollouts_know_the_limit(integrator: str) -> None:
    arm, step = flexible(1.0), 2e-5
    rng = np.random.default_rng(3)
    tau = rng.normal(size=(6, 6)) * [2.0, 0.01, 0.01, 0.6, 0.01, 0.01]
    assert (np.abs(tau[:, 0]) > 1.0).any() and (np.abs(tau[:, 0]) < 1.0).any()
    clipped = tau.copy()
    clipped[:, [0, 3]] = np.clip(tau[:, [0, 3]], [-1.0, -0.3], [1.0, 0.3])
    free, options = flexible(None), {"step": step, "integrator": integrator}
    a = fa.step_derivatives(arm, arm.zero, np.zeros(6), tau[0], **options)
    b = fa.step_derivatives(free, arm.zero, np.zeros(6), clipped[0], **options)
    over = np.abs(tau - clipped) > 0
    assert np.array_equal(a.q, b.q) and np.array_equal(a.A, b.A)
    assert np.array_equal(a.B, np.where(over[0], 0.0, b.B))
    by = rng.normal(size=(7, 6))
    rows = fa.rollout(arm, arm.zero, np.zeros(6), tau[None], **options)
    mine = fa.rollout_gradient(arm, rows.q[0], rows.v[0], tau, by, **options)
    other = fa.rollout_gradient(free, rows.q[0], rows.v[0], clipped, by, **options)
    assert mine.tau == pytest.approx(np.where(over, 0.0, other.tau), abs=1e-18)
    with refuses("derivative", "limit"):
        fa.rollout_gradient(arm, rows.q[0], rows.v[0], tau, by, parameters=["link.0.joint.torque_limit"], **options)


def test_a_prescribed_motion_beyond_the_motor_is_told() -> None:
    turn = fa.Motion([0, 0.5, 1], [0, 0.5, 1], [0, 1.5, 0], a=[0, 0, 0])
    run = fa.simulate(rigid(0.5), t, drive={0: turn})
    (found,) = run.check()
    assert "'link 0 revolute'" in found.where and found.limit == 0.5 < found.value == np.abs(run.tau).max()
    assert run.tau[:, 0] == pytest.approx(INERTIA * run.a[:, 0], abs=1e-9)
    assert not fa.simulate(rigid(5.0), t, drive={0: turn}).check()


def test_files_have_the_limit(tmp_path) -> None:
    wrist = fa.Universal(torque_limit=[3.0, 4.0], name="wrist")
    arm = fa.Arm([fa.Link(wrist, fa.RigidBody(1.0, (0.1, 0, 0), 0.01 * np.eye(3)))])
    fa.Scene(arm, t=t).save(tmp_path / "scene.toml")
    assert fa.load(tmp_path / "scene.toml").arm.links[0].joint.torque_limit == (3.0, 4.0)
    assert 'effort="3.0"' in arm.to_urdf() and 'effort="4.0"' in arm.to_urdf()
    assert 'actuatorfrcrange="-3.0 3.0"' in arm.to_mjcf()


def test_predictive_control_plans_within_the_limit() -> None:
    options = {"reference": 0.25, "rate_weight": 0.02, "horizon": 0.3, "stages": 10, "blocks": 5, "rate": 200}
    run = fa.simulate(rigid(1.0), t, control=fa.MPC(**options), integrator="implicit", step=1e-3)
    assert np.abs(run.tau[0]) == 1.0 and np.abs(run.tau[-1]) < 0.5
    same = fa.MPC(**options, limit=1.0)
    assert run.q == pytest.approx(fa.simulate(rigid(None), run.t, control=same, integrator="implicit", step=1e-3).q)


def test_a_filter_predicts_with_what_the_motor_gives() -> None:
    def after(arm: fa.Arm, tau: float) -> np.ndarray:
        known = fa.KalmanFilter(arm, [fa.sensors.Encoder(0, noise=1e-3)], 1e-2, force_noise=0.1, q_std=0.1, v_std=0.1)
        known.predict([tau])
        return np.concatenate([known.q, known.v])

    assert np.array_equal(after(rigid(2.0), 7.0), after(rigid(None), 2.0))
