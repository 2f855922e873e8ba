"""Positions and rates at which an arm's loops are closed."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._check import Array, array
from ..model.parts.chain import Chain
from ..model.parts.cylinder import stretched
from .rates import coordinate_sizes, displaced, elastic_rates, locked_rates, reach

CLOSED = 1e-9  # of the arm's length, and of a turn (rad): a start that is as near counts as closed
_TO_ROUNDING = 1e-12
_TRIES = 200
_LONGEST = 0.5  # of a step's turns (rad) and moves (parts of the arm's length)
_ASIDE = np.geomspace(0.03, 1.0, 6)  # rad, and parts of the arm's length: starts beside one that leads nowhere
RANK = 1e-9  # of the largest singular value of the Jacobian: smaller ones are zero


class Mobility(NamedTuple):
    """How loops hold an arm.

    Attributes:
        freedoms: independent motions that they leave, elastic ones too.
        rows: the number of constraints of rigid loops, entries of `loop_motion`.
        redundant: how many of these follow from the others: forces along them are not determined.
    """

    freedoms: int
    rows: int
    redundant: int


class OpenLoops(ValueError):
    """A start that leaves rigid loops open."""


class Closure:
    """The constraints of an arm's rigid loops: g, positions over the arm's length, and its Jacobian."""

    def __init__(self, arm: Chain) -> None:
        self.arm = arm
        self.rigid = arm.rigid_rows
        of = [(k, turns) for k, turns, rigid in arm._core.loop_rows if rigid]
        self.turns = np.array([turns for _, turns in of], bool)
        self.names = [arm.loop_names[k] for k, _ in of]
        self.length = reach(arm)
        self.scale = np.where(self.turns, 1.0, 1.0 / self.length)
        self.sizes = coordinate_sizes(arm)

    def gaps(self, q: Array) -> Array:
        return self.scale * self.arm.loop_motion(q)[0][self.rigid]

    def jacobian(self, q: Array) -> Array:
        return self.scale[:, None] * self.arm.loop_jacobian(q)[self.rigid]

    def worst(self, rows: Array, unit: str) -> str:
        """The loop that is farthest from closed, in words; `unit` is "" or "/s"."""
        k = int(np.abs(rows).argmax())
        size = abs(float(rows[k] / self.scale[k]))
        return f"loop '{self.names[k]}' is open by {size:.3g} {'rad' if self.turns[k] else 'm'}{unit}"

    def near(self, q: Array, free: NDArray[np.bool_]) -> Array:
        """q moved until the gaps are zero or get no smaller, by damped Gauss-Newton steps, the shortest ones."""
        arm, g, at = self.arm, self.gaps(q), np.flatnonzero(free)
        for _ in range(_TRIES if len(at) else 0):
            size = float(np.linalg.norm(g))
            U, s, Vt = np.linalg.svd(self.jacobian(q)[:, at] / self.sizes[at], full_matrices=False)
            if not size > 0.0 or not s[0] > 0.0:
                break
            keep = s > 1e-11 * s[0]
            turn = -Vt[keep].T @ (s[keep] / (s[keep] ** 2 + 1e-2 * size**2) * (U[:, keep].T @ g))
            turn *= min(1.0, _LONGEST / max(float(np.abs(turn).max()), 1e-300))
            step, E = np.zeros(arm.nv), arm._core.rates(q, np.zeros(arm.nv))[2]
            step[at] = turn / self.sizes[at]
            for halving in range(20):
                new = displaced(arm, q, E, step / 2.0**halving)
                g_new = self.gaps(new)
                if np.linalg.norm(g_new) < size:
                    break
            else:
                break
            q, g = new, g_new
        return q

    def closed(self, q: Array, free: NDArray[np.bool_]) -> Array:
        """As `near`; beams bend only where joints alone do not close it."""
        for movable in (free & ~elastic_rates(self.arm), free):
            q = self.near(q, movable)
            if np.abs(self.gaps(q)).max() <= _TO_ROUNDING:
                break
        return q

    def _beside(self, q: Array, size: float, free: NDArray[np.bool_]) -> Array:
        """Positions beside q: the same ones each time."""
        step = np.where(free, np.random.default_rng(1).uniform(-size, size, len(free)) / self.sizes, 0.0)
        return displaced(self.arm, q, self.arm._core.rates(q, 0.0 * step)[2], step)

    def assembled(self, q: Array, held: NDArray[np.bool_]) -> Array:
        """The nearest q at which all is closed to rounding; beams bend only where joints alone do not close it. Where
        steps from q lead nowhere, as from a dead centre, starts beside it are tried."""
        q = stretched(self.arm, q, held)
        joints, start, found = ~held & ~elastic_rates(self.arm), q, q
        for aside in (0.0, *_ASIDE):
            found = start if not aside else self._beside(start, aside, joints)
            found = self.closed(found, ~held)
            if np.abs(self.gaps(found)).max() <= _TO_ROUNDING:
                return found
            if not aside:
                q = found
            if not joints.any():
                break
        left = self.gaps(q)
        rank = np.linalg.matrix_rank(self.jacobian(q)[:, ~held] / self.sizes[~held], 1e-6) if (~held).any() else 0
        reach_or_meet = "its axes do not meet" if self.turns[np.abs(left).argmax()] else "the links do not reach"
        why = reach_or_meet if (~held).any() else "no joint is left to close it"
        if rank and np.abs(left).max() < 1e-3:
            why = "it is in a dead centre, or nearly"
        raise ValueError(
            f"{self.worst(left, '')} in the nearest positions that were found: {why}; begin from a q that is nearer, "
            "or hold fewer joints"
        )

    def moving(self, q: Array, v: Array, held: NDArray[np.bool_]) -> Array:
        """The nearest rates, in kinetic energy, with which the loops stay closed; beams take part only where joints
        alone do not."""
        import scipy.linalg as la  # slow to import

        arm, J = self.arm, self.jacobian(q)
        M = arm.mass_matrix(q)
        size = 1.0 / np.sqrt(np.maximum(np.diag(M), 1e-300))
        for free in (~held & ~elastic_rates(arm), ~held):
            if not free.any():
                continue
            d = size[free]
            L = la.cholesky(d[:, None] * M[np.ix_(free, free)] * d, lower=True)
            Z = la.solve_triangular(L, (J[:, free] * d).T, lower=True)
            y = np.linalg.lstsq(Z.T, -J @ v, rcond=RANK)[0]
            new = v.copy()
            new[free] += d * la.solve_triangular(L.T, y)
            left = J @ new
            if np.abs(left).max() <= _TO_ROUNDING * max(1.0, float(np.abs(J * new).max())):
                return new
            v = new
        raise ValueError(f"{self.worst(left, '/s')} with the nearest rates that were found; hold fewer joints")


def mobility(arm: Chain, q: ArrayLike | None = None) -> Mobility:
    """How many independent motions rigid loops leave at q, and how many of their conditions are redundant.

    Args:
        q: positions at which the loops are closed, (nq,); `zero` if None.

    Returns:
        Mobility: `.freedoms`, `.rows`, `.redundant`.
    """
    closure = Closure(arm)
    at = arm._place("q", q)
    J, rows = closure.jacobian(at) / closure.sizes, len(closure.turns)
    s = np.linalg.svd(J, compute_uv=False) if rows else np.zeros(0)
    rank = int(np.count_nonzero(s > RANK * s.max(initial=0.0)))
    return Mobility(arm.nv - rank, rows, rows - rank)


def assemble(
    arm: Chain, q: ArrayLike | None = None, v: ArrayLike | None = None, *, hold: Iterable[Any] = ()
) -> Any:  # fmt: skip
    """Positions near q at which all rigid loops are closed to rounding; with v, also the rates nearest to v (in
    kinetic energy) that keep them closed.

    By damped Gauss-Newton steps from q, each the shortest. Joints move; beams bend only where joints alone do not
    close the loops. Which of several closed positions is found depends on q.

    Args:
        q: start, (nq,), or as `pose` takes it: {"crank": 0.3}; `zero` if None.
        v: rates, (nv,); None: none are sought.
        hold: links, or (link, freedom), whose joints keep their positions, and rates.

    Returns:
        q (nq,); with v, q and v (nv,).

    Raises:
        ValueError: no such positions were found, naming the loop that is farthest from closed, and its gap.
    """
    at = arm._place("q", q)
    arm.check_balls("q", at)
    rates = None if v is None else array("v", v, (arm.nv,))
    held = locked_rates(arm, hold, "hold")
    if not arm.constrained:
        return at if rates is None else (at, rates)
    closure = Closure(arm)
    try:
        at = closure.assembled(at, held)
        return at if rates is None else (at, closure.moving(at, rates, held))
    except ValueError as e:
        raise ValueError(f"assemble: {e}") from None


def closed_start(
    arm: Chain, q: Array, v: Array, given: tuple[bool, bool], moved: Iterable[int] = (), named: Iterable[int] = (),
    names: tuple[str, str] = ("q0", "v0"),
) -> tuple[Array, Array]:  # fmt: skip
    """A start at which rigid loops are closed. Those that were not `given` follow: positions from those of the rates
    `moved` and `named`, without bending beams; rates from those `moved`.

    Raises:
        ValueError: the given start leaves a loop open, or opens it; nothing that closes it was found.
    """
    if not arm.constrained:
        return q, v
    closure, fixed = Closure(arm), np.isin(np.arange(arm.nv), list(moved))
    held = fixed | np.isin(np.arange(arm.nv), list(named)) | elastic_rates(arm)
    remedy = "of a start near it, with the joints that you set in `hold`"
    try:
        q = q if given[0] else closure.assembled(q, held)
        if np.abs(gaps := closure.gaps(q)).max() > CLOSED:
            raise ValueError(f"{closure.worst(gaps, '')}; take arm.assemble {remedy}")
    except ValueError as e:
        raise OpenLoops(f"{names[0]}: {e}") from None
    try:
        v = v if given[1] else closure.moving(q, v, fixed)
        J = closure.jacobian(q)
        if np.abs(rates := J @ v).max() > CLOSED * max(1.0, float(np.abs(J * v).max(initial=0.0))):
            both = ", ".join(names)
            raise ValueError(f"{closure.worst(rates, '/s')}; take {both} = arm.assemble({both}), {remedy}")
    except ValueError as e:
        raise OpenLoops(f"{names[1]}: {e}") from None
    return q, v
