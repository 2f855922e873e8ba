"""Equilibria of rods that stretch, shear, twist and bend, straight and curved at rest, against shooting
(tests/data/rods.json)."""

import json
from pathlib import Path

import flexarm as fa
import numpy as np
import pytest
from arms import STRAINS

CASES = {c["name"]: c for c in json.loads((Path(__file__).parent.parent / "data" / "rods.json").read_text())["cases"]}


def cantilever(case: dict, n: int) -> fa.Arm:
    """Of the case's stiffness, so light that its weight is none."""
    section = fa.SectionMatrix(case["stiffness"], 1e-6 * np.diag([1, 1, 1, 2e-2, 1e-2, 1e-2]))
    first, slope, length = np.array(case["curvature"]), np.array(case["curvature_slope"]), case["length"]
    beam = fa.Beam(
        length,
        section,
        modes={s: n for s in STRAINS},
        basis="legendre",
        order="exact",
        curvature=lambda x: first + slope * x / length,
    )
    return fa.Arm([fa.Link(fa.Fixed(), None, beam)])


@pytest.mark.parametrize("name", CASES)
def test_equilibria(name: str) -> None:
    """To 1e-8 of the length, the rod's reaction and its shape at rest among it."""
    case = CASES[name]
    arm = cantilever(case, 8)
    assert np.abs(arm.frame(arm.zero)[0] - case["tip_at_rest"]).max() < 1e-11 * case["length"]
    loads = [fa.Load(force=case["force"], moment=case["moment"])]
    q = arm.equilibrium(loads=loads)
    p, R = arm.frame(q)
    assert np.abs(p - case["tip"]).max() < 1e-8 * case["length"]
    assert np.abs(R - case["tip_orientation"]).max() < 1e-8
