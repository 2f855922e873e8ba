"""The Gymnasium environments: their conventions, and that the arm in them is the arm."""

from dataclasses import dataclass, replace

import flexarm as fa
import numpy as np
import pytest
from flexarm.tasks import TASKS, Task, TipTracking, VibrationSuppression

gym = pytest.importorskip("gymnasium")
from flexarm.env import FlexarmEnv, FlexarmVectorEnv  # noqa: E402
from gymnasium.utils.env_checker import check_env  # noqa: E402
from messages import refuses  # noqa: E402

IDS = ("TipTracking", "VibrationSuppression")


def tracking(o, kp=30.0, kd=4.0):
    """PD on where the end is to go, through the Jacobian of the links as if rigid; actions (n, 2)."""
    o = o.astype(float)
    a, b, w = o[:, 0], o[:, 0] + o[:, 1], o[:, 2:4]
    J = np.empty((len(o), 2, 2))
    J[:, 0, 1], J[:, 1, 1] = -0.4 * np.sin(b), 0.4 * np.cos(b)
    J[:, 0, 0], J[:, 1, 0] = J[:, 0, 1] - 0.5 * np.sin(a), J[:, 1, 1] + 0.5 * np.cos(a)
    force = kp * o[:, 6:8] + kd * (o[:, 8:10] - np.einsum("bij,bj->bi", J, w))
    return np.einsum("bij,bi->bj", J, force) / [3.0, 1.0]


@pytest.mark.filterwarnings("ignore")  # the checker's remarks, such as that observations are not bounded
@pytest.mark.parametrize("name", IDS)
def test_gymnasiums_checker_and_registry(name):
    check_env(gym.make(f"flexarm.env:flexarm/{name}-v0").unwrapped, skip_render_check=True)
    envs = gym.make_vec(f"flexarm/{name}-v0", num_envs=3, workers=1)
    assert isinstance(envs.unwrapped, FlexarmVectorEnv) and envs.metadata["autoreset_mode"].value == "NextStep"
    o, info = envs.reset(seed=1)
    assert o in envs.observation_space and info == {}
    o, r, terminated, truncated, _ = envs.step(envs.action_space.sample())
    assert o in envs.observation_space
    for x, kind in ((r, float), (terminated, bool), (truncated, bool)):
        assert x.shape == (3,) and x.dtype == kind
    envs.close()


@pytest.mark.parametrize("task", TASKS)
def test_environments_are_the_same_alone_and_together(task):
    together = FlexarmVectorEnv(3, task, workers=2)
    o, _ = together.reset(seed=5)
    u = np.random.default_rng(0).uniform(-1, 1, (4, 3, together.single_action_space.shape[0]))
    rows = [o, *(together.step(x)[0] for x in u)]
    for i in range(3):
        alone = FlexarmEnv(task)
        got = [alone.reset(seed=5 + i)[0], *(alone.step(x[i])[0] for x in u)]
        np.testing.assert_array_equal(got, [row[i] for row in rows])
    assert np.array_equal(together.reset(seed=5)[0], o)
    assert not np.array_equal(together.reset()[0], o)


def test_a_step_is_a_simulation_with_the_torque_held():
    envs = FlexarmVectorEnv(2, "vibration-suppression")
    envs.reset(seed=3)
    task, before = envs.task, envs.state
    q, v = before.q, before.v
    u = np.array([[0.7], [-5.0]])  # the second is cut off at -1
    o, *_ = envs.step(u)
    for i, torque in enumerate((0.35, -0.5)):
        t = task.step * np.arange(task.substeps + 1)
        options = {"integrator": "implicit", "step": task.step}
        run = fa.simulate(task.arm, t, q[i], v[i], drive={0: fa.Torque(torque)}, **options)
        np.testing.assert_allclose(envs.state.q[i], run.q[-1], rtol=1e-9, atol=1e-12)
        rate = run.strain(0, 0.0)[-1, 2]
        np.testing.assert_allclose(o[i, :3], [run.q[-1, 0], run.v[-1, 0], rate], rtol=2e-6, atol=1e-6)


@pytest.mark.parametrize("made", [lambda: FlexarmVectorEnv(2), FlexarmEnv])
def test_a_state_stays_what_it_was(made):
    envs = made()
    envs.reset(seed=0)
    before = envs.state
    kept = [x.copy() for x in before]
    envs.step(np.ones(envs.action_space.shape))
    envs.reset(seed=5)
    for name, x, y in zip(before._fields, before, kept, strict=True):
        np.testing.assert_array_equal(x, y, err_msg=name)
    envs.state.q[:] = 9.0
    assert (envs.state.q < 9.0).all()


def test_left_alone_an_undamped_arm_keeps_its_energy():
    arm = VibrationSuppression().arm
    link = arm.links[0]
    free = fa.Arm([replace(link, beam=replace(link.beam, damping_ratio=0.0))])
    envs = FlexarmVectorEnv(4, replace(VibrationSuppression(), arm=free))
    envs.reset(seed=0)
    begin = sum(free.energy(envs.state.q, envs.state.v))
    for _ in range(100):
        envs.step(np.zeros((4, 1)))
    end = sum(free.energy(envs.state.q, envs.state.v))
    assert np.abs(envs.state.v).max() > 0.1  # it moves
    np.testing.assert_allclose(end, begin, rtol=2e-3)


def test_pd_follows_the_target_and_nothing_does_not():
    kept = {}
    for name, policy in (("pd", tracking), ("nothing", lambda o: np.zeros((len(o), 2)))):
        envs = FlexarmVectorEnv(6, "tip-tracking")
        o, _ = envs.reset(seed=0)
        total, off = np.zeros(6), []
        for _ in range(200):
            o, r, terminated, _, _ = envs.step(policy(o))
            total += r
            off.append(np.linalg.norm(o[:, 6:8], axis=1))
            assert name != "pd" or not terminated.any()
        kept[name] = total.mean(), np.array(off)
    assert kept["pd"][1].max() < 0.03 and kept["pd"][0] > 185
    assert kept["nothing"][0] < 0.7 * kept["pd"][0]


def test_pd_stills_the_link_and_nothing_does_not():
    def late(kp, kv):
        envs = FlexarmVectorEnv(4, "vibration-suppression")
        o, _ = envs.reset(seed=2)
        last = []
        for _ in range(200):
            o, *_ = envs.step((-kp * o[:, :1] - kv * o[:, 1:2]) / 0.5)
            last.append(np.abs(o[:, 2]))
        return np.max(last[150:], axis=0)  # of the curvature at the clamp, 1/m

    still, ringing = late(4.0, 0.5), late(0.0, 0.0)
    assert still.max() < 0.015 and (ringing > 5 * still)[ringing > 0.05].all() and ringing.max() > 0.1


# -- the ends of episodes -----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Short(VibrationSuppression):
    """Lost where the action of environment i is 1; over after five periods."""

    horizon: int = 5

    def lost(self, state):
        return np.abs(state.q[:, 0]) > 1.0


def test_next_step_autoreset():
    envs = FlexarmVectorEnv(2, Short())
    o0, _ = envs.reset(seed=0)
    for k in range(1, 6):
        last, r, terminated, truncated, _ = envs.step(np.zeros((2, 1)))
        assert truncated.all() == (k == 5) and not terminated.any() and (r > 0).all()
    o, r, terminated, truncated, info = envs.step(np.ones((2, 1)))  # this one begins anew
    assert r.tolist() == [0, 0] and not truncated.any() and info == {}
    assert not np.array_equal(o, last) and not np.array_equal(o, o0) and (o[:, 1] == 0).all()
    fresh = FlexarmVectorEnv(2, Short())
    fresh.reset(seed=0)
    assert np.array_equal(fresh.reset()[0], o)  # the next draws of the same seed
    assert not envs.step(np.zeros((2, 1)))[3].any()


def test_same_step_autoreset_tells_the_last_observation():
    envs, plain = (FlexarmVectorEnv(2, Short(), autoreset_mode=m) for m in ("SameStep", "NextStep"))
    for e in (envs, plain):
        e.reset(seed=0)
    for _ in range(5):
        o, _, _, truncated, info = envs.step(np.zeros((2, 1)))
        last = plain.step(np.zeros((2, 1)))[0]
    assert truncated.all() and info["_final_obs"].all()
    assert np.array_equal(np.stack(info["final_obs"]), last)
    assert np.array_equal(o, plain.step(np.zeros((2, 1)))[0])


def test_without_autoreset_a_mask_says_which():
    envs = FlexarmVectorEnv(3, Short(), autoreset_mode="Disabled")
    envs.reset(seed=0)
    for _ in range(7):
        last, _, _, truncated, _ = envs.step(np.zeros((3, 1)))
    assert truncated.all()
    o, _ = envs.reset(options={"reset_mask": np.array([False, True, False])})
    assert np.array_equal(o[[0, 2]], last[[0, 2]]) and not np.array_equal(o[1], last[1])
    assert envs.step(np.zeros((3, 1)))[3].tolist() == [True, False, True]


def test_what_is_lost_ends_with_minus_one():
    envs = FlexarmVectorEnv(2, Short())
    envs.reset(seed=0)
    envs._q[1, 0] = 1.1
    _, r, terminated, truncated, _ = envs.step(np.zeros((2, 1)))
    assert terminated.tolist() == [False, True] and r[1] == -1 and not truncated.any()


def test_a_simulation_that_fails_ends_its_episode_and_no_other():
    envs = FlexarmVectorEnv(2, "vibration-suppression")
    envs.reset(seed=0)
    envs._v[0] = 1e30  # no step from there
    o, r, terminated, _, _ = envs.step(np.zeros((2, 1)))
    assert terminated.tolist() == [True, False] and r[0] == -1
    o, r, terminated, _, _ = envs.step(np.zeros((2, 1)))
    assert np.isfinite(o).all() and not terminated.any() and r[0] == 0


# -- parameters drawn anew ----------------------------------------------------------------------------------


def test_drawn_parameters_are_those_of_the_arms():
    draws = {"link.0.tip.mass": (0.01, 0.1), "link.0.beam.length": (0.4, 0.6)}
    envs = FlexarmVectorEnv(3, "vibration-suppression", randomize=draws)
    o, _ = envs.reset(seed=4)
    arms = list(envs._arms)
    masses = [a.links[0].tip.mass for a in arms]
    assert len(set(masses)) == 3 and min(masses) >= 0.01 and max(masses) <= 0.1
    state = envs.state
    for i, arm in enumerate(arms):
        np.testing.assert_allclose(state.end[i], arm.frame(state.q[i])[0])
        np.testing.assert_allclose(o[i, 2], arm.strain(state.q[i], 0, 0.0)[2], rtol=1e-6)
    q, v = state.q, state.v
    envs.step(np.zeros((3, 1)))
    for i, arm in enumerate(arms):
        t = envs.task.step * np.arange(5)
        run = fa.simulate(arm, t, q[i], v[i], integrator="implicit", step=envs.task.step)
        np.testing.assert_allclose(envs.state.q[i], run.q[-1], rtol=1e-9, atol=1e-12)
    envs.reset()
    assert [a.links[0].tip.mass for a in envs._arms] != masses


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"num_envs": 0}, "num_envs = 0"),
        ({"task": "tip-traking"}, "'tip-tracking'"),
        ({"task": Task}, "flexarm.tasks.Task"),
        ({"randomize": {"link.0.tip.mas": (0, 1)}}, "'link.0.tip.mass'"),
        ({"randomize": {"link.0.tip.mass": (1, 0)}}, "(1.0, 0.0)"),
        ({"autoreset_mode": "Sometime"}, "autoreset_mode"),
        ({"render_mode": "human"}, "render_mode"),
        ({"task": replace(TipTracking(), torque=(1.0,))}, "torque"),
    ],
)
def test_bad_arguments_are_named(arguments, says):
    with refuses(says):
        FlexarmVectorEnv(**{"num_envs": 2, **arguments})


def test_bad_actions_and_masks_are_named():
    envs = FlexarmVectorEnv(2, "tip-tracking")
    with pytest.raises(gym.error.ResetNeeded):
        envs.step(np.zeros((2, 2)))
    envs.reset(seed=0)
    with refuses("actions has shape"):
        envs.step(np.zeros((2, 3)))
    with refuses("actions[0, 0] = nan"):
        envs.step(np.full((2, 2), np.nan))
    with refuses("reset_mask"):
        envs.reset(options={"reset_mask": [1, 2, 3]})


def test_seeds_are_whole_numbers_of_any_kind():
    envs = FlexarmVectorEnv(2, "tip-tracking")
    o, _ = envs.reset(seed=[1, 2])
    for seed in (1, np.int64(1), np.array([1, 2]), (np.int32(1), 2)):
        np.testing.assert_array_equal(envs.reset(seed=seed)[0], o)
    for seed, says in (
        ([1, -2], "seed[1] = -2"),
        ([1.5, 2], "seed[0] = 1.5"),
        (-1, "seed = -1"),
        (1.5, "seed = 1.5"),
        ([1, 2, 3], "seed has 3"),
        ("12", "seed = '12'"),
    ):
        with refuses(says):
            envs.reset(seed=seed)
    one = FlexarmEnv("tip-tracking")
    np.testing.assert_array_equal(one.reset(seed=np.int64(1))[0], o[0])


def test_the_first_reset_is_of_all():
    envs = FlexarmVectorEnv(2, "tip-tracking", autoreset_mode="Disabled")
    with refuses("options['reset_mask']", "[1]"):
        envs.reset(options={"reset_mask": [True, False]})
    with pytest.raises(gym.error.ResetNeeded):
        envs.step(np.zeros((2, 2)))
    o, _ = envs.reset(seed=0, options={"reset_mask": [True, True]})
    np.testing.assert_array_equal(envs.reset(seed=0)[0], o)


def test_a_task_without_a_reward_is_refused_by_name():
    class Idle(Task):
        pass

    task = Idle(VibrationSuppression().arm, (1.0,))
    with refuses("Idle", "reward"):
        FlexarmVectorEnv(2, task)
    with refuses("Idle", "reward", error=NotImplementedError):
        task.reward(None, None)


def test_environments_draw_themselves() -> None:
    env = gym.make("flexarm.env:flexarm/TipTracking-v0", render_mode="rgb_array")
    env.reset(seed=0)
    first = env.render()
    assert first.shape == (480, 640, 3) and first.dtype == np.uint8 and (first < 200).any()
    for _ in range(10):
        env.step(env.action_space.sample() * 0 + 1)
    assert (env.render() != first).any() and env.metadata["render_fps"] > 0
    both = gym.make_vec("flexarm.env:flexarm/TipTracking-v0", num_envs=2, render_mode="rgb_array")
    both.reset(seed=0)
    pictures = both.render()
    assert len(pictures) == 2 and pictures[0].shape == (480, 640, 3)
    assert gym.make("flexarm.env:flexarm/TipTracking-v0", disable_env_checker=True).unwrapped.render() is None


@pytest.mark.parametrize("name", ["TipTracking", "VibrationSuppression"])
def test_pictures_show_what_is_aimed_at(name):
    """Green where the goal is: as far from the arm's end, in the picture too, as the reward counts."""
    env = gym.make(f"flexarm.env:flexarm/{name}-v0", render_mode="rgb_array", disable_env_checker=True).unwrapped
    env.reset(seed=3)
    state = env._one.state
    (mark,) = env.task.marks(state)[0]
    far = float(np.linalg.norm(mark - state.end[0]))
    assert far == pytest.approx(float(env.task._distance(state)[0]), abs=1e-12)
    pixels = env.render().astype(int)
    green = (pixels[..., 1] - pixels[..., 0] > 60) & (pixels[..., 1] - pixels[..., 2] > 20)
    assert 20 < green.sum() < 4000
