"""Electric motors between a controller and its joint."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np

from ..._check import Array
from ..parts.chain import Chain
from ..parts.part import Finite, NotNegative, Part, Positive


def torque_limits(arm: Chain) -> Array:
    """The largest total force of drives and controllers on each rate of an arm (N m, N), (nv,); infinity without a
    limit."""
    out = np.full(arm.nv, np.inf)
    for k, link in enumerate(arm.links):
        if link.joint.nv:
            out[arm.joint_rates(k)] = link.joint._per_freedom("torque_limit", link.joint.nv)
    return out


def reach_of(arm: Chain, columns: Array, limit: Any) -> Array:
    """The limit of each output with generalised forces `columns` (nv or more, nu): the least of its own limit and those
    of the motors at its joints."""
    with np.errstate(divide="ignore"):
        shares = torque_limits(arm)[:, None] / np.abs(columns[: arm.nv])
    return np.asarray(np.minimum(limit, shares.min(axis=0, initial=np.inf)))


@dataclass(frozen=True, repr=False)
class Motor(Part):
    """A geared electric motor between a controller and its joint.

    With `resistance`, the controller's output is a voltage and the back-EMF brakes; without, it is a current (an
    amplifier in current mode, as the paper's).

    Args:
        torque_constant: k_t (N m/A), which is the back-EMF constant (V s/rad) too.
        gear_ratio: n, motor revolutions for one of the joint.
        efficiency: of the gear, 0 to 1.
        limit: largest current (A), or voltage (V) with `resistance`; None: no limit.
        resistance: R of the winding (ohm); None: current mode.
        rotor_inertia: J_r (kg m²); give `reflected_inertia` = n² J_r to the joint.
    """

    torque_constant: Positive = 1.0
    gear_ratio: Finite = 1.0
    _: KW_ONLY
    efficiency: Positive = 1.0
    limit: Positive | None = None
    resistance: Positive | None = None
    rotor_inertia: NotNegative = 0.0

    def _made(self) -> None:
        if self.gear_ratio == 0.0:
            raise ValueError("gear_ratio = 0.0: must not be zero")
        if self.efficiency > 1.0:
            raise ValueError(f"efficiency = {self.efficiency}: must be at most 1")

    @property
    def reflected_inertia(self) -> float:
        """n² J_r (kg m²), the inertia of the rotor at the joint."""
        return self.gear_ratio**2 * self.rotor_inertia

    @property
    def gain(self) -> float:
        """Joint torque per unit of the controller's output (N m/A, or N m/V at rest)."""
        per_ampere = self.torque_constant * self.gear_ratio * self.efficiency
        return per_ampere if self.resistance is None else per_ampere / self.resistance

    @property
    def braking(self) -> float:
        """Damping by the back-EMF at the joint (N m s/rad); zero in current mode."""
        return 0.0 if self.resistance is None else self.gain * self.torque_constant * self.gear_ratio

    def __repr__(self) -> str:
        unit = "A" if self.resistance is None else "V"
        return f"Motor({self.gain:.4g} N m/{unit}, limit={self.limit})"
