"""Controllers: laws from measurements to joint forces and voltages (paper Sec. 5.3, Eq. 97).

Continuous ones are solved together with the arm's equations, in C++, by every integrator. Sampled ones read the state
at a fixed rate and hold their output until the next sample (zero-order hold).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

import flexarm._core as _core
from flexarm._core import Feedback, Sampler

from ..._check import Array, array, choice, finite_number, instance, number, positive
from ..parts.arguments import arguments
from ..parts.beam import STRAIN_NAMES
from ..parts.chain import Chain
from ..parts.joints import Prismatic
from ..parts.link import Link
from .drive import Torque, is_patch
from .following import fitted, led, led_by, plus
from .motor import Motor


def listed(name: str, value: Any) -> list[Any]:
    if not isinstance(value, (list, tuple)) or not value:
        raise ValueError(f"{name} = {value!r}: must be a list of at least one entry")
    return list(value)


def limit_of(value: Any, motor: Any = None, count: int | None = None) -> Any:
    """The limit of |u|, or of each of `count` outputs: the lower of the given limit and the motor's."""
    if motor is not None:
        instance("motor", motor, Motor)
    most = np.inf if motor is None or motor.limit is None else motor.limit
    if count is None or np.ndim(value) == 0:
        return min(np.inf if value is None else positive("limit", value), most)
    limits = array("limit", value)
    if limits.shape != (count,) or not ((limits > 0.0) & (limits < np.inf)).all():
        raise ValueError(f"limit = {value!r}: must be one positive number, or {count}, one for each output")
    return np.minimum(limits, most)


def gain_of(motor: Motor | None) -> float:
    """Joint force per unit of u."""
    return 1.0 if motor is None else motor.gain


def braking_laws(arm: Chain, motor: Motor | None, units: Iterable[Array]) -> list[Feedback]:
    """The laws of a motor's back-EMF at joints given by unit columns (nv,)."""
    if motor is None or motor.braking == 0.0:
        return []
    return [Feedback(unit, np.zeros(arm.nq), motor.braking * unit, None, np.inf) for unit in units]


class Run(NamedTuple):
    """Data of a run for its controllers.

    Attributes:
        times, loads: of the run.
        first, total: index of the controller's first state among those of all controllers, and their number; see
            `extended`.
        number: index of the controller. controls: all of them.
    """

    times: Array
    loads: Any
    first: int
    total: int
    number: int = 0
    controls: Sequence[Any] = ()


class Controller:
    """The base class of controllers: `simulate(control=...)` takes one, or a list of them."""

    #: number of integrated states of a continuous law
    memory = 0
    #: whether the time functions of its laws depend on the arm
    of_arm = False
    #: whether a changed argument needs a new object, not a set attribute
    rebuilt: ClassVar[bool] = False
    #: its type in files; "": not in files
    type: ClassVar[str] = ""

    def _arguments(self) -> dict[str, Any]:
        """The arguments it was made with, which a file holds; attributes have the same names."""
        made: Any = type(self)
        return {name: getattr(self, name) for name in arguments(made)}

    def __repr__(self) -> str:
        """One line with its gains, joint, rate, and other arguments that are not at their defaults."""
        try:
            given = self._arguments()
        except AttributeError:  # a subclass with other attributes
            return object.__repr__(self)
        made: Any = type(self)
        defaults = arguments(made)
        said = {name: _in_words(value) for name, value in given.items() if name in defaults}
        shown = [f"{name}={text}" for name, text in said.items()
                 if text and (name == "link" or text != _in_words(defaults[name].default))]  # fmt: skip
        return f"{made.__name__}({', '.join(shown)})"

    def check_smooth(self, arm: Chain, name: str) -> None:
        """Raises ValueError, with `name`, if its forces jump with its measurements."""

    def _smooth(self) -> Controller:
        """It, with sensors that do not read in steps."""
        return self

    def _laws(self, arm: Chain, run: Run) -> tuple[list[Feedback], list[Sampler]]:
        raise NotImplementedError(f"{type(self).__name__} is no control law: subclass Sampled, or give one a function")

    def _columns(self, arm: Chain) -> list[Array]:
        """Generalised forces (nv,) per unit of each output."""
        return force_columns(arm, self.actuate)  # type: ignore[attr-defined]


def controllers(control: Any) -> tuple[Controller, ...]:
    """The argument `control` of a run: none, one, or a list of controllers."""
    found = () if control is None else (control,) if isinstance(control, Controller) else control
    if not isinstance(found, (list, tuple)) or not all(isinstance(c, Controller) for c in found):
        raise ValueError(f"control = {control!r}: must be a controller, such as PD(...), or a list of them")
    return tuple(found)


def _in_words(value: Any) -> str:
    """An argument of a controller in short words; "" for None."""
    if isinstance(value, Torque) and value.constant:
        value = float(np.ravel(value(0.0))[0])
    if isinstance(value, np.ndarray):
        few = "[" + ", ".join(f"{x:.4g}" for x in value.ravel()) + "]"
        much = " x ".join(map(str, value.shape)) + " numbers"
        return "" if not value.any() else few if value.size <= 8 else much
    if isinstance(value, (list, tuple)):
        inside = ", ".join(map(_in_words, value))
        return f"({inside})" if isinstance(value, tuple) else f"[{inside}]"
    if value is None or (isinstance(value, float) and not np.isfinite(value)):
        return ""
    if isinstance(value, (bool, str, Motor)):
        return repr(value)
    return f"{value:.6g}" if isinstance(value, (int, float)) else getattr(value, "__name__", type(value).__name__)


class PD(Controller):
    """u = k_p (reference - q) + k_v (reference_rate - dq/dt) of one joint, continuous.

    Args:
        kp, kv: gains, per rad (m) and per rad/s (m/s); of a torque (N m, N), or of the motor's current or voltage.
        link, freedom: the joint (-1 is the last), and its freedom if it has several; or link = (link, freedom); or the
            name of a strut with a mass, whose q is its length (m).
        reference: of q (rad, m): a number, samples (t, r), linear in between, a callable t -> r, or a Motion, whose
            rate is then followed, too.
        reference_rate: of dq/dt (rad/s, m/s), likewise; None: the rate of a Motion, else zero.
        limit: of |u|; None: the motor's.
        motor: converts u to a torque; None: u is the torque.
    """

    type = "pd"

    def __init__(
        self, kp: float, kv: float, link: Any = -1, freedom: int | None = None, *, reference: Any = 0.0,
        reference_rate: Any = None, limit: float | None = None, motor: Motor | None = None,
    ) -> None:  # fmt: skip
        self.kp, self.kv = finite_number("kp", kp), finite_number("kv", kv)
        if freedom is None and isinstance(link, (tuple, list)):  # files have lists
            link, freedom = link
        self.link, self.freedom = link, freedom
        self.reference, self.reference_rate = led_by(reference, reference_rate)
        self.motor, self.limit = motor, limit_of(limit, motor)

    def _rate(self, arm: Chain) -> int:
        return arm.joint_rate(self.link if self.freedom is None else (self.link, self.freedom), "link")

    def _columns(self, arm: Chain) -> list[Array]:
        return [np.eye(arm.nv)[self._rate(arm)]]

    def _offset(self, arm: Chain, i: int, times: Array) -> Torque:
        """k_p r + k_v r' as a law of time."""
        return led(self.reference, self.reference_rate, self.kp, self.kv, times)

    def _laws(self, arm: Chain, run: Run) -> tuple[list[Feedback], list[Sampler]]:
        i = self._rate(arm)
        at = arm.coordinate_of(i)
        if at < 0:
            raise ValueError(
                f"control of '{arm.coordinates[i]}': a ball has no angle to control; use three rotations (Axes)"
            )
        unit, by_q = np.eye(arm.nv)[i], np.zeros(arm.nq)
        by_q[at] = self.kp
        column, offset = gain_of(self.motor) * unit, self._offset(arm, i, run.times).law
        law = Feedback(column, by_q, self.kv * unit, offset, self.limit)
        return [law, *braking_laws(arm, self.motor, [unit])], []


class StrainFeedback(PD):
    """A PD law of a joint with feedback of a beam's strain, continuous.

    u = k_p (reference - q) + k_v (reference_rate - dq/dt) - k_s (K - static), with K the curvature at a strain gauge
    (Eq. 97). Without `static` or `washout` the static strain under gravity shifts the joint by k_s K / k_p.

    Args:
        kp, kv, link, freedom, reference, reference_rate, limit, motor: as of PD.
        ks: gain per 1/m.
        x: position of the gauge on the beam (m).
        strain: the strain, in the order of `Arm.strain`: "K1", "K2", "K3", "phi12", "phi13" or
            "eps".
        beam: the link whose beam has the gauge; None: the controlled joint's link.
        static: static part, which is subtracted from K: a number (1/m); or "equilibrium": K in static equilibrium with
            gravity at the reference, with the arm's payload, without each `Load`.
        pose: positions of the other joints in that equilibrium: q (nq,), whose elastic entries are ignored; None: zero.
        washout: corner frequency (rad/s) of a high-pass filter, s / (s + washout) K is fed back instead of K: it
            removes static strain of gravity, loads and payloads. Its state starts at zero. None: no filter.
    """

    type = "strain_feedback"

    def __init__(
        self, kp: float, kv: float, ks: float, link: Any = -1, freedom: int | None = None, *, x: float = 0.0,
        strain: str = "K3", beam: int | str | None = None, reference: Any = 0.0, reference_rate: Any = None,
        static: float | str = 0.0, pose: ArrayLike | None = None, washout: float | None = None,
        limit: float | None = None, motor: Motor | None = None,
    ) -> None:  # fmt: skip
        super().__init__(
            kp, kv, link, freedom, reference=reference, reference_rate=reference_rate, limit=limit, motor=motor
        )
        self.ks, self.x, self.beam = finite_number("ks", ks), finite_number("x", x), beam
        self.strain = choice("strain", strain, STRAIN_NAMES)
        equilibrium = isinstance(static, str)
        self.static = choice("static", static, ("equilibrium",)) if equilibrium else finite_number("static", static)
        self.pose = pose if pose is None else array("pose", pose)
        if self.pose is not None and not equilibrium:
            raise ValueError('pose: is for static = "equilibrium"')
        self.washout = None if washout is None else positive("washout", washout)
        if self.washout is not None and static != 0.0:
            raise ValueError(f"washout = {washout}: it removes the static part; leave out static")
        self.memory, self.of_arm = int(washout is not None), equilibrium

    def _gauge(self, arm: Chain) -> Array:
        """Derivative of K by q, (nq,)."""
        beam = self.link if self.beam is None else self.beam
        row: Array = measured_rows(arm, [("strain", beam, self.x, self.strain)])[0][0]
        return row

    def _offset(self, arm: Chain, i: int, times: Array) -> Torque:
        law = super()._offset(arm, i, times)
        if not isinstance(self.static, str):
            return law if self.static == 0.0 else plus(law, Torque(self.ks * self.static))
        arm.refuse_loops('StrainFeedback: static = "equilibrium"', rigid=True)
        pose = np.zeros(arm.nq) if self.pose is None else array("pose", self.pose, (arm.nq,))
        followed = self.reference.law
        if isinstance(self.reference, Torque) and not isinstance(followed, _core.PiecewisePolynomial):
            followed = lambda t: (self.reference(t), 0.0, 0.0)  # noqa: E731
        held = [(j, _core.PiecewisePolynomial([0.0, 1.0], [[pose[arm.coordinate_of(j)]]])) for j in all_joints(arm)]
        axes = [(j, followed if j == i else place, 0.0, 0.0, np.inf) for j, place in held]
        core = _core.ComputedTorque(arm._core, axes, True, [], arm.nv)
        row, begin, end = self._gauge(arm), float(times[0]), float(times[-1])
        if self.reference.constant:
            return plus(law, Torque(self.ks * float(row @ core.at_rest([begin])[0])))
        kinks = followed.breaks if isinstance(followed, _core.PiecewisePolynomial) else np.zeros(0)
        rest = fitted(lambda t: self.ks * (core.at_rest(t) @ row)[:, None], begin, end, kinks)[0]
        return plus(law, Torque.of(rest))

    def _laws(self, arm: Chain, run: Run) -> tuple[list[Feedback], list[Sampler]]:
        (law, *others), _ = super()._laws(arm, run)
        row, by_v = self._gauge(arm), law.by_v
        by_q = law.by_q + self.ks * row
        if self.washout is None:
            return [Feedback(law.column, by_q, by_v, law.reference, law.limit), *others], []
        state = np.eye(arm.nv + run.total)[arm.nv + run.first]
        by_v = padded(by_v, arm.nv + run.total) - self.ks * state
        filtered = Feedback(state, -self.washout * row, self.washout * state, None, np.inf)
        return [Feedback(law.column, by_q, by_v, law.reference, law.limit), filtered, *others], []


class StateFeedback(Controller):
    """Feedback of all coordinates and rates, u = u0 - K [q - q0; v - v0], continuous.

    K is from a design on `Arm.linearize` (`lqr`, pole placement).

    Args:
        K: gains (nu, 2 nv): by all coordinates, then by all rates, in the order of LinearModel.states without locked
            coordinates. For arms without ball joints.
        actuate: nu links (-1 is the last), (link, freedom), ("patch", link, patch), or columns (nv,) of generalised
            forces per unit of u.
        q0, v0, u0: operating point and the forces there; None: zero.
        limit: of each |u|, one number or nu of them; None: no limit.
    """

    type = "state_feedback"

    def __init__(
        self, K: ArrayLike, actuate: Sequence[Any] = (-1,), *, q0: ArrayLike | None = None, v0: ArrayLike | None = None,
        u0: ArrayLike | None = None, limit: ArrayLike | None = None,
    ) -> None:  # fmt: skip
        self.K, self.actuate = np.atleast_2d(array("K", K)), listed("actuate", actuate)
        self.q0, self.v0, self.u0, self.limit = q0, v0, u0, limit_of(limit, None, len(self.actuate))

    def _laws(self, arm: Chain, run: Run) -> tuple[list[Feedback], list[Sampler]]:
        if arm.nq != arm.nv:
            raise ValueError(
                "StateFeedback: is for arms without balls, whose coordinates are not those of a linear model"
            )
        columns = force_columns(arm, self.actuate)
        K = array("K", self.K, (len(columns), 2 * arm.nv))
        q0 = arm._place("q0", self.q0)  # zero if None: there are no balls
        v0 = np.zeros(arm.nv) if self.v0 is None else array("v0", self.v0, (arm.nv,))
        u0 = np.zeros(len(columns)) if self.u0 is None else array("u0", self.u0, (len(columns),))
        offset = u0 + K @ np.concatenate([q0, v0])
        laws = [
            Feedback(c, k[: arm.nq], k[arm.nq :], Torque(float(u)).law, float(limit))
            for c, k, u, limit in zip(columns, K, offset, np.broadcast_to(self.limit, len(K)), strict=True)
        ]
        return laws, []


def all_joints(arm: Chain) -> list[int]:
    """The rates of all joints' freedoms. ValueError for ball joints."""
    for i in arm.freedoms:
        if arm.coordinate_of(i) < 0:
            raise ValueError(f"'{arm.coordinates[i]}' is a ball's, which has no angle; use three rotations (Axes)")
    return arm.freedoms


def force_columns(arm: Chain, actuate: Sequence[Any]) -> list[Array]:
    """A column of generalised forces (nv,) for each entry of `actuate`."""
    out = []
    for k, entry in enumerate(actuate):
        if isinstance(entry, (np.ndarray, list)):
            out.append(array(f"actuate[{k}]", entry, (arm.nv,)))
            continue
        if is_patch(entry):
            if len(entry) != 3:
                raise ValueError(f'actuate[{k}] = {entry!r}: must be ("patch", link, patch)')
            out.append(arm.patch_matrix[:, arm.patch_column(arm._link(entry[1], f"actuate[{k}]: link"), entry[2])])
            continue
        out.append(np.eye(arm.nv)[arm.joint_rate(entry, f"actuate[{k}]: link")])
    return out


def measured_rows(arm: Chain, measure: Sequence[Any] | None, first: int = 0) -> tuple[Array, Array]:
    """Matrices by_q (ny, nq) and by_v (ny, nv) of measurements that are linear in the state; None: the whole state."""
    if measure is None:
        return np.eye(arm.nq + arm.nv, arm.nq), np.eye(arm.nq + arm.nv, arm.nv, -arm.nq)
    parts = [rows_of_entry(arm, f"measure[{k}]", entry) for k, entry in enumerate(measure, first)]
    return np.vstack([np.zeros((0, arm.nq)), *(p[0] for p in parts)]), np.vstack(
        [np.zeros((0, arm.nv)), *(p[1] for p in parts)]
    )


def rows_of_entry(arm: Chain, field: str, entry: Any) -> tuple[Array, Array]:
    """The same of one measurement, such as ("joint", 0)."""
    kind = entry[0] if isinstance(entry, tuple) and entry else entry
    if kind in ("joint", "rate") and len(entry) == 2:
        rates = arm.joint_rates(entry[1], f"{field}: link")
        unit, at = np.eye(arm.nv)[rates], [arm.coordinate_of(i) for i in rates]
        if kind == "rate":
            return np.zeros((len(rates), arm.nq)), unit
        if min(at) < 0:
            raise ValueError(f"{field} = {entry!r}: a ball has no angle")
        return np.eye(arm.nq)[at], 0.0 * unit
    if kind == "strain" and len(entry) == 4:
        strain = STRAIN_NAMES.index(choice(f"{field}: strain", entry[3], STRAIN_NAMES))
        # strains are linear in the coordinates (Eq. 28-32)
        row = arm.strain(np.eye(arm.nq), entry[1], number(f"{field}: x", entry[2]))[:, strain]
    elif kind in ("charge", "patch_voltage") and len(entry) == 3:
        row = getattr(arm, kind)(np.eye(arm.nq), entry[1], entry[2])
    else:
        raise ValueError(
            f'{field} = {entry!r}: must be ("joint", link), ("rate", link), ("strain", link, x, "K3"), '
            '("charge", link, patch), ("patch_voltage", link, patch), or a sensor'
        )
    return row[None], np.zeros((1, arm.nv))


def control_laws(
    arm: Chain, control: Any, times: Array, loads: Any = (), prescribed: Sequence[int] = ()
) -> tuple[list[Feedback], list[Sampler], int]:
    """The continuous and sampled laws of all controllers of a run, as the core takes them, and the number of their
    states, by which the arm is extended. `prescribed`: the rates with prescribed motion."""
    all_given = controllers(control)
    total, first = sum(c.memory for c in all_given), 0
    feedback, sampled = [], []
    for k, c in enumerate(all_given):
        columns = c._columns(arm)
        for i in prescribed:
            if any(column[i] != 0.0 for column in columns):
                raise ValueError(f"control[{k}]: acts on '{arm.coordinates[i]}', whose motion is prescribed")
        laws, samplers = c._laws(arm, Run(times, loads, first, total, k, all_given))
        first += c.memory
        nq, nv = arm.nq + total, arm.nv + total
        feedback += [
            Feedback(padded(f.column, nv), padded(f.by_q, nq), padded(f.by_v, nv), f.reference, f.limit) for f in laws
        ]
        sampled += samplers
    return feedback, sampled, total


def padded(x: Array, size: int) -> Array:
    """x with zeros appended, `size` numbers."""
    return np.concatenate([x, np.zeros(size - x.size)]) if x.size < size else x


def extended(arm: Chain, memory: int) -> Chain:
    """The arm, extended by a massless link for each state x of a controller. The rate of its joint is x: with unit
    joint inertia, x' is the force and does not affect the arm. So every integrator integrates x."""
    return arm._alike([*arm.links, *[Link(Prismatic("x", reflected_inertia=1.0))] * memory], arm.gravity)
