"""Mechanisms of beams of bench/run/loops.py; the same numbers for flexarm and for its peers. Needs NumPy only."""

from __future__ import annotations

from dataclasses import dataclass

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


FOURBAR = Planar(0.2, 0.5, 0.4, 0.45, 0.6, 0.004, 0.02, 1.0, hub=0.02, knots=(0.0, 0.1, 0.3, 0.4), torques=(0.0, 2.5, 2.5, 0.0))  # fmt: skip
SLIDER = Planar(0.15, 0.5, 0.0, None, 0.0, 0.004, 0.02, 1.0, block=0.2, turn=6 * np.pi)
