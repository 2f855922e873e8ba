"""Exact beams take fewer Gauss points while their coordinates are small: runs do not tell."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import flexarm as fa
import numpy as np
import pytest

STEEL = fa.Material(7850.0, 209e9, 0.3)


@pytest.mark.parametrize(
    ("integrator", "options", "drift", "apart"),
    [
        ("gauss", {"step": 2e-3, "rtol": 1e-13}, 1e-9, 1e-9),
        ("implicit", {"step": 5e-4}, 1e-3, 1e-7),
        ("ida", {"rtol": 1e-9, "atol": 1e-11}, 1e-6, 1e-6),
    ],
)
def test_a_swing_across_the_bound_of_few_points(
    integrator: str, options: dict[str, Any], drift: float, apart: float
) -> None:
    """Against the same points, asked for: these are always all taken."""
    beam = fa.Beam(1.0, fa.Rectangle(0.004, 0.01), STEEL, {"bending_y": 2}, order="exact")
    t = np.linspace(0.0, 0.3, 31)
    runs = []
    for one in (beam, replace(beam, gauss_points=beam._core.gauss_points)):
        arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(0.5, inertia=(1e-2, 1e-2, 1e-2)), one)])
        q0 = arm.zero
        q0[-2:] = 0.2, 0.02  # a second mode that is sometimes within the bound
        run = fa.simulate(arm, t, q0=q0, integrator=integrator, **options)
        energy = np.array([sum(arm.energy(q, v)) for q, v in zip(run.q, run.v, strict=True)])
        assert np.ptp(energy) < drift * abs(energy).max()
        runs.append(run.q)
    assert abs(runs[0] - runs[1]).max() < apart
    assert (runs[0] != runs[1]).any()


def test_beams_that_choose_their_points_are_as_right_with_few_of_them() -> None:
    for modes in ({"bending_y": 3, "bending_z": 3, "torsion": 1}, {"bending_y": 3}):
        beam = fa.Beam(1.0, fa.Rectangle(0.004, 0.01), STEEL, modes, order="exact")
        few, many = (
            fa.Arm([fa.Link(fa.Universal(), beam=one), fa.Link(fa.Revolute("y"), fa.RigidBody(0.5, com=(0.1, 0, 0)))])
            for one in (beam, replace(beam, gauss_points=2 * beam._core.gauss_points))
        )
        q = 0.3 * np.sin(np.arange(few.nq))
        q[2 : 2 + beam.ne] *= 1e-3
        v, tau = np.cos(np.arange(few.nv)), np.zeros(few.nv)
        found, expected = few.forward_dynamics(q, v, tau), many.forward_dynamics(q, v, tau)
        assert abs(found - expected).max() < 1e-11 * abs(expected).max()
