"""What bench/run/struts.py holds flexarm's struts and tendons against; nothing of flexarm is in it.

    python bench/run/struts_truth.py    # how sure these numbers are, each by a second way

- `Boom`: two rigid links in a plane, moved by two cylinders: the textbook's equations of a double pendulum, the
  cylinders by virtual work, integrated to 1e-12.
- `Stayed`: a slender beam that bends without stretch (Euler's elastica) under its weight, held by a stay: shooting.
- `Stays`: small vibration of such a beam between stays: the zeros of a determinant.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from hermite import hermite
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import eigh
from scipy.optimize import brentq, fsolve

Array = NDArray[np.float64]
GRAVITY, E, RHO = 9.81, 209e9, 7850.0  # of the earth; of steel


# -- a boom of two sections, and two cylinders -------------------------------------------------------------------------


@dataclass(frozen=True)
class Section:
    """A rigid link in the x-y plane; x along it, from its hinge. Inertia about its centre of mass (kg m^2)."""

    length: float
    mass: float
    com: float
    inertia: float


@dataclass(frozen=True)
class Cylinder:
    """Between two points, each of (-1 world, 0 boom, 1 jib; x, y in its axes)."""

    a: tuple[int, float, float]
    b: tuple[int, float, float]
    stiffness: float
    damping: float = 0.0


@dataclass(frozen=True)
class Boom:
    """Its state: the angle of the boom over the ground, that of the jib against the boom, and their rates. The
    cylinders' springs are at rest at `start`; besides, they push by `forces`, either numbers (nt, 2), linear between
    `times` (s), or a function of time. `rods`: point masses at their ends b (kg)."""

    sections: tuple[Section, Section]
    cylinders: tuple[Cylinder, ...]
    start: tuple[float, float]
    times: tuple[float, ...]
    forces: Any = field(repr=False)
    rods: tuple[float, float] = (0.0, 0.0)

    def point(self, at: tuple[int, float, float], q: Any) -> tuple[Array, Array]:
        """Its place, and how that changes with the angles, (2, 2)."""
        of, x, y = at
        p, J = np.array([0.0, 0.0]), np.zeros((2, 2))
        if of < 0:
            return np.array([x, y]), J
        angle = 0.0
        for k, (u, w) in enumerate([(self.sections[0].length, 0.0)] * of + [(x, y)]):
            angle += q[k]
            c, s = np.cos(angle), np.sin(angle)
            d = np.array([c * u - s * w, s * u + c * w])
            p = p + d
            J[:, : k + 1] += np.array([-d[1], d[0]])[:, None]
        return p, J

    def length(self, cylinder: Cylinder, q: Any) -> tuple[float, Array]:
        """The length, and its derivatives."""
        (a, Ja), (b, Jb) = (self.point(at, q) for at in (cylinder.a, cylinder.b))
        n = (b - a) / np.linalg.norm(b - a)
        return float(np.linalg.norm(b - a)), n @ (Jb - Ja)

    @cached_property
    def rest(self) -> list[float]:
        return [self.length(c, self.start)[0] for c in self.cylinders]

    def driven(self, t: Any) -> Array:
        """The forces besides (N), (..., 2)."""
        if callable(self.forces):
            return np.asarray(self.forces(t))
        return np.stack([np.interp(t, self.times, f) for f in np.transpose(self.forces)], axis=-1)

    def push(self, t: float, q: Any, v: Any) -> tuple[Array, Array]:
        """Of each cylinder its force (N), and the Jacobian of the lengths."""
        found, J = [], []
        for c, rest, f in zip(self.cylinders, self.rest, self.driven(t), strict=True):
            length, by_q = self.length(c, q)
            found.append(f - c.stiffness * (length - rest) - c.damping * by_q @ v)
            J.append(by_q)
        return np.array(found), np.array(J)

    def rates(self, t: float, y: Array) -> Array:
        one, two = self.sections
        q, v = y[:2], y[2:]
        L, c = one.length, two.com
        h = two.mass * L * c
        cos, sin = np.cos(q[1]), np.sin(q[1])
        m22 = two.inertia + two.mass * c**2
        m12 = m22 + h * cos
        m11 = one.inertia + one.mass * one.com**2 + two.mass * L**2 + m22 + 2 * h * cos
        bias = h * sin * np.array([-(2 * v[0] + v[1]) * v[1], v[0] ** 2])
        far = two.mass * c * np.cos(q[0] + q[1])
        weight = GRAVITY * np.array([(one.mass * one.com + two.mass * L) * np.cos(q[0]) + far, far])
        f, J = self.push(t, q, v)
        M, force = np.array([[m11, m12], [m12, m22]]), J.T @ f - bias - weight
        for mass, (link, *at) in zip(self.rods, (c.b for c in self.cylinders), strict=True):
            p, by = self.point((link, *at), q)
            knee = self.point((link, 0.0, 0.0), q)[0]
            inward = v[: link + 1].sum() ** 2 * (p - knee) + link * v[0] ** 2 * knee  # acceleration at constant rates
            M, force = M + mass * by.T @ by, force - mass * by.T @ (np.array([0.0, GRAVITY]) - inward)
        a = np.linalg.solve(M, force)
        return np.concatenate([v, a])

    def run(self, t: Array, rtol: float = 1e-12) -> Array:
        """q and v from rest at `start`, (nt, 4). Integration stops at the corners of the forces."""
        y, out = np.array([*self.start, 0.0, 0.0]), np.empty((t.size, 4))
        for begin, end in pairwise(self.times):
            here = (t >= begin) & (t <= end)
            times = np.unique([*t[here], end])
            found = solve_ivp(self.rates, (begin, end), y, "DOP853", times, rtol=rtol, atol=1e-2 * rtol)
            out[here] = found.y.T[: here.sum()]
            y = found.y[:, -1]
        return out

    def energy(self, y: Array) -> Array:
        """Kinetic, of weight and of springs, (J), (nt,)."""
        out = []
        for state in y:
            q, v = state[:2], state[2:]
            E = 0.0
            for k, s in enumerate(self.sections):
                p, J = self.point((k, s.com, 0.0), q)
                E += s.mass * (0.5 * (J @ v) @ (J @ v) + GRAVITY * p[1]) + 0.5 * s.inertia * v[: k + 1].sum() ** 2
            E += sum(
                0.5 * c.stiffness * (self.length(c, q)[0] - r) ** 2
                for c, r in zip(self.cylinders, self.rest, strict=True)
            )
            out.append(E)
        return np.array(out)


BOOM = Boom(
    (Section(3.0, 120.0, 1.4, 95.0), Section(2.0, 50.0, 0.9, 18.0)),
    (
        Cylinder((-1, 0.4, -0.7), (0, 1.2, -0.12), 3e6, 1e4),
        Cylinder((0, 2.2, 0.2), (1, -0.2, 0.15), 3e6, 1e4),
    ),
    (0.5, -1.2),
    (0.0, 1.0, 2.0, 3.0, 4.0),
    ((1.2e4, 6e3), (1e6, 6e3), (9e5, 3.5e5), (2e5, 2e5), (1e5, -1e5)),
)


def stroke(t: Any) -> Array:
    """There and back within a second, smoothly: by springs of 1e8 N/m, 0.1 and 0.04 m."""
    return np.multiply.outer(0.5 - 0.5 * np.cos(2 * np.pi * np.asarray(t)), [1e7, 4e6])


STIFF = Boom(  # light, and held by cylinders of 1e8 N/m
    (Section(1.0, 1.0, 0.5, 0.08), Section(0.8, 0.5, 0.4, 0.03)),
    (Cylinder((-1, 0.3, -0.5), (0, 0.4, -0.05), 1e8), Cylinder((0, 0.6, 0.1), (1, -0.15, 0.1), 1e8)),
    (0.5, -1.2),
    (0.0, 1.0),
    stroke,
)
STRUCK = replace(STIFF, times=(0.0, 0.5, 1.0), forces=((0.0, 0.0), (1e7, 4e6), (0.0, 0.0)))


# -- a beam that sags, and a stay --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Stayed:
    """A beam clamped at the origin along x, of weight along -y; a stay from `anchor` to the beam's slice `at` (m)."""

    length: float = 5.0
    bending: float = E * np.pi * 0.008**4 / 4  # N m^2
    mass: float = RHO * np.pi * 0.008**2  # a metre
    at: float = 3.5
    anchor: tuple[float, float] = (0.0, 2.5)
    stiffness: float = 2e4
    rest: float = 4.6

    def stay(self, p: Any) -> Array:
        """The force that it exerts on its slice at p."""
        d = np.array(self.anchor) - p
        far = np.linalg.norm(d)
        return self.stiffness * max(far - self.rest, 0.0) * d / far

    def shape(self, root: float, force: Array, s: Array, rtol: float) -> Array:
        """x, y, angle, curvature (4, s) where the stay pulls by `force`, from a curvature at the root."""

        def slope(s: float, z: Array, held: float) -> list[float]:
            x, y = held * force - [0.0, self.mass * GRAVITY * (self.length - s)]  # what the outer part exerts
            c, n = np.cos(z[2]), np.sin(z[2])
            return [c, n, z[3], -(c * y - n * x) / self.bending]

        z, out = np.array([0.0, 0.0, 0.0, root]), []
        for begin, end, held in ((0.0, self.at, 1.0), (self.at, self.length, 0.0)):
            here = s[(s >= begin) & (s < end)]
            found = solve_ivp(
                slope, (begin, end), z, "DOP853", np.append(here, end), args=(held,), rtol=rtol, atol=1e-2 * rtol
            )
            z = found.y[:, -1]
            out.append(found.y[:, :-1])
        return np.column_stack([*out, z])

    def solve(self, s: Any = (), rtol: float = 1e-13) -> Array:
        """x, y, angle and curvature in equilibrium at s and at the beam's end, (4, s + 1)."""
        s = np.asarray(s, float)

        def missed(u: Array) -> list[float]:
            z = self.shape(u[0], u[1:], np.array([self.at]), rtol)
            return [z[3, -1], *(u[1:] - self.stay(z[:2, 0])) / 100.0]

        pull = 0.4 * self.mass * GRAVITY * self.length
        u, _, good, message = fsolve(missed, [0.0, -pull, pull], xtol=1e-14, full_output=True)
        if np.abs(missed(u)).max() > 1e-9:
            raise RuntimeError(message if good != 1 else "no equilibrium")
        return self.shape(u[0], u[1:], s, rtol)

    def by_bars(self, n: int) -> Array:
        """Place of the slice and of the end by n rigid bars with springs between them, the first half a bar from the
        clamp: Newton's iteration on their potential energy, (4,). Errors go with 1 / n^2."""
        h, k = self.length / n, round(self.at / self.length * n)
        springs = np.full(n, self.bending / h)
        springs[0] *= 2.0  # half a bar from the clamp
        D = np.eye(n) - np.eye(n, k=-1)
        K = D.T @ (springs[:, None] * D)
        # a bar's weight at its middle: bar i lifts by half of its own and all of the bars before
        lever = self.mass * GRAVITY * h * h * (n - np.arange(n) - 0.5)
        to = (np.arange(n) < k) * h

        def energy(theta: Array) -> float:
            c, s = np.cos(theta), np.sin(theta)
            over = max(np.hypot(*(np.array(self.anchor) - [to @ c, to @ s])) - self.rest, 0.0)
            return float(0.5 * theta @ K @ theta + lever @ s + 0.5 * self.stiffness * over**2)

        theta = np.zeros(n)
        for _ in range(200):
            c, s = np.cos(theta), np.sin(theta)
            d = np.array(self.anchor) - [to @ c, to @ s]
            far = np.linalg.norm(d)
            J = (d[0] * s - d[1] * c) * to / far  # of the stay's length
            pull = self.stiffness * max(far - self.rest, 0.0)
            P = np.array([-to * s, to * c])
            H = K - np.diag(lever * s) + self.stiffness * (far > self.rest) * np.outer(J, J)
            H += pull * (np.diag((d[0] * c + d[1] * s) * to) + P.T @ P - np.outer(J, J)) / far
            change = np.linalg.solve(H, K @ theta + lever * c + pull * J)
            if np.abs(change).max() < 1e-13:
                break
            step = 1.0
            while energy(theta - step * change) > energy(theta) + 1e-9 and step > 1e-3:
                step *= 0.5
            theta = theta - step * change
        else:
            raise RuntimeError("no equilibrium of the bars")
        c, s = np.cos(theta), np.sin(theta)
        return np.array([to @ c, to @ s, h * c.sum(), h * s.sum()])


# -- small vibration between stays -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Stays:
    """A clamped beam without weight, and two stays from its slice `at` to (x, +-y) and behind; equal pretension."""

    length: float = 4.0
    bending: float = E * np.pi * 0.01**4 / 4
    mass: float = RHO * np.pi * 0.01**2
    at: float = 2.5
    anchor: tuple[float, float] = (0.5, 1.5)
    stiffness: float = 4000.0
    tension: float = 120.0

    @property
    def far(self) -> float:
        return float(np.hypot(self.at - self.anchor[0], self.anchor[1]))

    @property
    def compression(self) -> float:
        """Of the beam from its root to the slice (N)."""
        return 2 * self.tension * (self.at - self.anchor[0]) / self.far

    def spring(self, across: bool) -> float:
        """By which the stays hold the slice, in their plane or across it (N/m): stretch, and tension that turns."""
        if across:
            return 2 * self.tension / self.far
        sin = self.anchor[1] / self.far
        return 2 * (self.stiffness * sin**2 + self.tension * (1 - sin**2) / self.far)

    def determinant(self, w: float, across: bool) -> float:
        """Zero at frequencies w (rad/s)."""
        EI, P, a = self.bending, self.compression, self.at
        square = w * np.sqrt(self.mass / EI)
        half = P / (2 * EI)
        fast = np.sqrt(half**2 + square**2)
        r, s = np.sqrt(fast - half), np.sqrt(fast + half)  # v'''' + P/EI v'' = square^2 v: e^(r x), e^(i s x)
        b = np.sqrt(square)

        def inner(x: float) -> Array:
            """v, v', v'', v''' of the two solutions that the clamp allows."""
            C, S, c, n = np.cosh(r * x), np.sinh(r * x), np.cos(s * x), np.sin(s * x)
            return np.array(
                [
                    [C - c, S / r - n / s],
                    [r * S + s * n, C - c],
                    [r**2 * C + s**2 * c, r * S + s * n],
                    [r**3 * S - s**3 * n, r**2 * C + s**2 * c],
                ]
            )

        def outer(x: float) -> Array:
            """Of the two that a free end at x = 0 allows."""
            C, S, c, n = np.cosh(b * x), np.sinh(b * x), np.cos(b * x), np.sin(b * x)
            return np.array(
                [
                    [C + c, S + n],
                    [b * (S - n), b * (C + c)],
                    [b**2 * (C - c), b**2 * (S - n)],
                    [b**3 * (S + n), b**3 * (C - c)],
                ]
            )

        left, right = inner(a), outer(a - self.length)
        jump = left[3] + (P * left[1] - self.spring(across) * left[0]) / EI
        rows = np.vstack([np.hstack([left[:3], -right[:3]]), np.concatenate([jump, -right[3]])])
        rows = rows / np.abs(rows).max(axis=1, keepdims=True)
        return float(np.linalg.det(rows / np.abs(rows).max(axis=0)))

    def frequencies(self, n: int, across: bool) -> Array:
        """The n lowest (rad/s), in the stays' plane or across it."""
        grid = np.sqrt(self.bending / self.mass) / self.length**2 * np.linspace(0.2, ((n + 1) * np.pi) ** 2, 400 * n)
        values = [self.determinant(w, across) for w in grid]
        at = [k for k in range(len(grid) - 1) if values[k] * values[k + 1] < 0][:n]
        return np.array(
            [brentq(self.determinant, grid[k], grid[k + 1], args=(across,), xtol=1e-14, rtol=1e-14) for k in at]
        )

    def by_elements(self, elements: int, n: int, across: bool) -> Array:
        """The same by Hermite elements of equal length; errors go with the fourth power."""
        h = self.length / elements
        M, K = (np.zeros((2 * elements + 2,) * 2) for _ in range(2))
        mass, slope, second = hermite(h)
        node = round(self.at / h)
        for k in range(elements):
            at = slice(2 * k, 2 * k + 4)
            M[at, at] += self.mass * mass
            K[at, at] += self.bending * second - self.compression * (k < node) * slope
        K[2 * node, 2 * node] += self.spring(across)
        return np.sqrt(eigh(K[2:, 2:], M[2:, 2:], eigvals_only=True)[:n])


def main() -> None:
    t = np.linspace(0.0, 4.0, 41)
    y = BOOM.run(t)
    print("boom: angles of a run at 1e-12, less those at 1e-10:", np.abs(y - BOOM.run(t, 1e-10))[:, :2].max())
    free = replace(BOOM, forces=np.zeros((5, 2)), cylinders=tuple(replace(c, damping=0.0) for c in BOOM.cylinders))
    E = free.energy(free.run(t))
    print(f"boom without dampers and forces: energy changes by {np.ptp(E):.1e} J of {np.abs(E).max():.3g}")
    stayed = Stayed()
    z = stayed.solve([stayed.at])
    bars = [stayed.by_bars(n) for n in (200, 400, 800)]
    first = [(4 * b - a) / 3 for a, b in pairwise(bars)]
    limit = (16 * first[1] - first[0]) / 15
    print("stayed beam, x y of slice and end:", z[:2].T.ravel(), "less bars, extrapolated:", z[:2].T.ravel() - limit)
    stays = Stays()
    for across in (False, True):
        w = stays.frequencies(5, across)
        coarse, fine = (stays.by_elements(n, 5, across) for n in (32, 64))
        print("between stays:", w, "less elements, extrapolated:", w - (16 * fine - coarse) / 15)


if __name__ == "__main__":
    main()
