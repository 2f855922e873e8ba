"""The result of an inversion: the motion, the torques, their errors, and runs that try them."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

import flexarm._core as _core

from ..._check import Array, array, choice
from ...arm.arm import Arm
from ...data.draw.style import Figure
from ...data.draw.trajectory import plot_panels
from ...model.acting.control import PD
from ...model.acting.drive import Motion, Torque
from ...run.result import Result
from ...run.simulation import simulate
from ..joint_limits import freedoms, same_joints
from .path import Output

REPLAYS = ("motion", "torque", "feedback")


class Exceeded(NamedTuple):
    """A limit that an inversion exceeds: its kind ("torque", "speed", "range"), the joint's link (or (link, freedom)),
    the time of the largest excess (s), the value there, the limit, and the joint's name in `arm.coordinates`."""

    kind: str
    joint: Any
    time: float
    value: float
    limit: float
    name: str

    def __str__(self) -> str:
        return f"{self.kind} of {self.name}: {self.value:.4g} at t = {self.time:.4g} s, limit {self.limit:.4g}"


@dataclass(repr=False, eq=False)
class Inversion:
    """The motion of an arm whose tip follows a path, and the torques for it, evenly spaced in time.

    Attributes:
        arm: the arm. method: "stable", "quasi-static" or "rigid".
        t: times (s), from `pre` before the path begins to `post` after it has ended, (nt,).
        q: coordinates, (nt, nq). v, a: their rates and accelerations, (nt, nv).
        tau: generalised forces (N, N m), (nt, nv): the motors' at the driven joints; 0 elsewhere.
        wanted: the components of the tip on the path, (nt, p), in the order of `names`.
        joints: of each driven freedom, its link, or (link, freedom) where the joint has several.
        pre, post: how long the joints move before the path begins and after it has ended (s).
        error: distance of the tip from the path between the rows, estimated from the equations' residual (m, rad).
        edge: largest distance of the window's ends from rest, as a motion of the tip with the joints held (m, rad). A
            run that begins at rest may be off by several times that.
        iterations: of the solver, on all grids. seconds: of computing.
        slowed: the factor by which the path was slowed for the limits; 1 without slowing.
        exceeded: limits that are exceeded, a list of (kind, joint, time, value, limit).
        poles: of the internal dynamics at rest (1/s, complex), at the path's start and at its end: the arm's dynamics
            with its tip at rest. Those in the right half plane make the joints move ahead of the tip. Empty unless the
            method is "stable".
    """

    arm: Arm
    method: str
    t: Array
    q: Array
    v: Array
    a: Array
    tau: Array
    wanted: Array
    names: tuple[str, ...]
    joints: list[Any]
    pre: float
    post: float
    error: float
    edge: float
    iterations: int
    seconds: float
    slowed: float
    poles: tuple[Array, Array]
    exceeded: list[Exceeded] = field(default_factory=list)
    _path: Any = None  # a Path
    _at: tuple[int, float | None] = (-1, None)  # link and x of the slice on the path
    _held: tuple[Any, ...] = ()  # keys of locked and of passive freedoms
    _passive: tuple[Any, ...] = ()

    def __repr__(self) -> str:
        return (
            f"Inversion({self.method}: {', '.join(self.names)} by {len(self.joints)} joints, {len(self.t)} rows, "
            f"t = {self.t[0]:.4g} to {self.t[-1]:.4g} s, {self.pre:.3g} s ahead and {self.post:.3g} s after, error "
            f"{self.error:.1e} m, {len(self.exceeded)} limits exceeded, {self.seconds:.3g} s)"
        )

    @property
    def motions(self) -> dict[Any, Motion]:
        """The motion of each driven joint, as `simulate(drive=...)` takes it: for servos that follow it exactly."""
        return {
            joint: Motion(self.t, self.q[:, self._coordinate(i)], self.v[:, i], self.a[:, i])
            for joint, i in self._rates()
        }

    @property
    def torques(self) -> dict[Any, Torque]:
        """The torque of each driven joint, as `simulate(drive=...)` takes it: splines of degree 5 through the rows.

        They are open-loop: see `replay`."""
        return {joint: _smooth_torque(self.t, self.tau[:, i]) for joint, i in self._rates()}

    def feedback(self, kp: Any, kv: Any) -> tuple[dict[Any, Torque], list[PD]]:
        """Torques and controllers that keep each driven joint to its motion: tau + kp (q_d - q) + kv (v_d - v), as
        `simulate(drive=..., control=...)` takes them.

        Args:
            kp, kv: gains, one number or one for each driven joint (N m/rad, N m s/rad; N/m, N s/m).
        """
        m = len(self.joints)
        kp, kv = (array(name, np.full(m, x) if np.ndim(x) == 0 else x, (m,)) for name, x in (("kp", kp), ("kv", kv)))
        torques, laws = {}, []
        for k, (joint, i) in enumerate(self._rates()):
            torques[joint] = _smooth_torque(self.t, self.tau[:, i] + kv[k] * self.v[:, i])
            reference = _smooth_torque(self.t, self.q[:, self._coordinate(i)])
            laws.append(PD(float(kp[k]), float(kv[k]), joint, reference=reference))
        return torques, laws

    def replay(self, arm: Arm | None = None, how: str = "motion", *, kp: Any = None, kv: Any = None,
               **options: Any) -> Result:  # fmt: skip
        """A simulation that tries the inversion: from rest in balance, over all rows. `tip_error` gives its distance
        from the path.

        Args:
            arm: another model of the same arm, such as one with more modes; None: the inverted one.
            how: "motion": the driven joints follow their motion exactly. "torque": the torques alone, open-loop: an arm
                that gravity upsets, or whose joints are not held, amplifies rounding errors and drifts away; this is a
                property of the arm. "feedback": the torques, and PD about the motion, with gains kp and kv.
            options: of `fa.simulate`. Without an integrator, "ida" with rtol 1e-9, atol 1e-11, max_order 5.
        """
        choice("how", how, REPLAYS)
        if (how == "feedback") != (kp is not None and kv is not None):
            raise ValueError(f'kp = {kp}, kv = {kv}: how="feedback" needs both gains, other ways none')
        arm = self.arm if arm is None else arm
        if not isinstance(arm, Arm) or not same_joints(arm, self.arm):
            raise ValueError(f"arm = {arm!r}: must be an Arm with the same joints as the inverted one")
        if "integrator" not in options:
            options = {"rtol": 1e-9, "atol": 1e-11, "max_order": 5, **options}
        drive: dict[Any, Any] = {}
        control: list[PD] | None = None
        if how == "feedback":
            torques, control = self.feedback(kp, kv)
            drive.update(torques)
        else:
            drive.update(self.motions if how == "motion" else self.torques)
        still = np.zeros(2)
        for joint in self._held:
            drive[joint] = Motion(self.t[[0, -1]], still + self._joint_places()[joint], still, still)
        return simulate(arm, self.t, self._start(arm), drive=drive, control=control, **options)

    def tip_error(self, result: Result) -> Array:
        """Distance of the tip from the path in a result, (nt, p): components of `names`, wanted less simulated.

        Raises:
            ValueError: the argument is no Result."""
        if not isinstance(result, Result):
            raise ValueError(f"result = {result!r}: must be a Result, such as replay() gives")
        output = Output(result.arm, *self._at, self.names)
        return output.error(result.q, self._path(result.t))

    def plot(self) -> Figure:
        """A figure of the path from its start, joint motions, their rates and torques; dotted: its ends."""
        rates = [i for _, i in self._rates()]
        label = [self.arm.coordinates[i] for i in rates]
        at = [self._coordinate(i) for i in rates]
        moved = self.wanted - self.wanted[0]
        panels = [("tip moved (m, rad)", [(name, moved[:, k]) for k, name in enumerate(self.names)])]
        panels += [
            (name, [(label[k], x[:, i]) for k, i in enumerate(columns)])
            for name, x, columns in (("joints (rad, m)", self.q, at), ("rates (rad/s, m/s)", self.v, rates),
                                     ("torques (N m, N)", self.tau, rates))
        ]  # fmt: skip
        fig = plot_panels(self.t, panels)
        for ax in fig.axes:
            for edge in (self.t[0] + self.pre, self.t[-1] - self.post):
                ax.axvline(edge, color="0.6", linewidth=0.8, linestyle=":")
        return fig

    # -- helpers ------------------------------------------------------------------------------------------------------

    def _rates(self) -> list[tuple[Any, int]]:
        return [(joint, self.arm.joint_rate(joint)) for joint in self.joints]

    def _coordinate(self, rate: int) -> int:
        return self.arm.coordinate_of(rate)

    def _joint_places(self) -> dict[Any, float]:
        """The start value of each freedom of each joint."""
        return {key: float(self.q[0, self._coordinate(i)]) for key, i in freedoms(self.arm).items()}

    def _start(self, arm: Arm) -> Array:
        """The pose at rest, of this or another model."""
        q = self.q[0].copy() if arm is self.arm else arm.zero
        for key, place in self._joint_places().items():
            q[arm.coordinate_of(arm.joint_rate(key))] = place
        return arm.equilibrium(q, lock=[key for key in self._joint_places() if key not in self._passive])


def _smooth_torque(t: Array, values: Array) -> Torque:
    from scipy.interpolate import PPoly, make_interp_spline  # slow to import

    pieces = PPoly.from_spline(make_interp_spline(t, values, k=5))
    keep = np.flatnonzero(np.diff(pieces.x) > 0)
    made = Torque.__new__(Torque)
    made.law = _core.PiecewisePolynomial(np.append(pieces.x[keep], pieces.x[-1]), pieces.c[:, keep])
    return made
