"""The window of an inversion: times before and after the path, the step of the grid, and the check of rest."""

from typing import Any

import numpy as np

from ..._check import Array
from .equations import Equations
from .path import Path
from .solve import DECAY, MOST, Grid, Motions, NotConverged, Solver

_FIRST_COUNT = 56  # intervals over the path of the first grid
_ROUNDS = 12  # grids
_RESOLVED = 2.6  # rad: largest phase of a pole in one step that the differences resolve
_RINGING = 3.0  # natural logarithm: largest growth or decay over the path of a pole that rings throughout
_LIGHTLY = 0.3  # the largest damping ratio of a pole that rings
_CHANGED = 0.3  # largest relative change of a ringing pole from one end of the path to the other
_ROUNDING = 1e-12  # share of an inertia
_LEAST = 12  # intervals before and after the path, for the differences
_ROUGH = 10.0  # largest error in multiples of the tolerance, if finer grids do not help
_MOST_LEFT = 0.01  # largest remaining vibration, as a share of the path's extent

Poles = tuple[Any, Any]  # complex, of the start and of the end


def _poles(M: Array, C: Array, K: Array, held: Array) -> Array:
    """Poles of M d'' + C d' + K d = 0, by rising size, without infinite ones.

    M is the inertia with the joints held, less the part that following joints take off; a difference of nearly equal
    entries, (k, k), is rounding, which would make infinite poles finite. `held` is the first, for comparison."""
    n = len(K)
    if not n:
        return np.zeros(0, dtype=complex)
    M = np.where(np.abs(M) < _ROUNDING * np.abs(held), 0.0, M)
    inverse = np.linalg.inv(K)
    M, C = inverse @ M, inverse @ C
    if np.abs(C).max() <= 1e-9 * np.sqrt(np.abs(M).max()):
        slow = np.linalg.eigvals(M)
        slow = np.sqrt(-slow.astype(complex))
        slow = np.concatenate([slow, -slow])
    else:
        slow = np.linalg.eigvals(np.block([[-C, -M], [np.eye(n), np.zeros((n, n))]]))
    slow = slow[np.abs(slow) > 1e-9 * np.abs(slow).max(initial=1e-300)]
    found = 1.0 / slow
    return np.asarray(found[np.argsort(np.abs(found))])


def _slow(poles: Array, T: float, step: float) -> Any:
    """Whether each pole rings throughout the path, and the grid can resolve it."""
    ringing = (np.abs(poles.real) * T < _RINGING) & (np.abs(poles.real) < _LIGHTLY * np.abs(poles))
    return ringing & (np.abs(poles) * step < _RESOLVED)


def _padding(poles: Array, side: int, T: float, step: float, decay: float) -> float:
    """Time in which the motion on one side decays by exp(decay), by its poles without those that ring throughout; of
    the poles that the grid resolves."""
    rates = (side * poles.real)[(np.abs(poles) * step < _RESOLVED) & ~_slow(poles, T, step)]
    slowest = rates[rates > 0].min(initial=np.inf)
    return float(decay / slowest) if np.isfinite(slowest) else 0.0


def _buffer(poles: Poles, T: float, step: float) -> float:
    """Time in which ringing dies out under added damping; 0 if different poles ring at both ends: some of them then
    belong to the motion ahead of the path, which must not be damped."""
    seen = [np.abs(p[_slow(p, T, step)]) for p in poles]
    known = [np.abs(p[_slow(p, T, 0.0)]) for p in poles]
    for here, there in ((seen[0], known[1]), (seen[1], known[0])):
        if any(not (np.abs(there - w) < _CHANGED * w).any() for w in here):
            return 0.0
    ringing = np.concatenate(seen)
    return 1.5 * DECAY / float(ringing.min()) if len(ringing) else 0.0


def solve(equations: Equations, path: Path, start: Array, method: str, tolerance: float,
           window: tuple[float | None, ...]) -> tuple[Motions, int, Poles]:  # fmt: skip
    solver, T = Solver(equations, path, equations.along(path, start)), path.end - path.begin
    dynamic = method == "stable" and len(equations.inner) > 0
    decay = max(2.0 + np.log(equations.length / tolerance), 4.0)
    none = np.zeros(0, dtype=complex)
    poles = (none, none)
    if dynamic:
        ends = zip(*solver.ends, equations.held(solver.poses.q[[0, -1]]), strict=True)
        start_poles, end_poles = (_poles(*matrices) for matrices in ends)
        poles = (start_poles, end_poles)
    count, longer, total, found, best, buffered = _FIRST_COUNT, [1.0, 1.0], 0, None, None, True
    for _ in range(_ROUNDS):
        step = T / count
        before, after = (factor * _padding(p, side, T, step, decay) if given is None else given
                         for factor, p, side, given in zip(longer, poles, (1, -1), window, strict=True))  # fmt: skip
        nodes = [int(np.ceil(x / step)) for x in (before, after, buffered * _buffer(poles, T, step))]
        if count + sum(nodes) > MOST:
            break
        grid = Grid(path, solver.poses, count, max(_LEAST, nodes[0]), max(_LEAST, nodes[1]), nodes[2])
        guess = solver.first_guess(grid) if found is None else solver.refined(grid, found)
        try:
            found = solver.solve(grid, guess, tolerance) if method != "quasi-static" else solver.still(grid, guess)
        except NotConverged:
            if best is not None and best.error < _ROUGH * tolerance:
                break
            if count > 4 * _FIRST_COUNT and not nodes[2]:
                raise
            count, found, buffered = count if nodes[2] else int(1.7 * count), None, not nodes[2]
            continue
        total += found.iterations
        rings = any(_slow(p, T, step).any() for p in poles)
        short = [k for k, edge in enumerate(found.edges) if edge > tolerance and longer[k] < 5]
        if found.error > tolerance:
            if best is not None and found.error > 0.5 * best.error and best.error < _ROUGH * tolerance:
                break  # a finer grid follows still faster poles
            count = int(count * np.clip(1.2 * (found.error / tolerance) ** (1 / 6), 1.3, 2.5))
        elif short and not rings and window == (None, None):
            longer = [1.6 * factor if k in short else factor for k, factor in enumerate(longer)]
        else:
            return found, total, poles
        best = found if best is None or found.error < best.error else best
    if best is not None and best.error < _ROUGH * tolerance:
        return best, total, poles
    left = f": with {before:.3g} s ahead of it and {after:.3g} s after, more than {MOST} steps would be needed"
    if best is not None:
        left = f": {best.error:.2g} m is left at steps of {best.step:.2g} s"
    raise ValueError(
        f"tip: the path is too rough for tolerance = {tolerance:g} m{left}; give it more continuous derivatives, more "
        "time, or allow a larger tolerance"
    )


def check_rest(path: Path, found: Motions, poles: Poles, tolerance: float) -> str:
    """A warning for an arm that does not come to rest; "" if it does.

    Raises:
        ValueError: the vibration is large compared with the path."""
    edge = max(found.edges)
    if edge <= 10 * tolerance:
        return ""
    T = path.end - path.begin
    ringing = np.abs(np.concatenate([p[_slow(p, T, found.step)] for p in poles]))
    slow = ", ".join(f"{w:.4g}" for w in sorted({float(f"{w:.4g}") for w in ringing})[:4])
    why = "its internal dynamics die out too slowly"
    if len(ringing):
        why = f"its internal dynamics have zeros on or near the imaginary axis, at {slow} rad/s, and ring"
    text = (
        f"the arm does not come to rest while its tip does: {why}; its end still moves by {edge:.2g} m on the "
        "joints held, and replay() tells how far that carries the tip off; damp the beams (damping_ratio), slow or "
        "smooth the path, take another slice or other components of the tip, or more pre and post"
    )
    moved = float(np.ptp(path(found.t), axis=0).max())
    if edge > _MOST_LEFT * moved:
        raise ValueError(f"tip: there is no inverse that comes to rest: {text}")
    return text
