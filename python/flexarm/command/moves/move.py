"""A planned move."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ..._check import Array, number
from ..._console import aligned
from ...arm.arm import Arm
from ...data.draw.style import Figure
from ...data.draw.trajectory import plot_panels
from ...model.acting.drive import Motion
from ...model.parts.labels import ends as ends_of
from ...run.result import Result
from ...run.simulation import simulate
from ..joint_limits import same_joints
from .moved_arm import MovedArm

_HOLD = 1e4  # duration of the rest at the end of the motions (s)
_AT = 0.99  # share of a limit from which it counts as reached


class LimitUse(NamedTuple):
    """The largest value of a limited quantity in a move.

    Attributes:
        what: "torque", "speed", "acceleration" or "jerk". joint: its name in `arm.coordinates`.
        peak: the largest absolute value. limit: its bound. t: time of the peak (s). reached: whether it is 99 % of the
            limit.
    """

    what: str
    joint: str
    peak: float
    limit: float
    t: float

    @property
    def reached(self) -> bool:
        return self.peak >= _AT * self.limit


@dataclass(frozen=True, repr=False)
class Move:
    """A move of an arm from rest to rest, the result of `plan_move`.

    Attributes:
        arm: the arm.
        t: times (s), (n,), from 0 to the end. q, v, a: of the joints there, (n, nj), in the order of `joints`.
        torques: of the joints, gravity included (N, N m), (n, nj): the reactions of the flexible arm to this motion;
            as feed-forward they produce it.
        joints: their names. duration: of the move (s).
        rigid_duration: of the time-optimal move of the arm with rigid beams along the same path, or the straight line
            (s), under the same limits of torque, speed and acceleration.
        half_period: of the slowest mode with locked joints (s), at the start or the end, the shorter one; 0 for a rigid
            arm. It is the time that a ZV shaper adds.
        frequencies: with locked joints, at the start and at the end (rad/s), (2, n): of the modes that are brought to
            rest.
        limits: the use of each limit.
        residual: largest distance of the arm's end, of a tree of any end, from its final place after the move,
            simulated on the flexible arm (m). residual_unshaped: after the time-optimal rigid move.
        drive: motions for `simulate`, which stay at the end when the move is over. rigid_drive: those of the
            time-optimal rigid move, for comparison.
    """

    arm: Arm
    t: Array
    q: Array
    v: Array
    a: Array
    torques: Array
    joints: tuple[str, ...]
    duration: float
    rigid_duration: float
    half_period: float
    frequencies: Array
    limits: tuple[LimitUse, ...]
    residual: float
    residual_unshaped: float
    drive: dict[Any, Motion]
    rigid_drive: dict[Any, Motion]
    _plant: MovedArm = field(compare=False)

    @property
    def motions(self) -> tuple[Motion, ...]:
        """The motions of the joints, in their order."""
        return tuple(self.drive.values())

    @property
    def reached(self) -> tuple[LimitUse, ...]:
        """The limits that the move reaches."""
        return tuple(x for x in self.limits if x.reached)

    def simulate(self, arm: Arm | None = None, *, after: float | None = None, **options: Any) -> Result:
        """A simulation of the flexible arm under this move, from rest, and for a while after.

        Args:
            arm: another one with the same joints, such as with another payload; the arm planned for if None.
            after: simulated time after the move (s); None: one period of the slowest mode.
            options: of `simulate`; "ida" with tight tolerances if none.
        """
        return self._run(simulate, arm, after, options)

    def _run(self, by: Callable[..., Result], arm: Arm | None, after: float | None, options: dict[str, Any]) -> Result:
        plant = self._plant if arm is None else self._other(arm)
        on = None if after is None else number("after", after)
        if on is not None and not 0.0 <= on < _HOLD:
            raise ValueError(f"after = {after}: must be from 0 to {_HOLD:g} s")
        end = plant.after(self.duration) if on is None else self.duration + np.linspace(0.0, on, 97)
        if not {"integrator", "rtol"} & set(options):
            options = {**options, **plant.tolerances}
        times = np.concatenate([self.t[:-1], end]) if end[-1] > end[0] else self.t
        return by(plant.arm, times, q0=plant.q_start, drive=self.drive, **options)

    def residual_of(self, arm: Arm) -> float:
        """Largest distance (m) after this move from its final place, for the end of another arm with the same joints,
        such as with another payload."""
        return swing(self._other(arm), self.simulate(arm), self.duration)

    def _other(self, arm: Any) -> MovedArm:
        if not isinstance(arm, Arm) or not same_joints(arm, self.arm):
            raise ValueError("arm: must be an Arm with the same joints as the one the move is planned for")
        return MovedArm(arm, type(self._plant.driven).of(arm), self.q[0], self.q[-1])

    def __repr__(self) -> str:
        return f"Move({self.duration:.4g} s, {len(self.joints)} joints, {100 * self._part():.2g} % of the vibration)"

    def _part(self) -> float:
        return self.residual / self.residual_unshaped if self.half_period > 0 else 0.0

    def __str__(self) -> str:
        bound = self.rigid_duration + self.half_period
        lines = [
            f"duration            {self.duration:.4g} s",
            f"rigid arm           {self.rigid_duration:.4g} s; with half a period {bound:.4g} s "
            f"({100 * (self.duration / bound - 1):+.1f} %)",
            f"end swings after it {1e3 * self.residual:.3g} mm; after the rigid arm's move "
            f"{1e3 * self.residual_unshaped:.3g} mm",
        ]
        rows = [("limit", "joint", "peak", "limit", "at (s)", "")]
        rows += [(x.what, x.joint, f"{x.peak:.4g}", f"{x.limit:.4g}", f"{x.t:.3g}", "reached" if x.reached else "")
                 for x in self.limits]  # fmt: skip
        return "\n".join([*lines, "", *aligned(rows, (2, 3, 4))])

    def plot(self) -> Figure:
        """A figure of the joints' positions, rates and torques over time, and of the distance of the arm's end (of a
        tree: of each end) from its place with the same joints and the beams at rest."""
        run = self.simulate()
        names, at = self.joints, self._plant.driven
        still = np.repeat(self._plant.q_end[None], len(run.t), axis=0)
        still[:, at.at] = run.q[:, at.at]
        off = np.linalg.norm(self.arm.end_places(run.q) - self.arm.end_places(still), axis=2)
        label = "from where these joints would have it at rest"
        ends = [label] if off.shape[1] == 1 else [f"{of}, {label}" for _, of in ends_of(self.arm)]
        units = "/".join(dict.fromkeys(at.units))
        forces = ", ".join({"rad": "N m", "m": "N"}[u] for u in dict.fromkeys(at.units))
        kind = "Force" if forces == "N" else "Torque"
        panels = [
            (f"Joint ({units})", [(n, run.q[:, k]) for n, k in zip(names, at.at, strict=True)]),
            (f"Rate ({units}/s)", [(n, run.v[:, k]) for n, k in zip(names, at.rates, strict=True)]),
            (f"{kind} ({forces})", [(n, run.tau[:, k]) for n, k in zip(names, at.rates, strict=True)]),
            ("Deflection of the end (mm)", [(name, 1e3 * x) for name, x in zip(ends, off.T, strict=True)]),
        ]
        return plot_panels(run.t, panels)


def swing(plant: MovedArm, run: Result, duration: float) -> float:
    """The largest distance of the arm's end, of a tree of any end, from its final place, after a move (m)."""
    after = run.arm.end_places(run.q[run.t >= duration * (1.0 - 1e-12)])
    return float(np.linalg.norm(after - plant.rest, axis=2).max())


def held(t: Array, q: Array, v: Array, a: Array) -> tuple[Array, ...]:
    """Samples, extended by rest after the last one."""
    zero = np.zeros_like(q[:1])
    return (
        np.append(t, t[-1] + _HOLD),
        np.vstack([q, q[-1:]]),
        np.vstack([v[:-1], zero, zero]),
        np.vstack([a[:-1], zero, zero]),
    )
