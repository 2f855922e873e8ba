"""The cases of bench/rod/rods.py in flexarm: all six strains, order "exact", Legendre shapes."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import flexarm as fa
import numpy as np
from rod_cases import Buckling, Dynamic, Piece, Pulse, Static
from scipy.optimize import brentq

STRAINS = ("bending_y", "bending_z", "torsion", "shear_y", "shear_z", "extension")


def beam(piece: Piece, shapes: int) -> fa.Beam:
    """A beam with so many shapes of each strain."""
    section = fa.SectionMatrix(piece.matrix, np.diag(piece.inertia))
    modes = {s: shapes for s in STRAINS}
    curvature = piece.curvature if any(piece.curvature) else None
    return fa.Beam(piece.length, section, None, modes, "legendre", "exact", curvature=curvature)


def arm(pieces: tuple[Piece, ...], shapes: int, base: fa.Joint | None = None) -> fa.Arm:
    """Beams in a row, the first clamped or on `base`."""
    links = []
    for k, piece in enumerate(pieces):
        place = fa.Placement(rotation=piece.turn) if any(piece.turn) else None
        links.append(fa.Link(base if base and not k else fa.Fixed(inboard=place), None, beam(piece, shapes)))
    return fa.Arm(links)


def equilibrium(case: Static, shapes: int) -> tuple[np.ndarray, np.ndarray, float, int]:
    """The tip's place and rotation, CPU time of the solution (s), number of coordinates."""
    model = arm(case.pieces, shapes)
    loads = [
        fa.Load(force=case.force, moment=case.moment),
        fa.Load(force=case.follower_force, moment=case.follower_moment, axes="section"),
    ]
    start = time.process_time()
    q = model.equilibrium(loads=loads)
    cpu = time.process_time() - start
    return *model.frame(q), cpu, model.nq


def _law(pulse: Pulse, vector: Any) -> Callable[[float], np.ndarray]:
    return lambda t: pulse.share(t) * np.array(vector)


def simulate(case: Dynamic, shapes: int, step: float, stages: int = 4) -> tuple[np.ndarray, float, int]:
    """Root and ends of all pieces (outputs + 1, 3 (pieces + 1)), CPU time (s), number of rates."""
    base = fa.Free(inboard=fa.Placement(case.root[0], case.root[1])) if case.free else None
    model = arm(case.pieces, shapes, base)
    loads = []
    for pulse in case.pulses:
        at: dict[str, Any] = {"link": 0, "x": 0.0} if pulse.piece < 0 else {"link": pulse.piece}
        at["axes"] = "section" if pulse.follows else "world"
        if pulse.smooth:
            loads.append(fa.Load(**at, force=_law(pulse, pulse.force), moment=_law(pulse, pulse.moment)))
        else:
            t = np.array([*pulse.knots, max(case.end, 1.001 * pulse.knots[2])])
            rows = np.array([0.0, 1.0, 0.0, 0.0])[:, None]
            loads.append(fa.Load(**at, force=rows * pulse.force, moment=rows * pulse.moment, t=t))
    start = time.process_time()
    result = fa.simulate(model, case.times, loads=loads, integrator="gauss", step=step, stages=stages)
    cpu = time.process_time() - start
    ends = [result.frame(k)[0] for k in range(len(case.pieces))]
    root = result.frame(0, 0.0)[0] if case.free else np.zeros_like(ends[0])
    return np.hstack([root, *ends]), cpu, model.nv


def softest(model: fa.Arm, q: np.ndarray, loads: list[fa.Load]) -> tuple[float, np.ndarray]:
    """The lowest square of a frequency (rad^2/s^2), negative where it grows instead, about the balance near q; and
    that balance."""
    modes = model.modes(q, loads=loads)
    return float(-np.real(modes.eigenvalues**2).max()), modes.q


def critical(model: fa.Arm, loads: Callable[[float], list[fa.Load]], low: float, high: float) -> float:
    """The load factor between two at which a frequency about the equilibrium comes to zero: where the polynomial
    through its squares at somewhat less load does. (Close to it a square is told as zero, as double precision knows no
    better; and beyond it another mode may be the lowest.)"""
    q = model.equilibrium(loads=loads(low))
    near = float(brentq(lambda f: softest(model, q, loads(f))[0], low, high, rtol=1e-3))
    factors = near * (0.93 + 0.05 * np.cos(np.pi * (np.arange(8) + 0.5) / 8))
    squares = np.array([softest(model, q, loads(f))[0] for f in factors])
    roots = np.polynomial.Chebyshev.fit(factors, squares, factors.size - 1).roots()
    roots = roots[np.abs(roots.imag) < 1e-6 * near].real
    return float(roots[np.abs(roots - near).argmin()])


def buckled(case: Buckling, shapes: int) -> float:
    """The critical factor; bars on the tip are massless links."""
    links, at = list(arm(case.pieces, shapes).links), np.zeros(3)
    for place, _ in case.arms:
        links.append(fa.Link(fa.Fixed(), fa.RigidBody(end=tuple(np.array(place) - at))))
        at = np.array(place)
    first = len(case.pieces)

    def loads(factor: float) -> list[fa.Load]:
        forces = [(first - 1, case.force), *((first + k, force) for k, (_, force) in enumerate(case.arms))]
        return [fa.Load(link, force=tuple(factor * np.array(force))) for link, force in forces]

    return critical(fa.Arm(links), loads, *case.between)


def split(piece: Piece, links: int, shapes: int) -> fa.Arm:
    """A curved rod as so many beams in a row."""
    return arm((replace(piece, length=piece.length / links),) * links, shapes)
