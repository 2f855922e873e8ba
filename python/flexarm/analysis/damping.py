"""Damping of beams, given by the modes of the whole arm, or found from a decay."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._check import Array, array, at_least, not_negative, number, whole
from ..model.acting.load import Load, at_time
from ..model.parts.chain import Chain
from .modes import Modes, SmallMotions, small_motions

Kind = TypeVar("Kind", bound=Chain)

_ROUNDS = 20  # of Newton's iteration
_CLOSE, _NEAR = 1e-12, 1e-9  # ratio to which it is brought, and with which it is content
_OTHERS = 1e-3  # weight of modes that are not named
_SAME = 1e-6  # by which frequencies may differ, as a part, that count as equal
_MOST = 0.5  # damping ratio: those given are of modes that ring


def with_damping(arm: Kind, D: Array) -> Kind:
    """The arm, with each beam's block of D (nv, nv) added to its damping."""
    links = list(arm.links)
    for k, beam, _, at in arm.beams():
        more = D[at, at] + (np.array(beam.damping) if beam.damping else 0.0)
        links[k] = replace(links[k], beam=replace(beam, damping=(0.5 * (more + more.T)).tolist()))
    return arm._alike(links, arm.gravity)


def _wanted(ratios: Any, frequencies: Array) -> dict[int, float]:
    """Damping ratio by mode."""
    if isinstance(ratios, Mapping):
        items = [(whole("ratios: mode", mode), ratio) for mode, ratio in ratios.items()]
    elif np.ndim(ratios):
        items = list(enumerate(ratios))
    else:
        items = [(k, ratios) for k in np.flatnonzero(frequencies).tolist()]
    out = {}
    for mode, ratio in items:
        if not 0 <= mode < len(frequencies):
            raise ValueError(f"ratios: mode = {mode}: must be from 0 to {len(frequencies) - 1}, the modes of this arm")
        out[mode] = value = number(f"ratios[{mode}]", ratio)
        if not 0 <= value < _MOST:
            raise ValueError(f"ratios[{mode}] = {ratio}: must be from 0 to below {_MOST}; 2 % is 0.02")
        if not frequencies[mode] > 0:
            raise ValueError(f"ratios[{mode}] = {ratio}: mode {mode} does not vibrate, its frequency is zero")
    if not out:
        raise ValueError(f"ratios = {ratios!r}: must be a ratio, a list of them, or a dictionary by mode")
    return out


def _patterns(arm: Chain, found: SmallMotions, shapes: Array) -> list[tuple[slice, Array]]:
    """Vectors u of which u u^T is a damping matrix of one beam, and where its coordinates stand in v. For each of some
    modes, and each beam, that which damps the mode and others as little as the beam can: of an arm with one beam, not
    at all."""
    parts, M = [at for *_, at in arm.beams()], found.mass
    at = np.concatenate([np.arange(s.start, s.stop) for s in parts])
    moving = np.setdiff1d(np.flatnonzero(found.free), at)  # joints that give way: the rest of the inertia
    G = np.zeros_like(M)
    G[np.ix_(at, at)] = M[np.ix_(at, at)]
    if moving.size:
        G[np.ix_(at, at)] -= M[np.ix_(at, moving)] @ np.linalg.solve(M[np.ix_(moving, moving)], M[np.ix_(moving, at)])
    out = []
    for s in parts:
        out += [(s, u) for u in (G @ shapes)[s].T if np.linalg.norm(u) > 1e-12 * np.linalg.norm(G[s])]
    return out


def modal_damping(
    arm: Kind,
    ratios: Any,
    q: ArrayLike | None = None,
    lock: Iterable[Any] | None = None,
    *,
    loads: Sequence[Load] | None = None,
    t: float = 0.0,
) -> Kind:
    """The same arm with beams damped so that its modes have given damping ratios, payload included
    (`Beam.damping_ratio` is that of the bare clamped beam).

    Other modes keep their damping if the arm has one beam. With several, each beam is damped separately, and other
    modes get some damping, too. For one beam with all modes it is the classical modal damping (Caughey 1960). Each
    beam's share is in its `damping`.

    Args:
        ratios: {mode: ratio}, numbered as in `modes(q, lock=lock)` without damping; a list, from mode 0 on; or one
            number for all modes. 2 % is 0.02.
        q, lock, loads, t: as of `modes`.

    Raises:
        ValueError: a mode that does not exist, does not vibrate, or bends no beam; a ratio below the present
            damping.
    """
    arm.refuse_loops("modal_damping", rigid=True)
    found = small_motions(arm, q, None, lock, at_time(arm, loads, t))
    modes = found.undamped()
    wanted = _wanted(ratios, modes.frequencies)
    if np.iscomplexobj(modes.shapes):
        raise ValueError("modal_damping: the forces here are not those of a potential; its modes have no real shapes")
    if not any(arm.beams()):
        raise ValueError("modal_damping: the arm has no beam that bends")
    reached = {k for k in wanted for *_, s in arm.beams() if np.abs(modes.shapes[s, k]).max() > 1e-9}
    for k in sorted(wanted.keys() - reached):
        raise ValueError(f"ratios[{k}]: mode {k} bends no beam, so that no damping of beams reaches it")
    rings = np.flatnonzero(modes.frequencies)
    mass = np.einsum("ik,ij,jk->k", modes.shapes[:, rings], found.mass, modes.shapes[:, rings])
    unit = modes.shapes[:, rings] / np.sqrt(2 * modes.frequencies[rings] * mass)  # of which x D x is a ratio
    named = np.array([int(np.flatnonzero(rings == k)[0]) for k in wanted])
    few = _sums(_patterns(arm, found, modes.shapes[:, list(wanted)]), unit, named)
    D, now, goal = _fitted(found, modes, named, wanted, few)
    if np.abs(now - goal).max() > _NEAR:
        D, now, goal = _fitted(found, modes, named, wanted, _any(found, unit, modes.frequencies[rings], named))
    if np.abs(now - goal).max() > _NEAR:
        raise ValueError(_refused(wanted, now))
    return with_damping(arm, D)


def _refused(wanted: Mapping[int, float], now: Array) -> str:
    """Says which ratios exclude each other, and the nearest that do not."""
    off = dict(zip(wanted, now - np.array(list(wanted.values())), strict=True))
    least = 1e-3 * max(map(abs, off.values()))
    less, more = ([k for k, x in off.items() if sign * x > least] for sign in (-1, 1))
    if not less:
        why = f"modes {more} cannot have so little: beams and joints have more already"
    else:
        why = f"modes {less} cannot have so much" + f" while modes {more} have so little" * bool(more)
        why += ": damping of one is damping of others"
    nearest = {k: round(float(x), 10) for k, x in zip(wanted, now, strict=True)}
    return f"ratios = {dict(wanted)}: {why}; the nearest that can be is ratios={nearest}"


#: Finds a damping matrix (nv, nv) by the ratios that it shall add to all modes that ring.
_Solve = Callable[[Array], Array]


def _fitted(
    found: SmallMotions, modes: Modes, named: NDArray[np.intp], wanted: Mapping[int, float], solve: _Solve
) -> tuple[Array, Array, Array]:
    """A damping matrix (nv, nv) that gives the ratios that are wanted, or the nearest; the ratios that it gives, and
    those wanted."""
    goal, numbers = np.array(list(wanted.values())), list(wanted)
    at = np.ix_(found.free, found.free)
    aim = np.zeros(np.count_nonzero(modes.frequencies))
    aim[named] = goal - _ratios(found, modes.shapes[:, numbers], np.zeros_like(found.M))
    first: tuple[Array, Array, Array] | None = None
    for k in range(_ROUNDS):
        D = solve(aim)
        now = _ratios(found, modes.shapes[:, numbers], D[at])
        off = np.abs(now - goal).max()
        first = first or (D, now, goal)  # out of reach: an aim beyond it leads only farther off
        if off < _CLOSE or (k > 2 and off > 0.5 * np.abs(first[1] - goal).max()):
            break
        aim[named] += goal - now
    assert first is not None
    return (D, now, goal) if off <= _NEAR else first


def _sums(patterns: list[tuple[slice, Array]], unit: Array, named: NDArray[np.intp]) -> _Solve:
    """By sums of patterns that change modes without a name as little as they can."""
    from scipy.optimize import nnls  # slow to import

    slope = np.array([[(u @ shape[s]) ** 2 for s, u in patterns] for shape in unit.T])  # small ratios add up
    size = slope.max(axis=0)
    weight = _weights(unit, named)

    def solve(aim: Array) -> Array:
        times = nnls(weight[:, None] * slope / size, weight * aim, maxiter=100 * len(patterns))[0] / size
        D = np.zeros((len(unit), len(unit)))
        for x, (s, u) in zip(times, patterns, strict=True):
            D[s, s] += x * np.outer(u, u)
        return D

    return solve


def _weights(unit: Array, named: NDArray[np.intp]) -> Array:
    weight = np.full(unit.shape[1], _OTHERS)
    weight[named] = 1.0
    return weight


def _any(found: SmallMotions, unit: Array, frequencies: Array, named: NDArray[np.intp]) -> _Solve:
    """By any damping matrix of each beam, C X X^T C^T: positive semidefinite, so that every one is looked at. It must
    not couple a mode that has a name with another of the same frequency: then neither would be a mode."""
    from scipy.optimize import least_squares  # slow to import

    parts = [s for *_, s in found.arm.beams()]
    C = [np.linalg.cholesky(found.mass[s, s]) for s in parts]
    Y = [c.T @ unit[s] for c, s in zip(C, parts, strict=True)]  # by beam (ne, modes)
    weight, n, most = _weights(unit, named), len(frequencies), max(float((y**2).sum(axis=0).max()) for y in Y)
    alike = np.abs(frequencies[:, None] - frequencies) < _SAME * frequencies
    alike &= (np.isin(range(n), named))[:, None] | np.isin(range(n), named)
    pairs = list(zip(*np.nonzero(np.triu(alike, 1)), strict=True))
    rows = [(k, k, weight[k]) for k in range(n)] + [(i, j, 1.0) for i, j in pairs]
    I, J = (np.array([row[k] for row in rows]) for k in (0, 1))
    scale, cuts = np.array([row[2] for row in rows]), np.cumsum([len(y) ** 2 for y in Y])[:-1]

    def split(x: Array) -> list[Array]:
        return [part.reshape(len(y), len(y)) for part, y in zip(np.split(x, cuts), Y, strict=True)]

    def left(x: Array, aim: Array) -> Array:
        ratios = sum(np.einsum("ak,ak->k", (Z := X.T @ y)[:, I], Z[:, J]) for X, y in zip(split(x), Y, strict=True))
        return np.asarray(scale * (ratios - aim) / most)

    def slope(x: Array, _: Array) -> Array:
        out = []
        for X, y in zip(split(x), Y, strict=True):
            Z = X.T @ y
            dX = np.einsum("ak,bk->kab", y[:, I], Z[:, J]) + np.einsum("ak,bk->kab", y[:, J], Z[:, I])
            out.append((scale[:, None, None] * dX / most).reshape(len(rows), -1))
        return np.hstack(out)

    start = np.concatenate([np.eye(len(y)).ravel() for y in Y])

    def solve(aim: Array) -> Array:
        size = max(float(np.abs(aim).max()), _NEAR)
        wanted = np.concatenate([aim, np.zeros(len(pairs))]) * most / size
        x = least_squares(left, start, slope, args=(wanted,), xtol=1e-15, ftol=1e-15, gtol=1e-15, max_nfev=300).x
        D = np.zeros((len(unit), len(unit)))
        for X, c, s in zip(split(x), C, parts, strict=True):
            D[s, s] = size / most * (c @ X) @ (c @ X).T
        return D

    return solve


def _ratios(found: SmallMotions, shapes: Array, C: Array) -> Array:
    """Damping ratios with this damping, of the modes that look most like these."""
    damped, M = found.solve(C), found.mass
    alike = np.abs(shapes.T @ M @ damped.shapes) ** 2
    size = np.einsum("ik,ij,jk->k", damped.shapes.conj(), M, damped.shapes).real
    return np.asarray(damped.damping[(alike / size).argmax(axis=1)])


def rayleigh_damping(arm: Kind, mass: float = 0.0, stiffness: float = 0.0) -> Kind:
    """The same arm with beams damped in proportion to their inertia and stiffness: `mass` (1/s) times the inertia
    of each beam's coordinates, payload included, at q = `zero`; `stiffness` (s) times their stiffness. A mode of
    frequency w then has a ratio of about mass / (2 w) + stiffness w / 2."""
    mass, stiffness = not_negative("mass", mass), not_negative("stiffness", stiffness)
    M = arm._core.mass_matrix(arm.zero)
    D = np.zeros((arm.nv, arm.nv))
    for _, beam, _, at in arm.beams():
        D[at, at] = mass * M[at, at] + stiffness * np.asarray(beam._core.stiffness)
    return with_damping(arm, D)


@dataclass(frozen=True)
class Decay:
    """Vibrations that die away, as a sum of exponentials.

    Attributes:
        frequencies: undamped, |s| (rad/s), ascending, (n,).
        damping: ratios -Re(s)/|s|, (n,); `Arm.modal_damping` takes them.
        amplitudes: at the first sample, (n,) or (n, k) where there are k signals.
        residual: root mean square of the misfit, over that of the signals (without their means).
    """

    frequencies: Array
    damping: Array
    amplitudes: Array
    residual: float


def fit_decay(t: ArrayLike, y: ArrayLike, modes: int = 1) -> Decay:
    """Frequencies and damping ratios of a measured free decay.

    The signal is a deflection, strain or acceleration, or several of them.

    The matrix pencil method (Hua & Sarkar 1990) on samples at equal steps, then nonlinear least squares. Constant
    offsets are fitted, too.

    Args:
        t: times (s), at equal steps, (nt,).
        y: (nt,), or (nt, k) of k signals that ring in the same modes.
        modes: how many vibrations to look for.

    Raises:
        ValueError: bad shapes or values, times at unequal steps, or fewer vibrations than were asked for.
    """
    from scipy.optimize import least_squares  # slow to import

    t, y, n = array("t", t), array("y", y), at_least("modes", modes, 1)
    rows = y[:, None] if y.ndim == 1 else y
    if t.ndim != 1 or rows.ndim != 2 or len(rows) != len(t):
        raise ValueError(f"t, y have shapes {t.shape}, {y.shape}: must be (nt,) and (nt,) or (nt, k)")
    if len(t) < 8 * n:
        raise ValueError(f"t: {len(t)} samples are too few for {n} modes; give {8 * n} at least")
    step = (t[-1] - t[0]) / (len(t) - 1)
    if not (step > 0 and np.abs(np.diff(t) - step).max() < 1e-3 * step):
        raise ValueError("t: must increase by equal steps")
    centred = rows - rows.mean(axis=0)
    size = float(np.sqrt((centred**2).mean()))
    if size == 0:
        raise ValueError("y: is constant")
    s = _pencil(centred, n, step)
    if len(s) < n:
        raise ValueError(f"modes = {modes}: only {len(s)} vibrations are found in y")
    time = t - t[0]

    def basis(x: Array) -> Array:
        w, z = np.abs(x[:n]), x[n:]
        decay = np.exp(-np.outer(time, z * w))
        turn = np.outer(time, w * np.sqrt(np.maximum(1e-12, 1 - z**2)))
        return np.hstack([decay * np.cos(turn), decay * np.sin(turn), np.ones((len(t), 1))])

    def left(x: Array) -> Array:  # variable projection: amplitudes are linear
        A = basis(x)
        return ((rows - A @ np.linalg.lstsq(A, rows, rcond=None)[0]) / size).ravel()

    start = np.concatenate([np.abs(s), -s.real / np.abs(s)])
    scale = np.concatenate([np.abs(s), np.full(n, 0.01)])
    found = least_squares(left, start, x_scale=scale, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    order = np.argsort(np.abs(found.x[:n]))
    parts = np.linalg.lstsq(basis(found.x), rows, rcond=None)[0]
    amplitudes = np.hypot(parts[:n], parts[n : 2 * n])[order]
    residual = float(np.sqrt((found.fun**2).mean()))
    single = amplitudes[:, 0] if y.ndim == 1 else amplitudes
    return Decay(np.abs(found.x[:n])[order], found.x[n:][order], single, residual)


def _pencil(y: Array, n: int, step: float) -> Array:
    """Of the strongest vibrations, s (1/s) with a positive imaginary part, at most n."""
    every = max(1, len(y) // 1200)  # a pencil of some hundred rows tells
    y, step = y[::every], step * every
    L = len(y) // 3
    H = np.vstack([np.lib.stride_tricks.sliding_window_view(column, L + 1) for column in y.T])
    rank = min(2 * n + 1, L)  # with the rest of the mean
    rows = np.linalg.svd(H, full_matrices=False)[2][:rank].conj()
    z = np.linalg.eigvals(np.linalg.pinv(rows[:, :-1].T) @ rows[:, 1:].T)
    s = np.log(z[np.abs(z) > 0].astype(complex)) / step
    s = s[s.imag > 0]
    if len(s) > n:
        E = np.exp(np.outer(np.arange(len(y)) * step, s))
        size = np.abs(np.linalg.lstsq(np.hstack([E, E.conj()]), y.astype(complex), rcond=None)[0][: len(s)]).max(axis=1)
        s = s[np.argsort(size)[-n:]]
    return np.asarray(s)
