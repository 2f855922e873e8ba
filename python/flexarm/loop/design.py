"""Optimal control of small deviations from rest: LQR and LQG, continuous or sampled exactly, with delay.

B. D. O. Anderson and J. B. Moore, Optimal Control: Linear Quadratic Methods, 1990; sampling of the cost: C. F. Van
Loan, IEEE Trans. Automatic Control 23 (1978), 395-404; delay: K. J. Astrom and B. Wittenmark, Computer-Controlled
Systems, 1997, ch. 3.2.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .._check import Array, array, instance, not_negative, positive
from ..analysis.equilibrium import balanced
from ..analysis.linear import linearize, solve_mass
from ..model.acting.control import StateFeedback, all_joints, force_columns, listed, measured_rows
from ..model.acting.sampled import LinearController
from ..model.parts.chain import Chain

_BRYSON = 0.1  # rad, m: deviation of a joint that is accepted by default
_SLOWER = 3.0  # than the lowest frequency with the joints held is the loop that the effort accepted aims at
_RIGID = 10.0  # rad/s: of an arm that does not bend
_NOISE = {"joint": 1e-4, "rate": 1e-2, "strain": 1e-4, "patch_voltage": 1e-2, "charge": 1e-9}  # SI
_DISTURBANCE = 30.0  # parts of the effort that disturb
_MEAN_TIME = 1e-3  # s: white noise has a mean over this time of the size given
_LEAST = 1e-6  # parts of the largest weight, and of the lowest frequency, that make a problem solvable

#: an entry of `outputs` of linearize: the largest deviation accepted
Weights = Mapping[Any, float]


class Rest(NamedTuple):
    """An arm at rest and its small deviations, in coordinates z whose square is energy: x = T z, z' = A z + B u, with
    q = q0 + x[:nv], v = x[nv:]."""

    arm: Chain
    q: Array
    tau: Array  # forces of all actuators that hold it
    u0: Array
    A: Array
    B: Array
    T: Array
    back: Array
    M: Array
    frequency: float  # the lowest with the joints held, or zero


def rest(arm: Chain, q: ArrayLike | None, actuate: Sequence[Any]) -> Rest:
    """The arm with its joints at q, its elastic coordinates in static balance there, and the forces that hold it.

    Raises:
        ValueError: balls; no static balance; an arm that the actuators do not hold there.
    """
    import scipy.linalg as la  # slow to import

    arm.refuse_loops("lqr, lqg: arm", rigid=True)
    joints, nv = all_joints(arm), arm.nv
    at = balanced(arm, q, None, arm.movable)
    zero = np.zeros(nv)
    tau = arm._core.inverse_dynamics(at, zero, zero)
    columns = np.array(force_columns(arm, actuate)).T
    needed = np.where(np.isin(np.arange(nv), joints), tau, 0.0)
    u0: Array = np.linalg.lstsq(columns, needed, rcond=None)[0].astype(float)
    left = needed - columns @ u0
    if np.abs(left).max() > 1e-6 * max(float(np.abs(needed).max()), 1e-6):
        worst = int(np.abs(left).argmax())
        raise ValueError(
            f"actuate: does not hold the arm at q: {left[worst]:.3g} (N, N m) is left on '{arm.coordinates[worst]}'"
        )
    A = linearize(arm, at, inputs=[], outputs=[], tau=needed).A
    M: Array = arm._core.mass_matrix(at)
    K = -M @ A[nv:, :nv]
    w2, modes = la.eigh(0.5 * (K + K.T), M)
    held = np.setdiff1d(np.arange(nv), joints)
    inside = np.ix_(held, held)
    lowest = float(max(la.eigh(K[inside], M[inside], eigvals_only=True)[0], 0.0)) ** 0.5 if held.size else 0.0
    speed = np.maximum(np.sqrt(np.abs(w2)), 1e-2 * (lowest or _RIGID))
    T = la.block_diag(modes / speed, modes)
    back = la.block_diag(speed[:, None] * (modes.T @ M), modes.T @ M)
    B = back @ np.vstack([np.zeros_like(columns), solve_mass(M, columns)])
    return Rest(arm, at, needed, u0, back @ A @ T, B, T, back, M, lowest)


def _actuators(arm: Chain, actuate: Sequence[Any] | None) -> list[Any]:
    instance("arm", arm, Chain, "an Arm")
    if actuate is not None:
        return listed("actuate", actuate)
    joints = [(k, j) for k, link in enumerate(arm.links) for j in range(link.joint.nv)]
    return [k if arm.links[k].joint.nv == 1 else (k, j) for k, j in joints]


def _efforts(at: Rest, actuate: Sequence[Any], effort: ArrayLike | None) -> Array:
    """The largest acceptable |u - u0| of each actuator."""
    n = len(actuate)
    if effort is not None:
        return _sizes("effort", effort, n, "of actuate")
    columns, joints = np.array(force_columns(at.arm, actuate)), all_joints(at.arm)
    out = np.zeros(n)
    for k, column in enumerate(columns):
        (used,) = np.nonzero(column)
        if not np.isin(used, joints).all():
            raise ValueError(f"effort: give it, the largest size accepted of each; {actuate[k]!r} has no default")
        out[k] = abs(column) @ at.M @ abs(column) * _BRYSON * ((at.frequency or _SLOWER * _RIGID) / _SLOWER) ** 2
    return out


def _sizes(field: str, value: ArrayLike, n: int, of: str) -> Array:
    """Positive numbers, one for all or one for each of n."""
    found = array(field, value)
    if found.shape not in ((), (n,)) or not (found > 0.0).all():
        raise ValueError(f"{field} = {value!r}: must be positive, one number or {n}, one for each {of}")
    return np.broadcast_to(found, (n,)).astype(float)


def _cost(at: Rest, weights: Weights | None, effort: Array) -> Array:
    """The weight of [z; u / effort], by Bryson's rule."""
    arm, n, nu = at.arm, at.A.shape[0], effort.size
    if weights is None:
        weights = {("joint", k): _BRYSON for k, link in enumerate(arm.links) if link.joint.nv}
        if not weights:
            raise ValueError('weights: give them, such as {("tip", -1): 0.01}; the arm has no joints to weigh')
    if not isinstance(weights, Mapping) or not weights:
        raise ValueError(f'weights = {weights!r}: must be a mapping such as {{("joint", 0): 0.1, ("tip", -1): 0.01}}')
    W = np.zeros((n + nu, n + nu))
    W[n:, n:] = np.eye(nu)
    for entry, size in weights.items():
        largest = positive(f"weights[{entry!r}]", size)
        if not isinstance(entry, tuple) or not entry or entry[0] in ("acceleration", "accelerometer"):
            raise ValueError(f'weights: {entry!r} must be an output of linearize, such as ("tip", -1), no acceleration')
        C = linearize(arm, at.q, inputs=[], outputs=[entry], tau=at.tau).C @ at.T
        W[:n, :n] += C.T @ C / largest**2
    return W


class Sampling(NamedTuple):
    """A plant z' = A z + B u between samples: z+ = F z + G u + H p, where p are outputs on their way, the newest first,
    p+ = [u; p] without the oldest; and the cost of [z; p; u] in a sample."""

    F: Array
    G: Array
    H: Array
    shift: Array  # p+ by p
    enter: Array  # p+ by u
    W: Array


def _integral(G: Array, W: Array, time: float) -> tuple[Array, Array]:
    """e^(G t) and the integral of e^(G't) W e^(Gt), by Van Loan's exponential of a short time, doubled."""
    import scipy.linalg as la  # slow to import

    n = len(G)
    doublings = max(0, int(np.ceil(np.log2(max(float(np.linalg.norm(G, 1)) * time, 1e-300)))) + 1)
    short = time / 2.0**doublings
    both = la.expm(short * np.block([[-G.T, W], [np.zeros((n, n)), G]]))
    E, V = both[n:, n:], both[n:, n:].T @ both[:n, n:]
    for _ in range(doublings):
        V, E = V + E.T @ V @ E, E @ E
    return E, 0.5 * (V + V.T)


def sampled_plant(A: Array, B: Array, W: Array, period: float, delay: float) -> Sampling:
    """The plant as it is from sample to sample, each input held for a period from `delay` on; W weighs [z; u]."""
    n, nu = B.shape
    late, part = divmod(delay / period + 1e-12, 1.0)
    late, part = int(late), (0.0 if part < 1e-9 else part)
    count = late + (part > 0.0)  # outputs on their way
    G = np.vstack([np.hstack([A, B]), np.zeros((nu, n + nu))])
    pick = np.zeros((nu, n + (count + 1) * nu))
    states = np.eye(n, pick.shape[1])

    def acting(k: int) -> Array:
        """Picks the output of k samples ago from [z; p; u]."""
        out, first = pick.copy(), n + (count * nu if k == 0 else (k - 1) * nu)
        out[:, first : first + nu] = np.eye(nu)
        return out

    cost = np.zeros((pick.shape[1],) * 2)
    for span, k in ((part * period, late + 1), ((1.0 - part) * period, late)):
        if span > 0.0:
            now = np.vstack([states, acting(k)])
            E, V = _integral(G, W, span)
            cost, states = cost + now.T @ V @ now, (E @ now)[:n]
    shift = np.eye(count * nu, k=-nu)
    enter = np.eye(count * nu, nu)
    F, H, G = np.split(states, [n, n + count * nu], axis=1)
    return Sampling(F, G, H, shift, enter, cost / period)


def _riccati(
    solve: Any, A: Array, B: Array, W: Array, sampled: bool, slowest: float, field: str
) -> tuple[Array, Array]:  # fmt: skip
    """K of u = -K x for the cost W of [x; u], and the least cost P. A problem whose solution is not unique, because
    something undamped is out of reach or costs nothing, is solved for a plant that is damped, and costs, by 1e-6 more.

    Raises:
        ValueError: where something that grows is out of reach.
    """
    n = len(A)
    for least in (0.0, _LEAST):
        Q = W[:n, :n] + least * np.abs(W[:n, :n]).max() * np.eye(n)
        calm = A * (1.0 - least) if sampled else A - least * slowest * np.eye(n)
        R, S = W[n:, n:], W[:n, n:]
        try:
            P = solve(calm, B, Q, R, s=S)
        except (np.linalg.LinAlgError, ValueError):
            continue
        K = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ calm + S.T) if sampled else np.linalg.solve(R, B.T @ P + S.T)
        if not np.isfinite(K).all():
            continue
        poles = np.linalg.eigvals(A - B @ K)
        grows = np.abs(poles) - 1.0 if sampled else poles.real / slowest
        left = grows > -10.0 * least  # undamped and out of reach: an oscillation may
        drifts = np.abs(poles - 1.0 if sampled else poles / slowest) < 1e-4
        if not left.any() or (least and grows.max() < 1e-5 and not drifts[left].any()):
            return np.asarray(K), np.asarray(P)
    raise ValueError(f"{field}: no solution was found: a motion that does not rest by itself is out of its reach")


def _regulator(at: Rest, W: Array, effort: Array, rate: float | None, delay: float) -> tuple[Array, Sampling | None]:
    """K by z (and by outputs on their way), of u / effort."""
    import scipy.linalg as la  # slow to import

    B, slowest = at.B * effort, at.frequency or _RIGID
    if rate is None:
        return _riccati(la.solve_continuous_are, at.A, B, W, False, slowest, "actuate")[0], None
    plant = sampled_plant(at.A, B, W, 1.0 / rate, delay)
    A = np.block([[plant.F, plant.H], [np.zeros((len(plant.shift), len(plant.F))), plant.shift]])
    both = np.vstack([plant.G, plant.enter])
    return _riccati(la.solve_discrete_are, A, both, plant.W, True, slowest, "actuate")[0], plant


def _times(rate: Any, delay: Any) -> tuple[float | None, float]:
    late = not_negative("delay", delay, "s")
    if rate is None and late:
        raise ValueError(f"delay = {delay}: must be zero, or positive with a rate")
    hertz = None if rate is None else positive("rate", rate)
    if hertz is not None and late * hertz > 100.0:
        raise ValueError(f"delay = {delay}: is {late * hertz:.3g} samples at rate = {rate}; at most 100")
    return hertz, late


def lqr(
    arm: Chain, q: ArrayLike | None = None, *, weights: Weights | None = None, effort: ArrayLike | None = None,
    actuate: Sequence[Any] | None = None, rate: float | None = None, delay: float = 0.0, limit: float | None = None,
) -> Any:  # fmt: skip
    """A linear-quadratic regulator of an arm about a pose.

    It is the feedback of all coordinates and rates that minimises the integral of
    sum (y / its size)² + sum ((u - u0) / effort)² (Bryson's rule), for small deviations. For arms without balls.

    Args:
        arm: the arm, with its gravity; u0 holds it at q.
        q: where its joints are to rest (nq,), `arm.zero` if None; elastic coordinates are put into static balance.
        weights: the weighed outputs as of `Arm.linearize`, each with the largest deviation accepted,
            such as {("joint", 0): 0.05, ("tip", -1): 0.002}; None: 0.1 rad (m) of each joint. A weight of the tip damps
            bending.
        effort: the largest u - u0 accepted, a number or one for each of `actuate` (N, N m, V); None: of joints, the
            size that makes a rigid arm three times slower than the lowest frequency with the joints held. For patches
            you must give it.
        actuate: as of StateFeedback; None: all joints.
        rate: samples a second (Hz), then the plant and its cost are sampled exactly; None: continuous.
        delay: from a sample to its force (s), which the design knows.
        limit: of each |u|; None: none.

    Returns:
        A StateFeedback; with a rate, a LinearController that measures the whole state.

    Raises:
        ValueError: arguments that do not fit, an arm that the actuators do not hold at q, or a motion that grows and
            that they do not reach.
    """
    entries, (hertz, late) = _actuators(arm, actuate), _times(rate, delay)
    at = rest(arm, q, entries)
    size = _efforts(at, entries, effort)
    K, plant = _regulator(at, _cost(at, weights, size), size, hertz, late)
    if plant is None:
        return StateFeedback(size[:, None] * (K @ at.back), entries, q0=at.q, u0=at.u0, limit=limit)
    n, count = len(at.A), len(plant.shift)
    by_x, by_p = size[:, None] * (K[:, :n] @ at.back), K[:, n:]
    A, B = plant.shift - plant.enter @ by_p, plant.enter @ K[:, :n] @ at.back
    return LinearController(
        A if count else [], B, -size[:, None] * by_p, by_x, rate=hertz, actuate=entries, delay=late, limit=limit,
        reference=np.concatenate([at.q, np.zeros(arm.nv)]), u0=at.u0, anti_windup=plant.enter / size if count else None,
    )  # fmt: skip


def lqg(
    arm: Chain, q: ArrayLike | None = None, *, measure: Sequence[Any], noise: ArrayLike | None = None,
    disturbance: ArrayLike | None = None, weights: Weights | None = None, effort: ArrayLike | None = None,
    actuate: Sequence[Any] | None = None, rate: float | None = None, delay: float = 0.0, limit: float | None = None,
) -> LinearController:  # fmt: skip
    """The regulator of `lqr` with a Kalman filter for the states that are not measured (LQG). Sampled, the force of a
    sample knows that sample; a limit is known to the filter (`anti_windup`).

    Args:
        arm, q, weights, effort, actuate, rate, delay, limit: as of `lqr`.
        measure: entries as of Sampled, without sensors, such as [("joint", 0), ("strain", 0, 0.0, "K3")].
        noise: standard deviation of each number measured, of a sample (continuous: of a mean over 1 ms), one or (ny,);
            None: 1e-4 of joints (rad, m), 1e-2 of rates, 1e-4 of strains (1/m), 1e-2 V of patch voltages, 1e-9 C.
        disturbance: standard deviation of a mean over 1 ms of the white force that disturbs each actuator (N, N m, V),
            one or (nu,); None: a 30th of `effort`, with which the filter of a joint's angle is about six times as fast
            as the regulator.

    Returns:
        A LinearController with 2 nv states, and one more for each output on its way; its reference is the measurement
        at rest, its u0 holds the arm there.

    Raises:
        ValueError: as of `lqr`; a motion that does not decay and that is not measured.
    """
    import scipy.linalg as la  # slow to import

    entries, (hertz, late) = _actuators(arm, actuate), _times(rate, delay)
    seen = listed("measure", measure)
    if any(hasattr(e, "sampler") for e in seen):
        raise ValueError('measure: sensors are not linear; give quantities, such as ("joint", 0), and their noise')
    parts = [measured_rows(arm, [e], k) for k, e in enumerate(seen)]
    by_q, by_v = (np.vstack([p[k] for p in parts]) for k in range(2))
    at = rest(arm, q, entries)
    C, n = np.hstack([by_q, by_v]) @ at.T, len(at.A)
    size = _efforts(at, entries, effort)
    usual = np.repeat([_NOISE[entry[0]] for entry in seen], [len(p[0]) for p in parts])
    sigma = usual if noise is None else _sizes("noise", noise, usual.size, "number measured")
    pushes = size / _DISTURBANCE if disturbance is None else _sizes("disturbance", disturbance, size.size, "of actuate")
    K, plant = _regulator(at, _cost(at, weights, size), size, hertz, late)
    slowest, force = at.frequency or _RIGID, at.B * pushes
    V = _MEAN_TIME * force @ force.T
    common: dict[str, Any] = {"measure": seen, "actuate": entries, "limit": limit, "u0": at.u0}
    common["reference"] = by_q @ at.q
    if plant is None:
        W = la.block_diag(V, _MEAN_TIME * np.diag(sigma**2))
        L = _riccati(la.solve_continuous_are, at.A.T, C.T, W, False, slowest, "measure")[0].T
        A = at.A - at.B * size @ K - L @ C
        return LinearController(
            A, -L, -size[:, None] * K, np.zeros((size.size, len(C))), anti_windup=at.B, **common
        )  # fmt: skip
    V = _integral(at.A.T, V, 1.0 / float(hertz or 1.0))[1]
    R = np.diag(sigma**2)
    _, P = _riccati(la.solve_discrete_are, plant.F.T, C.T, la.block_diag(V, R), True, slowest, "measure")
    gain = np.linalg.solve(R + C @ P @ C.T, C @ P).T  # of the sample itself
    keep, by_z, by_p = np.eye(n) - gain @ C, K[:, :n], K[:, n:]
    out, through = np.hstack([-by_z @ keep, -by_p]), by_z @ gain
    enter = np.vstack([plant.G, plant.enter])
    A = np.block([[plant.F @ keep, plant.H], [np.zeros((len(plant.shift), n)), plant.shift]]) + enter @ out
    B = np.vstack([-plant.F @ gain, np.zeros((len(plant.shift), len(C)))]) + enter @ through
    return LinearController(
        A, B, size[:, None] * out, size[:, None] * through, rate=hertz, delay=late, anti_windup=enter / size, **common
    )  # fmt: skip
