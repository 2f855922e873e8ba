"""Tasks for learning and search: an arm with measurements, actions and a reward.

A task is plain NumPy on batches, and needs no Gymnasium; `flexarm.env` turns it into environments.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ._check import Array
from .arm.arm import Arm
from .model.parts.beam import Beam, RigidBody
from .model.parts.joints import Revolute
from .model.parts.link import Link
from .model.parts.material import Material
from .model.parts.sections import Rectangle


class State(NamedTuple):
    """The state of B environments.

    Attributes:
        t: time since the start of each episode (s), (B,).
        q, v: coordinates (B, nq) and rates (B, nv).
        y: measurements, (B, ny).
        end: position of the end of the arm's last link (m), (B, 3).
        goal: of each environment, (B, ng).
    """

    t: Array
    q: Array
    v: Array
    y: Array
    end: Array
    goal: Array


@dataclass(frozen=True, eq=False)
class Task:
    """The definition of an environment; subclass it for your own.

    Attributes:
        arm: the arm.
        torque: largest torque (N m, N) of each joint in `links`; an action of 1 stands for it, -1 for its negative.
        links: the driven joints; -1 is the last.
        measure: measurements, entries as of `Sampled(measure=)`: ("joint", link), ("rate", link),
            ("strain", link, x, "K3").
        step: of the integration (s). substeps: steps in a control period, over which an action is held.
        horizon: control periods of an episode.
        randomize: paths (as `simulate_batch(parameters=)` has them) and the range (low, high) from which each value is
            drawn, evenly, for every episode.
        goals: count of numbers in a goal; extra: count of numbers that `observe` adds to the measurements.
    """

    arm: Arm
    torque: Sequence[float]
    links: Sequence[int] = (-1,)
    measure: Sequence[Any] = (("joint", -1), ("rate", -1))
    step: float = 2.5e-3
    substeps: int = 4
    horizon: int = 200
    randomize: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    goals: int = 0
    extra: int = 0

    @property
    def period(self) -> float:
        """The period of control (s)."""
        return self.step * self.substeps

    def start(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        """q (nq,), v (nv,) and the goal (goals,) of a new episode."""
        return self.arm.zero, np.zeros(self.arm.nv), np.zeros(self.goals)

    def observe(self, state: State) -> Array:
        """Observations besides the measurements, (B, extra)."""
        return np.zeros((len(state.t), self.extra))

    def reward(self, state: State, action: Array) -> Array:
        """The reward (B,) of the state after an action (B, nu) of -1 to 1."""
        raise NotImplementedError(f"{type(self).__name__} has no reward: give it reward(state, action) -> (B,)")

    def marks(self, state: State) -> Array:
        """Positions of the targets, which pictures show as small balls, (B, n, 3) (m)."""
        return np.zeros((len(state.t), 0, 3))

    def lost(self, state: State) -> NDArray[np.bool_]:
        """Whether an episode ends early, (B,)."""
        return np.zeros(len(state.t), bool)


def _ist_arm() -> Arm:
    """The paper's link on a hub of 0.03 kg m^2, with 30 g at its tip; a gauge at its clamp measures bending."""
    steel = Material(density=7850.0, youngs_modulus=209e9, poisson_ratio=0.3)
    beam = Beam(length=0.5, section=Rectangle(y=0.001, z=0.02), material=steel, modes={"bending_y": 3},
                damping_ratio=0.005)  # fmt: skip
    joint = Revolute("z", reflected_inertia=0.03)
    return Arm([Link(joint=joint, hub=RigidBody(end=(0.075, 0, 0)), beam=beam, tip=RigidBody(mass=0.03))])


@dataclass(frozen=True, eq=False)
class VibrationSuppression(Task):
    """The paper's flexible link starts bent and at an angle, and must come to rest at angle 0 without vibration.

    Observation (4): hub angle (rad) and rate (rad/s), curvature at the clamp (1/m), its rate (1/m/s).
    Action (1): hub torque, 1 stands for 0.5 N m; held for 10 ms; 200 periods are an episode.
    Start: hub within 0.3 rad; first bending coordinate such that the tip is up to 30 mm off; at rest.
    Reward: 1 / (1 + (x / 0.02)^2) - 0.01 u^2, x the distance (m) of the arm's end from its goal, u the action; ended
    early, with -1, if the hub is more than pi off or the tip more than 0.2 m beside the hub's axis.
    """

    arm: Arm = field(default_factory=_ist_arm)
    torque: Sequence[float] = (0.5,)
    measure: Sequence[Any] = (("joint", 0), ("rate", 0), ("strain", 0, 0.0, "K3"))
    extra: int = 1

    def start(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        q = self.arm.zero
        q[0], q[1] = rng.uniform(-0.3, 0.3), rng.uniform(-0.03, 0.03)  # clamped-free shapes are 1 at the tip
        return q, np.zeros(self.arm.nv), np.zeros(0)

    def observe(self, state: State) -> Array:
        row = self.arm.strain(np.eye(self.arm.nq), 0, 0.0)[:, 2]  # linear in q: with v it gives the rate
        return (state.v @ row)[:, None]

    def marks(self, state: State) -> Array:
        return np.tile(self.arm.frame(self.arm.zero)[0], (len(state.t), 1, 1))

    def _distance(self, state: State) -> Array:
        return np.asarray(np.linalg.norm(state.end - self.marks(state)[:, 0], axis=1))

    def reward(self, state: State, action: Array) -> Array:
        return np.asarray(1 / (1 + (self._distance(state) / 0.02) ** 2) - 0.01 * (action**2).sum(axis=1))

    def lost(self, state: State) -> NDArray[np.bool_]:
        angle = state.q[:, 0]
        beside = -np.sin(angle) * state.end[:, 0] + np.cos(angle) * state.end[:, 1]
        return np.asarray((np.abs(angle) > np.pi) | (np.abs(beside) > 0.2))


def _two_links() -> Arm:
    """Two flexible aluminium links in a plane, with an elbow motor of 0.3 kg and 0.1 kg to carry."""
    aluminium = Material(density=2700.0, youngs_modulus=70e9, poisson_ratio=0.33)
    beams = [
        Beam(
            length=length,
            section=Rectangle(y=y, z=0.02),
            material=aluminium,
            modes={"bending_y": 2},
            damping_ratio=0.01,
        )
        for length, y in ((0.5, 0.004), (0.4, 0.003))
    ]
    shoulder, elbow = (Revolute("z", reflected_inertia=x) for x in (0.02, 0.005))
    first = Link(joint=shoulder, beam=beams[0], tip=RigidBody(mass=0.3))
    return Arm([first, Link(joint=elbow, beam=beams[1], tip=RigidBody(mass=0.1))])


@dataclass(frozen=True, eq=False)
class TipTracking(Task):
    """The end of a flexible two-link arm in a plane must follow a target on a circle.

    Observation (10): angles of both joints (rad) and rates (rad/s), curvature at both clamps (1/m); from the end to
    the target, x and y (m); the target's velocity, x and y (m/s).
    Action (2): torques of shoulder and elbow, 1 stands for 3 and 1 N m; held for 10 ms; 400 periods are an episode.
    Start: at rest, on the target where the links are straight; the circle's radius is 0.1 to 0.2 m, its centre 0.6 m
    from the shoulder in any direction within 0.5 rad of x, a round takes 3 to 6 s either way.
    Reward: 1 / (1 + (x / 0.05)^2) - 0.01 |u|^2, x the distance from the target (m); ended early, with -1, if it is
    above 0.5 m.
    """

    arm: Arm = field(default_factory=_two_links)
    torque: Sequence[float] = (3.0, 1.0)
    links: Sequence[int] = (0, 1)
    measure: Sequence[Any] = (
        ("joint", 0), ("joint", 1), ("rate", 0), ("rate", 1), ("strain", 0, 0.0, "K3"), ("strain", 1, 0.0, "K3"),
    )  # fmt: skip
    horizon: int = 400
    goals: int = 5  # centre x, y; radius; phase; angular rate
    extra: int = 4

    def start(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        direction, radius = rng.uniform(-0.5, 0.5), rng.uniform(0.1, 0.2)
        phase, rate = rng.uniform(-np.pi, np.pi), 2 * np.pi / rng.uniform(3.0, 6.0) * rng.choice([-1.0, 1.0])
        goal = np.array([0.6 * np.cos(direction), 0.6 * np.sin(direction), radius, phase, rate])
        x, y = self.target(goal[None], np.zeros(1))[0][0]
        a, b = 0.5, 0.4  # lengths: where the straight links reach the target, elbow to the right
        bend = np.arccos(np.clip((x * x + y * y - a * a - b * b) / (2 * a * b), -1, 1))
        q = self.arm.zero
        q[0] = np.arctan2(y, x) - np.arctan2(b * np.sin(bend), a + b * np.cos(bend))
        q[self._elbow] = bend
        return q, np.zeros(self.arm.nv), goal

    @property
    def _elbow(self) -> int:
        return self.arm.coordinate_of(self.arm.joint_rate(1))

    def target(self, goal: Array, t: Array) -> tuple[Array, Array]:
        """Position and velocity (B, 2) of the targets at times t (B,)."""
        angle = goal[:, 3] + goal[:, 4] * t
        out = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        across = np.stack([-out[:, 1], out[:, 0]], axis=1)
        return goal[:, :2] + goal[:, 2:3] * out, (goal[:, 2] * goal[:, 4])[:, None] * across

    def observe(self, state: State) -> Array:
        place, velocity = self.target(state.goal, state.t)
        return np.concatenate([place - state.end[:, :2], velocity], axis=1)

    def marks(self, state: State) -> Array:
        place = self.target(state.goal, state.t)[0]
        return np.concatenate([place, state.end[:, 2:]], axis=1)[:, None]

    def _distance(self, state: State) -> Array:
        return np.asarray(np.linalg.norm(self.target(state.goal, state.t)[0] - state.end[:, :2], axis=1))

    def reward(self, state: State, action: Array) -> Array:
        return np.asarray(1 / (1 + (self._distance(state) / 0.05) ** 2) - 0.01 * (action**2).sum(axis=1))

    def lost(self, state: State) -> NDArray[np.bool_]:
        return np.asarray(self._distance(state) > 0.5)


#: by name
TASKS: dict[str, type[Task]] = {"tip-tracking": TipTracking, "vibration-suppression": VibrationSuppression}
