"""Rods reckoned another way than flexarm does: equilibria and critical loads by shooting, vibrations by collocation.
NumPy and SciPy only.

A rod has force n and moment m (world axes) on its sections, which turn by R: p' = R (e1 + gamma), R' = R (k0 + kappa)^,
n' = -f, m' = -p' x n, and (gamma, kappa) = C^-1 (R^T n, R^T m). From the tip inwards these are ordinary differential
equations once the tip's rotation is known, which Newton's iteration finds from the root's. Forces that follow the tip
need not even that.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class Rod:
    """One beam of a chain, along x at its root, in the axes of the end of the one before, turned by `turn`."""

    length: float  # m
    stiffness: Any  # (6, 6) or its diagonal: force x y z, moment x y z
    curvature: Callable[[float], Any] = lambda s: np.zeros(3)  # at rest (1/m)
    turn: Any = field(default_factory=lambda: np.eye(3))  # of its root
    weight: Any = (0.0, 0.0, 0.0)  # dead load per length (N/m)

    @property
    def compliance(self) -> np.ndarray:
        C = np.asarray(self.stiffness, dtype=float)
        return np.asarray(np.linalg.inv(np.diag(C) if C.ndim == 1 else C))


@dataclass(frozen=True)
class Loads:
    """At the tip: dead (in the world's axes) and following it (in the section's)."""

    force: Any = (0.0, 0.0, 0.0)
    moment: Any = (0.0, 0.0, 0.0)
    follower_force: Any = (0.0, 0.0, 0.0)
    follower_moment: Any = (0.0, 0.0, 0.0)
    arms: tuple[tuple[Any, Any], ...] = ()  # dead forces on rigid arms: place in the section's axes, force

    def at(self, R: np.ndarray, share: float) -> tuple[np.ndarray, np.ndarray]:
        """Force and moment on a tip that is turned by R (world)."""
        n = np.asarray(self.force, dtype=float) + R @ np.asarray(self.follower_force, dtype=float)
        m = np.asarray(self.moment, dtype=float) + R @ np.asarray(self.follower_moment, dtype=float)
        for arm, force in self.arms:
            n, m = n + np.asarray(force), m + np.cross(R @ np.asarray(arm, dtype=float), force)
        return share * n, share * m


def _inwards(rod: Rod, state: np.ndarray, share: float, rtol: float) -> np.ndarray:
    """[p, R, n, m] at the root of a rod from those at its end."""
    C, f, e1 = rod.compliance, share * np.asarray(rod.weight, dtype=float), np.array([1.0, 0.0, 0.0])

    def slope(s: float, y: np.ndarray) -> np.ndarray:
        R, n, m = y[3:12].reshape(3, 3), y[12:15], y[15:18]
        strain = C @ np.concatenate([R.T @ n, R.T @ m])
        k1, k2, k3 = strain[3:] + rod.curvature(s)
        dp = R @ (e1 + strain[:3])
        dR = R @ np.array([[0.0, -k3, k2], [k3, 0.0, -k1], [-k2, k1, 0.0]])
        return np.concatenate([dp, dR.ravel(), -f, -np.cross(dp, n)])

    done = solve_ivp(slope, (rod.length, 0.0), state, method="DOP853", rtol=rtol, atol=1e-13 * rod.length)
    return np.asarray(done.y[:, -1])


def _root(rods: Sequence[Rod], tip: np.ndarray, loads: Loads, share: float, rtol: float) -> np.ndarray:
    """[p, R, n, m] at the root, if the tip lies at zero, turned by `tip`."""
    n, m = loads.at(tip, share)
    state = np.concatenate([np.zeros(3), tip.ravel(), n, m])
    for rod in reversed(rods):
        state = _inwards(rod, state, share, rtol)
        state[3:12] = (state[3:12].reshape(3, 3) @ np.asarray(rod.turn).T).ravel()
    return state


def _miss(rods: Sequence[Rod], tip: np.ndarray, loads: Loads, share: float, rtol: float) -> np.ndarray:
    """By how much the root is turned (rotation vector)."""
    R = _root(rods, tip, loads, share, rtol)[3:12].reshape(3, 3)
    return np.asarray(Rotation.from_matrix(R).as_rotvec())


def jacobian(rods: Sequence[Rod], tip: np.ndarray, loads: Loads, share: float = 1.0, rtol: float = 1e-12) -> np.ndarray:
    """Of the root's turn by the tip's, (3, 3): singular where an equilibrium has neighbours."""
    turns, h = [Rotation.from_rotvec(1e-5 * e).as_matrix() for e in np.eye(3)], 2e-5
    to_and_fro = [(_miss(rods, t @ tip, loads, share, rtol), _miss(rods, t.T @ tip, loads, share, rtol)) for t in turns]
    return np.column_stack([(to - fro) / h for to, fro in to_and_fro])


def equilibrium(
    rods: Sequence[Rod], loads: Loads, steps: int = 8, start: np.ndarray | None = None, rtol: float = 1e-12
) -> tuple[np.ndarray, np.ndarray]:
    """Tip's place (3,) and rotation (3, 3), the root at zero and along the world's axes. The load is put on in steps,
    or at once from a tip's rotation `start`."""
    tip = _root(rods, np.eye(3), Loads(), 0.0, rtol)[3:12].reshape(3, 3).T if start is None else start
    for share in np.linspace(0.0, 1.0, steps + 1)[1:] if start is None else [1.0]:
        for _ in range(40):
            step = np.linalg.solve(jacobian(rods, tip, loads, share, rtol), -_miss(rods, tip, loads, share, rtol))
            step *= min(1.0, 0.5 / max(np.linalg.norm(step), 1e-300))
            tip = Rotation.from_rotvec(step).as_matrix() @ tip
            if np.linalg.norm(step) < 1e-11:
                break
        else:
            raise RuntimeError(f"shooting does not converge at {share:.3g} of the load")
    return -_root(rods, tip, loads, 1.0, rtol)[:3], tip


def critical(rods: Sequence[Rod], loads: Callable[[float], Loads], low: float, high: float) -> float:
    """The load factor between two at which the equilibrium reached from none has neighbours."""

    def det(factor: float) -> float:
        tip = equilibrium(rods, loads(factor))[1]
        return float(np.linalg.det(jacobian(rods, tip, loads(factor))))

    return float(brentq(det, low, high, xtol=1e-11 * high, rtol=1e-11))


def frequencies(rod: Rod, inertia: Any, count: int, points: int = 40, clamped: bool = False) -> np.ndarray:
    """Natural frequencies (rad/s) of a rod about its shape at rest, its root clamped, its end free or clamped.

    inertia: (6, 6) or its diagonal: per length, of force x y z, moment x y z.

    In the axes of the sections gamma = u' + K x u + e1 x theta, kappa = theta' + K x theta, n' + K x n = rho A u'',
    m' + K x m + e1 x n = J theta'', at Chebyshev's points."""
    C, M = np.linalg.inv(rod.compliance), np.asarray(inertia, dtype=float)
    M = np.diag(M) if M.ndim == 1 else M
    x, D = chebyshev(points, rod.length)
    size = 6 * (points + 1)
    strain, balance = np.kron(D, np.eye(6)), np.kron(D, np.eye(6))
    e1 = _cross(np.array([1.0, 0.0, 0.0]))
    for i, s in enumerate(x):
        K, at = _cross(np.asarray(rod.curvature(s), dtype=float)), slice(6 * i, 6 * i + 6)
        strain[at, at] += np.block([[K, e1], [np.zeros((3, 3)), K]])
        balance[at, at] += np.block([[K, np.zeros((3, 3))], [e1, K]])
    forces = np.kron(np.eye(points + 1), C) @ strain
    A, B = -balance @ forces, np.kron(np.eye(points + 1), M)
    free = slice(0, size - 6)  # the root is the last point
    A[:6] = np.eye(6, size) if clamped else forces[:6]
    B[:6] = 0.0
    A, B = A[free, free], B[free, free]
    scale = 1.0 / np.abs(A).max(axis=1)
    values = np.linalg.eigvals(np.linalg.solve(scale[:, None] * A, scale[:, None] * B))
    values = np.sort(values.real)[::-1][:count]
    return np.asarray(1.0 / np.sqrt(values))


def chebyshev(points: int, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Chebyshev's points from `length` down to zero, and the matrix that differentiates there."""
    k = np.arange(points + 1)
    x = np.cos(np.pi * k / points)
    c = np.where((k == 0) | (k == points), 2.0, 1.0) * (-1.0) ** k
    D = np.outer(c, 1.0 / c) / (x[:, None] - x + np.eye(points + 1))
    return (x + 1.0) * length / 2.0, (D - np.diag(D.sum(axis=1))) * 2.0 / length


def _cross(a: np.ndarray) -> np.ndarray:
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


@dataclass(frozen=True)
class Blade:
    """A straight rod of length 1, EI = 1 and rho A = 1, turning about z, its root on the axis.

    slenderness: its length over the section's radius of gyration. ratio: of EA to GA."""

    slenderness: float
    ratio: float = 3.059

    @property
    def stiffness(self) -> tuple[float, ...]:
        EA = self.slenderness**2
        GA = EA / self.ratio
        return (EA, GA, GA, 2.0 * GA / EA, 1.0, 1.0)

    @property
    def inertia(self) -> tuple[float, ...]:
        J = self.slenderness**-2
        return (1.0, 1.0, 1.0, 2.0 * J, J, J)

    def tip(self, speed: float) -> float:
        """Where the end is: X'' = -k^2 X, X(0) = 0, X'(1) = 1."""
        k = speed / self.slenderness
        return float(np.tan(k) / k) if k else 1.0

    def flap(self, speed: float, count: int, points: int = 30) -> np.ndarray:
        """Frequencies (rad/s) out of the plane of rotation, of deflection w, slope phi and twist alpha about the rod
        that its turning stretches by lambda = X' and pulls by T = EA (lambda - 1): gamma = w' - lambda phi,
        (GA gamma + T phi)' = rho A w'', EI phi'' + (lambda GA - T) gamma + J speed^2 phi = J phi'' + 2 J speed alpha',
        GJ alpha'' = 2 J alpha'' - 2 J speed phi' (primes on the right: of time)."""
        EA, GA, _, GJ, EI, _ = self.stiffness
        J, k, n = self.inertia[4], speed / self.slenderness, points + 1
        x, D = chebyshev(points, 1.0)
        stretch = np.cos(k * x) / np.cos(k)
        pull, I, O = EA * (stretch - 1.0), np.eye(n), np.zeros((n, n))
        shear = np.hstack([D, -np.diag(stretch), O])
        across = GA * shear + np.hstack([O, np.diag(pull), O])
        bend, twist = np.hstack([O, D, O]), np.hstack([O, O, D])
        moment = EI * D @ bend + np.diag(stretch * GA - pull) @ shear + J * speed**2 * np.hstack([O, I, O])
        K = -np.vstack([D @ across, moment, GJ * D @ twist])
        M = np.diag(np.repeat([1.0, J, 2.0 * J], n))
        G = 2.0 * J * speed * np.block([[O, O, O], [O, O, -I], [O, I, O]])
        for row, force in ((0, across[0]), (n, bend[0]), (2 * n, twist[0])):
            K[row], M[row], G[row] = force, 0.0, 0.0
        free = [i for i in range(3 * n) if i % n != points]
        K, M, G = (a[np.ix_(free, free)] / np.abs(K[np.ix_(free, free)]).max(axis=1)[:, None] for a in (K, M, G))
        A = np.block([[-np.linalg.solve(K, G), -np.linalg.solve(K, M)], [np.eye(len(free)), np.zeros_like(K)]])
        values = np.linalg.eigvals(A)
        values = np.sort(1.0 / np.abs(values[np.argsort(-np.abs(values))][: 2 * count]))
        return np.asarray(values[::2])
