"""The rods that flexarm and SoRoMoX are compared on. Needs NumPy only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Rods:
    """Equal circular rods in a row (SI), so many strain shapes each; on hinges along z and y in turn, or clamped."""

    name: str
    count: int
    bending_y: int
    bending_z: int
    torsion: int
    hinged: bool
    gravity: tuple[float, float, float]
    points: int  # of SoRoMoX's quadrature: the fewest that leave its accelerations within one per cent
    length: float = 0.5
    radius: float = 0.01
    density: float = 1000.0
    youngs_modulus: float = 1e7
    poisson_ratio: float = 0.45


RODS = (
    Rods("7 rods of 3+3+1 strains, hinged", 7, 3, 3, 1, True, (0.0, 0.0, -9.81), 5),
    Rods("1 planar rod of 4 strains, clamped", 1, 4, 0, 0, False, (0.0, -9.81, 0.0), 8),
)


def state(rods: Rods) -> tuple[np.ndarray, np.ndarray]:
    """Some coordinates and rates in flexarm's order: bent by some tenths of a radian a metre."""
    i = np.arange(rods.count * (rods.hinged + rods.bending_y + rods.bending_z + rods.torsion))
    return 0.2 * np.sin(1.7 * i + 1.0), 0.3 * np.cos(2.3 * i)


def soromox_order(rods: Rods, x: np.ndarray) -> np.ndarray:
    """From flexarm's coordinates (joint, bending along y, bending along z, torsion) to SoRoMoX's (joint, curvatures
    about x, y, z); what bends along z has curvature -K2."""
    parts = np.cumsum([rods.hinged, rods.bending_y, rods.bending_z])
    joint, along_y, along_z, twist = np.split(x.reshape(rods.count, -1), parts, axis=1)
    return np.hstack([joint, twist, -along_z, along_y]).ravel()
