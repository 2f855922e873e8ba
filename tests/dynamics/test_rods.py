"""Equilibria of rods that stretch, shear, twist and bend, against shooting (tests/data/rods.json)."""

import json
from pathlib import Path

import flexarm as fa
import numpy as np
import pytest

CASES = {c["name"]: c for c in json.loads((Path(__file__).parent.parent / "data" / "rods.json").read_text())["cases"]}
DIAGONAL = [name for name, c in CASES.items() if np.count_nonzero(c["stiffness"]) == 6]


def cantilever(case: dict, n: int, **more) -> fa.Arm:
    """A section and a material with the case's stiffness: force x y z, moment x y z."""
    EA, GAy, GAz, GJ, EIy, EIz = np.diag(case["stiffness"])
    assert GAy == GAz
    section = fa.GeneralSection(1.0, EIy / EA, EIz / EA, GJ / GAy, 1.0)
    beam = fa.Beam(
        case["length"],
        section,
        fa.Material(1.0, EA, shear_modulus=GAy),
        {s: n for s in fa._core.STRAINS},
        "legendre",
        "exact",
        **more,
    )
    return fa.Arm([fa.Link(fa.Fixed(), None, beam)])


@pytest.mark.parametrize("name", [name for name in DIAGONAL if not np.any(CASES[name]["curvature_slope"] or 0)])
def test_straight_rods(name: str) -> None:
    case = CASES[name]
    if np.any(case["curvature"]):
        pytest.skip("curved")
    arm = cantilever(case, 8)
    q = arm.equilibrium(loads=[fa.Load(force=case["force"], moment=case["moment"])])
    p, R = arm.frame(q)
    assert np.abs(p - case["tip"]).max() < 1e-8 * case["length"]
    assert np.abs(R - case["tip_orientation"]).max() < 1e-8
