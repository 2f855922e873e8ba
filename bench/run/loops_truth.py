"""What bench/run/loops.py holds flexarm's closed loops against; nothing of flexarm is in it.

    python bench/run/loops_truth.py            # how sure these numbers are, each by a second way
    python bench/run/loops_truth.py --write    # those of the tests, into tests/data/loops.json

- `Bodies`: rigid bodies in space, each with its own place and turn; every joint is a set of constraints. Accelerations
  by Lagrange's multipliers of least norm, eighth-order steps, places and rates put back onto the constraints.
- `ANDREWS`: the squeezer of Hairer and Wanner (1996, VII.7) in its seven angles, and the digits of the IVP test set.
- `FourBar`: of any lengths, by its crank alone. `DoubleFourBar`: of the IFToMM library, through its singular positions,
  by an integral. `BRICARD`: of the same library; `DELTA`: a robot of three arms.
- `ring`: chains of seven bodies about axes by chance, closed by each kind of joint.
- `Rod`: the flexible slider crank of the IVP test set (Simeon 1996), with its digits, and the curved rod's stretch.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
GRAVITY = 9.81
X, Y, Z = np.eye(3)

# -- rigid bodies, each on its own ------------------------------------------------------------------------------------

# What a joint holds: places along axes of A (m); and pairs of an axis of A and one of B that stay square.
HOLDS: dict[str, tuple[tuple[int, ...], tuple[tuple[int, int], ...]]] = {
    "fixed": ((0, 1, 2), ((1, 2), (2, 0), (0, 1))),
    "revolute": ((0, 1, 2), ((0, 2), (1, 2))),
    "prismatic": ((0, 1), ((1, 2), (2, 0), (0, 1))),
    "cylindrical": ((0, 1), ((0, 2), (1, 2))),
    "universal": ((0, 1, 2), ((0, 1),)),
    "planar": ((2,), ((0, 2), (1, 2))),
    "spherical": ((0, 1, 2), ()),
}
WORLD = -1


def axes_with(z: Array) -> Array:
    """A rotation whose third column is z."""
    z = np.asarray(z, float) / np.linalg.norm(z)
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


@dataclass(frozen=True)
class Rigid:
    mass: float
    inertia: Array  # about its centre, in its axes


@dataclass(frozen=True)
class Hold:
    """A joint of bodies a and b: its frames on both, place from the centre and axes."""

    kind: str
    a: int
    b: int
    on_a: tuple[Array, Array]
    on_b: tuple[Array, Array]


@dataclass
class Motion:
    """Centres, rotations, their speeds and angular velocities, all in the world's axes."""

    p: Array
    R: Array
    v: Array
    w: Array

    def copy(self) -> Motion:
        return Motion(self.p.copy(), self.R.copy(), self.v.copy(), self.w.copy())


Forces = Callable[[float, "Motion"], tuple[Array, Array]]


class Bodies:
    def __init__(self, bodies: list[Rigid], holds: list[Hold], gravity: Array, forces: Forces | None = None) -> None:
        self.n = len(bodies)
        self.mass = np.array([b.mass for b in bodies])
        self.inertia = np.array([b.inertia for b in bodies])
        self.holds, self.gravity, self.forces = holds, np.asarray(gravity, float), forces
        places, turns = [], []
        self.rows: list[tuple[int, str, Any]] = []
        for k, h in enumerate(holds):
            along, square = HOLDS[h.kind]
            places += [(k, i) for i in along]
            turns += [(k, i, j) for i, j in square]
        self.rows = [(k, "place", i) for k, i in places] + [(k, "turn", (i, j)) for k, i, j in turns]
        a, b = np.array([h.a for h in holds]), np.array([h.b for h in holds])
        k = np.array([x[0] for x in places], int)
        self.pa, self.pb = a[k], b[k]
        self.sa = np.array([holds[x].on_a[0] for x in k])
        self.sb = np.array([holds[x].on_b[0] for x in k])
        self.axis = np.array([holds[x[0]].on_a[1][:, x[1]] for x in places])
        k = np.array([x[0] for x in turns], int)
        self.ta, self.tb = a[k], b[k]
        self.first = np.array([holds[x[0]].on_a[1][:, x[1]] for x in turns]).reshape(-1, 3)
        self.second = np.array([holds[x[0]].on_b[1][:, x[2]] for x in turns]).reshape(-1, 3)

    def _with_world(self, m: Motion) -> Motion:
        """The world as a last body, at rest."""
        zero = np.zeros((1, 3))
        return Motion(np.vstack([m.p, zero]), np.concatenate([m.R, np.eye(3)[None]]), np.vstack([m.v, zero]),
                      np.vstack([m.w, zero]))  # fmt: skip

    def constraints(self, motion: Motion) -> tuple[Array, Array, Array, Array]:
        """g, its jacobian by (v, w) of all bodies, its rate, and its second rate without accelerations."""
        m = self._with_world(motion)

        def turned(body: Array, x: Array) -> Array:
            return np.einsum("kij,kj->ki", m.R[body], x)

        cross = np.cross
        n, places, turns = self.n, len(self.pa), len(self.ta)
        wa, wb = m.w[self.pa], m.w[self.pb]
        ra, rb, e = turned(self.pa, self.sa), turned(self.pb, self.sb), turned(self.pa, self.axis)
        d = m.p[self.pb] + rb - m.p[self.pa] - ra
        rate = m.v[self.pb] + cross(wb, rb) - m.v[self.pa] - cross(wa, ra)
        second = cross(wb, cross(wb, rb)) - cross(wa, cross(wa, ra))
        e1 = cross(wa, e)
        e2 = cross(wa, e1)

        def dot(x: Array, y: Array) -> Array:
            return np.asarray((x * y).sum(1))

        g = [dot(e, d)]
        dg = [dot(e1, d) + dot(e, rate)]
        bias = [dot(e2, d) + 2 * dot(e1, rate) + dot(e, second)]
        J = np.zeros((places + turns, n + 1, 6))
        row = np.arange(places)
        J[row, self.pa, :3] -= e
        J[row, self.pa, 3:] += cross(e, d) - cross(ra, e)
        J[row, self.pb, :3] += e
        J[row, self.pb, 3:] += cross(rb, e)
        if turns:
            wa, wb = m.w[self.ta], m.w[self.tb]
            f, s = turned(self.ta, self.first), turned(self.tb, self.second)
            f1, s1 = cross(wa, f), cross(wb, s)
            g.append(dot(f, s))
            dg.append(dot(f1, s) + dot(f, s1))
            bias.append(dot(cross(wa, f1), s) + 2 * dot(f1, s1) + dot(f, cross(wb, s1)))
            row = places + np.arange(turns)
            J[row, self.ta, 3:] += cross(f, s)
            J[row, self.tb, 3:] += cross(s, f)
        return np.concatenate(g), J[:, :n].reshape(-1, 6 * n), np.concatenate(dg), np.concatenate(bias)

    def _by_mass(self, R: Array, x: Array) -> Array:
        """The inverse mass matrix times forces, (..., 6 n)."""
        x = x.reshape(*x.shape[:-1], self.n, 6)
        turned = np.linalg.inv(R @ self.inertia @ R.transpose(0, 2, 1))
        turn = np.einsum("nij,...nj->...ni", turned, x[..., 3:])
        return np.concatenate([x[..., :3] / self.mass[:, None], turn], -1).reshape(*x.shape[:-2], 6 * self.n)

    def accelerations(self, t: float, m: Motion) -> tuple[Array, Array, Array]:
        """Of the centres, and angular ones, (n, 6); the multipliers (force along a row's axis, on b)."""
        force = self.mass[:, None] * self.gravity
        inertia = m.R @ self.inertia @ m.R.transpose(0, 2, 1)
        moment = -np.cross(m.w, np.einsum("nij,nj->ni", inertia, m.w))
        if self.forces is not None:
            f, c = self.forces(t, m)
            force, moment = force + f, moment + c
        free = self._by_mass(m.R, np.hstack([force, moment]).ravel())
        _, J, _, bias = self.constraints(m)
        by = self._by_mass(m.R, J)
        multipliers = np.linalg.lstsq(J @ by.T, -(bias + J @ free), rcond=1e-11)[0]
        return (free + multipliers @ by).reshape(self.n, 6), multipliers, J

    def put_back(self, m: Motion, tol: float = 1e-15) -> Motion:
        """Onto the constraints, by the way that is the shortest in the kinetic energy."""
        m = m.copy()
        for _ in range(20):
            g, J, *_ = self.constraints(m)
            by = self._by_mass(m.R, J)
            step = (np.linalg.lstsq(J @ by.T, -g, rcond=1e-11)[0] @ by).reshape(self.n, 6)
            m.p += step[:, :3]
            m.R = Rotation.from_rotvec(step[:, 3:]).as_matrix() @ m.R
            if np.abs(step).max() < tol:
                break
        _, J, rate, _ = self.constraints(m)
        by = self._by_mass(m.R, J)
        step = (np.linalg.lstsq(J @ by.T, -rate, rcond=1e-11)[0] @ by).reshape(self.n, 6)
        m.v += step[:, :3]
        m.w += step[:, 3:]
        return m

    def energy(self, m: Motion) -> float:
        inertia = m.R @ self.inertia @ m.R.transpose(0, 2, 1)
        kinetic = 0.5 * (self.mass @ (m.v**2).sum(1) + np.einsum("ni,nij,nj->", m.w, inertia, m.w))
        return float(kinetic - self.mass @ m.p @ self.gravity)

    def run(self, start: Motion, t: Array, tol: float = 1e-12) -> list[Motion]:
        """At the times t; put back onto the constraints at each of them."""
        n = self.n

        def pack(m: Motion) -> Array:
            turns = Rotation.from_matrix(m.R).as_quat()
            return np.concatenate([m.p.ravel(), turns.ravel(), m.v.ravel(), m.w.ravel()])

        def unpack(y: Array) -> Motion:
            p, q, v, w = np.split(y, [3 * n, 7 * n, 10 * n])
            return Motion(p.reshape(n, 3), Rotation.from_quat(q.reshape(n, 4)).as_matrix(), v.reshape(n, 3),
                          w.reshape(n, 3))  # fmt: skip

        def rates(now: float, y: Array) -> Array:
            m = unpack(y)
            a, *_ = self.accelerations(now, m)
            q = y[3 * n : 7 * n].reshape(n, 4)
            dq = np.empty_like(q)
            dq[:, :3] = 0.5 * (q[:, 3:] * m.w + np.cross(m.w, q[:, :3]))
            dq[:, 3] = -0.5 * (m.w * q[:, :3]).sum(1)
            return np.concatenate([m.v.ravel(), dq.ravel(), a[:, :3].ravel(), a[:, 3:].ravel()])

        found = [self.put_back(start)]
        for begin, end in pairwise(t):
            y = pack(found[-1])
            done = solve_ivp(rates, (begin, end), y, "DOP853", rtol=tol, atol=tol * 1e-2)
            found.append(self.put_back(unpack(done.y[:, -1])))
        return found


def bar(mass: float, length: float, side: float, along: int = 0) -> Array:
    """Inertia of a bar of square section about its centre."""
    inertia = np.full(3, mass * (length**2 + side**2) / 12)
    inertia[along] = mass * side**2 / 6
    return np.diag(inertia)


# -- Andrews' squeezer -------------------------------------------------------------------------------------------------


class Andrews:
    """In the seven angles beta, Theta, gamma, Phi, delta, Omega, epsilon of Hairer and Wanner; SI units."""

    m = np.array([0.04325, 0.00365, 0.02373, 0.00706, 0.07050, 0.00706, 0.05498])
    I = np.array([2.194e-6, 4.410e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5])
    A, B, C = np.array([-0.06934, -0.00227]), np.array([-0.03635, 0.03273]), np.array([0.014, 0.072])
    d, da, e, ea, rr, ra = 28e-3, 115e-4, 2e-2, 1421e-5, 7e-3, 92e-5
    ss, sa, sb, sc, sd = 35e-3, 1874e-5, 1043e-5, 18e-3, 2e-2
    ta, tb, u, ua, ub, zf, zt, fa = 2308e-5, 916e-5, 4e-2, 1228e-5, 449e-5, 2e-2, 4e-2, 1421e-5
    spring, rest, torque, end = 4530.0, 7785e-5, 33e-3, 0.03
    start = np.array([-0.0617138900142764496358948458001, 0, 0.455279819163070380255912382449,
                      0.222668390165885884674473185609, 0.487364979543842550225598953530,
                      -0.222668390165885884674473185609, 1.23054744454982119249735015568])  # fmt: skip
    # Test set for IVP solvers, problem II-10: angles, rates and accelerations at 0.03 s, by PSIDE with 1e-14 on a Cray
    q_end = np.array([0.1581077119629904e2, -0.1575637105984298e2, 0.4082224013073101e-1, -0.5347301163226948,
                      0.5244099658805304, 0.5347301163226948, 0.1048080741042263e1])  # fmt: skip
    v_end = np.array([0.1139920302151208e4, -0.1424379294994111e4, 0.1103291221937134e2, 0.1929337464421385e2,
                      0.5735699284790808, -0.1929337464421385e2, 0.3231791658026955])  # fmt: skip

    def matrices(self, q: Array, v: Array) -> tuple[Array, Array, Array, Array, Array]:
        """Mass matrix, forces, g, its jacobian, and its second rate without accelerations."""
        be, th, ga, ph, de, om, ep = q
        m, I, s, c = self.m, self.I, np.sin, np.cos
        d, da, e, rr, ss, zf, zt, u = self.d, self.da, self.e, self.rr, self.ss, self.zf, self.zt, self.u
        a, b = e - self.ea, zf - self.fa
        M = np.zeros((7, 7))
        M[0, 0] = m[0] * self.ra**2 + m[1] * (rr**2 - 2 * da * rr * c(th) + da**2) + I[0] + I[1]
        M[0, 1] = M[1, 0] = m[1] * (da**2 - da * rr * c(th)) + I[1]
        M[1, 1] = m[1] * da**2 + I[1]
        M[2, 2] = m[2] * (self.sa**2 + self.sb**2) + I[2]
        M[3, 3] = m[3] * a**2 + I[3]
        M[3, 4] = M[4, 3] = m[3] * (a**2 + zt * a * s(ph)) + I[3]
        M[4, 4] = m[3] * (zt**2 + 2 * zt * a * s(ph) + a**2) + m[4] * (self.ta**2 + self.tb**2) + I[3] + I[4]
        M[5, 5] = m[5] * b**2 + I[5]
        M[5, 6] = M[6, 5] = m[5] * (b**2 - u * b * s(om)) + I[5]
        M[6, 6] = m[5] * (b**2 - 2 * u * b * s(om) + u**2) + m[6] * (self.ua**2 + self.ub**2) + I[5] + I[6]
        at = self.B + np.array([self.sd * c(ga) + self.sc * s(ga), self.sd * s(ga) - self.sc * c(ga)])
        way = at - self.C
        length = np.hypot(*way)
        fx, fy = -self.spring * (length - self.rest) / length * way
        f = np.array([
            self.torque - m[1] * da * rr * v[1] * (v[1] + 2 * v[0]) * s(th), m[1] * da * rr * v[0] ** 2 * s(th),
            fx * (self.sc * c(ga) - self.sd * s(ga)) + fy * (self.sd * c(ga) + self.sc * s(ga)),
            m[3] * zt * a * v[4] ** 2 * c(ph), -m[3] * zt * a * v[3] * (v[3] + 2 * v[4]) * c(ph),
            -m[5] * u * b * v[6] ** 2 * c(om), m[5] * u * b * v[5] * (v[5] + 2 * v[6]) * c(om),
        ])  # fmt: skip

        # the point where three bodies meet, as sums of arms at angles: length, angle, and by which coordinates it turns
        crank = [(rr, be, [0]), (-d, be + th, [0, 1])]
        third = [(ss, ga - np.pi / 2, [2])]
        fifth = [(e, ph + de - np.pi / 2, [3, 4]), (zt, de, [4])]
        seventh = [(zf, om + ep, [5, 6]), (u, ep - np.pi / 2, [6])]

        def point(arms: list[tuple[float, float, list[int]]]) -> tuple[Array, Array, Array]:
            x, J, bias = np.zeros(2), np.zeros((2, 7)), np.zeros(2)
            for long, angle, turns in arms:
                arm = long * np.array([c(angle), s(angle)])
                x += arm
                J[:, turns] += np.array([[-arm[1]], [arm[0]]])
                bias -= arm * v[turns].sum() ** 2
            return x, J, bias

        p, J, bias = point(crank)
        others = [point(third), point(fifth), point(seventh)]
        g = np.concatenate([p - x - base for (x, *_), base in zip(others, (self.B, self.A, self.A), strict=True)])
        return M, f, g, np.vstack([J - x[1] for x in others]), np.concatenate([bias - x[2] for x in others])

    def accelerations(self, q: Array, v: Array) -> tuple[Array, Array]:
        M, f, _, J, bias = self.matrices(q, v)
        by = np.linalg.solve(M, np.column_stack([f, J.T]))
        multipliers = np.linalg.solve(J @ by[:, 1:], -(bias + J @ by[:, 0]))
        return by[:, 0] + by[:, 1:] @ multipliers, multipliers

    def put_back(self, q: Array, v: Array) -> tuple[Array, Array]:
        q, v = q.copy(), v.copy()
        for _ in range(5):
            M, _, g, J, _ = self.matrices(q, v)
            by = np.linalg.solve(M, J.T)
            q -= by @ np.linalg.solve(J @ by, g)
        M, _, _, J, _ = self.matrices(q, v)
        by = np.linalg.solve(M, J.T)
        return q, v - by @ np.linalg.solve(J @ by, J @ v)

    def run(self, t: Array, tol: float = 1e-13) -> tuple[Array, Array]:
        def rates(_: float, y: Array) -> Array:
            return np.concatenate([y[7:], self.accelerations(y[:7], y[7:])[0]])

        q, v = self.put_back(self.start, np.zeros(7))
        found = [(q, v)]
        for begin, end in pairwise(t):
            y = solve_ivp(rates, (begin, end), np.concatenate([q, v]), "DOP853", rtol=tol, atol=1e-15).y[:, -1]
            q, v = self.put_back(y[:7], y[7:])
            found.append((q, v))
        return np.array([x for x, _ in found]), np.array([x for _, x in found])


ANDREWS = Andrews()


# -- four bars ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class FourBar:
    """Crank, coupler and rocker, uniform rods in the plane x, y; the rocker's foot on the x axis. Angles from +x."""

    crank: float = 0.2
    coupler: float = 0.5
    rocker: float = 0.4
    base: float = 0.45
    density: float = 2.0  # kg/m
    torque: float = 0.0  # on the crank (N m)
    gravity: float = GRAVITY  # along -y

    def angles(self, crank: Any) -> tuple[Any, Any]:
        """Of the coupler and of the rocker; analytic, so that complex steps go through."""
        x, y = self.crank * np.cos(crank), self.crank * np.sin(crank)
        # |(x, y) + coupler e(b) - (base, 0)| = rocker
        dx, dy = self.base - x, -y
        far = np.sqrt(dx * dx + dy * dy)
        inside = (far * far + self.coupler**2 - self.rocker**2) / (2 * far * self.coupler)
        way = np.arctan(dy / dx) + np.arccos(inside)
        px, py = x + self.coupler * np.cos(way) - self.base, y + self.coupler * np.sin(way)
        return way, 2 * np.arctan(py / (self.rocker + px))

    def _sums(self, crank: complex) -> tuple[complex, complex, complex]:
        """Heights' sum of masses, and the turns of coupler and rocker."""
        way, back = self.angles(crank)
        a, b, c = self.crank, self.coupler, self.rocker
        s = np.sin
        height = a * (a / 2 * s(crank)) + b * (a * s(crank) + b / 2 * s(way)) + c * (c / 2 * s(back))
        return self.density * height, way, back

    def inertia_and_force(self, crank: float) -> tuple[float, float, float]:
        """I(x) of T = I x'^2 / 2, its slope, and -dV/dx + torque."""

        def turns(x: float) -> tuple[float, float, float, float]:
            """Rates of coupler and rocker per rate of the crank, and their slopes, from the closed loop."""
            way, back = (float(np.real(z)) for z in self.angles(x))
            a, b, c = self.crank, self.coupler, self.rocker
            lhs = np.array([[-b * np.sin(way), c * np.sin(back)], [b * np.cos(way), -c * np.cos(back)]])
            first = np.linalg.solve(lhs, a * np.array([np.sin(x), -np.cos(x)]))
            rhs = a * np.array([np.cos(x), np.sin(x)])
            rhs += b * first[0] ** 2 * np.array([np.cos(way), np.sin(way)])
            rhs -= c * first[1] ** 2 * np.array([np.cos(back), np.sin(back)])
            return (*first, *np.linalg.solve(lhs, rhs))  # type: ignore[return-value]

        b1, c1, b2, c2 = turns(crank)
        way, _ = (float(np.real(z)) for z in self.angles(crank))
        a, b, c = self.crank, self.coupler, self.rocker
        cos, sin = np.cos(crank - way), np.sin(crank - way)
        inertia = a**3 / 3 + b * (a**2 + a * b * cos * b1 + b**2 / 3 * b1**2) + c**3 / 3 * c1**2
        slope = b * (a * b * (-sin * (1 - b1) * b1 + cos * b2) + 2 * b**2 / 3 * b1 * b2) + 2 * c**3 / 3 * c1 * c2
        h = 1e-30
        force = self.torque - self.gravity * float(np.imag(self._sums(crank + 1j * h)[0])) / h
        return self.density * inertia, self.density * slope, force

    def rub(self, x: float, end: float, coulomb: float, tol: float = 1e-12) -> float:
        """The crank's angle at the end, from rest at x, with dry friction (N m) at the rocker's foot; from one
        turn back of the crank to the next. It must not stick there."""

        def by_rocker(x: float) -> float:
            return float(np.imag(self.angles(x + 1e-30j)[1])) / 1e-30

        def turned_back(_: float, y: Array) -> float:
            return float(y[1])

        turned_back.terminal = True  # type: ignore[attr-defined]
        t, v = 0.0, 0.0
        while t < end:
            _, _, force = self.inertia_and_force(x)
            if abs(force) <= coulomb * abs(by_rocker(x)):
                raise ValueError(f"it sticks at {t} s")
            way = np.sign(force)

            def rates(_: float, y: Array, way: float = way) -> list[float]:
                inertia, slope, force = self.inertia_and_force(y[0])
                share = by_rocker(y[0])
                rubs = coulomb * np.sign(way * share) * share
                return [y[1], (force - 0.5 * slope * y[1] ** 2 - rubs) / inertia]

            turned_back.direction = -way  # type: ignore[attr-defined]
            y = solve_ivp(rates, (t, end), [x, v], "DOP853", rtol=tol, atol=tol * 0.1, events=[turned_back])
            t, x, v = float(y.t[-1]), float(y.y[0, -1]), 0.0
        return x

    def energy(self, x: float, v: float) -> float:
        return 0.5 * self.inertia_and_force(x)[0] * v**2 + self.gravity * float(np.real(self._sums(x)[0]))

    def run(self, x: float, v: float, t: Array, tol: float = 1e-13) -> Array:
        """Crank, coupler, rocker (unwrapped), and the crank's rate, at the times t."""

        def rates(_: float, y: Array) -> list[float]:
            inertia, slope, force = self.inertia_and_force(y[0])
            return [y[1], (force - 0.5 * slope * y[1] ** 2) / inertia]

        y = solve_ivp(rates, (t[0], t[-1]), [x, v], "DOP853", t, rtol=tol, atol=tol * 1e-2).y
        angles = np.array([self.angles(z) for z in y[0]]).real
        return np.column_stack([y[0], angles, y[1]])


FOURBAR = FourBar()


def double_four_bar(t: Array, speed: float = 1.0, length: float = 1.0) -> tuple[Array, Array]:
    """Angle of the cranks from upright and their rate: three cranks and two couplers of 1 kg and `length` as one body;
    the time of an angle by an integral of the energy."""
    weight, inertia = 3.5 * GRAVITY * length, 3.0 * length**2  # cranks 1/3 each, couplers 1 each

    def rate(angle: float) -> float:
        return float(np.sqrt((speed / length) ** 2 + 2 * weight / inertia * (1 - np.cos(angle))))

    turn = quad(lambda x: 1 / rate(x), 0, 2 * np.pi, epsabs=0, epsrel=3e-14, limit=500)[0]
    angles = []
    for now in t:
        turns, left = divmod(now, turn)
        if left == 0:
            angles.append(2 * np.pi * turns)
            continue
        at = brentq(lambda x, left=left: quad(lambda z: 1 / rate(z), 0, x, epsabs=0, epsrel=1e-13, limit=500)[0] - left,
                    0, 2 * np.pi, xtol=1e-14, rtol=1e-14)  # fmt: skip
        angles.append(2 * np.pi * turns + at)
    found = np.array(angles)
    return found, np.array([rate(x) for x in found])


# -- Bricard's six hinges ----------------------------------------------------------------------------------------------

BRICARD_CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, -1, 0], [1, -1, 1], [0, -1, 1], [0, 0, 1]], float)
BRICARD_HINGES = np.array([Y, Z, X, Y, Z, X])  # at these corners, square to both rods


def bricard() -> tuple[Bodies, Motion]:
    """Five bars of 1 m, 1 kg, 0.1 m thick, and the ground (from the last corner to the first); gravity along -y."""
    bodies, holds = [], []
    centres = np.array([(BRICARD_CORNERS[k] + BRICARD_CORNERS[k + 1]) / 2 for k in range(5)])
    for k in range(5):
        along = int(np.argmax(np.abs(BRICARD_CORNERS[k + 1] - BRICARD_CORNERS[k])))
        bodies.append(Rigid(1.0, bar(1.0, 1.0, 0.1, along)))
    for k in range(6):
        a, b = k - 1, k if k < 5 else WORLD
        frame = axes_with(BRICARD_HINGES[k])

        def on(body: int, k: int = k, frame: Array = frame) -> tuple[Array, Array]:
            centre = np.zeros(3) if body == WORLD else centres[body]
            return BRICARD_CORNERS[k] - centre, frame

        holds.append(Hold("revolute", a, b, on(a), on(b)))
    zero = np.zeros((5, 3))
    start = Motion(centres, np.tile(np.eye(3), (5, 1, 1)), zero, zero.copy())
    return Bodies(bodies, holds, (0, -GRAVITY, 0)), start


def bricard_angles(m: Motion) -> tuple[Array, Array]:
    """Turns of the six hinges from the start, (6,), and their rates."""
    R = np.concatenate([np.eye(3)[None], m.R, np.eye(3)[None]])
    w = np.vstack([np.zeros(3), m.w, np.zeros(3)])
    angles, rates = np.empty(6), np.empty(6)
    for k in range(6):
        turn = Rotation.from_matrix(R[k].T @ R[k + 1]).as_rotvec()
        angles[k] = turn @ BRICARD_HINGES[k]
        rates[k] = R[k].T @ (w[k + 1] - w[k]) @ BRICARD_HINGES[k]
    return angles, rates


# -- a robot of three arms ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Delta:
    """Three upper arms on hinges of the base, each with two parallel rods on balls that hold the platform, below.

    Each rod has a universal joint at its upper end and a ball at the lower one, so that it does not spin."""

    base: float = 0.2  # of the hinges from the axis (m)
    plate: float = 0.05  # of the rods' lower ends from the axis
    upper: float = 0.25
    lower: float = 0.6
    apart: float = 0.08  # of the two rods
    upper_mass: float = 0.6
    lower_mass: float = 0.1
    plate_mass: float = 0.5
    down: float = 0.35  # of the upper arms at the start (rad)

    def way(self, arm: int) -> tuple[Array, Array]:
        """Outward, and along the hinge."""
        angle = 2 * np.pi * arm / 3
        out = np.array([np.cos(angle), np.sin(angle), 0])
        return out, np.cross(Z, out)

    def start(self) -> tuple[Array, Array, Array]:
        """Elbows' middles (3, 3), the plate's centre, the directions of rods (3, 3)."""
        elbows, wrists = [], []
        for arm in range(3):
            out, _ = self.way(arm)
            elbows.append(self.base * out + self.upper * (np.cos(self.down) * out - np.sin(self.down) * Z))
            wrists.append(self.plate * out)
        across = self.base + self.upper * np.cos(self.down) - self.plate
        deep = self.upper * np.sin(self.down) + np.sqrt(self.lower**2 - across**2)
        plate = np.array([0, 0, -deep])
        rods = np.array([(plate + w - e) / self.lower for e, w in zip(elbows, wrists, strict=True)])
        return np.array(elbows), plate, rods

    def bodies(self) -> tuple[Bodies, Motion]:
        """Bodies: three arms, then two rods of each arm, then the plate."""
        elbows, plate, ways = self.start()
        bodies: list[Rigid] = []
        holds: list[Hold] = []
        centres: list[Array] = []
        thin = self.lower_mass * 1e-4
        for arm in range(3):
            out, hinge = self.way(arm)
            foot = self.base * out
            along = (elbows[arm] - foot) / self.upper
            long = self.upper_mass * self.upper**2 / 12
            bodies.append(Rigid(self.upper_mass, long * (np.eye(3) - np.outer(along, along)) + 1e-4 * np.eye(3)))
            centres.append((foot + elbows[arm]) / 2)
        for arm in range(3):
            _, hinge = self.way(arm)
            for side in (-1, 1):
                long = self.lower_mass * self.lower**2 / 12
                turned = np.outer(ways[arm], ways[arm])
                bodies.append(Rigid(self.lower_mass, long * (np.eye(3) - turned) + thin * turned))
                centres.append(elbows[arm] + side * self.apart / 2 * hinge + self.lower / 2 * ways[arm])
        bodies.append(Rigid(self.plate_mass, np.diag([4e-4, 4e-4, 7e-4])))
        centres.append(plate)
        for arm in range(3):
            out, hinge = self.way(arm)
            foot, frame = self.base * out, axes_with(hinge)
            holds.append(Hold("revolute", WORLD, arm, (foot, frame), (foot - centres[arm], frame)))
            for k, side in enumerate((-1, 1)):
                body = 3 + 2 * arm + k
                top = elbows[arm] + side * self.apart / 2 * hinge
                low = top + self.lower * ways[arm]
                # the first axis of the universal joint is the hinge's, the second is square to it and to the rod
                second = np.cross(ways[arm], hinge)
                cross = np.column_stack([hinge, second, np.cross(hinge, second)])
                holds.append(Hold("universal", arm, body, (top - centres[arm], cross), (top - centres[body], cross)))
                holds.append(Hold("spherical", body, 9, (low - centres[body], np.eye(3)), (low - plate, np.eye(3))))
        zero = np.zeros((10, 3))
        start = Motion(np.array(centres), np.tile(np.eye(3), (10, 1, 1)), zero, zero.copy())
        return Bodies(bodies, holds, (0, 0, -GRAVITY)), start


DELTA = Delta()


# -- chains by chance, closed by each kind of joint --------------------------------------------------------------------


def _pose(place: Array, turn: Array) -> Array:
    made = np.eye(4)
    made[:3, :3], made[:3, 3] = Rotation.from_rotvec(turn).as_matrix(), place
    return made


def _moved(kind: str, axis: Array, rng: np.random.Generator) -> Array:
    """A joint's pose, somewhere: as of a tree's joint."""
    q = rng.uniform(-0.6, 0.6, 3)
    made = np.eye(4)
    if kind in ("prismatic", "cylindrical"):
        made[:3, 3] = q[0] * axis
    if kind == "planar":
        made[:2, 3] = q[:2]
    turns = {"revolute": [q[1] * axis], "cylindrical": [q[1] * axis], "universal": [q[0] * X, q[1] * Y],
             "planar": [q[2] * Z], "spherical": [q]}.get(kind, [])  # fmt: skip
    for turn in turns:
        made[:3, :3] = made[:3, :3] @ Rotation.from_rotvec(turn).as_matrix()
    return made


def ring(kind: str, from_world: bool, soft: bool, seed: int) -> dict[str, Any]:
    """Seven bodies on hinges; the last one is closed to the second one or to the world. A soft loop is open by some
    hundredths, and its springs and dampers pull. The arm, its state, and what follows from it, as numbers for JSON."""
    rng = np.random.default_rng(seed)
    n, stiffness, damping = 7, (2e3, 300.0), (5.0, 2.0)
    place, turn = rng.uniform(-0.4, 0.4, (n, 3)), rng.uniform(-1, 1, (n, 3))
    axis = rng.normal(size=(n, 3))
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    mass, com = rng.uniform(0.5, 2, n), rng.uniform(-0.2, 0.2, (n, 3))
    inertia = rng.uniform(0.02, 0.03, (n, 3))
    ends = rng.uniform(-0.3, 0.3, (2, 3))  # of a and b, from their links' frames
    closing = rng.normal(size=3)
    closing = closing / np.linalg.norm(closing) if kind in ("revolute", "prismatic", "cylindrical") else Z
    outboard = (rng.uniform(-0.2, 0.2, 3), rng.uniform(-1, 1, 3))
    q, v, tau = rng.uniform(-1, 1, n), rng.uniform(-2, 2, n), rng.uniform(-1, 1, n)
    gravity = np.array([1.0, -2.0, -9.0])
    free = _moved(kind, closing, rng)
    a = WORLD if from_world else 1

    def poses(q: Array) -> list[Array]:
        found = [np.eye(4)]
        for k in range(n):
            found.append(found[-1] @ _pose(place[k], turn[k]) @ _pose(np.zeros(3), q[k] * axis[k]))
        return found

    at = poses(q)
    on_a = at[a + 1] @ _pose(ends[0], np.zeros(3))
    on_b = at[n] @ _pose(ends[1], np.zeros(3))
    inboard = np.linalg.inv(on_a) @ on_b @ np.linalg.inv(_pose(*outboard)) @ np.linalg.inv(free)
    if soft:
        q = q + rng.uniform(-0.03, 0.03, n)
        at = poses(q)
    frame = np.eye(4)
    frame[:3, :3] = axes_with(closing) if kind in ("revolute", "prismatic", "cylindrical") else np.eye(3)
    local_a = _pose(ends[0], np.zeros(3)) @ inboard @ frame
    local_b = _pose(ends[1], np.zeros(3)) @ np.linalg.inv(_pose(*outboard)) @ frame

    def held(kind: str, a: int, b: int, A: Array, B: Array) -> Hold:
        """A and B in the axes of the links' frames."""
        return Hold(kind, a, b, (A[:3, 3] - (0 if a == WORLD else com[a]), A[:3, :3]), (B[:3, 3] - com[b], B[:3, :3]))

    hinges = []
    for k in range(n):
        third = np.eye(4)
        third[:3, :3] = axes_with(axis[k])
        hinges.append(held("revolute", k - 1, k, _pose(place[k], turn[k]) @ third, third))
    loop = held(kind, a, n - 1, local_a, local_b)
    centres = np.array([at[k + 1][:3, :3] @ com[k] + at[k + 1][:3, 3] for k in range(n)])
    R = np.array([x[:3, :3] for x in at[1:]])
    axes = np.einsum("kij,kj->ki", R, axis)
    joints = np.array([x[:3, 3] for x in at[1:]])
    T = np.zeros((n, 6, n))  # speeds and angular velocities of bodies by v
    for k in range(n):
        for j in range(k + 1):
            T[k, :3, j], T[k, 3:, j] = np.cross(axes[j], centres[k] - joints[j]), axes[j]
    bodies = [Rigid(m, np.diag(i)) for m, i in zip(mass, inertia, strict=True)]
    alone = Bodies(bodies, [loop], gravity)
    still = Motion(centres, R, np.zeros((n, 3)), np.zeros((n, 3)))
    g, J, *_ = alone.constraints(still)
    if not soft:
        assert np.abs(g).max() < 1e-14
        by = J @ T.reshape(6 * n, n)
        v = v - np.linalg.pinv(by) @ (by @ v)
    speeds = T @ v
    motion = Motion(centres, R, speeds[:, :3], speeds[:, 3:])
    moment = axes * tau[:, None] - np.vstack([axes[1:] * tau[1:, None], np.zeros(3)])

    def forces(_: float, m: Motion) -> tuple[Array, Array]:
        force = np.column_stack([np.zeros((n, 3)), moment])
        if soft:
            g, J, rate, _ = alone.constraints(m)
            turns = np.array([row[1] == "turn" for row in alone.rows])
            k, d = np.where(turns, *stiffness[::-1]), np.where(turns, *damping[::-1])
            force = force + (-(k * g + d * rate) @ J).reshape(n, 6)
        return force[:, :3], force[:, 3:]

    whole = Bodies(bodies, hinges if soft else [*hinges, loop], gravity, forces)
    acceleration, multipliers, J = whole.accelerations(0.0, motion)
    turning = np.vstack([np.zeros(3), acceleration[:, 3:]])
    joint = ((turning[1:] - turning[:-1]) * axes).sum(1)
    if soft:
        g, J, rate, _ = alone.constraints(motion)
        turns = np.array([row[1] == "turn" for row in alone.rows])
        on_rows = -(np.where(turns, *stiffness[::-1]) * g + np.where(turns, *damping[::-1]) * rate)
        on_last = (on_rows @ J).reshape(n, 6)[n - 1]
    else:
        mine = np.array([row[0] == n for row in whole.rows])
        on_last = (multipliers[mine] @ J[mine]).reshape(n, 6)[n - 1]
    arm_of = R[n - 1] @ loop.on_b[0]  # from the last body's centre to the loop's frame on it
    joint_of = {"kind": kind, "axis": closing.tolist(),
                "inboard": [inboard[:3, 3].tolist(), Rotation.from_matrix(inboard[:3, :3]).as_rotvec().tolist()],
                "outboard": [x.tolist() for x in outboard]}  # fmt: skip
    return {
        "links": [{"position": p.tolist(), "rotation": r.tolist(), "axis": x.tolist(), "mass": float(m),
                   "com": c.tolist(), "inertia": i.tolist()}
                  for p, r, x, m, c, i in zip(place, turn, axis, mass, com, inertia, strict=True)],
        "a": [None if a == WORLD else a, ends[0].tolist()], "b": [n - 1, ends[1].tolist()], "joint": joint_of,
        "soft": [*stiffness, *damping] if soft else None, "gravity": gravity.tolist(), "q": q.tolist(),
        "v": v.tolist(), "tau": tau.tolist(), "acceleration": joint.tolist(), "force": on_last[:3].tolist(),
        "moment": (on_last[3:] - np.cross(arm_of, on_last[:3])).tolist(),
    }  # fmt: skip


# -- the flexible slider crank of the IVP test set ---------------------------------------------------------------------


@dataclass(frozen=True)
class Rod:
    """A crank that turns at a constant speed moves a block along x by a flexible rod: sines across the chord, and
    polynomials along it. `curved`: the rod's stretch is u' + v'^2 / 2, else u'.

    The test set's own rod is TESTSET: not curved, and its mass matrix of the shapes along it has 8, 1 and 2 in place of
    8/15, 1/15 and 2/15, so that 14 ghosts of the rod go with these shapes."""

    sines: int = 2
    along: int = 2
    curved: bool = False
    crank: float = 0.15
    length: float = 0.30
    block: float = 0.075552
    side: float = 0.008
    E: float = 0.2e12
    density: float = 7870.0
    speed: float = 150.0
    damping: float = 0.0  # retardation time (s) of Kelvin and Voigt
    pi: float = np.pi
    ghost: float = 0.0  # times the rod's mass, which sits at (u, 0) of the chord's axes about the origin
    # Test set for IVP solvers, problem CRANK (index 2), initial values 1: at 0.1 s; its pi is 3.1415927
    START: tuple[float, ...] = field(default=(0.0, 0.0, 0.103339863e-4, 0.169327969e-4), repr=False)
    START_RATES: tuple[float, ...] = field(
        default=(0.444896105, 0.463434311e-2, -0.178591076e-5, -0.268938672e-5), repr=False)  # fmt: skip
    END: tuple[float, ...] = field(
        default=(-3.311734987910881e-1, 1.697373326718410e-1, 1.893192460247178e-4, 2.375751865617931e-5,
                 -5.323907988763734e-6, -8.363283141616840e-6), repr=False)  # fmt: skip

    @cached_property
    def shapes(self) -> dict[str, Array]:
        """At Gauss points: v and v', v'' by sines; u and u' by polynomials, the last of which is 1 at the end."""
        x, w = legendre.leggauss(40)
        s, w = (x + 1) / 2, w / 2 * self.length
        k = np.arange(1, self.sines + 1) * self.pi
        v, dv = np.sin(np.outer(k, s)), k[:, None] / self.length * np.cos(np.outer(k, s))
        ddv = -((k[:, None] / self.length) ** 2) * v
        # bubbles s^j (1 - s) of degree 2 and more, and s; of two: 4 s (1 - s), the middle's node, and s (2 s - 1)
        u, du = [], []
        for j in range(1, self.along):
            p = np.polynomial.Polynomial([0, 4, -4]) * np.polynomial.Legendre.basis(j - 1, [0, 1]).convert(
                kind=np.polynomial.Polynomial)  # fmt: skip
            u.append(p(s))
            du.append(p.deriv()(s) / self.length)
        last = np.polynomial.Polynomial([0, -1, 2])
        u.append(last(s))
        du.append(last.deriv()(s) / self.length)
        return {"w": w, "s": s, "v": v, "dv": dv, "ddv": ddv, "u": np.array(u), "du": np.array(du)}

    def split(self, q: Array) -> tuple[Array, Array]:
        return q[: self.sines], q[self.sines :]

    def angle(self, t: float, q: Array, dq: Array) -> tuple[float, float, float, float]:
        """Of the chord, its rate, the rate by the last coordinate's, and the second rate without that."""
        long, grows = self.length + q[-1], dq[-1]
        a, s = self.speed * t, self.speed
        angle = float(np.arcsin(-self.crank * np.sin(a) / long))
        c, sn = np.cos(angle), np.sin(angle)
        # r sin a + long sin b = 0, and its two derivatives
        rate = -(self.crank * s * np.cos(a) + grows * sn) / (long * c)
        by_last = -sn / (long * c)
        bias = -(-self.crank * s**2 * np.sin(a) + 2 * grows * rate * c - long * rate**2 * sn) / (long * c)
        return angle, float(rate), float(by_last), float(bias)

    def accelerations(self, t: float, q: Array, dq: Array) -> Array:
        """Virtual work of all slices and of the block, whose places are functions of q and of the time."""
        sh, n = self.shapes, self.sines + self.along
        qv, qu = self.split(q)
        dqv, dqu = self.split(dq)
        b, rate, by_last, bias = self.angle(t, q, dq)
        v, u = qv @ sh["v"], qu @ sh["u"]
        x = self.length * sh["s"] + u
        dv, du = dqv @ sh["v"], dqu @ sh["u"]
        a, s = self.speed * t, self.speed
        c, sn = np.cos(b), np.sin(b)
        # in the chord's axes: the crank pin's acceleration, slices' velocities by q, and accelerations without q''
        pin = -self.crank * s**2 * np.array([np.cos(a), np.sin(a)])
        pin = np.array([c * pin[0] + sn * pin[1], -sn * pin[0] + c * pin[1]])
        by = np.zeros((2, n, len(x)))
        by[0, self.sines :], by[1, : self.sines] = sh["u"], sh["v"]
        by[0, -1] += -v * by_last
        by[1, -1] += x * by_last
        free = np.array([pin[0] - x * rate**2 - v * bias - 2 * rate * dv,
                         pin[1] - v * rate**2 + x * bias + 2 * rate * du])  # fmt: skip
        line = self.density * self.side**2 * sh["w"]
        M = np.einsum("cix,cjx,x->ij", by, by, line)
        f = -np.einsum("cix,cx,x->i", by, free, line)
        if self.ghost:
            by[:] = 0
            by[0, self.sines :] = sh["u"]
            by[1, -1] = u * by_last
            free = np.array([-u * rate**2, u * bias + 2 * rate * du])
            M += self.ghost * np.einsum("cix,cjx,x->ij", by, by, line)
            f -= self.ghost * np.einsum("cix,cx,x->i", by, free, line)
        # sections turn as the chord does; the curved rod's as its slope does too
        turn = np.zeros((n, len(x)))
        if self.curved:
            turn[: self.sines] = sh["dv"]
        turn[-1] += by_last
        line = line * self.side**2 / 12
        M += np.einsum("ix,jx,x->ij", turn, turn, line)
        f -= turn @ line * bias
        # block at r cos a + (length + q) cos b
        long = self.length + q[-1]
        place = np.zeros(n)
        place[-1] = c - long * sn * by_last
        second = -self.crank * s**2 * np.cos(a) - 2 * dq[-1] * sn * rate - long * (c * rate**2 + sn * bias)
        M += self.block * np.outer(place, place)
        f -= self.block * second * place
        # forces of the rod
        area, bend = self.E * self.side**2, self.E * self.side**4 / 12
        slope, stretch = qv @ sh["dv"], qu @ sh["du"]
        stretch_rate = dqu @ sh["du"]
        if self.curved:
            stretch = stretch + slope**2 / 2
            stretch_rate = stretch_rate + slope * (dqv @ sh["dv"])
        pull = area * (stretch + self.damping * stretch_rate) * sh["w"]
        f[self.sines :] -= sh["du"] @ pull
        if self.curved:
            f[: self.sines] -= sh["dv"] @ (pull * slope)
        moment = bend * ((qv + self.damping * dqv) @ sh["ddv"]) * sh["w"]
        f[: self.sines] -= sh["ddv"] @ moment
        return np.linalg.solve(M, f)

    def run(
        self, t: Array, q: Array, dq: Array, tol: float = 1e-11, method: str = "DOP853"
    ) -> tuple[Array, Array]:
        n = self.sines + self.along

        def rates(now: float, y: Array) -> Array:
            return np.concatenate([y[n:], self.accelerations(now, y[:n], y[n:])])

        y = solve_ivp(rates, (t[0], t[-1]), np.concatenate([q, dq]), method, t, rtol=tol, atol=tol * 1e-5).y.T
        return y[:, :n], y[:, n:]

    def ends(self, t: Array, q: Array) -> tuple[Array, Array]:
        """The chord's angle and the block's place."""
        zero = np.zeros(q.shape[1])
        angle = np.array([self.angle(now, x, zero)[0] for now, x in zip(t, q, strict=True)])
        return angle, self.crank * np.cos(self.speed * t) + (self.length + q[:, -1]) * np.cos(angle)


TESTSET = Rod(pi=3.1415927, ghost=14.0)


# -- how sure, and the numbers of the tests ----------------------------------------------------------------------------


DELTA_TORQUES = (0.5, -1.0, 2.0)  # N m, about the arms' hinges


def delta() -> tuple[Bodies, Motion]:
    """DELTA with constant torques on its arms."""
    robot, start = DELTA.bodies()
    moment = np.zeros((10, 3))
    for arm, torque in enumerate(DELTA_TORQUES):
        moment[arm] = torque * DELTA.way(arm)[1]
    robot.forces = lambda t, m: (np.zeros((10, 3)), moment)
    return robot, start


def four_bar_bodies(four: FourBar, x: float, v: float) -> tuple[Bodies, Motion]:
    """The same rods, each on its own."""
    way, back = (float(np.real(z)) for z in four.angles(x))
    lengths, angles = (four.crank, four.coupler, four.rocker), (x, way, back)
    e = np.array([[np.cos(a), np.sin(a), 0] for a in angles])
    elbow, foot = four.crank * e[0], np.array([four.base, 0, 0])
    starts = np.array([np.zeros(3), elbow, foot])
    masses = [four.density * l for l in lengths]
    bodies = [Rigid(m, bar(m, l, 0.0) + 1e-3 * np.outer(X, X)) for m, l in zip(masses, lengths, strict=True)]
    halves = [np.array([l / 2, 0, 0]) for l in lengths]
    I = np.eye(3)
    holds = [Hold("revolute", WORLD, 0, (np.zeros(3), I), (-halves[0], I)),
             Hold("revolute", 0, 1, (halves[0], I), (-halves[1], I)),
             Hold("revolute", WORLD, 2, (foot, I), (-halves[2], I)),
             Hold("revolute", 1, 2, (halves[1], I), (halves[2], I))]  # fmt: skip
    R = np.array([Rotation.from_rotvec(a * Z).as_matrix() for a in angles])
    zero = np.zeros((3, 3))
    motion = Motion(starts + e * np.array(lengths)[:, None] / 2, R, zero, zero.copy())
    whole = Bodies(bodies, holds, np.array([0, -four.gravity, 0]),
                   lambda t, m: (np.zeros((3, 3)), np.array([four.torque * Z, 0 * Z, 0 * Z])))  # fmt: skip
    # rates by a small step of the crank
    h = 1e-30
    b1, c1 = (float(np.imag(z)) / h for z in four.angles(x + 1j * h))
    w = v * np.array([1.0, b1, c1])
    motion.w[:, 2] = w
    turned = np.column_stack([-e[:, 1], e[:, 0], 0 * e[:, 0]])
    motion.v[0] = w[0] * four.crank / 2 * turned[0]
    motion.v[1] = w[0] * four.crank * turned[0] + w[1] * four.coupler / 2 * turned[1]
    motion.v[2] = w[2] * four.rocker / 2 * turned[2]
    return whole, motion


def check() -> None:
    q, v = ANDREWS.run(np.linspace(0, ANDREWS.end, 31))
    off = np.abs(q[-1] - ANDREWS.q_end).max() / np.abs(q[-1]).max()
    print(f"Andrews' squeezer, own steps from the published digits: angles {off:.0e}, rates "
          f"{np.abs(v[-1] - ANDREWS.v_end).max() / np.abs(v[-1]).max():.0e} of the largest")  # fmt: skip
    t = np.linspace(0, 1, 11)
    y = FOURBAR.run(0.5, 3.0, t)
    energy = [FOURBAR.energy(a, b) for a, b in zip(y[:, 0], y[:, 3], strict=True)]
    runs = four_bar_bodies(FOURBAR, 0.5, 3.0)[0].run(four_bar_bodies(FOURBAR, 0.5, 3.0)[1], t)
    angles = np.array([Rotation.from_matrix(m.R).as_rotvec()[:, 2] for m in runs])
    apart = np.abs(np.exp(1j * angles) - np.exp(1j * y[:, :3])).max()
    print(f"four bars: energy changes by {np.ptp(energy) / abs(energy[0]):.0e}; from bodies on their own {apart:.0e}")
    whole, start = bricard()
    runs = whole.run(start, np.linspace(0, 2, 11))
    energy = [whole.energy(m) for m in runs]
    turned = np.array([bricard_angles(m)[0] for m in runs])
    a, b = np.sin(turned[:, 0]), np.sin(turned[:, 1])  # cosines of the hinges' whole angles, 90 degrees at the start
    print(f"Bricard: energy changes by {np.ptp(energy):.0e} J; cos a + cos b + cos a cos b within "
          f"{np.abs(a + b + a * b).max():.0e}")  # fmt: skip
    robot, at = delta()
    runs = robot.run(at, np.linspace(0, 0.2, 5))
    still = DELTA.bodies()[0]
    work = [sum(t * (Rotation.from_matrix(m.R[k]).as_rotvec() @ DELTA.way(k)[1]) for k, t in enumerate(DELTA_TORQUES))
            for m in runs]  # fmt: skip
    left = [still.energy(m) - w for m, w in zip(runs, work, strict=True)]
    print(f"Delta: energy less the torques' work changes by {np.ptp(left):.0e} J")
    t = np.array([0.0, 0.1])
    q, _ = TESTSET.run(t, np.array(TESTSET.START), np.array(TESTSET.START_RATES), 1e-9)
    angle, place = TESTSET.ends(t, q)
    off = np.array([angle[-1], place[-1], *q[-1]]) - TESTSET.END
    print(f"slider crank, own steps from the published digits: {np.abs(off).max():.0e} (rad, m)")


def as_numbers(whole: Bodies, start: Motion, tree: list[int]) -> dict[str, Any]:
    """Bodies and joints for JSON; the joints of `tree`, by their bodies b in turn, make a tree, the others close it.
    A frame is a place from the body's centre, and a rotation vector."""

    def frame(of: tuple[Array, Array]) -> list[list[float]]:
        return [of[0].tolist(), Rotation.from_matrix(of[1]).as_rotvec().tolist()]

    joints = [{"kind": h.kind, "a": h.a, "b": h.b, "on a": frame(h.on_a), "on b": frame(h.on_b)} for h in whole.holds]
    return {
        "mass": whole.mass.tolist(), "inertia": whole.inertia.tolist(), "gravity": whole.gravity.tolist(),
        "tree": [joints[k] for k in tree], "loops": [j for k, j in enumerate(joints) if k not in tree],
    }  # fmt: skip


def numbers() -> dict[str, Any]:
    t = np.linspace(0, 2, 5)
    whole, start = bricard()
    turned = [bricard_angles(m) for m in whole.run(start, t)]
    of_bricard = as_numbers(whole, start, [0, 1, 2, 3, 4])
    robot, at = delta()
    accelerations, *_ = robot.accelerations(0.0, at)
    plate = [m.p[9].tolist() for m in robot.run(at, np.linspace(0, 0.2, 3))]
    # three hinges, then of each arm (universal, ball) twice: bodies in the order of flexarm's links
    of_delta = as_numbers(robot, at, [0, 5, 10, 1, 3, 6, 8, 11, 13, 2])
    angle, rate = double_four_bar(np.linspace(0, 10, 11))
    times = np.array([0.0, 0.25, 0.5, 1.0])
    return {
        "made by": "bench/run/loops_truth.py --write",
        "four bar": {"t": times.tolist(), "start": [0.5, 3.0], "y": FOURBAR.run(0.5, 3.0, times).tolist()},
        "friction": {"coulomb": 0.3, "end": 3.0, "crank": FOURBAR.rub(0.5, 3.0, 0.3)},
        "double four bar": {"t": np.linspace(0, 10, 11).tolist(), "angle": angle.tolist(), "rate": rate.tolist()},
        "bricard": {**of_bricard, "t": t.tolist(), "angle": [a.tolist() for a, _ in turned],
                    "rate": [v.tolist() for _, v in turned]},
        "delta": {**of_delta, "t": [0.0, 0.1, 0.2], "plate": plate, "torques": DELTA_TORQUES,
                  "accelerations": [float(accelerations[k, 3:] @ DELTA.way(k)[1]) for k in range(3)]},
        "andrews": {"q": ANDREWS.q_end.tolist(), "v": ANDREWS.v_end.tolist()},
        "rings": [ring(kind, world, soft, 3) for kind in HOLDS for world in (False, True) for soft in (False, True)],
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="write the numbers of the tests, tests/data/loops.json")
    if not parser.parse_args().write:
        check()
        return
    path = Path(__file__).resolve().parents[2] / "tests" / "data" / "loops.json"
    text = json.dumps(numbers())
    path.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
