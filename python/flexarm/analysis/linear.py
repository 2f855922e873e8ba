"""Exact derivatives of the dynamics, and linear models between chosen inputs and outputs."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._check import Array, array, choice, finite, number
from .._console import aligned
from ..model.acting.load import Load, at_time
from ..model.parts.beam import STRAIN_NAMES
from ..model.parts.chain import Chain
from .assembly import Closure, closed_start
from .closed import Reduced, Slopes, reduced, slopes, turning
from .equilibrium import warn_unless_at_rest
from .rates import elastic_rates, locked_rates

_SHOWN = 16  # labels of a kind, and eigenvalues, that are printed
_BEFORE = 100.0  # times their mass's root, by which elastic coordinates come before joints as states
INPUTS = ("force", "acceleration", "load", "patch", "strut")
OUTPUTS = (
    *("joint", "rate", "tip", "velocity", "acceleration", "accelerometer", "strain"),
    *("charge", "patch_voltage"),
)


class Derivatives(NamedTuple):
    """Jacobians of a = M^-1 (tau - h): da/dq (nv, nq), da/dv and da/dtau = M^-1 (nv, nv)."""

    dq: Array
    dv: Array
    dtau: Array


def solve_mass(M: Array, right: Array) -> Array:
    """M^-1 right by Cholesky, M scaled to a unit diagonal."""
    import scipy.linalg as la  # slow to import

    d = 1.0 / np.sqrt(np.diag(M))
    try:
        out: Array = d[:, None] * la.cho_solve(la.cho_factor(d[:, None] * M * d), d[:, None] * right)
    except la.LinAlgError:
        raise ValueError("q: the mass matrix is singular in double precision; no acceleration follows") from None
    return out


def forward_derivatives(
    arm: Chain,
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike | None = None,
    *,
    loads: Sequence[Load] | None = None,
    t: float = 0.0,
) -> Derivatives:
    """Exact da/dq (..., nv, nq), da/dv and da/dtau (..., nv, nv) of `forward_dynamics`, as `.dq`, `.dv` and
    `.dtau`.

    From those of inverse dynamics at the acceleration a: da/dq = -M^-1 dtau/dq, da/dv = -M^-1 dtau/dv, with M^-1
    by the articulated-body method's factors (Eq. 92-96). O(N^2). Columns of a ball's quaternion do not depend on
    its length.

    Args:
        q: (..., nq). v, tau: (..., nv); tau is zero if None.
        loads, t: external forces and moments, with their values at time t (s).

    Raises:
        ValueError: bad shapes or values, or a singular mass matrix.
    """
    q, v, tau = arm._batch(q=q, v=v, tau=np.zeros(arm.nv) if tau is None else tau)
    found = arm._core.forward_derivatives(q, v, tau, *at_time(arm, loads, t))
    return Derivatives(*(finite("forward derivatives", x) for x in found))


@dataclass(frozen=True)
class LinearModel:
    """Small deviations from a state: dx/dt = A x + B u, y = C x + D u.

    The state x stacks the deviations of the coordinates, then those of the rates v; locked joints are left out of both.
    The deviation of a ball is a small turn in its link's axes (rad), so that both halves have one entry a rate. Of an
    arm with rigid loops, the states are coordinates that the others follow, as many as it has freedoms.

    Attributes:
        A, B, C, D: (nx, nx), (nx, nu), (ny, nx), (ny, nu).
        states, inputs, outputs: labels.
        q, v, a, tau: the state about which, its accelerations and forces, (nq,) and (nv,). Unless v and a are zero (or
            it is a steady spin) that state moves on, and the model holds for a short while.
        y: the outputs there, (ny,); zero for the turn of a ball.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    q: Array
    v: Array
    a: Array
    tau: Array
    y: Array

    def __str__(self) -> str:
        """Its size, its inputs and outputs, and its eigenvalues."""
        s = self.eigenvalues
        counts = f"{len(s)} states, {len(self.inputs)} inputs, {len(self.outputs)} outputs"
        lines = [f"dx/dt = A x + B u, y = C x + D u: {counts}"]
        for kind in ("states", "inputs", "outputs"):
            labels = getattr(self, kind)
            more = f", and {len(labels) - _SHOWN} more" if len(labels) > _SHOWN else ""
            lines.append(f"{kind:<8} {', '.join(labels[:_SHOWN]) or 'none'}{more}")
        upper = s[s.imag >= 0]
        upper = upper[np.argsort(np.abs(upper), kind="stable")]
        rows = [["eigenvalue (1/s)", "size (rad/s)", "Hz", "damping ratio"]]
        for x in upper[:_SHOWN]:
            size = float(np.abs(x))
            text = f"{x.real + 0.0:.4g}" + (f" +- {x.imag:.4g}i" if x.imag else "")
            rows.append([text, f"{size:.4g}", f"{size / (2 * np.pi):.4g}", f"{-x.real / size:.4g}" if size else "-"])
        rest = len(upper) - _SHOWN
        more = f"... and {rest} more eigenvalues, which are faster"
        return "\n".join([*lines, "", *aligned(rows, range(1, 4)), *([more] * (rest > 0))])

    @property
    def eigenvalues(self) -> NDArray[np.complex128]:
        """Of A (1/s), (nx,)."""
        return np.asarray(np.linalg.eigvals(self.A), dtype=complex)

    def to_control(self) -> Any:
        """The same as a control.StateSpace (package python-control), with these labels.

        Raises:
            ImportError: python-control is missing.
        """
        return state_space(self, "states", "inputs", "outputs")


def state_space(model: Any, *labels: str, period: float = 0.0) -> Any:
    """A, B, C and D of a model, with these labels, as a control.StateSpace."""
    try:
        import control
    except ImportError as e:
        raise ImportError("to_control needs python-control: pip install flexarm[control]") from e
    names = {kind: [x.replace(".", "_") for x in getattr(model, kind)] for kind in labels}  # dots are for subsystems
    return control.ss(model.A, model.B, model.C, model.D, period, **names)


@dataclass
class _Point:
    """The state about which, and da = X [theta; v; u]."""

    arm: Chain
    q: Array
    v: Array
    a: Array
    E: Array
    X: Array
    M: Array
    K: Array  # dtau/d theta

    def rows(self, theta: Any, v: Any, a: Array | None = None) -> Array:
        """The rows of an output whose derivatives by coordinates, rates and accelerations are given (zero: None)."""
        nv = self.arm.nv
        out = np.zeros((len(v if theta is None else theta), self.X.shape[1]))
        if theta is not None:
            out[:, :nv] += theta
        if v is not None:
            out[:, nv : 2 * nv] += v
        return out if a is None else out + a @ self.X


class _Output(NamedTuple):
    labels: list[str]
    y: Array
    rows: Array


def _where(entry: tuple[Any, ...], i: int) -> Any:
    return entry[i] if len(entry) > i else None


def _need(field: str, entry: Any, most: int, usage: str, least: int = 2) -> None:
    if not least <= len(entry) <= most:
        raise ValueError(f"{field} = {entry!r}: must be {usage}")


def _joint_output(p: _Point, field: str, entry: tuple[Any, ...]) -> _Output:
    _need(field, entry, 2, f'("{entry[0]}", link) or ("{entry[0]}", (link, freedom))')
    rates = p.arm.joint_rates(entry[1], f"{field}: link")
    labels = [f"{entry[0]} {p.arm.coordinates[i]}" for i in rates]
    unit = np.eye(p.arm.nv)[rates]
    if entry[0] == "rate":
        return _Output(labels, p.v[rates], p.rows(None, unit))
    at = [p.arm.coordinate_of(i) for i in rates]
    return _Output(labels, np.array([p.q[k] if k >= 0 else 0.0 for k in at]), p.rows(unit, None))


def _slice_name(arm: Chain, field: str, link: Any, x: Any) -> tuple[int, float | None, str]:
    n = arm._link(link, f"{field}: link")
    if x is None:
        return n, None, arm.names[n]
    at = number(f"{field}: x", x)
    return n, at, f"{arm.names[n]} at {at:g} m"


def _tip_output(p: _Point, field: str, entry: tuple[Any, ...]) -> _Output:
    _need(field, entry, 3, '("tip", link) or ("tip", link, x)')
    n, x, name = _slice_name(p.arm, field, entry[1], _where(entry, 2))
    labels = [f"tip {name} {axis}" for axis in "xyz"]
    return _Output(labels, p.arm.frame(p.q, n, x)[0], p.rows(p.arm.jacobian(p.q, n, x)[:3], None))


def _motion_output(p: _Point, field: str, entry: tuple[Any, ...]) -> _Output:
    kind = entry[0]
    _need(field, entry, 3, f'("{kind}", link) or ("{kind}", link, x)')
    n, x, name = _slice_name(p.arm, field, entry[1], _where(entry, 2))
    labels = [f"{kind} {name} {axis}" for axis in "xyz"]
    J = p.arm.jacobian(p.q, n, x)
    by_q, by_v = p.arm._core.motion_derivatives(p.q, p.v, p.a, n, x)  # of [velocity; acceleration], six rows each
    if kind == "velocity":
        return _Output(labels, p.arm.velocity(p.q, p.v, n, x)[:3], p.rows(by_q[:3] @ p.E, by_v[:3]))
    a = p.arm.acceleration(p.q, p.v, p.a, n, x)[:3]
    rows = p.rows(by_q[6:9] @ p.E, by_v[6:9], J[:3])
    if kind == "acceleration":
        return _Output(labels, a, rows)
    # accelerometer, f = R^T (a - g): with dR = (J_R theta)~ R, df = R^T (da + (a - g) x J_R theta)
    R, f = p.arm.frame(p.q, n, x)[1], a - np.array(p.arm.gravity)
    rows += p.rows(np.cross(f, J[3:].T).T, None)
    return _Output(labels, R.T @ f, R.T @ rows)


def _strain_output(p: _Point, field: str, entry: tuple[Any, ...]) -> _Output:
    _need(field, entry, 4, '("strain", link, x) or ("strain", link, x, "K3")', least=3)
    n, x = p.arm._link(entry[1], f"{field}: link"), number(f"{field}: x", entry[2])
    wanted = list(STRAIN_NAMES) if len(entry) == 3 else [choice(f"{field}: strain", entry[3], STRAIN_NAMES)]
    keep = [STRAIN_NAMES.index(s) for s in wanted]
    rows = p.arm.strain(np.eye(p.arm.nq), n, x).T[keep] @ p.E  # strains are linear in the coordinates (Eq. 28-32)
    labels = [f"strain {p.arm.names[n]} at {x:g} m {s}" for s in wanted]
    return _Output(labels, p.arm.strain(p.q, n, x)[keep], p.rows(rows, None))


def _patch_name(arm: Chain, column: int) -> str:
    link, patch = arm.patches[column]
    return f"{arm.names[link]} patch {patch}"


def _patch_output(p: _Point, field: str, entry: tuple[Any, ...]) -> _Output:
    _need(field, entry, 3, f'("{entry[0]}", link, patch)', least=3)
    n = p.arm._link(entry[1], f"{field}: link")
    column = p.arm.patch_column(n, entry[2], f"{field}: ")
    row = p.arm.patch_matrix[:, column][None]
    if entry[0] == "patch_voltage":
        row = -row / p.arm.capacitance(n, entry[2])
    y = row @ (p.E.T @ p.q)  # E is the identity on elastic coordinates
    return _Output([f"{entry[0]} {_patch_name(p.arm, column)}"], y, p.rows(row, None))


_OUTPUT: dict[str, Callable[[_Point, str, tuple[Any, ...]], _Output]] = {
    "joint": _joint_output,
    "rate": _joint_output,
    "tip": _tip_output,
    "velocity": _motion_output,
    "acceleration": _motion_output,
    "accelerometer": _motion_output,
    "strain": _strain_output,
    "charge": _patch_output,
    "patch_voltage": _patch_output,
}


class _Input(NamedTuple):
    label: str
    force: Array  #: generalised force per unit, (nv,)
    rate: int = -1  #: the rate whose acceleration it is, or -1


def _read_inputs(arm: Chain, q: Array, inputs: Sequence[Any] | None, locked: NDArray[np.bool_]) -> list[_Input]:
    if inputs is None:
            inputs = [(k, j) for k in arm.movable for j, i in enumerate(arm.joint_rates(k)) if not locked[i]]
    out: list[_Input] = []
    for k, given in enumerate(_listed("inputs", inputs)):
        field = f"inputs[{k}]"
        named = given[0] if isinstance(given, tuple) and given else None  # a kind, or, in (link, freedom), a link
        entry = given if isinstance(named, str) and named not in arm._numbers else ("force", given)
        kind = choice(field, entry[0], INPUTS)
        if kind == "load":
            _need(field, entry, 3, '("load", link) or ("load", link, x)')
            n, x, name = _slice_name(arm, field, entry[1], _where(entry, 2))
            J = arm.jacobian(q, n, x)
            out += [_Input(f"load {name} {axis}", J[i]) for i, axis in enumerate("xyz")]
            continue
        if kind == "strut":
            _need(field, entry, 2, '("strut", strut)')
            s = arm._strut(entry[1], f"{field}: strut")
            out.append(_Input(f"strut {arm.strut_names[s]}", arm.struts[s].sense * arm.strut_jacobian(q)[s]))
            continue
        if kind == "patch":
            _need(field, entry, 3, '("patch", link, patch)', least=3)
            column = arm.patch_column(entry[1], _where(entry, 2), f"{field}: ")
            out.append(_Input("patch " + _patch_name(arm, column), arm.patch_matrix[:, column]))
            continue
        _need(field, entry, 2, f'a link, (link, freedom), or ("{kind}", link)')
        for i in arm.joint_rates(entry[1], f"{field}: link"):
            if locked[i]:
                raise ValueError(f"{field} = {given!r}: that joint is locked")
            label = f"{kind} {arm.coordinates[i]}"
            unit = np.eye(arm.nv)[i]
            out.append(_Input(label, unit) if kind == "force" else _Input(label, 0.0 * unit, i))
    driven = [i.label for i in out]
    for label in driven:
        if driven.count(label) > 1:
            raise ValueError(f"inputs: '{label}' is named twice")
    return out


def _listed(field: str, entries: Any) -> Sequence[Any]:
    if not isinstance(entries, (list, tuple)):
        raise ValueError(f"{field} = {entries!r}: must be a list")
    return entries


def _read_outputs(p: _Point, outputs: Sequence[Any]) -> list[_Output]:
    out = []
    for k, entry in enumerate(_listed("outputs", outputs)):
        field = f"outputs[{k}]"
        if not isinstance(entry, tuple) or not entry:
            raise ValueError(f'{field} = {entry!r}: must be a tuple such as ("tip", 0)')
        out.append(_OUTPUT[choice(field, entry[0], OUTPUTS)](p, field, entry))
    return out


def _check_balls(arm: Chain, fixed: NDArray[np.bool_], field: str) -> None:
    for k, rates in arm.ball_rates():
        if fixed[rates].any() and not fixed[rates].all():
            raise ValueError(f"{field}: the three rotations of the ball of {arm.joint_names[k]} go together")


def _about(
    arm: Chain, q: Array, v: Array, a: Array, columns: list[_Input], free: NDArray[np.bool_], loads: Any,
    by: Slopes | None = None,
) -> _Point:  # fmt: skip
    """X from M_ff a_f + M_fg a_g + h_f = tau_f, f the free and g the given accelerations; of an arm with loops `by`."""
    nv = arm.nv
    by_q, by_v = (finite("inverse derivatives", x) for x in arm._core.inverse_derivatives(q, v, a, *loads))
    E = arm._core.rates(q, v)[2]
    M = arm.mass_matrix(q)
    K = by_q @ E
    if by is not None:
        pushes = [by.tau[:, i.rate] if i.rate >= 0 else by.tau[:, free] @ i.force[free] for i in columns]
        return _Point(arm, q, v, a, E, np.hstack([by.q, by.v, *(x[:, None] for x in pushes)]), M, K)
    right = np.hstack([-K, -by_v, *(i.force[:, None] for i in columns)])
    X = np.zeros((nv, 2 * nv + len(columns)))
    for k, column in enumerate(columns):
        if column.rate >= 0:
            right[:, 2 * nv + k] -= M[:, column.rate]
            X[column.rate, 2 * nv + k] = 1.0
    X[free] = solve_mass(M[np.ix_(free, free)], right[free])
    return _Point(arm, q, v, a, E, X, M, K)


def forces_of(
    arm: Chain, q: Array, inputs: Sequence[Any] | None, locked: NDArray[np.bool_]
) -> tuple[tuple[str, ...], Array]:
    """Labels of inputs, and the generalised forces of a unit of each, (nv, nu). ValueError for an acceleration."""
    columns = _read_inputs(arm, q, inputs, locked)
    for column in columns:
        if column.rate >= 0:
            raise ValueError(f"inputs: '{column.label}' would be prescribed; lock that joint, and drive another")
    return tuple(c.label for c in columns), np.array([c.force for c in columns]).reshape(-1, arm.nv).T


def rows_of(
    arm: Chain, q: Array, v: Array, E: Array, outputs: Sequence[Any] | None
) -> tuple[tuple[str, ...], Array]:  # fmt: skip
    """Labels of outputs, and their derivatives by small displacements of the rates, rates and accelerations, about a
    state without acceleration, (ny, 3 nv)."""
    nv = arm.nv
    X = np.hstack([np.zeros((nv, 2 * nv)), np.eye(nv)])
    point = _Point(arm, q, v, np.zeros(nv), E, X, np.eye(nv), np.zeros((nv, nv)))
    read = _read_outputs(point, _joints(arm) if outputs is None else outputs)
    return tuple(label for o in read for label in o.labels), np.vstack([np.zeros((0, 3 * nv)), *(o.rows for o in read)])


def _joints(arm: Chain) -> list[Any]:
    """The outputs that are meant where none is named."""
    return [("joint", k) for k in arm.movable]


def linearize(
    arm: Chain,
    q: ArrayLike,
    v: ArrayLike | None = None,
    inputs: Sequence[Any] | None = None,
    outputs: Sequence[Any] | None = None,
    *,
    tau: ArrayLike | None = None,
    lock: Iterable[Any] | None = None,
    loads: Sequence[Load] | None = None,
    t: float = 0.0,
) -> LinearModel:
    """Linear model about a state, by exact Jacobians.

    Args:
        q, v: the state, (nq,) and (nv,); v is zero if None.
        inputs: the inputs; None: the forces of all joints that are not locked. Each is
            a link, or (link, freedom): the force (torque) of its joint;
            ("acceleration", link) or ("acceleration", (link, freedom)): its acceleration, prescribed;
            ("load", link) or ("load", link, x): a force on the link's end or a slice, three world components (N);
            ("strut", strut): a driven force of a strut, or tension of a tendon (N), by name or number;
            ("patch", link, patch): a piezo patch's voltage (V).
        outputs: the measurements; None: the coordinates of all joints. Each is
            ("joint", link), ("rate", link): coordinates and rates, link or (link, freedom);
            ("tip", link) or ("tip", link, x): position of the link's end or a slice, world axes (m);
            ("velocity", link), ("acceleration", link), or with x: of the same, world axes;
            ("accelerometer", link), or with x: reading R^T (a - g) of one there, in its own axes (m/s^2);
            ("strain", link, x) or ("strain", link, x, "K3"): all strains, or one (1/m, rad; Eq. 18-21);
            ("charge", link, patch), ("patch_voltage", link, patch): of a piezo patch (C, V).
        tau: generalised forces there, (nv,); zero if None. `bias(q, 0)` holds the arm at rest.
        lock: links, or (link, freedom), whose joints keep their rates exactly; they are not states. With rigid
            loops, which must be closed at q, states are coordinates that the others follow.
        loads, t: external forces and moments, with their values at time t (s).

    Returns:
        LinearModel: `.A`, `.B`, `.C`, `.D`, labels, the outputs `.y` at the state, and `.to_control()`.

    Raises:
        ValueError: bad arguments, naming the entry.

    Warns:
        StateWarning: v is zero, but the arm is not in equilibrium (it falls, or sags): the model is valid for a
            moment only.
    """
    nv, zero = arm.nv, np.zeros(arm.nv)
    (q0,), acting = arm._single(q=q), at_time(arm, loads, t)
    v0 = zero if v is None else array("v", v, (nv,))
    locked = locked_rates(arm, lock)
    _check_balls(arm, locked, "lock")
    columns = _read_inputs(arm, q0, inputs, locked)
    given = locked.copy()
    given[[i.rate for i in columns if i.rate >= 0]] = True
    _check_balls(arm, given, "inputs")
    forces = zero if tau is None else array("tau", tau, (nv,))
    by: Slopes | None = None
    if arm.constrained:
        closed_start(arm, q0, v0, (True, True), names=("q", "v"))
        by = slopes(arm, q0, v0, forces, given, acting)
        a0 = by.a
    else:
        still = {int(i): 0.0 for i in np.flatnonzero(given)}
        a0 = arm._core.forward_dynamics(q0, v0, forces, "ab", still, *acting)

    point = _about(arm, q0, v0, a0, columns, ~given, acting, by)
    read = _read_outputs(point, _joints(arm) if outputs is None else outputs)
    if not v0.any():
        left = np.where(given, 0.0, point.M @ a0)
        warn_unless_at_rest(arm, (point.M, point.K, point.E.T @ q0), left, forces)
    turns = np.hstack([-turning(arm, v0), np.eye(nv), np.zeros((nv, len(columns)))])
    Y = np.vstack([np.zeros((0, point.X.shape[1])), *(o.rows for o in read)])
    F, u, names = np.vstack([turns, point.X]), slice(2 * nv, None), np.array(arm.coordinates)
    if by is not None:
        own, S = _independent(arm, reduced(arm, Closure(arm), q0, v0, by.forces, ~locked, acting))
    else:
        own = np.flatnonzero(~locked)
        S = np.eye(2 * nv)[:, np.concatenate([own, own + nv])]
        reaction = arm._core.inverse_dynamics(q0, v0, a0, *acting)
    keep = np.concatenate([own, own + nv])
    A, B, C = F[keep, : 2 * nv] @ S, F[keep, u], Y[:, : 2 * nv] @ S
    return LinearModel(
        *(A, B, C, Y[:, u], (*map(str, names[own]), *(f"rate {c}" for c in names[own]))),
        *(tuple(i.label for i in columns), tuple(label for o in read for label in o.labels)),
        *(q0, v0, a0, np.where(given, reaction, forces) if by is None else by.forces),
        y=np.concatenate([np.zeros(0), *(o.y for o in read)]),
    )


def _independent(arm: Chain, r: Reduced) -> tuple[NDArray[np.int_], Array]:
    """Coordinates that the others of an arm with loops follow, elastic ones before joints: their rates; and [theta; v]
    by them and their rates, (2 nv, 2 n), along motions that the loops let be."""
    import scipy.linalg as la  # slow to import

    n, size = r.T.shape[1], np.sqrt(r.M.diagonal())
    if not n:
        raise ValueError("lock: no motion is left")
    size[elastic_rates(arm)] *= _BEFORE
    own = np.sort(la.qr(r.T.T * size, pivoting=True, mode="r")[1][:n])
    inverse = np.linalg.inv(r.T[own])
    z = np.hstack([inverse, np.zeros((n, n))])
    w = np.hstack([-inverse @ r.N[own] @ inverse, inverse])
    return own, np.vstack([r.T @ z, r.T @ w + r.N @ z])
