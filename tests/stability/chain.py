"""A planar chain of rods in extended precision: the judge of AB and CI.

Written from the chain's kinetic energy alone, in absolute angles, so that it shares nothing with the program: with
P_k = theta_1 + ... + theta_k, rod k of mass m_k, length 1, inertia m_k/12,

    T = 1/2 sum_ij A_ij cos(P_i - P_j) P'_i P'_j,   A_ij = sum_{k >= max(i,j)} m_k c_ki c_kj + delta_ij m_i/12,

where c_ki = 1 for i < k and 1/2 for i = k; then sum_j A_ij (cos(P_i - P_j) P''_j + sin(P_i - P_j) P'_j^2) = Q_i.
"""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Context, Decimal, localcontext

import flexarm as fa
import mpmath
import numpy as np

DIGITS = Context(prec=60)


def rods(masses: Sequence[float]) -> fa.Arm:
    """Planar chain of unit rods on revolute joints."""
    return fa.Arm(
        [fa.Link(fa.Revolute("z"), fa.RigidBody(m, (0.5, 0, 0), (0, m / 12, m / 12), (1, 0, 0))) for m in masses]
    )


def cosine_and_sine(angles: np.ndarray) -> list[np.ndarray]:
    """Of exact angles, which Decimal does not offer."""
    with mpmath.workdps(DIGITS.prec):
        found = [(mpmath.cos(x), mpmath.sin(x)) for x in (mpmath.mpf(str(angle)) for angle in angles)]
        return [np.array([Decimal(mpmath.nstr(x, DIGITS.prec)) for x in xs]) for xs in zip(*found, strict=True)]


def solve(M: np.ndarray, b: np.ndarray) -> np.ndarray:
    """M x = b by elimination, in place, of a symmetric positive definite matrix: its diagonal serves in any order."""
    n = len(b)
    for k in range(n):
        part = M[k + 1 :, k] / M[k, k]
        M[k + 1 :, k + 1 :] -= np.outer(part, M[k, k + 1 :])
        b[k + 1 :] -= part * b[k]
    for k in reversed(range(n)):
        b[k] = (b[k] - M[k, k + 1 :] @ b[k + 1 :]) / M[k, k] if k < n - 1 else b[k] / M[k, k]
    return b


def accelerations(masses: Sequence[float], q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Joint accelerations of such a chain, as Decimals of 60 digits, of the same doubles."""
    with localcontext(DIGITS):
        mass, joint, rate, torque = (np.array([Decimal(float(x)) for x in xs]) for xs in (masses, q, v, tau))
        inertia = np.array([Decimal(float(m / 12)) for m in masses])  # as the arm was given it
        cosine, sine = cosine_and_sine(np.cumsum(joint))
        beyond = np.cumsum(mass[::-1])[::-1] - mass  # mass outward of rod k
        k = np.arange(len(mass))
        outer = np.maximum.outer(k, k)
        A = beyond[outer] + mass[outer] / 2
        A[k, k] = beyond + mass / 4 + inertia
        M = A * (np.outer(cosine, cosine) + np.outer(sine, sine))
        turned = A * (np.outer(sine, cosine) - np.outer(cosine, sine))
        Q = torque - np.append(torque[1:], Decimal(0)) - turned @ np.cumsum(rate) ** 2
        ddP = solve(M, Q)
        return np.append(ddP[:1], np.diff(ddP))


def error(found: Sequence[float], truth: np.ndarray) -> float:
    """Largest error over the largest acceleration."""
    with localcontext(DIGITS):
        off = max(abs(Decimal(float(x)) - y) for x, y in zip(found, truth, strict=True))
        return float(off / max(abs(truth)))


CHAINS = {  # masses of n rods
    "uniform": lambda n: [1.0] * n,
    "last link x 1e6": lambda n: [1.0] * (n - 1) + [1e6],
    "last link x 1e9": lambda n: [1.0] * (n - 1) + [1e9],
    "1e-8 rising to 1 at the tip": lambda n: np.logspace(-8, 0, n).tolist(),
}


def errors(masses: Sequence[float], states: int = 3, seed: int = 5) -> dict[str, float]:
    """Relative error of "ab" and "ci", and under "data" what the last bit of each angle of the input is worth: medians
    over random states of unit size; and the least of "ab"."""
    rng, arm = np.random.default_rng(seed), rods(masses)
    found: dict[str, list[float]] = {"ab": [], "ci": [], "data": []}
    for _ in range(states):
        q, v, tau = rng.normal(size=(3, arm.nv))
        truth = accelerations(masses, q, v, tau)
        for method in ("ab", "ci"):
            found[method].append(error(arm.forward_dynamics(q, v, tau, method), truth))
        nudged = accelerations(masses, np.nextafter(q, rng.choice([-10, 10], arm.nv)), v, tau)
        found["data"].append(error(nudged, truth))
    medians = {name: float(np.median(x)) for name, x in found.items()}
    return medians | {"ab, best state": min(found["ab"])}
