"""Where a run starts: as numbers, joints by name, or in balance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .._check import Array, array, choice
from ..acting.drive import Motion
from ..acting.load import Load
from ..acting.voltage import is_patch, split_drives
from ..arm import Arm

WORDS = ("equilibrium", "trim")


def start(
    arm: Arm, q0: Any, drive: Mapping[Any, Any] | None, loads: Sequence[Load] | None, t: float, tau: Any = None
) -> Array:
    """q (nq,) of what a q0 says: numbers, joints by name, or where the arm is in balance at time t (s); zero if None.

    Raises:
        ValueError: bad numbers or names, or no balance was found.
    """
    if not isinstance(q0, str):
        return arm._place("q0", q0)
    word, loads = choice("q0", q0, WORDS), tuple(loads or ())
    moved = {key: float(law(t)[0]) for key, law in (drive or {}).items() if isinstance(law, Motion)}
    pose = arm.pose(moved)
    forces, volts = acting(arm, drive or {}, t)
    if word == "trim":
        return arm.trim(pose, loads=loads, t=t, voltages=volts or None).q
    forces = forces if tau is None else forces + array("tau", tau, (arm.nv,))
    return arm.equilibrium(pose, forces, list(moved), loads=loads, t=t, voltages=volts or None)


def state(
    arm: Arm, q0: Any, v0: Any, drive: Mapping[Any, Any] | None, loads: Sequence[Load] | None, t: float
) -> tuple[Array, Array]:
    """q (nq,) and v (nv,) at time t (s); joints whose motion is prescribed are where that is."""
    q, v = np.array(start(arm, q0, drive, loads, t)), np.zeros(arm.nv) if v0 is None else np.array(v0, dtype=float)
    for i, law in arm.by_rate("drive", split_drives(drive)[0]).items():
        if isinstance(law, Motion):
            q[arm.coordinate_of(i)], v[i] = law(t)[:2]
    return q, v


def acting(arm: Arm, drive: Mapping[Any, Any], t: float) -> tuple[Array, dict[Any, float]]:
    """Forces of the joints' drives (nv,) and voltages of the patches, by (link, patch), at time t (s)."""
    tau, volts = np.zeros(arm.nv), {}
    for key, law in drive.items():
        if is_patch(key):
            volts[arm._link(key[1], "drive: link"), key[2]] = float(law(t))
        elif not isinstance(law, Motion):
            tau[arm.joint_rate(key, "drive: link")] += float(law(t))
    return tau, volts
