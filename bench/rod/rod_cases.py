"""The rods of bench/rod/rods.py. Needs NumPy only, which every peer has.

Forces and stiffness in the order force x y z, moment x y z, in the section's axes, x along the rod; SI units unless a
case says otherwise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

Z = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Piece:
    """One beam of a chain, its root turned by `turn` (rotation vector) against the end of the one before."""

    length: float
    stiffness: tuple[float, ...]  # of the six strains; or 36 numbers, row by row
    curvature: tuple[float, float, float] = Z  # at rest
    turn: tuple[float, float, float] = Z
    inertia: tuple[float, ...] = (1.0, 1.0, 1.0, 2e-3, 1e-3, 1e-3)  # per length

    @property
    def matrix(self) -> np.ndarray:
        """Stiffness, (6, 6)."""
        C = np.array(self.stiffness)
        return np.diag(C) if C.size == 6 else C.reshape(6, 6)


@dataclass(frozen=True)
class Static:
    """An equilibrium under loads on the tip: dead ones, and ones that follow it."""

    name: str
    pieces: tuple[Piece, ...]
    force: tuple[float, float, float] = Z
    moment: tuple[float, float, float] = Z
    follower_force: tuple[float, float, float] = Z
    follower_moment: tuple[float, float, float] = Z
    published: str = ""
    steps: int = 8  # of the load, in shooting

    @property
    def length(self) -> float:
        return sum(p.length for p in self.pieces)


def rectangle(E: float, G: float, y: float, z: float, torsion: float, shear: float = 5 / 6) -> tuple[float, ...]:
    """Stiffness of a bar, y by z, with a torsion constant."""
    A = y * z
    return (E * A, shear * G * A, shear * G * A, G * torsion, E * y * z**3 / 12, E * z * y**3 / 12)


ARC = (1e7, 1e7 / 2.4, 1e7 / 2.4, 8.333e5, 8.333e5, 8.333e5)
UNIT = (1e4, 5e3, 5e3, 1.0, 1.0, 1.5)  # a rod of length 1
# Wang, Sprague, Jonkman, Johnson & Jelsma 2017: a composite box
COMPOSITE = (
    *(1368.17e3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 88.56e3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 38.78e3, 0.0, 0.0, 0.0),
    *(0.0, 0.0, 0.0, 16.96e3, 17.61e3, -0.351e3, 0.0, 0.0, 0.0, 17.61e3, 59.12e3, -0.370e3),
    *(0.0, 0.0, 0.0, -0.351e3, -0.370e3, 141.47e3),
)
# Dowell & Traybar 1975, 7075 aluminium, 20 x 0.5 x 1/8 inch, as reckoned with by Bauchau and others
PRINCETON = rectangle(71.7e9, 71.7e9 / 2.62, 12.377e-3, 3.2024e-3, 0.8388 * 12.377e-3 * 3.2024e-3**3 / 3)
PRINCETON_LOADS, PRINCETON_ANGLES, PRINCETON_LENGTH = (4.448, 8.896, 13.345), tuple(range(0, 91, 15)), 0.508


def princeton(load: float, angle: float) -> Static:
    """The strip's weak axis is y (it bends easily along z); at angle 0 the load acts along its strong direction y."""
    a = math.radians(angle)
    force = (0.0, load * math.cos(a), load * math.sin(a))
    return Static(f"Princeton beam, {load} N at {angle}°", (Piece(PRINCETON_LENGTH, PRINCETON),), force=force)


def _helix(radius: float, rise: float, turns: float, stiffness: tuple[float, ...] = UNIT) -> Piece:
    """`rise`: along the axis, a radian."""
    r2 = radius**2 + rise**2
    return Piece(turns * 2 * math.pi * math.sqrt(r2), stiffness, (rise / r2, 0.0, radius / r2))


def _arc(load: float, published: str) -> Static:
    return Static(
        f"45° arc (Bathe & Bolourchi), {load:g} lb",
        (Piece(25 * math.pi, ARC, (0.0, 0.0, 0.01)),),
        force=(0.0, 0.0, load),
        published=published,
    )


_ROD, _STRIP = Piece(1.0, UNIT), Piece(1.0, (1e4, 5e3, 5e3, 1.0, 1.0, 50.0), (math.pi / 2, 0.0, 0.0))
STATICS = (
    _arc(300, "(58.84, 22.33, 40.08) Simo & Vu-Quoc, (59.2, 22.5, 39.5) Bathe & Bolourchi"),
    _arc(450, ""),
    _arc(600, "(47.23, 15.79, 53.37) Simo & Vu-Quoc, (47.2, 15.9, 53.4) Bathe & Bolourchi"),
    Static("oblique force", (_ROD,), force=(-2.0, 3.0, 4.0)),
    Static("force that follows the tip", (_ROD,), follower_force=(0.0, 3.0, 4.0)),
    Static("rolled up to two circles", (_ROD,), moment=(0.0, 0.0, 6 * math.pi), steps=24),
    Static("rolled up, and a force across", (_ROD,), moment=(0.0, 0.0, 6 * math.pi), force=(0.0, 0.0, 1.0), steps=24),
    Static("right-angle frame", (_ROD, Piece(1.0, UNIT, turn=(0.0, 0.0, math.pi / 2))), force=(2.0, 1.0, 3.0)),
    Static("a turn of a helix", (_helix(0.3, 0.1, 1.0),), force=(0.3, -0.2, 0.4)),
    Static("strip twisted by 90° at rest", (_STRIP,), force=(0.0, 3.0, 4.0)),
    Static(
        "composite cantilever",
        (Piece(10.0, COMPOSITE),),
        force=(0.0, 0.0, 150.0),
        published="(9.9097273, -0.0647488, 1.2297365) Wang et al. 2017",
    ),
    Static(
        "composite, twisted by 45° at rest",
        (Piece(10.0, COMPOSITE, (math.pi / 40, 0.0, 0.0)),),
        force=(-200.0, 100.0, 300.0),
        moment=(500.0, 0.0, 0.0),
    ),
)


_ANGLE = (0.0, 0.0, math.pi / 2)
MORE = (  # kept for the tests
    Static("post-buckled column", (_ROD,), force=(-8.0, 0.2, 0.3), steps=40),
    Static("follower force and moment", (_ROD,), follower_force=(0.0, 3.0, 4.0), follower_moment=(1.0, 2.0, 3.0)),
    Static("moment about a fixed skew axis", (_ROD,), moment=(1.0, 2.0, 3.0)),
    Static("stretched by half", (Piece(1.0, (10.0, 5.0, 5.0, 1.0, 1.0, 1.5)),), force=(5.0, 1.0, 1.0)),
    Static(
        "half a ring under a follower", (Piece(math.pi, UNIT, (0.0, 0.0, 1.0)),), follower_force=(0.5, 0.0, 0.5)
    ),
    Static("frame under a follower", (_ROD, Piece(1.0, UNIT, turn=_ANGLE)), follower_force=(2.0, 1.0, 1.0)),
    Static(
        "composite frame, its second leg twisted at rest",
        (Piece(10.0, COMPOSITE), Piece(5.0, COMPOSITE, (math.pi / 20, 0.0, 0.0), (0.0, 0.0, math.pi / 3))),
        force=(-100.0, 100.0, 200.0),
        follower_moment=(300.0, 0.0, -200.0),
    ),
)


@dataclass(frozen=True)
class Buckling:
    """Loads that grow with a factor until the equilibrium has neighbours."""

    name: str
    pieces: tuple[Piece, ...]
    between: tuple[float, float]  # factors
    unit: float  # that factors are told in
    known: str  # in that unit
    force: tuple[float, float, float] = Z  # of factor 1, on the tip
    arms: tuple[tuple[Any, Any], ...] = ()  # dead forces of factor 1 on rigid bars: place in the tip's axes, force
    shoots: bool = True


def _strip(ratio: float) -> Piece:
    """Weak against strong bending stiffness."""
    return Piece(1.0, (1e6, 1e6, 1e6, 1.0, 1.3, 1.3 / ratio))


_ROOT = math.sqrt(1.3)  # of EI GJ of the strip
_AXIAL = (((0.0, 0.5, 0.0), (-1.0, 0.0, 0.0)), ((0.0, -0.5, 0.0), (1.0, 0.0, 0.0)))
_BOTH = (
    *((place, tuple(x / 2 for x in force)) for place, force in _AXIAL),
    ((0.5, 0.0, 0.0), (0.0, 0.5, 0.0)),
    ((-0.5, 0.0, 0.0), (0.0, -0.5, 0.0)),
)
# Argyris et al. 1979: legs of 240 mm, 30 x 0.6 mm, E 71240 N/mm², nu 0.31; N and mm
_LEG = rectangle(71240.0, 71240.0 / 2.62, 30.0, 0.6, 30.0 * 0.6**3 / 3)
_FRAME = (Piece(240.0, _LEG), Piece(240.0, _LEG, turn=(0.0, 0.0, -math.pi / 2)))
BUCKLING = (
    *(
        Buckling(
            f"strip, force at the tip, stiffness {1 / r:g} to 1",
            (_strip(r),), (3.3 * _ROOT, 4.8 * _ROOT), _ROOT, "4.01260, the stiff way rigid",
            force=(0.0, -1.0, 0.0), shoots=r == 1e-2,
        )
        for r in (1e-2, 1e-3, 1e-4)
    ),
    Buckling(
        "strip, moment by dead forces along it on a bar across",
        (_strip(1e-4),), (1.3 * _ROOT, 1.9 * _ROOT), _ROOT, "π/2 = 1.57080, the stiff way rigid", arms=_AXIAL,
    ),
    Buckling(
        "strip, moment by dead forces on two bars (semitangential)",
        (_strip(1e-4),), (2.5 * _ROOT, 3.8 * _ROOT), _ROOT, "π = 3.14159, the stiff way rigid", arms=_BOTH,
        shoots=False,
    ),
    Buckling("right-angle frame, force along the clamped leg, outwards (N)", _FRAME, (0.6, 1.4), 1.0,
             "1.09 Argyris et al.", force=(1.0, 0.0, 0.0)),
    Buckling("right-angle frame, force inwards (N)", _FRAME, (0.4, 0.9), 1.0, "",
             force=(-1.0, 0.0, 0.0)),
)  # fmt: skip


@dataclass(frozen=True)
class Ring:
    """A curved rod, clamped at one end, to vibrate."""

    name: str
    piece: Piece
    shapes: int  # of each strain
    links: int = 1  # of as many beams of the same curvature
    points: int = 30  # of collocation

    @property
    def curvature(self) -> np.ndarray:
        return np.array(self.piece.curvature)


def _inertia(density: float, A: float, Iy: float, Iz: float) -> tuple[float, ...]:
    return (density * A, density * A, density * A, density * (Iy + Iz), density * Iy, density * Iz)


def _bow(turns: float) -> Ring:
    """Aluminium, 10 mm square, radius 0.5 m."""
    side, radius = 0.01, 0.5
    stiffness = rectangle(70e9, 26e9, side, side, 0.1406 * side**4)
    inertia = _inertia(2700.0, side**2, side**4 / 12, side**4 / 12)
    piece = Piece(turns * 2 * math.pi * radius, stiffness, (0.0, 0.0, 1 / radius), inertia=inertia)
    return Ring(f"arc of {360 * turns:g}°", piece, 12)


def _spring() -> Ring:
    """Mottershead's spring (1980): wire of 1 mm, mean radius 5 mm, 7.6 turns, pitch angle 8.5744°."""
    d, radius, pitch, E, density, nu = 1e-3, 5e-3, math.radians(8.5744), 2.06e11, 7900.0, 0.3
    A, I, G = math.pi * d**2 / 4, math.pi * d**4 / 64, E / (2 + 2 * nu)
    stiffness = (E * A, 0.9 * G * A, 0.9 * G * A, 2 * G * I, E * I, E * I)
    curvature = (math.sin(pitch) * math.cos(pitch) / radius, 0.0, math.cos(pitch) ** 2 / radius)
    piece = Piece(15.2 * math.pi * radius / math.cos(pitch), stiffness, curvature, inertia=_inertia(density, A, I, I))
    return Ring("helical spring of 7.6 turns, 8 beams", piece, 8, links=8, points=70)


RINGS = (_bow(0.25), _bow(0.5), _bow(0.75), _bow(1.0), _spring())


@dataclass(frozen=True)
class Pulse:
    """Dead or following force and moment at the end of a piece: a triangle in time, or a sine to the sixth."""

    piece: int  # its end; -1: the root of the first
    force: tuple[float, float, float] = Z
    moment: tuple[float, float, float] = Z
    knots: tuple[float, float, float] = (0.0, 1.0, 2.0)
    follows: bool = False
    smooth: bool = False

    def share(self, t: float) -> float:
        """Of force and moment, at a time."""
        if self.smooth:
            return math.sin(math.pi * t / self.knots[2]) ** 6 if t < self.knots[2] else 0.0
        return float(np.interp(t, self.knots, (0.0, 1.0, 0.0)))


@dataclass(frozen=True)
class Dynamic:
    """A chain at rest, then struck."""

    name: str
    title: str
    pieces: tuple[Piece, ...]
    pulses: tuple[Pulse, ...]
    end: float  # s
    outputs: int
    free: bool = False  # no clamp
    root: tuple[Any, Any] = field(default=(Z, Z))  # where it lies and how it is turned (rotation vector)

    @property
    def times(self) -> np.ndarray:
        return np.linspace(0.0, self.end, self.outputs + 1)


_ELBOW = Piece(10.0, (1e6, 1e6, 1e6, 1e3, 1e3, 1e3), inertia=(1.0, 1.0, 1.0, 20.0, 10.0, 10.0))
_FLYING = Piece(10.0, (1e4, 1e4, 1e4, 500.0, 500.0, 500.0), inertia=(1.0, 1.0, 1.0, 20.0, 10.0, 10.0))


def _elbow(name: str, title: str, smooth: bool) -> Dynamic:
    pieces = (_ELBOW, Piece(10.0, _ELBOW.stiffness, turn=(0.0, 0.0, math.pi / 2), inertia=_ELBOW.inertia))
    return Dynamic(name, title, pieces, (Pulse(0, force=(0.0, 0.0, 50.0), smooth=smooth),), end=4.0, outputs=40)


def _spaghetti(name: str, title: str, smooth: bool) -> Dynamic:
    pulse = Pulse(-1, (20.0, 0.0, 0.0), (0.0, 100.0, 200.0), (0.0, 2.5, 5.0), smooth=smooth)
    root = ((6.0, 0.0, 0.0), (0.0, 0.0, math.pi - math.asin(0.8)))
    return Dynamic(name, title, (_FLYING,), (pulse,), end=5.0, outputs=50, free=True, root=root)


DYNAMICS = (
    _elbow("elbow", "right-angle cantilever, triangular pulse", False),
    _elbow("elbow-smooth", "right-angle cantilever, smooth pulse", True),
    _spaghetti("spaghetti", "flying spaghetti, triangular pulse", False),
    _spaghetti("spaghetti-smooth", "flying spaghetti, smooth pulse", True),
    Dynamic(
        "follower",
        "cantilever, smooth follower pulse",
        (_ELBOW,),
        (Pulse(0, force=(0.0, 30.0, 40.0), follows=True, smooth=True),),
        end=5.0,
        outputs=50,
    ),
)
