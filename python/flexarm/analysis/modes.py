"""Natural frequencies and modes about a steady spin."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._check import Array, array, at_least, finite, positive, whole, within
from .._console import aligned
from ..data.draw.modes import plot_modes
from ..data.draw.style import Figure
from ..model.acting.load import Load, at_time
from ..model.parts.chain import Chain
from ..view.body import length
from ..view.view import View, animate_mode
from .assembly import Closure
from .closed import holding, reduced, turning
from .equilibrium import steady_state
from .rates import locked_rates


@dataclass(frozen=True)
class Modes:
    """Small free motions about a steady state, in ascending frequency.

    Attributes:
        frequencies: |s| (rad/s), shape (n,): undamped natural frequencies of oscillations. Zero for a rigid-body
            motion, or a mode that is lost to divergence (then `damping` is -1). An overdamped mode stands twice, once
            for each of its real roots (damping 1): then n is above the number of free coordinates.
        damping: ratios -Re(s)/|s|, shape (n,); negative when unstable.
        shapes: one column a mode, shape (nv, n); locked coordinates are zero, the largest entry is 1. Complex when
            gyroscopic or damped.
        participation: share of each coordinate in a mode's kinetic energy, shape (nv, n), columns adding up to 1.
        eigenvalues: s (1/s), shape (n,); of each conjugate pair the one with Im(s) > 0, and every real one.
        q: the steady state, shape (nq,).
        arm: whose they are.
    """

    frequencies: Array
    damping: Array
    shapes: NDArray[Any]
    participation: Array
    eigenvalues: NDArray[np.complex128]
    q: Array
    arm: Chain = field(repr=False, compare=False)

    @property
    def stable(self) -> bool:
        """Whether no mode grows."""
        return bool((self.eigenvalues.real <= 1e-9 * np.abs(self.eigenvalues)).all())

    def __str__(self) -> str:
        return self._table()

    def _table(self, most: int = 16) -> str:
        """The text of the lowest modes: numbers from 0, as `shapes` and `animate` count them."""
        rows = [["mode", "rad/s", "Hz", "damping ratio", "most of its energy in"]]
        for k, (w, s) in enumerate(zip(self.frequencies[:most], self.eigenvalues, strict=False)):
            where = int(self.participation[:, k].argmax())
            part = f"{self.arm.coordinates[where]} ({100 * self.participation[where, k]:.0f} %)"
            ratio = f"{self.damping[k]:.4g}" if w else "grows" if s.real > 0 else "rigid"
            rows.append([str(k), f"{w:.6g}", f"{w / (2 * np.pi):.6g}", ratio, part])
        rest = len(self.frequencies) - most
        return "\n".join([*aligned(rows, range(4)), *([f"... and {rest} more modes, which are faster"] * (rest > 0))])

    def plot(self, count: int = 4) -> Figure:
        """A figure of the lowest `count` modes along the arm: how far each slice moves along the world's axes, over the
        place along the arm, each mode's largest displacement being 1. Frequency and damping stand in the legend. Of a
        tree, each branch has a line of its own from where it begins, over the way from the world.

        Modes that only turn about the arm's axis, or do not vibrate (frequency 0), are left out. A complex mode is
        drawn at the instant of its largest displacement.

        Raises:
            ValueError: a count below 1, or no mode that moves the arm's axis.
        """
        at_least("count", count, 1)
        shapes = mode_shapes(self.arm, self, 41)
        first = np.searchsorted(shapes.link, np.arange(len(self.arm.links)))
        seats, joints = self._seats()
        path = np.insert(shapes.position, first, joints, axis=0)  # each joint ahead of its link
        at = first + np.arange(len(first))
        steps = np.diff(path, axis=0, prepend=np.zeros((1, 3)))
        steps[at] = path[at] - seats
        s = np.linalg.norm(steps, axis=1).cumsum()
        for k, (parent, x) in enumerate(self.arm.seats):
            if (parent, x) != (k - 1, None):  # a branch begins where it sits
                near = _point(shapes, parent, x) if parent >= 0 else -1
                s[at[k] :] -= s[at[k] - 1]
                if parent >= 0:
                    s[at[k] :] += s[near + parent + 1] + (0.0 if x is None else x - shapes.x[near])
        turned = np.abs(shapes.displacement).max(axis=(0, 1), initial=0.0)
        noise = 1e-9 * max(length(self.arm), float(turned.max(initial=0.0)))
        shown = np.flatnonzero((self.frequencies > 0) & (turned > noise))[:count]
        if not shown.size:
            raise ValueError("modes: none of them vibrates and moves the arm's axis; there is nothing to draw")
        flat = shapes.displacement[:, :, shown].reshape(-1, shown.size)
        largest = flat[np.abs(flat).argmax(axis=0), np.arange(shown.size)]
        moved = np.real(flat / largest).reshape(*shapes.displacement.shape[:2], shown.size)
        hertz, percent = self.frequencies / (2 * np.pi), 100 * self.damping
        labels = [f"mode {k}: {hertz[k]:.4g} Hz, damping {percent[k]:.3g} %" for k in shown]
        names = [(float(s[at[k]]), self.arm.links[k].joint.name or self.arm.names[k]) for k in self.arm.movable]
        return plot_modes(np.delete(s, at), moved, labels, names, self._branches(shapes))

    def _branches(self, shapes: ModeShapes) -> dict[str, list[int]]:
        """The points along each line that is drawn, from the point where it leaves another one. By the name of the link
        at its end."""
        out: dict[str, list[int]] = {}
        drawn = set[int]()
        for end in self.arm.ends:
            new = [end]
            parent, x = self.arm.seats[end]
            while parent >= 0 and x is None and parent not in drawn:
                new.insert(0, parent)
                parent, x = self.arm.seats[parent]
            drawn.update(new)
            out[self.arm.names[end]] = [
                *([_point(shapes, parent, x)] if parent >= 0 else []),
                *(i for k in new for i in np.flatnonzero(shapes.link == k).tolist()),
            ]
        return out

    def _seats(self) -> tuple[Array, Array]:
        """Where links sit on their parents, and where their joints are, (number of links, 3)."""
        seats, joints = [], []
        for link, (parent, x) in zip(self.arm.links, self.arm.seats, strict=True):
            p, R = (np.zeros(3), np.eye(3)) if parent < 0 else self.arm.frame(self.q, parent, x)
            place = link.joint.inboard
            seats.append(p)
            joints.append(p if place is None else p + R @ place._core[0])
        return np.array(seats), np.array(joints)

    def animate(self, mode: int = 0, amplitude: float | None = None) -> View:
        """A mode in 3-D, over one period again and again, without its decay: a View, which shows itself in a notebook;
        `.open()` shows it in a browser, `.save("mode.html")`, ".png", ".gif", ".mp4" writes it.

        Args:
            mode: its number, from 0; -1 is the last.
            amplitude: the largest displacement of any point (m); None: a tenth of the arm's length, and a turn of half
                a radian at most. A mode has no size of its own. Far above that the shape is no longer the mode's.

        Raises:
            ValueError: no such mode, an amplitude that is not above zero.
        """
        n = len(self.frequencies)
        within("mode", whole("mode", mode), -n, n - 1, ", the modes that were found")
        motion = np.array([self.arm.jacobian(self.q, *at) @ self.shapes[:, mode] for at in _places(self.arm, 9)])
        moved, turned = (float(np.linalg.norm(part, axis=1).max()) for part in (motion[:, :3], motion[:, 3:]))
        if amplitude is None:
            share = min(0.1 * length(self.arm) / max(moved, 1e-300), 0.5 / max(turned, 1e-300))
        else:
            if not moved > 0:
                raise ValueError(f"amplitude = {amplitude!r}: mode {mode} moves no point, and has none")
            share = positive("amplitude", amplitude, "m") / moved
        about = (float(self.frequencies[mode]), float(self.damping[mode]), mode % n, share * moved)
        return animate_mode(self.arm, self.q, share * self.shapes[:, mode], *about)


@dataclass(frozen=True)
class ModeShapes:
    """Modes as displacements of points along the arm, about the steady state.

    Attributes:
        link: the link of each point, (np,).
        x: its place along that link's beam (m), (np,); nan for the end of a link.
        position: of the points in the steady state, world axes (m), (np, 3).
        displacement: of the points in each mode, world axes, (np, 3, n), to the scale of `Modes.shapes` (m per unit of
            the largest coordinate); complex where those are. The motion is the real part of displacement e^(s t).
    """

    link: NDArray[np.int_]
    x: Array
    position: Array
    displacement: NDArray[Any]


def _places(arm: Chain, points: int) -> list[tuple[int, float | None]]:
    """Links and places along their beams, evenly spaced (m), with the end of each link, None."""
    along = [np.linspace(0.0, x.beam.length, points).tolist() if x.beam else [] for x in arm.links]
    return [(k, x) for k, places in enumerate(along) for x in (*places, None)]


def _point(shapes: ModeShapes, link: int, x: float | None) -> int:
    """The sampled point of a link that is nearest to a place on its beam; None: its end."""
    own = np.flatnonzero(shapes.link == link)
    return int(own[-1] if x is None else own[np.nanargmin(np.abs(shapes.x[own] - x))])


def mode_shapes(arm: Chain, modes: Modes, points: int = 21) -> ModeShapes:
    """Modes sampled along the arm: at `points` slices of every beam, from clamp to tip, and at every link's end.

    Returns:
        ModeShapes: `.link`, `.x`, `.position` (np, 3), `.displacement` (np, 3, n).

    Raises:
        ValueError: modes of another arm, or fewer than two points.
    """
    if not isinstance(modes, Modes) or modes.q.shape != (arm.nq,) or len(modes.shapes) != arm.nv:
        raise ValueError("modes: must be a result of this arm's `modes`")
    places = _places(arm, at_least("points", points, 2))
    position = np.array([arm.frame(modes.q, k, x)[0] for k, x in places])
    moved = np.array([arm.jacobian(modes.q, k, x)[:3] @ modes.shapes for k, x in places])
    return ModeShapes(
        np.array([k for k, _ in places]), np.array([np.nan if x is None else x for _, x in places]), position, moved
    )


@dataclass(frozen=True)
class SmallMotions:
    """M dv + G v + K q = 0 about a steady state."""

    arm: Chain
    q: Array  #: the state, (nq,)
    free: NDArray[np.bool_]  #: which rates are not locked, (nv,)
    M: Array  #: it, G and K are of the free coordinates; of an arm with rigid loops, of the motions T
    G: Array
    K: Array
    T: Array | None = None  #: (nv, n), that loops and locked joints leave; None: each free coordinate is one

    def solve(self, C: Array | float = 0.0) -> Modes:
        """The modes, with further damping C."""
        with np.errstate(all="ignore"):  # scaled so that M has a unit diagonal
            d = finite("modes: the root of the masses", 1.0 / np.sqrt(np.diag(self.M)))
            M, G, K = (finite("modes, scaled by the masses", d[:, None] * x * d) for x in (self.M, self.G + C, self.K))
        if np.linalg.eigvalsh(M)[0] < -1e-12:
            raise ValueError(
                "q: the mass matrix is not positive definite here; beams of order 0 are for small deflections"
            )
        size = float(np.abs(K).max()) or 1.0
        conservative = np.abs(G).max() <= 1e-13 * np.sqrt(size) and np.abs(K - K.T).max() <= 1e-10 * size
        s, vectors = _conservative(M, K) if conservative else _general(M, G, K)

        shapes = self.shapes(d[:, None] * vectors)
        largest = np.abs(shapes).argmax(axis=0)
        shapes = shapes / shapes[largest, np.arange(s.size)]
        radius = np.abs(s)
        oscillates = np.abs(s.imag) > 1e-9 * radius
        frequencies = np.where(oscillates | ((s.real < 0) & (radius > 0)), radius, 0.0)
        with np.errstate(invalid="ignore", divide="ignore"):
            damping = np.where(radius > 0, -s.real / radius, 0.0)
        damping[np.abs(damping) < 1e-12] = 0.0
        share = np.zeros(shapes.shape)
        if self.T is not None:
            share = np.abs(np.real(np.conj(shapes) * (self.mass @ shapes)))
        else:
            share[self.free] = np.abs(np.real(np.conj(vectors) * (M @ vectors)))
        share /= share.sum(axis=0)
        up = np.lexsort((radius, frequencies))
        return Modes(frequencies[up], damping[up], shapes[:, up], share[:, up], s[up], self.q, self.arm)

    def shapes(self, found: NDArray[Any]) -> NDArray[Any]:
        """Motions of all rates, (nv, ...), of those of M, G and K, (n, ...)."""
        if self.T is not None:
            return np.asarray(self.T @ found)
        out = np.zeros((self.arm.nv, *found.shape[1:]), dtype=found.dtype)
        out[self.free] = found
        return out

    @property
    def mass(self) -> Array:
        """The mass matrix of all coordinates, (nv, nv); zero where they are locked, but for an arm with loops."""
        if self.T is not None:
            return np.asarray(self.arm._core.mass_matrix(self.q))
        whole = np.zeros((self.arm.nv, self.arm.nv))
        whole[np.ix_(self.free, self.free)] = self.M
        return whole

    def undamped(self) -> Modes:
        """The modes without damping, and without gyroscopic forces."""
        return replace(self, G=np.zeros_like(self.G)).solve()


def small_motions(
    arm: Chain,
    q: ArrayLike | None = None,
    speed: Mapping[Any, float] | None = None,
    lock: Iterable[Any] | None = None,
    loads: Any = (),
) -> SmallMotions:
    """Those whose modes `modes` finds; `loads` as of `at_time`."""
    q0 = arm.zero if q is None else arm._single(q=q)[0]
    v0 = np.zeros(arm.nv)
    for i, value in arm.by_rate("speed", speed).items():
        v0[i] = array("speed", value, ())
    free = ~locked_rates(arm, lock)
    if not free.any():
        raise ValueError("lock: no coordinate is left to move")
    if not np.isfinite(arm._core.inverse_dynamics(q0, v0, np.zeros(arm.nv), *loads)).all():
        raise ValueError("speed, q: are too large, the forces there are not finite")
    return motions_about(arm, steady_state(arm, q0, v0, loads), v0, loads, free)


def motions_about(
    arm: Chain, q: Array, v: Array, loads: Any = (), free: NDArray[np.bool_] | None = None
) -> SmallMotions:  # fmt: skip
    """Of the free rates, all if None, about q (nq,) and v (nv,), whose accelerations are left out; of an arm with rigid
    loops, the forces that keep these are those of the joints that are not free, and of others where they must be."""
    free = np.ones(arm.nv, bool) if free is None else free
    if arm.constrained:
        closure = Closure(arm)
        tau = holding(arm, closure, q, v, loads, ~free)
        r = reduced(arm, closure, q, v, tau, free, loads)
        if not r.K.size:
            raise ValueError("lock: no motion is left")
        K = r.K - r.C @ r.W
        return SmallMotions(arm, q, free, np.eye(len(K)), r.C + r.W, K, r.T)
    by_q, by_v = (finite("inverse derivatives", x) for x in arm._core.inverse_derivatives(q, v, 0.0 * v, *loads))
    _, _, E = arm._core.rates(q, v)  # dq = E v: small turns of a ball move its quaternion so
    M, W = arm._core.mass_matrix(q), turning(arm, v)
    # dv = d(theta)/dt + W theta: a ball's turn theta is measured in axes that turn with it
    G, K, at = by_v + M @ W, by_q @ E + by_v @ W, np.ix_(free, free)
    return SmallMotions(arm, q, free, M[at], G[at], K[at])


def locked_modes(arm: Chain) -> Modes:
    """About zero, with all joints locked, without gravity; loops are open."""
    return modes(arm._alike(arm.links, loops=()), lock=arm.movable)


def modes(
    arm: Chain,
    q: ArrayLike | None = None,
    speed: Mapping[Any, float] | None = None,
    lock: Iterable[Any] | None = None,
    *,
    loads: Sequence[Load] | None = None,
    t: float = 0.0,
) -> Modes:
    """Natural frequencies and modes about a steady state.

    The joints rest at q (zero if None) or move at constant `speed`, under the required forces; the elastic
    coordinates are in equilibrium (found from q by Newton's iteration). Rigid loops must be closed at q, and stay
    closed in each mode; take q from `equilibrium` or `assemble`. The forces are those of the locked joints then,
    and of others only where those are not enough.

    Args:
        q: (nq,), or as `pose` takes it: {"elbow": 0.3}.
        speed: joint rates by link, or by (link, freedom) (rad/s, m/s).
        lock: links whose joints follow that motion exactly; the others vibrate about it.
        loads, t: external forces and moments, with their values at time t (s), included in the equilibrium.

    Returns:
        Modes: `.frequencies` (rad/s), `.damping`, `.shapes`, `.eigenvalues`, `.q`.

    Raises:
        ValueError: bad arguments, or no steady state at this speed with all beams in range.
    """
    return small_motions(arm, q, speed, lock, at_time(arm, loads, t)).solve()


def shift(M: Array, K: Array, rate: float) -> float:
    """The least of a row of numbers sigma that makes K + sigma M positive definite beyond rounding; 0 if K is.
    Without any stiffness: the square of `rate` (1/s).

    (Cholesky may pass a K whose rigid-body motion is 1e-16 off zero; its pivots tell.)
    """
    import scipy.linalg as la  # slow to import

    if not K.any():
        return rate**2
    sigma, most, definite = 0.0, 1e3 * float(np.abs(K).max()), -1.0
    while sigma <= most:
        moved = K + sigma * M
        try:
            pivots = np.diag(la.cholesky(moved)) ** 2 / np.diag(moved)
            definite = sigma if definite < 0 else definite
            if (pivots > 1e-11).all():
                return sigma
        except la.LinAlgError:
            pass
        sigma = max(10.0 * sigma, 1e-6 * float(np.abs(np.diag(K)).min()), 1e-12 * float(np.abs(K).max()), 1e-30)
    # shapes so nearly dependent that no shift helps: the mass matrix is as ill-conditioned as the stiffness
    return max(definite, 0.0)


def _conservative(M: Array, K: Array) -> tuple[NDArray[np.complex128], Array]:
    """s^2 M + K = 0. Solved as M x = mu (K + sigma M) x for the largest mu: eigh(K, M) loses digits of low modes when
    the highest eigenvalue is 1e10 times the lowest."""
    import scipy.linalg as la  # slow to import

    K = 0.5 * (K + K.T)
    sigma = shift(M, K, 1.0)
    try:
        mu, vectors = la.eigh(M, K + sigma * M)
    except la.LinAlgError:
        raise ValueError(
            "modes: masses and stiffness are singular in double precision; some motions differ by rounding alone, "
            "such as those of shape functions that are nearly dependent"
        ) from None
    square = 1.0 / mu - sigma
    # x K x / x M x is zero as far as double precision tells
    noise = 1e-13 * np.einsum("ik,ij,jk->k", np.abs(vectors), np.abs(K), np.abs(vectors)) / np.abs(mu)
    square[np.abs(square) < np.maximum(noise, 1e-10 * sigma)] = 0.0
    return np.emath.sqrt(-square).astype(complex), vectors


def _general(M: Array, G: Array, K: Array) -> tuple[NDArray[np.complex128], NDArray[Any]]:
    """s^2 M + s G + K = 0, as an ordinary eigenvalue problem of w = 1/(s - sigma), for the same reason. Where s
    differ so much that rounding hides the small w, the fast motions come from the problem of s itself."""
    import scipy.linalg as la  # slow to import

    n = len(M)
    sigma = np.sqrt(shift(M, 0.5 * (K + K.T), float(np.abs(G).max())))
    lu, order, _ = la.lapack.dgetrf(M * sigma**2 + G * sigma + K)
    pivots = np.abs(np.diag(lu))
    if not pivots.min() > n * np.finfo(float).eps * pivots.max():
        raise ValueError(
            "modes: masses, damping and stiffness are singular in double precision; some motions differ by rounding "
            "alone"
        )
    at_shift = lu, order
    companion = np.zeros((2 * n, 2 * n))
    companion[:n, :n] = -la.lu_solve(at_shift, 2 * sigma * M + G)
    companion[:n, n:] = -la.lu_solve(at_shift, M)
    companion[n:, :n] = np.eye(n)
    w, vectors = la.eig(companion)
    size = np.abs(w)
    if size.min() < 1e-10 * size.max():
        companion[:n] = -la.solve(M, np.hstack([G, K]), assume_a="pos")
        fast, moved = la.eig(companion)
        lost = size < np.sqrt(size.max() / np.abs(fast).max())  # between the slowest and the fastest
        found = np.argsort(np.abs(fast))[2 * n - np.count_nonzero(lost) :]
        w[lost], vectors[:, lost] = 1.0 / (fast[found] - sigma), moved[:, found]
    s = sigma + 1.0 / w
    s[np.abs(s) < 1e-5 * sigma] = 0.0
    tiny = 1e-12 * np.abs(s)
    upper, real = np.flatnonzero(s.imag > tiny), np.flatnonzero((np.abs(s.imag) <= tiny) & (s != 0))
    # A rigid-body motion has the eigenvalue zero twice, or once where it is damped. One stands for it.
    zero = np.count_nonzero(s == 0)
    _, singular, rows = la.svd(K)
    rigid = int(np.clip(np.count_nonzero(singular <= 1e-10 * singular[0]), (zero + 1) // 2, zero))
    keep = np.concatenate([real, upper])
    s = np.where(np.abs(s.imag) <= tiny, s.real, s)
    return np.concatenate([np.zeros(rigid), s[keep]]), np.hstack([rows[n - rigid :].T, vectors[n:, keep]])
