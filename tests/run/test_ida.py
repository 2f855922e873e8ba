"""IDA's linear solvers against each other, and events in every integrator."""


import flexarm as fa
import numpy as np
import pytest
from arms import BODY, STEEL, G, pendulum, random_arm, random_state, unit_balls
from messages import refuses
from scipy.special import ellipk

INTEGRATORS = [{"rtol": 1e-9, "atol": 1e-11}, {"integrator": "implicit", "step": 1e-3}]
INTEGRATORS += [{"integrator": "rk4", "step": 1e-2}, {"integrator": "gauss", "step": 0.1}]
NAMES = ["ida", "implicit", "rk4", "gauss"]


def event(f, terminal=False, direction=0):
    f.terminal, f.direction = terminal, direction
    return f


def hanging_chain(links: int, damping: float = 0.0, beam: fa.Beam | None = None) -> fa.Arm:
    body = fa.RigidBody(0.3, (0.1, 0, 0), (1e-4, 2e-4, 2e-4), (0.2, 0, 0))
    joints = [fa.Revolute("y" if k % 2 else "z", damping=damping) for k in range(links)]
    return fa.Arm([fa.Link(j, body, beam) for j in joints], gravity=(G, 0, 0))


def both(arm: fa.Arm, t, **options) -> tuple[fa.Result, fa.Result]:
    chain, dense = (fa.simulate(arm, t, linear_solver=s, **options) for s in ("chain", "dense"))
    return chain, dense


@pytest.mark.filterwarnings("ignore::flexarm.errors.RangeWarning")  # random arms bend as they like
@pytest.mark.parametrize("seed", range(6))
def test_chain_and_dense_agree_on_random_arms(seed: int) -> None:
    """Every joint, springs, stops, damping, loads, a motion: the same solution, at about the same number of steps."""
    rng = np.random.default_rng(200 + seed)
    arm = random_arm(rng, int(rng.integers(2, 5)), orders=(1, 2, 3, "exact"))
    q, v, tau = random_state(rng, arm)
    q, v = unit_balls(arm, 0.3 * q + 0.7 * arm.zero), 0.1 * v
    load = fa.Load(force=(0.3, -0.2, 0.1), moment=(0.01, 0, 0.02))
    drive = {}
    rigid = [k for k, link in enumerate(arm.links) if isinstance(link.joint, fa.Revolute)]
    if rigid:
        drive[rigid[0]] = fa.Motion(lambda t: (0.2 * np.sin(5 * t), np.cos(5 * t), -5 * np.sin(5 * t)))
        i = arm.coordinates.index(next(c for c in arm.coordinates if c.startswith(f"link {rigid[0]} ")))
        v[i] = 1.0
        q[arm.coordinate_of(i)] = 0.0
    t = np.linspace(0, 0.01, 3)
    chain, dense = both(arm, t, q0=q, v0=v, tau=tau, loads=[load], drive=drive, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(chain.q, dense.q, atol=1e-6)
    np.testing.assert_allclose(chain.v, dense.v, atol=2e-6 * max(1.0, np.abs(dense.v).max()) * 10)
    assert chain.stats["steps"] < 1.4 * dense.stats["steps"] + 20
    assert chain.stats["linear_iterations"] > 0 == dense.stats["linear_iterations"]


def test_balls_and_their_springs() -> None:
    """Stiff springs on a ball are in the chain's elimination, as those of any joint: no more steps than dense."""
    body = fa.RigidBody(1.0, (0.1, 0, 0), (2e-3, 3e-3, 4e-3), (0.2, 0, 0))
    arm = fa.Arm([fa.Link(fa.Spherical(stiffness=1e4, damping=100.0), body) for _ in range(3)], (0, 0, -G))
    v0 = np.array([0.1, 1.0, -2.0, 1.0, 0, 0, 0, 0.5, 0.2])
    chain, dense = both(arm, np.linspace(0, 2, 5), v0=v0)
    np.testing.assert_allclose(chain.q, dense.q, atol=1e-5)
    assert chain.stats["steps"] < 1.3 * dense.stats["steps"]
    assert chain.stats["newton_iterations"] < 1.3 * dense.stats["newton_iterations"]


def test_steps_grow_where_geometric_stiffness_rules() -> None:
    """A damped chain comes to rest; what keeps the steps small then is the weight, which the elimination alone leaves
    out: GMRES must step in."""
    chain, dense = both(hanging_chain(3, damping=0.5), np.linspace(0, 200, 5), q0=[0.5, 0.3, -0.2])
    np.testing.assert_allclose(chain.q, dense.q, atol=1e-6)
    assert chain.stats["steps"] < 1.5 * dense.stats["steps"]
    assert chain.stats["linear_iterations"] > chain.stats["newton_iterations"]


def test_sixty_flexible_links() -> None:
    beam = fa.Beam(0.3, fa.Rectangle(0.004, 0.01), STEEL, {"bending_y": 1, "bending_z": 1}, order=2)
    arm = hanging_chain(60, beam=beam)
    v0 = np.zeros(arm.nv)
    v0[0] = 0.3
    r = fa.simulate(arm, np.linspace(0, 0.2, 3), v0=v0)
    assert r.stats["steps"] < 1000 and r.stats["linear_iterations"] < 2 * r.stats["newton_iterations"]
    T, U = r.energy()
    assert np.ptp(T + U) < 1e-3 * T[0]
    assert np.abs(r.q[-1]).max() > 1e-3


def test_linear_solver_is_checked() -> None:
    with refuses("linear_solver = 'chian'", "'chain'"):
        fa.simulate(pendulum(), [0, 1], linear_solver="chian")


@pytest.mark.parametrize("options", INTEGRATORS, ids=NAMES)
def test_the_period_of_a_pendulum(options: dict) -> None:
    """4 K(sin(a/2)) sqrt(L/g) between passages of the bottom in one direction; half that between all of them."""
    swing = 1.2
    period = 4 * ellipk(np.sin(swing / 2) ** 2) / np.sqrt(G)
    rising = event(lambda t, q, v: q[0] + np.pi / 2, direction=1)
    falling = event(lambda t, q, v: q[0] + np.pi / 2, direction=-1)
    all_of_them = event(lambda t, q, v: q[0] + np.pi / 2)
    turning = event(lambda t, q, v: v[0], direction=1)
    r = fa.simulate(
        pendulum(), [0, 4.5], q0=[swing - np.pi / 2], events=[rising, falling, all_of_them, turning], **options
    )
    tolerance = 1e-5 if options.get("integrator") == "implicit" else 1e-6
    assert r.status == 0 and len(r.t) == 2
    np.testing.assert_allclose(r.t_events[1], [period / 4, period * 5 / 4], atol=tolerance)
    np.testing.assert_allclose(r.t_events[0], period * np.array([3 / 4, 7 / 4]), atol=tolerance)
    np.testing.assert_allclose(np.sort(np.concatenate(r.t_events[:2])), r.t_events[2], atol=1e-9)
    np.testing.assert_allclose(r.t_events[3], period * np.array([1 / 2, 3 / 2])[: len(r.t_events[3])], atol=tolerance)
    assert r.q_events[0].shape == (2, 1) and r.v_events[0].shape == (2, 1)
    np.testing.assert_allclose(r.q_events[0], -np.pi / 2, atol=1e-9)
    np.testing.assert_allclose(r.v_events[0], 2 * np.sqrt(G) * np.sin(swing / 2), rtol=1e-5)
    np.testing.assert_allclose(r.v_events[1], -2 * np.sqrt(G) * np.sin(swing / 2), rtol=1e-5)


@pytest.mark.parametrize("options", INTEGRATORS, ids=NAMES)
def test_a_ball_bounces(options: dict) -> None:
    """Runs that end at the ground, and begin again with the velocity turned back: the times are those of a ball."""
    arm = fa.Arm([fa.Link(fa.Prismatic("z"), fa.RigidBody(1.0))], gravity=(0, 0, -G))
    ground = event(lambda t, q, v: q[0], terminal=True, direction=-1)
    now, height, speed, times = 0.0, 1.0, 0.0, []
    for _ in range(3):
        r = fa.simulate(arm, np.linspace(now, now + 2, 21), q0=[height], v0=[speed], events=ground, **options)
        assert r.status == 1
        (now,), height, speed = r.t_events[0], 0.0, -0.5 * r.v_events[0][0, 0]
        assert r.t[-1] <= now < r.t[-1] + 0.1 and len(r.t) == len(r.q) == len(r.tau)
        assert r.q[-1, 0] > 0 and np.isfinite(r.q).all()
        times.append(now)
    first = np.sqrt(2 / G)
    np.testing.assert_allclose(times, first * np.array([1, 2, 2.5]), atol=1e-6)


@pytest.mark.parametrize("options", INTEGRATORS, ids=NAMES)
def test_terminal_counts_and_output_times(options: dict) -> None:
    """A constant speed: zeros at known times, one of them an output time, whose row is kept."""
    arm = fa.Arm([fa.Link(fa.Prismatic("x"), fa.RigidBody(1.0))])
    third = event(lambda t, q, v: np.sin(4 * np.pi * (t - 0.1)), terminal=3)  # zeros at 0.1, 0.35, 0.6
    r = fa.simulate(arm, np.linspace(0, 1, 11), v0=[2.0], events=[third, lambda t, q, v: q[0] - 1.0], **options)
    np.testing.assert_allclose(r.t_events[0], [0.1, 0.35, 0.6], atol=1e-9)
    np.testing.assert_allclose(r.q_events[0][:, 0], [0.2, 0.7, 1.2], atol=1e-8)
    np.testing.assert_allclose(r.t_events[1], [0.5], atol=1e-9)
    assert r.status == 1 and len(r.t) in (6, 7)  # 0.6 is a row when it is not later than the zero, to the last digit
    third.terminal = False  # zeros at output times must not be found again and again
    r = fa.simulate(arm, np.linspace(0, 1, 21), v0=[2.0], events=third, **options)
    np.testing.assert_allclose(r.t_events[0], [0.1, 0.35, 0.6, 0.85], atol=1e-9)
    assert r.status == 0 and len(r.t) == 21
    never = fa.simulate(arm, [0, 1], v0=[2.0], events=[lambda t, q, v: q[0] + 1], **options)
    assert never.status == 0 and [x.shape for x in never.t_events + never.q_events] == [(0,), (0, 1)]
    none = fa.simulate(arm, [0, 1], v0=[2.0], **options)
    assert none.t_events is None and none.status == 0
    at_start = fa.simulate(arm, [0, 1], v0=[2.0], events=event(lambda t, q, v: q[0], terminal=True), **options)
    assert at_start.status == 0 and len(at_start.t_events[0]) == 0


@pytest.mark.parametrize("options", INTEGRATORS, ids=NAMES)
def test_events_of_prescribed_joints_and_balls(options: dict) -> None:
    """What events see of a motion is the motion itself; a ball's quaternion is of unit length."""
    arm = fa.Arm([fa.Link(fa.Revolute("z"), BODY), fa.Link(fa.Spherical(), BODY)])
    seen = []

    def crossing(t, q, v):
        seen.append([abs(q[0] - t**2), abs(v[0] - 2 * t), abs(np.linalg.norm(q[1:]) - 1)])
        return q[0] - 0.25

    motion = {0: fa.Motion(lambda t: (t**2, 2 * t, 2.0))}
    v0 = np.array([0, 1.0, 2.0, 3.0])
    r = fa.simulate(arm, [0, 1], v0=v0, drive=motion, events=crossing, **options)
    assert np.max(seen) < 1e-12
    np.testing.assert_allclose(r.t_events[0], 0.5, atol=1e-12)
    alone = fa.Arm([fa.Link(fa.Revolute("z"), BODY)])
    crossing.terminal = True
    r = fa.simulate(alone, [0, 0.3, 0.8, 1], drive=motion, events=lambda t, q, v: q[0] - 0.25, **options)
    np.testing.assert_allclose(r.t_events[0], 0.5, atol=1e-12)
    assert len(r.t) == 4


def test_fixed_steps_locate_to_their_order() -> None:
    """rk4's time of a passage converges with the fourth order, though steps do not end there."""
    swing = 1.2
    period = 4 * ellipk(np.sin(swing / 2) ** 2) / np.sqrt(G)
    down = event(lambda t, q, v: q[0] + np.pi / 2, terminal=5)
    errors = []
    for h in (0.1, 0.05, 0.025):
        r = fa.simulate(pendulum(), [0, 10], q0=[swing - np.pi / 2], events=down, integrator="rk4", step=h)
        errors.append(abs(r.t_events[0][4] - 9 / 4 * period))
    assert errors[0] / errors[2] > 4**3 and errors[2] < 1e-5


def test_events_survive_a_failure_and_a_file(tmp_path) -> None:
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(inertia=(0, 0, 1.0)))])
    runaway = {0: fa.Torque(lambda t: 1.0 / max(1.0 - t, 1e-300) ** 3)}
    with pytest.raises(fa.SimulationError) as caught:
        fa.simulate(arm, np.linspace(0, 2, 21), drive=runaway, events=[lambda t, q, v: v[0] - 1, lambda t, q, v: 1.0])
    r = caught.value.result
    assert r.status == 0 and len(r.t_events[0]) == 1 and len(r.t_events[1]) == 0
    r.status = 1
    r.save(tmp_path / "run.npz")
    s = fa.Result.load(tmp_path / "run.npz")
    assert s.status == 1
    for name in ("t_events", "q_events", "v_events"):
        for x, y in zip(getattr(s, name), getattr(r, name), strict=True):
            np.testing.assert_array_equal(x, y)
    plain = fa.simulate(arm, [0, 1])
    plain.save(tmp_path / "plain.npz")
    assert fa.Result.load(tmp_path / "plain.npz").t_events is None


@pytest.mark.parametrize("options", INTEGRATORS, ids=NAMES)
def test_bad_events(options: dict) -> None:
    arm = pendulum()

    def good(t, q, v):
        return 1.0

    for events, message in (
        (3, "events = 3"),
        ([good, 3], "events[1] = 3"),
        (event(lambda t, q, v: 1.0, direction=2), ("events[0].direction = 2", "-1")),
        (event(lambda t, q, v: 1.0, terminal=-1), ("events[0].terminal = -1", "True", "False")),
        (event(lambda t, q, v: 1.0, terminal="yes"), "events[0].terminal = 'yes'"),
        ([good, lambda t, q, v: float("nan")], ("events[1] at t = 0", "nan")),
        (lambda t, q, v: "high", ("events[0] at t = 0", "'high'")),
    ):
        with refuses(message):
            fa.simulate(arm, [0, 1], events=events, **options)

    def broken(t, q, v):
        raise KeyError("no such event")

    with refuses("no such event", error=KeyError):
        fa.simulate(arm, [0, 1], events=broken, **options)
