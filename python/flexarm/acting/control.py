"""Controllers: what turns measurements into forces of joints and voltages (paper Sec. 5.3, Eq. 97).

Continuous ones are solved together with the arm's equations, in C++, by every integrator. Sampled ones look at the
state at a rate and hold what they answer until the next sample (zero-order hold).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

import flexarm._core as _core

from .._check import Array, array, choice, number
from ..parts.arguments import arguments
from ..parts.beam import STRAIN_NAMES
from ..parts.chain import Chain
from ..parts.joints import Prismatic
from ..parts.link import Link
from .drive import Motion, Torque
from .motor import Motor, finite, positive
from .voltage import is_patch

#: (column, by_q, by_v, reference, limit) and (first, period, delay, law): see flexarm/control.hpp
Feedback = tuple[Array, Array, Array, Any, float]
SampledLaw = tuple[float, float, float, Any]


def listed(name: str, value: Any) -> list[Any]:
    if not isinstance(value, (list, tuple)) or not value:
        raise ValueError(f"{name} = {value!r}: must be a list of at least one entry")
    return list(value)


def limit_of(value: Any, motor: Any = None) -> float:
    """The bound that |u| is kept within: the lower of the limit and the motor's."""
    if motor is not None and not isinstance(motor, Motor):
        raise ValueError(f"motor = {motor!r}: must be a Motor or None")
    limit = np.inf if value is None else positive("limit", value)
    return limit if motor is None or motor.limit is None else min(limit, motor.limit)


def gain_of(motor: Motor | None) -> float:
    """Force per unit of u."""
    return 1.0 if motor is None else motor.gain


def braking_laws(arm: Chain, motor: Motor | None, units: Iterable[Array]) -> list[Feedback]:
    """The laws of a motor's back-EMF, at joints given by unit columns (nv,)."""
    if motor is None or motor.braking == 0.0:
        return []
    return [(unit, np.zeros(arm.nq), motor.braking * unit, None, np.inf) for unit in units]


class Run(NamedTuple):
    """What a controller is told of a run.

    Attributes:
        times, loads: of the run.
        first, total: where the controller's states begin among those of all, and how many there are of all; see
            `extended`.
    """

    times: Array
    loads: Any
    first: int
    total: int


class Controller:
    """What all controllers share: `simulate(control=...)` takes one, or a list of them."""

    #: how many states of its own a continuous law integrates
    memory = 0
    #: what files call it; "": they cannot hold it
    type: ClassVar[str] = ""

    def _arguments(self) -> dict[str, Any]:
        """What a file says of it: the arguments it was made of, which it keeps by their names."""
        made: Any = type(self)
        return {name: getattr(self, name) for name in arguments(made)}

    def _laws(self, arm: Chain, run: Run) -> tuple[list[Feedback], list[SampledLaw]]:
        raise NotImplementedError(f"{type(self).__name__} is no control law: subclass Sampled, or give one a function")

    def _columns(self, arm: Chain) -> list[Array]:
        """Generalised forces (nv,) per unit of each output."""
        return force_columns(arm, self.actuate)  # type: ignore[attr-defined]


class _JointLaw(Controller):
    """u = k_p (r - q) - k_v dq/dt - k_s K at one freedom of a joint."""

    def __init__(
        self, kp: float, kv: float, link: Any, freedom: int | None, reference: Any, limit: Any, motor: Motor | None
    ) -> None:
        self.kp, self.kv = finite("kp", kp), finite("kv", kv)
        if freedom is None and isinstance(link, (tuple, list)):  # a list in a file
            link, freedom = link
        self.link, self.freedom = link, freedom
        if isinstance(reference, Motion):
            raise ValueError("reference: is of q alone: samples (t, r) or a callable t -> r, not a Motion")
        if not isinstance(reference, Torque) and (
            callable(reference) or not isinstance(reference, (list, tuple, np.ndarray))
        ):
            # a law of time like a torque's: samples, a callable, or a number
            reference = Torque(reference if callable(reference) else finite("reference", reference))
        elif not isinstance(reference, Torque):
            try:
                t, r = reference
            except (TypeError, ValueError):
                raise ValueError(
                    f"reference = {reference!r}: must be a number, samples (t, r), or a callable t -> r"
                ) from None
            times = array("reference: t", t)
            reference = Torque(times, array("reference: r", r, times.shape))
        self.reference, self.motor, self.limit = reference, motor, limit_of(limit, motor)

    def _rate(self, arm: Chain) -> int:
        return arm.joint_rate(self.link if self.freedom is None else (self.link, self.freedom), "link")

    def _columns(self, arm: Chain) -> list[Array]:
        return [np.eye(arm.nv)[self._rate(arm)]]

    def _strain(self, arm: Chain) -> Array:
        return np.zeros(arm.nq)

    def _laws(self, arm: Chain, run: Run) -> tuple[list[Feedback], list[SampledLaw]]:
        i = self._rate(arm)
        at = arm.coordinate_of(i)
        if at < 0:
            raise ValueError(
                f"control of '{arm.coordinates[i]}': a ball has no angle to control; use three rotations (Axes)"
            )
        self.reference.check_span("reference", run.times)
        unit, by_q = np.eye(arm.nv)[i], self._strain(arm)
        by_q[at] += self.kp
        law = (gain_of(self.motor) * unit, by_q, self.kv * unit, _scaled(self.reference.law, self.kp), self.limit)
        return [law, *braking_laws(arm, self.motor, [unit])], []


def _scaled(law: Any, factor: float) -> Any:
    if isinstance(law, _core.PiecewisePolynomial):
        return _core.PiecewisePolynomial(law.breaks, factor * law.coefficients)
    return lambda t: factor * array(f"reference at t = {t}", law(t), ()).item()


class PD(_JointLaw):
    """u = k_p (reference - q) - k_v dq/dt of one joint, continuous.

    Args:
        kp, kv: gains, per rad (m) and per rad/s (m/s); of a torque (N m, N), or of the motor's current or voltage.
        link, freedom: which joint (-1 is the last), and which of its freedoms, where it has several; or
            link = (link, freedom).
        reference: of q (rad, m): a number, samples (t, r) with straight lines between, or a callable t -> r.
        limit: u is kept within -limit .. limit; None: the motor's.
        motor: turns u into a torque; None: u is the torque.
    """

    type = "pd"

    def __init__(
        self, kp: float, kv: float, link: Any = -1, freedom: int | None = None, *, reference: Any = 0.0,
        limit: float | None = None, motor: Motor | None = None,
    ) -> None:  # fmt: skip
        super().__init__(kp, kv, link, freedom, reference, limit, motor)


class StrainFeedback(_JointLaw):
    """Eq. 97: u = k_p (reference - q) - k_v dq/dt - k_s K, with K a beam's curvature where a strain gauge sits.

    Args:
        kp, kv, link, freedom, reference, limit, motor: as of PD.
        ks: gain per 1/m.
        x: where the gauge is on the beam (m).
        strain: which strain, as `Arm.strain` orders them: "K1", "K2", "K3", "phi12", "phi13" or
            "eps".
        beam: the link whose beam bears the gauge; None: the controlled joint's own.
    """

    type = "strain_feedback"

    def __init__(
        self, kp: float, kv: float, ks: float, link: Any = -1, freedom: int | None = None, *, x: float = 0.0,
        strain: str = "K3", beam: int | str | None = None, reference: Any = 0.0, limit: float | None = None,
        motor: Motor | None = None,
    ) -> None:  # fmt: skip
        super().__init__(kp, kv, link, freedom, reference, limit, motor)
        self.ks, self.x, self.beam = finite("ks", ks), finite("x", x), beam
        self.strain = choice("strain", strain, STRAIN_NAMES)

    def _strain(self, arm: Chain) -> Array:
        beam = self.link if self.beam is None else self.beam
        row: Array = self.ks * measured_rows(arm, [("strain", beam, self.x, self.strain)])[0][0]
        return row


class StateFeedback(Controller):
    """u = u0 - K [q - q0; v - v0], continuous, with K from a design on `Arm.linearize` (LQR, pole placement).

    Args:
        K: gains (nu, 2 nv): by all coordinates, then by all rates, in the order of LinearModel.states of a model that
            locks nothing. For arms without balls.
        actuate: nu links (-1 is the last), (link, freedom), ("patch", link, patch), or columns (nv,) of generalised
            forces per unit of u.
        q0, v0, u0: the state about which, and the forces there; None: zero.
        limit: of each |u|; None: none.
    """

    type = "state_feedback"

    def __init__(
        self, K: ArrayLike, actuate: Sequence[Any] = (-1,), *, q0: ArrayLike | None = None, v0: ArrayLike | None = None,
        u0: ArrayLike | None = None, limit: float | None = None,
    ) -> None:  # fmt: skip
        self.K, self.actuate = np.atleast_2d(array("K", K)), listed("actuate", actuate)
        self.q0, self.v0, self.u0, self.limit = q0, v0, u0, limit_of(limit)

    def _laws(self, arm: Chain, run: Run) -> tuple[list[Feedback], list[SampledLaw]]:
        if arm.nq != arm.nv:
            raise ValueError(
                "StateFeedback: is for arms without balls, whose coordinates are not those of a linear model"
            )
        columns = force_columns(arm, self.actuate)
        K = array("K", self.K, (len(columns), 2 * arm.nv))
        q0 = np.zeros(arm.nq) if self.q0 is None else array("q0", self.q0, (arm.nq,))
        v0 = np.zeros(arm.nv) if self.v0 is None else array("v0", self.v0, (arm.nv,))
        u0 = np.zeros(len(columns)) if self.u0 is None else array("u0", self.u0, (len(columns),))
        offset = u0 + K @ np.concatenate([q0, v0])
        laws = [
            (c, k[: arm.nq], k[arm.nq :], Torque(float(u)).law, self.limit)
            for c, k, u in zip(columns, K, offset, strict=True)
        ]
        return laws, []


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


def measured_rows(arm: Chain, measure: Sequence[Any], first: int = 0) -> tuple[Array, Array]:
    """by_q (ny, nq) and by_v (ny, nv) of measurements that are linear in the state: "joint", "rate", "strain"."""
    by_q, by_v = [], []
    for k, entry in enumerate(measure, first):
        field = f"measure[{k}]"
        kind = entry[0] if isinstance(entry, tuple) and entry else entry
        if kind in ("joint", "rate") and len(entry) == 2:
            for i in arm.joint_rates(entry[1], f"{field}: link"):
                at = arm.coordinate_of(i)
                if kind == "joint" and at < 0:
                    raise ValueError(f"{field} = {entry!r}: a ball has no angle")
                by_q.append(np.eye(arm.nq)[at] if kind == "joint" else np.zeros(arm.nq))
                by_v.append(np.eye(arm.nv)[i] if kind == "rate" else np.zeros(arm.nv))
        elif kind == "strain" and len(entry) == 4:
            strain = STRAIN_NAMES.index(choice(f"{field}: strain", entry[3], STRAIN_NAMES))
            # strains are linear in the coordinates (Eq. 28-32)
            by_q.append(arm.strain(np.eye(arm.nq), entry[1], number(f"{field}: x", entry[2]))[:, strain])
            by_v.append(np.zeros(arm.nv))
        elif kind in ("charge", "patch_voltage") and len(entry) == 3:
            by_q.append(getattr(arm, kind)(np.eye(arm.nq), entry[1], entry[2]))
            by_v.append(np.zeros(arm.nv))
        else:
            raise ValueError(
                f'{field} = {entry!r}: must be ("joint", link), ("rate", link), ("strain", link, x, "K3"), '
                '("charge", link, patch), ("patch_voltage", link, patch), or a sensor'
            )
    return np.array(by_q).reshape(-1, arm.nq), np.array(by_v).reshape(-1, arm.nv)


def control_laws(
    arm: Chain, control: Any, times: Array, loads: Any = (), prescribed: Sequence[int] = ()
) -> tuple[list[Feedback], list[SampledLaw], int]:
    """The laws of all controllers of a run as the core takes them, continuous and sampled, and how many states of
    theirs the arm is to be extended by. `prescribed`: the rates whose motion is given."""
    all_given = [] if control is None else [control] if isinstance(control, Controller) else control
    if not isinstance(all_given, (list, tuple)) or not all(isinstance(c, Controller) for c in all_given):
        raise ValueError(f"control = {control!r}: must be a controller, such as PD(...), or a list of them")
    total, first = sum(c.memory for c in all_given), 0
    feedback, sampled = [], []
    for k, c in enumerate(all_given):
        columns = c._columns(arm)
        for i in prescribed:
            if any(column[i] != 0.0 for column in columns):
                raise ValueError(f"control[{k}]: acts on '{arm.coordinates[i]}', whose motion is prescribed")
        laws, samplers = c._laws(arm, Run(times, loads, first, total))
        first += c.memory
        nq, nv = arm.nq + total, arm.nv + total
        feedback += [(padded(c, nv), padded(by_q, nq), padded(by_v, nv), *rest) for c, by_q, by_v, *rest in laws]
        sampled += samplers
    return feedback, sampled, total


def padded(x: Array, size: int) -> Array:
    """x with zeros behind, `size` numbers."""
    return np.concatenate([x, np.zeros(size - x.size)])


def extended(arm: Chain, memory: int) -> Chain:
    """The arm with a link without bodies for each state of a controller, whose rate is that state: on a joint with unit
    inertia of its own, x' is the force, and nothing else of the arm feels it. So every integrator integrates x."""
    return arm._made([*arm.links, *[Link(Prismatic("x", reflected_inertia=1.0))] * memory], arm.gravity)
