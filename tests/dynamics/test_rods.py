"""Equilibria of rods that stretch, shear, twist and bend, straight and curved at rest, against shooting
(tests/data/rods.json)."""

import json
from pathlib import Path

import flexarm as fa
import numpy as np
import pytest

CASES = {c["name"]: c for c in json.loads((Path(__file__).parent.parent / "data" / "rods.json").read_text())["cases"]}
DIAGONAL = [name for name, c in CASES.items() if np.count_nonzero(c["stiffness"]) == 6]


def cantilever(case: dict, n: int) -> fa.Arm:
    """A section and a material with the case's stiffness: force x y z, moment x y z."""
    EA, GAy, GAz, GJ, EIy, EIz = np.diag(case["stiffness"])
    assert GAy == GAz
    section = fa.GeneralSection(1e-6, EIy / EA * 1e-6, EIz / EA * 1e-6, GJ / GAy * 1e-6, 1.0)  # small for its length
    material = fa.Material(1.0, EA * 1e6, shear_modulus=GAy * 1e6)
    first, slope, length = np.array(case["curvature"]), np.array(case["curvature_slope"]), case["length"]
    modes = {s: n for s in fa._core.STRAINS}
    beam = fa.Beam(
        length, section, material, modes, "legendre", "exact", curvature=lambda x: first + slope * x / length
    )
    return fa.Arm([fa.Link(fa.Fixed(), None, beam)])


def test_the_cases() -> None:
    assert len(DIAGONAL) == 4 and len(CASES) == 5


@pytest.mark.parametrize("name", DIAGONAL)
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
