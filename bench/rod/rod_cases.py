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


@dataclass(frozen=True)
class Pulse:
    """Dead or following force and moment at the end of a piece: a triangle in time, or the square of a sine."""

    piece: int  # its end; -1: the root of the first
    force: tuple[float, float, float] = Z
    moment: tuple[float, float, float] = Z
    knots: tuple[float, float, float] = (0.0, 1.0, 2.0)
    follows: bool = False
    smooth: bool = False

    def share(self, t: float) -> float:
        """Of force and moment, at a time."""
        if self.smooth:
            return math.sin(math.pi * t / self.knots[2]) ** 2 if t < self.knots[2] else 0.0
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
DYNAMICS = (
    Dynamic(
        "elbow",
        "right-angle cantilever (Simo & Vu-Quoc 1988), a force of 50 N out of its plane at the elbow",
        (_ELBOW, Piece(10.0, _ELBOW.stiffness, turn=(0.0, 0.0, math.pi / 2), inertia=_ELBOW.inertia)),
        (Pulse(0, force=(0.0, 0.0, 50.0)),),
        end=6.0,
        outputs=60,
    ),
    Dynamic(
        "spaghetti",
        "flying spaghetti (Simo & Vu-Quoc 1988): a free rod with a force and moments at one end",
        (_FLYING,),
        (Pulse(-1, (20.0, 0.0, 0.0), (0.0, 100.0, 200.0), (0.0, 2.5, 5.0)),),
        end=5.0,
        outputs=100,
        free=True,
        root=((6.0, 0.0, 0.0), (0.0, 0.0, math.pi - math.asin(0.8))),
    ),
    Dynamic(
        "follower",
        "a cantilever under a pulse that follows its tip",
        (_ELBOW,),
        (Pulse(0, force=(0.0, 30.0, 40.0), follows=True, smooth=True),),
        end=5.0,
        outputs=100,
    ),
)
