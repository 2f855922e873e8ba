"""Mechanisms of beams of bench/run/loops.py; the same numbers for flexarm and for its peers. Needs NumPy only."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

OUTPUTS = 100  # times at which places are compared
E, NU, RHO = 209e9, 0.3, 7850.0  # of steel


@dataclass(frozen=True)
class Planar:
    """A crank, a coupler, and a rocker or a block; beams in the plane x, y, straight and at rest at first."""

    crank: float
    coupler: float
    rocker: float
    base: float | None  # place of the rocker's foot on the x axis; None: a block slides there
    angle: float  # of the crank at first (rad)
    thick: float  # of the beams, in the plane (m)
    wide: float
    end: float  # s
    block: float = 0.0  # kg
    hub: float = 0.0  # kg m^2, on the crank's axis
    knots: tuple[float, ...] = ()
    torques: tuple[float, ...] = ()  # on the crank (N m), linear between knots
    turn: float = 0.0  # of the crank from 0 to the end, prescribed, of degree 5 (rad); 0: it is free
    retardation: float = 1e-4  # s
    gravity: float = 9.81  # along -y

    @property
    def span(self) -> float:
        return self.crank + self.coupler

    def stiffness(self) -> dict[str, float]:
        A, I = self.thick * self.wide, self.wide * self.thick**3 / 12
        shear = 10 * (1 + NU) / (12 + 11 * NU)
        return {"mass": RHO * A, "turning": RHO * I, "EI": E * I, "EA": E * A, "GA": shear * E / (2 + 2 * NU) * A}

    def angles(self) -> tuple[float, float]:
        """Of coupler and rocker at first (rad), from +x; the elbow is above."""
        x, y = self.crank * np.cos(self.angle), self.crank * np.sin(self.angle)
        if self.base is None:
            return float(np.arcsin(-y / self.coupler)), 0.0
        far, way = np.hypot(self.base - x, y), np.arctan2(-y, self.base - x)
        up = way + np.arccos((far**2 + self.coupler**2 - self.rocker**2) / (2 * far * self.coupler))
        px, py = x + self.coupler * np.cos(up), y + self.coupler * np.sin(up)
        return float(up), float(np.arctan2(py, px - self.base))

    def places(self) -> list[tuple[tuple[float, float], tuple[float, float]]]:
        """Ends of the beams; the rocker's from the coupler to its foot."""
        up, _ = self.angles()
        elbow = (self.crank * np.cos(self.angle), self.crank * np.sin(self.angle))
        top = (elbow[0] + self.coupler * np.cos(up), elbow[1] + self.coupler * np.sin(up))
        found = [((0.0, 0.0), elbow), (elbow, top)]
        return [*found, (top, (self.base, 0.0))] if self.base is not None else found


FOURBAR = Planar(0.2, 0.5, 0.4, 0.45, 0.6, 0.004, 0.02, 1.0, hub=0.02, knots=(0.0, 0.1, 0.3, 0.4, 1.0),
                 torques=(0.0, 2.5, 2.5, 0.0, 0.0))  # fmt: skip
SLIDER = Planar(0.15, 0.5, 0.0, None, 0.0, 0.004, 0.02, 1.0, block=0.2, turn=6 * np.pi)


@dataclass(frozen=True)
class Held(Planar):
    """Two arms of two beams that hold a beam between them: `crank` and `coupler` are upper and fore arm of both,
    `rocker` is not used, and `base` is between their shoulders. The hands are rigid on the bar; elbows are free.
    `torques` act on the left shoulder, and half of them on the right one."""

    fore: float = 1.05  # angle of the left fore arm at first (rad); the right arm is a mirror

    def places(self) -> list[tuple[tuple[float, float], tuple[float, float]]]:
        """Left upper and fore arm, bar, right fore and upper arm, one after the other."""
        assert self.base is not None
        elbow = self.crank * np.array([np.cos(self.angle), np.sin(self.angle)])
        hand = elbow + self.coupler * np.array([np.cos(self.fore), np.sin(self.fore)])
        left = [(0.0, 0.0), tuple(elbow), tuple(hand)]
        right = [(self.base - x, y) for x, y in reversed(left)]
        points = left + right
        return list(pairwise(points))  # type: ignore[arg-type]

    @property
    def bar(self) -> float:
        (a, _), (b, _) = self.places()[2]
        return b - a


HELD = Held(0.3, 0.3, 0.0, 0.8, 1.9, 0.004, 0.02, 0.5, hub=0.02, knots=(0.0, 0.05, 0.15, 0.2, 0.5),
            torques=(0.0, 6.0, 6.0, 0.0, 0.0))  # fmt: skip


@dataclass(frozen=True)
class Misaligned:
    """Bauchau's four bars: A (0, 0), B (0, 0.12), C (0.24, 0.12), D (0.24, 0); hinges along z, but the one at C, which
    is 5 degrees off. The crank AB turns at 0.6 rad/s, after a smooth start."""

    speed: float = -0.6  # rad/s
    start: float = 1.0  # s, of degree 5, over which the crank turns by half of speed * start
    end: float = 12.0
    tilt: float = np.pi / 36
    E: float = 207e9
    NU: float = 0.3
    RHO: float = 7800.0
    sides: tuple[float, float, float] = (0.016, 0.016, 0.008)  # of the bars' square sections (m)
    retardation: float = 1e-4  # s
    corners: tuple[tuple[float, float], ...] = ((0.0, 0.0), (0.0, 0.12), (0.24, 0.12), (0.24, 0.0))
    # of a square of 16 mm, as the benchmark gives them: EA, kGA, GJ, EI; of other sides by their powers
    given: tuple[float, float, float, float] = (52.99e6, 16.88e6, 733.5, 1131.0)

    def angle(self, t: float) -> float:
        """Of the crank; its rate is a smooth step, 10 x^3 - 15 x^4 + 6 x^5."""
        x = min(t / self.start, 1.0)
        begun = x**4 * (2.5 - 3 * x + x * x)
        return self.speed * (self.start * begun + max(t - self.start, 0.0))

    def section(self, side: float) -> tuple[np.ndarray, float, np.ndarray]:
        """Stiffness of (stretch, shears, twist, bendings), mass and inertia per length."""
        x = side / 0.016
        EA, GA, GJ, EI = self.given
        K = np.diag([EA * x**2, GA * x**2, GA * x**2, GJ * x**4, EI * x**4, EI * x**4])
        I = self.RHO * side**4 / 12
        return K, self.RHO * side**2, np.diag([2 * I, I, I])


MISALIGNED = Misaligned()
