"""Static equilibrium and steady spin, by Newton's iteration with exact Jacobians."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._check import Array, array, finite, warn
from ..model.acting.drive import voltage_forces
from ..model.acting.load import Load, at_time
from ..model.parts.chain import Chain
from .assembly import Closure, assemble, closed_start
from .closed import carried, tangent
from .rates import coordinate_sizes, displaced, elastic_rates, locked_rates
from .validity import range_warning, turned_inside_out, worst_range

_AT_REST = 1e-6  # parts of the forces at work by which a state at rest may be out of balance
_LARGEST = 0.5  # of a step's turns (rad) and moves (parts of the arm's length): none may pass an equilibrium by
_TRIES = 200  # Newton steps from the given start
_TRIES_IN_STEPS = 40  # and for each step of the load
_LEAST_SHARE = 1e-3  # of the load in one of its steps
_MOST_TRIES = 1000  # Newton steps for all steps of the load: they turn sections by 500 rad
_OFF_SADDLE = 1e-3  # turn (rad) or move (parts of the arm's length) out of a balance that is unstable
_ROUNDING = 1e-8  # of the stiffness: its asymmetry by rounding, of an arm with loops, without a follower force
_MOST_SADDLES = 8  # that are left so, at most


class Trim(NamedTuple):
    """A pose in balance, with the forces that hold it.

    Attributes:
        q: the coordinates (nq,), elastic ones in balance.
        tau: the generalised forces (N, N m) that hold the joints there, (nv,); zero for elastic coordinates.
    """

    q: Array
    tau: Array


def trim(
    arm: Chain, q: Any = None, *, loads: Sequence[Load] | None = None, t: float = 0.0, voltages: Any = None
) -> Trim:
    """A static equilibrium for given joint positions: elastic coordinates, and forces that hold the joints.

    `arm.linearize(q, tau=tau)`, `simulate(arm, t, q, tau=tau)` and a controller's u0 need both.

    Args:
        q: the joints' positions: all coordinates (nq,), of which the elastic ones are the start of the search; or
            as `pose` takes it, {0: 0.5, 1: -1.0}; `zero` if None.
        loads, t: external forces and moments, with their values at time t (s).
        voltages: of the patches (V), as of `equilibrium`.

    Returns:
        Trim: `.q` (nq,) and `.tau` (nv,); `q, tau = arm.trim(...)`.

    Raises:
        ValueError: bad arguments, or no equilibrium of the beams was found.

    Warns:
        StateWarning: the equilibrium of the beams is unstable: they buckle.
        RangeWarning: a beam is bent further than its order is good for.
    """
    volts = np.zeros(arm.nv) if voltages is None else voltage_forces(arm, voltages)
    found = trimmed(arm, q, at_time(arm, loads, t), volts)
    _warn_of_range(arm, found.q, "trim")
    return found


def trimmed(arm: Chain, q: Any, loads: Any, volts: Array | None = None) -> Trim:
    """As `trim`, without its warning of beams bent too far; `volts` are the forces (nv,) of the patches' voltages."""
    arm.refuse_loops("trim", rigid=True)
    joints = ~elastic_rates(arm)
    q0 = arm._single(q=arm.zero if q is None else q)[0]
    b = _balance_of(arm, np.zeros(arm.nv), np.zeros(arm.nv) if volts is None else volts, ~joints, loads)
    found, wrong = balance(b, q0, descend=True)
    if not wrong and b.perhaps_unstable:
        found = _stable(b, q0, found, False)
    if wrong:
        raise ValueError(f"q, gravity, loads: no balance of the beams was found with the joints held there: {wrong}")
    zero = np.zeros(arm.nv)
    forces = finite("the forces there", arm._core.inverse_dynamics(found, zero, zero, *loads))
    return Trim(found, np.where(joints, forces, 0.0))


class StateWarning(UserWarning):
    """A linear model about a state from which the arm accelerates, or an unstable balance."""


def warn_unless_at_rest(arm: Chain, at: tuple[Array, Array, Array], left: Array, tau: Array) -> None:
    """StateWarning where the forces `left` (nv,) that nothing balances are not small beside weight, tau and elastic
    forces, in the norm of M's diagonal.

    at: M and K of the rates, and small displacements from where the elastic coordinates are zero, (nv,)."""
    M, K, u = at
    scale = 1.0 / np.sqrt(np.diag(M))
    at_work = _weight(arm) + np.linalg.norm(scale * tau) + np.linalg.norm(scale * np.diag(K) * u)
    if np.linalg.norm(scale * left) <= _AT_REST * at_work:
        return
    worst = int(np.abs(scale * left).argmax())
    warn(
        f"linearize: the arm does not rest at this q, so that the model holds for a moment only: {left[worst]:.3g} "
        f"(N, N m) is left on '{arm.coordinates[worst]}', whose inertia is {M[worst, worst]:.3g}; give "
        "it both of q, tau = arm.trim(q), that pose in balance and the forces that hold its joints; or take q from "
        "arm.equilibrium(...), or lock the joints that something holds",
        StateWarning,
    )


def _balance_of(arm: Chain, v: Array, tau: Array, free: NDArray[np.bool_], loads: Any) -> _Balance:
    return (_OnLoops if arm.constrained else _Balance)(arm, v, tau, free, loads)


class _Balance:
    """The forces left over on the free coordinates at rest, or at constant rates v, and their Jacobian."""

    def __init__(self, arm: Chain, v: Array, tau: Array, free: NDArray[np.bool_], loads: Any) -> None:
        self.arm, self.v, self.tau, self.free, self.loads = arm, v, tau, free, loads
        self.zero, self.at = np.zeros(arm.nv), np.ix_(free, free)
        self.sizes = coordinate_sizes(arm)[free]
        self.tries = 0  # Newton steps of the last iteration
        self.perhaps_unstable = False  # whether the potential of the last step was not plainly convex there
        balls = [i for _, rates in arm.ball_rates() for i in range(arm.nv)[rates]]
        self.rows = ~np.isin(np.flatnonzero(free), balls)  # where a potential means a symmetric Jacobian anywhere

    def part(self, share: float) -> _Balance:
        """The same under a share of all that acts: gravity, loads, tau, and the square of the rates. Springs and
        elastic forces act wholly."""
        arm = self.arm._alike(self.arm.links, [share * g for g in self.arm.gravity])
        loads = (self.loads[0], share * self.loads[1]) if self.loads else ()
        return _balance_of(arm, np.sqrt(share) * self.v, share * self.tau, self.free, loads)

    def masses(self, q: Array) -> Array:
        M: Array = self.arm._core.mass_matrix(q)[self.at]
        return M

    def acting(self, q: Array) -> Array:
        """The part of tau on the free coordinates."""
        return self.tau[self.free]

    def turns(self, step: Array) -> Array:
        """The turns (rad) and moves (parts of the arm's length) of a step of the free coordinates."""
        return self.sizes * step

    def places(self, E: Array, q: Array) -> Array:
        """Those of coordinates q, or of their difference."""
        return self.sizes * (E.T @ q)[self.free]

    def moved(self, q: Array, E: Array, step: Array) -> Array:
        """q behind a step of the free coordinates."""
        whole = np.zeros(self.arm.nv)
        whole[self.free] = step
        return displaced(self.arm, q, E, whole)

    def worst(self, q: Array, r: Array) -> tuple[float, str]:
        """The force that is largest, by the masses, of the residual r, and its coordinate."""
        k = int(np.abs(r / np.sqrt(np.diag(self.masses(q)))).argmax())
        return float(r[k]), np.array(self.arm.coordinates)[self.free][k]

    def residual(self, q: Array) -> Array:
        r: Array = (self.arm._core.inverse_dynamics(q, self.v, self.zero, *self.loads) - self.tau)[self.free]
        return r

    def jacobian(self, q: Array, E: Array) -> Array:
        places, wrenches = self.loads or ([], np.zeros((0, 6)))
        by_q = self.arm._core.inverse_derivatives(q, self.v, self.zero, places, wrenches, by_v=False)[0]
        K: Array = (by_q @ E)[self.at]
        return K

    def has_potential(self, K: Array) -> bool:
        """Whether K is symmetric. Follower forces and moments in space have no potential; nothing is downhill there."""
        off = K - K.T
        off[~self.rows] = off[:, ~self.rows] = 0.0
        d = np.sqrt(np.abs(np.diag(K)))
        least = 1e-6 * float(np.abs(K).max(initial=0.0))
        return bool((np.abs(off) <= 1e-9 * np.maximum(np.outer(d, d), least)).all())


class _OnLoops(_Balance):
    """The same in coordinates z of the motions that rigid loops leave, of unit mass: dq = T z, and a step that
    closes the loops again. At a q where they are closed."""

    def __init__(self, arm: Chain, v: Array, tau: Array, free: NDArray[np.bool_], loads: Any) -> None:
        super().__init__(arm, v, tau, free, loads)
        self.closure = Closure(arm)
        self.M, self.T = np.zeros((0, 0)), np.zeros((arm.nv, 0))

    def masses(self, q: Array) -> Array:
        self.M = self.arm._core.mass_matrix(q)
        self.T = tangent(self.closure, q, self.free, self.M)
        return np.eye(self.T.shape[1])

    def acting(self, q: Array) -> Array:
        return self.T.T @ self.tau

    def turns(self, step: Array) -> Array:
        return self.closure.sizes * (self.T @ step)

    def places(self, E: Array, q: Array) -> Array:
        return self.closure.sizes * (E.T @ q)

    def moved(self, q: Array, E: Array, step: Array) -> Array:
        return self.closure.closed(displaced(self.arm, q, E, self.T @ step), self.free)

    def worst(self, q: Array, r: Array) -> tuple[float, str]:
        forces = self.M @ self.T @ r
        k = int(np.abs(forces / np.sqrt(np.diag(self.M))).argmax())
        return float(forces[k]), self.arm.coordinates[k]

    def residual(self, q: Array) -> Array:
        """Along the motions T of the last `masses`, as far as they are motions at q."""
        if not self.T.shape[1]:
            self.masses(q)
        M = self.arm._core.mass_matrix(q)
        T = tangent(self.closure, q, self.free, M)
        along: Array = T @ (T.T @ M @ self.T)
        return along.T @ (self.arm._core.inverse_dynamics(q, self.v, self.zero, *self.loads) - self.tau)

    def has_potential(self, K: Array) -> bool:
        off = np.abs(K - K.T).max(initial=0.0)
        return bool(self.arm.ball_rates()) or bool(off <= _ROUNDING * np.abs(K).max(initial=0.0))

    def jacobian(self, q: Array, E: Array) -> Array:
        """Of T' (h - tau - J' f) at constant forces f of the loops."""
        places, wrenches = self.loads or ([], np.zeros((0, 6)))
        rows = carried(self.arm, self.closure, q, self.v, self.tau, self.free, self.loads).rows
        by_q = self.arm._core.inverse_derivatives(q, self.v, self.zero, places, wrenches, False, rows)[0]
        K: Array = self.T.T @ (by_q @ E) @ self.T
        return K


class _Solver:
    """K x = b, scaled to a unit diagonal: by LU, or by least squares where K is singular."""

    def __init__(self, M: Array, K: Array) -> None:
        import scipy.linalg as la  # slow to import

        self.la, self.K = la, K
        self.d = 1.0 / np.sqrt(np.maximum(np.abs(np.diag(K)), 1e-14 * np.diag(M)))
        self.scaled = self.d[:, None] * K * self.d
        lu, order, _ = la.lapack.dgetrf(self.scaled)
        pivots = np.abs(np.diag(lu))
        self.lu = (lu, order) if pivots.min() > 1e-13 * pivots.max() else None

    def __call__(self, b: Array) -> Array:
        if self.lu is None:
            x = self.la.lstsq(self.scaled, self.d * b)[0]
        else:
            x = self.la.lu_solve(self.lu, self.d * b)
        out: Array = self.d * x
        return out

    def leaves(self, b: Array, x: Array) -> float:
        """Share of b that no x can balance: zero unless K is singular."""
        return float(np.linalg.norm(self.d * (self.K @ x - b)) / max(float(np.linalg.norm(self.d * b)), 1e-300))


def _equilibrated(M: Array, K: Array) -> Array:
    """Scales d (n,) by which the largest entry in each row of d K d is about 1. (The pencil of K and M will not do: its
    highest eigenvalues, of strains with hardly any inertia, drown the lowest.)"""
    size = np.abs(K)
    d = 1.0 / np.sqrt(np.diag(M))
    for _ in range(20):
        largest = d * (size * d).max(axis=1)
        d = d / np.sqrt(np.where(largest > 0.0, largest, 1.0))
    return np.asarray(d)


def _convex(M: Array, K: Array) -> tuple[Array, Array] | None:
    """Cholesky's factor of K scaled by d to a unit diagonal, and d; None unless positive definite beyond rounding."""
    import scipy.linalg as la  # slow to import

    d = 1.0 / np.sqrt(np.maximum(np.abs(np.diag(K)), 1e-14 * np.diag(M)))
    factor, wrong = la.lapack.dpotrf(d[:, None] * K * d)
    return (factor, d) if wrong == 0 and np.diag(factor).min() > 1e-6 else None


def _descent_step(M: Array, K: Array, r: Array, forces: float) -> tuple[Array, bool]:
    """Newton's step with |lambda| for the eigenvalues lambda of the scaled K: downhill in potential energy. Where
    lambda is zero the arm is indifferent and stays, unless a force above the noise of `forces` (sqrt(kg) m/s^2) pushes
    it. And whether K is positive definite."""
    import scipy.linalg as la  # slow to import

    K = 0.5 * (K + K.T)
    convex = _convex(M, K)
    if convex:  # no need of its eigenvalues
        factor, d = convex
        step: Array = -d * la.cho_solve((factor, False), d * r)
        return step, True
    d = _equilibrated(M, K)
    try:
        lam, V = la.eigh(d[:, None] * K * d)
    except la.LinAlgError:
        return np.full_like(r, np.nan), False
    Z = d[:, None] * V
    g = Z.T @ r
    least = 1e-14
    flat = np.abs(lam) <= least
    flat &= np.abs(g) <= 1e-11 * forces * np.sqrt(np.einsum("ik,ij,jk->k", Z, M, Z))
    g[flat] = 0.0
    step = -Z @ (g / np.maximum(np.abs(lam), least))
    return step, False


def _newton(b: _Balance, q: Array, descend: bool, tries: int) -> tuple[Array, str]:
    """Newton's iteration from q; see `balance`."""
    arm = b.arm
    M, forces = b.masses(q), 0.0
    r = b.residual(q)
    for steps in range(1, tries + 1):
        b.tries = steps
        if steps > 1:
            M = b.masses(q)
            r = b.residual(q)
        E = arm._core.rates(q, b.zero)[2]
        K = b.jacobian(q, E)
        if not (np.isfinite(K).all() and np.isfinite(r).all() and np.isfinite(M).all() and (np.diag(M) > 0.0).all()):
            return q, "from the q given the steps lead to where the forces are not finite or the masses not positive"
        scale = 1.0 / np.sqrt(np.diag(M))
        forces = max(forces, float(np.linalg.norm(scale * r)), float(np.linalg.norm(scale * b.acting(q))), _weight(arm))
        downhill = descend and b.has_potential(K)
        if downhill:
            step, convex = _descent_step(M, K, r, forces)
            b.perhaps_unstable = not convex
        else:
            b.perhaps_unstable, solve = False, _Solver(M, K)
            step = -solve(r)
        if not np.isfinite(step).all():
            break
        turn = b.turns(step)
        share = min(1.0, _LARGEST / max(float(np.abs(turn).max()), 1e-300))
        step *= share
        slope, size = float(step @ r), float(np.linalg.norm(scale * r))
        last = bool(np.abs(turn).max() <= 1e-8 * (1e-3 + np.abs(b.places(E, q)).max()))
        if last and not downhill and np.linalg.norm(scale * r) > 1e-9 * forces and solve.leaves(-r, step) > 1e-3:
            break  # K is singular, and nothing balances r
        for halving in range(40):
            q_new = b.moved(q, E, step / 2.0**halving)
            r_new = b.residual(q_new)
            if not np.isfinite(r_new).all():
                continue
            if last or float(np.linalg.norm(scale * r_new)) < size:
                break
            if downhill and slope < 0 > step @ r_new:
                break
            # stiff coordinates make r grow in a step that is right (Deuflhard's test: does the next step shrink?)
            shorter = 1.0 - 0.25 * share / 2.0**halving
            if not downhill and np.abs(b.turns(solve(r_new))).max() <= shorter * np.abs(turn).max():
                break
        else:
            break
        q, r = q_new, r_new
        if last:
            return q, turned_inside_out(arm, q)
    left, label = b.worst(q, r)
    return q, f"after {steps} damped Newton steps from the q given {left:.3g} (N, N m) is left on '{label}'"


def balance(b: _Balance, q: Array, descend: bool) -> tuple[Array, str]:
    """Moves the free coordinates of q until inverse_dynamics(q, v, 0) = tau on them.

    No step turns a section by more than 0.5 rad. Steps are halved until the residual, scaled by the mass matrix, is
    less than it was; or (descending in potential energy, where there is one) the step still leads downhill at its end;
    or (elsewhere) the next step is shorter. Newton's convergence being quadratic, the step after one of 1e-8 is the
    last. Where this fails from q, the load is put on in steps, which take _MOST_TRIES at most. Returns q, and an
    error in words, or "".
    """
    if not b.free.any() or not len(b.masses(q)):
        return q.copy(), ""
    found, wrong = _newton(b, q.copy(), descend, _TRIES)
    if not wrong:
        return found, ""
    share, step, at, tries = 0.0, 0.25, q.copy(), 0
    while share < 1.0 and step >= _LEAST_SHARE and tries < _MOST_TRIES:
        step = min(step, 1.0 - share)
        part = b.part(share + step) if share + step < 1.0 else b
        found, failed = _newton(part, at, descend, _TRIES_IN_STEPS)
        tries += part.tries
        if failed:
            step *= 0.5
            continue
        share, at, step = share + step, found, 2.0 * step
    if share >= 1.0:
        return at, ""
    far = b.arm.in_names(b.arm._core.farthest_out(at, b.zero))
    return at, f"{wrong}; put on in steps, {share:.3g} of the load was balanced" + (f", and {far}" if far else "")


def _way_down(b: _Balance, q: Array) -> Array | None:
    """A q beside one in balance from where potential energy falls further; None if that is stable or indifferent, or
    nothing has a potential."""
    import scipy.linalg as la  # slow to import

    M, E = b.masses(q), b.arm._core.rates(q, b.zero)[2]
    K = b.jacobian(q, E)
    if not b.has_potential(K):
        return None
    K = 0.5 * (K + K.T)
    if _convex(M, K):
        return None
    d = _equilibrated(M, K)
    softest: Array = d * la.eigh(d[:, None] * K * d, subset_by_index=[0, 0])[1][:, 0]
    softest /= np.sqrt(softest @ M @ softest)
    softest *= np.sign(softest[np.abs(softest).argmax()])
    beside = b.moved(q, E, _OFF_SADDLE * softest / np.abs(b.turns(softest)).max())
    d = 1.0 / np.sqrt(np.diag(M))
    forces = [d * b.acting(q), d * b.residual(q if b.arm.constrained else b.arm.zero)]
    noise = 1e-10 * (_weight(b.arm) + sum(float(np.linalg.norm(f)) for f in forces))
    return beside if float(softest @ b.residual(beside)) < -noise else None


def _weight(arm: Chain) -> float:
    """Size of the weight in the norm of the mass matrix, sqrt(m) g."""
    return float(np.sqrt(sum(link.mass for link in arm.links)) * np.linalg.norm(arm.gravity))


def steady_state(arm: Chain, q: Array, v: Array, loads: Any = (), volts: Array | None = None) -> Array:
    """Elastic coordinates in balance at joint positions q and constant rates v; `volts` as of `trim`."""
    q = closed_start(arm, q, v, (True, True), names=("q", "speed"))[0]
    b = _balance_of(arm, v, np.zeros(arm.nv) if volts is None else volts, elastic_rates(arm), loads)
    q, wrong = balance(b, q, descend=False)
    if wrong:
        raise ValueError(
            f"speed: no steady state of the elastic coordinates at this speed, gravity, loads and q: {wrong}"
        )
    return q


def _stable(b: _Balance, start: Array, q: Array, given: bool) -> Array:
    """Leaves an unstable balance q and lets Newton's iteration find a stable one. Warns (StateWarning) where it finds
    none, unless the start was `given` and is that balance itself."""
    E = b.arm._core.rates(q, b.zero)[2]
    stayed = np.abs(b.places(E, q - start)).max() < 1e-8
    beside = _way_down(b, q)
    for _ in range(0 if stayed else _MOST_SADDLES):
        if beside is None:
            break
        lower, wrong = _newton(b, beside, True, _TRIES)
        if wrong:
            break
        q, beside = lower, _way_down(b, lower)
    if beside is not None and not (stayed and given):
        worst = int(np.abs(b.places(E, beside - q)).argmax())
        names = np.array(b.arm.coordinates)[... if b.arm.constrained else b.free]
        warn(
            f"equilibrium: is unstable: the arm leaves it along '{names[worst]}'; start "
            "from a q off it, on the side to which it is to go, or give this one as q if it is meant",
            StateWarning,
        )
    return q


def _with_rigid_loops(arm: Chain, q: Array, tau: Array, lock: Iterable[Any] | None, loads: Any) -> Array | None:
    """The equilibrium with all loops rigid, which is near that with stiff ones; None where there is none."""
    still: dict[str, Any] = {"stiffness": None, "damping": 0.0, "angular_stiffness": None, "angular_damping": 0.0}
    loops = [replace(x, **still) for x in arm.loops]
    try:
        rigid = arm._alike(arm.links, arm.gravity, loops=loops)
        return balanced(rigid, q, tau, lock, loads)
    except ValueError:
        return None


def equilibrium(
    arm: Chain,
    q: ArrayLike | None = None,
    tau: ArrayLike | None = None,
    lock: Iterable[Any] | None = None,
    *,
    loads: Sequence[Load] | None = None,
    t: float = 0.0,
    voltages: Any = None,
) -> Array:
    """Coordinates (nq,) at rest in equilibrium with gravity, springs, loads and constant generalised forces.

    Damped Newton iteration from q with exact Jacobians, decreasing the potential energy if there is one: the
        equilibrium is then stable, unless q is one already. Rigid loops are closed first, near q.

    Args:
        q: start, and positions of locked joints, (nq,); `zero` if None.
        tau: generalised forces (N, N m), (nv,); zero if None. Those of locked joints are ignored: their reactions
            are `inverse_dynamics(q, 0, 0)`.
        lock: links, or (link, freedom), whose joints are locked.
        loads, t: external forces and moments, with their values at time t (s).
        voltages: of the patches (V), (n_patches,) in the order of `patches`, or by (link, patch).

    Raises:
        ValueError: bad arguments, or no equilibrium was found: for example a free joint without support, or a load
            that shortens a beam by more than its length.

    Warns:
        StateWarning: the equilibrium is unstable, and the given q is none.
        RangeWarning: a beam is bent further than its order is good for.
    """
    if voltages is not None:
        zero = np.zeros(arm.nv) if tau is None else array("tau", tau, (arm.nv,))
        tau = zero + voltage_forces(arm, voltages)
    found = balanced(arm, q, tau, lock, at_time(arm, loads, t))
    _warn_of_range(arm, found, "equilibrium")
    return found


def _warn_of_range(arm: Chain, q: Array, name: str) -> None:
    if (beyond := worst_range(arm, np.zeros(1), q[None])) is not None:
        warn(range_warning(arm, beyond, still=True).of(name))


def balanced(
    arm: Chain, q: ArrayLike | None, tau: ArrayLike | None, lock: Iterable[Any] | None, loads: Any = ()
) -> Array:  # fmt: skip
    """As `equilibrium`, without its warning of beams bent too far; `loads` as of `at_time`."""
    q0 = arm.zero if q is None else arm._single(q=q)[0]
    forces = np.zeros(arm.nv) if tau is None else array("tau", tau, (arm.nv,))
    free = ~locked_rates(arm, lock)
    forces = np.where(free, forces, 0.0)
    if arm.constrained:
        q0 = assemble(arm, q0, hold=lock or ())
    b = _balance_of(arm, np.zeros(arm.nv), forces, free, loads)
    found, wrong = balance(b, q0, descend=True)
    if wrong and any(x.gives_way for x in arm.loops):
        near = _with_rigid_loops(arm, q0, forces, lock, loads)
        again, failed = (found, wrong) if near is None else balance(b, near, descend=True)
        found, wrong = (found, wrong) if failed else (again, "")
    if not wrong and b.perhaps_unstable:
        found = _stable(b, q0, found, q is not None)
    if wrong:
        remedy = "hold a joint with lock or tau"
        if not (free & ~elastic_rates(arm)).any():
            remedy = "the load may be more than these beams bear"
        if any(link.beam is not None and link.beam.order in (2, 3) for link in arm.links):
            remedy += ', or more than their order does, where "exact" has a balance'
        raise ValueError(f"tau, gravity, loads: no equilibrium was found: {wrong}; {remedy}")
    return found
