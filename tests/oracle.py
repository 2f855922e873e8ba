"""An oracle for the dynamics: Lagrange's equations of the energies, with nothing of flexarm's in it.

From a scene (the dictionary that `flexarm.Arm.from_dict` takes) it writes down where all sections and bodies are,
from that the kinetic energy T(q, v), the potential U(q) and Rayleigh's dissipation F(v), and lets automatic
differentiation do the mechanics: tau = d/dt dT/dv - dT/dq + dU/dq + dF/dv, and its Jacobians. There are no sweeps, no
angular velocities, no Jacobians of slices and no bias terms; a body's kinetic energy is that of its points.

Beams: both bases, order 1, 2, 3 or "exact", without modal damping. Joints: all, with springs, dampers and placements,
without soft stops. Struts, tendons, contacts: from their lengths and gaps; springs have energy, and all forces act by
virtual work. The bristles of contacts are unbent where q is asked for, and bend with the direction of a Jacobian.
Rates are those of flexarm. A ball's chart is centred at its present orientation, R0 exp(theta), where dtheta/dt is the
angular velocity in link axes and d^2 theta/dt^2 its rate; "by q" of a ball means by a small rotation theta of R0.
"""

from __future__ import annotations

from itertools import pairwise
from math import factorial

import numpy as np
from numpy.polynomial import legendre
from scipy.linalg import block_diag
from scipy.optimize import brentq

RATE, VARY, TIME, SEEK = 1, 2, 4, 8  # the nilpotents: velocity, variation, passing of time, direction of a Jacobian
LEVI = np.zeros((3, 3, 3))  # v @ LEVI is the matrix of v x
for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    LEVI[k, i, j], LEVI[k, j, i] = -1.0, 1.0


class Jet:
    """An array with nilpotent parts: the sum over subsets s of the nilpotents e of parts[s] times the product of s.

    e^2 = 0, so that a function of x + e d has the part df/dx d, and nested derivatives come out exact. All parts have
    two leading axes: directions of VARY and of SEEK, of size 1 where there is none.
    """

    __array_ufunc__ = None  # array * jet asks the jet

    def __init__(self, parts: dict[int, np.ndarray]) -> None:
        self.parts = parts

    def linear(self, f) -> Jet:
        """A linear function of the array, applied to each part."""
        return Jet({s: f(x) for s, x in self.parts.items()})

    def product(self, other, f) -> Jet:
        """A bilinear function of two arrays."""
        if not isinstance(other, Jet):
            return self.linear(lambda x: f(x, np.asarray(other)))
        out: dict[int, np.ndarray] = {}
        for s, x in self.parts.items():
            for t, y in other.parts.items():
                if not s & t:
                    out[s | t] = out[s | t] + f(x, y) if s | t in out else f(x, y)
        return Jet(out)

    def __add__(self, other) -> Jet:
        out = dict(self.parts)
        for t, y in (other.parts if isinstance(other, Jet) else {0: np.asarray(other)[None, None]}).items():
            out[t] = out[t] + y if t in out else y
        return Jet(out)

    def __neg__(self) -> Jet:
        return self.linear(np.negative)

    def __sub__(self, other) -> Jet:
        return self + (-other)

    def __mul__(self, other) -> Jet:
        return self.product(other, np.multiply)

    __rmul__ = __mul__

    def __matmul__(self, other) -> Jet:
        return self.product(other, np.matmul)

    def __getitem__(self, index) -> Jet:
        return self.linear(lambda x: x[index])

    def sum(self, axes: int = 1) -> Jet:
        return self.linear(lambda x: x.sum(tuple(range(-axes, 0))))

    def part(self, bits: int) -> Jet:
        """What stands with these nilpotents."""
        return Jet({s ^ bits: x for s, x in self.parts.items() if s & bits == bits})

    def without(self, bits: int) -> Jet:
        """What stands without these nilpotents."""
        return Jet({s: x for s, x in self.parts.items() if not s & bits})

    def number(self, bits: int, *shape: int) -> np.ndarray:
        """One part of a scalar jet, over its directions."""
        return np.broadcast_to(self.parts.get(bits, np.zeros((1, 1))), shape).copy()


def tilde(v: Jet) -> Jet:
    """The matrix of v x."""
    return v.linear(lambda x: (x @ LEVI.reshape(3, 9)).reshape(*x.shape[:-1], 3, 3))


def power(x: Jet, n: float) -> Jet:
    """x^n: x0^n times the binomial series of x / x0, which ends after as many terms as nilpotents."""
    x0 = x.parts[0]
    u = x * (1 / x0) + (-1.0)
    term = total = Jet({0: np.ones_like(x0)})
    u.parts.pop(0)
    for k in range(4):
        term = term * u * ((n - k) / (k + 1))
        total = total + term
    return total * x0**n


def root(x: Jet) -> Jet:
    return power(x, 0.5)


def times(size: Jet, vector: Jet) -> Jet:
    """A number times a vector."""
    return size.linear(lambda x: x[..., None]) * vector


def turn_back(matrix: Jet, vector: Jet) -> Jet:
    """The matrix's transpose times the vector."""
    return turn(matrix.linear(lambda x: np.swapaxes(x, -1, -2)), vector)


def turn(matrix, vector):
    """matrix times vector."""
    return (matrix @ vector.linear(lambda x: x[..., None]))[..., 0]


def rotation(theta: Jet) -> Jet:
    """exp of the rotation vector: I + sin|t|/|t| t~ + (1 - cos|t|)/|t|^2 t~^2, both factors as series in |t|^2."""
    minus_square, b, c = -(theta * theta).sum(), None, None
    for k in range(22, -1, -1):  # |t| up to 3
        b = 1.0 / factorial(2 * k + 1) if b is None else minus_square * b + 1.0 / factorial(2 * k + 1)
        c = 1.0 / factorial(2 * k + 2) if c is None else minus_square * c + 1.0 / factorial(2 * k + 2)
    W = tilde(theta)
    scale = [f.linear(lambda x: x[..., None, None]) for f in (b, c)]
    return W * scale[0] + (W @ W) * scale[1] + np.eye(3)


def constant_rotation(vector) -> np.ndarray:
    return rotation(Jet({0: np.reshape(vector, (1, 1, 3)).astype(float)})).parts[0][0, 0]


def from_quaternion(p) -> np.ndarray:
    """The rotation of a quaternion w x y z: p u p*."""
    w, x, y, z = np.asarray(p) / np.linalg.norm(p)
    return np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
    )


def point_inertia(moments) -> np.ndarray:
    """Integral of r r^T dm (kg m^2) from the inertia about the same point: 3 numbers, 6, or a matrix."""
    m = np.asarray(moments, float)
    if m.shape == (6,):
        m = np.array([[m[0], m[3], m[4]], [m[3], m[1], m[5]], [m[4], m[5], m[2]]])
    J = np.diag(m) if m.shape == (3,) else m
    return 0.5 * np.trace(J) * np.eye(3) - J


class Beam:
    """Sections at Gauss points, at the places `at` (m) and, last, at the tip; functions of X are integrated through
    their polynomial at the Gauss points."""

    strains = ("bending_y", "bending_z", "torsion", "shear_y", "shear_z", "extension")

    def __init__(self, beam: dict, points: int, at: tuple[float, ...] = ()) -> None:
        assert beam["order"] != 0 and not beam.get("damping_ratio")
        section, material, length = beam["section"], beam["material"], beam["length"]
        s, w = legendre.leggauss(points)
        self.s, self.order = np.concatenate([s, 2 * np.array(at) / length - 1, [1.0]]), beam["order"]
        self.points, self.at = points, list(at)
        self.w = np.concatenate([0.5 * length * w, np.zeros(len(at) + 1)])
        coefficients = np.linalg.inv(legendre.legvander(s, points - 1))
        integrals = legendre.legint(np.eye(points), lbnd=-1, axis=0)  # of P_0, P_1, ..., column by column
        self.integrate = 0.5 * length * legendre.legval(self.s, integrals).T @ coefficients  # (s, points)
        # strains K1 K2 K3 phi12 phi13 eps at the points are B q: v2'' = K3, v3'' = -K2
        counts = [beam["modes"].get(name, 0) for name in self.strains]
        self.ne = sum(counts)
        self.B = np.zeros((self.s.size, 6, self.ne))
        column = 0
        for (row, sign), n in zip(((2, 1), (1, -1), (0, 1), (3, 1), (4, 1), (5, 1)), counts, strict=True):
            for k in range(n):
                self.B[:, row, column] = sign * self.shape(beam["basis"], row in (1, 2), k, length)
                column += 1
        assert section["type"] == "general"
        Iy, Iz, rho = section["second_moment_y"], section["second_moment_z"], material["density"]
        E, G = material["youngs_modulus"], material["shear_modulus"]
        kGA = section["shear_correction"] * G * section["area"]
        self.mass = self.w * rho * section["area"]
        self.inertia = self.w[:, None, None] * rho * np.diag([0, Iz, Iy]) * beam.get("rotary_inertia", True)
        self.rigidity = np.array([G * section["torsion_constant"], E * Iy, E * Iz, kGA, kGA, E * section["area"]])
        self.retardation = beam.get("kelvin_voigt", 0.0)

    def shape(self, basis: str, bending: bool, k: int, length: float) -> np.ndarray:
        """Strain of shape k = 0, 1, ... at the stations."""
        X = 0.5 * length * (1 + self.s)
        if basis == "legendre":
            return legendre.legval(self.s, np.eye(k + 1)[k])
        if not bending:  # of sin((k + 1/2) pi X / L), 1 at the tip
            return (-1) ** k * (k + 0.5) * np.pi / length * np.cos((k + 0.5) * np.pi * X / length)
        b = brentq(lambda b: np.cos(b) * np.cosh(b) + 1, k * np.pi + 1, (k + 1) * np.pi, xtol=1e-15)
        ratio = (np.cosh(b) + np.cos(b)) / (np.sinh(b) + np.sin(b))
        tip = np.cosh(b) - np.cos(b) - ratio * (np.sinh(b) - np.sin(b))
        z = b * X / length
        return (b / length) ** 2 / tip * (np.cosh(z) + np.cos(z) - ratio * (np.sinh(z) + np.sin(z)))

    def strain(self, q: Jet) -> Jet:
        return q.linear(lambda x: np.einsum("gcn,abn->abgc", self.B, x))

    def elastic(self, q: Jet) -> Jet:
        """Half the integral of rigidity times strain squared."""
        e = self.strain(q)
        return 0.5 * (e * e * (self.w[:, None] * self.rigidity)).sum(2)

    def integral(self, f: Jet, axes: int) -> Jet:
        """From 0 to each station, of what stands at the stations on the axis before the last `axes`."""
        gauss = (..., slice(0, self.points), *[slice(None)] * axes)
        return f[gauss].linear(lambda x: np.moveaxis(np.tensordot(self.integrate, x, (1, 2)), 0, 2))

    def sections(self, q: Jet) -> tuple[Jet, Jet]:
        """Position (..., 3) and orientation (..., 3, 3) of the sections.

        R' = R K~ is solved by the sum of R_i = int R_(i-1) K~, and x' = R [1 + eps, phi12, phi13] is cut at total order
        `order`; when exact, at an order where nothing is left. Below, R is the exp of the Magnus series."""
        strain = self.strain(q)
        K = strain[..., :3]
        phi = strain[..., [5, 3, 4]]
        W = tilde(K)
        n = 28 if self.order == "exact" else self.order
        R = Jet({0: np.eye(3) * np.ones((1, 1, self.s.size, 1, 1))})
        total, slope = R, Jet({0: np.eye(3)[0] * np.ones((1, 1, self.s.size, 1))})
        for _ in range(n):  # terms of the next total order
            slope = slope + turn(R, phi)
            R = self.integral(R @ W, 2)
            slope = slope + R.linear(lambda x: x[..., 0])
            total = total + R
        x = self.integral(slope, 1)
        return x, total if self.order == "exact" else rotation(self.magnus(K, W))

    def magnus(self, K: Jet, W: Jet) -> Jet:
        """The rotation vector, cut at the order; a x K = -K~ a."""
        one = self.integral(K, 1)
        if self.order == 1:
            return one
        one_K = -turn(W, one)
        two = 0.5 * self.integral(one_K, 1)
        if self.order == 2:
            return one + two
        one_one_K = -turn(tilde(one_K), one)
        return one + two + self.integral(-0.5 * turn(W, two) + (1.0 / 12.0) * one_one_K, 1)


def elementary(joint: dict) -> tuple[list[tuple[bool, np.ndarray]], bool]:
    """(whether a rotation, axis) of each motion of a joint in turn, and whether a ball follows."""
    unit = dict(zip("xyz", np.eye(3), strict=True))
    axis = joint.get("axis")
    axis = unit[axis] if isinstance(axis, str) else None if axis is None else np.divide(axis, np.linalg.norm(axis))
    chains = {
        "fixed": "",
        "universal": "rx ry",
        "planar": "tx ty rz",
        "spherical": "",
        "free": "tx ty tz",
        "axes": " ".join(joint.get("axes", ())),
    }
    if joint["type"] in chains:
        motions = [(m[0] == "r", unit[m[1]]) for m in chains[joint["type"]].split()]
    else:
        rotates = {"revolute": [True], "prismatic": [False], "cylindrical": [False, True]}[joint["type"]]
        motions = [(r, axis) for r in rotates]
    return motions, joint["type"] in ("spherical", "free")


class Link:
    """One table of a scene's `link`."""

    def __init__(self, link: dict, points: int, at: tuple[float, ...] = ()) -> None:
        self.joint = link["joint"]
        self.motions, self.ball = elementary(self.joint)
        self.nj = len(self.motions) + 3 * self.ball
        self.hub, self.tip = link.get("hub", {}), link.get("tip", {})
        self.beam = Beam(link["beam"], points, at) if "beam" in link else None
        self.nv = self.nj + (self.beam.ne if self.beam else 0)
        self.spring, self.damping, self.rest = (
            np.broadcast_to(self.joint.get(f, 0.0), self.nj) for f in ("stiffness", "damping", "rest")
        )

    def seat(self, p: Jet, R: Jet, q: np.ndarray, seek: Jet, motion: Jet) -> tuple[Jet, Jet]:
        """The link's frame from the end of its parent, at q + seek + motion."""

        def placed(p: Jet, R: Jet, side: str) -> tuple[Jet, Jet]:
            place = self.joint.get(side, {})
            p = p + turn(R, Jet({0: np.reshape(place.get("position", (0, 0, 0)), (1, 1, 3)).astype(float)}))
            return p, R @ constant_rotation(place.get("rotation", (0, 0, 0)))

        p, R = placed(p, R, "inboard")
        for i, (rotates, axis) in enumerate(self.motions):
            step = ((seek + motion)[..., i : i + 1] + q[i : i + 1]) * axis
            p, R = (p, R @ rotation(step)) if rotates else (p + turn(R, step), R)
        if self.ball:
            n = len(self.motions)
            R = R @ from_quaternion(q[n : n + 4]) @ rotation(seek[..., n : n + 3]) @ rotation(motion[..., n : n + 3])
        return placed(p, R, "outboard")


def read_point(given, links: list[dict]) -> tuple[int, str | float, np.ndarray]:
    """(link, "origin", "end" or X, offset) of a point; link -1: the world."""
    if isinstance(given, (list, tuple)) and len(given) == 3:
        given = {"link": "world", "offset": given}
    elif not isinstance(given, dict):
        given = dict(zip(("link", "at"), [given] if isinstance(given, (str, int)) else given, strict=False))
    link = given["link"]
    names = [x.get("name") for x in links]
    number = -1 if link == "world" else names.index(link) if isinstance(link, str) else link
    return number, given.get("at", "end"), np.reshape(given.get("offset", (0, 0, 0)), (1, 1, 3)).astype(float)


class Strut:
    """A table of a scene's `strut` or `tendon`."""

    def __init__(self, table: dict, links: list[dict]) -> None:
        self.tendon = "points" in table
        self.points = [read_point(p, links) for p in (table["points"] if self.tendon else (table["a"], table["b"]))]
        self.stiffness, self.damping = table.get("stiffness", 0.0), table.get("damping", 0.0)
        self.only = self.tendon and table.get("tension_only", True)
        self.constant = -table.get("tension", 0.0) if self.tendon else table.get("force", 0.0)
        self.rest = table.get("length")

    def stretch(self, length: Jet) -> Jet:
        """From the rest length; none where a tendon is slack."""
        d = length - self.rest
        return d * 0.0 if self.only and d.parts[0][0, 0] < 0 else d

    def spring(self, length: Jet) -> Jet:
        """Its energy (J)."""
        d = self.stretch(length)
        return 0.5 * self.stiffness * d * d

    def push(self, length: Jet, speed: Jet, driven: float) -> Jet:
        """The force that drives the ends apart (N); `driven` adds to a strut's force, to a tendon's tension."""
        d, damping = self.stretch(length), self.damping
        if self.only and d.parts[0][0, 0] < 1e-3:  # m
            damping = d * (self.damping / 1e-3)
        f = -(d * self.stiffness) - speed * damping + (self.constant + (-driven if self.tendon else driven))
        return f * 0.0 if self.only and f.parts[0][0, 0] > 0 else f


class Contact:
    """A table of a scene's `contact`."""

    def __init__(self, table: dict, links: list[dict]) -> None:
        on = table["against"]
        self.kind, self.point = on["type"], read_point(table["point"], links)
        self.on = read_point(on["point" if self.kind == "plane" else "center"], links)
        self.axes = constant_rotation(on.get("rotation", (0, 0, 0)))
        self.up = np.array(on.get("normal", (0, 0, 1)), float) / np.linalg.norm(on.get("normal", (0, 0, 1)))
        self.far, self.half = on.get("radius", 0.0), 0.5 * np.array(on.get("size", (0, 0, 0)), float)
        self.radius, self.stiffness = table.get("radius", 0.0), table["stiffness"]
        self.damping, self.exponent = table.get("damping", 0.0), table.get("exponent", 1.0)
        self.coulomb, self.bristles = table.get("coulomb", 0.0), table.get("tangential_stiffness", self.stiffness)

    def look(self, y: Jet) -> tuple[Jet, Jet]:
        """Gap, and the normal in the surface's axes, of a sphere whose centre is at y in these."""
        if self.kind == "plane":
            return (y * self.up).sum() + (-self.radius), Jet({0: self.up[None, None]})
        away = y + 0.0
        if self.kind == "box":
            at = y.parts[0][0, 0]
            side, beyond = np.sign(at), np.abs(at) - self.half
            if beyond.max() < 0:  # inside: the nearest face
                face = np.eye(3)[beyond.argmax()] * side
                gap = (y * face).sum() + (-self.half @ np.abs(face) - self.radius)
                return gap, Jet({0: face[None, None]})
            away = (y - Jet({0: (side * self.half)[None, None]})) * (beyond > 0)
        square = (away * away).sum()
        return root(square) + (-self.far - self.radius), times(power(square, -0.5), away)

    def spring(self, gap: Jet) -> Jet:
        """Its energy (J)."""
        if gap.parts[0][0, 0] >= 0:
            return gap * 0.0
        return power(-gap, self.exponent + 1) * (self.stiffness / (self.exponent + 1))

    def elastic(self, gap: Jet) -> Jet:
        return gap * 0.0 if gap.parts[0][0, 0] >= 0 else power(-gap, self.exponent) * self.stiffness

    def push(self, gap: Jet, rate: Jet) -> Jet:
        """The normal force (N)."""
        f = self.elastic(gap) * (rate * -self.damping + 1.0)
        return f if f.parts[0][0, 0] > 0 else f * 0.0

    def drag(self, push: Jet, bent: Jet, slip: Jet) -> Jet:
        """The force against the slip (N), where bristles that are hardly bent do not give way."""
        if not self.coulomb or not push.parts[0][0, 0] > 0:
            return slip * 0.0
        drag = bent * self.bristles + times(push * self.damping, slip)
        square = (drag * drag).sum()
        if square.parts[0][0, 0] <= (self.coulomb * push.parts[0][0, 0]) ** 2:
            return drag
        return times(push * self.coulomb * power(square, -0.5), drag)


class Touch:
    """Where a contact is, in the surface's axes: the sphere's centre, gap, normal, and the point of the arm that
    touches, as it moves on from there."""

    def __init__(self, contact: Contact, arm: tuple[Jet, Jet], on: tuple[Jet, Jet]) -> None:
        def seen(frame: tuple[Jet, Jet], offset: Jet, surface: tuple[Jet, Jet]) -> Jet:
            p, R = surface
            origin = p + turn(R, Jet({0: contact.on[2]}))
            return turn_back(R @ contact.axes, frame[0] + turn(frame[1], offset) - origin)

        still = [tuple(x.without(RATE) for x in frame) for frame in (arm, on)]
        self.centre = seen(arm, Jet({0: contact.point[2]}), on)
        self.gap, self.normal = contact.look(self.centre)
        self.touch = self.centre.without(RATE) - self.normal.without(RATE) * contact.radius
        p, R = still[1]  # of the point that touches: where it is on the arm
        world = p + turn(R, Jet({0: contact.on[2]})) + turn(R @ contact.axes, self.touch)
        own = turn_back(still[0][1], world - still[0][0])
        self.moving = seen(arm, own, on)
        base = [tuple(Jet({0: x.parts[0]}) for x in frame) for frame in (arm, on)]
        self.before = seen(base[0], own, base[1])  # where that point was

    def across(self, x: Jet, drop: int) -> Jet:
        n = self.normal.without(drop)
        return x - times((n * x).sum(), n)

    def forces(self, contact: Contact, drop: int = RATE | VARY | TIME) -> tuple[Jet, Jet]:
        """Push and drag, without the nilpotents `drop`; in the surface's axes."""
        push = contact.push(self.gap.without(drop), self.gap.part(RATE).without(drop))
        slip = self.across(self.moving.part(RATE).without(drop), drop)
        bent = self.across((self.touch - self.before).without(drop), drop)
        return push, contact.drag(push, bent, slip)


class Oracle:
    """Energies of a scene's arm and what follows from them. `points`: sections along each beam."""

    def __init__(self, scene: dict, points: int = 16) -> None:
        above = [k - 1 if x.get("parent") is None else x["parent"] for k, x in enumerate(scene["link"])]
        self.sits = [  # (link, place on its beam or "end") that each sits on
            (-1 if n == "world" else n, x.get("at", "end")) for n, x in zip(above, scene["link"], strict=True)
        ]
        tables = scene["link"]
        self.struts = [Strut(s, tables) for kind in ("strut", "tendon") for s in scene.get(kind, ())]
        self.contacts = [Contact(c, tables) for c in scene.get("contact", ())]
        at: list[set[float]] = [set() for _ in tables]
        points_ = [p for s in self.struts for p in s.points] + [p for c in self.contacts for p in (c.point, c.on)]
        for k, x in [*self.sits, *(p[:2] for p in points_)]:
            at[k] |= set() if isinstance(x, str) else {x}
        self.links = [Link(link, points, tuple(sorted(x))) for link, x in zip(tables, at, strict=True)]
        self.gravity = np.array(scene.get("gravity", (0.0, 0.0, 0.0)), float)
        self.nv = sum(link.nv for link in self.links)
        ball = np.array([1.0, 0.0, 0.0, 0.0])
        zero = [np.r_[np.zeros(len(x.motions)), ball[: 4 * x.ball], np.zeros(x.nv - x.nj)] for x in self.links]
        lengths = self._jets(np.concatenate(zero), np.zeros(self.nv), np.zeros(self.nv))[3]
        for s, length in zip(self.struts, lengths, strict=True):
            s.rest = float(length.parts[0][0, 0]) if s.rest is None else s.rest

    def energies(
        self, q: np.ndarray, seek: Jet, motion: Jet, rate: Jet
    ) -> tuple[Jet, Jet, Jet, list[Jet], list[Touch]]:
        """Kinetic and potential energy (less that of struts and contacts), Rayleigh's dissipation (half the power
        lost), the lengths of struts and the contacts at q + seek + motion, where `rate` is the part of `motion` that
        goes with RATE."""
        T = U = F = Jet({0: np.zeros((1, 1))})
        places: dict[tuple[int, str | float], tuple[Jet, Jet]] = {}  # where struts may sit
        p, R = Jet({0: np.zeros((1, 1, 3))}), Jet({0: np.eye(3)[None, None]})

        def add(mass, inertia, p: Jet, R: Jet) -> None:
            nonlocal T, U
            p_dot, R_dot = p.part(RATE), R.part(RATE)
            stations = np.ndim(mass)
            T = T + 0.5 * ((p_dot * p_dot).sum() * mass).sum(stations)
            T = T + 0.5 * ((R_dot @ inertia) * R_dot).sum(2 + stations)
            U = U - ((p.without(RATE) * self.gravity).sum() * mass).sum(stations)

        def body(b: dict, p: Jet, R: Jet) -> Jet:
            com, end = (np.reshape(b.get(k, (0, 0, 0)), (1, 1, 3)).astype(float) for k in ("com", "end"))
            if b:
                add(b.get("mass", 0.0), point_inertia(b.get("inertia", (0, 0, 0))), p + turn(R, Jet({0: com})), R)
            return p + turn(R, Jet({0: end}))

        at = at_q = 0
        places[-1, "end"] = p, R
        for k, link in enumerate(self.links):
            p, R = places[self.sits[k]]
            joint, elastic = slice(at, at + link.nj), slice(at + link.nj, at + link.nv)
            q_link = q[at_q : at_q + link.nv + link.ball]
            p, R = link.seat(p, R, q_link, seek[..., joint], motion[..., joint])
            places[k, "origin"] = p, R
            F = F + 0.5 * (rate[..., joint] * rate[..., joint] * link.damping).sum()
            n = len(link.motions)  # a ball has no springs
            stretch = (seek + motion)[..., at : at + n].without(RATE) + (q_link[:n] - link.rest[:n])
            U = U + 0.5 * (stretch * stretch * link.spring[:n]).sum()
            p = body(link.hub, p, R)
            if link.beam:
                qe = (seek + motion)[..., elastic] + q_link[link.nj + link.ball :]
                x, turned = link.beam.sections(qe)
                Rs = R.linear(lambda x: x[..., None, :, :])
                x, turned = p.linear(lambda x: x[..., None, :]) + turn(Rs, x), Rs @ turned
                add(link.beam.mass, link.beam.inertia, x, turned)
                for i, X in enumerate(link.beam.at, link.beam.points):
                    places[k, X] = x[..., i, :], turned[..., i, :, :]
                U = U + link.beam.elastic(qe.without(RATE))
                F = F + link.beam.retardation * link.beam.elastic(rate[..., elastic])
                p, R = x[..., -1, :], turned[..., -1, :, :]
            p = body(link.tip, p, R)
            places[k, "end"] = p, R
            at, at_q = at + link.nv, at_q + link.nv + link.ball

        def point(link: int, at: str | float, offset: np.ndarray) -> Jet:
            p, R = places[link, at]
            return p + turn(R, Jet({0: offset}))

        def length(strut: Strut) -> Jet:
            points = [point(*p) for p in strut.points]
            pieces = [b - a for a, b in pairwise(points)]
            return sum((root((d * d).sum()) for d in pieces), Jet({0: np.zeros((1, 1))}))

        touches = [Touch(c, places[c.point[:2]], places[c.on[:2]]) for c in self.contacts]
        return T, U, F, [length(s) for s in self.struts], touches

    def _jets(self, q, v, a, vary: str = "", jacobian: bool = False) -> tuple[Jet, Jet, Jet, list[Jet], list[Touch]]:
        """Energies, lengths and contacts at q, v with their rate of change along v, a (TIME; not where q is varied),
        their derivatives by each v or q (VARY), and of all these the derivatives by each of q, v and a (SEEK)."""
        n, eye = self.nv, np.eye(self.nv)
        by_q, by_v, by_a = np.split(np.eye(3 * n)[None], 3, axis=-1)
        row = {name: np.reshape(x, (1, 1, n)).astype(float) for name, x in (("v", v), ("a", a))}
        rate = {0: row["v"], TIME: row["a"], SEEK: by_v, TIME | SEEK: by_a}
        motion = {TIME: row["v"], TIME | SEEK: by_v}
        if vary:
            (rate if vary == "v" else motion)[VARY] = eye[:, None]
        motion |= {RATE | s: x for s, x in rate.items()}
        dropped = (TIME if vary == "q" else 0) | (0 if jacobian else SEEK)
        jets = (Jet(x).without(dropped) for x in ({SEEK: by_q}, motion, rate))
        return self.energies(np.asarray(q, float), *jets)

    def energy(self, q, v) -> tuple[float, float]:
        """Kinetic and potential energy (J)."""
        T, U, _, lengths, touches = self._jets(q, v, np.zeros(self.nv))
        U = sum((s.spring(x.without(RATE)) for s, x in zip(self.struts, lengths, strict=True)), U)
        U = sum((c.spring(x.gap.without(RATE)) for c, x in zip(self.contacts, touches, strict=True)), U)
        return float(T.number(0, 1, 1)[0, 0]), float(U.number(0, 1, 1)[0, 0])

    def power(self, q, v, a, driven=None) -> tuple[float, float]:
        """Rate of change of T + U along v, a; and what dampers and friction take, less what constant and driven forces
        of struts do (W)."""
        T, U, F, lengths, touches = self._jets(q, v, a)
        lost = 2 * F
        for s, x, f in zip(self.struts, lengths, self._driven(driven), strict=True):
            at, speed = x.without(RATE), x.part(RATE)
            U = U + s.spring(at)
            lost = lost - (s.push(at, speed, f) + s.stretch(at) * s.stiffness) * speed
        for c, x in zip(self.contacts, touches, strict=True):
            at, speed = x.gap.without(RATE), x.gap.part(RATE)
            U = U + c.spring(at)
            push, drag = x.forces(c, RATE)
            lost = lost - (push - c.elastic(at)) * speed + (drag * x.moving.part(RATE)).sum()
        stored, lost = (x.number(bits, 1, 1)[0, 0] for x, bits in ((T + U, TIME), (lost, 0)))
        return float(stored), float(lost)

    def strut_motion(self, q, v, driven=None) -> np.ndarray:
        """Length (m), its rate (m/s) and the pushing force (N) of each strut, (n, 3)."""
        rows = []
        lengths = self._jets(q, v, np.zeros(self.nv))[3]
        for s, x, f in zip(self.struts, lengths, self._driven(driven), strict=True):
            at, speed = x.without(RATE), x.part(RATE)
            rows.append([y.number(0, 1, 1)[0, 0] for y in (at, speed, s.push(at, speed, f))])
        return np.array(rows)

    def strut_jacobian(self, q) -> np.ndarray:
        """Of the lengths, (n, nv)."""
        lengths = self._jets(q, np.zeros(self.nv), np.zeros(self.nv), "v")[3]
        return np.array([x.number(RATE | VARY, self.nv, 1)[:, 0] for x in lengths]).reshape(-1, self.nv)

    def contact_motion(self, q, v) -> np.ndarray:
        """Gap (m), its rate (m/s) and the normal force (N) of each contact, (n, 3)."""
        touches = self._jets(q, v, np.zeros(self.nv))[4]
        found = [
            (x.gap.without(RATE), x.gap.part(RATE), x.forces(c)[0]) for c, x in zip(self.contacts, touches, strict=True)
        ]
        return np.array([[y.number(0, 1, 1)[0, 0] for y in row] for row in found])

    def centres(self, q) -> np.ndarray:
        """Of the contacts' spheres, in the axes of their surfaces, (n, 3)."""
        return np.array([x.centre.parts[0][0, 0] for x in self._jets(q, np.zeros(self.nv), np.zeros(self.nv))[4]])

    def _driven(self, driven) -> np.ndarray:
        return np.zeros(len(self.struts)) if driven is None else np.asarray(driven, float)

    def inverse(self, q, v, a, driven=None) -> np.ndarray:
        """Generalised forces d/dt dT/dv - dT/dq + dU/dq + dF/dv, less those of struts and contacts, (nv,)."""
        return self._inverse(q, v, a, driven, 0, 1)[:, 0]

    def jacobians(self, q, v, a, driven=None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Those of `inverse` by q (a ball's: by a small rotation in its link's axes), v and a; each (nv, nv)."""
        by_q, by_v, by_a = np.split(self._inverse(q, v, a, driven, SEEK, 3 * self.nv), 3, axis=1)
        return by_q, by_v, by_a

    def _inverse(self, q, v, a, driven, seek: int, directions: int) -> np.ndarray:
        shape = (self.nv, directions)
        T, _, F, lengths, touches = self._jets(q, v, a, "v", seek > 0)
        total = T.number(VARY | TIME | seek, *shape) + F.number(VARY | seek, *shape)
        for s, x, f in zip(self.struts, lengths, self._driven(driven), strict=True):
            force = s.push(x.without(RATE | VARY | TIME), x.part(RATE).without(VARY | TIME), f)
            by_q = x.part(RATE | VARY).without(TIME)  # of a length, with the derivatives that SEEK asks for
            total = total - (force * by_q).number(seek, *shape)
        for c, x in zip(self.contacts, touches, strict=True):
            push, drag = x.forces(c)
            gap, point = (y.part(RATE | VARY).without(TIME) for y in (x.gap, x.moving))
            total = total - (push * gap - (drag * point).sum()).number(seek, *shape)
        T, U, *_ = self._jets(q, v, a, "q", seek > 0)
        return total - T.number(VARY | seek, *shape) + U.number(VARY | seek, *shape)

    def forward(self, q, v, tau, driven=None) -> np.ndarray:
        """Accelerations, (nv,): the forces are linear in them."""
        a = np.zeros(self.nv)
        T, *_ = self._jets(q, v, a, "v", True)
        M = T.number(VARY | SEEK, self.nv, 3 * self.nv)[:, self.nv : 2 * self.nv]
        return np.linalg.solve(M, tau - self.inverse(q, v, a, driven))

    def small_turns(self, q) -> np.ndarray:
        """Change of q (nq) per small motion of each rate (nv): a ball's quaternion changes by p (0, theta / 2)."""
        blocks = []
        for link in self.links:
            n = len(link.motions)
            first = sum(b.shape[0] for b in blocks)
            blocks.append(np.eye(n))
            if link.ball:
                w, x, y, z = np.asarray(q)[first + n : first + n + 4]
                blocks.append(0.5 * np.array([[-x, -y, -z], [w, -z, y], [z, w, -x], [-y, x, w]]))
            blocks.append(np.eye(link.nv - link.nj))
        return block_diag(*blocks)
