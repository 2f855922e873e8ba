"""The fastest motion of a flexible arm by direct collocation: the motion of all coordinates is unknown.

Coordinates, rates and accelerations stand at the knots and midway between them. Accelerations are quadratic from knot
to knot (those of the joints linear), which is of fourth order: the Hermite-Simpson rule for second-order systems
(Hargraves and Paris, J. Guidance 10 (1987), 338-342; M. Kelly, SIAM Review 59 (2017), 849-904). At all these places
(Hargraves and Paris, J. Guidance 10 (1987), 338-342; M. Kelly, SIAM Review 59 (2017), 849-904). At all these places
the inverse dynamics must give zero forces on the elastic coordinates; its forces on the joints are their torques. Time
runs Programming 106 (2006), 25-57), as CasADi brings it, gets exact sparse Jacobians from the arm's.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..._check import Array
from ...run.result import Result
from .move_limits import Indices, Limits
from .plant import Plant

_SMOOTH = 1e-4  # weight of the mean squared change of the joints' accelerations from knot to knot beside the duration
_TOLERANCE, _ITERATIONS = 1e-6, 200
_ACCEPTABLE = 1e-3  # IPOPT's tolerance, and change of the objective, for an end after eight such rounds
_RANGE = (0.3, 1.05)  # of the duration, in parts of the first; a wider range leads the search far away


class Collocated(NamedTuple):
    """Attributes: duration (s). alpha: d²q/d(t/duration)² of the joints at the knots, (N + 1, nj). iterations.
    converged. status: IPOPT's message at its end."""

    duration: float
    alpha: Array
    iterations: int
    converged: bool
    status: str


def collocate(plant: Plant, limits: Limits, first: Result) -> Collocated:
    """The motion of least duration from rest to rest within the limits.

    Args:
        first: the initial motion, rows at the knots and midway between them, evenly spaced in time.

    Raises:
        ImportError: CasADi is not installed.
    """
    ca = casadi()
    d, n, P = plant.driven, plant.arm.nv, len(first.t)
    knots = P // 2
    T0 = float(first.t[-1])
    order = np.array([plant.arm.coordinate_of(i) for i in range(n)])
    guess = [first.q[:, order].T, T0 * first.v.T, T0**2 * first.a.T]
    scale = [_sizes(x) for x in (guess[0] - guess[0][:, :1], guess[1], guess[2])]
    y = [ca.MX.sym(name, n, P) for name in ("q", "u", "w")]
    T = ca.MX.sym("T")
    q, u, w = (ca.DM(s) * x for s, x in zip(scale, y, strict=True))
    q = q + ca.DM(guess[0][:, :1])
    forces = _forces(ca, plant, P)
    tau = forces(q, u / T, w / T**2)
    mass = np.abs(plant.arm.mass_matrix(plant.q_end)) @ (scale[2][:, 0] / T0**2)

    rows, low, high = [], [], []

    def add(row: Any, bottom: float, top: float) -> None:
        rows.append(ca.vec(row))
        low.append(np.full(row.numel(), bottom))
        high.append(np.full(row.numel(), top))

    for row in _rules(q, u, w, knots, scale, d.rates):
        add(row, 0.0, 0.0)
    if d.elastic.size:
        add(tau[d.elastic.tolist(), :] / ca.DM(mass[d.elastic]), 0.0, 0.0)
    for k, j in enumerate(d.rates.tolist()):
        jumps = (w[j, 2::2] - w[j, :-2:2]) * knots
        for value, most in (
            (tau[j, :], limits.torque[k]), (u[j, 1:-1] / T, limits.speed[k]),
            (w[j, 2:-2:2] / T**2, limits.acceleration[k]), (jumps / T**3, limits.jerk[k]),
        ):  # fmt: skip
            if np.isfinite(most):
                add(value / most, -1.0, 1.0)
    jumps = (y[2][d.rates.tolist(), 2::2] - y[2][d.rates.tolist(), :-2:2]) ** 2
    goal = T / T0 + _SMOOTH * ca.sum1(ca.sum2(jumps)) / len(d.rates)

    lowest, highest = _bounds(plant, limits, guess[0], scale, P)
    x0 = np.concatenate([*((g / s).ravel(order="F") for g, s in zip(_from(guess), scale, strict=True)), [T0]])
    lowest, highest = np.append(lowest, _RANGE[0] * T0), np.append(highest, _RANGE[1] * T0)
    problem = {"x": ca.vertcat(*map(ca.vec, y), T), "f": goal, "g": ca.vertcat(*rows)}
    how = {
        "print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.tol": _TOLERANCE,
        "ipopt.hessian_approximation": "limited-memory", "ipopt.limited_memory_max_history": 30,
        "ipopt.max_iter": _ITERATIONS, "ipopt.mu_strategy": "monotone", "ipopt.mu_init": 1e-3,
        "ipopt.bound_push": 1e-4, "ipopt.bound_frac": 1e-4,  # the first motion is near the optimum
        "ipopt.acceptable_tol": _ACCEPTABLE, "ipopt.acceptable_constr_viol_tol": _TOLERANCE,
        "ipopt.acceptable_obj_change_tol": _ACCEPTABLE, "ipopt.acceptable_iter": 8,
        "error_on_fail": False,
    }  # fmt: skip
    solver = ca.nlpsol("collocation", "ipopt", problem, how)
    found = solver(x0=x0, lbx=lowest, ubx=highest, lbg=np.concatenate(low), ubg=np.concatenate(high))
    x, stats = np.asarray(found["x"])[:, 0], solver.stats()
    alpha = scale[2][d.rates] * x[2 * n * P : 3 * n * P].reshape(n, P, order="F")[d.rates]
    return Collocated(float(x[-1]), alpha[:, ::2].T, int(stats["iter_count"]), bool(stats["success"]),
                      str(stats["return_status"]))  # fmt: skip


def casadi() -> Any:
    try:
        import casadi
    except ImportError:
        raise ImportError('plan_move: method="collocation" needs CasADi: pip install \'flexarm[optimize]\'') from None
    return casadi


def _sizes(x: Array) -> Array:
    """Sizes of the rows, (n, 1); none much smaller than the largest."""
    most = np.abs(x).max(axis=1, keepdims=True)
    return np.asarray(np.maximum(most, 1e-4 * most.max()))


def _from(guess: list[Array]) -> list[Array]:
    return [guess[0] - guess[0][:, :1], guess[1], guess[2]]


def _rules(q: Any, u: Any, w: Any, knots: int, scale: list[Array], joints: Indices) -> list[Any]:
    """Residuals of the rule that u and q are the integrals of accelerations w, quadratic from knot to knot."""
    h = 1.0 / knots
    (q0, qm, q1), (u0, um, u1), (w0, wm, w1) = ((x[:, :-2:2], x[:, 1::2], x[:, 2::2]) for x in (q, u, w))
    at = joints.tolist()
    return [
        (u1 - u0 - h / 6 * (w0 + 4 * wm + w1)) / scale[1],
        (um - u0 - h / 24 * (5 * w0 + 8 * wm - w1)) / scale[1],
        (q1 - q0 - h * u0 - h**2 / 6 * (w0 + 2 * wm)) / scale[0],
        (qm - q0 - h / 2 * u0 - h**2 / 96 * (7 * w0 + 6 * wm - w1)) / scale[0],
        (wm[at, :] - 0.5 * (w0[at, :] + w1[at, :])) / scale[2][joints],
    ]


def _bounds(plant: Plant, limits: Limits, q: Array, scale: list[Array], P: int) -> tuple[Array, Array]:
    """Bounds of the scaled unknowns: at rest in balance at both ends, joints between their stops."""
    d, n = plant.driven, len(q)
    order = np.array([plant.arm.coordinate_of(i) for i in range(n)])
    most = [np.full((n, P), np.inf) for _ in range(3)]
    least = [-x for x in most]
    least[0][d.rates] = (limits.middle - limits.reach)[:, None]
    most[0][d.rates] = (limits.middle + limits.reach)[:, None]
    for bound in (least, most):
        bound[0][:, 0], bound[0][:, -1] = q[:, 0], plant.q_end[order]
        bound[1][:, [0, -1]] = 0.0
        bound[2][np.ix_(d.rates, np.array([0, P - 1]))] = 0.0
    out = []
    for bound in (least, most):
        bound[0] -= q[:, :1]
        out.append(np.concatenate([(b / s).ravel(order="F") for b, s in zip(bound, scale, strict=True)]))
    return out[0], out[1]


def _forces(ca: Any, plant: Plant, P: int) -> Any:
    """Generalised forces (nv, P) of q, v, a (nv, P) as a function of CasADi, with the arm's Jacobians."""
    arm, core, n = plant.arm, plant.arm._core, plant.arm.nv
    order = np.argsort([arm.coordinate_of(i) for i in range(n)])  # from the order of rates to that of coordinates
    dense = ca.Sparsity.dense(n, P)
    blocks = ca.kron(ca.DM.eye(P), ca.DM.ones(n, n)).sparsity()

    def states(arg: Any) -> tuple[Array, Array, Array]:
        q, v, a = (np.ascontiguousarray(np.asarray(x).T) for x in arg[:3])
        return q[:, order], v, a

    class Slopes(ca.Callback):  # type: ignore[misc]
        def __init__(self, name: str, opts: dict[str, Any]) -> None:
            super().__init__()
            self.construct(name, opts)

        def get_n_in(self) -> int:
            return 4  # the fourth are the forces, which are not used

        def get_n_out(self) -> int:
            return 3

        def get_sparsity_in(self, i: int) -> Any:
            return dense if i < 3 else ca.Sparsity(n, P)

        def get_sparsity_out(self, i: int) -> Any:
            return blocks

        def eval(self, arg: Any) -> list[Any]:
            q, v, a = states(arg)
            found = [core.inverse_derivatives(*row) for row in zip(q, v, a, strict=True)]
            K, D = (np.array(x) for x in zip(*found, strict=True))
            M = core.mass_matrix(q)
            K = K[:, :, np.argsort(order)]
            return [ca.DM(blocks, x.swapaxes(1, 2).ravel()) for x in (K, D, M)]

    class Forces(ca.Callback):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__()
            self.construct("forces", {})

        def get_n_in(self) -> int:
            return 3

        def get_n_out(self) -> int:
            return 1

        def get_sparsity_in(self, i: int) -> Any:
            return dense

        def get_sparsity_out(self, i: int) -> Any:
            return dense

        def eval(self, arg: Any) -> list[Any]:
            return [ca.DM(core.inverse_dynamics(*states(arg)).T)]

        def has_jacobian(self) -> bool:
            return True

        def get_jacobian(self, name: str, inames: Any, onames: Any, opts: dict[str, Any]) -> Any:
            self.slopes = Slopes(name, opts)  # keeps a reference, as CasADi does not
            return self.slopes

        def has_jac_sparsity(self, oind: int, iind: int) -> bool:
            return True

        def get_jac_sparsity(self, oind: int, iind: int, symmetric: bool) -> Any:
            return blocks

    return Forces()
