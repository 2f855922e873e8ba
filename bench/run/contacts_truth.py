"""What bench/run/contacts.py holds flexarm's contacts against; nothing of flexarm is in it.

    python bench/run/contacts_truth.py            # how sure these numbers are, each by a second way
    python bench/run/contacts_truth.py --write    # those of the tests, into tests/data/contacts.json

- `Law`: the force of a contact. `Motion`: a motion with one contact in a plane, integrated from event to event: touch,
  release, stick, slide; the state of the bristles is one more number while they bend, and known where they slide.
- `Ball`, `restitution`, `elastic_contact`: a ball that falls on a plane; closed forms.
- `Block`: a body on an inclined plane, with a spring that drags it.
- `Falling`: a cantilever that falls on a stop: assembled cubic elements, and their modes.
- `Presser`: two links in a plane, the second a beam that bends by any angle, whose controller presses on a wall and
  slides along it.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import gamma
from pathlib import Path
from typing import Any

import numpy as np
from hermite import hermite
from numpy.polynomial import legendre
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import eigh
from scipy.optimize import brentq

Array = NDArray[np.float64]
GRAVITY, E, RHO = 9.81, 209e9, 7850.0  # of the earth; of steel


# -- the law, and a motion from event to event -------------------------------------------------------------------------


@dataclass(frozen=True)
class Law:
    """Hunt and Crossley's normal force; bristles of stiffness `tangential` that slide at `coulomb` times that."""

    stiffness: float
    damping: float = 0.0  # s/m
    exponent: float = 1.0
    coulomb: float = 0.0
    tangential: float = 0.0

    def normal(self, depth: float, rate: float) -> float:
        d = max(depth, 0.0)
        return float(max(self.stiffness * d**self.exponent * (1 + self.damping * rate), 0.0))

    def normal_rate(self, depth: float, rate: float, second: float) -> float:
        """How the normal force changes in time."""
        d, e = max(depth, 0.0), self.exponent
        if 1 + self.damping * rate <= 0:
            return 0.0
        by_depth = e * d ** (e - 1) * rate * (1 + self.damping * rate)
        return float(self.stiffness * (by_depth + d**e * self.damping * second))

    def friction(self, normal: float, bent: float, slip: float) -> float:
        """Against the slip (m/s), of bristles bent by so much (m)."""
        most = self.coulomb * normal
        return float(min(max(self.tangential * bent + self.damping * normal * slip, -most), most))


@dataclass
class State:
    t: float
    y: Array
    bent: float = 0.0
    mode: str = "air"  # or "stick", "slide"
    way: float = 1.0  # of a slide

    def copy(self) -> State:
        return replace(self, y=self.y.copy())


class Motion:
    """A model tells `touch` (depth, its rate, slip), its `rates` under a normal and a friction force, and with those
    the second derivative of the depth, `deepening`."""

    law: Law
    longest = 1e-3  # step (s), so that no event hides within one

    def touch(self, y: Array) -> tuple[float, float, float]:
        raise NotImplementedError

    def rates(self, t: float, y: Array, normal: float, friction: float) -> Array:
        raise NotImplementedError

    def deepening(self, y: Array, dy: Array) -> float:
        raise NotImplementedError

    def bent(self, state: State, y: Array) -> float:
        """How far the bristles are bent; y with that number last."""
        if state.mode != "slide":
            return float(y[-1])
        depth, rate, _ = self.touch(y[:-1])
        return state.way * self.law.coulomb * self.law.normal(depth, rate) / self.law.tangential

    def forces(self, state: State, y: Array) -> tuple[float, float]:
        """Normal force, and friction against the slip (N)."""
        if state.mode == "air":
            return 0.0, 0.0
        depth, rate, slip = self.touch(y[:-1])
        normal = self.law.normal(depth, rate)
        if not self.law.coulomb:
            return normal, 0.0
        return normal, self.law.friction(normal, self.bent(state, y), slip)

    def creep(self, state: State, t: float, y: Array) -> tuple[float, float]:
        """The slip, and how fast the limit of the bristles moves (m/s)."""
        depth, rate, slip = self.touch(y[:-1])
        dy = self.rates(t, y[:-1], *self.forces(state, y))
        limit = self.law.coulomb * self.law.normal_rate(depth, rate, self.deepening(y[:-1], dy)) / self.law.tangential
        return slip, limit

    def grips(self, state: State, t: float, y: Array) -> float:
        """Positive while a slide goes on."""
        slip, limit = self.creep(state, t, y)
        return state.way * slip - limit

    def go(self, state: State, until: float, t: Array, rtol: float = 1e-11) -> tuple[State, Array]:
        """On from a state; and at the times t, y, the depth, the normal force and the friction."""
        state, rows = state.copy(), np.empty((t.size, state.y.size + 3))
        done = 0

        def slope(t: float, y: Array) -> Array:
            dy = self.rates(t, y[:-1], *self.forces(state, y))
            slip = self.touch(y[:-1])[2] if state.mode == "stick" and self.law.coulomb else 0.0
            return np.append(dy, slip)

        def surface(t: float, y: Array) -> float:
            return self.touch(y[:-1])[0]

        def breaks(t: float, y: Array) -> float:
            depth, rate, _ = self.touch(y[:-1])
            return self.law.tangential * abs(y[-1]) - self.law.coulomb * self.law.normal(depth, rate)

        def grips(t: float, y: Array) -> float:
            return self.grips(state, t, y)

        while True:
            surface.direction = 1.0 if state.mode == "air" else -1.0  # type: ignore[attr-defined]
            breaks.direction, grips.direction = 1.0, -1.0  # type: ignore[attr-defined]
            events = [surface]
            if self.law.coulomb and state.mode != "air":
                events.append(breaks if state.mode == "stick" else grips)
            for event in events:
                event.terminal = True  # type: ignore[attr-defined]
            here = t[done:]
            here = here[here <= until]
            times = np.append(here, until) if not here.size or here[-1] < until else here
            found = solve_ivp(slope, (state.t, until), np.append(state.y, state.bent), "DOP853", times, events=events,
                              rtol=rtol, atol=1e-2 * rtol, max_step=self.longest)  # fmt: skip
            if found.status < 0:
                raise RuntimeError(found.message)
            for y in np.reshape(found.y, (state.y.size + 1, -1)).T[: here.size]:  # an event may come before the first
                rows[done] = [*y[:-1], self.touch(y[:-1])[0], *self.forces(state, y)]
                done += 1
            if found.status == 0:
                y = found.y[:, -1]
                state.bent = self.bent(state, y) if self.law.coulomb else 0.0
                state.t, state.y = until, y[:-1]
                return state, rows
            which = next(k for k, x in enumerate(found.t_events) if x.size)
            y = found.y_events[which][0]
            t_now = float(found.t_events[which][0])
            self.switch(state, which, t_now, y)

    def switch(self, state: State, which: int, t: float, y: Array) -> None:
        """What comes after an event."""
        if which == 0 and state.mode != "air":
            state.mode, state.bent = "air", 0.0
        elif which == 0:
            state.mode, state.bent = "stick", 0.0
            if self.law.coulomb:
                y[-1] = 0.0
                slip, limit = self.creep(state, t, y)
                state.mode, state.way = "slide" if abs(slip) > limit else "stick", float(np.sign(slip))
        elif state.mode == "stick":
            bent = y[-1] if y[-1] else self.touch(y[:-1])[2]
            state.mode, state.way = "slide", float(np.sign(bent))
        else:
            state.bent = self.bent(state, y)
            state.mode = "stick"
        state.t, state.y = t, y[:-1].copy()

    def start(self, y: Array, t: float = 0.0) -> State:
        depth = self.touch(np.asarray(y, float))[0]
        return State(t, np.asarray(y, float), mode="stick" if depth > 0 else "air")

    def run(self, y: Any, t: Array, rtol: float = 1e-11) -> Array:
        """y, depth, normal force and friction at the times t, the first of which is the start."""
        return self.go(self.start(y, t[0]), t[-1], t, rtol)[1]


# -- a ball ------------------------------------------------------------------------------------------------------------


@dataclass
class Ball(Motion):
    """A mass on a vertical slide; y: height (m) over the plane, and its rate."""

    law: Law
    mass: float = 1.0
    gravity: float = GRAVITY

    def touch(self, y: Array) -> tuple[float, float, float]:
        return -y[0], -y[1], 0.0

    def rates(self, t: float, y: Array, normal: float, friction: float) -> Array:
        return np.array([y[1], normal / self.mass - self.gravity])

    def deepening(self, y: Array, dy: Array) -> float:
        return float(-dy[1])


def restitution(damping: float, speed: float) -> float:
    """Speed of release over that of impact (m/s), for any exponent, stiffness and mass, without gravity.

    With w = damping times speed: m w dw / (1 + w) = - k damping^2 d^n dd, so that w - log(1 + w) is the same at both
    ends of the contact (Marhefka and Orin 1999)."""
    w = damping * speed
    if not w:
        return 1.0
    kept = w - np.log1p(w)
    u = brentq(lambda u: np.expm1(u) - u - kept, -kept - 2, -1e-12 * w, xtol=1e-16, rtol=1e-15)  # u = log(1 + w)
    return float(-np.expm1(u) / w)


def deepest(law: Law, mass: float, speed: float) -> float:
    """The depth (m) at which a ball turns back, without gravity."""
    n, a = law.exponent + 1, law.damping
    store = speed**2 / 2 if not a else (a * speed - np.log1p(a * speed)) / a**2
    return float((n * mass / law.stiffness * store) ** (1 / n))


def elastic_contact(law: Law, mass: float, speed: float) -> float:
    """How long (s) an undamped ball touches, without gravity: pi sqrt(m / k) if the exponent is 1."""
    n = law.exponent + 1
    return float(2 * deepest(law, mass, speed) / speed * np.sqrt(np.pi) * gamma(1 + 1 / n) / gamma(0.5 + 1 / n))


def linear_contact(law: Law, mass: float, speed: float, gravity: float = GRAVITY) -> float:
    """How long (s) an undamped ball touches under gravity, exponent 1."""
    w = np.sqrt(law.stiffness / mass)
    return float(2 / w * (np.pi - np.arctan(speed * w / gravity)))


def elastic_fall(law: Law, mass: float, height: float, t: Array, gravity: float = GRAVITY) -> Array:
    """Height (m) of an undamped ball, exponent 1, that is let go at `height`."""
    w, flight = np.sqrt(law.stiffness / mass), np.sqrt(2 * height / gravity)
    speed = gravity * flight
    touching = linear_contact(law, mass, speed, gravity)
    s = np.mod(np.asarray(t) + flight, 2 * flight + touching)  # since the last release
    u = s - 2 * flight
    below = -(gravity / w**2 * (1 - np.cos(w * u)) + speed / w * np.sin(w * u))
    return np.where(u < 0, speed * s - 0.5 * gravity * s**2, below)


# -- a block on an inclined plane --------------------------------------------------------------------------------------


@dataclass
class Block(Motion):
    """A mass that does not turn on an inclined plane; y: its way down the plane (m), its depth, and their rates. A
    spring along the plane goes from it to a place that moves at a speed."""

    law: Law
    mass: float = 2.0
    angle: float = 0.0
    spring: float = 0.0  # N/m
    pulled: float = 0.0  # m/s
    gravity: float = GRAVITY

    @property
    def rest(self) -> float:
        """The depth at which the plane carries it."""
        weight = self.mass * self.gravity * np.cos(self.angle)
        return float((weight / self.law.stiffness) ** (1 / self.law.exponent))

    def touch(self, y: Array) -> tuple[float, float, float]:
        return y[1], y[3], y[2]

    def rates(self, t: float, y: Array, normal: float, friction: float) -> Array:
        down = self.mass * self.gravity * np.sin(self.angle) - self.spring * (y[0] - self.pulled * t) - friction
        into = self.mass * self.gravity * np.cos(self.angle) - normal
        return np.array([y[2], y[3], down / self.mass, into / self.mass])

    def deepening(self, y: Array, dy: Array) -> float:
        return float(dy[3])


def slid(block: Block, t: Array) -> Array:
    """The way down the plane (m) of a block that starts at rest, carried by the plane, where friction does not hold it
    and has no damping: its bristles bend, then it slides."""
    limit = block.law.coulomb * block.mass * block.gravity * np.cos(block.angle)
    drive = block.mass * block.gravity * np.sin(block.angle)
    w = np.sqrt(block.law.tangential / block.mass)
    static = drive / block.law.tangential
    turn = np.arccos(1 - limit / drive) / w  # bristles bend by static (1 - cos w t)
    x0, v0 = limit / block.law.tangential, static * w * np.sin(w * turn)
    u = t - turn
    return np.where(u < 0, static * (1 - np.cos(w * t)), x0 + v0 * u + 0.5 * (drive - limit) / block.mass * u**2)


# -- a cantilever that falls on a stop ---------------------------------------------------------------------------------


@dataclass
class Falling(Motion):
    """A straight cantilever under its weight, let go at rest, whose end falls on a stop; small deflections. y: modal
    coordinates of its finite elements, and their rates."""

    law: Law
    length: float = 0.5
    thick: float = 0.004  # m, in the direction of its fall
    wide: float = 0.02
    tip: float = 0.05  # kg, a point
    retardation: float = 2e-5  # s, of Kelvin and Voigt
    below: float = 1e-3  # m, of the stop under the end
    gravity: float = GRAVITY
    elements: int = 24
    modes: int = 14
    longest: float = 1e-3

    @property
    def bending(self) -> float:
        return E * self.wide * self.thick**3 / 12

    @property
    def mass(self) -> float:
        """A metre."""
        return RHO * self.wide * self.thick

    @cached_property
    def modal(self) -> tuple[Array, Array, Array]:
        """Squares of the frequencies, the end's place, and the weight, by modes."""
        h, n = self.length / self.elements, 2 * self.elements
        M, K = (np.zeros((n + 2, n + 2)) for _ in range(2))
        mass, _, second = hermite(h)
        for k in range(self.elements):
            at = slice(2 * k, 2 * k + 4)
            M[at, at] += self.mass * mass
            K[at, at] += self.bending * second
        M[n, n] += self.tip
        M, K = M[2:, 2:], K[2:, 2:]
        square, shapes = eigh(K, M)
        weight = np.zeros(n)
        load = np.array([h / 2, h * h / 12, h / 2, -h * h / 12])
        for k in range(self.elements):
            at = slice(2 * k - 2, 2 * k + 2)
            weight[max(at.start, 0) : at.stop] += self.mass * (load if k else load[2:])
        weight[n - 2] += self.tip
        keep = slice(0, self.modes)
        return square[keep], shapes[n - 2, keep], -self.gravity * shapes.T[keep] @ weight

    def end(self, y: Array) -> Array:
        """Of rows of y: how far the end has moved (m), upwards."""
        return np.asarray(y[..., : self.modes] @ self.modal[1])

    def touch(self, y: Array) -> tuple[float, float, float]:
        end = self.modal[1]
        return float(-self.below - end @ y[: self.modes]), float(-end @ y[self.modes : 2 * self.modes]), 0.0

    def rates(self, t: float, y: Array, normal: float, friction: float) -> Array:
        square, end, weight = self.modal
        q, v = y[: self.modes], y[self.modes :]
        return np.concatenate([v, weight + normal * end - square * (q + self.retardation * v)])

    def deepening(self, y: Array, dy: Array) -> float:
        return float(-self.modal[1] @ dy[self.modes :])

    def fall(self, t: Array, rtol: float = 1e-11) -> Array:
        return self.run(np.zeros(2 * self.modes), t, rtol)


# -- an arm that presses on a wall and slides along it -----------------------------------------------------------------


@dataclass
class Presser(Motion):
    """A rigid link and a beam in a plane, without weight. Its end, a ball, meets a wall at x = `wall`. y: angles of the
    joints, the beam's curvatures (1/m), rates; and, held between samples, the controller has its torques and the
    integral of its force's error."""

    law: Law
    wall: float = 0.6  # m
    upper: float = 0.5  # m, rigid, its mass (kg) and inertia (kg m^2) about its middle:
    upper_mass: float = 1.0
    upper_inertia: float = 0.02
    rotor: tuple[float, float] = (0.05, 0.05)  # kg m^2, at each joint's own rate
    length: float = 0.5  # of the beam, of steel
    thick: float = 0.004
    wide: float = 0.02
    shapes: int = 3
    retardation: float = 2e-4  # s
    tip: float = 0.1  # kg, a point at the beam's end, the ball's centre
    radius: float = 0.01
    points: int = 14
    # the controller
    rate: float = 1000.0  # Hz
    force: float = 20.0  # N
    proportional: float = 0.3
    integral: float = 20.0  # 1/s
    damped: float = 150.0  # N s/m, towards the wall
    stiff: float = 4000.0  # N/m along the wall
    damped_along: float = 250.0
    begin: tuple[float, float] = (0.55, 0.3)  # where the end starts (m)
    slide: tuple[float, float, float] = (1.0, 2.0, -0.15)  # from when to when (s), and how far it moves along the wall
    longest: float = 1e-3
    torque: Array = field(default_factory=lambda: np.zeros(2), repr=False)

    @property
    def n(self) -> int:
        return 2 + self.shapes

    @cached_property
    def tables(self) -> tuple[Array, Array, Array, Array]:
        """At points along the beam, and last at its end: what they weigh (kg), the turn by coordinates, and the
        integral from the root; and the stiffness by curvatures."""
        s, w = legendre.leggauss(self.points)
        ends = np.append(s, 1.0)
        mass = np.append(RHO * self.thick * self.wide * 0.5 * self.length * w, self.tip)
        shape = legendre.legvander(s, self.shapes - 1)
        turn = np.ones((ends.size, self.n))
        turn[:, 2:] = 0.5 * self.length * np.array(
            [legendre.legval(ends, legendre.legint(np.eye(self.shapes)[k], lbnd=-1)) for k in range(self.shapes)]
        ).T  # fmt: skip
        through = np.linalg.inv(legendre.legvander(s, self.points - 1))
        whole = legendre.legint(np.eye(self.points), lbnd=-1, axis=0)
        integrate = 0.5 * self.length * legendre.legval(ends, whole).T @ through
        bending = E * self.wide * self.thick**3 / 12
        K = np.zeros(self.n)
        K[2:] = bending * 0.5 * self.length * (w @ shape**2)  # Legendre polynomials: a diagonal
        return mass, turn, integrate, K

    def places(self, q: Array, v: Array) -> tuple[Array, Array, Array]:
        """Of points along the beam and its end: (p, 2), derivatives (p, 2, n), and accelerations by rates (p, 2)."""
        _, turn, integrate, _ = self.tables
        c, s = np.cos(q[0]), np.sin(q[0])
        angle, spin = turn @ q, turn @ v
        along = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        across = np.stack([-along[:, 1], along[:, 0]], axis=-1)
        inner = slice(0, self.points)
        p = np.array([c, s]) * self.upper + integrate @ along[inner]
        flat = (across[:, :, None] * turn[:, None, :])[inner].reshape(self.points, -1)
        J = (integrate @ flat).reshape(-1, 2, self.n)
        J[:, 0, 0] -= self.upper * s
        J[:, 1, 0] += self.upper * c
        a = -np.array([c, s]) * self.upper * v[0] ** 2 - integrate @ (along * spin[:, None] ** 2)[inner]
        return p, J, a

    def touch(self, y: Array) -> tuple[float, float, float]:
        p, J, _ = self._places(y)
        v = y[self.n :]
        spin = self.tables[1][-1] @ v
        return float(p[-1, 0] + self.radius - self.wall), float(J[-1, 0] @ v), float(J[-1, 1] @ v + self.radius * spin)

    def _places(self, y: Array) -> tuple[Array, Array, Array]:
        """Those of the last y are kept: events ask for the same."""
        last = self.__dict__.get("_last")
        if last is None or not np.array_equal(last[0], y):
            last = (y.copy(), self.places(y[: self.n], y[self.n :]))
            self.__dict__["_last"] = last
        return last[1]

    def rates(self, t: float, y: Array, normal: float, friction: float) -> Array:
        mass, turn, _, K = self.tables
        v = y[self.n :]
        _, J, a = self._places(y)
        M = np.einsum("p,pin,pim->nm", mass, J, J)
        M[0, 0] += self.upper_inertia + self.upper_mass * (0.5 * self.upper) ** 2 + self.rotor[0]
        M[1, 1] += self.rotor[1]
        f = -np.einsum("p,pin,pi->n", mass, J, a) - K * (y[: self.n] + self.retardation * v)
        f[:2] += self.torque
        f -= normal * J[-1, 0] + friction * (J[-1, 1] + self.radius * turn[-1])
        return np.concatenate([v, np.linalg.solve(M, f)])

    def deepening(self, y: Array, dy: Array) -> float:
        _, J, a = self._places(y)
        return float(J[-1, 0] @ dy[self.n :] + a[-1, 0])

    # the controller

    def joints(self) -> Array:
        """Angles that bring the end of the straight beam to where it starts."""
        x, y = self.begin
        elbow = np.arccos((x * x + y * y - self.upper**2 - self.length**2) / (2 * self.upper * self.length))
        first = np.arctan2(y, x) - np.arctan2(self.length * np.sin(elbow), self.upper + self.length * np.cos(elbow))
        return np.array([first, elbow])

    def aim(self, t: float) -> float:
        """Where it should be along the wall (m): a quintic from rest to rest."""
        begin, end, by = self.slide
        u = min(max((t - begin) / (end - begin), 0.0), 1.0)
        return self.begin[1] + by * u**3 * (10 - 15 * u + 6 * u * u)

    def control(self, t: float, angles: Array, rates: Array, normal: float, sum_: float) -> tuple[Array, float]:
        """Torques, and the sum of the force's error (N s), with which the next sample goes on."""
        one, two = angles[0], angles[0] + angles[1]
        p = self.upper * np.array([np.cos(one), np.sin(one)]) + self.length * np.array([np.cos(two), np.sin(two)])
        far = self.length * np.array([-np.sin(two), np.cos(two)])
        J = np.column_stack([self.upper * np.array([-np.sin(one), np.cos(one)]) + far, far])
        speed = J @ rates
        error = self.force - normal
        if normal > 0:
            sum_ += error / self.rate
        push = self.force + self.proportional * error + self.integral * sum_ - self.damped * speed[0]
        along = self.stiff * (self.aim(t) - p[1]) - self.damped_along * speed[1]
        return J.T @ np.array([push, along]), sum_

    def press(self, t: Array, rtol: float = 1e-9) -> Array:
        """At the times t: y, depth, normal force, friction, torques."""
        y = np.zeros(2 * self.n)
        y[:2] = self.joints()
        state, sum_ = self.start(y), 0.0
        count = round(t[-1] * self.rate)
        rows = []
        for k in range(count):
            begin, end = k / self.rate, (k + 1) / self.rate
            normal = self.forces(state, np.append(state.y, state.bent))[0]
            self.torque, sum_ = self.control(begin, state.y[:2], state.y[self.n : self.n + 2], normal, sum_)
            here = t[(t >= begin - 1e-9 / self.rate) & (t < end - 1e-9 / self.rate)]
            state, found = self.go(state, end, here, rtol)
            rows.append(np.column_stack([found, np.tile(self.torque, (here.size, 1))]))
        last = self.forces(state, np.append(state.y, state.bent))
        rows.append(np.array([[*state.y, self.touch(state.y)[0], *last, *self.torque]]))
        return np.concatenate(rows)

    def end(self, y: Array) -> Array:
        """Where the end is (m), of rows of y."""
        return np.array([self.places(x[: self.n], x[self.n : 2 * self.n])[0][-1] for x in y])

    def energy(self, y: Array) -> float:
        """Kinetic, of the beam's bending and of the contact's spring (J)."""
        mass, _, _, K = self.tables
        q, v = y[: self.n], y[self.n :]
        u = self.places(q, v)[1] @ v
        first = self.upper_inertia + self.upper_mass * (0.5 * self.upper) ** 2 + self.rotor[0]
        kinetic = 0.5 * (mass @ (u * u).sum(1) + first * v[0] ** 2 + self.rotor[1] * v[1] ** 2)
        n = self.law.exponent + 1
        return float(kinetic + 0.5 * q @ (K * q) + self.law.stiffness / n * max(self.touch(y)[0], 0.0) ** n)


# -- what bench and tests take -----------------------------------------------------------------------------------------

FALLING = Falling(Law(1e6, 2.0), tip=0.1, retardation=1e-4, elements=32, modes=18)
PRESSER = Presser(Law(1e6, 1.0, coulomb=0.3, tangential=1e6))


def written() -> dict[str, Any]:
    """Rows for tests/data/contacts.json."""
    t = np.arange(0, 101) * 1e-3
    falling = FALLING.fall(t)
    pressed_t = np.arange(0, 126) * 0.02
    pressed = PRESSER.press(pressed_t)
    return {
        "made by": "bench/run/contacts_truth.py --write; its classes Falling and Presser",
        "falling": {"t": t.tolist(), "end": FALLING.end(falling).tolist(), "normal": falling[:, -2].tolist()},
        "pressing": {
            "t": pressed_t.tolist(),
            "end": PRESSER.end(pressed).tolist(),
            "normal": pressed[:, -4].tolist(),
            "friction": pressed[:, -3].tolist(),
        },
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="tests/data/contacts.json")
    if parser.parse_args().write:
        path = Path(__file__).resolve().parents[2] / "tests" / "data" / "contacts.json"
        path.write_text(json.dumps(written(), indent=1).replace("\n   ", "") + "\n", encoding="utf-8")
        return
    t = np.linspace(0.0, 2.0, 201)
    ball = Ball(Law(1e6))
    off = ball.run([0.3, 0.0], t)[:, 0] - elastic_fall(ball.law, 1.0, 0.3, t)
    print("undamped ball, 2 s: height off by", np.abs(off).max())
    for exponent in (1.0, 1.5):
        law = Law(1e6, 0.0, exponent)
        late = Ball(law, gravity=0.0).run([0.01, -1.0], np.array([0.0, 0.05]))[-1]
        touching = 0.05 - 0.01 - late[0]  # it leaves at the speed 1
        print(f"exponent {exponent}: time of contact off by", touching - elastic_contact(law, 1.0, 1.0))
        for damping in (0.2, 2.0):
            hit = Ball(Law(1e6, damping, exponent), gravity=0.0).run([0.01, -1.0], np.array([0.0, 0.1]))
            print(f"  damping {damping}: speed of release off by", hit[-1, 1] - restitution(damping, 1.0))
    block = Block(Law(1e6, 0.0, 1.0, 0.4, 1e6), angle=0.5)
    print("sliding block, 2 s: off by", np.abs(block.run([0.0, block.rest, 0, 0], t)[:, 0] - slid(block, t)).max(), "m")
    t = np.arange(0, 101) * 1e-3
    own = FALLING.fall(t)
    for other in (replace(FALLING, elements=64), replace(FALLING, modes=26)):
        found = other.fall(t)
        print(f"falling, {other.elements} elements, {other.modes} modes: end off by "
              f"{np.abs(FALLING.end(own) - other.end(found)).max():.1e} m, force by "
              f"{np.abs(own[:, -2] - found[:, -2]).max():.1e} N of {own[:, -2].max():.3g}")  # fmt: skip
    free = replace(PRESSER, law=Law(1e5), retardation=0.0)
    y = np.zeros(2 * free.n)
    y[:2], y[free.n : free.n + 2] = free.joints(), (0.5, -1.5)
    rows = free.run(y, np.linspace(0.0, 0.5, 51))[:, : 2 * free.n]
    E = np.array([free.energy(y) for y in rows])
    print(f"two links let go, and their wall: energy changes by {np.ptp(E):.1e} J of {E[0]:.3g}, depth up to "
          f"{max(free.touch(y)[0] for y in rows):.1e} m")  # fmt: skip
    t = np.arange(0, 126) * 0.02
    own, fine = PRESSER.press(t), PRESSER.press(t, 1e-10)
    end = np.abs(PRESSER.end(own) - PRESSER.end(fine)).max()
    force = np.abs(own[:, -4] - fine[:, -4]).max()
    print(f"pressing, tolerances 1e-9 and 1e-10: end off by {end:.1e} m, force by {force:.1e} N")


if __name__ == "__main__":
    main()
