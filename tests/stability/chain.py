"""A planar chain of rods in extended precision: the judge of AB and CI.

Written from the chain's kinetic energy alone, in absolute angles, so that it shares nothing with the program: with
P_k = theta_1 + ... + theta_k, rod k of mass m_k, length 1, inertia m_k/12,

    T = 1/2 sum_ij A_ij cos(P_i - P_j) P'_i P'_j,   A_ij = sum_{k >= max(i,j)} m_k c_ki c_kj + delta_ij m_i/12,

where c_ki = 1 for i < k and 1/2 for i = k; then sum_j A_ij (cos(P_i - P_j) P''_j + sin(P_i - P_j) P'_j^2) = Q_i.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import flexarm as fa
import mpmath
import numpy as np

DIGITS = 60


def rods(masses: Sequence[float]) -> fa.Arm:
    """Planar chain of unit rods on revolute joints."""
    return fa.Arm(
        [fa.Link(fa.Revolute("z"), fa.RigidBody(m, (0.5, 0, 0), (0, m / 12, m / 12), (1, 0, 0))) for m in masses]
    )


def accelerations(masses: Sequence[float], q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> list[mpmath.mpf]:
    """Joint accelerations of such a chain, to 60 digits, of the same doubles."""
    n = len(masses)
    with mpmath.workdps(DIGITS):
        mass, joint, rate, torque = ([mpmath.mpf(float(x)) for x in xs] for xs in (masses, q, v, tau))
        inertia = [mpmath.mpf(float(m / 12)) for m in masses]  # as the arm was given it
        P, dP = (np.cumsum(np.array(x, dtype=object)) for x in (joint, rate))
        beyond = [mpmath.mpf(0)] * (n + 1)  # mass outward of rod k
        for k in reversed(range(n)):
            beyond[k] = beyond[k + 1] + mass[k]
        cosine, sine = [mpmath.cos(x) for x in P], [mpmath.sin(x) for x in P]
        M, Q = mpmath.matrix(n, n), mpmath.matrix(n, 1)
        for i in range(n):
            Q[i] = torque[i] - (torque[i + 1] if i + 1 < n else 0)
            for j in range(n):
                outer = max(i, j)
                A = beyond[outer + 1] + mass[outer] / (4 if i == j else 2) + (inertia[i] if i == j else 0)
                M[i, j] = A * (cosine[i] * cosine[j] + sine[i] * sine[j])
                Q[i] -= A * (sine[i] * cosine[j] - cosine[i] * sine[j]) * dP[j] ** 2
        scale = [1 / mpmath.sqrt(M[i, i]) for i in range(n)]  # or a tiny mass looks singular to lu_solve
        D = mpmath.diag(scale)
        ddP = D * mpmath.lu_solve(D * M * D, D * Q)
        return [ddP[0], *(ddP[k] - ddP[k - 1] for k in range(1, n))]


def error(found: Sequence[Any], truth: list[mpmath.mpf]) -> float:
    """Largest error over the largest acceleration."""
    with mpmath.workdps(DIGITS):
        off = max(abs(mpmath.mpf(x) - y) for x, y in zip(found, truth, strict=True))
        return float(off / max(abs(y) for y in truth))


CHAINS = {  # published.md's table: masses of n rods
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
