"""Materials of beams."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import flexarm._core as _core

from .part import Part


@dataclass(frozen=True)
class Material(Part):
    """Linear elastic, isotropic material of a beam.

    Args:
        density: kg/m^3.
        youngs_modulus: Pa.
        poisson_ratio: for torsion and shear; this or `shear_modulus`, not both.
        shear_modulus: Pa.
    """

    density: float
    youngs_modulus: float
    poisson_ratio: float | None = None
    shear_modulus: float | None = None
    _core: _core.Material = field(init=False, repr=False, compare=False)

    def _made(self) -> Any:
        return _core.Material(self.density, self.youngs_modulus, self.poisson_ratio, self.shear_modulus)
