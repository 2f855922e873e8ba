"""Layered strips as beams: classical lamination theory with free edges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import flexarm._core as _core

from ..._check import Array, choice, instances, positive, tilde, warn
from .material import Material
from .part import Finite, ModelWarning, Part, Positive
from .sections import SectionMatrix

_THICK = 1 / 3  # of the width: the largest thickness of a plate
_GAUSS = np.polynomial.legendre.leggauss(5)  # exact for squares of the plies' shear stress, of order 4


@dataclass(frozen=True)
class Orthotropic(Part):
    """Material of a ply: 1 along its fibres, 2 across them in the ply's plane, 3 through its thickness.

    Args:
        density: kg/m^3.
        E1, E2: Young's moduli (Pa).
        G12: shear modulus in the plane (Pa).
        nu12: Poisson's ratio, strain across for a stress along the fibres.
        G13, G23: shear moduli through the thickness (Pa). None: as G12.
    """

    density: Positive
    E1: Positive
    E2: Positive
    G12: Positive
    nu12: float
    G13: Positive | None = None
    G23: Positive | None = None

    def _made(self) -> None:
        most = (self.E1 / self.E2) ** 0.5
        if not abs(self.nu12) < most:
            raise ValueError(f"nu12 = {self.nu12}: must lie between -sqrt(E1 / E2) and sqrt(E1 / E2), {most:.4g}")


@dataclass(frozen=True)
class Ply(Part):
    """One layer of a laminate.

    Args:
        thickness: m.
        material: an Orthotropic, or a Material with poisson_ratio.
        angle: of the fibres (rad), from x towards the strip's other axis: z where the plies lie on one another along y,
            and y where they do along z.
    """

    thickness: Positive
    material: Orthotropic | Material
    angle: Finite = 0.0

    def _made(self) -> None:
        if abs(self.angle) > 2 * np.pi:
            warn(f"angle = {self.angle:g} rad of a ply: is it in degrees?", ModelWarning)
        if isinstance(self.material, Material) and not self.material._core.shear_modulus > 0.0:
            raise ValueError(f"material = {self.material!r}: must have a poisson_ratio or a shear_modulus")

    def _moduli(self) -> tuple[Array, Array]:
        """Stiffness of plane stress (xx, ss, xs), and that of shear through the thickness (xn, sn); x and s the strip's
        axes, n its normal."""
        m = self.material
        if isinstance(m, Material):
            E, G = m.youngs_modulus, m._core.shear_modulus
            E1, E2, nu, G12, G13, G23 = E, E, E / (2 * G) - 1, G, G, G
        else:
            E1, E2, nu, G12 = m.E1, m.E2, m.nu12, m.G12
            G13, G23 = (G12 if G is None else G for G in (m.G13, m.G23))
        c, s = np.cos(self.angle), np.sin(self.angle)
        # strains along the fibres' axes, by those along the strip's
        T = np.array([[c * c, s * s, c * s], [s * s, c * c, -c * s], [-2 * c * s, 2 * c * s, c * c - s * s]])
        R = np.array([[c, s], [-s, c]])
        Q = np.linalg.inv(np.array([[1 / E1, -nu / E1, 0], [-nu / E1, 1 / E2, 0], [0, 0, 1 / G12]]))
        return T.T @ Q @ T, R.T @ np.diag([G13, G23]) @ R


def laminate(width: float, plies: Sequence[Ply], normal: str = "y") -> SectionMatrix:
    """Section of a flat strip of plies, about the middle of its thickness and width.

    Classical lamination theory (Jones, Mechanics of Composite Materials; Kollar and Springer, Mechanics of Composite
    Structures) of a narrow strip: its edges are free, so that nothing pulls or bends it across (N_s = M_s = 0). It has
    all couplings of the plies: of stretch and shear, stretch and twist, bending and twist, stretch and bending.
    Its torsion is that of a plate, 4 b D66 where nothing is coupled, with Saint-Venant's loss at the edges; shear in
    the plane is parabolic (5/6), that through the thickness in equilibrium with the plies' stresses. Against the
    elasticity of the section, strips of fibres along and across are right to 1 % from a width of three thicknesses on;
    of plies at angles the free edges are softer than in this theory: of carbon by up to 0.9 t/b in bending in the
    plane, 0.3 t/b in the others, t the thickness.

    Args:
        width: b (m).
        plies: from the least to the greatest y (or z).
        normal: "y": the plies lie on one another along y, and the width along z; "z": the other way.

    Returns:
        SectionMatrix, which holds the plies' density.

    Warns:
        ModelWarning: the laminate is thicker than a third of its width, so that plate theory does not hold.
    """
    b = positive("width", width)
    choice("normal", normal, ("y", "z"))
    instances("plies", plies, Ply, "Ply", 1)
    edges = np.cumsum([0.0, *(p.thickness for p in plies)])
    edges -= edges[-1] / 2
    t = float(edges[-1] - edges[0])
    if t > _THICK * b:
        warn(
            f"laminate: is {t:.3g} m thick and {b:.3g} m wide: its law is that of plates, thinner than a third of the "
            "width; see polygon for thick sections",
            ModelWarning,
        )
    return SectionMatrix(*(of(b, plies, edges, normal).tolist() for of in (_stiffness, _inertia)))


def _plate(plies: Sequence[Ply], edges: Any) -> Array:
    """(N_x N_s N_xs M_x M_s M_xs) by (strains of the middle, curvatures): [A B; B D]."""
    moments = [np.diff(edges**k) / k for k in (1, 2, 3)]
    A, B, D = (sum(m * p._moduli()[0] for m, p in zip(moment, plies, strict=True)) for moment in moments)
    return np.block([[A, B], [B, D]])


def _stiffness(b: float, plies: Sequence[Ply], edges: Any, normal: str) -> Array:
    full = np.linalg.inv(_plate(plies, edges))  # strains by resultants
    S = full[np.ix_([0, 2, 3, 5], [0, 2, 3, 5])]  # (eps_x, gamma_xs, kappa_x, kappa_xs), edges free: N_s = M_s = 0
    t, through = float(edges[-1] - edges[0]), _shear_compliance(plies, edges, full[:, 3])
    # strains by section forces: N = b N_x, V = b N_xs, M = b M_x, torque = 2 b M_xs with the twist kappa_xs / 2
    twist = np.array([1.0, 1.0, 1.0, 0.5])
    F = S * np.outer(twist, twist) / b
    F[1, 1] *= 6 / 5
    transverse = sum(p.thickness / p._moduli()[1][0, 0] for p in plies) / t  # 1 / G_xn
    stretched = b * (S[3, 3] * t**3 / 12 / transverse) ** 0.5  # the width, as if G_xs were G_xn
    F[3, 3] /= 3 * _core.Section.rectangle(t, stretched, (1.0, 1.0)).torsion_constant / (stretched * t**3)
    K = np.linalg.inv(F)
    held = np.linalg.inv(S[np.ix_([0, 2, 3], [0, 2, 3])])[0, 0]  # N_x by eps_x, not bent nor twisted, N_xs = 0
    out = np.zeros((6, 6))
    # the strip's strains as the beam's: (eps, gamma in the plane, kappa_x, twist)
    rows, signs = ([0, 2, 5, 3], [1, 1, -1, 1]) if normal == "y" else ([0, 1, 4, 3], [1, 1, 1, -1])
    out[np.ix_(rows, rows)] = K * np.outer(signs, signs)
    shear, wide = (1, 4) if normal == "y" else (2, 5)
    out[shear, shear] = b / through
    out[wide, wide] = held * b**3 / 12
    return 0.5 * (out + out.T) + 0.0  # and no -0.0


def _shear_compliance(plies: Sequence[Ply], edges: Any, bent: Any) -> float:
    """Shear angle by shear force per width (m/N): the energy of shear stresses that balance those of bending, whose
    strains per moment are `bent`."""
    below, energy = np.zeros(2), 0.0
    for ply, lo, hi in zip(plies, edges, edges[1:], strict=False):
        Q, G = ply._moduli()
        at_zero, slope = (Q @ bent[:3])[[0, 2]], (Q @ bent[3:])[[0, 2]]  # stresses xx and xs

        def stress(n: Any, start: Array = below, lo: Any = lo, a: Array = at_zero, s: Array = slope) -> Array:
            return start - np.outer(n - lo, a) - np.outer((n * n - lo * lo) / 2, s)

        n = (lo + hi) / 2 + (hi - lo) / 2 * _GAUSS[0]
        tau = stress(n)
        energy += float((hi - lo) / 2 * (_GAUSS[1] @ np.einsum("ni,ij,nj->n", tau, np.linalg.inv(G), tau)))
        below = stress(np.array([hi]))[0]
    return energy


def _inertia(b: float, plies: Sequence[Ply], edges: Any, normal: str) -> Array:
    density = np.array([p.material.density for p in plies])
    m, first, second = (b * float(density @ np.diff(edges**k)) / k for k in (1, 2, 3))
    wide = m * b * b / 12
    c = np.array([0.0, first, 0.0] if normal == "y" else [0.0, 0.0, first])
    about = np.diag([second + wide, wide, second] if normal == "y" else [second + wide, second, wide])
    C = tilde(c)
    return np.block([[m * np.eye(3), -C], [C, about]]) + 0.0
