"""Gymnasium environments on `rollout`; needs the extra "gym". Importing this module registers them:

gymnasium.make_vec("flexarm.env:flexarm/TipTracking-v0", num_envs=64)
gymnasium.make("flexarm.env:flexarm/VibrationSuppression-v0")
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._check import Array, array, at_least, choice, plain, warn
from .analysis.findings import RangeWarning, RunWarning
from .arm.arm import Arm
from .arm.variation import Setup, Variation
from .many.batch.rollout import rolled
from .model.acting.control import force_columns, measured_rows
from .tasks import TASKS, State, Task
from .view.stage import greatest_strain
from .view.view import show

try:
    import gymnasium as gym
    from gymnasium.spaces import Box
    from gymnasium.utils import seeding
    from gymnasium.vector import AutoresetMode, VectorEnv
    from gymnasium.vector.utils import batch_space
except ImportError as e:
    raise ImportError(f"flexarm.env needs Gymnasium 1.1 or newer ({e}); pip install 'flexarm[gym]'") from None

_Bools = NDArray[np.bool_]


def _task(task: str | Task, randomize: Mapping[str, tuple[float, float]] | None) -> Task:
    if isinstance(task, str):
        made: Callable[[], Task] = TASKS[choice("task", task, TASKS)]
        task = made()
    if not isinstance(task, Task):
        raise ValueError(f"task = {task!r}: must be a flexarm.tasks.Task, or one of {', '.join(TASKS)}")
    if type(task).reward is Task.reward:
        raise ValueError(f"task: {type(task).__name__} has no reward: give it reward(state, action) -> (B,)")
    if randomize is None:
        return task
    return replace(task, randomize=dict(randomize))


def _seed(field: str, value: Any) -> int | None:
    """A seed as Gymnasium takes it."""
    value = plain(value)
    if value is None or (isinstance(value, int) and not isinstance(value, bool) and value >= 0):
        return value
    raise ValueError(f"{field} = {value!r}: must be a whole number from 0, or None")


class FlexarmVectorEnv(VectorEnv[NDArray[np.float32], NDArray[np.float32], Any]):
    """num_envs environments of one task, stepped together in C++.

    A step holds each action for a control period of the task. Observations are the task's measurements and
    observations, in SI units, float32, unbounded; actions from -1 to 1 scale the largest torque of each driven joint,
    clipped.

    Args:
        num_envs: number of environments.
        task: "tip-tracking", "vibration-suppression" (see flexarm.tasks), or a Task.
        randomize: {path: (low, high)}: parameters drawn anew for each episode, in place of the task's own.
        workers: threads; None: one for each core.
        autoreset_mode: "NextStep": the step after an episode's end begins the next, its action is not used, its reward
            is 0; "SameStep": the step that ends it does, and has the last observation in infos["final_obs"];
            "Disabled": reset(options={"reset_mask": (num_envs,) bools}) does.
        render_mode: "rgb_array": `render` draws; None: it gives None.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "autoreset_mode": AutoresetMode.NEXT_STEP, "render_modes": ["rgb_array"]
    }  # fmt: skip

    def __init__(
        self,
        num_envs: int = 1,
        task: str | Task = "tip-tracking",
        *,
        randomize: Mapping[str, tuple[float, float]] | None = None,
        workers: int | None = None,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
    ) -> None:
        at_least("num_envs", num_envs, 1)
        if render_mode is not None:
            choice("render_mode", render_mode, ("rgb_array",))
        self.render_mode, self._strain = render_mode, 0.0  # the largest strain drawn, for a constant colour scale
        self.num_envs, self.task, self.workers = num_envs, _task(task, randomize), workers
        if not isinstance(autoreset_mode, AutoresetMode):
            choice("autoreset_mode", autoreset_mode, [m.value for m in AutoresetMode])
        self._mode = AutoresetMode(autoreset_mode)
        self.metadata = {**type(self).metadata, "autoreset_mode": self._mode, "render_fps": 1 / self.task.period}
        arm = self.task.arm
        self._columns = np.array(force_columns(arm, list(self.task.links)))  # (nu, nv)
        self._torque = array("torque", self.task.torque, (len(self._columns),))
        nu, self._rows = len(self._columns), measured_rows(arm, self.task.measure)
        ny = len(self._rows[0]) + self.task.extra
        self.single_action_space = Box(-1.0, 1.0, (nu,), np.float32)
        self.single_observation_space = Box(-np.inf, np.inf, (ny,), np.float32)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        _drawn_arms(self.task, np.zeros((1, len(self.task.randomize))))  # raises for bad paths at once
        self._arms = [arm] * num_envs
        self._odd = np.zeros(num_envs, bool)  # those with an own geometry
        self._by_q = np.repeat(self._rows[0][None], num_envs, axis=0)
        self._rngs: list[np.random.Generator] = []
        self._q, self._v = np.tile(arm.zero, (num_envs, 1)), np.zeros((num_envs, arm.nv))
        self._goal = np.zeros((num_envs, self.task.goals))
        self._count = np.zeros(num_envs, int)  # control periods since the episode began
        self._over, self._told = np.zeros(num_envs, bool), False

    @property
    def state(self) -> State:
        """The state of all environments at this time, which later steps do not change; see flexarm.tasks.State."""
        y = np.einsum("bij,bj->bi", self._by_q, self._q) + self._v @ self._rows[1].T
        end = self.task.arm.frame(self._q)[0]
        for i in np.flatnonzero(self._odd):
            end[i] = self._arms[i].frame(self._q[i])[0]
        return State(self._count * self.task.period, self._q.copy(), self._v.copy(), y, end, self._goal.copy())

    def _observation(self, state: State | None = None) -> NDArray[np.float32]:
        state = self.state if state is None else state
        return np.concatenate([state.y, self.task.observe(state)], axis=1).astype(np.float32)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begins new episodes.

        Args:
            seed: environment i draws from seed + i, or from seed[i]; None: continues the present sequences.
            options: "reset_mask": (num_envs,) bools, the environments to reset; all of them at first.

        Returns:
            Observations (num_envs, n) and {}.
        """
        mask = np.ones(self.num_envs, bool)
        if options and "reset_mask" in options:
            mask = np.asarray(options["reset_mask"])
            if mask.shape != (self.num_envs,) or mask.dtype != bool:
                raise ValueError(f"options['reset_mask'] = {mask!r}: must be {self.num_envs} bools")
            late = np.flatnonzero(~mask).tolist()
            if late and not self._rngs:
                raise ValueError(f"options['reset_mask']: the first reset is of all; it leaves out environments {late}")
        given = plain(seed)
        if isinstance(given, Sequence) and not isinstance(given, str):
            if len(given) != self.num_envs:
                raise ValueError(f"seed has {len(given)} entries: must be one number, or {self.num_envs}")
            seeds = [_seed(f"seed[{i}]", s) for i, s in enumerate(given)]
        else:
            first = _seed("seed", given)
            super().reset(seed=first)
            seeds = [None if first is None else first + i for i in range(self.num_envs)]
        if not self._rngs:
            self._rngs = [seeding.np_random(s)[0] for s in seeds]
        for i, s in enumerate(seeds):
            if s is not None and mask[i]:
                self._rngs[i] = seeding.np_random(s)[0]
        self._begin(mask)
        return self._observation(), {}

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Pictures of all arms in 3-D, (480, 640, 3) each; see `Arm.show`. Balls are the task's targets (`Task.marks`).
        None without render_mode."""
        if self.render_mode is None:
            return None
        if not self._rngs:
            raise gym.error.ResetNeeded("render before the first reset")
        pictures = []
        state = self.state
        aims = array("marks", self.task.marks(state)).reshape(self.num_envs, -1, 3)
        for arm, q, time, marks in zip(self._arms, self._q, state.t.tolist(), aims, strict=True):
            title = f"t = {time:.3g} s"
            view = show(arm, q, 1.0, t=time, marks=list(marks), title=title, steady=True, strain_scale=self._strain)
            self._strain = max(self._strain, greatest_strain(view.tracks))
            pictures.append(view.image())
        return tuple(pictures)

    def _begin(self, which: _Bools) -> None:
        """Begins new episodes of these environments."""
        ranges = array("randomize", list(self.task.randomize.values())).reshape(-1, 2)
        indices = [int(i) for i in np.flatnonzero(which)]
        if len(ranges) and indices:
            shares = np.array([self._rngs[i].random(len(ranges)) for i in indices])
            for i, arm in zip(indices, _drawn_arms(self.task, shares), strict=True):
                self._take(i, arm)
        for i in indices:
            self._q[i], self._v[i], self._goal[i] = self.task.start(self._rngs[i])
        self._count[which], self._over[which] = 0, False

    def _take(self, i: int, arm: Arm) -> None:
        """Sets the arm of environment i."""
        self._arms[i], self._by_q[i] = arm, measured_rows(arm, self.task.measure)[0]
        q = np.linspace(0.1, 0.2, arm.nq)
        self._odd[i] = not np.array_equal(arm.frame(q)[0], self.task.arm.frame(q)[0])

    def step(self, actions: ArrayLike) -> tuple[NDArray[np.float32], Array, _Bools, _Bools, dict[str, Any]]:
        """Advances every environment by one control period.

        Args:
            actions: (num_envs, nu), of -1 to 1.

        Returns:
            Observations (num_envs, n); rewards, whether the task was lost (or the simulation), and whether the
            horizon was reached (num_envs,) each; and {}, or the entries of autoreset_mode.
        """
        if not self._rngs:
            raise gym.error.ResetNeeded("step before the first reset")
        u = array("actions", actions, (self.num_envs, len(self._torque))).clip(-1.0, 1.0)
        begun = self._over.copy() if self._mode == AutoresetMode.NEXT_STEP else np.zeros(self.num_envs, bool)
        broken = self._advance(u)
        state = self.state
        terminated = self.task.lost(state) | broken
        reward = np.where(terminated, -1.0, self.task.reward(state, u))
        truncated = (self._count >= self.task.horizon) & ~terminated
        if begun.any():
            self._begin(begun)
            reward[begun], terminated[begun], truncated[begun] = 0.0, False, False
        observation = self._observation(None if begun.any() else state)
        info: dict[str, Any] = {}
        self._over = terminated | truncated
        if self._mode == AutoresetMode.SAME_STEP and self._over.any():
            over = self._over
            info = {"final_obs": np.full(self.num_envs, None, dtype=object), "_final_obs": over.copy()}
            for i in np.flatnonzero(over):
                info["final_obs"][i] = observation[i]
            info |= {"final_info": {}, "_final_info": over.copy()}
            self._begin(over.copy())
            observation = self._observation()
        return observation, reward, terminated, truncated, info

    def _tell(self, warning: RunWarning) -> None:
        """Passes a warning on; that of a beam beyond its range only once."""
        if not (self._told and isinstance(warning, RangeWarning)):
            warn(warning)
        self._told |= isinstance(warning, RangeWarning)

    def _advance(self, u: Array) -> _Bools:
        """Advances one control period; returns the environments that failed, whose state is unchanged."""
        n, arms = self.task.substeps, self._arms if self.task.randomize else self.task.arm
        force = ((u * self._torque) @ self._columns)[:, None, :]
        step, workers = self.task.step, self.workers
        out = rolled(self._tell, arms, self._q, self._v, force, step=step, nstep=n, every=n, workers=workers)
        fine = np.asarray(out.status == 0)
        self._q[fine], self._v[fine] = out.q[fine, -1], out.v[fine, -1]
        self._count += 1
        return ~fine


def _drawn_arms(task: Task, shares: Array) -> list[Arm]:
    """Arms with parameters at these shares (0 to 1) of their ranges."""
    values = {}
    for k, (path, ends) in enumerate(task.randomize.items()):
        low, high = array(f"randomize['{path}']", ends, (2,))
        if not low <= high:
            raise ValueError(f"randomize['{path}'] = ({low}, {high}): must be (low, high)")
        values[path] = low + (high - low) * shares[:, k]
    if not values:
        return [task.arm] * len(shares)
    variation = Variation(Setup(task.arm), values)
    return [variation.scenario(i).arm for i in range(len(shares))]


class FlexarmEnv(gym.Env[NDArray[np.float32], NDArray[np.float32]]):
    """One environment of a task; see FlexarmVectorEnv."""

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"]}  # noqa: RUF012

    def __init__(
        self,
        task: str | Task = "tip-tracking",
        *,
        randomize: Mapping[str, tuple[float, float]] | None = None,
        render_mode: str | None = None,
    ) -> None:
        self._one = FlexarmVectorEnv(
            1, task, randomize=randomize, workers=1, autoreset_mode=AutoresetMode.DISABLED, render_mode=render_mode
        )
        self.task, self.render_mode = self._one.task, render_mode
        self.metadata = {**type(self).metadata, "render_fps": 1 / self.task.period}
        self.action_space, self.observation_space = self._one.single_action_space, self._one.single_observation_space

    @property
    def state(self) -> State:
        """The state of the environment at this time, as of FlexarmVectorEnv with B = 1."""
        return self._one.state

    def render(self) -> NDArray[np.uint8] | None:
        """A picture of the arm in 3-D, (480, 640, 3), for render_mode = "rgb_array"; None without."""
        pictures = self._one.render()
        return None if pictures is None else pictures[0]

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begins a new episode."""
        super().reset(seed=_seed("seed", seed))
        return self._one.reset(seed=seed)[0][0], {}

    def step(self, action: ArrayLike) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Advances one control period."""
        observation, reward, terminated, truncated, _ = self._one.step(np.asarray(action)[None])
        return observation[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), {}


for _name, _kind in TASKS.items():
    gym.register(
        id=f"flexarm/{_kind.__name__}-v0",
        entry_point=f"{__name__}:FlexarmEnv",
        vector_entry_point=f"{__name__}:FlexarmVectorEnv",
        kwargs={"task": _name},
    )
